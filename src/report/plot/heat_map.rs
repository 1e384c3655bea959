//! An image over two axes with a colour bar.

use std::fmt::Write as _;

use super::cartesian::{Axis, Plot};
use super::colour::{ColourMap, indexed_png, packed_png};
use super::scale::Scale;
use super::{Size, coordinate, escape, text};
use crate::error::Result;

/// Values on a regular grid over the x and y axes.
#[derive(Debug)]
pub struct HeatMap {
    /// Unique in the page.
    pub id: String,
    /// Axis along the columns.
    pub x: Axis,
    /// Axis along the rows, upwards.
    pub y: Axis,
    /// Number of columns and rows.
    pub cells: [usize; 2],
    /// Row-major, the top row first; what is not finite is missing and shown hatched.
    pub values: Vec<f64>,
    /// Range and spacing of the colours.
    pub colours: Scale,
    /// Colour map.
    pub map: ColourMap,
    /// Quantity and unit beside the colour bar.
    pub label: String,
    /// Height of the plot area.
    pub height: f64,
    /// Values with σ for the read-out under the pointer; without them it reads the colours.
    pub read_out: Option<ReadOut>,
}

/// Values and σ over the same axes as the image, maybe on a coarser grid.
#[derive(Debug)]
pub struct ReadOut {
    /// Number of columns and rows.
    pub cells: [usize; 2],
    /// Row-major, the top row first; what is not finite is missing.
    pub values: Vec<f64>,
    /// σ of each value.
    pub sigma: Vec<f64>,
}

impl HeatMap {
    /// The image once, and a drawing of each size that refers to it.
    ///
    /// # Errors
    /// If the image cannot be encoded.
    pub fn draw(&self, sizes: &[Size], alt: &str) -> Result<String> {
        let [columns, rows] = self.cells;
        let png = indexed_png(&self.values, columns, rows, &self.colours, self.map)?;
        let mut out = format!(
            "<svg class=\"store\" width=\"0\" height=\"0\" aria-hidden=\"true\"><image id=\"{}\" \
             width=\"{columns}\" height=\"{rows}\" preserveAspectRatio=\"none\" href=\"{png}\"{}/></svg>",
            self.id,
            self.read_out_attributes()?
        );
        for &size in sizes {
            out += &self.draw_one(size, alt);
        }
        Ok(out)
    }

    /// What the script needs to say the value under the pointer: exact values and σ where they are
    /// given, else the colour map's name, from whose 255 steps it reads.
    fn read_out_attributes(&self) -> Result<String> {
        let mut out = format!(
            " data-map=\"{}\" data-spacing=\"{}\" data-v0=\"{}\" data-v1=\"{}\" data-name=\"{}\"",
            self.map.name(),
            self.colours.spacing().word(),
            self.colours.low(),
            self.colours.high(),
            escape(&self.label)
        );
        if let Some(read_out) = &self.read_out {
            let ReadOut {
                cells,
                values,
                sigma,
            } = read_out;
            let packed = packed_png(values, sigma, *cells)?;
            let _ = write!(
                out,
                " data-values=\"{}\" data-columns=\"{}\" data-rows=\"{}\" data-p0=\"{}\" data-p1=\"{}\" data-s0=\"{}\" data-s1=\"{}\"",
                packed.uri,
                cells[0],
                cells[1],
                packed.values[0],
                packed.values[1],
                packed.sigma[0],
                packed.sigma[1]
            );
        }
        Ok(out)
    }

    fn draw_one(&self, size: Size, alt: &str) -> String {
        let ticks = self.colours.ticks(5);
        let (right, bottom) = if size.is_wide() {
            (78.0, 0.0)
        } else {
            (4.0, 58.0)
        };
        let mut plot = Plot::new(size, self.height, self.x.clone(), self.y.clone())
            .without_grid()
            .with_margins(right, bottom);
        let [left, top, width, height] = plot.area();
        let [columns, rows] = self.cells;
        plot.raw_inside(&format!(
            "<rect class=\"missing\" width=\"{width:.1}\" height=\"{height:.1}\"/><use href=\"#{}\" transform=\"scale({:.6} {:.6})\"/>",
            self.id,
            width / columns as f64,
            height / rows as f64
        ));
        let mut bar = String::new();
        if size.is_wide() {
            let x = left + width + 16.0;
            let _ = write!(
                bar,
                "<rect class=\"frame\" style=\"fill:url(#{}-v)\" x=\"{}\" y=\"{}\" width=\"14\" height=\"{}\"/>",
                self.map.name(),
                coordinate(x),
                coordinate(top),
                coordinate(height)
            );
            for tick in ticks.iter().filter(|t| !t.label.is_empty()) {
                let y = top + (1.0 - tick.at) * height;
                bar += &text(x + 19.0, y + 4.5, "start", "tick", &tick.label);
                let _ = write!(
                    bar,
                    "<path class=\"grid\" d=\"M{} {}h4\"/>",
                    coordinate(x + 14.0),
                    coordinate(y)
                );
            }
            bar += &text(size.width() - 2.0, top - 9.0, "end", "label", &self.label);
        } else {
            let y = top + height + 62.0;
            let _ = write!(
                bar,
                "<rect class=\"frame\" style=\"fill:url(#{}-h)\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"12\"/>",
                self.map.name(),
                coordinate(left),
                coordinate(y),
                coordinate(width)
            );
            for tick in ticks.iter().filter(|t| !t.label.is_empty()) {
                let x = left + tick.at * width;
                bar += &text(x, y + 27.0, "middle", "tick", &tick.label);
                let _ = write!(
                    bar,
                    "<path class=\"grid\" d=\"M{} {}v4\"/>",
                    coordinate(x),
                    coordinate(y + 12.0)
                );
            }
            bar += &text(left, y - 6.0, "start", "label", &self.label);
        }
        plot.raw_outside(&bar);
        plot.finish(alt, &format!("data-image=\"{}\"", self.id))
    }
}
