//! The fit of one channel, and what is read from it: values, spectrum, bounds, status.

use std::f64::consts::{FRAC_PI_2, PI};

use faer::Mat;
use num_complex::Complex64;

use super::basis::{Basis, END_SHAPES};
use super::estimate::Coefficient;
use super::information::Information;
use super::posterior::{self, Posterior};
use super::prior::{Factor, Penalties, Relief, Smoothness};
use super::spectrum;
use crate::Result;
use crate::lighting::Status;

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

/// Status of a quantity from its bound, its σ, and its standard deviation with and without samples under the prior
/// of limited reach.
fn classify(bound: f64, sigma: f64, told: f64, prior: f64) -> Status {
    if bound <= 0.5 * prior && bound <= 10.0 * sigma {
        Status::Determined
    } else if told <= 0.5 * prior {
        Status::Weak
    } else {
        Status::Indeterminate
    }
}

/// What prior and samples say on coarse splines, when the prior reaches no farther than it may.
pub struct Reach {
    basis: Basis,
    /// The prior alone.
    prior: Factor,
    /// Prior and samples, without non-negativity: that narrows σ even where nothing was seen.
    told: Factor,
}

impl Reach {
    /// From the samples on coarse splines, and the prior with its correlation lengths held to `longest`.
    ///
    /// # Errors
    /// If the matrices cannot be factored.
    pub fn new(
        information: &Information,
        smoothness: &Smoothness,
        relief: &Relief,
        longest: f64,
    ) -> Result<Self> {
        let basis = information.basis;
        let most = smoothness.amplitude * longest.powi(6);
        let limited = Smoothness {
            amplitude: smoothness.amplitude,
            across: smoothness.across.min(most),
            along: smoothness.along.min(most),
        };
        let mut matrix = Mat::zeros(basis.pairs(), basis.pairs());
        Penalties::new(basis, relief).add_dense(&limited, &mut matrix);
        let prior = Factor::new(&matrix)?;
        matrix += information.dense(1.0);
        let told = Factor::new(&matrix)?;
        Ok(Self { basis, prior, told })
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
        relief: &Relief,
        non_negative: bool,
    ) -> Result<Self> {
        let penalties = Penalties::new(information.basis, relief);
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
        })
    }

    /// The splines.
    pub fn basis(&self) -> Basis {
        self.information.basis
    }

    /// Largest error of the splines in units of σ, estimated from the sixth differences of their coefficients:
    /// quintic splines miss h⁶ f⁽⁶⁾/46080 in each angle.
    pub fn spline_error(&self) -> f64 {
        let basis = self.basis();
        let x = &self.posterior.mean;
        let binomials = [1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0];
        let mut largest = 0.0f64;
        // Where the splines are equally spaced.
        let edge = END_SHAPES + 3;
        for m in edge..basis.len() - edge {
            for n in edge..=m {
                let difference = |step: &dyn Fn(usize) -> usize| -> f64 {
                    (0..7).map(|k| binomials[k] * x[step(k)]).sum()
                };
                let across_m = difference(&|k| basis.pair(m + k - 3, n));
                let across_n = difference(&|k| basis.pair(m, n + k - 3));
                let error = (across_m.abs() + across_n.abs()) / 46080.0;
                let here = posterior::value_at(basis, basis.centre(m), basis.centre(n));
                let variance = posterior::variance(&here, &self.posterior.covariance);
                largest = largest.max(error / variance.sqrt().max(f64::MIN_POSITIVE));
            }
        }
        largest
    }

    /// Values of the slice at size² cells.
    ///
    /// # Errors
    /// If the problem without smoothness cannot be factored.
    pub fn grid(&self, size: usize, reach: &Reach) -> Result<GridValues> {
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
        let (prior, told) = (reach.prior.inverse(), reach.told.inverse());
        let mut sigma = vec![0.0; size * size];
        let mut bound = sigma.clone();
        let mut status = vec![Status::Indeterminate; size * size];
        for i in 0..size {
            for j in 0..=i {
                let functional = posterior::value_at(self.basis(), angle(i), angle(j));
                let s = posterior::variance(&functional, &self.posterior.covariance).sqrt();
                let b = posterior::variance(&functional, &free).sqrt();
                let coarse = posterior::value_at(reach.basis, angle(i), angle(j));
                let p = posterior::variance(&coarse, &prior).sqrt();
                let t = posterior::variance(&coarse, &told).sqrt();
                for k in [i * size + j, j * size + i] {
                    sigma[k] = s;
                    bound[k] = b;
                    status[k] = classify(b, s, t, p);
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
    pub fn spectrum(
        &self,
        order: usize,
        vague: &Factor,
        reach: &Reach,
    ) -> Result<Vec<Coefficient>> {
        let functionals = spectrum::functionals(self.basis(), order);
        let sigma = spectrum::sigmas(&functionals, &self.posterior.factor);
        let bound = spectrum::sigmas(&functionals, vague);
        let coarse = spectrum::functionals(reach.basis, order);
        let prior = spectrum::sigmas(&coarse, &reach.prior);
        let told = spectrum::sigmas(&coarse, &reach.told);
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
                status: classify(bound[k], sigma[k], told[k], prior[k]),
            })
            .collect())
    }
}
