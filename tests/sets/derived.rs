//! Photo sets made from a committed one by a change whose effect on the light is known.

use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, FlatSamples, Image, Layer, LayerAttributes, SmallVec, Text, Vec2,
    WritableImage,
};
use tempfile::TempDir;
use toml::{Table, Value};

use super::{capture, image, set};

/// A photo as named planes of 32-bit floats.
pub struct Pixels {
    pub size: [usize; 2],
    pub planes: Vec<(String, Vec<f32>)>,
}

impl Pixels {
    /// The same with the columns (`across`) or rows in reverse.
    pub fn flipped(&mut self, across: bool) {
        let [width, height] = self.size;
        for (_, plane) in &mut self.planes {
            *plane = (0..width * height)
                .map(|at| {
                    let (x, y) = (at % width, at / width);
                    if across {
                        plane[y * width + width - 1 - x]
                    } else {
                        plane[(height - 1 - y) * width + x]
                    }
                })
                .collect();
        }
    }
}

/// Writes a copy of a committed set to a temporary folder, each photo through `pixels` (with the number of its
/// view) and the description, every default written out, through `describe`.
pub fn derive(
    name: &str,
    mut pixels: impl FnMut(usize, &mut Pixels),
    describe: impl FnOnce(&mut Table),
) -> TempDir {
    let original = capture(&set(name));
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::create_dir(folder.path().join("views")).expect("a folder for the photos");
    for (k, view) in original.views.iter().enumerate() {
        let file = &view.photos[0].file;
        let read = image(&original.folder.join(file));
        let mut photo = Pixels {
            size: read.size,
            planes: read.planes.into_iter().collect(),
        };
        pixels(k, &mut photo);
        write(&folder.path().join(file), photo);
    }
    let mut table: Table = original.to_toml().parse().expect("TOML");
    describe(&mut table);
    std::fs::write(folder.path().join("capture.toml"), table.to_string()).expect("writes");
    folder
}

/// Replaces the number under `key` of each view by a function of it.
pub fn each_view(table: &mut Table, key: &str, change: impl Fn(f64) -> f64) {
    for view in table["view"].as_array_mut().expect("views") {
        let value = view[key].as_float().expect("a number");
        view[key] = Value::Float(change(value));
    }
}

fn write(path: &Path, photo: Pixels) {
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = photo
        .planes
        .into_iter()
        .map(|(name, values)| {
            let name = Text::new_or_none(&name).expect("a plain name");
            AnyChannel::new(name, FlatSamples::F32(values))
        })
        .collect();
    let layer = Layer::new(
        Vec2(photo.size[0], photo.size[1]),
        LayerAttributes::default(),
        exr::prelude::Encoding::SMALL_FAST_LOSSLESS,
        AnyChannels::sort(channels),
    );
    Image::from_layer(layer)
        .write()
        .to_file(path)
        .expect("the photo is written");
}
