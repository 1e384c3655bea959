//! Velvet: two forms of light scattered by fibres that stand off the surface.

use std::f64::consts::{FRAC_1_PI, TAU};

use super::isotropic::slice;
use super::{Brdf, Isotropic, Pair};
use crate::angle::LocalAngle;

/// ρ = diffuse/π + sheen · D(θh) / (4 (cos θi′ + cos θo′ − cos θi′ cos θo′)), D = (2 + 1/r) sin^{1/r} θh / 2π, sr⁻¹.
///
/// `model = "sheen"` with `roughness`. D ("Charlie"): A. Estevez and C. Kulla, "Production friendly microfacet sheen BRDF",
/// SIGGRAPH course 2017; the masking is that of D. Neubelt and M. Pettineo, "Crafting a next-gen material pipeline for
/// The Order: 1886", SIGGRAPH course 2013.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheen {
    /// Albedo of the Lambertian part.
    pub diffuse: f64,
    /// Weight of the fibres.
    pub sheen: f64,
    /// r in 0–1: how much the fibres stray from standing upright.
    pub roughness: f64,
}

impl Isotropic for Sheen {
    fn rho(&self, pair: &Pair) -> f64 {
        let power = 1.0 / self.roughness;
        let fibres = (2.0 + power) * pair.sin2_half.powf(0.5 * power) / TAU;
        let (i, o) = (pair.cos_incident, pair.cos_exitant);
        self.diffuse * FRAC_1_PI + self.sheen * fibres / (4.0 * (i + o - i * o))
    }
}

impl Brdf for Sheen {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        slice(self, incident, exitant)
    }

    fn isotropic(&self) -> Option<&dyn Isotropic> {
        Some(self)
    }

    /// sin^{1/r} has the width √r about its maximum; and its branch point at θh = 0 is finer than that unless
    /// 1/r is an even number.
    fn lobe_width(&self) -> f64 {
        0.02
    }

    /// The masking's denominator vanishes at cos θi′ = −cos θo′ / (1 − cos θo′): beyond the horizon, but near it.
    fn grazing_width(&self) -> f64 {
        0.02
    }

    /// The mirror direction, where sin^{1/r} |θh| has its branch point.
    fn kinks(&self, exitant: LocalAngle) -> Vec<f64> {
        vec![-exitant.rad()]
    }
}

/// ρ = diffuse/π + sheen (n + 2)/(2π) · |sin θi′ sin θo′|ⁿ, sr⁻¹.
///
/// `model = "sheen"` with `exponent`. The reciprocal form of the empirical horizon term sinⁿ θ that describes the bright
/// rims of velvet (R. Lu, J. Koenderink and A. Kappers, "Optical properties (bidirectional reflectance distribution functions)
/// of velvet", Applied Optics 37 (1998)); the factor makes the term's directional albedo `sheen` · sinⁿ θi′.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HorizonSheen {
    /// Albedo of the Lambertian part.
    pub diffuse: f64,
    /// Albedo of the horizon term at grazing incidence.
    pub sheen: f64,
    /// n > 0: the larger, the thinner the bright rim.
    pub exponent: f64,
}

impl Isotropic for HorizonSheen {
    fn rho(&self, pair: &Pair) -> f64 {
        let n = self.exponent;
        let rim = (pair.sin_incident * pair.sin_exitant).powf(n);
        self.diffuse * FRAC_1_PI + self.sheen * (n + 2.0) / TAU * rim
    }
}

impl Brdf for HorizonSheen {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        slice(self, incident, exitant)
    }

    fn isotropic(&self) -> Option<&dyn Isotropic> {
        Some(self)
    }

    fn lobe_width(&self) -> f64 {
        1.0
    }

    /// sinⁿ θ ≈ exp(−n x²/2) at the distance x from the horizon: two standard deviations.
    fn grazing_width(&self) -> f64 {
        2.0 / self.exponent.max(4.0).sqrt()
    }

    /// The normal, where |sin θi′|ⁿ has its branch point.
    fn kinks(&self, _exitant: LocalAngle) -> Vec<f64> {
        vec![0.0]
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check_energy, check_reciprocity};
    use super::*;
    use crate::brdf::directional_albedo;

    #[test]
    fn both_are_reciprocal_and_keep_within_the_energy_that_comes() {
        for roughness in [0.2, 0.5, 1.0] {
            let model = Sheen {
                diffuse: 0.0,
                sheen: 1.0,
                roughness,
            };
            check_reciprocity(&model);
            check_energy(&model, 1.0);
        }
        for exponent in [1.0, 4.0, 12.5] {
            let model = HorizonSheen {
                diffuse: 0.2,
                sheen: 0.7,
                exponent,
            };
            check_reciprocity(&model);
            check_energy(&model, 0.9);
            let expected = 0.2 + 0.7 * 1.2f64.sin().powf(exponent);
            // The product rule on |sin θ|ⁿ, n ≥ 1.
            assert!((directional_albedo(&model, 1.2) - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn the_rim_is_brighter_than_the_middle() {
        let velvet = Sheen {
            diffuse: 0.0,
            sheen: 1.0,
            roughness: 0.3,
        };
        let light = LocalAngle::degrees(60.0);
        let at = |d: f64| velvet.value(light, LocalAngle::degrees(d));
        assert!(at(80.0) > 10.0 * at(0.0) && at(-60.0) < 1e-9);
    }
}
