//! A page of tables and figures: what reports have in common that are not of a single run.

use askama::Template;

use super::figure::Figure;
use super::plot::ColourMap;
use super::results::ResultTable;
use crate::error::{Error, Result};

/// The content of the page. Markup is made by this program from escaped text.
#[derive(Debug, Default)]
pub struct Sheet<'a> {
    /// Heading.
    pub title: &'a str,
    /// What kind of report it is.
    pub kind: &'a str,
    /// What to distrust.
    pub warnings: Vec<String>,
    /// The answer in sentences.
    pub findings: Vec<String>,
    /// Markup below the findings.
    pub answer: String,
    /// The answer in numbers.
    pub tables: Vec<ResultTable>,
    /// The evidence.
    pub figures: Vec<Figure>,
    /// Markup of the methods.
    pub methods: String,
    /// Names and texts of settings.
    pub settings: Vec<(&'a str, &'a str)>,
}

#[derive(Template)]
#[template(path = "sheet.html", config = "src/report/template/askama.toml")]
struct Page<'a> {
    title: &'a str,
    kind: &'a str,
    version: &'static str,
    style: &'static str,
    script: &'static str,
    gradients: String,
    warnings: &'a [String],
    findings: &'a [String],
    answer: &'a str,
    tables: &'a [ResultTable],
    figures: &'a [Figure],
    methods: &'a str,
    settings: &'a [(&'a str, &'a str)],
}

impl Sheet<'_> {
    /// One HTML page without any reference to the network.
    ///
    /// # Errors
    /// If the page cannot be put together.
    pub fn page(&self) -> Result<String> {
        let page = Page {
            title: self.title,
            kind: self.kind,
            version: env!("CARGO_PKG_VERSION"),
            style: include_str!("template/style.css"),
            script: super::SCRIPT,
            gradients: ColourMap::gradients(),
            warnings: &self.warnings,
            findings: &self.findings,
            answer: &self.answer,
            tables: &self.tables,
            figures: &self.figures,
            methods: &self.methods,
            settings: &self.settings,
        };
        page.render()
            .map_err(|e| Error::failed(format!("cannot write the report: {e}")))
    }
}
