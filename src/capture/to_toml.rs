//! A [`Capture`] as the text of a `capture.toml` with every default written out.

use std::fmt::Write;
use std::path::Path;

use super::{Capture, Encoding, Projection, Sensor, Shape, View};

impl Capture {
    /// The description as it was understood: reads back to the same capture. Paths are relative to
    /// the capture's folder; neither that folder nor anything else of the host is in it.
    pub fn to_toml(&self) -> String {
        let mut out = String::new();
        // Writing to a String cannot fail.
        let _ = self.write(&mut out);
        out
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "format = 1\nname = {}\n", quoted(&self.name))?;
        let shape = match self.object.shape {
            Shape::Cylinder => "cylinder",
            Shape::Sphere => "sphere",
        };
        writeln!(out, "[object]\nshape = \"{shape}\"")?;
        writeln!(out, "radius = {:?}", self.object.radius)?;
        if let Some(mask) = &self.object.mask {
            writeln!(out, "mask = {}", path(mask))?;
        }
        self.write_camera(out)?;
        write_sensor(&self.sensor, out)?;
        self.views.iter().try_for_each(|view| write_view(view, out))
    }

    fn write_camera(&self, out: &mut String) -> std::fmt::Result {
        let camera = &self.camera;
        writeln!(out, "\n[camera]")?;
        match camera.projection {
            Projection::Perspective { focal_px } => {
                writeln!(out, "projection = \"perspective\"\nfocal_px = {focal_px:?}")?;
            }
            Projection::Orthographic { metres_per_px } => {
                let width = metres_per_px * f64::from(camera.image_size[0]);
                writeln!(out, "projection = \"orthographic\"\nwidth_m = {width:?}")?;
            }
        }
        writeln!(out, "image_size = {:?}", camera.image_size)?;
        writeln!(out, "principal_point_px = {:?}", camera.principal_point_px)?;
        writeln!(out, "distortion = {:?}", camera.distortion)?;
        writeln!(out, "distance = {:?}", camera.distance)?;
        writeln!(out, "orbit_sigma_deg = {:?}", camera.orbit_sigma_deg)
    }
}

fn write_sensor(sensor: &Sensor, out: &mut String) -> std::fmt::Result {
    if *sensor == Sensor::default() {
        return Ok(());
    }
    writeln!(out, "\n[sensor]")?;
    match &sensor.encoding {
        None => {}
        Some(Encoding::Linear) => writeln!(out, "encoding = \"linear\"")?,
        Some(Encoding::Srgb) => writeln!(out, "encoding = \"srgb\"")?,
        Some(Encoding::Recover(_)) => writeln!(out, "encoding = \"recover\"")?,
        Some(Encoding::Gamma(gamma)) => writeln!(out, "encoding = \"gamma:{gamma}\"")?,
        Some(Encoding::Response(file)) => {
            let text = format!("response:{}", file.display());
            writeln!(out, "encoding = {}", quoted(&text))?;
        }
    }
    for (key, value) in [
        ("black_level", sensor.black_level),
        ("white_level", sensor.white_level),
        ("full_well_e", sensor.full_well_e),
        ("read_noise_e", sensor.read_noise_e),
        ("responsivity", sensor.responsivity),
    ] {
        if let Some(value) = value {
            writeln!(out, "{key} = {value:?}")?;
        }
    }
    for (key, file) in [("dark", &sensor.dark), ("flat", &sensor.flat)] {
        if let Some(file) = file {
            writeln!(out, "{key} = {}", path(file))?;
        }
    }
    if let Some(vignetting) = sensor.vignetting {
        writeln!(out, "vignetting = {vignetting:?}")?;
    }
    Ok(())
}

/// An angle in degrees as somebody would write it: 30, not 29.999999999999996, where that is the same number of radians.
fn degrees(radians: f64) -> f64 {
    let exact = radians.to_degrees();
    let short = (exact * 1e9).round() / 1e9;
    match short.to_radians() == radians {
        true => short,
        false => exact,
    }
}

fn write_view(view: &View, out: &mut String) -> std::fmt::Result {
    writeln!(
        out,
        "\n[[view]]\norbit_deg = {:?}",
        degrees(view.orbit.rad())
    )?;
    writeln!(out, "photos = [")?;
    for photo in &view.photos {
        write!(out, "    {{ file = {}", path(&photo.file))?;
        if let Some(exposure) = photo.exposure_s {
            write!(out, ", exposure_s = {exposure:?}")?;
        }
        writeln!(out, " }},")?;
    }
    writeln!(out, "]")?;
    writeln!(out, "plane_roll_deg = {:?}", degrees(view.plane_roll))?;
    if let Some(mask) = &view.mask {
        writeln!(out, "mask = {}", path(mask))?;
    }
    if let Some(outline) = &view.outline {
        writeln!(
            out,
            "outline = {{ centre_px = {:?}, radius_px = {:?} }}",
            outline.centre_px, outline.radius_px
        )?;
    }
    Ok(())
}

/// A TOML string of any text.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_string()).to_string()
}

/// A path with `/` between its parts.
pub(super) fn path(path: &Path) -> String {
    let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
    quoted(&parts.join("/"))
}
