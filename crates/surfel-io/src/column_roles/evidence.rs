//! Statistics of columns: ranges and counts over all rows, and properties of a sample of rows.

use crate::strided::{Strided, block_rows, read_rows};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Number of consecutive rows in each run of the sample. The sample has [`RUNS`] runs, spread evenly over the file, or
/// all rows of a file with fewer.
pub(super) const RUN_ROWS: usize = 32;
/// Number of runs of rows in the sample; each has [`RUN_ROWS`] rows. A file of at most 2048 rows is sampled whole.
const RUNS: usize = 64;
/// Number of distinct values at which counting stops. Columns with more distinct values are judged alike.
const MAX_DISTINCT: usize = 1024;
/// Smallest number of rows from which the values of a column are taken as typical of its role.
pub(super) const MANY_ROWS: usize = 8;

/// Statistics of one column, from which its possible roles are judged.
#[derive(Clone, Debug)]
pub(super) struct Column {
    /// Minimum finite value of all rows; +∞ if there is none.
    pub(super) least: f64,
    /// Maximum finite value of all rows; −∞ if there is none.
    pub(super) most: f64,
    /// True if every finite value is a whole number.
    pub(super) is_whole: bool,
    /// Difference between successive rows, if it is the same whole number in all rows, as in a column of row numbers.
    /// `None` otherwise.
    pub(super) step: Option<f64>,
    /// True if each value is equal to or greater than the one before.
    pub(super) is_sorted: bool,
    /// True if each value is greater than the one before.
    pub(super) is_increasing: bool,
    /// Number of distinct values in the sample, at most [`MAX_DISTINCT`].
    pub(super) distinct: usize,
    /// Values of the sampled rows, in runs of [`RUN_ROWS`] consecutive rows.
    pub(super) sample: Vec<f64>,
}

impl Column {
    /// True if all finite values are the same, or no value is finite.
    pub(super) fn is_constant(&self) -> bool {
        self.least >= self.most
    }

    /// True if the column counts rows: each value differs from the one before by the same whole number, other than 0.
    pub(super) fn counts(&self) -> bool {
        self.step.is_some_and(|step| step != 0.0)
    }

    /// True if the column numbers all rows, from 0 or 1.
    pub(super) fn is_row_number(&self) -> bool {
        self.step == Some(1.0) && (self.least == 0.0 || self.least == 1.0)
    }

    /// True if the column has few values (`has_few_values`) without large gaps, as classes are. None is above 255, and
    /// the sample has at least a quarter of the whole numbers in their range.
    pub(super) fn is_dense_label(&self) -> bool {
        let span = self.most - self.least + 1.0;
        self.has_few_values() && self.most <= 255.0 && self.distinct as f64 * 4.0 >= span
    }

    /// True if the column has few values (`has_few_values`), at most 40 distinct ones in at least 512 sampled rows, as
    /// with instance ids. They may have gaps.
    pub(super) fn is_sparse_label(&self) -> bool {
        self.has_few_values() && self.sample.len() >= 512 && self.distinct <= 40
    }

    /// True if all values are whole numbers from −1 on, not all the same. The sample must have at least [`MANY_ROWS`]
    /// rows and at most 64 distinct values, each at least three times on average.
    fn has_few_values(&self) -> bool {
        let is_repeated = self.distinct <= 64 && self.distinct * 3 <= self.sample.len();
        self.is_whole && self.sample.len() >= MANY_ROWS && is_repeated && self.least >= -1.0 && !self.is_constant()
    }

    /// True if no step between successive values of the sample is more than three times the mean step. False for fewer
    /// than `2 * MANY_ROWS` steps. Identifiers ascend in even steps, sorted coordinates in uneven ones.
    pub(super) fn has_even_steps(&self) -> bool {
        let gaps: Vec<f64> = self.successive().map(|(before, after)| (after - before).abs()).collect();
        let usual = gaps.iter().sum::<f64>() / gaps.len().max(1) as f64;
        gaps.len() >= 2 * MANY_ROWS && gaps.iter().all(|gap| *gap <= 3.0 * usual)
    }

    /// Returns the pairs of successive sample values within each run, whose rows are neighbours in the file.
    pub(super) fn successive(&self) -> impl Iterator<Item = (f64, f64)> {
        self.sample.chunks(RUN_ROWS).flat_map(|run| run.windows(2).map(|pair| (pair[0], pair[1])))
    }
}

/// Statistics of a column over a block of consecutive rows. [`measure`] joins the statistics of all blocks.
#[derive(Clone, Copy)]
struct Part {
    first: f64,
    last: f64,
    least: f64,
    most: f64,
    is_whole: bool,
    has_step: bool,
    is_sorted: bool,
    is_increasing: bool,
}

impl Part {
    fn of(values: &[f64], first_row: usize, start: f64, step: f64) -> Self {
        let (first, last) = (values[0], values[values.len() - 1]);
        let mut part = Self {
            first,
            last,
            least: f64::INFINITY,
            most: f64::NEG_INFINITY,
            is_whole: true,
            has_step: true,
            is_sorted: true,
            is_increasing: true,
        };
        for (i, v) in values.iter().enumerate() {
            part.has_step &= *v == start + step * (first_row + i) as f64;
            if v.is_finite() {
                (part.least, part.most) = (part.least.min(*v), part.most.max(*v));
                part.is_whole &= v.fract() == 0.0;
            }
        }
        for pair in values.windows(2) {
            part.is_sorted &= pair[0] <= pair[1];
            part.is_increasing &= pair[0] < pair[1];
        }
        part
    }

    fn join(self, next: Self) -> Self {
        Self {
            first: self.first,
            last: next.last,
            least: self.least.min(next.least),
            most: self.most.max(next.most),
            is_whole: self.is_whole && next.is_whole,
            has_step: self.has_step && next.has_step,
            is_sorted: self.is_sorted && next.is_sorted && self.last <= next.first,
            is_increasing: self.is_increasing && next.is_increasing && self.last < next.first,
        }
    }
}

/// Returns the statistics of columns, which have equal lengths and at least one row.
pub(super) fn measure(columns: &[Strided<'_>]) -> Vec<Column> {
    let sample = sample(columns);
    let rows = columns[0].len();
    let block = block_rows(columns);
    let line = |column: &Strided<'_>| {
        let [start, second] = [0, 1].map(|row| column.at(row));
        (start, if rows > 1 { second - start } else { 0.0 })
    };
    let lines: Vec<(f64, f64)> = columns.iter().map(line).collect();
    let buffers = || (Vec::new(), vec![Vec::new(); columns.len()]);
    let of_block = |(bytes, numbers): &mut (Vec<u8>, Vec<Vec<f64>>), i: usize| -> Vec<Part> {
        let range = i * block..rows.min((i + 1) * block);
        read_rows(columns, range.clone(), bytes, numbers);
        let of_column =
            |(values, (start, step)): (&Vec<f64>, &(f64, f64))| Part::of(values, range.start, *start, *step);
        numbers.iter().zip(&lines).map(of_column).collect()
    };
    let blocks: Vec<Vec<Part>> = match rows.div_ceil(block) {
        // Small tables are common, and waking threads would take longer than measuring them.
        1 => vec![of_block(&mut buffers(), 0)],
        count => (0..count).into_par_iter().map_init(buffers, of_block).collect(),
    };
    let joined = blocks.into_iter().reduce(|a, b| a.into_iter().zip(b).map(|(a, b)| a.join(b)).collect());
    let parts = joined.unwrap_or_default().into_iter().zip(lines).zip(sample);
    let column = |((part, (_, step)), sample): ((Part, (f64, f64)), Vec<f64>)| Column {
        least: part.least,
        most: part.most,
        is_whole: part.is_whole,
        step: (part.has_step && rows > 1 && step.fract() == 0.0).then_some(step),
        is_sorted: part.is_sorted,
        is_increasing: part.is_increasing,
        distinct: distinct(&sample),
        sample,
    };
    parts.map(column).collect()
}

/// Returns each column's values in the sample: runs of consecutive rows that are spread evenly over the file. A file of
/// at most 2048 rows is sampled whole.
fn sample(columns: &[Strided<'_>]) -> Vec<Vec<f64>> {
    let rows = columns[0].len();
    let starts: Vec<usize> = match rows {
        0..=2048 => (0..rows).step_by(RUN_ROWS).collect(),
        _ => (0..RUNS).map(|run| (run as u128 * (rows - RUN_ROWS) as u128 / (RUNS - 1) as u128) as usize).collect(),
    };
    let mut all = vec![Vec::new(); columns.len()];
    let (mut bytes, mut numbers) = (Vec::new(), vec![Vec::new(); columns.len()]);
    for start in starts {
        read_rows(columns, start..rows.min(start + RUN_ROWS), &mut bytes, &mut numbers);
        all.iter_mut().zip(&numbers).for_each(|(all, run)| all.extend_from_slice(run));
    }
    all
}

fn distinct(sample: &[f64]) -> usize {
    let mut found = BTreeSet::new();
    for value in sample {
        found.insert(value.to_bits());
        if found.len() == MAX_DISTINCT {
            break;
        }
    }
    found.len()
}

/// Range of colour channels: from 0 to 1, 255 or 65535.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scale {
    One,
    Bytes,
    Words,
}

impl Scale {
    pub(super) fn most(self) -> f64 {
        match self {
            Self::One => 1.0,
            Self::Bytes => 255.0,
            Self::Words => 65_535.0,
        }
    }
}

/// Three neighbouring columns, which may be vectors or colours.
pub(super) struct Triple<'a> {
    columns: [&'a Column; 3],
}

impl<'a> Triple<'a> {
    pub(super) fn of(columns: [&'a Column; 3]) -> Self {
        Self { columns }
    }

    fn rows(&self) -> impl Iterator<Item = [f64; 3]> {
        (0..self.columns[0].sample.len()).map(|row| self.columns.map(|c| c.sample[row]))
    }

    /// True if at least 95 % of the sampled rows, and at least one, are unit vectors, as normals are: their length is 1
    /// within 0.02. Zero vectors, which mean that a point has no normal, and vectors with NaN don't count.
    pub(super) fn is_unit(&self) -> bool {
        let (mut unit, mut other) = (0, 0);
        for row in self.rows() {
            let length = row.map(|v| v * v).iter().sum::<f64>().sqrt();
            // Normals are printed with two decimals at least.
            if (length - 1.0).abs() < 0.02 {
                unit += 1;
            } else if length != 0.0 && !length.is_nan() {
                other += 1;
            }
        }
        unit > 0 && unit >= 19 * other
    }

    /// Returns the range of the colour channels if the columns can be colours. Returns `None` for values below 0 or
    /// above 65535, fractions in columns that exceed 255, columns without a finite value, and zeros alone.
    pub(super) fn color_scale(&self) -> Option<Scale> {
        let [least, most] = self
            .columns
            .iter()
            .fold([f64::INFINITY, 0.0_f64], |[least, most], c| [least.min(c.least), most.max(c.most)]);
        let is_whole = self.columns.iter().all(|c| c.is_whole);
        // The minimum is infinite if there is no finite value.
        let is_finite = self.columns.iter().all(|c| c.least.is_finite());
        match most {
            _ if least < 0.0 || !is_finite || most <= 0.0 => None,
            m if m <= ROUNDED_ONE => Some(Scale::One),
            m if m <= 255.0 => Some(Scale::Bytes),
            m if m <= 65_535.0 && is_whole => Some(Scale::Words),
            _ => None,
        }
    }

    /// Returns a score that grows with the resemblance of the three columns to colours; `None` if they can't be
    /// colours.
    pub(super) fn color(&self) -> Option<f64> {
        let scale = self.color_scale()?;
        let c = &self.columns;
        let is_whole = c.iter().all(|c| c.is_whole);
        let mut score = match (scale, is_whole) {
            (Scale::Bytes, true) => 3.0,
            (Scale::One, false) | (Scale::Words, true) => 2.0,
            (Scale::One, true) => 0.2,
            (Scale::Bytes | Scale::Words, false) => 0.5,
        };
        let most = c.iter().fold(0.0_f64, |most, c| most.max(c.most));
        let nearly_grey = 1.0 - (self.mean_spread() / most).min(1.0);
        score += nearly_grey;
        if c[0].sample.len() < MANY_ROWS {
            return Some(score);
        }
        let is_extreme = scale != Scale::One && self.rows().flatten().all(|v| v == 0.0 || v == scale.most());
        let least_most = c.iter().fold(f64::INFINITY, |least, c| least.min(c.most));
        if least_most < 0.25 * most && !is_extreme {
            score -= 4.0;
        }
        let constant = c.iter().filter(|c| c.is_constant()).count();
        if constant == 3 {
            score -= 2.0;
        } else if !is_extreme {
            score -= 3.0 * constant as f64;
        }
        let labels = c.iter().filter(|c| c.is_dense_label() && c.most <= 64.0).count();
        score -= 2.0 * labels as f64 + if labels == 3 { 3.0 } else { 0.0 };
        score -= 4.0 * c.iter().filter(|c| c.counts() || c.is_increasing).count() as f64;
        if c.iter().all(|c| c.distinct >= 16) {
            score += 1.0;
        } else if scale == Scale::Words {
            score -= 2.0;
        } else if scale == Scale::Bytes && is_whole && labels == 0 && constant < 3 && most >= 100.0 {
            // A palette has few distinct values.
            score += 1.0;
        }
        match (scale, is_whole) {
            (Scale::One, false) if self.are_bytes_over_255() => score += 2.0,
            (Scale::Bytes, false) if nearly_grey > 0.65 => score += 1.0,
            _ => {}
        }
        Some(score)
    }

    /// Returns the mean difference between the largest and the smallest value of a row. It is small for colours, which
    /// are mostly near grey.
    fn mean_spread(&self) -> f64 {
        let spread = |row: [f64; 3]| {
            let [least, most] = row.iter().fold([f64::INFINITY, 0.0], |[lo, hi], v| [v.min(lo), v.max(hi)]);
            if most >= least { most - least } else { 0.0 }
        };
        self.rows().map(spread).sum::<f64>() / self.columns[0].sample.len().max(1) as f64
    }

    /// True if at least 95 % of the sampled finite values are 8-bit levels divided by 255, within 0.03 levels. Some
    /// value must be between 0 and 1.
    pub(super) fn are_bytes_over_255(&self) -> bool {
        let (mut near, mut far, mut between) = (0, 0, 0);
        for v in self.rows().flatten().filter(|v| v.is_finite()) {
            let level = v * 255.0;
            // Four decimals are the fewest that distinguish neighbouring levels reliably.
            let is_near = (level - level.round()).abs() <= 0.03;
            near += u32::from(is_near);
            far += u32::from(!is_near);
            between += u32::from(v > 0.0 && v < 1.0);
        }
        near >= 19 * far && between > 0
    }
}

/// Largest value of colour columns whose range counts as 0 to 1. Values that were rounded may exceed 1.
pub(crate) const ROUNDED_ONE: f64 = 1.001;
