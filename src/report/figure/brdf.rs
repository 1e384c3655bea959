//! The recovered BRDF slice: values, σ and status as images over θi′ and θo′.

use std::fmt::Write as _;

use super::{Figure, Panel, channel_note, image_channels};
use crate::error::Result;
use crate::pipeline::Run;
use crate::recover::Status;
use crate::recover::brdf::{BrdfEstimate, Slice};
use crate::report::number::{short, trimmed};
use crate::report::plot::{
    Axis, ColourMap, HeatMap, Legend, Mark, Plot, ReadOut, Scale, Size, coordinate, quantile,
};
use crate::report::table::{Cell, Table};

/// Largest number of cells along a side of an image.
const MOST: usize = 180;
/// Cells along a side of the image of the status.
const STATUS_CELLS: usize = 60;

/// The axes of every image of a slice.
fn axes() -> (Axis, Axis) {
    (
        Axis::degrees("incident direction θ_[i]′ / degrees", -90.0, 90.0, 30.0),
        Axis::degrees("exitant direction θ_[o]′ / degrees", -90.0, 90.0, 30.0),
    )
}

/// A layer of a slice as an image, θi′ to the right and θo′ upwards, NaN where indeterminate: side and values.
fn image(brdf: &BrdfEstimate, slice: &Slice, layer: &[f64]) -> (usize, Vec<f64>) {
    let n = brdf.size;
    let step = n.div_ceil(MOST).max(1);
    let side = n / step;
    let mut values = Vec::with_capacity(side * side);
    for row in (0..side).rev() {
        for column in 0..side {
            let k = (column * step + step / 2) * n + row * step + step / 2;
            let known = slice
                .status
                .get(k)
                .is_some_and(|s| *s != Status::Indeterminate);
            values.push(match layer.get(k) {
                Some(v) if known => *v,
                _ => f64::NAN,
            });
        }
    }
    (side, values)
}

/// ρ cos θi′ cos θo′ with σ for the pointer, a panel per channel.
///
/// # Errors
/// If an image cannot be encoded.
pub fn brdf_image(run: &Run) -> Result<Option<Figure>> {
    let Some(brdf) = &run.brdf else {
        return Ok(None);
    };
    let mut panels = Vec::new();
    let mut note = "";
    for c in image_channels(brdf.slices.len()) {
        let (slice, name) = (&brdf.slices[c], &brdf.channels[c]);
        let (side, values) = image(brdf, slice, &slice.reciprocal);
        let (_, sigma) = image(brdf, slice, &slice.sigma);
        let largest = quantile(values.iter().copied(), 1.0);
        let skewed = quantile(values.iter().copied(), 0.5) < 0.15 * largest;
        if skewed {
            note = " Colours follow the square root of the value.";
        }
        let (x, y) = axes();
        let map = HeatMap {
            id: format!("image-brdf-{c}"),
            x,
            y,
            cells: [side, side],
            read_out: Some(ReadOut {
                cells: [side, side],
                values: values.clone(),
                sigma,
            }),
            values,
            colours: if skewed {
                Scale::square_root(0.0, largest)
            } else {
                Scale::linear(0.0, largest)
            },
            map: ColourMap::Viridis,
            label: "ρ cos θ_[i]′ cos θ_[o]′ / sr⁻¹".to_owned(),
            height: 330.0,
        };
        let alt = format!(
            "BRDF slice of channel {name} times both cosines, over incident and exitant direction; largest value {} per steradian.",
            short(largest, 4)
        );
        panels.push(Panel {
            name: name.clone(),
            markup: map.draw(&[Size::Half], &alt)?,
        });
    }
    Ok((!panels.is_empty()).then(|| Figure {
        id: "brdf",
        title: "BRDF slice",
        caption: format!(
            "ρ cos θ_[i]′ cos θ_[o]′ in the plane of incidence, signed angles: the mirror direction is the falling diagonal θ_[o]′ = −θ_[i]′, retro-reflection the rising one. \
             The slice is symmetric about the rising diagonal (reciprocity). Hatched: indeterminate, no value is given.{note}{}",
            channel_note(brdf.slices.len())
        ),
        panels,
        table: table(brdf),
        wide: false,
    }))
}

/// Values, σ and status on a coarse grid.
fn table(brdf: &BrdfEstimate) -> Table {
    let n = brdf.size;
    let step = n.div_ceil(36).max(1);
    let mut columns = vec!["theta_i_deg".to_owned(), "theta_o_deg".to_owned()];
    for name in &brdf.channels {
        columns.extend(["rho", "sigma", "status"].map(|layer| format!("{layer}_{name}")));
    }
    let mut rows = Vec::new();
    for i in (step / 2..n).step_by(step) {
        for j in (step / 2..n).step_by(step) {
            let mut row = vec![
                Cell::Fixed(brdf.angle(i).to_degrees(), 2),
                Cell::Fixed(brdf.angle(j).to_degrees(), 2),
            ];
            for (c, slice) in brdf.slices.iter().enumerate() {
                let (rho, sigma) = brdf.rho(c, i, j).unwrap_or((f64::NAN, f64::NAN));
                let status = slice.status.get(i * n + j);
                row.push(Cell::Number(rho));
                row.push(Cell::Number(sigma));
                row.push(Cell::Text(status.map_or("", |s| s.word()).to_owned()));
            }
            rows.push(row);
        }
    }
    Table {
        columns,
        rows,
        note: "ρ without cosines, sr⁻¹, on a coarse grid; every cell is in brdf.csv.".to_owned(),
    }
}

/// σ of ρ cos θi′ cos θo′, a panel per channel.
///
/// # Errors
/// If an image cannot be encoded.
pub fn brdf_sigma(run: &Run) -> Result<Option<Figure>> {
    let Some(brdf) = &run.brdf else {
        return Ok(None);
    };
    let mut panels = Vec::new();
    for c in image_channels(brdf.slices.len()) {
        let (slice, name) = (&brdf.slices[c], &brdf.channels[c]);
        let (side, values) = image(brdf, slice, &slice.sigma);
        let positive = || values.iter().copied().filter(|v| *v > 0.0);
        let (low, high) = (quantile(positive(), 0.005), quantile(positive(), 0.995));
        let colours = if low > 0.0 && high > 5.0 * low {
            Scale::log(low, high)
        } else {
            Scale::linear(0.0, high)
        };
        let (x, y) = axes();
        let alt = format!(
            "Standard deviation of the BRDF slice of channel {name} times both cosines; from {} to {} per steradian in most of it.",
            short(low, 2),
            short(high, 2)
        );
        let map = HeatMap {
            id: format!("image-brdf-sigma-{c}"),
            x,
            y,
            cells: [side, side],
            values,
            colours,
            map: ColourMap::Cividis,
            label: "σ / sr⁻¹".to_owned(),
            height: 330.0,
            read_out: None,
        };
        panels.push(Panel {
            name: name.clone(),
            markup: map.draw(&[Size::Half], &alt)?,
        });
    }
    Ok((!panels.is_empty()).then(|| Figure {
        id: "brdf-sigma",
        title: "Standard deviation of the slice",
        caption: format!(
            "σ of ρ cos θ_[i]′ cos θ_[o]′: the noise of the samples and what smoothing may have taken away. It is larger in a lobe than beside it, and largest beyond the limb cut, where only reciprocity and smoothness tell.{}",
            channel_note(brdf.slices.len())
        ),
        panels,
        table: table(brdf),
        wide: false,
    }))
}

/// What is determined, a panel per channel.
pub fn brdf_status(run: &Run) -> Option<Figure> {
    let brdf = run.brdf.as_ref()?;
    let mut rows = Vec::new();
    let panels: Vec<Panel> = image_channels(brdf.slices.len())
        .into_iter()
        .map(|c| {
            let (slice, name) = (&brdf.slices[c], &brdf.channels[c]);
            let shares: Vec<(Status, f64)> =
                [Status::Determined, Status::Weak, Status::Indeterminate]
                    .into_iter()
                    .map(|s| {
                        let count = slice.status.iter().filter(|t| **t == s).count();
                        (s, count as f64 / slice.status.len().max(1) as f64)
                    })
                    .collect();
            rows.extend(shares.iter().map(|(status, share)| {
                vec![
                    Cell::Text(name.clone()),
                    Cell::Text(status.word().to_owned()),
                    Cell::Number(100.0 * share),
                ]
            }));
            Panel {
                name: name.clone(),
                markup: draw_status(brdf, slice, name, &shares),
            }
        })
        .collect();
    (!panels.is_empty()).then(|| Figure {
        id: "brdf-status",
        title: "What is determined",
        caption: "Determined: the photographs alone tell the value. Weak: they do together with the smoothness of the slice, between views or beyond the resolution of the light. \
                  Indeterminate: they hardly tell anything, and no value is given."
            .to_owned(),
        panels,
        table: Table {
            columns: ["channel", "status", "percent_of_the_slice"]
                .map(str::to_owned)
                .to_vec(),
            rows,
            note: "The status of every cell is in brdf.exr.".to_owned(),
        },
        wide: false,
    })
}

fn class(status: Status) -> &'static str {
    match status {
        Status::Determined => "s-determined",
        Status::Weak => "s-weak",
        Status::Indeterminate => "missing",
    }
}

fn draw_status(brdf: &BrdfEstimate, slice: &Slice, name: &str, shares: &[(Status, f64)]) -> String {
    let (x, y) = axes();
    let legend = shares
        .iter()
        .map(|(status, _)| Legend {
            class: class(*status).to_owned(),
            mark: Mark::Band,
            label: status.word().to_owned(),
        })
        .collect();
    let mut plot = Plot::new(Size::Half, 330.0, x, y)
        .without_grid()
        .with_legend(legend);
    let [_, _, width, height] = plot.area();
    let n = brdf.size;
    let side = STATUS_CELLS.min(n.max(1));
    let at = |row: usize, column: usize| -> Status {
        let place = |k: usize| (k * n + n / 2) / side;
        slice
            .status
            .get(place(column) * n + place(row))
            .copied()
            .unwrap_or(Status::Indeterminate)
    };
    let (dx, dy) = (width / side as f64, height / side as f64);
    let mut markup = String::new();
    for row in 0..side {
        let mut start = 0;
        while start < side {
            let status = at(row, start);
            let end = (start..side)
                .find(|&k| at(row, k) != status)
                .unwrap_or(side);
            let _ = write!(
                markup,
                "<rect class=\"band crisp {}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
                class(status),
                coordinate(start as f64 * dx),
                coordinate((side - 1 - row) as f64 * dy),
                coordinate((end - start) as f64 * dx),
                coordinate(dy)
            );
            start = end;
        }
    }
    plot.raw_inside(&markup);
    let words: Vec<String> = shares
        .iter()
        .map(|(status, share)| format!("{} {} %", status.word(), trimmed(100.0 * share, 3)))
        .collect();
    plot.finish(
        &format!(
            "Status of the BRDF slice of channel {name}: {}.",
            words.join(", ")
        ),
        "",
    )
}
