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
        let spacing = shader.spacing();
        let phi = Nodes::over([-FRAC_PI_2, FRAC_PI_2], spacing);
        let tau = Nodes::over(tau_range(body, camera)?, spacing);
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
