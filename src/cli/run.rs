//! `flatlight run`: photos in, products and report out.

use std::path::Path;

use flatlight::capture::Capture;
use flatlight::pipeline::{Folder, Found, Recipe, Run, Verdict, execute, input_hashes};
use flatlight::recover::Status;
use flatlight::{Error, Result, report};

use super::progress::Bars;
use super::{Common, say};

/// Photos in, products and report out.
pub fn run(
    recipe_file: &Path,
    capture: &Path,
    out: &Path,
    force: bool,
    common: &Common,
) -> Result<()> {
    let recipe = Recipe::read(recipe_file)?;
    let capture = Capture::read(capture)?;
    let hashes = input_hashes(&recipe, recipe_file, &capture)?;
    let folder = Folder::new(out);
    let _claim = folder.claim()?;
    if folder.look(&hashes, &recipe.to_toml(), &capture.to_toml(), force)? == Found::Same {
        say::result(
            common,
            &format!(
                "nothing to do, the folder holds this run already\nopen {}",
                out.join("report.html").display()
            ),
        );
        return Ok(());
    }
    let bars = Bars::strict(common.quiet, common.strict);
    let mut run = execute(&recipe, &capture, &bars).map_err(|e| named(e, recipe_file))?;
    drop(bars);
    run.input_hashes = hashes;
    if common.strict && !run.warnings.is_empty() {
        return Err(Error::failed(format!(
            "--strict: {} warning(s), nothing was written\n  {}",
            run.warnings.len(),
            run.warnings.join("\n  ")
        )));
    }
    folder.write_with(&run, &report::page)?;
    for warning in &run.warnings {
        say::warning(common, warning);
    }
    say::result(common, &answer(&run, out));
    Ok(())
}

/// An error about a key of the recipe, with the recipe's name.
fn named(error: Error, recipe: &Path) -> Error {
    let of_recipe = |key: &str| {
        let table = key.split('.').next().unwrap_or("");
        ["brdf", "lighting", "recovery", "light_field", "scale"].contains(&table)
    };
    match error.about().is_some_and(of_recipe) {
        true => error.file(recipe),
        false => error,
    }
}

/// The run's answer in a few lines, and the file to open.
fn answer(run: &Run, out: &Path) -> String {
    let mut lines = vec![format!(
        "{}: {} views, channels {}",
        run.capture_name,
        run.views.len(),
        run.channels.join(" ")
    )];
    if let Some(lighting) = &run.lighting {
        for source in &lighting.sources {
            let irradiance: Vec<String> = source
                .irradiance
                .iter()
                .zip(&source.irradiance_sigma)
                .map(|(e, s)| report::number::with_sigma(*e, *s))
                .collect();
            lines.push(format!(
                "  source at {}, {} W m⁻²",
                source.direction(),
                irradiance.join(", ")
            ));
        }
        for channel in &lighting.channels {
            lines.push(format!(
                "  {}: light determined up to p = {}",
                channel.name,
                channel
                    .determined_band
                    .map_or_else(|| "–".into(), |b| b.to_string())
            ));
        }
    }
    if let Some(brdf) = &run.brdf {
        for (name, slice) in brdf.channels.iter().zip(&brdf.slices) {
            let determined = slice
                .status
                .iter()
                .filter(|s| **s == Status::Determined)
                .count();
            lines.push(format!(
                "  {name}: {:.1} % of the BRDF slice determined",
                100.0 * determined as f64 / slice.status.len().max(1) as f64
            ));
        }
    }
    for models in run.models.iter().flat_map(|m| &m.channels) {
        if let Some(best) = models.fits.get(models.best) {
            let parameters: Vec<String> = best
                .parameters
                .iter()
                .map(|p| format!("{} {:.4}", p.name, p.value))
                .collect();
            lines.push(format!(
                "  {}: fitted best by {}, {}",
                models.channel,
                best.model,
                parameters.join(", ")
            ));
        }
    }
    for (name, fit) in run.channels.iter().zip(&run.fit) {
        let verdict = match fit.verdict {
            Verdict::Explained => "",
            Verdict::Doubtful => ": doubtful",
            Verdict::Refused => ": refused, this is no measurement",
        };
        lines.push(format!(
            "  {name}: residual {:.3} % of the largest radiance, {:.2} % of the light field unexplained beyond noise{verdict}",
            100.0 * fit.residual_relative,
            100.0 * fit.unexplained
        ));
    }
    lines.push(format!("open {}", out.join("report.html").display()));
    lines.join("\n")
}
