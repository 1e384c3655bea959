//! Sums over samples anywhere on the circle: Σ f_i e^{−idα_i}, by a recurrence over d.

use num_complex::Complex64;

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
