//! What the BRDF from known light costs: a 180 × 180 half grid from a light field of 360 × 180 with the noise of a good capture.
//!
//! Run with `cargo bench --bench brdf`. Times depend on the machine and on what else it does.

use std::cell::LazyCell;
use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use flatlight::angle::WorldAngle;
use flatlight::brdf::{Material, Model};
use flatlight::grid::Grid;
use flatlight::light_field::Samples;
use flatlight::lighting::{Lighting, Source};
use flatlight::recover::brdf::{Options, recover};
use flatlight::reflect;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const GRID: Grid = Grid {
    normals: 360,
    locals: 180,
};

/// Noise of each sample, of the largest radiance.
const NOISE: f64 = 1e-3;

fn names() -> Vec<String> {
    vec!["Y".to_owned()]
}

fn source(deg: f64, irradiance: f64) -> Source {
    Source {
        theta: WorldAngle::degrees(deg),
        irradiance: vec![irradiance],
    }
}

fn one_source() -> Lighting {
    Lighting::from_sources(names(), vec![source(37.3, 3.0)])
}

fn two_suns_and_fill() -> Lighting {
    let mut light = Lighting::from_sources(names(), vec![source(37.3, 3.0), source(-104.6, 1.1)]);
    light.table = vec![vec![0.04]];
    light
}

/// A room every half degree: uneven walls, a window and two lamps of some degrees.
fn environment() -> Lighting {
    let table = (0..720)
        .map(|i| {
            let deg = -180.0 + 0.5 * f64::from(i);
            let rad = deg.to_radians();
            let walls = 0.1 + 0.04 * (rad - 0.7).cos() + 0.02 * (5.0 * rad).sin();
            let window = if (20.0..44.0).contains(&deg) {
                2.5
            } else {
                0.0
            };
            let lamp = |at: f64, width: f64| if (deg - at).abs() < width { 30.0 } else { 0.0 };
            walls + window + lamp(-101.0, 1.0) + lamp(140.0, 1.5)
        })
        .collect();
    Lighting {
        channels: names(),
        table: vec![table],
        ..Lighting::default()
    }
}

fn phong(exponent: f64) -> Material {
    let table = format!("model = 'phong'\ndiffuse = 0.3\nspecular = 0.4\nexponent = {exponent}");
    Model::from_table(&table.parse().expect("TOML"))
        .and_then(|model| model.material(&names(), Path::new("")))
        .expect("a material")
}

/// The light field with its noise, seen up to 80°.
fn samples(light: &Lighting, material: &Material) -> Samples {
    let mut field = reflect::integral::on_grid(light, material, GRID)
        .expect("a light field")
        .remove(0);
    let sigma = NOISE * field.iter().fold(0.0f64, |a, b| a.max(*b));
    let mut rng = ChaCha8Rng::seed_from_u64(180);
    for value in &mut field {
        let z: f64 = StandardNormal.sample(&mut rng);
        *value += sigma * z;
    }
    let variance = (0..GRID.len())
        .map(|k| match GRID.local(k % GRID.locals).deg().abs() {
            b if b < 80.0 => sigma * sigma,
            _ => f64::INFINITY,
        })
        .collect();
    Samples::from_grid(GRID, names(), &[field], &[variance])
}

fn half_grid(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("BRDF on a 180 x 180 half grid, one channel");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(10));
    let options = Options::default();
    for (name, light) in [
        ("one source", one_source()),
        ("two suns and a fill", two_suns_and_fill()),
        ("environment", environment()),
    ] {
        // The first is held by the splines as they are, the second wants finer ones.
        for exponent in [32.0, 128.0] {
            let samples = LazyCell::new(|| samples(&light, &phong(exponent)));
            group.bench_function(format!("{name}, Phong {exponent}"), |b| {
                let samples = &*samples;
                b.iter(|| recover(black_box(samples), &light, &options).expect("a slice"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, half_grid);
criterion_main!(benches);
