//! The light field by the angular integral (eq. 4): slow, and the oracle of everything faster.
//!
//! Shares no code with the product form: its own quadrature, in the angle and not in frequency.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use rayon::prelude::*;

use super::panels::{for_each_node, panel_ends};
use super::{check, from_sources};
use crate::angle::{LocalAngle, NormalAngle, WorldAngle};
use crate::brdf::{Brdf, Material};
use crate::error::Result;
use crate::grid::Grid;
use crate::lighting::Lighting;

/// B(α, θo′) = ∫ L(α + θi′) ρ̂(θi′, θo′) dθi′ in one channel: sources and mirror exactly, the rest by
/// Gauss–Legendre panels that end wherever the integrand has a kink and shrink towards the lobe.
pub fn value(
    lighting: &Lighting,
    channel: usize,
    brdf: &dyn Brdf,
    normal: NormalAngle,
    local: LocalAngle,
) -> f64 {
    let mut sum = from_sources(lighting, channel, brdf, normal, local);
    if lighting.table.is_empty() && lighting.smooth.is_empty() {
        return sum;
    }
    let order = lighting.smooth.get(channel).map_or(0, |s| s.order());
    let knots = table_knots(lighting, channel, normal);
    let ends = panel_ends(brdf, local, order, knots);
    for_each_node(&ends, |angle, weight| {
        let incident = LocalAngle::radians(angle);
        let transfer = brdf.value(incident, local) * angle.cos();
        if transfer != 0.0 {
            sum += weight * transfer * lighting.density(channel, normal + incident);
        }
    });
    let mirror = brdf.mirror(local);
    if mirror != 0.0 {
        sum += mirror * lighting.density(channel, normal + -local);
    }
    sum
}

/// The angular integral as plainly as it can be said: one term for each of `terms` regular directions (those
/// of the light's own table if it has as many values). As good as the lobe is wide against their spacing.
pub fn sum(
    lighting: &Lighting,
    channel: usize,
    brdf: &dyn Brdf,
    normal: NormalAngle,
    local: LocalAngle,
    terms: usize,
) -> f64 {
    let step = TAU / terms as f64;
    let mut sum = from_sources(lighting, channel, brdf, normal, local);
    for k in 0..terms {
        let theta = WorldAngle::radians(-PI + k as f64 * step);
        let incident = theta - normal;
        let cosine = incident.visible_cosine();
        if cosine > 0.0 {
            let l = lighting.density(channel, theta);
            sum += step * l * brdf.value(incident, local) * cosine;
        }
    }
    sum
}

/// The whole light field, \[channel\]\[cell of `grid`\], W m⁻² sr⁻¹.
///
/// # Errors
/// If lighting and material do not have the same channels, or a mirror sees a directional source.
pub fn on_grid(lighting: &Lighting, material: &Material, grid: Grid) -> Result<Vec<Vec<f64>>> {
    check(lighting, material)?;
    let field = |(c, brdf): (usize, &std::sync::Arc<dyn Brdf>)| {
        (0..grid.len())
            .into_par_iter()
            .map(|cell| {
                let (i, j) = (cell / grid.locals, cell % grid.locals);
                value(lighting, c, brdf.as_ref(), grid.normal(i), grid.local(j))
            })
            .collect()
    };
    Ok(material.brdfs.iter().enumerate().map(field).collect())
}

/// Local angles at which the light has a kink: a table is linear between its values.
fn table_knots(lighting: &Lighting, channel: usize, normal: NormalAngle) -> Vec<f64> {
    let Some(n) = lighting.table.get(channel).map(Vec::len).filter(|n| *n > 1) else {
        return Vec::new();
    };
    let step = TAU / n as f64;
    let first = ((normal.rad() - FRAC_PI_2 + PI) / step).ceil() as i64;
    let last = ((normal.rad() + FRAC_PI_2 + PI) / step).floor() as i64;
    (first..=last)
        .map(|k| k as f64 * step - PI - normal.rad())
        .collect()
}
