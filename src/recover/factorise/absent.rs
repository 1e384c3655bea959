//! Frequencies that do not show in the light field: dark there, or invisible to this material?

use faer::Mat;
use num_complex::Complex64;

use super::columns::Spectrum;
use super::half_circle::HalfCircle;
use super::pairs::{Whitened, rows_of};
use super::refine::Refined;

/// L_p and the variance of its real part for a frequency that is not part of the fit, by regression of B_p on the
/// H_p(θo′) that the fitted ρ̃ gives it; `None` if that H_p is no more than its own uncertainty, so that p is invisible.
/// `changes` of Z by the lighting's uncertainty count into that: a Lambertian surface's odd H_p are differences of
/// even ones.
pub(super) fn lighting(
    frequency: usize,
    refined: &Refined,
    whitened: &Whitened,
    spectrum: &Spectrum,
    half: &HalfCircle,
    changes: &[Mat<f64>],
) -> Option<(Complex64, f64)> {
    let (pairs, posterior) = (&refined.pairs, &refined.posterior);
    let n = half.len();
    let rows = rows_of(&[frequency]);
    let weights = half.exponential(frequency as i64);
    let weight = whitened.weight.get(frequency).copied().unwrap_or(1.0);
    let root2 = std::f64::consts::SQRT_2;
    let exponentials = Mat::from_fn(rows.len(), n, |i, k| {
        let value = if i == 0 { weights[k].re } else { weights[k].im };
        root2 * weight * value / whitened.root[k]
    });
    let in_basis = &exponentials * &pairs.u;
    let response = &in_basis * &posterior.mean;
    let squares = Mat::from_fn(rows.len(), n, |i, a| in_basis[(i, a)].powi(2));
    let mut scatter = &squares * &posterior.variance;
    for change in changes {
        let moved = &in_basis * change;
        for b in 0..n {
            for i in 0..rows.len() {
                scatter[(i, b)] += moved[(i, b)].powi(2);
            }
        }
    }
    let data = Mat::from_fn(rows.len(), n, |i, k| {
        weight * whitened.precision[k].sqrt() * spectrum.values[(rows[i], k)]
    }) * &pairs.u;
    let (mut power, mut noise, mut product) = (0.0, 0.0, Complex64::ZERO);
    for b in 0..n.min(pairs.rows()) {
        let h = Complex64::new(response[(0, b)], response[(1, b)]);
        let spread = scatter[(0, b)] + scatter[(1, b)];
        // Unit noise in B_p and, since |L_p| ≤ 1, at most that of H_p.
        let weight = 1.0 / (1.0 + spread);
        power += weight * h.norm_sqr();
        noise += weight * spread;
        product += weight * h.conj() * Complex64::new(data[(0, b)], data[(1, b)]);
    }
    // Four times its noise: then the noise in H_p takes less than a quarter from the slope, which the information
    // below, without that noise, covers.
    let information = power - noise;
    (power > 4.0 * noise && information > 0.0).then(|| (product / information, 1.0 / information))
}
