//! Lambert and Ward's isotropic lobe.

use std::f64::consts::{FRAC_1_PI, PI};

use super::isotropic::slice;
use super::{Brdf, Isotropic, Pair};
use crate::angle::LocalAngle;

/// ρ = diffuse/π + specular · exp(−tan² θh / α²) / (4π α² √(cos θi′ cos θo′)), sr⁻¹; θh half angle.
///
/// The isotropic form of G. Ward, "Measuring and modeling anisotropic reflection", SIGGRAPH 1992. `specular` is the
/// lobe's albedo near normal incidence for α below about 0.2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ward {
    /// Albedo of the Lambertian part.
    pub diffuse: f64,
    /// Weight of the lobe.
    pub specular: f64,
    /// Standard deviation of the surface's slope, times √2.
    pub alpha: f64,
}

impl Isotropic for Ward {
    fn rho(&self, pair: &Pair) -> f64 {
        let a2 = self.alpha * self.alpha;
        let root = (pair.cos_incident * pair.cos_exitant).sqrt();
        self.diffuse * FRAC_1_PI
            + self.specular * (-pair.tan2_half() / a2).exp() / (4.0 * PI * a2 * root)
    }
}

impl Brdf for Ward {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        slice(self, incident, exitant)
    }

    fn isotropic(&self) -> Option<&dyn Isotropic> {
        Some(self)
    }

    /// exp(−x²/4α²) in x = θi′ + θo′: two standard deviations.
    fn lobe_width(&self) -> f64 {
        2.0 * std::f64::consts::SQRT_2 * self.alpha
    }

    /// ρ̂ goes to zero as the root of cos θi′: panels shrink until what the last one misses, its width to the power
    /// of 3/2, is below 1e-9.
    fn grazing_width(&self) -> f64 {
        1e-6
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check_energy, check_reciprocity};
    use super::*;
    use crate::brdf::directional_albedo;

    #[test]
    fn it_is_reciprocal_and_keeps_within_the_energy_that_comes() {
        for alpha in [0.05, 0.15, 0.4] {
            let model = Ward {
                diffuse: 0.3,
                specular: 0.5,
                alpha,
            };
            check_reciprocity(&model);
            check_energy(&model, 0.8 + 1.5 * alpha * alpha);
        }
        let narrow = Ward {
            diffuse: 0.0,
            specular: 1.0,
            alpha: 0.02,
        };
        // With t = tan θh, ⟨t²⟩ = α²: dω_h, the Jacobian 4 cos θh and the root give 1 − (3/2 + 1/2 + 1) t² + O(t⁴).
        let expected = 1.0 - 3.0 * 0.02 * 0.02;
        assert!((directional_albedo(&narrow, 0.0) - expected).abs() < 1e-5);
    }
}
