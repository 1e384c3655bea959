//! Two products of the same kind compared: the factor between them, how far they differ, and where.
//!
//! The second is the reference: differences are a·x − y with x from the first, y from the second, and a the factor
//! that was asked for.

mod product;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

pub use product::{Kind, Point, Product};

/// Two-sided 95 % point of the normal distribution.
const NORMAL_95: f64 = 1.959_963_984_540_054;
/// Share of the differences within 95 % error bars from which on two products agree: over a hundred values that
/// belong to one another less than 0.9 comes by chance once in forty times.
pub const AGREE: f64 = 0.9;

/// Which factor the first product is multiplied by before it is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// None: the values as they are.
    #[default]
    None,
    /// The best one for all channels together.
    Common,
    /// The best one for each channel.
    Channel,
}

/// What is asked of a comparison.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// The factor.
    pub scale: Scale,
    /// Largest relative error at which the products agree; `None`: the error bars decide, where there are any.
    pub tolerance: Option<f64>,
}

/// One value of both products.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// Where it stands, in the units of the product's axes.
    pub point: Point,
    /// Value of the first, times the factor.
    pub first: f64,
    /// Value of the second.
    pub second: f64,
    /// Their standard deviations, that of the first times the factor; `None` where it states none.
    pub sigmas: [Option<f64>; 2],
}

impl Pair {
    /// Standard deviation of the difference; `None` where neither states one.
    pub fn sigma(&self) -> Option<f64> {
        match self.sigmas {
            [None, None] => None,
            [x, y] => Some(x.unwrap_or(0.0).hypot(y.unwrap_or(0.0))),
        }
    }
}

/// One channel of two products.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelComparison {
    /// Channel name.
    pub name: String,
    /// The factor on the first.
    pub scale: f64,
    /// All values that both have.
    pub pairs: Vec<Pair>,
    /// Root mean square of the differences, relative to that of the second.
    pub relative: f64,
    /// Index of the pair of the largest difference.
    pub worst: usize,
    /// That difference relative to the largest |value| of the second.
    pub worst_relative: f64,
    /// Share of the differences within their 95 % error bars, and the root mean square of difference/σ.
    pub within: Option<(f64, f64)>,
    /// Whether they agree: by the tolerance that was asked for, else by the error bars; `None` without either.
    pub agrees: Option<bool>,
    /// (part of the product, root mean square of the differences there relative to that of all of the second).
    pub parts: Vec<(String, f64)>,
}

/// Two products compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// What they are.
    pub kind: Kind,
    /// The channels that both have.
    pub channels: Vec<ChannelComparison>,
}

/// Compares two products.
///
/// # Errors
/// If they are of different kinds, or have no channel or no point in common.
pub fn compare(first: &Product, second: &Product, options: &Options) -> Result<Comparison> {
    if first.kind != second.kind {
        return Err(Error::input(format!(
            "expected two products of the same kind, found {} and {}",
            first.kind.words(),
            second.kind.words()
        )));
    }
    let mut channels = Vec::new();
    for (c, name) in second.channels.iter().enumerate() {
        let Some(own) = first.channels.iter().position(|n| n == name) else {
            continue;
        };
        channels.push((name.clone(), pairs(first, own, second, c)));
    }
    if channels.is_empty() {
        return Err(Error::input(format!(
            "expected a common channel, found {} in the first and {} in the second",
            first.channels.join(", "),
            second.channels.join(", ")
        )));
    }
    if let Some((name, _)) = channels.iter().find(|(_, pairs)| pairs.is_empty()) {
        return Err(Error::input(format!(
            "channel {name} has no value at which both products are known"
        ))
        .advice(
            "Light fields and spectra are compared cell by cell: write both with the same grid.",
        ));
    }
    let common = factor(channels.iter().flat_map(|(_, pairs)| pairs));
    let channels: Vec<ChannelComparison> = channels
        .into_iter()
        .map(|(name, pairs)| {
            let scale = match options.scale {
                Scale::None => 1.0,
                Scale::Common => common,
                Scale::Channel => factor(pairs.iter()),
            };
            channel(name, pairs, scale, first.kind, options.tolerance)
        })
        .collect();
    Ok(Comparison {
        kind: first.kind,
        channels,
    })
}

/// The products of two files, or of two run folders those that both hold: (name, comparison).
///
/// # Errors
/// As [`compare`]; if a file is no product; if one path is a folder and the other is not, or two folders have
/// no product in common.
pub fn compare_paths(
    first: &Path,
    second: &Path,
    options: &Options,
) -> Result<Vec<(String, Comparison)>> {
    let files: Vec<(String, PathBuf, PathBuf)> = match (first.is_dir(), second.is_dir()) {
        (false, false) => {
            let name = first.file_name().unwrap_or(first.as_os_str());
            let name = name.to_string_lossy().into_owned();
            vec![(name, first.into(), second.into())]
        }
        (true, true) => Kind::FILES
            .iter()
            .map(|name| ((*name).to_owned(), first.join(name), second.join(name)))
            .filter(|(_, a, b)| a.is_file() && b.is_file())
            .collect(),
        _ => {
            return Err(Error::input(format!(
                "expected two files or two folders, found {} and {}",
                first.display(),
                second.display()
            )));
        }
    };
    if files.is_empty() {
        return Err(Error::input(format!(
            "expected one of {} in both folders, found none",
            Kind::FILES.join(", ")
        ))
        .file(first));
    }
    files
        .into_iter()
        .map(|(name, a, b)| {
            let compared = compare(&Product::read(&a)?, &Product::read(&b)?, options)
                .map_err(|e| e.file(&a))?;
            Ok((name, compared))
        })
        .collect()
}

/// What both know: at the points of the coarser one where values lie between grid points.
fn pairs(first: &Product, own: usize, second: &Product, other: usize) -> Vec<Pair> {
    let at_first = first.points.len() <= second.points.len();
    let points = if at_first {
        &first.points
    } else {
        &second.points
    };
    points
        .iter()
        .filter_map(|&point| {
            let (x, sigma_x) = first.at(own, point)?;
            let (y, sigma_y) = second.at(other, point)?;
            Some(Pair {
                point,
                first: x,
                second: y,
                sigmas: [sigma_x, sigma_y],
            })
        })
        .collect()
}

/// The factor on the first that leaves the least squares; 1 if the first is zero.
fn factor<'a>(pairs: impl Iterator<Item = &'a Pair>) -> f64 {
    let (mut cross, mut square) = (0.0, 0.0);
    for pair in pairs {
        cross += pair.first * pair.second;
        square += pair.first * pair.first;
    }
    if square > 0.0 { cross / square } else { 1.0 }
}

fn channel(
    name: String,
    mut pairs: Vec<Pair>,
    scale: f64,
    kind: Kind,
    tolerance: Option<f64>,
) -> ChannelComparison {
    for pair in &mut pairs {
        pair.first *= scale;
        pair.sigmas[0] = pair.sigmas[0].map(|s| s * scale.abs());
    }
    let norm = rms(pairs.iter().map(|p| p.second));
    let largest = pairs.iter().map(|p| p.second.abs()).fold(0.0, f64::max);
    let relative_to = |value: f64, whole: f64| match (value, whole) {
        (0.0, _) => 0.0,
        (value, whole) => value / whole,
    };
    let difference = |p: &Pair| p.first - p.second;
    let worst = (0..pairs.len())
        .max_by(|&i, &j| {
            difference(&pairs[i])
                .abs()
                .total_cmp(&difference(&pairs[j]).abs())
        })
        .unwrap_or(0);
    let scores: Vec<f64> = pairs
        .iter()
        .filter_map(|p| {
            p.sigma()
                .filter(|s| *s > 0.0)
                .map(|sigma| difference(p) / sigma)
        })
        .collect();
    let within = (!scores.is_empty()).then(|| {
        let inside = scores.iter().filter(|z| z.abs() <= NORMAL_95).count();
        (
            inside as f64 / scores.len() as f64,
            rms(scores.iter().copied()),
        )
    });
    let mut parts: Vec<(String, Vec<f64>)> = Vec::new();
    for pair in &pairs {
        let label = kind.part(pair.point);
        match parts.iter_mut().find(|(known, _)| *known == label) {
            Some((_, list)) => list.push(difference(pair)),
            None => parts.push((label, vec![difference(pair)])),
        }
    }
    let relative = relative_to(rms(pairs.iter().map(difference)), norm);
    ChannelComparison {
        agrees: agrees(relative, within, tolerance),
        relative,
        worst_relative: relative_to(difference(&pairs[worst]).abs(), largest),
        worst,
        within,
        parts: parts
            .into_iter()
            .map(|(label, list)| (label, relative_to(rms(list.into_iter()), norm)))
            .collect(),
        name,
        scale,
        pairs,
    }
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for value in values {
        sum += value * value;
        count += 1;
    }
    (sum / count.max(1) as f64).sqrt()
}

/// By the tolerance if there is one, else by the error bars if there are any.
fn agrees(relative: f64, within: Option<(f64, f64)>, tolerance: Option<f64>) -> Option<bool> {
    match (tolerance, within) {
        (Some(tolerance), _) => Some(relative <= tolerance),
        (None, Some((share, _))) => Some(share >= AGREE),
        (None, None) => None,
    }
}

impl Comparison {
    /// Every value of both: the product's axes, `channel,first,second,difference,sigma`.
    pub fn csv(&self) -> String {
        let mut text = format!(
            "{},channel,first,second,difference,sigma\n",
            self.kind.axes().join(",")
        );
        for channel in &self.channels {
            for pair in &channel.pairs {
                for coordinate in pair.point.iter().take(self.kind.axes().len()) {
                    let _ = write!(text, "{coordinate},");
                }
                let _ = write!(
                    text,
                    "{},{},{},{},",
                    channel.name,
                    pair.first,
                    pair.second,
                    pair.first - pair.second
                );
                if let Some(sigma) = pair.sigma() {
                    let _ = write!(text, "{sigma}");
                }
                text.push('\n');
            }
        }
        text
    }
}

#[cfg(test)]
mod tests;
