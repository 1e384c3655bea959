//! What is read from a finished fit: values, spectrum, σ, bounds, status.

use std::f64::consts::{FRAC_PI_2, PI};

use faer::Mat;
use num_complex::Complex64;
use rayon::prelude::*;

use super::estimate::Coefficient;
use super::fit::Fit;
use super::information::Information;
use super::posterior;
use super::prior::{Factor, Penalties, Precision, Relief, Smoothness, white};
use super::space::Space;
use super::spectrum;
use super::spread::{self, Spread, Variances};
use crate::Result;
use crate::lighting::Status;

/// How many times the largest value of the slice a coefficient may be in the problem without smoothness.
const VAGUE: f64 = 100.0;

/// The most of a bound's square that may be the white ε's own: averages over the slice have little of the size that ε allows its values, and
/// without this one that no sample sees could seem as well known as one that is measured badly.
const UNSEEN: f64 = 0.1;

/// What is left unseen by no more than rounding, of the prior's standard deviation: quadratures of the light and of the waves differ by far less.
const ROUNDING: f64 = 1e-3;

/// White prior that allows coefficients of [`VAGUE`] times `largest` on splines `spacing` radians apart.
pub fn vague(spacing: f64, largest: f64) -> Smoothness {
    let size = VAGUE * largest.max(f64::MIN_POSITIVE.sqrt());
    Smoothness {
        amplitude: (spacing * size).powi(-2),
        across: 0.0,
        along: 0.0,
    }
}

/// Status of a quantity from its bound, its σ, and its standard deviation with and without samples under the prior
/// of limited reach.
fn classify(bound: f64, sigma: f64, told: f64, prior: f64) -> Status {
    if bound <= 0.5 * prior && bound <= 10.0 * sigma {
        Status::Determined
    } else {
        unseen(told, prior)
    }
}

/// Status of what the samples alone do not determine.
fn unseen(told: f64, prior: f64) -> Status {
    if told <= 0.5 * prior {
        Status::Weak
    } else {
        Status::Indeterminate
    }
}

/// What prior and samples say on coarse splines, when the prior reaches no farther than it may.
pub struct Reach {
    space: Space,
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
        let space = information.space.clone();
        let most = smoothness.amplitude * longest.powi(6);
        let limited = Smoothness {
            amplitude: smoothness.amplitude,
            across: smoothness.across.min(most),
            along: smoothness.along.min(most),
        };
        let mut matrix = Mat::zeros(space.len(), space.len());
        Penalties::new(&space, relief).add_dense(&limited, &mut matrix);
        let prior = Factor::new(&matrix)?;
        matrix += information.equations(1.0)?.matrix;
        let told = Factor::new(&matrix)?;
        Ok(Self { space, prior, told })
    }
}

/// Values on a grid of cells, \[θi′\]\[θo′\], size².
pub struct GridValues {
    /// ρ̃.
    pub values: Vec<f64>,
    /// Standard deviation.
    pub sigma: Vec<f64>,
    /// The part of it that is what the splines miss.
    pub unresolved: Vec<f64>,
    /// Cramér–Rao bound without smoothness.
    pub bound: Vec<f64>,
    /// Status.
    pub status: Vec<Status>,
}

/// σ by the status: see [`spread`].
fn sigma(status: Status, posterior: f64, relative: Variances) -> f64 {
    match status {
        Status::Determined => (posterior * relative.noise).sqrt(),
        _ => (posterior * relative.total).sqrt(),
    }
}

/// What finer splines still miss of the slice, in units of what they changed about the coarse ones' slice, from the factors on the variances that
/// either needs.
///
/// Residuals beyond the noise, κ − 1 in the mean square, come from what splines miss: m_c² of the coarse ones, m_f² of the fine, and m_c² − m_f² is
/// what came between. Where it is something else that does not fit, the ratio says nothing, and as much again is the most that is taken.
pub fn missed(coarse: f64, fine: f64) -> f64 {
    let left = fine - 1.0;
    if left <= 0.0 {
        0.0
    } else {
        (left / (coarse - fine).max(left)).sqrt()
    }
}

/// The largest of a map \[i\]\[j\] of size² within `reach` cells to each side.
fn largest_within(map: &[f64], size: usize, reach: usize) -> Vec<f64> {
    // Of the lines, twice: the second time across, into the same order again.
    let along = |map: &[f64]| -> Vec<f64> {
        let lines: Vec<Vec<f64>> = map
            .chunks(size)
            .map(|line| {
                (0..size)
                    .map(|j| {
                        let near = &line[j.saturating_sub(reach)..(j + reach + 1).min(size)];
                        near.iter().copied().fold(0.0, f64::max)
                    })
                    .collect()
            })
            .collect();
        (0..size)
            .flat_map(|j| lines.iter().map(move |line| line[j]))
            .collect()
    };
    along(&along(map))
}

/// Values of the slice at size² cells, and its Fourier coefficients up to `order`.
///
/// `coarse` is the fit on coarse splines, by which the scatter of the estimate is compared with the posterior's: it has no
/// finer structure, and holds all of the frequencies. `missed` times the difference to it is added to the σ of the values ([`missed`]); coefficients are
/// integrals, in which errors of narrow splines cancel. What other errors did to the unknowns, `followed` \[unknown\]\[error\], is added to every σ.
///
/// # Errors
/// If the problem without smoothness cannot be factored.
pub fn read(
    fit: &Fit,
    coarse: &Fit,
    missed: f64,
    followed: &Mat<f64>,
    size: usize,
    order: usize,
    reach: &Reach,
) -> Result<(GridValues, Vec<Coefficient>)> {
    let places = places(fit.space(), size);
    let values: Vec<f64> = places
        .iter()
        .map(|place| posterior::apply(place, &fit.posterior.mean))
        .collect();
    let largest = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let variances = |covariance: &Mat<f64>| -> Vec<f64> {
        places
            .par_iter()
            .map(|place| posterior::variance(place, covariance))
            .collect()
    };
    let unsmoothed = Unsmoothed::new(fit, largest)?;
    let coefficients = coefficients(fit, coarse, followed, order, &unsmoothed, reach);
    let covariance = unsmoothed.factor.inverse();
    drop(unsmoothed);
    let bound: Vec<f64> = variances(&covariance).iter().map(|v| v.sqrt()).collect();
    drop(covariance);
    let posterior = variances(&fit.posterior.covariance);
    let others: Vec<f64> = places
        .par_iter()
        .map(|place| {
            let of = |error: usize| -> f64 {
                let moved = followed.col(error);
                place.iter().map(|&(index, w)| w * moved[index]).sum()
            };
            (0..followed.ncols()).map(|e| of(e).powi(2)).sum()
        })
        .collect();
    drop(places);

    let spread = Spread::new(coarse.space(), &coarse.posterior.covariance, &coarse.prior);
    let (prior, told) = (reach.prior.inverse(), reach.told.inverse());
    let cells: Vec<(usize, usize)> = (0..size)
        .flat_map(|i| (0..=i).map(move |j| (i, j)))
        .collect();
    let unresolved: Vec<f64> = match missed > 0.0 {
        false => vec![0.0; size * size],
        true => {
            let mut change = vec![0.0; size * size];
            for (&(i, j), value) in cells.iter().zip(&values) {
                let (a, b) = (centre(size, i), centre(size, j));
                let before =
                    posterior::apply(&coarse.space().value_at(a, b), &coarse.posterior.mean);
                change[i * size + j] = missed * (value - before).abs();
                change[j * size + i] = change[i * size + j];
            }
            // The change crosses 0 within the width of a spline.
            let reach = size.div_ceil(2 * coarse.space().basis().intervals());
            largest_within(&change, size, reach)
        }
    };
    let judged: Vec<(f64, Status)> = cells
        .par_iter()
        .enumerate()
        .map(|(k, &(i, j))| {
            let (a, b) = (centre(size, i), centre(size, j));
            let place = reach.space.value_at(a, b);
            let p = posterior::variance(&place, &prior).sqrt();
            let t = posterior::variance(&place, &told).sqrt();
            // Of ε each value alone may be a hundred times the largest.
            let status = match bound[k] <= largest {
                true => classify(bound[k], posterior[k].sqrt(), t, p),
                false => unseen(t, p),
            };
            let own = sigma(status, posterior[k], spread.at(a, b));
            let unresolved = unresolved[i * size + j];
            (
                (own * own + unresolved * unresolved + others[k]).sqrt(),
                status,
            )
        })
        .collect();
    let mut grid = GridValues {
        values: vec![0.0; size * size],
        sigma: vec![0.0; size * size],
        unresolved: vec![0.0; size * size],
        bound: vec![0.0; size * size],
        status: vec![Status::Indeterminate; size * size],
    };
    for (k, &(i, j)) in cells.iter().enumerate() {
        for cell in [i * size + j, j * size + i] {
            grid.values[cell] = values[k];
            grid.bound[cell] = bound[k].hypot(others[k].sqrt());
            grid.unresolved[cell] = unresolved[cell];
            (grid.sigma[cell], grid.status[cell]) = judged[k];
        }
    }
    Ok((grid, coefficients))
}

/// The problem without smoothness.
struct Unsmoothed {
    /// ε.
    white: Precision,
    /// Of J + ε.
    factor: Factor,
}

impl Unsmoothed {
    fn new(fit: &Fit, largest: f64) -> Result<Self> {
        let space = fit.space();
        let mut matrix = fit.information.equations(fit.noise)?.matrix;
        let white = white(space, vague(space.basis().spacing(), largest).amplitude);
        white.add_to(&mut matrix);
        Ok(Self {
            factor: Factor::new(&matrix)?,
            white,
        })
    }

    /// The squares of the bounds of functionals of the unknowns, and how much of each is the size that ε allows to what the samples do not see
    /// at all.
    fn bounds(&self, functionals: &Mat<f64>) -> Vec<[f64; 2]> {
        // g (J + ε)⁻¹ g, and g (J + ε)⁻¹ ε (J + ε)⁻¹ g.
        let mut seen = functionals.clone();
        self.factor.solve(&mut seen);
        let pulled = self.white.times_columns(&seen);
        let dot = |a: &Mat<f64>, b: &Mat<f64>, k: usize| -> f64 {
            let pairs = a.col(k).iter().zip(b.col(k).iter());
            pairs.map(|(a, b)| a * b).sum()
        };
        (0..functionals.ncols())
            .map(|k| [dot(functionals, &seen, k), dot(&seen, &pulled, k)].map(|v| v.max(0.0)))
            .collect()
    }
}

/// What a fit says of one coefficient.
struct Fitted {
    value: Complex64,
    /// Posterior variances of real and imaginary part.
    posterior: [f64; 2],
    /// Bound of each part.
    bound: f64,
    /// The part of it that is the size allowed by ε to what no sample sees.
    unseen: f64,
    /// Variance of each part by the other errors.
    others: f64,
}

impl Fitted {
    /// Whether the bound is that of the samples, rather than of ε.
    fn is_seen(&self, prior: f64) -> bool {
        let share = self.unseen * self.unseen <= UNSEEN * self.bound * self.bound;
        share || self.unseen <= ROUNDING * prior
    }
}

/// What the coarse fit and the prior say of one coefficient.
struct Expected {
    /// Of real and imaginary part.
    relative: [Variances; 2],
    /// Standard deviation of each part by the prior alone.
    prior: f64,
    /// By prior and samples.
    told: f64,
}

fn coefficients(
    fit: &Fit,
    coarse: &Fit,
    followed: &Mat<f64>,
    order: usize,
    unsmoothed: &Unsmoothed,
    reach: &Reach,
) -> Vec<Coefficient> {
    let part = |variances: &[f64]| spectrum::of_parts(variances[0], variances[1]).sqrt();
    let fitted = spectrum::functionals(fit.space(), order, |columns| {
        let posterior = spectrum::variances(columns, &fit.posterior.precision);
        let bounds = unsmoothed.bounds(columns);
        let value = |j: usize| -> f64 {
            let pairs = columns.col(j).iter().zip(&fit.posterior.mean);
            pairs.map(|(w, x)| w * x).sum()
        };
        let moved = columns.transpose() * followed;
        let others = |j: usize| moved.row(j).squared_norm_l2();
        posterior
            .chunks_exact(2)
            .zip(bounds.chunks_exact(2))
            .enumerate()
            .map(|(k, (posterior, bounds))| {
                let [bound, unseen] = [0, 1].map(|i| part(&[bounds[0][i], bounds[1][i]]));
                Fitted {
                    value: Complex64::new(value(2 * k), value(2 * k + 1)),
                    posterior: [posterior[0], posterior[1]],
                    bound,
                    unseen,
                    others: spectrum::of_parts(others(2 * k), others(2 * k + 1)),
                }
            })
            .collect()
    });
    let expected = spectrum::functionals(coarse.space(), order, |columns| {
        let covariance = &coarse.posterior.covariance;
        let relative = spread::ratios(columns, &(covariance * columns), covariance, &coarse.prior);
        let prior = spectrum::variances(columns, &reach.prior);
        let told = spectrum::variances(columns, &reach.told);
        relative
            .chunks_exact(2)
            .zip(prior.chunks_exact(2).zip(told.chunks_exact(2)))
            .map(|(relative, (prior, told))| Expected {
                relative: [relative[0], relative[1]],
                prior: part(prior),
                told: part(told),
            })
            .collect()
    });
    spectrum::indices(order)
        .into_iter()
        .zip(fitted.into_iter().zip(expected))
        .map(|((p, q), (fitted, expected))| {
            let scaled = |pick: &dyn Fn(Variances) -> f64| {
                let [re, im] = [0, 1].map(|i| fitted.posterior[i] * pick(expected.relative[i]));
                spectrum::of_parts(re, im)
            };
            let own = Variances {
                noise: scaled(&|v| v.noise),
                total: scaled(&|v| v.total),
            };
            let bound = fitted.bound;
            let status = match fitted.is_seen(expected.prior) {
                true => classify(bound, own.total.sqrt(), expected.told, expected.prior),
                false => unseen(expected.told, expected.prior),
            };
            Coefficient {
                p,
                q,
                value: fitted.value,
                sigma: sigma(status, 1.0, own).hypot(fitted.others.sqrt()),
                bound: bound.hypot(fitted.others.sqrt()),
                status,
            }
        })
        .collect()
}

/// Values of the slice at the cells (i, j ≤ i) of a grid of size², one after the other, as functionals of the unknowns.
fn places(space: &Space, size: usize) -> Vec<Vec<(usize, f64)>> {
    // Cells between the same knots are of the same unknowns.
    let basis = space.basis();
    let intervals: Vec<usize> = (0..size).map(|k| basis.interval(centre(size, k))).collect();
    let groups: Vec<&[usize]> = intervals.chunk_by(|a, b| a == b).collect();
    let mut starts = vec![0];
    for group in &groups {
        starts.push(starts[starts.len() - 1] + group.len());
    }
    let rows: Vec<Vec<Vec<(usize, f64)>>> = (0..groups.len())
        .into_par_iter()
        .flat_map_iter(|g| {
            let own = starts[g]..starts[g + 1];
            let mut rows: Vec<Vec<Vec<(usize, f64)>>> =
                own.clone().map(|i| Vec::with_capacity(i + 1)).collect();
            for h in 0..=g {
                let patch = space.patch(groups[g][0], groups[h][0]);
                for (row, i) in rows.iter_mut().zip(own.clone()) {
                    for j in starts[h]..starts[h + 1].min(i + 1) {
                        row.push(patch.value_at(centre(size, i), centre(size, j)));
                    }
                }
            }
            rows
        })
        .collect();
    rows.into_iter().flatten().collect()
}

/// θ′ at the centre of cell `k` of `size`, radians.
fn centre(size: usize, k: usize) -> f64 {
    -FRAC_PI_2 + (k as f64 + 0.5) * PI / size as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finer_splines_that_explain_everything_miss_nothing() {
        assert_eq!(missed(100.0, 1.0), 0.0);
        // Residuals of variance 101, of which 1 is noise, come down to 5: errors of 10 and of 2, and √96 between them.
        assert!((missed(101.0, 5.0) - 2.0 / 96f64.sqrt()).abs() < 1e-12);
        // What finer splines do not mend is not theirs.
        assert_eq!(missed(5.0, 5.0), 1.0);
        assert_eq!(missed(1.0, 5.0), 1.0);
    }

    #[test]
    fn the_largest_within_a_square() {
        let mut map = vec![0.0; 36];
        map[2 * 6 + 4] = 3.0;
        let found = largest_within(&map, 6, 1);
        for i in 0..6usize {
            for j in 0..6usize {
                let near = i.abs_diff(2) <= 1 && j.abs_diff(4) <= 1;
                assert_eq!(found[i * 6 + j], if near { 3.0 } else { 0.0 });
            }
        }
    }
}
