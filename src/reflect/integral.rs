//! The light field by the angular integral (eq. 4): slow, and the oracle of everything faster.
//!
//! Shares no code with the product form: its own quadrature, in the angle and not in frequency.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::num::NonZeroUsize;
use std::sync::OnceLock;

use rayon::prelude::*;

use super::{check, from_sources};
use crate::angle::{LocalAngle, NormalAngle};
use crate::brdf::{Brdf, Material};
use crate::error::Result;
use crate::grid::Grid;
use crate::lighting::Lighting;

/// B(α, θo′) = ∫ L(α + θi′) ρ̂(θi′, θo′) dθi′ in one channel: sources and mirror exactly, the rest by
/// Gauss–Legendre panels that end wherever the integrand has a kink and shrink towards the lobe.
pub fn value(
    lighting: &Lighting,
    channel: usize,
    brdf: &dyn Brdf,
    normal: NormalAngle,
    local: LocalAngle,
) -> f64 {
    let mut sum = from_sources(lighting, channel, brdf, normal, local);
    let ends = panel_ends(lighting, channel, brdf, normal, local);
    for pair in ends.windows(2) {
        let (middle, half) = ((pair[0] + pair[1]) / 2.0, (pair[1] - pair[0]) / 2.0);
        for (x, w) in gauss() {
            let incident = LocalAngle::radians(middle + half * x);
            let transfer = brdf.value(incident, local) * incident.rad().cos();
            if transfer != 0.0 {
                sum += half * w * transfer * lighting.density(channel, normal + incident);
            }
        }
    }
    let mirror = brdf.mirror(local);
    if mirror != 0.0 {
        sum += mirror * lighting.density(channel, normal + -local);
    }
    sum
}

/// The whole light field, \[channel\]\[cell of `grid`\], W m⁻² sr⁻¹.
///
/// # Errors
/// If lighting and material do not have the same channels, or a mirror sees a directional source.
pub fn on_grid(lighting: &Lighting, material: &Material, grid: Grid) -> Result<Vec<Vec<f64>>> {
    check(lighting, material)?;
    let field = |(c, brdf): (usize, &std::sync::Arc<dyn Brdf>)| {
        (0..grid.len())
            .into_par_iter()
            .map(|cell| {
                let (i, j) = (cell / grid.locals, cell % grid.locals);
                value(lighting, c, brdf.as_ref(), grid.normal(i), grid.local(j))
            })
            .collect()
    };
    Ok(material.brdfs.iter().enumerate().map(field).collect())
}

const NODES: usize = 20;

fn gauss() -> &'static [(f64, f64)] {
    static RULE: OnceLock<Vec<(f64, f64)>> = OnceLock::new();
    RULE.get_or_init(|| {
        let n = NonZeroUsize::new(NODES).unwrap_or(NonZeroUsize::MIN);
        gauss_quad::GaussLegendre::new(n).iter().copied().collect()
    })
}

/// Ends of the panels over θi′ ∈ [−π/2, π/2].
fn panel_ends(
    lighting: &Lighting,
    channel: usize,
    brdf: &dyn Brdf,
    normal: NormalAngle,
    local: LocalAngle,
) -> Vec<f64> {
    let mut ends = vec![-FRAC_PI_2, 0.0, FRAC_PI_2];
    ends.extend(brdf.kinks(local));
    // A table of light has a kink at each of its angles.
    if let Some(n) = lighting.table.get(channel).map(Vec::len).filter(|n| *n > 1) {
        let step = TAU / n as f64;
        let first = ((normal.rad() - FRAC_PI_2 + PI) / step).ceil() as i64;
        let last = ((normal.rad() + FRAC_PI_2 + PI) / step).floor() as i64;
        ends.extend((first..=last).map(|k| k as f64 * step - PI - normal.rad()));
    }
    // 20 nodes take a factor e^{ipθ} over a panel to 1e-13 if p · panel ≤ 8.
    let order = lighting.smooth.get(channel).map_or(0, |s| s.order());
    let widest = (8.0 / order.max(1) as f64).min(0.3);
    // Near its centre a lobe is smooth over a fraction of its width, far from it over a fraction of the
    // distance.
    let narrowest = (0.5 * brdf.lobe_width()).clamp(1e-5, widest);
    let centre = -local.rad();
    ends.push(centre);
    for side in [-1.0, 1.0] {
        let mut distance = 0.0f64;
        while distance < PI {
            distance += (0.3 * distance).clamp(narrowest, widest);
            ends.push(centre + side * distance);
        }
    }
    ends.retain(|e| e.abs() <= FRAC_PI_2);
    ends.sort_by(f64::total_cmp);
    ends.dedup_by(|a, b| (*a - *b).abs() < 1e-12);
    ends
}
