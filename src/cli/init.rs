//! `flatlight init`: a first `capture.toml` for a folder of photos.

use std::io::Write as _;
use std::path::Path;

use flatlight::capture::draft;
use flatlight::{Error, Result};

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
    let mut open = std::fs::File::create_new(&file).map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => refuse(),
        _ => Error::write(&file, e),
    })?;
    open.write_all(draft.toml.as_bytes())
        .and_then(|()| open.sync_all())
        .map_err(|e| Error::write(&file, e))?;
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
