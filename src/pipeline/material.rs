//! The recovered BRDF slice on its way to the products: as a table, as a material, and as fitted models.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use super::fit::DIFFUSE;
use super::recipe::RecoveryOptions;
use crate::angle::LocalAngle;
use crate::brdf::fit::{BrdfModels, FitOptions, fit_table};
use crate::brdf::{Axis, Brdf, Material, MeasuredSlice, SliceTable};
use crate::error::{Error, Result};
use crate::light_field::LightField;
use crate::recover::Status;
use crate::recover::brdf::{BrdfEstimate, Options, Regularisation};
use crate::recover::lighting;

/// Highest frequency of the slice's spectrum that the recovery computes.
const MOST_ORDER: usize = 90;

/// Directions on the half circle at which a known material is looked at.
const SAMPLED: usize = 36;

/// The recipe's `[recovery]` for a BRDF.
///
/// # Errors
/// For choices that a BRDF's recovery does not have.
pub fn options(recovery: &RecoveryOptions) -> Result<Options> {
    if !recovery.reciprocal {
        return Err(
            Error::input("a BRDF is recovered as reciprocal, found reciprocal = false")
                .key("recovery.reciprocal")
                .advice(
                    "Leave the key out. A surface that breaks reciprocity shows in the residual.",
                ),
        );
    }
    let regularisation = match recovery.regularisation {
        lighting::Regularisation::Evidence => Regularisation::Evidence,
        lighting::Regularisation::Gcv => Regularisation::Gcv,
        lighting::Regularisation::None => Regularisation::None,
        lighting::Regularisation::Fixed(s) if s > 0.0 => Regularisation::Factor(s),
        lighting::Regularisation::Fixed(_) => Regularisation::None,
        lighting::Regularisation::Truncate => {
            return Err(Error::input(
                "expected auto, evidence, gcv, none or a number for a BRDF, found \"truncate\"",
            )
            .key("recovery.regularisation")
            .advice("A lobe within the half circle has no last frequency to stop at."));
        }
    };
    let defaults = Options::default();
    Ok(Options {
        order: recovery
            .band
            .map_or(defaults.order, |band| band.min(MOST_ORDER)),
        regularisation,
        non_negative: recovery.non_negative,
        ..defaults
    })
}

/// Whether the known values of a slice, weighted by their cosines, are all about the same.
pub fn is_diffuse(estimate: &BrdfEstimate, channel: usize) -> bool {
    let (mut weight, mut sum, mut square) = (0.0, 0.0, 0.0);
    for i in 0..estimate.size {
        for j in 0..estimate.size {
            if let Some((rho, _)) = estimate.rho(channel, i, j) {
                let w = estimate.angle(i).cos() * estimate.angle(j).cos();
                weight += w;
                sum += w * rho;
                square += w * rho * rho;
            }
        }
    }
    let mean = sum / weight;
    let scatter = square / weight - mean * mean;
    weight > 0.0 && scatter <= (DIFFUSE * mean).powi(2)
}

/// Whether each place looks about the same from all sides: the scatter over θo′ of the light field at each normal, relative to all of it. A slice
/// that was found with its light may be wrong by half where it is diffuse; this is seen whatever is found.
///
/// A Lambertian cylinder gives up to 0.004 by its noise, with grooves 0.02 and with lobes of 6 % 0.13; no other surface of our trials less than 0.22.
pub fn looks_diffuse(field: &LightField, channel: usize) -> bool {
    let (mut scatter, mut power) = (0.0, 0.0);
    for i in 0..field.grid.normals {
        let (mut count, mut sum, mut square) = (0.0, 0.0, 0.0);
        for j in 0..field.grid.locals {
            let cell = field.grid.index(i, j);
            if field.weight[channel][cell] > 0.0 {
                let b = f64::from(field.mean[channel][cell]);
                count += 1.0;
                sum += b;
                square += b * b;
            }
        }
        if count > 1.0 {
            scatter += square - sum * sum / count;
            power += square;
        }
    }
    power > 0.0 && scatter <= DIFFUSE * DIFFUSE * power
}

/// The same of a known material.
pub fn reflects_diffusely(material: &Material, channel: usize) -> bool {
    let Some(brdf) = material.brdfs.get(channel) else {
        return false;
    };
    let angle = |k: usize| {
        LocalAngle::radians(((k as f64 + 0.5) / SAMPLED as f64 - 0.5) * std::f64::consts::PI)
    };
    let (mut weight, mut sum, mut square) = (0.0, 0.0, 0.0);
    for i in (0..SAMPLED).map(angle) {
        if brdf.mirror(i) != 0.0 {
            return false;
        }
        for j in (0..SAMPLED).map(angle) {
            let (rho, w) = (brdf.value(i, j), i.visible_cosine() * j.visible_cosine());
            weight += w;
            sum += w * rho;
            square += w * rho * rho;
        }
    }
    let mean = sum / weight;
    square / weight - mean * mean <= (DIFFUSE * mean).powi(2)
}

/// The content of `brdf.csv`: ρ and σ, NaN where the slice is indeterminate. `stride` takes every such cell, in the
/// middle of its neighbours.
pub fn table(estimate: &BrdfEstimate, stride: usize) -> SliceTable {
    let stride = stride.max(1);
    let axis = Axis {
        count: estimate.size / stride,
        inclusive: false,
    };
    let layer = |c: usize, pick: &dyn Fn((f64, f64)) -> f64| -> Vec<f64> {
        (0..axis.count * axis.count)
            .map(|cell| {
                let at = |k: usize| k * stride + stride / 2;
                estimate
                    .rho(c, at(cell / axis.count), at(cell % axis.count))
                    .map_or(f64::NAN, pick)
            })
            .collect()
    };
    let all = 0..estimate.channels.len();
    SliceTable {
        channels: estimate.channels.clone(),
        incident: axis,
        exitant: axis,
        rho: all.clone().map(|c| layer(c, &|v| v.0)).collect(),
        sigma: all.map(|c| layer(c, &|v| v.1)).collect(),
    }
}

/// The whole slice as a BRDF that can be evaluated, with what the prior makes of cells that nobody saw.
///
/// # Errors
/// If the slice's arrays do not have its size.
pub fn as_material(estimate: &BrdfEstimate) -> Result<Material> {
    let axis = Axis {
        count: estimate.size,
        inclusive: false,
    };
    let n = estimate.size;
    let angle = |k: usize| -FRAC_PI_2 + (k as f64 + 0.5) * PI / n as f64;
    let brdfs = estimate
        .slices
        .iter()
        .map(|slice| {
            let rho: Vec<f64> = slice
                .reciprocal
                .iter()
                .enumerate()
                .map(|(k, v)| v / (angle(k / n).cos() * angle(k % n).cos()))
                .collect();
            Ok(Arc::new(MeasuredSlice::new(axis, axis, &rho)?) as Arc<dyn Brdf>)
        })
        .collect::<Result<_>>()?;
    Ok(Material {
        channels: estimate.channels.clone(),
        brdfs,
    })
}

/// Analytic models fitted to the slice, or a sentence on why there are none. Neighbouring cells closer than the
/// splines' knots share their error, so only one cell per knot is used: χ² and σ then mean what they say.
pub fn fit_models(estimate: &BrdfEstimate, absolute: bool) -> (Option<BrdfModels>, Option<String>) {
    let spacing = PI / estimate.size.max(1) as f64;
    let stride = estimate
        .slices
        .iter()
        .map(|s| (s.resolution / spacing).ceil() as usize)
        .max()
        .unwrap_or(1)
        .max(1);
    // An odd divisor keeps the cells on a regular grid with a middle.
    let stride = (1..=stride)
        .rev()
        .find(|s| s % 2 == 1 && estimate.size.is_multiple_of(*s))
        .unwrap_or(1);
    let table = table(estimate, stride);
    let options = FitOptions {
        absolute,
        known_variance: true,
    };
    match fit_table(&table, options) {
        Ok(models) => (Some(models), None),
        Err(e) => (None, Some(format!("No analytic models were fitted: {e}."))),
    }
}

/// Share of the slice with a status.
pub fn share(status: &[Status], wanted: Status) -> f64 {
    status.iter().filter(|s| **s == wanted).count() as f64 / status.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;

    const GRID: Grid = Grid {
        normals: 72,
        locals: 36,
    };

    /// B = E cos α (1 + part cos 2θo′) where the sun is seen.
    fn field(part: f64) -> LightField {
        let grid = GRID;
        let mut field = LightField::empty(grid, vec!["Y".into()]);
        for i in 0..grid.normals {
            for j in 0..grid.locals {
                let lit = grid.normal(i).rad().cos().max(0.0);
                let b = lit * (1.0 + part * f64::cos(2.0 * grid.local(j).rad()));
                field.mean[0][grid.index(i, j)] = b as f32;
                field.weight[0][grid.index(i, j)] = 1.0;
            }
        }
        field
    }

    #[test]
    fn what_looks_the_same_from_all_sides_is_diffuse() {
        // The scatter over a half circle is part/√2, of which 0.15 is at a part of 0.21.
        for (part, expected) in [(0.0, true), (0.19, true), (0.24, false), (0.9, false)] {
            assert_eq!(looks_diffuse(&field(part), 0), expected, "{part}");
        }
        let nothing = LightField::empty(GRID, vec!["Y".into()]);
        assert!(!looks_diffuse(&nothing, 0));
    }
}
