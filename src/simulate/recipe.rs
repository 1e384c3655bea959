//! Recipes of synthetic captures: the scene, the camera and everything that is wrong with them.

use std::path::{Path, PathBuf};

use super::blemish::{Dust, Texture};
use crate::brdf::Model;
use crate::capture::table::{Section, Source};
use crate::capture::{Camera, Encoding, Object, Sensor, file};
use crate::error::{Error, Result, nearest};
use crate::files;
use crate::lighting::LightingDescription;

/// Most values of a picture: a gigabyte as float.
const LARGEST_PICTURE: u64 = 1 << 28;
/// Most views and most exposures of a view.
const MOST_VIEWS: i64 = 100_000;
const MOST_EXPOSURES: usize = 32;

/// What is to be simulated, with every default filled in.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// The folder that relative paths start from.
    pub folder: PathBuf,
    /// The capture's name.
    pub name: String,
    /// Where all randomness comes from.
    pub seed: u64,
    /// Channel names.
    pub channels: Vec<String>,
    /// The object as `capture.toml` describes it.
    pub object: Object,
    /// The camera, as in `capture.toml`.
    pub camera: Camera,
    /// Stated orbit angles, degrees.
    pub orbits_deg: Vec<f64>,
    /// Roll of the measurement plane about the optical axis, degrees.
    pub plane_roll_deg: f64,
    /// `[brdf]`.
    pub brdf: Model,
    /// `[lighting]`.
    pub lighting: LightingDescription,
    /// The sensor, as in `capture.toml`.
    pub sensor: Sensor,
    /// What becomes of the sensor's signal.
    pub output: Output,
    /// What is wrong.
    pub faults: Faults,
}

/// How photographs are exposed and stored.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// File format.
    pub format: PhotoFormat,
    /// Exposure times of each view, seconds.
    pub exposures_s: Vec<f64>,
    /// Linear stored units per unit radiance and second; `None`: by the sensor's responsivity, else 1 for
    /// EXR and so that the shortest exposure is filled for PNG.
    pub scale: Option<f64>,
    /// Share of the white level that the brightest radiance within |θo′| ≤ 80° reaches in the shortest
    /// exposure, where the scale is chosen so.
    pub fill: f64,
}

/// File formats that a simulated camera writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhotoFormat {
    /// OpenEXR, 16-bit floating point.
    ExrHalf,
    /// OpenEXR, 32-bit floating point.
    ExrFloat,
    /// PNG with this many significant bits: 8 in an 8-bit file, more in the lower bits of a 16-bit file.
    Png {
        /// 8 to 16.
        bits: u32,
    },
}

/// What is wrong with the set. All at their defaults: nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Faults {
    /// Photons are counted (needs the sensor's `full_well_e`).
    pub shot_noise: bool,
    /// The sensor's read noise.
    pub read_noise: bool,
    /// Radiance of what is behind the object, W m⁻² sr⁻¹, per channel or one for all.
    pub background: Vec<f64>,
    /// Veiling glare: share of the light that the lens spreads evenly over the picture.
    pub flare: f64,
    /// Standard deviation of the true orbit angles from the stated ones, degrees.
    pub orbit_jitter_deg: f64,
    /// Displacement of the object from the orbit's centre, metres, in the frame of the orbit angles (z up).
    pub object_offset_m: [f64; 3],
    /// Standard deviation of each view's own displacement of the object, in each direction, metres.
    pub wobble_m: f64,
    /// Turn of a cylinder's axis about the optical axis, degrees.
    pub tilt_deg: f64,
    /// Views that are left out, counted from 0.
    pub missing_views: Vec<usize>,
    /// Share of the views that are left out besides, at random.
    pub missing_share: f64,
    /// Standard deviation of the logarithm of true over stated exposure times.
    pub exposure_jitter: f64,
    /// Standard deviation of the logarithm of the lamps' brightness from view to view.
    pub brightness_jitter: f64,
    /// Albedo that varies over the object.
    pub texture: Option<Texture>,
    /// Specks on the object.
    pub dust: Option<Dust>,
    /// What `capture.toml` does not say although it is so.
    pub unstated: Vec<Unstated>,
}

/// A fact that `capture.toml` may keep silent about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unstated {
    /// The lens's distortion.
    Distortion,
    /// The vignetting.
    Vignetting,
    /// Full well, read noise and responsivity.
    Noise,
    /// The responsivity: radiance is then relative.
    Responsivity,
    /// How far the orbit angles are off.
    OrbitSigma,
}

const UNSTATED: [(&str, Unstated); 5] = [
    ("distortion", Unstated::Distortion),
    ("vignetting", Unstated::Vignetting),
    ("noise", Unstated::Noise),
    ("responsivity", Unstated::Responsivity),
    ("orbit_sigma", Unstated::OrbitSigma),
];

impl Unstated {
    /// The word in the recipe.
    pub fn word(self) -> &'static str {
        UNSTATED
            .iter()
            .find(|(_, u)| *u == self)
            .map_or("", |(word, _)| word)
    }
}

impl Recipe {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// All faults of the file at once: keys that are not known (with the nearest that is), values of the
    /// wrong type or out of range, facts that are missing or contradict each other.
    pub fn read(path: &Path) -> Result<Self> {
        let text = files::text(path)
            .map_err(|e| e.advice("Give a recipe file, as pipelines/simulate.toml."))?;
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
        let name = root.text("name").unwrap_or("synthetic capture").to_string();
        let seed = match root.integer("seed") {
            Some(seed) if seed < 0 => {
                let what = format!("expected a whole number from 0, found {seed}");
                root.fault("seed", what, None);
                0
            }
            seed => seed.unwrap_or(1) as u64,
        };
        let channels = channels(&root);
        let described = file::described(&root, folder);
        if described
            .as_ref()
            .is_some_and(|(object, _)| object.mask.is_some())
        {
            let what = "a synthetic capture has no mask";
            root.section("object").fault("mask", what, None);
        }
        let (orbits_deg, plane_roll_deg) = views(&root.section("views"));
        let sensor_section = root.section("sensor");
        let sensor = sensor(&sensor_section, folder);
        let output = output(&sensor_section, &sensor, &channels);
        sensor_section.check_unknown();
        let faults = faults(&root.section("faults"), &sensor, orbits_deg.len());
        for key in ["brdf", "lighting"] {
            if !root.section(key).exists() {
                root.missing(
                    key,
                    "A synthetic capture shows a known material under known light.",
                );
            }
        }
        if let Some((_, camera)) = &described {
            let [w, h] = camera.image_size.map(u64::from);
            if w * h * channels.len() as u64 > LARGEST_PICTURE {
                let what =
                    format!("expected at most {LARGEST_PICTURE} values a picture, found {w} x {h}");
                root.section("camera").fault("image_size", what, None);
            }
        }
        root.check_unknown();
        let mut errors = Vec::new();
        let plain = source.values()?;
        let sub = |key: &str| plain.get(key).and_then(toml::Value::as_table);
        let mut keep = |e: Error| errors.push(source.locate(&table, e));
        let brdf = sub("brdf").and_then(|t| Model::from_table(t).map_err(&mut keep).ok());
        let lighting =
            sub("lighting").and_then(|t| LightingDescription::from_toml(t).map_err(&mut keep).ok());
        let mut all = source.into_faults();
        all.append(&mut errors);
        match (Error::all(all), described, brdf, lighting) {
            (Some(error), ..) => Err(error),
            (None, Some((object, camera)), Some(brdf), Some(lighting)) => Ok(Self {
                folder: folder.to_path_buf(),
                name,
                seed,
                channels,
                object,
                camera,
                orbits_deg,
                plane_roll_deg,
                brdf,
                lighting,
                sensor,
                output,
                faults,
            }),
            _ => Err(Error::input("the recipe is incomplete").file(path)),
        }
    }
}

fn channels(root: &Section<'_>) -> Vec<String> {
    let names = root.texts("channels").unwrap_or(vec!["R", "G", "B"]);
    let plain = |name: &&str| {
        !name.is_empty() && name.len() < 32 && name.bytes().all(|b| b.is_ascii_alphanumeric())
    };
    let mut sorted = names.clone();
    sorted.sort_unstable();
    sorted.dedup();
    if names.is_empty() || !names.iter().all(plain) || sorted.len() != names.len() {
        let what = "expected different names of letters and digits";
        root.fault(
            "channels",
            what,
            Some("For example [\"R\", \"G\", \"B\"] or [\"Y\"]."),
        );
    }
    names.into_iter().map(String::from).collect()
}

/// Stated orbit angles and the plane's roll, degrees.
fn views(section: &Section<'_>) -> (Vec<f64>, f64) {
    let count = match section.integer("count") {
        Some(n) if (1..=MOST_VIEWS).contains(&n) => n as usize,
        Some(n) => {
            let what = format!("expected 1 to {MOST_VIEWS}, found {n}");
            section.fault("count", what, None);
            1
        }
        None => {
            if !section.has("count") {
                section.missing(
                    "count",
                    "Write [views] with count = 72, the number of views.",
                );
            }
            1
        }
    };
    let start = section.number("orbit_start_deg").unwrap_or(0.0);
    let step = section
        .number_where("orbit_step_deg", "an angle other than 0", |s| s != 0.0)
        .unwrap_or(360.0 / count as f64);
    let roll = section.number("plane_roll_deg").unwrap_or(0.0);
    section.check_unknown();
    // Views that come round to the first again would be one view given twice.
    if (count - 1) as f64 * step.abs() > 360.0 - 0.5e-6 * count as f64 {
        let what = format!("expected at most one turn, found {count} views of {step}° each");
        section.fault("orbit_step_deg", what, None);
    }
    let orbits = (0..count).map(|k| start + k as f64 * step).collect();
    (orbits, roll)
}

fn sensor(section: &Section<'_>, folder: &Path) -> Sensor {
    for key in ["dark", "flat"] {
        if section.has(key) {
            let what = "a synthetic capture has no such frame";
            section.fault(
                key,
                what,
                Some("Leave it out; black_level and vignetting say the same."),
            );
        }
    }
    let sensor = file::sensor(section, folder);
    if let Some(Encoding::Response(_) | Encoding::Recover(_)) = sensor.encoding {
        let what = "expected linear, srgb or gamma: tables of a response are read, not written";
        section.fault("encoding", what, None);
    }
    for (key, given) in [
        ("responsivity", sensor.responsivity.is_some()),
        ("read_noise_e", sensor.read_noise_e.is_some()),
    ] {
        if given && sensor.full_well_e.is_none() {
            let what = format!("expected full_well_e beside {key}, found none");
            section.fault(
                key,
                what,
                Some("full_well_e is the number of electrons at white_level."),
            );
        }
    }
    sensor
}

fn output(section: &Section<'_>, sensor: &Sensor, channels: &[String]) -> Output {
    let png = match section.text("format") {
        None | Some("exr-half" | "exr-float") => false,
        Some("png") => true,
        Some(other) => {
            let names = ["exr-half", "exr-float", "png"];
            let hint = nearest(other, &names).map(|n| format!("Did you mean \"{n}\"?"));
            let what = format!("expected one of {}, found \"{other}\"", names.join(", "));
            section.fault("format", what, hint.as_deref());
            false
        }
    };
    let bits = section
        .number_where("bits", "a whole number from 8 to 16", |b| {
            b.fract() == 0.0 && (8.0..=16.0).contains(&b)
        })
        .unwrap_or(16.0) as u32;
    if section.has("bits") && !png {
        section.fault("bits", "it belongs to format = \"png\"", None);
    }
    let encoded = !matches!(sensor.encoding, None | Some(Encoding::Linear));
    if png {
        let known = [vec!["R", "G", "B"], vec!["Y"]];
        if !known.iter().any(|k| channels == k) {
            section.fault(
                "format",
                "a PNG holds the channels R, G, B or Y, and no others",
                None,
            );
        }
        let largest = f64::from((1u32 << bits) - 1);
        if encoded && ![8, 16].contains(&bits) {
            let what = "expected 8 or 16 bits: curves are defined over the whole range of the file";
            section.fault("bits", what, None);
        }
        if sensor.white_level.is_some_and(|w| w > largest) {
            section.fault("white_level", format!("expected at most {largest}"), None);
        }
        if sensor.black_level.is_some_and(|b| b < 0.0 || b >= largest) {
            section.fault("black_level", format!("expected 0 to {largest}"), None);
        }
    } else {
        if encoded {
            section.fault(
                "encoding",
                "an EXR is linear",
                Some("Use format = \"png\"."),
            );
        }
        if sensor.full_well_e.is_some() && sensor.white_level.is_none() {
            let what = "expected the stored value at which full_well_e is reached, found none";
            section.fault("white_level", what, None);
        }
    }
    let exposures_s = section.number_list("exposures_s").unwrap_or(vec![1.0]);
    if !(1..=MOST_EXPOSURES).contains(&exposures_s.len()) || exposures_s.iter().any(|t| !(*t > 0.0))
    {
        let what = format!("expected 1 to {MOST_EXPOSURES} exposure times above 0, in seconds");
        section.fault("exposures_s", what, None);
    }
    let scale = section.number_where("scale", "a number above 0", |s| s > 0.0);
    if scale.is_some() && sensor.responsivity.is_some() {
        section.fault("scale", "expected scale or responsivity, found both", None);
    }
    let fill = section.number_where("fill", "a share above 0", |f| f > 0.0 && f <= 100.0);
    Output {
        format: match (png, section.word("format")) {
            (true, _) => PhotoFormat::Png { bits },
            (false, Some("exr-float")) => PhotoFormat::ExrFloat,
            _ => PhotoFormat::ExrHalf,
        },
        exposures_s,
        scale,
        fill: fill.unwrap_or(0.8),
    }
}

fn faults(section: &Section<'_>, sensor: &Sensor, views: usize) -> Faults {
    let at_least_0 = |key: &'static str| {
        section
            .number_where(key, "a number of at least 0", |x| x >= 0.0)
            .unwrap_or(0.0)
    };
    let counted = sensor.full_well_e.is_some();
    for key in ["shot_noise", "read_noise"] {
        if section.boolean(key) == Some(true) && !counted {
            let what = "noise needs the sensor's full_well_e, and none is given";
            section.fault(
                key,
                what,
                Some("Add full_well_e (and read_noise_e) to [sensor]."),
            );
        }
    }
    let background = section.number_list("background").unwrap_or(vec![0.0]);
    if background.iter().any(|b| *b < 0.0) {
        section.fault("background", "expected radiances of at least 0", None);
    }
    let share = |key: &'static str| {
        section
            .number_where(key, "a share from 0 to below 1", |x| {
                (0.0..1.0).contains(&x)
            })
            .unwrap_or(0.0)
    };
    let missing_views = match section.has("missing_views") {
        true => section.number_list("missing_views").unwrap_or_default(),
        false => Vec::new(),
    };
    if missing_views
        .iter()
        .any(|v| v.fract() != 0.0 || *v < 0.0 || *v >= views as f64)
    {
        let what = format!(
            "expected numbers of views from 0 to {}",
            views.saturating_sub(1)
        );
        section.fault("missing_views", what, None);
    }
    let faults = Faults {
        shot_noise: section.boolean("shot_noise").unwrap_or(counted),
        read_noise: section.boolean("read_noise").unwrap_or(counted),
        background,
        flare: share("flare"),
        orbit_jitter_deg: at_least_0("orbit_jitter_deg"),
        object_offset_m: section.numbers::<3>("object_offset_m").unwrap_or_default(),
        wobble_m: at_least_0("wobble_m"),
        tilt_deg: section
            .number_where("tilt_deg", "an angle from -45 to 45", |t| t.abs() <= 45.0)
            .unwrap_or(0.0),
        missing_views: missing_views.into_iter().map(|v| v as usize).collect(),
        missing_share: share("missing_share"),
        exposure_jitter: at_least_0("exposure_jitter"),
        brightness_jitter: at_least_0("brightness_jitter"),
        texture: texture(&section.section("texture")),
        dust: dust(&section.section("dust")),
        unstated: unstated(section),
    };
    section.check_unknown();
    faults
}

fn texture(section: &Section<'_>) -> Option<Texture> {
    let amplitude = section.number_where("amplitude", "a share from 0 to 1", |x| {
        (0.0..=1.0).contains(&x)
    });
    let scale_m = section.number_where("scale_m", "a length above 0", |x| x > 0.0);
    if section.exists() && !(section.has("amplitude") && section.has("scale_m")) {
        section.missing(
            "amplitude",
            "Write texture = { amplitude = 0.02, scale_m = 0.002 }.",
        );
    }
    section.check_unknown();
    Some(Texture {
        amplitude: amplitude?,
        scale_m: scale_m?,
    })
}

fn dust(section: &Section<'_>) -> Option<Dust> {
    let count = section.number_where("count", "a whole number from 0 to 1000000", |n| {
        n.fract() == 0.0 && (0.0..=1e6).contains(&n)
    });
    let radius_m = section.number_where("radius_m", "a length above 0", |x| x > 0.0);
    let opacity = section.number_where("opacity", "a share from 0 to 1", |x| {
        (0.0..=1.0).contains(&x)
    });
    if section.exists() && !(section.has("count") && section.has("radius_m")) {
        section.missing(
            "count",
            "Write dust = { count = 200, radius_m = 0.0002, opacity = 0.5 }.",
        );
    }
    section.check_unknown();
    Some(Dust {
        count: count? as usize,
        radius_m: radius_m?,
        opacity: opacity.unwrap_or(0.5),
    })
}

fn unstated(section: &Section<'_>) -> Vec<Unstated> {
    let mut all = Vec::new();
    for word in section.texts("unstated").unwrap_or_default() {
        match UNSTATED.iter().find(|(w, _)| *w == word) {
            Some((_, fact)) => all.push(*fact),
            None => {
                let words = UNSTATED.map(|(w, _)| w);
                let hint = nearest(word, &words).map(|w| format!("Did you mean \"{w}\"?"));
                let what = format!("expected some of {}, found \"{word}\"", words.join(", "));
                section.fault("unstated", what, hint.as_deref());
            }
        }
    }
    all
}
