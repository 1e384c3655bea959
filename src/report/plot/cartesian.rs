//! A plot with two axes: curves, bands, bars, points, all clipped to the plot area.

use std::fmt::Write as _;

use super::scale::{Scale, Tick};
use super::{Size, coordinate, escape, path_data, svg, text, text_width};

/// An axis: its range, its ticks and what it shows.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Range and spacing.
    pub scale: Scale,
    /// Quantity and unit.
    pub label: String,
    /// Marks.
    pub ticks: Vec<Tick>,
}

impl Axis {
    /// An axis with some `count` ticks at round values.
    pub fn new(label: impl Into<String>, scale: Scale, count: usize) -> Self {
        Self {
            scale,
            label: label.into(),
            ticks: scale.ticks(count),
        }
    }

    /// An axis of whole numbers with some `count` ticks.
    pub fn whole(label: impl Into<String>, low: f64, high: f64, count: usize) -> Self {
        let scale = Scale::linear(low, high);
        Self {
            scale,
            label: label.into(),
            ticks: scale.whole_ticks(count),
        }
    }

    /// An axis of angles in degrees with a tick every `step`.
    pub fn degrees(label: impl Into<String>, low: f64, high: f64, step: f64) -> Self {
        let scale = Scale::linear(low, high);
        Self {
            scale,
            label: label.into(),
            ticks: scale.ticks_every(step),
        }
    }
}

/// An entry of a legend.
#[derive(Clone, Debug)]
pub struct Legend {
    /// Class of the swatch.
    pub class: String,
    /// What the swatch looks like.
    pub mark: Mark,
    /// What it stands for.
    pub label: String,
}

/// Shapes of points and swatches; they differ in form, not only in colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A line.
    Line,
    /// A filled area.
    Band,
    /// A filled disc.
    Disc,
    /// A ring.
    Ring,
    /// A cross.
    Cross,
}

/// A drawing under construction.
#[derive(Debug)]
pub struct Plot {
    size: Size,
    height: f64,
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    x: Axis,
    y: Axis,
    legend: Vec<Legend>,
    grid: bool,
    inside: String,
    outside: String,
}

impl Plot {
    /// An empty plot; `plot_height` is that of the area inside the axes.
    pub fn new(size: Size, plot_height: f64, x: Axis, y: Axis) -> Self {
        let widest = y
            .ticks
            .iter()
            .map(|t| text_width(&t.label))
            .fold(0.0, f64::max);
        let (top, bottom) = (22.0, 46.0);
        let left = (widest + 14.0).max(44.0);
        let mut x = x;
        thin_labels(&mut x.ticks, size.width() - left - 12.0);
        Self {
            size,
            height: plot_height + top + bottom,
            left,
            right: 12.0,
            top,
            bottom,
            x,
            y,
            legend: Vec::new(),
            grid: true,
            inside: String::new(),
            outside: String::new(),
        }
    }

    /// Without grid lines, for images.
    #[must_use]
    pub fn without_grid(mut self) -> Self {
        self.grid = false;
        self
    }

    /// With a legend above the plot area.
    #[must_use]
    pub fn with_legend(mut self, legend: Vec<Legend>) -> Self {
        let rows = legend_rows(&legend, self.size.width() - self.left).len() as f64;
        let extra = if legend.is_empty() {
            0.0
        } else {
            18.0 * rows + 4.0
        };
        self.top += extra;
        self.height += extra;
        self.legend = legend;
        self
    }

    /// With more room on the right and at the bottom, for a colour bar.
    #[must_use]
    pub fn with_margins(mut self, right: f64, bottom: f64) -> Self {
        self.right += right;
        self.bottom += bottom;
        self.height += bottom;
        self
    }

    /// Left, top, width and height of the plot area.
    pub fn area(&self) -> [f64; 4] {
        [
            self.left,
            self.top,
            self.size.width() - self.left - self.right,
            self.height - self.top - self.bottom,
        ]
    }

    fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let [_, _, width, height] = self.area();
        (
            self.x.scale.position(x) * width,
            // A value of 0 on a logarithmic axis is drawn far below it, not left out.
            (1.0 - self.y.scale.position(y).clamp(-9.0, 9.0)) * height,
        )
    }

    /// A curve through the points.
    pub fn line(&mut self, points: &[(f64, f64)], class: &str) {
        let data = path_data(points.iter().map(|&(x, y)| {
            if x.is_finite() && y.is_finite() {
                self.at(x, y)
            } else {
                (f64::NAN, f64::NAN)
            }
        }));
        let _ = write!(self.inside, "<path class=\"line {class}\" d=\"{data}\"/>");
    }

    /// A band between two curves over the same x: (x, low, high).
    pub fn band(&mut self, points: &[(f64, f64, f64)], class: &str) {
        let usable: Vec<_> = points
            .iter()
            .filter(|(x, a, b)| x.is_finite() && a.is_finite() && b.is_finite())
            .collect();
        if usable.is_empty() {
            return;
        }
        let above = usable.iter().map(|(x, _, high)| self.at(*x, *high));
        let below = usable.iter().rev().map(|(x, low, _)| self.at(*x, *low));
        let data = path_data(above.chain(below));
        let _ = write!(self.inside, "<path class=\"band {class}\" d=\"{data}Z\"/>");
    }

    /// A bar from the lower axis between two x.
    pub fn bar(&mut self, from: f64, to: f64, value: f64, class: &str) {
        let [_, _, _, height] = self.area();
        let (x0, y) = self.at(from, value);
        let (x1, _) = self.at(to, value);
        let _ = write!(
            self.inside,
            "<rect class=\"bar {class}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
            coordinate(x0),
            coordinate(y),
            coordinate((x1 - x0).max(0.2)),
            coordinate((height - y).max(0.0))
        );
    }

    /// A point.
    pub fn point(&mut self, x: f64, y: f64, mark: Mark, class: &str) {
        let (cx, cy) = self.at(x, y);
        self.inside.push_str(&draw_mark(cx, cy, mark, class));
    }

    /// A vertical error bar.
    pub fn error_bar(&mut self, x: f64, low: f64, high: f64, class: &str) {
        let (cx, y0) = self.at(x, low);
        let (_, y1) = self.at(x, high);
        let _ = write!(
            self.inside,
            "<path class=\"error {class}\" d=\"{}\"/>",
            path_data([(cx, y0), (cx, y1)])
        );
    }

    /// A vertical line across the plot with words near its top, on the given row of text so that those
    /// of neighbours can be kept apart.
    pub fn vertical(&mut self, x: f64, class: &str, words: &str, row: usize) {
        let [_, _, width, height] = self.area();
        let (cx, _) = self.at(x, self.y.scale.high());
        let _ = write!(
            self.inside,
            "<path class=\"rule {class}\" d=\"{}\"/>",
            path_data([(cx, 0.0), (cx, height)])
        );
        if !words.is_empty() {
            let (anchor, offset) = if cx > 0.6 * width {
                ("end", -5.0)
            } else {
                ("start", 5.0)
            };
            self.inside.push_str(&text(
                cx + offset,
                14.0 + 17.0 * row as f64,
                anchor,
                "note halo",
                words,
            ));
        }
    }

    /// Markup in plot-area coordinates (clipped to it).
    pub fn raw_inside(&mut self, markup: &str) {
        self.inside.push_str(markup);
    }

    /// Markup in the drawing's coordinates.
    pub fn raw_outside(&mut self, markup: &str) {
        self.outside.push_str(markup);
    }

    /// The finished `<svg>`; `alt` describes it in words, `data` are attributes for the read-out under
    /// the pointer (`data-…`, already escaped).
    pub fn finish(self, alt: &str, data: &str) -> String {
        let [left, top, width, height] = self.area();
        let mut body = String::new();
        let _ = write!(
            body,
            "<rect class=\"plot-back\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
            coordinate(left),
            coordinate(top),
            coordinate(width),
            coordinate(height)
        );
        // The script draws others when a part of the plot is shown larger.
        body += "<g class=\"axes\">";
        let mut grid = String::new();
        for tick in &self.x.ticks {
            let x = left + tick.at * width;
            let length = if tick.label.is_empty() { 3.0 } else { 5.0 };
            grid += &path_data([(x, top + height), (x, top + height + length)]);
            if self.grid && !tick.label.is_empty() {
                grid += &path_data([(x, top), (x, top + height)]);
            }
            if !tick.label.is_empty() {
                body += &text(x, top + height + 18.0, "middle", "tick", &tick.label);
            }
        }
        for tick in &self.y.ticks {
            let y = top + (1.0 - tick.at) * height;
            let length = if tick.label.is_empty() { 3.0 } else { 5.0 };
            grid += &path_data([(left - length, y), (left, y)]);
            if self.grid && !tick.label.is_empty() {
                grid += &path_data([(left, y), (left + width, y)]);
            }
            if !tick.label.is_empty() {
                body += &text(left - 8.0, y + 4.5, "end", "tick", &tick.label);
            }
        }
        let _ = write!(body, "<path class=\"grid\" d=\"{grid}\"/></g>");
        body += &text(
            left + width / 2.0,
            top + height + 38.0,
            "middle",
            "label",
            &self.x.label,
        );
        body += &text(4.0, top - 9.0, "start", "label", &self.y.label);
        body += &self.draw_legend();
        let _ = write!(
            body,
            "<svg class=\"inside\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" overflow=\"hidden\">{}</svg>",
            coordinate(left),
            coordinate(top),
            coordinate(width),
            coordinate(height),
            self.inside
        );
        let _ = write!(
            body,
            "<rect class=\"frame area\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"{}{} {data}/>",
            coordinate(left),
            coordinate(top),
            coordinate(width),
            coordinate(height),
            scale_attributes('x', &self.x.scale),
            scale_attributes('y', &self.y.scale)
        );
        body += &self.outside;
        svg(self.size, self.size.width(), self.height, alt, &body)
    }

    fn draw_legend(&self) -> String {
        let mut out = String::new();
        let mut y = 13.0;
        for row in legend_rows(&self.legend, self.size.width() - self.left) {
            let mut x = self.left;
            for entry in row {
                match entry.mark {
                    Mark::Line => {
                        let _ = write!(
                            out,
                            "<path class=\"line {}\" d=\"{}\"/>",
                            escape(&entry.class),
                            path_data([(x, y - 4.0), (x + 26.0, y - 4.0)])
                        );
                    }
                    Mark::Band => {
                        let _ = write!(
                            out,
                            "<rect class=\"band {}\" x=\"{}\" y=\"{}\" width=\"26\" height=\"11\"/>",
                            escape(&entry.class),
                            coordinate(x),
                            coordinate(y - 10.0)
                        );
                    }
                    mark => out += &draw_mark(x + 13.0, y - 4.0, mark, &entry.class),
                }
                out += &text(x + 32.0, y, "start", "tick", &entry.label);
                x += legend_width(entry);
            }
            y += 18.0;
        }
        out
    }
}

/// Takes every other label away until they do not touch on an axis of this length.
fn thin_labels(ticks: &mut [Tick], length: f64) {
    loop {
        let labelled: Vec<usize> = (0..ticks.len())
            .filter(|&i| !ticks[i].label.is_empty())
            .collect();
        let crowded = labelled.windows(2).any(|pair| {
            let (a, b) = (&ticks[pair[0]], &ticks[pair[1]]);
            let wanted = (text_width(&a.label) + text_width(&b.label)) / 2.0 + 8.0;
            (b.at - a.at).abs() * length < wanted
        });
        if !crowded || labelled.len() < 3 {
            return;
        }
        for index in labelled.into_iter().skip(1).step_by(2) {
            ticks[index].label.clear();
        }
    }
}

fn scale_attributes(axis: char, scale: &Scale) -> String {
    format!(
        " data-{axis}0=\"{}\" data-{axis}1=\"{}\" data-{axis}-spacing=\"{}\"",
        scale.low(),
        scale.high(),
        scale.spacing().word()
    )
}

fn legend_width(entry: &Legend) -> f64 {
    32.0 + text_width(&entry.label) + 16.0
}

fn legend_rows(legend: &[Legend], width: f64) -> Vec<Vec<&Legend>> {
    let mut rows: Vec<Vec<&Legend>> = Vec::new();
    let mut used = f64::INFINITY;
    for entry in legend {
        let wanted = legend_width(entry);
        match rows.last_mut() {
            Some(row) if used + wanted <= width + 16.0 => {
                row.push(entry);
                used += wanted;
            }
            _ => {
                rows.push(vec![entry]);
                used = wanted;
            }
        }
    }
    rows
}

fn draw_mark(x: f64, y: f64, mark: Mark, class: &str) -> String {
    match mark {
        Mark::Ring | Mark::Disc => format!(
            "<circle class=\"{} {}\" cx=\"{}\" cy=\"{}\" r=\"3.5\"/>",
            if mark == Mark::Ring { "ring" } else { "disc" },
            escape(class),
            coordinate(x),
            coordinate(y)
        ),
        _ => format!(
            "<path class=\"cross {}\" d=\"{}{}\"/>",
            escape(class),
            path_data([(x - 3.5, y - 3.5), (x + 3.5, y + 3.5)]),
            path_data([(x - 3.5, y + 3.5), (x + 3.5, y - 3.5)])
        ),
    }
}
