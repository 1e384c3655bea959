//! The spectrum of the reciprocal transfer function, ρ̃_{p,q} (eq. 13), by quadrature.

use std::f64::consts::{PI, TAU};

use num_complex::Complex64;

use super::{Brdf, IncidentRule, transfer_row};
use crate::angle::LocalAngle;

/// ρ̃_{p,q} = (1/4π²) ∫∫ ρ̃(θi′, θo′) e^{−ipθi′ − iqθo′} dθi′ dθo′ for |p|, |q| ≤ order, sr⁻¹.
///
/// ρ̃ is real, so ρ̃_{−p,−q} = conj ρ̃_{p,q}; reciprocity is ρ̃_{p,q} = ρ̃_{q,p}.
#[derive(Clone, Debug, PartialEq)]
pub struct ReciprocalSpectrum {
    order: usize,
    /// p ≥ 0 only: \[p · (2 order + 1) + q + order\].
    coefficients: Vec<Complex64>,
}

impl ReciprocalSpectrum {
    /// The spectrum of `brdf` (its mirror included), by the rule of [`transfer_row`] in θi′ and a composite Gauss rule in
    /// θo′.
    pub fn of(brdf: &dyn Brdf, order: usize) -> Self {
        // In θo′, ρ̃_p is as smooth as the lobe, but near the horizon, and where two kinks of the BRDF meet; the
        // models' kinks meet at multiples of 15°.
        let ends = (-5..=5).map(|k| f64::from(k) * PI / 12.0).collect();
        let width = brdf.grazing_width().min(brdf.lobe_width()).max(1e-7);
        let rule = IncidentRule::composite(ends, &[(-PI / 2.0, width), (PI / 2.0, width)], order);
        let columns = 2 * order + 1;
        let mut coefficients = vec![Complex64::ZERO; (order + 1) * columns];
        for (&angle, &weight) in rule.angles.iter().zip(&rule.weights) {
            let row = transfer_row(brdf, LocalAngle::radians(angle), order);
            // H_p = 2π ρ̂_{−p}, and ρ̃ = ρ̂ cos θo′.
            let scale = weight * angle.cos() / (TAU * TAU);
            let step = Complex64::cis(-angle);
            let start = Complex64::cis(order as f64 * angle);
            for (h, line) in row.iter().zip(coefficients.chunks_exact_mut(columns)) {
                let mut term = scale * h.conj() * start;
                for c in line {
                    *c += term;
                    term *= step;
                }
            }
        }
        Self {
            order,
            coefficients,
        }
    }

    /// The largest |p| and |q|.
    pub fn order(&self) -> usize {
        self.order
    }

    /// ρ̃_{p,q}; zero beyond the order.
    pub fn get(&self, p: i64, q: i64) -> Complex64 {
        let n = self.order as i64;
        if p.abs() > n || q.abs() > n {
            return Complex64::ZERO;
        }
        if p < 0 {
            return self.get(-p, -q).conj();
        }
        let index = p * (2 * n + 1) + q + n;
        self.coefficients
            .get(index as usize)
            .copied()
            .unwrap_or(Complex64::ZERO)
    }

    /// Largest |ρ̃_{p,q} − ρ̃_{q,p}| over the largest |ρ̃_{p,q}|: 0 for a reciprocal BRDF.
    pub fn reciprocity_defect(&self) -> f64 {
        let n = self.order as i64;
        let (mut defect, mut largest) = (0.0f64, 0.0f64);
        for p in -n..=n {
            for q in -n..=n {
                let there = self.get(p, q);
                defect = defect.max((there - self.get(q, p)).norm());
                largest = largest.max(there.norm());
            }
        }
        if largest > 0.0 { defect / largest } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::super::closed_forms::{cosine_coefficient, half_circle_coefficient};
    use super::*;
    use crate::brdf::{Family, GgxConductor, Lambertian, Mirror};

    #[test]
    fn a_lambertian_spectrum_is_the_product_of_two_cosines() {
        let spectrum = ReciprocalSpectrum::of(&Lambertian { albedo: PI }, 12);
        for p in -12i64..=12 {
            for q in -12i64..=12 {
                let expected = cosine_coefficient(p) * cosine_coefficient(q);
                assert!((spectrum.get(p, q) - expected).norm() < 1e-14, "{p} {q}");
            }
        }
        assert_eq!(spectrum.get(13, 0), Complex64::ZERO);
    }

    #[test]
    fn a_mirror_on_the_half_circle_depends_on_the_difference_of_the_orders() {
        // ρ̃ = δ(θi′ + θo′) cos θo′: ρ̃_{p,q} = (1/4π²) ∫ cos b e^{i(p−q)b} db.
        let spectrum = ReciprocalSpectrum::of(&Mirror { reflectance: 1.0 }, 10);
        for p in -10..=10 {
            for q in -10..=10 {
                let expected = cosine_coefficient(p - q) / TAU;
                assert!((spectrum.get(p, q) - expected).norm() < 1e-14, "{p} {q}");
            }
        }
        // On the full circle, without the cosine, it is eq. 19: δ_pq/2π. Half of it is above the horizon.
        assert!((half_circle_coefficient(0) / TAU - 0.5 / TAU).abs() < 1e-15);
    }

    #[test]
    fn every_model_is_reciprocal_in_its_spectrum() {
        for family in Family::ALL {
            let values: Vec<f64> = family
                .parameters()
                .iter()
                .map(|p| match p.name {
                    "exponent" => 20.0,
                    "alpha" | "roughness" => 0.2,
                    "ior" => 1.5,
                    "sigma_deg" => 25.0,
                    "k" => 3.0,
                    _ => 0.4,
                })
                .collect();
            let defect =
                ReciprocalSpectrum::of(family.build(&values).as_ref(), 16).reciprocity_defect();
            // The inner rule is good to 1e-10; the outer one does not know all the kinks' crossings.
            assert!(defect < 1e-7, "{family:?}: {defect:.1e}");
        }
    }

    #[test]
    fn a_sharp_metal_s_spectrum_adds_up_to_its_values() {
        // Order 0,0 is the mean of ρ̃, here by the midpoint rule over the square.
        let metal = GgxConductor {
            alpha: 0.1,
            eta: 0.2,
            k: 3.9,
            specular: 1.0,
        };
        let n = 1000;
        let angle = |k: usize| -PI / 2.0 + (k as f64 + 0.5) * PI / n as f64;
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..n {
                let (a, b) = (angle(i), angle(j));
                sum +=
                    metal.value(LocalAngle::radians(a), LocalAngle::radians(b)) * a.cos() * b.cos();
            }
        }
        let expected = sum / (4.0 * (n * n) as f64);
        let found = ReciprocalSpectrum::of(&metal, 4).get(0, 0);
        // Midpoint rule: (π/n)²/24 times a second derivative of 1/α².
        assert!(
            (found.re / expected - 1.0).abs() < 1e-4,
            "{found} {expected}"
        );
    }
}
