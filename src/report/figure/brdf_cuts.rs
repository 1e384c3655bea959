//! The slice along θi′ at a few exitant directions, with its band and the model that fits best.

use super::lighting_curve::SIGMAS_95;
use super::{FULL, Figure, Panel, image_channels, two_scales};
use crate::angle::LocalAngle;
use crate::brdf::fit::ModelFit;
use crate::pipeline::Run;
use crate::recover::brdf::BrdfEstimate;
use crate::report::plot::{Axis, Legend, Mark, Plot, Scale, Size, bounds};
use crate::report::table::{Cell, Table};

/// Exitant directions that are shown, degrees.
const EXITANT_DEG: [f64; 4] = [0.0, 30.0, 60.0, 75.0];
const CLASSES: [&str; 4] = ["s-a", "s-b", "s-c", "s-d"];

/// One point of a cut.
struct Point {
    incident_deg: f64,
    /// ρ cos θi′ cos θo′ and its σ; NaN where indeterminate.
    value: f64,
    sigma: f64,
    /// The best model's value; NaN without one.
    model: f64,
}

/// A cut at the cell nearest to `exitant_deg`.
fn cut(brdf: &BrdfEstimate, c: usize, exitant_deg: f64, model: Option<&ModelFit>) -> Vec<Point> {
    let n = brdf.size;
    let j = (((exitant_deg + 90.0) / 180.0 * n as f64) as usize).min(n.saturating_sub(1));
    (0..n)
        .map(|i| {
            let (a, b) = (brdf.angle(i), brdf.angle(j));
            let cosines = a.cos() * b.cos();
            let (rho, sigma) = brdf.rho(c, i, j).unwrap_or((f64::NAN, f64::NAN));
            let model = model.map_or(f64::NAN, |m| {
                m.brdf.value(LocalAngle::radians(a), LocalAngle::radians(b))
            });
            Point {
                incident_deg: a.to_degrees(),
                value: rho * cosines,
                sigma: sigma * cosines,
                model: model * cosines,
            }
        })
        .collect()
}

/// ρ cos θi′ cos θo′ against θi′ with 95 % bands, a panel per channel.
pub fn brdf_cuts(run: &Run) -> Option<Figure> {
    let brdf = run.brdf.as_ref()?;
    let best = |name: &str| -> Option<&ModelFit> {
        let channel = run
            .models
            .as_ref()?
            .channels
            .iter()
            .find(|m| m.channel == name)?;
        channel.fits.get(channel.best)
    };
    let mut rows = Vec::new();
    let mut panels = Vec::new();
    let mut named = Vec::new();
    for c in image_channels(brdf.slices.len()) {
        let name = &brdf.channels[c];
        let model = best(name);
        if let Some(model) = model {
            named.push(format!("{name} {}", model.model));
        }
        let cuts: Vec<Vec<Point>> = EXITANT_DEG
            .iter()
            .map(|deg| cut(brdf, c, *deg, model))
            .collect();
        if cuts.iter().flatten().all(|p| !p.value.is_finite()) {
            continue;
        }
        for (deg, points) in EXITANT_DEG.iter().zip(&cuts) {
            rows.extend(points.iter().step_by(2).map(|p| {
                vec![
                    Cell::Text(name.clone()),
                    Cell::Fixed(*deg, 0),
                    Cell::Fixed(p.incident_deg, 2),
                    Cell::Number(p.value),
                    Cell::Number(p.sigma),
                    Cell::Number(p.model),
                ]
            }));
        }
        panels.push(Panel {
            name: name.clone(),
            markup: {
                let [linear, log] = scales(&cuts).map(|scale| {
                    let drawn = FULL.map(|size| draw(&cuts, name, model.is_some(), size, scale));
                    drawn.concat()
                });
                two_scales(&format!("brdf-cuts-{name}"), &linear, &log)
            },
        });
    }
    let model = if named.is_empty() {
        String::new()
    } else {
        format!(
            " Dotted: the analytic model that fits best ({}).",
            named.join(", ")
        )
    };
    (!panels.is_empty()).then(|| Figure {
        id: "brdf-cuts",
        title: "Cuts through the slice",
        caption: format!(
            "ρ cos θ_[i]′ cos θ_[o]′ against the incident direction at fixed exitant directions, with 95 % bands. A lobe about the mirror direction peaks at θ_[i]′ = −θ_[o]′.{model}"
        ),
        panels,
        table: Table {
            columns: [
                "channel",
                "theta_o_deg",
                "theta_i_deg",
                "rho_cos_cos",
                "sigma",
                "model",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows,
            note: "ρ itself is in brdf.csv.".to_owned(),
        },
        wide: true,
    })
}

/// A linear axis that holds all cuts, and a logarithmic one over at most four decades.
fn scales(cuts: &[Vec<Point>]) -> [Scale; 2] {
    let values = || cuts.iter().flatten().map(|p| p.value);
    let (low, high) = bounds(values());
    [
        Scale::linear(low.min(0.0), 1.06 * high),
        Scale::log_around(values(), 4.0),
    ]
}

fn draw(cuts: &[Vec<Point>], name: &str, has_model: bool, size: Size, scale: Scale) -> String {
    let mut legend: Vec<Legend> = EXITANT_DEG
        .iter()
        .zip(CLASSES)
        .map(|(deg, class)| Legend {
            class: class.to_owned(),
            mark: Mark::Line,
            label: format!("θₒ′ = {deg}°"),
        })
        .collect();
    legend.push(Legend {
        class: "s-n".to_owned(),
        mark: Mark::Band,
        label: "95 % band".to_owned(),
    });
    if has_model {
        legend.push(Legend {
            class: "floor".to_owned(),
            mark: Mark::Line,
            label: "model".to_owned(),
        });
    }
    let step = if size.is_wide() { 15.0 } else { 45.0 };
    let mut plot = Plot::new(
        size,
        300.0,
        Axis::degrees("incident direction θ_[i]′ / degrees", -90.0, 90.0, step),
        Axis::new("ρ cos θ_[i]′ cos θ_[o]′ / sr⁻¹", scale, 6),
    )
    .with_legend(legend);
    let thin = if size.is_wide() { 1 } else { 2 };
    for (points, class) in cuts.iter().zip(CLASSES) {
        let points = || points.iter().step_by(thin);
        let band: Vec<_> = points()
            .map(|p| {
                let half = SIGMAS_95 * p.sigma;
                (p.incident_deg, p.value - half, p.value + half)
            })
            .collect();
        plot.band(&band, class);
        let line: Vec<_> = points().map(|p| (p.incident_deg, p.value)).collect();
        plot.line(&line, class);
        if has_model {
            let model: Vec<_> = points().map(|p| (p.incident_deg, p.model)).collect();
            plot.line(&model, &format!("floor {class}"));
        }
    }
    plot.finish(
        &format!(
            "Cuts through the BRDF slice of channel {name} at exitant directions 0, 30, 60 and 75 degrees, with 95 percent bands."
        ),
        "data-curve=\"theta_i_deg\"",
    )
}
