//! The inverse directions: lighting, BRDF, or both from a light field.

pub mod advice;
pub mod brdf;
pub mod factorise;
pub mod lighting;
pub mod normal;
pub mod orbit;

pub use crate::lighting::Status;
