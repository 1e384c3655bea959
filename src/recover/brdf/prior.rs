//! The Gaussian prior: how large ρ̃ may be, and how fast it may bend along and across a lobe.

use std::f64::consts::FRAC_PI_2;

use faer::{Mat, Side};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::basis::{Basis, Local};
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
    /// Whose intervals are its cells.
    basis: Basis,
    /// \[i\]\[j\] in the middle of the cells.
    variance: Vec<f64>,
}

impl Relief {
    /// The same everywhere.
    pub fn flat(basis: Basis) -> Self {
        Self {
            basis,
            variance: vec![1.0; basis.intervals() * basis.intervals()],
        }
    }

    /// Multiplies by the ratio of two maps \[i\]\[j\], each first averaged over a Gaussian of standard deviation `width`
    /// radians.
    pub fn update(&mut self, wanted: &[f64], held: &[f64], width: f64) {
        let (wanted, held) = (self.blurred(wanted, width), self.blurred(held, width));
        for ((v, w), h) in self.variance.iter_mut().zip(wanted).zip(held) {
            let ratio = (w / h.max(f64::MIN_POSITIVE)).clamp(0.1, 10.0);
            *v = (*v * ratio).clamp(1e-4, 1e4);
        }
    }

    fn blurred(&self, map: &[f64], width: f64) -> Vec<f64> {
        let len = self.basis.intervals();
        let width = width / self.basis.spacing();
        let kernel: Vec<Vec<f64>> = (0..len)
            .map(|a| {
                let row: Vec<f64> = (0..len)
                    .map(|b| (-((a as f64 - b as f64) / width).powi(2) / 2.0).exp())
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

    /// The cell in which (a, b) is, and that across the diagonal.
    fn cells(&self, a: f64, b: f64) -> [usize; 2] {
        let (i, j) = (self.basis.interval(a), self.basis.interval(b));
        let len = self.basis.intervals();
        [i * len + j, j * len + i]
    }

    /// Bilinear between the middles of the cells.
    fn at(&self, a: f64, b: f64) -> f64 {
        let len = self.basis.intervals();
        let place = |angle: f64| {
            let x = (angle + FRAC_PI_2) / self.basis.spacing() - 0.5;
            let x = x.clamp(0.0, (len - 1) as f64);
            let i = (x as usize).min(len - 2);
            (i, x - i as f64)
        };
        let ((i, s), (j, t)) = (place(a), place(b));
        let v = |i: usize, j: usize| self.variance[i * len + j];
        (1.0 - s) * ((1.0 - t) * v(i, j) + t * v(i, j + 1))
            + s * ((1.0 - t) * v(i + 1, j) + t * v(i + 1, j + 1))
    }
}

/// The three quadratic forms on the unknowns, each the sum of squares of sparse rows.
pub struct Penalties {
    /// Values of the forms between unknown i and the j ≤ i with which it has any: of each i its (j, values).
    products: Vec<Vec<(usize, [f64; 3])>>,
    rows: Rows,
}

/// Sparse rows one after the other; of each a value in every form.
struct Rows {
    starts: Vec<usize>,
    entries: Vec<(usize, [f64; 3])>,
    /// The cells \[i\]\[j\] of the relief in which each row is, across the diagonal of each other.
    cells: Vec<[usize; 2]>,
}

impl Rows {
    fn row(&self, k: usize) -> &[(usize, [f64; 3])] {
        &self.entries[self.starts[k]..self.starts[k + 1]]
    }

    fn len(&self) -> usize {
        self.cells.len()
    }

    /// Of ∫ρ̃², ∫(∂³ρ̃/∂u³)² and ∫(∂³ρ̃/∂v³)², each weighted by 1/relief.
    ///
    /// The integrals are taken by 2 × 2 points of Gauss in every cell of the finest knots. One point would not see the waves that have a knot or a middle in each
    /// of their zeros; and differences of the coefficients would take the ends, where knots coincide, for corners of the slice.
    fn new(space: &Space, relief: &Relief) -> Self {
        let basis = space.basis();
        let h = basis.spacing();
        let offset = 0.5 / 3f64.sqrt();
        let jets: Vec<(f64, [Local; 4])> = (0..basis.intervals())
            .flat_map(|i| [0.5 - offset, 0.5 + offset].map(|part| basis.cell(i, part)))
            .map(|angle| (angle, [0, 1, 2, 3].map(|k| basis.derivative(angle, k))))
            .collect();
        let of_cells: Vec<Self> = (0..basis.intervals())
            .into_par_iter()
            .map(|i| {
                let mut rows = Self::empty();
                for j in 0..=i {
                    let patch = space.patch(i, j);
                    // Those across the diagonal are the same.
                    let share = h / 2.0 * if i == j { 1.0 } else { 2f64.sqrt() };
                    for (a, at_a) in &jets[2 * i..2 * i + 2] {
                        for (b, at_b) in &jets[2 * j..2 * j + 2] {
                            let scale = share / relief.at(*a, *b).sqrt();
                            let third = scale / 8f64.sqrt();
                            let mixed = |sign: f64| {
                                patch.sum(&[
                                    (at_a[3], at_b[0], third),
                                    (at_a[2], at_b[1], 3.0 * sign * third),
                                    (at_a[1], at_b[2], 3.0 * third),
                                    (at_a[0], at_b[3], sign * third),
                                ])
                            };
                            let (across, along) = (mixed(1.0), mixed(-1.0));
                            for (u, w) in across.into_iter().zip(along) {
                                rows.entries.push((u.0, [0.0, u.1, w.1]));
                            }
                            rows.finish(relief.cells(*a, *b));
                        }
                    }
                }
                rows
            })
            .collect();
        let mut all = Self::of_size(space, relief);
        for rows in of_cells {
            let from = all.entries.len();
            all.starts.extend(rows.starts[1..].iter().map(|s| s + from));
            all.entries.extend(rows.entries);
            all.cells.extend(rows.cells);
        }
        all
    }

    /// Of ∫ρ̃² as the sum of the squares of the coefficients.
    fn of_size(space: &Space, relief: &Relief) -> Self {
        let basis = space.basis();
        let mut rows = Self::empty();
        for m in 0..basis.len() {
            for n in 0..=m {
                let (a, b) = (basis.centre(m), basis.centre(n));
                let share = basis.spacing() * if m == n { 1.0 } else { 2f64.sqrt() };
                let scale = share / relief.at(a, b).sqrt();
                space.each(m, n, |unknown, factor| {
                    rows.entries.push((unknown, [scale * factor, 0.0, 0.0]));
                });
                rows.finish(relief.cells(a, b));
            }
        }
        rows
    }

    fn empty() -> Self {
        Self {
            starts: vec![0],
            entries: Vec::new(),
            cells: Vec::new(),
        }
    }

    fn finish(&mut self, cells: [usize; 2]) {
        self.starts.push(self.entries.len());
        self.cells.push(cells);
    }

    /// Their squares, for each of so many unknowns.
    fn products(&self, unknowns: usize) -> Vec<Vec<(usize, [f64; 3])>> {
        // The rows in which each unknown is, and its values there.
        let mut uses: Vec<Vec<(u32, [f64; 3])>> = vec![Vec::new(); unknowns];
        for k in 0..self.len() {
            for &(i, v) in self.row(k) {
                uses[i].push((k as u32, v));
            }
        }
        uses.par_iter()
            .enumerate()
            .map_init(
                || (vec![[0.0; 3]; unknowns], vec![false; unknowns]),
                |(sums, seen), (i, uses)| {
                    let mut touched = Vec::new();
                    for &(k, f) in uses {
                        for &(j, g) in self.row(k as usize).iter().filter(|(j, _)| *j <= i) {
                            if !std::mem::replace(&mut seen[j], true) {
                                touched.push(j);
                            }
                            for (sum, (f, g)) in sums[j].iter_mut().zip(f.iter().zip(g)) {
                                *sum += f * g;
                            }
                        }
                    }
                    touched.sort_unstable();
                    touched
                        .into_iter()
                        .map(|j| {
                            seen[j] = false;
                            (j, std::mem::take(&mut sums[j]))
                        })
                        .collect()
                },
            )
            .collect()
    }
}

/// Σ f x of a sparse row.
fn dot(row: &[(usize, f64)], x: &[f64]) -> f64 {
    row.iter().map(|&(k, f)| f * x[k]).sum()
}

/// Σ of weights times forms.
fn weigh(weights: &[f64; 3], forms: &[f64; 3]) -> f64 {
    weights.iter().zip(forms).map(|(w, f)| w * f).sum()
}

impl Penalties {
    /// The forms on `space`, weighted by 1/relief.
    pub fn new(space: &Space, relief: &Relief) -> Self {
        let rows = Rows::new(space, relief);
        Self {
            products: rows.products(space.len()),
            rows,
        }
    }

    /// Σ of the three forms in each cell \[i\]\[j\] of the relief, `cells` in all.
    pub fn energy(&self, smoothness: &Smoothness, x: &[f64], cells: usize) -> Vec<f64> {
        let weights = smoothness.weights();
        let mut out = vec![0.0; cells];
        for k in 0..self.rows.len() {
            let mut values = [0.0; 3];
            for &(i, f) in self.rows.row(k) {
                for (value, f) in values.iter_mut().zip(f) {
                    *value += f * x[i];
                }
            }
            let energy = weigh(&weights, &values.map(|v| v * v));
            for cell in self.rows.cells[k] {
                out[cell] += 0.5 * energy;
            }
        }
        out
    }

    /// The value of each form at `x`.
    pub fn values(&self, x: &[f64]) -> [f64; 3] {
        let mut out = [0.0; 3];
        for (i, row) in self.products.iter().enumerate() {
            for &(j, forms) in row {
                let both = if i == j { 1.0 } else { 2.0 } * x[i] * x[j];
                for (sum, f) in out.iter_mut().zip(forms) {
                    *sum += both * f;
                }
            }
        }
        // None is below 0 but by rounding.
        out.map(|v| v.max(0.0))
    }

    /// P.
    pub fn precision(&self, smoothness: &Smoothness) -> Precision {
        let weights = smoothness.weights();
        let mut rows = vec![Vec::new(); self.products.len()];
        for (i, row) in self.products.iter().enumerate() {
            for (j, forms) in row {
                let value = weigh(&weights, forms);
                rows[i].push((*j, value));
                if *j != i {
                    rows[*j].push((i, value));
                }
            }
        }
        Precision { rows }
    }

    /// Adds P to a dense matrix.
    pub fn add_dense(&self, smoothness: &Smoothness, out: &mut Mat<f64>) {
        let weights = smoothness.weights();
        for (i, row) in self.products.iter().enumerate() {
            for (j, forms) in row {
                let value = weigh(&weights, forms);
                out[(i, *j)] += value;
                if *j != i {
                    out[(*j, i)] += value;
                }
            }
        }
    }
}

/// The Cholesky factor L Lᵀ of a prior's precision, of which only a band about the diagonal is not 0: splines meet those some rows on and no
/// others, and the unknowns are in the order of the rows. A thirteenth of the work of the dense one.
pub struct Banded {
    /// Entries of a row before the diagonal.
    width: usize,
    /// L_{ij} at \[i\]\[j − i + width\]; 0 where j < 0.
    rows: Vec<f64>,
}

impl Banded {
    /// Factors P on a space whose every coefficient is an unknown; `None` if it is not positive definite to rounding.
    pub fn new(penalties: &Penalties, smoothness: &Smoothness) -> Option<Self> {
        let weights = smoothness.weights();
        let products = &penalties.products;
        let reach = |(i, row): (usize, &Vec<(usize, [f64; 3])>)| row.first().map_or(0, |p| i - p.0);
        let width = products.iter().enumerate().map(reach).max().unwrap_or(0);
        let stride = width + 1;
        let mut rows = vec![0.0; stride * products.len()];
        for (i, row) in products.iter().enumerate() {
            let (before, own) = rows.split_at_mut(stride * i);
            let own = &mut own[..stride];
            for (j, forms) in row {
                own[j + width - i] = weigh(&weights, forms);
            }
            for j in i.saturating_sub(width)..i {
                // The columns that both rows hold: from i − width to j.
                let at = j + width - i;
                let other = &before[stride * j..stride * (j + 1)];
                let sum = inner(&own[..at], &other[width - at..width]);
                own[at] = (own[at] - sum) / other[width];
            }
            let left = own[width] - inner(&own[..width], &own[..width]);
            if !(left > 0.0 && left.is_finite()) {
                return None;
            }
            own[width] = left.sqrt();
        }
        Some(Self { width, rows })
    }

    /// L⁻ᵀ · rhs: turns white noise into draws with this precision.
    pub fn draw(&self, rhs: &mut Mat<f64>) {
        let stride = self.width + 1;
        for mut column in rhs.col_iter_mut() {
            for i in (0..column.nrows()).rev() {
                let row = &self.rows[stride * i..stride * (i + 1)];
                let value = column[i] / row[self.width];
                column[i] = value;
                let from = i.saturating_sub(self.width);
                for (j, l) in (from..i).zip(&row[self.width - (i - from)..]) {
                    column[j] -= l * value;
                }
            }
        }
    }
}

/// Σ a b, summed in eight parts that a processor adds side by side.
fn inner(a: &[f64], b: &[f64]) -> f64 {
    let mut parts = [0.0; 8];
    let (whole_a, rest_a) = a.as_chunks::<8>();
    let (whole_b, rest_b) = b.as_chunks::<8>();
    for (a, b) in whole_a.iter().zip(whole_b) {
        for (sum, (a, b)) in parts.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    parts.iter().sum::<f64>() + rest
}

/// The precision of coefficients on the finest splines that are independent of each other: `amplitude` times the square of the
/// spacing each.
pub fn white(space: &Space, amplitude: f64) -> Precision {
    let basis = space.basis();
    let weight = amplitude * basis.spacing().powi(2);
    let mut rows = vec![Vec::new(); space.len()];
    let mut terms = Vec::new();
    for m in 0..basis.len() {
        for n in 0..=m {
            terms.clear();
            space.each(m, n, |unknown, factor| terms.push((unknown, factor)));
            let both = if m == n { 1.0 } else { 2.0 };
            for &(i, f) in &terms {
                rows[i].extend(terms.iter().map(|&(j, g)| (j, both * weight * f * g)));
            }
        }
    }
    for row in &mut rows {
        row.sort_unstable_by_key(|(j, _)| *j);
        row.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            if same {
                kept.1 += next.1;
            }
            same
        });
    }
    Precision { rows }
}

/// Columns that are multiplied at a time.
const ABREAST: usize = 8;

/// The prior's precision P as a sparse matrix: some hundred numbers in each row.
#[derive(Clone)]
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

    /// P times a factor.
    #[must_use]
    pub fn times_factor(mut self, factor: f64) -> Self {
        for (_, v) in self.rows.iter_mut().flatten() {
            *v *= factor;
        }
        self
    }

    /// P x.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        self.rows.iter().map(|row| dot(row, x)).collect()
    }

    /// P times each column of `x`.
    pub fn times_columns(&self, x: &Mat<f64>) -> Mat<f64> {
        let mut out = Mat::zeros(x.nrows(), x.ncols());
        // Some columns side by side, so that each number of P is read once for all of them.
        out.par_col_chunks_mut(ABREAST)
            .zip(x.par_col_chunks(ABREAST))
            .for_each(|(mut to, from)| {
                let mut side_by_side = vec![[0.0; ABREAST]; from.nrows()];
                for k in 0..from.ncols() {
                    for (place, v) in side_by_side.iter_mut().zip(from.col(k).iter()) {
                        place[k] = *v;
                    }
                }
                for (i, row) in self.rows.iter().enumerate() {
                    let mut sums = [0.0; ABREAST];
                    for &(j, f) in row {
                        for (sum, v) in sums.iter_mut().zip(&side_by_side[j]) {
                            *sum += f * v;
                        }
                    }
                    for (k, sum) in sums.iter().enumerate().take(to.ncols()) {
                        to[(i, k)] = *sum;
                    }
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
