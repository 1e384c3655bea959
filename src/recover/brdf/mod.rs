//! BRDF from known light.
//!
//! # The estimator
//!
//! The unknown is ρ̃(θi′, θo′) = ρ cos θi′ cos θo′ on the two half circles, a product spline with non-negative,
//! symmetric coefficients c_{mn} = c_{nm}: support, reciprocity and ρ ≥ 0 are part of the problem, and
//! nothing else is assumed of the lobe. A sample is linear in it (eq. 4),
//!
//! b = Σ_{mn} c_{mn} φ_n(θo′)/cos θo′ · \[Σ_k E_k φ_m(θ_k − α) + ∫ L(α + θ) φ_m(θ) dθ\] + noise,
//!
//! sources at their exact angles. ρ̃ is fitted rather than ρ because it is the quantity that is bounded and
//! continuous at grazing angles, and the one that is symmetric.
//!
//! With weights 1/σ² the samples give an information matrix J and a right side h. A Gaussian prior of precision P says how large
//! ρ̃ is and how rough across and along the mirror lobe ([`Smoothness`]), each with a local size that varies over the slice, because a lobe
//! fills a small part of it; all of it maximises the marginal likelihood of the samples, but the weight as a whole is then lowered by a
//! step, or as far as cross-validation asks. From c = (J + P)⁻¹ h the bias that the prior brings in is taken out, to second order, and
//! c ≥ 0 imposed. σ of what is determined is then that of the noise alone, over captures of this
//! very surface, and a 95 % interval covers 95 % at each place; for the rest σ holds what the prior expects besides (see
//! `posterior.rs` and `spread.rs`). Lobes that even the finest splines do not hold leave residuals beyond the noise: what these still miss
//! is judged from what finer splines mended of the residual and of the slice, and added to σ (see `reading.rs`).
//!
//! # What is determined, and the bound
//!
//! A quantity g·c (a value of the slice, a Fourier coefficient) has three variances: under the prior alone gᵀP⁻¹g,
//! under prior and samples gᵀ(J + P)⁻¹g, and by the samples alone gᵀJ⁻¹g, which is infinite if g leaves the
//! range of J. The last is the Cramér–Rao bound of the unregularised problem. It is computed as
//! gᵀ(J + ε)⁻¹g with a white ε that allows each coefficient a hundred times the largest value of the slice: far above
//! anything a determined quantity's bound may be, and finite (but huge) for the others. Then
//!
//! * *determined*: the bound is at most half the prior's standard deviation: the samples alone say more than four times
//!   as much as the prior, in variance. The prior changes such an estimate little, and the bound is a fair measure of it.
//! * *weak*: else, if the posterior's standard deviation is at most half the prior's: known by
//!   smoothness, between views or beyond the resolution of the light.
//! * *indeterminate*: the rest. Under uniform light that is everything but ρ̃_{0,q}, and every single value of the slice.
//!
//! For this judgement the prior's correlation lengths are held to [`Options::longest`], so that no smoothness, however
//! strongly the seen part suggests it, carries a value far into what was never seen.
//!
//! The prior enters only as the size that a quantity could be expected to have. The bound of the white ε
//! knows nothing of smoothness, so it does not flatter a prior that is wrong.

mod advice;
pub(super) mod basis;
mod estimate;
mod evidence;
mod fit;
mod information;
mod light_error;
mod posterior;
mod prior;
mod reading;
mod space;
mod spectrum;
mod spread;

use std::f64::consts::PI;

use faer::Mat;

use crate::light_field::{Samples, Systematic};
use crate::lighting::Lighting;
use crate::{Error, Result};
pub use advice::advise;
use basis::Basis;
pub use estimate::{BrdfEstimate, Coefficient, Slice};
pub use evidence::CurvePoint;
use fit::Fit;
use information::{Illumination, Information};
pub use light_error::LightError;
use prior::Relief;
pub use prior::Smoothness;
use reading::{Reach, vague};
use space::Space;

/// Longest correlation length that is learnt, radians.
const LONGEST: f64 = 1.0;

/// Intervals of the splines on which the prior's weights are learnt, and of the first result: 4.5° hold a lobe of exponent
/// 32 to 3e-6, of 128 to 2e-4. Where that is not enough, splines on half of it hold 64 times as well.
const COARSE: usize = 40;

/// How the weight of the prior is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Regularisation {
    /// Marginal likelihood for the form of the prior; its weight is a step below, or as far as cross-validation asks.
    Evidence,
    /// Generalised cross-validation alone for the weight.
    Gcv,
    /// The weights of `Evidence` times this factor.
    Factor(f64),
    /// These weights.
    Fixed(Smoothness),
    /// No smoothness at all, only that values are finite.
    None,
}

/// Residual variance in units of the samples' variances above which a warning is given: up to twice the stated σ is what an optimistic noise
/// model does.
pub const NOISE_FACTOR: f64 = 4.0;

/// Options of [`recover`].
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Cells of the half × half grid of the result along each side.
    pub size: usize,
    /// Knot intervals of the splines over the half circle; `None`: 40, and 80 where the lobe is so sharp and the noise so
    /// low that the splines themselves would limit the result.
    pub intervals: Option<usize>,
    /// Highest frequency of the spectrum.
    pub order: usize,
    /// How the weight of the prior is chosen.
    pub regularisation: Regularisation,
    /// Whether ρ ≥ 0 is demanded.
    pub non_negative: bool,
    /// How far from what was seen smoothness may fill in, radians: the longest correlation length by which the status of a
    /// value is judged.
    pub longest: f64,
    /// Whether evidence and cross-validation are computed for other weights of the prior too, for the report.
    pub curve: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            size: 180,
            intervals: None,
            order: 24,
            regularisation: Regularisation::Evidence,
            non_negative: true,
            longest: 12f64.to_radians(),
            curve: true,
        }
    }
}

/// Recovers ρ on the half × half grid of angles from samples of the light field under a known light.
///
/// The light's channels are matched by name; a light of one channel serves all.
///
/// # Errors
/// [`Kind::Input`](crate::error::Kind) if a channel has no light or no sample, or an option is out of range;
/// [`Kind::Failed`](crate::error::Kind) if the normal equations cannot be solved.
pub fn recover(samples: &Samples, lighting: &Lighting, options: &Options) -> Result<BrdfEstimate> {
    recover_with(samples, &[], lighting, options)
}

/// The same with systematic errors that all samples share: they are fitted along, each with a normal prior of one
/// standard deviation, so that σ holds what they leave open, and the bound with it.
///
/// # Errors
/// As [`recover`].
pub fn recover_with(
    samples: &Samples,
    systematics: &[Systematic],
    lighting: &Lighting,
    options: &Options,
) -> Result<BrdfEstimate> {
    recover_all(samples, systematics, lighting, &[], options)
}

/// The same under a light that is not known for certain: `errors` per channel of the samples, none where the light is known. They are not fitted, but
/// what they do to the slice is in its σ, and in the bound.
///
/// # Errors
/// As [`recover`], and if a covariance is not one of its frequencies.
pub fn recover_under(
    samples: &Samples,
    lighting: &Lighting,
    errors: &[LightError],
    options: &Options,
) -> Result<BrdfEstimate> {
    recover_all(samples, &[], lighting, errors, options)
}

fn recover_all(
    samples: &Samples,
    systematics: &[Systematic],
    lighting: &Lighting,
    errors: &[LightError],
    options: &Options,
) -> Result<BrdfEstimate> {
    check(options)?;
    let mut estimate = BrdfEstimate {
        channels: samples.channels.clone(),
        size: options.size,
        slices: Vec::new(),
        warnings: Vec::new(),
    };
    // One channel at a time: each fills the cores, and memory stays that of one.
    for (channel, name) in samples.channels.iter().enumerate() {
        let light_channel = match lighting.channels.iter().position(|c| c == name) {
            Some(k) => k,
            None if lighting.channels.len() == 1 => 0,
            None => {
                return Err(Error::input(format!(
                    "the lighting has no channel {name}, only {}",
                    lighting.channels.join(", ")
                ))
                .advice("give the lighting the channel names of the photographs"));
            }
        };
        let slice = recover_channel(
            samples,
            channel,
            systematics,
            (lighting, light_channel),
            errors.get(channel),
            options,
        )?;
        estimate
            .warnings
            .extend(estimate::gaps(name, options.size, &slice));
        if slice.noise > NOISE_FACTOR {
            estimate.warnings.push(format!(
                "{name}: the residual is {:.1} times what the variances of the samples allow; all σ are scaled up by it. The lighting or the geometry may be wrong, or light may come from outside the plane.",
                slice.noise.sqrt()
            ));
        }
        estimate.slices.push(slice);
    }
    Ok(estimate)
}

fn check(options: &Options) -> Result<()> {
    let number = |what: &str, value: usize, from: usize, to: usize| {
        if (from..=to).contains(&value) {
            Ok(())
        } else {
            Err(Error::input(format!(
                "expected {what} from {from} to {to}, got {value}"
            )))
        }
    };
    number("a grid size", options.size, 2, 2000)?;
    number(
        "knot intervals",
        options.intervals.unwrap_or(COARSE),
        12,
        100,
    )?;
    number("a highest frequency", options.order, 0, 90)?;
    if !(options.longest > 0.0 && options.longest < PI) {
        return Err(Error::input(format!(
            "expected a correlation length between 0 and π, got {}",
            options.longest
        )));
    }
    let positive = |v: f64| v.is_finite() && v > 0.0;
    match options.regularisation {
        Regularisation::Factor(f) if !positive(f) => Err(Error::input(format!(
            "expected a positive factor on the regularisation, got {f}"
        ))),
        Regularisation::Fixed(s) if !s.weights().into_iter().all(positive) => Err(Error::input(
            "expected three positive weights of the regularisation".to_owned(),
        )),
        _ => Ok(()),
    }
}

fn recover_channel(
    samples: &Samples,
    channel: usize,
    systematics: &[Systematic],
    (lighting, light_channel): (&Lighting, usize),
    error: Option<&LightError>,
    options: &Options,
) -> Result<Slice> {
    let name = samples.channels.get(channel).map_or("", String::as_str);
    let through = |space: &Space| Illumination::new(space.basis(), lighting, light_channel);
    let reduced = |space: Space| {
        let light = through(&space);
        let dark = light.is_dark();
        let information = Information::new(samples, channel, systematics, &light, space);
        (information, dark)
    };
    let intervals = options.intervals.unwrap_or(COARSE);
    let basis = Basis::new(COARSE.min(intervals));
    let (information, dark) = reduced(Space::uniform(basis));
    if dark {
        return Err(
            Error::input(format!("the known lighting is dark in channel {name}"))
                .advice("a BRDF can only be measured under light"),
        );
    }
    if information.count == 0 {
        return Err(Error::input(format!(
            "channel {name} has no usable sample of the light field"
        ))
        .advice("check the exposure, the mask and the limb cut"));
    }
    let learnt = evidence::learn(
        &information,
        LONGEST,
        options.curve || options.regularisation == Regularisation::Gcv,
    )?;
    let smoothness = match options.regularisation {
        Regularisation::Evidence => learnt.smoothness,
        Regularisation::Gcv => {
            let best = learnt
                .curve
                .iter()
                .min_by(|a, b| a.gcv.total_cmp(&b.gcv))
                .map_or(1.0, |p| p.factor);
            learnt.smoothness.times(best)
        }
        Regularisation::Factor(f) => learnt.smoothness.times(f),
        Regularisation::Fixed(s) => s,
        Regularisation::None => vague(basis.spacing(), learnt.largest),
    };
    let relief = match options.regularisation {
        Regularisation::Fixed(_) | Regularisation::None => Relief::flat(basis),
        _ => learnt.relief,
    };
    let reach = Reach::new(&information, &smoothness, &relief, options.longest)?;
    let mut coarse = Fit::new(information, &smoothness, &relief, options.non_negative)?;
    let finer = match options.intervals {
        None => coarse.finer(),
        Some(intervals) if intervals > COARSE => Some(Space::uniform(Basis::new(intervals))),
        Some(_) => None,
    };
    let (fine, missed) = match finer {
        None => {
            coarse = coarse.reconciled()?;
            (None, 0.0)
        }
        Some(space) => {
            let (information, _) = reduced(space);
            let fine = Fit::new(information, &smoothness, &relief, options.non_negative)?;
            let missed = reading::missed(coarse.noise, fine.noise);
            let fine = fine.reconciled()?;
            if fine.noise != coarse.noise {
                coarse = coarse.at_noise(fine.noise)?;
            }
            (Some(fine), missed)
        }
    };
    let fit = fine.as_ref().unwrap_or(&coarse);
    let followed = match error {
        Some(error) => light_error::followed(fit, samples, channel, &through(fit.space()), error)?,
        None => Mat::zeros(fit.space().len(), 0),
    };
    let (size, order) = (options.size, options.order);
    let (grid, spectrum) = reading::read(fit, &coarse, missed, &followed, size, order, &reach)?;
    Ok(Slice {
        reciprocal: grid.values,
        sigma: grid.sigma,
        unresolved: grid.unresolved,
        bound: grid.bound,
        status: grid.status,
        spectrum,
        chi_square: fit.chi_square,
        samples: fit.information.count,
        parameters: fit.parameters,
        noise: fit.noise,
        smoothness,
        curve: learnt.curve,
        resolution: fit.space().basis().spacing(),
        held: fit.posterior.held,
    })
}

#[cfg(test)]
mod tests;
