//! A bad photo among many is left out, and the others give what they would give without it.

use std::collections::BTreeMap;

use crate::bench::{Bench, Format, VIEWS};

/// Files that hold numbers and nothing of the capture's description.
const NUMBERS: [&str; 4] = [
    "light_field.exr",
    "lighting.csv",
    "lighting_spectrum.csv",
    "lighting.exr",
];

fn products(bench: &Bench) -> BTreeMap<&'static str, Vec<u8>> {
    NUMBERS
        .into_iter()
        .map(|name| (name, std::fs::read(bench.out().join(name)).expect(name)))
        .collect()
}

/// Removes a view from the description.
fn remove(bench: &Bench, view: usize) {
    let text = std::fs::read_to_string(bench.at("capture.toml")).expect("reads");
    let starts: Vec<usize> = text.match_indices("[[view]]").map(|(at, _)| at).collect();
    let end = starts.get(view + 1).copied().unwrap_or(text.len());
    bench.write(
        "capture.toml",
        format!("{}{}", &text[..starts[view]], &text[end..]),
    );
}

type Spoil = fn(&Bench, usize);

const WAYS: [(&str, Spoil); 5] = [
    ("empty", |b, v| b.spoil(&b.photo(v), &|bytes| bytes.clear())),
    ("cut in half", |b, v| {
        b.spoil(&b.photo(v), &|bytes| bytes.truncate(bytes.len() / 2));
    }),
    ("text", |b, v| {
        b.spoil(&b.photo(v), &|bytes| *bytes = b"text".to_vec())
    }),
    ("NaN", |b, v| b.repaint(v, &|_, _, _, _| f32::NAN)),
    ("of another size", |b, v| {
        image::Rgb32FImage::new(20, 16)
            .save(b.photo(v))
            .expect("writes");
    }),
];

/// In first, middle and last place, the first of which decides much: how many rows are averaged, the channels, the size.
#[test]
fn a_bad_photo_is_left_out_and_changes_nothing_else() {
    for view in [0, 4, VIEWS - 1] {
        let without = Bench::new(Format::Tiff);
        remove(&without, view);
        let output = without.run(&[]);
        assert_eq!(output.code, 0, "{}", output.said);
        let expected = products(&without);
        for (name, spoil) in WAYS {
            let bench = Bench::new(Format::Tiff);
            spoil(&bench, view);
            let output = bench.run(&[]);
            assert_eq!(output.code, 0, "view {view} {name}: {}", output.said);
            let file = format!("{view:03}.tif");
            let said = output.said.lines().find(|l| l.contains("was left out"));
            let said = said.unwrap_or_else(|| panic!("view {view} {name}: {}", output.said));
            assert!(
                said.contains(&file) && said.contains(&format!("view {view}")),
                "{said}"
            );
            assert!(
                output.said.contains("11 of 12 views remain")
                    && output.said.contains("60.0° instead of 30.0°"),
                "{}",
                output.said
            );
            for (product, bytes) in products(&bench) {
                assert!(bytes == expected[product], "view {view} {name}: {product}");
            }
            let summary = std::fs::read_to_string(bench.out().join("summary.json"));
            assert!(summary.expect("reads").contains("was left out"));
        }
    }
}

/// Some pixels that are no numbers cost those pixels, and it is said.
#[test]
fn pixels_that_are_no_numbers_are_not_used() {
    let bench = Bench::new(Format::Tiff);
    bench.repaint(3, &|v, x, _, _| {
        if (40..44).contains(&x) { f32::NAN } else { v }
    });
    let output = bench.run(&[]);
    assert_eq!(output.code, 0, "{}", output.said);
    // Four columns of sixteen rows in three channels.
    assert!(
        output
            .said
            .contains("192 values between the object's limbs are NaN"),
        "{}",
        output.said
    );
}
