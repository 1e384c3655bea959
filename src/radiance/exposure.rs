//! One photo as signal: linear, above black, without clipped pixels.

use std::ops::Range;

use super::calibration;
use super::census::Census;
use super::noise::Levels;
use super::response::{Response, Steps, rounding, rounding_in_binade};
use crate::capture::{Capture, Encoding, Photo as Shot};
use crate::error::{Error, Result};
use crate::photo::{self, Photo, Storage};

/// The signal of one photo's rows.
#[derive(Clone)]
pub(super) struct Exposure {
    /// Exposure time, seconds.
    pub seconds: f64,
    /// Channel names.
    pub channels: Vec<String>,
    /// How the file stores its values.
    pub storage: Storage,
    /// Signal, \[channel\]\[pixel\]; NaN where it is clipped or absent.
    pub signal: Vec<Vec<f32>>,
    /// Which pixels are sites of the channel's filter, \[channel\]\[pixel\]; `None`: all of all channels.
    pub sites: Option<Vec<Vec<bool>>>,
    /// Variance of the signal by rounding, \[channel\]\[pixel\].
    pub rounding: Vec<Vec<f32>>,
    /// Levels by channel.
    pub levels: Vec<Levels>,
    /// How stored values became linear.
    pub response: Response,
    /// Values that are no measurement.
    pub census: Census,
}

impl Exposure {
    /// Reads some rows of a photo.
    ///
    /// # Errors
    /// The photo cannot be read, or has not the camera's image size.
    pub(super) fn read(capture: &Capture, shot: &Shot, rows: &Range<u32>) -> Result<Self> {
        let path = capture.folder.join(&shot.file);
        let photo = calibration::of_size(&path, capture.camera.image_size, rows.clone())?;
        let response = match &capture.sensor.encoding {
            Some(encoding) => Response::of(encoding, &capture.folder)?,
            None => Response::by_storage(photo.storage),
        };
        if let (Some(Encoding::Response(file)), Response::Table { linear, .. }) =
            (&capture.sensor.encoding, &response)
            && linear.len() != 1
            && linear.len() != photo.channels.len()
        {
            return Err(Error::input(format!(
                "expected a response of 1 channel or of the {} channels {}, found {}",
                photo.channels.len(),
                photo.channels.join(", "),
                linear.len()
            ))
            .file(capture.folder.join(file)));
        }
        let seconds = match shot.exposure_s {
            Some(seconds) => seconds,
            None => photo::info(&path)?.shot.exposure_s.unwrap_or(1.0),
        };
        let dark = calibration::dark(capture, rows)?;
        Self::linearise(capture, photo, response, seconds, dark.as_ref())
    }

    fn linearise(
        capture: &Capture,
        photo: Photo,
        response: Response,
        seconds: f64,
        dark: Option<&Photo>,
    ) -> Result<Self> {
        let storage = photo.storage;
        let census = Census::of(&photo);
        let mut signal = photo.values;
        let sites = match storage {
            Storage::Sensor { .. } if signal.iter().flatten().any(|v| v.is_nan()) => Some(
                signal
                    .iter()
                    .map(|plane| plane.iter().map(|v| !v.is_nan()).collect())
                    .collect(),
            ),
            _ => None,
        };
        let brightest = match storage {
            Storage::SharedExponent => Some(brightest(&signal)),
            _ => None,
        };
        let (channels, width) = (signal.len(), photo.size[0] as usize);
        let mut rounding_variance = Vec::with_capacity(signal.len());
        let mut levels = Vec::with_capacity(signal.len());
        let step = code_step(&signal, storage);
        for (c, plane) in signal.iter_mut().enumerate() {
            let level = Levels::of(&capture.sensor, &response, c, storage)?;
            let dark = dark.and_then(|d| d.values.get(c).or(d.values.first()));
            let curve = Curve::new(&response, c, storage);
            let least = least_rounding(plane, storage);
            let mut variance = vec![0.0; plane.len()];
            let white = level.white_stored as f32;
            if response == Response::Linear && dark.is_none() && brightest.is_none() {
                pulp::Arch::new().dispatch(Unclipped {
                    plane,
                    variance: &mut variance,
                    white,
                    black: level.black as f32,
                    storage,
                    step,
                    least,
                });
            } else {
                for (i, (x, variance)) in plane.iter_mut().zip(&mut variance).enumerate() {
                    let stored = *x;
                    if stored.is_nan() || stored >= white {
                        *x = f32::NAN;
                        *variance = f32::INFINITY;
                        continue;
                    }
                    let (linear, slope) = curve.at(stored);
                    let black = match dark.and_then(|d| d.get(i)) {
                        Some(&dark) => curve.at(dark).0,
                        None => level.black as f32,
                    };
                    *x = linear - black;
                    let largest = brightest.as_ref().and_then(|b| b.get(i)).copied();
                    let stored_variance =
                        (step * rounding(largest.unwrap_or(stored), storage)).max(least);
                    *variance = stored_variance * slope * slope;
                }
            }
            // A colour between the sites of its filter was made from its neighbours, clipped ones too.
            if channels > 1 && matches!(storage, Storage::Integer { .. }) {
                drop_neighbours(plane, &mut variance, width);
            }
            rounding_variance.push(variance);
            levels.push(level);
        }
        Ok(Self {
            seconds,
            channels: photo.channels,
            storage,
            signal,
            sites,
            rounding: rounding_variance,
            levels,
            response,
            census,
        })
    }
}

/// Stored values that are linear already to signal and variance, with the processor's widest instructions.
struct Unclipped<'a> {
    plane: &'a mut [f32],
    variance: &'a mut [f32],
    white: f32,
    black: f32,
    storage: Storage,
    step: f32,
    least: f32,
}

impl Unclipped<'_> {
    #[inline(always)]
    fn each(&mut self, rounding: impl Fn(f32) -> f32) {
        let (white, black, step, least) = (self.white, self.black, self.step, self.least);
        for (x, variance) in self.plane.iter_mut().zip(&mut *self.variance) {
            let stored = *x;
            let unclipped = stored < white;
            let own = step * rounding(stored);
            let own = if own > least { own } else { least };
            *variance = if unclipped { own } else { f32::INFINITY };
            *x = if unclipped { stored - black } else { f32::NAN };
        }
    }
}

impl pulp::NullaryFnOnce for Unclipped<'_> {
    type Output = ();

    #[inline(always)]
    fn call(mut self) {
        match Steps::of(self.storage) {
            Steps::Whole => self.each(|_| 1.0 / 12.0),
            Steps::Binades { lowest, fraction } => {
                self.each(|x| rounding_in_binade(x, lowest, fraction));
            }
        }
    }
}

/// Makes the eight neighbours of each missing pixel missing.
fn drop_neighbours(plane: &mut [f32], variance: &mut [f32], width: usize) {
    let width = width.max(1);
    let missing: Vec<usize> = plane
        .iter()
        .enumerate()
        .filter_map(|(i, v)| v.is_nan().then_some(i))
        .collect();
    for at in missing {
        let x = at % width;
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let row = at / width;
        for y in row.saturating_sub(1)..row + 2 {
            let cells = y * width + columns.start..y * width + columns.end;
            if let (Some(values), Some(variances)) =
                (plane.get_mut(cells.clone()), variance.get_mut(cells))
            {
                values.fill(f32::NAN);
                variances.fill(f32::INFINITY);
            }
        }
    }
}

/// Square of the step between the codes that occur: sensors of 12 or 14 bits are often stored in the
/// upper bits of 16, which leaves the lower ones 0 in every pixel.
fn code_step(planes: &[Vec<f32>], storage: Storage) -> f32 {
    let Storage::Integer { max: 256.. } = storage else {
        return 1.0;
    };
    let mut bits = 0_u32;
    for plane in planes {
        for &value in plane {
            bits |= value as u32;
            if bits & 1 == 1 {
                return 1.0;
            }
        }
    }
    let step = (1_u32 << bits.trailing_zeros().min(8)) as f32;
    step * step
}

/// The brightest channel by pixel.
fn brightest(planes: &[Vec<f32>]) -> Vec<f32> {
    let mut brightest = planes.first().cloned().unwrap_or_default();
    for plane in planes {
        brightest
            .iter_mut()
            .zip(plane)
            .for_each(|(b, v)| *b = b.max(*v));
    }
    brightest
}

/// The least variance of rounding of any pixel of a plane. Floating point has ever finer steps
/// towards 0, but sums and resampling before the file was written were rounded at the picture's own
/// scale: no pixel is known better than the steps at a thousandth of the brightest.
fn least_rounding(plane: &[f32], storage: Storage) -> f32 {
    if let Storage::Integer { .. } | Storage::Sensor { .. } = storage {
        return 0.0;
    }
    let largest = pulp::Arch::new().dispatch(|| {
        let mut largest = [0.0_f32; 16];
        let (blocks, rest) = plane.as_chunks::<16>();
        let size = |v: f32| if v.is_finite() { v.abs() } else { 0.0 };
        for block in blocks {
            for (largest, v) in largest.iter_mut().zip(block) {
                let v = size(*v);
                *largest = if v > *largest { v } else { *largest };
            }
        }
        let rest = rest.iter().map(|v| size(*v));
        largest.into_iter().chain(rest).fold(0.0, f32::max)
    });
    rounding(largest / 1000.0, storage).max(f32::MIN_POSITIVE)
}

/// A response with its values at every integer code at hand.
struct Curve<'a> {
    response: &'a Response,
    channel: usize,
    storage: Storage,
    codes: Vec<(f32, f32)>,
}

impl<'a> Curve<'a> {
    fn new(response: &'a Response, channel: usize, storage: Storage) -> Self {
        let pair = |v: f64| {
            let (linear, slope) = response.decode(v, channel, storage);
            (linear as f32, slope as f32)
        };
        let codes = match storage {
            Storage::Integer { max } if max <= 0xffff && *response != Response::Linear => {
                (0..=max).map(|v| pair(f64::from(v))).collect()
            }
            _ => Vec::new(),
        };
        Self {
            response,
            channel,
            storage,
            codes,
        }
    }

    fn at(&self, stored: f32) -> (f32, f32) {
        if *self.response == Response::Linear {
            return (stored, 1.0);
        }
        // Dark frames are means of many and need not be whole.
        if let Some(&pair) = self.codes.get(stored as usize)
            && stored.fract() == 0.0
            && stored >= 0.0
        {
            return pair;
        }
        let (linear, slope) = self
            .response
            .decode(f64::from(stored), self.channel, self.storage);
        (linear as f32, slope as f32)
    }
}
