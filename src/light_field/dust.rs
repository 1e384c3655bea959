//! Rows of a station that do not belong: dust, scratches, a thread across the cylinder.
//!
//! The rows that a station averages show one place of a homogeneous object and follow 1, t, t² to within
//! their noise. A station whose rows scatter far more than those of its neighbourhood is fitted again to
//! the rows that agree with each other (least trimmed squares: P. J. Rousseeuw, "Least median of squares
//! regression", J. Am. Stat. Assoc. 79 (1984)), without those far off. Stations that agree are not touched.

use pulp::Simd;

use super::strip::Sums;

/// Stations of one neighbourhood.
const NEIGHBOURHOOD: usize = 32;

/// Scatter, in units of the neighbourhood's median and of the pixels' stated variance, from which a station is
/// looked at again: with 5 degrees of freedom chance gives 8 times in one station of a million.
const SUSPICIOUS: (f64, f64) = (8.0, 4.0);

/// The least degrees of freedom with which rows can be told to be off.
pub(super) const LEAST_FREEDOM: u32 = 4;

/// Part of the rows that is taken to be sound, and steps of trimming.
const SOUND: f64 = 0.6;
const STEPS: usize = 6;

/// A row is off by this many standard deviations of the sound ones.
const OFF: f64 = 5.0;

/// The variance of normal values over that of the 60 % with the smallest residuals.
const TRIMMED: f64 = 4.85;

/// Stations (of one channel) whose rows scatter suspiciously: each with its rows' variance about the fit and the
/// mean stated variance of its pixels, along the line; nothing where there are too few rows to tell.
pub(super) fn suspicious(stations: &[Option<[f64; 2]>]) -> Vec<usize> {
    let medians: Vec<f64> = stations
        .chunks(NEIGHBOURHOOD)
        .map(|block| {
            let mut values: Vec<f64> = block.iter().flatten().map(|s| s[0]).collect();
            let middle = values.len() / 2;
            if values.is_empty() {
                return f64::INFINITY;
            }
            *values.select_nth_unstable_by(middle, f64::total_cmp).1
        })
        .collect();
    let median = |block: usize| medians.get(block).copied().unwrap_or(f64::INFINITY);
    stations
        .iter()
        .enumerate()
        .filter_map(|(k, station)| {
            let [scatter, stated] = (*station)?;
            let block = k / NEIGHBOURHOOD;
            // Dust may cover most of a neighbourhood, not three of them.
            let usual = median(block)
                .min(median(block + 1))
                .min(block.checked_sub(1).map_or(f64::INFINITY, median));
            let limit = (SUSPICIOUS.0 * usual).max(SUSPICIOUS.1 * stated);
            (scatter > limit).then_some(k)
        })
        .collect()
}

/// The rows of one station: their distances from the line, values and variances.
#[derive(Default)]
pub(super) struct Rows {
    t: Vec<f64>,
    value: Vec<f64>,
    variance: Vec<f64>,
    /// Distances from the curve through the trusted rows.
    distance: Vec<f64>,
    /// 1 for a trusted row, 0 for others.
    trusted: Vec<f64>,
}

impl Rows {
    pub(super) fn clear(&mut self) {
        self.t.clear();
        self.value.clear();
        self.variance.clear();
    }

    pub(super) fn push(&mut self, t: f64, value: f64, variance: f64) {
        self.t.push(t);
        self.value.push(value);
        self.variance.push(variance);
    }

    /// The sums over the rows that agree, if any do not.
    pub(super) fn without_dust(&mut self) -> Option<Sums> {
        pulp::Arch::new().dispatch(WithoutDust(self))
    }

    #[inline(always)]
    fn trimmed<S: Simd>(&mut self, simd: S) -> Option<Sums> {
        let count = self.t.len();
        let sound = ((count as f64 * SOUND) as usize).max(5);
        if count <= sound {
            return None;
        }
        let median = nth(simd, &self.value, count / 2);
        self.distance.clear();
        self.distance
            .extend(self.value.iter().map(|v| (v - median).abs()));
        self.trusted.clear();
        self.trusted.resize(count, 0.0);
        let mut scale = 0.0;
        for _ in 0..STEPS {
            if !self.trust(simd, sound) {
                break;
            }
            let sums = self.sums();
            let (curve, trimmed) = sums.curve()?;
            let stated = sums.variance / f64::from(sums.count);
            scale = (TRIMMED * trimmed.residual / f64::from(trimmed.freedom.max(1))).max(stated);
            let k = super::strip::PIXEL_VARIANCE;
            for ((distance, t), value) in self.distance.iter_mut().zip(&self.t).zip(&self.value) {
                *distance = (value - curve[0] - curve[1] * t - curve[2] * (t * t + k)).abs();
            }
        }
        let limit = OFF * scale.sqrt();
        let mut kept = 0;
        for (trusted, d) in self.trusted.iter_mut().zip(&self.distance) {
            let near = *d <= limit;
            kept += usize::from(near);
            *trusted = if near { 1.0 } else { 0.0 };
        }
        (kept >= sound && kept < count).then(|| self.sums())
    }

    /// Trusts the `sound` rows nearest to the curve; whether these are others than before.
    #[inline(always)]
    fn trust<S: Simd>(&mut self, simd: S, sound: usize) -> bool {
        let limit = nth(simd, &self.distance, sound - 1);
        let (below, _) = counts(simd, &self.distance, limit);
        // Among equally distant rows the first ones, so that there are `sound` of them.
        let mut ties = sound.saturating_sub(below);
        let mut changed = false;
        for (trusted, d) in self.trusted.iter_mut().zip(&self.distance) {
            let tied = *d == limit && ties > 0;
            ties -= usize::from(tied);
            let now = if *d < limit || tied { 1.0 } else { 0.0 };
            changed |= *trusted != now;
            *trusted = now;
        }
        changed
    }

    /// The sums over the trusted rows, added in their order: rows of equal values on both sides of the line are equally
    /// far off but for rounding.
    #[inline(always)]
    fn sums(&self) -> Sums {
        let mut sums = Sums::default();
        let rows = self.t.iter().zip(&self.value).zip(&self.variance);
        for (((&t, &value), variance), trusted) in rows.zip(&self.trusted) {
            if *trusted > 0.0 {
                let t2 = t * t;
                sums.count += 1;
                for (sum, power) in sums.powers.iter_mut().zip([1.0, t, t2, t2 * t, t2 * t2]) {
                    *sum += power;
                }
                for (sum, power) in sums.values.iter_mut().zip([1.0, t, t2]) {
                    *sum += value * power;
                }
                sums.square += value * value;
                sums.variance += variance;
            }
        }
        sums
    }
}

/// The work of [`Rows::without_dust`], with the processor's widest instructions.
struct WithoutDust<'a>(&'a mut Rows);

impl pulp::WithSimd for WithoutDust<'_> {
    type Output = Option<Sums>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<Sums> {
        self.0.trimmed(simd)
    }
}

/// How many values are below the pivot, and how many are equal to it.
#[inline(always)]
fn counts<S: Simd>(simd: S, values: &[f64], pivot: f64) -> (usize, usize) {
    let (vectors, rest) = S::as_simd_f64s(values);
    let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
    let at = simd.splat_f64s(pivot);
    let (mut below, mut equal) = (zero, zero);
    for &v in vectors {
        below = simd.add_f64s(
            below,
            simd.select_f64s(simd.less_than_f64s(v, at), one, zero),
        );
        equal = simd.add_f64s(equal, simd.select_f64s(simd.equal_f64s(v, at), one, zero));
    }
    let count = |of: &dyn Fn(&f64) -> bool| rest.iter().filter(|v| of(v)).count();
    (
        simd.reduce_sum_f64s(below) as usize + count(&|v| *v < pivot),
        simd.reduce_sum_f64s(equal) as usize + count(&|v| *v == pivot),
    )
}

/// The value of rank `n` (from 0) by counting: on some dozens of values faster than moving them about.
#[inline(always)]
fn nth<S: Simd>(simd: S, values: &[f64], n: usize) -> f64 {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for &pivot in values {
        if !(pivot > low && pivot < high) {
            continue;
        }
        let (below, equal) = counts(simd, values, pivot);
        if below > n {
            high = pivot;
        } else if below + equal > n {
            return pivot;
        } else {
            low = pivot;
        }
    }
    // Values that are not finite.
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(n).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of one station with the noise of a fixed sequence.
    fn rows(off: impl Fn(usize) -> f64) -> Rows {
        let mut rows = Rows::default();
        for i in 0..48 {
            let t = i as f64 - 23.5;
            let noise = ((i * 7919 % 101) as f64 / 101.0 - 0.5) * 0.02;
            rows.push(t, 1.0 - 1e-4 * t * t + noise + off(i), 3.3e-5);
        }
        rows
    }

    #[test]
    fn counting_finds_what_sorting_finds() {
        for length in 1..60 {
            // With repeated values.
            let values: Vec<f64> = (0..length).map(|i| (i * 7919 % 23) as f64 - 9.0).collect();
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            for (n, expected) in sorted.iter().enumerate() {
                assert_eq!(nth(pulp::Scalar, &values, n), *expected);
            }
        }
        let endless = [f64::INFINITY, 1.0, f64::INFINITY];
        assert_eq!(nth(pulp::Scalar, &endless, 1), f64::INFINITY);
    }

    #[test]
    fn dust_is_left_out_and_nothing_else() {
        // A spot over a quarter of the rows and a thin scratch, light and dark.
        let mut dusty = rows(|i| match i {
            20..32 => 0.4,
            40 => -0.3,
            _ => 0.0,
        });
        let kept = dusty.without_dust().expect("rows are off");
        assert_eq!(kept.count, 48 - 13);
        let value = kept.fit().unwrap().value;
        // 35 rows of σ 0.006, half of them far from the line: known to 0.004.
        assert!((value - 1.0).abs() < 0.01, "{value}");
        assert!(rows(|_| 0.0).without_dust().is_none());
    }

    #[test]
    fn a_station_is_suspicious_against_its_neighbours() {
        let fit = |scatter: f64| Some([scatter, 1e-4]);
        let mut fits: Vec<_> = (0..200).map(|k| fit(1e-3 + 1e-5 * k as f64)).collect();
        assert!(suspicious(&fits).is_empty());
        fits[60..75].fill(fit(0.05));
        fits[150] = None;
        assert_eq!(suspicious(&fits), (60..75).collect::<Vec<_>>());
    }
}
