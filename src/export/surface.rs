//! The material of a run as one analytic 3-D model for all channels.

use std::f64::consts::FRAC_1_PI;
use std::path::Path;

use crate::brdf::{Family, Isotropic, Model, Pair};
use crate::error::{Error, Result};
use crate::pipeline::{Recipe, Run};

/// ρ = lambert/π + scale · ρ_family in every channel.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Channel names.
    pub channels: Vec<String>,
    /// The model.
    pub family: Family,
    /// Its parameters in each channel.
    pub layers: Vec<Layer>,
    /// Where it comes from, a sentence.
    pub origin: String,
}

/// A model's parameters in one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// One value for each of [`Family::parameters`].
    pub values: Vec<f64>,
    /// Albedo of a Lambertian part that is added.
    pub lambert: f64,
    /// Factor on the model.
    pub scale: f64,
    /// Root mean square error of the fit of ρ cos θi′ cos θo′ relative to its largest value; 0 if the model was stated.
    pub error: f64,
}

impl Surface {
    /// The model that fits the recovered slice best in all channels together, or else the one that the recipe states.
    ///
    /// # Errors
    /// If the run has neither.
    pub fn of(run: &Run) -> Result<Self> {
        Self::fitted(run).or_else(|| Self::stated(run)).ok_or_else(|| {
            Error::input("expected a run with a fitted or stated BRDF model, found none").advice(
                "Runs with recover = \"brdf\" or \"both\" fit models, unless the recovery was refused; a stated table has none. npz and astm hold slices as they are.",
            )
        })
    }

    fn fitted(run: &Run) -> Option<Self> {
        let models = run.models.as_ref()?;
        // The smallest sum of BIC over the channels, among the models that every channel has.
        let best = |family: Family| {
            let of_channel = |c: &crate::brdf::fit::ChannelModels| {
                let same = c.fits.iter().filter(|f| f.model == family.name());
                let complete = same.filter(|f| layer(family, f).is_some());
                complete
                    .min_by(|a, b| a.bic.total_cmp(&b.bic))
                    .map(|f| (f.bic, layer(family, f)))
            };
            let all: Option<Vec<_>> = models.channels.iter().map(of_channel).collect();
            all.filter(|a| !a.is_empty())
        };
        let (family, fits) = Family::ALL
            .into_iter()
            .filter_map(|family| Some((family, best(family)?)))
            .min_by(|(_, a), (_, b)| {
                let sum = |fits: &[(f64, _)]| fits.iter().map(|f| f.0).sum::<f64>();
                sum(a).total_cmp(&sum(b))
            })?;
        let layers: Vec<Layer> = fits.into_iter().filter_map(|f| f.1).collect();
        let errors: Vec<String> = layers
            .iter()
            .map(|l| format!("{:.2} %", 100.0 * l.error))
            .collect();
        Some(Self {
            channels: models.channels.iter().map(|c| c.channel.clone()).collect(),
            family,
            origin: format!(
                "Fitted to the recovered slice; root mean square error of rho cos cos over its largest value: {}.",
                errors.join(", ")
            ),
            layers,
        })
    }

    fn stated(run: &Run) -> Option<Self> {
        let recipe =
            Recipe::parse(&run.recipe_toml, Path::new("recipe.toml"), Path::new("")).ok()?;
        let Some(Model::Analytic { family, values }) = recipe.brdf else {
            return None;
        };
        let layers = (0..run.channels.len())
            .map(|c| {
                let of_channel = |v: &Vec<f64>| v.get(c).or(v.first()).copied();
                Some(Layer {
                    values: values.iter().map(of_channel).collect::<Option<_>>()?,
                    lambert: 0.0,
                    scale: 1.0,
                    error: 0.0,
                })
            })
            .collect::<Option<_>>()?;
        Some(Self {
            channels: run.channels.clone(),
            family,
            layers,
            origin: "Stated in the recipe, not measured.".to_owned(),
        })
    }

    /// ρ of each channel as a function in space, 1/sr; `None` for a mirror, which has no finite one.
    pub fn in_space(&self) -> Option<Vec<impl Fn(&Pair) -> f64 + Sync>> {
        if self.family == Family::Mirror {
            return None;
        }
        Some(
            self.layers
                .iter()
                .map(|layer| {
                    let base = self.family.build(&layer.values);
                    let Layer { lambert, scale, .. } = layer.clone();
                    move |pair: &Pair| {
                        lambert * FRAC_1_PI + scale * Isotropic::rho(base.as_ref(), pair)
                    }
                })
                .collect(),
        )
    }

    /// A parameter of the model in each channel.
    pub fn parameter(&self, name: &str) -> Option<Vec<f64>> {
        let at = self
            .family
            .parameters()
            .iter()
            .position(|p| p.name == name)?;
        self.layers
            .iter()
            .map(|layer| layer.values.get(at).copied())
            .collect()
    }

    /// The model and all its numbers, a line per channel.
    pub fn describe(&self) -> String {
        let mut text = format!("model {}\n", self.family.name());
        for (name, layer) in self.channels.iter().zip(&self.layers) {
            let parameters = self.family.parameters().iter().zip(&layer.values);
            let words: Vec<String> = parameters
                .map(|(p, v)| format!("{} {v}", p.name))
                .chain((layer.lambert > 0.0).then(|| format!("lambert {}", layer.lambert)))
                .chain((layer.scale != 1.0).then(|| format!("scale {}", layer.scale)))
                .collect();
            text += &format!("  {name}: {}\n", words.join(", "));
        }
        text + &self.origin + "\n"
    }
}

fn layer(family: Family, fit: &crate::brdf::fit::ModelFit) -> Option<Layer> {
    let value = |name: &str| {
        let found = fit.parameters.iter().find(|p| p.name == name);
        found.map(|p| p.value)
    };
    let values = family.parameters().iter().map(|p| value(p.name));
    Some(Layer {
        values: values.collect::<Option<_>>()?,
        lambert: value("lambert").unwrap_or(0.0),
        scale: value("scale").unwrap_or(1.0),
        error: fit.relative_rms,
    })
}
