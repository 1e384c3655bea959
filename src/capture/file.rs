//! `capture.toml` to a [`Capture`]: every key is known, in range and complete, or every fault is said.

use std::path::{Path, PathBuf};

use super::path::{inside, is_file_in};
use super::table::{Section, Source};
use super::views::{Headers, evenly_spaced_views, exposures, given_twice, listed_views};
use super::{Camera, Capture, Encoding, Object, Projection, Sensor, Shape};
use crate::error::{Error, Result};
use crate::files;

/// The largest `capture.toml` that is read, bytes: 100,000 views of several photos fit.
const LARGEST_FILE: u64 = 64 << 20;

/// The largest width or height of a photo, pixels.
const LARGEST_SIDE: i64 = 1 << 20;

impl Capture {
    /// Reads and checks a capture set's description.
    ///
    /// `path` is `capture.toml` or the folder that holds it. Pixels are not read; only where the
    /// description leaves `image_size` or exposure times out are they taken from the photos'
    /// headers.
    ///
    /// # Errors
    /// All faults of the description together, with line and key: syntax, unknown keys (with the
    /// nearest known name), values out of range, missing keys, missing files, paths that leave the
    /// folder, views or photos given twice.
    pub fn read(path: &Path) -> Result<Self> {
        let file = if path.is_dir() {
            path.join("capture.toml")
        } else {
            path.to_path_buf()
        };
        let text = files::text_up_to(&file, LARGEST_FILE).map_err(|e| {
            e.advice("`flatlight init DIR` writes a first capture.toml for a folder of photos.")
        })?;
        let folder = match file.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
            _ => PathBuf::from("."),
        };
        Self::parse(&text, &file, &folder)
    }

    /// The description in `text`, with paths relative to `folder`; `file` names it in messages.
    ///
    /// # Errors
    /// As [`Capture::read`].
    pub fn parse(text: &str, file: &Path, folder: &Path) -> Result<Self> {
        let source = Source::new(file, text);
        let table = source.parse()?;
        let capture = whole(&Section::root(&source, &table), folder);
        match (Error::all(source.into_faults()), capture) {
            (None, Some(capture)) => Ok(capture),
            (Some(faults), _) => Err(faults),
            (None, None) => Err(Error::input("the description is incomplete").file(file)),
        }
    }
}

/// `None` only if a fault was reported.
fn whole(root: &Section<'_>, folder: &Path) -> Option<Capture> {
    if let Some(format) = root.integer("format")
        && format != 1
    {
        root.fault(
            "format",
            format!("expected 1, the only format there is, found {format}"),
            Some("A newer flatlight may have written this file."),
        );
    }
    let name = root.text("name").map(str::to_string).or_else(|| {
        let real = folder.canonicalize().ok()?;
        Some(real.file_name()?.to_string_lossy().into_owned())
    });
    let object_section = root.section("object");
    let object = object(&object_section, folder);
    let camera_section = root.section("camera");
    let sensor_section = root.section("sensor");
    let sensor = sensor(&sensor_section, folder);
    sensor_section.check_unknown();

    let mut views = listed_views(root, folder);
    let orbit = root.section("views");
    views.extend(evenly_spaced_views(&orbit, folder));
    // An orbit without photos was reported there.
    if views.is_empty() && !orbit.exists() {
        root.missing(
            "view",
            "Add a [[view]] for each camera position, or [views] files = \"…\" for an even orbit.",
        );
    }
    given_twice(root, &views);
    let mut headers = Headers::read(&views, folder);
    headers.no_photos = views.is_empty();
    if let Some(failed) = headers.failed.take() {
        root.report(failed);
    }
    exposures(root, &mut views, &headers);

    let camera = camera(&camera_section, &headers, object.as_ref());
    if let (Some(camera), Some(object)) = (&camera, &object)
        && camera.distance <= object.radius
    {
        let millimetres = format!(
            "Both are in metres: is the radius in millimetres? Then write radius = {}.",
            object.radius / 1000.0
        );
        camera_section.fault(
            "distance",
            format!(
                "expected a camera outside the object's radius of {} m, found {} m",
                object.radius, camera.distance
            ),
            (object.radius / 1000.0 < camera.distance).then_some(millimetres.as_str()),
        );
    }
    camera_section.check_unknown();
    object_section.check_unknown();
    root.check_unknown();
    Some(Capture {
        name: name.unwrap_or_else(|| "capture".to_string()),
        folder: folder.to_path_buf(),
        object: object?,
        camera: camera?,
        sensor,
        views,
    })
}

/// `[object]` and `[camera]` of another file that describes them with the same keys and no photos;
/// `None` only if a fault was reported.
pub(crate) fn described(root: &Section<'_>, folder: &Path) -> Option<(Object, Camera)> {
    let object_section = root.section("object");
    let object = object(&object_section, folder);
    object_section.check_unknown();
    let camera_section = root.section("camera");
    let camera = camera(
        &camera_section,
        &Headers::read(&[], folder),
        object.as_ref(),
    );
    camera_section.check_unknown();
    Some((object?, camera?))
}

fn object(section: &Section<'_>, folder: &Path) -> Option<Object> {
    let shape = match section.text("shape") {
        Some("cylinder") => Some(Shape::Cylinder),
        Some("sphere") => Some(Shape::Sphere),
        Some(other) => {
            section.fault(
                "shape",
                format!("expected \"cylinder\" or \"sphere\", found \"{other}\""),
                None,
            );
            None
        }
        None => {
            if !section.has("shape") {
                section.missing("shape", "Write shape = \"cylinder\" or shape = \"sphere\".");
            }
            None
        }
    };
    let radius = section.number_where("radius", "a length above 0, in metres", |r| r > 0.0);
    if !section.has("radius") {
        section.missing("radius", "Give the object's radius in metres.");
    }
    Some(Object {
        mask: file(section, "mask", folder),
        shape: shape?,
        radius: radius?,
    })
}

fn camera(section: &Section<'_>, headers: &Headers, object: Option<&Object>) -> Option<Camera> {
    let image_size = match section.numbers::<2>("image_size") {
        Some(size) if size.iter().all(|&n| side(n)) => Some(size.map(|n| n as u32)),
        Some(size) => {
            section.fault(
                "image_size",
                format!(
                    "expected [width, height] in pixels, whole numbers above 0, found {size:?}"
                ),
                None,
            );
            None
        }
        None => {
            if !section.has("image_size") && headers.size.is_none() && !headers.no_photos {
                section.missing(
                    "image_size",
                    "Give [width, height] of the photos in pixels.",
                );
            }
            headers.size.filter(|_| !section.has("image_size"))
        }
    };
    let projection = projection(section, image_size);
    let orthographic = matches!(projection, Some(Projection::Orthographic { .. }));
    let distance = section.number_where("distance", "a length above 0, in metres", |d| d > 0.0);
    if !section.has("distance") && !orthographic {
        section.missing(
            "distance",
            "Give the distance from the camera to the centre of the object, in metres.",
        );
    }
    let orbit_sigma_deg = section
        .number_where("orbit_sigma_deg", "an angle from 0 to 90", |s| {
            (0.0..=90.0).contains(&s)
        })
        .unwrap_or(0.0);
    let principal_point_px = section.numbers::<2>("principal_point_px");
    let distortion = section.numbers::<5>("distortion").unwrap_or([0.0; 5]);
    let image_size = image_size?;
    Some(Camera {
        projection: projection?,
        image_size,
        principal_point_px: principal_point_px.unwrap_or(image_size.map(|n| f64::from(n) / 2.0)),
        distortion,
        // Parallel rays come from no distance in particular: any one outside the object will do.
        distance: distance.or_else(|| Some(10.0 * object.filter(|_| orthographic)?.radius))?,
        orbit_sigma_deg,
    })
}

fn side(n: f64) -> bool {
    n.fract() == 0.0 && (1.0..=LARGEST_SIDE as f64).contains(&n)
}

fn projection(section: &Section<'_>, image_size: Option<[u32; 2]>) -> Option<Projection> {
    let above_0 = |x: f64| x > 0.0;
    let kind = section.text("projection");
    let focal_px = section.number_where("focal_px", "a length above 0, in pixels", above_0);
    let fov = section.number_where("fov_x_deg", "an angle between 0 and 180", |a| {
        a > 0.0 && a < 180.0
    });
    let focal_mm = section.number_where("focal_mm", "a length above 0", above_0);
    let sensor_mm = section.number_where("sensor_width_mm", "a length above 0", above_0);
    let width_m = section.number_where("width_m", "a length above 0, in metres", above_0);
    let width_px = image_size.map(|[w, _]| f64::from(w));

    let scales: Vec<&'static str> = ["focal_px", "fov_x_deg", "focal_mm", "width_m"]
        .into_iter()
        .filter(|key| section.has(key))
        .collect();
    let orthographic = match kind {
        Some("perspective") => false,
        Some("orthographic") => true,
        Some(other) => {
            section.fault(
                "projection",
                format!("expected \"perspective\" or \"orthographic\", found \"{other}\""),
                None,
            );
            return None;
        }
        None => scales == ["width_m"],
    };
    const PERSPECTIVE: &str = "Give focal_px, or fov_x_deg, or focal_mm and sensor_width_mm.";
    const ORTHOGRAPHIC: &str = "Give width_m, the width of the picture on the object in metres.";
    if let [_, second, ..] = scales.as_slice() {
        section.fault(
            second,
            format!(
                "expected one statement of the scale, found {}",
                scales.join(" and ")
            ),
            Some(if orthographic {
                ORTHOGRAPHIC
            } else {
                PERSPECTIVE
            }),
        );
        return None;
    }
    if orthographic {
        if !section.has("width_m") {
            section.missing("width_m", ORTHOGRAPHIC);
        }
        return Some(Projection::Orthographic {
            metres_per_px: width_m? / width_px?,
        });
    }
    if section.has("width_m") {
        section.fault(
            "width_m",
            "expected a focal length, for the projection is perspective",
            Some(PERSPECTIVE),
        );
        return None;
    }
    if scales.is_empty() {
        section.missing("focal_px", PERSPECTIVE);
        return None;
    }
    if section.has("focal_mm") != section.has("sensor_width_mm") {
        section.fault(
            "focal_mm",
            "expected focal_mm and sensor_width_mm together, found one of them",
            Some(PERSPECTIVE),
        );
        return None;
    }
    let focal_px = match (focal_px, fov, focal_mm, sensor_mm) {
        (Some(focal), ..) => focal,
        (_, Some(fov), ..) => width_px? / 2.0 / (fov.to_radians() / 2.0).tan(),
        (.., Some(focal), Some(width)) => focal * width_px? / width,
        _ => return None,
    };
    Some(Projection::Perspective { focal_px })
}

/// The keys of `[sensor]`; others are the caller's to read or to report.
pub(crate) fn sensor(section: &Section<'_>, folder: &Path) -> Sensor {
    let encoding = section.text("encoding").and_then(|text| {
        encoding(text, folder)
            .map_err(|what| {
                section.fault(
                    "encoding",
                    what,
                    Some(
                        "Write \"linear\", \"srgb\", \"gamma:2.2\", \"response:FILE.csv\" or \"recover\".",
                    ),
                );
            })
            .ok()
    });
    let black_level = section.number("black_level");
    let white_level = section.number("white_level");
    if let Some(white) = white_level
        && white <= black_level.unwrap_or(0.0)
    {
        section.fault(
            "white_level",
            format!(
                "expected a value above the black level of {}, found {white}",
                black_level.unwrap_or(0.0)
            ),
            None,
        );
    }
    let full_well_e =
        section.number_where("full_well_e", "a number of electrons above 0", |n| n > 0.0);
    let vignetting = section.numbers::<3>("vignetting");
    if let Some([a, b, c]) = vignetting {
        let darkest = (0..=100)
            .map(|i| f64::from(i) / 100.0)
            .map(|r| 1.0 + r * r * (a + r * r * (b + r * r * c)))
            .fold(f64::INFINITY, f64::min);
        if darkest <= 0.0 {
            section.fault(
                "vignetting",
                format!("expected light everywhere in the picture, found a factor of {darkest:.3}"),
                Some("The factor is 1 + a r² + b r⁴ + c r⁶, with r = 1 at the image's corner."),
            );
        }
    }
    Sensor {
        encoding,
        black_level,
        white_level,
        full_well_e,
        read_noise_e: section.number_where(
            "read_noise_e",
            "a number of electrons, 0 or more",
            |n| n >= 0.0,
        ),
        responsivity: section.number_where(
            "responsivity",
            "electrons per unit radiance per second, above 0",
            |n| n > 0.0,
        ),
        dark: file(section, "dark", folder),
        flat: file(section, "flat", folder),
        vignetting,
    }
}

/// The encoding a text names, or what is wrong with it.
fn encoding(text: &str, folder: &Path) -> std::result::Result<Encoding, String> {
    match text.split_once(':') {
        None if text == "linear" => Ok(Encoding::Linear),
        None if text == "srgb" => Ok(Encoding::Srgb),
        None if text == "recover" => Ok(Encoding::Recover(None)),
        Some(("gamma", number)) => match number.trim().parse::<f64>() {
            Ok(gamma) if (0.1..=10.0).contains(&gamma) => Ok(Encoding::Gamma(gamma)),
            _ => Err(format!(
                "expected a gamma from 0.1 to 10, found \"{number}\""
            )),
        },
        Some(("response", path)) => {
            let path = inside(path.trim())?;
            is_file_in(folder, &path)?;
            Ok(Encoding::Response(path))
        }
        _ => Err(format!("expected a known encoding, found \"{text}\"")),
    }
}

/// An optional file of the capture's folder.
pub(super) fn file(section: &Section<'_>, key: &'static str, folder: &Path) -> Option<PathBuf> {
    let path = inside(section.text(key)?).and_then(|path| is_file_in(folder, &path).map(|()| path));
    path.map_err(|what| section.fault(key, what, None)).ok()
}
