//! How smooth the data say the BRDF is: the prior's three weights by marginal likelihood.

use faer::Mat;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::information::{Equations, Information};
use super::prior::{Banded, Factor, Penalties, Relief, Smoothness};
use crate::Result;

/// Draws by which traces are estimated. Each is a sum over about a thousand unknowns, so that 16 draws give
/// it to (2/16000)^½ = 1 %.
const PROBES: usize = 16;

/// Change of the logarithm of a weight that is left: it is a hundredth of the range that serves as well.
const SETTLED: f64 = 0.2;

/// Most steps towards the maximum of the evidence.
const ROUNDS: usize = 14;

/// Width over which the local size of ρ̃ is averaged, radians: enough places that its estimate is steady, and
/// narrow enough for a lobe.
const RELIEF: f64 = 0.1;

/// Factor between points of the regularisation curve: √10.
const STEP: f64 = 3.162_277_660_168_379_5;

/// Most steps by which cross-validation may weaken the prior.
const RELAXATIONS: usize = 8;

/// One point of the regularisation curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// The chosen weights of the prior times this.
    pub factor: f64,
    /// Log marginal likelihood, nats, up to a constant.
    pub evidence: f64,
    /// Generalised cross-validation score n χ²/(n − edf)².
    pub gcv: f64,
    /// Σ residual²/σ².
    pub chi_square: f64,
    /// Effective number of parameters the data determine.
    pub parameters: f64,
}

/// What was learnt from the data about prior and noise.
#[derive(Clone, Debug)]
pub struct Learnt {
    /// The prior that maximises the evidence, weakened by [`relaxed`].
    pub smoothness: Smoothness,
    /// Where ρ̃ is large and where small.
    pub relief: Relief,
    /// Largest coefficient of the fit.
    pub largest: f64,
    /// Evidence and GCV around the maximum.
    pub curve: Vec<CurvePoint>,
}

/// A fit at given weights on the coarse level.
struct Fit {
    x: Vec<f64>,
    a: Factor,
    chi_square: f64,
    gain: f64,
}

/// The problem on splines coarse enough for dense algebra at every trial.
struct Level {
    /// With all variances times the noise of the moment.
    equations: Equations,
    count: f64,
    penalties: Penalties,
    /// Number of cells of the relief.
    cells: usize,
    white: Mat<f64>,
}

impl Level {
    fn fit(&self, smoothness: &Smoothness) -> Result<Fit> {
        let mut matrix = self.equations.matrix.clone();
        self.penalties.add_dense(smoothness, &mut matrix);
        let a = Factor::new(&matrix)?;
        let rhs = &self.equations.right_side;
        let x = a.solve_vector(rhs);
        let gain: f64 = rhs.iter().zip(&x).map(|(h, x)| h * x).sum();
        let penalty: f64 = weighted(smoothness, &self.penalties.values(&x));
        let chi_square = (self.equations.square - gain - penalty).max(0.0);
        Ok(Fit {
            x,
            a,
            chi_square,
            gain,
        })
    }

    /// Draws of the coefficients as the prior alone expects them.
    fn prior_draws(&self, smoothness: &Smoothness) -> Result<Vec<Vec<f64>>> {
        if let Some(factor) = Banded::new(&self.penalties, smoothness) {
            return Ok(self.draws(|z| factor.draw(z)));
        }
        let n = self.equations.right_side.len();
        let mut matrix = Mat::zeros(n, n);
        self.penalties.add_dense(smoothness, &mut matrix);
        let factor = Factor::new(&matrix)?;
        Ok(self.draws(|z| factor.draw(z)))
    }

    /// Draws of the coefficients, of white noise that `coloured` gives their precision.
    fn draws(&self, coloured: impl Fn(&mut Mat<f64>)) -> Vec<Vec<f64>> {
        let mut z = self.white.clone();
        coloured(&mut z);
        (0..PROBES)
            .map(|j| (0..z.nrows()).map(|i| z[(i, j)]).collect())
            .collect()
    }

    /// tr(M⁻¹ P_k) of the three forms, from draws with precision M.
    fn traces(&self, draws: &[Vec<f64>]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for x in draws {
            for (s, v) in sum.iter_mut().zip(self.penalties.values(x)) {
                *s += v / PROBES as f64;
            }
        }
        sum
    }

    /// Mean of the penalties' energy over draws, \[i\]\[j\].
    fn energy(&self, smoothness: &Smoothness, draws: &[Vec<f64>]) -> Vec<f64> {
        let mut sum = vec![0.0; self.cells];
        for x in draws {
            for (s, v) in sum
                .iter_mut()
                .zip(self.penalties.energy(smoothness, x, self.cells))
            {
                *s += v / PROBES as f64;
            }
        }
        sum
    }
}

fn weighted(smoothness: &Smoothness, values: &[f64; 3]) -> f64 {
    smoothness
        .weights()
        .iter()
        .zip(values)
        .map(|(w, v)| w * v)
        .sum()
}

/// Keeps the correlation lengths between a fraction of the knots' spacing, below which the splines cannot
/// tell, and `longest`, beyond which the prior would carry values far from any sample.
fn limited(w: [f64; 3], spacing: f64, longest: f64) -> [f64; 3] {
    let shortest = (0.3 * spacing).min(longest);
    let limit = |v: f64| v.clamp(w[0] * shortest.powi(6), w[0] * longest.powi(6));
    [w[0], limit(w[1]), limit(w[2])]
}

/// Maximises the marginal likelihood of the samples over the three weights of the prior.
///
/// Fixed point of MacKay as generalised by Wood and Fasiolo ("A generalized Fellner–Schall method for
/// smoothing parameter optimization", Biometrics 73, 2017): each weight times
/// (tr P⁻¹P_k − tr A⁻¹P_k) / x̂ᵀP_k x̂, which raises the evidence at every step. With it the noise: where the
/// residual is larger than the variances allow, all of them are scaled up.
///
/// Then cross-validation may weaken the prior as a whole. The curve about what was chosen is computed if `curve` asks for it.
///
/// # Errors
/// If the normal equations cannot be factored.
pub fn learn(information: &Information, longest: f64, curve: bool) -> Result<Learnt> {
    let space = &information.space;
    let (basis, n) = (space.basis(), space.len());
    let mut rng = ChaCha8Rng::seed_from_u64(0x5eed_b4df);
    let mut relief = Relief::flat(basis);
    let mut level = Level {
        equations: information.equations(1.0)?,
        count: information.count as f64,
        penalties: Penalties::new(space, &relief),
        cells: basis.intervals() * basis.intervals(),
        white: Mat::from_fn(n, PROBES, |_, _| StandardNormal.sample(&mut rng)),
    };
    let mean_information = (0..n).map(|i| level.equations.matrix[(i, i)]).sum::<f64>() / n as f64;
    let mut noise = 1.0;
    // Start: a prior that says next to nothing, smooth over 0.1 rad; its fit gives the first amplitude.
    let shape = |amplitude: f64| {
        let l4 = 0.1f64.min(longest).powi(6);
        Smoothness {
            amplitude,
            across: amplitude * l4,
            along: amplitude * l4,
        }
    };
    let h2 = basis.spacing().powi(2);
    let start = level.fit(&shape(1e-4 * mean_information / h2))?;
    let size = level.penalties.values(&start.x)[0].max(f64::MIN_POSITIVE);
    // A prior may at most be a hundred million times as strong as the samples, or a black object would make it
    // infinite.
    let strongest = 1e8 * mean_information / h2;
    let mut smoothness = shape((0.1 * n as f64 / size).min(strongest));
    let mut largest = 0.0;
    for round in 0..ROUNDS {
        let now = smoothness;
        let (told, expected) = rayon::join(
            || -> Result<_> {
                let fit = level.fit(&now)?;
                let draws = level.draws(|z| fit.a.draw(z));
                let traces = level.traces(&draws);
                Ok((fit, draws, traces))
            },
            || -> Result<_> {
                let draws = level.prior_draws(&now)?;
                let traces = level.traces(&draws);
                Ok((draws, traces))
            },
        );
        let ((fit, draws, traces), (prior_draws, prior_traces)) = (told?, expected?);
        largest = fit.x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let values = level.penalties.values(&fit.x);
        let before = now.weights();
        let mut after = before;
        for k in 0..3 {
            // A floor keeps a step finite where the data say nothing about this form.
            let determined = (prior_traces[k] - traces[k]).max(1e-3 * prior_traces[k]);
            let ratio = determined / values[k].max(f64::MIN_POSITIVE);
            // Half as far again: the fixed point is approached from one side, slowly.
            after[k] = before[k] * ratio.powf(1.5).clamp(1.0 / 30.0, 30.0);
        }
        after[0] = after[0].min(strongest);
        let after = limited(after, basis.spacing(), longest);
        smoothness = Smoothness::from_weights(after);
        let parameters = n as f64 - weighted(&now, &traces);
        let free = level.count - parameters;
        let mut settled = true;
        if free > 0.05 * level.count {
            let reduced = fit.chi_square * noise / free;
            // Only beyond four standard deviations of χ² is it the noise that is wrong.
            let wanted = if reduced > 1.0 + 4.0 * (2.0 / free).sqrt() {
                reduced
            } else {
                1.0
            };
            settled = (wanted / noise).ln().abs() < 0.05;
            if wanted != noise {
                noise = wanted;
                level.equations = information.equations(noise)?;
            }
        }
        settled &= before
            .iter()
            .zip(&after)
            .all(|(b, a)| (a / b).ln().abs() < SETTLED);
        if (2..=6).contains(&round) && round % 2 == 0 {
            // The same step for the local size: what the posterior expects of the energy over what the prior does.
            let mut expected = level.energy(&now, &draws);
            for (e, v) in expected
                .iter_mut()
                .zip(level.penalties.energy(&now, &fit.x, level.cells))
            {
                *e += v;
            }
            relief.update(&expected, &level.energy(&now, &prior_draws), RELIEF);
            level.penalties = Penalties::new(space, &relief);
        } else if settled && round > 6 {
            break;
        }
    }
    let smoothness = smoothness.times(relaxed(&level, &smoothness)?);
    let curve = (-4..=4)
        .filter(|_| curve)
        .map(|k| point(&level, &smoothness, STEP.powi(k)))
        .collect::<Result<_>>()?;
    Ok(Learnt {
        smoothness,
        relief,
        largest,
        curve,
    })
}

/// The factor on all weights: a step below 1, and from there on down as long as generalised cross-validation falls.
///
/// The maximum of the evidence is best for the smooth estimate. The one from which the bias was taken must smooth less if
/// intervals are to cover what they claim at each place (undersmoothing: Hall, "Effect of bias estimation on coverage
/// accuracy of bootstrap confidence intervals for a probability density", Annals of Statistics 20, 1992); one step costs a
/// tenth of the error and brings lobes of exponent 128 from 93 to 94 %. And where a lobe is nothing like the prior
/// expects, the evidence smooths too much; cross-validation asks nothing of the prior.
fn relaxed(level: &Level, chosen: &Smoothness) -> Result<f64> {
    let score = |factor: f64| -> Result<f64> { Ok(point(level, chosen, factor)?.gcv) };
    let mut factor = 1.0 / STEP;
    // At least two are wanted.
    let (first, second) = rayon::join(|| score(factor), || score(factor / STEP));
    let (mut least, mut next) = (first?, second?);
    for _ in 1..RELAXATIONS {
        if next >= least {
            return Ok(factor);
        }
        (factor, least) = (factor / STEP, next);
        next = score(factor / STEP)?;
    }
    Ok(if next < least { factor / STEP } else { factor })
}

fn point(level: &Level, chosen: &Smoothness, factor: f64) -> Result<CurvePoint> {
    let smoothness = chosen.times(factor);
    let fit = level.fit(&smoothness)?;
    let n = level.equations.right_side.len() as f64;
    let parameters = n - weighted(&smoothness, &level.traces(&level.draws(|z| fit.a.draw(z))));
    // ln |P| scales by n ln factor; its value at the maximum is a constant of the curve.
    let evidence =
        0.5 * (n * factor.ln() - fit.a.log_determinant() - (level.equations.square - fit.gain));
    let free = (level.count - parameters).max(1.0);
    Ok(CurvePoint {
        factor,
        evidence,
        gcv: level.count * fit.chi_square / (free * free),
        chi_square: fit.chi_square,
        parameters,
    })
}
