//! Recipes: what to do with a capture.

use std::path::{Path, PathBuf};

use super::scale::ScaleDescription;
use crate::brdf::Model;
use crate::capture::table::{Section, Source};
use crate::error::{Error, Result, nearest};
use crate::files;
use crate::lighting::LightingDescription;
use crate::recover::lighting::Regularisation;

/// θo′ bins unless a recipe says otherwise.
pub(super) const LOCALS: usize = 180;

/// A recipe with every default filled in.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// The folder that relative paths start from.
    pub folder: PathBuf,
    /// What is recovered.
    pub recover: Recover,
    /// `[light_field]`.
    pub light_field: LightFieldOptions,
    /// `[brdf]`: what is known of the surface.
    pub brdf: Option<Model>,
    /// `[lighting]`: what is known of the light.
    pub lighting: Option<LightingDescription>,
    /// `[scale]`: what anchors the scale when both are recovered.
    pub scale: ScaleDescription,
    /// `[recovery]`.
    pub recovery: RecoveryOptions,
    /// Title of the report.
    pub title: Option<String>,
}

/// What is recovered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recover {
    /// The lighting, from a known BRDF.
    Lighting,
    /// The BRDF, from known lighting.
    Brdf,
    /// Both.
    Both,
    /// Nothing: stop at the light field.
    None,
}

const RECOVER: [(&str, Recover); 4] = [
    ("lighting", Recover::Lighting),
    ("brdf", Recover::Brdf),
    ("both", Recover::Both),
    ("none", Recover::None),
];

impl Recover {
    /// The word in the recipe.
    pub fn word(self) -> &'static str {
        RECOVER
            .iter()
            .find(|(_, r)| *r == self)
            .map_or("none", |(word, _)| word)
    }
}

/// How photographs become a light field.
#[derive(Clone, Debug, PartialEq)]
pub struct LightFieldOptions {
    /// α bins over the full circle.
    pub normals: usize,
    /// θo′ bins over (−90°, 90°).
    pub locals: usize,
    /// |θo′| beyond which samples are left out, degrees; `None`: decided by the pixels' footprint and
    /// the geometry's error.
    pub limb_cut_deg: Option<f64>,
    /// Image rows about the cross-section that are averaged; `None`: decided by the photos.
    pub rows: Option<usize>,
}

/// How light or material are recovered.
#[derive(Clone, Debug, PartialEq)]
pub struct RecoveryOptions {
    /// Largest frequency; `None`: as far as the data go.
    pub band: Option<usize>,
    /// How the strength of the prior is chosen.
    pub regularisation: Regularisation,
    /// Impose that light and BRDF are not negative.
    pub non_negative: bool,
    /// Impose Helmholtz reciprocity on the BRDF.
    pub reciprocal: bool,
    /// Probability of the intervals that are shown.
    pub confidence: f64,
}

impl Recipe {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// All faults of the file at once: keys that are not known (with the nearest that is), values of the
    /// wrong type or out of range, facts that the recovery needs and that are missing.
    pub fn read(path: &Path) -> Result<Self> {
        let text = files::text(path)
            .map_err(|e| e.advice("Give a recipe file, as those in the folder pipelines/."))?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        Self::parse(&text, path, &folder)
    }

    /// The same from text; `path` is for messages.
    ///
    /// # Errors
    /// As [`Recipe::read`].
    pub fn parse(text: &str, path: &Path, folder: &Path) -> Result<Self> {
        let source = Source::new(path, text);
        let table = source.parse()?;
        let root = Section::root(&source, &table);
        if let Some(format) = root.integer("format")
            && format != 1
        {
            root.fault("format", format!("expected 1, found {format}"), None);
        }
        let words = RECOVER.map(|(word, _)| word);
        let recover = match root.text("recover") {
            Some(word) => match RECOVER.iter().find(|(w, _)| *w == word) {
                Some((_, recover)) => *recover,
                None => {
                    let hint = nearest(word, &words).map(|w| format!("Did you mean \"{w}\"?"));
                    let what = format!("expected one of {}, found \"{word}\"", words.join(", "));
                    root.fault("recover", what, hint.as_deref());
                    Recover::None
                }
            },
            None => {
                if !root.has("recover") {
                    root.missing(
                        "recover",
                        "Write recover = \"lighting\", \"brdf\", \"both\" or \"none\".",
                    );
                }
                Recover::None
            }
        };
        let light_field = light_field(&root.section("light_field"));
        let recovery = recovery(&root.section("recovery"));
        if root.section("scale").exists() && recover != Recover::Both {
            root.fault(
                "scale",
                "a scale is only free when light and material are both unknown",
                Some("Remove [scale], or write recover = \"both\"."),
            );
        }
        let report = root.section("report");
        let title = report.text("title").map(String::from);
        report.check_unknown();
        let (has_brdf, has_lighting) = (
            root.section("brdf").exists(),
            root.section("lighting").exists(),
        );
        match recover {
            Recover::Lighting if !has_brdf => root.missing(
                "brdf",
                "The lighting is recovered from a known BRDF: give its model and parameters, or a table.",
            ),
            Recover::Brdf if !has_lighting => root.missing(
                "lighting",
                "The BRDF is recovered from known lighting: give its sources, or a table.",
            ),
            _ => {}
        }
        root.check_unknown();
        let located = |e: Error| source.locate(&table, e);
        let mut faults = Vec::new();

        // What materials and lights hold is read by their own modules.
        let plain = source.values()?;
        let sub = |key: &str| plain.get(key).and_then(toml::Value::as_table);
        let brdf = match sub("brdf").map(Model::from_table).transpose() {
            Ok(brdf) => brdf,
            Err(e) => {
                faults.push(located(e));
                None
            }
        };
        let lighting = match sub("lighting")
            .map(LightingDescription::from_toml)
            .transpose()
        {
            Ok(lighting) => lighting,
            Err(e) => {
                faults.push(located(e));
                None
            }
        };
        let scale = match sub("scale").map(ScaleDescription::from_toml).transpose() {
            Ok(scale) => scale.unwrap_or_default(),
            Err(e) => {
                faults.push(located(e));
                ScaleDescription::default()
            }
        };
        let mut all = source.into_faults();
        all.append(&mut faults);
        match Error::all(all) {
            Some(error) => Err(error),
            None => Ok(Self {
                folder: folder.to_path_buf(),
                recover,
                light_field,
                brdf,
                lighting,
                scale,
                recovery,
                title,
            }),
        }
    }

    /// The files that its facts come from.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files = Vec::new();
        if let Some(Model::Table(path)) = &self.brdf {
            files.push(self.folder.join(path));
        }
        if let Some(lighting) = &self.lighting {
            files.extend(lighting.files(&self.folder));
        }
        files
    }

    /// The recipe with every default written out.
    pub fn to_toml(&self) -> String {
        use toml::Value;
        let mut root = toml::Table::new();
        let integer = |n: usize| Value::Integer(i64::try_from(n).unwrap_or(i64::MAX));
        root.insert("format".into(), Value::Integer(1));
        root.insert("recover".into(), self.recover.word().into());
        let mut field = toml::Table::new();
        field.insert("normals".into(), integer(self.light_field.normals));
        field.insert("locals".into(), integer(self.light_field.locals));
        field.insert(
            "limb_cut_deg".into(),
            self.light_field
                .limb_cut_deg
                .map_or("auto".into(), Value::Float),
        );
        field.insert(
            "rows".into(),
            self.light_field.rows.map_or("auto".into(), integer),
        );
        root.insert("light_field".into(), field.into());
        if let Some(brdf) = &self.brdf {
            root.insert("brdf".into(), brdf.to_table().into());
        }
        if let Some(lighting) = &self.lighting
            && let Ok(value) = Value::try_from(lighting)
        {
            root.insert("lighting".into(), value);
        }
        if let Some(scale) = self.scale.to_table() {
            root.insert("scale".into(), scale.into());
        }
        let mut recovery = toml::Table::new();
        recovery.insert(
            "band".into(),
            self.recovery.band.map_or("auto".into(), integer),
        );
        let regularisation = match self.recovery.regularisation {
            Regularisation::Evidence => "evidence".into(),
            Regularisation::Gcv => "gcv".into(),
            Regularisation::Truncate => "truncate".into(),
            Regularisation::None => "none".into(),
            Regularisation::Fixed(strength) => Value::Float(strength),
        };
        recovery.insert("regularisation".into(), regularisation);
        recovery.insert("non_negative".into(), self.recovery.non_negative.into());
        recovery.insert("reciprocal".into(), self.recovery.reciprocal.into());
        recovery.insert("confidence".into(), self.recovery.confidence.into());
        root.insert("recovery".into(), recovery.into());
        if let Some(title) = &self.title {
            let mut report = toml::Table::new();
            report.insert("title".into(), title.as_str().into());
            root.insert("report".into(), report.into());
        }
        root.to_string()
    }
}

/// Bins that a light field may have on a side: enough for any lens, and an image that fits in memory.
const BINS: std::ops::RangeInclusive<i64> = 8..=7200;

fn light_field(section: &Section<'_>) -> LightFieldOptions {
    let bins = |key: &'static str, default: usize| match section.integer(key) {
        Some(n) if BINS.contains(&n) => n as usize,
        Some(n) => {
            let what = format!("expected {} to {}, found {n}", BINS.start(), BINS.end());
            section.fault(key, what, None);
            default
        }
        None => default,
    };
    let options = LightFieldOptions {
        normals: bins("normals", 720),
        locals: bins("locals", LOCALS),
        limb_cut_deg: unless_word(section, "limb_cut_deg", &["auto"]).and_then(|_| {
            section.number_where("limb_cut_deg", "\"auto\" or degrees from 10 to 90", |x| {
                (10.0..=90.0).contains(&x)
            })
        }),
        rows: unless_word(section, "rows", &["auto"]).and_then(|_| {
            section
                .number_where("rows", "\"auto\" or a whole number of rows from 1", |x| {
                    x >= 1.0 && x.fract() == 0.0 && x <= 1e6
                })
                .map(|x| x as usize)
        }),
    };
    section.check_unknown();
    options
}

fn recovery(section: &Section<'_>) -> RecoveryOptions {
    let regularisation = match unless_word(
        section,
        "regularisation",
        &["auto", "evidence", "gcv", "truncate", "none"],
    ) {
        Some(_) => section
            .number_where(
                "regularisation",
                "a number of at least 0, or one of auto, evidence, gcv, truncate, none",
                |x| x >= 0.0,
            )
            .map_or(Regularisation::Evidence, Regularisation::Fixed),
        None => match section.word("regularisation") {
            Some("gcv") => Regularisation::Gcv,
            Some("truncate") => Regularisation::Truncate,
            Some("none") => Regularisation::None,
            _ => Regularisation::Evidence,
        },
    };
    let options = RecoveryOptions {
        band: unless_word(section, "band", &["auto"]).and_then(|_| {
            section
                .number_where("band", "\"auto\" or a whole number from 0 to 1000", |x| {
                    (0.0..=1000.0).contains(&x) && x.fract() == 0.0
                })
                .map(|x| x as usize)
        }),
        regularisation,
        non_negative: section.boolean("non_negative").unwrap_or(true),
        reciprocal: section.boolean("reciprocal").unwrap_or(true),
        confidence: section
            .number_where("confidence", "a probability from 0.5 to 0.9999", |x| {
                (0.5..=0.9999).contains(&x)
            })
            .unwrap_or(0.95),
    };
    section.check_unknown();
    options
}

/// `Some` if the key stands there and is not one of the words: then it is to be read as a number.
fn unless_word(section: &Section<'_>, key: &'static str, words: &[&str]) -> Option<()> {
    if !section.has(key) {
        return None;
    }
    match section.word(key) {
        Some(word) if words.contains(&word) => None,
        _ => Some(()),
    }
}
