//! The two ways of computing a column of the light field: all of it by coefficients, or the lobe by an
//! integral and the rest by coefficients.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use num_complex::Complex64;

use super::super::panels::{for_each_node, panel_ends};
use super::integrals::Integrals;
use super::offers::{Task, shortest};
use super::plan::{ColumnPlan, Path};
use crate::angle::LocalAngle;
use crate::brdf::Brdf;
use crate::fourier::{CircleTransform, Series};

/// A column as it is planned, and what its own spectrum cannot tell.
#[derive(Clone, Debug)]
pub struct Column {
    pub plan: ColumnPlan,
    /// Bound of the errors of all quadratures, W m⁻² sr⁻¹.
    pub quadrature: f64,
    /// Largest frequency that is computed, and a bound of Σ 2|L_p||H_p| above it.
    pub seen: usize,
    pub beyond: f64,
}

/// B(α, θo′) of one column at the transform's angles, without sources, peaks and mirror; and the order that its own spectrum
/// asks for, with the bound of its error.
pub fn column(
    task: &Task,
    column: &Column,
    bends: &[f64],
    transform: &CircleTransform,
) -> (Vec<f64>, ColumnPlan) {
    let Task {
        rest,
        channel,
        light,
        brdf,
        allowed,
    } = *task;
    let local = column.plan.local;
    let product = |row: &[Complex64], quadrature: f64| {
        let sizes: Vec<f64> = row.iter().map(|h| h.norm()).collect();
        let all = (row.len() - 1, column.beyond);
        let left = allowed - quadrature;
        let (order, tail) = shortest(light, &sizes, column.beyond, left).unwrap_or(all);
        let coefficients = light.coefficients.iter().zip(row).take(order + 1);
        let values = transform.synthesise(&Series {
            coefficients: coefficients.map(|(l, h)| l * h).collect(),
        });
        (values, order, tail + quadrature)
    };
    match column.plan.path {
        Path::Product { points, .. } => {
            let circle = CircleTransform::new(points, -PI);
            let samples: Vec<f64> = (0..points)
                .map(|k| match circle.angle(k) {
                    a if a.abs() < FRAC_PI_2 => transfer(brdf, a, local),
                    _ => 0.0,
                })
                .collect();
            let series = circle.analyse(&samples, column.seen);
            let row: Vec<Complex64> = series.coefficients.iter().map(|c| TAU * c.conj()).collect();
            let (values, order, bound) = product(&row, column.quadrature);
            let path = Path::Product { order, points };
            (values, ColumnPlan { local, path, bound })
        }
        Path::Split {
            half_width, step, ..
        } => {
            let patch = Patch::new(brdf, local, half_width);
            let lobe = |a: f64| patch.lobe(brdf, a, local);
            let lobe = Integrals::new(lobe, [patch.from, patch.to], &brdf.kinks(local), step);
            let quadrature = column.quadrature.max(lobe.bound(bends));
            let (mut values, order, bound) =
                product(&row(brdf, local, column.seen, &patch), quadrature);
            let table = rest.table.get(channel).map_or(&[][..], Vec::as_slice);
            for (i, b) in values.iter_mut().enumerate() {
                *b += lobe.with(table, bends, transform.angle(i));
            }
            let path = Path::Split {
                order,
                half_width,
                step,
            };
            (values, ColumnPlan { local, path, bound })
        }
    }
}

/// H_p for 0 ≤ p ≤ `order`, by quadrature, of what a patch leaves of ρ̂.
fn row(brdf: &dyn Brdf, local: LocalAngle, order: usize, patch: &Patch) -> Vec<Complex64> {
    let ends = panel_ends(brdf, local, order, [patch.from, patch.to]);
    let mut row = vec![Complex64::ZERO; order + 1];
    for_each_node(&ends, |angle, weight| {
        let value = transfer(brdf, angle, local) - patch.lobe(brdf, angle, local);
        let step = Complex64::cis(angle);
        let mut turn = Complex64::new(weight * value, 0.0);
        for h in &mut row {
            *h += turn;
            turn *= step;
        }
    });
    row
}

/// ρ̂ without the mirror's delta.
pub fn transfer(brdf: &dyn Brdf, incident: f64, local: LocalAngle) -> f64 {
    brdf.value(LocalAngle::radians(incident), local) * incident.cos().max(0.0)
}

/// The cubic that replaces ρ̂ where the lobe is cut out; it meets ρ̂ in value and slope at both ends (in
/// value only at the horizon, where the lobe's own kink must leave with the lobe).
pub struct Patch {
    pub from: f64,
    pub to: f64,
    values: [f64; 2],
    slopes: [f64; 2],
}

impl Patch {
    pub fn new(brdf: &dyn Brdf, local: LocalAngle, half_width: f64) -> Self {
        let centre = -local.rad();
        let from = (centre - half_width).max(-FRAC_PI_2);
        let to = (centre + half_width).min(FRAC_PI_2);
        let h = 1e-3 * half_width;
        let f = |a: f64| transfer(brdf, a, local);
        let slope = |a: f64| match a.abs() + h > FRAC_PI_2 {
            true => 0.0,
            false => (f(a + h) - f(a - h)) / (2.0 * h),
        };
        Self {
            from,
            to,
            values: [f(from), f(to)],
            slopes: [slope(from), slope(to)],
        }
    }

    /// ρ̂ minus the patch; 0 outside.
    pub fn lobe(&self, brdf: &dyn Brdf, incident: f64, local: LocalAngle) -> f64 {
        if incident <= self.from || incident >= self.to {
            return 0.0;
        }
        let length = self.to - self.from;
        let t = (incident - self.from) / length;
        let s = 1.0 - t;
        let patch = s * s * (1.0 + 2.0 * t) * self.values[0]
            + t * t * (1.0 + 2.0 * s) * self.values[1]
            + length * (s * s * t * self.slopes[0] - t * t * s * self.slopes[1]);
        transfer(brdf, incident, local) - patch
    }
}
