//! The integral of a narrow lobe times a table of light, exact in the light.
//!
//! A table is linear between its values, so that two integrations by parts leave nothing of it but the bends at its
//! values: ∫ f L = F₁ L − F₂ L′ at the upper end, plus Σ_k (bend of L at θ_k) · F₂(θ_k), where F₁ and F₂
//! are the first and second integral of f from the lower end. However narrow the lobe and however sharp the light's edges,
//! no node can miss them.

use std::f64::consts::{PI, TAU};
use std::num::NonZeroUsize;
use std::sync::OnceLock;

/// First and second integral of a function, tabulated.
#[derive(Clone, Debug)]
pub struct Integrals {
    from: f64,
    to: f64,
    stretches: Vec<Smooth>,
    /// Largest error of interpolating F₂, measured in the middle of every step.
    pub error: f64,
}

/// A table between two kinks of the function.
#[derive(Clone, Debug)]
struct Smooth {
    from: f64,
    to: f64,
    step: f64,
    /// \[F₂, F₁, f\] at the ends of the steps.
    nodes: Vec<[f64; 3]>,
}

/// Nodes and weights of the eight-point Gauss rule on [0, 1].
fn rule() -> &'static [(f64, f64)] {
    static RULE: OnceLock<Vec<(f64, f64)>> = OnceLock::new();
    RULE.get_or_init(|| {
        let n = NonZeroUsize::new(8).unwrap_or(NonZeroUsize::MIN);
        let rule = gauss_quad::GaussLegendre::new(n);
        rule.iter().map(|(x, w)| (0.5 + 0.5 * x, 0.5 * w)).collect()
    })
}

impl Integrals {
    /// `f` must vanish or have its kinks at the two ends or at `kinks`; `step` is the largest one, radians.
    pub fn new(f: impl Fn(f64) -> f64, [from, to]: [f64; 2], kinks: &[f64], step: f64) -> Self {
        // Next to a kink the function is taken from its own side.
        const BESIDE: f64 = 1e-12;
        let mut ends: Vec<f64> = kinks
            .iter()
            .copied()
            .filter(|k| (from..to).contains(k))
            .collect();
        ends.extend([from, to]);
        ends.sort_by(f64::total_cmp);
        ends.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        let mut made = Self {
            from,
            to,
            stretches: Vec::with_capacity(ends.len()),
            error: 0.0,
        };
        let (mut first, mut second) = (0.0, 0.0);
        for pair in ends.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            let steps = ((to - from) / step).ceil().max(1.0) as usize;
            let step = (to - from) / steps as f64;
            let half = 0.5 * step;
            let mut nodes = vec![[second, first, f(from + BESIDE)]];
            let mut middles = Vec::with_capacity(steps);
            for k in 0..steps {
                for part in 0..2 {
                    let begin = from + (k as f64 + 0.5 * f64::from(part)) * step;
                    let (mut whole, mut moment) = (0.0, 0.0);
                    for &(x, w) in rule() {
                        let value = f(begin + x * half);
                        whole += w * half * value;
                        moment += w * half * value * (1.0 - x) * half;
                    }
                    second += first * half + moment;
                    first += whole;
                    if part == 0 {
                        middles.push(second);
                    }
                }
                let end = from + (k as f64 + 1.0) * step - BESIDE;
                nodes.push([second, first, f(end)]);
            }
            let table = Smooth {
                from,
                to,
                step,
                nodes,
            };
            for (k, middle) in middles.into_iter().enumerate() {
                let there = table.second(from + (k as f64 + 0.5) * step);
                made.error = made.error.max((there - middle).abs());
            }
            made.stretches.push(table);
        }
        made
    }

    fn second(&self, a: f64) -> f64 {
        let at = self.stretches.iter().find(|s| a <= s.to);
        at.or(self.stretches.last()).map_or(0.0, |s| s.second(a))
    }

    /// ∫ f(a) L(`normal` + a) da for light in a table that starts at −π, with its bends (`bends`).
    pub fn with(&self, table: &[f64], bends: &[f64], normal: f64) -> f64 {
        let n = table.len();
        let spacing = TAU / n as f64;
        let position = (normal + self.to + PI) / spacing;
        let last = position.floor();
        let first = ((normal + self.from + PI) / spacing).ceil();
        let at = |k: f64| k.rem_euclid(n as f64) as usize % n;
        let (low, high) = (table[at(last)], table[at(last + 1.0)]);
        let light = low + (position - last) * (high - low);
        let end = self.stretches.last().and_then(|s| s.nodes.last());
        let [second, whole, _] = end.copied().unwrap_or_default();
        let mut sum = whole * light - second * (high - low) / spacing;
        let mut index = at(first);
        for k in 0..=(last - first).max(-1.0) as i64 {
            let angle = (first + k as f64) * spacing - PI - normal;
            sum += bends[index] * self.second(angle);
            index = if index + 1 == n { 0 } else { index + 1 };
        }
        sum
    }

    /// A bound of the error of [`Integrals::with`].
    pub fn bound(&self, bends: &[f64]) -> f64 {
        let n = bends.len();
        let window = (((self.to - self.from) / TAU * n as f64).ceil() as usize + 1).min(n);
        let mut sum: f64 = bends[..window].iter().map(|b| b.abs()).sum();
        let mut most = sum;
        for k in 0..n {
            sum += bends[(k + window) % n].abs() - bends[k].abs();
            most = most.max(sum);
        }
        most * self.error
    }
}

impl Smooth {
    /// F₂: the quintic of values, first and second derivatives at both ends of the step.
    fn second(&self, a: f64) -> f64 {
        let position = (a - self.from) / self.step;
        let k = (position as usize).min(self.nodes.len() - 2);
        let t = position - k as f64;
        let ([y0, d0, s0], [y1, d1, s1]) = (self.nodes[k], self.nodes[k + 1]);
        let (t2, h) = (t * t, self.step);
        let t3 = t2 * t;
        let up = t3 * (10.0 - t * (15.0 - 6.0 * t));
        let slopes =
            d0 * (t - t3 * (6.0 - t * (8.0 - 3.0 * t))) - d1 * t3 * (4.0 - t * (7.0 - 3.0 * t));
        let curves = s0 * t2 * (1.0 - t * (3.0 - t * (3.0 - t))) + s1 * t3 * (1.0 - t * (2.0 - t));
        y0 + (y1 - y0) * up + h * slopes + 0.5 * h * h * curves
    }
}

/// Changes of the slope of a circular table at its values, per radian.
pub fn bends(table: &[f64]) -> Vec<f64> {
    let n = table.len();
    let spacing = TAU / n as f64;
    (0..n)
        .map(|i| (table[(i + 1) % n] - 2.0 * table[i] + table[(i + n - 1) % n]) / spacing)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::WorldAngle;
    use crate::lighting::Lighting;

    #[test]
    fn a_lobe_of_any_width_sees_every_edge_of_the_light() {
        let table: Vec<f64> = (0..100)
            .map(|i| if i % 7 == 3 { 50.0 } else { f64::from(i % 5) })
            .collect();
        let light = Lighting {
            channels: vec!["Y".into()],
            table: vec![table.clone()],
            ..Lighting::default()
        };
        let bends = bends(&table);
        for width in [0.003, 0.05, 0.4] {
            // (1 − (a − 0.1)²/w²)², which ends at w.
            let f = |a: f64| (1.0 - ((a - 0.1) / width).powi(2)).powi(2);
            let made = Integrals::new(f, [0.1 - width, 0.1 + width], &[], width / 4.0);
            for k in 0..40 {
                let normal = -3.0 + 0.157 * f64::from(k);
                let n = 200_000;
                let slow: f64 = (0..n)
                    .map(|i| {
                        let a = 0.1 - width + 2.0 * width * (f64::from(i) + 0.5) / f64::from(n);
                        f(a) * light.density(0, WorldAngle::radians(normal + a))
                    })
                    .sum::<f64>()
                    * 2.0
                    * width
                    / f64::from(n);
                let fast = made.with(&table, &bends, normal);
                // The midpoint rule's h²/24 per bend of up to 100/0.0628, with h = 4e-6 of 0.4.
                let sum = 1e-8 * width + made.bound(&bends);
                assert!(
                    (fast - slow).abs() < sum,
                    "{width} {k}: {fast} {slow} {sum:e}"
                );
            }
            // F₂ is of degree 6 here, so the error is one of its sixth derivative, h⁶/46080 · 24/w⁴.
            let expected = (width / 4.0f64).powi(6) / 46080.0 * 24.0 / width.powi(4);
            assert!(
                made.error < 1.01 * expected + 1e-16,
                "{:e} {expected:e}",
                made.error
            );
        }
    }
}
