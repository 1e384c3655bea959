//! A real function on the circle by its Fourier coefficients.

use std::f64::consts::TAU;

use num_complex::Complex64;
use serde::{Deserialize, Serialize};

/// The Fourier series of a real function, f(θ) = Σ_{|p| ≤ order} f_p e^{ipθ} (eq. 6).
///
/// Only p ≥ 0 is stored: f_{−p} = conj f_p, and f_0 is real.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// f_0 … f_order.
    pub coefficients: Vec<Complex64>,
}

impl Series {
    /// The zero function with coefficients up to `order`.
    pub fn zero(order: usize) -> Self {
        Self {
            coefficients: vec![Complex64::ZERO; order + 1],
        }
    }

    /// The largest stored frequency.
    pub fn order(&self) -> usize {
        self.coefficients.len().saturating_sub(1)
    }

    /// f_p for any sign of p; zero beyond the order.
    pub fn get(&self, p: i64) -> Complex64 {
        match self.coefficients.get(p.unsigned_abs() as usize) {
            Some(c) if p < 0 => c.conj(),
            Some(c) => *c,
            None => Complex64::ZERO,
        }
    }

    /// f(θ), by direct summation.
    pub fn evaluate(&self, theta: f64) -> f64 {
        let mut sum = 0.0;
        let step = Complex64::cis(theta);
        let mut turn = Complex64::ONE;
        for (p, c) in self.coefficients.iter().enumerate() {
            let term = (c * turn).re;
            sum += if p == 0 { term } else { 2.0 * term };
            turn *= step;
        }
        sum
    }

    /// (∫ f² dθ)^½ by Parseval's theorem.
    pub fn norm(&self) -> f64 {
        let mut sum = 0.0;
        for (p, c) in self.coefficients.iter().enumerate() {
            sum += if p == 0 {
                c.norm_sqr()
            } else {
                2.0 * c.norm_sqr()
            };
        }
        (TAU * sum).sqrt()
    }

    /// The series of f(θ − `angle`): the function turned counter-clockwise by `angle`.
    pub fn rotated(&self, angle: f64) -> Self {
        let coefficients = self
            .coefficients
            .iter()
            .enumerate()
            .map(|(p, c)| c * Complex64::cis(-(p as f64) * angle))
            .collect();
        Self { coefficients }
    }

    /// The same series cut or padded with zeros to `order`.
    pub fn with_order(&self, order: usize) -> Self {
        let mut coefficients = self.coefficients.clone();
        coefficients.resize(order + 1, Complex64::ZERO);
        Self { coefficients }
    }
}

/// Reads a number that JSON, which has no infinity, holds as `null`.
///
/// # Errors
/// If it is neither a number nor null.
pub(crate) fn or_infinite<'de, D: serde::Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(from)?.unwrap_or(f64::INFINITY))
}
