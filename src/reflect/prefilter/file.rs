//! The prefiltered table in files.
//!
//! Both hold the same cells: row i is α = −180° + (i + ½)·360°/normals, column j is
//! θo′ = −90° + (j + ½)·180°/locals; B in W m⁻² sr⁻¹ if the light is in W m⁻² rad⁻¹ and the BRDF in 1/sr.

use std::fmt::Write as _;
use std::path::Path;

use exr::prelude::{AttributeValue, LayerAttributes};

use super::Prefiltered;
use crate::error::Result;
use crate::files;
use crate::lighting::environment::write_planes;

impl Prefiltered {
    /// Writes the table as a 32-bit EXR image, locals wide and normals high; the header states both axes
    /// and the unit.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, file: &Path) -> Result<()> {
        let mut attributes = LayerAttributes::default();
        for (name, text) in [
            ("rows", "alpha_deg: from -180 at the top edge to 180"),
            (
                "columns",
                "theta_o_local_deg: from -90 at the left edge to 90",
            ),
            ("unit", "W m^-2 sr^-1"),
        ] {
            let value = AttributeValue::Text(text.into());
            attributes.other.insert(name.into(), value);
        }
        let size = [self.grid.locals, self.grid.normals];
        write_planes(file, size, &self.channels, single(&self.value), attributes)
    }

    /// Writes the table as CSV with the columns `alpha_deg,theta_o_deg,B_<channel>…`, α outer.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_csv(&self, file: &Path) -> Result<()> {
        let mut text = String::from("alpha_deg,theta_o_deg");
        for name in &self.channels {
            let _ = write!(text, ",B_{name}");
        }
        text.push('\n');
        for i in 0..self.grid.normals {
            // Of integers, so that a step of half a degree is written as such.
            let alpha = -180.0 + 180.0 * (2 * i + 1) as f64 / self.grid.normals as f64;
            for j in 0..self.grid.locals {
                let local = -90.0 + 90.0 * (2 * j + 1) as f64 / self.grid.locals as f64;
                let _ = write!(text, "{alpha},{local}");
                for channel in &self.value {
                    let _ = write!(text, ",{}", channel[self.grid.index(i, j)]);
                }
                text.push('\n');
            }
        }
        files::write_whole(file, text.as_bytes())
    }

    /// Writes an image of [`Prefiltered::view`] as a 32-bit EXR file.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_view(&self, file: &Path, size: [usize; 2], view: &[Vec<f64>]) -> Result<()> {
        let attributes = LayerAttributes::default();
        write_planes(file, size, &self.channels, single(view), attributes)
    }
}

fn single(planes: &[Vec<f64>]) -> Vec<Vec<f32>> {
    let plane = |v: &Vec<f64>| v.iter().map(|&b| b as f32).collect();
    planes.iter().map(plane).collect()
}
