//! EXR files of float planes in runs: pictures that are mostly empty or mostly alike, in a few milliseconds.
//!
//! A line's bytes are laid out as in a ZIP block ([`zip_block`](super::zip_block)), and instead of being deflated are written as
//! runs (OpenEXR's `ImfRle`). A line that is like the one before is not packed again.

use std::io::Cursor;

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter;
use exr::error::{Error, Result};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes,
    IntegerBounds, Layer, LayerAttributes, LineOrder, SmallVec, Text, Vec2, WritableImage,
};
use rayon::prelude::*;

/// A picture of float planes.
pub(crate) struct Picture<'a> {
    /// Width and height.
    pub size: [usize; 2],
    /// Its header's attributes.
    pub attributes: LayerAttributes,
    /// Names and values.
    pub planes: Vec<(Text, Plane<'a>)>,
}

/// The values of a plane.
#[derive(Clone, Copy)]
pub(crate) enum Plane<'a> {
    /// Row by row.
    Whole(&'a [f32]),
    /// The values of one row, and those of all others.
    OneRow(usize, &'a [f32], &'a [f32]),
}

impl<'a> Plane<'a> {
    fn row(self, y: usize, width: usize) -> &'a [f32] {
        match self {
            Self::Whole(values) => &values[y * width..(y + 1) * width],
            Self::OneRow(row, values, others) => match y == row {
                true => values,
                false => others,
            },
        }
    }

    fn fits(self, [width, height]: [usize; 2]) -> bool {
        match self {
            Self::Whole(values) => values.len() == width * height,
            Self::OneRow(row, values, others) => {
                row < height && values.len() == width && others.len() == width
            }
        }
    }
}

/// How the bytes are laid out.
const ENCODING: Encoding = Encoding {
    compression: Compression::RLE,
    blocks: Blocks::ScanLines,
    line_order: LineOrder::Increasing,
};

/// Shortest and longest run, and longest stretch without one.
const SHORTEST: usize = 3;
const LONGEST: usize = 128;
const STRETCH: usize = 127;
/// Bytes that are looked at together.
const TOGETHER: usize = 32;

/// Lines that one task packs.
const LINES: usize = 60;

/// The bytes of an EXR file with these pictures.
///
/// # Errors
/// If a plane does not have its picture's size, or the exr crate refuses the header.
pub(crate) fn encode(mut pictures: Vec<Picture<'_>>) -> Result<Vec<u8>> {
    let mut bounds = Vec2(1, 1);
    for picture in &mut pictures {
        let [width, height] = picture.size;
        bounds = Vec2(bounds.0.max(width), bounds.1.max(height));
        if !picture.planes.iter().all(|(_, p)| p.fits(picture.size)) {
            return Err(Error::Invalid("plane".into()));
        }
        // As the file has them.
        picture.planes.sort_by(|(a, _), (b, _)| a.cmp(b));
    }
    // For their headers; the values are not asked for.
    let layers: Layers = pictures
        .iter()
        .map(|picture| {
            let names = picture.planes.iter().map(|(name, _)| name.clone());
            let channels = names.map(|name| AnyChannel::new(name, FlatSamples::F32(Vec::new())));
            Layer::new(
                Vec2(picture.size[0], picture.size[1]),
                picture.attributes.clone(),
                ENCODING,
                AnyChannels::sort(channels.collect()),
            )
        })
        .collect();
    let image = Image::from_layers(
        ImageAttributes::new(IntegerBounds::from_dimensions(bounds)),
        layers,
    );
    let headers = image.write().infer_meta_data();
    let mut bytes = Cursor::new(Vec::new());
    exr::block::write(&mut bytes, headers, true, |_, writer| {
        for (index, picture) in pictures.iter().enumerate() {
            for (y, packed) in picture.packed().into_iter().enumerate() {
                let block = CompressedScanLineBlock {
                    y_coordinate: i32::try_from(y).map_err(|_| Error::Invalid("height".into()))?,
                    compressed_pixels_le: packed,
                };
                let chunk = Chunk {
                    layer_index: index,
                    compressed_block: CompressedBlock::ScanLine(block),
                };
                writer.write_chunk(y, chunk)?;
            }
        }
        Ok(())
    })?;
    Ok(bytes.into_inner())
}

impl Picture<'_> {
    /// The packed bytes of each line.
    fn packed(&self) -> Vec<Vec<u8>> {
        let [width, height] = self.size;
        let same = |y: usize| {
            self.planes.iter().all(|(_, plane)| {
                // Without a branch in it, so that many are compared at once.
                let both = plane.row(y - 1, width).iter().zip(plane.row(y, width));
                both.fold(true, |same, (a, b)| same & (a.to_bits() == b.to_bits()))
            })
        };
        let some: Vec<Vec<Vec<u8>>> = (0..height.div_ceil(LINES))
            .into_par_iter()
            .map(|part| {
                let first = part * LINES;
                let mut line = Line::default();
                (first..(first + LINES).min(height))
                    .map(|y| {
                        if y == first || !same(y) {
                            line.pack(self.planes.iter().map(|(_, plane)| plane.row(y, width)));
                        }
                        line.packed.clone()
                    })
                    .collect()
            })
            .collect();
        some.into_iter().flatten().collect()
    }
}

/// Layers as the exr crate's headers are made of.
type Layers = SmallVec<[Layer<AnyChannels<FlatSamples>>; 2]>;

/// A line as it is packed.
#[derive(Default)]
struct Line {
    bytes: Vec<u8>,
    differences: Vec<u8>,
    packed: Vec<u8>,
}

impl Line {
    fn pack<'a>(&mut self, planes: impl Iterator<Item = &'a [f32]> + Clone) {
        let half = 2 * planes.clone().map(<[f32]>::len).sum::<usize>();
        self.bytes.resize(2 * half, 0);
        let (mut even, mut odd) = self.bytes.split_at_mut(half);
        for plane in planes.clone() {
            let (pairs, rest) = even.split_at_mut(2 * plane.len());
            let (odd_pairs, odd_rest) = odd.split_at_mut(2 * plane.len());
            let both = pairs.as_chunks_mut::<2>().0.iter_mut();
            for ((even, odd), value) in both.zip(odd_pairs.as_chunks_mut::<2>().0).zip(plane) {
                let [a, b, c, d] = value.to_le_bytes();
                (*even, *odd) = ([a, c], [b, d]);
            }
            (even, odd) = (rest, odd_rest);
        }
        self.differences.clear();
        self.differences.extend(self.bytes.first());
        let pairs = self.bytes.iter().zip(self.bytes.get(1..).unwrap_or(&[]));
        self.differences
            .extend(pairs.map(|(before, byte)| byte.wrapping_sub(*before).wrapping_add(128)));
        self.packed.clear();
        runs(&self.differences, &mut self.packed);
        if self.packed.len() >= self.bytes.len() {
            // What packing does not make smaller is stored as it is.
            self.packed.clear();
            let values = planes.flatten();
            self.packed.extend(values.flat_map(|v| v.to_le_bytes()));
        }
    }
}

/// Packs bytes: a count less 1 and a byte that comes so many times, or a negative count and so many bytes.
fn runs(bytes: &[u8], packed: &mut Vec<u8>) {
    // Where a run begins from `at` on, and how long it is.
    let next = |mut at: usize| {
        // Without a branch for each, so that many are compared at once.
        while let Some(some) = bytes.get(at..at + TOGETHER + SHORTEST - 1) {
            let alike = |k: usize| (some[k] == some[k + 1]) & (some[k + 1] == some[k + 2]);
            if (0..TOGETHER).fold(false, |any, k| any | alike(k)) {
                break;
            }
            at += TOGETHER;
        }
        let start = bytes[at..]
            .windows(SHORTEST)
            .position(|w| w[0] == w[1] && w[1] == w[2])
            .map_or(bytes.len(), |found| at + found);
        let Some(first) = bytes.get(start) else {
            return (start, 0);
        };
        let mut end = start;
        while let Some(some) = bytes.get(end..end + TOGETHER) {
            if some.iter().fold(false, |other, b| other | (b != first)) {
                break;
            }
            end += TOGETHER;
        }
        end += bytes[end..].iter().take_while(|b| *b == first).count();
        (start, end - start)
    };
    let mut at = 0;
    while at < bytes.len() {
        let (start, length) = next(at);
        for stretch in bytes[at..start].chunks(STRETCH) {
            packed.push((stretch.len() as u8).wrapping_neg());
            packed.extend_from_slice(stretch);
        }
        let mut left = length;
        while left >= SHORTEST {
            let count = left.min(LONGEST);
            packed.extend([(count - 1) as u8, bytes[start]]);
            left -= count;
        }
        at = start + length - left;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{ReadChannels as _, ReadLayers as _};

    #[test]
    fn what_is_packed_is_read_back() {
        // Noise, runs of all lengths, equal lines, and a plane of nothing.
        let (width, height) = (301, 40);
        let value = |c: usize, x: usize, y: usize| match (c, y % 4) {
            (2, _) => 0.0,
            (_, 0 | 1) => (x * x + c) as f32 * 0.37,
            (_, 2) => (x / (1 + y)) as f32,
            _ => f32::from_bits((x * y * 2_654_435_761) as u32 & 0x7f7f_ffff),
        };
        let plane = |c: usize| -> Vec<f32> {
            (0..width * height)
                .map(|k| value(c, k % width, k / width))
                .collect()
        };
        let planes: Vec<Vec<f32>> = (0..3).map(plane).collect();
        let (row, others) = (vec![1.5; width], vec![-0.0; width]);
        let mut all: Vec<(Text, Plane<'_>)> = ["a", "b", "c"]
            .into_iter()
            .zip(&planes)
            .map(|(name, plane)| (Text::from(name), Plane::Whole(plane)))
            .collect();
        all.insert(1, (Text::from("d"), Plane::OneRow(7, &row, &others)));
        let picture = Picture {
            size: [width, height],
            attributes: LayerAttributes::named("x"),
            planes: all,
        };
        let bytes = encode(vec![picture]).unwrap();
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(bytes))
            .unwrap();
        let mut planted = planes;
        let of_row = |y: usize| if y == 7 { &row } else { &others };
        planted.push((0..height).flat_map(of_row).copied().collect());
        for (channel, planted) in image.layer_data.channel_data.list.iter().zip(&planted) {
            let bits = |v: f32| v.to_bits();
            let found: Vec<u32> = channel.sample_data.values_as_f32().map(bits).collect();
            let planted: Vec<u32> = planted.iter().copied().map(bits).collect();
            assert!(found == planted, "channel {}", channel.name);
        }
    }
}
