//! What each way of computing a column would cost, and how wrong it could be, at one exitant angle.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::super::panels::panel_ends;
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

/// Half widths of the cut around the lobe, in lobe widths.
const CUTS: [f64; 3] = [2.0, 4.0, 8.0];
/// No more points than this on a circle.
pub const MOST_POINTS: usize = 1 << 16;

/// The magnitudes of the transfer function at one θo′, whole and with the lobe cut out.
pub struct Probe {
    pub local: LocalAngle,
    pub whole: Vec<f64>,
    /// (half width, |H_p| of the rest, ∫|lobe|)
    pub cut: Vec<(f64, Vec<f64>, f64)>,
    /// Sum of the slopes at the horizon, sr⁻¹.
    pub kink: f64,
}

/// One way at one probe with its cost (ns) and error bound.
#[derive(Clone, Copy)]
pub struct Offer {
    pub path: Path,
    pub cost: f64,
    pub bound: f64,
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
    let magnitudes = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let samples: Vec<f64> = (0..points)
            .map(|k| match transform.angle(k) {
                a if a.abs() < FRAC_PI_2 => f(a),
                _ => 0.0,
            })
            .collect();
        transform
            .analyse(&samples, highest)
            .coefficients
            .iter()
            .map(|c| TAU * c.norm())
            .collect()
    };
    let whole = magnitudes(&|a| transfer(brdf, a, local));
    let cut = CUTS
        .iter()
        .map(|w| w * brdf.lobe_width())
        .filter(|w| *w < 0.7)
        .map(|half_width| {
            let patch = Patch::new(brdf, local, half_width);
            let rest = magnitudes(&|a| transfer(brdf, a, local) - patch.lobe(brdf, a, local));
            let mut lobe = 0.0;
            let m = 64;
            for k in 0..m {
                let a = patch.from + (k as f64 + 0.5) / f64::from(m) * (patch.to - patch.from);
                lobe += patch.lobe(brdf, a, local).abs() * (patch.to - patch.from) / f64::from(m);
            }
            (half_width, rest, lobe)
        })
        .collect();
    let edge = FRAC_PI_2 - 1e-6;
    let slope = |a: f64| brdf.value(LocalAngle::radians(a), local);
    Probe {
        local,
        whole,
        cut,
        kink: slope(edge) + slope(-edge),
    }
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
    // The trapezium rule's error at the horizon's kinks: h²/12 of the slopes' sum, as a light at the
    // horizon shows it.
    let brightest = rest
        .table
        .get(channel)
        .into_iter()
        .flatten()
        .fold(0.0f64, |m, v| m.max(v.abs()))
        + rest.smooth.get(channel).map_or(0.0, |s| {
            2.0 * s.coefficients.iter().map(|c| c.norm()).sum::<f64>()
        });
    let error = |points: usize| (TAU / points as f64).powi(2) / 12.0 * probe.kink * brightest;
    let whole = order_for(light, &probe.whole, ends, 0.8 * allowed).and_then(|(order, bound)| {
        let mut points = points_for(brdf, 4 * order);
        while error(points) > 0.2 * allowed && points < MOST_POINTS {
            points *= 2;
        }
        (error(points) <= 0.2 * allowed).then(|| Offer {
            path: Path::Product { order, points },
            cost: 0.5 * points as f64 * EVALUATE + fft(points) + fft(normals),
            bound: bound + error(points),
        })
    });
    let mut all = vec![whole];

    let n = rest.table.get(channel).map_or(0, Vec::len);
    for (k, _) in CUTS.iter().enumerate() {
        let offer = probe.cut.get(k).and_then(|(half_width, transfer, lobe)| {
            if n < 2 || !rest.smooth.is_empty() {
                return None;
            }
            let (order, bound) = order_for(light, transfer, ends, 0.6 * allowed)?;
            let seen = lobe * brightest;
            let (step, quadrature) = lobe_step(rest, channel, brdf, [*lobe, seen], 0.4 * allowed)?;
            let nodes = 4.0 * half_width / step;
            let breaks = [
                -half_width - probe.local.rad(),
                half_width - probe.local.rad(),
            ];
            Some(Offer {
                path: Path::Split {
                    order,
                    half_width: *half_width,
                    step,
                },
                cost: few(order, breaks) + nodes * (EVALUATE + normals as f64 * LOOK_UP),
                bound: bound + quadrature,
            })
        });
        all.push(offer);
    }
    all
}

/// Spacing of the node pairs in the lobe, and the error that is left; the lobe's integral is given alone
/// and times the brightest light. At a kink of the light a pair may be wrong by h²/45 of the jump of its
/// slope. What a pair misses of the lobe itself is h⁴/4320 of its fourth derivative, which for the narrowest
/// model (1/(1 + x²)² in units of the lobe's width w) is 120 at the peak: (h/w)⁴/36 of the integral.
fn lobe_step(
    rest: &Lighting,
    channel: usize,
    brdf: &dyn Brdf,
    [lobe, seen]: [f64; 2],
    allowed: f64,
) -> Option<(f64, f64)> {
    let table = rest.table.get(channel)?;
    let n = table.len();
    let spacing = TAU / n as f64;
    let bend = (0..n)
        .map(|i| (table[(i + 1) % n] - 2.0 * table[i] + table[(i + n - 1) % n]).abs() / spacing)
        .fold(0.0, f64::max);
    let mut step = (brdf.lobe_width() / 4.0).min(spacing);
    for _ in 0..6 {
        // A lobe narrower than the spacing holds one kink at its full height.
        let kinks = (1.0 / spacing).max(0.5 / brdf.lobe_width());
        let error = bend * step * step / 45.0 * lobe * kinks
            + seen * (step / brdf.lobe_width()).powi(4) / 36.0;
        if error <= allowed {
            return Some((step, error));
        }
        step /= 2.0;
    }
    None
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
    }
}

/// The smallest order whose truncation error Σ_{p > P} 2|L_p||H_p| is at most `allowed`, and that error.
/// Beyond the spectra both are taken to fall with 1/p² from their envelope over the last octave.
fn order_for(light: &Series, transfer: &[f64], ends: bool, allowed: f64) -> Option<(usize, f64)> {
    let highest = transfer.len() - 1;
    let last_octave = highest / 2 + 1..=highest;
    let beyond = if ends {
        0.0
    } else {
        let l = last_octave
            .clone()
            .filter_map(|p| light.coefficients.get(p))
            .fold(0.0f64, |m, c| m.max(c.norm()));
        let h = last_octave.map(|p| transfer[p]).fold(0.0, f64::max);
        2.0 * l * h * highest as f64 / 3.0
    };
    let mut tail = beyond;
    if tail > allowed {
        return None;
    }
    for p in (1..=highest).rev() {
        let term = 2.0 * light.coefficients.get(p).map_or(0.0, |c| c.norm()) * transfer[p];
        if tail + term > allowed {
            return Some((p, tail));
        }
        tail += term;
    }
    Some((0, tail))
}
