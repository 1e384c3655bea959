//! ZIP blocks of OpenEXR: of what is inflated only the wanted values are put together.
//!
//! A block is the lines' bytes, each line channel by channel, with all bytes of even place before all of odd place, and of all that
//! the differences of neighbours plus 128, deflated (OpenEXR, "Technical introduction", and its `ImfZip`).

use std::ops::Range;

use exr::meta::attribute::SampleType;
use libdeflater::Decompressor;

use crate::error::{Error, Result};

/// Inflates blocks one after another into the same memory.
pub(super) struct Inflater {
    decompressor: Decompressor,
    bytes: Vec<u8>,
}

/// The bytes of an inflated block, still apart by even and odd place.
pub(super) struct Apart<'a> {
    bytes: &'a [u8],
}

impl Inflater {
    pub(super) fn new() -> Self {
        Self {
            decompressor: Decompressor::new(),
            bytes: Vec::new(),
        }
    }

    /// Inflates a block of `size` bytes.
    ///
    /// # Errors
    /// If the bytes are no deflated block of this size.
    pub(super) fn inflate(&mut self, deflated: &[u8], size: usize) -> Result<Apart<'_>> {
        // Of a former block's bytes those that stay are written over.
        self.bytes.resize(size, 0);
        let found = self
            .decompressor
            .zlib_decompress(deflated, &mut self.bytes)
            .map_err(|_| Error::input("the EXR is damaged: a ZIP block cannot be inflated"))?;
        if found != size {
            return Err(Error::input(format!(
                "the EXR is damaged: expected a block of {size} bytes, found {found}"
            )));
        }
        undo_differences(&mut self.bytes);
        Ok(Apart { bytes: &self.bytes })
    }
}

impl Apart<'_> {
    /// The samples of one kind whose bytes lie at `place` of the block, as f32.
    pub(super) fn decode(&self, place: Range<usize>, kind: SampleType, out: &mut [f32]) {
        // Samples have an even number of bytes and begin at an even place.
        let (even, odd) = self.bytes.split_at(self.bytes.len().div_ceil(2));
        let halves = place.start / 2..place.end / 2;
        if let (Some(even), Some(odd)) = (even.get(halves.clone()), odd.get(halves)) {
            pulp::Arch::new().dispatch(Joined {
                even,
                odd,
                kind,
                out,
            });
        }
    }
}

/// Every byte but the first is the difference from the one before plus 128: puts the sums in their place, eight bytes at a time.
fn undo_differences(bytes: &mut [u8]) {
    const EACH: u64 = 0x0001_0001_0001_0001;
    const LOW: u64 = 0x00ff_00ff_00ff_00ff;
    if let Some(first) = bytes.first_mut() {
        // As if it were a difference from 0, too.
        *first = first.wrapping_add(128);
    }
    let (eights, rest) = bytes.as_chunks_mut::<8>();
    let mut sum: u64 = 0;
    for eight in eights {
        let differences = u64::from_le_bytes(*eight) ^ 0x8080_8080_8080_8080;
        // In four fields of 16 bits no sum of eight bytes and a byte runs over.
        let second = (differences >> 8) & LOW;
        let pairs = (differences & LOW) + second;
        let own = pairs.wrapping_mul(EACH);
        let up_to_second = own + sum * EACH;
        let up_to_first = up_to_second - second;
        *eight = ((up_to_first & LOW) | ((up_to_second & LOW) << 8)).to_le_bytes();
        // All that the next eight wait for is this addition.
        sum = (sum + (own >> 48)) & 0xff;
    }
    let mut sum = sum as u8;
    for byte in rest {
        sum = sum.wrapping_add(*byte ^ 0x80);
        *byte = sum;
    }
}

/// Puts the bytes of samples together, for the processor's widest instructions.
struct Joined<'a> {
    even: &'a [u8],
    odd: &'a [u8],
    kind: SampleType,
    out: &'a mut [f32],
}

impl pulp::NullaryFnOnce for Joined<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            even,
            odd,
            kind,
            out,
        } = self;
        match kind {
            SampleType::F16 => {
                for ((out, &even), &odd) in out.iter_mut().zip(even).zip(odd) {
                    *out = half(u16::from_le_bytes([even, odd]));
                }
            }
            SampleType::F32 | SampleType::U32 => {
                let pairs = even.as_chunks::<2>().0.iter().zip(odd.as_chunks::<2>().0);
                let words = pairs.map(|(e, o)| u32::from_le_bytes([e[0], o[0], e[1], o[1]]));
                if kind == SampleType::F32 {
                    for (out, word) in out.iter_mut().zip(words) {
                        *out = f32::from_bits(word);
                    }
                } else {
                    for (out, word) in out.iter_mut().zip(words) {
                        *out = word as f32;
                    }
                }
            }
        }
    }
}

/// The value of a half-precision number by its bits, without a branch.
#[inline(always)]
pub(super) fn half(bits: u16) -> f32 {
    const EXPONENT: u32 = 0x1f << 23;
    /// What the bias of a half's exponent lacks.
    const BIAS: u32 = 112 << 23;
    let magnitude = u32::from(bits & 0x7fff) << 13;
    let normal = magnitude + BIAS;
    // 2⁻¹⁴ + magnitude, less 2⁻¹⁴.
    let subnormal = f32::from_bits(normal + (1 << 23)) - f32::from_bits(BIAS + (1 << 23));
    let value = match magnitude & EXPONENT {
        0 => subnormal.to_bits(),
        EXPONENT => normal + BIAS,
        _ => normal,
    };
    f32::from_bits(value | (u32::from(bits & 0x8000) << 16))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_half_has_its_value() {
        for bits in 0..=u16::MAX {
            let expected = exr::prelude::f16::from_bits(bits).to_f32();
            let found = half(bits);
            assert!(
                found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan(),
                "{bits:#06x}: {found} instead of {expected}"
            );
        }
    }

    #[test]
    fn differences_are_summed_as_one_by_one() {
        for length in [0, 1, 7, 8, 9, 64, 1000] {
            let bytes: Vec<u8> = (0..length).map(|i| (i * i * 7 + i / 3) as u8).collect();
            let mut expected = bytes.clone();
            for i in 1..length {
                expected[i] = expected[i - 1].wrapping_add(bytes[i]).wrapping_sub(128);
            }
            let mut found = bytes;
            undo_differences(&mut found);
            assert_eq!(found, expected);
        }
    }
}
