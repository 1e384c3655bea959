//! One pose per view from the outlines of all views.
//!
//! An object that stands off the orbit's centre by (ox, oy) and a camera that looks past the centre by
//! c show, from the orbit angle φ, a lateral offset c − ox sin φ + oy cos φ and an object nearer by
//! ox cos φ + oy sin φ. What a view shows beyond that (a wobbling turntable, a hand-held camera) is
//! its own; how large that is, is read off the set, and each view is drawn towards the common model
//! accordingly (empirical Bayes). A clean set thus averages over its views, and a view
//! whose limb is dark gets the common model with an honest σ.

mod harmonic;
mod limbs;
mod setting;
#[cfg(test)]
mod tests;

use nalgebra::SMatrix;

use crate::capture::{Capture, Shape};
use crate::error::{Error, Result};

use super::outline::{Outline, Status};
use super::surface::Pose;
use harmonic::{harmonic, spread_beyond};
use setting::{Common, Observation, Of, Setting};

/// Part of a tilt that may be missed in all views alike, since a limb's place within its pixel pulls at what is found.
const LOCKED: f64 = 0.15;
/// A residual beyond this many σ is not of the same kind.
const OUTLIER: f64 = 4.0;
/// From this many σ on, a two-sided outline of the right width is a displaced object.
const BUMPED: f64 = 10.0;

/// The poses of all views and what they have in common.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// One per view.
    pub poses: Vec<Pose>,
    /// Displacement of the object from the orbit's centre, metres, in the frame of the orbit angles.
    pub displacement: [f64; 2],
    /// Its standard deviations.
    pub sigma_displacement: [f64; 2],
    /// Lateral offset common to all views in camera axes, metres.
    pub constant: f64,
    /// Its standard deviation.
    pub sigma_constant: f64,
    /// Radius over the described radius, from all views.
    pub radius_scale: f64,
    /// Its standard deviation.
    pub sigma_radius_scale: f64,
    /// Standard deviation of what views have of their own in lateral offset, metres.
    pub jitter: f64,
    /// Lean of a cylinder's axis in the frame of the orbit angles, radians: towards 0° and towards 90°. It shows as a tilt
    /// that goes with the sine of the orbit angle; a tilt that all views share is the camera's own.
    pub axis: [f64; 2],
    /// Standard deviation of each.
    pub sigma_axis: f64,
    /// Views whose measured outline contradicts the others and was left aside (a shadow's edge, a
    /// stand taken for the limb).
    pub set_aside: Vec<usize>,
}

/// Settles the poses of a set; `outlines` holds one outline per view, in the order of the views.
///
/// # Errors
/// If the number of outlines is not the number of views, or the normal equations cannot be solved
/// (numbers that are not finite).
pub fn settle(outlines: &[Outline], capture: &Capture) -> Result<Settled> {
    if outlines.len() != capture.views.len() {
        return Err(Error::failed(format!(
            "expected an outline for each of the {} views, found {}",
            capture.views.len(),
            outlines.len()
        )));
    }
    let setting = Setting::new(outlines, capture);
    let seen = setting.limbs(outlines);
    let mut genuine = vec![[false; 2]; outlines.len()];
    for (limb, is) in seen.iter().zip(limbs::genuine(&setting, &seen)) {
        // What the user measured is not doubted.
        let given = outlines[limb.view].status == Status::Given;
        genuine[limb.view][usize::from(limb.kind == Of::Limb(1.0))] = is || given;
    }
    let observations = setting.observations(outlines, &seen, &genuine);
    let unsolvable = || {
        Error::failed("the poses of the views could not be settled: the outlines are degenerate")
    };
    let widths = observations.iter().filter(|o| o.kind == Of::Width).count();
    let mut common = Common::zeros();
    let mut covariance = SMatrix::<f64, 4, 4>::zeros();
    let mut jitter = 0.0;
    let mut limb_error = setting.limb_error;
    let mut trust = vec![1.0; outlines.len()];
    for iteration in 0..15 {
        let prior = setting.prior_weight(&common);
        let mut normal = SMatrix::<f64, 4, 4>::from_diagonal(&prior);
        let mut right = -common.component_mul(&prior);
        for o in &observations {
            let (row, predicted) = setting.predict(o, &common);
            let variance = o.kind.variance(o.variance, limb_error, jitter);
            let weight = trust[o.view] / variance;
            normal.ger(weight, &row, &row, 1.0);
            right += row * (weight * (o.value - predicted));
        }
        covariance = normal.try_inverse().ok_or_else(unsolvable)?;
        let step = covariance * right;
        common += step;
        let misses: Vec<f64> = observations
            .iter()
            .map(|o| o.value - setting.predict(o, &common).1)
            .collect();
        let beyond = |width: bool, limb_error: f64| {
            spread_beyond(
                observations
                    .iter()
                    .zip(&misses)
                    .filter(|(o, _)| (o.kind == Of::Width) == width)
                    .map(|(o, miss)| (*miss, o.kind.variance(o.variance, limb_error, 0.0))),
            )
        };
        // Errors of the two limbs move the middle as much as half the width; a displacement moves only
        // the middle. Where few views show both limbs, those are the doubtful ones and say nothing of the rest.
        limb_error = setting.limb_error;
        if widths > observations.len() / 3 {
            limb_error = limb_error.max(beyond(true, 0.0));
        }
        jitter = beyond(false, limb_error);
        // Cauchy weights, of the scale of one σ since a shadow's edge errs to one side only; a view is
        // trusted as little as its worst number.
        trust.fill(1.0);
        for (o, miss) in observations.iter().zip(&misses) {
            let variance = o.kind.variance(o.variance, limb_error, jitter);
            let weight = 1.0 / (1.0 + miss * miss / variance);
            trust[o.view] = f64::min(trust[o.view], weight);
        }
        if iteration > 5 && step.component_div(&setting.prior).norm() < 1e-9 {
            break;
        }
    }
    if !common.iter().all(|v| v.is_finite()) {
        return Err(unsolvable());
    }

    let views = outlines.len();
    let mut own = vec![(0.0, f64::NAN); views];
    let mut width_ok = vec![true; views];
    let mut set_aside: Vec<usize> = (0..views)
        .filter(|&k| (0..2).any(|side| outlines[k].sides()[side] && !genuine[k][side]))
        .collect();
    for o in &observations {
        let miss = o.value - setting.predict(o, &common).1;
        if o.kind == Of::Width {
            let variance = o.kind.variance(o.variance, limb_error, jitter);
            width_ok[o.view] = miss * miss <= OUTLIER * OUTLIER * variance;
        }
    }
    for o in observations.iter().filter(|o| o.kind != Of::Width) {
        let (row, predicted) = setting.predict(o, &common);
        let miss = o.value - predicted;
        let model = (row.transpose() * covariance * row)[0];
        let measured = o.kind.variance(o.variance, limb_error, 0.0);
        let expected = miss * miss <= OUTLIER * OUTLIER * (measured + jitter + model);
        // Both limbs at the right distance from each other, and so far off that no bias of the limb
        // explains it: then it is the object, out of its place.
        let moved = o.kind == Of::Centre && miss * miss > (BUMPED * BUMPED) * (measured + jitter);
        if !width_ok[o.view] || !(expected || moved) {
            set_aside.push(o.view);
            continue;
        }
        let room = if expected { jitter } else { miss * miss };
        let gain = room / (room + measured);
        own[o.view] = (gain * miss, gain * measured);
    }
    set_aside.sort_unstable();
    set_aside.dedup();
    let (tilts, tilt, sigma_axis) = harmonic(
        &setting.orbit,
        outlines.iter().map(|o| (o.pose.tilt, o.pose.sigma_tilt)),
        0.05,
    );
    let (heights, ..) = harmonic(
        &setting.orbit,
        outlines
            .iter()
            .map(|o| (o.pose.offset[2], o.sigma_vertical)),
        0.05 * setting.radius,
    );
    let sphere = capture.object.shape == Shape::Sphere;
    let sigma = |j: usize| covariance[(j, j)].max(0.0).sqrt();
    let poses = (0..views)
        .map(|k| {
            let [towards, lateral_row] = setting.direction(k);
            let model = (lateral_row.transpose() * covariance * lateral_row)[0];
            let (shift, variance) = own[k];
            let variance = if variance.is_nan() { jitter } else { variance };
            Pose {
                offset: [
                    towards.dot(&common),
                    lateral_row.dot(&common) + shift,
                    if sphere { heights[k].0 } else { 0.0 },
                ],
                tilt: if sphere { 0.0 } else { tilts[k].0 },
                radius_scale: 1.0 + common[3],
                sigma_lateral: (variance + model).max(0.0).sqrt(),
                sigma_tilt: if sphere { 0.0 } else { tilts[k].1 },
                sigma_radius_scale: sigma(3),
            }
        })
        .collect();
    Ok(Settled {
        poses,
        displacement: [common[1], common[2]],
        sigma_displacement: [sigma(1), sigma(2)],
        constant: common[0],
        sigma_constant: sigma(0),
        radius_scale: 1.0 + common[3],
        sigma_radius_scale: sigma(3),
        jitter: jitter.sqrt(),
        axis: if sphere {
            [0.0; 2]
        } else {
            [tilt[1], -tilt[2]]
        },
        sigma_axis: sigma_axis.hypot(LOCKED * tilt[1].hypot(tilt[2])),
        set_aside,
    })
}
