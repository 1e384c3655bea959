//! From photographs' samples to the light field B(α, θo′) with mean, σ and weight.

mod samples;

pub use samples::{Column, Samples};
