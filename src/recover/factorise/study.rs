//! Monte-Carlo studies of the factorisation: error against the Cramér–Rao bound, coverage, eq. 29.

use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Arc;

use num_complex::Complex64;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::{Options, Status, cramer_rao, recover};
use crate::angle::{LocalAngle, NormalAngle, WorldAngle};
use crate::brdf::{Brdf, Model};
use crate::fourier::Series;
use crate::grid::Grid;
use crate::light_field::Samples;
use crate::lighting::Lighting;
use crate::reflect;

/// A BRDF by its recipe.
pub(super) fn brdf(recipe: &str) -> Arc<dyn Brdf> {
    let table: toml::Table = recipe.parse().expect("a TOML table");
    let material = Model::from_table(&table)
        .and_then(|m| m.material(&["Y".into()], Path::new(".")))
        .expect("a model");
    material.brdfs[0].clone()
}

pub(super) const PHONG_8: &str = "model = 'phong'\ndiffuse = 0.3\nspecular = 0.7\nexponent = 8";
pub(super) const PHONG_32: &str = "model = 'phong'\ndiffuse = 0.3\nspecular = 0.7\nexponent = 32";
pub(super) const PHONG_128: &str = "model = 'phong'\ndiffuse = 0.3\nspecular = 0.7\nexponent = 128";
pub(super) const GGX_01: &str = "model = 'ggx-conductor'\nalpha = 0.1\neta = 0.2\nk = 3.9";
pub(super) const GGX_02: &str = "model = 'ggx-conductor'\nalpha = 0.2\neta = 0.2\nk = 3.9";
pub(super) const GGX_04: &str = "model = 'ggx-conductor'\nalpha = 0.4\neta = 0.2\nk = 3.9";
pub(super) const PLASTIC: &str = "model = 'ggx-dielectric'\ndiffuse = 0.4\nalpha = 0.15\nior = 1.5";
pub(super) const VELVET: &str = "model = 'sheen'\ndiffuse = 0.1\nsheen = 0.8\nroughness = 0.3";

/// Two suns and a little uniform fill.
pub(super) fn two_suns() -> Lighting {
    let mut light = Lighting::uniform(vec!["Y".into()], &[0.04]);
    for (theta, e) in [(37.3, 3.0), (-104.6, 1.1)] {
        light.sources.push(crate::lighting::Source {
            theta: WorldAngle::degrees(theta),
            irradiance: vec![e],
        });
    }
    light
}

/// A sun in a sky that is bright overhead and dark below.
pub(super) fn sky_and_sun() -> Lighting {
    let table = (0..1440)
        .map(|i| {
            let theta = -PI + TAU * f64::from(i) / 1440.0;
            0.1 + 0.5 * (theta - 1.2).cos().max(0.0).powi(2)
        })
        .collect();
    Lighting {
        channels: vec!["Y".into()],
        sources: vec![crate::lighting::Source {
            theta: WorldAngle::degrees(37.3),
            irradiance: vec![2.0],
        }],
        table: vec![table],
        smooth: Vec::new(),
    }
}

/// A random light of the given order, nowhere negative by its mean.
pub(super) fn random(order: usize, seed: u64) -> Series {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let mut series = Series::zero(order);
    series.coefficients[0] = Complex64::ONE;
    for c in series.coefficients.iter_mut().skip(1) {
        *c = Complex64::new(normal(), normal()) * 0.25;
    }
    series
}

pub(super) enum Light {
    Real(Lighting),
    Limited(Series),
}

impl Light {
    /// The series with L_0 = 1, and the light field scaled alike.
    pub(super) fn series(&self, order: usize) -> Series {
        let mut s = match self {
            Self::Real(l) => l.series(0, order),
            Self::Limited(s) => s.with_order(order),
        };
        let zero = s.coefficients[0].re;
        for c in &mut s.coefficients {
            *c /= zero;
        }
        s
    }

    pub(super) fn value(&self, brdf: &dyn Brdf, row: &[Complex64], alpha: f64, local: f64) -> f64 {
        match self {
            Self::Real(l) => {
                reflect::integral::value(
                    l,
                    0,
                    brdf,
                    NormalAngle::radians(alpha),
                    LocalAngle::radians(local),
                ) / l.series(0, 0).coefficients[0].re
            }
            Self::Limited(s) => Series {
                coefficients: s.coefficients.iter().zip(row).map(|(l, h)| l * h).collect(),
            }
            .evaluate(alpha),
        }
    }

    /// B at the cells of `grid`.
    pub(super) fn field(&self, brdf: &dyn Brdf, grid: Grid) -> Vec<f64> {
        let order = match self {
            Self::Real(_) => 0,
            Self::Limited(s) => s.order(),
        };
        let columns: Vec<Vec<f64>> = (0..grid.locals)
            .into_par_iter()
            .map(|j| {
                let row = crate::brdf::transfer_row(brdf, grid.local(j), order);
                (0..grid.normals)
                    .map(|i| self.value(brdf, &row, grid.normal(i).rad(), grid.local(j).rad()))
                    .collect()
            })
            .collect();
        let mut field = vec![0.0; grid.len()];
        for (j, column) in columns.iter().enumerate() {
            for (i, v) in column.iter().enumerate() {
                field[grid.index(i, j)] = *v;
            }
        }
        field
    }
}

/// `clean` with seeded noise of `sigma` per cell, without the columns beyond `cut` degrees.
pub(super) fn samples(
    clean: &[f64],
    grid: Grid,
    sigma: f64,
    cut: f64,
    seed: Option<u64>,
) -> Samples {
    let mut value = clean.to_vec();
    if let Some(seed) = seed {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        for v in &mut value {
            let e: f64 = StandardNormal.sample(&mut rng);
            *v += sigma * e;
        }
    }
    let mut variance = vec![sigma * sigma; grid.len()];
    for (cell, v) in variance.iter_mut().enumerate() {
        if grid.local(cell % grid.locals).deg().abs() > cut {
            *v = f64::INFINITY;
        }
    }
    Samples::from_grid(grid, vec!["Y".into()], &[value], &[variance])
}

/// Relative error of p ≤ `to` in the L2 norm, both with L_0 = 1.
pub(super) fn error(found: &Series, truth: &Series, to: usize) -> f64 {
    let (mut difference, mut norm) = (0.0, truth.get(0).norm_sqr());
    for p in 1..=to as i64 {
        difference += 2.0 * (found.get(p) - truth.get(p)).norm_sqr();
        norm += 2.0 * truth.get(p).norm_sqr();
    }
    (difference / norm).sqrt()
}

/// What many draws of one case gave.
#[derive(Debug, Default)]
pub(super) struct Cell {
    pub band: usize,
    pub rms: f64,
    pub bias: f64,
    pub bound: f64,
    pub coverage: f64,
    pub start: f64,
    pub ratio: f64,
    pub misfit: f64,
    pub unsettled: usize,
    pub spread: f64,
    pub seconds: f64,
}

/// Errors are summed over the frequencies that are `determined` in every draw and whose own bound is below
/// 5 % of L_0.
pub(super) fn monte_carlo(
    brdf: &dyn Brdf,
    light: &Light,
    grid: Grid,
    noise: f64,
    cut: f64,
    draws: u64,
    options: &Options,
) -> Cell {
    let clean = light.field(brdf, grid);
    let sigma = noise * clean.iter().copied().fold(0.0, f64::max);
    let begun = std::time::Instant::now();
    let found: Vec<_> = (0..draws)
        .map(|d| {
            let s = samples(&clean, grid, sigma, cut, Some(1000 + d));
            recover(&s, options)
                .expect("a factorisation")
                .channels
                .remove(0)
        })
        .collect();
    let seconds = begun.elapsed().as_secs_f64() / draws as f64;
    let band = found.iter().map(|c| c.band).min().unwrap_or(0);
    let truth = light.series(band);
    let bound =
        cramer_rao(&samples(&clean, grid, sigma, cut, None), 0, &truth, band).expect("bound");
    let kept: Vec<usize> = (1..=band)
        .filter(|&p| bound[p] < 0.05 && found.iter().all(|c| c.status[p] == Status::Determined))
        .collect();
    let norm = truth.norm().powi(2) / TAU;
    let mut cell = Cell {
        band,
        seconds,
        ..Cell::default()
    };
    let (mut inside, mut count) = (0.0, 0.0);
    for &p in &kept {
        cell.bound += 2.0 * bound[p].powi(2) / norm;
        let mut mean = Complex64::ZERO;
        for c in &found {
            let e = c.lighting.coefficients[p] - truth.coefficients[p];
            mean += e / draws as f64;
            cell.rms += 2.0 * e.norm_sqr() / norm / draws as f64;
            cell.start += 2.0 * (c.start.coefficients[p] - truth.coefficients[p]).norm_sqr()
                / norm
                / draws as f64;
            cell.ratio += 2.0 * (c.ratio.coefficients[p] - truth.coefficients[p]).norm_sqr()
                / norm
                / draws as f64;
            cell.spread += 2.0 * c.sigma[p].powi(2) / norm / draws as f64;
            if let Some(i) = c.frequencies.iter().position(|&q| q == p) {
                let m = 2 * (c.frequencies.len() - 1);
                for (part, e) in [(2 * i - 2, e.re), (2 * i - 1, e.im)] {
                    inside +=
                        f64::from(e.abs() <= 1.959_964 * c.covariance[part * m + part].sqrt());
                    count += 1.0;
                }
            }
        }
        cell.bias += 2.0 * mean.norm_sqr() / norm;
    }
    for v in [
        &mut cell.rms,
        &mut cell.bias,
        &mut cell.bound,
        &mut cell.start,
        &mut cell.ratio,
        &mut cell.spread,
    ] {
        *v = v.sqrt();
    }
    cell.coverage = inside / count;
    cell.misfit = found.iter().map(|c| c.misfit).sum::<f64>() / draws as f64;
    cell.unsettled = found.iter().filter(|c| !c.converged).count();
    // Coverage of all complex errors, in σ.
    let (mut wi, mut wc) = (0.0, 0.0);
    for c in &found {
        for p in 1..=band {
            if c.sigma[p] < 0.4 && !kept.contains(&p) {
                wi += f64::from(
                    (c.lighting.coefficients[p] - truth.coefficients[p]).norm()
                        <= 1.7308 * c.sigma[p],
                );
                wc += 1.0;
            }
        }
    }
    let weak: f64 = wi / wc;
    println!(
        "band {band} kept {} | rms {:.2e} bound {:.2e} ratio {:.3} | bias {:.1e} sigma/bound {:.3} coverage {:.3} | start {:.1e} eq29 {:.1e} | misfit {:.3} unsettled {} | {:.0} ms | weak {weak:.3}",
        kept.len(),
        cell.rms,
        cell.bound,
        cell.rms / cell.bound,
        cell.bias,
        cell.spread / cell.bound,
        cell.coverage,
        cell.start,
        cell.ratio,
        cell.misfit,
        cell.unsettled,
        1e3 * cell.seconds
    );
    cell
}

#[test]
#[ignore = "minutes"]
fn explore() {
    let n: usize = std::env::var("N")
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(60);
    let cut: f64 = std::env::var("CUT")
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(90.0);
    let draws: u64 = std::env::var("DRAWS")
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(10);
    let grid = Grid {
        normals: 6 * n,
        locals: n,
    };
    for (bname, recipe) in [
        ("phong 8", PHONG_8),
        ("phong 32", PHONG_32),
        ("phong 128", PHONG_128),
        ("ggx .1", GGX_01),
        ("ggx .2", GGX_02),
        ("ggx .4", GGX_04),
        ("plastic", PLASTIC),
        ("velvet", VELVET),
    ] {
        if std::env::var("B").is_ok_and(|v| !v.split(',').any(|x| x == bname)) {
            continue;
        }
        let b = brdf(recipe);
        for (lname, light) in [
            ("suns", Light::Real(two_suns())),
            ("sky", Light::Real(sky_and_sun())),
            ("random", Light::Limited(random(16, 5))),
        ] {
            if std::env::var("L").is_ok_and(|v| v != lname) {
                continue;
            }
            for noise in [0.0001, 0.001, 0.01] {
                if std::env::var("S").is_ok_and(|v| v.parse::<f64>().unwrap_or(0.0) != noise) {
                    continue;
                }
                print!("{bname} {lname} {noise}: ");
                monte_carlo(
                    b.as_ref(),
                    &light,
                    grid,
                    noise,
                    cut,
                    draws,
                    &Options::default(),
                );
            }
        }
    }
}

/// 360 × 180 cells, 1 % noise per cell: where eq. 29 is off by 8 % or more, the factorisation is within 1 % up to p = 8.
#[test]
#[ignore = "seconds"]
fn one_per_cent_noise_leaves_one_per_cent_error_up_to_order_8() {
    let grid = Grid {
        normals: 360,
        locals: 180,
    };
    for recipe in [PHONG_32, PHONG_128] {
        for light in [Light::Real(two_suns()), Light::Limited(random(16, 7))] {
            let b = brdf(recipe);
            let clean = light.field(b.as_ref(), grid);
            let sigma = 0.01 * clean.iter().copied().fold(0.0, f64::max);
            let begun = std::time::Instant::now();
            let found = recover(
                &samples(&clean, grid, sigma, 90.0, Some(3)),
                &Options::default(),
            )
            .expect("result");
            let channel = &found.channels[0];
            let truth = light.series(8);
            println!(
                "{:?} band {} {:.4} start {:.4} eq29 {:.4} misfit {:.3} {:?}",
                begun.elapsed(),
                channel.band,
                error(&channel.lighting, &truth, 8),
                error(&channel.start, &truth, 8),
                error(&channel.ratio, &truth, 8),
                channel.misfit,
                channel.status
            );
        }
    }
}

#[test]
#[ignore = "seconds"]
fn a_near_mirror_factorises() {
    let grid = Grid {
        normals: 360,
        locals: 180,
    };
    let b = brdf("model = 'phong'\ndiffuse = 0\nspecular = 1\nexponent = 2000");
    for light in [Light::Real(two_suns()), Light::Limited(random(16, 7))] {
        let clean = light.field(b.as_ref(), grid);
        let sigma = 0.001 * clean.iter().copied().fold(0.0, f64::max);
        let begun = std::time::Instant::now();
        let found = recover(
            &samples(&clean, grid, sigma, 80.0, Some(3)),
            &Options::default(),
        )
        .expect("result");
        let channel = &found.channels[0];
        let truth = light.series(16);
        println!(
            "{:?} band {} {:.5} start {:.4} eq29 {:.4} misfit {:.3} {:?} {:?} eig {:.2?}",
            begun.elapsed(),
            channel.band,
            error(&channel.lighting, &truth, 16),
            error(&channel.start, &truth, 16),
            error(&channel.ratio, &truth, 16),
            channel.misfit,
            channel.status,
            channel.components,
            &channel.eigenvalues[..8]
        );
    }
}

#[test]
#[ignore = "seconds"]
fn lambert() {
    let grid = Grid {
        normals: 360,
        locals: 90,
    };
    let b = brdf("model = 'lambertian'\nalbedo = 0.7");
    for light in [Light::Real(two_suns()), Light::Limited(random(16, 7))] {
        let clean = light.field(b.as_ref(), grid);
        let sigma = 0.001 * clean.iter().copied().fold(0.0, f64::max);
        let found = recover(
            &samples(&clean, grid, sigma, 80.0, Some(3)),
            &Options::default(),
        )
        .expect("result");
        let channel = &found.channels[0];
        let truth = light.series(channel.band);
        println!(
            "band {} misfit {:.3} {:?} {:?} eig {:.2?}",
            channel.band,
            channel.misfit,
            channel.status,
            channel.components,
            &channel.eigenvalues[..8.min(channel.eigenvalues.len())]
        );
        for p in 1..=channel.band {
            println!(
                "{p}: {:.4} {:.4} sigma {:.4}",
                channel.lighting.coefficients[p], truth.coefficients[p], channel.sigma[p]
            );
        }
        let half = super::columns::half_circle(&samples(&clean, grid, sigma, 80.0, None)).unwrap();
        let sp = super::columns::Spectrum::fit(
            &samples(&clean, grid, sigma, 80.0, None),
            0,
            &half,
            channel.band,
        )
        .unwrap();
        let cov = super::uncertainty::bound(&sp, &half, &truth, &channel.frequencies).unwrap();
        for (i, p) in channel.frequencies.iter().enumerate().skip(1) {
            print!(
                "{p} bound {:.4} sigma {:.4} err {:.4}; ",
                (cov[(2 * i - 2, 2 * i - 2)] + cov[(2 * i - 1, 2 * i - 1)]).sqrt(),
                channel.sigma[*p],
                (channel.lighting.coefficients[*p] - truth.coefficients[*p]).norm()
            );
        }
        println!("{:#?}", found.warnings);
    }
}

/// 72 views every 5°, all columns of a cylinder seen from afar.
pub(super) fn views(
    light: &Light,
    b: &dyn Brdf,
    count: usize,
    locals: usize,
    cut: f64,
    noise: f64,
    skip: impl Fn(f64) -> bool,
    seed: u64,
) -> Samples {
    let grid = Grid {
        normals: count,
        locals,
    };
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let order = match light {
        Light::Real(_) => 0,
        Light::Limited(s) => s.order(),
    };
    let mut columns = Vec::new();
    let mut largest: f64 = 0.0;
    for j in 0..locals {
        let local = grid.local(j);
        if local.deg().abs() > cut {
            continue;
        }
        let row = crate::brdf::transfer_row(b, local, order);
        let mut column = crate::light_field::Column {
            local,
            alpha: vec![],
            view: vec![],
            value: vec![vec![]],
            variance: vec![vec![]],
        };
        for v in 0..count {
            let orbit = (1.25 + 360.0 / count as f64 * v as f64).to_radians();
            if skip(orbit) {
                continue;
            }
            let alpha = crate::angle::wrap(orbit - local.rad());
            let value = light.value(b, &row, alpha, local.rad());
            largest = largest.max(value);
            column.alpha.push(alpha);
            column.view.push(v as u32);
            column.value[0].push(value);
        }
        columns.push(column);
    }
    for c in &mut columns {
        for v in &mut c.value[0] {
            let e: f64 = StandardNormal.sample(&mut rng);
            *v += noise * largest * e;
            c.variance[0].push((noise * largest).powi(2).max(1e-12 * largest * largest));
        }
    }
    Samples {
        channels: vec!["Y".into()],
        columns,
    }
}

#[test]
#[ignore = "seconds"]
fn metal() {
    let b = brdf("model = 'ggx-conductor'\nalpha = 0.2\neta = 0.3749\nk = 2.3857");
    let light = Light::Real(two_suns());
    for (noise, cut, locals) in [
        (1e-5, 85.0, 180),
        (1e-4, 85.0, 180),
        (1e-3, 85.0, 180),
        (1e-4, 80.0, 180),
        (1e-4, 75.0, 180),
        (1e-4, 85.0, 90),
        (1e-4, 85.0, 60),
    ] {
        let begun = std::time::Instant::now();
        let s = views(&light, b.as_ref(), 72, locals, cut, noise, |_| false, 5);
        let made = begun.elapsed();
        let found = recover(&s, &Options::default()).expect("result");
        let c = &found.channels[0];
        let truth = light.series(12);
        println!(
            "noise {noise} cut {cut} locals {locals} {:?} resolved {} band {} error {:.5} start {:.4} eq29 {:.4} misfit {:.3} settled {} ",
            begun.elapsed() - made,
            c.resolved,
            c.band,
            error(&c.lighting, &truth, 12),
            error(&c.start, &truth, 12),
            error(&c.ratio, &truth, 12),
            c.misfit,
            c.converged
        );
        for p in 1..=12 {
            print!(
                "{p}:{:.4}/{:.4} ",
                (c.lighting.coefficients[p] - truth.coefficients[p]).norm(),
                c.sigma[p]
            );
        }
        println!();
    }
}
