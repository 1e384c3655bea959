//! What the factorisation promises, on small fields.

use num_complex::Complex64;

use super::half_circle::HalfCircle;
use super::study::{
    GGX_02, Light, PHONG_32, all_around, brdf, error, random, samples, two_suns, views,
};
use super::*;
use crate::angle::WorldAngle;
use crate::grid::Grid;

const GRID: Grid = Grid {
    normals: 90,
    locals: 45,
};

/// Relative noise per cell of most tests here.
const NOISE: f64 = 1e-3;

fn noisy(recipe: &str, light: &Light, cut: f64) -> Samples {
    let clean = light.field(brdf(recipe).as_ref(), GRID);
    let sigma = NOISE * clean.iter().copied().fold(0.0, f64::max);
    samples(&clean, GRID, sigma, cut, Some(11))
}

fn one(samples: &Samples, options: &Options) -> Channel {
    recover(samples, options)
        .expect("a factorisation")
        .channels
        .remove(0)
}

#[test]
fn lighting_and_brdf_come_back_within_their_error_bars() {
    let light = Light::Limited(random(8, 2));
    let truth = light.series(8);
    let found = one(&noisy(PHONG_32, &light, 86.0), &Options::default());
    assert_eq!(found.band, 8);
    // Order 8 at 0.1 % noise: the bound is near 0.1 % (THEORY: 0.08 % on a grid twice as fine).
    assert!(error(&found.lighting, &truth, 8) < 0.01);
    assert!(error(&found.ratio, &truth, 8) > error(&found.lighting, &truth, 8));
    for p in 1..=8 {
        let e = (found.lighting.coefficients[p] - truth.coefficients[p]).norm();
        // A complex error exceeds 3.2 σ once in 3e4 times.
        assert!(e < 3.2 * found.sigma[p], "{p}: {e} {}", found.sigma[p]);
    }
    // The slice is seen through a light of order 8, under which a lobe of 10° is blurred: compared as what the light
    // sees of it, H_p for p ≤ 4, column by column.
    let n = GRID.locals;
    let b = brdf(PHONG_32);
    for j in [10, 22, 30] {
        let local = GRID.local(j);
        let exact = crate::brdf::transfer_row(b.as_ref(), local, 4);
        for (p, h) in exact.iter().enumerate() {
            let weights = HalfCircle::new(n).exponential(p as i64);
            let seen: Complex64 = (0..n)
                .map(|k| weights[k] * found.brdf[k * n + j] * GRID.local(k).rad().cos())
                .sum();
            assert!(
                (seen - h).norm() < 0.02 * exact[0].norm(),
                "{j} {p}: {seen} {h}"
            );
        }
    }
    for (k, j) in (0..n).flat_map(|k| (0..n).map(move |j| (k, j))) {
        assert!(
            (found.brdf[k * n + j] - found.brdf[j * n + k]).abs()
                <= 1e-9 * found.brdf[k * n + j].abs().max(1.0)
        );
        assert!(found.brdf[k * n + j] >= 0.0);
    }
}

#[test]
fn turning_the_light_turns_the_result() {
    let light = random(8, 3);
    let turned = light.rotated(GRID.normal_step() * 7.0);
    let field = |l: &Series| {
        let clean = Light::Limited(l.clone()).field(brdf(GGX_02).as_ref(), GRID);
        one(
            &samples(&clean, GRID, 1e-3, 90.0, None),
            &Options::default(),
        )
    };
    let (a, b) = (field(&light), field(&turned));
    let expected = a.lighting.rotated(GRID.normal_step() * 7.0);
    // The same numbers in another order; both iterations stop within 5 % of σ.
    for p in 1..=8 {
        let difference = (b.lighting.get(p) - expected.get(p)).norm();
        assert!(difference <= 0.1 * a.sigma[p as usize], "{p}: {difference}");
    }
}

#[test]
fn a_lambertian_surface_leaves_odd_frequencies_indeterminate() {
    let light = Light::Limited(random(8, 4));
    let truth = light.series(8);
    let found = one(
        &noisy("model = 'lambertian'\nalbedo = 0.7", &light, 80.0),
        &Options::default(),
    );
    for p in [3, 5, 7] {
        assert_eq!(found.status[p], Status::Indeterminate);
        assert_eq!(found.lighting.coefficients[p], Complex64::ZERO);
    }
    for p in [1, 2, 4] {
        let e = (found.lighting.coefficients[p] - truth.coefficients[p]).norm();
        assert_eq!(found.status[p], Status::Determined);
        assert!(e < 3.2 * found.sigma[p], "{p}: {e} {}", found.sigma[p]);
    }
    assert!(found.components[0].contains(&2) && !found.components[0].contains(&3));
}

#[test]
fn uniform_light_leaves_all_but_the_mean_open() {
    let light = Light::Limited(Series {
        coefficients: vec![Complex64::ONE],
    });
    let found = recover(&noisy(PHONG_32, &light, 86.0), &Options::default()).expect("the mean");
    let channel = &found.channels[0];
    assert_eq!(channel.visible_band, 0);
    assert!(
        channel.band >= 8
            && channel.lighting.coefficients[1..]
                .iter()
                .all(|l| l.norm() == 0.0)
    );
    assert!(
        channel.status[1..]
            .iter()
            .all(|s| *s == Status::Indeterminate)
    );
    assert!(channel.brdf_sigma.iter().all(|s| s.is_infinite()));
    assert!(
        found.warnings[0].contains("does not change with the normal"),
        "{:?}",
        found.warnings
    );
}

/// A shift of the picture that all columns share, δ/cos θo′ in α: fitted along it costs the light little, and left alone far more than its
/// error bars.
#[test]
fn an_error_that_all_samples_share_is_fitted_along() {
    let light = Light::Limited(random(8, 2));
    let truth = light.series(8);
    let b = brdf(GGX_02);
    let clean = light.field(b.as_ref(), GRID);
    let sigma = NOISE * clean.iter().copied().fold(0.0, f64::max);
    let mut s = samples(&clean, GRID, sigma, 86.0, Some(11));
    // One standard deviation is 0.5°, and the truth lies 1.2 of them off.
    let delta = 0.5f64.to_radians();
    let fine = Grid {
        normals: 8 * GRID.normals,
        ..GRID
    };
    let field = light.field(b.as_ref(), fine);
    let change: Vec<Vec<f64>> = (0..GRID.locals)
        .map(|j| {
            let at = |i: usize| field[fine.index(i % fine.normals, j)];
            (0..GRID.normals)
                .map(|i| {
                    // The centres of coarse cells lie between those of fine ones.
                    let k = 8 * i + fine.normals;
                    let slope = (at(k + 4) - at(k + 3)) / fine.normal_step();
                    delta * slope / GRID.local(j).visible_cosine()
                })
                .collect()
        })
        .collect();
    for (column, change) in s.columns.iter_mut().zip(&change) {
        for (v, c) in column.value[0].iter_mut().zip(change) {
            *v += 1.2 * c;
        }
    }
    let shift = Systematic {
        name: "shift".into(),
        change: vec![change],
    };
    let alone = one(&s, &Options::default());
    let along = recover_with(&s, &[shift], &Options::default())
        .expect("a factorisation")
        .channels
        .remove(0);
    let [without, with] = [&alone, &along].map(|c| error(&c.lighting, &truth, 8));
    assert!(with < 0.3 * without, "{with} {without}");
    // The guess beyond the limb cut does not move with the error, which costs a few per cent of it.
    let found = along.systematics.found[0];
    assert!((found - 1.2).abs() < 0.1, "{found}");
}

#[test]
fn views_over_a_third_of_the_circle_invent_nothing() {
    let light = Light::Limited(random(8, 5));
    let truth = light.series(8);
    let orbits: Vec<f64> = (0..40).map(|v| 3.0 * f64::from(v)).collect();
    let s = views(&light, brdf(GGX_02).as_ref(), &orbits, 45, 86.0, NOISE, 8);
    if let Ok(found) = recover(&s, &Options::default()) {
        let channel = &found.channels[0];
        for p in 1..=channel.band.min(8) {
            let e = (channel.lighting.coefficients[p] - truth.coefficients[p]).norm();
            assert!(
                channel.status[p] == Status::Indeterminate || e < 4.0 * channel.sigma[p],
                "{p}: {e} {}",
                channel.sigma[p]
            );
        }
    }
}

#[test]
fn irregular_views_with_gaps_are_as_good_as_their_error_bars() {
    let light = Light::Limited(random(8, 6));
    let truth = light.series(8);
    // 72 views, unevenly spaced, six of them missing.
    let orbits: Vec<f64> = all_around(72)
        .into_iter()
        .enumerate()
        .filter(|(i, _)| i % 12 != 5)
        .map(|(i, o)| o + 1.5 * (i as f64).sin())
        .collect();
    let s = views(&light, brdf(PHONG_32).as_ref(), &orbits, 45, 86.0, NOISE, 9);
    let found = one(&s, &Options::default());
    assert!(found.band >= 8);
    for p in 1..=8 {
        let e = (found.lighting.coefficients[p] - truth.coefficients[p]).norm();
        assert!(e < 3.2 * found.sigma[p], "{p}: {e} {}", found.sigma[p]);
    }
    assert!(error(&found.lighting, &truth, 8) < 0.02);
}

#[test]
fn a_given_fact_sets_the_scale() {
    let light = Light::Limited(random(8, 2));
    let s = noisy(PHONG_32, &light, 90.0);
    let plain = one(&s, &Options::default());
    let with = |scale| {
        one(
            &s,
            &Options {
                scale,
                ..Options::default()
            },
        )
    };
    // The field was made with L_0 = 1 and an albedo that follows from its own BRDF.
    let total = with(Scale::TotalIrradiance(vec![3.0]));
    assert!((total.lighting.get(0).re * std::f64::consts::TAU - 3.0).abs() < 1e-9);
    let factor = total.lighting.get(0).re;
    assert!((total.brdf[1000] * factor - plain.brdf[1000]).abs() < 1e-9);
    let n = 2000;
    let b = brdf(PHONG_32);
    let fine = Grid {
        normals: 1,
        locals: n,
    };
    let albedo = (0..n)
        .step_by(10)
        .map(|j| {
            let local = fine.local(j);
            crate::brdf::transfer_row(b.as_ref(), local, 0)[0].re * local.rad().cos()
        })
        .sum::<f64>()
        * 10.0
        * fine.local_step()
        * std::f64::consts::FRAC_PI_4;
    let known = with(Scale::Albedo(vec![albedo]));
    // The noise of B̃_{0,0}: 1e-3 / √4050 of its size; the sum above is good to 1e-4.
    assert!((known.lighting.get(0).re - 1.0).abs() < 1e-3);
    assert!(
        recover(
            &s,
            &Options {
                scale: Scale::Albedo(vec![]),
                ..Options::default()
            }
        )
        .is_err()
    );
}

#[test]
fn a_known_source_sets_the_scale() {
    let light = Light::Real(two_suns());
    let s = views(
        &light,
        brdf(GGX_02).as_ref(),
        &all_around(72),
        60,
        86.0,
        NOISE,
        3,
    );
    let found = one(
        &s,
        &Options {
            scale: Scale::Source {
                theta: WorldAngle::degrees(37.3),
                irradiance: vec![3.0],
            },
            ..Options::default()
        },
    );
    let total = found.lighting.get(0).re * std::f64::consts::TAU;
    // 3 + 1.1 + 0.04 · 2π; the cut delta's side lobes reach the other sun's at the per-cent level.
    assert!((total / 4.3513 - 1.0).abs() < 0.05, "{total}");
}

/// The Cramér–Rao bound by brute force: the Fisher information of all unknowns, L and every entry of a symmetric ρ̃, and
/// the Schur complement of L.
#[test]
fn the_bound_is_that_of_the_whole_problem() {
    use faer::linalg::solvers::Solve;
    use faer::{Mat, Side};
    let grid = Grid {
        normals: 16,
        locals: 8,
    };
    let truth = random(3, 9);
    let clean = Light::Limited(truth.clone()).field(brdf(PHONG_32).as_ref(), grid);
    let sigma = 1e-2;
    let s = samples(&clean, grid, sigma, 90.0, None);
    let fast = study::bounds(&s, &truth, 3);

    let half = HalfCircle::new(8);
    let spectrum = Spectrum::fit(&s, 0, &half, 3, 1.0).expect("a spectrum");
    let e = half.exponentials(3);
    // ρ̃ that explains the field exactly at the nodes: the least-squares symmetric one.
    let unknowns: Vec<(usize, usize)> = (0..8).flat_map(|a| (0..=a).map(move |b| (a, b))).collect();
    let rows = 7 * 8;
    let operator = |k: usize, i: usize, x: &dyn Fn(usize) -> f64| -> f64 {
        // Row i of diag(L) E x at column k.
        let h = |row: usize| (0..8).map(|t| e[(row, t)] * x(t)).sum::<f64>() / half.cosines[k];
        if i == 0 {
            return truth.get(0).re * h(0);
        }
        let p = i.div_ceil(2);
        let l = truth.get(p as i64);
        let (re, im) = (h(2 * p - 1), h(2 * p));
        if i % 2 == 1 {
            l.re * re - l.im * im
        } else {
            l.im * re + l.re * im
        }
    };
    let brdf_part = Mat::from_fn(rows, unknowns.len(), |row, u| {
        let (k, i) = (row / 7, row % 7);
        let (a, b) = unknowns[u];
        let unit = |t: usize| f64::from((t == a && k == b) || (t == b && k == a));
        operator(k, i, &unit)
    });
    let data = Mat::from_fn(rows, 1, |row, _| spectrum.values[(row % 7, row / 7)]);
    let ridge = |m: Mat<f64>, by: f64| {
        let largest = (0..m.nrows()).map(|i| m[(i, i)]).fold(0.0, f64::max);
        Mat::from_fn(m.nrows(), m.ncols(), |i, j| {
            m[(i, j)] + if i == j { by * largest } else { 0.0 }
        })
    };
    let normal = ridge(brdf_part.transpose() * &brdf_part, 1e-13);
    let x = normal
        .llt(Side::Lower)
        .expect("positive")
        .solve(brdf_part.transpose() * data);
    let entry = |a: usize, b: usize| {
        let index = unknowns
            .iter()
            .position(|&u| u == (a.max(b), a.min(b)))
            .unwrap_or(0);
        x[(index, 0)]
    };
    let light_part = Mat::from_fn(rows, 6, |row, parameter| {
        let (k, i) = (row / 7, row % 7);
        let p = parameter / 2 + 1;
        if i.div_ceil(2) != p {
            return 0.0;
        }
        let h = |r: usize| (0..8).map(|t| e[(r, t)] * entry(t, k)).sum::<f64>() / half.cosines[k];
        let (re, im) = (h(2 * p - 1), h(2 * p));
        match (parameter % 2, i % 2) {
            (0, 1) => re,
            (0, _) => im,
            (_, 1) => -im,
            _ => re,
        }
    });
    let weight = 16.0 / (sigma * sigma);
    let cross = brdf_part.transpose() * &light_part;
    let explained = normal.llt(Side::Lower).expect("positive").solve(&cross);
    let information = (light_part.transpose() * &light_part - cross.transpose() * explained)
        * faer::Scale(weight);
    let covariance = information
        .llt(Side::Lower)
        .expect("positive")
        .solve(Mat::<f64>::identity(6, 6));
    for p in 1..=3 {
        let slow = (covariance[(2 * p - 2, 2 * p - 2)] + covariance[(2 * p - 1, 2 * p - 1)]).sqrt();
        // The ridge of 1e-13 on a problem of condition 1e6 or so.
        assert!(
            (fast[p] / slow - 1.0).abs() < 1e-3,
            "{p}: {} {slow}",
            fast[p]
        );
    }
}
