//! Equations 24–28: the BRDF from known light; a directional source; uniform light.

use std::f64::consts::TAU;

use num_complex::Complex64;

use super::{Curve, Double, Paper, Plot, exitant_nodes, mixed, parts, test_light};
use crate::angle::{LocalAngle, NormalAngle, WorldAngle};
use crate::brdf::Brdf;
use crate::error::Result;
use crate::fourier::CircleTransform;
use crate::lighting::{Lighting, Source};
use crate::reflect::integral;

const ORDER: i64 = 6;

pub fn check(paper: &mut Paper) -> Result<()> {
    let brdf = mixed();
    let transfer = Double::transfer(&brdf, ORDER, false);
    let scale = transfer.get(0, 0).norm();

    let light = Lighting::band_limited(vec!["Y".into()], vec![test_light()]);
    let field = measured(&light, &brdf, 16);
    let series = light.series(0, ORDER as usize);
    let smallest = (0..=ORDER)
        .map(|p| series.get(p).norm())
        .fold(f64::MAX, f64::min);
    paper.compare(
        "24",
        "the BRDF from known light: ρ̂_{p,q} = B_{−p,q} / (2π L_{−p})",
        parts(transfer.indices().map(|(p, q)| {
            let found = field.get(-p, q) / (TAU * series.get(-p));
            (transfer.get(p, q), found)
        })),
        1e-10 * scale / smallest,
        "1e-10 of ρ̂_{0,0} over the smallest L_p",
    );

    let sun = Lighting::from_sources(
        vec!["Y".into()],
        vec![Source {
            theta: WorldAngle::radians(0.0),
            irradiance: vec![1.0],
        }],
    );
    let series = sun.series(0, 50);
    paper.compare(
        "25",
        "a source at θ = 0 holds all frequencies alike: L_p = 1/2π",
        parts(
            series
                .coefficients
                .iter()
                .map(|&l| (Complex64::new(1.0 / TAU, 0.0), l)),
        ),
        1e-16,
        "rounding",
    );
    // The picture of a source is not band-limited: 8192 normals fold back what lies beyond.
    let field = measured(&sun, &brdf, 8192);
    paper.compare(
        "26",
        "under it the light field is the BRDF: B_{p,q} = ρ̂_{−p,q}",
        parts(field.indices().map(|(p, q)| (transfer.get(-p, q), field.get(p, q)))),
        1e-6 * scale,
        "8192 normals: coefficients fall with 1/p², what folds back is 2/8192² of ρ̂_{0,0} times its slope",
    );
    paper.compare(
        "27",
        "B(α, θo′) = ρ̂(−α, θo′)",
        (-20..=20).flat_map(|k| {
            let normal = NormalAngle::radians(0.074 * f64::from(k));
            [-1.2, 0.0, 0.7].map(|o| {
                let local = LocalAngle::radians(o);
                let incident = LocalAngle::radians(-normal.rad());
                let rho = brdf.value(incident, local) * normal.rad().cos();
                (rho, integral::value(&sun, 0, &brdf, normal, local))
            })
        }),
        1e-13,
        "rounding of the angle, times the exponent 32",
    );

    let exitant = LocalAngle::degrees(40.0);
    let degrees = || (-60..=60).map(|k| 3.0 * f64::from(k));
    let seen = degrees().map(|a| {
        let normal = NormalAngle::degrees(a);
        (a, integral::value(&sun, 0, &brdf, normal, exitant))
    });
    let slice = degrees().map(|a| {
        let incident = WorldAngle::radians(0.0) - NormalAngle::degrees(a);
        (a, brdf.value(incident, exitant) * incident.visible_cosine())
    });
    let (seen, slice): (Vec<_>, Vec<_>) = (seen.collect(), slice.collect());

    let uniform = Lighting::uniform(vec!["Y".into()], &[1.0 / TAU]);
    paper.compare(
        "28",
        "uniform light L = 1/2π has L_0 = 1/2π and nothing else",
        parts((0..=5).map(|p| {
            let closed = if p == 0 { 1.0 / TAU } else { 0.0 };
            (Complex64::new(closed, 0.0), uniform.series(0, 5).get(p))
        })),
        1e-16,
        "misprint in the text, which says L_0 = 1; with eq. 6 it is 1/2π, and eq. 28 uses that",
    );
    let flat = degrees().map(|a| {
        let normal = NormalAngle::degrees(a);
        (a, integral::value(&uniform, 0, &brdf, normal, exitant))
    });
    paper.plots.push(Plot {
        id: "directional",
        equation: "27",
        title: "Directional and uniform light",
        caption:
            "B(α, 40°): a source shows the whole BRDF turned round, uniform light only its mean."
                .into(),
        x: "α / degrees",
        y: "B / W m⁻² sr⁻¹",
        logarithmic: [false, false],
        curves: vec![
            Curve::line("ρ̂(−α, 40°)", slice),
            Curve::discs("B under a source", seen.into_iter().step_by(2)),
            Curve::line("B under uniform light", flat),
        ],
    });
    let field = measured(&uniform, &brdf, 16);
    let rows = (-ORDER..=ORDER).map(|q| (transfer.get(0, q), field.get(0, q)));
    let others = field
        .indices()
        .filter(|(p, _)| *p != 0)
        .map(|(p, q)| (Complex64::ZERO, field.get(p, q)));
    paper.compare(
        "28",
        "under uniform light only ρ̂_{0,q} = B_{0,q} is seen; all other B_{p,q} vanish",
        parts(rows.chain(others).collect::<Vec<_>>()),
        1e-10 * scale,
        "1e-10 of ρ̂_{0,0}",
    );
    Ok(())
}

/// B_{p,q} of the light field that the angular integral gives at `normals` regular α.
fn measured(light: &Lighting, brdf: &dyn Brdf, normals: usize) -> Double {
    let nodes = exitant_nodes(brdf);
    let circle = CircleTransform::new(normals, -std::f64::consts::PI);
    let rows: Vec<Vec<Complex64>> = nodes
        .iter()
        .map(|&(local, _)| {
            let column: Vec<f64> = (0..normals)
                .map(|i| {
                    let normal = NormalAngle::radians(circle.angle(i));
                    integral::value(light, 0, brdf, normal, local)
                })
                .collect();
            let b = circle.analyse(&column, ORDER as usize);
            (-ORDER..=ORDER).map(|p| b.get(p)).collect()
        })
        .collect();
    Double::from_rows(ORDER, &nodes, &rows)
}
