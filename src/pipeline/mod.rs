//! Recipes, the order of the stages, products and provenance.

mod run;

pub use run::{Preview, Run, Spectrum, ViewRecord};
