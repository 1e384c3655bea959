//! The surface: from a pixel to (α, θo′), and back.
//!
//! Everything follows from one fact: a line of sight that passes the object's centre at the signed
//! distance b meets the circle of radius R with sin θo′ = −b/R, whatever the distance. So with θo the
//! direction back to the camera, α = θo − θo′ (eq. 1), without the point of intersection.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Vector2, Vector3};

use crate::angle::wrap;
use crate::capture::{Object, Shape};

use super::camera::{CameraModel, Ray};

/// Where the object is in one view, in camera axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// From the nominal centre of the orbit to the object's centre (for a cylinder: to the point of
    /// its axis at z = 0), metres: towards the camera, right, up.
    pub offset: [f64; 3],
    /// Turn of a cylinder's axis about the optical axis, radians, counter-clockwise in the image.
    pub tilt: f64,
    /// Apparent radius over the radius that the description predicts.
    pub radius_scale: f64,
    /// Standard deviation of `offset[1]`, metres.
    pub sigma_lateral: f64,
    /// Standard deviation of `tilt`, radians.
    pub sigma_tilt: f64,
    /// Standard deviation of `radius_scale`.
    pub sigma_radius_scale: f64,
}

impl Pose {
    /// The object exactly where the description puts it.
    pub fn nominal() -> Self {
        Self {
            offset: [0.0; 3],
            tilt: 0.0,
            radius_scale: 1.0,
            sigma_lateral: 0.0,
            sigma_tilt: 0.0,
            sigma_radius_scale: 0.0,
        }
    }
}

/// Left or right in the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Smaller column, θo′ = +π/2 at the limb.
    Left,
    /// Larger column, θo′ = −π/2 at the limb.
    Right,
}

impl Side {
    /// Both.
    pub const BOTH: [Self; 2] = [Self::Left, Self::Right];

    /// −1 for left, +1 for right: the sign of y.
    pub fn sign(self) -> f64 {
        match self {
            Self::Left => -1.0,
            Self::Right => 1.0,
        }
    }
}

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// In-plane angle of the outward normal from the camera axes' x, radians, in [−π, π): add the
    /// view's orbit angle to get the global α.
    pub alpha: f64,
    /// θo′: from the normal to the direction to the camera's centre, in the plane, radians.
    pub local: f64,
    /// Out of the plane, radians: of the direction to the camera for a cylinder, of the normal for a
    /// sphere. Zero on the cross-section.
    pub elevation: f64,
}

/// A point of the cross-section and where it is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrossSectionPoint {
    /// Angle of the outward normal from the camera axes' x, radians.
    pub alpha: f64,
    /// Position in the image, pixels (may lie outside of it).
    pub pixel: [f64; 2],
}

/// One view's camera, object and pose, prepared for many pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewGeometry {
    camera: CameraModel,
    shape: Shape,
    radius: f64,
    centre: Vector3<f64>,
    /// Axes of the measurement plane (towards the camera, right) and its normal.
    plane: [Vector3<f64>; 3],
    pose: Pose,
}

impl ViewGeometry {
    /// `plane_roll` turns a sphere's measurement plane about the line from the camera to the sphere's
    /// centre, radians, counter-clockwise in the image; a cylinder's plane is across its axis.
    pub fn new(camera: &CameraModel, object: &Object, pose: Pose, plane_roll: f64) -> Self {
        let mut centre = Vector3::from(pose.offset);
        let x = Vector3::x();
        let plane = match object.shape {
            Shape::Cylinder => {
                let (sin, cos) = pose.tilt.sin_cos();
                let axis = Vector3::new(0.0, -sin, cos);
                // The point of the axis in the plane that holds the camera's centre.
                centre -= axis * axis.dot(&centre);
                [x, Vector3::new(0.0, cos, sin), axis]
            }
            Shape::Sphere => {
                let to_camera = if camera.is_orthographic() {
                    x
                } else {
                    camera.centre() - centre
                };
                let (sin, cos) = plane_roll.sin_cos();
                let normal = to_camera
                    .cross(&Vector3::new(0.0, cos, sin))
                    .try_normalize(0.0)
                    .unwrap_or(Vector3::z());
                let e1 = (x - normal * normal.x).try_normalize(0.0).unwrap_or(x);
                [e1, normal.cross(&e1), normal]
            }
        };
        Self {
            camera: camera.clone(),
            shape: object.shape,
            radius: object.radius * pose.radius_scale,
            centre,
            plane,
            pose,
        }
    }

    /// The pose it was made from.
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// The camera it was made from.
    pub fn camera(&self) -> &CameraModel {
        &self.camera
    }

    /// Whether the object is a sphere.
    pub fn is_sphere(&self) -> bool {
        self.shape == Shape::Sphere
    }

    /// Radius used, metres: the description's times the pose's scale.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    fn in_plane(&self, v: Vector3<f64>) -> Vector2<f64> {
        Vector2::new(v.dot(&self.plane[0]), v.dot(&self.plane[1]))
    }

    /// From the object's centre to the camera's, a unit vector; for parallel rays the way back along them.
    pub fn to_camera(&self) -> Vector3<f64> {
        if self.camera.is_orthographic() {
            Vector3::x()
        } else {
            (self.camera.centre() - self.centre)
                .try_normalize(0.0)
                .unwrap_or(Vector3::x())
        }
    }

    /// Angle of a direction's part in the measurement plane from the camera axes' x, radians.
    pub fn angle_of(&self, direction: Vector3<f64>) -> f64 {
        let part = self.in_plane(direction);
        part.y.atan2(part.x)
    }

    /// A sphere's outward normal that the pixel shows, a unit vector in camera axes; `None` if its line of sight
    /// misses the sphere.
    pub fn normal(&self, pixel: [f64; 2]) -> Option<Vector3<f64>> {
        self.towards(&self.camera.ray(pixel))
            .map(|n| n / self.radius)
    }

    /// From a sphere's centre to where a ray meets it.
    fn towards(&self, ray: &Ray) -> Option<Vector3<f64>> {
        let from_centre = ray.origin - self.centre;
        let squared = ray.direction.norm_squared();
        let along = from_centre.dot(&ray.direction);
        let inside =
            along * along - squared * (from_centre.norm_squared() - self.radius * self.radius);
        if inside.is_nan() || inside < 0.0 {
            return None;
        }
        let depth = (-along - inside.sqrt()) / squared;
        Some(from_centre + ray.direction * depth)
    }

    /// What the pixel shows; `None` if its line of sight misses the object.
    pub fn at(&self, pixel: [f64; 2]) -> Option<SurfacePoint> {
        let ray = self.camera.ray(pixel);
        match self.shape {
            Shape::Cylinder => {
                let sine = self.sin_local_of(&ray);
                if sine.is_nan() || sine.abs() > 1.0 {
                    return None;
                }
                let local = sine.asin();
                let back = self.in_plane(-ray.direction);
                Some(SurfacePoint {
                    alpha: wrap(back.y.atan2(back.x) - local),
                    local,
                    elevation: (-ray.direction.dot(&self.plane[2])).atan2(back.norm()),
                })
            }
            Shape::Sphere => {
                let normal = self.towards(&ray)?;
                let n = self.in_plane(normal);
                let back = self.in_plane(-ray.direction);
                Some(SurfacePoint {
                    alpha: n.y.atan2(n.x),
                    local: (n.x * back.y - n.y * back.x).atan2(n.dot(&back)),
                    elevation: normal.dot(&self.plane[2]).atan2(n.norm()),
                })
            }
        }
    }

    /// sin θo′ of the line of sight projected on the plane; beyond ±1 it passes the cross-section by.
    /// Costs no trigonometry: for footprints, where it is asked at many positions within a pixel.
    pub fn sin_local(&self, pixel: [f64; 2]) -> f64 {
        self.sin_local_of(&self.camera.ray(pixel))
    }

    fn sin_local_of(&self, ray: &Ray) -> f64 {
        let p = self.in_plane(ray.origin - self.centre);
        let d = self.in_plane(ray.direction);
        (p.y * d.x - p.x * d.y) / (d.norm() * self.radius)
    }

    /// By how much the line of sight misses the object, relative to its radius: the squared distance to
    /// the axis or the centre over R², minus 1. Negative on the object; smooth across the limb.
    pub fn miss(&self, pixel: [f64; 2]) -> f64 {
        match self.shape {
            Shape::Cylinder => self.sin_local(pixel).powi(2) - 1.0,
            Shape::Sphere => {
                let ray = self.camera.ray(pixel);
                let moment = (ray.origin - self.centre).cross(&ray.direction);
                moment.norm_squared() / (ray.direction.norm_squared() * self.radius.powi(2)) - 1.0
            }
        }
    }

    /// The point of the cross-section seen at θo′ = `local` (radians), by the law of sines in the
    /// triangle of centre, surface point and camera: α = β − θo′ + asin(R sin θo′ / d), β being the
    /// direction to the camera and d its distance from the centre. `None` beyond ±π/2, or if the camera
    /// is inside the object.
    pub fn trace(&self, local: f64) -> Option<CrossSectionPoint> {
        let alpha = self.alpha_at(local)?;
        let (sin, cos) = alpha.sin_cos();
        let normal = self.plane[0] * cos + self.plane[1] * sin;
        Some(CrossSectionPoint {
            alpha,
            pixel: self.camera.project(self.centre + normal * self.radius)?,
        })
    }

    fn alpha_at(&self, local: f64) -> Option<f64> {
        if local.is_nan() || local.abs() > FRAC_PI_2 {
            return None;
        }
        if self.camera.is_orthographic() {
            return Some(wrap(-local));
        }
        let to_camera = self.in_plane(self.camera.centre() - self.centre);
        let ratio = self.radius / to_camera.norm();
        (ratio < 1.0)
            .then(|| wrap(to_camera.y.atan2(to_camera.x) - local + (ratio * local.sin()).asin()))
    }

    /// The limb of the cross-section.
    pub fn limb(&self, side: Side) -> Option<CrossSectionPoint> {
        self.trace(-side.sign() * FRAC_PI_2)
    }

    /// Half the width of the cross-section in the image, pixels.
    pub fn radius_px(&self) -> Option<f64> {
        let [ul, vl] = self.limb(Side::Left)?.pixel;
        let [ur, vr] = self.limb(Side::Right)?.pixel;
        Some(0.5 * (ur - ul).hypot(vr - vl))
    }

    /// Column at which the image row position `row` crosses the outline, pixels; `None` where it does
    /// not (above or below a sphere).
    pub fn limb_at_row(&self, row: f64, side: Side) -> Option<f64> {
        let [u0, v0] = self.camera.project(self.centre)?;
        // A cylinder's axis leans; start from where it is at this row.
        let u0 = match self.shape {
            Shape::Cylinder => u0 + self.pose.tilt.tan() * (row - v0),
            Shape::Sphere => u0,
        };
        let reach = self.radius * self.nominal_px_per_metre();
        self.limb_from(u0 + side.sign() * 1.5 * reach, row, side)
    }

    /// The same in a fraction of the time, from a column near it, such as that in the row before.
    pub fn limb_at_row_near(&self, near: f64, row: f64, side: Side) -> Option<f64> {
        self.limb_from(near, row, side)
            .or_else(|| self.limb_at_row(row, side))
    }

    fn limb_from(&self, start: f64, row: f64, side: Side) -> Option<f64> {
        // Newton's method on a function that is convex about the limb: after the first step it comes in monotonically from outside.
        let mut u = start;
        let h = 1e-4 * self.radius * self.nominal_px_per_metre();
        for iteration in 0..40 {
            let miss = self.miss([u, row]);
            let slope = (self.miss([u + h, row]) - self.miss([u - h, row])) / (2.0 * h);
            let step = miss / slope;
            if !step.is_finite() || slope * side.sign() <= 0.0 {
                return None;
            }
            if step.abs() < 1e-9 {
                // Of an upright limb all rows have the same column, to the last bit.
                return Some(if iteration == 0 { u } else { u - step });
            }
            u -= step;
        }
        None
    }

    fn nominal_px_per_metre(&self) -> f64 {
        let depth = if self.camera.is_orthographic() {
            self.camera.distance()
        } else {
            self.camera.distance() - self.centre.x
        };
        self.camera.distance() / (depth * self.camera.metres_per_px())
    }

    /// Standard deviation of α (and of θo′) at `local` from the pose, radians: a shift of the object
    /// across the line of sight by δ turns the normal seen in a pixel by δ / (R cos θo′), and a radius
    /// wrong by the factor 1 + s by s tan θo′.
    pub fn sigma_alpha(&self, local: f64) -> f64 {
        let cosine = local.cos().max(0.0);
        let shift = self.pose.sigma_lateral / (self.radius * cosine);
        let scale = self.pose.sigma_radius_scale * local.sin() / cosine;
        shift.hypot(scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Camera, Projection};

    fn camera(perspective: bool, distortion: [f64; 5]) -> CameraModel {
        CameraModel::new(&Camera {
            projection: if perspective {
                Projection::Perspective { focal_px: 2400.0 }
            } else {
                Projection::Orthographic {
                    metres_per_px: 2.5e-4,
                }
            },
            image_size: [960, 480],
            principal_point_px: [483.0, 236.0],
            distortion,
            distance: 0.3,
            orbit_sigma_deg: 0.0,
        })
        .unwrap()
    }

    fn object(shape: Shape) -> Object {
        Object {
            shape,
            radius: 0.05,
            mask: None,
        }
    }

    fn pose() -> Pose {
        Pose {
            offset: [0.003, -0.002, 0.001],
            tilt: 0.03,
            radius_scale: 1.01,
            ..Pose::nominal()
        }
    }

    fn all() -> Vec<ViewGeometry> {
        let mut all = Vec::new();
        for (perspective, distortion) in [
            (true, [0.0; 5]),
            (true, [-0.2, 0.05, 0.001, -0.001, 0.0]),
            (false, [0.0; 5]),
        ] {
            for shape in [Shape::Cylinder, Shape::Sphere] {
                for roll in [0.0, 0.7, -2.0] {
                    let camera = camera(perspective, distortion);
                    all.push(ViewGeometry::new(&camera, &object(shape), pose(), roll));
                }
            }
        }
        all
    }

    #[test]
    fn tracing_and_looking_agree() {
        for g in all() {
            for k in -89..=89 {
                let local = f64::from(k).to_radians();
                let traced = g.trace(local).unwrap();
                let seen = g.at(traced.pixel).unwrap();
                // A pixel position near 1000 carries 1e-13 px; at 89° that is 1e-13 / (400 px · cos 89°)
                // = 1.5e-14 rad. The rest is a few roundings of the distortion's Newton step.
                let bound = 1e-12;
                assert!(
                    wrap(seen.alpha - traced.alpha).abs() < bound,
                    "{k} {seen:?} {traced:?}"
                );
                assert!((seen.local - local).abs() < bound, "{k} {seen:?}");
                assert!(seen.elevation.abs() < bound, "{k} {seen:?}");
                assert!((g.sin_local(traced.pixel) - local.sin()).abs() < bound);
            }
        }
    }

    /// The slow oracle: intersect in three dimensions, take the normal, project it on the plane.
    #[test]
    fn the_closed_form_is_the_intersection() {
        let camera = camera(true, [0.0; 5]);
        let pose = pose();
        let g = ViewGeometry::new(&camera, &object(Shape::Cylinder), pose, 0.0);
        let axis = Vector3::new(0.0, -pose.tilt.sin(), pose.tilt.cos());
        for (u, v) in [(300.5, 20.5), (483.0, 236.0), (700.5, 400.5)] {
            let ray = camera.ray([u, v]);
            // Bisect the distance to the axis between the camera and the nearest approach.
            let distance = |t: f64| {
                let p = ray.origin + ray.direction * t - Vector3::from(pose.offset);
                (p - axis * axis.dot(&p)).norm() - 0.05 * pose.radius_scale
            };
            let (mut near, mut far) = (0.0, 0.297);
            for _ in 0..80 {
                let t = 0.5 * (near + far);
                if distance(t) > 0.0 { near = t } else { far = t }
            }
            let point = ray.origin + ray.direction * near;
            let p = point - Vector3::from(pose.offset);
            let normal = (p - axis * axis.dot(&p)).normalize();
            let right = axis.cross(&Vector3::x());
            let view = camera.centre() - point;
            let alpha = normal.dot(&right).atan2(normal.x);
            let theta = view.dot(&right).atan2(view.x);
            let seen = g.at([u, v]).unwrap();
            assert!((seen.alpha - alpha).abs() < 1e-12);
            assert!((seen.local - (theta - alpha)).abs() < 1e-12);
            let elevation = (view.normalize().dot(&axis)).asin();
            assert!((seen.elevation - elevation).abs() < 1e-12);
        }
    }

    #[test]
    fn image_right_is_larger_alpha_and_smaller_local() {
        for g in all().iter().step_by(3) {
            let right = g.trace(-0.5).unwrap();
            let left = g.trace(0.5).unwrap();
            assert!(right.pixel[0] > left.pixel[0] && right.alpha > left.alpha);
        }
    }

    #[test]
    fn a_positive_roll_turns_the_trace_counter_clockwise() {
        let camera = camera(true, [0.0; 5]);
        let g = ViewGeometry::new(&camera, &object(Shape::Sphere), Pose::nominal(), 0.5);
        let [u, v] = g.trace(-0.9).unwrap().pixel;
        // Rows grow downwards.
        assert!(((236.0 - v) / (u - 483.0) - 0.5_f64.tan()).abs() < 1e-12);
    }

    /// The outline of a sphere by brute force: the last pixel position along a row that hits it.
    #[test]
    fn the_limb_is_where_lines_of_sight_begin_to_miss() {
        for g in all() {
            for side in Side::BOTH {
                for row in [100.25, 236.0, 330.5] {
                    let found = g.limb_at_row(row, side).unwrap();
                    let middle = g.trace(0.0).unwrap().pixel[0];
                    let (mut hit, mut missed) = (middle, middle + side.sign() * 700.0);
                    assert!(g.at([hit, row]).is_some() && g.at([missed, row]).is_none());
                    for _ in 0..80 {
                        let u = 0.5 * (hit + missed);
                        if g.at([u, row]).is_some() {
                            hit = u
                        } else {
                            missed = u
                        }
                    }
                    // Newton stops at 1e-9 px; the miss function itself is good to 1e-13 of 400 px.
                    assert!((found - hit).abs() < 2e-9, "{row} {side:?}: {found} {hit}");
                }
            }
        }
        // And a sphere's limb is nearer than 90° from the axis: cos of the angle is R/d.
        let g = ViewGeometry::new(
            &camera(true, [0.0; 5]),
            &object(Shape::Sphere),
            Pose::nominal(),
            0.3,
        );
        let limb = g.limb(Side::Right).unwrap();
        assert!((limb.alpha.cos() - 0.05 / 0.3).abs() < 1e-12);
    }

    #[test]
    fn sigma_is_the_derivative() {
        let camera = camera(true, [0.0; 5]);
        let cylinder = object(Shape::Cylinder);
        let at = |lateral: f64, scale: f64, pixel: [f64; 2]| {
            let pose = Pose {
                offset: [0.0, lateral, 0.0],
                radius_scale: 1.0 + scale,
                sigma_lateral: 1e-6,
                ..Pose::nominal()
            };
            let g = ViewGeometry::new(&camera, &cylinder, pose, 0.0);
            (g.at(pixel).unwrap(), g)
        };
        let pixel = at(0.0, 0.0, [0.0; 2].map(|_| 483.0))
            .1
            .trace(1.1)
            .unwrap()
            .pixel;
        let (seen, g) = at(0.0, 0.0, pixel);
        let moved = (at(1e-6, 0.0, pixel).0.alpha - seen.alpha).abs();
        // The shift is across the image, the line of sight here leans by asin(R sin θ′/d) = 8.5°: its
        // cosine is 0.989.
        assert!((g.sigma_alpha(seen.local) / moved - 1.0).abs() < 0.015);
    }
}
