//! Which views are fit to be used: a damaged photo among many, or one that cannot be of this object, is left out with a
//! warning, and the run goes on as if its view were not in the capture.

use crate::capture::Capture;
use crate::error::{Error, Kind, Result};
use crate::photo::Storage;
use crate::radiance::Odd;

use super::photographed::first_file;
use super::progress::Progress;

/// Part of the views that may be left out: with more, something is wrong with the set.
const MOST_LEFT_OUT: f64 = 0.25;
/// Views that must remain for any to be left out.
const LEAST_VIEWS: usize = 3;
/// Mean of the object, relative to the set's brightest, below which it is darker than black and not only noisy; and how
/// many standard errors it must be away from 0.
const DARKER_THAN_BLACK: (f64, f64) = (-0.01, 5.0);
/// Values are negative beyond noise if this part of a photo's lowest is below this part of the set's largest.
const STRONGLY_NEGATIVE: (f64, f64) = (0.01, -0.25);
/// A black photo between neighbours no further than this (degrees) that both show more than this part of the set's brightest
/// mean is no measurement: on a convex object light comes into view through the limb, and slowly.
const BLACK_BETWEEN: (f64, f64) = (60.0, 0.1);

/// What one view's photo shows at a glance: between the limbs, on the rows that were read.
#[derive(Clone, Debug)]
pub struct Look {
    /// Channel names.
    pub channels: Vec<String>,
    /// How the photo stores its values.
    pub storage: Storage,
    /// Values that are no measurement.
    pub odd: Odd,
    /// By channel.
    pub levels: Vec<Level>,
    /// Whether a mask hides a part of it.
    pub masked: bool,
}

/// Light of one channel on the object.
#[derive(Clone, Copy, Debug, Default)]
pub struct Level {
    /// Pixels of the object.
    pub pixels: usize,
    /// Those of them that are measurements.
    pub usable: usize,
    /// What the lowest hundredth of them stays below.
    pub low: f64,
    /// Mean of the usable ones.
    pub mean: f64,
    /// Standard error of the mean by their scatter.
    pub error: f64,
    /// The largest |value|.
    pub largest: f64,
}

impl Level {
    /// Of the object's pixels: `None` where a pixel is missing.
    pub fn of(values: impl Iterator<Item = Option<f64>>) -> Self {
        let mut pixels = 0;
        let counted = values.inspect(|_| pixels += 1);
        let mut usable: Vec<f64> = counted.flatten().collect();
        let n = usable.len();
        if n == 0 {
            return Self {
                pixels,
                ..Self::default()
            };
        }
        let mean = usable.iter().sum::<f64>() / n as f64;
        let squares: f64 = usable.iter().map(|v| (v - mean).powi(2)).sum();
        let lowest = (STRONGLY_NEGATIVE.0 * n as f64) as usize;
        let (_, low, _) = usable.select_nth_unstable_by(lowest.min(n - 1), f64::total_cmp);
        let low = *low;
        Self {
            pixels,
            usable: n,
            low,
            mean,
            error: squares.sqrt() / n as f64,
            largest: usable.iter().fold(0.0, |a, v| a.max(v.abs())),
        }
    }
}

/// The views of a capture that are used.
pub struct Usable {
    /// Their numbers in the capture.
    numbers: Vec<usize>,
    total: usize,
    /// What was left out, in words.
    pub notes: Vec<String>,
}

impl Usable {
    /// All of them.
    pub fn all(capture: &Capture) -> Self {
        Self {
            numbers: (0..capture.views.len()).collect(),
            total: capture.views.len(),
            notes: Vec::new(),
        }
    }

    /// The capture's number of a used view.
    pub fn number(&self, view: usize) -> usize {
        self.numbers.get(view).copied().unwrap_or(view)
    }

    /// The capture with these views only.
    pub fn of(&self, capture: &Capture) -> Capture {
        let views = self.numbers.iter().filter_map(|k| capture.views.get(*k));
        Capture {
            views: views.cloned().collect(),
            ..capture.clone()
        }
    }

    /// Leaves out the used views that cannot be; `None` if there were any, for then the others are to be read anew.
    ///
    /// # Errors
    /// If they are too many, or `progress` does not let the run go on.
    pub fn leave_out(
        &mut self,
        capture: &Capture,
        read: Vec<Result<Look>>,
        progress: &dyn Progress,
    ) -> Result<Option<Vec<Look>>> {
        let part = self.of(capture);
        let looks: Vec<Option<&Look>> = read.iter().map(|r| r.as_ref().ok()).collect();
        let mut senseless = senseless(&part, &looks);
        let mut faults: Vec<(usize, Error)> = Vec::new();
        let mut sound = Vec::with_capacity(read.len());
        for (view, read) in read.into_iter().enumerate() {
            let fault = match read {
                Err(error) if error.kind() == Kind::Failed => return Err(error),
                Err(error) => Some(error),
                Ok(look) => {
                    sound.push(look);
                    senseless.get_mut(view).and_then(Option::take)
                }
            };
            let number = self.number(view);
            faults.extend(fault.map(|fault| (view, fault.renumbered(number))));
        }
        if faults.is_empty() {
            return Ok(Some(sound));
        }
        let left_out = self.total - self.numbers.len() + faults.len();
        let rest = self.total - left_out;
        if left_out as f64 > MOST_LEFT_OUT * self.total as f64 || rest < LEAST_VIEWS {
            return Err(self.too_many(faults, left_out));
        }
        let mut unusable: Vec<usize> = Vec::new();
        for (view, fault) in faults {
            let said = fault.to_string().replace('\n', " ");
            progress.doubt(fault)?;
            self.notes.push(format!("A view was left out: {said}"));
            unusable.push(view);
        }
        let before = widest_gap(&part);
        let mut view = 0;
        self.numbers.retain(|_| {
            view += 1;
            !unusable.contains(&(view - 1))
        });
        let after = widest_gap(&self.of(capture));
        self.notes.push(format!(
            "{} of {} views remain; the widest gap between neighbouring views is {after:.1}° instead of {before:.1}°.",
            self.numbers.len(),
            self.total
        ));
        Ok(None)
    }

    /// Warnings of values that were not used in views that are.
    ///
    /// # Errors
    /// If `progress` does not let the run go on.
    pub fn odd_values(
        &self,
        capture: &Capture,
        looks: &[Look],
        progress: &dyn Progress,
    ) -> Result<Vec<String>> {
        let mut said = Vec::new();
        for (view, look) in looks.iter().enumerate() {
            for (count, what) in [(look.odd.nan, "NaN"), (look.odd.infinite, "infinite")] {
                if count == 0 {
                    continue;
                }
                let fault = Error::input(format!(
                    "{count} values between the object's limbs are {what} and were not used"
                ))
                .file(first_file(capture, view))
                .view(self.number(view));
                said.push(fault.to_string());
                progress.doubt(fault)?;
            }
        }
        Ok(said)
    }

    fn too_many(&self, faults: Vec<(usize, Error)>, left_out: usize) -> Error {
        let mut list: Vec<(Vec<usize>, Error)> = Vec::new();
        for (view, fault) in faults {
            let number = self.number(view);
            match list.iter_mut().find(|(_, other)| other.same_fault(&fault)) {
                Some((views, _)) => views.push(number),
                None => list.push((vec![number], fault)),
            }
        }
        let mut errors: Vec<Error> = list
            .into_iter()
            .map(|(views, fault)| match views.len() {
                1 => fault,
                n => {
                    let last = views.last().copied().unwrap_or(0);
                    fault.note(format!(
                        "The same holds for {n} views, the last of them view {last}."
                    ))
                }
            })
            .collect();
        if self.total > 1 {
            errors.push(Error::input(format!(
                "{left_out} of {} views cannot be used; a run goes on without them if they are no more than a quarter and {LEAST_VIEWS} remain",
                self.total
            )));
        }
        Error::all(errors).unwrap_or_else(|| Error::failed("no view can be used"))
    }
}

/// The widest angle between neighbouring views, degrees.
fn widest_gap(capture: &Capture) -> f64 {
    let mut angles: Vec<f64> = capture
        .views
        .iter()
        .map(|v| v.orbit.wrapped().deg())
        .collect();
    angles.sort_by(f64::total_cmp);
    let around = angles.first().map(|first| first + 360.0);
    let next = angles.iter().skip(1).copied().chain(around);
    angles
        .iter()
        .zip(next)
        .map(|(a, b)| b - a)
        .fold(0.0, f64::max)
}

/// The one of some values that most of them are; the first of several.
fn usual<T: PartialEq + Copy>(values: &[T]) -> Option<T> {
    let count = |value: &T| values.iter().filter(|v| *v == value).count();
    let mut best: Option<(usize, T)> = None;
    for value in values {
        let n = count(value);
        if best.is_none_or(|(most, _)| n > most) {
            best = Some((n, *value));
        }
    }
    best.map(|(_, value)| value)
}

/// How values are stored, in words; the two sizes of floating point are one.
fn stored(storage: Storage) -> String {
    match storage {
        Storage::Integer { max } => format!("integers of {} bits", 32 - max.leading_zeros()),
        Storage::Half | Storage::Float => "floating point".into(),
        Storage::SharedExponent => "floating point with a shared exponent".into(),
        Storage::Sensor { .. } => "a sensor's values".into(),
    }
}

/// What is wrong with each view, as far as its pixels and the other views show it.
fn senseless(capture: &Capture, looks: &[Option<&Look>]) -> Vec<Option<Error>> {
    let known: Vec<&Look> = looks.iter().flatten().copied().collect();
    let channels: Vec<&[String]> = known.iter().map(|l| l.channels.as_slice()).collect();
    let storages: Vec<String> = known.iter().map(|l| stored(l.storage)).collect();
    let storages: Vec<&str> = storages.iter().map(String::as_str).collect();
    let (usual_channels, usual_storage) = (usual(&channels), usual(&storages));
    let brightest = known
        .iter()
        .flat_map(|l| &l.levels)
        .fold(0.0_f64, |a, level| a.max(level.mean.abs()));
    let largest = known
        .iter()
        .flat_map(|l| &l.levels)
        .fold(0.0_f64, |a, level| a.max(level.largest));
    let black = |look: &Look| look.levels.iter().all(|l| l.usable > 0 && l.largest == 0.0);
    // A channel that no view measures.
    let blind = (0..usual_channels.map_or(0, <[String]>::len)).find(|c| {
        let unseen = |l: &&Look| l.levels.get(*c).is_some_and(|level| level.usable == 0);
        !known.is_empty() && known.iter().all(unseen)
    });
    let all_black = !known.is_empty() && known.iter().all(|l| black(l));
    looks
        .iter()
        .enumerate()
        .map(|(view, look)| {
            let look = (*look)?;
            let fault = |what: String| Some(Error::input(what).file(first_file(capture, view)));
            if let Some(usual) = usual_channels
                && look.channels != usual
            {
                return fault(format!(
                    "expected the channels {} as in the other views, found {}",
                    usual.join(", "),
                    look.channels.join(", ")
                ));
            }
            if let Some(usual) = usual_storage
                && stored(look.storage) != usual
            {
                return fault(format!(
                    "expected {usual} as in the other views, found {}",
                    stored(look.storage)
                ));
            }
            if let Some(what) = missing(capture, look) {
                return fault(what);
            }
            if let Some(c) = blind {
                let name = look.channels.get(c).map_or("", String::as_str);
                return fault(format!(
                    "channel {name}: no pixel of the object is finite and unclipped, in this view or any other"
                ));
            }
            if all_black {
                return fault("the photo is black: every pixel of the object is 0".into()).map(|e| {
                    e.advice("Was there light, was the lens open, and the exposure long enough?")
                });
            }
            let (least, errors) = DARKER_THAN_BLACK;
            let darker =
                |l: &Level| l.mean < least * brightest && l.mean < -errors * l.error;
            if look.levels.iter().all(darker) {
                let mean = look.levels.first().map_or(0.0, |l| l.mean);
                return fault(format!(
                    "the object is darker than black: its mean is negative, {mean:.3e} in the first channel"
                ))
                .map(|e| e.advice("Check sensor.black_level and the dark frame: what they subtract is more than the photo holds."));
            }
            let low = look.levels.iter().fold(0.0_f64, |a, l| a.min(l.low));
            if low < STRONGLY_NEGATIVE.1 * largest {
                return fault(format!(
                    "a part of the object is negative beyond any noise, down to {low:.3e} where the set's largest value is {largest:.3e}"
                ))
                .map(|e| e.advice("Light is not negative: check sensor.black_level, the dark frame, and what wrote the file."));
            }
            if black(look) && between_lit(capture, looks, view, brightest) {
                return fault(
                    "the photo is black, and its neighbours on both sides are not".into(),
                );
            }
            None
        })
        .collect()
}

/// Why no pixel of the object is a measurement, if so.
fn missing(capture: &Capture, look: &Look) -> Option<String> {
    if look.levels.iter().any(|l| l.usable > 0) {
        return None;
    }
    let pixels: usize = look.levels.iter().map(|l| l.pixels).sum();
    let Odd { nan, infinite, .. } = look.odd;
    Some(if u64::from(nan) + u64::from(infinite) > 0 {
        format!(
            "no pixel of the object has a finite value: of {pixels} values {nan} are NaN, {infinite} infinite, the rest clipped"
        )
    } else if look.masked {
        "no pixel of the object is left by its mask".into()
    } else if pixels == 0 {
        "no pixel of the object is in the picture".into()
    } else {
        let white = capture.sensor.white_level.map_or_else(
            || "the largest that the file can hold".into(),
            |w| format!("sensor.white_level = {w}"),
        );
        format!(
            "every pixel of the object is clipped: its stored values reach {white}, or it lies outside of the picture"
        )
    })
}

/// Whether the views next to a black one on both sides are bright.
fn between_lit(capture: &Capture, looks: &[Option<&Look>], view: usize, brightest: f64) -> bool {
    let (reach, share) = BLACK_BETWEEN;
    let Some(here) = capture.views.get(view) else {
        return false;
    };
    let mean = |look: &Look| look.levels.iter().fold(0.0_f64, |a, l| a.max(l.mean));
    let nearest = |sense: f64| {
        capture
            .views
            .iter()
            .zip(looks)
            .enumerate()
            .filter(|(k, (v, _))| *k != view && v.plane_roll == here.plane_roll)
            .filter_map(|(_, (v, look))| {
                let turn = sense * (v.orbit.rad() - here.orbit.rad());
                Some((turn.to_degrees().rem_euclid(360.0), (*look)?))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .filter(|(turn, _)| *turn <= reach)
            .map(|(_, look)| mean(look))
    };
    [1.0, -1.0]
        .into_iter()
        .all(|sense| nearest(sense).is_some_and(|mean| mean > share * brightest))
}
