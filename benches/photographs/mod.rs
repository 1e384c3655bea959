//! Capture sets of any size, made fast: a glossy cylinder under two suns and a fill, by the exact reflection of each
//! row, with the noise of a camera so that files compress as photographs do.

use std::f64::consts::TAU;
use std::fs;
use std::io::{self, Write as _};
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, Vec2, WritableImage, f16,
};
use flatlight::angle::LocalAngle;
use flatlight::brdf::{Brdf, Phong, transfer_row};
use flatlight::capture::{Camera, Object, Projection, Shape};
use flatlight::geometry::{CameraModel, Pose, ViewGeometry};
use rayon::prelude::*;

/// The material, per channel: diffuse and specular albedo; the exponent is common.
pub const ALBEDO: [[f64; 2]; 3] = [[0.30, 0.40], [0.22, 0.40], [0.15, 0.38]];
pub const EXPONENT: f64 = 32.0;
/// Suns: direction in degrees, irradiance.
pub const SUNS: [(f64, [f64; 3]); 2] = [(37.3, [3.0, 2.9, 2.7]), (-104.6, [1.1, 1.3, 1.7])];
/// Light from everywhere in the plane, W m⁻² rad⁻¹.
pub const FILL: [f64; 3] = [0.04, 0.045, 0.055];
/// Noise of a pixel, relative to the root of its radiance.
const NOISE: f64 = 0.004;
const DISTANCE: f64 = 0.6;
const RADIUS: f64 = 0.05;

/// How the photographs are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Store {
    /// EXR of 32-bit floats, 16 rows to a ZIP block.
    FloatZip,
    /// EXR of halves, 16 rows to a ZIP block.
    HalfZip,
    /// EXR of halves, a ZIP block a row.
    HalfZips,
    /// EXR of halves, PIZ, 32 rows to a block.
    HalfPiz,
    /// EXR of halves in ZIP tiles of 64 × 64.
    HalfTiles,
    /// PNG of 16 bits.
    Png,
    /// TIFF of 16 bits.
    Tiff,
    /// JPEG of 8 bits.
    Jpeg,
}

impl Store {
    /// By its name on a command line.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "float-zip" => Self::FloatZip,
            "half-zip" => Self::HalfZip,
            "half-zips" => Self::HalfZips,
            "half-piz" => Self::HalfPiz,
            "half-tiles" => Self::HalfTiles,
            "png" => Self::Png,
            "tiff" => Self::Tiff,
            "jpeg" => Self::Jpeg,
            _ => return None,
        })
    }

    fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Tiff => "tiff",
            Self::Jpeg => "jpg",
            _ => "exr",
        }
    }
}

fn invalid(e: impl std::fmt::Display) -> io::Error {
    io::Error::other(e.to_string())
}

/// Writes a set of `views` photographs; only `distinct` files are different, the rest are links to them, which is
/// nonsense to measure but not to read.
pub fn write_set(
    folder: &Path,
    views: usize,
    distinct: usize,
    size: [u32; 2],
    store: Store,
) -> io::Result<()> {
    fs::create_dir_all(folder.join("views"))?;
    let name = |k: usize| format!("views/{k:03}.{}", store.extension());
    let distinct = distinct.clamp(1, views);
    // A photograph of 24 megapixels takes 500 MB while it is made.
    let together = (100_000_000 / (size[0] as usize * size[1] as usize)).clamp(1, 64);
    let all: Vec<usize> = (0..distinct).collect();
    for some in all.chunks(together) {
        some.par_iter().try_for_each(|&k| {
            let orbit = TAU * k as f64 / views as f64;
            let planes = photograph(size, orbit, k as u64);
            write(&folder.join(name(k)), size, planes, store)
        })?;
    }
    for k in distinct..views {
        let link = folder.join(name(k));
        if !link.exists() {
            fs::hard_link(folder.join(name(k % distinct)), link)?;
        }
    }
    let linear = matches!(store, Store::Png | Store::Tiff | Store::Jpeg);
    let mut text = fs::File::create(folder.join("capture.toml"))?;
    write!(
        text,
        "format = 1\nname = \"made for the benches\"\n\n[object]\nshape = \"cylinder\"\nradius = {RADIUS}\n\n\
         [camera]\nprojection = \"perspective\"\nimage_size = [{}, {}]\nfocal_px = {}\ndistance = {DISTANCE}\n\n\
         {}[views]\nfiles = \"views/*\"\norbit_start_deg = 0.0\norbit_step_deg = {}\n",
        size[0],
        size[1],
        focal(size),
        if linear {
            "[sensor]\nencoding = \"linear\"\n\n"
        } else {
            ""
        },
        360.0 / views as f64
    )?;
    fs::write(folder.join("recipe.toml"), recipe())
}

/// The recipe that knows the material.
pub fn recipe() -> String {
    let each = |k: usize| ALBEDO.map(|a| a[k].to_string()).join(", ");
    format!(
        "format = 1\nrecover = \"lighting\"\n\n[brdf]\nmodel = \"phong\"\ndiffuse = [{}]\nspecular = [{}]\nexponent = {EXPONENT}\n",
        each(0),
        each(1)
    )
}

/// The object covers 85 % of the width.
fn focal(size: [u32; 2]) -> f64 {
    4879.0 / 960.0 * f64::from(size[0])
}

/// Linear planes of R, G and B.
fn photograph(size: [u32; 2], orbit: f64, seed: u64) -> Vec<Vec<f32>> {
    let [width, height] = size;
    let camera = Camera {
        projection: Projection::Perspective {
            focal_px: focal(size),
        },
        image_size: size,
        principal_point_px: [f64::from(width) / 2.0, f64::from(height) / 2.0],
        distortion: [0.0; 5],
        distance: DISTANCE,
        orbit_sigma_deg: 0.0,
    };
    let object = Object {
        shape: Shape::Cylinder,
        radius: RADIUS,
        mask: None,
    };
    let Ok(model) = CameraModel::new(&camera) else {
        return Vec::new();
    };
    let geometry = ViewGeometry::new(&model, &object, Pose::nominal(), 0.0);
    // What the lobes of a unit albedo and the fill give at θo′, in steps of a quarter of a degree.
    let lobe = Phong {
        diffuse: 0.0,
        specular: 1.0,
        exponent: EXPONENT,
    };
    let filled: Vec<f64> = (0..=720)
        .map(|k| {
            let local = (f64::from(k) / 4.0 - 90.0)
                .clamp(-89.99, 89.99)
                .to_radians();
            transfer_row(&lobe, LocalAngle::radians(local), 0)[0].re
        })
        .collect();
    let middle = f64::from(height) / 2.0;
    // Diffuse and specular parts of each column on the cross-section, \[channel\]\[column\].
    let mut parts = vec![vec![[0.0f64; 2]; width as usize]; 3];
    const RAYS: u32 = 8;
    for x in 0..width {
        for k in 0..RAYS {
            let u = f64::from(x) + (f64::from(k) + 0.5) / f64::from(RAYS);
            let Some(seen) = geometry.at([u, middle]) else {
                continue;
            };
            let at = (seen.local.to_degrees() + 90.0) * 4.0;
            let fill = filled[(at as usize).min(filled.len() - 1)];
            for (c, columns) in parts.iter_mut().enumerate() {
                let [diffuse, specular] = ALBEDO[c];
                let part = &mut columns[x as usize];
                part[0] += 2.0 * FILL[c] * diffuse / std::f64::consts::PI / f64::from(RAYS);
                part[1] += FILL[c] * specular * fill / f64::from(RAYS);
                for (theta, irradiance) in SUNS {
                    let incident = flatlight::angle::wrap(theta.to_radians() - seen.alpha - orbit);
                    if incident.abs() >= std::f64::consts::FRAC_PI_2 {
                        continue;
                    }
                    let e = irradiance[c] * incident.cos() / f64::from(RAYS);
                    part[0] += e * diffuse / std::f64::consts::PI;
                    part[1] += e
                        * specular
                        * lobe.value(
                            LocalAngle::radians(incident),
                            LocalAngle::radians(seen.local),
                        );
                }
            }
        }
    }
    (0..3usize)
        .map(|c| {
            let mut random = (seed + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (c as u64) << 17;
            let mut plane = Vec::with_capacity(width as usize * height as usize);
            for y in 0..height {
                // The view leaves the plane by ε, and the mirror direction with it.
                let down = (f64::from(y) + 0.5 - middle) / focal(size);
                let falls = down.atan().cos().powf(EXPONENT);
                for [diffuse, specular] in &parts[c] {
                    let b = diffuse + falls * specular;
                    plane.push((b + NOISE * b.sqrt() * normal(&mut random)) as f32);
                }
            }
            plane
        })
        .collect()
}

/// About a normal deviate: the sum of four uniform ones (xorshift) scaled to variance 1.
fn normal(state: &mut u64) -> f64 {
    let mut next = || {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        *state
    };
    let bits = next();
    let sum: f64 = (0..4)
        .map(|k| f64::from((bits >> (16 * k)) as u16) / 65535.0 - 0.5)
        .sum();
    sum * 3.0f64.sqrt()
}

fn write(path: &Path, size: [u32; 2], planes: Vec<Vec<f32>>, store: Store) -> io::Result<()> {
    let compression = match store {
        Store::FloatZip | Store::HalfZip | Store::HalfTiles => Compression::ZIP16,
        Store::HalfZips => Compression::ZIP1,
        Store::HalfPiz => Compression::PIZ,
        Store::Png | Store::Tiff => {
            let coded = |v: f32| (v * 20000.0).clamp(0.0, 65535.0) as u16;
            let pixels = interleaved(&planes, coded);
            return image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(size[0], size[1], pixels)
                .ok_or_else(|| invalid("a plane has not the image's size"))?
                .save(path)
                .map_err(invalid);
        }
        Store::Jpeg => {
            let coded = |v: f32| (v * 80.0).clamp(0.0, 255.0) as u8;
            let pixels = interleaved(&planes, coded);
            return image::ImageBuffer::<image::Rgb<u8>, _>::from_raw(size[0], size[1], pixels)
                .ok_or_else(|| invalid("a plane has not the image's size"))?
                .save(path)
                .map_err(invalid);
        }
    };
    let channels = planes
        .into_iter()
        .zip(["R", "G", "B"])
        .map(|(plane, name)| {
            let samples = match store {
                Store::FloatZip => FlatSamples::F32(plane),
                _ => FlatSamples::F16(plane.iter().map(|v| f16::from_f32(*v)).collect()),
            };
            AnyChannel::new(name, samples)
        })
        .collect();
    let blocks = match store {
        Store::HalfTiles => Blocks::Tiles(Vec2(64, 64)),
        _ => Blocks::ScanLines,
    };
    let layer = Layer::new(
        (size[0] as usize, size[1] as usize),
        LayerAttributes::default(),
        Encoding {
            compression,
            blocks,
            line_order: LineOrder::Increasing,
        },
        AnyChannels::sort(channels),
    );
    Image::from_layer(layer)
        .write()
        .to_file(path)
        .map_err(invalid)
}

fn interleaved<T>(planes: &[Vec<f32>], coded: impl Fn(f32) -> T) -> Vec<T> {
    let pixels = planes.first().map_or(0, Vec::len);
    (0..pixels)
        .flat_map(|i| planes.iter().map(move |p| p[i]))
        .map(coded)
        .collect()
}
