//! A polar plot: directions in the measurement plane, counter-clockwise from the reference axis.

use std::fmt::Write as _;

use super::scale::Scale;
use super::{Size, coordinate, path_data, svg, text};

/// A polar drawing under construction.
#[derive(Debug)]
pub struct Polar {
    size: Size,
    radius: f64,
    centre: [f64; 2],
    scale: Scale,
    body: String,
    over: String,
}

impl Polar {
    /// Rings from 0 to the scale's high end; `label` says what the radius shows.
    pub fn new(size: Size, scale: Scale, label: &str) -> Self {
        let width = size.width();
        let radius = width / 2.0 - 44.0;
        let centre = [width / 2.0, radius + 50.0];
        let mut polar = Self {
            size,
            radius,
            centre,
            scale,
            body: String::new(),
            over: String::new(),
        };
        let [cx, cy] = centre;
        let _ = write!(
            polar.body,
            "<circle class=\"plot-back\" cx=\"{0}\" cy=\"{1}\" r=\"{2}\"/><circle class=\"rim-line\" cx=\"{0}\" cy=\"{1}\" r=\"{2}\"/>",
            coordinate(cx),
            coordinate(cy),
            coordinate(radius)
        );
        for tick in scale.ticks(4).iter().filter(|t| t.at > 0.0) {
            let _ = write!(
                polar.body,
                "<circle class=\"grid\" cx=\"{}\" cy=\"{}\" r=\"{}\"/>",
                coordinate(cx),
                coordinate(cy),
                coordinate(tick.at * radius)
            );
            // Along −75°, where light from above the horizon of a usual set-up leaves room.
            let (x, y) = polar.at(-75f64.to_radians(), tick.at * radius);
            polar.over += &text(x + 3.0, y - 3.0, "start", "tick halo", &tick.label);
        }
        for degrees in (0..360).step_by(30) {
            let angle = f64::from(degrees).to_radians();
            let edge = polar.at(angle, radius);
            let _ = write!(
                polar.body,
                "<path class=\"grid\" d=\"{}\"/>",
                path_data([(cx, cy), edge])
            );
            let (x, y) = polar.at(angle, radius + 18.0);
            let signed = if degrees > 180 {
                degrees - 360
            } else {
                degrees
            };
            let words = format!("{}°", crate::report::number::fixed(f64::from(signed), 0));
            polar.body += &text(x, y + 4.5, "middle", "tick", &words);
        }
        polar.body += &text(4.0, 16.0, "start", "label", label);
        polar
    }

    /// Drawing coordinates of a direction (radians) at a distance from the centre (drawing units).
    fn at(&self, angle: f64, distance: f64) -> (f64, f64) {
        (
            self.centre[0] + distance * angle.cos(),
            self.centre[1] - distance * angle.sin(),
        )
    }

    fn place(&self, angle: f64, value: f64) -> (f64, f64) {
        let t = self.scale.position(value).clamp(0.0, 1.0);
        self.at(angle, t * self.radius)
    }

    /// A closed curve of (direction in radians, value).
    pub fn curve(&mut self, points: &[(f64, f64)], class: &str) {
        let data = path_data(
            points
                .iter()
                .map(|&(angle, value)| self.place(angle, value)),
        );
        let _ = write!(self.body, "<path class=\"line {class}\" d=\"{data}Z\"/>");
    }

    /// A band between two closed curves: (direction, low, high).
    pub fn band(&mut self, points: &[(f64, f64, f64)], class: &str) {
        let outer = path_data(points.iter().map(|&(a, _, high)| self.place(a, high)));
        let inner = path_data(points.iter().map(|&(a, low, _)| self.place(a, low)));
        let _ = write!(
            self.body,
            "<path class=\"band {class}\" fill-rule=\"evenodd\" d=\"{outer}Z{inner}Z\"/>"
        );
    }

    /// A ray at a direction (radians) to the rim, with words beyond the middle.
    pub fn ray(&mut self, angle: f64, class: &str, words: &str) {
        let data = path_data([self.at(angle, 0.0), self.at(angle, self.radius)]);
        let _ = write!(self.body, "<path class=\"ray {class}\" d=\"{data}\"/>");
        let (x, y) = self.at(angle, self.radius * 0.78);
        let (anchor, offset) = if angle.cos() > 0.0 {
            ("end", -7.0)
        } else {
            ("start", 7.0)
        };
        self.over += &text(x + offset, y - 3.0, anchor, "note halo", words);
    }

    /// The finished `<svg>`.
    pub fn finish(self, alt: &str) -> String {
        let height = 2.0 * self.radius + 80.0;
        svg(
            self.size,
            self.size.width(),
            height,
            alt,
            &format!("{}{}", self.body, self.over),
        )
    }
}
