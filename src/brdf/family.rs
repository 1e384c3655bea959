//! The analytic models by name: their parameters, and a model from its parameters' values.

use std::sync::Arc;

use super::{Blinn, GgxConductor, Isotropic, Lambertian, Mirror, Phong};

/// One parameter of a model: its key in a recipe and the values that make sense.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Key in a recipe and in `brdf_models.json`.
    pub name: &'static str,
    /// Value if the recipe has none; `None`: it must be given.
    pub default: Option<f64>,
    /// Smallest allowed value.
    pub low: f64,
    /// Largest allowed value; may be infinite.
    pub high: f64,
}

/// A kind of analytic BRDF.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Family {
    /// [`Lambertian`].
    Lambertian,
    /// [`Mirror`].
    Mirror,
    /// [`Phong`].
    Phong,
    /// [`Blinn`].
    Blinn,
    /// [`GgxConductor`].
    GgxConductor,
}

const fn parameter(name: &'static str, default: Option<f64>, low: f64, high: f64) -> Parameter {
    Parameter {
        name,
        default,
        low,
        high,
    }
}

/// Factors (albedos) have no upper limit: a relative capture has a scale of its own.
const fn factor(name: &'static str, default: Option<f64>) -> Parameter {
    parameter(name, default, 0.0, f64::INFINITY)
}

const DIFFUSE: Parameter = factor("diffuse", Some(0.0));
const SPECULAR: Parameter = factor("specular", None);
const EXPONENT: Parameter = parameter("exponent", None, 0.0, 1e6);
const ALPHA: Parameter = parameter("alpha", None, 1e-3, 2.0);

impl Family {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Lambertian,
        Self::Mirror,
        Self::Phong,
        Self::Blinn,
        Self::GgxConductor,
    ];

    /// Name in a recipe (`model = "…"`).
    pub fn name(self) -> &'static str {
        match self {
            Self::Lambertian => "lambertian",
            Self::Mirror => "mirror",
            Self::Phong => "phong",
            Self::Blinn => "blinn",
            Self::GgxConductor => "ggx-conductor",
        }
    }

    /// Its parameters, in the order [`Family::build`] takes their values.
    pub fn parameters(self) -> &'static [Parameter] {
        match self {
            Self::Lambertian => const { &[factor("albedo", None)] },
            Self::Mirror => const { &[factor("reflectance", Some(1.0))] },
            Self::Phong | Self::Blinn => &[DIFFUSE, SPECULAR, EXPONENT],
            Self::GgxConductor => {
                const {
                    &[
                        ALPHA,
                        parameter("eta", None, 0.0, 100.0),
                        parameter("k", None, 0.0, 100.0),
                        factor("specular", Some(1.0)),
                    ]
                }
            }
        }
    }

    /// The model with these values, one for each of [`Family::parameters`]; missing ones count as 0.
    pub fn build(self, values: &[f64]) -> Arc<dyn Isotropic> {
        let v = |i: usize| values.get(i).copied().unwrap_or(0.0);
        match self {
            Self::Lambertian => Arc::new(Lambertian { albedo: v(0) }),
            Self::Mirror => Arc::new(Mirror { reflectance: v(0) }),
            Self::Phong => Arc::new(Phong {
                diffuse: v(0),
                specular: v(1),
                exponent: v(2),
            }),
            Self::Blinn => Arc::new(Blinn {
                diffuse: v(0),
                specular: v(1),
                exponent: v(2),
            }),
            Self::GgxConductor => Arc::new(GgxConductor {
                alpha: v(0),
                eta: v(1),
                k: v(2),
                specular: v(3),
            }),
        }
    }
}
