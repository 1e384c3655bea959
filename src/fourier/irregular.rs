//! Sums over samples anywhere on the circle: Σ f_i e^{−idα_i}, by a recurrence over d; and series at such places.

use num_complex::Complex64;

use super::Series;

/// cos α and −sin α of each angle (radians): the factor e^{−iα} from one frequency to the next.
pub fn turns(alpha: &[f64]) -> Vec<[f64; 2]> {
    let turn = |alpha: &f64| {
        let (sin, cos) = (-alpha).sin_cos();
        [cos, sin]
    };
    alpha.iter().map(turn).collect()
}

/// Lists of values whose sums share the turns' powers: as many as there are registers for.
const TOGETHER: usize = 6;

/// Samples whose powers are taken through all frequencies at a time: they stay in the nearest cache.
const BLOCK: usize = 256;

/// Σ_i value_i turn_i^d for 0 ≤ d ≤ order, for each list of values; what is 0 in all lists that share powers costs nothing. After d
/// steps a power is d roundings off.
pub fn sums(turns: &[[f64; 2]], values: &[&[f64]], order: usize) -> Vec<Vec<Complex64>> {
    fn powers<const N: usize>(
        turns: &[[f64; 2]],
        values: [&[f64]; N],
        order: usize,
    ) -> [Vec<Complex64>; N] {
        pulp::Arch::new().dispatch(Powers {
            turns,
            values,
            order,
        })
    }
    let mut sums = Vec::with_capacity(values.len());
    for group in values.chunks(TOGETHER) {
        match *group {
            [a, b, c, d, e, f] => sums.extend(powers(turns, [a, b, c, d, e, f], order)),
            [a, b, c, d, e] => sums.extend(powers(turns, [a, b, c, d, e], order)),
            [a, b, c, d] => sums.extend(powers(turns, [a, b, c, d], order)),
            [a, b, c] => sums.extend(powers(turns, [a, b, c], order)),
            [a, b] => sums.extend(powers(turns, [a, b], order)),
            [a] => sums.extend(powers(turns, [a], order)),
            _ => {}
        }
    }
    sums
}

/// The sums of N lists, with the processor's widest instructions: as many samples side by side as it takes at once.
struct Powers<'a, const N: usize> {
    turns: &'a [[f64; 2]],
    values: [&'a [f64]; N],
    order: usize,
}

impl<const N: usize> pulp::WithSimd for Powers<'_, N> {
    type Output = [Vec<Complex64>; N];

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> [Vec<Complex64>; N] {
        let zero = simd.splat_f64s(0.0);
        // Samples that any of the lists has.
        let present: Vec<usize> = (0..self.turns.len())
            .filter(|&i| {
                self.values
                    .iter()
                    .any(|list| list.get(i).is_some_and(|v| *v != 0.0))
            })
            .collect();
        let mut sums = std::array::from_fn(|_| vec![Complex64::ZERO; self.order + 1]);
        for present in present.chunks(BLOCK) {
            // Cosine, sine, real and imaginary part of the power so far, and the values, in vectors; the last ones
            // are filled up with zeros.
            let vectors = present.len().div_ceil(S::F64_LANES);
            let mut all = vec![([zero, zero, simd.splat_f64s(1.0), zero], [zero; N]); vectors];
            let put = |vector: &mut S::f64s, lane: usize, value: f64| {
                let lanes: &mut [f64] =
                    pulp::bytemuck::cast_slice_mut(std::slice::from_mut(vector));
                if let Some(out) = lanes.get_mut(lane) {
                    *out = value;
                }
            };
            for (at, &i) in present.iter().enumerate() {
                let lane = at % S::F64_LANES;
                let (powers, lists) = &mut all[at / S::F64_LANES];
                put(&mut powers[0], lane, self.turns[i][0]);
                put(&mut powers[1], lane, self.turns[i][1]);
                for (list, values) in lists.iter_mut().zip(&self.values) {
                    put(list, lane, values.get(i).copied().unwrap_or(0.0));
                }
            }
            for p in 0..=self.order {
                let mut total = [[zero; 2]; N];
                for ([cos, sin, re, im], lists) in &mut all {
                    for (total, &list) in total.iter_mut().zip(&*lists) {
                        total[0] = simd.mul_add_e_f64s(list, *re, total[0]);
                        total[1] = simd.mul_add_e_f64s(list, *im, total[1]);
                    }
                    let turned = simd.sub_f64s(simd.mul_f64s(*re, *cos), simd.mul_f64s(*im, *sin));
                    *im = simd.mul_add_e_f64s(*re, *sin, simd.mul_f64s(*im, *cos));
                    *re = turned;
                }
                for (sums, [re, im]) in sums.iter_mut().zip(total) {
                    sums[p] += Complex64::new(simd.reduce_sum_f64s(re), simd.reduce_sum_f64s(im));
                }
            }
        }
        sums
    }
}

/// The values of some series at all samples, \[series\]\[n\]: [`Series::evaluate`] to a rounding per frequency.
pub fn synthesise(turns: &[[f64; 2]], series: &[&Series]) -> Vec<Vec<f64>> {
    fn of<const N: usize>(turns: &[[f64; 2]], series: [&Series; N]) -> [Vec<f64>; N] {
        pulp::Arch::new().dispatch(Synthesis { turns, series })
    }
    let mut values = Vec::with_capacity(series.len());
    for group in series.chunks(3) {
        match *group {
            [a, b, c] => values.extend(of(turns, [a, b, c])),
            [a, b] => values.extend(of(turns, [a, b])),
            [a] => values.extend(of(turns, [a])),
            _ => {}
        }
    }
    values
}

/// The values of N series, with the processor's widest instructions.
struct Synthesis<'a, const N: usize> {
    turns: &'a [[f64; 2]],
    series: [&'a Series; N],
}

impl<const N: usize> pulp::WithSimd for Synthesis<'_, N> {
    type Output = [Vec<f64>; N];

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> [Vec<f64>; N] {
        /// Vectors side by side: a power waits for the one before it.
        const SIDE: usize = 4;
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let order = self.series.iter().map(|s| s.order()).max().unwrap_or(0);
        // f = c_0 + 2 Re Σ c_p e^{ipα}; the powers are those of e^{−iα}.
        let coefficients: Vec<[[f64; 2]; N]> = (0..=order)
            .map(|p| {
                let twice = if p == 0 { 1.0 } else { 2.0 };
                self.series.map(|s| {
                    let c = s.coefficients.get(p).copied().unwrap_or_default();
                    [twice * c.re, twice * c.im]
                })
            })
            .collect();
        let mut values: [Vec<f64>; N] = std::array::from_fn(|_| vec![0.0; self.turns.len()]);
        let together = SIDE * S::F64_LANES;
        for (block, turns) in self.turns.chunks(together).enumerate() {
            let (mut cos, mut sin) = ([zero; SIDE], [zero; SIDE]);
            for (all, of) in [(&mut cos, 0), (&mut sin, 1)] {
                let lanes: &mut [f64] = pulp::bytemuck::cast_slice_mut(all.as_mut_slice());
                for (lane, turn) in lanes.iter_mut().zip(turns) {
                    *lane = turn[of];
                }
            }
            let (mut re, mut im) = ([one; SIDE], [zero; SIDE]);
            let mut sums = [[zero; SIDE]; N];
            for of_series in &coefficients {
                for (sums, [a, b]) in sums.iter_mut().zip(of_series) {
                    let (a, b) = (simd.splat_f64s(*a), simd.splat_f64s(*b));
                    for k in 0..SIDE {
                        let with_re = simd.mul_add_e_f64s(a, re[k], sums[k]);
                        sums[k] = simd.mul_add_e_f64s(b, im[k], with_re);
                    }
                }
                for k in 0..SIDE {
                    let turned =
                        simd.sub_f64s(simd.mul_f64s(re[k], cos[k]), simd.mul_f64s(im[k], sin[k]));
                    im[k] = simd.mul_add_e_f64s(re[k], sin[k], simd.mul_f64s(im[k], cos[k]));
                    re[k] = turned;
                }
            }
            for (values, sums) in values.iter_mut().zip(&sums) {
                let lanes: &[f64] = pulp::bytemuck::cast_slice(sums.as_slice());
                let out = values.iter_mut().skip(block * together);
                for (out, lane) in out.zip(lanes) {
                    *out = *lane;
                }
            }
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn series_are_synthesised_as_they_are_evaluated() {
        let series = |order: usize| Series {
            coefficients: (0..=order)
                .map(|p| {
                    Complex64::new(
                        (p as f64 * 1.3).cos(),
                        if p == 0 { 0.0 } else { (p as f64 * 0.7).sin() },
                    )
                })
                .collect(),
        };
        for count in [0, 1, 7, 16, 33, 100] {
            let alpha: Vec<f64> = (0..count).map(|i| 0.061 * i as f64 - 3.0).collect();
            let all = [series(0), series(40), series(137), series(3), series(12)];
            let some: Vec<&Series> = all.iter().collect();
            let found = synthesise(&turns(&alpha), &some);
            assert_eq!(found.len(), all.len());
            for (series, found) in all.iter().zip(&found) {
                assert_eq!(found.len(), alpha.len());
                for (alpha, found) in alpha.iter().zip(found) {
                    // A rounding for each power of each of 138 terms of size 2.
                    assert!((series.evaluate(*alpha) - found).abs() < 1e-11);
                }
            }
        }
    }
}
