//! A model up to its scale: for fits in which light or exposure takes up any factor.

use std::sync::Arc;

use super::FittedParameter;
use super::candidate::{Layered, geometric};
use super::minimise::{Minimum, minimise};
use crate::brdf::{Brdf, Family};

/// One free parameter of a shape.
#[derive(Clone, Debug)]
struct Free {
    /// Position among the family's parameters; one beyond the last is the added Lambertian part.
    slot: usize,
    /// Whether it is fitted by its logarithm.
    log: bool,
    low: f64,
    high: f64,
    starts: Vec<f64>,
}

/// A family of which one strength is held at 1, so that only its shape is free.
#[derive(Clone, Debug)]
pub(crate) struct Shape {
    family: Family,
    /// The family's parameters and the albedo of an added Lambertian part; free ones are overwritten.
    template: Vec<f64>,
    free: Vec<Free>,
}

impl Shape {
    /// Every family but the mirror, metals with a Lambertian part.
    pub(crate) fn all() -> Vec<Self> {
        Family::ALL
            .into_iter()
            .filter(|f| *f != Family::Mirror)
            .map(Self::new)
            .collect()
    }

    fn new(family: Family) -> Self {
        let indexed = matches!(family, Family::TorranceSparrow | Family::GgxDielectric);
        let mut names: Vec<&str> = family.parameters().iter().map(|p| p.name).collect();
        names.push("lambert");
        let mut template = vec![0.0; names.len()];
        let mut free = Vec::new();
        for (slot, name) in names.into_iter().enumerate() {
            let mut add = |log, low, high, starts: &[f64]| {
                free.push(Free {
                    slot,
                    log,
                    low,
                    high,
                    starts: starts.to_vec(),
                });
            };
            match name {
                "specular" | "sheen" | "albedo" => template[slot] = 1.0,
                // Beside a dielectric's coat, whose strength its index gives.
                "diffuse" if indexed => add(false, 0.0, 1e4, &[0.03, 0.3]),
                "diffuse" => add(false, 0.0, 1e4, &[0.1, 0.7]),
                "lambert" if family == Family::GgxConductor => add(false, 0.0, 1e4, &[0.0, 0.4]),
                "exponent" if family == Family::HorizonSheen => {
                    add(true, 0.1, 1e4, &geometric(0.5, 30.0, 4));
                }
                "exponent" => add(true, 0.5, 1e6, &geometric(3.0, 3000.0, 6)),
                "roughness" if family == Family::Sheen => {
                    add(true, 0.01, 1.0, &geometric(0.1, 0.8, 3));
                }
                "alpha" | "roughness" => add(true, 1e-3, 2.0, &geometric(0.03, 0.6, 5)),
                "ior" => add(false, 1.01, 10.0, &[1.5]),
                "eta" => add(true, 1e-3, 100.0, &[0.3, 1.5]),
                "k" => add(true, 1e-3, 100.0, &[2.5]),
                "sigma_deg" => add(false, 0.0, 90.0, &[10.0, 30.0]),
                _ => {}
            }
        }
        Self {
            family,
            template,
            free,
        }
    }

    /// Name of the family.
    pub(crate) fn name(&self) -> &'static str {
        self.family.name()
    }

    /// Number of free parameters.
    pub(crate) fn len(&self) -> usize {
        self.free.len()
    }

    /// Every combination of start values, as the minimiser's variables.
    pub(crate) fn starts(&self) -> Vec<Vec<f64>> {
        let mut all: Vec<Vec<f64>> = vec![Vec::new()];
        for free in &self.free {
            let inward = |v: f64| if free.log { v.ln() } else { v };
            all = all
                .iter()
                .flat_map(|c| {
                    let values = free.starts.iter();
                    values.map(move |v| [c.as_slice(), &[inward(*v)]].concat())
                })
                .collect();
        }
        all
    }

    /// The smallest Σ r² from `start`.
    pub(crate) fn minimise(
        &self,
        start: &[f64],
        residuals: &dyn Fn(&[f64], &mut Vec<f64>),
    ) -> Minimum {
        let bounds: Vec<(f64, f64)> = self
            .free
            .iter()
            .map(|f| {
                if f.log {
                    (f.low.ln(), f.high.ln())
                } else {
                    (f.low, f.high)
                }
            })
            .collect();
        minimise(start, &bounds, residuals)
    }

    fn values(&self, x: &[f64]) -> Vec<f64> {
        let mut values = self.template.clone();
        for (free, x) in self.free.iter().zip(x) {
            values[free.slot] = if free.log { x.exp() } else { *x };
        }
        values
    }

    /// `scale` times the model at the minimiser's variables.
    pub(crate) fn build(&self, x: &[f64], scale: f64) -> Arc<dyn Brdf> {
        let values = self.values(x);
        let n = values.len() - 1;
        Arc::new(Layered {
            lambert: scale * values[n],
            scale,
            base: self.family.build(&values[..n]),
        })
    }

    /// The parameters of `scale` times the model with their variances over the minimiser's variables. What only the
    /// scale decides has no σ.
    pub(crate) fn report(
        &self,
        x: &[f64],
        variance: &[Option<f64>],
        scale: f64,
    ) -> Vec<FittedParameter> {
        let values = self.values(x);
        let n = values.len() - 1;
        // A dielectric's coat has the strength that its index gives: the factor stands on its own.
        let own_factor = matches!(self.family, Family::TorranceSparrow | Family::GgxDielectric);
        let factor = |name: &str| match name {
            "lambert" => scale,
            "diffuse" | "specular" | "sheen" | "albedo" if !own_factor => scale,
            _ => 1.0,
        };
        let names = self.family.parameters().iter().map(|p| p.name);
        let mut parameters: Vec<FittedParameter> = names
            .chain(["lambert"])
            .enumerate()
            .filter(|(slot, _)| *slot < n || self.free.iter().any(|f| f.slot == n))
            .map(|(slot, name)| {
                let at = self.free.iter().position(|f| f.slot == slot);
                let slope = match at.and_then(|i| self.free.get(i)) {
                    Some(free) if free.log => values[slot],
                    _ => 1.0,
                };
                let variance = at.and_then(|i| variance.get(i).copied().flatten());
                FittedParameter {
                    name: name.to_string(),
                    value: factor(name) * values[slot],
                    sigma: variance.map(|v| v.sqrt() * slope * factor(name)),
                }
            })
            .collect();
        if own_factor {
            parameters.push(FittedParameter {
                name: "scale".into(),
                value: scale,
                sigma: None,
            });
        }
        parameters
    }
}
