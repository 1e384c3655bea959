//! Planted radiance through a simulated sensor and back.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal, Poisson};

use super::*;
use crate::angle::WorldAngle;
use crate::capture::{Camera, Capture, Encoding, Object, Photo, Projection, Sensor, Shape, View};

const WIDTH: usize = 640;
const HEIGHT: usize = 24;

/// Radiance that runs over 2.5 decades, smooth but for one sharp edge.
fn truth(x: usize) -> f64 {
    truth_at(x as f64)
}

fn truth_at(x: f64) -> f64 {
    let u = x / WIDTH as f64;
    let lobe = (-((u - 0.3) / 0.05).powi(2)).exp();
    // A lens spreads an edge over a pixel or two.
    let edge = 1.0 / (1.0 + ((448.0 - x) / 0.7).exp());
    0.01 + 0.1 * u + 3.0 * lobe + 0.3 * edge
}

fn capture(folder: &Path, sensor: Sensor, photos: Vec<Photo>) -> Capture {
    capture_of(folder, [WIDTH as u32, HEIGHT as u32], sensor, photos)
}

/// One view of a cylinder.
pub(super) fn capture_of(
    folder: &Path,
    image_size: [u32; 2],
    sensor: Sensor,
    photos: Vec<Photo>,
) -> Capture {
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
            image_size,
            principal_point_px: image_size.map(|n| f64::from(n) / 2.0),
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
    // With ≥ 5000 pixels per part, each with σ below 10 %, the mean is known to 0.15 % or better.
    assert!(bias.abs() < 0.001 && worst < 0.003, "{bias} {worst}");
    // The rms of 60,000 unit normals is 1 ± 0.003; models of clipping and rounding add a little.
    assert!((z - 1.0).abs() < 0.03, "{z}");
    // The shortest exposure holds radiances up to 16.
    assert_eq!(missing, 0.0);
}

/// What each exposure time is really multiplied by; the mean of the logarithms is 0.
fn jitter() -> [f64; 5] {
    let logs = [0.02, -0.03, 0.015, 0.01, -0.015_f64];
    logs.map(f64::exp)
}

#[test]
fn wrong_exposure_times_are_solved_for() {
    let folder = tempfile::tempdir().unwrap();
    let draws = [bracket(folder.path(), sensor(), jitter(), 1)];
    let (worst, bias, z, _) = score(&draws);
    // Ratios from about 15,000 shared pixels of 1 to 5 % noise are known to 0.05 %.
    assert!(bias.abs() < 0.001 && worst < 0.003, "{bias} {worst}");
    assert!((z - 1.0).abs() < 0.05, "{z}");
}

#[test]
fn swapped_exposures_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut photos = Vec::new();
    for (i, (real, stated)) in [(0.25, 1.0), (1.0, 0.25)].into_iter().enumerate() {
        let name = format!("{i}.exr");
        expose(&folder.path().join(&name), real, i as u64);
        photos.push(Photo {
            file: name.into(),
            exposure_s: Some(stated),
        });
    }
    let capture = capture(folder.path(), sensor(), photos);
    let error = view(&capture, 0, 0..HEIGHT as u32).unwrap_err().to_string();
    assert!(
        error.contains("view 0")
            && error.contains("exposure_s")
            && error.contains("0.06 times the light per second"),
        "{error}"
    );
}

#[test]
fn the_noise_is_estimated_from_the_brackets() {
    let folder = tempfile::tempdir().unwrap();
    let unknown = Sensor {
        full_well_e: None,
        read_noise_e: None,
        responsivity: None,
        ..sensor()
    };
    let per_code = 12_000.0 / (4095.0 - 64.0);
    let mut draws = Vec::new();
    for seed in 0..2 {
        let mut radiance = bracket(folder.path(), unknown.clone(), [1.0; 5], seed);
        assert!(radiance.noise_known);
        // Codes per second back to units of radiance.
        let unit = (per_code / 12_000.0) as f32;
        radiance.value[0].iter_mut().for_each(|v| *v *= unit);
        radiance.variance[0]
            .iter_mut()
            .for_each(|v| *v *= unit * unit);
        draws.push(radiance);
    }
    let (worst, bias, z, _) = score(&draws);
    assert!(bias.abs() < 0.001 && worst < 0.003, "{bias} {worst}");
    // A hundred bins of 512 give each coefficient to 1 or 2 %; the stated σ is wanted within 10 %.
    assert!((z - 1.0).abs() < 0.1, "{z}");
}

#[test]
fn one_photo_is_unbiased_up_to_clipping_and_missing_beyond() {
    let folder = tempfile::tempdir().unwrap();
    let mut errors = Vec::new();
    for seed in 0..4 {
        expose(&folder.path().join("a.exr"), 0.5, seed);
        let photo = Photo {
            file: "a.exr".into(),
            exposure_s: Some(0.5),
        };
        let radiance = view(
            &capture(folder.path(), sensor(), vec![photo]),
            0,
            0..HEIGHT as u32,
        )
        .unwrap();
        for (i, (&value, &variance)) in radiance.value[0]
            .iter()
            .zip(&radiance.variance[0])
            .enumerate()
        {
            let truth = truth(i % WIDTH);
            // The well is full at a radiance of 2; its shot noise is 0.018, so five σ are 0.09.
            if truth > 2.09 {
                assert!(variance.is_infinite(), "{truth} {value}");
            } else if truth < 1.9 {
                assert!(variance.is_finite());
            }
            if variance.is_finite() && truth > 1.6 {
                errors.push(f64::from(value) / truth - 1.0);
            }
        }
    }
    let bias = errors.iter().sum::<f64>() / errors.len() as f64;
    // 1 % noise over more than 500 pixels: the mean is known to 0.04 %.
    assert!(
        errors.len() > 500 && bias.abs() < 0.001,
        "{} {bias}",
        errors.len()
    );
}

#[test]
fn dark_flat_and_vignetting_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dark = |x: usize, y: usize| 64.0 + (x % 7) as f32 + y as f32;
    let flat = |x: usize, y: usize| {
        1.0 - 0.3 * ((x as f32 - 320.0) / 320.0).powi(2) + 0.002 * (y as f32 - 11.5)
    };
    let coefficients = [-0.28, 0.06, -0.01];
    let vignetting = |x: usize, y: usize| {
        let (dx, dy) = (x as f64 + 0.5 - 320.0, y as f64 + 0.5 - 12.0);
        let r2 = (dx * dx + dy * dy) / (320.0_f64 * 320.0 + 144.0);
        (1.0 + r2 * (-0.28 + r2 * (0.06 - 0.01 * r2))) as f32
    };
    let light = |x: usize| 100.0 * truth(x) as f32;
    write_y(&at("dark.exr"), dark);
    write_y(&at("flat.exr"), |x, y| dark(x, y) + 800.0 * flat(x, y));
    write_y(&at("a.exr"), |x, y| {
        dark(x, y) + 2.0 * light(x) * flat(x, y) * vignetting(x, y)
    });
    let sensor = Sensor {
        dark: Some("dark.exr".into()),
        flat: Some("flat.exr".into()),
        vignetting: Some(coefficients),
        ..Sensor::default()
    };
    let photo = Photo {
        file: "a.exr".into(),
        exposure_s: Some(2.0),
    };
    let radiance = view(&capture(folder.path(), sensor, vec![photo]), 0, 3..9).unwrap();
    for (i, &value) in radiance.value[0].iter().enumerate() {
        let expected = light(i % WIDTH);
        // The flat field's mean over the 32 × 24 central pixels is 1 − 0.3 (9.2/320)² = 0.9998.
        assert!(
            (value / expected - 1.0).abs() < 5e-4,
            "{i}: {value} {expected}"
        );
    }
    assert!(!radiance.noise_known);
}

#[test]
fn an_8_bit_srgb_photo_is_right_within_its_rounding() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let srgb = |x: f64| {
        if x <= 0.0031308 {
            12.92 * x
        } else {
            1.055 * x.powf(1.0 / 2.4) - 0.055
        }
    };
    let light = |x: usize, y: usize| (0.002 + x as f64 / 600.0 + y as f64 * 1e-4).min(1.2);
    let codes: Vec<u8> = (0..HEIGHT)
        .flat_map(|y| (0..WIDTH).map(move |x| (255.0 * srgb(light(x, y))).round().min(255.0) as u8))
        .collect();
    let image = image::GrayImage::from_raw(WIDTH as u32, HEIGHT as u32, codes).unwrap();
    image.save(&path).unwrap();
    let photo = Photo {
        file: "a.png".into(),
        exposure_s: Some(0.5),
    };
    let capture = capture(folder.path(), Sensor::default(), vec![photo]);
    let radiance = view(&capture, 0, 0..HEIGHT as u32).unwrap();
    let mut squares = Vec::new();
    for (i, (&value, &variance)) in radiance.value[0]
        .iter()
        .zip(&radiance.variance[0])
        .enumerate()
    {
        let expected = light(i % WIDTH, i / WIDTH) / 0.5;
        if expected * 0.5 > 1.0 {
            assert!(variance.is_infinite());
        } else if variance.is_finite() {
            squares.push((f64::from(value) - expected).powi(2) / f64::from(variance));
        }
    }
    // Rounding errors are uniform: the mean of 14,000 squared z-scores is 1 ± 0.01.
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!((mean - 1.0).abs() < 0.05, "{mean}");
}

/// A bracket of five whose photos are displaced (right, down) and turned about the picture's centre.
fn moved_bracket(
    folder: &Path,
    moves: [([f64; 2], f64); 5],
    scene: impl Fn(f64, f64) -> f64,
    seed: u64,
) -> crate::error::Result<Developed> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let per_code = 12_000.0 / (4095.0 - 64.0);
    let read = Normal::new(0.0, 5.0).unwrap();
    let mut photos = Vec::new();
    for (k, ([dx, dy], turn)) in moves.into_iter().enumerate() {
        let seconds = 0.0625 * 4_f64.powi(k as i32);
        let mut codes = vec![0.0; WIDTH * HEIGHT];
        for (i, code) in codes.iter_mut().enumerate() {
            let (x, y) = (
                (i % WIDTH) as f64 - dx - 320.0,
                (i / WIDTH) as f64 - dy - 12.0,
            );
            let (c, s) = (f64::cos(turn), f64::sin(turn));
            let light = scene(320.0 + c * x - s * y, 12.0 + s * x + c * y);
            let electrons = light * seconds * 12_000.0;
            let shot: f64 = Poisson::new(electrons).unwrap().sample(&mut random);
            let measured = shot + read.sample(&mut random);
            *code = (64.0 + measured / per_code).round().clamp(0.0, 4095.0) as f32;
        }
        let name = format!("{k}.exr");
        write_y(&folder.join(&name), |x, y| codes[y * WIDTH + x]);
        photos.push(Photo {
            file: name.into(),
            exposure_s: Some(seconds),
        });
    }
    develop(&capture(folder, sensor(), photos), 0, 0..HEIGHT as u32)
}

#[test]
fn moved_exposures_are_moved_back() {
    let folder = tempfile::tempdir().unwrap();
    for (round, moves) in [
        [0.0, 0.0, 0.4, 0.0, 0.0],
        [0.0, -0.8, 0.0, 0.3, 0.0],
        [0.0, -3.6, 2.3, 0.0, 0.0],
        [0.12, 0.0, 0.0, 0.0, 0.0],
    ]
    .into_iter()
    .enumerate()
    {
        let mut draws = Vec::new();
        for seed in 0..2 {
            let along = moves.map(|d| ([d, 0.0], 0.0));
            let found = moved_bracket(
                folder.path(),
                along,
                |x, _| truth_at(x),
                10 * round as u64 + seed,
            )
            .unwrap();
            for (exposure, planted) in found.exposures.iter().zip(moves) {
                let shift = exposure.shift;
                // The lobe's flanks rise by 3 % per pixel at 1 to 5 % noise: over 500 to 2000 pixels a
                // shift is known to 0.01 to 0.06 pixels; nothing lies across.
                let sigma = shift.sigma[0];
                assert!(
                    (shift.by[0] - planted).abs() < (4.0 * sigma).max(0.02),
                    "{planted}: {shift:?}"
                );
                assert!(planted == 0.0 || sigma < 0.06, "{planted}: {shift:?}");
                assert_eq!(shift.by[1], 0.0);
            }
            draws.push(found.radiance);
        }
        let (worst, bias, z, missing) = score(&draws);
        // As without a shift. The expected radiance that moves a value shares noise with its neighbours,
        // which adds up to a tenth to z in single pixels and nothing to means.
        assert!(
            bias.abs() < 0.001 && worst < 0.003,
            "{moves:?}: {bias} {worst}"
        );
        assert!((z - 1.0).abs() < 0.1, "{moves:?}: {z}");
        assert_eq!(missing, 0.0);
    }
}

#[test]
fn a_bracket_that_stood_still_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 0..4 {
        let still = [([0.0; 2], 0.0); 5];
        let found = moved_bracket(folder.path(), still, |x, _| truth_at(x), seed).unwrap();
        assert!(found.exposures.iter().all(|e| e.shift == Shift::default()));
    }
}

/// A picture with structure along both axes.
fn blobs(x: f64, y: f64) -> f64 {
    let wave = (x / 9.0).sin() * (y / 3.0).cos();
    0.3 + 0.25 * wave + 0.3 * truth_at(x)
}

#[test]
fn shifts_are_found_along_both_axes() {
    let folder = tempfile::tempdir().unwrap();
    let moves = [
        [0.0, 0.0],
        [0.7, -1.4],
        [0.0, 0.0],
        [-0.3, 0.25],
        [0.0, 0.0],
    ];
    let found = moved_bracket(folder.path(), moves.map(|d| (d, 0.0)), blobs, 5).unwrap();
    for (exposure, planted) in found.exposures.iter().zip(moves) {
        for axis in 0..2 {
            let error = (exposure.shift.by[axis] - planted[axis]).abs();
            assert!(error < 0.05, "{planted:?}: {:?}", exposure.shift);
        }
    }
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0);
    for (i, (&value, &variance)) in found.radiance.value[0]
        .iter()
        .zip(&found.radiance.variance[0])
        .enumerate()
    {
        let truth = blobs((i % WIDTH) as f64, (i / WIDTH) as f64);
        if variance.is_finite() {
            let error = f64::from(value) - truth;
            squares += error * error / f64::from(variance);
            sum += error / truth;
            count += 1;
        }
    }
    let z = (squares / f64::from(count)).sqrt();
    assert!(
        (z - 1.0).abs() < 0.1 && (sum / f64::from(count)).abs() < 0.001,
        "{z}"
    );
}

#[test]
fn what_moved_too_far_or_turned_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut far = [([0.0; 2], 0.0); 5];
    far[3].0 = [8.6, 0.0];
    let error = moved_bracket(folder.path(), far, |x, _| truth_at(x), 1).unwrap_err();
    let error = error.to_string();
    assert!(
        error.contains("view 0") && error.contains("moved by (8.") && error.contains("\"3.exr\""),
        "{error}"
    );
    let mut turned = [([0.0; 2], 0.0); 5];
    // 0.2 degrees move the ends of 640 pixels by 1.1.
    turned[2].1 = 0.2_f64.to_radians();
    let error = moved_bracket(folder.path(), turned, blobs, 1).unwrap_err();
    let error = error.to_string();
    assert!(
        error.contains("\"2.exr\" turned by") && error.contains("0.2"),
        "{error}"
    );
}

#[cfg(feature = "raw")]
#[test]
fn a_raw_bracket_gives_unbiased_radiance_in_all_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let read = Normal::new(0.0, 5.0).unwrap();
    let tint = [0.6, 1.0, 0.8];
    let per_code = 12_000.0 / (4095.0 - 66.0);
    let mut photos = Vec::new();
    for (k, denominator) in [16_u32, 4, 1].into_iter().enumerate() {
        let seconds = 1.0 / f64::from(denominator);
        let mut codes = vec![0_u16; WIDTH * HEIGHT];
        for (i, code) in codes.iter_mut().enumerate() {
            let (x, y) = (i % WIDTH, i / WIDTH);
            let (colour, black) = [[(0, 60.0), (1, 62.0)], [(1, 64.0), (2, 66.0)]][y % 2][x % 2];
            let electrons = 12_000.0 * seconds * tint[colour] * truth(x);
            let shot: f64 = Poisson::new(electrons).unwrap().sample(&mut random);
            let measured = black + (shot + read.sample(&mut random)) / per_code;
            *code = measured.round().clamp(0.0, 4095.0) as u16;
        }
        let name = format!("{k}.dng");
        let path = folder.path().join(&name);
        let exposure = (1, denominator);
        crate::photo::raw::tests::write_dng(&path, [WIDTH, HEIGHT], 1, exposure, |x, y| {
            codes[y * WIDTH + x]
        });
        photos.push(Photo {
            file: name.into(),
            // The file tells it.
            exposure_s: None,
        });
    }
    let sensor = Sensor {
        full_well_e: Some(12_000.0),
        read_noise_e: Some(5.0),
        responsivity: Some(12_000.0),
        ..Sensor::default()
    };
    let radiance = view(&capture(folder.path(), sensor, photos), 0, 0..HEIGHT as u32).unwrap();
    for (c, tint) in tint.into_iter().enumerate() {
        // Sums over columns, away from the edge over which a colour's sites are interpolated.
        let (mut squares, mut bias, mut count) = (0.0, 0.0, 0.0);
        for x in (2..430).chain(460..WIDTH - 2) {
            let (mut error, mut variance) = (0.0, 0.0);
            for y in 2..HEIGHT - 2 {
                let i = y * WIDTH + x;
                assert!(radiance.variance[c][i].is_finite(), "{c} {x} {y}");
                error += f64::from(radiance.value[c][i]) / (tint * truth(x)) - 1.0;
                variance += f64::from(radiance.variance[c][i]) / (tint * truth(x)).powi(2);
            }
            squares += error * error / variance;
            bias += error / (HEIGHT - 4) as f64;
            count += 1.0;
        }
        // 600 columns of 20 pixels: the mean is known to 0.1 %. The lobe's curvature adds 0.05 %.
        assert!((bias / count).abs() < 0.002, "{c}: {}", bias / count);
        // A column's pixels share sites with the next column's: its own mean scatters a little less
        // than the sites of its width let expect for red and blue, whose sites lie in every other one.
        let z = f64::sqrt(squares / count);
        assert!((0.6..1.1).contains(&z), "{c}: {z}");
    }
}

#[test]
fn masks_leave_out_what_is_not_white() {
    let folder = tempfile::tempdir().unwrap();
    let size = (WIDTH as u32, HEIGHT as u32);
    let paint = |name: &str, white: &dyn Fn(u32, u32) -> bool| {
        let image = image::GrayImage::from_fn(size.0, size.1, |x, y| {
            image::Luma([if white(x, y) { 255 } else { 40 }])
        });
        image.save(folder.path().join(name)).unwrap();
    };
    paint("all.png", &|x, _| x >= 20);
    paint("one.png", &|_, y| y != 7);
    paint("none.png", &|_, _| false);
    write_y(&folder.path().join("a.exr"), |_, _| 3.0);
    let photo = Photo {
        file: "a.exr".into(),
        exposure_s: Some(1.0),
    };
    let mut capture = capture(folder.path(), Sensor::default(), vec![photo]);
    let whole = view(&capture, 0, 2..20).unwrap();
    assert!(masked(&capture, 0, &whole).unwrap().is_none());
    capture.object.mask = Some("all.png".into());
    capture.views[0].mask = Some("one.png".into());
    let left = masked(&capture, 0, &whole).unwrap().unwrap();
    for (i, variance) in left.variance[0].iter().enumerate() {
        let (x, y) = (i % WIDTH, 2 + i / WIDTH);
        assert_eq!(variance.is_finite(), x >= 20 && y != 7, "{x} {y}");
    }
    capture.views[0].mask = Some("none.png".into());
    let error = masked(&capture, 0, &whole).unwrap_err().to_string();
    assert!(
        error.contains("none.png") && error.contains("view 0"),
        "{error}"
    );
}

#[test]
fn neighbours_of_clipped_pixels_are_missing_in_demosaiced_photos() {
    let folder = tempfile::tempdir().unwrap();
    let image = image::RgbImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| {
        image::Rgb([if (x, y) == (50, 10) { 255 } else { 90 }, 90, 90])
    });
    image.save(folder.path().join("a.png")).unwrap();
    let photo = Photo {
        file: "a.png".into(),
        exposure_s: Some(1.0),
    };
    let capture = capture(folder.path(), Sensor::default(), vec![photo]);
    let radiance = view(&capture, 0, 0..HEIGHT as u32).unwrap();
    for (i, variance) in radiance.variance[0].iter().enumerate() {
        let (x, y) = ((i % WIDTH) as i32, (i / WIDTH) as i32);
        assert_eq!(
            variance.is_infinite(),
            (x - 50).abs() <= 1 && (y - 10).abs() <= 1
        );
    }
    assert!(radiance.variance[1].iter().all(|v| v.is_finite()));
}

#[test]
fn a_12_bit_code_in_16_bits_rounds_in_its_own_steps() {
    let folder = tempfile::tempdir().unwrap();
    let codes = (0..WIDTH * HEIGHT)
        .map(|i| (i % 4000) as u16 * 16)
        .collect();
    let image = image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_raw(
        WIDTH as u32,
        HEIGHT as u32,
        codes,
    );
    image.unwrap().save(folder.path().join("a.png")).unwrap();
    let photo = Photo {
        file: "a.png".into(),
        exposure_s: Some(1.0),
    };
    let radiance = view(
        &capture(folder.path(), Sensor::default(), vec![photo]),
        0,
        0..4,
    )
    .unwrap();
    // One twelfth of 16², for whoever wrote the file rounded to multiples of 16.
    assert!(
        radiance.variance[0]
            .iter()
            .all(|&v| (v / (256.0 / 12.0) - 1.0).abs() < 1e-6)
    );
}

#[test]
fn the_rendered_test_photographs_are_sound() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata");
    let mut sets = 0;
    for entry in std::fs::read_dir(root).unwrap() {
        let folder = entry.unwrap().path();
        if !folder.join("capture.toml").exists() {
            continue;
        }
        sets += 1;
        let capture = Capture::read(&folder).unwrap();
        let findings = crate::capture::check(&capture);
        assert!(
            findings.faults.is_empty(),
            "{folder:?}: {:?}",
            findings.faults
        );
        let height = capture.camera.image_size[1];
        for index in [0, capture.views.len() - 1] {
            let radiance = view(&capture, index, 0..height).unwrap();
            for (value, variance) in radiance.value.iter().zip(&radiance.variance) {
                assert!(
                    variance.iter().all(|v| v.is_finite() && *v > 0.0),
                    "{folder:?}"
                );
                let brightest = value.iter().fold(0.0_f32, |a, &v| a.max(v));
                assert!(
                    brightest > 0.0 && value.iter().all(|&v| v >= 0.0),
                    "{folder:?}"
                );
                // Half floats round by at most 2^-11 of a value, uniformly.
                let worst = value
                    .iter()
                    .zip(variance)
                    .filter(|(v, _)| **v > 0.01 * brightest)
                    .map(|(v, s)| (12.0 * s).sqrt() / v)
                    .fold(0.0_f32, f32::max);
                assert!(worst <= 2_f32.powi(-10), "{folder:?}: {worst}");
            }
        }
    }
    assert!(sets > 0);
}
