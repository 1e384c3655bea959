//! The recipe of a validation (`pipelines/validate.toml`).

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use toml::Table;

use super::cell::{Cell, Recovered};
use super::scene;
use crate::error::{Error, Result, nearest};

/// Most views, columns and draws that make sense; beyond them it is a slip of the pen.
const MOST: usize = 100_000;

/// A validation: named surfaces and lightings, and the studies made of them.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyRecipe {
    format: u32,
    /// Title of the report.
    #[serde(default = "default_title")]
    pub title: String,
    /// Seed of every draw.
    #[serde(default)]
    seed: u32,
    /// Surfaces, as a recipe's `[brdf]`.
    brdf: BTreeMap<String, Table>,
    /// Lightings, as a recipe's `[lighting]` and more.
    lighting: BTreeMap<String, Table>,
    study: Vec<Study>,
    /// The text it was read from.
    #[serde(skip)]
    pub text: String,
}

/// All combinations of some surfaces, lightings, noises and numbers of views.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Study {
    name: String,
    recover: Recovered,
    brdf: Vec<String>,
    lighting: Vec<String>,
    noise: Vec<f64>,
    views: Vec<usize>,
    #[serde(default = "full_circle")]
    arc_deg: f64,
    locals: usize,
    #[serde(default = "no_cut")]
    limb_cut_deg: f64,
    draws: usize,
    /// What the default size changes; a study without it is made by `--full` only.
    default: Option<Smaller>,
}

/// The part of a study that the default size makes; what is not named stays.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Smaller {
    brdf: Option<Vec<String>>,
    lighting: Option<Vec<String>>,
    noise: Option<Vec<f64>>,
    views: Option<Vec<usize>>,
    draws: Option<usize>,
}

fn default_title() -> String {
    "Validation".to_owned()
}

fn full_circle() -> f64 {
    360.0
}

fn no_cut() -> f64 {
    90.0
}

/// The cells to be drawn, in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The cells.
    pub cells: Vec<Cell>,
}

impl StudyRecipe {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// If the file cannot be read, is not TOML, holds an unknown key, or names, numbers or descriptions that do not fit.
    pub fn read(path: &Path) -> Result<Self> {
        let text =
            crate::files::text(path).map_err(|e| e.advice("Try pipelines/validate.toml."))?;
        Self::parse(&text).map_err(|e| e.file(path))
    }

    /// The same from text.
    ///
    /// # Errors
    /// As [`StudyRecipe::read`].
    pub fn parse(text: &str) -> Result<Self> {
        let mut recipe: Self = toml::from_str(text).map_err(|e| {
            let line = e
                .span()
                .and_then(|s| text.get(..s.start))
                .map(|before| before.matches('\n').count() + 1);
            let error = Error::input(e.message());
            match line {
                Some(line) => error.line(line),
                None => error,
            }
        })?;
        text.clone_into(&mut recipe.text);
        match Error::all(recipe.faults()) {
            Some(error) => Err(error),
            None => Ok(recipe),
        }
    }

    fn faults(&self) -> Vec<Error> {
        let mut faults = Vec::new();
        if self.format != 1 {
            faults.push(Error::input(format!("expected 1, found {}", self.format)).key("format"));
        }
        let plain = |name: &str| {
            !name.is_empty()
                && name
                    .chars()
                    .all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c))
        };
        let names = self.brdf.keys().chain(self.lighting.keys());
        for name in names.chain(self.study.iter().map(|s| &s.name)) {
            if !plain(name) {
                faults.push(Error::input(format!(
                    "expected a name of letters, digits, - _ and ., found \"{name}\""
                )));
            }
        }
        for (name, table) in &self.brdf {
            if table.contains_key("table") {
                faults.push(
                    Error::input("expected an analytic model, found a table")
                        .key(format!("brdf.{name}")),
                );
            } else if let Err(e) = scene::material(table) {
                // The reader of a table knows it as [brdf], not by its name.
                faults.push(Error::input(format!("[brdf.{name}] {e}")));
            }
        }
        for (name, table) in &self.lighting {
            if let Err(e) = scene::lighting(table) {
                faults.push(Error::input(format!("[lighting.{name}] {e}")));
            }
        }
        for study in &self.study {
            faults.extend(study.faults(&self.brdf, &self.lighting));
        }
        faults
    }

    /// The cells of the default size, or all of them.
    pub fn plan(&self, full: bool) -> Plan {
        let cells = self
            .study
            .iter()
            .filter_map(|study| match (full, &study.default) {
                (true, _) => Some(study.clone()),
                (false, Some(smaller)) => Some(study.smaller(smaller)),
                (false, None) => None,
            })
            .flat_map(|study| self.cells(&study))
            .collect();
        Plan { cells }
    }

    fn cells(&self, study: &Study) -> Vec<Cell> {
        let mut cells = Vec::new();
        for brdf in &study.brdf {
            for lighting in &study.lighting {
                for &views in &study.views {
                    for &noise in &study.noise {
                        cells.push(Cell {
                            study: study.name.clone(),
                            recovered: study.recover,
                            brdf: brdf.clone(),
                            brdf_table: self.brdf.get(brdf).cloned().unwrap_or_default(),
                            lighting: lighting.clone(),
                            lighting_table: self
                                .lighting
                                .get(lighting)
                                .cloned()
                                .unwrap_or_default(),
                            noise,
                            views,
                            arc_deg: study.arc_deg,
                            locals: study.locals,
                            limb_cut_deg: study.limb_cut_deg,
                            draws: study.draws,
                            seed: u64::from(self.seed),
                        });
                    }
                }
            }
        }
        cells
    }
}

impl Study {
    fn smaller(&self, smaller: &Smaller) -> Self {
        let mut study = self.clone();
        if let Some(brdf) = &smaller.brdf {
            study.brdf.clone_from(brdf);
        }
        if let Some(lighting) = &smaller.lighting {
            study.lighting.clone_from(lighting);
        }
        if let Some(noise) = &smaller.noise {
            study.noise.clone_from(noise);
        }
        if let Some(views) = &smaller.views {
            study.views.clone_from(views);
        }
        if let Some(draws) = smaller.draws {
            study.draws = draws;
        }
        study
    }

    fn faults(
        &self,
        brdfs: &BTreeMap<String, Table>,
        lightings: &BTreeMap<String, Table>,
    ) -> Vec<Error> {
        let mut faults = Vec::new();
        let fault = |key: &str, what: String| {
            Error::input(what).key(format!("study \"{}\", {key}", self.name))
        };
        let sizes =
            std::iter::once(self.clone()).chain(self.default.iter().map(|s| self.smaller(s)));
        for study in sizes {
            for (key, names, known) in [
                ("brdf", &study.brdf, brdfs),
                ("lighting", &study.lighting, lightings),
            ] {
                let known: Vec<&str> = known.keys().map(String::as_str).collect();
                for name in names.iter().filter(|n| !known.contains(&n.as_str())) {
                    let error = fault(key, format!("there is no [{key}.{name}]"));
                    faults.push(match nearest(name, &known) {
                        Some(near) => error.advice(format!("Did you mean \"{near}\"?")),
                        None => error.advice(format!("There are {}.", known.join(", "))),
                    });
                }
            }
            for noise in study.noise.iter().filter(|n| !(**n > 0.0 && **n <= 1.0)) {
                faults.push(fault(
                    "noise",
                    format!(
                        "expected a share above 0 and up to 1 of the largest value, found {noise}"
                    ),
                ));
            }
            let counts = study.views.iter().map(|v| ("views", *v, 1));
            let counts = counts.chain([("locals", study.locals, 2), ("draws", study.draws, 2)]);
            for (key, value, least) in counts {
                if !(least..=MOST).contains(&value) {
                    faults.push(fault(
                        key,
                        format!("expected {least} to {MOST}, found {value}"),
                    ));
                }
            }
        }
        for (key, value, most) in [
            ("arc_deg", self.arc_deg, 360.0),
            ("limb_cut_deg", self.limb_cut_deg, 90.0),
        ] {
            if !(value > 0.0 && value <= most) {
                faults.push(fault(
                    key,
                    format!("expected an angle above 0 and up to {most}, found {value}"),
                ));
            }
        }
        faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECIPE: &str = "format = 1
        [brdf.a]
        model = 'lambertian'
        albedo = 0.5
        [brdf.b]
        model = 'phong'
        specular = 0.5
        exponent = 8
        [lighting.sun]
        sources = [{ theta_deg = 10, irradiance = 1 }]
        [[study]]
        name = 's'
        recover = 'lighting'
        brdf = ['a', 'b']
        lighting = ['sun']
        noise = [0.1, 0.01]
        views = [72]
        locals = 30
        draws = 100
        default = { brdf = ['b'], draws = 10 }
        [[study]]
        name = 't'
        recover = 'both'
        brdf = ['b']
        lighting = ['sun']
        noise = [0.01]
        views = [24]
        arc_deg = 120
        locals = 30
        draws = 100";

    #[test]
    fn the_default_size_is_a_part_of_the_full_one() {
        let recipe = StudyRecipe::parse(RECIPE).unwrap();
        let (part, full) = (recipe.plan(false).cells, recipe.plan(true).cells);
        assert_eq!((part.len(), full.len()), (2, 5));
        assert!(part.iter().all(|c| c.brdf == "b" && c.draws == 10));
        assert_eq!(full[4].normals(), 72);
        for cell in part {
            assert!(full.iter().any(|c| c.label() == cell.label()));
        }
    }

    #[test]
    fn all_faults_are_named() {
        let wrong = RECIPE
            .replace("brdf = ['a', 'b']", "brdf = ['a', 'bb']")
            .replace("noise = [0.1, 0.01]", "noise = [10]")
            .replace("arc_deg = 120", "arc_deg = 400")
            .replace("exponent = 8", "exponnt = 8");
        let message = StudyRecipe::parse(&wrong).unwrap_err().to_string();
        for part in ["[brdf.bb]", "found 10", "found 400", "exponnt", "brdf.b"] {
            assert!(message.contains(part), "{part} not in\n{message}");
        }
        let message = StudyRecipe::parse(&RECIPE.replace("draws = 10 }", "drows = 10 }"))
            .unwrap_err()
            .to_string();
        assert!(message.contains("drows"), "{message}");
    }
}
