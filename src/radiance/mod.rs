//! Photographs to linear radiance with a variance per pixel: response, dark and flat frames,
//! vignetting, noise, exposure merge.

use std::ops::Range;

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
    /// Variance of the radiance that is independent between pixels (shot, read, quantisation
    /// noise), \[channel\]\[row-major pixel\]; infinite where the pixel is missing.
    pub variance: Vec<Vec<f32>>,
    /// Whether the variance comes from a stated noise model; if not it holds only the
    /// quantisation of the file, and the noise is estimated from the scatter of neighbours.
    pub noise_known: bool,
}
