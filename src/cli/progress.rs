//! Progress bars on a terminal; nothing elsewhere.

use std::io::IsTerminal;
use std::sync::{Mutex, MutexGuard, PoisonError};

use flatlight::pipeline::Progress;
use flatlight::{Error, Result};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A bar per stage on stderr.
pub struct Bars {
    current: Mutex<ProgressBar>,
    shown: bool,
    strict: bool,
}

impl Bars {
    /// Bars if stderr is a terminal and `quiet` is not asked for.
    pub fn new(quiet: bool) -> Self {
        Self {
            current: Mutex::new(ProgressBar::hidden()),
            shown: !quiet && std::io::stderr().is_terminal(),
            strict: false,
        }
    }

    /// The same; `strict`: a doubtful photo ends the run.
    pub fn strict(quiet: bool, strict: bool) -> Self {
        let mut bars = Self::new(quiet);
        bars.strict = strict;
        bars
    }

    fn bar(&self) -> MutexGuard<'_, ProgressBar> {
        // A panic elsewhere leaves the bar as good as before.
        self.current.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Progress for Bars {
    fn stage(&self, name: &str, steps: usize) {
        if !self.shown {
            return;
        }
        let bar = ProgressBar::with_draw_target(Some(steps as u64), ProgressDrawTarget::stderr());
        let style = ProgressStyle::with_template(
            "{msg:>14} {bar:32} {pos}/{len}  {per_sec}  {elapsed} so far, {eta} left",
        )
        .unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style);
        bar.set_message(name.to_string());
        // A stage of one long step still shows that time goes by.
        bar.enable_steady_tick(std::time::Duration::from_millis(250));
        let mut current = self.bar();
        current.finish_and_clear();
        *current = bar;
    }

    fn step(&self) {
        if self.shown {
            self.bar().inc(1);
        }
    }

    fn doubt(&self, fault: Error) -> Result<()> {
        match self.strict {
            true => Err(fault),
            false => Ok(()),
        }
    }
}

impl Drop for Bars {
    fn drop(&mut self) {
        self.bar().finish_and_clear();
    }
}
