//! Incident light in the plane: L(θ) per channel, as a sum of sources, a uniform part, and a
//! smooth part given by a table or by Fourier coefficients.

mod csv;

use std::f64::consts::{PI, TAU};

use num_complex::Complex64;

use crate::angle::{WorldAngle, wrap};
use crate::fourier::{CircleTransform, Series};

/// A distant source: L = irradiance · δ(θ − `theta`).
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Direction to the source.
    pub theta: WorldAngle,
    /// Irradiance on a surface that faces it, W m⁻², per channel.
    pub irradiance: Vec<f64>,
}

/// Distant planar lighting, W m⁻² rad⁻¹ per channel: the sum of all its parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Lighting {
    /// Channel names.
    pub channels: Vec<String>,
    /// Directional sources.
    pub sources: Vec<Source>,
    /// Smooth part: per channel, n values at θ = −π + 2πi/n (the same n ≥ 1 for all), linear between
    /// them. Empty if there is none.
    pub table: Vec<Vec<f64>>,
}

impl Lighting {
    /// Uniform light, W m⁻² rad⁻¹ per channel.
    pub fn uniform(channels: Vec<String>, values: &[f64]) -> Self {
        let table = values.iter().map(|&v| vec![v]).collect();
        Self {
            channels,
            sources: Vec::new(),
            table,
        }
    }

    /// Only directional sources.
    pub fn from_sources(channels: Vec<String>, sources: Vec<Source>) -> Self {
        Self {
            channels,
            sources,
            table: Vec::new(),
        }
    }

    /// Smooth light from Fourier series, tabulated at `n` angles (take n ≥ 16 · order for 1e-3, since
    /// the table is linear between its values).
    pub fn from_series(channels: Vec<String>, series: &[Series], n: usize) -> Self {
        let transform = CircleTransform::new(n, -PI);
        let table = series.iter().map(|s| transform.synthesise(s)).collect();
        Self {
            channels,
            sources: Vec::new(),
            table,
        }
    }

    /// The smooth part L(θ), without the sources, W m⁻² rad⁻¹.
    pub fn density(&self, channel: usize, theta: WorldAngle) -> f64 {
        let Some(table) = self.table.get(channel) else {
            return 0.0;
        };
        let n = table.len();
        let position = (wrap(theta.rad()) + PI) / TAU * n as f64;
        let i = position.floor();
        let t = position - i;
        let i = i as usize;
        table[i % n] * (1.0 - t) + table[(i + 1) % n] * t
    }

    /// L_p of the whole lighting for 0 ≤ p ≤ `order` (eq. 6): exact for the sources and for the
    /// piecewise linear table.
    pub fn series(&self, channel: usize, order: usize) -> Series {
        let mut series = match self.table.get(channel) {
            Some(table) => {
                let n = table.len();
                let mut s = CircleTransform::new(n, -PI).analyse(table, order);
                // The transform of the interpolating hat functions: sinc²(p/n).
                for (p, c) in s.coefficients.iter_mut().enumerate().skip(1) {
                    let x = PI * p as f64 / n as f64;
                    *c *= (x.sin() / x).powi(2);
                }
                s
            }
            None => Series::zero(order),
        };
        for source in &self.sources {
            let e = source.irradiance[channel] / TAU;
            for (p, c) in series.coefficients.iter_mut().enumerate() {
                *c += e * Complex64::cis(-(p as f64) * source.theta.rad());
            }
        }
        series
    }

    /// ∫ L dθ over the circle, W m⁻².
    pub fn total_irradiance(&self, channel: usize) -> f64 {
        TAU * self.series(channel, 0).coefficients[0].re
    }

    /// The whole world's light turned counter-clockwise by `angle` radians.
    #[must_use]
    pub fn rotated(&self, angle: f64) -> Self {
        let n = self.table.first().map_or(1, Vec::len);
        let table = (0..self.table.len())
            .map(|c| {
                let at = |i: usize| -PI + TAU * i as f64 / n as f64 - angle;
                (0..n)
                    .map(|i| self.density(c, WorldAngle::radians(at(i))))
                    .collect()
            })
            .collect();
        let sources = self
            .sources
            .iter()
            .map(|s| Source {
                theta: WorldAngle::radians(s.theta.rad() + angle).wrapped(),
                irradiance: s.irradiance.clone(),
            })
            .collect();
        Self {
            channels: self.channels.clone(),
            sources,
            table,
        }
    }
}
