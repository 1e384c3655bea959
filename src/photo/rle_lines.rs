//! EXR files of float planes in runs: pictures that are mostly empty or mostly alike, in a few milliseconds.
//!
//! A line's bytes are laid out as in a ZIP block ([`zip_block`](super::zip_block)), and instead of being deflated are written as
//! runs (OpenEXR's `ImfRle`). A line that is like the one before is not packed again.

use std::io::Cursor;

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter;
use exr::error::{Error, Result};
use exr::prelude::{
    AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds,
    Layer, LineOrder, SmallVec, Vec2, WritableImage,
};

/// Layers of float planes.
pub(crate) type Layers = SmallVec<[Layer<AnyChannels<FlatSamples>>; 2]>;

/// How layers must be encoded for [`encode`].
pub(crate) const ENCODING: Encoding = Encoding {
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

/// The bytes of an EXR file with these layers, whose encoding is [`ENCODING`] and whose planes are floats.
///
/// # Errors
/// If that is not so, a plane does not have its layer's size, or the exr crate refuses the header.
pub(crate) fn encode(layers: Layers) -> Result<Vec<u8>> {
    let bounds = layers.iter().fold(Vec2(1, 1), |bounds, layer| {
        Vec2(bounds.0.max(layer.size.0), bounds.1.max(layer.size.1))
    });
    let image = Image::from_layers(
        ImageAttributes::new(IntegerBounds::from_dimensions(bounds)),
        layers,
    );
    let headers = image.write().infer_meta_data();
    let mut bytes = Cursor::new(Vec::new());
    exr::block::write(&mut bytes, headers, true, |_, writer| {
        for (index, layer) in image.layer_data.iter().enumerate() {
            let planes = planes(layer)?;
            let width = layer.size.0;
            let mut line = Line::default();
            for y in 0..layer.size.1 {
                let place = y * width..(y + 1) * width;
                let before = y.checked_sub(1).map(|y| y * width..(y + 1) * width);
                let same = |plane: &&[f32]| {
                    before.clone().is_some_and(|before| {
                        // Without a branch in it, so that many are compared at once.
                        let both = plane[before].iter().zip(&plane[place.clone()]);
                        both.fold(true, |same, (a, b)| same & (a.to_bits() == b.to_bits()))
                    })
                };
                if !planes.iter().all(same) {
                    line.pack(planes.iter().map(|plane| &plane[place.clone()]));
                }
                let block = CompressedScanLineBlock {
                    y_coordinate: i32::try_from(y).map_err(|_| Error::Invalid("height".into()))?,
                    compressed_pixels_le: line.packed.clone(),
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

/// The planes of a layer, in its channels' order.
fn planes(layer: &Layer<AnyChannels<FlatSamples>>) -> Result<Vec<&[f32]>> {
    if layer.encoding != ENCODING {
        return Err(Error::Invalid("encoding".into()));
    }
    let channels = layer.channel_data.list.iter();
    channels
        .map(|channel| match &channel.sample_data {
            FlatSamples::F32(values) if values.len() == layer.size.area() => Ok(values.as_slice()),
            _ => Err(Error::Invalid("plane".into())),
        })
        .collect()
}

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
    use exr::prelude::{AnyChannel, LayerAttributes, ReadChannels as _, ReadLayers as _};

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
        let list = ["a", "b", "c"].iter().enumerate();
        let list = list.map(|(c, name)| AnyChannel::new(*name, FlatSamples::F32(plane(c))));
        let layer = Layer::new(
            Vec2(width, height),
            LayerAttributes::named("x"),
            ENCODING,
            AnyChannels::sort(list.collect()),
        );
        let bytes = encode([layer].into_iter().collect()).unwrap();
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(bytes))
            .unwrap();
        for (c, channel) in image.layer_data.channel_data.list.iter().enumerate() {
            let bits = |v: f32| v.to_bits();
            let found: Vec<u32> = channel.sample_data.values_as_f32().map(bits).collect();
            let planted: Vec<u32> = plane(c).into_iter().map(bits).collect();
            assert!(found == planted, "channel {c}");
        }
    }
}
