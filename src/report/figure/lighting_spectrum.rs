//! The Fourier coefficients of the recovered lighting with what the data say about each.

use std::f64::consts::TAU;

use super::{FULL, Figure, Panel, lighting_unit};
use crate::pipeline::Run;
use crate::recover::Status;
use crate::recover::lighting::{ChannelEstimate, LightingEstimate};
use crate::report::plot::{Axis, Legend, Mark, Plot, Scale, Size};
use crate::report::table::{Cell, Table};

fn mark(status: Status) -> (Mark, &'static str) {
    match status {
        Status::Determined => (Mark::Disc, "s-determined"),
        Status::Weak => (Mark::Ring, "s-weak"),
        Status::Indeterminate => (Mark::Cross, "s-indeterminate"),
    }
}

/// |L_p| with σ, the bound, and the status by the form of the mark; a panel per channel.
pub fn lighting_spectrum(run: &Run) -> Option<Figure> {
    let lighting = run.lighting.as_ref()?;
    // Few frequencies stand well beside the polar plot, many need the whole width.
    let longest = lighting.channels.iter().map(|c| c.spectrum.len()).max()?;
    let wide = longest > 45;
    let panels = panels(run, lighting, wide);
    if panels.is_empty() {
        return None;
    }
    let rows = lighting
        .channels
        .iter()
        .flat_map(|channel| {
            channel.spectrum.iter().enumerate().map(|(p, c)| {
                vec![
                    Cell::Text(channel.name.clone()),
                    Cell::Fixed(p as f64, 0),
                    Cell::Number(c.value.re),
                    Cell::Number(c.value.im),
                    Cell::Number(c.sigma),
                    Cell::Number(c.bound),
                    Cell::Text(c.status.word().to_owned()),
                ]
            })
        })
        .collect();
    Some(Figure {
        id: "lighting-spectrum",
        title: "Frequencies of the lighting",
        caption: "|L_[p]| with one standard deviation. Discs: determined by the data alone. Rings: weak, the prior has a part in them. \
                  Crosses: indeterminate, the photographs say nothing about them. Dotted: the Cramér–Rao bound of σ without a prior; \
                  no unbiased method can do better with these photographs."
            .to_owned(),
        panels,
        table: Table {
            columns: ["channel", "p", "re", "im", "sigma", "bound", "status"]
                .map(str::to_owned)
                .to_vec(),
            rows,
            note: "The file lighting_spectrum.csv has the values at full precision.".to_owned(),
        },
        wide,
    })
}

fn panels(run: &Run, lighting: &LightingEstimate, wide: bool) -> Vec<Panel> {
    let sizes: &[Size] = if wide { &FULL } else { &[Size::Half] };
    lighting
        .channels
        .iter()
        .filter(|c| !c.spectrum.is_empty())
        .map(|channel| Panel {
            name: channel.name.clone(),
            markup: sizes.iter().map(|&size| draw(run, channel, size)).collect(),
        })
        .collect()
}

fn draw(run: &Run, channel: &ChannelEstimate, size: Size) -> String {
    let last = channel.spectrum.len() - 1;
    let y = Scale::log_around(
        channel
            .spectrum
            .iter()
            .flat_map(|c| [c.value.norm(), c.sigma, c.bound]),
        7.0,
    );
    let entry = |class: &str, mark, label: &str| Legend {
        class: class.to_owned(),
        mark,
        label: label.to_owned(),
    };
    let mut plot = Plot::new(
        size,
        260.0,
        Axis::whole(
            "frequency p",
            -0.5,
            last as f64 + 0.5,
            if size.is_wide() { 12 } else { 6 },
        ),
        Axis::new(format!("|L_[p]| / {}", lighting_unit(run)), y, 6),
    )
    .with_legend(vec![
        entry("s-determined", Mark::Disc, "determined"),
        entry("s-weak", Mark::Ring, "weak"),
        entry("s-indeterminate", Mark::Cross, "indeterminate"),
        entry("bound", Mark::Line, "bound of σ"),
    ]);
    let bound: Vec<_> = channel
        .spectrum
        .iter()
        .enumerate()
        .map(|(p, c)| (p as f64, c.bound))
        .collect();
    plot.line(&bound, "bound");
    for (p, c) in channel.spectrum.iter().enumerate() {
        let (mark, class) = mark(c.status);
        let size = c.value.norm();
        if c.sigma.is_finite() {
            plot.error_bar(p as f64, (size - c.sigma).max(0.0), size + c.sigma, class);
        }
        // What is zero has no logarithm: its mark stands at the lower edge.
        let lowest = y.low() * (y.high() / y.low()).powf(0.025);
        plot.point(p as f64, size.max(lowest), mark, class);
    }
    let count = |status| {
        channel
            .spectrum
            .iter()
            .filter(|c| c.status == status)
            .count()
    };
    plot.finish(
        &format!(
            "Magnitudes of the lighting's Fourier coefficients 0 to {last}, channel {}: {} determined, {} weak, {} indeterminate. Mean L is {:.4}.",
            channel.name,
            count(Status::Determined),
            count(Status::Weak),
            count(Status::Indeterminate),
            channel.spectrum.first().map_or(0.0, |c| c.value.re * TAU) / TAU
        ),
        "data-curve=\"p\"",
    )
}
