//! One cell of a study: its definition, its draws, and their comparison with the truth.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use num_complex::Complex64;
use serde::{Deserialize, Serialize};

use super::scene::Scene;
use super::tally::{Draw, Judged, Outcome, Quantity, determined, tally};
use crate::angle::LocalAngle;
use crate::error::{Error, Result};
use crate::fourier::Series;
use crate::pipeline::known;
use crate::recover::{Status, brdf, factorise, lighting};

/// Cells of the half × half grid on which a BRDF is compared: one every 4°, about the spacing of its splines.
const BRDF_SIZE: usize = 45;
/// Highest frequency of the slice's spectrum that is compared, where no value of it is determined.
const BRDF_ORDER: usize = 16;
/// Panels of the quadrature of the true spectrum.
const PANELS: usize = 300;

/// Which recovery a cell is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Recovered {
    /// Lighting from a known BRDF.
    Lighting,
    /// BRDF from known lighting.
    Brdf,
    /// Both from the light field alone.
    Both,
}

impl Recovered {
    /// The word in recipe and table.
    pub fn word(self) -> &'static str {
        match self {
            Self::Lighting => "lighting",
            Self::Brdf => "brdf",
            Self::Both => "both",
        }
    }

    /// What is judged of it, in the order of the table.
    pub fn quantities(self) -> &'static [Quantity] {
        match self {
            Self::Lighting => &[Quantity::Lighting],
            Self::Brdf => &[Quantity::Brdf],
            Self::Both => &[Quantity::Lighting, Quantity::Brdf],
        }
    }

    /// The ratio of error to bound that is promised.
    pub fn promised_ratio(self) -> f64 {
        match self {
            Self::Both => 1.25,
            _ => 1.1,
        }
    }
}

/// All that defines a cell: equal cells give equal outcomes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Name of the study.
    pub study: String,
    /// What is recovered.
    pub recovered: Recovered,
    /// Name of the BRDF.
    pub brdf: String,
    /// Its parameters.
    pub brdf_table: toml::Table,
    /// Name of the lighting.
    pub lighting: String,
    /// Its parameters.
    pub lighting_table: toml::Table,
    /// Standard deviation of the noise of a sample, relative to the largest value of the light field.
    pub noise: f64,
    /// Number of views.
    pub views: usize,
    /// The arc over which they are spread, degrees.
    pub arc_deg: f64,
    /// Columns over θo′ in (−90°, 90°).
    pub locals: usize,
    /// |θo′| beyond which there are no samples, degrees.
    pub limb_cut_deg: f64,
    /// Number of draws.
    pub draws: usize,
    /// Seed of the study.
    pub seed: u64,
}

impl Cell {
    /// Rows of the grid over the full circle: the views would be so many if they went all around.
    pub fn normals(&self) -> usize {
        (self.views as f64 * 360.0 / self.arc_deg).round() as usize
    }

    /// What a person calls it.
    pub fn label(&self) -> String {
        format!(
            "{} · {} · {} · {} % · {} views",
            self.recovered.word(),
            self.brdf,
            self.lighting,
            100.0 * self.noise,
            self.views
        )
    }

    /// Whether two cells have the same noiseless light field.
    fn same_field(&self, other: &Self) -> bool {
        self.brdf_table == other.brdf_table
            && self.lighting_table == other.lighting_table
            && self.normals() == other.normals()
            && self.locals == other.locals
    }

    /// Seed of one draw: a hash of all that tells draws apart, so that neither order nor neighbours matter.
    fn draw_seed(&self, draw: usize) -> u64 {
        let text = format!(
            "{}/{}/{}/{}/{}/{}/{}/{draw}",
            self.seed,
            self.recovered.word(),
            self.brdf,
            self.lighting,
            self.noise,
            self.views,
            self.arc_deg
        );
        let hash = blake3::hash(text.as_bytes());
        let mut first = [0; 8];
        first.copy_from_slice(&hash.as_bytes()[..8]);
        u64::from_le_bytes(first)
    }
}

/// A cell ready to be drawn.
pub(super) struct Prepared<'a> {
    cell: &'a Cell,
    scene: Scene,
    /// Of a cell whose BRDF is judged.
    slice: TrueSlice,
}

/// One draw: what is judged of it, in the order of [`Recovered::quantities`].
pub(super) type Drawn = Vec<Draw>;

/// The planted slice: what a BRDF is compared with.
#[derive(Default)]
struct TrueSlice {
    /// ρ̃ at [`cells`].
    values: Vec<f64>,
    /// ρ̃_{p,q} for 0 ≤ p ≤ [`BRDF_ORDER`], |q| ≤ p, in the order of the recovery.
    spectrum: Vec<Complex64>,
}

impl<'a> Prepared<'a> {
    /// Makes the light field, or takes that of the cell before if it is the same.
    pub fn new(cell: &'a Cell, last: &mut Option<(Cell, Scene)>) -> Result<Self> {
        let scene = match last {
            Some((before, scene)) if before.same_field(cell) => scene.clone(),
            _ => Scene::new(cell)?,
        };
        *last = Some((cell.clone(), scene.clone()));
        let slice = match cell.recovered {
            Recovered::Lighting => TrueSlice::default(),
            Recovered::Brdf => TrueSlice::new(&scene, 1.0),
            // As the light: in the scale L_0 = 1.
            Recovered::Both => TrueSlice::new(&scene, unit(&scene)),
        };
        Ok(Self { cell, scene, slice })
    }

    /// Recovers from one draw of the noise.
    pub fn draw(&self, draw: usize) -> Result<Drawn> {
        let samples = self
            .scene
            .samples(self.cell, Some(self.cell.draw_seed(draw)));
        match self.cell.recovered {
            Recovered::Lighting => {
                let options = lighting::Options {
                    band: None,
                    regularisation: lighting::Regularisation::Evidence,
                    non_negative: true,
                };
                let found = lighting::recover(&samples, &self.scene.material, &options)?;
                let channel = found.channels.first().ok_or_else(no_channel)?;
                Ok(vec![self.judge_lighting(channel)])
            }
            Recovered::Brdf => {
                let found = brdf::recover(&samples, &self.scene.lighting, &slice_options())?;
                let slice = found.slices.first().ok_or_else(no_channel)?;
                Ok(vec![self.judge_slice(slice)])
            }
            Recovered::Both => {
                let mut found = factorise::recover(&samples, &factorise::Options::default())?;
                let under = known::slice(&mut found, &samples, &[], None, &slice_options())?;
                let channel = found.channels.first().ok_or_else(no_channel)?;
                let slice = under.estimate.slices.first().ok_or_else(no_channel)?;
                Ok(vec![
                    self.judge_factorisation(channel),
                    self.judge_slice(slice),
                ])
            }
        }
    }

    fn judge_lighting(&self, found: &lighting::ChannelEstimate) -> Draw {
        let truth = self
            .scene
            .lighting
            .series(0, found.spectrum.len().saturating_sub(1));
        let quantities = found
            .spectrum
            .iter()
            .zip(&truth.coefficients)
            .enumerate()
            .flat_map(|(p, (c, t))| {
                let error = c.value - t;
                let parts = if p == 0 { 1 } else { 2 };
                [error.re, error.im]
                    .into_iter()
                    .take(parts)
                    .map(|error| Judged {
                        error,
                        sigma: c.sigma,
                        bound_square: c.bound * c.bound,
                        determined: c.status == Status::Determined,
                    })
            })
            .collect();
        Draw {
            quantities,
            band: None,
        }
    }

    /// The values, then the parts of the coefficients.
    fn judge_slice(&self, found: &brdf::Slice) -> Draw {
        let values = cells().zip(&self.slice.values).map(|(k, truth)| Judged {
            error: found.reciprocal[k] - truth,
            sigma: found.sigma[k],
            bound_square: found.bound[k].powi(2),
            determined: found.status[k] == Status::Determined,
        });
        let parts = found
            .spectrum
            .iter()
            .zip(&self.slice.spectrum)
            .flat_map(|(c, truth)| {
                let error = c.value - truth;
                [error.re, error.im]
                    .into_iter()
                    .take(parts(c.p, c.q))
                    .map(|error| Judged {
                        error,
                        sigma: c.sigma,
                        bound_square: c.bound.powi(2),
                        determined: c.status == Status::Determined,
                    })
            });
        let quantities = values.chain(parts).collect();
        let open = found
            .spectrum
            .iter()
            .filter(|c| c.status != Status::Determined)
            .map(|c| c.p)
            .min();
        let highest = found.spectrum.iter().map(|c| c.p).max().unwrap_or(0);
        let band = usize::try_from(open.map_or(highest, |p| p - 1)).ok();
        Draw { quantities, band }
    }

    fn judge_factorisation(&self, found: &factorise::Channel) -> Draw {
        let truth = self.true_unit_lighting(found.band);
        let size = 2 * (found.frequencies.len().saturating_sub(1));
        let mut quantities = Vec::new();
        for p in 1..=found.band {
            let error = found.lighting.get(p as i64) - truth.get(p as i64);
            let position = found.frequencies.iter().position(|&q| q == p);
            for (part, error) in [error.re, error.im].into_iter().enumerate() {
                let own = position.and_then(|i| {
                    let k = 2 * (i - 1) + part;
                    found.covariance.get(k * size + k)
                });
                quantities.push(Judged {
                    error,
                    sigma: own.map_or(found.sigma[p] / 2f64.sqrt(), |v| v.sqrt()),
                    // Filled in for all draws at once: it is that of the truth.
                    bound_square: f64::INFINITY,
                    determined: found.status[p] == crate::lighting::Status::Determined,
                });
            }
        }
        Draw {
            quantities,
            band: None,
        }
    }

    /// The light's series in the scale L_0 = 1.
    fn true_unit_lighting(&self, order: usize) -> Series {
        let mut series = self.scene.lighting.series(0, order);
        for c in &mut series.coefficients {
            *c /= unit(&self.scene);
        }
        series
    }

    /// Compares all draws with the truth: an outcome for each of [`Recovered::quantities`].
    pub fn tally(&self, draws: Vec<Result<Drawn>>) -> Vec<Outcome> {
        let mut failures = Vec::new();
        let good: Vec<Drawn> = draws
            .into_iter()
            .filter_map(|d| d.map_err(|e| failures.push(e.to_string())).ok())
            .collect();
        let succeeded = good.len();
        // The draws of each quantity.
        let mut of: Vec<Vec<Draw>> = self
            .cell
            .recovered
            .quantities()
            .iter()
            .map(|_| Vec::new())
            .collect();
        for drawn in good {
            for (of, draw) in of.iter_mut().zip(drawn) {
                of.push(draw);
            }
        }
        if self.cell.recovered == Recovered::Both
            && let [light, slice] = of.as_mut_slice()
            && let Err(e) = self.bound_both(light, slice)
        {
            failures.push(e.to_string());
        }
        let failure = failures.into_iter().next();
        let quantities = self.cell.recovered.quantities().iter().zip(of);
        quantities
            .map(|(&quantity, draws)| {
                let kept = determined(&draws);
                let outcome = match (quantity, self.cell.recovered) {
                    (Quantity::Lighting, Recovered::Both) => {
                        self.tally_unit_lighting(&draws, &kept)
                    }
                    (Quantity::Lighting, _) => self.tally_lighting(&draws, &kept),
                    (Quantity::Brdf, _) => self.tally_slice(&draws, &kept),
                };
                Outcome {
                    quantity,
                    draws: succeeded,
                    failed: self.cell.draws - succeeded,
                    failure: failure.clone(),
                    ..outcome
                }
            })
            .collect()
    }

    /// Of the values if any is determined, else of the spectrum: light without detail determines averages only. Of `both` it is the other way round, as
    /// light that is found up to a frequency has no detail beyond it, whatever the true one has.
    fn tally_slice(&self, draws: &[Draw], kept: &[bool]) -> Outcome {
        let values = self.slice.values.len();
        let by_value = match self.cell.recovered {
            Recovered::Both => !kept.iter().skip(values).any(|k| *k),
            _ => kept.iter().take(values).any(|k| *k),
        };
        let mut kept = kept.to_vec();
        for (i, kept) in kept.iter_mut().enumerate() {
            *kept &= (i < values) == by_value;
        }
        let of_values = cells().map(|k| match k / BRDF_SIZE == k % BRDF_SIZE {
            true => 1.0,
            false => 2.0,
        });
        // How many of ρ̃_{p,q}, ρ̃_{q,p} and their conjugates are different numbers.
        let of_parts = indices().flat_map(|(p, q)| {
            let alike = match (p, q) {
                (0, 0) => 1.0,
                (p, q) if p == q.abs() => 2.0,
                _ => 4.0,
            };
            std::iter::repeat_n(alike, parts(p, q))
        });
        let weights: Vec<f64> = of_values.chain(of_parts).collect();
        let spectrum = self.slice.spectrum.iter().zip(indices());
        let parts = spectrum.flat_map(|(c, (p, q))| [c.re, c.im].into_iter().take(parts(p, q)));
        let truth = self.slice.values.iter().copied().chain(parts);
        let norm = truth
            .zip(&weights)
            .enumerate()
            .filter(|(i, _)| (*i < values) == by_value)
            .map(|(_, (v, w))| w * v * v)
            .sum::<f64>()
            .sqrt();
        let mut outcome = tally(draws, &kept, &weights, norm);
        outcome.band = draws.iter().map(|d| d.band).min().flatten();
        outcome
    }

    fn tally_lighting(&self, draws: &[Draw], kept: &[bool]) -> Outcome {
        // Quantity 0 is L_0, then real and imaginary part of each.
        let band = kept.iter().rposition(|k| *k).map(|i| i.div_ceil(2));
        // L_p and L_{−p} have the same error.
        let weights: Vec<f64> = (0..kept.len())
            .map(|i| if i == 0 { 1.0 } else { 2.0 })
            .collect();
        let truth = self.scene.lighting.series(0, band.unwrap_or(0));
        let mut outcome = tally(draws, kept, &weights, coefficient_norm(&truth));
        outcome.band = band;
        outcome
    }

    fn tally_unit_lighting(&self, draws: &[Draw], kept: &[bool]) -> Outcome {
        let band = kept.iter().rposition(|k| *k).map(|i| i / 2 + 1);
        let truth = self.true_unit_lighting(band.unwrap_or(0));
        let mut outcome = tally(
            draws,
            kept,
            &vec![2.0; kept.len()],
            coefficient_norm(&truth),
        );
        outcome.band = band;
        outcome
    }

    /// Fills in the bounds of light and slice of `both`, which are those at the truth.
    ///
    /// With J the information of both, that of the slice is the bound under the true light and what the light's own bound does to it.
    fn bound_both(&self, light: &mut [Draw], slice: &mut [Draw]) -> Result<()> {
        // The bound's problem has all frequencies that the fits had.
        let order = determined(light).len() / 2;
        if order == 0 {
            return Ok(());
        }
        let clean = self.scene.samples(self.cell, None);
        let truth = self.true_unit_lighting(order);
        let covariance = factorise::cramer_rao(&clean, 0, &truth, order)?;
        for parts in light.iter_mut().map(|d| d.quantities.chunks_mut(2)) {
            for (p, parts) in parts.enumerate().take(order) {
                let variance = |k: usize| covariance[(2 * p + k) * (2 * order + 1)];
                // Of a part of the complex number, whatever its phase.
                let bound_square = 0.5 * (variance(0) + variance(1));
                for q in parts {
                    q.bound_square = bound_square;
                }
            }
        }
        // The light is taken in its own scale, in which the slice is smaller.
        let light_scale = unit(&self.scene).powi(2);
        let error = brdf::LightError {
            frequencies: (1..=order).collect(),
            covariance: covariance.iter().map(|v| v * light_scale).collect(),
            changes: Vec::new(),
        };
        let light = &self.scene.lighting;
        let found = brdf::recover_under(&clean, light, &[error], &slice_options())?;
        let at_truth = self.judge_slice(found.slices.first().ok_or_else(no_channel)?);
        for draw in slice {
            for (q, truth) in draw.quantities.iter_mut().zip(&at_truth.quantities) {
                q.bound_square = truth.bound_square * light_scale;
            }
        }
        Ok(())
    }
}

impl TrueSlice {
    /// The slice of `scene` times `factor`.
    fn new(scene: &Scene, factor: f64) -> Self {
        let value = |a: f64, b: f64| {
            let rho = scene.material.brdfs.first().map_or(0.0, |brdf| {
                brdf.value(LocalAngle::radians(a), LocalAngle::radians(b))
            });
            factor * rho * a.cos() * b.cos()
        };
        let angle = |k: usize| -FRAC_PI_2 + (k as f64 + 0.5) * PI / BRDF_SIZE as f64;
        let values = cells()
            .map(|k| value(angle(k / BRDF_SIZE), angle(k % BRDF_SIZE)))
            .collect();
        // Two-point Gauss on panels of 0.6°: exact to 1e-9 for lobes that photographs resolve.
        let h = PI / PANELS as f64;
        let nodes: Vec<f64> = (0..PANELS)
            .flat_map(|k| {
                let middle = -FRAC_PI_2 + (k as f64 + 0.5) * h;
                [-0.5, 0.5].map(|side| middle + side * h / 3f64.sqrt())
            })
            .collect();
        // ∫ ρ̃ e^{−ipθi′} dθi′ for each θo′, and then the same over that.
        let half: Vec<Vec<Complex64>> = nodes
            .iter()
            .map(|&b| {
                let mut sums = vec![Complex64::ZERO; BRDF_ORDER + 1];
                for &a in &nodes {
                    let step = Complex64::cis(-a);
                    let mut turn = Complex64::new(value(a, b) * h / 2.0, 0.0);
                    for sum in &mut sums {
                        *sum += turn;
                        turn *= step;
                    }
                }
                sums
            })
            .collect();
        let spectrum = indices()
            .map(|(p, q)| {
                let sum: Complex64 = nodes
                    .iter()
                    .zip(&half)
                    .map(|(b, row)| row[p as usize] * Complex64::cis(-f64::from(q) * b))
                    .sum();
                sum * h / 2.0 / (TAU * TAU)
            })
            .collect();
        Self { values, spectrum }
    }
}

/// How a slice is recovered.
fn slice_options() -> brdf::Options {
    brdf::Options {
        size: BRDF_SIZE,
        order: BRDF_ORDER,
        curve: false,
        ..brdf::Options::default()
    }
}

/// L_0 of the true light, which the recovery of both takes as 1.
fn unit(scene: &Scene) -> f64 {
    scene.lighting.series(0, 0).get(0).re
}

/// (p, q) of the independent coefficients of a real and symmetric ρ̃.
fn indices() -> impl Iterator<Item = (i32, i32)> {
    (0..=BRDF_ORDER as i32).flat_map(|p| (-p..=p).map(move |q| (p, q)))
}

/// Real numbers in ρ̃_{p,q}: it is real if ρ̃_{q,p} is its conjugate.
fn parts(p: i32, q: i32) -> usize {
    if p == -q { 1 } else { 2 }
}

/// (Σ_{|p| ≤ order} |L_p|²)^½.
fn coefficient_norm(series: &Series) -> f64 {
    series
        .coefficients
        .iter()
        .enumerate()
        .map(|(p, c)| if p == 0 { 1.0 } else { 2.0 } * c.norm_sqr())
        .sum::<f64>()
        .sqrt()
}

/// The cells of a symmetric slice that are not each other's mirror image.
fn cells() -> impl Iterator<Item = usize> {
    (0..BRDF_SIZE).flat_map(|i| (0..=i).map(move |j| i * BRDF_SIZE + j))
}

fn no_channel() -> Error {
    Error::failed("the recovery returned no channel")
}
