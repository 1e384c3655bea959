//! What a photo's header says of the exposure and the lens.

/// Exposure and lens of a photo, as far as its header states them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shot {
    /// Exposure time, seconds.
    pub exposure_s: Option<f64>,
    /// Aperture, focal length over diameter.
    pub f_number: Option<f64>,
    /// Sensitivity, ISO.
    pub iso: Option<f64>,
    /// Focal length, millimetres.
    pub focal_mm: Option<f64>,
    /// Focal length of the same field of view on a 36 mm wide frame, millimetres.
    pub focal_35mm: Option<f64>,
    /// When it was taken, as stated (`YYYY:MM:DD hh:mm:ss`).
    pub taken: Option<String>,
}

/// A number that can be an exposure time, an aperture, a sensitivity or a length.
pub(super) fn sensible(value: f64) -> Option<f64> {
    (value.is_finite() && value > 0.0).then_some(value)
}
