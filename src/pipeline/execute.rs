//! The stages in order: capture and recipe in, [`Run`] out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;

use super::measure::{Measured, measure};
use super::progress::Progress;
use super::recipe::{Recipe, Recover};
use super::run::{Run, Spectrum};
use crate::capture::Capture;
use crate::error::{Error, Result};
use crate::fourier::CircleTransform;
use crate::light_field::{LightField, Part, Samples};
use crate::recover::Status;
use crate::recover::lighting::{self, LightingEstimate};

/// Frequencies of the light field's spectrum that are shown.
const SPECTRUM_ORDER: usize = 60;
/// Relative residual above which a fit is called bad: clean photos leave 0.01–0.1 %, noisy ones their
/// noise; light from out of the plane leaves 10 % and more.
const BAD_RESIDUAL: f64 = 0.03;

/// Runs a recipe on a capture.
///
/// # Errors
/// Whatever is wrong with photos, recipe or their combination; nothing is written.
pub fn execute(recipe: &Recipe, capture: &Capture, progress: &dyn Progress) -> Result<Run> {
    if matches!(recipe.recover, Recover::Brdf | Recover::Both) {
        return Err(Error::input(format!(
            "recover = \"{}\" is not available in this version",
            recipe.recover.word()
        ))
        .key("recover")
        .advice("Available are \"lighting\" and \"none\"."));
    }
    let mut clock = Clock::new();
    let measured = measure(capture, &recipe.light_field, progress)?;
    clock.lap("photos to light field");
    let spectrum = spectrum(&measured.samples);
    clock.lap("spectrum");
    let mut warnings = measured.warnings.clone();
    let mut run_lighting = None;
    let mut residual = None;
    let mut view_residual = None;
    if let (Recover::Lighting, Some(model)) = (recipe.recover, &recipe.brdf) {
        progress.stage("lighting", 1);
        let material = model.material(&measured.samples.channels, &recipe.folder)?;
        warnings.extend(model.warnings());
        let options = lighting::Options {
            band: recipe.recovery.band,
            regularisation: recipe.recovery.regularisation,
            non_negative: recipe.recovery.non_negative,
        };
        let estimate = lighting::recover_with(
            &measured.samples,
            &measured.systematics,
            &material,
            &options,
        )?;
        clock.lap("lighting");
        let predicted = lighting::predict(&estimate, &material, &measured.field.samples());
        residual = Some(subtract(&measured.field, &predicted));
        let predicted = lighting::predict(&estimate, &material, &measured.samples);
        view_residual = Some(by_view(&measured, &predicted));
        clock.lap("residual");
        warnings.extend(fit_warnings(&estimate));
        run_lighting = Some(estimate);
        progress.step();
    }
    let findings = findings(&measured, run_lighting.as_ref());
    Ok(Run {
        title: recipe.title.clone().unwrap_or_else(|| capture.name.clone()),
        recover: recipe.recover.word().into(),
        capture_toml: capture.to_toml(),
        recipe_toml: recipe.to_toml(),
        capture_name: capture.name.clone(),
        channels: measured.samples.channels.clone(),
        radiance_unit: if capture.sensor.responsivity.is_some() || is_float(capture) {
            "W m⁻² sr⁻¹".into()
        } else {
            "relative".into()
        },
        limb_cut: measured.limb_cut,
        views: measured.views,
        previews: measured.previews,
        light_field: measured.field,
        spectrum,
        residual,
        view_residual,
        lighting: run_lighting,
        warnings,
        findings,
        stage_seconds: clock.laps,
        input_hashes: BTreeMap::new(),
        version: env!("CARGO_PKG_VERSION").into(),
    })
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

/// Measured minus predicted; `predicted` is \[channel\]\[column\]\[row\].
fn subtract(measured: &LightField, predicted: &[Vec<Vec<f64>>]) -> LightField {
    let mut residual = measured.clone();
    let grid = measured.grid;
    for (c, mean) in residual.mean.iter_mut().enumerate() {
        for i in 0..grid.normals {
            for j in 0..grid.locals {
                let at = grid.index(i, j);
                if residual.weight[c][at] > 0.0 {
                    mean[at] -= predicted[c][j][i] as f32;
                }
            }
        }
    }
    residual
}

/// Measured minus predicted for each photo's strip: a row per view, a column per θo′.
fn by_view(measured: &Measured, predicted: &[Vec<Vec<f64>>]) -> Part {
    let (width, height) = (measured.samples.columns.len(), measured.views.len());
    let mut planes = Vec::new();
    for (c, name) in measured.samples.channels.iter().enumerate() {
        let mut residual = vec![0.0f32; width * height];
        let mut weight = vec![0.0f32; width * height];
        for (j, column) in measured.samples.columns.iter().enumerate() {
            for (i, &view) in column.view.iter().enumerate() {
                if column.variance[c][i].is_finite() {
                    let at = view as usize * width + j;
                    residual[at] = (column.value[c][i] - predicted[c][j][i]) as f32;
                    weight[at] = 1.0;
                }
            }
        }
        planes.push((format!("residual.{name}"), residual));
        planes.push((format!("weight.{name}"), weight));
    }
    Part {
        name: "photos".into(),
        size: [width, height],
        planes,
        texts: vec![
            ("rows".into(), "views, in the order of capture.toml".into()),
            (
                "columns".into(),
                "theta_o', as in the part of the light field".into(),
            ),
        ],
        numbers: Vec::new(),
    }
}

/// |B_p(θo′)| by columns: the weighted means of b e^{−ipα} over even bins of α, which for even views is the DFT.
fn spectrum(samples: &Samples) -> Vec<Spectrum> {
    (0..samples.channels.len())
        .into_par_iter()
        .map(|c| {
            let order = samples
                .columns
                .iter()
                .map(|column| column.alpha.len() / 2)
                .max()
                .unwrap_or(0)
                .min(SPECTRUM_ORDER);
            let (mut power, mut noise) = (vec![0.0; order + 1], vec![0.0; order + 1]);
            let locals = samples.columns.len();
            let mut rows = vec![vec![0.0; locals]; order + 1];
            let mut parts = vec![vec![num_complex::Complex64::ZERO; locals]; order + 1];
            let mut used = 0usize;
            for (j, column) in samples.columns.iter().enumerate() {
                let seen: Vec<usize> = (0..column.alpha.len())
                    .filter(|&i| column.variance[c][i].is_finite())
                    .collect();
                // A column that few views see has no spectrum of its own.
                if seen.len() < 2 * order.max(1) * 9 / 10 {
                    continue;
                }
                used += 1;
                let n = seen.len() as f64;
                let mean_variance = seen.iter().map(|&i| column.variance[c][i]).sum::<f64>() / n;
                for p in 0..=order {
                    let mut sum = num_complex::Complex64::ZERO;
                    for &i in &seen {
                        sum += column.value[c][i]
                            * num_complex::Complex64::cis(-(p as f64) * column.alpha[i]);
                    }
                    let value = sum / n;
                    power[p] += value.norm_sqr();
                    noise[p] += mean_variance / n;
                    rows[p][j] = value.norm();
                    parts[p][j] = value;
                }
            }
            let rms = |sum: f64| (sum / used.max(1) as f64).sqrt();
            Spectrum {
                channel: samples.channels[c].clone(),
                magnitude: power.into_iter().map(rms).collect(),
                noise_floor: noise.into_iter().map(rms).collect(),
                image: local_spectrum(&parts, order),
            }
        })
        .collect()
}

/// |B_{p,q}| for |q| ≤ order from B_p(θo′) on regular columns over (−π/2, π/2), zero outside (eq. 6).
fn local_spectrum(parts: &[Vec<num_complex::Complex64>], order: usize) -> Vec<Vec<f64>> {
    let locals = parts.first().map_or(0, Vec::len);
    if locals == 0 {
        return Vec::new();
    }
    // The half circle padded to the full one: columns start at −π/2 + half a step.
    let n = 2 * locals;
    let step = std::f64::consts::PI / locals as f64;
    let transform = CircleTransform::new(n, -std::f64::consts::FRAC_PI_2 + 0.5 * step);
    parts
        .iter()
        .map(|row| {
            let pad = |f: &dyn Fn(&num_complex::Complex64) -> f64| -> Vec<f64> {
                let mut values: Vec<f64> = row.iter().map(f).collect();
                values.resize(n, 0.0);
                values
            };
            let re = transform.analyse(&pad(&|v| v.re), order);
            let im = transform.analyse(&pad(&|v| v.im), order);
            (-(order as i64)..=order as i64)
                .map(|q| (re.get(q) + num_complex::Complex64::I * im.get(q)).norm())
                .collect()
        })
        .collect()
}

fn fit_warnings(estimate: &LightingEstimate) -> Vec<String> {
    estimate
        .channels
        .iter()
        .filter(|c| c.residual_relative > BAD_RESIDUAL)
        .map(|c| {
            format!(
                "Channel {}: the best lighting leaves {:.1} % of the largest radiance unexplained. Either the BRDF is not this surface's, or light reaches the object from out of the measurement plane; do not use the result as a measurement.",
                c.name,
                100.0 * c.residual_relative
            )
        })
        .collect()
}

fn findings(measured: &Measured, lighting: Option<&LightingEstimate>) -> Vec<String> {
    let mut findings = Vec::new();
    let coverage = measured.field.coverage(0, measured.limb_cut);
    findings.push(format!(
        "{} views give samples for {:.1} % of the light field's cells with |θo′| ≤ {:.0}°.",
        measured.views.len(),
        100.0 * coverage,
        measured.limb_cut.to_degrees()
    ));
    let Some(lighting) = lighting else {
        return findings;
    };
    for source in &lighting.sources {
        findings.push(format!(
            "A source at {:.3}° ± {:.3}°.",
            source.theta_deg, source.theta_sigma_deg
        ));
    }
    for channel in &lighting.channels {
        let open: Vec<usize> = (0..channel.spectrum.len())
            .filter(|&p| channel.spectrum[p].status == Status::Indeterminate)
            .collect();
        let band = match channel.determined_band {
            Some(band) => format!("frequencies up to p = {band} are determined by the photos"),
            None => "no frequency is determined by the photos".into(),
        };
        let rest = match open.first() {
            Some(first) if open.len() + first == channel.spectrum.len() => {
                format!("; from p = {first} on the surface hides the light's detail")
            }
            Some(first) => format!(
                "; {} of the frequencies from p = {first} on cannot be known through this surface",
                open.len()
            ),
            None => String::new(),
        };
        findings.push(format!("Channel {}: {band}{rest}.", channel.name));
    }
    findings
}

/// blake3 hashes of all files that a run reads, by names relative to the capture or the recipe.
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
            let bytes = std::fs::read(&path).map_err(|e| Error::read(&path, e))?;
            Ok((name, blake3::hash(&bytes).to_hex().to_string()))
        })
        .collect()
}
