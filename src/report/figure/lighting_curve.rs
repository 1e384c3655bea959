//! The recovered lighting as a curve with its 95 % band.

use super::{FULL, Figure, Panel, irradiance_unit, lighting_unit};
use crate::pipeline::Run;
use crate::recover::lighting::LightingEstimate;
use crate::report::number::with_sigma;
use crate::report::plot::{Axis, Legend, Mark, Plot, Scale, Size, series_class};
use crate::report::table::{Cell, Table};

/// Half the width of a 95 % interval in units of σ.
pub const SIGMAS_95: f64 = 1.959_964;

/// θ of a table's value, degrees.
pub fn table_angle(i: usize, n: usize) -> f64 {
    -180.0 + 360.0 * i as f64 / n.max(1) as f64
}

/// The range to show, and whether sources stand out of it.
pub struct Range {
    /// Lowest and highest value shown.
    pub low: f64,
    /// Highest value shown.
    pub high: f64,
    /// Whether peaks at the sources are cut.
    pub cut: bool,
}

/// Sources of a vanishing width would press the rest of the curve onto the axis: where they stand more
/// than four times above all else, the range follows what is farther than 3° from every source.
pub fn shown_range(lighting: &LightingEstimate) -> Range {
    let (mut low, mut high, mut smooth) = (0.0f64, 0.0f64, 0.0f64);
    for channel in &lighting.channels {
        let n = channel.table.len();
        for (i, (value, sigma)) in channel.table.iter().zip(&channel.table_sigma).enumerate() {
            if !value.is_finite() {
                continue;
            }
            high = high.max(*value);
            let theta = table_angle(i, n);
            let near = lighting.sources.iter().any(|s| {
                crate::angle::wrap((theta - s.theta_deg).to_radians()).abs() < 3f64.to_radians()
            });
            if !near {
                let half = if sigma.is_finite() {
                    SIGMAS_95 * sigma
                } else {
                    0.0
                };
                // A band wider than the values themselves must not set the scale.
                smooth = smooth.max(value + half.min(value.abs()));
                low = low.min(value - half.min(value.abs()));
            }
        }
    }
    let cut = !lighting.sources.is_empty() && high > 4.0 * smooth && smooth > 0.0;
    let high = if cut {
        smooth * 1.5
    } else {
        high.max(smooth) * 1.06
    };
    Range {
        low: low * 1.05,
        high: if high > 0.0 { high } else { 1.0 },
        cut,
    }
}

/// L(θ) with its band, all channels, sources marked.
pub fn lighting_curve(run: &Run) -> Option<Figure> {
    let lighting = run.lighting.as_ref()?;
    let range = shown_range(lighting);
    let mut legend: Vec<Legend> = lighting
        .channels
        .iter()
        .enumerate()
        .map(|(c, channel)| Legend {
            class: series_class(&channel.name, c).to_owned(),
            mark: Mark::Line,
            label: channel.name.clone(),
        })
        .collect();
    legend.push(Legend {
        class: "s-n".to_owned(),
        mark: Mark::Band,
        label: "95 % band".to_owned(),
    });
    if !lighting.sources.is_empty() {
        legend.push(Legend {
            class: "source".to_owned(),
            mark: Mark::Line,
            label: "source".to_owned(),
        });
    }
    let draw = |size: Size| {
        let step = if size.is_wide() { 30.0 } else { 90.0 };
        let mut plot = Plot::new(
            size,
            280.0,
            Axis::degrees("direction θ / degrees", -180.0, 180.0, step),
            Axis::new(
                format!("L / {}", lighting_unit(run)),
                Scale::linear(range.low, range.high),
                6,
            ),
        )
        .with_legend(legend.clone());
        let thin = if size.is_wide() { 1 } else { 2 };
        for (c, channel) in lighting.channels.iter().enumerate() {
            let n = channel.table.len();
            let class = series_class(&channel.name, c);
            let values = || channel.table.iter().zip(&channel.table_sigma).enumerate();
            let band: Vec<_> = values()
                .step_by(thin)
                .map(|(i, (v, s))| {
                    let half = SIGMAS_95 * s;
                    (table_angle(i, n), v - half, v + half)
                })
                .collect();
            plot.band(&band, class);
            let line: Vec<_> = values()
                .step_by(thin)
                .map(|(i, (v, _))| (table_angle(i, n), *v))
                .collect();
            plot.line(&line, class);
        }
        for source in &lighting.sources {
            let words = if size.is_wide() || lighting.sources.len() == 1 {
                format!("{}°", with_sigma(source.theta_deg, source.theta_sigma_deg))
            } else {
                String::new()
            };
            plot.vertical(source.theta_deg, "source", &words);
        }
        let names: Vec<&str> = lighting.channels.iter().map(|c| c.name.as_str()).collect();
        plot.finish(
            &format!(
                "Recovered lighting against direction, channels {}, with 95 percent bands and {} sources.",
                names.join(", "),
                lighting.sources.len()
            ),
            "data-curve=\"theta_deg\"",
        )
    };
    let mut caption = format!(
        "Incident light per radian of direction, in {}, with the band that holds the truth in 95 % of cases if the noise model and the BRDF hold.",
        lighting_unit(run)
    );
    if !lighting.sources.is_empty() {
        let named: Vec<String> = lighting
            .sources
            .iter()
            .map(|s| {
                let irradiance: Vec<String> = s
                    .irradiance
                    .iter()
                    .zip(&s.irradiance_sigma)
                    .map(|(e, sigma)| with_sigma(*e, *sigma))
                    .collect();
                format!(
                    "{}° ({})",
                    with_sigma(s.theta_deg, s.theta_sigma_deg),
                    irradiance.join(", ")
                )
            })
            .collect();
        caption += &format!(
            " Vertical lines: sources, with irradiance in {} per channel: {}.",
            irradiance_unit(run),
            named.join("; ")
        );
    }
    if range.cut {
        caption += " The curve is cut at the top where the sources stand out of it.";
    }
    Some(Figure {
        id: "lighting",
        title: "Recovered lighting",
        caption,
        panels: vec![Panel {
            name: String::new(),
            markup: FULL.map(draw).concat(),
        }],
        table: table(lighting),
        wide: true,
    })
}

fn table(lighting: &LightingEstimate) -> Table {
    let mut columns = vec!["theta_deg".to_owned()];
    columns.extend(lighting.channels.iter().map(|c| format!("L_{}", c.name)));
    columns.extend(
        lighting
            .channels
            .iter()
            .map(|c| format!("sigma_{}", c.name)),
    );
    let n = lighting.channels.first().map_or(0, |c| c.table.len());
    let rows = (0..n)
        .map(|i| {
            let value = |v: &Vec<f64>| Cell::Number(v.get(i).copied().unwrap_or(f64::NAN));
            let mut row = vec![Cell::Fixed(table_angle(i, n), 1)];
            row.extend(lighting.channels.iter().map(|c| value(&c.table)));
            row.extend(lighting.channels.iter().map(|c| value(&c.table_sigma)));
            row
        })
        .collect();
    Table {
        columns,
        rows,
        note: "The file lighting.csv has the same columns at full precision.".to_owned(),
    }
}
