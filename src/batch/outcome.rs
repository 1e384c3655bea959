//! What one set of a batch came to: the scalars of its run, and its curves thinned for a small plot.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::pipeline::{Run, Verdict};
use crate::recover::Status;
use crate::recover::lighting::SourceEstimate;

/// Points of a small plot's curve.
const POINTS: usize = 181;
/// θi′ of the BRDF's cut, degrees: far enough from 0 that the mirror direction and the light are apart.
const CUT_DEG: f64 = -30.0;

/// One set of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The set's name.
    pub name: String,
    /// What was found, or why nothing was: a sentence and advice.
    pub found: Result<Found, String>,
    /// Whether an earlier batch had finished it.
    pub reused: bool,
}

/// Results of one set.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// `lighting`, `brdf`, `both` or `none`.
    pub recover: String,
    /// Name of the capture.
    pub capture: String,
    /// Unit of radiance.
    pub radiance_unit: String,
    /// Number of views.
    pub views: usize,
    /// Warnings of the run.
    pub warnings: Vec<String>,
    /// Light sources, the strongest first.
    pub sources: Vec<SourceEstimate>,
    /// Per channel.
    pub channels: Vec<ChannelFound>,
}

/// Results of one set in one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelFound {
    /// Channel name.
    pub name: String,
    /// Share of the light field's cells within the limb cut that were seen.
    pub coverage: f64,
    /// Root mean square of measured − predicted over the largest measured value; without a recovery none.
    pub residual_relative: Option<f64>,
    /// What is left beyond the noise, relative to the measured values.
    pub unexplained: Option<f64>,
    /// Whether the recovery explains the measurement.
    pub verdict: Option<Verdict>,
    /// Largest p up to which the light is determined.
    pub determined_band: Option<usize>,
    /// ∫ L dθ with its σ.
    pub total_irradiance: Option<(f64, f64)>,
    /// Share of the BRDF's slice that is determined.
    pub brdf_determined: Option<f64>,
    /// The model that fits the slice best, with its parameters.
    pub model: Option<String>,
    /// For the small plot.
    pub curve: Curve,
}

/// A curve of a set: L(θ) without the sources, or ρ cos θi′ cos θo′ along θo′ at θi′ = −30°, or for a light field alone the mean over θo′ of B(α, θo′).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Angle, degrees.
    pub angles_deg: Vec<f64>,
    /// Value; NaN where there is none.
    pub values: Vec<f64>,
}

impl Found {
    /// The scalars and curves of a run.
    pub fn of(run: &Run) -> Self {
        let mut sources = run
            .lighting
            .as_ref()
            .map_or_else(Vec::new, |l| l.sources.clone());
        let strength = |s: &SourceEstimate| s.irradiance.iter().sum::<f64>();
        sources.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
        Self {
            recover: run.recover.clone(),
            capture: run.capture_name.clone(),
            radiance_unit: run.radiance_unit.clone(),
            views: run.views.len(),
            warnings: run.warnings.clone(),
            sources,
            channels: (0..run.channels.len()).map(|c| channel(run, c)).collect(),
        }
    }

    /// The worst verdict of all channels.
    pub fn verdict(&self) -> Option<Verdict> {
        let worse = |v: &Verdict| match v {
            Verdict::Explained => 0,
            Verdict::Doubtful => 1,
            Verdict::Refused => 2,
        };
        self.channels
            .iter()
            .filter_map(|c| c.verdict)
            .max_by_key(worse)
    }
}

fn channel(run: &Run, c: usize) -> ChannelFound {
    let fit = run.fit.get(c);
    let light = run.lighting.as_ref().and_then(|l| l.channels.get(c));
    let slice = run.brdf.as_ref().and_then(|b| b.slices.get(c));
    let determined = |status: &[Status]| {
        let count = status.iter().filter(|s| **s == Status::Determined).count();
        count as f64 / status.len().max(1) as f64
    };
    let models = run.models.as_ref().and_then(|m| m.channels.get(c));
    let model = models.and_then(|m| m.fits.get(m.best)).map(|best| {
        let parameters: Vec<String> = best
            .parameters
            .iter()
            .map(|p| format!("{} {:.4}", p.name, p.value))
            .collect();
        format!("{}: {}", best.model, parameters.join(", "))
    });
    ChannelFound {
        name: run.channels.get(c).cloned().unwrap_or_default(),
        coverage: run.light_field.coverage(c, run.limb_cut),
        residual_relative: fit.map(|f| f.residual_relative),
        unexplained: fit.map(|f| f.unexplained),
        verdict: fit.map(|f| f.verdict),
        determined_band: light.and_then(|l| l.determined_band),
        total_irradiance: light
            .and_then(|l| l.spectrum.first())
            .map(|l| (TAU * l.value.re, TAU * l.sigma)),
        brdf_determined: slice.map(|s| determined(&s.status)),
        model,
        curve: curve(run, c),
    }
}

fn curve(run: &Run, c: usize) -> Curve {
    if let Some(brdf) = run.brdf.as_ref()
        && let Some(slice) = brdf.slices.get(c)
        && brdf.size > 0
    {
        let n = brdf.size;
        let row = ((CUT_DEG.to_radians() + FRAC_PI_2) / PI * n as f64) as usize;
        let at = |j: usize| slice.reciprocal.get(row.min(n - 1) * n + j).copied();
        return thinned(n, |j| brdf.angle(j).to_degrees(), at);
    }
    if let Some(light) = run.lighting.as_ref().and_then(|l| l.channels.get(c)) {
        let angle = |i: usize| -180.0 + 2.0 * i as f64;
        let value = |i| light.smooth.evaluate(f64::to_radians(angle(i))).max(0.0);
        return thinned(POINTS, angle, |i| Some(value(i)));
    }
    let (field, grid) = (&run.light_field, run.light_field.grid);
    let mean = |i: usize| {
        let (mut sum, mut count) = (0.0, 0usize);
        for j in 0..grid.locals {
            let k = grid.index(i, j);
            let weight = field.weight.get(c).and_then(|w| w.get(k));
            if weight.is_some_and(|w| *w > 0.0)
                && let Some(value) = field.mean.get(c).and_then(|m| m.get(k))
            {
                sum += f64::from(*value);
                count += 1;
            }
        }
        (count > 0).then(|| sum / count as f64)
    };
    thinned(grid.normals, |i| grid.normal(i).deg(), mean)
}

/// Every k-th of `n` values, and the largest of those left out in its place: a narrow peak stays.
fn thinned(n: usize, angle: impl Fn(usize) -> f64, value: impl Fn(usize) -> Option<f64>) -> Curve {
    let step = n.div_ceil(POINTS).max(1);
    let mut curve = Curve::default();
    for start in (0..n).step_by(step) {
        let highest = (start..(start + step).min(n))
            .filter_map(|i| value(i).filter(|v| v.is_finite()).map(|v| (i, v)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        let (i, v) = highest.unwrap_or((start, f64::NAN));
        curve.angles_deg.push(angle(i));
        curve.values.push(v);
    }
    curve
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thinned_curve_keeps_its_peaks_and_gaps() {
        let curve = thinned(
            720,
            |i| i as f64,
            |i| match i {
                331 => Some(9.0),
                400..420 => None,
                _ => Some(1.0),
            },
        );
        assert_eq!(curve.values.len(), 180);
        let peak = curve.values.iter().position(|v| *v == 9.0).expect("kept");
        assert_eq!(curve.angles_deg[peak], 331.0);
        assert_eq!(curve.values.iter().filter(|v| v.is_nan()).count(), 5);
    }
}
