//! The page of warnings says the thresholds that the program has.

use std::path::Path;

const PAGE: &str = include_str!("../docs/warnings.md");

/// File, name and value of every constant that the page gives.
fn stated() -> Vec<(String, String, f64)> {
    PAGE.lines()
        .filter_map(|line| {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            let value: f64 = cells.get(2)?.parse().ok()?;
            let mut quoted = cells.get(3)?.split('`').skip(1).step_by(2);
            Some((quoted.next()?.into(), quoted.next()?.into(), value))
        })
        .collect()
}

#[test]
fn every_threshold_is_that_of_the_source() {
    let stated = stated();
    assert!(stated.len() >= 18, "{} rows", stated.len());
    for (file, name, value) in stated {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(&file);
        let source = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{file}: {e}"));
        let start = format!("const {name}: ");
        let line = source
            .lines()
            .find(|line| line.contains(&start))
            .unwrap_or_else(|| panic!("{file} has no {name}"));
        let found = line.split('=').nth(1).expect("a value").trim();
        let found: f64 = found.trim_end_matches(';').parse().expect("a number");
        assert_eq!(found, value, "{name} in {file}");
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
