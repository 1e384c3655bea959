//! Isotropic BRDFs in the binary form of the MERL database.
//!
//! W. Matusik, H. Pfister, M. Brand, L. McMillan, "A data-driven reflectance model", SIGGRAPH 2003; the layout is that of the
//! database's files: three little-endian 32-bit integers 90, 90, 180, then float64 values, all of red, then green, then blue, each
//! \[θh\]\[θd\]\[φd\], in units of 1/1500, 1.15/1500 and 1.66/1500 sr⁻¹. Cells are θh = 90° (i/90)², θd = j·1°, φd = k·1° (Rusinkiewicz's half and difference angles; φd and φd + 180° are
//! the same by reciprocity), and hold the value at the cell's centre; a reader takes the cell that its angles fall into.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

use rayon::prelude::*;

use super::{IN_PLANE, Surface, rgb, unit};
use crate::brdf::Pair;
use crate::error::{Error, Result};
use crate::pipeline::Run;

/// Cells along θh, θd and φd.
pub const SIZE: [usize; 3] = [90, 90, 180];
/// sr⁻¹ per unit in red, green and blue.
const UNIT: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];
const CELLS: usize = SIZE[0] * SIZE[1] * SIZE[2];

/// A table in memory, in sr⁻¹.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Red, green, blue, each \[θh\]\[θd\]\[φd\]; negative where the database has no value.
    pub values: [Vec<f64>; 3],
}

/// θh, θd, φd at the centre of a cell, radians.
fn centre(cell: usize) -> [f64; 3] {
    let [_, difference, azimuth] = SIZE;
    let i = cell / (difference * azimuth);
    let j = cell / azimuth % difference;
    let k = cell % azimuth;
    let root = (i as f64 + 0.5) / SIZE[0] as f64;
    [
        FRAC_PI_2 * root * root,
        FRAC_PI_2 * (j as f64 + 0.5) / difference as f64,
        PI * (k as f64 + 0.5) / azimuth as f64,
    ]
}

/// The two directions of a cell's centre as a pair; `None` where one of them is below the horizon.
fn pair(half: f64, difference: f64, azimuth: f64) -> Option<Pair> {
    let (sh, ch) = half.sin_cos();
    let (sd, cd) = difference.sin_cos();
    let (sp, cp) = azimuth.sin_cos();
    // The difference vector in the frame of the half vector, turned about the binormal by θh.
    let turned = |x: f64| [ch * x * cp + sh * cd, x * sp, -sh * x * cp + ch * cd];
    Pair::between([0.0, 0.0, 1.0], turned(sd), turned(-sd))
}

/// The bytes of a MERL file of a surface. Cells of directions below the horizon hold −1, as in the database.
///
/// # Errors
/// For a mirror, and for channels that are neither R, G and B nor a single one.
pub fn encode(surface: &Surface) -> Result<Vec<u8>> {
    let of = rgb(&surface.channels)?;
    let rho = surface.in_space().ok_or_else(|| {
        Error::input("expected a BRDF with finite values for a MERL table, found a mirror")
    })?;
    let mut bytes = Vec::with_capacity(12 + 24 * CELLS);
    for size in SIZE {
        bytes.extend((size as i32).to_le_bytes());
    }
    for (c, unit) in of.into_iter().zip(UNIT) {
        let function = rho.get(c).ok_or_else(|| {
            Error::failed(format!("the surface has no parameters for channel {c}"))
        })?;
        let values: Vec<f64> = (0..CELLS)
            .into_par_iter()
            .map(|cell| {
                let [half, difference, azimuth] = centre(cell);
                pair(half, difference, azimuth).map_or(-1.0, |pair| function(&pair) / unit)
            })
            .collect();
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    }
    Ok(bytes)
}

impl Table {
    /// Reads a MERL file.
    ///
    /// # Errors
    /// If the file cannot be read or does not have the database's size.
    pub fn read(file: &Path) -> Result<Self> {
        let bytes = std::fs::read(file).map_err(|e| Error::read(file, e))?;
        Self::decode(&bytes).map_err(|e| e.file(file))
    }

    /// The same from bytes.
    ///
    /// # Errors
    /// If they do not have the database's size.
    pub fn decode(bytes: &[u8]) -> Result<Self> {
        let expected: Vec<u8> = SIZE
            .iter()
            .flat_map(|s| (*s as i32).to_le_bytes())
            .collect();
        if bytes.get(..12) != Some(&expected[..]) || bytes.len() != 12 + 24 * CELLS {
            return Err(Error::input(format!(
                "expected a MERL table of 90 × 90 × 180 cells, {} bytes, found {} bytes or another head",
                12 + 24 * CELLS,
                bytes.len()
            )));
        }
        let mut numbers = bytes[12..].chunks_exact(8).map(|eight| {
            let mut buffer = [0; 8];
            buffer.copy_from_slice(eight);
            f64::from_le_bytes(buffer)
        });
        let values = UNIT.map(|unit| {
            let colour = numbers.by_ref().take(CELLS);
            colour.map(|v| if v < 0.0 { v } else { v * unit }).collect()
        });
        Ok(Self { values })
    }

    /// ρ of the colour (0 red, 1 green, 2 blue) for polar angles and the azimuth between the directions,
    /// radians: the value of the cell, as the database's own reader takes it. `None` for no such value.
    pub fn rho(&self, colour: usize, incident: f64, exitant: f64, azimuth: f64) -> Option<f64> {
        let a = [incident.sin(), 0.0, incident.cos()];
        let b = [
            exitant.sin() * azimuth.cos(),
            exitant.sin() * azimuth.sin(),
            exitant.cos(),
        ];
        let sum = [0, 1, 2].map(|k| a[k] + b[k]);
        let length = sum.iter().map(|v| v * v).sum::<f64>().sqrt();
        let half = sum.map(|v| v / length);
        let sin_half = half[0].hypot(half[1]);
        let theta_half = sin_half.atan2(half[2]);
        // The incident direction, turned so that the half vector becomes the normal.
        let (c, s) = if sin_half > 0.0 {
            (half[0] / sin_half, half[1] / sin_half)
        } else {
            (1.0, 0.0)
        };
        let along = c * a[0] + s * a[1];
        let x = theta_half.cos() * along - theta_half.sin() * a[2];
        let y = c * a[1] - s * a[0];
        let z = theta_half.sin() * along + theta_half.cos() * a[2];
        let theta_difference = x.hypot(y).atan2(z);
        let phi = y.atan2(x).rem_euclid(PI);
        let index = |share: f64, count: usize| ((share * count as f64) as usize).min(count - 1);
        let i = index((theta_half / FRAC_PI_2).max(0.0).sqrt(), SIZE[0]);
        let j = index(theta_difference / FRAC_PI_2, SIZE[1]);
        let k = index(phi / PI, SIZE[2]);
        let values = self.values.get(colour)?;
        let value = values.get((i * SIZE[1] + j) * SIZE[2] + k).copied()?;
        (value >= 0.0).then_some(value)
    }
}

/// The label beside the table.
pub fn label(run: &Run, surface: &Surface) -> String {
    format!(
        "{}\n\nbrdf.binary: isotropic BRDF in the form of the MERL database, 90 x 90 x 180 cells (theta_h, theta_d, phi_d), values at the cells' centres.\n\
         {IN_PLANE} A slice in the plane of incidence is phi_d = 0 of this table and does not determine the rest.\n\n{}\
         unit: {}\nmade by flatlight {}\n",
        run.capture_name,
        surface.describe(),
        unit(run),
        run.version
    )
}

#[cfg(test)]
mod tests {
    use super::super::surface::Layer;
    use super::*;
    use crate::brdf::Family;

    fn surface(family: Family, values: &[f64]) -> Surface {
        Surface {
            channels: ["R", "G", "B"].map(str::to_owned).to_vec(),
            family,
            layers: (0..3)
                .map(|c| Layer {
                    values: values.to_vec(),
                    lambert: 0.1 * f64::from(c),
                    scale: 1.0,
                    error: 0.0,
                })
                .collect(),
            origin: String::new(),
        }
    }

    /// At the centre of every cell above the horizon the table gives back the model, to rounding.
    #[test]
    fn a_table_is_read_back_as_the_model_that_was_written() {
        for (family, values) in [
            (Family::GgxConductor, vec![0.2, 0.2, 3.9, 1.0]),
            (Family::Phong, vec![0.3, 0.4, 32.0]),
        ] {
            let surface = surface(family, &values);
            let bytes = encode(&surface).expect("a table");
            assert_eq!(bytes.len(), 34_992_012);
            let table = Table::decode(&bytes).expect("the same table");
            let rho = surface.in_space().expect("finite");
            let mut above = 0;
            for cell in (0..CELLS).step_by(97) {
                let [half, difference, azimuth] = centre(cell);
                let Some(pair) = pair(half, difference, azimuth) else {
                    assert!(table.values[0][cell] < 0.0);
                    continue;
                };
                above += 1;
                let (incident, exitant) = (pair.cos_incident.acos(), pair.cos_exitant.acos());
                let between = pair.cos_azimuth.clamp(-1.0, 1.0).acos();
                for (c, rho) in rho.iter().enumerate() {
                    let read = table.rho(c, incident, exitant, between);
                    let read = read.expect("above the horizon");
                    let exact = rho(&pair);
                    assert!(
                        (read - exact).abs() < 1e-12 * (1.0 + exact),
                        "{cell}: {read} {exact}"
                    );
                }
            }
            assert!(
                above > CELLS / 97 / 3,
                "{above} cells are above the horizon"
            );
        }
    }

    #[test]
    fn other_sizes_are_refused() {
        assert!(Table::decode(&[0; 100]).is_err());
        assert!(encode(&surface(Family::Mirror, &[1.0])).is_err());
    }
}
