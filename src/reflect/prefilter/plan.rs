//! The choice of the way: predicted error against predicted cost, for several splits of the light and of
//! the BRDF.
//!
//! Error and cost are computed at nine exitant angles, dense towards grazing; a column between two of
//! them takes the more demanding setting of both.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use super::super::product::sufficient_order;
use super::offers::{EVALUATE, MOST_POINTS, Offer, Probe, Task, offers, probe, worse};
use super::peaks::{Parted, Stretch, part};
use crate::angle::LocalAngle;
use crate::brdf::Material;
use crate::error::{Error, Result};
use crate::fourier::Series;
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

impl Choice {
    /// Smallest and largest order over the columns.
    pub fn orders(&self) -> (usize, usize) {
        let orders = || self.columns.iter().map(|c| c.path.order());
        (orders().min().unwrap_or(0), orders().max().unwrap_or(0))
    }

    /// Number of coefficients of all columns together (p ≥ 0).
    pub fn coefficients(&self) -> usize {
        self.columns.iter().map(|c| c.path.order() + 1).sum()
    }

    /// Number of columns whose lobe is integrated.
    pub fn split_columns(&self) -> usize {
        let split = |c: &&ColumnPlan| matches!(c.path, Path::Split { .. });
        self.columns.iter().filter(split).count()
    }
}

/// A way of taking the light apart that was weighed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Considered {
    /// Peaks evaluated directly.
    pub peaks: usize,
    /// Predicted time on one core, seconds, all channels; `None` if the error cannot be kept this way.
    pub cost: Option<f64>,
}

/// A plan for all channels.
pub struct Plan {
    pub rest: Lighting,
    pub stretches: Vec<Stretch>,
    /// Per channel the spectrum of `rest`, as long as any path needs.
    pub spectra: Vec<Series>,
    pub choices: Vec<Choice>,
    pub considered: Vec<Considered>,
}

/// Levels, in means of the table, above which the light is taken as a peak; `None` takes nothing.
const PEAK_LEVELS: [Option<f64>; 4] = [None, Some(100.0), Some(20.0), Some(4.0)];
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

    let setting = Setting {
        lighting,
        material,
        grid,
        places: &places,
        probes: &probes,
        levels: &levels,
        highest,
        tolerance,
    };
    let mut considered: Vec<Considered> = Vec::new();
    let mut best: Option<(f64, Plan)> = None;
    for parted in parted {
        let peaks = parted.peaks;
        if considered.last().is_some_and(|c| c.peaks == peaks) {
            continue;
        }
        let plan = setting.arrange(parted);
        let cost = plan
            .as_ref()
            .map(|p| p.choices.iter().map(|c| c.cost).sum::<f64>());
        considered.push(Considered { peaks, cost });
        if let (Some(plan), Some(cost)) = (plan, cost)
            && best.as_ref().is_none_or(|(least, _)| cost < *least)
        {
            best = Some((cost, plan));
        }
    }
    let best = best.map(|(_, plan)| Plan { considered, ..plan });
    best.ok_or_else(|| {
        Error::failed(format!(
            "no way of prefiltering keeps the error below {tolerance} of the mean light field"
        ))
        .advice("Ask for a larger tolerance, or give bright small lights as sources.")
    })
}

/// What all ways of taking the light apart have in common.
struct Setting<'a> {
    lighting: &'a Lighting,
    material: &'a Material,
    grid: Grid,
    places: &'a [usize],
    probes: &'a [Vec<Probe>],
    levels: &'a [f64],
    highest: usize,
    tolerance: f64,
}

impl Setting<'_> {
    /// The cheapest plan for a lighting taken apart in one way; `None` if the error cannot be kept.
    fn arrange(&self, parted: Parted) -> Option<Plan> {
        let stretched: usize = parted.stretches.iter().map(Stretch::nodes).sum();
        let nodes = self.lighting.sources.len() + stretched;
        let direct = (nodes * self.grid.normals / 2) as f64 * EVALUATE;
        let mut spectra = Vec::new();
        let mut choices = Vec::new();
        for (c, brdf) in self.material.brdfs.iter().enumerate() {
            let light = parted.rest.density_series(c, self.highest);
            let level = self.levels[c];
            let task = Task {
                rest: &parted.rest,
                channel: c,
                light: &light,
                brdf: brdf.as_ref(),
                allowed: self.tolerance * level,
            };
            let columns = columns(self.grid, self.places, &self.probes[c], &task)?;
            let bound = columns.iter().fold(0.0f64, |m, o| m.max(o.0.bound));
            choices.push(Choice {
                channel: self.material.channels[c].clone(),
                level,
                peaks: parted.peaks,
                nodes,
                peak_share: parted.share,
                bound: if level > 0.0 { bound / level } else { 0.0 },
                cost: columns.iter().map(|o| o.1 + direct).sum::<f64>() * 1e-9,
                columns: columns.into_iter().map(|o| o.0).collect(),
            });
            spectra.push(light);
        }
        Some(Plan {
            rest: parted.rest,
            stretches: parted.stretches,
            spectra,
            choices,
            considered: Vec::new(),
        })
    }
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
