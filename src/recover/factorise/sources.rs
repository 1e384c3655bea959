//! Sources in a light that is known by its lower frequencies only.

use std::f64::consts::TAU;

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use num_complex::Complex64;

use crate::fourier::Series;

/// Most sources that are looked for.
const MOST: usize = 12;
/// χ² that a source must explain: five standard deviations.
const EXPLAINS: f64 = 25.0;
/// Directions that are tried, per frequency of the light.
const DENSITY: usize = 16;
/// Gauss–Newton steps after each new source.
const STEPS: usize = 8;
/// Share of the upper half of the frequencies' power that the sources must explain.
const SHARE: f64 = 0.9;

/// Sources by their share of the mean light: L_q = Σ share e^{−iqθ} for L_0 = 1.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sources {
    /// Direction, radians, and share.
    pub each: Vec<(f64, f64)>,
}

impl Sources {
    /// What they add to L_q.
    pub fn coefficient(&self, q: usize) -> Complex64 {
        self.each
            .iter()
            .map(|(theta, share)| share * Complex64::cis(-(q as f64) * theta))
            .sum()
    }

    /// Largest change of a source from here to `other` at frequency `q`, relative to the largest source; infinite if they
    /// are not as many.
    pub fn change(&self, other: &Self, q: usize) -> f64 {
        if self.each.len() != other.each.len() {
            return f64::INFINITY;
        }
        let largest = self
            .each
            .iter()
            .map(|s| s.1)
            .fold(f64::MIN_POSITIVE, f64::max);
        self.each
            .iter()
            .zip(&other.each)
            .map(|(a, b)| {
                let [x, y] = [a, b].map(|s| s.1 * Complex64::cis(q as f64 * s.0));
                (x - y).norm() / largest
            })
            .fold(0.0, f64::max)
    }

    /// The sources in `lighting` (with L_0 = 1), whose (Re L_p, Im L_p, …) over `frequencies` but the first have the
    /// `covariance`; `None` if sources do not explain its upper frequencies.
    ///
    /// One after the other where it explains most, all refined together after each. Beside them stands a smooth light with
    /// |L_p| of about 1/(1 + p)², as that of skies with kinks but without edges.
    pub fn find(lighting: &Series, frequencies: &[usize], covariance: &Mat<f64>) -> Option<Self> {
        let frequencies: Vec<usize> = frequencies.iter().copied().skip(1).collect();
        let size = 2 * frequencies.len();
        if size == 0 || covariance.nrows() != size {
            return None;
        }
        let mut total = covariance.clone();
        for (i, &p) in frequencies.iter().enumerate() {
            let smooth = (1.0 + p as f64).powi(-4);
            total[(2 * i, 2 * i)] += smooth;
            total[(2 * i + 1, 2 * i + 1)] += smooth;
        }
        let weights = total
            .llt(Side::Lower)
            .ok()?
            .solve(Mat::<f64>::identity(size, size));
        let target = parts(frequencies.iter().map(|&p| lighting.get(p as i64)));
        let mut found = Self { each: Vec::new() };
        let last = frequencies.last().copied().unwrap_or(1);
        let tried = DENSITY * last;
        let direction = |k: usize| TAU * k as f64 / tried as f64;
        let turned: Vec<Mat<f64>> = (0..tried)
            .map(|k| delta(direction(k), &frequencies))
            .collect();
        let design = Mat::from_fn(size, tried, |i, k| turned[k][(i, 0)]);
        let weighted = &weights * &design;
        let squares: Vec<f64> = (0..tried)
            .map(|k| design.col(k).transpose() * weighted.col(k))
            .collect();
        // Direction and share are two numbers, as a coefficient is: as many sources as upper frequencies would be any light, and the lower ones are
        // the smooth light's.
        let upper = frequencies.iter().filter(|&&p| 2 * p > last).count();
        for _ in 0..MOST.min(upper / 2) {
            let along = weighted.transpose() * (&target - found.parts(&frequencies));
            // The gain of a source at each direction: (aᵀWr)² / aᵀWa, where aᵀWr is above 0.
            let best = (0..tried)
                .filter(|&k| along[(k, 0)] > 0.0)
                .map(|k| (along[(k, 0)].powi(2) / squares[k], k))
                .max_by(|x, y| x.0.total_cmp(&y.0))
                .map(|(gain, k)| (gain, direction(k), along[(k, 0)] / squares[k]));
            let Some((gain, theta, share)) = best else {
                break;
            };
            if gain < EXPLAINS {
                break;
            }
            found.each.push((theta, share));
            found.refine(&frequencies, &target, &weights);
        }
        let (mut power, mut unexplained) = (0.0, 0.0);
        for (i, &p) in frequencies.iter().enumerate().filter(|f| 2 * *f.1 > last) {
            // What noise brings, which nothing explains.
            let noise = covariance[(2 * i, 2 * i)] + covariance[(2 * i + 1, 2 * i + 1)];
            power += lighting.get(p as i64).norm_sqr() - noise;
            unexplained += (lighting.get(p as i64) - found.coefficient(p)).norm_sqr() - noise;
        }
        (unexplained < (1.0 - SHARE) * power).then_some(found)
    }

    fn parts(&self, frequencies: &[usize]) -> Mat<f64> {
        parts(frequencies.iter().map(|&p| self.coefficient(p)))
    }

    /// Gauss–Newton on directions and shares.
    fn refine(&mut self, frequencies: &[usize], target: &Mat<f64>, weights: &Mat<f64>) {
        for _ in 0..STEPS {
            let left = target - self.parts(frequencies);
            let columns: Vec<Mat<f64>> = self
                .each
                .iter()
                .flat_map(|&(theta, share)| {
                    let turned = |p: usize| {
                        -Complex64::I * p as f64 * share * Complex64::cis(-(p as f64) * theta)
                    };
                    [
                        parts(frequencies.iter().map(|&p| turned(p))),
                        delta(theta, frequencies),
                    ]
                })
                .collect();
            let design = Mat::from_fn(left.nrows(), columns.len(), |i, j| columns[j][(i, 0)]);
            let weighted = design.transpose() * weights;
            let mut normal = &weighted * &design;
            for i in 0..normal.nrows() {
                normal[(i, i)] *= 1.0 + 1e-6;
            }
            let Ok(factor) = normal.llt(Side::Lower) else {
                return;
            };
            let step = factor.solve(weighted * left);
            let reach = TAU / (4.0 * frequencies.last().copied().unwrap_or(1) as f64);
            for (i, (theta, share)) in self.each.iter_mut().enumerate() {
                *theta += step[(2 * i, 0)].clamp(-reach, reach);
                *share = (*share + step[(2 * i + 1, 0)]).max(0.0);
            }
            self.each.retain(|(_, share)| *share > 1e-6);
        }
    }
}

fn delta(theta: f64, frequencies: &[usize]) -> Mat<f64> {
    parts(
        frequencies
            .iter()
            .map(|&p| Complex64::cis(-(p as f64) * theta)),
    )
}

/// (Re, Im, …) as a column.
fn parts(values: impl Iterator<Item = Complex64>) -> Mat<f64> {
    let flat: Vec<f64> = values.flat_map(|c| [c.re, c.im]).collect();
    Mat::from_fn(flat.len(), 1, |i, _| flat[i])
}
