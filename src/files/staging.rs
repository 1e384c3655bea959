//! Many files and folders that take their names together: all are written into a folder of their own first, the last of them says that all
//! others are there, and then each is renamed. A process that ends in between leaves complete files of the former or of the new ones only, and
//! which of the two it will be is settled by the next one that claims the folder.

use std::fs;
use std::path::{Path, PathBuf};

use super::{call, flush_folder, make_folder, remove, rename, unwritten};
use crate::error::Result;

/// Name of the folder in which files are written before they get their names.
pub const STAGING: &str = ".flatlight-partial";

/// Makes the empty staging folder of a folder that was claimed.
///
/// # Errors
/// If it cannot be made, or what is left of an earlier one cannot be removed.
pub fn stage(folder: &Path) -> Result<PathBuf> {
    let staging = folder.join(STAGING);
    discard(folder)?;
    make_folder(&staging)?;
    Ok(staging)
}

/// Removes the staging folder with all that is in it, if it is there.
///
/// # Errors
/// If it is there and cannot be removed.
pub fn discard(folder: &Path) -> Result<()> {
    remove_tree(&folder.join(STAGING))
}

/// Gives what was staged its names in `folder`: first `last` and all `stale` names are removed there, then `names` are renamed one by
/// one, `last` at the end. Those that are not staged have their names already, if an earlier attempt was interrupted.
///
/// # Errors
/// If a name cannot be removed or given; the staging folder stays then, and the same can be done again.
pub fn commit(folder: &Path, names: &[&str], stale: &[&str], last: &str) -> Result<()> {
    let staging = folder.join(STAGING);
    for name in [last].iter().chain(stale) {
        remove(&folder.join(name))?;
    }
    for name in names {
        let (from, to) = (staging.join(name), folder.join(name));
        if from.exists() {
            if to.is_dir() {
                remove_tree(&to)?;
            }
            rename(&from, &to)?;
        }
    }
    flush_folder(folder)?;
    rename(&staging.join(last), &folder.join(last))?;
    flush_folder(folder)?;
    // All have their names; an empty folder that stays behind is removed by the next one that claims this.
    let _ = fs::remove_dir_all(staging);
    Ok(())
}

fn remove_tree(path: &Path) -> Result<()> {
    match call("remove").and_then(|()| fs::remove_dir_all(path)) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(unwritten(path, &e)),
        _ => Ok(()),
    }
}
