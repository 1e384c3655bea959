//! `flatlight compare`: two products, and how far they differ.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use flatlight::compare::{self, AGREE, ChannelComparison, Comparison, Options};
use flatlight::report::number::{percent, short};
use flatlight::{Error, Result, files, report};

use super::{Common, say};

/// What is compared, and how.
#[derive(Args, Clone, Debug)]
#[command(
    after_help = "Examples:\n  flatlight compare out/lighting.csv truth/lighting.csv --tolerance 0.01\n  flatlight compare monday/ tuesday/ --scale channel --report difference.html\n\n\
The second is the reference. With --tolerance two products agree if their relative error is within it; without, if nine in ten of the \
differences are within their 95 % error bars. Exit code 0: they agree, or there is nothing to judge by; 1: they differ; 2: they cannot be compared."
)]
pub struct Arguments {
    /// A product (lighting.csv, lighting_spectrum.csv, brdf.csv, brdf_spectrum.csv, light_field.exr), or a run's folder
    first: PathBuf,
    /// The reference: a product of the same kind, or a run's folder
    second: PathBuf,
    /// Factor on the first before it is compared
    #[arg(long, value_enum, default_value_t)]
    scale: Scale,
    /// Largest relative error (root mean square) at which they agree
    #[arg(long, value_name = "SHARE")]
    tolerance: Option<f64>,
    /// Writes every value of both with their difference, CSV
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Writes a page with the differences as plots, HTML
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// Factor on the first product.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Scale {
    /// None: values as they are
    #[default]
    None,
    /// The best one for all channels together
    Common,
    /// The best one for each channel
    Channel,
}

/// Compares, prints, and fails if the products differ.
pub fn compare(wanted: &Arguments, common: &Common) -> Result<()> {
    if let Some(tolerance) = wanted.tolerance
        && !(tolerance >= 0.0 && tolerance.is_finite())
    {
        return Err(
            Error::input(format!("expected a share of 0 or more, found {tolerance}"))
                .key("--tolerance"),
        );
    }
    let options = Options {
        scale: match wanted.scale {
            Scale::None => compare::Scale::None,
            Scale::Common => compare::Scale::Common,
            Scale::Channel => compare::Scale::Channel,
        },
        tolerance: wanted.tolerance,
    };
    let compared = compare::compare_paths(&wanted.first, &wanted.second, &options)?;
    let mut files = Vec::new();
    if let Some(out) = &wanted.out {
        files.push((out.clone(), table(&compared)?));
    }
    if let Some(page) = &wanted.report {
        let names = [&wanted.first, &wanted.second].map(|p| p.display().to_string());
        let names = [names[0].as_str(), names[1].as_str()];
        files.push((page.clone(), report::comparison(names, &compared)?));
    }
    files::write_together(&files)?;
    let mut differing = Vec::new();
    for (name, comparison) in &compared {
        say::result(common, &format!("{name}\n{}", text(comparison)));
        for channel in &comparison.channels {
            if channel.agrees == Some(false) {
                differing.push(format!("{name}, {}", reason(channel, wanted.tolerance)));
            }
        }
    }
    if differing.is_empty() {
        Ok(())
    } else {
        Err(Error::failed(format!(
            "the products differ\n  {}",
            differing.join("\n  ")
        )))
    }
}

fn table(compared: &[(String, Comparison)]) -> Result<String> {
    let [(_, comparison)] = compared else {
        return Err(Error::input(
            "expected two single products for the table of differences, found two folders",
        )
        .key("--out"));
    };
    Ok(comparison.csv())
}

fn text(comparison: &Comparison) -> String {
    let kind = comparison.kind;
    let mut lines = Vec::new();
    for channel in &comparison.channels {
        let place = channel
            .pairs
            .get(channel.worst)
            .map_or_else(String::new, |worst| kind.place(worst.point));
        lines.push(format!(
            "  {}: relative error {} over {} values, factor {}; largest difference {} of the maximum, at {place}",
            channel.name,
            percent(channel.relative),
            channel.pairs.len(),
            short(channel.scale, 6),
            percent(channel.worst_relative),
        ));
        if let Some((share, z)) = channel.within {
            lines.push(format!(
                "    {} of the differences are within their 95 % error bars; root mean square {} σ",
                percent(share),
                short(z, 3)
            ));
        }
        let parts: Vec<String> = channel
            .parts
            .iter()
            .map(|(label, error)| format!("{label}: {}", percent(*error)))
            .collect();
        lines.push(format!("    {}: {}", kind.parted_by(), parts.join(", ")));
    }
    lines.join("\n")
}

fn reason(channel: &ChannelComparison, tolerance: Option<f64>) -> String {
    match (tolerance, channel.within) {
        (None, Some((share, _))) => format!(
            "channel {}: {} of the differences are within their 95 % error bars, expected {} or more",
            channel.name,
            percent(share),
            percent(AGREE)
        ),
        (tolerance, _) => format!(
            "channel {}: relative error {}, expected {} or less",
            channel.name,
            percent(channel.relative),
            percent(tolerance.unwrap_or(0.0))
        ),
    }
}
