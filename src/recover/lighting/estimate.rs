//! The recovered lighting with its uncertainty, as products and the report take it.

use num_complex::Complex64;
use serde::{Deserialize, Serialize};

use crate::fourier::Series;
use crate::recover::Status;

/// Recovered lighting, all channels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightingEstimate {
    /// One estimate per channel, in the samples' order.
    pub channels: Vec<ChannelEstimate>,
    /// Sources found beside the smooth light; their irradiance is part of every table and spectrum.
    pub sources: Vec<SourceEstimate>,
}

/// Recovered lighting of one channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelEstimate {
    /// Channel name.
    pub name: String,
    /// L(θ), W m⁻² rad⁻¹, every 0.5° from −180°, \[720\].
    pub table: Vec<f64>,
    /// Standard deviation of each value of `table`, \[720\].
    pub table_sigma: Vec<f64>,
    /// The smooth part of the light, without the sources.
    pub smooth: Series,
    /// Irradiance of each source in this channel, W m⁻².
    pub irradiance: Vec<f64>,
    /// L_p for 0 ≤ p ≤ band, of smooth part and sources together.
    pub spectrum: Vec<Coefficient>,
    /// Largest p up to which every coefficient is determined.
    pub determined_band: Option<usize>,
    /// Root mean square of measured − predicted over the samples.
    pub residual_rms: f64,
    /// `residual_rms` relative to the largest measured value.
    pub residual_relative: f64,
    /// Mean squared residual in units of the samples' variance.
    pub chi2: f64,
    /// How the strength of the regularisation was chosen.
    pub regularisation: RegularisationChoice,
}

/// One recovered Fourier coefficient (eq. 6).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coefficient {
    /// L_p.
    pub value: Complex64,
    /// Standard deviation of the real and of the imaginary part.
    pub sigma: f64,
    /// Cramér–Rao bound of that standard deviation without any prior; infinite if the data say
    /// nothing.
    #[serde(deserialize_with = "crate::fourier::or_infinite")]
    pub bound: f64,
    /// What the data say about it.
    pub status: Status,
}

/// A source that was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceEstimate {
    /// Direction, degrees.
    pub theta_deg: f64,
    /// Its standard deviation, degrees.
    pub theta_sigma_deg: f64,
    /// Irradiance per channel, W m⁻².
    pub irradiance: Vec<f64>,
    /// Its standard deviation, W m⁻².
    pub irradiance_sigma: Vec<f64>,
}

impl SourceEstimate {
    /// `37.29990° ± 0.00047°`: both to the second digit of σ, so that a small one does not read as none.
    pub fn direction(&self) -> String {
        let (theta, sigma) = (self.theta_deg, self.theta_sigma_deg);
        let decimals = if sigma > 0.0 && sigma.is_finite() {
            (1.0 - sigma.log10().floor()).clamp(0.0, 9.0) as usize
        } else {
            3
        };
        format!("{theta:.decimals$}° ± {sigma:.decimals$}°")
    }
}

/// The regularisation's strength and the criterion that chose it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegularisationChoice {
    /// `gcv`, `evidence`, `truncate`, `none` or `fixed`.
    pub criterion: String,
    /// The chosen strength.
    pub strength: f64,
    /// (strength, criterion) at all strengths tried: smaller is better.
    pub curve: Vec<(f64, f64)>,
}
