//! Conversion of number columns to points. Names state the columns' roles; [`crate::column_roles`] detects the roles of
//! columns without names.
//!
//! Colours are values that a program displayed, so they are sRGB-encoded, whether they range to 255, to 65535 or to 1.

#![cfg_attr(not(all(feature = "npy", feature = "pcd", feature = "points")), allow(dead_code))]

use crate::color::{linear_of_8_bit, linear_of_level};
use crate::column_roles::{self, Part, ROUNDED_ONE, Role};
use crate::columns::f32_is_enough;
use crate::content::Content;
use crate::context::Context;
use crate::crs::IN_DEGREES;
use crate::error::{Fault, Problem};
use crate::strided::{self, NumberType, Strided, combined, ranges, vectors_f32};
use glam::{DVec3, Vec3};
use surfel_model::{CloudData, Column3, ExtraColumn, ExtraValues, PointCloud, Shape};

/// A column and its name, which is empty if the file states none.
pub(crate) struct Named<'a> {
    pub(crate) name: String,
    pub(crate) values: Strided<'a>,
}

/// Names of position columns, compared without case, units and quotes, in order of priority.
pub(crate) const POSITIONS: [[&str; 3]; 17] = [
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
pub(crate) const COLORS: [[&str; 3]; 6] = [
    ["red", "green", "blue"],
    ["r", "g", "b"],
    ["diffuse_red", "diffuse_green", "diffuse_blue"],
    ["color_r", "color_g", "color_b"],
    ["rf", "gf", "bf"],
    ["scan_red", "scan_green", "scan_blue"],
];
pub(crate) const NORMALS: [[&str; 3]; 5] = [
    ["nx", "ny", "nz"],
    ["normal_x", "normal_y", "normal_z"],
    ["normalx", "normaly", "normalz"],
    ["normals_x", "normals_y", "normals_z"],
    ["n_x", "n_y", "n_z"],
];

/// Names of position vectors whose components are separate columns, such as `points_0`, `points_1` and `points_2`.
const POSITION_VECTORS: [&str; 11] = [
    "points",
    "point",
    "points_m_xyz",
    "points_xyz",
    "xyz",
    "coordinates",
    "coords",
    "position",
    "positions",
    "pose_position",
    "center",
];
/// Names of colour vectors whose components are separate columns.
const COLOR_VECTORS: [&str; 7] = ["rgb", "rgba", "color", "colors", "colour", "colours", "rgb_color"];
/// Names of normal vectors whose components are separate columns.
const NORMAL_VECTORS: [&str; 4] = ["normals", "normal", "point_normals", "n"];

/// Roles of the columns of a point file, as column indices. Columns without a role become extra columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Roles {
    pub(crate) position: [usize; 3],
    pub(crate) color: Option<[usize; 3]>,
    /// Column with red, green and blue packed into one number, and true if the number includes an alpha.
    pub(crate) packed_color: Option<(usize, bool)>,
    pub(crate) normal: Option<[usize; 3]>,
    pub(crate) alpha: Option<usize>,
    pub(crate) radius: Option<usize>,
}

impl Roles {
    /// Assigns roles by the columns' names; returns `None` if no position is among them.
    pub(crate) fn by_name<'a>(names: impl IntoIterator<Item = &'a str>) -> Option<Self> {
        let names: Vec<String> = names.into_iter().map(plain_name).collect();
        let find = |name: &str| names.iter().position(|n| n == name);
        let set = |sets: &[[&str; 3]]| sets.iter().find_map(|[a, b, c]| Some([find(a)?, find(b)?, find(c)?]));
        let vectors = |bases: &[&str]| bases.iter().find_map(|base| numbered(&names, base));
        let color = set(&COLORS).or_else(|| vectors(&COLOR_VECTORS));
        let packed = || find("rgb").map(|i| (i, false)).or_else(|| find("rgba").map(|i| (i, true)));
        Some(Self {
            position: set(&POSITIONS).or_else(|| vectors(&POSITION_VECTORS))?,
            color,
            packed_color: if color.is_none() { packed() } else { None },
            normal: set(&NORMALS).or_else(|| vectors(&NORMAL_VECTORS)),
            alpha: find("alpha").or_else(|| color.and_then(|_| find("a"))),
            radius: find("radius").or_else(|| find("radii")),
        })
    }

    /// Detects the roles of columns from their values. Also returns the decisive reasons, as text for a note. Renames
    /// all columns to their roles, or to `column_N` with their numbers in the file, `numbers`. The second column of a
    /// name gets the ending `_2`.
    ///
    /// # Errors
    /// [`Problem`] if the rows are camera poses.
    pub(crate) fn by_content(columns: &mut [Named<'_>], numbers: &[usize]) -> Result<(Self, Vec<String>), Problem> {
        let values: Vec<Strided<'_>> = columns.iter().map(|c| c.values).collect();
        let layout = column_roles::choose(&values, numbers)?;
        let mut roles = Self { position: [0, 1, 2], ..Self::default() };
        let mut used: Vec<String> = Vec::new();
        for Part { role, first } in layout.parts {
            let triple = [first, first + 1, first + 2];
            match role {
                Role::Position => roles.position = triple,
                Role::Normal => roles.normal = Some(triple),
                Role::Color => roles.color = Some(triple),
                Role::Alpha => roles.alpha = Some(first),
                _ => {}
            }
            for (i, name) in role.names().iter().enumerate() {
                let count = used.iter().filter(|other| other == name).count();
                used.push((*name).to_owned());
                columns[first + i].name = match (*name, count) {
                    ("", _) => format!("column_{}", numbers.get(first + i).copied().unwrap_or(first + i + 1)),
                    (name, 0) => name.to_owned(),
                    (name, count) => format!("{name}_{}", count + 1),
                };
            }
        }
        Ok((roles, layout.reasons))
    }

    /// True if there are normals and radii, so that the points are splats.
    #[cfg(feature = "laz")]
    pub(crate) fn are_splats(&self) -> bool {
        self.radius.is_some() && self.normal.is_some()
    }
}

/// Returns a column's name for comparisons: in lower case, without quotes, unit and comment characters. Blanks,
/// hyphens, points and colons become underscores.
pub(crate) fn plain_name(name: &str) -> String {
    let name = name.trim_matches(|c: char| c.is_whitespace() || matches!(c, '"' | '\'' | '/' | '#'));
    let name = name.split(['[', '(']).next().unwrap_or(name).trim();
    name.to_ascii_lowercase().replace([' ', '-', '.', ':'], "_")
}

/// Returns the columns with the components of a vector: `BASE:0`, `BASE:1` and `BASE:2`, as ParaView, VeloView and
/// LidarView name them, or `BASE_X`, `BASE_Y` and `BASE_Z`.
fn numbered(names: &[String], base: &str) -> Option<[usize; 3]> {
    let endings = [["0", "1", "2"], ["x", "y", "z"]];
    let find = |ending: &str| {
        names.iter().position(|name| name.strip_prefix(base).is_some_and(|rest| rest.strip_prefix('_') == Some(ending)))
    };
    endings.iter().find_map(|[a, b, c]| Some([find(a)?, find(b)?, find(c)?]))
}

/// Kind of file from which columns were read, which affects the meaning of their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// A text file: all numbers are stored as `f64`, so that their type doesn't distinguish whole numbers from others.
    Text,
    /// A binary file: numbers have the types that the file states.
    Typed,
}

/// Builds a point cloud from columns; or a cloud of disks, if all points have a valid position, normal and radius.
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
    if triple(roles.position).iter().all(|c| c.kind() == NumberType::F32) {
        context.note_rounding(positions.high());
    }
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
            alphas = Some(bits.map(|b| (b as u32 >> 24) as f32 / 255.0));
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
    // Without normals, radii are stored as point sizes and also as an extra column.
    let sizes = roles.radius.filter(|_| normals.is_none()).map(|i| columns[i].values.map(|r| r as f32));
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
        (_, normals) => context.points(PointCloud {
            origin,
            positions,
            normals,
            colors,
            alphas,
            radii: sizes,
            extras,
            comments,
            ..PointCloud::default()
        }),
    }
}

/// Converts three columns to positions. Returns an origin, and positions relative to it. The origin is 0 and the
/// positions are rounded to f32 if no digits are lost, or if [`f32_is_enough`]. Otherwise the positions keep digits
/// beyond f32.
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

/// Converts three columns of colours to linear light. Their range is determined by their type and largest value.
fn levels(columns: [Strided<'_>; 3], source: Source, context: &mut Context<'_>) -> Vec<[f32; 3]> {
    if source == Source::Typed && columns.iter().all(|c| c.kind() == NumberType::U8) {
        let table = linear_of_8_bit();
        return combined(columns, |levels| levels.map(|level| table[level as usize]));
    }
    let largest = ranges(columns).iter().fold(0.0, |most: f64, range| most.max(range.1));
    let whole = source == Source::Typed && columns.iter().all(|c| c.kind().is_integer());
    let (scale, name) = match largest {
        m if m <= ROUNDED_ONE && !whole => (1.0, "1"),
        m if m <= 255.0 => (255.0, "255"),
        _ => (65_535.0, "65535"),
    };
    if columns.iter().any(|c| c.kind() != NumberType::U8) {
        context.note(format!("took the colours as sRGB-encoded, from 0 to {name}"));
    }
    combined(columns, |row| row.map(|level| linear_of_level(level, scale)))
}
