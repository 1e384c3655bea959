//! The recovered slice as `brdf_spectrum.csv` and `brdf.exr`.

use std::fmt::Write as _;

use crate::light_field::Part;
use crate::recover::Status;
use crate::recover::brdf::BrdfEstimate;

/// `channel,p,q,re,im,sigma,status` of ρ̃, p ≥ |q|; the rest follows from ρ̃_{q,p} = ρ̃_{p,q} and ρ̃_{−p,−q} = conj ρ̃_{p,q}.
/// σ is of the real and of the imaginary part. A coefficient that is indeterminate has no value.
pub fn spectrum_csv(brdf: &BrdfEstimate) -> String {
    let mut text = String::from("channel,p,q,re,im,sigma,status\n");
    for (name, slice) in brdf.channels.iter().zip(&brdf.slices) {
        for c in &slice.spectrum {
            let _ = write!(text, "{name},{},{},", c.p, c.q);
            if c.status == Status::Indeterminate {
                text.push_str(",,");
            } else {
                let _ = write!(text, "{},{},{}", c.value.re, c.value.im, c.sigma);
            }
            let _ = writeln!(text, ",{}", c.status.word());
        }
    }
    text
}

/// The slice as an image: layers `rho`, `sigma` (0 where indeterminate) and `status` (2 determined, 1 weak, 0
/// indeterminate); a row per θi′, a column per θo′.
pub fn image(brdf: &BrdfEstimate) -> Part<'static> {
    let n = brdf.size;
    let mut planes = Vec::new();
    for (c, (name, slice)) in brdf.channels.iter().zip(&brdf.slices).enumerate() {
        let cells = || (0..n * n).map(|k| brdf.rho(c, k / n, k % n).unwrap_or((0.0, 0.0)));
        planes.push((format!("rho.{name}"), cells().map(|v| v.0 as f32).collect()));
        planes.push((
            format!("sigma.{name}"),
            cells().map(|v| v.1 as f32).collect(),
        ));
        let status = slice.status.iter().map(|s| match s {
            Status::Determined => 2.0,
            Status::Weak => 1.0,
            Status::Indeterminate => 0.0,
        });
        planes.push((format!("status.{name}"), status.collect()));
    }
    let step = 180.0 / n.max(1) as f32;
    Part {
        name: "brdf".into(),
        size: [n, n],
        planes,
        texts: [
            ("rows", "theta_i_local_deg = rowStartDeg + (i + 0.5) * rowStepDeg"),
            (
                "columns",
                "theta_o_local_deg = columnStartDeg + (j + 0.5) * columnStepDeg",
            ),
            (
                "content",
                "BRDF rho in the plane of incidence, 1/sr, signed local angles, no cosine; status 2 determined, 1 weak, 0 indeterminate",
            ),
        ]
        .map(|(k, v)| (k.into(), v.into()))
        .to_vec(),
        numbers: vec![
            ("rowStartDeg".into(), -90.0),
            ("rowStepDeg".into(), step),
            ("columnStartDeg".into(), -90.0),
            ("columnStepDeg".into(), step),
        ],
    }
}
