//! What the samples say about the spline coefficients: rows of the model, and their Gram matrices.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::OnceLock;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use rayon::prelude::*;

use super::basis::{Basis, END_SHAPES};
use super::prior::Factor;
use super::space::Space;
use crate::Result;
use crate::angle::{WorldAngle, wrap};
use crate::light_field::{Column, Samples, Systematic};
use crate::lighting::Lighting;

/// Points of the circle on which the smooth light's convolution with a spline is tabulated. Between
/// them it is interpolated linearly; at 0.044° the error is below (2π/8192)²/8 · 4/h² = 1e-3 of a delta
/// function's response at h = 1°, and a thousand times less for light as smooth as its own table.
const CIRCLE: usize = 8192;

/// The light of one channel as seen through the splines: ∫ L(α + θ) φ_m(θ) dθ.
pub struct Illumination {
    basis: Basis,
    /// (direction, irradiance).
    sources: Vec<(f64, f64)>,
    /// ∫ L(x + θ) φ(θ) dθ at x = −π + 2πi/CIRCLE for the shapes of spline there are: those at the left
    /// end, the inner one (about its own centre), those at the right end. Empty without smooth light.
    smooth: Vec<Vec<f64>>,
}

impl Illumination {
    /// The light of `channel` of `lighting`.
    pub fn new(basis: Basis, lighting: &Lighting, channel: usize) -> Self {
        let sources = lighting
            .sources
            .iter()
            .filter_map(|s| Some((s.theta.rad(), *s.irradiance.get(channel)?)))
            .collect();
        let has_smooth = lighting
            .table
            .get(channel)
            .is_some_and(|t| t.iter().any(|&v| v != 0.0))
            || lighting.smooth.get(channel).is_some_and(|s| s.norm() > 0.0);
        let mut smooth = Vec::new();
        if has_smooth {
            let step = TAU / CIRCLE as f64;
            let light: Vec<f64> = (0..CIRCLE)
                .map(|i| lighting.density(channel, WorldAngle::radians(-PI + i as f64 * step)))
                .collect();
            let last = basis.len() - 1;
            let ends = (0..END_SHAPES)
                .chain([last / 2])
                .chain(last + 1 - END_SHAPES..=last);
            for m in ends {
                let centre = if m == last / 2 { basis.centre(m) } else { 0.0 };
                // Trapezoidal sum: the spline has two derivatives, so its error is far below that of the
                // interpolation. The spline is sampled relative to a point of the circle's grid.
                let reach = (3.5 * basis.spacing() / step).ceil() as isize + 1;
                let middle = ((basis.centre(m) - centre) / step).round() as isize;
                let taps: Vec<(isize, f64)> = (middle - reach..=middle + reach)
                    .filter_map(|k| {
                        let angle = centre + k as f64 * step;
                        let value: f64 = basis
                            .at(angle)
                            .iter()
                            .filter(|&(i, _)| i == m)
                            .map(|(_, v)| v)
                            .sum();
                        (value != 0.0).then_some((k, value * step))
                    })
                    .collect();
                smooth.push(
                    (0..CIRCLE as isize)
                        .into_par_iter()
                        .map(|i| {
                            taps.iter()
                                .map(|&(k, v)| {
                                    v * light[(i + k).rem_euclid(CIRCLE as isize) as usize]
                                })
                                .sum()
                        })
                        .collect(),
                );
            }
        }
        Self {
            basis,
            sources,
            smooth,
        }
    }

    /// Whether there is any light at all.
    pub fn is_dark(&self) -> bool {
        self.smooth.is_empty() && self.sources.iter().all(|s| s.1 == 0.0)
    }

    /// Adds `factor` · ∫ L(α + θ) φ_m(θ) dθ to `row`\[m\].
    pub fn add_row(&self, alpha: f64, factor: f64, row: &mut [f64]) {
        for &(theta, irradiance) in &self.sources {
            for (m, value) in self.basis.at(wrap(theta - alpha)).iter() {
                row[m] += factor * irradiance * value;
            }
        }
        if self.smooth.is_empty() {
            return;
        }
        let alpha = wrap(alpha);
        let last = self.basis.len() - 1;
        for (m, entry) in row.iter_mut().enumerate() {
            let (shape, shift) = if m < END_SHAPES {
                (m, 0.0)
            } else if m + END_SHAPES > last {
                (m + 2 * END_SHAPES - last, 0.0)
            } else {
                (END_SHAPES, self.basis.centre(m))
            };
            // Within one turn of the circle: sooner done than by the remainder of a division.
            let mut angle = alpha + shift;
            if angle < -PI {
                angle += TAU;
            } else if angle >= PI {
                angle -= TAU;
            }
            let position = (angle + PI) / TAU * CIRCLE as f64;
            let i = position as usize;
            let t = position - i as f64;
            let table = &self.smooth[shape];
            *entry += factor * (table[i % CIRCLE] * (1.0 - t) + table[(i + 1) % CIRCLE] * t);
        }
    }
}

/// The samples of one column θo′ reduced to its normal equations for the vector z_m = Σ_n c_{mn} φ_n(θo′).
pub struct ColumnInformation {
    /// θo′, radians.
    pub local: f64,
    /// Σ a aᵀ / σ², \[len\]\[len\].
    pub gram: Mat<f64>,
    /// Σ a y / σ².
    pub rhs: Vec<f64>,
    /// Σ a f / σ² of each systematic error f, \[len\]\[error\].
    cross: Mat<f64>,
    /// z = B x.
    touched: Touched,
}

/// What one column has to say of the systematic errors f themselves.
struct Shared {
    /// Σ f fᵀ / σ².
    gram: Mat<f64>,
    /// Σ f y / σ².
    rhs: Vec<f64>,
}

/// The systematic errors that all samples share, each with a normal prior of one standard deviation.
struct Coupling {
    /// Σ a f / σ² for the unknowns, \[unknown\]\[error\].
    cross: Mat<f64>,
    /// Σ f fᵀ / σ².
    gram: Mat<f64>,
    /// Σ f y / σ².
    rhs: Vec<f64>,
}

/// Normal equations of the unknowns.
pub struct Equations {
    /// Information matrix J.
    pub matrix: Mat<f64>,
    /// Right side h.
    pub right_side: Vec<f64>,
    /// Square of the samples in the metric of their covariance: χ²(c) = square − 2 hᵀc + cᵀJc.
    pub square: f64,
}

/// All columns of one channel.
pub struct Information {
    /// What the unknowns are.
    pub space: Space,
    /// Columns that hold a sample.
    pub columns: Vec<ColumnInformation>,
    /// Number of samples.
    pub count: usize,
    /// Σ y²/σ².
    square: f64,
    /// `None` without systematic errors.
    coupling: Option<Coupling>,
    /// The information matrix of independent samples, once it was asked for.
    independent: OnceLock<Mat<f64>>,
}

impl Information {
    /// Reduces `channel` of the samples to equations in `space`, through whose splines the light must have been seen. Samples with a variance that is not finite and positive, a value
    /// that is not finite, or θo′ beyond the half circle have no part in it. A systematic error must be of these
    /// samples.
    pub fn new(
        samples: &Samples,
        channel: usize,
        systematics: &[Systematic],
        light: &Illumination,
        space: Space,
    ) -> Self {
        let reduced: Vec<_> = samples
            .columns
            .par_iter()
            .enumerate()
            .filter_map(|(j, column)| {
                let own = of_column(systematics, channel, j);
                reduce(column, channel, &own, light, &space)
            })
            .collect();
        let errors = of_column(systematics, channel, 0).len();
        let mut information = Self {
            space,
            columns: Vec::with_capacity(reduced.len()),
            count: 0,
            square: 0.0,
            coupling: None,
            independent: OnceLock::new(),
        };
        let mut shared = Shared {
            gram: Mat::zeros(errors, errors),
            rhs: vec![0.0; errors],
        };
        for part in reduced {
            information.columns.push(part.column);
            information.count += part.count;
            information.square += part.square;
            shared.gram += part.shared.gram;
            for (sum, own) in shared.rhs.iter_mut().zip(part.shared.rhs) {
                *sum += own;
            }
        }
        if errors > 0 {
            let mut cross = Mat::zeros(information.space.len(), errors);
            for column in &information.columns {
                column.touched.add(&column.cross, &mut cross);
            }
            information.coupling = Some(Coupling {
                cross,
                gram: shared.gram,
                rhs: shared.rhs,
            });
        }
        information
    }

    /// The normal equations if all variances of the samples are `noise` times what they say. Systematic errors f have
    /// been integrated out: the samples' covariance is noise·W⁻¹ + Σ f fᵀ, inverted by Woodbury's identity.
    ///
    /// # Errors
    /// If the systematic errors are not finite.
    pub fn equations(&self, noise: f64) -> Result<Equations> {
        let mut equations = Equations {
            matrix: faer::Scale(1.0 / noise) * self.independent.get_or_init(|| self.dense()),
            right_side: self.right_side().iter().map(|h| h / noise).collect(),
            square: self.square / noise,
        };
        if let Some(coupling) = &self.coupling {
            // L⁻¹ of L Lᵀ = 1 + FᵀWF/noise, applied to what the errors have to do with the rest.
            let factor = coupling.factor(noise)?;
            let mut half = coupling.cross.transpose().to_owned();
            half *= faer::Scale(1.0 / noise);
            factor.half_solve(&mut half);
            let mut target = Mat::from_fn(coupling.rhs.len(), 1, |s, _| coupling.rhs[s] / noise);
            factor.half_solve(&mut target);
            matmul(
                &mut equations.matrix,
                Accum::Add,
                half.transpose(),
                &half,
                -1.0,
                faer::get_global_parallelism(),
            );
            let explained = half.transpose() * &target;
            for (i, h) in equations.right_side.iter_mut().enumerate() {
                *h -= explained[(i, 0)];
            }
            equations.square -= target.squared_norm_l2();
        }
        Ok(equations)
    }

    /// The right side of the equations of independent samples if these were the changes that `of_column` gives of those that are seen, in σ, several at a
    /// time: \[unknown\]\[change\].
    pub fn right_sides(
        &self,
        samples: &Samples,
        channel: usize,
        light: &Illumination,
        noise: f64,
        of_column: impl Fn(usize, &Column, &[Sample]) -> Mat<f64> + Sync,
    ) -> Mat<f64> {
        let parts: Vec<(Touched, Mat<f64>)> = samples
            .columns
            .par_iter()
            .enumerate()
            .filter_map(|(j, column)| {
                let seen = Seen::new(column, channel, light)?;
                let change = of_column(j, column, &seen.samples);
                let touched = Touched::new(column.local.rad(), &self.space);
                Some((touched, &seen.rows * &change))
            })
            .collect();
        let count = parts.first().map_or(0, |p| p.1.ncols());
        let mut sum = Mat::zeros(self.space.len(), count);
        for (touched, column) in &parts {
            touched.add(column, &mut sum);
        }
        sum *= faer::Scale(1.0 / noise);
        sum
    }

    /// χ² of the unknowns `x`, by the variances as given, with the systematic errors that fit best where there are any.
    /// Their own prior counts `noise` times, as if the variances were so many times what they say.
    ///
    /// # Errors
    /// If the systematic errors are not finite.
    pub fn chi_square(&self, x: &[f64], noise: f64) -> Result<f64> {
        let plain = self.plain_chi_square(x);
        let Some(coupling) = &self.coupling else {
            return Ok(plain);
        };
        let errors = coupling.rhs.len();
        let mut left = Mat::from_fn(errors, 1, |s, _| {
            let explained: f64 = coupling
                .cross
                .col(s)
                .iter()
                .zip(x)
                .map(|(c, x)| c * x)
                .sum();
            (coupling.rhs[s] - explained) / noise
        });
        coupling.factor(noise)?.half_solve(&mut left);
        Ok((plain - noise * left.squared_norm_l2()).max(0.0))
    }

    /// Σ residual²/σ² of the unknowns `x`.
    fn plain_chi_square(&self, x: &[f64]) -> f64 {
        let basis = self.space.basis();
        let (len, c) = (basis.len(), self.space.coefficients(x));
        let mut sum = self.square;
        for column in &self.columns {
            let mut z = vec![0.0; len];
            for (n, value) in basis.at(column.local).iter() {
                for (m, z) in z.iter_mut().enumerate() {
                    *z += value * c[basis.pair(m, n)];
                }
            }
            for j in 0..len {
                let g = column.gram.col(j);
                let product: f64 = z.iter().enumerate().map(|(i, z)| z * g[i]).sum();
                sum += z[j] * (product - 2.0 * column.rhs[j]);
            }
        }
        sum.max(0.0)
    }

    /// The right side of the normal equations, of independent samples.
    fn right_side(&self) -> Vec<f64> {
        let mut out = vec![0.0; self.space.len()];
        for column in &self.columns {
            for (unknown, parts) in column.touched.iter() {
                out[unknown] += parts.iter().map(|&(m, v)| v * column.rhs[m]).sum::<f64>();
            }
        }
        out
    }

    /// The information matrix of independent samples, dense: J = Σ over columns of Bᵀ G B.
    fn dense(&self) -> Mat<f64> {
        let n = self.space.len();
        // Where each unknown is found: column, and number there.
        let mut uses: Vec<Vec<(u32, u32)>> = vec![Vec::new(); n];
        for (c, column) in self.columns.iter().enumerate() {
            for (k, &unknown) in column.touched.unknowns.iter().enumerate() {
                uses[unknown as usize].push((c as u32, k as u32));
            }
        }
        let mut out = Mat::<f64>::zeros(n, n);
        out.par_col_chunks_mut(1)
            .zip(uses.par_iter())
            .for_each(|(mut to, uses)| {
                let Some(to) = to.as_mut().col_mut(0).try_as_col_major_mut() else {
                    return;
                };
                let to = to.as_slice_mut();
                let mut product = vec![0.0; self.space.basis().len()];
                for &(c, k) in uses {
                    let column = &self.columns[c as usize];
                    product.fill(0.0);
                    for &(m, value) in column.touched.parts(k as usize) {
                        for (p, g) in product.iter_mut().zip(column.gram.col(m).iter()) {
                            *p += value * g;
                        }
                    }
                    // From the diagonal down.
                    for i in k as usize..column.touched.unknowns.len() {
                        let parts = column.touched.parts(i).iter();
                        to[column.touched.unknowns[i] as usize] +=
                            parts.map(|&(m, v)| v * product[m]).sum::<f64>();
                    }
                }
            });
        for j in 0..n {
            for i in j + 1..n {
                out[(j, i)] = out[(i, j)];
            }
        }
        out
    }
}

/// A sparse matrix B, the unknowns that show in one column: z = B x.
struct Touched {
    /// In increasing order.
    unknowns: Vec<u32>,
    /// Where each unknown's pairs (m, factor) begin.
    starts: Vec<usize>,
    parts: Vec<(usize, f64)>,
}

impl Touched {
    /// The unknowns that show at θo′ = `local`, radians.
    fn new(local: f64, space: &Space) -> Self {
        let basis = space.basis();
        let splines: Vec<(usize, f64)> = basis.at(local).iter().collect();
        // All that is in z_m, one m after the other.
        let mut found: Vec<(usize, usize, f64)> = Vec::new();
        let mut slot = vec![usize::MAX; space.len()];
        let mut counts = vec![0usize; space.len()];
        for m in 0..basis.len() {
            let from = found.len();
            for &(n, value) in &splines {
                space.each(m, n, |unknown, factor| match found.get_mut(slot[unknown]) {
                    Some(entry) => entry.2 += value * factor,
                    None => {
                        slot[unknown] = found.len();
                        counts[unknown] += 1;
                        found.push((unknown, m, value * factor));
                    }
                });
            }
            for &(unknown, _, _) in &found[from..] {
                slot[unknown] = usize::MAX;
            }
        }
        // Sorted by unknown.
        let mut out = Self {
            unknowns: Vec::new(),
            starts: vec![0],
            parts: vec![(0, 0.0); found.len()],
        };
        let mut sum = 0;
        for (unknown, (&count, slot)) in counts.iter().zip(&mut slot).enumerate() {
            if count > 0 {
                out.unknowns.push(unknown as u32);
                *slot = sum;
                sum += count;
                out.starts.push(sum);
            }
        }
        for (unknown, m, value) in found {
            out.parts[slot[unknown]] = (m, value);
            slot[unknown] += 1;
        }
        out
    }

    /// Pairs (m, factor) of the unknown that is number `k` here.
    fn parts(&self, k: usize) -> &[(usize, f64)] {
        &self.parts[self.starts[k]..self.starts[k + 1]]
    }

    fn iter(&self) -> impl Iterator<Item = (usize, &[(usize, f64)])> {
        let unknowns = self.unknowns.iter().enumerate();
        unknowns.map(|(k, &unknown)| (unknown as usize, self.parts(k)))
    }

    /// Adds Bᵀ `of_column` to `sum`.
    fn add(&self, of_column: &Mat<f64>, sum: &mut Mat<f64>) {
        for (unknown, parts) in self.iter() {
            for &(m, value) in parts {
                for s in 0..of_column.ncols() {
                    sum[(unknown, s)] += value * of_column[(m, s)];
                }
            }
        }
    }
}

impl Coupling {
    fn factor(&self, noise: f64) -> Result<Factor> {
        let mut matrix = faer::Scale(1.0 / noise) * &self.gram;
        for s in 0..matrix.nrows() {
            matrix[(s, s)] += 1.0;
        }
        Factor::new(&matrix)
    }
}

/// One column's part of [`Information`].
struct Reduced {
    column: ColumnInformation,
    shared: Shared,
    count: usize,
    square: f64,
}

/// One usable sample of a column.
pub struct Sample {
    /// Its number in the column.
    number: usize,
    /// α, radians.
    pub alpha: f64,
    /// B.
    value: f64,
    /// 1/σ.
    pub root: f64,
}

/// What the light shows of the splines to the samples of one column.
struct Seen {
    /// Those that are usable.
    samples: Vec<Sample>,
    /// a/σ, \[len\]\[sample\].
    rows: Mat<f64>,
}

impl Seen {
    /// `None` if no sample is usable.
    fn new(column: &Column, channel: usize, light: &Illumination) -> Option<Self> {
        let local = column.local.rad();
        // Below 1e-6 rad from the horizon the division by the cosine has no meaning.
        if local.is_nan() || local.abs() > FRAC_PI_2 - 1e-6 {
            return None;
        }
        let (values, variances) = (column.value.get(channel)?, column.variance.get(channel)?);
        let samples: Vec<Sample> = column
            .alpha
            .iter()
            .zip(values.iter().zip(variances))
            .enumerate()
            .filter(|(_, (a, (y, v)))| a.is_finite() && y.is_finite() && v.is_finite() && **v > 0.0)
            .map(|(number, (&alpha, (&value, &v)))| Sample {
                number,
                alpha,
                value,
                root: 1.0 / v.sqrt(),
            })
            .collect();
        if samples.is_empty() {
            return None;
        }
        // B cos θo′ = Σ E ρ̃ + …, so a row of B carries 1/cos θo′.
        let cosine = local.cos();
        let mut rows = Mat::<f64>::zeros(light.basis.len(), samples.len());
        for (i, sample) in samples.iter().enumerate() {
            let row = rows.col_mut(i).try_as_col_major_mut()?.as_slice_mut();
            light.add_row(sample.alpha, sample.root / cosine, row);
        }
        Some(Self { samples, rows })
    }
}

/// What each systematic error does to all samples of column `j`.
fn of_column(systematics: &[Systematic], channel: usize, j: usize) -> Vec<&[f64]> {
    let changes = systematics.iter().filter_map(|s| s.change.get(channel));
    changes
        .map(|c| c.get(j).map_or(&[][..], Vec::as_slice))
        .collect()
}

/// What each systematic error does to the `samples` of one column, in σ: \[sample\]\[error\]; `changes` are those of all its samples.
pub fn changed(samples: &[Sample], changes: &[&[f64]]) -> Mat<f64> {
    Mat::from_fn(samples.len(), changes.len(), |i, s| {
        let change = changes[s].get(samples[i].number).copied().unwrap_or(0.0);
        // A slope that could not be told says nothing.
        if change.is_finite() {
            change * samples[i].root
        } else {
            0.0
        }
    })
}

fn reduce(
    column: &Column,
    channel: usize,
    changes: &[&[f64]],
    light: &Illumination,
    space: &Space,
) -> Option<Reduced> {
    let local = column.local.rad();
    let Seen { samples, rows } = Seen::new(column, channel, light)?;
    let len = light.basis.len();
    let mut rhs = vec![0.0; len];
    let mut square = 0.0;
    for (i, sample) in samples.iter().enumerate() {
        for (r, a) in rhs.iter_mut().zip(rows.col(i).iter()) {
            *r += a * sample.value * sample.root;
        }
        square += (sample.value * sample.root).powi(2);
    }
    let mut gram = Mat::<f64>::zeros(len, len);
    matmul(
        &mut gram,
        Accum::Replace,
        &rows,
        rows.transpose(),
        1.0,
        Par::Seq,
    );
    let f = changed(&samples, changes);
    let shared = Shared {
        gram: f.transpose() * &f,
        rhs: (0..changes.len())
            .map(|s| {
                f.col(s)
                    .iter()
                    .zip(&samples)
                    .map(|(f, sample)| f * sample.value * sample.root)
                    .sum()
            })
            .collect(),
    };
    let cross = &rows * &f;
    Some(Reduced {
        column: ColumnInformation {
            local,
            gram,
            rhs,
            cross,
            touched: Touched::new(local, space),
        },
        shared,
        count: samples.len(),
        square,
    })
}
