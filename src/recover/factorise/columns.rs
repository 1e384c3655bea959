//! B_p(θo′) at the nodes of the half circle, from irregular, missing, weighted samples in α.

use std::f64::consts::{PI, SQRT_2};

use faer::Mat;
use num_complex::Complex64;
use rayon::prelude::*;

use super::column_fit::{ColumnFit, Expected};
use super::half_circle::HalfCircle;
use crate::angle::wrap;
use crate::error::{Error, Result};
use crate::light_field::{Samples, Systematic};

/// The spectrum of one channel's light field along α, at every node of the half circle.
///
/// *Real basis.* B(α) = Σ_p B_p e^{ipα} is stored as the m = 2P + 1 reals (B_0, √2 Re B_1, √2 Im B_1, …), which keeps
/// Σ_{|p| ≤ P} |B_p|² a plain sum of squares and the noise of a complete regular circle white.
#[derive(Clone, Debug)]
pub(super) struct Spectrum {
    /// P, the largest frequency.
    pub order: usize,
    /// B_p(θo′) in the real basis, m × N; the prior mean where nothing was seen.
    pub values: Mat<f64>,
    /// Covariance of each column of `values`.
    pub covariance: Vec<Covariance>,
    /// Whether samples were seen at the node (false: beyond the limb cut).
    pub seen: Vec<bool>,
    /// What frequencies that are not resolved add to the variance of B_p at node k is `folds[(p, k)] · folded[k]`: (P + 1) × N …
    pub folds: Mat<f64>,
    /// … and \[N\].
    pub folded: Vec<f64>,
    /// What each error that all samples share does to `values` if it is one standard deviation, m × N.
    pub changes: Vec<Mat<f64>>,
}

/// Mean square difference of a spectrum and another in the real basis.
fn mean_square(spectrum: &[Complex64], other: impl Fn(usize) -> Complex64) -> f64 {
    let sum: f64 = spectrum
        .iter()
        .enumerate()
        .map(|(p, c)| if p == 0 { 1.0 } else { 2.0 } * (c - other(p)).norm_sqr())
        .sum();
    sum / (2 * spectrum.len() - 1) as f64
}

/// The turn of B_p, in radians, over which a straight line in the complex plane is still a fair guess.
const MOST_TURN: f64 = 2.5;

/// Covariance of the m values of one column.
#[derive(Clone, Debug)]
pub(super) enum Covariance {
    /// The same variance for all, uncorrelated: a complete regular circle.
    White(f64),
    /// A full m × m matrix.
    Full(Mat<f64>),
}

impl Covariance {
    /// Mean variance of the values of frequency `p`.
    pub fn at(&self, p: usize) -> f64 {
        match self {
            Self::White(v) => *v,
            Self::Full(c) if p == 0 => c[(0, 0)],
            Self::Full(c) => 0.5 * (c[(2 * p - 1, 2 * p - 1)] + c[(2 * p, 2 * p)]),
        }
    }
}

/// The half circle whose cells are the columns' spacing.
pub(super) fn half_circle(samples: &Samples) -> Result<HalfCircle> {
    let width = samples.column_width();
    if samples.columns.len() < 4 || width.is_nan() || width <= 0.0 {
        return Err(Error::input(format!(
            "factorisation needs at least 4 columns in increasing θo′, found {}",
            samples.columns.len()
        ))
        .advice("Use more columns: light_field.locals, or a wider limb cut."));
    }
    Ok(HalfCircle::new(
        ((PI / width).round() as usize).clamp(4, 720),
    ))
}

/// The largest frequency that the α samples of most columns resolve: half the number of distinct α in
/// the full circle, as far as the usual distance between neighbours goes.
pub(super) fn resolved_order(samples: &Samples, channel: usize) -> usize {
    let mut orders: Vec<usize> = samples
        .columns
        .iter()
        .filter_map(|column| {
            let variance = column.variance.get(channel)?;
            let mut alpha: Vec<f64> = column
                .alpha
                .iter()
                .zip(variance)
                .filter(|(_, v)| v.is_finite())
                .map(|(a, _)| wrap(*a))
                .collect();
            if alpha.len() < 2 {
                return None;
            }
            alpha.sort_by(f64::total_cmp);
            let mut gaps: Vec<f64> = alpha.windows(2).map(|w| w[1] - w[0]).collect();
            gaps.push(alpha[0] + 2.0 * PI - alpha[alpha.len() - 1]);
            gaps.retain(|g| *g > 1e-9);
            gaps.sort_by(f64::total_cmp);
            // A view or two missing leaves the others' spacing; the gap itself shows in the covariance.
            let gap = gaps.get(gaps.len() * 3 / 4).copied().unwrap_or(2.0 * PI);
            // n even samples resolve |p| < n/2, strictly.
            let by_gap = (PI / gap - 0.5 + 1e-6).floor().max(0.0) as usize;
            Some(by_gap.min((gaps.len() - 1) / 2))
        })
        .collect();
    orders.sort_unstable();
    orders.get(orders.len() / 2).copied().unwrap_or(0)
}

/// One column of samples as its coefficients.
struct Fitted {
    local: f64,
    values: Vec<f64>,
    covariance: Covariance,
    folds: Vec<f64>,
}

impl Spectrum {
    /// Weighted least squares in every column of `channel`, brought to the nodes of `half`.
    ///
    /// A column whose θo′ is a node's is taken as it is; otherwise a node takes the linear interpolation
    /// of its neighbours. Nodes beyond the outermost columns are filled by
    /// [`extrapolate`](Self::extrapolate).
    ///
    /// `left` is the share of the power of frequencies beyond `order` that is still in the samples.
    pub fn fit(
        samples: &Samples,
        channel: usize,
        half: &HalfCircle,
        order: usize,
        left: f64,
    ) -> Result<Self> {
        let size = 2 * order + 1;
        let expected = Expected::of(samples, channel, order).map(|e| e.without_kinks(left));
        let fits: Vec<Fitted> = samples
            .columns
            .par_iter()
            .filter_map(|column| {
                let own = column.value.get(channel)?;
                let fit = ColumnFit::new(column, channel, order, expected.as_ref())?;
                let (covariance, folds) = fit.covariance();
                Some(Fitted {
                    local: column.local.rad(),
                    values: fit.values(&[own]).pop()?,
                    covariance,
                    folds,
                })
            })
            .collect();
        if fits.len() < 4 {
            return Err(Error::input(format!(
                "factorisation needs samples in at least 4 columns of θo′, found {}",
                fits.len()
            ))
            .advice("Check the coverage: most of the light field was never seen."));
        }
        let places = places(&fits.iter().map(|f| f.local).collect::<Vec<_>>(), half);
        let mut values = Mat::zeros(size, half.len());
        let mut covariance = vec![Covariance::White(f64::INFINITY); half.len()];
        let mut folds = Mat::zeros(order + 1, half.len());
        let seen: Vec<bool> = places.iter().map(Option::is_some).collect();
        for (k, place) in places.iter().enumerate() {
            let Some([(left, near), (right, far)]) = *place else {
                continue;
            };
            let (left, right) = (&fits[left], &fits[right]);
            for i in 0..size {
                values[(i, k)] = near * left.values[i] + far * right.values[i];
            }
            for p in 0..=order {
                folds[(p, k)] = near * left.folds[p] + far * right.folds[p];
            }
            covariance[k] = if far == 0.0 {
                left.covariance.clone()
            } else {
                mixed(&left.covariance, &right.covariance, far, size)
            };
        }
        if seen.iter().filter(|s| **s).count() < 4 {
            return Err(Error::input(
                "factorisation found fewer than 4 usable columns of θo′ within ±90°",
            ));
        }
        let mut spectrum = Self {
            order,
            values,
            covariance,
            seen,
            folds,
            folded: vec![0.0; half.len()],
            changes: Vec::new(),
        };
        spectrum.extrapolate(half);
        Ok(spectrum)
    }

    /// Fills the nodes that were not seen by the line through the nearest seen nodes of B_p(θo′), three nodes apart
    /// against noise: a guess to start from, and a weak prior.
    ///
    /// Its variance is read from the data: the same line is drawn from as far inside the seen nodes as the node lies outside
    /// them, and compared with what was seen there. Twice that error is allowed, since curves grow towards grazing
    /// angles, and since it is common to all nodes on that side it is counted once for each.
    fn extrapolate(&mut self, half: &HalfCircle) {
        const APART: i64 = 3;
        let seen: Vec<i64> = (0..half.len() as i64)
            .filter(|&k| self.seen[k as usize])
            .collect();
        let (Some(&first), Some(&last)) = (seen.first(), seen.last()) else {
            return;
        };
        let is_seen = |k: i64| usize::try_from(k).is_ok_and(|k| self.seen.get(k) == Some(&true));
        let mut guesses = Vec::new();
        for k in (0..half.len() as i64).filter(|&k| !is_seen(k)) {
            // The two seen nodes that carry the line, how many nodes share its error, and the step inwards.
            let next = seen.partition_point(|&s| s < k);
            let (a, b, sharing, inwards) = if k < first {
                (first, first + APART, first, 1)
            } else if k > last {
                (last, last - APART, half.len() as i64 - 1 - last, -1)
            } else {
                let (a, b) = (seen[next - 1], seen[next]);
                (a, b, b - a - 1, 0)
            };
            let b = if is_seen(b) { b } else { a + inwards };
            let b = if is_seen(b) { b } else { a };
            let guess = self.line(a, b, k);
            let shift = inwards * sharing;
            let error = if inwards != 0 && [a, b, k].iter().all(|n| is_seen(n + shift)) {
                let inside = self.line(a + shift, b + shift, k + shift);
                let at = (k + shift) as usize;
                4.0 * mean_square(&inside, |p| self.get(p as i64, at))
            } else {
                mean_square(&guess, |_| Complex64::ZERO)
                    .max(mean_square(&self.line(a, a, k), |_| Complex64::ZERO))
            };
            guesses.push((k as usize, guess, sharing as f64 * error));
        }
        for (k, guess, variance) in guesses {
            for (p, c) in guess.into_iter().enumerate() {
                if p == 0 {
                    self.values[(0, k)] = c.re;
                } else {
                    self.values[(2 * p - 1, k)] = SQRT_2 * c.re;
                    self.values[(2 * p, k)] = SQRT_2 * c.im;
                }
            }
            self.covariance[k] = Covariance::White(variance.max(f64::MIN_POSITIVE));
        }
    }

    /// Gives the nodes that were not seen a standard deviation of ten times the largest power of any node: no prior to
    /// speak of.
    pub fn forget_guesses(&mut self) {
        let largest = (0..self.seen.len())
            .map(|k| self.values.col(k).iter().map(|v| v * v).sum::<f64>())
            .fold(f64::MIN_POSITIVE, f64::max);
        for (covariance, _) in self
            .covariance
            .iter_mut()
            .zip(&self.seen)
            .filter(|(_, s)| !**s)
        {
            *covariance = Covariance::White(100.0 * largest);
        }
    }

    /// B_p at node `k`, p = 0 … order, on the line through nodes `a` and `b` (constant if they are the same).
    ///
    /// A mirror's B_p turns as e^{−ipθo′}: where it would turn by more than [`MOST_TURN`] from `a` to `k`, the line is
    /// drawn in the frame that turns with the nodes.
    fn line(&self, a: i64, b: i64, k: i64) -> Vec<Complex64> {
        let t = if a == b {
            0.0
        } else {
            (k - a) as f64 / (b - a) as f64
        };
        (0..=self.order as i64)
            .map(|p| {
                let (near, far) = (self.get(p, a as usize), self.get(p, b as usize));
                let turn = (far * near.conj()).arg();
                if (turn * t).abs() < MOST_TURN {
                    return (1.0 - t) * near + t * far;
                }
                let along = (1.0 - t) * near + t * far * Complex64::cis(-turn);
                // A line that crosses zero has told all it can: then the amplitude is held.
                let crossed = along.norm() > 3.0 * near.norm() || (along * near.conj()).re < 0.0;
                (if crossed { near } else { along }) * Complex64::cis(turn * t)
            })
            .collect()
    }

    /// Adds to every column's variance what frequencies beyond those resolved would put onto those that are.
    ///
    /// Sharp light on the kinks of ρ̂ at grazing angles gives B_p that fall off as 1/p² without end. Their power is taken
    /// from the last quarter of the resolved frequencies, by that law. (Where the light is band-limited nothing but noise
    /// is there, and nothing is added.)
    pub fn add_folded_variance(&mut self) {
        let (first, last) = ((3 * self.order) / 4 + 1, self.order);
        if first > last {
            return;
        }
        for k in (0..self.seen.len()).filter(|&k| self.seen[k]) {
            let (mut kink, mut scatter, mut count) = (0.0, 0.0, 0.0);
            for p in first..=last {
                let (law, noise) = ((p as f64).powi(4), self.covariance[k].at(p));
                for i in [2 * p - 1, 2 * p] {
                    kink += law * (self.values[(i, k)].powi(2) - noise);
                    scatter += 2.0 * (law * noise).powi(2);
                    count += 1.0;
                }
            }
            // Excess below the scatter of the noise's own power is no excess.
            if kink > 3.0 * scatter.sqrt() {
                self.folded[k] = kink / count;
            }
        }
    }

    /// Variance of each of the two values of B_p at node `k`.
    pub fn variance(&self, p: usize, k: usize) -> f64 {
        self.covariance[k].at(p) + self.folds[(p, k)] * self.folded[k]
    }

    /// B_p at node `k`, complex, for any sign of p.
    pub fn get(&self, p: i64, k: usize) -> Complex64 {
        let q = p.unsigned_abs() as usize;
        if q == 0 {
            return Complex64::new(self.values[(0, k)], 0.0);
        }
        let c = Complex64::new(self.values[(2 * q - 1, k)], self.values[(2 * q, k)]) / SQRT_2;
        if p < 0 { c.conj() } else { c }
    }

    /// The same with frequencies up to `order` only.
    pub fn truncated(&self, order: usize) -> Self {
        let size = 2 * order + 1;
        let covariance = self
            .covariance
            .iter()
            .map(|c| match c {
                Covariance::White(v) => Covariance::White(*v),
                Covariance::Full(c) => Covariance::Full(Mat::from_fn(size, size, |i, j| c[(i, j)])),
            })
            .collect();
        Self {
            order,
            values: Mat::from_fn(size, self.values.ncols(), |i, k| self.values[(i, k)]),
            covariance,
            seen: self.seen.clone(),
            folds: self.folds.subrows(0, order + 1).to_owned(),
            folded: self.folded.clone(),
            changes: self
                .changes
                .iter()
                .map(|c| c.subrows(0, size).to_owned())
                .collect(),
        }
    }

    /// Per p, the power of B_p over all seen nodes in units of what noise alone would give.
    pub fn signal_to_noise(&self) -> Vec<f64> {
        (0..=self.order)
            .map(|p| {
                let (mut sum, mut count) = (0.0, 0.0);
                for k in (0..self.seen.len()).filter(|&k| self.seen[k]) {
                    let variance = self.variance(p, k);
                    let rows = if p == 0 { 0..1 } else { 2 * p - 1..2 * p + 1 };
                    for i in rows {
                        sum += self.values[(i, k)].powi(2) / variance;
                        count += 1.0;
                    }
                }
                sum / f64::max(count, 1.0)
            })
            .collect()
    }
}

fn mixed(left: &Covariance, right: &Covariance, t: f64, size: usize) -> Covariance {
    let (a, b) = ((1.0 - t) * (1.0 - t), t * t);
    match (left, right) {
        (Covariance::White(l), Covariance::White(r)) => Covariance::White(a * l + b * r),
        _ => {
            let at = |c: &Covariance, i: usize, j: usize| match c {
                Covariance::White(v) if i == j => *v,
                Covariance::White(_) => 0.0,
                Covariance::Full(m) => m[(i, j)],
            };
            Covariance::Full(Mat::from_fn(size, size, |i, j| {
                a * at(left, i, j) + b * at(right, i, j)
            }))
        }
    }
}

/// What each error of `systematics` does to the spectrum that [`Spectrum::fit`] finds, m × N each; 0 at nodes that were not
/// seen.
pub(super) fn changes(
    samples: &Samples,
    channel: usize,
    half: &HalfCircle,
    order: usize,
    systematics: &[Systematic],
) -> Vec<Mat<f64>> {
    let size = 2 * order + 1;
    if systematics.is_empty() {
        return Vec::new();
    }
    let expected = Expected::of(samples, channel, order);
    let fits: Vec<(f64, Vec<Vec<f64>>)> = samples
        .columns
        .par_iter()
        .enumerate()
        .filter_map(|(j, column)| {
            let missing = vec![0.0; column.alpha.len()];
            let own = |s: &'_ Systematic| -> Vec<f64> {
                s.change
                    .get(channel)
                    .and_then(|c| c.get(j))
                    .filter(|c| c.len() == column.alpha.len())
                    .unwrap_or(&missing)
                    .clone()
            };
            let targets: Vec<Vec<f64>> = systematics.iter().map(own).collect();
            let targets: Vec<&[f64]> = targets.iter().map(Vec::as_slice).collect();
            let fit = ColumnFit::new(column, channel, order, expected.as_ref())?;
            Some((column.local.rad(), fit.values(&targets)))
        })
        .collect();
    let places = places(&fits.iter().map(|f| f.0).collect::<Vec<_>>(), half);
    (0..systematics.len())
        .map(|s| {
            Mat::from_fn(size, half.len(), |i, k| {
                places[k].map_or(0.0, |[(left, near), (right, far)]| {
                    near * fits[left].1[s][i] + far * fits[right].1[s][i]
                })
            })
        })
        .collect()
}

/// For each node the two of the increasing `angles` (radians) that it lies between, with their weights, or twice the one that it stands
/// on; `None` where there are none near enough.
fn places(angles: &[f64], half: &HalfCircle) -> Vec<Option<[(usize, f64); 2]>> {
    let at = |angle: f64| {
        let above = angles.partition_point(|a| *a < angle - 0.02 * half.step());
        let right = *angles.get(above)?;
        if (right - angle).abs() <= 0.02 * half.step() {
            return Some([(above, 1.0), (above, 0.0)]);
        }
        let left = *angles.get(above.checked_sub(1)?)?;
        if right - left > 2.5 * half.step() {
            return None;
        }
        let t = (angle - left) / (right - left);
        Some([(above - 1, 1.0 - t), (above, t)])
    };
    half.angles.iter().map(|&angle| at(angle)).collect()
}
