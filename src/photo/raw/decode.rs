//! RAW files through `rawler`.

use std::ops::Range;
use std::path::Path;

use rawler::decoders::{Decoder, RawDecodeParams, RawMetadata, WellKnownIFD};
use rawler::formats::tiff::Rational;
use rawler::imgop::Rect;
use rawler::rawimage::{RawImage, RawImageData, RawPhotometricInterpretation};
use rawler::rawsource::RawSource;
use rawler::tags::{DngTag, TiffCommonTag};

use super::super::orientation::Orientation;
use super::super::shot::sensible;
use super::super::{Format, Header, Info, Photo, Planes, Shot, Storage, believable};
use super::directories;
use crate::error::{Error, Result};
use crate::files;

/// Reads the header of a RAW file and no pixels.
pub(in super::super) fn info(path: &Path) -> Result<Info> {
    let Opened {
        image, shot, bytes, ..
    } = open(path, true)?;
    let sensor = Sensor::of(&image)?;
    believable(sensor.crop_size(), 32, bytes)?;
    Ok(sensor.header(&image, shot).info())
}

/// Reads rows of a RAW file.
pub(in super::super) fn read(path: &Path, rows: Option<Range<u32>>) -> Result<Photo> {
    let header = open(path, true)?;
    believable(Sensor::of(&header.image)?.crop_size(), 32, header.bytes)?;
    let shot = header.shot;
    let Opened {
        image,
        black_deltas,
        ..
    } = open(path, false)?;
    let mut sensor = Sensor::of(&image)?;
    sensor.black_deltas = black_deltas;
    let header = sensor.header(&image, shot);
    header.photo(rows, |rows| sensor.planes(&image, rows))
}

fn failed(cause: impl std::fmt::Display) -> Error {
    Error::input(format!(
        "the RAW file is damaged or of an unknown kind: {cause}"
    ))
}

/// A decoded file.
struct Opened {
    image: RawImage,
    shot: Shot,
    /// Size of the file.
    bytes: u64,
    /// What is to be added to the black level: by column and by row of the lit part.
    black_deltas: [Vec<f64>; 2],
}

/// Refuses a picture, or tiles, of a size that the file cannot hold, before `rawler` makes room for them: it decodes a DNG to learn of
/// it.
fn room(decoder: &dyn Decoder, bytes: u64) -> Result<()> {
    use TiffCommonTag::{ImageLength, ImageWidth, SamplesPerPixel, TileLength, TileWidth};
    let Some(raw) = decoder.ifd(WellKnownIFD::Raw).ok().flatten() else {
        return Ok(());
    };
    let number = |tag| raw.get_entry(tag).map(|entry| entry.force_u32(0));
    let samples = number(SamplesPerPixel).unwrap_or(1).max(2);
    for sides in [[ImageWidth, ImageLength], [TileWidth, TileLength]] {
        if let [Some(width), Some(height)] = sides.map(number) {
            believable([width, height], 16 * u64::from(samples), bytes)?;
        }
    }
    Ok(())
}

/// Black levels of single columns and rows, which `rawler` does not take into account.
fn black_deltas(decoder: &dyn Decoder) -> [Vec<f64>; 2] {
    let raw = decoder.ifd(WellKnownIFD::Raw).ok().flatten();
    [DngTag::BlackLevelDeltaH, DngTag::BlackLevelDeltaV].map(|tag| {
        let entry = raw.as_ref().and_then(|raw| raw.get_entry(tag));
        entry.map_or_else(Vec::new, |entry| {
            (0..entry.value.count())
                .map(|k| f64::from(entry.value.force_f32(k)))
                .collect()
        })
    })
}

/// Decodes a file, with its pixels unless `dummy`.
fn open(path: &Path, dummy: bool) -> Result<Opened> {
    let (mut file, bytes) = files::open(path)?;
    directories::check(&mut file, bytes)?;
    let source = RawSource::new(path).map_err(|cause| Error::read(path, cause))?;
    let decoder = rawler::get_decoder(&source).map_err(failed)?;
    room(decoder.as_ref(), bytes)?;
    let parameters = RawDecodeParams::default();
    let image = decoder
        .raw_image(&source, &parameters, dummy)
        .map_err(failed)?;
    let shot = decoder
        .raw_metadata(&source, &parameters)
        .map(|metadata| shot(&metadata))
        .unwrap_or_default();
    Ok(Opened {
        black_deltas: black_deltas(decoder.as_ref()),
        image,
        shot,
        bytes,
    })
}

fn shot(metadata: &RawMetadata) -> Shot {
    let exif = &metadata.exif;
    let number =
        |r: &Option<Rational>| sensible(f64::from(r.as_ref()?.n) / f64::from(r.as_ref()?.d));
    Shot {
        exposure_s: number(&exif.exposure_time),
        f_number: number(&exif.fnumber),
        iso: exif
            .iso_speed_ratings
            .map(f64::from)
            .or(exif.iso_speed.map(f64::from))
            .and_then(sensible),
        focal_mm: number(&exif.focal_length),
        focal_35mm: None,
        taken: exif.date_time_original.clone(),
    }
}

/// What lies where on a sensor.
struct Sensor {
    /// The picture within the sensor.
    crop: Rect,
    /// Pattern of colours (0 R, 1 G, 2 B) over the whole sensor, \[row\]\[column\]; none: all channels everywhere.
    filters: Option<Vec<Vec<usize>>>,
    channels: Vec<String>,
    /// Black levels over a pattern of width and height, and where the pattern begins.
    black: Vec<f64>,
    black_size: [usize; 2],
    black_origin: [usize; 2],
    /// Added to it by column and by row, from the same origin.
    black_deltas: [Vec<f64>; 2],
    white: f64,
}

impl Sensor {
    fn of(image: &RawImage) -> Result<Self> {
        let whole = Rect::new(
            rawler::imgop::Point::zero(),
            rawler::imgop::Dim2::new(image.width, image.height),
        );
        let inside = |r: &Rect| {
            r.d.w > 0
                && r.d.h > 0
                && r.p.x.saturating_add(r.d.w) <= image.width
                && r.p.y.saturating_add(r.d.h) <= image.height
        };
        let crop = image
            .crop_area
            .filter(inside)
            .or(image.active_area.filter(inside))
            .unwrap_or(whole);
        let (filters, channels) = match &image.photometric {
            RawPhotometricInterpretation::Cfa(config) => {
                let cfa = &config.cfa;
                let pattern: Vec<Vec<usize>> = (0..cfa.height)
                    .map(|y| (0..cfa.width).map(|x| cfa.color_at(y, x)).collect())
                    .collect();
                if image.cpp != 1 || pattern.is_empty() || pattern.iter().flatten().any(|c| *c > 2)
                {
                    return Err(Error::input(
                        "expected a sensor with red, green and blue filters, found another kind",
                    ));
                }
                (Some(pattern), vec!["R", "G", "B"])
            }
            RawPhotometricInterpretation::BlackIsZero if image.cpp == 1 => (None, vec!["Y"]),
            RawPhotometricInterpretation::LinearRaw if image.cpp == 1 => (None, vec!["Y"]),
            RawPhotometricInterpretation::LinearRaw if image.cpp == 3 => {
                (None, vec!["R", "G", "B"])
            }
            _ => {
                return Err(Error::input(format!(
                    "expected one or three values per pixel, found {}",
                    image.cpp
                )));
            }
        };
        let level = |r: &Rational| f64::from(r.n) / f64::from(r.d.max(1));
        let mut black: Vec<f64> = image.blacklevel.levels.iter().map(level).collect();
        let mut black_size = [image.blacklevel.width, image.blacklevel.height];
        if black.len() != image.blacklevel.cpp * black_size[0] * black_size[1] || black.is_empty() {
            (black, black_size) = (vec![0.0; image.cpp], [1, 1]);
        }
        // In a DNG the pattern begins where the sensor's lit part does.
        let black_origin = match (&image.active_area, image.camera.mode.as_str()) {
            (Some(area), "dng") => [area.p.x, area.p.y],
            _ => [0, 0],
        };
        let white = image.whitelevel.0.iter().copied().min().unwrap_or(65535);
        Ok(Self {
            crop,
            filters,
            channels: channels.into_iter().map(String::from).collect(),
            black,
            black_size,
            black_origin,
            black_deltas: [Vec::new(), Vec::new()],
            white: f64::from(white),
        })
    }

    fn crop_size(&self) -> [u32; 2] {
        [self.crop.d.w, self.crop.d.h].map(|n| u32::try_from(n).unwrap_or(u32::MAX))
    }

    fn header(&self, image: &RawImage, shot: Shot) -> Header {
        let highest = self.black.iter().copied().fold(0.0, f64::max);
        Header {
            format: Format::Raw,
            stored: self.crop_size(),
            orientation: Orientation::of(u32::from(image.orientation.to_u16())),
            channels: self.channels.clone(),
            storage: match image.data {
                RawImageData::Integer(_) => Storage::Sensor {
                    white: (self.white - highest).max(1.0) as u32,
                    black: highest as u32,
                },
                RawImageData::Float(_) => Storage::Float,
            },
            shot,
        }
    }

    /// Values above black of rows of the crop, NaN at other colours' sites.
    fn planes(&self, image: &RawImage, rows: Range<u32>) -> Result<Planes> {
        let width = self.crop.d.w;
        let pixels = width * rows.len();
        let mut planes = vec![vec![f32::NAN; pixels]; self.channels.len()];
        let value = |at: usize| match &image.data {
            RawImageData::Integer(data) => data.get(at).map(|v| f64::from(*v)),
            RawImageData::Float(data) => data.get(at).map(|v| f64::from(*v)),
        };
        for (line, row) in rows.enumerate() {
            let y = self.crop.p.y + row as usize;
            for column in 0..width {
                let x = self.crop.p.x + column;
                let out = line * width + column;
                let mut put = |channel: usize, sample: usize| {
                    let found = value((y * image.width + x) * image.cpp + sample)
                        .ok_or_else(|| failed("pixels are missing"))?;
                    if let Some(cell) = planes.get_mut(channel).and_then(|p| p.get_mut(out)) {
                        *cell = (found - self.black_at(x, y, sample)) as f32;
                    }
                    Ok::<(), Error>(())
                };
                match &self.filters {
                    Some(pattern) => {
                        let line = &pattern[y % pattern.len()];
                        put(line[x % line.len()], 0)?;
                    }
                    None => {
                        for sample in 0..image.cpp {
                            put(sample, sample)?;
                        }
                    }
                }
            }
        }
        Ok(planes)
    }

    fn black_at(&self, x: usize, y: usize, sample: usize) -> f64 {
        let [width, height] = self.black_size;
        let cpp = self.black.len() / (width * height).max(1);
        let delta = |axis: usize, at: usize| {
            let place = at.checked_sub(self.black_origin[axis])?;
            self.black_deltas[axis].get(place).copied()
        };
        let own = delta(0, x).unwrap_or(0.0) + delta(1, y).unwrap_or(0.0);
        let x = (x + width * self.black_origin[0] - self.black_origin[0]) % width;
        let y = (y + height * self.black_origin[1] - self.black_origin[1]) % height;
        let at = (y * width + x) * cpp + sample.min(cpp.saturating_sub(1));
        self.black.get(at).copied().unwrap_or(0.0) + own
    }
}
