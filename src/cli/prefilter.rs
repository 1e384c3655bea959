//! `flatlight prefilter`.

mod told;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use flatlight::angle::WorldAngle;
use flatlight::brdf::{Family, Material, Model};
use flatlight::lighting::environment::{Environment, Section, Serves};
use flatlight::lighting::{Lighting, read_table};
use flatlight::reflect::prefilter::{
    Options, Prefiltered, Stage, Viewpoint, Ways, prefilter as compute,
};
use flatlight::{Error, Grid, Result};

use super::{Common, say};
use told::{Told, Tried};

/// Cells that `--check` compares, and the seed that picks them.
const CHECKED: (usize, u64) = (500, 1);

/// What is prefiltered, by what, and how well.
#[derive(Args, Clone, Debug)]
#[command(
    after_help = "A lat-long map has +Y up; its centre looks along +Z, a quarter to its left along +X, as seen from inside. θ = 0 is +X, \
counter-clockwise seen from above: θ = 90° looks along -Z. --heading-deg turns the axis θ = 0 counter-clockwise, --roll-deg turns the plane about \
it and lifts θ > 0.\nL is W m^-2 rad^-1 and B W m^-2 sr^-1 if the map is W m^-2 sr^-1; row i of the result is α = -180° + (i + ½)·360°/normals, \
column j is θo' = -90° + (j + ½)·180°/locals.\n\nExamples:\n  flatlight prefilter sky.exr --brdf model=phong,diffuse=0.3,specular=0.4,exponent=32 --out phong.exr --check\n  \
flatlight prefilter lighting.csv --brdf recipe.toml --tolerance 1e-4 --out table.csv\n  \
flatlight prefilter sky.exr --brdf recipe.toml --strip capture.toml --view 3 --out strip.exr"
)]
pub struct Arguments {
    /// A table of light (lighting.csv), or a lat-long map (EXR, HDR)
    environment: PathBuf,
    /// A TOML file with a [brdf] table, a brdf.csv, or key=value,… as in a recipe's [brdf]
    #[arg(long)]
    brdf: String,
    /// The table over (α, θo′), CSV or EXR; with --strip the image, EXR
    #[arg(long)]
    out: PathBuf,
    /// Largest error, as a fraction of the mean light field without the light's peaks
    #[arg(long, default_value_t = 1e-3)]
    tolerance: f64,
    /// Values over the full circle of α
    #[arg(long, default_value_t = 720, value_parser = clap::value_parser!(u16).range(8..=7200))]
    normals: u16,
    /// Values over θo′ in (−90°, 90°)
    #[arg(long, default_value_t = 180, value_parser = clap::value_parser!(u16).range(8..=7200))]
    locals: u16,
    /// Direction of θ = 0 in a map, degrees
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    heading_deg: f64,
    /// Turn of the plane about θ = 0 in a map, degrees
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    roll_deg: f64,
    /// What of a map is the planar light; default: columns for Lambertian surfaces, else the equator
    #[arg(long, value_enum)]
    section: Option<PartOfMap>,
    /// Compares random cells with brute force, and times every way
    #[arg(long)]
    check: bool,
    /// Renders the object of a capture.toml, seen by its camera, instead of writing the table
    #[arg(long, value_name = "CAPTURE")]
    strip: Option<PathBuf>,
    /// View of the capture, counted from 0
    #[arg(long, requires = "strip", conflicts_with = "orbit_deg")]
    view: Option<usize>,
    /// Direction from the object to the camera for --strip, degrees in the light's frame
    #[arg(long, requires = "strip", allow_negative_numbers = true)]
    orbit_deg: Option<f64>,
}

/// What of a map is the planar light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PartOfMap {
    /// The radiance in the plane: exact for mirrors
    Equator,
    /// The cos²-weighted columns: exact for Lambertian surfaces
    Columns,
}

/// Prefilters, writes the result, prints what was chosen and what it promises.
pub fn prefilter(wanted: &Arguments, common: &Common) -> Result<()> {
    let kind = extension(&wanted.out);
    if !(kind == "exr" || kind == "csv" && wanted.strip.is_none()) {
        let message = match &wanted.strip {
            Some(_) => "expected a name ending in .exr for the image",
            None => "expected a name ending in .csv or .exr for the table",
        };
        return Err(Error::input(message).file(&wanted.out).key("--out"));
    }
    let from = viewpoint(wanted)?;
    let (model, folder) = describe(&wanted.brdf)?;
    let mut warnings = model.warnings();
    let mut told = Told::default();
    let lighting = light(wanted, &model, &mut warnings, &mut told)?;
    let material = model.material(&lighting.channels, &folder)?;
    warnings.extend(model.warnings_of_table(&material));
    if common.strict && !warnings.is_empty() {
        return Err(Error::failed(format!(
            "--strict: {} warning(s), nothing was written\n  {}",
            warnings.len(),
            warnings.join("\n  ")
        )));
    }
    let grid = Grid {
        normals: usize::from(wanted.normals),
        locals: usize::from(wanted.locals),
    };
    let options = Options {
        tolerance: wanted.tolerance,
        ..Options::default()
    };
    let start = Instant::now();
    let made = compute(&lighting, &material, grid, &options)?;
    told.seconds = start.elapsed().as_secs_f64();
    match (&from, kind.as_str()) {
        (Some(from), _) => {
            let start = Instant::now();
            let image = made.view(from);
            told.view = Some((from.size, 1e3 * start.elapsed().as_secs_f64()));
            made.write_view(&wanted.out, from.size, &image)?;
        }
        (None, "csv") => made.write_csv(&wanted.out)?,
        (None, _) => made.write(&wanted.out)?,
    }
    for warning in &warnings {
        say::warning(common, warning);
    }
    if wanted.check {
        check(&made, &lighting, &material, &options, &mut told)?;
    }
    match common.log {
        say::Log::Text => say::print(&told.words(&made, wanted.tolerance, &wanted.out)),
        say::Log::Json => say::print(&format!(
            "{}\n",
            told.json(&made, wanted.tolerance, &wanted.out)
        )),
    }
    let worst = told.tried.first().map_or(0.0, |t| t.error.unwrap_or(0.0));
    if worst > options.tolerance {
        return Err(Error::failed(format!(
            "--check: the error is {worst:.1e} of the level, above the tolerance {:e}",
            options.tolerance
        )));
    }
    Ok(())
}

/// Where the camera of `--strip` stands.
fn viewpoint(wanted: &Arguments) -> Result<Option<Viewpoint>> {
    let Some(file) = &wanted.strip else {
        return Ok(None);
    };
    let stage = Stage::read(file)?;
    let from = match (wanted.view, wanted.orbit_deg) {
        (Some(view), _) => stage.view(view)?,
        (None, Some(orbit)) if orbit.is_finite() => stage.at(WorldAngle::degrees(orbit), 0.0)?,
        (None, orbit) => {
            let found = orbit.map_or("neither".to_owned(), |o| o.to_string());
            return Err(Error::input(format!(
                "expected --view N or --orbit-deg ANGLE for the camera's place, found {found}"
            ))
            .key("--strip"));
        }
    };
    Ok(Some(from))
}

fn extension(file: &Path) -> String {
    let extension = file.extension().unwrap_or_default();
    extension.to_string_lossy().to_lowercase()
}

/// The material of `--brdf`, and the folder that its paths start from.
fn describe(text: &str) -> Result<(Model, PathBuf)> {
    let file = Path::new(text);
    let folder = || file.parent().unwrap_or(Path::new("")).to_path_buf();
    match extension(file).as_str() {
        "csv" if !text.contains('=') => {
            let mut table = toml::Table::new();
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            table.insert("table".into(), name.as_ref().into());
            Ok((Model::from_table(&table)?, folder()))
        }
        "toml" if !text.contains('=') => {
            let content = std::fs::read_to_string(file).map_err(|e| Error::read(file, e))?;
            let root: toml::Table = content
                .parse()
                .map_err(|e: toml::de::Error| Error::input(e.message()).file(file))?;
            let Some(table) = root.get("brdf").and_then(toml::Value::as_table) else {
                return Err(Error::input("expected a [brdf] table, found none")
                    .file(file)
                    .advice(
                        "Write [brdf] with model = \"…\" and its parameters, as in a recipe.",
                    ));
            };
            let model = Model::from_table(table).map_err(|e| e.file(file))?;
            Ok((model, folder()))
        }
        _ => Ok((Model::from_table(&inline(text)?)?, PathBuf::new())),
    }
}

/// `key=value,key=[v,v,v],…` as a table; a value is TOML, or else a word.
fn inline(text: &str) -> Result<toml::Table> {
    let mut parts = vec![String::new()];
    let mut depth = 0usize;
    for c in text.chars() {
        match c {
            '[' => depth += 1,
            ']' => depth = depth.saturating_sub(1),
            _ => {}
        }
        match parts.last_mut() {
            Some(last) if c != ',' || depth > 0 => last.push(c),
            _ => parts.push(String::new()),
        }
    }
    let mut table = toml::Table::new();
    for part in parts {
        let Some((key, value)) = part.split_once('=') else {
            return Err(Error::input(format!(
                "expected a .toml or .csv file, or key=value,…, found {part:?}"
            ))
            .key("--brdf")
            .advice("For example: --brdf model=phong,diffuse=0.3,specular=0.4,exponent=32"));
        };
        let (key, value) = (key.trim(), value.trim());
        let parsed = format!("value = {value}").parse::<toml::Table>().ok();
        let value = parsed
            .and_then(|mut t| t.remove("value"))
            .unwrap_or_else(|| value.into());
        if table.insert(key.to_owned(), value).is_some() {
            return Err(Error::input(format!("{key} stands twice")).key("--brdf"));
        }
    }
    Ok(table)
}

/// The planar light of the environment.
fn light(
    wanted: &Arguments,
    model: &Model,
    warnings: &mut Vec<String>,
    told: &mut Told,
) -> Result<Lighting> {
    let file = &wanted.environment;
    if extension(file) == "csv" {
        for (key, given) in [
            ("--heading-deg", wanted.heading_deg != 0.0),
            ("--roll-deg", wanted.roll_deg != 0.0),
            ("--section", wanted.section.is_some()),
        ] {
            if given {
                return Err(Error::input(
                    "it places the plane in a lat-long map, and a table is planar already",
                )
                .key(key));
            }
        }
        return Ok(read_table(file)?.lighting);
    }
    for (key, angle) in [
        ("--heading-deg", wanted.heading_deg),
        ("--roll-deg", wanted.roll_deg),
    ] {
        if !angle.is_finite() {
            return Err(Error::input(format!("expected an angle, found {angle}")).key(key));
        }
    }
    let family = match model {
        Model::Analytic { family, .. } => Some(*family),
        Model::Table(_) => None,
    };
    let lambertian = family == Some(Family::Lambertian);
    let section = wanted.section.unwrap_or(match lambertian {
        true => PartOfMap::Columns,
        false => PartOfMap::Equator,
    });
    let exact = match section {
        PartOfMap::Equator => family == Some(Family::Mirror),
        PartOfMap::Columns => lambertian,
    };
    if !exact {
        let what = match section {
            PartOfMap::Equator => "the equator stands for the whole map exactly for mirrors only",
            PartOfMap::Columns => {
                "cos²-weighted columns stand for the whole map exactly for Lambertian surfaces only"
            }
        };
        warnings.push(format!(
            "{what}; this surface also sees light from out of the plane"
        ));
    }
    let map = Environment::read(file)?;
    let serves = match section {
        PartOfMap::Equator => Serves::Mirror,
        PartOfMap::Columns => Serves::Lambertian,
    };
    told.light = Some(format!(
        "{}: {} × {} pixels, channels {}; the planar light is its {}",
        file.display(),
        map.width,
        map.height,
        map.channels.join(" "),
        match section {
            PartOfMap::Equator => "equator (radiance in the plane)",
            PartOfMap::Columns => "columns, weighted by cos² of the elevation",
        }
    ));
    Ok(map.planar(Section {
        heading: wanted.heading_deg.to_radians(),
        roll: wanted.roll_deg.to_radians(),
        serves,
    }))
}

/// Every way once, timed, and compared with brute force.
fn check(
    made: &Prefiltered,
    lighting: &Lighting,
    material: &Material,
    options: &Options,
    told: &mut Told,
) -> Result<()> {
    for ways in Ways::ALL {
        let again;
        let (tried, seconds) = if ways == Ways::Cheapest {
            (made, told.seconds)
        } else {
            let start = Instant::now();
            let options = Options { ways, ..*options };
            match compute(lighting, material, made.grid, &options) {
                Ok(tried) => again = tried,
                Err(_) => {
                    told.tried.push(Tried::refused(ways));
                    continue;
                }
            }
            (&again, start.elapsed().as_secs_f64())
        };
        let found = tried.check(CHECKED.0, CHECKED.1);
        told.tried.push(Tried {
            ways,
            seconds: Some(seconds),
            error: Some(found.iter().fold(0.0f64, |m, c| m.max(c.largest))),
            rms: Some(found.iter().fold(0.0f64, |m, c| m.max(c.rms))),
        });
        if ways == Ways::Cheapest {
            let all = found.iter().map(|c| c.integral_time.as_secs_f64());
            told.integral = Some((CHECKED.0, all.sum()));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_brdf_can_be_said_in_one_word() -> Result<()> {
        let table = inline("model=phong,diffuse=[0.3, 0.2, 0.1],specular=0.4,exponent=32")?;
        assert_eq!(table["model"].as_str(), Some("phong"));
        assert_eq!(table["diffuse"].as_array().map(Vec::len), Some(3));
        assert_eq!(table["exponent"].as_integer(), Some(32));
        let (model, _) = describe("model=lambertian,albedo=0.5")?;
        assert!(matches!(
            model,
            Model::Analytic {
                family: Family::Lambertian,
                ..
            }
        ));
        for wrong in [
            "phong",
            "model=phong,,",
            "model=phong,model=ward",
            "model=phnog",
        ] {
            assert!(describe(wrong).is_err(), "{wrong}");
        }
        Ok(())
    }
}
