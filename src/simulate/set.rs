//! A whole synthetic capture set: every photo rendered, exposed and written, beside its truth.

use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::plan::{PlannedView, plan};
use super::recipe::{PhotoFormat, Recipe, Unstated};
use super::render::Renderer;
use super::sensor::Exposer;
use super::truth::{Truth, write};
use super::write::photo;
use crate::angle::WorldAngle;
use crate::capture::{Capture, Encoding, Photo, View};
use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::light_field::LightField;
use crate::reflect::product;

/// The truth's light field, as the test photographs have it.
const GRID: Grid = Grid {
    normals: 360,
    locals: 90,
};
/// A table of light has no end of frequencies; beyond this nothing is left that a picture shows.
const HIGHEST_ORDER: usize = 4000;
/// |θo′| within which the brightest point decides the exposure, degrees.
const EXPOSED_DEG: f64 = 80.0;
/// What a synthetic set consists of.
const ENTRIES: [&str; 4] = ["capture.toml", "recipe.toml", "views", "truth"];

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// Views, without the missing ones.
    pub views: usize,
    /// Photos.
    pub photos: usize,
    /// Linear stored units per unit radiance and second.
    pub scale: f64,
    /// Plain sentences: what to know about the set.
    pub warnings: Vec<String>,
}

/// Renders a recipe into the folder `out`: `capture.toml`, `views/`, `truth/` and a `recipe.toml` that recovers
/// the light. The folder appears when it is complete. `step` is called after every view, from several
/// threads. The files are the same for a recipe and its seed whatever the number of threads.
///
/// # Errors
/// What the recipe names cannot be read or does not fit together; the folder holds something and `force` is
/// not set, or something that is not a synthetic set; a file cannot be written.
pub fn simulate(
    recipe: &Recipe,
    out: &Path,
    force: bool,
    step: &(dyn Fn() + Sync),
) -> Result<Written> {
    may_replace(out, force)?;
    let lighting = recipe.lighting.resolve(&recipe.channels, &recipe.folder)?;
    let renderer = Renderer::new(
        &recipe.camera,
        &recipe.object,
        &recipe.brdf,
        &lighting,
        &recipe.folder,
    )?
    .with_background(&recipe.faults.background)
    .with_blemishes(recipe.faults.texture, recipe.faults.dust, recipe.seed);
    let views = plan(recipe)?;
    let light_field = light_field(recipe, &lighting)?;
    let exposer = Exposer::new(
        &recipe.sensor,
        &recipe.output,
        &recipe.faults,
        brightest(&light_field),
        recipe.seed,
    );
    let capture = stated(recipe, &views, &exposer, out);
    let truth = Truth {
        recipe,
        lighting: &lighting,
        light_field: &light_field,
        views: &views,
        scale: exposer.scale(),
    };
    let staging = Staging::beside(out)?;
    for folder in ["views", "truth"] {
        let folder = staging.path.join(folder);
        fs::create_dir_all(&folder).map_err(|e| Error::write(&folder, e))?;
    }
    truth.write(&staging.path.join("truth"), &capture)?;
    write(
        &staging.path.join("recipe.toml"),
        truth.recovery().as_bytes(),
    )?;
    write(
        &staging.path.join("capture.toml"),
        capture.to_toml().as_bytes(),
    )?;
    views.par_iter().try_for_each(|view| {
        let written = write_view(recipe, &renderer, &exposer, view, &staging.path);
        step();
        written.map_err(|e| e.view(view.number))
    })?;
    staging.publish(out, force)?;

    let mut warnings = recipe.brdf.warnings();
    if !renderer.is_spatial() {
        warnings.push(
            "the material is known in the plane of incidence only: rows off the cross-section show its \
             projection on the plane"
                .into(),
        );
    }
    Ok(Written {
        views: views.len(),
        photos: views.iter().map(|v| v.photos.len()).sum(),
        scale: exposer.scale(),
        warnings,
    })
}

fn write_view(
    recipe: &Recipe,
    renderer: &Renderer,
    exposer: &Exposer,
    view: &PlannedView,
    folder: &Path,
) -> Result<()> {
    let mut picture = renderer.view(&view.stand);
    exposer.through_lens(&mut picture);
    let count = view.photos.len();
    for (k, shot) in view.photos.iter().enumerate() {
        let number = (view.number * count + k) as u64;
        let seconds = shot.true_exposure_s * view.brightness;
        let values = exposer.expose(&picture, seconds, number);
        let format = recipe.output.format;
        let bytes = photo(format, picture.size, &picture.channels, values)?;
        write(&folder.join(&shot.file), &bytes)?;
    }
    Ok(())
}

/// B without a camera: mean, no σ, every cell seen.
fn light_field(recipe: &Recipe, lighting: &crate::lighting::Lighting) -> Result<LightField> {
    let material = recipe.brdf.material(&recipe.channels, &recipe.folder)?;
    let order = product::sufficient_order(lighting).min(HIGHEST_ORDER);
    let values = product::on_grid(lighting, &material, GRID, order)?;
    let mut field = LightField::empty(GRID, recipe.channels.clone());
    for (mean, values) in field.mean.iter_mut().zip(values) {
        *mean = values.into_iter().map(|b| b as f32).collect();
    }
    field.weight.iter_mut().for_each(|w| w.fill(1.0));
    Ok(field)
}

fn brightest(field: &LightField) -> f64 {
    let columns: Vec<usize> = (0..GRID.locals)
        .filter(|&j| GRID.local(j).deg().abs() <= EXPOSED_DEG)
        .collect();
    let cells = (0..GRID.normals).flat_map(|i| columns.iter().map(move |&j| GRID.index(i, j)));
    cells
        .flat_map(|cell| field.mean.iter().filter_map(move |m| m.get(cell)))
        .fold(0.0, |a, &b| a.max(f64::from(b)))
}

/// What `capture.toml` says: all that is so, but for what it is to keep silent about.
fn stated(recipe: &Recipe, views: &[PlannedView], exposer: &Exposer, out: &Path) -> Capture {
    let silent = |fact| recipe.faults.unstated.contains(&fact);
    let mut sensor = recipe.sensor.clone();
    sensor.encoding.get_or_insert(Encoding::Linear);
    sensor.responsivity = exposer.responsivity();
    if let PhotoFormat::Png { bits } = recipe.output.format {
        sensor
            .white_level
            .get_or_insert(f64::from((1u32 << bits) - 1));
    }
    if silent(Unstated::Noise) {
        (sensor.full_well_e, sensor.read_noise_e, sensor.responsivity) = (None, None, None);
    }
    if silent(Unstated::Responsivity) {
        sensor.responsivity = None;
    }
    if silent(Unstated::Vignetting) {
        sensor.vignetting = None;
    }
    let mut camera = recipe.camera.clone();
    if silent(Unstated::Distortion) {
        camera.distortion = [0.0; 5];
    }
    if silent(Unstated::OrbitSigma) {
        camera.orbit_sigma_deg = 0.0;
    } else if camera.orbit_sigma_deg == 0.0 {
        camera.orbit_sigma_deg = recipe.faults.orbit_jitter_deg.min(90.0);
    }
    let view = |view: &PlannedView| View {
        orbit: WorldAngle::degrees(view.orbit_deg),
        photos: view
            .photos
            .iter()
            .map(|shot| Photo {
                file: shot.file.clone(),
                exposure_s: Some(shot.exposure_s),
            })
            .collect(),
        plane_roll: recipe.plane_roll_deg.to_radians(),
        mask: None,
        outline: None,
    };
    Capture {
        name: recipe.name.clone(),
        folder: out.to_path_buf(),
        object: recipe.object.clone(),
        camera,
        sensor,
        views: views.iter().map(view).collect(),
    }
}

/// Whether the folder is free, or holds nothing but a synthetic set that `force` lets go.
fn may_replace(out: &Path, force: bool) -> Result<()> {
    let entries = match fs::read_dir(out) {
        Ok(entries) => entries,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(Error::read(out, e)),
    };
    let names: Vec<String> = entries
        .filter_map(|e| Some(e.ok()?.file_name().to_string_lossy().into_owned()))
        .collect();
    let foreign = names.iter().find(|n| !ENTRIES.contains(&n.as_str()));
    match (names.is_empty(), foreign, force) {
        (true, ..) | (false, None, true) => Ok(()),
        (false, None, false) => Err(Error::input("the folder holds a capture set already")
            .file(out)
            .advice("Give another folder with --out, or --force to replace the set.")),
        (false, Some(name), _) => Err(Error::input(format!(
            "expected an empty folder or a synthetic set, found \"{name}\" in it"
        ))
        .file(out)
        .advice("Give another folder with --out.")),
    }
}

/// A folder beside the final one, removed again unless it is published.
struct Staging {
    path: PathBuf,
}

impl Staging {
    fn beside(out: &Path) -> Result<Self> {
        let name = out.file_name().ok_or_else(|| {
            Error::input("expected the name of a folder")
                .file(out)
                .advice("Give a folder for the set with --out.")
        })?;
        let staging = format!(".{}-{}", name.to_string_lossy(), std::process::id());
        let path = out.with_file_name(staging);
        fs::create_dir_all(&path).map_err(|e| Error::write(&path, e))?;
        Ok(Self { path })
    }

    fn publish(self, out: &Path, force: bool) -> Result<()> {
        // Looked at again: rendering takes its time.
        may_replace(out, force)?;
        match fs::remove_dir_all(out) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(Error::write(out, e)),
            _ => {}
        }
        fs::rename(&self.path, out).map_err(|e| Error::write(out, e))
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        // Gone already if it was published; nothing reads what a failure leaves.
        let _ = fs::remove_dir_all(&self.path);
    }
}
