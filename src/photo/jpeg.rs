//! JPEG, strictly: a file that ends early is an error and not a grey rest. The decoder has no way
//! to stop after a row.

use std::io::Read;
use std::ops::Range;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::orientation::Orientation;
use super::{Format, Header, Opened, Planes, Shot, Storage, believable, shot};
use crate::error::{Error, Result};

/// Bytes that hold the markers before the pixels of any camera's file: a few segments of 64 kB
/// each, some of them a preview.
const HEAD: u64 = 4 << 20;

pub(super) fn open(
    mut opened: Opened,
    pixels: bool,
) -> Result<(Header, impl FnOnce(Range<u32>) -> Result<Planes>)> {
    let bytes = opened.bytes;
    let mut data = Vec::new();
    let limit = if pixels { u64::MAX } else { HEAD };
    opened
        .reader
        .by_ref()
        .take(limit)
        .read_to_end(&mut data)
        .map_err(|cause| Error::input(format!("cannot read it: {cause}")))?;
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(65_535)
        .set_max_height(65_535);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(data.as_slice()), options);
    decoder.decode_headers().map_err(damaged)?;
    let about = decoder
        .info()
        .ok_or_else(|| Error::input("the JPEG is damaged: it has no frame header"))?;
    let size = [u32::from(about.width), u32::from(about.height)];
    let (colour, channels): (_, &[&str]) = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => (ColorSpace::Luma, &["Y"]),
        Some(ColorSpace::YCbCr | ColorSpace::RGB) => (ColorSpace::RGB, &["R", "G", "B"]),
        other => {
            return Err(Error::input(format!(
                "expected a grey or colour JPEG, found the colour space {other:?}"
            )));
        }
    };
    let (shot, orientation) = match decoder.exif() {
        Some(block) => shot::exif(block),
        None => (Shot::default(), Orientation::UPRIGHT),
    };
    drop(decoder);
    let samples = channels.len();
    believable(size, 8 * samples as u64, bytes)?;
    let header = Header {
        format: Format::Jpeg,
        stored: size,
        orientation,
        channels: channels.iter().map(|n| n.to_string()).collect(),
        storage: Storage::Integer { max: 255 },
        shot,
    };
    Ok((header, move |rows: Range<u32>| {
        let width = size[0] as usize;
        let options = options.jpeg_set_out_colorspace(colour);
        let interleaved = JpegDecoder::new_with_options(ZCursor::new(data.as_slice()), options)
            .decode()
            .map_err(damaged)?;
        let line = width * samples;
        let wanted = interleaved
            .get(rows.start as usize * line..rows.end as usize * line)
            .ok_or_else(|| Error::input("the JPEG is damaged: it holds fewer rows than it says"))?;
        Ok((0..samples)
            .map(|c| {
                wanted
                    .iter()
                    .skip(c)
                    .step_by(samples)
                    .map(|&b| f32::from(b))
                    .collect()
            })
            .collect())
    }))
}

fn damaged(cause: impl std::fmt::Debug) -> Error {
    Error::input(format!("the JPEG is damaged or truncated: {cause:?}"))
}
