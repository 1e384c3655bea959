//! The measured slice as a table in the manner of ASTM E1392 (angle-resolved scatter): a head of keywords, then a line per pair of
//! directions with polar angles and azimuths in degrees.

use std::fmt::Write as _;

use crate::brdf::SliceTable;
use crate::error::{Error, Result};

const HEAD: &str = "theta_i_deg,phi_i_deg,theta_s_deg,phi_s_deg";

/// The table: `theta_i_deg,phi_i_deg,theta_s_deg,phi_s_deg,brdf_X…,sigma_X…` with ρ in `unit`. A signed angle of the plane is a polar angle with
/// azimuth 0° if positive and 180° if negative. A value that is not determined is an empty field.
pub fn encode(table: &SliceTable, sample: &str, unit: &str) -> String {
    let (rows, columns) = (table.incident.count, table.exitant.count);
    let mut text = format!(
        "# ASTM E1392-style table of the BRDF in the plane of incidence\n\
         # SAMPLE {}\n# SOURCE flatlight {}\n# VALUE BRDF without cosine, {unit}\n\
         # PLANE all directions lie in one plane: azimuths are 0 or 180\n# NUM_POINTS {}\n{HEAD}",
        sample.replace(['\n', '\r'], " "),
        env!("CARGO_PKG_VERSION"),
        rows * columns
    );
    for layer in ["brdf", "sigma"] {
        for name in &table.channels {
            let _ = write!(text, ",{layer}_{name}");
        }
    }
    text.push('\n');
    for cell in 0..rows * columns {
        let angles = [
            table.incident.angle(cell / columns),
            table.exitant.angle(cell % columns),
        ];
        for angle in angles.map(|a| a.deg()) {
            let azimuth = if angle < 0.0 { 180 } else { 0 };
            let _ = write!(text, "{},{azimuth},", angle.abs());
        }
        let layers = table
            .rho
            .iter()
            .map(Some)
            .chain((0..table.channels.len()).map(|c| table.sigma.get(c)));
        let fields: Vec<String> = layers
            .map(|layer| layer.and_then(|l| l.get(cell)).copied())
            .map(|v| {
                v.filter(|v| v.is_finite())
                    .map_or_else(String::new, |v| v.to_string())
            })
            .collect();
        text += &fields.join(",");
        text.push('\n');
    }
    text
}

/// Reads such a table back as a slice.
///
/// # Errors
/// If the columns are not those that [`encode`] writes, a field is not a number, or the directions are not the square grid of cells.
pub fn decode(text: &str) -> Result<SliceTable> {
    let mut lines = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.starts_with('#') && !line.trim().is_empty());
    let (at, head) = lines
        .next()
        .ok_or_else(|| Error::input("expected a line of column names, found none"))?;
    let columns = head
        .strip_prefix(HEAD)
        .and_then(|rest| rest.strip_prefix(','))
        .ok_or_else(|| {
            Error::input(format!(
                "expected columns that begin with {HEAD}, found {head}"
            ))
            .line(at + 1)
        })?;
    let columns: Vec<&str> = columns.split(',').collect();
    let channels: Vec<String> = columns
        .iter()
        .filter_map(|c| c.strip_prefix("brdf_").map(str::to_owned))
        .collect();
    let layers = channels.len();
    // The same as this program's own brdf.csv, whose reader checks the grid.
    let mut csv = String::from("theta_i_deg,theta_o_deg");
    for layer in ["rho", "sigma"] {
        for name in &channels {
            let _ = write!(csv, ",{layer}_{name}");
        }
    }
    csv.push('\n');
    if columns.len() != 2 * layers || layers == 0 {
        return Err(Error::input(format!(
            "expected a column sigma_X for each column brdf_X, found {}",
            columns.join(",")
        ))
        .line(at + 1));
    }
    for (at, line) in lines {
        let fields: Vec<&str> = line.split(',').collect();
        let signed = |theta: usize| -> Result<f64> {
            let number = |k: usize| {
                let field = fields.get(k).copied().unwrap_or_default();
                field.trim().parse::<f64>().map_err(|_| {
                    Error::input(format!("expected a number, found \"{field}\"")).line(at + 1)
                })
            };
            let azimuth = number(theta + 1)?;
            if azimuth != 0.0 && azimuth != 180.0 {
                return Err(Error::input(format!(
                    "expected the azimuth 0 or 180 in the plane of incidence, found {azimuth}"
                ))
                .line(at + 1));
            }
            Ok(number(theta)? * if azimuth == 0.0 { 1.0 } else { -1.0 })
        };
        let rest = fields.get(4..).unwrap_or_default();
        let _ = writeln!(csv, "{},{},{}", signed(0)?, signed(2)?, rest.join(","));
    }
    SliceTable::parse(&csv)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::Axis;

    #[test]
    fn a_table_is_read_back_as_it_was() {
        let axis = Axis {
            count: 6,
            inclusive: false,
        };
        // Every double that is written is read back; a hole stays a hole.
        let layer = |c: f64| -> Vec<f64> {
            (0..36)
                .map(|k| {
                    if k == 7 {
                        f64::NAN
                    } else {
                        c / (1.0 + f64::from(k))
                    }
                })
                .collect()
        };
        let table = SliceTable {
            channels: vec!["R".into(), "550 nm".into()],
            incident: axis,
            exitant: axis,
            rho: vec![layer(1.0), layer(7.3)],
            sigma: vec![layer(1e-3), layer(1e-9)],
        };
        let text = encode(&table, "a name\nof two lines", "1/sr");
        let back = decode(&text).expect("a table");
        assert_eq!(back.channels, table.channels);
        assert_eq!([back.incident, back.exitant], [axis; 2]);
        let bits =
            |v: &[Vec<f64>]| -> Vec<u64> { v.iter().flatten().map(|v| v.to_bits()).collect() };
        assert_eq!(bits(&back.rho), bits(&table.rho));
        assert_eq!(bits(&back.sigma), bits(&table.sigma));
    }

    #[test]
    fn what_is_not_in_the_plane_or_no_number_is_an_error_with_its_line() {
        let head = format!("# x\n{HEAD},brdf_Y,sigma_Y\n");
        for (line, word) in [
            ("10,90,10,0,1,0.1", "azimuth"),
            ("ten,0,10,0,1,0.1", "\"ten\""),
            ("10", "\"\""),
        ] {
            let error = decode(&format!("{head}{line}\n"))
                .expect_err(line)
                .to_string();
            assert!(error.contains(word) && error.contains('3'), "{error}");
        }
        assert!(decode("").is_err());
        assert!(decode("a,b\n1,2\n").is_err());
    }
}
