//! The recovered lighting as a polar plot.

use super::lighting_curve::{SIGMAS_95, shown_range, table_angle};
use super::{Figure, Panel, lighting_unit};
use crate::pipeline::Run;
use crate::report::number::trimmed;
use crate::report::plot::{Polar, Scale, Size, series_class};
use crate::report::table::{Cell, Table};

/// L(θ) around the object, as seen along the axis from above.
pub fn lighting_polar(run: &Run) -> Option<Figure> {
    let lighting = run.lighting.as_ref()?;
    let range = shown_range(lighting);
    let scale = Scale::linear(0.0, range.high);
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
        let n = channel.table.len();
        let angle = |i: usize| table_angle(i, n).to_radians();
        let values = || channel.table.iter().zip(&channel.table_sigma).enumerate();
        let band: Vec<_> = values()
            .map(|(i, (v, s))| (angle(i), v - SIGMAS_95 * s, v + SIGMAS_95 * s))
            .collect();
        polar.band(&band, class);
        let line: Vec<_> = values().map(|(i, (v, _))| (angle(i), *v)).collect();
        polar.curve(&line, class);
    }
    let rows = lighting
        .channels
        .iter()
        .map(|channel| {
            let n = channel.table.len();
            let (at, value) = channel
                .table
                .iter()
                .enumerate()
                .max_by(|a, b| a.1.total_cmp(b.1))
                .map_or((0, f64::NAN), |(i, v)| (i, *v));
            vec![
                Cell::Text(channel.name.clone()),
                Cell::Fixed(table_angle(at, n), 1),
                Cell::Number(value),
                Cell::Number(channel.table.iter().sum::<f64>() / n.max(1) as f64),
            ]
        })
        .collect();
    Some(Figure {
        id: "lighting-polar",
        title: "Lighting around the object",
        caption: format!(
            "The same lighting, drawn in the direction it comes from (0° to the right, counter-clockwise); colours as above.{}",
            if range.cut {
                " Cut at the rim at the sources."
            } else {
                ""
            }
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
            note: "All values are in the table of the recovered lighting.".to_owned(),
        },
        wide: false,
    })
}
