//! The picture that falls on the sensor: the mean radiance over every pixel.

use std::num::NonZeroUsize;
use std::path::Path;

use rayon::prelude::*;

use super::blemish::{Blemishes, Dust, Texture};
use super::body::Body;
use super::chart::SmoothPart;
use super::shade::{Plane, Shader};
use crate::brdf::Model;
use crate::capture::{Camera, Object};
use crate::error::{Error, Result};
use crate::geometry::{CameraModel, Pose, Side, ViewGeometry};
use crate::lighting::Lighting;

/// Nodes across a pixel, and across one near the limb.
const ACROSS: usize = 2;
const ACROSS_AT_LIMB: usize = 6;
/// Nodes down a pixel.
const DOWN: usize = 2;
/// Nodes across a pixel with specks or a fine texture; down it, each node becomes two.
const FINE: usize = 4;
/// Share of the half width beyond which a pixel counts as near the limb: sin 60°.
const NEAR_LIMB: f64 = 0.866;

/// What is photographed, and with what.
#[derive(Clone, Debug)]
pub struct Renderer {
    camera: CameraModel,
    object: Object,
    shader: Shader,
    background: Vec<f64>,
    blemishes: Blemishes,
}

/// Where the camera and the object really were in one view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stand {
    /// Direction from the orbit's centre to the camera in the frame in which the light stands still, radians.
    pub orbit: f64,
    /// The object in camera axes.
    pub pose: Pose,
    /// Roll of the light's plane about the optical axis, radians.
    pub plane_roll: f64,
}

/// A picture without a camera's faults: mean radiance of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Channel names.
    pub channels: Vec<String>,
    /// Radiance, W m⁻² sr⁻¹, \[channel\]\[row-major pixel\].
    pub values: Vec<Vec<f32>>,
}

impl Renderer {
    /// `folder`: where a table of the material is looked for.
    ///
    /// # Errors
    /// An unusable camera, a BRDF that does not fit the light's channels, a mirror under a directional source.
    pub fn new(
        camera: &Camera,
        object: &Object,
        material: &Model,
        lighting: &Lighting,
        folder: &Path,
    ) -> Result<Self> {
        if !(object.radius > 0.0 && object.radius < camera.distance) {
            return Err(Error::input(format!(
                "expected a radius between 0 and the camera's distance of {} m, found {}",
                camera.distance, object.radius
            ))
            .key("object.radius"));
        }
        Ok(Self {
            camera: CameraModel::new(camera)?,
            object: object.clone(),
            shader: Shader::new(material, lighting, folder)?,
            background: vec![0.0; lighting.channels.len()],
            blemishes: Blemishes::default(),
        })
    }

    /// The same before a background of this radiance, W m⁻² sr⁻¹ per channel (one value serves all).
    #[must_use]
    pub fn with_background(mut self, radiance: &[f64]) -> Self {
        let value = |c: usize| radiance.get(c).or(radiance.first()).copied();
        for (c, b) in self.background.iter_mut().enumerate() {
            *b = value(c).unwrap_or(0.0);
        }
        self
    }

    /// The same with texture and dust on the object.
    #[must_use]
    pub fn with_blemishes(
        mut self,
        texture: Option<Texture>,
        dust: Option<Dust>,
        seed: u64,
    ) -> Self {
        let half_height = 0.6 * self.camera.size()[1] * self.camera.metres_per_px();
        let (shape, radius) = (self.object.shape, self.object.radius);
        self.blemishes = Blemishes::new(texture, dust, shape, radius, half_height, seed);
        self
    }

    /// Whether the material is evaluated in 3-D. Tables are known in the plane of incidence only: normals and
    /// directions out of the plane are projected on it.
    pub fn is_spatial(&self) -> bool {
        self.shader.is_spatial()
    }

    /// Channel names.
    pub fn channels(&self) -> &[String] {
        self.shader.channels()
    }

    /// The picture of one view: box-shaped pixels, the limb's coverage exact along each sub-row.
    pub fn view(&self, stand: &Stand) -> Picture {
        let size = self.camera.size().map(|n| n as u32);
        let body = Body::new(&self.camera, &self.object, &stand.pose);
        let plane = Plane::new(stand.orbit, stand.plane_roll);
        let scene = Scene {
            renderer: self,
            smooth: SmoothPart::new(&self.shader, &body, &self.camera, &plane),
            geometry: ViewGeometry::new(&self.camera, &self.object, stand.pose, stand.plane_roll),
            body,
            plane,
            rules: Rules::new(),
        };
        let channels = self.channels().len();
        let rows: Vec<Vec<f32>> = (0..size[1])
            .into_par_iter()
            .map(|row| scene.row(row, size[0]))
            .collect();
        let plane_of = |c: usize| {
            rows.iter()
                .flat_map(|row| row.iter().skip(c).step_by(channels.max(1)).copied())
                .collect()
        };
        Picture {
            size,
            channels: self.channels().to_vec(),
            values: (0..channels).map(plane_of).collect(),
        }
    }
}

/// Nodes and weights on [0, 1].
type Rule = Vec<(f64, f64)>;

fn gauss(n: usize) -> Rule {
    let n = NonZeroUsize::new(n).unwrap_or(NonZeroUsize::MIN);
    gauss_quad::GaussLegendre::new(n)
        .iter()
        .map(|(x, w)| (0.5 + 0.5 * x, 0.5 * w))
        .collect()
}

/// How a pixel is sampled.
struct Rules {
    down: Rule,
    across: Rule,
    /// Across a pixel with specks or a texture finer than the pixel.
    fine: Rule,
    limb: Rule,
    /// Where no limb can be found along the row: plain steps.
    plain: Rule,
}

impl Rules {
    fn new() -> Self {
        Self {
            down: gauss(DOWN),
            across: gauss(ACROSS),
            fine: gauss(FINE),
            limb: gauss(ACROSS_AT_LIMB),
            plain: (0..16)
                .map(|k| ((f64::from(k) + 0.5) / 16.0, 1.0 / 16.0))
                .collect(),
        }
    }
}

/// All that one view's rows share.
struct Scene<'a> {
    renderer: &'a Renderer,
    body: Body,
    geometry: ViewGeometry,
    plane: Plane,
    smooth: Option<SmoothPart>,
    rules: Rules,
}

impl Scene<'_> {
    /// Radiances of a row, \[pixel\]\[channel\].
    fn row(&self, row: u32, width: u32) -> Vec<f32> {
        let channels = self.renderer.background.len();
        let mut sums = vec![0.0; width as usize * channels];
        for &(y, weight) in &self.rules.down {
            let v = f64::from(row) + y;
            let limbs = Side::BOTH.map(|side| self.geometry.limb_at_row(v, side));
            for (column, sum) in (0..width).zip(sums.chunks_exact_mut(channels.max(1))) {
                let from = f64::from(column);
                match limbs {
                    [Some(left), Some(right)] if left < right => {
                        self.between(from, v, [left, right], weight, sum);
                    }
                    _ => self.stratified(from, v, weight, sum),
                }
            }
        }
        sums.into_iter().map(|s| s as f32).collect()
    }

    /// A pixel's sub-row between limbs that are known: on the object's side of each the position is
    /// limb ± w², in which radiance is smooth, for the normal turns with the root of the distance.
    fn between(&self, from: f64, v: f64, [left, right]: [f64; 2], weight: f64, sum: &mut [f64]) {
        let (a, b) = (from.max(left), (from + 1.0).min(right));
        if a >= b {
            self.add_background(weight, sum);
            return;
        }
        if b - a < 1.0 {
            self.add_background(weight * (1.0 - (b - a)), sum);
        }
        let (middle, half) = (0.5 * (left + right), 0.5 * (right - left));
        if (a - middle).abs().max((b - middle).abs()) < NEAR_LIMB * half {
            self.interior([a, b], v, weight, sum);
            return;
        }
        for (limb, sign, p, q) in [
            (left, 1.0, a, b.min(middle)),
            (right, -1.0, b, a.max(middle)),
        ] {
            // Distances from the limb, and their roots.
            let (near, far) = (sign * (p - limb), sign * (q - limb));
            if far <= near {
                continue;
            }
            let (r0, r1) = (near.max(0.0).sqrt(), far.sqrt());
            for &(x, w) in &self.rules.limb {
                let r = r0 + x * (r1 - r0);
                let u = limb + sign * r * r;
                self.add_ray([u, v], weight * w * 2.0 * r * (r1 - r0), None, sum);
            }
        }
    }

    /// A pixel's sub-row away from the limb.
    fn interior(&self, [a, b]: [f64; 2], v: f64, weight: f64, sum: &mut [f64]) {
        let camera = &self.renderer.camera;
        let blemishes = &self.renderer.blemishes;
        let mut factor = None;
        if !blemishes.is_none() {
            let middle = self.body.hit(&camera.ray([0.5 * (a + b), v]));
            factor = middle.and_then(|hit| {
                let point = self.plane.still(hit.point);
                // Half a pixel's diagonal, as it lies on a surface up to 60° off.
                let reach = 1.2 * camera.metres_per_px();
                blemishes
                    .is_plain(point, reach)
                    .then(|| blemishes.factor(point))
            });
            if factor.is_none() {
                for row in [v - 0.125, v + 0.125] {
                    for &(x, w) in &self.rules.fine {
                        let part = 0.5 * weight * w * (b - a);
                        self.add_ray([a + x * (b - a), row], part, None, sum);
                    }
                }
                return;
            }
        }
        for &(x, w) in &self.rules.across {
            self.add_ray([a + x * (b - a), v], weight * w * (b - a), factor, sum);
        }
    }

    fn stratified(&self, from: f64, v: f64, weight: f64, sum: &mut [f64]) {
        for &(x, w) in &self.rules.plain {
            self.add_ray([from + x, v], weight * w, None, sum);
        }
    }

    fn add_background(&self, weight: f64, sum: &mut [f64]) {
        for (sum, b) in sum.iter_mut().zip(&self.renderer.background) {
            *sum += weight * b;
        }
    }

    /// `factor` is that of the blemishes if it is known already.
    fn add_ray(&self, pixel: [f64; 2], weight: f64, factor: Option<f64>, sum: &mut [f64]) {
        let ray = self.renderer.camera.ray(pixel);
        let Some(hit) = self.body.hit(&ray) else {
            self.add_background(weight, sum);
            return;
        };
        // Few channels need no allocation.
        const AT_ONCE: usize = 16;
        let mut small = [0.0; AT_ONCE];
        let mut large;
        let radiance = if sum.len() <= AT_ONCE {
            &mut small[..sum.len()]
        } else {
            large = vec![0.0; sum.len()];
            large.as_mut_slice()
        };
        self.renderer.shader.add_direct(&hit, &self.plane, radiance);
        if let Some(smooth) = &self.smooth {
            smooth.add(&self.body, &hit, radiance);
        }
        let blemishes = &self.renderer.blemishes;
        let factor = weight
            * match factor {
                Some(factor) => factor,
                None if blemishes.is_none() => 1.0,
                None => blemishes.factor(self.plane.still(hit.point)),
            };
        for (sum, b) in sum.iter_mut().zip(radiance.iter()) {
            *sum += factor * b;
        }
    }
}
