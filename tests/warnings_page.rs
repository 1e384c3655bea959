//! The page of warnings says the thresholds that the program has.

use std::path::Path;

const PAGE: &str = include_str!("../docs/warnings.md");

/// File, name and value of every constant that the page gives; a value is a number or a pair of them.
fn stated() -> Vec<(String, String, String)> {
    PAGE.lines()
        .filter_map(|line| {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            let value = cells.get(2)?;
            numbers(value)?;
            let mut quoted = cells.get(3)?.split('`').skip(1).step_by(2);
            let (file, name) = (quoted.next()?.into(), quoted.next()?.into());
            Some((file, name, value.to_string()))
        })
        .collect()
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    let inner = text.trim_start_matches('(').trim_end_matches(')');
    inner.split(',').map(|n| n.trim().parse().ok()).collect()
}

#[test]
fn every_threshold_is_that_of_the_source() {
    let stated = stated();
    assert!(stated.len() >= 40, "{} rows", stated.len());
    for (file, name, value) in stated {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(&file);
        let source = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{file}: {e}"));
        let start = format!("const {name}: ");
        let line = source
            .lines()
            .find(|line| line.contains(&start))
            .unwrap_or_else(|| panic!("{file} has no {name}"));
        let found = line.split('=').nth(1).expect("a value").trim();
        let found = numbers(found.trim_end_matches(';')).expect("numbers");
        assert_eq!(Some(found), numbers(&value), "{name} in {file}");
    }
}

/// Where a warning is given or a result is judged, a number that decides has a name.
#[test]
fn no_threshold_is_a_bare_number() {
    for (file, source) in [
        ("explain.rs", include_str!("../src/pipeline/explain.rs")),
        ("fit.rs", include_str!("../src/pipeline/fit.rs")),
        ("execute.rs", include_str!("../src/pipeline/execute.rs")),
        ("usable.rs", include_str!("../src/pipeline/usable.rs")),
        ("scenery.rs", include_str!("../src/pipeline/scenery.rs")),
        (
            "warnings.rs",
            include_str!("../src/recover/factorise/warnings.rs"),
        ),
        ("brdf/mod.rs", include_str!("../src/recover/brdf/mod.rs")),
        ("model.rs", include_str!("../src/brdf/model.rs")),
    ] {
        let code = source.split("#[cfg(test)]").next().expect("the code");
        for line in code.lines().filter(|l| !l.trim_start().starts_with("//")) {
            for sign in ["> ", ">= ", "< ", "<= "] {
                for rest in line.split(&format!(" {sign}")).skip(1) {
                    let number: String = rest
                        .chars()
                        .take_while(|c| c.is_ascii_digit() || ".-_e".contains(*c))
                        .collect();
                    let bare = number.contains('.') && !["0.0", "1.0"].contains(&number.as_str());
                    assert!(!bare, "{file}: {line}");
                }
            }
        }
    }
}

/// Every constant by which a result is judged stands on the page.
#[test]
fn no_threshold_of_the_verdict_is_missing() {
    let source = include_str!("../src/pipeline/fit.rs");
    for line in source.lines().filter(|line| line.starts_with("pub const ")) {
        let name = line["pub const ".len()..]
            .split(':')
            .next()
            .expect("a name");
        assert!(
            PAGE.contains(&format!("`{name}`")),
            "{name} is not on the page"
        );
    }
}
