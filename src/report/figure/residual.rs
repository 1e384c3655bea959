//! What the fit leaves unexplained.

use super::{
    Detail, FULL, Figure, Panel, cell_image, cell_table, channel_note, image_channels,
    light_field_axes, merge_note,
};
use crate::error::Result;
use crate::light_field::LightField;
use crate::pipeline::Run;
use crate::report::number::{percent, short};
use crate::report::plot::{
    Axis, ColourMap, HeatMap, Legend, Mark, Plot, Scale, Size, quantile, series_class,
};
use crate::report::table::{Cell, Table};

/// Measured − predicted as an image, a panel per channel.
///
/// # Errors
/// If an image cannot be encoded.
pub fn residual_image(run: &Run) -> Result<Option<Figure>> {
    let Some(field) = &run.residual else {
        return Ok(None);
    };
    let mut panels = Vec::new();
    let mut images = Vec::new();
    for channel in image_channels(field.channels.len()) {
        let image = cell_image(field, channel, run.limb_cut, Detail::Coarse, |k| {
            f64::from(field.mean[channel][k])
        });
        let limit = quantile(image.values.iter().map(|v| v.abs()), 0.995);
        let limit = if limit > 0.0 { limit } else { 1e-9 };
        let (x, y) = light_field_axes(45.0);
        let name = &field.channels[channel];
        let alt = format!(
            "Residual of the fit, channel {name}, from −{0} to {0} {1}.",
            short(limit, 2),
            run.radiance_unit
        );
        let map = HeatMap {
            id: format!("image-residual-{channel}"),
            x,
            y,
            cells: [image.columns, image.rows],
            values: image.values.clone(),
            colours: Scale::linear(-limit, limit),
            map: ColourMap::Vik,
            label: format!("residual / {}", run.radiance_unit),
            height: 220.0,
            read_out: None,
        };
        panels.push(Panel {
            name: name.clone(),
            markup: map.draw(&FULL, &alt)?,
        });
        images.push((format!("residual_{name}"), image));
    }
    let Some((_, first)) = images.first() else {
        return Ok(None);
    };
    let merge = merge_note(first, field);
    let borrowed: Vec<_> = images.iter().map(|(n, i)| (n.clone(), i)).collect();
    Ok(Some(Figure {
        id: "residual",
        title: "Residual: measured − predicted",
        caption: format!(
            "Structure here is what the model cannot explain: diagonals that follow the views point to exposure or geometry, \
             structure that stands still in α to the surface, stripes along the highlights to a BRDF that is not the object's or to light from out of the plane. \
             Colours saturate at the 99.5 % quantile.{merge}{}",
            channel_note(field.channels.len())
        ),
        panels,
        table: cell_table(
            &borrowed,
            "Single cells of the image on a coarse grid; every cell is in residual.exr.",
        ),
        wide: true,
    }))
}

/// Half the number of bins of the histogram, and their width in σ.
const HALF_BINS: usize = 24;
const BIN: f64 = 0.25;

/// Residuals in units of σ against the normal distribution they should follow.
pub fn residual_histogram(run: &Run) -> Option<Figure> {
    let field = run.residual.as_ref()?;
    let mut panels = Vec::new();
    let mut rows: Vec<Vec<Cell>> = centres()
        .map(|z| vec![Cell::Fixed(z, 3), Cell::Number(normal(z))])
        .collect();
    let mut columns = vec!["residual_in_sigma".to_owned(), "normal".to_owned()];
    let mut beyond = Vec::new();
    for channel in image_channels(field.channels.len()) {
        let (density, outside) = histogram(field, channel)?;
        let name = &field.channels[channel];
        beyond.push(format!("{name} {}", percent(outside)));
        columns.push(format!("density_{name}"));
        for (row, value) in rows.iter_mut().zip(&density) {
            row.push(Cell::Number(*value));
        }
        panels.push(Panel {
            name: name.clone(),
            markup: draw(&density, name, series_class(name, channel)),
        });
    }
    (!panels.is_empty()).then(|| Figure {
        id: "residual-histogram",
        title: "Residuals in units of σ",
        caption: format!(
            "Bars: how often each residual occurs, as a density. Curve: the normal distribution of width 1 that they follow when model and noise are right. \
             A narrower histogram says that σ was taken too large, a wider one that something is missing. Beyond ±3 σ (0.27 % expected): {}.",
            beyond.join(", ")
        ),
        panels,
        table: Table {
            columns,
            rows,
            note: String::new(),
        },
        wide: false,
    })
}

fn centres() -> impl Iterator<Item = f64> {
    (0..2 * HALF_BINS).map(|k| (k as f64 + 0.5 - HALF_BINS as f64) * BIN)
}

fn normal(z: f64) -> f64 {
    (-z * z / 2.0).exp() / std::f64::consts::TAU.sqrt()
}

/// Density per σ in each bin, and the share beyond ±3 σ; `None` if no cell has a σ.
fn histogram(field: &LightField, channel: usize) -> Option<(Vec<f64>, f64)> {
    let mut counts = vec![0usize; 2 * HALF_BINS];
    let (mut all, mut outside) = (0usize, 0usize);
    let cells = field
        .mean
        .get(channel)?
        .iter()
        .zip(field.sigma.get(channel)?)
        .zip(field.weight.get(channel)?);
    for ((value, sigma), weight) in cells {
        if *weight <= 0.0 || *sigma <= 0.0 {
            continue;
        }
        let z = f64::from(*value) / f64::from(*sigma);
        if !z.is_finite() {
            continue;
        }
        all += 1;
        outside += usize::from(z.abs() > 3.0);
        let bin = (z / BIN).floor() + HALF_BINS as f64;
        if bin >= 0.0
            && let Some(count) = counts.get_mut(bin as usize)
        {
            *count += 1;
        }
    }
    if all == 0 {
        return None;
    }
    let density = counts
        .iter()
        .map(|c| *c as f64 / (all as f64 * BIN))
        .collect();
    Some((density, outside as f64 / all as f64))
}

fn draw(density: &[f64], name: &str, class: &str) -> String {
    let highest = density.iter().copied().fold(0.42, f64::max);
    let edge = HALF_BINS as f64 * BIN;
    let mut plot = Plot::new(
        Size::Half,
        250.0,
        Axis::new("residual / σ", Scale::linear(-edge, edge), 6),
        Axis::new("density", Scale::linear(0.0, highest * 1.05), 5),
    )
    .with_legend(vec![
        Legend {
            class: class.to_owned(),
            mark: Mark::Band,
            label: format!("channel {name}"),
        },
        Legend {
            class: "s-n".to_owned(),
            mark: Mark::Line,
            label: "normal".to_owned(),
        },
    ]);
    for (z, value) in centres().zip(density) {
        plot.bar(z - BIN / 2.0, z + BIN / 2.0, *value, class);
    }
    let curve: Vec<_> = (-120..=120)
        .map(|k| f64::from(k) / 20.0)
        .map(|z| (z, normal(z)))
        .collect();
    plot.line(&curve, "s-n");
    plot.finish(
        &format!("Histogram of the residuals of channel {name} in units of their standard deviation, with the normal distribution."),
        "data-curve=\"residual_in_sigma\"",
    )
}
