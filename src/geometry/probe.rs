//! Photos of a mirror ball: from each highlight to the direction of its light, and to the plane in which a sphere at the
//! ball's place must be measured under that light.
//!
//! The mirror's law is applied exactly: the line of sight through the highlight meets the sphere, and the light comes
//! from l = 2 (n·v) n − v, from far away. The measurement plane is the one that holds the sphere's centre, the camera and
//! l ([`ViewGeometry::new`]'s `plane_roll`).

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector3;

use super::camera::CameraModel;
use super::outline::{self, Outline, Search};
use super::settle::settle;
use super::surface::{Pose, ViewGeometry};
use crate::angle::wrap;
use crate::capture::{Capture, GivenOutline, Shape};
use crate::error::{Error, Result};
use crate::photo;
use crate::radiance::{self, Radiance};

/// Largest part of the ball's apparent radius at which highlights are looked for: beyond, a pixel spans degrees.
const REACH: f64 = 0.985;
/// A highlight rises above the ball's median by this part of the brightest, and by this many deviations.
const LEAST_RISE: f64 = 0.3;
const LEAST_DEVIATIONS: f64 = 12.0;
/// Pixels above this part of a highlight's own peak are its core, of which the centre is taken.
const CORE: f64 = 0.5;
/// Clipped cores smaller than this part of the largest are glints.
const LEAST_CORE: f64 = 0.1;
/// How well the middle of a core is the light's image even if it is round and clean, pixels.
const CENTRE_FLOOR: f64 = 0.1;
/// Relative deviation of a mask's area from that of a disc of its width and height up to which it is the ball's outline.
const DISC: f64 = 0.03;

/// One light seen in a mirror ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Highlight {
    /// Middle of the highlight, pixels.
    pub pixel: [f64; 2],
    /// Its standard deviation.
    pub sigma_px: f64,
    /// Whether its core is clipped.
    pub clipped: bool,
    /// Direction to the light, a unit vector in camera axes: towards the camera, right, up.
    pub direction: [f64; 3],
    /// Roll of the plane that holds the light, radians in (−π/2, π/2].
    pub plane_roll: f64,
    /// Angle from the optical axis to the light in that plane, radians in (−π, π], counter-clockwise.
    pub light: f64,
    /// Standard deviation of the direction, radians.
    pub sigma: f64,
}

/// The highlights of a capture's photos: one list per view, brightest first.
///
/// The ball's outline is the description's, if it gives one; else that of its mask, if the mask is a disc; else it is
/// found in the photos, all of which then say where the ball stands.
///
/// # Errors
/// If the object is no sphere, a photo or a mask cannot be read, or the camera is inside the ball.
pub fn probe(capture: &Capture) -> Result<Vec<Vec<Highlight>>> {
    if capture.object.shape != Shape::Sphere {
        return Err(Error::input("expected a mirror ball, found a cylinder")
            .key("object.shape")
            .advice("Set shape = \"sphere\" and the ball's radius."));
    }
    let camera = CameraModel::new(&capture.camera)?;
    let height = capture.camera.image_size[1];
    let mut seen: Vec<(Radiance, Outline)> = Vec::new();
    for (k, view) in capture.views.iter().enumerate() {
        let place = |e: Error| e.view(k);
        let radiance = radiance::view(capture, k, 0..height).map_err(place)?;
        let given = match (
            view.outline,
            view.mask.as_ref().or(capture.object.mask.as_ref()),
        ) {
            (Some(given), _) => Some(given),
            (None, Some(mask)) => {
                let photo = photo::read(&capture.folder.join(mask), None).map_err(place)?;
                disc(&photo)
            }
            (None, None) => None,
        };
        let outline = match given {
            Some(given) => outline::given(given, &camera, &capture.object),
            None => outline::find(&radiance, &camera, &capture.object, Search::default()),
        };
        seen.push((radiance, outline.map_err(place)?));
    }
    let outlines: Vec<Outline> = seen.iter().map(|(_, o)| o.clone()).collect();
    let settled = settle(&outlines, capture)?;
    Ok(seen
        .iter()
        .zip(&settled.poses)
        .map(|((radiance, _), pose)| {
            let geometry = ViewGeometry::new(&camera, &capture.object, *pose, 0.0);
            cores(radiance, &geometry)
                .into_iter()
                .filter_map(|core| reflect(&geometry, capture, &core))
                .collect()
        })
        .collect())
}

/// The disc that a mask shows, if it does.
fn disc(mask: &photo::Photo) -> Option<GivenOutline> {
    let width = mask.size[0] as usize;
    let plane = mask.values.first()?;
    let white = 0.5 * plane.iter().copied().fold(0.0f32, f32::max);
    let (mut count, mut sum) = (0.0, [0.0; 2]);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for (i, _) in plane.iter().enumerate().filter(|(_, v)| **v > white) {
        let at = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        count += 1.0;
        for j in 0..2 {
            sum[j] += at[j];
            low[j] = low[j].min(at[j] - 0.5);
            high[j] = high[j].max(at[j] + 0.5);
        }
    }
    let box_area = (high[0] - low[0]) * (high[1] - low[1]);
    let round = (count / (box_area * PI / 4.0) - 1.0).abs() < DISC;
    (count > 0.0 && round).then(|| GivenOutline {
        centre_px: sum.map(|s| s / count),
        radius_px: (count / PI).sqrt(),
    })
}

/// A bright patch on the ball.
struct Core {
    pixel: [f64; 2],
    sigma_px: f64,
    clipped: bool,
}

/// The bright patches of one photo, brightest or largest first. Clipped pixels, which have no value, are the brightest
/// of all; if there are any, only patches that hold some are highlights.
fn cores(radiance: &Radiance, geometry: &ViewGeometry) -> Vec<Core> {
    let width = radiance.size[0] as usize;
    let inside = |i: usize| {
        let at = [
            (i % width) as f64 + 0.5,
            f64::from(radiance.rows.start) + (i / width) as f64 + 0.5,
        ];
        geometry.miss(at) < REACH * REACH - 1.0
    };
    let channels = radiance.channels.len().max(1) as f64;
    let count = radiance.value.first().map_or(0, Vec::len);
    // NaN off the ball, infinite where a channel is clipped.
    let brightness: Vec<f64> = (0..count)
        .map(|i| {
            if !inside(i) {
                return f64::NAN;
            }
            let known = radiance.variance.iter().all(|v| v[i].is_finite());
            let sum: f64 = radiance.value.iter().map(|v| f64::from(v[i])).sum();
            if known { sum / channels } else { f64::INFINITY }
        })
        .collect();
    let mut finite: Vec<f64> = brightness
        .iter()
        .copied()
        .filter(|b| b.is_finite())
        .collect();
    finite.sort_by(f64::total_cmp);
    let Some(&median) = finite.get(finite.len() / 2) else {
        return Vec::new();
    };
    let mut deviation: Vec<f64> = finite.iter().map(|b| (b - median).abs()).collect();
    deviation.sort_by(f64::total_cmp);
    let noise = 1.4826 * deviation.get(deviation.len() / 2).copied().unwrap_or(0.0);
    let brightest = finite.last().copied().unwrap_or(median);
    let rise = (LEAST_RISE * (brightest - median)).max(LEAST_DEVIATIONS * noise);
    let mut patches = patches(&brightness, width, median + rise);
    let clipped_in = |patch: &[usize]| {
        patch
            .iter()
            .filter(|&&i| brightness[i].is_infinite())
            .count()
    };
    let largest = patches.iter().map(|p| clipped_in(p)).max().unwrap_or(0);
    if largest > 0 {
        patches.retain(|p| clipped_in(p) as f64 >= (LEAST_CORE * largest as f64).max(1.0));
    }
    let peak = |patch: &[usize]| patch.iter().map(|&i| brightness[i]).fold(0.0, f64::max);
    patches.sort_by(|a, b| {
        let order = clipped_in(b).cmp(&clipped_in(a));
        order.then(peak(b).total_cmp(&peak(a)))
    });
    let first_row = f64::from(radiance.rows.start);
    patches
        .iter()
        .map(|patch| {
            let clipped = clipped_in(patch) > 0;
            let level = median + CORE * (peak(patch) - median);
            let weights = patch.iter().map(|&i| {
                let weight = match (clipped, brightness[i].is_infinite()) {
                    (true, hit) => f64::from(u8::from(hit)),
                    (false, _) => (brightness[i] - level).max(0.0),
                };
                (
                    weight,
                    [
                        (i % width) as f64 + 0.5,
                        first_row + (i / width) as f64 + 0.5,
                    ],
                )
            });
            let (mut total, mut first, mut second, mut squares) = (0.0, [0.0; 2], 0.0, 0.0);
            for (w, at) in weights {
                total += w;
                squares += w * w;
                for j in 0..2 {
                    first[j] += w * at[j];
                    second += w * at[j] * at[j];
                }
            }
            let pixel = first.map(|f| f / total);
            // Half the mean square distance from the middle: the extent along one axis.
            let extent = (0.5 * (second / total - pixel[0].powi(2) - pixel[1].powi(2)))
                .max(0.0)
                .sqrt();
            // A clipped core may be lopsided by as much as it is wide; of an unclipped one the middle is known as
            // well as that of so many pixels.
            let own = if clipped {
                0.5 * extent
            } else {
                (extent + 0.3) * (squares / (total * total)).sqrt()
            };
            Core {
                pixel,
                sigma_px: own.hypot(CENTRE_FLOOR),
                clipped,
            }
        })
        .filter(|core| core.pixel.iter().all(|p| p.is_finite()))
        .collect()
}

/// Connected groups of pixels above a level.
fn patches(brightness: &[f64], width: usize, level: f64) -> Vec<Vec<usize>> {
    let mut taken = vec![false; brightness.len()];
    let mut all = Vec::new();
    for start in 0..brightness.len() {
        if taken[start] || !(brightness[start] > level) {
            continue;
        }
        taken[start] = true;
        let mut patch = vec![start];
        let mut next = 0;
        while let Some(&i) = patch.get(next) {
            next += 1;
            let (column, row) = (i % width, i / width);
            for r in row.saturating_sub(1)..=row + 1 {
                for c in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                    let near = r * width + c;
                    if brightness.get(near).is_some_and(|b| *b > level) && !taken[near] {
                        taken[near] = true;
                        patch.push(near);
                    }
                }
            }
        }
        all.push(patch);
    }
    all
}

/// The direction from which a mirror at a pixel gets its light; `None` off the ball.
fn mirrored(geometry: &ViewGeometry, pixel: [f64; 2]) -> Option<Vector3<f64>> {
    let normal = geometry.normal(pixel)?;
    let view = -geometry.camera().ray(pixel).direction.normalize();
    Some(normal * (2.0 * normal.dot(&view)) - view)
}

fn reflect(geometry: &ViewGeometry, capture: &Capture, core: &Core) -> Option<Highlight> {
    let light = mirrored(geometry, core.pixel)?;
    // By central differences: one pixel along each axis, one σ of the ball's place and size.
    let between = |a: Vector3<f64>, b: Vector3<f64>| 0.5 * (a - b).norm();
    let at = |du: f64, dv: f64| mirrored(geometry, [core.pixel[0] + du, core.pixel[1] + dv]);
    let pose = *geometry.pose();
    let posed = |change: &dyn Fn(&mut Pose)| {
        let mut moved = pose;
        change(&mut moved);
        mirrored(
            &ViewGeometry::new(geometry.camera(), &capture.object, moved, 0.0),
            core.pixel,
        )
    };
    let (s, r) = (pose.sigma_lateral, pose.sigma_radius_scale);
    let pairs = [
        (at(0.5, 0.0), at(-0.5, 0.0), 2.0 * core.sigma_px),
        (at(0.0, 0.5), at(0.0, -0.5), 2.0 * core.sigma_px),
        (
            posed(&|p| p.offset[1] += s),
            posed(&|p| p.offset[1] -= s),
            1.0,
        ),
        (
            posed(&|p| p.offset[2] += s),
            posed(&|p| p.offset[2] -= s),
            1.0,
        ),
        (
            posed(&|p| p.radius_scale += r),
            posed(&|p| p.radius_scale -= r),
            1.0,
        ),
    ];
    let variance: f64 = pairs
        .into_iter()
        .map(|(a, b, factor)| match (a, b) {
            (Some(a), Some(b)) => (factor * between(a, b)).powi(2),
            // At the very limb a pixel's half is off the ball.
            _ => FRAC_PI_2.powi(2),
        })
        .sum();
    let (plane_roll, angle) = plane_of(geometry, capture, light);
    Some(Highlight {
        pixel: core.pixel,
        sigma_px: core.sigma_px,
        clipped: core.clipped,
        direction: light.into(),
        plane_roll,
        light: angle,
        // Two directions across the light share it.
        sigma: (0.5 * variance).sqrt(),
    })
}

/// Roll of the plane through the centre, the camera and `light`, and the light's angle in it.
fn plane_of(geometry: &ViewGeometry, capture: &Capture, light: Vector3<f64>) -> (f64, f64) {
    let across = light.cross(&geometry.to_camera());
    // In the line to the camera every plane holds the light.
    let mut roll = if across.norm() < 1e-9 {
        0.0
    } else {
        (-across.y).atan2(across.z)
    };
    if roll > FRAC_PI_2 {
        roll -= PI;
    } else if roll <= -FRAC_PI_2 {
        roll += PI;
    }
    let plane = ViewGeometry::new(geometry.camera(), &capture.object, *geometry.pose(), roll);
    (roll, wrap(plane.angle_of(light)))
}
