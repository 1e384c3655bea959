//! What the fuzz targets do with their bytes. `tests/fuzz_seeds.rs` does the same with the seeds in `fuzz/seeds/`, by the
//! stable compiler and without a fuzzer.
//!
//! A body must end without a panic for any bytes, and what it accepts must be sound: sizes agree, numbers are
//! finite, and what is written reads back.

use std::path::{Path, PathBuf};

use flatlight::brdf::SliceTable;
use flatlight::capture::Capture;
use flatlight::compare::Product;
use flatlight::error::Error;
use flatlight::lighting::environment::Environment;
use flatlight::lighting::{read_spectrum, read_table, write_spectrum};
use flatlight::pipeline::Recipe;
use flatlight::radiance::Response;
use flatlight::simulate;
use flatlight::validate::study::StudyRecipe;
use flatlight::{capture, photo};

/// A body: bytes, and a folder that it may use.
pub type Body = fn(&[u8], &Path);

/// All of them by name; seeds are in the folder of that name.
pub const ALL: [(&str, Body); 14] = [
    ("capture_toml", capture_toml),
    ("recipe_toml", recipe_toml),
    ("simulate_toml", simulate_toml),
    ("validate_toml", validate_toml),
    ("lighting_csv", lighting_csv),
    ("brdf_csv", brdf_csv),
    ("response_csv", response_csv),
    ("product_csv", product_csv),
    ("environment", environment),
    ("photo_exr", photo_exr),
    ("photo_png", photo_png),
    ("photo_jpeg", photo_jpeg),
    ("photo_tiff", photo_tiff),
    ("photo_hdr", photo_hdr),
];

/// Messages are for people: not empty, and no longer than they can be read.
fn readable(error: &Error) {
    let message = error.to_string();
    assert!(!message.trim().is_empty());
    assert!(
        !message.contains(|c: char| c.is_control() && c != '\n'),
        "control characters in {message:?}"
    );
    assert!(message.len() < 1 << 20, "{} bytes", message.len());
}

fn text(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes).ok()
}

fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("the scratch folder can be written");
    path
}

/// `capture.toml`; the folder holds the photo `a.png`, so that views can be read.
pub fn capture_toml(bytes: &[u8], folder: &Path) {
    let Some(text) = text(bytes) else { return };
    let file = Path::new("capture.toml");
    match Capture::parse(text, file, folder) {
        Err(error) => readable(&error),
        Ok(parsed) => {
            let resolved = parsed.to_toml();
            let again = Capture::parse(&resolved, file, folder)
                .unwrap_or_else(|e| panic!("what was resolved is not read: {e}\n{resolved}"));
            assert_eq!(again.to_toml(), resolved);
            let findings = capture::check(&parsed);
            findings.faults.iter().for_each(readable);
        }
    }
}

/// A recipe of `run`.
pub fn recipe_toml(bytes: &[u8], folder: &Path) {
    let Some(text) = text(bytes) else { return };
    let file = Path::new("recipe.toml");
    match Recipe::parse(text, file, folder) {
        Err(error) => readable(&error),
        Ok(parsed) => {
            let resolved = parsed.to_toml();
            let again = Recipe::parse(&resolved, file, folder)
                .unwrap_or_else(|e| panic!("what was resolved is not read: {e}\n{resolved}"));
            assert_eq!(again.to_toml(), resolved);
        }
    }
}

/// A recipe of `simulate`.
pub fn simulate_toml(bytes: &[u8], folder: &Path) {
    let Some(text) = text(bytes) else { return };
    match simulate::Recipe::parse(text, Path::new("simulate.toml"), folder) {
        Err(error) => readable(&error),
        Ok(recipe) => {
            if let Err(error) = simulate::plan(&recipe) {
                readable(&error);
            }
        }
    }
}

/// A recipe of `validate`.
pub fn validate_toml(bytes: &[u8], _: &Path) {
    let Some(text) = text(bytes) else { return };
    match StudyRecipe::parse(text) {
        Err(error) => readable(&error),
        Ok(recipe) => {
            recipe.plan(false);
        }
    }
}

/// `lighting.csv`.
pub fn lighting_csv(bytes: &[u8], folder: &Path) {
    match read_table(&put(folder, "lighting.csv", bytes)) {
        Err(error) => readable(&error),
        Ok(table) => {
            let n = table.angles.len();
            assert!(n > 0 && table.values.iter().all(|v| v.len() == n));
            assert!(table.sigma.iter().all(|s| s.len() == n));
            assert!(table.values.iter().flatten().all(|v| v.is_finite()));
        }
    }
}

/// `brdf.csv`.
pub fn brdf_csv(bytes: &[u8], _: &Path) {
    let Some(text) = text(bytes) else { return };
    match SliceTable::parse(text) {
        Err(error) => readable(&error),
        Ok(table) => {
            let again = SliceTable::parse(&table.to_csv())
                .unwrap_or_else(|e| panic!("what was written is not read: {e}"));
            assert_eq!(
                (again.incident, again.exitant),
                (table.incident, table.exitant)
            );
            for (a, b) in again.rho.iter().flatten().zip(table.rho.iter().flatten()) {
                assert!(a == b || (a.is_nan() && b.is_nan()), "{a} {b}");
            }
            for name in &table.channels {
                if let Err(error) = table.slice(name) {
                    readable(&error);
                }
            }
        }
    }
}

/// A response curve.
pub fn response_csv(bytes: &[u8], folder: &Path) {
    put(folder, "response.csv", bytes);
    let encoding = capture::Encoding::Response("response.csv".into());
    match Response::of(&encoding, folder) {
        Err(error) => readable(&error),
        Ok(response) => {
            let storage = photo::Storage::Integer { max: 255 };
            for code in [0.0, 128.0, 255.0] {
                response.decode(code, 0, storage);
                response.decode(code, 7, storage);
            }
        }
    }
}

/// The products that `compare` reads.
pub fn product_csv(bytes: &[u8], folder: &Path) {
    let path = put(folder, "product", bytes);
    match Product::read(&path) {
        Err(error) => readable(&error),
        Ok(product) => {
            for point in product.points.iter().take(100) {
                for channel in 0..product.channels.len() {
                    product.at(channel, *point);
                }
            }
        }
    }
    if let Ok(rows) = read_spectrum(&path) {
        let copy = folder.join("spectrum.csv");
        write_spectrum(&copy, &rows).expect("the scratch folder can be written");
        let again = read_spectrum(&copy).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(again.len(), rows.len());
    }
}

/// An environment map.
pub fn environment(bytes: &[u8], folder: &Path) {
    match Environment::read(&put(folder, "sky", bytes)) {
        Err(error) => readable(&error),
        Ok(map) => {
            let pixels = map.width * map.height;
            assert!(pixels > 0 && map.channels.len() == map.values.len());
            assert!(map.values.iter().all(|v| v.len() == pixels));
            assert!(map.values.iter().flatten().all(|v| v.is_finite()));
        }
    }
}

/// A photo that begins as its format does, whatever the fuzzer made of its first bytes: header, all rows, some rows.
fn photo(bytes: &[u8], magic: &[u8], folder: &Path) {
    let mut bytes = bytes.to_vec();
    for (byte, wanted) in bytes.iter_mut().zip(magic) {
        *byte = *wanted;
    }
    let path = put(folder, "photo", &bytes);
    let info = photo::info(&path);
    let photo = photo::read(&path, None);
    match (&info, &photo) {
        (_, Ok(photo)) => {
            let pixels = photo.size[0] as usize * photo.size[1] as usize;
            assert_eq!(photo.rows, 0..photo.size[1]);
            assert_eq!(photo.values.len(), photo.channels.len());
            assert!(photo.values.iter().all(|plane| plane.len() == pixels));
            let info = info.as_ref().unwrap_or_else(|e| panic!("{e}"));
            assert_eq!((info.size, &info.channels), (photo.size, &photo.channels));
            let rows = photo.size[1] / 3..photo.size[1].div_ceil(2);
            if !rows.is_empty() && pixels < 1 << 20 {
                let part = photo::read(&path, Some(rows.clone()));
                let part = part.unwrap_or_else(|e| panic!("rows {rows:?}: {e}"));
                let width = photo.size[0] as usize;
                let span = rows.start as usize * width..rows.end as usize * width;
                for (all, some) in photo.values.iter().zip(&part.values) {
                    let same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits();
                    assert!(
                        all[span.clone()].iter().zip(some).all(same),
                        "rows {rows:?}"
                    );
                }
            }
        }
        (info, Err(error)) => {
            readable(error);
            if let Err(error) = info {
                readable(error);
            }
        }
    }
}

/// OpenEXR.
pub fn photo_exr(bytes: &[u8], folder: &Path) {
    photo(bytes, &[0x76, 0x2f, 0x31, 0x01], folder);
}

/// PNG.
pub fn photo_png(bytes: &[u8], folder: &Path) {
    photo(bytes, b"\x89PNG\r\n\x1a\n", folder);
}

/// JPEG.
pub fn photo_jpeg(bytes: &[u8], folder: &Path) {
    photo(bytes, &[0xff, 0xd8, 0xff], folder);
}

/// TIFF, of either order of bytes.
pub fn photo_tiff(bytes: &[u8], folder: &Path) {
    photo(
        bytes,
        if bytes.first() == Some(&b'M') {
            b"MM\0*"
        } else {
            b"II*\0"
        },
        folder,
    );
}

/// Radiance HDR.
pub fn photo_hdr(bytes: &[u8], folder: &Path) {
    photo(bytes, b"#?", folder);
}
