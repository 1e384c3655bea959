//! Distant sources beside the smooth light: their exact response, and the improvement of their
//! directions.

use rayon::prelude::*;

use crate::angle::{NormalAngle, WorldAngle};
use crate::brdf::Brdf;
use crate::light_field::Samples;

/// B of a unit source (1 W m⁻² on a surface facing it) at `theta` for every sample,
/// ρ̂(θ − α, θo′), \[column\]\[n\].
///
/// A mirror's delta is not resolved by samples; its part of the response is left out.
pub fn unit_response(samples: &Samples, brdf: &dyn Brdf, theta: WorldAngle) -> Vec<Vec<f64>> {
    samples
        .columns
        .par_iter()
        .map(|column| {
            column
                .alpha
                .iter()
                .map(|&alpha| {
                    let incident = theta - NormalAngle::radians(alpha);
                    let cosine = incident.visible_cosine();
                    if cosine > 0.0 {
                        brdf.value(incident, column.local) * cosine
                    } else {
                        0.0
                    }
                })
                .collect()
        })
        .collect()
}

/// Σ w f g over the samples of `channel`.
pub fn weighted_product(samples: &Samples, channel: usize, f: &[Vec<f64>], g: &[Vec<f64>]) -> f64 {
    let sums: Vec<f64> = samples
        .columns
        .par_iter()
        .zip(f)
        .zip(g)
        .map(|((column, f), g)| {
            column.variance[channel]
                .iter()
                .zip(f)
                .zip(g)
                .filter(|((v, _), _)| v.is_finite() && **v > 0.0)
                .map(|((v, f), g)| f * g / v)
                .sum()
        })
        .collect();
    sums.iter().sum()
}
