//! The samples that an estimate of the lighting predicts.

use std::sync::Arc;

use num_complex::Complex64;
use rayon::prelude::*;

use super::LightingEstimate;
use super::sources::{Lit, Response};
use crate::brdf::{Brdf, Material, transfer_row};
use crate::fourier::{CircleTransform, Series, irregular};
use crate::light_field::{Column, Samples};

/// B that the estimate predicts for every sample that is not missing, \[channel\]\[column\]\[n\]; 0 for
/// the others.
pub fn predict(
    estimate: &LightingEstimate,
    material: &Material,
    samples: &Samples,
) -> Vec<Vec<Vec<f64>>> {
    predict_all(estimate, material, &[samples])
        .pop()
        .unwrap_or_default()
}

/// The same for several sets of samples, \[set\]\[channel\]\[column\]\[n\]: what their columns have in common is computed once.
pub fn predict_all(
    estimate: &LightingEstimate,
    material: &Material,
    sets: &[&Samples],
) -> Vec<Vec<Vec<Vec<f64>>>> {
    let transfers = Transfers::new(estimate, material, sets);
    sets.iter()
        .map(|samples| {
            let sources = of_sources(estimate, material, samples);
            let columns: Vec<Vec<Vec<f64>>> = samples
                .columns
                .par_iter()
                .enumerate()
                .map(|(j, column)| {
                    let mut predicted = smooth_columns(column, estimate, &transfers);
                    for (c, predicted) in predicted.iter_mut().enumerate() {
                        let irradiance = &estimate.channels[c].irradiance;
                        for (response, e) in sources[c].iter().zip(irradiance) {
                            for (b, f) in predicted.iter_mut().zip(&response[j]) {
                                *b += e * f;
                            }
                        }
                        for (b, v) in predicted.iter_mut().zip(&column.variance[c]) {
                            *b = if v.is_finite() { *b } else { 0.0 };
                        }
                    }
                    predicted
                })
                .collect();
            let mut channels = vec![Vec::with_capacity(columns.len()); estimate.channels.len()];
            for column in columns {
                for (channel, column) in channels.iter_mut().zip(column) {
                    channel.push(column);
                }
            }
            channels
        })
        .collect()
}

/// What the light's smooth part gives the samples of a column, \[channel\]\[n\].
fn smooth_columns(
    column: &Column,
    estimate: &LightingEstimate,
    transfers: &Transfers,
) -> Vec<Vec<f64>> {
    let reflected: Vec<Series> = estimate
        .channels
        .iter()
        .enumerate()
        .map(|(c, channel)| {
            let transfer = transfers.row(c, column).unwrap_or_default();
            let both = transfer.iter().zip(&channel.smooth.coefficients);
            Series {
                coefficients: both.map(|(h, l)| h * l).collect(),
            }
        })
        .collect();
    match column.regular() {
        Some(n) => {
            let circle = CircleTransform::new(n, column.alpha[0]);
            reflected.iter().map(|s| circle.synthesise(s)).collect()
        }
        None => {
            let series: Vec<&Series> = reflected.iter().collect();
            irregular::synthesise(&irregular::turns(&column.alpha), &series)
        }
    }
}

/// What a unit of each source gives the samples, \[channel\]\[source\]\[column\]\[n\].
fn of_sources(
    estimate: &LightingEstimate,
    material: &Material,
    samples: &Samples,
) -> Vec<Vec<Arc<Response>>> {
    let lit = Lit::new(samples);
    let firsts: Vec<usize> = (0..material.brdfs.len())
        .filter(|&c| twin(material, c) == c)
        .collect();
    let brdfs: Vec<&dyn Brdf> = firsts.iter().map(|&c| material.brdfs[c].as_ref()).collect();
    let by_source: Vec<Vec<Arc<Response>>> = estimate
        .sources
        .iter()
        .map(|source| {
            let responses = lit.unit_responses(&brdfs, source.theta_deg.to_radians());
            responses.into_iter().map(Arc::new).collect()
        })
        .collect();
    (0..estimate.channels.len())
        .map(|c| {
            let own = twin(material, c);
            let place = firsts.iter().take_while(|first| **first != own).count();
            let responses = by_source.iter().filter_map(|all| all.get(place));
            responses.map(Arc::clone).collect()
        })
        .collect()
}

/// The first channel that has the same BRDF.
fn twin(material: &Material, c: usize) -> usize {
    let same = |other: &usize| Arc::ptr_eq(&material.brdfs[*other], &material.brdfs[c]);
    (0..c).find(same).unwrap_or(c)
}

/// H_p of the columns of some samples.
struct Transfers {
    /// BRDF (the first channel that has it), order and θo′ (its bits) of each row, increasing.
    keys: Vec<(usize, usize, u64)>,
    /// H_p for 0 ≤ p ≤ order.
    rows: Vec<Vec<Complex64>>,
    /// BRDF and order of each channel.
    of_channel: Vec<(usize, usize)>,
}

impl Transfers {
    fn new(estimate: &LightingEstimate, material: &Material, sets: &[&Samples]) -> Self {
        let of_channel: Vec<(usize, usize)> = estimate
            .channels
            .iter()
            .enumerate()
            .map(|(c, channel)| (twin(material, c), channel.smooth.order()))
            .collect();
        let columns = sets.iter().flat_map(|samples| &samples.columns);
        let mut wanted: Vec<((usize, usize, u64), &Column)> = columns
            .flat_map(|column| {
                let seen = |c: usize| column.variance[c].iter().any(|v| v.is_finite());
                let channels = of_channel.iter().enumerate();
                let seen = channels.filter(move |(c, _)| seen(*c));
                seen.map(move |(_, (brdf, order))| {
                    ((*brdf, *order, column.local.rad().to_bits()), column)
                })
            })
            .collect();
        wanted.sort_by_key(|(key, _)| *key);
        wanted.dedup_by_key(|(key, _)| *key);
        let rows = wanted
            .par_iter()
            .map(|((brdf, order, _), column)| {
                transfer_row(material.brdfs[*brdf].as_ref(), column.local, *order)
            })
            .collect();
        Self {
            keys: wanted.into_iter().map(|(key, _)| key).collect(),
            rows,
            of_channel,
        }
    }

    /// The row of a column in channel `c`; `None` if the channel has no sample there.
    fn row(&self, c: usize, column: &Column) -> Option<&[Complex64]> {
        let (brdf, order) = *self.of_channel.get(c)?;
        let key = (brdf, order, column.local.rad().to_bits());
        let seen = column.variance.get(c)?.iter().any(|v| v.is_finite());
        let place = self.keys.binary_search(&key).ok().filter(|_| seen)?;
        self.rows.get(place).map(Vec::as_slice)
    }
}
