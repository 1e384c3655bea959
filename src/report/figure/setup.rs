//! A schematic of the set-up: the cross-section, the cameras around it, the light they revealed.

use std::fmt::Write as _;

use super::lighting_curve::{beside_sources, shown_range};
use super::{Figure, Panel};
use crate::pipeline::Run;
use crate::report::number::{fixed, trimmed};
use crate::report::plot::{Size, coordinate, path_data, svg, text};
use crate::report::settings::{number_at, text_at};
use crate::report::table::{Cell, Table};

/// Radii in the drawing: object, cameras, where the light starts and how far it reaches.
const OBJECT: f64 = 46.0;
const CAMERAS: f64 = 100.0;
const LIGHT: [f64; 2] = [116.0, 176.0];
const CENTRE: [f64; 2] = [215.0, 200.0];

fn at(degrees: f64, radius: f64) -> (f64, f64) {
    let (sin, cos) = degrees.to_radians().sin_cos();
    (CENTRE[0] + radius * cos, CENTRE[1] - radius * sin)
}

/// The set-up as seen from above; not to scale.
pub fn setup(run: &Run) -> Figure {
    let mut body = String::new();
    let [cx, cy] = CENTRE.map(coordinate);
    if let Some(lighting) = &run.lighting {
        let [_, high] = shown_range(lighting);
        let parts: Vec<_> = lighting
            .channels
            .iter()
            .map(|c| beside_sources(lighting, c))
            .collect();
        let reach = LIGHT[1] - LIGHT[0];
        let n = parts.iter().map(Vec::len).min().unwrap_or(0);
        let outer = (0..n).map(|i| {
            let mean = parts.iter().map(|p| p[i].value).sum::<f64>() / parts.len() as f64;
            let t = (mean / high).clamp(0.0, 1.0);
            at(parts[0][i].theta_deg, LIGHT[0] + reach * t)
        });
        let inner = (0..n).map(|i| at(parts[0][i].theta_deg, LIGHT[0]));
        let _ = write!(
            body,
            "<path class=\"light\" fill-rule=\"evenodd\" d=\"{}Z{}Z\"/>",
            path_data(outer),
            path_data(inner)
        );
        for source in &lighting.sources {
            let (x0, y0) = at(source.theta_deg, LIGHT[1] + 4.0);
            let (x1, y1) = at(source.theta_deg, OBJECT + 6.0);
            let _ = write!(
                body,
                "<path class=\"ray source\" d=\"{}\"/>",
                path_data([(x0, y0), (x1, y1)])
            );
            let left = at(source.theta_deg + 6.0, OBJECT + 16.0);
            let right = at(source.theta_deg - 6.0, OBJECT + 16.0);
            let _ = write!(
                body,
                "<path class=\"source-head\" d=\"{}Z\"/>",
                path_data([(x1, y1), left, right])
            );
        }
    }
    let _ = write!(
        body,
        "<circle class=\"orbit\" cx=\"{cx}\" cy=\"{cy}\" r=\"{CAMERAS}\"/><circle class=\"object\" cx=\"{cx}\" cy=\"{cy}\" r=\"{OBJECT}\"/>"
    );
    for view in &run.views {
        // A wedge whose point looks at the object.
        let point = at(view.orbit_deg, CAMERAS - 6.0);
        let wing = 2.2;
        let data = path_data([
            point,
            at(view.orbit_deg - wing, CAMERAS + 5.0),
            at(view.orbit_deg + wing, CAMERAS + 5.0),
        ]);
        let _ = write!(body, "<path class=\"camera\" d=\"{data}Z\"/>");
    }
    let axis = path_data([at(0.0, 0.0), at(0.0, OBJECT)]);
    let _ = write!(body, "<path class=\"axis\" d=\"{axis}\"/>");
    let (nx, ny) = at(0.0, OBJECT / 2.0);
    body += &text(nx, ny - 5.0, "middle", "tick", "α = 0");
    for degrees in [0, 90, 180, -90] {
        let (x, y) = at(f64::from(degrees), LIGHT[1] + 18.0);
        body += &text(
            x,
            y + 4.5,
            "middle",
            "tick",
            &format!("{}°", fixed(f64::from(degrees), 0)),
        );
    }
    let shape =
        text_at(&run.capture_toml, &["object", "shape"]).unwrap_or_else(|| "object".to_owned());
    let radius = number_at(&run.capture_toml, &["object", "radius"]);
    let distance = number_at(&run.capture_toml, &["camera", "distance"]);
    let mut size = format!("The {shape}'s cross-section");
    if let Some(radius) = radius {
        size += &format!(" (radius {} mm)", trimmed(radius * 1e3, 4));
    }
    size += &format!(" and {} camera positions", run.views.len());
    if let Some(distance) = distance {
        size += &format!(" at {} m", trimmed(distance, 4));
    }
    let light = match &run.lighting {
        Some(estimate) if estimate.sources.is_empty() => {
            " The shaded ring's thickness is the recovered light from that direction, mean over the channels."
        }
        Some(_) => {
            " The shaded ring's thickness is the recovered light from that direction, mean over the channels; arrows: sources that were found."
        }
        None => "",
    };
    Figure {
        id: "setup",
        title: "Set-up",
        caption: format!(
            "{size}, seen along the object's axis with the plane's normal towards the reader; angles count counter-clockwise. Not to scale.{light}"
        ),
        panels: vec![Panel {
            name: String::new(),
            markup: camera(&run.capture_toml)
                + &svg(
                    Size::Half,
                    Size::Half.width(),
                    2.0 * CENTRE[1],
                    &format!(
                        "Schematic of the set-up: {shape} in the middle, {} cameras around it, the recovered light outside.",
                        run.views.len()
                    ),
                    &body,
                ),
        }],
        table: Table {
            columns: [
                "view",
                "file",
                "orbit_deg",
                "plane_roll_deg",
                "centre_x_px",
                "centre_y_px",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows: run
                .views
                .iter()
                .zip(rolls(&run.capture_toml))
                .enumerate()
                .map(|(i, (v, roll))| {
                    vec![
                        Cell::Fixed(i as f64, 0),
                        Cell::Text(v.file.clone()),
                        Cell::Fixed(v.orbit_deg, 3),
                        Cell::Fixed(roll, 3),
                        Cell::Fixed(v.centre_px[0], 3),
                        Cell::Fixed(v.centre_px[1], 3),
                    ]
                })
                .collect(),
            note: String::new(),
        },
        wide: false,
    }
}

/// Roll of the measurement plane in each view, degrees; then zeros without end.
fn rolls(capture: &str) -> impl Iterator<Item = f64> {
    let capture: toml::Table = toml::from_str(capture).unwrap_or_default();
    let views = capture.get("view").and_then(toml::Value::as_array);
    let rolls: Vec<f64> = views
        .into_iter()
        .flatten()
        .map(|v| v.get("plane_roll_deg"))
        .map(|v| v.and_then(|v| v.as_float().or(v.as_integer().map(|i| i as f64))))
        .map(|v| v.unwrap_or(0.0))
        .collect();
    rolls.into_iter().chain(std::iter::repeat(0.0))
}

/// What the script needs to find the pixel that shows a surface point.
fn camera(capture: &str) -> String {
    let mut out = String::from("<div id=\"camera\" hidden");
    for (attribute, keys) in [
        ("radius", ["object", "radius"]),
        ("distance", ["camera", "distance"]),
        ("focal", ["camera", "focal_px"]),
        ("across", ["camera", "width_m"]),
    ] {
        if let Some(value) = number_at(capture, &keys) {
            out += &format!(" data-{attribute}=\"{value}\"");
        }
    }
    let size: Option<toml::Table> = toml::from_str(capture).ok();
    let width = size
        .as_ref()
        .and_then(|t| t.get("camera")?.get("image_size")?.get(0)?.as_integer());
    if let Some(width) = width {
        out += &format!(" data-width=\"{width}\"");
    }
    out + "></div>"
}
