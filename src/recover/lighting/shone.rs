//! What distant sources give in the samples, and its products with all that it is fitted beside.

use std::ops::Range;
use std::sync::Arc;

use super::mixture::Channel;
use super::sources::{Lit, Response, weighted_product};
use crate::brdf::Brdf;
use crate::light_field::Samples;
use crate::recover::normal::{NormalSystem, in_chunks};

/// Sums over a channel's samples of what some sources give: r_s, the responses to unit irradiance, and d_s, their derivatives by the
/// direction, in the order r_0, d_0, r_1, d_1 …
#[derive(Debug, Default)]
pub struct Sums {
    /// Dᵀ W f, \[function\]\[unknown\].
    projected: Vec<Vec<f64>>,
    /// Σ w f g with r_0, r_1 …, the systematic errors, the samples' values and, of a derivative, with itself, \[function\]\[g\].
    products: Vec<Vec<f64>>,
}

impl Sums {
    pub fn sources(&self) -> usize {
        self.projected.len() / 2
    }

    /// Dᵀ W r_s and the products of r_s.
    pub fn response(&self, s: usize) -> (&[f64], &[f64]) {
        (&self.projected[2 * s], &self.products[2 * s])
    }

    /// Dᵀ W d_s and the products of d_s.
    pub fn derivative(&self, s: usize) -> (&[f64], &[f64]) {
        (&self.projected[2 * s + 1], &self.products[2 * s + 1])
    }

    fn add(&mut self, other: &Self) {
        let own = self.projected.iter_mut().chain(&mut self.products);
        let more = other.projected.iter().chain(&other.products);
        for (a, b) in own.flatten().zip(more.flatten()) {
            *a += b;
        }
    }
}

/// What sources in some directions give in the samples of all channels.
#[derive(Debug)]
pub struct Shone {
    /// θ of the sources, radians.
    pub directions: Vec<f64>,
    /// Responses to unit irradiance, \[channel\]\[source\].
    pub responses: Vec<Vec<Arc<Response>>>,
    /// \[channel\].
    pub sums: Vec<Sums>,
}

impl Shone {
    /// Column by column from the responses to the sums, so that a thread waits for the others but once.
    pub fn new(lit: &Lit<'_>, channels: &[Channel<'_>], directions: &[f64]) -> Self {
        let first = |c: usize| channels.get(c).is_some_and(|channel| channel.twin == c);
        let distinct: Vec<&dyn Brdf> = (0..channels.len())
            .filter(|&c| first(c))
            .map(|c| channels[c].brdf)
            .collect();
        // Place of each channel's BRDF among the distinct ones.
        let places: Vec<usize> = channels
            .iter()
            .map(|channel| (0..channel.twin).filter(|&c| first(c)).count())
            .collect();
        let parts = match directions {
            [] => Vec::new(),
            _ => in_chunks(lit.samples, |columns| {
                let made: Vec<[Vec<Response>; 2]> = directions
                    .iter()
                    .map(|&theta| lit.with_derivatives(columns.clone(), &distinct, theta))
                    .collect();
                let sums = sums_of(lit.samples, channels, &places, &made, &columns);
                let responses: Vec<Vec<Response>> =
                    made.into_iter().map(|[responses, _]| responses).collect();
                (responses, sums)
            }),
        };
        let mut responses = vec![vec![Response::new(); distinct.len()]; directions.len()];
        let mut sums: Vec<Sums> = Vec::new();
        for (made, more) in parts {
            for (all, columns) in responses
                .iter_mut()
                .flatten()
                .zip(made.into_iter().flatten())
            {
                all.extend(columns);
            }
            match sums.is_empty() {
                true => sums = more,
                false => sums.iter_mut().zip(&more).for_each(|(a, b)| a.add(b)),
            }
        }
        sums.resize_with(channels.len(), Sums::default);
        let responses: Vec<Vec<Arc<Response>>> = responses
            .into_iter()
            .map(|of_source| of_source.into_iter().map(Arc::new).collect())
            .collect();
        Self {
            directions: directions.to_vec(),
            responses: places
                .iter()
                .map(|&b| responses.iter().map(|of| Arc::clone(&of[b])).collect())
                .collect(),
            sums,
        }
    }
}

/// What some columns add to the sums of each channel; `made` holds the sources' responses and derivatives there by BRDF, and `places` which BRDF a
/// channel has.
fn sums_of(
    samples: &Samples,
    channels: &[Channel<'_>],
    places: &[usize],
    made: &[[Vec<Response>; 2]],
    columns: &Range<usize>,
) -> Vec<Sums> {
    // A response and its derivative vanish at the same samples.
    let functions: Vec<&Vec<Response>> = made.iter().flatten().collect();
    let all: Vec<(&NormalSystem, &[Vec<f64>])> = functions
        .iter()
        .flat_map(|f| {
            let both = channels.iter().zip(places);
            both.map(|(channel, &b)| (&channel.system, f[b].as_slice()))
        })
        .collect();
    let projected = NormalSystem::project_columns(samples, columns.clone(), &all);
    let mut sums: Vec<Sums> = channels
        .iter()
        .zip(places)
        .map(|(channel, &b)| {
            let products = |(k, f): (usize, &&Vec<Response>)| -> Vec<f64> {
                let f = f[b].as_slice();
                let weights = part(&channel.system.weights, columns);
                let with = |g: &[Vec<f64>]| weighted_product(weights, f, g);
                let errors = channel.systematics.iter().map(|e| with(part(e, columns)));
                made.iter()
                    .map(|[responses, _]| with(&responses[b]))
                    .chain(errors)
                    .chain([with(part(&channel.values, columns))])
                    .chain((k % 2 == 1).then(|| with(f)))
                    .collect()
            };
            Sums {
                projected: Vec::with_capacity(functions.len()),
                products: functions.iter().enumerate().map(products).collect(),
            }
        })
        .collect();
    for (k, y) in projected.into_iter().enumerate() {
        sums[k % channels.len()].projected.push(y);
    }
    sums
}

/// A function of the samples in some columns.
fn part<'a>(of: &'a Response, columns: &Range<usize>) -> &'a [Vec<f64>] {
    of.get(columns.clone()).unwrap_or_default()
}
