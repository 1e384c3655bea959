//! Samples as a capture gives them: one α in each view and column, and geometry that is not quite right.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::planted::*;
use crate::angle::{WorldAngle, wrap};
use crate::fourier::Series;
use crate::grid::Grid;
use crate::light_field::{Samples, Systematic};
use crate::lighting::{Lighting, Status};
use crate::recover::brdf::{
    BrdfEstimate, LightError, Options, recover, recover_under, recover_with,
};
use num_complex::Complex64;

/// Samples as a capture gives them: `views` even views, `locals` columns, one α per view and column.
fn captured(
    planted: Planted,
    light: &Lighting,
    views: usize,
    locals: usize,
    level: f64,
) -> Samples {
    let fine = Grid {
        normals: 720,
        locals,
    };
    let largest = truth_max(&field(planted, light, fine), fine);
    let mut rng = ChaCha8Rng::seed_from_u64(72);
    let columns = (0..locals)
        .map(|j| fine.local(j).rad())
        .filter(|b| b.abs() < 85f64.to_radians())
        .map(|b| {
            let alpha: Vec<f64> = (0..views)
                .map(|v| wrap(TAU * v as f64 / views as f64 - b))
                .collect();
            let value = alpha
                .iter()
                .map(|alpha| {
                    let z: f64 = StandardNormal.sample(&mut rng);
                    let sun: f64 = light
                        .sources
                        .iter()
                        .map(|s| (wrap(s.theta.rad() - alpha), s.irradiance[0]))
                        .filter(|s| s.0.abs() < FRAC_PI_2)
                        .map(|(a, e)| e * planted.rho(a, b) * a.cos())
                        .sum();
                    let steps = 360;
                    let fill: f64 = (0..steps)
                        .map(|k| -FRAC_PI_2 + (f64::from(k) + 0.5) * PI / f64::from(steps))
                        .map(|a| {
                            light.density(0, WorldAngle::radians(alpha + a))
                                * planted.rho(a, b)
                                * a.cos()
                                * PI
                                / f64::from(steps)
                        })
                        .sum();
                    sun + fill + level * largest * z
                })
                .collect();
            crate::light_field::Column {
                local: crate::LocalAngle::radians(b),
                view: (0..views as u32).collect(),
                alpha,
                value: vec![value],
                variance: vec![vec![(level * largest).powi(2); views]],
            }
        })
        .collect();
    Samples {
        channels: vec!["Y".to_owned()],
        columns,
    }
}

/// Root mean square of error/σ over what is determined, |θ| ≤ 70°.
fn z_score(planted: Planted, estimate: &BrdfEstimate) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    let slice = &estimate.slices[0];
    for (i, j, k) in cells(estimate.size) {
        let (a, b) = (estimate.angle(i), estimate.angle(j));
        if a.abs().max(b.abs()) <= 70f64.to_radians() && slice.status[k] == Status::Determined {
            let t = planted.rho(a, b) * a.cos() * b.cos();
            sum += ((slice.reciprocal[k] - t) / slice.sigma[k]).powi(2);
            count += 1.0;
        }
    }
    assert!(count > 500.0);
    f64::sqrt(sum / count)
}

/// Samples of 72 even views whose geometry is wrong, and what one standard deviation of each error does to them.
/// `moved` tells, for each of `errors` errors in units of σ, by how much α and θo′ are off at (view, θo′).
fn misplaced(
    planted: Planted,
    light: &Lighting,
    errors: usize,
    drawn: &[f64],
    moved: impl Fn(usize, usize, f64) -> [f64; 2],
    seed: u64,
) -> (Samples, Vec<Systematic>) {
    let value = |alpha: f64, b: f64| -> f64 {
        light
            .sources
            .iter()
            .map(|s| (wrap(s.theta.rad() - alpha), s.irradiance[0]))
            .filter(|s| s.0.abs() < FRAC_PI_2)
            .map(|(a, e)| e * planted.rho(a, b) * a.cos())
            .sum()
    };
    let sigma = 1e-3 * 3.0 * planted.rho(-0.2, 0.2);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut systematics: Vec<Systematic> = (0..errors)
        .map(|e| Systematic {
            name: format!("error {e}"),
            change: vec![Vec::new()],
        })
        .collect();
    let (views, locals) = (72usize, 60);
    let grid = Grid {
        normals: views,
        locals,
    };
    let columns = (0..locals)
        .map(|j| grid.local(j).rad())
        .filter(|b| b.abs() < 75f64.to_radians())
        .map(|b| {
            let alpha: Vec<f64> = (0..views)
                .map(|v| wrap(TAU * v as f64 / views as f64 - b))
                .collect();
            let mut seen = Vec::with_capacity(views);
            for (v, &a) in alpha.iter().enumerate() {
                let mut off = [0.0; 2];
                for (e, z) in drawn.iter().enumerate() {
                    let m = moved(e, v, b);
                    off = [off[0] + z * m[0], off[1] + z * m[1]];
                }
                let z: f64 = StandardNormal.sample(&mut rng);
                seen.push(value(a + off[0], b + off[1]) + sigma * z);
            }
            for (e, systematic) in systematics.iter_mut().enumerate() {
                let change = alpha.iter().enumerate().map(|(v, &a)| {
                    let m = moved(e, v, b);
                    let step = 1e-3;
                    (value(a + step * m[0], b + step * m[1])
                        - value(a - step * m[0], b - step * m[1]))
                        / (2.0 * step)
                });
                systematic.change[0].push(change.collect());
            }
            crate::light_field::Column {
                local: crate::LocalAngle::radians(b),
                view: (0..views as u32).collect(),
                alpha,
                value: vec![seen],
                variance: vec![vec![sigma * sigma; views]],
            }
        })
        .collect();
    let samples = Samples {
        channels: vec!["Y".to_owned()],
        columns,
    };
    (samples, systematics)
}

#[test]
fn errors_of_the_geometry_are_in_the_error_bars() {
    let (options, _) = small();
    let planted = Planted::Phong(16.0);
    let light = lighting(Light::TwoSuns);
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let z = |samples: &Samples, systematics: &[Systematic]| {
        z_score(
            planted,
            &recover_with(samples, systematics, &light, &options).unwrap(),
        )
    };

    // Each view's orbit angle off by 0.3°.
    let sigma = 0.3f64.to_radians();
    let drawn: Vec<f64> = (0..72).map(|_| StandardNormal.sample(&mut rng)).collect();
    let turned = |e: usize, v: usize, _: f64| [if e == v { sigma } else { 0.0 }, 0.0];
    let (samples, systematics) = misplaced(planted, &light, 72, &drawn, turned, 1);
    let told = z(&samples, &systematics);
    // Some hundred independent parameters: the rms of their z-scores scatters by 1/√200 = 7 %; four of those. The
    // errors are five times the noise where the lobe is steep, and a blind fit, although it notices that the residual is
    // larger than the noise, does not know where.
    assert!((0.72..1.28).contains(&told), "{told}");

    // The outline off by 0.2° in all views: one number, here one standard deviation.
    let sigma = 0.2f64.to_radians();
    let shifted = |_: usize, _: usize, b: f64| [-sigma / b.cos(), sigma / b.cos()];
    let (samples, systematics) = misplaced(planted, &light, 1, &[1.0], shifted, 2);
    let (told, blind) = (z(&samples, &systematics), z(&samples, &[]));
    assert!((0.6..1.3).contains(&told), "{told}");
    assert!(blind > 2.0 * told, "{blind} {told}");

    // The object off by 0.2° of its radius along the reference axis: the same, as the sine of the orbit angle.
    let displaced = |_: usize, v: usize, b: f64| {
        let shift = sigma * (TAU * v as f64 / 72.0).sin() / b.cos();
        [-shift, shift]
    };
    let (samples, systematics) = misplaced(planted, &light, 1, &[-1.0], displaced, 3);
    let (told, blind) = (z(&samples, &systematics), z(&samples, &[]));
    assert!((0.6..1.3).contains(&told), "{told}");
    assert!(blind > 1.5 * told, "{blind} {told}");
}

/// Root mean square error of ρ̃ over |θ| ≤ 70°, relative to its maximum.
fn slice_error(planted: Planted, estimate: &BrdfEstimate) -> f64 {
    let (mut sum, mut count, mut largest) = (0.0, 0.0, 0.0f64);
    for (i, j, k) in cells(estimate.size) {
        let (a, b) = (estimate.angle(i), estimate.angle(j));
        let t = planted.rho(a, b) * a.cos() * b.cos();
        largest = largest.max(t);
        if a.abs().max(b.abs()) <= 70f64.to_radians() {
            sum += (estimate.slices[0].reciprocal[k] - t).powi(2);
            count += 1.0;
        }
    }
    (sum / count).sqrt() / largest
}

#[test]
fn seventy_two_views_give_the_slice_to_a_percent() {
    let options = Options {
        intervals: Some(45),
        size: 90,
        order: 8,
        ..Options::default()
    };
    let planted = Planted::Phong(32.0);
    let sun = lighting(Light::Sun);
    let error = slice_error(
        planted,
        &recover(&captured(planted, &sun, 72, 90, 2e-3), &sun, &options).unwrap(),
    );
    assert!(error < 0.01, "{error}");
    let mut suns = lighting(Light::TwoSuns);
    suns.table = vec![vec![0.05]];
    let error = slice_error(
        planted,
        &recover(&captured(planted, &suns, 72, 90, 2e-3), &suns, &options).unwrap(),
    );
    assert!(error < 0.03, "{error}");
}

#[test]
fn errors_of_the_light_are_in_the_error_bars() {
    // One error of the light, one standard deviation long: the suns a little broader, or turned.
    let planted = Planted::Phong(16.0);
    let light = lighting(Light::TwoSuns);
    let (options, _) = small();
    let samples = captured(planted, &light, 72, 60, 1e-3);
    let frequencies: Vec<usize> = (1..=20).collect();
    for (broader, turned) in [(1e-3, 0.0), (0.0, 3e-3), (5e-4, -1e-3)] {
        let mut wrong = light.clone();
        let mut off = Series::zero(20);
        for &p in &frequencies {
            let l = light.series(0, 20).get(p as i64);
            let p = p as f64;
            off.coefficients[p as usize] =
                l * Complex64::new(-broader * p * p, -turned * p) / (1.0 + (p / 10.0).powi(4));
        }
        wrong.smooth = vec![off.clone()];
        let parts: Vec<f64> = frequencies
            .iter()
            .flat_map(|&p| [off.get(p as i64).re, off.get(p as i64).im])
            .collect();
        let error = LightError {
            frequencies: frequencies.clone(),
            covariance: parts
                .iter()
                .flat_map(|a| parts.iter().map(move |b| a * b))
                .collect(),
            changes: Vec::new(),
        };
        let right = recover(&samples, &light, &options).unwrap();
        let found = recover_under(&samples, &wrong, &[error], &options).unwrap();
        let blind = recover(&samples, &wrong, &options).unwrap();
        let (mut moved, mut expected) = (0.0, 0.0);
        for (_, _, k) in cells(found.size) {
            let [r, f, b] = [&right, &found, &blind].map(|e| &e.slices[0]);
            moved += (f.reciprocal[k] - r.reciprocal[k]).powi(2);
            expected += f.sigma[k].powi(2) - b.sigma[k].powi(2);
        }
        // Where the fit notices that the light is wrong, all else is scaled up with the noise, which is little of this.
        let ratio = (moved / expected).sqrt();
        assert!((0.9..1.1).contains(&ratio), "{broader} {turned}: {ratio}");
    }
}
