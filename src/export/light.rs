//! The light of a run, recovered or stated, for renderers.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::{Path, PathBuf};

use super::rgb;
use crate::angle::WorldAngle;
use crate::error::{Error, Result};
use crate::lighting::{Lighting, environment::write_lat_long};
use crate::pipeline::{Recipe, Run};

/// Directional lights that stand for the continuous light: one every 0.25°, as light without negative values is tabulated. With the midpoint rule that is
/// right to 1e-5 of the light, by the kink of the cosine at ±90°.
const EMITTERS: usize = 1440;

/// The recovered light, or the one that the recipe states; `None` if there is neither. It is nowhere negative.
pub(super) fn lighting(run: &Run) -> Option<Lighting> {
    if let Some(estimate) = &run.lighting {
        return Some(estimate.without_negative());
    }
    let recipe = Recipe::parse(&run.recipe_toml, Path::new("recipe.toml"), Path::new("")).ok()?;
    recipe.lighting?.resolve(&run.channels, Path::new("")).ok()
}

/// The same where there must be one.
///
/// # Errors
/// If there is none.
pub(super) fn required(run: &Run) -> Result<Lighting> {
    lighting(run).ok_or_else(|| {
        Error::input("expected a run with a recovered or stated light, found none").advice(
            "A light that the recipe takes from a file is found only while that file is there.",
        )
    })
}

/// A directional light in the plane.
pub(super) struct Emitter {
    /// Direction that it comes from, radians.
    pub theta: f64,
    /// Irradiance on a surface facing it, W m⁻², red, green and blue.
    pub irradiance: [f64; 3],
}

/// Sources, and the continuous light in steps; each with what it gives a surface facing it.
///
/// # Errors
/// If the channels are not R, G and B or a single one.
pub(super) fn emitters(light: &Lighting) -> Result<(Vec<Emitter>, Vec<Emitter>)> {
    let of = rgb(&light.channels)?;
    let sources = light
        .sources
        .iter()
        .map(|s| Emitter {
            theta: s.theta.rad(),
            irradiance: of.map(|c| s.in_channel(c)),
        })
        .collect();
    let step = TAU / EMITTERS as f64;
    let continuous = Lighting {
        sources: Vec::new(),
        ..light.clone()
    };
    let continuous = (0..EMITTERS)
        .map(|k| -PI + step * k as f64)
        .map(|theta| Emitter {
            theta,
            irradiance: of.map(|c| step * continuous.density(c, WorldAngle::radians(theta))),
        })
        .filter(|e| e.irradiance.iter().any(|v| *v != 0.0))
        .collect();
    Ok((sources, continuous))
}

/// Writes the whole light as a lat-long map for a world with +Z up whose maps have +X in the middle, as Blender's.
///
/// # Errors
/// If there is no light, or the file cannot be written.
pub(super) fn environment(run: &Run, file: &Path) -> Result<PathBuf> {
    let light = required(run)?;
    // The map that `write_lat_long` makes shows θ = 90° − 360°·u; Blender's shows θ = 180° − 360°·u.
    write_lat_long(file, &light.rotated(-FRAC_PI_2))?;
    Ok(file.to_path_buf())
}
