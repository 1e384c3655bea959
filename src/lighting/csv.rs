//! Lighting in files: the table `theta_deg,L_R,…,sigma_R,…` and the spectrum
//! `channel,p,re,im,sigma,status`.

use std::fmt::Write as _;
use std::path::Path;

use num_complex::Complex64;
use serde::{Deserialize, Serialize};

use super::Lighting;
use crate::error::{Error, Result, nearest};
use crate::files;

/// A lighting as read from a table, with the standard deviations that stood beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct LightingTable {
    /// The light.
    pub lighting: Lighting,
    /// θ of each line, radians, \[n\].
    pub angles: Vec<f64>,
    /// L of each line, W m⁻² rad⁻¹, \[channel\]\[n\].
    pub values: Vec<Vec<f64>>,
    /// σ of L, \[channel\]\[n\]; `None` where the file states none.
    pub sigma: Vec<Vec<Option<f64>>>,
}

/// Reads a table of lighting: header `theta_deg,L_<channel>…` with optional `sigma_<channel>` columns,
/// lines at any regular step from any angle that close the circle.
///
/// # Errors
/// With file and line: a column that is not known, a field that is no number or is missing, angles
/// that are not regular or do not wrap at 360°.
pub fn read_table(file: &Path) -> Result<LightingTable> {
    let text = files::text(file)?;
    parse_table(&text).map_err(|e| e.file(file))
}

fn parse_table(text: &str) -> Result<LightingTable> {
    let mut lines = numbered(text);
    let Some((number, header)) = lines.next() else {
        return Err(Error::input(
            "expected the header theta_deg,L_<channel>…, found an empty file",
        ));
    };
    let columns: Vec<Columns> = columns(header).map_err(|e| e.line(number))?;
    let mut channels: Vec<String> = Vec::new();
    for column in &columns {
        if let Columns::Light(name) = column {
            if channels.contains(name) {
                return Err(Error::input(format!("the column L_{name} stands twice")).line(number));
            }
            channels.push(name.clone());
        }
    }
    if !matches!(columns.first(), Some(Columns::Angle)) || channels.is_empty() {
        return Err(Error::input(format!(
            "expected a header that starts with theta_deg and has a column L_<channel>, found {header:?}"
        ))
        .line(number));
    }
    for column in &columns {
        if let Columns::Sigma(name) = column
            && !channels.contains(name)
        {
            return Err(Error::input(format!(
                "the column sigma_{name} has no column L_{name} beside it"
            ))
            .line(number));
        }
    }

    let mut degrees: Vec<f64> = Vec::new();
    let mut values = vec![Vec::new(); channels.len()];
    let mut sigma = vec![Vec::new(); channels.len()];
    for (number, line) in lines {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if fields.len() != columns.len() {
            return Err(Error::input(format!(
                "expected {} fields as in the header, found {}",
                columns.len(),
                fields.len()
            ))
            .line(number));
        }
        let mut stated = vec![None; channels.len()];
        for (column, field) in columns.iter().zip(fields) {
            let place = |e: Error| e.line(number).key(column.name());
            match column {
                Columns::Angle => degrees.push(parse_number(field).map_err(place)?),
                Columns::Light(name) => {
                    let value = parse_number(field).map_err(place)?;
                    if let Some(c) = channels.iter().position(|n| n == name) {
                        values[c].push(value);
                    }
                }
                Columns::Sigma(_) if field.is_empty() => {}
                Columns::Sigma(name) => {
                    let value = parse_number(field).map_err(place)?;
                    if value < 0.0 {
                        return Err(place(Error::input(format!(
                            "expected a standard deviation of 0 or more, found {value}"
                        ))));
                    }
                    if let Some(c) = channels.iter().position(|n| n == name) {
                        stated[c] = Some(value);
                    }
                }
            }
        }
        for (all, one) in sigma.iter_mut().zip(stated) {
            all.push(one);
        }
        regular_so_far(&degrees).map_err(|e| e.line(number))?;
    }
    close_circle(&mut degrees, &mut values, &mut sigma)?;

    let start = degrees.first().copied().unwrap_or(-180.0).to_radians();
    Ok(LightingTable {
        lighting: Lighting::from_samples(channels, &values, start),
        angles: degrees.iter().map(|d| d.to_radians()).collect(),
        values,
        sigma,
    })
}

/// Lines with their numbers from 1, without the empty ones.
fn numbered(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.trim_start_matches('\u{feff}')
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim_end()))
        .filter(|(_, line)| !line.is_empty())
}

enum Columns {
    Angle,
    Light(String),
    Sigma(String),
}

impl Columns {
    fn name(&self) -> String {
        match self {
            Self::Angle => "theta_deg".into(),
            Self::Light(name) => format!("L_{name}"),
            Self::Sigma(name) => format!("sigma_{name}"),
        }
    }
}

fn columns(header: &str) -> Result<Vec<Columns>> {
    header
        .split(',')
        .map(str::trim)
        .map(|name| match name {
            "theta_deg" => Ok(Columns::Angle),
            _ => match (name.strip_prefix("L_"), name.strip_prefix("sigma_")) {
                (Some(channel), _) if !channel.is_empty() => Ok(Columns::Light(channel.into())),
                (_, Some(channel)) if !channel.is_empty() => Ok(Columns::Sigma(channel.into())),
                _ => {
                    let known = ["theta_deg", "L_R", "L_G", "L_B", "L_Y", "sigma_R", "sigma_Y"];
                    let error = Error::input(format!(
                        "expected columns theta_deg, L_<channel> and sigma_<channel>, found {name:?}"
                    ));
                    Err(match nearest(name, &known) {
                        Some(near) => error.advice(format!("Did you mean {near}?")),
                        None => error,
                    })
                }
            },
        })
        .collect()
}

fn parse_number(field: &str) -> Result<f64> {
    match field.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ if field.is_empty() => Err(Error::input("expected a number, found an empty field")
            .advice(
                "Light must be known at every angle of the table; write 0 where there is none.",
            )),
        _ => Err(Error::input(format!(
            "expected a finite number, found {field:?}"
        ))),
    }
}

/// Angles in files may carry as few as four decimals.
const ANGLE_SLACK_DEG: f64 = 1e-4;

fn regular_so_far(degrees: &[f64]) -> Result<()> {
    let [first, second, .., last] = degrees else {
        return match degrees {
            [a, b] if b <= a => Err(Error::input(format!(
                "expected increasing angles, found {b} after {a}"
            ))),
            _ => Ok(()),
        };
    };
    let step = second - first;
    let expected = degrees
        .len()
        .checked_sub(2)
        .and_then(|i| degrees.get(i))
        .map_or(*last, |previous| previous + step);
    if (last - expected).abs() > 2.0 * ANGLE_SLACK_DEG {
        return Err(Error::input(format!(
            "expected a regular step of {step}°, so {expected}, found {last}"
        )));
    }
    Ok(())
}

fn close_circle(
    degrees: &mut Vec<f64>,
    values: &mut [Vec<f64>],
    sigma: &mut [Vec<Option<f64>>],
) -> Result<()> {
    let n = degrees.len();
    let (Some(&first), Some(&last)) = (degrees.first(), degrees.last()) else {
        return Err(Error::input(
            "expected lines with values, found only the header",
        ));
    };
    if n == 1 {
        return Ok(());
    }
    // The same direction once more at the end is allowed if it says the same.
    if (last - first - 360.0).abs() < ANGLE_SLACK_DEG {
        let closes = values.iter().all(|v| v.first() == v.last());
        if !closes {
            return Err(Error::input(format!(
                "{first}° and {last}° are the same direction and have different values"
            ))
            .advice("A table of lighting must wrap: leave the last line out or make it equal to the first."));
        }
        degrees.pop();
        for v in values.iter_mut() {
            v.pop();
        }
        for s in sigma.iter_mut() {
            s.pop();
        }
        return Ok(());
    }
    let step = (last - first) / (n - 1) as f64;
    if (step * n as f64 - 360.0).abs() > ANGLE_SLACK_DEG * n as f64 {
        return Err(Error::input(format!(
            "expected angles that close the circle, found {n} lines at {step}° from {first}° to {last}°, which span {}°",
            step * n as f64
        ))
        .advice("A table of lighting must cover the full circle once at a regular step."));
    }
    Ok(())
}

/// Writes `n` lines of lighting from −180°: `theta_deg,L_…` and, if `sigma` (\[channel\]\[n\]) is given,
/// `sigma_…`; a σ that is not finite becomes an empty field. A source becomes the values beside it,
/// see [`Lighting::tabulated`].
///
/// # Errors
/// If the file cannot be written.
pub fn write_table(
    file: &Path,
    lighting: &Lighting,
    n: usize,
    sigma: Option<&[Vec<f64>]>,
) -> Result<()> {
    let text = values_csv(&lighting.channels, &lighting.tabulated(n), sigma);
    write_whole(file, &text)
}

/// The text that [`write_table`] writes, from values at regular angles from −180°, \[channel\]\[n\].
pub fn values_csv(channels: &[String], values: &[Vec<f64>], sigma: Option<&[Vec<f64>]>) -> String {
    let n = values.first().map_or(0, Vec::len);
    let mut text = String::from("theta_deg");
    for name in channels {
        let _ = write!(text, ",L_{name}");
    }
    if sigma.is_some() {
        for name in channels {
            let _ = write!(text, ",sigma_{name}");
        }
    }
    text.push('\n');
    for i in 0..n {
        let _ = write!(text, "{}", -180.0 + 360.0 * i as f64 / n as f64);
        for channel in values {
            let _ = write!(text, ",{}", channel[i]);
        }
        for channel in sigma.unwrap_or_default() {
            text.push(',');
            if let Some(s) = channel.get(i).filter(|s| s.is_finite()) {
                let _ = write!(text, "{s}");
            }
        }
        text.push('\n');
    }
    text
}

/// How well a coefficient is determined by the photographs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Known better than its own size or the noise asks for.
    Determined,
    /// Seen, but with large uncertainty or held by a prior.
    Weak,
    /// Not seen at all; the value is 0 or the prior's.
    Indeterminate,
}

impl Status {
    /// The word in the files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Determined => "determined",
            Self::Weak => "weak",
            Self::Indeterminate => "indeterminate",
        }
    }
}

/// One coefficient L_p of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectrumRow {
    /// Channel name.
    pub channel: String,
    /// Frequency, p ≥ 0.
    pub p: usize,
    /// L_p (eq. 6), W m⁻² rad⁻¹.
    pub value: Complex64,
    /// Standard deviation of the real and of the imaginary part of L_p; `None` if unknown.
    pub sigma: Option<f64>,
    /// How well it is determined.
    pub status: Status,
}

/// Writes `channel,p,re,im,sigma,status`.
///
/// # Errors
/// If the file cannot be written.
pub fn write_spectrum(file: &Path, rows: &[SpectrumRow]) -> Result<()> {
    write_whole(file, &spectrum_csv(rows))
}

/// The text that [`write_spectrum`] writes.
pub fn spectrum_csv(rows: &[SpectrumRow]) -> String {
    let mut text = String::from("channel,p,re,im,sigma,status\n");
    for row in rows {
        let (value, status) = (row.value, row.status.word());
        let _ = write!(text, "{},{},{},{},", row.channel, row.p, value.re, value.im);
        if let Some(s) = row.sigma.filter(|s| s.is_finite()) {
            let _ = write!(text, "{s}");
        }
        let _ = writeln!(text, ",{status}");
    }
    text
}

/// Reads a spectrum as [`write_spectrum`] writes it, or without σ and status, as a truth has them: then every
/// coefficient is determined.
///
/// # Errors
/// With file and line, for a header or a field that is not as expected.
pub fn read_spectrum(file: &Path) -> Result<Vec<SpectrumRow>> {
    let text = files::text(file)?;
    let mut lines = numbered(&text);
    let expected = "channel,p,re,im,sigma,status";
    match lines.next() {
        Some((_, header)) if header == expected || header == "channel,p,re,im" => {}
        other => {
            let found = other.map_or("", |(_, h)| h);
            return Err(
                Error::input(format!("expected the header {expected}, found {found:?}"))
                    .file(file)
                    .line(1),
            );
        }
    }
    lines
        .map(|(number, line)| parse_spectrum_row(line).map_err(|e| e.file(file).line(number)))
        .collect()
}

fn parse_spectrum_row(line: &str) -> Result<SpectrumRow> {
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    let [channel, p, re, im, sigma, status] = match fields.as_slice() {
        [channel, p, re, im] => [*channel, *p, *re, *im, "", "determined"],
        [channel, p, re, im, sigma, status] => [*channel, *p, *re, *im, *sigma, *status],
        _ => {
            return Err(Error::input(format!(
                "expected 6 fields, found {}",
                fields.len()
            )));
        }
    };
    let status = match status {
        "determined" => Status::Determined,
        "weak" => Status::Weak,
        "indeterminate" => Status::Indeterminate,
        other => {
            return Err(Error::input(format!(
                "expected determined, weak or indeterminate, found {other:?}"
            ))
            .key("status"));
        }
    };
    Ok(SpectrumRow {
        channel: channel.into(),
        p: p.parse().map_err(|_| {
            Error::input(format!("expected a frequency of 0 or more, found {p:?}")).key("p")
        })?,
        value: Complex64::new(
            parse_number(re).map_err(|e| e.key("re"))?,
            parse_number(im).map_err(|e| e.key("im"))?,
        ),
        sigma: match sigma {
            "" => None,
            s => Some(parse_number(s).map_err(|e| e.key("sigma"))?),
        },
        status,
    })
}

fn write_whole(file: &Path, text: &str) -> Result<()> {
    files::write_whole(file, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;
    use crate::angle::WorldAngle;
    use crate::fourier::Series;
    use crate::lighting::Source;

    fn order_12() -> Series {
        let coefficients = (0..=12)
            .map(|p| match p {
                0 => Complex64::new(2.0, 0.0),
                _ => Complex64::cis(1.7 * f64::from(p)) / f64::from(1 + p),
            })
            .collect();
        Series { coefficients }
    }

    fn round_trip(lighting: &Lighting, n: usize, sigma: Option<&[Vec<f64>]>) -> LightingTable {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("lighting.csv");
        write_table(&file, lighting, n, sigma).unwrap();
        read_table(&file).unwrap()
    }

    #[test]
    fn a_half_degree_table_of_order_12_light_comes_back_exactly_between_its_values() {
        let names = vec!["R".into(), "band_2".into()];
        let light =
            Lighting::band_limited(names.clone(), vec![order_12(), order_12().rotated(0.3)]);
        let sigma = vec![vec![0.25; 720], vec![f64::INFINITY; 720]];
        let read = round_trip(&light, 720, Some(&sigma));
        assert_eq!(read.lighting.channels, names);
        assert_eq!(read.sigma[0][17], Some(0.25));
        assert_eq!(read.sigma[1][17], None);
        assert!(read.lighting.table.is_empty());
        for c in 0..2 {
            for k in 0..1000 {
                let theta = WorldAngle::radians(0.01234 + 0.0063 * f64::from(k));
                // Decimal round trip is exact; two transforms of length 720 lose a few 2⁻⁵².
                let error = read.lighting.density(c, theta) - light.density(c, theta);
                assert!(error.abs() < 1e-12, "{error}");
            }
        }
    }

    #[test]
    fn a_table_with_a_sun_neither_rings_nor_loses_irradiance() {
        let mut light = Lighting::from_sources(
            vec!["Y".into()],
            vec![Source {
                theta: WorldAngle::degrees(37.3),
                irradiance: vec![5.0],
            }],
        );
        light.table = vec![vec![0.1]];
        let read = round_trip(&light, 720, None).lighting;
        for k in 0..3600 {
            let theta = WorldAngle::degrees(0.1 * f64::from(k));
            let l = read.density(0, theta);
            assert!(l >= 0.1 - 1e-12);
            let near = (theta.deg() - 37.3).abs() < 1.0;
            assert!(near || (l - 0.1).abs() < 1e-12, "{} {l}", theta.deg());
        }
        let total = light.total_irradiance(0);
        assert!((read.total_irradiance(0) - total).abs() < 1e-12 * total);
        // The centroid is kept: the phase of L_1 differs by the spread of the two values only,
        // E·t(1 − t)Δ²/2 with Δ = 0.5°.
        let lost = read.series(0, 1).coefficients[1] - light.series(0, 1).coefficients[1];
        assert!(
            lost.norm()
                < 5.0 / TAU * 0.125 * (PI / 360.0).powi(2)
                    + 5.0 / TAU * (PI / 360.0).powi(2) / 12.0 * 1.01
        );
    }

    #[test]
    fn an_off_lattice_table_keeps_its_shape() {
        // 24 values from −172.5°: an edge, so linear; the knots lie half a step off the lattice.
        let values = vec![
            (0..24)
                .map(|i| f64::from(u8::from(i < 9)))
                .collect::<Vec<f64>>(),
        ];
        let light = Lighting::from_samples(vec!["Y".into()], &values, (-172.5f64).to_radians());
        for (i, v) in values[0].iter().enumerate() {
            let theta = WorldAngle::degrees(-172.5 + 15.0 * i as f64);
            assert!((light.density(0, theta) - v).abs() < 1e-12);
            let beyond = WorldAngle::degrees(theta.deg() + 5.0);
            let next = values[0][(i + 1) % 24];
            assert!((light.density(0, beyond) - (v * 2.0 + next) / 3.0).abs() < 1e-9);
        }
    }

    #[test]
    fn faults_are_reported_with_their_line() {
        let fault = |text: &str| parse_table(text).unwrap_err().to_string();
        assert!(fault("").contains("empty file"));
        assert!(fault("theta_deg,L_Y\n").contains("only the header"));
        assert!(fault("theta,L_Y\n0,1\n").contains("Did you mean theta_deg?"));
        assert!(fault("theta_deg,L_Y,sigma_R\n0,1,1\n").contains("no column L_R"));
        let message = fault("theta_deg,L_Y\n-180,1\n-90,x\n");
        assert!(message.contains("line 3") && message.contains("L_Y") && message.contains("\"x\""));
        assert!(fault("theta_deg,L_Y\n-180,1\n-90,nan\n").contains("finite"));
        assert!(fault("theta_deg,L_Y\n-180,1\n-90,\n").contains("empty field"));
        assert!(fault("theta_deg,L_Y\n-180,1\n-90,1\n10,1\n").contains("line 4"));
        assert!(fault("theta_deg,L_Y\n-180,1\n-90,1\n0,1\n").contains("close the circle"));
        assert!(fault("theta_deg,L_Y\n-180,1\n0,1\n180,2\n").contains("same direction"));
        assert!(fault("theta_deg,L_Y\n-180,1,2\n").contains("expected 2 fields"));
        assert!(parse_table("theta_deg,L_Y\r\n-180,1\r\n0,1\r\n180,1\r\n").is_ok());
    }

    #[test]
    fn a_spectrum_comes_back() {
        let rows = vec![
            SpectrumRow {
                channel: "R".into(),
                p: 0,
                value: Complex64::new(1.0 / 3.0, 0.0),
                sigma: Some(1e-5),
                status: Status::Determined,
            },
            SpectrumRow {
                channel: "R".into(),
                p: 3,
                value: Complex64::ZERO,
                sigma: None,
                status: Status::Indeterminate,
            },
        ];
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("lighting_spectrum.csv");
        write_spectrum(&file, &rows).unwrap();
        assert_eq!(read_spectrum(&file).unwrap(), rows);
        std::fs::write(&file, "channel,p,re,im,sigma,status\nR,1,2,3,4,good\n").unwrap();
        let message = read_spectrum(&file).unwrap_err().to_string();
        assert!(message.contains(":2") && message.contains("good"));
    }
}
