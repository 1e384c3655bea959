//! Every view read once: its measured line and what else its photos show.

use std::ops::Range;

use rayon::prelude::*;

use super::lean::Slant;
use super::photographed::{Photographed, first_file, photographed, spread};
use super::preview::preview;
use super::progress::Progress;
use super::reach::Pilot;
use super::rows::rows_needed;
use super::run::Preview;
use super::scenery::{Scenery, scenery};
use super::usable::{Level, Look};
use crate::capture::Capture;
use crate::error::Result;
use crate::geometry::outline::Outline;
use crate::geometry::{CameraModel, Pose, ViewGeometry};
use crate::light_field::MeasuredLine;
use crate::radiance;

/// Photos shown in the report.
const PREVIEWS: usize = 4;

/// One view after its photos were read.
pub(super) struct ReadView {
    pub(super) channels: Vec<String>,
    pub(super) outline: Outline,
    pub(super) line: MeasuredLine,
    pub(super) exposures: Vec<radiance::Found>,
    pub(super) preview: Option<Preview>,
    pub(super) scenery: Scenery,
}

/// Every view, in order, each with its own fault.
pub(super) fn read_views(
    capture: &Capture,
    camera: &CameraModel,
    reach: f64,
    pilots: Vec<Pilot>,
    progress: &dyn Progress,
) -> Vec<Result<(ReadView, Look)>> {
    progress.stage("photos", capture.views.len());
    let shown = spread(capture.views.len(), PREVIEWS);
    let mut known: Vec<Option<Pilot>> = Vec::new();
    known.resize_with(capture.views.len(), || None);
    for pilot in pilots {
        let view = pilot.view;
        known[view] = Some(pilot);
    }
    known
        .into_par_iter()
        .enumerate()
        .map(|(k, pilot)| {
            let view = read_view(capture, camera, k, reach, pilot, shown.contains(&k));
            progress.step();
            view.map_err(|e| e.file(first_file(capture, k)))
        })
        .collect()
}

fn read_view(
    capture: &Capture,
    camera: &CameraModel,
    view: usize,
    reach: f64,
    pilot: Option<Pilot>,
    shown: bool,
) -> Result<(ReadView, Look)> {
    let roll = capture.views[view].plane_roll;
    let nominal = ViewGeometry::new(camera, &capture.object, Pose::nominal(), roll);
    let rows = rows_needed(capture, &nominal, reach);
    // Of other rows the outline may be another.
    let (known, line) = match pilot.filter(|pilot| pilot.photographed.radiance.rows == rows) {
        Some(mut pilot) => {
            let at = pilot.lines.iter().position(|(r, _)| *r == reach);
            let line = at.map(|at| pilot.lines.swap_remove(at).1);
            (pilot.photographed, line)
        }
        None => (photographed(capture, camera, view, rows)?, None),
    };
    let Photographed {
        radiance,
        outline,
        exposures,
        storage,
        census,
    } = known;
    let geometry = ViewGeometry::new(camera, &capture.object, outline.pose, roll);
    let line = match line {
        Some(line) => line,
        None => MeasuredLine::read(&radiance, &geometry, reach)?,
    };
    let look = Look {
        channels: radiance.channels.clone(),
        storage,
        odd: census.between(columns(&line)),
        levels: (0..radiance.channels.len())
            .map(|c| {
                let stations = line.stations.value[c]
                    .iter()
                    .zip(&line.stations.variance[c]);
                Level::of(stations.map(|(value, variance)| variance.is_finite().then_some(*value)))
            })
            .collect(),
        masked: capture.object.mask.is_some() || capture.views[view].mask.is_some(),
    };
    let ends = columns(&line);
    let row = line.positions.first().map_or(0.0, |p| p[1]);
    let read = ReadView {
        scenery: scenery(&radiance, row, [ends.start as f64, ends.end as f64]),
        preview: shown.then(|| preview(view, &radiance, &geometry, reach)),
        channels: radiance.channels,
        outline,
        line,
        exposures,
    };
    Ok((read, look))
}

/// Columns of the image that a line runs over.
fn columns(line: &MeasuredLine) -> Range<usize> {
    let places = || line.positions.iter().map(|p| p[0].max(0.0));
    let first = places().fold(f64::INFINITY, f64::min);
    let last = places().fold(0.0, f64::max);
    first as usize..last as usize + 1
}

/// The rows above and below each view's line. Photos are read a second time, which costs less than keeping what few
/// captures need.
pub(super) fn read_slants(
    capture: &Capture,
    camera: &CameraModel,
    reach: f64,
    read: &[ReadView],
) -> Result<Vec<Option<Slant>>> {
    let slant = |k: usize, found: &ReadView| -> Result<Option<Slant>> {
        let roll = capture.views[k].plane_roll;
        let nominal = ViewGeometry::new(camera, &capture.object, Pose::nominal(), roll);
        let rows = rows_needed(capture, &nominal, reach);
        let radiance = radiance::view(capture, k, rows)?;
        let masked = radiance::masked(capture, k, &radiance)?;
        let geometry = ViewGeometry::new(camera, &capture.object, found.outline.pose, roll);
        let radiance = masked.as_ref().unwrap_or(&radiance);
        Ok(Slant::read(radiance, &geometry, &found.line))
    };
    read.par_iter()
        .enumerate()
        .map(|(k, found)| slant(k, found).map_err(|e| e.view(k).file(first_file(capture, k))))
        .collect()
}
