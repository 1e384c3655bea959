//! What is printed, in words or as one JSON object per line (`--log json`).

use clap::ValueEnum;
use flatlight::Error;
use flatlight::error::printable;
use serde_json::json;

use super::Common;

/// Form of what is printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Log {
    /// Words.
    #[default]
    Text,
    /// One JSON object per line: `level` (result, warning, error) and `message`.
    Json,
}

fn line(level: &str, message: &str) -> String {
    json!({ "level": level, "message": message }).to_string()
}

/// A result, to stdout.
pub fn result(common: &Common, message: &str) {
    match common.log {
        Log::Text => println!("{}", printable(message)),
        Log::Json => println!("{}", line("result", message)),
    }
}

/// Something to distrust, to stderr; not if quiet.
pub fn warning(common: &Common, message: &str) {
    if common.quiet {
        return;
    }
    match common.log {
        Log::Text => eprintln!("warning: {}", printable(message)),
        Log::Json => eprintln!("{}", line("warning", message)),
    }
}

/// Why the program ends, to stderr.
pub fn error(log: Log, error: &Error) {
    match log {
        Log::Text => eprintln!("error: {error}"),
        Log::Json => eprintln!(
            "{}",
            json!({ "level": "error", "message": error.to_string(), "exit_code": error.exit_code() })
        ),
    }
}
