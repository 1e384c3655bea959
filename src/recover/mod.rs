//! The inverse directions: lighting, BRDF, or both from a light field.

pub mod lighting;
pub mod normal;
mod status;

pub use status::Status;
