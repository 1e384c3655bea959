//! The BRDF slice on the half grid, non-negative and reciprocal, with σ.

use faer::Mat;

use super::half_circle::HalfCircle;
use super::pairs::{Pairs, Whitened};
use super::posterior::Posterior;
use super::refine::Refined;

/// Rounds of alternating projections between the posterior and the non-negative slices: the change per round is
/// then below a thousandth of σ.
const ROUNDS: usize = 40;

/// ρ(θi′, θo′) and its σ at the nodes, N × N, symmetric.
#[derive(Clone, Debug)]
pub(super) struct Slice {
    /// ρ.
    pub value: Mat<f64>,
    /// σ of ρ.
    pub sigma: Mat<f64>,
}

/// The slice at the refined lighting with L_0 = 1; `changes` are those of [`lighting_changes`].
pub(super) fn slice(
    refined: &Refined,
    whitened: &Whitened,
    half: &HalfCircle,
    changes: &[Mat<f64>],
) -> Slice {
    let pairs = &refined.pairs;
    let y = non_negative(&refined.posterior, pairs);
    let mut variance = own_variance(&refined.posterior, pairs);
    for change in changes {
        let y = &pairs.u * change * pairs.u.transpose();
        for j in 0..half.len() {
            for k in 0..half.len() {
                variance[(k, j)] += y[(k, j)].powi(2);
            }
        }
    }
    // Y = D^½ ρ̃ D^½ and ρ̃ = ρ cos cos.
    let scale = |k: usize, j: usize| {
        1.0 / (whitened.root[k] * whitened.root[j] * half.cosines[k] * half.cosines[j])
    };
    let n = half.len();
    Slice {
        value: Mat::from_fn(n, n, |k, j| y[(k, j)] * scale(k, j)),
        sigma: Mat::from_fn(n, n, |k, j| variance[(k, j)].max(0.0).sqrt() * scale(k, j)),
    }
}

/// Minimises Σ (z − mean)² / variance over Y = U Z Uᵀ ≥ 0 by the alternating direction method of multipliers
/// (S. Boyd et al., Found. Trends Mach. Learn. 3, 2011, section 3): Z is diagonal, Y ≥ 0 a projection.
fn non_negative(posterior: &Posterior, pairs: &Pairs) -> Mat<f64> {
    let n = pairs.nodes();
    let u = &pairs.u;
    let mut variances: Vec<f64> = posterior
        .variance
        .col_iter()
        .flat_map(|c| c.iter().copied().collect::<Vec<_>>())
        .filter(|v| *v > 0.0)
        .collect();
    variances.sort_by(f64::total_cmp);
    let plain = u * &posterior.mean * u.transpose();
    let Some(&typical) = variances.get(variances.len() / 2) else {
        return Mat::from_fn(n, n, |k, j| plain[(k, j)].max(0.0));
    };
    let mut positive = Mat::from_fn(n, n, |k, j| plain[(k, j)].max(0.0));
    let mut dual = Mat::<f64>::zeros(n, n);
    for _ in 0..ROUNDS {
        let target = u.transpose() * (&positive - &dual) * u;
        let z = Mat::from_fn(n, n, |a, b| {
            let v = posterior.variance[(a, b)];
            (typical * posterior.mean[(a, b)] + v * target[(a, b)]) / (typical + v)
        });
        let y = u * z * u.transpose();
        for j in 0..n {
            for k in 0..n {
                let shifted = y[(k, j)] + dual[(k, j)];
                positive[(k, j)] = shifted.max(0.0);
                dual[(k, j)] = shifted - positive[(k, j)];
            }
        }
    }
    positive
}

/// Variance of Y_kj = Σ_ab u_ka u_jb z_ab with independent z_ab = z_ba:
/// Σ_ab v_ab u_ka² u_jb² + Σ_{a≠b} v_ab (u_ka u_ja)(u_kb u_jb).
fn own_variance(posterior: &Posterior, pairs: &Pairs) -> Mat<f64> {
    let n = pairs.nodes();
    let u = &pairs.u;
    let squares = Mat::from_fn(n, n, |k, a| u[(k, a)].powi(2));
    let mut variance = &squares * &posterior.variance * squares.transpose();
    let mut off_diagonal = posterior.variance.clone();
    for a in 0..n {
        off_diagonal[(a, a)] = 0.0;
    }
    for k in 0..n {
        let products = Mat::from_fn(n, n, |j, a| u[(k, a)] * u[(j, a)]);
        let half_way = &products * &off_diagonal;
        for j in 0..n {
            let cross: f64 = (0..n).map(|a| half_way[(j, a)] * products[(j, a)]).sum();
            variance[(k, j)] += cross;
        }
    }
    variance
}

/// What the lighting's own uncertainty does to Z: its change along each principal direction of the lighting's
/// `covariance`, one σ long. With A′ → A′ + T the data along the model are explained by z − y∥(T Z) / |s|.
///
/// Directions below a thousandth of the largest σ are left out.
pub(super) fn lighting_changes(
    refined: &Refined,
    whitened: &Whitened,
    covariance: &Mat<f64>,
) -> Vec<Mat<f64>> {
    let pairs = &refined.pairs;
    let (m, n) = (pairs.rows(), pairs.nodes());
    let Ok(eigen) = covariance.self_adjoint_eigen(faer::Side::Lower) else {
        return Vec::new();
    };
    let response = &whitened.exponentials * &pairs.u * &refined.posterior.mean;
    let lengths: Vec<f64> = eigen
        .S()
        .column_vector()
        .iter()
        .map(|v| v.max(0.0).sqrt())
        .collect();
    let longest = lengths.iter().copied().fold(0.0, f64::max);
    (0..lengths.len())
        .filter(|&direction| lengths[direction] > 1e-3 * longest)
        .map(|direction| {
            let mut rows = Mat::<f64>::zeros(m, n);
            for b in 0..n {
                for i in 1..=(m - 1) / 2 {
                    let re = lengths[direction] * eigen.U()[(2 * i - 2, direction)];
                    let im = lengths[direction] * eigen.U()[(2 * i - 1, direction)];
                    let (x, y) = (response[(2 * i - 1, b)], response[(2 * i, b)]);
                    rows[(2 * i - 1, b)] = re * x - im * y;
                    rows[(2 * i, b)] = re * y + im * x;
                }
            }
            let along = pairs.along(&(pairs.q.transpose() * rows));
            Mat::from_fn(n, n, |a, b| {
                let strength = pairs.strength(a, b);
                // τ²|s| / (1 + τ²|s|²) = variance · |s|.
                refined.posterior.variance[(a, b)] * strength * along[(a, b)]
            })
        })
        .collect()
}
