//! Whether a recovery explains what was measured: residuals, and the verdict on the result.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::causes::{Causes, causes};
use super::measure::Measured;
use super::run::Verdict;
use crate::angle::NormalAngle;
use crate::brdf::Material;
use crate::error::Result;
use crate::light_field::{LightField, Part, Samples};
use crate::lighting::Lighting;
use crate::reflect::product;

/// Unexplained share above which a result is doubtful. Clean photos of the test sets leave 0.05–0.6 %.
pub const DOUBTFUL: f64 = 0.02;
/// Unexplained share above which a result is refused. Light from out of the plane leaves 10 % (Phong 8) to 60 % (GGX
/// 0.1) on anything but Lambertian and mirror surfaces, and a BRDF recovered from it is wrong by more than half.
pub const REFUSED: f64 = 0.06;
/// Part of the light field that breaks reciprocity beyond the noise above which a recovery of both is doubtful, and above which it is
/// refused.
///
/// Light and BRDF of one light field are told apart by reciprocity alone, and what breaks it reaches them magnified. A metal and a glossy surface under two
/// suns, 72 views, break it by 0 to 0.0012 with a camera's noise and glare, by 0.002 with brightness that varies by 0.5 % (light wrong by
/// 1 %), by 0.005 to 0.025 with orbit angles that are off by 0.2° (1 to 7 %) or a texture of 2 % (6 %). A Phong lobe of exponent 8 on a third of
/// diffuse light, in light from all of space, breaks it by 0.0006 to 0.024, where the slice is wrong by 7 to 33 %: not all of it is found.
pub const VIOLATION_DOUBTFUL: f64 = 0.003;
/// As [`VIOLATION_DOUBTFUL`].
pub const VIOLATION_REFUSED: f64 = 0.01;
/// Square of the change of radiance across the measurement plane relative to that along it, above which a recovery of both is doubtful, and
/// above which it is refused: half of it is the share of the slice that light from out of the plane puts wrong. Light in the plane gives 0; a
/// camera 2° above the plane, or lamps 2° beside it, 0.02 with an exponent of 32.
pub const ACROSS_DOUBTFUL: f64 = 0.04;
/// As [`ACROSS_DOUBTFUL`].
pub const ACROSS_REFUSED: f64 = 0.12;
/// Relative scatter (rms) of a slice's values below which it counts as diffuse: such a sphere changes across the plane under any light from
/// all of space, and its slice is right all the same.
pub const DIFFUSE: f64 = 0.15;
/// What a lighting leaves that is the model's own ([`Causes::structure`]), relative to the measured values, above which it is doubtful, and above
/// which it is refused.
///
/// It reaches the light magnified: with an exponent of 7 to 16 in place of 8 and of 28 to 40 in place of 32, and with a diffuse part that
/// is a third too dark, the determined frequencies of the light were wrong by 4 to 19 times the share that was left, ten times in the
/// middle.
pub const STRUCTURE_DOUBTFUL: f64 = 0.003;
/// As [`STRUCTURE_DOUBTFUL`].
pub const STRUCTURE_REFUSED: f64 = 0.009;
/// Unexplained share above which a light by a diffuse surface is doubtful, be the surface known or not: such a surface shows the light's frequencies so weakly that a texture of
/// 5 % on it is taken for light that is wrong by 80 %, and leaves 0.014 to 0.02. Honest sets leave nothing.
pub const DIFFUSE_DOUBTFUL: f64 = 0.006;
/// Unexplained share from which it is looked whether photographs of which light and BRDF are both unknown are linear: a shoulder of 30 % on a lobe of exponent 32 is taken for
/// another lobe and another light, 7 to 12 % off, and leaves 0.009 to 0.014. Straightened it leaves a third of that; honest sets leave more if they are bent.
pub const CURVED: f64 = 0.006;
/// Residual, relative to the largest radiance, that is taken for no noise if the photos show no limb, or more than one object.
pub const NOISE_OR_NOTHING: f64 = 0.05;
/// Frequencies of continuous light that are carried into a prediction: the lobes that photographs resolve pass no more.
const ORDER: usize = 180;

/// How well a recovery explains the samples of one channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitQuality {
    /// Root mean square of measured − predicted over the samples.
    pub residual_rms: f64,
    /// `residual_rms` relative to the largest measured value.
    pub residual_relative: f64,
    /// Mean squared residual in units of the samples' variance.
    pub chi2: f64,
    /// Root mean square of what is left beyond the stated noise, relative to that of the measured values.
    pub unexplained: f64,
    /// The part of the light field that breaks reciprocity beyond the noise, whatever the light; of a recovery of both.
    #[serde(default)]
    pub violation: Option<f64>,
    /// Square of the change of radiance across the measurement plane relative to that along it, where it was looked for and the rows tell.
    #[serde(default)]
    pub across: Option<f64>,
    /// Whether it is doubted for the sake of another channel alone, which shares its views and the places of its lights.
    #[serde(default)]
    pub beside: bool,
    /// Whether a recovery of both found no end: its errors cannot be judged.
    #[serde(default)]
    pub unsettled: bool,
    /// Whether the photographs are explained far better if they are straightened.
    #[serde(default)]
    pub curved: bool,
    /// Whether a diffuse surface shows the light that is judged.
    #[serde(default)]
    pub diffuse: bool,
    /// What the residual looks like.
    #[serde(default)]
    pub causes: Causes,
    /// What follows for the result.
    pub verdict: Verdict,
}

/// Compares samples with a prediction, \[channel\]\[column\]\[n\].
pub fn quality(samples: &Samples, predicted: &[Vec<Vec<f64>>]) -> Vec<FitQuality> {
    (0..samples.channels.len())
        .into_par_iter()
        .map(|c| {
            let (mut squares, mut noise, mut chi2, mut power) = (0.0, 0.0, 0.0, 0.0);
            let (mut largest, mut count) = (0.0f64, 0usize);
            for (column, predicted) in samples.columns.iter().zip(&predicted[c]) {
                let measured = column.value[c].iter().zip(&column.variance[c]);
                for ((b, v), f) in measured.zip(predicted) {
                    if v.is_finite() && *v > 0.0 {
                        squares += (b - f).powi(2);
                        noise += v;
                        chi2 += (b - f).powi(2) / v;
                        power += b * b;
                        largest = largest.max(b.abs());
                        count += 1;
                    }
                }
            }
            let n = count.max(1) as f64;
            let unexplained = ((squares - noise).max(0.0) / power.max(f64::MIN_POSITIVE)).sqrt();
            let residual_rms = (squares / n).sqrt();
            FitQuality {
                residual_rms,
                residual_relative: residual_rms / largest.max(f64::MIN_POSITIVE),
                chi2: chi2 / n,
                unexplained,
                violation: None,
                across: None,
                beside: false,
                unsettled: false,
                curved: false,
                diffuse: false,
                causes: causes(samples, &predicted[c], c),
                verdict: verdict(unexplained, [DOUBTFUL, REFUSED]),
            }
        })
        .collect()
}

/// Explained up to the first limit, refused above the second.
fn verdict(value: f64, [doubtful, refused]: [f64; 2]) -> Verdict {
    match value {
        v if v <= doubtful => Verdict::Explained,
        v if v <= refused => Verdict::Doubtful,
        // Also what is no number.
        _ => Verdict::Refused,
    }
}

impl FitQuality {
    /// Takes into account what of the light field breaks reciprocity.
    pub fn judge_reciprocity(&mut self, violation: f64) {
        self.violation = Some(violation);
        let own = verdict(violation, [VIOLATION_DOUBTFUL, VIOLATION_REFUSED]);
        self.verdict = self.verdict.max(own);
    }

    /// Takes into account whether the search for light and BRDF has come to an end. σ is the curvature of the misfit where it is least: where
    /// no such place was found, not even with few frequencies, nothing is known of the errors.
    pub fn judge_search(&mut self, settled: bool) {
        self.unsettled = !settled;
        if self.unsettled {
            self.verdict = Verdict::Refused;
        }
    }

    /// Takes into account how radiance changes across the plane, by which what is diffuse is not judged, and that a diffuse surface shows the
    /// light weakly.
    pub fn judge_balance(&mut self, across: Option<f64>, diffuse: bool) {
        self.across = across;
        self.judge_diffuse(diffuse);
        if let (Some(across), false) = (across, diffuse) {
            let own = verdict(across, [ACROSS_DOUBTFUL, ACROSS_REFUSED]);
            self.verdict = self.verdict.max(own);
        }
    }

    fn judge_diffuse(&mut self, diffuse: bool) {
        self.diffuse = diffuse;
        if diffuse && self.unexplained > DIFFUSE_DOUBTFUL {
            self.verdict = self.verdict.max(Verdict::Doubtful);
        }
    }

    /// Judges a lighting, which takes up what is the model's own and, by a `diffuse` surface, texture.
    pub fn judge_lighting(&mut self, diffuse: bool) {
        self.judge_diffuse(diffuse);
        let own = verdict(
            self.causes.structure,
            [STRUCTURE_DOUBTFUL, STRUCTURE_REFUSED],
        );
        self.verdict = self.verdict.max(own);
    }
}

/// Where one channel is refused because light and BRDF of no kind in the plane explain it, the others are doubtful: geometry and lamps
/// are the same for all.
pub fn judge_together(fits: &mut [FitQuality]) {
    if fits.iter().any(|fit| fit.verdict == Verdict::Refused) {
        doubt_others(fits);
    }
}

/// All channels are on the same curve.
pub fn judge_curved(fits: &mut [FitQuality]) {
    for fit in fits {
        fit.curved = true;
        fit.verdict = fit.verdict.max(Verdict::Doubtful);
    }
}

/// What is wrong with the photographs or the lamps is so in all channels.
pub fn doubt_others(fits: &mut [FitQuality]) {
    for fit in fits {
        if fit.verdict == Verdict::Explained {
            fit.verdict = Verdict::Doubtful;
            fit.beside = true;
        }
    }
}

/// B that a light and a material predict for every sample, \[channel\]\[column\]\[n\].
///
/// # Errors
/// If light and material do not have the same channels.
pub fn predict(
    lighting: &Lighting,
    material: &Material,
    samples: &Samples,
) -> Result<Vec<Vec<Vec<f64>>>> {
    let places: Vec<_> = samples
        .columns
        .iter()
        .flat_map(|column| {
            column
                .alpha
                .iter()
                .map(|a| (NormalAngle::radians(*a), column.local))
        })
        .collect();
    let order = product::sufficient_order(lighting).min(ORDER);
    let flat = product::at(lighting, material, &places, order)?;
    Ok(flat
        .into_iter()
        .map(|channel| {
            let mut values = channel.into_iter();
            samples
                .columns
                .iter()
                .map(|column| values.by_ref().take(column.alpha.len()).collect())
                .collect()
        })
        .collect())
}

/// Measured minus predicted; `predicted` is \[channel\]\[column\]\[n\] for the samples `cells` of the field.
pub fn subtract(measured: &LightField, cells: &Samples, predicted: &[Vec<Vec<f64>>]) -> LightField {
    let mut residual = measured.clone();
    let grid = measured.grid;
    for (c, mean) in residual.mean.iter_mut().enumerate() {
        for (j, (column, predicted)) in cells.columns.iter().zip(&predicted[c]).enumerate() {
            for (&row, value) in column.view.iter().zip(predicted) {
                let at = grid.index(row as usize, j);
                if residual.weight[c][at] > 0.0 {
                    mean[at] -= *value as f32;
                }
            }
        }
    }
    residual
}

/// Measured minus predicted for each photo's strip: a row per view, a column per θo′.
pub fn by_view(measured: &Measured, predicted: &[Vec<Vec<f64>>]) -> Part<'static> {
    let (width, height) = (measured.samples.columns.len(), measured.views.len());
    let mut planes = Vec::new();
    for (c, name) in measured.samples.channels.iter().enumerate() {
        let mut residual = vec![0.0f32; width * height];
        let mut weight = vec![0.0f32; width * height];
        for (j, column) in measured.samples.columns.iter().enumerate() {
            for (i, &view) in column.view.iter().enumerate() {
                if column.variance[c][i].is_finite() {
                    let at = view as usize * width + j;
                    residual[at] = (column.value[c][i] - predicted[c][j][i]) as f32;
                    weight[at] = 1.0;
                }
            }
        }
        planes.push((format!("residual.{name}"), residual.into()));
        planes.push((format!("weight.{name}"), weight.into()));
    }
    Part {
        name: "photos".into(),
        size: [width, height],
        planes,
        texts: vec![
            ("rows".into(), "views, in the order of capture.toml".into()),
            (
                "columns".into(),
                "theta_o', as in the part of the light field".into(),
            ),
        ],
        numbers: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;
    use crate::light_field::Column;

    /// Three channels that are explained to the noise.
    fn explained() -> Vec<FitQuality> {
        let value = vec![1.0, 2.0, 3.0, 2.0];
        let samples = Samples {
            channels: ["R", "G", "B"].map(String::from).to_vec(),
            columns: vec![Column {
                local: LocalAngle::degrees(0.0),
                alpha: vec![-1.5, 0.0, 1.5, 3.0],
                view: vec![0, 1, 2, 3],
                value: vec![value.clone(); 3],
                variance: vec![vec![1e-4; 4]; 3],
            }],
        };
        quality(&samples, &vec![vec![value]; 3])
    }

    #[test]
    fn what_finds_no_end_is_no_measurement_and_its_neighbours_are_doubtful() {
        let mut fits = explained();
        for (fit, settled) in fits.iter_mut().zip([true, false, true]) {
            fit.judge_search(settled);
        }
        judge_together(&mut fits);
        let verdicts: Vec<Verdict> = fits.iter().map(|f| f.verdict).collect();
        let expected = [Verdict::Doubtful, Verdict::Refused, Verdict::Doubtful];
        assert_eq!(verdicts, expected);
    }

    #[test]
    fn on_a_curve_no_channel_is_explained() {
        let mut fits = explained();
        fits[1].verdict = Verdict::Refused;
        judge_curved(&mut fits);
        let verdicts: Vec<Verdict> = fits.iter().map(|f| f.verdict).collect();
        let expected = [Verdict::Doubtful, Verdict::Refused, Verdict::Doubtful];
        assert_eq!(verdicts, expected);
        assert!(fits.iter().all(|fit| fit.curved));
    }

    #[test]
    fn a_diffuse_surface_is_judged_more_strictly_known_or_not() {
        for diffuse in [false, true] {
            let mut fits = explained();
            let [known, unknown, _] = fits.as_mut_slice() else {
                panic!("three channels");
            };
            for fit in [&mut *known, &mut *unknown] {
                fit.unexplained = 0.5 * (DIFFUSE_DOUBTFUL + DOUBTFUL);
            }
            known.judge_lighting(diffuse);
            unknown.judge_balance(None, diffuse);
            let expected = match diffuse {
                true => Verdict::Doubtful,
                false => Verdict::Explained,
            };
            assert_eq!([known.verdict, unknown.verdict], [expected; 2]);
        }
    }
}
