//! Refines the orbit angles of a measured light field, where the description says that they are uncertain.

use serde::{Deserialize, Serialize};

use super::measure::Measured;
use super::orbit_errors;
use super::recipe::{Recipe, Recover};
use crate::angle::WorldAngle;
use crate::brdf::Material;
use crate::capture::Capture;
use crate::error::Result;
use crate::light_field::grid;
use crate::recover::lighting::{LightingEstimate, model_order};
use crate::recover::orbit::{Form, Offsets, Stated, refine};

/// Least frequency up to which light is modelled: a sun's shadow begins with a kink, of which 1/order is missed.
const LEAST_ORDER: usize = 120;

/// By how much the orbit angles were changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrbitRefinement {
    /// Standard deviation of the angles as described, degrees.
    pub prior_sigma_deg: f64,
    /// Root mean square of the changes, degrees.
    pub rms_deg: f64,
    /// The largest change, degrees.
    pub largest_deg: f64,
    /// Standard deviation of the mean of all angles, degrees: turned together with the light they show the same.
    pub mean_sigma_deg: f64,
    /// Added to each view's orbit angle, degrees.
    pub offset_deg: Vec<f64>,
    /// Standard deviation of each view's angle from the mean that is left, degrees.
    pub sigma_deg: Vec<f64>,
}

impl OrbitRefinement {
    fn new(prior_sigma_deg: f64, found: &Offsets) -> Self {
        let offset_deg: Vec<f64> = found.offset.iter().map(|d| d.to_degrees()).collect();
        let squares: f64 = offset_deg.iter().map(|d| d * d).sum();
        Self {
            prior_sigma_deg,
            rms_deg: (squares / offset_deg.len().max(1) as f64).sqrt(),
            largest_deg: offset_deg.iter().fold(0.0, |m, d| m.max(d.abs())),
            mean_sigma_deg: found.sigma_mean.to_degrees(),
            sigma_deg: found.sigma.iter().map(|s| s.to_degrees()).collect(),
            offset_deg,
        }
    }

    /// What was found, in words.
    pub fn finding(&self) -> String {
        let left = self.sigma_deg.iter().map(|s| s * s).sum::<f64>();
        format!(
            "The orbit angles, known to {:.2}°, were refined with the light field: by {:.3}° rms, at most {:.3}°. What is left is {:.4}° (rms σ), and {:.3}° of all together, which is the same as turning the light.",
            self.prior_sigma_deg,
            self.rms_deg,
            self.largest_deg,
            (left / self.sigma_deg.len().max(1) as f64).sqrt(),
            self.mean_sigma_deg,
        )
    }
}

/// Change of a normal (radians) from which the object's place is settled anew: a thousandth of a degree.
const UNSETTLED: f64 = 1.7e-5;

/// Moves the samples to the refined angles, and puts what stays uncertain into their σ. `None` if the capture's
/// angles are exact, or the light is known. `measure` measures the photos anew with other angles: of an object beside the
/// orbit's centre the angles say where it stands in each view.
///
/// # Errors
/// If the recipe's BRDF cannot be read, the equations cannot be solved, or `measure` fails.
pub fn refine_orbit(
    measured: &mut Measured,
    recipe: &Recipe,
    capture: &Capture,
    measure: &dyn Fn(&Capture) -> Result<Measured>,
) -> Result<Option<OrbitRefinement>> {
    let stated = capture.camera.orbit_sigma_deg;
    if !(stated > 0.0) {
        return Ok(None);
    }
    let (views, sigma) = (capture.views.len(), stated.to_radians());
    if recipe.recover == Recover::Brdf {
        // Under known light the errors are fitted along with the BRDF, as the geometry's other ones.
        let errors = orbit_errors::errors(&measured.samples, views, sigma);
        measured.systematics.extend(errors);
        return Ok(None);
    }
    let known = Known::of(recipe, &measured.samples.channels)?;
    let mut found = known.refine(measured, sigma, &vec![0.0; views])?;
    let mut turned = vec![0.0; views];
    let turns = found.offset.iter().fold(0.0f64, |m, d| m.max(d.abs()));
    let [x, y] = measured.displacement;
    if turns * x.hypot(y) > UNSETTLED * capture.object.radius {
        turned.clone_from(&found.offset);
        let mut anew = capture.clone();
        for (view, turn) in anew.views.iter_mut().zip(&turned) {
            view.orbit = WorldAngle::radians(view.orbit.rad() + turn);
        }
        *measured = measure(&anew)?;
        found = known.refine(measured, sigma, &turned)?;
    }
    for column in &mut measured.samples.columns {
        for (alpha, &view) in column.alpha.iter_mut().zip(&column.view) {
            *alpha += found.offset.get(view as usize).copied().unwrap_or(0.0);
        }
    }
    for (offset, turned) in found.offset.iter_mut().zip(&turned) {
        *offset += turned;
    }
    // Light that is sought turns with all angles together, see `turn`; where none is, that is an error like the others.
    let gauge = match recipe.recover {
        Recover::Lighting | Recover::Both => 0.0,
        _ => found.sigma_mean,
    };
    for (c, slopes) in found.slopes.iter().enumerate() {
        for (column, slopes) in measured.samples.columns.iter_mut().zip(slopes) {
            for (i, slope) in slopes.iter().enumerate() {
                let own = found.sigma.get(column.view[i] as usize).copied();
                let sigma = own.unwrap_or(sigma).hypot(gauge);
                column.variance[c][i] += (slope * sigma).powi(2);
            }
        }
    }
    measured.field = grid(&measured.samples, measured.field.grid, &measured.pixels);
    Ok(Some(OrbitRefinement::new(stated, &found)))
}

/// What the recipe says of the light field's form.
struct Known {
    /// The BRDF and the light's largest frequency, \[channel\].
    surface: Option<(Material, Vec<usize>)>,
}

impl Known {
    fn of(recipe: &Recipe, channels: &[String]) -> Result<Self> {
        let (Some(described), Recover::Lighting) = (&recipe.brdf, recipe.recover) else {
            return Ok(Self { surface: None });
        };
        let material = described.material(channels, &recipe.folder)?;
        let band = recipe.recovery.band;
        let orders = material.brdfs.iter();
        let order = orders
            .map(|b| band.unwrap_or(model_order(b.as_ref()).max(LEAST_ORDER)))
            .collect();
        Ok(Self {
            surface: Some((material, order)),
        })
    }

    fn refine(&self, measured: &Measured, sigma: f64, turned: &[f64]) -> Result<Offsets> {
        let stated = Stated {
            views: turned.len(),
            sigma,
            turned,
            systematics: &measured.systematics,
        };
        let form = match &self.surface {
            Some((material, order)) => Form::Surface { material, order },
            None => Form::Smooth,
        };
        refine(&measured.samples, stated, form)
    }
}

/// Adds to a recovered light's σ that all of it may be turned by `sigma` (radians), as the orbit angles together.
pub fn turn(lighting: &mut LightingEstimate, sigma: f64) {
    for channel in &mut lighting.channels {
        for (p, l) in channel.spectrum.iter_mut().enumerate() {
            // Across L_p; re and im share it.
            let across = p as f64 * l.value.norm() * sigma;
            l.sigma = l.sigma.hypot(across * std::f64::consts::FRAC_1_SQRT_2);
        }
        let n = channel.table.len();
        let step = std::f64::consts::TAU / n.max(1) as f64;
        for (i, s) in channel.table_sigma.iter_mut().enumerate() {
            let (before, after) = (channel.table[(i + n - 1) % n], channel.table[(i + 1) % n]);
            *s = s.hypot((after - before) / (2.0 * step) * sigma);
        }
    }
    for source in &mut lighting.sources {
        source.theta_sigma_deg = source.theta_sigma_deg.hypot(sigma.to_degrees());
    }
}

#[cfg(test)]
mod tests {
    use num_complex::Complex64;

    use super::*;
    use crate::fourier::Series;
    use crate::recover::Status;
    use crate::recover::lighting::{ChannelEstimate, Coefficient, RegularisationChoice};

    #[test]
    fn light_that_may_be_turned_is_uncertain_across_its_slope() {
        // L = 1 + cos 3θ: L_3 = 1/2, dL/dθ = −3 sin 3θ.
        let mut coefficients = vec![Complex64::ZERO; 4];
        coefficients[0] = Complex64::ONE;
        coefficients[3] = Complex64::new(0.5, 0.0);
        let series = Series { coefficients };
        let theta = |i: usize| (0.5 * i as f64 - 180.0).to_radians();
        let mut estimate = LightingEstimate {
            channels: vec![ChannelEstimate {
                name: "Y".into(),
                table: (0..720).map(|i| series.evaluate(theta(i))).collect(),
                table_sigma: vec![0.0; 720],
                smooth: series.clone(),
                irradiance: Vec::new(),
                spectrum: series
                    .coefficients
                    .iter()
                    .map(|&value| Coefficient {
                        value,
                        sigma: 0.0,
                        bound: 0.0,
                        status: Status::Determined,
                    })
                    .collect(),
                determined_band: Some(3),
                residual_rms: 0.0,
                residual_relative: 0.0,
                chi2: 1.0,
                regularisation: RegularisationChoice {
                    criterion: "none".into(),
                    strength: 0.0,
                    curve: Vec::new(),
                },
            }],
            sources: Vec::new(),
        };
        turn(&mut estimate, 0.01);
        let channel = &estimate.channels[0];
        for (i, s) in channel.table_sigma.iter().enumerate() {
            // The central difference is short by (3 h)²/6 = 1.1e-4 of it, h = 0.5°.
            let expected = (3.0 * (3.0 * theta(i)).sin() * 0.01).abs();
            assert!((s - expected).abs() < 2e-4 * 0.03, "{i}: {s} {expected}");
        }
        // Turned by 0.01, L_3 moves by 3 · 0.5 · 0.01, all of it in one component: 0.015² = re² + im².
        let sigma = channel.spectrum[3].sigma;
        assert!((2.0 * sigma * sigma - 0.015 * 0.015).abs() < 1e-12);
        assert_eq!(channel.spectrum[0].sigma, 0.0);
    }
}
