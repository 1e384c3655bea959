//! Every equation (1–33) and figure 3 of \[RH01\], recomputed: the claim, its closed form, our number and
//! the difference. Nothing is stored; all of it is computed when it is asked for, through the functions
//! that the pipeline uses.
//!
//! The paper's flatland constants are those of a BRDF in 1/rad: a Lambertian surface of albedo 1 has
//! ρ = ½ there, which is our [`Lambertian`] of albedo π/2.

mod deconvolution;
mod foundations;
mod lights;
mod lobes;
mod order;
mod statements;
mod surfaces;
mod terms;

use num_complex::Complex64;

use crate::angle::LocalAngle;
use crate::brdf::{Brdf, IncidentRule, Lambertian, Phong, transfer_row};
use crate::error::Result;
use crate::fourier::Series;

pub use statements::{SECTIONS, STATEMENTS, Statement};

/// One claim of the paper and what became of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// The equation or figure, by its name in [`STATEMENTS`].
    pub equation: &'static str,
    /// What the paper says, in words and symbols.
    pub claim: String,
    /// The value that the claim gives, at the place where ours is farthest from it.
    pub closed_form: f64,
    /// Ours at that place.
    pub ours: f64,
    /// The largest difference over all places that were compared.
    pub difference: f64,
    /// What it may be; the claim says from what it is derived.
    pub tolerance: f64,
    /// Whether difference ≤ tolerance.
    pub passed: bool,
    /// Where the tolerance comes from, or what is peculiar.
    pub note: String,
}

/// A curve of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// (x, y).
    pub points: Vec<(f64, f64)>,
    /// Whether the points stand for themselves (numbers that were found) instead of for a line.
    pub discs: bool,
}

impl Curve {
    fn line(name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self {
            name: name.into(),
            points: points.into_iter().collect(),
            discs: false,
        }
    }

    fn discs(name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self {
            discs: true,
            ..Self::line(name, points)
        }
    }
}

/// Data of one plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// A name for files and links.
    pub id: &'static str,
    /// The equation that it belongs to, one of those of [`STATEMENTS`].
    pub equation: &'static str,
    /// What is shown.
    pub title: &'static str,
    /// What to see in it.
    pub caption: String,
    /// Quantity and unit of x.
    pub x: &'static str,
    /// Quantity and unit of y.
    pub y: &'static str,
    /// Whether x and y are logarithmic.
    pub logarithmic: [bool; 2],
    /// The curves.
    pub curves: Vec<Curve>,
}

/// All that was recomputed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Paper {
    /// The claims, in the order of the paper.
    pub checks: Vec<Check>,
    /// The plots.
    pub plots: Vec<Plot>,
}

impl Paper {
    /// Whether every claim passed.
    pub fn passed(&self) -> bool {
        self.checks.iter().all(|c| c.passed)
    }

    /// Adds a check of all pairs (closed form, ours).
    fn compare(
        &mut self,
        equation: &'static str,
        claim: impl Into<String>,
        pairs: impl IntoIterator<Item = (f64, f64)>,
        tolerance: f64,
        note: impl Into<String>,
    ) {
        let mut worst = (f64::NAN, f64::NAN);
        let mut difference = -1.0;
        for (closed, ours) in pairs {
            let d = (closed - ours).abs();
            // A NaN is the worst of all.
            if d > difference || d.is_nan() {
                (worst, difference) = ((closed, ours), d);
                if d.is_nan() {
                    break;
                }
            }
        }
        self.checks.push(Check {
            equation,
            claim: claim.into(),
            closed_form: worst.0,
            ours: worst.1,
            difference,
            tolerance,
            passed: (0.0..=tolerance).contains(&difference),
            note: note.into(),
        });
    }
}

/// Recomputes the paper. Under ten seconds on one core in a release build.
///
/// # Errors
/// If a stage of the pipeline that it calls fails.
pub fn recompute() -> Result<Paper> {
    let mut paper = Paper::default();
    foundations::check(&mut paper)?;
    surfaces::check(&mut paper)?;
    terms::check(&mut paper);
    lobes::check(&mut paper);
    lights::check(&mut paper)?;
    deconvolution::check(&mut paper)?;
    order::check(&mut paper)?;
    // Stable: claims on one equation stay in the order in which they were made.
    let place = |name: &str| STATEMENTS.iter().position(|s| s.equation == name);
    paper.checks.sort_by_key(|c| place(c.equation));
    paper.plots.sort_by_key(|p| place(p.equation));
    Ok(paper)
}

/// Real and imaginary parts side by side.
fn parts(pairs: impl IntoIterator<Item = (Complex64, Complex64)>) -> Vec<(f64, f64)> {
    pairs
        .into_iter()
        .flat_map(|(a, b)| [(a.re, b.re), (a.im, b.im)])
        .collect()
}

/// The flatland Lambertian surface of albedo 1, ρ = ½.
fn flat_lambertian() -> Lambertian {
    Lambertian {
        albedo: std::f64::consts::FRAC_PI_2,
    }
}

/// ρ = cos^β(θi′ + θo′), the paper's Phong.
fn flat_phong(exponent: f64) -> Phong {
    Phong {
        diffuse: 0.0,
        specular: std::f64::consts::TAU / (exponent + 2.0),
        exponent,
    }
}

/// ρ = 0.3/π + 0.7·Phong 32: a material with all coefficients, neither smooth nor sharp.
fn mixed() -> Phong {
    Phong {
        diffuse: 0.3,
        specular: 0.7,
        exponent: 32.0,
    }
}

/// A light with all frequencies up to 6, never negative.
fn test_light() -> Series {
    let coefficients = (0..=6)
        .map(|p| match p {
            0 => Complex64::new(1.0, 0.0),
            _ => Complex64::from_polar(0.42 / f64::from(p + 1), 1.3 * f64::from(p * p)),
        })
        .collect();
    Series { coefficients }
}

/// Nodes θo′ and weights over the visible half circle that resolve `brdf` and frequencies up to 40.
fn exitant_nodes(brdf: &dyn Brdf) -> Vec<(LocalAngle, f64)> {
    let rule = IncidentRule::new(brdf, LocalAngle::radians(0.0), 40);
    let angles = rule.angles.into_iter().map(LocalAngle::radians);
    angles.zip(rule.weights).collect()
}

/// Coefficients f_{p,q} of eq. 13 for |p|, |q| ≤ order, \[p + order\]\[q + order\].
struct Double {
    order: i64,
    values: Vec<Vec<Complex64>>,
}

impl Double {
    /// From the coefficients over the first angle at each θo′ node, f_p for −order ≤ p ≤ order.
    fn from_rows(order: i64, nodes: &[(LocalAngle, f64)], rows: &[Vec<Complex64>]) -> Self {
        let size = (2 * order + 1) as usize;
        let mut values = vec![vec![Complex64::ZERO; size]; size];
        for ((local, weight), row) in nodes.iter().zip(rows) {
            for (p, f) in row.iter().enumerate() {
                for (q, value) in values[p].iter_mut().enumerate() {
                    let phase = -(q as f64 - order as f64) * local.rad();
                    *value += f * Complex64::cis(phase) * *weight / std::f64::consts::TAU;
                }
            }
        }
        Self { order, values }
    }

    /// ρ̂_{p,q}, or ρ̃_{p,q} with the second cosine.
    fn transfer(brdf: &dyn Brdf, order: i64, reciprocal: bool) -> Self {
        let nodes = exitant_nodes(brdf);
        let rows: Vec<Vec<Complex64>> = nodes
            .iter()
            .map(|(local, _)| {
                // H_p = 2π ρ̂_{−p}, so ρ̂_p = conj H_p / 2π.
                let row = transfer_row(brdf, *local, order as usize);
                let cosine = if reciprocal { local.rad().cos() } else { 1.0 };
                (-order..=order)
                    .map(|p| {
                        let h = row[p.unsigned_abs() as usize] * cosine / std::f64::consts::TAU;
                        if p < 0 { h } else { h.conj() }
                    })
                    .collect()
            })
            .collect();
        Self::from_rows(order, &nodes, &rows)
    }

    /// Σ_q |f_{p,q}|² over |q| ≤ 40 for the row of one p.
    fn energy(nodes: &[(LocalAngle, f64)], rows: &[Vec<Complex64>], row: usize) -> f64 {
        (-40..=40)
            .map(|q| {
                let sum: Complex64 = nodes
                    .iter()
                    .zip(rows)
                    .map(|((local, weight), f)| {
                        f[row] * Complex64::cis(-f64::from(q) * local.rad()) * *weight
                    })
                    .sum();
                (sum / std::f64::consts::TAU).norm_sqr()
            })
            .sum()
    }

    fn get(&self, p: i64, q: i64) -> Complex64 {
        let at = |k: i64| (k + self.order) as usize;
        self.values
            .get(at(p))
            .and_then(|row| row.get(at(q)))
            .copied()
            .unwrap_or(Complex64::ZERO)
    }

    /// All (p, q).
    fn indices(&self) -> impl Iterator<Item = (i64, i64)> + use<> {
        let order = self.order;
        (-order..=order).flat_map(move |p| (-order..=order).map(move |q| (p, q)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_claim_passes_and_every_equation_is_there() {
        let paper = recompute().unwrap();
        for c in &paper.checks {
            println!(
                "{:8} {:9.2e} ≤ {:7.1e} {} | {} | {} {}",
                c.equation, c.difference, c.tolerance, c.passed, c.claim, c.closed_form, c.ours
            );
        }
        let failed: Vec<&Check> = paper.checks.iter().filter(|c| !c.passed).collect();
        assert!(failed.is_empty(), "{failed:#?}");
        // Every statement has a check, every check and plot a statement.
        for statement in &STATEMENTS {
            let mut checks = paper.checks.iter();
            let checked = checks.any(|c| c.equation == statement.equation);
            assert!(checked, "{}", statement.equation);
        }
        let stated = |name: &str| STATEMENTS.iter().any(|s| s.equation == name);
        assert!(paper.checks.iter().all(|c| stated(c.equation)));
        assert!(paper.plots.iter().all(|p| stated(p.equation)));
        let figure = paper.plots.iter().find(|p| p.id == "figure-3").unwrap();
        assert_eq!(figure.curves.len(), 3);
        for plot in &paper.plots {
            for (x, y) in plot.curves.iter().flat_map(|c| &c.points) {
                assert!(x.is_finite() && y.is_finite(), "{}", plot.id);
            }
        }
    }

    #[test]
    fn a_wrong_number_does_not_pass() {
        let mut paper = Paper::default();
        paper.compare("1", "right", [(1.0, 1.0), (2.0, 2.0 + 1e-9)], 1e-8, "");
        paper.compare("2", "wrong", [(1.0, 1.0), (2.0, 2.1)], 1e-8, "");
        paper.compare("3", "undefined", [(1.0, f64::NAN), (1.0, 1.0)], 1e-8, "");
        paper.compare("4", "nothing compared", [], 1e-8, "");
        let passed: Vec<bool> = paper.checks.iter().map(|c| c.passed).collect();
        assert_eq!(passed, [true, false, false, false]);
        assert_eq!(paper.checks[1].closed_form, 2.0);
    }
}
