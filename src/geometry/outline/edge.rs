//! The limb in a strip: found to a pixel by comparing models, then to a fraction of one by a fit.
//!
//! Just inside the limb θo′ changes as the square root of the depth x, so a smooth B(α, θo′) is a
//! polynomial in √x: B ≈ l₀ + l₁ √x + l₂ x + l₃ x^(3/2), next to a level background, integrated over each
//! pixel. What tells the limb from the edge of a shadow (a sun's terminator) is that there B starts
//! from the background with a finite slope: no step and no root.

use std::ops::Range;

use image::{ImageBuffer, Luma};
use imageproc::filter::horizontal_filter;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::strip::{Line, Profile, Strip};

/// Pixels of background that a decision looks at.
pub(super) const OUTSIDE: usize = 8;
/// Pixels of surface that a decision looks at; at a radius of 400 px they span 15° of θo′.
const INSIDE: usize = 12;
/// How exactly the models describe a limb, relative to the contrast in the window.
const MODEL_ERROR: f64 = 0.01;
/// Least improvement of χ² of the limb model over those without a limb: 6σ, since a strip has
/// hundreds of positions and there are 16 strips.
const LEAST_GAIN: f64 = 36.0;

/// A place where a strip may have its limb.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// Depth inside the predicted limb, pixels.
    pub depth: f64,
    /// χ² gained by assuming the limb there.
    pub gain: f64,
}

/// Orthonormal bases of the competing models on a window, the edge's own pixel left out.
pub(super) struct Detector {
    limb: DMatrix<f64>,
    shadow: DMatrix<f64>,
    smooth: DMatrix<f64>,
}

impl Detector {
    pub(super) fn new() -> Self {
        let n = OUTSIDE + INSIDE;
        // Depth of a pixel's centre inside the middle of the edge's own pixel.
        let depth = |k: usize| {
            if k < OUTSIDE {
                k as f64 - OUTSIDE as f64
            } else {
                (k - OUTSIDE + 1) as f64
            }
        };
        let build = |columns: &[&dyn Fn(f64) -> f64]| {
            DMatrix::from_fn(n, columns.len(), |i, j| columns[j](depth(i)))
                .qr()
                .q()
        };
        let inside = |x: f64| x.max(0.0);
        let t = |x: f64| x / INSIDE as f64;
        Self {
            limb: build(&[
                &|x| if x < 0.0 { 1.0 } else { 0.0 },
                &|x| if x > 0.0 { 1.0 } else { 0.0 },
                &|x| inside(x).sqrt(),
                &|x| inside(t(x)),
            ]),
            shadow: build(&[&|_| 1.0, &|x| inside(t(x)), &|x| inside(t(x)).powi(2)]),
            smooth: build(&[&|_| 1.0, &t, &|x| t(x).powi(2), &|x| t(x).powi(3)]),
        }
    }

    /// The best places for a limb in a profile, best first, at most three.
    pub(super) fn candidates(&self, profile: &Profile) -> Vec<Candidate> {
        let mut found: Vec<Candidate> = steepest(profile)
            .into_iter()
            .filter_map(|k| {
                // The filter's peak may be a pixel off where the surface rises steeply.
                (k.saturating_sub(1)..=k + 1)
                    .filter_map(|k| self.judge(profile, k))
                    .max_by(|a, b| a.gain.total_cmp(&b.gain))
            })
            .filter(|c| c.gain > LEAST_GAIN)
            .collect();
        found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        found.dedup_by(|a, b| (a.depth - b.depth).abs() < 1.5);
        found.truncate(3);
        found
    }

    /// Compares the models with the limb inside pixel `k`.
    fn judge(&self, profile: &Profile, k: usize) -> Option<Candidate> {
        let outside = profile.value.get(k.checked_sub(OUTSIDE)?..k)?;
        let inside = profile.value.get(k + 1..=k + INSIDE)?;
        let window = DVector::from_iterator(
            OUTSIDE + INSIDE,
            outside.iter().chain(inside).map(|v| f64::from(*v)),
        );
        let (low, high) = (window.min(), window.max());
        // Also false if a pixel is missing (NaN).
        if !(window.sum().is_finite() && high > low) {
            return None;
        }
        let centred = window.add_scalar(-window.mean());
        let left = |basis: &DMatrix<f64>| {
            (centred.norm_squared() - basis.tr_mul(&centred).norm_squared()).max(0.0)
        };
        let variance = profile.variance + (MODEL_ERROR * (high - low)).powi(2);
        let limb = left(&self.limb) / variance;
        let without = left(&self.shadow).min(left(&self.smooth)) / variance;
        let freedom = (OUTSIDE + INSIDE - 4) as f64;
        Some(Candidate {
            depth: profile.first + k as f64,
            gain: (without - limb) / (limb / freedom).max(1.0),
        })
    }
}

/// Pixels where the smoothed profile is locally steepest.
fn steepest(profile: &Profile) -> Vec<usize> {
    // Derivative of a Gaussian of 1.2 px: wider than a sharp limb, narrower than a blurred one.
    let kernel: Vec<f32> = (-4..=4)
        .map(|i| {
            let x = i as f32 / 1.2;
            x * (-0.5 * x * x).exp()
        })
        .collect();
    let mut last = profile
        .value
        .iter()
        .copied()
        .find(|v| v.is_finite())
        .unwrap_or(0.0);
    let filled: Vec<f32> = profile
        .value
        .iter()
        .map(|v| {
            if v.is_finite() {
                last = *v;
            }
            last
        })
        .collect();
    let Some(picture) = ImageBuffer::<Luma<f32>, _>::from_raw(filled.len() as u32, 1, filled)
    else {
        return Vec::new();
    };
    if picture.width() == 0 {
        return Vec::new();
    }
    let slope: Vec<f32> = horizontal_filter(&picture, &kernel)
        .iter()
        .map(|s| s.abs())
        .collect();
    (1..slope.len().saturating_sub(1))
        .filter(|k| slope[*k] > 0.0 && slope[*k] >= slope[k - 1] && slope[*k] > slope[k + 1])
        .collect()
}

/// Where the limb is, to a fraction of a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    /// Depth inside the predicted limb, pixels.
    pub depth: f64,
    /// Standard deviation from noise, which averages over rows.
    pub sigma: f64,
    /// Standard deviation from the model's own error, which is the same in all rows.
    pub sigma_model: f64,
    /// Brightness just inside minus background, in its own standard deviations.
    pub contrast: f64,
    /// χ² of the fit.
    pub chi2: f64,
    /// Background and l₀ … l₃.
    pub levels: [f64; 5],
    /// Row of the inverse of the normal equations that tells the depth, over depth, background and l₀ … l₃.
    influence: [f64; 6],
    /// Variance by which each pixel may be off the model.
    floor: f64,
    /// Where it was searched for.
    start: f64,
}

/// How the pixels' background goes into the depth that was found.
pub(super) struct Background<'a> {
    edge: &'a Edge,
    slant: f64,
    blur: Vec<([f64; 4], [f64; 4])>,
    /// Distance (pixels) from the limb up to which a pixel sees both sides of it.
    pub reach: f64,
}

impl<'a> Background<'a> {
    pub(super) fn new(edge: &'a Edge, strip: &Strip, blur: f64) -> Self {
        let blur = nodes(blur, strip.slant);
        let widest = blur.iter().flat_map(|(at, _)| at);
        Self {
            edge,
            slant: strip.slant,
            reach: 0.5 + widest.fold(0.0, |a: f64, at| a.max(at.abs())),
            blur,
        }
    }

    /// By how much the limb's depth changes if the background in a pixel at `depth` (inside the predicted limb) becomes brighter by 1.
    pub(super) fn pull(&self, depth: f64, variance: f64) -> f64 {
        let Edge {
            levels,
            influence,
            floor,
            ..
        } = self.edge;
        if depth < self.edge.start - OUTSIDE as f64 {
            return 0.0;
        }
        let (basis, turn) = blurred_pixel(depth - self.edge.depth, self.slant, &self.blur);
        let slope: f64 = turn.iter().zip(levels).map(|(t, l)| t * l).sum();
        let by_levels: f64 = influence[1..].iter().zip(basis).map(|(i, b)| i * b).sum();
        (influence[0] * slope + by_levels) / (variance + floor) * basis[0]
    }
}

/// Pixels of a strip's lines: values, weights, and the square roots of these.
#[derive(Default)]
struct Pixels {
    value: Vec<f64>,
    weight: Vec<f64>,
    root: Vec<f64>,
}

/// The normal equations of one step of [`locate`] without their prior, for the processor's widest instructions.
struct Equations<'a> {
    pixels: &'a Pixels,
    /// Depth inside the predicted limb, and the pixels there.
    depths: &'a [(f64, Range<usize>)],
    edge: f64,
    levels: [f64; 5],
    slant: f64,
    blur: &'a [([f64; 4], [f64; 4])],
    iteration: usize,
}

/// What [`Equations`] add up to.
struct EquationSums {
    normal: [[f64; 6]; 6],
    right: [f64; 6],
    chi2: f64,
    /// Number of pixels, each counted by Huber's factor on its weight.
    used: f64,
}

impl pulp::NullaryFnOnce for Equations<'_> {
    type Output = EquationSums;

    #[inline(always)]
    fn call(self) -> EquationSums {
        let mut sums = EquationSums {
            normal: [[0.0; 6]; 6],
            right: [0.0; 6],
            chi2: 0.0,
            used: 0.0,
        };
        for (depth, rows) in self.depths {
            let (basis, turn) = blurred_pixel(depth - self.edge, self.slant, self.blur);
            let (mut expected, mut slope) = (0.0, 0.0);
            for j in 0..5 {
                expected += basis[j] * self.levels[j];
                slope += turn[j] * self.levels[j];
            }
            // The first pass has no levels yet: it solves for them alone, the edge held.
            let slope = if self.iteration == 0 { 0.0 } else { slope };
            let row = [slope, basis[0], basis[1], basis[2], basis[3], basis[4]];
            let [weight, pull, squares, used] =
                self.of_rows(rows.clone(), expected, self.iteration > 1);
            sums.chi2 += squares;
            sums.used += used;
            for j in 0..6 {
                let weighted = weight * row[j];
                for (sum, a) in sums.normal[j].iter_mut().zip(row) {
                    *sum += weighted * a;
                }
                sums.right[j] += row[j] * pull;
            }
        }
        sums
    }
}

impl Equations<'_> {
    /// Sums over some pixels with Huber's weights: of the weights, of weight times miss, of weight times squared miss, of the factors on
    /// the weights.
    #[inline(always)]
    fn of_rows(&self, rows: Range<usize>, expected: f64, robust: bool) -> [f64; 4] {
        const LANES: usize = 4;
        let pixels = self.pixels;
        let [value, weight, root] = [&pixels.value, &pixels.weight, &pixels.root]
            .map(|list| list.get(rows.clone()).unwrap_or(&[]).as_chunks::<LANES>());
        let terms = |value: f64, weight: f64, root: f64| {
            let miss = value - expected;
            let sigmas = miss.abs() * root;
            let huber = if robust && sigmas > 2.5 {
                2.5 / sigmas
            } else {
                1.0
            };
            let w = weight * huber;
            [w, w * miss, w * miss * miss, huber]
        };
        let mut sums = [[0.0; LANES]; 4];
        for ((value, weight), root) in value.0.iter().zip(weight.0).zip(root.0) {
            for lane in 0..LANES {
                let found = terms(value[lane], weight[lane], root[lane]);
                for k in 0..4 {
                    sums[k][lane] += found[k];
                }
            }
        }
        let mut total = sums.map(|lanes| lanes.iter().sum::<f64>());
        for ((value, weight), root) in value.1.iter().zip(weight.1).zip(root.1) {
            let found = terms(*value, *weight, *root);
            for k in 0..4 {
                total[k] += found[k];
            }
        }
        total
    }
}

/// Blurs that are tried, pixels (standard deviation), and the part of χ² that blur must explain to be believed: the
/// flank of a highlight beside a dim limb looks blurred too, but not as exactly.
const BLURS: [f64; 7] = [0.4, 0.6, 0.8, 1.1, 1.5, 2.0, 2.8];
const BLUR_GAIN: f64 = 0.7;
/// Columns per row from which a limb's slant is seen in a pixel: it then spreads less than a hundredth of the pixel's own width does.
const LEAST_LEAN: f64 = 0.1;
/// Gauss's rule of four points over a pixel of height 1, and the variance over it.
const HEIGHT_NODES: [f64; 4] = [
    -0.430_568_155_797_026_3,
    -0.169_990_521_792_428_13,
    0.169_990_521_792_428_13,
    0.430_568_155_797_026_3,
];
const HEIGHT_WEIGHTS: [f64; 4] = [
    0.173_927_422_568_726_93,
    0.326_072_577_431_273_07,
    0.326_072_577_431_273_07,
    0.173_927_422_568_726_93,
];
const PIXEL_VARIANCE: f64 = 1.0 / 12.0;
/// Nodes of the blur's quadrature, half a standard deviation apart.
const BLUR_NODES: i32 = 6;

/// A strip, its profile, the limb's depth in it by the bands' agreement, and the limb of a sharp photo there.
pub(super) struct Found<'a> {
    pub strip: &'a Strip,
    pub profile: &'a Profile,
    pub start: f64,
    pub sharp: Option<Edge>,
}

/// The blur of a photo (pixels), from where its limb has been found roughly.
pub(super) fn blur(mut found: Vec<Found<'_>>, radius_px: f64) -> f64 {
    let of_sharp = |f: &Found<'_>| f.sharp.map_or(f64::INFINITY, |e| e.chi2);
    found.sort_by(|a, b| of_sharp(b).total_cmp(&of_sharp(a)));
    // Beyond `limit` a lower bound.
    let chi2 = |blur: f64, limit: f64| -> f64 {
        let mut sum = 0.0;
        for f in &found {
            match locate(f.strip, f.profile, f.start, radius_px, blur) {
                Some(edge) => sum += edge.chi2,
                None => return f64::INFINITY,
            }
            if sum > limit {
                break;
            }
        }
        sum
    };
    let sharp: f64 = found.iter().map(of_sharp).sum();
    let limit = (1.0 - BLUR_GAIN) * sharp;
    if BLURS.iter().all(|&b| chi2(b, limit) > limit) {
        return 0.0;
    }
    let tried = BLURS.map(|b| (b, chi2(b, f64::INFINITY)));
    let (mut best, mut least) = (0.0, f64::INFINITY);
    for (k, &(b, chi)) in tried.iter().enumerate() {
        if chi < least {
            (best, least) = (b, chi);
            // The vertex of the parabola through the neighbours.
            if let (Some(l), Some(r)) = (k.checked_sub(1).map(|k| tried[k]), tried.get(k + 1)) {
                let (p, q) = ((chi - l.1) / (b - l.0), (r.1 - chi) / (r.0 - b));
                if q > p && p.is_finite() && q.is_finite() {
                    let middle = (0.5 * (l.0 + b), 0.5 * (b + r.0));
                    best = (middle.0 - p * (middle.1 - middle.0) / (q - p)).clamp(l.0, r.0);
                }
            }
        }
    }
    // Also if no sharp limb can be fitted at all.
    if least.is_finite() && !(least > limit) {
        best
    } else {
        0.0
    }
}

/// Gauss–Newton on (edge, background, l₀ … l₃) over all pixels of the strip's lines about `start`, with
/// Huber weights against dust.
pub(super) fn locate(
    strip: &Strip,
    profile: &Profile,
    start: f64,
    radius_px: f64,
    blur: f64,
) -> Option<Edge> {
    let inside = (0.03 * radius_px).clamp(6.0, INSIDE as f64);
    let mut pixels = Pixels::default();
    let mut depths: Vec<(f64, Range<usize>)> = Vec::new();
    for row in level(&strip.lines) {
        let Some(first) = row.first().map(|line| line.first) else {
            continue;
        };
        let from = (start - OUTSIDE as f64 - first).ceil().max(0.0) as usize;
        let to = (start + inside - first).floor().max(0.0) as usize;
        for k in from..=to {
            let begin = pixels.value.len();
            for line in row {
                if let (Some(value), Some(variance)) = (line.value.get(k), line.variance.get(k))
                    && variance.is_finite()
                {
                    pixels.value.push(f64::from(*value));
                    pixels.weight.push(f64::from(*variance));
                }
            }
            if pixels.value.len() > begin {
                depths.push((first + k as f64, begin..pixels.value.len()));
            }
        }
    }
    if pixels.value.len() < 12 {
        return None;
    }
    let (low, high) = profile.range(start - OUTSIDE as f64, start + inside)?;
    let floor = (0.3 * MODEL_ERROR * (high - low)).powi(2);
    let mut systematic = 0.0;
    for weight in &mut pixels.weight {
        *weight = 1.0 / (weight.max(profile.pixel_variance) + floor);
        pixels.root.push(weight.sqrt());
        systematic += floor * *weight;
        if !weight.is_finite() {
            return None;
        }
    }

    // Of the fit's variance, the share of the model's error does not shrink with the number of rows.
    let systematic = systematic / pixels.value.len() as f64 * strip.lines.len() as f64;
    // How much of the contrast each power of √x may carry at the window's end; it matters only where noise
    // would otherwise trade them against each other and against the edge.
    let span = inside;
    let bound = |power: i32, share: f64| (span.sqrt().powi(power) / (share * (high - low))).powi(2);
    let prior = SVector::<f64, 6>::new(0.0, 0.0, 0.0, bound(1, 1.0), bound(2, 1.0), bound(3, 0.5));

    let blur = nodes(blur, strip.slant);
    let mut edge = start;
    let mut levels = SVector::<f64, 5>::zeros();
    let mut sigma = f64::INFINITY;
    let mut contrast = 0.0;
    let mut chi2 = f64::INFINITY;
    let mut influence = [0.0; 6];
    for iteration in 0..12 {
        let sums = pulp::Arch::new().dispatch(Equations {
            pixels: &pixels,
            depths: &depths,
            edge,
            levels: std::array::from_fn(|j| levels[j]),
            slant: strip.slant,
            blur: &blur,
            iteration,
        });
        let mut normal = SMatrix::<f64, 6, 6>::from_fn(|i, j| sums.normal[j][i]);
        let mut right = SVector::<f64, 6>::from(sums.right);
        for (j, prior) in prior.iter().enumerate() {
            normal[(j, j)] += prior;
            right[j] -= prior * j.checked_sub(1).map_or(0.0, |j| levels[j]);
        }
        let [chi, total] = [sums.chi2, sums.used];
        if iteration == 0 {
            normal[(0, 0)] = 1.0;
        }
        let inverse = normal.try_inverse()?;
        let step = inverse * right;
        let move_by = step[0].clamp(-0.7, 0.7);
        edge += move_by;
        levels += step.fixed_rows::<5>(1);
        chi2 = chi;
        if iteration > 0 {
            influence = std::array::from_fn(|j| inverse[(0, j)]);
            let worse = (chi / (total - 6.0).max(1.0)).max(1.0);
            sigma = (inverse[(0, 0)] * worse).sqrt();
            // Brightness one pixel inside minus background.
            let one_in = SVector::<f64, 6>::new(0.0, -1.0, 1.0, 1.0, 1.0, 1.0);
            let jump = levels.dot(&one_in.fixed_rows::<5>(1));
            contrast = jump / ((one_in.transpose() * inverse * one_in)[0] * worse).sqrt();
        }
        if iteration > 2 && move_by.abs() < 1e-3 {
            break;
        }
    }
    (sigma.is_finite() && (edge - start).abs() < 3.0).then_some(Edge {
        depth: edge,
        sigma,
        sigma_model: sigma * systematic.sqrt(),
        contrast,
        chi2,
        levels: levels.into(),
        influence,
        floor,
        start,
    })
}

/// Rows whose pixels lie at the same depths together: all of an upright cylinder's, each by itself where the
/// limb is bent.
fn level(lines: &[Line]) -> impl Iterator<Item = &[Line]> {
    // The limb of a row is found to better than this.
    lines.chunk_by(|a, b| (a.first - b.first).abs() < 1e-8)
}

/// Nodes along the row (pixels) and their weights, padded with nodes of no weight, of all that spreads a limb of this slant beyond the pixel's own
/// width: a Gaussian blur, and the height of the pixel, through which a slanted limb crosses from one column to another. None: nothing.
fn nodes(blur: f64, slant: f64) -> Vec<([f64; 4], [f64; 4])> {
    let lean = (slant.powi(-2) - 1.0).max(0.0).sqrt();
    if !(blur > 0.0) {
        return match lean > LEAST_LEAN {
            true => vec![(HEIGHT_NODES.map(|v| lean * v), HEIGHT_WEIGHTS)],
            false => Vec::new(),
        };
    }
    let blur = blur.hypot(lean * PIXEL_VARIANCE.sqrt());
    let all: Vec<(f64, f64)> = (-BLUR_NODES..=BLUR_NODES)
        .map(|k| {
            let z = 0.5 * f64::from(k);
            (blur * z, (-0.5 * z * z).exp())
        })
        .collect();
    let total: f64 = all.iter().map(|(_, weight)| weight).sum();
    all.chunks(4)
        .map(|nodes| {
            let node = |k: usize| nodes.get(k).copied().unwrap_or((0.0, 0.0));
            (
                std::array::from_fn(|k| node(k).0),
                std::array::from_fn(|k| node(k).1 / total),
            )
        })
        .collect()
}

/// [`terms`] seen through a blur of such nodes.
#[inline(always)]
fn blurred_pixel(depth: f64, slant: f64, blur: &[([f64; 4], [f64; 4])]) -> ([f64; 5], [f64; 5]) {
    if blur.is_empty() {
        return terms(depth, slant);
    }
    let reaches = |at: &f64| depth + at + 0.5 > 0.0;
    if !blur.iter().any(|(at, _)| at.iter().any(reaches)) {
        return ([1.0, 0.0, 0.0, 0.0, 0.0], [0.0; 5]);
    }
    let sums = BlurredTerms { depth, slant, blur }.summed();
    (
        std::array::from_fn(|j| sums[j]),
        std::array::from_fn(|j| sums[5 + j]),
    )
}

/// [`terms`] through a blur.
struct BlurredTerms<'a> {
    depth: f64,
    slant: f64,
    blur: &'a [([f64; 4], [f64; 4])],
}

impl BlurredTerms<'_> {
    #[inline(always)]
    fn summed(self) -> [f64; 10] {
        let mut sums = [[0.0; 4]; 10];
        for (at, weight) in self.blur {
            for k in 0..4 {
                let (basis, turn) = terms(self.depth + at[k], self.slant);
                for j in 0..5 {
                    sums[j][k] += basis[j] * weight[k];
                    sums[5 + j][k] += turn[j] * weight[k];
                }
            }
        }
        sums.map(|lanes| lanes.iter().sum::<f64>())
    }
}

/// Background and l₀ … l₃ averaged over a pixel whose centre lies `depth` inside the limb (along the
/// row; `slant` turns that into depth across the limb), and their derivative by the limb's depth.
#[inline(always)]
fn terms(depth: f64, slant: f64) -> ([f64; 5], [f64; 5]) {
    let a = (depth - 0.5).max(0.0) * slant;
    let b = (depth + 0.5).max(0.0) * slant;
    let (root_a, root_b) = (a.sqrt(), b.sqrt());
    // The same for all pixels: nothing is divided in a loop over them.
    let per_depth = 1.0 / slant;
    let covered = (b - a) * per_depth;
    let basis = [
        1.0 - covered,
        covered,
        (b * root_b - a * root_a) * (per_depth / 1.5),
        0.5 * (b * b - a * a) * per_depth,
        (b * b * root_b - a * a * root_a) * (per_depth / 2.5),
    ];
    let one_if = |inside: bool| if inside { 1.0 } else { 0.0 };
    let crossed = one_if(b > 0.0) - one_if(a > 0.0);
    let turn = [
        crossed,
        -crossed,
        root_a - root_b,
        a - b,
        a * root_a - b * root_b,
    ];
    (basis, turn)
}
