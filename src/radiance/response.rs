//! Stored code values to linear values: the curve of an encoding and its slope.

use std::path::Path;

use crate::capture::Encoding;
use crate::error::{Error, Result};
use crate::files;
use crate::photo::Storage;

/// The largest response table that is read, bytes.
const LARGEST_TABLE: u64 = 16 << 20;

/// How stored values become linear ones.
///
/// * linear: the stored value itself;
/// * sRGB and gamma: 0 to 1, of the stored value over the largest that the file can hold (over 1
///   for floating point);
/// * a measured response: as in its table.
#[derive(Clone, Debug, PartialEq)]
pub enum Response {
    /// Stored values are linear.
    Linear,
    /// The sRGB curve (IEC 61966-2-1).
    Srgb,
    /// value = linear^(1/γ).
    Gamma(f64),
    /// Rows of (stored value, linear value per channel), both increasing.
    Table {
        /// Stored values.
        stored: Vec<f64>,
        /// Linear values, \[channel\]\[row\]; one channel serves all.
        linear: Vec<Vec<f64>>,
    },
}

impl Response {
    /// The response of an encoding; a response table is read from the capture's folder.
    ///
    /// # Errors
    /// The table cannot be read, has a cell that is not a number, or does not increase.
    pub fn of(encoding: &Encoding, folder: &Path) -> Result<Self> {
        Ok(match encoding {
            Encoding::Linear => Self::Linear,
            Encoding::Srgb => Self::Srgb,
            Encoding::Gamma(gamma) => Self::Gamma(*gamma),
            Encoding::Response(file) => Self::read(&folder.join(file))?,
            Encoding::Recover(Some(curve)) => Self::Table {
                stored: curve.stored.clone(),
                linear: curve.linear.clone(),
            },
            Encoding::Recover(None) => {
                return Err(Error::failed(
                    "the response was not recovered before the photos were read",
                ));
            }
        })
    }

    /// What a file is taken for if the capture does not say: floating point is linear, 8 bits are
    /// sRGB, more bits are linear.
    pub fn by_storage(storage: Storage) -> Self {
        match storage {
            Storage::Integer { max: 0..=255 } => Self::Srgb,
            _ => Self::Linear,
        }
    }

    /// Reads `value,linear` or `value,linear_R,linear_G,…`: a header line, then numbers.
    fn read(file: &Path) -> Result<Self> {
        let text = files::text_up_to(file, LARGEST_TABLE)?;
        let mut lines = text.lines().enumerate();
        let columns = lines
            .next()
            .map_or(0, |(_, header)| header.split(',').count());
        let mut stored = Vec::new();
        let mut linear = vec![Vec::new(); columns.saturating_sub(1)];
        for (i, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
            let fault = |what: String| Error::input(what).file(file).line(i + 1);
            let row: Option<Vec<f64>> = line
                .split(',')
                .map(|cell| cell.trim().parse().ok().filter(|x: &f64| x.is_finite()))
                .collect();
            match row.as_deref() {
                Some([value, rest @ ..]) if !rest.is_empty() && rest.len() == linear.len() => {
                    let grows = stored.last().is_none_or(|last| value > last)
                        && linear
                            .iter()
                            .zip(rest)
                            .all(|(c, x)| c.last().is_none_or(|l| x > l));
                    if !grows {
                        return Err(fault(
                            "expected values that increase from row to row".into(),
                        ));
                    }
                    stored.push(*value);
                    linear.iter_mut().zip(rest).for_each(|(c, x)| c.push(*x));
                }
                _ => {
                    return Err(fault(format!(
                        "expected {columns} numbers, at least 2, found \"{}\"",
                        line.chars().take(80).collect::<String>()
                    )));
                }
            }
        }
        if stored.len() < 2 {
            return Err(
                Error::input("expected a response of at least two rows, found fewer")
                    .file(file)
                    .advice("The columns are value,linear or value,linear_R,linear_G,linear_B."),
            );
        }
        Ok(Self::Table { stored, linear })
    }

    /// The linear value of a stored one, and the slope d linear / d stored there.
    pub fn decode(&self, stored: f64, channel: usize, storage: Storage) -> (f64, f64) {
        let scale = match storage {
            Storage::Integer { max } => f64::from(max),
            Storage::Sensor { white, .. } => f64::from(white),
            Storage::Half | Storage::Float | Storage::SharedExponent => 1.0,
        };
        match self {
            Self::Linear => (stored, 1.0),
            Self::Srgb => {
                let v = stored / scale;
                if v <= 0.040_45 {
                    (v / 12.92, 1.0 / (12.92 * scale))
                } else {
                    let base = (v + 0.055) / 1.055;
                    (base.powf(2.4), 2.4 * base.powf(1.4) / (1.055 * scale))
                }
            }
            Self::Gamma(gamma) => {
                let v = (stored / scale).max(0.0);
                (v.powf(*gamma), gamma * v.powf(gamma - 1.0) / scale)
            }
            Self::Table {
                stored: rows,
                linear,
            } => {
                let Some(curve) = linear.get(channel).or_else(|| linear.first()) else {
                    return (f64::NAN, f64::NAN);
                };
                let next = rows
                    .partition_point(|&r| r <= stored)
                    .clamp(1, rows.len() - 1);
                let pair = |v: &[f64]| Some((*v.get(next - 1)?, *v.get(next)?));
                match (pair(rows), pair(curve)) {
                    (Some((v0, v1)), Some((x0, x1))) => {
                        let slope = (x1 - x0) / (v1 - v0);
                        (x0 + slope * (stored - v0), slope)
                    }
                    _ => (f64::NAN, f64::NAN),
                }
            }
        }
    }
}

/// Variance of the rounding of a stored value: one twelfth of its squared step. Where channels share
/// an exponent, `stored` is the brightest channel's value.
pub fn rounding(stored: f32, storage: Storage) -> f32 {
    match Steps::of(storage) {
        Steps::Whole => 1.0 / 12.0,
        Steps::Binades { lowest, fraction } => rounding_in_binade(stored, lowest, fraction),
    }
}

/// How far apart stored values lie.
pub(super) enum Steps {
    /// Whole numbers.
    Whole,
    /// Powers of two, with the size of the value.
    Binades {
        /// Exponent below which steps do not get finer.
        lowest: i32,
        /// Bits of the fraction.
        fraction: i32,
    },
}

impl Steps {
    pub(super) fn of(storage: Storage) -> Self {
        let binades = |lowest, fraction| Self::Binades { lowest, fraction };
        match storage {
            Storage::Integer { .. } | Storage::Sensor { .. } => Self::Whole,
            Storage::Half => binades(-14, 10),
            Storage::Float => binades(-103, 23),
            // The brightest channel's mantissa has 8 bits, 128 to 255.
            Storage::SharedExponent => binades(-100, 7),
        }
    }
}

/// The variance of rounding in the binade that holds the value: the step is 2^(exponent − fraction bits).
#[inline(always)]
pub(super) fn rounding_in_binade(stored: f32, lowest: i32, fraction: i32) -> f32 {
    let exponent = (((stored.to_bits() >> 23) & 0xff) as i32 - 127).max(lowest);
    // 2^k as bits; k stays within the normal range of f32 for all kinds.
    let step = f32::from_bits(((exponent - fraction + 127).max(0) as u32) << 23);
    step * step / 12.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const BYTE: Storage = Storage::Integer { max: 255 };

    #[test]
    fn slopes_are_the_derivatives_of_the_curves() {
        let table = Response::Table {
            stored: vec![0.0, 100.0, 255.0],
            linear: vec![vec![0.0, 0.1, 1.0], vec![0.0, 0.2, 2.0]],
        };
        for response in [
            Response::Linear,
            Response::Srgb,
            Response::Gamma(2.2),
            table,
        ] {
            for channel in 0..2 {
                for v in [3.0, 9.0, 40.0, 128.0, 250.0] {
                    let h = 1e-4;
                    let (up, _) = response.decode(v + h, channel, BYTE);
                    let (down, _) = response.decode(v - h, channel, BYTE);
                    let (_, slope) = response.decode(v, channel, BYTE);
                    // Second-order differences are off by h² f‴ / 6, far below 1e-6 of the slope.
                    assert!(((up - down) / (2.0 * h) - slope).abs() < 1e-6 * slope.max(1e-3));
                }
            }
        }
    }

    #[test]
    fn srgb_has_its_published_values() {
        // IEC 61966-2-1: code 188 is half the light to within half a code; 255 is all of it.
        assert!((Response::Srgb.decode(188.0, 0, BYTE).0 - 0.5).abs() < 0.003);
        assert_eq!(Response::Srgb.decode(255.0, 0, BYTE).0, 1.0);
    }

    #[test]
    fn rounding_is_uniform_over_one_step() {
        // Steps of the half format: 2^-10 from 1 to 2, 2^-24 below 2^-14 (subnormal).
        let half = |v| rounding(v, Storage::Half) * 12.0;
        assert_eq!(half(1.5), 2f32.powi(-20));
        assert_eq!(half(-3.0), 2f32.powi(-18));
        assert_eq!(half(0.0), 2f32.powi(-48));
        assert_eq!(rounding(1.0, Storage::Float) * 12.0, 2f32.powi(-46));
        assert_eq!(rounding(77.0, BYTE), 1.0 / 12.0);
    }

    #[test]
    fn a_table_is_read_or_refused_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("r.csv");
        let read = |text: &str| {
            std::fs::write(&file, text).unwrap();
            Response::read(&file)
        };
        let good = read("value,linear_R,linear_G\n0,0,0\n128,0.2,0.3\n255,1,1.1\n").unwrap();
        let (x, slope) = good.decode(64.0, 1, BYTE);
        assert!((x - 0.15).abs() < 1e-12 && (slope - 0.3 / 128.0).abs() < 1e-12);
        for (bad, message) in [
            (
                "value,linear\n0,0\n0,1\n",
                ":3: expected values that increase",
            ),
            ("value,linear\n0,0\n1,x\n", ":3: expected 2 numbers"),
            ("value,linear\n0,0,1\n", ":2: expected 2 numbers"),
            ("value\n1\n2\n", ":2: expected 1 numbers, at least 2"),
            ("value,linear\n0,0\n", "at least two rows"),
        ] {
            let error = read(bad).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}
