//! What the light field leaves free: the components of the reciprocity graph.

use super::spectral::Coefficients;

/// The components of the graph whose nodes are the frequencies |p| that show in the light field and whose edges
/// are the B̃_{p,±q} above their noise, the one with p = 0 first, then by their lowest frequency.
///
/// In the ideal case each has one free factor, and L_0 = 1 fixes the first. An edge is a power of B̃_{p,q} and
/// B̃_{p,−q} (or their mirror images) beyond what noise exceeds once in 10⁵ (four degrees of freedom: 7.2 times its mean).
pub(super) fn components(coefficients: &Coefficients, frequencies: &[usize]) -> Vec<Vec<usize>> {
    const ABOVE_NOISE: f64 = 7.2;
    let linked = |p: usize, q: usize| {
        let (a, b) = (p as i64, q as i64);
        let power = |x: i64, y: i64| {
            0.5 * (coefficients.get(x, y).norm_sqr() + coefficients.get(x, -y).norm_sqr())
        };
        power(a, b) > ABOVE_NOISE * coefficients.variance[p]
            || power(b, a) > ABOVE_NOISE * coefficients.variance[q]
    };
    let mut left: Vec<usize> = frequencies.to_vec();
    let mut found = Vec::new();
    while !left.is_empty() {
        let mut component = vec![left.remove(0)];
        let mut next = 0;
        while let Some(&p) = component.get(next) {
            let (near, far): (Vec<usize>, Vec<usize>) = left.iter().partition(|&&q| linked(p, q));
            component.extend(near);
            left = far;
            next += 1;
        }
        component.sort_unstable();
        found.push(component);
    }
    found
}
