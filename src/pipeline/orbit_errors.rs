//! What errors of the orbit angles do to the samples.

use std::f64::consts::{PI, TAU};

use crate::angle::wrap;
use crate::light_field::{Column, Samples, Systematic};

/// Closest distance in α (radians) over which a derivative is taken: noise is amplified by its inverse, and no lobe that
/// photographs resolve changes its slope within it.
const STEP: f64 = 0.044;
/// Samples on each side that a derivative is taken from.
const SIDE: usize = 2;

/// One error for each view, of standard deviation `sigma` (radians): a view stated at the orbit angle θ was taken
/// at θ + δ and saw B(α + δ, θo′), where its sample stands at α. Empty if the angles are exact.
pub fn errors(samples: &Samples, views: usize, sigma: f64) -> Vec<Systematic> {
    if !(sigma > 0.0) {
        return Vec::new();
    }
    let channels = samples.channels.len();
    let slopes: Vec<Vec<Vec<f64>>> = (0..channels)
        .map(|c| samples.columns.iter().map(|s| slopes(s, c)).collect())
        .collect();
    (0..views)
        .map(|view| {
            let name = format!("orbit angle of view {view}");
            Systematic::of_turns(
                name,
                samples,
                &slopes,
                |_, of| {
                    if of == view { sigma } else { 0.0 }
                },
            )
        })
        .collect()
}

/// ∂B/∂α at the samples of a column, by the polynomial through each and its neighbours around the circle; 0 where there
/// are no two others.
fn slopes(column: &Column, channel: usize) -> Vec<f64> {
    let mut out = vec![0.0; column.alpha.len()];
    let (Some(value), Some(variance)) = (column.value.get(channel), column.variance.get(channel))
    else {
        return out;
    };
    let mut order: Vec<usize> = (0..column.alpha.len())
        .filter(|&i| variance[i].is_finite() && column.alpha[i].is_finite())
        .collect();
    order.sort_by(|&i, &j| wrap(column.alpha[i]).total_cmp(&wrap(column.alpha[j])));
    let n = order.len();
    for (place, &i) in order.iter().enumerate() {
        let mut nodes = vec![(0.0, value[i])];
        for direction in [1, n.saturating_sub(1)] {
            let (mut at, mut last, mut taken) = (place, 0.0f64, 0);
            for _ in 1..n {
                at = (at + direction) % n;
                let j = order[at];
                // Counted away from the sample, so that both sides go from 0 to 2π.
                let away = wrap(column.alpha[j] - column.alpha[i]);
                let distance = match direction {
                    1 => away.rem_euclid(TAU),
                    _ => (-away).rem_euclid(TAU),
                };
                if distance >= PI || taken == SIDE {
                    break;
                }
                if distance >= last + STEP {
                    nodes.push((away, value[j]));
                    (last, taken) = (distance, taken + 1);
                }
            }
        }
        out[i] = derivative(&nodes);
    }
    out
}

/// Derivative at the first node of the polynomial through all (Lagrange).
fn derivative(nodes: &[(f64, f64)]) -> f64 {
    let [(x, y), rest @ ..] = nodes else {
        return 0.0;
    };
    if rest.len() < 2 {
        return 0.0;
    }
    let mut sum = 0.0;
    for (j, (a, v)) in rest.iter().enumerate() {
        let mut weight = 1.0 / (a - x);
        for (m, (b, _)) in rest.iter().enumerate() {
            if m != j {
                weight *= (x - b) / (a - b);
            }
        }
        sum += weight * (v - y);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;

    #[test]
    fn slopes_are_those_of_the_lobe() {
        let grid = Grid {
            normals: 72,
            locals: 3,
        };
        // A lobe like that of exponent 32, σ = 10°, and its derivative.
        let width = 10f64.to_radians();
        let lobe = |a: f64| (-0.5 * (a / width).powi(2)).exp();
        let value: Vec<f64> = (0..grid.len())
            .map(|k| lobe(grid.normal(k / grid.locals).rad()))
            .collect();
        let mut variance = vec![1e-4; grid.len()];
        // A missing sample is no neighbour.
        variance[grid.index(40, 1)] = f64::INFINITY;
        let samples = Samples::from_grid(grid, vec!["Y".into()], &[value], &[variance]);
        let found = errors(&samples, 72, 0.01);
        assert_eq!(found.len(), 72);
        for (view, error) in found.iter().enumerate() {
            for (j, column) in samples.columns.iter().enumerate() {
                let a = column.alpha[view];
                let expected = -0.01 * a / width.powi(2) * lobe(a);
                let got = error.change[0][j][view];
                // Five points h = 5° apart: h⁴/30 of the fifth derivative, up to 8/width⁵ for a Gaussian; next to the gap
                // twice the spacing on one side: four times that.
                let tolerance = if j == 1 { 4.0 } else { 1.0 };
                let limit = 0.01 * 0.0873f64.powi(4) / 30.0 * 8.0 / width.powi(5) * tolerance;
                if j != 1 || view != 40 {
                    assert!(
                        (got - expected).abs() < limit,
                        "{view} {j} {got} {expected}"
                    );
                }
                assert!((0..72).all(|v| v == view || error.change[0][j][v] == 0.0));
            }
        }
        assert!(errors(&samples, 72, 0.0).is_empty());
    }
}
