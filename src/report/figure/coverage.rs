//! Which part of the (α, θo′) plane the photographs saw.

use super::{Detail, FULL, Figure, Panel, cell_image, cell_table, light_field_axes};
use crate::error::Result;
use crate::pipeline::Run;
use crate::report::number::{percent, trimmed};
use crate::report::plot::{ColourMap, HeatMap, Scale, bounds};

/// Number of pixels behind each cell; a panel per channel only where the channels differ.
///
/// # Errors
/// If an image cannot be encoded.
pub fn coverage(run: &Run) -> Result<Figure> {
    let field = &run.light_field;
    let alike = field.weight.windows(2).all(|w| w[0] == w[1]);
    let channels = if alike {
        vec![0]
    } else {
        super::image_channels(field.channels.len())
    };
    let mut panels = Vec::new();
    let mut images = Vec::new();
    for channel in channels.into_iter().filter(|c| *c < field.weight.len()) {
        let image = cell_image(field, channel, run.limb_cut, Detail::Gaps, |k| {
            f64::from(field.weight[channel][k])
        });
        let (low, high) = bounds(image.values.iter().copied());
        let colours = if high > 20.0 * low.max(1e-3) {
            Scale::log(low.max(high * 1e-3), high)
        } else {
            Scale::linear(0.0, high)
        };
        let share = field.coverage(channel, run.limb_cut);
        let (x, y) = light_field_axes(45.0);
        let name = if alike {
            "all channels".to_owned()
        } else {
            field.channels[channel].clone()
        };
        let alt = format!(
            "Coverage of the plane of normal and exitant direction, {name}: {} of the cells within the limb cut were seen.",
            percent(share)
        );
        let map = HeatMap {
            id: format!("image-coverage-{channel}"),
            x,
            y,
            cells: [image.columns, image.rows],
            values: image.values.clone(),
            colours,
            map: ColourMap::Cividis,
            label: "pixels per cell".to_owned(),
            height: 200.0,
            read_out: None,
        };
        panels.push(Panel {
            name,
            markup: map.draw(&FULL, &alt)?,
        });
        images.push((format!("pixels_{channel}"), image));
    }
    let grid = field.grid;
    let borrowed: Vec<_> = images.iter().map(|(n, i)| (n.clone(), i)).collect();
    Ok(Figure {
        id: "coverage",
        title: "Coverage",
        caption: format!(
            "Pixels behind each of the {} × {} cells ({}° in α, {}° in θ_[o]′). {} views, each one a falling diagonal; within |θ_[o]′| ≤ {}° they fill {} of the cells. \
             {} evenly spread views resolve frequencies |p| < {} of the light field in α.",
            grid.normals,
            grid.locals,
            trimmed(grid.normal_step().to_degrees(), 3),
            trimmed(grid.local_step().to_degrees(), 3),
            run.views.len(),
            trimmed(run.limb_cut.to_degrees(), 3),
            percent(field.coverage(0, run.limb_cut)),
            run.views.len(),
            run.views.len().div_ceil(2)
        ),
        panels,
        table: cell_table(
            &borrowed,
            "Single cells on a coarse grid; the weight of every cell is in light_field.exr.",
        ),
        wide: true,
    })
}
