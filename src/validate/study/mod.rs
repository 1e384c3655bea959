//! Monte-Carlo studies of the three recoveries: real error against the Cramér–Rao bound, and what the intervals cover.
//!
//! A *cell* of a study is one recovery of one BRDF under one lighting, seen by so many views, at one noise. Its light
//! field is computed without any approximation but quadrature, and each draw adds its own seeded normal noise, of
//! `noise` times the largest value of the field, to every sample.
//!
//! # What is compared
//!
//! Only *determined* quantities: those whose status is [`Status::Determined`](crate::recover::Status) in every draw.
//!
//! * `lighting`: the real and the imaginary parts of L_p. The truth's coefficients, sources included, are exact.
//! * `brdf`: the values of ρ̃ = ρ cos θi′ cos θo′ at the cells of a half × half grid of angles; if none is determined, as under
//!   light without detail, the real and the imaginary parts of ρ̃_{p,q}, p ≤ 16.
//! * `both`: the parts of L_p, p ≥ 1, in the scale L_0 = 1; and in the same scale the slice: an outcome for each. Of the slice the parts of ρ̃_{p,q} are compared,
//!   and only if none of them is determined its values: light that is found up to a frequency has no detail beyond it.
//!
//! # What is reported
//!
//! With e the errors of the determined quantities in the L2 norm of the function that they describe (∫|L|² = 2π Σ|L_p|²; the
//! sum over cells for ρ̃), and N the norm of the truth (of L: up to the band, since a sun's own norm is infinite):
//!
//! * rmse = √⟨|e|²⟩ / N over the draws; bias = |⟨e⟩| / N, of which rmse/√draws is left by chance alone;
//! * bound = √(Σ Cramér–Rao bounds) / N of the unregularised problem on the same quantities: for `both` at the truth (of the slice with all
//!   frequencies of the light unknown that the recovery finds), for the
//!   others by the recovery itself, its mean square over the draws (it knows the samples' variances, which are the truth's);
//! * ratio = rmse / bound; each = the ratio value by value, √⟨error²/bound²⟩ (in the report only); coverage: how many of all errors are within ±1.96 σ of their own draw;
//! * band: `lighting`, `both`: the largest determined p; `brdf`: the largest p up to which every ρ̃_{p,q}, |q| ≤ p, is
//!   determined.

mod cell;
mod folder;
mod recipe;
mod scene;
mod tally;

pub use cell::{Cell, Recovered};
pub use folder::{StudyFolder, tables};
pub use recipe::{Plan, StudyRecipe};
pub use tally::{Outcome, Quantity};

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::error::{Error, Result};
use cell::Prepared;

/// Draws every cell of `plan` that `folder` does not hold yet, and returns the outcomes of all in the plan's order, one for each of the
/// [`Recovered::quantities`].
///
/// `threads` draws are made at the same time, each on one thread, so that the result does not depend on their number.
/// `begin` is told of every cell and its number of draws, `step` of every draw that is done.
///
/// # Errors
/// If a lighting or BRDF cannot be made, or the folder cannot be written. A draw whose recovery fails is not an error: it is
/// counted in [`Outcome::failed`].
pub fn run(
    plan: &Plan,
    folder: &StudyFolder,
    threads: usize,
    begin: &dyn Fn(&Cell, usize),
    step: &(dyn Fn() + Sync),
) -> Result<Vec<(Cell, Outcome)>> {
    let mut done: Vec<(Cell, Outcome)> = Vec::new();
    let mut field = None;
    for cell in &plan.cells {
        if let Some(outcomes) = folder.read(cell)? {
            done.extend(outcomes.into_iter().map(|o| (cell.clone(), o)));
            continue;
        }
        begin(cell, cell.draws);
        let prepared = Prepared::new(cell, &mut field)?;
        let draws = on_threads(cell.draws, threads, step, |draw| prepared.draw(draw))?;
        let outcomes = prepared.tally(draws);
        folder.write(cell, &outcomes)?;
        done.extend(outcomes.into_iter().map(|o| (cell.clone(), o)));
    }
    Ok(done)
}

/// `work(0 … count − 1)` on so many threads, in order.
///
/// Every worker has a thread pool of one thread of its own: within a shared pool a draw that waits for its own parallel parts would
/// begin another draw, and memory would grow with the depth; and sums would depend on who helped.
fn on_threads<T: Send>(
    count: usize,
    threads: usize,
    step: &(dyn Fn() + Sync),
    work: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<(usize, T)>> = Mutex::new(Vec::with_capacity(count));
    let workers = threads.clamp(1, count.max(1));
    let pools = (0..workers)
        .map(|_| rayon::ThreadPoolBuilder::new().num_threads(1).build())
        .collect::<std::result::Result<Vec<_>, _>>()
        .map_err(|e| Error::failed(format!("cannot start {workers} threads: {e}")))?;
    std::thread::scope(|scope| {
        for pool in &pools {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= count {
                        return;
                    }
                    let result = pool.install(|| work(i));
                    // Whoever panicked with the lock left the list as it was.
                    let mut all = results
                        .lock()
                        .unwrap_or_else(std::sync::PoisonError::into_inner);
                    all.push((i, result));
                    drop(all);
                    step();
                }
            });
        }
    });
    let mut results = results
        .into_inner()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    results.sort_by_key(|(i, _)| *i);
    Ok(results.into_iter().map(|(_, r)| r).collect())
}
