//! What the stages of the main job cost, at real sizes.
//!
//! Run with `cargo bench`. Times depend on the machine and on what else it does.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use flatlight::angle::{LocalAngle, WorldAngle};
use flatlight::brdf::{Material, Model};
use flatlight::capture::{Camera, Capture, Object, Projection, Shape};
use flatlight::fourier::Series;
use flatlight::geometry::outline::{Search, find};
use flatlight::geometry::{CameraModel, Pose, ViewGeometry};
use flatlight::grid::Grid;
use flatlight::light_field::{Gathered, MeasuredLine, Samples, gather, grid};
use flatlight::lighting::Lighting;
use flatlight::pipeline::{Folder, Recipe, Silent, execute};
use flatlight::radiance::Radiance;
use flatlight::recover::lighting::{Options, Regularisation, recover};
use flatlight::{reflect, report};
use num_complex::Complex64;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const SIZE: [u32; 2] = [960, 240];
const CHANNELS: [&str; 3] = ["R", "G", "B"];

fn names() -> Vec<String> {
    CHANNELS.map(String::from).to_vec()
}

fn camera() -> Camera {
    Camera {
        projection: Projection::Perspective { focal_px: 4879.0 },
        image_size: SIZE,
        principal_point_px: [480.0, 120.0],
        distortion: [0.0; 5],
        distance: 0.6,
        orbit_sigma_deg: 0.0,
    }
}

fn object() -> Object {
    Object {
        shape: Shape::Cylinder,
        radius: 0.05,
        mask: None,
    }
}

/// A cylinder before black, brightest at θo′ = 0.6, pixels averaged over eight rays.
fn photo() -> Radiance {
    let (camera, object) = (camera(), object());
    let row: Vec<f32> = (0..SIZE[0])
        .map(|column| {
            let rays = (0..8).map(|k| f64::from(column) + (f64::from(k) + 0.5) / 8.0);
            let sum: f64 = rays
                .map(|x| {
                    let sine = ((x - 480.0) / 4879.0).atan().sin() * camera.distance;
                    let local = (sine / object.radius).asin();
                    if local.is_nan() {
                        0.0
                    } else {
                        0.2 + (local - 0.6).cos().max(0.0)
                    }
                })
                .sum();
            (sum / 8.0) as f32
        })
        .collect();
    let plane: Vec<f32> = row.repeat(SIZE[1] as usize);
    Radiance {
        size: SIZE,
        rows: 0..SIZE[1],
        channels: names(),
        variance: vec![vec![1e-8; plane.len()]; 3],
        value: vec![plane; 3],
        shared: Vec::new(),
        noise_known: true,
    }
}

fn outline(criterion: &mut Criterion) {
    let (photo, object) = (photo(), object());
    let camera = CameraModel::new(&camera()).expect("a camera");
    criterion.bench_function("outline of a 960 x 240 view", |b| {
        b.iter(|| find(black_box(&photo), &camera, &object, Search::default()).expect("found"));
    });
}

fn light_field(criterion: &mut Criterion) {
    let photo = photo();
    let camera = CameraModel::new(&camera()).expect("a camera");
    let geometry = ViewGeometry::new(&camera, &object(), Pose::nominal(), 0.0);
    criterion.bench_function("line of a 960 x 240 view, 41 rows averaged", |b| {
        b.iter(|| MeasuredLine::read(black_box(&photo), &geometry, 20.0).expect("a line"));
    });
    let line = MeasuredLine::read(&photo, &geometry, 20.0).expect("a line");
    let size = Grid {
        normals: 720,
        locals: 180,
    };
    let locals: Vec<LocalAngle> = (0..size.locals).map(|j| size.local(j)).collect();
    criterion.bench_function("light field 720 x 180 from 72 lines, 3 channels", |b| {
        b.iter(|| {
            let views: Vec<_> = (0..72)
                .map(|k| {
                    let orbit = WorldAngle::degrees(5.0 * f64::from(k));
                    line.samples(
                        &geometry,
                        orbit,
                        &locals,
                        size.local_step(),
                        80f64.to_radians(),
                    )
                })
                .collect();
            let Gathered {
                samples, pixels, ..
            } = gather(names(), &locals, &views, &[1e-5; 72]);
            grid(&samples, size, &pixels)
        });
    });
}

fn phong32() -> Material {
    let table = "model = 'phong'\ndiffuse = 0.3\nspecular = 0.4\nexponent = 32";
    let model = Model::from_table(&table.parse().expect("TOML")).expect("a model");
    model
        .material(&["Y".into()], Path::new(""))
        .expect("a material")
}

/// A full 720 × 180 light field under random light of order 16, with noise of 0.1 % of its maximum.
fn full_light_field(material: &Material) -> Samples {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut light = Series::zero(16);
    light.coefficients[0] = Complex64::ONE;
    for (p, l) in light.coefficients.iter_mut().enumerate().skip(1) {
        let (re, im): (f64, f64) = (random.sample(StandardNormal), random.sample(StandardNormal));
        *l = 0.2 * Complex64::new(re, im) / (p as f64).sqrt();
    }
    let size = Grid {
        normals: 720,
        locals: 180,
    };
    let lighting = Lighting::band_limited(vec!["Y".into()], vec![light]);
    let mut value =
        reflect::product::on_grid(&lighting, material, size, 16).expect("a light field");
    let largest = value[0].iter().fold(0.0f64, |a, v| a.max(*v));
    for v in &mut value[0] {
        let noise: f64 = random.sample(StandardNormal);
        *v += 1e-3 * largest * noise;
    }
    let variance = vec![vec![(1e-3 * largest).powi(2); size.len()]];
    Samples::from_grid(size, vec!["Y".into()], &value, &variance)
}

fn recovery(criterion: &mut Criterion) {
    let material = phong32();
    let samples = full_light_field(&material);
    for (name, non_negative) in [("any sign", false), ("non-negative", true)] {
        let options = Options {
            band: Some(60),
            regularisation: Regularisation::Evidence,
            non_negative,
        };
        let id = format!("lighting of order 60 from 720 x 180, {name}");
        criterion.bench_function(&id, |b| {
            b.iter(|| recover(black_box(&samples), &material, &options).expect("recovered"));
        });
    }
}

fn whole_run(criterion: &mut Criterion) {
    let set: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/phong32-two-suns");
    let recipe = Recipe::read(&set.join("recipe.toml")).expect("a recipe");
    let out = std::env::temp_dir().join(format!("flatlight-bench-{}", std::process::id()));
    let mut group = criterion.benchmark_group("whole run");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(8));
    group.bench_function("72 views of 480 x 24, report and products written", |b| {
        b.iter(|| {
            let capture = Capture::read(&set).expect("a capture");
            let run = execute(&recipe, &capture, &Silent).expect("a run");
            let page = report::page(&run).expect("a page");
            Folder::new(&out).write(&run, &page).expect("written");
        });
    });
    group.finish();
    std::fs::remove_dir_all(&out).expect("the folder was written");
}

criterion_group!(benches, outline, light_field, recovery, whole_run);
criterion_main!(benches);
