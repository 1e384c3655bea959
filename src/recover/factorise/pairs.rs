//! Reciprocity as independent pairs: the light field in the basis in which the symmetric unknown
//! decouples, given a lighting.

use faer::{Mat, Scale};

use super::columns::Spectrum;
use super::half_circle::HalfCircle;
use crate::error::{Error, Result};
use crate::fourier::Series;

/// The whitened problem B′ = A′ Y + unit noise, with Y symmetric, common to all lightings.
///
/// The variance of B_p(θo′_k) is taken as g_p / f_k, the best product of that form. Column k of B′ is √f_k G^{−½} B(θo′_k) with
/// G = diag(g); Y = D^½ ρ̃ D^½ with D_k = f_k / cos² θ_k; and A′(L) = G^{−½} diag(L) E D^{−½} with E the exponentials
/// on the half circle.
#[derive(Clone, Debug)]
pub(super) struct Whitened {
    /// The frequencies whose rows are in the problem, increasing, the first 0: m = 2 · count − 1.
    pub frequencies: Vec<usize>,
    /// B′, m × N.
    pub data: Mat<f64>,
    /// G^{−½} E D^{−½}, m × N.
    pub exponentials: Mat<f64>,
    /// D_k^½, \[N\].
    pub root: Vec<f64>,
    /// f_k, \[N\].
    pub precision: Vec<f64>,
    /// g_p^{−½} of every frequency up to the spectrum's order, \[P + 1\].
    pub weight: Vec<f64>,
    /// What each error that all samples share does to B′ if it is one standard deviation, m × N.
    pub changes: Vec<Mat<f64>>,
}

impl Whitened {
    /// The rows of `frequencies` (increasing, the first 0), whitened by the spectrum's variances.
    ///
    /// Leaving a frequency out loses what it tells and biases nothing: B_p depends on no other L_q.
    pub fn new(spectrum: &Spectrum, half: &HalfCircle, frequencies: &[usize]) -> Self {
        let (precision, weight) = as_product(spectrum);
        let root: Vec<f64> = precision
            .iter()
            .zip(&half.cosines)
            .map(|(f, c)| f.sqrt() / c)
            .collect();
        let plain = half.exponentials(spectrum.order);
        let rows = rows_of(frequencies);
        let whitened = |values: &Mat<f64>| {
            Mat::from_fn(rows.len(), half.len(), |i, k| {
                weight[rows[i].div_ceil(2)] * precision[k].sqrt() * values[(rows[i], k)]
            })
        };
        Self {
            frequencies: frequencies.to_vec(),
            data: whitened(&spectrum.values),
            changes: spectrum.changes.iter().map(whitened).collect(),
            exponentials: Mat::from_fn(rows.len(), half.len(), |i, k| {
                weight[rows[i].div_ceil(2)] * plain[(rows[i], k)] / root[k]
            }),
            root,
            precision,
            weight,
        }
    }

    /// The same problem for Y = V Y′ Vᵀ with orthonormal columns V, N × n; `root` and `precision` stay those of the nodes.
    pub fn within(&self, v: &Mat<f64>) -> Self {
        Self {
            data: &self.data * v,
            exponentials: &self.exponentials * v,
            changes: self.changes.iter().map(|c| c * v).collect(),
            ..self.clone()
        }
    }

    /// A′ for a lighting: the rows of p turned and scaled by L_p.
    pub fn operator(&self, lighting: &Series) -> Mat<f64> {
        let e = &self.exponentials;
        let mut a = Mat::zeros(e.nrows(), e.ncols());
        for k in 0..e.ncols() {
            a[(0, k)] = lighting.get(0).re * e[(0, k)];
            for (i, &p) in self.frequencies.iter().enumerate().skip(1) {
                let l = lighting.get(p as i64);
                let (re, im) = (e[(2 * i - 1, k)], e[(2 * i, k)]);
                a[(2 * i - 1, k)] = l.re * re - l.im * im;
                a[(2 * i, k)] = l.im * re + l.re * im;
            }
        }
        a
    }
}

/// f_k and g_p^{−½} with g_p / f_k nearest to the variance of B_p at node k, by turns in the relative error; the nodes
/// that were not seen have no say in g.
fn as_product(spectrum: &Spectrum) -> (Vec<f64>, Vec<f64>) {
    const TURNS: usize = 4;
    let (nodes, order) = (spectrum.seen.len(), spectrum.order);
    let seen: Vec<usize> = (0..nodes).filter(|&k| spectrum.seen[k]).collect();
    let mut of_frequency = vec![1.0; order + 1];
    let mut of_node = vec![f64::MIN_POSITIVE; nodes];
    for turn in 0..=TURNS {
        for (k, v) in of_node.iter_mut().enumerate() {
            let sum: f64 = (0..=order)
                .map(|p| if p == 0 { 1.0 } else { 2.0 } * spectrum.variance(p, k) / of_frequency[p])
                .sum();
            *v = (sum / (2 * order + 1) as f64).max(f64::MIN_POSITIVE);
        }
        if turn < TURNS {
            for (p, v) in of_frequency.iter_mut().enumerate() {
                let sum: f64 = seen
                    .iter()
                    .map(|&k| spectrum.variance(p, k) / of_node[k])
                    .sum();
                *v = sum / seen.len().max(1) as f64;
            }
        }
    }
    (
        of_node.iter().map(|v| 1.0 / v).collect(),
        of_frequency
            .iter()
            .map(|v| 1.0 / v.max(f64::MIN_POSITIVE).sqrt())
            .collect(),
    )
}

/// Where the coefficients of `frequencies` stand in the real basis.
pub(super) fn rows_of(frequencies: &[usize]) -> Vec<usize> {
    frequencies
        .iter()
        .flat_map(|&p| if p == 0 { 0..1 } else { 2 * p - 1..2 * p + 1 })
        .collect()
}

/// The problem for one lighting, in the basis of A′ = Q S Uᵀ: with B″ = Qᵀ B′ U and Z = Uᵀ Y U the model is
/// B″ = S Z, and the two entries B″_ab and B″_ba see the one unknown z_ab = z_ba through s_a and s_b.
#[derive(Clone, Debug)]
pub(super) struct Pairs {
    /// Q, m × m.
    pub q: Mat<f64>,
    /// Singular values in decreasing order, padded with zeros to the larger of m and N.
    pub s: Vec<f64>,
    /// U, N × N.
    pub u: Mat<f64>,
    /// B″, m × N.
    pub data: Mat<f64>,
    /// The pairs that both sides see above rounding.
    pub constraints: Vec<Constraint>,
}

/// Singular values below this times the largest are rounding, and so are their vectors.
const ROUNDING: f64 = 1e-9;

/// One constraint: entry (a, b), a > b, across the model: `cb` B″_ab − `ca` B″_ba = noise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constraint {
    /// Row in Q, and column in U of the mirrored entry.
    pub a: usize,
    /// Column in U, and row in Q of the mirrored entry.
    pub b: usize,
    /// s_a / |s|; 0 beyond the half circle's rank, where there is no mirrored entry.
    pub ca: f64,
    /// s_b / |s|.
    pub cb: f64,
}

impl Constraint {
    /// The value across the model of an m × N matrix of entries (the data, or a change of the model).
    pub fn of(&self, entry: impl Fn(usize, usize) -> f64) -> f64 {
        let own = self.cb * entry(self.a, self.b);
        if self.ca == 0.0 {
            own
        } else {
            own - self.ca * entry(self.b, self.a)
        }
    }
}

impl Pairs {
    /// Decomposes A′ of `lighting`; the data are those without `systematics` standard deviations of the errors that all samples
    /// share (none for those beyond its length).
    pub fn new(whitened: &Whitened, lighting: &Series, systematics: &[f64]) -> Result<Self> {
        let a = whitened.operator(lighting);
        let svd = a.svd().map_err(|_| {
            Error::failed(
                "the singular value decomposition of the light field's operator did not converge",
            )
        })?;
        let mut s: Vec<f64> = svd.S().column_vector().iter().copied().collect();
        s.resize(a.nrows().max(a.ncols()), 0.0);
        let (q, u) = (svd.U().to_owned(), svd.V().to_owned());
        let mut data = whitened.data.clone();
        for (change, f) in whitened.changes.iter().zip(systematics) {
            data -= change * Scale(*f);
        }
        let data = q.transpose() * data * &u;
        let mut pairs = Self {
            q,
            s,
            u,
            data,
            constraints: Vec::new(),
        };
        for a in 0..pairs.rows() {
            for b in 0..a.min(pairs.nodes()) {
                let (ca, cb, size) = pairs.gain(a, b);
                if size > 0.0 {
                    pairs.constraints.push(Constraint { a, b, ca, cb });
                }
            }
        }
        Ok(pairs)
    }

    /// m: real coefficients per column.
    pub fn rows(&self) -> usize {
        self.q.nrows()
    }

    /// N: nodes of the half circle.
    pub fn nodes(&self) -> usize {
        self.u.nrows()
    }

    /// cos and sin of the angle of pair (a, b): (s_a, s_b) / |s|, and |s|. All 0 where both sides see less than rounding
    /// lets tell: such a pair says nothing.
    pub fn gain(&self, a: usize, b: usize) -> (f64, f64, f64) {
        let size = self.s[a].hypot(self.s[b]);
        if size > ROUNDING * self.s[0] {
            (self.s[a] / size, self.s[b] / size, size)
        } else {
            (0.0, 0.0, 0.0)
        }
    }

    /// What the data say across the model, one value per constraint: zero but for noise of unit variance.
    pub fn across(&self) -> Vec<f64> {
        self.constraints
            .iter()
            .map(|c| c.of(|a, b| self.data[(a, b)]))
            .collect()
    }

    /// What the data say along the model: |s| z_ab plus noise of unit variance; N × N, symmetric. Zero
    /// where neither side sees the unknown. `entries` is the m × N matrix to take it from (the data, or a change
    /// of the model).
    pub fn along(&self, entries: &Mat<f64>) -> Mat<f64> {
        let (m, n) = (self.rows(), self.nodes());
        let mut y = Mat::zeros(n, n);
        for a in 0..m.min(n) {
            y[(a, a)] = entries[(a, a)];
            for b in 0..a {
                let (ca, cb, _) = self.gain(a, b);
                y[(a, b)] = ca * entries[(a, b)] + cb * entries[(b, a)];
                y[(b, a)] = y[(a, b)];
            }
            for b in m.min(n)..n {
                y[(a, b)] = entries[(a, b)];
                y[(b, a)] = y[(a, b)];
            }
        }
        y
    }

    /// |s| of entry (a, b) of [`along`](Self::along): s_a itself on the diagonal.
    pub fn strength(&self, a: usize, b: usize) -> f64 {
        if a == b {
            self.s[a]
        } else {
            self.s[a].hypot(self.s[b])
        }
    }

    /// Sum of squares of all constraints, and their number.
    pub fn misfit(&self) -> (f64, usize) {
        let across = self.across();
        (across.iter().map(|r| r * r).sum(), across.len())
    }

    /// Root of what the pairs hold across the model beyond the noise, relative to what they hold along it: the part of the light field
    /// that no light and no reciprocal BRDF explain. `free` is the number of parameters that were fitted. 0 where it is within four
    /// standard deviations of the noise's own scatter.
    pub fn violation(&self, free: usize) -> f64 {
        let (across, count) = self.misfit();
        let expected = count.saturating_sub(free) as f64;
        if across <= expected + 4.0 * (2.0 * expected).sqrt() {
            return 0.0;
        }
        let along = self.along(&self.data);
        let total: f64 = (0..along.ncols())
            .flat_map(|b| (b..along.nrows()).map(move |a| (a, b)))
            .map(|(a, b)| along[(a, b)].powi(2))
            .sum();
        ((across - expected) / total.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Derivative of every constraint by Re L_p, Im L_p of every frequency but L_0, which is held, and by the errors that
    /// all samples share: constraints × (m − 1 + errors).
    pub fn jacobian(&self, whitened: &Whitened, unknown: &Mat<f64>) -> Mat<f64> {
        // H′ = E D^{−½} Y in the basis U on the right: what a unit of L_p adds to row p of B′.
        let response = &whitened.exponentials * &self.u * unknown;
        let m = self.rows();
        let mut jacobian = Mat::zeros(self.constraints.len(), m - 1 + whitened.changes.len());
        for column in 0..m - 1 {
            let (re, im) = (2 * (column / 2) + 1, 2 * (column / 2) + 2);
            // i · (x + iy) = −y + ix.
            let (first, second, sign) = if column % 2 == 0 {
                (re, im, 1.0)
            } else {
                (im, re, -1.0)
            };
            let row = |matrix: &Mat<f64>, i: usize| -> Vec<f64> {
                (0..matrix.ncols()).map(|j| matrix[(i, j)]).collect()
            };
            let (q_re, q_im) = (row(&self.q, re), row(&self.q, im));
            let (h_first, h_second) = (row(&response, first), row(&response, second));
            let change = |a: usize, b: usize| sign * q_re[a] * h_first[b] + q_im[a] * h_second[b];
            for (row, constraint) in self.constraints.iter().enumerate() {
                jacobian[(row, column)] = constraint.of(change);
            }
        }
        for (s, change) in whitened.changes.iter().enumerate() {
            let entries = self.q.transpose() * change * &self.u;
            for (row, constraint) in self.constraints.iter().enumerate() {
                jacobian[(row, m - 1 + s)] = constraint.of(|a, b| entries[(a, b)]);
            }
        }
        jacobian
    }
}
