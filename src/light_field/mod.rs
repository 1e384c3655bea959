//! From photographs' samples to the light field B(α, θo′) with mean, σ and weight.

mod columns;
mod field;
mod gridding;
mod samples;
mod strip;

pub use field::LightField;
pub use samples::{Column, Samples};
