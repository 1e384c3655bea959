//! From pixels to (α, θo′): the camera, the outline of the object in the image, the surface.
