//! Files in and out: what is read is a regular file of bounded size, what is written is there whole or not at all.
//!
//! Every call on the file system that a run's products depend on goes through `call` in builds with debug assertions, where
//! a test can make the n-th of them fail; in releases `call` is nothing.

mod claim;
mod staging;
mod whole;

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use crate::error::{Error, Result};

pub use claim::{Claim, claim, share};
pub use staging::{STAGING, commit, discard, stage};
pub use whole::{write_together, write_whole};

/// The largest text that is read whole, bytes: a table of 4 million cells and a description of 100,000 views fit.
const LARGEST_TEXT: u64 = 1 << 28;

/// Bytes that are written at once, so that a disk may fill up within a file.
const PIECE: usize = 1 << 20;

/// A regular file opened for reading, and its length: no folder, device or pipe, which may have no end.
///
/// # Errors
/// If it cannot be opened or is no regular file.
pub fn open(path: &Path) -> Result<(Input, u64)> {
    open_if(path, fs::Metadata::is_file)
}

/// The same of anything but a folder: a reader that stops at a limit may read from a pipe.
///
/// # Errors
/// If it cannot be opened or is a folder.
pub fn open_stream(path: &Path) -> Result<(Input, u64)> {
    open_if(path, |about| !about.is_dir())
}

fn open_if(path: &Path, fits: impl Fn(&fs::Metadata) -> bool) -> Result<(Input, u64)> {
    let attempt = || -> io::Result<(File, fs::Metadata)> {
        // Looked at before it is opened: to open a pipe waits for its writer.
        let about = fs::metadata(path)?;
        if !fits(&about) {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                "expected a file, found something that is not a file",
            ));
        }
        call("open")?;
        Ok((File::open(path)?, about))
    };
    let (file, about) = attempt().map_err(|e| unread(path, &e))?;
    let input = Input {
        file,
        fault: Fault::default(),
    };
    Ok((input, about.len()))
}

/// The bytes of a file.
///
/// # Errors
/// If it cannot be read or is no regular file.
pub fn bytes(path: &Path) -> Result<Vec<u8>> {
    let (mut input, _) = open(path)?;
    let mut bytes = Vec::new();
    input
        .read_to_end(&mut bytes)
        .map_err(|e| unread(path, &e))?;
    Ok(bytes)
}

/// The text of a file of at most `largest` bytes.
///
/// # Errors
/// If it cannot be read, is a folder, is larger, or is not UTF-8.
pub fn text_up_to(path: &Path, largest: u64) -> Result<String> {
    let (input, length) = open_stream(path)?;
    let refuse = |found: u64| {
        Error::input(format!(
            "expected a file of at most {largest} bytes, found {found}"
        ))
        .file(path)
    };
    if length > largest {
        return Err(refuse(length));
    }
    let mut bytes = Vec::new();
    // It may grow while it is read.
    input
        .take(largest + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| unread(path, &e))?;
    if bytes.len() as u64 > largest {
        return Err(refuse(bytes.len() as u64));
    }
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        Error::input(format!(
            "expected a text in UTF-8, found other bytes from byte {at} on"
        ))
        .file(path)
    })
}

/// The text of a table or recipe.
///
/// # Errors
/// As [`text_up_to`].
pub fn text(path: &Path) -> Result<String> {
    text_up_to(path, LARGEST_TEXT)
}

/// A file that is read. What the system could not read is kept apart from what the bytes mean: a decoder may take the one
/// for the other.
#[derive(Debug)]
pub struct Input {
    file: File,
    fault: Fault,
}

/// What the system said when it could not read.
#[derive(Clone, Debug, Default)]
pub struct Fault(Arc<OnceLock<String>>);

impl Fault {
    /// The work's failure, if there was one: the file may be sound.
    pub fn failed(&self, path: &Path) -> Option<Error> {
        let said = self.0.get()?;
        Some(Error::failed(format!("cannot read it: {said}")).file(path))
    }

    fn keep<T>(&self, result: io::Result<T>) -> io::Result<T> {
        if let Err(cause) = &result
            && cause.kind() != io::ErrorKind::Interrupted
        {
            let _ = self.0.set(cause.to_string());
        }
        result
    }
}

impl Input {
    /// Where its faults are kept.
    pub fn fault(&self) -> Fault {
        self.fault.clone()
    }
}

impl Read for Input {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let result = call("read").and_then(|()| self.file.read(buffer));
        self.fault.keep(result)
    }
}

impl Seek for Input {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        // A place that no file has is a fault of the bytes that name it.
        self.file.seek(to)
    }
}

/// A file that is written and may not be on the disk yet.
#[derive(Debug)]
pub struct Unflushed {
    file: File,
    path: PathBuf,
}

impl Unflushed {
    /// Forces it to the disk.
    ///
    /// # Errors
    /// If it cannot be done.
    pub fn flush(&self) -> Result<()> {
        self.file.sync_all().map_err(|e| unwritten(&self.path, &e))
    }
}

/// Writes a file and flushes it to the disk; for places where a file that is half there harms nobody.
///
/// # Errors
/// If it cannot be written.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_unflushed(path, bytes)?.flush()
}

/// The same but for the flush, which whoever has the time for it must do.
///
/// # Errors
/// If it cannot be written.
pub fn write_unflushed(path: &Path, bytes: &[u8]) -> Result<Unflushed> {
    let attempt = || -> io::Result<File> {
        call("create")?;
        let mut file = File::create(path)?;
        for piece in bytes.chunks(PIECE) {
            call("write")?;
            file.write_all(piece)?;
        }
        // Here, so that the order of calls is that of the work, whoever flushes it.
        call("flush")?;
        Ok(file)
    };
    let file = attempt().map_err(|e| unwritten(path, &e))?;
    Ok(Unflushed {
        file,
        path: path.to_path_buf(),
    })
}

/// Renames a file within a file system, over another if there is one.
///
/// # Errors
/// If it cannot be done.
pub fn rename(from: &Path, to: &Path) -> Result<()> {
    call("rename")
        .and_then(|()| fs::rename(from, to))
        .map_err(|e| unwritten(to, &e))
}

/// Removes a file if it is there.
///
/// # Errors
/// If it is there and cannot be removed.
pub fn remove(path: &Path) -> Result<()> {
    match call("remove").and_then(|()| fs::remove_file(path)) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(unwritten(path, &e)),
        _ => Ok(()),
    }
}

/// Makes a folder with those above it.
///
/// # Errors
/// If it cannot be made.
pub fn make_folder(path: &Path) -> Result<()> {
    call("mkdir")
        .and_then(|()| fs::create_dir_all(path))
        .map_err(|e| unwritten(path, &e))
}

/// Forces a folder's entries to the disk.
///
/// # Errors
/// If it cannot be done.
pub fn flush_folder(path: &Path) -> Result<()> {
    call("flush")
        .and_then(|()| File::open(path))
        .and_then(|f| f.sync_all())
        .map_err(|e| unwritten(path, &e))
}

/// Why something could not be read: a file that is not there or is none is the user's to mend, a disk that fails is not.
fn unread(path: &Path, cause: &io::Error) -> Error {
    use io::ErrorKind::{InvalidInput, IsADirectory, NotADirectory, NotFound, PermissionDenied};
    match cause.kind() {
        InvalidInput | IsADirectory | NotADirectory | NotFound | PermissionDenied => {
            Error::read(path, cause)
        }
        // Links that lead to themselves, names too long, and the like.
        _ if !path.exists() => Error::read(path, cause),
        _ => Error::failed(format!("cannot read it: {cause}")).file(path),
    }
}

/// Why something could not be written: a full disk and a place that is not the user's to write to are for the user to mend.
pub fn unwritten(path: &Path, cause: &io::Error) -> Error {
    use io::ErrorKind::{
        InvalidFilename, IsADirectory, NotADirectory, NotFound, PermissionDenied, QuotaExceeded,
        ReadOnlyFilesystem, StorageFull,
    };
    let what = format!("cannot write it: {cause}");
    match cause.kind() {
        StorageFull | QuotaExceeded => Error::input(what)
            .file(path)
            .advice("The disk is full: free some space, or write to another place with --out."),
        PermissionDenied | ReadOnlyFilesystem | NotADirectory | NotFound | IsADirectory
        | InvalidFilename => Error::input(what)
            .file(path)
            .advice("Give a place that you may write to with --out."),
        _ => Error::write(path, cause),
    }
}

/// The next call on the file system, which fails if the environment asks for it: `FLATLIGHT_FAIL_CALL=n` makes the n-th
/// (from 1) fail as a full disk does, `n+` that and all after it, and `n!` ends the process there as a power loss would.
#[cfg(debug_assertions)]
fn call(what: &str) -> io::Result<()> {
    use std::sync::LazyLock;
    use std::sync::atomic::{AtomicU64, Ordering};
    static ASKED: LazyLock<Option<(u64, char)>> = LazyLock::new(|| {
        let text = std::env::var("FLATLIGHT_FAIL_CALL").ok()?;
        let number = text.trim_end_matches(['+', '!']);
        Some((number.parse().ok()?, text.chars().last()?))
    });
    static CALLS: AtomicU64 = AtomicU64::new(0);
    let Some((n, how)) = *ASKED else {
        return Ok(());
    };
    let now = CALLS.fetch_add(1, Ordering::SeqCst) + 1;
    match how {
        '!' if now == n => std::process::abort(),
        '+' if now >= n => {}
        _ if now == n => {}
        _ => return Ok(()),
    }
    let said = format!("made to fail: {what}, call {now}");
    Err(match what {
        "open" | "read" => io::Error::other(said),
        _ => io::Error::new(io::ErrorKind::StorageFull, said),
    })
}

/// Nothing.
#[cfg(not(debug_assertions))]
#[inline(always)]
fn call(_: &str) -> io::Result<()> {
    Ok(())
}
