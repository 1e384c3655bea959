//! OpenEXR: half, float and integer channels, scan lines and tiles, several parts, any channel
//! names, data window apart from the display window. Only blocks that hold wanted rows are read.

use std::collections::HashSet;
use std::ops::Range;

use exr::block::chunk::{Chunk, CompressedBlock};
use exr::block::reader::{ChunksReader, Reader};
use exr::block::{BlockIndex, UncompressedBlock, read as open_blocks};
use exr::compression::Compression;
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;

use super::shot::sensible;
use super::zip_block::{Apart, Inflater, half};
use super::{Format, Info, Opened, Photo, Planes, Shot, Storage, believable, plausible, wanted};
use crate::error::{Error, Result};
use crate::files::Input;

/// A channel of the photo and where the file keeps it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Source {
    name: String,
    part: usize,
    index: usize,
}

type Blocks = Reader<std::io::BufReader<Input>>;

pub(super) fn info(opened: Opened) -> Result<Info> {
    let bytes = opened.bytes;
    let blocks = open(opened)?;
    let (size, sources) = layout(blocks.headers())?;
    stored(blocks.headers(), size, bytes)?;
    let shot = blocks.headers().first().map(shot).unwrap_or_default();
    Ok(Info {
        format: Format::Exr,
        size,
        storage: storage(blocks.headers(), &sources),
        channels: sources.into_iter().map(|source| source.name).collect(),
        shot,
    })
}

pub(super) fn read(opened: Opened, rows: Option<Range<u32>>) -> Result<Photo> {
    let bytes = opened.bytes;
    let blocks = open(opened)?;
    let (size, sources) = layout(blocks.headers())?;
    stored(blocks.headers(), size, bytes)?;
    let rows = wanted(rows, size)?;
    let width = size[0] as usize;
    let pixels = width as u64 * u64::from(rows.end - rows.start);
    plausible(pixels.saturating_mul(4 * sources.len() as u64), bytes)?;

    let windows: Vec<Window> = blocks.headers().iter().map(Window::of).collect();
    let kinds: Vec<Vec<SampleType>> = blocks
        .headers()
        .iter()
        .map(|header| header.channels.list.iter().map(|c| c.sample_type).collect())
        .collect();
    let storage = storage(blocks.headers(), &sources);
    let mut values: Planes = sources
        .iter()
        .map(|source| {
            let covered = blocks
                .headers()
                .get(source.part)
                .is_some_and(|header| covers(header, &rows, width));
            // What a block overwrites need not be written before.
            let nothing = if covered { 0.0 } else { f32::NAN };
            vec![nothing; pixels as usize]
        })
        .collect();
    let chunks = blocks
        .filter_chunks(false, |_, _, block| {
            let Some(window) = windows.get(block.layer) else {
                return false;
            };
            let top = block.pixel_position.1 as i64 + window.top;
            block.level.0 == 0
                && block.level.1 == 0
                && sources.iter().any(|source| source.part == block.layer)
                && top < i64::from(rows.end)
                && top + block.pixel_size.1 as i64 > i64::from(rows.start)
        })
        .map_err(damaged)?;
    let meta = chunks.meta_data().clone();
    let mut found = HashSet::new();
    let mut inflater = Inflater::new();
    for chunk in chunks {
        let block = Block::of(chunk.map_err(damaged)?, &meta, &mut inflater)?;
        let part = block.index.layer;
        let [left, top] = [block.index.pixel_position.0, block.index.pixel_position.1];
        let in_rows = windows.get(part).is_some_and(|window| {
            let top = top as i64 + window.top;
            top < i64::from(rows.end)
                && top + block.index.pixel_size.1 as i64 > i64::from(rows.start)
        });
        // As many other blocks as are wanted leave no pixel of them out.
        if !in_rows || !found.insert((part, left, top)) {
            return Err(Error::input(
                "the EXR is damaged: its table leads to other blocks than it says",
            ));
        }
        if let (Some(window), Some(kinds)) = (windows.get(part), kinds.get(part)) {
            let place = Place {
                window,
                rows: &rows,
                width,
            };
            for (source, plane) in sources.iter().zip(&mut values) {
                if source.part == part {
                    place.copy(&block, kinds, source.index, plane);
                }
            }
        }
    }
    Ok(Photo {
        size,
        rows,
        channels: sources.into_iter().map(|source| source.name).collect(),
        values,
        storage,
    })
}

fn open(opened: Opened) -> Result<Blocks> {
    open_blocks(opened.reader, false).map_err(damaged)
}

fn damaged(cause: exr::error::Error) -> Error {
    match cause {
        exr::error::Error::NotSupported(what) => {
            Error::input(format!("this kind of EXR cannot be read: {what}"))
        }
        exr::error::Error::Io(cause) if cause.kind() == std::io::ErrorKind::UnexpectedEof => {
            Error::input("the EXR is truncated: it ends before its pixels do")
        }
        other => Error::input(format!("the EXR is damaged: {other}")),
    }
}

/// Pixels of a picture of which few are stored: those of the largest sensors, and as many again.
const LARGEST_FRAME: u64 = 1 << 28;
/// Bytes of a block beside its pixels, at least: its place in the table of blocks, its position and its length.
const BESIDE_BLOCK: u64 = 16;

/// Refuses sizes that the file's bytes cannot hold, by the headers alone, whichever rows are wanted.
fn stored(headers: &[Header], size: [u32; 2], bytes: u64) -> Result<()> {
    let area = |width: usize, height: usize| (width as u64).saturating_mul(height as u64);
    for header in headers {
        let [whole, block] = [header.layer_size, header.max_block_pixel_size()]
            .map(|size| area(size.0, size.1))
            .map(|pixels| pixels.saturating_mul(header.channels.bytes_per_pixel as u64));
        plausible(whole, bytes)?;
        plausible(block, bytes)?;
        let beside = (header.chunk_count as u64).saturating_mul(BESIDE_BLOCK);
        if beside > bytes {
            return Err(Error::input(format!(
                "the file declares {} x {} pixels in {} blocks, more than its {bytes} bytes can hold",
                header.layer_size.0, header.layer_size.1, header.chunk_count
            )));
        }
    }
    // Pixels of the picture that lie outside of what is stored cost the file nothing.
    let frame = u64::from(size[0]) * u64::from(size[1]);
    believable(size, if frame > LARGEST_FRAME { 32 } else { 0 }, bytes)
}

/// Offset of a part's data window from the display window's corner, pixels.
struct Window {
    left: i64,
    top: i64,
}

impl Window {
    fn of(header: &Header) -> Self {
        let data = header.own_attributes.layer_position;
        let display = header.shared_attributes.display_window.position;
        Self {
            left: i64::from(data.0) - i64::from(display.0),
            top: i64::from(data.1) - i64::from(display.1),
        }
    }
}

/// Whether the data of a part fill the wanted rows of a picture.
fn covers(header: &Header, rows: &Range<u32>, width: usize) -> bool {
    let Window { left, top } = Window::of(header);
    let (columns, lines) = (header.layer_size.0 as i64, header.layer_size.1 as i64);
    left <= 0
        && left + columns >= width as i64
        && top <= i64::from(rows.start)
        && top + lines >= i64::from(rows.end)
}

/// A block after decompression.
struct Block<'a> {
    index: BlockIndex,
    bytes: Bytes<'a>,
}

/// The bytes of a block.
enum Bytes<'a> {
    /// Line by line, in the machine's order.
    Lines(Vec<u8>),
    /// Apart by even and odd place.
    Apart(Apart<'a>),
}

impl<'a> Block<'a> {
    fn of(chunk: Chunk, meta: &MetaData, inflater: &'a mut Inflater) -> Result<Self> {
        let header = meta.headers.get(chunk.layer_index);
        let zip = header
            .filter(|header| matches!(header.compression, Compression::ZIP1 | Compression::ZIP16));
        if let (Some(header), Some(deflated)) = (zip, pixels(&chunk)) {
            let place = header
                .get_block_data_indices(&chunk.compressed_block)
                .map_err(damaged)?;
            let within = header
                .get_absolute_block_pixel_coordinates(place)
                .map_err(damaged)?;
            within.validate(Some(header.layer_size)).map_err(damaged)?;
            let size = within.size.area() * header.channels.bytes_per_pixel;
            // What deflating would not make smaller is stored as it is.
            if deflated.len() != size {
                return Ok(Self {
                    index: BlockIndex {
                        layer: chunk.layer_index,
                        pixel_position: within.position.to_usize("block").map_err(damaged)?,
                        pixel_size: within.size,
                        level: place.level_index,
                    },
                    bytes: Bytes::Apart(inflater.inflate(deflated, size)?),
                });
            }
        }
        let block = UncompressedBlock::decompress_chunk(chunk, meta, false).map_err(damaged)?;
        Ok(Self {
            index: block.index,
            bytes: Bytes::Lines(block.data),
        })
    }

    /// The samples whose bytes lie at `place`, as f32.
    fn decode(&self, place: Range<usize>, kind: SampleType, out: &mut [f32]) {
        match &self.bytes {
            Bytes::Lines(bytes) => {
                if let Some(bytes) = bytes.get(place) {
                    decode(bytes, kind, out);
                }
            }
            Bytes::Apart(apart) => apart.decode(place, kind, out),
        }
    }
}

/// The compressed pixels of flat data.
fn pixels(chunk: &Chunk) -> Option<&[u8]> {
    match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => Some(&block.compressed_pixels_le),
        CompressedBlock::Tile(block) => Some(&block.compressed_pixels_le),
        _ => None,
    }
}

/// Where the pixels of a part go.
struct Place<'a> {
    window: &'a Window,
    rows: &'a Range<u32>,
    width: usize,
}

impl Place<'_> {
    /// Copies one channel of a block into its plane, as far as it lies in the wanted rows and in
    /// the display window.
    fn copy(&self, block: &Block<'_>, kinds: &[SampleType], channel: usize, plane: &mut [f32]) {
        let Some(&kind) = kinds.get(channel) else {
            return;
        };
        let (columns, lines) = (block.index.pixel_size.0, block.index.pixel_size.1);
        let before: usize = kinds
            .iter()
            .take(channel)
            .map(|k| k.bytes_per_sample())
            .sum();
        let stride: usize = kinds.iter().map(|k| k.bytes_per_sample()).sum::<usize>() * columns;
        let left = block.index.pixel_position.0 as i64 + self.window.left;
        let skip = (-left).max(0) as usize;
        let first = left.max(0) as usize;
        if skip >= columns || first >= self.width {
            return;
        }
        let count = (columns - skip).min(self.width - first);
        let size = kind.bytes_per_sample();
        for line in 0..lines {
            let y = (block.index.pixel_position.1 + line) as i64 + self.window.top;
            if y < i64::from(self.rows.start) || y >= i64::from(self.rows.end) {
                continue;
            }
            let from = line * stride + before * columns + skip * size;
            let to = (y - i64::from(self.rows.start)) as usize * self.width + first;
            if let Some(out) = plane.get_mut(to..to + count) {
                block.decode(from..from + count * size, kind, out);
            }
        }
    }
}

/// Samples in the machine's byte order to f32.
fn decode(bytes: &[u8], kind: SampleType, out: &mut [f32]) {
    match kind {
        SampleType::F16 => {
            for (out, b) in out.iter_mut().zip(bytes.as_chunks::<2>().0) {
                *out = half(u16::from_ne_bytes(*b));
            }
        }
        SampleType::F32 => {
            for (out, b) in out.iter_mut().zip(bytes.as_chunks::<4>().0) {
                *out = f32::from_ne_bytes(*b);
            }
        }
        SampleType::U32 => {
            for (out, b) in out.iter_mut().zip(bytes.as_chunks::<4>().0) {
                *out = u32::from_ne_bytes(*b) as f32;
            }
        }
    }
}

/// Size of the picture and the channels that are read.
fn layout(headers: &[Header]) -> Result<([u32; 2], Vec<Source>)> {
    let first = headers
        .first()
        .ok_or_else(|| Error::input("the EXR is damaged: it has no parts"))?;
    let display = first.shared_attributes.display_window.size;
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let (width, height) = (side(display.0), side(display.1));
    let sources = choose(headers);
    if sources.is_empty() {
        return Err(Error::input(
            "expected colour or grey channels, found none in the EXR",
        ));
    }
    for source in &sources {
        let header = headers.get(source.part);
        let channel = header.and_then(|h| h.channels.list.get(source.index));
        if header.is_none_or(|h| h.deep)
            || channel.is_none_or(|c| c.sampling.0 != 1 || c.sampling.1 != 1)
        {
            return Err(Error::input(format!(
                "expected flat, full-resolution channels, found a deep or subsampled channel `{}`",
                source.name
            )));
        }
    }
    Ok(([width, height], sources))
}

/// The channels to read: plain R, G, B if there are any; else those of a layer; else a grey Y;
/// else all bands. Alpha, depth and what renderers add beside colour are left out.
fn choose(headers: &[Header]) -> Vec<Source> {
    let all: Vec<Source> = headers
        .iter()
        .enumerate()
        .flat_map(|(part, header)| {
            header
                .channels
                .list
                .iter()
                .enumerate()
                .map(move |(index, c)| Source {
                    name: c.name.to_string(),
                    part,
                    index,
                })
        })
        .collect();
    let layers: Vec<&str> = {
        let mut seen = vec![""];
        for source in &all {
            let layer = source.name.rsplit_once('.').map_or("", |(layer, _)| layer);
            if !seen.contains(&layer) {
                seen.push(layer);
            }
        }
        seen
    };
    let find = |part: usize, layer: &str, name: &str| {
        all.iter()
            .find(|s| s.part == part && split(&s.name) == (layer, name))
            .map(|s| Source {
                name: name.to_string(),
                ..s.clone()
            })
    };
    for wanted in [["R", "G", "B"].as_slice(), &["Y"]] {
        for layer in &layers {
            for part in 0..headers.len() {
                let found: Option<Vec<Source>> =
                    wanted.iter().map(|name| find(part, layer, name)).collect();
                if let Some(found) = found {
                    return found;
                }
            }
        }
    }
    bands(all, headers)
}

/// Layer and channel of a name such as `diffuse.R`.
fn split(name: &str) -> (&str, &str) {
    name.rsplit_once('.').unwrap_or(("", name))
}

/// Every channel that measures light, in the order of their numbers, without a prefix that all share.
fn bands(all: Vec<Source>, headers: &[Header]) -> Vec<Source> {
    const NOT_LIGHT: [&str; 12] = [
        "A", "AR", "AG", "AB", "Z", "ZBack", "id", "N", "X", "RY", "BY", "alpha",
    ];
    let mut bands: Vec<Source> = all
        .into_iter()
        .filter(|s| !NOT_LIGHT.contains(&split(&s.name).1))
        .collect();
    // Parts that each hold one channel of the same name are told apart by the part's own name.
    let repeated = |s: &Source| bands.iter().any(|o| o.name == s.name && o.part != s.part);
    let named: Vec<String> = bands
        .iter()
        .map(|s| {
            let part = headers
                .get(s.part)
                .and_then(|h| h.own_attributes.layer_name.as_ref());
            match part {
                Some(part) if repeated(s) => part.to_string(),
                _ => s.name.clone(),
            }
        })
        .collect();
    for (band, name) in bands.iter_mut().zip(named) {
        band.name = name;
    }
    let prefix = bands
        .first()
        .map(|s| split(&s.name).0.to_string())
        .unwrap_or_default();
    if !prefix.is_empty() && bands.iter().all(|s| split(&s.name).0 == prefix) {
        for band in &mut bands {
            band.name = split(&band.name).1.to_string();
        }
    }
    bands.sort_by(|a, b| crate::photo::natural_order(&a.name, &b.name));
    bands
}

/// The coarsest storage of the channels.
fn storage(headers: &[Header], sources: &[Source]) -> Storage {
    let kinds: Vec<SampleType> = sources
        .iter()
        .filter_map(|s| Some(headers.get(s.part)?.channels.list.get(s.index)?.sample_type))
        .collect();
    if kinds.contains(&SampleType::F16) {
        Storage::Half
    } else if kinds.contains(&SampleType::F32) {
        Storage::Float
    } else {
        Storage::Integer { max: u32::MAX }
    }
}

fn shot(header: &Header) -> Shot {
    let own = &header.own_attributes;
    let number = |x: Option<f32>| sensible(f64::from(x?));
    Shot {
        exposure_s: number(own.exposure),
        f_number: number(own.aperture),
        iso: number(own.iso_speed),
        focal_mm: None,
        focal_35mm: None,
        taken: own.capture_date.as_ref().map(|text| text.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use exr::prelude::*;

    use crate::photo::{Storage, info, read};

    fn pixel(channel: usize, x: usize, y: usize) -> f32 {
        // Exact in half precision: multiples of 1/8 below 256.
        ((channel * 71 + x * 3 + y * 5) % 2000) as f32 / 8.0
    }

    fn layer(
        name: &str,
        size: (usize, usize),
        offset: (i32, i32),
        encoding: Encoding,
        channels: &[(&str, bool)],
    ) -> Layer<AnyChannels<FlatSamples>> {
        let list = channels.iter().enumerate().map(|(c, (name, half))| {
            let values = (0..size.1).flat_map(|y| (0..size.0).map(move |x| pixel(c, x, y)));
            let samples = if *half {
                FlatSamples::F16(values.map(f16::from_f32).collect())
            } else {
                FlatSamples::F32(values.collect())
            };
            AnyChannel::new(*name, samples)
        });
        let mut attributes = LayerAttributes::named(name);
        attributes.layer_position = Vec2(offset.0, offset.1);
        attributes.exposure = Some(0.25);
        Layer::new(
            size,
            attributes,
            encoding,
            AnyChannels::sort(list.collect()),
        )
    }

    fn write(
        path: &Path,
        display: (i32, i32, usize, usize),
        layers: Vec<Layer<AnyChannels<FlatSamples>>>,
    ) {
        let window = IntegerBounds::new((display.0, display.1), (display.2, display.3));
        Image::from_layers(ImageAttributes::new(window), layers)
            .write()
            .to_file(path)
            .unwrap();
    }

    #[test]
    fn every_encoding_gives_the_same_rows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        for compression in [
            Compression::Uncompressed,
            Compression::RLE,
            Compression::ZIP1,
            Compression::ZIP16,
            Compression::PIZ,
        ] {
            for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 16))] {
                let encoding = Encoding {
                    compression,
                    blocks,
                    line_order: LineOrder::Increasing,
                };
                let channels = [("R", true), ("G", false), ("B", true), ("A", true)];
                write(
                    &path,
                    (0, 0, 50, 70),
                    vec![layer("main", (50, 70), (0, 0), encoding, &channels)],
                );
                let photo = read(&path, Some(21..43)).unwrap();
                assert_eq!(photo.channels, ["R", "G", "B"]);
                assert_eq!((photo.size, photo.rows.clone()), ([50, 70], 21..43));
                assert_eq!(photo.storage, Storage::Half);
                for c in 0..3 {
                    for y in 21..43 {
                        for x in 0..50 {
                            assert_eq!(photo.values[c][(y - 21) * 50 + x], pixel(c, x, y));
                        }
                    }
                }
            }
        }
        let info = info(&path).unwrap();
        assert_eq!((info.size, info.shot.exposure_s), ([50, 70], Some(0.25)));
    }

    #[test]
    fn the_data_window_is_placed_in_the_display_window() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        for encoding in [Encoding::SMALL_LOSSLESS, Encoding::FAST_LOSSLESS] {
            // Data start 3 left of and 4 above the picture's corner and end before its other corner.
            let data = layer("main", (20, 20), (7, 16), encoding, &[("layer.Y", false)]);
            write(&path, (10, 20, 30, 25), vec![data]);
            let photo = read(&path, None).unwrap();
            assert_eq!(
                (photo.size, photo.channels.as_slice()),
                ([30, 25], ["Y".to_string()].as_slice())
            );
            for y in 0..25_usize {
                for x in 0..30_usize {
                    let value = photo.values[0][y * 30 + x];
                    if x + 3 < 20 && y + 4 < 20 {
                        assert_eq!(value, pixel(0, x + 3, y + 4));
                    } else {
                        assert!(value.is_nan());
                    }
                }
            }
        }
    }

    #[test]
    fn of_tiles_only_those_of_the_rows_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let encoding = Encoding {
            compression: Compression::ZIP16,
            blocks: Blocks::Tiles(Vec2(64, 64)),
            line_order: LineOrder::Increasing,
        };
        let data = layer("main", (256, 1024), (0, 0), encoding, &[("Y", true)]);
        write(&path, (0, 0, 256, 1024), vec![data]);
        let whole = std::fs::read(&path).unwrap();
        // Two rows of tiles out of 16.
        let rows = 500..520;
        let sound = read(&path, Some(rows.clone())).unwrap();
        let places: Vec<usize> = (0..whole.len()).step_by(whole.len() / 400).collect();
        let matters = |place: &&usize| {
            let mut damaged = whole.clone();
            damaged[**place] ^= 0xff;
            std::fs::write(&path, &damaged).unwrap();
            read(&path, Some(rows.clone())).ok() != Some(sound.clone())
        };
        let share = places.iter().filter(matters).count() as f64 / places.len() as f64;
        // An eighth of the bytes, and the header; 0.03: two standard deviations of 400 places and the checksums.
        assert!((share - 0.125).abs() < 0.03, "{share}");
    }

    #[test]
    fn bands_come_in_the_order_of_their_numbers_from_all_parts() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let lossless = Encoding::SMALL_LOSSLESS;
        write(
            &path,
            (0, 0, 8, 8),
            vec![
                layer(
                    "one",
                    (8, 8),
                    (0, 0),
                    lossless,
                    &[("S.1000nm", false), ("S.450nm", false)],
                ),
                layer("two", (8, 8), (0, 0), lossless, &[("S.700nm", false)]),
            ],
        );
        let photo = read(&path, None).unwrap();
        assert_eq!(photo.channels, ["450nm", "700nm", "1000nm"]);
        assert_eq!(photo.values[1][9], pixel(0, 1, 1));
        assert_eq!(photo.values[0][9], pixel(1, 1, 1));
    }

    #[test]
    fn damage_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let zip = Encoding::SMALL_LOSSLESS;
        write(
            &path,
            (0, 0, 64, 64),
            vec![layer("main", (64, 64), (0, 0), zip, &[("Y", false)])],
        );
        let whole = std::fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(31) {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(read(&path, None).is_err(), "cut to {length} bytes");
        }
        // Flipped bits give an error or wrong pixels, and never a panic or another size.
        for place in (0..whole.len()).step_by(11) {
            let mut damaged = whole.clone();
            damaged[place] ^= 0x81;
            std::fs::write(&path, &damaged).unwrap();
            if let Ok(photo) = read(&path, None) {
                assert!(
                    photo
                        .values
                        .iter()
                        .all(|v| v.len() == (photo.size[0] * photo.size[1]) as usize)
                );
            }
        }
    }

    #[test]
    fn a_size_beyond_the_bytes_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let encoding = Encoding::UNCOMPRESSED;
        write(
            &path,
            (0, 0, 8, 8),
            vec![layer("main", (8, 8), (0, 0), encoding, &[("Y", false)])],
        );
        let mut bytes = std::fs::read(&path).unwrap();
        for name in [b"displayWindow\0box2i\0".as_slice(), b"dataWindow\0box2i\0"] {
            let at =
                bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4 + 8;
            bytes[at..at + 4].copy_from_slice(&99_999_i32.to_le_bytes());
            bytes[at + 4..at + 8].copy_from_slice(&99_999_i32.to_le_bytes());
        }
        let name = b"chunkCount\0int\0".as_slice();
        if let Some(at) = bytes.windows(name.len()).position(|w| w == name) {
            let at = at + name.len() + 4;
            bytes[at..at + 4].copy_from_slice(&100_000_i32.to_le_bytes());
        }
        bytes.resize(100_000, 0);
        std::fs::write(&path, &bytes).unwrap();
        let start = std::time::Instant::now();
        let error = read(&path, None).unwrap_err().to_string();
        assert!(
            error.contains("more than its 100000 bytes can hold"),
            "{error}"
        );
        assert!(start.elapsed().as_secs_f64() < 0.1);
    }
}
