//! The light field by the product of Fourier coefficients (eq. 11 and 14): for each θo′ the factors
//! H_p(θo′) = 2π ρ̂_{−p}(θo′), times L_p, summed over p by one FFT per column.
//!
//! Directional sources have no end of frequencies and are evaluated directly, without any loss.

use std::collections::HashMap;

use num_complex::Complex64;
use rayon::prelude::*;

use super::{check, from_sources};
use crate::angle::{LocalAngle, NormalAngle};
use crate::brdf::{Brdf, Material, transfer_row};
use crate::error::Result;
use crate::fourier::{CircleTransform, Series};
use crate::grid::Grid;
use crate::lighting::Lighting;

/// The order that loses nothing of band-limited light. A table of n values is linear between them and
/// has no end of frequencies: its coefficients beyond n/2 fall off with 1/p², those of any transfer
/// function at least as fast, so that 2n leaves about 1/(π·2n)² of its edges.
pub fn sufficient_order(lighting: &Lighting) -> usize {
    let tabulated = lighting
        .table
        .iter()
        .filter(|t| t.windows(2).any(|w| w[0] != w[1]))
        .map(|t| 2 * t.len())
        .max();
    let smooth = lighting.smooth.iter().map(Series::order).max();
    tabulated.max(smooth).unwrap_or(0)
}

/// B_p(θo′) = 2π L_p ρ̂_{−p}(θo′) for 0 ≤ p ≤ the order of `light` (eq. 11), W m⁻² sr⁻¹.
pub fn column_series(light: &Series, brdf: &dyn Brdf, local: LocalAngle) -> Series {
    let transfer = transfer_row(brdf, local, light.order());
    let coefficients = light
        .coefficients
        .iter()
        .zip(transfer)
        .map(|(l, h)| l * h)
        .collect();
    Series { coefficients }
}

/// The whole light field, \[channel\]\[cell of `grid`\], W m⁻² sr⁻¹, up to frequency `order` of the light
/// ([`sufficient_order`] for all of it); sources exactly.
///
/// # Errors
/// If lighting and material do not have the same channels, or a mirror sees a directional source.
pub fn on_grid(
    lighting: &Lighting,
    material: &Material,
    grid: Grid,
    order: usize,
) -> Result<Vec<Vec<f64>>> {
    check(lighting, material)?;
    let transform = CircleTransform::new(grid.normals.max(1), grid.normal(0).rad());
    let field = |(c, brdf): (usize, &std::sync::Arc<dyn Brdf>)| {
        let light = lighting.density_series(c, order);
        let columns: Vec<Vec<f64>> = (0..grid.locals)
            .into_par_iter()
            .map(|j| {
                let local = grid.local(j);
                let mut column = transform.synthesise(&column_series(&light, brdf.as_ref(), local));
                if !lighting.sources.is_empty() {
                    for (i, b) in column.iter_mut().enumerate() {
                        *b += from_sources(lighting, c, brdf.as_ref(), grid.normal(i), local);
                    }
                }
                column
            })
            .collect();
        let mut cells = Vec::with_capacity(grid.len());
        for i in 0..grid.normals {
            cells.extend(columns.iter().map(|column| column[i]));
        }
        cells
    };
    Ok(material.brdfs.iter().enumerate().map(field).collect())
}

/// The light field at given (α, θo′), \[channel\]\[n\], W m⁻² sr⁻¹. Samples of equal θo′ share the work of
/// their column.
///
/// # Errors
/// As [`on_grid`].
pub fn at(
    lighting: &Lighting,
    material: &Material,
    samples: &[(NormalAngle, LocalAngle)],
    order: usize,
) -> Result<Vec<Vec<f64>>> {
    check(lighting, material)?;
    let mut columns: HashMap<u64, Vec<usize>> = HashMap::new();
    for (i, (_, local)) in samples.iter().enumerate() {
        columns.entry(local.rad().to_bits()).or_default().push(i);
    }
    let columns: Vec<Vec<usize>> = columns.into_values().collect();
    let field = |(c, brdf): (usize, &std::sync::Arc<dyn Brdf>)| {
        let light = lighting.density_series(c, order);
        let computed: Vec<Vec<(usize, f64)>> = columns
            .par_iter()
            .map(|members| {
                let Some(local) = members.first().and_then(|&i| samples.get(i)).map(|s| s.1) else {
                    return Vec::new();
                };
                let series = column_series(&light, brdf.as_ref(), local);
                let evaluate = |&i: &usize| {
                    let normal = samples[i].0;
                    let direct = from_sources(lighting, c, brdf.as_ref(), normal, local);
                    (i, series.evaluate(normal.rad()) + direct)
                };
                members.iter().map(evaluate).collect()
            })
            .collect();
        let mut values = vec![0.0; samples.len()];
        for (i, b) in computed.into_iter().flatten() {
            values[i] = b;
        }
        values
    };
    Ok(material.brdfs.iter().enumerate().map(field).collect())
}

/// H_p(θo′) of every column of a grid, \[local\]\[p\], 0 ≤ p ≤ `order`: what lighting recovery and
/// repeated relighting start from.
pub fn transfer_columns(brdf: &dyn Brdf, grid: Grid, order: usize) -> Vec<Vec<Complex64>> {
    (0..grid.locals)
        .into_par_iter()
        .map(|j| transfer_row(brdf, grid.local(j), order))
        .collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::angle::WorldAngle;
    use crate::brdf::{GgxConductor, Lambertian, Mirror, Phong};
    use crate::lighting::Source;
    use crate::reflect::integral;

    fn phong(exponent: f64) -> Arc<dyn Brdf> {
        Arc::new(Phong {
            diffuse: 0.2,
            specular: 0.5,
            exponent,
        })
    }

    fn material(brdfs: Vec<Arc<dyn Brdf>>) -> Material {
        Material {
            channels: (0..brdfs.len()).map(|c| format!("c{c}")).collect(),
            brdfs,
        }
    }

    fn wiggly(order: usize) -> Series {
        let coefficients = (0..=order)
            .map(|p| {
                let size = 1.0 / (1.0 + p as f64);
                Complex64::new(size, if p == 0 { 0.0 } else { -0.4 * size })
            })
            .collect();
        Series { coefficients }
    }

    fn largest(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
        let pairs = || a.iter().flatten().zip(b.iter().flatten());
        let size = pairs().fold(0.0f64, |m, (_, y)| m.max(y.abs()));
        pairs().fold(0.0f64, |m, (x, y)| m.max((x - y).abs())) / size
    }

    #[test]
    fn product_equals_integral_for_band_limited_light_and_sources() {
        let brdfs: Vec<Arc<dyn Brdf>> = vec![
            Arc::new(Lambertian { albedo: 0.7 }),
            phong(33.0),
            phong(2000.0),
            Arc::new(GgxConductor {
                alpha: 0.2,
                eta: 0.2,
                k: 3.9,
                specular: 1.0,
            }),
        ];
        let material = material(brdfs);
        let mut light = Lighting::band_limited(
            material.channels.clone(),
            vec![wiggly(12), wiggly(40), wiggly(3), wiggly(20)],
        );
        light.sources = vec![Source {
            theta: WorldAngle::degrees(37.3),
            irradiance: vec![3.0, 2.0, 1.0, 0.5],
        }];
        let grid = Grid {
            normals: 36,
            locals: 18,
        };
        let order = sufficient_order(&light);
        assert_eq!(order, 40);
        let fast = on_grid(&light, &material, grid, order).unwrap();
        let slow = integral::on_grid(&light, &material, grid).unwrap();
        let error = largest(&fast, &slow);
        // Both quadratures are made for 1e-12 of the integrand's size.
        assert!(error < 1e-11, "{error:e}");

        let samples: Vec<(NormalAngle, LocalAngle)> = (0..60)
            .map(|k| {
                let (a, o) = (0.37 * f64::from(k), 1.5 * (f64::from(k / 3) * 1.1).sin());
                (NormalAngle::radians(a), LocalAngle::radians(o))
            })
            .collect();
        let fast = at(&light, &material, &samples, order).unwrap();
        let slow: Vec<Vec<f64>> = material
            .brdfs
            .iter()
            .enumerate()
            .map(|(c, brdf)| {
                samples
                    .iter()
                    .map(|&(a, o)| integral::value(&light, c, brdf.as_ref(), a, o))
                    .collect()
            })
            .collect();
        assert!(largest(&fast, &slow) < 1e-11);
    }

    #[test]
    fn a_table_needs_the_order_that_is_promised() {
        // Worst case: one raised value of 90 and edges.
        let mut table: Vec<f64> = (0..90).map(|i| f64::from(u8::from(i > 40))).collect();
        table[7] = 5.0;
        let material = material(vec![phong(33.0)]);
        let light = Lighting {
            channels: material.channels.clone(),
            table: vec![table],
            ..Lighting::default()
        };
        let grid = Grid {
            normals: 40,
            locals: 12,
        };
        let slow = integral::on_grid(&light, &material, grid).unwrap();
        let fast = on_grid(&light, &material, grid, sufficient_order(&light)).unwrap();
        // Σ_{p>2n} |L_p H_p| with both falling as 1/p² from about 1/n: see `sufficient_order`.
        assert!(largest(&fast, &slow) < 2e-6, "{:e}", largest(&fast, &slow));
        // The table truncated where a series of its values would end is far worse.
        let cut = on_grid(&light, &material, grid, 8).unwrap();
        assert!(largest(&cut, &slow) > 1e-3);
    }

    #[test]
    fn a_mirror_shows_the_light_and_refuses_a_point_source() {
        let material = material(vec![Arc::new(Mirror { reflectance: 0.6 })]);
        let mut light = Lighting::band_limited(material.channels.clone(), vec![wiggly(20)]);
        let grid = Grid {
            normals: 64,
            locals: 9,
        };
        let field = on_grid(&light, &material, grid, 20).unwrap();
        for i in 0..grid.normals {
            for j in 0..grid.locals {
                // Eq. 17: B(α, θo′) = reflectance · L(α − θo′).
                let local = grid.local(j);
                let l = light.density(0, grid.normal(i) + -local);
                let expected = 0.6 * l;
                assert!((field[0][grid.index(i, j)] - expected).abs() < 1e-12);
            }
        }
        light.sources.push(Source {
            theta: WorldAngle::degrees(0.0),
            irradiance: vec![1.0],
        });
        assert!(on_grid(&light, &material, grid, 20).is_err());
        light.channels = vec!["other".into()];
        assert!(integral::on_grid(&light, &material, grid).is_err());
    }
}
