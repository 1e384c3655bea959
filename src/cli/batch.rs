//! `flatlight batch`: one recipe on many capture sets.

use std::path::{Path, PathBuf};

use flatlight::batch::{self, Options, csv, find_sets};
use flatlight::pipeline::Recipe;
use flatlight::{Error, Result, files, report};

use super::progress::Bars;
use super::{Common, say};

/// Runs all sets, writes the table and the page; fails at the end if any set failed.
pub fn run(
    folder: &Path,
    recipe_file: &Path,
    out: Option<&Path>,
    jobs: Option<u16>,
    force: bool,
    common: &Common,
) -> Result<()> {
    let recipe = Recipe::read(recipe_file)?;
    let out = out.map_or_else(|| beside(folder, recipe_file), |out| Ok(out.to_path_buf()))?;
    let sets = find_sets(folder, &out)?;
    let options = Options {
        jobs: jobs.map_or_else(rayon::current_num_threads, usize::from),
        force,
        strict: common.strict,
    };
    let _claim = files::claim(&out)?;
    let bars = Bars::new(common.quiet);
    let outcomes = batch::run(&sets, recipe_file, &out, &options, &report::page, &bars)?;
    drop(bars);
    let name = |path: &Path| path.file_name().map(|n| n.to_string_lossy().into_owned());
    let title = recipe
        .title
        .clone()
        .or_else(|| name(folder))
        .unwrap_or_else(|| "Batch".into());
    let page = report::batch(&title, &recipe.to_toml(), &outcomes)?;
    files::write_together(&[
        (out.join("summary.csv"), csv(&outcomes)),
        (out.join("report.html"), page),
    ])?;

    let failed: Vec<String> = outcomes
        .iter()
        .filter_map(|o| {
            o.found
                .as_ref()
                .err()
                .map(|why| format!("{}: {why}", o.name))
        })
        .collect();
    let reused = outcomes.iter().filter(|o| o.reused).count();
    let warned = outcomes
        .iter()
        .filter(|o| o.found.as_ref().is_ok_and(|f| !f.warnings.is_empty()))
        .count();
    if warned > 0 {
        let text = format!("{warned} set(s) have warnings; their reports say which");
        say::warning(common, &text);
    }
    say::result(
        common,
        &format!(
            "{} of {} sets gave a result{}, {} failed\nopen {}",
            outcomes.len() - failed.len(),
            outcomes.len(),
            if reused > 0 {
                format!(" ({reused} of them from before)")
            } else {
                String::new()
            },
            failed.len(),
            out.join("report.html").display()
        ),
    );
    if failed.is_empty() {
        return Ok(());
    }
    Err(Error::failed(format!(
        "{} of {} sets failed\n  {}",
        failed.len(),
        outcomes.len(),
        failed.join("\n").replace('\n', "\n  ")
    )))
}

/// `sets-lighting` beside `sets` for the recipe `lighting.toml`.
fn beside(folder: &Path, recipe: &Path) -> Result<PathBuf> {
    let whole = std::fs::canonicalize(folder).map_err(|e| Error::read(folder, e))?;
    match (whole.file_name(), recipe.file_stem()) {
        (Some(name), Some(stem)) => {
            let mut name = name.to_os_string();
            name.push("-");
            name.push(stem);
            Ok(whole.with_file_name(name))
        }
        _ => Err(Error::input("expected a folder for the results, found none").key("--out")),
    }
}
