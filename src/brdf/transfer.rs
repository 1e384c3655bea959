//! The transfer function's Fourier coefficients in θi′ at a given θo′, by quadrature.

use std::f64::consts::FRAC_PI_2;
use std::num::NonZeroUsize;
use std::sync::OnceLock;

use num_complex::Complex64;

use super::{Brdf, Pair};
use crate::angle::LocalAngle;

/// Most nodes of one Gauss–Legendre panel.
const MOST_NODES: usize = 96;

/// Longest panel, in units of its distance from the nearest focus (or of the focus' width).
///
/// A pole at the distance δ beside the end of a panel of length 2.5 δ, or at 1.25 half lengths beyond it, lies on the
/// Bernstein ellipse of radius ≥ 2.5: the error falls as 2.5^{−2n}.
const REACH: f64 = 2.5;

/// The part of a panel's degree that pays for the BRDF itself: 2.5⁻³⁴ = 3·10⁻¹⁴.
const DEGREE: f64 = 34.0;

/// The Gauss–Legendre rule of `n` nodes on [−1, 1], computed once.
fn gauss(n: usize) -> &'static [(f64, f64)] {
    static RULES: [OnceLock<Vec<(f64, f64)>>; MOST_NODES + 1] =
        [const { OnceLock::new() }; MOST_NODES + 1];
    let n = n.clamp(1, MOST_NODES);
    RULES[n].get_or_init(|| {
        let n = NonZeroUsize::new(n).unwrap_or(NonZeroUsize::MIN);
        gauss_quad::GaussLegendre::new(n).iter().copied().collect()
    })
}

/// Quadrature over θi′ ∈ [−π/2, π/2] for one exitant direction: composite Gauss–Legendre, with panels
/// that shrink towards the mirror direction and towards the horizon, and end at the BRDF's kinks.
#[derive(Clone, Debug)]
pub struct IncidentRule {
    /// θi′ of each node, radians.
    pub angles: Vec<f64>,
    /// Weight of each node, radians.
    pub weights: Vec<f64>,
}

impl IncidentRule {
    /// A rule for `brdf` at `exitant` that resolves factors e^{ipθi′} up to |p| ≤ `order`, to 1e-10 of the largest
    /// coefficient for the models of this module.
    pub fn new(brdf: &dyn Brdf, exitant: LocalAngle, order: usize) -> Self {
        let centre = (-exitant.rad()).clamp(-FRAC_PI_2, FRAC_PI_2);
        let lobe = brdf.lobe_width().max(1e-5);
        let grazing = brdf.grazing_width().max(1e-7);
        let foci = [(centre, lobe), (-FRAC_PI_2, grazing), (FRAC_PI_2, grazing)];
        let mut ends = brdf.kinks(exitant);
        ends.push(centre);
        Self::composite(ends, &foci, order)
    }

    /// A rule over [−π/2, π/2] whose panels end at `ends` and shrink towards the foci (position, width).
    pub(super) fn composite(mut ends: Vec<f64>, foci: &[(f64, f64)], order: usize) -> Self {
        ends.retain(|end| end.abs() < FRAC_PI_2);
        ends.extend([-FRAC_PI_2, FRAC_PI_2]);
        ends.sort_by(f64::total_cmp);
        ends.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        let mut rule = Self {
            angles: Vec::with_capacity(256),
            weights: Vec::with_capacity(256),
        };
        for pair in ends.windows(2) {
            rule.panels(pair[0], pair[1], foci, order as f64);
        }
        rule
    }

    /// Adds nodes over [a, b], cut up until every panel suits all foci (position, width).
    fn panels(&mut self, a: f64, b: f64, foci: &[(f64, f64)], order: f64) {
        let length = b - a;
        let half = 0.5 * length;
        // The focus that allows the least, as a length and as the side on which it lies.
        let mut allowed = f64::INFINITY;
        let mut at_start = true;
        for &(position, width) in foci {
            let distance = (a - position).max(position - b).max(0.0);
            let reach = REACH * distance.max(width);
            if reach < allowed {
                allowed = reach;
                at_start = (position - a).abs() <= (position - b).abs();
            }
        }
        // ∫ e^{iphx} P_k(x) dx falls off beyond k = ph, over a transition of some (ph)^{1/3}.
        let phase = order * half;
        let degree = phase + 5.0 * phase.cbrt() + DEGREE;
        let nodes = (0.5 * degree).ceil() as usize;
        if length > allowed {
            // 0.7 = REACH · 0.28: the far part then suits this focus without another cut.
            let cut = if at_start { 0.28 } else { 0.72 };
            let middle = a + cut * length;
            self.panels(a, middle, foci, order);
            self.panels(middle, b, foci, order);
        } else if nodes > MOST_NODES {
            self.panels(a, a + half, foci, order);
            self.panels(a + half, b, foci, order);
        } else {
            for (x, w) in gauss(nodes) {
                self.angles.push(a + half + half * x);
                self.weights.push(half * w);
            }
        }
    }
}

/// Frequencies that are computed side by side.
const LANES: usize = 8;

/// H_p(θo′) = 2π ρ̂_{−p}(θo′) = ∫ ρ̂(θi′, θo′) e^{ipθi′} dθi′ for 0 ≤ p ≤ `order` (eq. 11); the factor by
/// which a light of frequency p shows at this exitant angle. H_{−p} = conj H_p.
pub fn transfer_row(brdf: &dyn Brdf, exitant: LocalAngle, order: usize) -> Vec<Complex64> {
    let rule = IncidentRule::new(brdf, exitant, order);
    let blocks = order / LANES + 1;
    let mut sums = vec![([0.0f64; LANES], [0.0f64; LANES]); blocks];
    let form = brdf.isotropic();
    let pair_of = Pair::towards_of_half(exitant);
    let mut nodes = Vec::with_capacity(rule.angles.len());
    for (&angle, &weight) in rule.angles.iter().zip(&rule.weights) {
        let half = (0.5 * angle).sin_cos();
        let rho = match form {
            Some(form) => pair_of(half).map_or(0.0, |pair| form.rho(&pair)),
            None => brdf.value(LocalAngle::radians(angle), exitant),
        };
        if rho != 0.0 {
            let (sin, cos) = half;
            let turn = [(cos - sin) * (cos + sin), 2.0 * sin * cos];
            nodes.push((turn, weight * rho * turn[0]));
        }
    }
    pulp::Arch::new().dispatch(AddNodes {
        sums: &mut sums,
        nodes: &nodes,
    });
    let mirror = brdf.mirror(exitant);
    (0..=order)
        .map(|p| {
            let smooth = sums.get(p / LANES).map_or(Complex64::ZERO, |(re, im)| {
                Complex64::new(re[p % LANES], im[p % LANES])
            });
            if mirror == 0.0 {
                smooth
            } else {
                smooth + mirror * Complex64::cis(-(p as f64) * exitant.rad())
            }
        })
        .collect()
}

/// Adds nodes to the sums, [`LANES`] frequencies at a time, for the processor's widest instructions.
struct AddNodes<'a> {
    sums: &'a mut [([f64; LANES], [f64; LANES])],
    /// Cosine and sine of the angle, and the factor, of each node.
    nodes: &'a [([f64; 2], f64)],
}

impl pulp::NullaryFnOnce for AddNodes<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let turned = |[re, im]: [f64; 2], [c, s]: [f64; 2]| [re * c - im * s, re * s + im * c];
        for &(step, factor) in self.nodes {
            // The first frequencies, and what takes them to the next: the turn by LANES times the angle.
            let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
            let mut turn = [1.0, 0.0];
            for k in 0..LANES {
                (re[k], im[k]) = (factor * turn[0], factor * turn[1]);
                turn = turned(turn, step);
            }
            let [c, s] = turn;
            for (sum_re, sum_im) in self.sums.iter_mut() {
                for k in 0..LANES {
                    sum_re[k] += re[k];
                    sum_im[k] += im[k];
                    [re[k], im[k]] = turned([re[k], im[k]], [c, s]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{
        Blinn, GgxConductor, GgxDielectric, HorizonSheen, Lambertian, OrenNayar, Phong, Sheen,
        TorranceSparrow, Ward,
    };

    /// The same integral by brute force: panels of 2 mrad between the kinks, cut a thousandfold finer at the horizon.
    fn oracle(brdf: &dyn Brdf, exitant: LocalAngle, order: usize) -> Vec<Complex64> {
        let mut ends: Vec<f64> = (0..=1570).map(|k| f64::from(k - 785) * 2e-3).collect();
        for k in 0..30 {
            let near = FRAC_PI_2 - 1e-3 * 0.5f64.powi(k);
            ends.extend([near, -near]);
        }
        ends.extend([-FRAC_PI_2, FRAC_PI_2, -exitant.rad()]);
        ends.extend(brdf.kinks(exitant));
        ends.retain(|e| e.abs() <= FRAC_PI_2);
        ends.sort_by(f64::total_cmp);
        let mut row = vec![Complex64::ZERO; order + 1];
        for pair in ends.windows(2) {
            let half = 0.5 * (pair[1] - pair[0]);
            for (x, w) in gauss(12) {
                let angle = pair[0] + half + half * x;
                let value =
                    half * w * angle.cos() * brdf.value(LocalAngle::radians(angle), exitant);
                for (p, h) in row.iter_mut().enumerate() {
                    *h += value * Complex64::cis(p as f64 * angle);
                }
            }
        }
        row
    }

    fn models() -> Vec<(Box<dyn Brdf>, f64)> {
        let phong = |exponent| Phong {
            diffuse: 0.2,
            specular: 0.5,
            exponent,
        };
        let metal = |alpha| GgxConductor {
            alpha,
            eta: 0.2,
            k: 3.9,
            specular: 1.0,
        };
        vec![
            (Box::new(Lambertian { albedo: 0.7 }), 1e-12),
            (Box::new(phong(1.0)), 1e-12),
            (Box::new(phong(8.0)), 1e-12),
            (Box::new(phong(32.0)), 1e-12),
            (Box::new(phong(2000.0)), 1e-10),
            (
                Box::new(Blinn {
                    diffuse: 0.1,
                    specular: 0.5,
                    exponent: 300.0,
                }),
                1e-11,
            ),
            (Box::new(metal(0.03)), 1e-10),
            (Box::new(metal(0.2)), 1e-10),
            (Box::new(metal(0.8)), 1e-10),
            (
                Box::new(GgxDielectric {
                    diffuse: 0.3,
                    alpha: 0.1,
                    ior: 1.3,
                }),
                1e-10,
            ),
            (
                Box::new(TorranceSparrow {
                    diffuse: 0.3,
                    roughness: 0.2,
                    ior: 1.5,
                }),
                1e-10,
            ),
            (
                Box::new(OrenNayar {
                    albedo: 0.7,
                    sigma: 0.4,
                }),
                1e-12,
            ),
            // Fractional powers at the kinks and roots at the horizon: no longer smooth there.
            (
                Box::new(Ward {
                    diffuse: 0.1,
                    specular: 0.5,
                    alpha: 0.15,
                }),
                1e-9,
            ),
            (
                Box::new(Sheen {
                    diffuse: 0.1,
                    sheen: 0.7,
                    roughness: 0.3,
                }),
                1e-9,
            ),
            (
                Box::new(HorizonSheen {
                    diffuse: 0.1,
                    sheen: 0.7,
                    exponent: 4.5,
                }),
                1e-8,
            ),
        ]
    }

    #[test]
    fn every_model_s_row_agrees_with_brute_force() {
        for (brdf, tolerance) in models() {
            for degrees in [-88.0, -60.0, -10.3, 0.0, 45.0, 75.0, 89.5] {
                let exitant = LocalAngle::degrees(degrees);
                let exact = oracle(brdf.as_ref(), exitant, 60);
                let found = transfer_row(brdf.as_ref(), exitant, 60);
                let scale = exact.iter().map(|h| h.norm()).fold(0.0, f64::max);
                let worst = exact
                    .iter()
                    .zip(&found)
                    .map(|(a, b)| (a - b).norm())
                    .fold(0.0, f64::max);
                // What `IncidentRule` promises, see its constants.
                assert!(
                    worst <= tolerance * scale,
                    "{brdf:?} at {degrees}°: {:.1e}",
                    worst / scale
                );
            }
        }
    }

    #[test]
    fn the_rule_is_short_where_the_material_is_smooth_and_resolves_any_order() {
        let nodes = |brdf: &dyn Brdf, order| {
            IncidentRule::new(brdf, LocalAngle::degrees(30.0), order)
                .angles
                .len()
        };
        let lambertian = Lambertian { albedo: 1.0 };
        assert!(nodes(&lambertian, 60) < 250, "{}", nodes(&lambertian, 60));
        for order in [0, 1, 700, 3000] {
            let exitant = LocalAngle::degrees(30.0);
            let row = transfer_row(&lambertian, exitant, order);
            let p = order as f64;
            // ∫ cos θ e^{ipθ} dθ / π = 2 cos(pπ/2) / (π (1 − p²)), and ½ for p = 1.
            let expected = if order == 1 {
                0.5
            } else {
                2.0 * (p * FRAC_PI_2).cos() / (std::f64::consts::PI * (1.0 - p * p))
            };
            // Rounding: e^{ipθ} carries p times the rounding of θ.
            assert!(
                (row[order].re - expected).abs() < 1e-14 * (1.0 + p),
                "{order}: {} {expected}",
                row[order]
            );
        }
    }
}
