//! Shot and read noise as the variance of a pixel's signal.

use std::sync::LazyLock;

use super::response::Response;
use crate::capture::Sensor;
use crate::error::{Error, Result};
use crate::photo::Storage;

/// Noise of a signal s: var s = `shot` · s + `read`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Variance per unit of signal: one over the electrons per unit of signal.
    pub shot: f64,
    /// Variance of no signal.
    pub read: f64,
}

impl Noise {
    /// Variance of a pixel whose expected signal is `signal`.
    pub fn variance(&self, signal: f64) -> f64 {
        self.shot * signal.max(0.0) + self.read
    }
}

/// Harmonics of a staircase that are summed: those beyond are below 1e-6 of the rounding even with the least noise that is tabulated.
const HARMONICS: u32 = 1000;
/// Steps of the tables, between which they are linear: to 3e-5 of the rounding.
const STEPS: usize = 512;

/// Of a rounding error's variance, the part that all measurements of one value have in common when their own noise has the variance
/// `noise`.
///
/// With step q and σ² = `noise`, the mean of rounded values errs by Σ (−1)ᵏ q/(πk) exp(−2π²k²σ²/q²) sin(2πk v/q) over k ≥ 1, the Fourier series of
/// the staircase seen through the noise (B. Widrow and I. Kollár, "Quantization Noise", Cambridge (2008), chapter 4). Over all values v its
/// variance is q²/2π² Σ k⁻² exp(−4π²k²σ²/q²): all of q²/12 without noise, 4 % of it at σ = q/3, none from half a step on.
pub fn shared_rounding(rounding: f64, noise: f64) -> f64 {
    /// By σ/q: near 0 it falls in proportion.
    static PARTS: LazyLock<Vec<f64>> = LazyLock::new(|| table(|turn| shared_part(turn * turn)));
    let ratio = noise / (12.0 * rounding);
    // Beyond, 1e-17 of the rounding.
    if !(rounding > 0.0 && ratio < 1.0) {
        return 0.0;
    }
    rounding * between(&PARTS, ratio.max(0.0).sqrt())
}

/// [`shared_rounding`] where the noise is not known, but how measurements of one value scatter (variance): noise and rounding without what
/// they share.
pub fn shared_rounding_of(rounding: f64, scatter: f64) -> f64 {
    static PARTS: LazyLock<Vec<f64>> = LazyLock::new(|| {
        table(|scatter| {
            let (mut low, mut high) = (0.0, scatter);
            for _ in 0..40 {
                let noise = 0.5 * (low + high);
                if noise + (1.0 - shared_part(noise)) / 12.0 > scatter {
                    high = noise;
                } else {
                    low = noise;
                }
            }
            shared_part(0.5 * (low + high))
        })
    });
    let ratio = scatter / (12.0 * rounding);
    if !(rounding > 0.0 && ratio < 1.0) {
        return 0.0;
    }
    rounding * between(&PARTS, ratio.max(0.0))
}

/// The shared part of the rounding for noise of the variance `ratio` q².
fn shared_part(ratio: f64) -> f64 {
    const ALL: f64 = 6.0 / (std::f64::consts::PI * std::f64::consts::PI);
    if !(ratio > 0.0) {
        return 1.0;
    }
    let squared = 4.0 * std::f64::consts::PI.powi(2) * ratio;
    let mut sum = 0.0;
    for k in 1..=HARMONICS {
        let k = f64::from(k).powi(2);
        let term = (-squared * k).exp() / k;
        sum += term;
        if term < 1e-9 * sum {
            break;
        }
    }
    (ALL * sum).min(1.0)
}

/// The values of a function at even steps from 0 to 1.
fn table(value: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..=STEPS)
        .map(|k| value(k as f64 / STEPS as f64))
        .collect()
}

/// A table's value at `x` from 0 to 1.
fn between(table: &[f64], x: f64) -> f64 {
    let place = x * (table.len() - 1) as f64;
    let k = (place as usize).min(table.len() - 2);
    let [low, high] = [table[k], table[k + 1]];
    low + (place - k as f64) * (high - low)
}

/// What the sensor's description says of levels and noise, in units of signal for one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Levels {
    /// The linear value of no light.
    pub black: f64,
    /// The stored value from which a pixel is clipped.
    pub white_stored: f64,
    /// The signal of that stored value.
    pub white: f64,
    /// The signal of the lowest value that can be stored.
    pub floor: f64,
    /// The stated noise.
    pub noise: Option<Noise>,
    /// Signal per unit radiance and second: responsivity over electrons per unit of signal, or 1.
    pub scale: f64,
}

impl Levels {
    /// Reads them off the sensor's description for files stored in one way.
    ///
    /// # Errors
    /// A full well or a responsivity is given without what gives it a scale.
    pub(super) fn of(
        sensor: &Sensor,
        response: &Response,
        channel: usize,
        storage: Storage,
    ) -> Result<Self> {
        let linear = |stored: f64| response.decode(stored, channel, storage).0;
        let (highest, lowest) = match storage {
            Storage::Integer { max } => (f64::from(max), linear(0.0)),
            Storage::Sensor { white, black } => (f64::from(white), -f64::from(black)),
            Storage::Half => (65504.0, f64::NEG_INFINITY),
            Storage::Float | Storage::SharedExponent => (f64::INFINITY, f64::NEG_INFINITY),
        };
        // Levels are stated in the sensor's codes, of which the file's own black was taken.
        let taken = match storage {
            Storage::Sensor { black, .. } => f64::from(black),
            _ => 0.0,
        };
        let black = sensor
            .black_level
            .map_or_else(|| linear(0.0), |level| linear(level - taken));
        let white_stored = sensor.white_level.map_or(highest, |level| level - taken);
        let white = if white_stored.is_finite() {
            linear(white_stored) - black
        } else {
            f64::INFINITY
        };
        let stated = sensor.white_level.is_some()
            || matches!(storage, Storage::Integer { .. } | Storage::Sensor { .. });
        let electrons = match sensor.full_well_e {
            Some(full_well) if stated && white > 0.0 => Some(full_well / white),
            Some(_) => {
                return Err(Error::input(
                    "expected a white_level above black beside full_well_e, found none",
                )
                .key("sensor.white_level")
                .advice("full_well_e is the number of electrons at white_level."));
            }
            None => None,
        };
        let scale = match (sensor.responsivity, electrons) {
            (None, _) => 1.0,
            (Some(responsivity), Some(electrons)) => responsivity / electrons,
            (Some(_), None) => {
                return Err(
                    Error::input("expected full_well_e beside responsivity, found none")
                        .key("sensor.full_well_e")
                        .advice("Only with it are electrons known from stored values."),
                );
            }
        };
        Ok(Self {
            black,
            white_stored,
            white,
            floor: lowest - black,
            noise: electrons.map(|e| Noise {
                shot: 1.0 / e,
                read: (sensor.read_noise_e.unwrap_or(0.0) / e).powi(2),
            }),
            scale,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn between_its_steps_a_table_is_the_series() {
        for k in 0..1000 {
            let sigma = (f64::from(k) + 0.5) / 1000.0;
            let miss = shared_rounding(1.0, 12.0 * sigma * sigma) - shared_part(sigma * sigma);
            assert!(miss.abs() < 3e-5, "{sigma}: {miss}");
            // There and back.
            let scatter = 12.0 * sigma * sigma + 1.0 - shared_part(sigma * sigma);
            let miss = shared_rounding_of(1.0, scatter) - shared_part(sigma * sigma);
            assert!(miss.abs() < 1e-3, "{sigma}: {miss}");
        }
    }

    #[test]
    fn noise_carries_values_over_the_steps() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        for sigma in [0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4] {
            let (mut errors, mut scatters) = (0.0, 0.0);
            let (values, rows) = (400, 1000);
            for v in 0..values {
                let value = (f64::from(v) + 0.5) / f64::from(values);
                let (mut sum, mut squares) = (0.0, 0.0);
                for _ in 0..rows {
                    let noise: f64 = StandardNormal.sample(&mut random);
                    let rounded = (value + sigma * noise).round();
                    sum += rounded;
                    squares += rounded * rounded;
                }
                let mean = sum / f64::from(rows);
                errors += (mean - value).powi(2);
                scatters += squares / f64::from(rows) - mean * mean;
            }
            let [shared, scatter] = [errors, scatters].map(|s| s / f64::from(values));
            let found = shared_rounding(1.0 / 12.0, sigma * sigma);
            // The scatter of 1000 rows is left in the mean.
            let by_chance = scatter / f64::from(rows);
            let allowed = 0.02 / 12.0 + 2.0 * by_chance;
            assert!(
                (found - shared).abs() < allowed,
                "{sigma}: {found} {shared}"
            );
            let by_scatter = shared_rounding_of(1.0 / 12.0, scatter);
            assert!(
                (by_scatter - shared).abs() < 2.0 * allowed,
                "{sigma}: {by_scatter} {shared}"
            );
        }
    }
}
