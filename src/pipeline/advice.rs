//! What to photograph next, in words.

use super::measure::Measured;
use crate::brdf::Material;
use crate::capture::Capture;
use crate::lighting::Lighting;
use crate::recover::advice::{self, Advice, Gain};
use crate::recover::brdf::{self, BrdfEstimate};
use crate::recover::lighting::LightingEstimate;

/// Numbers of the light that a view must add to be worth it, and their share of those that are known.
const WORTH: f64 = 0.5;
const WORTH_SHARE: f64 = 0.03;
/// Part of the slice that a view or a light must add to be worth it.
const WORTH_OF_SLICE: f64 = 0.005;

/// Orbit angles of the views, radians.
fn orbits(capture: &Capture) -> Vec<f64> {
    capture.views.iter().map(|v| v.orbit.rad()).collect()
}

/// On the light, from the first channel.
pub fn on_lighting(
    capture: &Capture,
    measured: &Measured,
    material: &Material,
    estimate: &LightingEstimate,
) -> Option<String> {
    let (brdf, channel) = (material.brdfs.first()?, estimate.channels.first()?);
    let mean = channel.spectrum.first()?.value.re;
    let noise = channel.chi2.max(1.0);
    let orbits = orbits(capture);
    let found = advice::lighting(&measured.samples, 0, &orbits, brdf.as_ref(), mean, noise).ok()?;
    let view = found.view?;
    let gain = view.then - found.now;
    let now = format!(
        "The photos determine {:.0} independent numbers of the light",
        found.now
    );
    let worth = WORTH.max(WORTH_SHARE * found.now);
    Some(if gain >= worth {
        format!(
            "{now}; of all further views one from {} would add most, {gain:.1}.",
            degrees(&view)
        )
    } else {
        format!(
            "{now}; no further view would add as much as {worth:.1}. A glossier surface would show more detail, a longer exposure a little."
        )
    })
}

/// On the slice, from the first channel.
pub fn on_brdf(
    capture: &Capture,
    measured: &Measured,
    lighting: &Lighting,
    estimate: &BrdfEstimate,
) -> Option<String> {
    let (name, slice) = (estimate.channels.first()?, estimate.slices.first()?);
    let own = lighting.channels.iter().position(|c| c == name);
    let found = brdf::advise(
        &measured.samples,
        0,
        &orbits(capture),
        lighting,
        own.unwrap_or(0),
        slice,
    )
    .ok()?;
    Some(said_of_slice(&found))
}

fn said_of_slice(found: &Advice) -> String {
    let share = |v: f64| format!("{:.1} %", 100.0 * v);
    let worth = |gain: &Gain| gain.then - found.now >= WORTH_OF_SLICE;
    let view = found.view.filter(worth).map(|gain| {
        format!(
            "one more view, best from {}, would make it {}",
            degrees(&gain),
            share(gain.then)
        )
    });
    let source = found.source.filter(worth).map(|gain| {
        format!(
            "the same views once more under a single source, best at {}, {}",
            degrees(&gain),
            share(gain.then)
        )
    });
    let now = format!(
        "Views and light determine {} of the slice (1 − σ²/σ₀², where σ₀ is its own size, over |θ′| ≤ 80°)",
        share(found.now)
    );
    match (view, source) {
        (None, None) => {
            format!(
                "{now}; no further view or light would add as much as {}.",
                share(WORTH_OF_SLICE)
            )
        }
        (Some(one), None) | (None, Some(one)) => format!("{now}; {one}."),
        (Some(view), Some(source)) => format!("{now}; {view}, {source}."),
    }
}

fn degrees(gain: &Gain) -> String {
    format!("{:.0}°", gain.direction.to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_worth_it_is_recommended() {
        let gain = |degrees: f64, then: f64| {
            Some(Gain {
                direction: degrees.to_radians(),
                then,
            })
        };
        let said = |view, source| {
            said_of_slice(&Advice {
                now: 0.5,
                view,
                source,
            })
        };
        let both = said(gain(95.0, 0.61), gain(-40.0, 0.99));
        assert!(both.contains("from 95°, would make it 61.0 %"), "{both}");
        assert!(both.contains("at -40°, 99.0 %"), "{both}");
        let light = said(gain(95.0, 0.501), gain(-40.0, 0.99));
        assert!(!light.contains("one more view") && light.contains("single source"));
        assert!(said(gain(95.0, 0.501), gain(-40.0, 0.502)).contains("no further view or light"));
    }
}
