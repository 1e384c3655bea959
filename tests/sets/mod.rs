//! The committed photo sets: where they are, what is true of them, and how to run them.

#![allow(dead_code, reason = "each test file uses its own part of this module")]

pub mod derived;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use exr::prelude::{AnyChannels, FlatSamples, Layer, read_first_flat_layer_from_file};
use flatlight::capture::Capture;
use flatlight::fourier::{CircleTransform, Series};
use flatlight::lighting::read_table;
use flatlight::pipeline::{Recipe, Run, Silent, execute};
use flatlight::recover::lighting::LightingEstimate;
use num_complex::Complex64;

/// The folder of a committed set.
pub fn set(name: &str) -> PathBuf {
    root().join("testdata").join(name)
}

/// The folder of the project.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The recipe of a committed set.
pub fn recipe(name: &str) -> Recipe {
    Recipe::read(&set(name).join("recipe.toml")).unwrap_or_else(|e| panic!("{e}"))
}

/// The description of a set in any folder.
pub fn capture(folder: &Path) -> Capture {
    Capture::read(folder).unwrap_or_else(|e| panic!("{e}"))
}

/// Photos to results, in memory.
pub fn run(recipe: &Recipe, folder: &Path) -> Run {
    execute(recipe, &capture(folder), &Silent).unwrap_or_else(|e| panic!("{e}"))
}

/// Planes of the first part of an EXR file by channel name, with its size and header.
pub struct Image {
    pub size: [usize; 2],
    pub planes: BTreeMap<String, Vec<f32>>,
    pub layer: Layer<AnyChannels<FlatSamples>>,
}

/// Reads an EXR file with the exr crate alone, nothing of ours.
pub fn image(path: &Path) -> Image {
    let image =
        read_first_flat_layer_from_file(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let layer = image.layer_data;
    let planes = layer
        .channel_data
        .list
        .iter()
        .map(|c| {
            let values: Vec<f32> = c.sample_data.values_as_f32().collect();
            (c.name.to_string(), values)
        })
        .collect();
    Image {
        size: [layer.size.0, layer.size.1],
        planes,
        layer,
    }
}

/// L_p of the whole light, sources included, p = 0…60, per channel: `truth/lighting_spectrum.csv`.
pub fn true_spectrum(name: &str, channel: &str) -> Series {
    spectrum_in(&set(name), channel)
}

/// The same of a set in any folder.
pub fn spectrum_in(folder: &Path, channel: &str) -> Series {
    let file = folder.join("truth/lighting_spectrum.csv");
    let text = std::fs::read_to_string(&file).expect("the truth is there");
    let coefficients: Vec<Complex64> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect::<Vec<_>>())
        .filter(|fields| fields[0] == channel)
        .map(|fields| {
            let number = |k: usize| -> f64 { fields[k].parse().expect("a number") };
            Complex64::new(number(2), number(3))
        })
        .collect();
    let place = folder.display();
    assert_eq!(coefficients.len(), 61, "{place}: p = 0…60 of {channel}");
    Series { coefficients }
}

/// L(θ) every 0.5° from −180°, without the sources: `truth/lighting.csv`, \[channel\]\[720\].
pub fn true_table(name: &str) -> Vec<Vec<f64>> {
    let table = read_table(&set(name).join("truth/lighting.csv"))
        .unwrap_or_else(|e| panic!("{e}"))
        .values;
    assert!(table.iter().all(|c| c.len() == 720), "{name}: 720 angles");
    table
}

/// ‖a − b‖ / ‖b‖ over the values.
pub fn relative(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let difference: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    let norm: f64 = b.iter().map(|b| b * b).sum();
    (difference / norm).sqrt()
}

/// ‖a − b‖ / ‖b‖ over the circle, for frequencies up to `order` (Parseval).
pub fn relative_up_to(a: &Series, b: &Series, order: usize) -> f64 {
    let difference = Series {
        coefficients: (0..=order as i64).map(|p| a.get(p) - b.get(p)).collect(),
    };
    difference.norm() / b.with_order(order).norm()
}

/// The recovered lighting.
pub fn lighting(run: &Run) -> &LightingEstimate {
    run.lighting.as_ref().expect("lighting was recovered")
}

/// The recovered spectrum of channel `c`.
pub fn recovered(run: &Run, c: usize) -> Series {
    Series {
        coefficients: lighting(run).channels[c]
            .spectrum
            .iter()
            .map(|l| l.value)
            .collect(),
    }
}

/// The spectrum of 720 values from −180°.
pub fn spectrum_of(table: &[f64], order: usize) -> Series {
    CircleTransform::new(table.len(), -std::f64::consts::PI).analyse(table, order)
}
