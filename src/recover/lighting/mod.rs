//! Lighting from a known BRDF (`recover = "lighting"`).

mod estimate;

pub use estimate::{
    ChannelEstimate, Coefficient, LightingEstimate, RegularisationChoice, SourceEstimate,
};
