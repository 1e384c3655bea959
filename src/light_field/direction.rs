//! Whether the orbit runs the other way round than described.
//!
//! Most objects are nearly matt, B(α, θo′) ≈ f(α), or nearly mirrors, B ≈ f(α − θo′) ([RH01] eqs. 17 and
//! 21). With the right direction one of these explains most of the light field; with the wrong one a view's
//! samples carry the normals of another place and neither does.

use super::Samples;
use crate::angle::{WorldAngle, wrap};

/// Bins of f around the circle: wider than a step between views, narrower than shading.
const BINS: usize = 72;

/// Part of the variance that must be left unexplained as described, and how much less the other way.
const UNEXPLAINED: f64 = 0.1;
const BETTER: f64 = 0.3;

/// Whether the samples fit much better if all views stand at minus their angle; `orbits` by view.
pub fn runs_backwards(samples: &Samples, orbits: &[WorldAngle]) -> bool {
    let described = unexplained(samples, orbits, false);
    described > UNEXPLAINED && unexplained(samples, orbits, true) < BETTER * described
}

/// Part of the variance that the better of the two simple light fields leaves.
fn unexplained(samples: &Samples, orbits: &[WorldAngle], reversed: bool) -> f64 {
    [0.0, 1.0]
        .into_iter()
        .map(|mirror| {
            let (mut within, mut whole) = (0.0, 0.0);
            for c in 0..samples.channels.len() {
                let mut bins = vec![[0.0_f64; 3]; BINS];
                for column in &samples.columns {
                    for (n, alpha) in column.alpha.iter().enumerate() {
                        let value = column.value[c][n];
                        let orbit = orbits.get(column.view[n] as usize).map(|o| o.rad());
                        let (Some(orbit), true) = (orbit, column.variance[c][n].is_finite()) else {
                            continue;
                        };
                        let back = if reversed { 2.0 * orbit } else { 0.0 };
                        let x = wrap(alpha - back - mirror * column.local.rad());
                        let part = x / std::f64::consts::TAU + 0.5;
                        let at = ((part * BINS as f64) as usize).min(BINS - 1);
                        let sums = &mut bins[at];
                        sums[0] += 1.0;
                        sums[1] += value;
                        sums[2] += value * value;
                    }
                }
                let total = bins
                    .iter()
                    .fold([0.0; 3], |t, b| [t[0] + b[0], t[1] + b[1], t[2] + b[2]]);
                let spread = |[n, s, q]: [f64; 3]| if n > 0.0 { q - s * s / n } else { 0.0 };
                whole += spread(total);
                within += bins.into_iter().map(spread).sum::<f64>();
            }
            if whole > 0.0 { within / whole } else { 0.0 }
        })
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;
    use crate::light_field::Column;

    /// 36 views at ten degrees, described as running by `sense` times that.
    fn samples(sense: f64, b: impl Fn(f64, f64) -> f64) -> (Samples, Vec<WorldAngle>) {
        let orbits: Vec<f64> = (0..36).map(|v| 10.0 * v as f64).collect();
        let columns = (0..150)
            .map(|j| {
                let local = (j as f64 - 74.5).to_radians();
                let at = |sense: f64| {
                    orbits
                        .iter()
                        .map(move |o| wrap(sense * o.to_radians() - local))
                };
                Column {
                    local: LocalAngle::radians(local),
                    alpha: at(sense).collect(),
                    view: (0..36).collect(),
                    value: vec![at(1.0).map(|alpha| b(alpha, local)).collect()],
                    variance: vec![vec![1e-6; 36]],
                }
            })
            .collect();
        let samples = Samples {
            channels: vec!["Y".into()],
            columns,
        };
        (
            samples,
            orbits
                .iter()
                .map(|o| WorldAngle::degrees(sense * o))
                .collect(),
        )
    }

    #[test]
    fn an_orbit_described_the_wrong_way_round_is_noticed() {
        let matt = |alpha: f64, local: f64| {
            let lit = |at: f64| wrap(at - alpha);
            lit(0.5).cos().max(0.0)
                + 0.4 * lit(2.4).cos().max(0.0)
                + 0.3 * (lit(0.5) + local).cos().max(0.0).powi(20)
        };
        let mirror = |alpha: f64, local: f64| {
            let x = wrap(alpha - local - 0.7);
            1.0 + 4.0 * (-x * x / 0.02).exp()
        };
        for (sense, expected) in [(1.0, false), (-1.0, true)] {
            let (set, orbits) = samples(sense, matt);
            assert_eq!(runs_backwards(&set, &orbits), expected);
            let (set, orbits) = samples(sense, mirror);
            assert_eq!(runs_backwards(&set, &orbits), expected);
        }
        // Light from all sides alike says nothing of a direction.
        let (set, orbits) = samples(-1.0, |_, local| 1.0 + 0.2 * local.cos());
        assert!(!runs_backwards(&set, &orbits));
    }
}
