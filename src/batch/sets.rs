//! Which folders are capture sets.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// How deep sets may lie below the folder of a batch.
const DEEPEST: usize = 8;
/// Endings of photographs, lower case: a folder that holds some and no `capture.toml` is a set that lacks it.
const PHOTOGRAPHS: [&str; 18] = [
    "exr", "hdr", "pic", "png", "tif", "tiff", "jpg", "jpeg", "dng", "cr2", "cr3", "nef", "arw",
    "raf", "orf", "rw2", "pef", "srw",
];

/// A capture set of a batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Set {
    /// Its folder relative to the batch's, with `/` between parts: its name, and that of its folder of products.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
}

/// The capture sets below `folder`, by name: every folder that holds a `capture.toml`, at any depth, and every folder directly below
/// that holds photographs, or nothing at all, without one: it is a set with a fault, not something to pass over. Left out are folders whose name begins
/// with a dot, results of runs, and `out`.
///
/// # Errors
/// If `folder` cannot be read or holds no set.
pub fn find_sets(folder: &Path, out: &Path) -> Result<Vec<Set>> {
    let mut sets = Vec::new();
    let out = std::fs::canonicalize(out).ok();
    let single = folder.join("capture.toml").exists();
    for (name, path) in subfolders(folder)? {
        let before = sets.len();
        let result = is_result(&path) || is_same(&path, out.as_deref());
        walk(&path, &name, out.as_deref(), 0, &mut sets);
        // Below a set are its photographs.
        if sets.len() == before && !result && !single && lacks_description(&path, 0) {
            sets.push(Set { name, folder: path });
        }
    }
    if sets.is_empty() {
        let found = if single { "one set itself" } else { "none" };
        return Err(Error::input(format!(
            "expected folders with a capture.toml each below this one, found {found}"
        ))
        .file(folder)
        .advice(if single {
            "Use `flatlight run` for a single set, or give the folder above."
        } else {
            "`flatlight init` writes a first capture.toml for a folder of photos."
        }));
    }
    sets.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(sets)
}

fn walk(path: &Path, name: &str, out: Option<&Path>, depth: usize, sets: &mut Vec<Set>) {
    if is_same(path, out) || is_result(path) || depth > DEEPEST {
        return;
    }
    match subfolders(path) {
        Ok(folders) if !path.join("capture.toml").exists() => {
            for (below, path) in folders {
                walk(&path, &format!("{name}/{below}"), out, depth + 1, sets);
            }
        }
        // A folder that cannot be read fails as a set, and says why.
        _ => sets.push(Set {
            name: name.to_owned(),
            folder: path.to_path_buf(),
        }),
    }
}

fn is_same(path: &Path, out: Option<&Path>) -> bool {
    out.is_some() && std::fs::canonicalize(path).ok().as_deref() == out
}

/// Whether a run left the folder: it holds a `capture.toml` too, but no photographs.
fn is_result(path: &Path) -> bool {
    path.join("provenance.json").exists()
}

/// Whether the folder is empty or holds photographs at any depth.
fn lacks_description(path: &Path, depth: usize) -> bool {
    let entries = entries(path).unwrap_or_default();
    if entries.is_empty() && depth == 0 {
        return true;
    }
    entries.iter().any(|(_, path)| {
        if path.is_dir() {
            return depth < DEEPEST && lacks_description(path, depth + 1);
        }
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        ending.is_some_and(|e| PHOTOGRAPHS.contains(&e.as_str()))
    })
}

fn subfolders(path: &Path) -> Result<Vec<(String, PathBuf)>> {
    let mut folders = entries(path)?;
    folders.retain(|(_, path)| path.is_dir());
    Ok(folders)
}

/// Name and path of everything in a folder that is not hidden, by name.
fn entries(folder: &Path) -> Result<Vec<(String, PathBuf)>> {
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| Error::read(folder, e))? {
        let entry = entry.map_err(|e| Error::read(folder, e))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if !name.starts_with('.') {
            entries.push((name, entry.path()));
        }
    }
    entries.sort();
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_found_at_any_depth_and_results_are_not_sets() {
        let root = tempfile::tempdir().expect("a folder");
        let file = |name: &str| {
            let path = root.path().join(name);
            std::fs::create_dir_all(path.parent().expect("inside")).expect("a folder");
            std::fs::write(path, b"x").expect("a file");
        };
        file("b/capture.toml");
        file("a/first/capture.toml");
        file("a/second/capture.toml");
        file("a/second/deeper/capture.toml");
        file("photos without description/views/1.EXR");
        file("notes/read me.txt");
        file("earlier/b/capture.toml");
        file("earlier/b/provenance.json");
        file(".hidden/capture.toml");
        file("out/c/capture.toml");
        std::fs::create_dir(root.path().join("empty")).expect("a folder");
        let sets = find_sets(root.path(), &root.path().join("out")).expect("sets");
        let names: Vec<&str> = sets.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "a/first",
                "a/second",
                "b",
                "empty",
                "photos without description"
            ]
        );
        let single = find_sets(&root.path().join("b"), Path::new("out")).expect_err("one set");
        assert!(single.to_string().contains("flatlight run"), "{single}");
        assert!(find_sets(&root.path().join("nowhere"), Path::new("out")).is_err());
    }
}
