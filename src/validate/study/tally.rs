//! From the errors of many draws to error, bias, coverage and ratio to the bound.

use serde::{Deserialize, Serialize};

/// Two-sided 95 % point of the normal distribution.
const NORMAL_95: f64 = 1.959_963_984_540_054;

/// What an outcome is about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// The light.
    #[default]
    Lighting,
    /// The BRDF slice.
    Brdf,
}

impl Quantity {
    /// The word in the table.
    pub fn word(self) -> &'static str {
        match self {
            Self::Lighting => "lighting",
            Self::Brdf => "brdf",
        }
    }
}

/// What a draw says of one real quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Judged {
    /// Estimate − truth.
    pub error: f64,
    /// Standard deviation that the estimate claims.
    pub sigma: f64,
    /// Square of the Cramér–Rao bound.
    pub bound_square: f64,
    /// Whether the estimate claims that it is determined.
    pub determined: bool,
}

/// One draw: all quantities in an order that is the same for all draws, as many as it has.
#[derive(Clone, Debug, Default)]
pub(super) struct Draw {
    /// The quantities.
    pub quantities: Vec<Judged>,
    /// For `brdf`: the largest p up to which all coefficients are determined.
    pub band: Option<usize>,
}

/// The result of a cell, of one of the quantities that it recovers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// What it is about.
    pub quantity: Quantity,
    /// Largest frequency that is determined; `None`: nothing is.
    pub band: Option<usize>,
    /// Number of real quantities that are determined in every draw.
    pub quantities: usize,
    /// Root mean square error over the draws, relative to the norm of the truth.
    pub rmse: Option<f64>,
    /// Norm of the mean error, relative to that of the truth.
    pub bias: Option<f64>,
    /// Cramér–Rao bound of the root mean square error, relative to the norm of the truth.
    pub bound: Option<f64>,
    /// The same ratio value by value: √⟨error²/bound²⟩ over all quantities and draws, in which the well-determined ones count as much
    /// as the others.
    pub each: Option<f64>,
    /// Share of the errors within ±1.96 σ.
    pub coverage: Option<f64>,
    /// Draws whose recovery succeeded.
    pub draws: usize,
    /// Draws whose recovery failed.
    pub failed: usize,
    /// Why the first of them failed.
    pub failure: Option<String>,
}

impl Outcome {
    /// rmse / bound.
    pub fn ratio(&self) -> Option<f64> {
        match (self.rmse, self.bound) {
            (Some(e), Some(b)) if b > 0.0 => Some(e / b),
            _ => None,
        }
    }
}

/// Which quantities are determined in every draw.
pub(super) fn determined(draws: &[Draw]) -> Vec<bool> {
    let length = draws.iter().map(|d| d.quantities.len()).min().unwrap_or(0);
    (0..length)
        .map(|i| draws.iter().all(|d| d.quantities[i].determined))
        .collect()
}

/// Sums up the quantities marked in `kept`: with the norm Σ weight · error², relative to `norm`.
pub(super) fn tally(draws: &[Draw], kept: &[bool], weights: &[f64], norm: f64) -> Outcome {
    let mut outcome = Outcome {
        draws: draws.len(),
        quantities: kept.iter().filter(|k| **k).count(),
        ..Outcome::default()
    };
    if outcome.quantities == 0 || draws.is_empty() || !(norm > 0.0) {
        return outcome;
    }
    let count = draws.len() as f64;
    let (mut square, mut bias, mut bound, mut each, mut inside) = (0.0, 0.0, 0.0, 0.0, 0usize);
    for (i, &weight) in weights.iter().enumerate() {
        if !kept.get(i).is_some_and(|k| *k) {
            continue;
        }
        let quantities = || draws.iter().map(|d| &d.quantities[i]);
        let mean = quantities().map(|q| q.error).sum::<f64>() / count;
        bias += weight * mean * mean;
        let own = quantities().map(|q| q.error * q.error).sum::<f64>() / count;
        let least = quantities().map(|q| q.bound_square).sum::<f64>() / count;
        square += weight * own;
        bound += weight * least;
        each += own / least;
        inside += quantities()
            .filter(|q| q.error.abs() <= NORMAL_95 * q.sigma)
            .count();
    }
    outcome.rmse = Some(square.sqrt() / norm);
    outcome.bias = Some(bias.sqrt() / norm);
    outcome.bound = bound.is_finite().then(|| bound.sqrt() / norm);
    outcome.each = Some((each / outcome.quantities as f64).sqrt()).filter(|v| v.is_finite());
    outcome.coverage = Some(inside as f64 / (count * outcome.quantities as f64));
    outcome
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quantity(error: f64, sigma: f64, determined: bool) -> Judged {
        Judged {
            error,
            sigma,
            bound_square: 0.25,
            determined,
        }
    }

    #[test]
    fn only_what_is_determined_in_every_draw_counts() {
        let draws = vec![
            Draw {
                quantities: vec![
                    quantity(1.0, 1.0, true),
                    quantity(9.0, 1.0, true),
                    quantity(7.0, 1.0, true),
                ],
                band: None,
            },
            Draw {
                quantities: vec![quantity(-3.0, 1.0, true), quantity(9.0, 1.0, false)],
                band: None,
            },
        ];
        let kept = determined(&draws);
        assert_eq!(kept, [true, false]);
        let outcome = tally(&draws, &kept, &[2.0, 1.0], 4.0);
        assert_eq!(outcome.quantities, 1);
        // √(2 · (1 + 9)/2) / 4, √(2 · (−1)²) / 4, √(2 · ¼) / 4; one of two within 1.96 σ.
        assert!((outcome.rmse.unwrap() - 10f64.sqrt() / 4.0).abs() < 1e-15);
        assert!((outcome.bias.unwrap() - 2f64.sqrt() / 4.0).abs() < 1e-15);
        assert!((outcome.bound.unwrap() - 0.5f64.sqrt() / 4.0).abs() < 1e-15);
        assert_eq!(outcome.coverage, Some(0.5));
        assert!((outcome.ratio().unwrap() - 20f64.sqrt()).abs() < 1e-12);
        assert!((outcome.each.unwrap() - 20f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn nothing_determined_is_no_number() {
        let outcome = tally(&[Draw::default()], &[], &[], 1.0);
        assert_eq!(
            (outcome.rmse, outcome.coverage, outcome.draws),
            (None, None, 1)
        );
    }
}
