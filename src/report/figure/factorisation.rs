//! What a recovery of both rests on: the eigenvalues of the reciprocity problem, and other ways to the lighting.

use super::{Figure, Panel, lighting_unit};
use crate::pipeline::{ChannelGauge, Run};
use crate::recover::lighting::ChannelEstimate;
use crate::report::number::percent;
use crate::report::plot::{Axis, Legend, Mark, Plot, Scale, Size, series_class};
use crate::report::table::{Cell, Table};

/// Eigenvalues in units of the noise, all channels.
pub fn eigenvalues(run: &Run) -> Option<Figure> {
    let most = run.gauge.iter().map(|g| g.eigenvalues.len()).max()?;
    if most < 2 {
        return None;
    }
    let y = Scale::log_around(
        run.gauge
            .iter()
            .flat_map(|g| g.eigenvalues.iter().copied())
            .chain([1.0]),
        12.0,
    );
    let mut plot = Plot::new(
        Size::Half,
        280.0,
        Axis::whole("number of the eigenvalue", 0.5, most as f64 + 0.5, 7),
        Axis::new("eigenvalue / noise", y, 6),
    )
    .with_legend(
        run.gauge
            .iter()
            .enumerate()
            .map(|(c, g)| Legend {
                class: series_class(&g.channel, c).to_owned(),
                mark: Mark::Line,
                label: g.channel.clone(),
            })
            .chain([Legend {
                class: "floor".to_owned(),
                mark: Mark::Line,
                label: "noise".to_owned(),
            }])
            .collect(),
    );
    plot.line(&[(0.0, 1.0), (most as f64 + 1.0, 1.0)], "floor");
    let mut rows = Vec::new();
    for (c, g) in run.gauge.iter().enumerate() {
        let class = series_class(&g.channel, c);
        let points: Vec<_> = g
            .eigenvalues
            .iter()
            .enumerate()
            .map(|(k, v)| ((k + 1) as f64, *v))
            .collect();
        plot.line(&points, class);
        rows.extend(points.iter().map(|(k, v)| {
            vec![
                Cell::Text(g.channel.clone()),
                Cell::Fixed(*k, 0),
                Cell::Number(*v),
            ]
        }));
    }
    let groups: Vec<String> = run
        .gauge
        .iter()
        .map(|g| format!("{} {}", g.channel, g.components.len()))
        .collect();
    Some(Figure {
        id: "eigenvalues",
        title: "Eigenvalues of the reciprocity problem",
        caption: format!(
            "Increasing, in units of what noise alone gives (dotted). The lighting is the eigenvector of the smallest; each further one near the noise is a direction in which light and material can be exchanged. \
             Groups of frequencies that reciprocity ties together: {} (1: a single free factor, the scale).",
            groups.join(", ")
        ),
        panels: vec![Panel {
            name: String::new(),
            markup: plot.finish(
                "Eigenvalues of the reciprocity problem in increasing order, logarithmic, in units of the noise.",
                "data-curve=\"number\"",
            ),
        }],
        table: Table {
            columns: ["channel", "number", "eigenvalue"].map(str::to_owned).to_vec(),
            rows,
            note: String::new(),
        },
        wide: false,
    })
}

/// |L_p| of the result, of the eigenproblem, and of eq. 29, a panel per channel.
pub fn ways_compared(run: &Run) -> Option<Figure> {
    let lighting = run.lighting.as_ref()?;
    let mut rows = Vec::new();
    let mut words = Vec::new();
    let mut panels = Vec::new();
    for (g, channel) in run.gauge.iter().zip(&lighting.channels) {
        for (p, l) in channel.spectrum.iter().enumerate() {
            rows.push(vec![
                Cell::Text(g.channel.clone()),
                Cell::Fixed(p as f64, 0),
                Cell::Number(l.value.norm()),
                Cell::Number(g.eigenproblem.get(p as i64).norm()),
                Cell::Number(g.ratios.get(p as i64).norm()),
            ]);
        }
        words.push(format!(
            "{} {} and {}",
            g.channel,
            percent(g.eigenproblem_difference),
            percent(g.ratios_difference)
        ));
        panels.push(Panel {
            name: g.channel.clone(),
            markup: draw(run, g, channel),
        });
    }
    (!panels.is_empty()).then(|| Figure {
        id: "eq-29",
        title: "Three ways to the lighting",
        caption: format!(
            "|L_[p]| of the result (discs), of the eigenproblem over all coefficients, and of the ratios of one row [RH01, eq. 29]. \
             Over the determined frequencies eigenproblem and ratios differ from the result by {} (relative L2).",
            words.join("; ")
        ),
        panels,
        table: Table {
            columns: ["channel", "p", "L_result", "L_eigenproblem", "L_eq_29"]
                .map(str::to_owned)
                .to_vec(),
            rows,
            note: String::new(),
        },
        wide: false,
    })
}

fn draw(run: &Run, gauge: &ChannelGauge, channel: &ChannelEstimate) -> String {
    let last = channel.spectrum.len().saturating_sub(1);
    let y = Scale::log_around(channel.spectrum.iter().map(|c| c.value.norm()), 4.0);
    let entry = |class: &str, mark, label: &str| Legend {
        class: class.to_owned(),
        mark,
        label: label.to_owned(),
    };
    let mut plot = Plot::new(
        Size::Half,
        280.0,
        Axis::whole("frequency p", -0.5, last as f64 + 0.5, 7),
        Axis::new(format!("|L_[p]| / {}", lighting_unit(run)), y, 6),
    )
    .with_legend(vec![
        entry("s-determined", Mark::Disc, "result"),
        entry("s-b", Mark::Line, "eigenproblem"),
        entry("s-c", Mark::Line, "eq. 29"),
    ]);
    for (series, class) in [(&gauge.eigenproblem, "s-b"), (&gauge.ratios, "s-c")] {
        let points: Vec<_> = (0..=last)
            .map(|p| (p as f64, series.get(p as i64).norm()))
            .collect();
        plot.line(&points, class);
    }
    for (p, c) in channel.spectrum.iter().enumerate() {
        if c.value.norm() > 0.0 {
            plot.point(p as f64, c.value.norm(), Mark::Disc, "s-determined");
        }
    }
    plot.finish(
        &format!(
            "Magnitudes of the lighting's coefficients of channel {} from the result, the eigenproblem and equation 29.",
            gauge.channel
        ),
        "data-curve=\"p\"",
    )
}
