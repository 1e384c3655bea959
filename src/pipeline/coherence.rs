//! What a BRDF leaves of whole views together.
//!
//! A lamp that stands elsewhere than stated, or a little light from the side, puts long stretches of a view wrong alike. Against that the mean of many
//! samples is no better than one of them: variances that are scaled to the size of the residual, but not to its length, give σ that are too
//! small, and a slice between two views that contradict each other is anything at all.

use crate::light_field::Samples;
use crate::recover::Status;
use crate::recover::brdf::Slice;

/// Variance of the residual, in units of the samples' variances, from which it is looked at: below, chance and the noise model's own error
/// make as much.
pub const MISFIT: f64 = 2.0;

/// Residuals of one channel by view, in the order of θo′, with the samples' variances.
struct Lines(Vec<Vec<Option<(f64, f64)>>>);

impl Lines {
    fn new(samples: &Samples, predicted: &[Vec<f64>], channel: usize) -> Self {
        let numbers = samples.columns.iter().flat_map(|c| &c.view);
        let views = numbers.max().map_or(0, |v| *v as usize + 1);
        let mut lines = vec![vec![None; samples.columns.len()]; views];
        for (j, (column, predicted)) in samples.columns.iter().zip(predicted).enumerate() {
            let (Some(value), Some(variance)) =
                (column.value.get(channel), column.variance.get(channel))
            else {
                continue;
            };
            for (((view, b), v), f) in column.view.iter().zip(value).zip(variance).zip(predicted) {
                let seen = v.is_finite() && *v > 0.0 && (b - f).is_finite();
                if let (true, Some(line)) = (seen, lines.get_mut(*view as usize)) {
                    line[j] = Some((b - f, *v));
                }
            }
        }
        Self(lines)
    }

    /// By how much the residual of a mean has a larger variance than if each sample erred for itself: 1 + 2 Σ of the correlations along
    /// the views, up to the first that is not positive, of the part of it that is beyond the stated noise.
    fn factor(&self) -> f64 {
        let columns = self.0.first().map_or(0, Vec::len);
        let (mut all, mut noise) = (0.0, 0.0);
        for (r, v) in self.0.iter().flatten().flatten() {
            all += r * r;
            noise += v;
        }
        if !(all > noise) {
            return 1.0;
        }
        let mut length = 1.0;
        for lag in 1..columns {
            let mut sum = 0.0;
            for line in &self.0 {
                for (a, b) in line.iter().zip(line.iter().skip(lag)) {
                    if let (Some((a, _)), Some((b, _))) = (a, b) {
                        sum += a * b;
                    }
                }
            }
            if !(sum > 0.0) {
                break;
            }
            // Noise correlates with nothing: what does is of the part beyond it.
            length += 2.0 * (sum / all).min((all - noise) / all);
        }
        length
    }
}

/// What each channel's variances of a mean are to be multiplied by, beyond the size of the residual: 1 where samples err each for itself.
pub fn factors(samples: &Samples, predicted: &[Vec<Vec<f64>>]) -> Vec<f64> {
    predicted
        .iter()
        .enumerate()
        .map(|(c, predicted)| Lines::new(samples, predicted, c).factor())
        .collect()
}

/// What a slice is on the whole: the rms of what is determined, or where nothing is (under a smooth light, which sees averages over the slice only) of
/// what prior and samples say together.
fn size(slice: &Slice) -> f64 {
    let mean_square = |among: &dyn Fn(Status) -> bool| {
        let values = slice.reciprocal.iter().zip(&slice.status);
        let squares = values.filter(|(_, s)| among(**s)).map(|(v, _)| v * v);
        let (n, sum) = squares.fold((0.0, 0.0), |(n, sum), square| (n + 1.0, sum + square));
        (n > 0.0).then(|| sum / n)
    };
    mean_square(&|s| s == Status::Determined)
        .or_else(|| mean_square(&|s| s != Status::Indeterminate))
        .map_or(0.0, f64::sqrt)
}

/// Multiplies the variances of a slice, but for what its splines miss: that was judged from residuals of whole lobes already. What is then known no
/// better than to half of what the slice is on the whole was only thought to be known.
pub fn widen(slice: &mut Slice, factor: f64) {
    let times = factor.max(1.0).sqrt();
    let size = size(slice);
    let parts = slice.sigma.iter_mut().zip(&slice.unresolved);
    for ((sigma, unresolved), status) in parts.zip(&mut slice.status) {
        let noise = (*sigma * *sigma - unresolved * unresolved).max(0.0).sqrt();
        *sigma = (noise * times).hypot(*unresolved);
        if *sigma > 0.5 * size {
            *status = Status::Indeterminate;
        }
    }
    for coefficient in &mut slice.spectrum {
        coefficient.sigma *= times;
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::angle::LocalAngle;
    use crate::light_field::Column;
    use crate::recover::brdf::Smoothness;

    /// The factor for ten views of 160 samples of variance 1 that a prediction of 1 leaves noise of `size` and `left`(view, column) of.
    fn factor(size: f64, left: impl Fn(u32, usize) -> f64) -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let columns = (0..160).map(|j| {
            let noise = |view| {
                let draw: f64 = StandardNormal.sample(&mut random);
                1.0 + size * draw + left(view, j)
            };
            Column {
                local: LocalAngle::degrees(j as f64 - 79.5),
                alpha: (0..10).map(f64::from).collect(),
                view: (0..10).collect(),
                value: vec![(0..10).map(noise).collect()],
                variance: vec![vec![1.0; 10]],
            }
        });
        let samples = Samples {
            channels: vec!["Y".into()],
            columns: columns.collect(),
        };
        factors(&samples, &[vec![vec![1.0; 10]; 160]])[0]
    }

    #[test]
    fn noise_has_no_length_however_large() {
        // Correlations of chance are 1/√1600 = 0.025 each, of noise as stated times an excess of as much.
        for size in [0.5, 1.0, 3.0] {
            let found = factor(size, |_, _| 0.0);
            assert!((found - 1.0).abs() < 0.3, "{size}: {found}");
        }
    }

    #[test]
    fn what_errs_as_one_counts_as_one() {
        // A wave of 80 samples correlates as a cosine up to a quarter of it: 1 + 2 · 80/2π = 26 err as one; at 160 samples the stretch of
        // each lag is a little shorter than the view, which takes a tenth.
        let wave = |view: u32, j: usize| {
            5.0 * (std::f64::consts::TAU * (j + 8 * view as usize) as f64 / 80.0).cos()
        };
        let found = factor(1.0, wave);
        // Its part of the residual is 12.5 of 13.5.
        let expected = 1.0 + 25.0 * 12.5 / 13.5;
        assert!(
            (0.8..1.1).contains(&(found / expected)),
            "{found} {expected}"
        );
        // Noise ten times as strong drowns it.
        assert!(factor(50.0, wave) < 2.0);
    }

    /// Three cells of 1 with these σ.
    fn slice(sigma: [f64; 3], status: [Status; 3]) -> Slice {
        Slice {
            reciprocal: vec![1.0; 3],
            sigma: sigma.to_vec(),
            unresolved: vec![0.0; 3],
            bound: vec![0.01; 3],
            status: status.to_vec(),
            spectrum: Vec::new(),
            chi_square: 10.0,
            samples: 1,
            parameters: 1.0,
            noise: 10.0,
            smoothness: Smoothness {
                amplitude: 1.0,
                across: 1.0,
                along: 1.0,
            },
            curve: Vec::new(),
            resolution: 0.1,
            held: 0,
        }
    }

    #[test]
    fn what_is_known_too_badly_is_no_longer_known() {
        let (known, weak, open) = (Status::Determined, Status::Weak, Status::Indeterminate);
        let mut slice = slice([0.01, 0.1, 0.2], [known, weak, known]);
        widen(&mut slice, 9.0);
        assert!((slice.sigma[1] - 0.3).abs() < 1e-12);
        assert_eq!(slice.status, [known, weak, open]);
    }

    #[test]
    fn what_prior_and_samples_say_together_is_held_against_its_own_size() {
        let (weak, open) = (Status::Weak, Status::Indeterminate);
        let mut slice = slice([0.01, 0.2, 0.01], [weak, weak, open]);
        widen(&mut slice, 9.0);
        assert_eq!(slice.status, [weak, open, open]);
    }

    #[test]
    fn what_splines_miss_is_counted_once() {
        let mut slice = slice([0.05, 0.03, 0.04], [Status::Determined; 3]);
        slice.unresolved = vec![0.04, 0.0, 0.04];
        widen(&mut slice, 9.0);
        // Of 0.05 the noise is 0.03, and three times that 0.09.
        let expected = [0.09f64.hypot(0.04), 0.09, 0.04];
        for (found, expected) in slice.sigma.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }
}
