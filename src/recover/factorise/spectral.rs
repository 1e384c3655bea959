//! The reciprocity eigenproblem: lighting from B̃_{p,q} alone, using every coefficient.

use std::f64::consts::TAU;

use faer::{Mat, Side};
use num_complex::Complex64;

use super::columns::Spectrum;
use super::half_circle::HalfCircle;
use crate::error::{Error, Result};
use crate::fourier::Series;

/// B̃_{p,q} for |p|, |q| ≤ order, and its noise.
#[derive(Clone, Debug)]
pub(super) struct Coefficients {
    order: i64,
    values: Vec<Complex64>,
    /// Variance of B̃_{p,q} (E|noise|²) by |p|, \[order + 1\]; the same for all q.
    pub variance: Vec<f64>,
}

impl Coefficients {
    /// B̃_{p,q} = (1/2π) ∫ B_p(θo′) cos θo′ e^{−iqθo′} dθo′ over the nodes.
    pub fn new(spectrum: &Spectrum, half: &HalfCircle) -> Self {
        let order = spectrum.order as i64;
        let width = 2 * spectrum.order + 1;
        let mut values = vec![Complex64::ZERO; width * width];
        // B̃ vanishes at the ends of the half circle, as the rule expects.
        let turns: Vec<Vec<Complex64>> = (-order..=order).map(|q| half.exponential(-q)).collect();
        for k in 0..half.len() {
            let weight = half.cosines[k] / TAU;
            for (i, p) in (-order..=order).enumerate() {
                let b = weight * spectrum.get(p, k);
                for (value, turn) in values[i * width..(i + 1) * width].iter_mut().zip(&turns) {
                    *value += b * turn[k];
                }
            }
        }
        let variance = (0..=spectrum.order)
            .map(|p| {
                (0..half.len())
                    .filter(|&k| spectrum.seen[k])
                    .map(|k| {
                        (half.step() * half.cosines[k] / TAU).powi(2) * spectrum.variance(p, k)
                    })
                    .sum()
            })
            .collect();
        Self {
            order,
            values,
            variance,
        }
    }

    /// B̃_{p,q}; zero beyond the order.
    pub fn get(&self, p: i64, q: i64) -> Complex64 {
        let width = 2 * self.order + 1;
        let index = (p + self.order) * width + q + self.order;
        if p.abs() > self.order || q.abs() > self.order {
            return Complex64::ZERO;
        }
        self.values
            .get(index as usize)
            .copied()
            .unwrap_or(Complex64::ZERO)
    }

    /// The largest frequency.
    pub fn order(&self) -> usize {
        self.order as usize
    }
}

/// The solution of the eigenproblem.
#[derive(Clone, Debug)]
pub(super) struct Start {
    /// L with L_0 = 1.
    pub lighting: Series,
    /// All eigenvalues, increasing, in units of what noise alone would give.
    pub eigenvalues: Vec<f64>,
}

/// Minimises Σ |B̃_{p,q} conj(L_q) − conj(B̃_{q,p}) L_p|² over unit L: the eigenvector of the smallest eigenvalue of
/// the (2P + 1)-square real symmetric matrix in (L_0, Re L_1, Im L_1, …), every equation weighted by
/// its noise. Then scaled to L_0 = 1.
pub(super) fn solve(coefficients: &Coefficients) -> Result<Start> {
    let order = coefficients.order;
    let size = 2 * order as usize + 1;
    let mut matrix = Mat::<f64>::zeros(size, size);
    let mut noise = vec![0.0; size];
    for p in 0..=order {
        for q in -order..=order {
            if p == q {
                continue;
            }
            let (vp, vq) = (
                coefficients.variance[p as usize],
                coefficients.variance[q.unsigned_abs() as usize],
            );
            let weight = 1.0 / (vp + vq).max(f64::MIN_POSITIVE);
            let (a, d) = (coefficients.get(p, q), -coefficients.get(q, p).conj());
            // Real and imaginary part as rows in the real unknowns.
            let mut row: Vec<(usize, [f64; 2])> = Vec::with_capacity(4);
            push(&mut row, q, a, true);
            push(&mut row, p, d, false);
            for &(i, x) in &row {
                for &(j, y) in &row {
                    matrix[(i, j)] += weight * (x[0] * y[0] + x[1] * y[1]);
                }
            }
            for (index, variance) in [(q.unsigned_abs() as usize, vp), (p as usize, vq)] {
                for i in [(2 * index).saturating_sub(1), 2 * index] {
                    noise[i] += weight * variance;
                    if index == 0 {
                        break;
                    }
                }
            }
        }
    }
    // In units of the noise's own contribution, so that eigenvalues near 1 are noise.
    let scale: Vec<f64> = noise
        .iter()
        .map(|n| n.max(f64::MIN_POSITIVE).sqrt())
        .collect();
    let scaled = Mat::from_fn(size, size, |i, j| matrix[(i, j)] / (scale[i] * scale[j]));
    let eigen = scaled.self_adjoint_eigen(Side::Lower).map_err(|_| {
        Error::failed("the reciprocity eigenproblem did not converge")
            .advice("Check the light field for missing or infinite values, or set a smaller band.")
    })?;
    let eigenvalues: Vec<f64> = eigen.S().column_vector().iter().copied().collect();
    // Of the eigenvectors at the noise level the one with the most of L_0 is the light that was there; the
    // others are free factors of components apart from it.
    let level = eigenvalues.first().copied().unwrap_or(0.0) * 2.0 + 1.0;
    let best = (0..size)
        .take_while(|&k| k == 0 || eigenvalues[k] < level)
        .max_by(|&a, &b| eigen.U()[(0, a)].abs().total_cmp(&eigen.U()[(0, b)].abs()))
        .unwrap_or(0);
    let vector: Vec<f64> = (0..size).map(|i| eigen.U()[(i, best)] / scale[i]).collect();
    let zero = vector[0];
    if zero.abs() <= 1e-9 * vector.iter().map(|v| v.abs()).fold(0.0, f64::max) || !zero.is_finite()
    {
        return Err(Error::failed(
            "the factorisation's mean light L_0 came out as zero, so the rest has no scale",
        )
        .advice("The light field may be dark or all noise: check exposure and black level."));
    }
    let mut lighting = Series::zero(order as usize);
    lighting.coefficients[0] = Complex64::ONE;
    for p in 1..=order as usize {
        lighting.coefficients[p] = Complex64::new(vector[2 * p - 1], vector[2 * p]) / zero;
    }
    Ok(Start {
        lighting,
        eigenvalues,
    })
}

/// Adds c · L_p (or c · conj L_p) to a row over the real unknowns.
fn push(row: &mut Vec<(usize, [f64; 2])>, p: i64, c: Complex64, conjugate: bool) {
    let index = p.unsigned_abs() as usize;
    if index == 0 {
        row.push((0, [c.re, c.im]));
        return;
    }
    // L_p = x + iy for p > 0, x − iy for p < 0; conjugation turns the sign once more.
    let sign = if (p < 0) != conjugate { -1.0 } else { 1.0 };
    row.push((2 * index - 1, [c.re, c.im]));
    row.push((2 * index, [-sign * c.im, sign * c.re]));
}
