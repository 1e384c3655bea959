//! Equations 17–23: mirror and Lambertian surfaces, and the light that a Lambertian surface cannot show.

use std::f64::consts::TAU;

use num_complex::Complex64;

use super::{Curve, Paper, Plot, flat_lambertian, mixed, parts, test_light};
use crate::angle::{LocalAngle, NormalAngle, WorldAngle};
use crate::brdf::{Brdf, Material, Mirror, transfer_row};
use crate::error::Result;
use crate::fourier::Series;
use crate::grid::Grid;
use crate::lighting::Lighting;
use crate::reflect::{integral, product};

pub fn check(paper: &mut Paper) -> Result<()> {
    mirror(paper)?;
    lambertian(paper);
    invisible(paper)?;
    Ok(())
}

fn mirror(paper: &mut Paper) -> Result<()> {
    let brdf = Mirror { reflectance: 1.0 };
    paper.compare(
        "17",
        "a mirror is ρ̂ = δ(θi′ + θo′): nothing beside the mirror direction, and weight 1 in it",
        (-8..=8).flat_map(|k| {
            let local = LocalAngle::radians(0.19 * f64::from(k));
            let beside = LocalAngle::radians(0.05 - local.rad());
            [(0.0, brdf.value(beside, local)), (1.0, brdf.mirror(local))]
        }),
        0.0,
        "exact",
    );
    let pairs = (-8..=8).flat_map(|k| {
        let local = LocalAngle::radians(0.19 * f64::from(k));
        let row = transfer_row(&brdf, local, 12);
        // H_p = 2π ρ̂_{−p} = e^{−ipθo′}: ρ̂ = Σ_p e^{ip(θi′ + θo′)}/2π, so ρ̂_{p,q} = δ_{pq}/2π.
        (0..=12)
            .map(|p| {
                let closed = Complex64::cis(-f64::from(p) * local.rad()) / TAU;
                (closed, row[p as usize] / TAU)
            })
            .collect::<Vec<_>>()
    });
    paper.compare(
        "18",
        "a mirror passes every frequency alike: ρ̂_{p,q} = δ_{pq}/2π",
        parts(pairs),
        1e-14,
        "rounding",
    );
    let light = test_light();
    let material = Material {
        channels: vec!["Y".into()],
        brdfs: vec![std::sync::Arc::new(brdf)],
    };
    let lighting = Lighting::band_limited(material.channels.clone(), vec![light.clone()]);
    let grid = Grid {
        normals: 90,
        locals: 31,
    };
    let field = product::on_grid(&lighting, &material, grid, light.order())?;
    let pairs = (0..grid.normals).flat_map(|i| (0..grid.locals).map(move |j| (i, j)));
    paper.compare(
        "19",
        "a mirror shows the light: L(α − θo′) = B(α, θo′)",
        pairs.map(|(i, j)| {
            let seen = grid.normal(i).rad() - grid.local(j).rad();
            (light.evaluate(seen), field[0][grid.index(i, j)])
        }),
        1e-13,
        "rounding of seven terms",
    );
    Ok(())
}

/// The closed form of eq. 21 and 22 for the flatland albedo 1.
pub fn lambertian_coefficient(p: i64) -> f64 {
    let p = p.abs();
    match p {
        1 => 0.125,
        _ if p % 2 == 1 => 0.0,
        _ => {
            let half = p / 2;
            let sign = if half % 2 == 0 { -1.0 } else { 1.0 };
            sign / (TAU * (p * p - 1) as f64)
        }
    }
}

fn lambertian(paper: &mut Paper) {
    let row = transfer_row(&flat_lambertian(), LocalAngle::radians(0.4), 400);
    let ours = |p: usize| row[p].re / TAU;
    paper.compare(
        "20",
        "a Lambertian surface is a half cosine for every θo′: ρ̂ = ½ cos θi′ (flatland, albedo 1)",
        (-7..=7).flat_map(|k| {
            let incident = LocalAngle::radians(0.2 * f64::from(k));
            let cosine = incident.rad().cos();
            [-1.3, 0.0, 0.4].map(|o| {
                let rho = flat_lambertian().value(incident, LocalAngle::radians(o));
                (0.5 * cosine, rho * cosine)
            })
        }),
        1e-15,
        "rounding",
    );
    paper.compare(
        "21",
        "its odd terms: ρ̂_{±1} = 1/8, others 0",
        (1..400)
            .step_by(2)
            .map(|p| (lambertian_coefficient(p), ours(p as usize))),
        1e-13,
        "quadrature made for 1e-12 of ρ̂_0",
    );
    paper.compare(
        "22",
        "even terms ρ̂_{2p} = (−1)^{p+1} / (2π(4p² − 1))",
        (0..=400)
            .step_by(2)
            .map(|p| (lambertian_coefficient(p), ours(p as usize))),
        1e-13,
        "quadrature made for 1e-12 of ρ̂_0",
    );
    paper.plots.push(Plot {
        id: "lambertian",
        equation: "22",
        title: "The Lambertian spectrum and its closed form",
        caption: "Even terms; of the odd ones only p = 1 is there (1/8). Beyond p = 2 little is left of any light.".into(),
        x: "frequency p",
        y: "|ρ̂_[p]|",
        logarithmic: [false, true],
        curves: vec![
            Curve::line("1/(2π|p² − 1|)", even_points(|p| lambertian_coefficient(p as i64).abs())),
            Curve::discs("computed", even_points(|p| ours(p).abs())),
        ],
    });
}

fn even_points(f: impl Fn(usize) -> f64) -> Vec<(f64, f64)> {
    (0..=40).step_by(2).map(|p| (p as f64, f(p))).collect()
}

fn invisible(paper: &mut Paper) -> Result<()> {
    let mut striped = Series::zero(3);
    striped.coefficients[0] = Complex64::new(1.0, 0.0);
    striped.coefficients[3] = Complex64::new(0.5, 0.0);
    let light = Lighting::band_limited(vec!["Y".into()], vec![striped]);
    let brdf = flat_lambertian();
    paper.compare(
        "23",
        "1 + cos 3θ looks like 1 to a Lambertian surface: B = 1 everywhere",
        (0..60).map(|k| {
            let normal = NormalAngle::radians(0.105 * f64::from(k));
            (
                1.0,
                integral::value(&light, 0, &brdf, normal, LocalAngle::radians(0.3)),
            )
        }),
        1e-12,
        "by the angular integral, with no use of the Fourier form",
    );
    let glossy = mixed();
    let degrees = || (-60..=60).map(|k| 3.0 * f64::from(k));
    let picture = |brdf: &dyn Brdf| {
        let local = LocalAngle::radians(0.3);
        let white = Lighting::uniform(vec!["Y".into()], &[1.0]);
        let normal = NormalAngle::radians(0.0);
        let level = integral::value(&white, 0, brdf, normal, local);
        degrees()
            .map(|a| {
                let b = integral::value(&light, 0, brdf, NormalAngle::degrees(a), local);
                (a, b / level)
            })
            .collect::<Vec<_>>()
    };
    paper.plots.push(Plot {
        id: "invisible",
        equation: "23",
        title: "The invisible cos 3θ",
        caption: "The light 1 + cos 3θ and what surfaces make of it, by the angular integral, over their picture of uniform light: \
                  the Lambertian one shows nothing of the stripes."
            .into(),
        x: "θ or α / degrees",
        y: "relative to uniform light",
        logarithmic: [false, false],
        curves: vec![
            Curve::line("light", degrees().map(|a| (a, light.density(0, WorldAngle::degrees(a))))),
            Curve::line("Phong 32 and Lambert", picture(&glossy)),
            Curve::line("Lambert", picture(&brdf)),
        ],
    });
    misprint(paper);
    Ok(())
}

fn misprint(paper: &mut Paper) {
    let angles = || (0..60).map(|k| 0.1 * f64::from(k));
    let product = |x: f64| (3.0 * x).sin() * x.cos();
    let half_sum = |x: f64, sign: f64| 0.5 * ((4.0 * x).sin() + sign * (2.0 * x).sin());
    let wrong = angles().fold(0.0f64, |m, x| m.max((product(x) - half_sum(x, -1.0)).abs()));
    paper.compare(
        "23",
        "its second line has a minus between the sines in print: sin 3x cos x = ½(sin 4x + sin 2x)",
        angles().map(|x| (product(x), half_sum(x, 1.0))),
        1e-14,
        format!("misprint; as printed the two sides differ by up to {wrong:.2}, and the result stands all the same"),
    );
}
