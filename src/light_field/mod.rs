//! From photographs' samples to the light field B(α, θo′) with mean, σ and weight.

mod field;
mod samples;

pub use field::LightField;
pub use samples::{Column, Samples};
