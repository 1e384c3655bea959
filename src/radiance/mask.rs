//! Masks: what of a photo is to be used.

use std::path::Path;

use super::Radiance;
use super::calibration::of_size;
use crate::capture::Capture;
use crate::error::{Error, Result};
use crate::photo::Storage;

/// The radiance of view `index` with the pixels missing that the masks of the set and of the view exclude;
/// `None` if there is no mask. White is used; what is darker than half is not.
///
/// # Errors
/// A mask cannot be read, has not the camera's image size, or leaves nothing.
pub fn masked(capture: &Capture, index: usize, radiance: &Radiance) -> Result<Option<Radiance>> {
    let of_view = capture.views.get(index).and_then(|view| view.mask.as_ref());
    let masks: Vec<&std::path::PathBuf> = capture.object.mask.iter().chain(of_view).collect();
    if masks.is_empty() {
        return Ok(None);
    }
    let mut out = radiance.clone();
    for file in masks {
        let path = capture.folder.join(file);
        let used = used(&path, radiance).map_err(|e| e.view(index))?;
        for (value, variance) in out.value.iter_mut().zip(&mut out.variance) {
            for ((value, variance), used) in value.iter_mut().zip(variance).zip(&used) {
                if !used {
                    (*value, *variance) = (0.0, f32::INFINITY);
                }
            }
        }
    }
    Ok(Some(out))
}

/// Which pixels of the radiance's rows a mask lets be used.
fn used(path: &Path, radiance: &Radiance) -> Result<Vec<bool>> {
    let mask = of_size(path, radiance.size, radiance.rows.clone())?;
    let half = match mask.storage {
        Storage::Integer { max } => max as f32 / 2.0,
        Storage::Sensor { white, .. } => white as f32 / 2.0,
        Storage::Half | Storage::Float | Storage::SharedExponent => 0.5,
    };
    let channels = mask.values.len().max(1) as f32;
    let used: Vec<bool> = (0..mask.values.first().map_or(0, Vec::len))
        .map(|i| {
            let sum: f32 = mask.values.iter().filter_map(|plane| plane.get(i)).sum();
            sum / channels > half
        })
        .collect();
    if !used.contains(&true) {
        return Err(Error::input(
            "expected a mask with white about the object's cross-section, found none",
        )
        .file(path)
        .advice("White is used, black is not: is it the wrong way round?"));
    }
    Ok(used)
}
