//! The program as a script sees it: exit codes, messages, what is on which stream, what is left behind.

mod sets;

use std::collections::BTreeMap;
use std::path::Path;

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use sets::*;
use tempfile::TempDir;

/// A quick set: 36 views.
const SET: &str = "phong8-two-suns";

fn flatlight() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_flatlight"));
    command.current_dir(root());
    command
}

/// `flatlight run RECIPE --capture CAPTURE --out OUT …`
fn run_command(recipe: &Path, capture: &Path, out: &Path, more: &[&str]) -> Assert {
    flatlight()
        .arg("run")
        .arg(recipe)
        .arg("--capture")
        .arg(capture)
        .arg("--out")
        .arg(out)
        .args(more)
        .assert()
}

/// `run` of the quick set.
fn run_set(out: &Path, more: &[&str]) -> Assert {
    run_command(&set(SET).join("recipe.toml"), &set(SET), out, more)
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn stderr(assert: &Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}

fn stdout(assert: &Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stdout).into_owned()
}

/// Asserts that a request was refused as the user's mistake, with all of `words` in the message and
/// nothing written.
fn refused(assert: Assert, out: &Path, words: &[&str]) {
    let assert = assert.code(2);
    let message = stderr(&assert);
    assert!(message.starts_with("error: "), "{message}");
    for word in words {
        assert!(message.contains(word), "{word:?} is not in: {message}");
    }
    assert_eq!(stdout(&assert), "", "results only on success");
    assert!(!out.exists(), "nothing is written");
}

/// A copy of the quick set that may be spoilt.
fn copy() -> TempDir {
    let folder = folder();
    std::fs::create_dir(folder.path().join("views")).expect("a folder");
    for file in capture(&set(SET)).files() {
        std::fs::copy(set(SET).join(&file), folder.path().join(&file)).expect("copies");
    }
    folder
}

/// Replaces text in a file that must hold it.
fn edit(file: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(file).expect("reads");
    assert!(text.contains(from), "{from:?} is in {}", file.display());
    std::fs::write(file, text.replace(from, to)).expect("writes");
}

/// Every file of a folder with its bytes.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    std::fs::read_dir(folder)
        .expect("the folder is there")
        .map(|entry| {
            let entry = entry.expect("an entry");
            let name = entry.file_name().to_string_lossy().into_owned();
            (name, std::fs::read(entry.path()).expect("reads"))
        })
        .collect()
}

#[test]
fn a_run_answers_leaves_every_product_and_says_what_to_open() {
    let out = folder();
    let out = out.path().join("made/on/the/way");
    let assert = run_set(&out, &[]).code(0);
    let answer = stdout(&assert);
    let sources: Vec<f64> = answer
        .lines()
        .filter_map(|line| line.trim().strip_prefix("source at "))
        .filter_map(|rest| rest.split('°').next()?.parse().ok())
        .collect();
    // Ten times what recovery from this set is off by.
    assert!(
        sources.len() == 2 && (sources[0] - 37.3).abs() < 0.01 && (sources[1] + 104.6).abs() < 0.01,
        "{answer}"
    );
    let page = out.join("report.html");
    assert!(
        answer
            .trim_end()
            .ends_with(&format!("open {}", page.display())),
        "{answer}"
    );
    let names: Vec<String> = contents(&out).into_keys().collect();
    assert_eq!(
        names,
        [
            "capture.toml",
            "light_field.exr",
            "lighting.csv",
            "lighting.exr",
            "lighting_spectrum.csv",
            "provenance.json",
            "recipe.toml",
            "report.html",
            "residual.exr",
            "run.json",
            "summary.json",
        ]
    );
}

/// Not a terminal: no bar, no control character on either stream, with or without `--quiet`.
#[test]
fn nothing_moves_on_a_pipe() {
    for more in [&[][..], &["--quiet"]] {
        let out = folder();
        let assert = run_set(&out.path().join("out"), more).code(0);
        assert_eq!(stderr(&assert), "", "{more:?}");
        assert!(!stdout(&assert).contains(['\u{1b}', '\r']), "{more:?}");
    }
}

#[test]
fn the_same_run_again_has_nothing_to_do() {
    let out = folder();
    run_set(out.path(), &[]).code(0);
    let before = contents(out.path());
    let assert = run_set(out.path(), &[]).code(0);
    assert!(
        stdout(&assert).contains("nothing to do"),
        "{}",
        stdout(&assert)
    );
    assert!(contents(out.path()) == before, "no byte has changed");
}

/// A product that was lost or changed is made again.
#[test]
fn a_damaged_folder_is_made_whole() {
    let out = folder();
    run_set(out.path(), &[]).code(0);
    let whole = contents(out.path());
    std::fs::write(out.path().join("lighting.csv"), "theta_deg\n").expect("writes");
    std::fs::remove_file(out.path().join("lighting.exr")).expect("removes");
    run_set(out.path(), &[]).code(0);
    let again = contents(out.path());
    for name in ["lighting.csv", "lighting.exr"] {
        assert!(again.get(name) == whole.get(name), "{name}");
    }
}

/// Numbers do not depend on how many threads computed them, to the last bit.
#[test]
fn products_are_the_same_at_any_thread_count() {
    let (one, many) = (folder(), folder());
    run_set(one.path(), &["--threads", "1"]).code(0);
    run_set(many.path(), &["--threads", "3"]).code(0);
    let (one, many) = (contents(one.path()), contents(many.path()));
    for (name, bytes) in &one {
        // These tell how long the stages took.
        if !["report.html", "summary.json", "run.json", "provenance.json"].contains(&name.as_str())
        {
            assert!(many.get(name) == Some(bytes), "{name}");
        }
    }
}

#[test]
fn a_folder_with_something_else_is_refused_without_force() {
    let out = folder();
    std::fs::write(out.path().join("thesis.txt"), "years of work").expect("writes");
    let assert = run_set(out.path(), &[]).code(2);
    let message = stderr(&assert);
    assert!(message.contains("--force"), "{message}");
    assert_eq!(contents(out.path()).len(), 1, "nothing is written");
    run_set(out.path(), &["--force"]).code(0);
    let after = contents(out.path());
    assert!(after.contains_key("report.html"));
    assert_eq!(after["thesis.txt"], b"years of work");
}

/// Another recipe into the same folder: refused; with `--force` nothing of the former run is left that could
/// be taken for this one's.
#[test]
fn a_run_never_mixes_with_another() {
    let out = folder();
    run_set(out.path(), &[]).code(0);
    let before = contents(out.path());
    let recipe = root().join("pipelines/light-field.toml");
    let assert = run_command(&recipe, &set(SET), out.path(), &[]).code(2);
    assert!(
        stderr(&assert).contains("other photos or settings"),
        "{}",
        stderr(&assert)
    );
    assert!(contents(out.path()) == before, "no byte has changed");
    run_command(&recipe, &set(SET), out.path(), &["--force"]).code(0);
    let after = contents(out.path());
    assert!(after.contains_key("light_field.exr"));
    for name in [
        "lighting.csv",
        "lighting_spectrum.csv",
        "lighting.exr",
        "residual.exr",
    ] {
        assert!(!after.contains_key(name), "{name} is of the former run");
    }
}

#[test]
fn mistakes_of_the_command_line_are_explained() {
    flatlight().assert().code(2);
    flatlight().arg("rum").assert().code(2);
    let assert = flatlight().args(["run", "x.toml"]).assert().code(2);
    let message = stderr(&assert);
    assert!(
        message.contains("--capture") && message.contains("--out"),
        "{message}"
    );
    let help = flatlight().args(["run", "--help"]).assert().code(0);
    assert!(stdout(&help).contains("Example"), "{}", stdout(&help));
    let version = flatlight().arg("--version").assert().code(0);
    assert!(stdout(&version).contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn mistakes_in_a_recipe_are_told_all_at_once() {
    let temporary = folder();
    let out = temporary.path().join("out");
    let missing = temporary.path().join("nowhere.toml");
    refused(
        run_command(&missing, &set(SET), &out, &[]),
        &out,
        &["nowhere.toml", "pipelines/"],
    );

    let recipe = temporary.path().join("recipe.toml");
    std::fs::copy(set(SET).join("recipe.toml"), &recipe).expect("copies");
    edit(&recipe, "recover = \"lighting\"", "recover = \"lightning\"");
    edit(
        &recipe,
        "[report]",
        "[recovery]\nnon_negatve = true\n[report]",
    );
    let words = [
        "recipe.toml:3",
        "lightning",
        "\"lighting\"",
        "non_negatve",
        "`non_negative`",
    ];
    refused(run_command(&recipe, &set(SET), &out, &[]), &out, &words);

    std::fs::write(&recipe, "format = 1\nrecover = \"lighting\"\n").expect("writes");
    refused(
        run_command(&recipe, &set(SET), &out, &[]),
        &out,
        &["brdf", "model"],
    );

    std::fs::write(&recipe, "format = \n").expect("writes");
    refused(
        run_command(&recipe, &set(SET), &out, &[]),
        &out,
        &["recipe.toml:1"],
    );

    let text = "format = 1\nrecover = \"lighting\"\n[brdf]\ntable = \"missing.csv\"\n";
    std::fs::write(&recipe, text).expect("writes");
    refused(
        run_command(&recipe, &set(SET), &out, &[]),
        &out,
        &["missing.csv"],
    );

    let text = "format = 1\nrecover = \"lighting\"\n[brdf]\nmodel = \"fong\"\n";
    std::fs::write(&recipe, text).expect("writes");
    refused(
        run_command(&recipe, &set(SET), &out, &[]),
        &out,
        &["fong", "phong"],
    );
}

#[test]
fn mistakes_in_a_capture_are_told_with_file_and_view() {
    let temporary = folder();
    let out = temporary.path().join("out");
    let recipe = set(SET).join("recipe.toml");
    let nowhere = temporary.path().join("nowhere");
    refused(
        run_command(&recipe, &nowhere, &out, &[]),
        &out,
        &["nowhere"],
    );

    let copy = copy();
    let photo = copy.path().join("views/003.exr");

    let other = set("phong8-smooth").join("views/003.exr");
    std::fs::copy(other, &photo).expect("copies");
    let words = ["003.exr", "view 3", "512 x 24", "540 x 25"];
    let strict = &["--strict"];
    refused(
        run_command(&recipe, copy.path(), &out, strict),
        &out,
        &words,
    );

    let bytes = std::fs::read(set(SET).join("views/003.exr")).expect("reads");
    for length in [0, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&photo, &bytes[..length]).expect("writes");
        refused(
            run_command(&recipe, copy.path(), &out, strict),
            &out,
            &["003.exr", "view 3"],
        );
    }

    // All photos gone: the pattern matches none.
    std::fs::remove_dir_all(copy.path().join("views")).expect("removes");
    refused(
        run_command(&recipe, copy.path(), &out, &[]),
        &out,
        &["views/*.exr"],
    );

    let file = copy.path().join("capture.toml");
    edit(&file, "radius", "raduis");
    let words = ["capture.toml:", "object.raduis", "`radius`"];
    refused(run_command(&recipe, copy.path(), &out, &[]), &out, &words);
}

/// A surface that the photos cannot be of: a warning, with advice; with `--strict` a failure that writes nothing.
#[test]
fn warnings_are_failures_if_asked_for() {
    let temporary = folder();
    let (recipe, matte) = (set(SET).join("recipe.toml"), set("lambertian-smooth"));
    let out = temporary.path().join("strict");
    let assert = run_command(&recipe, &matte, &out, &["--strict"]).code(1);
    assert!(
        stderr(&assert).contains("unexplained"),
        "{}",
        stderr(&assert)
    );
    assert!(!out.exists(), "nothing is written");

    let out = temporary.path().join("lenient");
    let assert = run_command(&recipe, &matte, &out, &[]).code(0);
    assert!(stderr(&assert).contains("warning: "), "{}", stderr(&assert));
    assert!(out.join("report.html").exists());
    let summary = std::fs::read_to_string(out.join("summary.json")).expect("reads");
    assert!(
        summary.contains("unexplained"),
        "the warning is kept with the results"
    );
}

/// A place that cannot be written to is a wrong request, told with its name before any work.
#[test]
fn an_unwritable_place_is_refused() {
    let out = Path::new("/proc/flatlight-cannot-write-here");
    let assert = run_set(out, &[]).code(2);
    assert!(stderr(&assert).contains("/proc/"), "{}", stderr(&assert));
}

#[test]
fn a_capture_is_checked_before_any_long_work() {
    let assert = flatlight().arg("check").arg(set(SET)).assert().code(0);
    assert!(stdout(&assert).contains("36 views"), "{}", stdout(&assert));
    let copy = copy();
    edit(&copy.path().join("capture.toml"), "radius", "raduis");
    let assert = flatlight().arg("check").arg(copy.path()).assert().code(2);
    assert!(stderr(&assert).contains("raduis"), "{}", stderr(&assert));
}

/// Two runs of the same photos are the same; against the truth of the set, the tolerance decides.
#[test]
fn products_are_compared_with_an_exit_code() {
    let (one, two) = (folder(), folder());
    run_set(one.path(), &[]).code(0);
    run_set(two.path(), &[]).code(0);
    let compare = |a: &Path, b: &Path, more: &[&str]| {
        flatlight().arg("compare").args([a, b]).args(more).assert()
    };
    let same = compare(one.path(), two.path(), &["--tolerance", "0"]).code(0);
    for name in ["light_field.exr", "lighting.csv", "lighting_spectrum.csv"] {
        assert!(stdout(&same).contains(name), "{}", stdout(&same));
    }
    let found = one.path().join("lighting_spectrum.csv");
    let truth = set(SET).join("truth/lighting_spectrum.csv");
    compare(&found, &truth, &["--tolerance", "0.003"]).code(0);
    let differs = compare(&found, &truth, &["--tolerance", "0"]).code(1);
    assert!(
        stderr(&differs).contains("channel R"),
        "{}",
        stderr(&differs)
    );
    compare(&found, &one.path().join("lighting.csv"), &[]).code(2);
}
