//! Which candidates belong to the limb: the ones that all bands of a side, and both sides, agree on.

use super::edge::Candidate;
use super::strip::Strip;
use crate::capture::Shape;
use crate::geometry::surface::Side;

/// Candidates this near to a line support it, pixels.
const TOLERANCE: f64 = 1.5;
/// Steepest change of the limb's displacement down the image: a tilt of 6°, or a sphere 10 % of its
/// radius too high.
const STEEPEST: f64 = 0.105;

/// The limb's displacement outwards from the prediction, pixels, along one side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    at: f64,
    slope: f64,
    support: f64,
    middle: f64,
}

impl Line {
    /// Depth inside the predicted limb at a row, pixels.
    pub(super) fn depth(&self, row: f64) -> f64 {
        -(self.at + self.slope * (row - self.middle))
    }
}

/// How far the limb may be from the prediction, pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    pub shift: f64,
    pub radius: f64,
}

/// The best pair of lines; a side without a limb is `None`.
pub(super) fn agree(
    strips: &[(Strip, Vec<Candidate>)],
    shape: Shape,
    reach: Reach,
) -> [Option<Line>; 2] {
    let [left, right] = Side::BOTH.map(|side| lines(strips, side));
    let height = strips.iter().map(|(s, _)| s.row).fold(0.0, f64::max)
        - strips.iter().map(|(s, _)| s.row).fold(f64::MAX, f64::min);
    let mut best = ([None, None], 0.0);
    let options = |lines: &[Line]| -> Vec<Option<Line>> {
        lines.iter().copied().map(Some).chain([None]).collect()
    };
    for l in options(&left) {
        for r in options(&right) {
            let (support, grown, moved) = match (l, r) {
                (Some(l), Some(r)) => {
                    // A tilt moves one side out as it moves the other in.
                    let skew = (l.slope + r.slope).abs() * 0.5 * height;
                    if shape == Shape::Cylinder && skew > 3.0 * TOLERANCE {
                        continue;
                    }
                    let support = l.support + r.support;
                    (support, 0.5 * (l.at + r.at), 0.5 * (r.at - l.at))
                }
                (Some(l), None) => (l.support, 0.0, -l.at),
                (None, Some(r)) => (r.support, 0.0, r.at),
                (None, None) => continue,
            };
            let (grown, moved) = (grown.abs() / reach.radius, moved.abs() / reach.shift);
            if grown > 1.0 || moved > 1.0 {
                continue;
            }
            let score = support * (1.0 - 0.3 * grown * grown - 0.1 * moved * moved);
            if score > best.1 {
                best = ([l, r], score);
            }
        }
    }
    best.0
}

/// Lines through the candidates of one side, best supported first, at most four.
fn lines(strips: &[(Strip, Vec<Candidate>)], side: Side) -> Vec<Line> {
    let bands: Vec<(f64, &[Candidate])> = strips
        .iter()
        .filter(|(s, _)| s.side == side)
        .map(|(s, c)| (s.row, c.as_slice()))
        .collect();
    if bands.is_empty() {
        return Vec::new();
    }
    let middle = bands.iter().map(|(row, _)| row).sum::<f64>() / bands.len() as f64;
    // One band cannot be half of the bands unless there are few.
    let least = bands.len().div_ceil(2);
    let mut found: Vec<Line> = Vec::new();
    let mut consider = |at: f64, slope: f64| {
        let near = bands.iter().filter_map(|(row, candidates)| {
            let here = at + slope * (row - middle);
            candidates
                .iter()
                .filter(|c| (-c.depth - here).abs() <= TOLERANCE)
                // A root, so that one bright band does not outvote the others; and no more than 30σ.
                .map(|c| c.gain.sqrt().min(30.0))
                .max_by(f64::total_cmp)
        });
        let (count, support) = near.fold((0, 0.0), |(n, s), gain| (n + 1, s + gain));
        if count >= least {
            found.push(Line {
                at,
                slope,
                support,
                middle,
            });
        }
    };
    for (i, (row_a, a)) in bands.iter().enumerate() {
        for a in *a {
            consider(-a.depth, 0.0);
            for (row_b, b) in &bands[i + 1..] {
                for b in *b {
                    let slope = (a.depth - b.depth) / (row_b - row_a);
                    if slope.abs() <= STEEPEST {
                        consider(-a.depth + slope * (middle - row_a), slope);
                    }
                }
            }
        }
    }
    found.sort_by(|a, b| b.support.total_cmp(&a.support));
    let mut kept: Vec<Line> = Vec::new();
    for line in found {
        if kept.len() < 4
            && kept
                .iter()
                .all(|k| (k.at - line.at).abs() > 2.0 * TOLERANCE)
        {
            kept.push(line);
        }
    }
    kept
}
