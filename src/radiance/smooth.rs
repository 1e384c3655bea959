//! The expected value of a noisy picture: local mean where the scatter is no more than noise, the
//! pixel itself where there is structure.
//!
//! J.-S. Lee, "Digital image enhancement and noise filtering by use of local statistics", IEEE
//! PAMI 2 (1980). Noise models and weights want the expected signal: taken from the pixel's own
//! noisy value they would favour values that happen to be low, and bias every mean.

/// Half the window's width and height, pixels. Rows of a strip across a cylinder are alike.
const REACH: [usize; 2] = [2, 1];

/// The scatter within the window, in units of the noise, below which it counts as noise: the
/// variance of 15 samples stays below twice its expectation in 99 % of windows.
const NOISE_ONLY: f64 = 2.0;

/// Expected value of each pixel of a plane (`width` pixels a row), where `noise(i, mean)` is the
/// variance of pixel i's noise if its expected value is `mean`. NaN pixels are left out, and stay.
pub(super) fn expected(plane: &[f32], width: usize, noise: impl Fn(usize, f64) -> f64) -> Vec<f32> {
    let width = width.max(1);
    let height = plane.len() / width;
    let mut out = vec![f32::NAN; plane.len()];
    for y in 0..height {
        let rows = y.saturating_sub(REACH[1])..(y + REACH[1] + 1).min(height);
        for x in 0..width {
            let i = y * width + x;
            let Some(&own) = plane.get(i).filter(|v| v.is_finite()) else {
                continue;
            };
            let columns = x.saturating_sub(REACH[0])..(x + REACH[0] + 1).min(width);
            // Differences to the pixel itself keep the sums free of cancellation.
            let (mut n, mut sum, mut squares) = (0.0_f32, 0.0_f32, 0.0_f32);
            for row in rows.clone() {
                for &v in plane
                    .get(row * width + columns.start..row * width + columns.end)
                    .unwrap_or(&[])
                {
                    if v.is_finite() {
                        let d = v - own;
                        n += 1.0;
                        sum += d;
                        squares += d * d;
                    }
                }
            }
            let mean = f64::from(own + sum / n);
            let scatter = f64::from(squares - sum * sum / n) / f64::from((n - 1.0).max(1.0));
            let keep = if n < 2.0 {
                1.0
            } else {
                (1.0 - NOISE_ONLY * noise(i, mean) / scatter).max(0.0)
            };
            let keep = if keep.is_finite() { keep } else { 0.0 };
            if let Some(out) = out.get_mut(i) {
                *out = (mean + keep * (f64::from(own) - mean)) as f32;
            }
        }
    }
    out
}
