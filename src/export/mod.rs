//! Results in the forms that other programs read: Mitsuba 3, Blender, MERL tables, ASTM-style tables, NumPy.
//!
//! A run measures the BRDF in the plane of incidence, and light in the plane. A renderer needs more: what is
//! exported as a 3-D material is a model whose slice fits the measured one, and every file says so.

pub mod astm;
mod blender;
mod light;
pub mod merl;
mod mitsuba;
mod npz;
mod surface;

pub use surface::{Layer, Surface};

use std::path::{Path, PathBuf};

use crate::brdf::{Axis, SliceTable};
use crate::error::{Error, Result};
use crate::files;
use crate::pipeline::Run;

/// A form to write results in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `scene.xml` with `material.xml` and `light.xml` for Mitsuba 3: renders what was photographed.
    Mitsuba,
    /// `environment.exr` and `blender.py`, which sets up world, suns and material.
    Blender,
    /// `brdf.binary`, the fitted isotropic model in the form of the MERL database, and `brdf.txt`, its label.
    Merl,
    /// `run.npz`: all arrays for NumPy.
    Npz,
    /// `brdf_astm.csv`: the measured slice in the manner of ASTM E1392.
    Astm,
}

/// Writes a run's results in one form into `folder`, which is made if it does not exist; the files that were written.
///
/// # Errors
/// If the run has nothing that the form can hold, or a file cannot be written.
pub fn export(run: &Run, format: Format, folder: &Path) -> Result<Vec<PathBuf>> {
    let files: Vec<(&str, Vec<u8>)> = match format {
        Format::Mitsuba => mitsuba::files(run)?,
        Format::Blender => blender::files(run)?,
        Format::Merl => {
            let surface = Surface::of(run)?;
            vec![
                ("brdf.binary", merl::encode(&surface)?),
                ("brdf.txt", merl::label(run, &surface).into_bytes()),
            ]
        }
        Format::Npz => vec![("run.npz", npz::encode(run)?)],
        Format::Astm => {
            let text = astm::encode(&slice(run)?, &run.capture_name, &unit(run));
            vec![("brdf_astm.csv", text.into_bytes())]
        }
    };
    files::make_folder(folder)?;
    let files: Vec<(PathBuf, Vec<u8>)> = files
        .into_iter()
        .map(|(name, bytes)| (folder.join(name), bytes))
        .collect();
    files::write_together(&files)?;
    let mut written: Vec<PathBuf> = files.into_iter().map(|(path, _)| path).collect();
    if format == Format::Blender {
        written.push(light::environment(run, &folder.join("environment.exr"))?);
    }
    Ok(written)
}

/// What every export says of its 3-D material.
const IN_PLANE: &str = "Measured is the slice of the BRDF in the plane of incidence. Everything outside that plane follows from the model, not from a measurement.";

/// The recovered slice, NaN where it is not determined.
///
/// # Errors
/// If the run has none.
fn slice(run: &Run) -> Result<SliceTable> {
    let brdf = run.brdf.as_ref().ok_or_else(|| {
        Error::input("expected a run with a recovered BRDF, found none")
            .advice("Recipes with recover = \"brdf\" or \"both\" recover one.")
    })?;
    let axis = Axis {
        count: brdf.size,
        inclusive: false,
    };
    let layer = |c: usize, pick: fn((f64, f64)) -> f64| -> Vec<f64> {
        let value = |cell: usize| brdf.rho(c, cell / brdf.size, cell % brdf.size);
        (0..brdf.size * brdf.size)
            .map(|cell| value(cell).map_or(f64::NAN, pick))
            .collect()
    };
    let channels = 0..brdf.channels.len();
    Ok(SliceTable {
        channels: brdf.channels.clone(),
        incident: axis,
        exitant: axis,
        rho: channels.clone().map(|c| layer(c, |v| v.0)).collect(),
        sigma: channels.map(|c| layer(c, |v| v.1)).collect(),
    })
}

/// The unit of ρ.
fn unit(run: &Run) -> String {
    let absolute = run.radiance_unit.starts_with('W');
    if absolute {
        "1/sr".to_owned()
    } else {
        "1/sr up to the factor between radiance and the values of the photographs".to_owned()
    }
}

/// Indices of the channels that are red, green and blue: by name, or the only one for all three.
fn rgb(channels: &[String]) -> Result<[usize; 3]> {
    let named = ["R", "G", "B"].map(|name| channels.iter().position(|c| c == name));
    match named {
        [Some(r), Some(g), Some(b)] => Ok([r, g, b]),
        _ if channels.len() == 1 => Ok([0; 3]),
        _ => Err(Error::input(format!(
            "expected the channels R, G and B or a single one, found {}",
            channels.join(", ")
        ))
        .advice("A multispectral run can be exported as npz and astm.")),
    }
}
