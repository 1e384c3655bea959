//! Bad input, as a table: how it is made, what is asked for, and what must be in the message. Every one of them ends with
//! exit code 2, one message and nothing written.

mod bench;
mod capture;
mod commands;
mod left_out;
mod photos;
mod recipes;
mod tables;

use std::collections::BTreeSet;

use bench::{Bench, Format, Output};
use rayon::prelude::*;

/// What the program is asked to do with a set.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Ask {
    Run,
    /// `run --strict`
    Strict,
    Check,
    /// Any arguments; `SET` and `OUT` stand for the folders.
    Other(&'static [&'static str]),
}

/// One bad input.
pub(crate) struct Case {
    /// What is wrong with it.
    what: String,
    format: Format,
    spoil: Box<dyn Fn(&Bench) + Send + Sync>,
    ask: Ask,
    /// Pieces that the message must hold.
    words: Vec<String>,
    /// What it must not hold: a second fault that only follows from the first.
    unsaid: Vec<String>,
}

impl Case {
    pub(crate) fn new(
        what: impl Into<String>,
        spoil: impl Fn(&Bench) + Send + Sync + 'static,
        words: &[&str],
    ) -> Self {
        Self {
            what: what.into(),
            format: Format::Exr,
            spoil: Box::new(spoil),
            ask: Ask::Run,
            words: words.iter().map(ToString::to_string).collect(),
            unsaid: Vec::new(),
        }
    }

    pub(crate) fn of(mut self, format: Format) -> Self {
        self.format = format;
        self
    }

    pub(crate) fn asks(mut self, ask: Ask) -> Self {
        self.ask = ask;
        self
    }

    pub(crate) fn without(mut self, words: &[&str]) -> Self {
        self.unsaid = words.iter().map(ToString::to_string).collect();
        self
    }

    /// What is wrong with how the program takes it.
    fn fault(&self) -> Option<String> {
        let bench = Bench::new(self.format);
        (self.spoil)(&bench);
        let before = names(&bench);
        let output = self.ask(&bench);
        let mut wrong = Vec::new();
        if output.code != 2 {
            wrong.push(format!("exit code {}", output.code));
        }
        if !output.said.lines().any(|line| line.starts_with("error: ")) {
            wrong.push("no error is said".into());
        }
        for word in self.words.iter().filter(|w| !output.said.contains(*w)) {
            wrong.push(format!("{word:?} is not said"));
        }
        for word in self.unsaid.iter().filter(|w| output.said.contains(*w)) {
            wrong.push(format!("{word:?} is said"));
        }
        if output.said.contains("panicked") {
            wrong.push("it panicked".into());
        }
        if !output.answered.is_empty() {
            wrong.push("a result on stdout".into());
        }
        if names(&bench) != before {
            wrong.push("something was written".into());
        }
        if std::env::var_os("SHOW_MESSAGES").is_some() {
            println!("## {}\n{}", self.what, output.said);
        }
        (!wrong.is_empty()).then(|| {
            format!(
                "{}: {}\n    {}",
                self.what,
                wrong.join("; "),
                output.said.trim_end().replace('\n', "\n    ")
            )
        })
    }

    fn ask(&self, bench: &Bench) -> Output {
        let (set, out) = (bench.set(), bench.out());
        match self.ask {
            Ask::Run => bench.run(&[]),
            Ask::Strict => bench.run(&["--strict"]),
            Ask::Check => bench::flatlight(&["check", bench::shown(&set)]),
            Ask::Other(arguments) => {
                let filled: Vec<String> = arguments
                    .iter()
                    .map(|a| {
                        a.replace("SET", bench::shown(&set))
                            .replace("OUT", bench::shown(&out))
                    })
                    .collect();
                let filled: Vec<&str> = filled.iter().map(String::as_str).collect();
                bench::flatlight(&filled)
            }
        }
    }
}

/// Every file and folder about the set.
fn names(bench: &Bench) -> BTreeSet<String> {
    fn walk(folder: &std::path::Path, found: &mut BTreeSet<String>) {
        let Ok(entries) = std::fs::read_dir(folder) else {
            return;
        };
        for entry in entries.flatten() {
            let path = entry.path();
            found.insert(format!("{path:?}"));
            if path.is_dir() && !path.is_symlink() {
                walk(&path, found);
            }
        }
    }
    let mut found = BTreeSet::new();
    let set = bench.set();
    walk(set.parent().unwrap_or(&set), &mut found);
    found
}

/// Every input of the table is refused as it should be.
fn all_refused(cases: Vec<Case>, least: usize) {
    let told: BTreeSet<&str> = cases.iter().map(|c| c.what.as_str()).collect();
    assert_eq!(told.len(), cases.len(), "each case is there once");
    assert!(cases.len() >= least, "{} cases", cases.len());
    let faults: Vec<String> = cases.par_iter().filter_map(Case::fault).collect();
    assert!(
        faults.is_empty(),
        "{} of {} inputs:\n{}",
        faults.len(),
        cases.len(),
        faults.join("\n")
    );
}

#[test]
fn descriptions_of_captures() {
    all_refused(capture::cases(), 70);
}

#[test]
fn recipes_of_runs() {
    all_refused(recipes::cases(), 35);
}

#[test]
fn photos_of_every_format() {
    all_refused(photos::cases(), 70);
}

#[test]
fn tables_and_maps() {
    all_refused(tables::cases(), 30);
}

#[test]
fn other_commands_and_folders() {
    all_refused(commands::cases(), 15);
}
