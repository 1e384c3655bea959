//! The inverse directions: lighting, BRDF, or both from a light field.

pub mod factorise;
