//! A view as its photos show it: radiance of some rows, and the outline in them.

use std::ops::Range;

use crate::capture::Capture;
use crate::error::Result;
use crate::geometry::CameraModel;
use crate::geometry::outline::{self, Outline, Search};
use crate::photo::Storage;
use crate::radiance::{self, Developed, Radiance};

/// Some rows of a view, as far as its masks let them be used, and the outline in them.
pub(super) struct Photographed {
    pub(super) radiance: Radiance,
    pub(super) outline: Outline,
    pub(super) exposures: Vec<radiance::Found>,
    pub(super) storage: Storage,
    pub(super) census: radiance::Census,
}

/// Reads some rows of a view.
///
/// # Errors
/// If a photo or a mask cannot be read.
pub(super) fn photographed(
    capture: &Capture,
    camera: &CameraModel,
    view: usize,
    rows: Range<u32>,
) -> Result<Photographed> {
    let Developed {
        radiance,
        exposures,
        storage,
        census,
    } = radiance::develop(capture, view, rows)?;
    let outline = |radiance: &Radiance| find_outline(capture, camera, view, radiance);
    let (radiance, outline) = match radiance::masked(capture, view, &radiance)? {
        None => {
            let outline = outline(&radiance)?;
            (radiance, outline)
        }
        Some(masked) => {
            let mut found = outline(&masked)?;
            // A mask that follows the object hides its limb, which the photo itself may show.
            if found.sides() == [false, false] {
                found = outline(&radiance)?;
            }
            (masked, found)
        }
    };
    Ok(Photographed {
        radiance,
        outline,
        exposures,
        storage,
        census,
    })
}

fn find_outline(
    capture: &Capture,
    camera: &CameraModel,
    view: usize,
    radiance: &Radiance,
) -> Result<Outline> {
    match capture.views[view].outline {
        Some(given) => outline::given(given, camera, &capture.object),
        None => outline::find(radiance, camera, &capture.object, Search::default()),
    }
}

/// The first photo of a view, as the description names it.
pub(super) fn first_file(capture: &Capture, view: usize) -> String {
    photo_file(capture, view, 0)
}

/// A photo of a view, as the description names it; empty if there is none.
pub(super) fn photo_file(capture: &Capture, view: usize, photo: usize) -> String {
    let photos = capture.views.get(view).map(|v| &v.photos);
    photos
        .and_then(|photos| photos.get(photo))
        .map_or_else(String::new, |p| p.file.display().to_string())
}

/// `count` indices spread evenly over 0 … n−1.
pub(super) fn spread(n: usize, count: usize) -> Vec<usize> {
    let mut all: Vec<usize> = (0..count.min(n)).map(|k| k * n / count.min(n)).collect();
    all.dedup();
    all
}
