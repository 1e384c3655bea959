//! Invariances of light and space, through the whole pipeline: photos changed in a way whose effect on
//! the light is exactly known.
//!
//! The changes are exact in the photos (a permutation of pixels, a multiplication that loses at most one
//! rounding of a 32-bit float, a number in the description). What is left is rounding, and the tolerances at which
//! iterations stop, amplified where the photos hardly determine the light: 1e-5 of the mean light and a tenth
//! of an error bar, which changes no conclusion that could be drawn.

mod sets;

use std::f64::consts::TAU;

use flatlight::brdf::Model;
use flatlight::fourier::Series;
use flatlight::pipeline::{Recipe, Run};
use flatlight::recover::Status;
use flatlight::recover::lighting::SourceEstimate;
use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use sets::derived::{derive, each_view};
use sets::*;
use toml::{Table, Value};

/// Relative to the mean light, and to an error bar.
const SAME: f64 = 1e-5;
const SMALL: f64 = 0.1;

/// Smooth light, and a sun seen from uneven views with the principal point off the image's centre.
const SETS: [&str; 2] = ["phong8-smooth", "phong8-sun"];

/// The set as it is but for its storage, which counts as rounding in the error budget: in 32-bit floats, as
/// the changed sets.
fn unchanged(recipe: &Recipe, name: &str) -> Run {
    run(recipe, derive(name, |_, _| {}, |_| {}).path())
}

/// Asserts that `changed` is the light of `original` after `series` and `source` were applied to every
/// channel and source.
fn expect(
    original: &Run,
    changed: &Run,
    series: impl Fn(usize, &Series) -> Series,
    source: impl Fn(&SourceEstimate) -> SourceEstimate,
) {
    for c in 0..original.channels.len() {
        let expected = series(c, &recovered(original, c));
        let found = recovered(changed, c);
        assert_eq!(found.order(), expected.order(), "the band is the same");
        let scale = expected.get(0).re;
        for (p, l) in lighting(changed).channels[c].spectrum.iter().enumerate() {
            let error = (found.get(p as i64) - expected.get(p as i64)).norm();
            let granted = SAME * scale + SMALL * l.sigma;
            assert!(
                error <= granted,
                "channel {c}, p = {p}: {error:e}, {granted:e}"
            );
        }
    }
    let (before, after) = (&lighting(original).sources, &lighting(changed).sources);
    assert_eq!(before.len(), after.len());
    for expected in before.iter().map(source) {
        let found = after
            .iter()
            .min_by(|a, b| {
                let far = |s: &SourceEstimate| (s.theta_deg - expected.theta_deg).abs();
                far(a).total_cmp(&far(b))
            })
            .expect("as many sources");
        assert!(
            (found.theta_deg - expected.theta_deg).abs() <= 1e-4,
            "{found:?} {expected:?}"
        );
        let error = relative(&found.irradiance, &expected.irradiance);
        assert!(error <= SAME, "{found:?} {expected:?}");
    }
}

/// The same orbit, counted from another direction: the light turns with it.
#[test]
fn the_light_turns_with_the_world() {
    const TURN: f64 = 30.0;
    for name in SETS {
        let turned = derive(name, |_, _| {}, |t| each_view(t, "orbit_deg", |o| o + TURN));
        let recipe = recipe(name);
        expect(
            &unchanged(&recipe, name),
            &run(&recipe, turned.path()),
            |_, l| l.rotated(TURN.to_radians()),
            |s| SourceEstimate {
                theta_deg: s.theta_deg + TURN,
                ..s.clone()
            },
        );
    }
}

/// Photos 2.5 times as bright: light 2.5 times as bright.
#[test]
fn the_light_scales_with_the_photos() {
    for name in SETS {
        let brighter = derive(
            name,
            |_, photo| {
                for (_, plane) in &mut photo.planes {
                    plane.iter_mut().for_each(|v| *v *= 2.5);
                }
            },
            |_| {},
        );
        let recipe = recipe(name);
        let scaled = |l: &Series| Series {
            coefficients: l.coefficients.iter().map(|c| c * 2.5).collect(),
        };
        expect(
            &unchanged(&recipe, name),
            &run(&recipe, brighter.path()),
            |_, l| scaled(l),
            |s| SourceEstimate {
                irradiance: s.irradiance.iter().map(|e| 2.5 * e).collect(),
                ..s.clone()
            },
        );
    }
}

/// The recipe of a set with the surface's values for red and blue exchanged.
fn red_for_blue(name: &str) -> Recipe {
    let mut recipe = recipe(name);
    let mut brdf = recipe.brdf.as_ref().expect("a known surface").to_table();
    for key in ["diffuse", "specular"] {
        brdf[key].as_array_mut().expect("three values").reverse();
    }
    recipe.brdf = Some(Model::from_table(&brdf).expect("the same model"));
    recipe
}

/// Red and blue exchanged in photos and material: exchanged in the light. No channel is special.
#[test]
fn colours_are_treated_alike() {
    for name in SETS {
        let swapped = derive(
            name,
            |_, photo| {
                for (name, _) in &mut photo.planes {
                    *name = match name.as_str() {
                        "R" => "B".into(),
                        "B" => "R".into(),
                        other => other.into(),
                    };
                }
            },
            |_| {},
        );
        let original = unchanged(&recipe(name), name);
        let expected: Vec<Series> = (0..3).map(|c| recovered(&original, 2 - c)).collect();
        expect(
            &original,
            &run(&red_for_blue(name), swapped.path()),
            |c, _| expected[c].clone(),
            |s| SourceEstimate {
                irradiance: s.irradiance.iter().rev().copied().collect(),
                ..s.clone()
            },
        );
    }
}

/// Moves the principal point to where a flip of the image takes it.
fn flip_principal_point(table: &mut Table, axis: usize) {
    let camera = table["camera"].as_table_mut().expect("a camera");
    let size = camera["image_size"][axis].as_integer().expect("pixels");
    let point = camera["principal_point_px"][axis]
        .as_float()
        .expect("pixels");
    camera["principal_point_px"][axis] = Value::Float(size as f64 - point);
}

/// The world in a mirror: photos flipped left to right, the orbit run the other way. The light is mirrored, and
/// nothing in geometry, line or recovery prefers a side.
#[test]
fn the_light_is_mirrored_with_the_world() {
    for name in SETS {
        let mirrored = derive(
            name,
            |_, photo| photo.flipped(true),
            |t| {
                flip_principal_point(t, 0);
                each_view(t, "orbit_deg", |o| -o);
            },
        );
        let recipe = recipe(name);
        expect(
            &unchanged(&recipe, name),
            &run(&recipe, mirrored.path()),
            |_, l| Series {
                coefficients: l.coefficients.iter().map(Complex64::conj).collect(),
            },
            |s| SourceEstimate {
                theta_deg: -s.theta_deg,
                ..s.clone()
            },
        );
    }
}

/// A cylinder upside down under the same light: nothing changes.
#[test]
fn up_and_down_are_alike() {
    for name in SETS {
        let flipped = derive(
            name,
            |_, photo| photo.flipped(false),
            |t| flip_principal_point(t, 1),
        );
        let recipe = recipe(name);
        expect(
            &unchanged(&recipe, name),
            &run(&recipe, flipped.path()),
            |_, l| l.clone(),
            SourceEstimate::clone,
        );
    }
}

/// The photos in another order: the same light.
#[test]
fn the_order_of_the_photos_does_not_matter() {
    for name in SETS {
        let shuffled = derive(
            name,
            |_, _| {},
            |t| t["view"].as_array_mut().expect("views").reverse(),
        );
        let recipe = recipe(name);
        expect(
            &unchanged(&recipe, name),
            &run(&recipe, shuffled.path()),
            |_, l| l.clone(),
            SourceEstimate::clone,
        );
    }
}

/// Shot and read noise of a known sensor, added to the photos: the errors of what is called determined
/// are as large as their σ says. Over 2 · 25 numbers of 3 channels their mean square is 1 ± 0.12 if they are
/// independent; correlated between neighbouring frequencies, as they are, some times that.
#[test]
fn noise_gives_the_errors_that_are_stated() {
    const FULL_WELL: f64 = 10_000.0;
    const READ: f64 = 5.0;
    let name = "phong8-smooth";
    let mut random = ChaCha8Rng::seed_from_u64(8);
    // No photo of this set is as bright as 4.
    let white = 4.0;
    let noisy = derive(
        name,
        |_, photo| {
            for (_, plane) in &mut photo.planes {
                for v in plane {
                    let electrons = f64::from(*v) * FULL_WELL / white;
                    assert!(electrons < FULL_WELL, "the photo is not clipped: {v}");
                    let normal: f64 = StandardNormal.sample(&mut random);
                    let noisy = electrons + (electrons + READ * READ).sqrt() * normal;
                    *v = (noisy * white / FULL_WELL) as f32;
                }
            }
        },
        |t| {
            let mut sensor = Table::new();
            sensor.insert("encoding".into(), "linear".into());
            sensor.insert("white_level".into(), Value::Float(white));
            sensor.insert("full_well_e".into(), Value::Float(FULL_WELL));
            sensor.insert("read_noise_e".into(), Value::Float(READ));
            t.insert("sensor".into(), sensor.into());
        },
    );
    let run = run(&recipe(name), noisy.path());
    let (mut sum, mut count) = (0.0, 0usize);
    for (c, channel) in lighting(&run).channels.iter().enumerate() {
        let truth = true_spectrum(name, &channel.name);
        let error = relative_up_to(&recovered(&run, c), &truth, 12);
        println!(
            "{}: light to {:.3} %, total {:.5}",
            channel.name,
            100.0 * error,
            TAU * channel.spectrum[0].value.re
        );
        for (p, l) in channel.spectrum.iter().enumerate().take(13) {
            if l.status == Status::Determined {
                let e = l.value - truth.get(p as i64);
                sum += (e.re / l.sigma).powi(2);
                count += 1;
                if p > 0 {
                    sum += (e.im / l.sigma).powi(2);
                    count += 1;
                }
            }
        }
    }
    let mean = sum / count as f64;
    println!("mean squared error {mean:.2} σ² over {count} numbers");
    assert!(count >= 60, "{count} numbers are determined");
    assert!((0.5..=2.0).contains(&mean), "mean squared error {mean} σ²");
}
