//! Formatting of numbers in messages.

pub use surfel_io::counted;

/// Formats a number with three significant digits, or as a whole number from 1000 on. Absolute values below 1e−5 and
/// from 1e5 on are written with a power of ten.
pub fn number(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        size if (1e-5..1e5).contains(&size) => {
            let decimals = (2.0 - size.log10().floor()).max(0.0) as usize;
            format!("{value:.decimals$}")
        }
        size if size.is_finite() => format!("{value:.2e}"),
        _ => value.to_string(),
    }
}

/// Formats a number with the fewest digits that identify it. If the value is exact in `f32`, its digits identify the
/// `f32`.
pub fn shortest(value: f64) -> String {
    let narrow = value as f32;
    if f64::from(narrow) == value { format!("{narrow:?}") } else { format!("{value:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits_and_powers_of_ten_only_beyond_five() {
        let cases = [
            (0.0, "0"),
            (1.0, "1.00"),
            (0.000_612_3, "0.000612"),
            (0.000_010_01, "0.0000100"),
            (0.000_009_99, "9.99e-6"),
            (123.4, "123"),
            (99_999.0, "99999"),
            (-0.5, "-0.500"),
            (1e5, "1.00e5"),
            (2.109_7e37, "2.11e37"),
            (5e-324, "4.94e-324"),
            (f64::INFINITY, "inf"),
            (f64::NAN, "NaN"),
        ];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn what_came_from_f32_is_as_short_as_it_was() {
        assert_eq!(shortest(f64::from(0.001_808_f32)), "0.001808");
        assert_eq!(shortest(0.001_808), "0.001808");
        assert_eq!(shortest(431_234.567), "431234.567");
        assert_eq!((shortest(1.0), shortest(f64::from(1e38_f32))), ("1.0".to_owned(), "1e38".to_owned()));
    }
}
