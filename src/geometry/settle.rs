//! One pose per view from the outlines of all views.
//!
//! An object that stands off the orbit's centre by (ox, oy) and a camera that looks past the centre by
//! c show, from the orbit angle φ, a lateral offset c − ox sin φ + oy cos φ and an object nearer by
//! ox cos φ + oy sin φ. What a view shows beyond that (a wobbling turntable, a hand-held camera) is
//! its own; how large that is, is read off the set, and each view is drawn towards the common model
//! accordingly (empirical Bayes). A clean set thus averages over its views, and a view
//! whose limb is dark gets the common model with an honest σ.

mod limbs;

use nalgebra::{DVector, SMatrix, SVector};

use crate::capture::{Capture, Shape};
use crate::error::{Error, Result};

use super::outline::{Outline, Status};
use super::surface::{Pose, Side};

/// Least model error that all bands of one limb share (a surface whose brightness turns too fast near the
/// limb), pixels. More is read off the scatter of the widths, which no displacement changes.
const LIMB_ERROR_PX: f64 = 0.03;
/// How well a radius is usually described, relative.
const RADIUS_ERROR: f64 = 0.005;
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

/// One number measured in one view: either the lateral offset (to which a one-sided limb adds the
/// radius's error) or half the width.
struct Observation {
    view: usize,
    kind: Of,
    value: f64,
    variance: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum Of {
    /// The lateral offset, from both sides.
    Centre,
    /// One limb: −1 left, +1 right.
    Limb(f64),
    /// Half the width.
    Width,
}

impl Of {
    /// Variance of an observation from that of its fit, that of the middle of two limbs by their model errors, and
    /// that of the view's place.
    fn variance(self, fit: f64, limb_error: f64, jitter: f64) -> f64 {
        match self {
            Self::Centre => fit + limb_error + jitter,
            Self::Limb(_) => fit + 2.0 * limb_error + jitter,
            Self::Width => fit + limb_error,
        }
    }
}

/// Unknowns: c, ox, oy, radius scale − 1.
type Common = SVector<f64, 4>;

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
    let (tilts, tilt, sigma_axis) = setting.harmonic(
        outlines.iter().map(|o| (o.pose.tilt, o.pose.sigma_tilt)),
        0.05,
    );
    let (heights, ..) = setting.harmonic(
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

/// What of the capture the model needs.
struct Setting {
    radius: f64,
    /// Lateral movement of a limb at the object's depth per relative change of the radius, metres.
    limb: f64,
    /// 1 / distance, or 0 for parallel rays.
    closeness: f64,
    limb_error: f64,
    orbit: Vec<(f64, f64)>,
    prior: Common,
}

impl Setting {
    fn new(outlines: &[Outline], capture: &Capture) -> Self {
        use crate::capture::Projection;
        let radius = capture.object.radius;
        let distance = capture.camera.distance;
        let (closeness, metres_per_px, limb) = match capture.camera.projection {
            Projection::Perspective { focal_px } => {
                let cosine = (1.0 - (radius / distance).powi(2)).max(1e-6).sqrt();
                (1.0 / distance, distance / focal_px, radius / cosine)
            }
            Projection::Orthographic { metres_per_px } => (0.0, metres_per_px, radius),
        };
        // A displacement and a camera that looks aside are told apart by several directions only.
        let measured = outlines
            .iter()
            .filter(|o| o.sides() != [false, false])
            .count();
        let displaced = if measured >= 6 { 0.2 } else { 1e-6 };
        Self {
            radius,
            limb,
            closeness,
            limb_error: (LIMB_ERROR_PX * metres_per_px).powi(2),
            orbit: capture
                .views
                .iter()
                .map(|v| v.orbit.rad().sin_cos())
                .collect(),
            prior: Common::new(0.2 * radius, displaced * radius, displaced * radius, 0.05),
        }
    }

    /// Where each view's limbs are, at the object's depth: by the exact tangents from the camera.
    fn limbs(&self, outlines: &[Outline]) -> Vec<Observation> {
        let mut all = Vec::new();
        for (view, outline) in outlines.iter().enumerate() {
            let pose = &outline.pose;
            let width = self.limb * pose.sigma_radius_scale;
            let variance = pose.sigma_lateral.powi(2) + width * width;
            for (side, _) in Side::BOTH.into_iter().zip(outline.sides()).filter(|s| s.1) {
                let radius = self.radius * pose.radius_scale;
                let value = if self.closeness > 0.0 {
                    let across = self.closeness * pose.offset[1];
                    let half = (self.closeness * radius / across.hypot(1.0)).asin();
                    (across.atan() + side.sign() * half).tan() / self.closeness
                } else {
                    pose.offset[1] + side.sign() * radius
                };
                if value.is_finite() && variance.is_finite() && variance > 0.0 {
                    all.push(Observation {
                        view,
                        kind: Of::Limb(side.sign()),
                        value,
                        variance,
                    });
                }
            }
        }
        all
    }

    /// The limbs that are `genuine` (per view: left, right); two of them as their middle and half their distance.
    fn observations(
        &self,
        outlines: &[Outline],
        limbs: &[Observation],
        genuine: &[[bool; 2]],
    ) -> Vec<Observation> {
        let mut all = Vec::new();
        for limb in limbs {
            let view = limb.view;
            let pose = &outlines[view].pose;
            let pair = genuine[view] == [true, true];
            if pair && limb.kind == Of::Limb(1.0) {
                let width = (self.limb * pose.sigma_radius_scale).powi(2);
                let mut add = |kind, value, variance: f64| {
                    if variance > 0.0 {
                        all.push(Observation {
                            view,
                            kind,
                            value,
                            variance,
                        });
                    }
                };
                add(Of::Centre, pose.offset[1], pose.sigma_lateral.powi(2));
                add(Of::Width, self.limb * pose.radius_scale, width);
            } else if !pair && genuine[view][usize::from(limb.kind == Of::Limb(1.0))] {
                all.push(Observation { ..*limb });
            }
        }
        all
    }

    /// Inverse variances of the prior at a state. A described radius or distance is mostly right to a fraction of a
    /// percent and now and then wrong by several: a Cauchy distribution.
    fn prior_weight(&self, common: &Common) -> Common {
        let mut weight = self.prior.map(|s| s.powi(-2));
        weight[3] = 1.0 / (RADIUS_ERROR * RADIUS_ERROR + common[3] * common[3]);
        weight
    }

    /// How c, ox, oy move the object in a view: towards the camera, and to the right.
    fn direction(&self, view: usize) -> [Common; 2] {
        let (sin, cos) = self.orbit.get(view).copied().unwrap_or((0.0, 1.0));
        [
            Common::new(0.0, cos, sin, 0.0),
            Common::new(1.0, -sin, cos, 0.0),
        ]
    }

    /// The derivative of an observation by the unknowns, and its predicted value. Outlines are fitted with the
    /// object at the described distance; nearer by x, everything appears larger by D / (D − x).
    fn predict(&self, o: &Observation, common: &Common) -> (Common, f64) {
        let [towards, right] = self.direction(o.view);
        let (lateral, limb) = match o.kind {
            Of::Centre => (right, 0.0),
            Of::Limb(sign) => (right, sign * self.limb),
            Of::Width => (Common::zeros(), self.limb),
        };
        let mut row = lateral;
        row[3] = limb;
        let at_centre = row.dot(common) + limb;
        let nearer = 1.0 / (1.0 - (self.closeness * towards.dot(common)).clamp(-0.5, 0.5));
        let row = row * nearer + towards * (at_centre * nearer * nearer * self.closeness);
        (row, at_centre * nearer)
    }

    /// Draws one number per view (value, σ) towards a + b sin φ + c cos φ; `prior` is the σ of each
    /// term about 0. Also a, b, c, and the larger σ of b and c.
    fn harmonic(
        &self,
        values: impl Iterator<Item = (f64, f64)>,
        prior: f64,
    ) -> (Vec<(f64, f64)>, [f64; 3], f64) {
        let values: Vec<_> = values.collect();
        let rows: Vec<SVector<f64, 3>> = self
            .orbit
            .iter()
            .map(|(sin, cos)| SVector::<f64, 3>::new(1.0, *sin, *cos))
            .collect();
        let usable = |(v, s): &(f64, f64)| v.is_finite() && s.is_finite() && *s > 0.0;
        let mut fitted = SVector::<f64, 3>::zeros();
        let mut covariance = SMatrix::<f64, 3, 3>::zeros();
        let mut spread = 0.0;
        for iteration in 0..20 {
            let mut normal = SMatrix::<f64, 3, 3>::identity() / (prior * prior);
            let mut right = SVector::<f64, 3>::zeros();
            for (row, (value, sigma)) in rows.iter().zip(&values).filter(|(_, v)| usable(v)) {
                let variance = sigma * sigma + spread;
                let miss = value - row.dot(&fitted);
                // By their own σ alone at first: far from the truth the right ones would count least.
                let weight = match iteration {
                    0 => 1.0 / variance,
                    _ => 1.0 / (variance + miss * miss / 4.0),
                };
                normal.ger(weight, row, row, 1.0);
                right += row * (weight * value);
            }
            let Some(inverse) = normal.try_inverse() else {
                break;
            };
            covariance = inverse;
            fitted = inverse * right;
            spread = spread_beyond(
                rows.iter()
                    .zip(&values)
                    .filter(|(_, v)| usable(v))
                    .map(|(row, (value, sigma))| (value - row.dot(&fitted), sigma * sigma)),
            );
        }
        let drawn = rows
            .iter()
            .zip(&values)
            .map(|(row, measured)| {
                let common = row.dot(&fitted);
                let model = (row.transpose() * covariance * row)[0];
                let miss = measured.0 - common;
                let variance = measured.1 * measured.1;
                let near = miss * miss <= OUTLIER * OUTLIER * (variance + spread + model);
                if usable(measured) && near {
                    let gain = spread / (spread + variance);
                    (common + gain * miss, (gain * variance + model).sqrt())
                } else {
                    (common, (spread + model).sqrt())
                }
            })
            .collect();
        let sigma = covariance[(1, 1)].max(covariance[(2, 2)]).max(0.0).sqrt();
        (drawn, fitted.into(), sigma)
    }
}

/// Variance of residuals beyond that of their measurement, robustly: from the median deviation. Zero unless
/// it shows by two standard errors, 2 · 1.65 / √n of the variance for a variance from n median deviations.
fn spread_beyond(misses: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (deviations, variances): (Vec<f64>, Vec<f64>) = misses
        .map(|(miss, variance)| (miss.abs(), variance))
        .unzip();
    let count = deviations.len() as f64;
    let (Some(deviation), Some(variance)) = (median(deviations), median(variances)) else {
        return 0.0;
    };
    let total = (1.4826 * deviation).powi(2);
    if total > variance * (1.0 + 3.3 / count.sqrt()) {
        total - variance
    } else {
        0.0
    }
}

fn median(values: Vec<f64>) -> Option<f64> {
    let mut sorted = DVector::from_vec(values);
    let n = sorted.len();
    (n > 0).then(|| {
        sorted.as_mut_slice().sort_by(f64::total_cmp);
        sorted[n / 2]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::WorldAngle;
    use crate::capture::{Sensor, View};
    use crate::geometry::outline::{Search, find};
    use crate::geometry::test_photo::{Scene, alpha_error_deg, seen_from};

    fn capture(scene: &Scene, orbits: &[f64]) -> Capture {
        Capture {
            name: String::new(),
            folder: ".".into(),
            object: scene.object.clone(),
            camera: scene.camera.clone(),
            sensor: Sensor::default(),
            views: orbits
                .iter()
                .map(|o| View {
                    orbit: WorldAngle::radians(*o),
                    photos: Vec::new(),
                    plane_roll: 0.0,
                    mask: None,
                    outline: None,
                })
                .collect(),
        }
    }

    /// Photographs `views` views and settles them: the truth, the result.
    fn run(scene: &Scene, truth: &[Pose], orbits: &[f64]) -> (Vec<Outline>, Settled) {
        let model = scene.model();
        let outlines: Vec<Outline> = truth
            .iter()
            .zip(orbits)
            .enumerate()
            .map(|(k, (pose, orbit))| {
                let photo = scene.photo(pose, *orbit, k as u64);
                find(&photo, &model, &scene.object, Search::default()).unwrap()
            })
            .collect();
        let settled = settle(&outlines, &capture(scene, orbits)).unwrap();
        (outlines, settled)
    }

    fn orbits(n: u32) -> Vec<f64> {
        (0..n)
            .map(|k| 0.1 + std::f64::consts::TAU * f64::from(k) / f64::from(n))
            .collect()
    }

    /// Errors of a set: the largest of the views' rms α errors (degrees), the largest lateral error and
    /// the largest lateral error over its σ (pixels).
    struct Errors {
        alpha_deg: f64,
        lateral_px: f64,
        sigmas: f64,
    }

    /// Photographs 24 views of an object that is off by 3 % of its radius (`off` = 1) and tilted by 1°, and settles them.
    fn errors(scene: &Scene, off: f64) -> Errors {
        let orbits = orbits(24);
        let tilt = match scene.object.shape {
            Shape::Cylinder => 1_f64.to_radians() * off,
            Shape::Sphere => 0.0,
        };
        let truth: Vec<Pose> = orbits
            .iter()
            .map(|o| seen_from(*o, [0.0012 * off, -0.0006 * off], 0.0006 * off, tilt))
            .collect();
        let (_, settled) = run(scene, &truth, &orbits);
        let px = scene.model().metres_per_px();
        let mut worst = Errors {
            alpha_deg: 0.0,
            lateral_px: 0.0,
            sigmas: 0.0,
        };
        for (truth, found) in truth.iter().zip(&settled.poses) {
            let lateral = (found.offset[1] - truth.offset[1]).abs();
            worst.alpha_deg = worst.alpha_deg.max(alpha_error_deg(scene, truth, found));
            worst.lateral_px = worst.lateral_px.max(lateral / px);
            worst.sigmas = worst.sigmas.max(lateral / found.sigma_lateral);
        }
        worst
    }

    #[test]
    fn a_clean_set_is_settled_whether_or_not_the_object_is_in_its_place() {
        for shape in [Shape::Cylinder, Shape::Sphere] {
            for background in [0.0, 0.3] {
                let mut scene = Scene::new(shape, [960, 12]);
                scene.background = background;
                for off in [0.0, 1.0] {
                    let e = errors(&scene, off);
                    // What the acceptance of real photographs asks: 0.05° for an unknown offset, and for a centred
                    // object hardly more than if the description were believed.
                    assert!(
                        e.alpha_deg < 0.05,
                        "{shape:?} {background} {off}: {}°",
                        e.alpha_deg
                    );
                    assert!(
                        e.lateral_px < 0.02,
                        "{shape:?} {background} {off}: {} px",
                        e.lateral_px
                    );
                }
            }
        }
    }

    #[test]
    fn one_sun_before_black_shows_one_limb_at_a_time_and_is_settled() {
        for shape in [Shape::Cylinder, Shape::Sphere] {
            for off in [0.0, 1.0] {
                let mut scene = Scene::new(shape, [960, 12]);
                scene.fill = 0.0;
                scene.suns.truncate(1);
                let e = errors(&scene, off);
                assert!(e.alpha_deg < 0.05, "{shape:?} {off}: {}°", e.alpha_deg);
                assert!(e.sigmas < 4.0, "{shape:?} {off}: {} σ", e.sigmas);
            }
        }
    }

    #[test]
    fn a_leaning_axis_is_found() {
        let orbits = orbits(36);
        let lean = 1_f64.to_radians();
        for rows in [16, 48] {
            for background in [0.0, 0.3] {
                let mut scene = Scene::new(Shape::Cylinder, [480, rows]);
                scene.background = background;
                // Towards 30° of the orbit, and a camera that is rolled by 0.3°.
                let roll = 0.3_f64.to_radians();
                let truth: Vec<Pose> = orbits
                    .iter()
                    .map(|o| {
                        seen_from(
                            *o,
                            [0.0; 2],
                            0.0,
                            roll + lean * (o - 30_f64.to_radians()).sin(),
                        )
                    })
                    .collect();
                let (_, settled) = run(&scene, &truth, &orbits);
                let [x, y] = settled.axis;
                let error = (x - lean * 30_f64.to_radians().cos()).hypot(y - lean * 0.5);
                // A view's limbs are located with an error of 0.04 px that goes with their place within a pixel, over
                // 12 rows 3e-3; it does not average out over views, see `LOCKED`.
                assert!(error < 4e-3, "{rows} {background}: {error}");
                assert!(error < 4.0 * settled.sigma_axis);
            }
        }
    }

    #[test]
    fn dim_limbs_beside_a_highlight_are_not_taken_for_a_displacement() {
        // In most views one limb vanishes into the background, and the flank of the highlight is found in its place,
        // up to 10 px inside; in others the limb is a hundred times dimmer than the highlight a few pixels away.
        for shape in [Shape::Cylinder, Shape::Sphere] {
            for alpha in [0.05, 0.1, 0.15] {
                for off in [0.0, 1.0] {
                    let mut scene = Scene::new(shape, [480, 12]);
                    scene.fill = 0.0;
                    scene.suns = vec![(1.163, 3.0)];
                    scene.metal = Some(alpha);
                    let e = errors(&scene, off);
                    // A tenth of a degree of α over the disc, what an error of the light's direction may be.
                    assert!(
                        e.alpha_deg < 0.1,
                        "{shape:?} {alpha} {off}: {}°",
                        e.alpha_deg
                    );
                    assert!(e.sigmas < 4.0, "{shape:?} {alpha} {off}: {} σ", e.sigmas);
                }
            }
        }
    }

    #[test]
    fn noise_and_a_background_half_as_bright_are_withstood() {
        for shape in [Shape::Cylinder, Shape::Sphere] {
            // The diffuse part of the surface is about 0.6 at its brightest: SNR 30.
            let mut scene = Scene::new(shape, [960, 12]);
            scene.background = 0.3;
            scene.noise = 0.02;
            for off in [0.0, 1.0] {
                let e = errors(&scene, off);
                assert!(e.alpha_deg < 0.2, "{shape:?} {off}: {}°", e.alpha_deg);
                assert!(e.sigmas < 4.0, "{shape:?} {off}: {} σ", e.sigmas);
            }
        }
    }

    #[test]
    fn jitter_of_the_views_is_followed_and_measured() {
        let orbits = orbits(24);
        let scene = Scene::new(Shape::Cylinder, [960, 12]);
        let px = scene.model().metres_per_px();
        // Two pixels to and fro, in no pattern of the orbit.
        let truth: Vec<Pose> = orbits
            .iter()
            .enumerate()
            .map(|(k, o)| seen_from(*o, [0.0; 2], 2.0 * px * f64::sin(2.4 * (k * k) as f64), 0.0))
            .collect();
        let (outlines, settled) = run(&scene, &truth, &orbits);
        // rms of 2 sin is √2 px; 24 draws determine a spread to 15 %, the median deviation to 25 %.
        assert!(
            (1.0..2.6).contains(&(settled.jitter / px)),
            "{}",
            settled.jitter / px
        );
        for (k, (t, p)) in truth.iter().zip(&settled.poses).enumerate() {
            if outlines[k].status == Status::Both && !settled.set_aside.contains(&k) {
                let error = (t.offset[1] - p.offset[1]).abs() / px;
                assert!(error < 0.3, "view {k}: {error} px");
            }
        }
    }

    #[test]
    fn a_radius_described_wrongly_is_measured() {
        let orbits = orbits(12);
        let scene = Scene::new(Shape::Sphere, [960, 12]);
        let truth: Vec<Pose> = orbits
            .iter()
            .map(|_| Pose {
                radius_scale: 1.02,
                ..Pose::nominal()
            })
            .collect();
        let (outlines, settled) = run(&scene, &truth, &orbits);
        // 0.05 px of 408 px.
        assert!(
            (settled.radius_scale - 1.02).abs() < 1.2e-4,
            "{}",
            settled.radius_scale
        );
        let seen = outlines[0].disagreement(&scene.object);
        assert!(
            (seen.radius - 0.02).abs() < 1e-3 && seen.sigma_radius < 1e-3,
            "{seen:?}"
        );
    }

    #[test]
    fn without_any_limb_the_description_stands_with_a_wide_sigma() {
        let orbits = orbits(3);
        let mut scene = Scene::new(Shape::Cylinder, [960, 12]);
        scene.fill = 0.0;
        scene.suns.clear();
        let truth = vec![Pose::nominal(); 3];
        let (outlines, settled) = run(&scene, &truth, &orbits);
        for (outline, pose) in outlines.iter().zip(&settled.poses) {
            assert_eq!(outline.status, Status::NotFound);
            assert_eq!(pose.offset, [0.0; 3]);
            assert!(pose.sigma_lateral > 0.1 * scene.object.radius);
        }
    }
}
