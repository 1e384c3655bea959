//! What was shot: the description of a photo set, as resolved from `capture.toml`.

mod check;
mod draft;
pub(crate) mod file;
mod path;
pub(crate) mod table;
#[cfg(test)]
mod tests;
mod to_toml;
mod views;

use std::path::PathBuf;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use check::{Findings, check, framing};
pub use draft::{Draft, draft};

use crate::angle::WorldAngle;

/// A capture set: object, camera, sensor and the views, with every default filled in.
#[derive(Clone, Debug)]
pub struct Capture {
    /// The user's name for it.
    pub name: String,
    /// The folder that holds `capture.toml`; all other paths are relative to it.
    pub folder: PathBuf,
    /// What was photographed.
    pub object: Object,
    /// How the camera maps directions to pixels, and where it stood.
    pub camera: Camera,
    /// How the sensor maps radiance to numbers.
    pub sensor: Sensor,
    /// The views, in the order of the file.
    pub views: Vec<View>,
}

/// The photographed object.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Its shape.
    pub shape: Shape,
    /// Its radius, metres.
    pub radius: f64,
    /// Mask image for all views (white is used), relative to the capture's folder.
    pub mask: Option<PathBuf>,
}

/// Shapes whose normals follow from their outline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// A circular cylinder, its axis across the measurement plane.
    Cylinder,
    /// A sphere.
    Sphere,
}

/// How directions become pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// A pinhole with the given focal length in pixels.
    Perspective {
        /// Focal length, pixels.
        focal_px: f64,
    },
    /// Parallel rays.
    Orthographic {
        /// Size of a pixel on the object, metres.
        metres_per_px: f64,
    },
}

/// The camera, the same for all views.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Perspective or orthographic, and its scale.
    pub projection: Projection,
    /// Width and height of a photo, pixels.
    pub image_size: [u32; 2],
    /// Principal point, pixels; the top-left corner of the image is (0, 0), so the centre of the
    /// first pixel is (0.5, 0.5).
    pub principal_point_px: [f64; 2],
    /// k1 k2 p1 p2 k3 of OpenCV's model.
    pub distortion: [f64; 5],
    /// Camera centre to the centre of the orbit, metres.
    pub distance: f64,
    /// Standard deviation of the orbit angles, degrees.
    pub orbit_sigma_deg: f64,
}

/// How stored code values relate to light.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Sensor {
    /// The encoding of stored values; `None`: decided by the file's type.
    pub encoding: Option<Encoding>,
    /// Stored code value of no light.
    pub black_level: Option<f64>,
    /// Stored code value at which the sensor saturates.
    pub white_level: Option<f64>,
    /// Electrons at `white_level`.
    pub full_well_e: Option<f64>,
    /// Read noise, electrons (standard deviation).
    pub read_noise_e: Option<f64>,
    /// Electrons per unit radiance per second.
    pub responsivity: Option<f64>,
    /// Dark frame, relative to the capture's folder.
    pub dark: Option<PathBuf>,
    /// Flat field, relative to the capture's folder.
    pub flat: Option<PathBuf>,
    /// a, b, c of 1 + a r² + b r⁴ + c r⁶, r = 1 at the image's corner.
    pub vignetting: Option<[f64; 3]>,
}

/// How linear light is encoded in stored values.
#[derive(Clone, Debug, PartialEq)]
pub enum Encoding {
    /// Proportional to radiance.
    Linear,
    /// The sRGB curve.
    Srgb,
    /// value = linear^(1/γ).
    Gamma(f64),
    /// A measured response curve, relative to the capture's folder.
    Response(PathBuf),
    /// The response is recovered from the set's own brackets; the curve, once that was done.
    Recover(Option<Arc<ResponseCurve>>),
}

/// A response curve as a table, straight between its rows.
#[derive(Clone, Debug, PartialEq)]
pub struct ResponseCurve {
    /// Stored values, increasing.
    pub stored: Vec<f64>,
    /// Their linear values, \[channel\]\[row\], increasing.
    pub linear: Vec<Vec<f64>>,
    /// Standard deviations of the linear values, \[channel\]\[row\].
    pub sigma: Vec<Vec<f64>>,
    /// Exposure times as stated, seconds, in increasing order, and the factors to be multiplied with that were found along
    /// with the curve.
    pub times: Vec<(f64, f64)>,
}

impl ResponseCurve {
    /// The factor of a stated exposure time; 1 if it was not among those that the curve was found from.
    pub fn time_factor(&self, stated: f64) -> f64 {
        let same = |t: f64| (t / stated).ln().abs() < 1e-3;
        let found = self.times.iter().find(|(t, _)| same(*t));
        found.map_or(1.0, |(_, factor)| *factor)
    }
}

/// One camera position.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Direction from the object to the camera in the frame in which the light stands still.
    pub orbit: WorldAngle,
    /// One photo, or an exposure bracket.
    pub photos: Vec<Photo>,
    /// Spheres: roll of the measurement plane about the optical axis, radians; a positive roll turns
    /// the plane's trace counter-clockwise in the image.
    pub plane_roll: f64,
    /// Mask image (white is used), relative to the capture's folder.
    pub mask: Option<PathBuf>,
    /// The outline, given by hand instead of found.
    pub outline: Option<GivenOutline>,
}

/// One photograph of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// The file, relative to the capture's folder.
    pub file: PathBuf,
    /// Exposure time, seconds; `None`: from the file's EXIF, else 1.
    pub exposure_s: Option<f64>,
}

/// An outline measured by the user.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GivenOutline {
    /// Centre of the outline, pixels.
    pub centre_px: [f64; 2],
    /// Half the width of the outline, pixels.
    pub radius_px: f64,
}

impl Capture {
    /// All files of the set, relative to its folder: description, photos, masks, calibration frames.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files = vec![PathBuf::from("capture.toml")];
        for view in &self.views {
            files.extend(view.photos.iter().map(|p| p.file.clone()));
            files.extend(view.mask.clone());
        }
        files.extend(self.object.mask.clone());
        files.extend(self.sensor.dark.clone());
        files.extend(self.sensor.flat.clone());
        if let Some(Encoding::Response(file)) = &self.sensor.encoding {
            files.push(file.clone());
        }
        files
    }
}
