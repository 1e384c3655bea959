//! The (α, θo′) grid of a light field: its size, its cell centres and its wrap-around.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use serde::{Deserialize, Serialize};

use crate::angle::{LocalAngle, NormalAngle, wrap};

/// A regular grid: `normals` rows over the full circle of α, `locals` columns over θo′ in (−90°, 90°).
///
/// Row i has its centre at α = −π + (i + ½)·2π/normals, column j at θo′ = −π/2 + (j + ½)·π/locals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Grid {
    /// Rows, bins of α over [−π, π); they wrap.
    pub normals: usize,
    /// Columns, bins of θo′ over (−π/2, π/2).
    pub locals: usize,
}

impl Grid {
    /// Number of cells.
    pub fn len(&self) -> usize {
        self.normals * self.locals
    }

    /// Whether the grid has no cell.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Width of a row in α, radians.
    pub fn normal_step(&self) -> f64 {
        TAU / self.normals as f64
    }

    /// Width of a column in θo′, radians.
    pub fn local_step(&self) -> f64 {
        PI / self.locals as f64
    }

    /// α at the centre of row `i`.
    pub fn normal(&self, i: usize) -> NormalAngle {
        NormalAngle::radians(-PI + (i as f64 + 0.5) * self.normal_step())
    }

    /// θo′ at the centre of column `j`.
    pub fn local(&self, j: usize) -> LocalAngle {
        LocalAngle::radians(-FRAC_PI_2 + (j as f64 + 0.5) * self.local_step())
    }

    /// The row whose bin holds α (after wrapping).
    pub fn row(&self, normal: NormalAngle) -> usize {
        let i = ((wrap(normal.rad()) + PI) / self.normal_step()) as usize;
        i.min(self.normals - 1)
    }

    /// Index of cell (row `i`, column `j`) in a row-major array of [`Grid::len`] values.
    pub fn index(&self, i: usize, j: usize) -> usize {
        i * self.locals + j
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_centre_lies_in_its_own_row() {
        let grid = Grid {
            normals: 720,
            locals: 180,
        };
        for i in 0..grid.normals {
            assert_eq!(grid.row(grid.normal(i)), i);
        }
        assert_eq!(grid.row(NormalAngle::radians(PI)), 0);
        assert!((grid.local(0).deg() + 89.5).abs() < 1e-12);
        assert!((grid.local(179).deg() - 89.5).abs() < 1e-12);
    }
}
