//! The choice of the way: predicted error against predicted cost, at a few exitant angles, for
//! several splits of the light and of the BRDF.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use num_complex::Complex64;
use rayon::prelude::*;

use super::super::panels::{for_each_node, panel_ends};
use super::super::product::sufficient_order;
use super::peaks::{Parted, Stretch, part};
use crate::angle::{LocalAngle, NormalAngle};
use crate::brdf::{Brdf, Material};
use crate::error::{Error, Result};
use crate::fourier::{CircleTransform, Series};
use crate::grid::Grid;
use crate::lighting::Lighting;

/// How one column of equal θo′ is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Path {
    /// `order` coefficients, from the FFT of the transfer function at `points` regular angles.
    Product {
        /// The largest frequency.
        order: usize,
        /// Angles on the circle.
        points: usize,
    },
    /// `order` coefficients for what is left when the lobe is cut out within `half_width` (radians) of
    /// the mirror direction, and an integral over the lobe with nodes `step` apart.
    Split {
        /// The largest frequency of the smooth part.
        order: usize,
        /// Half the length of the integral, radians.
        half_width: f64,
        /// Spacing of pairs of nodes, radians.
        step: f64,
    },
}

impl Path {
    /// The largest frequency of the light that it uses.
    pub fn order(self) -> usize {
        match self {
            Self::Product { order, .. } | Self::Split { order, .. } => order,
        }
    }
}

/// The way and what it promises at one θo′.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColumnPlan {
    /// θo′ of the column.
    pub local: LocalAngle,
    /// How it is computed.
    pub path: Path,
    /// Bound of the error in this column, W m⁻² sr⁻¹: Σ 2|L_p H_p| over what is left out, and the
    /// quadratures' own.
    pub bound: f64,
}

/// How one channel is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Channel name.
    pub channel: String,
    /// The mean light field without peaks, W m⁻² sr⁻¹, to which the tolerance refers.
    pub level: f64,
    /// Peaks of the light that are evaluated directly.
    pub peaks: usize,
    /// Evaluations of the BRDF that those peaks and the given sources take per cell.
    pub nodes: usize,
    /// Fraction of the total irradiance in the peaks.
    pub peak_share: f64,
    /// Largest predicted error as a fraction of `level`.
    pub bound: f64,
    /// Predicted time of this channel on one core, seconds.
    pub cost: f64,
    /// The columns of the grid, in its order.
    pub columns: Vec<ColumnPlan>,
}

/// A plan for all channels.
pub struct Plan {
    pub rest: Lighting,
    pub stretches: Vec<Stretch>,
    /// Per channel the spectrum of `rest`, as long as any path needs.
    pub spectra: Vec<Series>,
    pub choices: Vec<Choice>,
}

// Nanoseconds on a desktop core of 2024; only their ratios decide.
const EVALUATE: f64 = 30.0;
const MULTIPLY: f64 = 1.5;
const LOOK_UP: f64 = 5.0;
/// Of n log₂ n.
const TRANSFORM: f64 = 1.5;

/// Levels, in means of the table, above which the light is taken as a peak; `None` takes nothing.
const PEAK_LEVELS: [Option<f64>; 4] = [None, Some(100.0), Some(20.0), Some(4.0)];
/// Half widths of the cut around the lobe, in lobe widths.
const CUTS: [f64; 3] = [2.0, 4.0, 8.0];
/// No more points than this on a circle.
const MOST_POINTS: usize = 1 << 16;

/// The magnitudes of the transfer function at one θo′, whole and with the lobe cut out.
struct Probe {
    local: LocalAngle,
    whole: Vec<f64>,
    /// (half width, |H_p| of the rest, ∫|lobe|)
    cut: Vec<(f64, Vec<f64>, f64)>,
    /// Sum of the slopes at the horizon, sr⁻¹.
    kink: f64,
}

/// One way at one probe with its cost (ns) and error bound.
#[derive(Clone, Copy)]
struct Offer {
    path: Path,
    cost: f64,
    bound: f64,
}

pub fn plan(lighting: &Lighting, material: &Material, grid: Grid, tolerance: f64) -> Result<Plan> {
    let lobe = material
        .brdfs
        .iter()
        .map(|b| b.lobe_width())
        .fold(1.0, f64::min);
    let parted: Vec<Parted> = PEAK_LEVELS
        .iter()
        .map(|&level| part(lighting, level, lobe))
        .collect();
    let highest = sufficient_order(lighting).clamp(1, MOST_POINTS / 8);
    let places = probe_places(grid);
    let probes: Vec<Vec<Probe>> = material
        .brdfs
        .iter()
        .map(|brdf| {
            places
                .par_iter()
                .map(|&j| probe(brdf.as_ref(), grid.local(j), highest))
                .collect()
        })
        .collect();

    // What the light makes without its peaks; if it is nothing but peaks, what it makes.
    let levels: Vec<f64> = probes
        .iter()
        .enumerate()
        .map(|(c, probes)| {
            let white = probes.iter().map(|p| p.whole[0]).sum::<f64>() / probes.len() as f64;
            let l0 = |l: &Lighting| l.total_irradiance(c) / TAU * white;
            let quiet = parted.last().map_or(0.0, |p| l0(&p.rest));
            if quiet.abs() > 1e-9 * l0(lighting).abs() {
                quiet.abs()
            } else {
                l0(lighting).abs()
            }
        })
        .collect();

    let best = parted
        .into_iter()
        .filter_map(|parted| {
            let spectra: Vec<Series> = (0..material.brdfs.len())
                .map(|c| parted.rest.density_series(c, highest))
                .collect();
            let mut choices = Vec::new();
            for (c, brdf) in material.brdfs.iter().enumerate() {
                let task = Task {
                    rest: &parted.rest,
                    channel: c,
                    light: &spectra[c],
                    brdf: brdf.as_ref(),
                    allowed: tolerance * levels[c],
                };
                let columns = columns(grid, &places, &probes[c], &task)?;
                let stretched: usize = parted.stretches.iter().map(Stretch::nodes).sum();
                let nodes = lighting.sources.len() + stretched;
                let direct = (nodes * grid.normals / 2) as f64 * EVALUATE;
                let cost: f64 = columns.iter().map(|o| o.1 + direct).sum();
                let bound = columns.iter().fold(0.0f64, |m, o| m.max(o.0.bound));
                choices.push(Choice {
                    channel: material.channels[c].clone(),
                    level: levels[c],
                    peaks: parted.peaks,
                    nodes,
                    peak_share: parted.share,
                    bound: if levels[c] > 0.0 {
                        bound / levels[c]
                    } else {
                        0.0
                    },
                    cost: cost * 1e-9,
                    columns: columns.into_iter().map(|o| o.0).collect(),
                });
            }
            Some(Plan {
                rest: parted.rest,
                stretches: parted.stretches,
                spectra,
                choices,
            })
        })
        .min_by(|a, b| {
            let cost = |p: &Plan| p.choices.iter().map(|c| c.cost).sum::<f64>();
            cost(a).total_cmp(&cost(b))
        });
    best.ok_or_else(|| {
        Error::failed(format!(
            "no way of prefiltering keeps the error below {tolerance} of the mean light field"
        ))
        .advice("Ask for a larger tolerance, or give bright small lights as sources.")
    })
}

/// Columns at which the transfer function is looked at: dense towards grazing, where it changes.
fn probe_places(grid: Grid) -> Vec<usize> {
    const PROBES: usize = 9;
    let last = grid.locals - 1;
    let mut places: Vec<usize> = (0..PROBES)
        .map(|k| {
            let x = -(PI * k as f64 / (PROBES - 1) as f64).cos();
            ((x + 1.0) / 2.0 * last as f64).round() as usize
        })
        .collect();
    places.dedup();
    places
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

fn probe(brdf: &dyn Brdf, local: LocalAngle, highest: usize) -> Probe {
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

/// ρ̂ without the mirror's delta.
fn transfer(brdf: &dyn Brdf, incident: f64, local: LocalAngle) -> f64 {
    brdf.value(LocalAngle::radians(incident), local) * incident.cos().max(0.0)
}

/// The cubic that replaces ρ̂ where the lobe is cut out; it meets ρ̂ in value and slope at both ends (in
/// value only at the horizon, where the lobe's own kink must leave with the lobe).
struct Patch {
    from: f64,
    to: f64,
    values: [f64; 2],
    slopes: [f64; 2],
}

impl Patch {
    fn new(brdf: &dyn Brdf, local: LocalAngle, half_width: f64) -> Self {
        let centre = -local.rad();
        let from = (centre - half_width).max(-FRAC_PI_2);
        let to = (centre + half_width).min(FRAC_PI_2);
        let h = 1e-3 * half_width;
        let f = |a: f64| transfer(brdf, a, local);
        let slope = |a: f64| match a.abs() + h > FRAC_PI_2 {
            true => 0.0,
            false => (f(a + h) - f(a - h)) / (2.0 * h),
        };
        Self {
            from,
            to,
            values: [f(from), f(to)],
            slopes: [slope(from), slope(to)],
        }
    }

    /// ρ̂ minus the patch; 0 outside.
    fn lobe(&self, brdf: &dyn Brdf, incident: f64, local: LocalAngle) -> f64 {
        if incident <= self.from || incident >= self.to {
            return 0.0;
        }
        let length = self.to - self.from;
        let t = (incident - self.from) / length;
        let s = 1.0 - t;
        let patch = s * s * (1.0 + 2.0 * t) * self.values[0]
            + t * t * (1.0 + 2.0 * s) * self.values[1]
            + length * (s * s * t * self.slopes[0] - t * t * s * self.slopes[1]);
        transfer(brdf, incident, local) - patch
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

/// One channel of the light without its peaks, the material that it falls on, and the error that it may
/// have, W m⁻² sr⁻¹.
struct Task<'a> {
    rest: &'a Lighting,
    channel: usize,
    light: &'a Series,
    brdf: &'a dyn Brdf,
    allowed: f64,
}

/// The cheapest way for every column with its cost (ns); `None` if there is one without any.
fn columns(
    grid: Grid,
    places: &[usize],
    probes: &[Probe],
    task: &Task,
) -> Option<Vec<(ColumnPlan, f64)>> {
    let offers: Vec<Vec<Option<Offer>>> = probes
        .iter()
        .map(|probe| offers(probe, task, grid.normals))
        .collect();
    (0..grid.locals)
        .map(|j| {
            let right = places.partition_point(|&p| p < j).min(places.len() - 1);
            let left = right.saturating_sub(usize::from(places[right] != j));
            let combined = offers[left].iter().zip(&offers[right]);
            let best = combined
                .filter_map(|(a, b)| Some(worse((*a)?, (*b)?)))
                .min_by(|a, b| a.cost.total_cmp(&b.cost))?;
            let plan = ColumnPlan {
                local: grid.local(j),
                path: best.path,
                bound: best.bound,
            };
            Some((plan, best.cost))
        })
        .collect()
}

/// The same way with the more demanding of two settings.
fn worse(a: Offer, b: Offer) -> Offer {
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

/// What each way costs at a probe, in a fixed order of the ways.
fn offers(probe: &Probe, task: &Task, normals: usize) -> Vec<Option<Offer>> {
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
            let (step, quadrature) = lobe_step(rest, channel, brdf, *lobe, 0.4 * allowed)?;
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

/// Spacing of the node pairs in the lobe, and the error that is left: four pairs over a lobe width
/// resolve the lobe; at each kink of the light a pair may be wrong by h²/48 of the jump of its slope.
fn lobe_step(
    rest: &Lighting,
    channel: usize,
    brdf: &dyn Brdf,
    lobe: f64,
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
        let error = bend * step * step / 48.0 * lobe * kinks;
        if error <= allowed {
            return Some((step, error));
        }
        step /= 2.0;
    }
    None
}

/// B(α, θo′) of one column at the transform's angles, without sources, peaks and mirror.
pub fn column(
    rest: &Lighting,
    channel: usize,
    light: &Series,
    brdf: &dyn Brdf,
    plan: &ColumnPlan,
    transform: &CircleTransform,
) -> Vec<f64> {
    let local = plan.local;
    let product = |row: Vec<Complex64>| {
        let coefficients = light.coefficients.iter().zip(row).map(|(l, h)| l * h);
        transform.synthesise(&Series {
            coefficients: coefficients.collect(),
        })
    };
    match plan.path {
        Path::Product { order, points } => {
            let circle = CircleTransform::new(points, -PI);
            let samples: Vec<f64> = (0..points)
                .map(|k| match circle.angle(k) {
                    a if a.abs() < FRAC_PI_2 => transfer(brdf, a, local),
                    _ => 0.0,
                })
                .collect();
            let series = circle.analyse(&samples, order);
            product(series.coefficients.iter().map(|c| TAU * c.conj()).collect())
        }
        Path::Split {
            order,
            half_width,
            step,
        } => {
            let patch = Patch::new(brdf, local, half_width);
            let mut column = product(row(brdf, local, order, &patch));
            let pairs = ((patch.to - patch.from) / step).ceil().max(1.0);
            let width = (patch.to - patch.from) / pairs;
            let nodes: Vec<(f64, f64)> = (0..2 * pairs as usize)
                .map(|k| {
                    // The two Gauss nodes of each step.
                    let side = if k % 2 == 0 { -1.0 } else { 1.0 };
                    let middle = patch.from + ((k / 2) as f64 + 0.5) * width;
                    let a = middle + side * width / (2.0 * 3f64.sqrt());
                    (a, width / 2.0 * patch.lobe(brdf, a, local))
                })
                .collect();
            for (i, b) in column.iter_mut().enumerate() {
                let normal = NormalAngle::radians(transform.angle(i));
                for &(a, weight) in &nodes {
                    *b += weight * rest.density(channel, normal + LocalAngle::radians(a));
                }
            }
            column
        }
    }
}

/// H_p for 0 ≤ p ≤ `order`, by quadrature, of what a patch leaves of ρ̂.
fn row(brdf: &dyn Brdf, local: LocalAngle, order: usize, patch: &Patch) -> Vec<Complex64> {
    let ends = panel_ends(brdf, local, order, [patch.from, patch.to]);
    let mut row = vec![Complex64::ZERO; order + 1];
    for_each_node(&ends, |angle, weight| {
        let value = transfer(brdf, angle, local) - patch.lobe(brdf, angle, local);
        let step = Complex64::cis(angle);
        let mut turn = Complex64::new(weight * value, 0.0);
        for h in &mut row {
            *h += turn;
            turn *= step;
        }
    });
    row
}
