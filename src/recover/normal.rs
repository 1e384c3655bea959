//! The weighted least-squares problem of the lighting, by its structure.
//!
//! Samples b_i ≈ Σ_p L_p H_p(θo′_i) e^{ipα_i} are linear in L. Within a column of equal θo′ the normal
//! matrix depends on the samples only through S_d = Σ_i w_i e^{idα_i}, so it costs
//! O(columns · (samples · P + P²)) instead of O(samples · P²), and the design matrix is never formed.
//!
//! Unknowns are real: x = (L_0, Re L_1, Im L_1, Re L_2, …), 2P + 1 values.

use std::ops::Range;

use faer::Mat;
use num_complex::Complex64;
use rayon::prelude::*;

use crate::brdf::{Brdf, transfer_row};
use crate::fourier::{CircleTransform, Series, irregular};
use crate::light_field::{Column, Samples};

/// Columns that one task sums up before the tasks' results are added in order: fixed, so that the
/// result does not depend on the number of threads.
const CHUNK: usize = 12;

/// Normal equations A x = y of one channel, and what is needed to predict samples.
#[derive(Clone, Debug)]
pub struct NormalSystem {
    /// P, the largest frequency of the model.
    pub order: usize,
    /// A = Dᵀ W D, \[2P+1, 2P+1\], symmetric.
    pub matrix: Mat<f64>,
    /// y = Dᵀ W b, \[2P+1\].
    pub vector: Vec<f64>,
    /// bᵀ W b.
    pub square: f64,
    /// Number of samples with finite variance.
    pub count: usize,
    /// Sum of their weights.
    pub weight: f64,
    /// Their largest |b|.
    pub largest: f64,
    /// H_p(θo′) for each column, \[column\]\[p\], 0 ≤ p ≤ P.
    pub transfer: Vec<Vec<Complex64>>,
    /// Weights of the samples, \[column\]\[n\]; 0 where missing.
    pub weights: Vec<Vec<f64>>,
    turns: Vec<Turns>,
}

/// Position of Re L_p in the vector of unknowns; Im L_p (p ≥ 1) follows it.
pub fn position(p: usize) -> usize {
    if p == 0 { 0 } else { 2 * p - 1 }
}

/// The unknowns as a series.
pub fn to_series(x: &[f64]) -> Series {
    let order = x.len() / 2;
    let coefficients = (0..=order)
        .map(|p| match p {
            0 => Complex64::new(x[0], 0.0),
            _ => Complex64::new(x[2 * p - 1], x[2 * p]),
        })
        .collect();
    Series { coefficients }
}

/// A series as unknowns.
pub fn from_series(series: &Series) -> Vec<f64> {
    let mut x = vec![0.0; 2 * series.order() + 1];
    for (p, c) in series.coefficients.iter().enumerate() {
        x[position(p)] = c.re;
        if p > 0 {
            x[position(p) + 1] = c.im;
        }
    }
    x
}

/// Weight 1/σ² of a sample; 0 if it is missing.
fn weight(variance: f64) -> f64 {
    if variance.is_finite() && variance > 0.0 {
        1.0 / variance
    } else {
        0.0
    }
}

/// How the samples of a column lie on the circle.
#[derive(Clone, Debug)]
enum Turns {
    /// Evenly, so many of them from this α on.
    Regular(usize, f64),
    /// Anyhow: cos α and −sin α of each, the factors from one frequency to the next.
    Irregular(Vec<[f64; 2]>),
}

impl Turns {
    fn of(column: &Column) -> Self {
        match column.regular() {
            Some(n) => Self::Regular(n, column.alpha.first().copied().unwrap_or(0.0)),
            None => Self::Irregular(irregular::turns(&column.alpha)),
        }
    }

    /// A series at the samples.
    fn values(&self, series: &Series) -> Vec<f64> {
        match self {
            Self::Regular(n, start) => CircleTransform::new(*n, *start).synthesise(series),
            Self::Irregular(turns) => irregular::synthesise(turns, &[series])
                .pop()
                .unwrap_or_default(),
        }
    }

    /// Σ_i value_i e^{−idα_i} for 0 ≤ d ≤ order, for each of some lists of values: an FFT on a regular circle, else by
    /// recurrence.
    fn sums(&self, column: &Column, values: &[&[f64]], order: usize) -> Vec<Vec<Complex64>> {
        match self {
            Self::Regular(n, start) if order > 4 => {
                let circle = CircleTransform::new(*n, *start);
                values.iter().map(|v| circle.sum(v, order)).collect()
            }
            Self::Regular(..) => irregular::sums(&irregular::turns(&column.alpha), values, order),
            Self::Irregular(turns) => irregular::sums(turns, values, order),
        }
    }
}

impl NormalSystem {
    /// Sums up the samples of `channel` for a light of frequencies up to `order` on the surface
    /// `brdf`.
    pub fn new(samples: &Samples, channel: usize, brdf: &dyn Brdf, order: usize) -> Self {
        let transfer: Vec<Vec<Complex64>> = samples
            .columns
            .par_iter()
            .map(|c| transfer_row(brdf, c.local, order))
            .collect();
        Self::with_transfer(samples, channel, transfer, order)
    }

    /// The same with H_p(θo′) given for each column, \[column\]\[p\].
    pub fn with_transfer(
        samples: &Samples,
        channel: usize,
        transfer: Vec<Vec<Complex64>>,
        order: usize,
    ) -> Self {
        let n = 2 * order + 1;
        let turns: Vec<Turns> = samples.columns.iter().map(Turns::of).collect();
        let weights: Vec<Vec<f64>> = samples
            .columns
            .iter()
            .map(|c| c.variance[channel].iter().map(|&v| weight(v)).collect())
            .collect();
        let parts: Vec<Part> = in_chunks(samples, |columns| {
            let mut part = Part::new(order);
            for j in columns {
                let column = &samples.columns[j];
                part.add(column, &turns[j], channel, &weights[j], &transfer[j]);
            }
            part
        });
        let mut sum = Part::new(order);
        for part in &parts {
            sum.merge(part);
        }
        let matrix = Mat::from_fn(n, n, |i, j| sum.entry(i.max(j), i.min(j)));
        Self {
            order,
            matrix,
            vector: sum.vector,
            square: sum.square,
            count: sum.count,
            weight: sum.weight,
            largest: sum.largest,
            transfer,
            weights,
            turns,
        }
    }

    /// Dᵀ W f for any function f given at the samples, \[column\]\[n\]; f at missing samples is
    /// ignored. `samples` are those that the system was made of.
    pub fn project(&self, samples: &Samples, f: &[Vec<f64>]) -> Vec<f64> {
        Self::project_all(samples, &[(self, f)])
            .pop()
            .unwrap_or_default()
    }

    /// The same for many functions, each with the system of its channel; all systems are of the same samples. Functions
    /// that vanish at the same samples are best next to each other.
    pub fn project_all(samples: &Samples, all: &[(&Self, &[Vec<f64>])]) -> Vec<Vec<f64>> {
        let parts: Vec<Vec<Vec<f64>>> = in_chunks(samples, |columns| {
            let here: Vec<(&Self, &[Vec<f64>])> = all
                .iter()
                .map(|(system, f)| (*system, f.get(columns.clone()).unwrap_or_default()))
                .collect();
            Self::project_columns(samples, columns, &here)
        });
        let mut y: Vec<Vec<f64>> = all
            .iter()
            .map(|(system, _)| vec![0.0; 2 * system.order + 1])
            .collect();
        for part in &parts {
            for (a, b) in y.iter_mut().flatten().zip(part.iter().flatten()) {
                *a += b;
            }
        }
        y
    }

    /// What some columns add to [`Self::project_all`]; the functions are given in these columns alone.
    pub fn project_columns(
        samples: &Samples,
        columns: Range<usize>,
        all: &[(&Self, &[Vec<f64>])],
    ) -> Vec<Vec<f64>> {
        let order = all.iter().map(|(system, _)| system.order).max();
        let mut y: Vec<Vec<f64>> = all
            .iter()
            .map(|(system, _)| vec![0.0; 2 * system.order + 1])
            .collect();
        for (k, j) in columns.enumerate() {
            let weighted: Vec<Vec<f64>> = all
                .iter()
                .map(|(system, f)| {
                    let values = f.get(k).map_or(&[][..], Vec::as_slice);
                    let both = values.iter().zip(&system.weights[j]);
                    both.map(|(f, w)| if *w > 0.0 { w * f } else { 0.0 })
                        .collect()
                })
                .collect();
            let weighted: Vec<&[f64]> = weighted.iter().map(Vec::as_slice).collect();
            let (Some((first, _)), Some(order)) = (all.first(), order) else {
                break;
            };
            let sums = first.turns[j].sums(&samples.columns[j], &weighted, order);
            for ((y, (system, _)), sums) in y.iter_mut().zip(all).zip(&sums) {
                add_projection(y, &system.transfer[j], sums);
            }
        }
        y
    }

    /// The samples that light `series` would give, \[column\]\[n\].
    pub fn predict(&self, series: &Series) -> Vec<Vec<f64>> {
        self.turns
            .par_iter()
            .zip(&self.transfer)
            .map(|(turns, h)| {
                let both = h.iter().zip(&series.coefficients);
                turns.values(&Series {
                    coefficients: both.map(|(h, l)| h * l).collect(),
                })
            })
            .collect()
    }
}

/// What is found of some columns at a time, in their order.
pub fn in_chunks<T: Send>(samples: &Samples, of: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    let count = samples.columns.len();
    (0..count.div_ceil(CHUNK))
        .into_par_iter()
        .map(|k| of(k * CHUNK..count.min((k + 1) * CHUNK)))
        .collect()
}

/// y += Dᵀ of a column, from T_d = Σ w f e^{−idα}.
fn add_projection(y: &mut [f64], h: &[Complex64], t: &[Complex64]) {
    y[0] += h[0].re * t[0].re;
    for p in 1..h.len().min(t.len()) {
        // Σ w f · 2 Re(H_p e^{ipα}) and Σ w f · (−2 Im(H_p e^{ipα})), with Σ w f e^{ipα} = conj T_p.
        let g = 2.0 * h[p] * t[p].conj();
        y[2 * p - 1] += g.re;
        y[2 * p] -= g.im;
    }
}

/// The sums of some columns. The matrix is kept in four blocks, by whether row p and column q ≤ p belong to a real
/// part or an imaginary one, \[p\]\[q\]: what stands side by side is then computed side by side.
struct Part {
    order: usize,
    real_real: Vec<f64>,
    real_imaginary: Vec<f64>,
    imaginary_real: Vec<f64>,
    imaginary_imaginary: Vec<f64>,
    vector: Vec<f64>,
    square: f64,
    count: usize,
    weight: f64,
    largest: f64,
}

impl Part {
    fn new(order: usize) -> Self {
        let block = vec![0.0; (order + 1) * (order + 1)];
        Self {
            order,
            real_real: block.clone(),
            real_imaginary: block.clone(),
            imaginary_real: block.clone(),
            imaginary_imaginary: block,
            vector: vec![0.0; 2 * order + 1],
            square: 0.0,
            count: 0,
            weight: 0.0,
            largest: 0.0,
        }
    }

    /// Entry of the matrix at i ≥ j, by the unknowns' positions.
    fn entry(&self, i: usize, j: usize) -> f64 {
        let at = i.div_ceil(2) * (self.order + 1) + j.div_ceil(2);
        let imaginary = |i: usize| i > 0 && i.is_multiple_of(2);
        match (imaginary(i), imaginary(j)) {
            (false, false) => self.real_real[at],
            (false, true) => self.real_imaginary[at],
            (true, false) => self.imaginary_real[at],
            (true, true) => self.imaginary_imaginary[at],
        }
    }

    fn merge(&mut self, other: &Self) {
        for (all, more) in [
            (&mut self.real_real, &other.real_real),
            (&mut self.real_imaginary, &other.real_imaginary),
            (&mut self.imaginary_real, &other.imaginary_real),
            (&mut self.imaginary_imaginary, &other.imaginary_imaginary),
        ] {
            for (a, b) in all.iter_mut().zip(more) {
                *a += b;
            }
        }
        for (a, b) in self.vector.iter_mut().zip(&other.vector) {
            *a += b;
        }
        self.square += other.square;
        self.count += other.count;
        self.weight += other.weight;
        self.largest = self.largest.max(other.largest);
    }

    fn add(
        &mut self,
        column: &Column,
        turns: &Turns,
        channel: usize,
        weights: &[f64],
        h: &[Complex64],
    ) {
        let order = self.order;
        let mut weighted = vec![0.0; weights.len()];
        for ((out, &w), &b) in weighted.iter_mut().zip(weights).zip(&column.value[channel]) {
            if w > 0.0 {
                *out = w * b;
                self.square += w * b * b;
                self.count += 1;
                self.weight += w;
                self.largest = self.largest.max(b.abs());
            }
        }
        // S_d = Σ w e^{idα}; real and imaginary parts apart, and once more backwards from the order, so that all
        // that a row needs runs forwards.
        let both = turns.sums(column, &[&weighted, weights], 2 * order);
        let [of_values, sums] = both.as_slice() else {
            return;
        };
        add_projection(&mut self.vector, h, of_values);
        pulp::Arch::new().dispatch(AddSquares {
            part: self,
            h,
            sums,
        });
    }
}

/// Adds a column's Σ w G_p G_q to the matrix, for the processor's widest instructions.
struct AddSquares<'a> {
    part: &'a mut Part,
    h: &'a [Complex64],
    sums: &'a [Complex64],
}

impl pulp::NullaryFnOnce for AddSquares<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { part, h, sums } = self;
        let order = part.order;
        let s: [Vec<f64>; 2] = [
            sums.iter().map(|s| s.re).collect(),
            sums.iter().map(|s| -s.im).collect(),
        ];
        let back =
            [0, 1].map(|k: usize| s[k][..=order].iter().rev().copied().collect::<Vec<f64>>());
        let parts: [Vec<f64>; 2] = [
            h.iter().map(|h| h.re).collect(),
            h.iter().map(|h| h.im).collect(),
        ];
        let h0 = h[0].re;
        part.real_real[0] += h0 * h0 * s[0][0];
        for p in 1..=order {
            let start = p * (order + 1);
            let (re, im) = (h[p].re, h[p].im);
            part.real_real[start] += 2.0 * h0 * (re * s[0][p] - im * s[1][p]);
            part.imaginary_real[start] -= 2.0 * h0 * (re * s[1][p] + im * s[0][p]);
            let (hr, hi) = (&parts[0][1..=p], &parts[1][1..=p]);
            let (dr, di) = (&back[0][order - p + 1..], &back[1][order - p + 1..]);
            let (sr, si) = (&s[0][p + 1..=2 * p], &s[1][p + 1..=2 * p]);
            let (dr, di) = (&dr[..p], &di[..p]);
            let row = start + 1..start + 1 + p;
            let rr = &mut part.real_real[row.clone()];
            let ri = &mut part.real_imaginary[row.clone()];
            let ir = &mut part.imaginary_real[row.clone()];
            let ii = &mut part.imaginary_imaginary[row];
            for q in 0..p {
                // Σ w G_p conj(G_q) and Σ w G_p G_q with G_p = H_p e^{ipα}.
                let (x, y) = (re * dr[q] - im * di[q], re * di[q] + im * dr[q]);
                let difference = (x * hr[q] + y * hi[q], y * hr[q] - x * hi[q]);
                let (x, y) = (re * sr[q] - im * si[q], re * si[q] + im * sr[q]);
                let sum = (x * hr[q] - y * hi[q], x * hi[q] + y * hr[q]);
                rr[q] += 2.0 * (difference.0 + sum.0);
                ri[q] += 2.0 * (difference.1 - sum.1);
                ir[q] -= 2.0 * (difference.1 + sum.1);
                ii[q] += 2.0 * (difference.0 - sum.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;
    use crate::grid::Grid;

    #[derive(Debug)]
    struct Lobe;

    impl Brdf for Lobe {
        fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
            if !incident.is_visible() || !exitant.is_visible() {
                return 0.0;
            }
            0.1 + (-20.0 * (incident.rad() + exitant.rad()).powi(2)).exp() + 0.05 * incident.rad()
        }

        fn lobe_width(&self) -> f64 {
            0.2
        }
    }

    /// The dense design matrix, row by row: the oracle.
    fn dense(samples: &Samples, transfer: &[Vec<Complex64>], order: usize) -> (Mat<f64>, Vec<f64>) {
        let n = 2 * order + 1;
        let mut matrix = Mat::zeros(n, n);
        let mut vector = vec![0.0; n];
        for (column, h) in samples.columns.iter().zip(transfer) {
            for i in 0..column.alpha.len() {
                let w = weight(column.variance[0][i]);
                let mut row = vec![h[0].re];
                for (p, h) in h.iter().enumerate().skip(1) {
                    let g = h * Complex64::cis(p as f64 * column.alpha[i]);
                    row.push(2.0 * g.re);
                    row.push(-2.0 * g.im);
                }
                for a in 0..n {
                    for b in 0..n {
                        matrix[(a, b)] += w * row[a] * row[b];
                    }
                    if w > 0.0 {
                        vector[a] += w * row[a] * column.value[0][i];
                    }
                }
            }
        }
        (matrix, vector)
    }

    fn irregular(regular: bool) -> Samples {
        let grid = Grid {
            normals: 24,
            locals: 14,
        };
        let value: Vec<f64> = (0..grid.len())
            .map(|k| ((k * k) as f64 * 0.37).sin() + 1.0)
            .collect();
        let variance: Vec<f64> = (0..grid.len())
            .map(|k| {
                if k % 7 == 3 {
                    f64::INFINITY
                } else {
                    0.5 + (k % 5) as f64
                }
            })
            .collect();
        let mut samples = Samples::from_grid(grid, vec!["Y".into()], &[value], &[variance]);
        if !regular {
            for (j, column) in samples.columns.iter_mut().enumerate() {
                for (i, a) in column.alpha.iter_mut().enumerate() {
                    *a += 0.01 * ((i * 13 + j) as f64).sin();
                }
            }
        }
        samples
    }

    #[test]
    fn the_structured_matrix_equals_the_dense_one() {
        for regular in [true, false] {
            let samples = irregular(regular);
            let order = 9;
            let system = NormalSystem::new(&samples, 0, &Lobe, order);
            let (matrix, vector) = dense(&samples, &system.transfer, order);
            // Rounding of sums of about 300 terms of the matrix's largest size.
            let size = matrix[(0, 0)].abs() * 1e-12;
            for a in 0..2 * order + 1 {
                for b in 0..2 * order + 1 {
                    assert!(
                        (matrix[(a, b)] - system.matrix[(a, b)]).abs() < size,
                        "{a} {b}"
                    );
                }
                assert!((vector[a] - system.vector[a]).abs() < size);
            }
        }
    }

    #[test]
    fn predictions_are_the_adjoint_of_projections() {
        let samples = irregular(false);
        let system = NormalSystem::new(&samples, 0, &Lobe, 6);
        let x: Vec<f64> = (0..13).map(|k| (k as f64 * 1.3).cos()).collect();
        let predicted = system.predict(&to_series(&x));
        // D x projected is A x.
        let projected = system.project(&samples, &predicted);
        for (a, projected) in projected.iter().enumerate() {
            let ax: f64 = (0..13).map(|b| system.matrix[(a, b)] * x[b]).sum();
            assert!((ax - projected).abs() < 1e-9 * system.matrix[(0, 0)]);
        }
    }
}
