//! Every fault does what it says, seen through the pipeline's own reading of the photos.

use std::path::Path;

use super::{Recipe, simulate};
use crate::capture::{Capture, Sensor};
use crate::photo;
use crate::radiance;

const PLAIN: &str = r#"
format = 1
name = "a test"
seed = 3
channels = ["Y"]
[object]
shape = "cylinder"
radius = 0.05
[camera]
projection = "perspective"
image_size = [120, 40]
focal_px = 600.0
distance = 0.6
[views]
count = 4
orbit_start_deg = 10
[brdf]
model = "lambertian"
albedo = 0.6
[lighting]
sources = [{ theta_deg = 30, irradiance = 3.0 }]
uniform = 0.5
"#;

fn recipe(sensor: &str, faults: &str) -> Recipe {
    let text = format!("{PLAIN}[sensor]\n{sensor}\n[faults]\n{faults}\n");
    Recipe::parse(&text, Path::new("simulate.toml"), Path::new(".")).unwrap()
}

/// A set on disk, as any other program finds it.
struct Set {
    folder: tempfile::TempDir,
    capture: Capture,
}

fn set(recipe: &Recipe) -> Set {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("set");
    simulate(recipe, &out, false, &|| {}).unwrap();
    let capture = Capture::read(&out).unwrap();
    Set { folder, capture }
}

impl Set {
    fn radiance(&self, view: usize) -> radiance::Radiance {
        self.radiance_of_rows(view, 0..40)
    }

    fn radiance_of_rows(&self, view: usize, rows: std::ops::Range<u32>) -> radiance::Radiance {
        radiance::view(&self.capture, view, rows).unwrap()
    }

    fn stored(&self, view: usize, photo: usize) -> photo::Photo {
        let file = &self.capture.views[view].photos[photo].file;
        photo::read(&self.capture.folder.join(file), None).unwrap()
    }

    fn table(&self, name: &str) -> Vec<Vec<String>> {
        let file = self.folder.path().join("set/truth").join(name);
        let text = std::fs::read_to_string(file).unwrap();
        text.lines()
            .map(|l| l.split(',').map(String::from).collect())
            .collect()
    }
}

fn clean() -> Set {
    set(&recipe("format = \"exr-float\"", ""))
}

/// Pixel pairs (clean, other) wherever both are known and light.
fn pairs(clean: &radiance::Radiance, other: &radiance::Radiance) -> Vec<(f64, f64)> {
    clean.value[0]
        .iter()
        .zip(&other.value[0])
        .zip(&other.variance[0])
        .filter(|((c, _), variance)| **c > 0.05 && variance.is_finite())
        .map(|((c, o), _)| (f64::from(*c), f64::from(*o)))
        .collect()
}

#[test]
fn without_faults_the_radiance_is_the_light_field() {
    let set = clean();
    let photo = set.radiance(0);
    // A Lambertian surface: E/π · albedo with E = 3 cos + 2 · 0.5 in its own frame, over the middle row. A pixel
    // is 1/51 of the radius wide: its mean differs by h²/24 of the second derivative, 1e-4.
    let camera = crate::geometry::CameraModel::new(&set.capture.camera).unwrap();
    let geometry = crate::geometry::ViewGeometry::new(
        &camera,
        &set.capture.object,
        crate::geometry::Pose::nominal(),
        0.0,
    );
    for column in 30..90 {
        let seen = geometry.at([f64::from(column) + 0.5, 20.5]).unwrap();
        let to_light = crate::angle::wrap((30f64 - 10.0).to_radians() - seen.alpha);
        let expected = 0.6 / std::f64::consts::PI * (3.0 * to_light.cos().max(0.0) + 1.0);
        let found = f64::from(photo.value[0][20 * 120 + column as usize]);
        assert!(
            (found / expected - 1.0).abs() < 2e-4,
            "{column}: {found} {expected}"
        );
    }
}

#[test]
fn noise_has_the_variance_of_the_model() {
    let sensor = "format = \"png\"\nbits = 14\nblack_level = 400\nfull_well_e = 6000\nread_noise_e = 12\nexposures_s = [0.01]";
    let noisy = set(&recipe(sensor, ""));
    let quiet = clean();
    let (mut chi2, mut shift, mut n) = (0.0, 0.0, 0.0);
    for view in 0..4 {
        let (truth, photo) = (quiet.radiance(view), noisy.radiance(view));
        let truth_lit = truth.value[0]
            .iter()
            .zip(&photo.value[0])
            .zip(&photo.variance[0]);
        for ((t, p), variance) in truth_lit {
            if *t > 0.05 && variance.is_finite() {
                let z = f64::from(p - t) / f64::from(*variance).sqrt();
                chi2 += z * z;
                shift += z;
                n += 1.0;
            }
        }
    }
    assert!(n > 8000.0, "{n}");
    // χ²/n scatters by √(2/n), 1.5 %, and the pipeline's smoothed estimate of the expected signal by about
    // as much; the mean by 1/√n.
    assert!((chi2 / n - 1.0).abs() < 0.05, "{}", chi2 / n);
    assert!((shift / n).abs() < 4.0 / f64::sqrt(n), "{}", shift / n);
    // Switched off, what is left is rounding to 14 bits.
    let silent = set(&recipe(sensor, "shot_noise = false\nread_noise = false"));
    let codes = 16383.0 - 400.0;
    let responsivity = silent.capture.sensor.responsivity.unwrap();
    let step = 6000.0 / codes / (responsivity * 0.01);
    for (t, p) in pairs(&quiet.radiance(1), &silent.radiance(1)) {
        // Half a step, and the rounding of single precision.
        assert!((t - p).abs() < 0.5 * step + 1e-6, "{t} {p} {step}");
    }
}

#[test]
fn brackets_clip_and_together_show_everything() {
    let sensor = "format = \"png\"\nbits = 8\nencoding = \"srgb\"\nfull_well_e = 20000\nexposures_s = [0.01, 0.08]";
    let bracketed = set(&recipe(sensor, "shot_noise = false\nread_noise = false"));
    let clipped = |photo: usize| {
        let stored = bracketed.stored(0, photo);
        stored.values[0].iter().filter(|v| **v == 255.0).count()
    };
    assert_eq!(clipped(0), 0);
    assert!(clipped(1) > 500, "{}", clipped(1));
    let (truth, merged) = (clean().radiance(0), bracketed.radiance(0));
    let seen = pairs(&truth, &merged);
    let lit = truth.value[0].iter().filter(|v| **v > 0.05).count();
    assert_eq!(seen.len(), lit);
    for (t, m) in seen {
        // Half a step of sRGB is at most 1.2 % of a value above a tenth of the range, and 4 % at the darkest
        // that the long exposure shows (0.05/0.57 of 0.8 · 8).
        assert!((m / t - 1.0).abs() < 0.02, "{t} {m}");
    }
}

#[test]
fn vignetting_is_removed_if_stated_and_left_if_not() {
    let sensor = "format = \"exr-float\"\nvignetting = [-0.3, 0.05, 0.0]";
    let truth = clean().radiance(0);
    let stated = set(&recipe(sensor, "")).radiance(0);
    for (t, s) in pairs(&truth, &stated) {
        // Single precision, twice.
        assert!((s / t - 1.0).abs() < 1e-6, "{t} {s}");
    }
    let silent = set(&recipe(sensor, "unstated = [\"vignetting\"]"));
    assert_eq!(silent.capture.sensor.vignetting, None);
    let unstated = silent.radiance(0);
    let at = 2 * 120 + 25;
    let (dx, dy) = (25.5 - 60.0, 2.5 - 20.0);
    let r2 = (dx * dx + dy * dy) / (60.0f64 * 60.0 + 20.0 * 20.0);
    let factor = f64::from(unstated.value[0][at] / truth.value[0][at]);
    assert!(
        (factor - (1.0 + r2 * (-0.3 + r2 * 0.05))).abs() < 1e-6,
        "{factor}"
    );
}

#[test]
fn flare_and_background_add_what_they_say() {
    let truth = clean().radiance(0);
    let lit = set(&recipe("format = \"exr-float\"", "background = 0.2")).radiance(0);
    // The corner shows nothing but the background.
    assert_eq!((truth.value[0][0], lit.value[0][0]), (0.0, 0.2));
    let veiled = set(&recipe("format = \"exr-float\"", "flare = 0.01")).radiance(0);
    let mean = |r: &radiance::Radiance| {
        r.value[0].iter().map(|&v| f64::from(v)).sum::<f64>() / r.value[0].len() as f64
    };
    // All light is still there, and the dark corner has 1 % of the mean.
    assert!((mean(&veiled) / mean(&truth) - 1.0).abs() < 1e-6);
    assert!((f64::from(veiled.value[0][0]) / (0.01 * mean(&truth)) - 1.0).abs() < 1e-5);
}

#[test]
fn wrong_angles_are_in_the_truth_and_in_the_picture() {
    let wrong = set(&recipe("format = \"exr-float\"", "orbit_jitter_deg = 2"));
    assert_eq!(wrong.capture.camera.orbit_sigma_deg, 2.0);
    let rows = wrong.table("views.csv");
    let column = |name: &str| rows[0].iter().position(|h| h == name).unwrap();
    let (stated, real) = (column("orbit_deg"), column("true_orbit_deg"));
    let mut moved = 0;
    for (view, row) in rows.iter().skip(1).enumerate() {
        let angle = |c: usize| row[c].parse::<f64>().unwrap();
        assert!((angle(stated) - wrong.capture.views[view].orbit.deg()).abs() < 1e-9);
        // Six standard deviations.
        assert!((angle(stated) - angle(real)).abs() < 12.0);
        moved += usize::from(angle(stated) != angle(real));
        // The same view without jitter, at the true angle, is the same photo.
        let mut honest = recipe("format = \"exr-float\"", "");
        honest.orbits_deg = vec![angle(real)];
        let honest = set(&honest);
        for (a, b) in honest.stored(0, 0).values[0]
            .iter()
            .zip(&wrong.stored(view, 0).values[0])
        {
            assert!((a - b).abs() < 1e-6);
        }
    }
    assert_eq!(moved, 4);
    let silent = "orbit_jitter_deg = 2\nunstated = [\"orbit_sigma\"]";
    let silent = set(&recipe("format = \"exr-float\"", silent));
    assert_eq!(silent.capture.camera.orbit_sigma_deg, 0.0);
}

#[test]
fn a_displaced_object_is_found_where_it_is() {
    let faults = "object_offset_m = [0.002, -0.001, 0.0]\ntilt_deg = 0.5\nbackground = 0.02";
    let mut planted = recipe("format = \"exr-float\"", faults);
    planted.camera.image_size = [480, 60];
    planted.camera.principal_point_px = [240.0, 30.0];
    planted.camera.projection = crate::capture::Projection::Perspective { focal_px: 2000.0 };
    let displaced = set(&planted);
    let camera = crate::geometry::CameraModel::new(&displaced.capture.camera).unwrap();
    for view in 0..4 {
        let outline = crate::geometry::outline::find(
            &displaced.radiance_of_rows(view, 0..60),
            &camera,
            &displaced.capture.object,
            crate::geometry::Search::default(),
        )
        .unwrap();
        let (sin, cos) = displaced.capture.views[view].orbit.rad().sin_cos();
        let [x, y] = [0.002, -0.001];
        // Seen from the orbit angle, the object stands this far to the right, and looks so much larger for being
        // nearer.
        let (right, nearer) = (y * cos - x * sin, x * cos + y * sin);
        let apparent = right * 0.6 / (0.6 - nearer);
        let pose = outline.pose;
        // A pixel is 0.3 mm here, and the outline's stated model error 0.03 px a side.
        assert!(
            (pose.offset[1] - apparent).abs() < 2e-5,
            "{view}: {pose:?} {apparent}"
        );
        assert!(
            (pose.tilt.to_degrees() - 0.5).abs() < 0.05,
            "{view}: {pose:?}"
        );
        let scale = 0.6 / (0.6 - nearer);
        assert!(
            (pose.radius_scale / scale - 1.0).abs() < 1e-3,
            "{view}: {pose:?}"
        );
    }
}

#[test]
fn missing_views_are_missing_and_the_others_unchanged() {
    let sensor = "format = \"exr-float\"\nwhite_level = 1.0\nfull_well_e = 5000";
    let all = set(&recipe(sensor, ""));
    let some = set(&recipe(sensor, "missing_views = [1, 2]"));
    assert_eq!(some.capture.views.len(), 2);
    assert!((some.capture.views[1].orbit.deg() - 280.0).abs() < 1e-9);
    assert_eq!(some.stored(1, 0), all.stored(3, 0));
    let none = recipe(sensor, "missing_views = [0, 1, 2, 3]");
    assert!(simulate(&none, &some.folder.path().join("none"), false, &|| {}).is_err());
}

#[test]
fn exposure_and_brightness_scatter_as_the_truth_says() {
    let faults = "exposure_jitter = 0.05\nbrightness_jitter = 0.1";
    let (truth, scattered) = (clean(), set(&recipe("format = \"exr-float\"", faults)));
    let (views, photos) = (scattered.table("views.csv"), scattered.table("photos.csv"));
    for view in 0..4 {
        let number = |row: &[String], c: usize| row[c].parse::<f64>().unwrap();
        let expected = number(&views[view + 1], 7) * number(&photos[view + 1], 3);
        assert_ne!(expected, 1.0);
        for (t, s) in pairs(&truth.radiance(view), &scattered.radiance(view)) {
            assert!((s / t / expected - 1.0).abs() < 1e-6);
        }
    }
}

#[test]
fn texture_and_dust_change_the_object_only() {
    let faults = "background = 0.2\ntexture = { amplitude = 0.05, scale_m = 0.01 }\ndust = { count = 2000, radius_m = 0.001, opacity = 0.5 }";
    let (truth, marked) = (
        clean().radiance(0),
        set(&recipe("format = \"exr-float\"", faults)).radiance(0),
    );
    assert_eq!(marked.value[0][0], 0.2);
    // 2000 specks of 1 mm on 2π · 50 mm × 48 mm cover 1 − exp(−0.417) of it: a mean factor of 0.83, within the
    // scatter of the specks in sight (2 %) and of the texture's few periods (2 %).
    let factors: Vec<f64> = pairs(&truth, &marked).iter().map(|(t, m)| m / t).collect();
    let mean = factors.iter().sum::<f64>() / factors.len() as f64;
    assert!((mean - 0.83).abs() < 0.05, "{mean}");
    // A pixel is 1 mm, as a speck's radius: some pixels are fully under one, some free.
    assert!(factors.iter().any(|f| *f < 0.58) && factors.iter().any(|f| *f > 0.95));
}

#[test]
fn files_are_the_same_for_any_number_of_threads_and_differ_by_seed() {
    let sensor = "format = \"png\"\nbits = 12\nfull_well_e = 5000\nread_noise_e = 5";
    let noisy = recipe(sensor, "orbit_jitter_deg = 0.1\nflare = 0.01");
    let bytes = |recipe: &Recipe, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let set = pool.install(|| set(recipe));
        let files = set.capture.files();
        let read = |f: &std::path::PathBuf| std::fs::read(set.capture.folder.join(f)).unwrap();
        files.iter().map(read).collect::<Vec<_>>()
    };
    let one = bytes(&noisy, 1);
    assert!(one == bytes(&noisy, 3));
    let mut other = noisy.clone();
    other.seed = 4;
    assert!(one[1] != bytes(&other, 3)[1]);
}

#[test]
fn the_truth_s_recipe_makes_the_same_set_again() {
    let sensor =
        "format = \"png\"\nbits = 12\nfull_well_e = 5000\nread_noise_e = 5\nblack_level = 20";
    let faults = "orbit_jitter_deg = 0.1\ndust = { count = 10, radius_m = 0.001 }";
    let first = set(&recipe(sensor, faults));
    let again = Recipe::read(&first.folder.path().join("set/truth/recipe.toml")).unwrap();
    let second = set(&again);
    // Sources and light are read back from decimal numbers: the same but for a code's rounding.
    for (a, b) in first.stored(2, 0).values[0]
        .iter()
        .zip(&second.stored(2, 0).values[0])
    {
        assert!((a - b).abs() <= 1.0, "{a} {b}");
    }
}

#[test]
fn a_folder_with_something_else_is_left_alone() {
    let plain = recipe("", "");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("set");
    simulate(&plain, &out, false, &|| {}).unwrap();
    let again = simulate(&plain, &out, false, &|| {})
        .unwrap_err()
        .to_string();
    assert!(again.contains("--force"), "{again}");
    simulate(&plain, &out, true, &|| {}).unwrap();
    std::fs::write(out.join("diary.txt"), "mine").unwrap();
    let foreign = simulate(&plain, &out, true, &|| {})
        .unwrap_err()
        .to_string();
    assert!(foreign.contains("diary.txt"), "{foreign}");
    // No staging folder is left beside.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    assert_eq!(
        clean().capture.sensor.white_level,
        Sensor::default().white_level
    );
}

#[test]
fn all_faults_of_a_recipe_are_told_at_once() {
    let text = format!(
        "{PLAIN}[sensor]\nformat = \"pgn\"\nbits = 12\nread_noise_e = 3\n[faults]\nflair = 0.1\nflare = 2\nmissing_views = [9]\ntexture = {{ amplitude = 0.1 }}\nunstated = [\"vignette\"]\n"
    );
    let error = Recipe::parse(&text, Path::new("simulate.toml"), Path::new("."))
        .unwrap_err()
        .to_string();
    for part in [
        "Did you mean \"png\"?",
        "sensor.bits: it belongs to format",
        "full_well_e beside read_noise_e",
        "did you mean `flare`?",
        "faults.flare: expected a share",
        "faults.missing_views: expected numbers of views from 0 to 3",
        "faults.texture.amplitude",
        "Did you mean \"vignetting\"?",
    ] {
        assert!(error.contains(part), "{part}\nnot in\n{error}");
    }
    let mirror = PLAIN.replace("model = \"lambertian\"\nalbedo = 0.6", "model = \"mirror\"");
    let mirror = Recipe::parse(&mirror, Path::new("m.toml"), Path::new(".")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    assert!(simulate(&mirror, &folder.path().join("set"), false, &|| {}).is_err());
}
