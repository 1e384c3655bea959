//! A DNG written here, to the letter of its specification, and read back.

use std::ops::Range;
use std::path::Path;

use super::super::{Format, Photo, Storage, info, read};

/// Entries of a TIFF directory: tag, type, count, and their bytes.
type Entry = (u16, u16, u32, Vec<u8>);

fn shorts(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn longs(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A directory at `offset` and the data of its entries behind it.
fn directory(mut entries: Vec<Entry>, offset: usize) -> Vec<u8> {
    entries.sort_by_key(|e| e.0);
    let mut table = shorts(&[entries.len() as u16]);
    let mut data = Vec::new();
    let start = offset + 2 + 12 * entries.len() + 4;
    for (tag, kind, count, mut bytes) in entries {
        table.extend(shorts(&[tag, kind]));
        table.extend(longs(&[count]));
        if bytes.len() <= 4 {
            bytes.resize(4, 0);
            table.extend(bytes);
        } else {
            table.extend(longs(&[(start + data.len()) as u32]));
            bytes.resize(bytes.len().next_multiple_of(2), 0);
            data.extend(bytes);
        }
    }
    table.extend([0; 4]);
    table.extend(data);
    table
}

/// Writes an uncompressed DNG of a Bayer sensor (R G / G B) with black levels 60, 62, 64, 66 and white 4095.
pub(crate) fn write_dng(
    path: &Path,
    size: [usize; 2],
    orientation: u16,
    seconds: (u32, u32),
    code: impl Fn(usize, usize) -> u16,
) {
    let samples = 1;
    let tags = vec![
        (262, 3, 1, shorts(&[32803])),
        (33421, 3, 2, shorts(&[2, 2])),
        (33422, 1, 4, vec![0, 1, 1, 2]),
        (50713, 3, 2, shorts(&[2, 2])),
        (50714, 3, 4, shorts(&[60, 62, 64, 66])),
    ];
    write(
        path,
        size,
        samples,
        orientation,
        seconds,
        tags,
        |x, y, _| code(x, y),
    );
}

/// Writes an uncompressed DNG of so many samples per pixel, white 4095, with the tags that say what they are.
fn write(
    path: &Path,
    [width, height]: [usize; 2],
    samples: usize,
    orientation: u16,
    seconds: (u32, u32),
    tags: Vec<Entry>,
    code: impl Fn(usize, usize, usize) -> u16,
) {
    let pixels: Vec<u8> = (0..width * height * samples)
        .map(|i| (i / samples, i % samples))
        .flat_map(|(i, sample)| code(i % width, i / width, sample).to_le_bytes())
        .collect();
    let exif_at = 8 + pixels.len();
    let exif = directory(
        vec![
            (0x829a, 5, 1, longs(&[seconds.0, seconds.1])),
            (0x829d, 5, 1, longs(&[8, 1])),
            (0x8827, 3, 1, shorts(&[100])),
            (0x920a, 5, 1, longs(&[85, 1])),
        ],
        exif_at,
    );
    let root_at = exif_at + exif.len();
    // Without a colour matrix a DNG says nothing of colours in the world; none are asked for.
    let bits = shorts(&vec![16; samples]);
    let mut root: Vec<Entry> = tags;
    root.extend([
        (254, 4, 1, longs(&[0])),
        (256, 4, 1, longs(&[width as u32])),
        (257, 4, 1, longs(&[height as u32])),
        (258, 3, samples as u32, bits),
        (259, 3, 1, shorts(&[1])),
        (271, 2, 5, b"Test\0".to_vec()),
        (272, 2, 5, b"Test\0".to_vec()),
        (273, 4, 1, longs(&[8])),
        (274, 3, 1, shorts(&[orientation])),
        (277, 3, 1, shorts(&[samples as u16])),
        (278, 4, 1, longs(&[height as u32])),
        (279, 4, 1, longs(&[pixels.len() as u32])),
        (34665, 4, 1, longs(&[exif_at as u32])),
        (50706, 1, 4, vec![1, 4, 0, 0]),
        (50708, 2, 5, b"Test\0".to_vec()),
        (50717, 4, 1, longs(&[4095])),
    ]);
    let root = directory(root, root_at);
    let mut file = b"II*\0".to_vec();
    file.extend(longs(&[root_at as u32]));
    file.extend(pixels);
    file.extend(exif);
    file.extend(root);
    std::fs::write(path, file).unwrap();
}

/// A code that tells its place.
fn code(x: usize, y: usize) -> u16 {
    (200 + 7 * x + 100 * y) as u16
}

/// Every site of the sensor, in these rows, holds `value`(x, y) above its black level in its own colour and nothing in the others.
fn is_mosaic(photo: &Photo, rows: Range<u32>, value: impl Fn(usize, usize) -> f32) {
    assert_eq!(photo.rows, rows);
    let width = photo.size[0] as usize;
    for i in 0..width * rows.len() {
        let (x, y) = (i % width, rows.start as usize + i / width);
        let (colour, black) = [[(0, 60.0), (1, 62.0)], [(1, 64.0), (2, 66.0)]][y % 2][x % 2];
        for (c, plane) in photo.values.iter().enumerate() {
            if c == colour {
                assert_eq!(plane[i], value(x, y) - black, "{x} {y}");
            } else {
                assert!(plane[i].is_nan(), "{x} {y}");
            }
        }
    }
}

#[test]
fn a_dng_gives_the_sensors_values_above_black_at_their_sites() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    write_dng(&path, [32, 20], 1, (1, 50), code);
    let header = info(&path).unwrap();
    assert_eq!(header.format, Format::Raw);
    assert_eq!(
        (header.size, header.channels.join(",")),
        ([32, 20], "R,G,B".into())
    );
    assert_eq!(
        header.storage,
        Storage::Sensor {
            white: 4095 - 66,
            black: 66
        }
    );
    assert_eq!(header.shot.exposure_s, Some(0.02));
    assert_eq!(
        (header.shot.f_number, header.shot.focal_mm),
        (Some(8.0), Some(85.0))
    );
    let photo = read(&path, Some(5..9)).unwrap();
    is_mosaic(&photo, 5..9, |x, y| f32::from(code(x, y)));
}

#[test]
fn a_dng_is_turned_as_its_tag_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    // 6: the file's first row is the picture's right side.
    write_dng(&path, [32, 20], 6, (1, 50), code);
    let photo = read(&path, None).unwrap();
    assert_eq!(photo.size, [20, 32]);
    let (x, y) = (3, 10);
    // The pixel at (x, y) comes from column y, row 19 − x of the file: (10, 16) is a red site.
    assert_eq!(photo.values[0][y * 20 + x], f32::from(code(10, 16)) - 60.0);
}

#[test]
fn filters_and_black_levels_begin_where_the_lit_part_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    // Masked borders: 3 columns left and 1 right, 1 row above and 2 below; columns and rows have black levels of their own.
    let (size, lit) = ([32, 20], [3, 1, 31, 18]);
    let deltas = |n: usize, unit: i32| -> Vec<u8> {
        (0..n as i32)
            .flat_map(|k| [unit * k, 4].map(i32::to_le_bytes).concat())
            .collect()
    };
    let tags = vec![
        (262, 3, 1, shorts(&[32803])),
        (33421, 3, 2, shorts(&[2, 2])),
        (33422, 1, 4, vec![0, 1, 1, 2]),
        (50713, 3, 2, shorts(&[2, 2])),
        (50714, 3, 4, shorts(&[60, 62, 64, 66])),
        (50715, 10, 28, deltas(28, 1)),
        (50716, 10, 17, deltas(17, -2)),
        (50829, 4, 4, longs(&[lit[1], lit[0], lit[3], lit[2]])),
    ];
    write(&path, size, 1, 1, (1, 50), tags, |x, y, _| code(x, y));
    let photo = read(&path, None).unwrap();
    assert_eq!(photo.size, [28, 17]);
    is_mosaic(&photo, 0..17, |x, y| {
        f32::from(code(x + 3, y + 1)) - (0.25 * x as f32 - 0.5 * y as f32)
    });
}

#[test]
fn a_linear_dng_has_all_channels_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    let tags = vec![
        (262, 3, 1, shorts(&[34892])),
        (50714, 3, 3, shorts(&[60, 62, 64])),
    ];
    let value = |x: usize, y: usize, sample: usize| code(x, y) + 11 * sample as u16;
    write(&path, [32, 20], 3, 1, (1, 50), tags, value);
    let photo = read(&path, Some(4..7)).unwrap();
    assert_eq!(photo.channels.join(","), "R,G,B");
    for (i, (x, y)) in (0..3 * 32).map(|i| (i, (i % 32, 4 + i / 32))) {
        for (c, plane) in photo.values.iter().enumerate() {
            let expected = f32::from(value(x, y, c)) - [60.0, 62.0, 64.0][c];
            assert_eq!(plane[i], expected, "{x} {y} {c}");
        }
    }
}

#[test]
fn black_levels_of_another_number_than_said_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    let tags = vec![
        (262, 3, 1, shorts(&[32803])),
        (33421, 3, 2, shorts(&[2, 2])),
        (33422, 1, 4, vec![0, 1, 1, 2]),
        (50713, 3, 2, shorts(&[2, 2])),
        (50714, 3, 3, shorts(&[60, 62, 64])),
    ];
    write(&path, [32, 20], 1, 1, (1, 50), tags, |x, y, _| code(x, y));
    assert!(read(&path, None).is_err());
}

#[test]
fn a_damaged_dng_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    write_dng(&path, [32, 20], 1, (1, 50), code);
    let whole = std::fs::read(&path).unwrap();
    for length in [9, 200, 1000, whole.len() - 150] {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(read(&path, None).is_err(), "{length}");
    }
    let mut hollow = whole.clone();
    // The first directory said to lie beyond the end.
    hollow[4..8].copy_from_slice(&(whole.len() as u32 * 2).to_le_bytes());
    std::fs::write(&path, hollow).unwrap();
    assert!(read(&path, None).is_err());
}

#[test]
fn whatever_is_damaged_is_an_error_or_a_photo() {
    use rand::{RngExt, SeedableRng};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    write_dng(&path, [32, 20], 1, (1, 50), code);
    let whole = std::fs::read(&path).unwrap();
    let pixels = 2 * 32 * 20;
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    for _ in 0..3000 {
        let mut bytes = whole.clone();
        // The directories are behind the pixels; they say all that a decoder believes.
        for _ in 0..random.random_range(1..4) {
            let at = 8 + pixels + random.random_range(0..bytes.len() - 8 - pixels);
            bytes[at] = random.random();
        }
        if random.random_range(0..4) == 0 {
            bytes.truncate(random.random_range(8..bytes.len()));
        }
        std::fs::write(&path, &bytes).unwrap();
        if let Ok(photo) = read(&path, None) {
            let [width, height] = photo.size.map(|n| n as usize);
            assert!(photo.values.iter().all(|v| v.len() == width * height));
        }
    }
}
