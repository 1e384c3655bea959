//! Samples at exact positions to cells of the (α, θo′) grid.
//!
//! A sample has its column's θo′ but lies up to half a row from its cell's centre in α, over which a glossy
//! light field changes by percents. So a cell is not the mean of what fell into it: the samples of the
//! column are interpolated to the cell's centre, through the four nearest where views are sparse, by a local
//! parabola where several fall into a row.

use rayon::prelude::*;

use nalgebra::{Matrix3, Vector3};

use super::{Column, LightField, Samples};
use crate::angle::wrap;
use crate::grid::Grid;

/// Distance (radians) beyond which a sample says nothing about the curve between the nearest two: about the
/// width of the broadest lobe that a table of models holds.
const FAR: f64 = 0.45;

/// The light field on `grid`, whose columns are those of `samples`; `pixels` gives the number of pixels
/// behind each sample, \[column\]\[n\].
pub fn grid(samples: &Samples, grid: Grid, pixels: &[Vec<f32>]) -> LightField {
    let mut field = LightField::empty(grid, samples.channels.clone());
    let layers = field.mean.par_iter_mut().zip(&mut field.sigma);
    let layers = layers.zip(&mut field.weight).enumerate();
    layers.for_each(|(c, ((mean, sigma), weight))| {
        let columns: Vec<Vec<Cell>> = samples
            .columns
            .par_iter()
            .zip(pixels)
            .map(|(column, pixels)| cells(column, c, grid, pixels))
            .collect();
        for (j, cells) in columns.iter().enumerate() {
            for cell in cells {
                let at = grid.index(cell.row, j);
                mean[at] = cell.mean as f32;
                sigma[at] = cell.variance.sqrt() as f32;
                weight[at] = cell.weight;
            }
        }
    });
    field
}

struct Cell {
    row: usize,
    mean: f64,
    variance: f64,
    weight: f32,
}

struct Point {
    alpha: f64,
    value: f64,
    variance: f64,
    pixels: f32,
}

/// All cells of a column that hold a sample.
fn cells(column: &Column, channel: usize, grid: Grid, pixels: &[f32]) -> Vec<Cell> {
    let mut points: Vec<Point> = (0..column.alpha.len())
        .filter(|&i| column.variance[channel][i].is_finite())
        .map(|i| Point {
            alpha: wrap(column.alpha[i]),
            value: column.value[channel][i],
            variance: column.variance[channel][i],
            pixels: pixels[i],
        })
        .collect();
    points.sort_by(|a, b| a.alpha.total_cmp(&b.alpha));
    let mut cells = Vec::new();
    let mut first = 0;
    while first < points.len() {
        let row = grid.row(crate::NormalAngle::radians(points[first].alpha));
        let mut last = first + 1;
        while last < points.len()
            && grid.row(crate::NormalAngle::radians(points[last].alpha)) == row
        {
            last += 1;
        }
        let centre = grid.normal(row).rad();
        let (mean, variance) = if last - first >= 3 {
            parabola(&points, first, last, centre, grid.normal_step())
        } else {
            between(&points, first, last, centre)
        };
        let weight = points[first..last].iter().map(|p| p.pixels).sum::<f32>();
        cells.push(Cell {
            row,
            mean,
            variance,
            weight: weight.max(1.0),
        });
        first = last;
    }
    cells
}

/// Interpolation to `centre` through the two, and up to four if they lie within [`FAR`], of the samples around
/// `first..last`; for two samples in one cell, the mean of both.
fn between(points: &[Point], first: usize, last: usize, centre: f64) -> (f64, f64) {
    let n = points.len();
    let mut means = Vec::new();
    for nearest in first..last {
        // Offsets of the neighbours used, around the circle; the nearest sample itself is 0.
        let offset = |k: isize| {
            let at = (nearest as isize + k).rem_euclid(n as isize) as usize;
            (wrap(points[at].alpha - centre), at)
        };
        let ahead: isize = if offset(0).0 <= 0.0 { 1 } else { -1 };
        let mut used = vec![offset(0)];
        for k in [ahead, -ahead, 2 * ahead] {
            let (d, at) = offset(k);
            let fresh = used.iter().all(|&(u, _)| (u - d).abs() > 1e-6);
            if fresh && (d.abs() <= FAR || used.len() == 1) && used.len() < n {
                used.push((d, at));
            }
        }
        let (value, variance) = lagrange(&used, points);
        // What the last point changes is about what the next one would: the error of interpolation.
        let (fewer, _) = lagrange(&used[..used.len().max(2) - 1], points);
        means.push((value, variance + (value - fewer).powi(2)));
    }
    let n = means.len() as f64;
    let sum = means.iter().fold((0.0, 0.0), |s, m| (s.0 + m.0, s.1 + m.1));
    (sum.0 / n, sum.1 / (n * n))
}

/// Lagrange's interpolation at 0 through points at the given offsets, and its variance.
fn lagrange(used: &[(f64, usize)], points: &[Point]) -> (f64, f64) {
    let (mut value, mut variance) = (0.0, 0.0);
    for (i, &(d, at)) in used.iter().enumerate() {
        let weight: f64 = used
            .iter()
            .enumerate()
            .filter(|&(k, _)| k != i)
            .map(|(_, &(other, _))| other / (other - d))
            .product();
        value += weight * points[at].value;
        variance += weight * weight * points[at].variance;
    }
    (value, variance)
}

/// Mean of the samples in the cell, moved to its centre by a weighted parabola over three rows.
fn parabola(points: &[Point], first: usize, last: usize, centre: f64, step: f64) -> (f64, f64) {
    let half = 1.5 * step;
    let mut normal = Matrix3::<f64>::zeros();
    let mut right = Vector3::<f64>::zeros();
    let reach = |i: isize| {
        let p = &points[i.rem_euclid(points.len() as isize) as usize];
        (wrap(p.alpha - centre) / half, p)
    };
    let mut low = first as isize;
    while low > first as isize - points.len() as isize && reach(low - 1).0.abs() <= 1.0 {
        low -= 1;
    }
    let mut high = last as isize;
    while high < low + points.len() as isize && reach(high).0.abs() <= 1.0 {
        high += 1;
    }
    for i in low..high {
        let (d, p) = reach(i);
        let basis = Vector3::new(1.0, d, d * d);
        normal += basis * basis.transpose() / p.variance;
        right += basis * p.value / p.variance;
    }
    let (mut total, mut mean, mut moments) = (0.0, 0.0, Vector3::zeros());
    for p in &points[first..last] {
        let d = wrap(p.alpha - centre) / half;
        total += p.variance.recip();
        mean += p.value / p.variance;
        moments += Vector3::new(0.0, d, d * d) / p.variance;
    }
    mean /= total;
    moments /= total;
    match normal.try_inverse() {
        Some(inverse) => {
            let slopes = inverse * right;
            // Mean and slopes come from largely the same samples; their errors nearly add.
            let variance = total.recip() + moments.dot(&(inverse * moments));
            (mean - moments.dot(&slopes), variance)
        }
        None => (mean, total.recip()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;
    use std::f64::consts::{PI, TAU};

    fn column(views: usize, offset: f64, f: impl Fn(f64) -> f64) -> Column {
        let alpha: Vec<f64> = (0..views)
            .map(|k| -PI + TAU * k as f64 / views as f64 + offset)
            .collect();
        Column {
            local: LocalAngle::radians(0.0),
            view: (0..views as u32).collect(),
            value: vec![alpha.iter().map(|&a| f(a)).collect()],
            variance: vec![vec![1.0; views]],
            alpha,
        }
    }

    #[test]
    fn cells_hold_the_value_at_their_centre() {
        // Order 6 is well resolved by 36 views; 0.2° of offset would shift its value by 2 %.
        let f = |a: f64| 1.0 + (6.0 * a).sin();
        let g = Grid {
            normals: 720,
            locals: 1,
        };
        for (views, allowed) in [(36, 1e-2), (72, 1e-3), (2880, 1e-4)] {
            let column = column(views, 0.2f64.to_radians(), f);
            let found = cells(&column, 0, g, &vec![1.0; views]);
            assert_eq!(found.len(), views.min(720));
            for cell in found {
                let expected = f(g.normal(cell.row).rad());
                // Cubic interpolation: f⁗h⁴·t/12 with f⁗ = 1296, h the spacing and t the part of it moved.
                assert!(
                    (cell.mean - expected).abs() < allowed,
                    "{views}: {}",
                    cell.mean - expected
                );
            }
        }
    }

    #[test]
    fn many_samples_in_a_cell_reduce_its_variance() {
        let column = column(2880, 0.01, |a| a.cos());
        let g = Grid {
            normals: 720,
            locals: 1,
        };
        for cell in cells(&column, 0, g, &[1.0; 2880]) {
            assert!(
                cell.variance > 0.24 && cell.variance < 0.30,
                "{}",
                cell.variance
            );
        }
    }
}
