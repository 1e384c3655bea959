//! Shot and read noise as the variance of a pixel's signal.

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
