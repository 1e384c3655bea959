//! From photographs' samples to the light field B(α, θo′) with mean, σ and weight.

mod columns;
mod field;
mod file;
mod gridding;
mod samples;
mod strip;

pub use field::LightField;
pub use file::{Part, encode};
pub use samples::{Column, Samples};
