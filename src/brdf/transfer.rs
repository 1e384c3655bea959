//! The transfer function's Fourier coefficients in θi′ at a given θo′, by quadrature.

use std::f64::consts::FRAC_PI_2;
use std::num::NonZeroUsize;
use std::sync::OnceLock;

use num_complex::Complex64;

use super::Brdf;
use crate::angle::LocalAngle;

/// Nodes of one Gauss–Legendre panel.
const PANEL_NODES: usize = 16;

fn panel() -> &'static [(f64, f64)] {
    static RULE: OnceLock<Vec<(f64, f64)>> = OnceLock::new();
    RULE.get_or_init(|| {
        let n = NonZeroUsize::new(PANEL_NODES).unwrap_or(NonZeroUsize::MIN);
        gauss_quad::GaussLegendre::new(n).iter().copied().collect()
    })
}

/// Quadrature over θi′ ∈ [−π/2, π/2] for one exitant direction: composite Gauss–Legendre, with panels
/// that shrink towards the mirror direction to the lobe's width and end at the BRDF's kinks.
#[derive(Clone, Debug)]
pub struct IncidentRule {
    /// θi′ of each node, radians.
    pub angles: Vec<f64>,
    /// Weight of each node, radians.
    pub weights: Vec<f64>,
}

impl IncidentRule {
    /// A rule for `brdf` at `exitant` that resolves factors e^{ipθi′} up to |p| ≤ `order`.
    pub fn new(brdf: &dyn Brdf, exitant: LocalAngle, order: usize) -> Self {
        let centre = (-exitant.rad()).clamp(-FRAC_PI_2, FRAC_PI_2);
        // 16 nodes integrate e^{ipθ} over a panel to 1e-12 if p · panel ≤ 6.
        let widest = (6.0 / order.max(1) as f64).min(0.35);
        let narrowest = (0.7 * brdf.lobe_width()).clamp(1e-4, widest);
        let mut ends = vec![-FRAC_PI_2, FRAC_PI_2, centre];
        ends.extend(
            brdf.kinks(exitant)
                .into_iter()
                .filter(|k| k.abs() < FRAC_PI_2),
        );
        for side in [-1.0, 1.0] {
            let mut at = 0.0f64;
            loop {
                // Panels grow with the distance from the lobe's centre.
                at += (0.5 * at).clamp(narrowest, widest);
                let end = centre + side * at;
                if end.abs() >= FRAC_PI_2 {
                    break;
                }
                ends.push(end);
            }
        }
        ends.sort_by(f64::total_cmp);
        ends.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        let mut rule = Self {
            angles: Vec::new(),
            weights: Vec::new(),
        };
        for pair in ends.windows(2) {
            let (middle, half) = ((pair[0] + pair[1]) / 2.0, (pair[1] - pair[0]) / 2.0);
            for (x, w) in panel() {
                rule.angles.push(middle + half * x);
                rule.weights.push(half * w);
            }
        }
        rule
    }
}

/// H_p(θo′) = 2π ρ̂_{−p}(θo′) = ∫ ρ̂(θi′, θo′) e^{ipθi′} dθi′ for 0 ≤ p ≤ `order` (eq. 11); the factor by
/// which a light of frequency p shows at this exitant angle. H_{−p} = conj H_p.
pub fn transfer_row(brdf: &dyn Brdf, exitant: LocalAngle, order: usize) -> Vec<Complex64> {
    let rule = IncidentRule::new(brdf, exitant, order);
    let mut row = vec![Complex64::ZERO; order + 1];
    for (&angle, &weight) in rule.angles.iter().zip(&rule.weights) {
        let value = weight * brdf.value(LocalAngle::radians(angle), exitant) * angle.cos();
        if value == 0.0 {
            continue;
        }
        let step = Complex64::cis(angle);
        let mut turn = Complex64::new(value, 0.0);
        for h in &mut row {
            *h += turn;
            turn *= step;
        }
    }
    let mirror = brdf.mirror(exitant);
    if mirror != 0.0 {
        for (p, h) in row.iter_mut().enumerate() {
            *h += mirror * Complex64::cis(-(p as f64) * exitant.rad());
        }
    }
    row
}
