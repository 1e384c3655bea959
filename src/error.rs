//! One error for the whole crate: what was expected, what came, where, and what to do.

use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

/// Shorthand for results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Faults that one message shows; the rest are counted.
const MOST_SHOWN: usize = 50;

/// Whose fault it is, which decides the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The request or the input is wrong (exit code 2).
    Input,
    /// The input was acceptable and the work failed all the same (exit code 1).
    Failed,
}

/// What went wrong. Build it with [`Error::input`] or [`Error::failed`] and add the place.
#[derive(Debug)]
pub struct Error(Box<Inner>);

#[derive(Debug)]
struct Inner {
    kind: Kind,
    what: String,
    file: Option<PathBuf>,
    view: Option<usize>,
    key: Option<String>,
    line: Option<usize>,
    advice: Option<String>,
    also: Vec<Error>,
}

impl Error {
    fn new(kind: Kind, what: impl Into<String>) -> Self {
        Self(Box::new(Inner {
            kind,
            what: what.into(),
            file: None,
            view: None,
            key: None,
            line: None,
            advice: None,
            also: Vec::new(),
        }))
    }

    /// The request or the input is wrong. `what` says what was expected and what came.
    pub fn input(what: impl Into<String>) -> Self {
        Self::new(Kind::Input, what)
    }

    /// The work failed. `what` says which work, and why.
    pub fn failed(what: impl Into<String>) -> Self {
        Self::new(Kind::Failed, what)
    }

    /// A file could not be read: missing, not permitted, damaged.
    pub fn read(file: &Path, cause: impl fmt::Display) -> Self {
        Self::input(format!("cannot read it: {cause}")).file(file)
    }

    /// A file could not be written.
    pub fn write(file: &Path, cause: impl fmt::Display) -> Self {
        Self::failed(format!("cannot write it: {cause}")).file(file)
    }

    /// Several faults reported together; `None` if there are none.
    pub fn all(errors: Vec<Error>) -> Option<Self> {
        let mut errors = errors.into_iter();
        let mut first = errors.next()?;
        first.0.also.extend(errors);
        Some(first)
    }

    /// Adds the file the fault is in.
    #[must_use]
    pub fn file(mut self, file: impl Into<PathBuf>) -> Self {
        self.0.file.get_or_insert(file.into());
        self
    }

    /// Adds the index of the view, counted from 0 as in the files.
    #[must_use]
    pub fn view(mut self, view: usize) -> Self {
        self.0.view.get_or_insert(view);
        self
    }

    /// Gives another index of the view than the one that stands there.
    #[must_use]
    pub fn renumbered(mut self, view: usize) -> Self {
        self.0.view = Some(view);
        self
    }

    /// Adds the key of a TOML file or the column of a table.
    #[must_use]
    pub fn key(mut self, key: impl Into<String>) -> Self {
        self.0.key.get_or_insert(key.into());
        self
    }

    /// Adds the line in the file, counted from 1.
    #[must_use]
    pub fn line(mut self, line: usize) -> Self {
        self.0.line.get_or_insert(line);
        self
    }

    /// Adds what the user can do about it.
    #[must_use]
    pub fn advice(mut self, advice: impl Into<String>) -> Self {
        self.0.advice.get_or_insert(advice.into());
        self
    }

    /// Adds a sentence after the advice, if there is any.
    #[must_use]
    pub fn note(mut self, note: impl Into<String>) -> Self {
        let note = note.into();
        self.0.advice = Some(match self.0.advice.take() {
            Some(advice) => format!("{advice}\n  {note}"),
            None => note,
        });
        self
    }

    /// Whether another error says the same of another view or file.
    pub fn same_fault(&self, other: &Self) -> bool {
        let (a, b) = (&self.0, &other.0);
        (a.kind, &a.what, &a.key) == (b.kind, &b.what, &b.key)
    }

    /// Changes this error and each that is reported with it.
    pub(crate) fn map_each(mut self, change: &dyn Fn(Self) -> Self) -> Self {
        let also = std::mem::take(&mut self.0.also);
        let mut changed = change(self);
        changed.0.also = also.into_iter().map(change).collect();
        changed
    }

    /// Takes the advice out.
    pub(crate) fn take_advice(&mut self) -> Option<String> {
        self.0.advice.take()
    }

    /// The key it is about.
    pub fn about(&self) -> Option<&str> {
        self.0.key.as_deref()
    }

    /// Whose fault it is.
    pub fn kind(&self) -> Kind {
        self.0.kind
    }

    /// 2 for a wrong request or input, 1 for work that failed.
    pub fn exit_code(&self) -> u8 {
        match self.0.kind {
            Kind::Input => 2,
            Kind::Failed => 1,
        }
    }

    fn write_one(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let inner = &self.0;
        let mut place = Vec::new();
        if let Some(file) = &inner.file {
            place.push(match inner.line {
                Some(line) => format!("{}:{line}", file.display()),
                None => file.display().to_string(),
            });
        } else if let Some(line) = inner.line {
            place.push(format!("line {line}"));
        }
        if let Some(view) = inner.view {
            place.push(format!("view {view}"));
        }
        if let Some(key) = &inner.key {
            place.push(key.clone());
        }
        if !place.is_empty() {
            // A name with a line break in it must not look like a second message.
            let place = place.join(", ").replace('\n', "\\n");
            write!(f, "{}: ", printable(&place))?;
        }
        write!(f, "{}", printable(&inner.what))?;
        if let Some(advice) = &inner.advice {
            write!(f, "\n  {}", printable(advice))?;
        }
        Ok(())
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_one(f)?;
        for other in self.0.also.iter().take(MOST_SHOWN - 1) {
            f.write_str("\n")?;
            other.write_one(f)?;
        }
        match self.0.also.len().saturating_sub(MOST_SHOWN - 1) {
            0 => Ok(()),
            more => write!(f, "\n… and {more} more faults"),
        }
    }
}

impl std::error::Error for Error {}

/// The text with everything escaped that would move a terminal's cursor, colour it or turn the order of its letters;
/// line breaks stay. Names and values of files are other people's.
pub fn printable(text: &str) -> Cow<'_, str> {
    let hidden = |c: char| {
        (c.is_control() && c != '\n')
            || matches!(c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}')
    };
    if !text.contains(hidden) {
        return text.into();
    }
    let mut plain = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if hidden(c) {
            plain.extend(c.escape_unicode());
        } else {
            plain.push(c);
        }
    }
    plain.into()
}

/// The candidate nearest to `word`, if it is near enough to have been meant.
pub fn nearest<'a>(word: &str, candidates: &[&'a str]) -> Option<&'a str> {
    candidates
        .iter()
        .map(|c| (edit_distance(word, c), *c))
        .min()
        .filter(|(distance, c)| *distance <= 1 + c.len() / 3)
        .map(|(_, c)| c)
}

fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let substitute = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = substitute.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_says_where_what_and_what_to_do() {
        let error = Error::input("expected a length above 0, found -3")
            .file("capture.toml")
            .key("object.radius")
            .advice("Give the radius in metres.");
        assert_eq!(
            error.to_string(),
            "capture.toml, object.radius: expected a length above 0, found -3\n  Give the radius in metres."
        );
        assert_eq!(error.exit_code(), 2);
    }

    #[test]
    fn names_cannot_act_on_a_terminal_or_forge_a_message() {
        let error = Error::input("found \"\u{1b}[31mred\u{202e}\"").file("a\nerror: b\r.png");
        assert_eq!(
            error.to_string(),
            "a\\nerror: b\\u{d}.png: found \"\\u{1b}[31mred\\u{202e}\""
        );
    }

    #[test]
    fn a_thousand_faults_are_not_a_thousand_lines() {
        let all = Error::all((0..1000).map(|_| Error::input("wrong")).collect());
        let message = all.expect("faults").to_string();
        assert_eq!(message.lines().count(), MOST_SHOWN + 1);
        assert!(message.ends_with("… and 950 more faults"), "{message}");
    }

    #[test]
    fn the_nearest_name_is_found_only_if_near() {
        assert_eq!(
            nearest("raduis", &["shape", "radius", "mask"]),
            Some("radius")
        );
        assert_eq!(nearest("zzzzzz", &["shape", "radius", "mask"]), None);
    }
}
