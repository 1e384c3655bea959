//! What the outlines may be wrong by in all views alike, and where they lie in the photos.

use crate::capture::Capture;
use crate::geometry::{Settled, Side, ViewGeometry};
use crate::light_field::{Samples, Systematic};

/// Error of both limbs' positions (pixels) that photos of one object share, however many they are: the brightness just
/// inside the limb is not what the edge's model assumes. It shifts nothing, but changes the apparent radius.
const LIMB_ERROR_PX: f64 = 0.03;
/// Error (pixels) of where a set stands of which few views show both limbs: what is bright at one side only is found too far in, and that turns with the view as a displacement
/// of the object does.
const ONE_SIDED_ERROR_PX: f64 = 1.0;

/// The errors of the outline that all views share: where the object stands, and how large it looks. A
/// shift by δ turns the normal seen in a pixel by δ/(R cos θo′), a radius wrong by the factor 1 + s by
/// s tan θo′. `blind`: few views show both limbs.
pub(super) fn systematics(
    settled: &Settled,
    capture: &Capture,
    geometry: &ViewGeometry,
    blind: bool,
    samples: &Samples,
    slopes: &[Vec<Vec<f64>>],
) -> Vec<Systematic> {
    let radius = capture.object.radius;
    let least = if blind {
        ONE_SIDED_ERROR_PX / half_width(geometry)
    } else {
        0.0
    };
    let of_shift = |sigma: f64| (sigma / radius).max(least);
    let [x, y] = settled.sigma_displacement.map(of_shift);
    let constant = of_shift(settled.sigma_constant);
    let scale = settled
        .sigma_radius_scale
        .max(LIMB_ERROR_PX / half_width(geometry));
    let build = |name: &str, turn: &dyn Fn(f64, f64) -> f64| {
        Systematic::of_turns(name.into(), samples, slopes, |column, view| {
            turn(column.local.rad(), capture.views[view].orbit.rad())
        })
    };
    vec![
        build("shift of the outline in all views", &|local, _| {
            constant / local.cos()
        }),
        build(
            "displacement of the object along the reference axis",
            &|local, orbit| -x * orbit.sin() / local.cos(),
        ),
        build(
            "displacement of the object across the reference axis",
            &|local, orbit| y * orbit.cos() / local.cos(),
        ),
        build("apparent radius", &|local, _| scale * local.tan()),
    ]
}

pub(super) fn centre(geometry: &ViewGeometry) -> [f64; 2] {
    match Side::BOTH.map(|side| geometry.limb(side).map(|p| p.pixel)) {
        [Some(l), Some(r)] => [(l[0] + r[0]) / 2.0, (l[1] + r[1]) / 2.0],
        _ => [f64::NAN; 2],
    }
}

pub(super) fn half_width(geometry: &ViewGeometry) -> f64 {
    match Side::BOTH.map(|side| geometry.limb(side).map(|p| p.pixel)) {
        [Some(l), Some(r)] => (r[0] - l[0]).hypot(r[1] - l[1]) / 2.0,
        _ => f64::NAN,
    }
}

pub(super) fn px_per_metre(geometry: &ViewGeometry) -> f64 {
    half_width(geometry) / geometry.radius()
}
