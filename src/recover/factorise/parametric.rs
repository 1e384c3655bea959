//! Lighting and an analytic model at once, fitted to the light field itself: for few views, much noise or few frequencies.
//!
//! For a model ρ_θ the samples are linear in the light, so the light is the regularised least-squares solution L̂(θ) of the normal
//! equations, and the fit is over θ alone (variable projection: G. H. Golub and V. Pereyra, SIAM J. Numer. Anal.
//! 10, 1973). The derivatives of the projected residuals count L̂'s own change, so their normal matrix is the information
//! on θ that is left when the light is unknown. The model's factor is not determined: every shape has one strength held at 1.
//!
//! The prior on the light is |L_p| ≤ L_0, as in the free factorisation: a variance of L_0²/2 per real part, with L_0 from the
//! mean of the light field under ρ_θ. A frequency that the model does not pass stays at that prior and is `indeterminate`.
//!
//! What is minimised is −2 ln of the likelihood averaged over that prior, χ² + Lᵀ Λ L + ln |A + Λ| − ln |Λ|. Without the
//! determinants a sharper lobe would always be favoured, since it lets more of the light fit the noise.
//!
//! BIC is this minimum + parameters · ln n. AIC is conditional on the light: χ² + 2 (parameters + tr (A + Λ)⁻¹A), in which the
//! light counts with its effective number of parameters.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rayon::prelude::*;

use super::scale::{Scale, source_irradiance};
use super::{DETERMINED, WEAK};
use crate::angle::LocalAngle;
use crate::brdf::Brdf;
use crate::brdf::fit::{FittedParameter, Minimum, Shape};
use crate::error::{Error, Result};
use crate::fourier::Series;
use crate::light_field::Samples;
use crate::lighting::Status;
use crate::recover::normal::{NormalSystem, position, to_series};

/// Frequencies of the light. Lobes that few views or much noise leave to be seen pass no more.
const ORDER: usize = 24;
/// Columns that the search for a start looks at; the last fit takes all.
const START_COLUMNS: usize = 24;
/// Starts that are followed to their minimum.
const STARTS: usize = 2;

/// One model's best fit to the light field of a channel, with the light that goes with it.
#[derive(Clone, Debug)]
pub struct ParametricFit {
    /// Name of the model as in a recipe.
    pub model: String,
    /// Its parameters in the given scale. No σ: at a limit, held, decided by the scale, or not determined by the light field.
    pub parameters: Vec<FittedParameter>,
    /// Σ (residual/σ)² over the samples.
    pub chi_square: f64,
    /// Number of samples.
    pub samples: usize,
    /// Effective number of the light's parameters.
    pub light_parameters: f64,
    /// Akaike's criterion: smaller is better.
    pub aic: f64,
    /// Schwarz' Bayesian criterion: smaller is better.
    pub bic: f64,
    /// The fitted BRDF.
    pub brdf: Arc<dyn Brdf>,
    /// L_p, W m⁻² rad⁻¹; 0 where indeterminate.
    pub lighting: Series,
    /// σ of L_p (of the complex number), for L_0 relative to the scale.
    pub sigma: Vec<f64>,
    /// How well L_p is known.
    pub status: Vec<Status>,
}

/// All models' fits to one channel.
#[derive(Clone, Debug)]
pub struct ParametricChannel {
    /// Channel name.
    pub name: String,
    /// The fits, in increasing BIC.
    pub fits: Vec<ParametricFit>,
    /// Index of the best by AIC.
    pub best_by_aic: usize,
}

/// Fits every analytic model with an unknown light to one channel.
///
/// # Errors
/// If there are fewer than 20 samples, or no model can be fitted in the given scale.
pub fn parametric(samples: &Samples, channel: usize, scale: &Scale) -> Result<ParametricChannel> {
    let name = samples.channels.get(channel).cloned().unwrap_or_default();
    let count = samples.count(channel);
    if count < 20 {
        return Err(Error::failed(format!(
            "expected at least 20 samples to fit models to in channel {name}, found {count}"
        )));
    }
    let all = Field {
        samples: one_channel(samples, channel, 1),
    };
    let few = Field {
        samples: one_channel(samples, channel, samples.columns.len() / START_COLUMNS),
    };
    let mut fits: Vec<ParametricFit> = Shape::all()
        .par_iter()
        .filter_map(|shape| all.fit(&few, shape))
        .filter_map(|fit| fit.scaled(scale, channel))
        .collect();
    fits.sort_by(|a, b| a.bic.total_cmp(&b.bic));
    if fits.is_empty() {
        return Err(Error::failed(format!(
            "no analytic model could be fitted to the light field of channel {name}"
        )));
    }
    let best_by_aic = (0..fits.len())
        .min_by(|&a, &b| fits[a].aic.total_cmp(&fits[b].aic))
        .unwrap_or(0);
    Ok(ParametricChannel {
        name,
        fits,
        best_by_aic,
    })
}

/// Every `stride`-th column of one channel.
fn one_channel(samples: &Samples, channel: usize, stride: usize) -> Samples {
    let columns = samples
        .columns
        .iter()
        .skip(stride / 2)
        .step_by(stride.max(1));
    Samples {
        channels: vec![samples.channels.get(channel).cloned().unwrap_or_default()],
        columns: columns
            .map(|c| crate::light_field::Column {
                local: c.local,
                alpha: c.alpha.clone(),
                view: c.view.clone(),
                value: vec![c.value[channel].clone()],
                variance: vec![c.variance[channel].clone()],
            })
            .collect(),
    }
}

/// The light that explains the field best on a given surface.
struct Projected {
    light: Vec<f64>,
    /// (A + Λ)⁻¹.
    covariance: Mat<f64>,
    /// tr (A + Λ)⁻¹ A.
    effective: f64,
    /// (predicted − measured) / σ, then √Λ L, then the root of ln |A + Λ| − ln |Λ|.
    residuals: Vec<f64>,
    /// Σ of the squares of the first.
    chi_square: f64,
}

/// The samples of one channel.
struct Field {
    samples: Samples,
}

impl Field {
    /// `None` if the surface reflects nothing that was seen.
    fn project(&self, brdf: &dyn Brdf) -> Option<Projected> {
        let samples = &self.samples;
        let system = NormalSystem::new(samples, 0, brdf, ORDER);
        // L_0 from the mean of every column, B_0 = L_0 H_0.
        let (mut product, mut square) = (0.0, 0.0);
        for (column, h) in samples.columns.iter().zip(&system.transfer) {
            let h = h.first().map_or(0.0, |h| h.re);
            for (b, v) in column.value[0].iter().zip(&column.variance[0]) {
                if v.is_finite() && *v > 0.0 {
                    product += h * b / v;
                    square += h * h / v;
                }
            }
        }
        let mean = product / square;
        if !(mean > 0.0 && mean.is_finite()) {
            return None;
        }
        let prior = 2.0 / (mean * mean);
        let size = 2 * ORDER + 1;
        let mut matrix = system.matrix.clone();
        for i in 1..size {
            matrix[(i, i)] += prior;
        }
        let factor = matrix.llt(Side::Lower).ok()?;
        let target = Mat::from_fn(size, 1, |i, _| system.vector[i]);
        let solved = factor.solve(&target);
        let light: Vec<f64> = (0..size).map(|i| solved[(i, 0)]).collect();
        let covariance = factor.solve(Mat::<f64>::identity(size, size));
        let effective = size as f64 - (1..size).map(|i| prior * covariance[(i, i)]).sum::<f64>();
        let predicted = system.predict(&to_series(&light));
        let mut residuals = Vec::with_capacity(system.count + size);
        for (column, predicted) in samples.columns.iter().zip(&predicted) {
            let measured = column.value[0].iter().zip(&column.variance[0]);
            for ((b, v), f) in measured.zip(predicted) {
                if v.is_finite() && *v > 0.0 {
                    residuals.push((f - b) / v.sqrt());
                }
            }
        }
        let chi_square = residuals.iter().map(|r| r * r).sum();
        residuals.extend(light.iter().skip(1).map(|l| prior.sqrt() * l));
        // Λ⁻¹ A, with mean² for the L_0 that has no prior: a number without a unit.
        let lower = factor.L();
        let determinant: f64 = (0..size)
            .map(|i| 2.0 * lower[(i, i)].ln() - if i == 0 { -2.0 * mean.ln() } else { prior.ln() })
            .sum();
        residuals.push(determinant.max(0.0).sqrt());
        Some(Projected {
            light,
            covariance,
            effective,
            residuals,
            chi_square,
        })
    }

    fn descend(&self, shape: &Shape, start: &[f64]) -> Minimum {
        // A shape that cannot be fitted is as far off as no light at all.
        let dark: Vec<f64> = self
            .samples
            .columns
            .iter()
            .flat_map(|c| c.value[0].iter().zip(&c.variance[0]))
            .filter(|(_, v)| v.is_finite() && **v > 0.0)
            .map(|(b, v)| b / v.sqrt())
            .chain(std::iter::repeat_n(0.0, 2 * ORDER + 1))
            .collect();
        shape.minimise(start, &|x, r| {
            r.clear();
            match self.project(shape.build(x, 1.0).as_ref()) {
                Some(found) => r.extend(found.residuals),
                None => r.extend_from_slice(&dark),
            }
        })
    }

    fn fit(&self, few: &Self, shape: &Shape) -> Option<Fitted> {
        let chi_square = |x: &Vec<f64>| {
            few.project(shape.build(x, 1.0).as_ref())
                .map(|p| p.residuals.iter().map(|r| r * r).sum::<f64>())
        };
        let mut starts: Vec<(f64, Vec<f64>)> = shape
            .starts()
            .into_iter()
            .filter_map(|x| Some((chi_square(&x)?, x)))
            .collect();
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let best = starts
            .iter()
            .take(STARTS)
            .map(|(_, x)| few.descend(shape, x))
            .min_by(|a, b| a.chi_square.total_cmp(&b.chi_square))?;
        let minimum = self.descend(shape, &best.x);
        let at = self.project(shape.build(&minimum.x, 1.0).as_ref())?;
        // What the model's own uncertainty adds to the light's: (∂L/∂θ)² var θ, parameter by parameter.
        let mut variance: Vec<f64> = (0..at.light.len()).map(|i| at.covariance[(i, i)]).collect();
        for (k, v) in minimum.variance.iter().enumerate() {
            let Some(sigma) = v.map(f64::sqrt) else {
                continue;
            };
            let mut moved = minimum.x.clone();
            moved[k] += sigma;
            if let Some(other) = self.project(shape.build(&moved, 1.0).as_ref()) {
                // The factor between light and model is the scale's: L_0 is held.
                let ratio = at.light[0] / other.light[0];
                for ((v, a), b) in variance.iter_mut().zip(&at.light).zip(&other.light) {
                    *v += (ratio * b - a).powi(2);
                }
            }
        }
        Some(Fitted {
            shape: shape.clone(),
            samples: self.samples.count(0),
            minimum,
            light: at.light,
            variance,
            effective: at.effective,
            chi_square: at.chi_square,
        })
    }
}

/// A fit before its scale.
struct Fitted {
    shape: Shape,
    samples: usize,
    minimum: Minimum,
    light: Vec<f64>,
    variance: Vec<f64>,
    effective: f64,
    chi_square: f64,
}

impl Fitted {
    /// `None` if the scale asks for a light or a surface below 0.
    fn scaled(self, scale: &Scale, channel: usize) -> Option<ParametricFit> {
        let minimum = &self.minimum;
        let light = to_series(&self.light);
        let mean = light.get(0).re;
        let unscaled = self.shape.build(&minimum.x, 1.0);
        let value = |values: &[f64]| values.get(channel).copied().unwrap_or(f64::NAN);
        // The factor on the light.
        let factor = match scale {
            Scale::Unit => 1.0 / mean,
            Scale::TotalIrradiance(values) => value(values) / (TAU * mean),
            Scale::Source { theta, irradiance } => {
                value(irradiance) / source_irradiance(&light, ORDER, *theta)
            }
            Scale::Albedo(values) => planar_albedo(unscaled.as_ref()) / value(values),
        };
        if !(factor > 0.0 && factor.is_finite()) {
            return None;
        }
        let degrees = (self.samples as f64 - self.effective - self.shape.len() as f64).max(1.0);
        // A misfit is an error too: it is spread over the parameters as if it were noise.
        let inflation = (self.chi_square / degrees).max(1.0);
        let sigma: Vec<f64> = (0..=ORDER)
            .map(|p| {
                let i = position(p);
                let both = if p == 0 {
                    0.0
                } else {
                    self.variance[i] + self.variance[i + 1]
                };
                (both * inflation).sqrt()
            })
            .collect();
        let status: Vec<Status> = sigma
            .iter()
            .map(|s| match s / mean {
                s if s <= DETERMINED => Status::Determined,
                s if s <= WEAK => Status::Weak,
                _ => Status::Indeterminate,
            })
            .collect();
        let mut lighting = light;
        for (l, s) in lighting.coefficients.iter_mut().zip(&status) {
            *l *= if *s == Status::Indeterminate {
                0.0
            } else {
                factor
            };
        }
        let variance: Vec<Option<f64>> = minimum
            .variance
            .iter()
            .map(|v| v.map(|v| v * inflation))
            .collect();
        let parameters = self.shape.len() as f64;
        Some(ParametricFit {
            model: self.shape.name().to_string(),
            parameters: self.shape.report(&minimum.x, &variance, 1.0 / factor),
            chi_square: self.chi_square,
            samples: self.samples,
            light_parameters: self.effective,
            aic: self.chi_square + 2.0 * (parameters + self.effective),
            bic: minimum.chi_square + parameters * (self.samples as f64).ln(),
            brdf: self.shape.build(&minimum.x, 1.0 / factor),
            lighting,
            sigma: sigma.iter().map(|s| s * factor).collect(),
            status,
        })
    }
}

/// (π/4) ∫∫ ρ cos θi′ cos θo′ dθi′ dθo′, the albedo of a Lambertian surface of equal reflection in the plane.
fn planar_albedo(brdf: &dyn Brdf) -> f64 {
    const NODES: usize = 180;
    let step = PI / NODES as f64;
    let angle = |k: usize| LocalAngle::radians(-FRAC_PI_2 + (k as f64 + 0.5) * step);
    let sum: f64 = (0..NODES)
        .map(|k| {
            let row = crate::brdf::transfer_row(brdf, angle(k), 0);
            row.first().map_or(0.0, |h| h.re) * angle(k).visible_cosine()
        })
        .sum();
    PI / 4.0 * sum * step
}

#[cfg(test)]
mod tests {
    use super::super::study::{GGX_02, Light, PHONG_32, all_around, brdf, error, two_suns, views};
    use super::super::{Options, recover};
    use super::*;

    /// A model with a Lambertian part of albedo 0.3 added.
    #[derive(Debug)]
    struct Layered(Arc<dyn Brdf>);

    impl Brdf for Layered {
        fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
            self.0.value(incident, exitant) + 0.3 / PI
        }

        fn lobe_width(&self) -> f64 {
            self.0.lobe_width()
        }

        fn grazing_width(&self) -> f64 {
            self.0.grazing_width()
        }
    }

    /// `count` views with noise of 3 % of the largest value.
    fn few_views(surface: &dyn Brdf, light: &Light, count: usize) -> Samples {
        views(light, surface, &all_around(count), 60, 80.0, 0.03, 3)
    }

    fn within(fit: &ParametricFit, name: &str, truth: f64) {
        let p = fit.parameters.iter().find(|p| p.name == name);
        let p = p.expect("a parameter");
        let sigma = p.sigma.expect("a determined parameter");
        assert!(
            (p.value - truth).abs() < 3.0 * sigma && sigma < 0.5 * truth,
            "{p:?}, planted {truth}"
        );
    }

    /// Mean square of the deviations of p = 1 … 5 in units of σ: for 5 of them 3 is exceeded in 0.1 %.
    fn light_within(fit: &ParametricFit, truth: &Series) {
        let square = (1..=5).map(|p| {
            let off = (fit.lighting.coefficients[p] - truth.coefficients[p]).norm();
            (off / fit.sigma[p]).powi(2)
        });
        let mean = square.sum::<f64>() / 5.0;
        assert!(mean < 3.0, "{mean}");
    }

    #[test]
    fn a_metal_is_recognised_in_twelve_noisy_views() {
        let light = Light::Real(two_suns());
        let samples = few_views(&Layered(brdf(GGX_02)), &light, 12);
        let found = parametric(&samples, 0, &Scale::Unit).expect("fits");
        let truth = light.series(12);
        let named = |name: &str| found.fits.iter().find(|f| f.model == name).expect("a fit");
        // In the plane a metal and a dielectric of a high index are one shape; others are far off.
        assert!(found.fits[0].model.starts_with("ggx-"), "{found:?}");
        assert!(named("phong").bic > named("ggx-conductor").bic + 100.0);
        let metal = named("ggx-conductor");
        within(metal, "alpha", 0.2);
        within(metal, "lambert", 0.3);
        light_within(metal, &truth);
        let free = recover(&samples, &Options::default()).expect("a factorisation");
        let (with, without) = (
            error(&metal.lighting, &truth, 5),
            error(&free.channels[0].lighting, &truth, 5),
        );
        assert!(with < 0.7 * without, "{with} {without}");
    }

    #[test]
    fn a_gloss_is_recognised_in_twelve_noisy_views() {
        let light = Light::Real(two_suns());
        let samples = few_views(brdf(PHONG_32).as_ref(), &light, 12);
        let found = parametric(&samples, 0, &Scale::Unit).expect("fits");
        // In the plane Blinn's lobe of four times the exponent is nearly Phong's.
        assert!(["phong", "blinn"].contains(&found.fits[0].model.as_str()));
        let gloss = found.fits.iter().find(|f| f.model == "phong");
        let gloss = gloss.expect("a fit");
        within(gloss, "exponent", 32.0);
        within(gloss, "diffuse", 0.3);
        light_within(gloss, &light.series(12));
    }

    /// cos 3θ and higher odd frequencies are invisible to a Lambertian surface (eq. 23).
    #[test]
    fn a_diffuse_surface_is_recognised_and_odd_frequencies_stay_open() {
        let light = Light::Real(two_suns());
        let diffuse = brdf("model = 'lambertian'\nalbedo = 0.6");
        let samples = few_views(diffuse.as_ref(), &light, 24);
        let scale = Scale::Albedo(vec![0.6]);
        let found = parametric(&samples, 0, &scale).expect("fits");
        let best = &found.fits[0];
        assert_eq!(best.model, "lambertian");
        assert!((best.parameters[0].value - 0.6).abs() < 1e-4, "{best:?}");
        for p in [3, 5, 7, 9] {
            assert_eq!(best.status[p], Status::Indeterminate);
            assert_eq!(best.lighting.coefficients[p].norm(), 0.0);
        }
        assert_ne!(best.status[2], Status::Indeterminate);
        // Where nothing is known the estimate is 0 with the prior's σ, which covers any light.
        light_within(best, &light.series(5));
    }
}
