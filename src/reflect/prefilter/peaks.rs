//! Peaks of a table of light: what stands far above its surroundings, taken out and evaluated directly.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::angle::{LocalAngle, NormalAngle, wrap};
use crate::brdf::Brdf;
use crate::lighting::Lighting;

/// A lighting taken apart.
#[derive(Clone, Debug)]
pub struct Parted {
    /// The table with its peaks levelled, and the band-limited part; without the sources.
    pub rest: Lighting,
    /// The peaks, interval by interval of the table.
    pub stretches: Vec<Stretch>,
    /// Number of separate peaks.
    pub peaks: usize,
    /// The peaks' fraction of the total irradiance, all channels together.
    pub share: f64,
}

/// Light between two neighbouring angles of a table, linear from one to the other.
#[derive(Clone, Debug)]
pub struct Stretch {
    /// θ at which it begins, radians.
    from: f64,
    /// Its length, radians.
    length: f64,
    /// L at its two ends above the surroundings, W m⁻² rad⁻¹, \[channel\].
    ends: Vec<[f64; 2]>,
    /// Equal pieces in which a BRDF's lobe is resolved ([`Parted::resolve`]).
    pieces: usize,
}

/// Nodes and weights of the three-point Gauss rule on [0, 1].
const THREE: [(f64, f64); 3] = [
    (0.112_701_665_379_258_31, 5.0 / 18.0),
    (0.5, 8.0 / 18.0),
    (0.887_298_334_620_741_7, 5.0 / 18.0),
];

impl Stretch {
    /// Number of evaluations of the BRDF.
    pub fn nodes(&self) -> usize {
        THREE.len() * self.pieces
    }

    /// ∫ L ρ̂ dθi′ over the visible part of the stretch, W m⁻² sr⁻¹; `kinks` are the BRDF's at this exitant angle.
    pub fn reflected(
        &self,
        channel: usize,
        brdf: &dyn Brdf,
        normal: NormalAngle,
        local: LocalAngle,
        kinks: &[f64],
    ) -> f64 {
        let Some([first, last]) = self.ends.get(channel) else {
            return 0.0;
        };
        let begin = wrap(self.from - normal.rad());
        let visible = [begin.max(-FRAC_PI_2), (begin + self.length).min(FRAC_PI_2)];
        let [low, high] = visible;
        let between = kinks.iter().copied().filter(|k| (low..high).contains(k));
        let mut ends: Vec<f64> = between.collect();
        let light = |a: f64| first + (last - first) * (a - begin) / self.length;
        let over = |part| integral(brdf, local, part, light, self.pieces);
        if ends.is_empty() {
            return over(visible);
        }
        ends.extend(visible);
        ends.sort_by(f64::total_cmp);
        ends.windows(2).map(|part| over([part[0], part[1]])).sum()
    }

    /// The largest value that it holds in a channel.
    fn brightest(&self, channel: usize) -> f64 {
        let ends = self.ends.get(channel).copied().unwrap_or_default();
        ends[0].abs().max(ends[1].abs())
    }

    fn irradiance(&self) -> f64 {
        let ends = self.ends.iter();
        ends.map(|[a, b]| (a + b) / 2.0 * self.length).sum()
    }
}

/// ∫ ρ̂ times `light` between two local angles above the horizon, in so many pieces.
fn integral(
    brdf: &dyn Brdf,
    local: LocalAngle,
    [low, high]: [f64; 2],
    light: impl Fn(f64) -> f64,
    pieces: usize,
) -> f64 {
    if low >= high {
        return 0.0;
    }
    // Near the horizon nodes are even in the root of the distance from it, in which roots and masking are smooth.
    let horizon = match () {
        () if high > FRAC_PI_2 - NEAR => FRAC_PI_2,
        () if low < NEAR - FRAC_PI_2 => -FRAC_PI_2,
        () => 0.0,
    };
    let root = |a: f64| (horizon - a).abs().sqrt();
    let (from, to) = match horizon {
        0.0 => (low, high),
        _ => (root(low), root(high)),
    };
    let piece = (to - from) / pieces as f64;
    let mut sum = 0.0;
    for k in 0..pieces {
        for (x, w) in THREE {
            let at = from + (k as f64 + x) * piece;
            let (incident, slope) = match horizon {
                0.0 => (at, 1.0),
                _ => (horizon - horizon.signum() * at * at, 2.0 * at),
            };
            let rho = brdf.value(LocalAngle::radians(incident), local);
            sum += w * piece.abs() * slope * light(incident) * rho * incident.cos();
        }
    }
    sum
}

impl Parted {
    /// Cuts the stretches into as many pieces as keep the error of their integrals below `allowed` (W m⁻² sr⁻¹) in a channel
    /// at these exitant angles; returns a bound of the error that is left.
    pub fn resolve(
        &mut self,
        channel: usize,
        brdf: &dyn Brdf,
        locals: impl Iterator<Item = LocalAngle>,
        allowed: f64,
    ) -> f64 {
        let Some(length) = self.stretches.first().map(|s| s.length) else {
            return 0.0;
        };
        let light: f64 = self.stretches.iter().map(|s| s.brightest(channel)).sum();
        // Where the lobe is, and what is about it and at the horizon.
        let begins: Vec<(LocalAngle, f64)> = locals
            .flat_map(|local| {
                let about = (-12..=12).map(move |k| {
                    -local.rad() - length + 0.17 * f64::from(k) * brdf.lobe_width().min(0.5)
                });
                let ends = [
                    -FRAC_PI_2 - 0.6 * length,
                    FRAC_PI_2 - 0.4 * length,
                    FRAC_PI_2 - length,
                ];
                about.chain(ends).map(move |begin| (local, begin))
            })
            .collect();
        let error = |pieces: usize| {
            let errors = begins.iter().map(|&(local, begin)| {
                let part = [begin.max(-FRAC_PI_2), (begin + length).min(FRAC_PI_2)];
                let with = |pieces| integral(brdf, local, part, |_| 1.0, pieces);
                (with(pieces) - with(2 * pieces)).abs()
            });
            // Doubling leaves 1/64 of the error, but that swings with the place of the lobe: a factor of safety of 4.
            4.0 * light * errors.fold(0.0, f64::max)
        };
        let mut pieces = self.stretches.first().map_or(1, |s| s.pieces);
        let mut bound = error(pieces);
        while bound > allowed && pieces < MOST_PIECES {
            pieces *= 2;
            bound = error(pieces);
        }
        for stretch in &mut self.stretches {
            stretch.pieces = pieces;
        }
        bound
    }
}

/// Distance from the horizon that counts as near, radians.
const NEAR: f64 = 0.1;
/// Most pieces of a stretch.
const MOST_PIECES: usize = 1024;

/// Half width of the surroundings that a value is compared with, radians (5°).
const SURROUNDINGS: f64 = 0.087;

/// Takes out what stands more than `level` times the table's mean above its surroundings, `None` to
/// leave the table as it is.
pub fn part(lighting: &Lighting, level: Option<f64>) -> Parted {
    let mut rest = Lighting {
        sources: Vec::new(),
        ..lighting.clone()
    };
    let n = lighting.table.first().map_or(0, Vec::len);
    let uneven = lighting.table.iter().any(|t| t.len() != n);
    let (Some(level), true) = (level, n >= 8 && !uneven) else {
        return Parted {
            rest,
            stretches: Vec::new(),
            peaks: 0,
            share: 0.0,
        };
    };
    let total: Vec<f64> = (0..n)
        .map(|i| lighting.table.iter().map(|t| t[i]).sum())
        .collect();
    let mean = total.iter().sum::<f64>() / n as f64;
    let base = running_median(&total);
    let raised: Vec<bool> = (0..n)
        .map(|i| total[i] - base[i] > level * mean.abs())
        .collect();
    // The flanks of a peak belong to it as long as they stand out at all.
    let high: Vec<bool> = (0..n)
        .map(|i| {
            let near = [i + n - 2, i + n - 1, i, i + 1, i + 2];
            near.iter().any(|k| raised[k % n]) && total[i] > base[i]
        })
        .collect();
    let mut excess = vec![vec![0.0; n]; lighting.channels.len()];
    for (c, table) in lighting.table.iter().enumerate() {
        let background = running_median(table);
        for i in (0..n).filter(|&i| high[i]) {
            excess[c][i] = table[i] - background[i];
            rest.table[c][i] = background[i];
        }
    }
    let step = TAU / n as f64;
    let stretches: Vec<Stretch> = (0..n)
        .filter(|&i| high[i] || high[(i + 1) % n])
        .map(|i| Stretch {
            from: -PI + i as f64 * step,
            length: step,
            ends: excess.iter().map(|e| [e[i], e[(i + 1) % n]]).collect(),
            pieces: 1,
        })
        .collect();
    let all: f64 = (0..lighting.channels.len())
        .map(|c| lighting.total_irradiance(c))
        .sum();
    Parted {
        rest,
        peaks: (0..n)
            .filter(|&i| high[i] && !high[(i + n - 1) % n])
            .count(),
        share: stretches.iter().map(Stretch::irradiance).sum::<f64>() / all,
        stretches,
    }
}

/// The median of the values within 5° of each value of a circular table.
fn running_median(table: &[f64]) -> Vec<f64> {
    let n = table.len();
    let half = ((SURROUNDINGS / TAU * n as f64) as usize).clamp(3, (n - 1) / 2);
    (0..n)
        .map(|i| {
            let mut near: Vec<f64> = (0..=2 * half)
                .map(|k| table[(i + n + k - half) % n])
                .collect();
            let middle = near.len() / 2;
            *near.select_nth_unstable_by(middle, f64::total_cmp).1
        })
        .collect()
}
