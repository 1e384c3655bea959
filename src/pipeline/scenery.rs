//! What a photo shows about the object: nothing at all, or a second thing beside it. Either explains why a result explains
//! nothing.

use crate::radiance::Radiance;

/// Blocks of columns that are compared.
const BLOCKS: usize = 16;
/// Variance between blocks, in units of what the scatter within them gives, above which there is something in the picture:
/// noise gives 1 ± 0.4.
const STRUCTURE: f64 = 9.0;
/// And the least contrast: rounding of a constant gives less.
const CONTRAST: f64 = 1e-4;
/// Columns about the limbs that belong to neither side, in diameters.
const MARGIN: f64 = 0.05;
/// Brightness between background and object from which something counts as bright, and how plain (median deviation in the
/// same unit) the rest must be: before a visible environment nothing is said.
const BRIGHT: f64 = 0.25;
const PLAIN: f64 = 0.02;
/// Width of what is bright beside the object, in diameters.
const WIDE: f64 = 0.2;
/// Rows about the cross-section that are looked at.
const ROWS: f64 = 3.0;

/// What one photo shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scenery {
    /// Anything but an even area or noise.
    pub structured: bool,
    /// Something as bright as the object beside it, on a plain background.
    pub beside: bool,
}

/// Looks along the rows about `row`; `limbs` are the object's columns.
pub fn scenery(radiance: &Radiance, row: f64, limbs: [f64; 2]) -> Scenery {
    let profile = profile(radiance, row);
    Scenery {
        structured: structured(&profile),
        beside: beside(&profile, limbs),
    }
}

/// Mean over rows and channels by column; `None` where nothing is measured.
fn profile(radiance: &Radiance, row: f64) -> Vec<Option<f64>> {
    let width = radiance.size[0] as usize;
    let near = |y: u32| (f64::from(y) + 0.5 - row).abs() <= ROWS;
    let rows: Vec<usize> = radiance
        .rows
        .clone()
        .filter(|y| near(*y))
        .map(|y| (y - radiance.rows.start) as usize)
        .collect();
    (0..width)
        .map(|x| {
            let planes = radiance.value.iter().zip(&radiance.variance);
            let (mut sum, mut n) = (0.0, 0u32);
            for (value, variance) in planes {
                for y in &rows {
                    let at = y * width + x;
                    if variance.get(at).is_some_and(|v| v.is_finite()) {
                        sum += value.get(at).map_or(0.0, |v| f64::from(*v));
                        n += 1;
                    }
                }
            }
            (n > 0).then(|| sum / f64::from(n))
        })
        .collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    squares / values.len().saturating_sub(1).max(1) as f64
}

fn structured(profile: &[Option<f64>]) -> bool {
    let seen: Vec<f64> = profile.iter().flatten().copied().collect();
    let size = (seen.len() / BLOCKS).max(2);
    let blocks: Vec<&[f64]> = seen.chunks_exact(size).collect();
    if blocks.len() < 4 {
        return true;
    }
    let means: Vec<f64> = blocks.iter().map(|b| mean(b)).collect();
    let within: Vec<f64> = blocks.iter().map(|b| variance(b)).collect();
    let expected = mean(&within) / size as f64;
    let between = variance(&means);
    between > STRUCTURE * expected && between.sqrt() > CONTRAST * mean(&seen).abs()
}

fn beside(profile: &[Option<f64>], [left, right]: [f64; 2]) -> bool {
    let diameter = right - left;
    let margin = MARGIN * diameter;
    let (mut inside, mut outside) = (Vec::new(), Vec::new());
    for (x, value) in profile.iter().enumerate() {
        let (Some(value), place) = (*value, x as f64 + 0.5) else {
            continue;
        };
        if place < left - margin || place > right + margin {
            outside.push(value);
        } else if (left..right).contains(&place) {
            inside.push(value);
        }
    }
    if inside.is_empty() || outside.len() < 8 {
        return false;
    }
    inside.sort_by(f64::total_cmp);
    outside.sort_by(f64::total_cmp);
    let object = inside[inside.len() * 19 / 20];
    let background = outside[outside.len() / 10];
    let range = object - background;
    if !(range > 0.0) {
        return false;
    }
    let threshold = background + BRIGHT * range;
    let plain = outside.partition_point(|v| *v < threshold);
    let mut deviations: Vec<f64> = outside[..plain]
        .iter()
        .map(|v| (v - background).abs())
        .collect();
    deviations.sort_by(f64::total_cmp);
    let deviation = deviations
        .get(deviations.len() / 2)
        .copied()
        .unwrap_or(f64::INFINITY);
    let bright = (outside.len() - plain) as f64;
    bright > WIDE * diameter && deviation <= PLAIN * range
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(value: impl Fn(usize) -> f64) -> Vec<Option<f64>> {
        (0..200).map(|x| Some(value(x))).collect()
    }

    /// White noise of a linear congruential generator.
    fn noise(x: usize) -> f64 {
        let mut h = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h ^= h >> 29;
        h = h.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (h >> 40) as f64 / (1u64 << 24) as f64
    }

    #[test]
    fn even_areas_and_noise_are_nothing() {
        assert!(!structured(&seen(|_| 0.3)));
        assert!(!structured(&seen(noise)));
        assert!(structured(&seen(|x| noise(x) + x as f64 / 50.0)));
        assert!(structured(&seen(|x| f64::from((60..140).contains(&x)))));
    }

    #[test]
    fn a_second_thing_on_a_plain_background_is_told_from_scenery() {
        let one = |x: usize| f64::from((60..140).contains(&x));
        let two = |x: usize| one(x) + f64::from((155..190).contains(&x));
        assert!(!beside(&seen(one), [60.0, 140.0]));
        assert!(beside(&seen(two), [60.0, 140.0]));
        // A room behind the object.
        let room = |x: usize| one(x) + 0.5 + 0.4 * (x as f64 / 9.0).sin();
        assert!(!beside(&seen(room), [60.0, 140.0]));
    }
}
