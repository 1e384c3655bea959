//! The paper's Fourier series (eq. 6): indexing, sign and normalisation, in this one place.
//!
//! f_k = (1/2π) ∫ f(θ) e^{−ikθ} dθ and f(θ) = Σ f_k e^{ikθ}, with θ measured from the reference axis
//! whatever the first sample of a table is. FFT libraries are unnormalised and start at angle 0; the
//! factor and the shift between the two are applied here only.

pub mod irregular;
mod series;
mod transform;

pub use series::Series;
pub(crate) use series::or_infinite;
pub use transform::CircleTransform;
