//! The answer as tables.

use super::figure::{irradiance_unit, lighting_unit};
use super::number::{percent, short, with_sigma};
use crate::pipeline::Run;
use crate::recover::Status;

/// A table of words and formatted numbers; the first cell of a row is its heading.
#[derive(Clone, Debug)]
pub struct ResultTable {
    /// Title.
    pub title: String,
    /// Headings.
    pub columns: Vec<String>,
    /// Rows as long as the headings.
    pub rows: Vec<Vec<String>>,
}

/// What was found, in the order of interest.
pub fn tables(run: &Run) -> Vec<ResultTable> {
    let mut out = Vec::new();
    if let Some(lighting) = &run.lighting {
        if !lighting.sources.is_empty() {
            let mut columns = vec!["source".to_owned(), "direction / degrees".to_owned()];
            columns.extend(
                lighting
                    .channels
                    .iter()
                    .map(|c| format!("irradiance {} / {}", c.name, irradiance_unit(run))),
            );
            let rows = lighting
                .sources
                .iter()
                .enumerate()
                .map(|(i, s)| {
                    let mut row = vec![
                        (i + 1).to_string(),
                        with_sigma(s.theta_deg, s.theta_sigma_deg),
                    ];
                    row.extend((0..lighting.channels.len()).map(|c| {
                        match (s.irradiance.get(c), s.irradiance_sigma.get(c)) {
                            (Some(e), Some(sigma)) => with_sigma(*e, *sigma),
                            _ => "—".to_owned(),
                        }
                    }));
                    row
                })
                .collect();
            out.push(ResultTable {
                title: "Directional sources (± one standard deviation)".to_owned(),
                columns,
                rows,
            });
        }
        let rows = lighting
            .channels
            .iter()
            .map(|c| {
                let total = c.spectrum.first().map_or("—".to_owned(), |l| {
                    with_sigma(
                        std::f64::consts::TAU * l.value.re,
                        std::f64::consts::TAU * l.sigma,
                    )
                });
                let count = |status| c.spectrum.iter().filter(|l| l.status == status).count();
                vec![
                    c.name.clone(),
                    total,
                    c.determined_band
                        .map_or("none".to_owned(), |p| format!("p ≤ {p}")),
                    format!(
                        "{} / {} / {}",
                        count(Status::Determined),
                        count(Status::Weak),
                        count(Status::Indeterminate)
                    ),
                    percent(c.residual_relative),
                    short(c.chi2, 3),
                ]
            })
            .collect();
        out.push(ResultTable {
            title: format!("Lighting, L in {}", lighting_unit(run)),
            columns: [
                "channel".to_owned(),
                format!("total irradiance ∫L dθ / {}", irradiance_unit(run)),
                "determined band".to_owned(),
                "determined / weak / indeterminate".to_owned(),
                "residual rms / maximum".to_owned(),
                "χ² per sample".to_owned(),
            ]
            .to_vec(),
            rows,
        });
    }
    out.extend(brdf(run));
    out.extend(models(run));
    out.extend(gauge(run));
    let field = &run.light_field;
    let rows = field
        .channels
        .iter()
        .enumerate()
        .map(|(c, name)| {
            let (mut largest, mut squares, mut cells) = (0.0f64, 0.0f64, 0usize);
            for ((mean, sigma), weight) in field.mean[c]
                .iter()
                .zip(&field.sigma[c])
                .zip(&field.weight[c])
            {
                if *weight > 0.0 && mean.is_finite() && sigma.is_finite() {
                    largest = largest.max(f64::from(*mean));
                    squares += f64::from(*sigma).powi(2);
                    cells += 1;
                }
            }
            let typical = (squares / cells.max(1) as f64).sqrt();
            vec![
                name.clone(),
                short(largest, 4),
                if cells == 0 {
                    "—".to_owned()
                } else {
                    short(typical, 2)
                },
                percent(field.coverage(c, run.limb_cut)),
            ]
        })
        .collect();
    out.push(ResultTable {
        title: format!("Light field, B in {}", run.radiance_unit),
        columns: [
            "channel",
            "largest value",
            "rms σ per cell",
            "coverage within the limb cut",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows,
    });
    out
}

/// The recovered slice.
fn brdf(run: &Run) -> Option<ResultTable> {
    let brdf = run.brdf.as_ref()?;
    let rows = brdf
        .channels
        .iter()
        .zip(&brdf.slices)
        .enumerate()
        .map(|(c, (name, slice))| {
            let share = |status| {
                let count = slice.status.iter().filter(|s| **s == status).count();
                percent(count as f64 / slice.status.len().max(1) as f64)
            };
            let fit = run.fit.get(c);
            vec![
                name.clone(),
                share(Status::Determined),
                share(Status::Weak),
                share(Status::Indeterminate),
                format!("{}°", short(slice.resolution.to_degrees(), 2)),
                short(slice.parameters, 3),
                fit.map_or("—".to_owned(), |f| percent(f.residual_relative)),
                fit.map_or("—".to_owned(), |f| percent(f.unexplained)),
            ]
        })
        .collect();
    Some(ResultTable {
        title: "BRDF slice in sr⁻¹, in the plane of incidence".to_owned(),
        columns: [
            "channel",
            "determined",
            "weak",
            "indeterminate",
            "knots every",
            "effective parameters",
            "residual rms / maximum",
            "unexplained beyond noise",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows,
    })
}

/// How many models of a channel are listed.
const MODELS: usize = 5;

/// The analytic models that fit best.
fn models(run: &Run) -> Option<ResultTable> {
    let models = run.models.as_ref()?;
    let mut rows = Vec::new();
    for channel in &models.channels {
        let lowest = |pick: fn(&crate::brdf::fit::ModelFit) -> f64| {
            channel.fits.iter().map(pick).fold(f64::INFINITY, f64::min)
        };
        let (aic, bic) = (lowest(|f| f.aic), lowest(|f| f.bic));
        for fit in channel.fits.iter().take(MODELS) {
            let parameters: Vec<String> = fit
                .parameters
                .iter()
                .map(|p| match p.sigma {
                    Some(sigma) => format!("{} {}", p.name, with_sigma(p.value, sigma)),
                    None => format!("{} {}", p.name, short(p.value, 4)),
                })
                .collect();
            rows.push(vec![
                channel.channel.clone(),
                fit.model.clone(),
                percent(fit.relative_rms),
                short(fit.aic - aic, 3),
                short(fit.bic - bic, 3),
                parameters.join(", "),
            ]);
        }
    }
    (!rows.is_empty()).then(|| ResultTable {
        title: "Analytic models fitted to the slice (± one standard deviation)".to_owned(),
        columns: [
            "channel",
            "model",
            "rms of ρ cos cos / maximum",
            "ΔAIC",
            "ΔBIC",
            "parameters",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows,
    })
}

/// What a recovery of both left free.
fn gauge(run: &Run) -> Option<ResultTable> {
    if run.gauge.is_empty() {
        return None;
    }
    let rows = run
        .gauge
        .iter()
        .map(|g| {
            let undetermined: Vec<String> =
                g.undetermined.iter().map(ToString::to_string).collect();
            vec![
                g.channel.clone(),
                g.components.len().to_string(),
                if undetermined.is_empty() {
                    "none".to_owned()
                } else {
                    undetermined.join(", ")
                },
                short(g.misfit, 3),
                percent(g.ratios_difference),
                percent(g.eigenproblem_difference),
            ]
        })
        .collect();
    Some(ResultTable {
        title: "Light and material told apart by reciprocity".to_owned(),
        columns: [
            "channel",
            "free factors",
            "light's frequencies not determined",
            "misfit / noise",
            "eq. 29 differs by",
            "eigenproblem differs by",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows,
    })
}
