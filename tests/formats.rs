//! The files of a run, read back by other eyes: the exr crate, and plain text.

mod sets;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use exr::prelude::{AttributeValue, Text};
use flatlight::pipeline::{Folder, Run, input_hashes};
use flatlight::report;
use sets::*;
use tempfile::TempDir;

const SET: &str = "phong8-two-suns";
/// Shared by all tests of this file; the folder is removed with the last of them at the latest by the system.
static RUN: LazyLock<(Run, TempDir)> = LazyLock::new(|| {
    let (recipe, capture) = (recipe(SET), capture(&set(SET)));
    let mut run = run(&recipe, &set(SET));
    run.input_hashes = input_hashes(&recipe, &set(SET).join("recipe.toml"), &capture)
        .unwrap_or_else(|e| panic!("{e}"));
    let page = report::page(&run).unwrap_or_else(|e| panic!("{e}"));
    let folder = tempfile::tempdir().expect("a temporary folder");
    Folder::new(folder.path())
        .write(&run, &page)
        .unwrap_or_else(|e| panic!("{e}"));
    (run, folder)
});

fn out() -> &'static Path {
    RUN.1.path()
}

fn text(name: &str) -> String {
    std::fs::read_to_string(out().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn attribute(image: &Image, name: &str) -> f32 {
    match image.layer.attributes.other.get(&Text::from(name)) {
        Some(AttributeValue::F32(value)) => *value,
        other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn the_light_field_has_its_layers_and_axes() {
    let file = image(&out().join("light_field.exr"));
    assert_eq!(file.size, [180, 720], "columns are θo′, rows α");
    let names: Vec<&str> = file.planes.keys().map(String::as_str).collect();
    assert_eq!(
        names,
        [
            "mean.B", "mean.G", "mean.R", "sigma.B", "sigma.G", "sigma.R", "weight.B", "weight.G",
            "weight.R",
        ]
    );
    assert_eq!(attribute(&file, "columnStartDeg"), -90.0);
    assert_eq!(attribute(&file, "columnStepDeg"), 1.0);
    assert_eq!(attribute(&file, "rowStartDeg"), -180.0);
    assert_eq!(attribute(&file, "rowStepDeg"), 0.5);
    for c in ["R", "G", "B"] {
        let plane = |layer: &str| &file.planes[&format!("{layer}.{c}")];
        let seen = plane("weight").iter().filter(|w| **w > 0.0).count();
        // 36 views give one cell per column and view; columns near the limb are cut.
        assert!((36 * 120..=36 * 180).contains(&seen), "{seen} cells");
        for ((mean, sigma), weight) in plane("mean")
            .iter()
            .zip(plane("sigma"))
            .zip(plane("weight"))
        {
            assert!(mean.is_finite() && sigma.is_finite() && *weight >= 0.0);
            assert!(
                (*weight > 0.0) == (*sigma > 0.0),
                "σ where there is a value, and only there"
            );
            assert!(
                *weight > 0.0 || *mean == 0.0,
                "nothing stands where nothing was seen"
            );
        }
    }
}

/// Fields of a CSV file: header, then lines; every field is empty or a number with a dot.
fn table(name: &str, words: &[usize]) -> (String, Vec<Vec<String>>) {
    let text = text(name);
    assert!(!text.contains('\r') && text.ends_with('\n'));
    let mut lines = text.lines();
    let header = lines.next().expect("a header").to_string();
    let columns = header.split(',').count();
    let rows: Vec<Vec<String>> = lines
        .map(|line| line.split(',').map(String::from).collect())
        .collect();
    for row in &rows {
        assert_eq!(row.len(), columns, "{name}: {row:?}");
        for (k, field) in row.iter().enumerate() {
            let number = field.parse::<f64>().is_ok_and(f64::is_finite);
            assert!(
                words.contains(&k) || field.is_empty() || number,
                "{name}: {field:?}"
            );
        }
    }
    (header, rows)
}

#[test]
fn the_lighting_table_has_its_columns_and_round_trips() {
    let (header, rows) = table("lighting.csv", &[]);
    assert_eq!(header, "theta_deg,L_R,L_G,L_B,sigma_R,sigma_G,sigma_B");
    assert_eq!(rows.len(), 720);
    let number = |k: usize, column: usize| -> f64 { rows[k][column].parse().expect("a number") };
    for (k, _) in rows.iter().enumerate() {
        assert_eq!(number(k, 0), -180.0 + 0.5 * k as f64);
        for c in 0..3 {
            let channel = &lighting(&RUN.0).channels[c];
            assert_eq!(
                number(k, 1 + c).to_bits(),
                channel.table[k].to_bits(),
                "every bit is kept"
            );
            assert!(number(k, 4 + c) >= 0.0);
        }
    }
}

#[test]
fn the_spectrum_has_its_columns_and_round_trips() {
    let (header, rows) = table("lighting_spectrum.csv", &[0, 5]);
    assert_eq!(header, "channel,p,re,im,sigma,status");
    let mut expected = lighting(&RUN.0)
        .channels
        .iter()
        .flat_map(|c| c.spectrum.iter().enumerate().map(move |(p, l)| (c, p, l)));
    for row in &rows {
        let (channel, p, l) = expected.next().expect("a row per coefficient");
        assert_eq!(
            (row[0].as_str(), row[1].as_str()),
            (channel.name.as_str(), p.to_string().as_str())
        );
        let number = |k: usize| -> f64 { row[k].parse().expect("a number") };
        assert_eq!(number(2).to_bits(), l.value.re.to_bits());
        assert_eq!(number(3).to_bits(), l.value.im.to_bits());
        assert!(["determined", "weak", "indeterminate"].contains(&row[5].as_str()));
    }
    assert!(expected.next().is_none(), "no coefficient is missing");
}

/// The map lights a surface that stands in the plane as the light does. A renderer interpolates linearly between
/// rows and columns, with rows on both poles; a patch at elevation ε subtends cos ε of its angular size and
/// falls on the surface at a slant of another cos ε.
#[test]
fn the_environment_map_holds_the_energy_in_the_horizon() {
    use std::f64::consts::{PI, TAU};
    let map = image(&out().join("lighting.exr"));
    let [width, height] = map.size;
    // An odd number of rows has one on the horizon.
    assert!(
        width.abs_diff(2 * height) <= 2 && height % 2 == 1,
        "lat-long: {width} x {height}"
    );
    let step = PI / (height - 1) as f64;
    let n = 1000;
    let band: f64 = (0..n)
        .map(|k| -1.0 + (2.0 * k as f64 + 1.0) / n as f64)
        .map(|t| (1.0 - t.abs()) * (t * step).cos().powi(2) * step * 2.0 / n as f64)
        .sum();
    for (c, channel) in ["R", "G", "B"].iter().enumerate() {
        let rows: Vec<f64> = map.planes[*channel]
            .chunks(width)
            .map(|row| row.iter().map(|v| f64::from(*v)).sum())
            .collect();
        let lit: Vec<usize> = (0..height).filter(|y| rows[*y] > 0.0).collect();
        assert_eq!(lit, [height / 2], "the plane's band is the horizon's row");
        let found = rows[height / 2] * band * TAU / width as f64;
        let expected = TAU * lighting(&RUN.0).channels[c].spectrum[0].value.re;
        // Floats round to 6e-8 of the sun's two pixels; negative ripples of the fill are cut to zero.
        assert!(
            (found / expected - 1.0).abs() < 1e-4,
            "{channel}: {found}, {expected}"
        );
    }
}

#[test]
fn the_summary_holds_the_scalars() {
    let summary: serde_json::Value = serde_json::from_str(&text("summary.json")).expect("JSON");
    assert_eq!(summary["recover"], "lighting");
    assert_eq!(summary["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(summary["views"].as_array().map(Vec::len), Some(36));
    for channel in summary["channels"].as_array().expect("channels") {
        for key in [
            "residual_relative",
            "chi2",
            "coverage",
            "total_irradiance",
            "determined_band",
        ] {
            assert!(channel[key].is_number(), "{key}: {channel}");
        }
    }
    assert_eq!(summary["sources"].as_array().map(Vec::len), Some(2));
    assert!(
        summary["stage_seconds"]
            .as_object()
            .is_some_and(|s| s.len() >= 3)
    );
}

/// The recipe and the capture as resolved can be run again and mean the same.
#[test]
fn resolved_settings_are_settings() {
    let again = flatlight::pipeline::Recipe::read(&out().join("recipe.toml"))
        .unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(again.to_toml(), text("recipe.toml"));
    let file = out().join("capture.toml");
    let again = flatlight::capture::Capture::parse(&text("capture.toml"), &file, &set(SET))
        .unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(again.to_toml(), text("capture.toml"));
    let original = capture(&set(SET)).views;
    assert_eq!(again.views.len(), original.len());
    for (again, original) in again.views.iter().zip(&original) {
        // Degrees to radians and back may round.
        assert!((again.orbit.rad() - original.orbit.rad()).abs() < 1e-12);
        assert_eq!(again.photos, original.photos);
    }
}

#[test]
fn provenance_names_every_input_and_product_by_its_hash() {
    let provenance: serde_json::Value =
        serde_json::from_str(&text("provenance.json")).expect("JSON");
    let hashes = |key: &str| -> BTreeMap<String, String> {
        serde_json::from_value(provenance[key].clone()).expect("names and hashes")
    };
    let inputs = hashes("inputs");
    assert_eq!(inputs.len(), 36 + 2, "photos, description, recipe");
    let photo = std::fs::read(set(SET).join("views/000.exr")).expect("reads");
    assert_eq!(
        inputs["capture/views/000.exr"],
        blake3::hash(&photo).to_hex().to_string()
    );
    for (name, hash) in hashes("products") {
        let bytes = std::fs::read(out().join(&name)).expect("the product is there");
        assert_eq!(blake3::hash(&bytes).to_hex().to_string(), hash, "{name}");
    }
}

/// The page stands alone: nothing is fetched, and it stays small enough to be mailed.
#[test]
fn the_report_is_one_self_contained_page() {
    let page = text("report.html");
    assert!(page.starts_with("<!DOCTYPE html>") || page.starts_with("<!doctype html>"));
    assert!(page.trim_end().ends_with("</html>"));
    assert!(page.len() < 3_000_000, "{} bytes", page.len());
    for fetch in [
        "src=\"http",
        "src='http",
        "href=\"http",
        "@import",
        "url(http",
        "fetch(",
    ] {
        assert!(!page.contains(fetch), "{fetch}");
    }
}

/// Names of the machine, its user and its folders stay at home.
#[test]
fn no_product_tells_where_it_was_made() {
    let mut secrets = vec![
        root().display().to_string(),
        out().display().to_string(),
        set(SET).display().to_string(),
    ];
    for variable in ["HOME", "USER", "LOGNAME", "HOSTNAME"] {
        // A name of three letters turns up in compressed bytes by chance.
        secrets.extend(std::env::var(variable).ok().filter(|v| v.len() > 4));
    }
    secrets.extend(
        std::fs::read_to_string("/etc/hostname")
            .ok()
            .map(|h| h.trim().to_string())
            .filter(|h| h.len() > 4),
    );
    for entry in std::fs::read_dir(out()).expect("the folder is there") {
        let path = entry.expect("an entry").path();
        let bytes = std::fs::read(&path).expect("reads");
        for secret in &secrets {
            let found = bytes.windows(secret.len()).any(|w| w == secret.as_bytes());
            assert!(!found, "{secret} is in {}", path.display());
        }
    }
}
