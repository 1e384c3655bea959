//! Prefiltering a planar environment of 1024 values for a smooth BRDF at 1e-3, against the angular
//! integral with one term per value, both on one core.

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
    // The integral of one column of constant θo′ stands for all.
    let column = || {
        let local = GRID.local(GRID.locals / 3);
        (0..GRID.normals)
            .map(|i| integral::sum(&light, 0, &brdf, GRID.normal(i), local, VALUES))
            .sum::<f64>()
    };
    criterion.bench_function("prefilter, all columns", |b| b.iter(|| black_box(table())));
    criterion.bench_function("angular integral, one column", |b| {
        b.iter(|| black_box(column()));
    });
    let timed = |work: &dyn Fn()| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    };
    let fast = timed(&|| drop(black_box(table())));
    let slow = GRID.locals as f64
        * timed(&|| {
            black_box(column());
        });
    println!(
        "a single run of each: {fast:.4} s against {slow:.2} s, {:.0} times faster",
        slow / fast
    );
}

criterion_group!(benches, prefiltering);
criterion_main!(benches);
