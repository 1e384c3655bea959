//! Reflected radiance of a surface element in 3-D under light from the measurement plane.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;
use std::sync::Arc;

use nalgebra::Vector3;

use super::body::Hit;
use super::panels;
use crate::angle::{LocalAngle, WorldAngle, wrap};
use crate::brdf::{Brdf, Family, Isotropic, Model, Pair};
use crate::error::{Error, Result};
use crate::fourier::{CircleTransform, Series};
use crate::lighting::Lighting;
use crate::reflect::panels::{for_each_node, panel_ends};

/// The BRDF of every channel.
#[derive(Clone, Debug)]
enum Surface {
    /// Known in 3-D: evaluated out of the plane.
    Space(Vec<Arc<dyn Isotropic>>),
    /// Known in the plane only (a table), or defined there only (the mirror of [RH01]): normal and direction
    /// to the camera are projected on the plane.
    Plane(Vec<Arc<dyn Brdf>>),
}

/// Light and material, ready to be evaluated at many points.
#[derive(Clone, Debug)]
pub(super) struct Shader {
    surface: Surface,
    lighting: Lighting,
    smooth: Vec<Density>,
}

/// The plane of the light in camera axes: its reference direction turned by the orbit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// Direction to the camera in the frame of the light, radians.
    pub orbit: f64,
    axes: [Vector3<f64>; 3],
}

impl Plane {
    /// The light's plane, rolled about the optical axis by `roll` radians.
    pub(super) fn new(orbit: f64, roll: f64) -> Self {
        let (sin, cos) = roll.sin_cos();
        Self {
            orbit,
            axes: [
                Vector3::x(),
                Vector3::new(0.0, cos, sin),
                Vector3::new(0.0, -sin, cos),
            ],
        }
    }

    fn toward(&self, theta: f64) -> Vector3<f64> {
        let (sin, cos) = (theta - self.orbit).sin_cos();
        self.axes[0] * cos + self.axes[1] * sin
    }

    /// Angle of a direction's projection on the plane, in the frame of the light, and the projection's length.
    fn angle(&self, v: Vector3<f64>) -> (f64, f64) {
        let (x, y) = (v.dot(&self.axes[0]), v.dot(&self.axes[1]));
        (wrap(y.atan2(x) + self.orbit), x.hypot(y))
    }

    /// A vector of camera axes in the frame that stands still with the light.
    pub(super) fn still(&self, v: Vector3<f64>) -> Vector3<f64> {
        let [x, y, z] = self.axes.map(|axis| v.dot(&axis));
        let (sin, cos) = self.orbit.sin_cos();
        Vector3::new(x * cos - y * sin, x * sin + y * cos, z)
    }
}

impl Shader {
    /// Relative paths of the material are taken from `folder`.
    ///
    /// # Errors
    /// A BRDF whose channels are not the light's; a mirror under a directional source.
    pub(super) fn new(model: &Model, lighting: &Lighting, folder: &Path) -> Result<Self> {
        let material = model.material(&lighting.channels, folder)?;
        let mirror = material
            .brdfs
            .iter()
            .any(|b| b.mirror(LocalAngle::radians(0.0)) != 0.0);
        if mirror && !lighting.sources.is_empty() {
            return Err(Error::input(
                "a mirror shows a directional source as a point of infinite radiance",
            )
            .key("lighting.sources")
            .advice(
                "Give the source a width (a table of lighting), or the material a rough lobe.",
            ));
        }
        let surface = match model {
            Model::Analytic { family, values } if *family != Family::Mirror => Surface::Space(
                (0..lighting.channels.len())
                    .map(|c| {
                        let of_channel: Vec<f64> = values
                            .iter()
                            .filter_map(|v| v.get(c).or(v.first()).copied())
                            .collect();
                        family.build(&of_channel)
                    })
                    .collect(),
            ),
            _ => Surface::Plane(material.brdfs),
        };
        let smooth = (0..lighting.channels.len())
            .map(|c| Density::new(lighting, c))
            .collect();
        Ok(Self {
            surface,
            lighting: lighting.clone(),
            smooth,
        })
    }

    pub(super) fn channels(&self) -> &[String] {
        &self.lighting.channels
    }

    /// Whether the BRDF is evaluated in 3-D, not by its projection on the plane.
    pub(super) fn is_spatial(&self) -> bool {
        matches!(self.surface, Surface::Space(_))
    }

    /// Whether there is light beside the sources.
    pub(super) fn has_smooth(&self) -> bool {
        self.smooth.iter().any(|d| !d.is_dark())
    }

    fn brdf(&self, channel: usize) -> Option<&dyn Brdf> {
        match &self.surface {
            Surface::Space(all) => all.get(channel).map(|b| b.as_ref() as &dyn Brdf),
            Surface::Plane(all) => all.get(channel).map(|b| b.as_ref()),
        }
    }

    /// The channel with the narrowest lobe.
    fn sharpest(&self) -> Option<&dyn Brdf> {
        (0..self.channels().len())
            .filter_map(|c| self.brdf(c))
            .min_by(|a, b| a.lobe_width().total_cmp(&b.lobe_width()))
    }

    /// Sizes (radians), within the light's plane and out of it, of regions in which [`Shader::add_smooth`] can have no detail
    /// that eight nodes would not notice. Along the plane what is reflected is as smooth as the
    /// smoother of light and lobe, out of it as the lobe; the mirror direction turns twice as fast as the normal.
    pub(super) fn detail(&self) -> [f64; 2] {
        let order = self.smooth.iter().map(Density::order).max().unwrap_or(0);
        let by_light = 4.0 / order.max(1) as f64;
        let by_lobe = self.sharpest().map_or(PI, |b| 2.0 * b.lobe_width());
        [by_light.max(by_lobe), by_lobe].map(|size| size.clamp(PI / 256.0, PI / 8.0))
    }

    /// Adds what the sources (and, in a mirror, the smooth light) send to the camera, W m⁻² sr⁻¹ per
    /// channel: exact.
    pub(super) fn add_direct(&self, hit: &Hit, plane: &Plane, out: &mut [f64]) {
        for source in &self.lighting.sources {
            let light = plane.toward(source.theta.rad());
            self.for_rho(hit, plane, light, source.theta.rad(), |c, rho_cos| {
                if let Some(out) = out.get_mut(c) {
                    *out += rho_cos * source.in_channel(c);
                }
            });
        }
        if let Surface::Plane(all) = &self.surface {
            let (normal, _) = plane.angle(hit.normal);
            let local = LocalAngle::radians(wrap(plane.angle(hit.view).0 - normal));
            for ((out, brdf), light) in out.iter_mut().zip(all).zip(&self.smooth) {
                let mirror = brdf.mirror(local);
                if mirror != 0.0 {
                    *out += mirror * light.at(normal - local.rad());
                }
            }
        }
    }

    /// Adds what the smooth light sends to the camera by the BRDF without a mirror, W m⁻² sr⁻¹ per channel:
    /// the integral over the half circle above the surface.
    pub(super) fn add_smooth(&self, hit: &Hit, plane: &Plane, out: &mut [f64]) {
        let Some(sharpest) = self.sharpest() else {
            return;
        };
        let (normal, _) = plane.angle(hit.normal);
        let local = LocalAngle::radians(wrap(plane.angle(hit.view).0 - normal));
        let order = self
            .smooth
            .iter()
            .map(|d| d.series_order)
            .max()
            .unwrap_or(0);
        let mut breaks: Vec<f64> = self
            .smooth
            .iter()
            .flat_map(|d| &d.kinks)
            .map(|theta| wrap(theta - normal))
            .collect();
        if self.is_spatial() {
            let (behind, length) = plane.angle(-hit.view);
            let out = (1.0 - length * length).max(0.0).sqrt();
            breaks.extend(panels::grazing(wrap(behind - normal), out));
            if !sharpest.kinks(local).is_empty() {
                let toward = |angle: f64| plane.toward(normal + angle);
                breaks.extend(panels::kinks(hit.normal, hit.view, toward));
            }
        }
        let ends = panel_ends(sharpest, local, order, breaks);
        self.integrate(hit, plane, &ends, out);
    }

    /// Adds the integral over the panels between `ends`, angles from the normal's projection on the plane.
    fn integrate(&self, hit: &Hit, plane: &Plane, ends: &[f64], out: &mut [f64]) {
        let (normal, _) = plane.angle(hit.normal);
        for_each_node(ends, |angle, weight| {
            let theta = normal + angle;
            self.for_rho(hit, plane, plane.toward(theta), theta, |c, rho_cos| {
                if let (Some(out), Some(light)) = (out.get_mut(c), self.smooth.get(c)) {
                    *out += weight * rho_cos * light.at(theta);
                }
            });
        });
    }

    /// [`Shader::add_smooth`] by panels so many and so small towards the horizon and the lobe that nothing needs to be known
    /// about the surface.
    #[cfg(test)]
    pub(super) fn add_smooth_slowly(&self, hit: &Hit, plane: &Plane, out: &mut [f64]) {
        let (normal, _) = plane.angle(hit.normal);
        let local = wrap(plane.angle(hit.view).0 - normal);
        let mut ends: Vec<f64> = (-200..=200).map(|k| f64::from(k) * PI / 400.0).collect();
        for k in 0..40 {
            let d = 0.7f64.powi(k);
            ends.extend([FRAC_PI_2 - d, d - FRAC_PI_2, d - local, -d - local]);
        }
        let kinks = self.smooth.iter().flat_map(|d| &d.kinks);
        ends.extend(kinks.map(|theta| wrap(theta - normal)));
        ends.retain(|end| end.abs() <= FRAC_PI_2);
        ends.sort_by(f64::total_cmp);
        self.integrate(hit, plane, &ends, out);
    }

    /// Calls `visit(channel, ρ · cosine)` for light from `light`, whose angle in the plane is `theta`.
    fn for_rho(
        &self,
        hit: &Hit,
        plane: &Plane,
        light: Vector3<f64>,
        theta: f64,
        mut visit: impl FnMut(usize, f64),
    ) {
        match &self.surface {
            Surface::Space(all) => {
                let directions = [hit.normal, light, hit.view].map(<[f64; 3]>::from);
                let Some(pair) = Pair::between(directions[0], directions[1], directions[2]) else {
                    return;
                };
                for (c, brdf) in all.iter().enumerate() {
                    visit(c, brdf.rho(&pair) * pair.cos_incident);
                }
            }
            Surface::Plane(all) => {
                let (normal, _) = plane.angle(hit.normal);
                let incident = LocalAngle::radians(wrap(theta - normal));
                let exitant = LocalAngle::radians(wrap(plane.angle(hit.view).0 - normal));
                // A normal out of the plane still gets the light under its true cosine.
                let cosine = hit.normal.dot(&light);
                if cosine > 0.0 && incident.rad().abs() <= FRAC_PI_2 {
                    for (c, brdf) in all.iter().enumerate() {
                        visit(c, brdf.value(incident, exitant) * cosine);
                    }
                }
            }
        }
    }
}

/// The smooth light of one channel, quick to look up: the band-limited part from a table so fine that
/// cubic interpolation is exact to 1e-9, the rest as it is.
#[derive(Clone, Debug)]
struct Density {
    fine: Vec<f64>,
    series_order: usize,
    rest: Lighting,
    /// Angles at which the table has its sharpest bends, radians.
    kinks: Vec<f64>,
}

impl Density {
    fn new(lighting: &Lighting, channel: usize) -> Self {
        let series = lighting
            .smooth
            .get(channel)
            .cloned()
            .unwrap_or_else(|| Series::zero(0));
        // (2π order/n)⁴ · 3/128 ≤ 1e-9 for n ≥ 440 · order.
        let n = (440 * series.order()).max(16).next_power_of_two();
        Self {
            kinks: kinks(lighting.table.get(channel).map_or(&[], Vec::as_slice)),
            fine: CircleTransform::new(n, -PI).synthesise(&series),
            series_order: series.order(),
            rest: Lighting {
                table: lighting.table.get(channel).cloned().into_iter().collect(),
                ..Lighting::default()
            },
        }
    }

    fn is_dark(&self) -> bool {
        let dark = |values: &Vec<f64>| values.iter().all(|v| *v == 0.0);
        dark(&self.fine) && self.rest.table.iter().all(dark)
    }

    /// The largest frequency worth resolving: a table's is that of its own step.
    fn order(&self) -> usize {
        let tabulated = self
            .rest
            .table
            .iter()
            .filter(|t| t.windows(2).any(|w| w[0] != w[1]))
            .map(|t| t.len() / 2)
            .max();
        self.series_order.max(tabulated.unwrap_or(0))
    }

    /// L(θ), W m⁻² rad⁻¹.
    fn at(&self, theta: f64) -> f64 {
        let n = self.fine.len();
        let position = (wrap(theta) + PI) / TAU * n as f64;
        let t = position.fract();
        let i = position as usize + n;
        let v = |k: usize| self.fine.get((i + k - 1) % n).copied().unwrap_or(0.0);
        let band_limited = v(0) * (-t * (t - 1.0) * (t - 2.0) / 6.0)
            + v(1) * ((t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0)
            + v(2) * (-(t + 1.0) * t * (t - 2.0) / 2.0)
            + v(3) * ((t + 1.0) * t * (t - 1.0) / 6.0);
        let tabulated = match self.rest.table.first().map(Vec::as_slice) {
            None => 0.0,
            Some([constant]) => *constant,
            Some(_) => self.rest.density(0, WorldAngle::radians(theta)),
        };
        band_limited + tabulated
    }
}

/// Angles (radians) of the strongest bends of a table of light: those above a hundredth of its range, but no
/// more than a quadrature can afford to end its panels at.
fn kinks(table: &[f64]) -> Vec<f64> {
    const MOST: usize = 64;
    let n = table.len();
    let low = table.iter().copied().fold(f64::INFINITY, f64::min);
    let high = table.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut bends: Vec<(f64, usize)> = (0..n)
        .map(|i| {
            let bend = table[(i + n - 1) % n] - 2.0 * table[i] + table[(i + 1) % n];
            (bend.abs(), i)
        })
        .filter(|(bend, _)| *bend > 0.01 * (high - low))
        .collect();
    bends.sort_by(|a, b| b.0.total_cmp(&a.0));
    bends.truncate(MOST);
    bends
        .into_iter()
        .map(|(_, i)| -PI + TAU * i as f64 / n as f64)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::Material;
    use crate::grid::Grid;
    use crate::lighting::Source;
    use crate::reflect::product;

    /// A point of the plane's own cross-section: normal at `normal`, camera at `normal` + `local`.
    fn in_plane(normal: f64, local: f64, plane: &Plane) -> Hit {
        Hit {
            normal: plane.toward(normal),
            view: plane.toward(normal + local),
            point: plane.toward(normal),
        }
    }

    #[test]
    fn in_the_plane_it_is_the_light_field() {
        let channels = vec!["Y".to_string()];
        let smooth: Vec<f64> = (0..720)
            .map(|i| 1.0 + (f64::from(i) * TAU / 120.0).cos())
            .collect();
        let smooth = Lighting::from_samples(channels.clone(), &[smooth], -PI);
        let sun = Lighting::from_sources(
            channels.clone(),
            vec![Source {
                theta: WorldAngle::degrees(37.3),
                irradiance: vec![3.0],
            }],
        );
        let grid = Grid {
            normals: 24,
            locals: 18,
        };
        for (text, lighting) in [
            ("model = \"mirror\"\nreflectance = 0.8", smooth.clone()),
            (
                "model = \"phong\"\nspecular = 0.4\nexponent = 32",
                smooth.plus(&sun),
            ),
            (
                "model = \"ggx-conductor\"\nalpha = 0.2\neta = 0.2\nk = 3.9",
                smooth.plus(&sun),
            ),
            (
                "model = \"oren-nayar\"\nalbedo = 0.5\nsigma_deg = 20",
                smooth.plus(&sun),
            ),
        ] {
            let model = Model::from_table(&text.parse().expect("TOML")).expect("a model");
            let shader = Shader::new(&model, &lighting, Path::new("")).expect("fits");
            let material: Material = model.material(&channels, Path::new("")).expect("fits");
            let order = product::sufficient_order(&lighting);
            let field = product::on_grid(&lighting, &material, grid, order).expect("fits");
            let largest = field[0].iter().fold(0.0f64, |a, b| a.max(*b));
            let plane = Plane::new(1.1, 0.2);
            for i in 0..grid.normals {
                for j in 0..grid.locals {
                    let hit = in_plane(grid.normal(i).rad(), grid.local(j).rad(), &plane);
                    let mut found = [0.0];
                    shader.add_direct(&hit, &plane, &mut found);
                    shader.add_smooth(&hit, &plane, &mut found);
                    let expected = field[0][grid.index(i, j)];
                    // The light is interpolated to 1e-9.
                    assert!(
                        (found[0] - expected).abs() < 1e-8 * largest,
                        "{text} {i} {j}: {} {expected}",
                        found[0]
                    );
                }
            }
        }
    }

    #[test]
    fn a_table_out_of_the_plane_is_its_projection() {
        let channels = vec!["Y".to_string()];
        let sun = Lighting::from_sources(
            channels,
            vec![Source {
                theta: WorldAngle::degrees(20.0),
                irradiance: vec![1.0],
            }],
        );
        let model = Model::from_table(
            &"model = \"lambertian\"\nalbedo = 0.5"
                .parse()
                .expect("TOML"),
        )
        .expect("a model");
        let space = Shader::new(&model, &sun, Path::new("")).expect("fits");
        let projected = Shader {
            surface: Surface::Plane(
                model
                    .material(space.channels(), Path::new(""))
                    .expect("fits")
                    .brdfs,
            ),
            ..space.clone()
        };
        assert!(space.is_spatial() && !projected.is_spatial());
        let plane = Plane::new(0.0, 0.0);
        let hit = Hit {
            normal: Vector3::new(0.9, 0.2, 0.3).normalize(),
            view: Vector3::new(1.0, 0.0, 0.1).normalize(),
            point: Vector3::zeros(),
        };
        let (mut a, mut b) = ([0.0], [0.0]);
        space.add_direct(&hit, &plane, &mut a);
        projected.add_direct(&hit, &plane, &mut b);
        // Lambert's BRDF is the same in all directions, so the projection changes nothing.
        assert!(a[0] > 0.1 && (a[0] - b[0]).abs() < 1e-15);
    }
}
