//! `flatlight paper`: every equation recomputed on one page.

use std::process::Command;

#[test]
fn the_page_has_every_equation_and_all_pass() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("paper");
    let run = Command::new(env!("CARGO_BIN_EXE_flatlight"))
        .args(["paper", "--out"])
        .arg(&out)
        .output()
        .unwrap();
    let stdout = String::from_utf8(run.stdout).unwrap();
    assert_eq!(run.status.code(), Some(0), "{stdout}");

    let csv = std::fs::read_to_string(out.join("paper.csv")).unwrap();
    let mut lines = csv.lines();
    assert_eq!(
        lines.next(),
        Some("equation,claim,closed_form,ours,difference,tolerance,passed,note")
    );
    let mut seen = [false; 34];
    let mut checks = 0;
    for line in lines {
        checks += 1;
        assert!(line.contains(",true,"), "{line}");
        let name = line.split(',').next().unwrap();
        let ends: Vec<usize> = name.split('–').filter_map(|n| n.parse().ok()).collect();
        if let (Some(first), Some(last)) = (ends.first(), ends.last()) {
            (*first..=*last).for_each(|n| seen[n] = true);
        }
    }
    assert!(seen[1..].iter().all(|s| *s), "{seen:?}");
    assert!(csv.contains("\nfigure 3,"));
    let sentence = format!("{checks} of {checks} checks pass, recomputed in ");
    let (_, seconds) = stdout.split_once(&sentence).expect("a summary");
    let seconds: f64 = seconds.split(' ').next().unwrap().parse().unwrap();
    assert!(seconds < 10.0, "{seconds} s");

    let html = std::fs::read_to_string(out.join("paper.html")).unwrap();
    // One page that needs nothing else; the only addresses in it are names of XML languages.
    for reference in [
        "src=\"http",
        "href=\"http",
        "url(http",
        "url(\"http",
        "@import",
        "<link rel=\"style",
    ] {
        assert!(!html.contains(reference), "{reference}");
    }
    assert!(html.matches("<math").count() >= 32);
    for id in [
        "figure-3",
        "product-integral",
        "lambertian",
        "phong-fall-off",
        "microfacet",
        "spectra",
        "invisible",
        "directional",
        "order-sqrt-beta",
        "factorisation",
        "other-row",
        "lambertian-terms",
    ] {
        assert!(html.contains(&format!("<figure id=\"{id}\"")), "{id}");
    }
    assert_eq!(html.matches("Misprint in").count(), 2);
    assert!(!html.contains("FAIL") && !html.contains("NaN"));
}
