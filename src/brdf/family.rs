//! The analytic models by name: their parameters, and a model from its parameters' values.

use std::sync::Arc;

use super::{
    Blinn, GgxConductor, GgxDielectric, HorizonSheen, Isotropic, Lambertian, Mirror, OrenNayar,
    Phong, Sheen, TorranceSparrow, Ward,
};

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
    /// [`Ward`].
    Ward,
    /// [`TorranceSparrow`].
    TorranceSparrow,
    /// [`GgxConductor`].
    GgxConductor,
    /// [`GgxDielectric`].
    GgxDielectric,
    /// [`OrenNayar`].
    OrenNayar,
    /// [`Sheen`].
    Sheen,
    /// [`HorizonSheen`], in recipes `sheen` with an `exponent`.
    HorizonSheen,
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
const SHEEN: Parameter = factor("sheen", None);
const IOR: Parameter = parameter("ior", Some(1.5), 1.0, 10.0);
const ALPHA: Parameter = parameter("alpha", None, 1e-3, 2.0);

impl Family {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Lambertian,
        Self::Mirror,
        Self::Phong,
        Self::Blinn,
        Self::Ward,
        Self::TorranceSparrow,
        Self::GgxConductor,
        Self::GgxDielectric,
        Self::OrenNayar,
        Self::Sheen,
        Self::HorizonSheen,
    ];

    /// Name in a recipe (`model = "…"`).
    pub fn name(self) -> &'static str {
        match self {
            Self::Lambertian => "lambertian",
            Self::Mirror => "mirror",
            Self::Phong => "phong",
            Self::Blinn => "blinn",
            Self::Ward => "ward",
            Self::TorranceSparrow => "torrance-sparrow",
            Self::GgxConductor => "ggx-conductor",
            Self::GgxDielectric => "ggx-dielectric",
            Self::OrenNayar => "oren-nayar",
            Self::Sheen | Self::HorizonSheen => "sheen",
        }
    }

    /// Its parameters, in the order [`Family::build`] takes their values.
    pub fn parameters(self) -> &'static [Parameter] {
        match self {
            Self::Lambertian => const { &[factor("albedo", None)] },
            Self::Mirror => const { &[factor("reflectance", Some(1.0))] },
            Self::Phong | Self::Blinn => &[DIFFUSE, SPECULAR, EXPONENT],
            Self::Ward => &[DIFFUSE, SPECULAR, ALPHA],
            Self::TorranceSparrow => {
                const { &[DIFFUSE, parameter("roughness", None, 1e-3, 2.0), IOR] }
            }
            Self::GgxDielectric => &[DIFFUSE, ALPHA, IOR],
            Self::OrenNayar => {
                const {
                    &[
                        factor("albedo", None),
                        parameter("sigma_deg", None, 0.0, 90.0),
                    ]
                }
            }
            Self::Sheen => const { &[DIFFUSE, SHEEN, parameter("roughness", None, 0.01, 1.0)] },
            Self::HorizonSheen => {
                const { &[DIFFUSE, SHEEN, parameter("exponent", None, 0.1, 1e4)] }
            }
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
            Self::Ward => Arc::new(Ward {
                diffuse: v(0),
                specular: v(1),
                alpha: v(2),
            }),
            Self::TorranceSparrow => Arc::new(TorranceSparrow {
                diffuse: v(0),
                roughness: v(1),
                ior: v(2),
            }),
            Self::GgxDielectric => Arc::new(GgxDielectric {
                diffuse: v(0),
                alpha: v(1),
                ior: v(2),
            }),
            Self::OrenNayar => Arc::new(OrenNayar {
                albedo: v(0),
                sigma: v(1).to_radians(),
            }),
            Self::Sheen => Arc::new(Sheen {
                diffuse: v(0),
                sheen: v(1),
                roughness: v(2),
            }),
            Self::HorizonSheen => Arc::new(HorizonSheen {
                diffuse: v(0),
                sheen: v(1),
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
