//! What it costs to find lighting and BRDF at once, at real sizes: three channels, start and refinement, error bars.
//!
//! Run with `cargo bench --bench factorise`. Times depend on the machine and on what else it does.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use flatlight::angle::{NormalAngle, WorldAngle, wrap};
use flatlight::brdf::{Material, Model};
use flatlight::grid::Grid;
use flatlight::light_field::{Column, Samples};
use flatlight::lighting::{Lighting, Source};
use flatlight::recover::factorise::{Options, recover};
use flatlight::reflect;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Noise relative to the largest value.
const NOISE: f64 = 1e-3;

fn names() -> Vec<String> {
    ["R", "G", "B"].map(String::from).to_vec()
}

fn light() -> Lighting {
    let sources = [(37.3, [3.0, 2.9, 2.7]), (-104.6, [1.1, 1.3, 1.7])]
        .map(|(deg, e)| Source {
            theta: WorldAngle::degrees(deg),
            irradiance: e.to_vec(),
        })
        .to_vec();
    Lighting::from_sources(names(), sources)
        .plus(&Lighting::uniform(names(), &[0.04, 0.045, 0.055]))
}

fn gold() -> Material {
    let text = "model = 'ggx-conductor'\nalpha = 0.2\neta = [0.1431, 0.3749, 1.4424]\nk = [3.9831, 2.3857, 1.6032]";
    Model::from_table(&text.parse().expect("TOML"))
        .and_then(|m| m.material(&names(), std::path::Path::new(".")))
        .expect("gold")
}

/// Gold under two suns and a fill as `views` even views of a distant cylinder see it, in the columns of 1° within `cut` degrees.
fn samples(views: usize, cut: f64) -> Samples {
    let (light, gold) = (light(), gold());
    let grid = Grid {
        normals: 1,
        locals: 180,
    };
    let mut columns: Vec<Column> = (0..grid.locals)
        .map(|j| grid.local(j))
        .filter(|local| local.deg().abs() <= cut)
        .map(|local| {
            let orbit =
                |v: usize| 1.25f64.to_radians() + std::f64::consts::TAU * v as f64 / views as f64;
            let alpha: Vec<f64> = (0..views).map(|v| wrap(orbit(v) - local.rad())).collect();
            let places: Vec<_> = alpha
                .iter()
                .map(|a| (NormalAngle::radians(*a), local))
                .collect();
            let value = reflect::product::at(&light, &gold, &places, 0).expect("a light field");
            Column {
                local,
                view: (0..views as u32).collect(),
                variance: vec![Vec::new(); 3],
                value,
                alpha,
            }
        })
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for c in 0..3 {
        let values = columns.iter().flat_map(|column| column.value[c].iter());
        let sigma = NOISE * values.fold(0.0f64, |a, b| a.max(*b));
        for column in &mut columns {
            for v in &mut column.value[c] {
                let e: f64 = StandardNormal.sample(&mut rng);
                *v += sigma * e;
            }
            column.variance[c] = vec![sigma * sigma; column.alpha.len()];
        }
    }
    Samples {
        channels: names(),
        columns,
    }
}

/// Three channels of 72 and of 360 views, 168 columns; 5 s are asked for on two cores.
fn factorisation(c: &mut Criterion) {
    for views in [72, 360] {
        let samples = samples(views, 84.0);
        c.bench_function(&format!("factorisation, 3 channels, {views} views"), |b| {
            b.iter(|| recover(black_box(&samples), &Options::default()).expect("a factorisation"))
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).measurement_time(Duration::from_secs(20));
    targets = factorisation
}
criterion_main!(benches);
