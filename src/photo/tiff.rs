//! TIFF: integers of 8, 16 and 32 bits, floats of 16, 32 and 64; strips and tiles, of which only
//! those with wanted rows are read. The first page of several.

use std::io::BufReader;
use std::ops::Range;

use tiff::ColorType;
use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::{SampleFormat, Tag};

use super::orientation::Orientation;
use super::shot::sensible;
use super::{Format, Header, Opened, Planes, Shot, Storage, believable, plausible};
use crate::error::{Error, Result};
use crate::files::Input;

type Tiff = Decoder<BufReader<Input>>;

pub(super) fn open(opened: Opened) -> Result<(Header, impl FnOnce(Range<u32>) -> Result<Planes>)> {
    let bytes = opened.bytes;
    let mut tiff = Decoder::new(opened.reader)
        .map_err(damaged)?
        .with_limits(Limits::default());
    let (width, height) = tiff.dimensions().map_err(damaged)?;
    let colour = tiff.colortype().map_err(damaged)?;
    let (channels, samples, bits) = channels(colour)?;
    believable([width, height], samples as u64 * u64::from(bits), bytes)?;
    let format = tiff
        .find_tag_unsigned_vec::<u16>(Tag::SampleFormat)
        .map_err(damaged)?
        .and_then(|v| v.first().copied())
        .map_or(SampleFormat::Uint, SampleFormat::from_u16_exhaustive);
    let storage = match (format, bits) {
        (SampleFormat::Uint, 8 | 16 | 32) => Storage::Integer {
            max: u32::MAX >> (32 - u32::from(bits)),
        },
        (SampleFormat::IEEEFP, 16) => Storage::Half,
        (SampleFormat::IEEEFP, 32 | 64) => Storage::Float,
        (format, bits) => {
            return Err(Error::input(format!(
                "expected unsigned integers of 8, 16 or 32 bits or floats, found {format:?} of {bits} bits"
            )));
        }
    };
    let (shot, orientation) = header(&mut tiff);
    let planar = tiff
        .find_tag_unsigned::<u16>(Tag::PlanarConfiguration)
        .map_err(damaged)?
        == Some(2);
    let layout = Layout {
        size: [width, height],
        samples,
        channels: channels.len(),
        planar,
    };
    let header = Header {
        format: Format::Tiff,
        stored: [width, height],
        orientation,
        channels,
        storage,
        shot,
    };
    Ok((header, move |rows| layout.decode(tiff, bytes, rows)))
}

/// Names of the wanted channels, samples of a pixel in the file, bits of a sample.
fn channels(colour: ColorType) -> Result<(Vec<String>, usize, u8)> {
    let names = |names: &[&str]| names.iter().map(|n| n.to_string()).collect();
    Ok(match colour {
        ColorType::Gray(bits) => (names(&["Y"]), 1, bits),
        ColorType::GrayA(bits) => (names(&["Y"]), 2, bits),
        ColorType::RGB(bits) => (names(&["R", "G", "B"]), 3, bits),
        ColorType::RGBA(bits) => (names(&["R", "G", "B"]), 4, bits),
        ColorType::Multiband {
            bit_depth,
            num_samples,
        } if (1..=1024).contains(&num_samples) => (
            (1..=num_samples).map(|i| format!("band{i}")).collect(),
            usize::from(num_samples),
            bit_depth,
        ),
        other => {
            return Err(Error::input(format!(
                "expected a grey, colour or multi-band TIFF, found {other:?}"
            )));
        }
    })
}

struct Layout {
    size: [u32; 2],
    samples: usize,
    channels: usize,
    planar: bool,
}

impl Layout {
    fn decode(&self, mut tiff: Tiff, bytes: u64, rows: Range<u32>) -> Result<Planes> {
        let [width, height] = self.size;
        let pixels = width as usize * rows.len();
        plausible((4 * pixels * self.channels) as u64, bytes)?;
        let (chunk_width, chunk_height) = tiff.chunk_dimensions();
        if chunk_width == 0 || chunk_height == 0 {
            return Err(Error::input(
                "the TIFF is damaged: its strips or tiles are empty",
            ));
        }
        let chunk_samples = if self.planar { 1 } else { self.samples };
        plausible(
            u64::from(chunk_width.min(width))
                * u64::from(chunk_height.min(height))
                * chunk_samples as u64,
            bytes,
        )?;
        let across = width.div_ceil(chunk_width);
        let down = height.div_ceil(chunk_height);
        let chunks = across.checked_mul(down);
        let per_plane = chunks
            .filter(|n| n.checked_mul(self.samples as u32).is_some())
            .ok_or_else(|| {
                Error::input("the TIFF is damaged: it has more tiles than can be counted")
            })?;
        let mut planes = vec![vec![f32::NAN; pixels]; self.channels];
        for row in rows.start / chunk_height..=(rows.end - 1) / chunk_height {
            for column in 0..across {
                let index = row * across + column;
                let corner = [column * chunk_width, row * chunk_height];
                // A stored plane holds one sample of a pixel, else a chunk holds them all.
                let reads = if self.planar { self.channels } else { 1 };
                for plane in 0..reads {
                    let chunk = index + plane as u32 * per_plane;
                    let data = values(tiff.read_chunk(chunk).map_err(damaged)?)?;
                    let columns = chunk_width.min(width - corner[0]) as usize;
                    let place = Place {
                        corner,
                        columns,
                        rows: &rows,
                        width: width as usize,
                    };
                    if self.planar {
                        if let Some(out) = planes.get_mut(plane) {
                            place.copy(&data, 1, 0, out);
                        }
                    } else {
                        for (c, out) in planes.iter_mut().enumerate() {
                            place.copy(&data, self.samples, c, out);
                        }
                    }
                }
            }
        }
        Ok(planes)
    }
}

/// Where a chunk's pixels go.
struct Place<'a> {
    corner: [u32; 2],
    columns: usize,
    rows: &'a Range<u32>,
    width: usize,
}

impl Place<'_> {
    /// Copies sample `c` of every pixel of a chunk into its plane, as far as its rows are wanted.
    fn copy(&self, data: &[f32], samples: usize, c: usize, plane: &mut [f32]) {
        for (y, line) in (self.corner[1]..).zip(data.chunks_exact((self.columns * samples).max(1)))
        {
            if !self.rows.contains(&y) {
                continue;
            }
            let start = (y - self.rows.start) as usize * self.width + self.corner[0] as usize;
            if let Some(out) = plane.get_mut(start..start + self.columns) {
                let values = line.iter().skip(c).step_by(samples);
                out.iter_mut().zip(values).for_each(|(out, v)| *out = *v);
            }
        }
    }
}

fn values(chunk: DecodingResult) -> Result<Vec<f32>> {
    Ok(match chunk {
        DecodingResult::U8(v) => v.into_iter().map(f32::from).collect(),
        DecodingResult::U16(v) => v.into_iter().map(f32::from).collect(),
        DecodingResult::U32(v) => v.into_iter().map(|x| x as f32).collect(),
        DecodingResult::F16(v) => v.into_iter().map(|x| x.to_f32()).collect(),
        DecodingResult::F32(v) => v,
        DecodingResult::F64(v) => v.into_iter().map(|x| x as f32).collect(),
        _ => {
            return Err(Error::input(
                "expected unsigned integers or floats in the TIFF",
            ));
        }
    })
}

/// Exposure, lens and orientation. A directory that cannot be read states nothing.
fn header(tiff: &mut Tiff) -> (Shot, Orientation) {
    let orientation = tiff
        .find_tag_unsigned::<u32>(Tag::Orientation)
        .ok()
        .flatten()
        .map_or(Orientation::UPRIGHT, Orientation::of);
    let mut shot = Shot {
        taken: tiff.get_tag_ascii_string(Tag::DateTime).ok(),
        ..Shot::default()
    };
    let pointer = match tiff.find_tag(Tag::ExifDirectory) {
        Ok(Some(value)) => value.into_ifd_pointer().ok(),
        _ => None,
    };
    let Some(Ok(directory)) = pointer.map(|pointer| tiff.read_directory(pointer)) else {
        return (shot, orientation);
    };
    let mut tags = tiff.read_directory_tags(&directory);
    let mut number = |tag: u16| match tags.find_tag(Tag::from_u16_exhaustive(tag)).ok()?? {
        Value::Rational(a, b) => sensible(f64::from(a) / f64::from(b)),
        Value::SRational(a, b) => sensible(f64::from(a) / f64::from(b)),
        other => sensible(f64::from(other.into_u32().ok()?)),
    };
    // Tag numbers of EXIF 2.3, tables 7 and 8.
    shot.exposure_s = number(0x829a);
    shot.f_number = number(0x829d);
    shot.iso = number(0x8827);
    shot.focal_mm = number(0x920a);
    shot.focal_35mm = number(0xa405);
    (shot, orientation)
}

fn damaged(cause: tiff::TiffError) -> Error {
    match cause {
        tiff::TiffError::UnsupportedError(what) => {
            Error::input(format!("this kind of TIFF cannot be read: {what}"))
        }
        other => Error::input(format!("the TIFF is damaged or truncated: {other}")),
    }
}
