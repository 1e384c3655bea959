//! What differs from pixel to pixel whatever is photographed: dark frame, flat field, vignetting.

use std::ops::Range;
use std::path::Path;

use super::response::Response;
use crate::capture::{Capture, Sensor};
use crate::error::{Error, Result};
use crate::photo::{self, Photo, Storage};

/// Half the side of the block at the image's centre where a flat field counts as 1, pixels.
const CENTRE: u32 = 16;

/// Dark frame of some rows, \[channel\]\[pixel\], in stored values; `None` if there is none.
pub(super) fn dark(capture: &Capture, rows: &Range<u32>) -> Result<Option<Photo>> {
    let Some(file) = &capture.sensor.dark else {
        return Ok(None);
    };
    frame(&capture.folder.join(file), capture, rows.clone()).map(Some)
}

/// Relative illumination f of some rows, \[channel\]\[pixel\], 1 at the image's centre; `None` where
/// it is 1 everywhere. NaN where the flat field has no light.
pub(super) fn illumination(
    capture: &Capture,
    rows: &Range<u32>,
    channels: usize,
    storage: Storage,
    response: &Response,
) -> Result<Option<Vec<Vec<f32>>>> {
    let sensor = &capture.sensor;
    let mut planes: Option<Vec<Vec<f32>>> = None;
    if let Some(file) = &sensor.flat {
        let path = capture.folder.join(file);
        let [_, height] = capture.camera.image_size;
        let middle = height / 2;
        let block = middle.saturating_sub(CENTRE)..(middle + CENTRE).min(height);
        let block = flat(&path, capture, block, storage, response)?;
        let strip = flat(&path, capture, rows.clone(), storage, response)?;
        if strip.len() != channels && strip.len() != 1 {
            return Err(Error::input(format!(
                "expected a flat field of 1 or {channels} channels, found {}",
                strip.len()
            ))
            .file(path));
        }
        let mut divided = Vec::new();
        for (plane, block) in strip.into_iter().zip(block) {
            let centre = centre_mean(&block, capture.camera.image_size[0] as usize);
            if !(centre.is_finite() && centre > 0.0) {
                return Err(
                    Error::input("expected light at the flat field's centre, found none")
                        .file(path),
                );
            }
            divided.push(
                plane
                    .into_iter()
                    .map(|x| if x > 0.0 { x / centre } else { f32::NAN })
                    .collect::<Vec<f32>>(),
            );
        }
        while divided.len() < channels {
            divided.push(divided.first().cloned().unwrap_or_default());
        }
        planes = Some(divided);
    }
    if let Some(coefficients) = sensor.vignetting {
        let factors = vignetting(coefficients, capture.camera.image_size, rows);
        let planes = planes.get_or_insert_with(|| vec![vec![1.0; factors.len()]; channels]);
        for plane in planes {
            plane.iter_mut().zip(&factors).for_each(|(x, f)| *x *= f);
        }
    }
    Ok(planes)
}

/// 1 + a r² + b r⁴ + c r⁶ at the pixels' centres, r from the image's centre, 1 at its corner.
fn vignetting([a, b, c]: [f64; 3], size: [u32; 2], rows: &Range<u32>) -> Vec<f32> {
    let [half_width, half_height] = size.map(|n| f64::from(n) / 2.0);
    let corner = half_width * half_width + half_height * half_height;
    let mut factors = Vec::with_capacity(size[0] as usize * rows.len());
    for y in rows.clone() {
        let dy = f64::from(y) + 0.5 - half_height;
        for x in 0..size[0] {
            let dx = f64::from(x) + 0.5 - half_width;
            let r2 = (dx * dx + dy * dy) / corner;
            factors.push((1.0 + r2 * (a + r2 * (b + r2 * c))) as f32);
        }
    }
    factors
}

/// Rows of a flat field, linear and above black. One stored like the photos goes through their
/// response and black level; a floating-point one beside integer photos is linear already.
fn flat(
    path: &Path,
    capture: &Capture,
    rows: Range<u32>,
    photos: Storage,
    response: &Response,
) -> Result<Vec<Vec<f32>>> {
    let mut frame = frame(path, capture, rows.clone())?;
    if frame.storage != photos {
        return Ok(frame.values);
    }
    let dark = dark(capture, &rows)?;
    for (c, plane) in frame.values.iter_mut().enumerate() {
        let dark = dark
            .as_ref()
            .and_then(|d| d.values.get(c).or(d.values.first()));
        for (i, x) in plane.iter_mut().enumerate() {
            let black = black(&capture.sensor, dark.and_then(|d| d.get(i)).copied());
            let linear = |v: f64| response.decode(v, c, photos).0;
            *x = (linear(f64::from(*x)) - linear(black)) as f32;
        }
    }
    Ok(frame.values)
}

/// The stored value of no light at a pixel.
pub(super) fn black(sensor: &Sensor, dark: Option<f32>) -> f64 {
    dark.map_or(sensor.black_level.unwrap_or(0.0), f64::from)
}

fn frame(path: &Path, capture: &Capture, rows: Range<u32>) -> Result<Photo> {
    of_size(path, capture.camera.image_size, rows)
}

/// Rows of a photo, frame or mask, which must have the camera's image size.
pub(super) fn of_size(path: &Path, size: [u32; 2], rows: Range<u32>) -> Result<Photo> {
    let wrong = |found: [u32; 2]| {
        let what = format!(
            "expected {} x {} pixels, as camera.image_size says, found {} x {}",
            size[0], size[1], found[0], found[1]
        );
        let error = Error::input(what).file(path);
        if found == [size[1], size[0]] && found != size {
            return error.advice("It lies on its side: turn it, or correct its orientation tag.");
        }
        error.advice("Photos, frames and masks of a capture have one size.")
    };
    match photo::read(path, Some(rows)) {
        Ok(frame) if frame.size == size => Ok(frame),
        Ok(frame) => Err(wrong(frame.size)),
        // A smaller frame has no such rows.
        Err(error) => Err(match photo::info(path) {
            Ok(info) if info.size != size => wrong(info.size),
            _ => error,
        }),
    }
}

/// Mean over the columns about the middle of all rows of a block.
fn centre_mean(block: &[f32], width: usize) -> f32 {
    let middle = width / 2;
    let columns = middle.saturating_sub(CENTRE as usize)..(middle + CENTRE as usize).min(width);
    let lit: Vec<f64> = block
        .chunks_exact(width.max(1))
        .filter_map(|row| row.get(columns.clone()))
        .flatten()
        .filter(|x| x.is_finite())
        .map(|&x| f64::from(x))
        .collect();
    (lit.iter().sum::<f64>() / lit.len() as f64) as f32
}
