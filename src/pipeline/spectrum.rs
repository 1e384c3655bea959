//! Magnitudes of the measured light field's Fourier coefficients, for the report.

use num_complex::Complex64;
use rayon::prelude::*;

use super::run::Spectrum;
use crate::fourier::{CircleTransform, irregular};
use crate::light_field::{Column, Samples};

/// Frequencies of the light field's spectrum that are shown.
const SPECTRUM_ORDER: usize = 60;

/// |B_p(θo′)| by columns: the weighted means of b e^{−ipα} over even bins of α, which for even views is the DFT.
pub fn spectrum(samples: &Samples) -> Vec<Spectrum> {
    let longest = samples.columns.iter().map(|c| c.alpha.len()).max();
    let order = (longest.unwrap_or(0) / 2).min(SPECTRUM_ORDER);
    let columns: Vec<Vec<Option<ColumnSpectrum>>> = samples
        .columns
        .par_iter()
        .map(|column| of_column(column, samples.channels.len(), order))
        .collect();
    samples
        .channels
        .par_iter()
        .enumerate()
        .map(|(c, channel)| {
            let (mut power, mut noise) = (vec![0.0; order + 1], 0.0);
            let locals = samples.columns.len();
            let mut parts = vec![vec![Complex64::ZERO; locals]; order + 1];
            let mut used = 0usize;
            for (j, column) in columns.iter().enumerate() {
                let Some(column) = column.get(c).and_then(Option::as_ref) else {
                    continue;
                };
                used += 1;
                noise += column.noise;
                for (p, value) in column.means.iter().enumerate() {
                    power[p] += value.norm_sqr();
                    parts[p][j] = *value;
                }
            }
            let rms = |sum: f64| (sum / used.max(1) as f64).sqrt();
            Spectrum {
                channel: channel.clone(),
                magnitude: power.into_iter().map(rms).collect(),
                noise_floor: vec![rms(noise); order + 1],
                image: local_spectrum(&parts, order),
            }
        })
        .collect()
}

/// One column in one channel.
struct ColumnSpectrum {
    /// Mean of b e^{−ipα}, \[p\].
    means: Vec<Complex64>,
    /// Its variance.
    noise: f64,
}

/// By channel; `None` for a column that few views see, which has no spectrum of its own.
fn of_column(column: &Column, channels: usize, order: usize) -> Vec<Option<ColumnSpectrum>> {
    let seen: Vec<(Vec<f64>, f64, usize)> = (0..channels)
        .map(|c| {
            let (mut variance, mut count) = (0.0, 0);
            let both = column.value[c].iter().zip(&column.variance[c]);
            let values = both.map(|(value, v)| {
                if v.is_finite() {
                    variance += v;
                    count += 1;
                    *value
                } else {
                    0.0
                }
            });
            (values.collect(), variance, count)
        })
        .collect();
    let values: Vec<&[f64]> = seen.iter().map(|(values, ..)| values.as_slice()).collect();
    let sums = irregular::sums(&irregular::turns(&column.alpha), &values, order);
    sums.into_iter()
        .zip(&seen)
        .map(|(sums, &(_, variance, count))| {
            let n = count as f64;
            (count >= 2 * order.max(1) * 9 / 10).then(|| ColumnSpectrum {
                means: sums.into_iter().map(|sum| sum / n).collect(),
                noise: variance / (n * n),
            })
        })
        .collect()
}

/// |B_{p,q}| for |q| ≤ order from B_p(θo′) on regular columns over (−π/2, π/2), zero outside (eq. 6).
fn local_spectrum(parts: &[Vec<Complex64>], order: usize) -> Vec<Vec<f64>> {
    let locals = parts.first().map_or(0, Vec::len);
    if locals == 0 {
        return Vec::new();
    }
    // The half circle padded to the full one: columns start at −π/2 + half a step.
    let n = 2 * locals;
    let step = std::f64::consts::PI / locals as f64;
    let transform = CircleTransform::new(n, -std::f64::consts::FRAC_PI_2 + 0.5 * step);
    parts
        .iter()
        .map(|row| {
            let pad = |f: &dyn Fn(&Complex64) -> f64| -> Vec<f64> {
                let mut values: Vec<f64> = row.iter().map(f).collect();
                values.resize(n, 0.0);
                values
            };
            let re = transform.analyse(&pad(&|v| v.re), order);
            let im = transform.analyse(&pad(&|v| v.im), order);
            (-(order as i64)..=order as i64)
                .map(|q| (re.get(q) + Complex64::I * im.get(q)).norm())
                .collect()
        })
        .collect()
}
