//! A run read back from its folder: `run.json` for all but the images, which are the EXR products.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

use super::run::Run;
use crate::error::{Error, Result};
use crate::files;
use crate::grid::Grid;
use crate::light_field::LightField;
use crate::photo::ExrPart;
use crate::recover::Status;
use crate::recover::brdf::BrdfEstimate;

/// Name of the file that holds all of a run but its images.
pub const RECORD: &str = "run.json";

/// The text of `run.json`.
///
/// # Errors
/// If a number cannot be written as JSON.
pub fn text(run: &Run) -> Result<Vec<u8>> {
    serde_json::to_vec(run)
        .map_err(|e| Error::failed(format!("the run cannot be written as JSON: {e}")))
}

/// The run that a folder holds.
///
/// # Errors
/// If a file is missing, damaged, or of another version of this program.
pub fn read_back(folder: &Path) -> Result<Run> {
    let path = folder.join(RECORD);
    let bytes = files::bytes(&path)
        .map_err(|e| e.advice("Give the folder that `flatlight run` wrote with --out."))?;
    let mut run: Run = serde_json::from_slice(&bytes).map_err(|e| {
        Error::read(&path, e).advice("Run the recipe again with this version of the program.")
    })?;
    run.light_field = light_field(&folder.join("light_field.exr"), &run.channels)?;
    let residual = folder.join("residual.exr");
    if residual.exists() {
        run.residual = Some(light_field(&residual, &run.channels)?);
    }
    if let Some(brdf) = &mut run.brdf {
        fill(brdf, &folder.join("brdf.exr"))?;
    }
    if let Some(models) = &mut run.models {
        models.restore().map_err(|e| e.file(&path))?;
    }
    Ok(run)
}

fn plane(part: &ExrPart, name: &str, path: &Path) -> Result<Vec<f32>> {
    part.planes
        .iter()
        .find(|(n, _)| n == name)
        .map(|(_, values)| values.clone())
        .ok_or_else(|| Error::input(format!("expected a layer {name}, found none")).file(path))
}

fn light_field(path: &Path, channels: &[String]) -> Result<LightField> {
    let part = ExrPart::read(path)?;
    let layer = |layer: &str| -> Result<Vec<Vec<f32>>> {
        channels
            .iter()
            .map(|c| plane(&part, &format!("{layer}.{c}"), path))
            .collect()
    };
    Ok(LightField {
        grid: Grid {
            normals: part.size[1],
            locals: part.size[0],
        },
        channels: channels.to_vec(),
        mean: layer("mean")?,
        sigma: layer("sigma")?,
        weight: layer("weight")?,
    })
}

/// The arrays of a slice from `brdf.exr`; the bound is not part of it.
fn fill(brdf: &mut BrdfEstimate, path: &Path) -> Result<()> {
    let part = ExrPart::read(path)?;
    let n = brdf.size;
    if part.size != [n, n] {
        return Err(Error::input(format!(
            "expected {n} × {n} cells, found {} × {}",
            part.size[0], part.size[1]
        ))
        .file(path));
    }
    let cosine = |k: usize| (-FRAC_PI_2 + (k as f64 + 0.5) * PI / n as f64).cos();
    let times_cosines = |values: Vec<f32>| -> Vec<f64> {
        values
            .into_iter()
            .enumerate()
            .map(|(k, v)| f64::from(v) * cosine(k / n) * cosine(k % n))
            .collect()
    };
    for (name, slice) in brdf.channels.iter().zip(&mut brdf.slices) {
        slice.reciprocal = times_cosines(plane(&part, &format!("rho.{name}"), path)?);
        slice.sigma = times_cosines(plane(&part, &format!("sigma.{name}"), path)?);
        slice.status = plane(&part, &format!("status.{name}"), path)?
            .into_iter()
            .map(|v| match v {
                v if v > 1.5 => Status::Determined,
                v if v > 0.5 => Status::Weak,
                _ => Status::Indeterminate,
            })
            .collect();
    }
    Ok(())
}
