//! The Fourier coefficients of a column from irregular, missing, weighted samples.
//!
//! As many views as the light has frequencies leave nothing to spare: with one of them missing, or with their directions a tenth of a
//! degree off the regular ones, least squares of all resolved frequencies pass through every sample and swing in between, by as much
//! as the frequencies *beyond* those resolved let them. So every frequency is expected to have about the power that it has in the
//! other columns, and those beyond the resolved ones that of kinks, κ/q⁴; then the best linear estimate is what a
//! Gaussian process of that spectrum gives (N. Cressie, Statistics for Spatial Data, 1993, section 3.4, with the resolved frequencies all but free).
//! Where samples are regular it is the discrete Fourier transform.

use std::f64::consts::{PI, SQRT_2};

use faer::linalg::solvers::{Llt, Solve};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Mat, Par, Scale, Side};
use rayon::prelude::*;

use super::columns::Covariance;
use super::folded::{REACH, power};
use crate::fourier::CircleTransform;
use crate::light_field::{Column, Samples};

/// How many times the expected power a frequency of one column may have: it changes what was seen by less than the noise's
/// share of that.
const SLACK: f64 = 100.0;
/// Columns from which the expected power is taken, and rounds of taking it (expectation and maximisation).
const PILOTS: usize = 16;
const ROUNDS: usize = 3;
/// Part of the most complete column's samples that a pilot has.
const COMPLETE: f64 = 0.95;

/// What is expected of the spectrum of every column of one channel, relative to the column's mean square.
#[derive(Clone, Debug)]
pub(super) struct Expected {
    /// Power of each of the real values of frequency p, \[order + 1\].
    power: Vec<f64>,
    /// κ: beyond the order, each value of frequency q has κ / q⁴.
    kink: f64,
}

impl Expected {
    /// From the columns of `channel` that are the most complete; `None` if there is nothing to be seen.
    ///
    /// It begins with power that falls off as 1/p², slower than that of kinks.
    pub fn of(samples: &Samples, channel: usize, order: usize) -> Option<Self> {
        let present: Vec<(&Column, usize)> = samples
            .columns
            .iter()
            .map(|column| (column, present(column, channel).len()))
            .collect();
        let most = present.iter().map(|p| p.1).max()?;
        let complete: Vec<&Column> = present
            .iter()
            .filter(|p| p.1 > 0 && p.1 as f64 >= COMPLETE * most as f64)
            .map(|p| p.0)
            .collect();
        let pilots: Vec<&Column> = (0..PILOTS.min(complete.len()))
            .map(|i| complete[i * complete.len() / PILOTS.min(complete.len())])
            .collect();
        let start: Vec<f64> = (0..=order).map(|p| (1.0 + p as f64).powi(-2)).collect();
        let total: f64 = start[0] + 2.0 * start[1..].iter().sum::<f64>();
        let mut expected = Self::new(start.iter().map(|s| s / total).collect());
        for _ in 0..ROUNDS {
            let found: Vec<(f64, Vec<f64>)> = pilots
                .par_iter()
                .filter_map(|column| {
                    let fit = ColumnFit::with_slack(column, channel, order, Some(&expected), 1.0)?;
                    let values = fit.values(&[column.value.get(channel)?]).pop()?;
                    let covariance = fit.total();
                    let power = (0..=order)
                        .map(|p| {
                            let square = if p == 0 {
                                values[0].powi(2)
                            } else {
                                0.5 * (values[2 * p - 1].powi(2) + values[2 * p].powi(2))
                            };
                            square + covariance.at(p)
                        })
                        .collect();
                    Some((mean_square(column, channel), power))
                })
                .collect();
            let weight: f64 = found.iter().map(|f| f.0).sum();
            if weight.is_nan() || weight <= 0.0 {
                return None;
            }
            expected = Self::new(
                (0..=order)
                    .map(|p| found.iter().map(|f| f.1[p]).sum::<f64>() / weight)
                    .collect(),
            );
        }
        Some(expected)
    }

    /// The same where a share of `left` of the power beyond the order is still in the samples.
    pub fn without_kinks(self, left: f64) -> Self {
        Self {
            kink: self.kink * left,
            ..self
        }
    }

    /// With κ from the last quarter of the frequencies.
    fn new(power: Vec<f64>) -> Self {
        let order = power.len() - 1;
        let last = (3 * order) / 4 + 1..=order;
        let kinks: Vec<f64> = last.map(|p| power[p] * (p as f64).powi(4)).collect();
        Self {
            kink: kinks.iter().sum::<f64>() / kinks.len().max(1) as f64,
            power,
        }
    }
}

/// Samples of the column that have a value.
fn present(column: &Column, channel: usize) -> Vec<usize> {
    let (Some(value), Some(variance)) = (column.value.get(channel), column.variance.get(channel))
    else {
        return Vec::new();
    };
    (0..column.alpha.len())
        .filter(|&i| variance[i].is_finite() && variance[i] > 0.0 && value[i].is_finite())
        .collect()
}

fn mean_square(column: &Column, channel: usize) -> f64 {
    let present = present(column, channel);
    let sum: f64 = present
        .iter()
        .map(|&i| column.value[channel][i].powi(2))
        .sum();
    sum / present.len().max(1) as f64
}

/// The estimate of one column's coefficients, a linear map of its samples.
pub(super) enum ColumnFit<'a> {
    /// A complete regular circle of `n` samples with one variance: the discrete Fourier transform.
    Regular {
        n: usize,
        order: usize,
        variance: f64,
    },
    /// Anything else.
    Irregular(Irregular<'a>),
}

/// Generalised least squares with a prior: covariance of the samples C = root · rootᵀ.
pub(super) struct Irregular<'a> {
    column: &'a Column,
    present: Vec<usize>,
    root: Llt<f64>,
    /// root⁻¹ times the exponentials at the samples, n × m.
    design: Mat<f64>,
    /// Of the information matrix, m × m.
    factor: Llt<f64>,
    order: usize,
    kink: f64,
}

impl<'a> ColumnFit<'a> {
    /// For frequencies up to `order`; nothing if no sample is present.
    ///
    /// Without anything `expected` they have ten times the column's rms, and nothing lies beyond.
    pub fn new(
        column: &'a Column,
        channel: usize,
        order: usize,
        expected: Option<&Expected>,
    ) -> Option<Self> {
        Self::with_slack(column, channel, order, expected, SLACK)
    }

    fn with_slack(
        column: &'a Column,
        channel: usize,
        order: usize,
        expected: Option<&Expected>,
        slack: f64,
    ) -> Option<Self> {
        let variance = column.variance.get(channel)?;
        let present = present(column, channel);
        let first = variance[*present.first()?];
        let n = column.alpha.len();
        let even = present.len() == n && variance.iter().all(|v| (v - first).abs() <= 1e-9 * first);
        if even && n > 2 * order && column.regular().is_some() {
            return Some(Self::Regular {
                n,
                order,
                variance: first,
            });
        }
        let size = 2 * order + 1;
        let power = mean_square(column, channel);
        let kink = expected.map_or(0.0, |e| e.kink * power);
        let mut own = if kink > 0.0 {
            beyond(column, &present, order) * Scale(kink)
        } else {
            Mat::zeros(present.len(), present.len())
        };
        for (i, &sample) in present.iter().enumerate() {
            own[(i, i)] += variance[sample];
        }
        let root = own.llt(Side::Lower).ok()?;
        let mut design = Mat::from_fn(present.len(), size, |row, i| {
            let phase = i.div_ceil(2) as f64 * column.alpha[present[row]];
            match (i, i % 2) {
                (0, _) => 1.0,
                (_, 1) => SQRT_2 * phase.cos(),
                _ => -SQRT_2 * phase.sin(),
            }
        });
        solve_lower_triangular_in_place(root.L(), design.as_mut(), Par::Seq);
        let noise = present.iter().map(|&i| variance[i]).sum::<f64>() / present.len() as f64;
        let mut information = design.transpose() * &design;
        for i in 0..size {
            let prior = match expected {
                Some(e) => slack * power * e.power[i.div_ceil(2)],
                None => 100.0 * (power + noise),
            };
            information[(i, i)] += 1.0 / prior.max(f64::MIN_POSITIVE);
        }
        let factor = information.llt(Side::Lower).ok()?;
        Some(Self::Irregular(Irregular {
            column,
            present,
            root,
            design,
            factor,
            order,
            kink,
        }))
    }

    /// The m coefficients, in the real basis, of each of the `targets`, values at the column's samples.
    pub fn values(&self, targets: &[&[f64]]) -> Vec<Vec<f64>> {
        match self {
            Self::Regular { n, order, .. } => {
                let transform = CircleTransform::new(*n, -PI + PI / *n as f64);
                let values = targets.iter().map(|target| {
                    let series = transform.analyse(target, *order);
                    let mut values = vec![series.coefficients[0].re];
                    for c in series.coefficients.iter().skip(1) {
                        values.extend([SQRT_2 * c.re, SQRT_2 * c.im]);
                    }
                    values
                });
                values.collect()
            }
            Self::Irregular(fit) => {
                let mut target = Mat::from_fn(fit.present.len(), targets.len(), |row, t| {
                    targets[t][fit.present[row]]
                });
                solve_lower_triangular_in_place(fit.root.L(), target.as_mut(), Par::Seq);
                let solved = fit.factor.solve(fit.design.transpose() * target);
                (0..targets.len())
                    .map(|t| (0..solved.nrows()).map(|i| solved[(i, t)]).collect())
                    .collect()
            }
        }
    }

    /// Covariance of the coefficients of the column's own values by noise, frequencies beyond the order, and what was not seen.
    fn total(&self) -> Covariance {
        match self {
            Self::Regular { n, variance, .. } => Covariance::White(variance / *n as f64),
            Self::Irregular(fit) => {
                let size = fit.design.ncols();
                Covariance::Full(fit.factor.solve(Mat::<f64>::identity(size, size)))
            }
        }
    }

    /// The same without frequencies beyond the order, and what those add to the variance of each of the two values of frequency p if
    /// they have the power 1/q⁴, \[order + 1\].
    pub fn covariance(&self) -> (Covariance, Vec<f64>) {
        match (self, self.total()) {
            (Self::Irregular(fit), Covariance::Full(total)) => {
                // M K Mᵀ with M the linear map from samples to values, K the covariance of kinks.
                let rows = fit.present.len();
                let mut whitener = Mat::<f64>::identity(rows, rows);
                solve_lower_triangular_in_place(fit.root.L(), whitener.as_mut(), Par::Seq);
                let map = fit.factor.solve(fit.design.transpose() * whitener);
                let kinks = beyond(fit.column, &fit.present, fit.order);
                let folded = &map * kinks * map.transpose();
                let own = Covariance::Full(total - &folded * Scale(fit.kink));
                let folds = Covariance::Full(folded);
                (own, (0..=fit.order).map(|p| folds.at(p)).collect())
            }
            (Self::Regular { n, order, .. }, total) => {
                (total, (0..=*order).map(|p| power(p, *n)).collect())
            }
            (Self::Irregular(_), white) => (white, Vec::new()),
        }
    }
}

/// Covariance of samples of kinks, Σ_q (2 / q⁴) cos q(α − α′), over the frequencies beyond `order`.
fn beyond(column: &Column, present: &[usize], order: usize) -> Mat<f64> {
    let frequencies: Vec<usize> = (order + 1..=REACH * (order + 1)).collect();
    // cos q(α − α′) = cos qα cos qα′ + sin qα sin qα′.
    let mut waves = Mat::zeros(2 * frequencies.len(), present.len());
    for (i, &sample) in present.iter().enumerate() {
        for (c, &q) in frequencies.iter().enumerate() {
            let q = q as f64;
            let (sin, cos) = (q * column.alpha[sample]).sin_cos();
            waves[(2 * c, i)] = SQRT_2 * cos / (q * q);
            waves[(2 * c + 1, i)] = SQRT_2 * sin / (q * q);
        }
    }
    waves.transpose() * &waves
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::angle::LocalAngle;

    /// max(0, cos α): 1/π, 1/4, and (−1)^{p/2+1} / (π (p² − 1)) at even p; its kinks are those of a sun that grazes.
    fn clamped_cosine(p: usize) -> f64 {
        match p {
            0 => 1.0 / PI,
            1 => 0.25,
            p if p.is_multiple_of(2) => {
                let sign = if p.is_multiple_of(4) { -1.0 } else { 1.0 };
                sign / (PI * ((p * p) as f64 - 1.0))
            }
            _ => 0.0,
        }
    }

    /// Twenty columns of turned clamped cosines at `views` directions that are `jitter` degrees off, without those `missing`.
    fn columns(views: usize, jitter: f64, missing: &[usize]) -> Samples {
        let turned = |j: usize| 0.3 * j as f64;
        let columns = (0..20).map(|j| {
            let alpha: Vec<f64> = (0..views)
                .filter(|i| !missing.contains(i))
                .map(|i| {
                    let off = jitter.to_radians() * (7.3 * i as f64 + j as f64).sin();
                    TAU * i as f64 / views as f64 + off
                })
                .collect();
            let value = alpha
                .iter()
                .map(|a| (a - turned(j)).cos().max(0.0))
                .collect();
            Column {
                local: LocalAngle::degrees(4.0 * j as f64 - 38.0),
                view: (0..alpha.len() as u32).collect(),
                value: vec![value],
                variance: vec![vec![1e-12; alpha.len()]],
                alpha,
            }
        });
        Samples {
            channels: vec!["Y".into()],
            columns: columns.collect(),
        }
    }

    /// Root mean square error of the coefficients of all columns, with and without an expectation.
    fn errors(samples: &Samples, order: usize) -> [f64; 2] {
        let expected = Expected::of(samples, 0, order);
        [expected.as_ref(), None].map(|expected| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (j, column) in samples.columns.iter().enumerate() {
                let fit = ColumnFit::new(column, 0, order, expected).expect("samples");
                let values = fit.values(&[&column.value[0]]).pop().expect("a target");
                for p in 1..=order {
                    let turn = -(p as f64) * 0.3 * j as f64;
                    let truth = SQRT_2 * clamped_cosine(p);
                    sum += (values[2 * p - 1] - truth * turn.cos()).powi(2)
                        + (values[2 * p] - truth * turn.sin()).powi(2);
                    count += 2.0;
                }
            }
            f64::sqrt(sum / count)
        })
    }

    #[test]
    fn a_missing_view_costs_no_more_than_a_few_times_what_folds() {
        // What 72 even views fold onto the last frequencies is 1/(π 37²) = 2e-4, 1e-4 in the mean over all.
        let [regular, plain] = errors(&columns(72, 0.0, &[]), 35);
        assert!(regular < 1.5e-4, "{regular:e}");
        assert!(
            (regular - plain).abs() < 0.2 * plain,
            "{regular:e} {plain:e}"
        );
        for (jitter, missing) in [(0.1, vec![]), (0.1, vec![11]), (0.3, vec![11, 40])] {
            let order = (71 - missing.len()) / 2;
            let [expected, plain] = errors(&columns(72, jitter, &missing), order);
            assert!(
                expected < 5.0 * regular,
                "{jitter} {missing:?}: {expected:e}"
            );
            // With a sample less than needed nothing holds back what swings in between.
            assert!(
                missing.len() != 1 || plain > 2.0 * expected,
                "{jitter} {missing:?}: {plain:e}"
            );
        }
    }
}
