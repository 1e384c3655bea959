//! What a set's outlines measure, and how the common unknowns show in it.

use nalgebra::SVector;

use crate::capture::{Capture, Projection};
use crate::geometry::outline::Outline;
use crate::geometry::surface::Side;

/// Least model error that all bands of one limb share (a surface whose brightness turns too fast near the
/// limb), pixels. More is read off the scatter of the widths, which no displacement changes.
const LIMB_ERROR_PX: f64 = 0.03;
/// How well a radius is usually described, relative.
const RADIUS_ERROR: f64 = 0.005;

/// One number measured in one view: either the lateral offset (to which a one-sided limb adds the
/// radius's error) or half the width.
pub(super) struct Observation {
    pub view: usize,
    pub kind: Of,
    pub value: f64,
    pub variance: f64,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Of {
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
    pub fn variance(self, fit: f64, limb_error: f64, jitter: f64) -> f64 {
        match self {
            Self::Centre => fit + limb_error + jitter,
            Self::Limb(_) => fit + 2.0 * limb_error + jitter,
            Self::Width => fit + limb_error,
        }
    }
}

/// Unknowns: c, ox, oy, radius scale − 1.
pub(super) type Common = SVector<f64, 4>;

/// What of the capture the model needs.
pub(super) struct Setting {
    pub radius: f64,
    /// Lateral movement of a limb at the object's depth per relative change of the radius, metres.
    pub limb: f64,
    /// 1 / distance, or 0 for parallel rays.
    pub closeness: f64,
    pub limb_error: f64,
    pub orbit: Vec<(f64, f64)>,
    pub prior: Common,
}

impl Setting {
    pub fn new(outlines: &[Outline], capture: &Capture) -> Self {
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
    pub fn limbs(&self, outlines: &[Outline]) -> Vec<Observation> {
        let mut all = Vec::new();
        for (view, outline) in outlines.iter().enumerate() {
            let pose = &outline.pose;
            let width = self.limb * pose.sigma_radius_scale;
            let variance = pose.sigma_lateral.powi(2) + width * width;
            for (side, _) in Side::BOTH.into_iter().zip(outline.sides()).filter(|s| s.1) {
                let (value, ..) = self.tangent(pose.offset[1], pose.radius_scale, side.sign());
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
    pub fn observations(
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
    pub fn prior_weight(&self, common: &Common) -> Common {
        let mut weight = self.prior.map(|s| s.powi(-2));
        weight[3] = 1.0 / (RADIUS_ERROR * RADIUS_ERROR + common[3] * common[3]);
        weight
    }

    /// How c, ox, oy move the object in a view: towards the camera, and to the right.
    pub fn direction(&self, view: usize) -> [Common; 2] {
        let (sin, cos) = self.orbit.get(view).copied().unwrap_or((0.0, 1.0));
        [
            Common::new(0.0, cos, sin, 0.0),
            Common::new(1.0, -sin, cos, 0.0),
        ]
    }

    /// Where the line of sight that touches the object on one side (−1 left, +1 right) meets the plane through the centre of
    /// the orbit, metres, for an object at that depth, `lateral` to the right and `scale` times as large as described;
    /// also the derivatives by these two.
    fn tangent(&self, lateral: f64, scale: f64, side: f64) -> (f64, f64, f64) {
        if !(self.closeness > 0.0) {
            return (
                lateral + side * self.radius * scale,
                1.0,
                side * self.radius,
            );
        }
        let across = self.closeness * lateral;
        let away = across.hypot(1.0);
        let sine = (self.closeness * self.radius * scale / away).min(1.0 - 1e-9);
        let cosine = (1.0 - sine * sine).sqrt();
        let slope = (across.atan() + side * sine.asin()).tan();
        let turn = slope.mul_add(slope, 1.0);
        (
            slope / self.closeness,
            turn * (1.0 - side * across * sine / cosine) / (away * away),
            turn * side * self.radius / (away * cosine),
        )
    }

    /// The derivative of an observation by the unknowns, and its predicted value. Outlines are fitted with the
    /// object at the described distance; nearer by x, everything appears larger by D / (D − x), without any approximation:
    /// the tangents from the camera are the same.
    pub fn predict(&self, o: &Observation, common: &Common) -> (Common, f64) {
        let [towards, right] = self.direction(o.view);
        let nearer = 1.0 / (1.0 - (self.closeness * towards.dot(common)).clamp(-0.5, 0.5));
        let nearer_by = towards * (nearer * nearer * self.closeness);
        let mut scale_row = Common::zeros();
        scale_row[3] = nearer;
        let scale_row = scale_row + nearer_by * (1.0 + common[3]);
        let scale = nearer * (1.0 + common[3]);
        let lateral_row = right * nearer + nearer_by * right.dot(common);
        let lateral = nearer * right.dot(common);
        match o.kind {
            Of::Centre => (lateral_row, lateral),
            Of::Width => (scale_row * self.limb, scale * self.limb),
            Of::Limb(side) => {
                let (value, by_lateral, by_scale) = self.tangent(lateral, scale, side);
                (lateral_row * by_lateral + scale_row * by_scale, value)
            }
        }
    }
}
