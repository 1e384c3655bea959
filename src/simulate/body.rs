//! The object as a solid: where a line of sight meets it, and smooth coordinates on what is visible.
//!
//! Independent of the measurement's own geometry, which never computes the point of intersection: rays
//! are cut with the quadric in 3-D.

use nalgebra::Vector3;

use crate::capture::{Object, Shape};
use crate::geometry::{CameraModel, Pose, Ray};

/// What a line of sight meets, in camera axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    /// Outward unit normal.
    pub normal: Vector3<f64>,
    /// Unit vector back along the line of sight.
    pub view: Vector3<f64>,
    /// From the object's centre to the point, metres.
    pub point: Vector3<f64>,
}

/// The object in one view, in camera axes.
#[derive(Clone, Debug)]
pub(super) struct Body {
    shape: Shape,
    radius: f64,
    centre: Vector3<f64>,
    camera: Vector3<f64>,
    orthographic: bool,
    /// Towards the camera, right, up, turned with a cylinder's axis; for a sphere the first points from
    /// its centre to the camera.
    frame: [Vector3<f64>; 3],
}

impl Body {
    pub(super) fn new(camera: &CameraModel, object: &Object, pose: &Pose) -> Self {
        let centre = Vector3::from(pose.offset);
        let x = Vector3::x();
        let frame = match object.shape {
            Shape::Cylinder => {
                let (sin, cos) = pose.tilt.sin_cos();
                [x, Vector3::new(0.0, cos, sin), Vector3::new(0.0, -sin, cos)]
            }
            Shape::Sphere => {
                let towards = if camera.is_orthographic() {
                    x
                } else {
                    (camera.centre() - centre).try_normalize(0.0).unwrap_or(x)
                };
                let right = Vector3::z()
                    .cross(&towards)
                    .try_normalize(0.0)
                    .unwrap_or(Vector3::y());
                [towards, right, towards.cross(&right)]
            }
        };
        Self {
            shape: object.shape,
            radius: object.radius * pose.radius_scale,
            centre,
            camera: camera.centre(),
            orthographic: camera.is_orthographic(),
            frame,
        }
    }

    /// Where the line of sight first meets the object.
    pub(super) fn hit(&self, ray: &Ray) -> Option<Hit> {
        let from_centre = ray.origin - self.centre;
        let (p, d) = match self.shape {
            Shape::Cylinder => (self.across(from_centre), self.across(ray.direction)),
            Shape::Sphere => (from_centre, ray.direction),
        };
        let (a, b) = (d.norm_squared(), p.dot(&d));
        // |p × d|² instead of b² − a c: no cancellation far from the object.
        let inside = a * self.radius * self.radius - p.cross(&d).norm_squared();
        if !(inside >= 0.0) {
            return None;
        }
        let depth = (-b - inside.sqrt()) / a;
        Some(Hit {
            normal: (p + d * depth) / self.radius,
            view: -ray.direction.normalize(),
            point: from_centre + ray.direction * depth,
        })
    }

    fn across(&self, v: Vector3<f64>) -> Vector3<f64> {
        let axis = self.frame[2];
        v - axis * axis.dot(&v)
    }

    /// Coordinates (φ, τ) of what is visible, radians, in which reflected light is smooth up to the limb,
    /// where φ = ±90°. Cylinder: φ is the angle in its cross-section from the normal to the direction to the
    /// camera, τ that direction's elevation. Sphere: the disc of the visible cap, seen from the camera,
    /// is (sin φ cos τ, sin τ).
    pub(super) fn chart(&self, hit: &Hit) -> [f64; 2] {
        let [e1, e2, e3] = self.frame;
        match self.shape {
            Shape::Cylinder => {
                let n = [hit.normal.dot(&e1), hit.normal.dot(&e2)];
                let v = [hit.view.dot(&e1), hit.view.dot(&e2)];
                let local = (n[0] * v[1] - n[1] * v[0]).atan2(n[0] * v[0] + n[1] * v[1]);
                [local, hit.view.dot(&e3).atan2(v[0].hypot(v[1]))]
            }
            Shape::Sphere => {
                let k = self.cap();
                let across = hit.normal.dot(&e2) / k;
                let up = (hit.normal.dot(&e3) / k).clamp(-1.0, 1.0);
                let depth = (1.0 - across * across - up * up).max(0.0).sqrt();
                [across.atan2(depth), up.asin()]
            }
        }
    }

    /// Radius of the visible cap's rim over the sphere's.
    fn cap(&self) -> f64 {
        if self.orthographic {
            return 1.0;
        }
        let ratio = self.radius / (self.camera - self.centre).norm();
        (1.0 - ratio * ratio).max(0.0).sqrt()
    }

    /// What the line of sight meets at these coordinates; the inverse of [`Body::chart`].
    pub(super) fn at(&self, [phi, tau]: [f64; 2]) -> Hit {
        let [e1, e2, e3] = self.frame;
        match self.shape {
            Shape::Cylinder => {
                let exitant = if self.orthographic {
                    0.0
                } else {
                    let to_camera = self.across(self.camera - self.centre);
                    let towards = to_camera.dot(&e2).atan2(to_camera.dot(&e1));
                    towards + (self.radius * phi.sin() / to_camera.norm()).asin()
                };
                let on_circle = |angle: f64| e1 * angle.cos() + e2 * angle.sin();
                let normal = on_circle(exitant - phi);
                Hit {
                    normal,
                    view: on_circle(exitant) * tau.cos() + e3 * tau.sin(),
                    point: normal * self.radius,
                }
            }
            Shape::Sphere => {
                let k = self.cap();
                let (across, up) = (k * phi.sin() * tau.cos(), k * tau.sin());
                let depth = (1.0 - across * across - up * up).max(0.0).sqrt();
                let normal = e1 * depth + e2 * across + e3 * up;
                let point = normal * self.radius;
                let view = if self.orthographic {
                    e1
                } else {
                    (self.camera - self.centre - point)
                        .try_normalize(0.0)
                        .unwrap_or(e1)
                };
                Hit {
                    normal,
                    view,
                    point,
                }
            }
        }
    }

    pub(super) fn is_sphere(&self) -> bool {
        self.shape == Shape::Sphere
    }

    pub(super) fn centre(&self) -> Vector3<f64> {
        self.centre
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Camera, Projection};
    use crate::geometry::ViewGeometry;

    fn camera(orthographic: bool) -> CameraModel {
        CameraModel::new(&Camera {
            projection: if orthographic {
                Projection::Orthographic {
                    metres_per_px: 2.4e-4,
                }
            } else {
                Projection::Perspective { focal_px: 2400.0 }
            },
            image_size: [480, 300],
            principal_point_px: [240.0, 150.0],
            distortion: [0.0; 5],
            distance: 0.6,
            orbit_sigma_deg: 0.0,
        })
        .unwrap()
    }

    fn cases() -> Vec<(CameraModel, Object, Pose)> {
        let mut cases = Vec::new();
        for orthographic in [false, true] {
            for (shape, tilt) in [
                (Shape::Cylinder, 0.0),
                (Shape::Cylinder, 0.03),
                (Shape::Sphere, 0.0),
            ] {
                for offset in [[0.0; 3], [0.004, -0.003, 0.002]] {
                    cases.push((
                        camera(orthographic),
                        Object {
                            shape,
                            radius: 0.05,
                            mask: None,
                        },
                        Pose {
                            offset,
                            tilt,
                            ..Pose::nominal()
                        },
                    ));
                }
            }
        }
        cases
    }

    #[test]
    fn the_chart_is_inverted_and_rays_meet_what_it_says() {
        for (camera, object, pose) in cases() {
            let body = Body::new(&camera, &object, &pose);
            let mut met = 0;
            for u in (0..480).step_by(7) {
                for v in (0..300).step_by(11) {
                    let Some(hit) = body.hit(&camera.ray([f64::from(u), f64::from(v)])) else {
                        continue;
                    };
                    met += 1;
                    let again = body.at(body.chart(&hit));
                    // Near the limb a rounding of the sine is its root in the angle: √1e-16, times the cosine.
                    let tolerance = 1e-7;
                    assert!(
                        (again.normal - hit.normal).norm() < tolerance,
                        "{hit:?} {again:?}"
                    );
                    assert!(
                        (again.view - hit.view).norm() < tolerance,
                        "{hit:?} {again:?}"
                    );
                }
            }
            assert!(met > 1000);
        }
    }

    #[test]
    fn on_the_cross_section_it_agrees_with_the_measurement_s_geometry() {
        for (camera, object, pose) in cases() {
            let body = Body::new(&camera, &object, &pose);
            let geometry = ViewGeometry::new(&camera, &object, pose, 0.0);
            let plane_normal = if body.is_sphere() {
                let to_camera = if camera.is_orthographic() {
                    Vector3::x()
                } else {
                    camera.centre() - body.centre()
                };
                to_camera.cross(&Vector3::y()).normalize()
            } else {
                body.frame[2]
            };
            for degrees in (-85..=85).step_by(5) {
                let local = f64::from(degrees).to_radians();
                let seen = geometry.trace(local).unwrap();
                let hit = body.hit(&camera.ray(seen.pixel)).unwrap();
                let e1 = (Vector3::x() - plane_normal * plane_normal.x).normalize();
                let e2 = plane_normal.cross(&e1);
                let alpha = hit.normal.dot(&e2).atan2(hit.normal.dot(&e1));
                assert!(
                    (alpha - seen.alpha).abs() < 1e-9,
                    "{object:?} {pose:?} {degrees}"
                );
                assert!((hit.normal.dot(&hit.view) - local.cos()).abs() < 1e-9);
            }
        }
    }
}
