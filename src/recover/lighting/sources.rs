//! Distant sources beside the smooth light: their exact response, and the improvement of their
//! directions.

use std::ops::Range;

use rayon::prelude::*;

use crate::angle::{NormalAngle, WorldAngle};
use crate::brdf::{Brdf, Pair};
use crate::light_field::{Column, Samples};

/// Step (radians) of the central difference for a response's derivative by direction.
const DIFFERENCE: f64 = 2e-4;

/// A function of the samples, \[column\]\[n\].
pub type Response = Vec<Vec<f64>>;

/// Samples prepared for sources from many directions.
pub struct Lit<'a> {
    /// The samples.
    pub samples: &'a Samples,
    /// Sine and cosine of α/2, \[column\]\[n\].
    halves: Vec<Vec<(f64, f64)>>,
    /// Places of the samples that any channel has, \[column\].
    present: Vec<Vec<usize>>,
}

impl<'a> Lit<'a> {
    pub fn new(samples: &'a Samples) -> Self {
        let halves = |column: &Column| {
            let half = |alpha: &f64| (0.5 * alpha).sin_cos();
            column.alpha.iter().map(half).collect()
        };
        let present = |column: &Column| {
            let any = |i: &usize| column.variance.iter().any(|v| v[*i].is_finite());
            (0..column.alpha.len()).filter(any).collect()
        };
        Self {
            samples,
            halves: samples.columns.iter().map(halves).collect(),
            present: samples.columns.iter().map(present).collect(),
        }
    }

    /// B of a unit source (1 W m⁻² on a surface facing it) at `theta` (radians) for every sample,
    /// ρ̂(θ − α, θo′), by each of some BRDFs; 0 for samples that no channel has.
    ///
    /// A mirror's delta is not resolved by samples; its part of the response is left out.
    pub fn unit_responses(&self, brdfs: &[&dyn Brdf], theta: f64) -> Vec<Response> {
        let columns: Vec<Vec<Vec<f64>>> = (0..self.samples.columns.len())
            .into_par_iter()
            .map(|j| self.of_column(j, brdfs, theta))
            .collect();
        let mut all: Vec<Response> = vec![Vec::with_capacity(columns.len()); brdfs.len()];
        for column in columns {
            for (response, column) in all.iter_mut().zip(column) {
                response.push(column);
            }
        }
        all
    }

    /// [`Self::unit_responses`] in one column, by BRDF.
    fn of_column(&self, j: usize, brdfs: &[&dyn Brdf], theta: f64) -> Vec<Vec<f64>> {
        let (column, halves) = (&self.samples.columns[j], &self.halves[j]);
        let mut responses = vec![vec![0.0; column.alpha.len()]; brdfs.len()];
        // (θ − α)/2 by the addition theorem: no sine of every sample's own.
        let (sin, cos) = (0.5 * theta).sin_cos();
        let pair_of = Pair::towards_of_half(column.local);
        let most = self.present[j].len();
        let (mut places, mut pairs) = (Vec::with_capacity(most), Vec::with_capacity(most));
        for &i in &self.present[j] {
            let (s, c) = halves[i];
            let half = (sin * c - cos * s, cos * c + sin * s);
            // θ − α in [−π, π).
            let half = if half.1 < 0.0 {
                (-half.0, -half.1)
            } else {
                half
            };
            if let Some(pair) = pair_of(half) {
                places.push(i);
                pairs.push(pair);
            }
        }
        let mut rho = Vec::with_capacity(pairs.len());
        for (response, brdf) in responses.iter_mut().zip(brdfs) {
            if let Some(form) = brdf.isotropic() {
                form.rho_of_all(&pairs, &mut rho);
                for ((&i, pair), rho) in places.iter().zip(&pairs).zip(&rho) {
                    response[i] = rho * pair.cos_incident;
                }
                continue;
            }
            for &i in &self.present[j] {
                let incident = WorldAngle::radians(theta) - NormalAngle::radians(column.alpha[i]);
                if incident.is_visible() {
                    response[i] = brdf.value(incident, column.local) * incident.visible_cosine();
                }
            }
        }
        responses
    }

    /// [`Self::unit_responses`] in some columns, \[BRDF\]\[column\]\[n\], and their derivatives by the direction, per radian.
    pub fn with_derivatives(
        &self,
        columns: Range<usize>,
        brdfs: &[&dyn Brdf],
        theta: f64,
    ) -> [Vec<Response>; 2] {
        let [mut responses, mut derivatives] =
            [(); 2].map(|()| vec![Vec::with_capacity(columns.len()); brdfs.len()]);
        for j in columns {
            let [here, before, after] =
                [0.0, -DIFFERENCE, DIFFERENCE].map(|step| self.of_column(j, brdfs, theta + step));
            for (all, column) in responses.iter_mut().zip(here) {
                all.push(column);
            }
            for (all, (mut column, before)) in
                derivatives.iter_mut().zip(after.into_iter().zip(before))
            {
                for (d, b) in column.iter_mut().zip(before) {
                    *d = (*d - b) / (2.0 * DIFFERENCE);
                }
                all.push(column);
            }
        }
        [responses, derivatives]
    }
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
