//! The output folder of a study: finished cells, and the table of them all.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Cell, Outcome};
use crate::error::{Error, Result};
use crate::files::{self, Claim};

/// Where finished cells are kept.
const CELLS: &str = "cells";
/// The columns of the tables.
const COLUMNS: &str =
    "study,brdf,lighting,noise,views,recovered,band,rmse,bias,bound,ratio,coverage,draws";

/// A finished cell as it is kept.
#[derive(Serialize, Deserialize)]
struct Kept {
    version: String,
    cell: Cell,
    outcomes: Vec<Outcome>,
}

/// The output folder of a study, which no other process may write to meanwhile.
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    _claim: Claim,
}

impl StudyFolder {
    /// Opens or makes the folder.
    ///
    /// # Errors
    /// If it cannot be made, holds anything that no study has left there, or another process works in it.
    pub fn open(path: &Path) -> Result<Self> {
        let claim = files::claim(path)?;
        if let Ok(mut entries) = fs::read_dir(path)
            && entries.next().is_some()
            && !path.join(CELLS).is_dir()
        {
            return Err(
                Error::input("the folder holds files that are not from a validation")
                    .file(path)
                    .advice("Give another folder with --out."),
            );
        }
        let cells = path.join(CELLS);
        files::make_folder(&cells)?;
        Ok(Self {
            path: path.to_path_buf(),
            _claim: claim,
        })
    }

    /// The outcomes of a cell that was finished before, with the same definition and the same version.
    ///
    /// # Errors
    /// If the cell's definition has no name, that is, never.
    pub fn read(&self, cell: &Cell) -> Result<Option<Vec<Outcome>>> {
        // TOML, because its numbers come back to the last bit.
        let Ok(text) = fs::read_to_string(self.file(cell)?) else {
            return Ok(None);
        };
        let kept: Option<Kept> = toml::from_str(&text).ok();
        Ok(kept
            .filter(|k| k.version == env!("CARGO_PKG_VERSION") && k.cell == *cell)
            .map(|k| k.outcomes))
    }

    /// Keeps a finished cell.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, cell: &Cell, outcomes: &[Outcome]) -> Result<()> {
        let kept = Kept {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            cell: cell.clone(),
            outcomes: outcomes.to_vec(),
        };
        let text = toml::to_string(&kept)
            .map_err(|e| Error::failed(format!("a cell cannot be written as TOML: {e}")))?;
        files::write_whole(&self.file(cell)?, text.as_bytes())
    }

    /// Writes the study's result, (name, text), each whole or not at all, and none if one cannot be written.
    ///
    /// # Errors
    /// If one cannot be written.
    pub fn products(&self, products: &[(&str, String)]) -> Result<()> {
        let files: Vec<(PathBuf, &str)> = products
            .iter()
            .map(|(name, text)| (self.path.join(name), text.as_str()))
            .collect();
        files::write_together(&files)
    }

    fn file(&self, cell: &Cell) -> Result<PathBuf> {
        let text = toml::to_string(cell)
            .map_err(|e| Error::failed(format!("a cell cannot be written as TOML: {e}")))?;
        let hash = blake3::hash(text.as_bytes()).to_hex();
        let name = format!(
            "{}-{}-{}-{}.toml",
            cell.recovered.word(),
            cell.brdf,
            cell.lighting,
            hash.get(..16).unwrap_or_default()
        );
        Ok(self.path.join(CELLS).join(name))
    }
}

/// Tables (file, text) with a row per cell. A number that does not exist is an empty field.
///
/// * `validation.csv`: of all cells; where both are recovered, of the light.
/// * `validation_slices.csv`: of the BRDF slice in the cells where both are recovered, if there are any.
pub fn tables(cells: &[(Cell, Outcome)]) -> Vec<(&'static str, String)> {
    let table = |rows: &[&(Cell, Outcome)]| {
        let mut out = format!("{COLUMNS}\n");
        rows.iter().for_each(|row| write_row(&mut out, row));
        out
    };
    let (main, slices): (Vec<_>, Vec<_>) = cells
        .iter()
        .partition(|(cell, o)| cell.recovered.quantities().first() == Some(&o.quantity));
    let mut tables = vec![("validation.csv", table(&main))];
    if !slices.is_empty() {
        tables.push(("validation_slices.csv", table(&slices)));
    }
    tables
}

fn write_row(out: &mut String, (cell, o): &(Cell, Outcome)) {
    let number = |v: Option<f64>| {
        v.filter(|v| v.is_finite())
            .map(|v| v.to_string())
            .unwrap_or_default()
    };
    let _ = writeln!(
        out,
        "{},{},{},{},{},{},{},{},{},{},{},{},{}",
        cell.study,
        cell.brdf,
        cell.lighting,
        cell.noise,
        cell.views,
        cell.recovered.word(),
        o.band.map(|b| b.to_string()).unwrap_or_default(),
        number(o.rmse),
        number(o.bias),
        number(o.bound),
        number(o.ratio()),
        number(o.coverage),
        o.draws
    );
}
