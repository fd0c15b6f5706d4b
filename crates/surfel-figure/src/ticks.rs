//! Round numbers for the ticks of colour bars and for scale bars.

/// Ticks of a value range for a colour bar: round values and their labels.
#[derive(Clone, Debug, PartialEq)]
pub struct Ticks {
    /// Round values at which ticks are placed, in ascending order.
    pub values: Vec<f64>,
    /// Label of each tick: its value, divided by 10 to the power of `exponent`.
    pub labels: Vec<String>,
    /// Exponent of the common power of ten by which the values are divided in the labels; 0 for labels without a
    /// factor.
    pub exponent: i32,
}

/// Decimal exponents of the largest absolute value for which labels show plain values. Outside, labels are divided by a
/// power of ten.
const WRITTEN: std::ops::RangeInclusive<i32> = -3..=5;

/// Returns the smallest of 1, 2 and 5 times a power of ten that isn't less than `least`.
fn round_up(least: f64) -> f64 {
    let power = 10_f64.powi(least.log10().floor() as i32);
    let factor = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * power >= least * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

/// Returns the largest of 1, 2 and 5 times a power of ten that isn't more than `most`; 0 unless `most` is positive and
/// finite.
pub fn round_length(most: f64) -> f64 {
    if !(most > 0.0 && most.is_finite()) {
        return 0.0;
    }
    let power = 10_f64.powi(most.log10().floor() as i32);
    let factor = [5.0, 2.0].into_iter().find(|factor| factor * power <= most * (1.0 + 1e-9));
    factor.unwrap_or(1.0) * power
}

/// Returns the smallest multiple of a round step that isn't less than `value`. The step is 1, 2 or 5 times a power of
/// ten, and at least a `count`-th of the value. Returns 0 unless `value` is positive and finite.
pub fn round_end(value: f64, count: usize) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 0.0;
    }
    let step = round_up(value / count.max(1) as f64);
    (value / step * (1.0 - 1e-12)).ceil() * step
}

impl Ticks {
    /// Returns at least two and about `count` ticks at round values of a range. For an empty, reversed or infinite
    /// range, the first end is the only tick.
    pub fn new([lo, hi]: [f64; 2], count: usize) -> Self {
        let is_usable = lo.is_finite() && hi.is_finite() && lo < hi && (hi - lo).is_finite();
        if !is_usable {
            return Self { values: vec![lo], labels: vec![format!("{lo}")], exponent: 0 };
        }
        let mut step = round_up((hi - lo) / count.max(1) as f64);
        let multiples = |step: f64| ((lo / step - 1e-9).ceil(), (hi / step + 1e-9).floor());
        while multiples(step).1 - multiples(step).0 < 1.0 {
            step = round_length(step * 0.6);
        }
        let (first, last) = multiples(step);
        let values: Vec<f64> = (0..=(last - first) as usize).map(|k| (first + k as f64) * step).collect();
        let largest = lo.abs().max(hi.abs());
        let exponent = Some(largest.log10().floor() as i32).filter(|e| !WRITTEN.contains(e)).unwrap_or(0);
        let unit = 10_f64.powi(exponent);
        let decimals = ((exponent as f64 - step.log10()) - 1e-9).ceil().clamp(0.0, 17.0) as usize;
        let labels = values.iter().map(|value| number(value / unit, decimals)).collect();
        Self { values, labels, exponent }
    }

    /// Returns the common factor of the labels as text, such as "×10⁻⁶"; empty if there is none.
    pub fn factor(&self) -> String {
        if self.exponent == 0 {
            return String::new();
        }
        let digit = |c: char| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            '0' | '4'..='9' => char::from_u32(0x2070 + c as u32 - 0x30).unwrap_or(c),
            other => other,
        };
        format!("×10{}", self.exponent.to_string().chars().map(digit).collect::<String>())
    }
}

/// Formats a number with `decimals` decimal places, and with a minus sign (U+2212) instead of a hyphen.
fn number(value: f64, decimals: usize) -> String {
    // Adding zero turns −0 into 0.
    format!("{:.decimals$}", value + 0.0).replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_span_the_range() {
        let ranges = [
            [0.0, 1.0],
            [-3.7, 12.9],
            [0.123, 0.124],
            [1e-9, 3e-8],
            [0.0, 8.2e11],
            [412.3, 431.9],
            [-1.0, 0.0],
            [999_999.9, 1_000_000.4],
        ];
        for range in ranges {
            for count in [2, 3, 5, 8] {
                let ticks = Ticks::new(range, count);
                let (values, [lo, hi]) = (&ticks.values, range);
                let step = values[1] - values[0];
                let slack = 1e-9 * (hi - lo) + 1e-15 * hi.abs();
                assert!(values.len() >= 2 && values.len() <= count + 3, "{range:?} {count}: {values:?}");
                assert!(values.iter().all(|v| *v >= lo - slack && *v <= hi + slack), "{range:?}: {values:?}");
                assert!(values[0] - lo < step + slack && hi - values[values.len() - 1] < step + slack, "{values:?}");
                let lead = step / 10_f64.powf((step * 1.000_001).log10().floor());
                assert!([1.0, 2.0, 5.0].iter().any(|f| (lead - f).abs() < 1e-4), "{range:?}: step {step}");
                // Each label states its value.
                for (value, label) in values.iter().zip(&ticks.labels) {
                    let read: f64 = label.replace('−', "-").parse().unwrap();
                    let read = read * 10_f64.powi(ticks.exponent);
                    assert!((read - value).abs() <= 1e-6 * step, "{label} isn't {value}");
                }
            }
        }
    }

    #[test]
    fn labels_are_short() {
        let of = |range| (Ticks::new(range, 4).labels.join(" "), Ticks::new(range, 4).factor());
        assert_eq!(of([0.0, 1.0]), ("0.0 0.5 1.0".to_owned(), String::new()));
        assert_eq!(of([-2.0, 2.0]), ("−2 −1 0 1 2".to_owned(), String::new()));
        assert_eq!(of([0.0, 4e-5]), ("0 1 2 3 4".to_owned(), "×10⁻⁵".to_owned()));
        assert_eq!(Ticks::new([5.0, 5.0], 4).values, [5.0]);
        assert_eq!(Ticks::new([0.0, f64::INFINITY], 4).values, [0.0]);
    }

    #[test]
    fn ends_of_ranges_are_ticks() {
        for (value, expected) in [(0.0372, 0.04), (0.0408, 0.05), (0.006_8, 0.008), (5.0, 5.0), (1.209, 1.5)] {
            let end = round_end(value, 5);
            assert!((end / expected - 1.0).abs() < 1e-9, "{value}: {end}");
            let last = *Ticks::new([0.0, end], 5).values.last().unwrap();
            assert!((last / end - 1.0).abs() < 1e-9, "{value}: the last tick is {last}");
        }
        assert_eq!([0.0, -1.0, f64::NAN, f64::INFINITY].map(|value| round_end(value, 5)), [0.0; 4]);
    }

    #[test]
    fn lengths_are_rounded_down() {
        let all = [0.99, 1.0, 1.9, 2.0, 49.0, 51.0, 7.3e-4].map(round_length);
        for (found, expected) in all.iter().zip([0.5, 1.0, 1.0, 2.0, 20.0, 50.0, 5e-4]) {
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
        assert_eq!([0.0, -1.0, f64::NAN, f64::INFINITY].map(round_length), [0.0; 4]);
    }
}
