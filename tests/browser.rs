//! Every kind of report in a real Chromium: on a phone, on a wide screen, and on paper.
//!
//! Skipped with a message where there is no `chromium`, `chromium-browser` or `google-chrome`; with `FLATLIGHT_BROWSER=required` that
//! is a failure.

mod sets;

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use sets::*;

/// The largest page, bytes.
const LARGEST: u64 = 3_000_000;

const STUDY: &str = r#"
format = 1
seed = 7
[brdf.shiny]
model = "phong"
diffuse = 0.3
specular = 0.7
exponent = 32
[lighting.random-8]
random_order = 8
[[study]]
name = "l"
recover = "lighting"
brdf = ["shiny"]
lighting = ["random-8"]
noise = [0.003, 0.01]
views = [48]
locals = 30
draws = 6
default = {}
"#;

fn browser() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = ["chromium", "chromium-browser", "google-chrome"]
        .iter()
        .flat_map(|name| std::env::split_paths(&path).map(move |folder| folder.join(name)))
        .find(|file| file.is_file());
    if found.is_none() {
        let required = std::env::var_os("FLATLIGHT_BROWSER").is_some_and(|v| v == "required");
        assert!(!required, "no Chromium was found");
        eprintln!("skipped: no Chromium was found; install Debian's package chromium");
    }
    found
}

/// What Chromium says on stdout and stderr.
fn chromium(browser: &Path, profile: &Path, arguments: &[String]) -> (String, String) {
    let output = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-dev-shm-usage",
            // Pages may look at one another only here, and nothing leaves the machine.
            "--allow-file-access-from-files",
            "--host-resolver-rules=MAP * ~NOTFOUND",
            "--enable-logging=stderr",
            "--virtual-time-budget=6000",
        ])
        .arg(format!("--user-data-dir={}", profile.display()))
        .args(arguments)
        .output()
        .expect("Chromium starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&output.stdout), text(&output.stderr))
}

/// A page at one width: what the inspection sees, and that every drawing has ink in a screenshot.
fn inspect(browser: &Path, work: &Path, page: &Path, width: u32) {
    let name = format!("{} at {width} px", page.display());
    let inspection = root().join("tests/browser/inspect.html");
    let address = format!(
        "file://{}?width={width}&page=file://{}",
        inspection.display(),
        page.display()
    );
    let profile = work.join("profile");
    let (dom, log) = chromium(
        browser,
        &profile,
        &[
            "--window-size=1500,1000".into(),
            "--dump-dom".into(),
            address.clone(),
        ],
    );
    let console: Vec<&str> = log.lines().filter(|l| l.contains("CONSOLE")).collect();
    assert!(console.is_empty(), "{name}: {console:#?}");
    let seen = dom
        .split("data-seen=\"")
        .nth(1)
        .and_then(|rest| rest.split('"').next())
        .unwrap_or_else(|| panic!("{name}: the inspection did not end\n{log}"));
    let seen: Value = serde_json::from_slice(&percent_decoded(seen)).expect("JSON");
    assert_eq!(seen["faults"], serde_json::json!([]), "{name}");
    assert_eq!(seen["requests"], serde_json::json!([]), "{name}");
    let drawings = seen["drawings"].as_array().expect("drawings");
    assert!(!drawings.is_empty(), "{name}: nothing is drawn");

    let height = seen["height"].as_f64().expect("a height").ceil();
    // Chromium's textures end at 16384 pixels.
    let shown = height.min(16_000.0);
    let picture = work.join("screen.png");
    let (_, log) = chromium(
        browser,
        &profile,
        &[
            format!("--window-size={},{shown}", width.max(500)),
            format!("--screenshot={}", picture.display()),
            address,
        ],
    );
    let screen = image::open(&picture)
        .unwrap_or_else(|e| panic!("{name}: {e}\n{log}"))
        .to_rgb8();
    for drawing in drawings {
        let number = |key: &str| drawing[key].as_f64().expect("a number");
        let (x, y, w, h) = (number("x"), number("y"), number("width"), number("height"));
        if y + h > shown {
            continue;
        }
        // Ink is what is not the drawing's most frequent colour.
        let mut colours = std::collections::HashMap::new();
        for v in y as u32..((y + h) as u32).min(screen.height()) {
            for u in x.max(0.0) as u32..((x + w) as u32).min(screen.width()) {
                *colours.entry(screen.get_pixel(u, v).0).or_insert(0u32) += 1;
            }
        }
        let all: u32 = colours.values().sum();
        let most = colours.values().copied().max().unwrap_or(0);
        let ink = f64::from(all - most) / f64::from(all.max(1));
        // Axes and their labels alone are about 2 % of a plot.
        assert!(
            ink > 0.02 && colours.len() > 4,
            "{name}: {} has {:.1} % ink",
            drawing["name"],
            100.0 * ink
        );
    }
    // Of a run, not of a comparison, whose image of the same name knows no views.
    if let Some(cursor) = seen["cursor"]
        .as_str()
        .filter(|_| page.ends_with("report.html"))
    {
        for word in ["α", "θo′", "±", "view ", "pixel"] {
            assert!(cursor.contains(word), "{name}: {word} in {cursor}");
        }
    }
    println!(
        "{name}: {} drawings, {} read by pointer and keyboard, {} zoomed, {height} px high",
        drawings.len(),
        seen["readouts"],
        seen["zooms"]
    );
}

fn percent_decoded(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut k = 0;
    while k < bytes.len() {
        let code = text.get(k + 1..k + 3).filter(|_| bytes[k] == b'%');
        match code.and_then(|c| u8::from_str_radix(c, 16).ok()) {
            Some(byte) => {
                out.push(byte);
                k += 3;
            }
            None => {
                out.push(bytes[k]);
                k += 1;
            }
        }
    }
    out
}

fn flatlight(folder: &Path, arguments: &[&str], code: i32) {
    let output = Command::new(env!("CARGO_BIN_EXE_flatlight"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("it starts");
    let why = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {why}");
}

/// Reports of every kind in one folder.
fn pages(work: &Path) -> Vec<PathBuf> {
    for name in ["pipelines", "testdata"] {
        std::os::unix::fs::symlink(root().join(name), work.join(name)).expect("a link");
    }
    let run = |recipe: &str, set: &str, out: &str| {
        let (recipe, set) = (
            format!("pipelines/{recipe}.toml"),
            format!("testdata/{set}"),
        );
        flatlight(work, &["run", &recipe, "--capture", &set, "--out", out], 0);
    };
    run("light-field", "ggx-sphere", "none");
    run("lighting", "phong32-two-suns", "lighting");
    run("brdf", "phong32-sun", "brdf");
    run("both", "ggx02-two-suns", "both");
    std::fs::write(work.join("study.toml"), STUDY).expect("written");
    flatlight(work, &["validate", "study.toml", "--out", "validation"], 0);
    flatlight(work, &["paper", "--out", "paper"], 0);
    let truth = "testdata/phong32-two-suns/truth/lighting.csv";
    let compared = [
        "compare",
        "lighting/lighting.csv",
        truth,
        "--report",
        "compare.html",
        "--tolerance",
        "1000",
    ];
    flatlight(work, &compared, 0);
    flatlight(
        work,
        &["compare", "brdf", "brdf", "--report", "same.html"],
        0,
    );
    // Two sets, one of them without photographs.
    let sets = work.join("sets");
    std::fs::create_dir_all(sets.join("broken")).expect("a folder");
    for set in ["phong32-sun", "phong32-two-suns"] {
        std::os::unix::fs::symlink(root().join("testdata").join(set), sets.join(set))
            .expect("a link");
    }
    let batch = [
        "batch",
        "sets",
        "pipelines/lighting.toml",
        "--out",
        "batch",
        "--jobs",
        "1",
    ];
    flatlight(work, &batch, 1);
    [
        "none/report.html",
        "lighting/report.html",
        "brdf/report.html",
        "both/report.html",
        "validation/report.html",
        "paper/paper.html",
        "compare.html",
        "same.html",
        "batch/report.html",
    ]
    .map(|name| work.join(name))
    .to_vec()
}

#[test]
fn every_report_is_right_on_a_phone_a_screen_and_paper() {
    let Some(browser) = browser() else { return };
    let work = tempfile::tempdir().expect("a temporary folder");
    for page in pages(work.path()) {
        let size = page.metadata().expect("the page is there").len();
        assert!(size < LARGEST, "{}: {size} bytes", page.display());
        for width in [380, 1400] {
            inspect(&browser, work.path(), &page, width);
        }
        let paper = work.path().join("page.pdf");
        let print = [
            format!("--print-to-pdf={}", paper.display()),
            "--no-pdf-header-footer".into(),
            format!("file://{}", page.display()),
        ];
        let (_, log) = chromium(&browser, &work.path().join("profile"), &print);
        let console: Vec<&str> = log.lines().filter(|l| l.contains("CONSOLE")).collect();
        assert!(console.is_empty(), "{}: {console:#?}", page.display());
        let pdf = std::fs::read(&paper).expect("the print");
        assert!(
            pdf.starts_with(b"%PDF") && pdf.len() > 20_000,
            "{} bytes",
            pdf.len()
        );
        std::fs::remove_file(&paper).expect("removed");
    }
}
