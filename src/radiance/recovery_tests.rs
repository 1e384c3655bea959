//! Planted responses, photographed with noise and 8 bits, and recovered.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal, Poisson};

use super::tests::capture_of;
use super::*;
use crate::capture::{Encoding, Photo, Sensor};

const WIDTH: usize = 320;
const HEIGHT: usize = 120;

/// Radiance over three decades, different in each channel, with an edge and a lobe.
fn scene(x: usize, y: usize, channel: usize) -> f64 {
    let u = x as f64 / WIDTH as f64;
    let lobe = (-((u - 0.3) / 0.08).powi(2)).exp();
    let edge = if y > 80 { 0.3 } else { 1.0 };
    let tint = [1.0, 0.7, 0.45][channel];
    tint * edge * (0.004 * (1.0 + y as f64 / 60.0) + 0.2 * u * u + 2.0 * lobe)
}

/// Curves that cameras and films have: codes over the largest one, of linear values from 0 to 1.
fn srgb(e: f64) -> f64 {
    if e <= 0.003_130_8 {
        12.92 * e
    } else {
        1.055 * e.powf(1.0 / 2.4) - 0.055
    }
}

fn gamma(e: f64) -> f64 {
    e.powf(1.0 / 2.2)
}

/// A film: normal distribution of the grains' thresholds in the logarithm of light.
fn film(e: f64) -> f64 {
    let share = |e: f64| 0.5 * (1.0 + libm::erf(0.45 * (e / 0.12).ln()));
    share(e) / share(1.0)
}

/// Writes an 8-bit colour bracket and gives its description; `times` are what the shutter really did.
fn shoot(folder: &Path, response: fn(f64) -> f64, times: &[(f64, f64)]) -> crate::capture::Capture {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let read = Normal::new(0.0, 6.0).unwrap();
    let photos = times
        .iter()
        .enumerate()
        .map(|(k, (stated, real))| {
            let mut codes = Vec::with_capacity(3 * WIDTH * HEIGHT);
            for i in 0..WIDTH * HEIGHT {
                for c in 0..3 {
                    // The code is 255 at 12,000 electrons.
                    let electrons = 12_000.0 * scene(i % WIDTH, i / WIDTH, c) * real;
                    let shot: f64 = Poisson::new(electrons).unwrap().sample(&mut random);
                    let e = ((shot + read.sample(&mut random)) / 12_000.0).clamp(1e-9, 1.0);
                    codes.push((255.0 * response(e)).round() as u8);
                }
            }
            let name = format!("{k}.png");
            let image = image::RgbImage::from_raw(WIDTH as u32, HEIGHT as u32, codes).unwrap();
            image.save(folder.join(&name)).unwrap();
            Photo {
                file: name.into(),
                exposure_s: Some(*stated),
            }
        })
        .collect();
    let sensor = Sensor {
        encoding: Some(Encoding::Recover(None)),
        ..Sensor::default()
    };
    capture_of(folder, [WIDTH as u32, HEIGHT as u32], sensor, photos)
}

/// Seven exposures two thirds to one and a half stops apart, their times off by 1 % rms.
const TIMES: [(f64, f64); 7] = [
    (1.0 / 16.0, 0.0625 * 1.008),
    (1.0 / 8.0, 0.125 * 0.991),
    (1.0 / 4.0, 0.25 * 1.012),
    (1.0 / 2.0, 0.5 * 0.996),
    (1.0, 1.003),
    (2.0, 2.0 * 0.989),
    (6.0, 6.0 * 1.001),
];

#[test]
fn planted_responses_are_recovered() {
    for (name, response) in [
        ("srgb", srgb as fn(f64) -> f64),
        ("gamma", gamma),
        ("film", film),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let capture = shoot(folder.path(), response, &TIMES);
        let recovery = recover(&capture).unwrap();
        assert_eq!(recovery.curve.linear.len(), 3);
        for (c, (linear, sigma)) in recovery
            .curve
            .linear
            .iter()
            .zip(&recovery.curve.sigma)
            .enumerate()
        {
            let truth = |code: f64| {
                let (mut low, mut high) = (1e-9, 1.0);
                for _ in 0..60 {
                    let middle = f64::sqrt(low * high);
                    if 255.0 * response(middle) < code {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                f64::sqrt(low * high)
            };
            // The scale is open: that of the codes from 100 to 150.
            let scale = (100..=150)
                .map(|k| (linear[k] / truth(k as f64)).ln())
                .sum::<f64>()
                / 51.0;
            let (mut worst, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
            // Below, read noise is spread over so many codes that their mean is not that of the light.
            for k in 20..=243 {
                let error = (linear[k] / truth(k as f64)).ln() - scale;
                worst = worst.max(error.abs());
                squares += error * error;
                count += 1.0;
                // The σ is that of the curve alone; exposure times known to 1 % bend it besides.
                let bound = 5.0 * sigma[k] / linear[k] + 0.01;
                assert!(error.abs() < bound, "{name} {c} {k}: {error} {bound}");
            }
            let rms = f64::sqrt(squares / count);
            assert!(rms < 0.01, "{name} {c}: {rms} {worst}");
        }
        // The photos show the ratios of the exposures that were really made.
        for (found, real) in recovery.times.windows(2).zip(TIMES.windows(2)) {
            let found = found[1].0 * found[1].1 / (found[0].0 * found[0].1);
            let real = real[1].1 / real[0].1;
            assert!((found / real - 1.0).abs() < 0.03, "{name}: {found} {real}");
        }
    }
}

#[test]
fn photos_with_a_recovered_response_merge_to_radiance() {
    let folder = tempfile::tempdir().unwrap();
    let capture = shoot(folder.path(), film, &TIMES);
    let found = develop(&capture, 0, 0..HEIGHT as u32).unwrap();
    for (photo, real) in found.exposures.windows(2).zip(TIMES.windows(2)) {
        let ratio = real[1].0 / real[0].0 * photo[1].time_factor / photo[0].time_factor;
        let real = real[1].1 / real[0].1;
        assert!((ratio / real - 1.0).abs() < 0.02, "{ratio} {real}");
    }
    // One scale per channel is open; beyond it radiances are right from dark to bright.
    for (c, value) in found.radiance.value.iter().enumerate() {
        let pairs: Vec<(f64, f64)> = value
            .iter()
            .zip(&found.radiance.variance[c])
            .enumerate()
            .filter(|(_, (_, variance))| variance.is_finite())
            .map(|(i, (&v, _))| (f64::from(v), scene(i % WIDTH, i / WIDTH, c)))
            .collect();
        let scale = pairs.iter().map(|p| p.0).sum::<f64>() / pairs.iter().map(|p| p.1).sum::<f64>();
        for (low, high) in [(0.004, 0.02), (0.02, 0.1), (0.1, 0.5), (0.5, 2.0)] {
            let ratios: Vec<f64> = pairs
                .iter()
                .filter(|(_, t)| (low..high).contains(t))
                .map(|(v, t)| v / t / scale)
                .collect();
            let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
            assert!(
                ratios.len() < 500 || (mean - 1.0).abs() < 0.02,
                "{c} {low}: {mean}"
            );
        }
    }
}

/// `logs` without the straight line in `x` that fits them best: what turns the scale and the power of light.
fn without_gauge(x: &[f64], logs: &[f64]) -> Vec<f64> {
    let n = x.len() as f64;
    let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
    let (mx, my) = (mean(x), mean(logs));
    let xy: f64 = x.iter().zip(logs).map(|(x, y)| (x - mx) * (y - my)).sum();
    let xx: f64 = x.iter().map(|x| (x - mx).powi(2)).sum();
    let pairs = x.iter().zip(logs);
    pairs.map(|(x, y)| y - my - xy / xx * (x - mx)).collect()
}

#[test]
fn planted_errors_of_exposure_times_are_found() {
    // Nine stops; errors of 1 % and of 3 % rms.
    let pattern = [0.8, -1.3, 0.4, 1.6, -0.9, 0.2, -1.1, 1.2, -0.5];
    for (response, size) in [
        (srgb as fn(f64) -> f64, 0.01),
        (film, 0.01),
        (srgb, 0.03),
        (film, 0.03),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let times: Vec<(f64, f64)> = pattern
            .iter()
            .enumerate()
            .map(|(k, e)| {
                let stated = 2f64.powi(k as i32 - 5);
                (stated, stated * f64::exp(size * e))
            })
            .collect();
        let recovery = recover(&shoot(folder.path(), response, &times)).unwrap();
        let stops: Vec<f64> = times.iter().map(|(stated, _)| stated.log2()).collect();
        let truth: Vec<f64> = times
            .iter()
            .map(|(stated, real)| (real / stated).ln())
            .collect();
        let found: Vec<f64> = recovery
            .times
            .iter()
            .map(|(_, factor)| factor.ln())
            .collect();
        let truth = without_gauge(&stops, &truth);
        let found = without_gauge(&stops, &found);
        let errors = || found.iter().zip(&truth).map(|(f, t)| f - t);
        let n = errors().count() as f64;
        let rms = (errors().map(|e| e * e).sum::<f64>() / n).sqrt();
        let z = errors()
            .zip(&recovery.time_sigmas)
            .map(|(e, s)| (e / s).powi(2));
        let z = (z.sum::<f64>() / n).sqrt();
        println!(
            "{:.0} %: found to {:.3} %, {z:.2} σ of {:.3} %; misfit {:.2}",
            100.0 * size,
            100.0 * rms,
            100.0 * recovery.time_sigmas.iter().sum::<f64>() / n,
            recovery.misfit
        );
        // A fifth of the smaller errors; from 9 times less two z is known to 27 %.
        assert!(rms < 0.002, "{rms}");
        assert!(z < 2.0, "{z}");
    }
}

#[test]
fn what_cannot_be_recovered_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let capture = shoot(folder.path(), srgb, &TIMES[..1]);
    let error = recover(&capture).unwrap_err().to_string();
    assert!(error.contains("different exposure times"), "{error}");
}
