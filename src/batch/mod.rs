//! Many capture sets, one recipe: each set a run of its own, and what all of them found side by side.
//!
//! Every set has its own folder of products, as `flatlight run` leaves it. A set that was finished before is
//! recognised by the hashes of its inputs and not computed again, so that a batch that was stopped goes on where it
//! was. What cannot be done with one set is its own result and does not touch the others.

mod outcome;
mod sets;
mod summary;

pub use outcome::{ChannelFound, Curve, Found, Outcome};
pub use sets::{Set, find_sets};
pub use summary::csv;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::capture::Capture;
use crate::error::{Error, Result};
use crate::pipeline::{self, Folder, Progress, Recipe, Run, Silent, execute, input_hashes};

/// How a batch is done.
#[derive(Clone, Debug)]
pub struct Options {
    /// Sets worked on at the same time, at least one.
    pub jobs: usize,
    /// Replace what a set's folder holds, whatever it is.
    pub force: bool,
    /// A set with warnings counts as failed.
    pub strict: bool,
}

/// Runs the recipe on every set, into `out`/name of the set. `page` makes a set's report; `progress` has a step for each set.
///
/// The outcomes are in the order of `sets` and do not depend on `jobs`, nor on whether a set was finished by an
/// earlier call: they are taken from the files that the run left.
///
/// # Errors
/// If the recipe cannot be read. What is wrong with a set is its [`Outcome`].
pub fn run(
    sets: &[Set],
    recipe_file: &Path,
    out: &Path,
    options: &Options,
    page: &(dyn Fn(&Run) -> Result<String> + Sync),
    progress: &dyn Progress,
) -> Result<Vec<Outcome>> {
    let recipe = Recipe::read(recipe_file)?;
    progress.stage("sets", sets.len());
    let work = Work {
        recipe: &recipe,
        recipe_file,
        options,
        page,
    };
    let next = AtomicUsize::new(0);
    let outcomes: Vec<Mutex<Option<Outcome>>> = sets.iter().map(|_| Mutex::new(None)).collect();
    // Plain threads that take the next set: the stages inside share the pool of all threads, and a thread of the pool
    // that began a second set while it waits for its own would need the memory of both.
    std::thread::scope(|scope| {
        for _ in 0..options.jobs.clamp(1, sets.len().max(1)) {
            scope.spawn(|| {
                while let Some((set, place)) = {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    sets.get(k).zip(outcomes.get(k))
                } {
                    let outcome = work.one(set, out.join(&set.name));
                    *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(outcome);
                    progress.step();
                }
            });
        }
    });
    outcomes
        .into_iter()
        .map(|place| {
            let outcome = place.into_inner().unwrap_or_else(PoisonError::into_inner);
            outcome.ok_or_else(|| Error::failed("a thread ended before its set was done"))
        })
        .collect()
}

/// What is the same for all sets.
struct Work<'a> {
    recipe: &'a Recipe,
    recipe_file: &'a Path,
    options: &'a Options,
    page: &'a (dyn Fn(&Run) -> Result<String> + Sync),
}

impl Work<'_> {
    fn one(&self, set: &Set, out: PathBuf) -> Outcome {
        // Stages do not panic on any input that is known; a set that finds one all the same must not take 49 others along.
        let result = catch_unwind(AssertUnwindSafe(|| self.finish(set, &out))).unwrap_or_else(|_| {
            Err(Error::failed(
                "the program itself failed on this set: a fault of the program, not of the photographs",
            ))
        });
        let (found, reused) = match result {
            Ok((found, reused)) => (Ok(found), reused),
            Err(error) => (Err(error.to_string()), false),
        };
        Outcome {
            name: set.name.clone(),
            found,
            reused,
        }
    }

    /// What the set's run found, and whether it was there already.
    fn finish(&self, set: &Set, out: &Path) -> Result<(Found, bool)> {
        let capture = Capture::read(&set.folder)?;
        let hashes = input_hashes(self.recipe, self.recipe_file, &capture)?;
        let folder = Folder::new(out);
        let _claim = folder.claim()?;
        let (recipe_toml, capture_toml) = (self.recipe.to_toml(), capture.to_toml());
        let there = folder.look(&hashes, &recipe_toml, &capture_toml, self.options.force)?;
        let reused = there == pipeline::Found::Same;
        if !reused {
            let mut run = execute(self.recipe, &capture, &Silent)?;
            run.input_hashes = hashes;
            self.refuse_warnings(&run)?;
            folder.write_with(&run, &self.page)?;
        }
        let run = folder.read()?;
        self.refuse_warnings(&run)?;
        Ok((Found::of(&run), reused))
    }

    fn refuse_warnings(&self, run: &Run) -> Result<()> {
        if !self.options.strict || run.warnings.is_empty() {
            return Ok(());
        }
        Err(Error::failed(format!(
            "--strict: {} warning(s)\n  {}",
            run.warnings.len(),
            run.warnings.join("\n  ")
        )))
    }
}
