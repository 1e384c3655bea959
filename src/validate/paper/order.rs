//! The order of light that a Phong surface lets one recover, ~ √β: measured by recovering it.

use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::{Curve, Paper, Plot};
use crate::angle::LocalAngle;
use crate::brdf::{Material, Phong, transfer_row};
use crate::error::Result;
use crate::fourier::Series;
use crate::grid::Grid;
use crate::light_field::Samples;
use crate::lighting::Lighting;
use crate::recover::lighting::{DETERMINED, Options, Regularisation, recover};
use crate::reflect::product;

const GRID: Grid = Grid {
    normals: 240,
    locals: 45,
};
/// Noise of each sample as a fraction of the light field's mean.
const NOISE: f64 = 0.2;

pub fn check(paper: &mut Paper) -> Result<()> {
    let betas: Vec<f64> = (0..=10).map(|k| f64::from(1 << k)).collect();
    let measured: Vec<(f64, f64)> = betas
        .par_iter()
        .map(|&beta| Ok((beta, recovered_order(beta)?)))
        .collect::<Result<_>>()?;
    let expected: Vec<(f64, f64)> = betas.iter().map(|&b| (b, expected_order(b))).collect();
    paper.compare(
        "§5.3",
        "the order recovered from samples with 20 % noise is where the noise reaches 5 % of L_0: σ(L_p) = σ/√(2Σ|H_p|²)",
        expected.iter().zip(&measured).map(|(e, m)| (e.1, m.1)),
        1.0,
        "one order: the bound crosses between two whole numbers, and the recovery weighs all orders together",
    );
    // Below β = 8 the tail 1/p^{2+β} of the half circle, not the lobe, carries the highest orders.
    let lobes: Vec<(f64, f64)> = measured
        .iter()
        .copied()
        .filter(|(b, _)| *b >= 8.0)
        .collect();
    let (slope, factor) = power_law(&lobes);
    paper.compare(
        "§5.3",
        "the recoverable order grows as √β: exponent of the fit over β = 8 … 1024",
        [(0.5, slope)],
        0.05,
        "whole numbers near 6 carry ±0.5, ±8 %, over a range of a factor of 11 in order",
    );
    let over_root = |points: Vec<(f64, f64)>| points.into_iter().map(|(b, p)| (b.sqrt(), p));
    let fit = betas.iter().map(|&b| (b, factor * b.powf(slope))).collect();
    paper.plots.push(Plot {
        id: "order-sqrt-beta",
        equation: "§5.3",
        title: "Recovered order against √β",
        caption: format!(
            "Light of 100 orders recovered by the program's own estimator from {} × {} samples with {} % noise each, β = 1 … 1024: \
             the largest order with σ(L_[p]) ≤ {} % of L_[0]. Fit over β ≥ 8: {factor:.2}·β^({slope:.3}).",
            GRID.normals,
            GRID.locals,
            100.0 * NOISE,
            100.0 * DETERMINED
        ),
        x: "√β",
        y: "largest determined order",
        logarithmic: [true, true],
        curves: vec![
            Curve::line("fit", over_root(fit)),
            Curve::line("expected from the noise", over_root(expected)),
            Curve::discs("recovered", over_root(measured)),
        ],
    });
    Ok(())
}

/// A Phong lobe scaled so that light of constant L = 1 gives B = 1 at normal exitance.
fn lobe(beta: f64) -> Phong {
    let unit = Phong {
        diffuse: 0.0,
        specular: 1.0,
        exponent: beta,
    };
    let white = transfer_row(&unit, LocalAngle::radians(0.0), 0)[0].re;
    Phong {
        specular: 1.0 / white,
        ..unit
    }
}

/// Simulates the light field of a light of many orders with noise, recovers the light, and counts.
fn recovered_order(beta: f64) -> Result<f64> {
    let light = Series {
        coefficients: (0..=100)
            .map(|p| match p {
                0 => Complex64::ONE,
                _ => Complex64::from_polar(0.1, f64::from(p * p)),
            })
            .collect(),
    };
    let channels = vec!["Y".to_owned()];
    let material = Material {
        channels: channels.clone(),
        brdfs: vec![std::sync::Arc::new(lobe(beta))],
    };
    let lighting = Lighting::band_limited(channels.clone(), vec![light]);
    let mut field = product::on_grid(&lighting, &material, GRID, 100)?;
    let mut random = ChaCha8Rng::seed_from_u64(beta as u64);
    for b in field.iter_mut().flatten() {
        let normal: f64 = StandardNormal.sample(&mut random);
        *b += NOISE * normal;
    }
    let variance = vec![vec![NOISE * NOISE; GRID.len()]];
    let samples = Samples::from_grid(GRID, channels, &field, &variance);
    let options = Options {
        band: None,
        regularisation: Regularisation::Evidence,
        non_negative: false,
    };
    let estimate = recover(&samples, &material, &options)?;
    let band = estimate.channels.first().and_then(|c| c.determined_band);
    Ok(band.map_or(0.0, |p| p as f64))
}

/// The last order whose σ (of the real and of the imaginary part), from the noise alone, is at most 5 % of
/// L_0.
fn expected_order(beta: f64) -> f64 {
    let columns = product::transfer_columns(&lobe(beta), GRID, 150);
    let sigma = |p: usize| {
        let energy: f64 = columns.iter().map(|row| row[p].norm_sqr()).sum();
        NOISE / (2.0 * GRID.normals as f64 * energy).sqrt()
    };
    (0..=150)
        .take_while(|&p| sigma(p) <= DETERMINED)
        .last()
        .map_or(0.0, |p| p as f64)
}

/// (exponent, factor) of y = factor · x^exponent by least squares of the logarithms.
fn power_law(points: &[(f64, f64)]) -> (f64, f64) {
    let n = points.len() as f64;
    let logs = || points.iter().map(|(x, y)| (x.ln(), y.ln()));
    let (mx, my) = logs().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (sxx, sxy) = logs().fold((0.0, 0.0), |(a, b), (x, y)| {
        (a + (x - mx).powi(2), b + (x - mx) * (y - my))
    });
    let slope = sxy / sxx;
    (slope, (my - slope * mx).exp())
}
