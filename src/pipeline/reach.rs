//! The distance from the cross-section up to which rows are averaged, decided by a few views.

use rayon::prelude::*;

use super::photographed::{Photographed, first_file, photographed, spread};
use super::rows::{reaches, rows_needed};
use crate::capture::Capture;
use crate::error::{Error, Kind, Result};
use crate::geometry::{CameraModel, Pose, ViewGeometry};
use crate::light_field::MeasuredLine;

/// Change, relative to the largest radiance, that averaging more rows may make beyond the noise.
const ROWS_BIAS: f64 = 1e-4;
/// Views that decide how many rows are averaged.
const PILOTS: usize = 3;

/// A view that decided how many rows are averaged.
pub(super) struct Pilot {
    pub(super) view: usize,
    pub(super) photographed: Photographed,
    /// Its line by the distance that was averaged.
    pub(super) lines: Vec<(f64, MeasuredLine)>,
}

/// The largest distance from the cross-section over which averaging changes nothing but the noise, and the views that say so:
/// Lepski's rule, the estimate with more rows must agree with all those with fewer.
pub(super) fn choose_reach(
    capture: &Capture,
    camera: &CameraModel,
    locals: usize,
) -> Result<(f64, Vec<Pilot>)> {
    let candidates = reaches(capture, camera, locals);
    let widest = candidates.last().copied().unwrap_or(0.0);
    // By name: neither the order in which a capture lists its views matters, nor where its angles start.
    let mut named: Vec<usize> = (0..capture.views.len()).collect();
    named.sort_by_cached_key(|&view| first_file(capture, view));
    let chosen: Vec<Option<(f64, Pilot)>> = spread(named.len(), PILOTS)
        .into_par_iter()
        .map(|place| {
            let view = named[place];
            let place = |e: Error| e.view(view).file(first_file(capture, view));
            let roll = capture.views[view].plane_roll;
            let nominal = ViewGeometry::new(camera, &capture.object, Pose::nominal(), roll);
            let rows = rows_needed(capture, &nominal, widest);
            // What is wrong with a pilot's photo is said when all are read.
            let pilot = match photographed(capture, camera, view, rows) {
                Ok(pilot) => pilot,
                Err(error) if error.kind() == Kind::Failed => return Err(place(error)),
                Err(_) => return Ok(None),
            };
            let geometry = ViewGeometry::new(camera, &capture.object, pilot.outline.pose, roll);
            let mut narrower: Vec<MeasuredLine> = Vec::new();
            for (k, &reach) in candidates.iter().enumerate() {
                // With all rows in it already, a line does not change any more.
                if let Some(line) = narrower.last()
                    && line.has_all_rows(&pilot.radiance, candidates[k - 1])
                {
                    narrower.push(line.clone());
                    continue;
                }
                let Ok(line) = MeasuredLine::read(&pilot.radiance, &geometry, reach) else {
                    return Ok(None);
                };
                if !narrower.iter().all(|n| agree(&line, n, &geometry)) {
                    break;
                }
                narrower.push(line);
            }
            let reach = candidates[narrower.len().max(1) - 1];
            let pilot = Pilot {
                view,
                photographed: pilot,
                lines: candidates.iter().copied().zip(narrower).collect(),
            };
            Ok(Some((reach, pilot)))
        })
        .collect::<Result<_>>()?;
    let (reaches, pilots): (Vec<f64>, Vec<Pilot>) = chosen.into_iter().flatten().unzip();
    let least = reaches.into_iter().fold(widest, f64::min);
    Ok((least, pilots))
}

/// Whether `wider` differs from `narrower` by no more than the latter's noise and [`ROWS_BIAS`].
fn agree(wider: &MeasuredLine, narrower: &MeasuredLine, geometry: &ViewGeometry) -> bool {
    let (mut difference, mut noise, mut largest, mut count) = (0.0, 0.0, 0.0f64, 0usize);
    let (a, b) = (&wider.stations, &narrower.stations);
    for (k, position) in wider.positions.iter().enumerate().take(b.count()) {
        // Near the limb the comparison is about footprints, not about rows.
        if !(geometry.sin_local(*position).abs() < 0.97) {
            continue;
        }
        for c in 0..a.channels() {
            if a.variance[c][k].is_finite() && b.variance[c][k].is_finite() {
                difference += (a.value[c][k] - b.value[c][k]).powi(2);
                noise += b.variance[c][k];
                largest = largest.max(b.value[c][k].abs());
                count += 1;
            }
        }
    }
    count == 0 || difference <= 1.2 * noise + count as f64 * (ROWS_BIAS * largest).powi(2)
}
