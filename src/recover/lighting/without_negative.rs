//! The recovered light as renderers take it: nowhere negative.

use std::f64::consts::{PI, TAU};

use num_complex::Complex64;
use rayon::prelude::*;

use super::{ChannelEstimate, LightingEstimate};
use crate::angle::WorldAngle;
use crate::fourier::CircleTransform;
use crate::lighting::{Lighting, Source};
use crate::recover::Status;

/// Angles at which it is tabulated, every 0.25°.
const ANGLES: usize = 1440;
/// Share of the mean of all light, sources too, root sum of squares over the known frequencies, to which a light without negative values meets them.
const MET: f64 = 1e-4;
/// Steps after which the search for it ends: what is not met by then no such light meets, for noise.
const STEPS: usize = 3000;

impl LightingEstimate {
    /// The estimate as a light to be used again: its sources, and a table of the smooth part every 0.25° that is nowhere negative and has
    /// the frequencies that are known.
    #[must_use]
    pub fn without_negative(&self) -> Lighting {
        let irradiance = |s: usize| {
            let of = self.channels.iter();
            of.map(|c| c.irradiance.get(s).copied().unwrap_or(0.0).max(0.0))
                .collect()
        };
        Lighting {
            channels: self.channels.iter().map(|c| c.name.clone()).collect(),
            sources: self
                .sources
                .iter()
                .enumerate()
                .map(|(s, source)| Source {
                    theta: WorldAngle::degrees(source.theta_deg),
                    irradiance: irradiance(s),
                })
                .collect(),
            table: self.channels.par_iter().map(non_negative).collect(),
            ..Lighting::default()
        }
    }
}

/// Continuous light without negative values that has the recovered frequencies, at [`ANGLES`] angles from −180°.
///
/// Light that is known up to a frequency swings below zero beside a sun. A renderer cannot show that, and where negative values are
/// merely cut off the sum is too bright by tens of percent. Frequencies beyond those that are known are free: they are chosen so that the light
/// is nowhere negative, which makes a sun narrower than the band. Found is the least squares solution of L_p(x) = L_p, x ≥ 0, from the
/// clipped series on, by the accelerated projected gradient of Beck and Teboulle (2009), FISTA; its operator is a projection, so a step is 1.
fn non_negative(channel: &ChannelEstimate) -> Vec<f64> {
    let transform = CircleTransform::new(ANGLES, -PI);
    let wanted = &channel.smooth;
    let plain = transform.synthesise(wanted);
    let order = wanted.order().min(ANGLES / 2 - 1);
    let known = |p: usize| {
        let coefficient = channel.spectrum.get(p);
        coefficient.is_none_or(|c| c.status != Status::Indeterminate)
    };
    let mut light: Vec<f64> = plain.iter().map(|v| v.max(0.0)).collect();
    if light == plain {
        return light;
    }
    let mean = channel.spectrum.first().map_or(0.0, |c| c.value.norm());
    let enough = MET * TAU.sqrt() * mean;
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
        let plain = CircleTransform::new(ANGLES, -PI).synthesise(&known.smooth);
        assert!(plain.iter().any(|v| *v < -0.5));
        let found = non_negative(&known);
        assert!(found.iter().all(|v| *v >= 0.0));
        let spectrum = CircleTransform::new(ANGLES, -PI).analyse(&found, 20);
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
        let plain = CircleTransform::new(ANGLES, -PI).synthesise(&series);
        assert_eq!(found, plain);
    }
}
