//! `flatlight validate`: a table of true errors, the same at any number of threads, and resumable.

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use flatlight::validate::study::{Recovered, StudyRecipe};

const COLUMNS: &str =
    "study,brdf,lighting,noise,views,recovered,band,rmse,bias,bound,ratio,coverage,draws";

const RECIPE: &str = r#"
format = 1
seed = 7
[brdf.shiny]
model = "phong"
diffuse = 0.3
specular = 0.7
exponent = 32
[lighting.suns]
sources = [{ theta_deg = 37.3, irradiance = 3.0 }, { theta_deg = -104.6, irradiance = 1.1 }]
uniform = 0.05
[lighting.random-8]
random_order = 8
[[study]]
name = "l"
recover = "lighting"
brdf = ["shiny"]
lighting = ["suns", "random-8"]
noise = [0.01]
views = [48]
locals = 30
draws = 12
default = { lighting = ["random-8"] }
[[study]]
name = "b"
recover = "brdf"
brdf = ["shiny"]
lighting = ["suns"]
noise = [0.01]
views = [72]
locals = 60
draws = 2
default = {}
[[study]]
name = "f"
recover = "both"
brdf = ["shiny"]
lighting = ["random-8"]
noise = [0.001, 0.01]
views = [120]
locals = 40
draws = 10
default = {}
"#;

fn validate(recipe: &Path, out: &Path, extra: &[&str]) -> Output {
    Command::cargo_bin("flatlight")
        .expect("the program")
        .arg("validate")
        .arg(recipe)
        .arg("--out")
        .arg(out)
        .args(extra)
        .output()
        .expect("it runs")
}

fn rows(csv: &str) -> Vec<Vec<String>> {
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some(COLUMNS));
    lines
        .map(|l| l.split(',').map(str::to_owned).collect())
        .collect()
}

#[test]
fn a_study_is_true_repeatable_and_resumable() {
    let folder = tempfile::tempdir().expect("a folder");
    let recipe = folder.path().join("study.toml");
    fs::write(&recipe, RECIPE).expect("a recipe");
    let out = |name: &str| folder.path().join(name);
    let table_of =
        |name: &str, file: &str| fs::read_to_string(out(name).join(file)).expect("a table");
    let csv = |name: &str| table_of(name, "validation.csv");
    let slices = |name: &str| table_of(name, "validation_slices.csv");

    let first = validate(&recipe, &out("one"), &["--threads", "1"]);
    assert!(
        first.status.success(),
        "{}",
        String::from_utf8_lossy(&first.stderr)
    );
    assert!(
        validate(&recipe, &out("three"), &["--threads", "3"])
            .status
            .success()
    );
    assert_eq!(csv("one"), csv("three"), "to the last digit");

    let table = rows(&csv("one"));
    assert_eq!(table.len(), 4);
    let number = |row: &[String], column: &str| -> f64 {
        let k = COLUMNS
            .split(',')
            .position(|c| c == column)
            .expect("a column");
        row[k].parse().expect("a number")
    };
    assert_eq!(slices("one"), slices("three"), "to the last digit");
    let slices = rows(&slices("one"));
    let of_both: Vec<&[String]> = table[2..].iter().map(|row| &row[..6]).collect();
    assert_eq!(
        slices.iter().map(|row| &row[..6]).collect::<Vec<_>>(),
        of_both
    );
    for row in table.iter().chain(&slices) {
        assert_eq!(row.len(), 13);
        assert!(number(row, "rmse") > 0.0 && number(row, "bound") > 0.0);
        assert!(number(row, "bias") <= number(row, "rmse") * (1.0 + 1e-12));
        let ratio = number(row, "rmse") / number(row, "bound");
        assert!((number(row, "ratio") - ratio).abs() < 1e-12 * ratio);
    }
    // 10 draws of 16 parts: the rms of an efficient estimate scatters by 1/√(2·160) = 5.6 % about the bound, and
    // its coverage by √(0.05·0.95/160) = 1.7 %; four of those, beside the 25 % that are allowed. What is known of slices
    // beforehand, that they are reciprocal and not negative, may bring them far below the bound.
    for row in &table[2..] {
        assert!((0.75..1.5).contains(&number(row, "ratio")), "{row:?}");
        assert!(number(row, "coverage") > 0.88, "{row:?}");
    }
    for row in &slices {
        assert!((0.1..1.5).contains(&number(row, "ratio")), "{row:?}");
        assert!(number(row, "coverage") > 0.88, "{row:?}");
    }
    // The bound is proportional to the noise. The band is the same: all 8 frequencies of the light rise far above it.
    assert_eq!((&table[2][6], &table[3][6]), (&"8".into(), &"8".into()));
    let growth = number(&table[3], "bound") / number(&table[2], "bound");
    assert!((growth - 10.0).abs() < 1e-6, "{growth}");
    let page = fs::read_to_string(out("one").join("report.html")).expect("a report");
    // The name of SVG's elements, which scripts need, is no address that anything is fetched from.
    let addresses = page.replace("http://www.w3.org/2000/svg", "");
    assert!(page.contains("shiny") && page.contains("</html>") && !addresses.contains("http://"));

    // A finished cell is taken as it is, a lost one is made again.
    let kept: Vec<_> = fs::read_dir(out("one").join("cells"))
        .expect("cells")
        .map(|e| e.expect("an entry").path())
        .collect();
    let of = |word: &str| {
        kept.iter()
            .find(|p| {
                p.file_name()
                    .is_some_and(|n| n.to_string_lossy().starts_with(word))
            })
            .expect("a cell")
    };
    let marked = of("brdf");
    let text = fs::read_to_string(marked).expect("a cell");
    let changed: String = text
        .lines()
        .map(|l| {
            if l.starts_with("rmse = ") {
                "rmse = 0.125"
            } else {
                l
            }
        })
        .map(|l| format!("{l}\n"))
        .collect();
    assert_ne!(text, changed);
    fs::write(marked, changed).expect("a change");
    fs::remove_file(of("lighting")).expect("a loss");
    assert!(validate(&recipe, &out("one"), &[]).status.success());
    let again = rows(&csv("one"));
    assert_eq!(again[1][7], "0.125");
    assert_eq!(again[0], table[0]);

    // The whole recipe has one cell more, and finds the others done.
    assert!(validate(&recipe, &out("one"), &["--full"]).status.success());
    let full = rows(&csv("one"));
    assert_eq!(full.len(), 5);
    assert_eq!(full[1], table[0]);
}

/// A run that was killed leaves whole cells or none, and the next one ends with the table that an undisturbed one has.
#[test]
fn a_killed_study_goes_on_where_it_was() {
    let folder = tempfile::tempdir().expect("a folder");
    let recipe = folder.path().join("study.toml");
    let text = RECIPE.replace(
        "noise = [0.001, 0.01]",
        "noise = [0.001, 0.002, 0.005, 0.01]",
    );
    // What the draws come to is another test's.
    let text = text.replace("draws = 10", "draws = 4");
    fs::write(&recipe, text).expect("a recipe");
    let out = |name: &str| folder.path().join(name);
    let finished = || fs::read_dir(out("killed").join("cells")).map_or(0, Iterator::count);

    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("flatlight"))
        .arg("validate")
        .arg(&recipe)
        .arg("--out")
        .arg(out("killed"))
        .args(["--threads", "2", "--quiet"])
        .stdout(std::process::Stdio::null())
        .spawn()
        .expect("it starts");
    // Before the last cell, if this process is awake in time; the result must be the same in any case.
    while finished() < 3 && child.try_wait().expect("a state").is_none() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    child.kill().expect("an end");
    child.wait().expect("an end");
    assert!(finished() >= 3);

    assert!(
        validate(&recipe, &out("killed"), &["--threads", "2"])
            .status
            .success()
    );
    assert!(
        validate(&recipe, &out("whole"), &["--threads", "1"])
            .status
            .success()
    );
    let csv = |name: &str| fs::read_to_string(out(name).join("validation.csv")).expect("a table");
    assert_eq!(csv("killed"), csv("whole"), "to the last digit");
    assert_eq!(rows(&csv("whole")).len(), 6);
}

#[test]
fn wrong_requests_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let recipe = folder.path().join("study.toml");
    let out = folder.path().join("out");
    fs::write(&recipe, RECIPE.replace("\"shiny\"]", "\"shinny\"]")).expect("a recipe");
    let output = validate(&recipe, &out, &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("Did you mean \"shiny\"?"));
    assert!(!out.exists());

    fs::write(&recipe, RECIPE).expect("a recipe");
    let output = validate(&recipe, folder.path(), &[]);
    assert_eq!(output.status.code(), Some(2), "a folder with other files");
    let output = validate(&folder.path().join("none.toml"), &out, &[]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn the_recipe_that_ships_has_every_recovery_in_both_sizes() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/validate.toml");
    let recipe = StudyRecipe::read(&file).expect("it reads");
    for full in [false, true] {
        let cells = recipe.plan(full).cells;
        for recovered in [Recovered::Lighting, Recovered::Brdf, Recovered::Both] {
            assert!(cells.iter().any(|c| c.recovered == recovered));
        }
    }
    // Coverage is judged over 200 draws in each cell.
    for full in [false, true] {
        assert!(recipe.plan(full).cells.iter().all(|c| c.draws >= 200));
    }
    // 8 surfaces × 3 lightings × 3 noises, for each recovery.
    let full = recipe.plan(true).cells;
    for recovered in [Recovered::Lighting, Recovered::Brdf, Recovered::Both] {
        let count = full
            .iter()
            .filter(|c| c.recovered == recovered && c.arc_deg == 360.0)
            .count();
        assert_eq!(count, 72);
    }
}
