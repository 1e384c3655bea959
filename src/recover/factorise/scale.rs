//! The factor that the light field cannot tell: L → cL, ρ → ρ/c. An outside fact sets it.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::spectral::Coefficients;
use crate::angle::{WorldAngle, wrap};
use crate::error::{Error, Result};
use crate::fourier::Series;

/// What is known of the absolute scale, one value per channel.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Scale {
    /// Nothing: L_0 = 1 W m⁻² rad⁻¹ in every channel (a total irradiance of 2π), by convention. Lighting is then white and
    /// the material carries all the colour.
    #[default]
    Unit,
    /// ∫ L dθ over the circle, W m⁻².
    TotalIrradiance(Vec<f64>),
    /// A source at `theta` of known irradiance, W m⁻².
    Source {
        /// Direction to the source.
        theta: WorldAngle,
        /// Irradiance on a surface that faces it.
        irradiance: Vec<f64>,
    },
    /// The in-plane albedo (π/4) ∫∫ ρ cos θi′ cos θo′ dθi′ dθo′, which is the albedo of a Lambertian surface.
    Albedo(Vec<f64>),
}

/// The factor c for a lighting found with L_0 = 1, and a sentence about it.
pub(super) fn factor(
    scale: &Scale,
    channel: usize,
    lighting: &Series,
    band: usize,
    coefficients: &Coefficients,
) -> Result<(f64, String)> {
    let given = |values: &[f64], name: &str| -> Result<f64> {
        match values.get(channel) {
            Some(v) if *v > 0.0 && v.is_finite() => Ok(*v),
            Some(v) => Err(Error::input(format!(
                "expected a {name} above 0 for channel {channel}, found {v}"
            ))),
            None => Err(Error::input(format!(
                "expected a {name} for each channel, found {} of them",
                values.len()
            ))
            .advice("Give one value per channel of the capture.")),
        }
    };
    let (c, note) = match scale {
        Scale::Unit => (
            1.0,
            "The scale is a convention, L_0 = 1 in every channel: only products of light and BRDF are absolute."
                .to_string(),
        ),
        Scale::TotalIrradiance(values) => {
            let total = given(values, "total irradiance")?;
            (
                total / TAU,
                format!("The scale is set by the given total irradiance of {total} W m⁻²."),
            )
        }
        Scale::Source { theta, irradiance } => {
            let irradiance = given(irradiance, "source irradiance")?;
            let found = source_irradiance(lighting, band, *theta);
            (
                irradiance / found,
                format!(
                    "The scale is set by the given source of {irradiance} W m⁻² at {:.2}°.",
                    theta.deg()
                ),
            )
        }
        Scale::Albedo(values) => {
            let albedo = given(values, "albedo")?;
            // ∫∫ ρ̃ = 4π² ρ̃_{0,0} and B̃_{0,0} = 2π L_0 ρ̃_{0,0} (eq. 15).
            let found = PI * PI / 2.0 * coefficients.get(0, 0).re;
            (
                found / albedo,
                format!("The scale is set by the given in-plane albedo of {albedo}."),
            )
        }
    };
    if c > 0.0 && c.is_finite() {
        Ok((c, note))
    } else {
        Err(Error::failed(format!(
            "the given scale needs a factor of {c}, which is not above 0"
        ))
        .advice(
            "Check the source's direction, or give another fact: an albedo or a total irradiance.",
        ))
    }
}

/// Irradiance of a source at `theta` in a lighting cut at `band`: the least-squares amplitude of the cut delta
/// function over three of its widths, beside a background that is a straight line there.
pub(super) fn source_irradiance(lighting: &Series, band: usize, theta: WorldAngle) -> f64 {
    const POINTS: usize = 121;
    let width = TAU / (2 * band + 1) as f64;
    let reach = (3.0 * width).min(PI);
    let cut = lighting.with_order(band);
    let (mut normal, mut target) = (Matrix3::zeros(), Vector3::zeros());
    for k in 0..POINTS {
        let x = reach * (2.0 * k as f64 / (POINTS - 1) as f64 - 1.0);
        let kernel = (0..=band)
            .map(|p| {
                if p == 0 {
                    1.0
                } else {
                    2.0 * (p as f64 * x).cos()
                }
            })
            .sum::<f64>()
            / TAU;
        let row = Vector3::new(kernel, 1.0, x);
        normal += row * row.transpose();
        target += row * cut.evaluate(wrap(theta.rad() + x));
    }
    normal
        .cholesky()
        .map_or(f64::NAN, |factor| factor.solve(&target)[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;

    #[test]
    fn a_source_on_a_sloping_sky_is_measured() {
        let theta = WorldAngle::degrees(40.0);
        let mut light = Series::zero(24);
        for (p, c) in light.coefficients.iter_mut().enumerate() {
            *c = 3.0 / TAU * Complex64::cis(-(p as f64) * theta.rad());
        }
        light.coefficients[0] += 0.3;
        light.coefficients[1] += Complex64::new(0.05, 0.02);
        let found = source_irradiance(&light, 24, theta);
        // The sky's curvature over ±22° leaves 0.1 · 0.07 against a peak of 3·49/2π: well below 1 %.
        assert!((found - 3.0).abs() < 0.01, "{found}");
    }
}
