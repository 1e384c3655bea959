//! Covariance of the recovered lighting, and its Cramér–Rao bound.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use super::columns::{Covariance, Spectrum};
use super::half_circle::HalfCircle;
use super::pairs::{Pairs, Whitened, constraints, rows_of};
use super::refine::{Refined, prior_information};
use crate::error::{Error, Result};
use crate::fourier::Series;

/// (JᵀJ + `prior`)⁻¹.
pub(super) fn inverse_information(jacobian: &Mat<f64>, prior: f64) -> Result<Mat<f64>> {
    let mut information = jacobian.transpose() * jacobian;
    let size = information.nrows();
    for i in 0..size {
        information[(i, i)] += prior;
    }
    Ok(information
        .llt(Side::Lower)
        .map_err(|_| Error::failed("the information matrix of the lighting is singular"))?
        .solve(Mat::<f64>::identity(size, size)))
}

/// Covariance of (Re L_p, Im L_p, …) without L_0: that of the fit with its prior, and where the columns' noise is
/// not white, the real noise carried through the estimator's linear map.
pub(super) fn covariance(
    refined: &Refined,
    whitened: &Whitened,
    spectrum: &Spectrum,
) -> Result<Mat<f64>> {
    let prior = prior_information(&refined.lighting);
    let inverse = inverse_information(&refined.jacobian, prior)?;
    let white = spectrum
        .covariance
        .iter()
        .all(|c| matches!(c, Covariance::White(_)));
    if white {
        return Ok(inverse);
    }
    // δ = W r, r linear in B′: its influence on column k of B, then Σ_k (influence) C_k (influence)ᵀ.
    let map = &inverse * refined.jacobian.transpose();
    let pairs = &refined.pairs;
    let (m, n) = (pairs.rows(), pairs.nodes());
    let influence: Vec<Mat<f64>> = (0..map.nrows())
        .map(|parameter| {
            let mut entries = Mat::<f64>::zeros(m, n);
            for (row, (a, b)) in constraints(m, n).enumerate() {
                let w = map[(parameter, row)];
                let (ca, cb, _) = pairs.gain(a, b);
                entries[(a, b)] += cb * w;
                if a < n {
                    entries[(b, a)] -= ca * w;
                }
            }
            &pairs.q * entries * pairs.u.transpose()
        })
        .collect();
    let rows = rows_of(&whitened.frequencies);
    // What the prior leaves open is not in the noise.
    let mut total = &inverse * &inverse * faer::Scale(prior);
    for (k, noise) in spectrum.covariance.iter().enumerate() {
        let columns = Mat::from_fn(m, influence.len(), |i, parameter| {
            influence[parameter][(i, k)] * whitened.precision[k].sqrt()
        });
        match noise {
            Covariance::White(v) => total += columns.transpose() * &columns * faer::Scale(*v),
            Covariance::Full(c) => {
                let c = Mat::from_fn(m, m, |i, j| c[(rows[i], rows[j])]);
                total += columns.transpose() * c * &columns;
            }
        }
    }
    Ok(total)
}

/// Covariance bound of (Re L_p, Im L_p, …) for L_0 known: the Cramér–Rao bound of the unregularised problem with
/// ρ̃ free and reciprocal on the half circle, at the lighting `truth` and the noiseless spectrum `clean`.
///
/// The information left for L after the unknown ρ̃ is taken out is JᵀJ: along the model the data fix ρ̃, across it they
/// see L alone. Directions without information have an infinite bound.
pub(super) fn bound(
    clean: &Spectrum,
    half: &HalfCircle,
    truth: &Series,
    frequencies: &[usize],
) -> Result<Mat<f64>> {
    let whitened = Whitened::new(clean, half, frequencies);
    let pairs = Pairs::new(&whitened, truth)?;
    let along = pairs.along();
    let floor = 1e-12 * pairs.s[0];
    let unknown = Mat::from_fn(along.nrows(), along.ncols(), |a, b| {
        let strength = pairs.strength(a, b);
        if strength > floor {
            along[(a, b)] / strength
        } else {
            0.0
        }
    });
    let jacobian = pairs.jacobian(&whitened, &unknown);
    let information = jacobian.transpose() * &jacobian;
    let largest = (0..information.nrows())
        .map(|i| information[(i, i)])
        .fold(0.0, f64::max);
    // A floor of 1e-14 of the largest only keeps the inverse finite.
    inverse_information(&jacobian, 1e-14 * largest)
}
