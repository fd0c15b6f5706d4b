//! Colours of vertices and faces: detection of their range and encoding, and conversion to linear light.

use super::table::{Table, take, take_set};
use crate::color::{linear_of_8_bit, linear_of_16_bit, linear_of_level};
use crate::columns::{Numbers, number_type, to_f32, to_f64};
use crate::context::Context;
use crate::error::Fault;
use crate::strided::{NumberType, Strided, combined, ranges};
use surfel_model::ExtraValues;

const RGB: [&str; 3] = ["red", "green", "blue"];
/// Largest value up to which a file's sRGB-encoded float colours are taken to range from 0 to 1, unless some exceed 1
/// and all are whole. Computed light or displayed colours may exceed 1. Other colours range to 255 or 65535.
pub(crate) const MAX_FLOAT_COLOR: f64 = 8.0;

/// Encoding of colours that are stored as floats, which their number type doesn't determine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FloatColors {
    /// Linear light: in PLY files of splats (with half-axes, or with normals and radii), and in files with the comment
    /// `colors linear`.
    Linear,
    /// sRGB-encoded, as displayed: in all other files of points and meshes.
    Displayed,
}

impl FloatColors {
    /// Returns the encoding of float colours in a file of points or meshes: linear if a comment states it, else as
    /// displayed.
    pub(crate) fn of_comments(comments: &[String]) -> Self {
        if comments.iter().any(|c| super::comments::are_colors_linear(c)) { Self::Linear } else { Self::Displayed }
    }
}

/// Number type of three colour columns, as far as it matters for their range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ColorType {
    Byte,
    Short,
    Whole,
    Float,
}

impl ColorType {
    pub(crate) fn of(kinds: [NumberType; 3]) -> Self {
        let all = |f: fn(NumberType) -> bool| kinds.into_iter().all(f);
        match () {
            () if all(|kind| kind == NumberType::U8) => Self::Byte,
            () if all(|kind| kind == NumberType::U16) => Self::Short,
            () if all(NumberType::is_integer) => Self::Whole,
            () => Self::Float,
        }
    }
}

/// Encoding and range of colour values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ColorScale {
    Linear,
    /// sRGB-encoded values from 0 to this maximum: 1, 255 or 65535.
    Encoded(f64),
}

impl ColorScale {
    /// Determines encoding and range of colours: from their number type, their largest value, whether all values are
    /// whole, and the encoding of floats.
    pub(crate) fn of(kind: ColorType, largest: f64, whole: bool, floats: FloatColors) -> Self {
        match kind {
            ColorType::Byte => Self::Encoded(255.0),
            ColorType::Short | ColorType::Whole if largest <= 255.0 => Self::Encoded(255.0),
            ColorType::Short | ColorType::Whole => Self::Encoded(65_535.0),
            ColorType::Float if floats == FloatColors::Linear => Self::Linear,
            ColorType::Float if largest <= 1.0 || largest <= MAX_FLOAT_COLOR && !whole => Self::Encoded(1.0),
            ColorType::Float => Self::Encoded(if largest <= 255.0 { 255.0 } else { 65_535.0 }),
        }
    }

    /// Returns the function that converts stored values to linear light.
    pub(crate) fn linear(self) -> impl Fn(f64) -> f32 + Sync {
        let bytes = linear_of_8_bit();
        let shorts = if self == Self::Encoded(65_535.0) { linear_of_16_bit() } else { &[] };
        move |level| match self {
            Self::Linear => level as f32,
            Self::Encoded(255.0) if level.fract() == 0.0 => bytes[level.clamp(0.0, 255.0) as usize],
            Self::Encoded(65_535.0) if level.fract() == 0.0 => shorts[level.clamp(0.0, 65_535.0) as usize],
            Self::Encoded(most) => linear_of_level(level, most),
        }
    }

    /// Returns a note for the user about the encoding and range that were assumed. Returns `None` for 8-bit and linear
    /// colours, for 16-bit colours that exceed 255 or are all 0, and for other whole numbers up to 255.
    pub(crate) fn note(self, kind: ColorType, largest: f64) -> Option<String> {
        match (kind, self) {
            (ColorType::Byte, _) | (_, Self::Linear) => None,
            (ColorType::Short, Self::Encoded(255.0)) if largest > 0.0 => Some(EIGHT_BITS.into()),
            (ColorType::Short, _) | (ColorType::Whole, Self::Encoded(255.0)) => None,
            (_, Self::Encoded(scale)) => {
                let beyond = if largest > scale { ", and clamped larger ones" } else { "" };
                let remedy = if kind == ColorType::Float { "; a comment 'colors linear' says otherwise" } else { "" };
                Some(format!("took the colours as sRGB-encoded, from 0 to {scale}{beyond}{remedy}"))
            }
        }
    }
}

/// Note for the user about 16-bit colours that range only to 255.
pub(crate) const EIGHT_BITS: &str = "its colours count to 255 instead of 65535: taken as 8 bits";

/// Removes red, green and blue, or packed colours, from a table, and converts them to linear light. Returns `None` if
/// the table has no colours, and an error if some of the three columns are missing. Adds notes on assumptions about the
/// range.
pub(super) fn take_colors(
    table: &mut Table<'_>,
    floats: FloatColors,
    context: &mut Context<'_>,
) -> Result<Option<Vec<[f32; 3]>>, Fault> {
    let Some(columns) = take_set(table, RGB)? else { return Ok(take_packed(table)) };
    let columns = match columns {
        [Numbers::Stored(r), Numbers::Stored(g), Numbers::Stored(b)] => {
            return Ok(Some(stored_colors([r, g, b], floats, context)));
        }
        columns => columns.map(ExtraValues::from),
    };
    let kind = ColorType::of([0, 1, 2].map(|k| number_type(&columns[k])));
    let [r, g, b] = columns.map(|column| to_f64(&column));
    let scale = ColorColumns([&r, &g, &b]).scale(kind, floats, context);
    let linear = scale.linear();
    Ok(Some(r.iter().zip(&g).zip(&b).map(|((r, g), b)| [*r, *g, *b].map(&linear)).collect()))
}

/// Converts three colour columns, which are read in place, to linear light.
fn stored_colors(columns: [Strided<'_>; 3], floats: FloatColors, context: &mut Context<'_>) -> Vec<[f32; 3]> {
    let kind = ColorType::of(columns.map(|c| c.kind()));
    let largest = match kind {
        ColorType::Byte => 255.0,
        _ => ranges(columns).iter().fold(0.0, |most: f64, range| most.max(range.1)),
    };
    let is_whole = |row: [f64; 3]| row.iter().all(|c| !c.is_finite() || c.fract() == 0.0);
    // Only for float colours in this range does the scale depend on whether all values are whole.
    let matters = kind == ColorType::Float && largest > 1.0 && largest <= MAX_FLOAT_COLOR;
    let scale = ColorScale::of(kind, largest, matters && combined(columns, is_whole).iter().all(|w| *w), floats);
    scale.note(kind, largest).into_iter().for_each(|note| context.note(note));
    let linear = scale.linear();
    combined(columns, |row| row.map(&linear))
}

/// Removes the columns red, green and blue from a table, or returns an error if one is missing. Returns the colours as
/// fractions of their range, still encoded as in the file, and true if they are linear.
pub(super) fn take_printed(
    table: &mut Table<'_>,
    floats: FloatColors,
    context: &mut Context<'_>,
) -> Result<(Vec<[f64; 3]>, bool), Fault> {
    let columns = take(table, RGB)?.map(ExtraValues::from);
    let kind = ColorType::of([0, 1, 2].map(|k| number_type(&columns[k])));
    let [r, g, b] = columns.map(|column| to_f64(&column));
    let scale = ColorColumns([&r, &g, &b]).scale(kind, floats, context);
    let most = if let ColorScale::Encoded(most) = scale { most } else { 1.0 };
    let fraction = |((r, g), b): ((&f64, &f64), &f64)| [*r, *g, *b].map(|c| c / most);
    Ok((r.iter().zip(&g).zip(&b).map(fraction).collect(), scale == ColorScale::Linear))
}

/// Columns of red, green and blue in memory, before conversion.
struct ColorColumns<'a>([&'a [f64]; 3]);

impl ColorColumns<'_> {
    /// Returns encoding and range of the values. Adds the note of [`ColorScale::note`], if there is one.
    fn scale(&self, kind: ColorType, floats: FloatColors, context: &mut Context<'_>) -> ColorScale {
        let all = || self.0.into_iter().flatten().copied().filter(|c| c.is_finite());
        let largest = all().fold(0.0, f64::max);
        let scale = ColorScale::of(kind, largest, largest > 1.0 && all().all(|c| c.fract() == 0.0), floats);
        scale.note(kind, largest).into_iter().for_each(|note| context.note(note));
        scale
    }
}

/// Removes a column `rgb` or `rgba` of colours that are packed into one number, as the Point Cloud Library does.
/// Returns the colours in linear light; `None` if there is no such column. A column that isn't packed, because of its
/// type or its float values, stays in the table.
fn take_packed(table: &mut Table<'_>) -> Option<Vec<[f32; 3]>> {
    let name = ["rgb", "rgba"].into_iter().find(|name| table.has(name))?;
    let packed = match table.take(name).map(ExtraValues::from)? {
        ExtraValues::U32(packed) => packed,
        ExtraValues::I32(packed) => packed.into_iter().map(|v| v as u32).collect(),
        ExtraValues::F32(packed) if packed.iter().all(|v| is_packed(*v)) => {
            packed.iter().map(|v| v.to_bits()).collect()
        }
        other => {
            table.scalars.push((name.into(), Numbers::InMemory(other)));
            return None;
        }
    };
    let bytes = linear_of_8_bit();
    Some(packed.into_iter().map(|bits| [16, 8, 0].map(|shift| bytes[(bits >> shift & 255) as usize])).collect())
}

/// True if the bits of a float may be a packed colour, whose alpha is 0, 255 or nearly 255.
pub(super) fn is_packed(value: f32) -> bool {
    value.is_nan() || value.abs() < 1e-37 || value < -1e37
}

/// Removes the alphas from a table, and returns them as fractions from 0 to 1; `None` if there are none. 16-bit alphas
/// that never exceed 255 count as 8 bits. Float alphas may range to 255 or 65535, except in PLY files of splats
/// (`is_profile`), where they are fractions already; they aren't clamped.
pub(super) fn take_alphas(table: &mut Table<'_>, is_profile: bool, context: &mut Context<'_>) -> Option<Vec<f32>> {
    let fraction = |a: f64, most: f64| (a / most).clamp(0.0, 1.0) as f32;
    match table.take("alpha").map(ExtraValues::from)? {
        ExtraValues::U16(v) => {
            let are_bytes = v.iter().all(|a| *a <= 255);
            if are_bytes && v.iter().any(|a| *a > 0) {
                context.note("its alphas count to 255 instead of 65535: taken as 8 bits".into());
            }
            let most = if are_bytes { 255.0 } else { 65_535.0 };
            Some(v.iter().map(|a| fraction((*a).into(), most)).collect())
        }
        values @ (ExtraValues::F32(_) | ExtraValues::F64(_)) => {
            let mut v = to_f32(values);
            let largest = v.iter().copied().filter(|a| a.is_finite()).fold(0.0, f32::max);
            if !is_profile && f64::from(largest) > MAX_FLOAT_COLOR {
                let most = if largest <= 255.0 { 255.0 } else { 65_535.0 };
                context.note(format!("took the alphas as counting to {most}"));
                v.iter_mut().for_each(|a| *a = (f64::from(*a) / most) as f32);
            }
            Some(v)
        }
        other => Some(to_f64(&other).iter().map(|a| fraction(*a, 255.0)).collect()),
    }
}
