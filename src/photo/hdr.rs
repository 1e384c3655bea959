//! Radiance HDR (RGBE), with the EXPOSURE and COLORCORR lines undone and all eight orders of pixels.
//!
//! The format is that of the Radiance file formats manual and its `color.c`: three mantissas m
//! with a shared exponent e stand for (m + ½) 2^(e − 136).

use std::io::{BufRead, BufReader, Read};
use std::ops::Range;

use super::orientation::Orientation;
use super::{Format, Header, Opened, Planes, Shot, Storage, believable, plausible};
use crate::error::{Error, Result};
use crate::files::Input;

/// The longest line of the header that is read, bytes.
const LONGEST_LINE: u64 = 4096;

/// The most header lines.
const MOST_LINES: usize = 1000;

pub(super) fn open(opened: Opened) -> Result<(Header, impl FnOnce(Range<u32>) -> Result<Planes>)> {
    let bytes = opened.bytes;
    let mut reader = opened.reader;
    let mut scale = [1.0_f64; 3];
    for _ in 0..MOST_LINES {
        let text = line(&mut reader)?;
        if text.is_empty() {
            break;
        }
        if let Some(("FORMAT", format)) = text.split_once('=')
            && format.trim() != "32-bit_rle_rgbe"
        {
            return Err(Error::input(format!(
                "expected the format 32-bit_rle_rgbe, found {}",
                format.trim()
            )));
        }
        for (c, factor) in factors(&text)?.into_iter().enumerate() {
            scale[c] /= factor;
        }
    }
    let text = line(&mut reader)?;
    let (stored, orientation) = resolution(&text).ok_or_else(|| {
        Error::input(format!(
            "expected a size such as -Y 240 +X 960, found \"{}\"",
            text.chars().take(40).collect::<String>()
        ))
    })?;
    believable(stored, 32, bytes)?;
    let header = Header {
        format: Format::Hdr,
        stored,
        orientation,
        channels: ["R", "G", "B"].map(String::from).to_vec(),
        storage: Storage::SharedExponent,
        shot: Shot::default(),
    };
    Ok((header, move |rows: Range<u32>| {
        let width = stored[0] as usize;
        plausible((12 * width * rows.len()) as u64, bytes)?;
        let mut planes: Planes = (0..3)
            .map(|_| Vec::with_capacity(width * rows.len()))
            .collect();
        let mut pixels = Vec::new();
        for y in 0..rows.end {
            scan_line(&mut reader, width, &mut pixels)?;
            if y >= rows.start {
                for pixel in &pixels {
                    for (c, plane) in planes.iter_mut().enumerate() {
                        plane.push(value(pixel[c], pixel[3], scale[c]));
                    }
                }
            }
        }
        Ok(planes)
    }))
}

fn value(mantissa: u8, exponent: u8, scale: f64) -> f32 {
    if exponent == 0 {
        return 0.0;
    }
    ((f64::from(mantissa) + 0.5) * (f64::from(exponent) - 136.0).exp2() * scale) as f32
}

fn truncated(_: std::io::Error) -> Error {
    Error::input("the HDR file is truncated: it ends before its pixels do")
}

fn line(reader: &mut BufReader<Input>) -> Result<String> {
    let mut bytes = Vec::new();
    reader
        .by_ref()
        .take(LONGEST_LINE)
        .read_until(b'\n', &mut bytes)
        .map_err(truncated)?;
    if bytes.pop() != Some(b'\n') {
        return Err(Error::input(
            "the HDR file is damaged: its header does not end",
        ));
    }
    Ok(String::from_utf8_lossy(&bytes).trim_end().to_string())
}

/// What a header line says the pixels were multiplied by, for R, G and B.
fn factors(text: &str) -> Result<[f64; 3]> {
    let (key, value) = text.split_once('=').unwrap_or((text, ""));
    let numbers: Vec<f64> = value
        .split_whitespace()
        .filter_map(|n| n.parse().ok())
        .collect();
    let factors = match (key.trim(), numbers.as_slice()) {
        ("EXPOSURE", [all]) => [*all; 3],
        ("COLORCORR", [r, g, b]) => [*r, *g, *b],
        ("EXPOSURE" | "COLORCORR", _) => [f64::NAN; 3],
        _ => [1.0; 3],
    };
    if !factors.iter().all(|f| f.is_finite() && *f > 0.0) {
        return Err(Error::input(format!(
            "expected factors above 0, found \"{text}\""
        )));
    }
    Ok(factors)
}

/// Width and height of the stored lines, and how they lie in the picture.
fn resolution(text: &str) -> Option<([u32; 2], Orientation)> {
    let parts: Vec<&str> = text.split_whitespace().collect();
    let &[first, lines, second, length] = parts.as_slice() else {
        return None;
    };
    // Y grows upwards: "-Y" is from the top to the bottom.
    let tag = match (first, second) {
        ("-Y", "+X") => 1,
        ("-Y", "-X") => 2,
        ("+Y", "-X") => 3,
        ("+Y", "+X") => 4,
        ("+X", "-Y") => 5,
        ("-X", "-Y") => 6,
        ("-X", "+Y") => 7,
        ("+X", "+Y") => 8,
        _ => return None,
    };
    let side = |n: &str| n.parse::<u32>().ok().filter(|n| (1..=1 << 20).contains(n));
    Some(([side(length)?, side(lines)?], Orientation::of(tag)))
}

/// Reads one line of pixels: new run-length code, old run-length code or none.
fn scan_line(reader: &mut BufReader<Input>, width: usize, pixels: &mut Vec<[u8; 4]>) -> Result<()> {
    pixels.clear();
    let mut start = [0; 4];
    reader.read_exact(&mut start).map_err(truncated)?;
    let coded = start[0] == 2
        && start[1] == 2
        && usize::from(u16::from_be_bytes([start[2], start[3]])) == width
        && (8..32768).contains(&width);
    if coded {
        pixels.resize(width, [0; 4]);
        for c in 0..4 {
            component(reader, c, pixels)?;
        }
        return Ok(());
    }
    // Old code: (1, 1, 1, n) repeats the last pixel n times, the next such 256 n times.
    let mut shift = 0;
    loop {
        if start[..3] == [1, 1, 1] {
            let count = usize::from(start[3]) << shift;
            let last = *pixels.last().ok_or_else(bad_run)?;
            if shift > 16 || pixels.len() + count > width {
                return Err(bad_run());
            }
            pixels.resize(pixels.len() + count, last);
            shift += 8;
        } else {
            pixels.push(start);
            shift = 0;
        }
        if pixels.len() == width {
            return Ok(());
        }
        reader.read_exact(&mut start).map_err(truncated)?;
    }
}

/// One component of a line in the new code: runs above 128, literals up to it.
fn component(reader: &mut BufReader<Input>, c: usize, pixels: &mut [[u8; 4]]) -> Result<()> {
    let mut buffer = [0; 128];
    let mut rest = pixels;
    while !rest.is_empty() {
        let mut count = [0];
        reader.read_exact(&mut count).map_err(truncated)?;
        let (length, literals) = match usize::from(count[0]) {
            0 => return Err(bad_run()),
            n @ 1..=128 => (n, n),
            n => (n - 128, 1),
        };
        let bytes = buffer.get_mut(..literals).ok_or_else(bad_run)?;
        reader.read_exact(bytes).map_err(truncated)?;
        let (run, after) = rest.split_at_mut_checked(length).ok_or_else(bad_run)?;
        for (pixel, byte) in run.iter_mut().zip(bytes.iter().cycle()) {
            pixel[c] = *byte;
        }
        rest = after;
    }
    Ok(())
}

fn bad_run() -> Error {
    Error::input("the HDR file is damaged: a run of pixels does not fit its line")
}
