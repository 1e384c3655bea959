//! The samples that an estimate of the lighting predicts.

use std::sync::Arc;

use num_complex::Complex64;
use rayon::prelude::*;

use super::LightingEstimate;
use super::sources::{Lit, Response};
use crate::brdf::{Brdf, Material, transfer_row};
use crate::fourier::{CircleTransform, Series};
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
            (0..estimate.channels.len())
                .into_par_iter()
                .map(|c| {
                    let smooth = &estimate.channels[c].smooth;
                    let columns = samples.columns.par_iter().enumerate();
                    columns
                        .map(|(j, column)| {
                            let mut predicted =
                                smooth_column(column, c, smooth, transfers.row(c, column));
                            for (response, e) in
                                sources[c].iter().zip(&estimate.channels[c].irradiance)
                            {
                                let both = predicted.iter_mut().zip(&response[j]);
                                for ((b, f), v) in both.zip(&column.variance[c]) {
                                    *b += if v.is_finite() { e * f } else { 0.0 };
                                }
                            }
                            predicted
                        })
                        .collect()
                })
                .collect()
        })
        .collect()
}

/// What the light's smooth part gives the samples of a column in channel `c`, by its response H_p; 0 for missing samples.
fn smooth_column(
    column: &Column,
    c: usize,
    smooth: &Series,
    transfer: Option<&[Complex64]>,
) -> Vec<f64> {
    let n = column.alpha.len();
    let Some(transfer) = transfer else {
        return vec![0.0; n];
    };
    let both = transfer.iter().zip(&smooth.coefficients);
    let reflected = Series {
        coefficients: both.map(|(h, l)| h * l).collect(),
    };
    let mut predicted = match column.regular() {
        Some(n) => CircleTransform::new(n, column.alpha[0]).synthesise(&reflected),
        None => column
            .alpha
            .iter()
            .zip(&column.variance[c])
            .map(|(&alpha, v)| {
                if v.is_finite() {
                    reflected.evaluate(alpha)
                } else {
                    0.0
                }
            })
            .collect(),
    };
    for (b, v) in predicted.iter_mut().zip(&column.variance[c]) {
        *b = if v.is_finite() { *b } else { 0.0 };
    }
    predicted
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
