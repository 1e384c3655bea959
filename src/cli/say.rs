//! What is printed, in words or as one JSON object per line (`--log json`).

use std::io::{self, Write as _};
use std::sync::OnceLock;

use clap::ValueEnum;
use flatlight::error::printable;
use flatlight::{Error, Result};
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

/// Why stdout could not be written to.
static UNPRINTED: OnceLock<String> = OnceLock::new();

/// Text to stdout as it is. What cannot be printed is kept for [`printed`]; a reader that has read enough, as `head` does, is no fault.
pub fn print(text: &str) {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(cause) if cause.kind() != io::ErrorKind::BrokenPipe => {
            let _ = UNPRINTED.set(cause.to_string());
        }
        _ => {}
    }
}

/// Whether all results reached stdout.
///
/// # Errors
/// If they did not, as where it leads to a full disk.
pub fn printed() -> Result<()> {
    match UNPRINTED.get() {
        None => Ok(()),
        Some(cause) => Err(Error::input(format!("cannot print the result: {cause}"))
            .advice("Let the standard output lead to a place with free space.")),
    }
}

/// A result, to stdout.
pub fn result(common: &Common, message: &str) {
    match common.log {
        Log::Text => print(&format!("{}\n", printable(message))),
        Log::Json => print(&format!("{}\n", line("result", message))),
    }
}

/// A line to stderr; where that leads nowhere, there is nobody to tell.
fn aside(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Something to distrust, to stderr; not if quiet.
pub fn warning(common: &Common, message: &str) {
    if common.quiet {
        return;
    }
    match common.log {
        Log::Text => aside(&format!("warning: {}", printable(message))),
        Log::Json => aside(&line("warning", message)),
    }
}

/// Why the program ends, to stderr.
pub fn error(log: Log, error: &Error) {
    match log {
        Log::Text => aside(&format!("error: {error}")),
        Log::Json => aside(
            &json!({ "level": "error", "message": error.to_string(), "exit_code": error.exit_code() })
                .to_string(),
        ),
    }
}
