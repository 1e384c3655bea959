//! `flatlight export`: results in the forms of other programs.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use flatlight::export::{self, Format};
use flatlight::pipeline::Folder;
use flatlight::{Error, Result, files};

use super::{Common, say};

/// Which run, in which forms.
#[derive(Args, Clone, Debug)]
#[command(
    after_help = "Examples:\n  flatlight export out/ --to mitsuba\n  mitsuba -m llvm_ad_rgb -D orbit=45 out/export/scene.xml    the photograph from 45°, rendered\n  flatlight export out/ --to merl,npz,astm --out tables/\n\n\
A run measures the BRDF in the plane of incidence. mitsuba, blender and merl need all of it: they hold the analytic model that fits the slice best, and \
say so. npz and astm hold what was measured."
)]
pub struct Arguments {
    /// The folder that `flatlight run` wrote
    run: PathBuf,
    /// One or more forms, separated by commas
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        required = true,
        value_name = "FORM"
    )]
    to: Vec<Form>,
    /// Folder for the files, made if it does not exist; default: export/ in the run's folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Form {
    /// scene.xml, material.xml, light.xml for Mitsuba 3
    Mitsuba,
    /// environment.exr and blender.py
    Blender,
    /// brdf.binary, the fitted isotropic model as a MERL table, with its label brdf.txt
    Merl,
    /// run.npz, all arrays for NumPy
    Npz,
    /// brdf_astm.csv, the measured slice in the manner of ASTM E1392
    Astm,
}

/// Writes the forms that are asked for; those that the run cannot fill are an error after the others are written.
pub fn run(wanted: &Arguments, common: &Common) -> Result<()> {
    let folder = Folder::new(&wanted.run);
    let _run = wanted.run.is_dir().then(|| folder.share()).transpose()?;
    let run = folder.read()?;
    let out: &Path = &wanted
        .out
        .clone()
        .unwrap_or_else(|| wanted.run.join("export"));
    let _claim = is_other(out, &wanted.run)
        .then(|| files::claim(out))
        .transpose()?;
    let mut failed = Vec::new();
    for form in &wanted.to {
        let format = match form {
            Form::Mitsuba => Format::Mitsuba,
            Form::Blender => Format::Blender,
            Form::Merl => Format::Merl,
            Form::Npz => Format::Npz,
            Form::Astm => Format::Astm,
        };
        match export::export(&run, format, out) {
            Ok(files) => {
                for file in files {
                    say::result(common, &file.display().to_string());
                }
            }
            Err(error) => {
                let name = form.to_possible_value();
                let name = name.as_ref().map_or("", |n| n.get_name());
                failed.push(error.key(format!("--to {name}")));
            }
        }
    }
    Error::all(failed).map_or(Ok(()), Err)
}

/// Whether two paths are not the same folder.
fn is_other(a: &Path, b: &Path) -> bool {
    let whole = |path: &Path| std::fs::canonicalize(path).ok();
    whole(a).is_none_or(|a| Some(a) != whole(b))
}
