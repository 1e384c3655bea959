//! Whether the pixels that a run needs can be decoded, before any of its work.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;

use super::recipe::LOCALS;
use super::rows::{reaches, rows_needed};
use crate::capture::Capture;
use crate::error::{Error, Result};
use crate::geometry::{CameraModel, Pose, ViewGeometry};
use crate::photo;

/// Decodes the rows about the cross-section of all photos, masks and frames that have a sound header, and says of which that fails. What is
/// wrong with headers and sizes is not said again.
///
/// # Errors
/// If the camera is of no kind that there is.
pub fn damaged(capture: &Capture) -> Result<Vec<Error>> {
    let camera = CameraModel::new(&capture.camera)?;
    let reach = reaches(capture, &camera, LOCALS)
        .into_iter()
        .fold(0.0, f64::max);
    let size = capture.camera.image_size;
    // Each file once, with the rows of all views that it serves and the first of them.
    let mut wanted: BTreeMap<&Path, (Option<usize>, Range<u32>)> = BTreeMap::new();
    for (k, view) in capture.views.iter().enumerate() {
        let geometry =
            ViewGeometry::new(&camera, &capture.object, Pose::nominal(), view.plane_roll);
        let rows = rows_needed(capture, &geometry, reach);
        let own = view.photos.iter().map(|photo| &photo.file);
        let shared = [
            &capture.object.mask,
            &capture.sensor.dark,
            &capture.sensor.flat,
        ];
        let of_view = own.chain(&view.mask).map(|file| (file, Some(k)));
        for (file, k) in of_view.chain(shared.into_iter().flatten().map(|file| (file, None))) {
            let (_, all) = wanted.entry(file).or_insert((k, rows.clone()));
            *all = all.start.min(rows.start)..all.end.max(rows.end);
        }
    }
    let wanted: Vec<_> = wanted.into_iter().collect();
    let mut faults: Vec<(Option<usize>, Error)> = wanted
        .into_par_iter()
        .filter_map(|(file, (view, rows))| {
            let path = capture.folder.join(file);
            let sound = photo::info(&path).is_ok_and(|info| info.size == size);
            let fault = sound.then(|| photo::read(&path, Some(rows)).err())??;
            let fault = match view {
                Some(view) => fault.view(view),
                None => fault,
            };
            Some((view, fault))
        })
        .collect();
    faults.sort_by_key(|(view, _)| *view);
    Ok(faults.into_iter().map(|(_, fault)| fault).collect())
}
