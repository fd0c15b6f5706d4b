//! Columns of numbers in memory as files lay them out: of any type and byte order, at any distance from each other.

#![cfg_attr(not(all(feature = "npy", feature = "pcd")), allow(dead_code))]

use crate::columns::f32_of_half;
use glam::{DVec3, Vec3};
use surfel_model::{Column3, ExtraValues};

/// The types of number that files store.
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

    pub(crate) fn is_integer(self) -> bool {
        !matches!(self, Self::F16 | Self::F32 | Self::F64)
    }
}

/// A column: a number each `stride` bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strided<'a> {
    /// From the first number to the end of the last.
    bytes: &'a [u8],
    stride: usize,
    rows: usize,
    kind: NumberType,
    big_endian: bool,
}

/// Evaluates an expression with `$number` the function that makes an `f64` of the bytes of a number of the column's
/// type.
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
    /// The column that begins at `offset`; `None` if it doesn't lie within `bytes`.
    pub(crate) fn new(
        bytes: &'a [u8],
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
        let bytes = bytes.get(offset..offset.checked_add(length)?)?;
        (stride >= kind.bytes()).then_some(Self { bytes, stride, rows, kind, big_endian })
    }

    pub(crate) fn len(&self) -> usize {
        self.rows
    }

    pub(crate) fn kind(&self) -> NumberType {
        self.kind
    }

    /// The same bytes taken as another type of the same size.
    pub(crate) fn reinterpreted(self, kind: NumberType) -> Option<Self> {
        (kind.bytes() == self.kind.bytes()).then_some(Self { kind, ..self })
    }

    /// The bytes of each number, little endian.
    #[inline]
    fn raw<const N: usize>(&self) -> impl Iterator<Item = [u8; N]> {
        let big_endian = self.big_endian;
        self.bytes.chunks(self.stride).map(move |row| {
            let mut raw = row.first_chunk::<N>().copied().unwrap_or([0; N]);
            if big_endian {
                raw.reverse();
            }
            raw
        })
    }

    /// A number; 0 beyond the last.
    #[inline]
    pub(crate) fn at(&self, row: usize) -> f64 {
        by_type!(self, number => number(self.raw_at(row)))
    }

    /// The bytes of a number, little endian; zeros beyond the last.
    #[inline]
    fn raw_at<const N: usize>(&self, row: usize) -> [u8; N] {
        let mut raw = self.bytes.get(row * self.stride..).and_then(<[u8]>::first_chunk).copied().unwrap_or([0; N]);
        if self.big_endian {
            raw.reverse();
        }
        raw
    }

    /// Three columns of bytes, row by row.
    pub(crate) fn bytes_of([a, b, c]: [Self; 3]) -> impl Iterator<Item = [u8; 3]> {
        let rows = |c: Self| c.bytes.chunks(c.stride).map(|row| row.first().copied().unwrap_or(0));
        rows(a).zip(rows(b)).zip(rows(c)).map(|((a, b), c)| [a, b, c])
    }

    /// A function of every number.
    pub(crate) fn map<R>(&self, f: impl Fn(f64) -> R) -> Vec<R> {
        let mut all = Vec::with_capacity(self.rows);
        by_type!(self, number => all.extend(self.raw().map(|raw| f(number(raw)))));
        all
    }

    /// The least and the largest finite number; infinities where there is none.
    pub(crate) fn range(&self) -> (f64, f64) {
        let wider = |(a, b): (f64, f64), v: f64| if v.is_finite() { (a.min(v), b.max(v)) } else { (a, b) };
        let none = (f64::INFINITY, f64::NEG_INFINITY);
        by_type!(self, number => self.raw().map(number).fold(none, wider))
    }

    /// The largest finite number, at least 0.
    pub(crate) fn largest(&self) -> f64 {
        self.range().1.max(0.0)
    }

    /// The numbers in their own type; those that the model doesn't have become `f64`, halves `f32`.
    pub(crate) fn values(&self) -> ExtraValues {
        macro_rules! collect {
            ($t:ty) => {
                self.raw().map(<$t>::from_le_bytes).collect()
            };
        }
        match self.kind {
            NumberType::I8 => ExtraValues::I8(collect!(i8)),
            NumberType::U8 => ExtraValues::U8(collect!(u8)),
            NumberType::I16 => ExtraValues::I16(collect!(i16)),
            NumberType::U16 => ExtraValues::U16(collect!(u16)),
            NumberType::I32 => ExtraValues::I32(collect!(i32)),
            NumberType::U32 => ExtraValues::U32(collect!(u32)),
            NumberType::F32 => ExtraValues::F32(collect!(f32)),
            NumberType::F16 => ExtraValues::F32(self.map(|v| v as f32)),
            NumberType::I64 | NumberType::U64 | NumberType::F64 => ExtraValues::F64(self.map(|v| v)),
        }
    }
}

/// Three columns of the same length as vectors, with their origin.
pub(crate) fn with_origin(columns: [Strided<'_>; 3]) -> (DVec3, Column3) {
    let [x, y, z] = columns;
    if columns.iter().all(|c| c.kind == NumberType::F64) {
        let number = |c: &Strided<'_>, i: usize| f64::from_le_bytes(c.raw_at(i));
        Column3::with_origin_of(x.rows, |i| DVec3::new(number(&x, i), number(&y, i), number(&z, i)))
    } else {
        Column3::with_origin_of(x.rows, |i| DVec3::new(x.at(i), y.at(i), z.at(i)))
    }
}

/// Three columns of the same length as vectors of f32. Numbers of more digits are rounded.
pub(crate) fn vectors_f32(columns: [Strided<'_>; 3]) -> Vec<Vec3> {
    let [x, y, z] = columns;
    let mut all = Vec::with_capacity(x.rows);
    if columns.iter().all(|c| c.kind == NumberType::F32) {
        let number = |raw: [u8; 4]| f32::from_le_bytes(raw);
        let rows = x.raw().zip(y.raw()).zip(z.raw());
        all.extend(rows.map(|((x, y), z)| Vec3::new(number(x), number(y), number(z))));
    } else if columns.iter().all(|c| c.kind == NumberType::F64) {
        let number = |raw: [u8; 8]| f64::from_le_bytes(raw) as f32;
        let rows = x.raw().zip(y.raw()).zip(z.raw());
        all.extend(rows.map(|((x, y), z)| Vec3::new(number(x), number(y), number(z))));
    } else {
        all.extend((0..x.rows).map(|i| DVec3::new(x.at(i), y.at(i), z.at(i)).as_vec3()));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_lie_within_their_bytes() {
        let bytes: Vec<u8> = (0..24).collect();
        let column = |offset, stride, rows| Strided::new(&bytes, offset, stride, rows, NumberType::U16, false);
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
            let columns = [Strided::new(&little, offset, n, 1, kind, false), Strided::new(&big, 0, n, 1, kind, true)];
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
