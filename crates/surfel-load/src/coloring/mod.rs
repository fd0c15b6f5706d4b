//! Colouring of splats by an attribute: a column of the file, their height, or their normals.
//!
//! Splats are coloured after conversion, when points, meshes and splats alike have heights and normals. All objects
//! that are drawn together share one scale per attribute. `tally` collects the values of all files and derives the
//! scale; `together` applies it.

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

/// sRGB level, 0 to 255, of the grey that splats without a value get.
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
    /// Colours that aren't derived from a scale: the file's colours, or normals as colours.
    Direct,
    /// A colour map over a range of values.
    Range {
        /// Colour map that is stretched over the range.
        map: ColorMap,
        /// Minimum and maximum of the map's range, in the attribute's units.
        range: [f64; 2],
    },
    /// One colour for each distinct value, in ascending order of values.
    Categories(Vec<Category>),
}

/// Value that stands for a category, such as a class.
#[derive(Clone, Debug, PartialEq)]
pub struct Category {
    /// Attribute value of the category's splats.
    pub value: f64,
    /// Name of the category, if it has one.
    pub name: Option<Arc<str>>,
    /// Colour of the category as 8-bit sRGB levels.
    pub color: [u8; 3],
    /// Number of splats with this value.
    pub count: usize,
}

impl Category {
    /// Returns the category's name, or its value if it has no name.
    pub fn label(&self) -> String {
        self.name.as_ref().map_or_else(|| short(self.value), ToString::to_string)
    }
}

/// Attribute by which splats are coloured: a column of the file, the height, the normal, or the file's own colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// Values of a column of the file, by the column's index among the extra columns.
    Column(usize),
    /// Position of each splat along the up axis.
    Height,
    /// Normal of each splat, whose components become colours.
    Normal,
    /// Colour of each splat as the file states it.
    Rgb,
}

impl Attribute {
    /// Returns the attribute with this name. `has_colors` is true if the file has colours; "rgb" is an attribute only
    /// then.
    ///
    /// # Errors
    /// The names of the file's attributes, if none has this name.
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

    /// Returns the attribute's name, as the file spells it.
    pub(crate) fn name(self, extras: &[ExtraColumn]) -> String {
        match self {
            Self::Column(index) => extras.get(index).map_or_else(String::new, |column| column.name.clone()),
            Self::Height => "height".to_owned(),
            Self::Normal => "normal".to_owned(),
            Self::Rgb => "rgb".to_owned(),
        }
    }

    /// Returns the scale of an attribute whose colours aren't derived from numbers, and a note that explains the
    /// colours. Returns `None` for numbers.
    pub(crate) fn direct(self) -> Option<(ColorScale, &'static str)> {
        let note = match self {
            Self::Column(_) | Self::Height => return None,
            Self::Normal => "coloured by normal: red, green and blue are x, y and z from -1 to 1",
            Self::Rgb => "coloured by the file's own colours",
        };
        Some((ColorScale::Direct, note))
    }

    /// Returns the attribute's value for a splat; NaN if the attribute isn't a number.
    fn value(self, cloud: &SplatCloud, up: DVec3, i: usize) -> f64 {
        match self {
            Self::Column(index) => cloud.data().extras.get(index).map_or(f64::NAN, |column| column.values.get(i)),
            Self::Height => cloud.center(i).dot(up),
            Self::Normal | Self::Rgb => f64::NAN,
        }
    }

    /// Returns the attribute's values for all splats, in order. `up` is the unit vector along which heights are
    /// measured.
    pub(crate) fn values(self, cloud: &SplatCloud, up: DVec3) -> impl Iterator<Item = f64> + '_ {
        (0..cloud.len()).map(move |i| self.value(cloud, up, i))
    }
}

impl ColorScale {
    /// Returns a function that maps a value to a linear colour. Values that aren't finite or have no colour become
    /// grey.
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

/// Colours splats by an attribute; `None` colours them grey, and [`Attribute::Rgb`] changes nothing. `up` is the unit
/// vector along which heights are measured.
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

/// Replaces the colours of splats by linear RGB colours, one for each splat.
pub fn recolor(cloud: &mut SplatCloud, colors: Vec<[f32; 3]>) -> Result<(), ModelError> {
    let empty = SplatCloud::disks::<[f32; 3], [f32; 3]>(&[], &[], &[])?;
    let data = std::mem::replace(cloud, empty).into_data();
    *cloud = SplatCloud::new(CloudData { colors: Some(colors), ..data }, OnInvalid::Refuse)?.0;
    Ok(())
}

/// True if a column of this name contains ASPRS classes.
pub(crate) fn is_class(name: &str) -> bool {
    let named = ExtraColumn { name: "classification".into(), values: ExtraValues::U8(Vec::new()) };
    ExtraColumn::find(&[named], name).is_some()
}

/// Formats a value for the ends of a range: with about four significant digits, or as a whole number from 1000 to 10⁷.
pub(crate) fn short(value: f64) -> String {
    match value.abs() {
        a if a != 0.0 && !(1e-3..1e7).contains(&a) => format!("{value:.3e}"),
        a if a >= 1000.0 || value.fract() == 0.0 => format!("{value:.0}"),
        a if a >= 10.0 => format!("{value:.2}"),
        _ => format!("{value:.4}"),
    }
}

/// Converts an sRGB-encoded value in [0, 1] to a linear one.
pub(crate) fn linear(encoded: f64) -> f32 {
    srgb::decode(encoded.clamp(0.0, 1.0)) as f32
}
