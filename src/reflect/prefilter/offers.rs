//! What each way of computing a column would cost, and how wrong it could be, at one exitant angle.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::super::panels::panel_ends;
use super::integrals::{Integrals, bends};
use super::plan::Path;
use super::ways::{Patch, transfer};
use crate::angle::LocalAngle;
use crate::brdf::Brdf;
use crate::fourier::{CircleTransform, Series};
use crate::lighting::Lighting;

// Rough times in nanoseconds of one evaluation of a BRDF, one complex multiplication, one look-up of the
// light; only their ratios decide.
pub const EVALUATE: f64 = 30.0;
const MULTIPLY: f64 = 1.5;
const LOOK_UP: f64 = 5.0;
/// Of n log₂ n.
const TRANSFORM: f64 = 1.5;

/// Half widths of the cut around the lobe, in lobe widths; the last cut takes all.
const CUTS: [f64; 4] = [2.0, 4.0, 8.0, f64::INFINITY];
/// Times that the step of a lobe's integrals is halved.
const HALVINGS: usize = 6;
/// No more points than this on a circle.
pub const MOST_POINTS: usize = 1 << 16;

/// The magnitudes of the transfer function at one θo′, whole and with the lobe cut out.
pub struct Probe {
    pub local: LocalAngle,
    pub whole: Vec<f64>,
    /// Changes of the magnitudes when the angles at which it is sampled are halved in number, and that number.
    pub coarser: (Vec<f64>, usize),
    /// One for each width; `None` where that would be most of the half circle.
    pub cut: Vec<Option<Cut>>,
    /// Sum of the slopes at the horizon, sr⁻¹.
    pub kink: f64,
}

/// A transfer function with its lobe cut out.
pub struct Cut {
    pub half_width: f64,
    /// |H_p| of the rest.
    pub rest: Vec<f64>,
    /// Integrals of the lobe in smaller and smaller steps, radians.
    pub lobes: Vec<(f64, Integrals)>,
}

/// One way at one probe with its cost (ns) and error bound.
#[derive(Clone, Copy)]
pub struct Offer {
    pub path: Path,
    pub cost: f64,
    pub bound: f64,
    /// The part of the bound that is not truncation.
    pub quadrature: f64,
}

/// One channel of the light without its peaks, the material that it falls on, and the error that it may
/// have, W m⁻² sr⁻¹.
pub struct Task<'a> {
    pub rest: &'a Lighting,
    pub channel: usize,
    pub light: &'a Series,
    pub brdf: &'a dyn Brdf,
    pub allowed: f64,
}

pub fn probe(brdf: &dyn Brdf, local: LocalAngle, highest: usize) -> Probe {
    let points = points_for(brdf, 4 * highest);
    let transform = CircleTransform::new(points, -PI);
    let sampled = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
        (0..points)
            .map(|k| match transform.angle(k) {
                a if a.abs() < FRAC_PI_2 => f(a),
                _ => 0.0,
            })
            .collect()
    };
    let magnitudes = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let series = transform.analyse(&sampled(f), highest);
        series.coefficients.iter().map(|c| TAU * c.norm()).collect()
    };
    let whole = |a: f64| transfer(brdf, a, local);
    let samples = sampled(&whole);
    let fine = transform.analyse(&samples, highest).coefficients;
    let half: Vec<f64> = samples.iter().step_by(2).copied().collect();
    let coarse = CircleTransform::new(points / 2, -PI)
        .analyse(&half, highest)
        .coefficients;
    let changes = fine.iter().zip(&coarse).map(|(a, b)| TAU * (a - b).norm());
    let kinks = brdf.kinks(local);
    let cut = CUTS.iter().map(|w| {
        let half_width = w * brdf.lobe_width();
        let all = !half_width.is_finite();
        if half_width > 0.7 && !all {
            return None;
        }
        let half_width = half_width.min(PI);
        let patch = Patch::new(brdf, local, half_width);
        let lobe = |a: f64| patch.lobe(brdf, a, local);
        let mut step = lobe_step(brdf);
        let mut lobes: Vec<(f64, Integrals)> = Vec::new();
        while lobes.len() < HALVINGS && lobes.last().is_none_or(|l| l.1.error > 1e-15) {
            step *= 0.5;
            lobes.push((
                step,
                Integrals::new(lobe, [patch.from, patch.to], &kinks, step),
            ));
        }
        Some(Cut {
            half_width,
            rest: match all {
                true => vec![0.0; highest + 1],
                false => magnitudes(&|a| whole(a) - lobe(a)),
            },
            lobes,
        })
    });
    let edge = FRAC_PI_2 - 1e-6;
    let slope = |a: f64| brdf.value(LocalAngle::radians(a), local);
    Probe {
        local,
        coarser: (changes.collect(), points / 2),
        whole: fine.iter().map(|c| TAU * c.norm()).collect(),
        cut: cut.collect(),
        kink: slope(edge) + slope(-edge),
    }
}

/// Twice the largest step of a lobe's integrals that is tried: masking may be sharper than the lobe.
fn lobe_step(brdf: &dyn Brdf) -> f64 {
    let lobe = brdf.lobe_width();
    0.5 * lobe.min(brdf.grazing_width().max(lobe / 16.0))
}

/// Points on the circle that resolve the BRDF: three across the width of its narrowest feature leave
/// e^{−6π} of a Gaussian or rational lobe.
fn points_for(brdf: &dyn Brdf, at_least: usize) -> usize {
    let narrow = brdf.lobe_width().min(brdf.grazing_width()).max(1e-4);
    ((3.0 * TAU / narrow) as usize)
        .max(at_least)
        .max(256)
        .next_power_of_two()
        .min(MOST_POINTS)
}

/// What each way costs at a probe, in a fixed order of the ways.
pub fn offers(probe: &Probe, task: &Task, normals: usize) -> Vec<Option<Offer>> {
    let Task {
        rest,
        channel,
        light,
        brdf,
        allowed,
    } = *task;
    let ends = rest.band().is_some_and(|band| band <= light.order());
    let fft = |n: usize| TRANSFORM * n as f64 * (n as f64).log2();
    let few = |order: usize, breaks: [f64; 2]| {
        let panels = panel_ends(brdf, probe.local, order, breaks).len();
        20.0 * panels as f64 * (EVALUATE + MULTIPLY * order as f64) + fft(normals)
    };
    // The trapezium rule's error falls with h², as that of kinks does: h²/12 of the slopes' sum at the horizon, as a light
    // there shows it; and for kinks anywhere a third of what halving the number of points changed, here with a
    // factor of safety of 1.5.
    let brightest = rest
        .table
        .get(channel)
        .into_iter()
        .flatten()
        .fold(0.0f64, |m, v| m.max(v.abs()))
        + rest.smooth.get(channel).map_or(0.0, |s| {
            2.0 * s.coefficients.iter().map(|c| c.norm()).sum::<f64>()
        });
    let (changes, from) = &probe.coarser;
    let changed: f64 = changes
        .iter()
        .zip(&light.coefficients)
        .map(|(h, l)| 2.0 * h * l.norm())
        .sum();
    let error = |points: usize| {
        let at_horizon = (TAU / points as f64).powi(2) / 12.0 * probe.kink * brightest;
        at_horizon.max(0.5 * changed * (*from as f64 / points as f64).powi(2))
    };
    let whole = order_for(light, &probe.whole, ends, 0.8 * allowed).and_then(|(order, bound)| {
        // Twice what the order asks for, so that the column's own tail is seen.
        let mut points = points_for(brdf, 8 * order);
        while error(points) > 0.2 * allowed && points < MOST_POINTS {
            points *= 2;
        }
        (error(points) <= 0.2 * allowed).then(|| Offer {
            path: Path::Product { order, points },
            cost: 0.5 * points as f64 * EVALUATE + fft(points) + fft(normals),
            bound: bound + error(points),
            quadrature: error(points),
        })
    });
    let mut all = vec![whole];

    let table = rest.table.get(channel).filter(|t| t.len() > 1);
    let bends = table.map(|t| bends(t)).unwrap_or_default();
    for cut in &probe.cut {
        let offer = cut.as_ref().and_then(|cut| {
            if bends.is_empty() || !rest.smooth.is_empty() {
                return None;
            }
            let (order, bound) = order_for(light, &cut.rest, ends, 0.9 * allowed)?;
            let half_width = cut.half_width;
            let good = |l: &&(f64, Integrals)| l.1.bound(&bends) <= 0.05 * allowed;
            let (step, lobe) = cut.lobes.iter().find(good)?;
            let length = (2.0 * half_width).min(PI);
            let knots = length / TAU * bends.len() as f64;
            let nodes = length / step * 16.0;
            let breaks = [
                -half_width - probe.local.rad(),
                half_width - probe.local.rad(),
            ];
            Some(Offer {
                path: Path::Split {
                    order,
                    half_width,
                    step: *step,
                },
                cost: few(2 * order, breaks) + nodes * EVALUATE + normals as f64 * knots * LOOK_UP,
                bound: bound + lobe.bound(&bends),
                quadrature: lobe.bound(&bends),
            })
        });
        all.push(offer);
    }
    all
}

/// The same way with the more demanding of two settings.
pub fn worse(a: Offer, b: Offer) -> Offer {
    let order = a.path.order().max(b.path.order());
    let path = match (a.path, b.path) {
        (Path::Product { points: m, .. }, Path::Product { points: n, .. }) => Path::Product {
            order,
            points: m.max(n),
        },
        (
            Path::Split {
                half_width,
                step: s,
                ..
            },
            Path::Split { step: t, .. },
        ) => Path::Split {
            order,
            half_width,
            step: s.min(t),
        },
        // Offers stand in a fixed order, so that both are of one kind.
        (first, _) => first,
    };
    Offer {
        path,
        cost: a.cost.max(b.cost),
        bound: a.bound.max(b.bound),
        quadrature: a.quadrature.max(b.quadrature),
    }
}

/// The smallest order whose truncation error Σ_{p > P} 2|L_p||H_p| is at most `allowed`, and that error.
fn order_for(light: &Series, transfer: &[f64], ends: bool, allowed: f64) -> Option<(usize, f64)> {
    let beyond = if ends { 0.0 } else { beyond(light, transfer) };
    shortest(light, transfer, beyond, allowed)
}

/// Σ 2|L_p||H_p| beyond the spectra: both are taken to fall with 1/p² from their envelope over the last octave, or, for a
/// lobe that is narrower still, one of them.
pub fn beyond(light: &Series, transfer: &[f64]) -> f64 {
    let highest = transfer.len() - 1;
    let last_octave = highest / 2 + 1..=highest;
    let l = last_octave
        .clone()
        .filter_map(|p| light.coefficients.get(p))
        .fold(0.0f64, |m, c| m.max(c.norm()));
    let h = last_octave.map(|p| transfer[p]).fold(0.0, f64::max);
    let steep = transfer[highest / 4].max(transfer[highest / 4 + 1]) > 3.0 * h;
    2.0 * l * h * highest as f64 * if steep { 1.0 / 3.0 } else { 1.0 }
}

/// The smallest order whose truncation error, Σ 2|L_p||H_p| over the spectrum's end plus what is `beyond` it, is at
/// most `allowed`, and that error; `None` if not even all of it suffices.
pub fn shortest(
    light: &Series,
    transfer: &[f64],
    beyond: f64,
    allowed: f64,
) -> Option<(usize, f64)> {
    let mut tail = beyond;
    if tail > allowed {
        return None;
    }
    for p in (1..transfer.len()).rev() {
        let term = 2.0 * light.coefficients.get(p).map_or(0.0, |c| c.norm()) * transfer[p];
        if tail + term > allowed {
            return Some((p, tail));
        }
        tail += term;
    }
    Some((0, tail))
}
