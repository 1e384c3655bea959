//! Pixels in: one file per format; only the rows that are needed.
//!
//! Values come as the file stores them. What they mean is the business of
//! [`radiance`](crate::radiance).

mod exr;
mod hdr;
mod jpeg;
mod orientation;
mod part;
mod png;
pub(crate) mod raw;
pub(crate) mod rle_lines;
mod shot;
#[cfg(test)]
mod tests;
mod tiff;
mod zip_block;

use std::io::{BufReader, Read, Seek};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

pub use part::ExrPart;
pub use shot::Shot;

use self::orientation::Orientation;

use crate::error::{Error, Result};
use crate::files::{self, Input};

/// Some rows of a photograph as stored: code values before any linearisation.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// Width and height of the whole image, pixels (after EXIF orientation).
    pub size: [u32; 2],
    /// The rows that were read, counted from the top.
    pub rows: Range<u32>,
    /// Channel names: `R,G,B`, a single `Y`, or the file's band names; alpha is dropped.
    pub channels: Vec<String>,
    /// Stored values, \[channel\]\[row-major pixel of `rows`\]; NaN where the file holds no pixel.
    pub values: Vec<Vec<f32>>,
    /// How the values are stored, which bounds their precision.
    pub storage: Storage,
}

/// How a file stores its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// Unsigned integers up to `max`; values are given as these integers, not scaled.
    Integer {
        /// The largest code value that the file can hold (255, 65535, 4095 …).
        max: u32,
    },
    /// 16-bit floating point.
    Half,
    /// 32-bit floating point.
    Float,
    /// Three 8-bit mantissas with one exponent (Radiance HDR).
    SharedExponent,
    /// A sensor's code values, given above its black level, which may leave them below 0.
    Sensor {
        /// The value at which the sensor saturates, above black.
        white: u32,
        /// The black level that was subtracted: the lowest value is as far below 0.
        black: u32,
    },
}

/// File formats, told by content and not by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// OpenEXR.
    Exr,
    /// PNG.
    Png,
    /// JPEG.
    Jpeg,
    /// TIFF.
    Tiff,
    /// Radiance HDR.
    Hdr,
    /// Camera RAW, DNG among it.
    Raw,
}

/// What a photograph's header says.
#[derive(Clone, Debug, PartialEq)]
pub struct Info {
    /// The file's format.
    pub format: Format,
    /// Width and height of the whole image, pixels (after EXIF orientation).
    pub size: [u32; 2],
    /// Channel names as in [`Photo::channels`].
    pub channels: Vec<String>,
    /// How the values are stored.
    pub storage: Storage,
    /// Exposure and lens, as far as they are stated.
    pub shot: Shot,
}

/// The largest width or height of an image, pixels: products of sizes then stay far below 2^64.
const LARGEST_SIDE: u32 = 1 << 20;

/// Pixels by channel: \[channel\]\[row-major pixel\].
type Planes = Vec<Vec<f32>>;

/// A photo file after its size and format were looked at.
struct Opened {
    reader: BufReader<Input>,
    format: Format,
    bytes: u64,
}

/// Reads rows of a photograph, all of them if `rows` is `None`, decoding no more than the format
/// needs for them.
///
/// # Errors
/// The file cannot be read, is damaged, is of no known format, declares a size beyond what its
/// bytes can hold, or has no such rows.
pub fn read(path: &Path, rows: Option<Range<u32>>) -> Result<Photo> {
    guarded(path, |opened| match opened.format {
        Format::Exr => exr::read(opened, rows),
        Format::Png => png::open(opened).and_then(|(header, decode)| header.photo(rows, decode)),
        Format::Jpeg => {
            jpeg::open(opened, true).and_then(|(header, decode)| header.photo(rows, decode))
        }
        Format::Tiff => tiff::open(opened).and_then(|(header, decode)| header.photo(rows, decode)),
        Format::Hdr => hdr::open(opened).and_then(|(header, decode)| header.photo(rows, decode)),
        Format::Raw => raw::read(path, rows),
    })
}

/// Reads the header of a photograph and no pixels.
///
/// # Errors
/// As [`read`], as far as the header shows it.
pub fn info(path: &Path) -> Result<Info> {
    guarded(path, |opened| match opened.format {
        Format::Exr => exr::info(opened),
        Format::Png => Ok(png::open(opened)?.0.info()),
        Format::Jpeg => Ok(jpeg::open(opened, false)?.0.info()),
        Format::Tiff => Ok(tiff::open(opened)?.0.info()),
        Format::Hdr => Ok(hdr::open(opened)?.0.info()),
        Format::Raw => raw::info(path),
    })
}

/// Opens the file and keeps a decoder's panic, should one come, within that file.
fn guarded<T>(path: &Path, decode: impl FnOnce(Opened) -> Result<T>) -> Result<T> {
    let opened = open(path)?;
    let fault = opened.reader.get_ref().fault();
    let decoded = catch_unwind(AssertUnwindSafe(|| decode(opened)));
    if let Some(failed) = fault.failed(path) {
        return Err(failed);
    }
    match decoded {
        Ok(result) => result.map_err(|error| error.file(path)),
        Err(_) => Err(Error::input("the file is damaged: its decoder gave up").file(path)),
    }
}

fn open(path: &Path) -> Result<Opened> {
    let (file, bytes) = files::open(path)?;
    if bytes == 0 {
        return Err(Error::input("expected a photo, found an empty file").file(path));
    }
    let mut reader = BufReader::with_capacity(1 << 16, file);
    let mut start = Vec::with_capacity(16);
    reader
        .by_ref()
        .take(16)
        .read_to_end(&mut start)
        .and_then(|_| reader.rewind())
        .map_err(|cause| {
            let fault = reader.get_ref().fault().failed(path);
            fault.unwrap_or_else(|| Error::read(path, cause))
        })?;
    let format = Format::of(&start).ok_or_else(|| {
        Error::input("expected an EXR, PNG, TIFF, JPEG, HDR or RAW file, found none of them")
            .file(path)
    })?;
    let format = match format {
        Format::Tiff if raw::is_raw(path) => Format::Raw,
        format => format,
    };
    Ok(Opened {
        reader,
        format,
        bytes,
    })
}

impl Format {
    /// The format that begins with these bytes.
    fn of(start: &[u8]) -> Option<Self> {
        let begins = |magic: &[u8]| start.starts_with(magic);
        if begins(&[0x76, 0x2f, 0x31, 0x01]) {
            return Some(Self::Exr);
        }
        if begins(b"\x89PNG\r\n\x1a\n") {
            return Some(Self::Png);
        }
        if begins(&[0xff, 0xd8, 0xff]) {
            return Some(Self::Jpeg);
        }
        if begins(b"II*\0") || begins(b"MM\0*") || begins(b"II+\0") || begins(b"MM\0+") {
            return Some(Self::Tiff);
        }
        if begins(b"#?") {
            return Some(Self::Hdr);
        }
        // Panasonic, Olympus, Fujifilm, Canon.
        const RAW: [&[u8]; 6] = [
            b"IIU\0",
            b"IIRO",
            b"IIRS",
            b"MMOR",
            b"FUJIFILMCCD-RAW",
            b"FOVb",
        ];
        if RAW.into_iter().any(begins) || start.get(4..12) == Some(b"ftypcrx ") {
            return Some(Self::Raw);
        }
        None
    }
}

/// A header as the decoders give it, with the picture as it lies in the file.
struct Header {
    format: Format,
    stored: [u32; 2],
    orientation: Orientation,
    channels: Vec<String>,
    storage: Storage,
    shot: Shot,
}

impl Header {
    fn info(self) -> Info {
        Info {
            format: self.format,
            size: self.orientation.size(self.stored),
            channels: self.channels,
            storage: self.storage,
            shot: self.shot,
        }
    }

    /// The photo's wanted rows; `decode` gives planes of rows of the file.
    fn photo(
        self,
        rows: Option<Range<u32>>,
        decode: impl FnOnce(Range<u32>) -> Result<Planes>,
    ) -> Result<Photo> {
        let size = self.orientation.size(self.stored);
        let rows = wanted(rows, size)?;
        Ok(Photo {
            size,
            values: self.orientation.rows(self.stored, rows.clone(), decode)?,
            rows,
            channels: self.channels,
            storage: self.storage,
        })
    }
}

/// Refuses a size that no photo has, or of which the file's bytes cannot hold `bits` for every pixel, by the header alone and whichever
/// rows are wanted.
fn believable(size: [u32; 2], bits: u64, file_bytes: u64) -> Result<()> {
    if size.iter().any(|side| !(1..=LARGEST_SIDE).contains(side)) {
        return Err(Error::input(format!(
            "expected an image of 1 to {LARGEST_SIDE} pixels a side, found {} x {}",
            size[0], size[1]
        )));
    }
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    plausible(pixels.saturating_mul(bits) / 8, file_bytes)
}

/// The rows that are wanted, or an error if the image has no such rows.
fn wanted(rows: Option<Range<u32>>, size: [u32; 2]) -> Result<Range<u32>> {
    let rows = rows.unwrap_or(0..size[1]);
    if rows.start >= rows.end || rows.end > size[1] {
        return Err(Error::input(format!(
            "expected rows {} to {}, found an image of {} x {} pixels",
            rows.start, rows.end, size[0], size[1]
        )));
    }
    Ok(rows)
}

/// Refuses a declared size that the file's bytes cannot hold, before anything is allocated for it.
///
/// No lossless code that is in use packs more than about 1000 samples' bytes into one (deflate's
/// limit is 1032); the lossy ones stay below 4096 even for a flat image. 16 MB are allowed to
/// any file.
fn plausible(declared: u64, file_bytes: u64) -> Result<()> {
    let limit = file_bytes.saturating_mul(4096).saturating_add(16 << 20);
    if declared > limit {
        return Err(Error::input(format!(
            "the file declares {declared} bytes of pixels, more than its {file_bytes} bytes can hold"
        )));
    }
    Ok(())
}

/// Order in which people count: `view_2` before `view_10`, `450nm` before `1000nm`.
pub fn natural_order(a: &str, b: &str) -> std::cmp::Ordering {
    fn keys(text: &str) -> Vec<(String, u128)> {
        let mut keys = Vec::new();
        let mut rest = text;
        while !rest.is_empty() {
            let words = rest
                .find(|c: char| c.is_ascii_digit())
                .unwrap_or(rest.len());
            let (word, tail) = rest.split_at(words);
            let digits = tail
                .find(|c: char| !c.is_ascii_digit())
                .unwrap_or(tail.len());
            let (number, tail) = tail.split_at(digits);
            // Numbers too long for 128 bits are equal here and told apart by the plain text below.
            keys.push((word.to_string(), number.parse().unwrap_or(u128::MAX)));
            rest = tail;
        }
        keys
    }
    keys(a).cmp(&keys(b)).then_with(|| a.cmp(b))
}
