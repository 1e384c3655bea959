//! The fit of one channel, and what is read from it: values, spectrum, bounds, status.

use std::f64::consts::{FRAC_PI_2, PI};

use faer::Mat;
use num_complex::Complex64;
use rayon::prelude::*;

use super::basis::{Basis, END_SHAPES};
use super::estimate::Coefficient;
use super::information::Information;
use super::posterior::{self, Posterior};
use super::prior::{Factor, Penalties, Precision, Relief, Smoothness};
use super::spectrum;
use super::spread::{self, Spread, Variances};
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
        matrix += information.equations(1.0)?.matrix;
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
    /// The prior.
    prior: Precision,
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
    /// Standard deviation.
    pub sigma: Vec<f64>,
    /// Cramér–Rao bound without smoothness.
    pub bound: Vec<f64>,
    /// Status.
    pub status: Vec<Status>,
}

/// The Cramér–Rao bound without smoothness.
struct Bounds {
    /// Covariance of the coefficients.
    covariance: Mat<f64>,
    /// σ of the Fourier coefficients, as of [`spectrum::functionals`].
    spectrum: Vec<f64>,
}

/// σ by the status: see [`spread`].
fn sigma(status: Status, variances: Variances) -> f64 {
    match status {
        Status::Determined => variances.noise.sqrt(),
        _ => variances.total.sqrt(),
    }
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
        let prior = Penalties::new(information.basis, relief).precision(&smoothness);
        let pairs = information.basis.pairs() as f64;
        let count = information.count as f64;
        let solve = |noise: f64| -> Result<(Posterior, f64, f64)> {
            let posterior = Posterior::new(&information, &prior, noise, non_negative)?;
            let chi_square = information.chi_square(&posterior.mean, noise)?;
            let parameters = pairs - prior.trace_of_square(&posterior.covariance);
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
            prior,
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

    /// Values of the slice at size² cells, and its Fourier coefficients up to `order`.
    ///
    /// # Errors
    /// If the prior or the problem without smoothness cannot be factored.
    pub fn read(
        &self,
        size: usize,
        order: usize,
        reach: &Reach,
    ) -> Result<(GridValues, Vec<Coefficient>)> {
        let values = self.values(size);
        let largest = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let functionals = spectrum::functionals(self.basis(), order);
        let bounds = self.bounds(largest, &functionals)?;
        let coefficients = self.coefficients(order, &functionals, &bounds, reach);
        drop(functionals);
        Ok((self.grid(size, values, &bounds, reach), coefficients))
    }

    fn values(&self, size: usize) -> Vec<f64> {
        let mut values = vec![0.0; size * size];
        for i in 0..size {
            for j in 0..=i {
                let v = posterior::apply(
                    &posterior::value_at(self.basis(), centre(size, i), centre(size, j)),
                    &self.posterior.mean,
                );
                values[i * size + j] = v;
                values[j * size + i] = v;
            }
        }
        values
    }

    fn bounds(&self, largest: f64, functionals: &Mat<f64>) -> Result<Bounds> {
        let mut matrix = self.information.equations(self.noise)?.matrix;
        Penalties::new(self.basis(), &Relief::flat(self.basis()))
            .add_dense(&vague(self.basis(), largest), &mut matrix);
        let factor = Factor::new(&matrix)?;
        drop(matrix);
        Ok(Bounds {
            spectrum: spectrum::sigmas(functionals, &factor),
            covariance: factor.inverse(),
        })
    }

    fn grid(&self, size: usize, values: Vec<f64>, bounds: &Bounds, reach: &Reach) -> GridValues {
        let covariance = &self.posterior.covariance;
        let spread = Spread::new(self.basis(), covariance, &self.prior);
        let (prior, told) = (reach.prior.inverse(), reach.told.inverse());
        let rows: Vec<Vec<(f64, f64, Status)>> = (0..size)
            .into_par_iter()
            .map(|i| {
                let cells = (0..=i).map(|j| {
                    let (a, b) = (centre(size, i), centre(size, j));
                    let functional = posterior::value_at(self.basis(), a, b);
                    let posterior = posterior::variance(&functional, covariance);
                    let bound = posterior::variance(&functional, &bounds.covariance).sqrt();
                    let coarse = posterior::value_at(reach.basis, a, b);
                    let p = posterior::variance(&coarse, &prior).sqrt();
                    let t = posterior::variance(&coarse, &told).sqrt();
                    let status = classify(bound, posterior.sqrt(), t, p);
                    let relative = spread.at(a, b);
                    let variances = Variances {
                        noise: posterior * relative.noise,
                        total: posterior * relative.total,
                    };
                    (sigma(status, variances), bound, status)
                });
                cells.collect()
            })
            .collect();
        let mut out = GridValues {
            values,
            sigma: vec![0.0; size * size],
            bound: vec![0.0; size * size],
            status: vec![Status::Indeterminate; size * size],
        };
        for (i, row) in rows.into_iter().enumerate() {
            for (j, (sigma, bound, status)) in row.into_iter().enumerate() {
                for k in [i * size + j, j * size + i] {
                    out.sigma[k] = sigma;
                    out.bound[k] = bound;
                    out.status[k] = status;
                }
            }
        }
        out
    }

    fn coefficients(
        &self,
        order: usize,
        functionals: &Mat<f64>,
        bounds: &Bounds,
        reach: &Reach,
    ) -> Vec<Coefficient> {
        let covariance = &self.posterior.covariance;
        let parts = spread::variances(functionals, covariance, &self.prior);
        let coarse = spectrum::functionals(reach.basis, order);
        let prior = spectrum::sigmas(&coarse, &reach.prior);
        let told = spectrum::sigmas(&coarse, &reach.told);
        let x = &self.posterior.mean;
        let dot = |j: usize| -> f64 { functionals.col(j).iter().zip(x).map(|(w, x)| w * x).sum() };
        spectrum::indices(order)
            .into_iter()
            .enumerate()
            .map(|(k, (p, q))| {
                let [re, im] = [parts[2 * k], parts[2 * k + 1]];
                let both = Variances {
                    noise: spectrum::of_parts(re.noise, im.noise),
                    total: spectrum::of_parts(re.total, im.total),
                };
                let bound = bounds.spectrum[k];
                let status = classify(bound, both.total.sqrt(), told[k], prior[k]);
                Coefficient {
                    p,
                    q,
                    value: Complex64::new(dot(2 * k), dot(2 * k + 1)),
                    sigma: sigma(status, both),
                    bound,
                    status,
                }
            })
            .collect()
    }
}

/// θ′ at the centre of cell `k` of `size`, radians.
fn centre(size: usize, k: usize) -> f64 {
    -FRAC_PI_2 + (k as f64 + 0.5) * PI / size as f64
}
