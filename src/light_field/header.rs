//! The attributes of an EXR header in one order, so that the same content is the same bytes.
//!
//! The exr crate keeps additional attributes in a hash map and writes them in an order that changes with every
//! run. Sorting them in the encoded bytes changes no length, so that the offsets of all blocks stay true.

/// Bytes of magic number and version before the first attribute.
const START: usize = 8;
/// Bit of the version field that says that the file has several parts.
const MULTI_PART: u8 = 0x10;

/// Sorts the attributes of every part's header by name. Bytes that are not laid out as an EXR file are left
/// as they are from the first such place on.
pub fn sort_attributes(bytes: &mut [u8]) {
    let parts = bytes.get(5).map_or(0, |flags| flags & MULTI_PART) != 0;
    let mut start = START;
    // An empty header ends the headers of a file with several parts.
    while let Some(attributes) = attributes(bytes, start).filter(|a| !a.is_empty()) {
        let mut sorted: Vec<&[u8]> = attributes
            .iter()
            .map(|range| &bytes[range.clone()])
            .collect();
        sorted.sort_by_key(|attribute| attribute.split(|b| *b == 0).next());
        let sorted = sorted.concat();
        let end = start + sorted.len();
        bytes[start..end].copy_from_slice(&sorted);
        if !parts {
            return;
        }
        start = end + 1;
    }
}

/// Where each attribute of the header at `start` stands: name, type, both ended by 0, length of the value as 32
/// bits, value; a 0 ends the header.
fn attributes(bytes: &[u8], start: usize) -> Option<Vec<std::ops::Range<usize>>> {
    let mut attributes = Vec::new();
    let mut at = start;
    while *bytes.get(at)? != 0 {
        let word = |from: usize| Some(from + bytes.get(from..)?.iter().position(|b| *b == 0)? + 1);
        let length_at = word(word(at)?)?;
        let length = bytes.get(length_at..length_at + 4)?.first_chunk()?;
        let end = length_at + 4 + usize::try_from(u32::from_le_bytes(*length)).ok()?;
        bytes.get(at..end)?;
        attributes.push(at..end);
        at = end;
    }
    Some(attributes)
}

#[cfg(test)]
mod tests {
    use super::super::{Part, encode};

    /// A new hash map for every file: ten attributes come in one of 3.6 million orders.
    #[test]
    fn the_same_content_is_the_same_bytes() {
        let part = |name: &str| Part {
            name: name.into(),
            size: [40, 30],
            planes: vec![("Y".into(), vec![0.5; 1200].into())],
            texts: (0..5)
                .map(|k| (format!("text{k}"), "x".repeat(k)))
                .collect(),
            numbers: (0..5).map(|k| (format!("number{k}"), k as f32)).collect(),
        };
        let once = encode(&[part("a")]).expect("encodes");
        let twice = encode(&[part("a"), part("b")]).expect("encodes");
        for _ in 0..5 {
            assert!(encode(&[part("a")]).expect("encodes") == once);
            assert!(encode(&[part("a"), part("b")]).expect("encodes") == twice);
        }
    }

    #[test]
    fn damaged_bytes_are_left_alone() {
        let mut bytes = vec![7u8; 64];
        super::sort_attributes(&mut bytes);
        assert_eq!(bytes, vec![7u8; 64]);
        super::sort_attributes(&mut []);
    }
}
