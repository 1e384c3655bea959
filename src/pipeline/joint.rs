//! The factorisation's result on its way to the products: light and gauge.

use std::f64::consts::{PI, SQRT_2};

use serde::{Deserialize, Serialize};

use super::fit::FitQuality;
use crate::brdf::fit::FittedParameter;
use crate::fourier::Series;
use crate::light_field::Samples;
use crate::recover::Status;
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
