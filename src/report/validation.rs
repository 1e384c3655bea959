//! The page of a validation: errors, ratios to the bound, coverage.

use super::figure::{Figure, Panel};
use super::number::{percent, short};
use super::plot::{Axis, Legend, Mark, Plot, Scale, Size};
use super::results::ResultTable;
use super::sheet::Sheet;
use super::table::{Cell as Value, Table};
use crate::error::Result;
use crate::validate::study::{Cell, Outcome, Quantity, Recovered};

type Row = (Cell, Outcome);

/// What is judged of which recovery.
type Kind = (Recovered, Quantity);

const ALL: [Kind; 4] = [
    (Recovered::Lighting, Quantity::Lighting),
    (Recovered::Brdf, Quantity::Brdf),
    (Recovered::Both, Quantity::Lighting),
    (Recovered::Both, Quantity::Brdf),
];
/// What 95 % intervals of determined quantities are to cover.
const COVERED: std::ops::RangeInclusive<f64> = 0.93..=0.97;
/// Bound from which on nothing is promised of the recovery of both.
const BOUND_OF_BOTH: f64 = 0.05;

/// The report of a validation as one HTML page without any reference to the network.
///
/// # Errors
/// If the page cannot be put together.
pub fn validation(title: &str, recipe: &str, cells: &[(Cell, Outcome)]) -> Result<String> {
    Sheet {
        title,
        kind: "Errors of synthetic recoveries against the Cramér–Rao bound",
        warnings: cells.iter().filter_map(failure).collect(),
        findings: ALL.iter().filter_map(|k| finding(*k, cells)).collect(),
        tables: ALL.iter().filter_map(|k| table(*k, cells)).collect(),
        figures: vec![
            error_and_bound(cells),
            against_noise(
                cells,
                "ratio",
                "Ratio of error to bound",
                "1 is the bound. Below it a prior that is right has helped; above it something is lost.",
                |o| o.ratio(),
            ),
            against_noise(
                cells,
                "coverage",
                "Coverage of the 95 % intervals",
                "Share of the determined quantities whose truth lies within ±1.96 σ; 0.95 is right.",
                |o| o.coverage,
            ),
        ],
        methods: include_str!("template/validation_methods.html").to_owned(),
        settings: vec![("recipe.toml", recipe)],
        ..Sheet::default()
    }
    .page()
}

fn kind((cell, outcome): &Row) -> Kind {
    (cell.recovered, outcome.quantity)
}

fn of(wanted: Kind, cells: &[Row]) -> impl Iterator<Item = &Row> {
    cells.iter().filter(move |row| kind(row) == wanted)
}

/// What a person calls it.
fn word((recovered, quantity): Kind) -> String {
    match recovered {
        Recovered::Both => format!("both, {}", quantity.word()),
        _ => recovered.word().to_owned(),
    }
}

/// Draws that failed, said once for all that is judged of them.
fn failure((cell, outcome): &Row) -> Option<String> {
    let first = cell.recovered.quantities().first();
    let why = outcome
        .failure
        .as_ref()
        .filter(|_| first == Some(&outcome.quantity))?;
    Some(format!(
        "{}: {} of {} draws failed. {why}",
        cell.label(),
        outcome.failed,
        cell.draws
    ))
}

/// How many cells keep what is promised, and which not.
fn finding(kind: Kind, cells: &[Row]) -> Option<String> {
    let (recovered, _) = kind;
    let judged: Vec<&Row> = of(kind, cells)
        .filter(|(_, o)| o.ratio().is_some())
        .filter(|(_, o)| recovered != Recovered::Both || o.bound.is_some_and(|b| b < BOUND_OF_BOTH))
        .collect();
    if judged.is_empty() {
        return None;
    }
    let promised = recovered.promised_ratio();
    let over: Vec<String> = judged
        .iter()
        .filter(|(_, o)| o.ratio().is_some_and(|r| r > promised))
        .map(|(c, o)| {
            format!(
                "{} {} {} % ({})",
                c.brdf,
                c.lighting,
                100.0 * c.noise,
                o.ratio().map_or(String::new(), |r| short(r, 3))
            )
        })
        .collect();
    let outside = judged
        .iter()
        .filter(|(_, o)| o.coverage.is_some_and(|c| !COVERED.contains(&c)))
        .count();
    let mut text = format!(
        "{}: {} of {} cells are within {promised} times the bound; coverage is outside 93–97 % in {outside}.",
        word(kind),
        judged.len() - over.len(),
        judged.len()
    );
    if !over.is_empty() {
        text += &format!(" Above: {}.", over.join(", "));
    }
    Some(text)
}

fn table(kind: Kind, cells: &[Row]) -> Option<ResultTable> {
    let share = |v: Option<f64>| v.map_or("—".to_owned(), percent);
    let rows: Vec<Vec<String>> = of(kind, cells)
        .map(|(c, o)| {
            vec![
                c.study.clone(),
                c.brdf.clone(),
                c.lighting.clone(),
                percent(c.noise),
                c.views.to_string(),
                o.band.map_or("none".to_owned(), |p| format!("p ≤ {p}")),
                o.quantities.to_string(),
                share(o.rmse),
                share(o.bias),
                share(o.bound),
                o.ratio().map_or("—".to_owned(), |r| short(r, 3)),
                o.each.map_or("—".to_owned(), |r| short(r, 3)),
                share(o.coverage),
                o.draws.to_string(),
            ]
        })
        .collect();
    (!rows.is_empty()).then(|| ResultTable {
        title: match kind {
            (Recovered::Lighting, _) => "Lighting from a known BRDF",
            (Recovered::Brdf, _) => "BRDF from known lighting",
            (Recovered::Both, Quantity::Lighting) => "Lighting where both are recovered",
            (Recovered::Both, Quantity::Brdf) => "BRDF where both are recovered",
        }
        .to_owned(),
        columns: [
            "study",
            "brdf",
            "lighting",
            "noise",
            "views",
            "band",
            "values",
            "error",
            "bias",
            "bound",
            "ratio",
            "value by value",
            "coverage",
            "draws",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows,
    })
}

fn class(kind: Kind) -> (&'static str, Mark) {
    match kind {
        (Recovered::Lighting, _) => ("s-a", Mark::Disc),
        (Recovered::Brdf, _) => ("s-b", Mark::Ring),
        (Recovered::Both, Quantity::Lighting) => ("s-c", Mark::Cross),
        (Recovered::Both, Quantity::Brdf) => ("s-d", Mark::Disc),
    }
}

fn legend() -> Vec<Legend> {
    ALL.iter()
        .map(|&kind| {
            let (class, mark) = class(kind);
            Legend {
                class: class.to_owned(),
                mark,
                label: word(kind),
            }
        })
        .collect()
}

fn data(cells: &[Row]) -> Table {
    let number = |v: Option<f64>| Value::Number(v.unwrap_or(f64::NAN));
    Table {
        columns: [
            "study",
            "recovered",
            "quantity",
            "brdf",
            "lighting",
            "noise",
            "views",
            "rmse",
            "bias",
            "bound",
            "ratio",
            "coverage",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows: cells
            .iter()
            .map(|(c, o)| {
                vec![
                    Value::Text(c.study.clone()),
                    Value::Text(c.recovered.word().to_owned()),
                    Value::Text(o.quantity.word().to_owned()),
                    Value::Text(c.brdf.clone()),
                    Value::Text(c.lighting.clone()),
                    Value::Number(c.noise),
                    Value::Fixed(c.views as f64, 0),
                    number(o.rmse),
                    number(o.bias),
                    number(o.bound),
                    number(o.ratio()),
                    number(o.coverage),
                ]
            })
            .collect(),
        note: "The files validation.csv and validation_slices.csv (BRDF where both are recovered) have the values at full precision.".to_owned(),
    }
}

/// Error against bound, a mark per cell.
fn error_and_bound(cells: &[Row]) -> Figure {
    let values = cells.iter().flat_map(|(_, o)| [o.rmse, o.bound]).flatten();
    let scale = Scale::log_around(values, 6.0);
    let draw = |size: Size| {
        let mut plot = Plot::new(
            size,
            320.0,
            Axis::new("Cramér–Rao bound / norm of the truth", scale, 6),
            Axis::new("error / norm of the truth", scale, 6),
        )
        .with_legend(legend());
        plot.line(
            &[(scale.low(), scale.low()), (scale.high(), scale.high())],
            "bound",
        );
        for row in cells {
            if let (Some(error), Some(bound)) = (row.1.rmse, row.1.bound) {
                let (class, mark) = class(kind(row));
                plot.point(bound, error, mark, class);
            }
        }
        plot.finish(
            "Error of every cell against its bound, both logarithmic, with the line on which they are equal.",
            "",
        )
    };
    Figure {
        id: "error-and-bound",
        title: "Error and bound",
        caption: "Root mean square error of each cell against its Cramér–Rao bound. On the dotted line they are equal: no unbiased \
                  method without a prior can be below it."
            .to_owned(),
        panels: vec![Panel {
            name: "all".to_owned(),
            markup: [Size::Wide, Size::Narrow].map(draw).concat(),
        }],
        table: data(cells),
        wide: true,
    }
}

/// A quantity of every cell against its noise.
fn against_noise(
    cells: &[Row],
    id: &'static str,
    title: &'static str,
    caption: &str,
    quantity: impl Fn(&Outcome) -> Option<f64>,
) -> Figure {
    let noise = Scale::log_around(cells.iter().map(|(c, _)| c.noise), 8.0);
    let values = || cells.iter().filter_map(|(_, o)| quantity(o));
    let y = Scale::around(values().chain([0.9, 1.0]));
    let mut plot = Plot::new(
        Size::Half,
        260.0,
        Axis::new("noise / largest value", noise, 5),
        Axis::new(id, y, 5),
    )
    .with_legend(legend());
    for row in cells {
        if let Some(value) = quantity(&row.1) {
            let (class, mark) = class(kind(row));
            plot.point(row.0.noise, value, mark, class);
        }
    }
    Figure {
        id,
        title,
        caption: caption.to_owned(),
        panels: vec![Panel {
            name: "all".to_owned(),
            markup: plot.finish(&format!("{title} of every cell against its noise."), ""),
        }],
        table: data(cells),
        wide: false,
    }
}
