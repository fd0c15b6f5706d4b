//! Points from columns of numbers: which column is what, by its name or by what is in it.
//!
//! Colours are what a program displayed, so they are sRGB-encoded whether they count to 255, to 65535 or to 1.

#![cfg_attr(not(all(feature = "npy", feature = "pcd", feature = "points")), allow(dead_code))]

use crate::color::{linear_of_8_bit, linear_of_level};
use crate::columns::f32_is_enough;
use crate::content::Content;
use crate::context::Context;
use crate::crs::IN_DEGREES;
use crate::error::Fault;
use crate::strided::{self, NumberType, Strided, combined, ranges, vectors_f32};
use glam::{DVec3, Vec3};
use surfel_model::{CloudData, Column3, ExtraColumn, ExtraValues, PointCloud, Shape};

/// A column and its name, which is empty where the file gives none.
pub(crate) struct Named<'a> {
    pub(crate) name: String,
    pub(crate) values: Strided<'a>,
}

/// Names that columns go by, without case, units and quotes; of several sets that are there, the first counts.
const POSITIONS: [[&str; 3]; 17] = [
    ["x", "y", "z"],
    ["x_coord", "y_coord", "z_coord"],
    ["xcoord", "ycoord", "zcoord"],
    ["coord_x", "coord_y", "coord_z"],
    ["pos_x", "pos_y", "pos_z"],
    ["position_x", "position_y", "position_z"],
    ["easting", "northing", "elevation"],
    ["easting", "northing", "height"],
    ["easting", "northing", "altitude"],
    ["longitude", "latitude", "z"],
    ["longitude", "latitude", "height"],
    ["longitude", "latitude", "altitude"],
    ["longitude", "latitude", "elevation"],
    ["lon", "lat", "z"],
    ["lon", "lat", "alt"],
    ["lon", "lat", "height"],
    ["lon", "lat", "elevation"],
];
const COLORS: [[&str; 3]; 6] = [
    ["red", "green", "blue"],
    ["r", "g", "b"],
    ["diffuse_red", "diffuse_green", "diffuse_blue"],
    ["color_r", "color_g", "color_b"],
    ["rf", "gf", "bf"],
    ["scan_red", "scan_green", "scan_blue"],
];
const NORMALS: [[&str; 3]; 5] = [
    ["nx", "ny", "nz"],
    ["normal_x", "normal_y", "normal_z"],
    ["normalx", "normaly", "normalz"],
    ["normals_x", "normals_y", "normals_z"],
    ["n_x", "n_y", "n_z"],
];

/// What columns hold, by their indices. All others are kept as they are.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Roles {
    pub(crate) position: [usize; 3],
    pub(crate) color: Option<[usize; 3]>,
    /// Red, green and blue in the bits of one number, and whether it has an alpha.
    pub(crate) packed_color: Option<(usize, bool)>,
    pub(crate) normal: Option<[usize; 3]>,
    pub(crate) alpha: Option<usize>,
    pub(crate) radius: Option<usize>,
}

impl Roles {
    /// By the columns' names; `None` if these name no position.
    pub(crate) fn by_name<'a>(names: impl IntoIterator<Item = &'a str>) -> Option<Self> {
        let names: Vec<String> = names.into_iter().map(plain_name).collect();
        let find = |name: &str| names.iter().position(|n| n == name);
        let set = |sets: &[[&str; 3]]| sets.iter().find_map(|[a, b, c]| Some([find(a)?, find(b)?, find(c)?]));
        let color = set(&COLORS);
        let packed = || find("rgb").map(|i| (i, false)).or_else(|| find("rgba").map(|i| (i, true)));
        Some(Self {
            position: set(&POSITIONS)?,
            color,
            packed_color: if color.is_none() { packed() } else { None },
            normal: set(&NORMALS),
            alpha: find("alpha").or_else(|| color.and_then(|_| find("a"))),
            radius: find("radius").or_else(|| find("radii")),
        })
    }

    /// By the number of columns and what is in them: x y z, then triples that are normals if they have unit length,
    /// else colours. One column more than triples is an intensity, before them or, where that
    /// fits better, after them. All get names.
    pub(crate) fn by_content(columns: &mut [Named<'_>]) -> Self {
        let width = columns.len();
        let mut roles = Self { position: [0, 1, 2], ..Self::default() };
        let triple = |start: usize| Triple::of(std::array::from_fn(|i| &columns[start + i].values));
        let mut next = 3;
        let mut intensity = None;
        if width % 3 == 1 {
            let last = width >= 7 && triple(3).fits_better_than(&triple(4));
            intensity = Some(if last { width - 1 } else { 3 });
            next += usize::from(!last);
        }
        while width % 3 != 2 && next + 3 <= width {
            let (found, set) = (triple(next), Some([next, next + 1, next + 2]));
            if found.unit && roles.normal.is_none() {
                roles.normal = set;
            } else if found.color && roles.color.is_none() {
                roles.color = set;
            }
            next += 3;
        }
        if let Some(at) = intensity {
            columns[at].name = "intensity".into();
        }
        for (i, column) in columns.iter_mut().enumerate() {
            if column.name.is_empty() {
                column.name = format!("column_{}", i + 1);
            }
        }
        roles.name(columns);
        roles
    }

    /// True of points with normals and radii: those are splats.
    #[cfg(feature = "laz")]
    pub(crate) fn are_splats(&self) -> bool {
        self.radius.is_some() && self.normal.is_some()
    }

    /// Gives position, normal and colour their usual names.
    fn name(&self, columns: &mut [Named<'_>]) {
        let sets = [(Some(self.position), ["x", "y", "z"]), (self.color, COLORS[0]), (self.normal, NORMALS[0])];
        for (set, names) in sets {
            for (i, name) in set.into_iter().flatten().zip(names) {
                columns[i].name = name.into();
            }
        }
    }
}

/// A name in lower case, without quotes, unit and the signs that begin a comment.
fn plain_name(name: &str) -> String {
    let name = name.trim_matches(|c: char| c.is_whitespace() || matches!(c, '"' | '\'' | '/' | '#'));
    let name = name.split(['[', '(']).next().unwrap_or(name).trim();
    name.to_ascii_lowercase().replace([' ', '-', '.'], "_")
}

/// What three columns can be, judged by up to 1000 rows.
struct Triple {
    /// Vectors of unit length.
    unit: bool,
    /// Levels of up to 65535.
    color: bool,
    /// Whole numbers.
    whole: bool,
    largest: f64,
    /// How far the three lie apart in a row, summed: colours are mostly near grey.
    spread: f64,
}

impl Triple {
    fn of(columns: [&Strided<'_>; 3]) -> Self {
        let rows = columns[0].len();
        let (mut unit, mut other) = (0, 0);
        let mut found = Self { unit: false, color: true, whole: true, largest: 0.0, spread: 0.0 };
        for row in (0..rows).step_by(rows.div_ceil(1000).max(1)) {
            let t = columns.map(|c| c.at(row));
            let length = DVec3::from_array(t).length();
            // Normals are printed with two digits at least; points without one have zeros.
            if (length - 1.0).abs() < 0.02 {
                unit += 1;
            } else if length != 0.0 && !length.is_nan() {
                other += 1;
            }
            for c in t.into_iter().filter(|c| !c.is_nan()) {
                found.color &= (0.0..=65_535.0).contains(&c);
                found.whole &= c.fract() == 0.0;
                found.largest = found.largest.max(c);
            }
            let [least, most] = t.iter().fold([f64::INFINITY, 0.0], |[lo, hi], c| [c.min(lo), c.max(hi)]);
            found.spread += if most >= least { most - least } else { 0.0 };
        }
        found.unit = unit > 0 && unit >= 19 * other;
        found
    }

    /// Where one column is left over: whether this triple, before it, is one, and the other, after it, less so.
    fn fits_better_than(&self, after: &Self) -> bool {
        let eight_bit = |t: &Self| t.color && t.whole && t.largest <= 255.0;
        let any = |t: &Self| t.unit || t.color;
        let greyer = !eight_bit(after) || self.spread < after.spread;
        any(self) && !any(after) || eight_bit(self) && greyer && !after.unit
    }
}

/// Where columns come from, as far as it tells what their numbers mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// Printed numbers, all held as `f64`: whole numbers and others can't be told apart by their type.
    Text,
    /// Numbers of the file's own types.
    Typed,
}

/// Points of the columns; disks, where there are valid normals and radii.
pub(crate) fn build(
    columns: Vec<Named<'_>>,
    roles: &Roles,
    source: Source,
    mut comments: Vec<String>,
    context: &mut Context<'_>,
) -> Result<Content, Fault> {
    let triple = |set: [usize; 3]| set.map(|i| columns[i].values);
    if plain_name(&columns[roles.position[0]].name).starts_with("lon") {
        let what = "x and y are degrees, by their names: it is drawn as if they were as long as z's units";
        context.note(format!("{what}; project it first, as by pdal translate"));
        comments.push(IN_DEGREES.to_owned());
    }
    let (origin, positions) = positions(triple(roles.position));
    let normals = roles.normal.map(|set| vectors_f32(triple(set)));
    let (mut colors, mut alphas) = (roles.color.map(|set| levels(triple(set), source, context)), None);
    if let Some(a) = roles.alpha {
        let values = columns[a].values;
        let scale = if values.largest() > 1.0 || values.kind() == NumberType::U8 { 255.0 } else { 1.0 };
        alphas = Some(values.map(|a| (a / scale) as f32));
    }
    let packed = roles.packed_color.and_then(|(i, alpha)| {
        let bits = columns[i].values;
        let four = matches!(bits.kind(), NumberType::I32 | NumberType::U32 | NumberType::F32);
        Some((i, alpha, bits.reinterpreted(NumberType::U32).filter(|_| four)?))
    });
    if let Some((_, alpha, bits)) = packed {
        let table = linear_of_8_bit();
        let level = |bits: u32, shift: u32| table[(bits >> shift & 255) as usize];
        colors = Some(bits.map(|b| [16, 8, 0].map(|shift| level(b as u32, shift))));
        if alpha {
            let stored = bits.map(|b| (b as u32 >> 24) as f32 / 255.0);
            // Many writers leave the alpha of all points 0, which stands for nothing.
            alphas = stored.iter().any(|a| *a != 0.0).then_some(stored);
        }
    }
    let mut radii = None;
    if let (Some(i), Some(normals)) = (roles.radius, &normals) {
        let valid = |r: &f32| *r > 0.0 && r.is_finite();
        let values = columns[i].values.map(|r| r as f32);
        let whole = values.iter().all(valid)
            && normals.iter().all(|n| n.is_finite() && *n != Vec3::ZERO)
            && positions.high().iter().all(|p| p.is_finite());
        if whole {
            radii = Some((i, values));
        } else {
            context.note("kept the radii as a column: some points have no valid position, normal or radius".into());
        }
    }
    let used = |i: usize| {
        roles.position.contains(&i)
            || roles.color.is_some_and(|s| s.contains(&i))
            || roles.normal.is_some_and(|s| s.contains(&i))
            || roles.alpha == Some(i)
            || packed.as_ref().is_some_and(|p| p.0 == i)
            || radii.as_ref().is_some_and(|r| r.0 == i)
    };
    let extras = columns
        .iter()
        .enumerate()
        .filter(|(i, _)| !used(*i))
        .map(|(_, column)| {
            let printed = source == Source::Text && column.values.largest() < f64::from(1 << 24);
            let values =
                if printed { ExtraValues::F32(column.values.map(|v| v as f32)) } else { column.values.values() };
            ExtraColumn { name: column.name.chars().filter(|c| !c.is_control()).take(60).collect(), values }
        })
        .collect();
    let normals = normals.map(Column3::from_f32);
    match (radii, normals) {
        (Some((_, radii)), Some(normals)) => context.splats(CloudData {
            colors,
            alphas,
            extras,
            comments,
            ..CloudData::new(origin, positions, Shape::Disks { normals, radii })
        }),
        (_, normals) => {
            let points =
                PointCloud { origin, positions, normals, colors, alphas, extras, comments, ..PointCloud::default() };
            context.points(points)
        }
    }
}

/// Positions; `f32` as they are, others as far as their digits mean something.
pub(crate) fn positions(columns: [Strided<'_>; 3]) -> (DVec3, Column3) {
    let narrow = |c: &Strided<'_>| {
        matches!(c.kind(), NumberType::F32 | NumberType::F16) || c.kind().is_integer() && c.kind().bytes() <= 2
    };
    let enough = || {
        let [x, y, z] = ranges(columns);
        f32_is_enough(DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1))
    };
    if columns.iter().all(narrow) || enough() {
        return (DVec3::ZERO, Column3::from_f32(vectors_f32(columns)));
    }
    strided::with_origin(columns)
}

/// Colours by what they count to.
fn levels(columns: [Strided<'_>; 3], source: Source, context: &mut Context<'_>) -> Vec<[f32; 3]> {
    if source == Source::Typed && columns.iter().all(|c| c.kind() == NumberType::U8) {
        let table = linear_of_8_bit();
        return combined(columns, |levels| levels.map(|level| table[level as usize]));
    }
    let largest = ranges(columns).iter().fold(0.0, |most: f64, range| most.max(range.1));
    let whole = source == Source::Typed && columns.iter().all(|c| c.kind().is_integer());
    let (scale, name) = match largest {
        m if m <= 1.0 && !whole => (1.0, "1"),
        m if m <= 255.0 => (255.0, "255"),
        _ => (65_535.0, "65535"),
    };
    if columns.iter().any(|c| c.kind() != NumberType::U8) {
        context.note(format!("took the colours as sRGB-encoded, from 0 to {name}"));
    }
    combined(columns, |row| row.map(|level| linear_of_level(level, scale)))
}
