//! What would be learnt from one more view or one more light, by the information matrix.
//!
//! Samples that were not taken yet have an information matrix all the same: it depends on where they lie, how
//! precise they are, and on what is known, but not on their values. So candidates can be compared before any of them is photographed
//! (Bayesian A-optimal design; Chaloner and Verdinelli, "Bayesian experimental design: a review", Statistical Science 10, 1995).

use std::f64::consts::{PI, TAU};

use faer::linalg::matmul::matmul;
use faer::linalg::solvers::{DenseSolveCore, Solve};
use faer::{Accum, Mat, MatRef, Par, Side};
use num_complex::Complex64;
use rayon::prelude::*;

use super::normal::NormalSystem;
use crate::angle::wrap;
use crate::brdf::{Brdf, transfer_row};
use crate::error::{Error, Result};
use crate::light_field::{Column, Samples};

/// Directions that are tried all around the circle.
pub const CANDIDATES: usize = 72;
/// Columns of the samples that the comparison is made with; more would say the same.
const COLUMNS: usize = 45;
/// Highest frequency of the light that is counted.
const ORDER: usize = 60;

/// One candidate and what it would leave open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain {
    /// Orbit angle of a view, or direction of a source, radians.
    pub direction: f64,
    /// The measure of [`Advice::now`] with it.
    pub then: f64,
}

/// The best that could be added to a capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advice {
    /// How much is known now. For lighting: how many independent numbers of the light are known, Σ (1 − σ²/σ_prior²). For a BRDF:
    /// that sum over the slice's values, relative to their number, 0 … 1.
    pub now: f64,
    /// The best further view.
    pub view: Option<Gain>,
    /// The best single source under which all views would be taken once more.
    pub source: Option<Gain>,
}

/// The direction of candidate `k`, radians.
pub fn candidate(k: usize) -> f64 {
    -PI + TAU * k as f64 / CANDIDATES as f64
}

/// The best of the candidates by what `known` would then be.
pub fn best(known: impl Fn(f64) -> Option<f64> + Sync) -> Option<Gain> {
    (0..CANDIDATES)
        .into_par_iter()
        .filter_map(|k| {
            let direction = candidate(k);
            known(direction).map(|then| Gain { direction, then })
        })
        // The first of equals, whoever computes it.
        .collect::<Vec<_>>()
        .into_iter()
        .fold(None, |best: Option<Gain>, gain| match best {
            Some(b) if b.then >= gain.then => Some(b),
            _ => Some(gain),
        })
}

/// A capture's samples on fewer columns, with precision in their place, and the view that a camera at any orbit angle would
/// add to them.
pub struct Thinned {
    /// One channel.
    pub samples: Samples,
    /// For each column: α − orbit angle, and the variance of a sample, where the views have it in common.
    common: Vec<Option<(f64, f64)>>,
}

impl Thinned {
    /// Takes `channel` of the samples of views from `orbits` (radians); all variances times `noise`.
    pub fn new(samples: &Samples, channel: usize, orbits: &[f64], noise: f64) -> Self {
        let stride = samples.columns.len().div_ceil(COLUMNS).max(1);
        let mut columns = Vec::new();
        let mut common = Vec::new();
        for column in samples.columns.iter().skip(stride / 2).step_by(stride) {
            let (Some(value), Some(variance)) =
                (column.value.get(channel), column.variance.get(channel))
            else {
                continue;
            };
            // Each column stands for as many as were left out.
            let variance: Vec<f64> = variance.iter().map(|v| v * noise / stride as f64).collect();
            let seen: Vec<(usize, f64)> = variance
                .iter()
                .enumerate()
                .filter(|(_, v)| v.is_finite() && **v > 0.0)
                .map(|(i, v)| (i, *v))
                .collect();
            let turn: Complex64 = seen
                .iter()
                .filter_map(|&(i, _)| {
                    let orbit = orbits.get(*column.view.get(i)? as usize)?;
                    Some(Complex64::cis(column.alpha[i] - orbit))
                })
                .sum();
            let mut variances: Vec<f64> = seen.iter().map(|s| s.1).collect();
            variances.sort_by(f64::total_cmp);
            common.push(
                variances
                    .get(variances.len() / 2)
                    .filter(|_| turn.norm() > 0.5 * seen.len() as f64)
                    .map(|v| (turn.arg(), *v)),
            );
            columns.push(Column {
                local: column.local,
                alpha: column.alpha.clone(),
                view: column.view.clone(),
                value: vec![value.clone()],
                variance: vec![variance],
            });
        }
        Self {
            samples: Samples {
                channels: samples.channels.get(channel).cloned().into_iter().collect(),
                columns,
            },
            common,
        }
    }

    /// The samples of a further view; its values are nothing.
    pub fn view(&self, orbit: f64) -> Samples {
        let columns = self
            .samples
            .columns
            .iter()
            .zip(&self.common)
            .map(|(column, common)| {
                let (offset, variance) = common.unwrap_or((0.0, f64::INFINITY));
                Column {
                    local: column.local,
                    alpha: vec![wrap(orbit + offset)],
                    view: vec![0],
                    value: vec![vec![0.0]],
                    variance: vec![vec![variance]],
                }
            })
            .collect();
        Samples {
            channels: self.samples.channels.clone(),
            columns,
        }
    }
}

/// Which further view would tell most of the light. `mean_light` is L_0, `noise` the factor by which the samples scatter more
/// than their variances say; the prior is a deviation of L_0 for every part of every L_p.
///
/// # Errors
/// If L_0 is not positive, or the variances are so small that the matrices cannot be inverted.
pub fn lighting(
    samples: &Samples,
    channel: usize,
    orbits: &[f64],
    brdf: &dyn Brdf,
    mean_light: f64,
    noise: f64,
) -> Result<Advice> {
    if !(mean_light > 0.0 && noise > 0.0) {
        return Err(Error::input(format!(
            "expected light above 0, found {mean_light}"
        )));
    }
    let thinned = Thinned::new(samples, channel, orbits, noise);
    let transfer: Vec<Vec<Complex64>> = thinned
        .samples
        .columns
        .iter()
        .map(|c| transfer_row(brdf, c.local, ORDER))
        .collect();
    // Half of |L_p|² for each part; in units of the prior the sum below counts the numbers that are known.
    let scale = |i: usize| {
        if i == 0 {
            mean_light
        } else {
            mean_light / 2f64.sqrt()
        }
    };
    let unknowns = 2 * ORDER + 1;
    let system = NormalSystem::with_transfer(&thinned.samples, 0, transfer.clone(), ORDER);
    let have = Mat::from_fn(unknowns, unknowns, |i, j| {
        let own = if i == j { 1.0 } else { 0.0 };
        system.matrix[(i, j)] * scale(i) * scale(j) + own
    });
    let Ok(factor) = have.llt(Side::Lower) else {
        return Err(Error::failed("the information matrix cannot be inverted"));
    };
    let covariance = factor.inverse();
    let now = (0..unknowns).map(|i| 1.0 - covariance[(i, i)]).sum::<f64>();
    // With rows R more, C becomes C − C Rᵀ (1 + R C Rᵀ)⁻¹ R C (Woodbury): as many rows as there are columns, fewer than unknowns.
    let known = |rows: Mat<f64>| -> Option<f64> {
        let product = |a: MatRef<'_, f64>, b: MatRef<'_, f64>| {
            let mut product = Mat::zeros(a.nrows(), b.ncols());
            matmul(product.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
            product
        };
        let seen = product(rows.as_ref(), covariance.as_ref());
        let mut noisy = product(seen.as_ref(), rows.transpose());
        for i in 0..noisy.nrows() {
            noisy[(i, i)] += 1.0;
        }
        let square = product(seen.as_ref(), seen.transpose());
        let explained = noisy.llt(Side::Lower).ok()?.solve(&square);
        let more: f64 = (0..explained.nrows()).map(|i| explained[(i, i)]).sum();
        more.is_finite().then_some(now + more)
    };
    // A row for each sample of a further view: what it measures of each unknown, in its own standard deviation.
    let rows = |orbit: f64| {
        let view = thinned.view(orbit);
        let mut rows = Mat::zeros(view.columns.len(), unknowns);
        for (j, (column, h)) in view.columns.iter().zip(&transfer).enumerate() {
            let (Some(&alpha), Some(&variance)) =
                (column.alpha.first(), column.variance[0].first())
            else {
                continue;
            };
            if !(variance > 0.0 && variance.is_finite()) {
                continue;
            }
            let weight = variance.sqrt().recip();
            let turn = Complex64::cis(alpha);
            let mut wave = Complex64::new(weight, 0.0);
            for (p, h) in h.iter().enumerate() {
                let g = h * wave;
                if p == 0 {
                    rows[(j, 0)] = g.re * scale(0);
                } else {
                    rows[(j, 2 * p - 1)] = 2.0 * g.re * scale(2 * p - 1);
                    rows[(j, 2 * p)] = -2.0 * g.im * scale(2 * p);
                }
                wave *= turn;
            }
        }
        rows
    };
    Ok(Advice {
        now,
        view: best(|orbit| known(rows(orbit))),
        source: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{Lambertian, Phong};
    use crate::grid::Grid;

    const MATTE: Lambertian = Lambertian { albedo: 0.5 };

    /// Views within `half_arc` of 0 at 1 % noise, and their orbit angles.
    fn captured(half_arc: f64) -> (Samples, Vec<f64>) {
        let grid = Grid {
            normals: 72,
            locals: 40,
        };
        let mut samples = Samples::from_grid(
            grid,
            vec!["Y".into()],
            &[vec![0.0; grid.len()]],
            &[vec![1e-4; grid.len()]],
        );
        let step = TAU / 72.0;
        let orbits: Vec<f64> = (0..72)
            .map(|v| candidate(0) + (v as f64 + 0.5) * step)
            .collect();
        for column in &mut samples.columns {
            for (i, view) in column.view.iter_mut().enumerate() {
                let orbit = wrap(column.alpha[i] + column.local.rad());
                *view = ((orbit + PI) / step) as u32 % 72;
                if orbit.abs() > half_arc {
                    column.variance[0][i] = f64::INFINITY;
                }
            }
        }
        (samples, orbits)
    }

    #[test]
    fn the_best_view_lies_in_the_gap() {
        let brdf = Phong {
            diffuse: 0.3,
            specular: 0.4,
            exponent: 32.0,
        };
        let (samples, orbits) = captured(1.05);
        let advice = lighting(&samples, 0, &orbits, &brdf, 1.0, 1.0).unwrap();
        let view = advice.view.unwrap();
        assert!(view.direction.abs() > 1.05, "{view:?}");
        // A lobe of exponent 32 shows frequencies up to about 20; a view sees the light within its own ±90° mirrored, so
        // beside the third of the circle it adds numbers, not fractions.
        assert!(view.then > advice.now + 1.0, "{advice:?}");

        // Around the whole circle nothing is missing: one view in 73 can add little to any of the frequencies.
        let (samples, orbits) = captured(4.0);
        let all = lighting(&samples, 0, &orbits, &brdf, 1.0, 1.0).unwrap();
        assert!(all.now > advice.now);
        assert!(all.view.unwrap().then < all.now + 1.0, "{all:?}");
    }

    #[test]
    fn no_view_helps_against_a_matte_surface() {
        let (samples, orbits) = captured(4.0);
        // At 10 % noise: even frequencies up to some 8, whose response falls as 1/p² (eq. 22), and p = ±1.
        let advice = lighting(&samples, 0, &orbits, &MATTE, 1.0, 100.0).unwrap();
        assert!((5.0..25.0).contains(&advice.now), "{advice:?}");
        assert!(advice.view.unwrap().then < advice.now + 0.5, "{advice:?}");
        assert!(lighting(&samples, 0, &orbits, &MATTE, 0.0, 1.0).is_err());
    }
}
