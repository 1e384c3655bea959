//! Distant sources beside the smooth light: their exact response, and the improvement of their
//! directions.

use rayon::prelude::*;

use crate::angle::{NormalAngle, WorldAngle};
use crate::brdf::Brdf;
use crate::light_field::Samples;

/// Step (radians) of the central difference for a response's derivative by direction.
const DIFFERENCE: f64 = 2e-4;

/// A function of the samples, \[column\]\[n\].
pub type Response = Vec<Vec<f64>>;

/// B of a unit source (1 W m⁻² on a surface facing it) at `theta` (radians) for every sample,
/// ρ̂(θ − α, θo′); 0 for samples that no channel has.
///
/// A mirror's delta is not resolved by samples; its part of the response is left out.
pub fn unit_response(samples: &Samples, brdf: &dyn Brdf, theta: f64) -> Response {
    let theta = WorldAngle::radians(theta);
    samples
        .columns
        .par_iter()
        .map(|column| {
            let seen = |i: usize| column.variance.iter().any(|v| v[i].is_finite());
            column
                .alpha
                .iter()
                .enumerate()
                .map(|(i, &alpha)| {
                    let incident = theta - NormalAngle::radians(alpha);
                    let cosine = incident.visible_cosine();
                    if cosine > 0.0 && seen(i) {
                        brdf.value(incident, column.local) * cosine
                    } else {
                        0.0
                    }
                })
                .collect()
        })
        .collect()
}

/// The derivative of [`unit_response`] by the direction, per radian.
pub fn response_derivative(samples: &Samples, brdf: &dyn Brdf, theta: f64) -> Response {
    let mut derivative = unit_response(samples, brdf, theta + DIFFERENCE);
    let before = unit_response(samples, brdf, theta - DIFFERENCE);
    for (column, before) in derivative.iter_mut().zip(before) {
        for (d, b) in column.iter_mut().zip(before) {
            *d = (*d - b) / (2.0 * DIFFERENCE);
        }
    }
    derivative
}

/// Σ w f g over samples of weights w; f and g at samples of weight 0 are ignored.
pub fn weighted_product(weights: &[Vec<f64>], f: &[Vec<f64>], g: &[Vec<f64>]) -> f64 {
    let product = |w: f64, f: f64, g: f64| if w > 0.0 { w * f * g } else { 0.0 };
    let mut total = 0.0;
    for ((weights, f), g) in weights.iter().zip(f).zip(g) {
        // Four sums side by side, so that none waits for the one before.
        let (w, f, g) = (
            weights.as_chunks::<4>(),
            f.as_chunks::<4>(),
            g.as_chunks::<4>(),
        );
        let mut sums = [0.0; 4];
        for ((w, f), g) in w.0.iter().zip(f.0).zip(g.0) {
            for k in 0..4 {
                sums[k] += product(w[k], f[k], g[k]);
            }
        }
        total += sums.iter().sum::<f64>();
        for ((w, f), g) in w.1.iter().zip(f.1).zip(g.1) {
            total += product(*w, *f, *g);
        }
    }
    total
}
