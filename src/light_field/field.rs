//! The gridded light field: mean, σ and weight per cell.

use super::Samples;
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

    /// The cells as samples at their centres; cells that were never seen are missing.
    pub fn samples(&self) -> Samples {
        let value: Vec<Vec<f64>> = self
            .mean
            .iter()
            .map(|m| m.iter().map(|&v| f64::from(v)).collect())
            .collect();
        let variance: Vec<Vec<f64>> = self
            .sigma
            .iter()
            .zip(&self.weight)
            .map(|(sigma, weight)| {
                sigma
                    .iter()
                    .zip(weight)
                    .map(|(s, w)| {
                        if *w > 0.0 {
                            f64::from(*s).powi(2)
                        } else {
                            f64::INFINITY
                        }
                    })
                    .collect()
            })
            .collect();
        Samples::from_grid(self.grid, self.channels.clone(), &value, &variance)
    }

    /// Fraction of the cells with |θo′| ≤ `limb_cut` (radians) that were seen in `channel`.
    pub fn coverage(&self, channel: usize, limb_cut: f64) -> f64 {
        let (mut seen, mut all) = (0usize, 0usize);
        for j in 0..self.grid.locals {
            if self.grid.local(j).rad().abs() > limb_cut {
                continue;
            }
            for i in 0..self.grid.normals {
                all += 1;
                seen += usize::from(self.weight[channel][self.grid.index(i, j)] > 0.0);
            }
        }
        if all == 0 {
            0.0
        } else {
            seen as f64 / all as f64
        }
    }
}
