//! Composite Gauss–Legendre rules over θi′ whose panels shrink where a BRDF is narrow.

use std::f64::consts::{FRAC_PI_2, PI};
use std::num::NonZeroUsize;
use std::sync::OnceLock;

use crate::angle::LocalAngle;
use crate::brdf::Brdf;

/// Nodes of a panel: 20 take a factor e^{ipθ} over it to 1e-13 if p · panel ≤ 8.
const NODES: usize = 20;

/// Nodes and weights on [−1, 1].
pub(super) fn gauss() -> &'static [(f64, f64)] {
    static RULE: OnceLock<Vec<(f64, f64)>> = OnceLock::new();
    RULE.get_or_init(|| {
        let n = NonZeroUsize::new(NODES).unwrap_or(NonZeroUsize::MIN);
        gauss_quad::GaussLegendre::new(n).iter().copied().collect()
    })
}

/// Ends of panels over [−π/2, π/2] that resolve `brdf` at `local` and light up to frequency `order`: at
/// the kinks and at `breaks`, growing with the distance from the lobe's centre and from the horizon.
pub(crate) fn panel_ends(
    brdf: &dyn Brdf,
    local: LocalAngle,
    order: usize,
    breaks: impl IntoIterator<Item = f64>,
) -> Vec<f64> {
    let widest = (8.0 / order.max(1) as f64).min(0.3);
    let mut ends = vec![-FRAC_PI_2, 0.0, FRAC_PI_2];
    ends.extend(brdf.kinks(local));
    ends.extend(breaks);
    // A function that is smooth at distance d from its narrow place over a fraction of d.
    let mut grade = |centre: f64, width: f64| {
        let narrowest = (0.5 * width).clamp(1e-5, widest);
        ends.push(centre);
        for side in [-1.0, 1.0] {
            let mut distance = 0.0f64;
            while distance < PI {
                distance += (0.4 * distance).clamp(narrowest, widest);
                ends.push(centre + side * distance);
                // Where the panels have their full width the other centres may rule.
                if 0.4 * distance >= widest && distance > 2.0 * width {
                    break;
                }
            }
        }
    };
    grade(-local.rad(), brdf.lobe_width());
    if brdf.grazing_width() < widest {
        grade(-FRAC_PI_2, brdf.grazing_width());
        grade(FRAC_PI_2, brdf.grazing_width());
    }
    ends.retain(|e| e.abs() <= FRAC_PI_2);
    ends.sort_by(f64::total_cmp);
    ends.dedup_by(|a, b| (*a - *b).abs() < 1e-12);
    // No panel may be wider than the light's frequency allows.
    let mut filled = Vec::with_capacity(ends.len() * 2);
    for pair in ends.windows(2) {
        let pieces = ((pair[1] - pair[0]) / widest).ceil().max(1.0);
        for k in 0..pieces as usize {
            filled.push(pair[0] + (pair[1] - pair[0]) * k as f64 / pieces);
        }
    }
    filled.extend(ends.last());
    filled
}

/// Calls `visit(θi′, weight)` for every node of the panels between `ends`.
pub(crate) fn for_each_node(ends: &[f64], mut visit: impl FnMut(f64, f64)) {
    for pair in ends.windows(2) {
        let (middle, half) = ((pair[0] + pair[1]) / 2.0, (pair[1] - pair[0]) / 2.0);
        for (x, w) in gauss() {
            visit(middle + half * x, half * w);
        }
    }
}
