//! What is said about a cloud's named columns: their types and ranges, how many points each class has, and
//! the coordinate reference system.

use serde_json::{Value, json};
use surfel_model::ExtraColumn;

/// Names of the classes of LAS 1.4 R15, table 17; those of older versions where it reserves them (8 and 12).
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

/// Name, type and range of each column.
pub(crate) fn columns(extras: &[ExtraColumn]) -> Value {
    let column = |extra: &ExtraColumn| {
        let range = extra.values.range();
        json!({ "name": extra.name.escape_debug().to_string(), "type": extra.values.type_name(),
                "min": range.map(|r| r.0), "max": range.map(|r| r.1) })
    };
    extras.iter().map(column).collect()
}

/// How many points each class has that has any, by the column "classification".
pub(crate) fn classes(extras: &[ExtraColumn]) -> Value {
    let Some(extra) = extras.iter().find(|e| e.name == "classification") else { return Value::Null };
    let mut counts = [0_u64; 256];
    for i in 0..extra.values.len() {
        let class = extra.values.get(i);
        if class.fract() == 0.0 && (0.0..256.0).contains(&class) {
            counts[class as usize] += 1;
        }
    }
    let found = counts.iter().enumerate().filter(|(_, n)| **n > 0);
    found.map(|(class, n)| json!({ "class": class, "name": class_name(class), "count": n })).collect()
}

/// The coordinate reference system that comments carry (docs/format.md).
pub(crate) fn crs(comments: &[String]) -> Value {
    let after = |key: &str| comments.iter().find_map(|c| c.strip_prefix(key));
    let wkt = after("crs_wkt ");
    let name = wkt.and_then(|wkt| wkt.split('"').nth(1)).or_else(|| {
        // GeoTIFF ends each of its texts by a bar.
        after("crs_geotiff_text ").and_then(|texts| texts.split('|').map(str::trim).find(|text| !text.is_empty()))
    });
    match (after("crs "), name) {
        (None, None) => Value::Null,
        (code, name) => json!({ "code": code, "name": name, "wkt": wkt }),
    }
}
