//! The response of a camera from its own brackets: what codes one pixel has at known exposure times.
//!
//! P. E. Debevec and J. Malik, "Recovering high dynamic range radiance maps from photographs",
//! SIGGRAPH 1997, with their hand-made weights replaced by the noise, the smoothness chosen by the data,
//! and small errors of the exposure times solved for. The fit itself is in [`curve`](super::curve).

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use super::curve::{self, Codes, Patch, Seen};
use crate::capture::{Capture, Encoding, Photo as Shot, ResponseCurve};
use crate::error::{Error, Result};
use crate::photo::{self, Photo, Storage};

/// Views that are looked at, and pixels of each photo: a curve needs thousands of patches, not millions.
const VIEWS: usize = 8;
const PIXELS: usize = 400_000;

/// Width and height of a patch, pixels: its mean code is known to a fraction of a step.
const PATCH: [usize; 2] = [5, 3];

/// Largest scatter within a patch, in parts of the range of codes: where codes are spread further, the
/// curve at their mean is not the mean of the curve.
const FLAT: f64 = 0.02;

/// Codes of patches stay this many standard deviations away from where they are clipped.
const CLIP_MARGIN: f64 = 3.0;

/// How far codes stay above the darkest of the shortest exposure: standard deviations of a patch, codes, and parts of
/// that darkest code, since a veil is not the same in all exposures.
const FOG_MARGIN: (f64, f64, f64) = (6.0, 2.0, 0.5);

/// Bins of brightness from dark to bright, and most patches in one of them.
const BINS: usize = 64;
const PER_BIN: usize = 60;

/// A response and what was found out on the way.
#[derive(Clone, Debug, PartialEq)]
pub struct Recovery {
    /// The curve.
    pub curve: ResponseCurve,
    /// Stated exposure times, seconds, in increasing order, and the factors that the photos showed.
    pub times: Vec<(f64, f64)>,
    /// Standard deviations of the logarithms of these factors.
    pub time_sigmas: Vec<f64>,
    /// Number of patches that were used.
    pub patches: usize,
    /// Scatter of the logarithm of light about the fit, in units of what the noise lets expect.
    pub misfit: f64,
}

/// The capture with its response recovered, if its encoding asks for that; else as it is.
///
/// # Errors
/// As [`recover`].
pub fn resolved(capture: &Capture) -> Result<(Capture, Option<Recovery>)> {
    let mut capture = capture.clone();
    let recovery = match capture.sensor.encoding {
        Some(Encoding::Recover(None)) => Some(recover(&capture)?),
        _ => None,
    };
    if let Some(recovery) = &recovery {
        capture.sensor.encoding = Some(Encoding::Recover(Some(Arc::new(recovery.curve.clone()))));
    }
    Ok((capture, recovery))
}

/// Recovers the response from some of the capture's brackets.
///
/// The scale of each channel is not determined: 1 is the linear value of the middle code in all.
///
/// # Errors
/// No view has photos of different exposure times, photos are floating point, or too little of any is
/// neither clipped nor black.
pub fn recover(capture: &Capture) -> Result<Recovery> {
    let brackets: Vec<&[Shot]> = capture
        .views
        .iter()
        .map(|view| view.photos.as_slice())
        .filter(|photos| differ(photos))
        .collect();
    if brackets.is_empty() {
        return Err(Error::input(
            "expected views with photos of different exposure times, found none",
        )
        .key("sensor.encoding")
        .advice(
            "A response is recovered from brackets. Give it as srgb, gamma:… or response:FILE.csv.",
        ));
    }
    let step = brackets.len().div_ceil(VIEWS);
    let chosen: Vec<&[Shot]> = brackets.iter().step_by(step).copied().collect();
    let rows = rows(capture);
    let read: Vec<Vec<(f64, Photo)>> = chosen
        .par_iter()
        .map(|photos| {
            photos
                .iter()
                .map(|shot| read(capture, shot, rows.clone()))
                .collect()
        })
        .collect::<Result<_>>()?;
    let Some((_, first)) = read.first().and_then(|photos| photos.first()) else {
        return Err(Error::input("expected photos, found none"));
    };
    let Storage::Integer { max } = first.storage else {
        return Err(
            Error::input("expected photos that hold integers, found floating point")
                .key("sensor.encoding")
                .advice("Floating-point photos are nearly always linear."),
        );
    };
    let channels = first.channels.clone();
    let sensor = &capture.sensor;
    let codes = Codes {
        black: sensor.black_level.unwrap_or(0.0),
        white: sensor.white_level.unwrap_or(f64::from(max)),
    };
    let mut seconds: Vec<f64> = read.iter().flatten().map(|(seconds, _)| *seconds).collect();
    seconds.sort_by(f64::total_cmp);
    seconds.dedup_by(|a, b| (*a / *b).ln().abs() < 1e-6);
    let number = |t: f64| {
        let at = seconds.partition_point(|s| *s < t * (1.0 - 1e-6));
        at.min(seconds.len().saturating_sub(1))
    };

    let mut patches = Vec::new();
    for (c, name) in channels.iter().enumerate() {
        let mut found = Vec::new();
        for photos in &read {
            if photos.iter().any(|(_, photo)| photo.channels != channels) {
                return Err(Error::input(format!(
                    "expected the channels {} in all photos",
                    channels.join(",")
                )));
            }
            let planes: Vec<(usize, &[f32])> = photos
                .iter()
                .filter_map(|(t, photo)| Some((number(*t), photo.values.get(c)?.as_slice())))
                .collect();
            found.extend(cut(&planes, first.size[0] as usize, codes));
        }
        let kept = spread(above_fog(found, codes.black), &seconds, codes);
        if kept.len() < 4 * curve::PIECES {
            return Err(Error::input(format!(
                "expected flat areas that two exposures show unclipped, found {} in channel {name}",
                kept.len()
            ))
            .key("sensor.encoding")
            .advice(
                "Photograph the bracket with steps of at most a few stops, or give the response.",
            ));
        }
        patches.push(kept);
    }
    let fitted = curve::fit(&patches, &seconds, codes)?;
    let rows = codes.table();
    let times: Vec<(f64, f64)> = seconds.into_iter().zip(fitted.time_factors).collect();
    Ok(Recovery {
        curve: ResponseCurve {
            linear: fitted.channels.iter().map(|g| g.linear(&rows)).collect(),
            sigma: fitted.channels.iter().map(|g| g.sigma(&rows)).collect(),
            stored: rows,
            times: times.clone(),
        },
        times,
        time_sigmas: fitted.time_sigmas,
        patches: patches.iter().map(Vec::len).sum(),
        misfit: fitted.misfit,
    })
}

/// Whether exposure times differ by enough to bend a curve by.
fn differ(photos: &[Shot]) -> bool {
    let times = || photos.iter().filter_map(|photo| photo.exposure_s);
    let (low, high) = times().fold((f64::INFINITY, 0.0_f64), |(low, high), t| {
        (low.min(t), high.max(t))
    });
    high > 1.2 * low
}

/// Rows about the cross-section, as many as [`PIXELS`] allow.
fn rows(capture: &Capture) -> Range<u32> {
    let [width, height] = capture.camera.image_size;
    let count = (PIXELS as u32 / width.max(1)).clamp(PATCH[1] as u32, height.max(1));
    let middle = capture.camera.principal_point_px[1].clamp(0.0, f64::from(height)) as u32;
    let first = middle
        .saturating_sub(count / 2)
        .min(height.saturating_sub(count));
    first..(first + count).min(height)
}

fn read(capture: &Capture, shot: &Shot, rows: Range<u32>) -> Result<(f64, Photo)> {
    let path: &Path = &capture.folder.join(&shot.file);
    let photo = photo::read(path, Some(rows))?;
    if photo.size != capture.camera.image_size {
        let [w, h] = capture.camera.image_size;
        return Err(Error::input(format!(
            "expected {w} x {h} pixels, found {} x {}",
            photo.size[0], photo.size[1]
        ))
        .file(path));
    }
    Ok((shot.exposure_s.unwrap_or(1.0), photo))
}

/// The patches of one view and channel that at least two exposures show; `planes` gives the number of each
/// exposure's time and its codes.
fn cut(planes: &[(usize, &[f32])], width: usize, codes: Codes) -> Vec<Patch> {
    let width = width.max(1);
    let height = planes.first().map_or(0, |(_, plane)| plane.len() / width);
    let mut patches = Vec::new();
    for top in (0..(height + 1).saturating_sub(PATCH[1])).step_by(PATCH[1]) {
        for left in (0..(width + 1).saturating_sub(PATCH[0])).step_by(PATCH[0]) {
            let seen: Vec<Seen> = planes
                .iter()
                .filter_map(|(time, plane)| {
                    let lines = (top..top + PATCH[1])
                        .filter_map(|y| plane.get(y * width + left..y * width + left + PATCH[0]));
                    mean(lines.flatten(), codes).map(|(code, sigma)| Seen {
                        time: *time,
                        code,
                        sigma,
                    })
                })
                .collect();
            if seen.len() >= 2 {
                patches.push(Patch { seen });
            }
        }
    }
    patches
}

/// Mean code of a patch and its σ, if it is flat and nowhere near the ends of the range.
fn mean<'a>(values: impl Iterator<Item = &'a f32>, codes: Codes) -> Option<(f64, f64)> {
    let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for &value in values {
        let value = f64::from(value);
        (n, sum, squares) = (n + 1.0, sum + value, squares + value * value);
    }
    let mean = sum / n;
    let scatter = ((squares - sum * mean) / (n - 1.0)).max(0.0);
    let margin = CLIP_MARGIN * scatter.sqrt() + 1.0;
    let usable = n >= 2.0
        && scatter.sqrt() < FLAT * (codes.white - codes.black)
        && mean - margin >= codes.black
        && mean + margin <= codes.white;
    // Where all pixels have one code, the error of rounding is theirs in common; noise of half a step
    // spreads it.
    let alone = 1.0 + (n - 1.0) * (4.0 * scatter).min(1.0);
    usable.then(|| (mean, (scatter / n + 1.0 / (12.0 * alone)).sqrt()))
}

/// Patches without what is no lighter than the darkest of the shortest exposure: a film's fog, a veil, a
/// pedestal that was not stated, where the code no longer depends on the light.
fn above_fog(patches: Vec<Patch>, black: f64) -> Vec<Patch> {
    let mut darkest: Vec<(f64, f64)> = patches
        .iter()
        .flat_map(|patch| &patch.seen)
        .filter(|seen| seen.time == 0)
        .map(|seen| (seen.code, seen.sigma))
        .collect();
    darkest.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(code, sigma)) = darkest.get(darkest.len() / 100) else {
        return patches;
    };
    let veil = FOG_MARGIN.2 * (code - black).max(0.0);
    let least = code + FOG_MARGIN.0 * sigma + FOG_MARGIN.1 + veil;
    patches
        .into_iter()
        .filter_map(|mut patch| {
            patch.seen.retain(|seen| seen.code >= least);
            (patch.seen.len() >= 2).then_some(patch)
        })
        .collect()
}

/// Patches of all brightnesses in like numbers, the flattest first.
fn spread(patches: Vec<Patch>, seconds: &[f64], codes: Codes) -> Vec<Patch> {
    // About the light of a patch, by a curve that is about right: enough to sort by.
    let light = |patch: &Patch| {
        let logs = patch.seen.iter().filter_map(|seen| {
            let v = (seen.code - codes.black) / (codes.white - codes.black);
            Some(2.2 * v.max(1e-3).ln() - seconds.get(seen.time)?.ln())
        });
        logs.sum::<f64>() / patch.seen.len().max(1) as f64
    };
    let mut bright: Vec<(f64, Patch)> = patches.into_iter().map(|p| (light(&p), p)).collect();
    bright.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (Some(low), Some(high)) = (bright.first(), bright.last()) else {
        return Vec::new();
    };
    let (low, width) = (low.0, (high.0 - low.0).max(1e-9) / BINS as f64);
    let mut bins: Vec<Vec<Patch>> = vec![Vec::new(); BINS];
    for (light, patch) in bright {
        let at = (((light - low) / width) as usize).min(BINS - 1);
        if let Some(bin) = bins.get_mut(at) {
            bin.push(patch);
        }
    }
    let roughness = |patch: &Patch| {
        patch.seen.iter().map(|seen| seen.sigma).sum::<f64>() / patch.seen.len() as f64
    };
    bins.into_iter()
        .flat_map(|mut bin| {
            bin.sort_by(|a, b| {
                let more = b.seen.len().cmp(&a.seen.len());
                more.then(roughness(a).total_cmp(&roughness(b)))
            });
            bin.truncate(PER_BIN);
            bin
        })
        .collect()
}
