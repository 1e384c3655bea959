//! The fit of one channel, and what is read from it: values, spectrum, bounds, status.

use std::f64::consts::{FRAC_PI_2, PI};

use faer::Mat;
use num_complex::Complex64;

use super::basis::Basis;
use super::estimate::{Coefficient, Status};
use super::information::Information;
use super::posterior::{self, Posterior};
use super::prior::{Factor, Penalties, Relief, Smoothness};
use super::{COARSE, spectrum};
use crate::Result;

/// How many times the largest value of the slice a coefficient may be in the problem without smoothness.
const VAGUE: f64 = 100.0;

/// White prior that allows coefficients of [`VAGUE`] times `largest`.
pub fn vague(basis: Basis, largest: f64) -> Smoothness {
    let size = VAGUE * largest.max(f64::MIN_POSITIVE.sqrt());
    Smoothness {
        amplitude: (basis.spacing() * size).powi(-2),
        across: 0.0,
        along: 0.0,
    }
}

/// Status of a quantity from its bound, its posterior and its prior standard deviation.
fn classify(bound: f64, sigma: f64, prior: f64) -> Status {
    if bound <= 0.5 * prior && bound <= 10.0 * sigma {
        Status::Determined
    } else if sigma <= 0.5 * prior {
        Status::Weak
    } else {
        Status::Indeterminate
    }
}

/// A finished fit, to be read out.
pub struct Fit {
    /// The samples.
    pub information: Information,
    /// Coefficients and covariance.
    pub posterior: Posterior,
    /// Σ residual²/σ², by the variances as given.
    pub chi_square: f64,
    /// Effective number of parameters.
    pub parameters: f64,
    /// Factor on all variances.
    pub noise: f64,
    smoothness: Smoothness,
    relief: Relief,
}

/// Values on a grid of cells, \[θi′\]\[θo′\], size².
pub struct GridValues {
    /// ρ̃.
    pub values: Vec<f64>,
    /// Posterior standard deviation.
    pub sigma: Vec<f64>,
    /// Cramér–Rao bound without smoothness.
    pub bound: Vec<f64>,
    /// Status.
    pub status: Vec<Status>,
    /// Factor of the problem without smoothness.
    pub vague: Factor,
}

impl Fit {
    /// Solves for the coefficients; where the residual is larger than the variances of the samples allow, with all of
    /// them scaled up.
    ///
    /// # Errors
    /// If the normal equations cannot be factored.
    pub fn new(
        information: Information,
        smoothness: Smoothness,
        relief: Relief,
        non_negative: bool,
    ) -> Result<Self> {
        let penalties = Penalties::new(information.basis, &relief);
        let pairs = information.basis.pairs() as f64;
        let count = information.count as f64;
        let solve = |noise: f64| -> Result<(Posterior, f64, f64)> {
            let posterior =
                Posterior::new(&information, &penalties, &smoothness, noise, non_negative)?;
            let chi_square = information.chi_square(&posterior.mean);
            let parameters = pairs - penalties.trace(&smoothness, &posterior.covariance);
            Ok((posterior, chi_square, parameters))
        };
        let mut noise = 1.0;
        let (mut posterior, mut chi_square, mut parameters) = solve(noise)?;
        let free = count - parameters;
        // With few samples to spare the residual says nothing about the noise. Else, beyond five standard
        // deviations of χ² the variances are too small, or the model is wrong.
        if free > 0.05 * count && chi_square / free > 1.0 + 5.0 * (2.0 / free).sqrt() {
            noise = chi_square / free;
            drop(posterior);
            (posterior, chi_square, parameters) = solve(noise)?;
        }
        Ok(Self {
            information,
            posterior,
            chi_square,
            parameters,
            noise,
            smoothness,
            relief,
        })
    }

    /// The splines.
    pub fn basis(&self) -> Basis {
        self.information.basis
    }

    /// The prior's factor on splines coarse enough that it costs little.
    fn prior(&self) -> Result<(Basis, Factor)> {
        let basis = Basis::new(COARSE.min(self.basis().intervals()));
        let mut matrix = Mat::zeros(basis.pairs(), basis.pairs());
        Penalties::new(basis, &self.relief).add_dense(&self.smoothness, &mut matrix);
        Ok((basis, Factor::new(&matrix)?))
    }

    /// Values of the slice at size² cells.
    ///
    /// # Errors
    /// If the problem without smoothness cannot be factored.
    pub fn grid(&self, size: usize) -> Result<GridValues> {
        let angle = |k: usize| -FRAC_PI_2 + (k as f64 + 0.5) * PI / size as f64;
        let mut values = vec![0.0; size * size];
        for i in 0..size {
            for j in 0..=i {
                let v = posterior::apply(
                    &posterior::value_at(self.basis(), angle(i), angle(j)),
                    &self.posterior.mean,
                );
                values[i * size + j] = v;
                values[j * size + i] = v;
            }
        }
        let largest = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let mut matrix = self.information.dense(1.0 / self.noise);
        Penalties::new(self.basis(), &Relief::flat(self.basis()))
            .add_dense(&vague(self.basis(), largest), &mut matrix);
        let vague = Factor::new(&matrix)?;
        drop(matrix);
        let free = vague.inverse();
        let (prior_basis, prior) = self.prior()?;
        let prior = prior.inverse();
        let mut sigma = vec![0.0; size * size];
        let mut bound = sigma.clone();
        let mut status = vec![Status::Indeterminate; size * size];
        for i in 0..size {
            for j in 0..=i {
                let functional = posterior::value_at(self.basis(), angle(i), angle(j));
                let s = posterior::variance(&functional, &self.posterior.covariance).sqrt();
                let b = posterior::variance(&functional, &free).sqrt();
                let p = posterior::variance(
                    &posterior::value_at(prior_basis, angle(i), angle(j)),
                    &prior,
                )
                .sqrt();
                // Non-negativity narrows σ even where nothing was seen, so the status is by the σ without it.
                let told = match &self.posterior.unconstrained {
                    Some((_, wider)) => posterior::variance(&functional, wider).sqrt(),
                    None => s,
                };
                for k in [i * size + j, j * size + i] {
                    sigma[k] = s;
                    bound[k] = b;
                    status[k] = classify(b, told, p);
                }
            }
        }
        Ok(GridValues {
            values,
            sigma,
            bound,
            status,
            vague,
        })
    }

    /// Fourier coefficients up to `order`; `vague` is the factor of the problem without smoothness.
    ///
    /// # Errors
    /// If the prior cannot be factored.
    pub fn spectrum(&self, order: usize, vague: &Factor) -> Result<Vec<Coefficient>> {
        let functionals = spectrum::functionals(self.basis(), order);
        let sigma = spectrum::sigmas(&functionals, &self.posterior.factor);
        let bound = spectrum::sigmas(&functionals, vague);
        let told = match &self.posterior.unconstrained {
            Some((wider, _)) => spectrum::sigmas(&functionals, wider),
            None => sigma.clone(),
        };
        let (prior_basis, prior) = self.prior()?;
        let prior = spectrum::sigmas(&spectrum::functionals(prior_basis, order), &prior);
        let x = &self.posterior.mean;
        let dot = |j: usize| -> f64 { functionals.col(j).iter().zip(x).map(|(w, x)| w * x).sum() };
        Ok(spectrum::indices(order)
            .into_iter()
            .enumerate()
            .map(|(k, (p, q))| Coefficient {
                p,
                q,
                value: Complex64::new(dot(2 * k), dot(2 * k + 1)),
                sigma: sigma[k],
                bound: bound[k],
                status: classify(bound[k], told[k], prior[k]),
            })
            .collect())
    }
}
