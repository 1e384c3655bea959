//! The `[scale]` table of a recipe: the outside fact that anchors what a light field cannot tell, the factor between
//! light and material.

use crate::angle::WorldAngle;
use crate::error::{Error, Result, nearest};
use crate::recover::factorise::Scale;

/// What is known of the scale, one value for all channels or one for each:
///
/// * `albedo = 0.5`: the in-plane albedo (π/4) ∫∫ ρ cos θi′ cos θo′, that of a Lambertian surface of equal reflection;
/// * `total_irradiance = 12.4`: ∫ L dθ over the circle, W m⁻²;
/// * `source_irradiance = [3.0, 2.9, 2.7]` with `source_theta_deg = 37.3`: one source of known direction, W m⁻² on a
///   surface that faces it.
///
/// Without the table L_0 = 1 W m⁻² rad⁻¹ in every channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ScaleDescription {
    /// Nothing is known.
    #[default]
    Free,
    /// `albedo`.
    Albedo(Vec<f64>),
    /// `total_irradiance`.
    TotalIrradiance(Vec<f64>),
    /// `source_irradiance` and `source_theta_deg`.
    Source {
        /// Direction to the source, degrees.
        theta_deg: f64,
        /// Irradiance on a surface that faces it, W m⁻².
        irradiance: Vec<f64>,
    },
}

const FACTS: [&str; 3] = ["albedo", "total_irradiance", "source_irradiance"];
const DIRECTION: &str = "source_theta_deg";
const ADVICE: &str =
    "Give one of albedo, total_irradiance, or source_irradiance with source_theta_deg.";

impl ScaleDescription {
    /// From the recipe's `[scale]` table.
    ///
    /// # Errors
    /// For unknown keys (naming the nearest), no fact or several, values that are not above 0.
    pub fn from_toml(table: &toml::Table) -> Result<Self> {
        let known: Vec<&str> = FACTS.into_iter().chain([DIRECTION]).collect();
        for key in table.keys() {
            if !known.contains(&key.as_str()) {
                let advice = nearest(key, &known)
                    .map_or_else(|| ADVICE.to_string(), |k| format!("Did you mean `{k}`?"));
                return Err(Error::input("unknown key")
                    .key(format!("scale.{key}"))
                    .advice(advice));
            }
        }
        let given: Vec<&str> = FACTS
            .into_iter()
            .filter(|k| table.contains_key(*k))
            .collect();
        let [fact] = given.as_slice() else {
            return Err(Error::input(format!(
                "expected one fact about the scale, found {}",
                given.len()
            ))
            .key("scale")
            .advice(ADVICE));
        };
        let values = positive(table, fact)?;
        let direction = table.get(DIRECTION).map(|v| number(v).ok_or(v));
        match (*fact, direction) {
            ("source_irradiance", Some(Ok(theta_deg))) => Ok(Self::Source {
                theta_deg,
                irradiance: values,
            }),
            ("source_irradiance", None) => Err(Error::input(
                "expected the source's direction in degrees, found nothing",
            )
            .key(format!("scale.{DIRECTION}"))),
            (_, Some(Err(value))) => Err(Error::input(format!(
                "expected a direction in degrees, found {value}"
            ))
            .key(format!("scale.{DIRECTION}"))),
            (_, Some(Ok(_))) => Err(Error::input(format!(
                "a direction has no meaning beside {fact}"
            ))
            .key(format!("scale.{DIRECTION}"))),
            ("albedo", None) => Ok(Self::Albedo(values)),
            _ => Ok(Self::TotalIrradiance(values)),
        }
    }

    /// Whether anything is known.
    pub fn is_given(&self) -> bool {
        *self != Self::Free
    }

    /// As the recipe's table; `None` if nothing is known.
    pub fn to_table(&self) -> Option<toml::Table> {
        let list = |values: &[f64]| -> toml::Value {
            values
                .iter()
                .copied()
                .map(toml::Value::Float)
                .collect::<Vec<_>>()
                .into()
        };
        let mut table = toml::Table::new();
        match self {
            Self::Free => return None,
            Self::Albedo(values) => {
                table.insert("albedo".into(), list(values));
            }
            Self::TotalIrradiance(values) => {
                table.insert("total_irradiance".into(), list(values));
            }
            Self::Source {
                theta_deg,
                irradiance,
            } => {
                table.insert(DIRECTION.into(), toml::Value::Float(*theta_deg));
                table.insert("source_irradiance".into(), list(irradiance));
            }
        }
        Some(table)
    }

    /// For the channels of a capture.
    ///
    /// # Errors
    /// If there is neither one value nor one per channel.
    pub fn resolve(&self, channels: &[String]) -> Result<Scale> {
        let each = |values: &[f64], key: &str| match values {
            [one] => Ok(vec![*one; channels.len()]),
            many if many.len() == channels.len() => Ok(many.to_vec()),
            many => Err(Error::input(format!(
                "expected one value or one for each of the {} channels {}, found {}",
                channels.len(),
                channels.join(", "),
                many.len()
            ))
            .key(format!("scale.{key}"))),
        };
        Ok(match self {
            Self::Free => Scale::Unit,
            Self::Albedo(values) => Scale::Albedo(each(values, "albedo")?),
            Self::TotalIrradiance(values) => {
                Scale::TotalIrradiance(each(values, "total_irradiance")?)
            }
            Self::Source {
                theta_deg,
                irradiance,
            } => Scale::Source {
                theta: WorldAngle::degrees(*theta_deg).wrapped(),
                irradiance: each(irradiance, "source_irradiance")?,
            },
        })
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    match value {
        toml::Value::Float(v) if v.is_finite() => Some(*v),
        toml::Value::Integer(v) => Some(*v as f64),
        _ => None,
    }
}

/// One number above 0, or a list of them.
fn positive(table: &toml::Table, key: &str) -> Result<Vec<f64>> {
    let values: Option<Vec<f64>> = match table.get(key) {
        Some(toml::Value::Array(items)) => items.iter().map(number).collect(),
        Some(value) => number(value).map(|v| vec![v]),
        None => None,
    };
    match values {
        Some(values) if !values.is_empty() && values.iter().all(|v| *v > 0.0) => Ok(values),
        _ => Err(
            Error::input("expected a number above 0, or one for each channel")
                .key(format!("scale.{key}")),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<ScaleDescription> {
        ScaleDescription::from_toml(&text.parse().expect("TOML"))
    }

    #[test]
    fn facts_read_back_as_written() {
        for text in [
            "albedo = 0.5",
            "total_irradiance = [1, 2.5, 3.0]",
            "source_irradiance = 3.0\nsource_theta_deg = -37.5",
        ] {
            let scale = read(text).expect("a fact");
            let again = ScaleDescription::from_toml(&scale.to_table().expect("a table"));
            assert_eq!(again.expect("what was written"), scale, "{text}");
        }
        let channels = ["R", "G"].map(String::from);
        let scale = read("albedo = 0.5").and_then(|s| s.resolve(&channels));
        assert_eq!(scale.expect("one for all"), Scale::Albedo(vec![0.5, 0.5]));
        let scale = read("albedo = [0.5, 0.4, 0.3]").and_then(|s| s.resolve(&channels));
        assert!(scale.is_err());
    }

    #[test]
    fn faulty_facts_are_named() {
        for (text, expected) in [
            ("", "found 0"),
            ("albedo = 0.5\ntotal_irradiance = 1", "found 2"),
            ("albedo = -1", "scale.albedo"),
            ("albedo = []", "scale.albedo"),
            ("albedo = \"x\"", "scale.albedo"),
            ("albdo = 1", "Did you mean `albedo`?"),
            ("source_irradiance = 1", "scale.source_theta_deg"),
            (
                "source_irradiance = 1\nsource_theta_deg = \"x\"",
                "scale.source_theta_deg",
            ),
            ("albedo = 1\nsource_theta_deg = 3", "no meaning"),
        ] {
            let error = read(text).expect_err(expected).to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
