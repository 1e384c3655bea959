//! The table against the angular integral, at random cells.

use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::Prefiltered;
use crate::reflect::integral;

/// What a comparison with the angular integral found in one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Checked {
    /// Channel name.
    pub channel: String,
    /// Largest difference as a fraction of the channel's level.
    pub largest: f64,
    /// Root mean square of the differences as a fraction of the level.
    pub rms: f64,
    /// Time of the angular integral with one term per value of the light for the whole table, estimated
    /// from these cells, on all threads.
    pub integral_time: Duration,
}

impl Prefiltered {
    /// Compares `cells` random cells of every channel with brute force: [`integral::value`], which is
    /// good to 1e-10.
    pub fn check(&self, cells: usize, seed: u64) -> Vec<Checked> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let grid = self.grid;
        let picked: Vec<(usize, usize)> = (0..cells)
            .map(|_| {
                let i = random.random_range(0..grid.normals);
                (i, random.random_range(0..grid.locals))
            })
            .collect();
        let terms = self.lighting.table.first().map_or(0, Vec::len).max(1024);
        let mut found = Vec::new();
        for (c, (brdf, choice)) in self.material.brdfs.iter().zip(&self.choices).enumerate() {
            let level = match choice.level {
                0.0 => 1.0,
                level => level,
            };
            let brdf = brdf.as_ref();
            let errors: Vec<f64> = picked
                .par_iter()
                .map(|&(i, j)| {
                    let (normal, local) = (grid.normal(i), grid.local(j));
                    let b = integral::value(&self.lighting, c, brdf, normal, local);
                    (self.value[c][grid.index(i, j)] - b).abs() / level
                })
                .collect();
            let start = Instant::now();
            let sum: f64 = picked
                .par_iter()
                .map(|&(i, j)| {
                    let (normal, local) = (grid.normal(i), grid.local(j));
                    integral::sum(&self.lighting, c, brdf, normal, local, terms)
                })
                .sum();
            let time = start.elapsed();
            // The sum is used for its time only; this keeps it from being left out.
            std::hint::black_box(sum);
            let squares: f64 = errors.iter().map(|e| e * e).sum();
            found.push(Checked {
                channel: choice.channel.clone(),
                largest: errors.iter().copied().fold(0.0, f64::max),
                rms: (squares / cells.max(1) as f64).sqrt(),
                integral_time: time.mul_f64(grid.len() as f64 / cells.max(1) as f64),
            });
        }
        found
    }
}
