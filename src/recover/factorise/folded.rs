//! What the views do not resolve: frequencies of sharp light that fold onto those that are fitted.
//!
//! Where a sun grazes the surface B(α) has a kink, and B_q falls off as 1/q² only. n views sample that, and q = n − p, n + p, …
//! appear at p. Their B_q = L_q (E X)_q / cos θo′ are known as well as ρ̃ and L_q are: ρ̃'s transform
//! at high q is that of its slopes at ±90°, and the L_q of sources go on from those that were found. So once the
//! factorisation has an answer, the sources in it say what was folded, and it is taken from the samples.

use faer::linalg::triangular_solve::solve_upper_triangular_in_place;
use faer::{Mat, Par};
use num_complex::Complex64;
use rayon::prelude::*;

use super::half_circle::HalfCircle;
use super::pairs::{Pairs, Whitened};
use super::refine::Refined;
use super::sources::Sources;
use crate::error::Result;
use crate::light_field::{Column, Samples};
use crate::recover::brdf::basis::Basis;

/// How many times the number of resolved frequencies are counted as folding: the sum of 1/q² beyond is below a tenth of
/// that within.
pub(super) const REACH: usize = 6;

/// ρ̃ as a smooth function that vanishes at ±90°, given a lighting: what goes on at frequencies that were not fitted.
pub(super) struct Surface {
    basis: Basis,
    /// Coefficients over pairs of splines, n × n, symmetric.
    coefficients: Mat<f64>,
}

impl Surface {
    /// On splines with as many knots as the light has frequencies, all of which it then sees.
    ///
    /// With V an orthonormal basis of the splines at the whitened nodes, Y = V Y′ Vᵀ, and Y′ is found by the same pairs as Y,
    /// each shrunk by one prior variance for all, the mean square of those that are seen.
    pub fn fit(whitened: &Whitened, half: &HalfCircle, refined: &Refined) -> Result<Self> {
        let band = whitened.frequencies.last().copied().unwrap_or(0);
        let basis = Basis::new(band);
        let mut splines = Mat::<f64>::zeros(half.len(), basis.len());
        for (k, &angle) in half.angles.iter().enumerate() {
            for (m, value) in basis.at(angle).iter() {
                splines[(k, m)] = whitened.root[k] * value;
            }
        }
        let factors = splines.qr();
        let v = factors.compute_thin_Q();
        let pairs = Pairs::new(
            &whitened.within(&v),
            &refined.lighting,
            &refined.systematics,
        )?;
        let along = pairs.along(&pairs.data);
        let n = basis.len();
        let (mut power, mut count) = (0.0, 0.0);
        for a in 0..n {
            for b in 0..n {
                if along[(a, b)].powi(2) > 25.0 && pairs.strength(a, b) > 0.0 {
                    power += (along[(a, b)] / pairs.strength(a, b)).powi(2);
                    count += 1.0;
                }
            }
        }
        let prior = power / f64::max(count, 1.0);
        let z = Mat::from_fn(n, n, |a, b| {
            let s = pairs.strength(a, b);
            prior * s * along[(a, b)] / (1.0 + prior * s * s)
        });
        // Y′ = R C Rᵀ.
        let mut half_way = &pairs.u * z * pairs.u.transpose();
        solve_upper_triangular_in_place(factors.thin_R(), half_way.as_mut(), Par::Seq);
        let mut coefficients = half_way.transpose().to_owned();
        solve_upper_triangular_in_place(factors.thin_R(), coefficients.as_mut(), Par::Seq);
        Ok(Self {
            basis,
            coefficients,
        })
    }

    /// ∫ ρ̃(θi′, θo′) e^{iqθi′} dθi′ by the coefficients of splines in θo′, frequencies × n.
    fn transforms(&self, frequencies: &[usize]) -> Vec<Vec<Complex64>> {
        let last = frequencies.last().copied().unwrap_or(0);
        let spectrum = self.basis.spectrum(last);
        frequencies
            .par_iter()
            .map(|&q| {
                (0..self.basis.len())
                    .map(|n| {
                        spectrum[q]
                            .iter()
                            .enumerate()
                            .map(|(m, h)| h.conj() * self.coefficients[(m, n)])
                            .sum()
                    })
                    .collect()
            })
            .collect()
    }
}

/// One channel's samples without what `sources` put into frequencies above `resolved` on `surface`. Of even circles of
/// views only what folds onto frequencies up to `order` is computed.
pub(super) fn without(
    samples: &Samples,
    channel: usize,
    surface: &Surface,
    sources: &Sources,
    resolved: usize,
    order: usize,
) -> Samples {
    let views = samples
        .columns
        .iter()
        .map(|c| c.alpha.len())
        .max()
        .unwrap_or(0)
        .max(1);
    let even = samples
        .columns
        .iter()
        .all(|c| c.regular() == Some(views) && views > 2 * resolved);
    let frequencies: Vec<usize> = (resolved + 1..=REACH * (resolved + 1))
        .filter(|q| !even || q % views <= order || q % views + order >= views)
        .collect();
    let transforms = surface.transforms(&frequencies);
    let columns = samples
        .columns
        .par_iter()
        .map(|column| {
            let local = surface.basis.at(column.local.rad());
            let cosine = column.local.visible_cosine().max(f64::MIN_POSITIVE);
            let folded: Vec<Complex64> = frequencies
                .iter()
                .zip(&transforms)
                .map(|(&q, h)| {
                    let h: Complex64 = local.iter().map(|(n, value)| value * h[n]).sum();
                    sources.coefficient(q) * h / cosine
                })
                .collect();
            let value = column
                .alpha
                .iter()
                .zip(&column.value[channel])
                .map(|(alpha, value)| value - sum(&frequencies, &folded, *alpha))
                .collect();
            Column {
                local: column.local,
                alpha: column.alpha.clone(),
                view: column.view.clone(),
                value: vec![value],
                variance: vec![column.variance[channel].clone()],
            }
        })
        .collect();
    Samples {
        channels: vec![samples.channels[channel].clone()],
        columns,
    }
}

/// Σ 2 Re c_q e^{iqα} over increasing frequencies.
fn sum(frequencies: &[usize], coefficients: &[Complex64], alpha: f64) -> f64 {
    let step = Complex64::cis(alpha);
    let mut before = 0;
    let mut turn = Complex64::ONE;
    let mut total = 0.0;
    for (&q, c) in frequencies.iter().zip(coefficients) {
        turn = if q == before + 1 {
            turn * step
        } else {
            Complex64::cis(q as f64 * alpha)
        };
        before = q;
        total += 2.0 * (c * turn).re;
    }
    total
}

/// Σ over the frequencies q that fold onto `p` with `views` views of 1/q⁴: the power of kinks there.
pub(super) fn power(p: usize, views: usize) -> f64 {
    (1..=REACH / 2)
        .flat_map(|m| [(m * views).abs_diff(p), m * views + p])
        .map(|q| (q as f64).powi(-4))
        .sum()
}
