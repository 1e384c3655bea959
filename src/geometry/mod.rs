//! From pixels to (α, θo′): the camera, the outline of the object in the image, the surface.

pub mod camera;
pub mod surface;

pub use camera::{CameraModel, Ray};
pub use surface::{CrossSectionPoint, Pose, Side, SurfacePoint, ViewGeometry};
