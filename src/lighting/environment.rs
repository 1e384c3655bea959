//! Lat-long environment maps: planar light from them, and planar light into them.
//!
//! # Orientation
//!
//! The map's up is +Y. Column u ∈ [0, 1) (pixel i has its centre at u = (i + ½)/width) and elevation ε
//! (pixel row j has its centre at 90° − 180°·(j + ½)/height) show the direction
//! (cos ε cos φ, sin ε, −cos ε sin φ) with φ = 90° − 360°·u: the image centre looks along +Z, a quarter
//! to its left along +X, and the image is as seen from inside. φ is counter-clockwise about +Y. That is
//! the layout of OpenEXR's `LATLONG` and of Mitsuba's `envmap`, which loads it without a transform in a
//! world with +Y up; in a world with +Z up, rotate by 90° about x: then φ is the ordinary azimuth.
//!
//! # Normalisation
//!
//! Pixels are radiance, W m⁻² sr⁻¹. A band of radiance R(θ, ε) about the plane gives a facing surface
//! L(θ) = ∫ R cos² ε dε per radian of θ.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::io::Cursor;
use std::path::Path;

use exr::prelude as openexr;
use openexr::WritableImage as _;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Lighting;
use crate::error::{Error, Result};
use crate::files;
use crate::light_field::sort_attributes;
use crate::photo::{self, ExrPart, Format, rle_lines};

/// A lat-long map of radiance, W m⁻² sr⁻¹.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Channel names, without alpha.
    pub channels: Vec<String>,
    /// Pixels around the horizon.
    pub width: usize,
    /// Pixels from zenith to nadir.
    pub height: usize,
    /// Radiance, \[channel\]\[row-major pixel\].
    pub values: Vec<Vec<f32>>,
}

/// For which surfaces the planar light shall stand for the whole environment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Serves {
    /// Lambertian ones: L(θ) = ∫ L₃(θ, ε) cos² ε dε, exact on the equator of a sphere or cylinder.
    #[default]
    Lambertian,
    /// Mirrors: L is the radiance in the plane itself, exact for a mirror.
    Mirror,
}

/// A measurement plane in an environment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Section {
    /// φ of the reference axis θ = 0, radians; the axis is horizontal.
    pub heading: f64,
    /// Turn of the plane about the reference axis, radians; 0 is the horizon, and a positive roll lifts
    /// the directions θ > 0 (counter-clockwise in a photo taken from θ = 0).
    pub roll: f64,
    /// Which surfaces it is for.
    pub serves: Serves,
}

impl Section {
    /// Unit vector in the map's frame of in-plane angle θ and elevation ε out of the plane, radians.
    pub fn direction(&self, theta: f64, elevation: f64) -> [f64; 3] {
        let (sin_h, cos_h) = self.heading.sin_cos();
        let (sin_r, cos_r) = self.roll.sin_cos();
        let first = [cos_h, 0.0, -sin_h];
        let level = [-sin_h, 0.0, -cos_h];
        let up = [0.0, 1.0, 0.0];
        let (sin_t, cos_t) = theta.sin_cos();
        let (sin_e, cos_e) = elevation.sin_cos();
        std::array::from_fn(|k| {
            let second = cos_r * level[k] + sin_r * up[k];
            let normal = cos_r * up[k] - sin_r * level[k];
            cos_e * (cos_t * first[k] + sin_t * second) + sin_e * normal
        })
    }
}

impl Environment {
    /// Reads an OpenEXR or Radiance HDR file; alpha and further layers are ignored.
    ///
    /// # Errors
    /// If it cannot be read, or a pixel is not finite.
    pub fn read(file: &Path) -> Result<Self> {
        let map = match photo::info(file)?.format {
            Format::Exr => read_exr(file)?,
            Format::Hdr => {
                let photo = photo::read(file, None)?;
                Self {
                    channels: photo.channels,
                    width: photo.size[0] as usize,
                    height: photo.size[1] as usize,
                    values: photo.values,
                }
            }
            other => {
                return Err(Error::input(format!(
                    "expected an OpenEXR or Radiance HDR file, found {other:?}"
                ))
                .file(file));
            }
        };
        for (name, values) in map.channels.iter().zip(&map.values) {
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                return Err(Error::input(format!(
                    "expected finite radiance, found {} at column {}, row {} of channel {name}",
                    values[i],
                    i % map.width,
                    i / map.width
                ))
                .file(file)
                .advice("Half-float files overflow at suns: write the file in 32 bits, or replace the sun by a source."));
            }
        }
        Ok(map)
    }

    /// Radiance in a direction of the map's frame, bilinear between pixel centres.
    pub fn radiance(&self, channel: usize, direction: [f64; 3]) -> f64 {
        let [x, y, z] = direction;
        let azimuth = (-z).atan2(x);
        let elevation = y.clamp(-1.0, 1.0).asin();
        let u = (FRAC_PI_2 - azimuth) / TAU * self.width as f64 - 0.5;
        let v = (FRAC_PI_2 - elevation) / PI * self.height as f64 - 0.5;
        let v = v.clamp(0.0, self.height.saturating_sub(1) as f64);
        let (s, t) = (u - u.floor(), v - v.floor());
        let column = |k: f64| (u.floor() + k).rem_euclid(self.width as f64) as usize;
        let row = |k: usize| (v as usize + k).min(self.height.saturating_sub(1));
        let at = |i: usize, j: usize| {
            self.values
                .get(channel)
                .and_then(|c| c.get(j * self.width + i))
                .map_or(0.0, |&value| f64::from(value))
        };
        let (left, right) = (column(0.0), column(1.0));
        (1.0 - t) * ((1.0 - s) * at(left, row(0)) + s * at(right, row(0)))
            + t * ((1.0 - s) * at(left, row(1)) + s * at(right, row(1)))
    }

    /// Planar light for a section, at twice as many angles as the map has columns, so that every column
    /// of an unrolled map (of even width, with heading 0) is one of them.
    pub fn planar(&self, section: Section) -> Lighting {
        let n = 2 * self.width;
        let table = (0..self.channels.len())
            .map(|channel| {
                (0..n)
                    .into_par_iter()
                    .map(|i| {
                        let theta = -PI + TAU * i as f64 / n as f64;
                        self.planar_at(channel, section, theta)
                    })
                    .collect()
            })
            .collect();
        Lighting {
            channels: self.channels.clone(),
            table,
            ..Lighting::default()
        }
    }

    fn planar_at(&self, channel: usize, section: Section, theta: f64) -> f64 {
        match section.serves {
            Serves::Mirror => self.radiance(channel, section.direction(theta, 0.0)),
            Serves::Lambertian => {
                // Two midpoints per pixel: exact for the linear pieces but for the curvature of cos² ε
                // inside half a pixel.
                let m = 2 * self.height;
                let step = PI / m as f64;
                (0..m)
                    .map(|k| {
                        let elevation = -FRAC_PI_2 + (k as f64 + 0.5) * step;
                        let direction = section.direction(theta, elevation);
                        step * elevation.cos().powi(2) * self.radiance(channel, direction)
                    })
                    .sum()
            }
        }
    }
}

fn read_exr(file: &Path) -> Result<Environment> {
    let ExrPart { size, mut planes } = ExrPart::read(file)?;
    planes.retain(|(name, _)| name != "A");
    // Channels are stored by alphabet; R, G, B keep the order of the rest of the world.
    let rank = |name: &str| ["R", "G", "B"].iter().position(|c| *c == name).unwrap_or(3);
    planes.sort_by_key(|(name, _)| rank(name));
    if planes.is_empty() {
        return Err(Error::input("expected colour channels, found none").file(file));
    }
    let (channels, values) = planes.into_iter().unzip();
    Ok(Environment {
        channels,
        width: size[0],
        height: size[1],
        values,
    })
}

/// Height of the maps that are written, pixels: odd, so that one row lies on the horizon whether a
/// reader puts its rows at (j + ½)/height or, as Mitsuba, at j/(height − 1).
const HEIGHT: usize = 721;
/// Width of the maps that are written, pixels (0.25°).
const WIDTH: usize = 1440;

/// Writes planar light as a lat-long EXR map (32-bit float, 1440 × 721) that a renderer loads as it is:
/// black but for the row of the horizon, oriented as stated at the head of this module.
///
/// The row's radiance is R = L / ∫ τ(ε) cos² ε dε, where τ is the tent of half width 180°/720 that
/// Mitsuba's interpolation makes of one row; a renderer with rows of constant radiance 180°/721 high
/// shows 0.14 % less. A source is shared between the two columns beside it, which keeps its irradiance
/// and direction. Light below 0, which a recovery may contain, is written as 0.
///
/// # Errors
/// If the file cannot be written.
pub fn write_lat_long(file: &Path, lighting: &Lighting) -> Result<()> {
    files::write_whole(file, &lat_long(lighting).map_err(|e| e.file(file))?)
}

/// The bytes that [`write_lat_long`] writes.
///
/// # Errors
/// If the exr crate cannot encode them.
pub fn lat_long(lighting: &Lighting) -> Result<Vec<u8>> {
    let step = PI / (HEIGHT - 1) as f64;
    // ∫ (1 − |ε|/h) cos² ε dε over |ε| ≤ h: half of it is h, the other half, of cos 2ε, sin²h/h.
    let band = 0.5 * (step + step.sin().powi(2) / step);
    // Pixel centres lie at φ = 90° − 360°(i + ½)/1440, which is every odd angle of 2880.
    let fine = 2 * WIDTH;
    let density = Lighting {
        sources: Vec::new(),
        ..lighting.clone()
    }
    .tabulated(fine);
    let at_pixel = |i: usize| (fine * 3 / 4 + fine - (2 * i + 1)) % fine;
    let mut rows: Vec<Vec<f64>> = density
        .iter()
        .map(|values| (0..WIDTH).map(|i| values[at_pixel(i)]).collect())
        .collect();
    for (channel, row) in rows.iter_mut().enumerate() {
        for source in &lighting.sources {
            let u = ((FRAC_PI_2 - source.theta.rad()) / TAU).rem_euclid(1.0);
            let position = u * WIDTH as f64 - 0.5;
            let t = position - position.floor();
            let left = position.floor().rem_euclid(WIDTH as f64) as usize % WIDTH;
            let height = source.in_channel(channel) * WIDTH as f64 / TAU;
            row[left] += (1.0 - t) * height;
            row[(left + 1) % WIDTH] += t * height;
        }
    }
    let rows: Vec<Vec<f32>> = rows
        .iter()
        .map(|row| row.iter().map(|l| (l / band).max(0.0) as f32).collect())
        .collect();
    let black = vec![0.0; WIDTH];
    let planes = lighting.channels.iter().zip(&rows);
    let picture = rle_lines::Picture {
        size: [WIDTH, HEIGHT],
        attributes: openexr::LayerAttributes {
            environment_map: Some(exr::meta::attribute::EnvironmentMap::LatitudeLongitude),
            ..openexr::LayerAttributes::default()
        },
        planes: planes
            .map(|(name, row)| {
                let plane = rle_lines::Plane::OneRow(HEIGHT / 2, row, &black);
                (openexr::Text::from(name.as_str()), plane)
            })
            .collect(),
    };
    rle_lines::encode(vec![picture])
        .map_err(|e| Error::failed(format!("the EXR file cannot be encoded: {e}")))
}

/// Writes 32-bit planes of `size` (width, height), one per channel, as one EXR file, whole or not at
/// all.
pub(crate) fn write_planes(
    file: &Path,
    size: [usize; 2],
    channels: &[String],
    planes: Vec<Vec<f32>>,
    attributes: openexr::LayerAttributes,
) -> Result<()> {
    let encoding = openexr::Encoding {
        compression: openexr::Compression::ZIP16,
        blocks: openexr::Blocks::ScanLines,
        line_order: openexr::LineOrder::Increasing,
    };
    let planes = channels.iter().zip(planes).map(|(name, plane)| {
        openexr::AnyChannel::new(name.as_str(), openexr::FlatSamples::F32(plane))
    });
    let planes = openexr::AnyChannels::sort(planes.collect());
    let [width, height] = size;
    let layer = openexr::Layer::new((width, height), attributes, encoding, planes);
    let image = openexr::Image::from_layer(layer);
    let mut bytes = Cursor::new(Vec::new());
    image
        .write()
        .to_buffered(&mut bytes)
        .map_err(|e| Error::write(file, e))?;
    let mut bytes = bytes.into_inner();
    sort_attributes(&mut bytes);
    files::write_whole(file, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::WorldAngle;
    use crate::lighting::Source;

    /// A chart: every direction has its own radiance, a linear function of the unit vector.
    fn chart(width: usize, height: usize) -> Environment {
        let planes = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]];
        let values = planes
            .iter()
            .map(|plane| {
                (0..width * height)
                    .map(|k| {
                        let u = ((k % width) as f64 + 0.5) / width as f64;
                        let e = FRAC_PI_2 - PI * ((k / width) as f64 + 0.5) / height as f64;
                        let phi = FRAC_PI_2 - TAU * u;
                        let d = [e.cos() * phi.cos(), e.sin(), -e.cos() * phi.sin()];
                        let dot: f64 = d.iter().zip(plane).map(|(a, b)| a * b).sum();
                        (1.0 + dot) as f32
                    })
                    .collect()
            })
            .collect();
        Environment {
            channels: ["x", "y", "z"].map(String::from).to_vec(),
            width,
            height,
            values,
        }
    }

    #[test]
    fn the_chart_is_seen_in_the_right_directions() {
        let map = chart(256, 128);
        // Interpolating a function of curvature ½ over 2.45e-2 rad: ½·step²/8 in each axis.
        let tolerance = 2.0 * 0.5 * (TAU / 256.0f64).powi(2) / 8.0;
        for (heading, roll) in [(0.0, 0.0), (0.7, 0.0), (-2.0, 0.4), (1.0, -1.5)] {
            let section = Section {
                heading,
                roll,
                serves: Serves::Mirror,
            };
            let light = map.planar(section);
            for k in 0..50 {
                let theta = 0.126 * f64::from(k);
                let d = section.direction(theta, 0.0);
                for (c, component) in d.iter().enumerate() {
                    let l = light.density(c, WorldAngle::radians(theta));
                    // The map's linear interpolation and the table's.
                    let error = l - (1.0 + 0.5 * component);
                    assert!(
                        error.abs() < 2.0 * tolerance,
                        "{heading} {roll} {c}: {error}"
                    );
                }
            }
        }
        // The axes, said in words at the head of the module.
        let level = Section::default();
        let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-15);
        assert!(near(level.direction(0.0, 0.0), [1.0, 0.0, 0.0]));
        assert!(near(level.direction(FRAC_PI_2, 0.0), [0.0, 0.0, -1.0]));
        assert!(near(level.direction(0.0, FRAC_PI_2), [0.0, 1.0, 0.0]));
        let rolled = Section {
            roll: FRAC_PI_2,
            ..level
        };
        assert!(near(rolled.direction(FRAC_PI_2, 0.0), [0.0, 1.0, 0.0]));
    }

    #[test]
    fn cosine_weighted_columns_are_the_irradiance_of_a_lambertian_equator() {
        // L₃ = 1 + ½ d·ê: ∫ cos² = π/2, and the part along θ carries ∫ cos³ = 4/3.
        let light = chart(128, 64).planar(Section::default());
        for k in 0..40 {
            let theta = 0.16 * f64::from(k);
            let l = light.density(0, WorldAngle::radians(theta));
            let expected = FRAC_PI_2 + 0.5 * theta.cos() * 4.0 / 3.0;
            // Curvature of the map and of cos² over a pixel of 4.9e-2 rad: about step²/6 of the value.
            assert!((l - expected).abs() < 6e-4 * expected, "{l} {expected}");
        }
        let up = light.density(1, WorldAngle::radians(0.3));
        assert!((up - FRAC_PI_2).abs() < 6e-4 * FRAC_PI_2);
    }

    #[test]
    fn light_written_as_a_map_comes_back_with_its_irradiance_and_direction() {
        let mut light =
            Lighting::uniform(["R", "G", "B"].map(String::from).to_vec(), &[0.2, 0.1, 0.0]);
        light.sources.push(Source {
            theta: WorldAngle::degrees(37.3),
            irradiance: vec![3.0, 2.0, 1.0],
        });
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("lighting.exr");
        write_lat_long(&file, &light).unwrap();
        let map = Environment::read(&file).unwrap();
        assert_eq!((map.width, map.height), (1440, 721));
        assert_eq!(map.channels, light.channels);
        let read = map.planar(Section::default());
        // The row is read back as a tent of half width 180°/721, not 180°/720.
        let narrower = 720.0 / 721.0;
        for c in 0..3 {
            let (found, planted) = (read.series(c, 1), light.series(c, 1));
            for p in 0..2 {
                let (a, b) = (found.coefficients[p], narrower * planted.coefficients[p]);
                // 32-bit pixels, and a pixel's width of 0.25° on the first harmonic: Δ²/6.
                assert!(
                    (a - b).norm() < 2e-5 * light.series(c, 0).coefficients[0].norm(),
                    "{a} {b}"
                );
            }
        }
    }

    #[test]
    fn a_map_that_is_no_map_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("sky.exr");
        std::fs::write(&file, b"not an image").unwrap();
        for name in ["sky.exr", "sky.hdr", "missing.exr"] {
            let message = Environment::read(&folder.path().join(name))
                .unwrap_err()
                .to_string();
            assert!(message.contains(name), "{message}");
        }
    }
}
