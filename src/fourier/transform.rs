//! Between samples on a regular circle of angles and Fourier coefficients, by FFT.

use std::cell::RefCell;
use std::f64::consts::TAU;
use std::sync::Arc;

use num_complex::Complex64;
use rustfft::{Fft, FftPlanner};

use super::Series;

/// Transforms between `n` equidistant samples f(start + 2πi/n) and the coefficients of eq. 6.
///
/// One value can be shared between threads.
#[derive(Clone)]
pub struct CircleTransform {
    n: usize,
    start: f64,
    forward: Arc<dyn Fft<f64>>,
    inverse: Arc<dyn Fft<f64>>,
}

impl std::fmt::Debug for CircleTransform {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "CircleTransform({} samples from {} rad)",
            self.n, self.start
        )
    }
}

impl CircleTransform {
    /// For `n` ≥ 1 samples, the first at angle `start` (radians).
    /// Plans are kept for later calls on the same thread.
    pub fn new(n: usize, start: f64) -> Self {
        thread_local! {
            static PLANNER: RefCell<FftPlanner<f64>> = RefCell::new(FftPlanner::new());
        }
        PLANNER.with_borrow_mut(|planner| Self {
            n,
            start,
            forward: planner.plan_fft_forward(n),
            inverse: planner.plan_fft_inverse(n),
        })
    }

    /// Number of samples on the circle.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// The angle of sample `i`, radians, not wrapped.
    pub fn angle(&self, i: usize) -> f64 {
        self.start + i as f64 * TAU / self.n as f64
    }

    /// f_p ≈ (1/n) Σ_i f(θ_i) e^{−ipθ_i} for 0 ≤ p ≤ `order`; exact for a function of order below n/2.
    ///
    /// # Panics
    /// If `samples` does not hold `n` values (a mistake of the caller).
    pub fn analyse(&self, samples: &[f64], order: usize) -> Series {
        assert_eq!(samples.len(), self.n, "one sample for each angle");
        let mut buffer: Vec<Complex64> = samples.iter().map(|&v| Complex64::new(v, 0.0)).collect();
        self.forward.process(&mut buffer);
        let turn = Complex64::cis(-self.start);
        let mut phase = Complex64::new(1.0 / self.n as f64, 0.0);
        let coefficients = (0..=order)
            .map(|p| {
                let coefficient = buffer[p % self.n] * phase;
                phase *= turn;
                coefficient
            })
            .collect();
        Series { coefficients }
    }

    /// Σ_i f_i e^{−ipθ_i} (no 1/n) for 0 ≤ p ≤ `order`: the transform of a weighted set of points.
    ///
    /// # Panics
    /// If `values` does not hold `n` values (a mistake of the caller).
    pub fn sum(&self, values: &[f64], order: usize) -> Vec<Complex64> {
        let mut sums = self.analyse(values, order).coefficients;
        for s in &mut sums {
            *s *= self.n as f64;
        }
        sums
    }

    /// f(θ_i) for all i. Frequencies at or above n/2 alias, as they would in the exact sum.
    pub fn synthesise(&self, series: &Series) -> Vec<f64> {
        let mut buffer = vec![Complex64::ZERO; self.n];
        let turn = Complex64::cis(self.start);
        let mut phase = Complex64::ONE;
        for (p, c) in series.coefficients.iter().enumerate() {
            let turned = c * phase;
            phase *= turn;
            // f = Re(f_0 + 2 Σ_{p>0} f_p e^{ipθ}): one side of the spectrum is enough.
            buffer[p % self.n] += if p == 0 { turned } else { 2.0 * turned };
        }
        self.inverse.process(&mut buffer);
        buffer.iter().map(|c| c.re).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn a_planted_series_comes_back_whatever_the_first_angle() {
        let series = Series {
            coefficients: vec![
                Complex64::new(1.5, 0.0),
                Complex64::new(0.3, -0.2),
                Complex64::new(-0.1, 0.7),
                Complex64::new(0.0, 0.05),
            ],
        };
        for start in [0.0, -PI, 0.123] {
            for n in [7, 8, 720] {
                let transform = CircleTransform::new(n, start);
                let samples: Vec<f64> = (0..n)
                    .map(|i| series.evaluate(transform.angle(i)))
                    .collect();
                let found = transform.analyse(&samples, 3);
                for (a, b) in found.coefficients.iter().zip(&series.coefficients) {
                    // Rounding: a handful of operations of size 1 on 2⁻⁵³.
                    assert!((a - b).norm() < 1e-14, "{a} {b} n={n}");
                }
                for (a, b) in transform.synthesise(&series).iter().zip(&samples) {
                    assert!((a - b).abs() < 1e-13);
                }
            }
        }
    }

    #[test]
    fn rotation_multiplies_by_a_phase() {
        let series = Series {
            coefficients: vec![Complex64::ONE, Complex64::new(0.2, 0.1), Complex64::I],
        };
        let turned = series.rotated(0.7);
        for k in 0..20 {
            let theta = f64::from(k) * 0.3;
            assert!((turned.evaluate(theta) - series.evaluate(theta - 0.7)).abs() < 1e-14);
        }
    }
}
