//! `flatlight validate`.

use std::path::Path;

use flatlight::pipeline::Progress;
use flatlight::validate::study::{self, Cell, Outcome, StudyFolder, StudyRecipe};
use flatlight::{Error, Result, report};

use super::progress::Bars;
use super::{Common, say};

/// A Monte-Carlo study: its tables and its report.
pub fn validate(recipe_file: &Path, out: &Path, full: bool, common: &Common) -> Result<()> {
    let recipe = StudyRecipe::read(recipe_file)?;
    let plan = recipe.plan(full);
    let folder = StudyFolder::open(out)?;
    let bars = Bars::new(common.quiet);
    let threads = rayon::current_num_threads();
    let begin = |cell: &Cell, draws: usize| bars.stage(&cell.label(), draws);
    let cells = study::run(&plan, &folder, threads, &begin, &|| bars.step())?;
    drop(bars);
    let page = report::validation(&recipe.title, &recipe.text, &cells)?;
    let mut products = study::tables(&cells);
    products.extend([("recipe.toml", recipe.text.clone()), ("report.html", page)]);
    folder.products(&products)?;
    let failed: Vec<String> = cells.iter().filter_map(failure).collect();
    for warning in &failed {
        say::warning(common, warning);
    }
    if common.strict && !failed.is_empty() {
        return Err(Error::failed(format!(
            "--strict: draws failed in {} cells",
            failed.len()
        )));
    }
    for (cell, outcome) in &cells {
        say::result(common, &line(cell, outcome));
    }
    let page = out.join("report.html");
    say::result(common, &format!("open {}", page.display()));
    Ok(())
}

fn failure((cell, outcome): &(Cell, Outcome)) -> Option<String> {
    // Once for all that is judged of the draws.
    let first = cell.recovered.quantities().first();
    let why = outcome
        .failure
        .as_ref()
        .filter(|_| first == Some(&outcome.quantity))?;
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
        "{}, {}: p ≤ {}, error {}, bias {}, bound {}, ratio {}, coverage {}, {} draws",
        cell.label(),
        o.quantity.word(),
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
