//! What is assumed of the smooth light before looking: a Gaussian prior on its spectrum, with its
//! parameters chosen by the data.
//!
//! Re L_p and Im L_p (p ≥ 1) are independent normal variables of variance
//! τ² / (1 + (p/corner)^(2·steepness)); L_0 is free. Because light is not negative, |L_p| ≤ L_0: a prior
//! of deviation τ = L_0 for all p is the weakest that makes sense, and what it leaves open nothing
//! but the data can fix.

use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::prelude::*;
use faer::{Mat, Side};
use rayon::prelude::*;

use super::RegularisationChoice;
use crate::error::{Error, Result};

/// A Gaussian prior on the spectrum of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpectralPrior {
    /// τ, the standard deviation of Re L_p and Im L_p at low p, W m⁻² rad⁻¹.
    pub deviation: f64,
    /// Frequency at which the variance has halved; infinite: the same for all p.
    pub corner: f64,
    /// How fast it falls beyond.
    pub steepness: i32,
}

impl SpectralPrior {
    /// The same variance for all p.
    pub fn flat(deviation: f64) -> Self {
        Self {
            deviation,
            corner: f64::INFINITY,
            steepness: 1,
        }
    }

    /// 1/variance of unknown `i` of x = (L_0, Re L_1, Im L_1, …).
    pub fn precision(&self, i: usize) -> f64 {
        if i == 0 {
            return 0.0;
        }
        let p = i.div_ceil(2) as f64;
        // 1e30: as good as fixed at zero, and still a finite number.
        (1.0 + (p / self.corner).powi(2 * self.steepness).min(1e30)) / self.deviation.powi(2)
    }
}

/// Gaussian posterior of the unknowns of A x = y with noise scale κ under a prior.
///
/// After the coefficients come irradiances of sources and systematic errors.
#[derive(Debug)]
pub struct Posterior {
    /// Mean of the unknowns.
    pub mean: Vec<f64>,
    /// Logarithm of the marginal likelihood, up to a constant that depends on the data and on κ only.
    pub log_evidence: f64,
    factor: Llt<f64>,
}

impl Posterior {
    /// Covariance of the unknowns.
    pub fn covariance(&self) -> Mat<f64> {
        self.factor.inverse()
    }

    /// (x − mean)ᵀ Q (x − mean): how far x is from the mean, squared, in standard deviations.
    pub fn squared_distance(&self, x: &[f64]) -> f64 {
        let lower = self.factor.L();
        let difference: Vec<f64> = x.iter().zip(&self.mean).map(|(x, m)| x - m).collect();
        (0..x.len())
            .map(|j| {
                (j..x.len())
                    .map(|i| lower[(i, j)] * difference[i])
                    .sum::<f64>()
                    .powi(2)
            })
            .sum()
    }

    /// cᵀ Q⁻¹ c, the variance of the combination c of the unknowns.
    pub fn variance_of(&self, combination: &[f64]) -> f64 {
        let c = Mat::from_fn(combination.len(), 1, |i, _| combination[i]);
        let solved = self.factor.solve(&c);
        combination
            .iter()
            .enumerate()
            .map(|(i, c)| c * solved[(i, 0)])
            .sum()
    }
}

/// Normal equations, and which of the unknowns are what: coefficients, then irradiances of sources, then systematic errors.
pub struct Problem<'a> {
    /// A, symmetric positive semi-definite, in units of inverse variance.
    pub matrix: &'a Mat<f64>,
    /// y.
    pub vector: &'a [f64],
    /// Number of unknowns that the prior applies to.
    pub coefficients: usize,
    /// Number of unknowns at the end that have a unit normal prior (systematic errors in units of their σ);
    /// those between have a flat one (irradiances of sources).
    pub systematics: usize,
    /// κ: factor on the samples' variances.
    pub noise_scale: f64,
}

impl Problem<'_> {
    fn regularised(&self, prior: &SpectralPrior) -> Mat<f64> {
        let mut q = self.matrix * faer::Scale(1.0 / self.noise_scale);
        for i in 0..self.coefficients {
            q[(i, i)] += prior.precision(i);
        }
        for i in q.nrows() - self.systematics..q.nrows() {
            q[(i, i)] += 1.0;
        }
        // Directions that neither data nor prior fix (a source no sample sees) must not stop the
        // factorisation: 1e-13 of the largest entry is the rounding of the sums that made A.
        let largest = (0..q.nrows()).map(|i| q[(i, i)]).fold(0.0, f64::max);
        for i in 0..q.nrows() {
            q[(i, i)] += 1e-13 * largest;
        }
        q
    }

    /// bᵀWb − 2xᵀy + xᵀAx, the weighted sum of squared residuals; `square` is bᵀWb.
    pub fn residual(&self, square: f64, x: &[f64]) -> f64 {
        let x = ColRef::from_slice(x);
        let y = ColRef::from_slice(self.vector);
        square - 2.0 * (x.transpose() * y) + (x.transpose() * self.matrix) * x
    }

    fn right_side(&self) -> Mat<f64> {
        Mat::from_fn(self.vector.len(), 1, |i, _| {
            self.vector[i] / self.noise_scale
        })
    }

    /// Mean, factor of the inverse covariance and log evidence.
    ///
    /// # Errors
    /// If the matrix is not positive definite: values that are not finite, or weights of too wide a range.
    pub fn posterior(&self, prior: &SpectralPrior) -> Result<Posterior> {
        let factor = self.regularised(prior).llt(Side::Lower).map_err(|_| {
            Error::failed("the normal equations of the lighting cannot be factorised")
                .advice("The samples hold values that are not finite, or their weights span too wide a range.")
        })?;
        let b = self.right_side();
        let solution = factor.solve(&b);
        let mean: Vec<f64> = (0..b.nrows()).map(|i| solution[(i, 0)]).collect();
        let fit: f64 = (0..b.nrows()).map(|i| b[(i, 0)] * solution[(i, 0)]).sum();
        let lower = factor.L();
        let log_determinant: f64 = (0..b.nrows()).map(|i| 2.0 * lower[(i, i)].ln()).sum();
        let log_prior: f64 = (1..self.coefficients)
            .map(|i| prior.precision(i).ln())
            .sum();
        Ok(Posterior {
            mean,
            log_evidence: 0.5 * (fit - log_determinant + log_prior),
            factor,
        })
    }
}

/// Chooses the prior's shape and strength by the marginal likelihood, whose curve over the strength is returned.
pub fn choose_by_evidence(
    problem: &Problem<'_>,
    mean_light: f64,
) -> Result<(SpectralPrior, RegularisationChoice)> {
    let cost = |prior: &SpectralPrior| Ok(-problem.posterior(prior)?.log_evidence);
    let mut best = (f64::INFINITY, SpectralPrior::flat(mean_light));
    let better = |best: (f64, SpectralPrior), cost: f64, prior: SpectralPrior| {
        if cost < best.0 { (cost, prior) } else { best }
    };
    for step in 0..=6 {
        let prior = SpectralPrior::flat(mean_light * 10f64.powi(-step));
        best = better(best, cost(&prior)?, prior);
        // Once the likelihood falls with the strength it does not rise again.
        if f64::from(step) > (mean_light / best.1.deviation).log10() + 1.5 {
            break;
        }
    }
    // The first of equals, whoever computes it.
    let costs =
        |priors: &[SpectralPrior]| -> Result<Vec<f64>> { priors.par_iter().map(cost).collect() };
    let deviation = (best.1.deviation * 10f64.sqrt()).min(mean_light);
    // A sky falls off by a power of p from the first frequencies on; 1 leaves nothing but that.
    let shapes: Vec<SpectralPrior> = [3, 10]
        .into_iter()
        .flat_map(|steepness| {
            let corners = [1.0, 1.8, 3.0, 6.0, 9.0, 13.0, 19.0, 28.0];
            corners.map(|corner| SpectralPrior {
                deviation,
                corner,
                steepness,
            })
        })
        .collect();
    for (cost, prior) in costs(&shapes)?.into_iter().zip(shapes) {
        best = better(best, cost, prior);
    }
    let shape = best.1;
    let strengths: Vec<SpectralPrior> = (-3..=3)
        .map(|step| SpectralPrior {
            deviation: shape.deviation * 10f64.powf(f64::from(step) / 3.0),
            ..shape
        })
        .collect();
    let mut curve = Vec::with_capacity(strengths.len());
    for (cost, prior) in costs(&strengths)?.into_iter().zip(strengths) {
        curve.push(((mean_light / prior.deviation).powi(2), cost));
        best = better(best, cost, prior);
    }
    let strength = (mean_light / best.1.deviation).powi(2);
    Ok((
        best.1,
        RegularisationChoice {
            criterion: "evidence".into(),
            strength,
            curve,
        },
    ))
}

/// Chooses the strength of a flat prior by generalised cross-validation, N·residual²/(N − trace)².
///
/// `square` is bᵀWb and `count` N.
pub fn choose_by_gcv(
    problem: &Problem<'_>,
    square: f64,
    count: usize,
    mean_light: f64,
) -> Result<(SpectralPrior, RegularisationChoice)> {
    let n = count as f64;
    let mut curve = Vec::new();
    let mut best = (f64::INFINITY, SpectralPrior::flat(mean_light));
    for step in 0..=16 {
        let prior = SpectralPrior::flat(mean_light * 10f64.powf(-f64::from(step) / 4.0));
        let posterior = problem.posterior(&prior)?;
        let residual = problem.residual(square, &posterior.mean);
        let covariance = posterior.covariance();
        let trace: f64 = (0..problem.coefficients)
            .map(|i| 1.0 - prior.precision(i) * covariance[(i, i)])
            .sum();
        let cost = (n * residual / (n - trace).max(1.0).powi(2)).ln();
        curve.push(((mean_light / prior.deviation).powi(2), cost));
        if cost < best.0 {
            best = (cost, prior);
        }
    }
    let choice = RegularisationChoice {
        criterion: "gcv".into(),
        strength: (mean_light / best.1.deviation).powi(2),
        curve,
    };
    Ok((best.1, choice))
}
