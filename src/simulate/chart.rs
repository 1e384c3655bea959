//! Reflected smooth light over the visible surface, tabulated once per view and interpolated.
//!
//! The integral over the light costs some hundred evaluations of the BRDF; in the coordinates of
//! [`Body::chart`] its value is piecewise smooth, so that a few thousand nodes serve millions of rays. Where it is not
//! smooth cannot be said beforehand: an edge of the light is cut off along a meridian, and where the view grazes, the half
//! vector to light from the far horizon turns within the view's elevation above the light's plane, so that a rough
//! surface's value has a singular point on the limb. So the chart is divided until each cell's own Chebyshev
//! series has ended.

use std::f64::consts::{FRAC_PI_2, PI};

use rayon::prelude::*;

use super::body::{Body, Hit};
use super::shade::{Plane, Shader};
use crate::geometry::CameraModel;

/// Nodes of a cell in each coordinate.
const NODES: usize = 8;
/// What the two last Chebyshev coefficients of a cell may have in either coordinate, of the largest value in the
/// picture. What is left out is less than they are where the series converges, and some four times as much at a
/// kink.
const ENOUGH: f64 = 4e-6;
/// Steps in which that is approached: if the cells run out, all are equally good.
const STAGES: [f64; 5] = [1e-2, 1e-3, 1e-4, 2e-5, ENOUGH];
/// Most cells, and halvings of one.
const MOST_CELLS: usize = 1 << 14;
const MOST_HALVINGS: u32 = 24;
/// Positions per side of the image at which the range of the chart is looked for.
const LATTICE: u32 = 48;

/// A rectangle of the chart: from and to in φ and τ, radians.
type Extent = [[f64; 2]; 2];

/// The Chebyshev series of a rectangle.
#[derive(Clone, Debug)]
struct Cell {
    extent: Extent,
    halvings: u32,
    /// \[order in τ\]\[order in φ\]\[channel\].
    coefficients: Vec<f64>,
    /// What the last coefficients in φ and in τ have, in units of the channel's largest value.
    tails: [f64; 2],
}

/// A node of the tree of halvings.
#[derive(Clone, Copy, Debug)]
enum Branch {
    /// Index of a cell.
    Cell(usize),
    /// Halved in φ (0) or τ (1); the lower half stands here, the upper one after it.
    Halved(usize, usize),
}

/// Reflected smooth light of one view, W m⁻² sr⁻¹.
#[derive(Debug)]
pub(super) struct SmoothPart {
    extent: Extent,
    /// Number of equal first cells in φ and τ.
    first: [usize; 2],
    /// The first cells, φ running fastest, then the halves.
    tree: Vec<Branch>,
    cells: Vec<Cell>,
    channels: usize,
}

/// What a cell is computed from.
struct Painter<'a> {
    shader: &'a Shader,
    body: &'a Body,
    plane: &'a Plane,
    channels: usize,
}

impl Painter<'_> {
    fn cell(&self, extent: Extent, halvings: u32) -> Cell {
        let place = |[from, to]: [f64; 2], k: usize| {
            let x = (PI * (k as f64 + 0.5) / NODES as f64).cos();
            0.5 * (from + to) + 0.5 * (to - from) * x
        };
        let mut values = vec![0.0; NODES * NODES * self.channels];
        for (i, out) in values.chunks_exact_mut(self.channels).enumerate() {
            let at = [place(extent[0], i % NODES), place(extent[1], i / NODES)];
            self.shader.add_smooth(&self.body.at(at), self.plane, out);
        }
        let across = transform(&values, self.channels);
        let coefficients = transform(&across, NODES * self.channels);
        Cell {
            extent,
            halvings,
            coefficients,
            tails: [0.0; 2],
        }
    }
}

/// Chebyshev coefficients from values at the nodes, along the middle of the axes \[outer\]\[NODES\]\[inner\].
fn transform(values: &[f64], inner: usize) -> Vec<f64> {
    let mut out = vec![0.0; values.len()];
    for (block, out) in values
        .chunks_exact(NODES * inner)
        .zip(out.chunks_exact_mut(NODES * inner))
    {
        for (k, out) in out.chunks_exact_mut(inner).enumerate() {
            let scale = if k == 0 { 1.0 } else { 2.0 } / NODES as f64;
            for (j, row) in block.chunks_exact(inner).enumerate() {
                let turn = PI * k as f64 * (j as f64 + 0.5) / NODES as f64;
                let factor = scale * turn.cos();
                for (out, value) in out.iter_mut().zip(row) {
                    *out += factor * value;
                }
            }
        }
    }
    out
}

impl Cell {
    /// How much the last two orders in φ and in τ can make together, of each channel's `largest`; the worst channel.
    fn set_tails(&mut self, largest: &[f64]) {
        let channels = largest.len();
        let mut sums = vec![[0.0f64; 2]; channels];
        for (i, of_node) in self.coefficients.chunks_exact(channels.max(1)).enumerate() {
            for (axis, order) in [i % NODES, i / NODES].into_iter().enumerate() {
                if order + 2 >= NODES {
                    for (sum, c) in sums.iter_mut().zip(of_node) {
                        sum[axis] += c.abs();
                    }
                }
            }
        }
        self.tails = [0, 1].map(|axis| {
            let shares = sums.iter().zip(largest);
            shares.fold(0.0f64, |m, (sum, top)| match *top > 0.0 {
                true => m.max(sum[axis] / top),
                false => m,
            })
        });
    }

    /// The coordinate in which it is to be halved; `None` if it is good enough.
    fn wants(&self, enough: f64) -> Option<usize> {
        let axis = usize::from(self.tails[1] > self.tails[0]);
        (self.tails[axis] > enough && self.halvings < MOST_HALVINGS).then_some(axis)
    }

    fn halves(&self, axis: usize) -> [Extent; 2] {
        let [from, to] = self.extent[axis];
        let middle = 0.5 * (from + to);
        [[from, middle], [middle, to]].map(|half| {
            let mut extent = self.extent;
            extent[axis] = half;
            extent
        })
    }
}

impl SmoothPart {
    /// `None` if there is no smooth light, or nothing of the object in the picture.
    pub(super) fn new(
        shader: &Shader,
        body: &Body,
        camera: &CameraModel,
        plane: &Plane,
    ) -> Option<Self> {
        if !shader.has_smooth() {
            return None;
        }
        let [within, out] = shader.detail();
        // Towards a sphere's poles and with a rolled plane φ leads out of the light's plane too.
        let across = if body.is_sphere() {
            within.min(out)
        } else {
            within
        };
        let mut extent = [[-FRAC_PI_2, FRAC_PI_2], tau_range(body, camera)?];
        if extent[1][1] - extent[1][0] < 1e-6 {
            // An orthographic camera sees a cylinder from one elevation.
            extent[1] = [extent[1][0] - 1e-6, extent[1][1] + 1e-6];
        }
        let pieces =
            |[from, to]: [f64; 2], size: f64| ((to - from) / size).ceil().max(1.0) as usize;
        let first = [pieces(extent[0], across), pieces(extent[1], out)];
        let channels = shader.channels().len();
        let painter = Painter {
            shader,
            body,
            plane,
            channels,
        };
        let part = |[from, to]: [f64; 2], k: usize, n: usize| {
            let at = |k: usize| from + (to - from) * k as f64 / n as f64;
            [at(k), at(k + 1)]
        };
        let cells: Vec<Cell> = (0..first[0] * first[1])
            .into_par_iter()
            .map(|i| {
                let cell = [
                    part(extent[0], i % first[0], first[0]),
                    part(extent[1], i / first[0], first[1]),
                ];
                painter.cell(cell, 0)
            })
            .collect();
        let mut made = Self {
            extent,
            first,
            tree: (0..cells.len()).map(Branch::Cell).collect(),
            cells,
            channels,
        };
        made.divide(&painter);
        Some(made)
    }

    /// Halves cells until each is good enough, or there are too many.
    fn divide(&mut self, painter: &Painter) {
        // A bound of |Σ c T T| by its coefficients; of a smooth cell it is hardly more than the largest value.
        let largest: Vec<f64> = (0..self.channels)
            .map(|c| {
                let sums = self.cells.iter().map(|cell| {
                    let of_channel = cell.coefficients.iter().skip(c).step_by(self.channels);
                    of_channel.map(|v| v.abs()).sum::<f64>()
                });
                sums.fold(0.0, f64::max)
            })
            .collect();
        for cell in &mut self.cells {
            cell.set_tails(&largest);
        }
        let mut where_in_tree: Vec<usize> = (0..self.cells.len()).collect();
        for enough in STAGES {
            loop {
                let mut wanted: Vec<(usize, usize)> = self
                    .cells
                    .iter()
                    .enumerate()
                    .filter_map(|(i, cell)| Some((i, cell.wants(enough)?)))
                    .collect();
                wanted.truncate(MOST_CELLS.saturating_sub(self.cells.len()));
                if wanted.is_empty() {
                    break;
                }
                let halves: Vec<[Cell; 2]> = wanted
                    .par_iter()
                    .map(|&(i, axis)| {
                        let cell = &self.cells[i];
                        cell.halves(axis).map(|extent| {
                            let mut half = painter.cell(extent, cell.halvings + 1);
                            half.set_tails(&largest);
                            half
                        })
                    })
                    .collect();
                for ((i, axis), [lower, upper]) in wanted.into_iter().zip(halves) {
                    let at = self.tree.len();
                    let new = self.cells.len();
                    self.tree[where_in_tree[i]] = Branch::Halved(axis, at);
                    self.tree.extend([Branch::Cell(i), Branch::Cell(new)]);
                    self.cells[i] = lower;
                    self.cells.push(upper);
                    where_in_tree[i] = at;
                    where_in_tree.push(at + 1);
                }
            }
        }
    }

    /// The cell that holds a place of the chart.
    fn cell(&self, at: [f64; 2]) -> &Cell {
        let mut extent = self.extent;
        let mut place = [0; 2];
        for axis in 0..2 {
            let [from, to] = extent[axis];
            let n = self.first[axis];
            let k = ((at[axis] - from) / (to - from) * n as f64) as usize;
            place[axis] = k.min(n - 1);
            let end = |k: usize| from + (to - from) * k as f64 / n as f64;
            extent[axis] = [end(place[axis]), end(place[axis] + 1)];
        }
        let mut branch = place[1] * self.first[0] + place[0];
        loop {
            match self.tree[branch] {
                Branch::Cell(i) => return &self.cells[i],
                Branch::Halved(axis, halves) => {
                    let [from, to] = extent[axis];
                    let middle = 0.5 * (from + to);
                    let upper = at[axis] >= middle;
                    extent[axis] = if upper { [middle, to] } else { [from, middle] };
                    branch = halves + usize::from(upper);
                }
            }
        }
    }

    /// Adds the light reflected at a point, per channel.
    pub(super) fn add(&self, body: &Body, hit: &Hit, out: &mut [f64]) {
        let at = body.chart(hit);
        let cell = self.cell(at);
        let [across, along] = [0, 1].map(|axis| {
            let [from, to] = cell.extent[axis];
            let x = ((2.0 * at[axis] - from - to) / (to - from)).clamp(-1.0, 1.0);
            // Chebyshev's polynomials.
            let mut t = [1.0; NODES];
            t[1] = x;
            for k in 2..NODES {
                t[k] = 2.0 * x * t[k - 1] - t[k - 2];
            }
            t
        });
        let row = NODES * self.channels;
        for (row, b) in cell.coefficients.chunks_exact(row).zip(along) {
            for (of_node, a) in row.chunks_exact(self.channels).zip(across) {
                for (out, c) in out.iter_mut().zip(of_node) {
                    *out += a * b * c;
                }
            }
        }
    }
}

/// The values of τ in the picture, radians; `None` if the object is not in it.
fn tau_range(body: &Body, camera: &CameraModel) -> Option<[f64; 2]> {
    let [width, height] = camera.size();
    // However thin the object, the column of its centre shows it.
    let centre = camera.project(body.centre()).map(|[u, _]| u);
    let columns: Vec<f64> = (0..=LATTICE)
        .map(|i| width * f64::from(i) / f64::from(LATTICE))
        .chain(centre.filter(|u| (0.0..=width).contains(u)))
        .collect();
    let row = |j: u32| {
        let v = height * f64::from(j) / f64::from(LATTICE);
        columns
            .iter()
            .filter_map(|&u| Some(body.chart(&body.hit(&camera.ray([u, v]))?)[1]))
            .fold(None, |range: Option<[f64; 2]>, tau| {
                let [low, high] = range.unwrap_or([tau, tau]);
                Some([low.min(tau), high.max(tau)])
            })
    };
    let rows: Vec<Option<[f64; 2]>> = (0..=LATTICE).map(row).collect();
    let seen: Vec<[f64; 2]> = rows.iter().flatten().copied().collect();
    if seen.is_empty() {
        // A sphere between the lattice's points, or none: the whole range costs little beside a wrong picture.
        return body.is_sphere().then_some([-FRAC_PI_2, FRAC_PI_2]);
    }
    let low = seen.iter().map(|r| r[0]).fold(f64::INFINITY, f64::min);
    let high = seen.iter().map(|r| r[1]).fold(f64::NEG_INFINITY, f64::max);
    // What lies between the lattice's points is less than a step of it outside.
    let margin = 2.0 * (high - low) / f64::from(LATTICE);
    let (mut low, mut high) = (low - margin, high + margin);
    if body.is_sphere() {
        // Where the sphere ends within the picture τ runs to its pole, faster than any lattice.
        if rows.last().is_some_and(Option::is_none) {
            low = -FRAC_PI_2;
        }
        if rows.first().is_some_and(Option::is_none) {
            high = FRAC_PI_2;
        }
        (low, high) = (low.max(-FRAC_PI_2), high.min(FRAC_PI_2));
    }
    (high - low < PI + 1e-9).then_some([low, high])
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::brdf::Model;
    use crate::capture::{Camera, Object, Projection, Shape};
    use crate::fourier::Series;
    use crate::geometry::Pose;
    use crate::lighting::Lighting;
    use num_complex::Complex64;

    fn light(kind: &str) -> Lighting {
        let channels = vec!["Y".to_string()];
        match kind {
            "uniform" => Lighting::uniform(channels, &[0.7]),
            "order 15" => {
                let coefficients = (0..=15)
                    .map(|p| Complex64::cis(1.7 * f64::from(p * p)) / f64::from(1 + p))
                    .collect();
                Lighting::band_limited(channels, vec![Series { coefficients }])
            }
            _ => {
                // A window 30° wide with edges of one degree.
                let values = (0..360).map(|i| if (200..230).contains(&i) { 3.0 } else { 0.1 });
                Lighting {
                    channels,
                    table: vec![values.collect()],
                    ..Lighting::default()
                }
            }
        }
    }

    const LOBES: [(&str, &str); 3] = [
        ("model = \"lambertian\"\nalbedo = 0.5", "window"),
        (
            "model = \"phong\"\nspecular = 0.4\nexponent = 300",
            "order 15",
        ),
        (
            "model = \"phong\"\nspecular = 0.4\nexponent = 300",
            "window",
        ),
    ];
    const MICROFACETS: [(&str, &str); 5] = [
        (
            "model = \"ggx-conductor\"\nalpha = 0.1\neta = 0.2\nk = 3.9",
            "window",
        ),
        (
            "model = \"ggx-dielectric\"\nalpha = 0.3\ndiffuse = 0.3",
            "uniform",
        ),
        (
            "model = \"ggx-dielectric\"\nalpha = 0.05\ndiffuse = 0.3",
            "order 15",
        ),
        (
            "model = \"ggx-dielectric\"\nalpha = 0.1\ndiffuse = 0.3",
            "window",
        ),
        (
            "model = \"torrance-sparrow\"\ndiffuse = 0.3\nroughness = 0.15\nior = 1.5",
            "window",
        ),
    ];
    const CLOTH: [(&str, &str); 2] = [
        (
            "model = \"oren-nayar\"\nalbedo = 0.5\nsigma_deg = 25",
            "window",
        ),
        (
            "model = \"sheen\"\ndiffuse = 0.3\nsheen = 0.5\nexponent = 6",
            "window",
        ),
    ];

    #[test]
    fn under_lobes_it_is_the_integral() {
        check(&LOBES, Shape::Cylinder);
        check(&LOBES, Shape::Sphere);
    }

    #[test]
    fn under_microfacets_and_coats_it_is_the_integral() {
        check(&MICROFACETS, Shape::Cylinder);
        check(&MICROFACETS, Shape::Sphere);
    }

    #[test]
    fn on_cloth_it_is_the_integral() {
        check(&CLOTH, Shape::Cylinder);
        check(&CLOTH, Shape::Sphere);
        let fuzz = "model = \"sheen\"\ndiffuse = 0.3\nsheen = 0.5\nroughness = 0.3";
        check(&[(fuzz, "window")], Shape::Cylinder);
    }

    /// A camera that has the whole sphere in its picture, its poles too.
    fn camera() -> CameraModel {
        CameraModel::new(&Camera {
            projection: Projection::Perspective { focal_px: 400.0 },
            image_size: [90, 80],
            principal_point_px: [45.0, 40.0],
            distortion: [-0.1, 0.0, 0.0, 0.0, 0.0],
            distance: 0.6,
            orbit_sigma_deg: 0.0,
        })
        .unwrap()
    }

    /// Compares the table with the integral by brute force, all over the picture and close to the limb.
    fn check(cases: &[(&str, &str)], shape: Shape) {
        let camera = camera();
        let (tilt, roll) = match shape {
            Shape::Cylinder => (0.02, 0.0),
            Shape::Sphere => (0.0, 0.3),
        };
        let object = Object {
            shape,
            radius: 0.05,
            mask: None,
        };
        let pose = Pose {
            offset: [0.003, -0.002, 0.001],
            tilt,
            ..Pose::nominal()
        };
        let body = Body::new(&camera, &object, &pose);
        let plane = Plane::new(0.4, roll);
        for &(material, lights) in cases {
            let model = Model::from_table(&material.parse().unwrap()).unwrap();
            let shader = Shader::new(&model, &light(lights), Path::new("")).unwrap();
            let smooth = SmoothPart::new(&shader, &body, &camera, &plane).unwrap();
            assert!(smooth.cells.len() < MOST_CELLS / 2, "{material}");
            let mut hits = Vec::new();
            for k in 0..240 {
                // A low-discrepancy walk over the picture.
                let u = 90.0 * (f64::from(k) * 0.754_877_666).fract();
                let v = 80.0 * (f64::from(k) * 0.569_840_29).fract();
                hits.extend(body.hit(&camera.ray([u, v])));
            }
            assert!(hits.len() > 90);
            // And one towards the limb and the light's plane, over four decades of each.
            let [low, high] = smooth.extent[1];
            for k in 0..100 {
                let decades = |step: f64| 10f64.powf(-4.0 * (f64::from(k) * step).fract());
                let phi = FRAC_PI_2 - 1e-9 - 0.5 * decades(0.618_033_99);
                let tau = 0.1 * decades(0.381_966_01);
                let [phi, tau] =
                    [[phi, tau], [-phi, tau], [phi, -tau], [-phi, -tau]][k as usize % 4];
                hits.push(body.at([phi, tau.clamp(low, high)]));
            }
            // Errors are meant relative to the brightest point, which a few rays miss.
            let [low, high] = smooth.extent[1];
            let lattice =
                (0..=400).flat_map(|i| (0..=40).map(move |j| (f64::from(i), f64::from(j))));
            let largest = lattice.fold(0.0f64, |largest, (i, j)| {
                let phi = (i / 200.0 - 1.0) * (FRAC_PI_2 - 1e-6);
                let mut value = [0.0];
                smooth.add(
                    &body,
                    &body.at([phi, low + (high - low) * j / 40.0]),
                    &mut value,
                );
                largest.max(value[0])
            });
            let mut worst = 0.0f64;
            for hit in hits {
                let (mut fast, mut slow) = ([0.0], [0.0]);
                smooth.add(&body, &hit, &mut fast);
                shader.add_smooth_slowly(&hit, &plane, &mut slow);
                worst = worst.max((fast[0] - slow[0]).abs());
            }
            // Two coordinates, in each of which the last coefficients are below 4e-6 of the largest value, and what is left
            // out no more than four times that.
            assert!(
                worst < 3e-5 * largest,
                "{material} under {lights}, {shape:?}: {worst:e} of {largest}"
            );
        }
    }

    #[test]
    fn a_cell_s_series_reproduces_a_polynomial() {
        // Σ of Chebyshev polynomials with these coefficients, at the nodes.
        let planted: Vec<f64> = (0..NODES).map(|k| 1.0 / (1.0 + k as f64)).collect();
        let values: Vec<f64> = (0..NODES)
            .map(|j| {
                let turn = PI * (j as f64 + 0.5) / NODES as f64;
                let terms = planted.iter().enumerate();
                terms.map(|(k, c)| c * (k as f64 * turn).cos()).sum()
            })
            .collect();
        for (found, planted) in transform(&values, 1).iter().zip(&planted) {
            assert!((found - planted).abs() < 1e-14);
        }
    }
}
