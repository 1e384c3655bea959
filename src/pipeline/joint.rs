//! The factorisation's result on its way to the products: light, slice and gauge.

use std::f64::consts::{PI, SQRT_2};

use serde::{Deserialize, Serialize};

use super::fit::FitQuality;
use crate::error::Result;
use crate::fourier::Series;
use crate::light_field::Samples;
use crate::lighting::Lighting;
use crate::recover::brdf::{self, BrdfEstimate};
use crate::recover::factorise::{Channel, Factorisation};
use crate::recover::lighting::{
    ChannelEstimate, Coefficient, LightingEstimate, RegularisationChoice, TABLE,
};
use crate::recover::{Status, factorise};

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
}

/// The light that was found: band-limited.
pub fn light(found: &Factorisation) -> Lighting {
    Lighting::band_limited(
        found.channels.iter().map(|c| c.name.clone()).collect(),
        found.channels.iter().map(|c| c.lighting.clone()).collect(),
    )
}

/// The BRDF slice under the light that was found, with the light's own uncertainty in its σ.
///
/// # Errors
/// As [`brdf::recover`].
pub fn brdf(
    found: &Factorisation,
    samples: &Samples,
    options: &brdf::Options,
) -> Result<BrdfEstimate> {
    let mut estimate = brdf::recover(samples, &light(found), options)?;
    for (slice, channel) in estimate.slices.iter_mut().zip(&found.channels) {
        let n = found.nodes.len();
        if n != estimate.size {
            continue;
        }
        for (k, sigma) in slice.sigma.iter_mut().enumerate() {
            let cosines = found.nodes[k / n].visible_cosine() * found.nodes[k % n].visible_cosine();
            *sigma = sigma.max(channel.brdf_sigma[k] * cosines);
        }
    }
    Ok(estimate)
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
            let status = match channel.status[p] {
                factorise::Status::Determined => Status::Determined,
                factorise::Status::Weak => Status::Weak,
                factorise::Status::Indeterminate => Status::Indeterminate,
            };
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
                .filter(|&p| channel.status[p] != factorise::Status::Determined)
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
                undetermined,
            }
        })
        .collect()
}
