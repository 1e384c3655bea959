//! Rough metal: GGX microfacets with a conductor's Fresnel reflectance.

use std::f64::consts::PI;

use super::isotropic::slice;
use super::{Brdf, Isotropic, Pair, conductor_reflectance};
use crate::angle::LocalAngle;

/// D of the half vector: α² / (π cos⁴ (α² + tan²)²), written without the tangent's pole
/// (B. Walter et al., "Microfacet models for refraction through rough surfaces", EGSR 2007, eq. 33).
pub(super) fn distribution(pair: &Pair, alpha: f64) -> f64 {
    let a2 = alpha * alpha;
    let denominator = pair.cos_half * pair.cos_half * a2 + pair.sin2_half;
    a2 / (PI * denominator * denominator)
}

/// G₁(i) G₁(o) / (4 cos θi cos θo) with Smith's separable masking (Walter et al., eqs. 23 and 34),
/// finite at grazing angles.
pub(super) fn visibility(pair: &Pair, alpha: f64) -> f64 {
    let half = |cos: f64, sin: f64| cos + (cos * cos + alpha * alpha * sin * sin).sqrt();
    1.0 / (half(pair.cos_incident, pair.sin_incident) * half(pair.cos_exitant, pair.sin_exitant))
}

/// ρ = specular · F(θd) D(θh) G₁(θi) G₁(θo) / (4 cos θi cos θo), sr⁻¹; θh half angle, θd difference angle.
///
/// D and G₁ are those of GGX with separable Smith masking (Walter et al. 2007), F is the exact
/// conductor's. The same as Mitsuba 3's `roughconductor` with `distribution = "ggx"`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GgxConductor {
    /// Roughness α > 0 (the distribution's parameter, not its root).
    pub alpha: f64,
    /// Real part of the index of refraction.
    pub eta: f64,
    /// Imaginary part of the index of refraction.
    pub k: f64,
    /// A factor on the whole, 1 for a bare metal.
    pub specular: f64,
}

impl Isotropic for GgxConductor {
    fn rho(&self, pair: &Pair) -> f64 {
        self.specular
            * conductor_reflectance(pair.cos_difference, self.eta, self.k)
            * distribution(pair, self.alpha)
            * visibility(pair, self.alpha)
    }
}

impl Brdf for GgxConductor {
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
        self.alpha
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check_energy, check_reciprocity};
    use super::*;

    /// (θi′, θo′, ρ) in degrees and sr⁻¹: eval / cos θi′ of Mitsuba 3.9.1, `roughconductor`, variant `scalar_rgb`,
    /// `distribution = "ggx"`, for (α, η, k) = (0.2, 0.2, 3.9), (0.05, 1.5, 7) and (0.5, 2, 0.5).
    const MITSUBA: [[(f64, f64, f64); 9]; 3] = [
        [
            (0.0, 0.0, 1.893848300e+00),
            (30.0, -30.0, 2.507477056e+00),
            (30.0, -20.0, 1.656815985e+00),
            (-70.0, 65.0, 1.062026479e+01),
            (-80.0, 60.0, 5.621459712e+00),
            (45.0, 45.0, 2.197505071e-02),
            (-10.0, 85.0, 1.286109128e-01),
            (80.0, -84.0, 4.989120048e+01),
            (10.0, 25.0, 2.106079013e-01),
        ],
        [
            (0.0, 0.0, 2.837422943e+01),
            (30.0, -30.0, 3.777926584e+01),
            (30.0, -20.0, 2.144301742e+00),
            (-70.0, 65.0, 6.055918041e+01),
            (-80.0, 60.0, 1.797330249e+00),
            (45.0, 45.0, 1.409882053e-03),
            (-10.0, 85.0, 1.376618406e-02),
            (80.0, -84.0, 6.033979010e+02),
            (10.0, 25.0, 2.311894197e-02),
        ],
        [
            (0.0, 0.0, 4.301484674e-02),
            (30.0, -30.0, 5.587476873e-02),
            (30.0, -20.0, 4.943949271e-02),
            (-70.0, 65.0, 3.072228913e-01),
            (-80.0, 60.0, 3.441050827e-01),
            (45.0, 45.0, 1.227333219e-02),
            (-10.0, 85.0, 3.676068839e-02),
            (80.0, -84.0, 1.517067744e+00),
            (10.0, 25.0, 2.937032745e-02),
        ],
    ];

    fn metals() -> [GgxConductor; 3] {
        [(0.2, 0.2, 3.9), (0.05, 1.5, 7.0), (0.5, 2.0, 0.5)].map(|(alpha, eta, k)| GgxConductor {
            alpha,
            eta,
            k,
            specular: 1.0,
        })
    }

    #[test]
    fn it_is_mitsuba_s_rough_conductor() {
        for (metal, table) in metals().iter().zip(MITSUBA) {
            for (i, o, expected) in table {
                let found = metal.value(LocalAngle::degrees(i), LocalAngle::degrees(o));
                // Mitsuba computes in single precision: some ten roundings of 6e-8, and the cosine at 84°
                // carries its own 10 times larger.
                assert!(
                    (found / expected - 1.0).abs() < 1e-5,
                    "{metal:?} {i} {o}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn it_is_reciprocal_and_keeps_within_the_energy_that_comes() {
        for metal in metals() {
            check_reciprocity(&metal);
            check_energy(&metal, 1.0);
        }
    }

    #[test]
    fn without_masking_and_absorption_all_projected_microfacets_are_there() {
        // ∫ D cos θh dω = 1.
        for alpha in [0.05, 0.3, 1.0] {
            let mut sum = 0.0;
            let n = 200_000;
            for k in 0..n {
                let theta = (f64::from(k) + 0.5) / f64::from(n) * PI / 2.0;
                // With the incident direction at the half vector's mirror: θi = θo = θ on the same side.
                let pair = Pair::in_space(theta, theta, 0.0);
                sum += distribution(&pair, alpha) * theta.cos() * theta.sin();
            }
            sum *= 2.0 * PI * PI / 2.0 / f64::from(n);
            // Midpoint rule with a step of 8e-6 on a function of width α.
            assert!((sum - 1.0).abs() < 1e-6, "{alpha}: {sum}");
        }
    }
}
