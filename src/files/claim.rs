//! A folder that one process at a time writes to.

use std::fs;
use std::path::{Path, PathBuf};

use super::make_folder;
use crate::error::{Error, Kind, Result};

/// A folder that no other process of this program may write to meanwhile.
#[derive(Debug)]
pub struct Claim {
    /// Folders that were made for it, the innermost first.
    made: Vec<PathBuf>,
    /// Held for its lock, which ends with the process in any case.
    lock: Option<fs::File>,
}

/// Takes a folder for this process alone, until the value is dropped; makes it if it is not there. A folder that was made and stays
/// empty is removed again.
///
/// # Errors
/// If another process holds it, it is no folder, or it cannot be made.
pub fn claim(path: &Path) -> Result<Claim> {
    if path.exists() && !path.is_dir() {
        return Err(Error::input("expected a folder to write to, found a file")
            .file(path)
            .advice("Give another folder with --out."));
    }
    let made: Vec<PathBuf> = path
        .ancestors()
        .take_while(|p| !p.as_os_str().is_empty() && !p.exists())
        .map(Path::to_path_buf)
        .collect();
    // From here on what was made is removed again if it stays empty.
    let mut claim = Claim { made, lock: None };
    make_folder(path).map_err(|e| match e.kind() {
        Kind::Input => e,
        // Before any work, a place that cannot be written to is a wrong request.
        Kind::Failed => {
            Error::input(e.to_string()).advice("Give a folder that you may write to with --out.")
        }
    })?;
    match lock(path, fs::File::try_lock) {
        Ok(lock) => claim.lock = lock,
        Err(refused) => {
            claim.made.clear();
            return Err(refused);
        }
    }
    Ok(claim)
}

/// Keeps every other process of this program from writing to a folder that is there, until the value is dropped; others may read it too.
///
/// # Errors
/// If another process writes to it.
pub fn share(path: &Path) -> Result<Claim> {
    Ok(Claim {
        made: Vec::new(),
        lock: lock(path, fs::File::try_lock_shared)?,
    })
}

type Lock = fn(&fs::File) -> std::result::Result<(), fs::TryLockError>;

fn lock(path: &Path, lock: Lock) -> Result<Option<fs::File>> {
    // Without a name the folder is the one that the program was started in.
    let named = match path.as_os_str().is_empty() {
        true => Path::new("."),
        false => path,
    };
    let Ok(folder) = fs::File::open(named) else {
        return Ok(None);
    };
    match lock(&folder) {
        Ok(()) => Ok(Some(folder)),
        Err(fs::TryLockError::WouldBlock) => {
            Err(Error::input("another flatlight is at work in this folder")
                .file(path)
                .advice("Wait for it to end, or give another folder with --out."))
        }
        // A file system without locks.
        Err(fs::TryLockError::Error(_)) => Ok(None),
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        for folder in &self.made {
            // Not if there is anything in it.
            if fs::remove_dir(folder).is_err() {
                break;
            }
        }
        drop(self.lock.take());
    }
}
