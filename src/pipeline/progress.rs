//! How far a run is: stages tell, the edge of the program shows.

use crate::error::{Error, Result};

/// Listener to a run's progress; called from several threads.
pub trait Progress: Sync {
    /// A stage of `steps` steps begins.
    fn stage(&self, name: &str, steps: usize);
    /// A step of the current stage is done.
    fn step(&self);
    /// A photo is damaged or makes no sense, and the run would go on without it or without some of its pixels.
    ///
    /// # Errors
    /// What a listener returns ends the run.
    fn doubt(&self, fault: Error) -> Result<()> {
        drop(fault);
        Ok(())
    }
}

/// Nobody listens.
#[derive(Clone, Copy, Debug)]
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _name: &str, _steps: usize) {}
    fn step(&self) {}
}
