//! The page of a run built from closed forms: a Phong cylinder under a sun and a fill.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use num_complex::Complex64;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::figure::lighting_curve::beside_sources;
use super::page;
use crate::angle::{LocalAngle, WorldAngle, wrap};
use crate::brdf::{Brdf, transfer_row};
use crate::error::Result;
use crate::fourier::Series;
use crate::grid::Grid;
use crate::light_field::LightField;
use crate::pipeline::{Preview, Run, Spectrum, ViewRecord};
use crate::recover::Status;
use crate::recover::lighting::{
    ChannelEstimate, Coefficient, LightingEstimate, RegularisationChoice, SourceEstimate,
};

const NAMES: [&str; 3] = ["R", "G", "B"];
const SUN_DEG: f64 = 37.3;
const SUN: [f64; 3] = [3.0, 2.9, 2.7];
const FILL: [f64; 3] = [0.04, 0.045, 0.055];
const DIFFUSE: [f64; 3] = [0.30, 0.22, 0.15];
const SPECULAR: f64 = 0.40;
const EXPONENT: f64 = 32.0;
const VIEWS: usize = 72;

#[derive(Debug)]
struct Phong(f64);

impl Brdf for Phong {
    fn value(&self, incident: LocalAngle, exitant: LocalAngle) -> f64 {
        let lobe = (incident.rad() + exitant.rad()).cos().max(0.0);
        if incident.is_visible() && exitant.is_visible() {
            self.0 / PI + SPECULAR * (EXPONENT + 2.0) / TAU * lobe.powf(EXPONENT)
        } else {
            0.0
        }
    }

    fn lobe_width(&self) -> f64 {
        (2.0 / EXPONENT).sqrt()
    }
}

/// Light field, lighting and views of the scene, with 0.3 % noise; everything a run has.
fn sun_run() -> Run {
    let grid = Grid {
        normals: 720,
        locals: 180,
    };
    let channels: Vec<String> = NAMES.map(str::to_owned).to_vec();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let mut field = LightField::empty(grid, channels.clone());
    let mut residual = field.clone();
    let limb_cut = 80f64.to_radians();
    for (c, diffuse) in DIFFUSE.into_iter().enumerate() {
        let brdf = Phong(diffuse);
        for j in 0..grid.locals {
            let local = grid.local(j);
            if local.rad().abs() > limb_cut {
                continue;
            }
            let fill = FILL[c] * transfer_row(&brdf, local, 0)[0].re;
            for i in 0..grid.normals {
                // A cell is seen if one of the views, every 5°, falls into it.
                let orbit = (grid.normal(i) + local).deg();
                let nearest = (orbit / 5.0).round() * 5.0;
                if (orbit - nearest).abs() > 0.25 + 1e-9 {
                    continue;
                }
                let sun = WorldAngle::degrees(SUN_DEG) - grid.normal(i);
                let value = fill + SUN[c] * brdf.value(sun, local) * sun.visible_cosine();
                let sigma = 0.003 * (0.02 + value.max(0.0)).sqrt() / local.rad().cos().sqrt();
                let noise: f64 = StandardNormal.sample(&mut rng);
                let k = grid.index(i, j);
                field.mean[c][k] = (value + sigma * noise) as f32;
                residual.mean[c][k] = (sigma * noise) as f32;
                field.sigma[c][k] = sigma as f32;
                field.weight[c][k] = (6.0 / local.rad().cos()) as f32;
            }
        }
    }
    residual.sigma = field.sigma.clone();
    residual.weight = field.weight.clone();
    Run {
        title: "One sun on a red velvet cylinder".to_owned(),
        recover: "lighting".to_owned(),
        capture_toml: "format = 1\nname = \"red velvet\"\n\n[object]\nshape = \"cylinder\"\nradius = 0.05\n\n[camera]\nprojection = \"perspective\"\ndistance = 0.6\n".to_owned(),
        recipe_toml: "format = 1\nrecover = \"lighting\"\n\n[brdf]\nmodel = \"phong\"\nexponent = 32.0\n\n[recovery]\nregularisation = \"gcv\"\nnon_negative = true\n".to_owned(),
        capture_name: "red velvet on a 100 mm cylinder".to_owned(),
        channels,
        radiance_unit: "W m⁻² sr⁻¹".to_owned(),
        limb_cut,
        views: views(),
        orbit: None,
        previews: previews(),
        spectrum: spectrum(),
        residual: Some(residual),
        view_residual: None,
        fit: Vec::new(),
        lighting: Some(lighting()),
        brdf: None,
        models: None,
        gauge: Vec::new(),
        light_field: field,
        warnings: vec!["Two views (12, 40) are 0.4 % brighter than their neighbours; check that the lamp was stable, or give per-view gains.".to_owned()],
        findings: vec![
            "One source was found at 37.300° ± 0.004°, with 3.001 ± 0.002 W m⁻² in R.".to_owned(),
            "The smooth lighting is determined up to frequency 14 in every channel, features wider than about 13°.".to_owned(),
            "Frequencies above 20 cannot be known from this material: the Phong lobe reflects less than the noise of them.".to_owned(),
        ],
        stage_seconds: vec![("photographs".to_owned(), 0.412), ("outline".to_owned(), 0.081), ("light field".to_owned(), 0.063), ("lighting".to_owned(), 0.094)],
        input_hashes: (0..VIEWS).map(|v| (format!("views/{v:03}.exr"), blake3::hash(&v.to_le_bytes()).to_hex().to_string())).collect::<BTreeMap<_, _>>(),
        version: "0.1.0".to_owned(),
    }
}

fn views() -> Vec<ViewRecord> {
    (0..VIEWS)
        .map(|v| ViewRecord {
            orbit_deg: v as f64 * 5.0,
            file: format!("views/{v:03}.exr"),
            centre_px: [480.21, 119.73],
            centre_sigma_px: 0.0123,
            radius_px: 401.3,
            limbs_seen: [true, v != 7],
            samples: 47_520,
        })
        .collect()
}

/// A shaded cylinder as a camera at 0° and 90° sees it, with the true outline.
fn previews() -> Vec<Preview> {
    let (width, height) = (480u32, 120u32);
    [0usize, 18, 36, 54]
        .into_iter()
        .map(|view| {
            let orbit = view as f64 * 5f64.to_radians();
            let mut rgb = Vec::new();
            for _y in 0..height {
                for x in 0..width {
                    let u = (f64::from(x) + 0.5 - 240.0) / 200.0;
                    for c in 0..3 {
                        let value = if u.abs() < 1.0 {
                            let local = LocalAngle::radians(-u.asin());
                            let sun = wrap(SUN_DEG.to_radians() - orbit - u.asin());
                            let brdf = Phong(DIFFUSE[c]);
                            let light = if sun.abs() < FRAC_PI_2 {
                                sun.cos()
                            } else {
                                0.0
                            };
                            SUN[c] * brdf.value(LocalAngle::radians(sun), local) * light + 0.02
                        } else {
                            0.005
                        };
                        rgb.push((255.0 * (value / 1.2).clamp(0.0, 1.0).powf(0.45)) as u8);
                    }
                }
            }
            Preview {
                view,
                size: [width, height],
                rgb,
                scale: 2.0,
                outline: vec![
                    vec![[40.0, 0.0], [40.0, 120.0]],
                    vec![[440.0, 0.0], [440.0, 120.0]],
                ],
                measured_line: vec![[40.0, 60.0], [440.0, 60.0]],
                measured_rows: [52.0, 68.0],
            }
        })
        .collect()
}

/// L_p of the sun and the fill.
fn light_coefficient(c: usize, p: usize) -> Complex64 {
    let fill = if p == 0 { FILL[c] } else { 0.0 };
    SUN[c] / TAU * Complex64::cis(-(p as f64) * SUN_DEG.to_radians()) + fill
}

fn spectrum() -> Vec<Spectrum> {
    let (p_max, q_max) = (60usize, 40i64);
    (0..3)
        .map(|c| {
            let brdf = Phong(DIFFUSE[c]);
            let nodes: Vec<f64> = (0..90)
                .map(|k| -FRAC_PI_2 + (f64::from(k) + 0.5) * PI / 90.0)
                .collect();
            let rows: Vec<Vec<Complex64>> = nodes
                .iter()
                .map(|t| transfer_row(&brdf, LocalAngle::radians(*t), p_max))
                .collect();
            let mut image = Vec::new();
            let mut magnitude = Vec::new();
            for p in 0..=p_max {
                let light = light_coefficient(c, p);
                let square: f64 =
                    rows.iter().map(|r| (light * r[p]).norm_sqr()).sum::<f64>() / 90.0;
                magnitude.push((square + 1e-8).sqrt());
                image.push(
                    (-q_max..=q_max)
                        .map(|q| {
                            let sum: Complex64 = rows
                                .iter()
                                .zip(&nodes)
                                .map(|(r, t)| r[p] * Complex64::cis(-(q as f64) * t))
                                .sum();
                            (light * sum / 180.0).norm() + 1e-6
                        })
                        .collect(),
                );
            }
            Spectrum {
                channel: NAMES[c].to_owned(),
                magnitude,
                noise_floor: vec![1e-4; p_max + 1],
                image,
            }
        })
        .collect()
}

fn lighting() -> LightingEstimate {
    let band = 24usize;
    let channels = (0..3)
        .map(|c| {
            let table: Vec<f64> = (0..720)
                .map(|i| {
                    // A source is one table value of E / step, plus a fill with a broad sky.
                    let theta = (-180.0 + 0.5 * f64::from(i)).to_radians();
                    let sky =
                        FILL[c] * (1.0 + 0.8 * (theta - 1.2).cos() + 0.2 * (3.0 * theta).sin());
                    let at_sun = i == ((SUN_DEG + 180.0) * 2.0_f64).round() as i32;
                    sky + if at_sun {
                        SUN[c] / 0.5f64.to_radians()
                    } else {
                        0.0
                    }
                })
                .collect();
            let spectrum = (0..=band)
                .map(|p| {
                    let sigma = 2e-4 * (p as f64 * p as f64 / 70.0).exp();
                    Coefficient {
                        value: if p > 20 {
                            Complex64::ZERO
                        } else {
                            light_coefficient(c, p)
                        },
                        sigma: if p > 20 { 0.0 } else { sigma.min(0.1) },
                        bound: if p > 20 { f64::INFINITY } else { sigma },
                        status: match p {
                            0..=14 => Status::Determined,
                            15..=20 => Status::Weak,
                            _ => Status::Indeterminate,
                        },
                    }
                })
                .collect();
            ChannelEstimate {
                name: NAMES[c].to_owned(),
                table_sigma: table.iter().map(|v| 0.002 + 0.02 * v.min(0.2)).collect(),
                table,
                // The sky of the table: 1 + 0.8 cos(θ − 1.2) + 0.2 sin 3θ.
                smooth: Series {
                    coefficients: vec![
                        Complex64::new(FILL[c], 0.0),
                        0.4 * FILL[c] * Complex64::cis(-1.2),
                        Complex64::ZERO,
                        Complex64::new(0.0, -0.1 * FILL[c]),
                    ],
                },
                irradiance: vec![SUN[c]],
                spectrum,
                determined_band: Some(14),
                residual_rms: 0.0011,
                residual_relative: 0.0013,
                chi2: 1.02,
                regularisation: RegularisationChoice {
                    criterion: "gcv".to_owned(),
                    strength: 1e-4,
                    curve: (-8..=1)
                        .map(|k| (10f64.powi(k), 1e-5 * (1.0 + 0.1 * f64::from(k + 4).powi(2))))
                        .collect(),
                },
            }
        })
        .collect();
    LightingEstimate {
        channels,
        sources: vec![SourceEstimate {
            theta_deg: 37.3003,
            theta_sigma_deg: 0.0041,
            irradiance: SUN.to_vec(),
            irradiance_sigma: vec![0.0021, 0.0020, 0.0022],
        }],
    }
}

/// All text between `open` and the next `close`.
fn pieces<'a>(html: &'a str, open: &str, close: &str) -> Vec<&'a str> {
    html.split(open)
        .skip(1)
        .filter_map(|rest| rest.split_once(close).map(|(inside, _)| inside))
        .collect()
}

#[test]
fn every_figure_has_a_caption_a_drawing_a_table_and_its_data() -> Result<()> {
    let html = page(&sun_run())?;
    // The page can be looked at: FLATLIGHT_REPORT_OUT=page.html cargo test --lib report
    if let Ok(file) = std::env::var("FLATLIGHT_REPORT_OUT") {
        std::fs::write(&file, &html).map_err(|e| crate::Error::write(file.as_ref(), e))?;
    }
    let figures = pieces(&html, "<figure ", "</figure>");
    assert_eq!(figures.len(), 13);
    for figure in figures {
        let caption = pieces(figure, "<figcaption>", "</figcaption>");
        assert_eq!(caption.len(), 1);
        assert!(caption[0].len() > 60, "{caption:?}");
        let id = pieces(figure, "id=\"", "\"")[0];
        assert!(figure.contains("role=\"img\" aria-label=\""), "{id}");
        assert!(figure.contains(&format!("download=\"{id}.csv\"")), "{id}");
        let rows = figure.matches("<tr>").count();
        assert!((2..=42).contains(&rows), "{id}: {rows} rows");
        let csv = pieces(figure, "href=\"data:text/csv;charset=utf-8,", "\"");
        assert_eq!(csv.len(), 1);
        assert!(csv[0].matches("%0A").count() >= rows - 1, "{id}");
    }
    for word in ["37.3003 ± 0.0041", "3.0000 ± 0.0021", "p ≤ 14", "0.130 %"] {
        assert!(html.contains(word), "{word}");
    }
    // The bound for a whole report.
    assert!(html.len() < 3_000_000, "{} bytes", html.len());
    Ok(())
}

#[test]
fn nothing_in_the_page_leaves_the_page() -> Result<()> {
    let html = page(&sun_run())?;
    for attribute in [
        " src=\"",
        " href=\"",
        " action=\"",
        " data=\"",
        " srcset=\"",
    ] {
        for target in pieces(&html, attribute, "\"") {
            assert!(
                target.starts_with("data:") || target.starts_with('#'),
                "{attribute}{target}"
            );
        }
    }
    for word in [
        "@import",
        "url(http",
        "<link rel=\"stylesheet",
        "fetch(",
        "XMLHttpRequest",
    ] {
        assert!(!html.contains(word), "{word}");
    }
    for target in pieces(&html, "url(", ")") {
        assert!(target.starts_with('#'), "{target}");
    }
    // Every fragment has its target, and every id is given once.
    let mut ids: Vec<&str> = pieces(&html, " id=\"", "\"");
    ids.extend(pieces(&html, " id='", "'"));
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), count, "an id stands twice");
    for target in pieces(&html, " href=\"#", "\"") {
        assert!(ids.contains(&target), "#{target}");
    }
    Ok(())
}

#[test]
fn names_from_a_capture_are_text_and_never_markup() -> Result<()> {
    let hostile = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>&amp;]]></svg></style>";
    let mut run = sun_run();
    run.title = hostile.to_owned();
    run.capture_name = hostile.to_owned();
    run.capture_toml = format!("[object]\nshape = '''{}'''\n", hostile.replace("'", ""));
    run.recipe_toml = format!("[brdf]\nmodel = '''{}'''\n", hostile.replace("'", ""));
    run.radiance_unit = hostile.to_owned();
    run.version = hostile.to_owned();
    run.warnings = vec![hostile.to_owned()];
    run.findings = vec![hostile.to_owned()];
    run.stage_seconds = vec![(hostile.to_owned(), 1.0)];
    run.input_hashes = [(hostile.to_owned(), hostile.to_owned())].into();
    for view in &mut run.views {
        view.file = hostile.to_owned();
    }
    let names: Vec<String> = (0..3).map(|c| format!("{c}{hostile}")).collect();
    run.channels = names.clone();
    run.light_field.channels = names.clone();
    if let Some(residual) = &mut run.residual {
        residual.channels = names.clone();
    }
    for (spectrum, name) in run.spectrum.iter_mut().zip(&names) {
        spectrum.channel = name.clone();
    }
    if let Some(lighting) = &mut run.lighting {
        for (channel, name) in lighting.channels.iter_mut().zip(&names) {
            channel.name = name.clone();
            channel.regularisation.criterion = hostile.to_owned();
        }
    }
    let html = page(&run)?;
    assert!(!html.contains("alert(1)</script>"));
    assert!(!html.contains("<img"));
    // The page's own single script is the only one, and its own style the only style.
    assert_eq!(html.matches("<script").count(), 1);
    assert_eq!(html.matches("</style>").count(), 1);
    let plain = page(&sun_run())?;
    for tag in ["<svg", "</svg>", "<figure", "<path", "<table"] {
        let (a, b) = (html.matches(tag).count(), plain.matches(tag).count());
        // Long names wrap legends into more rows, but make no element more or less.
        assert_eq!(a, b, "{tag}");
    }
    Ok(())
}

#[test]
fn sections_appear_only_if_there_is_something_to_show() -> Result<()> {
    let mut run = sun_run();
    run.recover = "none".to_owned();
    run.lighting = None;
    run.residual = None;
    run.previews.clear();
    run.spectrum.clear();
    run.warnings.clear();
    let html = page(&run)?;
    for id in ["lighting-section", "fit-section", "photos", "spectrum"] {
        assert!(!html.contains(&format!("id=\"{id}\"")), "{id}");
    }
    assert!(html.contains("id=\"light-field\""));
    assert!(!html.contains("class=\"warning\""));
    Ok(())
}

#[test]
fn odd_data_never_panic_and_broken_sizes_are_errors() -> Result<()> {
    let mut run = sun_run();
    run.light_field = LightField::empty(run.light_field.grid, run.channels.clone());
    run.residual = Some(run.light_field.clone());
    run.views.clear();
    run.previews[0].view = 999;
    run.previews[1].size = [0, 0];
    run.spectrum[0].magnitude = vec![f64::NAN; 3];
    run.spectrum[1].image = vec![vec![1.0], vec![]];
    if let Some(lighting) = &mut run.lighting {
        lighting.channels[0].table = vec![f64::NAN; 720];
        lighting.channels[1].table.clear();
        lighting.channels[2].spectrum.clear();
        lighting.channels[0].regularisation.curve = vec![(0.0, f64::NAN), (f64::INFINITY, 1.0)];
        lighting.sources[0].irradiance.clear();
        lighting.sources[0].theta_deg = f64::NAN;
    }
    page(&run)?;
    run.light_field.mean.pop();
    assert!(page(&run).is_err());
    let mut run = sun_run();
    run.previews[0].rgb.pop();
    assert!(page(&run).is_err());
    Ok(())
}

#[test]
fn a_dense_noisy_field_still_fits_into_the_size_of_a_page() -> Result<()> {
    let mut run = sun_run();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(2);
    let count = run.light_field.grid.len();
    for c in 0..3 {
        for k in 0..count {
            let noise: f64 = StandardNormal.sample(&mut rng);
            let value = 1.0 + (k as f64 / 9e3).sin() + 0.01 * noise;
            run.light_field.mean[c][k] = value as f32;
            run.light_field.sigma[c][k] = (0.01 + 0.001 * noise.abs()) as f32;
            run.light_field.weight[c][k] = 5.0;
            if let Some(residual) = &mut run.residual {
                residual.mean[c][k] = (0.01 * noise) as f32;
                residual.sigma[c][k] = 0.01;
                residual.weight[c][k] = 5.0;
            }
        }
    }
    let html = page(&run)?;
    assert!(html.len() < 3_000_000, "{} bytes", html.len());
    Ok(())
}

#[test]
fn the_curve_beside_a_source_is_the_smooth_light_alone() {
    let estimate = lighting();
    for (c, channel) in estimate.channels.iter().enumerate() {
        for at in beside_sources(&estimate, channel) {
            let theta = at.theta_deg.to_radians();
            let sky = FILL[c] * (1.0 + 0.8 * (theta - 1.2).cos() + 0.2 * (3.0 * theta).sin());
            // Both are the same closed form, but for rounding.
            assert!((at.value - sky).abs() < 1e-12, "{} {}", at.value, sky);
            assert_eq!(at.half.is_nan(), (at.theta_deg - SUN_DEG).abs() < 0.5);
        }
    }
}
