//! Reflected smooth light over the visible surface, tabulated once per view and interpolated.
//!
//! The integral over the light costs some hundred evaluations of the BRDF; in the coordinates of
//! [`Body::chart`] its value is smooth, so that a few thousand nodes serve millions of rays.

use std::f64::consts::{FRAC_PI_2, PI};

use rayon::prelude::*;

use super::body::{Body, Hit};
use super::shade::{Plane, Shader};
use crate::geometry::CameraModel;

/// Points of the interpolation in each coordinate.
const POINTS: usize = 6;
/// How far the last nodes stay from the limb and a sphere's poles, radians: seen at exactly 90° rounding would
/// decide whether a point reflects.
const FROM_LIMB: f64 = 1e-7;
/// Positions per side of the image at which the range of the chart is looked for.
const LATTICE: u32 = 48;

/// A regular axis of nodes.
#[derive(Clone, Copy, Debug)]
struct Nodes {
    start: f64,
    step: f64,
    count: usize,
}

impl Nodes {
    fn over([low, high]: [f64; 2], spacing: f64) -> Self {
        let width = high - low;
        if !(width > 0.0) {
            return Self {
                start: low,
                step: 1.0,
                count: 1,
            };
        }
        let count = ((width / spacing).ceil() as usize + 1).max(POINTS);
        Self {
            start: low,
            step: width / (count - 1) as f64,
            count,
        }
    }

    fn at(&self, i: usize) -> f64 {
        self.start + i as f64 * self.step
    }

    /// First node and Lagrange's weights for a position.
    fn weights(&self, x: f64) -> (usize, [f64; POINTS]) {
        let mut weights = [0.0; POINTS];
        if self.count < POINTS {
            weights[0] = 1.0;
            return (0, weights);
        }
        let position = (x - self.start) / self.step;
        let first =
            (position.floor() - (POINTS / 2 - 1) as f64).clamp(0.0, (self.count - POINTS) as f64);
        let t = position - first;
        // Π over m ≠ k of (t − m)/(k − m); the denominators are ∓ k! (5 − k)!.
        const DENOMINATORS: [f64; POINTS] = [-120.0, 24.0, -12.0, 12.0, -24.0, 120.0];
        let mut below = 1.0;
        for (k, w) in weights.iter_mut().enumerate() {
            *w = below / DENOMINATORS[k];
            below *= t - k as f64;
        }
        let mut above = 1.0;
        for k in (0..POINTS).rev() {
            weights[k] *= above;
            above *= t - k as f64;
        }
        (first as usize, weights)
    }
}

/// Reflected smooth light of one view, W m⁻² sr⁻¹.
#[derive(Debug)]
pub(super) struct SmoothPart {
    phi: Nodes,
    tau: Nodes,
    channels: usize,
    /// \[τ\]\[φ\]\[channel\].
    values: Vec<f64>,
}

impl SmoothPart {
    /// `None` if there is no smooth light, or nothing of the object in the picture.
    pub(super) fn new(
        shader: &Shader,
        body: &Body,
        camera: &CameraModel,
        plane: &Plane,
    ) -> Option<Self> {
        if !shader.has_smooth() {
            return None;
        }
        let [within, out] = shader.spacing();
        // Towards a sphere's poles and with a rolled plane φ leads out of the light's plane too.
        let across = if body.is_sphere() {
            within.min(out)
        } else {
            within
        };
        let limb = FRAC_PI_2 - FROM_LIMB;
        let phi = Nodes::over([-limb, limb], across);
        let range = tau_range(body, camera)?.map(|tau| tau.clamp(-limb, limb));
        let tau = Nodes::over(range, out);
        let channels = shader.channels().len();
        let mut values = vec![0.0; tau.count * phi.count * channels];
        values
            .par_chunks_exact_mut(channels.max(1))
            .enumerate()
            .for_each(|(i, out)| {
                let hit = body.at([phi.at(i % phi.count), tau.at(i / phi.count)]);
                shader.add_smooth(&hit, plane, out);
            });
        Some(Self {
            phi,
            tau,
            channels,
            values,
        })
    }

    /// Adds the light reflected at a point, per channel.
    pub(super) fn add(&self, body: &Body, hit: &Hit, out: &mut [f64]) {
        let [phi, tau] = body.chart(hit);
        let (i0, across) = self.phi.weights(phi);
        let (j0, along) = self.tau.weights(tau);
        let rows = self.tau.count.min(POINTS);
        for (j, b) in along.iter().enumerate().take(rows) {
            let start = ((j0 + j) * self.phi.count + i0) * self.channels;
            let Some(row) = self.values.get(start..start + POINTS * self.channels) else {
                continue;
            };
            for (node, a) in row.chunks_exact(self.channels).zip(&across) {
                for (out, value) in out.iter_mut().zip(node) {
                    *out += a * b * value;
                }
            }
        }
    }
}

/// The values of τ in the picture, radians; `None` if the object is not in it.
fn tau_range(body: &Body, camera: &CameraModel) -> Option<[f64; 2]> {
    let [width, height] = camera.size();
    // However thin the object, the column of its centre shows it.
    let centre = camera.project(body.centre()).map(|[u, _]| u);
    let columns: Vec<f64> = (0..=LATTICE)
        .map(|i| width * f64::from(i) / f64::from(LATTICE))
        .chain(centre.filter(|u| (0.0..=width).contains(u)))
        .collect();
    let row = |j: u32| {
        let v = height * f64::from(j) / f64::from(LATTICE);
        columns
            .iter()
            .filter_map(|&u| Some(body.chart(&body.hit(&camera.ray([u, v]))?)[1]))
            .fold(None, |range: Option<[f64; 2]>, tau| {
                let [low, high] = range.unwrap_or([tau, tau]);
                Some([low.min(tau), high.max(tau)])
            })
    };
    let rows: Vec<Option<[f64; 2]>> = (0..=LATTICE).map(row).collect();
    let seen: Vec<[f64; 2]> = rows.iter().flatten().copied().collect();
    if seen.is_empty() {
        // A sphere between the lattice's points, or none: the whole range costs little beside a wrong picture.
        return body.is_sphere().then_some([-FRAC_PI_2, FRAC_PI_2]);
    }
    let low = seen.iter().map(|r| r[0]).fold(f64::INFINITY, f64::min);
    let high = seen.iter().map(|r| r[1]).fold(f64::NEG_INFINITY, f64::max);
    // What lies between the lattice's points is less than a step of it outside.
    let margin = 2.0 * (high - low) / f64::from(LATTICE);
    let (mut low, mut high) = (low - margin, high + margin);
    if body.is_sphere() {
        // Where the sphere ends within the picture τ runs to its pole, faster than any lattice.
        if rows.last().is_some_and(Option::is_none) {
            low = -FRAC_PI_2;
        }
        if rows.first().is_some_and(Option::is_none) {
            high = FRAC_PI_2;
        }
        (low, high) = (low.max(-FRAC_PI_2), high.min(FRAC_PI_2));
    }
    (high - low < PI + 1e-9).then_some([low, high])
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::brdf::Model;
    use crate::capture::{Camera, Object, Projection, Shape};
    use crate::fourier::Series;
    use crate::geometry::Pose;
    use crate::lighting::Lighting;
    use num_complex::Complex64;

    fn light(kind: &str) -> Lighting {
        let channels = vec!["Y".to_string()];
        match kind {
            "uniform" => Lighting::uniform(channels, &[0.7]),
            "order 15" => {
                let coefficients = (0..=15)
                    .map(|p| Complex64::cis(1.7 * f64::from(p * p)) / f64::from(1 + p))
                    .collect();
                Lighting::band_limited(channels, vec![Series { coefficients }])
            }
            _ => {
                // A window 30° wide with edges of one degree.
                let values = (0..360).map(|i| if (200..230).contains(&i) { 3.0 } else { 0.1 });
                Lighting {
                    channels,
                    table: vec![values.collect()],
                    ..Lighting::default()
                }
            }
        }
    }

    #[test]
    fn interpolation_is_the_integral() {
        for (material, lights) in [
            ("model = \"lambertian\"\nalbedo = 0.5", "window"),
            (
                "model = \"phong\"\nspecular = 0.4\nexponent = 300",
                "order 15",
            ),
            (
                "model = \"phong\"\nspecular = 0.4\nexponent = 300",
                "window",
            ),
            (
                "model = \"ggx-conductor\"\nalpha = 0.1\neta = 0.2\nk = 3.9",
                "window",
            ),
            (
                "model = \"ggx-dielectric\"\nalpha = 0.3\ndiffuse = 0.3",
                "uniform",
            ),
        ] {
            for (shape, tilt) in [(Shape::Cylinder, 0.02), (Shape::Sphere, 0.0)] {
                let model = Model::from_table(&material.parse().unwrap()).unwrap();
                let shader = Shader::new(&model, &light(lights), Path::new("")).unwrap();
                // The whole sphere is in the picture, its poles too.
                let camera = CameraModel::new(&Camera {
                    projection: Projection::Perspective { focal_px: 400.0 },
                    image_size: [90, 80],
                    principal_point_px: [45.0, 40.0],
                    distortion: [-0.1, 0.0, 0.0, 0.0, 0.0],
                    distance: 0.6,
                    orbit_sigma_deg: 0.0,
                })
                .unwrap();
                let object = Object {
                    shape,
                    radius: 0.05,
                    mask: None,
                };
                let pose = Pose {
                    offset: [0.003, -0.002, 0.001],
                    tilt,
                    ..Pose::nominal()
                };
                let body = Body::new(&camera, &object, &pose);
                let plane = Plane::new(0.4, 0.0);
                let smooth = SmoothPart::new(&shader, &body, &camera, &plane).unwrap();
                // Worst error where the surface is seen at less than 80°, and anywhere.
                let (mut worst, mut largest, mut met) = ([0.0f64; 2], 0.0f64, 0);
                for k in 0..1500 {
                    // A low-discrepancy walk over the picture.
                    let u = 90.0 * (f64::from(k) * 0.754_877_666).fract();
                    let v = 80.0 * (f64::from(k) * 0.569_840_29).fract();
                    let Some(hit) = body.hit(&camera.ray([u, v])) else {
                        continue;
                    };
                    let (mut fast, mut slow) = ([0.0], [0.0]);
                    smooth.add(&body, &hit, &mut fast);
                    shader.add_smooth(&hit, &plane, &mut slow);
                    let error = (fast[0] - slow[0]).abs();
                    if hit.normal.dot(&hit.view) > 80f64.to_radians().cos() {
                        worst[0] = worst[0].max(error);
                    }
                    worst[1] = worst[1].max(error);
                    largest = largest.max(slow[0]);
                    met += 1;
                }
                assert!(met > 500);
                // The spacing is chosen for 1e-5 of a full-contrast wave, in each of the two coordinates. Where an
                // edge of the light crosses the horizon of a metal, the second derivative jumps by ΔL times
                // the slope of ρ cos θi there: 3 · 100 at 80° and 3 · 1000 at the limb for this one, of
                // which h²/20 at π/512 is 6e-4 and 6e-3 of a largest value of 6.
                // Under a coat the light that enters falls to nothing within the last degrees, which the spacing
                // does not resolve: 3e-3 is what it costs there, and it is the chart's worst case.
                let limits = match (lights, material) {
                    ("window", m) if m.contains("conductor") => [2e-4, 2e-3],
                    (_, m) if m.contains("dielectric") => [4e-3, 4e-3],
                    _ => [5e-5, 5e-5],
                };
                for (worst, limit) in worst.iter().zip(limits) {
                    assert!(
                        *worst < limit * largest,
                        "{material} under {lights}, {shape:?}: {worst:e} of {largest}, at most {limit:e}"
                    );
                }
            }
        }
    }

    #[test]
    fn lagrange_s_weights_reproduce_a_quintic() {
        let nodes = Nodes::over([-1.0, 2.0], 0.3);
        let f = |x: f64| 1.0 + x * (2.0 - x * (0.5 - x * (1.0 + x * (0.3 - x))));
        for k in 0..=300 {
            let x = -1.0 + f64::from(k) * 0.01;
            let (first, weights) = nodes.weights(x);
            let sum: f64 = (0..POINTS)
                .map(|i| weights[i] * f(nodes.at(first + i)))
                .sum();
            assert!((sum - f(x)).abs() < 1e-12, "{x}");
        }
    }
}
