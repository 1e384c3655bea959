//! Exposure jitter: views that are a little too light or too dark as a whole.
//!
//! Neighbouring views see nearly the same light field: at one θo′ a view's sample is interpolated from those
//! of the two views on either side. What no interpolation explains and all columns of a view have in
//! common is the view's exposure. Light fields have details too, but a detail stands at another θo′ in
//! each view, so it is an outlier in a few columns. Jitter that is as smooth along the orbit as the light
//! field itself cannot be told from lighting and is not looked for: it stays 0 by the prior.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{Column, Samples};
use crate::angle::wrap;

/// Exposure jitter that is thought possible, as a standard deviation of its logarithm.
const POSSIBLE: f64 = 0.02;

/// The farthest of four neighbours, radians: beyond, interpolation between views explains nothing.
const FARTHEST: f64 = 0.36;

/// Columns that count as one: what interpolation leaves out is alike in neighbouring ones.
const ALIKE: f64 = 8.0;

/// Residual, in standard deviations, beyond which a sample is a detail of the light field.
const DETAIL: f64 = 3.0;

/// Parts of the equations that are added up by themselves, and then in order: fixed, so that the result does not depend on the number
/// of threads.
const PARTS: usize = 4;

/// Rounds of weighting anew.
const ROUNDS: usize = 6;

/// By how much the misfit (χ²) must fall per view for jitter to be believed, and the least jitter (rms).
const BELIEVED: f64 = 9.0;
const LEAST: f64 = 0.002;

/// Exposure errors of a capture's views.
#[derive(Clone, Debug, PartialEq)]
pub struct Jitter {
    /// What each view's values are to be divided by.
    pub factor: Vec<f64>,
    /// Standard deviation of its logarithm, for jitter from view to view.
    pub sigma: Vec<f64>,
}

impl Jitter {
    /// Root mean square of the logarithms.
    pub fn rms(&self) -> f64 {
        let squares = self.factor.iter().map(|f| f.ln().powi(2));
        (squares.sum::<f64>() / self.factor.len().max(1) as f64).sqrt()
    }
}

/// One sample against its four neighbours: Σ of view · coefficient = `off`.
struct Equation {
    terms: [(usize, f64); 5],
    off: f64,
    noise: f64,
}

/// The exposure jitter of `views` views; `None` if there is none beyond doubt.
pub fn jitter(samples: &Samples, views: usize) -> Option<Jitter> {
    // By column.
    let equations: Vec<Vec<Equation>> = samples
        .columns
        .par_iter()
        .map(|column| equations_of(column, samples.channels.len()))
        .collect();
    let count: usize = equations.iter().map(Vec::len).sum();
    if views < 8 || count < 20 * views {
        return None;
    }
    let mut delta = DVector::<f64>::zeros(views);
    let mut solver = None;
    let mut gained = 0.0;
    for _ in 0..ROUNDS {
        let residuals: Vec<Vec<f64>> = equations
            .par_iter()
            .map(|of_column| {
                let residual = |e: &Equation| {
                    let known: f64 = e.terms.iter().map(|(v, a)| a * delta[*v]).sum();
                    e.off - known
                };
                of_column.iter().map(residual).collect()
            })
            .collect();
        // Numbers that are not negative are ordered as their bits are.
        let size = |r: &f64| r.abs().to_bits();
        let mut sizes: Vec<u64> = residuals.iter().flatten().map(size).collect();
        let middle = sizes.len() / 2;
        let median = f64::from_bits(*sizes.select_nth_unstable(middle).1);
        let scatter = (1.4826 * median).max(1e-6);
        let part = equations.len().div_ceil(PARTS);
        let parts: Vec<(DMatrix<f64>, DVector<f64>)> = equations
            .par_chunks(part)
            .zip(residuals.par_chunks(part))
            .map(|(equations, residuals)| {
                let both = equations.iter().flatten().zip(residuals.iter().flatten());
                normal_equations(both, scatter, views)
            })
            .collect();
        let mut normal = DMatrix::<f64>::identity(views, views) / (POSSIBLE * POSSIBLE);
        let mut right = DVector::<f64>::zeros(views);
        for (n, r) in parts {
            normal += n;
            right += r;
        }
        let factor = normal.cholesky()?;
        delta = factor.solve(&right);
        gained = right.dot(&delta);
        solver = Some(factor);
    }
    if gained <= BELIEVED * views as f64 {
        return None;
    }
    let covariance = solver?.inverse();
    let found = Jitter {
        factor: delta.iter().map(|d| d.exp()).collect(),
        sigma: covariance.diagonal().iter().map(|v| v.sqrt()).collect(),
    };
    (found.rms() > LEAST).then_some(found)
}

/// What some equations add to the normal equations, the lower triangle of the matrix, which is what its factorisation looks at.
fn normal_equations<'a>(
    equations_and_residuals: impl Iterator<Item = (&'a Equation, &'a f64)>,
    scatter: f64,
    views: usize,
) -> (DMatrix<f64>, DVector<f64>) {
    let mut normal = DMatrix::<f64>::zeros(views, views);
    let mut right = DVector::<f64>::zeros(views);
    for (e, residual) in equations_and_residuals {
        let variance = scatter * scatter + e.noise * e.noise;
        // Tukey's weight: a detail of the light field says nothing of the exposure.
        let outside = residual * residual / (DETAIL * DETAIL * variance);
        if outside >= 1.0 {
            continue;
        }
        let weight = (1.0 - outside).powi(2) / (ALIKE * variance);
        for (k, &(i, a)) in e.terms.iter().enumerate() {
            let weighted = weight * a;
            for &(j, b) in e.terms.iter().take(k + 1) {
                normal[(i.max(j), i.min(j))] += weighted * b;
            }
            right[i] += weighted * e.off;
        }
    }
    (normal, right)
}

fn equations_of(column: &Column, channels: usize) -> Vec<Equation> {
    let mut equations = Vec::new();
    let mut order: Vec<usize> = (0..column.alpha.len()).collect();
    order.sort_by(|a, b| column.alpha[*a].total_cmp(&column.alpha[*b]));
    let n = order.len();
    if n < 5 {
        return equations;
    }
    for c in 0..channels {
        for at in 0..n {
            let five = [0, 1, 2, 3, 4].map(|k| order[(at + n + k - 2) % n]);
            let here = column.alpha[five[2]];
            let offset = five.map(|i| wrap(column.alpha[i] - here));
            let value = five.map(|i| column.value[c][i]);
            let variance = five.map(|i| column.variance[c][i]);
            let mean = value.iter().sum::<f64>() / 5.0;
            let even = offset.windows(2).all(|w| w[1] - w[0] > 1e-6);
            let near = offset[0] > -FARTHEST && offset[4] < FARTHEST;
            if !even || !near || !variance.iter().all(|v| v.is_finite()) || !(mean > 0.0) {
                continue;
            }
            let mut terms = [(0, 0.0); 5];
            let (mut off, mut noise) = (0.0, 0.0);
            for (k, term) in terms.iter_mut().enumerate() {
                let weight = if k == 2 {
                    1.0
                } else {
                    let others = [0, 1, 3, 4].into_iter().filter(|m| *m != k);
                    -others
                        .map(|m| offset[m] / (offset[m] - offset[k]))
                        .product::<f64>()
                };
                let part = weight * value[k] / mean;
                *term = (column.view[five[k]] as usize, part);
                off += part;
                noise += (weight / mean).powi(2) * variance[k];
            }
            // The dark side, where noise is all, has nothing to say.
            if noise < 0.01 {
                equations.push(Equation {
                    terms,
                    off,
                    noise: noise.sqrt(),
                });
            }
        }
    }
    equations
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;
    use crate::light_field::Column;
    use std::f64::consts::TAU;

    /// 72 views of a glossy object under two lights with 0.5 % of noise, each brighter by its factor.
    fn samples(gain: impl Fn(usize) -> f64) -> Samples {
        let views = 72;
        let noise = |i: usize| ((i * 7919 % 10007) as f64 / 10007.0 - 0.5) * 0.017;
        let columns = (0..140)
            .map(|j| {
                let local = (j as f64 - 69.5).to_radians();
                let alpha: Vec<f64> = (0..views)
                    .map(|v| wrap(TAU * v as f64 / views as f64 - local))
                    .collect();
                let light = |a: f64| {
                    let from = |at: f64, e: f64| {
                        let d = wrap(at - a);
                        let diffuse = d.cos().max(0.0);
                        let lobe = if d.abs() < 1.57 {
                            (d + local).cos().max(0.0).powi(40)
                        } else {
                            0.0
                        };
                        e * (0.3 * diffuse + lobe)
                    };
                    0.1 + from(0.7, 1.0) + from(-1.9, 0.4)
                };
                let value: Vec<f64> = alpha
                    .iter()
                    .enumerate()
                    .map(|(v, a)| light(*a) * gain(v) * (1.0 + noise(v * 140 + j)))
                    .collect();
                Column {
                    local: LocalAngle::radians(local),
                    view: (0..views as u32).collect(),
                    variance: vec![value.iter().map(|v| (0.005 * v).powi(2)).collect()],
                    value: vec![value],
                    alpha,
                }
            })
            .collect();
        Samples {
            channels: vec!["Y".into()],
            columns,
        }
    }

    #[test]
    fn jitter_from_view_to_view_is_found() {
        // White, 1 % rms.
        let planted = |v: usize| ((v * v * 7919 + 31 * v) % 1009) as f64 / 1009.0 * 0.0346 - 0.0173;
        let found = jitter(&samples(|v| planted(v).exp()), 72).expect("jitter");
        let left: Vec<f64> = (0..72).map(|v| planted(v) - found.factor[v].ln()).collect();
        let whole: Vec<f64> = (0..72).map(planted).collect();
        // What is slow along the orbit stays; what changes from view to view is what is found.
        let fast = |d: &[f64]| {
            let squares = (2..70).map(|v| {
                let step = d[v - 2] - 4.0 * d[v - 1] + 6.0 * d[v] - 4.0 * d[v + 1] + d[v + 2];
                step * step / 70.0
            });
            (squares.sum::<f64>() / 68.0).sqrt()
        };
        // Noise of 0.5 % in 140 columns, tied by eights, is 0.12 %.
        assert!(
            fast(&left) < 0.25 * fast(&whole),
            "{} of {}",
            fast(&left),
            fast(&whole)
        );
        let rms = |d: &[f64]| (d.iter().map(|x| x * x).sum::<f64>() / 72.0).sqrt();
        assert!(
            rms(&left) < 0.7 * rms(&whole),
            "{} of {}",
            rms(&left),
            rms(&whole)
        );
    }

    #[test]
    fn no_jitter_is_found_where_there_is_none() {
        assert_eq!(jitter(&samples(|_| 1.0), 72), None);
        // A drift as slow as lighting cannot be told from it.
        let drift = jitter(&samples(|v| 1.0 + 0.02 * (TAU * v as f64 / 72.0).cos()), 72);
        assert_eq!(drift, None);
    }
}
