//! The recovered lighting as a polar plot.

use super::lighting_curve::{beside_sources, shown_range};
use super::{Figure, Panel, lighting_unit};
use crate::pipeline::Run;
use crate::report::number::trimmed;
use crate::report::plot::{Polar, Scale, Size, series_class};
use crate::report::table::{Cell, Table};

/// L(θ) around the object, as seen along the axis from above.
pub fn lighting_polar(run: &Run) -> Option<Figure> {
    let lighting = run.lighting.as_ref()?;
    let [_, high] = shown_range(lighting);
    let scale = Scale::linear(0.0, high);
    let mut polar = Polar::new(Size::Half, scale, &format!("L / {}", lighting_unit(run)));
    for source in &lighting.sources {
        polar.ray(
            source.theta_deg.to_radians(),
            "source",
            &format!("{}°", trimmed(source.theta_deg, 4)),
        );
    }
    for (c, channel) in lighting.channels.iter().enumerate() {
        let class = series_class(&channel.name, c);
        let points = beside_sources(lighting, channel);
        let band: Vec<_> = points
            .iter()
            .filter(|p| p.half.is_finite())
            .map(|p| (p.theta_deg.to_radians(), p.value - p.half, p.value + p.half))
            .collect();
        polar.band(&band, class);
        let line: Vec<_> = points
            .iter()
            .map(|p| (p.theta_deg.to_radians(), p.value))
            .collect();
        polar.curve(&line, class);
    }
    let rows = lighting
        .channels
        .iter()
        .map(|channel| {
            let points = beside_sources(lighting, channel);
            let brightest = points.iter().max_by(|a, b| a.value.total_cmp(&b.value));
            vec![
                Cell::Text(channel.name.clone()),
                Cell::Fixed(brightest.map_or(f64::NAN, |p| p.theta_deg), 1),
                Cell::Number(brightest.map_or(f64::NAN, |p| p.value)),
                Cell::Number(
                    points.iter().map(|p| p.value).sum::<f64>() / points.len().max(1) as f64,
                ),
            ]
        })
        .collect();
    Some(Figure {
        id: "lighting-polar",
        title: "Lighting around the object",
        caption: format!(
            "The same lighting, drawn in the direction it comes from (0° to the right, counter-clockwise); colours as above.{}",
            if lighting.sources.is_empty() { "" } else { " Straight lines: sources." }
        ),
        panels: vec![Panel {
            name: String::new(),
            markup: polar.finish("Recovered lighting as a polar plot around the object."),
        }],
        table: Table {
            columns: ["channel", "brightest_theta_deg", "L_brightest", "L_mean"]
                .map(str::to_owned)
                .to_vec(),
            rows,
            note: "The light beside the sources; all values are in the table of the recovered lighting.".to_owned(),
        },
        wide: false,
    })
}
