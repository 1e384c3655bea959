//! `flatlight init`: a first `capture.toml` for a folder of photos.

use std::path::Path;

use flatlight::capture::draft;
use flatlight::{Error, Result, files};

use super::{Common, say};

/// Writes the draft, never over a file that is there, and says what is left to fill in.
pub fn run(folder: &Path, common: &Common) -> Result<()> {
    let file = folder.join("capture.toml");
    let refuse = || {
        Error::input("it is there already and is not written over")
            .file(&file)
            .advice("Move it away to begin anew, or run `flatlight check` on it.")
    };
    if file.exists() {
        return Err(refuse());
    }
    let draft = draft(folder)?;
    // Another one that writes a description here meanwhile is refused, or was before this.
    let _claim = files::claim(folder)?;
    if file.exists() {
        return Err(refuse());
    }
    files::write_whole(&file, draft.toml.as_bytes())?;
    for warning in &draft.warnings {
        say::warning(common, warning);
    }
    let mut lines = vec![format!("wrote {}", file.display())];
    if draft.to_do.is_empty() {
        lines.push("nothing is left to fill in; next: flatlight check".into());
    } else {
        lines.push("left to fill in:".into());
        lines.extend(draft.to_do.iter().map(|what| format!("  {what}")));
    }
    say::result(common, &lines.join("\n"));
    Ok(())
}
