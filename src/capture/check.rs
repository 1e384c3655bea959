//! Everything that can be seen to be wrong with a capture set before any long work: headers of all
//! photos and frames, and what the views as a whole cover.

use std::path::Path;

use rayon::prelude::*;

use super::{Capture, Shape};
use crate::error::Error;
use crate::photo::{self, Format, Info, Storage};

/// What a look at all headers found.
#[derive(Debug, Default)]
pub struct Findings {
    /// What makes a photo, or the whole set, unusable.
    pub faults: Vec<Error>,
    /// What may be meant, but costs accuracy or looks like a mistake; one sentence each.
    pub warnings: Vec<String>,
}

/// A gap between neighbouring views beyond which a warning is given, degrees: half the visible half
/// circle, so that every normal is still seen by two views.
const WIDE_GAP_DEG: f64 = 90.0;

/// Stated exposure times that differ from EXIF's by more than this are warned of (log): the
/// numbers on the dial are rounded by up to 7 %.
const TIME_DIFFERENCE: f64 = 0.1;

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
        .map(|(view, photo)| info(capture, &photo.file).map_err(|e| e.view(*view)))
        .collect::<Vec<_>>()
        .into_iter()
        .map(|result| result.map_err(|fault| findings.faults.push(fault)).ok())
        .collect();
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
            && high / low > 1.01
        {
            findings.warnings.push(format!(
                "the photos' {what} runs from {low} to {high}: radiances are comparable only at one setting"
            ));
        }
    }
    findings.warnings.extend(coverage(capture));
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
    let [width, height] = capture.camera.image_size;
    if info.size != [width, height] {
        return Err(Error::input(format!(
            "expected {width} x {height} pixels, as camera.image_size says, found {} x {}",
            info.size[0], info.size[1]
        ))
        .file(file));
    }
    Ok(info)
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

/// What the views leave unseen.
fn coverage(capture: &Capture) -> Vec<String> {
    let mut warnings = Vec::new();
    if capture.views.len() == 1 {
        warnings.push(
            "there is one view only: it is a single line of the light field, and no lighting or BRDF \
             can be separated from it without further knowledge"
                .to_string(),
        );
        return warnings;
    }
    let rolled = capture.views.iter().any(|view| view.plane_roll != 0.0);
    if capture.object.shape == Shape::Cylinder && rolled {
        warnings
            .push("plane_roll_deg is not 0, and a cylinder has only one cross-section".to_string());
    }
    let mut angles: Vec<f64> = capture
        .views
        .iter()
        .map(|view| view.orbit.wrapped().deg())
        .collect();
    angles.sort_by(f64::total_cmp);
    let around = angles.first().map(|first| first + 360.0);
    let gap = angles
        .iter()
        .zip(angles.iter().skip(1).copied().chain(around))
        .map(|(a, b)| b - a)
        .fold(0.0, f64::max);
    if gap > WIDE_GAP_DEG {
        warnings.push(format!(
            "there is a gap of {gap:.1} degrees between neighbouring views: some normals are seen by \
             fewer than two"
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(path: &Path, size: (usize, usize), exposure: f32) {
        use exr::prelude::*;
        let channels = SpecificChannels::build()
            .with_channel("Y")
            .with_pixel_fn(|_: Vec2<usize>| (1.0_f32,));
        let mut attributes = LayerAttributes::named("main");
        attributes.exposure = Some(exposure);
        let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, channels);
        Image::from_layer(layer).write().to_file(path).unwrap();
    }

    #[test]
    fn everything_wrong_comes_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write(&at("a.exr"), (8, 4), 1.0);
        write(&at("b.exr"), (8, 5), 1.0);
        std::fs::write(at("c.exr"), "no photo").unwrap();
        let rgb = image::RgbImage::new(8, 4);
        rgb.save(at("d.png")).unwrap();
        write(&at("mask.exr"), (9, 4), 1.0);
        let mut text =
            "format = 1\n[object]\nshape = \"cylinder\"\nradius = 0.05\nmask = \"mask.exr\"\n\
                        [camera]\nimage_size = [8, 4]\nfocal_px = 9\ndistance = 1\n"
                .to_string();
        for (i, name) in ["a.exr", "b.exr", "c.exr", "d.png"].iter().enumerate() {
            text += &format!("[[view]]\norbit_deg = {i}\nfile = \"{name}\"\nexposure_s = 2\n");
        }
        let capture = Capture::parse(&text, Path::new("capture.toml"), folder.path()).unwrap();
        let findings = check(&capture);
        let faults: Vec<String> = findings.faults.iter().map(Error::to_string).collect();
        assert_eq!(faults.len(), 4, "{faults:#?}");
        for (fault, expected) in faults.iter().zip([
            "b.exr, view 1: expected 8 x 4 pixels",
            "c.exr, view 2: expected an EXR",
            "mask.exr: expected 8 x 4 pixels",
            "d.png, view 3: expected the channels Y as in \"a.exr\", found R,G,B",
        ]) {
            assert!(fault.contains(expected), "{fault}");
        }
        let warnings = findings.warnings.join("\n");
        assert!(
            warnings.contains("\"a.exr\": exposure_s is 2, its header says 1"),
            "{warnings}"
        );
        assert!(warnings.contains("a gap of 357.0 degrees"), "{warnings}");
    }

    #[test]
    fn a_sound_set_has_nothing_wrong() {
        let folder = tempfile::tempdir().unwrap();
        for i in 0..8 {
            write(&folder.path().join(format!("{i}.exr")), (8, 4), 1.0);
        }
        let text = "format = 1\n[object]\nshape = \"cylinder\"\nradius = 0.05\n\
                    [camera]\nfocal_px = 9\ndistance = 1\n[views]\nfiles = \"*.exr\"\norbit_step_deg = 45\n";
        let capture = Capture::parse(text, Path::new("capture.toml"), folder.path()).unwrap();
        assert_eq!(capture.camera.image_size, [8, 4]);
        let findings = check(&capture);
        assert!(
            findings.faults.is_empty() && findings.warnings.is_empty(),
            "{findings:?}"
        );
    }
}
