//! Equation 30: the light field of a Lambertian surface, and how many terms of it are needed.

use std::f64::consts::TAU;

use num_complex::Complex64;

use super::surfaces::lambertian_coefficient;
use super::{Curve, Paper, Plot, flat_lambertian, parts};
use crate::angle::{LocalAngle, NormalAngle, WorldAngle};
use crate::fourier::Series;
use crate::lighting::{Lighting, Source};
use crate::reflect::{integral, product};

pub fn check(paper: &mut Paper) {
    let brdf = flat_lambertian();
    let series = Series {
        coefficients: (0..=24)
            .map(|p| Complex64::from_polar(1.0 / f64::from(p + 1), f64::from(p * p)))
            .collect(),
    };
    let b = product::column_series(&series, &brdf, LocalAngle::radians(0.0));
    paper.compare(
        "30",
        "under any light B_{2p} = L_{2p} (−1)^{p+1}/(4p² − 1), from p = 0 and with odd terms above 1 gone",
        parts((0..=24i64).map(|p| {
            (series.get(p) * TAU * lambertian_coefficient(p), b.get(p))
        })),
        1e-12,
        "quadrature made for 1e-12",
    );
    // How many terms a Lambertian picture needs: one source, whose picture is the half cosine itself.
    let sun = Lighting::from_sources(
        vec!["Y".into()],
        vec![Source {
            theta: WorldAngle::radians(0.0),
            irradiance: vec![1.0],
        }],
    );
    let row = sun.series(0, 80);
    let truth = |i: i32| {
        let normal = NormalAngle::radians(TAU * f64::from(i) / 4000.0);
        integral::value(&sun, 0, &brdf, normal, LocalAngle::radians(0.0))
    };
    let norm = (0..4000).map(|i| truth(i).powi(2)).sum::<f64>().sqrt();
    let cut_at = |order: usize| {
        let cut = product::column_series(&row.with_order(order), &brdf, LocalAngle::radians(0.0));
        let miss = (0..4000)
            .map(|i| (truth(i) - cut.evaluate(TAU * f64::from(i) / 4000.0)).powi(2))
            .sum::<f64>();
        miss.sqrt() / norm
    };
    // Parseval: the half cosine holds Σ|ρ̂_p|² = ∫(½ cos)²/2π = 1/16; so much is in the terms beyond.
    let predicted = |order: i64| {
        let inside: f64 = (-order..=order)
            .map(|p| lambertian_coefficient(p).powi(2))
            .sum();
        ((1.0 / 16.0 - inside) * 16.0).sqrt()
    };
    let orders = [0usize, 1, 2, 4, 8, 16, 32];
    paper.compare(
        "30",
        "what is left of a Lambertian picture under one source when it is cut at order 0, 1, 2 … 32",
        orders.map(|p| (predicted(p as i64), cut_at(p))),
        1e-5,
        "a mean over 4000 normals for the integral",
    );
    let levels = [0.01, 0.001];
    for level in levels {
        let needed = (0..=80).find(|&p| cut_at(p) <= level).unwrap_or(usize::MAX);
        let by_formula = (0..=80)
            .find(|&p| predicted(p) <= level)
            .unwrap_or(i64::MAX);
        paper.compare(
            "30",
            format!(
                "the order needed for {} % of the norm under one source",
                100.0 * level
            ),
            [(by_formula as f64, needed as f64)],
            0.0,
            "relighting against Parseval's sum over the closed form",
        );
    }
    let last = 80usize;
    paper.plots.push(Plot {
        id: "lambertian-terms",
        equation: "30",
        title: "How many terms a Lambertian picture needs",
        caption: "Relative error (L2) of the light field under one source, cut at order p; dotted lines of 1 % and 0.1 %.".into(),
        x: "order p",
        y: "relative error",
        logarithmic: [false, true],
        curves: [
            Curve::line("from eq. 30", (0..=last).map(|p| (p as f64, predicted(p as i64)))),
            Curve::discs("computed", (0..=last).step_by(2).map(|p| (p as f64, cut_at(p)))),
        ]
        .into_iter()
        .chain(levels.map(|l| Curve::line(format!("{} %", 100.0 * l), [(0.0, l), (last as f64, l)])))
        .collect(),
    });
}
