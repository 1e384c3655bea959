//! Analytic models fitted to a measured slice: parameters with σ, and which model fits best.

mod candidate;
mod minimise;
mod shape;

use std::sync::Arc;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Brdf, Lambertian, SliceTable};
use crate::angle::LocalAngle;
use crate::{Error, Result};
use candidate::Candidate;
pub(crate) use minimise::Minimum;
pub(crate) use shape::Shape;

/// One measured value of ρ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlicePoint {
    /// θi′.
    pub incident: LocalAngle,
    /// θo′.
    pub exitant: LocalAngle,
    /// ρ, sr⁻¹.
    pub rho: f64,
    /// Variance of ρ.
    pub variance: f64,
}

/// How to fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Whether ρ is on its absolute scale. If not, models whose strength follows from an index of refraction get a free
    /// factor (`scale`; for metals `specular`).
    pub absolute: bool,
    /// Whether the points' variances are known. If not, only their ratios count, and the level is read from the residual.
    pub known_variance: bool,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            absolute: true,
            known_variance: true,
        }
    }
}

/// A parameter as fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FittedParameter {
    /// Its key in a recipe; `lambert` for a Lambertian albedo added to a model that has none, `scale` for a factor on the whole model.
    pub name: String,
    /// The value.
    pub value: f64,
    /// One standard deviation; absent if the value is at a limit, held fixed, or not determined by the data. Where no model fits within the
    /// noise it is enlarged by the root of χ² per degree of freedom.
    pub sigma: Option<f64>,
}

/// One model's best fit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ModelFit {
    /// Name of the model as in a recipe.
    pub model: String,
    /// Its parameters.
    pub parameters: Vec<FittedParameter>,
    /// Σ (residual/σ)².
    pub chi_square: f64,
    /// Points minus free parameters.
    pub degrees_of_freedom: usize,
    /// Root mean square of the residual of ρ cos θi′ cos θo′ over its largest value.
    pub relative_rms: f64,
    /// Akaike's criterion: smaller is better.
    pub aic: f64,
    /// Schwarz' Bayesian criterion: smaller is better.
    pub bic: f64,
    /// The fitted BRDF.
    #[serde(skip, default = "black")]
    pub brdf: Arc<dyn Brdf>,
}

/// All models' fits in one channel.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ChannelModels {
    /// Channel name.
    pub channel: String,
    /// Number of values fitted to.
    pub points: usize,
    /// Index into `fits` of the best by BIC.
    pub best: usize,
    /// Index into `fits` of the best by AIC.
    pub best_by_aic: usize,
    /// The fits, in increasing BIC.
    pub fits: Vec<ModelFit>,
}

/// The content of `brdf_models.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BrdfModels {
    /// Version of the file's layout.
    pub format: u32,
    /// Unit of ρ.
    pub unit: String,
    /// Per channel.
    pub channels: Vec<ChannelModels>,
}

/// What a fit holds before [`BrdfModels::restore`].
fn black() -> Arc<dyn Brdf> {
    Arc::new(Lambertian { albedo: 0.0 })
}

impl BrdfModels {
    /// Builds the fitted BRDFs again from their names and parameters, after models were read from a file.
    ///
    /// # Errors
    /// If a model has an unknown name or lacks a parameter.
    pub fn restore(&mut self) -> Result<()> {
        for fit in self.channels.iter_mut().flat_map(|c| &mut c.fits) {
            fit.brdf = candidate::built(&fit.model, &fit.parameters).ok_or_else(|| {
                Error::input(format!(
                    "expected a known model with all its parameters, found \"{}\"",
                    fit.model
                ))
            })?;
        }
        Ok(())
    }
}

/// Fits every model to every channel of a table. Without σ columns all cells weigh the same in ρ cos cos.
///
/// # Errors
/// If a channel has too few values.
pub fn fit_table(table: &SliceTable, options: FitOptions) -> Result<BrdfModels> {
    let channels = (0..table.channels.len())
        .map(|c| {
            let options = FitOptions {
                known_variance: options.known_variance && !table.sigma.is_empty(),
                ..options
            };
            fit_slice(&table.channels[c], &points_of(table, c), options)
        })
        .collect::<Result<_>>()?;
    Ok(BrdfModels {
        format: 1,
        unit: "1/sr".into(),
        channels,
    })
}

/// The measured cells of a channel. Of two mirrored cells with exactly the same value, as a reciprocal recovery leaves them, only one counts.
fn points_of(table: &SliceTable, channel: usize) -> Vec<SlicePoint> {
    let (rows, columns) = (table.incident.count, table.exitant.count);
    let at =
        |all: &[Vec<f64>], cell: usize| -> Option<f64> { all.get(channel)?.get(cell).copied() };
    let mut points = Vec::new();
    for i in 0..rows {
        for j in 0..columns {
            let cell = i * columns + j;
            let Some(rho) = at(&table.rho, cell) else {
                continue;
            };
            let copied = table.incident == table.exitant
                && j < i
                && at(&table.rho, j * columns + i) == Some(rho);
            let (incident, exitant) = (table.incident.angle(i), table.exitant.angle(j));
            let cosines = incident.visible_cosine() * exitant.visible_cosine();
            let variance = if table.sigma.is_empty() {
                1.0 / (cosines * cosines)
            } else {
                at(&table.sigma, cell).map_or(f64::NAN, |s| s * s)
            };
            // At the horizon itself ρ cos cos is 0 and says nothing.
            if !copied && cosines > 1e-9 {
                points.push(SlicePoint {
                    incident,
                    exitant,
                    rho,
                    variance,
                });
            }
        }
    }
    points
}

/// Fits every model to the points with a finite ρ and a finite variance above 0.
///
/// # Errors
/// If fewer than 20 such points are there.
pub fn fit_slice(
    channel: &str,
    points: &[SlicePoint],
    options: FitOptions,
) -> Result<ChannelModels> {
    let points = usable(points);
    if points.len() < 20 {
        return Err(Error::failed(format!(
            "expected at least 20 measured values to fit models to in channel {channel}, found {}",
            points.len()
        )));
    }
    let mut fits: Vec<ModelFit> = Candidate::all(options.absolute)
        .par_iter()
        .map(|candidate| candidate.fit(&points, options))
        .collect();
    fits.sort_by(|a, b| a.bic.total_cmp(&b.bic));
    // Of two forms of one model with the same parameters (a metal with and without a factor) the better one stays.
    let mut seen: Vec<(String, Vec<String>)> = Vec::new();
    fits.retain(|fit| {
        let names = fit.parameters.iter().map(|p| p.name.clone()).collect();
        let form = (fit.model.clone(), names);
        let new = !seen.contains(&form);
        seen.push(form);
        new
    });
    let best_by_aic = (0..fits.len())
        .min_by(|&a, &b| fits[a].aic.total_cmp(&fits[b].aic))
        .unwrap_or(0);
    Ok(ChannelModels {
        channel: channel.to_string(),
        points: points.len(),
        best: 0,
        best_by_aic,
        fits,
    })
}

/// The points that carry information.
fn usable(points: &[SlicePoint]) -> Vec<SlicePoint> {
    points
        .iter()
        .filter(|p| p.rho.is_finite() && p.variance.is_finite() && p.variance > 0.0)
        .filter(|p| p.incident.visible_cosine() > 0.0 && p.exitant.visible_cosine() > 0.0)
        .copied()
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{Axis, Family, Material};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// A planted model on a 2° grid within ±80°, with noise of `level` times the largest ρ cos cos in ρ cos cos.
    fn planted(family: Family, values: &[f64], lambert: f64, level: f64, seed: u64) -> SliceTable {
        planted_on(90, family, values, lambert, level, seed)
    }

    /// The same with `n` cells along each side.
    fn planted_on(
        n: usize,
        family: Family,
        values: &[f64],
        lambert: f64,
        level: f64,
        seed: u64,
    ) -> SliceTable {
        let axis = Axis {
            count: n,
            inclusive: false,
        };
        let material = Material {
            channels: vec!["Y".into()],
            brdfs: vec![family.build(values)],
        };
        let mut table = SliceTable::of(&material, axis, axis);
        let cosines =
            |c: usize| axis.angle(c / n).visible_cosine() * axis.angle(c % n).visible_cosine();
        for rho in &mut table.rho[0] {
            *rho += lambert / std::f64::consts::PI;
        }
        let seen =
            |c: usize| axis.angle(c / n).deg().abs() < 80.0 && axis.angle(c % n).deg().abs() < 80.0;
        let largest = (0..n * n)
            .filter(|c| seen(*c))
            .map(|c| table.rho[0][c] * cosines(c))
            .fold(0.0, f64::max);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        table.sigma = vec![(0..n * n).map(|c| level * largest / cosines(c)).collect()];
        for c in 0..n * n {
            let noise: f64 = StandardNormal.sample(&mut random);
            table.rho[0][c] += noise * table.sigma[0][c];
            if !seen(c) {
                table.rho[0][c] = f64::NAN;
            }
        }
        table
    }

    #[test]
    fn planted_models_are_recognised_and_their_parameters_recovered() {
        let plants: [(Family, &[f64], f64); 12] = [
            (Family::Phong, &[0.05, 0.5, 800.0], 0.0),
            (Family::GgxConductor, &[0.04, 0.2, 3.9, 1.0], 0.1),
            (Family::Phong, &[0.3, 0.4, 32.0], 0.0),
            (Family::Blinn, &[0.2, 0.3, 60.0], 0.0),
            (Family::Ward, &[0.2, 0.2, 0.15], 0.0),
            (Family::TorranceSparrow, &[0.3, 0.2, 1.6], 0.0),
            (Family::GgxConductor, &[0.2, 1.2, 2.5, 1.0], 0.1),
            (Family::GgxConductor, &[0.3, 1.5, 3.0, 0.6], 0.2),
            (Family::GgxDielectric, &[0.4, 0.15, 1.5], 0.0),
            (Family::OrenNayar, &[0.6, 25.0], 0.0),
            (Family::Sheen, &[0.1, 0.6, 0.4], 0.0),
            (Family::HorizonSheen, &[0.2, 0.5, 3.0], 0.0),
        ];
        for (seed, (family, values, lambert)) in plants.into_iter().enumerate() {
            for level in [1e-3, 1e-2] {
                let table = planted(family, values, lambert, level, seed as u64);
                let models = fit_table(&table, FitOptions::default()).expect("enough points");
                let channel = &models.channels[0];
                let best = &channel.fits[channel.best];
                assert_eq!(best.model, family.name(), "{family:?} at {level}: {best:?}");
                for p in &best.parameters {
                    let place = family.parameters().iter().position(|q| q.name == p.name);
                    let truth = place.map_or(lambert, |k| values[k]);
                    let Some(sigma) = p.sigma else {
                        assert_eq!(p.value, truth, "{family:?} {p:?} is fixed");
                        continue;
                    };
                    // 54 comparisons: a 4 σ deviation by chance has odds of 1 in 300.
                    assert!(
                        (p.value - truth).abs() < 4.0 * sigma,
                        "{family:?} at {level}: {p:?}, planted {truth}"
                    );
                    // At 1 % of a narrow lobe's peak, 60 sr⁻¹, the weak parts drown.
                    let telling = level > 1e-3 || sigma < 0.3 * truth.max(0.1);
                    assert!(telling, "{family:?} at {level}: {p:?} says nothing");
                }
                // χ² is N ± √(2N): five of its deviations.
                let n = best.degrees_of_freedom as f64;
                assert!(
                    (best.chi_square - n).abs() < 5.0 * (2.0 * n).sqrt(),
                    "{family:?}: {}",
                    best.chi_square / n
                );
            }
        }
    }

    #[test]
    fn sigma_is_the_scatter_over_many_draws() {
        let plants: [(Family, &[f64], f64, f64); 10] = [
            (Family::Phong, &[0.3, 0.4, 32.0], 0.0, 0.01),
            (Family::Blinn, &[0.2, 0.3, 60.0], 0.0, 0.01),
            (Family::Ward, &[0.2, 0.2, 0.15], 0.0, 0.01),
            (Family::TorranceSparrow, &[0.3, 0.2, 1.6], 0.0, 0.003),
            // η and k are known apart at little noise only.
            (Family::GgxConductor, &[0.2, 1.2, 2.5, 1.0], 0.1, 1e-3),
            (Family::GgxDielectric, &[0.4, 0.15, 1.5], 0.0, 0.003),
            (Family::OrenNayar, &[0.6, 25.0], 0.0, 0.003),
            (Family::Sheen, &[0.1, 0.6, 0.4], 0.0, 0.003),
            (Family::HorizonSheen, &[0.2, 0.5, 3.0], 0.0, 0.003),
            (Family::Lambertian, &[0.5], 0.0, 0.01),
        ];
        let draws = 120u64;
        let (mut all, mut count) = (0.0, 0.0);
        for (k, (family, values, lambert, level)) in plants.into_iter().enumerate() {
            let fits: Vec<ModelFit> = (0..draws)
                .into_par_iter()
                .map(|draw| {
                    let seed = 1000 * k as u64 + draw;
                    let table = planted_on(30, family, values, lambert, level, seed);
                    let points = usable(&points_of(&table, 0));
                    // Of a metal the form without a factor, which stands last.
                    let candidates = Candidate::all(true);
                    let own = candidates.iter().rfind(|c| c.is_of(family));
                    own.expect("a candidate")
                        .fit(&points, FitOptions::default())
                })
                .collect();
            for (i, first) in fits[0].parameters.iter().enumerate() {
                let place = family
                    .parameters()
                    .iter()
                    .position(|q| q.name == first.name);
                let truth = place.map_or(lambert, |k| values[k]);
                let z: Vec<f64> = fits
                    .iter()
                    .filter_map(|f| Some((f.parameters[i].value - truth) / f.parameters[i].sigma?))
                    .collect();
                if z.is_empty() {
                    // Held fixed.
                    continue;
                }
                let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
                println!("{family:?} {}: z {rms:.3} of {}", first.name, z.len());
                // 120 draws give it to 6.5 %; four of those, since there are thirty.
                assert!(z.len() > 110, "{family:?} {}: {}", first.name, z.len());
                assert!(
                    (0.74..1.26).contains(&rms),
                    "{family:?} {}: {rms}",
                    first.name
                );
                all += rms * rms;
                count += 1.0;
            }
        }
        // All together: some 3000 numbers, half of them independent.
        let rms = f64::sqrt(all / count);
        assert!((0.94..1.06).contains(&rms), "{rms}");
    }

    #[test]
    fn a_relative_scale_and_unknown_noise_are_allowed() {
        let mut table = planted(Family::GgxDielectric, &[0.4, 0.15, 1.5], 0.0, 1e-3, 7);
        for rho in &mut table.rho[0] {
            *rho *= 250.0;
        }
        table.sigma.clear();
        let options = FitOptions {
            absolute: false,
            known_variance: false,
        };
        let models = fit_table(&table, options).expect("enough points");
        let best = &models.channels[0].fits[0];
        assert_eq!(best.model, "ggx-dielectric");
        for p in &best.parameters {
            let truth = match p.name.as_str() {
                "diffuse" => 0.4,
                "alpha" => 0.15,
                "ior" => 1.5,
                _ => 250.0,
            };
            let sigma = p.sigma.expect("determined");
            assert!((p.value - truth).abs() < 4.0 * sigma, "{p:?}");
        }
        let json = serde_json::to_string(&models).expect("serialisable");
        assert!(json.contains("\"model\":\"ggx-dielectric\"") && !json.contains("nan"));
    }

    #[test]
    fn a_reciprocal_copy_is_no_second_measurement() {
        let mut table = planted(Family::Phong, &[0.3, 0.4, 32.0], 0.0, 0.01, 3);
        let whole = points_of(&table, 0)
            .iter()
            .filter(|p| p.rho.is_finite())
            .count();
        for i in 0..90 {
            for j in 0..i {
                table.rho[0][i * 90 + j] = table.rho[0][j * 90 + i];
            }
        }
        let half = points_of(&table, 0)
            .iter()
            .filter(|p| p.rho.is_finite())
            .count();
        assert_eq!((whole, half), (6400, 6400 / 2 + 40));
    }

    #[test]
    fn on_a_lambertian_surface_the_richer_models_fit_as_well_and_the_simplest_wins() {
        let table = planted(Family::Lambertian, &[0.5], 0.0, 0.01, 11);
        let models = fit_table(&table, FitOptions::default()).expect("enough points");
        let fits = &models.channels[0].fits;
        assert_eq!(fits[0].model, "lambertian");
        let simplest = fits[0].chi_square;
        for fit in fits {
            // All others hold Lambert's surface as a limit, and their bounds include it to 1e-3 in reflectance.
            assert!(
                fit.chi_square <= simplest * 1.002,
                "{fit:?} against {simplest}"
            );
        }
    }

    #[test]
    fn too_few_points_are_an_error() {
        assert!(fit_slice("Y", &[], FitOptions::default()).is_err());
    }
}
