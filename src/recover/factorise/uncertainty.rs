//! Covariance of the recovered lighting, and its Cramér–Rao bound.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use super::columns::{Covariance, Spectrum};
use super::half_circle::HalfCircle;
use super::pairs::{Pairs, Whitened, rows_of};
use super::refine::{Refined, prior};
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

/// What the noise in Ẑ adds to ĴᵀĴ: N_kl = E[noise of J_k · noise of J_l] for z_ab with the variance (κ/|s|)² of their
/// shrunk estimates.
fn noise_information(refined: &Refined, whitened: &Whitened) -> Mat<f64> {
    let pairs = &refined.pairs;
    let (m, n) = (pairs.rows(), pairs.nodes());
    let in_basis = &whitened.exponentials * &pairs.u;
    // κ = variance · |s|².
    let scatter = Mat::from_fn(n, n, |a, b| {
        (refined.posterior.variance[(a, b)] * pairs.strength(a, b)).powi(2)
    });
    // Parameter k reads rows of Q and rows of the response: (row of Q, row of E, sign).
    let reads = |k: usize| {
        let (re, im) = (2 * (k / 2) + 1, 2 * (k / 2) + 2);
        if k.is_multiple_of(2) {
            [(re, re, 1.0), (im, im, 1.0)]
        } else {
            [(re, im, -1.0), (im, re, 1.0)]
        }
    };
    // The errors that all samples share have exact derivatives.
    let size = refined.jacobian.ncols();
    let mut noise = Mat::<f64>::zeros(size, size);
    for b in 0..m.min(n) {
        let response = Mat::from_fn(m, n, |i, c| in_basis[(i, c)] * scatter[(c, b)].sqrt());
        let covariance = &response * response.transpose();
        // (a, b) enters as c_b X_ab in its own constraint, whichever of the two indices is the larger.
        let turned = Mat::from_fn(m, m, |i, a| {
            let share = if a == b { 0.0 } else { pairs.gain(a, b).1 };
            share * pairs.q[(i, a)]
        });
        let weight = &turned * turned.transpose();
        for k in 0..m - 1 {
            for l in 0..=k {
                let mut sum = 0.0;
                for (q, e, sign) in reads(k) {
                    for (other_q, other_e, other_sign) in reads(l) {
                        sum += sign * other_sign * weight[(q, other_q)] * covariance[(e, other_e)];
                    }
                }
                noise[(k, l)] += sum;
                if k != l {
                    noise[(l, k)] += sum;
                }
            }
        }
    }
    noise
}

/// Part of the prior that keeps the score's variance positive where the data say nothing.
const FLOOR: f64 = 1e-3;

/// How well the estimator knows what it found.
pub(super) struct Linearised {
    /// Covariance of (Re L_p, Im L_p, …) without L_0, and of the errors that all samples share.
    joint: Mat<f64>,
    /// How many of its rows are the light's.
    light: usize,
}

impl Linearised {
    /// The covariance is that of the fit with its prior, and where the columns' noise is not white, the real noise carried
    /// through the estimator's linear map.
    ///
    /// The score Ĵᵀ y⊥ has variance ĴᵀĴ, but its slope is Ĵᵀ J = ĴᵀĴ − N, since the noise in Ĵ finds no echo in y⊥. In
    /// the principal directions of the two, of reliability r = slope / variance, the information is r² of what ĴᵀĴ claims.
    pub fn new(refined: &Refined, whitened: &Whitened, spectrum: &Spectrum) -> Result<Self> {
        let fault =
            || Error::failed("the information matrix of the lighting could not be decomposed");
        let prior = prior(refined);
        let mut variance = refined.jacobian.transpose() * &refined.jacobian;
        let size = variance.nrows();
        for (i, prior) in prior.iter().enumerate() {
            variance[(i, i)] += FLOOR * prior;
        }
        let slope = &variance - noise_information(refined, whitened);
        let factor = variance.llt(Side::Lower).map_err(|_| fault())?;
        let root = factor.L().to_owned();
        let mut half_way = slope;
        root.solve_lower_triangular_in_place(&mut half_way);
        let mut ratio = half_way.transpose().to_owned();
        root.solve_lower_triangular_in_place(&mut ratio);
        let eigen = ratio.self_adjoint_eigen(Side::Lower).map_err(|_| fault())?;
        let reliability: Vec<f64> = eigen
            .S()
            .column_vector()
            .iter()
            .map(|r| r.clamp(0.0, 1.0))
            .collect();
        let frame = &root * eigen.U();
        let trusted = Mat::from_fn(size, size, |i, d| frame[(i, d)] * reliability[d]);
        let information = &trusted * trusted.transpose();
        let mut regular = information;
        for (i, prior) in prior.iter().enumerate() {
            regular[(i, i)] += prior;
        }
        let inverse = regular
            .llt(Side::Lower)
            .map_err(|_| fault())?
            .solve(Mat::<f64>::identity(size, size));
        let white = spectrum
            .covariance
            .iter()
            .all(|c| matches!(c, Covariance::White(_)))
            && spectrum.folded.iter().all(|f| *f == 0.0);
        let joint = if white {
            inverse
        } else {
            // The score's trusted part: L V r Vᵀ L⁻¹ Ĵᵀ.
            let mut score = refined.jacobian.transpose().to_owned();
            root.solve_lower_triangular_in_place(&mut score);
            let map = &inverse * (&trusted * (eigen.U().transpose() * score));
            // What the prior leaves open is not in the noise.
            let left = Mat::from_fn(size, size, |i, j| inverse[(i, j)] * prior[j].sqrt());
            &left * left.transpose() + carried(&map, refined, whitened, spectrum)
        };
        Ok(Self {
            joint,
            light: size - refined.systematics.len(),
        })
    }

    /// Covariance of (Re L_p, Im L_p, …) without L_0.
    pub fn covariance(&self) -> Mat<f64> {
        self.joint
            .submatrix(0, 0, self.light, self.light)
            .to_owned()
    }

    /// What is still open of the errors that all samples share: independent combinations of them, each one standard deviation
    /// long, and what each does to (Re L_p, Im L_p, …).
    pub fn open_systematics(&self) -> Vec<(Vec<f64>, Vec<f64>)> {
        let count = self.joint.nrows() - self.light;
        if count == 0 {
            return Vec::new();
        }
        let own = self
            .joint
            .submatrix(self.light, self.light, count, count)
            .to_owned();
        let cross = self.joint.submatrix(0, self.light, self.light, count);
        let Ok(eigen) = own.self_adjoint_eigen(Side::Lower) else {
            return Vec::new();
        };
        (0..count)
            .filter_map(|d| {
                let sigma = eigen.S().column_vector()[d].max(0.0).sqrt();
                let direction = eigen.U().col(d);
                let with = cross * direction;
                (sigma > 0.0).then(|| {
                    (
                        direction.iter().map(|u| u * sigma).collect(),
                        with.iter().map(|c| c / sigma).collect(),
                    )
                })
            })
            .collect()
    }
}

/// The columns' real noise through δx = `map` · y⊥.
fn carried(
    map: &Mat<f64>,
    refined: &Refined,
    whitened: &Whitened,
    spectrum: &Spectrum,
) -> Mat<f64> {
    // y⊥ is linear in B′: the influence of column k of B, then Σ_k (influence) C_k (influence)ᵀ.
    let pairs = &refined.pairs;
    let (m, n) = (pairs.rows(), pairs.nodes());
    let influence: Vec<Mat<f64>> = (0..map.nrows())
        .map(|parameter| {
            let mut entries = Mat::<f64>::zeros(m, n);
            for (row, c) in pairs.constraints.iter().enumerate() {
                let w = map[(parameter, row)];
                entries[(c.a, c.b)] += c.cb * w;
                if c.a < n {
                    entries[(c.b, c.a)] -= c.ca * w;
                }
            }
            &pairs.q * entries * pairs.u.transpose()
        })
        .collect();
    let rows = rows_of(&whitened.frequencies);
    let mut total = Mat::<f64>::zeros(map.nrows(), map.nrows());
    for (k, noise) in spectrum.covariance.iter().enumerate() {
        let columns = Mat::from_fn(m, influence.len(), |i, parameter| {
            let weight = whitened.weight[rows[i].div_ceil(2)];
            influence[parameter][(i, k)] * weight * whitened.precision[k].sqrt()
        });
        let c = Mat::from_fn(m, m, |i, j| {
            let folded = if i == j {
                spectrum.variance(rows[i].div_ceil(2), k) - noise.at(rows[i].div_ceil(2))
            } else {
                0.0
            };
            folded
                + match noise {
                    Covariance::White(v) if i == j => *v,
                    Covariance::White(_) => 0.0,
                    Covariance::Full(c) => c[(rows[i], rows[j])],
                }
        });
        total += columns.transpose() * c * &columns;
    }
    total
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
    let pairs = Pairs::new(&whitened, truth, &[])?;
    let along = pairs.along(&pairs.data);
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
