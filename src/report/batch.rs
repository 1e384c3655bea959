//! The page of a batch: which sets gave a result, a table that sorts, and a small plot of each.

use std::fmt::Write as _;

use super::number::{percent, short, with_sigma};
use super::plot::{Scale, coordinate, escape, path_data, series_class};
use super::sheet::Sheet;
use super::table::data_uri;
use crate::batch::{ChannelFound, Found, Outcome, csv};
use crate::error::Result;
use crate::pipeline::Verdict;

/// Most sets that get a small plot: about 5 kB each.
const PLOTTED: usize = 300;
/// Width and height of a small plot's area.
const SMALL: [f64; 2] = [220.0, 90.0];
/// How far the sets' largest values may lie apart for one scale to serve all.
const COMMON_SCALE: f64 = 8.0;

/// The report of a batch as one HTML page without any reference to the network; each set's name leads to
/// its own report beside it.
///
/// # Errors
/// If the page cannot be put together.
pub fn batch(title: &str, recipe: &str, outcomes: &[Outcome]) -> Result<String> {
    let done: Vec<(&str, &Found)> = outcomes
        .iter()
        .filter_map(|o| o.found.as_ref().ok().map(|f| (o.name.as_str(), f)))
        .collect();
    Sheet {
        title,
        kind: "One recipe on many capture sets",
        findings: findings(outcomes, &done),
        answer: failures(outcomes) + &table(outcomes) + &small_multiples(&done),
        settings: vec![("recipe.toml", recipe)],
        ..Sheet::default()
    }
    .page()
}

fn findings(outcomes: &[Outcome], done: &[(&str, &Found)]) -> Vec<String> {
    let failed = outcomes.len() - done.len();
    let mut findings = vec![format!(
        "{} of {} sets gave a result{}.",
        done.len(),
        outcomes.len(),
        match failed {
            0 => String::new(),
            1 => "; one failed, and says why below".to_owned(),
            n => format!("; {n} failed, and say why below"),
        }
    )];
    for (verdict, words) in [
        (
            Verdict::Refused,
            "is no measurement: the recovery does not explain the photographs",
        ),
        (
            Verdict::Doubtful,
            "is doubtful: there are errors that the error bars do not hold",
        ),
    ] {
        let names: Vec<&str> = done
            .iter()
            .filter(|(_, f)| f.verdict() == Some(verdict))
            .map(|(name, _)| *name)
            .collect();
        if !names.is_empty() {
            findings.push(format!("{}: the result {words}.", names.join(", ")));
        }
    }
    findings
}

fn failures(outcomes: &[Outcome]) -> String {
    let mut out = String::new();
    for outcome in outcomes {
        if let Err(why) = &outcome.found {
            let _ = write!(
                out,
                "<p class=\"warning failure\"><strong>{}.</strong> {}</p>",
                escape(&outcome.name),
                escape(why).replace('\n', "<br>")
            );
        }
    }
    out
}

/// A cell: what is shown, and what the column is sorted by.
struct Cell {
    markup: String,
    key: String,
}

impl Cell {
    fn words(text: &str) -> Self {
        Self {
            markup: escape(text),
            key: text.to_lowercase(),
        }
    }

    fn number(value: Option<f64>, shown: impl Fn(f64) -> String) -> Self {
        value.filter(|v| v.is_finite()).map_or_else(
            || Self {
                markup: "—".to_owned(),
                key: String::new(),
            },
            |v| Self {
                markup: escape(&shown(v)),
                key: format!("{v:e}"),
            },
        )
    }
}

type Column = (&'static str, fn(&Found) -> Cell);

/// Largest of the channels' values.
fn worst(found: &Found, value: fn(&ChannelFound) -> Option<f64>) -> Option<f64> {
    found.channels.iter().filter_map(value).reduce(f64::max)
}

const COLUMNS: [Column; 9] = [
    ("views", |f| {
        Cell::number(Some(f.views as f64), |v| format!("{v:.0}"))
    }),
    ("coverage", |f| {
        let least = worst(f, |c| Some(-c.coverage)).map(|v| -v);
        Cell::number(least, percent)
    }),
    ("verdict", |f| match f.verdict() {
        Some(Verdict::Explained) => Cell::words("explained"),
        Some(Verdict::Doubtful) => Cell::words("doubtful"),
        Some(Verdict::Refused) => Cell::words("refused"),
        None => Cell::number(None, percent),
    }),
    ("residual", |f| {
        Cell::number(worst(f, |c| c.residual_relative), percent)
    }),
    ("unexplained", |f| {
        Cell::number(worst(f, |c| c.unexplained), percent)
    }),
    ("light determined to p", |f| {
        let least = worst(f, |c| c.determined_band.map(|b| -(b as f64)));
        Cell::number(least.map(|v| -v), |v| format!("{v:.0}"))
    }),
    ("strongest source", |f| {
        let source = f.sources.first();
        Cell::number(source.map(|s| s.theta_deg), |v| {
            let sigma = source.map_or(f64::NAN, |s| s.theta_sigma_deg);
            format!("{}°", with_sigma(v, sigma))
        })
    }),
    ("BRDF determined", |f| {
        let least = worst(f, |c| c.brdf_determined.map(|b| -b));
        Cell::number(least.map(|v| -v), percent)
    }),
    ("warnings", |f| {
        Cell::number(Some(f.warnings.len() as f64), |v| format!("{v:.0}"))
    }),
];

fn table(outcomes: &[Outcome]) -> String {
    let done: Vec<&Found> = outcomes
        .iter()
        .filter_map(|o| o.found.as_ref().ok())
        .collect();
    let columns: Vec<&Column> = COLUMNS
        .iter()
        .filter(|(_, cell)| done.iter().any(|f| !cell(f).key.is_empty()))
        .collect();
    let names: Vec<&str> = done
        .first()
        .map_or_else(Vec::new, |f| f.channels.iter().map(|c| &*c.name).collect());
    let has_light = done
        .iter()
        .any(|f| worst(f, |c| c.total_irradiance.map(|t| t.0)).is_some());
    let has_model = done
        .iter()
        .any(|f| f.channels.iter().any(|c| c.model.is_some()));
    let mut head: Vec<String> = vec!["set".into(), "result".into()];
    head.extend(columns.iter().map(|(name, _)| (*name).to_owned()));
    if has_light {
        head.extend(names.iter().map(|n| format!("∫L dθ {n}")));
    }
    if has_model {
        head.push("best model".into());
    }
    let mut out = format!(
        "<p><a class=\"csv\" download=\"summary.csv\" href=\"{}\">All values of all sets as CSV</a>. Residual: root mean square over the largest radiance. \
         Residual and unexplained share of the worst channel, coverage and determined share of the least.</p>\
         <div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"Results of all sets\"><table class=\"results sortable\"><caption>Results of all sets</caption><thead><tr>",
        data_uri(&csv(outcomes))
    );
    for name in &head {
        let _ = write!(out, "<th scope=\"col\">{}</th>", escape(name));
    }
    out += "</tr></thead><tbody>";
    for outcome in outcomes {
        let mut cells = Vec::new();
        match &outcome.found {
            Err(_) => {
                cells.push(Cell::words("failed"));
                cells.resize_with(head.len() - 1, || Cell::number(None, percent));
            }
            Ok(found) => {
                cells.push(Cell::words("done"));
                cells.extend(columns.iter().map(|(_, cell)| cell(found)));
                if has_light {
                    cells.extend(names.iter().map(|n| {
                        let total = found
                            .channels
                            .iter()
                            .find(|c| c.name == *n)
                            .and_then(|c| c.total_irradiance);
                        Cell::number(total.map(|t| t.0), |v| {
                            with_sigma(v, total.map_or(f64::NAN, |t| t.1))
                        })
                    }));
                }
                if has_model {
                    let model = found.channels.first().and_then(|c| c.model.as_deref());
                    cells.push(Cell::words(model.unwrap_or("—")));
                }
            }
        }
        let name = escape(&outcome.name);
        let heading = match &outcome.found {
            Ok(_) => format!("<a href=\"{}/report.html\">{name}</a>", link(&outcome.name)),
            Err(_) => name,
        };
        let _ = write!(
            out,
            "<tr><th scope=\"row\" data-key=\"{}\">{heading}</th>",
            escape(&outcome.name.to_lowercase())
        );
        for cell in cells {
            let _ = write!(
                out,
                "<td data-key=\"{}\">{}</td>",
                escape(&cell.key),
                cell.markup
            );
        }
        out += "</tr>";
    }
    out + "</tbody></table></div>"
}

/// A path relative to the page as the value of `href`.
fn link(name: &str) -> String {
    let mut out = String::from("./");
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~/".contains(&byte) {
            out.push(char::from(byte));
        } else {
            let _ = write!(out, "%{byte:02X}");
        }
    }
    out
}

/// What the curves show: quantity with unit, and the axis.
fn quantity(found: &Found) -> (String, &'static str, [f64; 2]) {
    let unit = if found.radiance_unit.starts_with('W') {
        ("W m⁻² rad⁻¹", "W m⁻² sr⁻¹")
    } else {
        ("relative", "relative")
    };
    match found.recover.as_str() {
        "lighting" => (
            format!("L / {}, without the sources, which are marked", unit.0),
            "θ",
            [-180.0, 180.0],
        ),
        "brdf" | "both" => (
            "ρ cos θi′ cos θo′ / sr⁻¹ at θi′ = −30°".to_owned(),
            "θo′",
            [-90.0, 90.0],
        ),
        _ => (
            format!("mean over θo′ of B / {}", unit.1),
            "α",
            [-180.0, 180.0],
        ),
    }
}

fn largest(found: &Found) -> f64 {
    found
        .channels
        .iter()
        .flat_map(|c| &c.curve.values)
        .copied()
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max)
}

fn small_multiples(done: &[(&str, &Found)]) -> String {
    let Some((_, first)) = done.first() else {
        return String::new();
    };
    let (what, axis, _) = quantity(first);
    let tops: Vec<f64> = done
        .iter()
        .map(|(_, f)| largest(f))
        .filter(|t| *t > 0.0)
        .collect();
    let top = tops.iter().copied().fold(0.0, f64::max);
    let low = tops.iter().copied().fold(f64::INFINITY, f64::min);
    let common = top <= COMMON_SCALE * low;
    let mut out = format!(
        "<h3 id=\"small-multiples\">Every set</h3><p>{what}, against {axis} in degrees, a curve per channel. {}{}</p><div class=\"multiples\">",
        if common {
            "All plots have the same scale.".to_owned()
        } else {
            format!(
                "Each plot has its own scale, the largest values lie a factor {} apart.",
                short(top / low, 2)
            )
        },
        if done.len() > PLOTTED {
            format!(" The first {PLOTTED} sets are shown.")
        } else {
            String::new()
        }
    );
    for (name, found) in done.iter().take(PLOTTED) {
        let top = if common { top } else { largest(found) };
        let _ = write!(
            out,
            "<a class=\"multiple\" href=\"{}/report.html\"><span>{}</span><small>up to {}</small>{}</a>",
            link(name),
            escape(name),
            escape(&short(largest(found), 3)),
            small(name, found, if top > 0.0 { 1.05 * top } else { 1.0 })
        );
    }
    out + "</div>"
}

fn small(name: &str, found: &Found, top: f64) -> String {
    let [width, height] = SMALL;
    let (_, axis, [low, high]) = quantity(found);
    let x = |angle: f64| (angle - low) / (high - low) * width;
    let y = |value: f64| height * (1.0 - (value / top).clamp(-0.05, 1.0));
    let mut body = String::new();
    for tick in Scale::linear(low, high).ticks_every((high - low) / 4.0) {
        let at = tick.at * width;
        let _ = write!(
            body,
            "<path class=\"grid\" d=\"M{0} 0V{height}\"/><text class=\"tick\" x=\"{0}\" y=\"{1}\" text-anchor=\"middle\">{2}</text>",
            coordinate(at),
            height + 14.0,
            tick.label
        );
    }
    if found.recover == "lighting" {
        for source in &found.sources {
            let _ = write!(
                body,
                "<path class=\"line source\" d=\"M{} {}V0\"/>",
                coordinate(x(source.theta_deg)),
                coordinate(height)
            );
        }
    }
    for (c, channel) in found.channels.iter().enumerate() {
        let curve = &channel.curve;
        let points = curve.angles_deg.iter().zip(&curve.values);
        let _ = write!(
            body,
            "<path class=\"line {}\" d=\"{}\"/>",
            series_class(&channel.name, c),
            path_data(points.map(|(a, v)| (x(*a), y(*v))))
        );
    }
    format!(
        "<svg viewBox=\"-20 -2 {} {}\" role=\"img\" aria-label=\"{}\"><path class=\"frame\" d=\"M0 0H{width}V{height}H0Z\"/>{body}</svg>",
        width + 40.0,
        height + 20.0,
        escape(&format!(
            "{name}: curve over {axis}, largest value {}",
            short(largest(found), 3)
        ))
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_safe_in_any_folder_name() {
        assert_eq!(link("a b/ü\"<"), "./a%20b/%C3%BC%22%3C");
        assert_eq!(link("javascript:x"), "./javascript%3Ax");
    }
}
