//! One channel from its samples to the result in the asked-for scale.

use std::f64::consts::TAU;

use faer::{Mat, Scale};
use num_complex::Complex64;

use super::columns::{self, Spectrum};
use super::half_circle::HalfCircle;
use super::settle::{Settled, settle, visible};
use super::sources::Sources;
use super::spectral::Coefficients;
use super::uncertainty::Linearised;
use super::unfold::unfold;
use super::{Channel, DETERMINED, LARGEST_ORDER, OpenError, Options, Systematics, WEAK};
use super::{absent, gauge, ratio, scale, slice};
use crate::angle::WorldAngle;
use crate::error::{Error, Result};
use crate::fourier::Series;
use crate::light_field::{Samples, Systematic};
use crate::lighting::Status;

/// Most radians of e^{ipθ} from node to node.
const MOST_TURN: f64 = 0.95;

/// The result where the light field does not change with the normal: uniform light, or a surface that passes nothing
/// else. Only L_0 is called known, the other frequencies and every value of ρ open.
fn unchanging(
    samples: &Samples,
    systematics: &[Systematic],
    channel: usize,
    half: &HalfCircle,
    options: &Options,
    spectrum: &Spectrum,
    resolved: usize,
) -> Result<Channel> {
    let band = spectrum.order;
    let coefficients = Coefficients::new(&spectrum.truncated(0), half);
    let mut lighting = Series::zero(band);
    lighting.coefficients[0] = Complex64::ONE;
    let (factor, scale) = scale::factor(&options.scale, channel, &lighting, 0, &coefficients)?;
    lighting.coefficients[0] *= factor;
    let mut sigma = vec![factor; band + 1];
    sigma[0] = 0.0;
    let mut status = vec![Status::Indeterminate; band + 1];
    status[0] = Status::Determined;
    Ok(Channel {
        name: samples.channels[channel].clone(),
        sigma,
        status,
        covariance: Vec::new(),
        systematics: Systematics::unknown(systematics.len()),
        components: vec![vec![0]],
        frequencies: vec![0],
        band,
        visible_band: 0,
        resolved,
        sources: Vec::new(),
        brdf: vec![0.0; half.len() * half.len()],
        brdf_sigma: vec![f64::INFINITY; half.len() * half.len()],
        eigenvalues: Vec::new(),
        start: lighting.clone(),
        ratio: lighting.clone(),
        lighting,
        misfit: 1.0,
        violation: 0.0,
        scale,
        converged: true,
    })
}

/// Directions and irradiances of sources in a light with L_0 = `mean`.
fn irradiances(sources: Option<&Sources>, mean: f64) -> Vec<(WorldAngle, f64)> {
    sources
        .iter()
        .flat_map(|s| &s.each)
        .map(|&(theta, share)| (WorldAngle::radians(theta).wrapped(), TAU * mean * share))
        .collect()
}

/// The series of (Re L_p, Im L_p, …) over `frequencies` without the first.
fn series(parts: &[f64], frequencies: &[usize], band: usize) -> Series {
    let mut series = Series::zero(band);
    for (&p, pair) in frequencies.iter().skip(1).zip(parts.chunks_exact(2)) {
        series.coefficients[p] = Complex64::new(pair[0], pair[1]);
    }
    series
}

/// `by` times a matrix, row by row.
fn row_major(m: &Mat<f64>, by: f64) -> Vec<f64> {
    (0..m.nrows())
        .flat_map(|i| (0..m.ncols()).map(move |j| (i, j)))
        .map(|(i, j)| by * m[(i, j)])
        .collect()
}

pub(super) fn recover_channel(
    samples: &Samples,
    systematics: &[Systematic],
    channel: usize,
    half: &HalfCircle,
    options: &Options,
) -> Result<Channel> {
    let resolved = columns::resolved_order(samples, channel);
    // The nodes' rule takes what stands at the ends of the half circle for a cubic over three nodes, and lobes that change faster there
    // are not integrated well at high frequencies.
    let order = options
        .band
        .unwrap_or(LARGEST_ORDER)
        .min(resolved)
        .min((MOST_TURN / half.step()) as usize);
    if order == 0 {
        return Err(Error::input(format!(
            "factorisation needs views that resolve at least one frequency of the light, found {resolved}"
        ))
        .advice("Photograph the object from more directions around it."));
    }
    let mut spectrum = Spectrum::fit(samples, channel, half, resolved, 1.0)?;
    spectrum.changes = columns::changes(samples, channel, half, resolved, systematics);
    spectrum.add_folded_variance();
    let spectrum = spectrum.truncated(order);
    let visible_band = visible(&spectrum).last().copied().unwrap_or(0);
    if visible_band == 0 {
        return unchanging(
            samples,
            systematics,
            channel,
            half,
            options,
            &spectrum,
            resolved,
        );
    }
    let mut settled = settle(&spectrum, half, options, None)?;
    if options.refine && spectrum.folded.iter().any(|v| *v > 0.0) {
        settled = unfold(samples, channel, half, options, &spectrum, settled)?;
    }
    let Settled {
        spectrum,
        frequencies,
        whitened,
        start,
        refined,
        sources,
    } = settled;
    let band = spectrum.order;
    let coefficients = Coefficients::new(&spectrum, half);
    let linearised = Linearised::new(&refined, &whitened, &spectrum)?;
    let covariance = linearised.covariance();
    let (sum, count) = refined.pairs.misfit();
    let misfit = sum / (count as f64 - covariance.nrows() as f64).max(1.0);
    // A misfit beyond its own scatter is a fault of model or noise: σ grows with it.
    let excess = if misfit > 1.0 + 4.0 * (2.0 / count as f64).sqrt() {
        misfit
    } else {
        1.0
    };
    let covariance = covariance * Scale(excess);

    let changes = slice::lighting_changes(&refined, &whitened, &covariance);

    let mut lighting = refined.lighting.clone();
    // √(var Re + var Im) of the prior where nothing is known.
    let mut sigma = vec![1.0; band + 1];
    sigma[0] = 0.0;
    for (i, &p) in frequencies.iter().enumerate().skip(1) {
        sigma[p] = (covariance[(2 * i - 2, 2 * i - 2)] + covariance[(2 * i - 1, 2 * i - 1)]).sqrt();
    }
    for p in (1..=band).filter(|p| !frequencies.contains(p)) {
        if let Some((l, variance)) =
            absent::lighting(p, &refined, &whitened, &spectrum, half, &changes)
        {
            lighting.coefficients[p] = l;
            sigma[p] = (2.0 * variance * excess).sqrt();
        }
    }
    let status: Vec<Status> = sigma
        .iter()
        .map(|s| match s {
            s if *s <= DETERMINED => Status::Determined,
            s if *s <= WEAK => Status::Weak,
            _ => Status::Indeterminate,
        })
        .collect();
    for (l, status) in lighting.coefficients.iter_mut().zip(&status) {
        if *status == Status::Indeterminate {
            *l = Complex64::ZERO;
        }
    }
    let slice = slice::slice(&refined, &whitened, half, &changes);
    let (factor, scale) = scale::factor(&options.scale, channel, &lighting, band, &coefficients)?;
    let scaled = |s: &Series| Series {
        coefficients: s.coefficients.iter().map(|c| c * factor).collect(),
    };
    Ok(Channel {
        name: samples.channels[channel].clone(),
        lighting: scaled(&lighting),
        sigma: sigma.iter().map(|s| s * factor).collect(),
        status,
        covariance: row_major(&covariance, factor * factor),
        systematics: Systematics {
            found: refined.systematics.clone(),
            open: linearised
                .open_systematics()
                .into_iter()
                .map(|(errors, light)| OpenError {
                    errors,
                    light: scaled(&series(&light, &frequencies, band)),
                })
                .collect(),
        },
        components: gauge::components(&coefficients, &frequencies),
        frequencies,
        band,
        visible_band,
        resolved,
        sources: irradiances(sources.as_ref(), factor),
        brdf: row_major(&slice.value, 1.0 / factor),
        brdf_sigma: row_major(&slice.sigma, 1.0 / factor),
        eigenvalues: start.eigenvalues,
        start: scaled(&start.lighting),
        ratio: scaled(&ratio::lighting(&coefficients)),
        violation: refined.pairs.violation(covariance.nrows()),
        misfit,
        scale,
        converged: refined.converged,
    })
}
