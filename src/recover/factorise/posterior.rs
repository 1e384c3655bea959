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
/// The prior variance τ² of z_ab is that of its neighbourhood of 5 × 5 entries; where the neighbourhood is at the noise it goes on from the last entry seen and decays. Any function of y∥ may be used here
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
        let along = pairs.along(&pairs.data);
        let square = |a: usize, b: usize| pairs.strength(a, b).powi(2);
        // Maximum likelihood of τ² for small τ²: weights |s|⁴ on z² − 1/|s|². Strengths fall steeply from entry to entry,
        // so the strongest neighbours speak for the weak ones.
        let excess = smoothed(
            &pairs.s,
            &Mat::from_fn(n, n, |a, b| square(a, b) * (along[(a, b)].powi(2) - 1.0)),
        );
        let weight = smoothed(&pairs.s, &Mat::from_fn(n, n, |a, b| square(a, b).powi(2)));
        // The mean of the excess over the 25 scatters by √(2 · weight / 25).
        let scatter = 2.0 / ((2 * REACH + 1) as f64).powi(2);
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
                let (over, by) = (excess[(a, b)], weight[(a, b)]);
                let tau = if by > 0.0 && over > 2.0 * (scatter * by).sqrt() {
                    over / by
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

/// The indices near `a` whose singular values are of its own kind: modes of nodes that were never seen have far
/// larger ones, and say nothing about the scale of the others.
fn neighbours(s: &[f64], a: usize, len: usize) -> impl Iterator<Item = usize> {
    const SPREAD: f64 = 20.0;
    (a.saturating_sub(REACH)..(a + REACH + 1).min(len))
        .filter(move |&i| s[i] <= SPREAD * s[a] && s[a] <= SPREAD * s[i])
}

/// Mean over the neighbours of an N × N array.
fn smoothed(s: &[f64], values: &Mat<f64>) -> Mat<f64> {
    let n = values.nrows();
    let near: Vec<Vec<usize>> = (0..n).map(|a| neighbours(s, a, n).collect()).collect();
    let mean = |indices: &[usize], at: &dyn Fn(usize) -> f64| {
        indices.iter().map(|&i| at(i)).sum::<f64>() / indices.len().max(1) as f64
    };
    let rows = Mat::from_fn(n, n, |a, b| mean(&near[a], &|i| values[(i, b)]));
    Mat::from_fn(n, n, |a, b| mean(&near[b], &|i| rows[(a, i)]))
}
