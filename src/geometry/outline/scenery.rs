//! By how much the scenery behind the object moves a limb.
//!
//! The limb's model has a level background. Where the scenery is not level, the pixels that the limb crosses have something else behind
//! them than the background that is seen beside it, and neighbouring rows have the same. What that is, the object hides; but the fit is
//! linear in small changes of the background, so it tells by how much the limb would move if the scenery at the limb were that of so
//! many pixels farther out. These moves, taken of all points of a limb at once, have the scenery's own correlation along it.

use super::edge::{Background, Edge, OUTSIDE};
use super::strip::{Profile, Strip};

/// Displacements of the scenery that are looked at, pixels: three times the background that the fit sees.
const SHIFTS: usize = 3 * OUTSIDE;

/// What the scenery may do to one limb point.
#[derive(Clone, Debug)]
pub(super) struct Scenery {
    /// By how much the limb's depth changes (pixels) with each displacement; `None` where that part of the scenery is not seen.
    pub moves: Vec<Option<f64>>,
    /// Variance of a move that is the pixels' noise.
    pub noise: f64,
    /// Variance that the point is given for it, pixels².
    pub known: f64,
}

impl Scenery {
    /// Of the limb that was found in a strip.
    pub(super) fn behind(strip: &Strip, profile: &Profile, edge: &Edge, blur: f64) -> Self {
        let background = Background::new(edge, strip, blur);
        let mut noise = 0.0;
        let mut pulls = 0.0;
        // By displacement: Σ pull · value, Σ value, number of pixels.
        let mut sums = vec![Some([0.0; 3]); SHIFTS];
        for line in &strip.lines {
            let last = (edge.depth + background.reach - line.first).floor();
            for k in (0..=last.max(0.0) as usize).rev().take(2 * OUTSIDE) {
                let depth = line.first + k as f64;
                let Some(variance) = line.variance.get(k).filter(|v| v.is_finite()) else {
                    continue;
                };
                let variance = f64::from(*variance).max(profile.pixel_variance);
                let pull = background.pull(depth, variance);
                if pull == 0.0 {
                    continue;
                }
                noise += pull * pull * variance;
                pulls += pull;
                for (shift, sums) in sums.iter_mut().enumerate() {
                    // From there on nothing of the object is seen.
                    let clear = (2.0 * background.reach).ceil() as usize + shift;
                    let seen = k.checked_sub(clear).and_then(|at| {
                        let known = line.variance.get(at)?.is_finite();
                        known.then(|| line.value.get(at)).flatten()
                    });
                    *sums = sums.zip(seen).map(|([by_pull, sum, count], seen)| {
                        let seen = f64::from(*seen);
                        [by_pull + pull * seen, sum + seen, count + 1.0]
                    });
                }
            }
        }
        // A level background moves nothing.
        let moved = |[by_pull, sum, count]: [f64; 3]| by_pull - pulls * sum / count.max(1.0);
        Self {
            moves: sums.into_iter().map(|sums| sums.map(moved)).collect(),
            noise,
            known: 0.0,
        }
    }

    /// Variance of the point by itself.
    pub(super) fn variance(&self) -> f64 {
        variance([(1.0, self)].into_iter())
    }
}

/// Variance of a weighted sum of the points of one limb, pixels².
pub(super) fn variance<'a>(points: impl Iterator<Item = (f64, &'a Scenery)> + Clone) -> f64 {
    let noise: f64 = points.clone().map(|(by, s)| by * by * s.noise).sum();
    let moves = (0..SHIFTS).filter_map(|shift| {
        points.clone().try_fold(0.0, |sum, (by, scenery)| {
            Some(sum + by * scenery.moves.get(shift).copied().flatten()?)
        })
    });
    let (squares, count) = moves.fold((0.0, 0.0), |(s, n), m| (s + m * m, n + 1.0));
    if count > 0.0 {
        (squares / count - noise).max(0.0)
    } else {
        0.0
    }
}
