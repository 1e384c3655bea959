//! The factorisation again, without what unresolved frequencies of sources fold onto those that are fitted.

use super::Options;
use super::absent;
use super::columns::{self, Spectrum};
use super::folded::{self, Surface};
use super::half_circle::HalfCircle;
use super::pairs::{Pairs, Whitened};
use super::settle::{Settled, settle};
use super::sources::Sources;
use super::uncertainty::Linearised;
use crate::error::Result;
use crate::light_field::Samples;

/// Most rounds of taking folded frequencies from the samples.
const UNFOLDINGS: usize = 4;
/// Share of the folded amplitude that is always taken to be left.
const LEFT: f64 = 0.1;
/// χ² by which sources may fit the frequencies beyond the band worse than no light there: five standard deviations.
const CONTRADICTS: f64 = 25.0;
/// Change of what is folded, relative to it, at which no further round is needed.
const UNFOLDED: f64 = 0.02;

/// The factorisation again, without what unresolved frequencies of the sources in it fold onto the others.
///
/// What is left of them is a share of what was there: at least [`LEFT`], and as much as brings the misfit down to 1. The result is the
/// last round that lowers the misfit of the frequencies of both in units of the noise alone, or leaves nothing beyond the noise: the
/// first may overshoot.
pub(super) fn unfold(
    samples: &Samples,
    channel: usize,
    half: &HalfCircle,
    options: &Options,
    folded: &Spectrum,
    first: Settled,
) -> Result<Settled> {
    let order = folded.order;
    let resolved = columns::resolved_order(samples, channel);
    let mut left = LEFT * LEFT;
    let mut before: Option<Sources> = None;
    let mut best = first;
    // The round before, where it was not yet the best.
    let mut last: Option<Settled> = None;
    for _ in 0..UNFOLDINGS {
        let from = last.as_ref().unwrap_or(&best);
        let covariance =
            Linearised::new(&from.refined, &from.whitened, &from.spectrum)?.covariance();
        let Some(sources) = Sources::find(&from.refined.lighting, &from.frequencies, &covariance)
        else {
            break;
        };
        if before.is_some_and(|b| b.change(&sources, 2 * resolved) < UNFOLDED)
            || contradicted(&sources, from, folded, resolved, half)
        {
            break;
        }
        let surface = Surface::fit(&from.whitened, half, &from.refined)?;
        let without = folded::without(samples, channel, &surface, &sources, resolved, order);
        let mut spectrum = Spectrum::fit(&without, 0, half, resolved, left)?.truncated(order);
        spectrum.changes.clone_from(&folded.changes);
        spectrum.folded = folded.folded.iter().map(|f| left * f).collect();
        let mut next = settle(&spectrum, half, options, Some(&from.refined.lighting))?;
        next.sources = Some(sources.clone());
        let common: Vec<usize> = next
            .frequencies
            .iter()
            .copied()
            .filter(|p| best.frequencies.contains(p))
            .collect();
        let misfit = noise_misfit(&next, &common, half)?;
        let (sum, count) = next.refined.pairs.misfit();
        left = (left * sum / count.max(1) as f64).clamp(LEFT * LEFT, 1.0);
        before = Some(sources);
        if misfit < noise_misfit(&best, &common, half)?.max(1.0) {
            best = next;
            last = None;
        } else {
            last = Some(next);
        }
    }
    Ok(best)
}

/// Whether the light beyond the band, as far as the light field shows that it would, is not that of the sources: frequencies of a smooth light can
/// be those of as many sources too, but only sources go on.
fn contradicted(
    sources: &Sources,
    settled: &Settled,
    spectrum: &Spectrum,
    resolved: usize,
    half: &HalfCircle,
) -> bool {
    // Farther up what folds is no longer small beside what is there: (p / (n − p))² is a quarter.
    let beyond = settled.spectrum.order + 1..=spectrum.order.min(2 * resolved / 3);
    let worse: f64 = beyond
        .filter_map(|p| {
            let (refined, whitened) = (&settled.refined, &settled.whitened);
            let (light, variance) = absent::lighting(p, refined, whitened, spectrum, half, &[])?;
            let misses = (light - sources.coefficient(p)).norm_sqr();
            Some((misses - light.norm_sqr()) / variance)
        })
        .sum();
    worse > CONTRADICTS
}

/// Mean square of the constraints among `frequencies` in units of the noise alone.
fn noise_misfit(settled: &Settled, frequencies: &[usize], half: &HalfCircle) -> Result<f64> {
    let mut spectrum = settled.spectrum.clone();
    spectrum.folded.fill(0.0);
    let whitened = Whitened::new(&spectrum, half, frequencies);
    let (sum, count) = Pairs::new(
        &whitened,
        &settled.refined.lighting,
        &settled.refined.systematics,
    )?
    .misfit();
    Ok(sum / count.max(1) as f64)
}
