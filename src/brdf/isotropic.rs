//! Isotropic BRDFs in 3-D: a pair of directions by its scalars, and the energy over the hemisphere.

use std::f64::consts::{FRAC_PI_2, PI};
use std::num::NonZeroUsize;

use super::Brdf;
use crate::angle::LocalAngle;

/// An incident and an exitant direction above the surface, by the scalars in which models are written.
///
/// In the plane, with signed angles a = θi′ and b = θo′: half angle (a + b)/2, difference angle
/// (a − b)/2, angle from the mirror direction a + b.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// cos θi′ > 0.
    pub cos_incident: f64,
    /// cos θo′ > 0.
    pub cos_exitant: f64,
    /// |sin θi′|.
    pub sin_incident: f64,
    /// |sin θo′|.
    pub sin_exitant: f64,
    /// Cosine of the azimuth between the two directions: 1 on the same side of the normal, −1 opposite.
    pub cos_azimuth: f64,
    /// Cosine of the angle between the normal and the half vector.
    pub cos_half: f64,
    /// Square of the sine of that angle (kept apart: 1 − cos² loses the narrow lobes).
    pub sin2_half: f64,
    /// Cosine of the angle between either direction and the half vector.
    pub cos_difference: f64,
    /// Cosine of the angle between the exitant direction and the mirrored incident one.
    pub cos_mirror: f64,
}

impl Pair {
    /// Two directions in the measurement plane; `None` if either is at or below the horizon.
    pub fn in_plane(incident: LocalAngle, exitant: LocalAngle) -> Option<Self> {
        Self::towards(exitant)(incident)
    }

    /// The same for many incident directions and one exitant one.
    pub fn towards(exitant: LocalAngle) -> impl Fn(LocalAngle) -> Option<Self> {
        let of_half = Self::towards_of_half(exitant);
        move |incident| {
            if incident.rad().abs() >= FRAC_PI_2 {
                return None;
            }
            of_half((0.5 * incident.rad()).sin_cos())
        }
    }

    /// The same by sine and cosine of half the incident angle, for those who have them.
    pub(crate) fn towards_of_half(exitant: LocalAngle) -> impl Fn((f64, f64)) -> Option<Self> {
        let above = exitant.rad().abs() < FRAC_PI_2;
        let half = (0.5 * exitant.rad()).sin_cos();
        move |incident| above.then(|| Self::of_halves(incident, half)).flatten()
    }

    /// By sine and cosine of half the incident and of half the exitant angle.
    fn of_halves((si, ci): (f64, f64), (so, co): (f64, f64)) -> Option<Self> {
        let sin_half = si * co + ci * so;
        let cos_half = ci * co - si * so;
        let cos_incident = (ci - si) * (ci + si);
        let cos_exitant = (co - so) * (co + so);
        (cos_incident > 0.0 && cos_exitant > 0.0).then(|| Self {
            cos_incident,
            cos_exitant,
            sin_incident: 2.0 * (si * ci).abs(),
            sin_exitant: 2.0 * (so * co).abs(),
            cos_azimuth: if si * so >= 0.0 { 1.0 } else { -1.0 },
            cos_half,
            sin2_half: sin_half * sin_half,
            cos_difference: ci * co + si * so,
            cos_mirror: (cos_half - sin_half) * (cos_half + sin_half),
        })
    }

    /// Polar angles in [0, π/2) and the azimuth between the two directions (0: same side), radians.
    pub fn in_space(incident: f64, exitant: f64, azimuth: f64) -> Self {
        let (si, ci) = incident.sin_cos();
        let (so, co) = exitant.sin_cos();
        let cos_azimuth = azimuth.cos();
        let between = si * so * cos_azimuth + ci * co;
        let cos_difference = ((1.0 + between) / 2.0).max(0.0).sqrt();
        let length2 = 4.0 * cos_difference * cos_difference;
        Self {
            cos_incident: ci,
            cos_exitant: co,
            sin_incident: si,
            sin_exitant: so,
            cos_azimuth,
            cos_half: (ci + co) / length2.sqrt(),
            sin2_half: (si * si + so * so + 2.0 * si * so * cos_azimuth) / length2,
            cos_difference,
            cos_mirror: ci * co - si * so * cos_azimuth,
        }
    }

    /// Unit vectors: the surface normal and the two directions; `None` if either is at or below the
    /// horizon.
    pub fn between(normal: [f64; 3], incident: [f64; 3], exitant: [f64; 3]) -> Option<Self> {
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        // |a × b|²: sines keep their digits where cosines are near 1.
        let cross2 = |a: [f64; 3], b: [f64; 3]| {
            let x = a[1] * b[2] - a[2] * b[1];
            let y = a[2] * b[0] - a[0] * b[2];
            let z = a[0] * b[1] - a[1] * b[0];
            x * x + y * y + z * z
        };
        let (ci, co) = (dot(normal, incident), dot(normal, exitant));
        if !(ci > 0.0 && co > 0.0) {
            return None;
        }
        let half = [0, 1, 2].map(|k| incident[k] + exitant[k]);
        let length2 = dot(half, half);
        let length = length2.sqrt();
        let sines = (cross2(normal, incident) * cross2(normal, exitant)).sqrt();
        let tangential = dot(incident, exitant) - ci * co;
        Some(Self {
            cos_incident: ci,
            cos_exitant: co,
            sin_incident: cross2(normal, incident).sqrt(),
            sin_exitant: cross2(normal, exitant).sqrt(),
            cos_azimuth: if sines > 0.0 {
                (tangential / sines).clamp(-1.0, 1.0)
            } else {
                1.0
            },
            cos_half: (ci + co) / length,
            sin2_half: cross2(normal, half) / length2,
            cos_difference: 0.5 * length,
            cos_mirror: ci * co - tangential,
        })
    }

    /// tan² of the half vector's angle.
    pub fn tan2_half(&self) -> f64 {
        self.sin2_half / (self.cos_half * self.cos_half)
    }
}

/// A BRDF whose 3-D form is known; its in-plane slice is its [`Brdf::value`].
pub trait Isotropic: Brdf {
    /// The 3-D BRDF without its delta part, sr⁻¹, no cosine in it.
    fn rho(&self, pair: &Pair) -> f64;

    /// [`Self::rho`] of many pairs, one after another into `rho`.
    fn rho_of_all(&self, pairs: &[Pair], rho: &mut Vec<f64>) {
        rho.clear();
        rho.extend(pairs.iter().map(|pair| self.rho(pair)));
    }
}

/// The in-plane slice of the 3-D form: the body of every model's [`Brdf::value`].
pub(super) fn slice(model: &impl Isotropic, incident: LocalAngle, exitant: LocalAngle) -> f64 {
    Pair::in_plane(incident, exitant).map_or(0.0, |pair| model.rho(&pair))
}

/// Share of the light from polar angle `incident` (radians) that leaves into the hemisphere:
/// ∫ ρ cos θo dω, plus the mirror's. Product Gauss–Legendre rule in the half vector's neighbourhood:
/// panels in θo and in azimuth shrink towards the mirror direction; 1e-6 for lobes wider than 0.01 rad.
pub fn directional_albedo(model: &dyn Isotropic, incident: f64) -> f64 {
    let width = model.lobe_width();
    let polar = graded_nodes(0.0, FRAC_PI_2, incident, width);
    let mut sum = 0.0;
    for &(theta, w) in &polar {
        // Near the pole a lobe of this width spans a larger azimuth.
        let azimuths = graded_nodes(0.0, PI, PI, width / theta.sin().max(width));
        let ring: f64 = azimuths
            .iter()
            .map(|&(phi, v)| v * model.rho(&Pair::in_space(incident, theta, phi)))
            .sum();
        sum += w * 2.0 * ring * theta.sin() * theta.cos();
    }
    sum + model.mirror(LocalAngle::radians(-incident))
}

/// Nodes and weights of a composite rule over [a, b] whose panels grow from `width` at `focus`.
fn graded_nodes(a: f64, b: f64, focus: f64, width: f64) -> Vec<(f64, f64)> {
    let Some(n) = NonZeroUsize::new(12) else {
        return Vec::new();
    };
    let rule = gauss_quad::GaussLegendre::new(n);
    let mut ends = vec![a, b];
    if focus > a && focus < b {
        ends.push(focus);
    }
    for side in [-1.0, 1.0] {
        let mut at = width.max(1e-4);
        while at < b - a {
            let end = focus + side * at;
            if end > a && end < b {
                ends.push(end);
            }
            at *= 2.0;
        }
    }
    ends.sort_by(f64::total_cmp);
    let mut nodes = Vec::with_capacity(ends.len() * n.get());
    for pair in ends.windows(2) {
        let (middle, half) = ((pair[0] + pair[1]) / 2.0, (pair[1] - pair[0]) / 2.0);
        nodes.extend(rule.iter().map(|(x, w)| (middle + half * x, half * w)));
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plane_is_a_slice_of_space() {
        for a in [-80.0f64, -30.0, 0.0, 10.0, 75.0] {
            for b in [-85.0f64, -20.0, 5.0, 60.0] {
                let plane = Pair::in_plane(LocalAngle::degrees(a), LocalAngle::degrees(b))
                    .expect("both above the horizon");
                let azimuth = if a * b >= 0.0 { 0.0 } else { PI };
                let space = Pair::in_space(a.abs().to_radians(), b.abs().to_radians(), azimuth);
                // A few roundings of numbers of size 1, divided by |i + o|² ≥ 0.1.
                for (p, s) in [
                    (plane.cos_incident, space.cos_incident),
                    (plane.sin_exitant, space.sin_exitant),
                    (plane.cos_half, space.cos_half),
                    (plane.sin2_half, space.sin2_half),
                    (plane.cos_difference, space.cos_difference),
                    (plane.cos_mirror, space.cos_mirror),
                ] {
                    assert!((p - s).abs() < 1e-14, "{a} {b}: {p} {s}");
                }
            }
        }
    }

    #[test]
    fn vectors_say_the_same_as_angles() {
        for (i, o, azimuth) in [
            (0.3f64, 1.2f64, 2.0f64),
            (1.5, 1.4, 3.1),
            (0.01, 0.02, 0.4),
            (0.0, 0.7, 1.0),
        ] {
            // The frame is turned, so that no component is special.
            let turn = nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.3);
            let direction = |polar: f64, azimuth: f64| -> [f64; 3] {
                let (s, c) = polar.sin_cos();
                (turn * nalgebra::Vector3::new(s * azimuth.cos(), s * azimuth.sin(), c)).into()
            };
            let vectors = Pair::between(
                direction(0.0, 0.0),
                direction(i, 0.0),
                direction(o, azimuth),
            )
            .expect("both above the horizon");
            let angles = Pair::in_space(i, o, azimuth);
            for (v, a) in [
                (vectors.cos_incident, angles.cos_incident),
                (vectors.sin_exitant, angles.sin_exitant),
                (vectors.cos_half, angles.cos_half),
                (vectors.sin2_half, angles.sin2_half),
                (vectors.cos_difference, angles.cos_difference),
                (vectors.cos_mirror, angles.cos_mirror),
            ] {
                // A few roundings of numbers of size 1.
                assert!((v - a).abs() < 1e-14, "{i} {o} {azimuth}: {v} {a}");
            }
            // The quotient of small sines is known to 1e-16 over their product.
            if i > 0.0 {
                assert!((vectors.cos_azimuth - angles.cos_azimuth).abs() < 1e-11);
            }
        }
        assert!(Pair::between([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]).is_none());
    }

    #[test]
    fn nothing_lies_below_the_horizon() {
        let up = LocalAngle::radians(0.0);
        assert!(Pair::in_plane(LocalAngle::degrees(90.0), up).is_none());
        assert!(Pair::in_plane(up, LocalAngle::degrees(-91.0)).is_none());
    }
}
