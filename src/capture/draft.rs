//! A first `capture.toml` for a folder of photos: what their headers say is filled in, what only
//! the photographer knows is left to fill in and said.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::to_toml::{path as toml_path, quoted};
use crate::error::{Error, Kind, Result};
use crate::photo::{self, Format, Info, Storage, natural_order};

/// A description to start from.
#[derive(Clone, Debug, PartialEq)]
pub struct Draft {
    /// The text of a `capture.toml`. It reads only after the lines marked `FILL IN` are completed.
    pub toml: String,
    /// What is left to fill in, one sentence each.
    pub to_do: Vec<String>,
    /// What looks odd in the photos, one sentence each.
    pub warnings: Vec<String>,
}

/// The deepest folder below the capture's own that is searched for photos.
const DEPTH: usize = 4;

/// The most photos of a draft.
const MOST_PHOTOS: usize = 100_000;

struct Found {
    file: PathBuf,
    info: Info,
}

/// Drafts a description of the photos in a folder and the folders in it.
///
/// Photos are taken in the order in which people count their names. Successive photos whose
/// exposure times change are one bracket, until an exposure time comes again.
///
/// # Errors
/// The folder cannot be read, or holds no photos.
pub fn draft(folder: &Path) -> Result<Draft> {
    let mut files = Vec::new();
    search(folder, Path::new(""), DEPTH, &mut files)?;
    files.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    let read: Vec<(PathBuf, Result<Info>)> = files
        .into_par_iter()
        .map(|file| {
            let info = photo::info(&folder.join(&file));
            (file, info)
        })
        .collect();
    let mut warnings = Vec::new();
    let mut photos = Vec::new();
    for (file, info) in read {
        match info {
            Ok(info) => photos.push(Found { file, info }),
            // The photo may be sound: a draft without it would be of another set.
            Err(error) if error.kind() == Kind::Failed => return Err(error),
            Err(error) => warnings.push(format!(
                "\"{}\" is left out: {}",
                file.display(),
                error.to_string().lines().next().unwrap_or_default()
            )),
        }
    }
    if photos.is_empty() {
        return Err(
            Error::input("expected photos (EXR, PNG, TIFF, JPEG, HDR or RAW), found none")
                .file(folder)
                .advice("Put the photos into this folder or into one below it."),
        );
    }
    let name = folder
        .canonicalize()
        .ok()
        .and_then(|f| Some(f.file_name()?.to_string_lossy().into_owned()))
        .unwrap_or_else(|| "capture".to_string());
    warnings.extend(oddities(&photos));
    let mut to_do = Vec::new();
    let mut toml = String::new();
    // Writing to a String cannot fail.
    let _ = write_draft(&mut toml, &mut to_do, &name, &photos);
    Ok(Draft {
        toml,
        to_do,
        warnings,
    })
}

/// Photo files below `folder`, relative to it, by the endings that photos have.
fn search(folder: &Path, below: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<()> {
    const ENDINGS: [&str; 18] = [
        "exr", "png", "tif", "tiff", "jpg", "jpeg", "hdr", "pic", "dng", "nef", "arw", "cr2",
        "cr3", "raf", "rw2", "orf", "pef", "srw",
    ];
    let here = folder.join(below);
    let entries = std::fs::read_dir(&here).map_err(|cause| Error::read(&here, cause))?;
    for entry in entries {
        let entry = entry.map_err(|cause| Error::read(&here, cause))?;
        let path = below.join(entry.file_name());
        let kind = entry
            .file_type()
            .map_err(|cause| Error::read(&here, cause))?;
        if path.to_str().is_none() || entry.file_name().to_string_lossy().starts_with('.') {
            continue;
        }
        if kind.is_dir() && depth > 0 {
            search(folder, &path, depth - 1, files)?;
        } else if kind.is_file() {
            let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
            let is_photo = ending.is_some_and(|e| ENDINGS.contains(&e.as_str()));
            if is_photo && !is_calibration(&path) {
                files.push(path);
            }
        }
        if files.len() > MOST_PHOTOS {
            return Err(Error::input(format!("expected at most {MOST_PHOTOS} photos")).file(here));
        }
    }
    Ok(())
}

/// Whether a file is by its name no view: a dark frame, a flat field, a mask.
fn is_calibration(path: &Path) -> bool {
    let name = path.to_string_lossy().to_lowercase();
    ["dark", "flat", "mask"].iter().any(|word| {
        name.split(['/', '\\']).any(|part| {
            part.strip_prefix(word)
                .is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_lowercase() && c != 's'))
        })
    })
}

/// What differs between photos that should be alike.
fn oddities(photos: &[Found]) -> Vec<String> {
    let mut warnings = Vec::new();
    let mut differs = |what: &str, value: &dyn Fn(&Info) -> String| {
        let mut values: Vec<String> = photos.iter().map(|p| value(&p.info)).collect();
        values.sort();
        values.dedup();
        if values.len() > 1 {
            values.truncate(4);
            warnings.push(format!(
                "the photos differ in {what}: {}",
                values.join("; ")
            ));
        }
    };
    let stated = |x: Option<f64>| x.map_or("not stated".to_string(), |x| format!("{x}"));
    differs("size", &|i| format!("{} x {}", i.size[0], i.size[1]));
    differs("channels", &|i| i.channels.join(","));
    differs("storage", &|i| format!("{:?}", i.storage));
    differs("ISO sensitivity", &|i| stated(i.shot.iso));
    differs("aperture", &|i| stated(i.shot.f_number));
    differs("focal length", &|i| stated(i.shot.focal_mm));
    warnings
}

/// Successive photos of one camera position, by their exposure times: a bracket ends before a
/// time that it already holds. Without exposure times every photo is a view.
fn brackets(photos: &[Found]) -> Vec<&[Found]> {
    let same = |a: &Found, b: &Found| match (a.info.shot.exposure_s, b.info.shot.exposure_s) {
        (Some(a), Some(b)) => (a / b).ln().abs() < 0.01,
        _ => true,
    };
    let mut groups = Vec::new();
    let mut start = 0;
    for i in 1..=photos.len() {
        let group = photos.get(start..i).unwrap_or(&[]);
        let ends = match photos.get(i) {
            Some(next) => group.iter().any(|earlier| same(earlier, next)),
            None => true,
        };
        if ends {
            groups.push(group);
            start = i;
        }
    }
    groups
}

fn write_draft(
    out: &mut String,
    to_do: &mut Vec<String>,
    name: &str,
    photos: &[Found],
) -> std::fmt::Result {
    let Some(first) = photos.first().map(|p| &p.info) else {
        return Ok(());
    };
    let [width, height] = first.size;
    writeln!(out, "format = 1\nname = {}\n", quoted(name))?;
    writeln!(
        out,
        "[object]\nshape = # FILL IN: \"cylinder\" or \"sphere\""
    )?;
    writeln!(out, "radius = # FILL IN: metres")?;
    to_do.push("object.shape: \"cylinder\" or \"sphere\"".into());
    to_do.push("object.radius: in metres".into());
    writeln!(
        out,
        "\n[camera]\nprojection = \"perspective\"\nimage_size = [{width}, {height}]"
    )?;
    match (first.shot.focal_mm, first.shot.focal_35mm) {
        (_, Some(equivalent)) => {
            // The 35 mm equivalent is rounded to whole millimetres by most cameras.
            writeln!(
                out,
                "focal_mm = {equivalent:?}  # 35 mm equivalent, from EXIF: coarse; calibrate it"
            )?;
            writeln!(out, "sensor_width_mm = 36.0")?;
            to_do.push("camera.focal_px: a calibrated one; EXIF's is coarse".into());
        }
        (Some(focal), None) => {
            writeln!(out, "focal_mm = {focal:?}  # from EXIF")?;
            writeln!(out, "sensor_width_mm = # FILL IN: the width of the sensor")?;
            to_do.push("camera.sensor_width_mm: from the camera's data sheet".into());
        }
        (None, None) => {
            writeln!(
                out,
                "focal_px = # FILL IN: or fov_x_deg, or focal_mm and sensor_width_mm"
            )?;
            to_do.push("camera.focal_px: or fov_x_deg, or focal_mm and sensor_width_mm".into());
        }
    }
    writeln!(
        out,
        "distance = # FILL IN: camera to the object's centre, metres"
    )?;
    to_do.push("camera.distance: from the camera to the object's centre, in metres".into());
    writeln!(out, "\n[sensor]")?;
    let encoding = match (first.format, first.storage) {
        (Format::Exr | Format::Hdr | Format::Raw, _) | (_, Storage::Half | Storage::Float) => {
            "linear"
        }
        (_, Storage::Integer { max: 0..=255 }) => "srgb",
        _ => "linear",
    };
    writeln!(
        out,
        "encoding = \"{encoding}\"  # linear | srgb | gamma:2.2 | response:FILE.csv | recover"
    )?;
    if let Storage::Integer { .. } = first.storage {
        to_do.push(format!(
            "sensor.encoding: \"{encoding}\" is a guess from the file type"
        ));
        writeln!(
            out,
            "# black_level, white_level, full_well_e, read_noise_e: for error bars from the sensor"
        )?;
    }

    let groups = brackets(photos);
    let step = 360.0 / groups.len() as f64;
    to_do.push(format!(
        "view.orbit_deg: an even full circle of {} views is assumed, counter-clockwise",
        groups.len()
    ));
    if photos.iter().any(|p| p.info.shot.exposure_s.is_none()) {
        to_do.push("exposure_s: the photos do not state it; needed if exposures differ".into());
    }
    for (i, group) in groups.into_iter().enumerate() {
        // Multiples of an exact step, without the dust of binary fractions.
        let orbit = (i as f64 * step * 1e9).round() / 1e9;
        writeln!(out, "\n[[view]]\norbit_deg = {orbit:?}\nphotos = [")?;
        for photo in group {
            write!(out, "    {{ file = {}", toml_path(&photo.file))?;
            if let Some(seconds) = photo.info.shot.exposure_s {
                write!(out, ", exposure_s = {seconds:?}")?;
            }
            writeln!(out, " }},")?;
        }
        writeln!(out, "]")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Capture;

    fn write(path: &Path, exposure: Option<f32>) {
        use exr::prelude::*;
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let channels = SpecificChannels::build()
            .with_channel("Y")
            .with_pixel_fn(|_: Vec2<usize>| (1.0_f32,));
        let mut attributes = LayerAttributes::named("main");
        attributes.exposure = exposure;
        let layer = Layer::new((8, 4), attributes, Encoding::SMALL_LOSSLESS, channels);
        Image::from_layer(layer).write().to_file(path).unwrap();
    }

    #[test]
    fn brackets_are_grouped_and_the_filled_in_draft_reads() {
        let folder = tempfile::tempdir().unwrap();
        for i in 1..=12_u8 {
            let exposure = [0.25, 1.0, 4.0][usize::from(i - 1) % 3];
            write(
                &folder.path().join(format!("views/img_{i}.exr")),
                Some(exposure),
            );
        }
        write(&folder.path().join("dark.exr"), None);
        write(&folder.path().join("masks/1.exr"), None);
        std::fs::write(folder.path().join("views/broken.exr"), "no photo").unwrap();
        let draft = draft(folder.path()).unwrap();
        assert_eq!(draft.warnings.len(), 1, "{:?}", draft.warnings);
        assert!(draft.warnings[0].contains("\"views/broken.exr\" is left out"));
        assert_eq!(draft.toml.matches("FILL IN").count(), 4);
        let text = draft
            .toml
            .replace("shape = #", "shape = \"sphere\" #")
            .replace("radius = #", "radius = 0.05 #")
            .replace("focal_px = #", "focal_px = 100 #")
            .replace("distance = #", "distance = 1 #");
        let file = folder.path().join("capture.toml");
        let capture = Capture::parse(&text, &file, folder.path()).unwrap();
        let times: Vec<Vec<f64>> = capture
            .views
            .iter()
            .map(|v| v.photos.iter().filter_map(|p| p.exposure_s).collect())
            .collect();
        assert_eq!(times, vec![vec![0.25, 1.0, 4.0]; 4]);
        let orbits: Vec<f64> = capture
            .views
            .iter()
            .map(|v| v.orbit.deg().round())
            .collect();
        assert_eq!(orbits, [0.0, 90.0, 180.0, 270.0]);
        assert_eq!(
            capture.views[3].photos[0].file,
            Path::new("views/img_10.exr")
        );
    }

    #[test]
    fn photos_without_exposure_times_are_views_each() {
        let folder = tempfile::tempdir().unwrap();
        (0..5).for_each(|i| write(&folder.path().join(format!("{i}.exr")), None));
        let draft = draft(folder.path()).unwrap();
        assert_eq!(draft.toml.matches("[[view]]").count(), 5);
        assert!(draft.to_do.iter().any(|t| t.starts_with("exposure_s")));
        let empty = tempfile::tempdir().unwrap();
        assert!(
            super::draft(empty.path())
                .unwrap_err()
                .to_string()
                .contains("found none")
        );
    }
}
