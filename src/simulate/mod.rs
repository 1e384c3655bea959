//! Synthetic capture sets: the exact forward model through a camera's faults.
//!
//! A picture is what a photograph of the scene is: every ray through a pixel is cast through the lens,
//! cut with the object in 3-D, and the 3-D BRDF is evaluated out of the plane for light from within it.

mod blemish;
mod body;
mod chart;
mod draw;
mod render;
mod shade;

pub use blemish::{Dust, Texture};
pub use render::{Picture, Renderer, Stand};
