//! The forward direction: the light field of a lighting and a BRDF.
