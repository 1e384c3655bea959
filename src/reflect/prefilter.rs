//! Environment prefiltering (\[RH01\] §5.4): the light field of a planar environment, each part of it by
//! the cheapest way that keeps a stated error.
//!
//! * The *smooth part* of the light and of the BRDF needs few Fourier coefficients (eq. 14).
//! * *Peaks* of the light, such as suns, have no end of frequencies; truncated they ring. They are
//!   evaluated directly, as the sources that they are, and neither smear nor ring.
//! * A *lobe* much narrower than the light's detail needs more coefficients than a short integral over
//!   the lobe needs nodes.
//!
//! `plan` chooses; this module carries the choice out.

mod check;
mod file;
mod integrals;
mod offers;
mod peaks;
mod plan;
mod strip;
mod viewpoint;
mod ways;

use rayon::prelude::*;

use super::{check, from_sources};
use crate::angle::{LocalAngle, NormalAngle};
use crate::brdf::{Brdf, Material};
use crate::error::{Error, Result};
use crate::fourier::CircleTransform;
use crate::grid::Grid;
use crate::lighting::Lighting;

pub use check::Checked;
use integrals::bends;
use offers::Task;
use peaks::Stretch;
pub use plan::{Choice, ColumnPlan, Considered, Path, Prediction, Ways};
pub use viewpoint::{Stage, Viewpoint};

/// What is asked of a prefiltering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Largest error allowed anywhere in a channel, as a fraction of the mean light field that the
    /// light makes without its peaks (so that a sun does not excuse errors in the shade).
    pub tolerance: f64,
    /// The ways that may be chosen.
    pub ways: Ways,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            tolerance: 1e-3,
            ways: Ways::Cheapest,
        }
    }
}

/// A light field over (α, θo′), ready to be looked up.
#[derive(Clone, Debug)]
pub struct Prefiltered {
    /// The cells of the table.
    pub grid: Grid,
    /// Channel names.
    pub channels: Vec<String>,
    /// B at the cell centres, \[channel\]\[cell\], W m⁻² sr⁻¹.
    pub value: Vec<Vec<f64>>,
    /// How each channel was computed.
    pub choices: Vec<Choice>,
    /// The ways of taking light and BRDF apart that were weighed against each other.
    pub considered: Vec<Considered>,
    /// The part of `value` that is smooth enough to be interpolated.
    smooth: Vec<Vec<f64>>,
    /// Peaks of the light, evaluated directly as its sources are.
    stretches: Vec<Stretch>,
    /// The whole light: its sources, and all of it where a mirror shows it.
    lighting: Lighting,
    material: Material,
}

/// Prefilters `lighting` by `material` on `grid`.
///
/// # Errors
/// If lighting and material do not have the same channels, a mirror sees a directional source, the
/// tolerance is not above 0, or no way reaches it.
pub fn prefilter(
    lighting: &Lighting,
    material: &Material,
    grid: Grid,
    options: &Options,
) -> Result<Prefiltered> {
    check(lighting, material)?;
    if options.tolerance.is_nan() || options.tolerance <= 0.0 || grid.is_empty() {
        return Err(Error::input(format!(
            "expected a tolerance above 0 and a grid with cells, found {} on {} × {}",
            options.tolerance, grid.normals, grid.locals
        )));
    }
    // The columns' own spectra may ask for more than was predicted from those at other angles.
    let mut planned = *options;
    for _ in 0..3 {
        let plan = plan::plan(lighting, material, grid, &planned)?;
        let made = carry_out(plan, lighting, material, grid, options);
        let most = options.tolerance * (1.0 + 1e-9);
        if made.choices.iter().all(|c| c.bound <= most) {
            return Ok(made);
        }
        planned.tolerance *= 0.5;
    }
    Err(plan::not_kept(options.tolerance))
}

fn carry_out(
    plan: plan::Plan,
    lighting: &Lighting,
    material: &Material,
    grid: Grid,
    options: &Options,
) -> Prefiltered {
    let transform = CircleTransform::new(grid.normals, grid.normal(0).rad());
    let rows = |columns: &[Vec<f64>]| -> Vec<f64> {
        let mut cells = Vec::with_capacity(grid.len());
        for i in 0..grid.normals {
            cells.extend(columns.iter().map(|column| column[i]));
        }
        cells
    };
    let mut smooth = Vec::new();
    let mut value = Vec::new();
    let mut choices = plan.choices;
    for ((c, brdf), choice) in material.brdfs.iter().enumerate().zip(&mut choices) {
        let task = Task {
            rest: &plan.rest,
            channel: c,
            light: &plan.spectra[c],
            brdf: brdf.as_ref(),
            allowed: options.tolerance * choice.level,
        };
        let bends = bends(plan.rest.table.get(c).map_or(&[], Vec::as_slice));
        let (columns, plans): (Vec<Vec<f64>>, Vec<ColumnPlan>) = plan.columns[c]
            .par_iter()
            .map(|column| ways::column(&task, column, &bends, &transform))
            .unzip();
        let bound = plans.iter().fold(0.0f64, |m, p| m.max(p.bound));
        if choice.level > 0.0 {
            choice.bound = bound / choice.level;
        }
        choice.columns = plans;
        let direct: Vec<Vec<f64>> = (0..grid.locals)
            .into_par_iter()
            .map(|j| {
                let at = |i| {
                    let (normal, local) = (grid.normal(i), grid.local(j));
                    direct_value(&plan.stretches, lighting, c, brdf.as_ref(), normal, local)
                };
                (0..grid.normals).map(at).collect()
            })
            .collect();
        let (smooth_part, direct_part) = (rows(&columns), rows(&direct));
        let both = smooth_part.iter().zip(&direct_part);
        value.push(both.map(|(a, b)| a + b).collect());
        smooth.push(smooth_part);
    }
    Prefiltered {
        grid,
        channels: lighting.channels.clone(),
        value,
        choices,
        considered: plan.considered,
        smooth,
        stretches: plan.stretches,
        lighting: lighting.clone(),
        material: material.clone(),
    }
}

/// Sources and peaks through the BRDF, and the whole light in the mirror.
fn direct_value(
    stretches: &[Stretch],
    lighting: &Lighting,
    channel: usize,
    brdf: &dyn Brdf,
    normal: NormalAngle,
    local: LocalAngle,
) -> f64 {
    let mut sum = from_sources(lighting, channel, brdf, normal, local);
    if !stretches.is_empty() {
        let kinks = brdf.kinks(local);
        for stretch in stretches {
            sum += stretch.reflected(channel, brdf, normal, local, &kinks);
        }
    }
    let mirror = brdf.mirror(local);
    if mirror != 0.0 {
        sum += mirror * lighting.density(channel, normal + -local);
    }
    sum
}

#[cfg(test)]
mod tests;
