//! What exposures of one view say of each other: errors of the exposure times, and the noise.

use std::path::Path;

use nalgebra::{DMatrix, DVector};

use super::merge::{Bracket, Measurement};
use super::noise::Noise;
use crate::error::{Error, Result};

/// How far stated exposure times are off, as a standard deviation of their logarithm: shutters
/// jitter by a few percent at worst, and the round numbers on the dial differ from the powers of
/// two that cameras keep by up to 7 %.
const TIME_ERROR: f64 = 0.03;

/// A ratio of exposure times that is off by more than this (log) is no jitter but a mistake.
const TIME_MISTAKE: f64 = 0.2;

/// The least number of pixels that two exposures share before they are compared.
const SHARED: f64 = 64.0;

/// Part of its light by which the neighbours of a pixel in an even area differ.
const FLAT: f32 = 0.05;

/// Mean square difference of two exposures, in units of the noise, up to which noise explains it; pixels that
/// count as independent in what is beyond.
const MISFIT: f64 = 1.3;
const INDEPENDENT: f64 = 200.0;

/// Pixels of similar brightness from which one variance is taken.
const BIN: usize = 512;

/// Factors by which the stated exposure times are to be multiplied, one per exposure, from the
/// ratios of the pixels that two successive exposures both show well. Their common factor cannot
/// be seen: the mean of their logarithms is that of `thought`, the factors that are expected.
///
/// # Errors
/// A ratio is so far off that the times must be wrong or swapped. `files` names the photos.
pub(super) fn time_factors(
    planes: &[Bracket<'_>],
    files: &[&Path],
    thought: &[f64],
) -> Result<Vec<f64>> {
    let seconds = planes
        .first()
        .map(|p| p.seconds.clone())
        .unwrap_or_default();
    let n = seconds.len();
    let expected: Vec<Vec<f32>> = planes.iter().map(Bracket::expected).collect();
    let order = by_time(&seconds);
    let mut matrix = DMatrix::<f64>::identity(n, n) / (TIME_ERROR * TIME_ERROR);
    let expected_log = |k: usize| thought.get(k).map_or(0.0, |f| f.ln());
    let mut right = DVector::from_fn(n, |k, _| expected_log(k) / (TIME_ERROR * TIME_ERROR));
    for pair in order.windows(2) {
        let &[short, long] = pair else { continue };
        let Some((ratio, sigma)) = log_ratio(planes, &expected, short, long) else {
            continue;
        };
        if ratio.abs() > TIME_MISTAKE + 4.0 * sigma {
            let name = |i: usize| {
                files
                    .get(i)
                    .map(|f| f.display().to_string())
                    .unwrap_or_default()
            };
            return Err(Error::input(format!(
                "expected \"{}\" to show the same light per second as \"{}\", found {:.2} times the \
                 light per second",
                name(long),
                name(short),
                ratio.exp()
            ))
            .advice(
                "Check exposure_s of both (swapped?), the black level and the encoding; \
                 automatic gain must be off.",
            ));
        }
        let weight = 1.0 / (sigma * sigma);
        for (i, j, sign) in [
            (short, short, 1.0),
            (long, long, 1.0),
            (short, long, -1.0),
            (long, short, -1.0),
        ] {
            matrix[(i, j)] += sign * weight;
        }
        right[long] += weight * ratio;
        right[short] -= weight * ratio;
    }
    Ok(match matrix.cholesky() {
        Some(solver) => solver.solve(&right).iter().map(|c| c.exp()).collect(),
        None => vec![1.0; n],
    })
}

/// Indices of the exposures, the shortest first.
pub(super) fn by_time(seconds: &[f64]) -> Vec<usize> {
    let mut order: Vec<(usize, f64)> = seconds.iter().copied().enumerate().collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    order.into_iter().map(|(i, _)| i).collect()
}

/// Log of the ratio (long over short) of the radiances that two exposures show, and its σ; `None`
/// if they share too little.
///
/// Both sums run over the same pixels, chosen by their expected signal, so that noise does not
/// choose them and the ratio of the sums is unbiased.
fn log_ratio(
    planes: &[Bracket<'_>],
    expected: &[Vec<f32>],
    short: usize,
    long: usize,
) -> Option<(f64, f64)> {
    let over = |flat: bool| ratio_over(planes, expected, short, long, flat);
    // Beside edges, what blurs or sharpens stored codes changes the ratio; where noise is known codes are mostly linear.
    match planes.iter().all(|plane| plane.noise.is_some()) {
        true => over(false),
        false => over(true).or_else(|| over(false)),
    }
}

/// [`log_ratio`] over all pixels, or those that are `flat`: like their neighbours.
fn ratio_over(
    planes: &[Bracket<'_>],
    expected: &[Vec<f32>],
    short: usize,
    long: usize,
    flat: bool,
) -> Option<(f64, f64)> {
    let mut sums = [0.0; 2];
    let mut variances = [0.0; 2];
    // The same ratio by each channel alone: its logarithm, its variance, and the light it rests on.
    let mut channels: Vec<(f64, f64, f64)> = Vec::new();
    // Products of what both show, weighted by the noise: what no common ratio explains.
    let (mut ss, mut sl, mut ll) = (0.0, 0.0, 0.0);
    let mut count = 0_u32;
    for (plane, expected) in planes.iter().zip(expected) {
        let before = (sums, variances);
        for (i, measured, variance) in shared(plane, expected, short, long) {
            if flat && !is_flat(expected, i, plane.width) {
                continue;
            }
            count += 1;
            let shown = measured.map(|m| m.signal / m.reach);
            let noise = [0, 1].map(|k: usize| variance[k] / measured[k].reach.powi(2));
            for k in 0..2 {
                sums[k] += shown[k];
                variances[k] += noise[k];
            }
            let weight = 1.0 / (noise[0] + noise[1]).max(f64::MIN_POSITIVE);
            ss += weight * shown[0] * shown[0];
            sl += weight * shown[0] * shown[1];
            ll += weight * shown[1] * shown[1];
        }
        let own = [0, 1].map(|k: usize| sums[k] - before.0[k]);
        if own[0] > 0.0 && own[1] > 0.0 {
            let variance = (0..2).map(|k| (variances[k] - before.1[k]) / (own[k] * own[k]));
            channels.push(((own[1] / own[0]).ln(), variance.sum(), own[0]));
        }
    }
    if f64::from(count) < SHARED || sums[0] <= 0.0 || sums[1] <= 0.0 {
        return None;
    }
    let variance = variances[0] / (sums[0] * sums[0]) + variances[1] / (sums[1] * sums[1]);
    let ratio = sums[1] / sums[0];
    let misfit = (ll - 2.0 * ratio * sl + ratio * ratio * ss) / f64::from(count);
    // Where a curve is a little wrong or something moved, neighbours err together; where the noise is not
    // known, all of the difference may be that.
    let together = 1.0 + f64::from(count) / INDEPENDENT;
    let excess = match planes.iter().all(|plane| plane.noise.is_some()) {
        true => 1.0 + (misfit - MISFIT).max(0.0) * together,
        false => misfit.max(1.0) * together,
    };
    let variance = variance * excess + disagreement(&channels, ratio.ln());
    // Nothing about a camera is stable to better than a part in ten thousand.
    Some((ratio.ln(), (variance + 1e-8).sqrt()))
}

/// Whether a pixel's neighbours show its light to a part of [`FLAT`].
fn is_flat(expected: &[f32], pixel: usize, width: usize) -> bool {
    let Some(&here) = expected.get(pixel) else {
        return false;
    };
    let like = |at: Option<usize>| {
        let there = at.and_then(|at| expected.get(at));
        there.is_none_or(|there| (there - here).abs() <= FLAT * here)
    };
    like(pixel.checked_sub(1))
        && like(pixel.checked_add(1))
        && like(pixel.checked_sub(width))
        && like(pixel.checked_add(width))
}

/// Variance of a logarithm of light's ratio that its channels show by their scatter about it, beyond their noise: one
/// shutter exposes all, so what differs is the curves' error. `channels`: logarithm, variance, light.
fn disagreement(channels: &[(f64, f64, f64)], ratio: f64) -> f64 {
    let total: f64 = channels.iter().map(|c| c.2).sum();
    let (mut scatter, mut shares) = (0.0, 0.0);
    for (log, variance, light) in channels {
        let share = light / total;
        scatter += share * ((log - ratio).powi(2) - variance).max(0.0);
        shares += share * share;
    }
    // That of the mean of 1/Σ share² channels, from as many less one.
    let freedom = 1.0 / shares - 1.0;
    if freedom > 1e-3 {
        scatter / freedom
    } else {
        0.0
    }
}

/// Pixels that two exposures both show well, by their expected signal: their index, measurements
/// and expected variances (rounding only if the noise is not known).
pub(super) fn shared<'a>(
    plane: &'a Bracket<'_>,
    expected: &'a [f32],
    short: usize,
    long: usize,
) -> impl Iterator<Item = (usize, [Measurement; 2], [f64; 2])> {
    let white = plane
        .exposures
        .get(long)
        .and_then(|e| e.levels.get(plane.channel))
        .map_or(f64::INFINITY, |levels| levels.white);
    let largest = expected
        .iter()
        .filter(|e| e.is_finite())
        .fold(0.0, |a: f64, &e| a.max(e.into()));
    expected.iter().enumerate().filter_map(move |(i, &e)| {
        let [s, l] = both(plane, i, short, long)?;
        let signal = [s, l].map(|m| f64::from(e) * m.reach);
        let variance = [(s, signal[0]), (l, signal[1])]
            .map(|(m, p)| m.rounding + plane.noise.map_or(0.0, |n| n.variance(p)));
        let usable = match plane.noise {
            Some(_) => {
                signal[1] + 4.0 * variance[1].sqrt() < white
                    && signal[0] > 10.0 * variance[0].sqrt()
            }
            None => {
                let brightest = white.min(largest * l.reach);
                signal[1] < 0.9 * brightest && signal[0] > 0.01 * brightest
            }
        };
        usable.then_some((i, [s, l], variance))
    })
}

/// A pixel's measurements in two exposures, if it is unclipped in both.
fn both(plane: &Bracket<'_>, pixel: usize, short: usize, long: usize) -> Option<[Measurement; 2]> {
    let mut found = [None; 2];
    for m in plane.measurements(pixel) {
        if m.exposure == short {
            found[0] = Some(m);
        } else if m.exposure == long {
            found[1] = Some(m);
        }
    }
    Some([found[0]?, found[1]?])
}

/// Shot and read noise from the scatter between successive exposures, `None` if they share too
/// little.
///
/// With q the ratio of their reaches (short over long), d = s_short − q s_long has the mean 0 and
/// the variance shot · p (1 + q) + read · (1 + q²) where p is the expected signal of the short
/// one: a straight line in p for each pair, fitted over bins of p.
pub(super) fn noise(plane: &Bracket<'_>) -> Option<Noise> {
    let expected = plane.expected();
    let order = by_time(&plane.seconds);
    // Normal equations of the weighted fit of [shot, read].
    let (mut aa, mut ab, mut bb, mut ay, mut by, mut bins) = (0.0, 0.0, 0.0, 0.0, 0.0, 0);
    for pair in order.windows(2) {
        let &[short, long] = pair else { continue };
        let white = plane.exposures.get(long)?.levels.get(plane.channel)?.white;
        let mut samples: Vec<[f64; 4]> = expected
            .iter()
            .enumerate()
            .filter_map(|(i, &e)| {
                let [s, l] = both(plane, i, short, long)?;
                let q = s.reach / l.reach;
                let kept = f64::from(e) * l.reach < 0.9 * white;
                kept.then_some([
                    f64::from(e) * s.reach,
                    s.signal - q * l.signal,
                    s.rounding + q * q * l.rounding,
                    q,
                ])
            })
            .collect();
        samples.sort_by(|a, b| a[0].total_cmp(&b[0]));
        for bin in samples.chunks_exact(BIN) {
            let mean = |k: usize| bin.iter().map(|s| s[k]).sum::<f64>() / BIN as f64;
            let (p, q) = (mean(0).max(0.0), mean(3));
            let total = scatter(bin.iter().map(|s| s[1]));
            let excess = total - mean(2);
            let (a, b) = (p * (1.0 + q), 1.0 + q * q);
            // The variance of a variance is proportional to its square.
            let weight = 1.0 / (total * total);
            if weight.is_finite() {
                aa += weight * a * a;
                ab += weight * a * b;
                bb += weight * b * b;
                ay += weight * a * excess;
                by += weight * b * excess;
                bins += 1;
            }
        }
    }
    if bins < 4 {
        return None;
    }
    let determinant = aa * bb - ab * ab;
    let both = (
        (bb * ay - ab * by) / determinant,
        (aa * by - ab * ay) / determinant,
    );
    let (shot, read) = match both {
        (shot, read) if shot >= 0.0 && read >= 0.0 => (shot, read),
        (shot, _) if shot >= 0.0 => ((ay / aa).max(0.0), 0.0),
        _ => (0.0, (by / bb).max(0.0)),
    };
    (shot.is_finite() && read.is_finite()).then_some(Noise { shot, read })
}

/// Variance without the far outliers that moved edges and dust make: values beyond four standard
/// deviations are dropped, three times over.
fn scatter(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let moments = |limit: Option<(f64, f64)>| {
        let kept = values
            .clone()
            .filter(|x| limit.is_none_or(|(mean, sd)| (x - mean).abs() <= 4.0 * sd));
        let (n, sum, squares) =
            kept.fold((0.0, 0.0, 0.0), |(n, s, q), x| (n + 1.0, s + x, q + x * x));
        let mean = sum / n;
        (
            mean,
            (squares / n - mean * mean).max(0.0) * n / (n - 1.0_f64).max(1.0),
        )
    };
    let mut limit = None;
    for _ in 0..3 {
        let (mean, variance) = moments(limit);
        limit = Some((mean, variance.sqrt()));
    }
    moments(limit).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_that_disagree_make_a_ratio_uncertain() {
        // Three channels of like light: the variance of their mean, by the textbook.
        let logs = [-0.06, -0.08, -0.19];
        let mean = -0.11;
        let textbook = logs.iter().map(|l| f64::powi(l - mean, 2)).sum::<f64>() / 2.0 / 3.0;
        let channels = logs.map(|log| (log, 1e-12, 5.0));
        assert!((disagreement(&channels, mean) / textbook - 1.0).abs() < 1e-6);
        // What noise explains is no disagreement, and one channel cannot disagree.
        let noisy = logs.map(|log| (log, 0.01, 5.0));
        assert_eq!(disagreement(&noisy, mean), 0.0);
        assert_eq!(disagreement(&channels[..1], -0.06), 0.0);
        assert_eq!(disagreement(&[], 0.0), 0.0);
    }
}
