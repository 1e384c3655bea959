//! The measured line of one view: from its radiance to samples in columns of equal θo′.

use std::f64::consts::FRAC_PI_2;

use crate::angle::{LocalAngle, WorldAngle, wrap};
use crate::error::{Error, Result};
use crate::geometry::{Side, ViewGeometry};
use crate::radiance::Radiance;

use super::columns::{Footprint, GAUSS_NODES, Line, sample};
use super::strip::{
    HAT_VARIANCE, PIXEL_VARIANCE, Stations, along_line, along_line_reach, along_rows,
};

/// Slope of the line in the image below which it is taken to run along the rows: over an object of
/// 1000 pixels it then leaves a row by less than one pixel, which the fit across the line follows.
const LEVEL: f64 = 1e-3;
/// Part of a sphere's half chord that may be averaged across the line: beyond it the fit by a
/// parabola is no longer good to 1e-4.
const CHORD: f64 = 0.12;

/// One view's stations along the line where the measurement plane cuts the object.
#[derive(Clone, Debug)]
pub struct MeasuredLine {
    /// Image position of each station, pixels, from the left limb to the right.
    pub positions: Vec<[f64; 2]>,
    /// The stations.
    pub stations: Stations,
    tangent: [f64; 2],
    /// Variance of places along the line, pixels², over what a station averages.
    extent: f64,
}

/// One view's samples in one channel and column.
#[derive(Clone, Copy, Debug)]
pub struct ViewSample {
    /// α, radians in [−π, π).
    pub alpha: f64,
    /// B.
    pub value: f64,
    /// Variance by the pixels' noise.
    pub variance: f64,
    /// dB/dθo′ along the view's line, per radian.
    pub slope: f64,
    /// Number of pixels behind it.
    pub pixels: f32,
}

impl MeasuredLine {
    /// Reads the line of a view; `reach` is the distance (pixels) to each side that is averaged.
    ///
    /// # Errors
    /// If the line does not lie in the rows of `radiance`, or is shorter than a few pixels.
    pub fn read(radiance: &Radiance, geometry: &ViewGeometry, reach: f64) -> Result<Self> {
        Self::read_below(radiance, geometry, reach, 0.0)
    }

    /// The same along a line that lies `below` pixels lower in the image: a cylinder seen out of its plane.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_below(
        radiance: &Radiance,
        geometry: &ViewGeometry,
        reach: f64,
        below: f64,
    ) -> Result<Self> {
        // Along the axis, so that the same normals are seen; a level line keeps to the pixels' columns.
        let tilt = geometry.pose().tilt.tan();
        let aside = if tilt.abs() < LEVEL {
            0.0
        } else {
            tilt * below
        };
        let ends = Side::BOTH.map(|side| {
            let [u, v] = geometry.limb(side)?.pixel;
            Some([u + aside, v + below])
        });
        let [Some(left), Some(right)] = ends else {
            return Err(Error::input("the camera is inside the object")
                .key("camera.distance")
                .advice("The distance runs from the camera's centre to the object's centre, and must exceed the radius."));
        };
        let along = [right[0] - left[0], right[1] - left[1]];
        let length = along[0].hypot(along[1]);
        if !(length >= 8.0) {
            return Err(Error::input(format!(
                "the object is {length:.1} pixels wide in the image, expected at least 8"
            ))
            .advice("Check radius, distance and focal length."));
        }
        let tangent = [along[0] / length, along[1] / length];
        // On a sphere the surface curves away across the line, faster near the limb.
        let chord = |position: [f64; 2]| {
            let s = (position[0] - left[0]) * tangent[0] + (position[1] - left[1]) * tangent[1];
            (s * (length - s)).max(0.0).sqrt()
        };
        let reach_at = |position: [f64; 2]| {
            if geometry.is_sphere() {
                reach.min(CHORD * chord(position)).max(1.0)
            } else {
                reach
            }
        };
        let width = radiance.size[0] as usize;
        if is_level(tangent) {
            let first = left[0].ceil().max(0.0) as usize;
            let last = (right[0].floor().max(0.0) as usize).min(width);
            let positions: Vec<[f64; 2]> = (first..last)
                .map(|u| {
                    let x = u as f64 + 0.5;
                    [x, left[1] + (x - left[0]) * tangent[1] / tangent[0]]
                })
                .collect();
            let rows = f64::from(radiance.rows.start)..f64::from(radiance.rows.end);
            if positions.is_empty() || !positions.iter().all(|p| rows.contains(&p[1])) {
                return Err(line_not_in_image(left, right, radiance));
            }
            let stations = along_rows(radiance, first..last, |u| {
                let position = positions[u - first];
                (position[1], reach_at(position))
            });
            return Ok(Self {
                positions,
                stations,
                tangent,
                extent: PIXEL_VARIANCE,
            });
        }
        // What looks past the limb is no measurement of the object.
        let clear = along_line_reach(tangent);
        let count = (length - 1.0).floor() as usize;
        let inside = |p: &[f64; 2]| {
            p[0] >= 0.5
                && p[0] <= width as f64 - 0.5
                && p[1] >= f64::from(radiance.rows.start) + 0.5
                && p[1] <= f64::from(radiance.rows.end) - 0.5
        };
        let positions: Vec<[f64; 2]> = (0..count)
            .map(|k| (length - (count - 1) as f64) / 2.0 + k as f64)
            .filter(|s| s.min(length - s) >= clear)
            .map(|s| [left[0] + s * tangent[0], left[1] + s * tangent[1]])
            .filter(inside)
            .collect();
        if positions.len() < 8 {
            return Err(line_not_in_image(left, right, radiance));
        }
        let stations = along_line(radiance, &positions, tangent, |k| reach_at(positions[k]));
        Ok(Self {
            positions,
            stations,
            tangent,
            extent: PIXEL_VARIANCE + HAT_VARIANCE,
        })
    }

    /// Whether the line, read with `reach`, averages all rows of `radiance`: further reach changes nothing.
    pub fn has_all_rows(&self, radiance: &Radiance, reach: f64) -> bool {
        let rows = [radiance.rows.start, radiance.rows.end].map(f64::from);
        let within = |p: &[f64; 2]| rows.iter().all(|row| (row - p[1]).abs() <= reach);
        is_level(self.tangent) && self.positions.iter().all(within)
    }

    /// |θo′| (radians) up to which lines in this direction have stations, wherever the limb lies within its pixel, on an object of this radius: gathered along a
    /// slanted line, pixels stay clear of the limb. A column that only some of the views see would tell of a part of the normals.
    pub fn seen_up_to(&self, radius_px: f64) -> f64 {
        if is_level(self.tangent) {
            return FRAC_PI_2;
        }
        // The outermost station may be as much as a pixel farther in.
        let clear = along_line_reach(self.tangent) + 1.0;
        (1.0 - clear / radius_px).max(0.0).asin()
    }

    /// One sample per channel and column: \[channel\]\[column\], `None` where the view did not see it.
    /// `locals` are the columns' θo′ in increasing order, `bin` their width, `limb_cut` the largest |θo′|
    /// (radians). `geometry` may differ from the one the line was read with by a shift along the line.
    pub fn samples(
        &self,
        geometry: &ViewGeometry,
        orbit: WorldAngle,
        locals: &[LocalAngle],
        bin: f64,
        limb_cut: f64,
    ) -> Vec<Vec<Option<ViewSample>>> {
        // Along the line θo′ decreases; samples are taken in increasing θo′.
        let (footprints, places): (Vec<Footprint>, Vec<usize>) = self
            .positions
            .iter()
            .enumerate()
            .rev()
            .filter_map(|(k, p)| Some((self.footprint(geometry, *p)?, k)))
            .unzip();
        let pixels: Vec<u32> = places.iter().map(|&k| self.stations.pixels[k]).collect();
        let ordered = |of: &[f64]| -> Vec<f64> { places.iter().map(|&k| of[k]).collect() };
        // Where each column's centre is seen: the same in all channels.
        let points: Vec<Option<(f64, f64)>> = locals
            .iter()
            .map(|local| {
                if local.rad().abs() > limb_cut || footprints.len() < 4 {
                    return None;
                }
                let point = geometry.trace(local.rad())?;
                Some((local.rad(), wrap(orbit.rad() + point.alpha)))
            })
            .collect();
        (0..self.stations.channels())
            .map(|c| {
                let line = Line {
                    value: &ordered(&self.stations.value[c]),
                    variance: &ordered(&self.stations.variance[c]),
                    pixels: &pixels,
                    footprints: &footprints,
                };
                points
                    .iter()
                    .map(|point| {
                        let (local, alpha) = (*point)?;
                        let found = sample(&line, local, bin)?;
                        Some(ViewSample {
                            alpha,
                            value: found.value,
                            variance: found.variance * found.shared,
                            slope: found.slope,
                            pixels: found.pixels as f32,
                        })
                    })
                    .collect()
            })
            .collect()
    }

    /// θo′ over the pixel at a station, and over all that it averages; `None` if any of it is off the object.
    fn footprint(&self, geometry: &ViewGeometry, position: [f64; 2]) -> Option<Footprint> {
        let at = |offset: f64| {
            let p = [
                position[0] + offset * self.tangent[0],
                position[1] + offset * self.tangent[1],
            ];
            let sine = geometry.sin_local(p);
            (sine.abs() < 1.0).then(|| sine.asin())
        };
        // The nodes of a pixel, as far apart as gives the same variance.
        let node = GAUSS_NODES[2] * (self.extent / PIXEL_VARIANCE).sqrt();
        Some(Footprint {
            ends: [at(0.5)?, at(-0.5)?],
            nodes: [at(node)?, at(0.0)?, at(-node)?],
        })
    }
}

fn line_not_in_image(left: [f64; 2], right: [f64; 2], radiance: &Radiance) -> Error {
    Error::input(format!(
        "the measured line runs from ({:.1}, {:.1}) to ({:.1}, {:.1}) pixels, outside of the image of {} × {} pixels",
        left[0], left[1], right[0], right[1], radiance.size[0], radiance.size[1]
    ))
    .advice("The photo must show the object's cross-section at the height of the principal point; check principal_point_px, focal length, distance and radius.")
}

/// |θo′| (radians) up to which samples are used unless the recipe says otherwise: where a pixel
/// covers less than `footprint` degrees of θo′ (1.5 as a rule), and at most 85°. Beyond, the samples' slopes are no longer
/// resolved and an error of the centre of a hundredth of a pixel shows.
pub fn automatic_limb_cut(geometry: &ViewGeometry, footprint: f64) -> f64 {
    const LARGEST: f64 = 85.0;
    let [left, right] = Side::BOTH.map(|side| geometry.limb(side).map(|p| p.pixel));
    let pixel = match (left, right) {
        (Some(l), Some(r)) => 2.0 / (r[0] - l[0]).hypot(r[1] - l[1]).max(2.0),
        _ => 1.0,
    };
    let cosine = (pixel / footprint.to_radians()).min(0.9);
    cosine.acos().min(LARGEST.to_radians())
}

/// Whether a line in this direction runs along the rows of pixels.
fn is_level(tangent: [f64; 2]) -> bool {
    tangent[1].abs() < LEVEL && tangent[0] > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Camera, Object, Projection, Shape};
    use crate::geometry::{CameraModel, Pose};

    /// A sphere of 200 pixels' radius, its measurement plane rolled.
    fn sphere(roll_deg: f64) -> ViewGeometry {
        let camera = CameraModel::new(&Camera {
            projection: Projection::Orthographic {
                metres_per_px: 0.05 / 200.0,
            },
            image_size: [480, 480],
            principal_point_px: [240.0, 240.0],
            distortion: [0.0; 5],
            distance: 1.0,
            orbit_sigma_deg: 0.0,
        })
        .unwrap();
        let object = Object {
            shape: Shape::Sphere,
            radius: 0.05,
            mask: None,
        };
        ViewGeometry::new(&camera, &object, Pose::nominal(), roll_deg.to_radians())
    }

    /// Radiance as fast as a lobe of Phong 32 changes it along a view, the same across the line; something else beyond the limb.
    fn brightness(sin_local: f64) -> f64 {
        match sin_local.abs() < 1.0 {
            true => (8.0 * sin_local.asin()).cos(),
            false => -3.0,
        }
    }

    fn photo(geometry: &ViewGeometry) -> Radiance {
        const PARTS: u32 = 12;
        let part = |k: u32, of: u32| f64::from(k) + (f64::from(of) + 0.5) / f64::from(PARTS);
        let pixel = |x: u32, y: u32| {
            let parts = (0..PARTS * PARTS).map(|n| [part(x, n % PARTS), part(y, n / PARTS)]);
            parts
                .map(|p| brightness(geometry.sin_local(p)))
                .sum::<f64>()
                / f64::from(PARTS * PARTS)
        };
        let value: Vec<f32> = (0..480 * 480)
            .map(|n| pixel(n % 480, n / 480) as f32)
            .collect();
        Radiance {
            size: [480, 480],
            rows: 0..480,
            channels: vec!["Y".into()],
            variance: vec![vec![1e-8; value.len()]],
            value: vec![value],
            shared: Vec::new(),
            noise_known: true,
        }
    }

    #[test]
    fn a_rolled_line_shows_what_a_level_one_does() {
        for roll in [0.0, 10.0, 30.0, 45.0] {
            let geometry = sphere(roll);
            let photo = photo(&geometry);
            let line = MeasuredLine::read(&photo, &geometry, 20.0).unwrap();
            let cut = automatic_limb_cut(&geometry, 2.75).min(line.seen_up_to(200.0));
            let locals: Vec<LocalAngle> = (0..180)
                .map(|j| LocalAngle::degrees(f64::from(j) - 89.5))
                .collect();
            let orbit = WorldAngle::degrees(0.0);
            let samples = line.samples(&geometry, orbit, &locals, f64::to_radians(1.0), cut);
            for (local, sample) in locals.iter().zip(&samples[0]) {
                if local.rad().abs() > cut {
                    continue;
                }
                let sample = sample.expect("seen");
                // A parabola through bins of 1° leaves the fourth order, (8 · 1°)⁴/24 = 2e-5; towards the limb it runs through 2.6 pixels to each
                // side, which cover 2° each at 80°.
                let allowed = match local.deg().abs() < 60.0 {
                    true => 1e-4,
                    false => 6e-3,
                };
                let miss = sample.value - brightness(local.rad().sin());
                assert!(miss.abs() < allowed, "{roll} {:.1} {miss:.5}", local.deg());
            }
        }
    }
}
