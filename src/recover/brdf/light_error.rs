//! What the light's own error does to the slice.
//!
//! An error δL of the light changes the light field as much as the slice would have it, δB(α, θo′) = Σ δL_p H_p(θo′) e^{ipα} with
//! H_p = ∫ ρ̂ e^{ipθi′} dθi′ (eq. 11), and the slice follows it by the same linear map that it follows the noise by. All samples share it: a mean of many is
//! no better than one.

use faer::{Mat, Side};
use num_complex::Complex64;

use super::basis::Basis;
use super::fit::Fit;
use super::information::{Illumination, Sample};
use crate::error::{Error, Result};
use crate::light_field::{Column, Samples, Systematic};

/// How well the Fourier coefficients of one channel's light are known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightError {
    /// p > 0 of the coefficients L_p that have an error, \[F\].
    pub frequencies: Vec<usize>,
    /// Covariance of (Re L_p, Im L_p) over them, row-major, \[2F\]\[2F\], (W m⁻² rad⁻¹)².
    pub covariance: Vec<f64>,
}

/// What independent errors of the light, each one standard deviation long, do to the unknowns of `fit`, the slice of `channel` under
/// `light`: \[unknown\]\[error\]. Samples and systematic errors are those of the fit.
///
/// # Errors
/// If the covariance is not one of the frequencies, or could not be decomposed.
pub fn followed(
    fit: &Fit,
    samples: &Samples,
    channel: usize,
    systematics: &[Systematic],
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
    if size == 0 {
        return Ok(Mat::zeros(fit.space().len(), 0));
    }
    let covariance = Mat::from_fn(size, size, |i, j| error.covariance[i * size + j]);
    let eigen = covariance
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| Error::failed("the covariance of the light could not be decomposed"))?;
    let lengths = eigen.S().column_vector();
    let root = Mat::from_fn(size, size, |i, d| {
        eigen.U()[(i, d)] * lengths[d].max(0.0).sqrt()
    });
    let change = Change::new(fit, &error.frequencies);
    let seen = fit.information.right_sides(
        samples,
        channel,
        systematics,
        light,
        fit.noise,
        |column, samples| change.of_column(column, samples),
    )? * root;
    // As the slice follows the noise, with the prior's bias taken out ([`super::posterior`]).
    let covariance = &fit.posterior.covariance;
    let mut moved = covariance * seen;
    let bias = covariance * fit.prior.times_columns(&moved);
    moved += bias;
    Ok(moved)
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

    /// In σ, \[sample\]\[2F\].
    fn of_column(&self, column: &Column, samples: &[Sample]) -> Mat<f64> {
        let local = column.local.rad();
        let mut line = vec![0.0; self.basis.len()];
        for (n, value) in self.basis.at(local).iter() {
            for (m, z) in line.iter_mut().enumerate() {
                *z += value * self.slice[self.basis.pair(m, n)];
            }
        }
        let mut change = Mat::zeros(samples.len(), 2 * self.frequencies.len());
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
        change
    }
}
