//! Writes a capture set for measurements of speed: `cargo bench --bench set -- FOLDER VIEWS WIDTHxHEIGHT STORE [DISTINCT]`,
//! STORE being float-zip, half-zip, half-zips, half-piz, half-tiles, png, tiff or jpeg; with DISTINCT only so many
//! files are different, and the others are links to them.

mod photographs;

use std::path::Path;

fn main() {
    // Without arguments, as `cargo bench` runs it among the others, there is nothing to write.
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| a != "--bench")
        .collect();
    let [folder, views, size, store, more @ ..] = arguments.as_slice() else {
        return;
    };
    let number = |text: &str| text.parse::<usize>().ok();
    let side = |text: &str| text.parse::<u32>().ok();
    let request = (|| {
        let (width, height) = size.split_once('x')?;
        let views = number(views)?;
        let distinct = match more.first() {
            Some(text) => number(text)?,
            None => views,
        };
        let store = photographs::Store::named(store)?;
        Some((views, distinct, [side(width)?, side(height)?], store))
    })();
    let Some((views, distinct, size, store)) = request else {
        eprintln!("expected FOLDER VIEWS WIDTHxHEIGHT STORE [DISTINCT], found {arguments:?}");
        std::process::exit(2);
    };
    if let Err(e) = photographs::write_set(Path::new(folder), views, distinct, size, store) {
        eprintln!("{e}");
        std::process::exit(1);
    }
}
