//! Whether the directories of a RAW file in the form of a TIFF fit into it: `rawler` makes room for what an entry declares before it
//! looks for it, and memory that is not there ends a program.

use std::io::{Read, Seek, SeekFrom};

use crate::error::{Error, Result};

/// Most directories that are looked at; cameras write a dozen.
const MOST: usize = 100;

/// Tags whose values are places of further directories: pictures, EXIF, position, interoperability.
const FURTHER: [u32; 4] = [330, 34665, 34853, 40965];

/// Looks at all directories that can be reached; whatever is no TIFF passes.
///
/// # Errors
/// An entry declares more bytes than the file has.
pub(super) fn check(file: &mut (impl Read + Seek), bytes: u64) -> Result<()> {
    let mut start = [0; 8];
    if file.read_exact(&mut start).is_err() {
        return Ok(());
    }
    let little = match &start[..2] {
        b"II" => true,
        b"MM" => false,
        _ => return Ok(()),
    };
    let number = |bytes: &[u8]| {
        let digit = |value: u32, byte: &u8| (value << 8) | u32::from(*byte);
        match little {
            true => bytes.iter().rev().fold(0, digit),
            false => bytes.iter().fold(0, digit),
        }
    };
    let mut places = vec![number(&start[4..])];
    let mut looked = 0;
    while let (Some(place), true) = (places.pop(), looked < MOST) {
        looked += 1;
        let Some(count) = part(file, place, 2).filter(|count| count.len() == 2) else {
            continue;
        };
        let length = 12 * u64::from(number(&count));
        let Some(entries) = part(file, place.saturating_add(2), length + 4) else {
            continue;
        };
        let (entries, rest) = entries.split_at(entries.len().min(length as usize));
        for entry in entries.chunks_exact(12) {
            let (tag, kind, count) = (
                number(&entry[..2]),
                number(&entry[2..4]),
                number(&entry[4..8]),
            );
            let unit = match kind {
                1 | 2 | 6 | 7 => 1,
                3 | 8 => 2,
                4 | 9 | 11 | 13 => 4,
                _ => 8,
            };
            let size = u64::from(count) * unit;
            if size > bytes {
                return Err(Error::input(format!(
                    "the file is damaged: its entry {tag} declares {size} bytes, more than all of its {bytes}"
                )));
            }
            if FURTHER.contains(&tag) {
                let inside = size <= 4;
                let list = match inside {
                    true => Some(entry[8..].to_vec()),
                    false => part(file, number(&entry[8..]), size.min(4 * MOST as u64)),
                };
                places.extend(list.unwrap_or_default().chunks_exact(4).map(number));
            }
        }
        places.extend(rest.get(..4).map(number).filter(|next| *next != 0));
    }
    Ok(())
}

/// So many bytes from a place on, or as many as there are.
fn part(file: &mut (impl Read + Seek), place: u32, length: u64) -> Option<Vec<u8>> {
    file.seek(SeekFrom::Start(place.into())).ok()?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// A directory of one entry of so many bytes, in a directory behind the first.
    fn file(count: u32) -> Vec<u8> {
        let mut file = b"MM\0*\0\0\0\x08\0\0".to_vec();
        file.extend(14_u32.to_be_bytes());
        file.extend([0, 1, 0, 50, 0, 1]);
        file.extend(count.to_be_bytes());
        file.extend([0; 8]);
        file
    }

    #[test]
    fn what_is_larger_than_the_file_is_refused() {
        let look = |file: &[u8]| check(&mut Cursor::new(file), file.len() as u64);
        assert!(look(&file(4)).is_ok());
        let error = look(&file(1000)).unwrap_err().to_string();
        assert!(error.contains("entry 50 declares 1000 bytes"), "{error}");
        // Whatever is cut off is for the decoder to say; directories in a ring come to an end.
        for length in 0..20 {
            assert!(look(&file(1000)[..length]).is_ok());
        }
        let mut ring = file(4);
        ring[10..14].copy_from_slice(&8_u32.to_be_bytes());
        assert!(look(&ring).is_ok());
    }
}
