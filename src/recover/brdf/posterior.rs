//! Estimate and covariance of the coefficients, by dense algebra.

use faer::Mat;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::information::Information;
use super::prior::{Factor, Precision};
use crate::Result;

/// Full exchanges that may fail to bring the number of wrong ones down.
const PATIENCE: usize = 5;

/// Weight of the logarithmic barrier at which the covariance is taken. An unknown whose estimate is 0 gets twice its precision whatever this is; one that is a
/// deviation above 0 gets a tenth more. With ten times that, averages over many unknowns that are well above 0 together were told 10 % too small a σ.
const BARRIER: f64 = 0.1;

/// Most steps to the barrier's centre, and the change of its logarithms that is left: σ is wanted to some per cent.
const CENTRINGS: usize = 30;
const CENTRED: f64 = 0.05;

/// Violation of a sign, in units of σ, that nobody needs to mend.
const NEGLIGIBLE: f64 = 1e-6;

/// Most rounds over all forces where exchanges and the descent went in circles, and most multiplications of all of them: half a second.
const SWEEPS: usize = 1000;
const MOST_WORK: usize = 1_000_000_000;

/// Draws by which the trace of the prior's share is estimated before there is a covariance. Each is a sum over about a thousand
/// unknowns, so that 16 draws give it to (2/16000)^½ = 1 %.
const PROBES: usize = 16;

/// The unknowns, and how well they are known.
pub struct Posterior {
    /// The estimate, non-negative if that was demanded.
    pub mean: Vec<f64>,
    /// J + P, where the information J includes what non-negativity says.
    pub precision: Factor,
    /// Its inverse.
    pub covariance: Mat<f64>,
    /// Number of unknowns that non-negativity holds at 0.
    pub held: usize,
    /// By how much non-negativity raised χ², in units of what noise may do.
    pub excess: f64,
}

/// The estimate before non-negativity is asked for.
pub struct Free {
    /// J + P.
    matrix: Mat<f64>,
    factor: Factor,
    /// The estimate.
    pub mean: Vec<f64>,
}

impl Free {
    /// Solves the weighted least-squares problem with the prior P, and takes the prior's bias out.
    ///
    /// x̂ = (J + P)⁻¹h is short of the truth by (J + P)⁻¹P x; that is estimated from x̂ itself and added (Tukey's "twicing",
    /// Exploratory Data Analysis, 1977, ch. 16): what is left of the bias is of second order, and σ is that of noise alone
    /// ([`super::spread`]), so that intervals cover what they claim at each place and not only on average.
    ///
    /// # Errors
    /// If the normal equations cannot be factored.
    pub fn new(information: &Information, prior: &Precision, noise: f64) -> Result<Self> {
        let equations = information.equations(noise)?;
        let mut matrix = equations.matrix;
        prior.add_to(&mut matrix);
        let factor = Factor::new(&matrix)?;
        let mut mean = factor.solve_vector(&equations.right_side);
        let bias = factor.solve_vector(&prior.times(&mean));
        for (x, b) in mean.iter_mut().zip(bias) {
            *x += b;
        }
        Ok(Self {
            matrix,
            factor,
            mean,
        })
    }

    /// Effective number of parameters, n − tr((P C)²), from draws of signs (Hutchinson, "A stochastic estimator of the trace of
    /// the influence matrix for Laplacian smoothing splines", Communications in Statistics 18, 1989).
    pub fn parameters(&self, prior: &Precision) -> f64 {
        let n = self.mean.len();
        let mut rng = ChaCha8Rng::seed_from_u64(0x0005_16e5);
        let signs = Mat::from_fn(
            n,
            PROBES,
            |_, _| {
                if rng.random::<bool>() { 1.0 } else { -1.0 }
            },
        );
        let mut right = signs.clone();
        self.factor.solve(&mut right);
        let mut left = prior.times_columns(&signs);
        self.factor.solve(&mut left);
        let right = prior.times_columns(&right);
        let trace: f64 = (0..PROBES)
            .map(|j| {
                let products = left.col(j).iter().zip(right.col(j).iter());
                products.map(|(a, b)| a * b).sum::<f64>()
            })
            .sum();
        n as f64 - trace / PROBES as f64
    }

    /// The estimate with its covariance.
    ///
    /// Non-negativity is of the unknowns, which makes the slice non-negative: the nearest such estimate in the
    /// metric J + P, `prior` being P. If the truth is non-negative, that moves what the samples say by their noise, and χ² rises by about
    /// 1 for each unknown that is held and independent of the others. If it rises by much more, P contradicts the samples: it would rather have
    /// them wrong than the detail that a non-negative lobe needs.
    ///
    /// The covariance is the curvature at the centre of a logarithmic barrier: an unknown far above 0 keeps
    /// its σ, one pressed against 0 gets what is left of its Gaussian there.
    ///
    /// # Errors
    /// If the normal equations cannot be factored.
    pub fn posterior(self, prior: &Precision, non_negative: bool) -> Result<Posterior> {
        let Self {
            mut matrix,
            factor,
            mut mean,
        } = self;
        let covariance = factor.inverse();
        let free = mean.clone();
        if !non_negative || hold_non_negative(&covariance, &mut mean)?.is_none() {
            return Ok(Posterior {
                mean,
                covariance,
                precision: factor,
                held: 0,
                excess: 0.0,
            });
        }
        // Each of these is tens of megabytes.
        drop(factor);
        let moved: Vec<f64> = mean.iter().zip(&free).map(|(x, f)| x - f).collect();
        let pulled = prior.times(&moved);
        let rise =
            squared(&matrix, &moved) - moved.iter().zip(pulled).map(|(a, b)| a * b).sum::<f64>();
        let held: Vec<usize> = (0..mean.len()).filter(|&i| mean[i] == 0.0).collect();
        let excess = rise / noise_of(independent(&covariance, &held));
        for (i, y) in barrier_centre(&covariance, &free).into_iter().enumerate() {
            matrix[(i, i)] += BARRIER / (y * y);
        }
        drop(covariance);
        let tighter = Factor::new(&matrix)?;
        drop(matrix);
        Ok(Posterior {
            held: held.len(),
            excess,
            mean,
            covariance: tighter.inverse(),
            precision: tighter,
        })
    }
}

/// How many of the unknowns in `list` are as good as independent: (Σ 1)² / Σ correlation².
fn independent(covariance: &Mat<f64>, list: &[usize]) -> f64 {
    let mut sum = 0.0;
    for &i in list {
        for &j in list {
            sum += covariance[(i, j)].powi(2) / (covariance[(i, i)] * covariance[(j, j)]);
        }
    }
    let count = list.len() as f64;
    count * count / sum.max(1.0)
}

/// Rise of χ² that noise may lead to where so many independent unknowns are held: twice 1 for each, since their number is a rough one, and four
/// standard deviations.
fn noise_of(independent: f64) -> f64 {
    2.0 * independent + 4.0 * (2.0 * independent).sqrt()
}

/// xᵀ M x.
fn squared(matrix: &Mat<f64>, x: &[f64]) -> f64 {
    let column = faer::ColRef::from_slice(x);
    let product = matrix * column;
    product.iter().zip(x).map(|(a, b)| a * b).sum()
}

/// Brings the Gaussian estimate `x` with the given covariance C to the nearest x ≥ 0, and returns the force with which each
/// is pressed against 0; `None` if none is.
///
/// With a set of coefficients held at 0 the others follow by their covariance, x + C_{·a} λ with C_{aa} λ = −x_a. Held ones
/// with λ < 0 are released and free ones below 0 held, all at once, until there is none (block principal pivoting: Portugal,
/// Júdice and Vicente, "A comparison of block pivoting and interior-point algorithms for linear least squares problems with
/// nonnegative variables", Mathematics of Computation 63, 1994). If their number does not come down, as with coefficients that
/// the samples hardly tell apart, the forces are led down the dual problem ½ λᵀCλ + xᵀλ, λ ≥ 0, which is certain to end (Lawson and Hanson,
/// Solving Least Squares Problems, 1974, ch. 23).
fn hold_non_negative(covariance: &Mat<f64>, x: &mut [f64]) -> Result<Option<Vec<f64>>> {
    if x.iter().all(|v| *v >= 0.0) {
        return Ok(None);
    }
    let mut held = Held::new(covariance, x);
    if !held.exchange()? {
        held.descend()?;
    }
    let Held { held, force, .. } = held;
    let moved = moved(covariance, x, &force);
    for ((x, v), held) in x.iter_mut().zip(moved).zip(held) {
        *x = if held { 0.0 } else { v.max(0.0) };
    }
    Ok(Some(force.into_iter().map(|f| f.max(0.0)).collect()))
}

/// x + C λ.
fn moved(covariance: &Mat<f64>, x: &[f64], force: &[f64]) -> Vec<f64> {
    let mut moved = x.to_vec();
    for (k, &f) in force.iter().enumerate().filter(|(_, f)| **f != 0.0) {
        for (v, c) in moved.iter_mut().zip(covariance.col(k).iter()) {
            *v += c * f;
        }
    }
    moved
}

/// Which coefficients are held at 0.
struct Held<'a> {
    covariance: &'a Mat<f64>,
    /// The estimate without constraint, and its σ.
    free: &'a [f64],
    sigma: Vec<f64>,
    held: Vec<bool>,
    /// λ; 0 of those that are free.
    force: Vec<f64>,
}

impl<'a> Held<'a> {
    /// Those that are below 0.
    fn new(covariance: &'a Mat<f64>, free: &'a [f64]) -> Self {
        Self {
            covariance,
            free,
            sigma: (0..free.len()).map(|i| covariance[(i, i)].sqrt()).collect(),
            held: free.iter().map(|v| *v < 0.0).collect(),
            force: vec![0.0; free.len()],
        }
    }

    fn active(&self) -> Vec<usize> {
        (0..self.held.len()).filter(|&i| self.held[i]).collect()
    }

    /// λ of the `active` ones that brings them to 0.
    fn bring_to_zero(&self, active: &[usize]) -> Result<Vec<f64>> {
        if active.is_empty() {
            return Ok(Vec::new());
        }
        let part = Mat::from_fn(active.len(), active.len(), |i, j| {
            self.covariance[(active[i], active[j])]
        });
        let right: Vec<f64> = active.iter().map(|&i| -self.free[i]).collect();
        Ok(Factor::new(&part)?.solve_vector(&right))
    }

    /// How far each free one is below 0, in σ.
    fn violations(&self) -> Vec<f64> {
        let moved = moved(self.covariance, self.free, &self.force);
        (0..moved.len())
            .map(|i| match self.held[i] {
                true => 0.0,
                false => -moved[i] / self.sigma[i],
            })
            .collect()
    }

    /// Exchanges all that are wrong until none is; `false` if their number does not come down.
    fn exchange(&mut self) -> Result<bool> {
        let (mut fewest, mut patience) = (usize::MAX, PATIENCE);
        while patience > 0 {
            let active = self.active();
            let force = self.bring_to_zero(&active)?;
            self.force.fill(0.0);
            for (&k, l) in active.iter().zip(force) {
                self.force[k] = l;
            }
            let below = self.violations();
            let wrong: Vec<usize> = (0..below.len())
                .filter(|&i| {
                    if self.held[i] {
                        self.force[i] * self.sigma[i] < -NEGLIGIBLE
                    } else {
                        below[i] > NEGLIGIBLE
                    }
                })
                .collect();
            if wrong.is_empty() {
                return Ok(true);
            }
            if wrong.len() < fewest {
                fewest = wrong.len();
                patience = PATIENCE;
            } else {
                patience -= 1;
            }
            for i in wrong {
                self.held[i] = !self.held[i];
            }
        }
        Ok(false)
    }

    /// Holds those below 0 one after the other, the worst first, and releases those whose force comes to 0 on the way.
    fn descend(&mut self) -> Result<()> {
        for (force, held) in self.force.iter_mut().zip(&mut self.held) {
            *held = *force > 0.0;
            *force = force.max(0.0);
        }
        // Whose violation is less than rounding: held, they would be pulled at once.
        let mut rounded = vec![false; self.held.len()];
        // Each round holds one; few are released again.
        let mut last = None;
        for _ in 0..2 * self.held.len() {
            loop {
                let active = self.active();
                let wanted = self.bring_to_zero(&active)?;
                // As far towards it as no force becomes a pull.
                let share = active
                    .iter()
                    .zip(&wanted)
                    .filter(|(_, w)| **w <= 0.0)
                    .map(|(&k, w)| self.force[k] / (self.force[k] - w))
                    .fold(1.0, f64::min);
                let mut released = false;
                for (&k, w) in active.iter().zip(&wanted) {
                    let to = self.force[k] + share * (w - self.force[k]);
                    let gone = share < 1.0 && *w <= 0.0 && to * self.sigma[k] < NEGLIGIBLE;
                    self.force[k] = if gone { 0.0 } else { to.max(0.0) };
                    self.held[k] = !gone;
                    released |= gone;
                }
                if !released {
                    break;
                }
            }
            if let Some(i) = last.filter(|&i: &usize| !self.held[i]) {
                rounded[i] = true;
            }
            let below = self.violations();
            last = (0..below.len())
                .filter(|&i| !rounded[i] && below[i] > NEGLIGIBLE)
                .max_by(|&i, &j| below[i].total_cmp(&below[j]));
            match last {
                Some(i) => self.held[i] = true,
                None => return Ok(()),
            }
        }
        self.sweep();
        Ok(())
    }

    /// Goes down the dual problem along one force after the other, which no rounding leads in circles: the forces come as near as they are
    /// wanted, if slowly.
    fn sweep(&mut self) {
        let mut moved = moved(self.covariance, self.free, &self.force);
        let work = self.force.len() * self.force.len();
        for _ in 0..SWEEPS.min(MOST_WORK / work.max(1)) {
            let mut farthest = 0.0f64;
            for i in 0..self.force.len() {
                let before = self.force[i];
                let after = (before - moved[i] / self.covariance[(i, i)]).max(0.0);
                if after == before {
                    continue;
                }
                for (v, c) in moved.iter_mut().zip(self.covariance.col(i).iter()) {
                    *v += c * (after - before);
                }
                self.force[i] = after;
                farthest = farthest.max((after - before).abs() * self.sigma[i]);
            }
            if farthest < NEGLIGIBLE {
                break;
            }
        }
        for (held, force) in self.held.iter_mut().zip(&self.force) {
            *held = *force > 0.0;
        }
    }
}

/// The minimum of ½ (y − x)ᵀ C⁻¹ (y − x) − [`BARRIER`] Σ ln y.
///
/// There y = x + C · BARRIER/y. Each y is brought to that with the others' share as it is, m times its own: y (y − x) = BARRIER · m C_{ii}; unknowns
/// that the samples hardly tell apart are then pushed together, as one, and not as if each stood at the barrier alone.
fn barrier_centre(covariance: &Mat<f64>, x: &[f64]) -> Vec<f64> {
    let root = |x: f64, variance: f64| {
        let root = (x * x + 4.0 * BARRIER * variance).sqrt();
        // The form without cancellation of (x + root)/2.
        if x > 0.0 {
            0.5 * (x + root)
        } else {
            2.0 * BARRIER * variance / (root - x)
        }
    };
    let own = |i: usize| covariance[(i, i)].max(f64::MIN_POSITIVE);
    let mut centre: Vec<f64> = x
        .iter()
        .enumerate()
        .map(|(i, &x)| root(x, own(i)))
        .collect();
    for _ in 0..CENTRINGS {
        let push: Vec<f64> = centre.iter().map(|y| 1.0 / y).collect();
        let pushed = covariance * faer::ColRef::from_slice(&push);
        let mut farthest = 0.0f64;
        for (i, y) in centre.iter_mut().enumerate() {
            // The others may also push the other way, but not past the barrier.
            let together = (pushed[i] * *y).max(0.1 * own(i));
            let next = root(x[i], together);
            farthest = farthest.max((next / *y).ln().abs());
            // Half the way, in which neighbours do not go past each other.
            *y = (*y * next).sqrt();
        }
        if farthest < CENTRED {
            break;
        }
    }
    centre
}

/// f(x) of a sparse functional.
pub fn apply(functional: &[(usize, f64)], x: &[f64]) -> f64 {
    functional.iter().map(|&(i, w)| w * x[i]).sum()
}

/// Variance of a sparse functional under a covariance matrix.
pub fn variance(functional: &[(usize, f64)], covariance: &Mat<f64>) -> f64 {
    let mut sum = 0.0;
    for (k, &(j, v)) in functional.iter().enumerate() {
        let column = covariance.col(j);
        let above: f64 = functional[..k].iter().map(|&(i, u)| u * column[i]).sum();
        sum += v * (2.0 * above + v * column[j]);
    }
    sum.max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients that the samples hardly tell apart: smooth fields over `len` places with correlation length `width` places.
    fn smooth_field(len: usize, width: f64) -> Mat<f64> {
        Mat::from_fn(len, len, |i, j| {
            let apart = (i as f64 - j as f64) / width;
            (-0.5 * apart * apart).exp() + if i == j { 1e-5 } else { 0.0 }
        })
    }

    fn ripples(len: usize, seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let steps: Vec<f64> = (0..len).map(|_| rng.random::<f64>() - 0.5).collect();
        steps
            .windows(3)
            .map(|w| w.iter().sum::<f64>())
            .chain([0.1, -0.1])
            .collect()
    }

    /// The conditions of Karush, Kuhn and Tucker, which only the nearest non-negative estimate fulfils.
    fn assert_nearest(covariance: &Mat<f64>, free: &[f64]) {
        let mut x = free.to_vec();
        let force = hold_non_negative(covariance, &mut x)
            .unwrap()
            .expect("some are below 0");
        let moved = moved(covariance, free, &force);
        let largest = force.iter().fold(0.0f64, |m, f| m.max(f.abs()));
        for (i, (x, f)) in x.iter().zip(&force).enumerate() {
            assert!(*x >= 0.0 && *f >= 0.0, "{i}: {x} {f}");
            assert!(*x == 0.0 || *f == 0.0, "{i}: {x} {f}");
            // Rounding of sums of forces of this size.
            assert!(
                (x - moved[i]).abs() < 2e-6 + 1e-12 * largest,
                "{i}: {x} {}",
                moved[i]
            );
        }
    }

    #[test]
    fn the_nearest_non_negative_estimate_is_found_where_exchanging_all_at_once_goes_in_circles() {
        let covariance = smooth_field(150, 4.0);
        let mut circles = 0;
        for seed in 0..20 {
            let free = ripples(150, seed);
            let mut held = Held::new(&covariance, &free);
            circles += usize::from(!held.exchange().unwrap());
            assert_nearest(&covariance, &free);
        }
        assert!(circles > 0);
    }

    #[test]
    fn sweeps_alone_find_the_nearest_estimate_too() {
        let covariance = smooth_field(40, 1.5);
        for seed in 0..5 {
            let free = ripples(40, seed);
            let mut swept = Held::new(&covariance, &free);
            swept.sweep();
            let mut nearest = free.clone();
            hold_non_negative(&covariance, &mut nearest).unwrap();
            for (v, x) in moved(&covariance, &free, &swept.force).iter().zip(nearest) {
                // A thousand steps of NEGLIGIBLE.
                assert!((v - x).abs() < 1e-3, "{v} {x}");
            }
        }
    }

    #[test]
    fn unknowns_that_are_as_good_as_one_stand_at_the_barrier_as_one() {
        // One unknown of deviation 2 at 0: y² is its variance times the barrier's weight, and its precision doubles.
        let y = barrier_centre(&Mat::from_fn(1, 1, |_, _| 4.0), &[0.0]);
        assert!((y[0] - (4.0 * BARRIER).sqrt()).abs() < 1e-12);
        // Four that hardly differ: so it does for their mean.
        let almost = Mat::from_fn(4, 4, |i, j| if i == j { 4.0004 } else { 4.0 });
        let y = barrier_centre(&almost, &[0.0; 4]);
        let told: f64 = y.iter().map(|y| BARRIER / (y * y)).sum();
        // To what is left when the centring ends.
        assert!((told * 4.0 - 1.0).abs() < 0.1, "{y:?}");
        // And of a field of many it is the minimum.
        let covariance = smooth_field(150, 4.0);
        let free = ripples(150, 3);
        let y = barrier_centre(&covariance, &free);
        for i in 0..150 {
            let pushed: f64 = (0..150).map(|j| covariance[(i, j)] * BARRIER / y[j]).sum();
            let off = (y[i] - free[i] - pushed).abs();
            assert!(
                y[i] > 0.0 && off < 0.2 * (y[i] + covariance[(i, i)].sqrt()),
                "{i}: {off}"
            );
        }
    }

    #[test]
    fn an_estimate_that_is_non_negative_stays_as_it_is() {
        let mut x = vec![0.0, 1.0, 2.0];
        let covariance = smooth_field(3, 1.0);
        assert!(hold_non_negative(&covariance, &mut x).unwrap().is_none());
        assert_eq!(x, [0.0, 1.0, 2.0]);
    }
}
