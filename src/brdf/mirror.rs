//! The ideal mirror (eqs. 17–19).

use std::f64::consts::PI;

use super::{Brdf, Isotropic, Pair};
use crate::angle::LocalAngle;

/// ρ̂ = reflectance · δ(θi′ + θo′): B(α, θo′) = reflectance · L(α − θo′).
///
/// In the paper's eq. 17 the reflectance is 1. L here is irradiance per radian of in-plane angle, so a
/// mirror's B is per radian too, not per steradian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirror {
    /// Share of the incident light that is reflected, 0–1, the same at all angles.
    pub reflectance: f64,
}

impl Isotropic for Mirror {
    fn rho(&self, _pair: &Pair) -> f64 {
        0.0
    }
}

impl Brdf for Mirror {
    fn value(&self, _incident: LocalAngle, _exitant: LocalAngle) -> f64 {
        0.0
    }

    fn mirror(&self, exitant: LocalAngle) -> f64 {
        if exitant.is_visible() {
            self.reflectance
        } else {
            0.0
        }
    }

    /// Nothing but the delta, which needs no quadrature.
    fn lobe_width(&self) -> f64 {
        PI
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{directional_albedo, transfer_row};

    #[test]
    fn light_of_every_frequency_comes_back_from_the_mirror_direction() {
        let model = Mirror { reflectance: 0.8 };
        let exitant = LocalAngle::degrees(40.0);
        for (p, h) in transfer_row(&model, exitant, 20).iter().enumerate() {
            let expected = 0.8 * num_complex::Complex64::cis(-(p as f64) * exitant.rad());
            assert!((h - expected).norm() < 1e-15);
        }
        assert_eq!(directional_albedo(&model, 0.3), 0.8);
        assert_eq!(model.mirror(LocalAngle::degrees(95.0)), 0.0);
    }
}
