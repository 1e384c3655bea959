//! The views of a `capture.toml`: listed one by one or as an even orbit, and what the photos'
//! headers add to them.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::file::file;
use super::path::{inside, is_file_in};
use super::table::Section;
use super::{GivenOutline, Photo, View};
use crate::angle::WorldAngle;
use crate::error::{Error, Kind};
use crate::photo;

fn exposure(section: &Section<'_>) -> Option<f64> {
    let stated = section.number_where("exposure_s", "an exposure time above 0, in seconds", |t| {
        t > 0.0
    });
    // A time that is stated and wrong was reported; it is not missing.
    stated.or_else(|| section.has("exposure_s").then_some(f64::NAN))
}

/// The `[[view]]` tables.
pub(super) fn listed_views(root: &Section<'_>, folder: &Path) -> Vec<View> {
    let mut views = Vec::new();
    for section in root.sections("view", true) {
        let orbit = section.number("orbit_deg");
        if !section.has("orbit_deg") {
            section.missing(
                "orbit_deg",
                "Give the direction from the object to the camera, in degrees.",
            );
        }
        let mut photos = Vec::new();
        for entry in section.sections("photos", false) {
            if !entry.has("file") {
                entry.missing("file", "Name the photo's file.");
            }
            let exposure_s = exposure(&entry);
            photos.extend(file(&entry, "file", folder).map(|file| Photo { file, exposure_s }));
            entry.check_unknown();
        }
        let shorthand_exposure = exposure(&section);
        if section.has("file") {
            if section.has("photos") {
                section.fault(
                    "file",
                    "expected either `file` or `photos`, found both",
                    None,
                );
            }
            photos.extend(file(&section, "file", folder).map(|file| Photo {
                file,
                exposure_s: shorthand_exposure,
            }));
        } else if !section.has("photos") {
            section.missing(
                "photos",
                "Write photos = [{ file = \"…\", exposure_s = … }].",
            );
        } else if section.sections("photos", false).is_empty() {
            section.fault("photos", "expected at least one photo, found none", None);
        } else if section.has("exposure_s") {
            section.fault(
                "exposure_s",
                "expected the exposure time beside each file in `photos`",
                None,
            );
        }
        let roll = section.number("plane_roll_deg").unwrap_or(0.0);
        let mask = file(&section, "mask", folder);
        let outline = outline(&section.section("outline"));
        section.check_unknown();
        views.push(View {
            orbit: WorldAngle::degrees(orbit.unwrap_or(f64::NAN)),
            photos,
            plane_roll: roll.to_radians(),
            mask,
            outline,
        });
    }
    views
}

fn outline(section: &Section<'_>) -> Option<GivenOutline> {
    let centre_px = section.numbers::<2>("centre_px");
    let radius_px = section.number_where("radius_px", "a length above 0, in pixels", |r| r > 0.0);
    if section.exists() && !(section.has("centre_px") && section.has("radius_px")) {
        section.missing("centre_px", "Give both centre_px = [x, y] and radius_px.");
    }
    section.check_unknown();
    Some(GivenOutline {
        centre_px: centre_px?,
        radius_px: radius_px?,
    })
}

/// The `[views]` table: an even orbit written short.
pub(super) fn evenly_spaced_views(section: &Section<'_>, folder: &Path) -> Vec<View> {
    let pattern = section.text("files");
    let start = section.number("orbit_start_deg").unwrap_or(0.0);
    let step = section.number_where("orbit_step_deg", "an angle other than 0", |s| s != 0.0);
    let exposure_s = exposure(section);
    let roll = section.number("plane_roll_deg").unwrap_or(0.0);
    if section.exists() && !section.has("files") {
        section.missing("files", "Write for example files = \"views/*.exr\".");
    }
    if section.exists() && !section.has("orbit_step_deg") {
        section.missing(
            "orbit_step_deg",
            "Give the angle from one view to the next, in degrees.",
        );
    }
    section.check_unknown();
    let Some(pattern) = pattern else {
        return Vec::new();
    };
    let files = match matching(pattern, folder) {
        Ok(files) => files,
        Err(what) => {
            section.fault("files", what, None);
            return Vec::new();
        }
    };
    let step = step.unwrap_or(f64::NAN);
    files
        .into_iter()
        .enumerate()
        .map(|(i, file)| View {
            orbit: WorldAngle::degrees(start + i as f64 * step),
            photos: vec![Photo { file, exposure_s }],
            plane_roll: roll.to_radians(),
            mask: None,
            outline: None,
        })
        .collect()
}

/// The files a pattern names, in the order in which people count.
fn matching(pattern: &str, folder: &Path) -> std::result::Result<Vec<PathBuf>, String> {
    let pattern = inside(pattern)?;
    let full = Path::new(&glob::Pattern::escape(&folder.to_string_lossy())).join(&pattern);
    let paths = glob::glob(&full.to_string_lossy()).map_err(|cause| {
        format!(
            "expected a file name with * or ?, found \"{}\": {cause}",
            pattern.display()
        )
    })?;
    if let Some(name) = not_utf8(folder, &pattern) {
        return Err(format!("the name of \"{name}\" is not UTF-8"));
    }
    let mut files = Vec::new();
    for path in paths {
        let path = path.map_err(|cause| format!("cannot look for files: {cause}"))?;
        let relative = path.strip_prefix(folder).unwrap_or(&path).to_path_buf();
        if relative.to_str().is_none() {
            return Err(format!(
                "the name of \"{}\" is not UTF-8",
                relative.display()
            ));
        }
        files.push(relative);
    }
    // Each is looked at folder by folder.
    let looks: Vec<_> = files
        .par_iter()
        .map(|file| is_file_in(folder, file))
        .collect();
    looks.into_iter().collect::<std::result::Result<(), _>>()?;
    if files.is_empty() {
        return Err(format!(
            "expected files like \"{}\", found none{}",
            pattern.display(),
            held(folder)
        ));
    }
    files.sort_by(|a, b| photo::natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(files)
}

/// What a capture's folder holds, as the end of a sentence.
fn held(folder: &Path) -> String {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| {
            let slash = if entry.path().is_dir() { "/" } else { "" };
            entry.file_name().to_string_lossy().into_owned() + slash
        })
        .collect();
    names.sort_by_key(|name| (!name.ends_with('/'), name.clone()));
    let more = if names.len() > 5 { ", …" } else { "" };
    names.truncate(5);
    if names.is_empty() {
        return String::new();
    }
    format!("; the folder holds {}{more}", names.join(", "))
}

/// A file of the pattern's folder that the pattern would name, were its name UTF-8: patterns pass over such names without a
/// word.
fn not_utf8(folder: &Path, pattern: &Path) -> Option<String> {
    let (above, name) = (pattern.parent()?, pattern.file_name()?);
    let wanted = glob::Pattern::new(&name.to_string_lossy()).ok()?;
    let entries = std::fs::read_dir(folder.join(above)).ok()?;
    entries.flatten().find_map(|entry| {
        let name = entry.file_name();
        let shown = name.to_string_lossy();
        (name.to_str().is_none() && wanted.matches(&shown)).then(|| shown.into_owned())
    })
}

/// Reports views of one direction, and photos used twice for one measurement.
pub(super) fn given_twice(root: &Section<'_>, views: &[View]) {
    let mut directions = HashMap::new();
    let sections = root.sections("view", true);
    let fault = |view: usize, key: &str, what: String, advice: &str| match sections.get(view) {
        Some(section) => section.fault(key, what, Some(advice)),
        None => root.fault("views", what, Some(advice)),
    };
    // One camera that never moved: a mirror ball's photos by several lights, whose directions are to be found.
    let fixed = views.len() > 2
        && views
            .iter()
            .all(|v| v.orbit == views[0].orbit && v.plane_roll == views[0].plane_roll);
    let mut files = HashMap::new();
    let mut turns = Vec::new();
    for (i, view) in views.iter().enumerate() {
        // Angles closer than a millionth of a degree are the same angle written twice.
        let key = |radians: f64| {
            (radians.to_degrees().rem_euclid(360.0) * 1e6).round() as i64 % 360_000_000
        };
        let plane = key(view.plane_roll);
        if !fixed
            && view.orbit.rad().is_finite()
            && let Some(first) = directions.insert((key(view.orbit.rad()), plane), i)
        {
            turns.push((first, i));
        }
        for photo in &view.photos {
            if let Some(first) = files.insert((&photo.file, plane), i) {
                fault(
                    i,
                    "photos",
                    format!(
                        "the photo \"{}\" is used twice, in views {first} and {i}",
                        photo.file.display()
                    ),
                    "One photo may serve several views only if their plane_roll_deg differ.",
                );
            }
        }
    }
    // An orbit of even steps that goes round twice is one mistake.
    let told = if sections.is_empty() {
        turns.len().min(1)
    } else {
        turns.len()
    };
    for &(first, i) in &turns[..told] {
        let others = match turns.len() - told {
            0 => String::new(),
            n => format!(
                ", and {n} more pairs have too: these {} steps go round more than once",
                views.len()
            ),
        };
        let degrees = (views[first].orbit.deg() * 1e6).round() / 1e6;
        fault(
            i,
            "orbit_deg",
            format!("views {first} and {i} have the same orbit angle of {degrees} degrees{others}"),
            "Several photos of one camera position belong into one view's `photos`.",
        );
    }
}

/// What the photos' own headers say, as far as the description leaves it to them.
pub(super) struct Headers {
    /// Size of the first photo that can be opened.
    pub(super) size: Option<[u32; 2]>,
    /// Whether photos should have been there and were not, which was reported.
    pub(super) no_photos: bool,
    /// Exposure time by file, where the description gives none.
    exposure_s: HashMap<PathBuf, Option<f64>>,
    /// What the system could not read; a photo that is damaged is told when its pixels are wanted.
    pub(super) failed: Option<Error>,
}

impl Headers {
    pub(super) fn read(views: &[View], folder: &Path) -> Self {
        use rayon::prelude::*;
        let photos = || views.iter().flat_map(|view| &view.photos);
        let unstated: Vec<&PathBuf> = photos()
            .filter(|photo| photo.exposure_s.is_none())
            .map(|photo| &photo.file)
            .collect();
        let mut failed = None;
        let mut kept = |result: crate::error::Result<photo::Info>| match result {
            Err(error) if error.kind() == Kind::Failed => {
                failed.get_or_insert(error);
                None
            }
            other => other.ok(),
        };
        let size =
            photos().find_map(|photo| Some(kept(photo::info(&folder.join(&photo.file)))?.size));
        let read: Vec<_> = unstated
            .into_par_iter()
            .map(|file| (file.clone(), photo::info(&folder.join(file))))
            .collect();
        let exposure_s = read
            .into_iter()
            .map(|(file, info)| (file, kept(info).and_then(|info| info.shot.exposure_s)))
            .collect();
        Self {
            no_photos: false,
            size,
            exposure_s,
            failed,
        }
    }
}

/// Fills in the exposure times that the photos' headers give; 1 for all if nothing gives any.
pub(super) fn exposures(root: &Section<'_>, views: &mut [View], headers: &Headers) {
    let photos = || views.iter().flat_map(|view| &view.photos);
    let time = |photo: &Photo| {
        photo
            .exposure_s
            .or_else(|| headers.exposure_s.get(&photo.file).copied().flatten())
    };
    let known = photos().filter(|photo| time(photo).is_some()).count();
    let total = photos().count();
    if known != 0
        && known != total
        && let Some(unknown) = photos().find(|photo| time(photo).is_none())
    {
        root.fault(
            "view",
            format!(
                "expected exposure times for all photos or for none, found none for {} of {total}, the first of them \"{}\"",
                total - known,
                unknown.file.display()
            ),
            Some("Add exposure_s to each photo; these files' headers hold none."),
        );
    }
    for photo in views.iter_mut().flat_map(|view| &mut view.photos) {
        photo.exposure_s = Some(
            photo
                .exposure_s
                .or_else(|| headers.exposure_s.get(&photo.file).copied().flatten())
                .unwrap_or(1.0),
        );
    }
}
