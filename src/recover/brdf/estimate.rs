//! What a BRDF recovery returns.

use std::f64::consts::{FRAC_PI_2, PI};

use num_complex::Complex64;
use serde::{Deserialize, Serialize};

use super::evidence::CurvePoint;
use super::prior::Smoothness;
use crate::lighting::Status;

/// The recovered in-plane slice, one per channel.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BrdfEstimate {
    /// Channel names.
    pub channels: Vec<String>,
    /// Cells of the half × half grid along each side; cell k is at −π/2 + (k + ½)·π/size.
    pub size: usize,
    /// The slice of each channel.
    pub slices: Vec<Slice>,
    /// What cannot be known from this capture, and what was unusual; plain sentences.
    pub warnings: Vec<String>,
}

/// One channel of a [`BrdfEstimate`]. Serialised without its arrays, which are images. Grid arrays are \[θi′\]\[θo′\], row-major, size², and symmetric; all are of
/// ρ̃ = ρ cos θi′ cos θo′ in sr⁻¹.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Slice {
    /// ρ̃; where the status is [`Status::Indeterminate`] it is what the prior makes of nothing, not a
    /// measurement.
    #[serde(skip)]
    pub reciprocal: Vec<f64>,
    /// Posterior standard deviation; includes what smoothing may have taken away.
    #[serde(skip)]
    pub sigma: Vec<f64>,
    /// The part of σ that is what even the finest splines miss, in quadrature: an error of the splines' own, whatever the noise.
    #[serde(skip)]
    pub unresolved: Vec<f64>,
    /// Cramér–Rao bound of the problem without smoothness prior, at the resolution of the splines; very large where the samples
    /// alone do not determine the value. Holds what the light's own uncertainty adds, where the light is not known for certain.
    #[serde(skip)]
    pub bound: Vec<f64>,
    /// Status of each cell.
    #[serde(skip)]
    pub status: Vec<Status>,
    /// ρ̃_{p,q} for p ≥ |q|.
    pub spectrum: Vec<Coefficient>,
    /// Σ residual²/σ², by the variances as given.
    pub chi_square: f64,
    /// Number of samples used.
    pub samples: usize,
    /// Effective number of parameters that the samples determine.
    pub parameters: f64,
    /// Factor by which all variances were scaled up because the residual was larger than they say; 1 if not.
    pub noise: f64,
    /// The prior used.
    pub smoothness: Smoothness,
    /// Evidence and cross-validation against the weight of the prior.
    pub curve: Vec<CurvePoint>,
    /// Distance of the knots of the splines, radians.
    pub resolution: f64,
    /// Number of coefficients that non-negativity holds at 0.
    pub held: usize,
}

/// One Fourier coefficient ρ̃_{p,q} (eq. 6 in both angles).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coefficient {
    /// Frequency in θi′, ≥ 0.
    pub p: i32,
    /// Frequency in θo′, |q| ≤ p. ρ̃_{q,p} is the same number, ρ̃_{−p,−q} its conjugate.
    pub q: i32,
    /// The estimate, sr⁻¹.
    pub value: Complex64,
    /// Standard deviation of its real and of its imaginary part.
    pub sigma: f64,
    /// Cramér–Rao bound of the problem without smoothness prior, of each part.
    pub bound: f64,
    /// Status.
    pub status: Status,
}

impl BrdfEstimate {
    /// θ′ at the centre of cell `k`, radians.
    pub fn angle(&self, k: usize) -> f64 {
        -FRAC_PI_2 + (k as f64 + 0.5) * PI / self.size as f64
    }

    /// ρ (no cosine, sr⁻¹) and its σ in channel `c` at cell (θi′ = `i`, θo′ = `j`); `None` where it is
    /// indeterminate or there is no such cell.
    pub fn rho(&self, c: usize, i: usize, j: usize) -> Option<(f64, f64)> {
        let slice = self.slices.get(c)?;
        if i >= self.size || j >= self.size {
            return None;
        }
        let k = i * self.size + j;
        if *slice.status.get(k)? == Status::Indeterminate {
            return None;
        }
        let cosines = self.angle(i).cos() * self.angle(j).cos();
        Some((slice.reciprocal[k] / cosines, slice.sigma[k] / cosines))
    }
}

/// Share of a slice that is indeterminate beyond which no place is named where it is so.
const NEARLY_ALL: f64 = 0.95;

/// Sentences on the parts of `slice` that are not known.
pub fn gaps(name: &str, size: usize, slice: &Slice) -> Vec<String> {
    let mut out = Vec::new();
    let total = (size * size) as f64;
    let missing = slice
        .status
        .iter()
        .filter(|s| **s == Status::Indeterminate)
        .count();
    // The corners at which both directions graze are open in every capture; they are no warning.
    if (missing as f64) < 0.01 * total {
        return out;
    }
    let known = slice
        .spectrum
        .iter()
        .filter(|c| c.status == Status::Determined);
    if missing == size * size {
        let names: Vec<String> = known
            .take(8)
            .map(|c| format!("({}, {})", c.p, c.q))
            .collect();
        out.push(if names.is_empty() {
            format!("{name}: this capture determines no part of the BRDF slice.")
        } else {
            format!(
                "{name}: no single value of the BRDF is determined, only averages over it: the coefficients (p, q) = {} …",
                names.join(", ")
            )
        });
        return out;
    }
    // Diagonals θi′ − θo′ = constant: each view sees one of them under each source.
    let step = 180.0 / size as f64;
    let mut bands: Vec<(f64, f64)> = Vec::new();
    for d in -(size as isize - 1)..size as isize {
        let cells = (0..size as isize)
            .filter(|j| (0..size as isize).contains(&(j + d)))
            .map(|j| ((j + d) as usize) * size + j as usize);
        let (mut all, mut lost) = (0usize, 0usize);
        for k in cells {
            all += 1;
            lost += usize::from(slice.status[k] == Status::Indeterminate);
        }
        // Reciprocity makes both signs alike; the positive ones are named.
        if d >= 0 && 2 * lost > all {
            let angle = d as f64 * step;
            match bands.last_mut() {
                Some(band) if angle - band.1 < 1.5 * step => band.1 = angle,
                _ => bands.push((angle, angle)),
            }
        }
    }
    let bands: Vec<String> = bands
        .iter()
        .map(|(from, to)| format!("{from:.0}° to {to:.0}°"))
        .collect();
    out.push(format!(
        "{name}: {:.0} % of the BRDF slice is indeterminate and left empty{}.",
        100.0 * missing as f64 / total,
        if bands.is_empty() || missing as f64 > NEARLY_ALL * total {
            String::new()
        } else {
            format!(
                ", mostly where |θi′ − θo′| is {}; views or lights at that angle to each other would fill it",
                bands.join(", ")
            )
        }
    ));
    out
}
