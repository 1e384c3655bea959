//! The joint refinement of lighting and BRDF: damped Gauss–Newton on the efficient score.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use super::pairs::{Pairs, Whitened};
use super::posterior::Posterior;
use crate::error::{Error, Result};
use crate::fourier::Series;

/// Steps after which the iteration stops in any case.
const MOST_STEPS: usize = 20;
/// A step this small, in units of the joint σ of all parameters, is the last.
const SETTLED: f64 = 0.05;
/// The rise of the misfit that a step may bring: the misfit changes by 1 over one σ of one parameter.
const SLACK: f64 = 0.5;

/// Where the refinement ended.
#[derive(Debug)]
pub(super) struct Refined {
    /// L, with L_0 as in the start.
    pub lighting: Series,
    /// The errors that all samples share, in standard deviations.
    pub systematics: Vec<f64>,
    /// The problem at that lighting.
    pub pairs: Pairs,
    /// The reciprocal transfer function in the problem's basis, given that lighting.
    pub posterior: Posterior,
    /// Derivative of the constraints by (Re L_1, Im L_1, …) and by the errors that all samples share.
    pub jacobian: Mat<f64>,
    /// Steps taken.
    pub steps: usize,
    /// Whether the last step was far below σ.
    pub converged: bool,
}

/// Information of the prior that |L_p| ≤ L_0, which holds for every light that is nowhere negative: a variance
/// of L_0²/2 per real part.
pub(super) fn prior_information(lighting: &Series) -> f64 {
    2.0 / lighting.get(0).norm_sqr().max(f64::MIN_POSITIVE)
}

/// The prior's information on each parameter of `refined`: that on L, and a standard deviation of 1 for the errors that all samples
/// share.
pub(super) fn prior(refined: &Refined) -> Vec<f64> {
    let shared = refined.systematics.len();
    let light = refined.jacobian.ncols() - shared;
    let mut prior = vec![prior_information(&refined.lighting); light];
    prior.resize(light + shared, 1.0);
    prior
}

/// The problem at `lighting`, without a step.
pub(super) fn held(whitened: &Whitened, lighting: &Series) -> Result<Refined> {
    let systematics = vec![0.0; whitened.changes.len()];
    let pairs = Pairs::new(whitened, lighting, &systematics)?;
    Ok(evaluated(whitened, lighting.clone(), systematics, pairs))
}

fn evaluated(
    whitened: &Whitened,
    lighting: Series,
    systematics: Vec<f64>,
    pairs: Pairs,
) -> Refined {
    let posterior = Posterior::new(&pairs);
    let jacobian = pairs.jacobian(whitened, &posterior.mean);
    Refined {
        lighting,
        systematics,
        pairs,
        posterior,
        jacobian,
        steps: 0,
        converged: true,
    }
}

/// Iterates x ← x + (JᵀJ + prior + damping)⁻¹ (Jᵀ r − prior · x) from `start` until steps are far below σ; x is L and the errors that
/// all samples share.
///
/// A step that raises Σ y⊥² + prior · x² by more than `SLACK` is repeated with more damping. (The efficient score is not
/// quite that function's gradient, so a rise far below its scatter is let pass.)
pub(super) fn refine(whitened: &Whitened, start: &Series) -> Result<Refined> {
    let information_of_light = prior_information(start);
    let cost = |pairs: &Pairs, lighting: &Series, systematics: &[f64]| {
        let light = lighting.coefficients.iter().skip(1);
        let light: f64 = light.map(|c| c.norm_sqr()).sum();
        let shared: f64 = systematics.iter().map(|f| f * f).sum();
        pairs.misfit().0 + information_of_light * light + shared
    };
    let mut at = held(whitened, start)?;
    let prior = prior(&at);
    let mut reached = cost(&at.pairs, &at.lighting, &at.systematics);
    let mut damping = 0.0;
    while at.steps < MOST_STEPS {
        let residuals = at.pairs.across();
        let across = Mat::from_fn(residuals.len(), 1, |i, _| residuals[i]);
        let mut information = at.jacobian.transpose() * &at.jacobian;
        let mut score = at.jacobian.transpose() * &across;
        for (i, &prior) in prior.iter().enumerate() {
            information[(i, i)] += prior;
            score[(i, 0)] -= prior * at.parameter(&whitened.frequencies, i);
        }
        let mut next = None;
        for _ in 0..6 {
            let mut damped = information.clone();
            for i in 0..prior.len() {
                damped[(i, i)] *= 1.0 + damping;
            }
            let step = damped
                .llt(Side::Lower)
                .map_err(|_| {
                    Error::failed(
                        "the information matrix of the refinement is not positive definite",
                    )
                })?
                .solve(&score);
            // The step in units of σ.
            let size = (step.transpose() * &score)[(0, 0)].max(0.0).sqrt();
            let lighting = moved(&at.lighting, &whitened.frequencies, &step);
            let light = prior.len() - at.systematics.len();
            let systematics: Vec<f64> = at
                .systematics
                .iter()
                .enumerate()
                .map(|(s, f)| f + step[(light + s, 0)])
                .collect();
            let pairs = Pairs::new(whitened, &lighting, &systematics)?;
            let found = cost(&pairs, &lighting, &systematics);
            if found <= reached + SLACK {
                next = Some((lighting, systematics, pairs, found, size));
                break;
            }
            damping = f64::max(10.0 * damping, 0.01);
        }
        let Some((lighting, systematics, pairs, found, size)) = next else {
            // No step downhill is left: the weakly determined frequencies are where they can be.
            at.converged = damping < 1.0;
            break;
        };
        reached = found;
        at = Refined {
            steps: at.steps + 1,
            converged: size < SETTLED && damping < 0.1,
            ..evaluated(whitened, lighting, systematics, pairs)
        };
        if at.converged {
            break;
        }
        damping = if damping < 0.02 { 0.0 } else { 0.1 * damping };
    }
    Ok(at)
}

impl Refined {
    /// Parameter `i` of (Re L_p, Im L_p, …) over the frequencies but the first, then the errors that all samples share.
    fn parameter(&self, frequencies: &[usize], i: usize) -> f64 {
        let light = 2 * frequencies.len().saturating_sub(1);
        if i >= light {
            return self.systematics.get(i - light).copied().unwrap_or(0.0);
        }
        let c = frequencies
            .get(i / 2 + 1)
            .map_or(num_complex::Complex64::ZERO, |&p| {
                self.lighting.get(p as i64)
            });
        if i.is_multiple_of(2) { c.re } else { c.im }
    }
}

fn moved(lighting: &Series, frequencies: &[usize], step: &Mat<f64>) -> Series {
    let mut next = lighting.clone();
    for (i, &p) in frequencies.iter().enumerate().skip(1) {
        if let Some(c) = next.coefficients.get_mut(p) {
            c.re += step[(2 * i - 2, 0)];
            c.im += step[(2 * i - 1, 0)];
        }
    }
    next
}
