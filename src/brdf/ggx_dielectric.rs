//! Rough plastic: a GGX dielectric coat over a Lambertian base.

use std::f64::consts::FRAC_1_PI;

use super::ggx::{distribution, visibility};
use super::isotropic::slice;
use super::{Brdf, Isotropic, Pair, dielectric_reflectance};
use crate::angle::LocalAngle;

/// ρ = F(θd) D(θh) G₁(θi′) G₁(θo′) / (4 cos θi′ cos θo′) + (diffuse/π) T(θi′) T(θo′) / T̄, sr⁻¹.
///
/// The coat: D and G₁ of GGX as in [`super::GgxConductor`], F of a dielectric. The base: light that gets through the
/// interface on its way in and out, T = 1 − F with the interface taken as smooth, scaled by its mean
/// T̄ = 2 ∫ T cos θ d(cos θ). So the base reflects `diffuse` · T(θi′) and the whole keeps the energy for diffuse ≤ 1.
/// The form is that of P. Shirley et al., "A practitioners' assessment of light reflection models", Pacific
/// Graphics 1997, and for α → 0 of Mitsuba 3's `plastic` with `nonlinear = false`; T̄ = ior² (1 − internal mean F).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GgxDielectric {
    /// Albedo of the base, as the share of what gets into it.
    pub diffuse: f64,
    /// Roughness α > 0 of the coat.
    pub alpha: f64,
    /// Index of refraction, ≥ 1.
    pub ior: f64,
}

/// T̄ = 1 − 2 ∫ F(c) c dc, in closed form.
///
/// W. Egan and T. Hilgeman, *Optical Properties of Inhomogeneous Materials*, 1979 (after R. Saunderson 1942 and
/// S. Duntley 1942), for ior > 1.
fn mean_transmittance(ior: f64) -> f64 {
    let n = ior;
    if n < 1.0 + 1e-4 {
        // The closed form cancels here; F̄ itself is below 1e-4.
        return 1.0;
    }
    let n2 = n * n;
    let n4 = n2 * n2;
    let (plus, minus) = (n2 + 1.0, n2 - 1.0);
    let mean = 0.5
        + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) * (n + 1.0))
        + n2 * minus * minus / (plus * plus * plus) * ((n - 1.0) / (n + 1.0)).ln()
        - 2.0 * n2 * n * (n2 + 2.0 * n - 1.0) / (plus * (n4 - 1.0))
        + 8.0 * n4 * (n4 + 1.0) / (plus * (n4 - 1.0) * (n4 - 1.0)) * n.ln();
    1.0 - mean
}

impl Isotropic for GgxDielectric {
    fn rho(&self, pair: &Pair) -> f64 {
        let coat = dielectric_reflectance(pair.cos_difference, self.ior)
            * distribution(pair, self.alpha)
            * visibility(pair, self.alpha);
        if self.diffuse == 0.0 {
            return coat;
        }
        let through = (1.0 - dielectric_reflectance(pair.cos_incident, self.ior))
            * (1.0 - dielectric_reflectance(pair.cos_exitant, self.ior));
        coat + self.diffuse * FRAC_1_PI * through / mean_transmittance(self.ior)
    }
}

impl Brdf for GgxDielectric {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        slice(self, incident, exitant)
    }

    fn isotropic(&self) -> Option<&dyn Isotropic> {
        Some(self)
    }

    /// D has its poles at tan θh = ±iα, which is 2α from the axis in θi′.
    fn lobe_width(&self) -> f64 {
        2.0 * self.alpha
    }

    /// G₁ has its branch points at cos θ = ±iα.
    fn grazing_width(&self) -> f64 {
        self.alpha.min(0.3)
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check_energy, check_reciprocity};
    use super::*;
    use crate::brdf::directional_albedo;

    #[test]
    fn it_is_reciprocal_and_keeps_within_the_energy_that_comes() {
        for alpha in [0.05, 0.2, 0.6] {
            let model = GgxDielectric {
                diffuse: 1.0,
                alpha,
                ior: 1.5,
            };
            check_reciprocity(&model);
            // A rough coat reflects a little more than the smooth one whose T is used: F̄(D) − F, below 0.02
            // up to α = 0.6 (and masking takes some of it back).
            check_energy(&model, 1.0 + 0.03 * alpha);
        }
    }

    #[test]
    fn the_base_reflects_its_share_of_what_gets_in() {
        let coat = |diffuse| GgxDielectric {
            diffuse,
            alpha: 0.2,
            ior: 1.5,
        };
        for angle in [0.0, 0.7, 1.3f64] {
            let base =
                directional_albedo(&coat(0.6), angle) - directional_albedo(&coat(0.0), angle);
            let expected = 0.6 * (1.0 - dielectric_reflectance(angle.cos(), 1.5));
            assert!((base - expected).abs() < 1e-6, "{base} {expected}");
        }
        // Egan and Hilgeman's F̄ for n = 1.5 and 4/3.
        assert!((1.0 - mean_transmittance(1.5) - 0.0918).abs() < 1e-4);
        assert!((1.0 - mean_transmittance(4.0 / 3.0) - 0.0664).abs() < 1e-4);
    }

    #[test]
    fn the_coat_is_that_of_mitsuba_s_rough_plastic() {
        // Mitsuba 3.9.1, `roughplastic`, `distribution = "ggx"`, α = 0.1, int_ior / ext_ior = 1.5: eval / cos θi′ less the same
        // without its specular part.
        let coat = GgxDielectric {
            diffuse: 0.0,
            alpha: 0.1,
            ior: 1.5,
        };
        for (i, o, expected) in [
            (0.0, 0.0, 0.463654995 - 0.1453451),
            (30.0, -30.0, 0.5843468646 - 0.1445107),
            (30.0, -20.0, 0.2742718469 - 0.1448100),
            (-70.0, 65.0, 5.518295106 - 0.1155569),
            (80.0, -84.0, 126.6857671 - 0.06667517),
        ] {
            let found = coat.value(LocalAngle::degrees(i), LocalAngle::degrees(o));
            // Single precision, and seven digits of the diffuse part.
            assert!(
                (found / expected - 1.0_f64).abs() < 2e-5,
                "{i} {o}: {found} {expected}"
            );
        }
    }

    #[test]
    fn with_a_smooth_coat_the_base_is_that_of_mitsuba_s_plastic() {
        // Mitsuba 3.9.1, `plastic`, int_ior over ext_ior 1 as below, eval / cos θi′; (ior, diffuse, θi′, θo′, ρ).
        for (ior, diffuse, i, o, expected) in [
            (1.5, 0.5, 0.0, 0.0, 1.616856e-01),
            (1.5, 0.5, 30.0, -20.0, 1.613844e-01),
            (1.5, 0.5, -80.0, 60.0, 9.784070e-02),
            (1.9, 0.2, -70.0, 65.0, 4.743531e-02),
            (1.9, 0.2, 80.0, -84.0, 1.808542e-02),
        ] {
            let (i, o) = (LocalAngle::degrees(i), LocalAngle::degrees(o));
            let with = |diffuse| {
                GgxDielectric {
                    diffuse,
                    alpha: 0.2,
                    ior,
                }
                .value(i, o)
            };
            let base = with(diffuse) - with(0.0);
            // Mitsuba's mean F is a fit of its own, good to 1e-3.
            assert!((base / expected - 1.0).abs() < 2e-3, "{base} {expected}");
        }
    }
}
