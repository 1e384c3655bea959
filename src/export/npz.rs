//! All arrays of a run as one `.npz` for NumPy.

use std::f64::consts::TAU;
use std::io::{Cursor, Write};

use npyz::{AutoSerialize, WriterBuilder as _};
use num_complex::Complex64;
use zip::write::SimpleFileOptions;

use super::slice;
use crate::error::{Error, Result};
use crate::light_field::LightField;
use crate::pipeline::Run;
use crate::recover::Status;

/// The bytes of the file. Arrays, in `np.load` by name; C is the number of channels, whose names are in `channels` (UTF-8 bytes):
///
/// * `alpha_deg` \[normals\], `theta_o_deg` \[locals\]; `light_field_mean`, `light_field_sigma`, `light_field_weight`, and `residual` \[C, normals, locals\], float32
/// * `lighting_theta_deg` \[720\], `lighting`, `lighting_sigma` \[C, 720\]; `lighting_spectrum` \[C, P\] complex, `lighting_spectrum_sigma`, `lighting_spectrum_status` (2 determined, 1 weak, 0 indeterminate)
/// * `source_deg`, `source_sigma_deg` \[S\], `source_irradiance`, `source_irradiance_sigma` \[S, C\]
/// * `brdf_theta_deg` \[n\], `brdf_rho`, `brdf_sigma` \[C, θi′, θo′\], NaN where indeterminate, `brdf_status`
///
/// Arrays of what the run did not recover are absent.
///
/// # Errors
/// If an array cannot be written.
pub fn encode(run: &Run) -> Result<Vec<u8>> {
    let mut file = Arrays {
        zip: zip::ZipWriter::new(Cursor::new(Vec::new())),
    };
    let longest = run.channels.iter().map(String::len).max().unwrap_or(0);
    let names = run.channels.iter().flat_map(|name| {
        let padding = longest - name.len();
        name.bytes().chain(std::iter::repeat_n(0, padding))
    });
    file.add("channels", &[run.channels.len(), longest], names)?;
    let grid = run.light_field.grid;
    let axis = |n: usize, at: &dyn Fn(usize) -> f64| (0..n).map(at).collect::<Vec<_>>();
    let normals = axis(grid.normals, &|i| grid.normal(i).deg());
    let locals = axis(grid.locals, &|j| grid.local(j).deg());
    file.add("alpha_deg", &[grid.normals], normals)?;
    file.add("theta_o_deg", &[grid.locals], locals)?;
    type Layer = fn(&LightField) -> &Vec<Vec<f32>>;
    let layers: [(&str, Layer); 3] = [
        ("light_field_mean", |f| &f.mean),
        ("light_field_sigma", |f| &f.sigma),
        ("light_field_weight", |f| &f.weight),
    ];
    let shape = [run.channels.len(), grid.normals, grid.locals];
    for (name, layer) in layers {
        let values = layer(&run.light_field).iter().flatten().copied();
        file.add(name, &shape, values)?;
    }
    if let Some(residual) = &run.residual {
        file.add("residual", &shape, residual.mean.iter().flatten().copied())?;
    }
    add_lighting(&mut file, run)?;
    if let Some(brdf) = &run.brdf {
        let table = slice(run)?;
        let n = brdf.size;
        let shape = [brdf.channels.len(), n, n];
        file.add(
            "brdf_theta_deg",
            &[n],
            (0..n).map(|k| brdf.angle(k).to_degrees()),
        )?;
        file.add("brdf_rho", &shape, table.rho.into_iter().flatten())?;
        file.add("brdf_sigma", &shape, table.sigma.into_iter().flatten())?;
        let status = brdf.slices.iter().flat_map(|s| &s.status).map(code);
        file.add("brdf_status", &shape, status)?;
    }
    let bytes = file.zip.finish().map_err(failed)?;
    Ok(bytes.into_inner())
}

fn add_lighting(file: &mut Arrays, run: &Run) -> Result<()> {
    let Some(lighting) = &run.lighting else {
        return Ok(());
    };
    let channels = &lighting.channels;
    let n = channels.first().map_or(0, |c| c.table.len());
    let step = TAU.to_degrees() / n.max(1) as f64;
    file.add(
        "lighting_theta_deg",
        &[n],
        (0..n).map(|i| -180.0 + step * i as f64),
    )?;
    let shape = [channels.len(), n];
    file.add(
        "lighting",
        &shape,
        channels.iter().flat_map(|c| c.table.iter().copied()),
    )?;
    let sigma = channels.iter().flat_map(|c| c.table_sigma.iter().copied());
    file.add("lighting_sigma", &shape, sigma)?;
    // Channels may have bands of their own; the shorter ones end in coefficients that are indeterminate.
    let band = channels.iter().map(|c| c.spectrum.len()).max().unwrap_or(0);
    let padded = || {
        channels
            .iter()
            .flat_map(move |c| (0..band).map(move |p| c.spectrum.get(p)))
    };
    let shape = [channels.len(), band];
    let value = padded().map(|l| l.map_or(Complex64::ZERO, |l| l.value));
    file.add("lighting_spectrum", &shape, value)?;
    let sigma = padded().map(|l| l.map_or(f64::NAN, |l| l.sigma));
    file.add("lighting_spectrum_sigma", &shape, sigma)?;
    let status = padded().map(|l| l.map_or(0, |l| code(&l.status)));
    file.add("lighting_spectrum_status", &shape, status)?;
    let sources = &lighting.sources;
    let count = [sources.len()];
    file.add("source_deg", &count, sources.iter().map(|s| s.theta_deg))?;
    file.add(
        "source_sigma_deg",
        &count,
        sources.iter().map(|s| s.theta_sigma_deg),
    )?;
    let shape = [sources.len(), channels.len()];
    let value = sources.iter().flat_map(|s| s.irradiance.iter().copied());
    file.add("source_irradiance", &shape, value)?;
    let sigma = sources
        .iter()
        .flat_map(|s| s.irradiance_sigma.iter().copied());
    file.add("source_irradiance_sigma", &shape, sigma)
}

fn code(status: &Status) -> u8 {
    match status {
        Status::Determined => 2,
        Status::Weak => 1,
        Status::Indeterminate => 0,
    }
}

/// A `.npz` under construction.
struct Arrays {
    zip: zip::ZipWriter<Cursor<Vec<u8>>>,
}

impl Arrays {
    /// Adds an array, the last axis running fastest.
    fn add<T: AutoSerialize>(
        &mut self,
        name: &str,
        shape: &[usize],
        values: impl IntoIterator<Item = T>,
    ) -> Result<()> {
        let options =
            SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
        self.zip
            .start_file(format!("{name}.npy"), options)
            .map_err(failed)?;
        let shape: Vec<u64> = shape.iter().map(|n| *n as u64).collect();
        let mut array = npyz::WriteOptions::new()
            .default_dtype()
            .shape(&shape)
            .writer(&mut self.zip as &mut dyn Write)
            .begin_nd()
            .map_err(failed)?;
        array.extend(values).map_err(failed)?;
        array.finish().map_err(failed)
    }
}

fn failed(cause: impl std::fmt::Display) -> Error {
    Error::failed(format!("the arrays cannot be written as .npz: {cause}"))
}
