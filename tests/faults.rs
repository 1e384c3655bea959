//! Faults of the system: every call on the file system fails once, the disk is full from any call on, the process is killed at
//! any call and at random moments, two runs want one folder. Afterwards the folder holds complete files of the former or the
//! new run only, and the next run ends as if nothing had been.

mod ended;
mod folder;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use ended::{calls, code, one_worked, said};
use folder::{contents, hidden};
use rayon::prelude::*;
use tempfile::TempDir;

const SIMULATE: &str = "format = 1\nname = \"small\"\nseed = 1\nchannels = [\"R\", \"G\", \"B\"]\n[object]\nshape = \"cylinder\"\nradius = 0.05\n\
    [camera]\nimage_size = [96, 16]\nfocal_px = 480\ndistance = 0.6\n[views]\ncount = 6\norbit_step_deg = 60\n\
    [brdf]\nmodel = \"phong\"\ndiffuse = [0.30, 0.22, 0.15]\nspecular = 0.4\nexponent = 8\n\
    [lighting]\nsources = [{ theta_deg = 37.3, irradiance = [3.0, 2.9, 2.7] }]\nuniform = 0.05\n[sensor]\nformat = \"exr-float\"\n";

/// A small set, the products of two recipes on it, and how long a run takes.
struct Sound {
    folder: TempDir,
    former: BTreeMap<String, Vec<u8>>,
    new: BTreeMap<String, Vec<u8>>,
    time: Duration,
}

static SOUND: LazyLock<Sound> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("simulate.toml"), SIMULATE).expect("writes");
    let output = command(&[
        "simulate",
        shown(&at("simulate.toml")),
        "--out",
        shown(&at("set")),
    ])
    .output();
    assert!(output.expect("starts").status.success());
    std::fs::write(at("former.toml"), "format = 1\nrecover = \"none\"\n").expect("writes");
    let run = |recipe: &Path, name: &str| {
        let out = at(name);
        let output = run(recipe, &at("set"), &out).output().expect("starts");
        assert_eq!(code(&output), 0, "{}", said(&output));
        contents(&out)
    };
    let former = run(&at("former.toml"), "former");
    let start = Instant::now();
    let new = run(&at("set/recipe.toml"), "new");
    let time = start.elapsed();
    Sound {
        former,
        new,
        time,
        folder,
    }
});

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_flatlight"));
    // One thread: the n-th call is the same in every run.
    command
        .args(arguments)
        .args(["--threads", "1"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// `flatlight run … --force`: whatever the folder holds.
fn run(recipe: &Path, set: &Path, out: &Path) -> Command {
    command(&[
        "run",
        shown(recipe),
        "--capture",
        shown(set),
        "--out",
        shown(out),
        "--force",
    ])
}

/// The new run into a folder.
fn new_run(out: &Path) -> Command {
    let folder = SOUND.folder.path();
    run(&folder.join("set/recipe.toml"), &folder.join("set"), out)
}

fn shown(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// Every file is the former run's or the new one's, whole.
fn is_of_either(found: &BTreeMap<String, Vec<u8>>) -> Result<(), String> {
    for (name, bytes) in found {
        let is = |run: &BTreeMap<String, Vec<u8>>| run.get(name) == Some(bytes);
        if !is(&SOUND.former) && !is(&SOUND.new) {
            return Err(format!("{name} is of neither run"));
        }
    }
    Ok(())
}

/// A folder that holds the former run.
fn with_former(place: &Path) -> PathBuf {
    let out = place.join("out");
    std::fs::create_dir(&out).expect("a folder");
    for entry in std::fs::read_dir(SOUND.folder.path().join("former")).expect("the former run") {
        let entry = entry.expect("an entry");
        std::fs::copy(entry.path(), out.join(entry.file_name())).expect("copies");
    }
    out
}

/// What is wrong after a run that was disturbed: with its folder, and with a run after it.
fn aftermath(out: &Path) -> Result<(), String> {
    is_of_either(&contents(out))?;
    let again = new_run(out).output().expect("starts");
    if code(&again) != 0 {
        return Err(format!("the next run fails: {}", said(&again)));
    }
    let found = contents(out);
    for (name, bytes) in &SOUND.new {
        if found.get(name) != Some(bytes) {
            return Err(format!("{name} is not as in an undisturbed run"));
        }
    }
    match (found.len() == SOUND.new.len(), hidden(out)) {
        (true, hidden) if hidden.is_empty() => Ok(()),
        (_, hidden) => Err(format!(
            "the folder holds more: {:?}, {hidden:?} hidden",
            found.keys()
        )),
    }
}

/// The new run over the former with `FLATLIGHT_FAIL_CALL` set: what is wrong afterwards. A call whose failure does no
/// harm, as of what only would have spared work, may fail without a word if every product is right.
fn disturbed(fail: &str) -> Result<(), String> {
    let place = tempfile::tempdir().expect("a folder");
    let out = with_former(place.path());
    let output = new_run(&out)
        .env("FLATLIGHT_FAIL_CALL", fail)
        .output()
        .expect("starts");
    let code = code(&output);
    let message = said(&output);
    let told = match code {
        // Killed by itself, as asked.
        -1 => fail.ends_with('!'),
        0 => true,
        1 | 2 => message.starts_with("error: ") && message.contains("made to fail"),
        _ => false,
    };
    if !told || message.contains("panicked") {
        return Err(format!("exit code {code}: {message}"));
    }
    if code == 0 && contents(&out) != SOUND.new {
        return Err("it said that all went well".into());
    }
    aftermath(&out)
}

/// Every `stride`-th call fails, alone, with all after it, and as a power loss.
fn all_calls(stride: usize) {
    let calls = calls("a run", |n| {
        let place = tempfile::tempdir().expect("a folder");
        let out = with_former(place.path());
        let output = new_run(&out)
            .env("FLATLIGHT_FAIL_CALL", format!("{n}!"))
            .output();
        code(&output.expect("starts")) != 0
    });
    let asked: Vec<String> = (1..=calls)
        .step_by(stride)
        .flat_map(|n| ["", "+", "!"].map(|how| format!("{n}{how}")))
        .collect();
    let wrong: Vec<String> = asked
        .par_iter()
        .filter_map(|fail| {
            let wrong = disturbed(fail).err();
            wrong.map(|what| format!("call {fail} of {calls}: {what}"))
        })
        .collect();
    println!("{} faults at {calls} calls", asked.len());
    assert!(
        wrong.is_empty(),
        "{} of {}:\n{}",
        wrong.len(),
        asked.len(),
        wrong.join("\n")
    );
}

#[test]
fn a_call_that_fails_leaves_whole_files_and_a_run_that_can_be_repeated() {
    all_calls(13);
}

/// The same at every call.
#[test]
#[ignore = "takes minutes; cargo test --test faults -- --ignored"]
fn every_call_that_fails_leaves_whole_files() {
    all_calls(1);
}

/// Kills runs at random moments of their time; each is then run again.
fn kills(count: u64) {
    let wrong: Vec<String> = (0..count)
        .into_par_iter()
        .filter_map(|k| {
            let place = tempfile::tempdir().expect("a folder");
            let out = with_former(place.path());
            // A sequence that fills the interval evenly in any order: multiples of the golden ratio.
            let moment = (k as f64 * 0.618_033_988_75).fract() * 1.1;
            let mut child = new_run(&out).spawn().expect("starts");
            std::thread::sleep(SOUND.time.mul_f64(moment));
            child.kill().expect("kills");
            child.wait().expect("ends");
            aftermath(&out)
                .err()
                .map(|what| format!("killed at {moment:.3} of its time: {what}"))
        })
        .collect();
    assert!(
        wrong.is_empty(),
        "{} of {count}:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

#[test]
fn a_run_that_is_killed_can_be_run_again() {
    kills(12);
}

#[test]
#[ignore = "takes a minute; .ci/run runs it"]
fn a_hundred_runs_that_are_killed_can_be_run_again() {
    kills(100);
}

#[test]
fn two_runs_into_one_folder_are_not_mixed() {
    let place = tempfile::tempdir().expect("a folder");
    let out = with_former(place.path());
    // As a run holds it from its beginning to its end.
    let held = std::fs::File::open(&out).expect("the folder");
    held.lock().expect("locks");
    let second = new_run(&out).output().expect("starts");
    assert_eq!(code(&second), 2, "{}", said(&second));
    assert!(
        said(&second).contains("another flatlight is at work"),
        "{}",
        said(&second)
    );
    assert!(contents(&out) == SOUND.former, "no byte has changed");
    // Not by closing it: a process that another test is just starting may still hold it open, and with it the lock.
    held.unlock().expect("unlocks");
    // Two at once: one does the work, and the other is refused or comes after it.
    let mut pair = [
        new_run(&out).spawn().expect("starts"),
        new_run(&out).spawn().expect("starts"),
    ];
    one_worked(&mut pair, "run");
    assert!(contents(&out) == SOUND.new);
}

#[test]
fn a_refused_run_leaves_no_folder_behind() {
    let place = tempfile::tempdir().expect("a folder");
    let out = place.path().join("made/on/the/way");
    let output = new_run(&out)
        .env("FLATLIGHT_FAIL_CALL", "40")
        .output()
        .expect("starts");
    assert_ne!(code(&output), 0);
    assert!(!place.path().join("made").exists(), "{}", said(&output));
}

/// The same products, to the last bit, at 1, 2 and 4 threads.
#[test]
fn threads_change_no_bit() {
    let place = tempfile::tempdir().expect("a folder");
    let folder = SOUND.folder.path();
    for threads in ["1", "2", "4"] {
        let out = place.path().join(threads);
        let mut run = Command::new(env!("CARGO_BIN_EXE_flatlight"));
        let output = run
            .arg("run")
            .arg(folder.join("set/recipe.toml"))
            .arg("--capture")
            .arg(folder.join("set"))
            .arg("--out")
            .arg(&out)
            .args(["--threads", threads])
            .output()
            .expect("starts");
        assert_eq!(code(&output), 0, "{}", said(&output));
        let found = contents(&out);
        for (name, bytes) in &SOUND.new {
            assert!(
                found.get(name) == Some(bytes),
                "{name} at {threads} threads"
            );
        }
    }
}
