//! The eight ways a picture may lie in its file (EXIF tag Orientation).

use std::ops::Range;

use super::Planes;
use crate::error::Result;

/// EXIF's Orientation, 1 to 8; 1 is upright.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Orientation(u8);

impl Orientation {
    pub(super) const UPRIGHT: Self = Self(1);

    /// The tag's meaning; anything but 1 to 8 is upright.
    pub(super) fn of(tag: u32) -> Self {
        match tag {
            2..=8 => Self(tag as u8),
            _ => Self::UPRIGHT,
        }
    }

    /// Whether rows of the file are columns of the picture.
    fn turned(self) -> bool {
        self.0 >= 5
    }

    /// The picture's size, given the file's.
    pub(super) fn size(self, [width, height]: [u32; 2]) -> [u32; 2] {
        if self.turned() {
            [height, width]
        } else {
            [width, height]
        }
    }

    /// Rows of the picture, from the file's pixels: `decode` gives planes of the file's rows and is
    /// asked for no more of them than are needed. `stored` is the file's width and height.
    pub(super) fn rows(
        self,
        stored: [u32; 2],
        rows: Range<u32>,
        decode: impl FnOnce(Range<u32>) -> Result<Planes>,
    ) -> Result<Planes> {
        let [width, height] = stored;
        let needed = match self.0 {
            1 | 2 => rows.clone(),
            3 | 4 => height - rows.end..height - rows.start,
            _ => 0..height,
        };
        let planes = decode(needed.clone())?;
        if self == Self::UPRIGHT {
            return Ok(planes);
        }
        let columns = self.size(stored)[0];
        let place = |x: u32, y: u32| match self.0 {
            2 => (width - 1 - x, y),
            3 => (width - 1 - x, height - 1 - y),
            4 => (x, height - 1 - y),
            5 => (y, x),
            6 => (y, height - 1 - x),
            7 => (width - 1 - y, height - 1 - x),
            _ => (width - 1 - y, x),
        };
        let turn = |plane: Vec<f32>| {
            rows.clone()
                .flat_map(|y| (0..columns).map(move |x| (x, y)))
                .map(|(x, y)| {
                    let (from_x, from_y) = place(x, y);
                    let index = (from_y - needed.start) as usize * width as usize + from_x as usize;
                    plane.get(index).copied().unwrap_or(f32::NAN)
                })
                .collect()
        };
        Ok(planes.into_iter().map(turn).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The picture that a file with this tag shows is the letter F whatever the tag: the files are
    /// the eight drawings of EXIF's specification.
    #[test]
    fn the_letter_f_stands_upright() {
        let upright = ["####", "#...", "###.", "#...", "#..."];
        let files: [&[&str]; 8] = [
            &upright,
            &["####", "...#", ".###", "...#", "...#"],
            &["...#", "...#", ".###", "...#", "####"],
            &["#...", "#...", "###.", "#...", "####"],
            &["#####", "#.#..", "#.#..", "#...."],
            &["#....", "#.#..", "#.#..", "#####"],
            &["....#", "..#.#", "..#.#", "#####"],
            &["#####", "..#.#", "..#.#", "....#"],
        ];
        for (tag, file) in (1..=8).zip(files) {
            let stored = [file[0].len() as u32, file.len() as u32];
            let orientation = Orientation::of(tag);
            assert_eq!(orientation.size(stored), [4, 5], "tag {tag}");
            for rows in [0..5, 1..3, 4..5] {
                let decode = |needed: Range<u32>| {
                    let text: String = file[needed.start as usize..needed.end as usize].concat();
                    Ok(vec![text.bytes().map(f32::from).collect()])
                };
                let planes = orientation.rows(stored, rows.clone(), decode).unwrap();
                let expected: Vec<f32> = upright[rows.start as usize..rows.end as usize]
                    .concat()
                    .bytes()
                    .map(f32::from)
                    .collect();
                assert_eq!(planes[0], expected, "tag {tag}, rows {rows:?}");
            }
        }
    }
}
