//! Numbers as a reader wants them: few digits, the ones that the uncertainty leaves.

use std::fmt::Write as _;

/// A number with `digits` significant digits, as `a × 10ⁿ` when it is very large or very small; an
/// em dash if it is not finite.
pub fn short(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return "—".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = digits.max(1) as i32;
    let exponent = exponent_after_rounding(value, digits);
    if (-3..6).contains(&exponent) {
        fixed(value, (digits - 1 - exponent).max(0) as usize)
    } else {
        let mantissa = value / 10f64.powi(exponent);
        format!(
            "{} × 10{}",
            fixed(mantissa, (digits - 1) as usize),
            superscript(exponent)
        )
    }
}

/// As [`short`], without zeros at the end: for round values such as settings and ticks.
pub fn trimmed(value: f64, digits: usize) -> String {
    let zeros_off = |text: &str| -> String {
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text.to_owned()
        }
    };
    let text = short(value, digits);
    match text.split_once(" × ") {
        Some(("1", power)) => power.to_owned(),
        Some((mantissa, power)) => match zeros_off(mantissa).as_str() {
            "1" => power.to_owned(),
            mantissa => format!("{mantissa} × {power}"),
        },
        None => zeros_off(&text),
    }
}

/// `value ± sigma`, both cut at the second significant digit of `sigma`.
///
/// Without a usable `sigma` (zero, infinite, not a number) only the value is written.
pub fn with_sigma(value: f64, sigma: f64) -> String {
    if !value.is_finite() {
        return "—".to_owned();
    }
    if !sigma.is_finite() || sigma <= 0.0 {
        return short(value, 4);
    }
    let last = exponent_after_rounding(sigma, 2) - 1;
    let size = if value == 0.0 {
        last + 1
    } else {
        exponent_after_rounding(value, 4).max(last + 1)
    };
    if (-3..6).contains(&size) && last >= -9 {
        let decimals = (-last).max(0) as usize;
        format!("{} ± {}", fixed(value, decimals), fixed(sigma, decimals))
    } else {
        let scale = 10f64.powi(size);
        let decimals = (size - last).max(0) as usize;
        format!(
            "({} ± {}) × 10{}",
            fixed(value / scale, decimals),
            fixed(sigma / scale, decimals),
            superscript(size)
        )
    }
}

/// A number with a fixed count of decimals and a true minus sign; never `−0`.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "—".to_owned();
    }
    let mut text = String::new();
    write_decimals(value, decimals, &mut text);
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

/// What `{value:.decimals$}` writes, in a third of the time where the number is small and not half way between two decimals.
pub fn write_decimals(value: f64, decimals: usize, out: &mut String) {
    const SCALES: [u32; 5] = [1, 10, 100, 1000, 10_000];
    if let Some(&scale) = SCALES.get(decimals) {
        let scaled = value.abs() * f64::from(scale);
        let rounded = scaled.round();
        // The product is wrong by 1e-7 at the most.
        if scaled < 1e9 && (scaled - rounded).abs() < 0.499 {
            let rounded = rounded as u32;
            if value.is_sign_negative() {
                out.push('-');
            }
            let _ = write!(out, "{}", rounded / scale);
            if decimals > 0 {
                out.push('.');
                let rest = rounded % scale;
                for place in (0..decimals).rev() {
                    let digit = rest / SCALES[place] % 10;
                    out.push(char::from(b'0' + digit as u8));
                }
            }
            return;
        }
    }
    let _ = write!(out, "{value:.decimals$}");
}

/// A share of one as per cent.
pub fn percent(share: f64) -> String {
    if share.is_finite() {
        format!("{} %", short(100.0 * share, 3))
    } else {
        "—".to_owned()
    }
}

/// 10ⁿ as text, for axes.
pub fn power_of_ten(exponent: i32) -> String {
    format!("10{}", superscript(exponent))
}

/// Whole numbers with thin spaces between groups of three digits.
pub fn count(value: usize) -> String {
    let digits = value.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) && digits.len() > 4 {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

/// The decimal exponent of `value` once it is rounded to `digits` significant digits.
fn exponent_after_rounding(value: f64, digits: i32) -> i32 {
    let rounded = format!("{:.*e}", (digits - 1).max(0) as usize, value.abs());
    rounded
        .split_once('e')
        .and_then(|(_, exponent)| exponent.parse().ok())
        .unwrap_or(0)
}

fn superscript(exponent: i32) -> String {
    exponent
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            '4' => '⁴',
            '5' => '⁵',
            '6' => '⁶',
            '7' => '⁷',
            '8' => '⁸',
            '9' => '⁹',
            _ => '⁰',
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_uncertainty_decides_the_digits() {
        assert_eq!(with_sigma(3.00214, 0.00432), "3.0021 ± 0.0043");
        assert_eq!(with_sigma(37.3, 0.0996), "37.30 ± 0.10");
        assert_eq!(
            with_sigma(-0.00001234, 0.0000005),
            "(−1.234 ± 0.050) × 10⁻⁵"
        );
        assert_eq!(with_sigma(12345678.0, 4321.0), "(1.23457 ± 0.00043) × 10⁷");
        assert_eq!(with_sigma(120.0, 35.0), "120 ± 35");
        assert_eq!(with_sigma(1.25, 0.0), "1.250");
        assert_eq!(with_sigma(1.25, f64::INFINITY), "1.250");
        assert_eq!(with_sigma(f64::NAN, 0.1), "—");
        assert_eq!(with_sigma(0.0, 0.1), "0.00 ± 0.10");
    }

    #[test]
    fn decimals_are_written_as_the_language_writes_them() {
        let mut values = vec![
            0.0,
            -0.0,
            0.5,
            1.5,
            0.125,
            -0.375,
            0.25,
            99.995,
            9.9999e4,
            1e5,
            1e9,
            -1e300,
            f64::MIN_POSITIVE,
            f64::INFINITY,
            f64::NAN,
        ];
        values.extend((0..20_000).map(|k| {
            let size = 10f64.powi(k % 13 - 6);
            (f64::from(k) * 0.754_877_666).fract() * size - 0.3 * size
        }));
        // Half way between two, and next to it.
        values.extend((0..2000).flat_map(|k| {
            let half = (f64::from(k) + 0.5) / 100.0;
            [half.next_down(), half, half.next_up()]
        }));
        for value in values {
            for decimals in 0..7 {
                let mut found = String::new();
                write_decimals(value, decimals, &mut found);
                assert_eq!(found, format!("{value:.decimals$}"), "{value:?}");
            }
        }
    }

    #[test]
    fn short_numbers_round_before_they_choose_a_notation() {
        assert_eq!(short(0.0, 3), "0");
        assert_eq!(short(999.96, 4), "1000");
        assert_eq!(short(-0.05, 2), "−0.050");
        assert_eq!(short(1e-9, 2), "1.0 × 10⁻⁹");
        assert_eq!(short(6.02e23, 3), "6.02 × 10²³");
        assert_eq!(short(f64::NEG_INFINITY, 3), "—");
        assert_eq!(fixed(-0.0004, 2), "0.00");
        assert_eq!(percent(0.00293), "0.293 %");
        assert_eq!(count(1234567), "1\u{202f}234\u{202f}567");
        assert_eq!(power_of_ten(-5), "10⁻⁵");
        assert_eq!(trimmed(1e-4, 3), "10⁻⁴");
        assert_eq!(trimmed(2.5e-5, 3), "2.5 × 10⁻⁵");
        assert_eq!(trimmed(80.0, 3), "80");
        assert_eq!(trimmed(0.5, 3), "0.5");
    }
}
