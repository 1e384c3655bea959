//! Light is not negative: the quadratic problem of the recovery under L(θ) ≥ 0 on a circle of angles.
//!
//! min ½ xᵀQx − yᵀx with G x ≥ 0 is solved in its dual, min_{μ ≥ 0} ½ μᵀKμ + μᵀGx̂ with K = G Q⁻¹ Gᵀ and
//! x = x̂ + Q⁻¹Gᵀμ, by block principal pivoting (Portugal, Júdice and Vicente, "A comparison of block
//! pivoting and interior-point algorithms for linear least squares problems with nonnegative
//! variables", Math. Comp. 63 (1994)), which changes many active angles at once.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

/// The mean of least cost with G x ≥ 0; `covariance` is Q⁻¹ and `mean` the unconstrained x̂.
///
/// `constraints` holds G, one row per constraint. Returns the constrained mean; where rounding
/// stops the iteration, constraints hold to 1e-9 of the largest value of |G x̂|.
pub fn constrain(mean: &[f64], covariance: &Mat<f64>, constraints: &Mat<f64>) -> Vec<f64> {
    let (m, n) = (constraints.nrows(), constraints.ncols());
    let x = Mat::from_fn(n, 1, |i, _| mean[i]);
    let slack = constraints * &x;
    let scale = (0..m).map(|k| slack[(k, 0)].abs()).fold(0.0, f64::max);
    let tolerance = 1e-9 * scale;
    if (0..m).all(|k| slack[(k, 0)] >= -tolerance) {
        return mean.to_vec();
    }
    let spread = covariance * constraints.transpose();
    let kernel = constraints * &spread;
    let ridge = 1e-12 * (0..m).map(|k| kernel[(k, k)]).fold(0.0, f64::max);

    let mut active: Vec<bool> = (0..m).map(|k| slack[(k, 0)] < -tolerance).collect();
    let mut fewest = usize::MAX;
    let mut patience = 3;
    let mut multipliers = vec![0.0; m];
    for _ in 0..40 * m {
        let set: Vec<usize> = (0..m).filter(|&k| active[k]).collect();
        let block = Mat::from_fn(set.len(), set.len(), |a, b| {
            kernel[(set[a], set[b])] + if a == b { ridge } else { 0.0 }
        });
        let right = Mat::from_fn(set.len(), 1, |a, _| -slack[(set[a], 0)]);
        let Ok(factor) = block.llt(Side::Lower) else {
            break;
        };
        let solution = factor.solve(&right);
        multipliers.fill(0.0);
        for (a, &k) in set.iter().enumerate() {
            multipliers[k] = solution[(a, 0)];
        }
        let largest = multipliers.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        let infeasible: Vec<usize> = (0..m)
            .filter(|&k| {
                if active[k] {
                    multipliers[k] < -1e-12 * largest
                } else {
                    let value = slack[(k, 0)]
                        + set
                            .iter()
                            .map(|&l| kernel[(k, l)] * multipliers[l])
                            .sum::<f64>();
                    value < -tolerance
                }
            })
            .collect();
        if infeasible.is_empty() {
            break;
        }
        // Exchange all of them while that makes progress, else only the last: this cannot cycle.
        if infeasible.len() < fewest {
            fewest = infeasible.len();
            patience = 3;
        } else if patience > 0 {
            patience -= 1;
        }
        let exchanged = if patience > 0 {
            &infeasible[..]
        } else {
            &infeasible[infeasible.len() - 1..]
        };
        for &k in exchanged {
            active[k] = !active[k];
        }
    }
    (0..n)
        .map(|i| {
            mean[i]
                + (0..m)
                    .filter(|&k| active[k])
                    .map(|k| spread[(i, k)] * multipliers[k].max(0.0))
                    .sum::<f64>()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_optimality_conditions_hold() {
        // Q = diag, G = identity: the answer is max(x̂, 0), value by value.
        let mean = [0.5, -0.2, 0.1, -3.0];
        let covariance = Mat::from_fn(4, 4, |i, j| if i == j { 1.0 + i as f64 } else { 0.0 });
        let found = constrain(&mean, &covariance, &Mat::identity(4, 4));
        for (f, m) in found.iter().zip(mean) {
            assert!((f - m.max(0.0)).abs() < 1e-9);
        }
    }

    #[test]
    fn correlated_unknowns_meet_the_conditions_of_karush_kuhn_and_tucker() {
        let n = 12;
        let q = Mat::from_fn(n, n, |i, j| {
            (-(i as f64 - j as f64).powi(2) / 8.0).exp() + if i == j { 0.1 } else { 0.0 }
        });
        let covariance = q
            .llt(Side::Lower)
            .expect("positive definite")
            .solve(Mat::identity(n, n));
        let mean: Vec<f64> = (0..n).map(|i| (i as f64 * 1.7).sin()).collect();
        let x = constrain(&mean, &covariance, &Mat::identity(n, n));
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
