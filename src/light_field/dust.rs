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

/// The least degrees of freedom with which rows can be told to be off.
pub(super) const LEAST_FREEDOM: u32 = 4;

/// Part of the rows that is taken to be sound, and steps of trimming.
const SOUND: f64 = 0.6;
const STEPS: usize = 6;

/// A row is off by this many standard deviations of the sound ones.
const OFF: f64 = 5.0;

/// The variance of normal values over that of the 60 % with the smallest residuals.
const TRIMMED: f64 = 4.85;

/// One row of a station: its distance from the line, value and variance.
pub(super) type Row = (f64, f64, f64);

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

/// The sums over the rows that agree, if any do not.
pub(super) fn without(rows: &[Row]) -> Option<Sums> {
    let sound = ((rows.len() as f64 * SOUND) as usize).max(5);
    if rows.len() <= sound {
        return None;
    }
    let nth = |values: &mut Vec<f64>, n: usize| *values.select_nth_unstable_by(n, f64::total_cmp).1;
    let mut scratch: Vec<f64> = rows.iter().map(|row| row.1).collect();
    let median = nth(&mut scratch, rows.len() / 2);
    let mut distance: Vec<f64> = rows.iter().map(|r| (r.1 - median).abs()).collect();
    let mut scale = 0.0;
    let mut trusted = vec![false; rows.len()];
    for _ in 0..STEPS {
        scratch.clone_from(&distance);
        let limit = nth(&mut scratch, sound - 1);
        // Among equally distant rows the first ones, so that there are `sound` of them.
        let mut ties = sound - distance.iter().filter(|d| **d < limit).count();
        let mut same = true;
        for (trusted, d) in trusted.iter_mut().zip(&distance) {
            let tied = *d == limit && ties > 0;
            ties -= usize::from(tied);
            let now = *d < limit || tied;
            same &= *trusted == now;
            *trusted = now;
        }
        if same {
            break;
        }
        let sums = sum(rows, |i| trusted[i]);
        let curve = sums.curve()?;
        let trimmed = sums.fit()?;
        let stated = sums.variance / f64::from(sums.count);
        scale = (TRIMMED * trimmed.residual / f64::from(trimmed.freedom.max(1))).max(stated);
        for (distance, (t, value, _)) in distance.iter_mut().zip(rows) {
            let k = super::strip::PIXEL_VARIANCE;
            *distance = (*value - curve[0] - curve[1] * t - curve[2] * (t * t + k)).abs();
        }
    }
    let limit = OFF * scale.sqrt();
    let kept = sum(rows, |i| distance[i] <= limit);
    (kept.count as usize >= sound && (kept.count as usize) < rows.len()).then_some(kept)
}

fn sum(rows: &[Row], of: impl Fn(usize) -> bool) -> Sums {
    let mut sums = Sums::default();
    for (i, (t, value, variance)) in rows.iter().enumerate() {
        if of(i) {
            sums.add(*t, *value, *variance);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of one station with the noise of a fixed sequence.
    fn rows(off: impl Fn(usize) -> f64) -> Vec<Row> {
        (0..48)
            .map(|i| {
                let t = i as f64 - 23.5;
                let noise = ((i * 7919 % 101) as f64 / 101.0 - 0.5) * 0.02;
                (t, 1.0 - 1e-4 * t * t + noise + off(i), 3.3e-5)
            })
            .collect()
    }

    #[test]
    fn dust_is_left_out_and_nothing_else() {
        // A spot over a quarter of the rows and a thin scratch, light and dark.
        let dusty = rows(|i| match i {
            20..32 => 0.4,
            40 => -0.3,
            _ => 0.0,
        });
        let kept = without(&dusty).expect("rows are off");
        assert_eq!(kept.count, 48 - 13);
        let value = kept.fit().unwrap().value;
        // 35 rows of σ 0.006, half of them far from the line: known to 0.004.
        assert!((value - 1.0).abs() < 0.01, "{value}");
        assert!(without(&rows(|_| 0.0)).is_none());
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
