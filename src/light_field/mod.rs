//! From photographs' samples to the light field B(α, θo′) with mean, σ and weight.

mod columns;
mod direction;
mod dust;
mod field;
mod file;
mod gridding;
mod header;
mod jitter;
mod line;
mod samples;
mod strip;

pub use direction::runs_backwards;
pub use field::LightField;
pub use file::{Part, encode};
pub use gridding::grid;
pub use header::sort_attributes;
pub use jitter::{Jitter, jitter};
pub use line::{MeasuredLine, ViewSample, automatic_limb_cut};
pub use samples::{Column, Gathered, Samples, Systematic, gather};
pub use strip::Stations;
