//! How the cost grows: with views, pixels, threads, the grid of samples and the order of the light; a page of log–log plots.
//!
//! `cargo bench --bench scaling` prints a table and writes `target/scaling/index.html`; with names behind `--` only those
//! parts (`views`, `pixels`, `threads`, `samples`, `order`). Each time is the least of several.

// Each bench uses a part of it.
#[allow(dead_code)]
mod photographs;

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use flatlight::Grid;
use flatlight::brdf::Phong;
use flatlight::capture::Capture;
use flatlight::light_field::Samples;
use flatlight::photo;
use flatlight::pipeline::{Folder, Recipe, Silent, execute, input_hashes};
use flatlight::recover::normal::NormalSystem;
use flatlight::report::plot::{Axis, Legend, Mark, Plot, Scale, Size, html_text};
use photographs::{Store, write_set};
use rayon::prelude::*;

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Measured times (seconds) against a size.
struct Curve {
    name: &'static str,
    points: Vec<(f64, f64)>,
    /// The exponent that theory gives, if it is a power.
    expected: Option<f64>,
}

struct Chart {
    title: &'static str,
    along: &'static str,
    curves: Vec<Curve>,
    remarks: Vec<String>,
}

fn main() -> Outcome<()> {
    let asked: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let wanted = |name: &str| asked.is_empty() || asked.iter().any(|a| a == name);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/scaling");
    let sets = folder.join("sets");
    let mut charts = Vec::new();
    type Part = (&'static str, fn(&Path) -> Outcome<Chart>);
    let parts: [Part; 5] = [
        ("views", views),
        ("pixels", pixels),
        ("threads", threads),
        ("samples", samples),
        ("order", order),
    ];
    for (name, part) in parts {
        if wanted(name) {
            let chart = part(&sets)?;
            print!("{}", chart.text());
            charts.push(chart);
        }
    }
    if sets.exists() {
        std::fs::remove_dir_all(&sets)?;
    }
    std::fs::create_dir_all(&folder)?;
    let page = folder.join("index.html");
    std::fs::write(&page, html(&charts))?;
    println!("open {}", page.display());
    Ok(())
}

/// The least time of some repetitions, at least three or half a second of them.
fn least(mut work: impl FnMut() -> Outcome<()>) -> Outcome<f64> {
    let (mut best, mut spent, mut runs) = (f64::INFINITY, 0.0, 0);
    while runs < 3 || (spent < 0.5 && runs < 20) {
        let start = Instant::now();
        work()?;
        let seconds = start.elapsed().as_secs_f64();
        best = best.min(seconds);
        spent += seconds;
        runs += 1;
    }
    Ok(best)
}

/// What `flatlight run` does, in a folder of its own, by one of the workers as there.
fn run(set: &Path) -> Outcome<Vec<(String, f64)>> {
    rayon::scope(|_| by_worker(set).map_err(|e| e.to_string())).map_err(Into::into)
}

fn by_worker(set: &Path) -> Outcome<Vec<(String, f64)>> {
    let recipe_file = set.join("recipe.toml");
    let (recipe, capture) = (Recipe::read(&recipe_file)?, Capture::read(set)?);
    let hashes = input_hashes(&recipe, &recipe_file, &capture)?;
    let mut found = execute(&recipe, &capture, &Silent)?;
    found.input_hashes = hashes;
    let out = set.join("out");
    Folder::new(&out).write_with(&found, &flatlight::report::page)?;
    std::fs::remove_dir_all(&out)?;
    Ok(found.stage_seconds)
}

fn made(
    folder: &Path,
    views: usize,
    distinct: usize,
    size: [u32; 2],
    store: Store,
) -> Outcome<PathBuf> {
    let set = folder.join(format!("{views}-{}x{}-{store:?}", size[0], size[1]));
    if !set.join("capture.toml").exists() {
        write_set(&set, views, distinct, size, store)?;
    }
    Ok(set)
}

fn views(sets: &Path) -> Outcome<Chart> {
    let (mut whole, mut photos) = (Vec::new(), Vec::new());
    for count in [18, 36, 72, 144, 288, 720] {
        let set = made(sets, count, count, [960, 48], Store::HalfZip)?;
        let mut first = f64::INFINITY;
        let seconds = least(|| {
            first = run(&set)?.first().map_or(first, |s| first.min(s.1));
            Ok(())
        })?;
        whole.push((count as f64, seconds));
        photos.push((count as f64, first));
        std::fs::remove_dir_all(&set)?;
    }
    Ok(Chart {
        title: "Views: runs of 960 × 48 pixels to the report",
        along: "views",
        curves: vec![
            Curve {
                name: "whole run",
                points: whole,
                expected: Some(1.0),
            },
            Curve {
                name: "photographs to light field",
                points: photos,
                expected: Some(1.0),
            },
        ],
        remarks: Vec::new(),
    })
}

fn pixels(sets: &Path) -> Outcome<Chart> {
    const VIEWS: usize = 12;
    let (mut whole, mut blocks, mut all) = (Vec::new(), Vec::new(), Vec::new());
    for size in [
        [960, 240],
        [1500, 1000],
        [3000, 2000],
        [6000, 4000],
        [9500, 6320],
    ] {
        let set = made(sets, VIEWS, 2, size, Store::HalfZip)?;
        let megapixels = f64::from(size[0]) * f64::from(size[1]) / 1e6;
        whole.push((megapixels, least(|| run(&set).map(|_| ()))?));
        let files: Vec<PathBuf> = (0..VIEWS)
            .map(|k| set.join(format!("views/{k:03}.exr")))
            .collect();
        // The rows that a run reads: 20 pixels about the cross-section for samples and outline at 6000 pixels.
        let half = (24_000 / size[0]).clamp(18, 120).min(size[1] / 2);
        let strip = size[1] / 2 - half..size[1] / 2 + half;
        let read = |rows: Option<std::ops::Range<u32>>| {
            least(|| {
                files
                    .par_iter()
                    .try_for_each(|f| photo::read(f, rows.clone()).map(drop))?;
                Ok(())
            })
        };
        blocks.push((megapixels, read(Some(strip))?));
        if megapixels < 30.0 {
            all.push((megapixels, read(None)?));
        }
        std::fs::remove_dir_all(&set)?;
    }
    Ok(Chart {
        title: "Pixels: 12 views in half-float ZIP EXR",
        along: "megapixels a view",
        curves: vec![
            Curve {
                name: "whole run",
                points: whole,
                expected: None,
            },
            Curve {
                name: "reading the blocks of the strip",
                points: blocks,
                expected: None,
            },
            Curve {
                name: "reading all of every photograph",
                points: all,
                expected: Some(1.0),
            },
        ],
        remarks: Vec::new(),
    })
}

fn threads(sets: &Path) -> Outcome<Chart> {
    let set = made(sets, 72, 72, [960, 240], Store::FloatZip)?;
    let mut points = Vec::new();
    for threads in [1usize, 2, 4] {
        if threads > std::thread::available_parallelism()?.get() {
            break;
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()?;
        let seconds = least(|| {
            pool.install(|| run(&set).map(|_| ()).map_err(|e| e.to_string()))
                .map_err(Into::into)
        })?;
        points.push((threads as f64, seconds));
    }
    let remarks = match points.as_slice() {
        [one, two, ..] => vec![format!("two threads: {:.2} times one", one.1 / two.1)],
        _ => Vec::new(),
    };
    Ok(Chart {
        title: "Threads: 72 views of 960 × 240 to the report",
        along: "threads",
        curves: vec![Curve {
            name: "whole run",
            points,
            expected: Some(-1.0),
        }],
        remarks,
    })
}

const LOBE: Phong = Phong {
    diffuse: 0.3,
    specular: 0.4,
    exponent: 32.0,
};

/// A full light field of one channel; where `irregular`, its samples lie beside their cells' centres.
fn full(normals: usize, locals: usize, irregular: bool) -> Samples {
    let grid = Grid { normals, locals };
    let value: Vec<f64> = (0..grid.len())
        .map(|k| 1.0 + (0.37 * k as f64).sin())
        .collect();
    let variance = vec![vec![1e-4; grid.len()]];
    let mut samples = Samples::from_grid(grid, vec!["Y".into()], &[value], &variance);
    if irregular {
        for column in &mut samples.columns {
            for (i, alpha) in column.alpha.iter_mut().enumerate() {
                *alpha += 1e-3 * (1.7 * i as f64).sin();
            }
        }
    }
    samples
}

/// Sums up the normal equations, which is what grows with the samples.
fn summed(samples: &Samples, order: usize) -> Outcome<f64> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let transfer = NormalSystem::new(samples, 0, &LOBE, order).transfer;
    least(|| {
        pool.install(|| NormalSystem::with_transfer(samples, 0, transfer.clone(), order));
        Ok(())
    })
}

fn samples(_: &Path) -> Outcome<Chart> {
    let (mut even, mut uneven) = (Vec::new(), Vec::new());
    for normals in [90, 180, 360, 720, 1440, 2880] {
        let count = (normals * 180) as f64;
        even.push((count, summed(&full(normals, 180, false), 40)?));
        uneven.push((count, summed(&full(normals, 180, true), 40)?));
    }
    Ok(Chart {
        title: "Recovery of order 40: samples in 180 columns, one thread",
        along: "samples",
        curves: vec![
            Curve {
                name: "α on a regular circle: N log N + columns · P²",
                points: even,
                expected: Some(1.0),
            },
            Curve {
                name: "α anyhow: N · P + columns · P²",
                points: uneven,
                expected: Some(1.0),
            },
        ],
        remarks: Vec::new(),
    })
}

fn order(_: &Path) -> Outcome<Chart> {
    let (mut even, mut uneven) = (Vec::new(), Vec::new());
    let (on, beside) = (full(720, 180, false), full(720, 180, true));
    for order in [8usize, 16, 32, 64, 128, 256] {
        even.push((order as f64, summed(&on, order)?));
        uneven.push((order as f64, summed(&beside, order)?));
    }
    Ok(Chart {
        title: "Recovery from 720 × 180: order P of the light, one thread",
        along: "order P",
        curves: vec![
            Curve {
                name: "α on a regular circle: N log N + columns · P²",
                points: even,
                expected: Some(2.0),
            },
            Curve {
                name: "α anyhow: N · P + columns · P²",
                points: uneven,
                expected: Some(1.0),
            },
        ],
        remarks: Vec::new(),
    })
}

/// Slope of the least-squares line through the logarithms of the upper half of the sizes, where constants have faded.
fn exponent(points: &[(f64, f64)]) -> f64 {
    let upper: Vec<(f64, f64)> = points
        [points.len() / 2 - usize::from(points.len() < 4 && points.len() > 1)..]
        .iter()
        .map(|(x, y)| (x.ln(), y.ln()))
        .collect();
    let n = upper.len() as f64;
    let mean = upper
        .iter()
        .fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let (mut xy, mut xx) = (0.0, 0.0);
    for (x, y) in &upper {
        xy += (x - mean.0) * (y - mean.1);
        xx += (x - mean.0).powi(2);
    }
    xy / xx
}

impl Curve {
    fn legend(&self) -> String {
        let expected = self
            .expected
            .map_or_else(String::new, |e| format!(", expected {e:.0} in the end"));
        format!(
            "{} (exponent {:.2}{expected})",
            self.name,
            exponent(&self.points)
        )
    }
}

impl Chart {
    fn text(&self) -> String {
        let mut text = format!("{}\n", self.title);
        for curve in &self.curves {
            let _ = writeln!(text, "  {}", curve.legend());
            for (x, y) in &curve.points {
                let _ = writeln!(text, "    {x:>10} {}: {:.5} s", self.along, y);
            }
        }
        for remark in &self.remarks {
            let _ = writeln!(text, "  {remark}");
        }
        text
    }

    fn svg(&self) -> String {
        const CLASSES: [&str; 3] = ["s-a", "s-b", "s-c"];
        let all = || self.curves.iter().flat_map(|c| &c.points);
        let x = Scale::log_around(all().map(|p| p.0), 6.0);
        let y = Scale::log_around(all().map(|p| p.1), 6.0);
        let legend = self
            .curves
            .iter()
            .zip(CLASSES)
            .map(|(curve, class)| Legend {
                class: class.into(),
                mark: Mark::Line,
                label: curve.legend(),
            })
            .collect();
        let mut plot = Plot::new(
            Size::Wide,
            300.0,
            Axis::new(self.along, x, 6),
            Axis::new("time, s", y, 5),
        )
        .with_legend(legend);
        for (curve, class) in self.curves.iter().zip(CLASSES) {
            plot.line(&curve.points, class);
            for (x, y) in &curve.points {
                plot.point(*x, *y, Mark::Disc, class);
            }
            // The slope that theory gives, through the last point.
            if let (Some(slope), Some(first), Some(last)) =
                (curve.expected, curve.points.first(), curve.points.last())
            {
                let start = last.1 * (first.0 / last.0).powf(slope);
                plot.line(&[(first.0, start), *last], &format!("{class} floor"));
            }
        }
        plot.finish(&format!("{}: time against {}", self.title, self.along), "")
    }
}

fn html(charts: &[Chart]) -> String {
    let style = include_str!("../src/report/template/style.css");
    let mut body = String::new();
    for chart in charts {
        let _ = write!(
            body,
            "<h2>{}</h2>\n{}\n<table><tr><th>{}</th>",
            html_text(chart.title),
            chart.svg(),
            chart.along
        );
        for curve in &chart.curves {
            let _ = write!(body, "<th>{}, s</th>", html_text(curve.name));
        }
        body += "</tr>\n";
        for (i, (x, _)) in chart
            .curves
            .first()
            .map_or(&[][..], |c| &c.points)
            .iter()
            .enumerate()
        {
            let _ = write!(body, "<tr><td>{x}</td>");
            for curve in &chart.curves {
                let cell = curve
                    .points
                    .get(i)
                    .map_or_else(String::new, |p| format!("{:.5}", p.1));
                let _ = write!(body, "<td>{cell}</td>");
            }
            body += "</tr>\n";
        }
        body += "</table>\n";
        for remark in &chart.remarks {
            let _ = writeln!(body, "<p>{}</p>", html_text(remark));
        }
    }
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>What flatlight costs</title>\n<style>\n{style}\n</style>\n</head>\n<body>\n<main>\n<h1>What flatlight costs</h1>\n<p>Measured times (least of several) on {} processors; dashed: the slope that theory gives for large sizes.</p>\n{body}</main>\n</body>\n</html>\n",
        std::thread::available_parallelism().map_or(0, usize::from)
    )
}
