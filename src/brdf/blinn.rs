//! Lambert and a Blinn lobe: a power of the half angle's cosine.

use std::f64::consts::{FRAC_1_PI, PI};

use super::isotropic::slice;
use super::{Brdf, Isotropic, Pair};
use crate::angle::LocalAngle;

/// ρ = diffuse/π + specular · N · cosⁿ((θi′ + θo′)/2), N = (n+2)(n+4) / (8π (2^{−n/2} + n)), sr⁻¹.
///
/// J. Blinn, "Models of light reflection for computer synthesized pictures", SIGGRAPH 1977; N makes
/// `specular` the lobe's exact albedo at normal incidence (F. Giesen, "Phong and Blinn-Phong
/// normalization factors", 2009). For n ≫ 1 it is (n + 6)/8π, near the (n + 8)/8π often seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blinn {
    /// Albedo of the Lambertian part.
    pub diffuse: f64,
    /// Albedo of the lobe at normal incidence.
    pub specular: f64,
    /// n ≥ 0; a Phong lobe of a quarter of it has about the same width.
    pub exponent: f64,
}

impl Isotropic for Blinn {
    fn rho(&self, pair: &Pair) -> f64 {
        let n = self.exponent;
        let scale = (n + 2.0) * (n + 4.0) / (8.0 * PI * ((-0.5 * n).exp2() + n));
        self.diffuse * FRAC_1_PI + self.specular * scale * pair.cos_half.powf(n)
    }
}

impl Brdf for Blinn {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        slice(self, incident, exitant)
    }

    fn isotropic(&self) -> Option<&dyn Isotropic> {
        Some(self)
    }

    /// cosⁿ(x/2) ≈ exp(−n x²/8): two standard deviations.
    fn lobe_width(&self) -> f64 {
        4.0 / self.exponent.max(4.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::check_reciprocity;
    use super::*;
    use crate::brdf::directional_albedo;

    #[test]
    fn it_is_reciprocal_and_normalised_at_normal_incidence() {
        for exponent in [1.0, 12.0, 130.0, 4000.0] {
            let model = Blinn {
                diffuse: 0.2,
                specular: 0.5,
                exponent,
            };
            check_reciprocity(&model);
            assert!((directional_albedo(&model, 0.0) - 0.7).abs() < 1e-6);
        }
    }
}
