//! Where the object is in the photos by the description alone: cut by the frame, too small, or of doubtful lengths.

use crate::capture::{Capture, Projection};
use crate::error::Error;

/// The object's width in parts of the photo's beyond which the description is doubted.
const MOST_WIDE: f64 = 1.3;
const LEAST_WIDE: f64 = 0.05;

/// The width of an object (pixels) below which its description cannot be meant.
const LEAST_PIXELS: f64 = 4.0;

/// How far a limb may lie out of the picture by the description, whose lengths are rough: pixels, and part of the
/// object's width.
const CUT_PX: f64 = 2.0;
const CUT_SHARE: f64 = 0.03;

/// Where the object is in the photos, by the description alone: what is doubtful about its size, and whether it is cut by
/// the frame at a side or too small to be measured, which no photo can make good. An outline given by hand is believed.
pub fn framing(capture: &Capture) -> (Vec<String>, Option<Error>) {
    let (object, camera) = (&capture.object, &capture.camera);
    let width = f64::from(camera.image_size[0]);
    let sine = (object.radius / camera.distance).clamp(0.0, 0.999_999);
    // Half the width on the image of a camera of focal length 1, and pixels to that unit.
    let (half, scale) = match camera.projection {
        Projection::Perspective { focal_px } => (sine.asin().tan(), focal_px),
        Projection::Orthographic { metres_per_px } => (object.radius, 1.0 / metres_per_px),
    };
    let across = 2.0 * half * scale;
    let stated = format!(
        "radius {} m, distance {} m and the focal length make the object {} pixels wide in photos of {width:.0}",
        object.radius,
        camera.distance,
        pixels(across)
    );
    let hint = if across > width {
        if across > 100.0 * width {
            "check focal_px, radius and distance"
        } else if across / 2.0 < width {
            "is focal_px that of a picture of twice the size?"
        } else if camera.distance < 50.0 * object.radius {
            "is the radius a diameter, or in other units than the distance?"
        } else {
            "check focal_px"
        }
    } else if across >= LEAST_WIDE * width {
        "check principal_point_px"
    } else if camera.distance > 500.0 * object.radius {
        "is the distance in millimetres? All lengths are in metres"
    } else {
        "check focal_px, which is in pixels, not in millimetres"
    };
    let fault = |what: String| {
        let advice = format!("The description gives {stated}; {hint}");
        let error = Error::input(what).file("capture.toml").key("camera");
        error.advice(advice.replace("gives radius", "says: radius"))
    };
    if capture.views.iter().all(|view| view.outline.is_some()) {
        return (Vec::new(), None);
    }
    if !(across >= LEAST_PIXELS) {
        let what = format!(
            "the object is {across:.1} pixels wide in the photos, expected at least {LEAST_PIXELS}"
        );
        return (Vec::new(), Some(fault(what)));
    }
    // A plane that is rolled onto its side crosses the picture from top to bottom.
    let level = |roll: f64| roll.cos().abs() > 0.7;
    if capture.views.iter().all(|view| level(view.plane_roll)) {
        let limb =
            |sign: f64| camera.principal_point_px[0] + sign * scale * distorted(capture, half);
        let margin = CUT_PX + CUT_SHARE * across;
        let cut = [limb(-1.0) < -margin, limb(1.0) > width + margin];
        let sides = match cut {
            [true, true] => "both sides",
            [true, false] => "the left side",
            [false, true] => "the right side",
            [false, false] => "",
        };
        if !sides.is_empty() {
            let what = format!(
                "the object is cut at {sides}: expected its limbs in columns 0 to {width:.0}, and by the description they are at {} and {} pixels",
                pixels(limb(-1.0)),
                pixels(limb(1.0))
            );
            return (Vec::new(), Some(fault(what)));
        }
    }
    if across > MOST_WIDE * width || across < LEAST_WIDE * width {
        return (vec![format!("{stated}; {hint}")], None);
    }
    (Vec::new(), None)
}

/// A number of pixels for people, however absurd.
fn pixels(value: f64) -> String {
    match value.abs() {
        v if v < 1e6 => format!("{value:.0}"),
        _ => format!("{value:.1e}"),
    }
}

/// Distance from the principal point on the image of a camera of focal length 1, with the lens's radial distortion.
fn distorted(capture: &Capture, r: f64) -> f64 {
    let [k1, k2, _, _, k3] = capture.camera.distortion;
    let r2 = r * r;
    let moved = r * (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)));
    match capture.camera.projection {
        Projection::Perspective { .. } if moved.is_finite() => moved,
        _ => r,
    }
}
