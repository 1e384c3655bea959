//! Recipes: what is asked for, what is stated as known, and whether it fits the photos.

use crate::Case;

/// A recipe that is this text, on the sound set.
fn recipe(what: &'static str, text: &'static str, words: &[&str]) -> Case {
    Case::new(what, move |b| b.write("recipe.toml", text), words)
}

/// The lighting from a BRDF that is this.
fn surface(what: &'static str, keys: &'static str, words: &[&str]) -> Case {
    let spoil = move |b: &crate::bench::Bench| {
        b.write(
            "recipe.toml",
            format!("format = 1\nrecover = \"lighting\"\n[brdf]\n{keys}\n"),
        );
    };
    Case::new(what, spoil, words)
}

/// The BRDF from light that is this.
fn light(what: &'static str, keys: &'static str, words: &[&str]) -> Case {
    let spoil = move |b: &crate::bench::Bench| {
        b.write(
            "recipe.toml",
            format!("format = 1\nrecover = \"brdf\"\n[lighting]\n{keys}\n"),
        );
    };
    Case::new(what, spoil, words)
}

/// A sound recipe and this beside it.
fn beside(what: &'static str, text: &'static str, words: &[&str]) -> Case {
    let spoil = move |b: &crate::bench::Bench| {
        let sound =
            "format = 1\nrecover = \"lighting\"\nbrdf = { model = \"lambertian\", albedo = 0.5 }\n";
        b.write("recipe.toml", format!("{sound}{text}\n"));
    };
    Case::new(what, spoil, words)
}

pub(crate) fn cases() -> Vec<Case> {
    vec![
        recipe(
            "recipe empty",
            "",
            &["recipe.toml", "recover: expected this key, found nothing"],
        ),
        recipe(
            "recipe of no format that is known",
            "format = 7\nrecover = \"none\"",
            &["recipe.toml:1, format: expected 1, found 7"],
        ),
        recipe(
            "recover misspelt",
            "recover = \"lightning\"",
            &[
                "recipe.toml:1, recover",
                "\"lightning\"",
                "Did you mean \"lighting\"?",
            ],
        ),
        recipe(
            "recover a number",
            "recover = 3",
            &["recover", "the number 3"],
        ),
        recipe(
            "recipe not closed",
            "recover = \"none",
            &["recipe.toml:1", "not valid TOML", "1 | recover"],
        ),
        Case::new(
            "recipe of bytes",
            |b| b.write("recipe.toml", [0xff, 0xfe]),
            &["recipe.toml", "UTF-8"],
        ),
        Case::new(
            "recipe missing",
            |b| std::fs::remove_file(b.at("recipe.toml")).expect("removes"),
            &["recipe.toml", "pipelines/"],
        ),
        Case::new(
            "recipe a folder",
            |b| {
                std::fs::remove_file(b.at("recipe.toml")).expect("removes");
                std::fs::create_dir(b.at("recipe.toml")).expect("a folder");
            },
            &["recipe.toml", "expected a file"],
        ),
        Case::new(
            "recipe that is a capture",
            |b| {
                b.write(
                    "recipe.toml",
                    std::fs::read(b.at("capture.toml")).expect("reads"),
                )
            },
            &["recipe.toml", "object: unknown key"],
        ),
        recipe(
            "lighting without a BRDF",
            "recover = \"lighting\"",
            &["brdf: expected this key", "known BRDF"],
        ),
        recipe(
            "BRDF without light",
            "recover = \"brdf\"",
            &["lighting: expected this key"],
        ),
        recipe(
            "scale where nothing is free",
            "recover = \"none\"\n[scale]\nalbedo = 0.5",
            &["scale", "both"],
        ),
        surface(
            "BRDF empty",
            "",
            &["recipe.toml:3", "brdf", "`model` or `table`"],
        ),
        surface(
            "model misspelt",
            "model = \"fong\"",
            &[
                "recipe.toml:4, brdf.model",
                "\"fong\"",
                "Did you mean \"phong\"?",
                "4 | model = \"fong\"",
            ],
        ),
        surface(
            "model a number",
            "model = 3",
            &["recipe.toml:4, brdf.model"],
        ),
        surface(
            "model's key misspelt",
            "model = \"phong\"\ndifuse = 0.3\nspecular = 0.1\nexponent = 8",
            &[
                "recipe.toml:5, brdf.difuse: unknown key",
                "Did you mean `diffuse`?",
                "5 | difuse",
            ],
        ),
        surface(
            "model's key missing",
            "model = \"phong\"\ndiffuse = 0.3\nspecular = 0.1",
            &["recipe.toml:3", "exponent", "missing"],
        ),
        surface(
            "model's value below 0",
            "model = \"phong\"\ndiffuse = -3\nspecular = 0.1\nexponent = 8",
            &[
                "recipe.toml:5, brdf.diffuse: expected a value of at least 0, found -3",
                "5 | diffuse = -3",
            ],
        ),
        surface(
            "model's value absurd",
            "model = \"phong\"\ndiffuse = 0.3\nspecular = 0.1\nexponent = 1e300",
            &["brdf.exponent: expected a value in 0 to 1000000, found 1e300"],
        ),
        surface(
            "model's value not a number",
            "model = \"lambertian\"\nalbedo = nan",
            &["brdf.albedo"],
        ),
        surface(
            "model's value a text",
            "model = \"lambertian\"\nalbedo = \"grey\"",
            &["recipe.toml:5, brdf.albedo", "grey"],
        ),
        surface(
            "model's values for two channels of three",
            "model = \"lambertian\"\nalbedo = [0.1, 0.2]",
            &[
                "recipe.toml",
                "brdf.albedo",
                "3 channels (R, G, B), found 2 values",
            ],
        ),
        surface(
            "surface that reflects nothing",
            "model = \"lambertian\"\nalbedo = 0",
            &["brdf", "reflects no light"],
        ),
        surface(
            "index of refraction 0",
            "model = \"ggx-dielectric\"\ndiffuse = 0.2\nalpha = 0.1\nior = 0",
            &["brdf.ior"],
        ),
        surface(
            "table missing",
            "table = \"brdf.csv\"",
            &["brdf.csv", "cannot read it"],
        ),
        surface(
            "table and model",
            "table = \"brdf.csv\"\nmodel = \"phong\"",
            &["brdf.model"],
        ),
        surface("table without a name", "table = \"\"", &["brdf.table"]),
        light(
            "light empty",
            "",
            &[
                "recipe.toml:3",
                "lighting",
                "sources, uniform, table, environment",
            ],
        ),
        light(
            "light below 0",
            "uniform = -1",
            &[
                "recipe.toml:4, lighting.uniform",
                "0 or more, found -1",
                "4 | uniform = -1",
            ],
        ),
        light(
            "no light",
            "uniform = 0",
            &["lighting is dark in channel R"],
        ),
        light(
            "light's key misspelt",
            "unifrom = 1",
            &["recipe.toml:4, lighting.unifrom", "Did you mean uniform?"],
        ),
        light(
            "light's heading of 40 digits",
            "environment = \"sky.exr\"\nheading_deg = 3088888888888888888888888888888888888888",
            &["recipe.toml:5: this value cannot be read", "overflow"],
        ),
        light(
            "light for two channels of three",
            "uniform = [1, 2]",
            &["lighting.uniform", "3 channels", "found 2"],
        ),
        light(
            "source without a direction",
            "sources = [{ irradiance = 1 }]",
            &["recipe.toml:4, lighting.sources[0].theta_deg", "found none"],
        ),
        light(
            "source by a name",
            "sources = [{ theta_deg = \"left\", irradiance = 1 }]",
            &["lighting.sources[0].theta_deg", "left"],
        ),
        light(
            "source without end",
            "sources = [{ theta_deg = 1, irradiance = inf }]",
            &["lighting.sources[0].irradiance", "finite"],
        ),
        light(
            "environment missing",
            "environment = \"sky.exr\"",
            &["sky.exr", "cannot read it"],
        ),
        light(
            "environment's plane without an environment",
            "uniform = 1\nheading_deg = 3",
            &["recipe.toml:5, lighting.heading_deg", "environment"],
        ),
        light(
            "environment for a surface that is not known",
            "environment = \"sky.exr\"\nenvironment_serves = \"glass\"",
            &["lighting.environment_serves", "lambertian", "glass"],
        ),
        beside(
            "bins beyond all",
            "[light_field]\nnormals = 1000000000",
            &["recipe.toml:5, light_field.normals: expected 8 to 7200, found 1000000000"],
        ),
        beside(
            "bins a fraction",
            "[light_field]\nlocals = 1.5",
            &["light_field.locals", "whole number"],
        ),
        beside(
            "limb cut beyond the limb",
            "[light_field]\nlimb_cut_deg = 120",
            &["light_field.limb_cut_deg", "10 to 90"],
        ),
        beside(
            "rows below 1",
            "[light_field]\nrows = 0",
            &["light_field.rows", "from 1"],
        ),
        beside(
            "band below 0",
            "[recovery]\nband = -3",
            &["recovery.band", "0 to 1000, found -3"],
        ),
        beside(
            "band beyond all",
            "[recovery]\nband = 1e9",
            &["recovery.band", "0 to 1000"],
        ),
        beside(
            "regularisation unknown",
            "[recovery]\nregularisation = \"tikonov\"",
            &["recovery.regularisation", "evidence"],
        ),
        beside(
            "confidence of certainty",
            "[recovery]\nconfidence = 1",
            &["recovery.confidence", "0.5 to 0.9999"],
        ),
        beside(
            "truth a text",
            "[recovery]\nnon_negative = \"yes\"",
            &["recovery.non_negative", "true or false"],
        ),
        beside(
            "key misspelt",
            "[recovery]\nnon_negatve = true",
            &["recipe.toml:5, recovery.non_negatve", "`non_negative`"],
        ),
        beside(
            "table misspelt",
            "[recovry]\nband = 3",
            &["recovry: unknown key; did you mean `recovery`?"],
        ),
        beside(
            "many faults at once",
            "[recovery]\nband = -3\nconfidence = 7\n[light_field]\nrows = 0",
            &["recovery.band", "recovery.confidence", "light_field.rows"],
        ),
    ]
}
