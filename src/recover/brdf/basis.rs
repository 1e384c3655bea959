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

    /// The same on intervals of half the width.
    pub fn halved(&self) -> Self {
        Self {
            intervals: 2 * self.intervals,
        }
    }

    /// Number of intervals.
    pub fn intervals(&self) -> usize {
        self.intervals
    }

    /// Angle at `part` of interval `i`, radians.
    pub fn cell(&self, i: usize, part: f64) -> f64 {
        (i as f64 + part) * self.spacing() - FRAC_PI_2
    }

    /// Interval in which `angle` is, radians.
    pub fn interval(&self, angle: f64) -> usize {
        // A number that is none counts as 0.
        let x = ((angle + FRAC_PI_2) / self.spacing()).clamp(0.0, self.intervals as f64);
        (x as usize).min(self.intervals - 1)
    }

    /// The functions that are not zero on interval `i`.
    pub fn on(&self, i: usize) -> std::ops::Range<usize> {
        // Functions i … i + degree of the full sequence.
        i.saturating_sub(1)..(i + DEGREE).min(self.len())
    }

    /// First and last interval on which function `m` is not zero.
    pub fn support(&self, m: usize) -> (usize, usize) {
        // Function m + 1 of the full sequence.
        let full = m + 1;
        (full.saturating_sub(DEGREE), full.min(self.intervals - 1))
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

    /// The functions at `angle`; none outside ±π/2.
    pub fn at(&self, angle: f64) -> Local {
        self.derivative(angle, 0)
    }

    /// Derivatives of `order` 0 to 3 of the functions at `angle`, per rad^order; none outside ±π/2 (recurrence of Cox and de Boor; de Boor,
    /// A Practical Guide to Splines, 1978, ch. X).
    pub fn derivative(&self, angle: f64, order: usize) -> Local {
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
            // The last steps differentiate: per rad instead of times a distance.
            let differentiated = degree + order > DEGREE;
            let mut carry = 0.0;
            for (r, value) in b.iter_mut().enumerate().take(degree) {
                let right = knot(r as isize + 1);
                let left = knot(r as isize + 1 - degree as isize);
                let term = *value / (right - left);
                let (falling, rising) = match differentiated {
                    false => ((right - x) * term, (x - left) * term),
                    true => (-(degree as f64) / h * term, degree as f64 / h * term),
                };
                *value = carry + falling;
                carry = rising;
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

    /// These functions in those of [`Basis::halved`], φ_i = Σ_m s_{mi} φ_m: for each m the pairs (i, s_{mi}), all positive.
    ///
    /// The middles of the intervals are inserted as knots, one after the other (Boehm, "Inserting new knots into B-spline
    /// curves", Computer-Aided Design 12, 1980).
    pub fn subdivision(&self) -> Vec<Vec<(usize, f64)>> {
        let full = self.intervals + DEGREE;
        // Knots in units of the interval, and each control point as a combination of the coarse ones.
        let mut knots: Vec<f64> = (0..=full + DEGREE)
            .map(|k| k.saturating_sub(DEGREE).min(self.intervals) as f64)
            .collect();
        let mut points: Vec<Vec<(usize, f64)>> = (0..full).map(|i| vec![(i, 1.0)]).collect();
        for interval in 0..self.intervals {
            let new = interval as f64 + 0.5;
            let k = knots.partition_point(|&u| u <= new) - 1;
            let inserted = (0..=points.len())
                .map(|i| {
                    let share = if i + DEGREE <= k {
                        1.0
                    } else if i > k {
                        0.0
                    } else {
                        (new - knots[i]) / (knots[i + DEGREE] - knots[i])
                    };
                    let mut point: Vec<(usize, f64)> = Vec::new();
                    let before = i.checked_sub(1).and_then(|i| points.get(i));
                    for (part, weight) in [(points.get(i), share), (before, 1.0 - share)] {
                        for &(j, s) in part.into_iter().flatten().filter(|_| weight > 0.0) {
                            match point.iter_mut().find(|t| t.0 == j) {
                                Some(term) => term.1 += weight * s,
                                None => point.push((j, weight * s)),
                            }
                        }
                    }
                    point
                })
                .collect();
            points = inserted;
            knots.insert(k + 1, new);
        }
        // The first and the last function of either are left out.
        let last = points.len() - 1;
        points[1..last]
            .iter()
            .map(|point| {
                let inner = point.iter().filter(|(j, _)| (1..full - 1).contains(j));
                inner.map(|&(j, s)| (j - 1, s)).collect()
            })
            .collect()
    }

    /// Error of the splines on each interval, at the knot to its left, of the function with the coefficients `c`: quintic ones miss h⁶ f⁽⁶⁾/46080, and the
    /// sixth derivative is the jump of the fifth over h. The first interval has none at its left: 0.
    pub fn errors(&self, c: &[f64]) -> Vec<f64> {
        let mut d: Vec<f64> = std::iter::once(0.0)
            .chain(c.iter().copied())
            .chain(std::iter::once(0.0))
            .collect();
        let knot = |k: usize| k.saturating_sub(DEGREE).min(self.intervals) as f64;
        for order in 1..=DEGREE {
            let degree = (DEGREE + 1 - order) as f64;
            d = d
                .windows(2)
                .enumerate()
                .map(|(i, w)| degree * (w[1] - w[0]) / (knot(i + DEGREE + 1) - knot(i + order)))
                .collect();
        }
        std::iter::once(0.0)
            .chain(d.windows(2).map(|w| (w[1] - w[0]) / 46080.0))
            .collect()
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
    fn derivatives_are_those_of_the_values() {
        let basis = Basis::new(13);
        let step = 1e-3;
        for k in 0..60 {
            // Well within an interval, so that the difference does not cross a knot.
            let angle = basis.cell(k % 13, 0.2 + 0.6 * (k / 13) as f64 / 4.0);
            for order in 1..=3 {
                let dense = |x: f64, order: usize| {
                    let mut out = vec![0.0; basis.len()];
                    for (m, v) in basis.derivative(x, order).iter() {
                        out[m] += v;
                    }
                    out
                };
                let [low, high] = [-step, step].map(|d| dense(angle + d, order - 1));
                for (m, v) in dense(angle, order).into_iter().enumerate() {
                    let expected = (high[m] - low[m]) / (2.0 * step);
                    // step²/6 times two derivatives more, each at most 2 · 5/h of the function before: a difference of two
                    // splines, and the knots at the ends are no closer than an interval.
                    let each = 2.0 * DEGREE as f64 / basis.spacing();
                    let size = each.powi(order as i32);
                    let error = (each * step).powi(2) / 6.0;
                    assert!(
                        (v - expected).abs() < size * error,
                        "{angle} {order} {m}: {v} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_spline_is_the_sum_of_its_halves() {
        let basis = Basis::new(13);
        let fine = basis.halved();
        let parts = basis.subdivision();
        assert_eq!(parts.len(), fine.len());
        for k in 0..=200 {
            let angle = -FRAC_PI_2 + f64::from(k) / 200.0 * PI;
            let mut sum = vec![0.0; basis.len()];
            for (m, value) in fine.at(angle).iter() {
                for &(i, s) in &parts[m] {
                    assert!(s > 0.0);
                    sum[i] += s * value;
                }
            }
            for (i, value) in basis.at(angle).iter() {
                sum[i] -= value;
            }
            // Rounding of numbers up to 1.
            assert!(sum.iter().all(|s| s.abs() < 1e-14), "{angle} {sum:?}");
        }
    }

    #[test]
    fn the_error_of_interpolation_is_foretold() {
        // cos⁸(θ + 0.2)·cos²θ has a spectrum up to 10; its best spline is found by least squares on many points.
        let f = |x: f64| (x + 0.2).cos().powi(8) * x.cos().powi(2);
        let basis = Basis::new(30);
        let angles: Vec<f64> = (0..2000)
            .map(|k| -FRAC_PI_2 + (f64::from(k) + 0.5) / 2000.0 * PI)
            .collect();
        let n = basis.len();
        let mut normal = faer::Mat::<f64>::zeros(n, n);
        let mut right = vec![0.0; n];
        for &x in &angles {
            for (i, u) in basis.at(x).iter() {
                right[i] += u * f(x);
                for (j, v) in basis.at(x).iter() {
                    normal[(i, j)] += u * v;
                }
            }
        }
        let c = crate::recover::brdf::prior::Factor::new(&normal)
            .expect("splines are independent")
            .solve_vector(&right);
        let told = basis.errors(&c).iter().fold(0.0f64, |a, b| a.max(b.abs()));
        let worst = angles
            .iter()
            .map(|&x| {
                let value: f64 = basis.at(x).iter().map(|(i, v)| v * c[i]).sum();
                (value - f(x)).abs()
            })
            .fold(0.0, f64::max);
        // The constant is that of periodic interpolation at knots, the largest of a wave; the sixth derivative is that of the coarse spline.
        assert!((0.4..2.5).contains(&(told / worst)), "{told} {worst}");
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
