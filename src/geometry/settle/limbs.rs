//! Which of the limbs that the photos seem to show are limbs.
//!
//! A dark limb vanishes into a black background; what the search then finds, the edge of a shadow or the flank of a
//! highlight, lies inside the object, by a fraction of a pixel or by many, and turns with the view as a displacement
//! does. One photo alone does not tell. All together do: true limbs agree on one place and one radius. So
//! each limb is either measured, with normal errors, or an edge anywhere near, ten times as likely inside the
//! object as outside, and the place and radius under which what was found is most likely are sought over
//! hypotheses from random fours of limbs (Fischler and Bolles, "Random sample consensus", Comm. ACM 24 (1981);
//! the mixture's likelihood: Torr and Zisserman, "MLESAC", CVIU 78 (2000)).

use nalgebra::SMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{Common, Observation, Of, Setting};

/// Part of the limbs that are expected to be something else, and the part of these that lies outside.
const FALSE: f64 = 0.2;
const OUTSIDE: f64 = 0.1;
/// Hypotheses from random limbs: if half of them are false, 1 in 16 fours is true, and the chance to miss all is
/// (15/16)^200 = 2e-6.
const TRIALS: usize = 200;
/// Hypotheses that are refined, and steps for each.
const REFINED: usize = 8;
const STEPS: usize = 20;
/// Spreads of the views about the common model that are tried, from the least error of a limb on.
const SPREADS: [f64; 5] = [1.0, 3.0, 10.0, 30.0, 100.0];
/// Widths within this many σ are right.
const PAIRED: f64 = 3.0;
/// With fewer limbs than this beyond the four unknowns nothing can be said against any of them.
const LEAST: usize = 8;

/// Whether each limb (of kind [`Of::Limb`]; the two of one view in succession) is one.
pub(super) fn genuine(setting: &Setting, limbs: &[Observation]) -> Vec<bool> {
    if limbs.len() < LEAST {
        return vec![true; limbs.len()];
    }
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut hypotheses = vec![Common::zeros()];
    for _ in 0..TRIALS {
        let four: Vec<&Observation> = (0..4)
            .filter_map(|_| limbs.get(random.random_range(0..limbs.len())))
            .collect();
        let start = Common::zeros();
        hypotheses.extend(step(
            setting,
            four.into_iter().map(|o| (o, 1.0)),
            1.0,
            &start,
        ));
    }
    let judged = |common: Common| {
        let misses = misses(setting, limbs, &common);
        SPREADS
            .iter()
            .map(|spread| {
                (
                    likelihood(setting, limbs, &misses, &common, *spread),
                    *spread,
                    common,
                )
            })
            .fold((f64::NEG_INFINITY, 1.0, common), |a, b| {
                if b.0 > a.0 { b } else { a }
            })
    };
    let mut best: Vec<_> = hypotheses.into_par_iter().map(judged).collect();
    best.sort_by(|a, b| b.0.total_cmp(&a.0));
    best.truncate(REFINED);
    let refined: Vec<_> = best
        .into_par_iter()
        .map(|mut found| {
            for _ in 0..STEPS {
                let (_, spread, common) = found;
                let missed = misses(setting, limbs, &common);
                let weighted = limbs
                    .iter()
                    .zip(&missed)
                    .map(|(o, miss)| (o, belief(setting, o, *miss, spread).0));
                let Some(next) = step(setting, weighted, spread, &common) else {
                    break;
                };
                let next = judged(next);
                if !(next.0 > found.0 + 1e-6) {
                    break;
                }
                found = next;
            }
            found
        })
        .collect();
    let nothing = (f64::NEG_INFINITY, 1.0, Common::zeros());
    type Judged = (f64, f64, Common);
    let better = |a: Judged, b: Judged| if b.0 > a.0 { b } else { a };
    let (_, spread, common) = refined.into_iter().fold(nothing, better);
    let missed = misses(setting, limbs, &common);
    let mut genuine: Vec<bool> = limbs
        .iter()
        .zip(&missed)
        .map(|(o, miss)| belief(setting, o, *miss, spread).0 > 0.5)
        .collect();
    // Two limbs at the right distance from each other, wherever they are, are those of an object that moved.
    for i in 1..limbs.len() {
        let (left, right) = (&limbs[i - 1], &limbs[i]);
        if left.view == right.view {
            let [l, r] = [missed[i - 1], missed[i]];
            let wider = variance(setting, left, 1.0) + variance(setting, right, 1.0);
            if (r - l).powi(2) < PAIRED * PAIRED * wider {
                genuine[i - 1] = true;
                genuine[i] = true;
            }
        }
    }
    genuine
}

/// A step of weighted least squares from `common`; `spread` in units of the limb's error.
fn step<'a>(
    setting: &Setting,
    weighted: impl Iterator<Item = (&'a Observation, f64)>,
    spread: f64,
    common: &Common,
) -> Option<Common> {
    let prior = setting.prior_weight(common);
    let mut normal = SMatrix::<f64, 4, 4>::from_diagonal(&prior);
    let mut right = -common.component_mul(&prior);
    for (o, weight) in weighted {
        let (row, predicted) = setting.predict(o, common);
        let weight = weight / variance(setting, o, spread);
        normal.ger(weight, &row, &row, 1.0);
        right += row * (weight * (o.value - predicted));
    }
    let next = common + normal.try_inverse()? * right;
    next.iter().all(|v| v.is_finite()).then_some(next)
}

fn variance(setting: &Setting, o: &Observation, spread: f64) -> f64 {
    o.variance + 2.0 * setting.limb_error * spread * spread
}

/// By how much each limb is from where it would be.
fn misses(setting: &Setting, limbs: &[Observation], common: &Common) -> Vec<f64> {
    limbs
        .iter()
        .map(|o| o.value - setting.predict(o, common).1)
        .collect()
}

/// Probability that a limb which is off by `miss` is one, and the logarithm of the density of what was found.
fn belief(setting: &Setting, o: &Observation, miss: f64, spread: f64) -> (f64, f64) {
    let outwards = match o.kind {
        Of::Limb(side) => miss * side > 0.0,
        Of::Centre | Of::Width => false,
    };
    let variance = variance(setting, o, spread);
    let genuine = (1.0 - FALSE) * (-0.5 * miss * miss / variance).exp()
        / (std::f64::consts::TAU * variance).sqrt();
    // Anywhere within the search's reach, an eighth of the radius to each side.
    let other = FALSE * if outwards { OUTSIDE } else { 1.0 - OUTSIDE } / (0.125 * setting.radius);
    (genuine / (genuine + other), (genuine + other).ln())
}

fn likelihood(
    setting: &Setting,
    limbs: &[Observation],
    misses: &[f64],
    common: &Common,
    spread: f64,
) -> f64 {
    let prior = setting.prior_weight(common);
    let size = common.component_mul(common).dot(&prior);
    limbs
        .iter()
        .zip(misses)
        .map(|(o, miss)| belief(setting, o, *miss, spread).1)
        .sum::<f64>()
        - 0.5 * size
}
