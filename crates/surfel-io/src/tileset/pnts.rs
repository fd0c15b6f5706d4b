//! Reader of `pnts`, the point tiles of 3D Tiles 1.0: a header, a feature table and a batch table.

use crate::color::linear_of_unit;
use crate::columns::f32_step;
use crate::error::{Fault, Location, Problem};
use crate::gathered_points::PointsPart;
use crate::scene_file::json_problem;
use glam::{DAffine3, DVec3};
use serde_json::Value;
use surfel_model::{ExtraColumn, ExtraValues};

const HEADER: usize = 28;

/// A feature table or batch table: JSON with the offsets of columns, and the bytes that contain the columns.
struct Table<'a> {
    json: Value,
    body: &'a [u8],
}

/// Reads the points of a `pnts` tile, and transforms them to world space.
pub(super) fn read(bytes: &[u8], world_from_tile: DAffine3) -> Result<PointsPart, Fault> {
    let words = bytes.get(4..HEADER).map(|raw| raw.as_chunks::<4>().0);
    let Some(&[version, _, json, binary, batch_json, batch_binary]) = words.and_then(|w| w.first_chunk::<6>()) else {
        return Err(cut().into());
    };
    let version = u32::from_le_bytes(version);
    if version != 1 {
        let problem = Problem::new(format!("is a pnts tile of version {version}")).at(Location::Byte(4));
        return Err(problem.expected("version 1").into());
    }
    let mut at = HEADER;
    let mut take = |length: [u8; 4]| {
        let start = at;
        at = start.checked_add(u32::from_le_bytes(length) as usize)?;
        bytes.get(start..at)
    };
    let (features, body) = (take(json), take(binary));
    let (batch, batch_body) = (take(batch_json), take(batch_binary));
    let (Some(features), Some(body)) = (features, body) else { return Err(cut().into()) };
    let features = Table { json: parse(features)?, body };
    let mut part = features.points()?;
    if let (Some(batch), Some(body)) = (batch, batch_body) {
        let table = Table { json: parse(batch)?, body };
        // If points have batch ids, rows of the batch table belong to groups of points.
        if features.json.get("BATCH_ID").is_none() {
            part.extras = table.columns(part.positions.len());
        }
    }
    part.place(world_from_tile);
    Ok(part)
}

fn cut() -> Problem {
    Problem::new("is a pnts tile that is cut off").help("copy or export the file again: it is incomplete")
}

fn parse(json: &[u8]) -> Result<Value, Problem> {
    let json = json.trim_ascii();
    if json.is_empty() { Ok(Value::Null) } else { serde_json::from_slice(json).map_err(|e| json_problem(&e)) }
}

fn numbers<const N: usize>(of: &Value) -> Option<[f64; N]> {
    let found: Option<Vec<f64>> = of.as_array()?.iter().map(Value::as_f64).collect();
    found?.try_into().ok()
}

impl<'a> Table<'a> {
    /// Returns the bytes of a table's column with `count` rows of `size` bytes; `None` if there is no such column.
    fn column(&self, name: &str, count: usize, size: usize) -> Result<Option<&'a [u8]>, Problem> {
        let Some(property) = self.json.get(name) else { return Ok(None) };
        let start = property.get("byteOffset").and_then(Value::as_u64).and_then(|o| usize::try_from(o).ok());
        let data = start.and_then(|start| self.body.get(start..)?.get(..count.checked_mul(size)?));
        let what = || Problem::new(format!("{name} of {count} points reaches beyond the tile"));
        data.map(Some).ok_or_else(|| what().help("copy or export the file again: it is damaged"))
    }

    fn points(&self) -> Result<PointsPart, Problem> {
        if self.json.pointer("/extensions/3DTILES_draco_point_compression").is_some() {
            let problem = Problem::new("is a pnts tile that is compressed by Draco, which is not read");
            return Err(problem.help("export the tileset as 3D Tiles 1.1, or its points as LAZ"));
        }
        let count = self.json.get("POINTS_LENGTH").and_then(Value::as_u64).and_then(|n| usize::try_from(n).ok());
        let count = count.ok_or_else(|| Problem::new("the pnts tile has no POINTS_LENGTH"))?;
        let center = self.json.get("RTC_CENTER").and_then(numbers).map_or(DVec3::ZERO, DVec3::from_array);
        let mut step = 0.0;
        let positions = if let Some(raw) = self.column("POSITION", count, 12)? {
            let finite = floats(raw).flatten().filter(|c| c.is_finite());
            step = f32_step(finite.fold(0.0, |most: f32, c| most.max(c.abs())).into());
            floats(raw).map(|p| center + DVec3::from(p.map(f64::from))).collect()
        } else if let Some(raw) = self.column("POSITION_QUANTIZED", count, 6)? {
            let of = |key: &str| self.json.get(key).and_then(numbers).map(DVec3::from_array);
            let (Some(offset), Some(scale)) = (of("QUANTIZED_VOLUME_OFFSET"), of("QUANTIZED_VOLUME_SCALE")) else {
                return Err(Problem::new("POSITION_QUANTIZED lacks its volume")
                    .expected("QUANTIZED_VOLUME_OFFSET and QUANTIZED_VOLUME_SCALE"));
            };
            let steps = raw.as_chunks::<6>().0.iter().map(|&[a, b, c, d, e, f]| [[a, b], [c, d], [e, f]]);
            steps
                .map(|p| DVec3::from(p.map(|raw| f64::from(u16::from_le_bytes(raw)) / 65_535.0)))
                .map(|p| center + offset + p * scale)
                .collect()
        } else {
            return Err(Problem::new("the pnts tile has no positions").expected("POSITION or POSITION_QUANTIZED"));
        };
        let (normals, colors) = (self.normals(count)?, self.colors(count)?);
        Ok(PointsPart { positions, normals, colors, extras: Vec::new(), step })
    }

    fn normals(&self, count: usize) -> Result<Option<Vec<[f32; 3]>>, Problem> {
        if let Some(raw) = self.column("NORMAL", count, 12)? {
            return Ok(Some(floats(raw).collect()));
        }
        let packed = self.column("NORMAL_OCT16P", count, 2)?;
        let unpack = |&[x, y]: &[u8; 2]| octahedral(x, y);
        Ok(packed.map(|raw| raw.as_chunks::<2>().0.iter().map(unpack).collect()))
    }

    /// Returns the colours of `count` points as linear RGB and alpha, or `None` if the tile has none. Stored levels are
    /// sRGB-encoded.
    fn colors(&self, count: usize) -> Result<Option<Vec<[f32; 4]>>, Problem> {
        let linear = |level: u32, most: u32| linear_of_unit(f64::from(level) / f64::from(most));
        let of_bytes = |&[r, g, b]: &[u8; 3]| [r, g, b].map(|c| linear(c.into(), 255));
        if let Some(raw) = self.column("RGBA", count, 4)? {
            let rgba = |&[r, g, b, a]: &[u8; 4]| with_alpha(of_bytes(&[r, g, b]), f32::from(a) / 255.0);
            return Ok(Some(raw.as_chunks::<4>().0.iter().map(rgba).collect()));
        }
        if let Some(raw) = self.column("RGB", count, 3)? {
            return Ok(Some(raw.as_chunks::<3>().0.iter().map(|c| with_alpha(of_bytes(c), 1.0)).collect()));
        }
        if let Some(raw) = self.column("RGB565", count, 2)? {
            let unpack = |&raw: &[u8; 2]| {
                let bits = u32::from(u16::from_le_bytes(raw));
                with_alpha([linear(bits >> 11, 31), linear(bits >> 5 & 63, 63), linear(bits & 31, 31)], 1.0)
            };
            return Ok(Some(raw.as_chunks::<2>().0.iter().map(unpack).collect()));
        }
        let constant = self.json.get("CONSTANT_RGBA").and_then(numbers::<4>);
        Ok(constant.map(|[r, g, b, a]| {
            vec![with_alpha([r, g, b].map(|c| linear_of_unit(c / 255.0)), (a / 255.0) as f32); count]
        }))
    }

    /// Returns the columns of a batch table that have one number per point, under the first 60 characters of the file's
    /// names. Columns of other types, columns stored as JSON, and damaged ones are dropped.
    fn columns(&self, count: usize) -> Vec<ExtraColumn> {
        let Some(properties) = self.json.as_object() else { return Vec::new() };
        let mut found = Vec::new();
        for (name, property) in properties {
            let text = |key: &str| property.get(key).and_then(Value::as_str);
            let (Some("SCALAR"), Some(kind)) = (text("type"), text("componentType")) else { continue };
            let read = || -> Option<ExtraValues> {
                macro_rules! column {
                    ($t:ty, $variant:ident) => {{
                        let raw = self.column(name, count, size_of::<$t>()).ok()??;
                        let (values, _) = raw.as_chunks::<{ size_of::<$t>() }>();
                        Some(ExtraValues::$variant(values.iter().map(|&v| <$t>::from_le_bytes(v)).collect()))
                    }};
                }
                match kind {
                    "BYTE" => column!(i8, I8),
                    "UNSIGNED_BYTE" => column!(u8, U8),
                    "SHORT" => column!(i16, I16),
                    "UNSIGNED_SHORT" => column!(u16, U16),
                    "INT" => column!(i32, I32),
                    "UNSIGNED_INT" => column!(u32, U32),
                    "FLOAT" => column!(f32, F32),
                    "DOUBLE" => column!(f64, F64),
                    _ => None,
                }
            };
            if let Some(values) = read() {
                found.push(ExtraColumn { name: name.chars().take(60).collect(), values });
            }
        }
        found
    }
}

fn floats(raw: &[u8]) -> impl Iterator<Item = [f32; 3]> + use<'_> {
    let triple = |&[a, b, c, d, e, f, g, h, i, j, k, l]: &[u8; 12]| {
        [[a, b, c, d], [e, f, g, h], [i, j, k, l]].map(f32::from_le_bytes)
    };
    raw.as_chunks::<12>().0.iter().map(triple)
}

fn with_alpha([r, g, b]: [f32; 3], alpha: f32) -> [f32; 4] {
    [r, g, b, alpha]
}

/// Decodes a unit normal from two bytes (Cigolle 2014, "oct16").
fn octahedral(x: u8, y: u8) -> [f32; 3] {
    let [x, y] = [x, y].map(|v| f32::from(v) / 255.0 * 2.0 - 1.0);
    let z = 1.0 - x.abs() - y.abs();
    let fold = |a: f32, b: f32| if z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
    glam::Vec3::new(fold(x, y), fold(y, x), z).normalize_or_zero().to_array()
}
