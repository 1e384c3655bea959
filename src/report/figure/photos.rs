//! A few photographs with what was found in them.

use std::fmt::Write as _;

use super::{Figure, Panel};
use crate::error::{Error, Result};
use crate::pipeline::{Preview, Run, ViewRecord};
use crate::report::number::{count, fixed, short};
use crate::report::plot::{coordinate, data_uri, escape, path_data};
use crate::report::table::{Cell, Table};

/// At most this many photos are put into the page.
const SHOWN: usize = 6;

/// Slope of the measured line (degrees) from which it is a rolled plane's and not the lens's.
const LEAST_ROLL: f64 = 2.0;

/// Photos with outline, measured line and rows drawn over them; `None` if there is no preview.
///
/// # Errors
/// If a preview's pixels do not fit its size, or it cannot be encoded.
pub fn photos(run: &Run) -> Result<Option<Figure>> {
    let usable: Vec<&Preview> = run
        .previews
        .iter()
        .filter(|p| p.size[0] > 0 && p.size[1] > 0)
        .collect();
    // Strips lie one above the other, taller photos two in a row.
    let tall = usable.iter().any(|p| p.size[0] < 2 * p.size[1]);
    let mut markup = format!("<div class=\"photos{}\">", if tall { " tall" } else { "" });
    let step = usable.len().div_ceil(SHOWN).max(1);
    for preview in usable.iter().step_by(step) {
        let view = run.views.get(preview.view);
        let words = view.map_or_else(
            || format!("view {}", preview.view),
            |v| describe(preview.view, v),
        );
        markup += &format!(
            "<div class=\"photo\">{}<p>{}</p></div>",
            draw(preview, &words)?,
            escape(&words)
        );
    }
    markup += "</div>";
    Ok((!usable.is_empty()).then(|| Figure {
        id: "photos",
        title: "Photographs and what was found in them",
        caption: "Solid, orange: the outline of the object. Dashed, blue: the line of the cross-section along which was measured. \
                  Lightened band between the white lines: the rows that were averaged. \
                  Striped: pixels that a mask, or clipping in every exposure, leaves out. Brightness is for the eye only."
            .to_owned(),
        panels: vec![Panel {
            name: String::new(),
            markup,
        }],
        table: table(run),
        wide: false,
    }))
}

fn describe(index: usize, view: &ViewRecord) -> String {
    let limbs = match view.limbs_seen {
        [true, true] => "both limbs seen",
        [true, false] => "only the left limb seen",
        [false, true] => "only the right limb seen",
        [false, false] => "no limb seen",
    };
    format!(
        "View {index}, {} at {}°: half width {} px, centre ± {} px, {limbs}, {} samples",
        view.file,
        fixed(view.orbit_deg, 2),
        fixed(view.radius_px, 2),
        short(view.centre_sigma_px, 2),
        count(view.samples)
    )
}

fn draw(preview: &Preview, words: &str) -> Result<String> {
    let [width, height] = preview.size;
    let photo = photo_uri(preview)?;
    let [first, last] = preview.measured_rows;
    let rows = (last - first).max(0.0);
    // The band lies along a plane that was rolled; else it is rows of the photo.
    let roll = match preview.measured_line.as_slice() {
        [from, .., to] => (to[1] - from[1]).atan2(to[0] - from[0]).to_degrees(),
        _ => 0.0,
    };
    let roll = if roll.abs() < LEAST_ROLL { 0.0 } else { roll };
    let middle = preview
        .measured_line
        .iter()
        .fold([0.0, 0.0], |sum, p| [sum[0] + p[0], sum[1] + p[1]])
        .map(|sum| sum / preview.measured_line.len().max(1) as f64);
    let reach = f64::from(width.max(height));
    let (left, length) = (middle[0] - 2.0 * reach, 4.0 * reach);
    let mut over = String::new();
    let _ = write!(
        over,
        "<g transform=\"rotate({} {} {})\"><rect class=\"rows\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
        coordinate(roll),
        coordinate(middle[0]),
        coordinate(middle[1]),
        coordinate(left),
        coordinate(first),
        coordinate(length),
        coordinate(rows)
    );
    for y in [first, last] {
        let _ = write!(
            over,
            "<path class=\"row-edge\" d=\"M{} {}h{}\"/>",
            coordinate(left),
            coordinate(y),
            coordinate(length)
        );
    }
    over += "</g>";
    for (lines, class) in [
        (preview.outline.as_slice(), "outline"),
        (std::slice::from_ref(&preview.measured_line), "measured"),
    ] {
        for line in lines {
            let data = path_data(line.iter().map(|p| (p[0], p[1])));
            // A dark rim keeps the line visible on bright and on dark ground.
            let _ = write!(
                over,
                "<path class=\"rim\" d=\"{data}\"/><path class=\"{class}\" d=\"{data}\"/>"
            );
        }
    }
    Ok(format!(
        "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{}\"><image width=\"{width}\" height=\"{height}\" href=\"{photo}\"/>{over}</svg>",
        escape(&format!(
            "Photograph with outline and measured line. {words}"
        ))
    ))
}

/// The preview as JPEG: photographs are smaller so, and nobody measures in them.
fn photo_uri(preview: &Preview) -> Result<String> {
    let [width, height] = preview.size;
    if preview.rgb.len() != width as usize * height as usize * 3 {
        return Err(Error::failed(format!(
            "the preview of {width} × {height} pixels holds {} bytes instead of 3 per pixel",
            preview.rgb.len()
        ))
        .view(preview.view));
    }
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 88)
        .encode(&preview.rgb, width, height, image::ExtendedColorType::Rgb8)
        .map_err(|e| Error::failed(format!("cannot encode a preview: {e}")).view(preview.view))?;
    Ok(data_uri("image/jpeg", &bytes))
}

fn table(run: &Run) -> Table {
    let columns = [
        "view",
        "file",
        "orbit_deg",
        "centre_x_px",
        "centre_y_px",
        "centre_sigma_px",
        "radius_px",
        "left_limb",
        "right_limb",
        "samples",
    ];
    let seen = |limb: bool| Cell::Text(if limb { "seen" } else { "not seen" }.to_owned());
    let rows = run
        .views
        .iter()
        .enumerate()
        .map(|(i, v)| {
            vec![
                Cell::Fixed(i as f64, 0),
                Cell::Text(v.file.clone()),
                Cell::Fixed(v.orbit_deg, 3),
                Cell::Fixed(v.centre_px[0], 3),
                Cell::Fixed(v.centre_px[1], 3),
                Cell::Number(v.centre_sigma_px),
                Cell::Fixed(v.radius_px, 3),
                seen(v.limbs_seen[0]),
                seen(v.limbs_seen[1]),
                Cell::Fixed(v.samples as f64, 0),
            ]
        })
        .collect();
    Table {
        columns: columns.map(str::to_owned).to_vec(),
        rows,
        note: "All views, those that are not pictured too.".to_owned(),
    }
}
