//! How many rows of a photo are needed, and how many can be averaged.

use std::f64::consts::PI;
use std::ops::Range;

use crate::capture::{Capture, Projection, Shape};
use crate::geometry::{CameraModel, Side, ViewGeometry};

/// Rows above and below the cross-section that the outline is searched in, pixels: the most, and the least. In
/// between as many as hold the same number of pixels per angle as the most do at an object of this radius.
const OUTLINE_ROWS: f64 = 48.0;
const LEAST_OUTLINE_ROWS: f64 = 16.0;
const OUTLINE_RADIUS_PX: f64 = 430.0;
/// Pixels behind a sample beyond which more only take time: at the shot noise of a good camera, 0.5 %, they know it to
/// 1e-4 of its value, and neither geometry nor a BRDF are known better.
const ENOUGH_PIXELS: f64 = 2100.0;
/// Distances from the cross-section that are tried for the averaging of rows, pixels.
const REACHES: [f64; 12] = [
    2.0, 3.0, 4.5, 6.5, 9.5, 14.0, 20.0, 30.0, 45.0, 65.0, 95.0, 140.0,
];
/// Largest elevation out of the plane that is averaged: of the view direction on a cylinder, of the
/// normal on a sphere, radians.
const ELEVATION: (f64, f64) = (0.026, 0.05);

/// Rows of the image that hold the outline's search band and the measured line.
pub(super) fn rows_needed(capture: &Capture, geometry: &ViewGeometry, reach: f64) -> Range<u32> {
    let height = f64::from(capture.camera.image_size[1]);
    let ends = Side::BOTH.map(|side| geometry.limb(side).map(|p| p.pixel[1]));
    let (Some(left), Some(right)) = (ends[0], ends[1]) else {
        return 0..capture.camera.image_size[1];
    };
    let radius = geometry.radius_px().unwrap_or(OUTLINE_RADIUS_PX);
    let outline =
        (OUTLINE_ROWS * OUTLINE_RADIUS_PX / radius).clamp(LEAST_OUTLINE_ROWS, OUTLINE_ROWS);
    let margin = reach.max(outline) + 2.0;
    let first = (left.min(right) - margin).floor().clamp(0.0, height);
    let last = (left.max(right) + margin).ceil().clamp(0.0, height);
    if last > first {
        first as u32..last as u32
    } else {
        0..capture.camera.image_size[1]
    }
}

/// Distances from the cross-section (pixels), in increasing order, whose rows may be averaged into samples of `locals` columns; one at least.
pub(super) fn reaches(capture: &Capture, camera: &CameraModel, locals: usize) -> Vec<f64> {
    let limit = reach_limit(capture, camera, locals);
    REACHES
        .into_iter()
        .enumerate()
        .filter(|&(i, r)| i == 0 || r <= limit)
        .map(|(_, r)| r)
        .collect()
}

/// Largest distance from the cross-section (pixels) that may be averaged into samples of `locals` columns.
fn reach_limit(capture: &Capture, camera: &CameraModel, locals: usize) -> f64 {
    let object_px = capture.object.radius / camera.metres_per_px();
    let across = object_px * PI / locals.max(1) as f64;
    let enough = ENOUGH_PIXELS / (2.0 * across);
    let allowed = match (capture.object.shape, capture.camera.projection) {
        (Shape::Cylinder, Projection::Perspective { focal_px }) => focal_px * ELEVATION.0,
        (Shape::Cylinder, Projection::Orthographic { .. }) => object_px,
        (Shape::Sphere, _) => object_px * ELEVATION.1,
    };
    allowed.min(enough)
}
