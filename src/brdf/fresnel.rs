//! Fresnel reflectance of unpolarised light (M. Born and E. Wolf, *Principles of Optics*, §1.5 and §14.2).

/// Reflectance of a dielectric seen from outside; `ior` = n_inside / n_outside ≥ 1,
/// `cosine` of the angle of incidence in 0–1.
pub fn dielectric_reflectance(cosine: f64, ior: f64) -> f64 {
    let c = cosine.clamp(0.0, 1.0);
    // n cos θt
    let t = (ior * ior - 1.0 + c * c).max(0.0).sqrt();
    let s = (c - t) / (c + t);
    let n2 = ior * ior;
    let p = (n2 * c - t) / (n2 * c + t);
    0.5 * (s * s + p * p)
}

/// Reflectance of a conductor of complex index `eta` + i `k`, relative to the outside.
pub fn conductor_reflectance(cosine: f64, eta: f64, k: f64) -> f64 {
    let c = cosine.clamp(0.0, 1.0);
    let c2 = c * c;
    let s2 = 1.0 - c2;
    // a² − b² = η² − k² − sin² θ, ab = ηk: the refracted wave's (complex) n cos θt = a + ib.
    let real = eta * eta - k * k - s2;
    let modulus = (real * real + 4.0 * eta * eta * k * k).sqrt();
    let a = (0.5 * (modulus + real)).max(0.0).sqrt();
    let s = (modulus + c2 - 2.0 * a * c) / (modulus + c2 + 2.0 * a * c);
    let tail = modulus * c2 + s2 * s2;
    let cross = 2.0 * a * c * s2;
    let p = s * (tail - cross) / (tail + cross);
    0.5 * (s + p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;

    #[test]
    fn normal_grazing_and_brewster_values_are_the_textbook_ones() {
        assert!((dielectric_reflectance(1.0, 1.5) - 0.04).abs() < 1e-15);
        assert!((dielectric_reflectance(0.0, 1.5) - 1.0).abs() < 1e-15);
        // At Brewster's angle, tan θ = n, only s light is left: ((n² − 1)/(n² + 1))² / 2.
        let n: f64 = 1.5;
        let brewster = 1.0 / (1.0 + n * n).sqrt();
        let expected = 0.5 * ((n * n - 1.0) / (n * n + 1.0)).powi(2);
        assert!((dielectric_reflectance(brewster, n) - expected).abs() < 1e-15);
    }

    #[test]
    fn a_conductor_agrees_with_the_complex_equations_and_without_k_with_the_dielectric() {
        for k in 0..=20 {
            let c = f64::from(k) / 20.0;
            assert!(
                (conductor_reflectance(c, 1.5, 0.0) - dielectric_reflectance(c, 1.5)).abs() < 1e-12
            );
            let n = Complex64::new(0.2, 3.9);
            let t = (n * n - (1.0 - c * c)).sqrt();
            let s = ((c - t) / (c + t)).norm_sqr();
            let p = ((n * n * c - t) / (n * n * c + t)).norm_sqr();
            assert!((conductor_reflectance(c, 0.2, 3.9) - 0.5 * (s + p)).abs() < 1e-12);
        }
    }
}
