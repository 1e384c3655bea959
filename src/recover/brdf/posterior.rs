//! Mean and covariance of the coefficients given the samples and the prior, by dense algebra.

use faer::Mat;

use super::basis::Basis;
use super::information::Information;
use super::prior::{Factor, Penalties, Smoothness};
use crate::Result;

/// Most steps of the interior-point method; it takes 10 to 20.
const ROUNDS: usize = 40;

/// A change of χ² that nobody needs.
const NEGLIGIBLE: f64 = 0.05;

/// Gaussian posterior of the coefficients c_{mn}, m ≥ n.
pub struct Posterior {
    /// Mean, or the non-negative maximum.
    pub mean: Vec<f64>,
    /// Factor of the precision, without the constraints.
    pub factor: Factor,
    /// Number of coefficients that non-negativity holds at 0.
    pub held: usize,
}

impl Posterior {
    /// Solves the weighted least-squares problem with the prior.
    ///
    /// Non-negativity is of the coefficients, which makes the spline non-negative; the covariance stays that of
    /// the unconstrained problem, which is the wider one.
    ///
    /// # Errors
    /// If the normal equations cannot be factored.
    pub fn new(
        information: &Information,
        smoothness: &Smoothness,
        noise: f64,
        non_negative: bool,
    ) -> Result<Self> {
        let mut matrix = information.dense(1.0 / noise);
        Penalties::new(information.basis).add_dense(smoothness, &mut matrix);
        let rhs: Vec<f64> = information
            .right_side()
            .iter()
            .map(|h| h / noise)
            .collect();
        let factor = Factor::new(&matrix)?;
        let mut mean = factor.solve_vector(&rhs);
        let mut held = 0;
        if non_negative {
            held = hold_non_negative(&matrix, &rhs, &mut mean)?;
        }
        Ok(Self { mean, factor, held })
    }
}

/// Minimises ½ xᵀA x − hᵀx over x ≥ 0, given its unconstrained minimum in `x`; returns how many are at 0.
fn hold_non_negative(matrix: &Mat<f64>, rhs: &[f64], x: &mut [f64]) -> Result<usize> {
    let n = x.len();
    let product = |v: &[f64]| -> Vec<f64> {
        let p = matrix * Mat::from_fn(n, 1, |i, _| v[i]);
        (0..n).map(|i| p[(i, 0)]).collect()
    };
    // If setting the negative ones to 0 costs next to nothing in χ², that is the answer.
    let cut: Vec<f64> = x.iter().map(|v| (-v).max(0.0)).collect();
    let cost: f64 = cut.iter().zip(product(&cut)).map(|(a, b)| a * b).sum();
    let negative = x.iter().filter(|v| **v < 0.0).count();
    if cost < NEGLIGIBLE {
        x.iter_mut().for_each(|v| *v = v.max(0.0));
        return Ok(negative);
    }
    // Primal-dual interior point with Mehrotra's corrector; z ≥ 0 are the multipliers. All in units of
    // s = 1/√A_ii, in which both are of order 1.
    let unit: Vec<f64> = (0..n).map(|i| 1.0 / matrix[(i, i)].sqrt()).collect();
    let mut z: Vec<f64> = unit.iter().map(|s| 1.0 / s).collect();
    for (v, s) in x.iter_mut().zip(&unit) {
        *v = v.max(*s);
    }
    for _ in 0..ROUNDS {
        let gradient: Vec<f64> = product(x).iter().zip(rhs).map(|(p, h)| p - h).collect();
        let dual: f64 = gradient
            .iter()
            .zip(&z)
            .zip(&unit)
            .map(|((g, z), s)| ((g - z) * s).powi(2))
            .sum();
        let gap: f64 = x.iter().zip(&z).map(|(x, z)| x * z).sum();
        if gap < NEGLIGIBLE && dual < NEGLIGIBLE {
            break;
        }
        let mut barrier = matrix.clone();
        for i in 0..n {
            barrier[(i, i)] += z[i] / x[i];
        }
        let factor = Factor::new(&barrier)?;
        let step = |target: &dyn Fn(usize) -> f64| -> (Vec<f64>, Vec<f64>) {
            let right: Vec<f64> = (0..n).map(|i| target(i) / x[i] - gradient[i]).collect();
            let dx = factor.solve_vector(&right);
            let dz = (0..n)
                .map(|i| (target(i) - z[i] * dx[i]) / x[i] - z[i])
                .collect();
            (dx, dz)
        };
        let longest = |v: &[f64], d: &[f64]| {
            v.iter()
                .zip(d)
                .filter(|(_, d)| **d < 0.0)
                .fold(1.0f64, |t, (v, d)| t.min(-0.995 * v / d))
        };
        let (px, pz) = step(&|_| 0.0);
        let (tx, tz) = (longest(x, &px), longest(&z, &pz));
        let ahead: f64 = (0..n)
            .map(|i| (x[i] + tx * px[i]) * (z[i] + tz * pz[i]))
            .sum();
        let centre = (ahead / gap).powi(3) * gap / n as f64;
        let (dx, dz) = step(&|i| centre - px[i] * pz[i]);
        let (tx, tz) = (longest(x, &dx), longest(&z, &dz));
        for i in 0..n {
            x[i] += tx * dx[i];
            z[i] += tz * dz[i];
        }
    }
    let mut held = 0;
    for i in 0..n {
        if x[i] * matrix[(i, i)] < z[i] {
            x[i] = 0.0;
            held += 1;
        }
    }
    Ok(held)
}

/// Sparse functional: value of the spline at (a, b) as factors on the unknowns.
pub fn value_at(basis: Basis, a: f64, b: f64) -> Vec<(usize, f64)> {
    let (at_a, at_b) = (basis.at(a), basis.at(b));
    let mut out = Vec::with_capacity(16);
    for (m, u) in at_a.iter() {
        for (n, v) in at_b.iter() {
            out.push((basis.pair(m, n), u * v));
        }
    }
    out
}

/// f(x) of a sparse functional.
pub fn apply(functional: &[(usize, f64)], x: &[f64]) -> f64 {
    functional.iter().map(|&(i, w)| w * x[i]).sum()
}

/// Variance of a sparse functional under a covariance matrix.
pub fn variance(functional: &[(usize, f64)], covariance: &Mat<f64>) -> f64 {
    let mut sum = 0.0;
    for &(i, u) in functional {
        for &(j, v) in functional {
            sum += u * v * covariance[(i, j)];
        }
    }
    sum.max(0.0)
}
