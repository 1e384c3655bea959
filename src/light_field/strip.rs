//! The measured line of a view as stations, one per pixel along it, with several rows averaged.
//!
//! Away from the cross-section radiance changes with the square of the distance: on a cylinder because
//! the view direction leaves the plane, on a sphere because the normal does. Each station is therefore
//! fitted across the line by 1, t and t² and read at t = 0; a plain mean would be off by up to 0.1 %, and an
//! image of even height has no row on the cross-section at all.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::dust;
use crate::radiance::{Radiance, shared_rounding_of};

/// Radiance at each pixel step along the measured line.
#[derive(Clone, Debug, PartialEq)]
pub struct Stations {
    /// Radiance on the cross-section, \[channel\]\[station\].
    pub value: Vec<Vec<f64>>,
    /// Its variance, \[channel\]\[station\]; infinite if no pixel of it was usable.
    pub variance: Vec<Vec<f64>>,
    /// Number of pixels averaged, \[station\].
    pub pixels: Vec<u32>,
}

impl Stations {
    /// So many stations of which nothing was seen.
    fn unseen(count: usize, channels: usize) -> Self {
        Self {
            value: vec![vec![0.0; count]; channels],
            variance: vec![vec![f64::INFINITY; count]; channels],
            pixels: vec![0; count],
        }
    }

    /// Number of stations.
    pub fn count(&self) -> usize {
        self.pixels.len()
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.value.len()
    }
}

/// Stations on both sides over which the scatter of rows is pooled where no noise model is stated.
const POOL: usize = 12;
/// Largest variance of a station in units of that of one of its pixels. Beyond, the rows that are left, as of a station of which most is clipped, lie to
/// one side of the line, and what a parabola makes of them there is no measurement.
const FARTHEST: f64 = 1.5;
/// Least part of a term of a fit in two directions that the other terms must not have, for its factor to be known; a station with all its
/// pixels has a half and more.
const LEAST_OWN: f64 = 0.02;
/// Variance of a position within a pixel of width 1.
pub(super) const PIXEL_VARIANCE: f64 = 1.0 / 12.0;
/// Variance of the places along the line by which [`along_line`] weights pixels: that of a hat one pixel to each side.
pub(super) const HAT_VARIANCE: f64 = 1.0 / 6.0;

/// Sums over the rows of one station and channel.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    pub count: u32,
    /// Σ t^k, k = 0 … 4.
    pub powers: [f64; 5],
    /// Σ v, Σ v t, Σ v t².
    pub values: [f64; 3],
    /// Σ v².
    pub square: f64,
    /// Σ of the variances.
    pub variance: f64,
}

/// Weights of the value at t = 0 in the fit, as a function of t: row of (XᵀX)⁻¹ for the constant.
#[derive(Clone, Copy)]
pub(super) struct Fit {
    pub value: f64,
    /// Σ of squared weights of the rows: the variance of `value` for pixels of variance 1.
    pub gain: f64,
    pub residual: f64,
    pub freedom: u32,
}

impl Sums {
    /// The coefficients of 1, t and t² (its mean over a pixel), and the fit, for five rows or more.
    pub(super) fn curve(&self) -> Option<([f64; 3], Fit)> {
        if self.count < 5 {
            return None;
        }
        let n = f64::from(self.count);
        // The mean of t² over a pixel is larger than that of its centre.
        let [_, p1, p2, p3, p4] = self.powers;
        let k = PIXEL_VARIANCE;
        let (q2, q3, q4) = (p2 + k * n, p3 + k * p1, p4 + 2.0 * k * p2 + k * k * n);
        let [v0, v1, v2] = self.values;
        let inverse = Matrix3::new(n, p1, q2, p1, p2, q3, q2, q3, q4).try_inverse()?;
        let right = Vector3::new(v0, v1, v2 + k * v0);
        let curve = inverse * right;
        let fit = Fit {
            value: curve[0],
            gain: inverse[(0, 0)],
            residual: (self.square - curve.dot(&right)).max(0.0),
            freedom: self.count - 3,
        };
        Some(([curve[0], curve[1], curve[2]], fit))
    }

    /// The fit at t = 0 with as many terms as the rows determine; `None` without rows, and where they do not reach to the line.
    pub(super) fn fit(&self) -> Option<Fit> {
        self.any_fit().filter(|fit| fit.gain <= FARTHEST)
    }

    fn any_fit(&self) -> Option<Fit> {
        let n = f64::from(self.count);
        let [_, p1, p2, _, p4] = self.powers;
        let k = PIXEL_VARIANCE;
        let (q2, q4) = (p2 + k * n, p4 + 2.0 * k * p2 + k * k * n);
        let [v0, v1, v2] = self.values;
        let v2 = v2 + k * v0;
        match self.count {
            0 => None,
            1 => (p1.abs() <= 1.0).then_some(Fit {
                value: v0,
                gain: 1.0,
                residual: 0.0,
                freedom: 0,
            }),
            2..=4 => {
                // 1 and t² only: rows on one side or around the line still reach it. Two rows around it are nearer to a line than to a parabola.
                let even = line_through(self.count, [n, q2, q4], [v0, v2], self.square);
                let straight = || line_through(self.count, [n, p1, p2], [v0, v1], self.square);
                match self.count {
                    2 => [even, straight()]
                        .into_iter()
                        .flatten()
                        .min_by(|a, b| a.gain.total_cmp(&b.gain)),
                    _ => even,
                }
            }
            _ => self.curve().map(|(_, fit)| fit),
        }
    }
}

/// The fit of `count` values by 1 and one x, at x = 0: from \[n, Σx, Σx²\], \[Σv, Σvx\] and Σv². `None` where all x are the same.
fn line_through(count: u32, [n, x, xx]: [f64; 3], [v, vx]: [f64; 2], square: f64) -> Option<Fit> {
    let determinant = n * xx - x * x;
    if determinant <= 1e-9 * n * xx {
        return None;
    }
    let (a, b) = (
        (xx * v - x * vx) / determinant,
        (n * vx - x * v) / determinant,
    );
    Some(Fit {
        value: a,
        gain: xx / determinant,
        residual: (square - a * v - b * vx).max(0.0),
        freedom: count - 2,
    })
}

/// Columns that are summed at a time: their sums stay in registers, and a row of them is part of one cache line.
const LANES: usize = 8;

/// The rows held that lie within reach of any of some columns' lines.
fn rows_within(radiance: &Radiance, lines: &[(f64, f64)]) -> Range<u32> {
    let top = lines.iter().map(|(h, r)| h - r).fold(f64::MAX, f64::min);
    let bottom = lines.iter().map(|(h, r)| h + r).fold(f64::MIN, f64::max);
    let held =
        |row: f64| row.clamp(f64::from(radiance.rows.start), f64::from(radiance.rows.end)) as u32;
    held((top - 1.0).floor())..held((bottom + 1.0).ceil())
}

/// The sums of up to [`LANES`] neighbouring columns, for the processor's widest instructions.
struct ColumnSums<'a> {
    /// Height of the line and reach of each column.
    lines: &'a [(f64, f64)],
    rows: Range<u32>,
    /// From the first column of the first row on.
    values: &'a [f32],
    variances: &'a [f32],
    /// Pixels from row to row.
    width: usize,
}

impl pulp::NullaryFnOnce for ColumnSums<'_> {
    type Output = [Sums; LANES];

    #[inline(always)]
    fn call(self) -> [Sums; LANES] {
        type Lanes = [f64; LANES];
        let columns = self.lines.len().min(LANES);
        // Columns that are not there have no reach.
        let (mut height, mut reach): (Lanes, Lanes) = ([0.0; LANES], [-1.0; LANES]);
        for (k, line) in self.lines.iter().enumerate().take(LANES) {
            (height[k], reach[k]) = *line;
        }
        // Count, Σ t … t⁴, Σ v, Σ v t, Σ v t², Σ v², Σ variance.
        let mut sums = [[0.0; LANES]; 10];
        let (mut value, mut variance) = ([0.0f32; LANES], [f32::INFINITY; LANES]);
        let rows = self
            .values
            .chunks(self.width)
            .zip(self.variances.chunks(self.width));
        for (y, (values, variances)) in self.rows.zip(rows) {
            let centre = f64::from(y) + 0.5;
            if let (Some(values), Some(variances)) = (
                values.first_chunk::<LANES>(),
                variances.first_chunk::<LANES>(),
            ) && columns == LANES
            {
                (value, variance) = (*values, *variances);
            } else {
                let there = columns.min(values.len());
                value[..there].copy_from_slice(&values[..there]);
                variance[..there].copy_from_slice(&variances[..there]);
            }
            for k in 0..LANES {
                let t = centre - height[k];
                // Without a branch, so that the columns go side by side; what is left out adds zeros.
                let used = (t.abs() <= reach[k]) & (variance[k].abs() < f32::INFINITY);
                let one = if used { 1.0 } else { 0.0 };
                let t = if used { t } else { 0.0 };
                let v = if used { f64::from(value[k]) } else { 0.0 };
                let s = if used { f64::from(variance[k]) } else { 0.0 };
                let t2 = t * t;
                let terms = [one, t, t2, t2 * t, t2 * t2, v, v * t, v * t2, v * v, s];
                for (sum, term) in sums.iter_mut().zip(terms) {
                    sum[k] += term;
                }
            }
        }
        std::array::from_fn(|k| {
            let [n, p1, p2, p3, p4, v0, v1, v2, square, variance] = sums.map(|lanes| lanes[k]);
            Sums {
                count: n as u32,
                powers: [n, p1, p2, p3, p4],
                values: [v0, v1, v2],
                square,
                variance,
            }
        })
    }
}

/// Stations for the image columns `columns`, for a measured line that runs along the rows.
///
/// `line` gives for each column the height of the line (photo pixels from the top) and the largest
/// distance from it that is averaged, both for the column's centre.
pub fn along_rows(
    radiance: &Radiance,
    columns: Range<usize>,
    line: impl Fn(usize) -> (f64, f64),
) -> Stations {
    let channels = radiance.channels.len();
    let width = radiance.size[0] as usize;
    let lines: Vec<(f64, f64)> = columns.clone().map(&line).collect();
    // By channel; a few views are read before all others, and then processors are free.
    let of_channels: Vec<Fitted> = (0..channels)
        .into_par_iter()
        .map(|c| {
            let (values, variances) = (&radiance.value[c], &radiance.variance[c]);
            let mut sums = Vec::with_capacity(lines.len());
            for (block, lines) in lines.chunks(LANES).enumerate() {
                let first = columns.start + block * LANES;
                let rows = rows_within(radiance, lines);
                let at = (rows.start - radiance.rows.start) as usize * width + first;
                let found = pulp::Arch::new().dispatch(ColumnSums {
                    lines,
                    rows,
                    values: values.get(at..).unwrap_or(&[]),
                    variances: variances.get(at..).unwrap_or(&[]),
                    width,
                });
                sums.extend_from_slice(&found[..lines.len()]);
            }
            let fits = sums.iter().map(Sums::fit).collect();
            let mut fitted = Fitted { sums, fits };
            fitted.leave_dust_out(radiance, c, columns.start, &lines);
            fitted
        })
        .collect();
    let mut all = Stations::unseen(lines.len(), channels);
    for (c, fitted) in of_channels.iter().enumerate() {
        let shared = rounded_alike(radiance, c, columns.start, &lines);
        fitted.read(radiance.noise_known, &shared, c, &mut all);
    }
    all
}

/// Mean over the rows of each station of a channel of the variance that pixels share; none if they share nothing.
fn rounded_alike(
    radiance: &Radiance,
    channel: usize,
    first: usize,
    lines: &[(f64, f64)],
) -> Vec<f64> {
    let width = radiance.size[0] as usize;
    let Some(plane) = radiance.shared.get(channel) else {
        return Vec::new();
    };
    let of_station = |(k, (height, reach)): (usize, &(f64, f64))| {
        let rows = rows_within(radiance, &lines[k..=k]);
        let near = rows.filter(|row| (f64::from(*row) + 0.5 - height).abs() <= *reach);
        let (sum, count) = near
            .filter_map(|row| plane.get((row - radiance.rows.start) as usize * width + first + k))
            .fold((0.0, 0.0), |(sum, n), shared| {
                (sum + f64::from(*shared), n + 1.0)
            });
        if count > 0.0 { sum / count } else { 0.0 }
    };
    lines.iter().enumerate().map(of_station).collect()
}

/// The stations of one channel: sums over their rows, and the fits of these.
struct Fitted {
    sums: Vec<Sums>,
    fits: Vec<Option<Fit>>,
}

impl Fitted {
    /// Replaces the sums and fits of stations some of whose rows are off; `lines` as in [`along_rows`], from image column `first` on.
    fn leave_dust_out(
        &mut self,
        radiance: &Radiance,
        channel: usize,
        first: usize,
        lines: &[(f64, f64)],
    ) {
        let width = radiance.size[0] as usize;
        let mut rows = dust::Rows::default();
        let scatter: Vec<Option<[f64; 2]>> = self
            .sums
            .iter()
            .zip(&self.fits)
            .map(|(s, fit)| {
                let fit = fit.filter(|fit| fit.freedom >= dust::LEAST_FREEDOM)?;
                Some([
                    fit.residual / f64::from(fit.freedom),
                    s.variance / f64::from(s.count),
                ])
            })
            .collect();
        let values = self.fits.iter().flatten();
        let largest = values.map(|fit| fit.value.abs()).fold(0.0, f64::max);
        for k in dust::suspicious(&scatter, largest) {
            let (height, reach) = lines[k];
            let near = rows_within(radiance, &lines[k..=k]);
            let at = (near.start - radiance.rows.start) as usize * width + first + k;
            let [values, variances] =
                [&radiance.value[channel], &radiance.variance[channel]].map(|plane| {
                    let from = plane.get(at..).unwrap_or(&[]);
                    from.iter().copied().step_by(width)
                });
            let count = near.len();
            rows.take(near.start, [height, reach], values.take(count), variances);
            if let Some(kept) = rows.without_dust() {
                self.sums[k] = kept;
                self.fits[k] = kept.fit();
            }
        }
    }

    /// The stations of channel `c`; where the noise is not known it is taken from the rows' scatter about the
    /// fit, pooled over neighbouring stations. What of the quantisation the rows share (`shared`, by station) is added in full.
    fn read(&self, noise_known: bool, shared: &[f64], c: usize, all: &mut Stations) {
        let pooled = |of: fn(&Fit) -> f64| -> Vec<f64> {
            let each: Vec<f64> = self
                .fits
                .iter()
                .map(|f| f.as_ref().map_or(0.0, of))
                .collect();
            let near = |k: usize| &each[k.saturating_sub(POOL)..(k + POOL + 1).min(each.len())];
            (0..each.len()).map(|k| side_by_side(near(k))).collect()
        };
        let (residual, freedom) = match noise_known {
            true => (Vec::new(), Vec::new()),
            false => (
                pooled(|fit| fit.residual),
                pooled(|fit| f64::from(fit.freedom)),
            ),
        };
        for (k, (sums, fit)) in self.sums.iter().zip(&self.fits).enumerate() {
            let Some(fit) = fit else { continue };
            let mean_pixel = sums.variance / f64::from(sums.count);
            all.value[c][k] = fit.value;
            all.pixels[k] = all.pixels[k].max(sums.count);
            all.variance[c][k] = if noise_known {
                let shared = shared.get(k).copied().unwrap_or(0.0).min(mean_pixel);
                fit.gain * (mean_pixel - shared) + shared
            } else {
                let scatter = residual[k] / freedom[k].max(1.0);
                fit.gain * scatter + shared_rounding_of(mean_pixel, scatter)
            };
        }
    }
}

/// The sum of some values, four by four.
fn side_by_side(values: &[f64]) -> f64 {
    let (fours, rest) = values.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for four in fours {
        for (sum, value) in sums.iter_mut().zip(four) {
            *sum += value;
        }
    }
    sums.iter().chain(rest).sum()
}

/// How far (pixels) along the line a station of [`along_line`] has parts of pixels.
pub(super) fn along_line_reach(tangent: [f64; 2]) -> f64 {
    1.0 + 0.5 * (tangent[0].abs() + tangent[1].abs())
}

/// Stations at the given image positions for a line in any direction: pixels are gathered in a frame
/// along (`tangent`, a unit vector) and across the line.
///
/// Along the line a pixel counts for the two nearest stations in proportion (a hat one pixel to each
/// side, so that a station averages more than its pixel: [`HAT_VARIANCE`]); that halves the noise and ties neighbours together, for which the variance is enlarged by 3/2, the
/// ratio of (Σ w)² to Σ w² summed over stations.
pub fn along_line(
    radiance: &Radiance,
    positions: &[[f64; 2]],
    tangent: [f64; 2],
    reach: impl Fn(usize) -> f64,
) -> Stations {
    let channels = radiance.channels.len();
    let width = radiance.size[0] as usize;
    let mut all = Stations::unseen(positions.len(), channels);
    for (k, position) in positions.iter().enumerate() {
        let reach = reach(k);
        let radius = reach + 1.5;
        let x = ((position[0] - radius).floor().max(0.0) as usize)
            ..((position[0] + radius).ceil().clamp(0.0, width as f64) as usize);
        let y = ((position[1] - radius)
            .floor()
            .max(f64::from(radiance.rows.start)) as u32)
            ..((position[1] + radius)
                .ceil()
                .clamp(0.0, f64::from(radiance.rows.end)) as u32);
        for c in 0..channels {
            let mut normal = nalgebra::Matrix4::<f64>::zeros();
            let mut right = nalgebra::Vector4::<f64>::zeros();
            let mut used = Vec::new();
            for row in y.clone() {
                let below = f64::from(row) + 0.5 - position[1];
                for u in near_line(position[0], below, tangent, reach, &x) {
                    let at = (row - radiance.rows.start) as usize * width + u;
                    let d = [u as f64 + 0.5 - position[0], below];
                    let s = d[0] * tangent[0] + d[1] * tangent[1];
                    let t = d[0] * tangent[1] - d[1] * tangent[0];
                    let variance = f64::from(radiance.variance[c][at]);
                    if s.abs() >= 1.0 || t.abs() > reach || !variance.is_finite() {
                        continue;
                    }
                    let weight = 1.0 - s.abs();
                    let basis = nalgebra::Vector4::new(1.0, s, t, t * t + PIXEL_VARIANCE);
                    let value = f64::from(radiance.value[c][at]);
                    normal += weight * basis * basis.transpose();
                    right += weight * basis * value;
                    used.push((weight, basis, value, variance));
                }
            }
            let Some(inverse) = inverse(&normal).filter(|_| used.len() >= 8) else {
                continue;
            };
            let fit = inverse * right;
            let row = inverse.row(0).transpose();
            let (mut variance, mut gain, mut residual) = (0.0, 0.0, 0.0);
            for (weight, basis, value, pixel) in &used {
                let w = weight * row.dot(basis);
                variance += w * w * pixel;
                gain += w * w;
                residual += (value - fit.dot(basis)).powi(2);
            }
            if gain > FARTHEST {
                continue;
            }
            if !radiance.noise_known {
                let mean_pixel = used.iter().map(|u| u.3).sum::<f64>() / used.len() as f64;
                let scatter = residual / (used.len() - 4).max(1) as f64;
                variance = gain * scatter + shared_rounding_of(mean_pixel, scatter);
            }
            all.value[c][k] = fit[0];
            all.variance[c][k] = 1.5 * variance;
            all.pixels[k] = used.len() as u32 / 2;
        }
    }
    all
}

/// The inverse of a normal matrix whose terms the pixels tell apart: of a station beside clipped ones a single column of pixels may be
/// left, in which the place along the line goes with the row.
fn inverse(normal: &nalgebra::Matrix4<f64>) -> Option<nalgebra::Matrix4<f64>> {
    let size = normal.diagonal().map(f64::sqrt);
    if !size.iter().all(|s| *s > 0.0) {
        return None;
    }
    let scaled = normal.component_div(&(size * size.transpose()));
    // Squares of the pivots: the part of each term that those before it do not have.
    let own = scaled.cholesky()?.l_dirty().diagonal().map(|p| p * p);
    (own.min() > LEAST_OWN)
        .then(|| normal.try_inverse())
        .flatten()
}

/// The columns among `columns` that [`along_line`] may use of a row `below` a station at `place`: those less than a pixel along the line
/// and within reach across it, and at most one more at each end.
fn near_line(
    place: f64,
    below: f64,
    tangent: [f64; 2],
    reach: f64,
    columns: &Range<usize>,
) -> Range<usize> {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    // |aside · x + below · y| ≤ largest
    for ([x, y], largest) in [(tangent, 1.0), ([tangent[1], -tangent[0]], reach)] {
        if x.abs() > 1e-6 {
            let (middle, half) = (-below * y / x, largest / x.abs());
            low = low.max(middle - half);
            high = high.min(middle + half);
        }
    }
    let column = |aside: f64| {
        let at = place + aside - 0.5;
        at.clamp(columns.start as f64, columns.end as f64)
    };
    let first = column(low).floor() as usize;
    let last = (column(high).ceil() as usize + 1).min(columns.end);
    first..last.max(first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiance::shared_rounding;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn no_pixel_near_a_line_is_passed_over() {
        let columns = 3..60;
        for degrees in [0.0, 0.01, 0.1, 3.0, 30.0, 45.0, 80.0, 89.99, 90.0, -60.0] {
            let (y, x) = f64::to_radians(degrees).sin_cos();
            for reach in [1.0, 6.5, 20.0] {
                for place in [2.2, 30.0, 30.49, 58.7] {
                    for below in [-21.0, -6.3, -0.5, 0.0, 0.99, 7.5, 19.0] {
                        let near = near_line(place, below, [x, y], reach, &columns);
                        let used = columns.clone().filter(|u| {
                            let aside = *u as f64 + 0.5 - place;
                            let (s, t) = (aside * x + below * y, aside * y - below * x);
                            s.abs() < 1.0 && t.abs() <= reach
                        });
                        for u in used {
                            assert!(near.contains(&u), "{degrees} {reach} {place} {below} {u}");
                        }
                    }
                }
            }
        }
    }

    fn image(height: u32, f: impl Fn(f64, f64) -> f64) -> Radiance {
        let width = 32u32;
        let value = (0..height)
            .flat_map(|y| {
                (0..width)
                    .map(move |x| (x, y))
                    .map(|(x, y)| {
                        // The mean over the pixel, by a fine sum.
                        let mut sum = 0.0;
                        for a in 0..20 {
                            for b in 0..20 {
                                sum += f(
                                    f64::from(x) + (f64::from(a) + 0.5) / 20.0,
                                    f64::from(y) + (f64::from(b) + 0.5) / 20.0,
                                );
                            }
                        }
                        (sum / 400.0) as f32
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        Radiance {
            size: [width, height],
            rows: 0..height,
            channels: vec!["Y".into()],
            value: vec![value],
            variance: vec![vec![1e-12; (width * height) as usize]],
            shared: Vec::new(),
            noise_known: true,
        }
    }

    #[test]
    fn the_value_on_the_line_is_found_for_even_and_odd_heights() {
        for height in [1, 2, 3, 4, 7, 8, 24] {
            let middle = f64::from(height) / 2.0;
            let image = image(height, |x, y| 1.0 + 0.01 * x - 0.004 * (y - middle).powi(2));
            let found = along_rows(&image, 0..32, |_| (middle, 100.0));
            for (u, value) in found.value[0].iter().enumerate() {
                let expected = 1.0 + 0.01 * (u as f64 + 0.5);
                // A single row keeps its footprint's bias 0.004/12; two or more reach the line
                // within f32 rounding; two rows at ±½ share one t², so only their mean is known.
                let allowed = if height <= 2 {
                    0.004 / 3.0 + 1e-6
                } else {
                    2e-6
                };
                assert!((value - expected).abs() < allowed, "{height} {u}");
            }
        }
    }

    /// Over stations whose brightness runs through the steps of whole numbers, with noise of σ steps: rms of error over stated σ.
    fn rms_error_of_rounded(sigma: f64, noise_known: bool, seed: u64) -> f64 {
        let (width, height) = (600_u32, 40);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // By 0.37 of a step from station to station.
        let truth = |x: u32| 80.0 + 0.37 * f64::from(x);
        let value: Vec<f32> = (0..width * height)
            .map(|i| {
                let noise: f64 = StandardNormal.sample(&mut random);
                (truth(i % width) + sigma * noise).round() as f32
            })
            .collect();
        let rounding = 1.0 / 12.0;
        let stated = rounding + if noise_known { sigma * sigma } else { 0.0 };
        let shared = shared_rounding(rounding, sigma * sigma) as f32;
        let image = Radiance {
            size: [width, height],
            rows: 0..height,
            channels: vec!["Y".into()],
            variance: vec![vec![stated as f32; value.len()]],
            shared: match noise_known {
                true => vec![vec![shared; value.len()]],
                false => Vec::new(),
            },
            value: vec![value],
            noise_known,
        };
        let found = along_rows(&image, 0..width as usize, |_| (20.0, 100.0));
        let squares: f64 = (0..width)
            .map(|x| {
                let error = found.value[0][x as usize] - truth(x);
                error * error / found.variance[0][x as usize]
            })
            .sum();
        (squares / f64::from(width)).sqrt()
    }

    #[test]
    fn rows_that_round_alike_are_no_better_than_one() {
        for noise_known in [true, false] {
            for sigma in [0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0] {
                let rms = rms_error_of_rounded(sigma, noise_known, 3);
                // Of 600 stations 1 ± 0.03; that of pooled rows' scatter, which goes by few values where rows round alike, another tenth.
                assert!((rms - 1.0).abs() < 0.2, "{noise_known} {sigma}: {rms}");
            }
        }
    }

    #[test]
    fn two_rows_tell_what_lies_between_them() {
        let slope = 0.03;
        let image = image(2, |_, y| 1.0 + slope * y);
        for line in [0.55, 0.7, 0.9, 0.95, 1.0, 1.05, 1.3, 1.45] {
            let found = along_rows(&image, 0..32, |_| (line, 1.0));
            // Nearer to a row than a quarter of a pixel a parabola knows as much, and its vertex is not on the line.
            let miss = found.value[0][3] - (1.0 + slope * line);
            assert!(miss.abs() < slope / 8.0, "{line}: {miss}");
            assert!(found.variance[0][3].is_finite(), "{line}");
        }
    }

    #[test]
    fn rows_to_one_side_are_not_taken_to_the_line() {
        // Of a column most rows are clipped, all but the lowest ones; from the seventh on they lie on both sides of the line.
        let whole = image(12, |x, y| 1.0 + 0.01 * x - 0.004 * (y - 6.0).powi(2));
        for left in [1, 2, 3, 5, 6, 7, 9, 12] {
            let mut clipped = whole.clone();
            for row in 0..12 - left {
                clipped.variance[0][row * 32 + 20] = f32::INFINITY;
            }
            let found = along_rows(&clipped, 0..32, |_| (6.0, 100.0));
            assert_eq!(found.variance[0][20].is_finite(), left >= 7, "{left}");
        }
    }

    #[test]
    fn dust_on_some_rows_does_not_show() {
        let height = 40;
        let scene = |x: f64, y: f64| 2.0 + 0.02 * x - 0.001 * (y - 20.0).powi(2);
        let clean = image(height, scene);
        let mut dusty = clean.clone();
        for y in 22..31 {
            for x in 10..15 {
                dusty.value[0][y * 32 + x] *= 0.6;
            }
        }
        let read = |image: &Radiance| along_rows(image, 0..32, |_| (20.0, 30.0));
        let (a, b) = (read(&clean), read(&dusty));
        for u in 0..a.count() {
            // Without noise the sound rows tell the same; rounding to f32 is 2e-7.
            assert!((a.value[0][u] - b.value[0][u]).abs() < 2e-6, "{u}");
            let pixels = if (10..15).contains(&u) { 31 } else { 40 };
            assert_eq!(b.pixels[u], pixels, "{u}");
        }
    }

    #[test]
    fn beside_what_is_clipped_a_slanted_line_tells_little_or_nothing() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let height = 32;
        // Brighter to the right by as much as a lobe's flank; clipped from column 16 on, and with it a part of column 15.
        let mut image = image(height, |x, _| 0.4 + 0.03 * x);
        for (i, (value, variance)) in image.value[0]
            .iter_mut()
            .zip(&mut image.variance[0])
            .enumerate()
        {
            let noise: f64 = StandardNormal.sample(&mut random);
            *value += 0.01 * noise as f32;
            *variance = 1e-4;
            let column = i % 32;
            if column > 15 || column == 15 && (i / 32) % 3 != 0 {
                (*value, *variance) = (0.0, f32::INFINITY);
            }
        }
        for tilt in [0.0011, 0.003, -0.01, 0.02, 0.3] {
            let tangent = [f64::cos(tilt), f64::sin(tilt)];
            let positions: Vec<[f64; 2]> = (0..18).map(|k| [f64::from(k) + 0.3, 16.0]).collect();
            let found = along_line(&image, &positions, tangent, |_| 4.5);
            for (k, position) in positions.iter().enumerate() {
                let sigma = found.variance[0][k].sqrt();
                let error = found.value[0][k] - (0.4 + 0.03 * position[0]);
                // Of 90 stations none is off by 5 σ.
                assert!(
                    !sigma.is_finite() || error.abs() < 5.0 * sigma,
                    "{tilt} {k}: {error} {sigma}"
                );
            }
            assert!(found.variance[0][8].is_finite() && found.variance[0][17].is_infinite());
        }
    }

    #[test]
    fn a_line_in_any_direction_reads_the_same() {
        let height = 40;
        let (cx, cy) = (16.0, 20.0);
        for angle in [0.0f64, 0.3, 0.8, 1.4] {
            let tangent = [angle.cos(), -angle.sin()];
            let image = image(height, |x, y| {
                let (dx, dy) = (x - cx, y - cy);
                let s = dx * tangent[0] + dy * tangent[1];
                let t = dx * tangent[1] - dy * tangent[0];
                2.0 + 0.02 * s - 0.003 * t * t
            });
            let positions: Vec<[f64; 2]> = (-8..=8)
                .map(|k| {
                    [
                        cx + f64::from(k) * tangent[0],
                        cy + f64::from(k) * tangent[1],
                    ]
                })
                .collect();
            let found = along_line(&image, &positions, tangent, |_| 4.0);
            for (k, value) in found.value[0].iter().enumerate() {
                let s = k as f64 - 8.0;
                assert!((value - (2.0 + 0.02 * s)).abs() < 1e-5, "{angle} {k}");
            }
        }
    }
}
