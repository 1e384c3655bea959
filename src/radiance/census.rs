//! Stored values that are no measurement: not a number, infinite, below 0.

use crate::photo::{Photo, Storage};

/// Values of one image column that are no measurement, over all channels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Odd {
    /// Not a number: the file holds no value there.
    pub nan: u32,
    /// Infinite.
    pub infinite: u32,
    /// Below 0.
    pub negative: u32,
}

impl std::ops::AddAssign for Odd {
    fn add_assign(&mut self, other: Self) {
        self.nan = self.nan.saturating_add(other.nan);
        self.infinite = self.infinite.saturating_add(other.infinite);
        self.negative = self.negative.saturating_add(other.negative);
    }
}

/// The odd values of a photo's rows by column.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// \[column\]; empty if every value is a measurement.
    columns: Vec<Odd>,
}

impl Census {
    /// Counts a photo's odd values. A sensor's values lie about its black level and at its filters' sites: none of them is
    /// odd.
    pub(super) fn of(photo: &Photo) -> Self {
        let sound = |v: &f32| *v >= 0.0 && *v < f32::INFINITY;
        // Without a branch in it, so that sound photos pass at the speed of memory.
        let all = |plane: &Vec<f32>| {
            pulp::Arch::new().dispatch(|| plane.iter().fold(true, |all, v| all & sound(v)))
        };
        if matches!(photo.storage, Storage::Sensor { .. }) || photo.values.iter().all(all) {
            return Self::default();
        }
        let width = (photo.size[0] as usize).max(1);
        let mut columns = vec![Odd::default(); width];
        for plane in &photo.values {
            for row in plane.chunks(width) {
                for (odd, value) in columns.iter_mut().zip(row) {
                    odd.nan += u32::from(value.is_nan());
                    odd.infinite += u32::from(value.is_infinite());
                    odd.negative += u32::from(*value < 0.0);
                }
            }
        }
        Self { columns }
    }

    /// Adds another photo of the same view.
    pub(super) fn add(&mut self, other: &Self) {
        if self.columns.is_empty() {
            self.columns.clone_from(&other.columns);
            return;
        }
        for (sum, odd) in self.columns.iter_mut().zip(&other.columns) {
            *sum += *odd;
        }
    }

    /// The odd values of some columns.
    pub fn between(&self, columns: std::ops::Range<usize>) -> Odd {
        let mut sum = Odd::default();
        let end = columns.end.min(self.columns.len());
        for odd in self.columns.get(columns.start.min(end)..end).unwrap_or(&[]) {
            sum += *odd;
        }
        sum
    }
}
