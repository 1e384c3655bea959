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
//! With weights 1/σ² the samples give an information matrix J and a right side h. The estimate is the
//! maximum of the posterior under a Gaussian prior of precision P ([`Smoothness`]: size, bending across and along the lobe),
//! c = (J + P)⁻¹ h; the three weights of P maximise the marginal likelihood of the samples, and P is capped so that it carries
//! no value farther than [`Options::longest`]. σ is from (J + P)⁻¹. As a confidence interval it covers what it claims when averaged over
//! the slice (Nychka, "Bayesian confidence intervals for smoothing splines", JASA 83, 1988), because
//! it holds the expected squared bias of smoothing beside the variance.
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
//! The prior enters only as the size that a quantity could be expected to have. The bound of the white ε
//! knows nothing of smoothness, so it does not flatter a prior that is wrong.

mod basis;
mod estimate;
mod evidence;
mod information;
mod posterior;
mod prior;
mod spectrum;

use std::f64::consts::{FRAC_PI_2, PI};

use faer::Mat;
use num_complex::Complex64;

use crate::light_field::Samples;
use crate::lighting::Lighting;
use crate::{Error, Result};
use basis::Basis;
pub use estimate::{BrdfEstimate, Coefficient, Slice, Status};
pub use evidence::CurvePoint;
use information::{Illumination, Information};
use posterior::Posterior;
pub use prior::Smoothness;
use prior::{Factor, Penalties};

/// Intervals of the splines on which the prior's weights are learnt.
const COARSE: usize = 40;

/// How many times the largest value of the slice a coefficient may be in the problem without smoothness.
const VAGUE: f64 = 100.0;

/// How the weight of the prior is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Regularisation {
    /// Marginal likelihood.
    Evidence,
    /// Generalised cross-validation along the curve through the maximum of the marginal likelihood.
    Gcv,
    /// That maximum's weights times this factor.
    Factor(f64),
    /// These weights.
    Fixed(Smoothness),
    /// No smoothness at all, only that values are finite.
    None,
}

/// Options of [`recover`].
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Cells of the half × half grid of the result along each side.
    pub size: usize,
    /// Knot intervals of the splines over the half circle.
    pub intervals: usize,
    /// Highest frequency of the spectrum.
    pub order: usize,
    /// How the weight of the prior is chosen.
    pub regularisation: Regularisation,
    /// Whether ρ ≥ 0 is demanded.
    pub non_negative: bool,
    /// Longest correlation length the prior may have, radians.
    pub longest: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            size: 180,
            intervals: 60,
            order: 24,
            regularisation: Regularisation::Evidence,
            non_negative: true,
            longest: 12f64.to_radians(),
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
        let slice = recover_channel(samples, channel, lighting, light_channel, options)?;
        estimate
            .warnings
            .extend(estimate::gaps(name, options.size, &slice));
        if slice.noise > 1.2 {
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
    number("knot intervals", options.intervals, 12, 100)?;
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
    lighting: &Lighting,
    light_channel: usize,
    options: &Options,
) -> Result<Slice> {
    let name = samples.channels.get(channel).map_or("", String::as_str);
    let coarse_basis = Basis::new(COARSE.min(options.intervals));
    let light = Illumination::new(coarse_basis, lighting, light_channel);
    if light.is_dark() {
        return Err(
            Error::input(format!("the known lighting is dark in channel {name}"))
                .advice("a BRDF can only be measured under light"),
        );
    }
    let coarse = Information::new(samples, channel, &light);
    if coarse.count == 0 {
        return Err(Error::input(format!(
            "channel {name} has no usable sample of the light field"
        ))
        .advice("check the exposure, the mask and the limb cut"));
    }
    let learnt = evidence::learn(&coarse, options.longest, 1.0)?;
    let basis = Basis::new(options.intervals);
    let light = Illumination::new(basis, lighting, light_channel);
    let information = Information::new(samples, channel, &light);
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
        Regularisation::None => vague(basis, largest_of(&coarse, &learnt)?),
    };
    let penalties = Penalties::new(basis);
    let mut noise = 1.0;
    let mut posterior;
    let mut chi_square;
    let mut parameters;
    let mut round = 0;
    loop {
        posterior = Posterior::new(&information, &smoothness, noise, options.non_negative)?;
        chi_square = information.chi_square(&posterior.mean);
        parameters = basis.pairs() as f64 - penalties.trace(&smoothness, &posterior.covariance);
        let free = information.count as f64 - parameters;
        let reduced = chi_square / free.max(1.0);
        round += 1;
        // Beyond five standard deviations of χ² the variances are too small, or the model is wrong.
        if round > 1
            || free < 0.05 * information.count as f64
            || reduced < 1.0 + 5.0 * (2.0 / free).sqrt()
        {
            break;
        }
        noise = reduced;
    }
    let fit = Fit {
        basis,
        information: &information,
        posterior: &posterior,
        smoothness,
        noise,
    };
    let grid = fit.grid(options.size)?;
    let spectrum = fit.spectrum(options.order, &grid.vague)?;
    Ok(Slice {
        reciprocal: grid.values,
        sigma: grid.sigma,
        bound: grid.bound,
        status: grid.status,
        spectrum,
        chi_square,
        samples: information.count,
        parameters,
        noise,
        smoothness,
        curve: learnt.curve,
        resolution: basis.spacing(),
        held: posterior.held,
    })
}

/// White prior that allows coefficients of [`VAGUE`] times `largest`.
fn vague(basis: Basis, largest: f64) -> Smoothness {
    let size = VAGUE * largest.max(f64::MIN_POSITIVE.sqrt());
    Smoothness {
        amplitude: (basis.spacing() * size).powi(-2),
        across: 0.0,
        along: 0.0,
    }
}

fn largest_of(information: &Information, learnt: &evidence::Learnt) -> Result<f64> {
    let fit = Posterior::new(information, &learnt.smoothness, learnt.noise, false)?;
    Ok(fit.mean.iter().fold(0.0, |m, v| v.abs().max(m)))
}

fn classify(bound: f64, sigma: f64, prior: f64) -> Status {
    if bound <= 0.5 * prior && bound <= 10.0 * sigma {
        Status::Determined
    } else if sigma <= 0.5 * prior {
        Status::Weak
    } else {
        Status::Indeterminate
    }
}

/// A finished fit, to be read out.
struct Fit<'a> {
    basis: Basis,
    information: &'a Information,
    posterior: &'a Posterior,
    smoothness: Smoothness,
    noise: f64,
}

struct GridValues {
    values: Vec<f64>,
    sigma: Vec<f64>,
    bound: Vec<f64>,
    status: Vec<Status>,
    /// Factor of the problem without smoothness.
    vague: Factor,
}

impl Fit<'_> {
    /// The prior's factor on splines coarse enough that it costs little.
    fn prior(&self) -> Result<(Basis, Factor)> {
        let basis = Basis::new(COARSE.min(self.basis.intervals()));
        let mut matrix = Mat::zeros(basis.pairs(), basis.pairs());
        Penalties::new(basis).add_dense(&self.smoothness, &mut matrix);
        Ok((basis, Factor::new(&matrix)?))
    }

    fn grid(&self, size: usize) -> Result<GridValues> {
        let angle = |k: usize| -FRAC_PI_2 + (k as f64 + 0.5) * PI / size as f64;
        let mut values = vec![0.0; size * size];
        for i in 0..size {
            for j in 0..=i {
                let v = posterior::apply(
                    &posterior::value_at(self.basis, angle(i), angle(j)),
                    &self.posterior.mean,
                );
                values[i * size + j] = v;
                values[j * size + i] = v;
            }
        }
        let largest = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let mut matrix = self.information.dense(1.0 / self.noise);
        Penalties::new(self.basis).add_dense(&vague(self.basis, largest), &mut matrix);
        let vague = Factor::new(&matrix)?;
        drop(matrix);
        let free = vague.inverse();
        let (prior_basis, prior) = self.prior()?;
        let prior = prior.inverse();
        let mut sigma = vec![0.0; size * size];
        let mut bound = sigma.clone();
        let mut status = vec![Status::Indeterminate; size * size];
        for i in 0..size {
            for j in 0..=i {
                let functional = posterior::value_at(self.basis, angle(i), angle(j));
                let s = posterior::variance(&functional, &self.posterior.covariance).sqrt();
                let b = posterior::variance(&functional, &free).sqrt();
                let p = posterior::variance(
                    &posterior::value_at(prior_basis, angle(i), angle(j)),
                    &prior,
                )
                .sqrt();
                for k in [i * size + j, j * size + i] {
                    sigma[k] = s;
                    bound[k] = b;
                    status[k] = classify(b, s, p);
                }
            }
        }
        Ok(GridValues {
            values,
            sigma,
            bound,
            status,
            vague,
        })
    }

    fn spectrum(&self, order: usize, vague: &Factor) -> Result<Vec<Coefficient>> {
        let functionals = spectrum::functionals(self.basis, order);
        let sigma = spectrum::sigmas(&functionals, &self.posterior.factor);
        let bound = spectrum::sigmas(&functionals, vague);
        let (prior_basis, prior) = self.prior()?;
        let prior = spectrum::sigmas(&spectrum::functionals(prior_basis, order), &prior);
        let x = &self.posterior.mean;
        let dot = |j: usize| -> f64 { functionals.col(j).iter().zip(x).map(|(w, x)| w * x).sum() };
        Ok(spectrum::indices(order)
            .into_iter()
            .enumerate()
            .map(|(k, (p, q))| Coefficient {
                p,
                q,
                value: Complex64::new(dot(2 * k), dot(2 * k + 1)),
                sigma: sigma[k],
                bound: bound[k],
                status: classify(bound[k], sigma[k], prior[k]),
            })
            .collect())
    }
}

#[cfg(test)]
mod tests;
