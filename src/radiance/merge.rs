//! Exposures of one view to one radiance per pixel, each weighted by the inverse of its expected
//! variance.
//!
//! Weights, variances and the decision whether an exposure is near clipping come from the expected
//! signal of a pixel, never from the noisy value itself: a value that is low by chance would get
//! more weight and a smaller variance, and one that is high by chance would be dropped as clipped.
//! (M. Granados et al., "Optimal HDR reconstruction with linear digital cameras", CVPR 2010, iterate
//! on each pixel's own estimate; the neighbours' help removes the bias that is left by it.)

use std::ops::Range;
use std::path::Path;

use super::Radiance;
use super::align;
use super::brackets;
use super::calibration;
use super::census::Census;
use super::exposure::Exposure;
use super::filters;
use super::motion::{self, Shift};
use super::noise::{Noise, shared_rounding};
use super::recovery;
use super::smooth;
use crate::capture::{Capture, Encoding, View};
use crate::error::{Error, Result};
use crate::photo::Storage;

/// How far, in standard deviations, a pixel's expected signal stays away from where it would be
/// clipped: closer, the exposures that happen to be unclipped are low by selection (at 3σ by
/// 0.004σ).
const CLIP_MARGIN: f64 = 3.0;

/// Radiance and variance of one channel, \[pixel\].
pub(super) type Plane = (Vec<f32>, Vec<f32>);

/// A view's radiance and what was found out about its exposures on the way.
#[derive(Clone, Debug, PartialEq)]
pub struct Developed {
    /// The radiance.
    pub radiance: Radiance,
    /// By photo, in the view's order.
    pub exposures: Vec<Found>,
    /// How the photos store their values.
    pub storage: Storage,
    /// Stored values that are no measurement, of all photos.
    pub census: Census,
}

/// What a view's brackets say of one of its exposures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// By what the stated exposure time was multiplied; the mean logarithm of a view is 0.
    pub time_factor: f64,
    /// How the photo lay against the view's other photos before it was moved back.
    pub shift: Shift,
}

/// Linear radiance of some rows of a view, from all its exposures; see [`develop`].
///
/// # Errors
/// As [`develop`].
pub fn view(capture: &Capture, index: usize, rows: Range<u32>) -> Result<Radiance> {
    Ok(develop(capture, index, rows)?.radiance)
}

/// Linear radiance of some rows of a view, from all its exposures.
///
/// Reads each photo's rows, linearises them, solves for small errors of the stated exposure times,
/// estimates the noise from the brackets if the capture does not state it, moves exposures back that
/// are shifted, and merges. A pixel that is clipped or absent in all photos has an infinite variance
/// and the value 0.
///
/// # Errors
/// There is no such view; the response is to be recovered and cannot be; a photo cannot be read or differs from the others in size, channels or
/// storage; the sensor's description is incomplete; the exposure times contradict the pixels; the
/// camera moved between exposures by more than can be made good.
pub fn develop(capture: &Capture, index: usize, rows: Range<u32>) -> Result<Developed> {
    let view = capture.views.get(index).ok_or_else(|| {
        Error::input(format!(
            "expected one of {} views, found the number {index}",
            capture.views.len()
        ))
    })?;
    if let Some(Encoding::Recover(None)) = capture.sensor.encoding {
        let (capture, _) = recovery::resolved(capture)?;
        return develop(&capture, index, rows);
    }
    of_view(capture, view, rows).map_err(|error| error.view(index))
}

fn of_view(capture: &Capture, view: &View, rows: Range<u32>) -> Result<Developed> {
    let mut exposures = Vec::with_capacity(view.photos.len());
    for photo in &view.photos {
        exposures.push(Exposure::read(capture, photo, &rows)?);
    }
    let first = exposures
        .first()
        .ok_or_else(|| Error::input("expected at least one photo, found none"))?;
    for (other, photo) in exposures.iter().zip(&view.photos).skip(1) {
        if other.channels != first.channels || other.storage != first.storage {
            return Err(Error::input(format!(
                "expected the channels {} stored as {:?}, as in the view's first photo, found {} as {:?}",
                first.channels.join(","),
                first.storage,
                other.channels.join(","),
                other.storage
            ))
            .file(capture.folder.join(&photo.file)));
        }
    }
    let channels = first.channels.clone();
    let illumination = calibration::illumination(
        capture,
        &rows,
        channels.len(),
        first.storage,
        &first.response,
    )?;
    let files: Vec<_> = view
        .photos
        .iter()
        .map(|photo| photo.file.as_path())
        .collect();
    let stated: Vec<Bracket<'_>> = (0..channels.len())
        .map(|channel| Bracket {
            exposures: &exposures,
            channel,
            seconds: exposures.iter().map(|e| e.seconds).collect(),
            illumination: illumination
                .as_ref()
                .and_then(|i| i.get(channel))
                .map(Vec::as_slice),
            noise: first.levels.get(channel).and_then(|l| l.noise),
            width: capture.camera.image_size[0] as usize,
        })
        .collect();

    let aligned: Vec<Exposure>;
    let thought: Vec<f64> = match &capture.sensor.encoding {
        Some(Encoding::Recover(Some(curve))) => exposures
            .iter()
            .map(|e| curve.time_factor(e.seconds))
            .collect(),
        _ => vec![1.0; exposures.len()],
    };
    let (mut planes, mut factors) = solved(&stated, &exposures, &files, &thought)?;
    let shifts = if exposures.len() > 1 {
        motion::between(&exposures, &planes, &files)?
    } else {
        None
    };
    if let Some(shifts) = &shifts {
        if exposures.iter().any(|e| e.sites.is_some()) {
            return Err(motion::at_sites(shifts, &files));
        }
        let by: Vec<[f64; 2]> = shifts.iter().map(|shift| shift.by).collect();
        aligned = align::aligned(&exposures, &by, &planes);
        // Times and noise that were found on moved pictures are found again.
        (planes, factors) = solved(&stated, &aligned, &files, &thought)?;
    }
    let noise_known = planes.iter().all(|plane| plane.noise.is_some());
    let shifts = shifts.unwrap_or_else(|| vec![Shift::default(); exposures.len()]);
    let mut census = Census::default();
    exposures.iter().for_each(|e| census.add(&e.census));
    let storage = first.storage;
    let mut shared = Vec::new();
    let mut merged: Vec<Plane> = if exposures.len() == 1 && !noise_known {
        let reaches: Vec<f32> = planes.iter().map(Bracket::only_reach).collect();
        let scaled = exposures.iter_mut().flat_map(|only| {
            std::mem::take(&mut only.signal)
                .into_iter()
                .zip(std::mem::take(&mut only.rounding))
        });
        scaled
            .zip(reaches)
            .enumerate()
            .map(|(channel, (plane, reach))| {
                let light = illumination.as_ref().and_then(|i| i.get(channel));
                scale(plane, reach, light.map(Vec::as_slice))
            })
            .collect()
    } else {
        let merge = |plane: &Bracket<'_>| plane.merge(&plane.expected());
        let (merged, parts): (Vec<Plane>, Vec<Vec<f32>>) = planes.iter().map(merge).unzip();
        if noise_known && parts.iter().flatten().any(|part| *part > 0.0) {
            shared = parts;
        }
        merged
    };
    if let Some(sites) = exposures.first().and_then(|e| e.sites.as_ref()) {
        let width = capture.camera.image_size[0] as usize;
        for (plane, sites) in merged.iter_mut().zip(sites) {
            filters::fill(plane, sites, width);
        }
    }
    let (value, variance) = merged.into_iter().unzip();
    Ok(Developed {
        storage,
        census,
        radiance: Radiance {
            size: capture.camera.image_size,
            rows,
            channels,
            value,
            variance,
            shared,
            noise_known,
        },
        exposures: factors
            .into_iter()
            .zip(shifts)
            .map(|(time_factor, shift)| Found { time_factor, shift })
            .collect(),
    })
}

/// The planes of some exposures with their times corrected and their noise estimated where `stated` has
/// none, and the factors of the times, which are thought to be about `thought`.
fn solved<'a>(
    stated: &[Bracket<'a>],
    exposures: &'a [Exposure],
    files: &[&Path],
    thought: &[f64],
) -> Result<(Vec<Bracket<'a>>, Vec<f64>)> {
    let mut planes = brackets_of(exposures, stated);
    if exposures.len() < 2 {
        return Ok((planes, vec![1.0; exposures.len()]));
    }
    let factors = brackets::time_factors(&planes, files, thought)?;
    for plane in &mut planes {
        for (seconds, factor) in plane.seconds.iter_mut().zip(&factors) {
            *seconds *= factor;
        }
        if plane.noise.is_none() {
            plane.noise = brackets::noise(plane);
        }
    }
    Ok((planes, factors))
}

/// The planes of other exposures that are described as `like`.
pub(super) fn brackets_of<'a>(exposures: &'a [Exposure], like: &[Bracket<'a>]) -> Vec<Bracket<'a>> {
    like.iter()
        .map(|plane| Bracket {
            exposures,
            seconds: plane.seconds.clone(),
            ..*plane
        })
        .collect()
}

/// One channel of all exposures of a view.
pub(super) struct Bracket<'a> {
    pub exposures: &'a [Exposure],
    pub channel: usize,
    /// Exposure times, corrected where they have been solved for.
    pub seconds: Vec<f64>,
    /// Relative illumination by pixel, 1 if `None`.
    pub illumination: Option<&'a [f32]>,
    /// Noise of the signal, if it is known.
    pub noise: Option<Noise>,
    /// Pixels in a row.
    pub width: usize,
}

/// One exposure's measurement of one pixel.
#[derive(Clone, Copy)]
pub(super) struct Measurement {
    /// Signal; its expectation is `reach` times the radiance.
    pub signal: f64,
    /// Signal per unit of radiance: f t, and the absolute scale if there is one.
    pub reach: f64,
    /// Variance by rounding.
    pub rounding: f64,
    /// Index of the exposure.
    pub exposure: usize,
}

impl Bracket<'_> {
    pub(super) fn pixels(&self) -> usize {
        self.exposures
            .first()
            .and_then(|e| e.signal.get(self.channel))
            .map_or(0, Vec::len)
    }

    /// Signal per unit of radiance of one exposure, by pixel.
    pub(super) fn reaches(&self, exposure: usize) -> Vec<f64> {
        let seconds = self.seconds.get(exposure).copied().unwrap_or(f64::NAN);
        let levels = self.exposures.get(exposure).map(|e| &e.levels);
        let scale = levels
            .and_then(|l| l.get(self.channel))
            .map_or(f64::NAN, |l| l.scale);
        (0..self.pixels())
            .map(|i| {
                let light = self
                    .illumination
                    .map_or(1.0, |f| f.get(i).map_or(f64::NAN, |&f| f64::from(f)));
                light * seconds * scale
            })
            .collect()
    }

    /// The unclipped measurements of a pixel.
    pub(super) fn measurements(&self, pixel: usize) -> impl Iterator<Item = Measurement> {
        let light = self
            .illumination
            .map_or(1.0, |f| f.get(pixel).map_or(f64::NAN, |&f| f64::from(f)));
        self.exposures
            .iter()
            .zip(&self.seconds)
            .enumerate()
            .filter_map(move |(exposure, (photo, seconds))| {
                let signal = *photo.signal.get(self.channel)?.get(pixel)?;
                let rounding = *photo.rounding.get(self.channel)?.get(pixel)?;
                let reach = light * seconds * photo.levels.get(self.channel)?.scale;
                (signal.is_finite() && reach > 0.0).then_some(Measurement {
                    signal: f64::from(signal),
                    reach,
                    rounding: f64::from(rounding),
                    exposure,
                })
            })
    }

    /// Expected radiance of every pixel: all unclipped light over all its time (the best estimate
    /// where shot noise rules, with weights that know nothing of the values), smoothed where the
    /// scatter is only noise. NaN where every exposure is clipped.
    pub(super) fn expected(&self) -> Vec<f32> {
        let pooled: Vec<f32> = (0..self.pixels())
            .map(|i| {
                let (signal, reach) = self
                    .measurements(i)
                    .fold((0.0, 0.0), |(s, r), m| (s + m.signal, r + m.reach));
                (signal / reach) as f32
            })
            .collect();
        let Some(noise) = self.noise else {
            return pooled;
        };
        smooth::expected(&pooled, self.width, |i, mean| {
            let (variance, reach) = self.measurements(i).fold((0.0, 0.0), |(v, r), m| {
                (v + noise.variance(mean * m.reach) + m.rounding, r + m.reach)
            });
            variance / (reach * reach)
        })
    }

    /// Radiance and variance by pixel, and the part of the variance that pixels of one radiance share.
    fn merge(&self, expected: &[f32]) -> (Plane, Vec<f32>) {
        expected
            .iter()
            .enumerate()
            .map(|(i, &expected)| {
                let merged = self.merge_pixel(i, f64::from(expected));
                let [value, variance, shared] = merged.unwrap_or([0.0, f64::INFINITY, 0.0]);
                ((value as f32, variance as f32), shared as f32)
            })
            .unzip()
    }

    /// Signal per unit of radiance and of illumination of the only exposure.
    fn only_reach(&self) -> f32 {
        let seconds = self.seconds.first().copied().unwrap_or(1.0);
        let levels = self.exposures.first().map(|only| &only.levels);
        let scale = levels
            .and_then(|levels| levels.get(self.channel))
            .map_or(1.0, |levels| levels.scale);
        (seconds * scale) as f32
    }

    fn merge_pixel(&self, pixel: usize, expected: f64) -> Option<[f64; 3]> {
        let (mut weights, mut sum, mut shared) = (0.0, 0.0, 0.0);
        let mut dimmest_use: Option<(Measurement, f64)> = None;
        for m in self.measurements(pixel) {
            let mut variance = m.rounding;
            let mut rounds_alike = m.rounding;
            if let Some(noise) = self.noise {
                let signal = expected * m.reach;
                let own = noise.variance(signal);
                variance += own;
                rounds_alike = shared_rounding(m.rounding, own);
                let margin = CLIP_MARGIN * variance.sqrt();
                let levels = self.exposures.get(m.exposure)?.levels.get(self.channel)?;
                if signal + margin >= levels.white {
                    continue;
                }
                if signal - margin <= levels.floor {
                    // Cut off at the lowest code: of use only if no exposure is better.
                    if dimmest_use.is_none_or(|(best, _)| best.reach < m.reach) {
                        dimmest_use = Some((m, variance));
                    }
                    continue;
                }
            }
            let weight = m.reach * m.reach / variance;
            weights += weight;
            sum += weight * m.signal / m.reach;
            shared += weight * weight * rounds_alike / (m.reach * m.reach);
        }
        if weights > 0.0 {
            return Some([sum / weights, 1.0 / weights, shared / (weights * weights)]);
        }
        dimmest_use.map(|(m, variance)| {
            let squared = m.reach * m.reach;
            [m.signal / m.reach, variance / squared, m.rounding / squared]
        })
    }
}

/// Radiance and variance from signal and variance of a single exposure whose noise is not known, in their place: nothing to weigh.
/// `reach` is the signal per unit of radiance, `illumination` by pixel.
fn scale((mut value, mut variance): Plane, reach: f32, illumination: Option<&[f32]>) -> Plane {
    let scale_pixel = |value: &mut f32, variance: &mut f32, reach: f32| {
        let known = value.is_finite() & (reach > 0.0);
        *value = if known { *value / reach } else { 0.0 };
        *variance = if known {
            *variance / (reach * reach)
        } else {
            f32::INFINITY
        };
    };
    pulp::Arch::new().dispatch(|| match illumination {
        None => {
            for (value, variance) in value.iter_mut().zip(&mut variance) {
                scale_pixel(value, variance, reach);
            }
        }
        Some(light) => {
            for (i, (value, variance)) in value.iter_mut().zip(&mut variance).enumerate() {
                let light = light.get(i).copied().unwrap_or(f32::NAN);
                scale_pixel(value, variance, reach * light);
            }
        }
    });
    (value, variance)
}
