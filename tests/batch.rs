//! Fifty capture sets of which three are broken: 47 results, three failures that say why, exit code 1; stopped and
//! gone on with, the same to the bit.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A small noisy set under one sun; the seed and the sun's direction differ.
fn scene(k: usize) -> String {
    format!(
        "format = 1\nname = \"set {k}\"\nseed = {k}\nchannels = [\"Y\"]\n\
         [object]\nshape = \"cylinder\"\nradius = 0.05\n\
         [camera]\nprojection = \"perspective\"\nimage_size = [200, 12]\nfocal_px = 1000.0\ndistance = 0.6\n\
         [views]\ncount = 24\norbit_start_deg = 0.0\norbit_step_deg = 15.0\n\
         [brdf]\nmodel = \"phong\"\ndiffuse = 0.3\nspecular = 0.4\nexponent = 16\n\
         [lighting]\nsources = [{{ theta_deg = {}, irradiance = 3.0 }}]\nuniform = 0.04\n\
         [sensor]\nwhite_level = 4.0\nfull_well_e = 15000\nread_noise_e = 6\n",
        sun(k)
    )
}

/// Direction of set k's sun, degrees.
fn sun(k: usize) -> f64 {
    -90.0 + 3.7 * k as f64
}

const RECIPE: &str = "format = 1\nrecover = \"lighting\"\n[light_field]\nnormals = 180\nlocals = 90\n[brdf]\nmodel = \"phong\"\ndiffuse = 0.3\nspecular = 0.4\nexponent = 16\n";
const SETS: usize = 50;
/// Sets that are broken, and a word of what is said about each.
const BROKEN: [(usize, &str); 3] = [
    (7, "capture.toml"),
    (23, "views cannot be used"),
    (41, "`shape`"),
];

fn flatlight() -> Command {
    Command::new(env!("CARGO_BIN_EXE_flatlight"))
}

fn name(k: usize) -> String {
    format!("group {}/set {k:02}", k / 20)
}

/// The fifty sets, three of them broken in different ways.
fn make(root: &Path) {
    std::fs::write(root.join("recipe.toml"), RECIPE).expect("written");
    for k in 0..SETS {
        let scene_file = root.join("scene.toml");
        std::fs::write(&scene_file, scene(k)).expect("written");
        let set = root.join("sets").join(name(k));
        std::fs::create_dir_all(set.parent().expect("a group")).expect("a folder");
        let done = flatlight()
            .arg("simulate")
            .arg(&scene_file)
            .arg("--out")
            .arg(&set)
            .stdout(Stdio::null())
            .status()
            .expect("it starts");
        assert!(done.success());
    }
    let set = |k: usize| root.join("sets").join(name(k));
    // A description that a text editor spoilt, photos that the card did not hold to their end, and a set without any description.
    let whole = root.join("sets/seven");
    std::fs::rename(set(7), &whole).expect("moved");
    std::fs::remove_file(whole.join("capture.toml")).expect("it was there");
    for photo in std::fs::read_dir(set(23).join("views")).expect("photos") {
        let photo = photo.expect("an entry").path();
        let bytes = std::fs::read(&photo).expect("a photo");
        std::fs::write(&photo, &bytes[..bytes.len() / 2]).expect("written");
    }
    let description = set(41).join("capture.toml");
    let text = std::fs::read_to_string(&description).expect("a description");
    std::fs::write(&description, text.replace("shape =", "shap =")).expect("written");
}

fn batch(root: &Path, out: &Path, more: &[&str]) -> Command {
    let mut command = flatlight();
    command
        .arg("batch")
        .arg(root.join("sets"))
        .arg(root.join("recipe.toml"))
        .arg("--out")
        .arg(out)
        .args(more);
    command
}

/// Every file of every result but those that hold times, by name.
fn products(out: &Path, below: &Path, files: &mut BTreeMap<String, Vec<u8>>) {
    for entry in std::fs::read_dir(below).expect("a folder") {
        let path = entry.expect("an entry").path();
        let file = path
            .file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        let relative = path
            .strip_prefix(out)
            .expect("inside")
            .display()
            .to_string();
        // A killed run may leave its folder of unfinished files behind.
        if path.is_dir() && !file.starts_with(".flatlight-partial") {
            products(out, &path, files);
        } else if path.is_file()
            && (!["run.json", "summary.json", "provenance.json", "report.html"]
                .contains(&file.as_str())
                || relative == "report.html")
        {
            files.insert(relative, std::fs::read(&path).expect("it reads"));
        }
    }
}

fn all_products(out: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    products(out, out, &mut files);
    files
}

/// How many sets have a complete result.
fn finished(out: &Path) -> usize {
    (0..SETS)
        .filter(|k| out.join(name(*k)).join("provenance.json").exists())
        .count()
}

#[test]
fn three_broken_sets_of_fifty_do_not_stop_the_others_nor_does_a_kill() {
    let root = tempfile::tempdir().expect("a temporary folder");
    make(root.path());
    let out = root.path().join("results");
    let output = batch(root.path(), &out, &["--threads", "2"])
        .output()
        .expect("it starts");
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        said.contains("47 of 50 sets gave a result, 3 failed"),
        "{said}"
    );
    let why = String::from_utf8_lossy(&output.stderr);
    assert!(why.contains("3 of 50 sets failed"), "{why}");

    let table = std::fs::read_to_string(out.join("summary.csv")).expect("the table");
    let rows: Vec<&str> = table.lines().collect();
    assert_eq!(rows.len(), 1 + SETS);
    let column = |name: &str| {
        let found = rows[0].split(',').position(|c| c == name);
        found.unwrap_or_else(|| panic!("{name} in {}", rows[0]))
    };
    for k in 0..SETS {
        let broken = BROKEN.iter().find(|(b, _)| *b == k);
        let set = if k == 7 { "seven".into() } else { name(k) };
        let row = rows
            .iter()
            .find(|r| r.starts_with(&format!("{set},")))
            .unwrap_or_else(|| panic!("{set} has no row"));
        match broken {
            Some((_, word)) => {
                assert!(
                    row.starts_with(&format!("{set},failed,")) && row.contains(word),
                    "{row}"
                );
                assert!(!out.join(&set).join("lighting.csv").exists(), "{set}");
            }
            None => {
                let fields: Vec<&str> = row.split(',').collect();
                let number = |name: &str| -> f64 { fields[column(name)].parse().expect(name) };
                assert_eq!(fields[column("status")], "done", "{row}");
                // Five standard deviations: one chance in 40,000 over the 47 sets that a right result is further off.
                let (theta, sigma) = (number("source_deg"), number("source_sigma_deg"));
                assert!((theta - sun(k)).abs() < 5.0 * sigma && sigma < 0.1, "{row}");
                assert!(out.join(&set).join("report.html").exists());
            }
        }
    }
    let page = std::fs::read_to_string(out.join("report.html")).expect("the page");
    assert_eq!(page.matches("class=\"multiple\"").count(), 47);
    assert_eq!(page.matches("warning failure").count(), 3);
    assert!(page.len() < 3_000_000, "{} bytes", page.len());

    // Killed in the middle, again with other parallelism, and gone on with: the same files.
    let other = root.path().join("killed");
    let mut child = batch(root.path(), &other, &["--jobs", "3", "--quiet"])
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .expect("it starts");
    let start = Instant::now();
    while finished(&other) < 12 {
        assert!(
            start.elapsed() < Duration::from_secs(300),
            "twelve sets take minutes"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().expect("killed");
    child.wait().expect("gone");
    let before = finished(&other);
    assert!(before < 47, "it was killed in the middle: {before}");
    assert!(!other.join("summary.csv").exists());
    let output = batch(root.path(), &other, &["--jobs", "1"])
        .output()
        .expect("it starts");
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        said.contains(&format!("({before} of them from before)")),
        "{said}"
    );
    let (first, second) = (all_products(&out), all_products(&other));
    let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&first), names(&second));
    for (file, bytes) in &first {
        assert!(second[file] == *bytes, "{file} differs");
    }

    // Mended sets are done the next time, and only those.
    std::fs::remove_dir_all(root.path().join("sets/seven")).expect("removed");
    let description = root.path().join("sets").join(name(41)).join("capture.toml");
    let text = std::fs::read_to_string(&description).expect("a description");
    std::fs::write(&description, text.replace("shap =", "shape =")).expect("written");
    let output = batch(root.path(), &out, &[]).output().expect("it starts");
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        said.contains("48 of 49 sets gave a result (47 of them from before), 1 failed"),
        "{said}"
    );
}

#[test]
fn a_folder_without_sets_is_a_wrong_request() {
    let root = tempfile::tempdir().expect("a temporary folder");
    std::fs::create_dir(root.path().join("sets")).expect("a folder");
    std::fs::write(root.path().join("recipe.toml"), RECIPE).expect("written");
    let output = batch(root.path(), &root.path().join("out"), &[])
        .output()
        .expect("it starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(!root.path().join("out").exists());
}
