//! The object's outline in one photo: where its limb is, to a fraction of a pixel, and the pose that follows.
//!
//! Strips of pixels about the limb that the description predicts are searched for the limb
//! (`edge`), the bands of rows and both sides must agree (`consensus`), and the exact perspective
//! outline is fitted to what was found (`fit`). Either side may be invisible.

mod consensus;
mod edge;
mod fit;
mod scenery;
mod strip;

use crate::capture::{GivenOutline, Object, Shape};
use crate::error::{Error, Result};
use crate::radiance::Radiance;

use super::camera::CameraModel;
use super::surface::{Pose, Side, ViewGeometry};

/// Least brightness just inside the limb against the background, in σ of the fit: with less, the smooth
/// start of a shadow is as good an explanation.
const LEAST_CONTRAST: f64 = 6.0;

/// Variance by the scenery that a point has at least, relative to what the points of its side usually have: beside one that
/// looks level, a part that is not may be hidden.
const LEAST_SCENERY: f64 = 0.5;

/// Strips that tell a photo's blur.
const BLUR_STRIPS: usize = 3;

/// Where to look for the limb.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Largest displacement of the object from the description, in radii.
    pub shift: f64,
    /// Largest relative error of the described radius.
    pub radius: f64,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            shift: 0.12,
            radius: 0.06,
        }
    }
}

/// A place where the limb was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimbPoint {
    /// Which side of the object.
    pub side: Side,
    /// Row position, pixels from the top of the image.
    pub row: f64,
    /// Column position, pixels from the left of the image.
    pub column: f64,
    /// Standard deviation of the column.
    pub sigma_px: f64,
}

/// Where an outline comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Both sides of the limb were measured.
    Both,
    /// One side was measured; the radius is the description's.
    Only(Side),
    /// No limb is visible; the pose is the description's.
    NotFound,
    /// Given by the user.
    Given,
}

/// The outline of the object in one view.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Where it comes from.
    pub status: Status,
    /// Middle of the cross-section's two limb points, pixels.
    pub centre_px: [f64; 2],
    /// Standard deviation of the centre across the image, pixels; infinite if no limb was found.
    pub sigma_centre_px: f64,
    /// Half the width of the cross-section, pixels.
    pub radius_px: f64,
    /// Half the width that the description predicts, pixels.
    pub predicted_radius_px: f64,
    /// The pose, with the object at the described distance.
    pub pose: Pose,
    /// Standard deviation of the upward offset, metres.
    pub sigma_vertical: f64,
    /// The measured limb, for drawing; empty if given or not found.
    pub limb: Vec<LimbPoint>,
}

impl Outline {
    /// Which sides were measured: left, right.
    pub fn sides(&self) -> [bool; 2] {
        match self.status {
            Status::Both | Status::Given => [true, true],
            Status::Only(side) => [side == Side::Left, side == Side::Right],
            Status::NotFound => [false, false],
        }
    }

    /// How the photo disagrees with the description.
    pub fn disagreement(&self, object: &Object) -> Disagreement {
        Disagreement {
            shift: self.pose.offset[1] / object.radius,
            sigma_shift: self.pose.sigma_lateral / object.radius,
            radius: self.pose.radius_scale - 1.0,
            sigma_radius: match self.status {
                Status::Both | Status::Given => self.pose.sigma_radius_scale,
                Status::Only(_) | Status::NotFound => f64::INFINITY,
            },
        }
    }
}

/// Measured minus described, relative to the described radius; an infinite σ means not measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement {
    /// Lateral displacement of the centre, in radii, positive to the right.
    pub shift: f64,
    /// Its standard deviation.
    pub sigma_shift: f64,
    /// Relative error of the described apparent radius.
    pub radius: f64,
    /// Its standard deviation.
    pub sigma_radius: f64,
}

/// Finds the outline in a view's radiance, starting from the description's prediction.
///
/// # Errors
/// If the camera of the description is inside the object. A limb that cannot be seen is no error: see
/// [`Status`].
pub fn find(
    radiance: &Radiance,
    camera: &CameraModel,
    object: &Object,
    search: Search,
) -> Result<Outline> {
    let nominal = ViewGeometry::new(camera, object, Pose::nominal(), 0.0);
    let radius_px = predicted_radius(&nominal, camera, object)?;
    let reach = consensus::Reach {
        shift: search.shift * radius_px,
        radius: search.radius * radius_px,
    };
    let strips = strip::cut(radiance, &nominal, object.shape, reach.shift + 24.0);
    let detector = edge::Detector::new();
    let profiles: Vec<_> = strips.iter().map(strip::Strip::profile).collect();
    let candidates: Vec<_> = strips
        .into_iter()
        .zip(&profiles)
        .map(|(s, p)| {
            let found = detector.candidates(p);
            (s, found)
        })
        .collect();
    let lines = consensus::agree(&candidates, object.shape, reach);
    // Where each strip's limb would be in a sharp photo.
    let sharp: Vec<Option<(f64, Option<edge::Edge>)>> = candidates
        .iter()
        .zip(&profiles)
        .map(|((strip, _), profile)| {
            let line = lines[usize::from(strip.side == Side::Right)]?;
            let start = line.depth(strip.row);
            Some((start, edge::locate(strip, profile, start, radius_px, 0.0)))
        })
        .collect();
    let blur = blur(&candidates, &profiles, &sharp, radius_px);
    let mut limb = Vec::new();
    let mut sceneries = Vec::new();
    let mut model_errors = [Vec::new(), Vec::new()];
    for (((strip, _), profile), sharp) in candidates.iter().zip(&profiles).zip(&sharp) {
        let Some((start, sharp)) = *sharp else {
            continue;
        };
        let found = if blur > 0.0 {
            edge::locate(strip, profile, start, radius_px, blur)
        } else {
            sharp
        };
        let Some(found) = found.filter(|e| e.contrast.abs() > LEAST_CONTRAST) else {
            continue;
        };
        let Some(predicted) = nominal.limb_at_row(strip.row, strip.side) else {
            continue;
        };
        model_errors[usize::from(strip.side == Side::Right)].push(found.sigma_model);
        sceneries.push(scenery::Scenery::behind(strip, profile, &found, blur));
        limb.push(LimbPoint {
            side: strip.side,
            row: strip.row,
            column: predicted - strip.side.sign() * found.depth,
            sigma_px: found.sigma,
        });
    }
    for side in Side::BOTH {
        let of_side = |p: &LimbPoint| p.side == side;
        let mut all: Vec<f64> = limb
            .iter()
            .zip(&sceneries)
            .filter(|(p, _)| of_side(p))
            .map(|(_, scenery)| scenery.variance())
            .collect();
        let middle = all.len() / 2;
        all.sort_by(f64::total_cmp);
        let usual = all.get(middle).copied().unwrap_or(0.0);
        let points = limb.iter_mut().zip(&mut sceneries);
        for (point, scenery) in points.filter(|(p, _)| of_side(p)) {
            scenery.known = scenery.variance().max(LEAST_SCENERY * usual);
            point.sigma_px = point.sigma_px.hypot(scenery.known.sqrt());
        }
    }
    let seen = Side::BOTH.map(|side| limb.iter().any(|p| p.side == side));
    let fitted = if seen == [false, false] {
        None
    } else {
        fit::fit(camera, object, Pose::nominal(), &limb, &sceneries)
    };
    let Some(mut fitted) = fitted else {
        return Ok(not_found(&nominal, object, radius_px, search));
    };
    fitted.add_model_error(
        camera,
        object,
        model_errors.map(|mut side| {
            let middle = side.len() / 2;
            side.sort_by(f64::total_cmp);
            side.get(middle).copied()
        }),
    );
    let status = match seen {
        [true, true] => Status::Both,
        [true, false] => Status::Only(Side::Left),
        _ => Status::Only(Side::Right),
    };
    Ok(assemble(status, fitted, camera, object, radius_px, limb))
}

/// The photo's blur, pixels, from the strips with the most contrast; `sharp`: where the limb would be without.
fn blur(
    candidates: &[(strip::Strip, Vec<edge::Candidate>)],
    profiles: &[strip::Profile],
    sharp: &[Option<(f64, Option<edge::Edge>)>],
    radius_px: f64,
) -> f64 {
    let mut found: Vec<(f64, edge::Found<'_>)> = candidates
        .iter()
        .zip(profiles)
        .zip(sharp)
        .filter_map(|(((strip, _), profile), sharp)| {
            let (start, sharp) = (*sharp)?;
            let contrast = sharp.map_or(0.0, |e| e.contrast.abs());
            let found = edge::Found {
                strip,
                profile,
                start,
                sharp,
            };
            Some((contrast, found))
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(BLUR_STRIPS);
    if found.is_empty() {
        0.0
    } else {
        edge::blur(found.into_iter().map(|f| f.1).collect(), radius_px)
    }
}

/// The outline that the user measured: half its width and its centre.
///
/// # Errors
/// A radius that is not positive, or an outline that no position of the object could show.
pub fn given(outline: GivenOutline, camera: &CameraModel, object: &Object) -> Result<Outline> {
    let nominal = ViewGeometry::new(camera, object, Pose::nominal(), 0.0);
    let radius_px = predicted_radius(&nominal, camera, object)?;
    let [u, v] = outline.centre_px;
    let r = outline.radius_px;
    if !(r > 0.0 && [u, v, r].iter().all(|x| x.is_finite())) {
        return Err(Error::input(format!(
            "expected a finite centre and a radius above 0, found ({u}, {v}) and {r}"
        ))
        .key("view.outline"));
    }
    let (left, right) = (camera.ray([u - r, v]), camera.ray([u + r, v]));
    let (centre, apparent) = if camera.is_orthographic() {
        let across = right.origin - left.origin;
        let mut centre = 0.5 * (left.origin + right.origin);
        centre.x = 0.0;
        (centre, 0.5 * across.norm())
    } else {
        let (a, b) = (left.direction.normalize(), right.direction.normalize());
        let middle = a + b;
        let depth = camera.distance() / -middle.x;
        let centre = camera.centre() + middle * depth;
        let sine = 0.5 * (b - a).norm();
        (centre, sine * middle.norm() * depth)
    };
    let scale = apparent / object.radius;
    // A quarter of a pixel: what a careful user reads off a screen.
    let sigma_px = 0.25;
    let sigma = sigma_px * camera.metres_per_px();
    let pose = Pose {
        offset: match object.shape {
            Shape::Cylinder => [0.0, centre.y, 0.0],
            Shape::Sphere => centre.into(),
        },
        radius_scale: scale,
        sigma_lateral: sigma,
        sigma_radius_scale: sigma / object.radius,
        ..Pose::nominal()
    };
    let fitted = fit::Fitted {
        pose,
        sigma_vertical: sigma,
    };
    let result = assemble(Status::Given, fitted, camera, object, radius_px, Vec::new());
    if result.radius_px.is_finite() {
        Ok(result)
    } else {
        Err(Error::input(format!(
            "an outline of radius {r} px means an object that reaches the camera"
        ))
        .key("view.outline"))
    }
}

fn predicted_radius(nominal: &ViewGeometry, camera: &CameraModel, object: &Object) -> Result<f64> {
    nominal
        .radius_px()
        .filter(|r| r.is_finite() && *r > 0.0)
        .ok_or_else(|| {
            Error::input(format!(
                "the camera at {} m from the centre would be inside the object of radius {} m",
                camera.distance(),
                object.radius
            ))
            .key("camera.distance")
        })
}

fn not_found(nominal: &ViewGeometry, object: &Object, radius_px: f64, search: Search) -> Outline {
    let pose = Pose {
        sigma_lateral: search.shift * object.radius,
        ..Pose::nominal()
    };
    let [u, v] = nominal.trace(0.0).map_or([f64::NAN; 2], |p| p.pixel);
    Outline {
        status: Status::NotFound,
        centre_px: [u, v],
        sigma_centre_px: f64::INFINITY,
        radius_px,
        predicted_radius_px: radius_px,
        pose,
        sigma_vertical: f64::INFINITY,
        limb: Vec::new(),
    }
}

fn assemble(
    status: Status,
    fitted: fit::Fitted,
    camera: &CameraModel,
    object: &Object,
    predicted_radius_px: f64,
    limb: Vec<LimbPoint>,
) -> Outline {
    let g = ViewGeometry::new(camera, object, fitted.pose, 0.0);
    let ends = Side::BOTH.map(|side| g.limb(side).map_or([f64::NAN; 2], |p| p.pixel));
    Outline {
        status,
        centre_px: [0, 1].map(|i| 0.5 * (ends[0][i] + ends[1][i])),
        sigma_centre_px: fitted.pose.sigma_lateral / camera.metres_per_px(),
        radius_px: 0.5 * (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1]),
        predicted_radius_px,
        pose: fitted.pose,
        sigma_vertical: fitted.sigma_vertical,
        limb,
    }
}

#[cfg(test)]
mod stated;
#[cfg(test)]
mod tests;
