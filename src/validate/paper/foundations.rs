//! Equations 1–16: angles, the reflection equation, its Fourier form, and inverse lighting.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use num_complex::Complex64;

use super::{Curve, Double, Paper, Plot, exitant_nodes, mixed, parts, test_light};
use crate::angle::{LocalAngle, NormalAngle, WorldAngle};
use crate::brdf::{Brdf, transfer_row};
use crate::error::Result;
use crate::fourier::{CircleTransform, Series};
use crate::lighting::Lighting;
use crate::reflect::{integral, product};

const ORDER: i64 = 6;

pub fn check(paper: &mut Paper) -> Result<()> {
    let brdf = mixed();
    let series = test_light();
    let light = Lighting::band_limited(vec!["Y".into()], vec![series.clone()]);
    let places: Vec<(NormalAngle, LocalAngle)> = (0..24)
        .map(|k| {
            let normal = NormalAngle::radians(-3.0 + 0.26 * f64::from(k));
            (
                normal,
                LocalAngle::radians(1.5 * (f64::from(k) * 0.7).sin()),
            )
        })
        .collect();

    paper.compare(
        "1",
        "θ = α + θ′: global and local directions differ by the normal's",
        places.iter().flat_map(|&(a, o)| {
            let exitant = a + o;
            [
                (a.rad() + o.rad(), exitant.rad()),
                (o.rad(), (exitant - a).rad()),
            ]
        }),
        1e-14,
        "rounding",
    );

    // The reflection equation as a plain sum over global directions, with nothing of the library but ρ.
    let plain = |normal: NormalAngle, local: LocalAngle| {
        let n = 40_000;
        let step = TAU / f64::from(n);
        (0..n)
            .map(|k| {
                let theta = WorldAngle::radians((f64::from(k) + 0.5) * step);
                let incident = theta - normal;
                let l = series.evaluate(theta.rad());
                l * brdf.value(incident, local) * incident.visible_cosine() * step
            })
            .sum::<f64>()
    };
    let integral = |(a, o): (NormalAngle, LocalAngle)| integral::value(&light, 0, &brdf, a, o);
    paper.compare(
        "2",
        "B = ∫ L ρ cos θi′ over the directions above the surface",
        places.iter().map(|&(a, o)| (plain(a, o), integral((a, o)))),
        1e-7,
        "a midpoint sum of 40 000 directions: step²/24 of the kinks' jumps",
    );
    paper.compare(
        "3",
        "ρ̂ = ρ cos θi′: H_0(θo′) is the integral of ρ cos θi′",
        places.iter().map(|&(_, o)| {
            let n = 20_000;
            let step = PI / f64::from(n);
            let sum: f64 = (0..n)
                .map(|k| {
                    let i = LocalAngle::radians(-FRAC_PI_2 + (f64::from(k) + 0.5) * step);
                    brdf.value(i, o) * i.rad().cos() * step
                })
                .sum();
            (sum, transfer_row(&brdf, o, 0)[0].re)
        }),
        1e-7,
        "a midpoint sum of 20 000 directions",
    );
    let both_ways = |&(a, o): &(NormalAngle, LocalAngle)| {
        let column = product::column_series(&series, &brdf, o);
        (integral((a, o)), column.evaluate(a.rad()))
    };
    paper.compare(
        "4",
        "B(α, θo′) = ∫ L(α + θi′) ρ̂(θi′, θo′) dθi′ equals the product form",
        places.iter().map(both_ways),
        1e-10 * size(&places, integral),
        "1e-10 of the largest value: both quadratures are made for 1e-12",
    );
    let reciprocal = Double::transfer(&brdf, ORDER, true);
    let scale = reciprocal.get(0, 0).norm();
    paper.compare(
        "5",
        "ρ̃ = ρ cos θi′ cos θo′ is symmetric: ρ̃_{p,q} = ρ̃_{q,p}",
        parts(
            reciprocal
                .indices()
                .map(|(p, q)| (reciprocal.get(p, q), reciprocal.get(q, p))),
        ),
        1e-10 * scale,
        "quadrature over θi′ and over θo′ are different",
    );

    let circle = CircleTransform::new(64, 0.3);
    let samples: Vec<f64> = (0..64).map(|i| series.evaluate(circle.angle(i))).collect();
    let analysed = circle.analyse(&samples, 6);
    paper.compare(
        "6",
        "f_k = (1/2π) ∫ f e^{−ikθ} dθ and f = Σ f_k e^{ikθ} are inverses",
        parts(
            series
                .coefficients
                .iter()
                .copied()
                .zip(analysed.coefficients),
        ),
        1e-14,
        "rounding",
    );
    let local = LocalAngle::degrees(40.0);
    let column = product::column_series(&series, &brdf, local);
    let circle: Vec<f64> = (-90..=90).map(|k| 2.0 * f64::from(k)).collect();
    let values = |f: &dyn Fn(NormalAngle) -> f64| -> Vec<(f64, f64)> {
        let at = circle.iter().map(|&a| (a, f(NormalAngle::degrees(a))));
        at.collect()
    };
    let by_product = values(&|a| column.evaluate(a.rad()));
    let by_integral = values(&|a| integral((a, local)));
    let largest = by_integral.iter().fold(0.0f64, |m, p| m.max(p.1.abs()));
    let difference = by_product.iter().zip(&by_integral);
    // What is equal to the last bit is drawn at the bit.
    let difference: Vec<(f64, f64)> = difference
        .map(|(p, i)| (p.0, ((p.1 - i.1).abs() / largest).max(f64::EPSILON)))
        .collect();
    paper.plots.push(Plot {
        id: "product-integral",
        equation: "4",
        title: "Product form and angular integral",
        caption: "B(α, 40°) of a surface of 0.3 Lambert and 0.7 Phong 32 under light of order 6, by both.".into(),
        x: "α / degrees",
        y: "B / W m⁻² sr⁻¹",
        logarithmic: [false, false],
        curves: vec![
            Curve::line("angular integral", by_integral),
            Curve::discs("product form", by_product.iter().copied().step_by(6)),
        ],
    });
    paper.plots.push(Plot {
        id: "product-integral-difference",
        equation: "4",
        title: "Their difference",
        caption: "Relative to the largest value. The promise is 10⁻¹⁰ for band-limited light."
            .into(),
        x: "α / degrees",
        y: "|difference| / largest B",
        logarithmic: [false, true],
        curves: vec![
            Curve::line("difference", difference),
            Curve::line("promised", [(-180.0, 1e-10), (180.0, 1e-10)]),
        ],
    });
    shifts(paper, &light);
    expansions(paper, &brdf, &series, &light);
    product_form(paper, &brdf, &light);
    Ok(())
}

fn size<T: Copy>(places: &[T], f: impl Fn(T) -> f64) -> f64 {
    places.iter().fold(0.0f64, |m, &p| m.max(f(p).abs()))
}

/// Equations 7–10: a turned normal multiplies the light's coefficients by phases, and the exponentials
/// are orthogonal.
fn shifts(paper: &mut Paper, light: &Lighting) {
    let series = light.series(0, ORDER as usize);
    let alpha = 0.83;
    // L(α + θi′) as a function of θi′ is the light turned by −α.
    let turned = light.rotated(-alpha).series(0, ORDER as usize);
    paper.compare(
        "7–10",
        "L(α + θi′) has the coefficients L_p e^{ipα}",
        parts(
            series
                .coefficients
                .iter()
                .enumerate()
                .map(|(p, l)| (l * Complex64::cis(p as f64 * alpha), turned.coefficients[p])),
        ),
        1e-14,
        "rounding",
    );
    let circle = CircleTransform::new(48, -PI);
    let pairs = (0..=6usize).flat_map(|p| {
        let cosine: Vec<f64> = (0..48)
            .map(|i| (p as f64 * circle.angle(i)).cos())
            .collect();
        let found = circle.analyse(&cosine, 6).coefficients;
        (0..=6usize).map(move |q| {
            let expected = if p != q {
                0.0
            } else if p == 0 {
                1.0
            } else {
                0.5
            };
            (expected, found[q].re)
        })
    });
    paper.compare(
        "7–10",
        "(1/2π) ∫ e^{ipθ} e^{−iqθ} dθ = δ_{pq}: cos pθ has the coefficients ½ at ±p only",
        pairs.collect::<Vec<_>>(),
        1e-14,
        "rounding",
    );
}

/// The rest of equations 7–10: the two expansions and the double sum that orthogonality makes a single
/// one.
fn expansions(paper: &mut Paper, brdf: &dyn Brdf, light: &Series, lighting: &Lighting) {
    let angles = || (0..24).map(|k| -3.0 + 0.26 * f64::from(k));
    paper.compare(
        "7–10",
        "the light is its series: L(θi) = Σ_p L_p e^{ipθi}",
        angles().map(|theta| {
            let sum: Complex64 = (-ORDER..=ORDER)
                .map(|p| light.get(p) * Complex64::cis(p as f64 * theta))
                .sum();
            (lighting.density(0, WorldAngle::radians(theta)), sum.re)
        }),
        1e-14,
        "rounding of 13 terms",
    );
    const MOST: usize = 400;
    let local = LocalAngle::radians(0.3);
    let row = transfer_row(brdf, local, MOST);
    let edges: f64 = [-FRAC_PI_2, FRAC_PI_2]
        .map(|a| brdf.value(LocalAngle::radians(a * (1.0 - 1e-9)), local))
        .iter()
        .sum();
    paper.compare(
        "7–10",
        "and so is the transfer function: ρ̂(θi′, θo′) = Σ_p ρ̂_p(θo′) e^{ipθi′}, here |p| ≤ 400",
        (0..23).map(|k| {
            let a = -1.5 + 0.13 * f64::from(k);
            let sum: f64 = row
                .iter()
                .enumerate()
                // ρ̂_p = conj H_p / 2π, and the terms of ±p are conjugate.
                .map(|(p, h)| {
                    let term = (h.conj() * Complex64::cis(p as f64 * a)).re / TAU;
                    if p == 0 { term } else { 2.0 * term }
                })
                .sum();
            let incident = LocalAngle::radians(a);
            (brdf.value(incident, local) * a.cos(), sum)
        }),
        edges / (PI * MOST as f64),
        "the kinks at ±90°, of slopes s, leave coefficients s/(2πp²): Σ over |p| > 400 is at most s/(400π)",
    );
    paper.compare(
        "7–10",
        "put together and integrated, only q = −p is left: B = 2π Σ_p L_p ρ̂_{−p}(θo′) e^{ipα}",
        angles().map(|alpha| {
            let sum: Complex64 = (-ORDER..=ORDER)
                .map(|p| {
                    // 2π ρ̂_{−p} = H_p.
                    let h = row[p.unsigned_abs() as usize];
                    let h = if p < 0 { h.conj() } else { h };
                    light.get(p) * h * Complex64::cis(p as f64 * alpha)
                })
                .sum();
            let normal = NormalAngle::radians(alpha);
            (integral::value(lighting, 0, brdf, normal, local), sum.re)
        }),
        1e-10 * light.get(0).norm() * row[0].norm(),
        "1e-10 of the mean",
    );
}

/// Equations 11–16, with B computed by the angular integral.
fn product_form(paper: &mut Paper, brdf: &dyn Brdf, light: &Lighting) {
    let series = light.series(0, ORDER as usize);
    let nodes = exitant_nodes(brdf);
    let circle = CircleTransform::new(16, -PI);
    // B_p(θo′) from the angular integral at 16 normals, which hold orders below 8.
    let field: Vec<Vec<Complex64>> = nodes
        .iter()
        .map(|&(local, _)| {
            let column: Vec<f64> = (0..16)
                .map(|i| {
                    let normal = NormalAngle::radians(circle.angle(i));
                    integral::value(light, 0, brdf, normal, local)
                })
                .collect();
            let b = circle.analyse(&column, ORDER as usize);
            (-ORDER..=ORDER).map(|p| b.get(p)).collect()
        })
        .collect();
    let at = |p: i64| (p + ORDER) as usize;
    let scale = field.iter().fold(0.0f64, |m, row| m.max(row[at(0)].norm()));
    let one_angle = nodes.iter().zip(&field).flat_map(|((local, _), row)| {
        let transfer = transfer_row(brdf, *local, ORDER as usize);
        (0..=ORDER)
            .map(|p| (series.get(p) * transfer[p as usize], row[at(p)]))
            .collect::<Vec<_>>()
    });
    paper.compare(
        "11",
        "B_p(θo′) = 2π L_p ρ̂_{−p}(θo′)",
        parts(one_angle),
        1e-10 * scale,
        "1e-10 of the largest coefficient, product against angular integral",
    );
    let transfer = Double::transfer(brdf, ORDER, false);
    let b = Double::from_rows(ORDER, &nodes, &field);
    let scale = b.get(0, 0).norm();
    paper.compare(
        "14",
        "B_{p,q} = 2π L_p ρ̂_{−p,q}",
        parts(
            b.indices()
                .map(|(p, q)| (TAU * series.get(p) * transfer.get(-p, q), b.get(p, q))),
        ),
        1e-10 * scale,
        "1e-10 of B_{0,0}, product against angular integral",
    );
    let reciprocal = Double::transfer(brdf, ORDER, true);
    let with_cosine: Vec<Vec<Complex64>> = nodes
        .iter()
        .zip(&field)
        .map(|((local, _), row)| row.iter().map(|v| v * local.rad().cos()).collect())
        .collect();
    let tilde = Double::from_rows(ORDER, &nodes, &with_cosine);
    // A function of both angles is its series if that holds all its energy (Parseval).
    let whole: f64 = nodes
        .iter()
        .zip(&with_cosine)
        .map(|((_, weight), row)| weight * row[at(1)].norm_sqr() / TAU)
        .sum();
    let held = Double::energy(&nodes, &with_cosine, at(1));
    paper.compare(
        "12–13",
        "functions of both angles are sums over e^{ipα} e^{iqθo′}: Σ_q |B̃_{1,q}|² = (1/2π) ∫ |B̃_1(θo′)|² dθo′",
        [(1.0, held / whole)],
        1e-4,
        "the sum ends at |q| = 40; beyond, coefficients that fall with 1/q² hold about 1/40³ of the energy",
    );
    let scaled: Vec<Vec<Complex64>> = nodes
        .iter()
        .map(|(local, _)| {
            let h = transfer_row(brdf, *local, 1)[1] * local.rad().cos() / TAU;
            vec![h.conj()]
        })
        .collect();
    let whole: f64 = nodes
        .iter()
        .zip(&scaled)
        .map(|((_, weight), row)| weight * row[0].norm_sqr() / TAU)
        .sum();
    paper.compare(
        "12–13",
        "and likewise the BRDF: Σ_q |ρ̃_{1,q}|² = (1/2π) ∫ |ρ̃_1(θo′)|² dθo′",
        [(1.0, Double::energy(&nodes, &scaled, 0) / whole)],
        1e-4,
        "as above",
    );
    paper.compare(
        "15",
        "B̃_{p,q} = 2π L_p ρ̃_{−p,q}",
        parts(
            tilde
                .indices()
                .map(|(p, q)| (TAU * series.get(p) * reciprocal.get(-p, q), tilde.get(p, q))),
        ),
        1e-10 * scale,
        "1e-10 of B_{0,0}",
    );
    let inverse = (-ORDER..=ORDER).map(|p| {
        let l = tilde.get(p, 0) / (TAU * reciprocal.get(-p, 0));
        (series.get(p), l)
    });
    paper.compare(
        "16",
        "L_p = B_{p,q} / (2π ρ̂_{−p,q}) for any q, here q = 0",
        parts(inverse),
        1e-9,
        "1e-10 of B_{0,0} over the smallest |ρ̃_{p,0}| in use",
    );
}
