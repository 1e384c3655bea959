//! The space in which the slice is sought: product splines, locally refined where a lobe asks for it.

use super::basis::{Basis, Local};

/// Symmetric product splines on equal intervals, or coarse ones with splines of half the interval in a region.
///
/// Refined spaces are truncated hierarchical B-splines (Giannelli, Jüttler and Speleers, "THB-splines: the truncated basis for
/// hierarchical splines", Computer Aided Geometric Design 29, 2012): a fine spline is an unknown if its support lies in
/// the region, a coarse one unless its does, and each coarse one is written in fine ones without those that are unknowns themselves. They are
/// linearly independent, and non-negative unknowns make a non-negative slice.
///
/// Every slice of the space has coefficients c_{mn} = c_{nm} on the finest splines, which are linear in the unknowns; all the
/// rest of the recovery is written in those.
#[derive(Clone, Debug)]
pub struct Space {
    basis: Basis,
    unknowns: usize,
    /// Where the combination of each c_{mn}, m ≥ n, begins in `terms`; empty if every c_{mn} is an unknown itself.
    starts: Vec<usize>,
    terms: Vec<(usize, f64)>,
}

impl Space {
    /// Every c_{mn} is an unknown.
    pub fn uniform(basis: Basis) -> Self {
        Self {
            basis,
            unknowns: basis.pairs(),
            starts: Vec::new(),
            terms: Vec::new(),
        }
    }

    /// Splines on `coarse`, and on half its intervals within the cells of the coarse knots that `refined` \[i\]\[j\] holds; those
    /// across the diagonal count as well.
    pub fn refined(coarse: Basis, refined: &[bool]) -> Self {
        let fine = coarse.halved();
        let cells = coarse.intervals();
        let within = |a: (usize, usize), b: (usize, usize)| {
            (a.0..=a.1)
                .all(|i| (b.0..=b.1).all(|j| refined[i * cells + j] || refined[j * cells + i]))
        };
        let mut unknowns = 0;
        let mut number = |is_unknown: bool| {
            is_unknown.then(|| {
                unknowns += 1;
                unknowns - 1
            })
        };
        // The unknown that each pair is, if it is one; in the order of the pairs, so that neighbours stay close.
        let mut of_fine = Vec::with_capacity(fine.pairs());
        for m in 0..fine.len() {
            for n in 0..=m {
                let halves = |k: usize| (fine.support(k).0 / 2, fine.support(k).1 / 2);
                of_fine.push(number(within(halves(m), halves(n))));
            }
        }
        let mut of_coarse = Vec::with_capacity(coarse.pairs());
        for m in 0..coarse.len() {
            for n in 0..=m {
                of_coarse.push(number(!within(coarse.support(m), coarse.support(n))));
            }
        }
        let parts = coarse.subdivision();
        let mut starts = vec![0];
        let mut terms: Vec<(usize, f64)> = Vec::new();
        for m in 0..fine.len() {
            for n in 0..=m {
                let from = terms.len();
                match of_fine[fine.pair(m, n)] {
                    Some(unknown) => terms.push((unknown, 1.0)),
                    None => {
                        for &(i, u) in &parts[m] {
                            for &(j, v) in &parts[n] {
                                if let Some(unknown) = of_coarse[coarse.pair(i, j)] {
                                    add(&mut terms, from, unknown, u * v);
                                }
                            }
                        }
                    }
                }
                starts.push(terms.len());
            }
        }
        Self {
            basis: fine,
            unknowns,
            starts,
            terms,
        }
    }

    /// The finest splines.
    pub fn basis(&self) -> Basis {
        self.basis
    }

    /// Number of unknowns.
    pub fn len(&self) -> usize {
        self.unknowns
    }

    /// Calls `term` with each unknown that c_{mn} consists of and its factor.
    pub fn each(&self, m: usize, n: usize, mut term: impl FnMut(usize, f64)) {
        let pair = self.basis.pair(m, n);
        if self.starts.is_empty() {
            term(pair, 1.0);
        } else {
            for &(unknown, factor) in &self.terms[self.starts[pair]..self.starts[pair + 1]] {
                term(unknown, factor);
            }
        }
    }

    /// c_{mn}, m ≥ n, of unknowns `x`.
    pub fn coefficients(&self, x: &[f64]) -> Vec<f64> {
        if self.starts.is_empty() {
            return x.to_vec();
        }
        self.starts
            .windows(2)
            .map(|w| self.terms[w[0]..w[1]].iter().map(|&(k, f)| f * x[k]).sum())
            .collect()
    }

    /// Value of the slice at (a, b), radians, as factors on the unknowns, each named once.
    pub fn value_at(&self, a: f64, b: f64) -> Vec<(usize, f64)> {
        self.patch(self.basis.interval(a), self.basis.interval(b))
            .value_at(a, b)
    }

    /// The slice on intervals `i` and `j` of the knots.
    pub fn patch(&self, i: usize, j: usize) -> Patch {
        let mut patch = Patch {
            basis: self.basis,
            unknowns: Vec::with_capacity(64),
            starts: vec![0],
            terms: Vec::with_capacity(64),
        };
        for m in self.basis.on(i) {
            for n in self.basis.on(j) {
                let Patch {
                    unknowns, terms, ..
                } = &mut patch;
                self.each(m, n, |unknown, factor| {
                    let place = unknowns.iter().position(|&u| u == unknown);
                    terms.push((place.unwrap_or(unknowns.len()), factor));
                    if place.is_none() {
                        unknowns.push(unknown);
                    }
                });
                patch.starts.push(patch.terms.len());
            }
        }
        patch
    }
}

/// A [`Space`] between neighbouring knots.
pub struct Patch {
    basis: Basis,
    /// Those that are not zero here.
    unknowns: Vec<usize>,
    /// Where the terms of each c_{mn} begin, in the order of the splines m and n that are not zero here.
    starts: Vec<usize>,
    /// Places in `unknowns` and factors.
    terms: Vec<(usize, f64)>,
}

impl Patch {
    /// Value of the slice at (a, b), radians, within these knots, as factors on the unknowns, each named once.
    pub fn value_at(&self, a: f64, b: f64) -> Vec<(usize, f64)> {
        self.sum(&[(self.basis.at(a), self.basis.at(b), 1.0)])
    }

    /// Σ factor Σ_{mn} c_{mn} f_m g_n over some (f, g, factor), as factors on the unknowns, each named once; f and g are values or derivatives of
    /// the splines within these knots.
    pub fn sum(&self, parts: &[(Local, Local, f64)]) -> Vec<(usize, f64)> {
        // The weight of each c_{mn} first: it consists of up to some ten unknowns.
        let mut weights = vec![0.0; self.starts.len() - 1];
        for (f, g, weight) in parts {
            let products = f
                .iter()
                .flat_map(|(_, u)| g.iter().map(move |(_, v)| u * v * weight));
            for (sum, product) in weights.iter_mut().zip(products) {
                *sum += product;
            }
        }
        let mut out: Vec<(usize, f64)> = self.unknowns.iter().map(|&u| (u, 0.0)).collect();
        for (weight, range) in weights.into_iter().zip(self.starts.windows(2)) {
            for &(place, factor) in &self.terms[range[0]..range[1]] {
                out[place].1 += weight * factor;
            }
        }
        out
    }
}

/// Adds `factor` to the term of `unknown` among those from `from` on.
fn add(terms: &mut Vec<(usize, f64)>, from: usize, unknown: usize, factor: f64) {
    match terms[from..].iter_mut().find(|t| t.0 == unknown) {
        Some(term) => term.1 += factor,
        None => terms.push((unknown, factor)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells within `reach` cells of the mirror direction.
    fn about_the_mirror(basis: Basis, reach: isize) -> Vec<bool> {
        let n = basis.intervals() as isize;
        (0..n * n)
            .map(|k| (k / n + k % n - n + 1).abs() <= reach)
            .collect()
    }

    #[test]
    fn what_coarse_splines_hold_refined_ones_hold_too() {
        let coarse = Basis::new(20);
        let plain = Space::uniform(coarse);
        let space = Space::refined(coarse, &about_the_mirror(coarse, 7));
        // With coarse and fine unknowns both.
        assert!(space.len() > coarse.pairs() && space.len() < space.basis().pairs());
        let wave = |a: f64, b: f64| a.cos() * b.cos() * (1.0 + (a + 0.3).sin() * (b + 0.3).sin());
        // A coarse spline's unknown in the refined space: the value that reproduces it is found by least squares on
        // a grid, and must be exact.
        let x: Vec<f64> = (0..coarse.len())
            .flat_map(|m| (0..=m).map(move |n| (m, n)))
            .map(|(m, n)| wave(coarse.centre(m), coarse.centre(n)))
            .collect();
        let angles: Vec<f64> = (0..120)
            .map(|k| -1.565 + 3.13 * f64::from(k) / 119.0)
            .collect();
        let mut normal = faer::Mat::<f64>::zeros(space.len(), space.len());
        let mut right = vec![0.0; space.len()];
        let value = |space: &Space, x: &[f64], a: f64, b: f64| -> f64 {
            space.value_at(a, b).iter().map(|&(k, w)| w * x[k]).sum()
        };
        for &a in &angles {
            for &b in &angles {
                let row = space.value_at(a, b);
                let y = value(&plain, &x, a, b);
                for &(i, u) in &row {
                    right[i] += u * y;
                    for &(j, v) in &row {
                        normal[(i, j)] += u * v;
                    }
                }
            }
        }
        let found = super::super::prior::Factor::new(&normal)
            .expect("linearly independent splines")
            .solve_vector(&right);
        for &a in &angles {
            for &b in &angles {
                let (is, was) = (value(&space, &found, a, b), value(&plain, &x, a, b));
                // Rounding times the condition number of the normal equations, some 1e6.
                assert!((is - was).abs() < 1e-8, "{a} {b}: {is} {was}");
            }
        }
    }

    #[test]
    fn a_region_of_everything_or_of_nothing_is_a_uniform_space() {
        let coarse = Basis::new(12);
        let cells = coarse.intervals() * coarse.intervals();
        let all = Space::refined(coarse, &vec![true; cells]);
        assert_eq!(all.len(), coarse.halved().pairs());
        let none = Space::refined(coarse, &vec![false; cells]);
        assert_eq!(none.len(), coarse.pairs());
        // Coefficients are never negative combinations.
        let some = Space::refined(coarse, &about_the_mirror(coarse, 6));
        assert!(some.terms.iter().all(|t| t.1 > 0.0));
        // And a slice written in fine splines is that of its coefficients.
        let x: Vec<f64> = (0..some.len()).map(|k| (k as f64 * 0.7).sin()).collect();
        let c = some.coefficients(&x);
        let fine = Space::uniform(coarse.halved());
        for (a, b) in [(0.1, -0.2), (1.2, 0.4), (-1.5, 1.5)] {
            let of = |space: &Space, x: &[f64]| -> f64 {
                space.value_at(a, b).iter().map(|&(k, w)| w * x[k]).sum()
            };
            assert!((of(&some, &x) - of(&fine, &c)).abs() < 1e-12);
        }
    }
}
