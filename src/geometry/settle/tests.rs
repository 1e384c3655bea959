use super::*;
use crate::angle::WorldAngle;
use crate::capture::{Sensor, View};
use crate::geometry::outline::{Search, find};
use crate::geometry::test_photo::{Scene, alpha_error_deg, seen_from};

fn capture(scene: &Scene, orbits: &[f64]) -> Capture {
    Capture {
        name: String::new(),
        folder: ".".into(),
        object: scene.object.clone(),
        camera: scene.camera.clone(),
        sensor: Sensor::default(),
        views: orbits
            .iter()
            .map(|o| View {
                orbit: WorldAngle::radians(*o),
                photos: Vec::new(),
                plane_roll: 0.0,
                mask: None,
                outline: None,
            })
            .collect(),
    }
}

/// Photographs `views` views and settles them: the truth, the result.
fn run(scene: &Scene, truth: &[Pose], orbits: &[f64]) -> (Vec<Outline>, Settled) {
    let model = scene.model();
    let outlines: Vec<Outline> = truth
        .iter()
        .zip(orbits)
        .enumerate()
        .map(|(k, (pose, orbit))| {
            let photo = scene.photo(pose, *orbit, k as u64);
            find(&photo, &model, &scene.object, Search::default()).unwrap()
        })
        .collect();
    let settled = settle(&outlines, &capture(scene, orbits)).unwrap();
    (outlines, settled)
}

fn orbits(n: u32) -> Vec<f64> {
    (0..n)
        .map(|k| 0.1 + std::f64::consts::TAU * f64::from(k) / f64::from(n))
        .collect()
}

/// Errors of a set: the largest of the views' rms α errors (degrees), the largest lateral error and
/// the largest lateral error over its σ (pixels).
struct Errors {
    alpha_deg: f64,
    lateral_px: f64,
    sigmas: f64,
}

/// Photographs 24 views of an object that is off by 3 % of its radius (`off` = 1) and tilted by 1°, and settles them.
fn errors(scene: &Scene, off: f64) -> Errors {
    let orbits = orbits(24);
    let tilt = match scene.object.shape {
        Shape::Cylinder => 1_f64.to_radians() * off,
        Shape::Sphere => 0.0,
    };
    let truth: Vec<Pose> = orbits
        .iter()
        .map(|o| seen_from(*o, [0.0012 * off, -0.0006 * off], 0.0006 * off, tilt))
        .collect();
    let (_, settled) = run(scene, &truth, &orbits);
    let px = scene.model().metres_per_px();
    let mut worst = Errors {
        alpha_deg: 0.0,
        lateral_px: 0.0,
        sigmas: 0.0,
    };
    for (truth, found) in truth.iter().zip(&settled.poses) {
        let lateral = (found.offset[1] - truth.offset[1]).abs();
        worst.alpha_deg = worst.alpha_deg.max(alpha_error_deg(scene, truth, found));
        worst.lateral_px = worst.lateral_px.max(lateral / px);
        worst.sigmas = worst.sigmas.max(lateral / found.sigma_lateral);
    }
    worst
}

#[test]
fn a_clean_set_is_settled_whether_or_not_the_object_is_in_its_place() {
    for shape in [Shape::Cylinder, Shape::Sphere] {
        for background in [0.0, 0.3] {
            let mut scene = Scene::new(shape, [960, 12]);
            scene.background = background;
            for off in [0.0, 1.0] {
                let e = errors(&scene, off);
                // What the acceptance of real photographs asks: 0.05° for an unknown offset, and for a centred
                // object hardly more than if the description were believed.
                assert!(
                    e.alpha_deg < 0.05,
                    "{shape:?} {background} {off}: {}°",
                    e.alpha_deg
                );
                assert!(
                    e.lateral_px < 0.02,
                    "{shape:?} {background} {off}: {} px",
                    e.lateral_px
                );
            }
        }
    }
}

#[test]
fn one_sun_before_black_shows_one_limb_at_a_time_and_is_settled() {
    for shape in [Shape::Cylinder, Shape::Sphere] {
        for off in [0.0, 1.0] {
            let mut scene = Scene::new(shape, [960, 12]);
            scene.fill = 0.0;
            scene.suns.truncate(1);
            let e = errors(&scene, off);
            // The error that a limb is trusted to. Tangents to first order in the displacement would miss this: at one limb
            // alone they are off by tan²(5°) of it, 0.08 px.
            assert!(e.lateral_px < 0.03, "{shape:?} {off}: {} px", e.lateral_px);
            assert!(e.alpha_deg < 0.02, "{shape:?} {off}: {}°", e.alpha_deg);
            assert!(e.sigmas < 3.0, "{shape:?} {off}: {} σ", e.sigmas);
        }
    }
}

#[test]
fn a_leaning_axis_is_found() {
    let orbits = orbits(36);
    let lean = 1_f64.to_radians();
    for rows in [16, 48] {
        for background in [0.0, 0.3] {
            let mut scene = Scene::new(Shape::Cylinder, [480, rows]);
            scene.background = background;
            // Towards 30° of the orbit, and a camera that is rolled by 0.3°.
            let roll = 0.3_f64.to_radians();
            let truth: Vec<Pose> = orbits
                .iter()
                .map(|o| {
                    seen_from(
                        *o,
                        [0.0; 2],
                        0.0,
                        roll + lean * (o - 30_f64.to_radians()).sin(),
                    )
                })
                .collect();
            let (_, settled) = run(&scene, &truth, &orbits);
            let [x, y] = settled.axis;
            let error = (x - lean * 30_f64.to_radians().cos()).hypot(y - lean * 0.5);
            // A view's limbs are located with an error of 0.04 px that goes with their place within a pixel, over
            // 12 rows 3e-3; it does not average out over views, see `LOCKED`.
            assert!(error < 4e-3, "{rows} {background}: {error}");
            assert!(error < 4.0 * settled.sigma_axis);
        }
    }
}

#[test]
fn dim_limbs_beside_a_highlight_are_not_taken_for_a_displacement() {
    // In most views one limb vanishes into the background, and the flank of the highlight is found in its place,
    // up to 10 px inside; in others the limb is a hundred times dimmer than the highlight a few pixels away.
    for shape in [Shape::Cylinder, Shape::Sphere] {
        for alpha in [0.05, 0.1, 0.15] {
            for off in [0.0, 1.0] {
                let mut scene = Scene::new(shape, [480, 12]);
                scene.fill = 0.0;
                scene.suns = vec![(1.163, 3.0)];
                scene.metal = Some(alpha);
                let e = errors(&scene, off);
                // A tenth of a degree of α over the disc, what an error of the light's direction may be.
                assert!(
                    e.alpha_deg < 0.1,
                    "{shape:?} {alpha} {off}: {}°",
                    e.alpha_deg
                );
                assert!(e.sigmas < 4.0, "{shape:?} {alpha} {off}: {} σ", e.sigmas);
            }
        }
    }
}

#[test]
fn noise_and_a_background_half_as_bright_are_withstood() {
    for shape in [Shape::Cylinder, Shape::Sphere] {
        // The diffuse part of the surface is about 0.6 at its brightest: SNR 30.
        let mut scene = Scene::new(shape, [960, 12]);
        scene.background = 0.3;
        scene.noise = 0.02;
        for off in [0.0, 1.0] {
            let e = errors(&scene, off);
            assert!(e.alpha_deg < 0.2, "{shape:?} {off}: {}°", e.alpha_deg);
            assert!(e.sigmas < 4.0, "{shape:?} {off}: {} σ", e.sigmas);
        }
    }
}

#[test]
fn jitter_of_the_views_is_followed_and_measured() {
    let orbits = orbits(24);
    let scene = Scene::new(Shape::Cylinder, [960, 12]);
    let px = scene.model().metres_per_px();
    // Two pixels to and fro, in no pattern of the orbit.
    let truth: Vec<Pose> = orbits
        .iter()
        .enumerate()
        .map(|(k, o)| seen_from(*o, [0.0; 2], 2.0 * px * f64::sin(2.4 * (k * k) as f64), 0.0))
        .collect();
    let (outlines, settled) = run(&scene, &truth, &orbits);
    // rms of 2 sin is √2 px; 24 draws determine a spread to 15 %, the median deviation to 25 %.
    assert!(
        (1.0..2.6).contains(&(settled.jitter / px)),
        "{}",
        settled.jitter / px
    );
    for (k, (t, p)) in truth.iter().zip(&settled.poses).enumerate() {
        if outlines[k].status == Status::Both && !settled.set_aside.contains(&k) {
            let error = (t.offset[1] - p.offset[1]).abs() / px;
            assert!(error < 0.3, "view {k}: {error} px");
        }
    }
}

#[test]
fn a_radius_described_wrongly_is_measured() {
    let orbits = orbits(12);
    let scene = Scene::new(Shape::Sphere, [960, 12]);
    let truth: Vec<Pose> = orbits
        .iter()
        .map(|_| Pose {
            radius_scale: 1.02,
            ..Pose::nominal()
        })
        .collect();
    let (outlines, settled) = run(&scene, &truth, &orbits);
    // 0.05 px of 408 px.
    assert!(
        (settled.radius_scale - 1.02).abs() < 1.2e-4,
        "{}",
        settled.radius_scale
    );
    let seen = outlines[0].disagreement(&scene.object);
    assert!(
        (seen.radius - 0.02).abs() < 1e-3 && seen.sigma_radius < 1e-3,
        "{seen:?}"
    );
}

#[test]
fn without_any_limb_the_description_stands_with_a_wide_sigma() {
    let orbits = orbits(3);
    let mut scene = Scene::new(Shape::Cylinder, [960, 12]);
    scene.fill = 0.0;
    scene.suns.clear();
    let truth = vec![Pose::nominal(); 3];
    let (outlines, settled) = run(&scene, &truth, &orbits);
    for (outline, pose) in outlines.iter().zip(&settled.poses) {
        assert_eq!(outline.status, Status::NotFound);
        assert_eq!(pose.offset, [0.0; 3]);
        assert!(pose.sigma_lateral > 0.1 * scene.object.radius);
    }
}
