//! Lambert and Torrance and Sparrow's rough dielectric: Beckmann facets, V-shaped grooves.

use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, PI, SQRT_2};

use super::isotropic::slice;
use super::{Brdf, Isotropic, Pair, dielectric_reflectance};
use crate::angle::LocalAngle;

/// ρ = diffuse/π + F(θd) D(θh) G / (4 cos θi′ cos θo′), sr⁻¹; θh half angle, θd difference angle.
///
/// D = exp(−tan² θh / m²) / (π m² cos⁴ θh) (Beckmann), G = min(1, 2 cos θh cos θo′ / cos θd, 2 cos θh cos θi′ / cos θd)
/// (grooves), F of a dielectric. K. Torrance and E. Sparrow, "Theory for off-specular reflection from roughened surfaces",
/// JOSA 57 (1967); with the normalisation and D of R. Cook and K. Torrance, "A reflectance model for computer graphics",
/// ACM TOG 1 (1982), with their 1/π corrected to 1/4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorranceSparrow {
    /// Albedo of the Lambertian part.
    pub diffuse: f64,
    /// m: root-mean-square slope of the facets, times √2.
    pub roughness: f64,
    /// Index of refraction, ≥ 1.
    pub ior: f64,
}

impl Isotropic for TorranceSparrow {
    fn rho(&self, pair: &Pair) -> f64 {
        let m2 = self.roughness * self.roughness;
        let c2 = pair.cos_half * pair.cos_half;
        let facets = (-pair.sin2_half / (c2 * m2)).exp() / (PI * m2 * c2 * c2);
        let (low, high) = if pair.cos_incident < pair.cos_exitant {
            (pair.cos_incident, pair.cos_exitant)
        } else {
            (pair.cos_exitant, pair.cos_incident)
        };
        // G / (4 cos θi cos θo), finite when one of the cosines vanishes.
        let grooves = (0.25 / low).min(0.5 * pair.cos_half / pair.cos_difference) / high;
        self.diffuse * FRAC_1_PI
            + dielectric_reflectance(pair.cos_difference, self.ior) * facets * grooves
    }
}

impl Brdf for TorranceSparrow {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        slice(self, incident, exitant)
    }

    fn isotropic(&self) -> Option<&dyn Isotropic> {
        Some(self)
    }

    /// exp(−x²/4m²) in x = θi′ + θo′: two standard deviations.
    fn lobe_width(&self) -> f64 {
        2.0 * SQRT_2 * self.roughness
    }

    /// Where G's branches meet: 2 cos θh cos θo′ = cos θd is cos((θi′ + 3θo′)/2) = 0, its counterpart
    /// cos((3θi′ + θo′)/2) = 0, and the two masks are equal at θi′ = θo′.
    fn kinks(&self, exitant: LocalAngle) -> Vec<f64> {
        let o = exitant.rad();
        let mut kinks = vec![o];
        for side in [-PI, PI] {
            kinks.push(side - 3.0 * o);
            kinks.push((side - o) / 3.0);
        }
        kinks.retain(|k| k.abs() < FRAC_PI_2);
        kinks
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check_energy, check_reciprocity};
    use super::*;

    fn plastic(roughness: f64) -> TorranceSparrow {
        TorranceSparrow {
            diffuse: 0.0,
            roughness,
            ior: 1.5,
        }
    }

    #[test]
    fn it_is_reciprocal_and_keeps_within_the_energy_that_comes() {
        for roughness in [0.05, 0.2, 0.5] {
            check_reciprocity(&plastic(roughness));
            check_energy(&plastic(roughness), 1.0);
        }
    }

    #[test]
    fn a_smooth_one_reflects_as_fresnel_says() {
        use crate::brdf::directional_albedo;
        for angle in [0.0, 0.4, 0.8] {
            let found = directional_albedo(&plastic(0.01), angle);
            let expected = dielectric_reflectance(angle.cos(), 1.5);
            // F averaged over facets tilted by m: m² F″/2, and F″ is of the order of F up to 50°.
            assert!(
                (found / expected - 1.0).abs() < 5e-4,
                "{angle}: {found} {expected}"
            );
        }
    }

    #[test]
    fn the_kinks_are_where_the_masking_changes() {
        let model = plastic(0.3);
        for degrees in [-80.0, -40.0, 10.0, 65.0] {
            let exitant = LocalAngle::degrees(degrees);
            let kinks = model.kinks(exitant);
            let masked = |a: f64| {
                let p = Pair::in_plane(LocalAngle::radians(a), exitant).expect("above the horizon");
                let factor = 2.0 * p.cos_half / p.cos_difference;
                let branches = [1.0, factor * p.cos_exitant, factor * p.cos_incident];
                (0..3).min_by(|x, y| branches[*x].total_cmp(&branches[*y]))
            };
            for k in 0..1790 {
                let (a, b) = (
                    -1.5620 + 0.001745 * f64::from(k),
                    -1.5620 + 0.001745 * f64::from(k + 1),
                );
                if masked(a) != masked(b) {
                    assert!(
                        kinks.iter().any(|x| (a..=b).contains(x)),
                        "{degrees}: {a} {kinks:?}"
                    );
                }
            }
        }
    }
}
