//! A material as a recipe describes it (`[brdf]`): a model and its parameters, or a table.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{Brdf, Family, Material, SliceTable, directional_albedo};
use crate::angle::LocalAngle;
use crate::error::nearest;
use crate::{Error, Result};

/// A material as a recipe describes it: `model = "phong"` with its parameters (one value for all channels, or
/// one for each), or `table = "brdf.csv"`. Written back with every default filled in.
#[derive(Clone, Debug, PartialEq)]
pub enum Model {
    /// An analytic model.
    Analytic {
        /// Which one.
        family: Family,
        /// For each of [`Family::parameters`], one value for all channels or one per channel.
        values: Vec<Vec<f64>>,
    },
    /// A table in a file, absolute or relative to the recipe.
    Table(PathBuf),
}

/// Mean reflection over some pairs of directions, the mirror's among them: its sign is what matters.
fn reflected(brdf: &dyn Brdf) -> f64 {
    let mut sum = 0.0;
    for exitant in [-60.0, -30.0, 0.0, 30.0, 60.0].map(LocalAngle::degrees) {
        sum += brdf.mirror(exitant) + brdf.value(LocalAngle::radians(-exitant.rad()), exitant);
        for k in 0..90 {
            let incident = LocalAngle::degrees(2.0 * f64::from(k) - 89.0);
            sum += brdf.value(incident, exitant) * incident.visible_cosine() / 90.0;
        }
    }
    sum
}

impl Model {
    /// From the `[brdf]` table of a recipe.
    ///
    /// # Errors
    /// For an unknown model or key (naming the nearest), a missing or superfluous one, and values that are
    /// not numbers or out of their range.
    pub fn from_table(table: &toml::Table) -> Result<Self> {
        if let Some(path) = table.get("table") {
            return Self::from_file_key(path, table);
        }
        let Some(name) = table.get("model") else {
            let advice = format!("Models: {}.", model_names().join(", "));
            return Err(Error::input("expected `model` or `table`, found neither")
                .key("brdf")
                .advice(advice));
        };
        let family = family_of(name, table)?;
        let parameters = family.parameters();
        let known: Vec<&str> = std::iter::once("model")
            .chain(parameters.iter().map(|p| p.name))
            .collect();
        check_keys(table, &known)?;
        let mut values = Vec::with_capacity(parameters.len());
        for p in parameters {
            let given = match (table.get(p.name), p.default) {
                (Some(value), _) => numbers(value).map_err(|e| e.key(key(p.name)))?,
                (None, Some(default)) => vec![default],
                (None, None) => {
                    return Err(Error::input(format!(
                        "the model \"{}\" needs `{}`, which is missing",
                        family.name(),
                        p.name
                    ))
                    .key(key(p.name)));
                }
            };
            if let Some(bad) = given.iter().find(|v| !(p.low..=p.high).contains(*v)) {
                let range = if p.high.is_finite() {
                    format!("a value in {} to {}", p.low, p.high)
                } else {
                    format!("a value of at least {}", p.low)
                };
                return Err(
                    Error::input(format!("expected {range}, found {bad:?}")).key(key(p.name))
                );
            }
            values.push(given);
        }
        Ok(Self::Analytic { family, values })
    }

    fn from_file_key(path: &toml::Value, table: &toml::Table) -> Result<Self> {
        check_keys(table, &["table"])?;
        match path.as_str() {
            Some(path) if !path.is_empty() => Ok(Self::Table(PathBuf::from(path))),
            _ => Err(
                Error::input(format!("expected the name of a CSV file, found {path}"))
                    .key(key("table")),
            ),
        }
    }

    /// As the `[brdf]` table of a recipe, with every default written out.
    pub fn to_table(&self) -> toml::Table {
        let mut table = toml::Table::new();
        match self {
            Self::Analytic { family, values } => {
                table.insert("model".into(), family.name().into());
                for (p, v) in family.parameters().iter().zip(values) {
                    let value = match v.as_slice() {
                        [one] => toml::Value::Float(*one),
                        many => many
                            .iter()
                            .copied()
                            .map(toml::Value::Float)
                            .collect::<Vec<_>>()
                            .into(),
                    };
                    table.insert(p.name.into(), value);
                }
            }
            Self::Table(path) => {
                table.insert("table".into(), path.display().to_string().into());
            }
        }
        table
    }

    /// The BRDF of each of `channels`; a table's path is relative to `folder`.
    ///
    /// # Errors
    /// If a parameter has neither one value nor one per channel; if the table cannot be read, lacks a
    /// channel or has holes that reciprocity does not fill.
    pub fn material(&self, channels: &[String], folder: &Path) -> Result<Material> {
        let brdfs: Vec<Arc<dyn Brdf>> = match self {
            Self::Analytic { family, values } => {
                self.check_lengths(channels)?;
                let own: Vec<Vec<f64>> =
                    (0..channels.len()).map(|c| of_channel(values, c)).collect();
                // Channels of equal parameters share one BRDF, so that its work is done once.
                let mut brdfs: Vec<Arc<dyn Brdf>> = Vec::with_capacity(own.len());
                for (c, values) in own.iter().enumerate() {
                    let twin = own[..c].iter().position(|other| other == values);
                    brdfs.push(match twin {
                        Some(twin) => Arc::clone(&brdfs[twin]),
                        None => family.build(values),
                    });
                }
                brdfs
            }
            Self::Table(path) => {
                let path = folder.join(path);
                let table = SliceTable::read(&path)?;
                channels
                    .iter()
                    .map(|name| {
                        Ok(Arc::new(table.slice(name).map_err(|e| e.file(&path))?)
                            as Arc<dyn Brdf>)
                    })
                    .collect::<Result<_>>()?
            }
        };
        for (name, brdf) in channels.iter().zip(&brdfs) {
            let reflected = reflected(brdf.as_ref());
            if !(reflected > 0.0) {
                let found = if reflected < 0.0 {
                    "its mean is negative"
                } else {
                    "it reflects no light"
                };
                let error = Error::input(format!(
                    "expected a material that reflects light, and in channel {name} {found}"
                ));
                return Err(match self {
                    Self::Table(path) => error.file(folder.join(path)),
                    Self::Analytic { .. } => error.key("brdf"),
                });
            }
        }
        Ok(Material {
            channels: channels.to_vec(),
            brdfs,
        })
    }

    /// What is allowed but unlikely: a material that reflects more light than it gets. One sentence each;
    /// empty for tables, whose energy out of the plane is not known.
    pub fn warnings(&self) -> Vec<String> {
        let Self::Analytic { family, values } = self else {
            return Vec::new();
        };
        let count = values.iter().map(Vec::len).max().unwrap_or(0);
        let mut warnings = Vec::new();
        for channel in 0..count {
            let model = family.build(&of_channel(values, channel));
            let worst = (0..9)
                .map(|k| FRAC_PI_2 * f64::from(k) / 9.0)
                .map(|angle| (directional_albedo(model.as_ref(), angle), angle))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((albedo, angle)) = worst
                // 1e-4 is above the quadrature's error and below anything that matters.
                && albedo > 1.0 + 1e-4
            {
                let which = if count > 1 {
                    format!(" (value {channel})")
                } else {
                    String::new()
                };
                warnings.push(format!(
                    "brdf: {}{which} reflects {albedo:.3} of the light that arrives at {:.0}° from the normal, \
                     more than all of it",
                    family.name(),
                    angle.to_degrees()
                ));
            }
        }
        warnings
    }

    /// The same of a table, by the slices that were read from it.
    ///
    /// What a slice sends within its plane is no energy, for a plane holds no solid angle: a lobe of 1 sr⁻¹ is harmless, and one of
    /// 100 sr⁻¹ may be. But under normal incidence an isotropic surface reflects alike at every azimuth, and the slice through the
    /// normal is the whole of it: 2π ∫ ρ(0, θo′) sin θo′ cos θo′ dθo′ is the albedo there, and no surface that keeps energy has more than 1.
    pub fn warnings_of_table(&self, material: &Material) -> Vec<String> {
        if matches!(self, Self::Analytic { .. }) {
            return Vec::new();
        }
        let pairs = material.channels.iter().zip(&material.brdfs);
        pairs
            .filter_map(|(name, brdf)| {
                let albedo = albedo_at_normal_incidence(brdf.as_ref());
                (albedo > 1.0 + TABLE_ALBEDO_ERROR).then(|| {
                    format!(
                        "brdf: in channel {name} the table reflects {albedo:.3} of the light that arrives along the normal, \
                         more than all of it (of an isotropic surface, whose slice is alike at every azimuth there)"
                    )
                })
            })
            .collect()
    }

    fn check_lengths(&self, channels: &[String]) -> Result<()> {
        let Self::Analytic { family, values } = self else {
            return Ok(());
        };
        for (p, v) in family.parameters().iter().zip(values) {
            if v.len() != 1 && v.len() != channels.len() {
                return Err(Error::input(format!(
                    "expected one value, or one for each of the {} channels ({}), found {} values",
                    channels.len(),
                    channels.join(", "),
                    v.len()
                ))
                .key(key(p.name)));
            }
        }
        Ok(())
    }
}

/// The values of one channel.
fn of_channel(values: &[Vec<f64>], channel: usize) -> Vec<f64> {
    let pick = |v: &Vec<f64>| v.get(channel).or(v.first()).copied().unwrap_or(0.0);
    values.iter().map(pick).collect()
}

fn key(name: &str) -> String {
    format!("brdf.{name}")
}

fn model_names() -> Vec<&'static str> {
    let mut names: Vec<&str> = Family::ALL.iter().map(|f| f.name()).collect();
    names.dedup();
    names
}

/// The family of this name; where two share it, the one whose keys are in the table.
fn family_of(name: &toml::Value, table: &toml::Table) -> Result<Family> {
    let word = name.as_str().unwrap_or_default();
    let same: Vec<Family> = Family::ALL
        .into_iter()
        .filter(|f| f.name() == word)
        .collect();
    let fits = |f: &&Family| {
        f.parameters()
            .iter()
            .all(|p| p.default.is_some() || table.contains_key(p.name))
    };
    if let Some(family) = same.iter().find(fits).or(same.first()) {
        return Ok(*family);
    }
    let names = model_names();
    let advice = match nearest(word, &names) {
        Some(near) => format!("Did you mean \"{near}\"?"),
        None => format!("Models: {}.", names.join(", ")),
    };
    Err(Error::input(format!("expected a BRDF model, found {name}"))
        .key(key("model"))
        .advice(advice))
}

fn check_keys(table: &toml::Table, known: &[&str]) -> Result<()> {
    let unknown = table.keys().filter(|k| !known.contains(&k.as_str()));
    let errors = unknown.map(|k| {
        let advice = match nearest(k, known) {
            Some(near) => format!("Did you mean `{near}`?"),
            None => format!("Keys here: {}.", known.join(", ")),
        };
        Error::input("unknown key").key(key(k)).advice(advice)
    });
    Error::all(errors.collect()).map_or(Ok(()), Err)
}

/// One number or a list of them, all finite.
fn numbers(value: &toml::Value) -> Result<Vec<f64>> {
    let one = |v: &toml::Value| match v {
        toml::Value::Float(f) if f.is_finite() => Some(*f),
        toml::Value::Integer(i) => Some(*i as f64),
        _ => None,
    };
    let all = match value {
        toml::Value::Array(list) if !list.is_empty() => list.iter().map(one).collect(),
        other => one(other).map(|v| vec![v]),
    };
    all.ok_or_else(|| {
        Error::input(format!(
            "expected a number, or a list of one number per channel, found {value}"
        ))
    })
}

impl Serialize for Model {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        self.to_table().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Model {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let table = toml::Table::deserialize(deserializer)?;
        Self::from_table(&table).map_err(serde::de::Error::custom)
    }
}

/// By how much the albedo of a table may exceed 1 without a warning: measured tables are good to about a percent.
const TABLE_ALBEDO_ERROR: f64 = 0.01;
/// Angles of the sum over a slice: lobes of 1° are resolved.
const ALBEDO_NODES: usize = 720;

/// 2π ∫ ½ [ρ(0, θ) + ρ(0, −θ)] sin θ cos θ dθ over 0 … π/2, by the midpoint rule.
fn albedo_at_normal_incidence(brdf: &dyn Brdf) -> f64 {
    let step = FRAC_PI_2 / ALBEDO_NODES as f64;
    let normal = LocalAngle::radians(0.0);
    let sum: f64 = (0..ALBEDO_NODES)
        .map(|k| {
            let theta = (k as f64 + 0.5) * step;
            let value = |angle| brdf.value(normal, LocalAngle::radians(angle));
            (value(theta) + value(-theta)) * theta.sin() * theta.cos()
        })
        .sum();
    PI * sum * step
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;

    fn parse(text: &str) -> Result<Model> {
        Model::from_table(&text.parse().expect("valid TOML"))
    }

    fn rgb() -> Vec<String> {
        ["R", "G", "B"].map(String::from).to_vec()
    }

    #[test]
    fn a_recipe_s_table_becomes_one_brdf_per_channel() {
        let model = parse(
            "model = \"phong\"\ndiffuse = [0.30, 0.22, 0.15]\nspecular = [0.40, 0.40, 0.38]\nexponent = 32",
        )
        .expect("the example of the documentation");
        let material = model
            .material(&rgb(), Path::new("."))
            .expect("three channels");
        let blue = crate::brdf::Phong {
            diffuse: 0.15,
            specular: 0.38,
            exponent: 32.0,
        };
        let (a, b) = (LocalAngle::degrees(20.0), LocalAngle::degrees(-25.0));
        assert_eq!(material.brdfs[2].value(a, b), blue.value(a, b));
        assert!(model.material(&rgb()[..2], Path::new(".")).is_err());
        assert!(model.warnings().is_empty());
    }

    #[test]
    fn it_is_written_back_with_every_default() {
        let model = parse(
            "model = \"ggx-conductor\"\nalpha = 0.2\neta = [0.2, 0.9, 1.1]\nk = [3.9, 2.4, 2.2]",
        )
        .expect("specular has a default");
        let text = toml::to_string(&model).expect("a TOML table");
        assert!(text.contains("specular = 1.0"), "{text}");
        let again: Model = toml::from_str(&text).expect("what was written");
        assert_eq!(again, model);
        let table: Model = toml::from_str("table = \"brdf.csv\"").expect("a table");
        assert_eq!(table, Model::Table("brdf.csv".into()));
    }

    #[test]
    fn faults_are_named_with_the_nearest_name() {
        for (text, expected) in [
            ("model = \"pong\"", "Did you mean \"phong\"?"),
            (
                "model = \"phong\"\nspecular = 1\nexponnent = 3",
                "Did you mean `exponent`?",
            ),
            ("model = \"phong\"\nspecular = 1", "needs `exponent`"),
            (
                "model = \"lambertian\"\nalbedo = -0.1",
                "at least 0, found -0.1",
            ),
            ("model = \"lambertian\"\nalbedo = nan", "expected a number"),
            ("model = \"lambertian\"\nalbedo = []", "expected a number"),
            (
                "model = \"lambertian\"\nalbedo = \"red\"",
                "expected a number",
            ),
            (
                "model = \"ggx-conductor\"\nalpha = 0\neta = 1\nk = 1",
                "0.001 to 2",
            ),
            ("model = 3", "expected a BRDF model"),
            ("table = 3", "name of a CSV file"),
            ("table = \"a.csv\"\nmodel = \"phong\"", "brdf.model"),
            ("", "expected `model` or `table`"),
        ] {
            let error = parse(text).expect_err(text).to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }

    #[test]
    fn every_model_of_the_documentation_is_understood() {
        for text in [
            "model = \"lambertian\"\nalbedo = 0.5",
            "model = \"mirror\"",
            "model = \"phong\"\nspecular = 0.4\nexponent = 32",
            "model = \"blinn\"\ndiffuse = 0.1\nspecular = 0.4\nexponent = 32",
            "model = \"ward\"\nspecular = 0.4\nalpha = 0.1",
            "model = \"torrance-sparrow\"\ndiffuse = 0.3\nroughness = 0.2\nior = 1.5",
            "model = \"ggx-conductor\"\nalpha = 0.2\neta = 0.2\nk = 3.9",
            "model = \"ggx-dielectric\"\ndiffuse = 0.3\nalpha = 0.1",
            "model = \"oren-nayar\"\nalbedo = 0.7\nsigma_deg = 20",
            "model = \"sheen\"\nsheen = 0.5\nroughness = 0.3",
            "model = \"sheen\"\nsheen = 0.5\nexponent = 4",
        ] {
            let model = parse(text).expect(text);
            assert!(
                model.warnings().is_empty(),
                "{text}: {:?}",
                model.warnings()
            );
            let material = model.material(&rgb(), Path::new(".")).expect(text);
            assert_eq!(material.brdfs.len(), 3);
            assert_eq!(
                Model::from_table(&model.to_table()).expect("resolved"),
                model
            );
        }
        assert_ne!(
            parse("model = \"sheen\"\nsheen = 1\nroughness = 0.3")
                .expect("roughness")
                .to_table()
                .get("roughness"),
            None
        );
        assert!(parse("model = \"sheen\"\nsheen = 1\nroughness = 0.3\nexponent = 3").is_err());
    }

    #[test]
    fn too_much_energy_is_a_warning() {
        let model = parse("model = \"phong\"\ndiffuse = [0.3, 0.8]\nspecular = 0.5\nexponent = 20")
            .expect("allowed");
        let warnings = model.warnings();
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(
            warnings[0].contains("(value 1) reflects 1.300"),
            "{warnings:?}"
        );
    }

    #[test]
    fn too_much_energy_of_a_table_is_a_warning() {
        let folder = tempfile::tempdir().expect("a folder");
        let axis = crate::brdf::Axis {
            count: 90,
            inclusive: false,
        };
        let warnings = |text: &str| {
            let channels = vec!["Y".to_string()];
            let known = parse(text).expect(text);
            let material = known.material(&channels, folder.path()).expect(text);
            let table = SliceTable::of(&material, axis, axis);
            std::fs::write(folder.path().join("brdf.csv"), table.to_csv()).expect("writes");
            let model = Model::Table("brdf.csv".into());
            let read = model.material(&channels, folder.path()).expect("reads");
            assert!(known.warnings_of_table(&material).is_empty());
            model.warnings_of_table(&read)
        };
        // The in-plane peak of this lobe is 16 sr⁻¹, and all it reflects is 0.9 of the light.
        for sound in [
            "model = \"lambertian\"\nalbedo = 0.99",
            "model = \"phong\"\nspecular = 0.9\nexponent = 100",
        ] {
            assert_eq!(warnings(sound), Vec::<String>::new(), "{sound}");
        }
        // Lambertian of albedo 1.3: ∫ is 1.3 but for the table's interpolation.
        let said = warnings("model = \"phong\"\ndiffuse = 0.8\nspecular = 0.5\nexponent = 20");
        assert!(
            said[0].contains("channel Y the table reflects 1.") && said.len() == 1,
            "{said:?}"
        );
    }
}
