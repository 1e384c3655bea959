//! Where the integral over a plane of light must be cut so that each panel's integrand is smooth, for normals and views
//! that lie out of that plane.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector3;

/// Intervals of the half circle in which a change of sign is looked for.
const INTERVALS: usize = 32;
/// Halvings of such an interval: to 1e-10.
const HALVINGS: usize = 30;

/// Angles from the normal's projection at which panels must end where the surface is seen at a grazing angle.
///
/// `behind` is the direction straight away from the camera (angle of its projection from the normal's, radians), `out`
/// how far it lies out of the plane. The half vector to light from there turns within as many radians as that direction
/// lies out of the plane or below the horizon, and the BRDF with it; a sheen's masking does the same on either side.
pub(super) fn grazing(behind: f64, out: f64) -> impl Iterator<Item = f64> {
    const WIDEST: f64 = 0.3;
    let width = (behind.abs() - FRAC_PI_2).hypot(out);
    let mut distance = if width < WIDEST { 0.0 } else { PI };
    let distances = std::iter::from_fn(move || {
        distance += (0.5 * width.hypot(distance)).max(1e-5);
        (distance < WIDEST).then_some(distance)
    });
    distances.flat_map(|d| [FRAC_PI_2 - d, d - FRAC_PI_2])
}

/// Angles at which the models that have kinks have them out of the plane of incidence; `toward` gives the direction at an
/// angle from the normal's projection.
pub(super) fn kinks(
    normal: Vector3<f64>,
    view: Vector3<f64>,
    toward: impl Fn(f64) -> Vector3<f64>,
) -> Vec<f64> {
    let exitant = normal.dot(&view);
    // Each changes its sign at a kink.
    let changes = |angle: f64| {
        let light = toward(angle);
        let (incident, between) = (normal.dot(&light), light.dot(&view));
        let square = 2.0 + 2.0 * between;
        [
            // An azimuth of 90°, and equal inclinations (Oren and Nayar; the latter Torrance and Sparrow).
            between - incident * exitant,
            incident - exitant,
            // 90° from the mirror direction (Phong).
            2.0 * incident * exitant - between,
            // The ends of masking and of shadowing, 2 cos θh cos θo′ = cos θd and its counterpart, times
            // 2 |i + o| (Torrance and Sparrow).
            4.0 * (incident + exitant) * exitant - square,
            4.0 * (incident + exitant) * incident - square,
        ]
    };
    let at = |k: usize| -FRAC_PI_2 + PI * k as f64 / INTERVALS as f64;
    let mut found = Vec::new();
    let mut before = changes(at(0));
    for k in 1..=INTERVALS {
        let after = changes(at(k));
        for (which, (a, b)) in before.iter().zip(after).enumerate() {
            if a * b < 0.0 {
                let (mut low, mut high) = (at(k - 1), at(k));
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (low + high);
                    if changes(middle)[which] * a > 0.0 {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                found.push(0.5 * (low + high));
            }
        }
        before = after;
    }
    found
}
