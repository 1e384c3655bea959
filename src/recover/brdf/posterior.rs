//! Mean and covariance of the coefficients given the samples and the prior, by dense algebra.

use faer::Mat;

use super::basis::Basis;
use super::information::Information;
use super::prior::{Factor, Penalties, Smoothness};
use crate::Result;

/// Most steps of the interior-point method; it takes 10 to 20.
const ROUNDS: usize = 40;

/// Weight of the logarithmic barrier at which the covariance is taken.
const BARRIER: f64 = 3.0;

/// How many σ above 0 a coefficient is safe from the constraint.
const CONTESTED: f64 = 6.0;

/// A change of χ² that nobody needs.
const NEGLIGIBLE: f64 = 0.05;

/// Gaussian posterior of the coefficients c_{mn}, m ≥ n.
pub struct Posterior {
    /// Mean, or the non-negative maximum.
    pub mean: Vec<f64>,
    /// Factor of the precision.
    pub factor: Factor,
    /// Its inverse.
    pub covariance: Mat<f64>,
    /// Number of coefficients that non-negativity holds at 0.
    pub held: usize,
}

impl Posterior {
    /// Solves the weighted least-squares problem with the prior.
    ///
    /// Non-negativity is of the coefficients, which makes the spline non-negative. Its covariance is the curvature
    /// at the centre of a logarithmic barrier: a coefficient far above 0 keeps its σ, one pressed against 0
    /// by a force z gets the 1/z of the exponential that is left of its Gaussian.
    ///
    /// # Errors
    /// If the normal equations cannot be factored.
    pub fn new(
        information: &Information,
        penalties: &Penalties,
        smoothness: &Smoothness,
        noise: f64,
        non_negative: bool,
    ) -> Result<Self> {
        let mut matrix = information.dense(1.0 / noise);
        penalties.add_dense(smoothness, &mut matrix);
        let rhs: Vec<f64> = information.right_side().iter().map(|h| h / noise).collect();
        let factor = Factor::new(&matrix)?;
        let mut mean = factor.solve_vector(&rhs);
        let covariance = factor.inverse();
        if non_negative && let Some(force) = constrain(&covariance, &mut mean)? {
            let held = mean.iter().filter(|v| **v == 0.0).count();
            for (i, (&x, &z)) in mean.iter().zip(&force).enumerate() {
                matrix[(i, i)] += barrier_curvature(x, z, 1.0 / covariance[(i, i)]);
            }
            // Each of these is tens of megabytes.
            drop((factor, covariance));
            let tighter = Factor::new(&matrix)?;
            drop(matrix);
            let narrower = tighter.inverse();
            return Ok(Self {
                mean,
                factor: tighter,
                covariance: narrower,
                held,
            });
        }
        Ok(Self {
            mean,
            factor,
            covariance,
            held: 0,
        })
    }
}

/// Brings the Gaussian estimate `x` with the given covariance to x ≥ 0, and returns the force with which each is pressed
/// against 0; `None` if none is.
///
/// Only coefficients within [`CONTESTED`] σ of 0 can be; the others follow them by their covariance, so the
/// problem shrinks to the contested ones.
fn constrain(covariance: &Mat<f64>, x: &mut [f64]) -> Result<Option<Vec<f64>>> {
    let contested: Vec<usize> = (0..x.len())
        .filter(|&i| x[i] < CONTESTED * covariance[(i, i)].sqrt())
        .collect();
    if !x.iter().any(|v| *v < 0.0) {
        return Ok(None);
    }
    let c = contested.len();
    let part = Factor::new(&Mat::from_fn(c, c, |i, j| {
        covariance[(contested[i], contested[j])]
    }))?;
    let precision = part.inverse();
    let mut y: Vec<f64> = contested.iter().map(|&i| x[i]).collect();
    let right = &precision * Mat::from_fn(c, 1, |i, _| y[i]);
    let right: Vec<f64> = (0..c).map(|i| right[(i, 0)]).collect();
    let force = hold_non_negative(&precision, &right, &mut y)?;
    let change: Vec<f64> = contested.iter().zip(&y).map(|(&i, y)| y - x[i]).collect();
    let change = part.solve_vector(&change);
    for (i, v) in x.iter_mut().enumerate() {
        let follow: f64 = contested
            .iter()
            .zip(&change)
            .map(|(&k, d)| covariance[(k, i)] * d)
            .sum();
        *v = (*v + follow).max(0.0);
    }
    for (&i, y) in contested.iter().zip(y) {
        x[i] = y;
    }
    Ok(force.map(|f| {
        let mut all = vec![0.0; x.len()];
        for (&i, f) in contested.iter().zip(f) {
            all[i] = f;
        }
        all
    }))
}

/// Minimises ½ xᵀA x − hᵀx over x ≥ 0, given its unconstrained minimum in `x`. Returns the multipliers z ≥ 0 (the
/// force by which each is pressed against 0), or `None` if there was nothing to do.
fn hold_non_negative(matrix: &Mat<f64>, rhs: &[f64], x: &mut [f64]) -> Result<Option<Vec<f64>>> {
    let n = x.len();
    let product = |v: &[f64]| -> Vec<f64> {
        let p = matrix * Mat::from_fn(n, 1, |i, _| v[i]);
        (0..n).map(|i| p[(i, 0)]).collect()
    };
    // If setting the negative ones to 0 costs next to nothing in χ², that is the answer.
    let cut: Vec<f64> = x.iter().map(|v| (-v).max(0.0)).collect();
    let cost: f64 = cut.iter().zip(product(&cut)).map(|(a, b)| a * b).sum();
    if cost < NEGLIGIBLE {
        x.iter_mut().for_each(|v| *v = v.max(0.0));
        return Ok(None);
    }
    // Primal-dual interior point with Mehrotra's corrector; z ≥ 0 are the multipliers. It starts in units of
    // 1/√A_ii, in which both are of order 1.
    let mut z: Vec<f64> = (0..n).map(|i| matrix[(i, i)].sqrt()).collect();
    for (v, z) in x.iter_mut().zip(&z) {
        *v = v.max(1.0 / z);
    }
    for _ in 0..ROUNDS {
        let gradient: Vec<f64> = product(x).iter().zip(rhs).map(|(p, h)| p - h).collect();
        let dual: f64 = gradient
            .iter()
            .zip(&z)
            .enumerate()
            .map(|(i, (g, z))| (g - z).powi(2) / matrix[(i, i)])
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
    for i in 0..n {
        if x[i] * matrix[(i, i)] < z[i] {
            x[i] = 0.0;
        }
    }
    Ok(Some(z))
}

/// What the curvature of a barrier −[`BARRIER`]·ln x adds to the precision of a coefficient whose constrained
/// estimate is `x`, pressed against 0 by `z`, and whose precision without the constraint is `c`.
fn barrier_curvature(x: f64, z: f64, c: f64) -> f64 {
    // Its centre: c (y − x) + z = BARRIER / y.
    let b = c * x - z;
    let root = (b * b + 4.0 * c * BARRIER).sqrt();
    // The form without cancellation of (b + root)/2c.
    let y = if b > 0.0 {
        (b + root) / (2.0 * c)
    } else {
        2.0 * BARRIER / (root - b)
    };
    BARRIER / (y * y)
}

/// Sparse functional: value of the spline at (a, b) as factors on the unknowns.
pub fn value_at(basis: Basis, a: f64, b: f64) -> Vec<(usize, f64)> {
    let (at_a, at_b) = (basis.at(a), basis.at(b));
    let mut out = Vec::with_capacity(36);
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
