//! What tells one input file from another: a hash of its bytes.
//!
//! A photograph of tens of megapixels is mostly rows that no measurement reads; hashing all of it would cost many times
//! what reading the rows costs. So the hash of a large file is of its length, its two ends (an EXR or TIFF file has its
//! tables of blocks there, which change with the compressed size of any block) and of pieces evenly spread over it. It says so:
//! `sampled:` stands before it. Smaller files are hashed whole, as `b3sum` does.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::error::{Error, Result};
use crate::files::{self, Input};

/// Files up to this size are hashed whole, bytes.
const WHOLE: u64 = 16 << 20;
/// Bytes at each end of a larger file, number of pieces between, and their size.
const END: u64 = 256 << 10;
const PIECES: u64 = 512;
const PIECE: u64 = 4 << 10;

/// The hash of a file.
///
/// # Errors
/// If it cannot be read.
pub fn fingerprint(path: &Path) -> Result<String> {
    let (file, length) = files::open_stream(path)?;
    let fault = file.fault();
    hash(file, length).map_err(|e| {
        let failed = fault.failed(path);
        failed.unwrap_or_else(|| Error::read(path, e))
    })
}

fn hash(mut file: Input, length: u64) -> std::io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    if length <= WHOLE {
        // Also of what has no length of its own, such as a pipe.
        hasher.update_reader(file)?;
        return Ok(hasher.finalize().to_hex().to_string());
    }
    hasher.update(&length.to_le_bytes());
    // Hashed together: one after another they would take three times as long.
    let mut buffer = Vec::with_capacity((2 * END + PIECES * PIECE) as usize);
    let mut take = |start: u64, count: u64| -> std::io::Result<()> {
        file.seek(SeekFrom::Start(start))?;
        let read = file.by_ref().take(count).read_to_end(&mut buffer)?;
        if read as u64 == count {
            Ok(())
        } else {
            Err(std::io::ErrorKind::UnexpectedEof.into())
        }
    };
    take(0, END)?;
    let step = (length - 2 * END) / PIECES;
    for k in 0..PIECES {
        take(END + k * step, PIECE)?;
    }
    take(length - END, END)?;
    hasher.update(&buffer);
    Ok(format!("sampled:{}", hasher.finalize().to_hex()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_file_is_hashed_whole_and_a_large_one_in_pieces() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        std::fs::write(&path, b"a photograph").unwrap();
        assert_eq!(
            fingerprint(&path).unwrap(),
            blake3::hash(b"a photograph").to_hex().to_string()
        );
        let mut bytes: Vec<u8> = (0..20_000_000u32).map(|i| (i >> 3) as u8).collect();
        std::fs::write(&path, &bytes).unwrap();
        let whole = fingerprint(&path).unwrap();
        assert!(whole.starts_with("sampled:"));
        // Both ends, and a change as long as a compressed block in between.
        let last = bytes.len() - 1;
        for place in [0..1, last..last + 1, 9_000_000..9_050_000] {
            let changed = place.clone();
            for b in &mut bytes[changed] {
                *b ^= 1;
            }
            std::fs::write(&path, &bytes).unwrap();
            assert_ne!(fingerprint(&path).unwrap(), whole, "{place:?}");
            for b in &mut bytes[place] {
                *b ^= 1;
            }
        }
        bytes.push(0);
        std::fs::write(&path, &bytes).unwrap();
        assert_ne!(fingerprint(&path).unwrap(), whole);
        assert!(fingerprint(&folder.path().join("none")).is_err());
    }
}
