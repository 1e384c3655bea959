use super::*;
use crate::geometry::test_photo::{Scene, alpha_error_deg, seen_from};

fn look(scene: &Scene, pose: &Pose, orbit: f64) -> Outline {
    find(
        &scene.photo(pose, orbit, 7),
        &scene.model(),
        &scene.object,
        Search::default(),
    )
    .unwrap()
}

#[test]
fn an_object_off_its_place_is_found_in_a_single_photo() {
    for shape in [Shape::Cylinder, Shape::Sphere] {
        for off in [-0.1, -0.03, 0.0, 0.03, 0.1] {
            let scene = Scene::new(shape, [960, 24]);
            // Orbit 0.1 sees both suns at a slant: both limbs are lit.
            let truth = seen_from(0.1, [0.0; 2], off * 0.05, 0.0);
            let found = look(&scene, &truth, 0.1);
            assert_eq!(found.status, Status::Both, "{shape:?} {off}");
            let error = alpha_error_deg(&scene, &truth, &found.pose);
            assert!(error < 0.05, "{shape:?} {off}: {error}°");
        }
    }
}

#[test]
fn a_tilted_cylinder_is_found_over_a_tall_strip() {
    for tilt_deg in [-5.0, 1.0, 3.0_f64] {
        let mut scene = Scene::new(Shape::Cylinder, [960, 240]);
        scene.background = 0.3;
        let truth = seen_from(0.1, [0.0; 2], 0.001, tilt_deg.to_radians());
        let found = look(&scene, &truth, 0.1);
        // 0.05 px over half of 240 rows.
        assert!(
            (found.pose.tilt - truth.tilt).abs() < 5e-4,
            "{tilt_deg}: {:?}",
            found.pose
        );
        assert!(alpha_error_deg(&scene, &truth, &found.pose) < 0.05);
    }
}

#[test]
fn a_whole_sphere_shows_its_height_too() {
    let mut scene = Scene::new(Shape::Sphere, [480, 480]);
    scene.background = 1.5;
    let mut truth = seen_from(0.1, [0.0; 2], 0.0015, 0.0);
    truth.offset[2] = -0.002;
    let found = look(&scene, &truth, 0.1);
    let px = scene.model().metres_per_px();
    assert_eq!(found.status, Status::Both);
    for i in [1, 2] {
        let error = (found.pose.offset[i] - truth.offset[i]) / px;
        assert!(error.abs() < 0.2, "{i}: {error} px");
    }
}

#[test]
fn a_sphere_looks_as_large_wherever_it_is_lit_from() {
    for roll_deg in [0.0f64, 20.0, 30.0, -45.0] {
        let mut scene = Scene::new(Shape::Sphere, [480, 480]);
        scene.roll = roll_deg.to_radians();
        let found = look(&scene, &Pose::nominal(), 0.1);
        let error = found.radius_px - found.predicted_radius_px;
        // A quarter of what a point of the limb is taken to be off.
        assert!(error.abs() < 0.0025, "{roll_deg}: {error} px");
    }
}

#[test]
fn a_shadows_edge_is_not_taken_for_the_limb() {
    // One sun, black background: the shadow begins inside the disc, where θo′ is 65° to 80°.
    for shape in [Shape::Cylinder, Shape::Sphere] {
        for from_sun in [-25.0, -20.0, -15.0, 15.0, 20.0, 25.0_f64] {
            let mut scene = Scene::new(shape, [960, 24]);
            scene.fill = 0.0;
            scene.suns = vec![(from_sun.to_radians(), 3.0)];
            let found = look(&scene, &Pose::nominal(), 0.0);
            let lit = if from_sun > 0.0 {
                Side::Right
            } else {
                Side::Left
            };
            assert_eq!(found.status, Status::Only(lit), "{shape:?} {from_sun}");
            let error = alpha_error_deg(&scene, &Pose::nominal(), &found.pose);
            // At 160° it peaks 7 px inside the limb, where B turns faster than powers of √x follow: 0.3 px.
            assert!(error < 0.1, "{shape:?} {from_sun}: {error}°");
        }
    }
}

#[test]
fn dust_and_missing_pixels_do_not_move_the_limb() {
    let scene = Scene::new(Shape::Cylinder, [960, 48]);
    let truth = seen_from(0.1, [0.0; 2], 0.001, 0.0);
    let mut photo = scene.photo(&truth, 0.1, 1);
    let clean = find(&photo, &scene.model(), &scene.object, Search::default()).unwrap();
    let left = clean.limb[0].column as usize;
    for row in 0..48 {
        for column in left - 6..left + 6 {
            let i = row * 960 + column;
            if row % 9 == 0 {
                photo.value[0][i] = 4.0;
            } else if row % 7 == 0 {
                photo.variance[0][i] = f32::INFINITY;
                photo.value[0][i] = f32::NAN;
            }
        }
    }
    let dusty = find(&photo, &scene.model(), &scene.object, Search::default()).unwrap();
    let moved = (dusty.centre_px[0] - clean.centre_px[0]).abs();
    assert!(moved < 0.05, "{moved} px");
}

#[test]
fn a_given_outline_reproduces_the_pose() {
    for shape in [Shape::Cylinder, Shape::Sphere] {
        let scene = Scene::new(shape, [960, 240]);
        let truth = Pose {
            offset: [0.0, 0.0013, 0.0],
            radius_scale: 1.03,
            ..Pose::nominal()
        };
        let g = ViewGeometry::new(&scene.model(), &scene.object, truth, 0.0);
        let [l, r] = Side::BOTH.map(|s| g.limb_at_row(120.0, s).unwrap());
        let hand = GivenOutline {
            centre_px: [0.5 * (l + r), 120.0],
            radius_px: 0.5 * (r - l),
        };
        let found = given(hand, &scene.model(), &scene.object).unwrap();
        // Columns are good to 1e-9 px of 400 px.
        assert!((found.pose.offset[1] - 0.0013).abs() < 1e-11);
        assert!((found.pose.radius_scale - 1.03).abs() < 1e-10);
        let bad = GivenOutline {
            radius_px: -3.0,
            ..hand
        };
        assert!(given(bad, &scene.model(), &scene.object).is_err());
    }
}

#[test]
fn odd_photos_are_survived() {
    let scene = Scene::new(Shape::Sphere, [64, 3]);
    let mut photo = scene.photo(&Pose::nominal(), 0.0, 0);
    photo.variance[0].fill(f32::INFINITY);
    let model = scene.model();
    let outline = find(&photo, &model, &scene.object, Search::default()).unwrap();
    assert_eq!(outline.status, Status::NotFound);
    photo.value[0].truncate(5);
    photo.variance[0].clear();
    assert!(find(&photo, &model, &scene.object, Search::default()).is_ok());
    photo.channels.clear();
    photo.value.clear();
    assert!(find(&photo, &model, &scene.object, Search::default()).is_ok());
    let mut huge = scene.object.clone();
    huge.radius = 1.0;
    assert!(find(&photo, &model, &huge, Search::default()).is_err());
}

/// The photo through a lens of Gaussian blur, `sigma` pixels.
fn blurred(photo: &Radiance, sigma: f64) -> Radiance {
    let [w, h] = photo.size.map(|s| s as usize);
    let reach = (4.0 * sigma).ceil() as isize;
    let kernel: Vec<f64> = (-reach..=reach)
        .map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp())
        .collect();
    let total: f64 = kernel.iter().sum();
    let pass = |from: &[f32], across: bool| -> Vec<f32> {
        (0..w * h)
            .map(|i| {
                let (x, y) = ((i % w) as isize, (i / w) as isize);
                let sum: f64 = kernel
                    .iter()
                    .enumerate()
                    .map(|(k, weight)| {
                        let d = k as isize - reach;
                        let (x, y) = if across { (x + d, y) } else { (x, y + d) };
                        let x = x.clamp(0, w as isize - 1) as usize;
                        let y = y.clamp(0, h as isize - 1) as usize;
                        weight * f64::from(from[y * w + x])
                    })
                    .sum();
                (sum / total) as f32
            })
            .collect()
    };
    let mut out = photo.clone();
    out.value[0] = pass(&pass(&photo.value[0], true), false);
    out
}

#[test]
fn a_lens_that_blurs_does_not_move_the_limb() {
    for shape in [Shape::Cylinder, Shape::Sphere] {
        for background in [0.0, 0.3, 1.5] {
            for sigma in [0.5, 1.0, 2.0] {
                let mut scene = Scene::new(shape, [960, 24]);
                scene.background = background;
                let truth = seen_from(0.1, [0.0; 2], 0.0015, 0.0);
                let photo = blurred(&scene.photo(&truth, 0.1, 1), sigma);
                let found = find(&photo, &scene.model(), &scene.object, Search::default()).unwrap();
                let error = alpha_error_deg(&scene, &truth, &found.pose);
                assert!(error < 0.05, "{shape:?} {background} {sigma}: {error}°");
            }
        }
    }
}

#[test]
fn a_background_of_any_brightness_will_do() {
    for shape in [Shape::Cylinder, Shape::Sphere] {
        for background in [0.0, 0.03, 0.1, 0.2, 0.4, 0.6, 0.9, 1.5, 5.0] {
            let mut scene = Scene::new(shape, [960, 24]);
            scene.background = background;
            let truth = seen_from(0.1, [0.0; 2], -0.0015, 0.0);
            let found = look(&scene, &truth, 0.1);
            let error = alpha_error_deg(&scene, &truth, &found.pose);
            assert!(error < 0.05, "{shape:?} {background}: {error}°");
        }
    }
}

#[test]
fn a_highlight_at_the_limb_is_not_taken_for_it() {
    // A sun from 120° to 179° off the line of sight: its highlight lies at θo′ of 60° to 89.5°.
    for shape in [Shape::Cylinder, Shape::Sphere] {
        for from_sun in [120.0, 140.0, 150.0, 160.0, 170.0_f64] {
            let mut scene = Scene::new(shape, [960, 24]);
            scene.suns = vec![(from_sun.to_radians(), 3.0)];
            scene.exponent = 128;
            scene.background = 0.02;
            let truth = seen_from(0.0, [0.0; 2], 0.0015, 0.0);
            let found = look(&scene, &truth, 0.0);
            let error = alpha_error_deg(&scene, &truth, &found.pose);
            // At 160° it peaks 7 px inside the limb, where B turns faster than powers of √x follow: 0.3 px.
            assert!(error < 0.1, "{shape:?} {from_sun}: {error}°");
        }
    }
}

#[test]
fn a_floor_or_a_stand_at_the_object_is_left_aside() {
    for shape in [Shape::Cylinder, Shape::Sphere] {
        let tall = match shape {
            Shape::Cylinder => 48,
            Shape::Sphere => 480,
        };
        for bright in [0.05, 0.5, 2.0f32] {
            let scene = Scene::new(shape, [960, tall]);
            let truth = seen_from(0.1, [0.0; 2], 0.0015, 0.0);
            let clean = scene.photo(&truth, 0.1, 1);
            // A floor over the lowest quarter of the rows, in front of the object.
            let mut floor = clean.clone();
            let width = 960;
            let from = (tall as usize * 3 / 4) * width;
            floor.value[0][from..].fill(bright);
            // A post that touches the left limb over a third of the rows and reaches 30 px to the left of it.
            let mut post = clean.clone();
            let geometry = ViewGeometry::new(&scene.model(), &scene.object, truth, 0.0);
            for row in tall as usize / 3..tall as usize * 2 / 3 {
                let limb = geometry.limb_at_row(row as f64 + 0.5, Side::Left).unwrap() as usize;
                post.value[0][row * width + limb - 30..row * width + limb].fill(bright);
            }
            for (name, photo) in [("floor", floor), ("post", post)] {
                let found = find(&photo, &scene.model(), &scene.object, Search::default()).unwrap();
                let error = alpha_error_deg(&scene, &truth, &found.pose);
                assert!(error < 0.2, "{shape:?} {bright} {name}: {error}°");
            }
        }
    }
}
