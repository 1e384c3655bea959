//! The factorisation's result on its way to the products: light, slice and gauge.

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2, TAU};

use num_complex::Complex64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::fit::FitQuality;
use crate::brdf::fit::FittedParameter;
use crate::fourier::Series;
use crate::light_field::{Column, Samples, Systematic};
use crate::lighting::{Lighting, Source};
use crate::recover::Status;
use crate::recover::brdf::{BrdfEstimate, LightError};
use crate::recover::factorise::{self, Channel, Factorisation, ParametricFit, Scale};
use crate::recover::lighting::{
    ChannelEstimate, Coefficient, LightingEstimate, RegularisationChoice, TABLE,
};

/// What the light field left free in one channel, and how other ways to factorise it did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelGauge {
    /// Channel name.
    pub channel: String,
    /// Where the scale comes from, a sentence.
    pub scale: String,
    /// Largest frequency that shows in the light field.
    pub band: usize,
    /// Largest frequency that the views resolve.
    pub resolved: usize,
    /// Frequencies of the light that reciprocity ties together; each such group has a free factor of its own, that of
    /// p = 0 is the scale.
    pub components: Vec<Vec<usize>>,
    /// Frequencies of the light that are not determined.
    pub undetermined: Vec<usize>,
    /// Eigenvalues of the reciprocity problem, increasing, in units of the noise: one near 1 is not determined.
    pub eigenvalues: Vec<f64>,
    /// Mean square of the reciprocity residuals in units of the noise: 1 if model and noise are right.
    pub misfit: f64,
    /// Whether the refinement settled.
    pub converged: bool,
    /// L_p of the eigenproblem alone.
    pub eigenproblem: Series,
    /// L_p by the ratios of [RH01, eq. 29].
    pub ratios: Series,
    /// ‖L(eigenproblem) − L‖ / ‖L‖ over the determined frequencies.
    pub eigenproblem_difference: f64,
    /// ‖L(eq. 29) − L‖ / ‖L‖ over the determined frequencies.
    pub ratios_difference: f64,
    /// Analytic models fitted to the light field, each with its light, where that leaves most of the light open.
    #[serde(default)]
    pub parametric: Option<ParametricFactorisation>,
}

/// Analytic models fitted to the light field itself, with the light as unknown as they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParametricFactorisation {
    /// Why they are offered, a sentence.
    pub reason: String,
    /// The fits, the best by BIC first.
    pub fits: Vec<ParametricModel>,
    /// Index into `fits` of the best by AIC.
    pub best_by_aic: usize,
}

/// One model and its light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParametricModel {
    /// Name of the model as in a recipe.
    pub model: String,
    /// Its parameters in the scale of the run; without σ where the scale decides, at a limit, or where the light field does not tell.
    pub parameters: Vec<FittedParameter>,
    /// Names of the parameters that the light field does not determine.
    pub undetermined: Vec<String>,
    /// Σ (residual/σ)² over the samples.
    pub chi_square: f64,
    /// Number of samples.
    pub samples: usize,
    /// Effective number of the light's parameters.
    pub light_parameters: f64,
    /// Akaike's criterion.
    pub aic: f64,
    /// Schwarz' Bayesian criterion, with the likelihood averaged over the light.
    pub bic: f64,
    /// L_p of the light that goes with it, p ≥ 0.
    pub lighting: Vec<Coefficient>,
}

/// Degrees of θo′ per pixel up to which samples are used where both are unknown: what lies beyond the cut is as unknown as the
/// light, and that costs more than samples whose slope is hardly resolved. At 83.8° of an object 408 pixels wide.
pub const FOOTPRINT: f64 = 2.75;

/// Error that samples have in common with their neighbours, relative to the channel's largest value. Pixels are fitted along the
/// view's line over a column's width, which smooths the kinks where a sun grazes. In photos without noise that is 2e-5 to 5e-5 (rms) of
/// the largest value, three times as much near the limb.
const MODEL_ERROR: f64 = 1e-4;

/// The samples with the variance of that error added: the factorisation takes their errors as independent.
///
/// Where a pixel of an object `radius_px` large covers more than a column, what the fit within it misses grows as the square of
/// its footprint.
pub fn with_model_error(samples: &Samples, radius_px: f64) -> Samples {
    let mut widened = samples.clone();
    let width = samples.column_width();
    for c in 0..samples.channels.len() {
        let present = samples.columns.iter().flat_map(|column| {
            let both = column.value[c].iter().zip(&column.variance[c]);
            both.filter(|(_, v)| v.is_finite()).map(|(b, _)| b.abs())
        });
        let largest = present.fold(0.0, f64::max);
        for column in &mut widened.columns {
            let footprint = 1.0 / (radius_px * column.local.rad().cos());
            let growth = 1.0 + (footprint / width).powi(2);
            let added = (MODEL_ERROR * growth * largest).powi(2);
            for v in &mut column.variance[c] {
                *v += added;
            }
        }
    }
    widened
}

/// Analytic models for the channels in which the free factorisation determines less than two thirds of the frequencies that
/// show in the light field, or did not settle; none where no model can be fitted.
pub fn parametric(
    found: &Factorisation,
    samples: &Samples,
    scale: &Scale,
) -> Vec<Option<ParametricFactorisation>> {
    found
        .channels
        .iter()
        .enumerate()
        .map(|(c, channel)| {
            let known = (1..=channel.band)
                .filter(|&p| channel.status[p] == Status::Determined)
                .count();
            if channel.converged && 3 * known >= 2 * channel.visible_band {
                return None;
            }
            let fits = factorise::parametric(samples, c, scale).ok()?;
            Some(ParametricFactorisation {
                reason: format!(
                    "Without a model {known} of the {} frequencies of the light that show are determined.",
                    channel.visible_band
                ),
                best_by_aic: fits.best_by_aic,
                fits: fits.fits.into_iter().map(model_summary).collect(),
            })
        })
        .collect()
}

fn model_summary(fit: ParametricFit) -> ParametricModel {
    // The strength that the scale decides has no σ of its own.
    let held = ["specular", "sheen", "albedo", "scale"];
    ParametricModel {
        undetermined: fit
            .parameters
            .iter()
            .filter(|p| p.sigma.is_none() && !held.contains(&p.name.as_str()))
            .map(|p| p.name.clone())
            .collect(),
        lighting: fit
            .lighting
            .coefficients
            .iter()
            .zip(fit.sigma.iter().zip(&fit.status))
            .enumerate()
            .map(|(p, (value, (sigma, status)))| {
                let sigma = sigma / if p == 0 { 1.0 } else { SQRT_2 };
                Coefficient {
                    value: *value,
                    sigma,
                    bound: if *status == Status::Indeterminate {
                        f64::INFINITY
                    } else {
                        sigma
                    },
                    status: *status,
                }
            })
            .collect(),
        model: fit.model,
        parameters: fit.parameters,
        chi_square: fit.chi_square,
        samples: fit.samples,
        light_parameters: fit.light_parameters,
        aic: fit.aic,
        bic: fit.bic,
    }
}

/// The light that was found: its frequencies up to the band, and beyond it what the sources in it go on with.
pub fn light(found: &Factorisation) -> Lighting {
    light_of(found, |channel, p| {
        channel.status[p] != Status::Indeterminate
    })
}

/// The same with the known frequencies alone up to the band: the light under which the slice is recovered.
pub fn known_light(found: &Factorisation) -> Lighting {
    light_of(found, is_known)
}

/// |L_p|/σ from which a weakly determined frequency is better taken for what it was found to be than for none: a surface shows most of a sharp light by frequencies
/// that are known to 10 %, and their errors are followed into the slice's σ. Noise alone is that large once in 50.
const KNOWN: f64 = 2.0;

fn is_known(channel: &Channel, p: usize) -> bool {
    match channel.status[p] {
        Status::Determined => true,
        Status::Weak => channel.lighting.get(p as i64).norm() >= KNOWN * channel.sigma[p],
        Status::Indeterminate => false,
    }
}

/// Sources have all frequencies: what they bring within the band is taken from the smooth part, which holds the rest of L_p of the
/// frequencies that are `kept`. Of the others nothing is left where there are no sources; where there are, they go on there as they do beyond
/// the band.
fn light_of(found: &Factorisation, kept: impl Fn(&Channel, usize) -> bool) -> Lighting {
    let count = found.channels.len();
    let sources: Vec<Source> = found
        .channels
        .iter()
        .enumerate()
        .flat_map(|(c, channel)| {
            channel.sources.iter().map(move |&(theta, irradiance)| {
                let mut by_channel = vec![0.0; count];
                by_channel[c] = irradiance;
                Source {
                    theta,
                    irradiance: by_channel,
                }
            })
        })
        .collect();
    let smooth = found.channels.iter().enumerate().map(|(c, channel)| {
        let sharp = Lighting {
            channels: Vec::new(),
            sources: sources.clone(),
            ..Lighting::default()
        }
        .series(c, channel.band);
        let rest = sharp.coefficients.iter().enumerate().map(|(p, s)| {
            if kept(channel, p) {
                channel.lighting.get(p as i64) - s
            } else {
                Complex64::ZERO
            }
        });
        Series {
            coefficients: rest.collect(),
        }
    });
    Lighting {
        channels: found.channels.iter().map(|c| c.name.clone()).collect(),
        smooth: smooth.collect(),
        sources,
        ..Lighting::default()
    }
}

/// The samples without what the frequencies of the light that are not known did to them, as far as they show and where no sources stand for them: what is left is explained by the known light alone, at the same information per frequency.
///
/// Returned twice: with the samples' variances, and with what the light's own uncertainty by the noise adds to them,
/// Σ_p 2 |σ(L_p) B_p / L_p|² (B_p is proportional to L_p, eq. 11), so that columns in which the light's error shows most say least. How it reaches the slice's
/// σ, as one error of all samples, [`light_errors`] say. Where sources stand for L_p their error is what they miss of the determined frequencies.
pub fn known_part(found: &Factorisation, samples: &Samples) -> (Samples, Samples) {
    let mut part = samples.clone();
    let mut widened = samples.clone();
    let sources_miss: Vec<f64> = found.channels.iter().map(sources_miss).collect();
    for (c, channel) in found.channels.iter().enumerate() {
        let modelled = !channel.sources.is_empty();
        let known = |p: usize| p <= channel.band && is_known(channel, p);
        let spectra = factorise::spectra(samples, c);
        let columns = part.columns.par_iter_mut().zip(&mut widened.columns);
        columns.zip(spectra).for_each(|((column, wide), series)| {
            let Some(mut open) = series else {
                return;
            };
            let added: f64 = (1..=channel.band)
                .map(|p| {
                    let light = channel.lighting.get(p as i64).norm();
                    let share = match known(p) {
                        true => own_sigma(channel, p) / light.max(f64::MIN_POSITIVE),
                        false if modelled => sources_miss[c],
                        false => 0.0,
                    };
                    2.0 * (open.get(p as i64).norm() * share.min(1.0)).powi(2)
                })
                .sum();
            let shown = channel.band.max(channel.visible_band);
            for (p, b) in open.coefficients.iter_mut().enumerate() {
                if modelled || known(p) || p > shown {
                    *b = Complex64::ZERO;
                }
            }
            for i in 0..column.alpha.len() {
                if column.variance[c][i].is_finite() {
                    column.value[c][i] -= open.evaluate(column.alpha[i]);
                    wide.value[c][i] = column.value[c][i];
                    wide.variance[c][i] += added;
                }
            }
        });
    }
    (part, widened)
}

/// Root of the share of the power in the upper half of the determined frequencies that the channel's sources do not explain.
fn sources_miss(channel: &Channel) -> f64 {
    let (mut missed, mut power) = (0.0, f64::MIN_POSITIVE);
    for p in (channel.band / 2..=channel.band).filter(|&p| channel.status[p] == Status::Determined)
    {
        let sharp: Complex64 = channel
            .sources
            .iter()
            .map(|(theta, irradiance)| irradiance / TAU * Complex64::cis(-(p as f64) * theta.rad()))
            .sum();
        let l = channel.lighting.get(p as i64);
        missed += (l - sharp).norm_sqr();
        power += l.norm_sqr();
    }
    (missed / power).sqrt()
}

/// σ of L_p by the noise alone, without the errors that all samples share.
fn own_sigma(channel: &Channel, p: usize) -> f64 {
    let open = &channel.systematics.open;
    let shared: f64 = open.iter().map(|e| e.light.get(p as i64).norm_sqr()).sum();
    (channel.sigma[p].powi(2) - shared).max(0.0).sqrt()
}

/// How well the known frequencies of each channel's light are known, beside the errors that all samples share.
pub fn light_errors(found: &Factorisation) -> Vec<LightError> {
    found.channels.iter().map(light_error).collect()
}

fn light_error(channel: &Channel) -> LightError {
    let frequencies: Vec<usize> = (1..=channel.band)
        .filter(|&p| is_known(channel, p))
        .collect();
    let fitted: Vec<usize> = channel.frequencies.iter().copied().skip(1).collect();
    let part = |series: &Series, p: usize, k: usize| {
        let l = series.get(p as i64);
        if k == 0 { l.re } else { l.im }
    };
    let size = 2 * frequencies.len();
    let mut covariance = Vec::with_capacity(size * size);
    for i in 0..size {
        for j in 0..size {
            let (p, q) = (frequencies[i / 2], frequencies[j / 2]);
            let place = |p: usize| fitted.iter().position(|&f| f == p);
            covariance.push(match (place(p), place(q)) {
                (Some(a), Some(b)) => {
                    let index = (2 * a + i % 2) * 2 * fitted.len() + 2 * b + j % 2;
                    let open = channel.systematics.open.iter();
                    let shared: f64 = open
                        .map(|e| part(&e.light, p, i % 2) * part(&e.light, q, j % 2))
                        .sum();
                    channel.covariance.get(index).copied().unwrap_or(0.0) - shared
                }
                // Regressed one by one.
                (None, None) if i == j => 0.5 * channel.sigma[p].powi(2),
                _ => 0.0,
            });
        }
    }
    LightError {
        frequencies,
        covariance,
    }
}

/// The samples without the errors that all of them share, as far as the factorisation found them.
pub fn corrected(found: &Factorisation, samples: &Samples, systematics: &[Systematic]) -> Samples {
    let mut samples = samples.clone();
    for (c, channel) in found.channels.iter().enumerate() {
        for (j, column) in samples.columns.iter_mut().enumerate() {
            let change = combined(systematics, &channel.systematics.found, c, j, column);
            for (value, change) in column.value[c].iter_mut().zip(change) {
                *value -= change;
            }
        }
    }
    samples
}

/// What is still open of those errors: by how much they change the samples while the light stays as it was found.
///
/// The light that goes along with each error changes them too: an error that it makes up for changes nothing.
pub fn open_systematics(
    found: &Factorisation,
    samples: &Samples,
    systematics: &[Systematic],
) -> Vec<Systematic> {
    let responses: Vec<Vec<Vec<Complex64>>> = found
        .channels
        .iter()
        .map(|channel| responses(found, channel, samples))
        .collect();
    (0..systematics.len())
        .map(|k| Systematic {
            name: format!("combination {k} of the errors of the geometry"),
            change: found
                .channels
                .iter()
                .enumerate()
                .map(|(c, channel)| {
                    let Some(open) = channel.systematics.open.get(k) else {
                        let none = samples.columns.iter().map(|s| vec![0.0; s.alpha.len()]);
                        return none.collect();
                    };
                    let columns = samples.columns.iter().zip(&responses[c]).enumerate();
                    columns
                        .map(|(j, (column, response))| {
                            let along = Series {
                                coefficients: response
                                    .iter()
                                    .zip(&open.light.coefficients)
                                    .map(|(h, l)| h * l)
                                    .collect(),
                            };
                            combined(systematics, &open.errors, c, j, column)
                                .into_iter()
                                .zip(&column.alpha)
                                .map(|(change, alpha)| change + along.evaluate(*alpha))
                                .collect()
                        })
                        .collect()
                })
                .collect(),
        })
        .collect()
}

/// Σ of `amounts` of the errors at the samples of column `j`.
fn combined(
    systematics: &[Systematic],
    amounts: &[f64],
    channel: usize,
    j: usize,
    column: &Column,
) -> Vec<f64> {
    let mut sum = vec![0.0; column.alpha.len()];
    for (error, amount) in systematics.iter().zip(amounts) {
        let change = error.change.get(channel).and_then(|c| c.get(j));
        for (sum, change) in sum.iter_mut().zip(change.into_iter().flatten()) {
            *sum += amount * change;
        }
    }
    sum
}

/// H_p(θo′) = ∫ ρ̂(θi′, θo′) e^{ipθi′} dθi′ of the factorisation's own slice at each column of the samples; 0 for frequencies that are
/// not determined.
fn responses(found: &Factorisation, channel: &Channel, samples: &Samples) -> Vec<Vec<Complex64>> {
    let nodes = found.nodes.len();
    let step = PI / nodes.max(1) as f64;
    let place = |column: &Column| {
        let k = (column.local.rad() + FRAC_PI_2) / step - 0.5;
        (k.round().max(0.0) as usize).min(nodes.saturating_sub(1))
    };
    samples
        .columns
        .par_iter()
        .map(|column| {
            let k = place(column);
            let mut out = vec![Complex64::ZERO; channel.band + 1];
            for (i, node) in found.nodes.iter().enumerate() {
                let rho = channel.brdf.get(i * nodes + k).copied().unwrap_or(0.0);
                let turn = Complex64::cis(node.rad());
                let mut term = Complex64::from(rho * node.visible_cosine() * step);
                for (h, status) in out.iter_mut().zip(&channel.status) {
                    if *status == Status::Determined {
                        *h += term;
                    }
                    term *= turn;
                }
            }
            out
        })
        .collect()
}

/// How many σ a coefficient of the slice must have to show that the surface passes its frequency.
const SHOWS: f64 = 5.0;

/// Takes back what was said of frequencies that do not show in the light field and that the slice does not show to
/// pass either: they may be dark or invisible, and nothing tells which.
///
/// The factorisation calls them dark where its own ρ̃ passes them; but what that ρ̃ is there rests on no data, and only
/// the slice, fitted with its σ, says so.
pub fn retract_unseen(found: &mut Factorisation, slice: &BrdfEstimate) {
    for (channel, slice) in found.channels.iter_mut().zip(&slice.slices) {
        let passes = |p: usize| {
            slice.spectrum.iter().any(|c| {
                [c.p, c.q].map(|f| f.unsigned_abs() as usize).contains(&p)
                    && c.value.norm() > SHOWS * c.sigma
            })
        };
        let mean = channel.lighting.get(0).re;
        for p in 1..=channel.band {
            if !channel.frequencies.contains(&p)
                && channel.status[p] != Status::Indeterminate
                && !passes(p)
            {
                channel.status[p] = Status::Indeterminate;
                channel.lighting.coefficients[p] = Complex64::ZERO;
                channel.sigma[p] = mean;
            }
        }
    }
}

/// The light as a lighting recovery gives it: a table with σ and a spectrum with status.
pub fn lighting(found: &Factorisation, fit: &[FitQuality]) -> LightingEstimate {
    LightingEstimate {
        channels: found
            .channels
            .iter()
            .zip(fit)
            .map(|(channel, fit)| ChannelEstimate {
                name: channel.name.clone(),
                table: (0..TABLE)
                    .map(|k| channel.lighting.evaluate(angle(k)))
                    .collect(),
                table_sigma: (0..TABLE).map(|k| sigma_at(channel, angle(k))).collect(),
                smooth: channel.lighting.clone(),
                irradiance: Vec::new(),
                spectrum: spectrum(channel),
                determined_band: spectrum(channel)
                    .iter()
                    .take_while(|c| c.status == Status::Determined)
                    .count()
                    .checked_sub(1),
                residual_rms: fit.residual_rms,
                residual_relative: fit.residual_relative,
                chi2: fit.chi2,
                regularisation: RegularisationChoice {
                    criterion: "none".into(),
                    strength: 0.0,
                    curve: Vec::new(),
                },
            })
            .collect(),
        sources: Vec::new(),
    }
}

fn angle(k: usize) -> f64 {
    -PI + 2.0 * PI * k as f64 / TABLE as f64
}

/// σ of L(θ) = L_0 + 2 Σ (Re L_p cos pθ − Im L_p sin pθ).
fn sigma_at(channel: &Channel, theta: f64) -> f64 {
    let fitted: Vec<usize> = channel.frequencies.iter().copied().skip(1).collect();
    let size = 2 * fitted.len();
    let gradient: Vec<f64> = fitted
        .iter()
        .flat_map(|&p| {
            let (sin, cos) = (p as f64 * theta).sin_cos();
            [2.0 * cos, -2.0 * sin]
        })
        .collect();
    let mut variance = 0.0;
    for (row, g) in channel.covariance.chunks_exact(size.max(1)).zip(&gradient) {
        variance += g * row.iter().zip(&gradient).map(|(c, h)| c * h).sum::<f64>();
    }
    // The others were regressed one by one: (2σ/√2)² each.
    let others = (1..=channel.band).filter(|p| !fitted.contains(p));
    variance += others.map(|p| 2.0 * channel.sigma[p].powi(2)).sum::<f64>();
    variance.max(0.0).sqrt()
}

fn spectrum(channel: &Channel) -> Vec<Coefficient> {
    (0..=channel.band)
        .map(|p| {
            let status = channel.status[p];
            // L_0 is real, and known as well as the scale.
            let parts = if p == 0 { 1.0 } else { SQRT_2 };
            let sigma = channel.sigma[p] / parts;
            Coefficient {
                value: channel.lighting.get(p as i64),
                sigma,
                // The covariance is the inverse information at the estimate.
                bound: if status == Status::Indeterminate {
                    f64::INFINITY
                } else {
                    sigma
                },
                status,
            }
        })
        .collect()
}

/// The gauge of every channel.
pub fn gauge(found: &Factorisation) -> Vec<ChannelGauge> {
    found
        .channels
        .iter()
        .map(|channel| {
            let undetermined: Vec<usize> = (0..=channel.band)
                .filter(|&p| channel.status[p] != Status::Determined)
                .collect();
            let difference = |other: &Series| {
                let (mut square, mut norm) = (0.0, f64::MIN_POSITIVE);
                for p in (0..=channel.band).filter(|p| !undetermined.contains(p)) {
                    let l = channel.lighting.get(p as i64);
                    let both = if p == 0 { 1.0 } else { 2.0 };
                    square += both * (other.get(p as i64) - l).norm_sqr();
                    norm += both * l.norm_sqr();
                }
                (square / norm).sqrt()
            };
            ChannelGauge {
                channel: channel.name.clone(),
                scale: channel.scale.clone(),
                band: channel.band,
                resolved: channel.resolved,
                components: channel.components.clone(),
                eigenvalues: channel.eigenvalues.clone(),
                misfit: channel.misfit,
                converged: channel.converged,
                eigenproblem_difference: difference(&channel.start),
                ratios_difference: difference(&channel.ratio),
                eigenproblem: channel.start.clone(),
                ratios: channel.ratio.clone(),
                parametric: None,
                undetermined,
            }
        })
        .collect()
}
