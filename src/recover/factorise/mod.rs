//! Lighting and BRDF at once, from the light field alone (\[RH01\] section 5.3, and beyond).
//!
//! # The problem
//!
//! Per channel, with θo′ on N nodes of the half circle and X = ρ̃ a symmetric N × N matrix, the spectrum of the light
//! field along α is (eq. 11 and 5)
//!
//! ```text
//! B_p(θo′_k) = L_p (E X)_pk / cos θo′_k + noise,      (E X)_pk = ∫ ρ̃(θi′, θo′_k) e^{ipθi′} dθi′.
//! ```
//!
//! Unknown are all L_p and all of X. Only two things tie them together: the support (E is an integral over the half
//! circle) and reciprocity (X is symmetric). One complex factor per component of the reciprocity graph is free; L_0 = 1
//! fixes the first.
//!
//! # Pairs
//!
//! Divide every column by its noise: B′ = A′ Y with Y = D^½ X D^½ symmetric, D_k = (precision of column k) / cos² θ_k, and
//! A′(L) = diag(L) E D^{−½} **the same matrix for all columns**. With A′ = Q S Uᵀ, B″ = Qᵀ B′ U and Z = Uᵀ Y U the model
//! is B″ = S Z: every unknown z_ab = z_ba of the N(N+1)/2 is seen exactly twice, as B″_ab = s_a z_ab and B″_ba = s_b z_ab,
//! with independent unit noise. So, given L, the problem falls into pairs, and each pair has
//!
//! * data **along** the model, y∥ = (s_a B″_ab + s_b B″_ba) / |s| = |s| z_ab + noise: they tell z, that is ρ;
//! * data **across** it, y⊥ = (s_b B″_ab − s_a B″_ba) / |s| = 0 + noise: they tell L, and only L.
//!
//! Σ y⊥² is minus twice the log-likelihood maximised over every reciprocal ρ̃, exactly; no grid of ρ̃ is ever solved for,
//! and nodes beyond the limb cut are unknowns like the others (they are given a variance as large as the signal).
//!
//! # The estimator
//!
//! L moves y⊥ by J_k = the across part of (∂A′/∂L_k) Z. The estimate solves Ĵᵀ y⊥ = 0, by Gauss–Newton steps
//! (ĴᵀĴ)⁻¹ Ĵᵀ y⊥, with Ĵ from an estimate Ẑ of Z. *Any* Ẑ that is a function of y∥ gives an estimate without bias to first
//! order, whatever prior it uses, because the noise of y⊥ is independent of that of y∥. That is the answer to
//! the fault of joint minima, in which a prior on ρ pulls L (here it would do so through (1 − κ) y∥² terms, which
//! favour large |s| and make L too sharp): the prior never meets the score of L. It only weighs the pairs. Where
//! z_ab does not rise above its noise, Ẑ is shrunk to 0 and the pair has no say, as it has no information; a pair with full
//! weight there would add noise. This is the efficient score of semiparametric statistics (B. G. Lindsay, Biometrika
//! 69, 1982, for nuisance parameters with sufficient statistics).
//!
//! The covariance of L is (JᵀJ)⁻¹; taken at the truth it is the Cramér–Rao bound of the unregularised problem. The only
//! prior on L is |L_p| ≤ L_0, which every non-negative light obeys, as a variance of L_0²/2 per real part; what the data leave
//! at that is reported `indeterminate`.
//!
//! Errors that all samples share, as those of the geometry, are unknowns beside L with a normal prior each: what they do to the data
//! across the model is their part of J, and both parts of the data are taken without them.
//!
//! Frequencies that do not rise above the noise in any column are left out of the fit, which biases nothing; then
//! they are regressed on the H_p of the fitted ρ̃: they come out dark where H_p is seen, else invisible.
//!
//! The start is the eigenproblem (`spectral`) over all (p, q); eq. 29 is in `ratio`.
//!
//! # Limits
//!
//! Pairs are exact if the noise of a column is the same for all its coefficients (a complete circle of views with even
//! noise). Otherwise the mean variance of the column is used: the estimate stays unbiased, loses some efficiency, and its σ
//! is that of the true noise carried through.
//!
//! Light that is not band-limited (a sun) leaves kinks in B(α) where it grazes; their frequencies n − p beyond those that
//! the n views resolve fold onto p with about (p / (n − p))² of its amplitude. Where that rises above the noise of a
//! column it is added to its variance; then the sources in the light that was found say what folds, and it is taken from the
//! samples (`folded`, `sources`). What sharp light without sources folds, an edge of a wide lamp, stays a variance.
//!
//! ρ̃ stands on nodes as far apart as the columns, and frequencies that turn by more than 0.95 radians from node to node are left out: with
//! columns of 3° and 0.01 % noise the error for velvet, whose ρ̃ has a layer at the limb that nodes do not resolve, was 2.5 times the bound
//! with frequencies up to 2.5 radians, 1.3 times up to 1.25, and 1.1 times up to this.
//!
//! Beyond the limb cut the guess that serves as a weak prior has the error that the same guess has inside the cut; where
//! lobes change their character in the part that was never seen, σ is too small.

mod absent;
mod channel;
mod column_fit;
mod columns;
mod folded;
mod gauge;
mod half_circle;
mod pairs;
mod parametric;
mod posterior;
mod ratio;
mod refine;
mod scale;
mod settle;
mod slice;
mod sources;
mod spectral;
#[cfg(test)]
mod study;
#[cfg(test)]
mod tests;
mod uncertainty;
mod unfold;
mod warnings;

use std::f64::consts::SQRT_2;

use num_complex::Complex64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use channel::recover_channel;
use columns::Spectrum;
pub use warnings::MISFIT;
use warnings::warnings;

use crate::angle::{LocalAngle, WorldAngle};
use crate::error::Result;
use crate::fourier::Series;
use crate::light_field::{Samples, Systematic};
use crate::lighting::Status;

pub use parametric::{ParametricChannel, ParametricFit, parametric};
pub use scale::Scale;

/// The largest order that is fitted unless a band is asked for.
const LARGEST_ORDER: usize = 64;

/// What the user may set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Largest frequency; `None`: as far as the views resolve and the signal goes.
    pub band: Option<usize>,
    /// What fixes the scale.
    pub scale: Scale,
    /// Whether the start is refined; without, the result is the eigenproblem's.
    pub refine: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            band: None,
            scale: Scale::Unit,
            refine: true,
        }
    }
}

/// Largest σ of a coefficient called determined, relative to L_0: the range |L_p| ≤ L_0 that any light has is then
/// narrowed more than twentyfold.
const DETERMINED: f64 = 0.05;
/// Largest σ of a coefficient called weak; beyond, it is hardly known better than for any light.
const WEAK: f64 = 0.4;

/// Lighting and BRDF of all channels.
#[derive(Clone, Debug)]
pub struct Factorisation {
    /// θ′ of the nodes of the half grid, \[N\].
    pub nodes: Vec<LocalAngle>,
    /// One result per channel.
    pub channels: Vec<Channel>,
    /// What a reader must know, in plain sentences.
    pub warnings: Vec<String>,
}

/// Lighting and BRDF of one channel.
#[derive(Clone, Debug)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// L_p, W m⁻² rad⁻¹, up to `band`; 0 where indeterminate.
    pub lighting: Series,
    /// σ of L_p (of the complex number: √(var Re + var Im)), \[band + 1\]; L_0 is held by the scale.
    pub sigma: Vec<f64>,
    /// How well L_p is known, \[band + 1\].
    pub status: Vec<Status>,
    /// Covariance of (Re L_p, Im L_p) over `frequencies` without the first, row-major.
    pub covariance: Vec<f64>,
    /// What was found of the errors that all samples share; what is open of them is in `covariance` and `sigma`.
    pub systematics: Systematics,
    /// The frequencies up to `band` that show in the light field, the first 0.
    pub frequencies: Vec<usize>,
    /// Largest frequency that is recovered.
    pub band: usize,
    /// Largest frequency that shows in the light field above its noise.
    pub visible_band: usize,
    /// Largest frequency that the views resolve.
    pub resolved: usize,
    /// Sources in the light, which go on with L_p beyond `band`: direction and irradiance, W m⁻². Looked for only where
    /// frequencies that the views do not resolve show in the light field.
    pub sources: Vec<(WorldAngle, f64)>,
    /// ρ(θi′, θo′), sr⁻¹, at the nodes, N × N, symmetric, at the resolution of the light's band.
    pub brdf: Vec<f64>,
    /// σ of ρ, N × N.
    pub brdf_sigma: Vec<f64>,
    /// Eigenvalues of the reciprocity problem, increasing, in units of the noise: those near 1 are not determined.
    pub eigenvalues: Vec<f64>,
    /// Components of the reciprocity graph, that of p = 0 first.
    pub components: Vec<Vec<usize>>,
    /// The eigenproblem's lighting, in the same scale.
    pub start: Series,
    /// Eq. 29's lighting, in the same scale.
    pub ratio: Series,
    /// Mean square of the reciprocity residuals in units of the noise: 1 if model and noise are right.
    pub misfit: f64,
    /// The part of the light field (rms) that breaks reciprocity beyond the noise, whatever the light.
    pub violation: f64,
    /// Where the scale comes from.
    pub scale: String,
    /// Whether the refinement settled.
    pub converged: bool,
}

/// Errors that all samples of a channel share, fitted along with the light.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Systematics {
    /// Each, in its standard deviations as given.
    pub found: Vec<f64>,
    /// What is still open of them: independent of each other, each one standard deviation long.
    pub open: Vec<OpenError>,
}

/// A combination of errors that all samples share, and the error of the light that goes with it.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenError {
    /// How much of each error, in its standard deviations as given.
    pub errors: Vec<f64>,
    /// What it does to L_p, W m⁻² rad⁻¹.
    pub light: Series,
}

impl Systematics {
    /// Of `count` errors no more is known than is given.
    fn unknown(count: usize) -> Self {
        let open = (0..count).map(|s| OpenError {
            errors: (0..count).map(|i| f64::from(i == s)).collect(),
            light: Series::zero(0),
        });
        Self {
            found: vec![0.0; count],
            open: open.collect(),
        }
    }
}

/// Factorises the light field of every channel.
///
/// # Errors
/// If there are too few columns or samples, if a given scale is unusable, or if a decomposition fails. A light field that does
/// not change with the normal is no error: all but L_0 is then indeterminate, and the warnings say so.
pub fn recover(samples: &Samples, options: &Options) -> Result<Factorisation> {
    recover_with(samples, &[], options)
}

/// The same with errors that all samples share, as those of the geometry: each is fitted along with a normal prior of one
/// standard deviation, so that σ and covariance hold what they leave open.
///
/// # Errors
/// As [`recover`].
pub fn recover_with(
    samples: &Samples,
    systematics: &[Systematic],
    options: &Options,
) -> Result<Factorisation> {
    let half = columns::half_circle(samples)?;
    let channels: Vec<Channel> = (0..samples.channels.len())
        .into_par_iter()
        .map(|channel| recover_channel(samples, systematics, channel, &half, options))
        .collect::<Result<_>>()?;
    let warnings = channels.iter().flat_map(warnings).collect();
    Ok(Factorisation {
        nodes: half
            .angles
            .iter()
            .map(|a| LocalAngle::radians(*a))
            .collect(),
        channels,
        warnings,
    })
}

/// B_p of every column of `channel` up to the frequency that the views resolve; `None` where a column has no samples.
pub fn spectra(samples: &Samples, channel: usize) -> Vec<Option<Series>> {
    let order = columns::resolved_order(samples, channel);
    let expected = column_fit::Expected::of(samples, channel, order);
    samples
        .columns
        .par_iter()
        .map(|column| {
            let fit = column_fit::ColumnFit::new(column, channel, order, expected.as_ref())?;
            let values = fit.values(&[column.value.get(channel)?]).pop()?;
            let coefficients = (0..=order).map(|p| match p {
                0 => Complex64::from(values[0]),
                _ => Complex64::new(values[2 * p - 1], values[2 * p]) / SQRT_2,
            });
            Some(Series {
                coefficients: coefficients.collect(),
            })
        })
        .collect()
}

/// Covariance of (Re L_p, Im L_p), p = 1 … order, row-major, \[2·order\]\[2·order\], at the Cramér–Rao bound for L_0 known, for `truth` and samples
/// `clean` of its light field that hold the noise's variance but no noise; over the frequencies 0 … order.
///
/// # Errors
/// As [`recover`].
pub fn cramer_rao(
    clean: &Samples,
    channel: usize,
    truth: &Series,
    order: usize,
) -> Result<Vec<f64>> {
    let half = columns::half_circle(clean)?;
    let mut spectrum = Spectrum::fit(clean, channel, &half, order, 1.0)?;
    spectrum.forget_guesses();
    let frequencies: Vec<usize> = (0..=order).collect();
    let covariance = uncertainty::bound(&spectrum, &half, truth, &frequencies)?;
    let size = 2 * order;
    Ok((0..size)
        .flat_map(|i| (0..size).map(move |j| (i, j)))
        .map(|at| covariance[at])
        .collect())
}
