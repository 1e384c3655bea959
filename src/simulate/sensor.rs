//! From the picture on the sensor to stored values: vignetting, flare, exposure, noise, clipping,
//! encoding, quantisation.
//!
//! The model is that of [`radiance`](crate::radiance), read from right to left: s = L f t k above black,
//! in linear units of the file, with g electrons per unit.

use rand_distr::{Distribution, Normal, Poisson};
use rayon::prelude::*;

use super::draw::{Purpose, generator};
use super::recipe::{Faults, Output, PhotoFormat};
use super::render::Picture;
use crate::capture::{Encoding, Sensor};

/// A sensor ready to expose pictures.
#[derive(Clone, Debug)]
pub(super) struct Exposer {
    encoding: Encoding,
    format: PhotoFormat,
    /// Linear value of no light, and the largest signal above it.
    black: f64,
    white: f64,
    /// Electrons per unit of signal.
    electrons: Option<f64>,
    /// Units of signal per unit radiance and second.
    scale: f64,
    shot: bool,
    /// Standard deviation of the read noise, electrons.
    read_e: f64,
    vignetting: [f64; 3],
    flare: f64,
    seed: u64,
}

impl Exposer {
    /// `brightest`: radiance that reaches the recipe's `fill` where the scale is chosen by it.
    pub(super) fn new(
        sensor: &Sensor,
        output: &Output,
        faults: &Faults,
        brightest: f64,
        seed: u64,
    ) -> Self {
        let encoding = sensor.encoding.clone().unwrap_or(Encoding::Linear);
        let largest = match output.format {
            PhotoFormat::Png { bits } => f64::from((1u32 << bits) - 1),
            PhotoFormat::ExrHalf => 65504.0,
            PhotoFormat::ExrFloat => f64::INFINITY,
        };
        let decode = |stored: f64| decode(&encoding, stored, output.format);
        let black = decode(sensor.black_level.unwrap_or(0.0));
        let white = decode(sensor.white_level.unwrap_or(largest)) - black;
        let electrons = sensor.full_well_e.map(|e| e / white);
        let shortest = output
            .exposures_s
            .iter()
            .copied()
            .fold(f64::INFINITY, f64::min);
        let by_fill = output.fill * white / (brightest * shortest);
        let scale = match (output.scale, sensor.responsivity, electrons) {
            (Some(scale), ..) => scale,
            (None, Some(responsivity), Some(electrons)) => responsivity / electrons,
            _ if matches!(output.format, PhotoFormat::Png { .. }) && by_fill.is_finite() => by_fill,
            _ => 1.0,
        };
        Self {
            encoding,
            format: output.format,
            black,
            white,
            electrons,
            scale,
            shot: faults.shot_noise,
            read_e: if faults.read_noise {
                sensor.read_noise_e.unwrap_or(0.0)
            } else {
                0.0
            },
            vignetting: sensor.vignetting.unwrap_or_default(),
            flare: faults.flare,
            seed,
        }
    }

    /// Units of signal per unit radiance and second.
    pub(super) fn scale(&self) -> f64 {
        self.scale
    }

    /// Electrons per unit radiance and second, if electrons are counted.
    pub(super) fn responsivity(&self) -> Option<f64> {
        Some(self.scale * self.electrons?)
    }

    /// What the lens makes of a picture: darker towards the corners, and a veil over all.
    pub(super) fn through_lens(&self, picture: &mut Picture) {
        let [width, height] = picture.size;
        let [a, b, c] = self.vignetting;
        let half = picture.size.map(|n| f64::from(n) / 2.0);
        let corner = half[0] * half[0] + half[1] * half[1];
        if self.vignetting != [0.0; 3] {
            let factor = |x: u32, y: u32| {
                let (dx, dy) = (f64::from(x) + 0.5 - half[0], f64::from(y) + 0.5 - half[1]);
                let r2 = (dx * dx + dy * dy) / corner;
                1.0 + r2 * (a + r2 * (b + r2 * c))
            };
            for plane in &mut picture.values {
                for (y, row) in (0..height).zip(plane.chunks_exact_mut(width as usize)) {
                    for (x, value) in (0..width).zip(row) {
                        *value = (f64::from(*value) * factor(x, y)) as f32;
                    }
                }
            }
        }
        if self.flare > 0.0 {
            for plane in &mut picture.values {
                let mean = plane.iter().map(|&v| f64::from(v)).sum::<f64>() / plane.len() as f64;
                for value in plane {
                    *value = ((1.0 - self.flare) * f64::from(*value) + self.flare * mean) as f32;
                }
            }
        }
    }

    /// Stored values of one exposure of `seconds`, \[channel\]\[pixel\]; `number` tells the photos of a set
    /// apart.
    pub(super) fn expose(&self, picture: &Picture, seconds: f64, number: u64) -> Vec<Vec<f32>> {
        let width = picture.size[0] as usize;
        let read = Normal::new(0.0, self.read_e).ok();
        let rows: Vec<Vec<Vec<f32>>> = (0..picture.size[1] as usize)
            .into_par_iter()
            .map(|row| {
                let mut random = generator(self.seed, Purpose::Noise, number, row as u64);
                let line = |plane: &Vec<f32>| {
                    plane
                        .iter()
                        .skip(row * width)
                        .take(width)
                        .map(|&radiance| {
                            let mut signal = f64::from(radiance) * seconds * self.scale;
                            if let Some(electrons) = self.electrons {
                                let mut count = signal * electrons;
                                if self.shot
                                    && let Ok(poisson) = Poisson::new(count)
                                {
                                    count = poisson.sample(&mut random);
                                }
                                if self.read_e > 0.0
                                    && let Some(read) = &read
                                {
                                    count += read.sample(&mut random);
                                }
                                signal = count / electrons;
                            }
                            self.stored(signal) as f32
                        })
                        .collect()
                };
                picture.values.iter().map(line).collect()
            })
            .collect();
        (0..picture.values.len())
            .map(|c| rows.iter().flat_map(|row| &row[c]).copied().collect())
            .collect()
    }

    /// The stored value of a signal.
    fn stored(&self, signal: f64) -> f64 {
        let linear = self.black + signal.min(self.white);
        let PhotoFormat::Png { bits } = self.format else {
            return linear;
        };
        let largest = f64::from((1u32 << bits) - 1);
        encode(&self.encoding, linear, self.format)
            .round()
            .clamp(0.0, largest)
    }
}

/// The largest value that the file can hold, over which curves are defined.
fn range(format: PhotoFormat) -> f64 {
    match format {
        PhotoFormat::Png { bits: 8 } => 255.0,
        PhotoFormat::Png { .. } => 65535.0,
        PhotoFormat::ExrHalf | PhotoFormat::ExrFloat => 1.0,
    }
}

/// Linear value of a stored one (IEC 61966-2-1 for sRGB).
fn decode(encoding: &Encoding, stored: f64, format: PhotoFormat) -> f64 {
    let v = stored / range(format);
    match encoding {
        Encoding::Linear | Encoding::Response(_) | Encoding::Recover(_) => stored,
        Encoding::Srgb if v <= 0.040_45 => v / 12.92,
        Encoding::Srgb => ((v + 0.055) / 1.055).powf(2.4),
        Encoding::Gamma(gamma) => v.max(0.0).powf(*gamma),
    }
}

/// The inverse of [`decode`].
fn encode(encoding: &Encoding, linear: f64, format: PhotoFormat) -> f64 {
    let v = match encoding {
        Encoding::Linear | Encoding::Response(_) | Encoding::Recover(_) => return linear,
        Encoding::Srgb if linear <= 0.003_130_8 => 12.92 * linear,
        Encoding::Srgb => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
        Encoding::Gamma(gamma) => linear.max(0.0).powf(1.0 / gamma),
    };
    v * range(format)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_is_the_inverse_of_decoding() {
        let format = PhotoFormat::Png { bits: 8 };
        for encoding in [Encoding::Linear, Encoding::Srgb, Encoding::Gamma(2.2)] {
            for code in 0..=255 {
                let stored = f64::from(code);
                let again = encode(&encoding, decode(&encoding, stored, format), format);
                // The two ends of sRGB's straight part are rounded in the standard: 1e-4 of a code.
                assert!(
                    (again - stored).abs() < 1e-3,
                    "{encoding:?} {code}: {again}"
                );
            }
        }
    }
}
