//! Promises of the prefiltering, against the angular integral.

use std::sync::Arc;
use std::time::Instant;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::angle::WorldAngle;
use crate::brdf::{GgxConductor, Lambertian, Mirror, Phong};
use crate::lighting::Source;
use crate::reflect::integral;

/// A town square at noon in `n` values: blue gradient, dark walls with bright windows, texture of a
/// tenth, and a sun in one value, ten thousand times the sky.
fn environment(n: usize, sun: bool) -> Lighting {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut table = vec![0.0; n];
    for (i, v) in table.iter_mut().enumerate() {
        let theta = std::f64::consts::TAU * i as f64 / n as f64;
        *v = 1.0 + 0.6 * theta.sin() + 0.1 * (random.random::<f64>() - 0.5);
        if (n / 8..n / 4).contains(&i) {
            *v *= if i / 9 % 3 == 0 { 2.5 } else { 0.15 };
        }
    }
    if sun {
        table[n * 5 / 7] = 1e4;
    }
    Lighting {
        channels: vec!["Y".into()],
        table: vec![table],
        ..Lighting::default()
    }
}

fn one(brdf: Arc<dyn Brdf>) -> Material {
    Material {
        channels: vec!["Y".into()],
        brdfs: vec![brdf],
    }
}

fn materials() -> Vec<(&'static str, Material)> {
    let phong = |exponent| {
        one(Arc::new(Phong {
            diffuse: 0.3,
            specular: 0.5,
            exponent,
        }))
    };
    let ggx = |alpha| {
        one(Arc::new(GgxConductor {
            alpha,
            eta: 0.2,
            k: 3.9,
            specular: 1.0,
        }))
    };
    vec![
        ("Lambertian", one(Arc::new(Lambertian { albedo: 0.8 }))),
        ("Phong 32", phong(32.0)),
        ("Phong 200000", phong(2e5)),
        ("GGX 0.2", ggx(0.2)),
        ("GGX 0.01", ggx(0.01)),
    ]
}

/// The largest error at `cells` random cells against the angular integral, in units of the level.
fn error(light: &Lighting, material: &Material, made: &Prefiltered, cells: usize) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let brdf = material.brdfs[0].as_ref();
    let picked: Vec<(usize, usize)> = (0..cells)
        .map(|_| {
            let (i, j) = (random.next_u32() as usize, random.next_u32() as usize);
            (i % made.grid.normals, j % made.grid.locals)
        })
        .collect();
    picked
        .par_iter()
        .map(|&(i, j)| {
            let (normal, local) = (made.grid.normal(i), made.grid.local(j));
            let b = integral::value(light, 0, brdf, normal, local);
            (made.value[0][made.grid.index(i, j)] - b).abs() / made.choices[0].level
        })
        .reduce(|| 0.0, f64::max)
}

const GRID: Grid = Grid {
    normals: 512,
    locals: 45,
};

#[test]
fn the_promised_error_is_kept_for_every_material_with_and_without_a_sun() {
    for sun in [false, true] {
        let light = environment(1024, sun);
        for (name, material) in materials() {
            for tolerance in [1e-2, 1e-3] {
                let options = Options {
                    tolerance,
                    ..Options::default()
                };
                let made = prefilter(&light, &material, GRID, &options).unwrap();
                let choice = &made.choices[0];
                let found = error(&light, &material, &made, 150);
                assert!(
                    choice.bound <= tolerance * 1.0001,
                    "{name} {}",
                    choice.bound
                );
                assert!(found <= tolerance, "{name} sun {sun}: {found:.1e}");
                // The cheapest of what was weighed was taken.
                let least = made
                    .considered
                    .iter()
                    .filter_map(|c| Some(c.prediction?.cost));
                assert_eq!(least.fold(f64::MAX, f64::min), choice.cost);
                // A sun of 10⁴ cannot be kept in the shade's tolerance by coefficients; a lobe narrower
                // than the environment's detail is integrated, a broad one is not.
                let integrated = choice.split_columns() > 0;
                assert!(
                    !(sun && tolerance < 2e-3) || choice.peaks > 0 || integrated,
                    "{name}"
                );
                match name {
                    "Lambertian" | "Phong 32" => assert_eq!(choice.split_columns(), 0),
                    "Phong 200000" => assert_eq!(choice.split_columns(), GRID.locals),
                    _ => {}
                }
            }
        }
    }
}

/// Lights that are hard in different ways.
fn hard_environments() -> Vec<(&'static str, Lighting)> {
    let table = |name, values: Vec<f64>| {
        let light = Lighting {
            channels: vec!["Y".into()],
            table: vec![values],
            ..Lighting::default()
        };
        (name, light)
    };
    let mut random = ChaCha8Rng::seed_from_u64(3);
    // A dark hall with spots one or two values wide, of very different brightness.
    let mut hall: Vec<f64> = (0..1000).map(|i| 0.02 + 0.01 * f64::from(i % 3)).collect();
    for k in 0..12 {
        let (i, bright) = (random.random_range(0..1000), 10f64.powi(k % 5));
        hall[i] += bright;
        hall[(i + 1) % 1000] += bright * f64::from(k % 2);
    }
    let mut tiny = environment(2048, false).table.swap_remove(0);
    tiny[700] = 1e6;
    tiny[1501] = 3e5;
    vec![
        ("square", environment(1024, false)),
        ("hall", table("", hall).1),
        ("tiny suns", table("", tiny).1),
        (
            "noise",
            table("", (0..360).map(|_| random.random::<f64>()).collect()).1,
        ),
        (
            "half",
            table("", (0..512).map(|i| f64::from(i / 256)).collect()).1,
        ),
    ]
}

fn hard_materials() -> Vec<(&'static str, Material)> {
    let mut all = materials();
    for text in [
        "model = \"phong\"\ndiffuse = 0.1\nspecular = 0.5\nexponent = 1",
        "model = \"ggx-conductor\"\nalpha = 0.05\neta = 0.2\nk = 3.9",
        "model = \"ggx-dielectric\"\nalpha = 0.05\ndiffuse = 0.3",
        "model = \"ggx-dielectric\"\nalpha = 0.3\ndiffuse = 0.3",
        "model = \"oren-nayar\"\nalbedo = 0.5\nsigma_deg = 25",
        "model = \"torrance-sparrow\"\ndiffuse = 0.3\nroughness = 0.1\nior = 1.5",
        "model = \"ward\"\ndiffuse = 0.3\nspecular = 0.3\nalpha = 0.1",
        "model = \"sheen\"\ndiffuse = 0.1\nsheen = 0.5\nexponent = 40",
        "model = \"sheen\"\ndiffuse = 0.1\nsheen = 0.5\nroughness = 0.3",
    ] {
        let model = crate::brdf::Model::from_table(&text.parse().unwrap()).unwrap();
        let channels = ["Y".to_string()];
        let material = model.material(&channels, std::path::Path::new("")).unwrap();
        all.push((text, material));
    }
    all
}

/// Cells at random, more towards grazing exitance than elsewhere.
fn cells(grid: Grid, n: usize) -> Vec<(usize, usize)> {
    let mut random = ChaCha8Rng::seed_from_u64(19);
    (0..n)
        .map(|_| {
            let i = random.random_range(0..grid.normals);
            let x = random.random::<f64>() * std::f64::consts::PI;
            let j = (0.5 * (1.0 - x.cos()) * grid.locals as f64) as usize;
            (i, j.min(grid.locals - 1))
        })
        .collect()
}

#[test]
fn every_stated_bound_is_one() {
    let grid = Grid {
        normals: 256,
        locals: 37,
    };
    let picked = cells(grid, 80);
    let (mut kept, mut refused) = (0, 0);
    for (place, light) in hard_environments() {
        for (name, material) in hard_materials() {
            let brdf = material.brdfs[0].as_ref();
            let exact: Vec<f64> = picked
                .par_iter()
                .map(|&(i, j)| integral::value(&light, 0, brdf, grid.normal(i), grid.local(j)))
                .collect();
            for (tolerance, ways) in [
                (1e-2, Ways::Product),
                (1e-2, Ways::Split),
                (1e-3, Ways::Cheapest),
                (1e-4, Ways::Cheapest),
            ] {
                let options = Options { tolerance, ways };
                let case = format!("{name:?} in {place} to {tolerance:e} by {ways:?}");
                let Ok(made) = prefilter(&light, &material, grid, &options) else {
                    // Kinks at the horizon and spots of light can ask for more coefficients than there are.
                    assert_eq!(ways, Ways::Product, "{case}");
                    refused += 1;
                    continue;
                };
                kept += 1;
                let choice = &made.choices[0];
                assert!(choice.bound <= tolerance * 1.000_001, "{case}");
                for (&(i, j), exact) in picked.iter().zip(&exact) {
                    let error = (made.value[0][grid.index(i, j)] - exact).abs();
                    let plan = &choice.columns[j];
                    assert!(plan.bound <= choice.bound * choice.level * 1.000_001);
                    // The oracle is good to 1e-10, of values up to 10⁶ times the level.
                    assert!(
                        error <= plan.bound + 1e-10 * exact,
                        "{case} at {}°: {error:e}, stated {:e}, {:?}",
                        plan.local.deg(),
                        plan.bound,
                        plan.path
                    );
                }
            }
        }
    }
    assert!(kept > 240 && refused < kept / 5, "{kept} {refused}");
}

#[test]
fn a_smooth_brdf_needs_few_coefficients_and_is_fast() {
    let light = environment(1024, false);
    let material = &materials()[1].1;
    let grid = Grid {
        normals: 1024,
        locals: 180,
    };
    let one_core = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let start = Instant::now();
    let made = one_core
        .install(|| prefilter(&light, material, grid, &Options::default()))
        .unwrap();
    let fast = start.elapsed().as_secs_f64();
    // The angular integral as plainly as it can be said: one term per value of the environment.
    let brdf = &material.brdfs[0];
    let start = Instant::now();
    let mut largest = 0.0f64;
    let columns = [20, 90, 150];
    for j in columns {
        let local = grid.local(j);
        for i in 0..grid.normals {
            let mut sum = 0.0;
            for (k, l) in light.table[0].iter().enumerate() {
                let theta = -std::f64::consts::PI + std::f64::consts::TAU * k as f64 / 1024.0;
                let incident = WorldAngle::radians(theta) - grid.normal(i);
                sum += l * brdf.value(incident, local) * incident.visible_cosine();
            }
            sum *= std::f64::consts::TAU / 1024.0;
            largest = largest.max((sum - made.value[0][grid.index(i, j)]).abs());
        }
    }
    let slow = start.elapsed().as_secs_f64() * grid.locals as f64 / columns.len() as f64;
    assert!(largest <= 2e-3 * made.choices[0].level);
    assert!(made.choices[0].orders().1 < 200);
    assert!(made.choices[0].coefficients() < 200 * grid.locals);
    // Measured without optimisation beyond level 1 and beside other tests, the ratio is near 100 on a
    // single core; this fails only if the work becomes another order of magnitude.
    assert!(slow > 10.0 * fast, "{slow} {fast}");
}

#[test]
fn a_sun_does_not_ring_in_the_shade() {
    // Where the sun does not shine the light field is the sky's alone, to the tolerance of the sky.
    let (sunny, cloudy) = (environment(1024, true), environment(1024, false));
    let material = &materials()[0].1;
    let with = prefilter(&sunny, material, GRID, &Options::default()).unwrap();
    let without = prefilter(&cloudy, material, GRID, &Options::default()).unwrap();
    let sun = WorldAngle::radians(-std::f64::consts::PI + std::f64::consts::TAU * 731.0 / 1024.0);
    let mut shaded = 0;
    for i in 0..GRID.normals {
        if !(sun - GRID.normal(i)).is_visible() {
            // The sun's tent reaches one value over the horizon.
            if ((sun - GRID.normal(i)).rad().abs() - std::f64::consts::FRAC_PI_2) < 0.0062 {
                continue;
            }
            shaded += 1;
            for j in 0..GRID.locals {
                let cell = GRID.index(i, j);
                let difference = with.value[0][cell] - without.value[0][cell];
                // Two results of 1e-3 each, and the texture value that the sun replaced.
                assert!(difference.abs() < 2.5e-3 * without.choices[0].level);
            }
        }
    }
    assert!(shaded > 240);
}

#[test]
fn a_strip_is_the_table_between_its_cells() {
    let mut light = environment(1024, true);
    light.sources.push(Source {
        theta: WorldAngle::degrees(12.0),
        irradiance: vec![4.0],
    });
    let material = &materials()[1].1;
    let grid = Grid {
        normals: 720,
        locals: 180,
    };
    let made = prefilter(&light, material, grid, &Options::default()).unwrap();
    // An orthographic view from 40°: α = 40° − asin x, θo′ = asin x.
    let pixels: Vec<Option<(NormalAngle, LocalAngle)>> = (0..200)
        .map(|k| {
            let x: f64 = (f64::from(k) - 99.5) / 95.0;
            (x.abs() < 1.0).then(|| {
                let local = x.asin();
                (
                    NormalAngle::radians(0.698 - local),
                    LocalAngle::radians(local),
                )
            })
        })
        .collect();
    let strip = made.strip(&pixels);
    let brdf = material.brdfs[0].as_ref();
    for (seen, b) in pixels.iter().zip(&strip[0]) {
        match seen {
            Some((a, o)) => {
                let exact = integral::value(&light, 0, brdf, *a, *o);
                // The tolerance, and cubic interpolation over half a degree of a 14° lobe.
                let error = (b - exact).abs() / made.choices[0].level;
                assert!(error < 1.5e-3, "{} {error}", o.deg());
            }
            None => assert_eq!(*b, 0.0),
        }
    }
}

#[test]
fn a_mirror_shows_the_environment_and_its_sun_unfiltered() {
    let light = environment(1024, true);
    let material = one(Arc::new(Mirror { reflectance: 0.5 }));
    let made = prefilter(&light, &material, GRID, &Options::default()).unwrap();
    for i in 0..GRID.normals {
        for j in 0..GRID.locals {
            let (normal, local) = (GRID.normal(i), GRID.local(j));
            let expected = 0.5 * light.density(0, normal + -local);
            let error = made.value[0][GRID.index(i, j)] - expected;
            assert!(error.abs() < 1e-12 * expected.max(1.0));
        }
    }
}

#[test]
fn the_table_is_written_as_an_image() {
    let light = environment(256, false);
    let made = prefilter(&light, &materials()[0].1, GRID, &Options::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("prefiltered.exr");
    made.write(&file).unwrap();
    // Any reader of images will do.
    let image = crate::lighting::environment::Environment::read(&file).unwrap();
    assert_eq!((image.width, image.height), (GRID.locals, GRID.normals));
    for (pixel, b) in image.values[0].iter().zip(&made.value[0]) {
        assert_eq!(*pixel, *b as f32);
    }
}

#[test]
fn nonsense_is_refused() {
    let light = environment(64, false);
    let material = &materials()[0].1;
    for tolerance in [0.0, -1.0, f64::NAN] {
        assert!(
            prefilter(
                &light,
                material,
                GRID,
                &Options {
                    tolerance,
                    ..Options::default()
                }
            )
            .is_err()
        );
    }
    let empty = Grid {
        normals: 0,
        locals: 4,
    };
    assert!(prefilter(&light, material, empty, &Options::default()).is_err());
}
