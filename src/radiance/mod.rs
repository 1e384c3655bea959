//! Photographs to linear radiance with a variance per pixel: response, dark and flat frames,
//! vignetting, noise, exposure merge.
//!
//! The signal s of a pixel is its linear value above black, in the linear units of its
//! [`Response`]. With g electrons per unit of signal, exposure time t and the relative
//! illumination f of the pixel (vignetting, flat field),
//!
//! ```text
//! s = L f t r / g,        var s = s/g + (read noise/g)² + rounding
//! ```
//!
//! where L is the radiance and r the responsivity; without one, L is in units of s per second.

mod align;
mod brackets;
mod calibration;
mod census;
mod curve;
mod exposure;
mod filters;
mod mask;
mod merge;
mod motion;
mod noise;
mod recovery;
#[cfg(test)]
mod recovery_tests;
mod response;
mod smooth;
#[cfg(test)]
mod tests;

use std::ops::Range;

pub use census::{Census, Odd};
pub use mask::masked;
pub use merge::{Developed, Found, develop, view};
pub use motion::Shift;
pub use noise::{Noise, shared_rounding, shared_rounding_of};
pub use recovery::{Recovery, recover, resolved};
pub use response::Response;

/// Linear radiance of some rows of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct Radiance {
    /// Width and height of the whole image, pixels.
    pub size: [u32; 2],
    /// The rows that are held, counted from the top.
    pub rows: Range<u32>,
    /// Channel names.
    pub channels: Vec<String>,
    /// Radiance (or the capture's relative unit: value / exposure_s), \[channel\]\[row-major pixel\].
    pub value: Vec<Vec<f32>>,
    /// Variance of the radiance (shot, read, quantisation noise), independent between pixels but for `shared`, \[channel\]\[row-major pixel\]; infinite where the pixel is missing.
    pub variance: Vec<Vec<f32>>,
    /// Of the variance, what pixels of one and the same radiance do not have each by itself but share: the part of the rounding over
    /// which noise does not carry them, \[channel\]\[row-major pixel\]. No planes if there is none, or if the noise is not known.
    pub shared: Vec<Vec<f32>>,
    /// Whether the variance comes from a stated noise model; if not it holds only the
    /// quantisation of the file, and the noise is estimated from the scatter of neighbours.
    pub noise_known: bool,
}
