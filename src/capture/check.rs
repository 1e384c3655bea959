//! Everything that can be seen to be wrong with a capture set before any long work: headers of all
//! photos and frames, and what the views as a whole cover.

mod framing;
mod orbit;

use std::path::Path;

use rayon::prelude::*;

use super::Capture;
use crate::error::Error;
use crate::photo::{self, Format, Info, Storage};
pub use framing::framing;

/// What a look at all headers found.
#[derive(Debug, Default)]
pub struct Findings {
    /// What makes a photo, or the whole set, unusable.
    pub faults: Vec<Error>,
    /// What may be meant, but costs accuracy or looks like a mistake; one sentence each.
    pub warnings: Vec<String>,
}

/// Stated exposure times that differ from EXIF's by more than this are warned of (log): the
/// numbers on the dial are rounded by up to 7 %.
const TIME_DIFFERENCE: f64 = 0.1;

/// ISO sensitivities and apertures that run over more than this factor are warned of: a setting is one of steps of a tenth or more, and what is
/// written of one setting differs by rounding alone.
const SETTING_CHANGE: f64 = 1.01;

/// Looks at the headers of all photos, masks and frames of a capture set that was read, and at the
/// set as a whole. No pixels are decoded.
pub fn check(capture: &Capture) -> Findings {
    let mut findings = Findings::default();
    let photos: Vec<(usize, &super::Photo)> = capture
        .views
        .iter()
        .enumerate()
        .flat_map(|(i, view)| view.photos.iter().map(move |photo| (i, photo)))
        .collect();
    let infos: Vec<Option<Info>> = photos
        .par_iter()
        .map(|(view, photo)| {
            photo::info(&capture.folder.join(&photo.file)).map_err(|e| e.view(*view))
        })
        .collect::<Vec<_>>()
        .into_iter()
        .map(|result| result.map_err(|fault| findings.faults.push(fault)).ok())
        .collect();
    findings.faults.extend(sizes(capture, &photos, &infos));
    for file in frames(capture) {
        if let Err(fault) = info(capture, file) {
            findings.faults.push(fault);
        }
    }

    let known = || {
        photos
            .iter()
            .zip(&infos)
            .filter_map(|((v, p), i)| Some((*v, *p, i.as_ref()?)))
    };
    if let Some((_, first_photo, first)) = known().next() {
        for (view, photo, info) in known() {
            if info.channels != first.channels {
                findings.faults.push(
                    Error::input(format!(
                        "expected the channels {} as in \"{}\", found {}",
                        first.channels.join(","),
                        first_photo.file.display(),
                        info.channels.join(",")
                    ))
                    .file(&photo.file)
                    .view(view),
                );
            } else if info.storage != first.storage {
                findings.warnings.push(format!(
                    "\"{}\" is stored as {:?}, \"{}\" as {:?}",
                    photo.file.display(),
                    info.storage,
                    first_photo.file.display(),
                    first.storage
                ));
            }
        }
        findings.warnings.extend(encoding(capture, first));
    }
    for (_, photo, info) in known() {
        if let (Some(stated), Some(header)) = (photo.exposure_s, info.shot.exposure_s)
            && (stated / header).ln().abs() > TIME_DIFFERENCE
        {
            findings.warnings.push(format!(
                "\"{}\": exposure_s is {stated}, its header says {header}",
                photo.file.display()
            ));
        }
    }
    for (what, value) in [
        (
            "ISO sensitivity",
            (|i| i.shot.iso) as fn(&Info) -> Option<f64>,
        ),
        ("aperture", |i| i.shot.f_number),
    ] {
        let mut values: Vec<f64> = known().filter_map(|(_, _, i)| value(i)).collect();
        values.sort_by(f64::total_cmp);
        if let (Some(low), Some(high)) = (values.first(), values.last())
            && high / low > SETTING_CHANGE
        {
            findings.warnings.push(format!(
                "the photos' {what} runs from {low} to {high}: radiances are comparable only at one setting"
            ));
        }
    }
    let (doubts, fault) = framing(capture);
    findings.warnings.extend(doubts);
    findings.faults.extend(fault);
    findings.warnings.extend(orbit::gaps(capture));
    findings.warnings.extend(orbit::coverage(capture));
    findings
}

/// Masks, dark frame and flat field, each once.
fn frames(capture: &Capture) -> Vec<&Path> {
    let sensor = &capture.sensor;
    let whole = [&capture.object.mask, &sensor.dark, &sensor.flat];
    let mut frames: Vec<&Path> = whole
        .into_iter()
        .chain(capture.views.iter().map(|view| &view.mask))
        .filter_map(|file| file.as_deref())
        .collect();
    frames.sort();
    frames.dedup();
    frames
}

/// A file's header, if it can be read and has the camera's image size.
fn info(capture: &Capture, file: &Path) -> Result<Info, Error> {
    // Messages show the path as the description writes it.
    let info = photo::info(&capture.folder.join(file))?;
    if info.size != capture.camera.image_size {
        return Err(wrong_size(capture.camera.image_size, info.size, file));
    }
    Ok(info)
}

/// Photos whose size is not the camera's: one fault if it is the description that is wrong.
fn sizes(
    capture: &Capture,
    photos: &[(usize, &super::Photo)],
    infos: &[Option<Info>],
) -> Vec<Error> {
    let stated = capture.camera.image_size;
    let mut found: Vec<[u32; 2]> = infos.iter().flatten().map(|i| i.size).collect();
    let known = found.len();
    found.dedup();
    if let [[width, height]] = *found
        && [width, height] != stated
        && known > 1
    {
        let fault = Error::input(format!(
            "expected {} x {} pixels, as camera.image_size says, and all {known} photos have {width} x {height}",
            stated[0], stated[1]
        ))
        .file("capture.toml")
        .key("camera.image_size");
        let swapped = [height, width] == stated;
        return vec![fault.advice(if swapped {
            format!("Width and height are swapped: write image_size = [{width}, {height}].")
        } else {
            format!("Write image_size = [{width}, {height}], and give focal_px and principal_point_px in these pixels.")
        })];
    }
    photos
        .iter()
        .zip(infos)
        .filter_map(|((view, photo), info)| Some((*view, *photo, info.as_ref()?)))
        .filter(|(.., info)| info.size != stated)
        .map(|(view, photo, info)| wrong_size(stated, info.size, &photo.file).view(view))
        .collect()
}

fn wrong_size([width, height]: [u32; 2], found: [u32; 2], file: &Path) -> Error {
    let fault = Error::input(format!(
        "expected {width} x {height} pixels, as camera.image_size says, found {} x {}",
        found[0], found[1]
    ))
    .file(file);
    match found == [height, width] {
        true => fault.advice("It lies on its side: turn it, or correct its orientation tag."),
        false => fault,
    }
}

/// What an encoding that is not stated, or does not fit the files, means.
fn encoding(capture: &Capture, first: &Info) -> Vec<String> {
    let mut warnings = Vec::new();
    let integer = matches!(first.storage, Storage::Integer { .. });
    match (&capture.sensor.encoding, first.storage) {
        (None, Storage::Integer { max: 0..=255 }) => warnings.push(
            "sensor.encoding is not stated and the files have 8 bits: sRGB is assumed".to_string(),
        ),
        (None, Storage::Integer { .. }) => warnings.push(
            "sensor.encoding is not stated and the files hold integers: linear is assumed"
                .to_string(),
        ),
        (
            Some(super::Encoding::Srgb | super::Encoding::Gamma(_)),
            Storage::Half | Storage::Float,
        ) => {
            warnings.push(
                "sensor.encoding is a curve, and the files are floating point, which is nearly always linear"
                    .to_string(),
            );
        }
        (Some(super::Encoding::Recover(_)), _) => {
            let alone = |view: &super::View| view.photos.len() < 2;
            if capture.views.iter().all(alone) {
                warnings.push(
                    "sensor.encoding is \"recover\" and no view has several photos: a response is recovered from brackets"
                        .to_string(),
                );
            }
        }
        _ => {}
    }
    if first.format == Format::Jpeg {
        warnings.push(
            "the photos are JPEGs: processed by the camera and lossy; error bars cannot know by how much"
                .to_string(),
        );
    }
    if integer && capture.sensor.full_well_e.is_none() {
        warnings.push(
            "sensor.full_well_e is not stated: the noise is estimated from brackets, or from neighbouring pixels"
                .to_string(),
        );
    }
    warnings
}

#[cfg(test)]
mod tests;
