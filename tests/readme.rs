//! What the README says can be done, is done: its commands run, its files exist, its map is true.

mod sets;

use std::collections::BTreeSet;

use sets::*;

const README: &str = include_str!("../README.md");

/// The commands of the README's shell blocks.
fn commands() -> Vec<String> {
    let mut commands = Vec::new();
    let mut shell = false;
    for line in README.lines() {
        if let Some(language) = line.strip_prefix("```") {
            shell = language == "sh";
        } else if shell && !line.trim().is_empty() {
            commands.push(line.trim().to_string());
        }
    }
    commands
}

/// `cargo run --release -- ARGUMENTS` and `flatlight ARGUMENTS` are run by the binary under test, in a folder that
/// is like a fresh clone; the commands that build or install it are what brought this test here.
#[test]
fn every_command_runs() {
    let clone = tempfile::tempdir().expect("a temporary folder");
    for entry in ["pipelines", "testdata"] {
        std::os::unix::fs::symlink(root().join(entry), clone.path().join(entry)).expect("a link");
    }
    let mut run = 0;
    for command in commands() {
        let line = command.split('#').next().unwrap_or_default().trim();
        let arguments = line
            .strip_prefix("cargo run --release -- ")
            .or_else(|| line.strip_prefix("flatlight "));
        match arguments {
            Some(arguments) => {
                assert_cmd::Command::new(env!("CARGO_BIN_EXE_flatlight"))
                    .current_dir(clone.path())
                    .args(arguments.split_whitespace())
                    .assert()
                    .code(0);
                run += 1;
            }
            None => assert!(
                ["cargo test", "cargo bench", "cargo install --path ."].contains(&line),
                "a command that this test does not know: {command}"
            ),
        }
    }
    assert!(run >= 3, "{run} commands were run");
    assert!(commands().iter().any(|c| c.starts_with("cargo test")));
    assert!(
        clone.path().join("out/report.html").exists(),
        "the file to open is there"
    );
}

/// Links to files of the project.
#[test]
fn every_link_leads_somewhere() {
    let mut links = 0;
    for (at, _) in README.match_indices("](") {
        let target = README[at + 2..].split(')').next().unwrap_or_default();
        if !target.starts_with("http") && !target.starts_with('#') {
            assert!(root().join(target).exists(), "{target}");
            links += 1;
        }
    }
    assert!(links >= 3, "{links} links");
}

/// The map of the code lists every module of `src/`, and none that is not there.
#[test]
fn the_map_is_true() {
    let listed: BTreeSet<&str> = README
        .lines()
        .filter_map(|line| line.strip_prefix("src/"))
        .filter_map(|line| line.split_whitespace().next())
        .map(|name| name.trim_end_matches('/'))
        .collect();
    let there: BTreeSet<String> = std::fs::read_dir(root().join("src"))
        .expect("the source")
        .map(|entry| {
            entry
                .expect("an entry")
                .file_name()
                .to_string_lossy()
                .into()
        })
        .collect();
    let there: BTreeSet<&str> = there.iter().map(String::as_str).collect();
    assert_eq!(listed, there);
}

/// Names of photo sets, recipes and products in the README exist.
#[test]
fn every_named_recipe_exists() {
    for word in README.split(|c: char| c.is_whitespace() || "`()|,;".contains(c)) {
        if word.starts_with("pipelines/") && word.ends_with(".toml") {
            assert!(root().join(word).exists(), "{word}");
        }
    }
}
