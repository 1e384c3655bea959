//! Every recipe that is shipped can be run as it is, on a committed set, and leaves what it is for.

mod sets;

use std::collections::BTreeSet;

use flatlight::pipeline::Recipe;
use sets::*;

const LIGHTING: [&str; 3] = ["lighting.csv", "lighting_spectrum.csv", "lighting.exr"];
const BRDF: [&str; 4] = [
    "brdf.csv",
    "brdf_spectrum.csv",
    "brdf.exr",
    "brdf_models.json",
];

const ALL: [&str; 10] = [
    "report.html",
    "summary.json",
    "light_field.exr",
    "lighting.csv",
    "lighting_spectrum.csv",
    "lighting.exr",
    "brdf.csv",
    "brdf_spectrum.csv",
    "brdf.exr",
    "brdf_models.json",
];

/// A recipe, the set that its comments name, and the products that it is for.
const RECIPES: [(&str, &str, &[&[&str]]); 4] = [
    ("light-field.toml", "ggx02-two-suns", &[]),
    ("lighting.toml", "phong32-two-suns", &[&LIGHTING]),
    ("brdf.toml", "phong32-sun", &[&BRDF]),
    ("both.toml", "ggx02-two-suns", &[&LIGHTING, &BRDF]),
];

fn shipped() -> BTreeSet<String> {
    std::fs::read_dir(root().join("pipelines"))
        .expect("the recipes are there")
        .map(|entry| {
            entry
                .expect("an entry")
                .file_name()
                .to_string_lossy()
                .into()
        })
        // These two are for commands of their own, whose tests run them.
        .filter(|name: &String| name != "simulate.toml" && name != "validate.toml")
        .collect()
}

#[test]
fn every_recipe_is_run_here() {
    let tested: BTreeSet<String> = RECIPES.iter().map(|r| r.0.to_string()).collect();
    assert_eq!(tested, shipped());
}

#[test]
fn every_recipe_does_what_it_is_for() {
    for (recipe, name, groups) in RECIPES {
        let path = format!("pipelines/{recipe}");
        let set = format!("testdata/{name}");
        let text = std::fs::read_to_string(root().join(&path)).expect("reads");
        let command = format!("flatlight run {path} --capture {set} --out out/");
        assert!(
            text.contains(&command),
            "{path} says how it is run: {command}"
        );
        let out = tempfile::tempdir().expect("a temporary folder");
        assert_cmd::Command::new(env!("CARGO_BIN_EXE_flatlight"))
            .current_dir(root())
            .args(["run", &path, "--capture", &set, "--out"])
            .arg(out.path())
            .assert()
            .code(0);
        let always = ["report.html", "summary.json", "light_field.exr"];
        let expected: Vec<&str> = groups
            .iter()
            .copied()
            .flatten()
            .chain(&always)
            .copied()
            .collect();
        for product in ALL {
            let there = out.path().join(product).exists();
            assert_eq!(there, expected.contains(&product), "{recipe}: {product}");
        }
    }
}

/// What a recipe writes out in full are the program's defaults: leaving them out changes nothing.
#[test]
fn what_is_written_out_is_the_default() {
    for name in shipped() {
        let path = root().join("pipelines").join(&name);
        let full = Recipe::read(&path).unwrap_or_else(|e| panic!("{e}"));
        let text = std::fs::read_to_string(&path).expect("reads");
        let mut bare: toml::Table = text.parse().expect("TOML");
        bare.retain(|key, _| key != "light_field" && key != "recovery");
        let bare =
            Recipe::parse(&bare.to_string(), &path, root()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(full.to_toml(), bare.to_toml(), "{name}");
    }
}
