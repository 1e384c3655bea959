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
    /// Equal pieces in which a BRDF's lobe is resolved.
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

    /// ∫ L ρ̂ dθi′ over the visible part of the stretch, W m⁻² sr⁻¹.
    pub fn reflected(
        &self,
        channel: usize,
        brdf: &dyn Brdf,
        normal: NormalAngle,
        local: LocalAngle,
    ) -> f64 {
        let Some([first, last]) = self.ends.get(channel) else {
            return 0.0;
        };
        // The stretch in local angles, cut at the horizon: there ρ̂ has its kink.
        let begin = wrap(self.from - normal.rad());
        let (low, high) = (begin.max(-FRAC_PI_2), (begin + self.length).min(FRAC_PI_2));
        if low >= high {
            return 0.0;
        }
        let piece = (high - low) / self.pieces as f64;
        let mut sum = 0.0;
        for k in 0..self.pieces {
            for (x, w) in THREE {
                let incident = low + (k as f64 + x) * piece;
                let t = (incident - begin) / self.length;
                let light = first * (1.0 - t) + last * t;
                let rho = brdf.value(LocalAngle::radians(incident), local);
                sum += w * piece * light * rho * incident.cos();
            }
        }
        sum
    }

    fn irradiance(&self) -> f64 {
        let ends = self.ends.iter();
        ends.map(|[a, b]| (a + b) / 2.0 * self.length).sum()
    }
}

/// Half width of the surroundings that a value is compared with, radians (5°).
const SURROUNDINGS: f64 = 0.087;

/// Takes out what stands more than `level` times the table's mean above its surroundings, `None` to
/// leave the table as it is; `lobe` is the width of the narrowest lobe that will see it.
pub fn part(lighting: &Lighting, level: Option<f64>, lobe: f64) -> Parted {
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
    // Three nodes take a lobe over half its width to 1e-6 of it, over a quarter to 1e-8; a sun's
    // highlight may be 10⁴ times the rest.
    let pieces = (4.0 * step / lobe).ceil().clamp(1.0, 64.0) as usize;
    let stretches: Vec<Stretch> = (0..n)
        .filter(|&i| high[i] || high[(i + 1) % n])
        .map(|i| Stretch {
            from: -PI + i as f64 * step,
            length: step,
            ends: excess.iter().map(|e| [e[i], e[(i + 1) % n]]).collect(),
            pieces,
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
