//! A report can be made again from what a run left.

use std::path::Path;

use assert_cmd::Command;

fn flatlight() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_flatlight"));
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    command
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
}

#[test]
fn a_report_is_rebuilt_as_it_was_and_the_folder_stays_whole() {
    let out = tempfile::tempdir().expect("a temporary folder");
    let run = [
        "run",
        "pipelines/lighting.toml",
        "--capture",
        "testdata/phong32-two-suns",
        "--out",
    ];
    flatlight().args(run).arg(out.path()).assert().success();
    let page = read(out.path(), "report.html");
    std::fs::remove_file(out.path().join("report.html")).expect("it was there");
    flatlight().arg("report").arg(out.path()).assert().success();
    assert!(
        read(out.path(), "report.html") == page,
        "the rebuilt page differs"
    );
    // The provenance holds the page's hash, so that the folder still counts as this run.
    let again = flatlight().args(run).arg(out.path()).assert().success();
    let said = String::from_utf8_lossy(&again.get_output().stdout).into_owned();
    assert!(said.contains("nothing to do"), "{said}");
}

#[test]
fn a_folder_without_a_run_is_refused() {
    let out = tempfile::tempdir().expect("a temporary folder");
    let refused = flatlight().arg("report").arg(out.path()).assert().code(2);
    let said = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(
        said.contains("run.json") && said.contains("--out"),
        "{said}"
    );
    assert!(!out.path().join("report.html").exists());
}

#[test]
fn a_draft_names_what_is_left_and_is_never_written_over() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let set = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/phong32-sun/views");
    let views = folder.path().join("views");
    std::fs::create_dir(&views).expect("a folder");
    for entry in std::fs::read_dir(set).expect("views").take(4) {
        let entry = entry.expect("a photo");
        std::fs::copy(entry.path(), views.join(entry.file_name())).expect("a copy");
    }
    let first = flatlight()
        .arg("init")
        .arg(folder.path())
        .assert()
        .success();
    let said = String::from_utf8_lossy(&first.get_output().stdout).into_owned();
    assert!(said.contains("left to fill in"), "{said}");
    let draft = read(folder.path(), "capture.toml");
    assert!(draft.contains("FILL IN"));
    flatlight().arg("init").arg(folder.path()).assert().code(2);
    assert_eq!(read(folder.path(), "capture.toml"), draft);
    // What is not filled in is a fault, not a guess.
    flatlight().arg("check").arg(folder.path()).assert().code(2);
}

#[test]
fn check_reads_headers_and_answers_in_words_or_json() {
    let good = flatlight()
        .args(["check", "testdata/phong32-sun"])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&good.get_output().stdout).into_owned();
    assert!(
        said.contains("72 views") && said.contains("nothing wrong"),
        "{said}"
    );
    let json = flatlight()
        .args(["check", "testdata/phong32-sun", "--log", "json"])
        .assert()
        .success();
    let line: serde_json::Value =
        serde_json::from_slice(&json.get_output().stdout).expect("a line of JSON");
    assert_eq!(line["level"], "result");
    let missing = flatlight()
        .args(["check", "no-such-folder", "--log", "json"])
        .assert()
        .code(2);
    let line: serde_json::Value =
        serde_json::from_slice(&missing.get_output().stderr).expect("a line of JSON");
    assert_eq!(
        [&line["level"], &line["exit_code"]],
        [&"error".into(), &serde_json::json!(2)]
    );
}
