//! `flatlight prefilter`: orientation, normalisation, suns, cameras, and what it says to mistakes.

use std::path::{Path, PathBuf};
use std::process::Command;

use flatlight::angle::WorldAngle;
use flatlight::capture::Capture;
use flatlight::geometry::{CameraModel, Pose, ViewGeometry};
use flatlight::lighting::environment::Environment;

const PHONG: &str = "model=phong,diffuse=0.3,specular=0.4,exponent=32";

/// Exit code, stdout, stderr.
fn flatlight(words: &[&str], files: &[(&str, &Path)]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_flatlight"));
    command.arg("prefilter").args(words);
    for (option, file) in files {
        if !option.is_empty() {
            command.arg(option);
        }
        command.arg(file);
    }
    let run = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (run.status.code(), text(run.stdout), text(run.stderr))
}

/// The direction of a map's pixel, as the command's help says it.
fn direction(x: usize, y: usize, size: (usize, usize)) -> [f64; 3] {
    let azimuth = 90.0 - 360.0 * (x as f64 + 0.5) / size.0 as f64;
    let elevation = 90.0 - 180.0 * (y as f64 + 0.5) / size.1 as f64;
    let (azimuth, elevation) = (azimuth.to_radians(), elevation.to_radians());
    [
        elevation.cos() * azimuth.cos(),
        elevation.sin(),
        -elevation.cos() * azimuth.sin(),
    ]
}

/// A map of radiance in the folder.
fn map(
    folder: &Path,
    name: &str,
    size: (usize, usize),
    radiance: impl Fn(usize, usize) -> [f64; 3] + Sync,
) -> PathBuf {
    let file = folder.join(name);
    exr::prelude::write_rgb_file(&file, size.0, size.1, |x, y| {
        let [r, g, b] = radiance(x, y);
        (r as f32, g as f32, b as f32)
    })
    .unwrap();
    file
}

/// Rows of the table: α and θo′ in degrees, then B per channel.
fn table(file: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(file).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("alpha_deg,theta_o_deg,B_R,B_G,B_B"));
    let numbers = |line: &str| line.split(',').map(|n| n.parse().unwrap()).collect();
    lines.map(numbers).collect()
}

/// The unit vector at in-plane angle θ, of a plane with this heading and roll (degrees).
fn in_plane(theta: f64, heading: f64, roll: f64) -> [f64; 3] {
    let (h, r, t) = (heading.to_radians(), roll.to_radians(), theta.to_radians());
    let first = [h.cos(), 0.0, -h.sin()];
    // A quarter turn counter-clockwise from it, lifted by the roll.
    let second = [-h.sin() * r.cos(), r.sin(), -h.cos() * r.cos()];
    std::array::from_fn(|k| t.cos() * first[k] + t.sin() * second[k])
}

#[test]
fn a_chart_comes_out_where_the_help_says_and_as_bright() {
    let folder = tempfile::tempdir().unwrap();
    let size = (256, 128);
    // The red, green and blue radiance are 1 + ½ of the direction's x, y, z.
    let chart = map(folder.path(), "chart.exr", size, |x, y| {
        direction(x, y, size).map(|d| 1.0 + 0.5 * d)
    });
    let out = folder.path().join("table.csv");
    for (heading, roll) in [(0.0, 0.0), (30.0, 20.0), (-130.0, -60.0)] {
        let plane = [
            "--normals".to_owned(),
            "90".to_owned(),
            "--locals".to_owned(),
            "30".to_owned(),
            format!("--heading-deg={heading}"),
            format!("--roll-deg={roll}"),
        ];
        let run = |brdf: &'static str| {
            let mut words: Vec<&str> = plane.iter().map(String::as_str).collect();
            words.extend(["--brdf", brdf]);
            let (code, _, errors) = flatlight(&words, &[("", &chart), ("--out", &out)]);
            assert_eq!(code, Some(0), "{errors}");
            // Each is exact for its surface, so there is nothing to warn of.
            assert_eq!(errors, "");
            let rows = table(&out);
            assert_eq!(rows.len(), 90 * 30);
            rows
        };
        for row in run("model=lambertian,albedo=0.8") {
            let normal = in_plane(row[0], heading, roll);
            for c in 0..3 {
                // The irradiance of 1 + ½ d·ê is π + ½·(2π/3) n·ê, and ρ = 0.8/π.
                let expected = 0.8 * (1.0 + normal[c] / 3.0);
                // The tolerance, and a map of 1.4° pixels: step²/6 of the value.
                assert!((row[2 + c] - expected).abs() < 1.5e-3 * expected, "{row:?}");
            }
        }
        for row in run("model=mirror,reflectance=0.5") {
            let seen = in_plane(row[0] - row[1], heading, roll);
            for c in 0..3 {
                let expected = 0.5 * (1.0 + 0.5 * seen[c]);
                // Linear between values of the map and of the table: ½·step²/8 each, in two directions.
                assert!((row[2 + c] - expected).abs() < 2e-4, "{row:?} {expected}");
            }
        }
    }
}

#[test]
fn the_four_quarters_of_a_map_are_where_they_should_be() {
    let folder = tempfile::tempdir().unwrap();
    let size = (128, 64);
    let out = folder.path().join("table.csv");
    // Column of the map and the direction of the light in the plane: +X, +Z, −X, −Z.
    for (column, theta) in [(32, 0.0), (64, -90.0), (96, 180.0), (0, 90.0)] {
        let lit = map(folder.path(), "lit.exr", size, |x, _| {
            let near = (x + size.0 + 1 - column) % size.0 < 2;
            [if near { 1.0 } else { 0.0 }; 3]
        });
        let words = ["--brdf", "model=mirror,reflectance=1", "--locals", "45"];
        let (code, _, errors) = flatlight(&words, &[("", &lit), ("--out", &out)]);
        assert_eq!(code, Some(0), "{errors}");
        for row in table(&out) {
            let off = WorldAngle::degrees(row[0] - row[1] - theta).wrapped().deg();
            // Two columns of 2.8°, and linear from pixel to pixel.
            assert!(row[2] == 0.0 || off.abs() < 2.0 * 2.8125, "{row:?}");
            assert!(row[2] > 0.99 || off.abs() > 1.0, "{row:?}");
        }
    }
}

#[test]
fn a_small_bright_sun_does_not_ring() {
    let folder = tempfile::tempdir().unwrap();
    let size = (256, 128);
    let sky = |x: usize, y: usize| direction(x, y, size).map(|d| 1.0 + 0.5 * d);
    // 10⁵ times the sky in one column on the horizon; +X, that is θ = 0, lies at column 64.
    let sun = |x: usize, y: usize| match (x, y) {
        (64, 63 | 64) => [1e5; 3],
        _ => sky(x, y),
    };
    let out = [folder.path().join("sun.csv"), folder.path().join("sky.csv")];
    let maps = [
        map(folder.path(), "sun.exr", size, sun),
        map(folder.path(), "sky.exr", size, sky),
    ];
    for (map, out) in maps.iter().zip(&out) {
        let words = ["--brdf", PHONG, "--check", "--quiet"];
        let (code, stdout, errors) = flatlight(&words, &[("", map), ("--out", out)]);
        assert_eq!(code, Some(0), "{stdout}\n{errors}");
    }
    let (with, without) = (table(&out[0]), table(&out[1]));
    let level = without.iter().map(|r| r[2]).sum::<f64>() / without.len() as f64;
    let mut shaded = 0;
    for (a, b) in with.iter().zip(&without) {
        assert!(a[2] >= 0.0);
        // The sun's pixel ends 2.1° beside θ = −0.7°.
        if a[0].abs() > 93.0 {
            shaded += 1;
            // 1e-3 each, of levels that differ by at most a half.
            assert!((a[2] - b[2]).abs() < 3e-3 * level, "{a:?} {b:?}");
        } else if a[0].abs() < 80.0 {
            assert!(a[2] > b[2] + 10.0 * level);
        }
    }
    assert!(shaded > 60_000);
}

#[test]
fn a_view_is_the_photograph_that_a_renderer_makes() {
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/phong32-smooth");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("view.exr");
    let capture = Capture::read(&case).unwrap();
    for view in [0usize, 29] {
        let number = view.to_string();
        let (code, stdout, errors) = flatlight(
            &["--view", &number, "--tolerance", "1e-4"],
            &[
                ("", &case.join("truth/lighting.csv")),
                ("--brdf", &case.join("recipe.toml")),
                ("--strip", &case),
                ("--out", &out),
            ],
        );
        assert_eq!(code, Some(0), "{stdout}\n{errors}");
        assert!(stdout.contains("pixels rendered in"));
        let ours = Environment::read(&out).unwrap();
        let photo = case.join(&capture.views[view].photos[0].file);
        let theirs = Environment::read(&photo).unwrap();
        assert_eq!((ours.width, ours.height), (theirs.width, theirs.height));
        let camera = CameraModel::new(&capture.camera).unwrap();
        let geometry = ViewGeometry::new(&camera, &capture.object, Pose::nominal(), 0.0);
        let seen: Vec<usize> = (0..ours.width * ours.height)
            .filter(|k| {
                let at = [(k % ours.width) as f64 + 0.5, (k / ours.width) as f64 + 0.5];
                let point = geometry.at(at);
                point.is_some_and(|p| p.local.abs() < 75f64.to_radians())
            })
            .collect();
        assert!(seen.len() > ours.width * ours.height / 2);
        for c in 0..3 {
            let largest = seen.iter().fold(0.0f32, |m, &k| m.max(theirs.values[c][k]));
            let squares: f64 = seen
                .iter()
                .map(|&k| f64::from(ours.values[c][k] - theirs.values[c][k]).powi(2))
                .sum();
            let rms = (squares / seen.len() as f64).sqrt() / f64::from(largest);
            // The photographs are means over pixels, up to 1.1° wide at 75° of a light of order 12:
            // Δ²/24 · 12² = 2e-3 of its detail there, and far less elsewhere.
            assert!(rms < 5e-4, "view {view}: {rms}");
        }
    }
}

#[test]
fn a_view_needs_no_photographs_and_no_views() {
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/phong32-smooth");
    let folder = tempfile::tempdir().unwrap();
    let capture = Capture::read(&case).unwrap();
    let stated: toml::Table = std::fs::read_to_string(case.join("capture.toml"))
        .unwrap()
        .parse()
        .unwrap();
    // The object and the camera alone; and with views whose photos do not exist.
    let mut bare = toml::Table::new();
    for key in ["object", "camera"] {
        bare.insert(key.into(), stated[key].clone());
    }
    let bare_file = folder.path().join("stage.toml");
    std::fs::write(&bare_file, bare.to_string()).unwrap();
    let planned = folder.path().join("capture.toml");
    let orbits = "[[view]]\norbit_deg = 12.5\nphotos = [{ file = \"not/yet.png\" }]\n";
    std::fs::write(&planned, format!("{bare}\n{orbits}")).unwrap();
    let orbit = capture.views[7].orbit.deg().to_string();
    let out = [0, 1, 2].map(|k| folder.path().join(format!("{k}.exr")));
    for (file, place, out) in [
        (&case, ["--view", "7"], &out[0]),
        (&bare_file, ["--orbit-deg", &orbit], &out[1]),
        (&planned, ["--view", "0"], &out[2]),
    ] {
        let light = case.join("truth/lighting.csv");
        let files: [(&str, &Path); 4] = [
            ("", &light),
            ("--brdf", &case.join("recipe.toml")),
            ("--strip", file),
            ("--out", out),
        ];
        let (code, stdout, errors) = flatlight(&place, &files);
        assert_eq!(code, Some(0), "{stdout}\n{errors}");
        let (_, ms) = stdout.split_once("pixels rendered in ").unwrap();
        let ms: f64 = ms.split(' ').next().unwrap().parse().unwrap();
        println!("{ms} ms");
    }
    let image = |k: usize| Environment::read(&out[k]).unwrap();
    assert_eq!(image(0).values, image(1).values);
    assert!(image(0).values != image(2).values);
    // Nowhere to stand.
    let files: [(&str, &Path); 3] = [
        ("", &case.join("truth/lighting.csv")),
        ("--strip", &bare_file),
        ("--out", &out[0]),
    ];
    for (place, expected) in [(&[][..], "--orbit-deg"), (&["--view", "1"], "--orbit-deg")] {
        let words = [&["--brdf", PHONG], place].concat();
        let (code, _, errors) = flatlight(&words, &files);
        assert_eq!(code, Some(2), "{errors}");
        assert!(errors.contains(expected), "{errors}");
    }
}

#[test]
fn the_choice_is_told_as_json_too() {
    let folder = tempfile::tempdir().unwrap();
    let size = (512, 256);
    // A hall with windows two pixels wide, up to 10⁴ times as bright as its walls.
    let hall = map(folder.path(), "hall.exr", size, |x, y| {
        let window = if x % 37 < 2 && y > 100 && y < 150 {
            10f64.powi((x / 37 % 5) as i32)
        } else {
            0.0
        };
        [1.0 + window, 0.7 + 0.5 * window, 0.5]
    });
    let out = folder.path().join("table.exr");
    let files: [(&str, &Path); 2] = [("", &hall), ("--out", &out)];
    let brdf = "model=ggx-dielectric,alpha=0.05,diffuse=0.3";
    let words = [
        "--brdf",
        brdf,
        "--check",
        "--log",
        "json",
        "--normals",
        "360",
        "--locals",
        "60",
    ];
    let (code, stdout, errors) = flatlight(&words, &files);
    assert_eq!(code, Some(0), "{stdout}\n{errors}");
    let lines: Vec<serde_json::Value> = stdout
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let [told] = lines.as_slice() else {
        panic!("{stdout}");
    };
    assert_eq!(told["level"], "result");
    assert_eq!(told["channels"].as_array().unwrap().len(), 3);
    let chosen = told["ways"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|w| w["chosen"] == true);
    let chosen: Vec<_> = chosen.collect();
    assert_eq!(chosen.len(), 1);
    assert!(chosen[0]["predicted_s"].as_f64().unwrap() > 0.0);
    assert!(chosen[0]["predicted_coefficients"].as_u64().unwrap() >= 180);
    let bound = told["channels"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| c["bound"].as_f64().unwrap());
    let bound = bound.fold(0.0, f64::max);
    assert!(bound > 0.0 && bound <= 1.000_001e-3);
    for way in told["checked"].as_array().unwrap() {
        if let Some(error) = way["error"].as_f64() {
            assert!(error <= 1e-3, "{way}");
            assert!(way["measured_s"].as_f64().unwrap() > 0.0);
        }
    }
    assert!(told["checked"][0]["error"].as_f64().unwrap() <= bound);
}

#[test]
fn mistakes_are_said_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let light = folder.path().join("light.csv");
    let mut text = String::from("theta_deg,L_Y\n");
    for i in 0..64 {
        text += &format!("{},{}\n", -180.0 + 5.625 * f64::from(i), 1 + i % 5);
    }
    std::fs::write(&light, text).unwrap();
    let (csv, txt) = (folder.path().join("b.csv"), folder.path().join("b.txt"));
    let empty = folder.path().join("empty.toml");
    std::fs::write(&empty, "format = 1\n").unwrap();
    let empty = empty.to_str().unwrap();
    let cases: [(&[&str], &Path, &str); 8] = [
        (&["--brdf", "model=phnog"], &csv, "Did you mean \"phong\"?"),
        (&["--brdf", "phong"], &csv, "key=value"),
        (&["--brdf", empty], &csv, "[brdf]"),
        (&["--brdf", "missing.toml"], &csv, "missing.toml"),
        (&["--brdf", PHONG], &txt, ".csv or .exr"),
        (&["--brdf", PHONG, "--tolerance", "0"], &csv, "tolerance"),
        (
            &["--brdf", PHONG, "--heading-deg", "5"],
            &csv,
            "--heading-deg",
        ),
        (&["--brdf", PHONG, "--view", "1"], &csv, "--strip"),
    ];
    for (words, out, expected) in cases {
        let (code, _, errors) = flatlight(words, &[("", &light), ("--out", out)]);
        assert_eq!(code, Some(2), "{words:?}: {errors}");
        assert!(errors.contains(expected), "{words:?}: {errors}");
        assert!(!out.exists());
    }
    // And the same without a mistake.
    let (code, stdout, errors) = flatlight(&["--brdf", PHONG], &[("", &light), ("--out", &csv)]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(stdout.contains("chosen") && csv.exists());
}
