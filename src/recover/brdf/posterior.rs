//! Estimate and covariance of the coefficients, by dense algebra.

use faer::Mat;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::information::Information;
use super::prior::{Factor, Precision};
use crate::Result;

/// Most exchanges between the coefficients that are held and those that are free; it takes 5 to 20.
const ROUNDS: usize = 80;

/// Full exchanges that may fail to bring the number of wrong ones down.
const PATIENCE: usize = 5;

/// Weight of the logarithmic barrier at which the covariance is taken.
const BARRIER: f64 = 3.0;

/// Violation of a sign, in units of σ, that nobody needs to mend.
const NEGLIGIBLE: f64 = 1e-6;

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
    /// metric J + P. Its covariance is the curvature at the centre of a logarithmic barrier: an unknown far above 0 keeps
    /// its σ, one pressed against 0 by a force z gets the 1/z of the exponential that is left of its Gaussian.
    ///
    /// # Errors
    /// If the normal equations cannot be factored.
    pub fn posterior(self, non_negative: bool) -> Result<Posterior> {
        let Self {
            mut matrix,
            factor,
            mut mean,
        } = self;
        let covariance = factor.inverse();
        if non_negative && let Some(force) = hold_non_negative(&covariance, &mut mean)? {
            // Each of these is tens of megabytes.
            drop(factor);
            for (i, (&x, &z)) in mean.iter().zip(&force).enumerate() {
                matrix[(i, i)] += barrier_curvature(x, z, 1.0 / covariance[(i, i)]);
            }
            drop(covariance);
            let tighter = Factor::new(&matrix)?;
            drop(matrix);
            return Ok(Posterior {
                held: mean.iter().filter(|v| **v == 0.0).count(),
                mean,
                covariance: tighter.inverse(),
                precision: tighter,
            });
        }
        Ok(Posterior {
            mean,
            covariance,
            precision: factor,
            held: 0,
        })
    }
}

/// Brings the Gaussian estimate `x` with the given covariance C to the nearest x ≥ 0, and returns the force with which each
/// is pressed against 0; `None` if none is.
///
/// With a set of coefficients held at 0 the others follow by their covariance, x + C_{·a} λ with C_{aa} λ = −x_a. Held ones
/// with λ < 0 are released and free ones below 0 held, all at once, until there is none; if their number does not come down,
/// one at a time, which is certain to end (block principal pivoting: Portugal, Júdice and Vicente, "A comparison of block
/// pivoting and interior-point algorithms for linear least squares problems with nonnegative variables", Mathematics of
/// Computation 63, 1994).
fn hold_non_negative(covariance: &Mat<f64>, x: &mut [f64]) -> Result<Option<Vec<f64>>> {
    let sigma: Vec<f64> = (0..x.len()).map(|i| covariance[(i, i)].sqrt()).collect();
    let mut held: Vec<bool> = x.iter().map(|v| *v < 0.0).collect();
    if !held.contains(&true) {
        return Ok(None);
    }
    let (mut fewest, mut patience) = (usize::MAX, PATIENCE);
    let mut force = vec![0.0; x.len()];
    let mut moved = x.to_vec();
    for _ in 0..ROUNDS {
        let active: Vec<usize> = (0..x.len()).filter(|&i| held[i]).collect();
        let part = Mat::from_fn(active.len(), active.len(), |i, j| {
            covariance[(active[i], active[j])]
        });
        let right: Vec<f64> = active.iter().map(|&i| -x[i]).collect();
        let lambda = Factor::new(&part)?.solve_vector(&right);
        force.fill(0.0);
        moved.copy_from_slice(x);
        for (&k, l) in active.iter().zip(&lambda) {
            force[k] = *l;
            for (v, c) in moved.iter_mut().zip(covariance.col(k).iter()) {
                *v += c * l;
            }
        }
        let wrong: Vec<usize> = (0..x.len())
            .filter(|&i| {
                if held[i] {
                    force[i] * sigma[i] < -NEGLIGIBLE
                } else {
                    moved[i] < -NEGLIGIBLE * sigma[i]
                }
            })
            .collect();
        if wrong.is_empty() {
            break;
        }
        if wrong.len() < fewest {
            fewest = wrong.len();
            patience = PATIENCE;
        } else {
            patience = patience.saturating_sub(1);
        }
        let exchanged = if patience > 0 {
            &wrong[..]
        } else {
            &wrong[wrong.len() - 1..]
        };
        for &i in exchanged {
            held[i] = !held[i];
        }
    }
    for (i, (x, v)) in x.iter_mut().zip(&moved).enumerate() {
        *x = if held[i] { 0.0 } else { v.max(0.0) };
        force[i] = force[i].max(0.0);
    }
    Ok(Some(force))
}

/// What the curvature of a barrier −[`BARRIER`]·ln x adds to the precision of a coefficient whose constrained
/// estimate is `x`, pressed against 0 by `z`, and whose precision without the constraint is `c`.
fn barrier_curvature(x: f64, z: f64, c: f64) -> f64 {
    // Its centre: c (y − x) + z = BARRIER / y.
    let b = c * x - z;
    let root = (b * b + 4.0 * c * BARRIER).sqrt();
    // The form without cancellation of (b + root)/2c.
    let y = if b > 0.0 {
        (b + root) / (2.0 * c)
    } else {
        2.0 * BARRIER / (root - b)
    };
    BARRIER / (y * y)
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
