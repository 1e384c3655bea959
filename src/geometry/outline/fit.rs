//! Least squares of the exact perspective outline to limb points.

use nalgebra::{SMatrix, SVector};

use super::LimbPoint;
use super::scenery::{self, Scenery};
use crate::capture::{Object, Shape};
use crate::geometry::camera::CameraModel;
use crate::geometry::surface::{Pose, Side, ViewGeometry};

/// What the outline determines, and how well.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fitted {
    pub pose: Pose,
    /// Standard deviation of `pose.offset[2]`, metres.
    pub sigma_vertical: f64,
}

impl Fitted {
    /// Adds what each side's limb is off as a whole (pixels; `None`: not seen) to the variances.
    pub(super) fn add_model_error(
        &mut self,
        camera: &CameraModel,
        object: &Object,
        sides: [Option<f64>; 2],
    ) {
        let [left, right] = sides.map(|px| px.map(|px| (px * camera.metres_per_px()).powi(2)));
        let (lateral, width) = match (left, right) {
            (Some(l), Some(r)) => (0.25 * (l + r), 0.25 * (l + r)),
            (one, other) => (one.or(other).unwrap_or(0.0), 0.0),
        };
        let pose = &mut self.pose;
        pose.sigma_lateral = pose.sigma_lateral.hypot(lateral.sqrt());
        pose.sigma_radius_scale = pose.sigma_radius_scale.hypot(width.sqrt() / object.radius);
    }
}

/// Model error of a limb point that its own fit doesn't know of, pixels.
const POINT_FLOOR: f64 = 0.01;
/// Most steps of the fit.
const STEPS: usize = 12;

/// Gauss–Newton with Huber weights on (y, z, ln scale, tilt). The radius is held where only one side is seen.
pub(super) fn fit(
    camera: &CameraModel,
    object: &Object,
    start: Pose,
    points: &[LimbPoint],
    sceneries: &[Scenery],
) -> Option<Fitted> {
    let radius = object.radius;
    let both = Side::BOTH
        .iter()
        .all(|side| points.iter().any(|p| p.side == *side));
    let sphere = object.shape == Shape::Sphere;
    // Prior standard deviations; what the photo cannot show stays as described.
    let prior = SVector::<f64, 4>::new(
        0.5 * radius,
        if sphere { 0.05 * radius } else { 1e-9 * radius },
        if both { 0.1 } else { 1e-9 },
        if sphere { 1e-9 } else { 0.05 },
    );
    let step = SVector::<f64, 4>::new(1e-5 * radius, 1e-5 * radius, 1e-5, 1e-5);
    let pose = |p: &SVector<f64, 4>| Pose {
        offset: [0.0, p[0], p[1]],
        tilt: p[3],
        radius_scale: p[2].exp(),
        ..Pose::nominal()
    };
    let misses = |p: &SVector<f64, 4>| -> Vec<Option<f64>> {
        let g = ViewGeometry::new(camera, object, pose(p), 0.0);
        points
            .iter()
            .map(|point| Some(point.column - g.limb_at_row(point.row, point.side)?))
            .collect()
    };
    let mut p = SVector::<f64, 4>::new(start.offset[1], start.offset[2], 0.0, 0.0);
    for iteration in 0..STEPS {
        let here = misses(&p);
        let moved: Vec<Vec<Option<f64>>> = (0..4)
            .map(|j| {
                let mut q = p;
                q[j] += step[j];
                misses(&q)
            })
            .collect();
        let mut normal = SMatrix::<f64, 4, 4>::from_diagonal(&prior.map(|s| s.powi(-2)));
        let mut right = -p.component_div(&prior.component_mul(&prior));
        let mut chi = 0.0;
        let mut total = 0.0;
        // By how much each point moves the unknowns, but for the inverse.
        let mut pulls = Vec::with_capacity(points.len());
        for (i, point) in points.iter().enumerate() {
            let Some(miss) = here[i] else { continue };
            let mut row = SVector::<f64, 4>::zeros();
            for j in 0..4 {
                row[j] = moved[j][i].map_or(0.0, |m| (miss - m) / step[j]);
            }
            let sigma = point.sigma_px.hypot(POINT_FLOOR);
            let sigmas = miss.abs() / sigma;
            // An edge of the scenery is no error of the limb: such a point is left out ever more the farther it is off.
            let scenic = sceneries.get(i).map_or(0.0, |s| s.known) > POINT_FLOOR * POINT_FLOOR;
            let huber = match iteration {
                0 => 1.0,
                _ if sigmas <= 2.0 => 1.0,
                _ if iteration < 4 || !scenic => 2.0 / sigmas,
                _ => (2.0 / sigmas).powi(2),
            };
            let w = huber / (sigma * sigma);
            normal.ger(w, &row, &row, 1.0);
            right += row * (w * miss);
            chi += w * miss * miss;
            total += huber;
            pulls.push((i, row * w));
        }
        let inverse = normal.try_inverse()?;
        let change = inverse * right;
        p += change;
        if iteration > 4 && change.component_div(&prior).norm() < 1e-7 || iteration + 1 == STEPS {
            let worse = (chi / (total - 3.0).max(1.0)).max(1.0);
            // The scenery moves the points of a limb together.
            let of_scenery = |j: usize| -> f64 {
                let of_side = |side: Side| {
                    let of_points = pulls.iter().filter_map(|(i, pull)| {
                        let scenery = sceneries.get(*i)?;
                        (points[*i].side == side).then(|| ((inverse.row(j) * pull)[0], scenery))
                    });
                    scenery::variance(of_points)
                };
                Side::BOTH.map(of_side).iter().sum()
            };
            let of_noise = |j: usize| -> f64 {
                let by_points = pulls.iter().map(|(i, pull)| {
                    let own = sceneries.get(*i).map_or(0.0, |s| s.known);
                    let variance = points[*i].sigma_px.powi(2) + POINT_FLOOR * POINT_FLOOR - own;
                    (inverse.row(j) * pull)[0].powi(2) * variance
                });
                by_points.sum()
            };
            let sigma = |j: usize| {
                let independent = inverse[(j, j)] * worse;
                independent.max(of_noise(j) + of_scenery(j)).sqrt()
            };
            let mut pose = pose(&p);
            pose.sigma_lateral = sigma(0);
            pose.sigma_tilt = if sphere { 0.0 } else { sigma(3) };
            pose.sigma_radius_scale = if both {
                sigma(2) * pose.radius_scale
            } else {
                0.0
            };
            return pose.offset.iter().all(|v| v.is_finite()).then_some(Fitted {
                pose,
                sigma_vertical: sigma(1),
            });
        }
    }
    None
}
