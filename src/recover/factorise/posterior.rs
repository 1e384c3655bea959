//! The reciprocal transfer function given a lighting: each unknown from its data, shrunk by what its
//! neighbours show.

use faer::Mat;

use super::pairs::Pairs;

/// Half the side of the square of neighbours from which the prior variance of an entry is taken.
const REACH: usize = 2;
/// From one index to the next, the prior variance of entries that do not rise above the noise falls by this.
const DECAY: f64 = 0.7;

/// Mean and variance of Z, entry by entry: a Gaussian posterior under an empirical prior of mean 0.
///
/// The prior variance τ² of z_ab is that of its neighbourhood of 5 × 5 entries, (mean of y∥² − 1) / |s|²; where the
/// neighbourhood is at the noise it goes on from the last entry seen and decays. Any function of y∥ may be used here
/// without bias in the lighting, since the noise along the model is independent of that across it.
#[derive(Clone, Debug)]
pub(super) struct Posterior {
    /// E z_ab, N × N, symmetric.
    pub mean: Mat<f64>,
    /// Variance of z_ab, N × N, symmetric.
    pub variance: Mat<f64>,
}

impl Posterior {
    /// From the data along the model.
    pub fn new(pairs: &Pairs) -> Self {
        let n = pairs.nodes();
        let along = pairs.along();
        let local = smoothed(&Mat::from_fn(n, n, |a, b| along[(a, b)].powi(2)));
        // A mean of 25 squares of unit noise scatters by √(2/25) ≈ 0.28 about 1.
        let above = 1.0 + 2.0 * (2.0 / ((2 * REACH + 1) as f64).powi(2)).sqrt();
        let mut prior = Mat::<f64>::zeros(n, n);
        let mut mean = Mat::zeros(n, n);
        let mut variance = Mat::zeros(n, n);
        for a in 0..n {
            for b in 0..=a {
                let strength = pairs.strength(a, b);
                let before = match (a > b, b.checked_sub(1)) {
                    (true, _) => prior[(a - 1, b)],
                    (false, Some(c)) => prior[(a - 1, c)],
                    (false, None) => 0.0,
                };
                let seen = local[(a, b)] > above && strength > 0.0;
                let tau = if seen {
                    (local[(a, b)] - 1.0) / (strength * strength)
                } else {
                    DECAY * before
                };
                prior[(a, b)] = tau;
                let information = 1.0 + tau * strength * strength;
                mean[(a, b)] = tau * strength * along[(a, b)] / information;
                variance[(a, b)] = tau / information;
                mean[(b, a)] = mean[(a, b)];
                variance[(b, a)] = variance[(a, b)];
            }
        }
        Self { mean, variance }
    }
}

/// Mean over the neighbours, fewer at the edges.
fn smoothed(power: &Mat<f64>) -> Mat<f64> {
    let rows = Mat::from_fn(power.nrows(), power.ncols(), |a, b| {
        let range = a.saturating_sub(REACH)..(a + REACH + 1).min(power.nrows());
        let count = range.len() as f64;
        range.map(|i| power[(i, b)]).sum::<f64>() / count
    });
    Mat::from_fn(power.nrows(), power.ncols(), |a, b| {
        let range = b.saturating_sub(REACH)..(b + REACH + 1).min(power.ncols());
        let count = range.len() as f64;
        range.map(|i| rows[(a, i)]).sum::<f64>() / count
    })
}
