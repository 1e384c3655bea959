//! Orbit angles that are wrong by 0.35° (rms) against true ones: the same photographs give almost the same light.
//!
//! The angles' common turn is not determined by any photograph (all views turned together are the light turned back), so the
//! planted errors have the mean 0. Where some views are dark and say nothing of their angles, as under one sun before black, not
//! even that helps: of N views with errors of variance σ² and mean 0, the M that say something have a mean error of variance σ² (1/M − 1/N),
//! of which only what was thought of the angles before says anything. It turns the light, and puts L_p wrong by p times as much:
//! no estimate can do better than this bound, and the last test shows that ours is no worse. The other sets have light from all around.

mod sets;

use std::path::Path;

use flatlight::WorldAngle;
use flatlight::capture::Capture;
use flatlight::pipeline::{Recipe, Run, Silent, execute};
use flatlight::simulate::{Recipe as Simulated, simulate};
use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use sets::*;

const WRONG_DEG: f64 = 0.35;
/// The promise: errors of the light within this factor of those at the true angles.
const FACTOR: f64 = 1.5;

/// The set with angles that are wrong by [`WRONG_DEG`] rms, and says so; the errors, degrees.
fn wrong(folder: &Path, seed: u64) -> (Capture, Vec<f64>) {
    let mut capture = capture(folder);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut errors: Vec<f64> = (0..capture.views.len())
        .map(|_| StandardNormal.sample(&mut random))
        .collect();
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n;
    let rms = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n).sqrt();
    for (e, view) in errors.iter_mut().zip(&mut capture.views) {
        *e = WRONG_DEG * (*e - mean) / rms;
        view.orbit = WorldAngle::radians(view.orbit.rad() + e.to_radians());
    }
    capture.camera.orbit_sigma_deg = WRONG_DEG;
    (capture, errors)
}

/// Relative error of all channels' light up to order 12.
fn error(run: &Run, folder: &Path) -> f64 {
    let squares: f64 = run
        .channels
        .iter()
        .enumerate()
        .map(|(c, name)| relative_up_to(&recovered(run, c), &spectrum_in(folder, name), 12).powi(2))
        .sum();
    (squares / run.channels.len() as f64).sqrt()
}

/// Runs a set with its angles and with wrong ones, checks the errors of light and angles, and gives those of the light.
fn compared(folder: &Path, seed: u64) -> [f64; 2] {
    let (exact, refined, _) = runs(folder, seed);
    [&exact, &refined].map(|run| error(run, folder))
}

/// Both runs, and what is left of each view's planted error, degrees.
fn runs(folder: &Path, seed: u64) -> (Run, Run, Vec<f64>) {
    let recipe = Recipe::read(&folder.join("recipe.toml")).unwrap();
    let (capture, planted) = wrong(folder, seed);
    let exact = run(&recipe, folder);
    let refined = execute(&recipe, &capture, &Silent).unwrap();
    let both = [&exact, &refined].map(|run| error(run, folder));
    let orbit = refined.orbit.as_ref().expect("refined angles");
    let n = planted.len() as f64;
    let left: Vec<f64> = (planted.iter().zip(&orbit.offset_deg))
        .map(|(e, found)| e + found)
        .collect();
    let mean = left.iter().sum::<f64>() / n;
    let z = left.iter().zip(&orbit.sigma_deg);
    let z = (z.map(|(e, s)| ((e - mean) / s).powi(2)).sum::<f64>() / n).sqrt();
    let rms = (left.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n).sqrt();
    println!(
        "{}: light {:.4} % at the true angles, {:.4} % with refined ones ({:.2} times); angles left {rms:.4}°, {z:.2} σ",
        folder.display(),
        100.0 * both[0],
        100.0 * both[1],
        both[1] / both[0]
    );
    // From 36 angles the scatter is known to 12 %; beyond 1.5 σ is too small.
    assert!(z < 1.5, "{z}");
    (exact, refined, left)
}

#[test]
fn a_sphere_s_outline_is_not_taken_for_wrong_angles() {
    // Its radius is found to 0.03 px; taken for angles that would be 0.02° along the orbit, once around.
    let [exact, refined] = compared(&set("ggx-sphere"), 7);
    assert!(refined < FACTOR * exact, "{exact} {refined}");
}

#[test]
fn an_object_beside_the_orbit_s_centre_is_settled_with_the_refined_angles() {
    // 3 % of the radius beside, an angle wrong by 0.35° puts the object 0.08 px from where it is: 0.02° of the normal.
    let text = r#"
        format = 1
        name = "two suns and a fill, beside the centre"
        seed = 3
        channels = ["Y"]
        [object]
        shape = "cylinder"
        radius = 0.05
        [camera]
        image_size = [480, 16]
        focal_px = 2439.5
        distance = 0.6
        [views]
        count = 36
        orbit_start_deg = 2.0
        orbit_step_deg = 10.0
        [brdf]
        model = "phong"
        diffuse = 0.3
        specular = 0.4
        exponent = 16
        [lighting]
        sources = [
            { theta_deg = 37.3, irradiance = 3.0 },
            { theta_deg = 150.0, irradiance = 2.0 },
            { theta_deg = -104.6, irradiance = 1.3 },
        ]
        uniform = 0.05
        [sensor]
        format = "exr-float"
        [faults]
        object_offset_m = [0.0012, -0.0009, 0.0]
    "#;
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("s.toml"), folder.path().join("set"));
    std::fs::write(&file, text).unwrap();
    simulate(&Simulated::read(&file).unwrap(), &out, false, &|| {}).unwrap();
    let [exact, refined] = compared(&out, 5);
    assert!(refined < FACTOR * exact, "{exact} {refined}");
}

#[test]
fn under_one_sun_only_the_common_turn_of_the_lit_views_is_left() {
    let folder = set("phong8-sun");
    let (exact, refined, left) = runs(&folder, 7);
    let orbit = refined.orbit.as_ref().expect("refined angles");
    // The views that say something of their angles, and what is left of their mean error.
    let lit: Vec<(f64, f64)> = left
        .iter()
        .zip(&orbit.sigma_deg)
        .filter(|(_, s)| **s < WRONG_DEG / 5.0)
        .map(|(e, s)| (*e, 1.0 / (s * s)))
        .collect();
    let (m, n) = (lit.len() as f64, left.len() as f64);
    assert!(lit.len() < left.len(), "some views are dark");
    let weight: f64 = lit.iter().map(|(_, w)| w).sum();
    let turn = (lit.iter().map(|(e, w)| e * w).sum::<f64>() / weight).to_radians();
    let bound = (WRONG_DEG * (1.0 / m - 1.0 / n).sqrt()).to_radians();
    assert!(turn.abs() < 3.0 * bound, "{turn} {bound}");
    // A sun's |L_p| are alike: p² has the mean 2 Σ p² / 25 over |p| ≤ 12.
    let slope = (2.0 * (1..=12).map(|p| f64::from(p * p)).sum::<f64>() / 25.0).sqrt();
    let [exact_error, refined_error] = [&exact, &refined].map(|run| error(run, &folder));
    assert!(
        refined_error < 3.0 * slope * bound,
        "{refined_error} {bound}"
    );
    // With that turn taken back nothing else is left.
    let squares: f64 = refined
        .channels
        .iter()
        .enumerate()
        .map(|(c, name)| {
            let mut light = recovered(&refined, c);
            for (p, l) in light.coefficients.iter_mut().enumerate() {
                *l *= Complex64::cis(p as f64 * turn);
            }
            relative_up_to(&light, &spectrum_in(&folder, name), 12).powi(2)
        })
        .sum();
    let rest = (squares / refined.channels.len() as f64).sqrt();
    println!(
        "{m} of {n} views lit: turned by {:.4}°, bound {:.4}°; light {:.4} % at the true angles, {:.4} % with refined ones, {:.4} % turned back",
        turn.to_degrees(),
        bound.to_degrees(),
        100.0 * exact_error,
        100.0 * refined_error,
        100.0 * rest
    );
    assert!(rest < FACTOR * exact_error, "{rest} {exact_error}");
}
