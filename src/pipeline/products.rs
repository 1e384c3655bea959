//! The files that a run leaves, and the folder that holds them: each is whole or not there.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::joint::ChannelGauge;
use super::run::Run;
use super::{brdf_products, material, record};
use crate::brdf::fit::BrdfModels;
use crate::error::{Error, Result};
use crate::files::{self, Claim, STAGING};
use crate::light_field::{Part, encode};
use crate::lighting::{SpectrumRow, environment::lat_long, spectrum_csv, values_csv};
use crate::recover::Status;
use crate::recover::brdf::{BrdfEstimate, Slice};
use crate::recover::lighting::LightingEstimate;

/// Name of the file that tells which inputs and settings a folder was made from.
const PROVENANCE: &str = "provenance.json";
/// Version of the folder's layout.
const FORMAT: u32 = 1;

/// Makes the bytes of a file.
type Make<'a> = dyn Fn() -> Result<Vec<u8>> + Send + Sync + 'a;

/// A file of a run: its name and what makes its bytes.
pub struct Product<'a> {
    /// Name in the output folder.
    pub name: &'static str,
    make: Box<Make<'a>>,
}

impl<'a> Product<'a> {
    fn new(name: &'static str, make: impl Fn() -> Result<Vec<u8>> + Send + Sync + 'a) -> Self {
        Self {
            name,
            make: Box::new(make),
        }
    }
}

/// Makes the page that reports a run.
pub type Page<'a> = dyn Fn(&Run) -> Result<String> + Sync + 'a;

/// The products that `run` has; `page` makes the report.
pub fn products<'a>(run: &'a Run, page: &'a Page<'a>) -> Vec<Product<'a>> {
    let mut products = vec![
        Product::new("report.html", move || Ok(page(run)?.into_bytes())),
        Product::new("summary.json", move || Ok(pretty(&summary(run)))),
        Product::new(record::RECORD, move || record::text(run)),
        Product::new("recipe.toml", move || {
            Ok(run.recipe_toml.clone().into_bytes())
        }),
        Product::new("capture.toml", move || {
            Ok(run.capture_toml.clone().into_bytes())
        }),
        Product::new("light_field.exr", move || {
            encode(&[run.light_field.part("light field")])
        }),
    ];
    if let Some(lighting) = &run.lighting {
        products.extend(lighting_products(run, lighting));
    }
    if let Some(brdf) = &run.brdf {
        products.extend(brdf_products(brdf));
    }
    if let Some(models) = &run.models {
        products.push(Product::new("brdf_models.json", move || {
            models_json(models)
        }));
    }
    if let Some(residual) = &run.residual {
        products.push(Product::new("residual.exr", move || {
            let mut parts = vec![residual.part("light field")];
            parts.extend(run.view_residual.iter().map(Part::borrowed));
            encode(&parts)
        }));
    }
    products
}

fn brdf_products(brdf: &BrdfEstimate) -> Vec<Product<'_>> {
    vec![
        Product::new("brdf.csv", move || {
            Ok(material::table(brdf, 1).to_csv().into_bytes())
        }),
        Product::new("brdf_spectrum.csv", move || {
            Ok(brdf_products::spectrum_csv(brdf).into_bytes())
        }),
        Product::new("brdf.exr", move || encode(&[brdf_products::image(brdf)])),
    ]
}

fn models_json(models: &BrdfModels) -> Result<Vec<u8>> {
    let value = serde_json::to_value(models)
        .map_err(|e| Error::failed(format!("the models cannot be written as JSON: {e}")))?;
    Ok(pretty(&value))
}

fn lighting_products<'a>(run: &'a Run, lighting: &'a LightingEstimate) -> Vec<Product<'a>> {
    vec![
        Product::new("lighting.csv", move || {
            let values: Vec<Vec<f64>> = lighting.channels.iter().map(|c| c.table.clone()).collect();
            let sigma: Vec<Vec<f64>> = lighting
                .channels
                .iter()
                .map(|c| c.table_sigma.clone())
                .collect();
            Ok(values_csv(&run.channels, &values, Some(&sigma)).into_bytes())
        }),
        Product::new("lighting_spectrum.csv", move || {
            let rows: Vec<SpectrumRow> = lighting
                .channels
                .iter()
                .flat_map(|c| {
                    c.spectrum.iter().enumerate().map(|(p, l)| SpectrumRow {
                        channel: c.name.clone(),
                        p,
                        value: l.value,
                        sigma: Some(l.sigma),
                        status: l.status,
                    })
                })
                .collect();
            Ok(spectrum_csv(&rows).into_bytes())
        }),
        Product::new("lighting.exr", move || {
            lat_long(&lighting.without_negative())
        }),
    ]
}

fn pretty(value: &serde_json::Value) -> Vec<u8> {
    let mut text = format!("{value:#}");
    text.push('\n');
    text.into_bytes()
}

/// All scalars of the run.
fn summary(run: &Run) -> serde_json::Value {
    let mut channels = Vec::new();
    for (c, name) in run.channels.iter().enumerate() {
        let mut channel = json!({
            "name": name,
            "coverage": run.light_field.coverage(c, run.limb_cut),
        });
        if let Some(object) = channel.as_object_mut() {
            if let Some(fit) = run.fit.get(c) {
                object.insert("residual_rms".into(), json!(fit.residual_rms));
                object.insert("residual_relative".into(), json!(fit.residual_relative));
                object.insert("chi2".into(), json!(fit.chi2));
                object.insert("unexplained".into(), json!(fit.unexplained));
                if let Some(violation) = fit.violation {
                    object.insert("violation_of_reciprocity".into(), json!(violation));
                }
                if let Some(across) = fit.across {
                    object.insert("change_across_plane".into(), json!(across));
                }
                object.insert("verdict".into(), json!(fit.verdict));
            }
            if let Some(l) = run.lighting.as_ref().and_then(|l| l.channels.get(c)) {
                object.insert("determined_band".into(), json!(l.determined_band));
                object.insert("regularisation".into(), json!(l.regularisation));
                let total = std::f64::consts::TAU * l.spectrum.first().map_or(0.0, |p| p.value.re);
                object.insert("total_irradiance".into(), json!(total));
                let bound: Vec<Option<f64>> = l
                    .spectrum
                    .iter()
                    .map(|p| p.bound.is_finite().then_some(p.bound))
                    .collect();
                object.insert("bound".into(), json!(bound));
            }
            if let Some(brdf) = run.brdf.as_ref().and_then(|b| b.slices.get(c)) {
                object.insert("brdf".into(), brdf_summary(brdf));
            }
            if let Some(gauge) = run.gauge.get(c) {
                object.insert("gauge".into(), gauge_summary(gauge));
            }
        }
        channels.push(channel);
    }
    json!({
        "format": FORMAT,
        "program": "flatlight",
        "version": run.version,
        "title": run.title,
        "capture": run.capture_name,
        "recover": run.recover,
        "radiance_unit": run.radiance_unit,
        "views": run.views,
        "orbit_refinement": run.orbit,
        "limb_cut_deg": run.limb_cut.to_degrees(),
        "channels": channels,
        "sources": run.lighting.as_ref().map_or(&[][..], |l| &l.sources),
        "findings": run.findings,
        "warnings": run.warnings,
        "stage_seconds": run.stage_seconds.iter().cloned().collect::<BTreeMap<_, _>>(),
    })
}

/// Scalars of a recovered slice.
fn brdf_summary(slice: &Slice) -> serde_json::Value {
    let share = |status| material::share(&slice.status, status);
    json!({
        "determined_share": share(Status::Determined),
        "weak_share": share(Status::Weak),
        "indeterminate_share": share(Status::Indeterminate),
        "samples": slice.samples,
        "parameters": slice.parameters,
        "noise_factor": slice.noise.sqrt(),
        "resolution_deg": slice.resolution.to_degrees(),
        "held_at_zero": slice.held,
        "smoothness": {
            "amplitude": slice.smoothness.amplitude,
            "across": slice.smoothness.across,
            "along": slice.smoothness.along,
        },
    })
}

/// What a recovery of both left free, and the comparison with the paper's ratios.
fn gauge_summary(gauge: &ChannelGauge) -> serde_json::Value {
    json!({
        "scale": gauge.scale,
        "band": gauge.band,
        "resolved": gauge.resolved,
        "components": gauge.components,
        "undetermined": gauge.undetermined,
        "eigenvalues": gauge.eigenvalues,
        "misfit": gauge.misfit,
        "converged": gauge.converged,
        "difference_of_eigenproblem": gauge.eigenproblem_difference,
        "difference_of_eq_29": gauge.ratios_difference,
        "parametric": gauge.parametric,
    })
}

/// What a folder was made from and what it holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Provenance {
    format: u32,
    program: String,
    version: String,
    /// blake3 of every input file.
    inputs: BTreeMap<String, String>,
    /// blake3 of the resolved recipe.
    recipe: String,
    /// blake3 of the resolved capture.
    capture: String,
    /// blake3 of every product.
    products: BTreeMap<String, String>,
}

/// The output folder of a run.
#[derive(Clone, Debug)]
pub struct Folder {
    path: PathBuf,
}

/// What stands in an output folder before a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Nothing, or what may be replaced.
    Free,
    /// The same run, complete: nothing is left to do.
    Same,
}

impl Folder {
    /// The folder at `path`, which need not exist yet.
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.to_path_buf(),
        }
    }

    /// Looks whether a run with these inputs may be written here.
    ///
    /// # Errors
    /// If the folder holds anything but the same run, unless `force` is set.
    pub fn look(
        &self,
        inputs: &BTreeMap<String, String>,
        recipe_toml: &str,
        capture_toml: &str,
        force: bool,
    ) -> Result<Found> {
        let entries = match fs::read_dir(&self.path) {
            Ok(entries) => entries,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Found::Free),
            Err(e) if e.kind() == std::io::ErrorKind::NotADirectory => {
                return Err(Error::input(
                    "expected a folder for the products, found a file or something under one",
                )
                .file(&self.path)
                .advice("Give another folder with --out."));
            }
            Err(e) => return Err(Error::read(&self.path, e)),
        };
        let names: Vec<String> = entries
            .filter_map(|e| e.ok().map(|e| e.file_name().to_string_lossy().into_owned()))
            .filter(|name| !name.starts_with(STAGING))
            .collect();
        if names.is_empty() {
            return Ok(Found::Free);
        }
        let held = read_provenance(&self.path.join(PROVENANCE));
        if !force
            && let Some(held) = &held
            && held.version == env!("CARGO_PKG_VERSION")
            && held.format == FORMAT
            && held.inputs == *inputs
            && held.recipe == hash(recipe_toml.as_bytes())
            && held.capture == hash(capture_toml.as_bytes())
        {
            let whole = held.products.iter().all(|(name, expected)| {
                files::bytes(&self.path.join(name)).is_ok_and(|bytes| hash(&bytes) == *expected)
            });
            // The same run, damaged: it is made again over what is left of it.
            return Ok(if whole { Found::Same } else { Found::Free });
        }
        if force {
            return Ok(Found::Free);
        }
        let what = if held.is_some() {
            "the folder holds a run of other photos or settings"
        } else {
            "the folder holds files that are not from this run"
        };
        Err(Error::input(what)
            .file(&self.path)
            .advice("Give another folder with --out, or --force to write into this one."))
    }

    /// The run that the folder holds, as far as a report needs it.
    ///
    /// # Errors
    /// If a file is missing, damaged, or of another version of this program.
    pub fn read(&self) -> Result<Run> {
        record::read_back(&self.path)
    }

    /// Replaces the report of the run that the folder holds.
    ///
    /// # Errors
    /// If a file cannot be read or written; the former report is whole then.
    pub fn replace_report(&self, report: &str) -> Result<()> {
        let path = self.path.join(PROVENANCE);
        let bytes = files::bytes(&path)?;
        let mut held: Provenance =
            serde_json::from_slice(&bytes).map_err(|e| Error::read(&path, e))?;
        held.products
            .insert("report.html".into(), hash(report.as_bytes()));
        let text = serde_json::to_value(&held)
            .map_err(|e| Error::failed(format!("provenance cannot be written as JSON: {e}")))?;
        files::write_whole(&self.path.join("report.html"), report.as_bytes())?;
        files::write_whole(&path, &pretty(&text))
    }

    /// Writes all products: first all into a folder of their own, flushed to the disk, `provenance.json` last; then each
    /// to its name, `provenance.json` last. A process that ends in between leaves complete files of the former or of this run
    /// only, and [`Folder::claim`] brings them to either the one or the other.
    ///
    /// # Errors
    /// If a file cannot be written; nothing of the folder has changed then unless the renaming itself failed.
    pub fn write(&self, run: &Run, report: &str) -> Result<()> {
        self.write_with(run, &|_| Ok(report.to_owned()))
    }

    /// The same with the report made while the other products are written.
    ///
    /// # Errors
    /// As [`Self::write`], and if `page` fails.
    pub fn write_with(&self, run: &Run, page: &Page<'_>) -> Result<()> {
        files::make_folder(&self.path)?;
        if let Err(error) = self.stage(run, page) {
            // Nothing reads what is left of it, if it cannot be removed either.
            let _ = files::discard(&self.path);
            return Err(error);
        }
        self.commit()
    }

    /// Writes all products into the staging folder.
    fn stage(&self, run: &Run, page: &Page<'_>) -> Result<()> {
        let staging = files::stage(&self.path)?;
        let products = products(run, page);
        let hashes: BTreeMap<String, String> = thread::scope(|scope| {
            let written: Vec<_> = products
                .par_iter()
                .map(|product| {
                    let named = |e: Error| e.file(self.path.join(product.name));
                    let bytes = (product.make)().map_err(named)?;
                    let path = staging.join(product.name);
                    let file = Arc::new(files::write_unflushed(&path, &bytes).map_err(named)?);
                    // While the disk is waited for, a processor has other work.
                    let own = Arc::clone(&file);
                    let flushing = thread::Builder::new().spawn_scoped(scope, move || own.flush());
                    if flushing.is_err() {
                        file.flush().map_err(named)?;
                    }
                    Ok((product.name, hash(&bytes), flushing.ok()))
                })
                .collect::<Result<_>>()?;
            written
                .into_iter()
                .map(|(name, hash, flushing)| {
                    let ended = flushing.map(thread::ScopedJoinHandle::join).transpose();
                    let flushed = ended.map_err(|_| Error::failed("a file was not flushed"));
                    let flushed = flushed.and_then(Option::transpose);
                    flushed.map_err(|e| e.file(self.path.join(name)))?;
                    Ok((name.to_string(), hash))
                })
                .collect::<Result<_>>()
        })?;
        let provenance = Provenance {
            format: FORMAT,
            program: "flatlight".into(),
            version: run.version.clone(),
            inputs: run.input_hashes.clone(),
            recipe: hash(run.recipe_toml.as_bytes()),
            capture: hash(run.capture_toml.as_bytes()),
            products: hashes,
        };
        let text = serde_json::to_value(&provenance)
            .map_err(|e| Error::failed(format!("provenance cannot be written as JSON: {e}")))?;
        // Whole, for its being there says that all others are. Their names reach the disk with its own: without one of them it
        // says nothing, and until then no name in the folder has changed.
        files::write_whole(&staging.join(PROVENANCE), &pretty(&text))
    }

    /// Gives the staged products their names.
    fn commit(&self) -> Result<()> {
        let file = self.path.join(STAGING).join(PROVENANCE);
        let provenance: Provenance =
            serde_json::from_slice(&files::bytes(&file)?).map_err(|e| Error::read(&file, e))?;
        let names: Vec<&str> = provenance.products.keys().map(String::as_str).collect();
        // What an earlier run left and this one does not have must not be taken for its result.
        let stale: Vec<&str> = ALL_PRODUCTS
            .into_iter()
            .filter(|name| !names.contains(name))
            .collect();
        files::commit(&self.path, &names, &stale, PROVENANCE)
    }

    /// Takes the folder for this process alone, until the value is dropped; makes it if it is not there, and finishes or
    /// undoes what an interrupted run left half done. A folder that was made and stays empty is removed again.
    ///
    /// # Errors
    /// If another process holds it, or it cannot be made or written to.
    pub fn claim(&self) -> Result<Claim> {
        let claim = files::claim(&self.path)?;
        self.repair()?;
        Ok(claim)
    }

    /// Keeps the folder as it is while it is read, until the value is dropped; finishes before what an interrupted run left half done.
    ///
    /// # Errors
    /// If another process writes to it, or what was left cannot be finished.
    pub fn share(&self) -> Result<Claim> {
        if self.path.join(STAGING).exists() {
            self.claim()?;
        }
        files::share(&self.path)
    }

    /// Finishes the commit of an interrupted run whose products were all staged; removes what is left of one that had not come
    /// so far.
    fn repair(&self) -> Result<()> {
        let staging = self.path.join(STAGING);
        if !staging.exists() {
            return Ok(());
        }
        let whole = |provenance: &Provenance| {
            provenance.products.iter().all(|(name, expected)| {
                let known = ALL_PRODUCTS.contains(&name.as_str());
                let is = |folder: &Path| {
                    files::bytes(&folder.join(name)).is_ok_and(|bytes| hash(&bytes) == *expected)
                };
                known && (is(&staging) || is(&self.path))
            })
        };
        if read_provenance(&staging.join(PROVENANCE)).is_some_and(|p| whole(&p)) {
            return self.commit();
        }
        files::discard(&self.path)
    }
}

fn read_provenance(path: &Path) -> Option<Provenance> {
    serde_json::from_slice(&files::bytes(path).ok()?).ok()
}

/// Every name a product can have.
const ALL_PRODUCTS: [&str; 14] = [
    "report.html",
    "summary.json",
    "recipe.toml",
    "capture.toml",
    "light_field.exr",
    "lighting.csv",
    "lighting_spectrum.csv",
    "lighting.exr",
    "run.json",
    "brdf.csv",
    "brdf_spectrum.csv",
    "brdf.exr",
    "brdf_models.json",
    "residual.exr",
];

fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}
