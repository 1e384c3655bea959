//! The description of a capture set: what is read, what is refused, and what is written back.

use std::path::Path;

use super::*;

const GOOD: &str = r#"
format = 1
name = "ball"
[object]
shape = "sphere"
radius = 0.05
[camera]
projection = "perspective"
image_size = [960, 240]
focal_px = 4879.0
distance = 0.6
[sensor]
encoding = "gamma:2.2"
black_level = 256
white_level = 4095
vignetting = [-0.28, 0.06, 0.0]
[[view]]
orbit_deg = 5.0
photos = [{ file = "v/a.png", exposure_s = 0.001 }, { file = "v/b.png", exposure_s = 0.016 }]
plane_roll_deg = 30
outline = { centre_px = [480.2, 119.7], radius_px = 401.3 }
[[view]]
orbit_deg = 10
file = "v/c.png"
exposure_s = 0.5
mask = "v/a.png"
"#;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("v")).unwrap();
    for name in ["a", "b", "c"] {
        std::fs::write(folder.path().join(format!("v/{name}.png")), "x").unwrap();
    }
    folder
}

fn parse(text: &str) -> crate::Result<Capture> {
    Capture::parse(text, Path::new("capture.toml"), folder().path())
}

fn faults(text: &str) -> String {
    parse(text).unwrap_err().to_string()
}

#[test]
fn every_key_is_understood_and_survives_a_round_trip() {
    let capture = parse(GOOD).unwrap();
    assert_eq!(capture.object.shape, Shape::Sphere);
    assert_eq!(capture.camera.principal_point_px, [480.0, 120.0]);
    assert_eq!(capture.sensor.encoding, Some(Encoding::Gamma(2.2)));
    assert_eq!(capture.views.len(), 2);
    let first = &capture.views[0];
    assert_eq!(first.photos[1].exposure_s, Some(0.016));
    assert!((first.plane_roll - 30_f64.to_radians()).abs() < 1e-15);
    assert_eq!(first.outline.unwrap().radius_px, 401.3);
    assert_eq!(capture.views[1].mask.as_deref(), Some(Path::new("v/a.png")));

    // 30° in radians and back is 29.999999999999996.
    assert!(capture.to_toml().contains("plane_roll_deg = 30.0\n"));

    let again = parse(&capture.to_toml()).unwrap();
    assert_eq!(again.to_toml(), capture.to_toml());
    assert_eq!(again.camera, capture.camera);
    assert_eq!(again.sensor, capture.sensor);
    assert_eq!(again.views, capture.views);
}

#[test]
fn the_scale_may_be_stated_in_four_ways() {
    let focal = |line: &str| match parse(&GOOD.replace("focal_px = 4879.0", line))
        .unwrap()
        .camera
        .projection
    {
        Projection::Perspective { focal_px } => focal_px,
        Projection::Orthographic { metres_per_px } => -metres_per_px,
    };
    // Half the width of 960 px over tan 45° is 480; a lens as long as the sensor is wide is 960.
    assert!((focal("fov_x_deg = 90") - 480.0).abs() < 1e-9);
    assert!((focal("focal_mm = 36\nsensor_width_mm = 36.0") - 960.0).abs() < 1e-9);
    let parallel = GOOD
        .replace("focal_px = 4879.0", "width_m = 0.12")
        .replace("perspective", "orthographic")
        .replace("distance = 0.6", "");
    let capture = parse(&parallel).unwrap();
    assert_eq!(
        capture.camera.projection,
        Projection::Orthographic {
            metres_per_px: 0.12 / 960.0
        }
    );
    assert!(capture.camera.distance > capture.object.radius);
}

#[test]
fn an_even_orbit_is_written_short() {
    let short = GOOD.split("[[view]]").next().unwrap().to_string()
        + "[views]\nfiles = \"v/*.png\"\norbit_start_deg = -10\norbit_step_deg = 5\n";
    let capture = parse(&short).unwrap();
    let views: Vec<(f64, String)> = capture
        .views
        .iter()
        .map(|v| {
            (
                v.orbit.deg().round(),
                v.photos[0].file.display().to_string(),
            )
        })
        .collect();
    assert_eq!(
        views,
        [
            (-10.0, "v/a.png".into()),
            (-5.0, "v/b.png".into()),
            (0.0, "v/c.png".into())
        ]
    );
    assert!(
        capture
            .views
            .iter()
            .all(|v| v.photos[0].exposure_s == Some(1.0))
    );
}

#[test]
fn faults_say_what_and_where() {
    for (good, bad, expected) in [
        (
            "radius = 0.05",
            "raduis = 0.05",
            "unknown key; did you mean `radius`?",
        ),
        (
            "radius = 0.05",
            "radius = 0",
            "expected a length above 0, in metres, found 0",
        ),
        (
            "radius = 0.05",
            "radius = nan",
            "expected a length above 0, in metres, found the number nan",
        ),
        (
            "radius = 0.05",
            "radius = \"5 cm\"",
            "expected a length above 0, in metres, found the text",
        ),
        (
            "\"sphere\"",
            "\"cube\"",
            "expected \"cylinder\" or \"sphere\", found \"cube\"",
        ),
        (
            "distance = 0.6",
            "distance = 0.04",
            "expected a camera outside the object's radius",
        ),
        ("distance = 0.6", "", "camera.distance: expected this key"),
        (
            "[960, 240]",
            "[960.5, 240]",
            "expected [width, height] in pixels",
        ),
        (
            "[960, 240]",
            "[960]",
            "expected a list of 2 finite numbers, found a list of 1",
        ),
        (
            "focal_px = 4879.0",
            "",
            "camera.focal_px: expected this key",
        ),
        (
            "focal_px = 4879.0",
            "focal_px = 1\nfov_x_deg = 3",
            "found focal_px and fov_x_deg",
        ),
        (
            "focal_px = 4879.0",
            "focal_mm = 50",
            "focal_mm and sensor_width_mm together",
        ),
        ("gamma:2.2", "gamma:x", "expected a gamma from 0.1 to 10"),
        ("gamma:2.2", "rec709", "expected a known encoding"),
        (
            "gamma:2.2",
            "response:no.csv",
            "cannot find the file \"no.csv\"",
        ),
        (
            "white_level = 4095",
            "white_level = 200",
            "above the black level of 256, found 200",
        ),
        (
            "[-0.28, 0.06, 0.0]",
            "[-2, 0, 0]",
            "expected light everywhere",
        ),
        ("v/a.png\", exp", "../a.png\", exp", "with \"..\" in it"),
        ("v/a.png\", exp", "/v/a.png\", exp", "found the absolute"),
        (
            "v/a.png\", exp",
            "v/z.png\", exp",
            "cannot find the file \"v/z.png\"",
        ),
        (
            "v/b.png",
            "v/a.png",
            "the photo \"v/a.png\" is used twice, in views 0 and 0",
        ),
        (
            "orbit_deg = 10",
            "orbit_deg = 365\nplane_roll_deg = 30",
            "the same orbit angle",
        ),
        (
            "orbit_deg = 10",
            "",
            "view 1, view.orbit_deg: expected this key",
        ),
        (
            "exposure_s = 0.5",
            "exposure_s = -1",
            "an exposure time above 0, in seconds, found -1",
        ),
        (
            "exposure_s = 0.5",
            "",
            "exposure times for all photos or for none, found none for 1 of 3",
        ),
        ("format = 1", "format = 2", "expected 1, the only format"),
        ("name = \"ball\"", "name = ball", "this is not valid TOML"),
    ] {
        assert!(GOOD.contains(good), "{good}");
        let message = faults(&GOOD.replacen(good, bad, 1));
        assert!(message.contains(expected), "{bad}: {message}");
    }
}

#[test]
fn several_faults_come_together_with_their_lines() {
    let bad = GOOD
        .replace("radius = 0.05", "radius = -3")
        .replace("distance = 0.6", "distence = 0.6");
    let message = faults(&bad);
    assert!(
        message.contains("capture.toml:6, object.radius"),
        "{message}"
    );
    assert!(message.contains("6 | radius = -3"), "{message}");
    assert!(
        message.contains("capture.toml:11, camera.distence"),
        "{message}"
    );
    assert!(message.contains("did you mean `distance`?"), "{message}");
}

#[cfg(unix)]
#[test]
fn a_link_may_not_lead_out() {
    let folder = folder();
    std::fs::remove_file(folder.path().join("v/a.png")).unwrap();
    std::os::unix::fs::symlink("/etc/hosts", folder.path().join("v/a.png")).unwrap();
    let error = Capture::parse(GOOD, Path::new("capture.toml"), folder.path()).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("leads out of the capture's folder"),
        "{error}"
    );
}
