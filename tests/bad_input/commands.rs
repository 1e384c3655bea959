//! The other commands, and the folders that products go to.

use crate::bench::Bench;
use crate::{Ask, Case};

fn ask(
    what: &'static str,
    arguments: &'static [&'static str],
    spoil: fn(&Bench),
    words: &[&str],
) -> Case {
    Case::new(what, spoil, words).asks(Ask::Other(arguments))
}

const SIMULATE: &str = "format = 1\nseed = 1\n[object]\nshape = \"cylinder\"\nradius = 0.05\n[camera]\nimage_size = [96, 16]\nfocal_px = 480\ndistance = 0.6\n[views]\ncount = 12\norbit_step_deg = 30\n[brdf]\nmodel = \"lambertian\"\nalbedo = 0.5\n[lighting]\nuniform = 1\n";

/// A recipe of `simulate` with one text replaced by another.
fn simulated(what: &'static str, from: &'static str, to: &'static str, words: &[&str]) -> Case {
    let spoil = move |b: &Bench| b.write("simulate.toml", SIMULATE.replacen(from, to, 1));
    Case::new(format!("simulate: {what}"), spoil, words).asks(Ask::Other(&[
        "simulate",
        "SET/simulate.toml",
        "--out",
        "OUT",
    ]))
}

/// A recipe of `validate` that is this text.
fn validated(what: &'static str, text: &'static str, words: &[&str]) -> Case {
    let spoil = move |b: &Bench| b.write("validate.toml", text);
    Case::new(format!("validate: {what}"), spoil, words).asks(Ask::Other(&[
        "validate",
        "SET/validate.toml",
        "--out",
        "OUT",
    ]))
}

pub(crate) fn cases() -> Vec<Case> {
    const RUN: &[&str] = &["run", "SET/recipe.toml", "--capture", "SET", "--out", "OUT"];
    vec![
        ask(
            "a folder that holds something else",
            RUN,
            |b| {
                std::fs::create_dir(b.out()).expect("a folder");
                std::fs::write(b.out().join("thesis.txt"), "years of work").expect("writes");
            },
            &["out", "not from this run", "--force"],
        ),
        ask(
            "a file in the place of the folder",
            RUN,
            |b| std::fs::write(b.out(), "").expect("writes"),
            &["out", "expected a folder"],
        ),
        ask(
            "a folder under a file",
            &[
                "run",
                "SET/recipe.toml",
                "--capture",
                "SET",
                "--out",
                "SET/capture.toml/out",
            ],
            |_| {},
            &["capture.toml/out"],
        ),
        ask(
            "products into the capture's folder",
            &["run", "SET/recipe.toml", "--capture", "SET", "--out", "SET"],
            |_| {},
            &["set", "--out"],
        ),
        ask(
            "check of nothing",
            &["check", "SET/nowhere"],
            |_| {},
            &["nowhere"],
        ),
        ask(
            "init of a folder without photos",
            &["init", "OUT"],
            |b| std::fs::create_dir(b.out()).expect("a folder"),
            &["out", "photo"],
        ),
        ask(
            "init of a file",
            &["init", "SET/capture.toml"],
            |_| {},
            &["capture.toml"],
        ),
        ask(
            "init over a description",
            &["init", "SET"],
            |_| {},
            &["capture.toml"],
        ),
        ask(
            "report of nothing",
            &["report", "SET"],
            |_| {},
            &["run.json", "flatlight run"],
        ),
        ask(
            "report of a run that is text",
            &["report", "SET"],
            |b| b.write("run.json", "text"),
            &["run.json"],
        ),
        ask(
            "compare of nothing",
            &["compare", "SET/a.csv", "SET/b.csv"],
            |_| {},
            &["a.csv"],
        ),
        ask(
            "compare of what is no product",
            &["compare", "SET/recipe.toml", "SET/recipe.toml"],
            |_| {},
            &["recipe.toml", "lighting.csv"],
        ),
        ask(
            "compare of two kinds",
            &["compare", "SET/a.csv", "SET/b.csv"],
            |b| {
                b.write("a.csv", "theta_deg,L_Y\n-180,1\n0,1\n");
                b.write("b.csv", "channel,p,re,im\nY,0,1,0\n");
            },
            &["lighting", "spectrum"],
        ),
        ask(
            "prefilter of nothing",
            &[
                "prefilter",
                "SET/sky.exr",
                "--brdf",
                "SET/recipe.toml",
                "--out",
                "OUT.exr",
            ],
            |_| {},
            &["sky.exr"],
        ),
        ask(
            "probe of a cylinder",
            &["probe", "SET"],
            |_| {},
            &["sphere"],
        ),
        ask(
            "no thread",
            &["check", "SET", "--threads", "0"],
            |_| {},
            &["threads"],
        ),
        simulated("nothing of it", SIMULATE, "", &["simulate.toml", "object"]),
        simulated(
            "a thousand million views",
            "count = 12",
            "count = 1000000000",
            &["simulate.toml:11, views.count", "1000000000"],
        ),
        simulated(
            "light of 40 digits",
            "uniform = 1",
            "uniform = 3088888888888888888888888888888888888888",
            &["simulate.toml:", "this value cannot be read", "overflow"],
        ),
        simulated(
            "no view",
            "count = 12",
            "count = 0",
            &["views.count", "found 0"],
        ),
        simulated(
            "a picture beyond all sizes",
            "[96, 16]",
            "[1000000, 1000000]",
            &["camera.image_size", "1000000"],
        ),
        simulated(
            "a key misspelt",
            "seed = 1",
            "sed = 1",
            &["simulate.toml:2, sed", "`seed`"],
        ),
        simulated(
            "a camera inside the object",
            "distance = 0.6",
            "distance = 0.01",
            &["object.radius", "camera's distance of 0.01 m"],
        ),
        simulated(
            "a surface that is not known",
            "\"lambertian\"",
            "\"lambert\"",
            &["brdf.model", "lambertian"],
        ),
        simulated(
            "noise of a sensor that is not known",
            "[brdf]",
            "[sensor]\nformat = \"gif\"\n[brdf]",
            &["sensor.format", "gif"],
        ),
        validated("nothing of it", "", &["validate.toml"]),
        validated("text", "studies = yes", &["validate.toml:1"]),
        validated(
            "a key misspelt",
            "format = 1\nsed = 1",
            &["validate.toml:2", "sed"],
        ),
    ]
}
