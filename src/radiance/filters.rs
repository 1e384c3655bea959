//! Colours at the pixels whose filters let another one through.
//!
//! A sensor with colour filters measures each colour at some sites only. Between them radiance is
//! interpolated from the nearest sites of the same colour, with no help from other colours, whose edges need
//! not be its own. Where a site is missing (clipped, masked), so is what would lean on it.

use super::merge::Plane;

/// Farthest site that is asked, pixels: two for patterns that leave a colour out of a row and its neighbours.
const REACH: i64 = 2;

/// Fills the pixels of a plane that are no `sites` (\[pixel\]). Interpolated pixels are not new
/// measurements: all variances are raised by the number of pixels per site, so that means over many pixels
/// have the variance that their sites give them.
pub(super) fn fill((value, variance): &mut Plane, sites: &[bool], width: usize) {
    let count = sites.iter().filter(|site| **site).count();
    if count == 0 || count == sites.len() {
        return;
    }
    let shared = sites.len() as f32 / count as f32;
    let width = width.max(1);
    let height = value.len() / width;
    let measured = (value.clone(), variance.clone());
    for y in 0..height {
        for x in 0..width {
            let at = y * width + x;
            if sites.get(at).copied().unwrap_or(true) {
                if let Some(variance) = variance.get_mut(at) {
                    *variance *= shared;
                }
                continue;
            }
            let found =
                (1..=REACH).find_map(|reach| around(&measured, sites, width, (x, y), reach));
            let (mean, noise) = found.flatten().unwrap_or((0.0, f32::INFINITY));
            if let (Some(value), Some(variance)) = (value.get_mut(at), variance.get_mut(at)) {
                (*value, *variance) = (mean, noise * shared);
            }
        }
    }
}

/// The mean of the sites within `reach` by a tent, and their mean variance. Nothing if there are none, or
/// the picture's edge cuts the window; nothing inside if one of them is missing.
fn around(
    (value, variance): &Plane,
    sites: &[bool],
    width: usize,
    (x, y): (usize, usize),
    reach: i64,
) -> Option<Option<(f32, f32)>> {
    let height = (sites.len() / width) as i64;
    let (mut weights, mut sum, mut noise, mut moment) = (0.0, 0.0, 0.0, [0.0_f32; 2]);
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let (u, v) = (x as i64 + dx, y as i64 + dy);
            if !(0..width as i64).contains(&u) || !(0..height).contains(&v) {
                continue;
            }
            let at = v as usize * width + u as usize;
            if !sites.get(at).copied().unwrap_or(false) {
                continue;
            }
            let weight = ((reach + 1 - dx.abs()) * (reach + 1 - dy.abs())) as f32;
            let here = variance.get(at).copied().unwrap_or(f32::INFINITY);
            if !here.is_finite() {
                return Some(None);
            }
            weights += weight;
            sum += weight * value.get(at).copied().unwrap_or(0.0);
            noise += weight * here;
            moment[0] += weight * dx as f32;
            moment[1] += weight * dy as f32;
        }
    }
    // Sites on one side only would shift the picture.
    let balanced = moment.iter().all(|m| m.abs() < 1e-3 * weights);
    (weights > 0.0).then(|| balanced.then(|| (sum / weights, noise / weights)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sites of red, green and blue in a Bayer pattern.
    fn bayer(width: usize, height: usize, colour: usize) -> Vec<bool> {
        let pattern = [[0, 1], [1, 2]];
        (0..width * height)
            .map(|i| pattern[(i / width) % 2][i % width % 2] == colour)
            .collect()
    }

    #[test]
    fn a_slope_is_filled_without_error() {
        let (width, height) = (20, 12);
        for colour in 0..3 {
            let sites = bayer(width, height, colour);
            let truth = |i: usize| 1.0 + 0.1 * (i % width) as f32 - 0.03 * (i / width) as f32;
            let mut plane: Plane = sites
                .iter()
                .enumerate()
                .map(|(i, site)| {
                    if *site {
                        (truth(i), 1.0)
                    } else {
                        (0.0, f32::INFINITY)
                    }
                })
                .unzip();
            fill(&mut plane, &sites, width);
            let shared = if colour == 1 { 2.0 } else { 4.0 };
            for i in 0..width * height {
                let (x, y) = (i % width, i / width);
                let inner = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
                assert!(!inner || plane.1[i] == shared, "{colour} {x} {y}");
                if plane.1[i].is_finite() {
                    assert!((plane.0[i] - truth(i)).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn nothing_leans_on_a_clipped_site() {
        let (width, height) = (12, 12);
        let sites = bayer(width, height, 0);
        let mut plane: Plane = (
            vec![1.0; width * height],
            sites
                .iter()
                .map(|s| if *s { 1.0 } else { f32::INFINITY })
                .collect(),
        );
        let clipped = 4 * width + 4;
        plane.1[clipped] = f32::INFINITY;
        fill(&mut plane, &sites, width);
        for y in 3..=5 {
            for x in 3..=5 {
                assert!(plane.1[y * width + x].is_infinite(), "{x} {y}");
            }
        }
        assert!(plane.1[4 * width + 2].is_finite() && plane.1[2 * width + 5].is_finite());
    }
}
