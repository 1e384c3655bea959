//! `flatlight probe`: the lights that a mirror ball shows.

use std::path::Path;

use flatlight::capture::Capture;
use flatlight::geometry::{Highlight, probe};
use flatlight::{Error, Result};
use serde_json::json;

use super::say::Log;
use super::{Common, say};

/// Prints a line for each highlight.
pub fn run(path: &Path, views: bool, common: &Common) -> Result<()> {
    let capture = Capture::read(path)?;
    let found = probe(&capture)?;
    let files: Vec<String> = capture
        .views
        .iter()
        .map(|v| {
            v.photos
                .first()
                .map_or_else(String::new, |p| p.file.display().to_string())
        })
        .collect();
    let dark: Vec<&str> = found
        .iter()
        .zip(&files)
        .filter(|(lights, _)| lights.is_empty())
        .map(|(_, file)| file.as_str())
        .collect();
    if !dark.is_empty() {
        let text = format!("no highlight was found in {}", dark.join(", "));
        if common.strict {
            return Err(Error::failed(format!("--strict: {text}")));
        }
        say::warning(common, &text);
    }
    if !views && common.log == Log::Text {
        say::print("file,plane_roll_deg,light_deg,sigma_deg,orbit_deg,column_px,row_px,clipped\n");
    }
    if views && common.log == Log::Text {
        let all = found.iter().flatten().map(|light| light.sigma);
        let (sum, count) = all.fold((0.0, 0.0), |(s, n), sigma| (s + sigma * sigma, n + 1.0));
        if count > 0.0 {
            let sigma = f64::sqrt(sum / count).to_degrees();
            say::print(&format!(
                "# Under [camera], for how well these angles are known (rms of the lights): orbit_sigma_deg = {sigma:.3}\n\n"
            ));
        }
    }
    for (lights, file) in found.iter().zip(&files) {
        for light in lights {
            say::print(&format!("{}\n", line(light, file, views, common.log)));
        }
    }
    Ok(())
}

fn line(light: &Highlight, file: &str, views: bool, log: Log) -> String {
    let roll = light.plane_roll.to_degrees();
    let (angle, sigma) = (light.light.to_degrees(), light.sigma.to_degrees());
    let [u, v] = light.pixel;
    // The light stands still at 0°: the camera is then at the opposite of the angle to it.
    let orbit = -angle;
    match (log, views) {
        (Log::Json, _) => json!({
            "level": "result", "file": file, "plane_roll_deg": roll, "light_deg": angle, "sigma_deg": sigma,
            "orbit_deg": orbit, "column_px": u, "row_px": v, "clipped": light.clipped,
        })
        .to_string(),
        (Log::Text, true) => format!(
            "[[view]]  # light of {file}, σ {sigma:.3}°\norbit_deg = {orbit:?}\nplane_roll_deg = {roll:?}\nphotos = []\n"
        ),
        (Log::Text, false) => {
            let name = if file.contains([',', '"']) {
                format!("\"{}\"", file.replace('"', "\"\""))
            } else {
                file.to_string()
            };
            format!("{name},{roll},{angle},{sigma},{orbit},{u},{v},{}", light.clipped)
        }
    }
}
