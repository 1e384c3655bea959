//! `flatlight report`: the report again, from what a run left.

use std::path::Path;

use flatlight::pipeline::Folder;
use flatlight::{Result, report};

use super::{Common, say};

/// Rebuilds `report.html` in a run's folder.
pub fn run(path: &Path, common: &Common) -> Result<()> {
    let folder = Folder::new(path);
    let _claim = path.is_dir().then(|| folder.claim()).transpose()?;
    let page = report::page(&folder.read()?)?;
    folder.replace_report(&page)?;
    say::result(
        common,
        &format!("open {}", path.join("report.html").display()),
    );
    Ok(())
}
