//! What is said of sets that are wrong, and of sound ones.

use super::*;

fn write(path: &Path, size: (usize, usize), exposure: f32) {
    use exr::prelude::*;
    let channels = SpecificChannels::build()
        .with_channel("Y")
        .with_pixel_fn(|_: Vec2<usize>| (1.0_f32,));
    let mut attributes = LayerAttributes::named("main");
    attributes.exposure = Some(exposure);
    let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, channels);
    Image::from_layer(layer).write().to_file(path).unwrap();
}

#[test]
fn everything_wrong_comes_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write(&at("a.exr"), (8, 4), 1.0);
    write(&at("b.exr"), (8, 5), 1.0);
    std::fs::write(at("c.exr"), "no photo").unwrap();
    let rgb = image::RgbImage::new(8, 4);
    rgb.save(at("d.png")).unwrap();
    write(&at("mask.exr"), (9, 4), 1.0);
    let mut text =
        "format = 1\n[object]\nshape = \"cylinder\"\nradius = 0.05\nmask = \"mask.exr\"\n\
                    [camera]\nimage_size = [8, 4]\nfocal_px = 60\ndistance = 1\n"
            .to_string();
    for (i, name) in ["a.exr", "b.exr", "c.exr", "d.png"].iter().enumerate() {
        text += &format!("[[view]]\norbit_deg = {i}\nfile = \"{name}\"\nexposure_s = 2\n");
    }
    let capture = Capture::parse(&text, Path::new("capture.toml"), folder.path()).unwrap();
    let findings = check(&capture);
    let faults: Vec<String> = findings.faults.iter().map(Error::to_string).collect();
    assert_eq!(faults.len(), 4, "{faults:#?}");
    for (fault, expected) in faults.iter().zip([
        "c.exr, view 2: expected an EXR",
        "b.exr, view 1: expected 8 x 4 pixels",
        "mask.exr: expected 8 x 4 pixels",
        "d.png, view 3: expected the channels Y as in \"a.exr\", found R,G,B",
    ]) {
        assert!(fault.contains(expected), "{fault}");
    }
    let warnings = findings.warnings.join("\n");
    assert!(
        warnings.contains("\"a.exr\": exposure_s is 2, its header says 1"),
        "{warnings}"
    );
    assert!(warnings.contains("a gap of 357.0 degrees"), "{warnings}");
}

/// What is said of `count` photos of 8 x 4 pixels, named `v_1.exr` and on, without those of `absent`.
fn said(camera: &str, count: usize, absent: &[usize], step: f64) -> (String, String) {
    let folder = tempfile::tempdir().unwrap();
    for i in (1..=count).filter(|i| !absent.contains(i)) {
        write(&folder.path().join(format!("v_{i}.exr")), (8, 4), 1.0);
    }
    let text = format!(
        "format = 1\n[object]\nshape = \"cylinder\"\nradius = 0.05\n[camera]\n{camera}\n\
         [views]\nfiles = \"v_*.exr\"\norbit_step_deg = {step}\n"
    );
    let capture = match Capture::parse(&text, Path::new("capture.toml"), folder.path()) {
        Ok(capture) => capture,
        Err(error) => return (error.to_string(), String::new()),
    };
    let findings = check(&capture);
    let faults: Vec<String> = findings.faults.iter().map(Error::to_string).collect();
    (faults.join("\n"), findings.warnings.join("\n"))
}

#[test]
fn swapped_width_and_height_are_said_once() {
    let (faults, _) = said(
        "image_size = [4, 8]\nfocal_px = 40\ndistance = 1",
        8,
        &[],
        45.0,
    );
    assert!(
        faults.contains("all 8 photos have 8 x 4") && faults.contains("image_size = [8, 4]"),
        "{faults}"
    );
    assert!(faults.contains("swapped"), "{faults}");
    assert_eq!(faults.matches("expected").count(), 1, "{faults}");
}

#[test]
fn an_orbit_without_photos_is_one_fault() {
    let (faults, _) = said("focal_px = 40\ndistance = 1", 0, &[], 45.0);
    assert!(
        faults.contains("expected files like \"v_*.exr\", found none"),
        "{faults}"
    );
    assert_eq!(faults.matches("expected").count(), 1, "{faults}");
}

#[test]
fn units_and_focal_lengths_are_doubted() {
    let camera = |focal: f64, distance: f64| format!("focal_px = {focal}\ndistance = {distance}");
    // 2 · 60 px · 0.05 = 6 of 8 pixels.
    let told = |camera: &str| {
        let (faults, warnings) = said(camera, 8, &[], 45.0);
        faults + &warnings
    };
    assert_eq!(told(&camera(60.0, 1.0)), "");
    let wide = told(&camera(150.0, 1.0));
    assert!(
        wide.contains("cut at both sides") && wide.contains("twice the size"),
        "{wide}"
    );
    assert!(told(&camera(60.0, 1000.0)).contains("millimetres"));
    assert!(told(&camera(2.0, 1.0)).contains("focal_px"));
    let (faults, _) = said("focal_px = 60\ndistance = 0.04", 8, &[], 45.0);
    assert!(faults.contains("radius in millimetres"), "{faults}");
}

#[test]
fn missing_photos_of_an_orbit_are_suspected() {
    let camera = "focal_px = 60\ndistance = 1";
    let warned = |count, absent: &[usize], step| said(camera, count, absent, step).1;
    let one = warned(24, &[7], 15.0);
    assert!(
        one.contains("jump from \"v_6.exr\" to \"v_8.exr\"") && one.contains("a photo is missing"),
        "{one}"
    );
    assert!(
        one.contains("23 views 15.0000 degrees apart make 345.00 degrees"),
        "{one}"
    );
    assert!(warned(24, &[7, 8], 15.0).contains("2 photos are missing"));
    // Half an orbit is no mistake, nor is a full one.
    assert!(!warned(12, &[], 15.0).contains("not 360"));
    assert_eq!(warned(24, &[], 15.0), "");
}

#[test]
fn a_sound_set_has_nothing_wrong() {
    let folder = tempfile::tempdir().unwrap();
    for i in 0..8 {
        write(&folder.path().join(format!("{i}.exr")), (8, 4), 1.0);
    }
    let text = "format = 1\n[object]\nshape = \"cylinder\"\nradius = 0.05\n\
                [camera]\nfocal_px = 60\ndistance = 1\n[views]\nfiles = \"*.exr\"\norbit_step_deg = 45\n";
    let capture = Capture::parse(text, Path::new("capture.toml"), folder.path()).unwrap();
    assert_eq!(capture.camera.image_size, [8, 4]);
    let findings = check(&capture);
    assert!(
        findings.faults.is_empty() && findings.warnings.is_empty(),
        "{findings:?}"
    );
}
