//! How far the estimate scatters about the truth.
//!
//! With C = (J + P)⁻¹ and K = CP the estimate is x̃ = (1 + K) C h ([`super::posterior`]), the answer (1 − K²) x to a noiseless
//! measurement of x. Over the noise, and over surfaces as the prior expects them, its error has
//!
//! * the covariance of the noise (1 + K) C J C (1 + K)ᵀ = (1 + K − K² − K³) C, and
//! * the expected square of the bias that is left, K² P⁻¹ K²ᵀ = K³ C.
//!
//! Where the samples say much more than the prior, K is small and so is K³. There the first is the whole variance: it is that of
//! the estimate over captures of this very surface, however the prior may err. Where they do not, the sum
//! (1 + K − K²) C counts, which for K → 1 is the prior's own variance.

use std::f64::consts::{FRAC_PI_2, PI};

use faer::Mat;

use super::prior::Precision;
use super::space::Space;

/// Places along each angle at which the variances are computed: one every 5°. Between them only their ratio to the
/// posterior's variance is interpolated, which has no structure finer than the prior's correlation lengths.
const PLACES: usize = 36;

/// Variances of one quantity, relative to the posterior's.
#[derive(Clone, Copy, Debug)]
pub struct Variances {
    /// Of the estimate under noise.
    pub noise: f64,
    /// The same and the square of the bias that the prior leads to expect.
    pub total: f64,
}

/// The variances of functionals v of the unknowns, the columns of `functionals`; `seen` is C v.
pub fn ratios(
    functionals: &Mat<f64>,
    seen: &Mat<f64>,
    covariance: &Mat<f64>,
    prior: &Precision,
) -> Vec<Variances> {
    // u = C v, w = P u, z = C w: then Kⁿ C in the middle of v is u·w, w·z, z·P z for n = 1, 2, 3.
    let pulled = prior.times_columns(seen);
    let twice = covariance * &pulled;
    let last = prior.times_columns(&twice);
    let dot = |a: &Mat<f64>, b: &Mat<f64>, j: usize| -> f64 {
        a.col(j)
            .iter()
            .zip(b.col(j).iter())
            .map(|(a, b)| a * b)
            .sum()
    };
    (0..functionals.ncols())
        .map(|j| {
            let posterior = dot(functionals, seen, j);
            let total = posterior + dot(seen, &pulled, j) - dot(&pulled, &twice, j);
            let left = dot(&twice, &last, j);
            // All lie between 0 and 5/4 but for rounding.
            let relative = |v: f64| (v / posterior.max(f64::MIN_POSITIVE)).clamp(0.0, 1.25);
            Variances {
                noise: relative(total - left),
                total: relative(total),
            }
        })
        .collect()
}

/// The variances of the slice's values relative to the posterior's.
pub struct Spread {
    /// \[i\]\[j\], PLACES².
    places: Vec<Variances>,
}

impl Spread {
    /// From the covariance of the unknowns.
    pub fn new(space: &Space, covariance: &Mat<f64>, prior: &Precision) -> Self {
        let angle = |k: usize| -FRAC_PI_2 + (k as f64 + 0.5) * PI / PLACES as f64;
        let list: Vec<(usize, usize)> = (0..PLACES)
            .flat_map(|i| (0..=i).map(move |j| (i, j)))
            .collect();
        let n = space.len();
        let mut functionals = Mat::zeros(n, list.len());
        let mut seen = Mat::zeros(n, list.len());
        for (k, &(i, j)) in list.iter().enumerate() {
            for (index, weight) in space.value_at(angle(i), angle(j)) {
                functionals[(index, k)] += weight;
                let mut column = seen.col_mut(k);
                column += faer::Scale(weight) * covariance.col(index);
            }
        }
        let values = ratios(&functionals, &seen, covariance, prior);
        let mut places = vec![
            Variances {
                noise: 1.0,
                total: 1.0
            };
            PLACES * PLACES
        ];
        for (&(i, j), v) in list.iter().zip(values) {
            places[i * PLACES + j] = v;
            places[j * PLACES + i] = v;
        }
        Self { places }
    }

    /// Relative to the posterior's variance at (θi′, θo′) = (`a`, `b`), radians.
    pub fn at(&self, a: f64, b: f64) -> Variances {
        let place = |angle: f64| {
            let x = (angle + FRAC_PI_2) / PI * PLACES as f64 - 0.5;
            let x = x.clamp(0.0, (PLACES - 1) as f64);
            let i = (x as usize).min(PLACES - 2);
            (i, x - i as f64)
        };
        let ((i, s), (j, t)) = (place(a), place(b));
        let mix = |pick: &dyn Fn(&Variances) -> f64| {
            let v = |i: usize, j: usize| pick(&self.places[i * PLACES + j]);
            (1.0 - s) * ((1.0 - t) * v(i, j) + t * v(i, j + 1))
                + s * ((1.0 - t) * v(i + 1, j) + t * v(i + 1, j + 1))
        };
        Variances {
            noise: mix(&|v| v.noise),
            total: mix(&|v| v.total),
        }
    }
}
