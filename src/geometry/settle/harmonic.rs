//! Numbers of the views, drawn towards the form that a displacement or a lean gives them over the orbit.

use nalgebra::{DVector, SMatrix, SVector};

use super::OUTLIER;

/// Draws one number per view (value, σ), each at an `orbit` angle (sine, cosine), towards a + b sin φ + c cos φ; `prior` is the σ of each
/// term about 0. Also a, b, c, and the larger σ of b and c.
pub(super) fn harmonic(
    orbit: &[(f64, f64)],
    values: impl Iterator<Item = (f64, f64)>,
    prior: f64,
) -> (Vec<(f64, f64)>, [f64; 3], f64) {
    let values: Vec<_> = values.collect();
    let rows: Vec<SVector<f64, 3>> = orbit
        .iter()
        .map(|(sin, cos)| SVector::<f64, 3>::new(1.0, *sin, *cos))
        .collect();
    let usable = |(v, s): &(f64, f64)| v.is_finite() && s.is_finite() && *s > 0.0;
    let mut fitted = SVector::<f64, 3>::zeros();
    let mut covariance = SMatrix::<f64, 3, 3>::zeros();
    let mut spread = 0.0;
    for iteration in 0..20 {
        let mut normal = SMatrix::<f64, 3, 3>::identity() / (prior * prior);
        let mut right = SVector::<f64, 3>::zeros();
        for (row, (value, sigma)) in rows.iter().zip(&values).filter(|(_, v)| usable(v)) {
            let variance = sigma * sigma + spread;
            let miss = value - row.dot(&fitted);
            // By their own σ alone at first: far from the truth the right ones would count least.
            let weight = match iteration {
                0 => 1.0 / variance,
                _ => 1.0 / (variance + miss * miss / 4.0),
            };
            normal.ger(weight, row, row, 1.0);
            right += row * (weight * value);
        }
        let Some(inverse) = normal.try_inverse() else {
            break;
        };
        covariance = inverse;
        fitted = inverse * right;
        spread = spread_beyond(
            rows.iter()
                .zip(&values)
                .filter(|(_, v)| usable(v))
                .map(|(row, (value, sigma))| (value - row.dot(&fitted), sigma * sigma)),
        );
    }
    let drawn = rows
        .iter()
        .zip(&values)
        .map(|(row, measured)| {
            let common = row.dot(&fitted);
            let model = (row.transpose() * covariance * row)[0];
            let miss = measured.0 - common;
            let variance = measured.1 * measured.1;
            let near = miss * miss <= OUTLIER * OUTLIER * (variance + spread + model);
            if usable(measured) && near {
                let gain = spread / (spread + variance);
                (common + gain * miss, (gain * variance + model).sqrt())
            } else {
                (common, (spread + model).sqrt())
            }
        })
        .collect();
    let sigma = covariance[(1, 1)].max(covariance[(2, 2)]).max(0.0).sqrt();
    (drawn, fitted.into(), sigma)
}

/// Variance of residuals beyond that of their measurement, robustly: from the median deviation. Zero unless
/// it shows by two standard errors, 2 · 1.65 / √n of the variance for a variance from n median deviations.
pub(super) fn spread_beyond(misses: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (deviations, variances): (Vec<f64>, Vec<f64>) = misses
        .map(|(miss, variance)| (miss.abs(), variance))
        .unzip();
    let count = deviations.len() as f64;
    let (Some(deviation), Some(variance)) = (median(deviations), median(variances)) else {
        return 0.0;
    };
    let total = (1.4826 * deviation).powi(2);
    if total > variance * (1.0 + 3.3 / count.sqrt()) {
        total - variance
    } else {
        0.0
    }
}

fn median(values: Vec<f64>) -> Option<f64> {
    let mut sorted = DVector::from_vec(values);
    let n = sorted.len();
    (n > 0).then(|| {
        sorted.as_mut_slice().sort_by(f64::total_cmp);
        sorted[n / 2]
    })
}
