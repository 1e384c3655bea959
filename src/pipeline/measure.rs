//! From a capture set to the light field: every photo is read once, strip by strip.

use std::ops::Range;

use rayon::prelude::*;

use super::lean::{self, Lean, LeaningView, Slant};
use super::preview::preview;
use super::progress::Progress;
use super::recipe::LightFieldOptions;
use super::run::{Preview, ViewRecord};
use super::scenery::{Scenery, scenery};
use super::usable::{Level, Look, Usable};
use crate::capture::{Capture, Projection, Shape, framing};
use crate::error::{Error, Kind, Result};
use crate::geometry::outline::{self, Outline, Search};
use crate::geometry::{CameraModel, Pose, Settled, Side, ViewGeometry, settle};
use crate::grid::Grid;
use crate::light_field::{
    Gathered, Jitter, LightField, MeasuredLine, Samples, Systematic, ViewSample,
    automatic_limb_cut, gather, grid, jitter, runs_backwards,
};
use crate::photo::Storage;
use crate::radiance::{self, Developed, Radiance};

/// Rows above and below the cross-section that the outline is searched in, pixels: the most, and the least. In
/// between as many as hold the same number of pixels per angle as the most do at an object of this radius.
const OUTLINE_ROWS: f64 = 48.0;
const LEAST_OUTLINE_ROWS: f64 = 16.0;
const OUTLINE_RADIUS_PX: f64 = 430.0;
/// Pixels behind a sample beyond which more only take time: at the shot noise of a good camera, 0.5 %, they know it to
/// 1e-4 of its value, and neither geometry nor a BRDF are known better.
const ENOUGH_PIXELS: f64 = 2100.0;
/// Distances from the cross-section that are tried for the averaging of rows, pixels.
pub(super) const REACHES: [f64; 12] = [
    2.0, 3.0, 4.5, 6.5, 9.5, 14.0, 20.0, 30.0, 45.0, 65.0, 95.0, 140.0,
];
/// Largest elevation out of the plane that is averaged: of the view direction on a cylinder, of the
/// normal on a sphere, radians.
const ELEVATION: (f64, f64) = (0.026, 0.05);
/// Change, relative to the largest radiance, that averaging more rows may make beyond the noise.
const ROWS_BIAS: f64 = 1e-4;
/// Error of both limbs' positions (pixels) that photos of one object share, however many they are: the brightness just
/// inside the limb is not what the edge's model assumes. It shifts nothing, but changes the apparent radius.
const LIMB_ERROR_PX: f64 = 0.03;
/// Error (pixels) of where a set stands of which few views show both limbs, and the part of views below which they
/// are few: what is bright at one side only is found too far in, and that turns with the view as a displacement
/// of the object does.
const ONE_SIDED_ERROR_PX: f64 = 1.0;
const TWO_SIDED: f64 = 0.5;
/// Change of an exposure time by the brackets (log) from which it is told.
const TIME_CHANGE: f64 = 0.01;
/// The object's distance from the orbit's centre, in parts of its radius, beyond which a warning is given: a turntable is centred to a
/// few tenths of a percent with care, and what is found is taken into account.
const OFF_CENTRE: f64 = 0.02;
/// Part by which the object looks larger or smaller than described, and σ of what is found beyond it, from which a warning is given: lengths
/// are measured to half a percent.
const SIZE_CHANGE: f64 = 0.005;
const SIZE_SIGMAS: f64 = 4.0;
/// Views that decide how many rows are averaged, and photos shown in the report.
const PILOTS: usize = 3;
const PREVIEWS: usize = 4;

/// The measured light field and how it came about.
#[derive(Debug)]
pub struct Measured {
    /// The capture with the views that were used.
    pub capture: Capture,
    /// Samples at exact positions, for the recoveries.
    pub samples: Samples,
    /// Errors of the geometry that all samples have in common.
    pub systematics: Vec<Systematic>,
    /// Displacement of the object from the orbit's centre, metres, in the frame of the orbit angles.
    pub displacement: [f64; 2],
    /// By how much, relative, all light may be wrong because the object leans.
    pub scale_sigma: f64,
    /// Number of pixels behind each sample, \[column\]\[n\].
    pub pixels: Vec<Vec<f32>>,
    /// The same on the grid, for people and files.
    pub field: LightField,
    /// |θo′| beyond which nothing was used, radians.
    pub limb_cut: f64,
    /// Distance from the cross-section up to which rows were averaged, pixels.
    pub reach: f64,
    /// What is wrong with the photos if nothing explains them.
    pub doubt: Option<Error>,
    /// What was found in each view.
    pub views: Vec<ViewRecord>,
    /// A few photos.
    pub previews: Vec<Preview>,
    /// Plain sentences.
    pub warnings: Vec<String>,
}

/// One view after its photos were read.
struct ReadView {
    channels: Vec<String>,
    outline: Outline,
    line: MeasuredLine,
    exposures: Vec<radiance::Found>,
    preview: Option<Preview>,
    scenery: Scenery,
}

/// What the photos of a capture show, whatever the orbit angles are.
pub struct Taken {
    /// The capture with the views that are used.
    pub capture: Capture,
    camera: CameraModel,
    usable: Usable,
    response: Option<radiance::Recovery>,
    read: Vec<ReadView>,
    reach: f64,
    unseen: bool,
}

/// Reads the photos of a capture.
///
/// # Errors
/// If the object is not in the picture by the description, or too many photos cannot be read, do not show the measured line,
/// differ in channels or storage, or cannot be of one object; a few such are left out with a warning.
pub fn take(
    capture: &Capture,
    options: &LightFieldOptions,
    progress: &dyn Progress,
) -> Result<Taken> {
    let (whole, response) = radiance::resolved(capture).map_err(|e| e.file("capture.toml"))?;
    if let Some(fault) = framing(&whole).1 {
        return Err(fault);
    }
    let camera = CameraModel::new(&whole.camera)?;
    let mut usable = Usable::all(&whole);
    let (capture, read, reach) = loop {
        let part = usable.of(&whole);
        let (reach, pilots) = match options.rows {
            Some(rows) => (rows as f64 / 2.0, Vec::new()),
            None => choose_reach(&part, &camera, options.locals)?,
        };
        let (read, looks): (Vec<_>, Vec<_>) = read_views(&part, &camera, reach, pilots, progress)
            .into_iter()
            .map(|view| match view {
                Ok((view, look)) => (Some(view), Ok(look)),
                Err(error) => (None, Err(error)),
            })
            .unzip();
        if let Some(looks) = usable.leave_out(&whole, looks, progress)? {
            let read: Vec<ReadView> = read.into_iter().flatten().collect();
            let odd = usable.odd_values(&part, &looks, progress)?;
            usable.notes.extend(odd);
            break (part, read, reach);
        }
    };
    let unseen = read
        .iter()
        .all(|view| view.outline.sides() == [false, false]);
    if unseen && !read.iter().any(|v| v.scenery.structured) {
        return Err(no_object(
            "the photos show an even area or noise and nothing else",
        ));
    }
    Ok(Taken {
        capture,
        camera,
        usable,
        response,
        read,
        reach,
        unseen,
    })
}

/// Measures the light field of a capture. Where the recipe leaves the limb cut open, samples are used up to where a pixel covers
/// `footprint` degrees of θo′.
///
/// # Errors
/// As [`take`] and [`at_angles`].
pub fn measure(
    capture: &Capture,
    options: &LightFieldOptions,
    footprint: f64,
    progress: &dyn Progress,
) -> Result<Measured> {
    let taken = take(capture, options, progress)?;
    at_angles(&taken, &taken.capture, options, footprint, progress)
}

/// The light field that photos show with their views at the orbit angles of `turned`: the capture's, or others.
///
/// # Errors
/// If the poses of the views cannot be settled, or photos cannot be read again.
pub fn at_angles(
    taken: &Taken,
    turned: &Capture,
    options: &LightFieldOptions,
    footprint: f64,
    progress: &dyn Progress,
) -> Result<Measured> {
    let Taken {
        camera,
        usable,
        response,
        read,
        reach,
        unseen,
        ..
    } = taken;
    let (capture, reach, unseen) = (turned, *reach, *unseen);
    let channels = read[0].channels.clone();

    progress.stage("light field", capture.views.len());
    let outlines: Vec<Outline> = read.iter().map(|v| v.outline.clone()).collect();
    let settled = settle(&outlines, capture)?;
    let poses = &settled.poses;
    let cells = Grid {
        normals: options.normals,
        locals: options.locals,
    };
    let locals: Vec<_> = (0..cells.locals).map(|j| cells.local(j)).collect();
    let geometries: Vec<ViewGeometry> = poses
        .iter()
        .zip(&capture.views)
        .map(|(pose, view)| ViewGeometry::new(camera, &capture.object, *pose, view.plane_roll))
        .collect();
    let limb_cut = match options.limb_cut_deg {
        Some(degrees) => degrees.to_radians(),
        None => {
            let roll = capture.views[0].plane_roll;
            let nominal = ViewGeometry::new(camera, &capture.object, Pose::nominal(), roll);
            let seen = read.iter().zip(&geometries);
            seen.map(|(read, geometry)| read.line.seen_up_to(half_width(geometry)))
                .fold(automatic_limb_cut(&nominal, footprint), f64::min)
        }
    };
    let slants = match capture.object.shape {
        Shape::Cylinder if lean::shows(&settled) => read_slants(capture, camera, reach, read)?,
        _ => Vec::new(),
    };
    let leaning: Vec<LeaningView<'_>> = read
        .iter()
        .zip(&geometries)
        .enumerate()
        .map(|(k, (read, geometry))| LeaningView {
            line: &read.line,
            slant: slants.get(k).and_then(Option::as_ref),
            geometry,
            orbit: capture.views[k].orbit,
        })
        .collect();
    let lean = Lean::of(&settled, &leaning);
    let sampled = |corrected: bool| -> Vec<Vec<Vec<Option<ViewSample>>>> {
        leaning
            .par_iter()
            .enumerate()
            .map(|(k, view)| {
                let upright = lean
                    .as_ref()
                    .filter(|_| corrected)
                    .and_then(|lean| lean.corrected(k, view));
                let line = upright.as_ref().unwrap_or(view.line);
                line.samples(
                    view.geometry,
                    view.orbit,
                    &locals,
                    cells.local_step(),
                    limb_cut,
                )
            })
            .collect()
    };
    let mut views = sampled(true);
    let outline_sigma: Vec<f64> = poses
        .iter()
        .map(|p| p.sigma_lateral / capture.object.radius)
        .collect();
    let mut gathered = gather(channels.clone(), &locals, &views, &outline_sigma);
    let jitter = jitter(&gathered.samples, views.len());
    if let Some(jitter) = &jitter {
        steady(&mut views, jitter);
        gathered = gather(channels.clone(), &locals, &views, &outline_sigma);
    }
    let Gathered {
        samples,
        pixels,
        slopes,
    } = gathered;
    let two_sided = outlines
        .iter()
        .filter(|o| o.sides() == [true, true])
        .count();
    let blind = (two_sided as f64) < TWO_SIDED * outlines.len() as f64;
    let (field, (mut systematics, mut seen)) = rayon::join(
        || grid(&samples, cells, &pixels),
        || {
            rayon::join(
                || systematics(&settled, capture, &geometries[0], blind, &samples, &slopes),
                || warnings(capture, &outlines, poses, &samples),
            )
        },
    );
    if let Some(lean) = &lean {
        let mut uncorrected = sampled(false);
        if let Some(jitter) = &jitter {
            steady(&mut uncorrected, jitter);
        }
        let uncorrected = gather(channels, &locals, &uncorrected, &outline_sigma);
        systematics.push(lean::systematic(&samples, &uncorrected.samples));
        let corrected = slants.iter().flatten().count();
        seen.push(lean.warning(corrected, read.len()));
    }
    let records = (0..read.len())
        .map(|k| ViewRecord {
            orbit_deg: taken.capture.views[k].orbit.deg(),
            file: first_file(capture, k),
            centre_px: centre(&geometries[k]),
            centre_sigma_px: poses[k].sigma_lateral * px_per_metre(&geometries[k]),
            radius_px: half_width(&geometries[k]),
            limbs_seen: outlines[k].sides(),
            samples: views[k].first().map_or(0, |c| c.iter().flatten().count()),
        })
        .collect();
    let number = |view: usize| usable.number(view);
    let beside = read.iter().filter(|v| v.scenery.beside).count();
    Ok(Measured {
        capture: taken.capture.clone(),
        doubt: if 2 * beside > read.len() {
            Some(beside_object(beside, read.len()))
        } else if unseen {
            Some(no_object(
                "no view shows its limb, and nothing explains what is in its place",
            ))
        } else {
            None
        },
        warnings: [
            usable.notes.clone(),
            response.iter().map(response_note).collect(),
            exposure_warnings(capture, read, &number),
            jitter
                .iter()
                .map(|j| jitter_note(capture, j, &number))
                .collect(),
            seen,
        ]
        .concat(),
        samples,
        systematics,
        displacement: settled.displacement,
        scale_sigma: lean.as_ref().map_or(0.0, Lean::scale_sigma),
        pixels,
        field,
        limb_cut,
        reach,
        views: records,
        previews: read.iter().filter_map(|v| v.preview.clone()).collect(),
    })
}

/// Takes the views' exposure jitter out of their samples, \[view\]\[column\].
fn steady(views: &mut [Vec<Vec<Option<ViewSample>>>], jitter: &Jitter) {
    for (view, factor) in views.iter_mut().zip(&jitter.factor) {
        for sample in view.iter_mut().flatten().flatten() {
            sample.value /= factor;
            sample.slope /= factor;
            sample.variance /= factor * factor;
        }
    }
}

/// `count` indices spread evenly over 0 … n−1.
pub(super) fn spread(n: usize, count: usize) -> Vec<usize> {
    let mut all: Vec<usize> = (0..count.min(n)).map(|k| k * n / count.min(n)).collect();
    all.dedup();
    all
}

fn first_file(capture: &Capture, view: usize) -> String {
    photo_file(capture, view, 0)
}

fn photo_file(capture: &Capture, view: usize, photo: usize) -> String {
    capture.views[view]
        .photos
        .get(photo)
        .map_or_else(String::new, |p| p.file.display().to_string())
}

/// Rows of the image that hold the outline's search band and the measured line.
pub(super) fn rows_needed(capture: &Capture, geometry: &ViewGeometry, reach: f64) -> Range<u32> {
    let height = f64::from(capture.camera.image_size[1]);
    let ends = Side::BOTH.map(|side| geometry.limb(side).map(|p| p.pixel[1]));
    let (Some(left), Some(right)) = (ends[0], ends[1]) else {
        return 0..capture.camera.image_size[1];
    };
    let radius = geometry.radius_px().unwrap_or(OUTLINE_RADIUS_PX);
    let outline =
        (OUTLINE_ROWS * OUTLINE_RADIUS_PX / radius).clamp(LEAST_OUTLINE_ROWS, OUTLINE_ROWS);
    let margin = reach.max(outline) + 2.0;
    let first = (left.min(right) - margin).floor().clamp(0.0, height);
    let last = (left.max(right) + margin).ceil().clamp(0.0, height);
    if last > first {
        first as u32..last as u32
    } else {
        0..capture.camera.image_size[1]
    }
}

fn find_outline(
    capture: &Capture,
    camera: &CameraModel,
    view: usize,
    radiance: &Radiance,
) -> Result<Outline> {
    match capture.views[view].outline {
        Some(given) => outline::given(given, camera, &capture.object),
        None => outline::find(radiance, camera, &capture.object, Search::default()),
    }
}

/// Some rows of a view, as far as its masks let them be used, and the outline in them.
pub(super) struct Photographed {
    pub(super) radiance: Radiance,
    pub(super) outline: Outline,
    exposures: Vec<radiance::Found>,
    storage: Storage,
    census: radiance::Census,
}

pub(super) fn photographed(
    capture: &Capture,
    camera: &CameraModel,
    view: usize,
    rows: Range<u32>,
) -> Result<Photographed> {
    let Developed {
        radiance,
        exposures,
        storage,
        census,
    } = radiance::develop(capture, view, rows)?;
    let outline = |radiance: &Radiance| find_outline(capture, camera, view, radiance);
    let (radiance, outline) = match radiance::masked(capture, view, &radiance)? {
        None => {
            let outline = outline(&radiance)?;
            (radiance, outline)
        }
        Some(masked) => {
            let mut found = outline(&masked)?;
            // A mask that follows the object hides its limb, which the photo itself may show.
            if found.sides() == [false, false] {
                found = outline(&radiance)?;
            }
            (masked, found)
        }
    };
    Ok(Photographed {
        radiance,
        outline,
        exposures,
        storage,
        census,
    })
}

fn no_object(why: &str) -> Error {
    Error::input(format!("expected an object, found no object: {why}"))
        .file("capture.toml")
        .key("camera")
        .advice("Are these the photos, is there one object only, is it cut by the frame, do radius, distance, focal length and principal_point_px put it where it is? If its limb cannot be seen against the background, give each view's outline by hand.")
}

fn beside_object(count: usize, views: usize) -> Error {
    Error::input(format!(
        "expected one object before a plain background, found something as bright beside the object in {count} of {views} views, and nothing explains what was measured"
    ))
    .file("capture.toml")
    .key("object.mask")
    .advice("Hide the rest with a mask (white is used), crop the photos to the object, or check which of the things radius and principal_point_px describe.")
}

/// Every view, in order, each with its own fault.
fn read_views(
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
fn read_slants(
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

/// A view that decided how many rows are averaged.
struct Pilot {
    view: usize,
    photographed: Photographed,
    /// Its line by the distance that was averaged.
    lines: Vec<(f64, MeasuredLine)>,
}

/// The largest distance from the cross-section over which averaging changes nothing but the noise, and the views that say so:
/// Lepski's rule, the estimate with more rows must agree with all those with fewer.
fn choose_reach(
    capture: &Capture,
    camera: &CameraModel,
    locals: usize,
) -> Result<(f64, Vec<Pilot>)> {
    let limit = reach_limit(capture, camera, locals);
    let candidates: Vec<f64> = REACHES
        .into_iter()
        .enumerate()
        .filter(|&(i, r)| i == 0 || r <= limit)
        .map(|(_, r)| r)
        .collect();
    let widest = candidates.last().copied().unwrap_or(REACHES[0]);
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

/// Largest distance from the cross-section (pixels) that may be averaged into samples of `locals` columns.
pub(super) fn reach_limit(capture: &Capture, camera: &CameraModel, locals: usize) -> f64 {
    let object_px = capture.object.radius / camera.metres_per_px();
    let across = object_px * std::f64::consts::PI / locals.max(1) as f64;
    let enough = ENOUGH_PIXELS / (2.0 * across);
    let allowed = match (capture.object.shape, capture.camera.projection) {
        (Shape::Cylinder, Projection::Perspective { focal_px }) => focal_px * ELEVATION.0,
        (Shape::Cylinder, Projection::Orthographic { .. }) => object_px,
        (Shape::Sphere, _) => object_px * ELEVATION.1,
    };
    allowed.min(enough)
}

fn centre(geometry: &ViewGeometry) -> [f64; 2] {
    match Side::BOTH.map(|side| geometry.limb(side).map(|p| p.pixel)) {
        [Some(l), Some(r)] => [(l[0] + r[0]) / 2.0, (l[1] + r[1]) / 2.0],
        _ => [f64::NAN; 2],
    }
}

fn half_width(geometry: &ViewGeometry) -> f64 {
    match Side::BOTH.map(|side| geometry.limb(side).map(|p| p.pixel)) {
        [Some(l), Some(r)] => (r[0] - l[0]).hypot(r[1] - l[1]) / 2.0,
        _ => f64::NAN,
    }
}

fn px_per_metre(geometry: &ViewGeometry) -> f64 {
    half_width(geometry) / geometry.radius()
}

/// The errors of the outline that all views share: where the object stands, and how large it looks. A
/// shift by δ turns the normal seen in a pixel by δ/(R cos θo′), a radius wrong by the factor 1 + s by
/// s tan θo′. `blind`: few views show both limbs.
fn systematics(
    settled: &Settled,
    capture: &Capture,
    geometry: &ViewGeometry,
    blind: bool,
    samples: &Samples,
    slopes: &[Vec<Vec<f64>>],
) -> Vec<Systematic> {
    let radius = capture.object.radius;
    let least = if blind {
        ONE_SIDED_ERROR_PX / half_width(geometry)
    } else {
        0.0
    };
    let of_shift = |sigma: f64| (sigma / radius).max(least);
    let [x, y] = settled.sigma_displacement.map(of_shift);
    let constant = of_shift(settled.sigma_constant);
    let scale = settled
        .sigma_radius_scale
        .max(LIMB_ERROR_PX / half_width(geometry));
    let build = |name: &str, turn: &dyn Fn(f64, f64) -> f64| Systematic {
        name: name.into(),
        change: slopes
            .iter()
            .map(|columns| {
                columns
                    .iter()
                    .zip(&samples.columns)
                    .map(|(slopes, column)| {
                        slopes
                            .iter()
                            .zip(&column.view)
                            .map(|(slope, &view)| {
                                let orbit = capture.views[view as usize].orbit.rad();
                                slope * turn(column.local.rad(), orbit)
                            })
                            .collect()
                    })
                    .collect()
            })
            .collect(),
    };
    vec![
        build("shift of the outline in all views", &|local, _| {
            constant / local.cos()
        }),
        build(
            "displacement of the object along the reference axis",
            &|local, orbit| -x * orbit.sin() / local.cos(),
        ),
        build(
            "displacement of the object across the reference axis",
            &|local, orbit| y * orbit.cos() / local.cos(),
        ),
        build("apparent radius", &|local, _| scale * local.tan()),
    ]
}

/// How well the response was recovered from the brackets.
fn response_note(found: &radiance::Recovery) -> String {
    let curve = &found.curve;
    let sigmas = curve.linear.iter().zip(&curve.sigma).flat_map(|(x, s)| {
        let rows = x.len();
        let middle = x.iter().zip(s).take(rows * 9 / 10).skip(rows / 10);
        middle.map(|(x, s)| s / x)
    });
    let times = found.times.iter().map(|(_, factor)| factor.ln().abs());
    format!(
        "The camera's response was recovered from {} patches of the brackets (σ up to {:.1} % of the light over the middle 80 % of the codes; \
         exposure times up to {:.1} % other than stated; misfit {:.1} times the noise); the scale between channels is that of a grey of the middle code.",
        found.patches,
        100.0 * sigmas.fold(0.0, f64::max),
        100.0 * times.fold(0.0, f64::max),
        found.misfit
    )
}

/// How much the views' exposures were found to jitter.
fn jitter_note(capture: &Capture, jitter: &Jitter, number: &dyn Fn(usize) -> usize) -> String {
    let size = |v: &usize| jitter.factor.get(*v).map_or(0.0, |f| f.ln().abs());
    let worst = (0..jitter.factor.len()).max_by(|a, b| size(a).total_cmp(&size(b)));
    let (view, sigma) = worst.map_or((0, 0.0), |v| (v, jitter.sigma[v]));
    format!(
        "Exposure changes from view to view by {:.2} % (rms), the most in view {} (\"{}\": {:+.2} ± {:.2} %); it was divided out. Changes as slow along the orbit as lighting cannot be told from lighting and are left.",
        100.0 * jitter.rms(),
        number(view),
        first_file(capture, view),
        100.0 * (jitter.factor.get(view).copied().unwrap_or(1.0) - 1.0),
        100.0 * sigma
    )
}

/// What the brackets showed to be other than stated: photos moved against each other, exposure times.
fn exposure_warnings(
    capture: &Capture,
    read: &[ReadView],
    number: &dyn Fn(usize) -> usize,
) -> Vec<String> {
    let mut warnings = Vec::new();
    let mut worst: Option<(f64, usize, usize)> = None;
    for (v, view) in read.iter().enumerate() {
        for (p, found) in view.exposures.iter().enumerate() {
            let [dx, dy] = found.shift.by;
            if found.shift.by != [0.0; 2] {
                let [sx, sy] = found.shift.sigma;
                warnings.push(format!(
                    "View {}: \"{}\" lay ({dx:.2} ± {sx:.2}, {dy:.2} ± {sy:.2}) pixels off the view's other photos and was moved back.",
                    number(v),
                    photo_file(capture, v, p)
                ));
            }
            let change = found.time_factor.ln();
            if worst.is_none_or(|(largest, ..)| change.abs() > f64::abs(largest)) {
                worst = Some((change, v, p));
            }
        }
    }
    if let Some((change, v, p)) = worst
        && change.abs() > TIME_CHANGE
    {
        warnings.push(format!(
            "The brackets show exposure times other than stated, and were merged with those; the most in view {}: \"{}\" by {:+.1} %.",
            number(v),
            photo_file(capture, v, p),
            100.0 * change.exp_m1()
        ));
    }
    warnings
}

fn warnings(
    capture: &Capture,
    outlines: &[Outline],
    poses: &[Pose],
    samples: &Samples,
) -> Vec<String> {
    let mut warnings = Vec::new();
    let unseen = outlines
        .iter()
        .filter(|o| o.sides() == [false, false])
        .count();
    if unseen == outlines.len() {
        warnings.push(
            "No view shows the object's limb; the outline is the description's. A brighter or darker background lets it be found, or give it by hand with `outline`.".into(),
        );
    }
    let orbits: Vec<_> = capture.views.iter().map(|view| view.orbit).collect();
    if runs_backwards(samples, &orbits) {
        warnings.push(
            "The views fit together much better the other way round: turn the sign of orbit_deg (or orbit_step_deg). It counts counter-clockwise seen from above, in the frame of the light: turning the object or the light instead turns the sense.".into(),
        );
    }
    let radius = capture.object.radius;
    let shift = poses
        .iter()
        .map(|p| p.offset[1].abs() / radius)
        .fold(0.0, f64::max);
    if shift > OFF_CENTRE {
        warnings.push(format!(
            "The object's centre is up to {:.1} % of its radius off the orbit's centre; the found outline was used.",
            100.0 * shift
        ));
    }
    let scale = poses.iter().map(|p| p.radius_scale - 1.0).sum::<f64>() / poses.len() as f64;
    let sigma = poses
        .iter()
        .map(|p| p.sigma_radius_scale)
        .fold(f64::INFINITY, f64::min);
    if scale.abs() > SIZE_CHANGE + SIZE_SIGMAS * sigma {
        warnings.push(format!(
            "The object looks {:.1} % {} than radius, distance and focal length say; the found outline was used. Check these three.",
            100.0 * scale.abs(),
            if scale > 0.0 { "larger" } else { "smaller" }
        ));
    }
    for (c, name) in samples.channels.iter().enumerate() {
        if samples.count(c) == 0 {
            warnings.push(format!("Channel {name} has no usable pixel."));
        }
    }
    warnings
}
