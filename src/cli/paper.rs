//! `flatlight paper`.

use std::path::Path;
use std::time::Instant;

use flatlight::validate::paper::{STATEMENTS, recompute};
use flatlight::{Error, Result, files, report};

use super::{Common, say};

/// Recomputes the paper, writes the page and the table, prints a summary; failed checks are an error.
pub fn paper(out: &Path, common: &Common) -> Result<()> {
    let _claim = files::claim(out)?;
    let start = Instant::now();
    let paper = recompute()?;
    let seconds = start.elapsed().as_secs_f64();
    let page = out.join("paper.html");
    files::write_together(&[
        (page.clone(), report::paper::page(&paper)?),
        (out.join("paper.csv"), report::paper::csv(&paper)),
    ])?;
    if !common.quiet && common.log == say::Log::Text {
        say::print("equation     checks  worst difference/tolerance  result\n");
        for statement in &STATEMENTS {
            let checks = || {
                let all = paper.checks.iter();
                all.filter(|c| c.equation == statement.equation)
            };
            // A check that must be exact has the tolerance 0.
            let share = |d: f64, t: f64| if d == 0.0 { 0.0 } else { d / t };
            let worst = checks().map(|c| share(c.difference, c.tolerance));
            say::print(&format!(
                "{:<12} {:>6}  {:>26.2e}  {}\n",
                statement.equation,
                checks().count(),
                worst.fold(0.0, f64::max),
                if checks().all(|c| c.passed) {
                    "pass"
                } else {
                    "FAIL"
                }
            ));
        }
    }
    let failed: Vec<String> = paper
        .checks
        .iter()
        .filter(|c| !c.passed)
        .map(|c| format!("eq. {}: {}", c.equation, c.claim))
        .collect();
    say::result(
        common,
        &format!(
            "{} of {} checks pass, recomputed in {seconds:.1} s\nopen {}",
            paper.checks.len() - failed.len(),
            paper.checks.len(),
            page.display()
        ),
    );
    if failed.is_empty() {
        return Ok(());
    }
    Err(Error::failed(format!(
        "{} check(s) failed\n  {}",
        failed.len(),
        failed.join("\n  ")
    )))
}
