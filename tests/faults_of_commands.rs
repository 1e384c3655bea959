//! Faults of the system in the commands beside `run`: every call on the file system fails once, the disk is full from any call on, the process is
//! killed at any call and at random moments, two want one folder. Afterwards the folder holds complete files of the former or the
//! new results only, and the next attempt ends as if nothing had been.

mod ended;
mod folder;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use ended::{calls, code, one_worked, said};
use folder::{contents, hidden};
use rayon::prelude::*;
use tempfile::TempDir;

const SIMULATE: &str = "format = 1\nname = \"small\"\nseed = 1\nchannels = [\"Y\"]\n[object]\nshape = \"cylinder\"\nradius = 0.05\n\
    [camera]\nimage_size = [96, 16]\nfocal_px = 480\ndistance = 0.6\n[views]\ncount = 6\norbit_step_deg = 60\n\
    [brdf]\nmodel = \"phong\"\ndiffuse = 0.30\nspecular = 0.4\nexponent = 8\n\
    [lighting]\nsources = [{ theta_deg = 37.3, irradiance = 3.0 }]\nuniform = 0.05\n[sensor]\nformat = \"exr-float\"\n";
/// So few cells that processes start and files are written most of the time: calls are as many as on a fine grid.
const GRID: &str = "\n[light_field]\nnormals = 72\nlocals = 36\n";
const VALIDATE: &str = "format = 1\nseed = 7\n[brdf.shiny]\nmodel = \"phong\"\ndiffuse = 0.3\nspecular = 0.7\nexponent = 8\n\
    [lighting.soft]\nrandom_order = 4\n[[study]]\nname = \"l\"\nrecover = \"lighting\"\nbrdf = [\"shiny\"]\nlighting = [\"soft\"]\nnoise = [0.01, 0.02]\n\
    views = [24]\nlocals = 20\ndraws = 2\n";

/// A command with its arguments that writes into the folder `out`, and what stood there before.
struct Case {
    name: &'static str,
    /// Arguments; `@` begins the name of a file of [`Case::place`], `^` one of the folder that is written to.
    former: Option<&'static str>,
    new: &'static str,
    /// What the command says where it finds its work done, with exit code 2.
    done: Option<&'static str>,
    /// Files that tell what failed, whole but of neither.
    telling: &'static [&'static str],
}

/// Each writes over what `former` left. A batch without its sets' folders, which are those of `run`.
const CASES: [Case; 10] = [
    Case {
        name: "simulate",
        former: Some("simulate @former.toml --out ^"),
        new: "simulate @new.toml --out ^ --force",
        done: None,
        telling: &[],
    },
    Case {
        name: "validate",
        former: Some("validate @former-study.toml --out ^"),
        new: "validate @study.toml --out ^",
        done: None,
        telling: &[],
    },
    Case {
        name: "batch",
        former: Some("batch @sets @former-recipe.toml --out ^"),
        new: "batch @sets @recipe.toml --out ^ --force --jobs 1",
        done: None,
        telling: &["report.html", "summary.csv"],
    },
    Case {
        name: "export",
        former: Some("export @former-run --to npz,mitsuba --out ^"),
        new: "export @run --to npz,mitsuba,blender --out ^",
        done: None,
        telling: &[],
    },
    Case {
        name: "compare",
        former: Some(
            "compare @former-run/lighting.csv @run/lighting.csv --tolerance 9 --out ^d.csv --report ^d.html",
        ),
        new: "compare @run/lighting.csv @run/lighting.csv --tolerance 9 --out ^d.csv --report ^d.html",
        done: None,
        telling: &[],
    },
    Case {
        name: "prefilter to an image",
        former: Some(
            "prefilter @run/lighting.csv --brdf model=lambertian,albedo=0.3 --out ^t.exr --normals 24 --locals 12",
        ),
        new: "prefilter @run/lighting.csv --brdf model=lambertian,albedo=0.5 --out ^t.exr --normals 24 --locals 12",
        done: None,
        telling: &[],
    },
    Case {
        name: "prefilter to a table",
        former: Some(
            "prefilter @run/lighting.csv --brdf model=lambertian,albedo=0.3 --out ^t.csv --normals 24 --locals 12",
        ),
        new: "prefilter @run/lighting.csv --brdf model=lambertian,albedo=0.5 --out ^t.csv --normals 24 --locals 12",
        done: None,
        telling: &[],
    },
    Case {
        name: "paper",
        former: None,
        new: "paper --out ^",
        done: None,
        telling: &[],
    },
    Case {
        name: "man",
        former: None,
        new: "man --out ^",
        done: None,
        telling: &[],
    },
    Case {
        name: "init",
        former: Some("simulate @former.toml --out ^"),
        new: "init ^views",
        done: Some("it is there already"),
        telling: &[],
    },
];

/// What the commands read.
static PLACE: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, text).expect("writes");
    };
    write("former.toml", SIMULATE);
    write(
        "new.toml",
        &SIMULATE.replace("diffuse = 0.30", "diffuse = 0.25"),
    );
    write(
        "former-study.toml",
        &VALIDATE.replace("seed = 7", "seed = 8"),
    );
    write("study.toml", VALIDATE);
    write(
        "former-recipe.toml",
        &format!("format = 1\nrecover = \"none\"\n{GRID}"),
    );
    let ran = |words: &str| {
        let output = command(words, folder.path(), folder.path())
            .output()
            .expect("starts");
        assert_eq!(code(&output), 0, "{words}: {}", said(&output));
    };
    ran("simulate @former.toml --out @sets/a");
    ran("simulate @new.toml --out @sets/b");
    for (set, recipe) in [("a", "recipe.toml"), ("b", "recipe-b.toml")] {
        let written = folder.path().join(format!("sets/{set}/recipe.toml"));
        let text = std::fs::read_to_string(written).expect("reads");
        write(recipe, &format!("{text}{GRID}"));
    }
    ran("run @recipe.toml --capture @sets/a --out @former-run");
    ran("run @recipe-b.toml --capture @sets/b --out @run");
    folder
});

fn command(words: &str, place: &Path, out: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_flatlight"));
    for word in words.split(' ') {
        match (word.strip_prefix('@'), word.strip_prefix('^')) {
            (Some(name), _) => command.arg(place.join(name)),
            (_, Some("")) => command.arg(out),
            (_, Some(name)) => command.arg(out.join(name)),
            _ => command.arg(word),
        };
    }
    // One thread: the n-th call is the same in every run.
    command
        .args(["--threads", "1"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// A case with what its folder shows before and after.
struct Sound {
    case: &'static Case,
    folder: TempDir,
    former: BTreeMap<String, Vec<u8>>,
    new: BTreeMap<String, Vec<u8>>,
    time: Duration,
}

impl Sound {
    fn of(case: &'static Case) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("former");
        std::fs::create_dir(&out).expect("a folder");
        if let Some(words) = case.former {
            let output = command(words, PLACE.path(), &out).output().expect("starts");
            assert_eq!(code(&output), 0, "{words}: {}", said(&output));
        }
        let mut sound = Self {
            case,
            former: contents(&out),
            new: BTreeMap::new(),
            time: Duration::ZERO,
            folder,
        };
        let place = tempfile::tempdir().expect("a folder");
        let out = sound.with_former(place.path());
        let start = Instant::now();
        let output = sound.new_at(&out).output().expect("starts");
        assert_eq!(code(&output), 0, "{}: {}", case.new, said(&output));
        sound.time = start.elapsed();
        sound.new = contents(&out);
        assert!(sound.new != sound.former, "{} does something", case.name);
        assert_eq!(hidden(&out), Vec::<String>::new());
        sound
    }

    fn with_former(&self, place: &Path) -> PathBuf {
        let out = place.join("out");
        copy(&self.folder.path().join("former"), &out);
        out
    }

    fn new_at(&self, out: &Path) -> Command {
        command(self.case.new, PLACE.path(), out)
    }

    /// What is wrong after the command was disturbed: with its folder, and with the same command after it.
    fn aftermath(&self, out: &Path) -> Result<(), String> {
        for (name, bytes) in &contents(out) {
            let is = |all: &BTreeMap<String, Vec<u8>>| all.get(name) == Some(bytes);
            let tells = self.case.telling.contains(&name.as_str());
            if !is(&self.former) && !is(&self.new) && !tells {
                return Err(format!("{name} is neither the former nor the new"));
            }
        }
        let again = self.new_at(out).output().expect("starts");
        let done = self
            .case
            .done
            .is_some_and(|done| said(&again).contains(done));
        if code(&again) != 0 && !done {
            return Err(format!("the next one fails: {}", said(&again)));
        }
        let found = contents(out);
        if found != self.new {
            let odd = |name: &&String| found.get(*name) != self.new.get(*name);
            let names: Vec<&String> = found.keys().chain(self.new.keys()).filter(odd).collect();
            return Err(format!("not as undisturbed: {names:?}"));
        }
        match hidden(out) {
            hidden if hidden.is_empty() => Ok(()),
            hidden => Err(format!("hidden files are left: {hidden:?}")),
        }
    }

    /// The command with `FLATLIGHT_FAIL_CALL` set: what is wrong afterwards, and whether the call came.
    fn disturbed(&self, fail: &str) -> Result<bool, String> {
        let place = tempfile::tempdir().expect("a folder");
        let out = self.with_former(place.path());
        let output = self
            .new_at(&out)
            .env("FLATLIGHT_FAIL_CALL", fail)
            .output()
            .expect("starts");
        let (code, message) = (code(&output), said(&output));
        let told = match code {
            // Killed by itself, as asked.
            -1 => fail.ends_with('!'),
            0 => true,
            1 | 2 => message.contains("error: ") && message.contains("made to fail"),
            _ => false,
        };
        if !told || message.contains("panicked") {
            return Err(format!("exit code {code}: {message}"));
        }
        if code == 0 && contents(&out) != self.new {
            return Err("it said that all went well".into());
        }
        self.aftermath(&out)?;
        Ok(code != 0)
    }

    /// Whether the command comes to its `n`-th call on the file system.
    fn comes(&self, n: usize) -> bool {
        let place = tempfile::tempdir().expect("a folder");
        let out = self.with_former(place.path());
        let mut command = self.new_at(&out);
        let output = command.env("FLATLIGHT_FAIL_CALL", format!("{n}!")).output();
        code(&output.expect("starts")) == -1
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("a folder") {
        let entry = entry.expect("an entry");
        let to = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &to);
        } else {
            std::fs::copy(entry.path(), to).expect("copies");
        }
    }
}

/// About `count` calls of each command fail, alone, with all after it, and as a power loss.
fn calls_fail(count: usize) {
    let wrong: Vec<String> = CASES
        .par_iter()
        .flat_map(|case| {
            let sound = Sound::of(case);
            let calls = calls(case.name, |n| sound.comes(n));
            let asked: Vec<String> = (1..=calls)
                .step_by(calls.div_ceil(count))
                .chain([calls])
                .flat_map(|n| ["", "+", "!"].map(|how| format!("{n}{how}")))
                .collect();
            println!("{}: {} faults at {calls} calls", case.name, asked.len());
            let wrong: Vec<String> = asked
                .par_iter()
                .filter_map(|fail| {
                    let wrong = sound.disturbed(fail).err()?;
                    Some(format!("{}, call {fail} of {calls}: {wrong}", case.name))
                })
                .collect();
            wrong
        })
        .collect();
    assert!(wrong.is_empty(), "{}:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn a_call_that_fails_leaves_whole_files_and_a_command_that_can_be_repeated() {
    calls_fail(6);
}

/// The same at every call.
#[test]
#[ignore = "takes minutes; cargo test --test faults_of_commands -- --ignored"]
fn every_call_that_fails_leaves_whole_files() {
    calls_fail(usize::MAX);
}

/// Kills each command at random moments of its time; it is then given again.
fn kills(count: u64) {
    let wrong: Vec<String> = CASES
        .par_iter()
        .flat_map(|case| {
            let sound = Sound::of(case);
            let wrong: Vec<String> = (0..count)
                .into_par_iter()
                .filter_map(|k| {
                    let place = tempfile::tempdir().expect("a folder");
                    let out = sound.with_former(place.path());
                    // A sequence that fills the interval evenly in any order: multiples of the golden ratio.
                    let moment = (k as f64 * 0.618_033_988_75).fract() * 1.1;
                    let mut child = sound.new_at(&out).spawn().expect("starts");
                    std::thread::sleep(sound.time.mul_f64(moment));
                    child.kill().expect("kills");
                    child.wait().expect("ends");
                    let wrong = sound.aftermath(&out).err()?;
                    Some(format!("{}, killed at {moment:.3}: {wrong}", case.name))
                })
                .collect();
            wrong
        })
        .collect();
    assert!(wrong.is_empty(), "{}:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn a_command_that_is_killed_can_be_given_again() {
    kills(3);
}

#[test]
#[ignore = "takes minutes; cargo test --test faults_of_commands -- --ignored"]
fn commands_that_are_killed_a_hundred_times_can_be_given_again() {
    kills(100);
}

/// Every command that writes a folder is refused while another is at work in it, and changes nothing there.
#[test]
fn two_commands_do_not_write_into_one_folder() {
    for case in &CASES {
        // Those that write a single file each give it a name at once, and two of them do not meet.
        if case.new.contains("^d.") || case.new.contains("^t.") {
            continue;
        }
        let sound = Sound::of(case);
        let place = tempfile::tempdir().expect("a folder");
        let out = sound.with_former(place.path());
        let folder = match case.name {
            "init" => out.join("views"),
            _ => out.clone(),
        };
        let held = std::fs::File::open(&folder).expect("the folder");
        held.lock().expect("locks");
        let second = sound.new_at(&out).output().expect("starts");
        assert_eq!(code(&second), 2, "{}: {}", case.name, said(&second));
        assert!(
            said(&second).contains("another flatlight is at work"),
            "{}: {}",
            case.name,
            said(&second)
        );
        assert!(
            contents(&out) == sound.former,
            "{}: no byte has changed",
            case.name
        );
        // Not by closing it: a process that another test is just starting may still hold it open, and with it the lock.
        held.unlock().expect("unlocks");
        // Two at once: one does the work, and the other is refused or comes after it.
        let mut pair = [(); 2].map(|()| sound.new_at(&out).spawn().expect("starts"));
        one_worked(&mut pair, case.name);
        assert!(contents(&out) == sound.new, "{}", case.name);
    }
}

/// Of commands that write single files several may be at work at once, each on a result of its own: what is there at any moment and in the end is
/// one of the results, whole, and files that belong together are of the same one.
#[test]
fn commands_that_write_the_same_file_at_once_mix_nothing() {
    for case in CASES
        .iter()
        .filter(|case| case.new.contains("^d.") || case.new.contains("^t."))
    {
        let sound = Sound::of(case);
        for round in 0..6 {
            let place = tempfile::tempdir().expect("a folder");
            let out = sound.with_former(place.path());
            let former = case.former.expect("the same with another result");
            let mut at_work: Vec<Child> = (0..6)
                .map(|k| match (k + round) % 2 {
                    0 => sound.new_at(&out).spawn().expect("starts"),
                    _ => command(former, PLACE.path(), &out).spawn().expect("starts"),
                })
                .collect();
            let whole = |found: &BTreeMap<String, Vec<u8>>| {
                found.iter().all(|(name, bytes)| {
                    [&sound.former, &sound.new]
                        .iter()
                        .any(|run| run.get(name) == Some(bytes))
                })
            };
            while at_work
                .iter_mut()
                .any(|c| c.try_wait().expect("ends").is_none())
            {
                let seen = contents(&out);
                assert!(whole(&seen), "{}: half a file is seen", case.name);
            }
            one_worked(&mut at_work, case.name);
            let found = contents(&out);
            assert!(
                found == sound.former || found == sound.new,
                "{}: of both results",
                case.name
            );
            assert!(hidden(&out).is_empty(), "{}: {:?}", case.name, hidden(&out));
        }
    }
}

/// A place that cannot be written to is the user's to mend: exit code 2, and what is wrong in words.
#[test]
#[cfg(unix)]
fn a_place_that_cannot_be_written_to_is_said() {
    for case in &CASES {
        let place = tempfile::tempdir().expect("a folder");
        // A file in the way: what even root cannot write under.
        let out = place.path().join("file");
        std::fs::write(&out, "in the way").expect("writes");
        let output = command(case.new, PLACE.path(), &out.join("below"))
            .output()
            .expect("starts");
        assert_eq!(code(&output), 2, "{}: {}", case.name, said(&output));
        let message = said(&output);
        assert!(
            message.contains("error: ")
                && message.contains("file")
                && !message.contains("panicked"),
            "{}: {message}",
            case.name
        );
    }
}

/// Results that cannot be printed are a clear failure, and a reader that has enough is none.
#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_behind_the_standard_output_is_said() {
    let full = || {
        let file = std::fs::OpenOptions::new().write(true).open("/dev/full");
        Stdio::from(file.expect("a device that is always full"))
    };
    let place = tempfile::tempdir().expect("a folder");
    for words in [
        "check @sets/a",
        "man --out ^",
        "compare @run/lighting.csv @run/lighting.csv",
    ] {
        let output = command(words, PLACE.path(), place.path())
            .stdout(full())
            .output()
            .expect("starts");
        assert_eq!(code(&output), 2, "{words}: {}", said(&output));
        assert!(
            said(&output).contains("cannot print"),
            "{words}: {}",
            said(&output)
        );
        let quiet = command(words, PLACE.path(), place.path())
            .stderr(full())
            .output()
            .expect("starts");
        assert_eq!(code(&quiet), 0, "{words} without a place for warnings");
    }
}
