//! Descriptions of a file's attributes: types, ranges, numbers of points per class, and the coordinate reference
//! system.

use glam::DVec3;
use serde_json::{Map, Value, json};
use surfel_io::Content;
use surfel_model::{CloudData, Column3, ExtraColumn, Mesh, Shape};

/// Names of the ASPRS point classes, by number, from LAS 1.4 R15, table 17. The table reserves the numbers 8 and 12;
/// they have names of older versions.
const ASPRS_CLASSES: [&str; 23] = [
    "never classified",
    "unclassified",
    "ground",
    "low vegetation",
    "medium vegetation",
    "high vegetation",
    "building",
    "low noise",
    "model key-point",
    "water",
    "rail",
    "road surface",
    "overlap",
    "wire guard",
    "wire conductor",
    "transmission tower",
    "wire connector",
    "bridge deck",
    "high noise",
    "overhead structure",
    "ignored ground",
    "snow",
    "temporal exclusion",
];

fn class_name(class: usize) -> &'static str {
    ASPRS_CLASSES.get(class).copied().unwrap_or(if class < 64 { "reserved" } else { "user-defined" })
}

/// Describes the type and the range of a column as JSON.
pub fn column(extra: &ExtraColumn) -> Value {
    let range = extra.values.range();
    json!({ "type": extra.values.type_name(), "min": range.map(|r| r.0), "max": range.map(|r| r.1) })
}

/// Returns the range of an attribute, as JSON with `min` and `max`, by its name in [`surfel_io::Loaded::attributes`].
/// Columns of the file are excluded. The limits are numbers, or arrays of one number per component. They are null for
/// attributes without an order, such as textures.
fn range(content: &Content, name: &str) -> Value {
    match content {
        Content::Splats(cloud) => of_splats(cloud.data(), name),
        Content::Points(points) => match name {
            "position" => of_column(points.origin, Some(&points.positions)),
            "normal" => of_column(DVec3::ZERO, points.normals.as_ref()),
            "colour" => of_rows(points.colors.as_deref()),
            "alpha" => of_numbers(points.alphas.as_deref()),
            _ => nothing(),
        },
        Content::Mesh(mesh) => of_mesh(mesh, name),
        Content::Octree(octree) => of_mesh(octree.mesh(), name),
        Content::Gaussians(gaussians) => {
            let data = gaussians.data();
            match name {
                "position" => of_column(data.origin, Some(&data.centers)),
                "standard deviations" => of_rows(Some(&data.sigmas)),
                "rotation" => of_rows(Some(&data.rotations)),
                "opacity" => of_numbers(Some(&data.opacities)),
                _ => nothing(),
            }
        }
    }
}

fn of_splats(data: &CloudData, name: &str) -> Value {
    match (name, &data.shape) {
        ("position", _) => of_column(data.origin, Some(&data.centers)),
        ("normal", Shape::Disks { normals, .. }) => of_column(DVec3::ZERO, Some(normals)),
        ("radius", Shape::Disks { radii, .. } | Shape::Balls { radii, .. }) => of_numbers(Some(radii)),
        ("half-axes", Shape::Ellipses { s, t }) => {
            let lengths = [s, t].into_iter().flat_map(|axis| (0..axis.len()).map(|i| axis.get(i).length()));
            spread(lengths.map(|length| [length])).map_or_else(nothing, |(lo, hi)| limits(lo[0], hi[0]))
        }
        ("shading normal", _) => of_column(DVec3::ZERO, data.shading_normals.as_ref()),
        ("colour", _) => of_rows(data.colors.as_deref()),
        ("alpha", _) => of_numbers(data.alphas.as_deref()),
        ("interior weight", _) => data.interior_weight.map_or_else(nothing, |weight| limits(weight, weight)),
        _ => nothing(),
    }
}

fn of_mesh(mesh: &Mesh, name: &str) -> Value {
    match name {
        "position" => of_column(mesh.origin, Some(&mesh.positions)),
        "normal" => of_rows(mesh.normals.as_deref()),
        "colour" => of_rows(mesh.colors.as_deref()),
        "alpha" => of_numbers(mesh.alphas.as_deref()),
        "texture coordinates" => of_rows(mesh.uvs.as_deref()),
        _ => nothing(),
    }
}

fn of_column(origin: DVec3, column: Option<&Column3>) -> Value {
    let rows = column.into_iter().flat_map(|column| (0..column.len()).map(|i| (origin + column.get(i)).to_array()));
    spread(rows).map_or_else(nothing, |(lo, hi)| limits(lo.to_vec(), hi.to_vec()))
}

fn of_rows<const N: usize>(rows: Option<&[[f32; N]]>) -> Value {
    let rows = rows.into_iter().flatten().map(|row| row.map(f64::from));
    spread(rows).map_or_else(nothing, |(lo, hi)| limits(lo.to_vec(), hi.to_vec()))
}

fn of_numbers(numbers: Option<&[f32]>) -> Value {
    let rows = numbers.into_iter().flatten().map(|number| [f64::from(*number)]);
    spread(rows).map_or_else(nothing, |(lo, hi)| limits(lo[0], hi[0]))
}

/// Returns the minimum and maximum of each component over all rows; `None` without rows. Rows with a component that
/// isn't finite are skipped.
fn spread<const N: usize>(rows: impl Iterator<Item = [f64; N]>) -> Option<([f64; N], [f64; N])> {
    rows.filter(|row| row.iter().all(|v| v.is_finite())).fold(None, |found, row| {
        let (lo, hi) = found.unwrap_or((row, row));
        Some((std::array::from_fn(|k| lo[k].min(row[k])), std::array::from_fn(|k| hi[k].max(row[k]))))
    })
}

pub(crate) fn limits(lo: impl Into<Value>, hi: impl Into<Value>) -> Value {
    json!({ "min": lo.into(), "max": hi.into() })
}

fn nothing() -> Value {
    json!({ "min": null, "max": null })
}

/// Widens an attribute's range, in JSON, so that it includes the range `other`, or zero if `other` is `None`.
pub(crate) fn widen(range: &mut Value, other: Option<&Value>) {
    let zero = json!(0.0);
    let Some(sides) = range.as_object_mut() else { return };
    for (side, pick) in [("min", f64::min as fn(f64, f64) -> f64), ("max", f64::max)] {
        let other = other.map_or(&zero, |other| &other[side]);
        let wider = |own: &Value, other: &Value| match (own.as_f64(), other.as_f64()) {
            (Some(own), Some(other)) => json!(pick(own, other)),
            (None, Some(other)) => json!(other),
            _ => own.clone(),
        };
        let widened = match sides[side].as_array() {
            Some(own) => own.iter().enumerate().map(|(k, own)| wider(own, other.get(k).unwrap_or(other))).collect(),
            None => wider(&sides[side], other),
        };
        sides[side] = widened;
    }
}

/// Returns the ranges of the attributes of a file's content, by name; for columns of the file also their types. `names`
/// are the names of all attributes, those of the columns (`extras`) last.
pub(crate) fn ranges(content: &Content, names: &[String], extras: &[ExtraColumn]) -> Map<String, Value> {
    // The last names are those of the columns, in their order.
    let (known, named) = names.split_at(names.len().saturating_sub(extras.len()));
    let columns = named.iter().cloned().zip(extras.iter().map(column));
    columns.chain(known.iter().map(|name| (name.clone(), range(content, name)))).collect()
}

/// Returns [`ranges`] of a mesh. The key `of` of each column states whether it belongs to vertices or faces.
pub(crate) fn of_mesh_with_columns(content: &Content, names: &[String], mesh: &Mesh) -> Map<String, Value> {
    let extras: Vec<ExtraColumn> = mesh.vertex_extras.iter().chain(&mesh.triangle_extras).cloned().collect();
    let mut found = ranges(content, names, &extras);
    let first = names.len().saturating_sub(extras.len());
    for (i, name) in names[first..].iter().enumerate() {
        let of = if i < mesh.vertex_extras.len() { "vertices" } else { "faces" };
        found[name.as_str()]["of"] = json!(of);
    }
    found
}

/// Returns the number of points of each class from 0 to 255, from the column "classification"; `None` without this
/// column.
pub fn class_counts(extras: &[ExtraColumn]) -> Option<[u64; 256]> {
    let extra = extras.iter().find(|e| e.name == "classification")?;
    let mut counts = [0_u64; 256];
    for i in 0..extra.values.len() {
        let class = extra.values.get(i);
        if class.fract() == 0.0 && (0.0..256.0).contains(&class) {
            counts[class as usize] += 1;
        }
    }
    Some(counts)
}

/// Lists the classes that have points, with number, name and count.
pub fn classes(counts: &[u64; 256]) -> Value {
    let found = counts.iter().enumerate().filter(|(_, n)| **n > 0);
    found.map(|(class, n)| json!({ "class": class, "name": class_name(class), "count": n })).collect()
}

/// Returns the coordinate reference system that the comments of a cloud store (docs/format.md), as JSON with `code`,
/// `name` and `wkt`. Returns null if they store none.
pub(crate) fn crs(comments: &[String]) -> Value {
    let after = |key: &str| comments.iter().find_map(|c| c.strip_prefix(key));
    let wkt = after("crs_wkt ");
    let name = wkt.and_then(|wkt| wkt.split('"').nth(1)).or_else(|| {
        // GeoTIFF ends each of its texts with a bar.
        after("crs_geotiff_text ").and_then(|texts| texts.split('|').map(str::trim).find(|text| !text.is_empty()))
    });
    match (after("crs "), name) {
        (None, None) => Value::Null,
        (code, name) => json!({ "code": code, "name": name, "wkt": wkt }),
    }
}
