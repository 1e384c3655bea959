//! The fit of one channel, and where it wants finer splines.

use super::information::Information;
use super::posterior::{self, Free, Posterior};
use super::prior::{Penalties, Precision, Relief, Smoothness};
use super::space::Space;
use crate::Result;

/// Error of the splines, in units of σ, beyond which finer ones are taken. A fifth would add 2 % to the total; but it is told from a fit that lacks
/// the very frequencies that are missed, and comes out up to four times too small where lobes end in a sharp crest.
const TOLERATED: f64 = 0.05;

/// Cells by which the region of finer splines reaches beyond those that want them: a fine spline is three such cells wide.
const MARGIN: usize = 2;

/// Most unknowns, which bound time and memory: matrices of 50 MB.
const MOST: usize = 2500;

/// Factor on the prior where it contradicts non-negativity, and how often that may be.
const YIELD: f64 = 0.1;
const YIELDS: usize = 4;

/// A finished fit, to be read out.
pub struct Fit {
    /// The samples.
    pub information: Information,
    /// Unknowns and covariance.
    pub posterior: Posterior,
    /// The prior, weakened if it contradicted non-negativity.
    pub prior: Precision,
    /// Σ residual²/σ², by the variances as given.
    pub chi_square: f64,
    /// Effective number of parameters.
    pub parameters: f64,
    /// Factor on all variances.
    pub noise: f64,
    non_negative: bool,
}

impl Fit {
    /// Solves for the unknowns; where the residual is larger than the variances of the samples allow, with all of
    /// them scaled up.
    ///
    /// # Errors
    /// If the normal equations cannot be factored.
    pub fn new(
        information: Information,
        smoothness: &Smoothness,
        relief: &Relief,
        non_negative: bool,
    ) -> Result<Self> {
        let prior = Penalties::new(&information.space, relief).precision(smoothness);
        let mut noise = 1.0;
        let mut free = Free::new(&information, &prior, noise)?;
        let count = information.count as f64;
        let freedom = count - free.parameters(&prior);
        let chi_square = information.chi_square(&free.mean, noise)?;
        // With few samples to spare the residual says nothing about the noise. Else, beyond five standard
        // deviations of χ² the variances are too small, or the model is wrong.
        if freedom > 0.05 * count && chi_square / freedom > 1.0 + 5.0 * (2.0 / freedom).sqrt() {
            noise = chi_square / freedom;
            drop(free);
            free = Free::new(&information, &prior, noise)?;
        }
        Self::finish(information, prior, free, noise, non_negative)
    }

    /// The same fit with all variances `noise` times what they say.
    ///
    /// # Errors
    /// If the normal equations cannot be factored.
    pub fn at_noise(self, noise: f64) -> Result<Self> {
        let Self {
            information,
            prior,
            posterior,
            non_negative,
            ..
        } = self;
        drop(posterior);
        let free = Free::new(&information, &prior, noise)?;
        Self::finish(information, prior, free, noise, non_negative)
    }

    fn finish(
        information: Information,
        prior: Precision,
        free: Free,
        noise: f64,
        non_negative: bool,
    ) -> Result<Self> {
        let posterior = free.posterior(&prior, non_negative)?;
        Ok(Self {
            chi_square: information.chi_square(&posterior.mean, noise)?,
            parameters: information.space.len() as f64
                - prior.trace_of_square(&posterior.covariance),
            information,
            posterior,
            prior,
            noise,
            non_negative,
        })
    }

    /// The fit with a prior that does not contradict non-negativity: a weaker one, as long as that helps.
    ///
    /// The evidence knows nothing of signs. Where light without detail shows only the averages of a sharp lobe, the smoothest slice
    /// with those averages is negative beside it, and a prior from that one cannot believe in the lobe.
    ///
    /// # Errors
    /// If the normal equations cannot be factored.
    pub fn reconciled(mut self) -> Result<Self> {
        for _ in 0..YIELDS {
            let excess = self.posterior.excess;
            if excess <= 1.0 {
                break;
            }
            let prior = self.prior.clone().times_factor(YIELD);
            let free = Free::new(&self.information, &prior, self.noise)?;
            let posterior = free.posterior(&prior, self.non_negative)?;
            // Else the splines are at fault.
            if posterior.excess > 0.7 * excess {
                break;
            }
            self.chi_square = self.information.chi_square(&posterior.mean, self.noise)?;
            self.parameters =
                self.space().len() as f64 - prior.trace_of_square(&posterior.covariance);
            (self.prior, self.posterior) = (prior, posterior);
        }
        Ok(self)
    }

    /// What the unknowns are.
    pub fn space(&self) -> &Space {
        &self.information.space
    }

    /// The space with finer splines wherever the errors of these are not small beside σ; `None` if they are everywhere. If that were more
    /// than can be afforded, where they are largest beside σ.
    pub fn finer(&self) -> Option<Space> {
        let coarse = self.space().basis();
        let cells = coarse.intervals();
        let ratio = self.spline_errors();
        let mut tolerated = TOLERATED;
        loop {
            let wanting: Vec<(usize, usize)> = (0..cells * cells)
                .filter(|&k| ratio[k] > tolerated)
                .map(|k| (k / cells, k % cells))
                .collect();
            if wanting.is_empty() {
                return None;
            }
            let mut refined = vec![false; cells * cells];
            for (i, j) in wanting {
                for i in i.saturating_sub(MARGIN)..(i + MARGIN + 1).min(cells) {
                    for j in j.saturating_sub(MARGIN)..(j + MARGIN + 1).min(cells) {
                        refined[i * cells + j] = true;
                    }
                }
            }
            let space = Space::refined(coarse, &refined);
            if space.len() <= MOST {
                return Some(space);
            }
            tolerated *= 1.5;
        }
    }

    /// Errors of uniform splines on each cell of their knots \[i\]\[j\], in units of the σ that the samples' stated variances
    /// lead to. Splines that are too coarse also show as noise above the stated.
    fn spline_errors(&self) -> Vec<f64> {
        let basis = self.space().basis();
        let (cells, len) = (basis.intervals(), basis.len());
        let c = self.space().coefficients(&self.posterior.mean);
        // For spline n along one angle, at knot i along the other.
        let of_spline: Vec<Vec<f64>> = (0..len)
            .map(|n| {
                let line: Vec<f64> = (0..len).map(|m| c[basis.pair(m, n)]).collect();
                basis.errors(&line)
            })
            .collect();
        let knot = |i: usize| basis.cell(i, 0.0);
        let centre = |i: usize| basis.cell(i, 0.5);
        let mut out = vec![0.0f64; cells * cells];
        for i in 1..cells {
            let here: Vec<f64> = of_spline.iter().map(|errors| errors[i]).collect();
            for j in 0..cells {
                let splines = basis.at(centre(j));
                let error: f64 = splines.iter().map(|(n, v)| v * here[n]).sum();
                let place = self.space().value_at(knot(i), centre(j));
                let variance = posterior::variance(&place, &self.posterior.covariance) / self.noise;
                let ratio = error.abs() / variance.sqrt().max(f64::MIN_POSITIVE);
                // The knot is the edge of two cells, and of two more across the diagonal.
                for (a, b) in [(i - 1, j), (i, j), (j, i - 1), (j, i)] {
                    let cell = &mut out[a * cells + b];
                    *cell = cell.max(ratio);
                }
            }
        }
        out
    }
}
