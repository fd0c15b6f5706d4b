//! Columns of vectors: f32 values relative to an f64 origin, with a residual only if f32 loses precision.

use glam::{DVec3, Vec3};

/// Column of 3-vectors in f32, with the rounding errors of f32 as an optional second column.
///
/// `value = high + low`. Fast backends read [`Column3::high`]; the f64 reference reads [`Column3::get`]. A column read
/// from f32 data has no low part, and needs 12 bytes per element.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Column3 {
    high: Vec<Vec3>,
    low: Option<Vec<Vec3>>,
}

impl Column3 {
    /// Creates a column of f32 values, stored exactly.
    pub fn from_f32(high: Vec<Vec3>) -> Self {
        Self { high, low: None }
    }

    /// Creates a column from f32 values and their rounding errors, if any. A low part of another length is dropped.
    pub fn from_parts(high: Vec<Vec3>, low: Option<Vec<Vec3>>) -> Self {
        Self { low: low.filter(|low| low.len() == high.len()), high }
    }

    /// Creates a column of f64 values, stored to about 48 bits. The low part is dropped if it is zero everywhere.
    pub fn from_f64(values: &[DVec3]) -> Self {
        let high: Vec<Vec3> = values.iter().map(|v| v.as_vec3()).collect();
        let low: Vec<Vec3> = values
            .iter()
            .zip(&high)
            .map(|(v, h)| if h.is_finite() { (*v - h.as_dvec3()).as_vec3() } else { Vec3::ZERO })
            .collect();
        let exact = low.iter().all(|l| *l == Vec3::ZERO);
        Self { high, low: (!exact).then_some(low) }
    }

    /// Splits points into an f64 origin and offsets from it, to preserve the precision of georeferenced data.
    ///
    /// The origin is zero for points that f32 represents exactly. Otherwise it is the origin that [`Self::origin_of`]
    /// returns for the bounds of the finite points: about their centre, or zero if the bounds are close to zero.
    /// Offsets are exact to about 48 bits of the extent. Non-finite points stay non-finite.
    pub fn with_origin(points: &[DVec3]) -> (DVec3, Self) {
        Self::with_origin_of(points.len(), |i| points[i])
    }

    /// Splits points like [`Self::with_origin`], for points that needn't be in memory. `point(i)` returns point `i` and
    /// is called twice for each.
    pub fn with_origin_of(count: usize, point: impl Fn(usize) -> DVec3) -> (DVec3, Self) {
        let split = |p: DVec3| {
            let high = p.as_vec3();
            (high, if high.is_finite() { (p - high.as_dvec3()).as_vec3() } else { Vec3::ZERO })
        };
        let (mut min, mut max, mut exact) = (DVec3::INFINITY, DVec3::NEG_INFINITY, true);
        for p in (0..count).map(&point) {
            exact &= split(p).1 == Vec3::ZERO;
            if p.is_finite() {
                (min, max) = (min.min(p), max.max(p));
            }
        }
        if exact {
            return (DVec3::ZERO, Self::from_f32((0..count).map(|i| point(i).as_vec3()).collect()));
        }
        let origin = Self::origin_of(min, max);
        let (mut high, mut low) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for (h, l) in (0..count).map(|i| split(point(i) - origin)) {
            high.push(h);
            low.push(l);
        }
        let exact = low.iter().all(|l| *l == Vec3::ZERO);
        (origin, Self { high, low: (!exact).then_some(low) })
    }

    /// Returns a suitable origin for points within bounds, in the units of the bounds. The origin is the centre,
    /// rounded to multiples of a power of two. The power is the next one above the longest side, or above 1e-6 of the
    /// largest coordinate if that is more. The origin is zero if no coordinate exceeds four times the longest side, or
    /// if the bounds are empty.
    pub fn origin_of(min: DVec3, max: DVec3) -> DVec3 {
        let extent = (max - min).max_element();
        // Near zero, f32 is precise enough without an origin.
        let largest = min.abs().max(max.abs()).max_element();
        if min.x > max.x || largest <= 4.0 * extent {
            return DVec3::ZERO;
        }
        // All points may be equal; an origin of about 20 bits is fine enough.
        let grid = extent.max(largest * 1e-6).max(f64::MIN_POSITIVE).log2().ceil().exp2();
        ((min + max) * (0.5 / grid)).round() * grid
    }

    /// Returns the number of elements.
    pub fn len(&self) -> usize {
        self.high.len()
    }

    /// True if there are no elements.
    pub fn is_empty(&self) -> bool {
        self.high.is_empty()
    }

    /// Returns the element at `index` with all stored precision.
    #[inline]
    pub fn get(&self, index: usize) -> DVec3 {
        let high = self.high[index].as_dvec3();
        match &self.low {
            Some(low) => high + low[index].as_dvec3(),
            None => high,
        }
    }

    /// Returns the f32 part: the values rounded to nearest.
    pub fn high(&self) -> &[Vec3] {
        &self.high
    }

    /// Returns the rounding errors of the f32 part, if any are stored.
    pub fn low(&self) -> Option<&[Vec3]> {
        self.low.as_deref()
    }

    /// Drops the rounding errors; values then have the precision of f32.
    pub fn discard_low(&mut self) {
        self.low = None;
    }

    /// Returns the heap memory in use, in bytes.
    pub fn bytes(&self) -> usize {
        (self.high.len() + self.low.as_ref().map_or(0, Vec::len)) * size_of::<Vec3>()
    }

    /// Drops the elements whose flag is false.
    pub fn retain(&mut self, keep: &[bool]) {
        retain(&mut self.high, keep);
        if let Some(low) = &mut self.low {
            retain(low, keep);
        }
    }

    /// Returns the elements at `indices`, in that order.
    pub fn select(&self, indices: &[u32]) -> Self {
        let pick = |v: &[Vec3]| indices.iter().map(|&i| v[i as usize]).collect();
        Self { high: pick(&self.high), low: self.low.as_deref().map(pick) }
    }
}

/// Drops the elements of `values` whose flag is false. Elements without a flag remain.
pub(crate) fn retain<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut flags = keep.iter();
    values.retain(|_| *flags.next().unwrap_or(&true));
}

/// Drops the rows of elements whose flag in `keep` is false. If there are no rows yet, each element's row is its index.
pub(crate) fn retain_rows(rows: &mut Option<Vec<u32>>, keep: &[bool]) {
    match rows {
        Some(rows) => retain(rows, keep),
        None => *rows = Some((0..).zip(keep).filter(|(_, keep)| **keep).map(|(row, _)| row).collect()),
    }
}

/// A column of a file that Surfel doesn't interpret. It is stored so that a round trip loses nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct ExtraColumn {
    /// Name of the column in its file.
    pub name: String,
    /// Values, one per element.
    pub values: ExtraValues,
}

impl ExtraColumn {
    /// Returns the column with this name; `None` if there is none. If there is no exact match, case, the prefix
    /// `scalar_` and all characters except letters and digits are ignored. Thus, `scalar_Return_Number`, `ReturnNumber`
    /// and `return_number` are the same attribute.
    pub fn find<'a>(extras: &'a [Self], name: &str) -> Option<&'a Self> {
        let plain = |name: &str| {
            let lower = name.to_ascii_lowercase();
            let lower = lower.strip_prefix("scalar_").unwrap_or(&lower);
            lower.chars().filter(|c| c.is_alphanumeric()).collect::<String>()
        };
        let wanted = plain(name);
        let exact = extras.iter().find(|e| e.name == name);
        exact.or_else(|| extras.iter().find(|e| !wanted.is_empty() && plain(&e.name) == wanted))
    }
}

/// Values of an [`ExtraColumn`], in the file's own type.
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "the variants are the PLY scalar types")]
pub enum ExtraValues {
    I8(Vec<i8>),
    U8(Vec<u8>),
    I16(Vec<i16>),
    U16(Vec<u16>),
    I32(Vec<i32>),
    U32(Vec<u32>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

macro_rules! each_extra {
    ($self:expr, $values:ident => $body:expr) => {
        match $self {
            ExtraValues::I8($values) => $body,
            ExtraValues::U8($values) => $body,
            ExtraValues::I16($values) => $body,
            ExtraValues::U16($values) => $body,
            ExtraValues::I32($values) => $body,
            ExtraValues::U32($values) => $body,
            ExtraValues::F32($values) => $body,
            ExtraValues::F64($values) => $body,
        }
    };
}

impl ExtraValues {
    /// Returns the number of values.
    pub fn len(&self) -> usize {
        each_extra!(self, v => v.len())
    }

    /// Returns the size of a value, in bytes.
    pub fn value_bytes(&self) -> usize {
        fn bytes<T>(_: &[T]) -> usize {
            size_of::<T>()
        }
        each_extra!(self, v => bytes(v))
    }

    /// True if there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the heap memory in use, in bytes.
    pub fn bytes(&self) -> usize {
        each_extra!(self, v => size_of_val(v.as_slice()))
    }

    /// Returns the value at `index`; f64 represents every type exactly.
    #[allow(clippy::useless_conversion, reason = "one of the eight types is f64")]
    pub fn get(&self, index: usize) -> f64 {
        each_extra!(self, v => f64::from(v[index]))
    }

    /// Returns the smallest and the largest finite value; `None` if there is none.
    #[allow(clippy::useless_conversion, reason = "one of the eight types is f64")]
    pub fn range(&self) -> Option<(f64, f64)> {
        let finite = |values: &mut dyn Iterator<Item = f64>| {
            values.filter(|v| v.is_finite()).fold(None, |range: Option<(f64, f64)>, v| {
                Some(range.map_or((v, v), |(lo, hi)| (lo.min(v), hi.max(v))))
            })
        };
        each_extra!(self, v => finite(&mut v.iter().map(|x| f64::from(*x))))
    }

    /// Returns the PLY name of the type: "uchar", "float", …
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::I8(_) => "char",
            Self::U8(_) => "uchar",
            Self::I16(_) => "short",
            Self::U16(_) => "ushort",
            Self::I32(_) => "int",
            Self::U32(_) => "uint",
            Self::F32(_) => "float",
            Self::F64(_) => "double",
        }
    }

    /// True for integer types.
    pub fn is_integer(&self) -> bool {
        !matches!(self, Self::F32(_) | Self::F64(_))
    }

    /// Truncates the column to `len` values, or appends zeros up to that number.
    pub fn resize(&mut self, len: usize) {
        each_extra!(self, v => v.resize(len, Default::default()));
    }

    /// Returns the values at `indices`, in that order.
    #[must_use]
    pub fn select(&self, indices: &[u32]) -> Self {
        macro_rules! selected {
            ($($kind:ident),*) => {
                match self {
                    $(Self::$kind(values) => Self::$kind(indices.iter().map(|i| values[*i as usize]).collect()),)*
                }
            };
        }
        selected!(I8, U8, I16, U16, I32, U32, F32, F64)
    }

    /// Drops the values whose flag is false.
    pub fn retain(&mut self, keep: &[bool]) {
        each_extra!(self, v => retain(v, keep));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn georeferenced_points_keep_sub_millimetre_detail_in_f32() {
        let points: Vec<DVec3> = (0..1000)
            .map(|i| {
                DVec3::new(
                    4.5e6 + f64::from(i) * 1.234_567e-3,
                    -7.1e6 + f64::from(i) * 3e-4,
                    312.0 + f64::from(i) * 1e-4,
                )
            })
            .collect();
        let (origin, column) = Column3::with_origin(&points);
        for (i, p) in points.iter().enumerate() {
            let fast = origin + column.high()[i].as_dvec3();
            assert!((fast - *p).abs().max_element() < 1e-4, "{i}: {fast} {p}");
            assert!((origin + column.get(i) - *p).abs().max_element() < 1e-9);
        }
    }

    #[test]
    fn range_is_of_the_finite_values() {
        assert_eq!(ExtraValues::F32(vec![f32::NAN, 2.0, -1.5, f32::INFINITY]).range(), Some((-1.5, 2.0)));
        assert_eq!(ExtraValues::F64(vec![f64::NAN]).range(), None);
        let values = ExtraValues::U32(vec![7, u32::MAX]);
        assert_eq!((values.range(), values.get(1)), (Some((7.0, 4_294_967_295.0)), 4_294_967_295.0));
    }

    #[test]
    fn attributes_are_found_by_the_names_that_programs_give_them() {
        let named = |name: &str| ExtraColumn { name: name.into(), values: ExtraValues::U8(vec![]) };
        let extras = ["scalar_Return_Number", "Intensity", "intensity", "Original_cloud_index"].map(named);
        let find = |name: &str| ExtraColumn::find(&extras, name).map(|e| e.name.as_str());
        assert_eq!(find("return_number"), Some("scalar_Return_Number"));
        assert_eq!(find("ReturnNumber"), Some("scalar_Return_Number"));
        assert_eq!((find("intensity"), find("INTENSITY")), (Some("intensity"), Some("Intensity")));
        assert_eq!((find("classification"), find(""), find("_")), (None, None, None));
        let values = [ExtraValues::I8(vec![-3]), ExtraValues::U16(vec![65_535]), ExtraValues::F32(vec![0.5])];
        assert_eq!(values.map(|v| (v.get(0), v.is_integer())), [(-3.0, true), (65_535.0, true), (0.5, false)]);
    }

    #[test]
    fn f32_data_has_no_low_part_and_no_origin() {
        let points: Vec<DVec3> = (0..10).map(|i| DVec3::splat(f64::from(0.1_f32 * i as f32))).collect();
        let (origin, column) = Column3::with_origin(&points);
        assert_eq!(origin, DVec3::ZERO);
        assert!(column.low().is_none());
        assert_eq!(column.bytes(), 120);
    }

    #[test]
    fn origin_of_points_in_one_place_is_near_them() {
        for p in [DVec3::new(-36.5, -0.1, 0.0), DVec3::splat(1e-30), DVec3::new(1e15 + 0.125, 0.1, -3e14)] {
            for points in [vec![p], vec![p; 3]] {
                let (origin, column) = Column3::with_origin(&points);
                assert!(
                    (origin + column.get(0)).abs_diff_eq(p, p.abs().max_element() * 2f64.powi(-48)),
                    "{p} {origin}"
                );
            }
        }
    }

    #[test]
    fn non_finite_points_stay_non_finite() {
        let (_, column) = Column3::with_origin(&[DVec3::new(1e6 + 0.1, 0.0, 0.0), DVec3::NAN, DVec3::splat(1e300)]);
        assert!(!column.get(1).is_finite());
        assert!(!column.get(2).is_finite());
    }
}
