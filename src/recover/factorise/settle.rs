//! The largest band at which the fit settles, and the ways to begin it.

use super::Options;
use super::absent;
use super::columns::Spectrum;
use super::half_circle::HalfCircle;
use super::pairs::Whitened;
use super::refine::{self, Refined};
use super::sources::Sources;
use super::spectral::{self, Coefficients};
use crate::error::Result;
use crate::fourier::Series;

/// The frequencies whose power over the columns exceeds the noise's by five of its standard deviations.
pub(super) fn visible(spectrum: &Spectrum) -> Vec<usize> {
    let columns = spectrum.seen.iter().filter(|s| **s).count() as f64;
    let mut frequencies = vec![0];
    for (p, power) in spectrum.signal_to_noise().into_iter().enumerate().skip(1) {
        // A mean of 2 · columns squares scatters by √(2 / (2 · columns)).
        if power > 1.0 + 5.0 / columns.sqrt() {
            frequencies.push(p);
        }
    }
    frequencies
}

/// The number of frequencies of the first stage.
const FIRST_STAGE: usize = 8;

/// The eigenproblem's result at the full band, and the refinement.
///
/// The refinement begins with the eigenproblem of the lowest frequencies, which is well determined; the higher ones
/// join at their regression on the ρ̃ so found. At the noise of the highest frequencies the eigenproblem of the full
/// band can be far off; it is tried if the first way ends badly, and the better fit is kept.
fn fit(
    spectrum: &Spectrum,
    half: &HalfCircle,
    frequencies: &[usize],
    options: &Options,
) -> Result<(spectral::Start, Refined)> {
    let full = spectral::solve(&Coefficients::new(spectrum, half))?;
    let whitened = Whitened::new(spectrum, half, frequencies);
    let start = within_light(&full.lighting, frequencies);
    if !options.refine {
        let refined = refine::held(&whitened, &start)?;
        return Ok((full, refined));
    }
    let first = frequencies.len().min(FIRST_STAGE + 1);
    let low = if first < frequencies.len() {
        let order = frequencies[first - 1];
        let low = spectral::solve(&Coefficients::new(&spectrum.truncated(order), half))?;
        let lighting = within_light(&low.lighting.with_order(spectrum.order), frequencies);
        let stage = Whitened::new(spectrum, half, &frequencies[..first]);
        let refined = refine::refine(&stage, &lighting)?;
        let mut lighting = refined.lighting.clone();
        for &p in &frequencies[first..] {
            if let Some((l, _)) = absent::lighting(p, &refined, &stage, spectrum, half, &[]) {
                lighting.coefficients[p] = l;
            }
        }
        within_light(&lighting, frequencies)
    } else {
        start.clone()
    };
    let mut refined = refine::refine(&whitened, &low)?;
    let (misfit, count) = refined.pairs.misfit();
    if first < frequencies.len() && (!refined.converged || misfit > 1.2 * count as f64) {
        let other = refine::refine(&whitened, &start)?;
        if other.pairs.misfit().0 < misfit {
            refined = other;
        }
    }
    Ok((full, refined))
}

/// The coefficients of `frequencies`, cut to |L_p| ≤ L_0 = 1: no light that is nowhere negative has more.
fn within_light(lighting: &Series, frequencies: &[usize]) -> Series {
    let mut within = Series::zero(lighting.order());
    for &p in frequencies {
        let l = lighting.get(p as i64);
        within.coefficients[p] = l / l.norm().max(1.0);
    }
    within
}

/// A factorisation at the largest band at which it settles.
pub(super) struct Settled {
    /// The light field's spectrum up to that band.
    pub spectrum: Spectrum,
    /// The frequencies that show in it, the first 0.
    pub frequencies: Vec<usize>,
    /// The whitened problem of those.
    pub whitened: Whitened,
    /// The eigenproblem's result.
    pub start: spectral::Start,
    /// The refinement's.
    pub refined: Refined,
    /// The sources whose unresolved frequencies were taken from the samples, if any were.
    pub sources: Option<Sources>,
}

/// Factorises at the largest band at which the refinement settles: beyond it the weakest frequencies drag the others
/// along. `from` is a lighting to begin with, if there is one.
pub(super) fn settle(
    spectrum: &Spectrum,
    half: &HalfCircle,
    options: &Options,
    from: Option<&Series>,
) -> Result<Settled> {
    let mut frequencies = visible(spectrum);
    loop {
        let band = frequencies.last().copied().unwrap_or(0);
        let cut = spectrum.truncated(band);
        let whitened = Whitened::new(&cut, half, &frequencies);
        if let Some(lighting) = from {
            let refined = refine::refine(
                &whitened,
                &within_light(&lighting.with_order(band), &frequencies),
            )?;
            if refined.converged {
                let start = spectral::solve(&Coefficients::new(&cut, half))?;
                return Ok(Settled {
                    spectrum: cut,
                    frequencies,
                    whitened,
                    start,
                    refined,
                    sources: None,
                });
            }
        }
        let (start, refined) = fit(&cut, half, &frequencies, options)?;
        if refined.converged || frequencies.len() <= FIRST_STAGE {
            return Ok(Settled {
                spectrum: cut,
                frequencies,
                whitened,
                start,
                refined,
                sources: None,
            });
        }
        frequencies.truncate((frequencies.len() * 3).div_ceil(4));
    }
}
