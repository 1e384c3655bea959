//! What is compared: the products of a run, as values at points.

use std::collections::HashMap;
use std::path::Path;

use crate::brdf::{MeasuredSlice, SliceTable};
use crate::error::{Error, Result};
use crate::files;
use crate::light_field::LightField;
use crate::lighting::{read_spectrum, read_table};
use crate::{LocalAngle, WorldAngle};

/// Coordinates of a value: degrees, or frequencies and then the part of the complex number (0 real, 1 imaginary).
pub type Point = [f64; 3];

/// The kinds of products.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `lighting.csv`.
    Lighting,
    /// `lighting_spectrum.csv`.
    LightingSpectrum,
    /// `brdf.csv`, compared as ρ cos θi′ cos θo′, which stays finite towards the horizon.
    Brdf,
    /// `brdf_spectrum.csv`.
    BrdfSpectrum,
    /// `light_field.exr`.
    LightField,
}

impl Kind {
    /// The files of a run folder that are compared.
    pub const FILES: [&'static str; 5] = [
        "light_field.exr",
        "lighting.csv",
        "lighting_spectrum.csv",
        "brdf.csv",
        "brdf_spectrum.csv",
    ];

    /// What a person calls it.
    pub fn words(self) -> &'static str {
        match self {
            Self::Lighting => "a lighting",
            Self::LightingSpectrum => "a spectrum of a lighting",
            Self::Brdf => "a BRDF",
            Self::BrdfSpectrum => "a spectrum of a BRDF",
            Self::LightField => "a light field",
        }
    }

    /// Names of the coordinates.
    pub fn axes(self) -> &'static [&'static str] {
        match self {
            Self::Lighting => &["theta_deg"],
            Self::LightingSpectrum => &["p", "part"],
            Self::Brdf => &["theta_i_deg", "theta_o_deg"],
            Self::BrdfSpectrum => &["p", "q", "part"],
            Self::LightField => &["alpha_deg", "theta_o_deg"],
        }
    }

    /// A point in words.
    pub fn place(self, point: Point) -> String {
        let [a, b, c] = point;
        let part = |c: f64| if c == 0.0 { "real" } else { "imaginary" };
        match self {
            Self::Lighting => format!("θ = {a}°"),
            Self::LightingSpectrum => format!("p = {a} ({} part)", part(b)),
            Self::Brdf => format!("θi′ = {a}°, θo′ = {b}°"),
            Self::BrdfSpectrum => format!("p = {a}, q = {b} ({} part)", part(c)),
            Self::LightField => format!("α = {a}°, θo′ = {b}°"),
        }
    }

    /// What [`Kind::part`] parts by.
    pub fn parted_by(self) -> &'static str {
        match self {
            Self::Lighting => "error by θ",
            Self::LightingSpectrum | Self::BrdfSpectrum => "error by p",
            Self::Brdf => "error by the larger of |θi′| and |θo′|",
            Self::LightField => "error by |θo′|",
        }
    }

    /// The part of the product that a point lies in.
    pub fn part(self, point: Point) -> String {
        let band = |value: f64, step: f64| {
            let low = (value / step).floor() * step;
            format!("{low}…{}°", low + step)
        };
        let [a, b, _] = point;
        match self {
            Self::Lighting => band(a, 45.0),
            Self::LightingSpectrum | Self::BrdfSpectrum => format!("{a}"),
            Self::Brdf => band(a.abs().max(b.abs()).min(89.999), 15.0),
            Self::LightField => band(b.abs().min(89.999), 15.0),
        }
    }
}

/// A product: values at points, and between them where that has a meaning.
#[derive(Debug)]
pub struct Product {
    /// What it is.
    pub kind: Kind,
    /// Channel names.
    pub channels: Vec<String>,
    /// The points of its table.
    pub points: Vec<Point>,
    values: Values,
}

/// A value and its σ, where there is one.
pub type Measured = (f64, Option<f64>);

#[derive(Debug)]
enum Values {
    /// By point, \[channel\].
    Listed(Vec<HashMap<[i64; 3], Measured>>),
    /// \[channel\]\[i\], at equal steps from `start` (degrees) around the circle.
    Circle {
        start: f64,
        table: Vec<Vec<Measured>>,
    },
    /// The table, and each channel's interpolation if it has no hole.
    Slice(SliceTable, Vec<Option<MeasuredSlice>>),
}

/// Points are the same up to this many parts of a unit: files carry at least six digits.
const PARTS: f64 = 1e5;

fn key(point: Point) -> [i64; 3] {
    point.map(|v| (v * PARTS).round() as i64)
}

impl Product {
    /// Reads a product, of the kind that its header says.
    ///
    /// # Errors
    /// If the file cannot be read or is none of the products that are compared.
    pub fn read(file: &Path) -> Result<Self> {
        let mut start = [0; 4];
        let read = std::io::Read::read(&mut files::open(file)?.0, &mut start)
            .map_err(|e| Error::read(file, e))?;
        // The magic number of OpenEXR.
        if start[..read] == [0x76, 0x2f, 0x31, 0x01] {
            return Self::light_field(file);
        }
        let text = files::text(file)?;
        let header = text.lines().next().unwrap_or("").trim();
        let names: Vec<&str> = header.split(',').collect();
        match names.as_slice() {
            ["theta_i_deg", "theta_o_deg", ..] => Self::slice(file),
            ["theta_deg", ..] => Self::lighting(file),
            ["channel", "p", "q", ..] => brdf_spectrum(&text).map_err(|e| e.file(file)),
            ["channel", "p", ..] => Self::lighting_spectrum(file),
            _ => Err(Error::input(format!(
                "expected one of {}, found a file that begins with {:?}",
                Kind::FILES.join(", "),
                header.chars().take(60).collect::<String>()
            ))
            .file(file)),
        }
    }

    fn lighting(file: &Path) -> Result<Self> {
        let table = read_table(file)?;
        let points = table
            .angles
            .iter()
            .map(|a| [WorldAngle::radians(*a).deg(), 0.0, 0.0])
            .collect();
        let rows = table.values.iter().zip(&table.sigma);
        Ok(Self {
            kind: Kind::Lighting,
            points,
            values: Values::Circle {
                start: table.angles.first().map_or(0.0, |a| a.to_degrees()),
                table: rows
                    .map(|(v, s)| v.iter().copied().zip(s.iter().copied()).collect())
                    .collect(),
            },
            channels: table.lighting.channels,
        })
    }

    fn lighting_spectrum(file: &Path) -> Result<Self> {
        let rows = read_spectrum(file)?;
        let parts = rows.into_iter().flat_map(|row| {
            let p = row.p as f64;
            [(row.value.re, 0.0), (row.value.im, 1.0)]
                .map(|(value, part)| (row.channel.clone(), [p, part, 0.0], value, row.sigma))
        });
        // Im L_0 is zero by definition.
        Ok(listed(
            Kind::LightingSpectrum,
            parts.filter(|(_, point, ..)| point[..2] != [0.0, 1.0]),
        ))
    }

    fn slice(file: &Path) -> Result<Self> {
        let table = SliceTable::read(file)?;
        let mut points = Vec::with_capacity(table.incident.count * table.exitant.count);
        for i in 0..table.incident.count {
            for j in 0..table.exitant.count {
                points.push([
                    table.incident.angle(i).deg(),
                    table.exitant.angle(j).deg(),
                    0.0,
                ]);
            }
        }
        let slices = table
            .channels
            .iter()
            .map(|name| table.slice(name).ok())
            .collect();
        Ok(Self {
            kind: Kind::Brdf,
            channels: table.channels.clone(),
            points,
            values: Values::Slice(table, slices),
        })
    }

    fn light_field(file: &Path) -> Result<Self> {
        let field = LightField::read(file)?;
        let mut entries = Vec::with_capacity(field.channels.len() * field.grid.len());
        for (c, name) in field.channels.iter().enumerate() {
            for k in (0..field.grid.len()).filter(|&k| field.weight[c][k] > 0.0) {
                let alpha = field.grid.normal(k / field.grid.locals).deg();
                let local = field.grid.local(k % field.grid.locals).deg();
                let sigma = f64::from(field.sigma[c][k]);
                entries.push((
                    name.clone(),
                    [alpha, local, 0.0],
                    f64::from(field.mean[c][k]),
                    (sigma > 0.0).then_some(sigma),
                ));
            }
        }
        Ok(listed(Kind::LightField, entries.into_iter()))
    }

    /// Value and σ of a channel at a point; `None` where the product says nothing.
    pub fn at(&self, channel: usize, point: Point) -> Option<Measured> {
        match &self.values {
            Values::Listed(maps) => maps.get(channel)?.get(&key(point)).copied(),
            Values::Circle { start, table } => {
                let row = table.get(channel)?;
                let position = (point[0] - start).rem_euclid(360.0) / 360.0 * row.len() as f64;
                let nearest = position.round();
                if (position - nearest).abs() < 1e-6 {
                    return row.get(nearest as usize % row.len()).copied();
                }
                let (i, t) = (position.floor() as usize % row.len(), position.fract());
                let ((a, sigma_a), (b, sigma_b)) = (row[i], row[(i + 1) % row.len()]);
                let sigma = sigma_a.zip(sigma_b).map(|(a, b)| a + t * (b - a));
                Some((a + t * (b - a), sigma))
            }
            Values::Slice(table, slices) => {
                let incident = LocalAngle::degrees(point[0]);
                let exitant = LocalAngle::degrees(point[1]);
                let cosines = incident.visible_cosine() * exitant.visible_cosine();
                let (x, y) = (
                    table.incident.position(incident),
                    table.exitant.position(exitant),
                );
                let (i, j) = (x.round(), y.round());
                let inside = |v: f64, count: usize| v >= 0.0 && v < count as f64;
                if !inside(i, table.incident.count) || !inside(j, table.exitant.count) {
                    return None;
                }
                let cell = i as usize * table.exitant.count + j as usize;
                let sigma = table.sigma.get(channel).map(|s| s[cell] * cosines);
                let sigma = sigma.filter(|s| s.is_finite());
                let value = if (x - i).abs() < 1e-6 && (y - j).abs() < 1e-6 {
                    table.rho.get(channel)?[cell] * cosines
                } else {
                    slices.get(channel)?.as_ref()?.tilde(incident, exitant)
                };
                value.is_finite().then_some((value, sigma))
            }
        }
    }
}

fn listed(kind: Kind, entries: impl Iterator<Item = (String, Point, f64, Option<f64>)>) -> Product {
    let (mut channels, mut points): (Vec<String>, Vec<Point>) = (Vec::new(), Vec::new());
    let mut maps: Vec<HashMap<_, _>> = Vec::new();
    for (channel, point, value, sigma) in entries {
        let c = channels
            .iter()
            .position(|n| *n == channel)
            .unwrap_or_else(|| {
                channels.push(channel);
                maps.push(HashMap::new());
                maps.len() - 1
            });
        maps[c].insert(key(point), (value, sigma));
        points.push(point);
    }
    // In order and each once, whichever channels have them.
    points.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    points.dedup();
    Product {
        kind,
        channels,
        points,
        values: Values::Listed(maps),
    }
}

/// `channel,p,q,re,im,sigma,status`; a coefficient without a value is left out.
fn brdf_spectrum(text: &str) -> Result<Product> {
    let mut entries = Vec::new();
    for (n, line) in text.lines().enumerate().skip(1) {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let number = |k: usize| -> Result<Option<f64>> {
            match fields.get(k).copied().unwrap_or("") {
                "" => Ok(None),
                field => field.parse().map(Some).map_err(|_| {
                    Error::input(format!("expected a number, found {field:?}")).line(n + 1)
                }),
            }
        };
        let (Some(p), Some(q), Some(re), Some(im)) =
            (number(1)?, number(2)?, number(3)?, number(4)?)
        else {
            continue;
        };
        let sigma = number(5)?;
        for (value, part) in [(re, 0.0), (im, 1.0)] {
            entries.push((fields[0].to_owned(), [p, q, part], value, sigma));
        }
    }
    Ok(listed(Kind::BrdfSpectrum, entries.into_iter()))
}
