//! The measured light field and its standard deviation as images.

use super::{
    CellImage, Detail, FULL, Figure, Panel, cell_image, cell_table, channel_note, image_channels,
    light_field_axes, merge_note,
};
use crate::error::Result;
use crate::pipeline::Run;
use crate::report::number::{short, trimmed};
use crate::report::plot::{ColourMap, HeatMap, ReadOut, Scale, quantile};

/// B(α, θo′), a panel per channel.
///
/// # Errors
/// If an image cannot be encoded.
pub fn light_field(run: &Run) -> Result<Figure> {
    let field = &run.light_field;
    let mut panels = Vec::new();
    let mut images = Vec::new();
    let mut note = String::new();
    // One channel may show every cell; several would make a heavy page.
    let detail = if field.channels.len() == 1 {
        Detail::Fine
    } else {
        Detail::Coarse
    };
    for channel in image_channels(field.channels.len()) {
        let image = cell_image(field, channel, run.limb_cut, detail, |k| {
            f64::from(field.mean[channel][k])
        });
        let largest = quantile(image.values.iter().copied(), 1.0);
        let typical = quantile(image.values.iter().copied(), 0.5);
        // Highlights would leave the rest of a linear image dark.
        let skewed = typical < 0.15 * largest;
        let colours = if skewed {
            Scale::square_root(0.0, largest)
        } else {
            Scale::linear(0.0, largest)
        };
        if skewed {
            note = " Colours follow the square root of the value.".to_owned();
        }
        let (x, y) = light_field_axes(45.0);
        let name = &field.channels[channel];
        let alt = format!(
            "Light field of channel {name} as an image over normal direction and exitant direction; largest value {} {}, median {}.",
            short(largest, 4),
            run.radiance_unit,
            short(typical, 3)
        );
        let map = HeatMap {
            id: format!("image-light-field-{channel}"),
            x,
            y,
            cells: [image.columns, image.rows],
            values: image.values.clone(),
            colours,
            map: ColourMap::Viridis,
            label: format!("B / {}", run.radiance_unit),
            height: 300.0,
            read_out: Some(read_out(run, channel)),
        };
        panels.push(Panel {
            name: name.clone(),
            markup: map.draw(&FULL, &alt)?,
        });
        images.push((format!("B_{name}"), image));
    }
    let merge = images
        .first()
        .map_or_else(String::new, |(_, image)| merge_note(image, field));
    Ok(Figure {
        id: "light-field",
        title: "Measured light field",
        caption: format!(
            "B(α, θ_[o]′): the radiance that leaves the surface point with normal α in the direction θ_[o]′ from that normal. \
             One photograph is one falling diagonal; a highlight of a source at θ_[s] lies along θ_[o]′ = α − θ_[s]. \
             Hatched: beyond the limb cut of ±{}°, or never seen.{note}{merge}{}",
            trimmed(run.limb_cut.to_degrees(), 3),
            channel_note(field.channels.len())
        ),
        panels,
        table: table(&images, "light_field.exr"),
        wide: true,
    })
}

/// σ of the light field, a panel per channel.
///
/// # Errors
/// If an image cannot be encoded.
pub fn sigma(run: &Run) -> Result<Figure> {
    let field = &run.light_field;
    let mut panels = Vec::new();
    let mut images = Vec::new();
    for channel in image_channels(field.channels.len()) {
        let image = cell_image(field, channel, run.limb_cut, Detail::Coarse, |k| {
            f64::from(field.sigma[channel][k])
        });
        let positive = || image.values.iter().copied().filter(|v| *v > 0.0);
        let (low, high) = (quantile(positive(), 0.005), quantile(positive(), 0.995));
        let colours = if low > 0.0 && high > 5.0 * low {
            Scale::log(low, high)
        } else {
            Scale::linear(0.0, high)
        };
        let (x, y) = light_field_axes(45.0);
        let name = &field.channels[channel];
        let alt = format!(
            "Standard deviation of the light field of channel {name}; from {} to {} {} in most of the plane.",
            short(low, 2),
            short(high, 2),
            run.radiance_unit
        );
        let map = HeatMap {
            id: format!("image-sigma-{channel}"),
            x,
            y,
            cells: [image.columns, image.rows],
            values: image.values.clone(),
            colours,
            map: ColourMap::Cividis,
            label: format!("σ / {}", run.radiance_unit),
            height: 220.0,
            read_out: None,
        };
        panels.push(Panel {
            name: name.clone(),
            markup: map.draw(&FULL, &alt)?,
        });
        images.push((format!("sigma_{name}"), image));
    }
    Ok(Figure {
        id: "sigma",
        title: "Standard deviation of the light field",
        caption: format!(
            "σ of each cell's mean, from the noise of the pixels behind it and the uncertainty of the geometry, which grows towards the limb.{}",
            channel_note(field.channels.len())
        ),
        panels,
        table: table(&images, "light_field.exr"),
        wide: true,
    })
}

/// Values and σ for the pointer, coarse: a hand does not aim finer.
fn read_out(run: &Run, channel: usize) -> ReadOut {
    let field = &run.light_field;
    let image = |layer: &[Vec<f32>]| {
        cell_image(field, channel, run.limb_cut, Detail::Coarse, |k| {
            f64::from(layer[channel][k])
        })
    };
    let values = image(&field.mean);
    ReadOut {
        cells: [values.columns, values.rows],
        values: values.values,
        sigma: image(&field.sigma).values,
    }
}

fn table(images: &[(String, CellImage)], file: &str) -> crate::report::table::Table {
    let images: Vec<_> = images.iter().map(|(n, i)| (n.clone(), i)).collect();
    cell_table(
        &images,
        &format!("Single cells of the image on a coarse grid; every cell is in {file}."),
    )
}
