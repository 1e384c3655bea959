//! A cylinder whose axis leans out of the normal of the light's plane.
//!
//! Normals then leave the plane by up to the lean t, and a lobe is missed by e = ε_v + ε_l, the elevations of the view and
//! of the light above the cross-section. To leading order a lobe of any form gives B = B₀ − K e²/2, so that B₀ = B −
//! (e/2) ∂B/∂ε_v; what is diffuse depends on neither, up to t²/2. And ∂B/∂ε_v is in the photo itself: rows above and
//! below the measured line see the same normals under other elevations. The light that a lobe shows comes from about the
//! mirror direction γ, so ε_l = axis · (cos γ, sin γ). What a tilt that the outline got wrong by δ adds to those
//! differences, −δ f ∂B/∂u, has another form than the rest, e (a + b B), and is fitted and taken out with it. At a lean of 1° and an exponent of 32 all this is up to 2 % of B.

use nalgebra::{Matrix3, Vector3};

use crate::angle::{WorldAngle, wrap};
use crate::geometry::{Settled, ViewGeometry};
use crate::light_field::{MeasuredLine, Samples, Systematic};
use crate::radiance::Radiance;
use crate::recover::lighting::LightingEstimate;

/// Lean (radians) below which it is left alone: 0.1°, where 2 % have become 2e-4.
const LEAST: f64 = 1.7e-3;
/// Standard deviations by which a lean must show.
const SIGNIFICANT: f64 = 4.0;
/// What the correction is believed to be wrong by, of itself.
const SHARE: f64 = 0.1;
/// Part of the room above and below the line at which the rows beside it are read; as many are averaged to both sides.
const BESIDE: f64 = 0.5;
/// Least and largest such room, pixels.
const LEAST_ROOM: f64 = 3.0;
const MOST_ROOM: f64 = 40.0;
/// |sin θo′| up to which a view's tilt is sought.
const INNER: f64 = 0.9;
/// Half the width of the window in which slopes are averaged, in radii.
const WINDOW: f64 = 0.02;

/// How radiance changes with the view's elevation along a measured line.
#[derive(Debug)]
pub struct Slant {
    /// ∂B/∂ε_v per station and channel, and its variance; `None` where not seen.
    slope: Vec<Vec<Option<(f64, f64)>>>,
    /// Pixels down the image per radian of elevation.
    px_per_radian: f64,
    /// Stations to both sides over which slopes are averaged.
    half: usize,
}

/// One view with what its rows say.
#[derive(Clone, Copy)]
pub struct LeaningView<'a> {
    /// The measured line.
    pub line: &'a MeasuredLine,
    /// The rows beside it.
    pub slant: Option<&'a Slant>,
    /// The settled geometry.
    pub geometry: &'a ViewGeometry,
    /// Direction to the camera.
    pub orbit: WorldAngle,
}

impl Slant {
    /// Reads the rows above and below a line; `None` if there are too few.
    pub fn read(radiance: &Radiance, geometry: &ViewGeometry, line: &MeasuredLine) -> Option<Self> {
        let [top, bottom] = [radiance.rows.start, radiance.rows.end].map(f64::from);
        let room = line
            .positions
            .iter()
            .map(|p| (p[1] - top).min(bottom - p[1]))
            .fold(MOST_ROOM, f64::min);
        if room < LEAST_ROOM {
            return None;
        }
        let offset = BESIDE * room;
        let beside =
            |sign: f64| MeasuredLine::read_below(radiance, geometry, offset, sign * offset).ok();
        let (above, below) = (beside(-1.0)?, beside(1.0)?);
        let count = line.stations.count();
        if above.stations.count() != count || below.stations.count() != count {
            return None;
        }
        let channels = radiance.channels.len();
        let elevation = |l: &MeasuredLine, k: usize| Some(geometry.at(l.positions[k])?.elevation);
        let between = |k: usize| Some(elevation(&below, k)? - elevation(&above, k)?);
        let slope = (0..count)
            .map(|k| {
                let (a, b) = (&above.stations, &below.stations);
                (0..channels)
                    .map(|c| {
                        let d = between(k).filter(|d| *d != 0.0)?;
                        let variance = (a.variance[c][k] + b.variance[c][k]) / (d * d);
                        let slope = (b.value[c][k] - a.value[c][k]) / d;
                        variance.is_finite().then_some((slope, variance))
                    })
                    .collect()
            })
            .collect();
        Some(Self {
            slope,
            px_per_radian: 2.0 * offset / between(count / 2)?,
            half: (WINDOW * geometry.radius_px()?).ceil() as usize,
        })
    }
}

/// The lean of an axis.
#[derive(Clone, Debug)]
pub struct Lean {
    /// Towards orbit angles 0° and 90°, radians.
    axis: [f64; 2],
    /// By how much each view's slopes follow its ∂B/∂u.
    slide: Vec<f64>,
}

/// Whether a set's outlines show a lean that matters.
pub fn shows(settled: &Settled) -> bool {
    let [x, y] = settled.axis;
    let size = x.hypot(y);
    size > LEAST && size > SIGNIFICANT * settled.sigma_axis
}

impl Lean {
    /// The lean of a set, if it has one.
    pub fn of(settled: &Settled, views: &[LeaningView<'_>]) -> Option<Self> {
        if !shows(settled) {
            return None;
        }
        let mut lean = Self {
            axis: settled.axis,
            slide: vec![0.0; views.len()],
        };
        // A tilt that goes as c + x sin φ − y cos φ: see `Settled::axis`.
        let mut normal = Matrix3::<f64>::zeros();
        let mut right = Vector3::<f64>::zeros();
        for (k, view) in views.iter().enumerate() {
            let (Some(slant), Some((slide, weight))) = (view.slant, lean.slide_of(view)) else {
                continue;
            };
            lean.slide[k] = slide;
            let tilt = view.geometry.pose().tilt - slide / slant.px_per_radian;
            let (sin, cos) = view.orbit.rad().sin_cos();
            let row = Vector3::new(1.0, sin, -cos);
            normal += weight * row * row.transpose();
            right += weight * row * tilt;
        }
        if let Some(inverse) = normal.try_inverse() {
            let fitted = inverse * right;
            lean.axis = [fitted[1], fitted[2]];
        }
        Some(lean)
    }

    /// Elevations of view and mirrored light together at a position, radians.
    fn missed(&self, view: &LeaningView<'_>, position: [f64; 2]) -> Option<f64> {
        let seen = view.geometry.at(position)?;
        // The tilt across the line of sight is in `seen` already; what leans towards the camera is not.
        let mirror = wrap(view.orbit.rad() + seen.alpha - seen.local);
        Some(seen.elevation + self.elevation(view.orbit.rad()) + self.elevation(mirror))
    }

    /// The part of a view's slopes that goes as ∂B/∂u (per pixel) beside e and e B, and its weight.
    fn slide_of(&self, view: &LeaningView<'_>) -> Option<(f64, f64)> {
        let slant = view.slant?;
        let channels = view.line.stations.channels();
        let (mut along, mut across) = (0.0, 0.0);
        for c in 0..channels {
            let mut normal = Matrix3::<f64>::zeros();
            let mut right = Vector3::<f64>::zeros();
            for k in 1..view.line.stations.count().saturating_sub(1) {
                let position = view.line.positions[k];
                // Towards the limb θo′ is no longer even over a pixel.
                if !(view.geometry.sin_local(position).abs() < INNER) {
                    continue;
                }
                let (Some((slope, _)), Some(e)) = (slant.slope[k][c], self.missed(view, position))
                else {
                    continue;
                };
                let Some(change) = change(view.line, c, k) else {
                    continue;
                };
                let row = Vector3::new(change, e, e * view.line.stations.value[c][k]);
                normal += row * row.transpose();
                right += row * slope;
            }
            // What ∂B/∂u explains alone, in its own weight.
            if let Some(inverse) = normal.try_inverse()
                && inverse[(0, 0)] > 0.0
            {
                across += (inverse * right)[0] / inverse[(0, 0)];
                along += 1.0 / inverse[(0, 0)];
            }
        }
        (along > 0.0).then(|| (across / along, along))
    }

    /// Elevation of the direction θ of the light's plane above the cross-section, radians.
    fn elevation(&self, theta: f64) -> f64 {
        self.axis[0] * theta.cos() + self.axis[1] * theta.sin()
    }

    /// View `k`'s line as an upright cylinder would show it.
    pub fn corrected(&self, k: usize, view: &LeaningView<'_>) -> Option<MeasuredLine> {
        let slant = view.slant?;
        let slide = self.slide.get(k)?;
        let mut upright = view.line.clone();
        let count = upright.stations.count();
        for i in 0..count {
            let Some(e) = self.missed(view, view.line.positions[i]) else {
                continue;
            };
            let window = i.saturating_sub(slant.half).max(1)..(i + slant.half + 1).min(count - 1);
            for c in 0..upright.stations.channels() {
                let near = window.clone().filter_map(|k| {
                    let (slope, variance) = slant.slope[k][c]?;
                    Some((slope - slide * change(view.line, c, k)?, variance))
                });
                let (n, sum, variance) = near.fold((0.0, 0.0, 0.0), |t, (slope, variance)| {
                    (t.0 + 1.0, t.1 + slope, t.2 + variance)
                });
                if n > 0.0 {
                    upright.stations.value[c][i] -= 0.5 * e * sum / n;
                    upright.stations.variance[c][i] += 0.25 * e * e * variance / (n * n);
                }
            }
        }
        Some(upright)
    }

    /// What to tell the user.
    pub fn warning(&self, corrected: usize, views: usize) -> String {
        let [x, y] = self.axis;
        format!(
            "The cylinder's axis leans by {:.2}°, towards {:.0}° of the orbit. What that does to the highlights was taken out in {corrected} of {views} views with the rows above and below the cross-section{}. Set it upright for the best results.",
            x.hypot(y).to_degrees(),
            y.atan2(x).to_degrees(),
            if corrected < views {
                "; the others have too few"
            } else {
                ""
            }
        )
    }

    /// What the lean does to all light alike, relative: cosines of normals that leave the plane are short by up to t²/2.
    pub fn scale_sigma(&self) -> f64 {
        let [x, y] = self.axis;
        0.5 * (x * x + y * y)
    }
}

/// ∂B/∂u at a station of a line, per pixel; `None` next to one that was not seen, whose value says nothing.
fn change(line: &MeasuredLine, channel: usize, k: usize) -> Option<f64> {
    let stations = &line.stations;
    let seen = |k: usize| {
        let known = stations.variance[channel].get(k)?.is_finite();
        known.then(|| stations.value[channel][k])
    };
    seen(k)?;
    Some(0.5 * (seen(k + 1)? - seen(k.checked_sub(1)?)?))
}

/// The correction's own error, from the samples with and without it.
pub fn systematic(upright: &Samples, leaning: &Samples) -> Systematic {
    let change = (0..upright.channels.len()).map(|c| {
        let columns = upright.columns.iter().zip(&leaning.columns);
        columns
            .map(|(a, b)| {
                let before = |i: usize| b.value[c].get(i).copied();
                let values = a.value[c].iter().enumerate();
                values
                    .map(|(i, a)| SHARE * (a - before(i).unwrap_or(*a)))
                    .collect()
            })
            .collect()
    });
    Systematic {
        name: "lean of the cylinder's axis".into(),
        change: change.collect(),
    }
}

/// Adds to a recovered light's σ that all of it may be wrong by the factor 1 ± `sigma`.
pub fn scale(lighting: &mut LightingEstimate, sigma: f64) {
    for channel in &mut lighting.channels {
        for l in &mut channel.spectrum {
            l.sigma = l.sigma.hypot(l.value.norm() * sigma);
        }
        for (s, l) in channel.table_sigma.iter_mut().zip(&channel.table) {
            *s = s.hypot(l * sigma);
        }
    }
    for source in &mut lighting.sources {
        for (s, e) in source.irradiance_sigma.iter_mut().zip(&source.irradiance) {
            *s = s.hypot(e * sigma);
        }
    }
}
