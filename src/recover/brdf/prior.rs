//! The Gaussian prior: how large ρ̃ may be, and how fast it may bend along and across a lobe.

use std::f64::consts::FRAC_PI_2;

use faer::{Mat, Side};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::basis::Basis;
use super::space::Space;
use crate::{Error, Result};

/// Precision of the prior, P = amplitude ∫ρ̃² + across ∫(∂³ρ̃/∂u³)² + along ∫(∂³ρ̃/∂v³)², where u and v are
/// lengths along the diagonals θi′ + θo′ (across a mirror lobe) and θi′ − θo′ (along it).
///
/// The spectrum of such a ρ̃ is 1/(amplitude + across·ω_u⁶ + along·ω_v⁶): a Gaussian field with correlation
/// lengths (across/amplitude)^⅙ and (along/amplitude)^⅙ radians. A mirror lobe makes the second long, a
/// retro-reflective one the first. Third derivatives, because lobes are smooth at small scales: with second ones the
/// error under 1 % noise was twice as large, and σ wider than it need be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Smoothness {
    /// sr², per rad².
    pub amplitude: f64,
    /// rad⁶ times that.
    pub across: f64,
    /// rad⁶ times that.
    pub along: f64,
}

impl Smoothness {
    /// Correlation lengths (across, along), radians.
    pub fn lengths(&self) -> (f64, f64) {
        (
            (self.across / self.amplitude).powf(1.0 / 6.0),
            (self.along / self.amplitude).powf(1.0 / 6.0),
        )
    }

    /// The same prior with all its weights times `factor`.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        Self {
            amplitude: self.amplitude * factor,
            across: self.across * factor,
            along: self.along * factor,
        }
    }

    pub(super) fn weights(&self) -> [f64; 3] {
        [self.amplitude, self.across, self.along]
    }

    pub(super) fn from_weights(w: [f64; 3]) -> Self {
        Self {
            amplitude: w[0],
            across: w[1],
            along: w[2],
        }
    }
}

/// How large ρ̃ may be here compared with elsewhere: a factor on the prior's variance over the slice.
///
/// A lobe fills a small part of it. One size for all would smooth the lobe too much, and the rest too little.
#[derive(Clone, Debug)]
pub struct Relief {
    basis: Basis,
    /// \[m\]\[n\] at the centres of the splines.
    variance: Vec<f64>,
}

impl Relief {
    /// The same everywhere.
    pub fn flat(basis: Basis) -> Self {
        Self {
            basis,
            variance: vec![1.0; basis.len() * basis.len()],
        }
    }

    /// Multiplies by the ratio of two maps \[m\]\[n\], each first averaged over a Gaussian of standard deviation `width`
    /// radians.
    pub fn update(&mut self, wanted: &[f64], held: &[f64], width: f64) {
        let (wanted, held) = (self.blurred(wanted, width), self.blurred(held, width));
        for ((v, w), h) in self.variance.iter_mut().zip(wanted).zip(held) {
            let ratio = (w / h.max(f64::MIN_POSITIVE)).clamp(0.1, 10.0);
            *v = (*v * ratio).clamp(1e-4, 1e4);
        }
    }

    fn blurred(&self, map: &[f64], width: f64) -> Vec<f64> {
        let len = self.basis.len();
        let centre: Vec<f64> = (0..len).map(|m| self.basis.centre(m)).collect();
        let kernel: Vec<Vec<f64>> = centre
            .iter()
            .map(|a| {
                let row: Vec<f64> = centre
                    .iter()
                    .map(|b| (-((a - b) / width).powi(2) / 2.0).exp())
                    .collect();
                let sum: f64 = row.iter().sum();
                row.iter().map(|k| k / sum).collect()
            })
            .collect();
        // Rows, then columns.
        let once: Vec<Vec<f64>> = map
            .chunks(len)
            .map(|row| {
                kernel
                    .iter()
                    .map(|k| k.iter().zip(row).map(|(k, v)| k * v).sum())
                    .collect()
            })
            .collect();
        kernel
            .iter()
            .flat_map(|k| {
                let once = &once;
                (0..len).map(move |n| k.iter().zip(once).map(|(k, row)| k * row[n]).sum())
            })
            .collect()
    }

    /// Bilinear between the centres.
    fn at(&self, a: f64, b: f64) -> f64 {
        let last = self.basis.len() - 1;
        // The centre of an inner spline m is knot m − 1.
        let place = |angle: f64| {
            let x = ((angle + FRAC_PI_2) / self.basis.spacing() + 1.0).clamp(0.0, last as f64);
            let i = (x as usize).min(last - 1);
            (i, x - i as f64)
        };
        let ((i, s), (j, t)) = (place(a), place(b));
        let v = |i: usize, j: usize| self.variance[i * (last + 1) + j];
        (1.0 - s) * ((1.0 - t) * v(i, j) + t * v(i, j + 1))
            + s * ((1.0 - t) * v(i + 1, j) + t * v(i + 1, j + 1))
    }
}

/// The three quadratic forms on the unknowns; each the sum of squares of sparse rows, one for each place \[m\]\[n\] of the full
/// square of coefficients.
pub struct Penalties {
    unknowns: usize,
    forms: [Rows; 3],
}

/// Sparse rows one after the other.
struct Rows {
    starts: Vec<usize>,
    entries: Vec<(usize, f64)>,
}

impl Rows {
    fn iter(&self) -> impl Iterator<Item = &[(usize, f64)]> {
        self.starts.windows(2).map(|w| &self.entries[w[0]..w[1]])
    }
}

/// Σ f x of a sparse row.
fn dot(row: &[(usize, f64)], x: &[f64]) -> f64 {
    row.iter().map(|&(k, f)| f * x[k]).sum()
}

impl Penalties {
    /// The forms on `space`, weighted by 1/relief.
    pub fn new(space: &Space, relief: &Relief) -> Self {
        let basis = space.basis();
        let centre: Vec<f64> = (0..basis.len()).map(|m| basis.centre(m)).collect();
        let forms = [0, 1, 2].map(|form| {
            let mut rows = Rows {
                starts: vec![0],
                entries: Vec::with_capacity(4 * centre.len() * centre.len()),
            };
            for (m, &a) in centre.iter().enumerate() {
                for (n, &b) in centre.iter().enumerate() {
                    let from = rows.entries.len();
                    let scale = relief.at(a, b).sqrt().recip();
                    for (i, j, factor) in difference(basis, scale, form, m, n) {
                        space.each(i, j, |unknown, share| {
                            let entries = &mut rows.entries;
                            match entries[from..].iter_mut().find(|e| e.0 == unknown) {
                                Some(entry) => entry.1 += factor * share,
                                None => entries.push((unknown, factor * share)),
                            }
                        });
                    }
                    rows.starts.push(rows.entries.len());
                }
            }
            rows
        });
        Self {
            unknowns: space.len(),
            forms,
        }
    }

    /// Σ of the three forms at each place \[m\]\[n\].
    pub fn energy(&self, smoothness: &Smoothness, x: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.forms[0].starts.len() - 1];
        for (rows, weight) in self.forms.iter().zip(smoothness.weights()) {
            for (place, row) in out.iter_mut().zip(rows.iter()) {
                *place += weight * dot(row, x).powi(2);
            }
        }
        out
    }

    /// The value of each form at `x`.
    pub fn values(&self, x: &[f64]) -> [f64; 3] {
        [0, 1, 2].map(|form| {
            let rows = self.forms[form].iter();
            rows.map(|row| dot(row, x).powi(2)).sum()
        })
    }

    /// P.
    pub fn precision(&self, smoothness: &Smoothness) -> Precision {
        // The rows in which each unknown is, and its factor there.
        let mut uses: Vec<Vec<(usize, usize, f64)>> = vec![Vec::new(); self.unknowns];
        for (form, rows) in self.forms.iter().enumerate() {
            for (place, row) in rows.iter().enumerate() {
                for &(i, f) in row.iter().filter(|(_, f)| *f != 0.0) {
                    uses[i].push((form, place, f));
                }
            }
        }
        let weights = smoothness.weights();
        let rows = uses
            .par_iter()
            .map_init(
                || vec![0.0; self.unknowns],
                |sums, uses| {
                    let mut touched = Vec::new();
                    for &(form, place, f) in uses {
                        let rows = &self.forms[form];
                        for &(j, g) in &rows.entries[rows.starts[place]..rows.starts[place + 1]] {
                            if sums[j] == 0.0 {
                                touched.push(j);
                            }
                            sums[j] += weights[form] * f * g;
                        }
                    }
                    touched.sort_unstable();
                    touched.dedup();
                    touched
                        .into_iter()
                        .map(|j| (j, std::mem::take(&mut sums[j])))
                        .collect()
                },
            )
            .collect();
        Precision { rows }
    }

    /// Adds P to a dense matrix.
    pub fn add_dense(&self, smoothness: &Smoothness, out: &mut Mat<f64>) {
        for (rows, weight) in self.forms.iter().zip(smoothness.weights()) {
            for row in rows.iter().filter(|_| weight != 0.0) {
                for &(i, a) in row {
                    for &(j, b) in row {
                        out[(i, j)] += weight * a * b;
                    }
                }
            }
        }
    }
}

/// The row of `form` (0 amplitude, 1 across, 2 along) centred at coefficient (m, n) of the full square, times `scale`: up to four
/// coefficients with their factors. Those beyond the square are of the splines left out: 0.
fn difference(
    basis: Basis,
    scale: f64,
    form: usize,
    m: usize,
    n: usize,
) -> impl Iterator<Item = (usize, usize, f64)> {
    let h = basis.spacing();
    let (steps, factor): (&[f64], f64) = if form == 0 {
        (&[1.0], h * scale)
    } else {
        // The diagonal neighbours are √2 h apart; times h, since the sum stands for ∫ da db.
        (
            &[3.0, -1.0, 1.0, -3.0],
            scale * h / (2f64.sqrt() * h).powi(3),
        )
    };
    let side = if form == 1 { 1 } else { -1 };
    let last = basis.len() as isize - 1;
    // −x₋₁ + 3x₀ − 3x₁ + x₂, the middle first.
    let order = [0isize, -1, 2, 1];
    steps.iter().zip(order).filter_map(move |(&step, k)| {
        let (i, j) = (m as isize + k, n as isize + side * k);
        let inside = i >= 0 && j >= 0 && i <= last && j <= last;
        inside.then_some((i as usize, j as usize, step * factor))
    })
}

/// The prior's precision P as a sparse matrix: some twenty numbers in each row where splines are of one width, some hundred where
/// two meet.
pub struct Precision {
    rows: Vec<Vec<(usize, f64)>>,
}

impl Precision {
    /// Adds P to a dense matrix.
    pub fn add_to(&self, out: &mut Mat<f64>) {
        for (i, row) in self.rows.iter().enumerate() {
            for &(j, v) in row {
                // By columns, as P is symmetric.
                out[(j, i)] += v;
            }
        }
    }

    /// P x.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        self.rows.iter().map(|row| dot(row, x)).collect()
    }

    /// P times each column of `x`.
    pub fn times_columns(&self, x: &Mat<f64>) -> Mat<f64> {
        let mut out = Mat::zeros(x.nrows(), x.ncols());
        out.par_col_chunks_mut(1)
            .zip(x.par_col_chunks(1))
            .for_each(|(mut to, from)| {
                let from: Vec<f64> = from.col(0).iter().copied().collect();
                for (i, row) in self.rows.iter().enumerate() {
                    to[(i, 0)] = dot(row, &from);
                }
            });
        out
    }

    /// tr((P C)²) for a symmetric C: what twicing leaves of the prior's share of the parameters.
    pub fn trace_of_square(&self, covariance: &Mat<f64>) -> f64 {
        let product = self.times_columns(covariance);
        (0..product.ncols())
            .map(|j| {
                let column = product.col(j);
                (0..product.nrows())
                    .map(|i| column[i] * product[(j, i)])
                    .sum::<f64>()
            })
            .sum()
    }
}

/// A Cholesky factor L Lᵀ of a precision matrix.
pub struct Factor {
    llt: faer::linalg::solvers::Llt<f64>,
}

impl Factor {
    /// Factors `matrix`.
    ///
    /// # Errors
    /// [`Kind::Failed`](crate::error::Kind) if it is not positive definite to rounding.
    pub fn new(matrix: &Mat<f64>) -> Result<Self> {
        // Directions that the samples do not see may be lost in the rounding of those they see well; a few
        // parts in 10¹² more on the diagonal then change nothing that is measured.
        if let Ok(llt) = matrix.llt(Side::Lower) {
            return Ok(Self { llt });
        }
        let mut lifted = matrix.clone();
        for lift in [1e-13, 1e-12, 1e-11] {
            for i in 0..lifted.nrows() {
                lifted[(i, i)] += lift * matrix[(i, i)];
            }
            if let Ok(llt) = lifted.llt(Side::Lower) {
                return Ok(Self { llt });
            }
        }
        Err(Error::failed("the normal equations of the BRDF are not positive definite")
            .advice("check the variances of the samples and the lighting for extreme values, or set the smoothness by hand"))
    }

    /// ln det.
    pub fn log_determinant(&self) -> f64 {
        let l = self.llt.L();
        2.0 * (0..l.nrows()).map(|i| l[(i, i)].ln()).sum::<f64>()
    }

    /// Solves for all columns of `rhs` in place.
    pub fn solve(&self, rhs: &mut Mat<f64>) {
        use faer::linalg::solvers::Solve;
        self.llt.solve_in_place(rhs);
    }

    /// Solves for one vector.
    pub fn solve_vector(&self, rhs: &[f64]) -> Vec<f64> {
        let mut m = Mat::from_fn(rhs.len(), 1, |i, _| rhs[i]);
        self.solve(&mut m);
        (0..rhs.len()).map(|i| m[(i, 0)]).collect()
    }

    /// L⁻¹ · rhs: its columns' squared norms are variances of the functionals in `rhs`.
    pub fn half_solve(&self, rhs: &mut Mat<f64>) {
        self.llt.L().solve_lower_triangular_in_place(rhs);
    }

    /// L⁻ᵀ · rhs: turns white noise into draws with this precision.
    pub fn draw(&self, rhs: &mut Mat<f64>) {
        self.llt
            .L()
            .transpose()
            .solve_upper_triangular_in_place(rhs);
    }

    /// The whole covariance matrix.
    pub fn inverse(&self) -> Mat<f64> {
        use faer::linalg::solvers::DenseSolveCore;
        self.llt.inverse()
    }
}
