//! What holds for any values: files read back as they were written, BRDFs are reciprocal, and the world may be turned or
//! brightened without any result but the light's knowing of it.

use std::path::Path;

use flatlight::LocalAngle;
use flatlight::brdf::{Axis, Family, SliceTable};
use flatlight::capture::Capture;
use flatlight::lighting::{
    SpectrumRow, Status, read_spectrum, read_table, values_csv, write_spectrum,
};
use flatlight::pipeline::{Recipe, Run, Silent, execute};
use flatlight::simulate;
use num_complex::Complex64;
use proptest::prelude::*;

/// Any finite number, of any size and sign.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -1.0..1.0_f64,
        prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO
    ]
}

fn scratch(name: &str) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join(name);
    (folder, file)
}

proptest! {
    #[test]
    fn a_table_of_lighting_reads_back_to_the_last_bit(
        values in prop::collection::vec(prop::collection::vec(number(), 36), 1..4),
    ) {
        let (_folder, file) = scratch("lighting.csv");
        let channels: Vec<String> = (0..values.len()).map(|c| format!("band_{c}")).collect();
        let sigma: Vec<Vec<f64>> = values.iter().map(|v| v.iter().map(|x| x.abs()).collect()).collect();
        std::fs::write(&file, values_csv(&channels, &values, Some(&sigma))).expect("written");
        let read = read_table(&file).unwrap_or_else(|e| panic!("{e}"));
        prop_assert_eq!(&read.lighting.channels, &channels);
        for (a, b) in read.values.iter().flatten().zip(values.iter().flatten()) {
            prop_assert_eq!(a.to_bits(), b.to_bits());
        }
        for (a, b) in read.sigma.iter().flatten().zip(sigma.iter().flatten()) {
            prop_assert_eq!(a.map(f64::to_bits), Some(b.to_bits()));
        }
    }

    #[test]
    fn a_spectrum_reads_back_to_the_last_bit(
        rows in prop::collection::vec((number(), number(), prop::option::of(number()), 0..3_usize), 1..40),
    ) {
        let (_folder, file) = scratch("lighting_spectrum.csv");
        let rows: Vec<SpectrumRow> = rows
            .into_iter()
            .enumerate()
            .map(|(p, (re, im, sigma, status))| SpectrumRow {
                channel: "R".into(),
                p,
                value: Complex64::new(re, im),
                sigma: sigma.map(f64::abs),
                status: [Status::Determined, Status::Weak, Status::Indeterminate][status],
            })
            .collect();
        write_spectrum(&file, &rows).expect("written");
        let read = read_spectrum(&file).unwrap_or_else(|e| panic!("{e}"));
        prop_assert_eq!(read.len(), rows.len());
        for (a, b) in read.iter().zip(&rows) {
            prop_assert_eq!((a.p, a.value, a.sigma, a.status), (b.p, b.value, b.sigma, b.status));
        }
    }

    #[test]
    fn a_table_of_a_brdf_reads_back_to_the_last_bit(
        size in 2..12_usize,
        inclusive in any::<bool>(),
        seed in prop::collection::vec(prop::option::weighted(0.9, number()), 121),
    ) {
        let axis = Axis { count: size, inclusive };
        let rho: Vec<f64> = seed.iter().take(size * size).map(|v| v.unwrap_or(f64::NAN)).collect();
        let table = SliceTable { channels: vec!["Y".into()], incident: axis, exitant: axis, rho: vec![rho], sigma: Vec::new() };
        let read = SliceTable::parse(&table.to_csv()).unwrap_or_else(|e| panic!("{e}"));
        prop_assert_eq!((read.incident, read.exitant), (axis, axis));
        for (a, b) in read.rho[0].iter().zip(&table.rho[0]) {
            prop_assert!(a == b || (a.is_nan() && b.is_nan()), "{} {}", a, b);
        }
    }

    /// ρ(θi′, θo′) = ρ(θo′, θi′) for every model and all of its parameters' values. Rounding: 1e-9 of the value holds
    /// the 1e6 that an exponent multiplies a half unit in the last place by.
    #[test]
    fn every_model_is_reciprocal(
        places in prop::collection::vec(0.0..1.0_f64, 8),
        a in -89.0..89.0_f64,
        b in -89.0..89.0_f64,
    ) {
        for family in Family::ALL {
            let values: Vec<f64> = family
                .parameters()
                .iter()
                .zip(&places)
                .map(|(p, t)| {
                    let (low, high) = (p.low.max(1e-2), p.high.min(100.0));
                    low * (high / low).powf(*t)
                })
                .collect();
            let model = family.build(&values);
            let (a, b) = (LocalAngle::degrees(a), LocalAngle::degrees(b));
            let (ab, ba): (f64, f64) = (model.value(a, b), model.value(b, a));
            prop_assert!(
                (ab - ba).abs() <= 1e-9 * ab.abs().max(ba.abs()) + f64::MIN_POSITIVE,
                "{:?} {:?}: {} {}", family, values, ab, ba
            );
            prop_assert!(ab >= 0.0 && ab.is_finite(), "{:?} {:?}: {}", family, values, ab);
        }
    }
}

const SUN_DEG: f64 = 37.3;
const FILL_SUN_DEG: f64 = -104.6;

/// A set whose world is turned by an angle, and whose photos take `seconds`, with a recipe on it.
fn turned(degrees: f64, seconds: f64, recover: &str) -> Run {
    let light = format!(
        "[lighting]\nsources = [{{ theta_deg = {}, irradiance = [3.0] }}, {{ theta_deg = {}, irradiance = [1.1] }}]\nuniform = 0.3\n",
        SUN_DEG + degrees,
        FILL_SUN_DEG + degrees
    );
    let material = "[brdf]\nmodel = \"phong\"\ndiffuse = 0.3\nspecular = 0.4\nexponent = 8\n";
    let text = format!(
        "format = 1\nseed = 1\nchannels = [\"Y\"]\n[object]\nshape = \"cylinder\"\nradius = 0.05\n\
         [camera]\nimage_size = [120, 16]\nfocal_px = 600\ndistance = 0.6\n\
         [views]\ncount = 24\norbit_start_deg = {degrees}\norbit_step_deg = 15\n{material}{light}[sensor]\nformat = \"exr-float\"\n"
    );
    let folder = tempfile::tempdir().expect("a folder");
    let parsed = simulate::Recipe::parse(&text, Path::new("scene.toml"), folder.path());
    let out = folder.path().join("set");
    simulate::simulate(
        &parsed.unwrap_or_else(|e| panic!("{e}")),
        &out,
        false,
        &|| {},
    )
    .unwrap_or_else(|e| panic!("{e}"));
    let mut capture = Capture::read(&out).unwrap_or_else(|e| panic!("{e}"));
    for photo in capture.views.iter_mut().flat_map(|v| &mut v.photos) {
        photo.exposure_s = Some(seconds);
    }
    let known = if recover == "lighting" {
        material
    } else {
        &light
    };
    let text =
        format!("recover = \"{recover}\"\n[light_field]\nnormals = 180\nlocals = 90\n{known}");
    let recipe = Recipe::parse(&text, Path::new("recipe.toml"), folder.path());
    execute(&recipe.unwrap_or_else(|e| panic!("{e}")), &capture, &Silent)
        .unwrap_or_else(|e| panic!("{e}"))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2, max_shrink_iters: 0, ..ProptestConfig::default() })]

    /// Turned by any angle, the world gives the same light, turned: L_p e^{−ipa}. The photos agree to the rounding of 32-bit
    /// floats, 6e-8, and so do the samples; a lobe as dull as this one's passes a hundredth of the last determined frequency, and the
    /// prior's strength is learnt anew: 1e-3 of the mean.
    #[test]
    fn the_light_of_a_turned_world_is_turned(degrees in -180.0..180.0_f64) {
        let (still, turned) = (turned(0.0, 1.0, "lighting"), turned(degrees, 1.0, "lighting"));
        let spectrum = |run: &Run| run.lighting.as_ref().expect("light").channels[0].spectrum.clone();
        let (a, b) = (spectrum(&still), spectrum(&turned));
        prop_assert_eq!(a.len(), b.len());
        let mean = a[0].value.re;
        let mut count = 0;
        for (p, (a, b)) in a.iter().zip(&b).enumerate() {
            if a.status == Status::Determined && b.status == Status::Determined {
                count += 1;
                let expected = a.value * Complex64::cis(-(p as f64) * degrees.to_radians());
                prop_assert!((b.value - expected).norm() < 1e-3 * mean, "p = {}: {} {}", p, b.value, expected);
            }
        }
        prop_assert!(count > 4, "{} coefficients", count);
    }

    /// And the same BRDF: the object does not know where north is.
    #[test]
    fn the_material_of_a_turned_world_is_the_same(degrees in -180.0..180.0_f64) {
        let (still, turned) = (turned(0.0, 1.0, "brdf"), turned(degrees, 1.0, "brdf"));
        let slice = |run: &Run| run.brdf.as_ref().expect("a BRDF").slices[0].clone();
        let (a, b) = (slice(&still), slice(&turned));
        let largest = a.reciprocal.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let both = a.status.iter().zip(&b.status);
        let known = both.map(|(a, b)| *a != Status::Indeterminate && *b != Status::Indeterminate);
        let mut count = 0;
        for ((x, y), known) in a.reciprocal.iter().zip(&b.reciprocal).zip(known) {
            if known {
                count += 1;
                prop_assert!((x - y).abs() < 1e-3 * largest, "{} {}", x, y);
            }
        }
        prop_assert!(count > a.status.len() / 4, "{} of {} cells", count, a.status.len());
    }

    /// Photos that took twice the time show half the radiance for the same stored values.
    #[test]
    fn radiance_is_per_second(seconds in 0.01..100.0_f64) {
        let (one, other) = (turned(0.0, 1.0, "lighting"), turned(0.0, seconds, "lighting"));
        let spectrum = |run: &Run| run.lighting.as_ref().expect("light").channels[0].spectrum.clone();
        let (a, b) = (spectrum(&one), spectrum(&other));
        for (p, (a, b)) in a.iter().zip(&b).enumerate() {
            if a.status == Status::Determined && b.status == Status::Determined {
                let difference = (b.value * seconds - a.value).norm();
                prop_assert!(difference < 1e-3 * spectrum(&one)[0].value.re, "p = {}: {}", p, difference);
            }
        }
    }
}
