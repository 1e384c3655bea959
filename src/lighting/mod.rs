//! Incident light in the plane: L(θ) per channel, as a sum of distant sources, a band-limited part
//! given exactly by its Fourier series, and a table that is linear between its values.
//!
//! The three parts answer three needs. A sun is narrower than any table and must neither be smeared
//! nor ring; light that was recovered or designed up to a frequency is known exactly at every angle;
//! anything else that was measured comes as values at regular angles.

mod csv;
mod describe;
pub mod environment;

use std::f64::consts::{PI, TAU};

use num_complex::Complex64;

use crate::angle::{WorldAngle, wrap};
use crate::fourier::{CircleTransform, Series};

pub use csv::{
    LightingTable, SpectrumRow, Status, read_spectrum, read_table, spectrum_csv, values_csv,
    write_spectrum, write_table,
};
pub use describe::{EnvironmentDescription, LightingDescription, SourceDescription};

/// A distant source: L = irradiance · δ(θ − `theta`).
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Direction to the source.
    pub theta: WorldAngle,
    /// Irradiance on a surface that faces it, W m⁻², per channel.
    pub irradiance: Vec<f64>,
}

impl Source {
    /// Irradiance in one channel, W m⁻²; 0 for a channel it does not state.
    pub fn in_channel(&self, channel: usize) -> f64 {
        self.irradiance.get(channel).copied().unwrap_or(0.0)
    }
}

/// Distant planar lighting, W m⁻² rad⁻¹ per channel: the sum of all its parts.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Lighting {
    /// Channel names.
    pub channels: Vec<String>,
    /// Directional sources.
    pub sources: Vec<Source>,
    /// Tabulated part: per channel, n values at θ = −π + 2πi/n (the same n ≥ 1 for all), linear between
    /// them. Empty if there is none.
    pub table: Vec<Vec<f64>>,
    /// Band-limited part: per channel, its Fourier series, exact at every angle. Empty if there is
    /// none.
    pub smooth: Vec<Series>,
}

impl Lighting {
    /// Uniform light, W m⁻² rad⁻¹ per channel.
    pub fn uniform(channels: Vec<String>, values: &[f64]) -> Self {
        let table = values.iter().map(|&v| vec![v]).collect();
        Self {
            channels,
            table,
            ..Self::default()
        }
    }

    /// Only directional sources.
    pub fn from_sources(channels: Vec<String>, sources: Vec<Source>) -> Self {
        Self {
            channels,
            sources,
            ..Self::default()
        }
    }

    /// Light from Fourier series, tabulated at `n` angles. The table is linear between its values
    /// (take n ≥ 16 · order for 1e-3); [`Lighting::band_limited`] is exact.
    pub fn from_series(channels: Vec<String>, series: &[Series], n: usize) -> Self {
        let transform = CircleTransform::new(n, -PI);
        let table = series.iter().map(|s| transform.synthesise(s)).collect();
        Self {
            channels,
            table,
            ..Self::default()
        }
    }

    /// Light that is exactly its Fourier series, one per channel.
    pub fn band_limited(channels: Vec<String>, series: Vec<Series>) -> Self {
        Self {
            channels,
            smooth: series,
            ..Self::default()
        }
    }

    /// The smooth parts of L(θ), without the sources, W m⁻² rad⁻¹.
    pub fn density(&self, channel: usize, theta: WorldAngle) -> f64 {
        let tabulated = match self.table.get(channel) {
            Some(table) if !table.is_empty() => {
                let n = table.len();
                let position = (wrap(theta.rad()) + PI) / TAU * n as f64;
                let i = position.floor();
                let t = position - i;
                let i = i as usize;
                table[i % n] * (1.0 - t) + table[(i + 1) % n] * t
            }
            _ => 0.0,
        };
        tabulated
            + self
                .smooth
                .get(channel)
                .map_or(0.0, |s| s.evaluate(theta.rad()))
    }

    /// L_p of the whole lighting for 0 ≤ p ≤ `order` (eq. 6): exact for every part.
    pub fn series(&self, channel: usize, order: usize) -> Series {
        let mut series = self.density_series(channel, order);
        for source in &self.sources {
            let e = source.in_channel(channel) / TAU;
            for (p, c) in series.coefficients.iter_mut().enumerate() {
                *c += e * Complex64::cis(-(p as f64) * source.theta.rad());
            }
        }
        series
    }

    /// L_p without the sources for 0 ≤ p ≤ `order`: exact for the band-limited part and for the
    /// piecewise linear table.
    pub fn density_series(&self, channel: usize, order: usize) -> Series {
        let mut series = match self.table.get(channel) {
            Some(table) if !table.is_empty() => {
                let n = table.len();
                let mut s = CircleTransform::new(n, -PI).analyse(table, order);
                // The transform of the interpolating hat functions: sinc²(p/n).
                for (p, c) in s.coefficients.iter_mut().enumerate().skip(1) {
                    let x = PI * p as f64 / n as f64;
                    *c *= (x.sin() / x).powi(2);
                }
                s
            }
            _ => Series::zero(order),
        };
        if let Some(smooth) = self.smooth.get(channel) {
            for (c, s) in series.coefficients.iter_mut().zip(&smooth.coefficients) {
                *c += s;
            }
        }
        series
    }

    /// The largest frequency of the light, if it is band-limited: `None` if it has sources or a table
    /// with a kink (any table that is not constant).
    pub fn band(&self) -> Option<usize> {
        let constant = |t: &Vec<f64>| t.windows(2).all(|w| w[0] == w[1]);
        if !self.sources.is_empty() || !self.table.iter().all(constant) {
            return None;
        }
        Some(self.smooth.iter().map(Series::order).max().unwrap_or(0))
    }

    /// ∫ L dθ over the circle, W m⁻².
    pub fn total_irradiance(&self, channel: usize) -> f64 {
        self.series(channel, 0)
            .coefficients
            .first()
            .map_or(0.0, |c| TAU * c.re)
    }

    /// The whole world's light turned counter-clockwise by `angle` radians: exact for the sources and
    /// the band-limited part; a table is resampled at its own angles (exact if `angle` is a multiple
    /// of its step).
    #[must_use]
    pub fn rotated(&self, angle: f64) -> Self {
        let tabulated = Self {
            table: self.table.clone(),
            ..Self::default()
        };
        let table = (0..self.table.len())
            .map(|c| {
                let n = self.table[c].len();
                let at = |i: usize| -PI + TAU * i as f64 / n as f64 - angle;
                (0..n)
                    .map(|i| tabulated.density(c, WorldAngle::radians(at(i))))
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
            smooth: self.smooth.iter().map(|s| s.rotated(angle)).collect(),
        }
    }

    /// The sum of two lightings of the same channels. Tables of different lengths meet on their least
    /// common multiple, which is exact, if that is at most 2¹⁶; else on the longer one.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let channels = self.channels.clone();
        let [a, b] = [self, other].map(|l| l.table.first().map_or(0, Vec::len));
        let n = match (a, b) {
            (0, n) | (n, 0) => n,
            _ => match a / gcd(a, b) * b {
                n if n <= 1 << 16 => n,
                _ => a.max(b),
            },
        };
        let tables = [self, other].map(|l| Self {
            table: l.table.clone(),
            ..Self::default()
        });
        let table = if n == 0 {
            Vec::new()
        } else {
            (0..channels.len())
                .map(|c| {
                    (0..n)
                        .map(|i| {
                            let at = WorldAngle::radians(-PI + TAU * i as f64 / n as f64);
                            tables[0].density(c, at) + tables[1].density(c, at)
                        })
                        .collect()
                })
                .collect()
        };
        let smooth = if self.smooth.is_empty() && other.smooth.is_empty() {
            Vec::new()
        } else {
            let part =
                |l: &Self, c: usize| l.smooth.get(c).cloned().unwrap_or_else(|| Series::zero(0));
            (0..channels.len())
                .map(|c| {
                    let (a, b) = (part(self, c), part(other, c));
                    let order = a.order().max(b.order());
                    let (mut sum, b) = (a.with_order(order), b.with_order(order));
                    for (x, y) in sum.coefficients.iter_mut().zip(&b.coefficients) {
                        *x += y;
                    }
                    sum
                })
                .collect()
        };
        let sources = self.sources.iter().chain(&other.sources).cloned().collect();
        Self {
            channels,
            sources,
            table,
            smooth,
        }
    }

    /// L at `n` regular angles −π + 2πi/n per channel, \[channel\]\[n\], W m⁻² rad⁻¹. A source, which no
    /// value can hold, is shared between the two angles beside it, so that its irradiance and its
    /// direction (the centroid) are kept.
    pub fn tabulated(&self, n: usize) -> Vec<Vec<f64>> {
        let step = TAU / n as f64;
        (0..self.channels.len())
            .map(|channel| {
                let mut values: Vec<f64> = (0..n)
                    .map(|i| self.density(channel, WorldAngle::radians(-PI + i as f64 * step)))
                    .collect();
                for source in &self.sources {
                    let position = (wrap(source.theta.rad()) + PI) / step;
                    let (i, t) = (position.floor() as usize, position.fract());
                    let height = source.in_channel(channel) / step;
                    if n > 0 {
                        values[i % n] += height * (1.0 - t);
                        values[(i + 1) % n] += height * t;
                    }
                }
                values
            })
            .collect()
    }

    /// Light from values at n regular angles, the first at `start` (radians), \[channel\]\[n\].
    ///
    /// A table that *resolves* its function stands for its trigonometric interpolant, which is exact
    /// for any light of order below n/4; a table with spikes or edges stands for the straight lines
    /// between its values, which cannot ring. The upper half of the table's band decides: the sum of
    /// its magnitudes bounds what the interpolant could add between the values; it must stay below
    /// 1e-3 of the largest value in every channel. (An edge of relative height h has a sum of about
    /// h/4, a single raised value one of h/2.)
    pub fn from_samples(channels: Vec<String>, values: &[Vec<f64>], start: f64) -> Self {
        if values.iter().any(Vec::is_empty) {
            return Self {
                channels,
                ..Self::default()
            };
        }
        match resolved(values, start) {
            Some(series) => Self::band_limited(channels, series),
            None => Self {
                channels,
                table: values.iter().map(|v| on_the_lattice(v, start)).collect(),
                ..Self::default()
            },
        }
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The trigonometric interpolants of all channels if every one is resolved.
fn resolved(values: &[Vec<f64>], start: f64) -> Option<Vec<Series>> {
    values
        .iter()
        .map(|v| {
            let n = v.len();
            let highest = n.saturating_sub(1) / 2;
            let mut series = CircleTransform::new(n.max(1), start).analyse(v, highest);
            let size = v.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            let upper: f64 = series
                .coefficients
                .iter()
                .enumerate()
                .filter(|(p, _)| 4 * p >= n && *p > 0)
                .map(|(_, c)| 2.0 * c.norm())
                .sum();
            // The coefficient at n/2 exactly has no phase and is left out; it must vanish too.
            let alternating: f64 = if n > 1 && n % 2 == 0 {
                let sum: f64 = v
                    .iter()
                    .zip([1.0, -1.0].iter().cycle())
                    .map(|(x, s)| x * s)
                    .sum();
                (sum / n as f64).abs()
            } else {
                0.0
            };
            if upper + alternating > 1e-3 * size || alternating > 1e-6 * size {
                return None;
            }
            // What is below the transform's rounding carries nothing.
            while series.order() > 0
                && series
                    .coefficients
                    .last()
                    .is_some_and(|c| c.norm() < 1e-15 * size)
            {
                series.coefficients.pop();
            }
            Some(series)
        })
        .collect()
}

/// The piecewise linear function through `values` from `start`, tabulated from −π: exact if `start` is
/// a simple fraction of a step off the lattice, else on a lattice 16 times finer.
fn on_the_lattice(values: &[f64], start: f64) -> Vec<f64> {
    let n = values.len();
    let step = TAU / n as f64;
    let offset = ((start + PI) / step).rem_euclid(1.0);
    let finer = (1..=16usize)
        .find(|&k| {
            let shift = offset * k as f64;
            // Angles in files may be rounded to some nine digits.
            (shift - shift.round()).abs() < 1e-6
        })
        .unwrap_or(16);
    let fine = n * finer;
    (0..fine)
        .map(|i| {
            let theta = -PI + TAU * i as f64 / fine as f64;
            let position = (theta - start) / step;
            let whole = (position + 1e-9).floor();
            let t = (position - whole).max(0.0);
            let i = whole.rem_euclid(n as f64) as usize % n;
            if t < 2e-9 {
                values[i]
            } else {
                values[i] * (1.0 - t) + values[(i + 1) % n] * t
            }
        })
        .collect()
}
