//! The stages in order: capture and recipe in, [`Run`] out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;

use super::advice;
use super::balance;
use super::coherence;
use super::explain;
use super::fingerprint::fingerprint;
use super::fit;
use super::joint;
use super::known;
use super::lean;
use super::material;
use super::measure::{Measured, at_angles, take};
use super::orbit::{OrbitRefinement, refine_orbit, turn};
use super::progress::Progress;
use super::recipe::{Recipe, Recover};
use super::run::{Recovered, Run, Verdict};
use super::spectrum::spectrum;
use super::trial;
use crate::capture::Capture;
use crate::error::{Error, Result};
use crate::light_field::Samples;
use crate::recover::{Status, brdf, factorise, lighting};

/// Degrees of θo′ per pixel up to which the samples' slopes are resolved.
const FOOTPRINT: f64 = 1.5;

/// Runs a recipe on a capture.
///
/// # Errors
/// Whatever is wrong with photos, recipe or their combination; nothing is written.
pub fn execute(recipe: &Recipe, capture: &Capture, progress: &dyn Progress) -> Result<Run> {
    let mut clock = Clock::new();
    let footprint = match recipe.recover {
        Recover::Both => joint::FOOTPRINT,
        _ => FOOTPRINT,
    };
    if capture.views.len() < 2 && recipe.recover != Recover::None {
        return Err(one_view());
    }
    let taken = take(capture, &recipe.light_field, progress)?;
    let whole = capture;
    let light_field =
        |turned: &Capture| at_angles(&taken, turned, &recipe.light_field, footprint, progress);
    let mut measured = light_field(&taken.capture)?;
    clock.lap("photos to light field");
    let orbit = refine_orbit(&mut measured, recipe, &taken.capture, &light_field)?;
    if orbit.is_some() {
        clock.lap("orbit angles");
    }
    // The lines of hundreds of large photographs are more than all that follows needs.
    let capture = &taken.into_capture();
    let spectrum = spectrum(&measured.samples);
    clock.lap("spectrum");
    let radiance_unit = if capture.sensor.responsivity.is_some() || is_float(capture) {
        "W m⁻² sr⁻¹"
    } else {
        "relative"
    };
    let task = Task {
        recipe,
        capture,
        measured: &measured,
        absolute: radiance_unit.starts_with('W'),
        progress,
    };
    let mut recovered = match recipe.recover {
        Recover::Lighting => task.lighting(&mut clock)?,
        Recover::Brdf => task.brdf(&mut clock)?,
        Recover::Both => task.both(&mut clock)?,
        Recover::None => Recovered::default(),
    };
    let unlike = |f: &fit::FitQuality| f.verdict != Verdict::Explained;
    if recipe.recover != Recover::Both && recovered.fit.iter().any(unlike) {
        // Not a judge here, where light or BRDF is known, but a witness of the cause.
        let across = balance::out_of_plane(&measured)?;
        for (fit, across) in recovered.fit.iter_mut().zip(across) {
            fit.across = across;
        }
    }
    if let (Some(orbit), Some(light)) = (&orbit, &mut recovered.lighting) {
        turn(light, orbit.mean_sigma_deg.to_radians());
    }
    if let Some(light) = &mut recovered.lighting {
        lean::scale(light, measured.scale_sigma);
    }
    // Where noise is estimated from the scatter, what nothing explains may also pass for noise.
    let unexplained = |f: &fit::FitQuality| {
        f.verdict == Verdict::Refused || f.residual_relative > fit::NOISE_OR_NOTHING
    };
    if recovered.fit.iter().any(unexplained)
        && let Some(doubt) = measured.doubt.take()
    {
        return Err(doubt);
    }
    let mut warnings = measured.warnings.clone();
    warnings.append(&mut recovered.warnings);
    warnings.extend(explain::fit_warnings(recipe.recover, &measured, &recovered));
    let warnings = explain::grouped(warnings);
    refuse(&mut recovered);
    let mut findings = explain::findings(recipe, &measured, &recovered);
    findings.extend(orbit.as_ref().map(OrbitRefinement::finding));
    // It rests on the first channel's result.
    let accepted = |f: &&fit::FitQuality| f.verdict != Verdict::Refused;
    if recovered.fit.first().filter(accepted).is_some() {
        findings.extend(recovered.advice.take());
    }
    Ok(Run {
        title: recipe.title.clone().unwrap_or_else(|| capture.name.clone()),
        recover: recipe.recover.word().into(),
        capture_toml: whole.to_toml(),
        recipe_toml: recipe.to_toml(),
        capture_name: capture.name.clone(),
        channels: measured.samples.channels.clone(),
        radiance_unit: radiance_unit.into(),
        limb_cut: measured.limb_cut,
        views: measured.views,
        orbit,
        previews: measured.previews,
        light_field: measured.field,
        spectrum,
        residual: recovered.residual,
        view_residual: recovered.view_residual,
        fit: recovered.fit,
        lighting: recovered.lighting,
        brdf: recovered.brdf,
        models: recovered.models,
        gauge: recovered.gauge,
        warnings,
        findings,
        stage_seconds: clock.laps,
        input_hashes: BTreeMap::new(),
        version: env!("CARGO_PKG_VERSION").into(),
    })
}

/// What every recovery starts from.
struct Task<'a> {
    recipe: &'a Recipe,
    capture: &'a Capture,
    measured: &'a Measured,
    /// Whether radiance is on its absolute scale.
    absolute: bool,
    progress: &'a dyn Progress,
}

impl Task<'_> {
    fn lighting(&self, clock: &mut Clock) -> Result<Recovered> {
        let (recipe, samples) = (self.recipe, &self.measured.samples);
        let Some(model) = &recipe.brdf else {
            return Err(missing("brdf"));
        };
        self.progress.stage("lighting", 1);
        let material = model.material(&samples.channels, &recipe.folder)?;
        let options = lighting::Options {
            band: recipe.recovery.band,
            regularisation: recipe.recovery.regularisation,
            non_negative: recipe.recovery.non_negative,
        };
        let estimate =
            lighting::recover_with(samples, &self.measured.systematics, &material, &options)?;
        clock.lap("lighting");
        let cells = self.measured.field.samples();
        let predicted = lighting::predict_all(&estimate, &material, &[&cells, samples]);
        let [on_grid, on_samples] = predicted.as_slice() else {
            return Err(Error::failed("the prediction is incomplete"));
        };
        let mut recovered = self.residuals((&cells, on_grid), on_samples);
        for (c, fit) in recovered.fit.iter_mut().enumerate() {
            fit.judge_lighting(material::reflects_diffusely(&material, c));
        }
        clock.lap("residual");
        if let Some(left) = unexplained(&recovered.fit) {
            let lamps: Vec<trial::Lamp> = estimate
                .sources
                .iter()
                .map(|s| (s.theta_deg.to_radians(), s.irradiance.iter().sum()))
                .collect();
            let again = |samples: &Samples| {
                let estimate = lighting::recover_with(samples, &[], &material, &options)?;
                let predicted = lighting::predict(&estimate, &material, samples);
                Ok(mean_unexplained(&fit::quality(samples, &predicted)))
            };
            recovered.cause = trial::better(samples, &lamps, left, &again);
            if recovered.cause.is_some() {
                fit::doubt_others(&mut recovered.fit);
            }
            clock.lap("cause");
        }
        (recovered.advice, recovered.warnings) = rayon::join(
            || advice::on_lighting(self.capture, self.measured, &material, &estimate),
            || [model.warnings(), model.warnings_of_table(&material)].concat(),
        );
        clock.lap("advice");
        recovered.lighting = Some(estimate);
        self.progress.step();
        Ok(recovered)
    }

    fn brdf(&self, clock: &mut Clock) -> Result<Recovered> {
        let (recipe, samples) = (self.recipe, &self.measured.samples);
        let Some(described) = &recipe.lighting else {
            return Err(missing("lighting"));
        };
        self.progress.stage("BRDF", 2);
        let light = described.resolve(&samples.channels, &recipe.folder)?;
        let options = material::options(&recipe.recovery)?;
        let mut estimate =
            brdf::recover_with(samples, &self.measured.systematics, &light, &options)?;
        clock.lap("BRDF");
        self.progress.step();
        let slice = material::as_material(&estimate)?;
        let cells = self.measured.field.samples();
        let on_grid = fit::predict(&light, &slice, &cells)?;
        let on_samples = fit::predict(&light, &slice, samples)?;
        let mut recovered = self.residuals((&cells, &on_grid), &on_samples);
        let together = coherence::factors(samples, &on_samples);
        for (slice, factor) in estimate.slices.iter_mut().zip(together) {
            if slice.noise > coherence::MISFIT {
                coherence::widen(slice, factor);
            }
        }
        clock.lap("residual");
        let (models, note) = material::fit_models(&estimate, self.absolute);
        clock.lap("models");
        self.progress.step();
        if let Some(left) = unexplained(&recovered.fit[..1]) {
            let lamps: Vec<trial::Lamp> = light
                .sources
                .iter()
                .map(|s| (s.theta.rad(), s.irradiance.iter().sum()))
                .collect();
            // All channels were photographed alike, and a BRDF takes its time.
            let first = trial::one_channel(samples, 0);
            let light = trial::light_of_channel(&light, 0);
            let options = brdf::Options {
                size: trial::SIZE,
                intervals: Some(trial::INTERVALS),
                ..options
            };
            let again = |samples: &Samples| {
                let estimate = brdf::recover_with(samples, &[], &light, &options)?;
                let slice = material::as_material(&estimate)?;
                let predicted = fit::predict(&light, &slice, samples)?;
                Ok(mean_unexplained(&fit::quality(samples, &predicted)))
            };
            recovered.cause = trial::better(&first, &lamps, left, &again);
            if recovered.cause.is_some() {
                fit::doubt_others(&mut recovered.fit);
            }
            clock.lap("cause");
        }
        recovered.advice = advice::on_brdf(self.capture, self.measured, &light, &estimate);
        clock.lap("advice");
        recovered.warnings = estimate.warnings.clone();
        recovered.warnings.extend(note);
        recovered.brdf = Some(estimate);
        recovered.models = models;
        Ok(recovered)
    }

    fn both(&self, clock: &mut Clock) -> Result<Recovered> {
        let (recipe, samples) = (self.recipe, &self.measured.samples);
        self.progress.stage("both", 2);
        let options = factorise::Options {
            band: recipe.recovery.band,
            scale: recipe.scale.resolve(&samples.channels)?,
            refine: true,
        };
        let radius = self.measured.views.iter().map(|v| v.radius_px);
        let radius_px = radius.fold(f64::INFINITY, f64::min);
        let widened = known::with_model_error(samples, radius_px);
        let mut found = factorise::recover_with(&widened, &self.measured.systematics, &options)?;
        let parametric = joint::parametric(&found, &widened, &options.scale);
        drop(widened);
        clock.lap("factorisation");
        self.progress.step();
        let mut options = material::options(&recipe.recovery)?;
        let band = found.channels.iter().map(|c| c.band).max();
        options.order = options.order.max(band.unwrap_or(0));
        let systematics = &self.measured.systematics;
        let known::Slice {
            estimate,
            light,
            part,
        } = known::slice(&mut found, samples, systematics, Some(radius_px), &options)?;
        clock.lap("BRDF");
        let (models, note) = material::fit_models(&estimate, recipe.scale.is_given());
        clock.lap("models");
        let slice = material::as_material(&estimate)?;
        let cells = self.measured.field.samples();
        let on_grid = fit::predict(&known::light(&found), &slice, &cells)?;
        let on_samples = fit::predict(&known::light(&found), &slice, samples)?;
        let mut recovered = self.residuals((&cells, &on_grid), &on_samples);
        recovered.fit = fit::quality(&part, &fit::predict(&light, &slice, &part)?);
        for (fit, channel) in recovered.fit.iter_mut().zip(&found.channels) {
            fit.judge_reciprocity(channel.violation);
            fit.judge_search(channel.converged);
        }
        let across = balance::out_of_plane(self.measured)?;
        for (c, (fit, across)) in recovered.fit.iter_mut().zip(across).enumerate() {
            let diffuse = material::is_diffuse(&estimate, c)
                || material::looks_diffuse(&self.measured.field, c);
            fit.judge_balance(across, diffuse);
        }
        clock.lap("residual");
        let curved = |fit: &fit::FitQuality| {
            fit.verdict == Verdict::Explained && fit.unexplained > fit::CURVED
        };
        if let Some(channel) = recovered.fit.iter().position(curved) {
            recovered.cause = straighter(samples, channel, radius_px, &recipe.recovery)?;
            if recovered.cause.is_some() {
                fit::judge_curved(&mut recovered.fit);
            }
            clock.lap("cause");
        }
        fit::judge_together(&mut recovered.fit);
        if recovered.cause.is_none() && unexplained(&recovered.fit).is_some() {
            recovered.cause = trial::few_views(samples);
        }
        self.progress.step();
        recovered.advice = advice::on_brdf(self.capture, self.measured, &light, &estimate);
        clock.lap("advice");
        recovered.warnings = explain::factorisation_warnings(&found, samples);
        recovered.warnings.extend(estimate.warnings.iter().cloned());
        recovered.warnings.extend(note);
        recovered.lighting = Some(joint::lighting(&found, &recovered.fit));
        recovered.brdf = Some(estimate);
        recovered.models = models;
        recovered.gauge = joint::gauge(&found);
        for (gauge, models) in recovered.gauge.iter_mut().zip(parametric) {
            gauge.parametric = models;
        }
        Ok(recovered)
    }

    /// Residuals and verdicts of predictions for the grid's cells and for the samples.
    fn residuals(
        &self,
        (cells, on_grid): (&Samples, &[Vec<Vec<f64>>]),
        on_samples: &[Vec<Vec<f64>>],
    ) -> Recovered {
        let (fit, (residual, view_residual)) = rayon::join(
            || fit::quality(&self.measured.samples, on_samples),
            || {
                rayon::join(
                    || fit::subtract(&self.measured.field, cells, on_grid),
                    || fit::by_view(self.measured, on_samples),
                )
            },
        );
        Recovered {
            residual: Some(residual),
            view_residual: Some(view_residual),
            fit,
            ..Recovered::default()
        }
    }
}

/// What is left unexplained on average, if any of it is doubtful.
fn unexplained(fits: &[fit::FitQuality]) -> Option<f64> {
    let doubtful = fits.iter().any(|f| f.verdict != Verdict::Explained);
    doubtful.then(|| mean_unexplained(fits))
}

/// What would straighten the photographs of one channel so that light and BRDF explain far more of them.
fn straighter(
    samples: &Samples,
    channel: usize,
    radius_px: f64,
    recovery: &super::recipe::RecoveryOptions,
) -> Result<Option<String>> {
    let jointly = factorise::Options {
        band: recovery.band,
        ..factorise::Options::default()
    };
    let options = brdf::Options {
        size: trial::SIZE,
        intervals: Some(trial::INTERVALS),
        ..material::options(recovery)?
    };
    let again = |samples: &Samples| {
        let widened = known::with_model_error(samples, radius_px);
        let mut found = factorise::recover_with(&widened, &[], &jointly)?;
        let under = known::slice(&mut found, samples, &[], Some(radius_px), &options)?;
        let slice = material::as_material(&under.estimate)?;
        let predicted = fit::predict(&under.light, &slice, &under.part)?;
        Ok(mean_unexplained(&fit::quality(&under.part, &predicted)))
    };
    trial::straighter(&trial::one_channel(samples, channel), &again)
}

fn mean_unexplained(fits: &[fit::FitQuality]) -> f64 {
    fits.iter().map(|f| f.unexplained).sum::<f64>() / fits.len().max(1) as f64
}

/// What does not explain the photographs is no measurement: nothing of a refused channel is called determined.
fn refuse(recovered: &mut Recovered) {
    for (c, fit) in recovered.fit.iter().enumerate() {
        if fit.verdict != Verdict::Refused {
            continue;
        }
        if let Some(channel) = recovered
            .lighting
            .as_mut()
            .and_then(|l| l.channels.get_mut(c))
        {
            channel.determined_band = None;
            for coefficient in &mut channel.spectrum {
                coefficient.status = Status::Indeterminate;
            }
        }
        if let Some(slice) = recovered.brdf.as_mut().and_then(|b| b.slices.get_mut(c)) {
            slice.status.fill(Status::Indeterminate);
            for coefficient in &mut slice.spectrum {
                coefficient.status = Status::Indeterminate;
            }
        }
    }
    let refused = |name: &str, channels: &[String]| {
        channels
            .iter()
            .position(|c| c == name)
            .and_then(|c| recovered.fit.get(c))
            .is_some_and(|f| f.verdict == Verdict::Refused)
    };
    // A model of a refused slice would be taken for a material.
    if let (Some(models), Some(brdf)) = (&mut recovered.models, &recovered.brdf) {
        models
            .channels
            .retain(|m| !refused(&m.channel, &brdf.channels));
    }
}

fn one_view() -> Error {
    Error::input("expected at least two views to recover light or material from, found one view")
        .file("capture.toml")
        .key("view")
        .advice("One view is a single line of the light field: what the light did and what the surface did are not told apart on it. With recover = \"none\" its line is written.")
}

fn missing(key: &str) -> Error {
    Error::input("the recipe does not say what is known").key(key)
}

/// Whether the photos hold radiance itself, as renderers write it.
fn is_float(capture: &Capture) -> bool {
    capture.views.iter().flat_map(|v| &v.photos).all(|p| {
        p.file
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("exr"))
            && p.exposure_s.is_none_or(|t| t == 1.0)
    })
}

struct Clock {
    last: Instant,
    laps: Vec<(String, f64)>,
}

impl Clock {
    fn new() -> Self {
        Self {
            last: Instant::now(),
            laps: Vec::new(),
        }
    }

    fn lap(&mut self, name: &str) {
        let now = Instant::now();
        self.laps
            .push((name.into(), (now - self.last).as_secs_f64()));
        self.last = now;
    }
}

/// Hashes of all files that a run reads, by names relative to the capture or the recipe.
///
/// # Errors
/// If a file cannot be read.
pub fn input_hashes(
    recipe: &Recipe,
    recipe_file: &Path,
    capture: &Capture,
) -> Result<BTreeMap<String, String>> {
    let mut files: Vec<(String, PathBuf)> = Vec::new();
    for file in capture.files() {
        files.push((
            format!("capture/{}", file.display()),
            capture.folder.join(&file),
        ));
    }
    let name = recipe_file
        .file_name()
        .map_or_else(String::new, |n| n.to_string_lossy().into());
    files.push((format!("recipe/{name}"), recipe_file.to_path_buf()));
    for file in recipe.files() {
        let name = file
            .file_name()
            .map_or_else(String::new, |n| n.to_string_lossy().into());
        files.push((format!("recipe/{name}"), file));
    }
    files
        .into_par_iter()
        .map(|(name, path)| {
            let hash = fingerprint(&path)?;
            Ok((name, hash))
        })
        .collect()
}
