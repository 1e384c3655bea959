//! Lambert's ideal diffuser (J. H. Lambert, *Photometria*, 1760).

use std::f64::consts::{FRAC_1_PI, PI};

use super::isotropic::slice;
use super::{Brdf, Isotropic, Pair};
use crate::angle::LocalAngle;

/// ρ = albedo/π, sr⁻¹.
///
/// The paper's flatland normalisation is ρ = ½ for albedo 1 (eqs. 20–22): the same curve, π/2 times as high.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lambertian {
    /// Share of the incident light that is reflected, 0–1.
    pub albedo: f64,
}

impl Isotropic for Lambertian {
    fn rho(&self, _pair: &Pair) -> f64 {
        self.albedo * FRAC_1_PI
    }
}

impl Brdf for Lambertian {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        slice(self, incident, exitant)
    }

    fn isotropic(&self) -> Option<&dyn Isotropic> {
        Some(self)
    }

    fn lobe_width(&self) -> f64 {
        PI
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::check_reciprocity;
    use super::*;
    use crate::brdf::directional_albedo;

    #[test]
    fn it_reflects_its_albedo_from_every_direction() {
        let model = Lambertian { albedo: 0.7 };
        check_reciprocity(&model);
        for angle in [0.0, 0.5, 1.5] {
            // ∫ cos θ dω = π, by a Gauss rule that is exact for it to rounding.
            assert!((directional_albedo(&model, angle) - 0.7).abs() < 1e-12);
        }
    }
}
