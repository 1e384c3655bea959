//! `flatlight paper`.

use std::path::Path;
use std::time::Instant;

use flatlight::validate::paper::{STATEMENTS, recompute};
use flatlight::{Error, Result, report};

use super::{Common, file, say};

/// Recomputes the paper, writes the page and the table, prints a summary; failed checks are an error.
pub fn paper(out: &Path, common: &Common) -> Result<()> {
    std::fs::create_dir_all(out).map_err(|e| Error::write(out, e))?;
    let start = Instant::now();
    let paper = recompute()?;
    let seconds = start.elapsed().as_secs_f64();
    let page = out.join("paper.html");
    file::write(&page, report::paper::page(&paper)?.as_bytes())?;
    file::write(
        &out.join("paper.csv"),
        report::paper::csv(&paper).as_bytes(),
    )?;
    if !common.quiet && common.log == say::Log::Text {
        println!("equation     checks  worst difference/tolerance  result");
        for statement in &STATEMENTS {
            let checks = || {
                let all = paper.checks.iter();
                all.filter(|c| c.equation == statement.equation)
            };
            // A check that must be exact has the tolerance 0.
            let share = |d: f64, t: f64| if d == 0.0 { 0.0 } else { d / t };
            let worst = checks().map(|c| share(c.difference, c.tolerance));
            println!(
                "{:<12} {:>6}  {:>26.2e}  {}",
                statement.equation,
                checks().count(),
                worst.fold(0.0, f64::max),
                if checks().all(|c| c.passed) {
                    "pass"
                } else {
                    "FAIL"
                }
            );
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
