//! Data flows one way: a module uses those above it, in the order below, never those below it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The modules of the library from what everything stands on to what nothing stands on.
const ORDER: [&str; 22] = [
    "error",
    "files",
    "angle",
    "grid",
    "fourier",
    "photo",
    "capture",
    "radiance",
    "geometry",
    "light_field",
    "lighting",
    "brdf",
    "reflect",
    "recover",
    "simulate",
    "pipeline",
    "validate",
    "compare",
    "batch",
    "export",
    "report",
    "cli",
];

fn sources(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, files);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
}

/// The modules that a line of code names by `crate::`, also in braces; comments name freely.
fn named(code: &str) -> Vec<String> {
    let mut names = Vec::new();
    for (at, root) in code.match_indices("crate::") {
        let rest = &code[at + root.len()..];
        let group = match rest.strip_prefix('{') {
            Some(inner) => inner,
            None => rest,
        };
        let mut depth = 0;
        let mut word = String::new();
        let mut first = true;
        for c in group.chars() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    first = true;
                    continue;
                }
                _ => {}
            }
            let letter = c.is_ascii_lowercase() || c == '_';
            if first && letter {
                word.push(c);
            } else if !c.is_whitespace() || !word.is_empty() {
                names.extend((!word.is_empty()).then(|| std::mem::take(&mut word)));
                first = false;
                if !rest.starts_with('{') {
                    break;
                }
            }
        }
        names.extend((!word.is_empty()).then_some(word));
    }
    names
}

#[test]
fn names_are_read_off_code() {
    assert_eq!(named("use crate::angle::{LocalAngle, wrap};"), ["angle"]);
    assert_eq!(
        named("use crate::{Error, Result, grid::Grid, photo};"),
        ["grid", "photo"]
    );
    assert_eq!(
        named("let x = crate::fourier::f(crate::grid::g());"),
        ["fourier", "grid"]
    );
    assert_eq!(named("pub(crate) mod table;"), [""; 0]);
}

#[test]
fn no_module_uses_one_below_it() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&source, &mut files);
    assert!(files.len() > 50, "the source is found");
    let mut wrong = BTreeMap::new();
    let mut uses = 0;
    for file in &files {
        let relative = file.strip_prefix(&source).expect("inside");
        let module = relative
            .components()
            .next()
            .and_then(|c| Path::new(c.as_os_str()).file_stem())
            .map(|m| m.to_string_lossy().into_owned())
            .expect("a name");
        if ["lib", "main"].contains(&module.as_str()) {
            continue;
        }
        let place = |name: &str| ORDER.iter().position(|m| *m == name);
        let here = place(&module)
            .unwrap_or_else(|| panic!("{module} has no place in the order of this test"));
        let text = std::fs::read_to_string(file).expect("reads");
        let code: String = text
            .lines()
            .filter(|line| !line.trim_start().starts_with("//"))
            .flat_map(|line| [line, "\n"])
            .collect();
        for name in named(&code) {
            uses += 1;
            match place(&name) {
                Some(there) if there > here => {
                    wrong.insert(relative.display().to_string(), name);
                }
                Some(_) => {}
                None => panic!("{name}, used by {module}, has no place in the order of this test"),
            }
        }
    }
    assert!(uses > 200, "uses are found: {uses}");
    assert!(
        wrong.is_empty(),
        "file: what it uses from below: {wrong:#?}"
    );
}

/// The tour in `lib.rs` lists the modules, every one of them and no other.
#[test]
fn the_order_has_every_module() {
    let lib = include_str!("../src/lib.rs");
    let mut declared: Vec<&str> = lib
        .lines()
        .filter_map(|line| line.strip_prefix("pub mod "))
        .map(|name| name.trim_end_matches(';'))
        .collect();
    declared.push("cli");
    declared.sort_unstable();
    let mut ordered = ORDER.to_vec();
    ordered.sort_unstable();
    assert_eq!(declared, ordered);
}
