//! Planted surfaces under planted lights, and their light fields with noise.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::super::{Options, spectrum};
use crate::angle::{WorldAngle, wrap};
use crate::fourier::Series;
use crate::grid::Grid;
use crate::light_field::Samples;
use crate::lighting::{Lighting, Source};

/// ρ(θi′, θo′) of the planted surfaces, written out here so that the test shares nothing with the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Planted {
    Lambert,
    Phong(f64),
    Ggx(f64),
    Plastic,
    Velvet,
    Retro,
}

impl Planted {
    pub fn rho(self, a: f64, b: f64) -> f64 {
        let (ca, cb) = (a.cos(), b.cos());
        let ggx = |alpha: f64, f0: f64| {
            let h = (a + b) / 2.0;
            let ch = h.cos();
            let d = alpha * alpha / (PI * (ch * ch * (alpha * alpha - 1.0) + 1.0).powi(2));
            let g = |c: f64| 2.0 / (1.0 + (1.0 + alpha * alpha * (1.0 / (c * c) - 1.0)).sqrt());
            let cosine = ((a - b) / 2.0).cos();
            let f = f0 + (1.0 - f0) * (1.0 - cosine).powi(5);
            d * g(ca) * g(cb) * f / (4.0 * ca * cb)
        };
        match self {
            Self::Lambert => 0.6 / PI,
            Self::Phong(n) => 0.3 / PI + 0.4 * (n + 2.0) / TAU * (a + b).cos().max(0.0).powf(n),
            Self::Ggx(alpha) => ggx(alpha, 0.9),
            Self::Plastic => 0.5 / PI + ggx(0.2, 0.04),
            // Rises toward grazing, where a lobe model falls.
            Self::Velvet => {
                0.05 / PI + 0.15 * ((a + b) / 2.0).sin().abs().powi(3) / (ca + cb - ca * cb)
            }
            Self::Retro => 0.2 / PI + 0.8 * (a - b).cos().max(0.0).powi(60),
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub enum Light {
    Sun,
    TwoSuns,
    SkyAndSun,
    Random16,
}

pub fn lighting(light: Light) -> Lighting {
    let names = vec!["Y".to_owned()];
    let sun = |deg: f64, e: f64| Source {
        theta: WorldAngle::degrees(deg),
        irradiance: vec![e],
    };
    match light {
        Light::Sun => Lighting::from_sources(names, vec![sun(37.3, 3.0)]),
        Light::TwoSuns => Lighting::from_sources(names, vec![sun(37.3, 3.0), sun(-61.7, 1.4)]),
        Light::SkyAndSun => {
            let table = (0..720)
                .map(|i| {
                    let theta = -PI + TAU * f64::from(i) / 720.0;
                    0.25 + 0.15 * (theta - 0.4).cos() + 0.1 * (2.0 * theta).sin()
                })
                .collect();
            let mut l = Lighting::from_sources(names, vec![sun(37.3, 2.0)]);
            l.table = vec![table];
            l
        }
        Light::Random16 => {
            let mut rng = ChaCha8Rng::seed_from_u64(16);
            let mut series = Series::zero(16);
            let mut sum = 0.0;
            for c in series.coefficients.iter_mut().skip(1) {
                *c = Complex64::new(
                    StandardNormal.sample(&mut rng),
                    StandardNormal.sample(&mut rng),
                );
                sum += c.norm();
            }
            // Light is nowhere negative.
            series.coefficients[0] = Complex64::new(0.7 * sum, 0.0);
            Lighting::from_series(names, &[series], 1024)
        }
    }
}

/// Two-point Gauss nodes on `panels` panels of the half circle, each of weight π/(2 panels).
pub fn nodes(panels: usize) -> Vec<f64> {
    let h = PI / panels as f64;
    (0..panels)
        .flat_map(|k| {
            let middle = -FRAC_PI_2 + (k as f64 + 0.5) * h;
            [-1.0, 1.0].map(|s| middle + s * h / (2.0 * 3f64.sqrt()))
        })
        .collect()
}

/// B by eq. 4: sources directly, the smooth light by quadrature.
pub fn field(planted: Planted, light: &Lighting, grid: Grid) -> Vec<f64> {
    let angles = nodes(360);
    let weight = PI / angles.len() as f64;
    let mut out = vec![0.0; grid.len()];
    for j in 0..grid.locals {
        let b = grid.local(j).rad();
        let nodes: Vec<(f64, f64)> = angles
            .iter()
            .map(|&a| (a, planted.rho(a, b) * a.cos() * weight))
            .collect();
        for i in 0..grid.normals {
            let alpha = grid.normal(i).rad();
            let mut sum = 0.0;
            for s in &light.sources {
                let a = wrap(s.theta.rad() - alpha);
                if a.abs() < FRAC_PI_2 {
                    sum += s.irradiance[0] * planted.rho(a, b) * a.cos();
                }
            }
            if !light.table.is_empty() {
                sum += nodes
                    .iter()
                    .map(|&(a, r)| r * light.density(0, WorldAngle::radians(alpha + a)))
                    .sum::<f64>();
            }
            out[grid.index(i, j)] = sum;
        }
    }
    out
}

/// Limb cut of most tests: none but that of the grid's last column.
pub const LIMB: f64 = FRAC_PI_2;

/// Noise of σ = `level` · max on all samples with |θo′| within the limb cut that `seen` admits.
pub fn noisy(
    truth: &[f64],
    grid: Grid,
    level: f64,
    seed: u64,
    seen: impl Fn(f64, f64) -> bool,
) -> Samples {
    let largest = truth_max(truth, grid);
    let sigma = level * largest;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut variance = vec![f64::INFINITY; grid.len()];
    let mut value = vec![0.0; grid.len()];
    for i in 0..grid.normals {
        for j in 0..grid.locals {
            let z: f64 = StandardNormal.sample(&mut rng);
            let k = grid.index(i, j);
            let (alpha, b) = (grid.normal(i).rad(), grid.local(j).rad());
            if b.abs() <= LIMB && seen(alpha, b) {
                value[k] = truth[k] + sigma * z;
                variance[k] = sigma * sigma;
            }
        }
    }
    Samples::from_grid(grid, vec!["Y".to_owned()], &[value], &[variance])
}

/// Largest B within the limb cut.
pub fn truth_max(truth: &[f64], grid: Grid) -> f64 {
    let mut largest = 0.0f64;
    for i in 0..grid.normals {
        for j in 0..grid.locals {
            if grid.local(j).rad().abs() <= LIMB {
                largest = largest.max(truth[grid.index(i, j)]);
            }
        }
    }
    largest
}

/// ρ̃_{p,q} of a planted surface by quadrature.
pub fn planted_spectrum(planted: Planted, order: usize) -> Vec<Complex64> {
    let angles = nodes(200);
    let n = angles.len();
    let angle = |k: usize| angles[k];
    let value: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            (0..n)
                .map(|j| {
                    let (a, b) = (angle(i), angle(j));
                    planted.rho(a, b) * a.cos() * b.cos()
                })
                .collect()
        })
        .collect();
    let turn: Vec<Vec<Complex64>> = (0..=order)
        .map(|p| {
            (0..n)
                .map(|k| Complex64::cis(-(p as f64) * angle(k)))
                .collect()
        })
        .collect();
    let half: Vec<Vec<Complex64>> = (0..=order)
        .map(|p| {
            (0..n)
                .map(|j| (0..n).map(|i| turn[p][i] * value[i][j]).sum())
                .collect()
        })
        .collect();
    spectrum::indices(order)
        .into_iter()
        .map(|(p, q)| {
            let t = &turn[q.unsigned_abs() as usize];
            let sum: Complex64 = (0..n)
                .map(|j| half[p as usize][j] * if q < 0 { t[j].conj() } else { t[j] })
                .sum();
            sum / (4.0 * (n * n) as f64)
        })
        .collect()
}

/// (i, j, index) of the cells with i ≥ j.
pub fn cells(size: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..size).flat_map(move |i| (0..=i).map(move |j| (i, j, i * size + j)))
}

/// A small problem, for tests that run often.
pub fn small() -> (Options, Grid) {
    let options = Options {
        size: 45,
        intervals: Some(30),
        order: 10,
        ..Options::default()
    };
    let grid = Grid {
        normals: 120,
        locals: 45,
    };
    (options, grid)
}
