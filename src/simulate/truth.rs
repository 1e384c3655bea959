//! What is true of a synthetic capture, as files: `truth/`, in the form of the test photographs'.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use toml::{Table, Value};

use super::plan::PlannedView;
use super::recipe::{PhotoFormat, Recipe};
use crate::brdf::Model;
use crate::capture::Capture;
use crate::error::Result;
use crate::files;
use crate::light_field::{LightField, encode};
use crate::lighting::{Lighting, SpectrumRow, Status, write_spectrum, write_table};

/// Lines of `lighting.csv`: every half degree.
const LINES: usize = 720;
/// Largest frequency of `lighting_spectrum.csv`.
const ORDER: usize = 60;

/// What is known about a set beforehand.
pub(super) struct Truth<'a> {
    pub recipe: &'a Recipe,
    pub lighting: &'a Lighting,
    pub light_field: &'a LightField,
    pub views: &'a [PlannedView],
    /// Units of signal per unit radiance and second.
    pub scale: f64,
}

impl Truth<'_> {
    /// Writes all of it into `folder`, which exists; `capture` is what is stated.
    ///
    /// # Errors
    /// If a file cannot be written or a table of the material cannot be read.
    pub(super) fn write(&self, folder: &Path, capture: &Capture) -> Result<()> {
        if let Model::Table(table) = &self.recipe.brdf {
            let from = self.recipe.folder.join(table);
            let bytes = files::bytes(&from)?;
            files::write(&folder.join("brdf.csv"), &bytes)?;
        }
        files::write(&folder.join("scene.toml"), self.scene().as_bytes())?;
        files::write(&folder.join("recipe.toml"), self.recipe(capture).as_bytes())?;
        files::write(&folder.join("views.csv"), self.views().as_bytes())?;
        files::write(&folder.join("photos.csv"), self.photos().as_bytes())?;
        let smooth = Lighting {
            sources: Vec::new(),
            ..self.lighting.clone()
        };
        write_table(&folder.join("lighting.csv"), &smooth, LINES, None)?;
        write_spectrum(&folder.join("lighting_spectrum.csv"), &self.spectrum())?;
        let field = encode(&[self.light_field.part("light field")])?;
        files::write(&folder.join("light_field.exr"), &field)
    }

    fn brdf(&self, folder: &str) -> Table {
        match &self.recipe.brdf {
            Model::Table(_) => Model::Table(PathBuf::from(format!("{folder}brdf.csv"))).to_table(),
            analytic => analytic.to_table(),
        }
    }

    /// Sources exactly, everything else as a table beside.
    fn lighting(&self) -> Table {
        let sources: Vec<Value> = self
            .lighting
            .sources
            .iter()
            .map(|source| {
                let mut entry = Table::new();
                entry.insert("theta_deg".into(), source.theta.deg().into());
                entry.insert("irradiance".into(), source.irradiance.clone().into());
                entry.into()
            })
            .collect();
        let mut table = Table::new();
        if !sources.is_empty() {
            table.insert("sources".into(), sources.into());
        }
        table.insert("table".into(), "lighting.csv".into());
        table
    }

    fn scene(&self) -> String {
        let mut scene = Table::new();
        scene.insert("brdf".into(), self.brdf("").into());
        scene.insert("lighting".into(), self.lighting().into());
        format!(
            "# What was rendered. The light is the sum of the entries of [lighting].\n\n{scene}"
        )
    }

    /// A recipe that recovers the light of the set from its known material.
    pub(super) fn recovery(&self) -> String {
        let mut recipe = Table::new();
        recipe.insert("format".into(), 1.into());
        recipe.insert("recover".into(), "lighting".into());
        recipe.insert("brdf".into(), self.brdf("truth/").into());
        format!("# Recovers the light of this set from its known BRDF.\n{recipe}")
    }

    /// The recipe with every default written out; `[brdf]` and `[lighting]` are those of `scene.toml`.
    fn recipe(&self, stated: &Capture) -> String {
        let (recipe, faults) = (self.recipe, &self.recipe.faults);
        // Object, camera and sensor are written as a capture of what is true.
        let actual = Capture {
            object: recipe.object.clone(),
            camera: recipe.camera.clone(),
            sensor: recipe.sensor.clone(),
            views: Vec::new(),
            ..stated.clone()
        };
        let mut root: Table = actual.to_toml().parse().unwrap_or_default();
        let integer = |n: usize| Value::Integer(i64::try_from(n).unwrap_or(i64::MAX));
        root.insert("name".into(), recipe.name.clone().into());
        let seed = i64::try_from(recipe.seed).unwrap_or(i64::MAX);
        root.insert("seed".into(), seed.into());
        root.insert("channels".into(), recipe.channels.clone().into());
        let mut views = Table::new();
        views.insert("count".into(), integer(recipe.orbits_deg.len()));
        if let [first, second, ..] = recipe.orbits_deg[..] {
            views.insert("orbit_step_deg".into(), (second - first).into());
        }
        let start = recipe.orbits_deg.first().copied().unwrap_or(0.0);
        views.insert("orbit_start_deg".into(), start.into());
        views.insert("plane_roll_deg".into(), recipe.plane_roll_deg.into());
        root.insert("views".into(), views.into());
        root.insert("brdf".into(), self.brdf("").into());
        root.insert("lighting".into(), self.lighting().into());
        let mut sensor = match root.remove("sensor") {
            Some(Value::Table(sensor)) => sensor,
            _ => Table::new(),
        };
        let format = match recipe.output.format {
            PhotoFormat::ExrHalf => "exr-half",
            PhotoFormat::ExrFloat => "exr-float",
            PhotoFormat::Png { bits } => {
                sensor.insert("bits".into(), i64::from(bits).into());
                "png"
            }
        };
        sensor.insert("format".into(), format.into());
        sensor.insert(
            "exposures_s".into(),
            recipe.output.exposures_s.clone().into(),
        );
        sensor.insert("fill".into(), recipe.output.fill.into());
        if !sensor.contains_key("responsivity") {
            sensor.insert("scale".into(), self.scale.into());
        }
        root.insert("sensor".into(), sensor.into());
        let mut wrong = Table::new();
        wrong.insert("shot_noise".into(), faults.shot_noise.into());
        wrong.insert("read_noise".into(), faults.read_noise.into());
        wrong.insert("background".into(), faults.background.clone().into());
        for (key, value) in [
            ("flare", faults.flare),
            ("orbit_jitter_deg", faults.orbit_jitter_deg),
            ("wobble_m", faults.wobble_m),
            ("tilt_deg", faults.tilt_deg),
            ("missing_share", faults.missing_share),
            ("exposure_jitter", faults.exposure_jitter),
            ("brightness_jitter", faults.brightness_jitter),
        ] {
            wrong.insert(key.into(), value.into());
        }
        wrong.insert(
            "object_offset_m".into(),
            faults.object_offset_m.to_vec().into(),
        );
        if !faults.missing_views.is_empty() {
            let missing: Vec<Value> = faults.missing_views.iter().map(|v| integer(*v)).collect();
            wrong.insert("missing_views".into(), missing.into());
        }
        if let Some(texture) = &faults.texture {
            let mut table = Table::new();
            table.insert("amplitude".into(), texture.amplitude.into());
            table.insert("scale_m".into(), texture.scale_m.into());
            wrong.insert("texture".into(), table.into());
        }
        if let Some(dust) = &faults.dust {
            let mut table = Table::new();
            table.insert("count".into(), integer(dust.count));
            table.insert("radius_m".into(), dust.radius_m.into());
            table.insert("opacity".into(), dust.opacity.into());
            wrong.insert("dust".into(), table.into());
        }
        let silent: Vec<&str> = faults.unstated.iter().map(|u| u.word()).collect();
        wrong.insert("unstated".into(), silent.into());
        root.insert("faults".into(), wrong.into());
        root.to_string()
    }

    /// Offsets are the object's in camera axes: towards the camera, right, up.
    fn views(&self) -> String {
        let mut text = String::from(
            "view,orbit_deg,true_orbit_deg,offset_towards_m,offset_right_m,offset_up_m,tilt_deg,brightness\n",
        );
        for view in self.views {
            let [towards, right, up] = view.stand.pose.offset;
            let _ = writeln!(
                text,
                "{},{},{},{towards},{right},{up},{},{}",
                view.number,
                view.orbit_deg,
                view.stand.orbit.to_degrees(),
                view.stand.pose.tilt.to_degrees(),
                view.brightness
            );
        }
        text
    }

    fn photos(&self) -> String {
        let mut text = String::from("view,file,exposure_s,true_exposure_s\n");
        for view in self.views {
            for photo in &view.photos {
                let _ = writeln!(
                    text,
                    "{},{},{},{}",
                    view.number,
                    photo.file.display(),
                    photo.exposure_s,
                    photo.true_exposure_s
                );
            }
        }
        text
    }

    fn spectrum(&self) -> Vec<SpectrumRow> {
        let channels = self.lighting.channels.iter().enumerate();
        channels
            .flat_map(|(c, name)| {
                let series = self.lighting.series(c, ORDER);
                series
                    .coefficients
                    .into_iter()
                    .enumerate()
                    .map(move |(p, value)| SpectrumRow {
                        channel: name.clone(),
                        p,
                        value,
                        sigma: None,
                        status: Status::Determined,
                    })
            })
            .collect()
    }
}
