//! Which photos are taken, and how what is true in each differs from what is stated.

use std::path::PathBuf;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::draw::{Purpose, generator};
use super::recipe::{PhotoFormat, Recipe};
use super::render::Stand;
use crate::error::{Error, Result};
use crate::geometry::Pose;

/// One view that is taken.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedView {
    /// Index among the recipe's views, missing ones counted.
    pub number: usize,
    /// The orbit angle that `capture.toml` states, degrees.
    pub orbit_deg: f64,
    /// Where camera and object really are.
    pub stand: Stand,
    /// Factor on all light.
    pub brightness: f64,
    /// The photos.
    pub photos: Vec<PlannedPhoto>,
}

/// One photo that is taken.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedPhoto {
    /// File, relative to the capture's folder.
    pub file: PathBuf,
    /// The exposure time that `capture.toml` states, seconds.
    pub exposure_s: f64,
    /// How long the shutter really was open, seconds.
    pub true_exposure_s: f64,
}

/// The views of a recipe that are taken, in its order.
///
/// # Errors
/// If no view is left.
pub fn plan(recipe: &Recipe) -> Result<Vec<PlannedView>> {
    let faults = &recipe.faults;
    let draw = |purpose, view: usize| generator(recipe.seed, purpose, view as u64, 0);
    let kept = |view: &usize| {
        let unlucky = draw(Purpose::Missing, *view).random_range(0.0..1.0) < faults.missing_share;
        !faults.missing_views.contains(view) && !unlucky
    };
    let views: Vec<PlannedView> = (0..recipe.orbits_deg.len())
        .filter(kept)
        .map(|number| {
            let orbit_deg = recipe.orbits_deg[number];
            let jitter = faults.orbit_jitter_deg * normal(&mut draw(Purpose::Orbit, number));
            let orbit = (orbit_deg + jitter).to_radians();
            let (sin, cos) = orbit.sin_cos();
            let [x, y, z] = faults.object_offset_m;
            let mut wobble = draw(Purpose::Wobble, number);
            let offset = [x * cos + y * sin, y * cos - x * sin, z]
                .map(|component| component + faults.wobble_m * normal(&mut wobble));
            let brightness = draw(Purpose::Brightness, number);
            PlannedView {
                number,
                orbit_deg,
                stand: Stand {
                    orbit,
                    pose: Pose {
                        offset,
                        tilt: faults.tilt_deg.to_radians(),
                        ..Pose::nominal()
                    },
                    plane_roll: recipe.plane_roll_deg.to_radians(),
                },
                brightness: lognormal(brightness, faults.brightness_jitter),
                photos: photos(recipe, number, draw(Purpose::Exposure, number)),
            }
        })
        .collect();
    if views.is_empty() {
        return Err(Error::input("all views are missing")
            .key("faults.missing_views")
            .advice("Leave out fewer views."));
    }
    Ok(views)
}

fn photos(recipe: &Recipe, number: usize, mut random: ChaCha8Rng) -> Vec<PlannedPhoto> {
    let ending = match recipe.output.format {
        PhotoFormat::Png { .. } => "png",
        PhotoFormat::ExrHalf | PhotoFormat::ExrFloat => "exr",
    };
    let exposures = &recipe.output.exposures_s;
    exposures
        .iter()
        .enumerate()
        .map(|(k, &exposure_s)| {
            let file = if exposures.len() == 1 {
                format!("views/{number:03}.{ending}")
            } else {
                format!("views/{number:03}_{k:02}.{ending}")
            };
            let error = recipe.faults.exposure_jitter * normal(&mut random);
            PlannedPhoto {
                file: file.into(),
                exposure_s,
                true_exposure_s: exposure_s * error.exp(),
            }
        })
        .collect()
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

fn lognormal(mut random: ChaCha8Rng, sigma: f64) -> f64 {
    (sigma * normal(&mut random)).exp()
}
