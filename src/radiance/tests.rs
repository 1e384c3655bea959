//! Planted radiance through a simulated sensor and back.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal, Poisson};

use super::*;
use crate::angle::WorldAngle;
use crate::capture::*;

const WIDTH: usize = 640;
const HEIGHT: usize = 24;

/// Radiance that runs over 2.5 decades, smooth but for one sharp edge.
fn truth(x: usize) -> f64 {
    let u = x as f64 / WIDTH as f64;
    let lobe = (-((u - 0.3) / 0.05).powi(2)).exp();
    0.01 + 0.1 * u + 3.0 * lobe + if u > 0.7 { 0.3 } else { 0.0 }
}

fn capture(folder: &Path, sensor: Sensor, photos: Vec<Photo>) -> Capture {
    Capture {
        name: "test".into(),
        folder: folder.to_path_buf(),
        object: Object {
            shape: Shape::Cylinder,
            radius: 0.05,
            mask: None,
        },
        camera: Camera {
            projection: Projection::Perspective { focal_px: 1000.0 },
            image_size: [WIDTH as u32, HEIGHT as u32],
            principal_point_px: [WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0],
            distortion: [0.0; 5],
            distance: 1.0,
            orbit_sigma_deg: 0.0,
        },
        sensor,
        views: vec![View {
            orbit: WorldAngle::degrees(0.0),
            photos,
            plane_roll: 0.0,
            mask: None,
            outline: None,
        }],
    }
}

fn write_y(path: &Path, value: impl Fn(usize, usize) -> f32 + Sync) {
    use exr::prelude::*;
    let channels = SpecificChannels::build()
        .with_channel("Y")
        .with_pixel_fn(|p: Vec2<usize>| (value(p.0, p.1),));
    Image::from_channels((WIDTH, HEIGHT), channels)
        .write()
        .to_file(path)
        .unwrap();
}

/// A sensor with 12 bits, 12,000 electrons full well, black at 64; clipped, rounded.
fn expose(path: &Path, seconds: f64, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let per_code = 12_000.0 / (4095.0 - 64.0);
    let read = Normal::new(0.0, 5.0).unwrap();
    let mut codes = vec![0.0; WIDTH * HEIGHT];
    for (i, code) in codes.iter_mut().enumerate() {
        // 12,000 electrons are a radiance of 1 in one second.
        let electrons = truth(i % WIDTH) * seconds * 12_000.0;
        let shot: f64 = Poisson::new(electrons).unwrap().sample(&mut random);
        let measured = shot + read.sample(&mut random);
        *code = (64.0 + measured / per_code).round().clamp(0.0, 4095.0) as f32;
    }
    write_y(path, |x, y| codes[y * WIDTH + x]);
}

fn sensor() -> Sensor {
    Sensor {
        encoding: Some(Encoding::Linear),
        black_level: Some(64.0),
        white_level: Some(4095.0),
        full_well_e: Some(12_000.0),
        read_noise_e: Some(5.0),
        responsivity: Some(12_000.0),
        ..Sensor::default()
    }
}

/// Five exposures a factor of 4 apart, `errors` being what the times are really multiplied by.
fn bracket(folder: &Path, sensor: Sensor, errors: [f64; 5], seed: u64) -> Radiance {
    let photos = errors
        .iter()
        .enumerate()
        .map(|(i, error)| {
            let seconds = 0.0625 * 4_f64.powi(i as i32);
            let name = format!("{i}.exr");
            expose(&folder.join(&name), seconds * error, seed * 10 + i as u64);
            Photo {
                file: name.into(),
                exposure_s: Some(seconds),
            }
        })
        .collect();
    view(&capture(folder, sensor, photos), 0, 0..HEIGHT as u32).unwrap()
}

/// Worst bias in ten parts of the range, overall bias, rms z-score, share of missing pixels.
fn score(radiances: &[Radiance]) -> (f64, f64, f64, f64) {
    let mut parts = vec![Vec::new(); 10];
    let mut all = Vec::new();
    let (mut squares, mut missing) = (0.0, 0);
    for radiance in radiances {
        for (i, (&value, &variance)) in radiance.value[0]
            .iter()
            .zip(&radiance.variance[0])
            .enumerate()
        {
            let truth = truth(i % WIDTH);
            if variance.is_infinite() {
                missing += 1;
                continue;
            }
            let error = f64::from(value) - truth;
            squares += error * error / f64::from(variance);
            all.push(error / truth);
            parts[((truth / 0.01).log10() * 4.0) as usize % 10].push(error / truth);
        }
    }
    let mean = |v: &Vec<f64>| v.iter().sum::<f64>() / v.len() as f64;
    let worst = parts
        .iter()
        .filter(|p| p.len() > 5000)
        .map(|p| mean(p).abs())
        .fold(0.0, f64::max);
    let total = (WIDTH * HEIGHT * radiances.len()) as f64;
    (
        worst,
        mean(&all),
        (squares / all.len() as f64).sqrt(),
        f64::from(missing) / total,
    )
}

#[test]
fn a_bracket_gives_unbiased_radiance_and_its_true_variance() {
    let folder = tempfile::tempdir().unwrap();
    let draws: Vec<Radiance> = (0..4)
        .map(|seed| bracket(folder.path(), sensor(), [1.0; 5], seed))
        .collect();
    let (worst, bias, z, missing) = score(&draws);
    eprintln!("worst {worst:.5} bias {bias:.5} z {z:.4} missing {missing:.4}");
    // With ≥ 5000 pixels per part, each with σ below 10 %, the mean is known to 0.15 % or better.
    assert!(bias.abs() < 0.001 && worst < 0.003, "{bias} {worst}");
    // The rms of 60,000 unit normals is 1 ± 0.003; models of clipping and rounding add a little.
    assert!((z - 1.0).abs() < 0.03, "{z}");
    // The shortest exposure holds radiances up to 16.
    assert_eq!(missing, 0.0);
}
