//! Colouring of splats by an attribute: a column of the file, their height, or their normals.
//!
//! Splats are coloured after conversion, when points, meshes and splats alike have heights and normals. Everything
//! drawn together shares one scale per attribute: a `tally::Tally` of the values of all files determines it, and
//! `together` applies it.

mod files;
mod maps;
pub(crate) mod tally;
pub mod together;
pub(crate) mod vision;

pub use files::{FileColors, Labels};
pub use maps::ColorMap;
pub use together::Colorings;
pub use vision::confusions;

use glam::DVec3;
use std::sync::Arc;
use surfel_math::srgb;
use surfel_model::{CloudData, ExtraColumn, ExtraValues, ModelError, OnInvalid, SplatCloud};

/// sRGB level of splats without a value.
const GREY: u8 = 128;

/// An attribute and the colours of its values.
#[derive(Clone, Debug, PartialEq)]
pub struct Coloring {
    /// Name of the attribute.
    pub attribute: String,
    /// Colours of the attribute's values.
    pub scale: ColorScale,
}

/// Mapping from values to colours.
#[derive(Clone, Debug, PartialEq)]
pub enum ColorScale {
    /// Colours that aren't derived from values: those of the file, or those of normals.
    Direct,
    /// A colour map over a range of values.
    Range {
        /// The colour map.
        map: ColorMap,
        /// Values at the ends of the map, in the attribute's units.
        range: [f64; 2],
    },
    /// One colour per value, in ascending order of values.
    Categories(Vec<Category>),
}

/// A value that represents a category, such as a class.
#[derive(Clone, Debug, PartialEq)]
pub struct Category {
    /// The value.
    pub value: f64,
    /// Name of the category, if it has one.
    pub name: Option<Arc<str>>,
    /// Colour as sRGB levels.
    pub color: [u8; 3],
    /// Number of splats with this value.
    pub count: usize,
}

impl Category {
    /// Returns the category's name, or else its value.
    pub fn label(&self) -> String {
        self.name.as_ref().map_or_else(|| short(self.value), ToString::to_string)
    }
}

/// Source of an attribute's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// A column, by its index among the extra columns.
    Column(usize),
    /// Position along the up axis.
    Height,
    /// Normal, whose components become colours.
    Normal,
    /// Colours of the file.
    Rgb,
}

impl Attribute {
    /// Returns the attribute with this name. `has_colors` is true if the file has colours, so that "rgb" is an
    /// attribute.
    ///
    /// # Errors
    /// The names of the attributes that exist.
    pub fn of(extras: &[ExtraColumn], has_colors: bool, name: &str) -> Result<Self, Vec<String>> {
        if let Some(column) = ExtraColumn::find(extras, name) {
            let index = extras.iter().position(|extra| std::ptr::eq(extra, column));
            return Ok(Self::Column(index.unwrap_or_default()));
        }
        match name.to_lowercase().as_str() {
            "height" => Ok(Self::Height),
            "normal" => Ok(Self::Normal),
            "rgb" if has_colors => Ok(Self::Rgb),
            _ => {
                let own = has_colors.then_some("rgb").into_iter().chain(["height", "normal"]).map(str::to_owned);
                Err(own.chain(extras.iter().map(|e| e.name.escape_debug().to_string())).collect())
            }
        }
    }

    /// Returns the attribute's name as spelled in the file.
    pub(crate) fn name(self, extras: &[ExtraColumn]) -> String {
        match self {
            Self::Column(index) => extras.get(index).map_or_else(String::new, |column| column.name.clone()),
            Self::Height => "height".to_owned(),
            Self::Normal => "normal".to_owned(),
            Self::Rgb => "rgb".to_owned(),
        }
    }

    /// Returns the scale of an attribute without numbers, and a note that explains its colours.
    pub(crate) fn direct(self) -> Option<(ColorScale, &'static str)> {
        let note = match self {
            Self::Column(_) | Self::Height => return None,
            Self::Normal => "coloured by normal: red, green and blue are x, y and z from -1 to 1",
            Self::Rgb => "coloured by the file's own colours",
        };
        Some((ColorScale::Direct, note))
    }

    /// Returns the value for a splat; NaN if the attribute has no numbers.
    fn value(self, cloud: &SplatCloud, up: DVec3, i: usize) -> f64 {
        match self {
            Self::Column(index) => cloud.data().extras.get(index).map_or(f64::NAN, |column| column.values.get(i)),
            Self::Height => cloud.center(i).dot(up),
            Self::Normal | Self::Rgb => f64::NAN,
        }
    }

    /// Returns the values of all splats.
    pub(crate) fn values(self, cloud: &SplatCloud, up: DVec3) -> impl Iterator<Item = f64> + '_ {
        (0..cloud.len()).map(move |i| self.value(cloud, up, i))
    }
}

impl ColorScale {
    /// Returns a function from values to linear colours; grey for a value that isn't finite or has no colour.
    pub fn painter(&self) -> Box<dyn Fn(f64) -> [f32; 3] + '_> {
        let light = |levels: [u8; 3]| levels.map(|level| linear(f64::from(level) / 255.0));
        let grey = light([GREY; 3]);
        match self {
            Self::Direct => Box::new(move |_| grey),
            Self::Range { map, range: [lo, hi] } => {
                let table: Vec<[f32; 3]> = map.levels().into_iter().map(light).collect();
                let (lo, hi) = (*lo, *hi);
                Box::new(move |v| {
                    let at = ((v - lo) / (hi - lo)).clamp(0.0, 1.0) * table.len() as f64;
                    if v.is_finite() { table[(at as usize).min(table.len() - 1)] } else { grey }
                })
            }
            Self::Categories(categories) => Box::new(move |v| {
                // Adding zero turns −0 into 0.
                let found = categories.binary_search_by(|c| c.value.total_cmp(&(v + 0.0)));
                found.map_or(grey, |at| light(categories[at].color))
            }),
        }
    }
}

/// Colours splats by an attribute; `None` makes them grey. `up` is the unit axis along which heights are measured.
pub fn paint(
    cloud: &mut SplatCloud,
    attribute: Option<Attribute>,
    scale: &ColorScale,
    up: DVec3,
) -> Result<(), ModelError> {
    let painter = scale.painter();
    let colors: Vec<[f32; 3]> = match attribute {
        Some(Attribute::Rgb) => return Ok(()),
        Some(Attribute::Normal) => {
            let of = |n: DVec3| (0.5 * n + 0.5).to_array().map(linear);
            (0..cloud.len()).map(|i| of(cloud.shading_normal(i))).collect()
        }
        Some(attribute) => attribute.values(cloud, up).map(&painter).collect(),
        None => vec![painter(f64::NAN); cloud.len()],
    };
    recolor(cloud, colors)
}

/// Colours splats by values, one for each splat.
pub fn paint_values(
    cloud: &mut SplatCloud,
    values: impl Iterator<Item = f64>,
    scale: &ColorScale,
) -> Result<(), ModelError> {
    let colors = values.map(scale.painter()).collect();
    recolor(cloud, colors)
}

/// Replaces the colours of splats.
pub fn recolor(cloud: &mut SplatCloud, colors: Vec<[f32; 3]>) -> Result<(), ModelError> {
    let empty = SplatCloud::disks::<[f32; 3], [f32; 3]>(&[], &[], &[])?;
    let data = std::mem::replace(cloud, empty).into_data();
    *cloud = SplatCloud::new(CloudData { colors: Some(colors), ..data }, OnInvalid::Refuse)?.0;
    Ok(())
}

/// True for the name of a column of ASPRS classes.
pub(crate) fn is_class(name: &str) -> bool {
    let named = ExtraColumn { name: "classification".into(), values: ExtraValues::U8(Vec::new()) };
    ExtraColumn::find(&[named], name).is_some()
}

/// Formats a value with about four digits, to distinguish numbers of a range.
pub(crate) fn short(value: f64) -> String {
    match value.abs() {
        a if a != 0.0 && !(1e-3..1e7).contains(&a) => format!("{value:.3e}"),
        a if a >= 1000.0 || value.fract() == 0.0 => format!("{value:.0}"),
        a if a >= 10.0 => format!("{value:.2}"),
        _ => format!("{value:.4}"),
    }
}

/// Converts an sRGB-encoded value from 0 to 1 to linear.
pub(crate) fn linear(encoded: f64) -> f32 {
    srgb::decode(encoded.clamp(0.0, 1.0)) as f32
}
