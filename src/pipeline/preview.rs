//! Photos made small, with outline and measured line, for the report.

use super::run::Preview;
use crate::geometry::{Side, ViewGeometry};
use crate::radiance::Radiance;

/// Largest width of a preview, pixels.
const WIDTH: u32 = 480;

/// A preview of the rows that `radiance` holds.
pub fn preview(view: usize, radiance: &Radiance, geometry: &ViewGeometry, reach: f64) -> Preview {
    let width = radiance.size[0];
    let rows = radiance.rows.end - radiance.rows.start;
    let step = width.div_ceil(WIDTH).max(1);
    let size = [width.div_ceil(step), rows.div_ceil(step)];
    let scale = f64::from(step);
    let top = f64::from(radiance.rows.start);
    // R, G, B if there are three channels or more, else grey.
    let shown: Vec<usize> = ["R", "G", "B"]
        .iter()
        .filter_map(|name| radiance.channels.iter().position(|c| c == name))
        .collect();
    let shown = if shown.len() == 3 { shown } else { vec![0; 3] };
    let white = brightest(radiance, &shown);
    let mut rgb = Vec::with_capacity((size[0] * size[1] * 3) as usize);
    for y in 0..size[1] {
        for x in 0..size[0] {
            for &c in &shown {
                let (mut sum, mut count) = (0.0f32, 0.0f32);
                for row in y * step..((y + 1) * step).min(rows) {
                    for column in x * step..((x + 1) * step).min(width) {
                        sum += radiance.value[c][(row * width + column) as usize];
                        count += 1.0;
                    }
                }
                rgb.push(srgb(sum / (count * white)));
            }
        }
    }
    let to_preview = |p: [f64; 2]| [p[0] / scale, (p[1] - top) / scale];
    let outline = Side::BOTH
        .iter()
        .map(|&side| {
            (0..=8)
                .filter_map(|k| {
                    let row = top + f64::from(rows) * f64::from(k) / 8.0;
                    Some(to_preview([geometry.limb_at_row(row, side)?, row]))
                })
                .collect()
        })
        .collect();
    let measured_line: Vec<[f64; 2]> = Side::BOTH
        .iter()
        .filter_map(|&side| geometry.limb(side))
        .map(|p| to_preview(p.pixel))
        .collect();
    let middle =
        measured_line.iter().map(|p| p[1]).sum::<f64>() / measured_line.len().max(1) as f64;
    Preview {
        view,
        size,
        rgb,
        scale,
        outline,
        measured_line,
        measured_rows: [middle - reach / scale, middle + reach / scale],
    }
}

/// The value shown as white: the 99.5th percentile over the shown channels, by a sparse sample.
fn brightest(radiance: &Radiance, shown: &[usize]) -> f32 {
    let mut values: Vec<f32> = shown
        .iter()
        .flat_map(|&c| radiance.value[c].iter().step_by(7).copied())
        .filter(|v| v.is_finite())
        .collect();
    values.sort_by(f32::total_cmp);
    let at = values
        .len()
        .saturating_sub(1)
        .min(values.len() * 995 / 1000);
    values
        .get(at)
        .copied()
        .unwrap_or(1.0)
        .max(f32::MIN_POSITIVE)
}

/// The sRGB code of a linear value in 0 … 1.
fn srgb(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    };
    (255.0 * encoded).round() as u8
}
