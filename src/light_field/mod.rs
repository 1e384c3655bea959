//! From photographs' samples to the light field B(α, θo′) with mean, σ and weight.

mod columns;
mod dust;
mod field;
mod file;
mod gridding;
mod header;
mod line;
mod samples;
mod strip;

pub use field::LightField;
pub use file::{Part, encode};
pub use gridding::grid;
pub use line::{MeasuredLine, ViewSample, automatic_limb_cut};
pub use samples::{Column, Gathered, Samples, Systematic, gather};
pub use strip::Station;
