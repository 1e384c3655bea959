//! Lambert and a Phong lobe, in the reciprocal (modified) form.

use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, TAU};

use super::isotropic::slice;
use super::{Brdf, Isotropic, Pair};
use crate::angle::LocalAngle;

/// ρ = diffuse/π + specular (n + 2)/(2π) cosⁿ(θi′ + θo′), sr⁻¹; the lobe ends where the angle to the
/// mirror direction reaches 90°.
///
/// E. Lafortune and Y. Willems, "Using the modified Phong reflectance model for physically based
/// rendering", Leuven CW 197, 1994. At normal incidence the lobe reflects exactly `specular`, elsewhere less.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phong {
    /// Albedo of the Lambertian part.
    pub diffuse: f64,
    /// Albedo of the lobe at normal incidence.
    pub specular: f64,
    /// n ≥ 0.
    pub exponent: f64,
}

impl Isotropic for Phong {
    fn rho(&self, pair: &Pair) -> f64 {
        let lobe = if pair.cos_mirror > 0.0 {
            self.specular * (self.exponent + 2.0) / TAU * power(pair.cos_mirror, self.exponent)
        } else {
            0.0
        };
        self.diffuse * FRAC_1_PI + lobe
    }

    /// Whole exponents side by side: the same multiplications as one by one.
    fn rho_of_all(&self, pairs: &[Pair], rho: &mut Vec<f64>) {
        rho.clear();
        let Some(exponent) = whole(self.exponent) else {
            rho.extend(pairs.iter().map(|pair| self.rho(pair)));
            return;
        };
        let scale = self.specular * (self.exponent + 2.0) / TAU;
        let diffuse = self.diffuse * FRAC_1_PI;
        rho.extend(pairs.iter().map(|pair| pair.cos_mirror));
        pulp::Arch::new().dispatch(|| {
            for lanes in rho.chunks_mut(8) {
                let mut cosine = [0.0; 8];
                cosine[..lanes.len()].copy_from_slice(lanes);
                let (mut power, mut square, mut left) = ([1.0; 8], cosine, exponent);
                while left > 0 {
                    if left & 1 == 1 {
                        power.iter_mut().zip(square).for_each(|(p, s)| *p *= s);
                    }
                    left >>= 1;
                    square.iter_mut().for_each(|s| *s *= *s);
                }
                for ((rho, power), cosine) in lanes.iter_mut().zip(power).zip(cosine) {
                    let lobe = if cosine > 0.0 { scale * power } else { 0.0 };
                    *rho = diffuse + lobe;
                }
            }
        });
    }
}

/// A whole exponent, as people state them.
fn whole(n: f64) -> Option<i32> {
    let whole = n as i32;
    ((0..=1024).contains(&whole) && f64::from(whole) == n).then_some(whole)
}

/// xⁿ; whole exponents cost a few multiplications.
fn power(x: f64, n: f64) -> f64 {
    let Some(mut left) = whole(n) else {
        return x.powf(n);
    };
    let (mut power, mut square) = (1.0, x);
    while left > 0 {
        if left & 1 == 1 {
            power *= square;
        }
        left >>= 1;
        square *= square;
    }
    power
}

impl Brdf for Phong {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        slice(self, incident, exitant)
    }

    fn isotropic(&self) -> Option<&dyn Isotropic> {
        Some(self)
    }

    /// cosⁿ x ≈ exp(−n x²/2): two standard deviations.
    fn lobe_width(&self) -> f64 {
        2.0 / self.exponent.max(1.0).sqrt()
    }

    /// The lobe's cut-off at |θi′ + θo′| = 90°.
    fn kinks(&self, exitant: LocalAngle) -> Vec<f64> {
        vec![-FRAC_PI_2 - exitant.rad(), FRAC_PI_2 - exitant.rad()]
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check_energy, check_reciprocity};
    use super::*;
    use crate::brdf::directional_albedo;

    #[test]
    fn it_is_reciprocal_and_reflects_no_more_than_it_says() {
        for exponent in [1.0, 8.0, 32.0, 2000.0] {
            let model = Phong {
                diffuse: 0.3,
                specular: 0.6,
                exponent,
            };
            check_reciprocity(&model);
            check_energy(&model, 0.9);
            // (n+2)/(2π) normalises the lobe at normal incidence: ∫ cosⁿ⁺¹ θ dω = 2π/(n+2).
            assert!((directional_albedo(&model, 0.0) - 0.9).abs() < 1e-6);
        }
        // A narrow lobe keeps its first moment along the mirror direction: cos θ times as much.
        for angle in [0.4f64, 0.8, 1.1] {
            let narrow = Phong {
                diffuse: 0.0,
                specular: 1.0,
                exponent: 2000.0,
            };
            // What goes below the horizon is cos²⁰⁰⁰(π/2 − 1.1) = 1e-100.
            assert!((directional_albedo(&narrow, angle) - angle.cos()).abs() < 1e-6);
        }
    }
}
