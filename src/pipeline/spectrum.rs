//! Magnitudes of the measured light field's Fourier coefficients, for the report.

use num_complex::Complex64;
use rayon::prelude::*;

use super::run::Spectrum;
use crate::fourier::CircleTransform;
use crate::light_field::Samples;

/// Frequencies of the light field's spectrum that are shown.
const SPECTRUM_ORDER: usize = 60;

/// |B_p(θo′)| by columns: the weighted means of b e^{−ipα} over even bins of α, which for even views is the DFT.
pub fn spectrum(samples: &Samples) -> Vec<Spectrum> {
    (0..samples.channels.len())
        .into_par_iter()
        .map(|c| {
            let order = samples
                .columns
                .iter()
                .map(|column| column.alpha.len() / 2)
                .max()
                .unwrap_or(0)
                .min(SPECTRUM_ORDER);
            let (mut power, mut noise) = (vec![0.0; order + 1], vec![0.0; order + 1]);
            let locals = samples.columns.len();
            let mut rows = vec![vec![0.0; locals]; order + 1];
            let mut parts = vec![vec![Complex64::ZERO; locals]; order + 1];
            let mut used = 0usize;
            for (j, column) in samples.columns.iter().enumerate() {
                let seen: Vec<usize> = (0..column.alpha.len())
                    .filter(|&i| column.variance[c][i].is_finite())
                    .collect();
                // A column that few views see has no spectrum of its own.
                if seen.len() < 2 * order.max(1) * 9 / 10 {
                    continue;
                }
                used += 1;
                let n = seen.len() as f64;
                let mean_variance = seen.iter().map(|&i| column.variance[c][i]).sum::<f64>() / n;
                for p in 0..=order {
                    let mut sum = Complex64::ZERO;
                    for &i in &seen {
                        sum += column.value[c][i] * Complex64::cis(-(p as f64) * column.alpha[i]);
                    }
                    let value = sum / n;
                    power[p] += value.norm_sqr();
                    noise[p] += mean_variance / n;
                    rows[p][j] = value.norm();
                    parts[p][j] = value;
                }
            }
            let rms = |sum: f64| (sum / used.max(1) as f64).sqrt();
            Spectrum {
                channel: samples.channels[c].clone(),
                magnitude: power.into_iter().map(rms).collect(),
                noise_floor: noise.into_iter().map(rms).collect(),
                image: local_spectrum(&parts, order),
            }
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
