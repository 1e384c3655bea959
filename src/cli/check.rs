//! `flatlight check`: everything wrong with a capture set, at once.

use std::path::Path;

use flatlight::capture::{Capture, check};
use flatlight::{Error, Result, pipeline};

use super::{Common, say};

/// Reads the description, all headers, and of every photo the pixels that a run needs; faults end it with an error that lists them all.
pub fn run(path: &Path, common: &Common) -> Result<()> {
    let capture = Capture::read(path)?;
    let mut findings = check(&capture);
    findings.faults.extend(pipeline::damaged(&capture)?);
    for warning in &findings.warnings {
        say::warning(common, warning);
    }
    let count = findings.warnings.len();
    if let Some(error) = Error::all(findings.faults) {
        return Err(error);
    }
    if common.strict && count > 0 {
        return Err(Error::failed(format!("--strict: {count} warning(s)")));
    }
    let photos: usize = capture.views.iter().map(|v| v.photos.len()).sum();
    let odd = match count {
        0 => "nothing odd".to_string(),
        1 => "one warning".to_string(),
        n => format!("{n} warnings"),
    };
    say::result(
        common,
        &format!(
            "{}: {} views, {photos} photos, nothing wrong, {odd}",
            capture.name,
            capture.views.len()
        ),
    );
    Ok(())
}
