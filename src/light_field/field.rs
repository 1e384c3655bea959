//! The gridded light field: mean, σ and weight per cell.

use rayon::prelude::*;

use super::{Column, Samples};
use crate::grid::Grid;

/// B(α, θo′) on a grid, as `light_field.exr` holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct LightField {
    /// Size and position of the cells.
    pub grid: Grid,
    /// Channel names.
    pub channels: Vec<String>,
    /// B at the cell's centre, W m⁻² sr⁻¹ (or the capture's relative unit), \[channel\]\[cell\]; 0 where
    /// the weight is 0.
    pub mean: Vec<Vec<f32>>,
    /// Standard deviation of the mean, \[channel\]\[cell\]; 0 where the weight is 0.
    pub sigma: Vec<Vec<f32>>,
    /// Number of pixels behind the cell, \[channel\]\[cell\]; 0: never seen.
    pub weight: Vec<Vec<f32>>,
}

impl LightField {
    /// A field in which nothing has been seen.
    pub fn empty(grid: Grid, channels: Vec<String>) -> Self {
        let blank = vec![vec![0.0; grid.len()]; channels.len()];
        Self {
            grid,
            channels,
            mean: blank.clone(),
            sigma: blank.clone(),
            weight: blank,
        }
    }

    /// The cells that any channel has seen, as samples at their centres; their `view` is the cell's row.
    pub fn samples(&self) -> Samples {
        let column = |j: usize| {
            let seen = |i: &usize| {
                let at = self.grid.index(*i, j);
                self.weight.iter().any(|weight| weight[at] > 0.0)
            };
            let rows: Vec<usize> = (0..self.grid.normals).filter(seen).collect();
            let pick = |c: usize, of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
                rows.iter().map(|&i| of(c, self.grid.index(i, j))).collect()
            };
            let channels = 0..self.channels.len();
            let variance = |c: usize, at: usize| match self.weight[c][at] > 0.0 {
                true => f64::from(self.sigma[c][at]).powi(2),
                false => f64::INFINITY,
            };
            Column {
                local: self.grid.local(j),
                alpha: rows.iter().map(|&i| self.grid.normal(i).rad()).collect(),
                view: rows.iter().map(|&i| i as u32).collect(),
                value: channels
                    .clone()
                    .map(|c| pick(c, &|c, at| f64::from(self.mean[c][at])))
                    .collect(),
                variance: channels.map(|c| pick(c, &variance)).collect(),
            }
        };
        Samples {
            channels: self.channels.clone(),
            columns: (0..self.grid.locals).into_par_iter().map(column).collect(),
        }
    }

    /// Fraction of the cells with |θo′| ≤ `limb_cut` (radians) that were seen in `channel`.
    pub fn coverage(&self, channel: usize, limb_cut: f64) -> f64 {
        let within: Vec<bool> = (0..self.grid.locals)
            .map(|j| self.grid.local(j).rad().abs() <= limb_cut)
            .collect();
        let all = within.iter().filter(|within| **within).count() * self.grid.normals;
        let rows = self.weight[channel].chunks(self.grid.locals.max(1));
        let seen: usize = rows
            .map(|row| {
                let both = row.iter().zip(&within);
                both.filter(|(weight, within)| **within && **weight > 0.0)
                    .count()
            })
            .sum();
        if all == 0 {
            0.0
        } else {
            seen as f64 / all as f64
        }
    }
}
