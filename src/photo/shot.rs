//! What a photo's header says of the exposure and the lens (EXIF).

use exif::{In, Reader, Tag, Value};

use super::orientation::Orientation;

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

/// Reads an EXIF block (without the `Exif\0\0` before it). What is damaged in it is passed over:
/// a camera's notes are no reason to refuse its photo.
pub(super) fn exif(block: &[u8]) -> (Shot, Orientation) {
    let mut reader = Reader::new();
    reader.continue_on_error(true);
    let fields = reader
        .read_raw(block.to_vec())
        .or_else(|error| error.distill_partial_result(|_| {}));
    let Ok(fields) = fields else {
        return (Shot::default(), Orientation::UPRIGHT);
    };
    let number = |tag: Tag| {
        let value = match &fields.get_field(tag, In::PRIMARY)?.value {
            Value::Rational(v) => v.first()?.to_f64(),
            Value::SRational(v) => v.first()?.to_f64(),
            other => f64::from(other.get_uint(0)?),
        };
        sensible(value)
    };
    let text = |tag: Tag| match &fields.get_field(tag, In::PRIMARY)?.value {
        Value::Ascii(v) => Some(String::from_utf8_lossy(v.first()?).into_owned()),
        _ => None,
    };
    // APEX: time = 2^−Tv, aperture = 2^(Av/2); older cameras write only these.
    let apex = |tag: Tag| match &fields.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(v) => Some(v.first()?.to_f64()),
        Value::SRational(v) => Some(v.first()?.to_f64()),
        _ => None,
    };
    let shot = Shot {
        exposure_s: number(Tag::ExposureTime)
            .or_else(|| sensible((-apex(Tag::ShutterSpeedValue)?).exp2())),
        f_number: number(Tag::FNumber)
            .or_else(|| sensible((apex(Tag::ApertureValue)? / 2.0).exp2())),
        iso: number(Tag::PhotographicSensitivity),
        focal_mm: number(Tag::FocalLength),
        focal_35mm: number(Tag::FocalLengthIn35mmFilm),
        taken: text(Tag::DateTimeOriginal).or_else(|| text(Tag::DateTime)),
    };
    let orientation = fields
        .get_field(Tag::Orientation, In::PRIMARY)
        .and_then(|field| field.value.get_uint(0))
        .map_or(Orientation::UPRIGHT, Orientation::of);
    (shot, orientation)
}
