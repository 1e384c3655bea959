//! From where an object is seen: the object and the camera of a `capture.toml` without its photographs.

use std::f64::consts::TAU;
use std::path::Path;

use crate::angle::WorldAngle;
use crate::capture::table::{Section, Source};
use crate::capture::{Camera, Object, file};
use crate::error::{Error, Result};
use crate::geometry::{CameraModel, Pose, ViewGeometry};

/// An object and a camera that may stand anywhere around it.
#[derive(Clone, Debug)]
pub struct Stage {
    /// What is seen.
    pub object: Object,
    /// What it is seen with.
    pub camera: Camera,
    /// Direction to the camera and roll of the measurement plane (radians) of the `[[view]]`s, in their order.
    listed: Vec<(WorldAngle, f64)>,
    /// First direction, step and roll of an even orbit, radians.
    orbit: Option<[f64; 3]>,
}

/// One place of the camera.
#[derive(Clone, Debug)]
pub struct Viewpoint {
    /// Direction from the object to the camera in the light's frame.
    pub orbit: WorldAngle,
    /// Where pixels look.
    pub geometry: ViewGeometry,
    /// Width and height of the image, pixels.
    pub size: [usize; 2],
}

impl Stage {
    /// Reads `[object]` and `[camera]` of a `capture.toml` (or of the folder's), and its views if it has any; everything
    /// else in the file is left alone, and no photograph is looked for. So `image_size` must be there.
    ///
    /// # Errors
    /// If the file cannot be read; all faults of the two tables at once.
    pub fn read(path: &Path) -> Result<Self> {
        let name = match path.is_dir() {
            true => path.join("capture.toml"),
            false => path.to_path_buf(),
        };
        let text = std::fs::read_to_string(&name).map_err(|e| Error::read(&name, e))?;
        let folder = name.parent().unwrap_or(Path::new(""));
        let source = Source::new(&name, &text);
        let table = source.parse()?;
        let root = Section::root(&source, &table);
        let described = file::described(&root, folder);
        let listed = root
            .sections("view", true)
            .iter()
            .map(|view| {
                if !view.has("orbit_deg") {
                    view.missing(
                        "orbit_deg",
                        "Give the direction from the object to the camera, in degrees.",
                    );
                }
                let orbit = WorldAngle::degrees(view.number("orbit_deg").unwrap_or(f64::NAN));
                let roll = view.number("plane_roll_deg").unwrap_or(0.0);
                (orbit, roll.to_radians())
            })
            .collect();
        let views = root.section("views");
        let angle = |key| views.number(key).map(f64::to_radians);
        let turn = views.integer("count").map(|n| TAU / n.max(1) as f64);
        let orbit = angle("orbit_step_deg").or(turn).map(|step| {
            let start = angle("orbit_start_deg").unwrap_or(0.0);
            [start, step, angle("plane_roll_deg").unwrap_or(0.0)]
        });
        match (Error::all(source.into_faults()), described) {
            (None, Some((object, camera))) => Ok(Self {
                object,
                camera,
                listed,
                orbit,
            }),
            (Some(faults), _) => Err(faults),
            (None, None) => Err(Error::input("the description is incomplete").file(name)),
        }
    }

    /// The camera at a view of the file, counted from 0.
    ///
    /// # Errors
    /// If the file does not say where that view is from, or the camera cannot be used.
    pub fn view(&self, number: usize) -> Result<Viewpoint> {
        let even = self.orbit.filter(|_| self.listed.is_empty());
        let placed = match (self.listed.get(number), even) {
            (Some(view), _) => Some(*view),
            (None, Some([start, step, roll])) => {
                Some((WorldAngle::radians(start + step * number as f64), roll))
            }
            (None, None) => None,
        };
        let (orbit, roll) = placed.ok_or_else(|| {
            Error::input(format!(
                "expected a view below {}, found {number}",
                self.listed.len()
            ))
            .key("--view")
            .advice("--orbit-deg places the camera where no view is.")
        })?;
        self.at(orbit, roll)
    }

    /// The camera in any direction from the object; `roll` of the measurement plane, radians.
    ///
    /// # Errors
    /// If the camera cannot be used.
    pub fn at(&self, orbit: WorldAngle, roll: f64) -> Result<Viewpoint> {
        let camera = CameraModel::new(&self.camera)?;
        Ok(Viewpoint {
            orbit,
            geometry: ViewGeometry::new(&camera, &self.object, Pose::nominal(), roll),
            size: self.camera.image_size.map(|n| n as usize),
        })
    }
}
