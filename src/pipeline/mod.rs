//! Recipes, the order of the stages, products and provenance.

mod execute;
mod measure;
mod preview;
mod products;
mod progress;
mod recipe;
mod run;

pub use execute::{execute, input_hashes};
pub use measure::{Measured, measure};
pub use products::{Folder, Found, Product, products};
pub use progress::{Progress, Silent};
pub use recipe::{LightFieldOptions, Recipe, Recover, RecoveryOptions};
pub use run::{Preview, Run, Spectrum, ViewRecord};
