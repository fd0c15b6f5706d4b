//! Utilities for formats of laser scans: reading with seeking, columns that take no memory while they are zero, and
//! colours of 8 or 16 bits.

#![cfg_attr(not(feature = "las"), allow(dead_code))]

use crate::color::{exact_8_bit, linear_of_8_bit, linear_of_16_bit};
use std::io::{Read, Seek};
use surfel_model::{ExtraColumn, ExtraValues};

/// A seekable source of bytes, such as a file of a scan. Readers take only its points into memory.
pub(crate) trait Source: Read + Seek + Send + Sync {}

impl<T: Read + Seek + Send + Sync> Source for T {}

/// A number type that extra columns can have.
pub(crate) trait Scalar: Copy + Default + PartialEq + Send + Sync {
    fn column(values: Vec<Self>) -> ExtraValues;
}

macro_rules! scalars {
    ($($t:ty => $variant:ident),*) => {
        $(impl Scalar for $t {
            fn column(values: Vec<Self>) -> ExtraValues {
                ExtraValues::$variant(values)
            }
        })*
    };
}

scalars!(i8 => I8, u8 => U8, i16 => I16, u16 => U16, i32 => I32, u32 => U32, f32 => F32, f64 => F64);

/// A column that takes no memory as long as all its values are zero.
#[derive(Debug, Default)]
pub(crate) struct SparseColumn<T> {
    zeros: usize,
    values: Vec<T>,
}

impl<T: Scalar> SparseColumn<T> {
    /// Appends `count` values. Memory is reserved for `expected` values, a lower bound of the final number.
    pub(crate) fn append(&mut self, count: usize, expected: usize, values: impl Iterator<Item = T> + Clone) {
        if self.values.is_empty() {
            if values.clone().all(|v| v == T::default()) {
                self.zeros += count;
                return;
            }
            self.values.reserve_exact(expected.max(self.zeros + count));
            self.values.resize(self.zeros, T::default());
        }
        self.values.extend(values);
    }

    /// True if all values so far are zero.
    pub(crate) fn is_zero(&self) -> bool {
        self.values.is_empty()
    }

    /// Returns the column under a name; `None` if all values are zero.
    pub(crate) fn finish(self, name: String) -> Option<ExtraColumn> {
        let mut values = self.values;
        values.shrink_to_fit();
        (!values.is_empty()).then(|| ExtraColumn { name, values: T::column(values) })
    }
}

/// sRGB-encoded colours from 16-bit fields, into which many programs write 8-bit levels (0–255). They are converted to
/// linear RGB when they are appended.
#[derive(Debug, Default)]
pub(crate) struct WideColors {
    linear: Vec<[f32; 3]>,
    /// True if some level so far exceeds 255, so that the levels have 16 bits.
    wide: bool,
    /// True if some level so far exceeds 0, so that not all colours are black.
    any: bool,
}

impl WideColors {
    pub(crate) fn append(&mut self, expected: usize, levels: impl Iterator<Item = [u16; 3]> + Clone) {
        self.see(levels.clone());
        if self.linear.is_empty() {
            self.linear.reserve_exact(expected);
        }
        if self.wide {
            let table = linear_of_16_bit();
            self.linear.extend(levels.map(|rgb| rgb.map(|c| table[usize::from(c)])));
        } else {
            let table = linear_of_8_bit();
            self.linear.extend(levels.map(|rgb| rgb.map(|c| table[usize::from(c)])));
        }
    }

    /// Includes colours in the detection of the range without appending them: those of dropped points. The range then
    /// doesn't depend on which points are dropped.
    pub(crate) fn see(&mut self, levels: impl Iterator<Item = [u16; 3]>) {
        let largest = levels.flatten().max().unwrap_or(0);
        self.any |= largest > 0;
        if largest > 255 && !self.wide {
            self.wide = true;
            let table = linear_of_16_bit();
            for c in self.linear.iter_mut().flatten() {
                *c = table[usize::from(exact_8_bit(*c).unwrap_or(0))];
            }
        }
    }

    /// True if some colour so far isn't black.
    pub(crate) fn any(&self) -> bool {
        self.any
    }

    /// Returns the colours as linear RGB, and true if their levels range only to 255. Returns `None` if all colours are
    /// black.
    pub(crate) fn finish(self) -> Option<(Vec<[f32; 3]>, bool)> {
        self.any.then_some((self.linear, !self.wide))
    }
}

/// Returns a column's name for comparisons: its ASCII letters and digits, in lower case.
pub(crate) fn plain_name(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
}

/// Names of the columns with normals, in the form that [`plain_name`] returns.
pub(crate) const NORMAL_NAMES: [&str; 3] = ["normalx", "normaly", "normalz"];

/// Removes the columns with normals from the extra columns, and returns them as vectors. A missing component is zero.
/// Returns `None` if all three components are missing.
#[cfg(feature = "las")]
pub(crate) fn take_normals(extras: &mut Vec<ExtraColumn>) -> Option<surfel_model::Column3> {
    let mut found: [Option<Vec<f32>>; 3] = [None, None, None];
    extras.retain_mut(|extra| match NORMAL_NAMES.iter().position(|name| plain_name(&extra.name) == *name) {
        Some(k) => {
            found[k] = Some(crate::columns::to_f32(std::mem::replace(&mut extra.values, ExtraValues::U8(Vec::new()))));
            false
        }
        None => true,
    });
    let count = found.iter().flatten().map(Vec::len).max()?;
    let at = |k: usize, i: usize| found[k].as_ref().and_then(|v: &Vec<f32>| v.get(i)).copied().unwrap_or(0.0);
    let vectors = (0..count).map(|i| glam::Vec3::new(at(0, i), at(1, i), at(2, i)));
    Some(surfel_model::Column3::from_f32(vectors.collect()))
}

/// Returns the text before the first zero byte, without surrounding blanks. Control characters, such as line breaks,
/// become blanks.
pub(crate) fn one_line(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    let text = String::from_utf8_lossy(&bytes[..end]);
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>().trim().to_owned()
}

/// Formats an extent as "W x D x H" for a note, with four digits or in whole units.
pub(crate) fn format_extent(extent: glam::DVec3) -> String {
    let one = |v: f64| {
        let digits = if v > 0.0 && v.is_finite() { (3 - v.log10().floor() as i32).clamp(0, 9) } else { 0 };
        format!("{v:.*}", digits as usize)
    };
    format!("{} x {} x {}", one(extent.x), one(extent.y), one(extent.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn column_of_zeros_takes_no_memory_and_a_late_value_keeps_its_place() {
        let mut column = SparseColumn::default();
        column.append(3, 5, [0_u16; 3].into_iter());
        assert_eq!(column.values.capacity(), 0);
        column.append(2, 5, [0, 7].into_iter());
        let made = column.finish("a".into()).unwrap();
        assert_eq!(made.values, ExtraValues::U16(vec![0, 0, 0, 0, 7]));
        assert_eq!(SparseColumn::<u8>::default().finish("b".into()), None);
    }

    #[test]
    fn colours_that_count_to_255_are_told_from_dark_ones_even_if_bright_ones_come_last() {
        let mut narrow = WideColors::default();
        narrow.append(2, [[0, 128, 255], [1, 2, 3]].into_iter());
        let (colors, eight) = narrow.finish().unwrap();
        assert!(eight && colors[0] == [0.0, linear_of_8_bit()[128], 1.0]);
        let mut wide = WideColors::default();
        wide.append(3, [[0, 128, 255], [1, 2, 3]].into_iter());
        wide.append(3, [[256, 65_535, 4]].into_iter());
        let (colors, eight) = wide.finish().unwrap();
        let table = linear_of_16_bit();
        assert!(!eight && colors[0] == [0.0, table[128], table[255]] && colors[2] == [table[256], 1.0, table[4]]);
    }
}
