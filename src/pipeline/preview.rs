//! Photos made small, with outline and measured line, for the report.

use super::run::Preview;
use crate::geometry::{Side, ViewGeometry};
use crate::radiance::Radiance;

/// Largest width of a preview, pixels.
const WIDTH: u32 = 480;

/// Rows at which the outline is drawn: those of a whole sphere look round.
const ROWS: u32 = 64;

/// Stripes of this width (preview pixels) and colour, on black, mark what masks or clipping leave out: the reddish purple of Okabe
/// and Ito's colours, which no photograph of light on a material has in stripes.
const STRIPE: u32 = 4;
const LEFT_OUT: [u8; 3] = [204, 121, 167];

/// A preview of the rows that `radiance` holds.
pub fn preview(view: usize, radiance: &Radiance, geometry: &ViewGeometry, reach: f64) -> Preview {
    let width = radiance.size[0];
    let rows = radiance.rows.end - radiance.rows.start;
    let step = width.div_ceil(WIDTH).max(1);
    let size = [width.div_ceil(step), rows.div_ceil(step)];
    let scale = f64::from(step);
    let top = f64::from(radiance.rows.start);
    let rgb = colours(radiance, step, size);
    let to_preview = |p: [f64; 2]| [p[0] / scale, (p[1] - top) / scale];
    let outline = Side::BOTH
        .iter()
        .map(|&side| {
            (0..=ROWS)
                .filter_map(|k| {
                    let row = top + f64::from(rows) * f64::from(k) / f64::from(ROWS);
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

/// The preview's sRGB bytes, a cell of `step` × `step` photo pixels each.
fn colours(radiance: &Radiance, step: u32, size: [u32; 2]) -> Vec<u8> {
    let width = radiance.size[0];
    let rows = radiance.rows.end - radiance.rows.start;
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
            let cell = |c: usize| -> Option<f32> {
                let (mut sum, mut count) = (0.0f32, 0.0f32);
                for row in y * step..((y + 1) * step).min(rows) {
                    for column in x * step..((x + 1) * step).min(width) {
                        let at = (row * width + column) as usize;
                        if radiance.variance[c][at].is_finite() {
                            sum += radiance.value[c][at];
                            count += 1.0;
                        }
                    }
                }
                (count > 0.0).then_some(sum / count)
            };
            match [cell(shown[0]), cell(shown[1]), cell(shown[2])] {
                [None, None, None] => rgb.extend(if ((x + y) / STRIPE).is_multiple_of(2) {
                    LEFT_OUT
                } else {
                    [0; 3]
                }),
                // What is missing in one channel only is clipped there.
                seen => rgb.extend(seen.map(|v| v.map_or(u8::MAX, |v| srgb(v / white)))),
            }
        }
    }
    rgb
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_is_striped_and_changes_nothing_else() {
        let mut radiance = Radiance {
            size: [16, 4],
            rows: 0..4,
            channels: ["R", "G", "B"].map(str::to_owned).to_vec(),
            value: vec![vec![1.0; 64]; 3],
            variance: vec![vec![1e-4; 64]; 3],
            shared: Vec::new(),
            noise_known: true,
        };
        let whole = colours(&radiance, 2, [8, 2]);
        assert!(whole.iter().all(|&v| v == 255), "white is the brightest");
        // The right half is masked, as [`crate::radiance::masked`] does it; of one cell on the left a single pixel.
        for c in 0..3 {
            for at in (0..64).filter(|at| at % 16 >= 8).chain([0]) {
                radiance.value[c][at] = 0.0;
                radiance.variance[c][at] = f32::INFINITY;
            }
        }
        // In one channel a cell is clipped.
        for at in [2, 3, 18, 19] {
            radiance.variance[0][at] = f32::INFINITY;
        }
        let masked = colours(&radiance, 2, [8, 2]);
        for (at, (found, before)) in masked.chunks(3).zip(whole.chunks(3)).enumerate() {
            if at % 8 < 4 {
                assert_eq!(found, before, "cell {at}");
            } else {
                assert!(found == LEFT_OUT || found == [0; 3], "cell {at}: {found:?}");
            }
        }
        let striped = masked.chunks(3).filter(|rgb| *rgb == LEFT_OUT).count();
        assert!((1..8).contains(&striped), "{striped} of 8 cells");
    }
}
