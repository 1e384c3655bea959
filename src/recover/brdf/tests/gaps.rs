//! What a capture leaves open is named, and what would fill it is advised.

use std::f64::consts::{PI, TAU};

use super::planted::*;
use crate::angle::wrap;
use crate::grid::Grid;
use crate::light_field::Samples;
use crate::lighting::{Lighting, Status};
use crate::recover::brdf::{advise, recover};

#[test]
fn uniform_light_determines_only_the_constant_term() {
    let (options, grid) = small();
    let planted = Planted::Phong(16.0);
    let light = Lighting::uniform(vec!["Y".to_owned()], &[1.0 / TAU]);
    let truth = field(planted, &light, grid);
    let samples = noisy(&truth, grid, 1e-3, 7, |_, _| true);
    let estimate = recover(&samples, &light, &options).unwrap();
    let slice = &estimate.slices[0];
    assert!(slice.status.iter().all(|s| *s == Status::Indeterminate));
    assert!(estimate.rho(0, 10, 20).is_none());
    let spectrum = planted_spectrum(planted, options.order);
    for (c, t) in slice.spectrum.iter().zip(&spectrum) {
        if c.q == 0 {
            assert_eq!(c.status, Status::Determined, "{c:?}");
            // Four σ for each of 22 numbers: passes by chance in 99.9 % of the seeds.
            assert!((c.value.re - t.re).abs() < 4.0 * c.sigma, "{c:?} {t}");
            assert!((c.value.im - t.im).abs() < 4.0 * c.sigma, "{c:?} {t}");
        } else {
            assert_ne!(c.status, Status::Determined, "{c:?}");
        }
    }
    assert_eq!(estimate.warnings.len(), 1, "{:?}", estimate.warnings);
    assert!(estimate.warnings[0].contains("only averages"));
}

/// Whatever the surface, the noise and the views: under uniform light no value is known, no average but ρ̃_{p,0}, and those are true.
#[test]
fn nothing_is_invented_under_uniform_light() {
    let (options, grid) = small();
    let light = Lighting::uniform(vec!["Y".to_owned()], &[0.3]);
    for (planted, level, arc) in [
        (Planted::Lambert, 1e-3, 180.0),
        (Planted::Phong(64.0), 1e-4, 180.0),
        (Planted::Phong(8.0), 1e-2, 60.0),
        (Planted::Ggx(0.2), 1e-3, 60.0),
        (Planted::Velvet, 1e-2, 180.0),
        (Planted::Retro, 1e-4, 60.0),
    ] {
        let truth = field(planted, &light, grid);
        let samples = noisy(&truth, grid, level, 11, |alpha, b| {
            wrap(alpha + b).abs() <= f64::to_radians(arc)
        });
        let slice = recover(&samples, &light, &options)
            .unwrap()
            .slices
            .remove(0);
        assert!(
            slice.status.iter().all(|s| *s == Status::Indeterminate),
            "{planted:?} {level} {arc}"
        );
        let mut determined = 0;
        for (c, t) in slice
            .spectrum
            .iter()
            .zip(planted_spectrum(planted, options.order))
        {
            if c.status == Status::Determined {
                assert_eq!(c.q, 0, "{planted:?} {level} {arc}: {c:?}");
                // Five σ for each of some hundred numbers: passes by chance in 99.99 % of the seeds.
                let off = (c.value - t).norm();
                assert!(
                    off < 5.0 * 2f64.sqrt() * c.sigma,
                    "{planted:?} {level} {arc}: {c:?} {t}"
                );
                determined += 1;
            }
        }
        assert!(determined > 0, "{planted:?} {level} {arc}");
    }
}

#[test]
fn views_over_a_third_of_the_circle_leave_named_gaps() {
    let (options, grid) = small();
    let planted = Planted::Phong(8.0);
    let light = lighting(Light::Sun);
    let truth = field(planted, &light, grid);
    // Views from −60° to 60° see θi′ − θo′ = 37.3° − θo from −22.7° to 97.3°; with the roles of
    // light and view exchanged, everything up to |97.3°|.
    let samples = noisy(&truth, grid, 1e-3, 3, |alpha, b| {
        wrap(alpha + b).abs() <= 60f64.to_radians()
    });
    let estimate = recover(&samples, &light, &options).unwrap();
    let slice = &estimate.slices[0];
    let mut reciprocal = 0;
    for (i, j, k) in cells(options.size) {
        let (a, b) = (estimate.angle(i), estimate.angle(j));
        let apart = (a - b).abs().to_degrees();
        let t = planted.rho(a, b) * a.cos() * b.cos();
        if apart < 88.0 {
            assert_eq!(slice.status[k], Status::Determined, "{a} {b}");
            assert!((slice.reciprocal[k] - t).abs() < 6.0 * slice.sigma[k]);
        }
        if apart > 130.0 {
            assert_eq!(slice.status[k], Status::Indeterminate, "{a} {b}");
        }
        // Known although no view saw it: only the cell across the diagonal was seen.
        reciprocal += usize::from(estimate.rho(0, j, i).is_some() && (30.0..88.0).contains(&apart));
    }
    assert!(reciprocal > 200);
    assert_eq!(estimate.warnings.len(), 1);
    assert!(
        estimate.warnings[0]
            .contains("indeterminate and left empty, mostly where |θi′ − θo′| is 1"),
        "{:?}",
        estimate.warnings
    );
}

/// Orbit angles of 72 even views, and samples of those that `seen` admits, on a grid that lies on their lines.
fn from_views(
    planted: Planted,
    light: &Lighting,
    seen: impl Fn(f64) -> bool,
) -> (Samples, Vec<f64>) {
    let grid = Grid {
        normals: 72,
        locals: 36,
    };
    let step = TAU / 72.0;
    let place = |orbit: f64| (wrap(orbit + 0.5 * step) + PI) / step;
    let mut samples = noisy(&field(planted, light, grid), grid, 1e-3, 4, |a, b| {
        seen(wrap(a + b))
    });
    for column in &mut samples.columns {
        for (view, a) in column.view.iter_mut().zip(&column.alpha) {
            *view = place(a + column.local.rad()) as u32 % 72;
        }
    }
    (
        samples,
        (0..72).map(|v| -PI + f64::from(v) * step).collect(),
    )
}

#[test]
fn the_advice_is_what_is_missing() {
    let (options, _) = small();
    let planted = Planted::Phong(16.0);
    // Views from −60° to 60° under a sun at 37.3° see |θi′ − θo′| up to 97.3°: only views farther than that from the sun show
    // more, those between 134.7° and −60°.
    let sun = lighting(Light::Sun);
    let (samples, orbits) = from_views(planted, &sun, |orbit| orbit.abs() <= 60f64.to_radians());
    let slice = &recover(&samples, &sun, &options).unwrap().slices[0];
    let advice = advise(&samples, 0, &orbits, &sun, 0, slice).unwrap();
    let view = advice.view.unwrap();
    let from_sun = wrap(view.direction - 37.3f64.to_radians())
        .abs()
        .to_degrees();
    assert!(view.direction.to_degrees().abs() > 60.0, "{view:?}");
    assert!((97.3..175.0).contains(&from_sun), "{view:?}");
    assert!(view.then > advice.now + 0.01, "{advice:?}");
    // And a second source shows the same views what the first did not.
    assert!(advice.source.unwrap().then > view.then, "{advice:?}");

    // Under uniform light one view is as good as all, and only a source helps.
    let uniform = Lighting::uniform(vec!["Y".to_owned()], &[0.5]);
    let (samples, orbits) = from_views(planted, &uniform, |_| true);
    let slice = &recover(&samples, &uniform, &options).unwrap().slices[0];
    let advice = advise(&samples, 0, &orbits, &uniform, 0, slice).unwrap();
    assert!(advice.now < 0.5, "{advice:?}");
    assert!(advice.view.unwrap().then < advice.now + 0.005, "{advice:?}");
    assert!(advice.source.unwrap().then > 0.95, "{advice:?}");

    // A black slice has no size to compare with.
    let mut black = slice.clone();
    black.reciprocal.fill(0.0);
    assert!(advise(&samples, 0, &orbits, &uniform, 0, &black).is_err());
}
