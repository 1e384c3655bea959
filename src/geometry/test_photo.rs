//! Photographs for tests: an independent little ray tracer (three-dimensional intersection, Phong shading
//! with suns and a uniform fill, a box-shaped pixel) and noise.

use std::f64::consts::PI;

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::camera::CameraModel;
use super::surface::Pose;
use crate::capture::{Camera, Object, Projection, Shape};
use crate::radiance::Radiance;

/// What stands before the camera.
#[derive(Clone)]
pub struct Scene {
    pub camera: Camera,
    pub object: Object,
    /// Direction (world, radians) and irradiance of each sun.
    pub suns: Vec<(f64, f64)>,
    /// Roll of the plane in which they stand about the optical axis, radians.
    pub roll: f64,
    /// Radiance of a diffuse surface under the fill.
    pub fill: f64,
    pub exponent: i32,
    /// Roughness of a GGX metal that stands in the place of the diffuse and glossy Phong surface.
    pub metal: Option<f64>,
    pub background: f64,
    /// Standard deviation of normal noise.
    pub noise: f64,
}

impl Scene {
    pub fn new(shape: Shape, size: [u32; 2]) -> Self {
        Self {
            camera: Camera {
                projection: Projection::Perspective {
                    focal_px: 0.85 * f64::from(size[0]) / 2.0 * 0.5979_f64 / 0.05,
                },
                image_size: size,
                principal_point_px: size.map(|s| f64::from(s) / 2.0),
                distortion: [0.0; 5],
                distance: 0.6,
                orbit_sigma_deg: 0.0,
            },
            object: Object {
                shape,
                radius: 0.05,
                mask: None,
            },
            suns: vec![(0.65, 3.0), (-1.83, 1.3)],
            roll: 0.0,
            fill: 0.05,
            exponent: 32,
            metal: None,
            background: 0.0,
            noise: 0.0,
        }
    }

    pub fn model(&self) -> CameraModel {
        CameraModel::new(&self.camera).unwrap()
    }

    /// Radiance along a ray, with the object at `pose` seen from `orbit`.
    fn radiance(
        &self,
        origin: Vector3<f64>,
        direction: Vector3<f64>,
        pose: &Pose,
        orbit: f64,
    ) -> f64 {
        let axis = match self.object.shape {
            Shape::Cylinder => Vector3::new(0.0, -pose.tilt.sin(), pose.tilt.cos()),
            Shape::Sphere => Vector3::zeros(),
        };
        let flat = |v: Vector3<f64>| v - axis * axis.dot(&v);
        let p = flat(origin - Vector3::from(pose.offset));
        let d = flat(direction);
        let r = self.object.radius * pose.radius_scale;
        let (a, b, c) = (d.norm_squared(), p.dot(&d), p.norm_squared() - r * r);
        let inside = b * b - a * c;
        if inside < 0.0 {
            return self.background;
        }
        let t = (-b - inside.sqrt()) / a;
        let normal = (p + d * t) / r;
        let view = -direction.normalize();
        let mirrored = normal * (2.0 * normal.dot(&view)) - view;
        let n = f64::from(self.exponent);
        let mut sum = self.fill;
        for (theta, irradiance) in &self.suns {
            let (across, towards) = (theta - orbit).sin_cos();
            let (up, right) = self.roll.sin_cos();
            let light = Vector3::new(towards, across * right, across * up);
            let cosine = normal.dot(&light);
            if cosine > 0.0 {
                let reflected = match self.metal {
                    Some(alpha) => metal(alpha, normal, light, view),
                    None => {
                        let lobe = mirrored.dot(&light).max(0.0).powi(self.exponent);
                        0.3 / PI + 0.4 * (n + 2.0) / (2.0 * PI) * lobe
                    }
                };
                sum += irradiance * cosine * reflected;
            }
        }
        sum
    }

    /// One photo; a pixel is the mean of 24 × 3 rays near the limb, of 3 × 1 elsewhere.
    pub fn photo(&self, pose: &Pose, orbit: f64, seed: u64) -> Radiance {
        let model = self.model();
        let [w, h] = self.camera.image_size;
        let geometry = super::surface::ViewGeometry::new(&model, &self.object, *pose, 0.0);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut value = Vec::with_capacity((w * h) as usize);
        for row in 0..h {
            for column in 0..w {
                let (u, v) = (f64::from(column), f64::from(row));
                let (across, down) = if geometry.miss([u + 0.5, v + 0.5]).abs() < 0.1 {
                    (24, 3)
                } else {
                    (3, 1)
                };
                let mut sum = 0.0;
                for j in 0..down {
                    for i in 0..across {
                        let ray = model.ray([
                            u + (f64::from(i) + 0.5) / f64::from(across),
                            v + (f64::from(j) + 0.5) / f64::from(down),
                        ]);
                        sum += self.radiance(ray.origin, ray.direction, pose, orbit);
                    }
                }
                let noise: f64 = StandardNormal.sample(&mut random);
                value.push((sum / f64::from(across * down) + self.noise * noise) as f32);
            }
        }
        Radiance {
            size: [w, h],
            rows: 0..h,
            channels: vec!["Y".into()],
            variance: vec![vec![(self.noise * self.noise) as f32; value.len()]],
            value: vec![value],
            shared: Vec::new(),
            noise_known: true,
        }
    }
}

/// GGX with Smith's shadowing and a reflectance of 1 (Walter et al., EGSR 2007, equations 20, 33, 34): its long tails
/// leave a limb far from the highlight dim, not black.
fn metal(alpha: f64, n: Vector3<f64>, light: Vector3<f64>, view: Vector3<f64>) -> f64 {
    let (ci, co) = (n.dot(&light), n.dot(&view).max(1e-6));
    let ch = n.dot(&(light + view).normalize());
    let a2 = alpha * alpha;
    let d = a2 / (PI * (ch * ch * (a2 - 1.0) + 1.0).powi(2));
    let g = |c: f64| 2.0 / (1.0 + (1.0 + a2 * (1.0 / (c * c) - 1.0)).sqrt());
    d * g(ci) * g(co) / (4.0 * ci * co)
}

/// Where a displaced object appears from `orbit`: `world` in metres, then the tilt.
pub fn seen_from(orbit: f64, world: [f64; 2], constant: f64, tilt: f64) -> Pose {
    let (sin, cos) = orbit.sin_cos();
    Pose {
        offset: [
            world[0] * cos + world[1] * sin,
            constant - world[0] * sin + world[1] * cos,
            0.0,
        ],
        tilt,
        ..Pose::nominal()
    }
}

/// Root mean square difference of α, degrees, over the pixels of a middle row that `truth` shows at
/// |θo′| ≤ 75°.
pub fn alpha_error_deg(scene: &Scene, truth: &Pose, found: &Pose) -> f64 {
    let model = scene.model();
    let [truth, found] =
        [truth, found].map(|p| super::surface::ViewGeometry::new(&model, &scene.object, *p, 0.0));
    let row = f64::from(scene.camera.image_size[1]) / 2.0;
    let (mut sum, mut n) = (0.0, 0.0);
    for column in 0..scene.camera.image_size[0] {
        let pixel = [f64::from(column) + 0.5, row];
        let Some(t) = truth.at(pixel) else { continue };
        if t.local.abs() <= 75_f64.to_radians() {
            let f = found
                .at(pixel)
                .map_or(1.0, |f| crate::angle::wrap(f.alpha - t.alpha));
            sum += f * f;
            n += 1.0;
        }
    }
    f64::sqrt(sum / n).to_degrees()
}
