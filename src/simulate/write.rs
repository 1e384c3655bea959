//! Photographs as files.

use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, LayerAttributes,
    LineOrder, SmallVec, Text, Vec2, WritableImage, f16,
};

use super::recipe::PhotoFormat;
use crate::error::{Error, Result};

/// The bytes of a photo file of stored values, \[channel\]\[row-major pixel\].
///
/// # Errors
/// If the encoder refuses the picture.
pub(super) fn photo(
    format: PhotoFormat,
    size: [u32; 2],
    channels: &[String],
    values: Vec<Vec<f32>>,
) -> Result<Vec<u8>> {
    match format {
        PhotoFormat::Png { bits } => png(size, bits > 8, &values),
        PhotoFormat::ExrHalf => exr(size, channels, values, true),
        PhotoFormat::ExrFloat => exr(size, channels, values, false),
    }
}

fn exr(size: [u32; 2], channels: &[String], values: Vec<Vec<f32>>, half: bool) -> Result<Vec<u8>> {
    let list: SmallVec<[AnyChannel<FlatSamples>; 4]> = channels
        .iter()
        .zip(values)
        .map(|(name, plane)| {
            let samples = if half {
                FlatSamples::F16(plane.into_iter().map(f16::from_f32).collect())
            } else {
                FlatSamples::F32(plane)
            };
            AnyChannel::new(Text::new_or_none(name).unwrap_or_default(), samples)
        })
        .collect();
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let image = Image::from_layer(exr::prelude::Layer::new(
        Vec2(size[0] as usize, size[1] as usize),
        LayerAttributes::default(),
        encoding,
        AnyChannels::sort(list),
    ));
    let mut bytes = Cursor::new(Vec::new());
    image
        .write()
        // Views are written side by side already.
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|e| Error::failed(format!("a photo cannot be encoded as EXR: {e}")))?;
    Ok(bytes.into_inner())
}

fn png(size: [u32; 2], wide: bool, values: &[Vec<f32>]) -> Result<Vec<u8>> {
    let fault =
        |e: png::EncodingError| Error::failed(format!("a photo cannot be encoded as PNG: {e}"));
    let pixels = size[0] as usize * size[1] as usize;
    let mut data = Vec::with_capacity(pixels * values.len() * (1 + usize::from(wide)));
    for i in 0..pixels {
        for plane in values {
            let code = plane.get(i).copied().unwrap_or(0.0) as u16;
            if wide {
                data.extend(code.to_be_bytes());
            } else {
                data.push(code.min(255) as u8);
            }
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size[0], size[1]);
    encoder.set_color(match values.len() {
        1 => png::ColorType::Grayscale,
        _ => png::ColorType::Rgb,
    });
    encoder.set_depth(match wide {
        true => png::BitDepth::Sixteen,
        false => png::BitDepth::Eight,
    });
    let mut writer = encoder.write_header().map_err(fault)?;
    writer.write_image_data(&data).map_err(fault)?;
    writer.finish().map_err(fault)?;
    Ok(bytes)
}
