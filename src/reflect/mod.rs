//! The forward direction: the light field of a lighting and a material, by the product of their
//! Fourier series (fast) and by the angular integral (slow, the oracle).

pub mod integral;
pub(crate) mod panels;
pub mod prefilter;
pub mod product;

use crate::angle::{LocalAngle, NormalAngle};
use crate::brdf::{Brdf, Material};
use crate::error::{Error, Result};
use crate::lighting::Lighting;

/// Light from the directional sources alone: Σ_k E_k ρ̂(θ_k − α, θo′), which is eq. 4 without any
/// approximation.
fn from_sources(
    lighting: &Lighting,
    channel: usize,
    brdf: &dyn Brdf,
    normal: NormalAngle,
    local: LocalAngle,
) -> f64 {
    lighting
        .sources
        .iter()
        .map(|source| {
            let incident = source.theta - normal;
            match incident.visible_cosine() {
                0.0 => 0.0,
                cosine => source.in_channel(channel) * brdf.value(incident, local) * cosine,
            }
        })
        .sum()
}

/// The material and the lighting must speak of the same channels, and a mirror under a point source has
/// no finite light field.
fn check(lighting: &Lighting, material: &Material) -> Result<()> {
    if lighting.channels != material.channels || material.brdfs.len() != material.channels.len() {
        return Err(Error::input(format!(
            "expected lighting and material in the same channels, found {} and {}",
            lighting.channels.join(", "),
            material.channels.join(", ")
        )));
    }
    let normal_exitance = LocalAngle::radians(0.0);
    let mirror = material
        .brdfs
        .iter()
        .any(|b| b.mirror(normal_exitance) != 0.0);
    if mirror && !lighting.sources.is_empty() {
        return Err(Error::input(
            "a mirror shows a directional source as a point of infinite radiance",
        )
        .advice("Give the source a width (a table of lighting), or the material a rough lobe."));
    }
    Ok(())
}
