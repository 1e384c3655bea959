//! The slice of a recovery of both: a BRDF under what is known of the light that was found with it.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use num_complex::Complex64;
use rayon::prelude::*;

use crate::error::Result;
use crate::fourier::Series;
use crate::light_field::{Column, Samples, Systematic};
use crate::lighting::{Lighting, Source};
use crate::recover::Status;
use crate::recover::brdf::{self, BrdfEstimate, LightError};
use crate::recover::factorise::{self, Channel, Factorisation, OpenError};

/// A slice, and what it was recovered from.
pub struct Slice {
    /// The slice.
    pub estimate: BrdfEstimate,
    /// What is known of the light.
    pub light: Lighting,
    /// The samples as that light alone gives them.
    pub part: Samples,
}

/// Recovers the slice under the light that was found in `samples` with the errors `systematics` that all of them
/// share, and takes back what the slice does not bear out ([`retract_unseen`]). Samples of photographs come with the radius of the object in
/// them, and have an error of their own ([`with_model_error`]); computed ones have none.
///
/// # Errors
/// As [`brdf::recover_under`].
pub fn slice(
    found: &mut Factorisation,
    samples: &Samples,
    systematics: &[Systematic],
    radius_px: Option<f64>,
    options: &brdf::Options,
) -> Result<Slice> {
    let light = known_light(found);
    let (part, widened) = known_part(found, &corrected(found, samples, systematics));
    let widened = match radius_px {
        Some(radius_px) => with_model_error(&widened, radius_px),
        None => widened,
    };
    let errors = light_errors(found, samples, systematics);
    let estimate = brdf::recover_under(&widened, &light, &errors, options)?;
    retract_unseen(found, &estimate);
    Ok(Slice {
        estimate,
        light,
        part,
    })
}

/// Error that samples have in common with their neighbours, relative to the channel's largest value. Pixels are fitted along the
/// view's line over a column's width, which smooths the kinks where a sun grazes. In photos without noise that is 2e-5 to 5e-5 (rms) of
/// the largest value, three times as much near the limb.
const MODEL_ERROR: f64 = 1e-4;

/// The samples with the variance of that error added: the factorisation takes their errors as independent.
///
/// Where a pixel of an object `radius_px` large covers more than a column, what the fit within it misses grows as the square of
/// its footprint.
pub fn with_model_error(samples: &Samples, radius_px: f64) -> Samples {
    let mut widened = samples.clone();
    let width = samples.column_width();
    for c in 0..samples.channels.len() {
        let present = samples.columns.iter().flat_map(|column| {
            let both = column.value[c].iter().zip(&column.variance[c]);
            both.filter(|(_, v)| v.is_finite()).map(|(b, _)| b.abs())
        });
        let largest = present.fold(0.0, f64::max);
        for column in &mut widened.columns {
            let footprint = 1.0 / (radius_px * column.local.rad().cos());
            let growth = 1.0 + (footprint / width).powi(2);
            let added = (MODEL_ERROR * growth * largest).powi(2);
            for v in &mut column.variance[c] {
                *v += added;
            }
        }
    }
    widened
}

/// The light that was found: its frequencies up to the band, and beyond it what the sources in it go on with.
pub fn light(found: &Factorisation) -> Lighting {
    light_of(found, |channel, p| {
        channel.status[p] != Status::Indeterminate
    })
}

/// The same with the known frequencies alone up to the band: the light under which the slice is recovered.
fn known_light(found: &Factorisation) -> Lighting {
    light_of(found, is_known)
}

/// |L_p|/σ from which a weakly determined frequency is better taken for what it was found to be than for none: a surface shows most of a sharp light by frequencies
/// that are known to 10 %, and their errors are followed into the slice's σ. Noise alone is that large once in 50.
const KNOWN: f64 = 2.0;

fn is_known(channel: &Channel, p: usize) -> bool {
    match channel.status[p] {
        Status::Determined => true,
        Status::Weak => channel.lighting.get(p as i64).norm() >= KNOWN * channel.sigma[p],
        Status::Indeterminate => false,
    }
}

/// Sources have all frequencies: what they bring within the band is taken from the smooth part, which holds the rest of L_p of the
/// frequencies that are `kept`. Of the others nothing is left where there are no sources; where there are, they go on there as they do beyond
/// the band.
fn light_of(found: &Factorisation, kept: impl Fn(&Channel, usize) -> bool) -> Lighting {
    let count = found.channels.len();
    let sources: Vec<Source> = found
        .channels
        .iter()
        .enumerate()
        .flat_map(|(c, channel)| {
            channel.sources.iter().map(move |&(theta, irradiance)| {
                let mut by_channel = vec![0.0; count];
                by_channel[c] = irradiance;
                Source {
                    theta,
                    irradiance: by_channel,
                }
            })
        })
        .collect();
    let smooth = found.channels.iter().enumerate().map(|(c, channel)| {
        let sharp = Lighting {
            channels: Vec::new(),
            sources: sources.clone(),
            ..Lighting::default()
        }
        .series(c, channel.band);
        let rest = sharp.coefficients.iter().enumerate().map(|(p, s)| {
            if kept(channel, p) {
                channel.lighting.get(p as i64) - s
            } else {
                Complex64::ZERO
            }
        });
        Series {
            coefficients: rest.collect(),
        }
    });
    Lighting {
        channels: found.channels.iter().map(|c| c.name.clone()).collect(),
        smooth: smooth.collect(),
        sources,
        ..Lighting::default()
    }
}

/// The samples without what the frequencies of the light that are not known did to them, as far as they show and where no sources stand for them: what is left is explained by the known light alone, at the same information per frequency.
///
/// Returned twice: with the samples' variances, and with what the light's own uncertainty by the noise adds to them,
/// Σ_p 2 |σ(L_p) B_p / L_p|² (B_p is proportional to L_p, eq. 11), so that columns in which the light's error shows most say least. How it reaches the slice's
/// σ, as one error of all samples, [`light_errors`] say. Where sources stand for L_p their error is what they miss of the determined frequencies.
fn known_part(found: &Factorisation, samples: &Samples) -> (Samples, Samples) {
    let mut part = samples.clone();
    let mut widened = samples.clone();
    let sources_miss: Vec<f64> = found.channels.iter().map(sources_miss).collect();
    for (c, channel) in found.channels.iter().enumerate() {
        let modelled = !channel.sources.is_empty();
        let known = |p: usize| p <= channel.band && is_known(channel, p);
        let spectra = factorise::spectra(samples, c);
        let columns = part.columns.par_iter_mut().zip(&mut widened.columns);
        columns.zip(spectra).for_each(|((column, wide), series)| {
            let Some(mut open) = series else {
                return;
            };
            let added: f64 = (1..=channel.band)
                .map(|p| {
                    let light = channel.lighting.get(p as i64).norm();
                    let share = match known(p) {
                        true => own_sigma(channel, p) / light.max(f64::MIN_POSITIVE),
                        false if modelled => sources_miss[c],
                        false => 0.0,
                    };
                    2.0 * (open.get(p as i64).norm() * share.min(1.0)).powi(2)
                })
                .sum();
            let shown = channel.band.max(channel.visible_band);
            for (p, b) in open.coefficients.iter_mut().enumerate() {
                if modelled || known(p) || p > shown {
                    *b = Complex64::ZERO;
                }
            }
            for i in 0..column.alpha.len() {
                if column.variance[c][i].is_finite() {
                    column.value[c][i] -= open.evaluate(column.alpha[i]);
                    wide.value[c][i] = column.value[c][i];
                    wide.variance[c][i] += added;
                }
            }
        });
    }
    (part, widened)
}

/// Root of the share of the power in the upper half of the determined frequencies that the channel's sources do not explain.
fn sources_miss(channel: &Channel) -> f64 {
    let (mut missed, mut power) = (0.0, f64::MIN_POSITIVE);
    for p in (channel.band / 2..=channel.band).filter(|&p| channel.status[p] == Status::Determined)
    {
        let sharp: Complex64 = channel
            .sources
            .iter()
            .map(|(theta, irradiance)| irradiance / TAU * Complex64::cis(-(p as f64) * theta.rad()))
            .sum();
        let l = channel.lighting.get(p as i64);
        missed += (l - sharp).norm_sqr();
        power += l.norm_sqr();
    }
    (missed / power).sqrt()
}

/// σ of L_p by the noise alone, without the errors that all samples share.
fn own_sigma(channel: &Channel, p: usize) -> f64 {
    let open = &channel.systematics.open;
    let shared: f64 = open.iter().map(|e| e.light.get(p as i64).norm_sqr()).sum();
    (channel.sigma[p].powi(2) - shared).max(0.0).sqrt()
}

/// How well the known frequencies of each channel's light are known, and beside it the errors that all samples share.
fn light_errors(
    found: &Factorisation,
    samples: &Samples,
    systematics: &[Systematic],
) -> Vec<LightError> {
    let channels = found.channels.iter().enumerate();
    channels
        .map(|(c, channel)| LightError {
            changes: open_changes(found, c, samples, systematics),
            ..light_error(channel)
        })
        .collect()
}

fn light_error(channel: &Channel) -> LightError {
    let frequencies: Vec<usize> = (1..=channel.band)
        .filter(|&p| is_known(channel, p))
        .collect();
    let fitted: Vec<usize> = channel.frequencies.iter().copied().skip(1).collect();
    let part = |series: &Series, p: usize, k: usize| {
        let l = series.get(p as i64);
        if k == 0 { l.re } else { l.im }
    };
    let size = 2 * frequencies.len();
    let mut covariance = Vec::with_capacity(size * size);
    for i in 0..size {
        for j in 0..size {
            let (p, q) = (frequencies[i / 2], frequencies[j / 2]);
            let place = |p: usize| fitted.iter().position(|&f| f == p);
            covariance.push(match (place(p), place(q)) {
                (Some(a), Some(b)) => {
                    let index = (2 * a + i % 2) * 2 * fitted.len() + 2 * b + j % 2;
                    let open = channel.systematics.open.iter();
                    let shared: f64 = open
                        .map(|e| part(&e.light, p, i % 2) * part(&e.light, q, j % 2))
                        .sum();
                    channel.covariance.get(index).copied().unwrap_or(0.0) - shared
                }
                // Regressed one by one.
                (None, None) if i == j => 0.5 * channel.sigma[p].powi(2),
                _ => 0.0,
            });
        }
    }
    LightError {
        frequencies,
        covariance,
        changes: Vec::new(),
    }
}

/// The samples without the errors that all of them share, as far as the factorisation found them.
fn corrected(found: &Factorisation, samples: &Samples, systematics: &[Systematic]) -> Samples {
    let mut samples = samples.clone();
    for (c, channel) in found.channels.iter().enumerate() {
        for (j, column) in samples.columns.iter_mut().enumerate() {
            let change = combined(systematics, &channel.systematics.found, c, j, column);
            for (value, change) in column.value[c].iter_mut().zip(change) {
                *value -= change;
            }
        }
    }
    samples
}

/// What is still open of those errors in channel `c`: by how much they change the samples together with the error of the light that goes with them,
/// \[error\]\[column\]\[sample\]. An error that the light makes up for changes nothing.
fn open_changes(
    found: &Factorisation,
    c: usize,
    samples: &Samples,
    systematics: &[Systematic],
) -> Vec<Vec<Vec<f64>>> {
    let Some(channel) = found.channels.get(c).filter(|_| !systematics.is_empty()) else {
        return Vec::new();
    };
    let responses = responses(found, channel, samples);
    let of_column = |j: usize, open: &OpenError| -> Vec<f64> {
        let column = &samples.columns[j];
        let along = Series {
            coefficients: responses[j]
                .iter()
                .zip(&open.light.coefficients)
                .map(|(h, l)| h * l)
                .collect(),
        };
        combined(systematics, &open.errors, c, j, column)
            .into_iter()
            .zip(&column.alpha)
            .map(|(change, alpha)| change + along.evaluate(*alpha))
            .collect()
    };
    let columns = 0..samples.columns.len();
    let open = channel.systematics.open.iter();
    open.map(|open| columns.clone().map(|j| of_column(j, open)).collect())
        .collect()
}

/// Σ of `amounts` of the errors at the samples of column `j`.
fn combined(
    systematics: &[Systematic],
    amounts: &[f64],
    channel: usize,
    j: usize,
    column: &Column,
) -> Vec<f64> {
    let mut sum = vec![0.0; column.alpha.len()];
    for (error, amount) in systematics.iter().zip(amounts) {
        let change = error.change.get(channel).and_then(|c| c.get(j));
        for (sum, change) in sum.iter_mut().zip(change.into_iter().flatten()) {
            *sum += amount * change;
        }
    }
    sum
}

/// H_p(θo′) = ∫ ρ̂(θi′, θo′) e^{ipθi′} dθi′ of the factorisation's own slice at each column of the samples; 0 for frequencies that are
/// not known.
fn responses(found: &Factorisation, channel: &Channel, samples: &Samples) -> Vec<Vec<Complex64>> {
    let nodes = found.nodes.len();
    let step = PI / nodes.max(1) as f64;
    let place = |column: &Column| {
        let k = (column.local.rad() + FRAC_PI_2) / step - 0.5;
        (k.round().max(0.0) as usize).min(nodes.saturating_sub(1))
    };
    samples
        .columns
        .par_iter()
        .map(|column| {
            let k = place(column);
            let mut out = vec![Complex64::ZERO; channel.band + 1];
            for (i, node) in found.nodes.iter().enumerate() {
                let rho = channel.brdf.get(i * nodes + k).copied().unwrap_or(0.0);
                let turn = Complex64::cis(node.rad());
                let mut term = Complex64::from(rho * node.visible_cosine() * step);
                for (p, h) in out.iter_mut().enumerate() {
                    if is_known(channel, p) {
                        *h += term;
                    }
                    term *= turn;
                }
            }
            out
        })
        .collect()
}

/// How many σ a coefficient of the slice must have to show that the surface passes its frequency.
const SHOWS: f64 = 5.0;

/// Takes back what was said of frequencies that do not show in the light field and that the slice does not show to
/// pass either: they may be dark or invisible, and nothing tells which.
///
/// The factorisation calls them dark where its own ρ̃ passes them; but what that ρ̃ is there rests on no data, and only
/// the slice, fitted with its σ, says so.
fn retract_unseen(found: &mut Factorisation, slice: &BrdfEstimate) {
    for (channel, slice) in found.channels.iter_mut().zip(&slice.slices) {
        let passes = |p: usize| {
            slice.spectrum.iter().any(|c| {
                [c.p, c.q].map(|f| f.unsigned_abs() as usize).contains(&p)
                    && c.value.norm() > SHOWS * c.sigma
            })
        };
        let mean = channel.lighting.get(0).re;
        for p in 1..=channel.band {
            if !channel.frequencies.contains(&p)
                && channel.status[p] != Status::Indeterminate
                && !passes(p)
            {
                channel.status[p] = Status::Indeterminate;
                channel.lighting.coefficients[p] = Complex64::ZERO;
                channel.sigma[p] = mean;
            }
        }
    }
}
