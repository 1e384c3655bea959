//! PNG of 8 and 16 bits (fewer bits and palettes are expanded to 8). Stops after the last wanted row.

use std::ops::Range;

use png::{BitDepth, ColorType, DecodingError, Limits, Transformations};

use super::orientation::Orientation;
use super::{Format, Header, Opened, Planes, Shot, Storage, believable, plausible, shot};
use crate::error::{Error, Result};
use crate::files::Input;

type Reader = png::Reader<std::io::BufReader<Input>>;

pub(super) fn open(opened: Opened) -> Result<(Header, impl FnOnce(Range<u32>) -> Result<Planes>)> {
    let bytes = opened.bytes;
    let mut decoder = png::Decoder::new_with_limits(opened.reader, Limits { bytes: 256 << 20 });
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    let reader = decoder.read_info().map_err(damaged)?;
    let info = reader.info();
    let size = [info.width, info.height];
    believable(size, info.bits_per_pixel() as u64, bytes)?;
    let (shot, orientation) = match &info.exif_metadata {
        Some(block) => shot::exif(block),
        None => (Shot::default(), Orientation::UPRIGHT),
    };
    let (colour, depth) = reader.output_color_type();
    let names: &[&str] = match colour {
        ColorType::Grayscale | ColorType::GrayscaleAlpha => &["Y"],
        _ => &["R", "G", "B"],
    };
    let samples = colour.samples();
    let wide = depth == BitDepth::Sixteen;
    let header = Header {
        format: Format::Png,
        stored: size,
        orientation,
        channels: names.iter().map(|n| n.to_string()).collect(),
        storage: Storage::Integer {
            max: if wide { 65535 } else { 255 },
        },
        shot,
    };
    let channels = names.len();
    Ok((header, move |rows: Range<u32>| {
        decode(
            reader,
            bytes,
            Layout {
                size,
                samples,
                channels,
                wide,
            },
            rows,
        )
    }))
}

struct Layout {
    size: [u32; 2],
    /// Samples of a pixel, alpha among them.
    samples: usize,
    /// Samples that are wanted: the first ones.
    channels: usize,
    wide: bool,
}

fn decode(mut reader: Reader, bytes: u64, layout: Layout, rows: Range<u32>) -> Result<Planes> {
    let width = layout.size[0] as usize;
    let pixels = width * rows.len();
    plausible(4 * (pixels * layout.channels) as u64, bytes)?;
    let mut planes: Planes = (0..layout.channels)
        .map(|_| Vec::with_capacity(pixels))
        .collect();
    if reader.info().interlaced {
        // Every pass holds pixels of every few rows: there is no stopping early.
        let size = reader
            .output_buffer_size()
            .ok_or_else(|| Error::input("the PNG is too large for this machine"))?;
        plausible(size as u64, bytes)?;
        let mut whole = vec![0; size];
        reader.next_frame(&mut whole).map_err(damaged)?;
        let line = width * layout.samples * (1 + usize::from(layout.wide));
        for row in whole
            .chunks_exact(line.max(1))
            .skip(rows.start as usize)
            .take(rows.len())
        {
            layout.split(row, &mut planes);
        }
    } else {
        for y in 0..rows.end {
            let row = reader.next_row().map_err(damaged)?.ok_or_else(|| {
                Error::input("the PNG is truncated: it ends before its pixels do")
            })?;
            if y >= rows.start {
                layout.split(row.data(), &mut planes);
            }
        }
    }
    Ok(planes)
}

impl Layout {
    /// Appends a row's samples to their planes. PNG stores 16 bits with the high byte first.
    fn split(&self, row: &[u8], planes: &mut [Vec<f32>]) {
        for (c, plane) in planes.iter_mut().enumerate() {
            if self.wide {
                let pairs = row.as_chunks::<2>().0;
                let samples = pairs.iter().skip(c).step_by(self.samples);
                plane.extend(samples.map(|&b| f32::from(u16::from_be_bytes(b))));
            } else {
                plane.extend(
                    row.iter()
                        .skip(c)
                        .step_by(self.samples)
                        .map(|&b| f32::from(b)),
                );
            }
        }
    }
}

fn damaged(cause: DecodingError) -> Error {
    match cause {
        DecodingError::IoError(cause) if cause.kind() == std::io::ErrorKind::UnexpectedEof => {
            Error::input("the PNG is truncated: it ends before its pixels do")
        }
        other => Error::input(format!("the PNG is damaged: {other}")),
    }
}
