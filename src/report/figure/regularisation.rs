//! How the strength of the regularisation was chosen.

use super::{Figure, Panel};
use crate::pipeline::Run;
use crate::recover::brdf::CurvePoint;
use crate::recover::lighting::RegularisationChoice;
use crate::report::number::trimmed;
use crate::report::plot::{Axis, Plot, Scale, Size, bounds, series_class};
use crate::report::settings::text_at;
use crate::report::table::{Cell, Table};

/// How the strength was chosen in every channel that has a choice.
fn choices(run: &Run) -> Vec<(String, RegularisationChoice)> {
    if let Some(brdf) = &run.brdf {
        let word = text_at(&run.recipe_toml, &["recovery", "regularisation"]);
        return brdf
            .channels
            .iter()
            .zip(&brdf.slices)
            .map(|(name, slice)| (name.clone(), of_slice(&slice.curve, word.as_deref())))
            .collect();
    }
    run.lighting
        .iter()
        .flat_map(|l| &l.channels)
        .map(|c| (c.name.clone(), c.regularisation.clone()))
        .collect()
}

/// The curve of a slice: its strengths are factors on those of the largest evidence.
fn of_slice(curve: &[CurvePoint], word: Option<&str>) -> RegularisationChoice {
    if word == Some("gcv") {
        let best = curve.iter().min_by(|a, b| a.gcv.total_cmp(&b.gcv));
        return RegularisationChoice {
            criterion: "gcv".to_owned(),
            strength: best.map_or(1.0, |p| p.factor),
            curve: curve.iter().map(|p| (p.factor, p.gcv)).collect(),
        };
    }
    RegularisationChoice {
        criterion: "evidence".to_owned(),
        strength: 1.0,
        curve: curve.iter().map(|p| (p.factor, -p.evidence)).collect(),
    }
}

/// The criterion against the strength, a panel per channel; `None` if nothing was tried.
pub fn regularisation(run: &Run) -> Option<Figure> {
    let choices = choices(run);
    let mut panels = Vec::new();
    let mut rows = Vec::new();
    let mut chosen = Vec::new();
    for (c, (name, choice)) in choices.iter().enumerate() {
        if choice.curve.len() < 2 {
            continue;
        }
        chosen.push(format!("{name} {}", trimmed(choice.strength, 3)));
        panels.push(Panel {
            name: name.clone(),
            markup: draw(choice, name, series_class(name, c)),
        });
        rows.extend(choice.curve.iter().map(|(strength, value)| {
            vec![
                Cell::Text(name.clone()),
                Cell::Number(*strength),
                Cell::Number(*value),
            ]
        }));
    }
    let criterion = &choices.first()?.1.criterion;
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
