//! Damped Gauss–Newton (Levenberg–Marquardt) within bounds, for a handful of parameters and many residuals.

use nalgebra::{DMatrix, DVector};

/// Iterations after which a fit is taken as it stands; ordinary ones need 5 to 20.
const MOST_ITERATIONS: usize = 60;

/// Where the sum of squares is smallest.
#[derive(Clone, Debug)]
pub(crate) struct Minimum {
    /// The parameters.
    pub x: Vec<f64>,
    /// Sum of the squared residuals.
    pub chi_square: f64,
    /// Variance of each parameter for residuals of variance 1; `None` if it sits on a bound or the data do not determine it.
    pub variance: Vec<Option<f64>>,
}

/// Jᵀ J and Jᵀ r at a point.
struct Normal {
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
}

/// Minimises Σ r² over `bounds` (low, high), from `start`. `residuals` fills the vector of all r for given parameters.
///
/// Marquardt's damping is relative to each parameter's own curvature, so their units do not matter.
pub(super) fn minimise(
    start: &[f64],
    bounds: &[(f64, f64)],
    residuals: &dyn Fn(&[f64], &mut Vec<f64>),
) -> Minimum {
    let clamp = |x: f64, k: usize| bounds.get(k).map_or(x, |(low, high)| x.clamp(*low, *high));
    let mut x: Vec<f64> = start
        .iter()
        .enumerate()
        .map(|(k, v)| clamp(*v, k))
        .collect();
    let mut r = Vec::new();
    residuals(&x, &mut r);
    let mut chi_square = sum_of_squares(&r);
    let mut damping = 1e-3;
    let mut normal = normal_equations(&x, &r, bounds, residuals);
    'outer: for _ in 0..MOST_ITERATIONS {
        let free = free_parameters(&x, bounds, &normal);
        if free.is_empty() {
            break;
        }
        loop {
            let Some(step) = damped_step(&normal, &free, damping) else {
                break 'outer;
            };
            let mut next = x.clone();
            for (s, &k) in step.iter().zip(&free) {
                next[k] = clamp(x[k] - s, k);
            }
            let mut next_r = Vec::with_capacity(r.len());
            residuals(&next, &mut next_r);
            let next_chi = sum_of_squares(&next_r);
            if next_chi < chi_square {
                let gain = chi_square - next_chi;
                (x, r, chi_square) = (next, next_r, next_chi);
                damping = (damping * 0.2).max(1e-12);
                normal = normal_equations(&x, &r, bounds, residuals);
                // For N residuals of variance 1 this is N·1e-10 in χ², a step of far less than a σ.
                if gain <= 1e-10 * chi_square {
                    break 'outer;
                }
                break;
            }
            damping *= 5.0;
            if damping > 1e9 {
                break 'outer;
            }
        }
    }
    let variance = variances(&x, &normal, bounds);
    Minimum {
        x,
        chi_square,
        variance,
    }
}

fn sum_of_squares(r: &[f64]) -> f64 {
    let sum: f64 = r.iter().map(|v| v * v).sum();
    if sum.is_finite() { sum } else { f64::INFINITY }
}

/// By one-sided differences that stay within the bounds. The step is the cube root of rounding, relative: error 1e-5 of J, which moves no minimum.
fn normal_equations(
    x: &[f64],
    r: &[f64],
    bounds: &[(f64, f64)],
    residuals: &dyn Fn(&[f64], &mut Vec<f64>),
) -> Normal {
    let n = x.len();
    let mut columns: Vec<Vec<f64>> = Vec::with_capacity(n);
    for k in 0..n {
        let mut step = 6e-6 * x[k].abs().max(1e-2);
        if x[k] + step > bounds[k].1 {
            step = -step;
        }
        let mut moved = x.to_vec();
        moved[k] += step;
        let mut column = Vec::with_capacity(r.len());
        residuals(&moved, &mut column);
        for (c, r) in column.iter_mut().zip(r) {
            *c = (*c - r) / step;
        }
        columns.push(column);
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    Normal {
        matrix: DMatrix::from_fn(n, n, |i, j| dot(&columns[i], &columns[j])),
        gradient: DVector::from_fn(n, |i, _| dot(&columns[i], r)),
    }
}

/// Parameters that have an effect and are not held at a bound by the slope.
fn free_parameters(x: &[f64], bounds: &[(f64, f64)], normal: &Normal) -> Vec<usize> {
    let gradient = &normal.gradient;
    (0..x.len())
        // The width of a lobe whose strength is 0 changes nothing.
        .filter(|&k| normal.matrix[(k, k)] > 0.0)
        .filter(|&k| {
            let (low, high) = bounds[k];
            !(x[k] <= low && gradient[k] >= 0.0 || x[k] >= high && gradient[k] <= 0.0)
        })
        .collect()
}

/// The matrix of the free parameters scaled to a unit diagonal, and the scales; `None` if one has no effect at all.
fn scaled(normal: &Normal, free: &[usize]) -> Option<(DMatrix<f64>, Vec<f64>)> {
    let scale: Vec<f64> = free.iter().map(|&k| normal.matrix[(k, k)].sqrt()).collect();
    if scale.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
        return None;
    }
    let n = free.len();
    let matrix = DMatrix::from_fn(n, n, |i, j| {
        normal.matrix[(free[i], free[j])] / (scale[i] * scale[j])
    });
    Some((matrix, scale))
}

fn damped_step(normal: &Normal, free: &[usize], damping: f64) -> Option<Vec<f64>> {
    let (mut matrix, scale) = scaled(normal, free)?;
    for i in 0..free.len() {
        matrix[(i, i)] += damping;
    }
    let right = DVector::from_fn(free.len(), |i, _| normal.gradient[free[i]] / scale[i]);
    let solution = matrix.cholesky()?.solve(&right);
    Some(solution.iter().zip(&scale).map(|(s, d)| s / d).collect())
}

/// Diagonal of (Jᵀ J)⁻¹ over the parameters off their bounds.
fn variances(x: &[f64], normal: &Normal, bounds: &[(f64, f64)]) -> Vec<Option<f64>> {
    let mut free: Vec<usize> = (0..x.len())
        .filter(|&k| x[k] > bounds[k].0 && x[k] < bounds[k].1)
        .collect();
    free.retain(|&k| normal.matrix[(k, k)] > 0.0);
    let mut variance = vec![None; x.len()];
    if let Some((matrix, scale)) = scaled(normal, &free)
        && let Some(cholesky) = matrix.cholesky()
    {
        let inverse = cholesky.inverse();
        for (i, &k) in free.iter().enumerate() {
            let value = inverse[(i, i)] / (scale[i] * scale[i]);
            // Of a unit-diagonal matrix; 1e10 is where the differences' own error (1e-5)² decides.
            if value.is_finite() && inverse[(i, i)] < 1e10 {
                variance[k] = Some(value);
            }
        }
    }
    variance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decay_is_found_with_its_covariance_and_bounds_are_kept() {
        let t: Vec<f64> = (0..50).map(|k| f64::from(k) * 0.1).collect();
        let model = |x: &[f64], t: f64| x[0] * (-x[1] * t).exp() + x[2];
        let data: Vec<f64> = t.iter().map(|&t| model(&[3.0, 1.3, 0.0], t)).collect();
        let residuals = |x: &[f64], r: &mut Vec<f64>| {
            r.clear();
            r.extend(t.iter().zip(&data).map(|(&t, d)| (model(x, t) - d) * 100.0));
        };
        let wide = [(0.0, 10.0), (0.0, 10.0), (-1.0, 1.0)];
        let found = minimise(&[1.0, 0.3, 0.5], &wide, &residuals);
        for (a, b) in found.x.iter().zip([3.0, 1.3, 0.0]) {
            assert!((a - b).abs() < 1e-6, "{found:?}");
        }
        // (JᵀJ)⁻¹ with exact derivatives.
        let j = DMatrix::from_fn(50, 3, |i, k| {
            let e = (-1.3 * t[i]).exp();
            100.0 * [e, -3.0 * t[i] * e, 1.0][k]
        });
        let exact = (j.transpose() * &j).try_inverse().expect("regular");
        for k in 0..3 {
            let v = found.variance[k].expect("determined");
            // One-sided differences, 1e-5 of J, magnified by the condition of the three curves.
            assert!((v / exact[(k, k)] - 1.0).abs() < 1e-2);
        }
        let narrow = [(0.0, 2.0), (0.0, 10.0), (-1.0, 1.0)];
        let found = minimise(&[1.0, 0.3, 0.5], &narrow, &residuals);
        assert_eq!(found.x[0], 2.0);
        assert!(found.variance[0].is_none() && found.variance[1].is_some());
    }
}
