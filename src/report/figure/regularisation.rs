//! How the strength of the regularisation was chosen.

use super::{Figure, Panel};
use crate::pipeline::Run;
use crate::recover::lighting::RegularisationChoice;
use crate::report::number::trimmed;
use crate::report::plot::{Axis, Plot, Scale, Size, bounds, series_class};
use crate::report::table::{Cell, Table};

/// The criterion against the strength, a panel per channel; `None` if nothing was tried.
pub fn regularisation(run: &Run) -> Option<Figure> {
    let lighting = run.lighting.as_ref()?;
    let mut panels = Vec::new();
    let mut rows = Vec::new();
    let mut chosen = Vec::new();
    for (c, channel) in lighting.channels.iter().enumerate() {
        let choice = &channel.regularisation;
        if choice.curve.len() < 2 {
            continue;
        }
        chosen.push(format!("{} {}", channel.name, trimmed(choice.strength, 3)));
        panels.push(Panel {
            name: channel.name.clone(),
            markup: draw(choice, &channel.name, series_class(&channel.name, c)),
        });
        rows.extend(choice.curve.iter().map(|(strength, value)| {
            vec![
                Cell::Text(channel.name.clone()),
                Cell::Number(*strength),
                Cell::Number(*value),
            ]
        }));
    }
    let criterion = &lighting.channels.first()?.regularisation.criterion;
    let meaning = match criterion.as_str() {
        "gcv" => "generalised cross-validation: the error expected on a sample that was left out",
        "evidence" => "the marginal likelihood of the data (its negative logarithm)",
        "truncate" => "the largest frequency that is kept",
        _ => "the strength as given",
    };
    (!panels.is_empty()).then(|| Figure {
        id: "regularisation",
        title: "Choice of the regularisation",
        caption: format!(
            "Criterion: {meaning}; smaller is better. Chosen: {}. A flat curve says that the choice matters little.",
            chosen.join(", ")
        ),
        panels,
        table: Table {
            columns: ["channel", "strength", "criterion"].map(str::to_owned).to_vec(),
            rows,
            note: String::new(),
        },
        wide: false,
    })
}

fn draw(choice: &RegularisationChoice, name: &str, class: &str) -> String {
    let strengths = || choice.curve.iter().map(|(s, _)| *s);
    let values = || choice.curve.iter().map(|(_, v)| *v);
    let (low, high) = bounds(strengths().filter(|s| *s > 0.0));
    let x = if high > 30.0 * low {
        Scale::log(low, high)
    } else {
        Scale::around(strengths())
    };
    // Only differences of a criterion mean something; its own size would drown them in digits.
    let (smallest, _) = bounds(values());
    let curve: Vec<(f64, f64)> = choice
        .curve
        .iter()
        .map(|(strength, value)| (*strength, value - smallest))
        .collect();
    let y = Scale::around(curve.iter().map(|(_, v)| *v));
    let mut plot = Plot::new(
        Size::Half,
        250.0,
        Axis::new("strength", x, 5),
        Axis::new(format!("criterion − minimum ({})", choice.criterion), y, 5),
    );
    plot.line(&curve, class);
    plot.vertical(choice.strength, "chosen", "chosen", 0);
    plot.finish(
        &format!(
            "Criterion {} against the strength of the regularisation for channel {name}; the chosen strength is {}.",
            choice.criterion,
            trimmed(choice.strength, 3)
        ),
        "data-curve=\"strength\"",
    )
}
