//! Light is not negative: the quadratic problem of the recovery under L(θ) ≥ 0 on a circle of angles.
//!
//! min (x − x̂)ᵀ Q (x − x̂) with G x ≥ 0 becomes, with Q⁻¹ = C Cᵀ and x = x̂ + C w, the least |w| with
//! V w ≥ −G x̂, V = G C. That is solved by the dual method of Goldfarb and Idnani ("A numerically
//! stable dual method for solving strictly convex quadratic programs", Math. Programming 27 (1983)):
//! violated constraints are taken in one at a time, and it ends after finitely many steps also where
//! there are more constraints than unknowns, as on a finely sampled circle.

use faer::{Mat, Side};

use crate::error::{Error, Result};

/// Relative size below which what is left of a constraint's normal counts as dependent on the
/// active ones: rounding leaves 1e-16 times the number of unknowns.
const DEPENDENT: f64 = 1e-10;

/// The most likely x with G x ≥ 0, for a normal distribution of mean x̂ and covariance Q⁻¹; one
/// constraint per row of G.
///
/// Constraints hold to 1e-9 of the largest |G x̂|.
///
/// # Errors
/// If the covariance is not positive definite, or the iteration does not end (neither should happen).
pub fn constrain(mean: &[f64], covariance: &Mat<f64>, constraints: &Mat<f64>) -> Result<Vec<f64>> {
    let (m, n) = (constraints.nrows(), constraints.ncols());
    let slack: Vec<f64> = (0..m)
        .map(|k| (0..n).map(|i| constraints[(k, i)] * mean[i]).sum())
        .collect();
    let tolerance = 1e-9 * slack.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    if slack.iter().all(|&s| s >= -tolerance) {
        return Ok(mean.to_vec());
    }
    let mut raised = covariance.clone();
    for i in 0..n {
        // Rounding of an inverse: its smallest eigenvalues may come out slightly negative.
        raised[(i, i)] *= 1.0 + 1e-12;
    }
    let factor = raised
        .llt(Side::Lower)
        .map_err(|_| Error::failed("the covariance of the lighting is not positive definite"))?;
    let normals = constraints * factor.L();
    let whitened = Whitened::new(&normals, &slack, tolerance).solve()?;
    Ok((0..n)
        .map(|i| {
            mean[i]
                + (0..=i)
                    .map(|j| factor.L()[(i, j)] * whitened[j])
                    .sum::<f64>()
        })
        .collect())
}

/// The least-distance problem min |w|² with v_k · w ≥ −s_k.
struct Whitened<'a> {
    slack: &'a [f64],
    tolerance: f64,
    /// Rows v_k.
    normals: Vec<Vec<f64>>,
    w: Vec<f64>,
    active: Vec<usize>,
    is_active: Vec<bool>,
    multipliers: Vec<f64>,
    /// Orthonormal basis of the active normals, in the order they were taken in, and R with V_Aᵀ = Q R.
    basis: Vec<Vec<f64>>,
    triangle: Vec<Vec<f64>>,
}

/// a · b, with the processor's widest instructions.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    pulp::Arch::new().dispatch(Dot(a, b))
}

struct Dot<'a>(&'a [f64], &'a [f64]);

impl pulp::WithSimd for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> f64 {
        // Sums side by side: each waits for its last addition.
        let mut sums = [simd.splat_f64s(0.0); 4];
        let ((a, a_rest), (b, b_rest)) = (S::as_simd_f64s(self.0), S::as_simd_f64s(self.1));
        for (a, b) in a.chunks(sums.len()).zip(b.chunks(sums.len())) {
            for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                *sum = simd.mul_add_e_f64s(*a, *b, *sum);
            }
        }
        let [x, y, z, w] = sums;
        let sum = simd.add_f64s(simd.add_f64s(x, y), simd.add_f64s(z, w));
        let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
        simd.reduce_sum_f64s(sum) + rest
    }
}

/// The products of each of some vectors with one.
struct Dots<'a>(&'a [Vec<f64>], &'a [f64]);

impl pulp::WithSimd for Dots<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Vec<f64> {
        let mut dots = Vec::with_capacity(self.0.len());
        // No closure: it would not be compiled for these instructions.
        for a in self.0 {
            dots.push(Dot(a, self.1).with_simd(simd));
        }
        dots
    }
}

impl<'a> Whitened<'a> {
    fn new(normals: &Mat<f64>, slack: &'a [f64], tolerance: f64) -> Self {
        let n = normals.ncols();
        Self {
            slack,
            tolerance,
            normals: (0..normals.nrows())
                .map(|k| (0..n).map(|i| normals[(k, i)]).collect())
                .collect(),
            w: vec![0.0; n],
            active: Vec::new(),
            is_active: vec![false; normals.nrows()],
            multipliers: Vec::new(),
            basis: Vec::new(),
            triangle: Vec::new(),
        }
    }

    fn violation(&self, k: usize) -> f64 {
        self.slack[k] + dot(&self.normals[k], &self.w)
    }

    fn solve(mut self) -> Result<Vec<f64>> {
        let limit = 20 * (self.normals.len() + self.w.len());
        for _ in 0..limit {
            let along = pulp::Arch::new().dispatch(Dots(&self.normals, &self.w));
            let worst = (0..self.normals.len())
                .filter(|&k| !self.is_active[k])
                .map(|k| (self.slack[k] + along[k], k))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            match worst {
                Some((violation, k)) if violation < -self.tolerance => {
                    if !self.take_in(k, limit) {
                        break;
                    }
                }
                _ => return Ok(self.w),
            }
        }
        Err(
            Error::failed("the non-negative lighting was not found within the limit of steps")
                .advice("Set non_negative = false in the recipe, and report this capture."),
        )
    }

    /// Makes constraint `k` hold, dropping active ones whose multiplier would turn negative.
    fn take_in(&mut self, k: usize, limit: usize) -> bool {
        let normal = self.normals[k].clone();
        let length = dot(&normal, &normal).sqrt();
        let mut own_multiplier = 0.0;
        for _ in 0..limit {
            // The part of the normal outside the active ones' span, orthogonalised twice.
            let mut rest = normal.clone();
            let mut along = vec![0.0; self.basis.len()];
            for _ in 0..2 {
                for (q, a) in self.basis.iter().zip(&mut along) {
                    let c = dot(q, &rest);
                    *a += c;
                    for (r, q) in rest.iter_mut().zip(q) {
                        *r -= c * q;
                    }
                }
            }
            let change = self.back_substitute(&along);
            let blocking = change
                .iter()
                .zip(&self.multipliers)
                .enumerate()
                .filter(|(_, (r, _))| **r > 0.0)
                .map(|(j, (r, u))| (u / r, j))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let square = dot(&rest, &rest);
            let full = if square.sqrt() > DEPENDENT * length {
                Some((-self.violation(k) / square).max(0.0))
            } else {
                None
            };
            let (step, drop) = match (full, blocking) {
                (Some(full), Some((partial, j))) if partial < full => (partial, Some(j)),
                (Some(full), _) => (full, None),
                (None, Some((partial, j))) => (partial, Some(j)),
                // The constraints contradict each other; w = −C⁻¹x̂ meets them all, so this is rounding.
                (None, None) => return false,
            };
            if full.is_some() {
                for (w, r) in self.w.iter_mut().zip(&rest) {
                    *w += step * r;
                }
            }
            for (u, r) in self.multipliers.iter_mut().zip(&change) {
                *u = (*u - step * r).max(0.0);
            }
            own_multiplier += step;
            match drop {
                Some(j) => self.drop(j),
                None => {
                    let size = square.sqrt();
                    self.basis.push(rest.iter().map(|r| r / size).collect());
                    along.push(size);
                    self.triangle.push(along);
                    self.active.push(k);
                    self.is_active[k] = true;
                    self.multipliers.push(own_multiplier);
                    return true;
                }
            }
        }
        false
    }

    /// R⁻¹ a.
    fn back_substitute(&self, a: &[f64]) -> Vec<f64> {
        let mut x = a.to_vec();
        for i in (0..x.len()).rev() {
            for j in i + 1..x.len() {
                x[i] -= self.triangle[j][i] * x[j];
            }
            x[i] /= self.triangle[i][i];
        }
        x
    }

    /// Takes active constraint `j` out and makes R triangular again by rotations.
    fn drop(&mut self, j: usize) {
        self.is_active[self.active.remove(j)] = false;
        self.multipliers.remove(j);
        self.triangle.remove(j);
        for i in j..self.triangle.len() {
            // Column i now has one entry below its diagonal.
            let (a, b) = (self.triangle[i][i], self.triangle[i][i + 1]);
            let size = a.hypot(b);
            let (c, s) = (a / size, b / size);
            for column in &mut self.triangle[i..] {
                let (x, y) = (column[i], column[i + 1]);
                column[i] = c * x + s * y;
                column[i + 1] = c * y - s * x;
            }
            self.triangle[i].truncate(i + 1);
            let (first, second) = self.basis.split_at_mut(i + 1);
            for (x, y) in first[i].iter_mut().zip(&mut second[0]) {
                (*x, *y) = (c * *x + s * *y, c * *y - s * *x);
            }
        }
        self.basis.pop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::linalg::solvers::Solve;

    #[test]
    fn independent_unknowns_are_cut_at_zero() {
        let mean = [0.5, -0.2, 0.1, -3.0];
        let covariance = Mat::from_fn(4, 4, |i, j| if i == j { 1.0 + i as f64 } else { 0.0 });
        let found = constrain(&mean, &covariance, &Mat::identity(4, 4)).expect("solves");
        for (f, m) in found.iter().zip(mean) {
            assert!((f - m.max(0.0)).abs() < 1e-9);
        }
    }

    #[test]
    fn correlated_unknowns_meet_the_conditions_of_karush_kuhn_and_tucker() {
        let n = 24;
        let q = Mat::from_fn(n, n, |i, j| {
            (-(i as f64 - j as f64).powi(2) / 8.0).exp() + if i == j { 0.01 } else { 0.0 }
        });
        let covariance = q
            .llt(Side::Lower)
            .expect("positive definite")
            .solve(Mat::identity(n, n));
        for seed in 0..20 {
            let mean: Vec<f64> = (0..n)
                .map(|i| ((i * (7 + seed)) as f64 * 1.7).sin())
                .collect();
            let x = constrain(&mean, &covariance, &Mat::identity(n, n)).expect("solves");
            for i in 0..n {
                // The gradient Q (x − x̂) is the multiplier: ≥ 0, and 0 where x > 0.
                let multiplier: f64 = (0..n).map(|j| q[(i, j)] * (x[j] - mean[j])).sum();
                assert!(
                    x[i] > -1e-8 && multiplier > -1e-7,
                    "{i}: {} {multiplier}",
                    x[i]
                );
                assert!(
                    x[i].min(multiplier).abs() < 1e-7,
                    "{i}: {} {multiplier}",
                    x[i]
                );
            }
        }
    }

    #[test]
    fn a_circle_sampled_finer_than_its_band_is_kept_above_zero() {
        // A cosine series whose unconstrained value is below zero nearly everywhere: x = 0 but for a
        // positive mean is the only room, and far more constraints are active than there are unknowns.
        let order = 10;
        let n = 2 * order + 1;
        let constraints = super::super::synthesis_matrix(order, 8 * order);
        let covariance = Mat::from_fn(
            n,
            n,
            |i, j| if i == j { 1.0 / (1.0 + i as f64) } else { 0.0 },
        );
        for level in [-1.0, -0.1, 0.0, 0.05] {
            let mut mean: Vec<f64> = (0..n).map(|i| 0.1 * (i as f64 * 2.1).cos()).collect();
            mean[0] = level;
            let x = constrain(&mean, &covariance, &constraints).expect("solves");
            for k in 0..8 * order {
                let value: f64 = (0..n).map(|i| constraints[(k, i)] * x[i]).sum();
                assert!(value > -1e-8, "{level} {k} {value}");
            }
        }
    }
}
