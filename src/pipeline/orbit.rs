//! Refines the orbit angles of a measured light field, where the description says that they are uncertain.

use serde::{Deserialize, Serialize};

use super::measure::Measured;
use super::recipe::{Recipe, Recover};
use crate::capture::Capture;
use crate::error::Result;
use crate::light_field::{Systematic, grid};
use crate::recover::lighting::model_order;
use crate::recover::orbit::{Form, Offsets, refine};

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

/// Moves the samples to the refined angles, and puts what stays uncertain into their σ. `None` if the capture's
/// angles are exact.
///
/// # Errors
/// If the recipe's BRDF cannot be read or the equations cannot be solved.
pub fn refine_orbit(
    measured: &mut Measured,
    recipe: &Recipe,
    capture: &Capture,
) -> Result<Option<OrbitRefinement>> {
    let stated = capture.camera.orbit_sigma_deg;
    if !(stated > 0.0) {
        return Ok(None);
    }
    let samples = &measured.samples;
    let (views, sigma) = (capture.views.len(), stated.to_radians());
    let found = match (&recipe.brdf, recipe.recover) {
        (Some(described), Recover::Lighting) => {
            let material = described.material(&samples.channels, &recipe.folder)?;
            let order: Vec<usize> = material
                .brdfs
                .iter()
                .map(|b| recipe.recovery.band.unwrap_or(model_order(b.as_ref())))
                .collect();
            let form = Form::Surface {
                material: &material,
                order: &order,
            };
            refine(samples, views, sigma, form)?
        }
        _ => refine(samples, views, sigma, Form::Smooth)?,
    };
    for column in &mut measured.samples.columns {
        for (alpha, &view) in column.alpha.iter_mut().zip(&column.view) {
            *alpha += found.offset.get(view as usize).copied().unwrap_or(0.0);
        }
    }
    for (c, slopes) in found.slopes.iter().enumerate() {
        for (column, slopes) in measured.samples.columns.iter_mut().zip(slopes) {
            for (i, slope) in slopes.iter().enumerate() {
                let own = found.sigma.get(column.view[i] as usize).copied();
                column.variance[c][i] += (slope * own.unwrap_or(sigma)).powi(2);
            }
        }
    }
    measured.systematics.push(Systematic {
        name: "mean of the orbit angles".into(),
        change: found
            .slopes
            .iter()
            .map(|columns| {
                columns
                    .iter()
                    .map(|slopes| slopes.iter().map(|s| s * found.sigma_mean).collect())
                    .collect()
            })
            .collect(),
    });
    measured.field = grid(&measured.samples, measured.field.grid, &measured.pixels);
    Ok(Some(OrbitRefinement::new(stated, &found)))
}
