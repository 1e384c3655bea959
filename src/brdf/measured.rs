//! The measured slice as a BRDF: interpolation of a table of one channel.

use super::table::tidy;
use super::{Axis, Brdf};
use crate::angle::LocalAngle;
use crate::{Error, Result};

/// Coefficients beyond either end of an axis that an evaluation within ±90° can touch.
const PAD: usize = 2;

/// A BRDF from a table of one channel.
///
/// Interpolates ρ̃ = ρ cos θi′ cos θo′ by a tensor cubic spline: ρ̃ is smooth and falls to 0 at ±90°, where ρ itself may
/// be singular. ρ̃ is continued as an odd function across ±90°. Noise stays as it is: values may be negative.
#[derive(Clone, Debug)]
pub struct MeasuredSlice {
    incident: Axis,
    exitant: Axis,
    /// B-spline coefficients of ρ̃ with `PAD` more on either side, \[(i + PAD) · (exitant.count + 2 PAD) + j + PAD\].
    coefficients: Vec<f64>,
}

impl MeasuredSlice {
    /// From ρ\[i · exitant.count + j\], sr⁻¹; a NaN is taken from the mirrored cell (θo′, θi′).
    ///
    /// # Errors
    /// If the shape is wrong or a cell stays without a value.
    pub fn new(incident: Axis, exitant: Axis, rho: &[f64]) -> Result<Self> {
        let (ni, no) = (incident.count, exitant.count);
        if ni < 2 || no < 2 || rho.len() != ni * no {
            return Err(Error::input(format!(
                "expected a table of at least 2 × 2 angles, found {ni} × {no} with {} values",
                rho.len()
            )));
        }
        let mut tilde = vec![0.0; ni * no];
        let mut holes = Vec::new();
        for i in 0..ni {
            for j in 0..no {
                if incident.is_horizon(i) || exitant.is_horizon(j) {
                    continue;
                }
                let mut value = rho[i * no + j];
                if value.is_nan() && incident == exitant {
                    value = rho[j * no + i];
                }
                if !value.is_finite() {
                    holes.push((i, j));
                }
                let cosines =
                    incident.angle(i).visible_cosine() * exitant.angle(j).visible_cosine();
                tilde[i * no + j] = value * cosines;
            }
        }
        if let Some(&(i, j)) = holes.first() {
            return Err(Error::input(format!(
                "expected a value in every cell, or in its mirrored one; {} of {} have none, the first at \
                 θi′ = {}°, θo′ = {}°",
                holes.len(),
                ni * no,
                tidy(incident.angle(i).deg()),
                tidy(exitant.angle(j).deg())
            ))
            .advice("Measure with more views or a smaller limb cut, or use the fitted model instead of the table."));
        }
        for row in tilde.chunks_mut(no) {
            spline_coefficients(row, exitant.inclusive);
        }
        for j in 0..no {
            let mut column: Vec<f64> = (0..ni).map(|i| tilde[i * no + j]).collect();
            spline_coefficients(&mut column, incident.inclusive);
            for (i, c) in column.into_iter().enumerate() {
                tilde[i * no + j] = c;
            }
        }
        // PAD coefficients beyond either end, by the odd continuation across the horizon.
        let width = no + 2 * PAD;
        let mut coefficients = vec![0.0; (ni + 2 * PAD) * width];
        for i in 0..ni + 2 * PAD {
            let (source_i, sign_i) = continued(i, incident);
            for j in 0..width {
                let (source_j, sign_j) = continued(j, exitant);
                coefficients[i * width + j] = sign_i * sign_j * tilde[source_i * no + source_j];
            }
        }
        Ok(Self {
            incident,
            exitant,
            coefficients,
        })
    }

    /// ρ̃(θi′, θo′) = ρ cos θi′ cos θo′, sr⁻¹; 0 below the horizon.
    pub fn tilde(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        if !incident.is_visible() || !exitant.is_visible() {
            return 0.0;
        }
        let (i, wi) = stencil(self.incident.position(incident), self.incident.count);
        let (j, wj) = stencil(self.exitant.position(exitant), self.exitant.count);
        let width = self.exitant.count + 2 * PAD;
        let mut sum = 0.0;
        for (k, a) in wi.iter().enumerate() {
            let start = (i + k) * width + j;
            let row = self.coefficients.get(start..start + 4).unwrap_or(&[]);
            sum += a * row.iter().zip(&wj).map(|(c, b)| c * b).sum::<f64>();
        }
        sum
    }
}

/// Index and sign of the coefficient that stands at padded position `at`: the odd continuation's centre is the end
/// point itself if that is on the horizon, else half a step beyond it.
fn continued(at: usize, axis: Axis) -> (usize, f64) {
    let n = axis.count;
    let beyond = usize::from(axis.inclusive);
    if at < PAD {
        ((PAD - 1 - at + beyond).min(n - 1), -1.0)
    } else if at < PAD + n {
        (at - PAD, 1.0)
    } else {
        (n.saturating_sub(1 + (at - PAD - n) + beyond), -1.0)
    }
}

/// Turns values into cubic B-spline coefficients in place: (c_{k−1} + 4 c_k + c_{k+1})/6 = f_k with the odd
/// continuation, by elimination in the tridiagonal system.
fn spline_coefficients(values: &mut [f64], inclusive: bool) {
    let n = values.len();
    // An odd continuation makes an end on the horizon 0 by itself; half a step before it, c_{−1} = −c_0.
    let end = if inclusive { 4.0 } else { 3.0 };
    let off = |k: usize| {
        if inclusive && (k == 0 || k + 1 == n) {
            0.0
        } else {
            1.0
        }
    };
    let mut upper = vec![0.0; n];
    let mut before = (0.0, 0.0);
    for (k, value) in values.iter_mut().enumerate() {
        let diagonal = if k == 0 || k + 1 == n { end } else { 4.0 };
        let pivot = diagonal - off(k) * before.0;
        upper[k] = off(k) / pivot;
        *value = (6.0 * *value - off(k) * before.1) / pivot;
        before = (upper[k], *value);
    }
    for k in (0..n.saturating_sub(1)).rev() {
        values[k] -= upper[k] * values[k + 1];
    }
}

/// First padded coefficient and the four weights of the cubic B-spline at `position`, which lies within half a step of
/// the axis.
fn stencil(position: f64, count: usize) -> (usize, [f64; 4]) {
    let k = position.floor().clamp(-1.0, count as f64 - 1.0);
    let t = position - k;
    let s = 1.0 - t;
    let weights = [
        s * s * s / 6.0,
        (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
        (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
        t * t * t / 6.0,
    ];
    // Weights belong to k − 1 … k + 2.
    ((k + PAD as f64 - 1.0) as usize, weights)
}

impl Brdf for MeasuredSlice {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        let cosines = incident.visible_cosine() * exitant.visible_cosine();
        if cosines > 0.0 {
            self.tilde(incident, exitant) / cosines
        } else {
            0.0
        }
    }

    fn lobe_width(&self) -> f64 {
        2.0 * self.incident.step()
    }

    /// Every eighth knot of the spline: with the some 20 nodes of a panel, measured detail is resolved everywhere.
    fn kinks(&self, _exitant: LocalAngle) -> Vec<f64> {
        (0..self.incident.count)
            .step_by(8)
            .map(|i| self.incident.angle(i).rad())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{GgxConductor, Material, SliceTable, transfer_row};
    use std::f64::consts::FRAC_PI_2;
    use std::sync::Arc;

    const METAL: GgxConductor = GgxConductor {
        alpha: 0.1,
        eta: 0.2,
        k: 3.9,
        specular: 0.8,
    };

    fn table(axis: Axis) -> SliceTable {
        let material = Material {
            channels: vec!["Y".into()],
            brdfs: vec![Arc::new(METAL)],
        };
        SliceTable::of(&material, axis, axis)
    }

    #[test]
    fn a_tabulated_metal_has_the_transfer_function_of_the_metal() {
        for (count, inclusive) in [(181, true), (180, false)] {
            let slice = table(Axis { count, inclusive })
                .slice("Y")
                .expect("complete");
            for degrees in [-80.0, -79.25, -60.5, -30.0, 0.0, 0.5, 44.3, 70.0, 80.0] {
                let exitant = LocalAngle::degrees(degrees);
                let exact = transfer_row(&METAL, exitant, 30);
                let found = transfer_row(&slice, exitant, 30);
                let scale = exact.iter().map(|h| h.norm()).fold(0.0, f64::max);
                for (p, (a, b)) in exact.iter().zip(&found).enumerate() {
                    // Cubic spline: h⁴ f⁗/384 with f = (1 + x²)⁻², x = h/0.2 rad per step, is 1e-5 of the
                    // peak; the odd continuation at the horizon adds some 1e-4.
                    assert!((a - b).norm() < 1e-3 * scale, "{degrees}° p={p}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn the_spline_passes_through_its_values() {
        let axis = Axis {
            count: 90,
            inclusive: false,
        };
        let slice = table(axis)
            .slice("any name: there is one channel only")
            .expect("complete");
        for i in 0..90 {
            for j in 0..90 {
                let (a, b) = (axis.angle(i), axis.angle(j));
                let exact = METAL.value(a, b);
                assert!(
                    (slice.value(a, b) - exact).abs() < 1e-9 * (1.0 + exact),
                    "{i} {j}"
                );
            }
        }
        // The odd continuation vanishes at the horizon up to the rounding of sums of size 1.
        let horizon = slice.tilde(LocalAngle::radians(FRAC_PI_2), LocalAngle::degrees(-71.3));
        assert!(horizon.abs() < 1e-14, "{horizon}");
        assert_eq!(
            slice.value(LocalAngle::degrees(91.0), LocalAngle::degrees(0.0)),
            0.0
        );
    }
}
