//! Files of every format, written by other encoders, and read back: values, rows, headers, damage.

use std::path::{Path, PathBuf};

use super::*;

const WIDTH: u32 = 37;
const HEIGHT: u32 = 29;

/// A pattern that differs by channel, column and row, up to 65535.
fn code(c: usize, x: u32, y: u32) -> u16 {
    ((c as u32 * 20011 + x * 1021 + y * 313) % 65536) as u16
}

fn interleaved(samples: usize) -> Vec<u16> {
    (0..HEIGHT)
        .flat_map(|y| (0..WIDTH).map(move |x| (x, y)))
        .flat_map(|(x, y)| (0..samples).map(move |c| code(c, x, y)))
        .collect()
}

fn check(path: &Path, channels: &[&str], storage: Storage, value: impl Fn(u16) -> f32) {
    for rows in [0..HEIGHT, 5..6, 11..23, HEIGHT - 1..HEIGHT] {
        let photo = read(path, Some(rows.clone())).unwrap();
        assert_eq!(photo.size, [WIDTH, HEIGHT]);
        assert_eq!(photo.channels, channels);
        assert_eq!(photo.storage, storage);
        for (c, plane) in photo.values.iter().enumerate() {
            let expected: Vec<f32> = rows
                .clone()
                .flat_map(|y| (0..WIDTH).map(move |x| (x, y)))
                .map(|(x, y)| value(code(c, x, y)))
                .collect();
            assert_eq!(*plane, expected, "channel {c}, rows {rows:?}");
        }
    }
    let info = info(path).unwrap();
    assert_eq!((info.size, info.storage), ([WIDTH, HEIGHT], storage));
    assert_eq!(info.channels, channels);
}

/// Every shortened file is an error, and so is what follows bits that flip, or else pixels come out.
fn check_damage(path: &Path, needs_all: bool) {
    let whole = std::fs::read(path).unwrap();
    let step = (whole.len() / 40).max(1);
    for length in (0..whole.len()).step_by(step) {
        std::fs::write(path, &whole[..length]).unwrap();
        let result = read(path, None);
        assert!(
            !needs_all || result.is_err(),
            "{} cut to {length} bytes",
            path.display()
        );
    }
    for place in (0..whole.len()).step_by(step) {
        let mut damaged = whole.clone();
        damaged[place] ^= 0x91;
        std::fs::write(path, &damaged).unwrap();
        if let Ok(photo) = read(path, None) {
            let pixels = photo.size[0] as usize * photo.size[1] as usize;
            assert!(photo.values.iter().all(|plane| plane.len() == pixels));
        }
    }
}

fn write_png(path: &Path, colour: ::png::ColorType, wide: bool, exif: Option<Vec<u8>>) {
    let file = std::fs::File::create(path).unwrap();
    let mut info = ::png::Info::with_size(WIDTH, HEIGHT);
    info.color_type = colour;
    info.bit_depth = if wide {
        ::png::BitDepth::Sixteen
    } else {
        ::png::BitDepth::Eight
    };
    info.exif_metadata = exif.map(Into::into);
    let mut writer = ::png::Encoder::with_info(file, info)
        .unwrap()
        .write_header()
        .unwrap();
    let samples = interleaved(colour.samples());
    let bytes: Vec<u8> = if wide {
        samples.iter().flat_map(|v| v.to_be_bytes()).collect()
    } else {
        samples.iter().map(|v| (v >> 8) as u8).collect()
    };
    writer.write_image_data(&bytes).unwrap();
    writer.finish().unwrap();
}

fn file(folder: &tempfile::TempDir, name: &str) -> PathBuf {
    folder.path().join(name)
}

#[test]
fn png_of_8_and_16_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(&folder, "a.png");
    let rgb = ["R", "G", "B"];
    for (colour, channels) in [
        (::png::ColorType::Grayscale, &["Y"][..]),
        (::png::ColorType::GrayscaleAlpha, &["Y"]),
        (::png::ColorType::Rgb, &rgb),
        (::png::ColorType::Rgba, &rgb),
    ] {
        write_png(&path, colour, true, None);
        check(&path, channels, Storage::Integer { max: 65535 }, f32::from);
        write_png(&path, colour, false, None);
        check(&path, channels, Storage::Integer { max: 255 }, |v| {
            f32::from(v >> 8)
        });
    }
    check_damage(&path, false);
}

#[test]
fn tiff_of_every_storage() {
    use ::tiff::encoder::{TiffEncoder, colortype};
    let folder = tempfile::tempdir().unwrap();
    let path = file(&folder, "a.tif");
    macro_rules! write {
        ($colour:ty, $samples:expr, $convert:expr) => {{
            let mut encoder = TiffEncoder::new(std::fs::File::create(&path).unwrap()).unwrap();
            let mut image = encoder.new_image::<$colour>(WIDTH, HEIGHT).unwrap();
            image.rows_per_strip(4).unwrap();
            let data: Vec<_> = interleaved($samples).into_iter().map($convert).collect();
            image.write_data(&data).unwrap();
        }};
    }
    let rgb = ["R", "G", "B"];
    write!(colortype::RGB8, 3, |v| (v >> 8) as u8);
    check(&path, &rgb, Storage::Integer { max: 255 }, |v| {
        f32::from(v >> 8)
    });
    write!(colortype::RGBA16, 4, |v| v);
    check(&path, &rgb, Storage::Integer { max: 65535 }, f32::from);
    write!(colortype::Gray16, 1, |v| v);
    check(&path, &["Y"], Storage::Integer { max: 65535 }, f32::from);
    write!(colortype::RGB32Float, 3, |v| f32::from(v) / 7.0);
    check(&path, &rgb, Storage::Float, |v| f32::from(v) / 7.0);
    check_damage(&path, false);
}

/// The beginning of a little-endian TIFF file of one image, after TIFF 6.0 section 2: entries of tag, type, count, and value or place.
fn tiff_header(entries: &[(u16, u16, u32, u32)]) -> Vec<u8> {
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    bytes.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in entries {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([0; 4]);
    bytes
}

#[test]
fn tiff_of_half_floats_in_tiles() {
    // The encoder writes neither, so the file is put together by hand: little-endian, 16 × 16
    // tiles, one grey half float a pixel, after TIFF 6.0 section 15.
    let folder = tempfile::tempdir().unwrap();
    let path = file(&folder, "a.tif");
    let (across, down) = (WIDTH.div_ceil(16), HEIGHT.div_ceil(16));
    let half = |v: u16| ::exr::prelude::f16::from_f32(f32::from(v >> 6));
    let count = (across * down) as usize;
    let arrays = 8 + 2 + 12 * 11 + 4;
    let data = arrays + 8 * count;
    let mut bytes = tiff_header(&[
        (256, 4, 1, WIDTH),
        (257, 4, 1, HEIGHT),
        (258, 3, 1, 16),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (277, 3, 1, 1),
        (322, 4, 1, 16),
        (323, 4, 1, 16),
        (324, 4, count as u32, arrays as u32),
        (325, 4, count as u32, (arrays + 4 * count) as u32),
        (339, 3, 1, 3),
    ]);
    (0..count).for_each(|i| bytes.extend(((data + 512 * i) as u32).to_le_bytes()));
    (0..count).for_each(|_| bytes.extend(512_u32.to_le_bytes()));
    for tile in 0..across * down {
        for y in 0..16 {
            for x in 0..16 {
                let (x, y) = (tile % across * 16 + x, tile / across * 16 + y);
                let value = if x < WIDTH && y < HEIGHT {
                    code(0, x, y)
                } else {
                    0xffff
                };
                bytes.extend(half(value).to_le_bytes());
            }
        }
    }
    std::fs::write(&path, bytes).unwrap();
    check(&path, &["Y"], Storage::Half, |v| half(v).to_f32());
}

#[test]
fn jpeg_is_close_to_its_original_and_never_truncated() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(&folder, "a.jpg");
    // A smooth picture survives quality 100 to within a few codes.
    let pixel = |x: u32, y: u32| [(40 + 3 * x) as u8, (200 - 4 * y) as u8, (x + y) as u8];
    let image = image::RgbImage::from_fn(WIDTH, HEIGHT, |x, y| image::Rgb(pixel(x, y)));
    let mut out = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut out, 100);
    image.write_with_encoder(encoder).unwrap();
    std::fs::write(&path, &out).unwrap();
    let photo = read(&path, Some(3..20)).unwrap();
    assert_eq!((photo.size, photo.channels.len()), ([WIDTH, HEIGHT], 3));
    for (i, y) in (3..20).enumerate() {
        for x in 0..WIDTH {
            for (c, plane) in photo.values.iter().enumerate() {
                let got = plane[i * WIDTH as usize + x as usize];
                assert!(
                    (got - f32::from(pixel(x, y)[c])).abs() <= 6.0,
                    "{x} {y} {c} {got}"
                );
            }
        }
    }
    assert_eq!(info(&path).unwrap().size, [WIDTH, HEIGHT]);
    check_damage(&path, false);
    for length in [out.len() / 3, out.len() / 2, out.len() - 40] {
        std::fs::write(&path, &out[..length]).unwrap();
        assert!(
            read(&path, None).is_err(),
            "cut to {length} of {} bytes",
            out.len()
        );
    }
}

#[test]
fn hdr_undoes_its_exposure_in_every_order_and_code() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(&folder, "a.hdr");
    let rgbe = |x: u32, y: u32| [(128 + x) as u8, y as u8, 7, (120 + y % 9) as u8];
    let expected = |x: u32, y: u32, c: usize| {
        let [r, g, b, e] = rgbe(x, y);
        // Pixels were multiplied by 4, and blue by 2 more: the file says so, and it is undone.
        let scale = [0.25, 0.25, 0.125][c];
        (f32::from([r, g, b][c]) + 0.5) * (f32::from(e) - 136.0).exp2() * scale
    };
    for (order, coded) in [
        ("-Y 29 +X 37", true),
        ("-Y 29 +X 37", false),
        ("+Y 29 -X 37", true),
        ("+X 37 -Y 29", true),
    ] {
        let mut bytes =
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nEXPOSURE=2.0\nCOLORCORR=1 1 2\n\n"
                .to_vec();
        bytes.extend(order.as_bytes());
        bytes.push(b'\n');
        let turned = order.starts_with("+X");
        let (lines, length) = if turned {
            (WIDTH, HEIGHT)
        } else {
            (HEIGHT, WIDTH)
        };
        for line in 0..lines {
            let pixels: Vec<[u8; 4]> = (0..length)
                .map(|i| match order {
                    "+Y 29 -X 37" => rgbe(WIDTH - 1 - i, HEIGHT - 1 - line),
                    "+X 37 -Y 29" => rgbe(line, i),
                    _ => rgbe(i, line),
                })
                .collect();
            if !coded {
                pixels.iter().for_each(|p| bytes.extend(p));
                continue;
            }
            bytes.extend([2, 2, 0, length as u8]);
            for c in 0..4 {
                // Runs where there are any, and literals.
                let mut rest: &[[u8; 4]] = &pixels;
                while let Some(first) = rest.first() {
                    let run = rest
                        .iter()
                        .take(127)
                        .take_while(|p| p[c] == first[c])
                        .count();
                    if run > 2 {
                        bytes.extend([128 + run as u8, first[c]]);
                        rest = &rest[run..];
                    } else {
                        bytes.extend([1, first[c]]);
                        rest = &rest[1..];
                    }
                }
            }
        }
        std::fs::write(&path, &bytes).unwrap();
        let photo = read(&path, Some(4..9)).unwrap();
        assert_eq!(
            (photo.size, photo.storage),
            ([WIDTH, HEIGHT], Storage::SharedExponent)
        );
        for y in 4..9 {
            for x in 0..WIDTH {
                for c in 0..3 {
                    let got = photo.values[c][((y - 4) * WIDTH + x) as usize];
                    // One rounding to f32.
                    assert!(
                        (got / expected(x, y, c) - 1.0).abs() < 1e-6,
                        "{order} {x} {y} {c}"
                    );
                }
            }
        }
    }
    check_damage(&path, true);
}

#[test]
fn exif_is_read_and_turns_the_picture() {
    use ::exif::{Field, In, Rational, Tag, Value, experimental::Writer};
    let field = |tag, value| Field {
        tag,
        ifd_num: In::PRIMARY,
        value,
    };
    let rational = |num, denom| Value::Rational(vec![Rational { num, denom }]);
    let fields = [
        field(Tag::Orientation, Value::Short(vec![6])),
        field(Tag::ExposureTime, rational(1, 60)),
        field(Tag::FNumber, rational(80, 10)),
        field(Tag::PhotographicSensitivity, Value::Short(vec![200])),
        field(Tag::FocalLength, rational(85, 1)),
        field(
            Tag::DateTimeOriginal,
            Value::Ascii(vec![b"2024:05:06 07:08:09".to_vec()]),
        ),
    ];
    let mut writer = Writer::new();
    fields.iter().for_each(|f| writer.push_field(f));
    let mut block = std::io::Cursor::new(Vec::new());
    writer.write(&mut block, false).unwrap();

    let folder = tempfile::tempdir().unwrap();
    let path = file(&folder, "a.png");
    write_png(
        &path,
        ::png::ColorType::Grayscale,
        true,
        Some(block.into_inner()),
    );
    let info = info(&path).unwrap();
    assert_eq!(info.size, [HEIGHT, WIDTH]);
    let expected = Shot {
        exposure_s: Some(1.0 / 60.0),
        f_number: Some(8.0),
        iso: Some(200.0),
        focal_mm: Some(85.0),
        focal_35mm: None,
        taken: Some("2024:05:06 07:08:09".into()),
    };
    assert_eq!(info.shot, expected);
    // Orientation 6: the file's first row is the picture's right edge.
    let photo = read(&path, Some(2..4)).unwrap();
    assert_eq!(
        photo.values[0][HEIGHT as usize - 1],
        f32::from(code(0, 2, 0))
    );
    assert_eq!(
        photo.values[0][HEIGHT as usize],
        f32::from(code(0, 3, HEIGHT - 1))
    );
}

#[test]
fn a_tiff_that_declares_more_than_it_holds_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(&folder, "a.tif");
    for (width, height, expected) in [
        (u32::MAX, u32::MAX, "pixels a side"),
        (1 << 20, 1 << 20, "bytes can hold"),
    ] {
        let mut bytes = tiff_header(&[
            (256, 4, 1, width),
            (257, 4, 1, height),
            (258, 3, 1, 8),
            (259, 3, 1, 1),
            (262, 3, 1, 1),
            (273, 4, 1, 8),
            (277, 3, 1, 1),
            (278, 4, 1, height),
            (279, 4, 1, 100),
        ]);
        bytes.resize(400, 0);
        std::fs::write(&path, bytes).unwrap();
        let error = read(&path, None).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn what_is_no_photo_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(&folder, "a.png");
    let message = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        read(&path, None).unwrap_err().to_string()
    };
    assert!(message(b"").contains("found an empty file"));
    assert!(message(b"GIF89a").contains("expected an EXR, PNG, TIFF, JPEG, HDR or RAW"));
    assert!(
        read(folder.path(), None)
            .unwrap_err()
            .to_string()
            .contains("not a file")
    );
    write_png(&path, ::png::ColorType::Grayscale, true, None);
    let error = read(&path, Some(20..30)).unwrap_err().to_string();
    assert!(
        error.contains("expected rows 20 to 30, found an image of 37 x 29"),
        "{error}"
    );
}

#[test]
fn numbers_in_names_count() {
    let mut names = ["v_10.exr", "v_2.exr", "v_1b.exr", "v_1.exr", "u.exr"];
    names.sort_by(|a, b| natural_order(a, b));
    assert_eq!(
        names,
        ["u.exr", "v_1.exr", "v_1b.exr", "v_2.exr", "v_10.exr"]
    );
}
