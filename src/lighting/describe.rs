//! The `[lighting]` table of a recipe: what the user knows about the light.

use std::path::{Path, PathBuf};

use serde::Serialize;
use toml::{Table, Value};

use super::environment::{Environment, Section, Serves};
use super::{Lighting, Source, read_table};
use crate::angle::WorldAngle;
use crate::error::{Error, Result, nearest};

/// Lighting as a recipe describes it; all parts add up.
///
/// A value per channel may be given once for all channels.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LightingDescription {
    /// Directional sources.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sources: Vec<SourceDescription>,
    /// Light from everywhere in the plane, W m⁻² rad⁻¹.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub uniform: Vec<f64>,
    /// A table as [`super::write_table`] writes it, relative to the recipe.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table: Option<PathBuf>,
    /// A lat-long environment map, cut by the measurement plane.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub environment: Option<EnvironmentDescription>,
}

/// An environment map of a recipe, and the plane in it; see [`Section`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EnvironmentDescription {
    /// The map, OpenEXR or Radiance HDR, relative to the recipe.
    #[serde(rename = "environment")]
    pub file: PathBuf,
    /// Which surfaces the planar light is for: `lambertian` (cos²-weighted columns) or `mirror` (the
    /// radiance in the plane).
    #[serde(rename = "environment_serves")]
    pub serves: Serves,
    /// Direction of the reference axis in the map, degrees.
    pub heading_deg: f64,
    /// Turn of the plane about the reference axis, degrees.
    pub roll_deg: f64,
}

/// One directional source of a recipe.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SourceDescription {
    /// Direction to the source, degrees.
    pub theta_deg: f64,
    /// Irradiance on a surface that faces it, W m⁻².
    pub irradiance: Vec<f64>,
}

/// How much of a table's light may be negative against the positive: what a recovery without the constraint leaves.
const NEGATIVE_LIGHT: f64 = 0.25;

const KEYS: [&str; 7] = [
    "sources",
    "uniform",
    "table",
    "environment",
    "environment_serves",
    "heading_deg",
    "roll_deg",
];
const SOURCE_KEYS: [&str; 2] = ["theta_deg", "irradiance"];

impl LightingDescription {
    /// From the recipe's `[lighting]` table.
    ///
    /// # Errors
    /// All at once: keys that are not known (with the nearest that is), values of the wrong type, a
    /// source without a direction, light that is negative or not finite.
    pub fn from_toml(table: &Table) -> Result<Self> {
        let mut faults = unknown_keys(table, &KEYS, "lighting");
        let mut described = Self::default();
        if let Some(value) = table.get("sources") {
            match value {
                Value::Array(items) => {
                    for (i, item) in items.iter().enumerate() {
                        match source(item, &format!("lighting.sources[{i}]")) {
                            Ok(source) => described.sources.push(source),
                            Err(mut more) => faults.append(&mut more),
                        }
                    }
                }
                other => faults.push(
                    expected("a list of sources", other)
                        .key("lighting.sources")
                        .advice("Write sources = [{ theta_deg = 30, irradiance = [3, 3, 3] }]."),
                ),
            }
        }
        if let Some(value) = table.get("uniform") {
            match per_channel(value) {
                Ok(values) => described.uniform = values,
                Err(e) => faults.push(e.key("lighting.uniform")),
            }
        }
        if let Some(value) = table.get("table") {
            match path(value) {
                Ok(file) => described.table = Some(file),
                Err(e) => faults.push(e.key("lighting.table")),
            }
        }
        match environment(table) {
            Ok(environment) => described.environment = environment,
            Err(mut more) => faults.append(&mut more),
        }
        if faults.is_empty() && described == Self::default() {
            faults.push(
                Error::input("expected a description of the light, found an empty table")
                    .key("lighting")
                    .advice("Give at least one of sources, uniform, table, environment."),
            );
        }
        match Error::all(faults) {
            Some(error) => Err(error),
            None => Ok(described),
        }
    }

    /// The lighting in the capture's channels. Relative paths are taken from `folder`, the recipe's.
    ///
    /// # Errors
    /// A value list or a file whose channels are not the capture's; a file that cannot be read.
    pub fn resolve(&self, channels: &[String], folder: &Path) -> Result<Lighting> {
        let mut sources = Vec::new();
        for (i, s) in self.sources.iter().enumerate() {
            sources.push(Source {
                theta: WorldAngle::degrees(s.theta_deg).wrapped(),
                irradiance: for_channels(&s.irradiance, channels)
                    .map_err(|e| e.key(format!("lighting.sources[{i}].irradiance")))?,
            });
        }
        let mut lighting = Lighting::from_sources(channels.to_vec(), sources);
        if !self.uniform.is_empty() {
            let values =
                for_channels(&self.uniform, channels).map_err(|e| e.key("lighting.uniform"))?;
            lighting = lighting.plus(&Lighting::uniform(channels.to_vec(), &values));
        }
        if let Some(file) = &self.table {
            let file = folder.join(file);
            let table = read_table(&file)?;
            for (name, values) in table.lighting.channels.iter().zip(&table.values) {
                let of_sign = |sign: f64| values.iter().map(|v| (sign * v).max(0.0)).sum::<f64>();
                if of_sign(-1.0) > NEGATIVE_LIGHT * of_sign(1.0) {
                    return Err(Error::input(format!(
                        "expected light of 0 or more, and channel {name} is negative to a large part"
                    ))
                    .file(&file)
                    .key(format!("L_{name}")));
                }
            }
            let read = table.lighting;
            let matched =
                in_channels(&read, channels).map_err(|e| e.file(&file).key("lighting.table"))?;
            lighting = lighting.plus(&matched);
        }
        if let Some(environment) = &self.environment {
            let file = folder.join(&environment.file);
            let section = Section {
                heading: environment.heading_deg.to_radians(),
                roll: environment.roll_deg.to_radians(),
                serves: environment.serves,
            };
            let planar = Environment::read(&file)?.planar(section);
            let matched = in_channels(&planar, channels)
                .map_err(|e| e.file(&file).key("lighting.environment"))?;
            lighting = lighting.plus(&matched);
        }
        Ok(lighting)
    }

    /// The files it needs, resolved against `folder`: what a run's provenance must hash.
    pub fn files(&self, folder: &Path) -> Vec<PathBuf> {
        let environment = self.environment.as_ref().map(|e| &e.file);
        self.table
            .iter()
            .chain(environment)
            .map(|f| folder.join(f))
            .collect()
    }
}

fn unknown_keys(table: &Table, known: &[&str], place: &str) -> Vec<Error> {
    table
        .keys()
        .filter(|key| !known.contains(&key.as_str()))
        .map(|key| {
            let error = Error::input("unknown key").key(format!("{place}.{key}"));
            match nearest(key, known) {
                Some(near) => error.advice(format!("Did you mean {near}?")),
                None => error.advice(format!("Known keys: {}.", known.join(", "))),
            }
        })
        .collect()
}

fn source(item: &Value, place: &str) -> std::result::Result<SourceDescription, Vec<Error>> {
    let Value::Table(table) = item else {
        return Err(vec![
            expected("a table { theta_deg = …, irradiance = … }", item).key(place),
        ]);
    };
    let mut faults = unknown_keys(table, &SOURCE_KEYS, place);
    let theta = match table.get("theta_deg") {
        Some(value) => number(value),
        None => Err(Error::input("expected a direction in degrees, found none")),
    };
    let irradiance = match table.get("irradiance") {
        Some(value) => per_channel(value),
        None => Err(Error::input("expected an irradiance in W m⁻², found none")),
    };
    match (theta, irradiance) {
        (Ok(theta_deg), Ok(irradiance)) if faults.is_empty() => Ok(SourceDescription {
            theta_deg,
            irradiance,
        }),
        (theta, irradiance) => {
            faults.extend(theta.err().map(|e| e.key(format!("{place}.theta_deg"))));
            faults.extend(
                irradiance
                    .err()
                    .map(|e| e.key(format!("{place}.irradiance"))),
            );
            Err(faults)
        }
    }
}

/// The environment's keys, which mean something together only.
fn environment(table: &Table) -> std::result::Result<Option<EnvironmentDescription>, Vec<Error>> {
    let mut faults = Vec::new();
    let Some(file) = table.get("environment") else {
        for key in ["environment_serves", "heading_deg", "roll_deg"] {
            if table.contains_key(key) {
                faults.push(
                    Error::input("it describes an environment, and none is given")
                        .key(format!("lighting.{key}"))
                        .advice("Add environment = \"FILE.exr\", or leave it out."),
                );
            }
        }
        return if faults.is_empty() {
            Ok(None)
        } else {
            Err(faults)
        };
    };
    let mut keep = |result: Result<f64>, key: &str| {
        result.unwrap_or_else(|e| {
            faults.push(e.key(format!("lighting.{key}")));
            0.0
        })
    };
    let angle = |key: &str| table.get(key).map_or(Ok(0.0), number);
    let heading_deg = keep(angle("heading_deg"), "heading_deg");
    let roll_deg = keep(angle("roll_deg"), "roll_deg");
    let serves = match table.get("environment_serves") {
        None => Serves::default(),
        Some(Value::String(s)) if s == "lambertian" => Serves::Lambertian,
        Some(Value::String(s)) if s == "mirror" => Serves::Mirror,
        Some(other) => {
            faults.push(
                expected("\"lambertian\" or \"mirror\"", other).key("lighting.environment_serves"),
            );
            Serves::default()
        }
    };
    match path(file) {
        Ok(file) if faults.is_empty() => Ok(Some(EnvironmentDescription {
            file,
            serves,
            heading_deg,
            roll_deg,
        })),
        Ok(_) => Err(faults),
        Err(e) => {
            faults.push(e.key("lighting.environment"));
            Err(faults)
        }
    }
}

fn expected(what: &str, found: &Value) -> Error {
    Error::input(format!(
        "expected {what}, found {} {found}",
        found.type_str()
    ))
}

fn number(value: &Value) -> Result<f64> {
    let number = match value {
        Value::Float(f) => *f,
        Value::Integer(i) => *i as f64,
        other => return Err(expected("a number", other)),
    };
    if number.is_finite() {
        Ok(number)
    } else {
        Err(expected("a finite number", value))
    }
}

fn path(value: &Value) -> Result<PathBuf> {
    match value {
        Value::String(name) if !name.is_empty() => Ok(name.into()),
        other => Err(expected("the name of a file", other)),
    }
}

/// One number, or a list with one for each channel; light is never negative.
fn per_channel(value: &Value) -> Result<Vec<f64>> {
    let values = match value {
        Value::Array(items) => items.iter().map(number).collect::<Result<Vec<f64>>>()?,
        one => vec![number(one)?],
    };
    match values.iter().find(|v| **v < 0.0) {
        Some(negative) => Err(Error::input(format!(
            "expected light of 0 or more, found {negative}"
        ))),
        None if values.is_empty() => Err(Error::input("expected a number, found an empty list")),
        None => Ok(values),
    }
}

fn for_channels(values: &[f64], channels: &[String]) -> Result<Vec<f64>> {
    match values {
        [one] => Ok(vec![*one; channels.len()]),
        _ if values.len() == channels.len() => Ok(values.to_vec()),
        _ => Err(Error::input(format!(
            "expected one value or one for each of the {} channels {}, found {}",
            channels.len(),
            channels.join(", "),
            values.len()
        ))),
    }
}

/// The lighting with its channels picked by name, in the order of `channels`; a file of one channel
/// serves for all.
fn in_channels(lighting: &Lighting, channels: &[String]) -> Result<Lighting> {
    let mut picks = Vec::new();
    for name in channels {
        let found = match lighting.channels.as_slice() {
            [_] => Some(0),
            several => several.iter().position(|c| c == name),
        };
        picks.push(found.ok_or_else(|| {
            Error::input(format!(
                "expected light in the capture's channels {}, found {}",
                channels.join(", "),
                lighting.channels.join(", ")
            ))
        })?);
    }
    Ok(Lighting {
        channels: channels.to_vec(),
        sources: lighting
            .sources
            .iter()
            .map(|s| Source {
                theta: s.theta,
                irradiance: picks.iter().map(|&c| s.in_channel(c)).collect(),
            })
            .collect(),
        table: pick(&lighting.table, &picks),
        smooth: pick(&lighting.smooth, &picks),
    })
}

fn pick<T: Clone>(all: &[T], picks: &[usize]) -> Vec<T> {
    picks.iter().filter_map(|&c| all.get(c).cloned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<LightingDescription> {
        LightingDescription::from_toml(&text.parse::<Table>().unwrap())
    }

    fn rgb() -> Vec<String> {
        ["R", "G", "B"].map(String::from).to_vec()
    }

    #[test]
    fn sources_uniform_and_table_add_up_in_the_captures_channels() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(
            folder.path().join("sky.csv"),
            "theta_deg,L_B,L_R,L_G\n-180,3,1,2\n0,3,1,2\n",
        )
        .unwrap();
        let described = parse(
            "table = 'sky.csv'\nuniform = 0.5\n\
             sources = [{ theta_deg = 370, irradiance = [3.0, 2, 1] }, { theta_deg = -90, irradiance = 1 }]",
        )
        .unwrap();
        let light = described.resolve(&rgb(), folder.path()).unwrap();
        for (c, (sky, sun)) in [(1.0, 3.0), (2.0, 2.0), (3.0, 1.0)].into_iter().enumerate() {
            let density = light.density(c, WorldAngle::degrees(12.0));
            assert!((density - 0.5 - sky).abs() < 1e-12);
            let total = std::f64::consts::TAU * (0.5 + sky) + sun + 1.0;
            assert!((light.total_irradiance(c) - total).abs() < 1e-12 * total);
        }
        assert!((light.sources[0].theta.deg() - 10.0).abs() < 1e-12);
        assert_eq!(
            described.files(folder.path()),
            [folder.path().join("sky.csv")]
        );
        // Written out in a resolved recipe, it reads back as itself.
        let written = toml::to_string(&described).unwrap();
        assert_eq!(parse(&written).unwrap(), described);
    }

    #[test]
    fn all_faults_are_reported_at_once_with_the_nearest_known_key() {
        let message = parse(
            "unifrom = 1\nsources = [{ theta = 3, irradiance = 1 }, { theta_deg = 'x', irradiance = [-1] }]",
        )
        .unwrap_err()
        .to_string();
        for part in [
            "lighting.unifrom: unknown key",
            "Did you mean uniform?",
            "lighting.sources[0].theta: unknown key",
            "Did you mean theta_deg?",
            "lighting.sources[0].theta_deg: expected a direction",
            "lighting.sources[1].theta_deg: expected a number, found string",
            "lighting.sources[1].irradiance: expected light of 0 or more, found -1",
        ] {
            assert!(message.contains(part), "{part}\nnot in\n{message}");
        }
        assert!(parse("").unwrap_err().to_string().contains("empty table"));
        assert!(parse("uniform = nan").is_err());
    }

    #[test]
    fn an_environment_is_cut_by_the_plane() {
        let folder = tempfile::tempdir().unwrap();
        let mut sun = Lighting::uniform(rgb(), &[0.0; 3]);
        sun.sources.push(Source {
            theta: WorldAngle::degrees(80.0),
            irradiance: vec![3.0, 2.0, 1.0],
        });
        let file = folder.path().join("sun.exr");
        crate::lighting::environment::write_lat_long(&file, &sun).unwrap();
        let described = parse("environment = 'sun.exr'\nheading_deg = 30").unwrap();
        let light = described.resolve(&rgb(), folder.path()).unwrap();
        // Seen from an axis at 30°, the sun of 80° stands at 50°; the map holds 0.14 % less.
        let first = light.series(0, 1).coefficients[1];
        assert!((first.arg() + 50f64.to_radians()).abs() < 1e-4);
        assert!((light.total_irradiance(0) - 3.0).abs() < 0.006);
        let written = toml::to_string(&described).unwrap();
        assert_eq!(parse(&written).unwrap(), described);
        for wrong in [
            "environment = 'a.exr'\nenvironment_serves = 'all'",
            "roll_deg = 3\nuniform = 1",
            "environment = 3",
        ] {
            assert!(parse(wrong).is_err());
        }
    }

    #[test]
    fn a_mismatch_of_channels_is_an_error() {
        let wrong = parse("uniform = [1, 2]").unwrap();
        let message = wrong
            .resolve(&rgb(), Path::new("."))
            .unwrap_err()
            .to_string();
        assert!(message.contains("3 channels R, G, B, found 2"), "{message}");
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("l.csv"), "theta_deg,L_R,L_X\n0,1,2\n").unwrap();
        let table = parse("table = 'l.csv'").unwrap();
        let message = table
            .resolve(&rgb(), folder.path())
            .unwrap_err()
            .to_string();
        assert!(message.contains("found R, X"), "{message}");
    }
}
