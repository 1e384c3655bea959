//! What the light's own error does to the slice.
//!
//! An error δL of the light changes the light field as much as the slice would have it, δB(α, θo′) = Σ δL_p H_p(θo′) e^{ipα} with
//! H_p = ∫ ρ̂ e^{ipθi′} dθi′ (eq. 11), and the slice follows it by the same linear map that it follows the noise by. All samples share it: a mean of many is
//! no better than one. Errors that were found together with the light change the samples beside it, and reach the slice in the same way. Nothing is learnt
//! of any of them here: the light was found in these samples, and what they say of it they have said.

use faer::{Mat, MatMut, Side};
use num_complex::Complex64;

use super::basis::Basis;
use super::fit::Fit;
use super::information::{Illumination, Sample, changed};
use crate::error::{Error, Result};
use crate::light_field::{Column, Samples};

/// How well one channel's light is known, and what was found along with it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightError {
    /// p > 0 of the coefficients L_p that have an error, \[F\].
    pub frequencies: Vec<usize>,
    /// Covariance of (Re L_p, Im L_p) over them, row-major, \[2F\]\[2F\], (W m⁻² rad⁻¹)².
    pub covariance: Vec<f64>,
    /// What else changes the samples, each one standard deviation long and independent of the others: \[error\]\[column\]\[sample\], W m⁻² sr⁻¹.
    pub changes: Vec<Vec<Vec<f64>>>,
}

/// What independent errors of the light and of what was found with it, each one standard deviation long, do to the unknowns of `fit`, the slice of
/// `channel` under `light`: \[unknown\]\[error\]. The samples are those of the fit, without systematic errors of its own.
///
/// # Errors
/// If the covariance is not one of the frequencies, or could not be decomposed.
pub fn followed(
    fit: &Fit,
    samples: &Samples,
    channel: usize,
    light: &Illumination,
    error: &LightError,
) -> Result<Mat<f64>> {
    let size = 2 * error.frequencies.len();
    if error.covariance.len() != size * size {
        return Err(Error::input(format!(
            "expected a covariance of {size} × {size} for the errors of the light, got {} numbers",
            error.covariance.len()
        )));
    }
    let others = error.changes.len();
    if size + others == 0 {
        return Ok(Mat::zeros(fit.space().len(), 0));
    }
    let of_light = root(size, &error.covariance)?;
    let root = Mat::from_fn(size + others, size + others, |i, d| {
        if i < size && d < size {
            of_light[(i, d)]
        } else {
            f64::from(i == d)
        }
    });
    let change = Change::new(fit, &error.frequencies);
    let of_column = |j: usize, column: &Column, samples: &[Sample]| {
        let mut all = Mat::zeros(samples.len(), size + others);
        let (by_light, beside) = all.as_mut().split_at_col_mut(size);
        change.of_column(column, samples, by_light);
        let changes: Vec<&[f64]> = error
            .changes
            .iter()
            .map(|c| c.get(j).map_or(&[][..], Vec::as_slice))
            .collect();
        { beside }.copy_from(changed(samples, &changes));
        all
    };
    let information = &fit.information;
    let seen = information.right_sides(samples, channel, light, fit.noise, of_column) * root;
    // As the slice follows the noise, with the prior's bias taken out ([`super::posterior`]).
    let covariance = &fit.posterior.covariance;
    let mut moved = covariance * seen;
    let bias = covariance * fit.prior.times_columns(&moved);
    moved += bias;
    Ok(moved)
}

/// R of C = R Rᵀ, of a row-major C \[size\]\[size\].
fn root(size: usize, covariance: &[f64]) -> Result<Mat<f64>> {
    // The decomposition takes no empty matrix.
    if size == 0 {
        return Ok(Mat::zeros(0, 0));
    }
    let eigen = Mat::from_fn(size, size, |i, j| covariance[i * size + j])
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| Error::failed("the covariance of the light could not be decomposed"))?;
    let lengths = eigen.S().column_vector();
    Ok(Mat::from_fn(size, size, |i, d| {
        eigen.U()[(i, d)] * lengths[d].max(0.0).sqrt()
    }))
}

/// The change of the samples by Re L_p and Im L_p.
struct Change<'a> {
    basis: Basis,
    frequencies: &'a [usize],
    /// ∫ φ_m e^{−ipθ} dθ, \[p\]\[m\].
    waves: Vec<Vec<Complex64>>,
    /// The slice's coefficients.
    slice: Vec<f64>,
}

impl<'a> Change<'a> {
    fn new(fit: &Fit, frequencies: &'a [usize]) -> Self {
        let basis = fit.space().basis();
        Self {
            waves: basis.spectrum(frequencies.iter().copied().max().unwrap_or(0)),
            slice: fit.space().coefficients(&fit.posterior.mean),
            basis,
            frequencies,
        }
    }

    /// In σ, to `change` \[sample\]\[2F\].
    fn of_column(&self, column: &Column, samples: &[Sample], mut change: MatMut<f64>) {
        let local = column.local.rad();
        let mut line = vec![0.0; self.basis.len()];
        for (n, value) in self.basis.at(local).iter() {
            for (m, z) in line.iter_mut().enumerate() {
                *z += value * self.slice[self.basis.pair(m, n)];
            }
        }
        for (k, &p) in self.frequencies.iter().enumerate() {
            let waves = self.waves[p].iter().zip(&line);
            // B cos θo′ = Σ L_p H_p e^{ipα}, of which −p gives as much again.
            let response: Complex64 = waves.map(|(wave, z)| wave.conj() * z).sum();
            let response = 2.0 * response / local.cos();
            for (i, sample) in samples.iter().enumerate() {
                let wave = sample.root * response * Complex64::cis(p as f64 * sample.alpha);
                change[(i, 2 * k)] = wave.re;
                change[(i, 2 * k + 1)] = -wave.im;
            }
        }
    }
}
