//! Quintic B-splines on the half circle, and unknowns that are symmetric in two of them.

use std::f64::consts::{FRAC_PI_2, PI};

use num_complex::Complex64;

/// Nodes and weights of 8-point Gauss–Legendre quadrature on [−1, 1], positive half.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// Degree of the splines. A lobe cosⁿ on knots h apart is held to 15 n³ h⁶/46080 of its height: 1e-5 for n = 128 and
/// h = 3°, where cubic splines reach 3 n² h⁴/384 = 1e-3.
const DEGREE: usize = 5;

/// Functions at each end whose knots are not equally spaced.
pub const END_SHAPES: usize = DEGREE - 1;

/// Clamped B-splines of degree 5, φ_0 … φ_{len−1}, on `intervals` equal intervals of [−π/2, π/2].
///
/// The two functions that do not vanish at ±π/2 are left out: ρ̃ = ρ cos θi′ cos θo′ of a finite ρ is 0
/// there. All functions are ≥ 0, so non-negative coefficients make a non-negative spline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Basis {
    intervals: usize,
}

/// The up to six functions that are not zero at an angle: index of the first, and their values.
#[derive(Clone, Copy, Debug)]
pub struct Local {
    first: usize,
    count: usize,
    values: [f64; DEGREE + 1],
}

impl Local {
    /// Pairs (index, value).
    pub fn iter(&self) -> impl Iterator<Item = (usize, f64)> + Clone + '_ {
        (0..self.count).map(|k| (self.first + k, self.values[k]))
    }
}

impl Basis {
    /// At least 12 intervals, so that left and right ends do not meet.
    pub fn new(intervals: usize) -> Self {
        Self {
            intervals: intervals.max(12),
        }
    }

    /// Number of functions.
    pub fn len(&self) -> usize {
        self.intervals + DEGREE - 2
    }

    /// Number of unknowns of a symmetric function of two angles.
    pub fn pairs(&self) -> usize {
        self.len() * (self.len() + 1) / 2
    }

    /// Distance of the knots, radians.
    pub fn spacing(&self) -> f64 {
        PI / self.intervals as f64
    }

    /// Index of the unknown c_{mn} = c_{nm}.
    pub fn pair(&self, m: usize, n: usize) -> usize {
        let (high, low) = if m >= n { (m, n) } else { (n, m) };
        high * (high + 1) / 2 + low
    }

    /// Angle at which function `m` is largest, radians; exact for the inner ones.
    pub fn centre(&self, m: usize) -> f64 {
        // Greville abscissa: the mean of the inner knots of the full function m + 1.
        let knots = (m + 2..m + 2 + DEGREE).map(|k| self.knot(k));
        knots.sum::<f64>() / DEGREE as f64
    }

    /// Knot `k` of the clamped sequence, radians.
    fn knot(&self, k: usize) -> f64 {
        k.saturating_sub(DEGREE).min(self.intervals) as f64 * self.spacing() - FRAC_PI_2
    }

    /// The functions at `angle`; none outside ±π/2 (Cox–de Boor recurrence).
    pub fn at(&self, angle: f64) -> Local {
        let mut values = [0.0; DEGREE + 1];
        if angle.is_nan() || angle.abs() > FRAC_PI_2 {
            return Local {
                first: 0,
                count: 0,
                values,
            };
        }
        let h = self.spacing();
        let x = ((angle + FRAC_PI_2) / h).clamp(0.0, self.intervals as f64);
        let cell = (x as usize).min(self.intervals - 1);
        // Clamped knots in units of h: cell + k, held within the domain.
        let knot =
            |k: isize| -> f64 { (cell as isize + k).clamp(0, self.intervals as isize) as f64 };
        let mut b = [0.0; DEGREE + 1];
        b[0] = 1.0;
        for degree in 1..=DEGREE {
            let mut carry = 0.0;
            for (r, value) in b.iter_mut().enumerate().take(degree) {
                let right = knot(r as isize + 1);
                let left = knot(r as isize + 1 - degree as isize);
                let term = *value / (right - left);
                *value = carry + (right - x) * term;
                carry = (x - left) * term;
            }
            b[degree] = carry;
        }
        // Full indices cell … cell + degree; the first and the last function of all are left out.
        let mut first = cell;
        let mut count = 0;
        for (k, &value) in b.iter().enumerate() {
            let full = cell + k;
            if full == 0 || full == self.intervals + DEGREE - 1 {
                continue;
            }
            if count == 0 {
                first = full - 1;
            }
            values[count] = value;
            count += 1;
        }
        Local {
            first,
            count,
            values,
        }
    }

    /// ∫ φ_m(θ) e^{−ipθ} dθ for 0 ≤ p ≤ `order`: \[p\]\[m\], radians.
    pub fn spectrum(&self, order: usize) -> Vec<Vec<Complex64>> {
        let mut out = vec![vec![Complex64::ZERO; self.len()]; order + 1];
        let h = self.spacing();
        // 8 nodes are exact to rounding while p times the panel is below 2.
        let panels = (order as f64 * h / 2.0).ceil().max(1.0) as usize;
        let width = h / panels as f64;
        for panel in 0..self.intervals * panels {
            let middle = -FRAC_PI_2 + (panel as f64 + 0.5) * width;
            for (x, w) in GAUSS.iter().flat_map(|&(x, w)| [(x, w), (-x, w)]) {
                let angle = middle + x * width / 2.0;
                let local = self.at(angle);
                let step = Complex64::cis(-angle);
                let mut turn = Complex64::new(w * width / 2.0, 0.0);
                for row in &mut out {
                    for (m, value) in local.iter() {
                        row[m] += turn * value;
                    }
                    turn *= step;
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splines_reproduce_a_quadratic_that_vanishes_at_the_ends() {
        // They hold every quadratic; its coefficient is the blossom: x² becomes the mean product of pairs of inner knots.
        let basis = Basis::new(12);
        let coefficient = |m: usize| {
            let knots: Vec<f64> = (m + 2..m + 2 + DEGREE).map(|k| basis.knot(k)).collect();
            let (sum, squares) = knots
                .iter()
                .fold((0.0, 0.0), |(s, q), k| (s + k, q + k * k));
            let pairs = (DEGREE * (DEGREE - 1)) as f64;
            FRAC_PI_2 * FRAC_PI_2 - (sum * sum - squares) / pairs
        };
        for k in 0..=100 {
            let angle = -FRAC_PI_2 + f64::from(k) / 100.0 * PI;
            let value: f64 = basis
                .at(angle)
                .iter()
                .map(|(m, v)| v * coefficient(m))
                .sum();
            let truth = FRAC_PI_2 * FRAC_PI_2 - angle * angle;
            // Rounding of a handful of operations of size 2.
            assert!((value - truth).abs() < 1e-13, "{angle} {value} {truth}");
        }
        assert_eq!(basis.at(1.58).iter().count(), 0);
        assert_eq!(basis.at(f64::NAN).iter().count(), 0);
    }

    #[test]
    fn the_spectrum_of_a_spline_is_that_of_its_samples() {
        let basis = Basis::new(12);
        let spectrum = basis.spectrum(9);
        let n = 20_000;
        for m in [0, 1, 4, 14] {
            for p in [0usize, 1, 4, 9] {
                let mut sum = Complex64::ZERO;
                for i in 0..n {
                    let angle = -FRAC_PI_2 + (i as f64 + 0.5) * PI / n as f64;
                    for (k, v) in basis.at(angle).iter() {
                        if k == m {
                            sum += v * Complex64::cis(-(p as f64) * angle) * PI / n as f64;
                        }
                    }
                }
                // Midpoint rule: step² / 24 · |f''| · width, |f''| ≤ 6/h² + p², below 1e-6.
                assert!((sum - spectrum[p][m]).norm() < 1e-6);
            }
        }
    }
}
