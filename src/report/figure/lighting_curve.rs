//! The recovered lighting as a curve with its 95 % band.

use super::{FULL, Figure, Panel, irradiance_unit, lighting_unit, two_scales};
use crate::angle::wrap;
use crate::pipeline::Run;
use crate::recover::lighting::{ChannelEstimate, LightingEstimate};
use crate::report::number::with_sigma;
use crate::report::plot::{Axis, Legend, Mark, Plot, Scale, Size, quantile, series_class};
use crate::report::table::{Cell, Table};

/// Half the width of a 95 % interval in units of σ.
pub const SIGMAS_95: f64 = 1.959_964;

/// θ of a table's value, degrees.
pub fn table_angle(i: usize, n: usize) -> f64 {
    -180.0 + 360.0 * i as f64 / n.max(1) as f64
}

/// One direction of the light beside the sources.
#[derive(Clone, Copy, Debug)]
pub struct Beside {
    /// Direction, degrees.
    pub theta_deg: f64,
    /// L of the smooth part, W m⁻² rad⁻¹.
    pub value: f64,
    /// Half its 95 % band; not a number where a source hides it.
    pub half: f64,
}

/// The recovered light without its sources. The table spreads a source over the two values next to it;
/// there the smooth part is evaluated from its series.
pub fn beside_sources(lighting: &LightingEstimate, channel: &ChannelEstimate) -> Vec<Beside> {
    let n = channel.table.len();
    let step = 360.0 / n.max(1) as f64;
    channel
        .table
        .iter()
        .zip(&channel.table_sigma)
        .enumerate()
        .map(|(i, (value, sigma))| {
            let theta_deg = table_angle(i, n);
            let hidden = lighting.sources.iter().any(|s| {
                wrap((theta_deg - s.theta_deg).to_radians()).abs() < 1.001 * step.to_radians()
            });
            if hidden {
                let smooth = channel.smooth.evaluate(theta_deg.to_radians());
                Beside {
                    theta_deg,
                    value: smooth.max(0.0),
                    half: f64::NAN,
                }
            } else {
                Beside {
                    theta_deg,
                    value: *value,
                    half: SIGMAS_95 * sigma,
                }
            }
        })
        .collect()
}

/// Least and largest L to show. Bands belong to it as long as they do not dwarf both the light itself and
/// the mean of all light; without any smooth light, a fiftieth of that mean is shown.
pub fn shown_range(lighting: &LightingEstimate) -> [f64; 2] {
    let (mut low, mut high, mut mean) = (0.0f64, 0.0f64, 0.0f64);
    let mut upper = Vec::new();
    for channel in &lighting.channels {
        let n = channel.table.len().max(1) as f64;
        mean = mean.max(channel.table.iter().sum::<f64>() / n);
        for at in beside_sources(lighting, channel) {
            if at.value.is_finite() {
                low = low.min(at.value);
                high = high.max(at.value);
            }
            upper.push(at.value + at.half);
        }
    }
    let most = 3.0 * high.max(mean);
    let with_band = quantile(upper, 0.97).min(most);
    let high = high.max(with_band).max(0.02 * mean) * 1.06;
    [low * 1.05, if high > 0.0 { high } else { 1.0 }]
}

/// L(θ) with its band, all channels, sources marked.
pub fn lighting_curve(run: &Run) -> Option<Figure> {
    let lighting = run.lighting.as_ref()?;
    let [low, high] = shown_range(lighting);
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
    let draw = |size: Size, scale: Scale| {
        let step = if size.is_wide() { 30.0 } else { 90.0 };
        let mut plot = Plot::new(
            size,
            280.0,
            Axis::degrees("direction θ / degrees", -180.0, 180.0, step),
            Axis::new(format!("L / {}", lighting_unit(run)), scale, 6),
        )
        .with_legend(legend.clone());
        let thin = if size.is_wide() { 1 } else { 2 };
        for (c, channel) in lighting.channels.iter().enumerate() {
            let class = series_class(&channel.name, c);
            let points = beside_sources(lighting, channel);
            let points = || points.iter().step_by(thin);
            let band: Vec<_> = points()
                .map(|p| (p.theta_deg, p.value - p.half, p.value + p.half))
                .collect();
            plot.band(&band, class);
            let line: Vec<_> = points().map(|p| (p.theta_deg, p.value)).collect();
            plot.line(&line, class);
        }
        for (row, source) in lighting.sources.iter().enumerate() {
            let words = if size.is_wide() || lighting.sources.len() == 1 {
                format!("{}°", with_sigma(source.theta_deg, source.theta_sigma_deg))
            } else {
                String::new()
            };
            plot.vertical(source.theta_deg, "source", &words, row % 8);
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
    let smooth = lighting.channels.iter().flat_map(|c| {
        let beside = beside_sources(lighting, c);
        beside.into_iter().map(|p| p.value)
    });
    let logarithmic = Scale::log_around(smooth, 5.0);
    let mut caption = format!(
        "Incident light per radian of direction, in {}, with the band that holds the truth in 95 % of cases if the noise model and the BRDF hold.",
        lighting_unit(run)
    );
    // Ripples of a percent are noise; swings are the end of the spectrum.
    if low < -0.02 * high {
        caption += " It holds the frequencies that are known and no others: beside a bright source it swings, below zero too. \
                    lighting.exr holds a light with these frequencies that is nowhere negative.";
    }
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
            " Vertical lines: sources, which the curve leaves out, with irradiance in {} per channel: {}.",
            irradiance_unit(run),
            named.join("; ")
        );
    }
    Some(Figure {
        id: "lighting",
        title: "Recovered lighting",
        caption,
        panels: vec![Panel {
            name: String::new(),
            markup: two_scales(
                "lighting",
                &FULL
                    .map(|size| draw(size, Scale::linear(low, high)))
                    .concat(),
                &FULL.map(|size| draw(size, logarithmic)).concat(),
            ),
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
        note: "A source's irradiance is in the two values next to it, as in lighting.csv, which has all at full precision.".to_owned(),
    }
}
