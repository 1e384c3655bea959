//! The choice of the way: predicted error against predicted cost, for several splits of the light and of
//! the BRDF.
//!
//! Error and cost are predicted at nine exitant angles, dense towards grazing; a column between two of them takes the
//! more demanding setting of both. When it is computed, its own spectrum decides on its order and states its error.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use super::super::product::sufficient_order;
use super::Options;
use super::offers::{EVALUATE, MOST_POINTS, Offer, Probe, Task, beyond, offers, probe, worse};
use super::peaks::{Parted, Stretch, part};
use super::ways::Column;
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
    /// the mirror direction, and an integral over the lobe that is exact in the light.
    Split {
        /// The largest frequency of the smooth part.
        order: usize,
        /// Half the length of the integral, radians.
        half_width: f64,
        /// Step in which the lobe's first and second integrals are tabulated, radians.
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

/// Which ways of computing a column may be chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ways {
    /// For every column the cheaper one.
    #[default]
    Cheapest,
    /// Coefficients only.
    Product,
    /// The lobe by an integral, the rest by coefficients.
    Split,
}

impl Ways {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Cheapest, Self::Product, Self::Split];

    fn allows(self, path: Path) -> bool {
        match self {
            Self::Cheapest => true,
            Self::Product => matches!(path, Path::Product { .. }),
            Self::Split => matches!(path, Path::Split { .. }),
        }
    }
}

/// A way of taking light and BRDF apart that was weighed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Considered {
    /// Peaks evaluated directly.
    pub peaks: usize,
    /// How the rest is computed.
    pub ways: Ways,
    /// What it takes; `None` if the error cannot be kept this way.
    pub prediction: Option<Prediction>,
}

/// Predicted effort and error of all channels together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Time on one core, seconds.
    pub cost: f64,
    /// Coefficients of all columns (p ≥ 0).
    pub coefficients: usize,
    /// Largest error as a fraction of its channel's level.
    pub bound: f64,
}

impl Prediction {
    fn of(choices: &[Choice]) -> Self {
        Self {
            cost: choices.iter().map(|c| c.cost).sum(),
            coefficients: choices.iter().map(Choice::coefficients).sum(),
            bound: choices.iter().fold(0.0, |m, c| m.max(c.bound)),
        }
    }
}

/// A plan for all channels.
pub struct Plan {
    pub rest: Lighting,
    pub stretches: Vec<Stretch>,
    /// Per channel the spectrum of `rest`, as long as any path needs.
    pub spectra: Vec<Series>,
    pub choices: Vec<Choice>,
    /// What the columns of each channel are computed from.
    pub columns: Vec<Vec<Column>>,
    pub considered: Vec<Considered>,
}

/// Levels, in means of the table, above which the light is taken as a peak; `None` takes nothing.
const PEAK_LEVELS: [Option<f64>; 4] = [None, Some(100.0), Some(20.0), Some(4.0)];

/// The cheapest plan of those that `options` allow.
///
/// # Errors
/// If none keeps the tolerance.
pub fn plan(
    lighting: &Lighting,
    material: &Material,
    grid: Grid,
    options: &Options,
) -> Result<Plan> {
    let tolerance = options.tolerance;
    let parted: Vec<Parted> = PEAK_LEVELS
        .iter()
        .map(|&level| part(lighting, level))
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
        let arranged = setting.arrange(parted);
        for ways in Ways::ALL {
            let made = setting.choices(&arranged, ways);
            let (choices, columns): (Option<Vec<Choice>>, Vec<Vec<Column>>) = match made {
                Some(made) => {
                    let (choices, columns) = made.into_iter().unzip();
                    (Some(choices), columns)
                }
                None => (None, Vec::new()),
            };
            let prediction = choices.as_deref().map(Prediction::of);
            considered.push(Considered {
                peaks,
                ways,
                prediction,
            });
            let (Some(choices), Some(Prediction { cost, .. })) = (choices, prediction) else {
                continue;
            };
            if ways == options.ways && best.as_ref().is_none_or(|(least, _)| cost < *least) {
                let plan = Plan {
                    rest: arranged.parted.rest.clone(),
                    stretches: arranged.parted.stretches.clone(),
                    spectra: arranged.spectra.clone(),
                    choices,
                    columns,
                    considered: Vec::new(),
                };
                best = Some((cost, plan));
            }
        }
    }
    let best = best.map(|(_, plan)| Plan { considered, ..plan });
    best.ok_or_else(|| not_kept(tolerance))
}

/// No way is good enough.
pub fn not_kept(tolerance: f64) -> Error {
    Error::failed(format!(
        "no way of prefiltering keeps the error below {tolerance} of the mean light field"
    ))
    .advice("Ask for a larger tolerance, or give bright small lights as sources.")
}

/// Share of the allowed error that the peaks' integrals may have.
const PEAKS_SHARE: f64 = 0.05;

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

/// A lighting taken apart in one way, and what each column's ways would take.
struct Arranged {
    parted: Parted,
    /// Per channel.
    spectra: Vec<Series>,
    /// \[channel\]\[probe\]\[way\], in a fixed order of the ways.
    offers: Vec<Vec<Vec<Option<Offer>>>>,
    /// Per channel a bound of the error of the peaks' integrals, W m⁻² sr⁻¹.
    peaks: Vec<f64>,
    /// Evaluations of the BRDF per cell for sources and peaks.
    nodes: usize,
}

impl Setting<'_> {
    fn arrange(&self, mut parted: Parted) -> Arranged {
        let mut peaks = Vec::new();
        for (c, brdf) in self.material.brdfs.iter().enumerate() {
            let allowed = PEAKS_SHARE * self.tolerance * self.levels[c];
            let locals = self.probes[c].iter().map(|p| p.local);
            peaks.push(parted.resolve(c, brdf.as_ref(), locals, allowed));
        }
        let stretched: usize = parted.stretches.iter().map(Stretch::nodes).sum();
        let mut spectra = Vec::new();
        let mut all = Vec::new();
        for (c, brdf) in self.material.brdfs.iter().enumerate() {
            let light = parted.rest.density_series(c, self.highest);
            let task = Task {
                rest: &parted.rest,
                channel: c,
                light: &light,
                brdf: brdf.as_ref(),
                allowed: (1.0 - PEAKS_SHARE) * self.tolerance * self.levels[c],
            };
            let probes = self.probes[c].iter();
            all.push(
                probes
                    .map(|p| offers(p, &task, self.grid.normals))
                    .collect(),
            );
            spectra.push(light);
        }
        Arranged {
            nodes: self.lighting.sources.len() + stretched,
            peaks,
            parted,
            spectra,
            offers: all,
        }
    }

    /// The cheapest columns of all channels; `None` if the error cannot be kept.
    fn choices(&self, arranged: &Arranged, ways: Ways) -> Option<Vec<(Choice, Vec<Column>)>> {
        let direct = (arranged.nodes * self.grid.normals / 2) as f64 * EVALUATE;
        let one = |(c, channel): (usize, &String)| {
            let level = self.levels[c];
            let peaks = arranged.peaks[c];
            if peaks > PEAKS_SHARE * self.tolerance * level {
                return None;
            }
            let columns = self.columns(arranged, c, ways)?;
            let bound = columns.iter().fold(0.0f64, |m, o| m.max(o.0.plan.bound)) + peaks;
            let choice = Choice {
                channel: channel.clone(),
                level,
                peaks: arranged.parted.peaks,
                nodes: arranged.nodes,
                peak_share: arranged.parted.share,
                bound: if level > 0.0 { bound / level } else { 0.0 },
                cost: columns.iter().map(|o| o.1 + direct).sum::<f64>() * 1e-9,
                columns: columns.iter().map(|o| o.0.plan).collect(),
            };
            Some((choice, columns.into_iter().map(|o| o.0).collect()))
        };
        self.material.channels.iter().enumerate().map(one).collect()
    }

    /// The cheapest way for every column of a channel with its cost (ns), from what the probes offer; `None` if
    /// there is one without any.
    fn columns(&self, arranged: &Arranged, c: usize, ways: Ways) -> Option<Vec<(Column, f64)>> {
        let (offers, places) = (&arranged.offers[c], self.places);
        let peaks = arranged.peaks[c];
        let light = &arranged.spectra[c];
        let band = arranged.parted.rest.band();
        let ends = band.is_some_and(|band| band <= light.order());
        let one = |j: usize| {
            let right = places.partition_point(|&p| p < j).min(places.len() - 1);
            let left = right.saturating_sub(usize::from(places[right] != j));
            let combined = offers[left].iter().zip(&offers[right]).enumerate();
            let (way, best) = combined
                .filter_map(|(way, (a, b))| Some((way, worse((*a)?, (*b)?))))
                .filter(|(_, offer)| ways.allows(offer.path))
                .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))?;
            let order = best.path.order();
            let seen = match best.path {
                Path::Product { points, .. } => points / 4,
                Path::Split { .. } => 2 * order + 8,
            }
            .min(self.highest);
            let spectrum = |probe: &Probe| -> f64 {
                let cut = way.checked_sub(1).and_then(|k| probe.cut.get(k)?.as_ref());
                let transfer = cut.map_or(&probe.whole, |cut| &cut.rest);
                let after = light.coefficients.iter().zip(transfer).skip(seen + 1);
                let tail: f64 = after.map(|(l, h)| 2.0 * l.norm() * h).sum();
                tail + if ends { 0.0 } else { beyond(light, transfer) }
            };
            let beyond = [left, right].map(|k| spectrum(&self.probes[c][k]));
            let column = Column {
                plan: ColumnPlan {
                    local: self.grid.local(j),
                    path: best.path,
                    bound: best.bound + peaks,
                },
                quadrature: best.quadrature + peaks,
                seen,
                beyond: beyond[0].max(beyond[1]),
            };
            Some((column, best.cost))
        };
        (0..self.grid.locals).map(one).collect()
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
