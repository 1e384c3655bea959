//! Equations 31–33, figure 3, and the microfacet distribution: surfaces with a lobe.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::{Curve, Double, Paper, Plot, flat_lambertian, flat_phong};
use crate::angle::LocalAngle;
use crate::brdf::{Brdf, Mirror, transfer_row};

pub fn check(paper: &mut Paper) {
    phong(paper);
    microfacet(paper);
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
    let betas = [0.0, 8.0, 128.0];
    paper.plots.push(Plot {
        id: "figure-3",
        equation: "figure 3",
        title: "Figure 3",
        caption:
            "|ρ̂_[p]| of Phong surfaces at normal exitance, for the three exponents of the paper."
                .into(),
        x: "frequency p",
        y: "|ρ̂_[p]|",
        logarithmic: [false, false],
        curves: betas
            .map(|beta| {
                let ours = spectrum(beta, 40);
                let points =
                    (-40i32..=40).map(|p| (f64::from(p), ours[p.unsigned_abs() as usize].abs()));
                Curve::line(format!("β = {beta}"), points)
            })
            .to_vec(),
    });
    paper.plots.push(Plot {
        id: "phong-gaussian",
        equation: "33",
        title: "Lobes are nearly Gaussian",
        caption: "ρ̂_[p]/ρ̂_[0] (discs) and exp(−p²/(2(β + 3))) (lines): the surface is a low-pass filter of order √β.".into(),
        x: "frequency p",
        y: "ρ̂_[p]/ρ̂_[0]",
        logarithmic: [false, false],
        curves: [8.0f64, 128.0]
            .iter()
            .flat_map(|&beta| {
                let ours = spectrum(beta, 40);
                let gauss = move |p: usize| (-((p * p) as f64) / (2.0 * (beta + 3.0))).exp();
                [
                    Curve::line(format!("Gaussian, β = {beta}"), (0..=40).map(|p| (p as f64, gauss(p)))),
                    Curve::discs(
                        format!("β = {beta}"),
                        (0..=40).map(|p| (p as f64, ours[p] / ours[0])),
                    ),
                ]
            })
            .collect(),
    });
    paper.plots.push(Plot {
        id: "phong-fall-off",
        equation: "32",
        title: "Fall-off of the Phong spectrum",
        caption: "|ρ̂_[p]| where it does not vanish (discs), and |p|^(−(2+β)) through the last of them (lines).".into(),
        x: "frequency p",
        y: "|ρ̂_[p]|",
        logarithmic: [true, true],
        curves: [0usize, 1, 2]
            .iter()
            .flat_map(|&beta| {
                let last = 256 + beta % 2;
                let ours = spectrum(beta as f64, last);
                // Eq. 32: frequencies of the parity of β + 3 vanish.
                let kept: Vec<usize> = [4, 8, 16, 32, 64, 128, 256].map(|p| p + beta % 2).to_vec();
                let law = ours[last].abs() * (last as f64).powi(beta as i32 + 2);
                let power = move |p: usize| law / (p as f64).powi(beta as i32 + 2);
                let line: Vec<(f64, f64)> = kept.iter().map(|&p| (p as f64, power(p))).collect();
                let found = kept.iter().map(|&p| (p as f64, ours[p].abs()));
                [
                    Curve::line(format!("p^−{}", beta + 2), line),
                    Curve::discs(format!("β = {beta}"), found),
                ]
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
        equation: "microfacet",
        title: "Spectra of microfacet distributions",
        caption: "At normal exitance, over ρ̂_[0]: computed (discs), and the Gaussian of width 1/(2m) (lines).".into(),
        x: "frequency p",
        y: "|ρ̂_[p]|/ρ̂_[0]",
        logarithmic: [false, false],
        curves: widths
            .iter()
            .flat_map(|&m| {
                let row = transfer_row(&Distribution { m }, LocalAngle::radians(0.0), 100);
                let gauss = move |p: i32| closed(m, f64::from(p)) / closed(m, 0.0);
                [
                    Curve::line(format!("Gaussian, m = {m}"), (0..=100).map(|p| (f64::from(p), gauss(p)))),
                    Curve::discs(
                        format!("m = {m}"),
                        (0..=100).step_by(4).map(|p| (p as f64, row[p].norm() / row[0].norm())),
                    ),
                ]
            })
            .collect(),
    });
    let at_normal = |name: &str, brdf: &dyn Brdf| {
        let row = transfer_row(brdf, LocalAngle::radians(0.0), 40);
        let points = row.iter().enumerate();
        let kept = points.filter(|(_, h)| h.norm() > 1e-7 * row[0].norm());
        Curve::line(
            name,
            kept.map(|(p, h)| (p as f64, h.norm() / row[0].norm())),
        )
    };
    paper.plots.push(Plot {
        id: "spectra",
        equation: "microfacet",
        title: "Four surfaces as filters",
        caption: "|ρ̂_[p]|/ρ̂_[0] at normal exitance: the mirror passes all, the Lambertian surface next to nothing; lobes lie between. \
                  Terms that vanish are left out."
            .into(),
        x: "frequency p",
        y: "|ρ̂_[p]|/ρ̂_[0]",
        logarithmic: [false, true],
        curves: vec![
            at_normal("mirror", &Mirror { reflectance: 1.0 }),
            at_normal("microfacet, m = 0.05", &Distribution { m: 0.05 }),
            at_normal("Phong 32", &flat_phong(32.0)),
            at_normal("Lambertian", &flat_lambertian()),
        ],
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
