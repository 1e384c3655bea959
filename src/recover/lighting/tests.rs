//! Planted lights, recovered.

use std::sync::Arc;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::angle::WorldAngle;
use crate::brdf::Phong;
use crate::grid::Grid;
use crate::lighting::{Lighting, Source};
use crate::reflect;

fn phong(exponent: f64) -> Arc<dyn Brdf> {
    Arc::new(Phong {
        diffuse: 0.3,
        specular: 0.4,
        exponent,
    })
}

fn material(brdf: Arc<dyn Brdf>) -> Material {
    Material {
        channels: vec!["Y".into()],
        brdfs: vec![brdf],
    }
}

/// 72 views, columns of 2°, |θo′| ≤ 80°, noise of `sigma` times the largest value.
fn samples(lighting: &Lighting, material: &Material, sigma: f64, seed: u64) -> Samples {
    let grid = Grid {
        normals: 72,
        locals: 90,
    };
    let field = reflect::integral::on_grid(lighting, material, grid).expect("forward");
    let largest = field[0].iter().fold(0.0f64, |a, b| a.max(*b));
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut value = field[0].clone();
    for v in &mut value {
        let z: f64 = StandardNormal.sample(&mut random);
        *v += sigma * largest * z;
    }
    let variance = (0..grid.len())
        .map(|k| {
            if grid.local(k % grid.locals).deg().abs() > 80.0 {
                f64::INFINITY
            } else {
                (sigma * largest).powi(2)
            }
        })
        .collect();
    Samples::from_grid(grid, vec!["Y".into()], &[value], &[variance])
}

fn options() -> Options {
    Options {
        band: None,
        regularisation: Regularisation::Evidence,
        non_negative: true,
    }
}

fn suns(list: &[(f64, f64)], fill: f64) -> Lighting {
    let sources = list
        .iter()
        .map(|&(theta, e)| Source {
            theta: WorldAngle::degrees(theta),
            irradiance: vec![e],
        })
        .collect();
    let mut lighting = Lighting::uniform(vec!["Y".into()], &[fill]);
    lighting.sources = sources;
    lighting
}

#[test]
fn one_sun_is_one_source() {
    for (seed, sigma) in [(1, 1e-4), (2, 1e-3), (3, 1e-2)] {
        let material = material(phong(32.0));
        let samples = samples(&suns(&[(37.3, 3.0)], 0.0), &material, sigma, seed);
        let found = recover(&samples, &material, &options()).expect("recovers");
        for s in &found.sources {
            println!(
                "{sigma} {} ± {} E {} ± {}",
                s.theta_deg, s.theta_sigma_deg, s.irradiance[0], s.irradiance_sigma[0]
            );
        }
        println!(
            "chi2 {} {:?}",
            found.channels[0].chi2, found.channels[0].regularisation
        );
        assert_eq!(found.sources.len(), 1);
    }
}

#[test]
fn the_intervals_of_a_source_cover_it() {
    let material = material(phong(32.0));
    // The faint noise is far below what the sun leaves unexplained where light is taken for smooth.
    for sigma in [2e-4, 1e-2] {
        let (mut direction, mut irradiance) = (0.0, 0.0);
        let draws = 60;
        for seed in 0..draws {
            let samples = samples(&suns(&[(37.3, 3.0)], 0.04), &material, sigma, 100 + seed);
            let found = recover(&samples, &material, &options()).expect("recovers");
            assert_eq!(found.sources.len(), 1);
            let s = &found.sources[0];
            direction += ((s.theta_deg - 37.3) / s.theta_sigma_deg).powi(2);
            irradiance += ((s.irradiance[0] - 3.0) / s.irradiance_sigma[0]).powi(2);
        }
        // The root mean square of 60 normal deviates is 1 ± 0.09; three of those.
        for z in [direction, irradiance] {
            let rms = (z / draws as f64).sqrt();
            assert!((0.73..1.27).contains(&rms), "noise {sigma}: {rms}");
        }
    }
}

#[test]
fn the_variance_of_the_light_is_that_of_its_unknowns() {
    let order = 7;
    let n = 2 * order + 1;
    let factor = Mat::from_fn(n, n, |i, j| ((i * 5 + j * 3) as f64 * 0.7).sin());
    let covariance = &factor * factor.transpose();
    let m = 24;
    let synthesis = synthesis_matrix(order, m);
    let dense = &synthesis * &covariance * synthesis.transpose();
    let found = CircleTransform::new(m, -PI).synthesise(&variance_series(&covariance, order));
    for (k, v) in found.iter().enumerate() {
        // Rounding of 15² products of a few units.
        assert!((v - dense[(k, k)]).abs() < 1e-10, "{k}: {v}");
    }
}
