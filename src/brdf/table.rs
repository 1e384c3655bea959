//! The measured slice: ρ on a regular grid of (θi′, θo′), as `brdf.csv` holds it, and its interpolation.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use super::Brdf;
use crate::angle::LocalAngle;
use crate::error::nearest;
use crate::{Error, Result};

/// Cells a table may have: 4000 × 4000, finer than any capture.
const MOST_CELLS: usize = 16_000_000;

/// Coefficients beyond either end of an axis that an evaluation within ±90° can touch.
const PAD: usize = 2;

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
    fn position(&self, angle: LocalAngle) -> f64 {
        let offset = if self.inclusive { 0.0 } else { 0.5 };
        (angle.rad() + FRAC_PI_2) / self.step() - offset
    }

    /// Whether angle number `i` is ±90°, where ρ cos cos is zero whatever ρ is.
    fn is_horizon(&self, i: usize) -> bool {
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
        let text = std::fs::read_to_string(path).map_err(|e| Error::read(path, e))?;
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
        let attempt = || -> std::io::Result<()> {
            let mut file = atomic_write_file::AtomicWriteFile::open(path)?;
            file.write_all(self.to_csv().as_bytes())?;
            file.commit()
        };
        attempt().map_err(|e| Error::write(path, e))
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
fn tidy(degrees: f64) -> f64 {
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

/// A BRDF from a table of one channel.
///
/// Interpolates ρ̃ = ρ cos θi′ cos θo′ by a tensor cubic spline: ρ̃ is smooth and falls to 0 at ±90°, where ρ itself may
/// be singular. ρ̃ is continued as an odd function across ±90°. Noise stays as it is: values may be negative.
#[derive(Clone, Debug)]
pub struct MeasuredSlice {
    incident: Axis,
    exitant: Axis,
    /// B-spline coefficients of ρ̃ with `PAD` more on either side, \[(i + PAD) · (exitant.count + 2 PAD) + j + PAD\].
    coefficients: Vec<f64>,
}

impl MeasuredSlice {
    /// From ρ\[i · exitant.count + j\], sr⁻¹; a NaN is taken from the mirrored cell (θo′, θi′).
    ///
    /// # Errors
    /// If the shape is wrong or a cell stays without a value.
    pub fn new(incident: Axis, exitant: Axis, rho: &[f64]) -> Result<Self> {
        let (ni, no) = (incident.count, exitant.count);
        if ni < 2 || no < 2 || rho.len() != ni * no {
            return Err(Error::input(format!(
                "expected a table of at least 2 × 2 angles, found {ni} × {no} with {} values",
                rho.len()
            )));
        }
        let mut tilde = vec![0.0; ni * no];
        let mut holes = Vec::new();
        for i in 0..ni {
            for j in 0..no {
                if incident.is_horizon(i) || exitant.is_horizon(j) {
                    continue;
                }
                let mut value = rho[i * no + j];
                if value.is_nan() && incident == exitant {
                    value = rho[j * no + i];
                }
                if !value.is_finite() {
                    holes.push((i, j));
                }
                let cosines =
                    incident.angle(i).visible_cosine() * exitant.angle(j).visible_cosine();
                tilde[i * no + j] = value * cosines;
            }
        }
        if let Some(&(i, j)) = holes.first() {
            return Err(Error::input(format!(
                "expected a value in every cell, or in its mirrored one; {} of {} have none, the first at \
                 θi′ = {}°, θo′ = {}°",
                holes.len(),
                ni * no,
                tidy(incident.angle(i).deg()),
                tidy(exitant.angle(j).deg())
            ))
            .advice("Measure with more views or a smaller limb cut, or use the fitted model instead of the table."));
        }
        for row in tilde.chunks_mut(no) {
            spline_coefficients(row, exitant.inclusive);
        }
        for j in 0..no {
            let mut column: Vec<f64> = (0..ni).map(|i| tilde[i * no + j]).collect();
            spline_coefficients(&mut column, incident.inclusive);
            for (i, c) in column.into_iter().enumerate() {
                tilde[i * no + j] = c;
            }
        }
        // PAD coefficients beyond either end, by the odd continuation across the horizon.
        let width = no + 2 * PAD;
        let mut coefficients = vec![0.0; (ni + 2 * PAD) * width];
        for i in 0..ni + 2 * PAD {
            let (source_i, sign_i) = continued(i, incident);
            for j in 0..width {
                let (source_j, sign_j) = continued(j, exitant);
                coefficients[i * width + j] = sign_i * sign_j * tilde[source_i * no + source_j];
            }
        }
        Ok(Self {
            incident,
            exitant,
            coefficients,
        })
    }

    /// ρ̃(θi′, θo′) = ρ cos θi′ cos θo′, sr⁻¹; 0 below the horizon.
    pub fn tilde(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        if !incident.is_visible() || !exitant.is_visible() {
            return 0.0;
        }
        let (i, wi) = stencil(self.incident.position(incident), self.incident.count);
        let (j, wj) = stencil(self.exitant.position(exitant), self.exitant.count);
        let width = self.exitant.count + 2 * PAD;
        let mut sum = 0.0;
        for (k, a) in wi.iter().enumerate() {
            let start = (i + k) * width + j;
            let row = self.coefficients.get(start..start + 4).unwrap_or(&[]);
            sum += a * row.iter().zip(&wj).map(|(c, b)| c * b).sum::<f64>();
        }
        sum
    }
}

/// Index and sign of the coefficient that stands at padded position `at`: the odd continuation's centre is the end
/// point itself if that is on the horizon, else half a step beyond it.
fn continued(at: usize, axis: Axis) -> (usize, f64) {
    let n = axis.count;
    let beyond = usize::from(axis.inclusive);
    if at < PAD {
        ((PAD - 1 - at + beyond).min(n - 1), -1.0)
    } else if at < PAD + n {
        (at - PAD, 1.0)
    } else {
        (n.saturating_sub(1 + (at - PAD - n) + beyond), -1.0)
    }
}

/// Turns values into cubic B-spline coefficients in place: (c_{k−1} + 4 c_k + c_{k+1})/6 = f_k with the odd
/// continuation, by elimination in the tridiagonal system.
fn spline_coefficients(values: &mut [f64], inclusive: bool) {
    let n = values.len();
    // An odd continuation makes an end on the horizon 0 by itself; half a step before it, c_{−1} = −c_0.
    let end = if inclusive { 4.0 } else { 3.0 };
    let off = |k: usize| {
        if inclusive && (k == 0 || k + 1 == n) {
            0.0
        } else {
            1.0
        }
    };
    let mut upper = vec![0.0; n];
    let mut before = (0.0, 0.0);
    for (k, value) in values.iter_mut().enumerate() {
        let diagonal = if k == 0 || k + 1 == n { end } else { 4.0 };
        let pivot = diagonal - off(k) * before.0;
        upper[k] = off(k) / pivot;
        *value = (6.0 * *value - off(k) * before.1) / pivot;
        before = (upper[k], *value);
    }
    for k in (0..n.saturating_sub(1)).rev() {
        values[k] -= upper[k] * values[k + 1];
    }
}

/// First padded coefficient and the four weights of the cubic B-spline at `position`, which lies within half a step of
/// the axis.
fn stencil(position: f64, count: usize) -> (usize, [f64; 4]) {
    let k = position.floor().clamp(-1.0, count as f64 - 1.0);
    let t = position - k;
    let s = 1.0 - t;
    let weights = [
        s * s * s / 6.0,
        (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
        (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
        t * t * t / 6.0,
    ];
    // Weights belong to k − 1 … k + 2.
    ((k + PAD as f64 - 1.0) as usize, weights)
}

impl Brdf for MeasuredSlice {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        let cosines = incident.visible_cosine() * exitant.visible_cosine();
        if cosines > 0.0 {
            self.tilde(incident, exitant) / cosines
        } else {
            0.0
        }
    }

    fn lobe_width(&self) -> f64 {
        2.0 * self.incident.step()
    }

    /// Every fourth knot of the spline, so that measured detail is resolved everywhere.
    fn kinks(&self, _exitant: LocalAngle) -> Vec<f64> {
        (0..self.incident.count)
            .step_by(4)
            .map(|i| self.incident.angle(i).rad())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{GgxConductor, Material, transfer_row};
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
    fn a_tabulated_metal_has_the_transfer_function_of_the_metal() {
        for (count, inclusive) in [(181, true), (180, false)] {
            let slice = table(Axis { count, inclusive })
                .slice("Y")
                .expect("complete");
            for degrees in [-80.0, -79.25, -60.5, -30.0, 0.0, 0.5, 44.3, 70.0, 80.0] {
                let exitant = LocalAngle::degrees(degrees);
                let exact = transfer_row(&METAL, exitant, 30);
                let found = transfer_row(&slice, exitant, 30);
                let scale = exact.iter().map(|h| h.norm()).fold(0.0, f64::max);
                for (p, (a, b)) in exact.iter().zip(&found).enumerate() {
                    // Cubic spline: h⁴ f⁗/384 with f = (1 + x²)⁻², x = h/0.2 rad per step, is 1e-5 of the
                    // peak; the odd continuation at the horizon adds some 1e-4.
                    assert!((a - b).norm() < 1e-3 * scale, "{degrees}° p={p}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn the_spline_passes_through_its_values() {
        let axis = Axis {
            count: 90,
            inclusive: false,
        };
        let slice = table(axis)
            .slice("any name: there is one channel only")
            .expect("complete");
        for i in 0..90 {
            for j in 0..90 {
                let (a, b) = (axis.angle(i), axis.angle(j));
                let exact = METAL.value(a, b);
                assert!(
                    (slice.value(a, b) - exact).abs() < 1e-9 * (1.0 + exact),
                    "{i} {j}"
                );
            }
        }
        assert_eq!(
            slice.value(LocalAngle::degrees(91.0), LocalAngle::degrees(0.0)),
            0.0
        );
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
