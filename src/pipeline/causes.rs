//! What the residual of a fit looks like, and what would make it look so.
//!
//! A residual is a field over views and θo′, and its causes keep to different lines of it: a wrong exposure or a lamp that flickers scales a view,
//! a wrong orbit angle or an object that moved shifts a view, texture goes with α whatever the view, noise has no neighbours. What is left when these are
//! taken out, and is alike in neighbouring columns and in neighbouring views, is the model's own: a BRDF that is not this
//! surface's, light from out of the plane or nearby, photographs that are not linear. Only the latter is taken up by the result, since the others
//! keep to no light and to no BRDF: 3.6 % of a texture move a light by 0.1 %, 2.2 % of a wrong BRDF by 11 %.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use crate::angle::wrap;
use crate::light_field::Samples;

/// Intervals of α in which texture is looked for.
const PLACES: usize = 72;
/// Columns apart that still are neighbours: beyond what pixels have in common, within any lobe that photographs resolve.
const NEIGHBOURS: f64 = 3.0 * PI / 180.0;
/// Largest angle between views that are neighbours, radians.
const NEXT_VIEW: f64 = 0.3;
/// Rounds in which views and places are fitted by turns.
const ROUNDS: usize = 3;

/// Shares of the residual's square by what it goes with, for one channel. They may overlap.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Causes {
    /// A factor of each view.
    pub brightness: f64,
    /// A shift of each view, beyond its factor.
    pub shift: f64,
    /// A factor of each place on the surface.
    pub texture: f64,
    /// No neighbour has it: noise, dust, fine texture.
    pub rough: f64,
    /// The rest, as far as it is alike in neighbouring columns and views.
    pub model: f64,
    /// That rest, rms, relative to the measured values.
    pub structure: f64,
}

/// Share of the residual from which a cause is named.
const NAMED: f64 = 0.15;

impl Causes {
    /// The causes that the residual looks like, the likeliest first, each with its share; `model` says what may be wrong with the model.
    ///
    /// The model is always named, since a result takes up most of what its errors do and little is left to be seen; and before all
    /// others if `model_first`.
    pub fn ranked(&self, model: &str, model_first: bool) -> Vec<String> {
        let mut others = [
            (
                self.brightness,
                "exposure times or lamps that are not as stated, view by view",
            ),
            (
                self.shift,
                "orbit angles that are off, or an object that moved between views",
            ),
            (
                self.texture,
                "texture, or a shape that is not round and convex: the surface is not the same everywhere",
            ),
            (
                self.rough,
                "noise larger than stated, dust, or fine texture",
            ),
        ];
        others.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut all: Vec<(f64, &str)> = others.into_iter().filter(|o| o.0 >= NAMED).collect();
        let place = all.partition_point(|o| !model_first && o.0 > self.model);
        all.insert(place, (self.model, model));
        all.into_iter()
            .map(|(share, what)| {
                format!("{what} ({:.0} % of what is left looks so)", 100.0 * share)
            })
            .collect()
    }
}

/// Residual and prediction by views and columns, NaN where there is none.
struct Field {
    views: usize,
    columns: usize,
    residual: Vec<f64>,
    predicted: Vec<f64>,
    alpha: Vec<f64>,
    orbit: Vec<f64>,
    width: f64,
    power: f64,
}

impl Field {
    fn new(samples: &Samples, predicted: &[Vec<f64>], channel: usize) -> Self {
        let columns = samples.columns.len();
        let numbers = samples.columns.iter().flat_map(|c| &c.view);
        let views = numbers.max().map_or(0, |v| *v as usize + 1);
        let mut field = Self {
            views,
            columns,
            residual: vec![f64::NAN; views * columns],
            predicted: vec![f64::NAN; views * columns],
            alpha: vec![0.0; views * columns],
            orbit: vec![f64::NAN; views],
            width: samples.column_width(),
            power: 0.0,
        };
        for (j, (column, predicted)) in samples.columns.iter().zip(predicted).enumerate() {
            let (Some(value), Some(variance)) =
                (column.value.get(channel), column.variance.get(channel))
            else {
                continue;
            };
            for (i, view) in column.view.iter().enumerate() {
                let at = *view as usize * columns + j;
                field.orbit[*view as usize] = wrap(column.alpha[i] + column.local.rad());
                let seen = variance[i].is_finite() && variance[i] > 0.0;
                if let (true, Some(f)) = (seen, predicted.get(i)) {
                    field.residual[at] = value[i] - f;
                    field.predicted[at] = *f;
                    field.alpha[at] = column.alpha[i];
                    field.power += value[i].powi(2);
                }
            }
        }
        field
    }

    /// Sum of squares and number of what is there.
    fn squares(&self, residual: &[f64]) -> (f64, f64) {
        let seen = residual.iter().filter(|r| r.is_finite());
        seen.fold((0.0, 0.0), |(sum, n), r| (sum + r * r, n + 1.0))
    }

    /// Derivative of the prediction along a view, by columns.
    fn slope(&self, at: usize) -> f64 {
        let j = at % self.columns;
        let before = if j > 0 {
            self.predicted[at - 1]
        } else {
            f64::NAN
        };
        let after = if j + 1 < self.columns {
            self.predicted[at + 1]
        } else {
            f64::NAN
        };
        let slope = 0.5 * (after - before);
        if slope.is_finite() { slope } else { 0.0 }
    }

    /// `residual` without its best fit by a factor, and where `shifted` a shift, of each view.
    fn without_views(&self, residual: &[f64], shifted: bool) -> Vec<f64> {
        let mut rest = residual.to_vec();
        for v in 0..self.views {
            let row = v * self.columns..(v + 1) * self.columns;
            let (mut ff, mut fs, mut ss, mut fr, mut sr) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for at in row.clone().filter(|at| residual[*at].is_finite()) {
                let (f, r) = (self.predicted[at], residual[at]);
                let s = if shifted { self.slope(at) } else { 0.0 };
                ff += f * f;
                fs += f * s;
                ss += s * s;
                fr += f * r;
                sr += s * r;
            }
            let determinant = ff * ss - fs * fs;
            let (a, b) = if determinant > 1e-9 * ff * ss {
                (
                    (ss * fr - fs * sr) / determinant,
                    (ff * sr - fs * fr) / determinant,
                )
            } else {
                (fr / ff.max(f64::MIN_POSITIVE), 0.0)
            };
            for at in row {
                let s = if shifted { self.slope(at) } else { 0.0 };
                rest[at] -= a * self.predicted[at] + b * s;
            }
        }
        rest
    }

    /// `residual` without its best fit by a factor of each interval of α.
    fn without_places(&self, residual: &[f64]) -> Vec<f64> {
        let place = |at: usize| {
            let share = (wrap(self.alpha[at]) + PI) / TAU;
            ((share * PLACES as f64) as usize).min(PLACES - 1)
        };
        let (mut ff, mut fr) = (vec![f64::MIN_POSITIVE; PLACES], vec![0.0; PLACES]);
        for at in (0..residual.len()).filter(|at| residual[*at].is_finite()) {
            ff[place(at)] += self.predicted[at].powi(2);
            fr[place(at)] += self.predicted[at] * residual[at];
        }
        let fitted = |at: usize| self.predicted[at] * fr[place(at)] / ff[place(at)];
        residual
            .iter()
            .enumerate()
            .map(|(at, r)| if r.is_finite() { r - fitted(at) } else { *r })
            .collect()
    }

    /// Correlation of the values `step` columns apart in a view.
    fn along_views(&self, residual: &[f64], step: usize) -> f64 {
        let pairs = (0..residual.len())
            .filter(|at| at % self.columns + step < self.columns)
            .map(|at| (residual[at], residual[at + step]));
        correlation(pairs)
    }

    /// Correlation of the values of neighbouring views at the same θo′; 1 if there are none, for then nothing speaks against it.
    fn across_views(&self, residual: &[f64]) -> f64 {
        let mut order: Vec<usize> = (0..self.views)
            .filter(|v| self.orbit[*v].is_finite())
            .collect();
        order.sort_by(|a, b| self.orbit[*a].total_cmp(&self.orbit[*b]));
        let next = order.iter().copied().cycle().skip(1);
        let near: Vec<(usize, usize)> = order
            .iter()
            .copied()
            .zip(next)
            .filter(|(a, b)| a != b && wrap(self.orbit[*b] - self.orbit[*a]).abs() <= NEXT_VIEW)
            .collect();
        if 2 * near.len() < order.len() {
            return 1.0;
        }
        let columns = self.columns;
        let pairs = near.iter().flat_map(|&(a, b)| {
            (0..columns).map(move |j| (residual[a * columns + j], residual[b * columns + j]))
        });
        correlation(pairs)
    }
}

fn correlation(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, f64::MIN_POSITIVE);
    for (a, b) in pairs.filter(|(a, b)| a.is_finite() && b.is_finite()) {
        ab += a * b;
        aa += a * a;
        bb += b * b;
    }
    ab / (aa * bb).sqrt().max(f64::MIN_POSITIVE)
}

/// Looks at what `predicted`, \[column\]\[n\], leaves of a channel.
pub fn causes(samples: &Samples, predicted: &[Vec<f64>], channel: usize) -> Causes {
    let field = Field::new(samples, predicted, channel);
    let (square, count) = field.squares(&field.residual);
    if !(square > 0.0 && field.power > 0.0) {
        return Causes::default();
    }
    // The share that a fit with `free` parameters explains beyond what it would of noise.
    let share = |rest: &[f64], free: usize| {
        let left = field.squares(rest).0 / (count - free as f64).max(1.0);
        (1.0 - left * count / square).clamp(0.0, 1.0)
    };
    let brightness = share(&field.without_views(&field.residual, false), field.views);
    let moved = share(&field.without_views(&field.residual, true), 2 * field.views);
    let texture = share(&field.without_places(&field.residual), PLACES);
    let mut rest = field.residual.clone();
    for _ in 0..ROUNDS {
        rest = field.without_places(&field.without_views(&rest, true));
    }
    let step = (NEIGHBOURS / field.width).round().max(1.0) as usize;
    // Noise lowers both alike; what only one of them has is no structure.
    let alike = field
        .along_views(&rest, step)
        .min(field.across_views(&rest))
        .max(0.0);
    let structured = alike * field.squares(&rest).0;
    Causes {
        brightness,
        shift: (moved - brightness).max(0.0),
        texture,
        rough: (1.0 - field.along_views(&field.residual, step)).clamp(0.0, 1.0),
        model: (structured / square).min(1.0),
        structure: (structured / field.power).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::LocalAngle;
    use crate::light_field::Column;

    const VIEWS: usize = 72;

    /// Samples b = f + r(view, α, θo′) of f = 1 + ½ cos(α − θo′), and f.
    fn samples(residual: impl Fn(usize, f64, f64) -> f64) -> (Samples, Vec<Vec<f64>>) {
        let field = |alpha: f64, local: f64| 1.0 + 0.5 * (alpha - local).cos();
        let mut predicted = Vec::new();
        let columns = (0..120)
            .map(|j| {
                let local = (f64::from(j) + 0.5) * PI / 180.0 - PI / 3.0;
                let orbit = |v: usize| v as f64 * TAU / VIEWS as f64;
                let alpha: Vec<f64> = (0..VIEWS).map(|v| wrap(orbit(v) - local)).collect();
                let f: Vec<f64> = alpha.iter().map(|a| field(*a, local)).collect();
                let value = (0..VIEWS)
                    .map(|v| f[v] + residual(v, alpha[v], local) * f[v])
                    .collect();
                predicted.push(f);
                Column {
                    local: LocalAngle::radians(local),
                    alpha,
                    view: (0..VIEWS as u32).collect(),
                    value: vec![value],
                    variance: vec![vec![1e-8; VIEWS]],
                }
            })
            .collect();
        let channels = vec!["Y".into()];
        (Samples { channels, columns }, predicted)
    }

    /// Evenly distributed over ±1, of a hash.
    fn noise(n: u64) -> f64 {
        let mut h = n.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h ^= h >> 29;
        h = h.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (h >> 40) as f64 / f64::from(1u32 << 23) - 1.0
    }

    fn found(residual: impl Fn(usize, f64, f64) -> f64) -> Causes {
        let (samples, predicted) = samples(residual);
        causes(&samples, &predicted, 0)
    }

    #[test]
    fn a_factor_of_each_view_is_brightness() {
        let causes = found(|v, _, _| 0.01 * noise(v as u64));
        assert!(
            causes.brightness > 0.99 && causes.structure < 1e-4,
            "{causes:?}"
        );
        assert!(causes.ranked("the model", false)[0].starts_with("exposure times"));
    }

    #[test]
    fn a_factor_of_each_place_is_texture() {
        // 5° wide bins hold waves of 60° to 1 − (π/12)²/3 of their power or better.
        let causes = found(|_, alpha, _| 0.01 * (6.0 * alpha).sin());
        assert!(
            causes.texture > 0.95 && causes.structure < 1e-3,
            "{causes:?}"
        );
        assert!(causes.ranked("the model", false)[0].starts_with("texture"));
    }

    #[test]
    fn what_has_no_neighbours_is_noise() {
        let causes =
            found(|v, _, local| 0.01 * noise((v as u64) << 32 | (local * 1e4) as i64 as u64));
        // 8640 samples: a correlation by chance of 0.01, and its root in the structure.
        assert!(causes.rough > 0.9 && causes.model < 0.05, "{causes:?}");
        assert!(causes.ranked("the model", false)[0].starts_with("noise"));
    }

    #[test]
    fn what_goes_with_both_angles_is_the_model_s_own() {
        // Its mean over θo′ at a place is 0, and at a view sin(5π/3)/(5π/3) of it at most, 3 % of its power; neighbouring views, 5° apart,
        // correlate by cos 40° = 0.77, columns 3° apart by more.
        let causes = found(|_, alpha, local| 0.01 * (3.0 * local).cos() * (8.0 * alpha).cos());
        assert!(causes.model > 0.6 && causes.brightness < 0.1, "{causes:?}");
        // The root of that share of an rms of 0.005.
        assert!(causes.structure > 0.6f64.sqrt() * 0.0045, "{causes:?}");
        assert!(causes.ranked("the model", false)[0].starts_with("the model"));
        assert!(causes.ranked("the model", true)[0].starts_with("the model"));
    }
}
