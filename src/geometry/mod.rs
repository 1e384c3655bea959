//! From pixels to (α, θo′): the camera, the outline of the object in the image, the surface.
//!
//! [`outline::find`] looks for the object's limb in each photo, [`settle::settle`] makes one pose per view of all
//! outlines together, and [`ViewGeometry`] says what every pixel shows.

pub mod camera;
pub mod outline;
pub mod probe;
pub mod settle;
pub mod surface;
#[cfg(test)]
mod test_photo;

pub use camera::{CameraModel, Ray};
pub use outline::{Disagreement, LimbPoint, Outline, Search, Status};
pub use probe::{Highlight, probe};
pub use settle::{Settled, settle};
pub use surface::{CrossSectionPoint, Pose, Side, SurfacePoint, ViewGeometry};
