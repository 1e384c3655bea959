//! `flatlight simulate`.

use std::path::Path;

use flatlight::pipeline::Progress;
use flatlight::simulate::{Recipe, plan, simulate};
use flatlight::{Error, Result};

use super::progress::Bars;
use super::{Common, say};

/// A recipe in, a synthetic capture set with its truth out.
pub fn run(recipe: &Path, out: &Path, force: bool, common: &Common) -> Result<()> {
    let recipe = Recipe::read(recipe)?;
    let unlikely = recipe.brdf.warnings();
    if common.strict && !unlikely.is_empty() {
        return Err(Error::failed(format!(
            "--strict: {} warning(s), nothing was written\n  {}",
            unlikely.len(),
            unlikely.join("\n  ")
        )));
    }
    let bars = Bars::new(common.quiet);
    bars.stage("views", plan(&recipe)?.len());
    let written = simulate(&recipe, out, force, &|| bars.step())?;
    drop(bars);
    for warning in &written.warnings {
        say::warning(common, warning);
    }
    say::result(
        common,
        &format!(
            "{}: {} photos of {} views in {}\nflatlight run {} --capture {} --out OUT recovers its light",
            recipe.name,
            written.photos,
            written.views,
            out.display(),
            out.join("recipe.toml").display(),
            out.display()
        ),
    );
    Ok(())
}
