//! Colour maps that readers with any colour vision can order, and images made with them.

use std::fmt::Write as _;

use colorous::{CIVIDIS, VIRIDIS};

use super::scale::{Scale, bounds};
use crate::error::{Error, Result};

/// A colour map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColourMap {
    /// Values: dark blue over green to yellow.
    Viridis,
    /// Uncertainties and counts: dark blue over grey to yellow.
    Cividis,
    /// Signed values about zero: blue over white to orange-brown (after F. Crameri's *vik*).
    Vik,
}

/// Anchors of *vik* at equal steps (F. Crameri, "Scientific colour maps", MIT licence).
const VIK: [[u8; 3]; 10] = [
    [0x00, 0x12, 0x61],
    [0x03, 0x3e, 0x7d],
    [0x1e, 0x6f, 0x9d],
    [0x71, 0xa8, 0xc4],
    [0xc9, 0xdd, 0xe7],
    [0xea, 0xce, 0xbd],
    [0xd3, 0x97, 0x74],
    [0xbe, 0x65, 0x33],
    [0x8b, 0x27, 0x06],
    [0x59, 0x00, 0x08],
];

impl ColourMap {
    /// sRGB at `t` in 0..1.
    pub fn at(self, t: f64) -> [u8; 3] {
        let t = if t.is_finite() {
            t.clamp(0.0, 1.0)
        } else {
            0.0
        };
        match self {
            Self::Viridis => VIRIDIS.eval_continuous(t).as_array(),
            Self::Cividis => CIVIDIS.eval_continuous(t).as_array(),
            Self::Vik => {
                let position = t * (VIK.len() - 1) as f64;
                let i = (position as usize).min(VIK.len() - 2);
                let part = position - i as f64;
                let mix = |k: usize| {
                    let (a, b) = (f64::from(VIK[i][k]), f64::from(VIK[i + 1][k]));
                    (a + (b - a) * part).round() as u8
                };
                [mix(0), mix(1), mix(2)]
            }
        }
    }

    /// Name in ids of gradients.
    pub fn name(self) -> &'static str {
        match self {
            Self::Viridis => "viridis",
            Self::Cividis => "cividis",
            Self::Vik => "vik",
        }
    }

    /// SVG gradients of all maps, to be put once into the page.
    pub fn gradients() -> String {
        let mut out = String::new();
        for map in [Self::Viridis, Self::Cividis, Self::Vik] {
            for (suffix, ends) in [("h", "x2='1' y2='0'"), ("v", "y1='1' x2='0' y2='0'")] {
                let colours: String = (0..255)
                    .filter(|_| suffix == "h")
                    .flat_map(|k| map.at(f64::from(k) / 254.0))
                    .map(|byte| format!("{byte:02x}"))
                    .collect();
                let _ = write!(
                    out,
                    "<linearGradient id='{}-{suffix}' {ends} data-colours='{colours}'>",
                    map.name()
                );
                for k in 0..=24 {
                    let [r, g, b] = map.at(f64::from(k) / 24.0);
                    let _ = write!(
                        out,
                        "<stop offset='{:.4}' stop-color='#{r:02x}{g:02x}{b:02x}'/>",
                        f64::from(k) / 24.0
                    );
                }
                out.push_str("</linearGradient>");
            }
        }
        out
    }
}

/// An indexed PNG as a `data:` URI: colour 0 is transparent (missing), 1…255 span the map.
///
/// `values` is row-major, `columns` × `rows`, the top row first; what is not finite is missing.
///
/// # Errors
/// If the sizes do not agree or the encoder fails.
pub fn indexed_png(
    values: &[f64],
    columns: usize,
    rows: usize,
    scale: &Scale,
    map: ColourMap,
) -> Result<String> {
    if columns * rows != values.len() || values.is_empty() {
        return Err(Error::failed(format!(
            "an image of {columns} × {rows} cells was given {} values",
            values.len()
        )));
    }
    let indices: Vec<u8> = values
        .iter()
        .map(|&v| {
            if v.is_finite() {
                1 + (scale.position(v).clamp(0.0, 1.0) * 254.0).round() as u8
            } else {
                0
            }
        })
        .collect();
    let mut palette = vec![0u8; 3];
    for k in 0..255 {
        palette.extend(map.at(f64::from(k) / 254.0));
    }
    encode([columns, rows], &indices, Some(palette))
}

/// Values and σ for the script, packed into the bytes of an image that a canvas gives back exactly.
#[derive(Debug)]
pub struct Packed {
    /// The PNG.
    pub uri: String,
    /// Least and largest value.
    pub values: [f64; 2],
    /// Least and largest σ.
    pub sigma: [f64; 2],
}

/// Packs values (12 bits, as their square root above the least, so that the step follows shot noise:
/// 0.05 % of the largest value at most) into red and the upper half of green, and σ (8 bits,
/// logarithmic) into blue. A blue of 0 marks a missing value.
///
/// # Errors
/// If the encoder fails or the sizes do not agree.
pub fn packed_png(values: &[f64], sigma: &[f64], cells: [usize; 2]) -> Result<Packed> {
    let (low, high) = bounds(values.iter().copied());
    let (s0, s1) = bounds(sigma.iter().copied().filter(|s| *s > 0.0));
    let range = (high - low).max(f64::MIN_POSITIVE);
    let ratio = (s1 / s0).ln().max(1e-12);
    let mut bytes = Vec::with_capacity(values.len() * 3);
    for (value, sigma) in values.iter().zip(sigma) {
        if !value.is_finite() {
            bytes.extend([0, 0, 0]);
            continue;
        }
        let code = (((value - low) / range).max(0.0).sqrt() * 4095.0).round() as u16;
        let t = if *sigma > 0.0 {
            (sigma / s0).ln() / ratio
        } else {
            0.0
        };
        bytes.extend([
            (code >> 4) as u8,
            ((code & 15) << 4) as u8,
            1 + (t.clamp(0.0, 1.0) * 254.0).round() as u8,
        ]);
    }
    if sigma.len() != values.len() || values.len() != cells[0] * cells[1] {
        return Err(Error::failed(
            "values, σ and cells of an image differ in number",
        ));
    }
    Ok(Packed {
        uri: encode(cells, &bytes, None)?,
        values: [low, high],
        sigma: [s0, s1],
    })
}

/// A PNG of palette indices (colour 0 transparent) or, without a palette, of RGB bytes.
fn encode(cells: [usize; 2], bytes: &[u8], palette: Option<Vec<u8>>) -> Result<String> {
    let failed = |e: png::EncodingError| Error::failed(format!("cannot encode a plot's PNG: {e}"));
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, cells[0] as u32, cells[1] as u32);
    encoder.set_depth(png::BitDepth::Eight);
    // A tenth larger than the balanced level, in a third of the time.
    encoder.set_compression(png::Compression::Fast);
    if let Some(palette) = palette {
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_palette(palette);
        encoder.set_trns(vec![0u8]);
    } else {
        encoder.set_color(png::ColorType::Rgb);
    }
    // Indices of a palette have no neighbourhood that a filter could use; noise has none either.
    encoder.set_filter(png::Filter::NoFilter);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(bytes).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(data_uri("image/png", &out))
}

/// Bytes as a base64 `data:` URI.
pub fn data_uri(kind: &str, bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(kind.len() + 13 + bytes.len().div_ceil(3) * 4);
    let _ = write!(out, "data:{kind};base64,");
    for chunk in bytes.chunks(3) {
        let word = chunk
            .iter()
            .enumerate()
            .fold(0u32, |w, (k, b)| w | u32::from(*b) << (16 - 8 * k));
        for k in 0..4 {
            if k <= chunk.len() {
                let digit = (word >> (18 - 6 * k)) & 63;
                out.push(char::from(DIGITS[digit as usize]));
            } else {
                out.push('=');
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_follows_the_standard_vectors() {
        // RFC 4648, section 10.
        for (text, code) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(
                data_uri("x", text.as_bytes()),
                format!("data:x;base64,{code}")
            );
        }
    }

    #[test]
    fn maps_for_values_grow_lighter_all_the_way() {
        // Lightness order is what survives a photocopier and any colour vision.
        let luma = |[r, g, b]: [u8; 3]| {
            0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
        };
        for map in [ColourMap::Viridis, ColourMap::Cividis] {
            for k in 0..32 {
                let (a, b) = (f64::from(k) / 32.0, f64::from(k + 1) / 32.0);
                // 8-bit rounding moves luma by at most 0.5.
                assert!(luma(map.at(b)) > luma(map.at(a)) - 0.5, "{map:?} at {a}");
            }
        }
        // The diverging map is lightest at zero and darkens evenly to both sides.
        let middle = luma(ColourMap::Vik.at(0.5));
        assert!(middle > 200.0);
        assert!(luma(ColourMap::Vik.at(0.0)) < 40.0 && luma(ColourMap::Vik.at(1.0)) < 40.0);
    }

    #[test]
    fn an_image_decodes_to_the_colours_of_its_values() -> Result<()> {
        let values = [0.0, f64::NAN, 1.0, 0.5];
        let uri = indexed_png(&values, 2, 2, &Scale::linear(0.0, 1.0), ColourMap::Viridis)?;
        let bytes = decode_base64(uri.trim_start_matches("data:image/png;base64,"));
        let image = image::load_from_memory(&bytes).expect("a PNG").to_rgba8();
        assert_eq!(image.get_pixel(1, 0).0[3], 0);
        let [r, g, b] = ColourMap::Viridis.at(1.0);
        assert_eq!(image.get_pixel(0, 1).0, [r, g, b, 255]);
        let [r, g, b] = ColourMap::Viridis.at(0.0);
        assert_eq!(image.get_pixel(0, 0).0, [r, g, b, 255]);
        assert!(indexed_png(&values, 3, 2, &Scale::linear(0.0, 1.0), ColourMap::Vik).is_err());
        Ok(())
    }

    #[test]
    fn packed_values_come_back_within_their_step() -> Result<()> {
        let values: Vec<f64> = (0..100).map(|k| 0.02 + 0.05 * f64::from(k)).collect();
        let mut sigma: Vec<f64> = values.iter().map(|v| 0.01 * v.sqrt()).collect();
        sigma[7] = 0.0;
        let mut holed = values.clone();
        holed[3] = f64::NAN;
        let packed = packed_png(&holed, &sigma, [10, 10])?;
        let bytes = decode_base64(packed.uri.trim_start_matches("data:image/png;base64,"));
        let image = image::load_from_memory(&bytes).expect("a PNG").to_rgb8();
        let [low, high] = packed.values;
        let ratio = packed.sigma[1] / packed.sigma[0];
        for (k, pixel) in image.pixels().enumerate() {
            let [r, g, b] = pixel.0;
            if k == 3 {
                assert_eq!(b, 0);
                continue;
            }
            let t = f64::from(u16::from(r) << 4 | u16::from(g) >> 4) / 4095.0;
            let value = low + (high - low) * t * t;
            // Half a step of t moves t² by t/4095 and a little more at zero.
            let step = (high - low) * (t / 4095.0 + 0.25 / 4095.0f64.powi(2));
            assert!(
                (value - values[k]).abs() <= 1.001 * step,
                "{value} {}",
                values[k]
            );
            if sigma[k] > 0.0 {
                let s = packed.sigma[0] * ratio.powf(f64::from(b - 1) / 254.0);
                // Half a step of 254 over the logarithmic range.
                assert!((s / sigma[k]).ln().abs() <= 0.501 * ratio.ln() / 254.0);
            }
        }
        Ok(())
    }

    fn decode_base64(text: &str) -> Vec<u8> {
        let value = |c: u8| match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            _ => 63,
        };
        let mut out = Vec::new();
        for chunk in text.as_bytes().chunks(4) {
            let word = chunk
                .iter()
                .fold(0u32, |w, &c| w << 6 | u32::from(value(c)));
            out.extend_from_slice(&word.to_be_bytes()[1..]);
        }
        out
    }
}
