//! Exposures of one view must show one picture: a touched tripod is found by the shift between
//! them.

use std::path::Path;

use super::brackets::{by_time, shared};
use super::merge::Bracket;
use crate::error::{Error, Result};

/// The largest shift between exposures that is let pass, pixels. On a 960-pixel view of a cylinder
/// it turns a normal by 0.02° at the centre: below what the outline is found to.
const LARGEST_SHIFT: f64 = 0.1;

/// A shift counts if it is this many times its standard deviation.
const SIGNIFICANT: f64 = 5.0;

/// The shift that is thought possible before the photos are looked at, pixels: it settles the axis
/// along which the picture has no structure.
const POSSIBLE_SHIFT: f64 = 10.0;

/// Checks that successive exposures are not shifted against each other.
///
/// To first order I_long − I_short = −d · ∇I; d follows by weighted least squares over the pixels
/// that both show well, from the gradient of the `expected` radiance (\[channel\]\[pixel\]).
///
/// # Errors
/// A shift is larger than a tenth of a pixel beyond doubt. `files` names the photos.
pub(super) fn check(planes: &[Bracket<'_>], expected: &[Vec<f32>], files: &[&Path]) -> Result<()> {
    let Some(first) = planes.first() else {
        return Ok(());
    };
    for pair in by_time(&first.seconds).windows(2) {
        let &[short, long] = pair else { continue };
        let (shift, sigma) = shift(planes, expected, short, long);
        let [dx, dy] = shift;
        let moved = shift
            .iter()
            .zip(sigma)
            .any(|(d, s)| d.abs() > LARGEST_SHIFT && d.abs() > SIGNIFICANT * s);
        if moved {
            let name = |i: usize| {
                files
                    .get(i)
                    .map(|f| f.display().to_string())
                    .unwrap_or_default()
            };
            return Err(Error::input(format!(
                "expected exposures of one picture, found \"{}\" moved by ({dx:.2}, {dy:.2}) pixels \
                 against \"{}\"",
                name(long),
                name(short)
            ))
            .advice("The camera or the object moved within the bracket: leave one of the two photos out."));
        }
    }
    Ok(())
}

/// The shift of the long exposure against the short one (right, down) and its σ, pixels.
fn shift(
    planes: &[Bracket<'_>],
    expected: &[Vec<f32>],
    short: usize,
    long: usize,
) -> ([f64; 2], [f64; 2]) {
    let prior = 1.0 / (POSSIBLE_SHIFT * POSSIBLE_SHIFT);
    // Normal equations [xx, xy; xy, yy] d = [xd, yd], and what is left of the differences.
    let (mut xx, mut xy, mut yy, mut xd, mut yd) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let (mut squares, mut count) = (0.0, 0.0);
    for (plane, expected) in planes.iter().zip(expected) {
        for (i, [s, l], variance) in shared(plane, expected, short, long) {
            let Some([gx, gy]) = gradient(expected, plane.width, i) else {
                continue;
            };
            let variance =
                [(variance[0], s), (variance[1], l)].map(|(v, m)| v / (m.reach * m.reach));
            // Gradients that are no more than noise would pull the shift towards 0.
            if gx * gx + gy * gy < 4.0 * variance[1] {
                continue;
            }
            let weight = 1.0 / (variance[0] + variance[1]);
            let difference = s.signal / s.reach - l.signal / l.reach;
            xx += weight * gx * gx;
            xy += weight * gx * gy;
            yy += weight * gy * gy;
            xd += weight * gx * difference;
            yd += weight * gy * difference;
            squares += weight * difference * difference;
            count += 1.0;
        }
    }
    let (xx, yy) = (xx + prior, yy + prior);
    let determinant = xx * yy - xy * xy;
    let d = [
        (yy * xd - xy * yd) / determinant,
        (xx * yd - xy * xd) / determinant,
    ];
    // Noise that is larger than stated, or not stated at all, shows in what is left.
    let left = (squares - d[0] * xd - d[1] * yd) / f64::max(count - 2.0, 1.0);
    let sigma = [yy, xx].map(|m| (left.max(1.0) * m / determinant).sqrt());
    (d, sigma)
}

/// Central differences of the expected radiance at a pixel, per pixel; none at the edges.
fn gradient(expected: &[f32], width: usize, pixel: usize) -> Option<[f64; 2]> {
    let column = pixel % width.max(1);
    if column == 0 || column + 1 == width {
        return None;
    }
    let at = |i: usize| {
        expected
            .get(i)
            .copied()
            .filter(|v| v.is_finite())
            .map(f64::from)
    };
    let gx = (at(pixel + 1)? - at(pixel - 1)?) / 2.0;
    let gy = match (at(pixel + width), pixel.checked_sub(width).and_then(at)) {
        (Some(below), Some(above)) => (below - above) / 2.0,
        _ => return None,
    };
    Some([gx, gy])
}
