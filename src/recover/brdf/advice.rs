//! Which further view or light would tell most of the slice.

use faer::Mat;

use super::basis::Basis;
use super::information::{Illumination, Information};
use super::prior::{Factor, Penalties, Relief, Smoothness};
use super::space::Space;
use super::{Options, Slice};
use crate::angle::WorldAngle;
use crate::light_field::Samples;
use crate::lighting::{Lighting, Source};
use crate::recover::advice::{Advice, Thinned, best};
use crate::{Error, Result};

/// Intervals of the splines: 7.5°, finer than the prior's correlation length.
const INTERVALS: usize = 24;
/// Values of the slice that are counted, along each angle, and how far they go, radians.
const PLACES: usize = 27;
const FARTHEST: f64 = 1.4;

/// Which further view, and which single source for the views once more, would tell most of the slice that was recovered from
/// `channel` of the samples of views from `orbits` (radians).
///
/// What is known of a value is 1 − σ²/σ_prior², by the samples and a prior of the slice's own size and of the correlation length
/// up to which smoothness may fill in ([`Options::longest`]).
///
/// # Errors
/// If the slice is 0 everywhere, the light has no such channel, or the normal equations cannot be factored.
pub fn advise(
    samples: &Samples,
    channel: usize,
    orbits: &[f64],
    lighting: &Lighting,
    light_channel: usize,
    slice: &Slice,
) -> Result<Advice> {
    let basis = Basis::new(INTERVALS);
    let space = Space::uniform(basis);
    let mean_square =
        slice.reciprocal.iter().map(|v| v * v).sum::<f64>() / slice.reciprocal.len().max(1) as f64;
    let irradiance = if light_channel < lighting.channels.len() {
        lighting.total_irradiance(light_channel)
    } else {
        0.0
    };
    if !(mean_square > 0.0 && irradiance > 0.0) {
        return Err(Error::input(
            "expected a slice and a light above 0 to advise on",
        ));
    }
    let angle = |k: usize| FARTHEST * (2.0 * k as f64 / (PLACES - 1) as f64 - 1.0);
    let places: Vec<_> = (0..PLACES)
        .flat_map(|i| (0..=i).map(move |j| (i, j)))
        .map(|(i, j)| space.value_at(angle(i), angle(j)))
        .collect();
    let variances = |covariance: &Mat<f64>| -> Vec<f64> {
        places
            .iter()
            .map(|f| super::posterior::variance(f, covariance))
            .collect()
    };
    let length = Options::default().longest.powi(6);
    let penalties = Penalties::new(&space, &Relief::flat(basis));
    let prior = |amplitude: f64| {
        let mut matrix = Mat::zeros(space.len(), space.len());
        let smoothness = Smoothness {
            amplitude,
            across: amplitude * length,
            along: amplitude * length,
        };
        penalties.add_dense(&smoothness, &mut matrix);
        matrix
    };
    let unit = variances(&Factor::new(&prior(1.0))?.inverse());
    let amplitude = unit.iter().sum::<f64>() / unit.len() as f64 / mean_square;
    let expected: Vec<f64> = unit.iter().map(|v| v / amplitude).collect();

    let thinned = Thinned::new(samples, channel, orbits, slice.noise);
    let light = Illumination::new(basis, lighting, light_channel);
    let information = |samples: &Samples, light: &Illumination| -> Option<Mat<f64>> {
        let equations = Information::new(samples, 0, &[], light, space.clone()).equations(1.0);
        equations.ok().map(|e| e.matrix)
    };
    let Some(have) = information(&thinned.samples, &light) else {
        return Err(Error::failed("the samples have no information matrix"));
    };
    let base = prior(amplitude) + have;
    let known = |more: &Mat<f64>| -> Option<f64> {
        let covariance = Factor::new(&(&base + more)).ok()?.inverse();
        let sum: f64 = variances(&covariance)
            .iter()
            .zip(&expected)
            .map(|(v, e)| 1.0 - v / e)
            .sum();
        Some(sum / expected.len() as f64)
    };
    let Some(now) = known(&Mat::zeros(space.len(), space.len())) else {
        return Err(Error::failed("the information matrix cannot be inverted"));
    };
    Ok(Advice {
        now,
        view: best(|orbit| known(&information(&thinned.view(orbit), &light)?)),
        source: best(|theta| {
            let lamp = Lighting::from_sources(
                thinned.samples.channels.clone(),
                vec![Source {
                    theta: WorldAngle::radians(theta),
                    irradiance: vec![irradiance],
                }],
            );
            let light = Illumination::new(basis, &lamp, 0);
            known(&information(&thinned.samples, &light)?)
        }),
    })
}
