//! Exposures of one view must show one picture: the shift between them is measured, and a turn or a
//! zoom, which no shift makes good, is refused.

use std::path::Path;

use nalgebra::{SMatrix, SVector};

use super::align;
use super::brackets::{by_time, shared};
use super::exposure::Exposure;
use super::merge::{Bracket, brackets_of};
use crate::error::{Error, Result};

/// The least shift that is corrected, pixels: on a 960-pixel view of a cylinder it turns a normal by
/// 0.01° at the centre, below what the outline is found to.
const LEAST_SHIFT: f64 = 0.05;

/// The largest shift that is corrected, pixels: a camera that moved further has most likely turned,
/// and sees the object from elsewhere.
const LARGEST_SHIFT: f64 = 8.0;

/// The largest displacement by a turn or a zoom that is let pass, at the picture's farthest pixel.
const LARGEST_TWIST: f64 = 0.5;

/// A shift counts if it is this many times its standard deviation.
const SIGNIFICANT: f64 = 5.0;

/// The shift that is thought possible before the photos are looked at, pixels: it settles the axis
/// along which the picture has no structure.
const POSSIBLE_SHIFT: f64 = 10.0;

/// The mean square of a gradient, in units of a pixel's noise, below which it is no structure.
const STRUCTURE: f64 = 2.0;

/// How far the brightness of two exposures may differ beside the shift (part of it), before they are
/// looked at: the error of their times that is not yet known.
const POSSIBLE_GAIN: f64 = 0.1;

/// Most pixels that are compared in the search over whole pixels.
const SEARCHED: usize = 6000;

/// Rounds of measuring and moving back; each leaves a tenth of what the one before left.
const ROUNDS: usize = 8;

/// What may be left of a shift: pixels, and beyond them parts of its standard deviation.
const SETTLED: f64 = 0.003;
const UNSETTLED: f64 = 0.1;

/// The standard deviation (pixels) beyond which a picture is said to have no structure along an axis.
const UNKNOWN: f64 = 0.5;

/// By how much a shift of whole pixels must lower the misfit (χ²) against none.
const BETTER: f64 = 50.0;

/// How an exposure lies against the view's reference exposure.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Shift {
    /// Right and down, pixels.
    pub by: [f64; 2],
    /// Standard deviation of both; large along an axis on which the picture has no structure.
    pub sigma: [f64; 2],
}

/// Shift of each exposure; `None` if all lie alike, as far as can be seen.
///
/// To first order I_long − I_short = −d · ∇I; d follows by weighted least squares over the pixels
/// that both show well, from the gradient of the expected radiance, together with a turn, a zoom, a
/// gain and an offset. Where d is found, the exposures are moved back by it and it is measured again,
/// until nothing is left; a search over whole pixels comes before, for shifts beyond the reach of the
/// gradient. `planes` must carry exposure times free of errors beyond a few percent.
///
/// # Errors
/// The exposures are shifted too far, or turned or zoomed against each other. `files` names them.
pub(super) fn between(
    exposures: &[Exposure],
    planes: &[Bracket<'_>],
    files: &[&Path],
) -> Result<Option<Vec<Shift>>> {
    let Some(first) = planes.first() else {
        return Ok(None);
    };
    let order = by_time(&first.seconds);
    let expected: Vec<Vec<f32>> = planes.iter().map(Bracket::expected).collect();
    let pairs = || {
        order
            .windows(2)
            .filter_map(|pair| Some((*pair.first()?, *pair.get(1)?)))
    };
    let fits: Vec<Fit> = pairs()
        .map(|(short, long)| fit(planes, &expected, short, long))
        .collect();
    if !fits.iter().any(|fit| fit.shift.moved() || fit.twisted()) {
        return Ok(None);
    }
    let mut total = vec![[0.0; 2]; exposures.len()];
    let mut chain = [0.0; 2];
    for ((short, long), fit) in pairs().zip(&fits) {
        let step = search(planes, &expected, (short, long), fit.shift.known());
        chain = [chain[0] + step[0], chain[1] + step[1]];
        if let Some(total) = total.get_mut(long) {
            *total = chain;
        }
    }
    let mut variance = vec![[0.0; 2]; exposures.len()];
    for round in 1..=ROUNDS {
        let moved = align::moved(exposures, &total, planes);
        let planes = brackets_of(&moved, planes);
        let expected: Vec<Vec<f32>> = planes.iter().map(Bracket::expected).collect();
        let (mut chain, mut chain_variance, mut largest) = ([0.0; 2], [0.0; 2], 0.0_f64);
        let mut twist = None;
        for (short, long) in pairs() {
            let found = fit(&planes, &expected, short, long);
            let known = found.shift.known();
            for axis in 0..2 {
                let (by, sigma) = (found.shift.by[axis], found.shift.sigma[axis]);
                chain_variance[axis] += sigma * sigma;
                if known[axis] {
                    chain[axis] += by;
                    largest = largest.max(by.abs() - UNSETTLED * sigma);
                }
            }
            if let (Some(total), Some(variance)) = (total.get_mut(long), variance.get_mut(long)) {
                *total = [total[0] + chain[0], total[1] + chain[1]];
                *variance = chain_variance;
                if total[0].hypot(total[1]) > LARGEST_SHIFT {
                    return Err(too_far(*total, files, short, long));
                }
            }
            if found.twisted() {
                twist.get_or_insert_with(|| twisted(&found, files, short, long));
            }
        }
        if largest < SETTLED || round == ROUNDS {
            match twist {
                Some(error) => return Err(error),
                None => break,
            }
        }
    }
    Ok(Some(relative(&total, &variance)))
}

/// Shifts against the exposure to which all others are nearest; what is no more than noise is 0.
fn relative(total: &[[f64; 2]], variance: &[[f64; 2]]) -> Vec<Shift> {
    let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let spread = |a: &[f64; 2]| total.iter().map(|b| distance(a, b)).sum::<f64>();
    let reference = total
        .iter()
        .zip(variance)
        .min_by(|a, b| spread(a.0).total_cmp(&spread(b.0)));
    let Some((origin, base)) = reference else {
        return Vec::new();
    };
    total
        .iter()
        .zip(variance)
        .map(|(t, v)| {
            let mut shift = Shift::default();
            for axis in 0..2 {
                let by = t[axis] - origin[axis];
                shift.sigma[axis] = (v[axis] - base[axis]).abs().sqrt();
                if by.abs() > 3.0 * shift.sigma[axis] && by.abs() > 0.01 {
                    shift.by[axis] = by;
                }
            }
            shift
        })
        .collect()
}

/// RAW exposures are not moved: what lies between the sites of a colour is not known well enough.
pub(super) fn at_sites(shifts: &[Shift], files: &[&Path]) -> Error {
    let worst = shifts.iter().enumerate().max_by(|a, b| {
        let length = |s: &Shift| s.by[0].hypot(s.by[1]);
        length(a.1).total_cmp(&length(b.1))
    });
    let (at, [dx, dy]) = worst.map_or((0, [0.0; 2]), |(i, shift)| (i, shift.by));
    Error::input(format!(
        "expected exposures of one picture, found \"{}\" moved by ({dx:.2}, {dy:.2}) pixels against the view's others",
        name(files, at)
    ))
    .advice("Photos that hold a sensor's own values are not moved back: leave it out, or give demosaiced photos.")
}

fn name<'a>(files: &[&'a Path], i: usize) -> std::path::Display<'a> {
    files.get(i).copied().unwrap_or(Path::new("")).display()
}

fn too_far([dx, dy]: [f64; 2], files: &[&Path], short: usize, long: usize) -> Error {
    Error::input(format!(
        "expected exposures of one picture, found \"{}\" moved by ({dx:.1}, {dy:.1}) pixels \
         against \"{}\"",
        name(files, long),
        name(files, short)
    ))
    .advice(format!(
        "Up to {LARGEST_SHIFT} pixels are moved back; beyond, the view itself has changed: leave one of the two photos out."
    ))
}

fn twisted(found: &Fit, files: &[&Path], short: usize, long: usize) -> Error {
    Error::input(format!(
        "expected exposures of one picture, found \"{}\" turned by {:.3} degrees and zoomed by {:.3} % \
         against \"{}\", which moves its farthest pixels by {:.2}",
        name(files, long),
        found.turn.to_degrees(),
        100.0 * found.zoom,
        name(files, short),
        found.twist
    ))
    .advice("The camera turned, or was focused anew, within the bracket: only shifts are corrected. Leave one of the two photos out.")
}

/// What moves the long exposure against the short one.
#[derive(Default)]
struct Fit {
    shift: Shift,
    /// Turn (radians) and zoom, and the displacement that both make at the farthest pixel, with its σ.
    turn: f64,
    zoom: f64,
    twist: f64,
    twist_sigma: f64,
}

impl Fit {
    fn twisted(&self) -> bool {
        self.twist > LARGEST_TWIST && self.twist > SIGNIFICANT * self.twist_sigma
    }
}

impl Shift {
    /// Whether the picture shows a shift along either axis.
    fn known(&self) -> [bool; 2] {
        self.sigma.map(|sigma| sigma < UNKNOWN)
    }

    /// Whether it is large enough to matter, beyond doubt.
    fn moved(&self) -> bool {
        let mut axes = self.by.iter().zip(self.sigma);
        axes.any(|(d, sigma)| d.abs() > LEAST_SHIFT && d.abs() > SIGNIFICANT * sigma)
    }
}

/// Unknowns: shift right and down, turn and zoom (as displacement at the farthest pixel), gain and offset.
const UNKNOWNS: usize = 6;

/// Terms of which the unknowns' are made: gx, gy, gx x, gx y, gy x, gy y, brightness, 1.
const TERMS: usize = 8;

/// The terms that each unknown is the factor of.
const MADE_OF: [[f64; TERMS]; UNKNOWNS] = [
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
];

/// The terms that each axis' gradient stands in.
const OF_AXIS: [[usize; 3]; 2] = [[0, 2, 3], [1, 4, 5]];

fn fit(planes: &[Bracket<'_>], expected: &[Vec<f32>], short: usize, long: usize) -> Fit {
    let mut products = SMatrix::<f64, TERMS, TERMS>::zeros();
    let mut differences = SVector::<f64, TERMS>::zeros();
    let (mut squares, mut count, mut noise) = (0.0, 0.0, 0.0);
    let width = planes.first().map_or(1, |plane| plane.width.max(1));
    let height = expected.first().map_or(0, Vec::len) / width;
    let half = [width as f64 / 2.0, height as f64 / 2.0];
    let far = half[0].hypot(half[1]);
    for (plane, expected) in planes.iter().zip(expected) {
        let largest = expected.iter().filter(|e| e.is_finite());
        let largest = largest.fold(f64::MIN_POSITIVE, |a, &e| a.max(e.into()));
        for (i, [s, l], variance) in shared(plane, expected, short, long) {
            let Some([gx, gy]) = gradient(expected, width, i) else {
                continue;
            };
            let variance =
                [(variance[0], s), (variance[1], l)].map(|(v, m)| v / (m.reach * m.reach));
            // Gradients that are no more than noise would pull the shift towards 0.
            if gx * gx + gy * gy < 4.0 * variance[1] {
                continue;
            }
            let weight = 1.0 / (variance[0] + variance[1]);
            let difference = s.signal / s.reach - l.signal / l.reach;
            let x = ((i % width) as f64 + 0.5 - half[0]) / far;
            let y = ((i / width) as f64 + 0.5 - half[1]) / far;
            let brightness = expected.get(i).map_or(0.0, |&e| f64::from(e));
            let terms = SVector::<f64, TERMS>::from([
                gx,
                gy,
                gx * x,
                gx * y,
                gy * x,
                gy * y,
                brightness,
                largest,
            ]);
            products += weight * terms * terms.transpose();
            differences += weight * difference * terms;
            squares += weight * difference * difference;
            noise += weight * variance[1];
            count += 1.0;
        }
    }
    // Along an axis without structure the gradient is noise, which says nothing of a shift.
    let mut made_of = SMatrix::<f64, UNKNOWNS, TERMS>::from_fn(|i, k| MADE_OF[i][k]);
    for (axis, terms) in OF_AXIS.into_iter().enumerate() {
        if products[(axis, axis)] < STRUCTURE * noise {
            for term in terms {
                made_of.column_mut(term).fill(0.0);
            }
        }
    }
    let mut normal = made_of * products * made_of.transpose();
    let right = made_of * differences;
    let possible = [POSSIBLE_SHIFT; 4].into_iter().chain([POSSIBLE_GAIN; 2]);
    for (i, possible) in possible.enumerate() {
        normal[(i, i)] += 1.0 / (possible * possible);
    }
    let Some(solver) = normal.cholesky() else {
        return Fit::default();
    };
    let found = solver.solve(&right);
    // Noise that is larger than stated, or not stated at all, shows in what is left.
    let left = (squares - found.dot(&right)) / f64::max(count - UNKNOWNS as f64, 1.0);
    let covariance = solver.inverse() * left.max(1.0);
    let sigma = |i: usize| covariance[(i, i)].sqrt();
    Fit {
        shift: Shift {
            by: [found[0], found[1]],
            sigma: [sigma(0), sigma(1)],
        },
        turn: found[2] / far,
        zoom: found[3] / far,
        twist: found[2].hypot(found[3]),
        twist_sigma: sigma(2).hypot(sigma(3)),
    }
}

/// The shift of the long exposure in whole pixels, by the least mean square of what is left; `along`
/// says along which axes there is structure.
fn search(
    planes: &[Bracket<'_>],
    expected: &[Vec<f32>],
    (short, long): (usize, usize),
    along: [bool; 2],
) -> [f64; 2] {
    let [reach_x, reach_y] = along.map(|axis| if axis { LARGEST_SHIFT as i64 + 1 } else { 0 });
    let mut samples = Vec::new();
    for (plane, expected) in planes.iter().zip(expected) {
        let width = plane.width.max(1) as i64;
        let edges: Vec<usize> = shared(plane, expected, short, long)
            .filter(|(i, [s, _], variance)| {
                gradient(expected, plane.width, *i).is_some_and(|[gx, gy]| {
                    gx * gx + gy * gy > 4.0 * variance[0] / (s.reach * s.reach)
                })
            })
            .map(|(i, ..)| i)
            .collect();
        let skip = (edges.len() * planes.len() / SEARCHED).max(1);
        for &i in edges.iter().step_by(skip) {
            let Some(a) = plane.measurements(i).find(|m| m.exposure == short) else {
                continue;
            };
            samples.push((plane, width, i as i64, a));
        }
    }
    let (mut best, mut unmoved) = (([0.0; 2], f64::INFINITY), f64::INFINITY);
    for dy in -reach_y..=reach_y {
        for dx in -reach_x..=reach_x {
            let (mut sum, mut count) = (0.0, 0usize);
            for (plane, width, i, a) in &samples {
                let column = i % width + dx;
                let at = i + dy * width + dx;
                if !(0..*width).contains(&column) || at < 0 {
                    continue;
                }
                let there = plane.measurements(at as usize).find(|m| m.exposure == long);
                let Some(b) = there else { continue };
                let noise = |m: &super::merge::Measurement| {
                    let read = plane.noise.map_or(0.0, |n| n.variance(m.signal));
                    (m.rounding + read) / (m.reach * m.reach)
                };
                let difference = a.signal / a.reach - b.signal / b.reach;
                sum += difference * difference / (noise(a) + noise(&b)).max(f64::MIN_POSITIVE);
                count += 1;
            }
            if count * 2 < samples.len() || count == 0 {
                continue;
            }
            let misfit = sum / count as f64;
            if misfit < best.1 {
                best = ([dx as f64, dy as f64], misfit);
            }
            if (dx, dy) == (0, 0) {
                unmoved = misfit;
            }
        }
    }
    // Relative to the least misfit, for the noise may be larger than stated.
    if (unmoved / best.1 - 1.0) * samples.len() as f64 > BETTER {
        best.0
    } else {
        [0.0; 2]
    }
}

/// Central differences of the expected radiance at a pixel, per pixel; none at the edges.
fn gradient(expected: &[f32], width: usize, pixel: usize) -> Option<[f64; 2]> {
    let column = pixel % width.max(1);
    if column < 2 || column + 2 >= width {
        return None;
    }
    let at = |i: usize| {
        expected
            .get(i)
            .copied()
            .filter(|v| v.is_finite())
            .map(f64::from)
    };
    // At the sites of colour filters the neighbours of the same colour are two pixels away.
    let along = |stride: usize| {
        [1, 2].into_iter().find_map(|steps| {
            let (after, before) = (
                at(pixel + steps * stride),
                pixel.checked_sub(steps * stride),
            );
            Some((after? - at(before?)?) / (2.0 * steps as f64))
        })
    };
    Some([along(1)?, along(width)?])
}
