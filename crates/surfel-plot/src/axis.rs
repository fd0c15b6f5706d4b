//! Axes: which values are where, and which are named.

/// How values are spread over an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By their logarithm. What isn't above 0 lies at the lower end.
    Log,
    /// By their logarithm, from large values to small ones. What isn't above 0 lies at the right end.
    LogDown,
}

/// An axis of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What it measures, with its unit.
    pub label: String,
    /// How values are spread.
    pub scale: Scale,
    /// Values at its ends; found from the data where there are none. What lies beyond is drawn at the end.
    pub range: Option<[f64; 2]>,
}

impl Axis {
    /// An axis that finds its range.
    pub fn new(label: impl Into<String>, scale: Scale) -> Self {
        Self { label: label.into(), scale, range: None }
    }

    /// The same with its ends given.
    #[must_use]
    pub fn over(self, range: [f64; 2]) -> Self {
        Self { range: Some(range), ..self }
    }

    /// The axis for these values.
    pub(crate) fn fit(&self, values: impl Iterator<Item = f64>) -> Fitted {
        let scale = self.scale;
        let values = self.range.map_or_else(|| values.collect(), |range| range.to_vec());
        let usable = values.iter().copied().filter(|&v| v.is_finite() && (scale == Scale::Linear || v > 0.0));
        let (mut low, mut high) = usable
            .map(|v| position(scale, v))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let step = step(scale, (high - low).max(if scale == Scale::Linear { 1e-9 } else { 1.0 }));
        // Given ends stay as they are; powers of ten leave a little room, since an axis much longer than its data is empty.
        let (low, high) = match (scale, self.range) {
            (_, Some(_)) => (low, high),
            (Scale::Linear, None) => ((low / step - 1e-9).floor() * step, (high / step + 1e-9).ceil() * step),
            (Scale::Log | Scale::LogDown, None) => {
                // A single value still gets a factor of two.
                let room = (0.04 * (high - low)).max(0.5 * (0.3 - (high - low)));
                (low - room, high + room)
            }
        };
        Fitted { scale, low, high: if high > low { high } else { low + 2.0 * step }, step }
    }
}

/// Where a value lies, before it is brought to [0, 1].
fn position(scale: Scale, value: f64) -> f64 {
    match scale {
        Scale::Linear => value,
        Scale::Log => value.log10(),
        Scale::LogDown => -value.log10(),
    }
}

/// A step between named values that makes about six of them: 1, 2 or 5 times a power of ten.
fn step(scale: Scale, length: f64) -> f64 {
    let rough = length / 6.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|step| *step >= rough * 0.999);
    let step = step.unwrap_or(power);
    if scale == Scale::Linear { step } else { step.max(1.0).round() }
}

/// A value of one digit.
fn short(value: f64) -> String {
    let exponent = value.log10().floor();
    match exponent as i32 {
        0..=3 => format!("{value:.0}"),
        -3..=-1 => format!("{value:.*}", -exponent as usize),
        _ => format!("{value:.0e}"),
    }
}

/// An axis with its ends.
pub(crate) struct Fitted {
    scale: Scale,
    low: f64,
    high: f64,
    step: f64,
}

impl Fitted {
    /// Where a value lies, 0 to 1.
    pub(crate) fn at(&self, value: f64) -> f64 {
        let nowhere = self.scale != Scale::Linear && value <= 0.0;
        let position = match (nowhere, self.scale) {
            (true, Scale::LogDown) => f64::INFINITY,
            (true, _) => f64::NEG_INFINITY,
            (false, scale) => position(scale, value),
        };
        ((position - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }

    /// Places and names along the axis.
    pub(crate) fn ticks(&self) -> Vec<(f64, String)> {
        let at = |position: f64| (position - self.low) / (self.high - self.low);
        let decades = self.high - self.low;
        if self.scale != Scale::Linear && decades < 2.0 {
            // Few powers of ten: what lies between them is named too.
            let digits: &[i32] = if decades < 0.7 { &[1, 2, 3, 4, 5, 6, 7, 8, 9] } else { &[1, 2, 5] };
            let sign = if self.scale == Scale::Log { 1.0 } else { -1.0 };
            let exponents = (self.low.min(-self.high).floor() as i32 - 1)..=(self.high.max(-self.low).ceil() as i32);
            let values = exponents.flat_map(|e| digits.iter().map(move |&d| f64::from(d) * 10f64.powi(e)));
            let named = values.map(|value| (at(sign * value.log10()), short(value)));
            return named.filter(|(at, _)| (-1e-9..=1.0 + 1e-9).contains(at)).collect();
        }
        let first = (self.low / self.step - 1e-9).ceil();
        let count = ((self.high - first * self.step) / self.step + 1e-6).floor().max(0.0) as usize;
        let tick = |i: usize| {
            let position = (first + i as f64) * self.step;
            (at(position), self.name(position))
        };
        (0..=count).map(tick).collect()
    }

    fn name(&self, position: f64) -> String {
        let power = |exponent: f64| match exponent.round() as i32 {
            exponent @ 0..=3 => format!("{}", 10f64.powi(exponent)),
            exponent @ -2..=-1 => format!("{:.*}", exponent.unsigned_abs() as usize, 10f64.powi(exponent)),
            exponent => format!("1e{exponent}"),
        };
        match self.scale {
            Scale::Linear => {
                let digits = (-self.step.log10().floor()).clamp(0.0, 12.0) as usize;
                format!("{:.digits$}", if position.abs() < 1e-12 { 0.0 } else { position })
            }
            Scale::Log => power(position),
            Scale::LogDown => power(-position),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(axis: &Axis, values: &[f64]) -> Vec<String> {
        axis.fit(values.iter().copied()).ticks().into_iter().map(|t| t.1).collect()
    }

    #[test]
    fn axis_names_round_values_that_hold_the_data() {
        assert_eq!(names(&Axis::new("", Scale::Linear), &[0.3, 5.2]), ["0", "1", "2", "3", "4", "5", "6"]);
        assert_eq!(names(&Axis::new("", Scale::Log), &[0.02, 900.0]), ["0.1", "1", "10", "100", "1000"]);
        assert_eq!(names(&Axis::new("", Scale::LogDown), &[1.0, 1e-4]), ["1", "0.1", "0.01", "1e-3", "1e-4"]);
        assert_eq!(names(&Axis::new("", Scale::Log), &[3.0, 30.0]), ["5", "10", "20"]);
        assert_eq!(names(&Axis::new("", Scale::Log), &[0.034, 0.061]), ["0.04", "0.05", "0.06"]);
    }

    #[test]
    fn axis_puts_what_it_cannot_show_at_its_ends() {
        let up = Axis::new("", Scale::Log).fit([1e-8, 1.0].into_iter());
        assert_eq!([up.at(0.0), up.at(f64::INFINITY)], [0.0, 1.0]);
        assert!(up.at(1e-8) < 0.05 && up.at(1.0) > 0.95);
        let down = Axis::new("", Scale::LogDown).fit([1e-8, 1.0].into_iter());
        assert_eq!(down.at(0.0), 1.0);
        assert!(down.at(1.0) < 0.05 && down.at(1e-8) > 0.95);
    }

    #[test]
    fn axis_of_nothing_or_of_one_value_has_a_length() {
        for scale in [Scale::Linear, Scale::Log] {
            assert!(names(&Axis::new("", scale), &[]).len() > 1, "{scale:?}");
            assert!(names(&Axis::new("", scale), &[5.0]).len() > 1, "{scale:?}");
        }
    }
}
