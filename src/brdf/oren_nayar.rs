//! Oren and Nayar's rough diffuser.

use std::f64::consts::FRAC_1_PI;

use super::isotropic::slice;
use super::{Brdf, Isotropic, Pair};
use crate::angle::LocalAngle;

/// ρ = (albedo/π) (A + B max(0, cos φ) sin a tan b), sr⁻¹, with a the larger and b the smaller of |θi′| and |θo′|, φ the azimuth
/// between them (cos φ = 1 in the plane when both are on one side of the normal, else −1),
/// A = 1 − σ² / (2 (σ² + 0.33)), B = 0.45 σ² / (σ² + 0.09).
///
/// The qualitative model of M. Oren and S. Nayar, "Generalization of Lambert's reflectance model", SIGGRAPH 1994, eq. 30:
/// no interreflections. σ = 0 is Lambert's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrenNayar {
    /// Albedo of each facet.
    pub albedo: f64,
    /// σ: standard deviation of the facets' slope angle, radians.
    pub sigma: f64,
}

impl Isotropic for OrenNayar {
    fn rho(&self, pair: &Pair) -> f64 {
        let s2 = self.sigma * self.sigma;
        let a = 1.0 - 0.5 * s2 / (s2 + 0.33);
        let b = 0.45 * s2 / (s2 + 0.09);
        // sin of the larger angle times tan of the smaller: both sines over the larger cosine.
        let back = pair.cos_azimuth.max(0.0) * pair.sin_incident * pair.sin_exitant
            / pair.cos_incident.max(pair.cos_exitant);
        self.albedo * FRAC_1_PI * (a + b * back)
    }
}

impl Brdf for OrenNayar {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        slice(self, incident, exitant)
    }

    fn isotropic(&self) -> Option<&dyn Isotropic> {
        Some(self)
    }

    fn lobe_width(&self) -> f64 {
        1.0
    }

    /// The retro-reflecting side begins at the normal, and has an edge at θi′ = θo′ (and, in 1/cos, at −θo′).
    fn kinks(&self, exitant: LocalAngle) -> Vec<f64> {
        vec![0.0, exitant.rad(), -exitant.rad()]
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check_energy, check_reciprocity};
    use super::*;

    #[test]
    fn it_is_reciprocal_and_keeps_within_its_albedo() {
        for degrees in [0.0f64, 20.0, 45.0] {
            let model = OrenNayar {
                albedo: 0.9,
                sigma: degrees.to_radians(),
            };
            check_reciprocity(&model);
            // The qualitative fit overshoots the facets' albedo by a few per cent at grazing incidence.
            check_energy(&model, 0.9 * 1.06);
        }
    }

    #[test]
    fn it_sends_light_back_to_where_it_came_from() {
        let rough = OrenNayar {
            albedo: 0.9,
            sigma: 0.5,
        };
        let at = |i: f64, o: f64| rough.value(LocalAngle::degrees(i), LocalAngle::degrees(o));
        assert!(at(60.0, 60.0) > 1.3 * at(60.0, -60.0));
        // σ = ½: A = 1 − ½·0.25/0.58, B = 0.45·0.25/0.34, and sin 60° tan 60° = 3/2.
        let expected = 0.9 * FRAC_1_PI * (1.0 - 0.125 / 0.58 + 0.1125 / 0.34 * 1.5);
        assert!((at(60.0, 60.0) - expected).abs() < 1e-14);
    }
}
