//! What a homogeneous object should not have: texture and dust. Both stand still with the object, and
//! the object with the light.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::draw::{Purpose, generator};
use crate::capture::Shape;

/// Plane waves of a texture.
const WAVES: usize = 24;

/// Albedo that varies over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texture {
    /// Standard deviation of the albedo's factor.
    pub amplitude: f64,
    /// Length over which it varies, metres: the waves' mean period.
    pub scale_m: f64,
}

/// Dark specks on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dust {
    /// How many, over the whole object (of a cylinder: the part in the picture, all around).
    pub count: usize,
    /// Radius of a speck, metres.
    pub radius_m: f64,
    /// Share of the light that a speck takes away, 0–1.
    pub opacity: f64,
}

/// The factor on the reflected light at every point of the surface.
#[derive(Clone, Debug, Default)]
pub(super) struct Blemishes {
    waves: Vec<(Vector3<f64>, f64)>,
    amplitude: f64,
    dust: Option<Dust>,
    /// Specks by the cells that they touch.
    cells: HashMap<[i64; 3], Vec<Vector3<f64>>>,
}

impl Blemishes {
    /// `half_height`: of the part of a cylinder that gets dust, metres.
    pub(super) fn new(
        texture: Option<Texture>,
        dust: Option<Dust>,
        shape: Shape,
        radius: f64,
        half_height: f64,
        seed: u64,
    ) -> Self {
        let mut all = Self::default();
        if let Some(texture) = texture {
            let mut random = generator(seed, Purpose::Texture, 0, 0);
            all.amplitude = texture.amplitude;
            all.waves = (0..WAVES)
                .map(|_| {
                    let per_metre = TAU / texture.scale_m * random.random_range(0.5..1.5);
                    (
                        direction(&mut random) * per_metre,
                        random.random_range(0.0..TAU),
                    )
                })
                .collect();
        }
        if let Some(dust) = dust {
            let mut random = generator(seed, Purpose::Dust, 0, 0);
            for _ in 0..dust.count {
                let at = match shape {
                    Shape::Sphere => direction(&mut random) * radius,
                    Shape::Cylinder => {
                        let angle: f64 = random.random_range(-PI..PI);
                        let height = random.random_range(-1.0..=1.0) * half_height;
                        Vector3::new(radius * angle.cos(), radius * angle.sin(), height)
                    }
                };
                let low = cell(at.add_scalar(-dust.radius_m), dust.radius_m);
                let high = cell(at.add_scalar(dust.radius_m), dust.radius_m);
                for i in low[0]..=high[0] {
                    for j in low[1]..=high[1] {
                        for k in low[2]..=high[2] {
                            all.cells.entry([i, j, k]).or_default().push(at);
                        }
                    }
                }
            }
            all.dust = Some(dust);
        }
        all
    }

    pub(super) fn is_none(&self) -> bool {
        self.waves.is_empty() && self.cells.is_empty()
    }

    /// Whether no speck touches the surroundings of `point` up to `reach` metres, and the texture is flat
    /// there: one value of the factor serves.
    pub(super) fn is_plain(&self, point: Vector3<f64>, reach: f64) -> bool {
        // Over a phase of ±0.5 the mean of a wave is 4 % smaller than its middle: less than a
        // thousandth of a texture of 2 %.
        let fine = self.waves.iter().any(|(k, _)| k.norm() * reach > 0.5);
        let dusty = self.dust.is_some_and(|dust| {
            let far = reach + dust.radius_m;
            let low = cell(point.add_scalar(-reach), dust.radius_m);
            let high = cell(point.add_scalar(reach), dust.radius_m);
            // Specks much finer than the reach: too many cells to ask.
            (0..3).any(|k| high[k] - low[k] > 4)
                || (low[0]..=high[0]).any(|i| {
                    (low[1]..=high[1]).any(|j| {
                        (low[2]..=high[2]).any(|k| {
                            self.cells.get(&[i, j, k]).is_some_and(|specks| {
                                specks.iter().any(|s| (s - point).norm() < far)
                            })
                        })
                    })
                })
        });
        !fine && !dusty
    }

    /// `point`: from the object's centre, metres, in the frame that stands still with it.
    pub(super) fn factor(&self, point: Vector3<f64>) -> f64 {
        let mut factor = 1.0;
        if !self.waves.is_empty() {
            let sum: f64 = self
                .waves
                .iter()
                .map(|(k, at)| (k.dot(&point) + at).cos())
                .sum();
            // Each wave has variance ½.
            factor += self.amplitude * sum * (2.0 / WAVES as f64).sqrt();
        }
        if let Some(dust) = &self.dust
            && let Some(specks) = self.cells.get(&cell(point, dust.radius_m))
            && specks.iter().any(|at| (at - point).norm() < dust.radius_m)
        {
            factor *= 1.0 - dust.opacity;
        }
        factor.max(0.0)
    }
}

fn cell(point: Vector3<f64>, radius: f64) -> [i64; 3] {
    // Two radii a side: a speck touches at most eight.
    [0, 1, 2].map(|k| (point[k] / (2.0 * radius)).floor() as i64)
}

fn direction(random: &mut ChaCha8Rng) -> Vector3<f64> {
    let v = Vector3::from_fn(|_, _| StandardNormal.sample(random));
    v.try_normalize(1e-12).unwrap_or(Vector3::z())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_has_its_amplitude_and_dust_covers_its_area() {
        let radius = 0.05;
        let texture = Texture {
            amplitude: 0.02,
            scale_m: 0.002,
        };
        let dust = Dust {
            count: 300,
            radius_m: 0.0005,
            opacity: 0.4,
        };
        let on_cylinder = |i: usize, n: usize| {
            // A low-discrepancy walk over 2π × ±5 mm.
            let angle = TAU * i as f64 / n as f64;
            let height = 0.01 * ((i as f64 * 0.618_033_988_75).fract() - 0.5);
            Vector3::new(radius * angle.cos(), radius * angle.sin(), height)
        };
        let n = 200_000;
        let textured = Blemishes::new(Some(texture), None, Shape::Cylinder, radius, 0.005, 7);
        let values: Vec<f64> = (0..n).map(|i| textured.factor(on_cylinder(i, n))).collect();
        let mean = values.iter().sum::<f64>() / n as f64;
        let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64).sqrt();
        // 24 waves of fixed amplitude: the surface is hundreds of periods around, so each has its ½.
        assert!((deviation / 0.02 - 1.0).abs() < 0.1, "{deviation}");
        let dusty = Blemishes::new(None, Some(dust), Shape::Cylinder, radius, 0.005, 7);
        let covered = (0..n)
            .filter(|&i| dusty.factor(on_cylinder(i, n)) < 1.0)
            .count() as f64
            / n as f64;
        // 300 discs on 2π · 50 mm × 10 mm that may overlap: 1 − exp(−7.5 %), with the scatter of overlaps
        // and of specks over the edge (each of about 1/20 of a speck's area lost): a tenth.
        let expected = 1.0 - (-300.0 * PI * 0.0005_f64.powi(2) / (TAU * radius * 0.01)).exp();
        assert!(
            (covered / expected - 1.0).abs() < 0.1,
            "{covered} {expected}"
        );
        let bare = Blemishes::new(None, None, Shape::Sphere, radius, 0.0, 7);
        assert!(bare.is_none() && bare.factor(Vector3::x()) == 1.0);
    }
}
