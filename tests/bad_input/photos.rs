//! Photos: damaged files of every format at every stage, and pixels that are no measurement.

use std::path::PathBuf;

use crate::bench::{Bench, Format, VIEWS};
use crate::{Ask, Case};

/// A damage to a file: its name, what it does, what is said of it.
type Damage = (&'static str, fn(&mut Vec<u8>), &'static str);

const DAMAGES: [Damage; 5] = [
    ("empty", Vec::clear, "found an empty file"),
    ("of one byte", |b| b.truncate(1), "found none of them"),
    ("ending in its header", |b| b.truncate(20), ""),
    ("cut in half", |b| b.truncate(b.len() / 2), ""),
    (
        "of another kind",
        |b| *b = b"%PDF-1.7\n".to_vec(),
        "found none of them",
    ),
];

/// Where a photo is needed: the words for it, and how the file comes there.
const STAGES: [(&str, &str); 4] = [
    ("mask", "radius = 0.05"),
    ("dark", "[[view]]"),
    ("flat", "[[view]]"),
    ("view's mask", "plane_roll_deg = 0.0"),
];

pub(crate) fn cases() -> Vec<Case> {
    let mut cases = damaged_photos();
    cases.extend(damaged_frames());
    cases.extend(mixed());
    cases.extend(pixels());
    cases.extend(hostile());
    cases
}

fn damaged_photos() -> Vec<Case> {
    let mut cases = Vec::new();
    for format in Format::ALL {
        for (name, damage, said) in DAMAGES {
            let file = format!("003.{}", format.ending());
            cases.push(
                Case::new(
                    format!("a {format:?} {name} among sound ones, strictly"),
                    move |b| b.spoil(&b.photo(3), &|bytes| damage(bytes)),
                    &[&file, "view 3", said],
                )
                .of(format)
                .asks(Ask::Strict),
            );
        }
        // What the headers do not show is found by a check too, all of it at once.
        cases.push(
            Case::new(
                format!("two {format:?}s cut in half and a frame, checked"),
                move |b| {
                    for view in [3, 7] {
                        b.spoil(&b.photo(view), &|bytes| bytes.truncate(bytes.len() / 2));
                    }
                    let path = frame(b, "dark", format);
                    b.spoil(&path, &|bytes| bytes.truncate(bytes.len() / 2));
                },
                &["view 3", "view 7", &format!("frame.{}", format.ending())],
            )
            .of(format)
            .asks(Ask::Check)
            .without(&["view 0", "view 4"]),
        );
        cases.push(
            Case::new(
                format!("all {format:?}s cut in half"),
                |b| {
                    for view in 0..VIEWS {
                        b.spoil(&b.photo(view), &|bytes| bytes.truncate(bytes.len() / 2));
                    }
                },
                &["view 0", "view 11", "12 of 12 views"],
            )
            .of(format),
        );
        cases.push(
            Case::new(
                format!("half of the {format:?}s empty"),
                |b| (0..6).for_each(|view| b.spoil(&b.photo(view), &|bytes| bytes.clear())),
                &["view 0", "view 5", "found an empty file", "6 of 12 views"],
            )
            .of(format),
        );
        cases.push(
            Case::new(
                format!("a {format:?} that is a folder"),
                |b| {
                    std::fs::remove_file(b.photo(3)).expect("removes");
                    std::fs::create_dir(b.photo(3)).expect("a folder");
                },
                &["view 3", "to be a file, and it is not"],
            )
            .of(format),
        );
    }
    // Checksums find what changed inside; formats without any are as good as their codes.
    for format in [Format::Png, Format::Jpeg] {
        for ask in [Ask::Strict, Ask::Check] {
            cases.push(
                Case::new(
                    format!("a {format:?} with bytes changed inside, {ask:?}"),
                    |b| {
                        b.spoil(&b.photo(3), &|bytes| {
                            let middle = bytes.len() / 2;
                            bytes[middle..middle + 40].fill(0xff);
                        });
                    },
                    &["view 3", "damaged"],
                )
                .of(format)
                .asks(ask),
            );
        }
    }
    cases.push(
        Case::new(
            "several photos damaged in several ways, checked",
            |b| {
                b.spoil(&b.photo(1), &|bytes| bytes.clear());
                b.spoil(&b.photo(4), &|bytes| bytes.truncate(30));
                b.spoil(&b.photo(7), &|bytes| *bytes = b"text".to_vec());
            },
            &["view 1", "view 4", "view 7"],
        )
        .asks(Ask::Check),
    );
    cases
}

/// Puts a frame beside the photos and names it in the description.
fn frame(bench: &Bench, stage: &str, format: Format) -> PathBuf {
    let name = format!("frame.{}", format.ending());
    let sound = Bench::new(format);
    std::fs::copy(sound.photo(0), bench.at(&name)).expect("copies");
    let (_, place) = STAGES.iter().find(|(s, _)| *s == stage).expect("a stage");
    let text = match stage {
        "mask" => format!("{place}\nmask = \"{name}\""),
        "view's mask" => format!("mask = \"{name}\""),
        other => format!("{other} = \"{name}\"\n{place}"),
    };
    bench.edit("capture.toml", place, &text);
    bench.at(&name)
}

fn damaged_frames() -> Vec<Case> {
    let mut cases = Vec::new();
    for (stage, _) in STAGES {
        for format in Format::ALL {
            let file = format!("frame.{}", format.ending());
            let case = Case::new(
                format!("{stage}: a {format:?} cut in half"),
                move |b| {
                    let path = frame(b, stage, format);
                    b.spoil(&path, &|bytes| bytes.truncate(bytes.len() / 2));
                },
                &[&file],
            );
            // One view's mask spoils one view.
            cases.push(match stage {
                "view's mask" => case.asks(Ask::Strict),
                _ => case,
            });
        }
        cases.push(
            Case::new(
                format!("{stage} of another size"),
                move |b| {
                    let path = frame(b, stage, Format::Png);
                    image::RgbImage::new(20, 10).save(path).expect("writes");
                },
                &["frame.png", "20 x 10", "96 x 16"],
            )
            .asks(match stage {
                "dark" => Ask::Check,
                "view's mask" => Ask::Strict,
                _ => Ask::Run,
            }),
        );
    }
    cases.push(Case::new(
        "mask that hides everything",
        |b| {
            let path = frame(b, "mask", Format::Png);
            image::GrayImage::new(96, 16).save(path).expect("writes");
        },
        &["mask"],
    ));
    cases.push(
        Case::new(
            "flat field that is black",
            |b| {
                let path = frame(b, "flat", Format::Png);
                image::RgbImage::new(96, 16).save(path).expect("writes");
            },
            &["frame.png"],
        )
        .of(Format::Png),
    );
    cases
}

fn mixed() -> Vec<Case> {
    vec![
        Case::new(
            "a photo of another size, strictly",
            |b| image::RgbImage::new(90, 16).save(b.photo(3)).expect("writes"),
            &["view 3", "003.png", "expected 96 x 16 pixels", "90 x 16"],
        )
        .of(Format::Png)
        .asks(Ask::Strict),
        Case::new(
            "a photo lying on its side",
            |b| image::RgbImage::new(16, 96).save(b.photo(3)).expect("writes"),
            &["view 3", "16 x 96", "on its side"],
        )
        .of(Format::Png)
        .asks(Ask::Check),
        Case::new(
            "a grey photo among colour ones, strictly",
            |b| image::GrayImage::new(96, 16).save(b.photo(3)).expect("writes"),
            &["view 3", "003.png", "expected the channels R", "found Y"],
        )
        .of(Format::Png)
        .asks(Ask::Strict),
        Case::new(
            "an 8-bit photo among 16-bit ones, strictly",
            |b| {
                let pixels = image::open(b.photo(3)).expect("reads").into_rgb8();
                pixels.save(b.photo(3)).expect("writes");
            },
            &["view 3", "003.png", "8 bits", "16 bits"],
        )
        .of(Format::Png)
        .asks(Ask::Strict),
        Case::new(
            "a floating-point photo among integers, strictly",
            |b| {
                let pixels = image::open(b.photo(3)).expect("reads").into_rgb32f();
                pixels.save(b.at("views/float.tif")).expect("writes");
                b.edit("capture.toml", "views/003.png", "views/float.tif");
            },
            &["view 3", "float.tif", "16 bits", "floating point"],
        )
        .of(Format::Png)
        .asks(Ask::Strict),
        Case::new(
            "brackets with swapped times",
            |b| {
                // Each view once more at a quarter of the light, and the two times the wrong way round.
                for view in 0..VIEWS {
                    let mut pixels = image::open(b.photo(view)).expect("reads").into_rgb32f();
                    pixels.iter_mut().for_each(|v| *v *= 0.25);
                    pixels.save(b.at(&format!("views/{view:03}_short.tif"))).expect("writes");
                    let long = format!("{{ file = \"views/{view:03}.tif\", exposure_s = 1.0 }},");
                    let both = format!(
                        "{{ file = \"views/{view:03}.tif\", exposure_s = 0.25 }},\n    {{ file = \"views/{view:03}_short.tif\", exposure_s = 1.0 }},"
                    );
                    b.edit("capture.toml", &long, &both);
                }
            },
            &["exposure", "view 0", "swapped"],
        )
        .of(Format::Tiff),
    ]
}

fn pixels() -> Vec<Case> {
    let all = |what, paint: fn(f32, u32, u32, usize) -> f32, words: &[&str]| {
        Case::new(what, move |b| b.repaint_all(&paint), words).of(Format::Tiff)
    };
    let one = |what, paint: fn(f32, u32, u32, usize) -> f32, words: &[&str]| {
        Case::new(what, move |b| b.repaint(3, &paint), words)
            .of(Format::Tiff)
            .asks(Ask::Strict)
    };
    vec![
        all(
            "all photos black",
            |_, _, _, _| 0.0,
            &["view 0", "the photo is black", "exposure", "12 of 12 views"],
        ),
        all(
            "all photos NaN",
            |_, _, _, _| f32::NAN,
            &["no pixel", "finite"],
        ),
        all(
            "all photos infinite",
            |_, _, _, _| f32::INFINITY,
            &["no pixel", "finite"],
        ),
        all(
            "all photos negative",
            |v, _, _, _| -v - 0.001,
            &["negative", "black_level"],
        ),
        all(
            "one channel NaN",
            |v, _, _, c| if c == 1 { f32::NAN } else { v },
            &["channel G", "finite"],
        ),
        all("all photos of one value", |_, _, _, _| 0.5, &["no object"]),
        all(
            "all photos noise",
            |_, x, y, c| {
                let mut h = x.wrapping_mul(0x9e37_79b1)
                    ^ y.wrapping_mul(0x85eb_ca77)
                    ^ (c as u32).wrapping_mul(0xc2b2_ae3d);
                h ^= h >> 15;
                h = h.wrapping_mul(0x2c1b_3c6d);
                h ^= h >> 12;
                (h & 0xffff) as f32 / 65536.0
            },
            &["no object"],
        ),
        all(
            "a gradient and no object",
            |_, x, _, _| 0.1 + x as f32 / 96.0,
            &["no object"],
        ),
        one(
            "one photo black",
            |_, _, _, _| 0.0,
            &["view 3", "003.tif", "black"],
        ),
        one(
            "one photo NaN",
            |_, _, _, _| f32::NAN,
            &["view 3", "003.tif", "no pixel", "finite"],
        ),
        one(
            "one photo infinite",
            |_, _, _, _| f32::INFINITY,
            &["view 3", "003.tif", "finite"],
        ),
        one(
            "one photo negative",
            |v, _, _, _| -v - 0.001,
            &["view 3", "003.tif", "negative"],
        ),
        one(
            "one photo with NaN pixels on the object",
            |v, x, _, _| if (40..60).contains(&x) { f32::NAN } else { v },
            &["003.tif", "NaN"],
        ),
        one(
            "one photo with infinite pixels on the object",
            |v, x, _, _| {
                if (40..60).contains(&x) {
                    f32::INFINITY
                } else {
                    v
                }
            },
            &["003.tif", "infinite"],
        ),
        one(
            "one photo with negative pixels on the object",
            |v, x, _, _| if (40..60).contains(&x) { -1.0 } else { v },
            &["003.tif", "negative"],
        ),
        Case::new(
            "two objects",
            |b| {
                b.edit("capture.toml", "focal_px = 480.0", "focal_px = 240.0");
                for view in 0..VIEWS {
                    let pixels = image::open(b.photo(view)).expect("reads").into_rgb32f();
                    let mut two = pixels.clone();
                    for (x, y, pixel) in two.enumerate_pixels_mut() {
                        *pixel = *pixels.get_pixel(x % 48 * 2, y);
                    }
                    two.save(b.photo(view)).expect("writes");
                }
            },
            &["no object", "is there one object only"],
        )
        .of(Format::Tiff),
        Case::new(
            "object cut by the frame",
            |b| {
                for view in 0..VIEWS {
                    let pixels = image::open(b.photo(view)).expect("reads").into_rgb32f();
                    let mut cut = pixels.clone();
                    for (x, y, pixel) in cut.enumerate_pixels_mut() {
                        *pixel = *pixels.get_pixel(24 + x / 2, y);
                    }
                    cut.save(b.photo(view)).expect("writes");
                }
            },
            &["no object", "limb"],
        )
        .of(Format::Tiff),
    ]
}

/// Small files that declare large pictures.
fn hostile() -> Vec<Case> {
    let png = |b: &Bench| {
        b.spoil(&b.photo(3), &|bytes| {
            // Width and height in IHDR, and its checksum.
            bytes[16..24].copy_from_slice(&[0, 1, 0x86, 0xa0, 0, 1, 0x86, 0xa0]);
            let crc = crc32(&bytes[12..29]);
            bytes[29..33].copy_from_slice(&crc.to_be_bytes());
        });
    };
    let hdr = |b: &Bench| {
        b.write(
            "views/003.hdr",
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 100000\n\x02\x02\x00\x00",
        );
    };
    let jpeg = |b: &Bench| {
        b.spoil(&b.photo(3), &|bytes| {
            let frame = bytes
                .windows(2)
                .position(|w| w == [0xff, 0xc0])
                .expect("a frame");
            bytes[frame + 5..frame + 9].fill(0xff);
        });
    };
    let tiff = |b: &Bench| {
        b.spoil(&b.photo(3), &|bytes| {
            let directory = u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]) as usize;
            let entries = usize::from(u16::from_le_bytes([bytes[directory], bytes[directory + 1]]));
            for k in 0..entries {
                let at = directory + 2 + 12 * k;
                let tag = u16::from_le_bytes([bytes[at], bytes[at + 1]]);
                if [256, 257].contains(&tag) {
                    bytes[at + 2..at + 4].copy_from_slice(&4_u16.to_le_bytes());
                    bytes[at + 8..at + 12].copy_from_slice(&100_000_u32.to_le_bytes());
                }
            }
        });
    };
    let exr = |b: &Bench| {
        b.spoil(&b.photo(3), &|bytes| {
            for name in [b"displayWindow\0box2i\0".as_slice(), b"dataWindow\0box2i\0"] {
                let found = bytes.windows(name.len()).position(|w| w == name);
                let at = found.expect("a window") + name.len() + 4 + 8;
                bytes[at..at + 4].copy_from_slice(&99_999_i32.to_le_bytes());
                bytes[at + 4..at + 8].copy_from_slice(&99_999_i32.to_le_bytes());
            }
        });
    };
    let case = |format: Format, spoil: fn(&Bench)| {
        let file = format!("003.{}", format.ending());
        Case::new(
            format!("a {format:?} that declares a hundred thousand pixels squared"),
            spoil,
            &[&file, "view 3"],
        )
        .of(format)
        .asks(Ask::Strict)
    };
    vec![
        case(Format::Png, png),
        case(Format::Hdr, hdr),
        case(Format::Jpeg, jpeg),
        case(Format::Tiff, tiff),
        case(Format::Exr, exr),
    ]
}

/// CRC-32 as PNG has it.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(crc & 1))
        })
    })
}
