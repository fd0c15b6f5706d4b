//! Conversion of scalar columns of any type to the model's columns of positions, vectors and colours.

use crate::strided::{self, NumberType, Strided, vectors_f32};
use glam::{DVec3, Vec3};
use surfel_model::{Column3, ExtraValues};

/// A column of numbers, in memory or stored in a file.
#[derive(Debug)]
pub(crate) enum Numbers<'a> {
    InMemory(ExtraValues),
    Stored(Strided<'a>),
}

impl Numbers<'_> {
    /// Returns the column's number type. For a stored column, it is the type in the file.
    pub(crate) fn kind(&self) -> NumberType {
        match self {
            Self::InMemory(values) => number_type(values),
            Self::Stored(column) => column.kind(),
        }
    }
}

/// Returns the number type of a column in memory.
pub(crate) fn number_type(values: &ExtraValues) -> NumberType {
    match values {
        ExtraValues::I8(_) => NumberType::I8,
        ExtraValues::U8(_) => NumberType::U8,
        ExtraValues::I16(_) => NumberType::I16,
        ExtraValues::U16(_) => NumberType::U16,
        ExtraValues::I32(_) => NumberType::I32,
        ExtraValues::U32(_) => NumberType::U32,
        ExtraValues::F32(_) => NumberType::F32,
        ExtraValues::F64(_) => NumberType::F64,
    }
}

impl From<Numbers<'_>> for ExtraValues {
    fn from(numbers: Numbers<'_>) -> Self {
        match numbers {
            Numbers::InMemory(values) => values,
            Numbers::Stored(column) => column.values(),
        }
    }
}

/// Returns the columns unread if all three are stored in a file. Otherwise reads all of them into memory, and returns
/// them as the error value.
fn stored(values: [Numbers<'_>; 3]) -> Result<[Strided<'_>; 3], [ExtraValues; 3]> {
    match values {
        [Numbers::Stored(a), Numbers::Stored(b), Numbers::Stored(c)] => Ok([a, b, c]),
        other => Err(other.map(ExtraValues::from)),
    }
}

/// Converts a column to f64, which is exact for all number types.
pub(crate) fn to_f64(values: &ExtraValues) -> Vec<f64> {
    match values {
        ExtraValues::I8(v) => v.iter().map(|&x| x.into()).collect(),
        ExtraValues::U8(v) => v.iter().map(|&x| x.into()).collect(),
        ExtraValues::I16(v) => v.iter().map(|&x| x.into()).collect(),
        ExtraValues::U16(v) => v.iter().map(|&x| x.into()).collect(),
        ExtraValues::I32(v) => v.iter().map(|&x| x.into()).collect(),
        ExtraValues::U32(v) => v.iter().map(|&x| x.into()).collect(),
        ExtraValues::F32(v) => v.iter().map(|&x| x.into()).collect(),
        ExtraValues::F64(v) => v.clone(),
    }
}

/// Converts a column to f32; numbers that f32 can't represent are rounded to nearest.
pub(crate) fn to_f32(values: impl Into<ExtraValues>) -> Vec<f32> {
    match values.into() {
        ExtraValues::F32(v) => v,
        other => to_f64(&other).into_iter().map(|x| x as f32).collect(),
    }
}

/// True if f32 represents every value of the column's number type exactly.
fn fits_f32(values: &ExtraValues) -> bool {
    !matches!(values, ExtraValues::I32(_) | ExtraValues::U32(_) | ExtraValues::F64(_))
}

fn zip3<A: Copy, T>(a: &[A], b: &[A], c: &[A], f: impl Fn(A, A, A) -> T) -> Vec<T> {
    a.iter().zip(b).zip(c).map(|((&a, &b), &c)| f(a, b, c)).collect()
}

fn exact_f32(values: [ExtraValues; 3]) -> Result<Vec<Vec3>, Vec<DVec3>> {
    if values.iter().all(fits_f32) {
        let [x, y, z] = values.map(to_f32);
        return Ok(zip3(&x, &y, &z, Vec3::new));
    }
    let [x, y, z] = values.map(|v| to_f64(&v));
    Err(zip3(&x, &y, &z, DVec3::new))
}

/// Combines columns of x, y and z to a column of vectors; f64 sources keep their precision.
pub(crate) fn vectors(values: [Numbers<'_>; 3]) -> Column3 {
    match stored(values).map_err(exact_f32) {
        Ok(columns) if columns.iter().all(|c| c.kind().fits_f32()) => Column3::from_f32(vectors_f32(columns)),
        Ok(columns) => strided::of_f64(columns, DVec3::ZERO),
        Err(Ok(v)) => Column3::from_f32(v),
        Err(Err(v)) => Column3::from_f64(&v),
    }
}

/// Combines columns of x, y and z to positions. Returns an origin, and the positions relative to it. The origin is 0 if
/// f32 represents all values of the columns' number types exactly.
pub(crate) fn positions(values: [Numbers<'_>; 3]) -> (DVec3, Column3) {
    match stored(values).map_err(exact_f32) {
        Ok(columns) if columns.iter().all(|c| c.kind().fits_f32()) => {
            (DVec3::ZERO, Column3::from_f32(vectors_f32(columns)))
        }
        Ok(columns) => strided::with_origin(columns),
        Err(Ok(v)) => (DVec3::ZERO, Column3::from_f32(v)),
        Err(Err(v)) => Column3::with_origin(&v),
    }
}

/// Converts positions that were printed as text or computed by a transformation. Returns an origin, and the positions
/// relative to it. Digits beyond f32 are stored only if [`f32_is_enough`] is false; otherwise they are only noise.
#[cfg(any(feature = "gltf", feature = "obj", feature = "off"))]
pub(crate) fn measured_positions(points: &[DVec3]) -> (DVec3, Column3) {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in points.iter().filter(|p| p.is_finite()) {
        (min, max) = (min.min(*p), max.max(*p));
    }
    if f32_is_enough(min, max) {
        return (DVec3::ZERO, Column3::from_f32(points.iter().map(|p| p.as_vec3()).collect()));
    }
    Column3::with_origin(points)
}

/// Largest rounding step of coordinates for which users get no note, as a fraction of the longest side of the points'
/// bounds.
const MAX_ROUNDING_FRACTION: f64 = 1.0 / 50_000.0;

/// Returns a note for the user if 32-bit coordinates between `min` and `max` are so far from the origin that rounding
/// is noticeable; else `None`.
pub(crate) fn rounding_note(min: DVec3, max: DVec3) -> Option<String> {
    rounding_note_of_step(f32_step(min.abs().max(max.abs()).max_element()), min, max)
}

/// Returns the rounding step of 32-bit floats near a value: the distance to the next smaller float. It is 0 for values
/// that aren't positive and finite.
pub(crate) fn f32_step(largest: f64) -> f64 {
    let largest = largest as f32;
    if largest > 0.0 && largest.is_finite() { f64::from(largest) - f64::from(largest.next_down()) } else { 0.0 }
}

/// Returns a note for the user if the rounding step `step` of coordinates between `min` and `max` is more than 1/50,000
/// of the longest side of these bounds; else `None`.
pub(crate) fn rounding_note_of_step(step: f64, min: DVec3, max: DVec3) -> Option<String> {
    let extent = (max - min).max_element();
    (extent > 0.0 && step > extent * MAX_ROUNDING_FRACTION).then(|| {
        format!("its coordinates are 32-bit floats far from the origin: they are rounded to steps of {step} there")
    })
}

/// True if f32 is precise enough for measured points between `min` and `max`. This holds if the largest absolute
/// coordinate is at most 32 times the longest side of the bounds: f32 then rounds by at most 1/500,000 of this side.
pub(crate) fn f32_is_enough(min: DVec3, max: DVec3) -> bool {
    min.abs().max(max.abs()).max_element() <= 32.0 * (max - min).max_element()
}

#[cfg(all(test, feature = "exr", feature = "npy"))]
mod tests {
    use crate::strided::f32_of_half;

    #[test]
    fn halves_agree_with_the_crate_half() {
        for bits in 0..=u16::MAX {
            let (ours, theirs) = (f32_of_half(bits), half::f16::from_bits(bits).to_f32());
            assert!(ours.to_bits() == theirs.to_bits() || ours.is_nan() && theirs.is_nan(), "{bits:#x}");
        }
    }
}
