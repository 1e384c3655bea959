//! Distant sources beside the smooth light: their exact response, and the improvement of their
//! directions.

use rayon::prelude::*;

use crate::angle::{NormalAngle, WorldAngle};
use crate::brdf::{Brdf, Isotropic, Pair};
use crate::light_field::Samples;

/// Step (radians) of the central difference for a response's derivative by direction.
const DIFFERENCE: f64 = 2e-4;

/// A function of the samples, \[column\]\[n\].
pub type Response = Vec<Vec<f64>>;

/// B of a unit source (1 W m⁻² on a surface facing it) at `theta` (radians) for every sample,
/// ρ̂(θ − α, θo′), by each of some BRDFs; 0 for samples that no channel has.
///
/// A mirror's delta is not resolved by samples; its part of the response is left out.
pub fn unit_responses(samples: &Samples, brdfs: &[&dyn Brdf], theta: f64) -> Vec<Response> {
    let theta = WorldAngle::radians(theta);
    let forms: Vec<Option<&dyn Isotropic>> = brdfs.iter().map(|b| b.isotropic()).collect();
    let columns: Vec<Vec<Vec<f64>>> = samples
        .columns
        .par_iter()
        .map(|column| {
            let pair_of = Pair::towards(column.local);
            let mut responses = vec![vec![0.0; column.alpha.len()]; brdfs.len()];
            for (i, &alpha) in column.alpha.iter().enumerate() {
                let incident = theta - NormalAngle::radians(alpha);
                if !incident.is_visible() || !column.variance.iter().any(|v| v[i].is_finite()) {
                    continue;
                }
                let pair = pair_of(incident);
                for ((response, brdf), form) in responses.iter_mut().zip(brdfs).zip(&forms) {
                    response[i] = match (form, &pair) {
                        (Some(form), Some(pair)) => form.rho(pair) * pair.cos_incident,
                        (Some(_), None) => 0.0,
                        _ => brdf.value(incident, column.local) * incident.visible_cosine(),
                    };
                }
            }
            responses
        })
        .collect();
    let mut all: Vec<Response> = vec![Vec::with_capacity(columns.len()); brdfs.len()];
    for column in columns {
        for (response, column) in all.iter_mut().zip(column) {
            response.push(column);
        }
    }
    all
}

/// The derivatives of [`unit_responses`] by the direction, per radian.
pub fn response_derivatives(samples: &Samples, brdfs: &[&dyn Brdf], theta: f64) -> Vec<Response> {
    let mut derivatives = unit_responses(samples, brdfs, theta + DIFFERENCE);
    let before = unit_responses(samples, brdfs, theta - DIFFERENCE);
    for (derivative, before) in derivatives.iter_mut().zip(before) {
        for (column, before) in derivative.iter_mut().zip(before) {
            for (d, b) in column.iter_mut().zip(before) {
                *d = (*d - b) / (2.0 * DIFFERENCE);
            }
        }
    }
    derivatives
}

/// Σ w f g over samples of weights w; f and g at samples of weight 0 are ignored.
pub fn weighted_product(weights: &[Vec<f64>], f: &[Vec<f64>], g: &[Vec<f64>]) -> f64 {
    pulp::Arch::new().dispatch(Product { weights, f, g })
}

/// The work of [`weighted_product`], with the processor's widest instructions.
struct Product<'a> {
    weights: &'a [Vec<f64>],
    f: &'a [Vec<f64>],
    g: &'a [Vec<f64>],
}

impl pulp::WithSimd for Product<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> f64 {
        let zero = simd.splat_f64s(0.0);
        let mut total = 0.0;
        for ((weights, f), g) in self.weights.iter().zip(self.f).zip(self.g) {
            let [(w, w_rest), (f, f_rest), (g, g_rest)] =
                [weights, f, g].map(|list| S::as_simd_f64s(list));
            let mut sum = zero;
            for ((&w, &f), &g) in w.iter().zip(f).zip(g) {
                let product = simd.mul_f64s(simd.mul_f64s(w, f), g);
                let present = simd.greater_than_f64s(w, zero);
                sum = simd.add_f64s(sum, simd.select_f64s(present, product, zero));
            }
            total += simd.reduce_sum_f64s(sum);
            for ((w, f), g) in w_rest.iter().zip(f_rest).zip(g_rest) {
                if *w > 0.0 {
                    total += w * f * g;
                }
            }
        }
        total
    }
}
