//! Files that a command writes by itself.

use std::io::Write as _;
use std::path::Path;

use atomic_write_file::AtomicWriteFile;
use flatlight::{Error, Result};

/// Writes a file whole or not at all.
pub fn write(file: &Path, bytes: &[u8]) -> Result<()> {
    let attempt = || -> std::io::Result<()> {
        let mut target = AtomicWriteFile::open(file)?;
        target.write_all(bytes)?;
        target.commit()
    };
    attempt().map_err(|e| Error::write(file, e))
}
