//! The Fourier coefficients ρ̃_{p,q} of the recovered slice.

use std::f64::consts::TAU;

use faer::Mat;
use num_complex::Complex64;

use super::basis::Basis;
use super::prior::Factor;

/// The independent indices of a real, symmetric ρ̃ up to `order`: p ≥ |q|, p ≥ 0. The others follow from
/// ρ̃_{q,p} = ρ̃_{p,q} and ρ̃_{−p,−q} = conj ρ̃_{p,q}.
pub fn indices(order: usize) -> Vec<(i32, i32)> {
    (0..=order as i32)
        .flat_map(|p| (-p..=p).map(move |q| (p, q)))
        .collect()
}

/// Real and imaginary parts of ρ̃_{p,q} (eq. 6 in both angles) as functionals of the unknowns: two columns
/// for each of [`indices`].
pub fn functionals(basis: Basis, order: usize) -> Mat<f64> {
    let transform = basis.spectrum(order);
    let list = indices(order);
    let mut out = Mat::zeros(basis.pairs(), 2 * list.len());
    for (k, &(p, q)) in list.iter().enumerate() {
        let at = &transform[p as usize];
        let bt = &transform[q.unsigned_abs() as usize];
        for (m, a) in at.iter().enumerate() {
            for (n, b) in bt.iter().enumerate() {
                let b = if q < 0 { b.conj() } else { *b };
                let w: Complex64 = a * b / (TAU * TAU);
                let i = basis.pair(m, n);
                out[(i, 2 * k)] += w.re;
                out[(i, 2 * k + 1)] += w.im;
            }
        }
    }
    out
}

/// σ of each coefficient (root mean square of those of its real and imaginary part) for the functionals of
/// [`functionals`] under a factored precision.
pub fn sigmas(functionals: &Mat<f64>, factor: &Factor) -> Vec<f64> {
    let mut half = functionals.clone();
    factor.half_solve(&mut half);
    (0..half.ncols() / 2)
        .map(|k| {
            let square = |j: usize| half.col(j).squared_norm_l2();
            of_parts(square(2 * k), square(2 * k + 1)).sqrt()
        })
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
