//! Splats coloured by an attribute: of the file, their height, or their normals.
//!
//! Colours are given to splats, after they are made: points, meshes and splats alike have a height and normals then.

mod bar;
mod maps;

pub use bar::save_color_bar;

use glam::DVec3;
use surfel_math::srgb;
use surfel_model::{Colormap, ExtraColumn, ExtraValues, OnInvalid, SplatCloud};

/// Most categories that are told apart where nobody asks for them.
const CATEGORIES: usize = 20;
/// Percentiles between which values get different colours, where nothing says the range.
const PERCENTILES: [f64; 2] = [2.0, 98.0];
/// sRGB level of what has no value.
const GREY: u8 = 128;

/// What splats are coloured by.
#[derive(Clone, Debug, PartialEq)]
pub struct Coloring {
    /// The attribute.
    pub attribute: String,
    /// The colours of its values.
    pub scale: ColorScale,
}

/// Which colours values have.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum ColorScale {
    /// The colours of the file, or of directions.
    Direct,
    /// A map's colours, from the first value of the range to the second.
    Range {
        /// The map.
        map: Colormap,
        /// Its ends.
        range: [f64; 2],
    },
    /// A colour for each value, in ascending order.
    Categories(Vec<Category>),
}

/// A value that stands for a kind of thing.
#[derive(Clone, Debug, PartialEq)]
pub struct Category {
    /// The value.
    pub value: f64,
    /// What it is called, if it is known.
    pub name: Option<&'static str>,
    /// sRGB levels.
    pub color: [u8; 3],
    /// How many splats have it.
    pub count: usize,
}

/// How to colour.
pub(crate) struct ColorBy<'a> {
    pub(crate) attribute: &'a str,
    pub(crate) map: Option<Colormap>,
    pub(crate) range: Option<[f64; 2]>,
    /// The direction of height.
    pub(crate) up: DVec3,
}

/// Why splats have the colours they have.
pub(crate) enum Colored {
    /// They are coloured, and what is to be said of it.
    By(Coloring, String),
    /// They have no such attribute, but these; all are grey.
    Unknown(Vec<String>),
}

/// Colours splats.
pub(crate) fn color(cloud: &mut SplatCloud, by: &ColorBy<'_>) -> Result<Colored, surfel_model::ModelError> {
    let name = by.attribute;
    let is = |what: &str| name.eq_ignore_ascii_case(what);
    let (colors, result) = if let Some(column) = ExtraColumn::find(&cloud.data().extras, name) {
        let values: Vec<f64> = (0..cloud.len()).map(|i| column.values.get(i)).collect();
        of_values(&values, by, is_class(&column.name), column.name.as_str())
    } else if is("height") {
        let values: Vec<f64> = (0..cloud.len()).map(|i| cloud.center(i).dot(by.up)).collect();
        of_values(&values, &ColorBy { map: Some(by.map.unwrap_or(Colormap::Viridis)), ..*by }, false, "height")
    } else if is("normal") {
        let of = |n: DVec3| (0.5 * n + 0.5).to_array().map(linear);
        let colors = (0..cloud.len()).map(|i| of(cloud.shading_normal(i))).collect();
        let note = "coloured by normal: red, green and blue are x, y and z from -1 to 1".to_owned();
        let coloring = Coloring { attribute: "normal".into(), scale: ColorScale::Direct };
        (Some(colors), Colored::By(coloring, note))
    } else if is("rgb") && cloud.data().colors.is_some() {
        let coloring = Coloring { attribute: "rgb".into(), scale: ColorScale::Direct };
        (None, Colored::By(coloring, "coloured by the file's own colours".into()))
    } else {
        let has_rgb = cloud.data().colors.is_some().then_some("rgb");
        let own = has_rgb.into_iter().chain(["height", "normal"]).map(str::to_owned);
        let extras = cloud.data().extras.iter().map(|e| e.name.escape_debug().to_string());
        let colors = vec![[linear(f64::from(GREY) / 255.0); 3]; cloud.len()];
        (Some(colors), Colored::Unknown(own.chain(extras).collect()))
    };
    if let Some(colors) = colors {
        let empty = SplatCloud::disks::<[f32; 3], [f32; 3]>(&[], &[], &[])?;
        let mut data = std::mem::replace(cloud, empty).into_data();
        data.colors = Some(colors);
        *cloud = SplatCloud::new(data, OnInvalid::Refuse)?.0;
    }
    Ok(result)
}

/// The scale of the values that points are coloured by: of a column, or of their height.
#[cfg(feature = "ortho")]
pub(crate) fn scale_of(points: &surfel_model::PointCloud, by: &ColorBy<'_>) -> Colored {
    let name = by.attribute;
    if let Some(column) = ExtraColumn::find(&points.extras, name) {
        let values: Vec<f64> = (0..points.len()).map(|i| column.values.get(i)).collect();
        return of_values(&values, by, is_class(&column.name), &column.name).1;
    }
    let direct = |note: &str| {
        Colored::By(Coloring { attribute: name.to_lowercase(), scale: ColorScale::Direct }, note.to_owned())
    };
    match name.to_lowercase().as_str() {
        "height" => {
            let values: Vec<f64> =
                (0..points.len()).map(|i| (points.origin + points.positions.get(i)).dot(by.up)).collect();
            of_values(&values, &ColorBy { map: Some(by.map.unwrap_or(Colormap::Viridis)), ..*by }, false, "height").1
        }
        "normal" => direct("coloured by normal: red, green and blue are x, y and z from -1 to 1"),
        "rgb" if points.colors.is_some() => direct("coloured by the file's own colours"),
        _ => {
            let has_rgb = points.colors.is_some().then_some("rgb");
            let own = has_rgb.into_iter().chain(["height", "normal"]).map(str::to_owned);
            Colored::Unknown(own.chain(points.extras.iter().map(|e| e.name.escape_debug().to_string())).collect())
        }
    }
}

/// True of the name of a column of ASPRS's classes.
fn is_class(name: &str) -> bool {
    let named = ExtraColumn { name: "classification".into(), values: ExtraValues::U8(Vec::new()) };
    ExtraColumn::find(&[named], name).is_some()
}

type Colors = Vec<[f32; 3]>;

fn of_values(values: &[f64], by: &ColorBy<'_>, class: bool, name: &str) -> (Option<Colors>, Colored) {
    let grey = [linear(f64::from(GREY) / 255.0); 3];
    let missing = values.iter().filter(|v| !v.is_finite()).count();
    let mut note = format!("coloured by {}", name.escape_debug());
    let categories = match by.map {
        Some(Colormap::Tab20) => Some(categories(values, false, usize::MAX)),
        Some(_) => None,
        None if by.range.is_some() => None,
        None if class => Some(categories(values, true, usize::MAX)),
        None => Some(categories(values, false, CATEGORIES)).filter(|found| !found.is_empty()),
    };
    let (colors, scale) = if let Some(categories) = categories {
        let of = |v: &f64| categories.binary_search_by(|c| c.value.total_cmp(v)).ok().map(|at| categories[at].color);
        let colors = values.iter().map(|v| of(v).map_or(grey, |c| c.map(|c| linear(f64::from(c) / 255.0)))).collect();
        let shown = categories.iter().take(CATEGORIES).map(|c| match c.name {
            Some(name) => format!("{} {name} {}", c.value, c.count),
            None => format!("{}: {}", c.value, c.count),
        });
        note += &format!(" ({})", shown.collect::<Vec<_>>().join(", "));
        (colors, ColorScale::Categories(categories))
    } else {
        // What grey levels measure is most often shown by them.
        let intensity = name.to_ascii_lowercase().trim_start_matches("scalar_") == "intensity";
        let map = by.map.unwrap_or(if intensity { Colormap::Grey } else { Colormap::Viridis });
        let [lo, hi] = by.range.unwrap_or_else(|| percentiles(values));
        let table: Vec<[f32; 3]> =
            maps::levels(map).into_iter().map(|c| c.map(|c| linear(f64::from(c) / 255.0))).collect();
        let of = |v: f64| {
            let at = ((v - lo) / (hi - lo)).clamp(0.0, 1.0) * table.len() as f64;
            if v.is_finite() { table[(at as usize).min(table.len() - 1)] } else { grey }
        };
        let how = if by.range.is_some() { "" } else { ", the 2nd to the 98th percentile: --range says others" };
        note += &format!(" by {} from {} to {}{how}", map.name(), short(lo), short(hi));
        (values.iter().map(|v| of(*v)).collect(), ColorScale::Range { map, range: [lo, hi] })
    };
    if missing > 0 {
        note += &format!("; {missing} without a value are grey");
    }
    (Some(colors), Colored::By(Coloring { attribute: name.to_owned(), scale }, note))
}

/// The distinct values, if all finite ones are whole and at most `most`; else none.
fn categories(values: &[f64], class: bool, most: usize) -> Vec<Category> {
    let tab20 = maps::levels(Colormap::Tab20);
    let mut found: Vec<(f64, usize)> = Vec::new();
    for &v in values.iter().filter(|v| v.is_finite()) {
        if v.fract() != 0.0 {
            if most < usize::MAX {
                return Vec::new();
            }
            continue;
        }
        // Adding zero makes −0 one with 0.
        let v = v + 0.0;
        match found.binary_search_by(|(known, _)| known.total_cmp(&v)) {
            Ok(at) => found[at].1 += 1,
            Err(_) if found.len() == most => return Vec::new(),
            Err(_) if found.len() >= 1 << 16 => {}
            Err(at) => found.insert(at, (v, 1)),
        }
    }
    let of = |(value, count): (f64, usize)| {
        let known = if class { maps::class(value) } else { None };
        let cyclic = tab20[value.rem_euclid(tab20.len() as f64) as usize % tab20.len()];
        Category { value, name: known.map(|k| k.0), color: known.map_or(cyclic, |k| k.1), count }
    };
    found.into_iter().map(of).collect()
}

/// The percentiles of the finite values; apart from each other by 1 at least where they are one.
fn percentiles(values: &[f64]) -> [f64; 2] {
    let mut finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let Some(last) = finite.len().checked_sub(1) else { return [0.0, 1.0] };
    let [lo, hi] = PERCENTILES.map(|p| {
        let at = (p / 100.0 * last as f64).round() as usize;
        *finite.select_nth_unstable_by(at, f64::total_cmp).1
    });
    if lo < hi && (hi - lo).is_finite() { [lo, hi] } else { [lo - 0.5, lo + 0.5] }
}

/// Four digits that tell numbers of a range apart.
pub(crate) fn short(value: f64) -> String {
    match value.abs() {
        a if a != 0.0 && !(1e-3..1e7).contains(&a) => format!("{value:.3e}"),
        a if a >= 1000.0 || value.fract() == 0.0 => format!("{value:.0}"),
        a if a >= 10.0 => format!("{value:.2}"),
        _ => format!("{value:.4}"),
    }
}

/// The linear value of an sRGB-encoded one from 0 to 1.
pub(crate) fn linear(encoded: f64) -> f32 {
    srgb::decode(encoded.clamp(0.0, 1.0)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    fn cloud(name: &str, values: ExtraValues) -> SplatCloud {
        let n = values.len();
        let centers: Vec<[f32; 3]> = (0..n).map(|i| [0.0, 0.0, i as f32]).collect();
        let made = SplatCloud::disks(&centers, &vec![[0.0, 0.0, 1.0_f32]; n], &vec![1.0; n]).unwrap();
        let mut data = made.into_data();
        data.extras.push(ExtraColumn { name: name.into(), values });
        SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
    }

    fn by(attribute: &str) -> ColorBy<'_> {
        ColorBy { attribute, map: None, range: None, up: DVec3::Z }
    }

    fn levels(cloud: &SplatCloud) -> Vec<[u8; 3]> {
        let encode = |c: f32| (0..=255_u8).find(|l| (linear(f64::from(*l) / 255.0) - c).abs() < 1e-7).unwrap();
        (0..cloud.len()).map(|i| cloud.color(i).map(encode)).collect()
    }

    #[test]
    fn values_within_the_range_have_the_map_s_colours_and_none_is_grey() {
        let mut c = cloud("scalar_Temp", ExtraValues::F32(vec![-5.0, 0.0, 5.0, 10.0, 99.0, f32::NAN]));
        let options = ColorBy { map: Some(Colormap::Viridis), range: Some([0.0, 10.0]), ..by("temp") };
        let Ok(Colored::By(coloring, note)) = color(&mut c, &options) else { panic!() };
        assert_eq!(coloring.scale, ColorScale::Range { map: Colormap::Viridis, range: [0.0, 10.0] });
        assert!(note.contains("scalar_Temp by viridis from 0 to 10; 1 without a value"), "{note}");
        let (dark, middle, light) = ([68, 1, 84], [33, 145, 140], [253, 231, 37]);
        assert_eq!(levels(&c), [dark, dark, middle, light, light, [GREY; 3]]);
    }

    #[test]
    fn the_default_range_leaves_two_percent_out_at_each_end() {
        let mut c = cloud("intensity", ExtraValues::F64((0..=100).map(|i| f64::from(i) + 0.5).collect()));
        let Ok(Colored::By(coloring, note)) = color(&mut c, &by("Intensity")) else { panic!() };
        assert_eq!(coloring.scale, ColorScale::Range { map: Colormap::Grey, range: [2.5, 98.5] });
        assert!(note.contains("by grey from 2.5000 to 98.50, the 2nd to the 98th percentile"), "{note}");
        // Values that are all one have a colour, too.
        assert_eq!(percentiles(&[7.0; 9]), [6.5, 7.5]);
        assert_eq!((percentiles(&[f64::NAN]), percentiles(&[])), ([0.0, 1.0], [0.0, 1.0]));
    }

    #[test]
    fn classes_have_their_own_colours_and_other_whole_numbers_those_of_tab20() {
        let mut c = cloud("Classification", ExtraValues::U8(vec![2, 6, 2, 200]));
        let Ok(Colored::By(coloring, note)) = color(&mut c, &by("classification")) else { panic!() };
        let ColorScale::Categories(found) = &coloring.scale else { panic!("{coloring:?}") };
        assert_eq!(found.iter().map(|c| (c.value, c.count)).collect::<Vec<_>>(), [(2.0, 2), (6.0, 1), (200.0, 1)]);
        assert!(note.contains("2 ground 2, 6 building 1, 200: 1"), "{note}");
        let tab20 = maps::levels(Colormap::Tab20);
        assert_eq!(levels(&c)[3], tab20[0], "200 is 0 of twenty");
        let mut c = cloud("scan", ExtraValues::I16(vec![1, -1, 19]));
        color(&mut c, &by("scan")).unwrap();
        assert_eq!(levels(&c), [tab20[1], tab20[19], tab20[19]]);
        // More than twenty are a measure.
        let mut c = cloud("level", ExtraValues::I16((0..30).collect()));
        let Ok(Colored::By(coloring, _)) = color(&mut c, &by("level")) else { panic!() };
        assert!(matches!(coloring.scale, ColorScale::Range { map: Colormap::Viridis, .. }));
    }

    #[test]
    fn height_and_normals_are_there_without_an_attribute_and_what_is_not_there_is_named() {
        let mut c = cloud("a", ExtraValues::U8(vec![0; 3]));
        let options = ColorBy { up: DVec3::NEG_Z, range: Some([-2.0, 0.0]), ..by("height") };
        color(&mut c, &options).unwrap();
        assert_eq!((levels(&c)[0], levels(&c)[2]), ([253, 231, 37], [68, 1, 84]), "down is up");
        color(&mut c, &by("normal")).unwrap();
        assert_eq!(c.color(0), [linear(0.5), linear(0.5), 1.0]);
        let Ok(Colored::Unknown(known)) = color(&mut c, &by("b")) else { panic!() };
        assert_eq!(known, ["rgb", "height", "normal", "a"]);
        assert_eq!(levels(&c), [[GREY; 3]; 3]);
    }
}
