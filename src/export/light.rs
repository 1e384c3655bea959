//! The light of a run, recovered or stated, for renderers.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::{Path, PathBuf};

use num_complex::Complex64;

use super::rgb;
use crate::angle::WorldAngle;
use crate::error::{Error, Result};
use crate::fourier::CircleTransform;
use crate::lighting::{Lighting, Source, environment::write_lat_long};
use crate::pipeline::{Recipe, Run};
use crate::recover::{Status, lighting::ChannelEstimate};

/// Directional lights that stand for the continuous light: one every 0.25°. With the midpoint rule that is
/// right to 1e-5 of the light, by the kink of the cosine at ±90°.
const EMITTERS: usize = 1440;

/// Share of the mean light, root mean square over the known frequencies, to which a light without negative values meets them.
const MET: f64 = 1e-4;
/// Steps after which the search for it ends: what is not met by then no such light meets, for noise.
const STEPS: usize = 3000;

/// The recovered light, or the one that the recipe states; `None` if there is neither. It is nowhere negative ([`non_negative`]).
pub(super) fn lighting(run: &Run) -> Option<Lighting> {
    if let Some(estimate) = &run.lighting {
        let mut light = Lighting {
            channels: run.channels.clone(),
            table: estimate.channels.iter().map(non_negative).collect(),
            ..Lighting::default()
        };
        light.sources = (0..estimate.sources.len())
            .map(|s| Source {
                theta: WorldAngle::degrees(estimate.sources[s].theta_deg),
                irradiance: estimate
                    .channels
                    .iter()
                    .map(|c| c.irradiance.get(s).copied().unwrap_or(0.0).max(0.0))
                    .collect(),
            })
            .collect();
        return Some(light);
    }
    let recipe = Recipe::parse(&run.recipe_toml, Path::new("recipe.toml"), Path::new("")).ok()?;
    recipe.lighting?.resolve(&run.channels, Path::new("")).ok()
}

/// The same where there must be one.
///
/// # Errors
/// If there is none.
pub(super) fn required(run: &Run) -> Result<Lighting> {
    lighting(run).ok_or_else(|| {
        Error::input("expected a run with a recovered or stated light, found none").advice(
            "A light that the recipe takes from a file is found only while that file is there.",
        )
    })
}

/// A directional light in the plane.
pub(super) struct Emitter {
    /// Direction that it comes from, radians.
    pub theta: f64,
    /// Irradiance on a surface facing it, W m⁻², red, green and blue.
    pub irradiance: [f64; 3],
}

/// Continuous light without negative values that has the recovered frequencies, at [`EMITTERS`] angles from −180°.
///
/// Light that is known up to a frequency swings below zero beside a sun. A renderer cannot show that, and where negative values are
/// merely cut off the sum is too bright by tens of percent. Frequencies beyond those that are known are free: they are chosen so that the light
/// is nowhere negative, which makes a sun narrower than the band. Found is the least squares solution of L_p(x) = L_p, x ≥ 0, from the
/// clipped series on, by the accelerated projected gradient of Beck and Teboulle (2009), FISTA; its operator is a projection, so a step is 1.
fn non_negative(channel: &ChannelEstimate) -> Vec<f64> {
    let transform = CircleTransform::new(EMITTERS, -PI);
    let wanted = &channel.smooth;
    let plain = transform.synthesise(wanted);
    let order = wanted.order().min(EMITTERS / 2 - 1);
    let known = |p: usize| {
        let coefficient = channel.spectrum.get(p);
        coefficient.is_none_or(|c| c.status != Status::Indeterminate)
    };
    let mut light: Vec<f64> = plain.iter().map(|v| v.max(0.0)).collect();
    if light == plain {
        return light;
    }
    let enough = MET * TAU.sqrt() * wanted.get(0).norm();
    let (mut ahead, mut momentum) = (light.clone(), 1.0_f64);
    for _ in 0..STEPS {
        let mut missing = transform.analyse(&ahead, order);
        for (p, value) in missing.coefficients.iter_mut().enumerate() {
            *value = if known(p) {
                wanted.get(p as i64) - *value
            } else {
                Complex64::ZERO
            };
        }
        if missing.norm() <= enough {
            break;
        }
        let next: Vec<f64> = transform
            .synthesise(&missing)
            .iter()
            .zip(&ahead)
            .map(|(step, v)| (v + step).max(0.0))
            .collect();
        let faster = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
        let push = (momentum - 1.0) / faster;
        for ((a, new), old) in ahead.iter_mut().zip(&next).zip(&light) {
            *a = new + push * (new - old);
        }
        (light, momentum) = (next, faster);
    }
    light
}

/// Sources, and the continuous light in steps; each with what it gives a surface facing it.
///
/// # Errors
/// If the channels are not R, G and B or a single one.
pub(super) fn emitters(light: &Lighting) -> Result<(Vec<Emitter>, Vec<Emitter>)> {
    let of = rgb(&light.channels)?;
    let sources = light
        .sources
        .iter()
        .map(|s| Emitter {
            theta: s.theta.rad(),
            irradiance: of.map(|c| s.in_channel(c)),
        })
        .collect();
    let step = TAU / EMITTERS as f64;
    let continuous = Lighting {
        sources: Vec::new(),
        ..light.clone()
    };
    let continuous = (0..EMITTERS)
        .map(|k| -PI + step * k as f64)
        .map(|theta| Emitter {
            theta,
            irradiance: of.map(|c| step * continuous.density(c, WorldAngle::radians(theta))),
        })
        .filter(|e| e.irradiance.iter().any(|v| *v != 0.0))
        .collect();
    Ok((sources, continuous))
}

/// Writes the whole light as a lat-long map for a world with +Z up whose maps have +X in the middle, as Blender's.
///
/// # Errors
/// If there is no light, or the file cannot be written.
pub(super) fn environment(run: &Run, file: &Path) -> Result<PathBuf> {
    let light = required(run)?;
    // The map that `write_lat_long` makes shows θ = 90° − 360°·u; Blender's shows θ = 180° − 360°·u.
    write_lat_long(file, &light.rotated(-FRAC_PI_2))?;
    Ok(file.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fourier::Series;
    use crate::recover::lighting::{Coefficient, RegularisationChoice};

    fn channel(light: &Lighting, order: usize, unknown: usize) -> ChannelEstimate {
        let smooth: Series = light.series(0, order);
        let spectrum = smooth.coefficients.iter().enumerate();
        ChannelEstimate {
            name: "Y".into(),
            table: Vec::new(),
            table_sigma: Vec::new(),
            irradiance: Vec::new(),
            spectrum: spectrum
                .map(|(p, value)| Coefficient {
                    value: *value,
                    sigma: 1e-4,
                    bound: 1e-4,
                    status: match p {
                        p if p == unknown => Status::Indeterminate,
                        _ => Status::Determined,
                    },
                })
                .collect(),
            determined_band: Some(order),
            residual_rms: 0.0,
            residual_relative: 0.0,
            chi2: 1.0,
            regularisation: RegularisationChoice {
                criterion: "none".into(),
                strength: 0.0,
                curve: Vec::new(),
            },
            smooth,
        }
    }

    #[test]
    fn a_sun_that_is_known_up_to_a_frequency_is_told_without_negative_light() {
        let sun = Source {
            theta: WorldAngle::degrees(37.3),
            irradiance: vec![3.0],
        };
        let mut light = Lighting::uniform(vec!["Y".into()], &[0.2]);
        light.sources.push(sun);
        let mut known = channel(&light, 20, 7);
        known.smooth.coefficients[7] = Complex64::ZERO;
        let plain = CircleTransform::new(EMITTERS, -PI).synthesise(&known.smooth);
        assert!(plain.iter().any(|v| *v < -0.5));
        let found = non_negative(&known);
        assert!(found.iter().all(|v| *v >= 0.0));
        let spectrum = CircleTransform::new(EMITTERS, -PI).analyse(&found, 20);
        let mean = light.series(0, 0).get(0).norm();
        for p in (0..=20).filter(|p| *p != 7) {
            let off = (spectrum.get(p) - known.smooth.get(p)).norm() / mean;
            assert!(off < 2e-4, "{p}: {off}");
        }
        // What was not known is found by the light not being negative: beside a fill of 0.2 a sun of 3 leaves little choice.
        let off = (spectrum.get(7) - light.series(0, 7).get(7)).norm() / mean;
        assert!(off < 0.2, "{off}");
    }

    #[test]
    fn light_that_is_nowhere_negative_is_left_as_it_is() {
        let mut series = Series::zero(3);
        series.coefficients[0] = Complex64::new(2.0, 0.0);
        series.coefficients[3] = Complex64::new(0.3, -0.5);
        let light = Lighting::band_limited(vec!["Y".into()], vec![series.clone()]);
        let found = non_negative(&channel(&light, 3, 99));
        let plain = CircleTransform::new(EMITTERS, -PI).synthesise(&series);
        assert_eq!(found, plain);
    }
}
