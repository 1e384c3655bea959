//! A whole synthetic capture set: every photo rendered, exposed and written, beside its truth.

use std::fs;
use std::path::Path;

use rayon::prelude::*;

use super::plan::{PlannedView, plan};
use super::recipe::{PhotoFormat, Recipe, Unstated};
use super::render::Renderer;
use super::sensor::Exposer;
use super::truth::Truth;
use super::write::photo;
use crate::angle::WorldAngle;
use crate::capture::{Capture, Encoding, Photo, View};
use crate::error::{Error, Result};
use crate::files::{self, STAGING};
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
/// What a synthetic set consists of beside its description.
const ENTRIES: [&str; 3] = ["recipe.toml", "views", "truth"];
/// What makes a set of them, written last.
const DESCRIPTION: &str = "capture.toml";

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
/// the light. They get their names together when all are complete. `step` is called after every view, from several
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
    let _claim = files::claim(out)?;
    finish_interrupted(out)?;
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
    let staged = stage(out, &truth, &capture, |folder| {
        views.par_iter().try_for_each(|view| {
            let written = write_view(recipe, &renderer, &exposer, view, folder);
            step();
            written.map_err(|e| e.view(view.number))
        })
    });
    if let Err(error) = staged {
        // Nothing reads what is left of it, if it cannot be removed either.
        let _ = files::discard(out);
        return Err(error);
    }
    files::commit(out, &ENTRIES, &[], DESCRIPTION)?;

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

/// Writes the whole set into the staging folder, its description last.
fn stage(
    out: &Path,
    truth: &Truth,
    capture: &Capture,
    photos: impl Fn(&Path) -> Result<()>,
) -> Result<()> {
    let staging = files::stage(out)?;
    for folder in ["views", "truth"] {
        files::make_folder(&staging.join(folder))?;
    }
    truth.write(&staging.join("truth"), capture)?;
    files::write(&staging.join("recipe.toml"), truth.recovery().as_bytes())?;
    photos(&staging)?;
    for folder in ["views", "truth", ""] {
        files::flush_folder(&staging.join(folder))?;
    }
    // Whole, for its being there says that all others are.
    files::write_whole(&staging.join(DESCRIPTION), capture.to_toml().as_bytes())
}

/// Gives a set that an interrupted call had complete its names; removes what is left of one that had not come so far.
fn finish_interrupted(out: &Path) -> Result<()> {
    let staging = out.join(STAGING);
    if staging.join(DESCRIPTION).exists() {
        return files::commit(out, &ENTRIES, &[], DESCRIPTION);
    }
    match staging.exists() {
        true => files::discard(out),
        false => Ok(()),
    }
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
        files::write(&folder.join(&shot.file), &bytes)?;
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
        .filter(|name| !name.starts_with(STAGING))
        .collect();
    let foreign = names
        .iter()
        .find(|n| **n != DESCRIPTION && !ENTRIES.contains(&n.as_str()));
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
