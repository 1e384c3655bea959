//! Prefiltering a planar environment of 1024 values for a smooth BRDF at 1e-3, against the angular integral
//! with one term per value in every cell of the same table, both on one core.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use flatlight::Grid;
use flatlight::brdf::{Material, Phong};
use flatlight::lighting::Lighting;
use flatlight::reflect::integral;
use flatlight::reflect::prefilter::{Options, prefilter};

const GRID: Grid = Grid {
    normals: 1024,
    locals: 180,
};
const VALUES: usize = 1024;

/// A bright half, a dark half, windows and a fine texture.
fn environment() -> Lighting {
    let value = |i: usize| {
        let theta = TAU * i as f64 / VALUES as f64;
        let windows = if (128..256).contains(&i) && (i / 9).is_multiple_of(3) {
            2.5
        } else {
            1.0
        };
        windows * (1.0 + 0.6 * theta.sin() + 0.05 * (377.0 * theta).cos())
    };
    Lighting {
        channels: vec!["Y".into()],
        table: vec![(0..VALUES).map(value).collect()],
        ..Lighting::default()
    }
}

fn prefiltering(criterion: &mut Criterion) {
    let light = environment();
    let brdf = Phong {
        diffuse: 0.3,
        specular: 0.4,
        exponent: 32.0,
    };
    let material = Material {
        channels: light.channels.clone(),
        brdfs: vec![Arc::new(brdf)],
    };
    let Ok(one_core) = rayon::ThreadPoolBuilder::new().num_threads(1).build() else {
        return;
    };
    let table = || one_core.install(|| prefilter(&light, &material, GRID, &Options::default()));
    criterion.bench_function("prefilter", |b| b.iter(|| black_box(table())));

    // The integral over the whole table: one term for each value of the light above the horizon.
    let transfer =
        |i: usize, j: usize| integral::sum(&light, 0, &brdf, GRID.normal(i), GRID.local(j), VALUES);
    let start = Instant::now();
    let slow: Vec<f64> = (0..GRID.len())
        .map(|cell| transfer(cell / GRID.locals, cell % GRID.locals))
        .collect();
    let integral = start.elapsed().as_secs_f64();
    let runs = 20;
    let start = Instant::now();
    let made = (0..runs)
        .map(|_| black_box(table()))
        .fold(None, |_, made| made.ok());
    let prefilter = start.elapsed().as_secs_f64() / f64::from(runs);
    let Some(made) = made else { return };
    let difference = made.value[0]
        .iter()
        .zip(&slow)
        .fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
    let choice = &made.choices[0];
    println!(
        "{} × {} cells: prefilter {prefilter:.4} s ({} coefficients, stated error {:.1e}), angular integral {integral:.2} s, {:.0} times; they differ by {:.1e} of the level",
        GRID.normals,
        GRID.locals,
        choice.coefficients(),
        choice.bound,
        integral / prefilter,
        difference / choice.level
    );
}

criterion_group!(benches, prefiltering);
criterion_main!(benches);
