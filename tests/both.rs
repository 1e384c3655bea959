//! Lighting and BRDF at once, from photographs alone.

use std::path::Path;

use flatlight::brdf::{Brdf, Model};
use flatlight::capture::{Capture, Encoding};
use flatlight::fourier::Series;
use flatlight::lighting::{Lighting, Source};
use flatlight::pipeline::{Folder, Recipe, Run, Silent, Verdict, execute};
use flatlight::recover::Status;
use flatlight::simulate;
use flatlight::{LocalAngle, WorldAngle};

fn light() -> Lighting {
    let channels: Vec<String> = ["R", "G", "B"].map(String::from).to_vec();
    let sources = [(37.3, [3.0, 2.9, 2.7]), (-104.6, [1.1, 1.3, 1.7])]
        .map(|(deg, e)| Source {
            theta: WorldAngle::degrees(deg),
            irradiance: e.to_vec(),
        })
        .to_vec();
    Lighting::from_sources(channels.clone(), sources)
        .plus(&Lighting::uniform(channels, &[0.04, 0.045, 0.055]))
}

/// Of a set's views the first `views`.
fn run(set: &str, views: usize, scale: &str) -> Run {
    run_changed(set, scale, &|capture| capture.views.truncate(views))
}

/// A set whose description was changed first.
fn run_changed(set: &str, scale: &str, change: &dyn Fn(&mut Capture)) -> Run {
    let text = format!("format = 1\nrecover = \"both\"\n{scale}\n");
    let recipe = Recipe::parse(&text, Path::new("recipe.toml"), Path::new(".")).expect("a recipe");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("testdata")
        .join(set);
    let mut capture = Capture::read(&folder).expect("a capture");
    change(&mut capture);
    execute(&recipe, &capture, &Silent).expect("a run")
}

/// Photographs simulated from a scene, whose files are in `folder`.
fn run_simulated(scene: &str, folder: &Path) -> Run {
    let scene = simulate::Recipe::parse(scene, Path::new("scene.toml"), folder).expect("a scene");
    let place = tempfile::tempdir().expect("a temporary folder");
    let set = place.path().join("set");
    simulate::simulate(&scene, &set, false, &|| {}).expect("photographs");
    let recipe = Recipe::parse(
        "format = 1\nrecover = 'both'\n",
        Path::new("recipe.toml"),
        Path::new("."),
    )
    .expect("a recipe");
    let capture = Capture::read(&set).expect("a capture");
    execute(&recipe, &capture, &Silent).expect("a run")
}

/// Relative L2 error up to `order` after the best scale, and that scale (truth over result).
fn lighting_error(run: &Run, c: usize, truth: &Lighting, order: usize) -> (f64, f64) {
    let spectrum = &run.lighting.as_ref().expect("a light").channels[c].spectrum;
    let truth = truth.series(c, order);
    let found = Series {
        coefficients: spectrum.iter().map(|l| l.value).collect(),
    };
    let weight = |p: i64| if p == 0 { 1.0 } else { 2.0 };
    let sum = |f: &dyn Fn(i64) -> f64| (0..=order as i64).map(|p| weight(p) * f(p)).sum::<f64>();
    let scale =
        sum(&|p| (found.get(p).conj() * truth.get(p)).re) / sum(&|p| found.get(p).norm_sqr());
    let error = sum(&|p| (scale * found.get(p) - truth.get(p)).norm_sqr());
    ((error / sum(&|p| truth.get(p).norm_sqr())).sqrt(), scale)
}

/// Root mean square error of ρ cos cos within 70° over its maximum.
fn brdf_error(run: &Run, c: usize, truth: &dyn Brdf) -> f64 {
    let brdf = run.brdf.as_ref().expect("a slice");
    let (mut squares, mut count, mut largest) = (0.0, 0.0, 0.0f64);
    for i in 0..brdf.size {
        for j in 0..brdf.size {
            let [a, b] = [i, j].map(|k| LocalAngle::radians(brdf.angle(k)));
            if a.deg().abs() > 70.0 || b.deg().abs() > 70.0 {
                continue;
            }
            let cosines = a.visible_cosine() * b.visible_cosine();
            let (rho, _) = brdf.rho(c, i, j).expect("a value within 70°");
            let truth = truth.value(a, b);
            squares += ((rho - truth) * cosines).powi(2);
            largest = largest.max(truth * cosines);
            count += 1.0;
        }
    }
    (squares / count).sqrt() / largest
}

/// A gold cylinder under two suns and a fill, nothing known but the total irradiance.
///
/// Promised is 0.5 % of the lighting up to p = 12. Blue, where gold is dark at the mirror direction and bright at grazing, so
/// that more of the lobe lies beyond the limb cut, is the hardest: 0.16 %.
#[test]
fn a_metal_under_two_suns_gives_light_and_material() {
    let total: Vec<f64> = (0..3).map(|c| light().total_irradiance(c)).collect();
    let run = run(
        "ggx02-two-suns",
        72,
        &format!("[scale]\ntotal_irradiance = {total:?}"),
    );
    let recipe = "model = 'ggx-conductor'\nalpha = 0.2\neta = [0.1431, 0.3749, 1.4424]\nk = [3.9831, 2.3857, 1.6032]";
    let truth = Model::from_table(&recipe.parse().expect("TOML"))
        .and_then(|m| m.material(&run.channels, Path::new(".")))
        .expect("gold");
    for c in 0..3 {
        let (error, scale) = lighting_error(&run, c, &light(), 12);
        assert!(error < 5e-3, "channel {c}: {error}");
        assert!((scale - 1.0).abs() < 0.01, "channel {c}: {scale}");
        let rms = brdf_error(&run, c, truth.brdfs[c].as_ref());
        assert!(rms < 3e-3, "channel {c}: {rms}");
        // Right to 0.2 %, the result explains the photographs: noise-free ones but for kinks where the suns graze, 0.4–0.7 %.
        let fit = &run.fit[c];
        assert!(
            fit.verdict == Verdict::Explained && fit.unexplained < 0.01,
            "{fit:?}"
        );
        let channel = &run.lighting.as_ref().expect("a light").channels[c];
        assert!(channel.determined_band >= Some(12));
        // Eq. 29 uses one row of the equations where the result uses all.
        let gauge = &run.gauge[c];
        assert!(gauge.ratios_difference > 3.0 * error, "{gauge:?}");
        assert_eq!(gauge.components.len(), 1);
        // For a renderer the suns must not ring below zero, and what is cut off must not make the light brighter: p ≤ 12 as recovered.
        let shown = run.lighting.as_ref().expect("a light").without_negative();
        assert!(shown.table[c].iter().all(|l| *l >= 0.0));
        let (found, recovered) = (shown.series(c, 12), &channel.spectrum);
        for (p, l) in recovered.iter().enumerate().take(13) {
            let off = (found.get(p as i64) - l.value).norm() / recovered[0].value.norm();
            assert!(off < 2e-3, "channel {c}, p = {p}: {off}");
        }
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    Folder::new(folder.path())
        .write(&run, "<html></html>")
        .expect("products");
    for name in [
        "lighting.csv",
        "lighting_spectrum.csv",
        "lighting.exr",
        "brdf.csv",
        "brdf_spectrum.csv",
        "brdf.exr",
        "brdf_models.json",
        "residual.exr",
    ] {
        assert!(folder.path().join(name).exists(), "{name}");
    }
    let text = std::fs::read_to_string(folder.path().join("summary.json")).expect("text");
    let summary: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let gauge = &summary["channels"][0]["gauge"];
    for key in ["scale", "components", "undetermined", "difference_of_eq_29"] {
        assert!(!gauge[key].is_null(), "{key}");
    }
}

/// Photographs that no lighting and BRDF explain are told: a view stands 1.5° beside its stated angle, to alternate sides (a tenth of
/// the lobe's height on its flanks), or the photographs are not linear.
#[test]
fn what_does_not_explain_the_photographs_is_told() {
    let crooked = |capture: &mut Capture| {
        for (k, view) in capture.views.iter_mut().enumerate() {
            let side = if k % 2 == 0 { 1.5 } else { -1.5 };
            view.orbit = WorldAngle::degrees(view.orbit.deg() + side);
        }
    };
    let curved = |capture: &mut Capture| capture.sensor.encoding = Some(Encoding::Gamma(1.8));
    for (name, run) in [
        ("orbit", run_changed("ggx02-two-suns", "", &crooked)),
        ("gamma", run_changed("ggx02-two-suns", "", &curved)),
    ] {
        for fit in &run.fit {
            assert_ne!(fit.verdict, Verdict::Explained, "{name}: {fit:?}");
        }
        assert!(
            run.warnings.iter().any(|w| w.contains("unexplained")),
            "{name}: {:?}",
            run.warnings
        );
    }
}

/// The error bars of a slice whose light was found along with it hold the light's error: it bends the whole crest of a sharp lobe alike, however many
/// samples there are of it.
#[test]
fn the_error_bars_of_the_slice_hold_those_of_the_light() {
    // A light of all frequencies up to 16, nowhere negative.
    let mut series = Series::zero(16);
    for p in 0..=16 {
        let size = if p == 0 { 1.0 } else { 0.07 };
        series.coefficients[p] = num_complex::Complex64::from_polar(size, 2.4 * (p * p) as f64);
    }
    let mut table = "theta_deg,L_Y\n".to_owned();
    for k in 0..720 {
        let deg = -180.0 + 0.5 * f64::from(k);
        let l = series.evaluate(deg.to_radians());
        assert!(l > 0.0, "{deg}: {l}");
        table += &format!("{deg},{l}\n");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("light.csv"), table).expect("writes");
    let scene = "format = 1\nname = 'noisy'\nseed = 9\nchannels = ['Y']\n[object]\nshape = 'cylinder'\nradius = 0.05\n\
        [camera]\nprojection = 'perspective'\nimage_size = [480, 12]\nfocal_px = 2439.5\ndistance = 0.6\n\
        [views]\ncount = 72\norbit_start_deg = 0.0\norbit_step_deg = 5.0\n\
        [brdf]\nmodel = 'ggx-conductor'\nalpha = 0.1\neta = 0.2\nk = 3.9\n[lighting]\ntable = 'light.csv'\n\
        [sensor]\nformat = 'png'\nbits = 16\nexposures_s = [1.0]\nfill = 0.8\nfull_well_e = 3000\nread_noise_e = 8\n";
    let run = run_simulated(scene, folder.path());
    let recipe = "model = 'ggx-conductor'\nalpha = 0.1\neta = 0.2\nk = 3.9";
    let truth = Model::from_table(&recipe.parse().expect("TOML"))
        .and_then(|m| m.material(&run.channels, Path::new(".")))
        .expect("a metal");
    let brdf = run.brdf.as_ref().expect("a slice");
    let found = run.lighting.as_ref().expect("a light").channels[0].spectrum[0].value;
    let scale = found.re / series.get(0).re;
    let (mut squares, mut inside, mut count) = (0.0, 0.0, 0.0);
    for i in 0..brdf.size {
        for j in 0..brdf.size {
            let [a, b] = [i, j].map(|k| LocalAngle::radians(brdf.angle(k)));
            if a.deg().abs() > 75.0 || b.deg().abs() > 75.0 {
                continue;
            }
            let Some((rho, sigma)) = brdf.rho(0, i, j) else {
                continue;
            };
            let z = (scale * rho - truth.brdfs[0].value(a, b)) / (scale * sigma);
            squares += z * z;
            inside += f64::from(u8::from(z.abs() < 1.96));
            count += 1.0;
        }
    }
    let (z, inside) = (f64::sqrt(squares / count), inside / count);
    // With the light taken for known z was 2.6. The light's errors are some twenty numbers that all values share: 1/√40 = 16 % of z, two of those.
    assert!(count > 10_000.0, "{count}");
    assert!((0.6..1.35).contains(&z) && inside > 0.85, "{z} {inside}");
}

/// Half a circle of views: the other half of the light field may be anything, and uniform light is not what hides its frequencies.
#[test]
fn views_over_half_of_the_circle_are_not_enough_for_both() {
    let run = run("ggx02-two-suns", 36, "");
    let told = |what: &str| run.warnings.iter().any(|w| w.contains(what));
    assert!(
        told("185° of the circle have no views"),
        "{:?}",
        run.warnings
    );
    assert!(
        !told("does not change with the normal"),
        "{:?}",
        run.warnings
    );
}

/// Uniform light tells of the light its mean and of the BRDF its mean over incidence (eq. 28), all around and from a third of the
/// circle: every frequency beyond is named as open, and no value of the BRDF is called known.
#[test]
fn uniform_light_leaves_all_but_the_means_open() {
    for (views, step) in [(36, 10.0), (24, 5.0)] {
        let text = format!(
            "format = 1\nname = 'uniform'\nchannels = ['Y']\n[object]\nshape = 'cylinder'\nradius = 0.05\n\
             [camera]\nprojection = 'perspective'\nimage_size = [480, 24]\nfocal_px = 2439.5\ndistance = 0.6\n\
             [views]\ncount = {views}\norbit_start_deg = 0.0\norbit_step_deg = {step}\n\
             [brdf]\nmodel = 'phong'\ndiffuse = 0.3\nspecular = 0.4\nexponent = 32\n[lighting]\nuniform = 0.4\n\
             [sensor]\nformat = 'png'\nbits = 16\nexposures_s = [1.0]\nfill = 0.8\nfull_well_e = 1000000\nread_noise_e = 8\n"
        );
        let run = run_simulated(&text, Path::new("."));
        let gauge = &run.gauge[0];
        assert_eq!(
            gauge.undetermined,
            (1..=gauge.band).collect::<Vec<_>>(),
            "{views} views"
        );
        let light = &run.lighting.as_ref().expect("a light").channels[0];
        assert_eq!(light.determined_band, Some(0));
        for (p, l) in light.spectrum.iter().enumerate().skip(1) {
            assert!(
                l.status == Status::Indeterminate && l.value.norm() == 0.0,
                "{views} views, p = {p}: {l:?}"
            );
        }
        let slice = &run.brdf.as_ref().expect("a slice").slices[0];
        assert!(slice.status.iter().all(|s| *s != Status::Determined));
        assert!(
            run.warnings
                .iter()
                .any(|w| w.contains("does not change with the normal")),
            "{:?}",
            run.warnings
        );
    }
}

/// A diffuse surface passes hardly any odd frequency of the light (eq. 22): they are named, not invented.
#[test]
fn a_lambertian_surface_leaves_odd_frequencies_undetermined() {
    let run = run("lambertian-smooth", 36, "");
    for channel in &run.lighting.as_ref().expect("a light").channels {
        for (p, l) in channel.spectrum.iter().enumerate() {
            if p > 1 && p % 2 == 1 {
                assert_ne!(l.status, Status::Determined, "{} p = {p}", channel.name);
            }
        }
    }
    assert!(run.gauge.iter().all(|g| g.scale.contains("convention")));
    // Hardly anything of the light is determined without a model; with one the surface is recognised.
    for gauge in &run.gauge {
        let models = gauge.parametric.as_ref().expect("models");
        assert_eq!(models.fits[0].model, "lambertian", "{}", gauge.channel);
        assert_eq!(models.fits[0].lighting[3].status, Status::Indeterminate);
    }
}

/// A gold cylinder from a third of the circle: most of the light was never seen, and what is called determined is right.
#[test]
fn views_over_a_third_of_the_circle_leave_the_light_open() {
    let total: Vec<f64> = (0..3).map(|c| light().total_irradiance(c)).collect();
    let run = run(
        "ggx02-two-suns",
        24,
        &format!("[scale]\ntotal_irradiance = {total:?}"),
    );
    for (c, channel) in run
        .lighting
        .as_ref()
        .expect("a light")
        .channels
        .iter()
        .enumerate()
    {
        let truth = light().series(c, channel.spectrum.len());
        for (p, l) in channel.spectrum.iter().enumerate().skip(1) {
            let off = (l.value - truth.get(p as i64)).norm();
            assert!(
                l.status == Status::Indeterminate || off < 5.0 * 2f64.sqrt() * l.sigma,
                "channel {c}, p = {p}: {off}, {l:?}"
            );
        }
        let open = run.gauge[c].undetermined.len();
        assert!(
            2 * open > channel.spectrum.len(),
            "{:?}",
            run.gauge[c].undetermined
        );
    }
}
