//! Medians of many values, and a robust limit for outliers.

use crate::parallel::map_tasks;

/// Number of standard deviations above the median beyond which a value is an outlier. The standard deviation is that of
/// the values' logarithms, estimated from their median absolute deviation.
const DEVIATIONS: f64 = 3.5;
/// Ratio of the median absolute deviation to the standard deviation in a normal distribution.
const MAD: f64 = 0.674_489_75;

/// Median of some positive values, and the spread of their logarithms.
pub(crate) struct Spread {
    pub(crate) median: f64,
    /// Standard deviation of the values' natural logarithms, estimated from the median absolute deviation.
    spread: f64,
}

impl Spread {
    /// Returns the largest value that is no outlier. It is [`DEVIATIONS`] standard deviations above the median in the
    /// logarithm, or `times` the median, whichever is larger.
    pub(crate) fn most(&self, times: f64) -> f64 {
        self.median * (DEVIATIONS * self.spread).exp().max(times)
    }
}

/// Measures the median and spread of those of `count` values that are positive; `None` if there are none. `value` maps
/// an index to a value.
pub(crate) fn spread(count: usize, value: impl Fn(usize) -> f32 + Sync) -> Option<Spread> {
    let median = median_of(count, &value)?;
    // The larger of v/median and median/v has the same order as the absolute difference of the logarithms.
    let times = |i: usize| match value(i) {
        v if v > 0.0 => (v / median).max(median / v),
        _ => 0.0,
    };
    let spread = median_of(count, times).map_or(0.0, |times| f64::from(times).ln()) / MAD;
    Some(Spread { median: f64::from(median), spread })
}

/// Returns the lower median of those of `count` values that are positive, without copying all of them; `None` if there
/// are none. `value` maps an index to a value.
pub(crate) fn median_of(count: usize, value: impl Fn(usize) -> f32 + Sync) -> Option<f32> {
    /// Number of low bits of a float that are ignored by the histogram from which the median is found.
    const SHIFT: u32 = 16;
    const BINS: usize = 1 << (31 - SHIFT);
    let tasks = count.div_ceil(1 << 14).clamp(1, 32);
    let range = |task: usize| task * count / tasks..(task + 1) * count / tasks;
    let parts = map_tasks(tasks, |task| {
        let mut bins = vec![0_usize; BINS];
        for v in range(task).map(&value).filter(|v| *v > 0.0) {
            bins[(v.to_bits() >> SHIFT) as usize] += 1;
        }
        bins
    });
    let bins: Vec<usize> = (0..BINS).map(|b| parts.iter().map(|p| p[b]).sum()).collect();
    let mut middle = bins.iter().sum::<usize>().checked_sub(1)? / 2;
    let bin = bins.iter().position(|n| {
        let is_here = middle < *n;
        middle -= if is_here { 0 } else { *n };
        is_here
    })?;
    let here = |v: &f32| *v > 0.0 && (v.to_bits() >> SHIFT) as usize == bin;
    let mut values = map_tasks(tasks, |task| range(task).map(&value).filter(here).collect::<Vec<f32>>()).concat();
    Some(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_without_a_copy_are_those_of_sorted_values() {
        let mut random = crate::mesh::random::Random::new(9);
        for count in [0, 1, 2, 17, 40_001] {
            let values: Vec<f32> = (0..count).map(|_| (random.unit() * 3.0 - 0.5).powi(3) as f32).collect();
            let mut sorted: Vec<f32> = values.iter().copied().filter(|v| *v > 0.0).collect();
            sorted.sort_by(f32::total_cmp);
            let expected = sorted.len().checked_sub(1).map(|last| sorted[last / 2]);
            assert_eq!(median_of(count, |i| values[i]), expected);
        }
    }
}
