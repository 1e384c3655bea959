//! What a measurement of the light field found to be unusual, in plain sentences.

use super::photographed::{first_file, photo_file};
use super::views::ReadView;
use crate::capture::Capture;
use crate::geometry::Pose;
use crate::geometry::outline::Outline;
use crate::light_field::{Jitter, Samples, runs_backwards};
use crate::radiance;

/// Change of an exposure time by the brackets (log) from which it is told.
const TIME_CHANGE: f64 = 0.01;
/// The object's distance from the orbit's centre, in parts of its radius, beyond which a warning is given: a turntable is centred to a
/// few tenths of a percent with care, and what is found is taken into account.
const OFF_CENTRE: f64 = 0.02;
/// Part by which the object looks larger or smaller than described, and σ of what is found beyond it, from which a warning is given: lengths
/// are measured to half a percent.
const SIZE_CHANGE: f64 = 0.005;
const SIZE_SIGMAS: f64 = 4.0;

/// How well the response was recovered from the brackets.
pub(super) fn response_note(found: &radiance::Recovery) -> String {
    let curve = &found.curve;
    let sigmas = curve.linear.iter().zip(&curve.sigma).flat_map(|(x, s)| {
        let rows = x.len();
        let middle = x.iter().zip(s).take(rows * 9 / 10).skip(rows / 10);
        middle.map(|(x, s)| s / x)
    });
    let times = found.times.iter().map(|(_, factor)| factor.ln().abs());
    format!(
        "The camera's response was recovered from {} patches of the brackets (σ up to {:.1} % of the light over the middle 80 % of the codes; \
         exposure times up to {:.1} % other than stated; misfit {:.1} times the noise); the scale between channels is that of a grey of the middle code.",
        found.patches,
        100.0 * sigmas.fold(0.0, f64::max),
        100.0 * times.fold(0.0, f64::max),
        found.misfit
    )
}

/// How much the views' exposures were found to jitter.
pub(super) fn jitter_note(
    capture: &Capture,
    jitter: &Jitter,
    number: &dyn Fn(usize) -> usize,
) -> String {
    let size = |v: &usize| jitter.factor.get(*v).map_or(0.0, |f| f.ln().abs());
    let worst = (0..jitter.factor.len()).max_by(|a, b| size(a).total_cmp(&size(b)));
    let (view, sigma) = worst.map_or((0, 0.0), |v| (v, jitter.sigma[v]));
    format!(
        "Exposure changes from view to view by {:.2} % (rms), the most in view {} (\"{}\": {:+.2} ± {:.2} %); it was divided out. Changes as slow along the orbit as lighting cannot be told from lighting and are left.",
        100.0 * jitter.rms(),
        number(view),
        first_file(capture, view),
        100.0 * (jitter.factor.get(view).copied().unwrap_or(1.0) - 1.0),
        100.0 * sigma
    )
}

/// What the brackets showed to be other than stated: photos moved against each other, exposure times.
pub(super) fn exposure_warnings(
    capture: &Capture,
    read: &[ReadView],
    number: &dyn Fn(usize) -> usize,
) -> Vec<String> {
    let mut warnings = Vec::new();
    let mut worst: Option<(f64, usize, usize)> = None;
    for (v, view) in read.iter().enumerate() {
        for (p, found) in view.exposures.iter().enumerate() {
            let [dx, dy] = found.shift.by;
            if found.shift.by != [0.0; 2] {
                let [sx, sy] = found.shift.sigma;
                warnings.push(format!(
                    "View {}: \"{}\" lay ({dx:.2} ± {sx:.2}, {dy:.2} ± {sy:.2}) pixels off the view's other photos and was moved back.",
                    number(v),
                    photo_file(capture, v, p)
                ));
            }
            let change = found.time_factor.ln();
            if worst.is_none_or(|(largest, ..)| change.abs() > f64::abs(largest)) {
                worst = Some((change, v, p));
            }
        }
    }
    if let Some((change, v, p)) = worst
        && change.abs() > TIME_CHANGE
    {
        warnings.push(format!(
            "The brackets show exposure times other than stated, and were merged with those; the most in view {}: \"{}\" by {:+.1} %.",
            number(v),
            photo_file(capture, v, p),
            100.0 * change.exp_m1()
        ));
    }
    warnings
}

pub(super) fn warnings(
    capture: &Capture,
    outlines: &[Outline],
    poses: &[Pose],
    samples: &Samples,
) -> Vec<String> {
    let mut warnings = Vec::new();
    let unseen = outlines
        .iter()
        .filter(|o| o.sides() == [false, false])
        .count();
    if unseen == outlines.len() {
        warnings.push(
            "No view shows the object's limb; the outline is the description's. A brighter or darker background lets it be found, or give it by hand with `outline`.".into(),
        );
    }
    let orbits: Vec<_> = capture.views.iter().map(|view| view.orbit).collect();
    if runs_backwards(samples, &orbits) {
        warnings.push(
            "The views fit together much better the other way round: turn the sign of orbit_deg (or orbit_step_deg). It counts counter-clockwise seen from above, in the frame of the light: turning the object or the light instead turns the sense.".into(),
        );
    }
    let radius = capture.object.radius;
    let shift = poses
        .iter()
        .map(|p| p.offset[1].abs() / radius)
        .fold(0.0, f64::max);
    if shift > OFF_CENTRE {
        warnings.push(format!(
            "The object's centre is up to {:.1} % of its radius off the orbit's centre; the found outline was used.",
            100.0 * shift
        ));
    }
    let scale = poses.iter().map(|p| p.radius_scale - 1.0).sum::<f64>() / poses.len() as f64;
    let sigma = poses
        .iter()
        .map(|p| p.sigma_radius_scale)
        .fold(f64::INFINITY, f64::min);
    if scale.abs() > SIZE_CHANGE + SIZE_SIGMAS * sigma {
        warnings.push(format!(
            "The object looks {:.1} % {} than radius, distance and focal length say; the found outline was used. Check these three.",
            100.0 * scale.abs(),
            if scale > 0.0 { "larger" } else { "smaller" }
        ));
    }
    for (c, name) in samples.channels.iter().enumerate() {
        if samples.count(c) == 0 {
            warnings.push(format!("Channel {name} has no usable pixel."));
        }
    }
    warnings
}
