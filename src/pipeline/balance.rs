//! Whether the photographs are alike above and below the measured line, as light in the plane alone makes them.
//!
//! Light that comes from above or below the plane broadens the lobes of a slice, and where it comes from does not change much around the
//! circle, the light field is still that of light in the plane, of another material: reciprocity holds, nothing is left
//! unexplained, and the slice is wrong. The rows beside the line tell it. Light in the plane and a surface that is the same on both sides of it give a picture that is even in the distance
//! from the plane, so that its derivative across the line is zero; light from one side of it does not.
//!
//! Near a mirrored direction, a lobe is a function of how far light is from that direction, whether across the plane or along it. Light at the
//! elevation ε gives the derivative ε B″ across the plane where light in it gives B′ along, and broadens the lobe by
//! ½ ε² B″: with B″ ~ B′²/B the share of the light field that is wrong is half the square of the ratio of both, rms.

use rayon::prelude::*;

use super::measure::Measured;
use super::photographed::{photographed, spread};
use super::rows::rows_needed;
use crate::capture::Shape;
use crate::error::Result;
use crate::geometry::{CameraModel, Pose, ViewGeometry};
use crate::light_field::MeasuredLine;

/// Views that are looked at.
const VIEWS: usize = 24;
/// Least and largest room above and below the line that is used, pixels.
const LEAST_ROOM: f64 = 1.0;
const MOST_ROOM: f64 = 40.0;
/// |sin θo′| up to which it is used: towards the limb the lines above and below leave the object.
const INNER: f64 = 0.85;
/// |sin| of the roll of a plane up to which the image's columns cross it.
const LEVEL: f64 = 0.05;
/// Standard deviations of the noise's own scatter that the derivatives across must exceed.
const SIGNIFICANT: f64 = 5.0;

/// One view and channel: Σ (∂B/∂ε B), its variance, Σ B² and Σ (∂B/∂α)².
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    across: f64,
    variance: f64,
    power: f64,
    along: f64,
}

/// Mean square of the relative change of radiance across the plane to that along it, both by angle of the mirrored direction, per
/// channel: twice the share of a slice that is wrong. 0 where noise explains it; `None` where the rows do not tell.
///
/// An axis that leans does the same to the picture and is known otherwise: nothing is said of such a set.
///
/// # Errors
/// If a photo cannot be read again.
pub fn out_of_plane(measured: &Measured) -> Result<Vec<Option<f64>>> {
    let channels = measured.samples.channels.len();
    if measured.scale_sigma > 0.0 {
        return Ok(vec![None; channels]);
    }
    let camera = CameraModel::new(&measured.capture.camera)?;
    let level = |v: &usize| measured.capture.views[*v].plane_roll.sin().abs() < LEVEL;
    let views: Vec<usize> = (0..measured.capture.views.len()).filter(level).collect();
    let sums: Vec<Vec<Sums>> = spread(views.len(), VIEWS)
        .into_par_iter()
        .map(|place| of_view(measured, &camera, views[place]))
        .collect::<Result<_>>()?;
    // By how much the mirrored direction turns with the elevation of the view, or of a sphere's normal, against the normal along the line.
    let gain = match measured.capture.object.shape {
        Shape::Cylinder => 2.0,
        Shape::Sphere => 1.0,
    };
    Ok((0..channels)
        .map(|c| {
            let of: Vec<Sums> = sums
                .iter()
                .filter_map(|view| view.get(c).copied())
                .collect();
            ratio(&of, gain)
        })
        .collect())
}

/// The mean square over views, each with the weight of its light, without what the noise adds.
fn ratio(views: &[Sums], gain: f64) -> Option<f64> {
    let seen: Vec<&Sums> = views
        .iter()
        .filter(|s| s.power > 0.0 && s.variance > 0.0)
        .collect();
    let along: f64 = seen.iter().map(|s| s.along).sum();
    if !(along > 0.0) {
        return None;
    }
    let (mut excess, mut scatter) = (0.0, 0.0);
    for s in seen {
        let noise = s.variance / s.power;
        excess += s.across * s.across / s.power - noise;
        scatter += 2.0 * noise * noise;
    }
    Some(match excess > SIGNIFICANT * scatter.sqrt() {
        true => gain * gain * excess / along,
        false => 0.0,
    })
}

fn of_view(measured: &Measured, camera: &CameraModel, view: usize) -> Result<Vec<Sums>> {
    let capture = &measured.capture;
    let roll = capture.views[view].plane_roll;
    let nominal = ViewGeometry::new(camera, &capture.object, Pose::nominal(), roll);
    let rows = rows_needed(capture, &nominal, measured.reach);
    let found = photographed(capture, camera, view, rows).map_err(|e| e.view(view))?;
    let (radiance, pose) = (&found.radiance, found.outline.pose);
    let geometry = ViewGeometry::new(camera, &capture.object, pose, roll);
    let none = Vec::new();
    let Ok(line) = MeasuredLine::read(radiance, &geometry, measured.reach) else {
        return Ok(none);
    };
    let [top, bottom] = [radiance.rows.start, radiance.rows.end].map(f64::from);
    let room = line
        .positions
        .iter()
        .map(|p| (p[1] - top).min(bottom - p[1]))
        .fold(
            MOST_ROOM.min(INNER * geometry.radius_px().unwrap_or(MOST_ROOM) / 4.0),
            f64::min,
        );
    if !(room >= LEAST_ROOM) {
        return Ok(none);
    }
    let beside =
        |sign: f64| MeasuredLine::read_below(radiance, &geometry, 0.5 * room, sign * 0.5 * room);
    let (Ok(above), Ok(below)) = (beside(-1.0), beside(1.0)) else {
        return Ok(none);
    };
    let count = line.stations.count();
    if above.stations.count() != count || below.stations.count() != count {
        return Ok(none);
    }
    let at = |line: &MeasuredLine, k: usize| geometry.at(line.positions[k]);
    Ok((0..radiance.channels.len())
        .map(|c| {
            let mut sums = Sums::default();
            for k in 1..count.saturating_sub(1) {
                let inside = geometry.sin_local(line.positions[k]).abs() < INNER;
                let (Some(a), Some(b)) = (at(&above, k), at(&below, k)) else {
                    continue;
                };
                let (Some(before), Some(after)) = (at(&line, k - 1), at(&line, k + 1)) else {
                    continue;
                };
                let step = b.elevation - a.elevation;
                let turn = crate::angle::wrap(after.alpha - before.alpha);
                let values = |l: &MeasuredLine, k: usize| l.stations.value[c][k];
                let variance = above.stations.variance[c][k] + below.stations.variance[c][k];
                let known = [k - 1, k, k + 1]
                    .iter()
                    .all(|&k| line.stations.variance[c][k].is_finite());
                if !inside || step == 0.0 || turn == 0.0 || !known || !variance.is_finite() {
                    continue;
                }
                let value = values(&line, k);
                let across = (values(&below, k) - values(&above, k)) / step;
                let along = (values(&line, k + 1) - values(&line, k - 1)) / turn;
                sums.across += across * value;
                sums.variance += variance / (step * step) * value * value;
                sums.power += value * value;
                sums.along += along * along;
            }
            sums
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lobe cos^n about the mirrored direction under light at the elevation ε, seen on a cylinder.
    fn lobe(exponent: f64, elevation: f64) -> Sums {
        let mut sums = Sums::default();
        for k in -400..400 {
            // In the plane from the light, and across it from the view's side.
            let alpha = f64::from(k) * 0.002;
            let value = |across: f64| ((2.0 * alpha).cos() * across.cos()).max(0.0).powf(exponent);
            let b = value(elevation);
            let step = 1e-4;
            let slope = (value(elevation - step) - value(elevation + step)) / (2.0 * step);
            let along = -2.0 * exponent * (2.0 * alpha).tan() * b;
            sums.across += slope * b;
            sums.power += b * b;
            sums.along += along * along;
        }
        sums.variance = 1e-9 * sums.power;
        sums
    }

    #[test]
    fn light_in_the_plane_is_balanced() {
        assert_eq!(ratio(&[lobe(32.0, 0.0); 24], 2.0), Some(0.0));
    }

    /// (n tan ε)² over n²⟨tan² 2α⟩ ≈ n/2 of a narrow lobe: 2 n ε².
    #[test]
    fn light_beside_the_plane_shows_by_the_square_of_its_elevation() {
        for (n, degrees) in [(32.0, 2.0f64), (32.0, 5.0), (128.0, 2.0)] {
            let found = ratio(&[lobe(n, degrees.to_radians()); 24], 2.0).expect("known");
            let expected = 2.0 * n * degrees.to_radians().powi(2);
            // The lobe is a Gaussian up to 1/n.
            assert!(
                (found / expected - 1.0).abs() < 3.0 / n,
                "{n} {degrees}: {found} {expected}"
            );
        }
    }

    #[test]
    fn noise_alone_is_balanced() {
        // Each as large as its standard deviation.
        let noisy = |sign: f64| Sums {
            across: sign * 0.1,
            variance: 0.01,
            power: 1.0,
            along: 1.0,
        };
        let views: Vec<Sums> = (0..24)
            .map(|k| noisy(if k % 2 == 0 { 1.0 } else { -1.0 }))
            .collect();
        assert_eq!(ratio(&views, 2.0), Some(0.0));
    }
}
