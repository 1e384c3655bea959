//! Smooth light and sources fitted together; how many sources there are is decided by the marginal
//! likelihood.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use faer::Mat;
use rayon::prelude::*;

use super::prior::{Posterior, Problem, SpectralPrior, choose_by_evidence, choose_by_gcv};
use super::shone::{Shone, Sums};
use super::sources::{Lit, Response, weighted_product};
use super::{Regularisation, RegularisationChoice, SourceEstimate, WEAK};
use crate::angle::wrap;
use crate::brdf::Brdf;
use crate::error::Result;
use crate::fourier::Series;
use crate::light_field::Samples;
use crate::recover::normal::NormalSystem;

/// Most sources that are looked for.
const MOST_SOURCES: usize = 12;
/// Gain in log evidence at which a further source is believed (odds of 400 to 1).
const BELIEF: f64 = 6.0;
/// Standard deviation, relative to the largest sample, below which no sample is trusted: BRDF, geometry and
/// planarity of the light are not known better, and their errors are not independent between samples.
const MODEL_ERROR: f64 = 1e-4;
/// Weighted rms, relative to the largest sample, up to which a misfit may pass for a split source.
const SPLIT_ERROR: f64 = 3e-4;
/// Peaks that are tried as two sources.
const MOST_SPLITS: usize = 2;
/// Half the distance (radians) at which a peak is tried as two sources.
const SPLIT: f64 = 0.035;
/// Deviation of the prior under which directions are first improved, relative to the mean light.
const SHARP: f64 = 1e-2;
/// Factor on the noise's variance that makes another fit worth its time: 5 % of σ.
const WORTHWHILE: f64 = 0.9;
/// Rounds of directions under held priors and priors for held directions, at the most.
const ROUNDS: usize = 3;
/// Gauss–Newton steps under one prior, at the most.
const STEPS: usize = 8;
/// Step, in standard deviations, that is left out: it would move nothing that matters, and what the sources give would have to be found again.
const REST: f64 = 0.03;
/// Standard deviation of a direction (radians) beyond which the data do not guide it.
const LOST: f64 = 0.3;
/// Longest step of a direction, radians: within the width of a lobe the step may be trusted.
const LONGEST_STEP: f64 = 0.05;

/// One channel's normal equations and scales.
#[derive(Debug)]
pub struct Channel<'a> {
    pub name: String,
    pub index: usize,
    /// The first channel that has the same BRDF.
    pub twin: usize,
    pub brdf: &'a dyn Brdf,
    pub system: NormalSystem,
    /// L_0, W m⁻² rad⁻¹, roughly.
    pub mean_light: f64,
    /// Systematic errors' changes of the samples, \[error\]\[column\]\[n\].
    pub systematics: Vec<Response>,
    /// The samples' values, \[column\]\[n\].
    pub values: Response,
    /// What does not change with the sources.
    known: Known,
    /// κ ≥ 1: by how much the samples scatter more than their variances say, and at least what makes
    /// their weighted mean variance that of [`MODEL_ERROR`].
    pub noise_scale: f64,
}

/// Products of the systematic errors.
#[derive(Debug)]
struct Known {
    /// Dᵀ W f of each.
    crosses: Vec<Vec<f64>>,
    /// Σ w f g with each of them up to itself.
    between: Vec<Vec<f64>>,
    /// Σ w f b with the samples' values.
    with_values: Vec<f64>,
}

/// What a channel is made of.
pub struct ChannelParts<'a> {
    pub name: String,
    pub samples: &'a Samples,
    pub index: usize,
    pub twin: usize,
    pub brdf: &'a dyn Brdf,
    pub system: NormalSystem,
    pub systematics: Vec<Response>,
    pub mean_light: f64,
}

impl<'a> Channel<'a> {
    /// Measures the noise scale on the fit under the weakest prior.
    pub fn new(parts: ChannelParts<'a>) -> Result<Self> {
        let ChannelParts {
            name,
            samples,
            index,
            twin,
            brdf,
            system,
            systematics,
            mean_light,
        } = parts;
        let values: Response = samples
            .columns
            .iter()
            .map(|c| c.value[index].clone())
            .collect();
        let product = |f: &Response, g: &Response| weighted_product(&system.weights, f, g);
        let known = Known {
            crosses: {
                let all: Vec<(&NormalSystem, &[Vec<f64>])> = systematics
                    .iter()
                    .map(|f| (&system, f.as_slice()))
                    .collect();
                NormalSystem::project_all(samples, &all)
            },
            between: systematics
                .iter()
                .enumerate()
                .map(|(s, f)| systematics[..=s].iter().map(|g| product(f, g)).collect())
                .collect(),
            with_values: systematics.iter().map(|f| product(f, &values)).collect(),
        };
        let mut channel = Self {
            name,
            index,
            twin,
            brdf,
            system,
            mean_light,
            systematics,
            values,
            known,
            noise_scale: 1.0,
        };
        let equations = channel.equations(&Sums::default());
        let problem = channel.problem(&equations, 0);
        let x = problem.posterior(&SpectralPrior::flat(mean_light))?.mean;
        let residual = problem.residual(channel.system.square, &x);
        channel.noise_scale = channel.noise_scale_of(residual, x.len());
        Ok(channel)
    }

    /// κ from the weighted sum of squared residuals of a fit of `unknowns` unknowns.
    fn noise_scale_of(&self, residual: f64, unknowns: usize) -> f64 {
        let freedom = self.system.count.saturating_sub(unknowns).max(1);
        let floor = (self.system.largest * MODEL_ERROR).powi(2) * self.system.weight
            / self.system.count as f64;
        (residual / freedom as f64).max(floor).max(1.0)
    }

    /// Posterior of the smooth light and the systematic errors under the weakest prior.
    pub fn weak_posterior(&self) -> Result<Posterior> {
        let equations = self.equations(&Sums::default());
        self.problem(&equations, 0)
            .posterior(&SpectralPrior::flat(self.mean_light))
    }

    fn problem<'b>(&self, equations: &'b (Mat<f64>, Vec<f64>), sources: usize) -> Problem<'b> {
        let coefficients = self.system.vector.len();
        Problem {
            matrix: &equations.0,
            vector: &equations.1,
            coefficients,
            systematics: equations.1.len() - coefficients - sources,
            noise_scale: self.noise_scale,
        }
    }

    /// Normal equations of coefficients, irradiances of `lit` sources, and systematic errors.
    fn equations(&self, lit: &Sums) -> (Mat<f64>, Vec<f64>) {
        let n = self.system.vector.len();
        let (sources, systematics) = (lit.sources(), self.systematics.len());
        let size = n + sources + systematics;
        let mut matrix = Mat::zeros(size, size);
        let mut coefficients = matrix.as_mut().submatrix_mut(0, 0, n, n);
        coefficients.copy_from(&self.system.matrix);
        let mut vector = self.system.vector.clone();
        for s in 0..sources + systematics {
            let error = s.checked_sub(sources);
            let cross = match error {
                Some(e) => &self.known.crosses[e],
                None => lit.response(s).0,
            };
            for (i, c) in cross.iter().enumerate() {
                matrix[(i, n + s)] = *c;
                matrix[(n + s, i)] = *c;
            }
            for t in 0..=s {
                let product = match (error, t.checked_sub(sources)) {
                    (Some(e), Some(f)) => self.known.between[e][f],
                    (Some(_), None) => lit.response(t).1[s],
                    (None, _) => lit.response(s).1[t],
                };
                matrix[(n + s, n + t)] = product;
                matrix[(n + t, n + s)] = product;
            }
            vector.push(match error {
                Some(e) => self.known.with_values[e],
                None => lit.response(s).1[sources + systematics],
            });
        }
        (matrix, vector)
    }
}

/// Where the prior of a fit comes from.
#[derive(Clone, Copy, Debug)]
enum Strength {
    /// Chosen as the recipe says.
    Chosen(Regularisation),
    /// Given.
    Held(SpectralPrior),
}

/// The fit of one channel: unknowns are the coefficients, one irradiance per source, the systematic errors.
#[derive(Debug)]
pub struct Fit {
    pub posterior: Posterior,
    pub prior: SpectralPrior,
    pub choice: RegularisationChoice,
    responses: Vec<Arc<Response>>,
    /// Gradient and curvature of the log posterior by each source's direction.
    guides: Vec<(f64, f64)>,
    log_evidence: f64,
    /// Weighted sum of squared residuals.
    square: f64,
}

impl Fit {
    /// Samples that the given light would give, \[column\]\[n\].
    pub fn predict(
        &self,
        channel: &Channel<'_>,
        smooth: &Series,
        irradiance: &[f64],
        systematics: &[f64],
    ) -> Vec<Vec<f64>> {
        let mut predicted = channel.system.predict(smooth);
        let sources = self.responses.iter().map(Arc::as_ref).zip(irradiance);
        for (response, e) in sources.chain(channel.systematics.iter().zip(systematics)) {
            for (column, f) in predicted.iter_mut().zip(response) {
                for (b, f) in column.iter_mut().zip(f) {
                    *b += e * f;
                }
            }
        }
        predicted
    }
}

/// Fits of all channels with common source directions.
#[derive(Debug)]
pub struct Mixture {
    pub fits: Vec<Fit>,
    /// Standard deviations of the sources' directions, radians.
    pub direction_sigmas: Vec<f64>,
    /// What they give.
    shone: Arc<Shone>,
    log_evidence: f64,
    coefficients: Vec<usize>,
}

impl Mixture {
    /// The smooth light alone.
    pub fn smooth(
        lit: &Lit<'_>,
        channels: &[Channel<'_>],
        regularisation: Regularisation,
    ) -> Result<Self> {
        Self::chosen(
            Arc::new(Shone::new(lit, channels, &[])),
            channels,
            regularisation,
        )
    }

    /// The likeliest number of sources, starting from these, after the channels' noise has changed.
    pub fn refit(
        &self,
        lit: &Lit<'_>,
        channels: &[Channel<'_>],
        regularisation: Regularisation,
        candidates: &[f64],
    ) -> Result<Self> {
        let settled = Self::settled(lit, channels, Arc::clone(&self.shone), regularisation)?;
        settled.extended(lit, channels, regularisation, candidates)
    }

    /// With as many more sources at `candidates` (directions, radians, brightest first) as are believed, and peaks split in two.
    pub fn extended(
        self,
        lit: &Lit<'_>,
        channels: &[Channel<'_>],
        regularisation: Regularisation,
        candidates: &[f64],
    ) -> Result<Self> {
        let mut best = self;
        let found = best.directions().to_vec();
        let mut trial = found.clone();
        let mut worse = 0;
        for &candidate in candidates {
            let nearest = found.iter().map(|d| wrap(d - candidate).abs());
            // A source that was found has moved a little from its peak.
            if nearest.fold(f64::INFINITY, f64::min) < 2.0 * SPLIT {
                continue;
            }
            if trial.len() == MOST_SOURCES {
                break;
            }
            trial.push(candidate);
            // One more may be needed before two weaker sources together pay.
            if best.improve(lit, channels, &trial, regularisation)? {
                worse = 0;
            } else {
                worse += 1;
                if worse == 2 {
                    break;
                }
            }
        }
        // Two sources within a lobe may show as one peak.
        let known = if best.directions().is_empty() {
            candidates
        } else {
            best.directions()
        }
        .to_vec();
        for (s, theta) in known.iter().enumerate().take(MOST_SPLITS) {
            let mut split = known.clone();
            if best.directions().is_empty() {
                split.truncate(s + 1);
            }
            split[s] = theta - SPLIT;
            split.push(theta + SPLIT);
            if best.explains(channels) || best.improve(lit, channels, &split, regularisation)? {
                break;
            }
        }
        Ok(best)
    }

    /// Measures the channels' noise again on these residuals; whether that changes what may be believed.
    pub fn measure_noise(&self, channels: &mut [Channel<'_>]) -> bool {
        let mut changed = false;
        for (channel, fit) in channels.iter_mut().zip(&self.fits) {
            let unknowns = fit.posterior.mean.len() + self.directions().len();
            let measured = channel.noise_scale_of(fit.square, unknowns);
            if measured < WORTHWHILE * channel.noise_scale {
                channel.noise_scale = measured;
                changed = true;
            }
        }
        changed
    }

    /// Takes the fit with sources at about `directions` instead, if it is believed more.
    fn improve(
        &mut self,
        lit: &Lit<'_>,
        channels: &[Channel<'_>],
        directions: &[f64],
        regularisation: Regularisation,
    ) -> Result<bool> {
        let trial = Self::refined(lit, channels, directions, regularisation)?;
        let more = directions
            .len()
            .saturating_sub(self.directions().len())
            .max(1);
        let better = trial.log_evidence > self.log_evidence + BELIEF * more as f64
            && trial.is_lit()
            && trial.separates(self, channels);
        if better {
            *self = trial;
        }
        Ok(better)
    }

    /// Whether the residuals are within what models are good for, and mostly by sources.
    fn explains(&self, channels: &[Channel<'_>]) -> bool {
        !self.directions().is_empty()
            && channels.iter().zip(&self.fits).all(|(channel, fit)| {
                let limit = (SPLIT_ERROR * channel.system.largest).powi(2) * channel.system.weight;
                fit.square <= limit
            })
    }

    /// Directions improved by Gauss–Newton steps: first as if nearly all light came from the sources, which
    /// pins them down, then with the prior that the data choose.
    fn refined(
        lit: &Lit<'_>,
        channels: &[Channel<'_>],
        directions: &[f64],
        regularisation: Regularisation,
    ) -> Result<Self> {
        let sharp: Vec<Strength> = channels
            .iter()
            .map(|c| Strength::Held(SpectralPrior::flat(SHARP * c.mean_light)))
            .collect();
        let begun = Self::fitted(
            Arc::new(Shone::new(lit, channels, directions)),
            channels,
            &sharp,
        )?;
        let shone = begun.descended(lit, channels, &sharp)?;
        Self::settled(lit, channels, shone, regularisation)
    }

    /// Directions and the prior that the data choose, improved in turn from these directions.
    fn settled(
        lit: &Lit<'_>,
        channels: &[Channel<'_>],
        shone: Arc<Shone>,
        regularisation: Regularisation,
    ) -> Result<Self> {
        let mut mixture = Self::chosen(shone, channels, regularisation)?;
        // The better the directions, the less is left for the smooth light, and the other way round.
        for _ in 0..ROUNDS {
            let priors: Vec<SpectralPrior> = mixture.fits.iter().map(|f| f.prior).collect();
            let held: Vec<Strength> = priors.iter().map(|&p| Strength::Held(p)).collect();
            let shone = mixture.descended(lit, channels, &held)?;
            mixture = Self::chosen(shone, channels, regularisation)?;
            if mixture.fits.iter().map(|f| f.prior).eq(priors) {
                break;
            }
        }
        let steps = mixture.direction_steps();
        // Laplace's approximation for each direction, with all directions equally likely before.
        for (_, sigma) in &steps {
            mixture.log_evidence += sigma.ln() - 0.5 * TAU.ln();
        }
        mixture.direction_sigmas = steps.into_iter().map(|(_, sigma)| sigma).collect();
        Ok(mixture)
    }

    /// What the sources give in the directions at which the Gauss–Newton steps under held priors come to rest, starting from this fit, whose
    /// priors are those held.
    fn descended(
        &self,
        lit: &Lit<'_>,
        channels: &[Channel<'_>],
        strengths: &[Strength],
    ) -> Result<Arc<Shone>> {
        let mut next;
        let mut mixture = self;
        for step in 1.. {
            let steps = mixture.direction_steps();
            let within = |part: f64| steps.iter().all(|(step, sigma)| step.abs() < part * sigma);
            if within(REST) {
                break;
            }
            let directions: Vec<f64> = mixture
                .directions()
                .iter()
                .zip(&steps)
                .map(|(theta, (step, _))| wrap(theta + step.clamp(-LONGEST_STEP, LONGEST_STEP)))
                .collect();
            let shone = Arc::new(Shone::new(lit, channels, &directions));
            // Steps shrink so fast that what is left after one of a tenth of a standard deviation is nothing.
            if step == STEPS || within(0.1) {
                return Ok(shone);
            }
            next = Self::fitted(shone, channels, strengths)?;
            mixture = &next;
        }
        Ok(Arc::clone(&mixture.shone))
    }

    /// The fit with the sources' directions held, and priors as the recipe says.
    fn chosen(
        shone: Arc<Shone>,
        channels: &[Channel<'_>],
        regularisation: Regularisation,
    ) -> Result<Self> {
        let strengths = vec![Strength::Chosen(regularisation); channels.len()];
        Self::fitted(shone, channels, &strengths)
    }

    fn fitted(shone: Arc<Shone>, channels: &[Channel<'_>], strengths: &[Strength]) -> Result<Self> {
        let fits: Vec<Fit> = channels
            .par_iter()
            .zip(strengths)
            .zip(&shone.responses)
            .zip(&shone.sums)
            .map(|(((channel, strength), own), sums)| {
                fit_channel(channel, own.clone(), sums, *strength)
            })
            .collect::<Result<_>>()?;
        Ok(Self {
            log_evidence: fits.iter().map(|f| f.log_evidence).sum(),
            fits,
            direction_sigmas: vec![0.0; shone.directions.len()],
            coefficients: channels.iter().map(|c| c.system.vector.len()).collect(),
            shone,
        })
    }

    /// Directions of the sources, radians.
    pub fn directions(&self) -> &[f64] {
        &self.shone.directions
    }

    /// For each source the Gauss–Newton step of its direction and its standard deviation, radians.
    fn direction_steps(&self) -> Vec<(f64, f64)> {
        (0..self.directions().len())
            .map(|s| {
                let gradient: f64 = self.fits.iter().map(|fit| fit.guides[s].0).sum();
                let curvature: f64 = self.fits.iter().map(|fit| fit.guides[s].1).sum();
                let sigma = curvature.recip().sqrt();
                if sigma < LOST {
                    (gradient / curvature, sigma)
                } else {
                    (0.0, PI)
                }
            })
            .collect()
    }

    /// Mean and standard deviation of source `s`'s irradiance in each channel.
    fn irradiances(&self, s: usize) -> Vec<(f64, f64)> {
        self.fits
            .iter()
            .zip(&self.coefficients)
            .map(|(fit, n)| {
                let mut unit = vec![0.0; fit.posterior.mean.len()];
                unit[n + s] = 1.0;
                (
                    fit.posterior.mean[n + s],
                    fit.posterior.variance_of(&unit).max(0.0).sqrt(),
                )
            })
            .collect()
    }

    /// Whether every source sends light in some channel and takes it from none beyond its error.
    fn is_lit(&self) -> bool {
        (0..self.directions().len()).all(|s| {
            let all = self.irradiances(s);
            all.iter().any(|(e, sigma)| *e > 5.0 * sigma)
                && all.iter().all(|(e, sigma)| *e > -3.0 * sigma)
        })
    }

    /// Whether the last source is either far from the others, or explains so much that it cannot be an
    /// error of the model: two sources within a lobe differ from one by a slight widening, which errors of
    /// geometry and of the BRDF imitate.
    fn separates(&self, without: &Self, channels: &[Channel<'_>]) -> bool {
        let lobe = channels
            .iter()
            .map(|c| c.brdf.lobe_width())
            .fold(f64::INFINITY, f64::min);
        let Some((last, others)) = self.directions().split_last() else {
            return true;
        };
        let near = others
            .iter()
            .any(|other| wrap(last - other).abs() < 0.5 * lobe);
        !near
            || channels
                .iter()
                .zip(&self.fits)
                .zip(&without.fits)
                .any(|((channel, fit), before)| {
                    let gain = before.square - fit.square;
                    gain > (SPLIT_ERROR * channel.system.largest).powi(2) * channel.system.weight
                })
    }

    /// The sources as they are reported.
    pub fn source_estimates(&self) -> Vec<SourceEstimate> {
        (0..self.directions().len())
            .map(|s| {
                let all = self.irradiances(s);
                SourceEstimate {
                    theta_deg: self.directions()[s].to_degrees(),
                    theta_sigma_deg: self.direction_sigmas[s].to_degrees(),
                    irradiance: all.iter().map(|(e, _)| e.max(0.0)).collect(),
                    irradiance_sigma: all.iter().map(|(_, sigma)| *sigma).collect(),
                }
            })
            .collect()
    }
}

/// Gradient and curvature of the log posterior by the direction of source `s`, with all other unknowns of the channel at their best (profile
/// likelihood).
fn direction_gradient(
    channel: &Channel<'_>,
    posterior: &Posterior,
    sums: &Sums,
    s: usize,
) -> (f64, f64) {
    let n = channel.system.vector.len();
    let irradiance = posterior.mean[n + s];
    let kappa = channel.noise_scale;
    let (projected, products) = sums.derivative(s);
    let (others, rest) = products.split_at(sums.sources() + channel.systematics.len());
    let cross = [projected, others].concat();
    let (data, own) = (rest[0], rest[1]);
    let fitted: f64 = cross.iter().zip(&posterior.mean).map(|(a, b)| a * b).sum();
    let explained = posterior.variance_of(&cross);
    let gradient = irradiance * (data - fitted) / kappa;
    let curvature = irradiance.powi(2) * (own / kappa - explained / kappa.powi(2));
    (gradient, curvature.max(0.0))
}

/// One channel with the sources' directions held: normal equations of coefficients and irradiances.
fn fit_channel(
    channel: &Channel<'_>,
    responses: Vec<Arc<Response>>,
    sums: &Sums,
    strength: Strength,
) -> Result<Fit> {
    let system = &channel.system;
    let n = system.vector.len();
    let equations = channel.equations(sums);
    let problem = channel.problem(&equations, responses.len());
    let mean_light = channel.mean_light;
    let guides = |posterior: &Posterior| -> Vec<(f64, f64)> {
        (0..responses.len())
            .map(|s| direction_gradient(channel, posterior, sums, s))
            .collect()
    };
    let named = |criterion: &str, strength: f64| RegularisationChoice {
        criterion: criterion.into(),
        strength,
        curve: Vec::new(),
    };
    let regularisation = match strength {
        Strength::Chosen(regularisation) => regularisation,
        Strength::Held(prior) => {
            let posterior = problem.posterior(&prior)?;
            let choice = named("held", (mean_light / prior.deviation).powi(2));
            return Ok(Fit {
                log_evidence: posterior.log_evidence,
                square: problem.residual(system.square, &posterior.mean),
                guides: guides(&posterior),
                posterior,
                prior,
                choice,
                responses,
            });
        }
    };
    let (prior, choice) = match regularisation {
        Regularisation::Evidence => choose_by_evidence(&problem, mean_light)?,
        Regularisation::Gcv => choose_by_gcv(&problem, system.square, system.count, mean_light)?,
        // A thousand times the largest possible coefficient is no prior at all, and keeps the
        // equations solvable where the data say nothing.
        Regularisation::None => (SpectralPrior::flat(1e3 * mean_light), named("none", 0.0)),
        Regularisation::Truncate => {
            let weak = problem.posterior(&SpectralPrior::flat(mean_light))?;
            let covariance = weak.covariance();
            let last = (1..n)
                .filter(|&i| covariance[(i, i)].sqrt() <= WEAK * mean_light)
                .max()
                .map_or(1, |i| i.div_ceil(2));
            let prior = SpectralPrior {
                deviation: 1e3 * mean_light,
                corner: last as f64 + 0.5,
                steepness: 200,
            };
            (prior, named("truncate", last as f64))
        }
        Regularisation::Fixed(strength) => {
            let deviation = mean_light / strength.max(f64::MIN_POSITIVE).sqrt();
            (SpectralPrior::flat(deviation), named("fixed", strength))
        }
    };
    let posterior = problem.posterior(&prior)?;
    // The irradiances' flat prior over [0, 2π L_0], the largest that the mean light allows.
    let log_irradiance_prior = responses.len() as f64 * (0.5 * TAU.ln() - (TAU * mean_light).ln());
    Ok(Fit {
        log_evidence: posterior.log_evidence + log_irradiance_prior,
        square: problem.residual(system.square, &posterior.mean),
        guides: guides(&posterior),
        posterior,
        prior,
        choice,
        responses,
    })
}
