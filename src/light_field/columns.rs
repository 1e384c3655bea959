//! From the stations of a view's measured line to one sample per θo′ column.
//!
//! A column's sample is the mean of the stations in its bin, moved to the bin's centre with slope and
//! curvature from a fit over a window two bins wide. The mean keeps the noise low and samples of
//! neighbouring columns nearly independent; the fit takes out what the mean of a curved function is
//! off by. Both are averaged over each pixel's footprint, which near the limb is wider than a bin.

use nalgebra::{Matrix3, Vector3};

/// Half-width of the window of the fit, in bins and (at least) in pixels.
const WINDOW_BINS: f64 = 1.0;
const WINDOW_PIXELS: f64 = 2.6;
/// Part of the bin that stations must cover for the column to count as seen.
const LEAST_COVERED: f64 = 0.7;

/// Where a station lies, by its footprint along the measured line.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// θo′ at the two ends of the pixel, radians, in increasing order.
    pub ends: [f64; 2],
    /// θo′ at the three nodes of Gauss's rule over what the station averages: the pixel, or somewhat more.
    pub nodes: [f64; 3],
}

/// Weights of Gauss's three-point rule on an interval of length 1.
const GAUSS: [f64; 3] = [5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0];
/// Its nodes, from the middle of the interval.
pub const GAUSS_NODES: [f64; 3] = [-0.387_298_334_620_741_7, 0.0, 0.387_298_334_620_741_7];

impl Footprint {
    fn width(&self) -> f64 {
        self.ends[1] - self.ends[0]
    }

    /// Footprint averages of (θo′ − centre) and of its square.
    fn moments(&self, centre: f64) -> (f64, f64) {
        let (mut first, mut second) = (0.0, 0.0);
        for (w, node) in GAUSS.iter().zip(self.nodes) {
            let d = node - centre;
            first += w * d;
            second += w * d * d;
        }
        (first, second)
    }

    /// Length of the part within a bin.
    fn overlap(&self, centre: f64, half: f64) -> f64 {
        (self.ends[1].min(centre + half) - self.ends[0].max(centre - half)).max(0.0)
    }
}

/// A column's sample in one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value {
    /// B at the centre of the column.
    pub value: f64,
    /// Its variance by the stations' noise.
    pub variance: f64,
    /// dB/dθo′ along the view's line.
    pub slope: f64,
    /// Number of pixels in the mean.
    pub pixels: f64,
    /// By how much the variance must be enlarged for columns to count as independent, ≥ 1: where a
    /// pixel is wider than a bin, several columns come from it.
    pub shared: f64,
}

/// The stations of a line in one channel, in increasing θo′.
#[derive(Clone, Copy, Debug)]
pub struct Line<'a> {
    /// Radiance.
    pub value: &'a [f64],
    /// Its variance; infinite where missing.
    pub variance: &'a [f64],
    /// Pixels averaged.
    pub pixels: &'a [u32],
    /// Where each lies.
    pub footprints: &'a [Footprint],
}

/// The sample at `centre` of a bin of width `bin` (radians); `None` if the bin was not seen.
pub fn sample(line: &Line<'_>, centre: f64, bin: f64) -> Option<Value> {
    let footprints = line.footprints;
    let middle = footprints
        .partition_point(|f| f.nodes[1] < centre)
        .min(footprints.len() - 1);
    let pixel = footprints[middle].width();
    let half = (WINDOW_BINS * bin).max(WINDOW_PIXELS * pixel);
    let first = footprints.partition_point(|f| f.nodes[1] < centre - half);
    let last = footprints.partition_point(|f| f.nodes[1] <= centre + half);

    let mut normal = Matrix3::<f64>::zeros();
    let mut right = Vector3::<f64>::zeros();
    let (mut covered, mut mean, mut mean_first, mut mean_second, mut pixels) =
        (0.0, 0.0, 0.0, 0.0, 0.0);
    let mut count = 0;
    for (k, footprint) in (first..last).zip(&footprints[first..last]) {
        if !line.variance[k].is_finite() {
            continue;
        }
        count += 1;
        let (d1, d2) = footprint.moments(centre);
        // In units of the window the normal matrix is well conditioned.
        let basis = Vector3::new(1.0, d1 / half, d2 / (half * half));
        normal += basis * basis.transpose();
        right += basis * line.value[k];
        let overlap = footprint.overlap(centre, bin / 2.0);
        covered += overlap;
        mean += overlap * line.value[k];
        mean_first += overlap * basis[1];
        mean_second += overlap * basis[2];
        pixels += overlap / footprint.width() * f64::from(line.pixels[k]);
    }
    if covered < LEAST_COVERED * bin || count < 4 {
        return None;
    }
    mean /= covered;
    mean_first /= covered;
    mean_second /= covered;
    let inverse = normal.try_inverse()?;
    let fit = inverse * right;
    let value = mean - mean_first * fit[1] - mean_second * fit[2];
    // Row vector of the moments applied to the fit: the weight that each station has through it.
    let through_fit = inverse * Vector3::new(0.0, mean_first, mean_second);
    let mut variance = 0.0;
    for (k, footprint) in (first..last).zip(&footprints[first..last]) {
        if !line.variance[k].is_finite() {
            continue;
        }
        let (d1, d2) = footprint.moments(centre);
        let basis = Vector3::new(1.0, d1 / half, d2 / (half * half));
        let weight = footprint.overlap(centre, bin / 2.0) / covered - through_fit.dot(&basis);
        variance += weight * weight * line.variance[k];
    }
    Some(Value {
        value,
        variance,
        slope: fit[1] / half,
        pixels,
        shared: (pixel / bin).max(1.0),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stations of a line on which θo′ = asin(s/radius), each the average of `f` over its pixel.
    fn line(radius: f64, f: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<Footprint>) {
        let n = (2.0 * radius) as i32 - 2;
        (0..n)
            .map(|k| {
                let s = f64::from(k) - f64::from(n - 1) / 2.0;
                let at = |d: f64| ((s + d) / radius).asin();
                let mean = (0..200)
                    .map(|m| f(at((f64::from(m) + 0.5) / 200.0 - 0.5)))
                    .sum::<f64>()
                    / 200.0;
                let footprint = Footprint {
                    ends: [at(-0.5), at(0.5)],
                    nodes: GAUSS_NODES.map(at),
                };
                (mean, footprint)
            })
            .unzip()
    }

    /// A sample of stations of variance 1, but for those where `missing`.
    fn read(
        (value, footprints): &(Vec<f64>, Vec<Footprint>),
        missing: impl Fn(f64) -> bool,
        centre: f64,
        bin: f64,
    ) -> Option<Value> {
        let variance: Vec<f64> = footprints
            .iter()
            .map(|f| {
                if missing(f.nodes[1]) {
                    f64::INFINITY
                } else {
                    1.0
                }
            })
            .collect();
        let line = Line {
            value,
            variance: &variance,
            pixels: &vec![1; value.len()],
            footprints,
        };
        sample(&line, centre, bin)
    }

    #[test]
    fn a_narrow_lobe_is_read_at_the_bins_centre() {
        // A Phong lobe of exponent 32 at 1° bins, photographed 400 and 200 pixels in radius.
        for radius in [200.0, 400.0] {
            let lobe = |t: f64| (t - 0.3f64).cos().max(0.0).powi(32);
            let stations = line(radius, lobe);
            let bin = 1f64.to_radians();
            for j in -75..=75 {
                let centre = (f64::from(j) + 0.5) * bin;
                let found = read(&stations, |_| false, centre, bin).expect("seen");
                // Fourth-order remainder of the fit: B⁗ a⁴/24 · 0.3 with a = 1.5°, B⁗ ≤ 3·32².
                assert!(
                    (found.value - lobe(centre)).abs() < 4e-5,
                    "{j}: {}",
                    found.value
                );
            }
        }
    }

    #[test]
    fn the_variance_is_that_of_the_mean_of_the_bin() {
        let stations = line(400.0, |t| t);
        let bin = 1f64.to_radians();
        let found = read(&stations, |_| false, 0.005, bin).expect("seen");
        // 400 px · 1° = 6.98 pixels in the bin; curvature and slope, from twice as many pixels, add about a
        // tenth each.
        let expected = 1.0 / 6.98;
        assert!(found.variance > 0.95 * expected && found.variance < 1.25 * expected);
        assert!((found.slope - 1.0).abs() < 1e-6);
    }

    #[test]
    fn an_unseen_bin_has_no_sample() {
        let stations = line(200.0, |t| t);
        assert!(read(&stations, |t| t.abs() < 0.1, 0.0, 0.02).is_none());
    }
}
