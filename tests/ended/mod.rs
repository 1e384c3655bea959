//! How commands ended, and at which calls on the file system they can be made to fail.

use std::process::{Child, Output};

/// The exit code; −1 of what was killed.
pub fn code(output: &Output) -> i32 {
    output.status.code().unwrap_or(-1)
}

/// What was said on the standard error output.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Waits for commands that were started at once: the work is done, by one of them or by several, and what could not do it was refused.
pub fn one_worked(at_work: &mut [Child], what: &str) {
    let codes: Vec<i32> = at_work
        .iter_mut()
        .map(|c| c.wait().expect("ends").code().unwrap_or(-1))
        .collect();
    assert!(
        codes.contains(&0) && codes.iter().all(|c| [0, 2].contains(c)),
        "{what}: {codes:?}"
    );
}

/// How many calls a command makes, if the `n`-th `comes`.
pub fn calls(what: &str, comes: impl Fn(usize) -> bool) -> usize {
    let (mut low, mut high) = (1, 4096);
    assert!(
        comes(low) && !comes(high),
        "{what} makes fewer than {high} calls"
    );
    while high - low > 1 {
        let middle = (low + high) / 2;
        if comes(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}
