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
//! Beyond the limb cut the guess that serves as a weak prior has the error that the same guess has inside the cut; where
//! lobes change their character in the part that was never seen, σ is too small.

mod absent;
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
mod slice;
mod sources;
mod spectral;
#[cfg(test)]
mod study;
#[cfg(test)]
mod tests;
mod uncertainty;

use num_complex::Complex64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use columns::Spectrum;
use half_circle::HalfCircle;
use pairs::{Pairs, Whitened};
use sources::Sources;
use spectral::Coefficients;

use crate::angle::LocalAngle;
use crate::error::{Error, Result};
use crate::fourier::Series;
use crate::light_field::Samples;
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
    /// The frequencies up to `band` that show in the light field, the first 0.
    pub frequencies: Vec<usize>,
    /// Largest frequency that is recovered.
    pub band: usize,
    /// Largest frequency that shows in the light field above its noise.
    pub visible_band: usize,
    /// Largest frequency that the views resolve.
    pub resolved: usize,
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
    /// Where the scale comes from.
    pub scale: String,
    /// Whether the refinement settled.
    pub converged: bool,
}

/// Factorises the light field of every channel.
///
/// # Errors
/// If there are too few columns or samples, if a given scale is unusable, or if a decomposition fails. A light field that does
/// not change with the normal is no error: all but L_0 is then indeterminate, and the warnings say so.
pub fn recover(samples: &Samples, options: &Options) -> Result<Factorisation> {
    let half = columns::half_circle(samples)?;
    let channels: Vec<Channel> = (0..samples.channels.len())
        .into_par_iter()
        .map(|channel| recover_channel(samples, channel, &half, options))
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

/// σ of L_1 … L_order at the Cramér–Rao bound for L_0 known, for `truth` and samples `clean` of its light field that hold
/// the noise's variance but no noise; over the frequencies 0 … order, \[order + 1\] with 0 for L_0.
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
    let mut spectrum = Spectrum::fit(clean, channel, &half, order)?;
    spectrum.forget_guesses();
    let frequencies: Vec<usize> = (0..=order).collect();
    let covariance = uncertainty::bound(&spectrum, &half, truth, &frequencies)?;
    let mut bound = vec![0.0];
    for p in 1..=order {
        bound
            .push((covariance[(2 * p - 2, 2 * p - 2)] + covariance[(2 * p - 1, 2 * p - 1)]).sqrt());
    }
    Ok(bound)
}

/// The frequencies whose power over the columns exceeds the noise's by five of its standard deviations.
fn visible(spectrum: &Spectrum) -> Vec<usize> {
    let columns = spectrum.seen.iter().filter(|s| **s).count() as f64;
    let mut frequencies = vec![0];
    for (p, power) in spectrum.signal_to_noise().into_iter().enumerate().skip(1) {
        // A mean of 2 · columns squares scatters by √(2 / (2 · columns)).
        if power > 1.0 + 5.0 / columns.sqrt() {
            frequencies.push(p);
        }
    }
    frequencies
}

/// The number of frequencies of the first stage.
const FIRST_STAGE: usize = 8;

/// The eigenproblem's result at the full band, and the refinement.
///
/// The refinement begins with the eigenproblem of the lowest frequencies, which is well determined; the higher ones
/// join at their regression on the ρ̃ so found. At the noise of the highest frequencies the eigenproblem of the full
/// band can be far off; it is tried if the first way ends badly, and the better fit is kept.
fn fit(
    spectrum: &Spectrum,
    half: &HalfCircle,
    frequencies: &[usize],
    options: &Options,
) -> Result<(spectral::Start, refine::Refined)> {
    let full = spectral::solve(&Coefficients::new(spectrum, half))?;
    let whitened = Whitened::new(spectrum, half, frequencies);
    let start = within_light(&full.lighting, frequencies);
    if !options.refine {
        let refined = refine::held(&whitened, &start)?;
        return Ok((full, refined));
    }
    let first = frequencies.len().min(FIRST_STAGE + 1);
    let low = if first < frequencies.len() {
        let order = frequencies[first - 1];
        let low = spectral::solve(&Coefficients::new(&spectrum.truncated(order), half))?;
        let lighting = within_light(&low.lighting.with_order(spectrum.order), frequencies);
        let stage = Whitened::new(spectrum, half, &frequencies[..first]);
        let refined = refine::refine(&stage, &lighting)?;
        let mut lighting = refined.lighting.clone();
        for &p in &frequencies[first..] {
            if let Some((l, _)) = absent::lighting(p, &refined, &stage, spectrum, half, &[]) {
                lighting.coefficients[p] = l;
            }
        }
        within_light(&lighting, frequencies)
    } else {
        start.clone()
    };
    let mut refined = refine::refine(&whitened, &low)?;
    let (misfit, count) = refined.pairs.misfit();
    if first < frequencies.len() && (!refined.converged || misfit > 1.2 * count as f64) {
        let other = refine::refine(&whitened, &start)?;
        if other.pairs.misfit().0 < misfit {
            refined = other;
        }
    }
    Ok((full, refined))
}

/// The coefficients of `frequencies`, cut to |L_p| ≤ L_0 = 1: no light that is nowhere negative has more.
fn within_light(lighting: &Series, frequencies: &[usize]) -> Series {
    let mut within = Series::zero(lighting.order());
    for &p in frequencies {
        let l = lighting.get(p as i64);
        within.coefficients[p] = l / l.norm().max(1.0);
    }
    within
}

/// A factorisation at the largest band at which it settles.
struct Settled {
    spectrum: Spectrum,
    frequencies: Vec<usize>,
    whitened: Whitened,
    start: spectral::Start,
    refined: refine::Refined,
}

/// Factorises at the largest band at which the refinement settles: beyond it the weakest frequencies drag the others
/// along. `from` is a lighting to begin with, if there is one.
fn settle(
    spectrum: &Spectrum,
    half: &HalfCircle,
    options: &Options,
    from: Option<&Series>,
) -> Result<Settled> {
    let mut frequencies = visible(spectrum);
    loop {
        let band = frequencies.last().copied().unwrap_or(0);
        let cut = spectrum.truncated(band);
        let whitened = Whitened::new(&cut, half, &frequencies);
        if let Some(lighting) = from {
            let refined = refine::refine(
                &whitened,
                &within_light(&lighting.with_order(band), &frequencies),
            )?;
            if refined.converged {
                let start = spectral::solve(&Coefficients::new(&cut, half))?;
                return Ok(Settled {
                    spectrum: cut,
                    frequencies,
                    whitened,
                    start,
                    refined,
                });
            }
        }
        let (start, refined) = fit(&cut, half, &frequencies, options)?;
        if refined.converged || frequencies.len() <= FIRST_STAGE {
            return Ok(Settled {
                spectrum: cut,
                frequencies,
                whitened,
                start,
                refined,
            });
        }
        frequencies.truncate((frequencies.len() * 3).div_ceil(4));
    }
}

/// Most rounds of taking folded frequencies from the samples.
const UNFOLDINGS: usize = 3;
/// Share of the folded amplitude that is always taken to be left.
const LEFT: f64 = 0.1;
/// Change of what is folded, relative to it, at which no further round is needed.
const UNFOLDED: f64 = 0.02;

/// The factorisation again, without what unresolved frequencies of the sources in it fold onto the others.
///
/// What is left of them is a share of what was there: at least [`LEFT`], and as much as brings the misfit down to 1. The
/// result counts if it lowers the misfit in units of the noise alone.
fn unfold(
    samples: &Samples,
    channel: usize,
    half: &HalfCircle,
    options: &Options,
    folded: &Spectrum,
    first: Settled,
) -> Result<Settled> {
    let order = folded.order;
    let resolved = columns::resolved_order(samples, channel);
    let mut left = LEFT * LEFT;
    let mut before: Option<Sources> = None;
    let mut best = None;
    for _ in 0..UNFOLDINGS {
        let at = best.as_ref().unwrap_or(&first);
        let covariance = uncertainty::covariance(&at.refined, &at.whitened, &at.spectrum)?;
        let Some(sources) = Sources::find(&at.refined.lighting, &at.frequencies, &covariance)
        else {
            break;
        };
        if before.is_some_and(|b| b.change(&sources, 2 * resolved) < UNFOLDED) {
            break;
        }
        let surface = folded::Surface::fit(&at.whitened, half, &at.refined.lighting)?;
        let without = folded::without(samples, channel, &surface, &sources, resolved, order);
        let mut spectrum = Spectrum::fit(&without, 0, half, resolved)?.truncated(order);
        spectrum.folds.clone_from(&folded.folds);
        spectrum.folded = folded.folded.iter().map(|f| left * f).collect();
        let next = settle(&spectrum, half, options, Some(&at.refined.lighting))?;
        let (sum, count) = next.refined.pairs.misfit();
        left = (left * sum / count.max(1) as f64).clamp(LEFT * LEFT, 1.0);
        before = Some(sources);
        best = Some(next);
    }
    let best = match best {
        Some(best) if noise_misfit(&best, half)? < noise_misfit(&first, half)? => best,
        _ => first,
    };
    Ok(best)
}

/// Mean square of the constraints in units of the noise alone.
fn noise_misfit(settled: &Settled, half: &HalfCircle) -> Result<f64> {
    let mut spectrum = settled.spectrum.clone();
    spectrum.folded.fill(0.0);
    let whitened = Whitened::new(&spectrum, half, &settled.frequencies);
    let (sum, count) = Pairs::new(&whitened, &settled.refined.lighting)?.misfit();
    Ok(sum / count.max(1) as f64)
}

/// The result where the light field does not change with the normal: uniform light, or a surface that passes nothing
/// else. Only L_0 is called known, and of ρ no value.
fn unchanging(
    samples: &Samples,
    channel: usize,
    half: &HalfCircle,
    options: &Options,
    spectrum: &Spectrum,
    resolved: usize,
) -> Result<Channel> {
    let spectrum = spectrum.truncated(0);
    let coefficients = Coefficients::new(&spectrum, half);
    let mut lighting = Series::zero(0);
    lighting.coefficients[0] = Complex64::ONE;
    let (factor, scale) = scale::factor(&options.scale, channel, &lighting, 0, &coefficients)?;
    lighting.coefficients[0] *= factor;
    Ok(Channel {
        name: samples.channels[channel].clone(),
        sigma: vec![0.0],
        status: vec![Status::Determined],
        covariance: Vec::new(),
        components: vec![vec![0]],
        frequencies: vec![0],
        band: 0,
        visible_band: 0,
        resolved,
        brdf: vec![0.0; half.len() * half.len()],
        brdf_sigma: vec![f64::INFINITY; half.len() * half.len()],
        eigenvalues: Vec::new(),
        start: lighting.clone(),
        ratio: lighting.clone(),
        lighting,
        misfit: 1.0,
        scale,
        converged: true,
    })
}

/// `by` times a matrix, row by row.
fn row_major(m: &faer::Mat<f64>, by: f64) -> Vec<f64> {
    (0..m.nrows())
        .flat_map(|i| (0..m.ncols()).map(move |j| (i, j)))
        .map(|(i, j)| by * m[(i, j)])
        .collect()
}

fn recover_channel(
    samples: &Samples,
    channel: usize,
    half: &HalfCircle,
    options: &Options,
) -> Result<Channel> {
    let resolved = columns::resolved_order(samples, channel);
    // Beyond two radians per node the exponentials are not integrated well.
    let order = options
        .band
        .unwrap_or(LARGEST_ORDER)
        .min(resolved)
        .min((2.0 / half.step()) as usize);
    if order == 0 {
        return Err(Error::input(format!(
            "factorisation needs views that resolve at least one frequency of the light, found {resolved}"
        ))
        .advice("Photograph the object from more directions around it."));
    }
    let mut spectrum = Spectrum::fit(samples, channel, half, resolved)?;
    spectrum.add_folded_variance();
    let spectrum = spectrum.truncated(order);
    let visible_band = visible(&spectrum).last().copied().unwrap_or(0);
    if visible_band == 0 {
        return unchanging(samples, channel, half, options, &spectrum, resolved);
    }
    let mut settled = settle(&spectrum, half, options, None)?;
    if options.refine && spectrum.folded.iter().any(|v| *v > 0.0) {
        settled = unfold(samples, channel, half, options, &spectrum, settled)?;
    }
    let Settled {
        spectrum,
        frequencies,
        whitened,
        start,
        refined,
    } = settled;
    let band = spectrum.order;
    let coefficients = Coefficients::new(&spectrum, half);
    let covariance = uncertainty::covariance(&refined, &whitened, &spectrum)?;
    let (sum, count) = refined.pairs.misfit();
    let misfit = sum / (count as f64 - covariance.nrows() as f64).max(1.0);
    // A misfit beyond its own scatter is a fault of model or noise: σ grows with it.
    let excess = if misfit > 1.0 + 4.0 * (2.0 / count as f64).sqrt() {
        misfit
    } else {
        1.0
    };
    let covariance = covariance * faer::Scale(excess);

    let changes = slice::lighting_changes(&refined, &whitened, &covariance);

    let mut lighting = refined.lighting.clone();
    // √(var Re + var Im) of the prior where nothing is known.
    let mut sigma = vec![1.0; band + 1];
    sigma[0] = 0.0;
    for (i, &p) in frequencies.iter().enumerate().skip(1) {
        sigma[p] = (covariance[(2 * i - 2, 2 * i - 2)] + covariance[(2 * i - 1, 2 * i - 1)]).sqrt();
    }
    for p in (1..=band).filter(|p| !frequencies.contains(p)) {
        if let Some((l, variance)) =
            absent::lighting(p, &refined, &whitened, &spectrum, half, &changes)
        {
            lighting.coefficients[p] = l;
            sigma[p] = (2.0 * variance * excess).sqrt();
        }
    }
    let status: Vec<Status> = sigma
        .iter()
        .map(|s| match s {
            s if *s <= DETERMINED => Status::Determined,
            s if *s <= WEAK => Status::Weak,
            _ => Status::Indeterminate,
        })
        .collect();
    for (l, status) in lighting.coefficients.iter_mut().zip(&status) {
        if *status == Status::Indeterminate {
            *l = Complex64::ZERO;
        }
    }
    let slice = slice::slice(&refined, &whitened, half, &changes);
    let (factor, scale) = scale::factor(&options.scale, channel, &lighting, band, &coefficients)?;
    let scaled = |s: &Series| Series {
        coefficients: s.coefficients.iter().map(|c| c * factor).collect(),
    };
    Ok(Channel {
        name: samples.channels[channel].clone(),
        lighting: scaled(&lighting),
        sigma: sigma.iter().map(|s| s * factor).collect(),
        status,
        covariance: row_major(&covariance, factor * factor),
        components: gauge::components(&coefficients, &frequencies),
        frequencies,
        band,
        visible_band,
        resolved,
        brdf: row_major(&slice.value, 1.0 / factor),
        brdf_sigma: row_major(&slice.sigma, 1.0 / factor),
        eigenvalues: start.eigenvalues,
        start: scaled(&start.lighting),
        ratio: scaled(&ratio::lighting(&coefficients)),
        misfit,
        scale,
        converged: refined.converged,
    })
}

/// What a reader must know about a channel.
fn warnings(channel: &Channel) -> Vec<String> {
    let name = &channel.name;
    let mut said = Vec::new();
    if channel.visible_band == 0 {
        said.push(format!(
            "Channel {name}: the light field does not change with the normal. The light is uniform, or the surface passes nothing but \
             its mean: no other frequency of the light, and of the BRDF nothing but its mean over incidence, is determined."
        ));
    }
    let listed = |status: Status| -> Vec<String> {
        (0..=channel.band)
            .filter(|&p| channel.status[p] == status)
            .map(|p| p.to_string())
            .collect()
    };
    let indeterminate = listed(Status::Indeterminate);
    if !indeterminate.is_empty() {
        said.push(format!(
            "Channel {name}: the lighting's frequencies {} are not determined by this light field and are left at 0.",
            indeterminate.join(", ")
        ));
    }
    let weak = listed(Status::Weak);
    if !weak.is_empty() {
        said.push(format!(
            "Channel {name}: the lighting's frequencies {} are only weakly determined.",
            weak.join(", ")
        ));
    }
    if channel.components.len() > 1 {
        let others: Vec<String> = channel.components[1..]
            .iter()
            .map(|c| {
                let names: Vec<String> = c.iter().map(ToString::to_string).collect();
                format!("{{{}}}", names.join(", "))
            })
            .collect();
        said.push(format!(
            "Channel {name}: reciprocity does not tie the frequencies {} to the mean light; each such group has a factor of its own.",
            others.join(" and ")
        ));
    }
    if channel.misfit > 1.2 {
        said.push(format!(
            "Channel {name}: the light field breaks reciprocity by {:.1} times its stated noise; the error bars were widened by \
             that. Light from out of the plane, a texture, or too small a noise estimate would do this.",
            channel.misfit.sqrt()
        ));
    }
    if channel.band < channel.visible_band {
        said.push(format!(
            "Channel {name}: frequencies above {} show in the light field (up to {}), too weakly to be recovered.",
            channel.band, channel.visible_band
        ));
    }
    if !channel.converged {
        said.push(format!(
            "Channel {name}: the refinement did not settle; the weakly determined frequencies may be worse than their error bars."
        ));
    }
    said
}
