//! Planted BRDFs come back within their error bars.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::angle::{WorldAngle, wrap};
use crate::fourier::Series;
use crate::grid::Grid;
use crate::lighting::Source;

/// ρ(θi′, θo′) of the planted surfaces, written out here so that the test shares nothing with the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Planted {
    Lambert,
    Phong(f64),
    Ggx(f64),
    Plastic,
    Velvet,
    Retro,
}

impl Planted {
    fn rho(self, a: f64, b: f64) -> f64 {
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
enum Light {
    Sun,
    TwoSuns,
    SkyAndSun,
    Random16,
}

fn lighting(light: Light) -> Lighting {
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

/// B by eq. 4: sources directly, the smooth light by the midpoint rule over 720 steps.
fn field(planted: Planted, light: &Lighting, grid: Grid) -> Vec<f64> {
    let steps = 720;
    let mut out = vec![0.0; grid.len()];
    for j in 0..grid.locals {
        let b = grid.local(j).rad();
        let nodes: Vec<(f64, f64)> = (0..steps)
            .map(|k| {
                let a = -FRAC_PI_2 + (f64::from(k) + 0.5) * PI / f64::from(steps);
                (a, planted.rho(a, b) * a.cos() * PI / f64::from(steps))
            })
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
const LIMB: f64 = FRAC_PI_2;

/// Noise of σ = `level` · max on all samples with |θo′| within the limb cut that `seen` admits.
fn noisy(
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
fn truth_max(truth: &[f64], grid: Grid) -> f64 {
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

/// ρ̃_{p,q} of a planted surface by the midpoint rule.
fn planted_spectrum(planted: Planted, order: usize) -> Vec<Complex64> {
    let n = 400;
    let angle = |k: usize| -FRAC_PI_2 + (k as f64 + 0.5) * PI / n as f64;
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

/// Sums over draws and quantities.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    count: f64,
    inside: f64,
    error: f64,
    bound: f64,
    sigma: f64,
}

impl Tally {
    fn add(&mut self, error: f64, sigma: f64, bound: f64) {
        self.count += 1.0;
        self.inside += f64::from(u8::from(error.abs() <= 1.959_964 * sigma));
        self.error += error * error;
        self.bound += bound * bound;
        self.sigma += sigma * sigma;
    }
    fn coverage(&self) -> f64 {
        self.inside / self.count
    }
    fn ratio(&self) -> f64 {
        (self.error / self.bound).sqrt()
    }
}

/// Values and coefficients that are determined, over `draws` noise draws.
fn study(
    planted: Planted,
    light: Light,
    level: f64,
    draws: u64,
    options: &Options,
    grid: Grid,
) -> (Tally, Tally, Slice) {
    let light = lighting(light);
    let truth = field(planted, &light, grid);
    let spectrum = planted_spectrum(planted, options.order);
    let (mut values, mut coefficients) = (Tally::default(), Tally::default());
    let mut last = None;
    for draw in 0..draws {
        let samples = noisy(&truth, grid, level, 100 + draw, |_, _| true);
        let estimate = recover(&samples, &light, options).unwrap();
        let slice = &estimate.slices[0];
        for i in 0..options.size {
            for j in 0..=i {
                let k = i * options.size + j;
                if slice.status[k] != Status::Determined {
                    continue;
                }
                let (a, b) = (estimate.angle(i), estimate.angle(j));
                let t = planted.rho(a, b) * a.cos() * b.cos();
                values.add(slice.reciprocal[k] - t, slice.sigma[k], slice.bound[k]);
            }
        }
        for (c, t) in slice.spectrum.iter().zip(&spectrum) {
            if c.status != Status::Determined {
                continue;
            }
            coefficients.add(c.value.re - t.re, c.sigma, c.bound);
            if c.p != c.q.abs() || c.q > 0 {
                coefficients.add(c.value.im - t.im, c.sigma, c.bound);
            }
        }
        last = Some(estimate);
    }
    (values, coefficients, last.unwrap().slices.remove(0))
}

#[test]
#[ignore = "prints the study's table: some minutes"]
fn table_of_the_study() {
    let grid = Grid {
        normals: 360,
        locals: 90,
    };
    let planted = [
        Planted::Phong(8.0),
        Planted::Phong(32.0),
        Planted::Phong(128.0),
        Planted::Ggx(0.1),
        Planted::Ggx(0.2),
        Planted::Ggx(0.4),
        Planted::Plastic,
        Planted::Velvet,
        Planted::Lambert,
        Planted::Retro,
    ];
    let intervals = std::env::var("INTERVALS")
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(60);
    let draws = std::env::var("DRAWS")
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(2);
    let only = std::env::var("LIGHT").unwrap_or_default();
    for light in [
        Light::Sun,
        Light::TwoSuns,
        Light::SkyAndSun,
        Light::Random16,
    ] {
        if !format!("{light:?}").starts_with(&only) {
            continue;
        }
        for p in planted {
            for level in [1e-4, 1e-3, 1e-2] {
                let options = Options {
                    size: 60,
                    intervals,
                    ..Options::default()
                };
                let start = std::time::Instant::now();
                let (v, c, s) = study(p, light, level, draws, &options, grid);
                let (u, w) = s.smoothness.lengths();
                println!(
                    "{light:?} {p:?} {level:.0e}: values {:.0}% cov {:.3} ratio {:.2} | coef {:.0}% cov {:.3} ratio {:.2} | l {:.1} {:.1} chi {:.3} noise {:.3} held {} edf {:.3} {:.2}s",
                    100.0 * v.count / draws as f64 / (60.0 * 61.0 / 2.0),
                    v.coverage(),
                    v.ratio(),
                    100.0 * c.count / draws as f64 / (2.0 * s.spectrum.len() as f64),
                    c.coverage(),
                    c.ratio(),
                    u.to_degrees(),
                    w.to_degrees(),
                    s.chi_square / (s.samples as f64 - s.parameters),
                    s.noise,
                    s.held,
                    s.parameters / (63.0 * 32.0),
                    start.elapsed().as_secs_f64() / draws as f64
                );
            }
        }
    }
}
