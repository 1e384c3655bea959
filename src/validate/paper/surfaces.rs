//! Equations 17–23 and 30–33: mirror, Lambertian, Phong and microfacet surfaces, and figure 3.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use num_complex::Complex64;

use super::{Curve, Double, Paper, Plot, flat_lambertian, flat_phong, parts, test_light};
use crate::angle::{LocalAngle, NormalAngle, WorldAngle};
use crate::brdf::{Brdf, Material, Mirror, transfer_row};
use crate::error::Result;
use crate::fourier::Series;
use crate::grid::Grid;
use crate::lighting::{Lighting, Source};
use crate::reflect::{integral, product};

pub fn check(paper: &mut Paper) -> Result<()> {
    mirror(paper)?;
    lambertian(paper);
    invisible(paper)?;
    irradiance(paper)?;
    phong(paper);
    microfacet(paper);
    Ok(())
}

fn mirror(paper: &mut Paper) -> Result<()> {
    let brdf = Mirror { reflectance: 1.0 };
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
        "17–18",
        "a mirror, ρ̂ = δ(θi′ + θo′), passes every frequency alike: ρ̂_{p,q} = δ_{pq}/2π",
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
fn lambertian_coefficient(p: i64) -> f64 {
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
        "20–21",
        "a Lambertian surface is a half cosine, the same for every θo′: ρ̂_{±1} = 1/8, other odd terms 0",
        (1..400).step_by(2).map(|p| (lambertian_coefficient(p), ours(p as usize))),
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
        title: "The Lambertian spectrum and its closed form".into(),
        x: "frequency p",
        y: "|ρ̂_p|",
        logarithmic: [false, true],
        curves: vec![
            Curve {
                name: "computed".into(),
                points: even_points(|p| ours(p).abs()),
            },
            Curve {
                name: "1/(2π(p² − 1))".into(),
                points: even_points(|p| lambertian_coefficient(p as i64).abs()),
            },
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
    paper.compare(
        "23",
        "its second line reads sin 3x cos x = ½(sin 4x − sin 2x) in print; the sign must be +",
        (0..60).map(|k| {
            let x = 0.1 * f64::from(k);
            (
                (3.0 * x).sin() * x.cos(),
                0.5 * ((4.0 * x).sin() + (2.0 * x).sin()),
            )
        }),
        1e-14,
        "a misprint; with − the two sides differ by up to 1, and the result stands all the same",
    );
    Ok(())
}

fn irradiance(paper: &mut Paper) -> Result<()> {
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
    for level in [0.01, 0.001] {
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
    paper.plots.push(Plot {
        id: "lambertian-terms",
        title: "Error of a Lambertian picture cut at order p, one source".into(),
        x: "order p",
        y: "relative error (L2)",
        logarithmic: [false, true],
        curves: vec![Curve {
            name: "computed".into(),
            points: (0..=80).map(|p| (p as f64, cut_at(p))).collect(),
        }],
    });
    Ok(())
}

/// Eq. 31: ρ̂_{−p}(0) of cos^β(θi′ + θo′); the Gamma functions of arguments below 0 carry their signs.
pub fn phong_coefficient(beta: f64, p: f64) -> f64 {
    let low = (3.0 - p + beta) / 2.0;
    if low <= 0.0 && low == low.round() {
        return 0.0;
    }
    let (numerator, _) = libm::lgamma_r(2.0 + beta);
    let (a, sign) = libm::lgamma_r(low);
    let (b, _) = libm::lgamma_r((3.0 + p + beta) / 2.0);
    f64::from(sign) * (numerator - beta * 2f64.ln() - a - b).exp() / 4.0
}

fn phong(paper: &mut Paper) {
    let at_normal = LocalAngle::radians(0.0);
    let spectrum = |beta: f64, order: usize| -> Vec<f64> {
        let row = transfer_row(&flat_phong(beta), at_normal, order);
        row.iter().map(|h| h.re / TAU).collect()
    };
    let betas = [0.0, 1.0, 2.0, 8.0, 32.0, 128.0, 1024.0];
    paper.compare(
        "31",
        "Phong at normal exitance: ρ̂_{−p}(0) = Γ(2+β) / (4·2^β Γ((3−p+β)/2) Γ((3+p+β)/2)), β = 0 … 1024",
        betas.iter().flat_map(|&beta| {
            let ours = spectrum(beta, 80);
            (0..=80).map(move |p| (phong_coefficient(beta, f64::from(p)), ours[p as usize]))
        }),
        1e-12,
        "quadrature made for 1e-12 of ρ̂_0 < 0.32, and ln Γ",
    );
    paper.compare(
        "32",
        "for whole β it vanishes at p = ±(β + 3 + 2k)",
        [0usize, 1, 2, 8].iter().flat_map(|&beta| {
            let ours = spectrum(beta as f64, 60);
            (0..10).map(move |k| (0.0, ours[beta + 3 + 2 * k]))
        }),
        1e-13,
        "quadrature made for 1e-12",
    );
    paper.compare(
        "32",
        "for |p| ≫ β + 3 it falls as |p|^{−(2+β)}: slope between p and 2p, p ≈ 100",
        [0.0f64, 1.0, 2.0].map(|beta| {
            // p of the parity that does not vanish.
            let p = if beta == 1.0 { 101 } else { 100 };
            let twice = if beta == 1.0 { 2 * p + 1 } else { 2 * p };
            let ours = spectrum(beta, twice);
            let slope = (ours[twice] / ours[p]).abs().ln() / (twice as f64 / p as f64).ln();
            (-(2.0 + beta), slope)
        }),
        5e-3,
        "(β + 3)³/(6p²) of the next term",
    );
    paper.compare(
        "33",
        "for |p| ≪ β it is near exp(−p²/(2(β+3))): ratio to ρ̂_0 for p² ≤ β, β = 128",
        {
            let ours = spectrum(128.0, 11);
            (0..=11).map(move |p| {
                let x = f64::from(p * p) / (2.0 * 131.0);
                ((-x).exp(), ours[p as usize] / ours[0])
            })
        },
        // ln ratio = −p²/(2(β+2)) + O(p⁴/β³): the difference of 1/(β+2) and 1/(β+3).
        8e-3,
        "1/β: the paper's constant is good to that",
    );
    paper.plots.push(Plot {
        id: "figure-3",
        title: "Figure 3: |ρ̂_p| of Phong surfaces at normal exitance".into(),
        x: "frequency p",
        y: "|ρ̂_p|",
        logarithmic: [false, false],
        curves: [0.0, 8.0, 128.0]
            .iter()
            .map(|&beta| {
                let ours = spectrum(beta, 40);
                Curve {
                    name: format!("β = {beta}"),
                    points: (-40i32..=40)
                        .map(|p| (f64::from(p), ours[p.unsigned_abs() as usize].abs()))
                        .collect(),
                }
            })
            .collect(),
    });
    paper.compare(
        "figure 3",
        "its three curves start at ρ̂_0 = Γ(2+β) / (4·2^β Γ((3+β)/2)²): 1/π, …",
        [0.0, 8.0, 128.0].map(|beta| (phong_coefficient(beta, 0.0), spectrum(beta, 0)[0])),
        1e-13,
        "quadrature made for 1e-12",
    );
}

/// ρ = exp(−((θi′ + θo′)/2)² / 2m²): the microfacet distribution alone.
#[derive(Debug)]
struct Distribution {
    m: f64,
}

impl Brdf for Distribution {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        if !(incident.is_visible() && exitant.is_visible()) {
            return 0.0;
        }
        let half = (incident.rad() + exitant.rad()) / 2.0;
        (-half * half / (2.0 * self.m * self.m)).exp()
    }

    fn lobe_width(&self) -> f64 {
        4.0 * self.m
    }
}

fn microfacet(paper: &mut Paper) {
    // A lobe of deviation 2m in θi′, and cos θi′ shifts its spectrum by ±1.
    let gaussian = |m: f64, p: f64| m * (TAU).sqrt() / PI * (-2.0 * m * m * p * p).exp();
    let closed = |m: f64, p: f64| 0.5 * (gaussian(m, p - 1.0) + gaussian(m, p + 1.0));
    let widths = [0.02, 0.05, 0.1];
    paper.compare(
        "microfacet",
        "the distribution exp(−((θi′+θo′)/2)²/2m²) has a Gaussian spectrum of width 1/(2m); θo′ = 0, m = 0.02 … 0.1",
        widths.iter().flat_map(|&m| {
            let row = transfer_row(&Distribution { m }, LocalAngle::radians(0.0), 120);
            (0..=120).map(move |p| (closed(m, f64::from(p)), row[p as usize].re / TAU))
        }),
        // Cut at ±90°: e^{−(π/2)²/(8m²)} = 4e-14 of the peak for m = 0.1.
        1e-12,
        "the cut at ±90° of the widest, and quadrature",
    );
    let mirror_like = Double::transfer(&Distribution { m: 0.02 }, 3, false);
    let diagonal = mirror_like.get(1, 1).norm();
    paper.compare(
        "microfacet",
        "a narrow lobe is nearly diagonal in (p, q), as a mirror is, but for the half circle: |ρ̂_{1,3}|/|ρ̂_{1,1}| → (cos sinc)",
        [(half_circle(2.0) / half_circle(0.0), mirror_like.get(1, 3).norm() / diagonal)],
        // The lobe's own width: (2m)²·p² on either coefficient.
        0.02,
        "width of the lobe against the frequencies, and its loss at the ends",
    );
    paper.plots.push(Plot {
        id: "microfacet",
        title: "Spectra of microfacet distributions at normal exitance".into(),
        x: "frequency p",
        y: "|ρ̂_p|/ρ̂_0",
        logarithmic: [false, false],
        curves: widths
            .iter()
            .map(|&m| {
                let row = transfer_row(&Distribution { m }, LocalAngle::radians(0.0), 100);
                Curve {
                    name: format!("m = {m}"),
                    points: (0..=100)
                        .map(|p| (p as f64, row[p].norm() / row[0].norm()))
                        .collect(),
                }
            })
            .collect(),
    });
}

/// |∫ cos θ e^{ikθ} dθ| over the visible half circle: what a mirror that is cut there, with its cosine,
/// has at p − q = k.
fn half_circle(k: f64) -> f64 {
    if (k.abs() - 1.0).abs() < 1e-12 {
        return FRAC_PI_2;
    }
    (2.0 * (k * FRAC_PI_2).cos() / (1.0 - k * k)).abs()
}
