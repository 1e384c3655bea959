//! Transfer functions whose Fourier coefficients are known in closed form (\[RH01\], section 4).
//!
//! They are in the paper's flatland normalisation where the function's name or description says so.

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2, TAU};

/// The coefficient (1/2π) ∫ cos θ e^{−ipθ} dθ over [−π/2, π/2]: twice that of the flatland Lambertian surface.
pub fn cosine_coefficient(p: i64) -> f64 {
    2.0 * lambertian_transfer(p)
}

/// The coefficient (1/2π) ∫ e^{−ipθ} dθ over [−π/2, π/2].
pub fn half_circle_coefficient(p: i64) -> f64 {
    match p {
        0 => 0.5,
        p if p % 2 == 0 => 0.0,
        p => (p as f64 * FRAC_PI_2).sin() / (PI * p as f64),
    }
}

/// ρ̂_p of a Lambertian surface of albedo 1 in flatland, ρ = ½ (eqs. 21–22): 1/8 for p = ±1, 0 for the other odd p, and
/// (−1)^{m+1} / (2π (4m² − 1)) for p = 2m. A surface in space with albedo a has 2a/π times that.
pub fn lambertian_transfer(p: i64) -> f64 {
    match p {
        1 | -1 => 0.125,
        p if p % 2 != 0 => 0.0,
        p => {
            let sign = if (p / 2) % 2 == 0 { -1.0 } else { 1.0 };
            let p = p as f64;
            sign / (TAU * (p * p - 1.0))
        }
    }
}

/// ρ̂_{−p}(0) of ρ = cos^β(θi′ + θo′), without any normalisation (eqs. 31–33):
/// Γ(2+β) / (4 · 2^β Γ((3−p+β)/2) Γ((3+p+β)/2)); zero at p = ±(β + 3 + 2k).
pub fn phong_normal_transfer(beta: f64, p: i64) -> f64 {
    let low = 0.5 * (3.0 - p.unsigned_abs() as f64 + beta);
    let high = 0.5 * (3.0 + p.unsigned_abs() as f64 + beta);
    if low <= 0.0 && low == low.floor() {
        // A pole of Γ.
        return 0.0;
    }
    let (log_low, sign) = libm::lgamma_r(low);
    let exponent = libm::lgamma(2.0 + beta)
        - (beta + 2.0) * std::f64::consts::LN_2
        - log_low
        - libm::lgamma(high);
    f64::from(sign) * exponent.exp()
}

/// ρ_p of exp(−((θi′ + θo′)/2)² / 2m²) in θi′ at θo′ = 0, without the cosine and over the whole line:
/// a Gaussian in p of width 1/(2m).
pub fn microfacet_gaussian(m: f64, p: i64) -> f64 {
    let x = m * p as f64;
    2.0 * m * SQRT_2 * PI.sqrt() / TAU * (-2.0 * x * x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;
    use crate::brdf::{Brdf, Lambertian, Phong, transfer_row};

    /// ρ̂_{−p}(0) by quadrature.
    fn at_normal_exitance(brdf: &dyn Brdf) -> Vec<f64> {
        let row = transfer_row(brdf, LocalAngle::radians(0.0), 60);
        row.iter().map(|h| h.re / TAU).collect()
    }

    #[test]
    fn the_lambertian_series_is_that_of_equations_21_and_22() {
        // Flatland: ρ = ½, that is an albedo of π/2 in space.
        let quadrature = at_normal_exitance(&Lambertian { albedo: PI / 2.0 });
        for (p, q) in quadrature.iter().enumerate() {
            // Rounding of 200 terms of size 1/100.
            assert!((q - lambertian_transfer(p as i64)).abs() < 1e-15, "{p}");
        }
        assert!((lambertian_transfer(0) - 1.0 / TAU).abs() < 1e-16);
        assert!((lambertian_transfer(-2) - 1.0 / (6.0 * PI)).abs() < 1e-16);
        assert_eq!(lambertian_transfer(3), 0.0);
        for p in [1i64, 2, 5, 7] {
            let sum: f64 = (0..100_000)
                .map(|k| -FRAC_PI_2 + (f64::from(k) + 0.5) * PI / 1e5)
                .map(|t| (p as f64 * t).cos() * 0.5e-5)
                .sum();
            // Midpoint rule, (pπ/1e5)²/24.
            assert!((sum - half_circle_coefficient(p)).abs() < 1e-8);
        }
    }

    #[test]
    fn phong_at_normal_exitance_is_that_of_equations_31_to_33() {
        for beta in [0.0, 1.0, 8.0, 32.0, 128.0, 2000.0] {
            let lobe = Phong {
                diffuse: 0.0,
                specular: TAU / (beta + 2.0),
                exponent: beta,
            };
            let quadrature = at_normal_exitance(&lobe);
            let largest = phong_normal_transfer(beta, 0);
            for (p, q) in quadrature.iter().enumerate() {
                let closed = phong_normal_transfer(beta, p as i64);
                // The quadrature's 1e-10 relative to the largest, and lgamma of 2000, 13,000, to 2⁻⁵² of itself.
                assert!(
                    (q - closed).abs() < 3e-11 * largest,
                    "β={beta} p={p}: {q} {closed}"
                );
            }
        }
        assert_eq!(phong_normal_transfer(8.0, 11), 0.0);
        assert_eq!(phong_normal_transfer(8.0, -13), 0.0);
        // Near-Gaussian for |p| ≪ β, up to p⁴/β³.
        let ratio = phong_normal_transfer(128.0, 8) / phong_normal_transfer(128.0, 0);
        assert!((ratio - (-64.0f64 / (2.0 * 131.0)).exp()).abs() < 4096.0 / 128f64.powi(3));
        // The tail falls as |p|^{−(2+β)}.
        let slope = (phong_normal_transfer(2.5, 2001) / phong_normal_transfer(2.5, 1001))
            .abs()
            .log2();
        assert!((slope + 4.5).abs() < 0.01, "{slope}");
    }

    #[derive(Debug)]
    struct Gaussian(f64);

    impl Brdf for Gaussian {
        fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
            let half = 0.5 * (incident.rad() + exitant.rad());
            (-half * half / (2.0 * self.0 * self.0)).exp()
        }

        fn lobe_width(&self) -> f64 {
            4.0 * self.0
        }
    }

    #[test]
    fn a_gaussian_of_the_half_angle_has_a_gaussian_spectrum() {
        for m in [0.02, 0.05, 0.1] {
            let quadrature = at_normal_exitance(&Gaussian(m));
            for (p, q) in quadrature.iter().enumerate() {
                let p = p as i64;
                // The cosine of ρ̂ shares each order out to its two neighbours. What the half circle cuts off is
                // exp(−(π/2)²/8m²) = 4e-14 for m = 0.1.
                let closed = 0.5 * (microfacet_gaussian(m, p - 1) + microfacet_gaussian(m, p + 1));
                assert!((q - closed).abs() < 1e-12, "{m} {p}: {q} {closed}");
            }
        }
    }
}
