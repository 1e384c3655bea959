//! A small kit of scientific plots as SVG: axes, curves with bands, images with a colour bar, polar.
//!
//! Colours come from the page's style sheet (classes), so that one drawing serves light, dark and
//! paper. Every drawing exists in the sizes that its figure needs; text is never scaled far from the
//! size it is meant for.

mod cartesian;
pub mod colour;
mod heat_map;
mod polar;
pub mod scale;

pub use cartesian::{Axis, Legend, Mark, Plot};
pub use colour::{ColourMap, data_uri};
pub use heat_map::{HeatMap, ReadOut};
pub use polar::Polar;
pub use scale::{Scale, bounds, quantile};

use std::fmt::Write as _;

use super::number::write_decimals;

/// The drawing sizes, in the user units of the SVG (about CSS pixels).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Across the page.
    Wide,
    /// Across a phone.
    Narrow,
    /// Half the page, or a phone.
    Half,
}

impl Size {
    /// Width of the drawing.
    pub fn width(self) -> f64 {
        match self {
            Self::Wide => 880.0,
            Self::Narrow => 350.0,
            Self::Half => 430.0,
        }
    }

    /// Class of the `<svg>`, by which the page shows the one that fits.
    pub fn class(self) -> &'static str {
        match self {
            Self::Wide => "wide",
            Self::Narrow => "narrow",
            Self::Half => "half",
        }
    }

    /// Whether there is room for detail along x.
    pub fn is_wide(self) -> bool {
        self == Self::Wide
    }
}

/// The class that colours and dashes a channel's curve: by name for red, green and blue, else by turn.
pub fn series_class(name: &str, index: usize) -> &'static str {
    const OTHERS: [&str; 6] = ["s-a", "s-b", "s-c", "s-d", "s-e", "s-f"];
    match name {
        "R" => "s-r",
        "G" => "s-g",
        "B" => "s-b3",
        "Y" => "s-a",
        _ => OTHERS[index % OTHERS.len()],
    }
}

/// Text made safe inside markup and attributes.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            _ => out.push(c),
        }
    }
    out
}

/// Text with subscripts written `_[…]` as HTML; everything else is made safe.
pub fn html_text(text: &str) -> String {
    subscripts(&escape(text), "<sub>", "</sub>")
}

fn subscripts(escaped: &str, open: &str, close: &str) -> String {
    let mut out = String::with_capacity(escaped.len() + 16);
    let mut rest = escaped;
    while let Some((before, after)) = rest.split_once("_[") {
        let Some((inside, behind)) = after.split_once(']') else {
            break;
        };
        out += before;
        out += open;
        out += inside;
        out += close;
        rest = behind;
    }
    out + rest
}

/// An `<svg>` of the given size around `body`, described for those who cannot see it.
pub fn svg(size: Size, width: f64, height: f64, alt: &str, body: &str) -> String {
    format!(
        "<svg class=\"{}\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">{body}</svg>",
        size.class(),
        coordinate(width),
        coordinate(height),
        escape(alt)
    )
}

/// A coordinate with a tenth of a unit; what is not finite is put far outside.
pub fn coordinate(value: f64) -> String {
    let value = if value.is_finite() {
        value.clamp(-99_999.0, 99_999.0)
    } else {
        -99_999.0
    };
    let mut text = String::new();
    write_decimals(value, 1, &mut text);
    let text = text.strip_suffix(".0").unwrap_or(&text);
    if text == "-0" { "0" } else { text }.to_owned()
}

/// A `<text>` element with subscripts written `_[…]`; `anchor` is `start`, `middle` or `end`.
pub fn text(x: f64, y: f64, anchor: &str, class: &str, content: &str) -> String {
    format!(
        "<text x=\"{}\" y=\"{}\" text-anchor=\"{anchor}\" class=\"{class}\">{}</text>",
        coordinate(x),
        coordinate(y),
        // A shift that is undone by the text that follows works in every renderer.
        subscripts(
            &escape(content),
            "<tspan dy=\"3\" class=\"sub\">",
            "</tspan><tspan dy=\"-3\">\u{200b}</tspan>"
        )
    )
}

/// Points as the data of a path; points that are not finite break it. Steps from point to point, which are half as long to write as
/// the points, are taken between rounded points, so that they do not add up errors.
pub fn path_data(points: impl IntoIterator<Item = (f64, f64)>) -> String {
    let tenths = |v: f64| (10.0 * v.clamp(-99_999.0, 99_999.0)).round() as i64;
    let mut out = String::new();
    let mut last: Option<(i64, i64)> = None;
    let mut stepping = false;
    for (x, y) in points {
        if !x.is_finite() || !y.is_finite() {
            last = None;
            continue;
        }
        let at = (tenths(x), tenths(y));
        let (command, pair) = match last {
            Some(from) => ("l", (at.0 - from.0, at.1 - from.1)),
            None => ("M", at),
        };
        if command == "M" || !stepping {
            out += command;
        } else if pair.0 >= 0 {
            out.push(' ');
        }
        push_tenths(&mut out, pair.0);
        if pair.1 >= 0 {
            out.push(' ');
        }
        push_tenths(&mut out, pair.1);
        stepping = command == "l";
        last = Some(at);
    }
    out
}

/// The shortest decimal of a number of tenths: `-.3`, `12`, `4.5`.
fn push_tenths(out: &mut String, tenths: i64) {
    if tenths < 0 {
        out.push('-');
    }
    let (whole, tenth) = (tenths.abs() / 10, tenths.abs() % 10);
    if whole != 0 || tenth == 0 {
        let _ = write!(out, "{whole}");
    }
    if tenth != 0 {
        let _ = write!(out, ".{tenth}");
    }
}

/// Width of a text of 13 units' height, roughly: enough to lay out legends.
pub fn text_width(text: &str) -> f64 {
    7.0 * text.chars().count() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subscripts_are_set_and_everything_else_is_text() {
        assert_eq!(html_text("|B_[pq]| < 1"), "|B<sub>pq</sub>| &lt; 1");
        assert_eq!(html_text("a_[<b>"), "a_[&lt;b&gt;");
        assert_eq!(html_text("x_[<i>]_["), "x<sub>&lt;i&gt;</sub>_[");
        assert_eq!(escape("\"'&"), "&quot;&#39;&amp;");
    }

    #[test]
    fn a_path_is_broken_where_a_value_is_missing() {
        let points = [(0.0, 1.0), (1.0, 2.04), (f64::NAN, 0.0), (3.0, -0.01)];
        assert_eq!(path_data(points), "M0 1l1 1M3 0");
        let steps = [(1.23, -0.06), (1.28, 0.0), (0.9, 0.71), (12.0, 4.55)];
        assert_eq!(path_data(steps), "M1.2-.1l.1 .1-.4 .7 11.1 3.9");
    }

    #[test]
    fn a_point_lies_where_its_axes_say() {
        let x = Axis::degrees("x", -180.0, 180.0, 90.0);
        let y = Axis::new("y", Scale::log(1e-4, 1.0), 4);
        let mut plot = Plot::new(Size::Half, 200.0, x, y);
        let [_, _, width, _] = plot.area();
        plot.point(90.0, 1e-2, Mark::Disc, "s-a");
        let svg = plot.finish("", "");
        // Three quarters along x; half way down of four decades.
        let place = format!("cx=\"{}\" cy=\"100\"", coordinate(0.75 * width));
        assert!(svg.contains(&place), "{place} in {svg}");
    }

    #[test]
    fn light_from_above_is_drawn_above() {
        let mut polar = Polar::new(Size::Half, Scale::linear(0.0, 1.0), "L");
        let quarter = std::f64::consts::FRAC_PI_2;
        polar.curve(&[(0.0, 1.0), (quarter, 1.0)], "s-a");
        let svg = polar.finish("");
        // Radius 430/2 − 44 = 171 about (215, 221): right edge (386, 221), top (215, 50).
        assert!(svg.contains("d=\"M386 221l-171-171Z\""), "{svg}");
    }
}
