//! All that a run found, in memory: what is written to the output folder and what the report shows.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::fit::FitQuality;
use super::joint::ChannelGauge;
use super::orbit::OrbitRefinement;
use crate::brdf::fit::BrdfModels;
use crate::grid::Grid;
use crate::light_field::{LightField, Part};
use crate::recover::brdf::BrdfEstimate;
use crate::recover::lighting::LightingEstimate;

/// Whether a recovery explains what was measured, from good to bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Up to what good photographs leave.
    Explained,
    /// There are errors that σ does not hold.
    Doubtful,
    /// The result is no measurement.
    Refused,
}

/// What a recovery gives, before it becomes part of a [`Run`].
#[derive(Clone, Debug, Default)]
pub struct Recovered {
    /// As in [`Run`].
    pub residual: Option<LightField>,
    /// As in [`Run`].
    pub view_residual: Option<Part<'static>>,
    /// As in [`Run`].
    pub fit: Vec<FitQuality>,
    /// As in [`Run`].
    pub lighting: Option<LightingEstimate>,
    /// As in [`Run`].
    pub brdf: Option<BrdfEstimate>,
    /// As in [`Run`].
    pub models: Option<BrdfModels>,
    /// As in [`Run`].
    pub gauge: Vec<ChannelGauge>,
    /// As in [`Run`].
    pub warnings: Vec<String>,
    /// What would explain more of the photographs, if a recovery does not and something was found: a cause, in words.
    pub cause: Option<String>,
    /// What to photograph next, a plain sentence; one of the findings.
    pub advice: Option<String>,
}

/// The results of one run. Serialised without its images, which are products of their own.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Run {
    /// Title of the report.
    pub title: String,
    /// `lighting`, `brdf`, `both` or `none`.
    pub recover: String,
    /// `capture.toml` as resolved.
    pub capture_toml: String,
    /// `recipe.toml` as resolved.
    pub recipe_toml: String,
    /// Name of the capture.
    pub capture_name: String,
    /// Channel names.
    pub channels: Vec<String>,
    /// Unit of radiance: `W m⁻² sr⁻¹`, or `relative`.
    pub radiance_unit: String,
    /// |θo′| beyond which samples were left out, radians.
    pub limb_cut: f64,
    /// What was found in each view.
    pub views: Vec<ViewRecord>,
    /// How the orbit angles were refined; `None` if they are known exactly.
    #[serde(default)]
    pub orbit: Option<OrbitRefinement>,
    /// A few photos for the eye.
    pub previews: Vec<Preview>,
    /// The measured light field.
    #[serde(skip, default = "nothing_seen")]
    pub light_field: LightField,
    /// Spectrum of the measured light field, per channel.
    pub spectrum: Vec<Spectrum>,
    /// Measured minus predicted light field; its σ and weight are the measurement's.
    #[serde(skip)]
    pub residual: Option<LightField>,
    /// Measured minus predicted for each photo's strip, a row per view.
    #[serde(skip)]
    pub view_residual: Option<Part<'static>>,
    /// How well the recovery explains the samples, per channel; empty without one.
    pub fit: Vec<FitQuality>,
    /// The recovered lighting.
    pub lighting: Option<LightingEstimate>,
    /// The recovered BRDF slice.
    pub brdf: Option<BrdfEstimate>,
    /// Analytic models fitted to the slice.
    pub models: Option<BrdfModels>,
    /// What a recovery of both left free, per channel; empty for the others.
    pub gauge: Vec<ChannelGauge>,
    /// Plain sentences: what to distrust and what to do about it.
    pub warnings: Vec<String>,
    /// Plain sentences: what can and what cannot be known from this capture.
    pub findings: Vec<String>,
    /// Seconds per stage, in order.
    pub stage_seconds: Vec<(String, f64)>,
    /// blake3 hash of every input file, by its name relative to the capture or recipe.
    pub input_hashes: BTreeMap<String, String>,
    /// Version of this program.
    pub version: String,
}

fn nothing_seen() -> LightField {
    let grid = Grid {
        normals: 0,
        locals: 0,
    };
    LightField::empty(grid, Vec::new())
}

/// Bytes as text, two hexadecimal digits each.
mod hexadecimal {
    use serde::{Deserialize as _, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(bytes: &[u8], to: S) -> Result<S::Ok, S::Error> {
        let digit = |value: u8| char::from(b"0123456789abcdef"[usize::from(value & 15)]);
        let digits = bytes.iter().flat_map(|b| [digit(b >> 4), digit(*b)]);
        let mut text = String::with_capacity(2 * bytes.len());
        text.extend(digits);
        to.serialize_str(&text)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u8>, D::Error> {
        let text = String::deserialize(from)?;
        let digit = |d: u8| char::from(d).to_digit(16);
        text.as_bytes()
            .chunks(2)
            .map(|pair| match pair {
                [a, b] => Some((16 * digit(*a)? + digit(*b)?) as u8),
                _ => None,
            })
            .collect::<Option<_>>()
            .ok_or_else(|| serde::de::Error::custom("expected pairs of hexadecimal digits"))
    }
}

/// What was found in one view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewRecord {
    /// Direction to the camera, degrees.
    pub orbit_deg: f64,
    /// First photo of the view, relative to the capture's folder.
    pub file: String,
    /// Centre of the outline used, pixels.
    pub centre_px: [f64; 2],
    /// Its standard deviation across the measured line, pixels.
    pub centre_sigma_px: f64,
    /// Half the width of the outline used, pixels.
    pub radius_px: f64,
    /// Whether the left and the right limb were seen in this photo.
    pub limbs_seen: [bool; 2],
    /// Number of samples that this view gave, over all columns, in the first channel.
    pub samples: usize,
}

/// A photo made small, with the geometry to be drawn over it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Preview {
    /// Index of the view.
    pub view: usize,
    /// Width and height of the preview, preview pixels.
    pub size: [u32; 2],
    /// sRGB bytes, row-major, 3 per pixel, tone-mapped for the eye.
    #[serde(with = "hexadecimal")]
    pub rgb: Vec<u8>,
    /// Photo pixels per preview pixel.
    pub scale: f64,
    /// The outline as polylines, preview pixels.
    pub outline: Vec<Vec<[f64; 2]>>,
    /// The line along which was measured, preview pixels.
    pub measured_line: Vec<[f64; 2]>,
    /// First and last photo row that was averaged, preview pixels.
    pub measured_rows: [f64; 2],
}

/// Magnitudes of a light field's Fourier coefficients in α, over the columns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spectrum {
    /// Channel name.
    pub channel: String,
    /// Root mean square over θo′ of |B_p(θo′)|, for p = 0, 1, 2 ….
    pub magnitude: Vec<f64>,
    /// The value that noise alone would give.
    pub noise_floor: Vec<f64>,
    /// |B_{p,q}| as an image, \[p\]\[q + q_max\], for 0 ≤ p and −q_max ≤ q ≤ q_max.
    pub image: Vec<Vec<f64>>,
}
