//! The measured light field as the recoveries take it: exact positions, values, variances.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::ViewSample;
use crate::angle::LocalAngle;
use crate::grid::Grid;

/// Samples of B(α, θo′), sorted into columns of equal θo′.
///
/// Every sample of a column has exactly the column's θo′ (the pixels of each view are fitted there,
/// see [`crate::light_field`]); α is irregular.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// Channel names.
    pub channels: Vec<String>,
    /// Columns in increasing θo′.
    pub columns: Vec<Column>,
}

/// The samples at one θo′.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// θo′ of all samples of this column.
    pub local: LocalAngle,
    /// α of each sample, radians, \[n\].
    pub alpha: Vec<f64>,
    /// Number of the view each sample came from, \[n\].
    pub view: Vec<u32>,
    /// B, W m⁻² sr⁻¹ (or the capture's relative unit), \[channel\]\[n\].
    pub value: Vec<Vec<f64>>,
    /// Variance of B, \[channel\]\[n\]; infinite where the sample is missing in that channel.
    pub variance: Vec<Vec<f64>>,
}

impl Samples {
    /// One sample at the centre of each cell of `grid`; `value` and `variance` are
    /// \[channel\]\[cell\], row-major as in [`Grid::index`]; infinite variance marks a missing cell.
    pub fn from_grid(
        grid: Grid,
        channels: Vec<String>,
        value: &[Vec<f64>],
        variance: &[Vec<f64>],
    ) -> Self {
        let rows = 0..grid.normals;
        let columns = (0..grid.locals)
            .map(|j| {
                let pick = |all: &[Vec<f64>]| -> Vec<Vec<f64>> {
                    all.iter()
                        .map(|v| rows.clone().map(|i| v[grid.index(i, j)]).collect())
                        .collect()
                };
                Column {
                    local: grid.local(j),
                    alpha: rows.clone().map(|i| grid.normal(i).rad()).collect(),
                    view: rows.clone().map(|i| i as u32).collect(),
                    value: pick(value),
                    variance: pick(variance),
                }
            })
            .collect();
        Self { channels, columns }
    }

    /// Number of samples that are present in `channel`.
    pub fn count(&self, channel: usize) -> usize {
        self.columns
            .iter()
            .map(|c| c.variance[channel].iter().filter(|v| v.is_finite()).count())
            .sum()
    }

    /// Width of a column in θo′, radians, taken from the spacing of the columns.
    pub fn column_width(&self) -> f64 {
        match self.columns.as_slice() {
            [first, .., last] => {
                (last.local.rad() - first.local.rad()) / (self.columns.len() - 1) as f64
            }
            _ => PI,
        }
    }
}

/// What fits along and across the measured line leave in photos without any noise, relative to the
/// channel's largest value (rms of such photos against quadrature: 2e-5 to 5e-5). Without it a black pixel,
/// whose rounding is nothing, would outweigh all others.
pub const MODEL_FLOOR: f64 = 3e-5;

/// An error that all samples of a capture have in common, such as a shift of the outline.
#[derive(Clone, Debug, PartialEq)]
pub struct Systematic {
    /// What it is.
    pub name: String,
    /// By how much each sample changes if the error is one standard deviation, \[channel\]\[column\]\[n\].
    pub change: Vec<Vec<Vec<f64>>>,
}

impl Systematic {
    /// What turns the direction of every sample: by `turn` (radians for one standard deviation, of its column and its view), where
    /// the sample changes by `slopes` for each radian, \[channel\]\[column\]\[n\].
    pub fn of_turns(
        name: String,
        samples: &Samples,
        slopes: &[Vec<Vec<f64>>],
        turn: impl Fn(&Column, usize) -> f64,
    ) -> Self {
        let of_column = |column: &Column, slopes: &Vec<f64>| -> Vec<f64> {
            slopes
                .iter()
                .zip(&column.view)
                .map(|(slope, &view)| slope * turn(column, view as usize))
                .collect()
        };
        let change = slopes
            .iter()
            .map(|columns| {
                samples
                    .columns
                    .iter()
                    .zip(columns)
                    .map(|(column, slopes)| of_column(column, slopes))
                    .collect()
            })
            .collect();
        Self { name, change }
    }
}

/// Samples of all views in columns, with what goes along with each.
#[derive(Clone, Debug)]
pub struct Gathered {
    /// The samples.
    pub samples: Samples,
    /// Number of pixels behind each sample, \[column\]\[n\].
    pub pixels: Vec<Vec<f32>>,
    /// dB/dθo′ along the view's line, \[channel\]\[column\]\[n\]; 0 where missing.
    pub slopes: Vec<Vec<Vec<f64>>>,
}

/// Gathers the views' samples into columns; `views` holds, per view, \[channel\]\[column\].
///
/// The variance of a sample is that of its pixels' noise, plus that of an error of its view's outline, plus a
/// floor of `MODEL_FLOOR` times the channel's largest value, squared. `outline_sigma` gives, per view, the standard
/// deviation of θo′ by the outline's error at θo′ = 0, radians; it grows as 1/cos θo′.
pub fn gather(
    channels: Vec<String>,
    locals: &[LocalAngle],
    views: &[Vec<Vec<Option<ViewSample>>>],
    outline_sigma: &[f64],
) -> Gathered {
    let mut slopes = vec![Vec::with_capacity(locals.len()); channels.len()];
    let mut all_pixels = Vec::with_capacity(locals.len());
    let floor: Vec<f64> = (0..channels.len())
        .map(|c| {
            let values = views.iter().flat_map(|v| v[c].iter().flatten());
            let largest = values.fold(0.0f64, |a, s| a.max(s.value.abs()));
            (MODEL_FLOOR * largest).powi(2)
        })
        .collect();
    let gathered: Vec<(Column, Vec<f32>, Vec<Vec<f64>>)> = locals
        .par_iter()
        .enumerate()
        .map(|(j, &local)| {
            let mut column = Column {
                local,
                alpha: Vec::new(),
                view: Vec::new(),
                value: vec![Vec::new(); channels.len()],
                variance: vec![Vec::new(); channels.len()],
            };
            let mut pixels = Vec::new();
            let mut slopes = vec![Vec::new(); channels.len()];
            for (k, view) in views.iter().enumerate() {
                let Some(any) = view.iter().find_map(|c| c[j]) else {
                    continue;
                };
                column.alpha.push(any.alpha);
                column.view.push(k as u32);
                pixels.push(any.pixels);
                let own = outline_sigma[k] / local.rad().cos();
                for (c, of_channel) in view.iter().enumerate() {
                    let sample = of_channel[j];
                    column.value[c].push(sample.map_or(0.0, |s| s.value));
                    column.variance[c].push(sample.map_or(f64::INFINITY, |s| {
                        s.variance + (s.slope * own).powi(2) + floor[c]
                    }));
                    slopes[c].push(sample.map_or(0.0, |s| s.slope));
                }
            }
            (column, pixels, slopes)
        })
        .collect();
    let mut columns = Vec::with_capacity(locals.len());
    for (column, pixels, of_column) in gathered {
        columns.push(column);
        all_pixels.push(pixels);
        for (all, of_channel) in slopes.iter_mut().zip(of_column) {
            all.push(of_channel);
        }
    }
    Gathered {
        samples: Samples { channels, columns },
        pixels: all_pixels,
        slopes,
    }
}

impl Column {
    /// If all α lie on one regular circle −π + (i + ½)·2π/n in order (as [`Samples::from_grid`] makes
    /// them), its n: then sums over the column are FFTs.
    pub fn regular(&self) -> Option<usize> {
        let n = self.alpha.len();
        let step = 2.0 * PI / n as f64;
        let regular = n > 0
            && self.alpha.iter().enumerate().all(|(i, a)| {
                // Rounding of −π + (i + ½)·step is below 1e-15; 1e-12 is far below any real spacing.
                (a - (-PI + (i as f64 + 0.5) * step)).abs() < 1e-12
            });
        regular.then_some(n)
    }
}
