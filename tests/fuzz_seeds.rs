//! The seeds of the fuzz targets, and thousands of small damages to them, through the targets' own bodies: what the
//! fuzzer does at length is done here in short, by the stable compiler.

#[path = "../fuzz/bodies.rs"]
mod bodies;

use std::path::{Path, PathBuf};

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Damages made of each seed.
const DAMAGES: usize = 60;

fn seeds(target: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fuzz/seeds")
        .join(target);
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
        .map(|entry| entry.expect("an entry").path())
        .collect();
    files.sort();
    files
        .into_iter()
        .map(|file| {
            let bytes = std::fs::read(&file).expect("reads");
            (file, bytes)
        })
        .collect()
}

/// A byte changed, a piece cut out, doubled or swapped for another, the end cut off, a number made absurd.
fn damage(bytes: &[u8], random: &mut StdRng) -> Vec<u8> {
    let mut damaged = bytes.to_vec();
    for _ in 0..random.random_range(1..4) {
        if damaged.is_empty() {
            return damaged;
        }
        let at = random.random_range(0..damaged.len());
        let end = (at + random.random_range(1..24)).min(damaged.len());
        match random.random_range(0..6) {
            0 => damaged[at] = random.random(),
            1 => {
                damaged.drain(at..end);
            }
            2 => {
                let piece = damaged[at..end].to_vec();
                let to = random.random_range(0..=damaged.len());
                damaged.splice(to..to, piece);
            }
            3 => damaged.truncate(at),
            4 => damaged[at..end].fill(0xff),
            _ => {
                let numbers: [&[u8]; 6] = [
                    b"-1",
                    b"nan",
                    b"1e309",
                    b"0",
                    b"99999999999999999999",
                    b"\"\"",
                ];
                let number = numbers[random.random_range(0..numbers.len())];
                damaged.splice(at..end.min(at + 3), number.iter().copied());
            }
        }
    }
    damaged
}

#[test]
fn no_target_falls_over_its_seeds_or_their_damages() {
    // Decoders may panic inside; the library contains that.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let mut fallen = Vec::new();
    for (name, body) in bodies::ALL {
        let folder = tempfile::tempdir().expect("a folder");
        let photo = seeds("photo_png").remove(0).1;
        std::fs::write(folder.path().join("a.png"), photo).expect("writes");
        let seeds = seeds(name);
        assert!(!seeds.is_empty(), "{name} has seeds");
        let mut random = StdRng::seed_from_u64(7);
        for (file, bytes) in &seeds {
            for k in 0..=DAMAGES {
                let input = if k == 0 {
                    bytes.clone()
                } else {
                    damage(bytes, &mut random)
                };
                let run = std::panic::AssertUnwindSafe(|| body(&input, folder.path()));
                if let Err(panic) = std::panic::catch_unwind(run) {
                    let said = panic.downcast_ref::<String>().cloned().unwrap_or_default();
                    fallen.push(format!("{name}, {}, damage {k}: {said}", file.display()));
                }
            }
        }
    }
    std::panic::set_hook(hook);
    assert!(fallen.is_empty(), "{}", fallen.join("\n"));
}
