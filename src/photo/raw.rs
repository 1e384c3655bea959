//! Camera RAW and DNG: the sensor's own values, above black, at the sites of its colour filters.
//!
//! Nothing is interpolated, balanced or denoised here: a pixel holds the one colour that its filter let
//! through, and no value (NaN) in the others. `rawler` decodes; its colours and crops are not used beyond the
//! camera's stated crop.

use std::path::Path;

#[cfg(not(feature = "raw"))]
use super::Info;
#[cfg(not(feature = "raw"))]
use crate::error::{Error, Result};

#[cfg(feature = "raw")]
mod decode;
#[cfg(feature = "raw")]
mod directories;
#[cfg(all(test, feature = "raw"))]
pub(crate) mod tests;

/// Whether a TIFF is in truth a RAW file: a DNG, or what cameras write in the form of a TIFF.
pub(super) fn is_raw(path: &Path) -> bool {
    use tiff::tags::Tag;
    const DNG_VERSION: u16 = 50706;
    const SUB_DIRECTORIES: u16 = 330;
    let Ok(file) = std::fs::File::open(path) else {
        return false;
    };
    let Ok(mut tiff) = tiff::decoder::Decoder::new(std::io::BufReader::new(file)) else {
        // The decoder refuses files whose first directory holds no picture that it knows.
        return named_raw(path);
    };
    let mut has = |tag: u16| {
        let found = tiff.find_tag(Tag::from_u16_exhaustive(tag));
        matches!(found, Ok(Some(_)))
    };
    has(DNG_VERSION) || (has(SUB_DIRECTORIES) && has(271) && named_raw(path))
}

/// Whether a file's name is one that cameras give to RAW files in the form of a TIFF.
fn named_raw(path: &Path) -> bool {
    const ENDINGS: [&str; 12] = [
        "dng", "nef", "nrw", "arw", "sr2", "srf", "pef", "cr2", "3fr", "iiq", "erf", "srw",
    ];
    path.extension().is_some_and(|ending| {
        let ending = ending.to_string_lossy().to_lowercase();
        ENDINGS.contains(&ending.as_str())
    })
}

#[cfg(feature = "raw")]
pub(super) use decode::{info, read};

#[cfg(not(feature = "raw"))]
fn absent() -> Error {
    Error::input("this is a camera's RAW file, which this build of flatlight cannot read")
        .advice("Build with `--features raw` (it brings code under the LGPL), or convert to a linear TIFF of 16 bits.")
}

/// Without the feature `raw`.
#[cfg(not(feature = "raw"))]
pub(super) fn info(_: &Path) -> Result<Info> {
    Err(absent())
}

/// Without the feature `raw`.
#[cfg(not(feature = "raw"))]
pub(super) fn read(_: &Path, _: Option<std::ops::Range<u32>>) -> Result<super::Photo> {
    Err(absent())
}
