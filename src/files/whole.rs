//! Files that are there whole or not at all.

use std::fs::{self, File, TryLockError};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use super::{PIECE, STAGING, call, flush_folder, rename, unwritten};
use crate::error::{Error, Result};

/// Writes a file whole or not at all: beside its place, flushed to the disk, then renamed.
///
/// # Errors
/// If it cannot be written, or another process of this program is writing it.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    write_together(&[(path.to_path_buf(), bytes)])
}

/// Writes files whole or not at all, and none if one of them cannot be written: they are renamed after all of them are written.
///
/// # Errors
/// If one cannot be written, or another process of this program is writing it.
pub fn write_together<B: AsRef<[u8]>>(files: &[(PathBuf, B)]) -> Result<()> {
    let mut written = Vec::with_capacity(files.len());
    for (path, bytes) in files {
        written.push(Beside::write(path, bytes.as_ref())?);
    }
    for beside in written {
        beside.publish()?;
    }
    Ok(())
}

/// A file beside the one that it will replace, held for this process alone by its lock. Its name is known, so that what a killed process
/// leaves is written over by the next.
struct Beside<'a> {
    path: &'a Path,
    place: PathBuf,
    /// `None` once it has its name.
    file: Option<File>,
}

impl<'a> Beside<'a> {
    fn write(path: &'a Path, bytes: &[u8]) -> Result<Self> {
        let name = path.file_name().ok_or_else(|| {
            Error::input("expected the name of a file to write to, found none").file(path)
        })?;
        let mut hidden = std::ffi::OsString::from(format!("{STAGING}-"));
        hidden.push(name);
        let place = path.with_file_name(hidden);
        let fail = |cause: io::Error| unwritten(path, &cause);
        if path.is_dir() {
            return Err(fail(io::ErrorKind::IsADirectory.into()));
        }
        let file = call("create")
            .and_then(|()| locked(&place))
            .map_err(|cause| match cause.kind() {
                io::ErrorKind::WouldBlock => Error::input("another flatlight is writing this file")
                    .file(path)
                    .advice("Wait for it to end, or give another file."),
                _ => fail(cause),
            })?;
        // From here on it is removed again unless it gets its name.
        let mut beside = Self {
            path,
            place,
            file: None,
        };
        let filled = fill(&file, path, bytes);
        beside.file = Some(file);
        filled.map_err(fail)?;
        Ok(beside)
    }

    fn publish(mut self) -> Result<()> {
        rename(&self.place, self.path)?;
        self.file = None;
        let folder = self.path.parent().filter(|p| !p.as_os_str().is_empty());
        flush_folder(folder.unwrap_or(Path::new(".")))
    }
}

impl Drop for Beside<'_> {
    fn drop(&mut self) {
        if self.file.is_some() {
            // Nothing reads it, if it cannot be removed.
            let _ = fs::remove_file(&self.place);
        }
    }
}

fn fill(mut file: &File, path: &Path, bytes: &[u8]) -> io::Result<()> {
    file.set_len(0)?;
    if let Ok(former) = fs::metadata(path) {
        // Who may read the former may read the new.
        file.set_permissions(former.permissions())?;
    }
    for piece in bytes.chunks(PIECE) {
        call("write")?;
        file.write_all(piece)?;
    }
    call("flush")?;
    file.sync_all()
}

/// Opens or makes a file and locks it.
fn locked(place: &Path) -> io::Result<File> {
    loop {
        let mut options = fs::OpenOptions::new();
        let file = options
            .write(true)
            .create(true)
            .truncate(false)
            .open(place)?;
        match file.try_lock() {
            // A file system without locks.
            Ok(()) | Err(TryLockError::Error(_)) => {}
            Err(TryLockError::WouldBlock) => return Err(io::ErrorKind::WouldBlock.into()),
        }
        // Between both another process may have renamed it: then it is no longer the one of this name.
        if is_at(&file, place)? {
            return Ok(file);
        }
    }
}

#[cfg(unix)]
fn is_at(file: &File, place: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt as _;
    let own = file.metadata()?;
    Ok(fs::symlink_metadata(place)
        .is_ok_and(|found| (found.dev(), found.ino()) == (own.dev(), own.ino())))
}

/// An open file cannot be renamed here.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> io::Result<bool> {
    Ok(true)
}
