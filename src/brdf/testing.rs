//! The physics every model is tested for.

use std::f64::consts::PI;

use super::{Isotropic, directional_albedo};
use crate::angle::LocalAngle;

/// ρ(a, b) = ρ(b, a) ≥ 0, and ρ(a, b) = ρ(−a, −b), over the half circles and in space.
pub fn check_reciprocity(model: &dyn Isotropic) {
    for i in 0..36 {
        for j in 0..36 {
            let a = LocalAngle::degrees(-87.5 + 5.0 * f64::from(i));
            let b = LocalAngle::degrees(-87.5 + 5.0 * f64::from(j));
            let value = model.value(a, b);
            assert!(value >= 0.0 && value.is_finite(), "{model:?}: {value}");
            // Rounding of the half-angle products, magnified by the steepest lobe (exponent 2000).
            let tolerance = 1e-12 * (value + 1e-3);
            assert!(
                (value - model.value(b, a)).abs() <= tolerance,
                "{model:?} at {a:?} {b:?}"
            );
            assert!(
                (value - model.value(-a, -b)).abs() <= tolerance,
                "{model:?} at {a:?} {b:?}"
            );
            for phi in [0.3, 1.5, 2.9] {
                use super::Pair;
                let (s, t) = (a.rad().abs(), b.rad().abs());
                let there = model.rho(&Pair::in_space(s, t, phi));
                let back = model.rho(&Pair::in_space(t, s, phi));
                assert!((there - back).abs() <= 1e-11 * (there + 1e-3), "{model:?}");
            }
        }
    }
}

/// The directional albedo never exceeds `bound`.
pub fn check_energy(model: &dyn Isotropic, bound: f64) {
    for k in 0..9 {
        let albedo = directional_albedo(model, PI / 2.0 * f64::from(k) / 9.0);
        // The product rule's own error.
        assert!(
            albedo >= 0.0 && albedo <= bound + 1e-5,
            "{model:?}: {albedo} at {k}"
        );
    }
}
