//! The pixels about the predicted limb, straightened: one strip per side and band of rows.

use std::ops::Range;

use crate::capture::Shape;
use crate::geometry::surface::{Side, ViewGeometry};
use crate::radiance::Radiance;

/// At most this many rows are looked at, in at most [`BANDS`] bands: the limb is smooth, so more rows
/// would only cost time.
const ROWS: usize = 64;
const BANDS: usize = 8;
/// A sphere's rows are used up to this many radii above and below its centre, where the limb crosses
/// a row at 45°: beyond, it is too slanted to be located along the row.
const SPHERE_REACH: f64 = 0.7;
/// Up to so many values are sorted pair by pair for their median.
const FEW: usize = 8;

/// Brightness about one side's predicted limb, along the rows of one band.
pub(super) struct Strip {
    pub side: Side,
    /// Mean position of its rows, pixels from the top of the image.
    pub row: f64,
    /// Cosine of the angle between the limb's normal and the image row.
    pub slant: f64,
    pub lines: Vec<Line>,
}

/// One image row of a strip.
pub(super) struct Line {
    /// Centre of the row, pixels from the top of the image.
    pub row: f64,
    /// Depth of the first pixel's centre inside the predicted limb, pixels; the others follow in
    /// steps of 1, inwards.
    pub first: f64,
    pub value: Vec<f32>,
    /// Infinite where the pixel is missing or outside the image.
    pub variance: Vec<f32>,
}

/// Cuts out the strips of both sides, `reach` pixels to either side of the predicted limb.
pub(super) fn cut(
    radiance: &Radiance,
    predicted: &ViewGeometry,
    shape: Shape,
    reach: f64,
) -> Vec<Strip> {
    let Some(rows) = usable_rows(radiance, predicted, shape) else {
        return Vec::new();
    };
    let mut strips = Vec::new();
    let mut last = [None; 2];
    for band in bands(rows) {
        for (side, last) in Side::BOTH.into_iter().zip(&mut last) {
            // From row to row the limb moves little.
            let mut limb = |row: f64| -> Option<f64> {
                *last = match *last {
                    Some(near) => predicted.limb_at_row_near(near, row, side),
                    None => predicted.limb_at_row(row, side),
                };
                *last
            };
            let lines: Vec<Line> = band
                .iter()
                .filter_map(|row| {
                    let limb = limb(f64::from(*row) + 0.5)?;
                    line(radiance, limb, *row, side, reach)
                })
                .collect();
            let (Some(a), Some(b)) = (lines.first(), lines.last()) else {
                continue;
            };
            let row = 0.5 * (a.row + b.row);
            let step = 2.0;
            let lean = match (limb(row - step), limb(row + step)) {
                (Some(above), Some(below)) => (below - above) / (2.0 * step),
                _ => 0.0,
            };
            strips.push(Strip {
                side,
                row,
                slant: 1.0 / lean.hypot(1.0),
                lines,
            });
        }
    }
    strips
}

fn usable_rows(radiance: &Radiance, predicted: &ViewGeometry, shape: Shape) -> Option<Range<u32>> {
    let held = radiance.rows.clone();
    let rows = match shape {
        Shape::Cylinder => held,
        Shape::Sphere => {
            let [_, centre] = predicted.trace(0.0)?.pixel;
            let reach = SPHERE_REACH * predicted.radius_px()?;
            let top = (centre - reach).max(f64::from(held.start));
            let bottom = (centre + reach).min(f64::from(held.end));
            top.ceil() as u32..bottom.floor().max(0.0) as u32
        }
    };
    (rows.start < rows.end).then_some(rows)
}

/// Groups of adjacent rows, spread over `rows`.
fn bands(rows: Range<u32>) -> Vec<Vec<u32>> {
    let all: Vec<u32> = rows.collect();
    let count = (all.len() / 4).clamp(1, BANDS);
    let height = (ROWS / count).min(all.len() / count).max(1);
    (0..count)
        .map(|band| {
            let start = band * all.len() / count;
            let end = (band + 1) * all.len() / count;
            let skip = (end - start).saturating_sub(height) / 2;
            all.iter()
                .skip(start + skip)
                .take(height)
                .copied()
                .collect()
        })
        .collect()
}

fn line(radiance: &Radiance, limb: f64, row: u32, side: Side, reach: f64) -> Option<Line> {
    let centre = f64::from(row) + 0.5;
    let width = radiance.size[0] as usize;
    let offset = row.checked_sub(radiance.rows.start)? as usize * width;
    let length = (2.0 * reach) as usize;
    let inwards = -side.sign();
    // Column of the outermost pixel, then inwards one by one.
    let start = (limb - inwards * reach).floor();
    let (mut value, mut variance) = (vec![0.0; length], vec![f32::INFINITY; length]);
    // From left to right: the first column, and which of the line's pixels lie in the image.
    let leftmost = match side {
        Side::Left => start,
        Side::Right => start + 1.0 - length as f64,
    };
    let skip = (-leftmost).max(0.0) as usize;
    let first = leftmost.max(0.0) as usize;
    if skip < length && first < width {
        let count = (length - skip).min(width - first);
        let at = offset + first..offset + first + count;
        pulp::Arch::new().dispatch(Brightness {
            radiance,
            at,
            value: &mut value[skip..skip + count],
            variance: &mut variance[skip..skip + count],
        });
    }
    if side == Side::Right {
        value.reverse();
        variance.reverse();
    }
    Some(Line {
        row: centre,
        first: inwards * (start + 0.5 - limb),
        value,
        variance,
    })
}

/// Mean over the channels and its variance at some pixels, for the processor's widest instructions; missing if any channel is, for a
/// mean over fewer channels has another level and would look like an edge.
struct Brightness<'a> {
    radiance: &'a Radiance,
    at: Range<usize>,
    value: &'a mut [f32],
    variance: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Brightness<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            radiance,
            at,
            value: sum,
            variance: sum_variance,
        } = self;
        let planes = || radiance.value.iter().zip(&radiance.variance);
        let held =
            |(value, variance): (&Vec<f32>, &Vec<f32>)| value.len().min(variance.len()) >= at.end;
        if radiance.value.is_empty() || !planes().all(held) {
            return;
        }
        sum_variance.fill(0.0);
        for (value, variance) in planes() {
            let pixels = value[at.clone()].iter().zip(&variance[at.clone()]);
            for ((sum, sum_variance), (value, v)) in
                sum.iter_mut().zip(&mut *sum_variance).zip(pixels)
            {
                let known = (value.abs() < f32::INFINITY) & (v.abs() < f32::INFINITY);
                *sum += if known { *value } else { 0.0 };
                *sum_variance += if known { *v } else { f32::INFINITY };
            }
        }
        let count = radiance.value.len() as f32;
        for (sum, variance) in sum.iter_mut().zip(sum_variance) {
            let known = *variance < f32::INFINITY;
            *sum = if known { *sum / count } else { 0.0 };
            *variance = if known {
                *variance / (count * count)
            } else {
                f32::INFINITY
            };
        }
    }
}

/// The median over a strip's lines at each depth, and the noise of one pixel.
pub(super) struct Profile {
    /// Depth of the first value inside the predicted limb, pixels; steps of 1 inwards.
    pub first: f64,
    /// NaN where no line has a pixel.
    pub value: Vec<f32>,
    /// Variance of the median.
    pub variance: f64,
    /// Variance of one pixel that the scatter between lines shows.
    pub pixel_variance: f64,
}

impl Profile {
    /// Least and largest value between two depths.
    pub(super) fn range(&self, from: f64, to: f64) -> Option<(f64, f64)> {
        let index =
            |depth: f64| ((depth - self.first).round().max(0.0) as usize).min(self.value.len());
        let (low, high) = self
            .value
            .get(index(from)..index(to))?
            .iter()
            .filter(|v| v.is_finite())
            .fold((f64::MAX, f64::MIN), |(l, h), v| {
                (l.min(f64::from(*v)), h.max(f64::from(*v)))
            });
        (high > low).then_some((low, high))
    }
}

impl Strip {
    pub(super) fn profile(&self) -> Profile {
        let length = self.lines.iter().map(|l| l.value.len()).min().unwrap_or(0);
        let mut value = Vec::with_capacity(length);
        let mut scatter = Vec::with_capacity(length);
        let mut stated = Vec::with_capacity(length);
        let mut here: Vec<f32> = Vec::with_capacity(self.lines.len());
        for k in 0..length {
            here.clear();
            let mut variance = 0.0;
            for line in &self.lines {
                if line.variance[k].is_finite() {
                    here.push(line.value[k]);
                    variance += line.variance[k];
                }
            }
            let Some(middle) = median(&mut here) else {
                value.push(f32::NAN);
                continue;
            };
            value.push(middle);
            stated.push(variance / here.len() as f32);
            if here.len() >= 3 {
                for v in &mut here {
                    *v = (*v - middle).abs();
                }
                // 1.48 times the median deviation is the standard deviation of normal noise.
                scatter.extend(median(&mut here).map(|d| (1.48 * d).powi(2)));
            }
        }
        let pixel_variance = f64::from(median(&mut scatter).unwrap_or(0.0))
            .max(f64::from(median(&mut stated).unwrap_or(0.0)));
        let lines = self.lines.len().max(1) as f64;
        Profile {
            first: self.lines.iter().map(|l| l.first).sum::<f64>() / lines,
            value,
            // The median of n normal values has π/2 times the variance of their mean.
            variance: pixel_variance * 1.57 / lines,
            pixel_variance,
        }
    }
}

fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    if values.len() > FEW {
        return Some(*values.select_nth_unstable_by(middle, f32::total_cmp).1);
    }
    // A few are sorted without a branch that depends on them: every one is as often less as not. Zeros are all the same here.
    for end in 1..values.len() {
        for k in (0..end).rev() {
            let (a, b) = (values[k], values[k + 1]);
            (values[k], values[k + 1]) = (a.min(b), a.max(b));
        }
    }
    values.get(middle).copied()
}
