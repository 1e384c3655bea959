//! Surface reflection in the plane of incidence: analytic models, one per file, and tables.
//!
//! Every [`Brdf`] is the in-plane slice of a 3-D BRDF, in sr⁻¹, for one channel; a [`Material`] holds
//! one per channel. The analytic models are written once, in their 3-D form ([`Isotropic`]), so that
//! their energy can be checked over the hemisphere.

mod blinn;
pub mod closed_forms;
mod family;
pub mod fit;
mod fresnel;
mod ggx;
mod ggx_dielectric;
mod isotropic;
mod lambertian;
mod measured;
mod mirror;
mod model;
mod oren_nayar;
mod phong;
mod sheen;
mod spectrum;
mod table;
#[cfg(test)]
mod testing;
mod torrance_sparrow;
mod transfer;
mod ward;

use std::fmt::Debug;
use std::sync::Arc;

use crate::angle::LocalAngle;

pub use blinn::Blinn;
pub use family::{Family, Parameter};
pub use fresnel::{conductor_reflectance, dielectric_reflectance};
pub use ggx::GgxConductor;
pub use ggx_dielectric::GgxDielectric;
pub use isotropic::{Isotropic, Pair, directional_albedo};
pub use lambertian::Lambertian;
pub use measured::MeasuredSlice;
pub use mirror::Mirror;
pub use model::Model;
pub use oren_nayar::OrenNayar;
pub use phong::Phong;
pub use sheen::{HorizonSheen, Sheen};
pub use spectrum::ReciprocalSpectrum;
pub use table::{Axis, SliceTable};
pub use torrance_sparrow::TorranceSparrow;
pub use transfer::{IncidentRule, transfer_row};
pub use ward::Ward;

/// The in-plane slice of an isotropic BRDF in one channel.
///
/// ρ(θi′, θo′) = [`Brdf::value`] plus, for mirrors, a delta function: the transfer function is
/// ρ̂(θi′, θo′) = value · cos θi′ + [`Brdf::mirror`](θo′) · δ(θi′ + θo′).
pub trait Brdf: Debug + Send + Sync {
    /// ρ(θi′, θo′) without the delta part, sr⁻¹, no cosine in it; 0 if either direction is below the
    /// surface.
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64;

    /// Weight of the mirror's δ(θi′ + θo′) in ρ̂ (dimensionless reflectance).
    fn mirror(&self, _exitant: LocalAngle) -> f64 {
        0.0
    }

    /// The 3-D form, where there is one: [`value`](Brdf::value) is its slice. Who wants several BRDFs at the same
    /// directions works these out once.
    fn isotropic(&self) -> Option<&dyn Isotropic> {
        None
    }

    /// Width (radians, in θi′) of the narrowest lobe around the mirror direction: how fine a
    /// quadrature must be there. For a Gaussian lobe two standard deviations, for a rational one the
    /// distance of its poles from the real axis.
    fn lobe_width(&self) -> f64;

    /// Distance (radians) from ±π/2 over which masking or a root changes the value: how fine a
    /// quadrature must be at grazing incidence.
    fn grazing_width(&self) -> f64 {
        1.0
    }

    /// Angles θi′ (radians) at which the value has a kink for this exitant direction, beyond those at
    /// ±π/2: quadrature panels end there.
    fn kinks(&self, _exitant: LocalAngle) -> Vec<f64> {
        Vec::new()
    }
}

/// One BRDF per channel.
#[derive(Clone, Debug)]
pub struct Material {
    /// Channel names.
    pub channels: Vec<String>,
    /// The BRDF of each channel.
    pub brdfs: Vec<Arc<dyn Brdf>>,
}
