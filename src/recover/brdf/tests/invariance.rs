//! What must not matter, what must hold of any result, and what is refused.

use std::f64::consts::{FRAC_PI_2, PI};

use super::planted::*;
use crate::angle::wrap;
use crate::lighting::Lighting;
use crate::recover::brdf::{Options, Slice, recover};

#[test]
fn the_data_find_out_which_way_the_lobe_is_smooth() {
    let (options, grid) = small();
    let light = lighting(Light::TwoSuns);
    let lengths = |planted| {
        let truth = field(planted, &light, grid);
        let samples = noisy(&truth, grid, 1e-2, 1, |_, _| true);
        let estimate = recover(&samples, &light, &options).unwrap();
        estimate.slices[0].smoothness.lengths()
    };
    let (across, along) = lengths(Planted::Phong(128.0));
    assert!(across < 0.7 * along, "{across} {along}");
    let (across, along) = lengths(Planted::Retro);
    assert!(along < 0.9 * across, "{across} {along}");
}

#[test]
fn turning_the_world_changes_nothing() {
    let (options, grid) = small();
    let light = lighting(Light::TwoSuns);
    let truth = field(Planted::Plastic, &light, grid);
    let samples = noisy(&truth, grid, 1e-3, 5, |_, _| true);
    let mut turned = samples.clone();
    for column in &mut turned.columns {
        for alpha in &mut column.alpha {
            *alpha = wrap(*alpha + 0.7);
        }
    }
    let one = recover(&samples, &light, &options).unwrap();
    let two = recover(&turned, &light.rotated(0.7), &options).unwrap();
    let largest = one.slices[0]
        .reciprocal
        .iter()
        .fold(0.0f64, |m, v| m.max(*v));
    for (a, b) in one.slices[0]
        .reciprocal
        .iter()
        .zip(&two.slices[0].reciprocal)
    {
        // Angles are rounded at 1e-16 and the condition number is below 1e8; the prior's fixed point
        // stops at the same step.
        assert!((a - b).abs() < 1e-6 * largest);
    }
}

#[test]
fn non_negative_and_reciprocal_with_signed_noise() {
    let (options, grid) = small();
    let light = lighting(Light::TwoSuns);
    let planted = Planted::Ggx(0.2);
    let truth = field(planted, &light, grid);
    let samples = noisy(&truth, grid, 1e-2, 5, |_, _| true);
    let estimate = |non_negative| {
        let options = Options {
            non_negative,
            ..options.clone()
        };
        recover(&samples, &light, &options)
            .unwrap()
            .slices
            .remove(0)
    };
    let (with, without) = (estimate(true), estimate(false));
    assert!(with.held > 0 && without.held == 0);
    assert!(with.reciprocal.iter().all(|v| *v >= 0.0));
    assert!(without.reciprocal.iter().any(|v| *v < 0.0));
    let n = options.size;
    for (i, j, k) in cells(n) {
        assert_eq!(with.reciprocal[k], with.reciprocal[j * n + i]);
    }
    let angle = |k: usize| -FRAC_PI_2 + (k as f64 + 0.5) * PI / n as f64;
    let error = |s: &Slice| -> f64 {
        cells(n)
            .map(|(i, j, k)| {
                let (a, b) = (angle(i), angle(j));
                (s.reciprocal[k] - planted.rho(a, b) * a.cos() * b.cos()).powi(2)
            })
            .sum()
    };
    // Half of the cells are dark, where the constraint takes away about half of the noise.
    assert!(error(&with) < error(&without));
}

#[test]
fn wrong_requests_are_refused_with_a_reason() {
    let (options, grid) = small();
    let light = lighting(Light::Sun);
    let truth = field(Planted::Lambert, &light, grid);
    let samples = noisy(&truth, grid, 1e-2, 5, |_, _| true);
    let dark = Lighting::uniform(vec!["Y".to_owned()], &[0.0]);
    assert!(
        recover(&samples, &dark, &options)
            .unwrap_err()
            .to_string()
            .contains("dark")
    );
    let unseen = noisy(&truth, grid, 1e-2, 5, |_, _| false);
    assert!(
        recover(&unseen, &light, &options)
            .unwrap_err()
            .to_string()
            .contains("no usable sample")
    );
    let other = Lighting::uniform(vec!["R".to_owned(), "G".to_owned()], &[1.0, 1.0]);
    assert!(
        recover(&samples, &other, &options)
            .unwrap_err()
            .to_string()
            .contains("no channel Y")
    );
    let wrong = Options { size: 0, ..options };
    assert!(recover(&samples, &light, &wrong).is_err());
}

#[test]
fn a_black_object_is_black_and_units_do_not_matter() {
    let (options, grid) = small();
    let light = lighting(Light::TwoSuns);
    let mut samples = noisy(
        &field(Planted::Plastic, &light, grid),
        grid,
        1e-3,
        5,
        |_, _| true,
    );
    let one = recover(&samples, &light, &options).unwrap();
    for column in &mut samples.columns {
        column.value[0].iter_mut().for_each(|v| *v *= 1e-12);
        column.variance[0].iter_mut().for_each(|v| *v *= 1e-24);
    }
    let small = recover(&samples, &light, &options).unwrap();
    for (a, b) in one.slices[0]
        .reciprocal
        .iter()
        .zip(&small.slices[0].reciprocal)
    {
        // As for a turned world: rounding times the condition number.
        assert!(
            (a - b * 1e12).abs() < 1e-6,
            "{a} {b} {:?} {:?}",
            one.slices[0].smoothness,
            small.slices[0].smoothness
        );
    }
    for column in &mut samples.columns {
        column.value[0].fill(0.0);
    }
    let black = recover(&samples, &light, &options).unwrap();
    assert!(black.slices[0].reciprocal.iter().all(|v| v.abs() < 1e-14));
}
