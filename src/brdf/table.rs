//! ρ on a regular grid of (θi′, θo′), as `brdf.csv` holds it.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt::Write as _;
use std::path::Path;

use super::{Brdf, MeasuredSlice};
use crate::angle::LocalAngle;
use crate::error::nearest;
use crate::files;
use crate::{Error, Result};

/// Cells a table may have: 2000 × 2000, finer than any capture.
const MOST_CELLS: usize = 4_000_000;

/// A regular axis of a local angle over [−90°, 90°].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis {
    /// Number of angles, ≥ 2.
    pub count: usize,
    /// Whether ±90° themselves are on the axis; else they lie half a step beyond its ends.
    pub inclusive: bool,
}

impl Axis {
    /// Distance between neighbours, radians.
    pub fn step(&self) -> f64 {
        let intervals = if self.inclusive {
            self.count.saturating_sub(1)
        } else {
            self.count
        };
        PI / intervals.max(1) as f64
    }

    /// Angle number `i`.
    pub fn angle(&self, i: usize) -> LocalAngle {
        let offset = if self.inclusive { 0.0 } else { 0.5 };
        LocalAngle::radians((i as f64 + offset) * self.step() - FRAC_PI_2)
    }

    /// Position of an angle in steps: `i` at angle number `i`.
    pub(crate) fn position(&self, angle: LocalAngle) -> f64 {
        let offset = if self.inclusive { 0.0 } else { 0.5 };
        (angle.rad() + FRAC_PI_2) / self.step() - offset
    }

    /// Whether angle number `i` is ±90°, where ρ cos cos is zero whatever ρ is.
    pub(super) fn is_horizon(&self, i: usize) -> bool {
        self.inclusive && (i == 0 || i + 1 == self.count)
    }

    /// The axis that consists of these angles in degrees, sorted and distinct.
    fn of(degrees: &[f64]) -> Option<Self> {
        [true, false].into_iter().find_map(|inclusive| {
            let axis = Self {
                count: degrees.len(),
                inclusive,
            };
            // Files may carry angles with five decimals; real steps are far larger.
            let near = |(i, d): (usize, &f64)| (axis.angle(i).deg() - d).abs() < 1e-4;
            (axis.count >= 2 && degrees.iter().enumerate().all(near)).then_some(axis)
        })
    }
}

/// ρ and its σ on a grid, per channel: the content of `brdf.csv`.
#[derive(Clone, Debug, PartialEq)]
pub struct SliceTable {
    /// Channel names.
    pub channels: Vec<String>,
    /// θi′.
    pub incident: Axis,
    /// θo′.
    pub exitant: Axis,
    /// ρ, sr⁻¹, \[channel\]\[i · exitant.count + j\] for incident i and exitant j; NaN where not measured.
    pub rho: Vec<Vec<f64>>,
    /// σ of ρ, the same shape, NaN where not known; empty if there is none at all.
    pub sigma: Vec<Vec<f64>>,
}

impl SliceTable {
    /// The values of `material` on a grid, without σ. Its delta part is not a value and is left out.
    pub fn of(material: &super::Material, incident: Axis, exitant: Axis) -> Self {
        let cells = |brdf: &dyn Brdf| {
            (0..incident.count * exitant.count)
                .map(|c| {
                    brdf.value(
                        incident.angle(c / exitant.count),
                        exitant.angle(c % exitant.count),
                    )
                })
                .collect()
        };
        Self {
            channels: material.channels.clone(),
            incident,
            exitant,
            rho: material.brdfs.iter().map(|b| cells(b.as_ref())).collect(),
            sigma: Vec::new(),
        }
    }

    /// Reads `brdf.csv`: `theta_i_deg,theta_o_deg,rho_…` and, if there, `sigma_…` of the same channels. Lines in
    /// any order; an empty field or an absent line is a cell that was not measured.
    ///
    /// # Errors
    /// If the file cannot be read or is not such a table, with the line.
    pub fn read(path: &Path) -> Result<Self> {
        let text = files::text(path)?;
        Self::parse(&text).map_err(|e| e.file(path))
    }

    /// The same, from text.
    ///
    /// # Errors
    /// As [`SliceTable::read`].
    pub fn parse(text: &str) -> Result<Self> {
        let mut lines = text
            .trim_start_matches('\u{feff}')
            .lines()
            .enumerate()
            .map(|(n, l)| (n + 1, l.trim()))
            .filter(|(_, l)| !l.is_empty());
        let (first, header) = lines
            .next()
            .ok_or_else(|| Error::input("expected a header line, found an empty file"))?;
        let columns = Columns::of(header).map_err(|e| e.line(first))?;
        let rows: Vec<Row> = lines
            .map(|(n, line)| columns.row(line, n).map_err(|e| e.line(n)))
            .collect::<Result<_>>()?;
        let incident = axis_of(rows.iter().map(|r| r.incident), "theta_i_deg")?;
        let exitant = axis_of(rows.iter().map(|r| r.exitant), "theta_o_deg")?;
        let cells = incident.count * exitant.count;
        if cells > MOST_CELLS {
            return Err(Error::input(format!(
                "expected at most {MOST_CELLS} cells, found {} × {}",
                incident.count, exitant.count
            )));
        }
        let mut table = Self {
            rho: vec![vec![f64::NAN; cells]; columns.channels.len()],
            sigma: if columns.sigma.is_empty() {
                Vec::new()
            } else {
                vec![vec![f64::NAN; cells]; columns.channels.len()]
            },
            channels: columns.channels,
            incident,
            exitant,
        };
        let mut line_of: HashMap<usize, usize> = HashMap::with_capacity(rows.len());
        for row in rows {
            let i = incident.position(LocalAngle::degrees(row.incident)).round() as usize;
            let j = exitant.position(LocalAngle::degrees(row.exitant)).round() as usize;
            let cell = i * exitant.count + j;
            if let Some(before) = line_of.insert(cell, row.line) {
                return Err(Error::input(format!(
                    "expected each pair of angles once, found {}°, {}° again (first in line {before})",
                    row.incident, row.exitant
                ))
                .line(row.line));
            }
            let fields = table.rho.iter_mut().chain(&mut table.sigma);
            for (values, v) in fields.zip(row.values) {
                values[cell] = v;
            }
        }
        Ok(table)
    }

    /// The text of `brdf.csv`; every f64 reads back exactly, a cell without a value is an empty field.
    pub fn to_csv(&self) -> String {
        let mut text = String::from("theta_i_deg,theta_o_deg");
        for name in &self.channels {
            let _ = write!(text, ",rho_{name}");
        }
        if !self.sigma.is_empty() {
            for name in &self.channels {
                let _ = write!(text, ",sigma_{name}");
            }
        }
        text.push('\n');
        for i in 0..self.incident.count {
            for j in 0..self.exitant.count {
                let _ = write!(
                    text,
                    "{},{}",
                    tidy(self.incident.angle(i).deg()),
                    tidy(self.exitant.angle(j).deg())
                );
                for values in self.rho.iter().chain(&self.sigma) {
                    let v = values
                        .get(i * self.exitant.count + j)
                        .copied()
                        .unwrap_or(f64::NAN);
                    text.push(',');
                    if v.is_finite() {
                        let _ = write!(text, "{v}");
                    }
                }
                text.push('\n');
            }
        }
        text
    }

    /// Writes `brdf.csv`, whole or not at all.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        files::write_whole(path, self.to_csv().as_bytes())
    }

    /// The interpolated BRDF of the channel of this name. A table with one channel serves any name.
    ///
    /// # Errors
    /// If there is no such channel, or a cell has no value and neither has its mirrored cell.
    pub fn slice(&self, name: &str) -> Result<MeasuredSlice> {
        let found = self.channels.iter().position(|c| c == name);
        let index = match (found, self.channels.len()) {
            (Some(index), _) => index,
            (None, 1) => 0,
            (None, _) => {
                let names: Vec<&str> = self.channels.iter().map(String::as_str).collect();
                let advice = nearest(name, &names)
                    .map_or_else(String::new, |n| format!(" Is rho_{n} meant?"));
                return Err(Error::input(format!(
                    "expected a column rho_{name}, found channels {}",
                    names.join(", ")
                ))
                .advice(format!("The table needs one column for each channel of the photos, or a single one for all.{advice}")));
            }
        };
        let rho = self.rho.get(index).map_or(&[][..], Vec::as_slice);
        MeasuredSlice::new(self.incident, self.exitant, rho)
    }
}

/// Degrees without the rounding noise of radians: 1e-9° is far below the tolerance of reading.
pub(super) fn tidy(degrees: f64) -> f64 {
    let rounded = (degrees * 1e9).round() / 1e9;
    if rounded == 0.0 { 0.0 } else { rounded }
}

/// Which field of a line is what.
struct Columns {
    channels: Vec<String>,
    incident: usize,
    exitant: usize,
    rho: Vec<usize>,
    sigma: Vec<usize>,
    count: usize,
}

struct Row {
    line: usize,
    incident: f64,
    exitant: f64,
    values: Vec<f64>,
}

impl Columns {
    fn of(header: &str) -> Result<Self> {
        let names: Vec<&str> = header.split(',').map(str::trim).collect();
        let find = |wanted: &str| {
            names.iter().position(|n| *n == wanted).ok_or_else(|| {
                Error::input(format!("expected a column {wanted}, found {}", names.join(",")))
                    .key(wanted)
                    .advice("The header is theta_i_deg,theta_o_deg,rho_R,… with the channels' names, then sigma_R,… if known.")
            })
        };
        let channels: Vec<String> = names
            .iter()
            .filter_map(|n| n.strip_prefix("rho_"))
            .map(String::from)
            .collect();
        if channels.is_empty() {
            return Err(find("rho_Y")
                .err()
                .unwrap_or_else(|| Error::input("no channel")));
        }
        for (k, name) in names.iter().enumerate() {
            let known = ["theta_i_deg", "theta_o_deg"].contains(name)
                || name.starts_with("rho_")
                || name.starts_with("sigma_");
            if !known || names[..k].contains(name) {
                return Err(Error::input("unknown column, or one that is there twice").key(*name));
            }
        }
        let has_sigma = names.iter().any(|n| n.starts_with("sigma_"));
        Ok(Self {
            incident: find("theta_i_deg")?,
            exitant: find("theta_o_deg")?,
            rho: channels
                .iter()
                .map(|c| find(&format!("rho_{c}")))
                .collect::<Result<_>>()?,
            sigma: if has_sigma {
                channels
                    .iter()
                    .map(|c| find(&format!("sigma_{c}")))
                    .collect::<Result<_>>()?
            } else {
                Vec::new()
            },
            channels,
            count: names.len(),
        })
    }

    fn row(&self, line: &str, number: usize) -> Result<Row> {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if fields.len() != self.count {
            return Err(Error::input(format!(
                "expected {} fields, found {}",
                self.count,
                fields.len()
            )));
        }
        let value = |k: usize| {
            let text = fields.get(k).copied().unwrap_or_default();
            match text.parse::<f64>() {
                _ if text.is_empty() => Ok(f64::NAN),
                Ok(v) if v.is_finite() => Ok(v),
                _ => Err(Error::input(format!(
                    "expected a finite number or nothing, found \"{text}\""
                ))),
            }
        };
        let angle = |k: usize| {
            let v = value(k)?;
            if (-90.0001..=90.0001).contains(&v) {
                Ok(v)
            } else {
                Err(Error::input(format!(
                    "expected an angle in −90 to 90, found \"{}\"",
                    fields[k]
                )))
            }
        };
        let sigma = |k: usize| match value(k)? {
            v if v < 0.0 => Err(Error::input(format!(
                "expected a σ of at least 0, found {v}"
            ))),
            v => Ok(v),
        };
        let mut values = self
            .rho
            .iter()
            .map(|&k| value(k))
            .collect::<Result<Vec<_>>>()?;
        for &k in &self.sigma {
            values.push(sigma(k)?);
        }
        Ok(Row {
            line: number,
            incident: angle(self.incident)?,
            exitant: angle(self.exitant)?,
            values,
        })
    }
}

fn axis_of(angles: impl Iterator<Item = f64>, name: &str) -> Result<Axis> {
    let mut distinct: Vec<f64> = angles.collect();
    distinct.sort_by(f64::total_cmp);
    // Twice the tolerance with which an angle may miss its place on the axis.
    distinct.dedup_by(|b, a| (*a - *b).abs() < 2e-4);
    Axis::of(&distinct).ok_or_else(|| {
        let span = match distinct.as_slice() {
            [first, .., last] => format!("{} angles from {first} to {last}", distinct.len()),
            _ => format!("{} angle(s)", distinct.len()),
        };
        Error::input(format!(
            "expected equal steps from −90 to 90, with the ends on the grid or half a step beyond it; found {span}"
        ))
        .key(name)
        .advice("Cells that were not measured may be left empty, but the angles must be there.")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{GgxConductor, Material};
    use std::sync::Arc;

    const METAL: GgxConductor = GgxConductor {
        alpha: 0.1,
        eta: 0.2,
        k: 3.9,
        specular: 0.8,
    };

    fn table(axis: Axis) -> SliceTable {
        let material = Material {
            channels: vec!["Y".into()],
            brdfs: vec![Arc::new(METAL)],
        };
        SliceTable::of(&material, axis, axis)
    }

    #[test]
    fn a_file_reads_back_exactly_with_its_holes() {
        let mut table = table(Axis {
            count: 37,
            inclusive: true,
        });
        table.sigma = vec![table.rho[0].iter().map(|r| 0.01 * r + 1e-7).collect()];
        table.rho[0][5 * 37 + 9] = f64::NAN;
        table.sigma[0][5 * 37 + 9] = f64::NAN;
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("brdf.csv");
        table.write(&path).expect("writable");
        let again = SliceTable::read(&path).expect("what was written");
        assert_eq!(again.to_csv(), table.to_csv());
        let bits = |t: &SliceTable| -> Vec<u64> {
            t.rho[0]
                .iter()
                .chain(&t.sigma[0])
                .map(|v| v.to_bits())
                .collect()
        };
        assert_eq!(bits(&again), bits(&table));
        // The hole's mirrored cell is there; without it the table is refused.
        assert!(again.slice("Y").is_ok());
        table.rho[0][9 * 37 + 5] = f64::NAN;
        let error = table
            .slice("Y")
            .expect_err("a hole on both sides")
            .to_string();
        assert!(
            error.contains("2 of 1369 have none, the first at θi′ = -65°, θo′ = -45°"),
            "{error}"
        );
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_a_table_or_an_error(
            lines in proptest::collection::vec("(-?(90|45|0|22\\.5)|),-?(90|45|0|x),[0-9.e-]{0,6}(,[0-9]{1,2})?", 0..30),
            sigma in proptest::bool::ANY,
        ) {
            let header = if sigma { "theta_i_deg,theta_o_deg,rho_Y,sigma_Y" } else { "theta_i_deg,theta_o_deg,rho_Y" };
            if let Ok(table) = SliceTable::parse(&format!("{header}\n{}", lines.join("\n"))) {
                let again = SliceTable::parse(&table.to_csv()).expect("what was written is readable");
                proptest::prop_assert_eq!(again.to_csv(), table.to_csv());
                if let Ok(slice) = table.slice("Y") {
                    proptest::prop_assert!(slice.value(LocalAngle::degrees(10.0), LocalAngle::degrees(-80.0)).is_finite());
                }
            }
        }
    }

    #[test]
    fn faulty_files_say_where() {
        let header = "theta_i_deg,theta_o_deg,rho_Y\n";
        for (text, expected) in [
            (String::new(), "empty file"),
            ("theta_i_deg,rho_Y\n".into(), "theta_o_deg"),
            ("theta_i_deg,theta_o_deg\n".into(), "rho_Y"),
            ("theta_i_deg,theta_o_deg,rho_Y,rho_Y\n".into(), "twice"),
            (
                format!("{header}0,0\n"),
                "line 2: expected 3 fields, found 2",
            ),
            (format!("{header}0,0,x\n"), "found \"x\""),
            (format!("{header}0,0,nan\n"), "found \"nan\""),
            (format!("{header}0,100,1\n"), "−90 to 90"),
            (format!("{header},0,1\n"), "−90 to 90"),
            (
                format!("{header}-90,-90,1\n0,0,1\n45,45,1\n"),
                "equal steps",
            ),
            (
                format!("{header}-45,-45,1\n45,45,1\n-45,-45,2\n"),
                "line 4: expected each pair",
            ),
            (format!("{header}-45,-45,1\n"), "equal steps"),
            (
                "theta_i_deg,theta_o_deg,rho_Y,sigma_Y\n-45,-45,1,-1\n".into(),
                "σ of at least 0",
            ),
        ] {
            let error = SliceTable::parse(&text).expect_err(expected).to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
