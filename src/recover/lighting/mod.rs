//! Lighting from a known BRDF (`recover = "lighting"`).
//!
//! The light is a smooth part, Σ L_p e^{ipθ} with a Gaussian prior on its spectrum
//! ([`SpectralPrior`]), and, where the marginal likelihood asks for them, distant sources with an
//! exact response. Both are fitted together by weighted least squares on the samples
//! ([`crate::recover::normal`]); then L(θ) ≥ 0 is imposed ([`positivity`]).
//!
//! *What is determined* is judged without the prior that the data chose: against the weakest prior
//! that makes sense for light, a deviation of L_0 for every L_p (|L_p| ≤ L_0 for light that is not
//! negative). With σ the posterior deviation of L_p under it, L_p is `determined` if σ ≤
//! [`DETERMINED`]·L_0, `weak` if σ ≤ [`WEAK`]·L_0, else `indeterminate`.

mod estimate;
mod mixture;
pub mod positivity;
mod predict;
mod prior;
mod shone;
mod sources;
mod without_negative;

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use faer::Mat;
use num_complex::Complex64;
use rayon::prelude::*;

use crate::angle::wrap;
use crate::brdf::{Brdf, Material, transfer_row};
use crate::error::{Error, Result};
use crate::fourier::{CircleTransform, Series};
use crate::light_field::{Samples, Systematic};
use crate::recover::Status;
use crate::recover::normal::{NormalSystem, position, to_series};

pub use estimate::{
    ChannelEstimate, Coefficient, LightingEstimate, RegularisationChoice, SourceEstimate,
};
use mixture::{Channel, ChannelParts, Mixture};
pub use predict::{predict, predict_all};
use prior::Posterior;
pub use prior::SpectralPrior;
use sources::Lit;

/// σ(L_p)/L_0 up to which a coefficient is determined.
pub const DETERMINED: f64 = 0.05;
/// σ(L_p)/L_0 up to which a coefficient is weakly determined.
pub const WEAK: f64 = 0.5;
/// Smallest response |H_p| that is trusted, relative to |H_0|: no BRDF is known better, and below it the
/// model's errors pass for light.
const RESPONSE_FLOOR: f64 = 2e-4;
/// Irradiance, relative to the brightest, below which a peak is not tried as a source.
const FAINTEST: f64 = 5e-3;
/// Times that the noise is measured again once sources have been found.
const NOISE_ROUNDS: usize = 2;
/// Values of L(θ) in the products: every 0.5° from −180°.
pub const TABLE: usize = 720;
/// Largest frequency of the model unless the recipe names one. A lobe of width w (2σ if it were a
/// Gaussian) has passed 1e-6 of the light's amplitude at p ≈ 10/w; slower tails come from edges of
/// the half circle, and errors of the surface's model drown them.
pub fn model_order(brdf: &dyn Brdf) -> usize {
    (8.0 / brdf.lobe_width().max(1e-3)).clamp(40.0, 180.0) as usize
}

/// What the user can choose.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The light is taken as band-limited to this frequency; `None`: as far as the data say anything.
    pub band: Option<usize>,
    /// How the strength of the prior is chosen.
    pub regularisation: Regularisation,
    /// Impose L(θ) ≥ 0, and look for sources.
    pub non_negative: bool,
}

/// How the strength of the prior is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Regularisation {
    /// By marginal likelihood, its shape too.
    Evidence,
    /// By generalised cross-validation, of a flat prior.
    Gcv,
    /// No prior; the model ends at the last frequency that the data determine.
    Truncate,
    /// No prior.
    None,
    /// A flat prior of deviation L_0/√strength.
    Fixed(f64),
}

/// Recovers the lighting from samples of a light field on a surface of known BRDF.
///
/// # Errors
/// If the material does not have the samples' channels, if there is no sample, if all samples are
/// zero, or if the surface reflects nothing towards any sample.
pub fn recover(
    samples: &Samples,
    material: &Material,
    options: &Options,
) -> Result<LightingEstimate> {
    recover_with(samples, &[], material, options)
}

/// The same with systematic errors that all samples share: they are fitted along, each with a normal prior of one
/// standard deviation, so that the light's σ holds what they leave open.
///
/// # Errors
/// As [`recover`].
pub fn recover_with(
    samples: &Samples,
    systematics: &[Systematic],
    material: &Material,
    options: &Options,
) -> Result<LightingEstimate> {
    // The matrices are small, and results must not depend on the number of threads.
    faer::set_global_parallelism(faer::Par::Seq);
    if material.brdfs.len() != samples.channels.len() {
        return Err(Error::input(format!(
            "expected a BRDF for each of the channels {}, found {}",
            samples.channels.join(", "),
            material.channels.join(", ")
        )));
    }
    // Channels often share a BRDF; what follows from it alone is computed once.
    let twins: Vec<usize> = (0..material.brdfs.len())
        .map(|c| {
            let same = |other: &usize| Arc::ptr_eq(&material.brdfs[*other], &material.brdfs[c]);
            (0..c).find(same).unwrap_or(c)
        })
        .collect();
    let transfers: Vec<Vec<Vec<Complex64>>> = material
        .brdfs
        .iter()
        .enumerate()
        .map(|(c, brdf)| {
            if twins[c] != c {
                return Vec::new();
            }
            let order = options.band.unwrap_or_else(|| model_order(brdf.as_ref()));
            samples
                .columns
                .par_iter()
                .map(|column| transfer_row(brdf.as_ref(), column.local, order))
                .collect()
        })
        .collect();
    let mut channels: Vec<Channel<'_>> = (0..samples.channels.len())
        .into_par_iter()
        .map(|c| {
            let (system, mean_light) = prepare(samples, c, &transfers[twins[c]], options)?;
            Channel::new(ChannelParts {
                name: samples.channels[c].clone(),
                samples,
                index: c,
                twin: twins[c],
                brdf: material.brdfs[c].as_ref(),
                system,
                systematics: systematics.iter().map(|s| s.change[c].clone()).collect(),
                mean_light,
            })
        })
        .collect::<Result<_>>()?;
    let mirror = material.brdfs.iter().any(|b| {
        samples
            .columns
            .iter()
            .any(|column| b.mirror(column.local) != 0.0)
    });
    // A source is not band-limited, and a mirror's response to one is a delta that samples miss.
    let look_for_sources = options.non_negative && options.band.is_none() && !mirror;
    let weak_posteriors = |channels: &[Channel<'_>]| -> Result<Vec<Posterior>> {
        channels.par_iter().map(Channel::weak_posterior).collect()
    };
    let mut weak = weak_posteriors(&channels)?;
    let lit = Lit::new(samples);
    let (candidates, smooth) = rayon::join(
        || match look_for_sources {
            true => brightest_peaks(&channels, &weak),
            false => Ok(Vec::new()),
        },
        || Mixture::smooth(&lit, &channels, options.regularisation),
    );
    let candidates = candidates?;
    let mut mixture = smooth?.extended(&lit, &channels, options.regularisation, &candidates)?;
    // What sources explain is no noise: with less noise, fainter sources show and errors are smaller.
    for _ in 0..NOISE_ROUNDS {
        if mixture.directions().is_empty() || !mixture.measure_noise(&mut channels) {
            break;
        }
        weak = weak_posteriors(&channels)?;
        mixture = mixture.refit(&lit, &channels, options.regularisation, &candidates)?;
    }

    let estimates = (0..channels.len())
        .into_par_iter()
        .map(|c| finish(samples, &channels[c], &weak[c], &mixture, c, options))
        .collect::<Result<_>>()?;
    Ok(LightingEstimate {
        channels: estimates,
        sources: mixture.source_estimates(),
    })
}

/// The normal equations of one channel, up to the frequency beyond which the data say nothing, and roughly L_0;
/// `transfer` is H_p(θo′) for each column, \[column\]\[p\].
fn prepare(
    samples: &Samples,
    channel: usize,
    transfer: &[Vec<Complex64>],
    options: &Options,
) -> Result<(NormalSystem, f64)> {
    let name = &samples.channels[channel];
    if samples.count(channel) == 0 {
        return Err(Error::input(format!("channel {name} has no usable sample"))
            .advice("Every pixel is clipped, masked or beyond the limb cut."));
    }
    let (mean_light, informative) = first_look(samples, channel, transfer);
    if !(mean_light > 0.0 && mean_light.is_finite()) {
        return Err(Error::input(format!(
            "channel {name}: the mean light comes out as {mean_light:.3e}, expected a positive number"
        ))
        .advice("Check that the photos show the object, that the black level is right, and that the BRDF reflects light in this channel."));
    }
    let order = options.band.unwrap_or(informative);
    let rows = transfer
        .iter()
        .map(|row| row.iter().take(order + 1).copied().collect())
        .collect();
    let system = NormalSystem::with_transfer(samples, channel, rows, order);
    Ok((system, mean_light))
}

/// L_0 as if the light were uniform, and the largest p that could show above the noise and above
/// [`RESPONSE_FLOOR`] if L_p were as large as it can be, L_0.
fn first_look(samples: &Samples, channel: usize, transfer: &[Vec<Complex64>]) -> (f64, usize) {
    let order = transfer.first().map_or(0, |row| row.len() - 1);
    let (mut signal, mut information) = (0.0, vec![0.0; order + 1]);
    for (column, h) in samples.columns.iter().zip(transfer) {
        let mut weight = 0.0;
        for (v, b) in column.variance[channel].iter().zip(&column.value[channel]) {
            if v.is_finite() && *v > 0.0 {
                weight += 1.0 / v;
                signal += h[0].re * b / v;
            }
        }
        for (sum, h) in information.iter_mut().zip(h) {
            *sum += weight * h.norm_sqr();
        }
    }
    let mean_light = signal / information[0];
    // 0.01: a tenth of a standard deviation.
    let shows = |p: usize| information[p] * mean_light.powi(2) > 0.01;
    let trusted = |p: usize| information[p] > RESPONSE_FLOOR.powi(2) * information[0];
    let informative = (0..=order)
        .rev()
        .find(|&p| shows(p) && trusted(p))
        .unwrap_or(0);
    (mean_light, informative)
}

/// Directions that may hold sources, brightest first: the peaks of the light under the weakest prior
/// with L(θ) ≥ 0, which sharpens a source far beyond the band; by their irradiance over all channels in units
/// of the mean light. A peak wider than one and a half periods of the finest frequency that the data know is no
/// source.
fn brightest_peaks(channels: &[Channel<'_>], weak: &[Posterior]) -> Result<Vec<f64>> {
    let lights: Vec<Vec<f64>> = channels
        .par_iter()
        .zip(weak)
        .map(|(channel, weak)| {
            let mut x = constrained(weak, channel.system.order, 0)?;
            x.truncate(channel.system.vector.len());
            let light = CircleTransform::new(TABLE, -PI).synthesise(&to_series(&x));
            Ok(light.iter().map(|l| l / channel.mean_light).collect())
        })
        .collect::<Result<_>>()?;
    let finest = channels
        .iter()
        .zip(weak)
        .map(|(channel, weak)| {
            let covariance = weak.covariance();
            let known = |p: &usize| {
                covariance[(position(*p), position(*p))].sqrt() <= DETERMINED * channel.mean_light
            };
            (0..=channel.system.order).rev().find(known).unwrap_or(0)
        })
        .max()
        .unwrap_or(0);
    let sum: Vec<f64> = (0..TABLE)
        .map(|k| lights.iter().map(|l| l[k]).sum())
        .collect();
    let at = |k: isize| sum[k.rem_euclid(TABLE as isize) as usize];
    let mut peaks = Vec::new();
    for k in 0..TABLE as isize {
        // A peak of light that is nowhere twice its mean is no source.
        if !(at(k) > at(k - 1) && at(k) >= at(k + 1) && at(k) > 2.0 * channels.len() as f64) {
            continue;
        }
        // Down to the valleys on both sides.
        let (mut low, mut high) = (k, k);
        while k - low < TABLE as isize / 2 && at(low - 1) < at(low) {
            low -= 1;
        }
        while high - k < TABLE as isize / 2 && at(high + 1) < at(high) {
            high += 1;
        }
        let floor = at(low).max(at(high));
        let half = 0.5 * (at(k) + floor);
        let width = (low..=high).filter(|&i| at(i) > half).count() as f64 * TAU / TABLE as f64;
        if width > 1.5 * TAU / finest.max(1) as f64 {
            continue;
        }
        let (mut total, mut moment) = (0.0, 0.0);
        for i in low..=high {
            let above = (at(i) - floor).max(0.0);
            total += above;
            moment += above * (i - k) as f64;
        }
        let theta = -PI + TAU * (k as f64 + moment / total) / TABLE as f64;
        peaks.push((total, wrap(theta)));
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let brightest = peaks.first().map_or(0.0, |peak| peak.0);
    peaks.retain(|peak| peak.0 > FAINTEST * brightest);
    Ok(peaks.into_iter().map(|(_, theta)| theta).collect())
}

/// From the fit to what is reported.
fn finish(
    samples: &Samples,
    channel: &Channel<'_>,
    weak: &Posterior,
    mixture: &Mixture,
    index: usize,
    options: &Options,
) -> Result<ChannelEstimate> {
    let fit = &mixture.fits[index];
    let covariance = fit.posterior.covariance();
    let weak = weak.covariance();
    let order = channel.system.order;
    let n = 2 * order + 1;
    let mut unknowns = fit.posterior.mean.clone();
    let mut shown = unknowns.clone();
    if options.non_negative {
        shown = constrained(&fit.posterior, order, mixture.directions().len())?;
        // A series that ends at P and is nowhere negative cannot be as sharp as light can. Where the data
        // see that, the coefficients stay theirs and only the table is kept above zero: 4 per unknown is far
        // beyond what noise gives, 1 per active constraint at the most.
        if fit.posterior.squared_distance(&shown) <= 4.0 * unknowns.len() as f64 {
            unknowns.clone_from(&shown);
        }
    }
    let smooth = to_series(&unknowns[..n]);
    let (irradiance, systematics) = unknowns[n..].split_at(mixture.directions().len());

    let circle = CircleTransform::new(TABLE, -PI);
    let mut table = circle.synthesise(&to_series(&shown[..n]));
    if options.non_negative {
        // What is left below zero lies between the angles at which the constraint was imposed.
        for value in &mut table {
            *value = value.max(0.0);
        }
    }
    let mut table_variance: Vec<f64> = circle
        .synthesise(&variance_series(&covariance, order))
        .into_iter()
        .map(|v| v.max(0.0))
        .collect();
    let step = TAU / TABLE as f64;
    for (s, (&theta, &e)) in mixture.directions().iter().zip(irradiance).enumerate() {
        let variance = covariance[(n + s, n + s)];
        // The two nearest values share the source so that its irradiance and its direction are kept.
        let at = (theta + PI).rem_euclid(TAU) / step;
        let (k, t) = (at.floor() as usize, at.fract());
        for (k, share) in [(k % TABLE, 1.0 - t), ((k + 1) % TABLE, t)] {
            table[k] += share * e / step;
            table_variance[k] += variance * (share / step).powi(2);
        }
    }

    let spectrum: Vec<Coefficient> = (0..=order)
        .map(|p| coefficient(channel, &weak, mixture, &covariance, &smooth, irradiance, p))
        .collect();
    let determined_band = spectrum
        .iter()
        .take_while(|c| c.status == Status::Determined)
        .count()
        .checked_sub(1);
    let predicted = fit.predict(channel, &smooth, irradiance, systematics);
    let (mut sum, mut chi2, mut largest, mut count) = (0.0, 0.0, 0.0f64, 0usize);
    for (column, predicted) in samples.columns.iter().zip(&predicted) {
        let measured = column.value[channel.index]
            .iter()
            .zip(&column.variance[channel.index]);
        for ((b, v), f) in measured.zip(predicted) {
            if v.is_finite() && *v > 0.0 {
                sum += (b - f).powi(2);
                chi2 += (b - f).powi(2) / v;
                largest = largest.max(b.abs());
                count += 1;
            }
        }
    }
    let residual_rms = (sum / count.max(1) as f64).sqrt();
    Ok(ChannelEstimate {
        name: channel.name.clone(),
        table,
        table_sigma: table_variance.iter().map(|v| v.sqrt()).collect(),
        smooth,
        irradiance: irradiance.to_vec(),
        spectrum,
        determined_band,
        residual_rms,
        residual_relative: residual_rms / largest,
        chi2: chi2 / count.max(1) as f64,
        regularisation: fit.choice.clone(),
    })
}

/// L_p of smooth part and sources together.
fn coefficient(
    channel: &Channel<'_>,
    weak: &Mat<f64>,
    mixture: &Mixture,
    covariance: &Mat<f64>,
    smooth: &Series,
    irradiance: &[f64],
    p: usize,
) -> Coefficient {
    let n = 2 * channel.system.order + 1;
    let parts = if p == 0 { 1 } else { 2 };
    let mut value = smooth.coefficients[p];
    for (&theta, &e) in mixture.directions().iter().zip(irradiance) {
        value += e / TAU * Complex64::cis(-(p as f64) * theta);
    }
    let mut variance = 0.0;
    for part in 0..parts {
        // The real or the imaginary part as a combination of the unknowns.
        let mut combination = vec![(position(p) + part, 1.0)];
        for (s, &theta) in mixture.directions().iter().enumerate() {
            let phase = Complex64::cis(-(p as f64) * theta) / TAU;
            combination.push((n + s, if part == 0 { phase.re } else { phase.im }));
        }
        for &(i, a) in &combination {
            for &(j, b) in &combination {
                variance += a * b * covariance[(i, j)];
            }
        }
    }
    for (&sigma, &e) in mixture.direction_sigmas.iter().zip(irradiance) {
        variance += (p as f64 * e / TAU * sigma).powi(2);
    }
    let prior_precision = SpectralPrior::flat(channel.mean_light).precision(position(p));
    let weak_variance = (0..parts)
        .map(|k| weak[(position(p) + k, position(p) + k)])
        .sum::<f64>()
        / parts as f64;
    let information = 1.0 / weak_variance - prior_precision;
    let weak_sigma = weak_variance.sqrt() / channel.mean_light;
    Coefficient {
        value,
        sigma: (variance / parts as f64).max(0.0).sqrt(),
        // Below a hundredth of the prior's information the difference is rounding.
        bound: if information > 0.01 * prior_precision {
            information.recip().sqrt()
        } else {
            f64::INFINITY
        },
        status: if weak_sigma <= DETERMINED {
            Status::Determined
        } else if weak_sigma <= WEAK {
            Status::Weak
        } else {
            Status::Indeterminate
        },
    }
}

/// The variance of L(θ) = Σ L_p e^{ipθ} as a series of order 2P, from the covariance of the unknowns.
///
/// Var L(θ) = Σ_{p,q} Cov(L_p, L_q*) e^{i(p−q)θ} over all signs of p and q, with L_{−p} = L_p*.
fn variance_series(covariance: &Mat<f64>, order: usize) -> Series {
    let mut series = Series::zero(2 * order);
    let v = &mut series.coefficients;
    v[0] += covariance[(0, 0)];
    for p in 1..=order {
        let (re, im) = (position(p), position(p) + 1);
        v[p] += 2.0 * Complex64::new(covariance[(re, 0)], covariance[(im, 0)]);
        for q in 1..=p {
            let (re_q, im_q) = (position(q), position(q) + 1);
            let (rr, ii) = (covariance[(re, re_q)], covariance[(im, im_q)]);
            let (ir, ri) = (covariance[(im, re_q)], covariance[(re, im_q)]);
            // (p, q) and (q, p), or once if they are the same.
            let times = if p == q { 1.0 } else { 2.0 };
            v[p - q] += 2.0 * Complex64::new(rr + ii, ir - ri);
            v[p + q] += times * Complex64::new(rr - ii, ir + ri);
        }
    }
    series
}

/// Rows: angles −π + 2πk/m; columns: the unknowns; the product is L(θ).
fn synthesis_matrix(order: usize, m: usize) -> Mat<f64> {
    Mat::from_fn(m, 2 * order + 1, |k, i| {
        let theta = -PI + TAU * k as f64 / m as f64;
        let p = i.div_ceil(2) as f64;
        match i {
            0 => 1.0,
            _ if i % 2 == 1 => 2.0 * (p * theta).cos(),
            _ => -2.0 * (p * theta).sin(),
        }
    })
}

/// The posterior mean under L(θ) ≥ 0 at 4P angles and non-negative irradiances.
fn constrained(posterior: &Posterior, order: usize, sources: usize) -> Result<Vec<f64>> {
    let n = 2 * order + 1;
    let angles = (4 * order).max(8);
    let synthesis = synthesis_matrix(order, angles);
    let constraints = Mat::from_fn(angles + sources, posterior.mean.len(), |k, i| {
        if k < angles && i < n {
            synthesis[(k, i)]
        } else {
            f64::from(u8::from(k >= angles && i >= n && k - angles == i - n))
        }
    });
    positivity::constrain(&posterior.mean, &posterior.covariance(), &constraints)
}

#[cfg(test)]
mod tests;
