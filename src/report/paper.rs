//! The page of `flatlight paper`: what \[RH01\] states, equation by equation, beside what comes out here;
//! and the same as a table.

use std::fmt::Write as _;

use askama::Template;

use super::equation::display;
use super::figure::{Figure, Panel};
use super::number::{short, trimmed};
use super::plot::{Axis, ColourMap, Legend, Mark, Plot, Scale, Size, bounds, html_text};
use super::table::{Cell, Table, write_csv_text};
use crate::error::{Error, Result};
use crate::validate::paper::{self, Check, Paper, SECTIONS, STATEMENTS, Statement};

/// The page as the template takes it.
#[derive(Template)]
#[template(path = "paper.html", config = "src/report/template/askama.toml")]
struct Page {
    version: &'static str,
    style: &'static str,
    own_style: &'static str,
    script: &'static str,
    gradients: String,
    passed: usize,
    all: usize,
    failed: Vec<String>,
    misprints: Vec<Misprint>,
    sections: Vec<Section>,
}

/// A misprint of the paper and the equation that it is in.
struct Misprint {
    anchor: String,
    name: String,
    text: String,
}

/// Statements under one heading, and their plots.
struct Section {
    anchor: String,
    title: &'static str,
    statements: Vec<Block>,
    figures: Vec<Figure>,
}

/// One statement and its checks.
struct Block {
    anchor: String,
    name: String,
    title: &'static str,
    passed: bool,
    equation: String,
    rows: Vec<Row>,
}

/// One check in words and formatted numbers.
struct Row {
    claim: String,
    note: String,
    closed_form: String,
    ours: String,
    difference: String,
    tolerance: String,
    passed: bool,
}

/// The page of a recomputed paper, self-contained.
///
/// # Errors
/// If an equation cannot be set.
pub fn page(paper: &Paper) -> Result<String> {
    let starts: Vec<usize> = SECTIONS.iter().map(|(_, first)| place(first)).collect();
    let mut sections = Vec::new();
    for (k, (title, first)) in SECTIONS.iter().enumerate() {
        let end = starts.get(k + 1).copied().unwrap_or(STATEMENTS.len());
        let stated = STATEMENTS.get(starts[k]..end).unwrap_or_default();
        let statements = stated.iter().map(|s| block(s, paper));
        let belongs = |p: &&paper::Plot| stated.iter().any(|s| s.equation == p.equation);
        sections.push(Section {
            anchor: format!("section-{}", anchor(first)),
            title,
            statements: statements.collect::<Result<_>>()?,
            figures: paper.plots.iter().filter(belongs).map(figure).collect(),
        });
    }
    let failed = paper.checks.iter().filter(|c| !c.passed);
    let misprint = |c: &Check| {
        let text = c.note.strip_prefix("misprint")?;
        let text = text.trim_start_matches([';', ' ']);
        Some(Misprint {
            anchor: anchor(c.equation),
            name: name(c.equation),
            text: markup(&format!("{} ({text}).", c.claim)),
        })
    };
    let page = Page {
        version: env!("CARGO_PKG_VERSION"),
        style: include_str!("template/style.css"),
        own_style: include_str!("template/paper.css"),
        script: super::SCRIPT,
        gradients: ColourMap::gradients(),
        passed: paper.checks.iter().filter(|c| c.passed).count(),
        all: paper.checks.len(),
        failed: failed
            .map(|c| format!("{}: {}", name(c.equation), c.claim))
            .collect(),
        misprints: paper.checks.iter().filter_map(misprint).collect(),
        sections,
    };
    page.render()
        .map_err(|e| Error::failed(format!("cannot write the page: {e}")))
}

/// All checks as CSV with the columns `equation,claim,closed_form,ours,difference,tolerance,passed,note`.
pub fn csv(paper: &Paper) -> String {
    let mut out =
        String::from("equation,claim,closed_form,ours,difference,tolerance,passed,note\n");
    for check in &paper.checks {
        write_csv_text(check.equation, &mut out);
        out.push(',');
        write_csv_text(&check.claim, &mut out);
        for value in [
            check.closed_form,
            check.ours,
            check.difference,
            check.tolerance,
        ] {
            out.push(',');
            if value.is_finite() {
                let _ = write!(out, "{value:e}");
            }
        }
        let _ = write!(out, ",{},", check.passed);
        write_csv_text(&check.note, &mut out);
        out.push('\n');
    }
    out
}

/// Where a statement stands.
fn place(equation: &str) -> usize {
    let mut all = STATEMENTS.iter();
    all.position(|s| s.equation == equation).unwrap_or(0)
}

/// A name for links: letters, digits and hyphens only.
fn anchor(equation: &str) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
    format!("eq-{}", equation.chars().map(safe).collect::<String>())
}

fn name(equation: &str) -> String {
    match equation.chars().next() {
        Some('0'..='9') if equation.contains('–') => format!("Equations {equation}"),
        Some('0'..='9') => format!("Equation {equation}"),
        Some('§') => format!("Section {}", equation.trim_start_matches('§')),
        _ => {
            let mut letters = equation.chars();
            let first = letters.next().map(|c| c.to_uppercase().to_string());
            first.unwrap_or_default() + letters.as_str()
        }
    }
}

fn block(statement: &Statement, paper: &Paper) -> Result<Block> {
    let checks: Vec<&Check> = paper
        .checks
        .iter()
        .filter(|c| c.equation == statement.equation)
        .collect();
    Ok(Block {
        anchor: anchor(statement.equation),
        name: name(statement.equation),
        title: statement.title,
        passed: !checks.is_empty() && checks.iter().all(|c| c.passed),
        equation: display(statement.latex)?,
        rows: checks.into_iter().map(row).collect(),
    })
}

fn row(check: &Check) -> Row {
    Row {
        claim: markup(&check.claim),
        note: markup(&check.note),
        closed_form: trimmed(check.closed_form, 10),
        ours: trimmed(check.ours, 10),
        difference: short(check.difference, 2),
        tolerance: short(check.tolerance, 2),
        passed: check.passed,
    }
}

/// A claim with its indices and exponents set.
fn markup(text: &str) -> String {
    let html = html_text(&symbols(text));
    let mut out = String::with_capacity(html.len());
    let mut rest = html.as_str();
    while let Some((before, after)) = rest.split_once("^{") {
        let Some((inside, behind)) = after.split_once('}') else {
            break;
        };
        let _ = write!(out, "{before}<sup>{inside}</sup>");
        rest = behind;
    }
    out + rest
}

/// Plain-text indices set as such: `L_p`, `ρ̂_{p,q}` and `θo′` in the notation of the kit, `_[…]`.
fn symbols(text: &str) -> String {
    let text = text.replace("θi", "θ_i").replace("θo", "θ_o");
    let text = text.as_str();
    let mut out = String::with_capacity(text.len() + 16);
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('_') {
        out += before;
        if let Some((inside, behind)) = after.strip_prefix('{').and_then(|a| a.split_once('}')) {
            let _ = write!(out, "_[{inside}]");
            rest = behind;
            continue;
        }
        // An index without braces is one letter, or digits.
        let digits = after.chars().take_while(char::is_ascii_digit).count();
        let length = match digits {
            0 => after.chars().next().map_or(0, char::len_utf8),
            n => n,
        };
        let (inside, behind) = after.split_at(length);
        let _ = write!(out, "_[{inside}]");
        rest = behind;
    }
    out + rest
}

const CLASSES: [&str; 6] = ["s-a", "s-b", "s-c", "s-d", "s-e", "s-f"];

/// A plot's classes: discs share the class of the line before them if there are as many of both, so that
/// what belongs together has one colour.
fn classes(plot: &paper::Plot) -> Vec<&'static str> {
    let discs = plot.curves.iter().filter(|c| c.discs).count();
    let in_pairs = discs > 1 && 2 * discs == plot.curves.len();
    let class = |k: usize| CLASSES[(if in_pairs { k / 2 } else { k }) % CLASSES.len()];
    (0..plot.curves.len()).map(class).collect()
}

/// A plot as a figure of the report.
fn figure(plot: &paper::Plot) -> Figure {
    let values = |pick: fn(&(f64, f64)) -> f64| {
        let points = plot.curves.iter().flat_map(|c| &c.points);
        points.map(pick).collect::<Vec<f64>>()
    };
    let (x, y) = (values(|p| p.0), values(|p| p.1));
    let x = match plot.logarithmic[0] {
        true => Axis::new(plot.x, Scale::log_around(x, 12.0), 6),
        false => {
            let (low, high) = bounds(x);
            if plot.x.contains("degrees") {
                Axis::degrees(plot.x, low, high, 60.0)
            } else {
                Axis::whole(plot.x, low, high, 7)
            }
        }
    };
    let y = match plot.logarithmic[1] {
        true => Scale::log_around(y, 18.0),
        false => Scale::around(y),
    };
    let classes = classes(plot);
    let legend = plot
        .curves
        .iter()
        .zip(&classes)
        .map(|(curve, class)| Legend {
            class: (*class).to_owned(),
            mark: if curve.discs { Mark::Disc } else { Mark::Line },
            label: curve.name.clone(),
        });
    let mut drawing = Plot::new(Size::Half, 280.0, x, Axis::new(plot.y, y, 6)).with_legend(
        if plot.curves.len() > 1 {
            legend.collect()
        } else {
            Vec::new()
        },
    );
    for (curve, class) in plot.curves.iter().zip(&classes) {
        if curve.discs {
            for &(x, y) in &curve.points {
                drawing.point(x, y, Mark::Disc, class);
            }
        } else {
            drawing.line(&curve.points, class);
        }
    }
    let table = table(plot);
    let data = format!("data-curve=\"{}\"", table.columns[0]);
    let markup = drawing.finish(&format!("{}. {}", plot.title, plot.caption), &data);
    Figure {
        id: plot.id,
        title: plot.title,
        caption: plot.caption.clone(),
        panels: vec![Panel {
            name: String::new(),
            markup,
        }],
        table,
        wide: false,
    }
}

/// All curves over the union of their x; empty where a curve has no point.
fn table(plot: &paper::Plot) -> Table {
    let mut all: Vec<f64> = plot
        .curves
        .iter()
        .flat_map(|c| c.points.iter().map(|p| p.0))
        .collect();
    all.sort_by(f64::total_cmp);
    all.dedup();
    let columns = std::iter::once("x".to_owned()).chain(plot.curves.iter().map(|c| c.name.clone()));
    let row = |x: &f64| {
        let values = plot.curves.iter().map(|c| {
            let point = c.points.iter().find(|p| p.0 == *x);
            Cell::Number(point.map_or(f64::NAN, |p| p.1))
        });
        std::iter::once(Cell::Number(*x)).chain(values).collect()
    };
    Table {
        columns: columns.collect(),
        rows: all.iter().map(row).collect(),
        note: format!("x: {}.", plot.x),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_in_words_become_subscripts() {
        let cases = [
            (
                "B_p(θo′) = 2π L_p ρ̂_{−p}",
                "B_[p](θ_[o]′) = 2π L_[p] ρ̂_[−p]",
            ),
            ("L_12 + x", "L_[12] + x"),
            ("no index", "no index"),
            ("at the end_", "at the end_[]"),
        ];
        for (plain, set) in cases {
            assert_eq!(symbols(plain), set);
        }
        assert_eq!(
            markup("e^{ipθ} < L_p^{2"),
            "e<sup>ipθ</sup> &lt; L<sub>p</sub>^{2"
        );
        assert_eq!(name("7–10"), "Equations 7–10");
        assert_eq!(anchor("§5.3"), "eq--5-3");
    }

    #[test]
    fn every_equation_can_be_set() -> Result<()> {
        for statement in &STATEMENTS {
            let mathml = display(statement.latex)?;
            assert!(mathml.starts_with("<math"), "{}", statement.equation);
        }
        Ok(())
    }

    #[test]
    fn a_failed_check_is_said_at_the_top_and_in_its_place() -> Result<()> {
        let check = |equation, passed| Check {
            equation,
            claim: "B_p < 1 & more".into(),
            closed_form: 1.0,
            ours: f64::NAN,
            difference: f64::NAN,
            tolerance: 1e-10,
            passed,
            note: "a, \"b\"".into(),
        };
        let paper = Paper {
            checks: vec![check("1", true), check("2", false)],
            plots: Vec::new(),
        };
        let page = page(&paper)?;
        assert!(page.contains("1 of 2 checks"), "{page}");
        assert!(page.contains("Equation 2: B_p &#60; 1 &#38; more"));
        assert!(page.contains("B<sub>p</sub> &lt; 1 &amp; more"));
        assert_eq!(
            csv(&paper).lines().nth(2),
            Some("2,B_p < 1 & more,1e0,,,1e-10,false,\"a, \"\"b\"\"\"")
        );
        Ok(())
    }
}
