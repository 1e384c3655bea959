//! `flatlight validate`.

use std::path::Path;

use flatlight::pipeline::Progress;
use flatlight::validate::study::{self, Cell, Outcome, StudyFolder, StudyRecipe};
use flatlight::{Error, Result, report};

use super::Common;
use super::progress::Bars;

/// A Monte-Carlo study: validation.csv and its report.
pub fn validate(recipe_file: &Path, out: &Path, full: bool, common: &Common) -> Result<()> {
    let recipe = StudyRecipe::read(recipe_file)?;
    let plan = recipe.plan(full);
    let folder = StudyFolder::open(out)?;
    let bars = Bars::new(common.quiet);
    let threads = rayon::current_num_threads();
    let begin = |cell: &Cell, draws: usize| bars.stage(&cell.label(), draws);
    let cells = study::run(&plan, &folder, threads, &begin, &|| bars.step())?;
    drop(bars);
    folder.product("validation.csv", &study::csv(&cells))?;
    folder.product("recipe.toml", &recipe.text)?;
    folder.product(
        "report.html",
        &report::validation(&recipe.title, &recipe.text, &cells)?,
    )?;
    let failed: Vec<String> = cells.iter().filter_map(failure).collect();
    if !common.quiet {
        for warning in &failed {
            eprintln!("warning: {warning}");
        }
    }
    if common.strict && !failed.is_empty() {
        return Err(Error::failed(format!(
            "--strict: draws failed in {} cells",
            failed.len()
        )));
    }
    for (cell, outcome) in &cells {
        println!("{}", line(cell, outcome));
    }
    println!("open {}", out.join("report.html").display());
    Ok(())
}

fn failure((cell, outcome): &(Cell, Outcome)) -> Option<String> {
    let why = outcome.failure.as_ref()?;
    Some(format!(
        "{}: {} of {} draws failed: {why}",
        cell.label(),
        outcome.failed,
        cell.draws
    ))
}

fn line(cell: &Cell, o: &Outcome) -> String {
    let percent = |v: Option<f64>| v.map_or("–".into(), |v| format!("{:.3} %", 100.0 * v));
    format!(
        "{}: p ≤ {}, error {}, bias {}, bound {}, ratio {}, coverage {}, {} draws",
        cell.label(),
        o.band.map_or("–".into(), |b| b.to_string()),
        percent(o.rmse),
        percent(o.bias),
        percent(o.bound),
        o.ratio().map_or("–".into(), |r| format!("{r:.3}")),
        o.coverage
            .map_or("–".into(), |c| format!("{:.1} %", 100.0 * c)),
        o.draws
    )
}
