//! Strided columns of numbers in files, of any type and byte order. Columns are read block by block, in parallel, so
//! that only the converted values are ever in memory.

#![cfg_attr(not(all(feature = "npy", feature = "pcd")), allow(dead_code))]

use crate::bytes::Bytes;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use surfel_model::{Column3, ExtraValues};

/// Number types that files store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NumberType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

impl NumberType {
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 | Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// True if f32 represents every number of the type exactly.
    pub(crate) fn fits_f32(self) -> bool {
        self.bytes() <= 2 || self == Self::F32
    }

    pub(crate) fn is_integer(self) -> bool {
        !matches!(self, Self::F16 | Self::F32 | Self::F64)
    }
}

/// A column of numbers in a file or in memory, with one number every `stride` bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strided<'a> {
    /// Bytes from the first number to the end of the last.
    bytes: Bytes<'a>,
    stride: usize,
    rows: usize,
    kind: NumberType,
    big_endian: bool,
}

/// Position and type of a column in a file, without a reference to the open file.
#[cfg(feature = "laz")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    offset: usize,
    stride: usize,
    rows: usize,
    pub(crate) kind: NumberType,
    big_endian: bool,
}

#[cfg(feature = "laz")]
impl Place {
    /// Returns the column at this place in a file's bytes; `None` if it isn't inside them.
    pub(crate) fn of(self, bytes: Bytes<'_>) -> Option<Strided<'_>> {
        Strided::new(bytes, self.offset, self.stride, self.rows, self.kind, self.big_endian)
    }
}

/// Maximum number of bytes of a column that each thread has in memory at a time.
const BLOCK_BYTES: usize = 1 << 18;
/// Maximum number of rows that each thread has in memory at a time.
const BLOCK_ROWS: usize = 1 << 14;

/// A block of rows of K columns as `f64`, and the buffer of bytes from which the numbers are decoded.
struct Block<const K: usize> {
    bytes: Vec<u8>,
    numbers: [Vec<f64>; K],
}

/// Reads a range of rows of each column into the column's element of `numbers`, with `bytes` as buffer. Does nothing if
/// the range is empty or exceeds a column.
pub(crate) fn read_rows(columns: &[Strided<'_>], rows: Range<usize>, bytes: &mut Vec<u8>, numbers: &mut [Vec<f64>]) {
    let Some(parts) = columns.iter().map(|c| c.part(rows.clone())).collect::<Option<Vec<_>>>() else { return };
    if let Some((hull, starts)) = Bytes::hull(&parts) {
        let bytes = hull.read_into(bytes);
        let decoded = columns.iter().zip(starts).zip(numbers);
        decoded.for_each(|((column, start), numbers)| column.decode(&bytes[start..], rows.len(), numbers));
        return;
    }
    for ((column, part), numbers) in columns.iter().zip(parts).zip(numbers) {
        column.decode(part.read_into(bytes), rows.len(), numbers);
    }
}

impl<const K: usize> Block<K> {
    fn new() -> Self {
        Self { bytes: Vec::new(), numbers: [const { Vec::new() }; K] }
    }

    /// Reads a range of rows into this block.
    fn read(&mut self, columns: &[Strided<'_>; K], rows: Range<usize>) {
        read_rows(columns, rows, &mut self.bytes, &mut self.numbers);
    }

    fn row(&self, row: usize) -> [f64; K] {
        std::array::from_fn(|k| self.numbers[k][row])
    }
}

/// Returns the number of rows of these columns that each thread reads at a time.
pub(crate) fn block_rows(columns: &[Strided<'_>]) -> usize {
    let stride = columns.iter().map(|c| c.stride).max().unwrap_or(1);
    (BLOCK_BYTES / stride.max(1)).clamp(1, BLOCK_ROWS)
}

/// Applies a function to every row of columns of equal length, in parallel, and returns the results in order.
pub(crate) fn combined<const K: usize, R: Copy + Default + Send>(
    columns: [Strided<'_>; K],
    f: impl Fn([f64; K]) -> R + Sync,
) -> Vec<R> {
    let mut all = vec![R::default(); columns[0].rows];
    let rows = block_rows(&columns);
    all.par_chunks_mut(rows).enumerate().for_each_init(Block::new, |block, (i, out)| {
        block.read(&columns, i * rows..i * rows + out.len());
        out.iter_mut().enumerate().for_each(|(row, out)| *out = f(block.row(row)));
    });
    all
}

/// Folds the rows of each block of columns of equal length, in parallel, and then joins the blocks' results in order.
fn folded<const K: usize, R: Clone + Send + Sync>(
    columns: [Strided<'_>; K],
    none: R,
    fold: impl Fn(R, [f64; K]) -> R + Sync,
    join: impl Fn(R, R) -> R,
) -> R {
    let (count, rows) = (columns[0].rows, block_rows(&columns));
    let of_block = |block: &mut Block<K>, i: usize| {
        let range = i * rows..count.min((i + 1) * rows);
        block.read(&columns, range.clone());
        (0..range.len()).fold(none.clone(), |all, row| fold(all, block.row(row)))
    };
    let blocks: Vec<R> = (0..count.div_ceil(rows)).into_par_iter().map_init(Block::new, of_block).collect();
    blocks.into_iter().fold(none.clone(), join)
}

/// Returns the minimum and maximum finite number of each column; +∞ and −∞ if there is none.
pub(crate) fn ranges<const K: usize>(columns: [Strided<'_>; K]) -> [(f64, f64); K] {
    let wider = |(a, b): (f64, f64), (c, d): (f64, f64)| (a.min(c), b.max(d));
    let none = [(f64::INFINITY, f64::NEG_INFINITY); K];
    let join = |a: [(f64, f64); K], b: [(f64, f64); K]| std::array::from_fn(|k| wider(a[k], b[k]));
    let with = |all: [(f64, f64); K], row: [f64; K]| {
        std::array::from_fn(|k| if row[k].is_finite() { wider(all[k], (row[k], row[k])) } else { all[k] })
    };
    folded(columns, none, with, join)
}

/// Evaluates an expression for the number type of a column. In it, `$number` is the function that converts a number's
/// bytes to `f64`.
macro_rules! by_type {
    ($column:expr, $number:ident => $body:expr) => {
        match $column.kind {
            NumberType::I8 => by_type!(@ i8, $number, $body),
            NumberType::U8 => by_type!(@ u8, $number, $body),
            NumberType::I16 => by_type!(@ i16, $number, $body),
            NumberType::U16 => by_type!(@ u16, $number, $body),
            NumberType::I32 => by_type!(@ i32, $number, $body),
            NumberType::U32 => by_type!(@ u32, $number, $body),
            NumberType::I64 => by_type!(@ i64, $number, $body),
            NumberType::U64 => by_type!(@ u64, $number, $body),
            NumberType::F32 => by_type!(@ f32, $number, $body),
            NumberType::F64 => {
                let $number = f64::from_le_bytes;
                $body
            }
            NumberType::F16 => {
                let $number = |raw| f64::from(f32_of_half(u16::from_le_bytes(raw)));
                $body
            }
        }
    };
    (@ $t:ty, $number:ident, $body:expr) => {{
        let $number = |raw| <$t>::from_le_bytes(raw) as f64;
        $body
    }};
}

impl<'a> Strided<'a> {
    /// Creates a column that begins at `offset`; returns `None` if the column isn't inside `bytes`.
    pub(crate) fn new(
        bytes: Bytes<'a>,
        offset: usize,
        stride: usize,
        rows: usize,
        kind: NumberType,
        big_endian: bool,
    ) -> Option<Self> {
        let length = match rows {
            0 => 0,
            rows => stride.checked_mul(rows - 1)?.checked_add(kind.bytes())?,
        };
        let bytes = bytes.part(offset..offset.checked_add(length)?)?;
        (stride >= kind.bytes()).then_some(Self { bytes, stride, rows, kind, big_endian })
    }

    pub(crate) fn len(&self) -> usize {
        self.rows
    }

    /// Returns the column's place in its file; `None` for a column in memory.
    #[cfg(feature = "laz")]
    pub(crate) fn place(&self) -> Option<Place> {
        let Bytes::File { start, .. } = self.bytes else { return None };
        let Self { stride, rows, kind, big_endian, .. } = *self;
        Some(Place { offset: start, stride, rows, kind, big_endian })
    }

    pub(crate) fn kind(&self) -> NumberType {
        self.kind
    }

    /// Returns the same column with the number type `kind` instead of its own; `None` if their sizes differ.
    pub(crate) fn reinterpreted(self, kind: NumberType) -> Option<Self> {
        (kind.bytes() == self.kind.bytes()).then_some(Self { kind, ..self })
    }

    /// Returns the bytes of a range of rows; `None` if it is empty or exceeds the column.
    fn part(&self, rows: Range<usize>) -> Option<Bytes<'a>> {
        let last = rows.end.checked_sub(1).filter(|last| rows.start <= *last)?;
        self.bytes.part(rows.start * self.stride..last * self.stride + self.kind.bytes())
    }

    /// Decodes the numbers of `rows` rows from their bytes.
    fn decode(&self, bytes: &[u8], rows: usize, numbers: &mut Vec<f64>) {
        numbers.clear();
        by_type!(self, number => {
            let of_row = |row: &[u8]| {
                let mut raw = row.first_chunk().copied().unwrap_or_default();
                if self.big_endian {
                    raw.reverse();
                }
                number(raw)
            };
            numbers.extend(bytes.chunks(self.stride).take(rows).map(of_row));
        });
        numbers.resize(rows, 0.0);
    }

    /// Returns the number in a row; 0 beyond the last row.
    pub(crate) fn at(&self, row: usize) -> f64 {
        let mut block = Block::new();
        if row < self.rows {
            block.read(&[*self], row..row + 1);
        }
        block.numbers[0].first().copied().unwrap_or(0.0)
    }

    /// Applies a function to every number of the column, in parallel, and returns the results in order.
    pub(crate) fn map<R: Copy + Default + Send>(&self, f: impl Fn(f64) -> R + Sync) -> Vec<R> {
        combined([*self], |[v]| f(v))
    }

    /// Returns the column's largest finite number, but at least 0.
    pub(crate) fn largest(&self) -> f64 {
        let [(_, largest)] = ranges([*self]);
        largest.max(0.0)
    }

    /// Reads the column into memory in its own number type. Types that the data model lacks become `f64`, half floats
    /// `f32`.
    pub(crate) fn values(&self) -> ExtraValues {
        match self.kind {
            NumberType::I8 => ExtraValues::I8(self.map(|v| v as i8)),
            NumberType::U8 => ExtraValues::U8(self.map(|v| v as u8)),
            NumberType::I16 => ExtraValues::I16(self.map(|v| v as i16)),
            NumberType::U16 => ExtraValues::U16(self.map(|v| v as u16)),
            NumberType::I32 => ExtraValues::I32(self.map(|v| v as i32)),
            NumberType::U32 => ExtraValues::U32(self.map(|v| v as u32)),
            NumberType::F16 | NumberType::F32 => ExtraValues::F32(self.map(|v| v as f32)),
            NumberType::I64 | NumberType::U64 | NumberType::F64 => ExtraValues::F64(self.map(|v| v)),
        }
    }
}

/// Combines three columns of equal length to vectors. Returns an origin, and vectors relative to it, as
/// [`Column3::with_origin`] does.
pub(crate) fn with_origin(columns: [Strided<'_>; 3]) -> (DVec3, Column3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY, true);
    let with = |(min, max, exact): (DVec3, DVec3, bool), p: [f64; 3]| {
        let p = DVec3::from(p);
        let exact = exact && split(p).1 == Vec3::ZERO;
        if p.is_finite() { (min.min(p), max.max(p), exact) } else { (min, max, exact) }
    };
    let (min, max, exact) = folded(columns, none, with, |(a, b, e), (c, d, f)| (a.min(c), b.max(d), e && f));
    if exact {
        return (DVec3::ZERO, Column3::from_f32(vectors_f32(columns)));
    }
    let origin = Column3::origin_of(min, max);
    (origin, of_f64(columns, origin))
}

/// Splits a vector into its value rounded to f32 and the remainder.
fn split(p: DVec3) -> (Vec3, Vec3) {
    let high = p.as_vec3();
    (high, if high.is_finite() { (p - high.as_dvec3()).as_vec3() } else { Vec3::ZERO })
}

/// Combines three columns of equal length to vectors relative to `origin`. The rounding errors of f32 are stored, too.
pub(crate) fn of_f64(columns: [Strided<'_>; 3], origin: DVec3) -> Column3 {
    let (mut high, mut low) = (vec![[0.0; 3]; columns[0].rows], vec![[0.0; 3]; columns[0].rows]);
    let rows = block_rows(&columns);
    let blocks = high.par_chunks_mut(rows).zip(low.par_chunks_mut(rows)).enumerate();
    blocks.for_each_init(Block::new, |block, (i, (high, low))| {
        block.read(&columns, i * rows..i * rows + high.len());
        for (row, (high, low)) in high.iter_mut().zip(low).enumerate() {
            let (h, l) = split(DVec3::from(block.row(row)) - origin);
            (*high, *low) = (h.to_array(), l.to_array());
        }
    });
    let [high, low] = [high, low].map(vectors);
    let exact = low.iter().all(|l| *l == Vec3::ZERO);
    Column3::from_parts(high, (!exact).then_some(low))
}

/// Combines three columns of equal length to vectors, rounded to f32.
pub(crate) fn vectors_f32(columns: [Strided<'_>; 3]) -> Vec<Vec3> {
    vectors(combined(columns, |row| row.map(|v| v as f32)))
}

/// Converts arrays to vectors. Both have the same layout, so that the memory is reused.
fn vectors(arrays: Vec<[f32; 3]>) -> Vec<Vec3> {
    arrays.into_iter().map(Vec3::from_array).collect()
}

/// Converts an IEEE 754 half-precision number, given by its bits, to f32.
pub(crate) fn f32_of_half(half: u16) -> f32 {
    let magnitude = u32::from(half & 0x7fff);
    let value = match magnitude >> 10 {
        // Subnormals are multiples of 2⁻²⁴.
        0 => magnitude as f32 * f32::from_bits((127 - 24) << 23),
        31 => f32::from_bits(0x7f80_0000 | (magnitude & 0x3ff) << 13),
        _ => f32::from_bits((magnitude << 13) + ((127 - 15) << 23)),
    };
    if half >> 15 == 1 { -value } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_lie_within_their_bytes() {
        let bytes: Vec<u8> = (0..24).collect();
        let column =
            |offset, stride, rows| Strided::new(Bytes::Memory(&bytes), offset, stride, rows, NumberType::U16, false);
        assert!(column(0, 12, 2).is_some() && column(10, 12, 2).is_some() && column(11, 12, 2).is_none());
        assert!(column(0, 2, 12).is_some() && column(0, 2, 13).is_none() && column(0, 1, 3).is_none());
        assert!(column(24, 2, 0).is_some() && column(25, 2, 0).is_none());
        assert!(column(0, usize::MAX, 3).is_none() && column(usize::MAX, 2, 1).is_none());
        assert_eq!(column(10, 12, 2).unwrap().map(|v| v), [f64::from(0x0b0a), f64::from(0x1716)]);
    }

    #[test]
    fn numbers_of_every_type_and_byte_order_are_read() {
        let mut little = Vec::new();
        macro_rules! push {
            ($($v:expr),*) => { $(little.extend($v.to_le_bytes());)* };
        }
        push!(-3_i8, 200_u8, -300_i16, 60_000_u16, -70_000_i32, 4_000_000_000_u32, -5_000_000_000_i64);
        push!(6_000_000_000_u64, 0xc500_u16, 1.5_f32, -2.5_f64);
        use NumberType::*;
        let kinds = [I8, U8, I16, U16, I32, U32, I64, U64, F16, F32, F64];
        let expected = [-3.0, 200.0, -300.0, 60_000.0, -7e4, 4e9, -5e9, 6e9, -5.0, 1.5, -2.5];
        let mut offset = 0;
        for (kind, expected) in kinds.into_iter().zip(expected) {
            let n = kind.bytes();
            let mut big = little[offset..offset + n].to_vec();
            big.reverse();
            let column = |bytes, at, big| Strided::new(Bytes::Memory(bytes), at, n, 1, kind, big);
            let columns = [column(&little, offset, false), column(&big, 0, true)];
            for column in columns.map(Option::unwrap) {
                assert_eq!((column.at(0), column.map(|v| v)), (expected, vec![expected]), "{kind:?}");
                assert_eq!(crate::columns::to_f64(&column.values()), [expected], "{kind:?}");
                let (origin, all) = with_origin([column; 3]);
                assert_eq!(origin + all.get(0), DVec3::splat(expected));
                assert_eq!(vectors_f32([column; 3]), [DVec3::splat(expected).as_vec3()]);
                assert_eq!(column.largest(), expected.max(0.0));
            }
            offset += n;
        }
    }
}
