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

/// Count, sum and sum of squares of some finite values. In f64 the squares of f32 values lose nothing
/// that matters: the variance of a window is right to 1e-12 of its mean square.
#[derive(Clone, Copy, Default)]
struct Sums([f64; 3]);

impl Sums {
    fn add(&mut self, other: Self) {
        self.0.iter_mut().zip(other.0).for_each(|(a, b)| *a += b);
    }
}

/// Expected value of each pixel of a plane (`width` pixels a row), where `noise(i, mean)` is the
/// variance of pixel i's noise if its expected value is `mean`. NaN pixels are left out, and stay.
pub(super) fn expected(plane: &[f32], width: usize, noise: impl Fn(usize, f64) -> f64) -> Vec<f32> {
    let width = width.max(1);
    let height = plane.len() / width;
    let mut out = vec![f32::NAN; plane.len()];
    let mut columns = vec![Sums::default(); width];
    for (y, out_row) in out.chunks_exact_mut(width).enumerate() {
        let rows = y.saturating_sub(REACH[1])..(y + REACH[1] + 1).min(height);
        columns.fill(Sums::default());
        for row in rows.filter_map(|r| plane.get(r * width..(r + 1) * width)) {
            for (column, &v) in columns.iter_mut().zip(row) {
                if v.is_finite() {
                    let v = f64::from(v);
                    column.add(Sums([1.0, v, v * v]));
                }
            }
        }
        let row = plane.get(y * width..(y + 1) * width).unwrap_or(&[]);
        for (x, (out, &own)) in out_row.iter_mut().zip(row).enumerate() {
            if !own.is_finite() {
                continue;
            }
            let window = x.saturating_sub(REACH[0])..(x + REACH[0] + 1).min(width);
            let mut sums = Sums::default();
            for column in columns.get(window).unwrap_or(&[]) {
                sums.add(*column);
            }
            let [n, sum, squares] = sums.0;
            let mean = sum / n;
            let scatter = (squares - sum * mean) / (n - 1.0).max(1.0);
            let keep = if n < 2.0 {
                1.0
            } else {
                (1.0 - NOISE_ONLY * noise(y * width + x, mean) / scatter).max(0.0)
            };
            *out = (mean + keep * (f64::from(own) - mean)) as f32;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};

    use super::*;

    #[test]
    fn noise_is_averaged_and_structure_is_kept() {
        let (width, height) = (200, 40);
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let normal = Normal::new(0.0_f32, 1.0).unwrap();
        let truth = |x: usize| if x < 100 { 10.0 } else { 60.0_f32 };
        let plane: Vec<f32> = (0..width * height)
            .map(|i| truth(i % width) + normal.sample(&mut random))
            .collect();
        let smooth = expected(&plane, width, |_, _| 1.0);
        let rms = |columns: std::ops::Range<usize>| {
            let errors = smooth
                .iter()
                .enumerate()
                .filter(|(i, _)| columns.contains(&(i % width)))
                .map(|(i, v)| f64::from(v - truth(i % width)).powi(2));
            (errors.clone().sum::<f64>() / errors.count() as f64).sqrt()
        };
        // The mean of 15 has a σ of 0.26 (of 10 in the first and last row); one window in a hundred
        // keeps part of its noise. Next to the step the pixels stay themselves, with their σ of 1.
        assert!(rms(10..90) < 0.35, "{}", rms(10..90));
        assert!(rms(98..102) < 1.2, "{}", rms(98..102));
    }

    #[test]
    fn missing_pixels_stay_missing_and_take_no_part() {
        let mut plane = vec![4.0_f32; 30];
        plane[7] = f32::NAN;
        let smooth = expected(&plane, 10, |_, _| 1.0);
        assert!(smooth[7].is_nan());
        assert!(smooth.iter().enumerate().all(|(i, v)| i == 7 || *v == 4.0));
    }
}
