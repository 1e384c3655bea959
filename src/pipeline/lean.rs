//! A cylinder whose axis leans out of the normal of the light's plane.
//!
//! Normals then leave the plane by up to the lean t, and a lobe is missed by e = ε_v + ε_l, the elevations of the view and
//! of the light above the cross-section. To leading order a lobe of any form gives B = B₀ − K e²/2, so that B₀ = B −
//! (e/2) ∂B/∂ε_v; what is diffuse depends on neither, up to t²/2. And ∂B/∂ε_v is in the photo itself: rows above and
//! below the measured line see the same normals under other elevations. The light that a lobe shows comes from about the
//! mirror direction γ, so ε_l = axis · (cos γ, sin γ). At a lean of 1° and an exponent of 32 all this is up to 2 % of B.

use crate::angle::{WorldAngle, wrap};
use crate::geometry::{Settled, ViewGeometry};
use crate::light_field::{MeasuredLine, Samples, Systematic};
use crate::radiance::Radiance;

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
/// Half the width of the window in which slopes are averaged, in radii.
const WINDOW: f64 = 0.02;

/// How radiance changes with the view's elevation along a measured line.
#[derive(Debug)]
pub struct Slant {
    /// ∂B/∂ε_v per station and channel, and its variance; `None` where not seen.
    slope: Vec<Vec<Option<(f64, f64)>>>,
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
        let count = line.stations.len();
        if above.stations.len() != count || below.stations.len() != count {
            return None;
        }
        let channels = radiance.channels.len();
        let raw: Vec<Vec<Option<(f64, f64)>>> = (0..count)
            .map(|k| {
                let elevation = |l: &MeasuredLine| Some(geometry.at(l.positions[k])?.elevation);
                let between = elevation(&below).zip(elevation(&above)).map(|(b, a)| b - a);
                (0..channels)
                    .map(|c| {
                        let (a, b) = (&above.stations[k], &below.stations[k]);
                        let d = between.filter(|d| *d != 0.0)?;
                        let variance = (a.variance[c] + b.variance[c]) / (d * d);
                        let slope = (b.value[c] - a.value[c]) / d;
                        variance.is_finite().then_some((slope, variance))
                    })
                    .collect()
            })
            .collect();
        let half = (WINDOW * geometry.radius_px()?).ceil() as usize;
        let slope = (0..count)
            .map(|k| {
                let window = k.saturating_sub(half)..(k + half + 1).min(count);
                (0..channels)
                    .map(|c| {
                        let near = raw[window.clone()].iter().filter_map(|s| s[c]);
                        let (n, s, v) = near.fold((0.0, 0.0, 0.0), |t, (slope, variance)| {
                            (t.0 + 1.0, t.1 + slope, t.2 + variance)
                        });
                        (n > 0.0).then(|| (s / n, v / (n * n)))
                    })
                    .collect()
            })
            .collect();
        Some(Self { slope })
    }
}

/// The lean of an axis.
#[derive(Clone, Copy, Debug)]
pub struct Lean {
    /// Towards orbit angles 0° and 90°, radians.
    axis: [f64; 2],
}

impl Lean {
    /// The lean of a set, if it has one.
    pub fn of(settled: &Settled) -> Option<Self> {
        let [x, y] = settled.axis;
        let size = x.hypot(y);
        let shows = size > LEAST && size > SIGNIFICANT * settled.sigma_axis;
        shows.then_some(Self { axis: [x, y] })
    }

    /// Elevation of the direction θ of the light's plane above the cross-section, radians.
    fn elevation(&self, theta: f64) -> f64 {
        self.axis[0] * theta.cos() + self.axis[1] * theta.sin()
    }

    /// The line as an upright cylinder would show it.
    pub fn corrected(
        &self,
        line: &MeasuredLine,
        slant: &Slant,
        geometry: &ViewGeometry,
        orbit: WorldAngle,
    ) -> MeasuredLine {
        let mut upright = line.clone();
        let positions = upright.positions.iter();
        for ((station, position), slope) in
            upright.stations.iter_mut().zip(positions).zip(&slant.slope)
        {
            let Some(seen) = geometry.at(*position) else {
                continue;
            };
            // The tilt across the line of sight is in `seen` already; what leans towards the camera is not.
            let mirror = wrap(orbit.rad() + seen.alpha - seen.local);
            let e = seen.elevation + self.elevation(orbit.rad()) + self.elevation(mirror);
            for (c, slope) in slope.iter().enumerate() {
                if let Some((slope, variance)) = slope {
                    station.value[c] -= 0.5 * e * slope;
                    station.variance[c] += 0.25 * e * e * variance;
                }
            }
        }
        upright
    }

    /// What to tell the user.
    pub fn warning(&self, corrected: bool) -> String {
        let [x, y] = self.axis;
        format!(
            "The cylinder's axis leans by {:.2}°, towards {:.0}° of the orbit; {}",
            x.hypot(y).to_degrees(),
            y.atan2(x).to_degrees(),
            if corrected {
                "what that does to the highlights was taken out with the rows above and below the cross-section. Set it upright for the best results."
            } else {
                "the photos have too few rows to take out what that does to the highlights. Set it upright, or take higher photos."
            }
        )
    }
}

/// The correction's own error, from the samples with and without it.
pub fn systematic(upright: &Samples, leaning: &Samples) -> Option<Systematic> {
    let change = (0..upright.channels.len())
        .map(|c| {
            upright
                .columns
                .iter()
                .zip(&leaning.columns)
                .map(|(a, b)| {
                    let pairs = a.value[c].iter().zip(&b.value[c]);
                    (a.alpha.len() == b.alpha.len())
                        .then(|| pairs.map(|(a, b)| SHARE * (a - b)).collect())
                })
                .collect()
        })
        .collect::<Option<_>>()?;
    Some(Systematic {
        name: "lean of the cylinder's axis".into(),
        change,
    })
}
