//! What is planted: lightings, light fields, noisy samples.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use toml::{Table, Value};

use super::cell::Cell;
use crate::angle::WorldAngle;
use crate::brdf::{Material, Model};
use crate::error::{Error, Result};
use crate::fourier::{CircleTransform, Series};
use crate::grid::Grid;
use crate::light_field::Samples;
use crate::lighting::{Lighting, LightingDescription};
use crate::reflect;

/// The only channel of a study.
pub(super) const CHANNEL: &str = "Y";
/// Values of a sky: one per degree; the light is linear between them, and so is its truth.
const SKY: usize = 360;
/// Points at which the smallest value of a random light is looked for, per order: at 64 it misses the minimum
/// by less than (π/64)²/8 of the light's amplitude.
const POINTS_PER_ORDER: usize = 64;

/// A lighting from its table in the recipe: the keys of a recipe's `[lighting]`, and of them or instead
///
/// * `random_order` with `random_seed`: normal coefficients up to that order, and as much uniform light as brings the
///   darkest direction to a twentieth of the mean;
/// * `sky = { zenith_deg, radiance }`: radiance · cos² of the angle from the zenith in the upper half, 0 below.
///
/// # Errors
/// If a key is unknown, missing or out of range.
pub(super) fn lighting(table: &Table) -> Result<Lighting> {
    let channels = vec![CHANNEL.to_owned()];
    let mut rest = table.clone();
    let mut light = Lighting {
        channels: channels.clone(),
        ..Lighting::default()
    };
    if let Some(order) = rest.remove("random_order") {
        let order = whole(&order, 1, 200).map_err(|e| e.key("random_order"))?;
        let seed = match rest.remove("random_seed") {
            Some(seed) => whole(&seed, 0, u32::MAX as usize).map_err(|e| e.key("random_seed"))?,
            None => 1,
        };
        light = Lighting::band_limited(channels.clone(), vec![random(order, seed as u64)]);
    }
    if let Some(sky) = rest.remove("sky") {
        let (zenith, radiance) = sky_values(&sky).map_err(|e| e.key("sky"))?;
        let values = (0..SKY)
            .map(|i| {
                let theta = -PI + TAU * i as f64 / SKY as f64;
                radiance * (theta - zenith).cos().max(0.0).powi(2)
            })
            .collect();
        light = light.plus(&Lighting {
            channels: channels.clone(),
            table: vec![values],
            ..Lighting::default()
        });
    }
    if !rest.is_empty()
        || light
            == (Lighting {
                channels: channels.clone(),
                ..Lighting::default()
            })
    {
        let described = LightingDescription::from_toml(&rest)?;
        light = light.plus(&described.resolve(&channels, Path::new("."))?);
    }
    Ok(light)
}

fn whole(value: &Value, low: usize, high: usize) -> Result<usize> {
    value
        .as_integer()
        .and_then(|n| usize::try_from(n).ok())
        .filter(|n| (low..=high).contains(n))
        .ok_or_else(|| {
            Error::input(format!(
                "expected a whole number from {low} to {high}, found {value}"
            ))
        })
}

fn sky_values(value: &Value) -> Result<(f64, f64)> {
    let number = |key: &str| {
        let value = value.get(key)?;
        value
            .as_float()
            .or_else(|| value.as_integer().map(|n| n as f64))
    };
    match (number("zenith_deg"), number("radiance")) {
        (Some(zenith), Some(radiance)) if zenith.is_finite() && radiance >= 0.0 => {
            Ok((WorldAngle::degrees(zenith).rad(), radiance))
        }
        _ => Err(Error::input(format!(
            "expected {{ zenith_deg = …, radiance = 0 or more }}, found {value}"
        ))),
    }
}

/// Normal coefficients up to `order`, made nowhere negative by L_0 = 1.
fn random(order: usize, seed: u64) -> Series {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let mut series = Series::zero(order);
    for c in series.coefficients.iter_mut().skip(1) {
        *c = Complex64::new(normal(), normal());
    }
    let darkest = CircleTransform::new(POINTS_PER_ORDER * order, -PI)
        .synthesise(&series)
        .into_iter()
        .fold(0.0, f64::min);
    let scale = 0.95 / -darkest.min(-f64::MIN_POSITIVE.sqrt());
    for c in series.coefficients.iter_mut().skip(1) {
        *c *= scale;
    }
    series.coefficients[0] = Complex64::ONE;
    series
}

/// A BRDF from its table in the recipe.
///
/// # Errors
/// As [`Model::from_table`]; tables of measured BRDFs are not taken.
pub(super) fn material(table: &Table) -> Result<Material> {
    Model::from_table(table)?.material(&[CHANNEL.to_owned()], Path::new("."))
}

/// A planted scene and its light field without noise.
#[derive(Clone, Debug)]
pub(super) struct Scene {
    /// The light.
    pub lighting: Lighting,
    /// The surface.
    pub material: Material,
    /// α by the spacing of the views.
    pub grid: Grid,
    /// B at the cells of the grid.
    pub field: Vec<f64>,
}

impl Scene {
    /// The scene of a cell.
    ///
    /// # Errors
    /// If lighting or BRDF cannot be made.
    pub fn new(cell: &Cell) -> Result<Self> {
        let lighting = lighting(&cell.lighting_table)?;
        let material = material(&cell.brdf_table)?;
        let grid = Grid {
            normals: cell.normals(),
            locals: cell.locals,
        };
        let mut field = match lighting.band() {
            Some(order) => reflect::product::on_grid(&lighting, &material, grid, order)?,
            None => reflect::integral::on_grid(&lighting, &material, grid)?,
        };
        Ok(Self {
            field: field.pop().unwrap_or_default(),
            lighting,
            material,
            grid,
        })
    }

    /// Standard deviation of the noise, `relative` times the largest value.
    pub fn noise(&self, relative: f64) -> f64 {
        relative * self.field.iter().fold(0.0f64, |a, b| a.max(*b))
    }

    /// Samples of the views over the cell's arc within its limb cut; without noise if there is no seed.
    ///
    /// The view from θo sees the cells with α + θo′ = θo, so an arc of views is a band of the (α, θo′) plane.
    pub fn samples(&self, cell: &Cell, seed: Option<u64>) -> Samples {
        let sigma = self.noise(cell.noise);
        let mut value = self.field.clone();
        if let Some(seed) = seed {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            for v in &mut value {
                let e: f64 = StandardNormal.sample(&mut rng);
                *v += sigma * e;
            }
        }
        let grid = self.grid;
        let half_arc = 0.5 * cell.arc_deg.to_radians();
        let variance = (0..grid.len())
            .map(|k| {
                let (i, j) = (k / grid.locals, k % grid.locals);
                let local = grid.local(j);
                let orbit = (grid.normal(i) + local).wrapped().rad();
                let seen = local.deg().abs() <= cell.limb_cut_deg && orbit.abs() <= half_arc;
                if seen { sigma * sigma } else { f64::INFINITY }
            })
            .collect();
        Samples::from_grid(grid, vec![CHANNEL.to_owned()], &[value], &[variance])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_nowhere_negative_and_as_described() {
        let table = |text: &str| text.parse::<Table>().unwrap();
        let random = lighting(&table("random_order = 16\nrandom_seed = 3")).unwrap();
        assert_eq!(random.band(), Some(16));
        let darkest = (0..10_000)
            .map(|k| random.density(0, WorldAngle::degrees(0.036 * f64::from(k))))
            .fold(f64::INFINITY, f64::min);
        // A twentieth of the mean, less what the search may miss: (π/64)²/8 of an amplitude below 10.
        assert!((0.047..0.0501).contains(&darkest), "{darkest}");

        let both = lighting(&table(
            "sky = { zenith_deg = 70, radiance = 0.5 }\nuniform = 0.1\nsources = [{ theta_deg = 37.3, irradiance = 2 }]",
        ))
        .unwrap();
        assert_eq!(both.density(0, WorldAngle::degrees(-100.0)), 0.1);
        assert!((both.density(0, WorldAngle::degrees(70.0)) - 0.6).abs() < 1e-12);
        // ∫ cos² over the half circle is π/2; the straight lines between degrees lose (1°)²/6 of the integral of 2 sin².
        let expected = 0.1 * TAU + 0.5 * PI / 2.0 + 2.0;
        assert!((both.total_irradiance(0) - expected).abs() < 1e-4);
        for wrong in ["", "random_order = 0", "sky = 3", "unifrom = 1"] {
            assert!(lighting(&table(wrong)).is_err(), "{wrong}");
        }
    }
}
