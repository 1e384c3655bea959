//! From a capture set to the light field: every photo is read once, strip by strip.

use rayon::prelude::*;

use super::lean::{self, Lean, LeaningView};
use super::notes::{exposure_warnings, jitter_note, response_note, warnings};
use super::outline_errors::{centre, half_width, px_per_metre, systematics};
use super::photographed::first_file;
use super::progress::Progress;
use super::reach::choose_reach;
use super::recipe::LightFieldOptions;
use super::run::{Preview, ViewRecord};
use super::usable::Usable;
use super::views::{ReadView, read_slants, read_views};
use crate::capture::{Capture, Shape, framing};
use crate::error::{Error, Result};
use crate::geometry::outline::Outline;
use crate::geometry::{CameraModel, Pose, ViewGeometry, settle};
use crate::grid::Grid;
use crate::light_field::{
    Gathered, Jitter, LightField, Samples, Systematic, ViewSample, automatic_limb_cut, gather,
    grid, jitter,
};
use crate::radiance;

/// Part of the views that show both limbs below which these are few.
const TWO_SIDED: f64 = 0.5;

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

impl Taken {
    /// The capture with the views that are used; what its photos show is forgotten.
    pub fn into_capture(self) -> Capture {
        self.capture
    }
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
    let two_sided = outlines
        .iter()
        .filter(|o| o.sides() == [true, true])
        .count();
    let blind = (two_sided as f64) < TWO_SIDED * outlines.len() as f64;
    let shown = |found: &Gathered| {
        let Gathered {
            samples,
            pixels,
            slopes,
        } = found;
        rayon::join(
            || grid(samples, cells, pixels),
            || {
                rayon::join(
                    || systematics(&settled, capture, &geometries[0], blind, samples, slopes),
                    || warnings(capture, &outlines, poses, samples),
                )
            },
        )
    };
    // Most captures have no jitter: what they show is found while it is looked for.
    let (jitter, mut found) = rayon::join(
        || jitter(&gathered.samples, views.len()),
        || shown(&gathered),
    );
    if let Some(jitter) = &jitter {
        steady(&mut views, jitter);
        gathered = gather(channels.clone(), &locals, &views, &outline_sigma);
        found = shown(&gathered);
    }
    let (field, (mut systematics, mut seen)) = found;
    let Gathered {
        samples, pixels, ..
    } = gathered;
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
