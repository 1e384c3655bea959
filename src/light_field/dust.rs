//! Rows of a station that do not belong: dust, scratches, a thread across the cylinder.
//!
//! The rows that a station averages show one place of a homogeneous object and follow 1, t, t² to within
//! their noise. A station whose rows scatter far more than those of its neighbourhood is fitted again to
//! the rows that agree with each other (least trimmed squares: P. J. Rousseeuw, "Least median of squares
//! regression", J. Am. Stat. Assoc. 79 (1984)), without those far off. Stations that agree are not touched.

use super::strip::Sums;

/// Stations of one neighbourhood.
const NEIGHBOURHOOD: usize = 32;

/// Scatter, in units of the neighbourhood's median and of the pixels' stated variance, from which a station is
/// looked at again: with 5 degrees of freedom chance gives 8 times in one station of a million.
const SUSPICIOUS: (f64, f64) = (8.0, 4.0);

/// Part of the largest radiance up to which rows may scatter about the fit unsuspected: what is no parabola is a curve of the fourth order, and
/// one that scatters so shifts the station by as much (0.9 of it), a tenth of what the choice of rows lets pass. Photographs without noise would be
/// full of dust otherwise.
const CURVED: f64 = 1e-5;

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
/// mean stated variance of its pixels, along the line; nothing where there are too few rows to tell. `largest` is the channel's
/// largest radiance.
pub(super) fn suspicious(stations: &[Option<[f64; 2]>], largest: f64) -> Vec<usize> {
    let curved = (CURVED * largest).powi(2);
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
            let limit = (SUSPICIOUS.0 * usual)
                .max(SUSPICIOUS.1 * stated)
                .max(curved);
            (scatter > limit).then_some(k)
        })
        .collect()
}

/// Rows that are worked on side by side, and summed in this order whatever the processor has: rows of equal values on both
/// sides of the line are equally far off but for rounding.
const LANES: usize = 4;

/// Guesses of a ranked value, and ranks that are left over to go one by one.
const GUESSES: usize = 8;
const NEAR: usize = 3;

/// The rows of one station: their distances from the line, values and variances.
#[derive(Default)]
pub(super) struct Rows {
    t: Vec<f64>,
    value: Vec<f64>,
    variance: Vec<f64>,
    /// Distances from the curve through the trusted rows; endless for what fills up the last [`LANES`].
    distance: Vec<f64>,
    /// 1 for a trusted row, 0 for others.
    trusted: Vec<f64>,
}

/// A list as whole [`LANES`].
fn lanes(list: &[f64]) -> &[[f64; LANES]] {
    list.as_chunks().0
}

fn lanes_mut(list: &mut [f64]) -> &mut [[f64; LANES]] {
    list.as_chunks_mut().0
}

impl Rows {
    /// Takes rows in place of those before, from image row `first` on, each with its value and variance: those that are there and no
    /// further than `reach` from the line at `height` (pixels from the top).
    pub(super) fn take(
        &mut self,
        first: u32,
        [height, reach]: [f64; 2],
        values: impl ExactSizeIterator<Item = f32>,
        variances: impl Iterator<Item = f32>,
    ) {
        let most = values.len();
        for list in [&mut self.t, &mut self.value, &mut self.variance] {
            list.resize(most, 0.0);
        }
        let mut count = 0;
        let [t, value, variance] =
            [&mut self.t, &mut self.value, &mut self.variance].map(|list| &mut list[..most]);
        for (row, (v, s)) in (first..).zip(values.zip(variances)) {
            let distance = f64::from(row) + 0.5 - height;
            if count < most {
                // What is not there is overwritten by what comes next.
                t[count] = distance;
                value[count] = f64::from(v);
                variance[count] = f64::from(s);
            }
            count += usize::from((distance.abs() <= reach) & s.is_finite());
        }
        for list in [&mut self.t, &mut self.value, &mut self.variance] {
            list.truncate(count);
        }
    }

    /// The sums over the rows that agree, if any do not.
    pub(super) fn without_dust(&mut self) -> Option<Sums> {
        pulp::Arch::new().dispatch(WithoutDust(self))
    }

    #[inline(always)]
    fn trimmed(&mut self) -> Option<Sums> {
        let count = self.t.len();
        let sound = ((count as f64 * SOUND) as usize).max(5);
        if count <= sound {
            return None;
        }
        let whole = count.next_multiple_of(LANES);
        self.distance.clone_from(&self.value);
        self.distance.resize(whole, f64::INFINITY);
        for list in [&mut self.t, &mut self.value, &mut self.variance] {
            list.resize(whole, 0.0);
        }
        let (least, most) = span(lanes(&self.distance));
        let middle = 0.5 * (least + most);
        let median = Ranked::from(
            lanes(&self.distance),
            count / 2,
            middle,
            least,
            Some((most, count)),
        )
        .value;
        for d in &mut self.distance[..count] {
            *d = (*d - median).abs();
        }
        self.trusted.clear();
        self.trusted.resize(whole, 0.0);
        let (mut scale, mut guess) = (0.0, 0.0);
        let (_, most) = span(lanes(&self.distance));
        let mut limit = Ranked::from(
            lanes(&self.distance),
            sound - 1,
            SOUND * most,
            0.0,
            Some((most, count)),
        );
        for step in 0..STEPS {
            if step > 0 {
                limit = Ranked::from(lanes(&self.distance), sound - 1, guess, 0.0, None);
            }
            if !self.trust(sound, limit) {
                break;
            }
            let sums = self.sums();
            let (curve, trimmed) = sums.curve()?;
            let stated = sums.variance / f64::from(sums.count);
            scale = (TRIMMED * trimmed.residual / f64::from(trimmed.freedom.max(1))).max(stated);
            let k = super::strip::PIXEL_VARIANCE;
            let rows = lanes(&self.t).iter().zip(lanes(&self.value));
            let distances = lanes_mut(&mut self.distance).iter_mut();
            let mut farthest = [0.0; LANES];
            for ((distance, trusted), (t, value)) in distances.zip(lanes(&self.trusted)).zip(rows) {
                for lane in 0..LANES {
                    let t = t[lane];
                    let d = (value[lane] - curve[0] - curve[1] * t - curve[2] * (t * t + k)).abs();
                    distance[lane] = d;
                    let further = (trusted[lane] > 0.0) & (d > farthest[lane]);
                    farthest[lane] = if further { d } else { farthest[lane] };
                }
            }
            // Of the rows that were trusted: none of the nearest ones is further off.
            guess = farthest.iter().copied().fold(0.0, f64::max);
            self.distance[count..].fill(f64::INFINITY);
        }
        let limit = OFF * scale.sqrt();
        let mut kept = [0.0; LANES];
        let trusted = lanes_mut(&mut self.trusted).iter_mut();
        for (trusted, d) in trusted.zip(lanes(&self.distance)) {
            for lane in 0..LANES {
                trusted[lane] = if d[lane] <= limit { 1.0 } else { 0.0 };
                kept[lane] += trusted[lane];
            }
        }
        let kept = kept.iter().sum::<f64>() as usize;
        (kept >= sound && kept < count).then(|| self.sums())
    }

    /// Trusts the `sound` rows nearest to the curve; whether these are others than before.
    #[inline(always)]
    fn trust(&mut self, sound: usize, limit: Ranked) -> bool {
        let mut changed = false;
        if limit.below + limit.equal == sound {
            let mut others = [0.0; LANES];
            let trusted = lanes_mut(&mut self.trusted).iter_mut();
            for (trusted, d) in trusted.zip(lanes(&self.distance)) {
                for lane in 0..LANES {
                    let now = if d[lane] <= limit.value { 1.0 } else { 0.0 };
                    others[lane] += f64::abs(now - trusted[lane]);
                    trusted[lane] = now;
                }
            }
            return others.iter().sum::<f64>() > 0.0;
        }
        // Among equally distant rows the first ones, so that there are `sound` of them.
        let mut ties = sound.saturating_sub(limit.below);
        for (trusted, d) in self.trusted.iter_mut().zip(&self.distance) {
            let tied = *d == limit.value && ties > 0;
            ties -= usize::from(tied);
            let now = if *d < limit.value || tied { 1.0 } else { 0.0 };
            changed |= *trusted != now;
            *trusted = now;
        }
        changed
    }

    /// The sums over the trusted rows.
    #[inline(always)]
    fn sums(&self) -> Sums {
        // Count, Σ t … t⁴, Σ v, Σ v t, Σ v t², Σ v², Σ variance.
        let mut sums = [[0.0; LANES]; 10];
        let [t, value, variance, trusted] =
            [&self.t, &self.value, &self.variance, &self.trusted].map(|list| lanes(list));
        for (((t, value), variance), trusted) in t.iter().zip(value).zip(variance).zip(trusted) {
            for lane in 0..LANES {
                // What is not trusted adds zeros.
                let used = trusted[lane] > 0.0;
                let one = if used { 1.0 } else { 0.0 };
                let t = if used { t[lane] } else { 0.0 };
                let v = if used { value[lane] } else { 0.0 };
                let s = if used { variance[lane] } else { 0.0 };
                let t2 = t * t;
                let terms = [one, t, t2, t2 * t, t2 * t2, v, v * t, v * t2, v * v, s];
                for (sum, term) in sums.iter_mut().zip(terms) {
                    sum[lane] += term;
                }
            }
        }
        let [n, p1, p2, p3, p4, v0, v1, v2, square, variance] =
            sums.map(|lanes| lanes.iter().sum::<f64>());
        Sums {
            count: n as u32,
            powers: [n, p1, p2, p3, p4],
            values: [v0, v1, v2],
            square,
            variance,
        }
    }
}

/// The work of [`Rows::without_dust`], for the processor's widest instructions.
struct WithoutDust<'a>(&'a mut Rows);

impl pulp::NullaryFnOnce for WithoutDust<'_> {
    type Output = Option<Sums>;

    #[inline(always)]
    fn call(self) -> Option<Sums> {
        self.0.trimmed()
    }
}

/// A value among others, how many of them are below it, and how many are equal to it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ranked {
    value: f64,
    below: usize,
    equal: usize,
}

impl Ranked {
    #[inline(always)]
    fn of(values: &[[f64; LANES]], value: f64) -> Self {
        let (mut below, mut equal) = ([0.0; LANES], [0.0; LANES]);
        for lanes in values {
            for lane in 0..LANES {
                below[lane] += if lanes[lane] < value { 1.0 } else { 0.0 };
                equal[lane] += if lanes[lane] == value { 1.0 } else { 0.0 };
            }
        }
        Self {
            value,
            below: below.iter().sum::<f64>() as usize,
            equal: equal.iter().sum::<f64>() as usize,
        }
    }

    /// Whether it has this rank (from 0).
    fn is(&self, rank: usize) -> bool {
        self.below <= rank && rank < self.below + self.equal
    }

    /// The value of a rank by counting: on some dozens of values faster than moving them about.
    #[inline(always)]
    fn among(values: &[[f64; LANES]], rank: usize) -> Self {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for &pivot in values.as_flattened() {
            if !(pivot > low && pivot < high) {
                continue;
            }
            let found = Self::of(values, pivot);
            if found.below > rank {
                high = pivot;
            } else if found.is(rank) {
                return found;
            } else {
                low = pivot;
            }
        }
        // Values that are not finite.
        let mut sorted = values.as_flattened().to_vec();
        sorted.sort_by(f64::total_cmp);
        Self::of(values, sorted.get(rank).copied().unwrap_or(f64::NAN))
    }

    /// The same among values from `least` on, of which so many are no larger than `most`, from a guess: between two values whose ranks lie on both sides by linear interpolation, and
    /// the last few ranks one by one.
    #[inline(always)]
    fn from(
        values: &[[f64; LANES]],
        rank: usize,
        guess: f64,
        least: f64,
        most: Option<(f64, usize)>,
    ) -> Self {
        // A value and how many are not above it; a value and how many are below it.
        let (mut low, mut not_above) = (least.next_down(), 0);
        let mut high = most.map(|(most, count)| (most.next_up(), count));
        let mut guess = guess;
        for _ in 0..GUESSES {
            let found = Self::of(values, guess);
            if found.is(rank) {
                return found;
            }
            if found.below > rank {
                high = Some((guess, found.below));
            } else {
                (low, not_above) = (guess, found.below + found.equal);
            }
            let (up, down) = (rank + 1 - not_above, high.map(|(_, below)| below - rank));
            if up <= NEAR || down.is_some_and(|down| down <= NEAR) {
                let upwards = down.is_none_or(|down| up <= down);
                let (mut value, steps) = match high {
                    Some((high, below)) if !upwards => (high, below - rank),
                    _ => (low, up),
                };
                for _ in 0..steps {
                    value = if upwards {
                        next_above(values, value)
                    } else {
                        next_below(values, value)
                    };
                }
                // Among equal values steps are longer than ranks.
                let found = Self::of(values, value);
                if found.is(rank) {
                    return found;
                }
                break;
            }
            guess = match high {
                Some((high, below)) => {
                    let share = (rank as f64 + 0.5 - not_above as f64) / (below - not_above) as f64;
                    low + (high - low) * share
                }
                None => 1.5 * guess,
            };
        }
        Self::among(values, rank)
    }
}

/// The least and the largest of the values that are not endless.
#[inline(always)]
fn span(values: &[[f64; LANES]]) -> (f64, f64) {
    let (mut least, mut most) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
    for lanes in values {
        for lane in 0..LANES {
            let value = lanes[lane];
            least[lane] = if value < least[lane] {
                value
            } else {
                least[lane]
            };
            let more = (value > most[lane]) & (value < f64::INFINITY);
            most[lane] = if more { value } else { most[lane] };
        }
    }
    (
        least.into_iter().fold(f64::INFINITY, f64::min),
        most.into_iter().fold(f64::NEG_INFINITY, f64::max),
    )
}

/// The least of the values above another.
#[inline(always)]
fn next_above(values: &[[f64; LANES]], value: f64) -> f64 {
    let mut next = [f64::INFINITY; LANES];
    for lanes in values {
        for lane in 0..LANES {
            let nearer = (lanes[lane] > value) & (lanes[lane] < next[lane]);
            next[lane] = if nearer { lanes[lane] } else { next[lane] };
        }
    }
    next.iter().copied().fold(f64::INFINITY, f64::min)
}

/// The largest of the values below another.
#[inline(always)]
fn next_below(values: &[[f64; LANES]], value: f64) -> f64 {
    let mut next = [f64::NEG_INFINITY; LANES];
    for lanes in values {
        for lane in 0..LANES {
            let nearer = (lanes[lane] < value) & (lanes[lane] > next[lane]);
            next[lane] = if nearer { lanes[lane] } else { next[lane] };
        }
    }
    next.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of one station with the noise of a fixed sequence.
    fn rows(off: impl Fn(usize) -> f64) -> Rows {
        let mut rows = Rows::default();
        let value = |i: usize| {
            let t = i as f64 - 23.5;
            let noise = ((i * 7919 % 101) as f64 / 101.0 - 0.5) * 0.02;
            (1.0 - 1e-4 * t * t + noise + off(i)) as f32
        };
        let values: Vec<f32> = (0..48).map(value).collect();
        let line = [24.0, 30.0];
        rows.take(0, line, values.into_iter(), [3.3e-5; 48].into_iter());
        rows
    }

    #[test]
    fn counting_finds_what_sorting_finds() {
        for length in 1..16 {
            // With repeated values.
            let value = |i: usize| (i * 7919 % 23) as f64 - 9.0;
            let values: Vec<[f64; LANES]> = (0..length)
                .map(|i| std::array::from_fn(|lane| value(LANES * i + lane)))
                .collect();
            let mut sorted = values.as_flattened().to_vec();
            sorted.sort_by(f64::total_cmp);
            for (rank, expected) in sorted.iter().enumerate() {
                let found = Ranked::among(&values, rank);
                assert!(found.value == *expected && found.is(rank));
                let (least, most) = span(&values);
                assert_eq!((Some(&least), Some(&most)), (sorted.first(), sorted.last()));
                let found = Ranked::from(
                    &values,
                    rank,
                    0.5 * (least + most),
                    least,
                    Some((most, sorted.len())),
                );
                assert!(found.value == *expected && found.is(rank));
                // From any guess, where no value is below 0.
                let above: Vec<[f64; LANES]> =
                    values.iter().map(|lanes| lanes.map(|v| v + 9.0)).collect();
                for guess in [0.0, 0.5, 3.0, 7.7, 13.0, 22.0, 30.0, f64::NAN] {
                    let found = Ranked::from(&above, rank, guess, 0.0, None);
                    assert!(found.value == *expected + 9.0 && found.is(rank));
                }
            }
        }
        let endless = [[f64::INFINITY, 1.0, f64::INFINITY, 2.0]];
        assert_eq!(Ranked::among(&endless, 2).value, f64::INFINITY);
        assert_eq!(span(&endless), (1.0, 2.0));
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
        assert!(suspicious(&fits, 1.0).is_empty());
        fits[60..75].fill(fit(0.05));
        fits[150] = None;
        assert_eq!(suspicious(&fits, 1.0), (60..75).collect::<Vec<_>>());
        // Scatter of σ 0.22 that is a millionth of the brightest radiance is none.
        assert!(suspicious(&fits, 2.2e5).is_empty());
    }
}
