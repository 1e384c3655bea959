//! The half circle of local angles: nodes, quadrature, and the exponentials on it.

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2};

use faer::Mat;
use num_complex::Complex64;

/// Nodes at each end whose weights are corrected.
const END_NODES: usize = 3;

/// csc y − 1/y = Σ c_n y^{2n−1}: 2 (2^{2n−1} − 1) |B_{2n}| / (2n)!, n = 1, 2, ….
const COSECANT: [f64; 8] = [
    1.0 / 6.0,
    7.0 / 360.0,
    31.0 / 15_120.0,
    127.0 / 604_800.0,
    73.0 / 3_421_440.0,
    1_414_477.0 / 653_837_184_000.0,
    8191.0 / 37_362_124_800.0,
    16_931_177.0 / 762_187_345_920_000.0,
];

/// Corrections γ_k of the midpoint rule for ∫ f(t) e^{ixt} dt (unit step) at an end t = 0 where f vanishes:
/// the sum gains Σ_k γ_k f(k + ½) over the three nodes nearest to the end.
///
/// The sum of e^{ixt} over the nodes misses the integral's end term by D(x) = i/x − i/(2 sin(x/2)), and that of tʲ e^{ixt}
/// by (−i d/dx)ʲ D: the γ solve Σ_k γ_k (k + ½)ʲ = (−i d/dx)ʲ D for j = 1, 2, 3, which is Euler–Maclaurin with the
/// oscillation taken exactly. ρ̃ = ρ cos θi′ cos θo′ does vanish at ±π/2.
fn end_correction(x: f64) -> [Complex64; END_NODES] {
    // D = −(i/2) Σ c_n (x/2)^{2n−1}; its j-th derivative term by term.
    let derivative = |j: i32| -> f64 {
        COSECANT
            .iter()
            .enumerate()
            .map(|(n, c)| {
                let power = 2 * n as i32 + 1;
                let falling: f64 = (0..j).map(|k| f64::from(power - k)).product();
                if power < j {
                    0.0
                } else {
                    -0.5 * c * falling * 0.5f64.powi(power) * x.powi(power - j)
                }
            })
            .sum()
    };
    let i = Complex64::I;
    // (−i)ʲ · i · derivative.
    let moments = [
        derivative(1) * Complex64::ONE,
        derivative(2) * -i,
        derivative(3) * -Complex64::ONE,
    ];
    // Inverse of Σ_k γ_k n_kʲ for n = ½, 3/2, 5/2: Lagrange polynomials t·(quadratic) through the nodes.
    let nodes = [0.5, 1.5, 2.5];
    let mut gamma = [Complex64::ZERO; END_NODES];
    for (k, g) in gamma.iter_mut().enumerate() {
        let (a, b) = (nodes[(k + 1) % 3], nodes[(k + 2) % 3]);
        let scale = nodes[k] * (nodes[k] - a) * (nodes[k] - b);
        *g = (a * b * moments[0] - (a + b) * moments[1] + moments[2]) / scale;
    }
    gamma
}

/// Regular nodes at the centres of `len` cells over [−π/2, π/2].
#[derive(Clone, Debug)]
pub(super) struct HalfCircle {
    /// θ′ of each node, radians, \[N\].
    pub angles: Vec<f64>,
    /// cos θ′ of each node, \[N\].
    pub cosines: Vec<f64>,
}

impl HalfCircle {
    /// With `len` ≥ 1 cells.
    pub fn new(len: usize) -> Self {
        let step = PI / len as f64;
        let angles: Vec<f64> = (0..len)
            .map(|k| -FRAC_PI_2 + (k as f64 + 0.5) * step)
            .collect();
        let cosines = angles.iter().map(|a| a.cos()).collect();
        Self { angles, cosines }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.angles.len()
    }

    /// Width of a cell, radians.
    pub fn step(&self) -> f64 {
        PI / self.len() as f64
    }

    /// Weights w_k of ∫ f(θ) e^{ipθ} dθ ≈ Σ_k w_k f(θ_k) for f that vanishes at ±π/2, \[N\]; exact to fifth order
    /// in the step at the ends, and as the midpoint rule (spectrally) inside.
    pub fn exponential(&self, p: i64) -> Vec<Complex64> {
        let (step, n) = (self.step(), self.len());
        let mut weights: Vec<Complex64> = self
            .angles
            .iter()
            .map(|a| step * Complex64::cis(p as f64 * a))
            .collect();
        // The series of the correction converges for steps below a turn of e^{ipθ}; there and beyond the
        // rule is lost anyway.
        let x = p as f64 * step;
        if n >= 2 * END_NODES && x.abs() < PI {
            let end = Complex64::cis(p as f64 * FRAC_PI_2) * step;
            for (k, gamma) in end_correction(x).into_iter().enumerate() {
                weights[k] += end.conj() * gamma;
                weights[n - 1 - k] += end * gamma.conj();
            }
        }
        weights
    }

    /// The map from a column of ρ̃ to its transform ∫ ρ̃(θi′, ·) e^{ipθi′} dθi′ in the
    /// [real basis](super::columns::Spectrum): (2·order + 1) × N.
    pub fn exponentials(&self, order: usize) -> Mat<f64> {
        let rows: Vec<Vec<Complex64>> = (0..=order).map(|p| self.exponential(p as i64)).collect();
        Mat::from_fn(2 * order + 1, self.len(), |row, k| {
            let value = rows[row.div_ceil(2)][k];
            match (row, row % 2) {
                (0, _) => value.re,
                (_, 1) => SQRT_2 * value.re,
                _ => SQRT_2 * value.im,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rule_integrates_functions_that_vanish_at_the_ends_to_fifth_order() {
        // ∫ cos θ e^{aθ} dθ = 2 cosh(aπ/2) / (1 + a²) with a = 1 + ip.
        for p in [0, 3, 20] {
            let a = Complex64::new(1.0, f64::from(p));
            let exact = 2.0 * (a * FRAC_PI_2).cosh() / (1.0 + a * a);
            let error = |n: usize| {
                let half = HalfCircle::new(n);
                let sum: Complex64 = half
                    .angles
                    .iter()
                    .zip(half.exponential(i64::from(p)))
                    .map(|(t, w)| w * t.cos() * t.exp())
                    .sum();
                (sum - exact).norm()
            };
            // Halving the step divides an error of order 5 by 32 or more.
            assert!(
                error(40) / error(80) > 25.0,
                "{p}: {} {}",
                error(40),
                error(80)
            );
            // The plain midpoint rule is off by h²/24·[f′] = 4e-5·5 here.
            assert!(error(90) < 2e-8, "{p}: {}", error(90));
        }
    }
}
