//! Looking the prefiltered light field up: an image strip of the object for any camera.

use std::f64::consts::{FRAC_PI_2, PI};

use rayon::prelude::*;

use super::{Prefiltered, Viewpoint, direct_value};
use crate::angle::{LocalAngle, NormalAngle, wrap};

/// Half the height of the band of a sphere that is drawn, radians (5°).
const BAND: f64 = 0.0873;

impl Prefiltered {
    /// B at one place of the object, W m⁻² sr⁻¹: the smooth part by cubic interpolation of the table,
    /// sources and peaks and what a mirror shows exactly.
    pub fn at(&self, channel: usize, normal: NormalAngle, local: LocalAngle) -> f64 {
        let (Some(smooth), Some(brdf)) =
            (self.smooth.get(channel), self.material.brdfs.get(channel))
        else {
            return 0.0;
        };
        let (rows, columns) = (self.grid.normals as i64, self.grid.locals as i64);
        let u = (wrap(normal.rad()) + PI) / self.grid.normal_step() - 0.5;
        let v =
            (local.rad().clamp(-FRAC_PI_2, FRAC_PI_2) + FRAC_PI_2) / self.grid.local_step() - 0.5;
        let (i, j) = (
            u.floor() as i64,
            (v.floor() as i64).clamp(0, (columns - 2).max(0)),
        );
        let (across, along) = (cubic(u - u.floor()), cubic(v - j as f64));
        let mut sum = 0.0;
        for (di, a) in across.iter().enumerate() {
            let row = (i - 1 + di as i64).rem_euclid(rows);
            let cell = |c: i64| {
                smooth
                    .get((row * columns + c) as usize)
                    .copied()
                    .unwrap_or(0.0)
            };
            for (dj, b) in along.iter().enumerate() {
                let column = j - 1 + dj as i64;
                // Beyond the outermost centres a straight line goes on.
                let value = if column < 0 {
                    2.0 * cell(0) - cell(1.min(columns - 1))
                } else if column >= columns {
                    2.0 * cell(columns - 1) - cell((columns - 2).max(0))
                } else {
                    cell(column)
                };
                sum += a * b * value;
            }
        }
        sum + direct_value(
            &self.stretches,
            &self.lighting,
            channel,
            brdf.as_ref(),
            normal,
            local,
        )
    }

    /// The object as a camera sees it, one value per pixel and channel, \[channel\]\[row-major pixel\],
    /// W m⁻² sr⁻¹; 0 beside the object.
    ///
    /// A pixel shows the light field at the (α, θo′) of its centre. That is exact on the cross-section; a
    /// cylinder's rows differ from it by the square of their elevation, and of a sphere only the band of
    /// ±5° about its measurement plane is drawn.
    pub fn view(&self, from: &Viewpoint) -> Vec<Vec<f64>> {
        let Viewpoint {
            orbit,
            geometry,
            size: [width, height],
        } = from;
        let pixels: Vec<Option<(NormalAngle, LocalAngle)>> = (0..width * height)
            .into_par_iter()
            .map(|k| {
                let (x, y) = ((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
                let seen = geometry.at([x, y])?;
                if geometry.is_sphere() && seen.elevation.abs() > BAND {
                    return None;
                }
                Some((
                    NormalAngle::radians(orbit.rad() + seen.alpha),
                    LocalAngle::radians(seen.local),
                ))
            })
            .collect();
        self.strip(&pixels)
    }

    /// One value per pixel and channel, \[channel\]\[pixel\], for pixels that see the object at (α, θo′)
    /// or, `None`, pass it by (value 0). Any camera's geometry gives those.
    pub fn strip(&self, pixels: &[Option<(NormalAngle, LocalAngle)>]) -> Vec<Vec<f64>> {
        (0..self.channels.len())
            .map(|channel| {
                pixels
                    .par_iter()
                    .map(|seen| seen.map_or(0.0, |(a, o)| self.at(channel, a, o)))
                    .collect()
            })
            .collect()
    }
}

/// Weights of the values at −1, 0, 1, 2 for a place t ∈ [0, 1): the cubic with central slopes. It goes on
/// as a cubic for t beyond, which only the outermost half cell asks for.
fn cubic(t: f64) -> [f64; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ]
}
