//! Recipes, the order of the stages, products and provenance.

mod advice;
mod balance;
mod brdf_products;
mod causes;
mod execute;
mod explain;
mod fingerprint;
mod fit;
mod joint;
mod lean;
mod material;
mod measure;
mod orbit;
mod orbit_errors;
mod preview;
mod products;
mod progress;
mod recipe;
mod record;
mod run;
mod scale;
mod scenery;
mod spectrum;
mod trial;
mod usable;

pub use crate::files::Claim;
pub use execute::{execute, input_hashes};
pub use fit::FitQuality;
pub use joint::ChannelGauge;
pub use measure::{Measured, Taken, at_angles, measure, take};
pub use orbit::OrbitRefinement;
pub use products::{Folder, Found, Product, products};
pub use progress::{Progress, Silent};
pub use recipe::{LightFieldOptions, Recipe, Recover, RecoveryOptions};
pub use run::{Preview, Recovered, Run, Spectrum, Verdict, ViewRecord};
pub use scale::ScaleDescription;
