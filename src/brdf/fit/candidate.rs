//! One model as a candidate: which parameters are free, where to start, and its best fit.

use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::super::{Brdf, Family, Isotropic};
use super::minimise::{Minimum, minimise};
use super::{FitOptions, FittedParameter, ModelFit, SlicePoint};
use crate::angle::LocalAngle;

/// Points that the search for a start looks at; the last fit takes all.
const START_POINTS: usize = 1500;

/// Starts that are followed to their minimum.
const STARTS: usize = 3;

/// How a parameter enters.
#[derive(Clone, Debug)]
enum Role {
    /// ρ is linear in it; solved for at every start.
    Linear,
    /// Positive, fitted by its logarithm; the values to start from.
    Log(Vec<f64>),
    /// Fitted as it is; the values to start from.
    Plain(Vec<f64>),
    /// Held at this value.
    Fixed(f64),
}

#[derive(Clone, Debug)]
struct Slot {
    name: &'static str,
    role: Role,
    low: f64,
    high: f64,
}

/// ρ = lambert/π + scale · ρ_family(values).
#[derive(Debug)]
pub(super) struct Layered {
    pub lambert: f64,
    pub scale: f64,
    pub base: Arc<dyn Isotropic>,
}

impl Brdf for Layered {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        if incident.visible_cosine() > 0.0 && exitant.visible_cosine() > 0.0 {
            self.lambert * FRAC_1_PI + self.scale * self.base.value(incident, exitant)
        } else {
            0.0
        }
    }

    fn mirror(&self, exitant: LocalAngle) -> f64 {
        self.scale * self.base.mirror(exitant)
    }

    fn lobe_width(&self) -> f64 {
        self.base.lobe_width()
    }

    fn grazing_width(&self) -> f64 {
        self.base.grazing_width()
    }

    fn kinks(&self, exitant: LocalAngle) -> Vec<f64> {
        self.base.kinks(exitant)
    }
}

/// A fitted model from its name and its parameters; `None` if one is missing.
pub(super) fn built(model: &str, parameters: &[FittedParameter]) -> Option<Arc<dyn Brdf>> {
    let value = |name: &str| parameters.iter().find(|p| p.name == name).map(|p| p.value);
    Family::ALL
        .into_iter()
        .filter(|family| family.name() == model)
        .find_map(|family| {
            let values: Option<Vec<f64>> =
                family.parameters().iter().map(|p| value(p.name)).collect();
            Some(Arc::new(Layered {
                lambert: value("lambert").unwrap_or(0.0),
                scale: value("scale").unwrap_or(1.0),
                base: family.build(&values?),
            }) as Arc<dyn Brdf>)
        })
}

/// A model to be fitted.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    family: Family,
    /// The family's parameters, then `lambert` and `scale`.
    slots: Vec<Slot>,
}

/// `n` ≥ 2 values from `low` to `high`, each the same factor from the next.
pub(super) fn geometric(low: f64, high: f64, n: usize) -> Vec<f64> {
    (0..n)
        .map(|k| low * (high / low).powf(k as f64 / (n - 1) as f64))
        .collect()
}

impl Candidate {
    /// Every family but the mirror, whose delta no table holds. Metals are given a Lambertian part (a diffuse or velvet
    /// model has one already), and on an absolute scale they come twice: bare, and with a free factor `specular`.
    pub(super) fn all(absolute: bool) -> Vec<Self> {
        let families = Family::ALL.into_iter().filter(|f| *f != Family::Mirror);
        let mut all: Vec<Self> = families.map(|f| Self::new(f, absolute)).collect();
        if absolute {
            let mut bare = Self::new(Family::GgxConductor, true);
            for slot in bare.slots.iter_mut().filter(|s| s.name == "specular") {
                slot.role = Role::Fixed(1.0);
            }
            all.push(bare);
        }
        all
    }

    /// One family as a candidate.
    pub(super) fn new(family: Family, absolute: bool) -> Self {
        let role = |name: &str| match name {
            "diffuse" | "albedo" | "sheen" => Role::Linear,
            "specular" => Role::Linear,
            "exponent" if family == Family::HorizonSheen => Role::Log(geometric(0.5, 60.0, 8)),
            "exponent" => Role::Log(geometric(1.0, 8000.0, 16)),
            "alpha" => Role::Log(geometric(0.012, 1.0, 12)),
            "roughness" if family == Family::Sheen => Role::Log(geometric(0.06, 1.0, 8)),
            "roughness" => Role::Log(geometric(0.012, 1.0, 12)),
            "ior" => Role::Plain(vec![1.2, 1.5, 2.0]),
            "eta" => Role::Log(vec![0.15, 0.6, 2.0]),
            "k" => Role::Log(vec![0.5, 2.0, 4.5]),
            "sigma_deg" => Role::Plain(vec![3.0, 10.0, 20.0, 30.0, 45.0]),
            _ => Role::Plain(vec![1.0]),
        };
        let mut slots: Vec<Slot> = family
            .parameters()
            .iter()
            .map(|p| Slot {
                name: p.name,
                role: role(p.name),
                low: p.low,
                high: p.high,
            })
            .collect();
        for slot in &mut slots {
            if matches!(slot.name, "eta" | "k") {
                // The logarithm needs a limit above 0.
                slot.low = 1e-3;
            }
        }
        let mut extra = |name, used: bool, fixed| {
            slots.push(Slot {
                name,
                role: if used {
                    Role::Linear
                } else {
                    Role::Fixed(fixed)
                },
                low: 0.0,
                high: f64::INFINITY,
            });
        };
        extra("lambert", family == Family::GgxConductor, 0.0);
        let indexed = matches!(family, Family::TorranceSparrow | Family::GgxDielectric);
        extra("scale", indexed && !absolute, 1.0);
        Self { family, slots }
    }

    /// Whether it is a form of `family`.
    #[cfg(test)]
    pub(super) fn is_of(&self, family: Family) -> bool {
        self.family == family
    }

    /// The model with a value for each slot.
    fn build(&self, values: &[f64]) -> Layered {
        let n = self.slots.len() - 2;
        Layered {
            lambert: values[n],
            scale: values[n + 1],
            base: self.family.build(&values[..n]),
        }
    }

    fn free(&self) -> Vec<usize> {
        (0..self.slots.len())
            .filter(|&k| !matches!(self.slots[k].role, Role::Fixed(_)))
            .collect()
    }

    /// From the minimiser's variable to the parameter.
    fn outward(&self, slot: usize, x: f64) -> f64 {
        match self.slots[slot].role {
            Role::Log(_) => x.exp(),
            _ => x,
        }
    }

    fn inward(&self, slot: usize, value: f64) -> f64 {
        match self.slots[slot].role {
            Role::Log(_) => value.max(f64::MIN_POSITIVE).ln(),
            _ => value,
        }
    }

    /// The best fit to `points` (all valid, at least as many as parameters).
    pub(super) fn fit(&self, points: &[SlicePoint], options: FitOptions) -> ModelFit {
        let few = thin(points, START_POINTS);
        let mut minima: Vec<Minimum> = self
            .starts(&few)
            .iter()
            .map(|start| self.descend(&few, start))
            .collect();
        minima.sort_by(|a, b| a.chi_square.total_cmp(&b.chi_square));
        let start = minima.first().map_or_else(Vec::new, |m| m.x.clone());
        let minimum = if few.len() < points.len() || minima.is_empty() {
            self.descend_from(points, &start)
        } else {
            minima.swap_remove(0)
        };
        self.report(points, &minimum, options)
    }

    fn descend(&self, points: &[SlicePoint], values: &[f64]) -> Minimum {
        let start: Vec<f64> = self
            .free()
            .iter()
            .map(|&k| self.inward(k, values[k]))
            .collect();
        self.descend_from(points, &start)
    }

    fn descend_from(&self, points: &[SlicePoint], start: &[f64]) -> Minimum {
        let free = self.free();
        let bounds: Vec<(f64, f64)> = free
            .iter()
            .map(|&k| {
                let slot = &self.slots[k];
                (self.inward(k, slot.low), self.inward(k, slot.high))
            })
            .collect();
        let residuals = |x: &[f64], r: &mut Vec<f64>| {
            let model = self.build(&self.values(x));
            r.clear();
            r.extend(
                points
                    .iter()
                    .map(|p| (model.value(p.incident, p.exitant) - p.rho) / p.variance.sqrt()),
            );
        };
        minimise(start, &bounds, &residuals)
    }

    /// All slots' values from the free ones' variables.
    fn values(&self, x: &[f64]) -> Vec<f64> {
        let mut x = x.iter();
        (0..self.slots.len())
            .map(|k| match self.slots[k].role {
                Role::Fixed(value) => value,
                _ => x.next().map_or(0.0, |x| self.outward(k, *x)),
            })
            .collect()
    }

    /// The most promising combinations of start values, the linear parameters solved for.
    fn starts(&self, points: &[SlicePoint]) -> Vec<Vec<f64>> {
        let mut combinations: Vec<Vec<f64>> = vec![Vec::new()];
        for slot in &self.slots {
            let choices = match &slot.role {
                Role::Linear => vec![0.0],
                Role::Fixed(value) => vec![*value],
                Role::Log(values) | Role::Plain(values) => values.clone(),
            };
            combinations = combinations
                .iter()
                .flat_map(|c| choices.iter().map(move |v| [c.as_slice(), &[*v]].concat()))
                .collect();
        }
        let mut solved: Vec<(f64, Vec<f64>)> = combinations
            .into_iter()
            .map(|values| self.solve_linear(points, values))
            .collect();
        solved.sort_by(|a, b| a.0.total_cmp(&b.0));
        solved.into_iter().take(STARTS).map(|(_, v)| v).collect()
    }

    /// Weighted least squares for the linear parameters, negative ones set to 0 in turn; returns χ² too.
    fn solve_linear(&self, points: &[SlicePoint], mut values: Vec<f64>) -> (f64, Vec<f64>) {
        let scale = self.slots.len() - 1;
        let scale_is_free = matches!(self.slots[scale].role, Role::Linear);
        let mut linear: Vec<usize> = (0..self.slots.len())
            .filter(|&k| matches!(self.slots[k].role, Role::Linear))
            .collect();
        let weight: Vec<f64> = points.iter().map(|p| 1.0 / p.variance.sqrt()).collect();
        let evaluate = |values: &[f64]| -> Vec<f64> {
            let model = self.build(values);
            let at = |p: &SlicePoint| model.value(p.incident, p.exitant);
            points.iter().zip(&weight).map(|(p, w)| w * at(p)).collect()
        };
        // With the scale at 1 and all else at 0: a free scale's own curve, else the part that is always there.
        for &k in &linear {
            values[k] = if k == scale { 1.0 } else { 0.0 };
        }
        let ground = evaluate(&values);
        let target: Vec<f64> = points
            .iter()
            .zip(&weight)
            .zip(&ground)
            .map(|((p, w), g)| w * p.rho - if scale_is_free { 0.0 } else { *g })
            .collect();
        let curves: Vec<Vec<f64>> = (0..self.slots.len())
            .map(|k| {
                if !linear.contains(&k) {
                    return Vec::new();
                }
                if k == scale {
                    return ground.clone();
                }
                let mut one = values.clone();
                one[k] = 1.0;
                evaluate(&one)
                    .iter()
                    .zip(&ground)
                    .map(|(v, g)| v - g)
                    .collect()
            })
            .collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut coefficients;
        loop {
            let n = linear.len();
            let matrix = DMatrix::from_fn(n, n, |i, j| {
                // A curve may vanish on the points: the tiny ridge keeps its coefficient at 0.
                let ridge = if i == j { 1e-12 } else { 0.0 };
                dot(&curves[linear[i]], &curves[linear[j]]) * (1.0 + ridge) + ridge * 1e-12
            });
            let right = DVector::from_fn(n, |i, _| dot(&curves[linear[i]], &target));
            coefficients = matrix
                .cholesky()
                .map_or_else(|| DVector::zeros(n), |c| c.solve(&right));
            let lowest = (0..n).min_by(|&a, &b| coefficients[a].total_cmp(&coefficients[b]));
            match lowest {
                Some(k) if coefficients[k] < 0.0 => {
                    linear.remove(k);
                }
                _ => break,
            }
        }
        let mut residual = target;
        let mut solution = values;
        if scale_is_free {
            solution[scale] = 0.0;
        }
        for (c, &k) in coefficients.iter().zip(&linear) {
            solution[k] = *c;
            for (r, v) in residual.iter_mut().zip(&curves[k]) {
                *r -= c * v;
            }
        }
        if scale_is_free && solution[scale] > 0.0 {
            // ρ = scale · (diffuse + …): the family's own factors were solved for as products with the scale.
            for &k in linear.iter().filter(|&&k| k + 2 < self.slots.len()) {
                solution[k] /= solution[scale];
            }
        }
        (dot(&residual, &residual), solution)
    }

    fn report(&self, points: &[SlicePoint], minimum: &Minimum, options: FitOptions) -> ModelFit {
        let free = self.free();
        let values = self.values(&minimum.x);
        let n = points.len() as f64;
        let k = free.len() as f64;
        let degrees_of_freedom = points.len().saturating_sub(free.len()).max(1);
        let reduced = minimum.chi_square / degrees_of_freedom as f64;
        // A misfit is an error too: it is spread over the parameters as if it were noise.
        let inflation = if options.known_variance {
            reduced.max(1.0)
        } else {
            reduced
        };
        let parameters = self
            .slots
            .iter()
            .enumerate()
            .filter(|(slot, s)| free.contains(slot) || s.name == "specular")
            .map(|(slot, s)| {
                let at = free.iter().position(|f| *f == slot);
                let variance = at.and_then(|i| minimum.variance.get(i).copied().flatten());
                let slope = match s.role {
                    Role::Log(_) => values[slot],
                    _ => 1.0,
                };
                FittedParameter {
                    name: s.name.to_string(),
                    value: values[slot],
                    sigma: variance.map(|v| (v * inflation).sqrt() * slope),
                }
            })
            .collect();
        let brdf: Arc<dyn Brdf> = Arc::new(self.build(&values));
        let (mut sum, mut largest) = (0.0, f64::MIN_POSITIVE);
        for p in points {
            let cosines = p.incident.visible_cosine() * p.exitant.visible_cosine();
            let misfit = (brdf.value(p.incident, p.exitant) - p.rho) * cosines;
            sum += misfit * misfit;
            largest = (p.rho * cosines).abs().max(largest);
        }
        // −2 ln(likelihood) up to what is common to all models.
        let deviance = if options.known_variance {
            minimum.chi_square
        } else {
            n * (minimum.chi_square / n).max(f64::MIN_POSITIVE).ln()
        };
        ModelFit {
            model: self.family.name().to_string(),
            parameters,
            chi_square: minimum.chi_square,
            degrees_of_freedom,
            relative_rms: (sum / n).sqrt() / largest,
            aic: deviance + 2.0 * k,
            bic: deviance + k * n.ln(),
            brdf,
        }
    }
}

/// At most `count` of the points: half of them evenly from all, half evenly from the twentieth with the largest ρ cos cos, where the lobe is.
fn thin(points: &[SlicePoint], count: usize) -> Vec<SlicePoint> {
    if points.len() <= count {
        return points.to_vec();
    }
    let every = |list: &[SlicePoint], n: usize| -> Vec<SlicePoint> {
        // A stride that is no divisor of the grid's width visits all its columns.
        let stride = list.len() as f64 / n as f64;
        (0..n)
            .filter_map(|k| list.get(((k as f64 + 0.5) * stride) as usize).copied())
            .collect()
    };
    let mut chosen = every(points, count / 2);
    let mut bright = points.to_vec();
    let tilde = |p: &SlicePoint| p.rho * p.incident.visible_cosine() * p.exitant.visible_cosine();
    bright.sort_by(|a, b| tilde(b).total_cmp(&tilde(a)));
    bright.truncate((points.len() / 20).max(count / 2));
    chosen.extend(every(&bright, count / 2));
    chosen
}
