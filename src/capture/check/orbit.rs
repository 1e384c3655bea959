//! What the views as a whole cover, and what their names and angles say of photos that are missing.

use std::path::Path;

use crate::capture::{Capture, Shape};

/// A gap between neighbouring views beyond which a warning is given, degrees: half the visible half
/// circle, so that every normal is still seen by two views.
const WIDE_GAP_DEG: f64 = 90.0;

/// Steps of an even orbit that may be missing from the full circle, or from a numbering, for photos to be taken for missing: a
/// longer gap is meant.
const MOST_MISSING: f64 = 3.0;
const MOST_SKIPPED: u64 = 10;

/// What an even orbit's file names and angles say of a photo that is missing: all after it would stand a
/// step too early.
pub(super) fn gaps(capture: &Capture) -> Vec<String> {
    let mut warnings = Vec::new();
    let orbits: Vec<f64> = capture.views.iter().map(|view| view.orbit.deg()).collect();
    let (Some(first), Some(second)) = (orbits.first(), orbits.get(1)) else {
        return warnings;
    };
    let step = second - first;
    let even = orbits
        .windows(2)
        .all(|pair| (pair[1] - pair[0] - step).abs() < 1e-6 * step.abs());
    if !even || orbits.len() < 4 {
        return warnings;
    }
    let numbers: Option<Vec<(u64, &Path)>> = capture
        .views
        .iter()
        .map(|view| {
            let file = &view.photos.first()?.file;
            Some((
                last_number(&file.file_stem()?.to_string_lossy())?,
                file.as_path(),
            ))
        })
        .collect();
    if let Some(numbers) = numbers {
        let mut strides: Vec<u64> = numbers
            .windows(2)
            .map(|pair| pair[1].0.abs_diff(pair[0].0))
            .collect();
        strides.sort_unstable();
        let usual = strides.get(strides.len() / 2).copied().unwrap_or(1);
        for pair in numbers.windows(2) {
            let stride = pair[1].0.abs_diff(pair[0].0);
            // Steps that are no multiple of the usual one are no numbering.
            if usual > 0 && stride > usual && stride % usual == 0 && stride <= MOST_SKIPPED * usual
            {
                warnings.push(format!(
                    "the files jump from \"{}\" to \"{}\" and their angles do not: if {} missing, all views from there on stand too early; list them with [[view]]",
                    pair[0].1.display(),
                    pair[1].1.display(),
                    match stride / usual - 1 {
                        1 => "a photo is".to_string(),
                        n => format!("{n} photos are"),
                    }
                ));
            }
        }
    }
    let short = 360.0 - orbits.len() as f64 * step.abs();
    if short.abs() > 1e-6 * 360.0 && short <= MOST_MISSING * step.abs() && short > -step.abs() {
        warnings.push(format!(
            "{} views {:.4} degrees apart make {:.2} degrees, not 360: is a photo missing, or orbit_step_deg another?",
            orbits.len(),
            step.abs(),
            orbits.len() as f64 * step.abs()
        ));
    }
    warnings
}

/// The last run of digits of a name.
fn last_number(name: &str) -> Option<u64> {
    let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let digits = name.get(..end)?;
    let start = digits.rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| {
        at + digits[at..].chars().next().map_or(1, char::len_utf8)
    });
    digits.get(start..)?.parse().ok()
}

/// What the views leave unseen.
pub(super) fn coverage(capture: &Capture) -> Vec<String> {
    let mut warnings = Vec::new();
    if capture.views.len() == 1 {
        warnings.push(
            "there is one view only: it is a single line of the light field, and no lighting or BRDF \
             can be separated from it without further knowledge"
                .to_string(),
        );
        return warnings;
    }
    let rolled = capture.views.iter().any(|view| view.plane_roll != 0.0);
    if capture.object.shape == Shape::Cylinder && rolled {
        warnings
            .push("plane_roll_deg is not 0, and a cylinder has only one cross-section".to_string());
    }
    let mut angles: Vec<f64> = capture
        .views
        .iter()
        .map(|view| view.orbit.wrapped().deg())
        .collect();
    angles.sort_by(f64::total_cmp);
    let around = angles.first().map(|first| first + 360.0);
    let gap = angles
        .iter()
        .zip(angles.iter().skip(1).copied().chain(around))
        .map(|(a, b)| b - a)
        .fold(0.0, f64::max);
    if gap > WIDE_GAP_DEG {
        warnings.push(format!(
            "there is a gap of {gap:.1} degrees between neighbouring views: some normals are seen by \
             fewer than two"
        ));
    }
    warnings
}
