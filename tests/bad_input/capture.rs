//! `capture.toml`: keys, values, files, angles.

use crate::bench::Format;
use crate::{Ask, Case};

/// A description with one text replaced by another.
fn edited(what: &'static str, from: &'static str, to: &'static str, words: &[&str]) -> Case {
    Case::new(what, move |b| b.edit("capture.toml", from, to), words)
}

const RADIUS: &str = "radius = 0.05";
const DISTANCE: &str = "distance = 0.6";
const FOCAL: &str = "focal_px = 480.0";
const ENCODING: &str = "encoding = \"linear\"";
const FILE: &str = "views/001.exr";

pub(crate) fn cases() -> Vec<Case> {
    let mut cases = object();
    cases.extend(camera());
    cases.extend(sensor());
    cases.extend(views());
    cases.extend(files());
    cases.extend(whole());
    cases
}

fn object() -> Vec<Case> {
    vec![
        edited(
            "radius 0",
            RADIUS,
            "radius = 0",
            &[
                ":6, object.radius: expected a length above 0, in metres, found 0",
                "6 | radius = 0",
            ],
        ),
        edited(
            "radius below 0",
            RADIUS,
            "radius = -0.05",
            &[":6, object.radius", "above 0", "found -0.05"],
        ),
        edited(
            "radius not a number",
            RADIUS,
            "radius = nan",
            &["object.radius", "above 0, in metres", "nan"],
        ),
        edited(
            "radius infinite",
            RADIUS,
            "radius = inf",
            &["object.radius", "above 0, in metres", "inf"],
        ),
        edited(
            "radius with a unit",
            RADIUS,
            "radius = \"5 cm\"",
            &["object.radius", "above 0, in metres", "the text \"5 cm\""],
        ),
        edited(
            "radius a list",
            RADIUS,
            "radius = [0.05]",
            &["object.radius", "above 0, in metres", "a list of 1 values"],
        ),
        edited(
            "radius missing",
            RADIUS,
            "",
            &[
                "object.radius: expected this key, found nothing",
                "in metres",
            ],
        ),
        edited(
            "radius misspelt",
            RADIUS,
            "raduis = 0.05",
            &[":6, object.raduis: unknown key; did you mean `radius`?"],
        ),
        edited(
            "radius given twice",
            RADIUS,
            "radius = 0.05\nradius = 0.06",
            &[":7", "duplicate key", "7 | radius = 0.06"],
        ),
        edited(
            "radius of a planet",
            RADIUS,
            "radius = 6.4e6",
            &["camera.distance", "outside the object's radius"],
        ),
        edited(
            "shape unknown",
            "\"cylinder\"",
            "\"cube\"",
            &[":5, object.shape: expected \"cylinder\" or \"sphere\", found \"cube\""],
        ),
        edited(
            "shape missing",
            "shape = \"cylinder\"",
            "",
            &["object.shape", "found nothing"],
        ),
        edited(
            "shape a number",
            "shape = \"cylinder\"",
            "shape = 3",
            &["object.shape", "a text in quotes", "the number 3"],
        ),
        edited(
            "object a text",
            "[object]\nshape = \"cylinder\"\nradius = 0.05",
            "object = \"cylinder\"",
            &["object", "table"],
        ),
        edited(
            "mask missing",
            RADIUS,
            "radius = 0.05\nmask = \"mask.png\"",
            &[":7, object.mask", "cannot find the file \"mask.png\""],
        ),
        edited(
            "mask out of the folder",
            RADIUS,
            "radius = 0.05\nmask = \"../mask.png\"",
            &["object.mask", "inside the capture's folder"],
        ),
    ]
}

fn camera() -> Vec<Case> {
    vec![
        edited(
            "camera inside the object",
            DISTANCE,
            "distance = 0.04",
            &[
                "camera.distance: expected a camera outside the object's radius of 0.05 m, found 0.04 m",
                "14 | distance = 0.04",
            ],
        ),
        edited(
            "radius in millimetres",
            RADIUS,
            "radius = 50",
            &[
                "camera.distance",
                "is the radius in millimetres? Then write radius = 0.05",
            ],
        ),
        edited(
            "distance missing",
            DISTANCE,
            "",
            &["camera.distance", "found nothing", "in metres"],
        ),
        edited(
            "distance 0",
            DISTANCE,
            "distance = 0",
            &["camera.distance", "above 0"],
        ),
        edited(
            "distance infinite",
            DISTANCE,
            "distance = inf",
            &["camera.distance", "above 0, in metres"],
        ),
        edited(
            "focal length below 0",
            FOCAL,
            "focal_px = -480",
            &[":10, camera.focal_px", "above 0", "found -480"],
        ),
        edited(
            "focal length missing",
            FOCAL,
            "",
            &["camera.focal_px", "fov_x_deg", "focal_mm"],
        ),
        edited(
            "focal length given twice over",
            FOCAL,
            "focal_px = 480\nfov_x_deg = 20",
            &[
                "camera.fov_x_deg",
                "one statement of the scale, found focal_px and fov_x_deg",
            ],
        ),
        edited(
            "field of view of a half circle",
            FOCAL,
            "fov_x_deg = 180",
            &["camera.fov_x_deg", "between 0 and 180"],
        ),
        edited(
            "focal length in millimetres without a sensor",
            FOCAL,
            "focal_mm = 50",
            &["camera.focal_mm", "focal_mm and sensor_width_mm together"],
        ),
        edited(
            "width of a parallel projection in a perspective",
            FOCAL,
            "width_m = 0.1",
            &["camera", "perspective"],
        ),
        edited(
            "projection unknown",
            "\"perspective\"",
            "\"fisheye\"",
            &[
                "camera.projection",
                "\"perspective\" or \"orthographic\", found \"fisheye\"",
            ],
        ),
        edited(
            "size of images 0",
            "image_size = [96, 16]",
            "image_size = [96, 0]",
            &["camera.image_size", "whole numbers above 0"],
        ),
        edited(
            "size of images a fraction",
            "image_size = [96, 16]",
            "image_size = [96.5, 16]",
            &["camera.image_size", "whole numbers"],
        ),
        edited(
            "size of images beyond all",
            "image_size = [96, 16]",
            "image_size = [1e12, 16]",
            &["camera.image_size", "1000000000000"],
        ),
        edited(
            "size of images of three numbers",
            "image_size = [96, 16]",
            "image_size = [96, 16, 3]",
            &["camera.image_size", "2"],
        ),
        edited(
            "size of images not that of the photos",
            "image_size = [96, 16]",
            "image_size = [97, 16]",
            &["expected 97 x 16 pixels", "96 x 16"],
        ),
        edited(
            "size of images swapped",
            "image_size = [96, 16]",
            "image_size = [16, 96]",
            &["image_size = [96, 16]", "swapped"],
        )
        .asks(Ask::Check),
        edited(
            "distortion of four numbers",
            "distortion = [0.0, 0.0, 0.0, 0.0, 0.0]",
            "distortion = [0, 0, 0, 0]",
            &["camera.distortion", "5"],
        ),
        edited(
            "distortion beyond all",
            "distortion = [0.0, 0.0, 0.0, 0.0, 0.0]",
            "distortion = [1e9, 0, 0, 0, 0]",
            &["camera"],
        ),
        edited(
            "principal point a text",
            "principal_point_px = [48.0, 8.0]",
            "principal_point_px = \"centre\"",
            &["camera.principal_point_px", "the text \"centre\""],
        ),
        edited(
            "principal point off the object",
            "principal_point_px = [48.0, 8.0]",
            "principal_point_px = [4800.0, 8.0]",
            &["cut at", "principal_point_px"],
        ),
        edited(
            "orbit's sigma below 0",
            "orbit_sigma_deg = 0.0",
            "orbit_sigma_deg = -1",
            &["camera.orbit_sigma_deg", "from 0 to 90"],
        ),
        edited(
            "object cut at both sides",
            FOCAL,
            "focal_px = 800.0",
            &["cut at both sides", "pixels", "focal_px"],
        ),
        edited(
            "object cut at both sides, checked",
            FOCAL,
            "focal_px = 800.0",
            &["cut at both sides", "focal_px"],
        )
        .asks(Ask::Check),
        edited(
            "object cut at the left",
            "principal_point_px = [48.0, 8.0]",
            "principal_point_px = [20.0, 8.0]",
            &["cut at the left side"],
        ),
        edited(
            "object cut at the right",
            "principal_point_px = [48.0, 8.0]",
            "principal_point_px = [76.0, 8.0]",
            &["cut at the right side"],
        ),
        edited(
            "camera a hair's breadth off",
            DISTANCE,
            "distance = 0.0500001",
            &["cut at both sides", "distance"],
        ),
        edited(
            "focal length beyond all",
            FOCAL,
            "focal_px = 1e300",
            &["cut at both sides", "focal_px"],
        ),
        edited(
            "distance beyond all",
            DISTANCE,
            "distance = 1e12",
            &["pixels wide", "distance"],
        ),
        edited(
            "distance in millimetres",
            DISTANCE,
            "distance = 600",
            &["pixels wide", "millimetres"],
        ),
        edited(
            "unknown key of the camera",
            DISTANCE,
            "distance = 0.6\naperture = 8",
            &[":15, camera.aperture: unknown key", "15 | aperture = 8"],
        ),
        edited(
            "camera missing",
            "[camera]",
            "[camra]",
            &["camra: unknown key; did you mean `camera`?"],
        ),
    ]
}

fn sensor() -> Vec<Case> {
    let key = |what, text: &'static str, words: &[&str]| edited(what, ENCODING, text, words);
    vec![
        key(
            "encoding misspelt",
            "encoding = \"liner\"",
            &[":18, sensor.encoding", "found \"liner\"", "\"linear\""],
        ),
        key(
            "encoding a number",
            "encoding = 2.2",
            &["sensor.encoding", "a text in quotes", "2.2"],
        ),
        key(
            "gamma 0",
            "encoding = \"gamma:0\"",
            &["sensor.encoding", "gamma from 0.1 to 10, found \"0\""],
        ),
        key(
            "gamma a word",
            "encoding = \"gamma:two\"",
            &["sensor.encoding", "found \"two\""],
        ),
        key(
            "response missing",
            "encoding = \"response:curve.csv\"",
            &["sensor.encoding", "cannot find the file \"curve.csv\""],
        ),
        key(
            "response out of the folder",
            "encoding = \"response:/etc/passwd\"",
            &["sensor.encoding", "relative to the capture's folder"],
        ),
        key(
            "response to recover without brackets",
            "encoding = \"recover\"",
            &["bracket"],
        ),
        key(
            "white level below black level",
            "black_level = 300\nwhite_level = 200",
            &[
                "sensor.white_level",
                "above the black level of 300, found 200",
            ],
        ),
        key(
            "black level a text",
            "black_level = \"dark\"",
            &["sensor.black_level", "the text \"dark\""],
        ),
        key(
            "full well 0",
            "full_well_e = 0",
            &["sensor.full_well_e", "above 0"],
        ),
        key(
            "read noise below 0",
            "read_noise_e = -3",
            &["sensor.read_noise_e", "0 or more"],
        ),
        key(
            "responsivity 0",
            "responsivity = 0",
            &["sensor.responsivity", "above 0"],
        ),
        key(
            "vignetting without light",
            "vignetting = [-2.0, 0.0, 0.0]",
            &["sensor.vignetting", "light everywhere"],
        ),
        key(
            "dark frame missing",
            "dark = \"dark.exr\"",
            &["sensor.dark", "cannot find"],
        ),
        key(
            "flat field a folder",
            "flat = \"views\"",
            &["sensor.flat", "to be a file"],
        ),
        key(
            "every pixel at the white level",
            "white_level = 1e-6",
            &["clipped", "white_level"],
        ),
        key(
            "black level above every pixel",
            "black_level = 1e6",
            &["black_level"],
        ),
        key(
            "unknown key of the sensor",
            "iso = 100",
            &["sensor.iso: unknown key"],
        ),
    ]
}

fn views() -> Vec<Case> {
    const ORBIT: &str = "orbit_deg = 0.0";
    const TIME: &str = "exposure_s = 1.0";
    vec![
        edited(
            "angle missing",
            "orbit_deg = 0.0\n",
            "",
            &["view 0, view.orbit_deg: expected this key, found nothing"],
        ),
        edited(
            "angle not a number",
            ORBIT,
            "orbit_deg = nan",
            &[":21, view 0, view.orbit_deg", "finite number"],
        ),
        edited(
            "angle a text",
            ORBIT,
            "orbit_deg = \"north\"",
            &["view 0", "orbit_deg", "the text \"north\""],
        ),
        edited(
            "angle twice",
            "orbit_deg = 30.0",
            "orbit_deg = 0.0",
            &[
                ":28, view 1",
                "views 0 and 1 have the same orbit angle of 0 degrees",
            ],
        ),
        edited(
            "angle twice, a turn apart",
            "orbit_deg = 30.0",
            "orbit_deg = 360.0",
            &["views 0 and 1 have the same orbit angle"],
        ),
        edited(
            "photo twice",
            FILE,
            "views/000.exr",
            &[
                ":29, view 1",
                "the photo \"views/000.exr\" is used twice, in views 0 and 1",
            ],
        ),
        edited(
            "exposure 0",
            TIME,
            "exposure_s = 0",
            &[":23, view 0", "exposure time above 0, in seconds, found 0"],
        )
        .without(&["for all photos or for none"]),
        edited(
            "exposure below 0",
            TIME,
            "exposure_s = -1",
            &["view 0", "exposure_s", "above 0"],
        )
        .without(&["for all photos or for none"]),
        edited(
            "exposure a fraction in words",
            TIME,
            "exposure_s = \"1/60\"",
            &["view 0", "exposure_s", "the text \"1/60\""],
        )
        .without(&["for all photos or for none"]),
        edited(
            "exposures of some",
            ", exposure_s = 1.0",
            "",
            &[
                "exposure times for all photos or for none, found none for 1 of 12",
                "views/000.exr",
            ],
        ),
        edited(
            "photos an empty list",
            "photos = [\n    { file = \"views/000.exr\", exposure_s = 1.0 },\n]",
            "photos = []",
            &["view 0", "view.photos", "at least one photo, found none"],
        ),
        edited(
            "photos missing",
            "photos = [\n    { file = \"views/000.exr\", exposure_s = 1.0 },\n]",
            "",
            &["view 0", "view.photos", "found nothing"],
        ),
        edited(
            "photos a text",
            "photos = [\n    { file = \"views/000.exr\", exposure_s = 1.0 },\n]",
            "photos = \"views/000.exr\"",
            &["view 0", "view.photos", "list of tables"],
        ),
        edited(
            "photo without a file",
            "file = \"views/000.exr\", ",
            "",
            &["view 0", "file", "Name the photo's file"],
        ),
        edited(
            "unknown key of a view",
            "plane_roll_deg = 0.0",
            "plane_role_deg = 0.0",
            &[
                "view 0",
                "view.plane_role_deg: unknown key; did you mean `plane_roll_deg`?",
            ],
        ),
        edited(
            "roll a text",
            "plane_roll_deg = 0.0",
            "plane_roll_deg = \"up\"",
            &["view 0", "plane_roll_deg", "the text \"up\""],
        ),
        edited(
            "outline half given",
            "plane_roll_deg = 0.0",
            "outline = { radius_px = 40.0 }",
            &["view 0", "outline", "both centre_px = [x, y] and radius_px"],
        ),
        edited(
            "outline of radius 0",
            "plane_roll_deg = 0.0",
            "outline = { centre_px = [48.0, 8.0], radius_px = 0 }",
            &["view 0", "radius_px", "above 0"],
        ),
        Case::new(
            "one view only",
            |b| {
                let text = std::fs::read_to_string(b.at("capture.toml")).expect("reads");
                let second = text.match_indices("[[view]]").nth(1).expect("views").0;
                b.write("capture.toml", &text[..second]);
            },
            &["one view", "at least two"],
        ),
        Case::new(
            "no view",
            |b| {
                let text = std::fs::read_to_string(b.at("capture.toml")).expect("reads");
                let first = text.find("[[view]]").expect("views");
                b.write("capture.toml", &text[..first]);
            },
            &[
                "capture.toml",
                "view: expected this key, found nothing",
                "[[view]]",
            ],
        ),
        orbit(
            "orbit's pattern that fits nothing",
            "files = \"*.jpeg\"\norbit_step_deg = 30",
            &[
                "views.files",
                "files like \"*.jpeg\", found none; the folder holds ",
            ],
        ),
        orbit(
            "orbit's pattern out of the folder",
            "files = \"../**/*.exr\"\norbit_step_deg = 30",
            &["views.files", "inside the capture's folder"],
        ),
        orbit(
            "orbit's pattern that is none",
            "files = \"views/[.exr\"\norbit_step_deg = 30",
            &["views.files", "with * or ?"],
        ),
        orbit(
            "orbit's step 0",
            "files = \"views/*.exr\"\norbit_step_deg = 0",
            &["views.orbit_step_deg", "other than 0"],
        ),
        orbit(
            "orbit's step missing",
            "files = \"views/*.exr\"",
            &["views.orbit_step_deg", "found nothing"],
        ),
        orbit(
            "orbit that meets itself",
            "files = \"views/*.exr\"\norbit_step_deg = 180",
            &[
                "views 0 and 2 have the same orbit angle of 0 degrees",
                "more pairs",
                "go round more than once",
            ],
        ),
        orbit(
            "orbit's files missing",
            "orbit_step_deg = 30",
            &["views.files", "found nothing"],
        ),
    ]
}

/// The set with its views written short.
fn orbit(what: &'static str, keys: &'static str, words: &[&str]) -> Case {
    let spoil = move |b: &crate::bench::Bench| {
        let text = std::fs::read_to_string(b.at("capture.toml")).expect("reads");
        let first = text.find("[[view]]").expect("views");
        b.write(
            "capture.toml",
            format!("{}[views]\n{keys}\n", &text[..first]),
        );
    };
    Case::new(what, spoil, words)
}

fn files() -> Vec<Case> {
    let mut cases = vec![
        edited(
            "photo missing",
            FILE,
            "views/nope.exr",
            &[
                ":30, view 1",
                "cannot find the file \"views/nope.exr\"",
                "30 |",
            ],
        ),
        edited(
            "photo a folder",
            FILE,
            "views",
            &["view 1", "expected \"views\" to be a file"],
        ),
        edited(
            "photo above the folder",
            FILE,
            "../set/views/001.exr",
            &["view 1", "\"..\""],
        ),
        edited(
            "photo above the folder by a detour",
            FILE,
            "views/../../set/views/001.exr",
            &["view 1", "\"..\""],
        ),
        edited(
            "photo by an absolute path",
            FILE,
            "/etc/passwd",
            &["view 1", "the absolute \"/etc/passwd\""],
        ),
        edited(
            "photo without a name",
            FILE,
            "",
            &["view 1", "found an empty text"],
        ),
        edited(
            "photo named with a control character",
            FILE,
            "views/\\u001b[31m.exr",
            &["view 1", "\\u{1b}[31m"],
        )
        .without(&["\u{1b}"]),
        edited(
            "photo named with markup",
            FILE,
            "<script>alert(1)</script>",
            &["view 1", "cannot find"],
        ),
        edited(
            "photo named over a thousand letters",
            FILE,
            LONG,
            &["view 1", "cannot find"],
        ),
    ];
    #[cfg(unix)]
    cases.push(Case::new(
        "photo that is a link out of the folder",
        |b| {
            std::fs::remove_file(b.photo(1)).expect("removes");
            std::fs::write(b.at("../secret.exr"), "secret").expect("writes");
            std::os::unix::fs::symlink(b.at("../secret.exr"), b.photo(1)).expect("links");
        },
        &["view 1", "is a link that leads out of the capture's folder"],
    ));
    #[cfg(unix)]
    cases.push(Case::new(
        "photo that is a link to itself",
        |b| {
            std::fs::remove_file(b.photo(1)).expect("removes");
            std::os::unix::fs::symlink(b.photo(1), b.photo(1)).expect("links");
        },
        &["view 1", "cannot find the file"],
    ));
    #[cfg(unix)]
    cases.push(Case::new(
        "folder of photos that is a link out",
        |b| {
            let away = b.at("../away");
            std::fs::rename(b.at("views"), &away).expect("moves");
            std::os::unix::fs::symlink(&away, b.at("views")).expect("links");
        },
        &["view 0", "is a link that leads out of the capture's folder"],
    ));
    #[cfg(target_os = "linux")]
    cases.push(Case::new(
        "photo whose name is not UTF-8",
        |b| {
            use std::os::unix::ffi::OsStrExt;
            let name = std::ffi::OsStr::from_bytes(b"views/\xff\xfe.exr");
            std::fs::rename(b.photo(1), b.set().join(name)).expect("renames");
            let text = std::fs::read_to_string(b.at("capture.toml")).expect("reads");
            let first = text.find("[[view]]").expect("views");
            let orbit = "[views]\nfiles = \"views/*.exr\"\norbit_step_deg = 30\n";
            b.write("capture.toml", format!("{}{orbit}", &text[..first]));
        },
        &["views.files", "is not UTF-8"],
    ));
    cases
}

const LONG: &str = const {
    const BYTES: [u8; 1200] = [b'a'; 1200];
    match std::str::from_utf8(&BYTES) {
        Ok(text) => text,
        Err(_) => "",
    }
};

fn whole() -> Vec<Case> {
    vec![
        edited(
            "table that is not closed",
            "[camera]",
            "[camera",
            &[":8", "not valid TOML", "8 | [camera"],
        ),
        edited(
            "text that is not closed",
            "name = \"small\"",
            "name = \"small",
            &[":2", "not valid TOML"],
        ),
        edited(
            "format of the future",
            "format = 1",
            "format = 2",
            &[":1, format: expected 1", "newer flatlight"],
        ),
        edited(
            "format a text",
            "format = 1",
            "format = \"one\"",
            &[":1, format", "the text \"one\""],
        ),
        edited(
            "unknown table",
            "[sensor]",
            "[lens]\nk = 1\n[sensor]",
            &["lens: unknown key"],
        ),
        Case::new(
            "description empty",
            |b| b.write("capture.toml", ""),
            &["object", "camera", "view"],
        ),
        Case::new(
            "description of bytes",
            |b| b.write("capture.toml", [0xff, 0xfe, 0x00]),
            &["capture.toml", "UTF-8"],
        ),
        Case::new(
            "description missing",
            |b| std::fs::remove_file(b.at("capture.toml")).expect("removes"),
            &["capture.toml", "flatlight init"],
        ),
        Case::new(
            "description a folder",
            |b| {
                std::fs::remove_file(b.at("capture.toml")).expect("removes");
                std::fs::create_dir(b.at("capture.toml")).expect("a folder");
            },
            &["capture.toml", "expected a file"],
        ),
        Case::new(
            "description without end",
            |b| b.write("capture.toml", "a = 1\n".repeat(12 << 20)),
            &["capture.toml", "at most", "bytes"],
        ),
        Case::new(
            "description nested without end",
            |b| b.write("capture.toml", format!("a = {}", "[".repeat(100_000))),
            &["capture.toml:1", "not valid TOML"],
        ),
        Case::new(
            "many faults at once",
            |b| {
                b.edit("capture.toml", "radius = 0.05", "raduis = 0.05");
                b.edit("capture.toml", "\"perspective\"", "\"fisheye\"");
                b.edit("capture.toml", "orbit_deg = 0.0", "orbit_deg = \"x\"");
                b.edit("capture.toml", "views/003.exr", "views/nope.exr");
            },
            &["raduis", "fisheye", "view 0", "view 3", "nope.exr"],
        ),
        Case::new(
            "photos of two sizes and two kinds of channels at once",
            |b| {
                image::RgbImage::new(95, 16)
                    .save(b.photo(2))
                    .expect("writes");
                image::GrayImage::new(96, 16)
                    .save(b.photo(5))
                    .expect("writes");
            },
            &[
                "002.png", "view 2", "95 x 16", "005.png", "view 5", "found Y",
            ],
        )
        .of(Format::Png)
        .asks(Ask::Check),
    ]
}
