//! Every recipe that is shipped can be run as it is, on a committed set, and leaves what it is for.

mod sets;

use std::collections::BTreeSet;

use flatlight::pipeline::Recipe;
use sets::*;

/// A recipe, the set it is run on, and the products that it is for.
const RECIPES: [(&str, &str, &[&str]); 4] = [
    (
        "lighting.toml",
        "phong32-two-suns",
        &[
            "lighting.csv",
            "lighting_spectrum.csv",
            "lighting.exr",
            "residual.exr",
        ],
    ),
    (
        "brdf.toml",
        "phong32-sun",
        &[
            "brdf.csv",
            "brdf_spectrum.csv",
            "brdf.exr",
            "brdf_models.json",
            "residual.exr",
        ],
    ),
    (
        "both.toml",
        "ggx02-two-suns",
        &[
            "lighting.csv",
            "lighting_spectrum.csv",
            "lighting.exr",
            "brdf.csv",
            "brdf_spectrum.csv",
            "brdf.exr",
            "brdf_models.json",
            "residual.exr",
        ],
    ),
    ("light-field.toml", "ggx02-two-suns", &["light_field.exr"]),
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
        .collect()
}

#[test]
fn every_recipe_is_run_here() {
    let tested: BTreeSet<String> = RECIPES.iter().map(|r| r.0.to_string()).collect();
    assert_eq!(tested, shipped());
}

#[test]
fn every_recipe_does_what_it_is_for() {
    for (recipe, name, products) in RECIPES {
        let out = tempfile::tempdir().expect("a temporary folder");
        assert_cmd::Command::new(env!("CARGO_BIN_EXE_flatlight"))
            .current_dir(root())
            .args(["run", &format!("pipelines/{recipe}"), "--strict"])
            .args(["--capture", &format!("testdata/{name}"), "--out"])
            .arg(out.path())
            .assert()
            .code(0);
        for product in products.iter().chain(&["report.html", "summary.json"]) {
            assert!(out.path().join(product).exists(), "{recipe}: {product}");
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
