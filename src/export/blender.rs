//! World and material for Blender.

use super::light::required;
use super::{IN_PLANE, Surface, rgb};
use crate::error::Result;
use crate::pipeline::Run;

/// `blender.py`, to be run in Blender's text editor: world with the environment beside it, sun lamps, and the material where Blender has its model.
///
/// # Errors
/// If there is no light, or channels are not R, G and B or a single one.
pub(super) fn files(run: &Run) -> Result<Vec<(&'static str, Vec<u8>)>> {
    let of = rgb(&run.channels)?;
    let list = |v: &[f64]| {
        let picked = of.map(|c| v.get(c).copied().unwrap_or(0.0).to_string());
        format!("({})", picked.join(", "))
    };
    let mut facts = format!("# {}\n", run.capture_name.replace(['\n', '\r'], " "));
    facts += "SUNS = [  # degrees from +X towards +Y, irradiance in W/m2: red, green, blue\n";
    for source in &required(run)?.sources {
        facts += &format!(
            "    ({}, {}),\n",
            source.theta.deg(),
            list(&source.irradiance)
        );
    }
    facts += "]\n";
    match Surface::of(run) {
        Ok(surface) => {
            facts += &format!("# {IN_PLANE}\n");
            for line in surface.describe().lines() {
                facts += &format!("# {line}\n");
            }
            facts += &format!("MODEL = \"{}\"\nMATERIAL = {{\n", surface.family.name());
            for parameter in surface.family.parameters() {
                let values = surface.parameter(parameter.name).unwrap_or_default();
                facts += &format!("    \"{}\": {},\n", parameter.name, list(&values));
            }
            let lambert: Vec<f64> = surface.layers.iter().map(|l| l.lambert).collect();
            let scale: Vec<f64> = surface.layers.iter().map(|l| l.scale).collect();
            facts += &format!(
                "    \"lambert\": {},\n    \"scale\": {},\n}}\n",
                list(&lambert),
                list(&scale)
            );
        }
        Err(_) => facts += "MODEL = None\nMATERIAL = {}\n",
    }
    let script = include_str!("blender.py").replace("# FACTS\n", &facts);
    Ok(vec![("blender.py", script.into_bytes())])
}
