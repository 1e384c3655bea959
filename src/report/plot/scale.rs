//! From values to positions along an axis, and the ticks that a reader can interpolate between.

use crate::report::number::{fixed, power_of_ten, trimmed};

/// How values are spread along an axis or a colour bar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spacing {
    /// Equal steps are equally long.
    Linear,
    /// As the square root: shot noise is equally wide everywhere, and shadows can be seen.
    SquareRoot,
    /// Equal ratios are equally long.
    Log,
}

impl Spacing {
    /// Its name for the script.
    pub fn word(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::SquareRoot => "root",
            Self::Log => "log",
        }
    }
}

/// An axis range and its spacing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
    spacing: Spacing,
}

/// A labelled mark on an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// Where, 0 at the axis' low end and 1 at its high end.
    pub at: f64,
    /// What is written there; empty for a minor mark.
    pub label: String,
}

impl Scale {
    /// A linear axis. Ends that are equal or not finite are moved apart.
    pub fn linear(low: f64, high: f64) -> Self {
        let low = if low.is_finite() { low } else { 0.0 };
        let high = if high.is_finite() { high } else { low + 1.0 };
        let high = if high > low {
            high
        } else {
            low + low.abs().max(1.0) * 1e-3
        };
        Self {
            low,
            high,
            spacing: Spacing::Linear,
        }
    }

    /// A square-root axis from `low`.
    pub fn square_root(low: f64, high: f64) -> Self {
        Self {
            spacing: Spacing::SquareRoot,
            ..Self::linear(low, high)
        }
    }

    /// A logarithmic axis; ends that are not positive are replaced.
    pub fn log(low: f64, high: f64) -> Self {
        let high = if high.is_finite() && high > 0.0 {
            high
        } else {
            1.0
        };
        let low = if low.is_finite() && low > 0.0 && low < high {
            low
        } else {
            high * 1e-3
        };
        Self {
            low,
            high,
            spacing: Spacing::Log,
        }
    }

    /// A linear axis that holds all `values` with a margin of 4 % of their range.
    pub fn around(values: impl IntoIterator<Item = f64>) -> Self {
        let (low, high) = bounds(values);
        let margin = 0.04 * (high - low);
        Self::linear(low - margin, high + margin)
    }

    /// A logarithmic axis that holds the positive `values`, over at most `decades` below the largest.
    pub fn log_around(values: impl IntoIterator<Item = f64>, decades: f64) -> Self {
        let (low, high) = bounds(values.into_iter().filter(|v| *v > 0.0));
        Self::log((low * 0.7).max(high * 10f64.powf(-decades)), high * 1.5)
    }

    /// The low end.
    pub fn low(&self) -> f64 {
        self.low
    }

    /// The high end.
    pub fn high(&self) -> f64 {
        self.high
    }

    /// How values are spread.
    pub fn spacing(&self) -> Spacing {
        self.spacing
    }

    /// Where `value` lies: 0 at the low end, 1 at the high end, beyond them outside.
    pub fn position(&self, value: f64) -> f64 {
        let linear = (value - self.low) / (self.high - self.low);
        match self.spacing {
            Spacing::Linear => linear,
            Spacing::SquareRoot => linear.abs().sqrt() * linear.signum(),
            Spacing::Log if value > 0.0 => (value / self.low).ln() / (self.high / self.low).ln(),
            Spacing::Log => f64::NEG_INFINITY,
        }
    }

    /// Some `count` ticks at round values.
    pub fn ticks(&self, count: usize) -> Vec<Tick> {
        match self.spacing {
            Spacing::Linear => self.linear_ticks(count),
            Spacing::SquareRoot => self.square_root_ticks(count),
            Spacing::Log => self.log_ticks(count),
        }
    }

    /// Ticks every `step` (in the axis' unit), for angles.
    pub fn ticks_every(&self, step: f64) -> Vec<Tick> {
        let decimals = decimals_of(step);
        let first = (self.low / step - 1e-9).ceil() as i64;
        let last = (self.high / step + 1e-9).floor() as i64;
        (first..=last.min(first.saturating_add(100)))
            .map(|k| {
                let value = k as f64 * step;
                Tick {
                    at: self.position(value),
                    label: fixed(value, decimals),
                }
            })
            .filter(|tick| (-1e-6..=1.0 + 1e-6).contains(&tick.at))
            .collect()
    }

    /// Some `count` ticks at whole numbers, for frequencies.
    pub fn whole_ticks(&self, count: usize) -> Vec<Tick> {
        let step = round_step((self.high - self.low) / count.max(1) as f64);
        self.ticks_every(if step == 2.5 {
            5.0
        } else {
            step.max(1.0).round()
        })
    }

    fn linear_ticks(&self, count: usize) -> Vec<Tick> {
        let raw = (self.high - self.low) / count.max(1) as f64;
        let step = round_step(raw);
        let largest = self.low.abs().max(self.high.abs());
        if (1e-3..1e5).contains(&largest) {
            return self.ticks_every(step);
        }
        let mut ticks = self.ticks_every(step);
        for tick in &mut ticks {
            let value = self.low + tick.at * (self.high - self.low);
            // As many digits as tell neighbours apart.
            let digits = (largest / step).log10().ceil().clamp(2.0, 12.0) as usize + 1;
            tick.label = trimmed((value / step).round() * step, digits).replace(" × ", "·");
        }
        ticks
    }

    fn square_root_ticks(&self, count: usize) -> Vec<Tick> {
        let mut chosen = vec![(self.position(self.low.max(0.0)), self.low.max(0.0))];
        let gap = 0.7 / count.max(1) as f64;
        let top = (self.high - self.low).max(self.high).log10().floor() as i32;
        let mut candidates: Vec<f64> = (top - 3..=top)
            .flat_map(|e| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(e)))
            .filter(|v| *v > self.low && *v <= self.high)
            .collect();
        candidates.reverse();
        for value in candidates {
            let at = self.position(value);
            if chosen.iter().all(|(other, _)| (at - other).abs() >= gap) {
                chosen.push((at, value));
            }
        }
        chosen.sort_by(|a, b| a.0.total_cmp(&b.0));
        chosen
            .into_iter()
            .map(|(at, value)| Tick {
                at,
                label: tick_label(value),
            })
            .collect()
    }

    fn log_ticks(&self, count: usize) -> Vec<Tick> {
        let first = (self.low.log10() - 1e-9).ceil() as i32;
        let last = (self.high.log10() + 1e-9).floor() as i32;
        let decades = last - first + 1;
        let every = (decades as usize).div_ceil(count.max(1)).max(1) as i32;
        // One notation along the axis.
        let plain = first >= -2 - i32::from(decades <= 1) && last <= 3;
        let mut ticks = Vec::new();
        for exponent in first - 1..=last {
            for mantissa in 1..10 {
                let value = f64::from(mantissa) * 10f64.powi(exponent);
                let at = self.position(value);
                if !(-1e-9..=1.0 + 1e-9).contains(&at) {
                    continue;
                }
                let label = if mantissa == 1 && (exponent - first).rem_euclid(every) == 0 {
                    if plain {
                        tick_label(value)
                    } else {
                        power_of_ten(exponent)
                    }
                } else if decades <= 1 && matches!(mantissa, 2 | 5) {
                    tick_label(value)
                } else if mantissa == 1 || decades <= 4 {
                    String::new()
                } else {
                    continue;
                };
                ticks.push(Tick { at, label });
            }
        }
        ticks
    }
}

/// Smallest and largest finite value; (0, 1) if there is none.
pub fn bounds(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(v), high.max(v))
        });
    if low <= high { (low, high) } else { (0.0, 1.0) }
}

/// The value below which the share `q` of the finite values lies; 0 if there is none.
pub fn quantile(values: impl IntoIterator<Item = f64>, q: f64) -> f64 {
    let mut finite: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    if finite.is_empty() {
        return 0.0;
    }
    let at = ((finite.len() - 1) as f64 * q.clamp(0.0, 1.0)).round() as usize;
    *finite.select_nth_unstable_by(at, f64::total_cmp).1
}

fn tick_label(value: f64) -> String {
    trimmed(value, 3).replace(" × ", "·")
}

fn round_step(raw: f64) -> f64 {
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .find(|m| m * power >= raw * (1.0 - 1e-9))
        .unwrap_or(10.0)
        * power;
    // Far from zero a step can drown in the rounding of the ends.
    if step > 0.0 && step.is_finite() {
        step
    } else {
        1.0
    }
}

fn decimals_of(step: f64) -> usize {
    (0..12)
        .find(|&d| {
            let scaled = step * 10f64.powi(d);
            (scaled - scaled.round()).abs() < 1e-6 * scaled
        })
        .unwrap_or(12) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: &[Tick]) -> Vec<&str> {
        ticks
            .iter()
            .map(|t| t.label.as_str())
            .filter(|l| !l.is_empty())
            .collect()
    }

    #[test]
    fn ticks_are_round_and_inside_the_axis() {
        let scale = Scale::linear(-0.03, 1.31);
        assert_eq!(
            labels(&scale.ticks(6)),
            ["0.00", "0.25", "0.50", "0.75", "1.00", "1.25"]
        );
        let angles = Scale::linear(-180.0, 180.0).ticks_every(90.0);
        assert_eq!(labels(&angles), ["−180", "−90", "0", "90", "180"]);
        let log = Scale::log(3e-6, 2.0).ticks(6);
        assert_eq!(
            labels(&log),
            ["10⁻⁵", "10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "10⁰"]
        );
        let small = Scale::linear(0.0, 3e-7).ticks(3);
        assert_eq!(labels(&small), ["0", "10⁻⁷", "2·10⁻⁷", "3·10⁻⁷"]);
        for spacing in [
            Scale::linear(-1e9, 3e9),
            Scale::square_root(0.0, 0.37),
            Scale::log(0.2, 0.9),
        ] {
            let ticks = spacing.ticks(5);
            assert!(labels(&ticks).len() >= 2, "{ticks:?}");
            assert!(ticks.iter().all(|t| (-1e-6..=1.000001).contains(&t.at)));
        }
    }

    #[test]
    fn no_range_is_too_odd_for_an_axis() {
        for (low, high) in [
            (0.0, 0.0),
            (5.0, 5.0),
            (f64::NAN, f64::INFINITY),
            (3.0, -3.0),
            (1e300, 1.000_000_1e300),
            (1.0, 1.0 + 1e-15),
        ] {
            for scale in [
                Scale::linear(low, high),
                Scale::square_root(low, high),
                Scale::log(low, high),
            ] {
                assert!(scale.low < scale.high, "{scale:?}");
                assert!(scale.ticks(5).len() <= 120);
                assert!(scale.position(scale.low).abs() < 1e-9);
                assert!((scale.position(scale.high) - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn quantiles_ignore_what_is_missing() {
        let values = [f64::NAN, 1.0, 2.0, 3.0, 4.0, 5.0];
        assert_eq!(quantile(values, 0.5), 3.0);
        assert_eq!(quantile(values, 1.0), 5.0);
        assert_eq!(quantile([f64::NAN], 0.5), 0.0);
        assert_eq!(bounds([f64::NAN, 2.0, -1.0]), (-1.0, 2.0));
    }
}
