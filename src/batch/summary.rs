//! The summary table of a batch: one row per set.

use super::{ChannelFound, Found, Outcome};
use crate::pipeline::Verdict;

/// The table as CSV: a row per set in the order given, a missing value an empty field.
///
/// `set,status,error,capture,recover,views,warnings,verdict,sources,source_deg,source_sigma_deg` (of the strongest source), then for each channel X
/// that any set has `coverage_X,residual_relative_X,unexplained_X,determined_band_X,total_irradiance_X,sigma_total_irradiance_X,brdf_determined_X,model_X`. `status` is `done` or `failed`.
pub fn csv(outcomes: &[Outcome]) -> String {
    let mut channels: Vec<&str> = Vec::new();
    for found in outcomes.iter().filter_map(|o| o.found.as_ref().ok()) {
        for channel in &found.channels {
            if !channels.contains(&channel.name.as_str()) {
                channels.push(&channel.name);
            }
        }
    }
    let mut head: Vec<String> = FIXED.map(str::to_owned).to_vec();
    for name in &channels {
        head.extend(PER_CHANNEL.map(|column| format!("{column}_{name}")));
    }
    let mut text = row(&head);
    for outcome in outcomes {
        let mut cells = vec![outcome.name.clone()];
        match &outcome.found {
            Err(why) => {
                cells.extend(["failed".into(), one_line(why)]);
                cells.resize(head.len(), String::new());
            }
            Ok(found) => {
                cells.extend(["done".into(), String::new()]);
                cells.extend(fixed(found));
                for name in &channels {
                    let channel = found.channels.iter().find(|c| c.name == *name);
                    cells.extend(channel.map_or_else(Default::default, per_channel));
                }
            }
        }
        text += &row(&cells);
    }
    text
}

const FIXED: [&str; 11] = [
    "set",
    "status",
    "error",
    "capture",
    "recover",
    "views",
    "warnings",
    "verdict",
    "sources",
    "source_deg",
    "source_sigma_deg",
];

fn fixed(found: &Found) -> [String; 8] {
    let strongest = found.sources.first();
    [
        found.capture.clone(),
        found.recover.clone(),
        found.views.to_string(),
        found.warnings.len().to_string(),
        found.verdict().map_or("", verdict).to_owned(),
        match found.recover.as_str() {
            "lighting" | "both" => found.sources.len().to_string(),
            _ => String::new(),
        },
        number(strongest.map(|s| s.theta_deg)),
        number(strongest.map(|s| s.theta_sigma_deg)),
    ]
}

const PER_CHANNEL: [&str; 8] = [
    "coverage",
    "residual_relative",
    "unexplained",
    "determined_band",
    "total_irradiance",
    "sigma_total_irradiance",
    "brdf_determined",
    "model",
];

fn per_channel(channel: &ChannelFound) -> [String; 8] {
    [
        number(Some(channel.coverage)),
        number(channel.residual_relative),
        number(channel.unexplained),
        channel
            .determined_band
            .map_or_else(String::new, |b| b.to_string()),
        number(channel.total_irradiance.map(|t| t.0)),
        number(channel.total_irradiance.map(|t| t.1)),
        number(channel.brdf_determined),
        channel.model.clone().unwrap_or_default(),
    ]
}

/// The verdict in the word of `summary.json`.
fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Explained => "explained",
        Verdict::Doubtful => "doubtful",
        Verdict::Refused => "refused",
    }
}

fn number(value: Option<f64>) -> String {
    value
        .filter(|v| v.is_finite())
        .map_or_else(String::new, |v| format!("{v:?}"))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn row(cells: &[String]) -> String {
    let quoted = |cell: &String| {
        if cell.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", cell.replace('"', "\"\""))
        } else {
            cell.clone()
        }
    };
    let mut line = cells.iter().map(quoted).collect::<Vec<_>>().join(",");
    line.push('\n');
    line
}
