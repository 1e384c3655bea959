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

/// ISO sensitivities and apertures that run over more than this factor are warned of: a setting is one of steps of a tenth or more, and what is
/// written of one setting differs by rounding alone.
const SETTING_CHANGE: f64 = 1.01;

/// Steps of an even orbit that may be missing from the full circle, or from a numbering, for photos to be taken for missing: a
/// longer gap is meant.
const MOST_MISSING: f64 = 3.0;
const MOST_SKIPPED: u64 = 10;

/// The object's width in parts of the photo's beyond which the description is doubted.
const MOST_WIDE: f64 = 1.3;
const LEAST_WIDE: f64 = 0.05;

/// The width of an object (pixels) below which its description cannot be meant.
const LEAST_PIXELS: f64 = 4.0;

/// How far a limb may lie out of the picture by the description, whose lengths are rough: pixels, and part of the
/// object's width.
const CUT_PX: f64 = 2.0;
const CUT_SHARE: f64 = 0.03;

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
    findings.warnings.extend(gaps(capture));
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

/// Where the object is in the photos, by the description alone: what is doubtful about its size, and whether it is cut by
/// the frame at a side or too small to be measured, which no photo can make good. An outline given by hand is believed.
pub fn framing(capture: &Capture) -> (Vec<String>, Option<Error>) {
    let (object, camera) = (&capture.object, &capture.camera);
    let width = f64::from(camera.image_size[0]);
    let sine = (object.radius / camera.distance).clamp(0.0, 0.999_999);
    // Half the width on the image of a camera of focal length 1, and pixels to that unit.
    let (half, scale) = match camera.projection {
        super::Projection::Perspective { focal_px } => (sine.asin().tan(), focal_px),
        super::Projection::Orthographic { metres_per_px } => (object.radius, 1.0 / metres_per_px),
    };
    let across = 2.0 * half * scale;
    let stated = format!(
        "radius {} m, distance {} m and the focal length make the object {} pixels wide in photos of {width:.0}",
        object.radius,
        camera.distance,
        pixels(across)
    );
    let hint = if across > width {
        if across > 100.0 * width {
            "check focal_px, radius and distance"
        } else if across / 2.0 < width {
            "is focal_px that of a picture of twice the size?"
        } else if camera.distance < 50.0 * object.radius {
            "is the radius a diameter, or in other units than the distance?"
        } else {
            "check focal_px"
        }
    } else if across >= LEAST_WIDE * width {
        "check principal_point_px"
    } else if camera.distance > 500.0 * object.radius {
        "is the distance in millimetres? All lengths are in metres"
    } else {
        "check focal_px, which is in pixels, not in millimetres"
    };
    let fault = |what: String| {
        let advice = format!("The description gives {stated}; {hint}");
        let error = Error::input(what).file("capture.toml").key("camera");
        error.advice(advice.replace("gives radius", "says: radius"))
    };
    if capture.views.iter().all(|view| view.outline.is_some()) {
        return (Vec::new(), None);
    }
    if !(across >= LEAST_PIXELS) {
        let what = format!(
            "the object is {across:.1} pixels wide in the photos, expected at least {LEAST_PIXELS}"
        );
        return (Vec::new(), Some(fault(what)));
    }
    // A plane that is rolled onto its side crosses the picture from top to bottom.
    let level = |roll: f64| roll.cos().abs() > 0.7;
    if capture.views.iter().all(|view| level(view.plane_roll)) {
        let limb =
            |sign: f64| camera.principal_point_px[0] + sign * scale * distorted(capture, half);
        let margin = CUT_PX + CUT_SHARE * across;
        let cut = [limb(-1.0) < -margin, limb(1.0) > width + margin];
        let sides = match cut {
            [true, true] => "both sides",
            [true, false] => "the left side",
            [false, true] => "the right side",
            [false, false] => "",
        };
        if !sides.is_empty() {
            let what = format!(
                "the object is cut at {sides}: expected its limbs in columns 0 to {width:.0}, and by the description they are at {} and {} pixels",
                pixels(limb(-1.0)),
                pixels(limb(1.0))
            );
            return (Vec::new(), Some(fault(what)));
        }
    }
    if across > MOST_WIDE * width || across < LEAST_WIDE * width {
        return (vec![format!("{stated}; {hint}")], None);
    }
    (Vec::new(), None)
}

/// A number of pixels for people, however absurd.
fn pixels(value: f64) -> String {
    match value.abs() {
        v if v < 1e6 => format!("{value:.0}"),
        _ => format!("{value:.1e}"),
    }
}

/// Distance from the principal point on the image of a camera of focal length 1, with the lens's radial distortion.
fn distorted(capture: &Capture, r: f64) -> f64 {
    let [k1, k2, _, _, k3] = capture.camera.distortion;
    let r2 = r * r;
    let moved = r * (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)));
    match capture.camera.projection {
        super::Projection::Perspective { .. } if moved.is_finite() => moved,
        _ => r,
    }
}

/// What an even orbit's file names and angles say of a photo that is missing: all after it would stand a
/// step too early.
fn gaps(capture: &Capture) -> Vec<String> {
    let mut warnings = Vec::new();
    let orbits: Vec<f64> = capture.views.iter().map(|view| view.orbit.deg()).collect();
    let (Some(first), Some(second)) = (orbits.first(), orbits.get(1)) else {
        return warnings;
    };
    let step = second - first;
    let even = orbits
        .windows(2)
        .all(|pair| (pair[1] - pair[0] - step).abs() < 1e-6 * step.abs());
    if !even || orbits.len() < 4 {
        return warnings;
    }
    let numbers: Option<Vec<(u64, &Path)>> = capture
        .views
        .iter()
        .map(|view| {
            let file = &view.photos.first()?.file;
            Some((
                last_number(&file.file_stem()?.to_string_lossy())?,
                file.as_path(),
            ))
        })
        .collect();
    if let Some(numbers) = numbers {
        let mut strides: Vec<u64> = numbers
            .windows(2)
            .map(|pair| pair[1].0.abs_diff(pair[0].0))
            .collect();
        strides.sort_unstable();
        let usual = strides.get(strides.len() / 2).copied().unwrap_or(1);
        for pair in numbers.windows(2) {
            let stride = pair[1].0.abs_diff(pair[0].0);
            // Steps that are no multiple of the usual one are no numbering.
            if usual > 0 && stride > usual && stride % usual == 0 && stride <= MOST_SKIPPED * usual {
                warnings.push(format!(
                    "the files jump from \"{}\" to \"{}\" and their angles do not: if {} missing, all views from there on stand too early; list them with [[view]]",
                    pair[0].1.display(),
                    pair[1].1.display(),
                    match stride / usual - 1 {
                        1 => "a photo is".to_string(),
                        n => format!("{n} photos are"),
                    }
                ));
            }
        }
    }
    let short = 360.0 - orbits.len() as f64 * step.abs();
    if short.abs() > 1e-6 * 360.0 && short <= MOST_MISSING * step.abs() && short > -step.abs() {
        warnings.push(format!(
            "{} views {:.4} degrees apart make {:.2} degrees, not 360: is a photo missing, or orbit_step_deg another?",
            orbits.len(),
            step.abs(),
            orbits.len() as f64 * step.abs()
        ));
    }
    warnings
}

/// The last run of digits of a name.
fn last_number(name: &str) -> Option<u64> {
    let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let digits = name.get(..end)?;
    let start = digits.rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| {
        at + digits[at..].chars().next().map_or(1, char::len_utf8)
    });
    digits.get(start..)?.parse().ok()
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
                        [camera]\nimage_size = [8, 4]\nfocal_px = 60\ndistance = 1\n"
                .to_string();
        for (i, name) in ["a.exr", "b.exr", "c.exr", "d.png"].iter().enumerate() {
            text += &format!("[[view]]\norbit_deg = {i}\nfile = \"{name}\"\nexposure_s = 2\n");
        }
        let capture = Capture::parse(&text, Path::new("capture.toml"), folder.path()).unwrap();
        let findings = check(&capture);
        let faults: Vec<String> = findings.faults.iter().map(Error::to_string).collect();
        assert_eq!(faults.len(), 4, "{faults:#?}");
        for (fault, expected) in faults.iter().zip([
            "c.exr, view 2: expected an EXR",
            "b.exr, view 1: expected 8 x 4 pixels",
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

    /// What is said of `count` photos of 8 x 4 pixels, named `v_1.exr` and on, without those of `absent`.
    fn said(camera: &str, count: usize, absent: &[usize], step: f64) -> (String, String) {
        let folder = tempfile::tempdir().unwrap();
        for i in (1..=count).filter(|i| !absent.contains(i)) {
            write(&folder.path().join(format!("v_{i}.exr")), (8, 4), 1.0);
        }
        let text = format!(
            "format = 1\n[object]\nshape = \"cylinder\"\nradius = 0.05\n[camera]\n{camera}\n\
             [views]\nfiles = \"v_*.exr\"\norbit_step_deg = {step}\n"
        );
        let capture = match Capture::parse(&text, Path::new("capture.toml"), folder.path()) {
            Ok(capture) => capture,
            Err(error) => return (error.to_string(), String::new()),
        };
        let findings = check(&capture);
        let faults: Vec<String> = findings.faults.iter().map(Error::to_string).collect();
        (faults.join("\n"), findings.warnings.join("\n"))
    }

    #[test]
    fn swapped_width_and_height_are_said_once() {
        let (faults, _) = said(
            "image_size = [4, 8]\nfocal_px = 40\ndistance = 1",
            8,
            &[],
            45.0,
        );
        assert!(
            faults.contains("all 8 photos have 8 x 4") && faults.contains("image_size = [8, 4]"),
            "{faults}"
        );
        assert!(faults.contains("swapped"), "{faults}");
        assert_eq!(faults.matches("expected").count(), 1, "{faults}");
    }

    #[test]
    fn an_orbit_without_photos_is_one_fault() {
        let (faults, _) = said("focal_px = 40\ndistance = 1", 0, &[], 45.0);
        assert!(
            faults.contains("expected files like \"v_*.exr\", found none"),
            "{faults}"
        );
        assert_eq!(faults.matches("expected").count(), 1, "{faults}");
    }

    #[test]
    fn units_and_focal_lengths_are_doubted() {
        let camera =
            |focal: f64, distance: f64| format!("focal_px = {focal}\ndistance = {distance}");
        // 2 · 60 px · 0.05 = 6 of 8 pixels.
        let told = |camera: &str| {
            let (faults, warnings) = said(camera, 8, &[], 45.0);
            faults + &warnings
        };
        assert_eq!(told(&camera(60.0, 1.0)), "");
        let wide = told(&camera(150.0, 1.0));
        assert!(
            wide.contains("cut at both sides") && wide.contains("twice the size"),
            "{wide}"
        );
        assert!(told(&camera(60.0, 1000.0)).contains("millimetres"));
        assert!(told(&camera(2.0, 1.0)).contains("focal_px"));
        let (faults, _) = said("focal_px = 60\ndistance = 0.04", 8, &[], 45.0);
        assert!(faults.contains("radius in millimetres"), "{faults}");
    }

    #[test]
    fn missing_photos_of_an_orbit_are_suspected() {
        let camera = "focal_px = 60\ndistance = 1";
        let warned = |count, absent: &[usize], step| said(camera, count, absent, step).1;
        let one = warned(24, &[7], 15.0);
        assert!(
            one.contains("jump from \"v_6.exr\" to \"v_8.exr\"")
                && one.contains("a photo is missing"),
            "{one}"
        );
        assert!(
            one.contains("23 views 15.0000 degrees apart make 345.00 degrees"),
            "{one}"
        );
        assert!(warned(24, &[7, 8], 15.0).contains("2 photos are missing"));
        // Half an orbit is no mistake, nor is a full one.
        assert!(!warned(12, &[], 15.0).contains("not 360"));
        assert_eq!(warned(24, &[], 15.0), "");
    }

    #[test]
    fn a_sound_set_has_nothing_wrong() {
        let folder = tempfile::tempdir().unwrap();
        for i in 0..8 {
            write(&folder.path().join(format!("{i}.exr")), (8, 4), 1.0);
        }
        let text = "format = 1\n[object]\nshape = \"cylinder\"\nradius = 0.05\n\
                    [camera]\nfocal_px = 60\ndistance = 1\n[views]\nfiles = \"*.exr\"\norbit_step_deg = 45\n";
        let capture = Capture::parse(text, Path::new("capture.toml"), folder.path()).unwrap();
        assert_eq!(capture.camera.image_size, [8, 4]);
        let findings = check(&capture);
        assert!(
            findings.faults.is_empty() && findings.warnings.is_empty(),
            "{findings:?}"
        );
    }
}
