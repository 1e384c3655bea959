//! The page of a comparison: whether two products agree, by how much they differ, and where.

use super::figure::{Figure, Panel, lighting_curve::SIGMAS_95};
use super::number::{percent, short};
use super::plot::{
    Axis, ColourMap, HeatMap, Legend, Mark, Plot, Scale, Size, bounds, quantile, series_class,
};
use super::results::ResultTable;
use super::sheet::Sheet;
use super::table::{Cell, Table};
use crate::compare::{ChannelComparison, Comparison, Kind};
use crate::error::Result;

/// Sizes of a figure across the page.
const FULL: [Size; 2] = [Size::Wide, Size::Narrow];
/// Most channels that get a panel.
const PANELS: usize = 8;
/// Most cells of a difference image along each axis.
const CELLS: [usize; 2] = [360, 180];
/// Most rows of a table in the page's CSV; `--out` writes all values.
const ROWS: usize = 20_000;

/// The report of a comparison as one HTML page without any reference to the network. `names` are those of the two, `compared` the products by name.
///
/// # Errors
/// If an image cannot be encoded or the page cannot be put together.
pub fn comparison(names: [&str; 2], compared: &[(String, Comparison)]) -> Result<String> {
    let title = format!("{} against {}", names[0], names[1]);
    let mut figures = Vec::new();
    for (name, comparison) in compared {
        figures.extend(values(name, comparison)?);
        figures.push(by_part(name, comparison));
    }
    let differing = compared
        .iter()
        .flat_map(|(_, c)| &c.channels)
        .filter(|c| c.agrees == Some(false))
        .count();
    Sheet {
        title: &title,
        kind: "Two results compared",
        warnings: Vec::new(),
        findings: findings(compared, differing),
        tables: compared.iter().map(|(n, c)| table(n, c)).collect(),
        figures,
        methods: METHODS.to_owned(),
        ..Sheet::default()
    }
    .page()
}

const METHODS: &str = "<p>The second is the reference. Differences are <i>a</i> · first − second, with the factor <i>a</i> that was asked for: none (1), the best one for all channels, or the \
best one for each. The relative error is the root mean square of the differences over that of the second. Differences are judged by the standard deviation of both together; where only one states errors, by its own. \
A BRDF is compared as ρ cos θ<sub>i</sub>′ cos θ<sub>o</sub>′, which stays finite towards the horizon. Values that lie between the grid points of one are interpolated in it.</p>";

fn findings(compared: &[(String, Comparison)], differing: usize) -> Vec<String> {
    let judged = compared
        .iter()
        .flat_map(|(_, c)| &c.channels)
        .any(|c| c.agrees.is_some());
    let mut findings = vec![match (judged, differing) {
        (false, _) => {
            "There is nothing to judge by: neither states error bars, and no tolerance was given."
                .to_owned()
        }
        (true, 0) => "The two agree.".to_owned(),
        (true, n) => format!("The two differ, in {n} channel(s) of the products below."),
    }];
    for (name, comparison) in compared {
        let worst = comparison
            .channels
            .iter()
            .max_by(|a, b| a.relative.total_cmp(&b.relative));
        if let Some(worst) = worst {
            let place = worst
                .pairs
                .get(worst.worst)
                .map_or_else(String::new, |p| comparison.kind.place(p.point));
            findings.push(format!(
                "{name}: relative error up to {} (channel {}); the largest single difference is {} of the maximum, at {place}.",
                percent(worst.relative),
                worst.name,
                percent(worst.worst_relative)
            ));
        }
    }
    findings
}

fn table(name: &str, comparison: &Comparison) -> ResultTable {
    let rows = comparison
        .channels
        .iter()
        .map(|c| {
            let dash = || "—".to_owned();
            vec![
                c.name.clone(),
                c.pairs.len().to_string(),
                short(c.scale, 6),
                percent(c.relative),
                percent(c.worst_relative),
                c.within.map_or_else(dash, |(share, _)| percent(share)),
                c.within.map_or_else(dash, |(_, z)| short(z, 3)),
                match c.agrees {
                    Some(true) => "agree".to_owned(),
                    Some(false) => "differ".to_owned(),
                    None => dash(),
                },
            ]
        })
        .collect();
    ResultTable {
        title: name.to_owned(),
        columns: [
            "channel",
            "values",
            "factor on the first",
            "relative error",
            "largest difference / maximum",
            "within 95 % error bars",
            "rms of difference / σ",
            "verdict",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows,
    }
}

/// Ids of a product's two figures.
fn ids(kind: Kind) -> [&'static str; 2] {
    match kind {
        Kind::Lighting => ["lighting", "lighting-parts"],
        Kind::LightingSpectrum => ["lighting-spectrum", "lighting-spectrum-parts"],
        Kind::Brdf => ["brdf", "brdf-parts"],
        Kind::BrdfSpectrum => ["brdf-spectrum", "brdf-spectrum-parts"],
        Kind::LightField => ["light-field", "light-field-parts"],
    }
}

/// The differences where they are: a curve over one angle, an image over two; spectra are shown by frequency only.
fn values(name: &str, comparison: &Comparison) -> Result<Option<Figure>> {
    let kind = comparison.kind;
    let mut panels = Vec::new();
    for (index, channel) in comparison.channels.iter().take(PANELS).enumerate() {
        let markup = match kind {
            Kind::Lighting => curve(channel, index),
            Kind::Brdf => image(
                kind,
                channel,
                index,
                ["θ_[i]′ / degrees", "θ_[o]′ / degrees"],
            )?,
            Kind::LightField => image(kind, channel, index, ["α / degrees", "θ_[o]′ / degrees"])?,
            Kind::LightingSpectrum | Kind::BrdfSpectrum => return Ok(None),
        };
        panels.push(Panel {
            name: channel.name.clone(),
            markup,
        });
    }
    let caption = match kind {
        Kind::Lighting => {
            "Difference of the two, first − second, with the 95 % band of their error bars about zero. Inside the band the two agree. Sources stand out as peaks; the axis leaves the largest 1 % out."
        }
        _ => {
            "First − second. Blue: the first is smaller; brown: it is larger. Colours saturate at the 99.5 % quantile. Hatched: not known by both."
        }
    };
    Ok(Some(Figure {
        id: ids(kind)[0],
        title: "Difference",
        caption: format!("{name}. {caption}"),
        panels,
        table: pairs(comparison),
        wide: true,
    }))
}

fn pairs(comparison: &Comparison) -> Table {
    let axes = comparison.kind.axes();
    let mut columns: Vec<String> = axes.iter().map(|a| (*a).to_owned()).collect();
    columns.extend(["channel", "first", "second", "difference", "sigma"].map(str::to_owned));
    let all: usize = comparison.channels.iter().map(|c| c.pairs.len()).sum();
    let step = all.div_ceil(ROWS).max(1);
    let rows = comparison
        .channels
        .iter()
        .flat_map(|c| c.pairs.iter().step_by(step).map(move |p| (c, p)))
        .map(|(c, p)| {
            let mut row: Vec<Cell> = p
                .point
                .iter()
                .take(axes.len())
                .map(|v| Cell::Number(*v))
                .collect();
            row.push(Cell::Text(c.name.clone()));
            row.extend([p.first, p.second, p.first - p.second].map(Cell::Number));
            row.push(Cell::Number(p.sigma().unwrap_or(f64::NAN)));
            row
        })
        .collect();
    Table {
        columns,
        rows,
        note: if step > 1 {
            format!("Every {step}th of {all} values; flatlight compare --out writes all.")
        } else {
            String::new()
        },
    }
}

fn curve(channel: &ChannelComparison, index: usize) -> String {
    let point = |p: &crate::compare::Pair| (p.point[0], p.first - p.second);
    let largest = quantile(
        channel.pairs.iter().flat_map(|p| {
            [
                (p.first - p.second).abs(),
                SIGMAS_95 * p.sigma().unwrap_or(0.0),
            ]
        }),
        0.99,
    );
    let largest = if largest > 0.0 { 1.1 * largest } else { 1.0 };
    let class = series_class(&channel.name, index);
    let mut out = String::new();
    for size in FULL {
        let step = if size.is_wide() { 30.0 } else { 90.0 };
        let mut plot = Plot::new(
            size,
            220.0,
            Axis::degrees("direction θ / degrees", -180.0, 180.0, step),
            Axis::new("first − second", Scale::linear(-largest, largest), 6),
        )
        .with_legend(vec![
            Legend {
                class: class.to_owned(),
                mark: Mark::Line,
                label: "difference".to_owned(),
            },
            Legend {
                class: "s-n".to_owned(),
                mark: Mark::Band,
                label: "95 % band".to_owned(),
            },
        ]);
        let band: Vec<_> = channel
            .pairs
            .iter()
            .filter_map(|p| Some((p.point[0], SIGMAS_95 * p.sigma()?)))
            .map(|(x, half)| (x, -half, half))
            .collect();
        plot.band(&band, "s-n");
        let line: Vec<_> = channel.pairs.iter().map(point).collect();
        plot.line(&line, class);
        out += &plot.finish(
            &format!(
                "Difference of channel {} over the direction; relative error {}.",
                channel.name,
                percent(channel.relative)
            ),
            "data-curve=\"theta_deg\"",
        );
    }
    out
}

fn image(kind: Kind, channel: &ChannelComparison, index: usize, axes: [&str; 2]) -> Result<String> {
    let range = |k: usize| bounds(channel.pairs.iter().map(|p| p.point[k]));
    let count = |k: usize| {
        let mut all: Vec<f64> = channel.pairs.iter().map(|p| p.point[k]).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all.len().clamp(1, CELLS[k])
    };
    let ((x0, x1), (y0, y1)) = (range(0), range(1));
    let [columns, rows] = [count(0), count(1)];
    let place = |v: f64, low: f64, high: f64, n: usize| {
        let share = if high > low {
            (v - low) / (high - low)
        } else {
            0.0
        };
        ((share * n as f64) as usize).min(n - 1)
    };
    let mut sums = vec![(0.0, 0usize); columns * rows];
    for pair in &channel.pairs {
        let column = place(pair.point[0], x0, x1, columns);
        let row = rows - 1 - place(pair.point[1], y0, y1, rows);
        if let Some((sum, n)) = sums.get_mut(row * columns + column) {
            *sum += pair.first - pair.second;
            *n += 1;
        }
    }
    let values: Vec<f64> = sums
        .into_iter()
        .map(|(sum, n)| if n > 0 { sum / n as f64 } else { f64::NAN })
        .collect();
    let largest = quantile(values.iter().map(|v| v.abs()), 0.995);
    let largest = if largest > 0.0 { largest } else { 1.0 };
    // Points are the centres of cells.
    let half = |low: f64, high: f64, n: usize| 0.5 * (high - low) / (n.max(2) - 1) as f64;
    let (hx, hy) = (half(x0, x1, columns), half(y0, y1, rows));
    let step = if kind == Kind::LightField { 45.0 } else { 30.0 };
    let map = HeatMap {
        id: format!("image-{}-{index}", ids(kind)[0]),
        x: Axis::degrees(axes[0], x0 - hx, x1 + hx, step),
        y: Axis::degrees(axes[1], y0 - hy, y1 + hy, 30.0),
        cells: [columns, rows],
        values,
        colours: Scale::linear(-largest, largest),
        map: ColourMap::Vik,
        label: "first − second".to_owned(),
        height: 260.0,
        read_out: None,
    };
    map.draw(
        &FULL,
        &format!(
            "Difference of channel {} as an image; relative error {}.",
            channel.name,
            percent(channel.relative)
        ),
    )
}

/// The error by parts of the product, all channels.
fn by_part(name: &str, comparison: &Comparison) -> Figure {
    let labels: Vec<&str> = comparison
        .channels
        .iter()
        .max_by_key(|c| c.parts.len())
        .map_or_else(Vec::new, |c| {
            c.parts.iter().map(|(l, _)| l.as_str()).collect()
        });
    let errors = || {
        comparison
            .channels
            .iter()
            .flat_map(|c| c.parts.iter().map(|(_, e)| *e))
    };
    let mut x = Axis::whole(
        comparison.kind.parted_by().trim_start_matches("error by "),
        -0.5,
        labels.len().max(1) as f64 - 0.5,
        labels.len().max(1),
    );
    let every = labels.len().div_ceil(10).max(1);
    x.ticks = labels
        .iter()
        .enumerate()
        .step_by(every)
        .map(|(i, label)| super::plot::scale::Tick {
            at: x.scale.position(i as f64),
            label: (*label).to_owned(),
        })
        .collect();
    let mut plot = Plot::new(
        Size::Wide,
        220.0,
        x.clone(),
        Axis::new(
            "error / norm of the second",
            Scale::log_around(errors(), 8.0),
            5,
        ),
    );
    let mut narrow = Plot::new(
        Size::Narrow,
        220.0,
        x,
        Axis::new(
            "error / norm of the second",
            Scale::log_around(errors(), 8.0),
            5,
        ),
    );
    let legend: Vec<Legend> = comparison
        .channels
        .iter()
        .enumerate()
        .map(|(c, channel)| Legend {
            class: series_class(&channel.name, c).to_owned(),
            mark: MARKS[c % MARKS.len()],
            label: channel.name.clone(),
        })
        .collect();
    plot = plot.with_legend(legend.clone());
    narrow = narrow.with_legend(legend);
    for (c, channel) in comparison.channels.iter().enumerate() {
        for (label, error) in &channel.parts {
            if let Some(i) = labels.iter().position(|l| l == label) {
                for drawing in [&mut plot, &mut narrow] {
                    let class = series_class(&channel.name, c);
                    drawing.point(i as f64, *error, MARKS[c % MARKS.len()], class);
                }
            }
        }
    }
    let alt = format!(
        "{name}: {} as marks, logarithmic.",
        comparison.kind.parted_by()
    );
    Figure {
        id: ids(comparison.kind)[1],
        title: "Where the two differ",
        caption: format!(
            "{name}. Root mean square of the differences in each part, over that of all of the second."
        ),
        panels: vec![Panel {
            name: "all".to_owned(),
            markup: plot.finish(&alt, "") + &narrow.finish(&alt, ""),
        }],
        table: Table {
            columns: ["part", "channel", "error"].map(str::to_owned).to_vec(),
            rows: comparison
                .channels
                .iter()
                .flat_map(|c| {
                    c.parts.iter().map(|(label, error)| {
                        vec![
                            Cell::Text(label.clone()),
                            Cell::Text(c.name.clone()),
                            Cell::Number(*error),
                        ]
                    })
                })
                .collect(),
            note: String::new(),
        },
        wide: true,
    }
}

const MARKS: [Mark; 3] = [Mark::Disc, Mark::Ring, Mark::Cross];
