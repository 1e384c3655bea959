//! Pixels in: one file per format; only the rows that are needed.

use std::ops::Range;

/// Some rows of a photograph as stored: code values before any linearisation.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// Width and height of the whole image, pixels (after EXIF orientation).
    pub size: [u32; 2],
    /// The rows that were read, counted from the top.
    pub rows: Range<u32>,
    /// Channel names: `R,G,B`, a single `Y`, or the file's band names; alpha is dropped.
    pub channels: Vec<String>,
    /// Stored values, \[channel\]\[row-major pixel of `rows`\].
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
}
