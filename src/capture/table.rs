//! Reading a TOML table key by key, so that every fault in the file is found and reported at once.
//!
//! A [`Section`] remembers which keys it was asked for; [`Section::check_unknown`] then reports every
//! other key as unknown, with the nearest known name.

use std::cell::RefCell;
use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use crate::error::{Error, nearest};

/// The text of a TOML file and the faults found in it so far.
pub(crate) struct Source<'a> {
    file: PathBuf,
    text: &'a str,
    faults: RefCell<Vec<Error>>,
}

impl<'a> Source<'a> {
    pub(crate) fn new(file: &Path, text: &'a str) -> Self {
        Self {
            file: file.to_path_buf(),
            text,
            faults: RefCell::new(Vec::new()),
        }
    }

    /// Parses the text; syntax errors are reported with their lines.
    pub(crate) fn parse(&self) -> Result<DeTable<'a>, Error> {
        let (table, errors) = DeTable::parse_recoverable(self.text);
        for error in errors {
            let fault = Error::input(format!("this is not valid TOML: {}", error.message()));
            self.report(self.placed(fault, error.span().as_ref(), None));
        }
        if let Some(error) = Error::all(self.faults.take()) {
            return Err(error);
        }
        self.values()?;
        Ok(table.into_inner())
    }

    /// The values without their places, for modules that read their own sections.
    ///
    /// # Errors
    /// If a value is none that a program can hold, such as a whole number of 40 digits.
    pub(crate) fn values(&self) -> Result<toml::Table, Error> {
        self.text.parse().map_err(|e: toml::de::Error| {
            let fault = Error::input(format!("this value cannot be read: {}", e.message()));
            self.placed(fault, e.span().as_ref(), None)
        })
    }

    /// Adds file and line to an error whose key stands in the file, and shows the line.
    pub(crate) fn locate(&self, table: &DeTable<'_>, error: Error) -> Error {
        error.map_each(&|mut error| {
            let span = error.about().and_then(|key| span_of(table, key));
            let advice = error.take_advice();
            self.placed(error, span.as_ref(), advice.as_deref())
        })
    }

    pub(crate) fn report(&self, fault: Error) {
        self.faults.borrow_mut().push(fault);
    }

    /// All faults so far as one error, if there are any.
    pub(crate) fn into_faults(self) -> Vec<Error> {
        self.faults.into_inner()
    }

    /// Adds file and line, and shows the line.
    fn placed(&self, fault: Error, span: Option<&Range<usize>>, advice: Option<&str>) -> Error {
        let fault = fault.file(&self.file);
        let Some(span) = span else {
            return match advice {
                Some(advice) => fault.advice(advice),
                None => fault,
            };
        };
        let start = span.start.min(self.text.len());
        let before = self.text.get(..start).unwrap_or("");
        let line = before.matches('\n').count() + 1;
        let source = self.text.lines().nth(line - 1).unwrap_or("").trim_end();
        let mut shown: String = source.chars().take(100).collect();
        if shown.len() < source.len() {
            shown.push('…');
        }
        let mut note = format!("{line} | {shown}");
        if let Some(advice) = advice {
            note = format!("{note}\n  {advice}");
        }
        fault.line(line).advice(note)
    }
}

/// One table of the file, or an absent one.
pub(crate) struct Section<'a> {
    source: &'a Source<'a>,
    path: String,
    table: Option<&'a DeTable<'a>>,
    span: Option<Range<usize>>,
    view: Option<usize>,
    asked: RefCell<Vec<&'static str>>,
}

impl<'a> Section<'a> {
    pub(crate) fn root(source: &'a Source<'a>, table: &'a DeTable<'a>) -> Self {
        Self {
            source,
            path: String::new(),
            table: Some(table),
            span: None,
            view: None,
            asked: RefCell::new(Vec::new()),
        }
    }

    /// Reports a fault that is not of this file.
    pub(crate) fn report(&self, fault: Error) {
        self.source.report(fault);
    }

    /// Whether the section stands in the file.
    pub(crate) fn exists(&self) -> bool {
        self.table.is_some()
    }

    fn name(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_string()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    fn raw(&self, key: &'static str) -> Option<&'a Spanned<DeValue<'a>>> {
        if !self.asked.borrow().contains(&key) {
            self.asked.borrow_mut().push(key);
        }
        self.table?.get(key)
    }

    /// Whether the key stands in the section.
    pub(crate) fn has(&self, key: &'static str) -> bool {
        self.raw(key).is_some()
    }

    /// Reports a fault of one key.
    pub(crate) fn fault(&self, key: &str, what: impl Into<String>, advice: Option<&str>) {
        let span = self
            .table
            .and_then(|t| t.get(key))
            .map(|v| v.span())
            .or_else(|| self.span.clone());
        let mut fault = Error::input(what).key(self.name(key));
        if let Some(view) = self.view {
            fault = fault.view(view);
        }
        self.source
            .report(self.source.placed(fault, span.as_ref(), advice));
    }

    /// Reports that a needed key is missing.
    pub(crate) fn missing(&self, key: &str, advice: &str) {
        self.fault(key, "expected this key, found nothing", Some(advice));
    }

    fn wrong_type(&self, key: &str, expected: &str, found: &DeValue<'_>) {
        let found = match found {
            DeValue::String(s) => format!("the text \"{s}\""),
            DeValue::Integer(i) => format!("the number {i}"),
            DeValue::Float(x) => format!("the number {x}"),
            DeValue::Boolean(b) => format!("{b}"),
            DeValue::Datetime(d) => format!("the date {d}"),
            DeValue::Array(a) => format!("a list of {} values", a.len()),
            DeValue::Table(_) => "a table".to_string(),
        };
        self.fault(key, format!("expected {expected}, found {found}"), None);
    }

    /// A text.
    pub(crate) fn text(&self, key: &'static str) -> Option<&'a str> {
        let value = self.raw(key)?.get_ref();
        let text = value.as_str();
        if text.is_none() {
            self.wrong_type(key, "a text in quotes", value);
        }
        text
    }

    /// A text, or nothing if the key is absent or something else.
    pub(crate) fn word(&self, key: &'static str) -> Option<&'a str> {
        self.raw(key)?.get_ref().as_str()
    }

    /// `true` or `false`.
    pub(crate) fn boolean(&self, key: &'static str) -> Option<bool> {
        let value = self.raw(key)?.get_ref();
        let boolean = value.as_bool();
        if boolean.is_none() {
            self.wrong_type(key, "true or false", value);
        }
        boolean
    }

    /// A finite number.
    pub(crate) fn number(&self, key: &'static str) -> Option<f64> {
        let value = self.raw(key)?.get_ref();
        let number = finite(value);
        if number.is_none() {
            self.wrong_type(key, "a finite number", value);
        }
        number
    }

    /// A finite number that passes a test; `expected` says which.
    pub(crate) fn number_where(
        &self,
        key: &'static str,
        expected: &str,
        test: impl Fn(f64) -> bool,
    ) -> Option<f64> {
        let value = self.raw(key)?.get_ref();
        let number = finite(value);
        match number {
            None => self.wrong_type(key, expected, value),
            Some(number) if !test(number) => {
                self.fault(key, format!("expected {expected}, found {number:?}"), None);
                return None;
            }
            Some(_) => {}
        }
        number
    }

    /// A whole number.
    pub(crate) fn integer(&self, key: &'static str) -> Option<i64> {
        let value = self.raw(key)?.get_ref();
        let integer = whole(value);
        if integer.is_none() {
            self.wrong_type(key, "a whole number", value);
        }
        integer
    }

    /// A list of exactly `N` finite numbers.
    pub(crate) fn numbers<const N: usize>(&self, key: &'static str) -> Option<[f64; N]> {
        let value = self.raw(key)?.get_ref();
        let numbers = value.as_array().and_then(list::<N>);
        if numbers.is_none() {
            self.wrong_type(key, &format!("a list of {N} finite numbers"), value);
        }
        numbers
    }

    /// A list of finite numbers; a single number counts as a list.
    pub(crate) fn number_list(&self, key: &'static str) -> Option<Vec<f64>> {
        let value = self.raw(key)?.get_ref();
        let numbers: Option<Vec<f64>> = match value.as_array() {
            Some(array) => array.iter().map(|v| finite(v.get_ref())).collect(),
            None => finite(value).map(|number| vec![number]),
        };
        if numbers.is_none() {
            self.wrong_type(key, "a finite number or a list of them", value);
        }
        numbers
    }

    /// A list of texts.
    pub(crate) fn texts(&self, key: &'static str) -> Option<Vec<&'a str>> {
        let value = self.raw(key)?.get_ref();
        let texts: Option<Vec<&str>> = value
            .as_array()
            .and_then(|array| array.iter().map(|v| v.get_ref().as_str()).collect());
        if texts.is_none() {
            self.wrong_type(key, "a list of texts", value);
        }
        texts
    }

    /// A table within this one.
    pub(crate) fn section(&self, key: &'static str) -> Section<'a> {
        let value = self.raw(key);
        let table = value.and_then(|v| v.get_ref().as_table());
        if let (Some(value), None) = (value, table) {
            self.wrong_type(key, "a table", value.get_ref());
        }
        Section {
            source: self.source,
            path: self.name(key),
            table,
            span: value.map(|v| v.span()),
            view: self.view,
            asked: RefCell::new(Vec::new()),
        }
    }

    /// A list of tables within this one (`[[key]]`); `are_views` numbers them as views.
    pub(crate) fn sections(&self, key: &'static str, are_views: bool) -> Vec<Section<'a>> {
        let Some(value) = self.raw(key) else {
            return Vec::new();
        };
        let Some(array) = value.get_ref().as_array() else {
            self.wrong_type(key, "a list of tables", value.get_ref());
            return Vec::new();
        };
        let mut sections = Vec::new();
        for (i, item) in array.iter().enumerate() {
            let Some(table) = item.get_ref().as_table() else {
                self.wrong_type(key, "a list of tables", item.get_ref());
                continue;
            };
            sections.push(Section {
                source: self.source,
                path: self.name(key),
                table: Some(table),
                span: Some(item.span()),
                view: if are_views { Some(i) } else { self.view },
                asked: RefCell::new(Vec::new()),
            });
        }
        sections
    }

    /// Reports every key that was not asked for.
    pub(crate) fn check_unknown(&self) {
        let Some(table) = self.table else { return };
        let asked = self.asked.borrow();
        for key in table.keys() {
            let name: &str = key.get_ref();
            if asked.contains(&name) {
                continue;
            }
            let what = match nearest(name, &asked) {
                Some(known) => format!("unknown key; did you mean `{known}`?"),
                None => format!("unknown key; the known ones are {}", asked.join(", ")),
            };
            let mut fault = Error::input(what).key(self.name(name));
            if let Some(view) = self.view {
                fault = fault.view(view);
            }
            self.source
                .report(self.source.placed(fault, Some(&key.span()), None));
        }
    }
}

/// Where a key such as `lighting.sources[1].theta_deg` stands, or the last of its tables that is there.
fn span_of(table: &DeTable<'_>, key: &str) -> Option<Range<usize>> {
    let mut table = Some(table);
    let mut span = None;
    for part in key.split('.') {
        let (name, index) = match part.split_once('[') {
            Some((name, rest)) => (name, rest.trim_end_matches(']').parse::<usize>().ok()),
            None => (part, None),
        };
        let Some(value) = table.and_then(|t| t.get(name)) else {
            break;
        };
        let item = index.and_then(|i| value.get_ref().as_array()?.get(i));
        let value = item.unwrap_or(value);
        span = Some(value.span());
        table = value.get_ref().as_table();
    }
    span
}

fn finite(value: &DeValue<'_>) -> Option<f64> {
    let number = match value {
        DeValue::Float(x) => x.as_str().parse().ok()?,
        DeValue::Integer(_) => whole(value)? as f64,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

fn whole(value: &DeValue<'_>) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

fn list<const N: usize>(array: &DeArray<'_>) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = array.iter().map(|v| finite(v.get_ref())).collect();
    numbers?.try_into().ok()
}
