//! What a run says in words: what is known, what is not, and what to distrust.

use std::f64::consts::{FRAC_PI_2, TAU};

use super::fit::{
    ACROSS_DOUBTFUL, ACROSS_REFUSED, DIFFUSE_DOUBTFUL, DOUBTFUL, REFUSED, STRUCTURE_DOUBTFUL,
    STRUCTURE_REFUSED, VIOLATION_DOUBTFUL, VIOLATION_REFUSED,
};
use super::joint::ChannelGauge;
use super::material::share;
use super::measure::Measured;
use super::recipe::{Recipe, Recover};
use super::run::{Recovered, Verdict};
use crate::light_field::{Column, Samples};
use crate::recover::Status;
use crate::recover::brdf::BrdfEstimate;
use crate::recover::factorise::{self, Factorisation};
use crate::recover::lighting::LightingEstimate;

/// A gap between neighbouring views, radians, beyond which it is why no frequency of a light field shows.
const WIDE_GAP: f64 = FRAC_PI_2;
/// Change with the normal, relative to the mean, that a light field has where a light that is not uniform shows.
const CHANGE: f64 = 0.05;

/// What a fit that does not explain the photographs means for its result.
pub fn fit_warnings(recover: Recover, measured: &Measured, recovered: &Recovered) -> Vec<String> {
    const OUT_OF_PLANE: &str = "light reaches the object from out of the measurement plane";
    const SURROUNDINGS: &str = "light reaches the object from out of the measurement plane or from nearby, the object is not convex, or the photographs are not linear";
    let (result, model) = match recover {
        Recover::Lighting => (
            "lighting",
            format!("the BRDF is not this surface's, {SURROUNDINGS}"),
        ),
        Recover::Brdf => (
            "BRDF",
            format!("the light is not the stated one, {SURROUNDINGS}"),
        ),
        _ => ("lighting and BRDF", SURROUNDINGS.to_string()),
    };
    recovered
        .fit
        .iter()
        .zip(&measured.samples.channels)
        .filter_map(|(fit, name)| {
            let (limits, across_limit) = match fit.verdict {
                Verdict::Refused => ([REFUSED, VIOLATION_REFUSED, STRUCTURE_REFUSED], ACROSS_REFUSED),
                _ => ([DOUBTFUL, VIOLATION_DOUBTFUL, STRUCTURE_DOUBTFUL], ACROSS_DOUBTFUL),
            };
            let (usual, consequence) = match fit.verdict {
                Verdict::Explained => return None,
                Verdict::Doubtful => (
                    "usual is below",
                    "Errors of that order, or larger ones, are not in the error bars.".to_string(),
                ),
                Verdict::Refused => (
                    "more than",
                    format!("No {result} is given as a measurement: every value is marked indeterminate."),
                ),
            };
            let [mut unexplained, violation, structure] = limits;
            if fit.diffuse && fit.verdict == Verdict::Doubtful {
                unexplained = DIFFUSE_DOUBTFUL;
            }
            let mut found = Vec::new();
            if !(fit.unexplained <= unexplained) {
                found.push(format!(
                    "the best {result} leaves {:.1} % of the light field unexplained beyond the noise ({usual} {:.*} %)",
                    100.0 * fit.unexplained,
                    usize::from(fit.diffuse),
                    100.0 * unexplained
                ));
            }
            if recover == Recover::Lighting && fit.causes.structure > structure {
                found.push(format!(
                    "{:.1} % of the light field is unexplained beyond the noise and alike in neighbouring views and directions ({usual} {:.1} %), which reaches the light magnified about ten times",
                    100.0 * fit.causes.structure,
                    100.0 * structure
                ));
            }
            if let Some(broken) = fit.violation
                && broken > violation
            {
                found.push(format!(
                    "{:.2} % of the light field is unexplained beyond the noise by any light and any reciprocal BRDF ({usual} {:.2} %), which reaches the BRDF magnified many times",
                    100.0 * broken,
                    100.0 * violation
                ));
            }
            let across = fit.across.filter(|across| *across > across_limit);
            if let Some(across) = across {
                found.push(format!(
                    "the radiance changes {:.0} % as fast across the measurement plane as along it ({usual} {:.0} %), which light in the plane never does",
                    100.0 * across.sqrt(),
                    100.0 * across_limit.sqrt()
                ));
            }
            if fit.unsettled {
                found.push("the search for light and BRDF finds no end, however few the frequencies, so that nothing is known of their errors".into());
            }
            if fit.curved {
                found.push("another light and another BRDF explain the photographs far better if these are straightened".into());
            }
            if fit.beside {
                found.push(match recover {
                    Recover::Both => {
                        "another channel, of the same views and lamps, is explained by no light in the plane".into()
                    }
                    _ => "another channel, of the same photographs and lamps, is not explained".into(),
                });
            }
            // A stated light that is wrong may look like texture, and what breaks reciprocity is the model's whatever the rest looks like.
            let broken = fit.violation.is_some_and(|broken| broken > violation);
            let model_first = broken
                || recover == Recover::Brdf
                || across.is_some()
                || fit.beside
                // What a search without an end leaves is no residual.
                || fit.unsettled;
            let model = match across {
                Some(_) => OUT_OF_PLANE,
                None => model.as_str(),
            };
            let mut causes = fit.causes.ranked(model, model_first);
            if let Some(cause) = &recovered.cause {
                causes.insert(0, cause.clone());
            }
            Some(format!(
                "Channel {name}: {}. {consequence} Likeliest first: {}.",
                found.join(", and "),
                causes.join("; ")
            ))
        })
        .collect()
}

/// Plain sentences: what can and what cannot be known from this capture.
pub fn findings(recipe: &Recipe, measured: &Measured, recovered: &Recovered) -> Vec<String> {
    let mut findings = Vec::new();
    let coverage = measured.field.coverage(0, measured.limb_cut);
    findings.push(format!(
        "{} views give samples for {:.1} % of the light field's cells with |θo′| ≤ {:.0}°.",
        measured.views.len(),
        100.0 * coverage,
        measured.limb_cut.to_degrees()
    ));
    let accepted = |c: usize| {
        recovered
            .fit
            .get(c)
            .is_none_or(|f| f.verdict != Verdict::Refused)
    };
    if let Some(lighting) = &recovered.lighting {
        findings.extend(about_lighting(lighting, &accepted));
    }
    if let Some(brdf) = &recovered.brdf {
        findings.extend(about_brdf(brdf, &accepted));
    }
    for (c, gauge) in recovered.gauge.iter().enumerate() {
        if accepted(c) {
            findings.extend(about_gauge(gauge, recipe));
        }
    }
    if let Some(models) = &recovered.models {
        for channel in &models.channels {
            if let Some(best) = channel.fits.get(channel.best) {
                findings.push(format!(
                    "Channel {}: of the analytic models {} fits the slice best, to {} of its largest ρ cos θi′ cos θo′ (rms).",
                    channel.channel,
                    best.model,
                    percent(best.relative_rms)
                ));
            }
        }
    }
    grouped(findings)
}

/// A share in percent, to two significant digits.
fn percent(share: f64) -> String {
    let value = 100.0 * share;
    let decimals = if value > 0.0 && value.is_finite() {
        (1.0 - value.log10().floor()).clamp(0.0, 6.0) as usize
    } else {
        1
    };
    format!("{value:.decimals$} %")
}

/// Sentences that say the same of several channels, "Channel R: …", become one, at the place of the first.
pub fn grouped(sentences: Vec<String>) -> Vec<String> {
    let mut groups: Vec<(Vec<String>, String)> = Vec::new();
    for sentence in sentences {
        let split = sentence
            .strip_prefix("Channel ")
            .and_then(|rest| rest.split_once(": "));
        let Some((channel, rest)) = split else {
            groups.push((Vec::new(), sentence));
            continue;
        };
        match groups
            .iter_mut()
            .find(|(channels, said)| !channels.is_empty() && said == rest)
        {
            Some((channels, _)) => channels.push(channel.to_string()),
            None => groups.push((vec![channel.to_string()], rest.to_string())),
        }
    }
    groups
        .into_iter()
        .map(|(channels, rest)| match channels.as_slice() {
            [] => rest,
            [one] => format!("Channel {one}: {rest}"),
            many => format!("Channels {}: {rest}", many.join(", ")),
        })
        .collect()
}

/// The column with the most normals.
fn fullest(samples: &Samples) -> Option<&Column> {
    samples.columns.iter().max_by_key(|c| c.alpha.len())
}

/// The widest gap between neighbouring normals in the fullest column, radians.
fn widest_gap(samples: &Samples) -> f64 {
    let mut alpha = fullest(samples).map_or(Vec::new(), |c| c.alpha.clone());
    alpha.sort_by(f64::total_cmp);
    let around = match (alpha.first(), alpha.last()) {
        (Some(first), Some(last)) => first + TAU - last,
        _ => TAU,
    };
    alpha
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(around, f64::max)
}

/// Standard deviation over the normals of the fullest column, relative to their mean.
fn change_with_normal(samples: &Samples, channel: usize) -> f64 {
    let column = fullest(samples);
    let planes = column.and_then(|c| Some((c.value.get(channel)?, c.variance.get(channel)?)));
    let Some((values, variances)) = planes else {
        return 0.0;
    };
    let seen = values.iter().zip(variances).filter(|(_, v)| v.is_finite());
    let (n, sum, square) = seen.fold((0.0, 0.0, 0.0), |(n, sum, square), (b, _)| {
        (n + 1.0, sum + b, square + b * b)
    });
    let mean: f64 = sum / n;
    let variance: f64 = square / n - mean * mean;
    variance.max(0.0).sqrt() / mean.abs()
}

/// What makes a factorisation doubtful; what it leaves open by nature is a finding.
pub fn factorisation_warnings(found: &Factorisation, samples: &Samples) -> Vec<String> {
    let gap = widest_gap(samples);
    let mut said = Vec::new();
    for (c, channel) in found.channels.iter().enumerate() {
        let name = &channel.name;
        let hidden = gap > WIDE_GAP && change_with_normal(samples, c) > CHANGE;
        if channel.visible_band == 0 && hidden {
            said.push(format!(
                "Channel {name}: {:.0}° of the circle have no views, and what the light field does there may be anything: no frequency of it can be told. Light and BRDF together need views all round; one of them alone, with the other known, does not.",
                gap.to_degrees()
            ));
        } else if channel.visible_band == 0 {
            said.push(format!(
                "Channel {name}: the light field does not change with the normal. The light is uniform, or the surface passes nothing but its mean: no other frequency of the light is determined, and of the BRDF nothing but its mean over incidence."
            ));
        }
        if channel.misfit > factorise::MISFIT {
            said.push(format!(
                "Channel {name}: the light field breaks reciprocity by {:.1} times its stated noise; the error bars were widened by that. Light from out of the plane or from nearby, photographs that are not linear, a texture, an object that is not convex, or too small a noise estimate would do this.",
                channel.misfit.sqrt()
            ));
        }
    }
    said
}

fn about_lighting(lighting: &LightingEstimate, accepted: &dyn Fn(usize) -> bool) -> Vec<String> {
    let mut findings = Vec::new();
    for source in &lighting.sources {
        findings.push(format!("A source at {}.", source.direction()));
    }
    for (c, channel) in lighting.channels.iter().enumerate() {
        if !accepted(c) {
            findings.push(format!(
                "Channel {}: no lighting can be given, because none explains the photographs.",
                channel.name
            ));
            continue;
        }
        let open: Vec<usize> = (0..channel.spectrum.len())
            .filter(|&p| channel.spectrum[p].status == Status::Indeterminate)
            .collect();
        let band = match channel.determined_band {
            Some(band) => {
                format!("the light's frequencies up to p = {band} are determined by the photos")
            }
            None => "no frequency of the light is determined by the photos".into(),
        };
        let rest = match open.first() {
            Some(first) if open.len() + first == channel.spectrum.len() => {
                format!("; from p = {first} on the surface hides the light's detail")
            }
            Some(first) => format!(
                "; of the frequencies from p = {first} on, {} cannot be known through this surface",
                open.len()
            ),
            None => String::new(),
        };
        findings.push(format!("Channel {}: {band}{rest}.", channel.name));
    }
    findings
}

fn about_brdf(estimate: &BrdfEstimate, accepted: &dyn Fn(usize) -> bool) -> Vec<String> {
    estimate
        .slices
        .iter()
        .zip(&estimate.channels)
        .enumerate()
        .map(|(c, (slice, name))| {
            if !accepted(c) {
                return format!(
                    "Channel {name}: no BRDF can be given, because none explains the photographs."
                );
            }
            let [determined, weak, open] = [
                Status::Determined,
                Status::Weak,
                Status::Indeterminate,
            ]
            .map(|status| 100.0 * share(&slice.status, status));
            if determined == 0.0 && weak == 0.0 {
                let known = slice
                    .spectrum
                    .iter()
                    .filter(|k| k.status == Status::Determined)
                    .count();
                return format!(
                    "Channel {name}: this light determines no single value of the BRDF, only {known} averages over it (coefficients in brdf_spectrum.csv); light from a narrow direction would determine the values."
                );
            }
            let rest = match open {
                0.0 => "nothing of it is left open".into(),
                o if o < 1.0 => {
                    "only corners in which both directions graze are left empty".into()
                }
                o => format!(
                    "{o:.0} % cannot be known from these views under this light and is left empty"
                ),
            };
            format!(
                "Channel {name}: the photos alone determine {determined:.0} % of the BRDF slice (reciprocity included), and {weak:.0} % together with its smoothness; {rest}."
            )
        })
        .collect()
}

fn about_gauge(gauge: &ChannelGauge, recipe: &Recipe) -> Vec<String> {
    let name = &gauge.channel;
    let mut said = vec![format!("Channel {name}: {}", gauge.scale)];
    if !recipe.scale.is_given() {
        said[0].push_str(
            " A [scale] in the recipe (a reference albedo, a known source or total irradiance) would make both absolute.",
        );
    }
    if !gauge.undetermined.is_empty() {
        let names: Vec<String> = gauge.undetermined.iter().map(ToString::to_string).collect();
        said.push(format!(
            "Channel {name}: the light's frequencies {} are not determined by reciprocity.",
            names.join(", ")
        ));
    }
    if gauge.components.len() > 1 {
        said.push(format!(
            "Channel {name}: reciprocity ties the frequencies of the light together in {} groups; each beyond the first has a free factor of its own.",
            gauge.components.len()
        ));
    }
    if let Some(models) = &gauge.parametric
        && let Some(best) = models.fits.first()
    {
        said.push(format!(
            "Channel {name}: {} Of the analytic models fitted to the light field with the light unknown, {} explains it best; summary.json has its parameters and the light that goes with it.",
            models.reason, best.model
        ));
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;

    #[test]
    fn channels_that_share_a_sentence_share_it() {
        let said = ["All.", "Channel R: a.", "Channel G: b.", "Channel B: a."];
        assert_eq!(
            grouped(said.map(String::from).to_vec()),
            ["All.", "Channels R, B: a.", "Channel G: b."]
        );
    }

    #[test]
    fn the_widest_gap_is_found_across_the_end_of_the_circle() {
        let column = |degrees: &[f64]| Column {
            local: LocalAngle::degrees(0.0),
            alpha: degrees.iter().map(|d| d.to_radians()).collect(),
            view: (0..degrees.len() as u32).collect(),
            value: Vec::new(),
            variance: Vec::new(),
        };
        let gap = |columns: &[&[f64]]| {
            let samples = Samples {
                channels: Vec::new(),
                columns: columns.iter().map(|c| column(c)).collect(),
            };
            widest_gap(&samples).to_degrees()
        };
        assert!((gap(&[&[0.0], &[170.0, -60.0, 0.0, 60.0]]) - 130.0).abs() < 1e-9);
        assert!((gap(&[&[-90.0, 0.0, 85.0]]) - 185.0).abs() < 1e-9);
        assert_eq!(gap(&[&[]]), 360.0);
    }
}
