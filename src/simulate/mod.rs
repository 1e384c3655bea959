//! Synthetic capture sets: the exact forward model through a camera's faults.
//!
//! A picture is what a photograph of the scene is: every ray through a pixel is cast through the lens,
//! cut with the object in 3-D, and the 3-D BRDF is evaluated out of the plane for light from within it.
//! Then come what lens and sensor do to it, and what a capture's description has wrong. [`simulate`] makes
//! a whole set from a [`Recipe`]; [`Renderer`] makes single pictures.
//!
//! For a light field without a camera see [`reflect`](crate::reflect).

mod blemish;
mod body;
mod chart;
mod draw;
mod panels;
mod plan;
mod recipe;
mod render;
mod sensor;
mod set;
mod shade;
#[cfg(test)]
mod tests;
mod truth;
mod write;

pub use blemish::{Dust, Texture};
pub use plan::{PlannedPhoto, PlannedView, plan};
pub use recipe::{Faults, Output, PhotoFormat, Recipe, Unstated};
pub use render::{Picture, Renderer, Stand};
pub use set::{Written, simulate};
