//! `flatlight run` and `flatlight check`.

use std::path::Path;

use flatlight::capture::Capture;
use flatlight::pipeline::{Folder, Found, Recipe, Run, execute, input_hashes};
use flatlight::{Error, Result, report};

use super::Common;
use super::progress::Bars;

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
    if folder.look(&hashes, &recipe.to_toml(), &capture.to_toml(), force)? == Found::Same {
        println!("nothing to do, the folder holds this run already");
        println!("open {}", out.join("report.html").display());
        return Ok(());
    }
    let bars = Bars::new(common.quiet);
    let mut run = execute(&recipe, &capture, &bars)?;
    drop(bars);
    run.input_hashes = hashes;
    if common.strict && !run.warnings.is_empty() {
        return Err(Error::failed(format!(
            "--strict: {} warning(s), nothing was written\n  {}",
            run.warnings.len(),
            run.warnings.join("\n  ")
        )));
    }
    let page = report::page(&run)?;
    folder.write(&run, &page)?;
    if !common.quiet {
        for warning in &run.warnings {
            eprintln!("warning: {warning}");
        }
    }
    println!("{}", answer(&run, out));
    Ok(())
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
                .map(|(e, s)| format!("{e:.4} ± {s:.4}"))
                .collect();
            lines.push(format!(
                "  source at {:.3}° ± {:.3}°, {} W m⁻²",
                source.theta_deg,
                source.theta_sigma_deg,
                irradiance.join(", ")
            ));
        }
        for channel in &lighting.channels {
            lines.push(format!(
                "  {}: determined up to p = {}, residual {:.3} % of the largest radiance",
                channel.name,
                channel
                    .determined_band
                    .map_or_else(|| "–".into(), |b| b.to_string()),
                100.0 * channel.residual_relative
            ));
        }
    }
    lines.push(format!("open {}", out.join("report.html").display()));
    lines.join("\n")
}

/// Everything wrong with a capture set.
pub fn check(path: &Path) -> Result<()> {
    let capture = Capture::read(path)?;
    println!(
        "{}: {} views, nothing wrong found in the description",
        capture.name,
        capture.views.len()
    );
    Ok(())
}
