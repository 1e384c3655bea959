//! The Fourier coefficients ρ̃_{p,q} of the recovered slice.

use std::f64::consts::TAU;

use faer::Mat;
use num_complex::Complex64;
use rayon::prelude::*;

use super::prior::Factor;
use super::space::Space;

/// The independent indices of a real, symmetric ρ̃ up to `order`: p ≥ |q|, p ≥ 0. The others follow from
/// ρ̃_{q,p} = ρ̃_{p,q} and ρ̃_{−p,−q} = conj ρ̃_{p,q}.
pub fn indices(order: usize) -> Vec<(i32, i32)> {
    (0..=order as i32)
        .flat_map(|p| (-p..=p).map(move |q| (p, q)))
        .collect()
}

/// Coefficients that are treated at a time, so that a high order does not fill the memory.
const AT_ONCE: usize = 64;

/// Real and imaginary parts of ρ̃_{p,q} (eq. 6 in both angles) as functionals of the unknowns: two columns for each
/// of [`indices`], handed to `read` some at a time, in order.
pub fn functionals<T>(
    space: &Space,
    order: usize,
    mut read: impl FnMut(&Mat<f64>) -> Vec<T>,
) -> Vec<T> {
    let basis = space.basis();
    let transform = basis.spectrum(order);
    let mut out = Vec::new();
    for some in indices(order).chunks(AT_ONCE) {
        let mut columns = Mat::<f64>::zeros(space.len(), 2 * some.len());
        columns
            .par_col_chunks_mut(2)
            .zip(some.par_iter())
            .for_each(|(mut column, &(p, q))| {
                let at = &transform[p as usize];
                let bt = &transform[q.unsigned_abs() as usize];
                let scale = (TAU * TAU).recip();
                let part = |m: usize, n: usize| {
                    let b = if q < 0 { bt[n].conj() } else { bt[n] };
                    scale * at[m] * b
                };
                for m in 0..basis.len() {
                    for n in 0..=m {
                        // c_{mn} and c_{nm}.
                        let mut w: Complex64 = part(m, n);
                        if m != n {
                            w += part(n, m);
                        }
                        space.each(m, n, |unknown, factor| {
                            column[(unknown, 0)] += factor * w.re;
                            column[(unknown, 1)] += factor * w.im;
                        });
                    }
                }
            });
        out.extend(read(&columns));
    }
    out
}

/// Variance of each functional of [`functionals`] under a factored precision.
pub fn variances(functionals: &Mat<f64>, factor: &Factor) -> Vec<f64> {
    let mut half = functionals.clone();
    factor.half_solve(&mut half);
    (0..half.ncols())
        .map(|j| half.col(j).squared_norm_l2())
        .collect()
}

/// Variance of each part of a coefficient from those of its real and imaginary part.
pub fn of_parts(re: f64, im: f64) -> f64 {
    // ρ̃_{0,0} and ρ̃_{p,−p} are real by symmetry; their imaginary functional is 0 but for rounding.
    if im <= 1e-12 * re {
        re
    } else {
        (re + im) / 2.0
    }
}
