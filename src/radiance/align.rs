//! Exposures that were moved against each other, moved back.
//!
//! A pixel's value is not replaced by a mean of its neighbours: that would blur what is sharp and tie the
//! noise of neighbours together. What is added instead is the difference between the expected radiance
//! here and where the pixel looked, E(x) − E(x − f), which has hardly any noise; the pixel keeps its own.
//! The part of the shift that is whole pixels moves pixels as they are.

use super::exposure::Exposure;
use super::merge::{Bracket, brackets_of};

/// How far (standard deviations) from clipping the light that a pixel really saw must stay.
const CLIP_MARGIN: f64 = 3.0;

/// A picture at positions displaced by less than a pixel.
struct Interpolated {
    value: Vec<f32>,
    /// What two more points along each axis changed: about the error that is left.
    error: Vec<f32>,
}

/// The exposures as if taken where the reference exposure was: exposure e shows at x + `shifts[e]` what
/// the reference shows at x. Pixels whose origin is off the picture, next to a missing one or close to
/// clipping are missing.
pub(super) fn aligned(
    exposures: &[Exposure],
    shifts: &[[f64; 2]],
    planes: &[Bracket<'_>],
) -> Vec<Exposure> {
    let resampled = moved(exposures, shifts, planes);
    let references = brackets_of(&resampled, planes);
    let expected: Vec<Vec<f32>> = references.iter().map(Bracket::expected).collect();
    let mut out = exposures.to_vec();
    for (e, (exposure, shift)) in out.iter_mut().zip(shifts).enumerate() {
        if *shift == [0.0; 2] {
            continue;
        }
        let (whole, part) = split(*shift);
        for (plane, expected) in planes.iter().zip(&expected) {
            let seen = interpolate(expected, plane.width, part.map(|f| -f));
            let reach = plane.reaches(e);
            let c = plane.channel;
            let levels = exposure.levels.get(c).copied();
            let (Some(signal), Some(rounding), Some(levels)) = (
                exposure.signal.get_mut(c),
                exposure.rounding.get_mut(c),
                levels,
            ) else {
                continue;
            };
            let from = |x: usize| origin(x, plane.width, reach.len(), whole);
            let old = (signal.clone(), rounding.clone());
            for x in 0..signal.len() {
                let moved = from(x).and_then(|at| {
                    let gain = reach.get(x)? / reach.get(at)?;
                    let (there, error) = (*seen.value.get(x)?, *seen.error.get(x)?);
                    let here = f64::from(*expected.get(x)?);
                    let reach = *reach.get(x)?;
                    let noise = plane
                        .noise
                        .map_or(0.0, |n| n.variance(reach * f64::from(there)));
                    let margin = CLIP_MARGIN * (noise + f64::from(*old.1.get(at)?)).sqrt();
                    if !(reach * f64::from(there) + margin < levels.white) {
                        return None;
                    }
                    let value = gain * f64::from(*old.0.get(at)?);
                    let value = value + reach * (here - f64::from(there));
                    let error = reach * f64::from(error);
                    let rounding = gain * gain * f64::from(*old.1.get(at)?) + error * error;
                    value.is_finite().then_some((value as f32, rounding as f32))
                });
                let (value, variance) = moved.unwrap_or((f32::NAN, f32::INFINITY));
                if let (Some(s), Some(r)) = (signal.get_mut(x), rounding.get_mut(x)) {
                    (*s, *r) = (value, variance);
                }
            }
        }
    }
    out
}

/// The exposures moved by plain interpolation: good enough to measure shifts on and to expect radiance
/// from, but blurred in noise.
pub(super) fn moved(
    exposures: &[Exposure],
    shifts: &[[f64; 2]],
    planes: &[Bracket<'_>],
) -> Vec<Exposure> {
    let mut out = exposures.to_vec();
    for (e, (exposure, shift)) in out.iter_mut().zip(shifts).enumerate() {
        if *shift == [0.0; 2] {
            continue;
        }
        let (whole, part) = split(*shift);
        for plane in planes {
            let reach = plane.reaches(e);
            let Some(signal) = exposure.signal.get_mut(plane.channel) else {
                continue;
            };
            let shown: Vec<f32> = (0..signal.len())
                .map(|x| {
                    let at = origin(x, plane.width, signal.len(), whole)?;
                    Some((f64::from(*signal.get(at)?) * reach.get(x)? / reach.get(at)?) as f32)
                })
                .map(|value| value.unwrap_or(f32::NAN))
                .collect();
            *signal = interpolate(&shown, plane.width, part).value;
        }
    }
    out
}

/// A shift as whole pixels and a rest of at most half a pixel.
fn split(shift: [f64; 2]) -> ([i64; 2], [f64; 2]) {
    let whole = shift.map(f64::round);
    (
        whole.map(|k| k as i64),
        [shift[0] - whole[0], shift[1] - whole[1]],
    )
}

/// The pixel that lies `whole` pixels right and below, if the picture has it.
fn origin(pixel: usize, width: usize, pixels: usize, whole: [i64; 2]) -> Option<usize> {
    let (x, y) = (pixel % width.max(1), pixel / width.max(1));
    let x = usize::try_from(x as i64 + whole[0])
        .ok()
        .filter(|x| *x < width)?;
    let y = usize::try_from(y as i64 + whole[1]).ok()?;
    Some(y * width + x).filter(|at| *at < pixels)
}

/// The picture at positions displaced by `by` (right, down; at most half a pixel each), by Lagrange's
/// polynomials through six points; NaN where one of them is missing.
fn interpolate(plane: &[f32], width: usize, by: [f64; 2]) -> Interpolated {
    let mut value = plane.to_vec();
    let mut error = vec![0.0_f32; plane.len()];
    let width = width.max(1);
    let height = plane.len() / width;
    for (axis, f) in by.into_iter().enumerate() {
        if f == 0.0 {
            continue;
        }
        let (length, stride) = if axis == 0 {
            (width, 1)
        } else {
            (height, width)
        };
        let six = weights::<6>(f);
        let four = weights::<4>(f);
        let source = value.clone();
        for i in 0..source.len() {
            let along = if axis == 0 { i % width } else { i / width };
            let sum = |weights: &[f64], first: i64| {
                let mut sum = 0.0;
                for (k, w) in weights.iter().enumerate() {
                    let step = first + k as i64;
                    if !(0..length as i64).contains(&(along as i64 + step)) {
                        return f64::NAN;
                    }
                    let at = i as i64 + step * stride as i64;
                    let v = usize::try_from(at).ok().and_then(|at| source.get(at));
                    sum += w * v.map_or(f64::NAN, |v| f64::from(*v));
                }
                sum
            };
            let fine = sum(&six.1, six.0);
            let coarse = sum(&four.1, four.0);
            if let (Some(value), Some(error)) = (value.get_mut(i), error.get_mut(i)) {
                *value = fine as f32;
                *error = (f64::from(*error).hypot(fine - coarse)) as f32;
            }
        }
    }
    Interpolated { value, error }
}

/// The first of N consecutive points around a displacement, and Lagrange's weights of all.
fn weights<const N: usize>(f: f64) -> (i64, [f64; N]) {
    let half = N as i64 / 2;
    let first = if f >= 0.0 { 1 - half } else { -half };
    let weights = std::array::from_fn(|k| {
        let node = (first + k as i64) as f64;
        (0..N as i64)
            .map(|m| (first + m) as f64)
            .filter(|other| *other != node)
            .map(|other| (f - other) / (node - other))
            .product()
    });
    (first, weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_points_follow_a_lens_blurred_picture() {
        // A wave of eight pixels' length; the remainder of Lagrange's sixth order is below
        // 2π/8 to the sixth over 6! times the product of the distances, 225/64: 1.1e-3.
        let width = 40;
        let wave = |x: f64, y: f64| (x * 0.785 + y * 0.3).sin();
        let plane: Vec<f32> = (0..width * width)
            .map(|i| wave((i % width) as f64, (i / width) as f64) as f32)
            .collect();
        for by in [[0.5, 0.0], [-0.3, 0.4], [0.0, -0.5], [0.1, 0.1]] {
            let found = interpolate(&plane, width, by);
            for (i, value) in found.value.iter().enumerate() {
                let (x, y) = (i % width, i / width);
                if (3..width - 3).contains(&x) && (3..width - 3).contains(&y) {
                    let expected = wave(x as f64 + by[0], y as f64 + by[1]);
                    let error = (f64::from(*value) - expected).abs();
                    assert!(error < 1.5e-3, "{by:?} {x} {y}: {error}");
                    // The error that is told is larger than the one that is made, on the whole.
                    assert!(error < 1e-4 + 2.0 * f64::from(found.error[i]).max(4e-4));
                }
            }
        }
    }

    #[test]
    fn whole_pixels_move_as_they_are() {
        assert_eq!(split([2.3, -1.6]).0, [2, -2]);
        assert_eq!(origin(12, 10, 50, [1, 1]), Some(23));
        assert_eq!(origin(19, 10, 50, [1, 0]), None);
        assert_eq!(origin(45, 10, 50, [0, 1]), None);
        assert_eq!(origin(3, 10, 50, [0, -1]), None);
    }
}
