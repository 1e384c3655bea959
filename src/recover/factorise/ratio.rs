//! Eq. 29: the paper's factorisation, one ratio per frequency. The oracle, and the comparison in reports.

use num_complex::Complex64;

use super::spectral::Coefficients;
use crate::fourier::Series;

/// L_p / L_0 = B̃_{p,0} / B̃_{0,−p} (eq. 29 with L_0 = 1): reciprocity with q = 0 alone. Frequencies at which the
/// denominator is zero come out as 0.
pub(super) fn lighting(coefficients: &Coefficients) -> Series {
    let mut series = Series::zero(coefficients.order());
    for (p, l) in series.coefficients.iter_mut().enumerate() {
        let p = p as i64;
        let ratio = coefficients.get(p, 0) / coefficients.get(0, p).conj();
        *l = if ratio.is_finite() {
            ratio
        } else {
            Complex64::ZERO
        };
    }
    series
}
