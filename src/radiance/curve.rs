//! A response curve fitted to patches that were photographed at several exposure times.
//!
//! With g(z) the logarithm of the linear value of code z, patch i of light E_i, seen in exposure j of time
//! t_j (1 + τ_j), obeys
//!
//! ```text
//! g(z_ij) = ln E_i + ln t_j + τ_j,     with the variance (g′(z_ij) σ_ij)²
//! ```
//!
//! where σ_ij is the noise of the mean code. g is a cubic spline in u = ln((z − black)/(white − z)): a
//! power of the code, a logistic film curve and a straight line are all smooth in it, at both ends. The
//! weight of the spline's second differences is the one of the largest marginal likelihood; residuals
//! beyond three standard deviations lose weight; a fall of the curve is not let be. The E_i are eliminated,
//! the τ_j are common to all channels and small: how small is learnt from them.

use nalgebra::{DMatrix, DVector};

use crate::error::{Error, Result};

/// Pieces of the spline over the codes that were seen.
pub(super) const PIECES: usize = 24;
const COEFFICIENTS: usize = PIECES + 3;

/// How far stated exposure times are off, as a standard deviation of their logarithm, before the photos are looked at: the round
/// numbers on the dial differ from the powers of two that cameras keep by up to 7 %, most of them by less. And how many exposures
/// this counts as, against those that show what this shutter does.
const TIME_ERROR: f64 = 0.03;
const TIMES_THOUGHT: f64 = 2.0;

/// Error of the logarithm of light that no noise explains: the light's and the shutter's jitter.
const FLOOR: f64 = 0.003;

/// Residual, in standard deviations, from which a measurement loses weight.
const OUTLIER: f64 = 3.0;

/// Rounds of weighting anew, and those after which the times' scatter is learnt from them.
const ROUNDS: usize = 12;
const SETTLED: usize = 3;

/// Weight of what must hold exactly, far above that of all patches together.
const HOLD: f64 = 1e11;

/// Patches that count as independent in what no noise explains.
const INDEPENDENT: f64 = 50.0;

/// The least rise of a coefficient of g over the one before.
const LEAST_RISE: f64 = 1e-3;

/// The range of codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Codes {
    /// The code of no light.
    pub black: f64,
    /// The code from which pixels are clipped.
    pub white: f64,
}

impl Codes {
    /// u of a code; half a step keeps the ends finite.
    fn u(self, code: f64) -> f64 {
        let half = 0.5;
        let up = (code - self.black).max(0.0) + half;
        let down = (self.white - code).max(0.0) + half;
        (up / down).ln()
    }

    /// du/dz.
    fn slope(self, code: f64) -> f64 {
        let up = (code - self.black).max(0.0) + 0.5;
        let down = (self.white - code).max(0.0) + 0.5;
        1.0 / up + 1.0 / down
    }

    /// Codes of a table that is straight between them to far less than a step.
    pub(super) fn table(self) -> Vec<f64> {
        let range = self.white - self.black;
        if range <= 1024.0 {
            let last = range.ceil() as u32;
            return (0..=last)
                .map(|k| (self.black + f64::from(k)).min(self.white))
                .collect();
        }
        // Even steps in u, none below a code.
        let (low, high) = (self.u(self.black), self.u(self.white));
        let mut table = vec![self.black];
        for k in 1..2048 {
            let u = low + (high - low) * f64::from(k) / 2048.0;
            let part = 1.0 / (1.0 + (-u).exp());
            let code = (self.black - 0.5 + part * (range + 1.0)).round();
            if table.last().is_some_and(|last| code > *last) && code < self.white {
                table.push(code);
            }
        }
        table.push(self.white);
        table
    }
}

/// A patch of even light.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Patch {
    /// What each exposure shows of it.
    pub seen: Vec<Seen>,
}

/// A patch in one exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seen {
    /// Number of the exposure time.
    pub time: usize,
    /// Mean code.
    pub code: f64,
    /// Standard deviation of the mean.
    pub sigma: f64,
}

/// The curves of all channels.
pub(super) struct Fitted {
    pub channels: Vec<LogCurve>,
    /// By exposure time: what the stated one is to be multiplied by.
    pub time_factors: Vec<f64>,
    /// Standard deviations of their logarithms.
    pub time_sigmas: Vec<f64>,
    /// Root of the mean square residual in units of its σ.
    pub misfit: f64,
}

/// g of one channel, 0 at the middle code.
pub(super) struct LogCurve {
    codes: Codes,
    knots: Knots,
    coefficients: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl LogCurve {
    /// Basis of g(z) − g(middle).
    fn basis(&self, code: f64) -> DVector<f64> {
        let middle = (self.codes.black + self.codes.white) / 2.0;
        self.knots.basis(self.codes.u(code)).0 - self.knots.basis(self.codes.u(middle)).0
    }

    /// Linear values of codes; 0 for no light.
    pub(super) fn linear(&self, codes: &[f64]) -> Vec<f64> {
        codes
            .iter()
            .map(|&code| {
                if code <= self.codes.black {
                    return 0.0;
                }
                self.basis(code).dot(&self.coefficients).exp()
            })
            .collect()
    }

    /// Standard deviations of the linear values.
    pub(super) fn sigma(&self, codes: &[f64]) -> Vec<f64> {
        let linear = self.linear(codes);
        codes
            .iter()
            .zip(linear)
            .map(|(&code, linear)| {
                let basis = self.basis(code);
                linear * basis.dot(&(&self.covariance * &basis)).max(0.0).sqrt()
            })
            .collect()
    }
}

/// Even knots of a cubic B-spline over the u that were seen; straight beyond.
#[derive(Clone, Copy)]
struct Knots {
    low: f64,
    step: f64,
}

impl Knots {
    /// Values of the basis functions at u and their slopes.
    fn basis(self, u: f64) -> (DVector<f64>, DVector<f64>) {
        let at = (u - self.low) / self.step;
        let inside = at.clamp(0.0, PIECES as f64);
        let piece = (inside as usize).min(PIECES - 1);
        let x = inside - piece as f64;
        let y = 1.0 - x;
        let value = [
            y * y * y / 6.0,
            (3.0 * x * x * x - 6.0 * x * x + 4.0) / 6.0,
            (3.0 * y * y * y - 6.0 * y * y + 4.0) / 6.0,
            x * x * x / 6.0,
        ];
        let slope = [
            -y * y / 2.0,
            (3.0 * x * x - 4.0 * x) / 2.0,
            -(3.0 * y * y - 4.0 * y) / 2.0,
            x * x / 2.0,
        ];
        let mut values = DVector::zeros(COEFFICIENTS);
        let mut slopes = DVector::zeros(COEFFICIENTS);
        for (k, (v, s)) in value.into_iter().zip(slope).enumerate() {
            values[piece + k] = v + s * (at - inside);
            slopes[piece + k] = s / self.step;
        }
        (values, slopes)
    }
}

/// Fits the curves of all channels; `patches` by channel, `seconds` the stated exposure times.
///
/// # Errors
/// The patches do not determine the curves.
pub(super) fn fit(patches: &[Vec<Patch>], seconds: &[f64], codes: Codes) -> Result<Fitted> {
    let knots: Vec<Knots> = patches.iter().map(|p| knots(p, codes)).collect();
    let unknowns = patches.len() * COEFFICIENTS + seconds.len();
    let smooth = smoothness(patches.len(), unknowns);
    let mut thought = Thought::first(seconds.len());
    let mut solution: Option<DVector<f64>> = None;
    let mut weights: Vec<Vec<Vec<f64>>> = patches
        .iter()
        .map(|p| p.iter().map(|patch| vec![1.0; patch.seen.len()]).collect())
        .collect();
    let mut last = None;
    // What no noise explains weighs less against what is thought of the times: as noise does, and as
    // what neighbouring patches have in common.
    let count = patches.iter().map(Vec::len).sum::<usize>() as f64;
    let mut excess = 1.0;
    let first = patches.len() * COEFFICIENTS;
    for round in 0..ROUNDS {
        let system = System::gather(
            patches,
            seconds,
            codes,
            &knots,
            &weights,
            solution.as_ref(),
            unknowns,
        );
        let prior = Prior {
            fixed: thought.fixed(patches.len(), seconds, unknowns),
            smooth: &smooth,
            rank: (patches.len() * (COEFFICIENTS - 2)) as f64,
        };
        let (x, covariance, scale) = system.solve(&prior, excess).ok_or_else(|| {
            Error::input("the brackets do not determine the response")
                .key("sensor.encoding")
                .advice("Exposure times must differ, and the photos overlap in brightness.")
        })?;
        // The prior of the times was multiplied by it.
        let covariance = covariance * excess;
        if round + 1 < ROUNDS {
            reweigh(patches, seconds, codes, &knots, &x, scale, &mut weights);
            if round >= SETTLED {
                let variances: Vec<f64> =
                    covariance.diagonal().iter().skip(first).copied().collect();
                thought.learn(x.rows(first, seconds.len()).as_slice(), &variances);
            }
        }
        excess = 1.0 + (scale * scale - 1.0).max(0.0) * (1.0 + count / INDEPENDENT);
        solution = Some(x.clone());
        last = Some((x, covariance, scale));
    }
    let Some((x, covariance, scale)) = last else {
        return Err(Error::failed("the response was not fitted"));
    };
    let channels = knots
        .iter()
        .enumerate()
        .map(|(c, knots)| LogCurve {
            codes,
            knots: *knots,
            coefficients: x.rows(c * COEFFICIENTS, COEFFICIENTS).into_owned(),
            covariance: covariance
                .view(
                    (c * COEFFICIENTS, c * COEFFICIENTS),
                    (COEFFICIENTS, COEFFICIENTS),
                )
                .into_owned(),
        })
        .collect();
    Ok(Fitted {
        channels,
        time_sigmas: covariance
            .diagonal()
            .iter()
            .skip(first)
            .map(|v| v.max(0.0).sqrt())
            .collect(),
        time_factors: x
            .rows(first, seconds.len())
            .iter()
            .map(|t| t.exp())
            .collect(),
        misfit: scale,
    })
}

fn knots(patches: &[Patch], codes: Codes) -> Knots {
    let us = patches
        .iter()
        .flat_map(|p| &p.seen)
        .map(|seen| codes.u(seen.code));
    let (low, high) = us.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), u| {
        (low.min(u), high.max(u))
    });
    Knots {
        low,
        step: ((high - low) / PIECES as f64).max(1e-6),
    }
}

/// What is thought before the photos are looked at.
struct Prior<'a> {
    /// Second differences of each curve, to be scaled.
    smooth: &'a DMatrix<f64>,
    /// The times, and a weak hold of the curves' common constant, which the E_i leave free.
    fixed: DMatrix<f64>,
    /// Rank of `smooth`.
    rank: f64,
}

fn smoothness(channels: usize, unknowns: usize) -> DMatrix<f64> {
    let mut smooth = DMatrix::zeros(unknowns, unknowns);
    for c in 0..channels {
        let first = c * COEFFICIENTS;
        for k in first..first + COEFFICIENTS - 2 {
            for (i, a) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                for (j, b) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                    smooth[(k + i, k + j)] += a * b;
                }
            }
        }
    }
    smooth
}

/// What is thought of the exposure times.
struct Thought {
    /// Variance of the logarithms of their errors.
    variance: f64,
    /// By exposure time: how far the photos leave the logarithm open, as a variance.
    open: Vec<f64>,
}

impl Thought {
    fn first(times: usize) -> Self {
        Self {
            variance: TIME_ERROR * TIME_ERROR,
            open: vec![0.0; times],
        }
    }

    /// From errors τ that were found, with what the prior left of their variances: the step of expectation and maximisation.
    fn learn(&mut self, found: &[f64], variances: &[f64]) {
        let squares = found.iter().zip(variances).map(|(t, v)| t * t + v);
        // Two of them hold the scale and the power of light.
        let shown = (found.len() as f64 - 2.0).max(0.0);
        let thought = TIMES_THOUGHT * TIME_ERROR * TIME_ERROR;
        let learnt = (squares.sum::<f64>() + thought) / (shown + TIMES_THOUGHT);
        // Never more than is thought: an exposure that the fit has lost would make room for itself.
        self.variance = match shown > 0.0 {
            true => learnt.min(TIME_ERROR * TIME_ERROR),
            false => TIME_ERROR * TIME_ERROR,
        };
        // A normal prior of this variance took v = 1/(1/variance + 1/open).
        for (open, v) in self.open.iter_mut().zip(variances) {
            let precision = (1.0 / v - 1.0 / self.variance).max(0.01 / self.variance);
            *open = 1.0 / precision;
        }
    }

    /// The prior's precision.
    ///
    /// A power of all times, with the curves to the same power, leaves the misfit 0 as it is and shrinks that of
    /// noise; so the stated times are taken to be right on the whole: Σ w_j τ_j = 0 and Σ w_j τ_j ln t_j = 0, where w_j is
    /// the weight of time j in the mean of errors that scatter and are found with their variances.
    fn fixed(&self, channels: usize, seconds: &[f64], unknowns: usize) -> DMatrix<f64> {
        let mut fixed = DMatrix::zeros(unknowns, unknowns);
        for first in (0..channels).map(|c| c * COEFFICIENTS) {
            for k in first..first + COEFFICIENTS {
                for m in first..first + COEFFICIENTS {
                    fixed[(k, m)] += 1.0 / (COEFFICIENTS * COEFFICIENTS) as f64;
                }
            }
        }
        let first = channels * COEFFICIENTS;
        let weights: Vec<f64> = self
            .open
            .iter()
            .map(|o| 1.0 / (self.variance + o))
            .collect();
        let total = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let shares: Vec<(f64, f64)> = weights
            .iter()
            .zip(seconds)
            .map(|(w, t)| (w / total, t.ln()))
            .collect();
        let mean = shares.iter().map(|(n, log)| n * log).sum::<f64>();
        for (i, (n, a)) in shares.iter().enumerate() {
            fixed[(first + i, first + i)] += 1.0 / self.variance;
            for (j, (m, b)) in shares.iter().enumerate() {
                fixed[(first + i, first + j)] += HOLD * n * m * (1.0 + (a - mean) * (b - mean));
            }
        }
        fixed
    }
}

/// One equation: its row, right side and variance.
fn equation(
    seen: &Seen,
    seconds: &[f64],
    codes: Codes,
    knots: Knots,
    coefficients: Option<&[f64]>,
) -> (DVector<f64>, f64, f64) {
    let (values, slopes) = knots.basis(codes.u(seen.code));
    let slope = match coefficients {
        Some(a) => slopes.iter().zip(a).map(|(s, a)| s * a).sum::<f64>(),
        // To begin with, a power of 2 on a straight line.
        None => 2.0,
    };
    let per_code = slope.abs().max(1e-3) * codes.slope(seen.code);
    let time = seconds.get(seen.time).copied().unwrap_or(1.0);
    (
        values,
        time.ln(),
        (per_code * seen.sigma).powi(2) + FLOOR * FLOOR,
    )
}

/// Normal equations with the light of every patch eliminated.
struct System {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    squares: f64,
    /// Equations less patches.
    freedom: f64,
}

impl System {
    fn gather(
        patches: &[Vec<Patch>],
        seconds: &[f64],
        codes: Codes,
        knots: &[Knots],
        weights: &[Vec<Vec<f64>>],
        solution: Option<&DVector<f64>>,
        unknowns: usize,
    ) -> Self {
        let mut normal = DMatrix::zeros(unknowns, unknowns);
        let mut right = DVector::zeros(unknowns);
        let (mut squares, mut freedom) = (0.0, 0.0);
        let times = patches.len() * COEFFICIENTS;
        for (c, ((patches, knots), weights)) in patches.iter().zip(knots).zip(weights).enumerate() {
            let first = c * COEFFICIENTS;
            let own = solution.and_then(|x| x.as_slice().get(first..first + COEFFICIENTS));
            for (patch, weights) in patches.iter().zip(weights) {
                // Σw, Σw·row and Σw·rhs give what eliminating ln E takes away.
                let (mut sum, mut mean) = (0.0, 0.0);
                let mut row_sum: Vec<(usize, f64)> = Vec::new();
                for (seen, robust) in patch.seen.iter().zip(weights) {
                    let (values, rhs, variance) = equation(seen, seconds, codes, *knots, own);
                    let w = robust / variance;
                    let mut row: Vec<(usize, f64)> = values
                        .iter()
                        .enumerate()
                        .filter(|(_, v)| **v != 0.0)
                        .map(|(k, v)| (first + k, *v))
                        .collect();
                    row.push((times + seen.time, -1.0));
                    for &(i, a) in &row {
                        for &(j, b) in &row {
                            normal[(i, j)] += w * a * b;
                        }
                        right[i] += w * a * rhs;
                        row_sum.push((i, w * a));
                    }
                    squares += w * rhs * rhs;
                    mean += w * rhs;
                    sum += w;
                    freedom += robust;
                }
                freedom -= 1.0;
                row_sum.sort_by_key(|(i, _)| *i);
                row_sum.dedup_by(|next, kept| {
                    let same = next.0 == kept.0;
                    if same {
                        kept.1 += next.1;
                    }
                    same
                });
                for &(i, a) in &row_sum {
                    for &(j, b) in &row_sum {
                        normal[(i, j)] -= a * b / sum;
                    }
                    right[i] -= a * mean / sum;
                }
                squares -= mean * mean / sum;
            }
        }
        Self {
            normal,
            right,
            squares,
            freedom,
        }
    }

    /// The solution of the largest marginal likelihood over the weight of smoothness, the inverse of its
    /// normal matrix, and the root of the mean square residual.
    fn solve(&self, prior: &Prior<'_>, excess: f64) -> Option<(DVector<f64>, DMatrix<f64>, f64)> {
        let mut best: Option<(f64, f64)> = None;
        for k in -8..=24 {
            let weight = 10_f64.powf(f64::from(k) / 4.0 + 1.0);
            let Some((x, solver)) = self.at(prior, excess, weight, &[]) else {
                continue;
            };
            let misfit = (self.squares - x.dot(&self.right)).max(0.0);
            let logdet = 2.0 * solver.l().diagonal().iter().map(|d| d.ln()).sum::<f64>();
            let minus_two_log =
                self.freedom * (misfit / self.freedom).ln() + logdet - prior.rank * weight.ln();
            if minus_two_log.is_finite() && best.is_none_or(|(b, _)| minus_two_log < b) {
                best = Some((minus_two_log, weight));
            }
        }
        let (_, weight) = best?;
        // Where the curve would fall, its coefficients are held to rise by the least.
        let mut held: Vec<usize> = Vec::new();
        for _ in 0..COEFFICIENTS {
            let (x, solver) = self.at(prior, excess, weight, &held)?;
            let curves = (prior.rank as usize) / (COEFFICIENTS - 2);
            let falls: Vec<usize> = (0..curves * COEFFICIENTS)
                .filter(|k| k % COEFFICIENTS != 0)
                .filter(|&k| x[k] - x[k - 1] < 0.5 * LEAST_RISE && !held.contains(&k))
                .collect();
            if falls.is_empty() {
                let misfit = (self.squares - 2.0 * x.dot(&self.right)
                    + x.dot(&(&self.normal * &x)))
                .max(0.0)
                    / self.freedom.max(1.0);
                return Some((x, solver.inverse(), misfit.sqrt()));
            }
            held.extend(falls);
        }
        None
    }

    fn at(
        &self,
        prior: &Prior<'_>,
        excess: f64,
        weight: f64,
        held: &[usize],
    ) -> Option<(DVector<f64>, nalgebra::Cholesky<f64, nalgebra::Dyn>)> {
        let mut normal = &self.normal + &prior.fixed * excess + prior.smooth * weight;
        let mut right = self.right.clone();
        for &k in held {
            for (i, a) in [(k, 1.0), (k - 1, -1.0)] {
                for (j, b) in [(k, 1.0), (k - 1, -1.0)] {
                    normal[(i, j)] += HOLD * a * b;
                }
                right[i] += HOLD * a * LEAST_RISE;
            }
        }
        let solver = normal.cholesky()?;
        Some((solver.solve(&right), solver))
    }
}

/// Tukey's weights of the residuals, in units of what they scatter.
fn reweigh(
    patches: &[Vec<Patch>],
    seconds: &[f64],
    codes: Codes,
    knots: &[Knots],
    x: &DVector<f64>,
    scale: f64,
    weights: &mut [Vec<Vec<f64>>],
) {
    let times = patches.len() * COEFFICIENTS;
    for (c, ((patches, knots), weights)) in patches.iter().zip(knots).zip(weights).enumerate() {
        let own = x.as_slice().get(c * COEFFICIENTS..(c + 1) * COEFFICIENTS);
        for (patch, weights) in patches.iter().zip(weights) {
            let logs: Vec<(f64, f64)> = patch
                .seen
                .iter()
                .map(|seen| {
                    let (values, rhs, variance) = equation(seen, seconds, codes, *knots, own);
                    let g: f64 =
                        own.map_or(0.0, |own| values.iter().zip(own).map(|(v, a)| v * a).sum());
                    (g - x[times + seen.time] - rhs, variance)
                })
                .collect();
            // The median is not moved by the outlier that is looked for.
            let mut sorted: Vec<f64> = logs.iter().map(|(log, _)| *log).collect();
            sorted.sort_by(f64::total_cmp);
            let middle = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
            let pair = sorted.len() == 2;
            let (sum, total) = logs
                .iter()
                .fold((0.0, 0.0), |(s, w), (l, v)| (s + l / v, w + 1.0 / v));
            let centre = if pair { sum / total } else { middle };
            for ((log, variance), weight) in logs.iter().zip(weights.iter_mut()) {
                let z = (log - centre) / (scale.clamp(1.0, 3.0) * variance.sqrt() * OUTLIER);
                *weight = if z.abs() < 1.0 {
                    1.0
                } else {
                    (1.0 / z.abs()).powi(2)
                };
            }
        }
    }
}
