//! Random numbers that depend on the seed and on what they are for, and on nothing else: not on
//! threads, not on which other faults are switched on.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// What random numbers are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub(super) enum Purpose {
    /// Orbit angles.
    Orbit = 1,
    /// Displacements of single views.
    Wobble,
    /// Brightness of the lamps.
    Brightness,
    /// Exposure times.
    Exposure,
    /// Which views are missing.
    Missing,
    /// Albedo.
    Texture,
    /// Specks.
    Dust,
    /// Shot and read noise.
    Noise,
}

/// The generator for one purpose, picture (`first`) and row (`second`): its key is these numbers.
pub(super) fn generator(seed: u64, purpose: Purpose, first: u64, second: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    let numbers = [seed, purpose as u64, first, second];
    for (bytes, number) in key.chunks_exact_mut(8).zip(numbers) {
        bytes.copy_from_slice(&number.to_le_bytes());
    }
    ChaCha8Rng::from_seed(key)
}
