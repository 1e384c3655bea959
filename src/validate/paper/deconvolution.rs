//! Equation 29: light and BRDF from the light field alone, by the ratios that reciprocity allows; and
//! which coefficients those ratios cannot reach.

use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::{Curve, Double, Paper, Plot, exitant_nodes, flat_lambertian, mixed, parts, test_light};
use crate::brdf::{Brdf, Material};
use crate::error::Result;
use crate::fourier::Series;
use crate::grid::Grid;
use crate::light_field::Samples;
use crate::lighting::Lighting;
use crate::recover::factorise::{self, Options};
use crate::reflect::product;

const ORDER: i64 = 6;

pub fn check(paper: &mut Paper) -> Result<()> {
    let light = test_light();
    let field = reciprocal_field(&light, &mixed());
    paper.compare(
        "29",
        "lighting from the light field alone, q = 0: L_p/L_0 = B̃_{p,0} / B̃_{0,−p}",
        parts((1..=ORDER).map(|p| {
            let ratio = field.get(p, 0) / field.get(0, -p);
            (light.get(p) / light.get(0), ratio)
        })),
        1e-8,
        "1e-12 of B̃_{0,0} over the smallest B̃_{0,p}",
    );
    // The same with any q, for a surface with vanishing terms: those that vanish are left out.
    let floor = 1e-4 * field.get(0, 0).norm();
    let usable = field
        .indices()
        .filter(|&(p, q)| field.get(p, q).norm() > floor && field.get(-q, -p).norm() > floor);
    paper.compare(
        "29",
        "and with any other q: L_p = L_{−q} B̃_{p,q} / B̃_{−q,−p}",
        parts(usable.map(|(p, q)| {
            let ratio = light.get(-q) * field.get(p, q) / field.get(-q, -p);
            (light.get(p), ratio)
        })),
        1e-7,
        "1e-12 of B̃_{0,0} over the floor of 1e-4",
    );
    second_row(paper);

    let field = reciprocal_field(&light, &flat_lambertian());
    let lost = unreachable(&field);
    paper.compare(
        "29",
        "a Lambertian surface leaves the odd orders above 1 indeterminate, and no others (up to 6: 3 and 5)",
        [(2.0, lost.len() as f64), (3.0, first(&lost)), (5.0, last(&lost))],
        0.0,
        "orders that no chain of coefficients above 1e-9 of B̃_{0,0} ties to L_0",
    );
    let lost = unreachable(&reciprocal_field(&light, &mixed()));
    paper.compare(
        "29",
        "a Lambertian surface with a Phong lobe leaves none",
        [(0.0, lost.len() as f64)],
        0.0,
        "as above",
    );
    from_noisy_samples(paper)
}

/// Noise of each sample as a fraction of the light field's mean.
const NOISE: f64 = 1e-3;

/// The same question put to the pipeline's factorisation, which uses every coefficient, with noise.
fn from_noisy_samples(paper: &mut Paper) -> Result<()> {
    let grid = Grid {
        normals: 120,
        locals: 60,
    };
    let truth = test_light();
    let channels = vec!["Y".to_owned()];
    let lighting = Lighting::band_limited(channels.clone(), vec![truth.clone()]);
    let material = Material {
        channels: channels.clone(),
        brdfs: vec![std::sync::Arc::new(mixed())],
    };
    let mut field = product::on_grid(&lighting, &material, grid, truth.order())?;
    let mean = field.iter().flatten().sum::<f64>() / grid.len() as f64;
    let sigma = NOISE * mean;
    let mut random = ChaCha8Rng::seed_from_u64(29);
    for b in field.iter_mut().flatten() {
        let normal: f64 = StandardNormal.sample(&mut random);
        *b += sigma * normal;
    }
    let variance = vec![vec![sigma * sigma; grid.len()]];
    let samples = Samples::from_grid(grid, channels, &field, &variance);
    let options = Options {
        band: Some(truth.order()),
        ..Options::default()
    };
    let found = factorise::recover(&samples, &options)?;
    let Some(channel) = found.channels.first() else {
        return Ok(());
    };
    let stated: f64 = channel.sigma.iter().map(|s| s * s).sum::<f64>().sqrt();
    let miss = |series: &Series| {
        let order = 1..=truth.order() as i64;
        order
            .map(|p| (series.get(p) - truth.get(p) / truth.get(0)).norm_sqr())
            .sum::<f64>()
            .sqrt()
    };
    paper.compare(
        "29",
        "from samples with 0.1 % noise the pipeline's factorisation, which uses all p and q, finds L_1 … L_6 within three of its own deviations",
        [(0.0, miss(&channel.lighting))],
        3.0 * stated,
        "3 √(Σσ²): exceeded by chance at most once in 8000 draws (e⁻⁹, if one coefficient carries all of it)",
    );
    let curve = |name: &str, series: &Series| {
        let error = |p: i64| (series.get(p) - truth.get(p) / truth.get(0)).norm();
        Curve::line(
            name,
            (1..=truth.order() as i64).map(|p| (p as f64, error(p))),
        )
    };
    paper.plots.push(Plot {
        id: "factorisation",
        equation: "29",
        title: "Light from the light field alone, with noise",
        caption: format!(
            "Error of L_[p]/L_[0] from {} × {} samples with 0.1 % noise: by the ratios of eq. 29 with q = 0, by all coefficients at once, \
             and after refinement.",
            grid.normals, grid.locals
        ),
        x: "frequency p",
        y: "|error of L_[p]|/L_[0]",
        logarithmic: [false, true],
        curves: vec![
            curve("eq. 29, q = 0", &channel.ratio),
            curve("all p and q", &channel.start),
            curve("refined", &channel.lighting),
        ],
    });
    Ok(())
}

/// If B̃_{p,0} vanishes for some p because the light has no such frequency in row 0's partner, another row
/// serves: light without its mean (B̃_{0,q} = 0) is recovered from the row q = −1.
fn second_row(paper: &mut Paper) {
    let mut light = test_light();
    light.coefficients[0] = Complex64::ZERO;
    let field = reciprocal_field(&light, &mixed());
    paper.compare(
        "29",
        "with L_0 = 0 the row q = 0 says nothing (B̃_{0,p} = 0); q = −1 gives L_p/L_1 = B̃_{p,−1} / B̃_{1,−p}",
        parts((2..=ORDER).map(|p| {
            let ratio = field.get(p, -1) / field.get(1, -p);
            (light.get(p) / light.get(1), ratio)
        }))
        .into_iter()
        .chain((1..=ORDER).map(|p| (0.0, field.get(0, p).norm()))),
        1e-8,
        "1e-12 of B̃_{1,1} over the smallest B̃_{1,p}",
    );
    let found = |p: i64| field.get(p, -1) / field.get(1, -p);
    let planted = |p: i64| light.get(p) / light.get(1);
    paper.plots.push(Plot {
        id: "other-row",
        equation: "29",
        title: "Where q = 0 says nothing",
        caption: "Light without its mean: all B̃_[0,p] vanish, and with them the ratios for q = 0. Those for q = −1 give the light all the same."
            .into(),
        x: "frequency p",
        y: "|L_[p]/L_[1]|",
        logarithmic: [false, false],
        curves: vec![
            Curve::line("planted", (1..=ORDER).map(|p| (p as f64, planted(p).norm()))),
            Curve::discs("found with q = −1", (1..=ORDER).map(|p| (p as f64, found(p).norm()))),
        ],
    });
}

/// B̃_{p,q} by the product form.
fn reciprocal_field(light: &Series, brdf: &dyn Brdf) -> Double {
    let nodes = exitant_nodes(brdf);
    let rows: Vec<Vec<Complex64>> = nodes
        .iter()
        .map(|&(local, _)| {
            let b = product::column_series(light, brdf, local);
            (-ORDER..=ORDER)
                .map(|p| b.get(p) * local.rad().cos())
                .collect()
        })
        .collect();
    Double::from_rows(ORDER, &nodes, &rows)
}

/// The orders |p| that are not tied to order 0 by coefficients B̃_{p,q} that do not vanish.
fn unreachable(field: &Double) -> Vec<i64> {
    let floor = 1e-9 * field.get(0, 0).norm();
    let mut reached = vec![false; ORDER as usize + 1];
    reached[0] = true;
    for _ in 0..=ORDER {
        for (p, q) in field.indices() {
            let (a, b) = (p.unsigned_abs() as usize, q.unsigned_abs() as usize);
            if field.get(p, q).norm() > floor && (reached[a] || reached[b]) {
                (reached[a], reached[b]) = (true, true);
            }
        }
    }
    (0..=ORDER).filter(|&p| !reached[p as usize]).collect()
}

fn first(orders: &[i64]) -> f64 {
    orders.first().map_or(f64::NAN, |&p| p as f64)
}

fn last(orders: &[i64]) -> f64 {
    orders.last().map_or(f64::NAN, |&p| p as f64)
}
