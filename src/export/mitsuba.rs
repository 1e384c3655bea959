//! A scene for Mitsuba 3 that shows what was photographed: material, light and camera of a run.

use std::fmt::Write as _;

use super::light::{Emitter, emitters, lighting};
use super::{IN_PLANE, Surface, merl, rgb};
use crate::brdf::Family;
use crate::error::{Error, Result};
use crate::pipeline::Run;

/// The files of the scene: `scene.xml`, which includes the others, `material.xml`, `light.xml` if light is known, and where no plugin of
/// Mitsuba has the material's model, `flatlight_merl.py` with the table that it reads.
///
/// # Errors
/// If the run has no 3-D model of the material, or other channels than R, G and B or a single one.
pub(super) fn files(run: &Run) -> Result<Vec<(&'static str, Vec<u8>)>> {
    let surface = Surface::of(run)?;
    let of = rgb(&surface.channels)?;
    let (material, table) = match plugin(&surface, of) {
        Some(plugin) => (plugin, false),
        None => (TABLE.to_owned(), true),
    };
    let about = comment(&format!(
        "{}: {IN_PLANE}\n{}",
        run.capture_name,
        surface.describe()
    ));
    let material = format!("<scene version=\"3.0.0\">\n{about}{material}</scene>\n");
    let mut files = vec![("material.xml", material.into_bytes())];
    if table {
        files.push((
            "flatlight_merl.py",
            include_bytes!("flatlight_merl.py").to_vec(),
        ));
        files.push(("brdf.binary", merl::encode(&surface)?));
        files.push(("brdf.txt", merl::label(run, &surface).into_bytes()));
    }
    let light = lighting(run);
    if let Some(light) = &light {
        let (sources, continuous) = emitters(light)?;
        files.push(("light.xml", light_xml(&sources, &continuous).into_bytes()));
    }
    let scene = scene(run, table, light.is_some())?;
    files.push(("scene.xml", scene.into_bytes()));
    Ok(files)
}

/// The table of the model, by a plugin in Python that is written beside it.
const TABLE: &str = "  <bsdf type=\"flatlight-merl\" id=\"material\">\n    <string name=\"filename\" value=\"brdf.binary\"/>\n  </bsdf>\n";

/// The material as a plugin that Mitsuba has; `None` if none has its model.
fn plugin(surface: &Surface, of: [usize; 3]) -> Option<String> {
    let pick = |values: &[f64]| of.map(|c| values.get(c).copied().unwrap_or(0.0));
    let lambert = pick(&surface.layers.iter().map(|l| l.lambert).collect::<Vec<_>>());
    let scale = pick(&surface.layers.iter().map(|l| l.scale).collect::<Vec<_>>());
    let parameter = |name: &str| surface.parameter(name).map(|v| pick(&v));
    let largest = |v: [f64; 3]| v.into_iter().fold(0.0, f64::max);
    match surface.family {
        Family::Lambertian => {
            let albedo = parameter("albedo")?;
            let albedo = [0, 1, 2].map(|c| scale[c] * albedo[c] + lambert[c]);
            (largest(albedo) <= 1.0).then(|| diffuse("id=\"material\"", albedo, "  "))
        }
        Family::GgxConductor => {
            let alpha = parameter("alpha")?;
            let mean = alpha.iter().sum::<f64>() / 3.0;
            // The plugin has one roughness; a percent of it is less than any eye or test here sees.
            if alpha.iter().any(|a| (a / mean - 1.0).abs() > 0.01) {
                return None;
            }
            let specular = parameter("specular")?;
            let specular = [0, 1, 2].map(|c| scale[c] * specular[c]);
            let (eta, k) = (parameter("eta")?, parameter("k")?);
            // blendbsdf weighs its two parts by 1 − w and w; each must stay a reflectance.
            let w = largest(lambert);
            if w == 0.0 {
                return (largest(specular) <= 1.0)
                    .then(|| conductor("id=\"material\"", mean, eta, k, specular, "  "));
            }
            let metal = specular.map(|s| s / (1.0 - w));
            (w < 1.0 && largest(metal) <= 1.0).then(|| {
                format!(
                    "  <bsdf type=\"blendbsdf\" id=\"material\">\n    <float name=\"weight\" value=\"{w}\"/>\n{}{}  </bsdf>\n",
                    conductor("", mean, eta, k, metal, "    "),
                    diffuse("", lambert.map(|l| l / w), "    ")
                )
            })
        }
        _ => None,
    }
}

fn triple(values: [f64; 3]) -> String {
    let [r, g, b] = values;
    format!("{r}, {g}, {b}")
}

fn diffuse(id: &str, reflectance: [f64; 3], indent: &str) -> String {
    format!(
        "{indent}<bsdf type=\"diffuse\" {id}>\n{indent}  <rgb name=\"reflectance\" value=\"{}\"/>\n{indent}</bsdf>\n",
        triple(reflectance)
    )
}

fn conductor(
    id: &str,
    alpha: f64,
    eta: [f64; 3],
    k: [f64; 3],
    specular: [f64; 3],
    indent: &str,
) -> String {
    format!(
        "{indent}<bsdf type=\"roughconductor\" {id}>\n{indent}  <string name=\"distribution\" value=\"ggx\"/>\n{indent}  <float name=\"alpha\" value=\"{alpha}\"/>\n\
         {indent}  <rgb name=\"eta\" value=\"{}\"/>\n{indent}  <rgb name=\"k\" value=\"{}\"/>\n{indent}  <rgb name=\"specular_reflectance\" value=\"{}\"/>\n{indent}</bsdf>\n",
        triple(eta),
        triple(k),
        triple(specular)
    )
}

/// Light in the plane as directional emitters, which is exact for sources, and for continuous light a sum every 0.25°.
fn light_xml(sources: &[Emitter], continuous: &[Emitter]) -> String {
    let mut text = String::from("<scene version=\"3.0.0\">\n");
    text += &comment(
        "Light in the plane z = 0, as directional emitters: irradiance is that of a surface facing the emitter. The object's cross-section is lit exactly \
         as it was photographed; what was out of the plane, if anything, is not here. Of light that was recovered up to a frequency \
         it has the frequencies known, and beyond them those that keep it from being negative.",
    );
    for emitter in sources.iter().chain(continuous) {
        let (sin, cos) = emitter.theta.sin_cos();
        let weight = emitter.irradiance.iter().map(|v| v.abs()).sum::<f64>();
        let _ = writeln!(
            text,
            "  <emitter type=\"directional\"><vector name=\"direction\" value=\"{}, {}, 0\"/><rgb name=\"irradiance\" value=\"{}\"/><float name=\"sampling_weight\" value=\"{weight}\"/></emitter>",
            -cos,
            -sin,
            triple(emitter.irradiance)
        );
    }
    text + "</scene>\n"
}

/// Camera and object, in metres: the object stands at the origin, its plane is z = 0, θ = 0 is +x.
fn scene(run: &Run, table: bool, lit: bool) -> Result<String> {
    let capture: toml::Table = toml::from_str(&run.capture_toml)
        .map_err(|e| Error::failed(format!("the run's capture.toml cannot be read again: {e}")))?;
    let section = |name: &str| capture.get(name).and_then(toml::Value::as_table);
    let number = |section: Option<&toml::Table>, key: &str| {
        let value = section.and_then(|s| s.get(key));
        value.and_then(|v| v.as_float().or_else(|| v.as_integer().map(|i| i as f64)))
    };
    let pair = |section: Option<&toml::Table>, key: &str| {
        let value = section.and_then(|s| s.get(key)).and_then(|v| v.as_array());
        let number = |v: &toml::Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
        value.and_then(|v| Some([number(v.first()?)?, number(v.get(1)?)?]))
    };
    let missing = |key: &str| Error::failed(format!("the run's capture.toml has no {key}"));
    let (object, camera) = (section("object"), section("camera"));
    let radius = number(object, "radius").ok_or_else(|| missing("object.radius"))?;
    let distance = number(camera, "distance").ok_or_else(|| missing("camera.distance"))?;
    let [width, height] = pair(camera, "image_size").ok_or_else(|| missing("camera.image_size"))?;
    let [cx, cy] = pair(camera, "principal_point_px").unwrap_or([width / 2.0, height / 2.0]);
    let roll = capture
        .get("view")
        .and_then(|v| v.as_array())
        .and_then(|v| v.first())
        .and_then(|v| number(v.as_table(), "plane_roll_deg"))
        .unwrap_or(0.0);
    // The plane's normal stands upright in the picture at roll 0; a positive roll turns it counter-clockwise there.
    let (sin, cos) = roll.to_radians().sin_cos();
    let (sensor, lens) = match (number(camera, "width_m"), number(camera, "focal_px")) {
        (Some(across), _) => (
            "orthographic",
            format!(
                "    <transform name=\"to_world\">\n      <scale x=\"{0}\" y=\"{0}\"/>\n",
                across / 2.0
            ),
        ),
        (None, Some(focal)) => (
            "perspective",
            format!(
                "    <string name=\"fov_axis\" value=\"x\"/>\n    <float name=\"fov\" value=\"{}\"/>\n    <float name=\"principal_point_offset_x\" value=\"{}\"/>\n    <float name=\"principal_point_offset_y\" value=\"{}\"/>\n    <transform name=\"to_world\">\n",
                2.0 * (width / 2.0 / focal).atan().to_degrees(),
                0.5 - cx / width,
                0.5 - cy / height
            ),
        ),
        (None, None) => return Err(missing("camera.focal_px or camera.width_m")),
    };
    let shape = match object.and_then(|o| o.get("shape")).and_then(|s| s.as_str()) {
        Some("sphere") => {
            format!("  <shape type=\"sphere\">\n    <float name=\"radius\" value=\"{radius}\"/>\n")
        }
        _ => format!(
            "  <shape type=\"cylinder\">\n    <float name=\"radius\" value=\"{radius}\"/>\n    <point name=\"p0\" x=\"0\" y=\"0\" z=\"{}\"/>\n    <point name=\"p1\" x=\"0\" y=\"0\" z=\"{}\"/>\n",
            -20.0 * radius,
            20.0 * radius
        ),
    };
    let plugin = if table {
        "\nThe material is a table, read by a plugin in Python: `import flatlight_merl` after choosing the variant and before loading this file."
    } else {
        ""
    };
    let dark = if lit {
        ""
    } else {
        "\nThe light of this run is not known: add emitters."
    };
    Ok(format!(
        "<scene version=\"3.0.0\">\n{}  <default name=\"orbit\" value=\"0\"/>\n  <default name=\"spp\" value=\"1024\"/>\n\
         \x20 <integrator type=\"path\">\n    <integer name=\"max_depth\" value=\"2\"/>\n  </integrator>\n\
         \x20 <sensor type=\"{sensor}\">\n{lens}      <lookat origin=\"{distance}, 0, 0\" target=\"0, 0, 0\" up=\"0, {sin}, {cos}\"/>\n      <rotate z=\"1\" angle=\"$orbit\"/>\n    </transform>\n\
         \x20   <film type=\"hdrfilm\">\n      <integer name=\"width\" value=\"{width}\"/>\n      <integer name=\"height\" value=\"{height}\"/>\n      <string name=\"pixel_format\" value=\"rgb\"/>\n\
         \x20     <string name=\"component_format\" value=\"float32\"/>\n      <rfilter type=\"box\"/>\n    </film>\n\
         \x20   <sampler type=\"independent\">\n      <integer name=\"sample_count\" value=\"$spp\"/>\n    </sampler>\n  </sensor>\n\
         \x20 <include filename=\"material.xml\"/>\n{}{shape}    <ref id=\"material\"/>\n  </shape>\n</scene>\n",
        comment(&format!(
            "{}\nmitsuba -m llvm_ad_rgb -D orbit=45 scene.xml    the photograph from 45 degrees. A lens's distortion and an object beside the orbit's centre are not modelled.{plugin}{dark}",
            run.capture_name
        )),
        if lit {
            "  <include filename=\"light.xml\"/>\n"
        } else {
            ""
        }
    ))
}

/// Text as a comment of XML, which must not hold two hyphens in a row.
fn comment(text: &str) -> String {
    let mut safe = text.trim().to_owned();
    while safe.contains("--") {
        safe = safe.replace("--", "-");
    }
    format!("  <!-- {} -->\n", safe.replace('\n', "\n       "))
}
