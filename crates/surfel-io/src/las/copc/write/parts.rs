//! Building of octree nodes, part by part: splats, levels, and mean colours and normals. A *part* is a subtree of the
//! octree that is built in memory. A *chunk* is the compressed points of a node.

use super::grid::{Frame, Grid};
use super::layout::Layout;
use crate::error::{IoError, Problem};
use crate::las::copc::build::{Coded, Part, levels};
use crate::las::copc::octants::VoxelKey;
use crate::las::field;
use crate::las::records::{on_grid, value_of};
use ::laz::LazVlr;
use ::laz::laszip::LasZipCompressor;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::io::{self, Cursor};
use std::path::Path;
use surfel_model::{Column3, PointCloud};

/// The splat of a point: its normal and radius.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointSplat {
    /// Unit normal; zero if it couldn't be estimated.
    pub normal: [f32; 3],
    /// Radius, in the units of the file; 0 if it couldn't be estimated.
    pub radius: f32,
}

/// Callback that estimates a splat for each point of a region of the cloud, in the order of the points. An error is the
/// reason, as text for a message.
pub type Prepare<'a> = &'a (dyn Fn(&PointCloud) -> Result<Vec<PointSplat>, String> + Sync);

/// A part of the cloud in memory.
pub(super) struct Loaded {
    pub(super) part: Part,
    pub(super) records: Vec<u8>,
    /// Records of the points around the part.
    pub(super) margin: Vec<u8>,
}

/// Nodes built from a part.
pub(super) struct Made {
    pub(super) points: u64,
    /// Compressed nodes that are complete.
    pub(super) packed: Vec<Packed>,
    /// Point records of nodes above the part. Other parts have points of these nodes, too.
    pub(super) upper: Vec<(VoxelKey, Vec<u8>)>,
}

/// Settings for building nodes; shared by threads that build several parts at once.
pub(super) struct Maker<'a> {
    pub(super) prepare: Option<Prepare<'a>>,
    pub(super) layout: &'a Layout,
    /// Position of the scanner, if one scanner recorded all points.
    pub(super) viewpoint: Option<DVec3>,
    pub(super) grid: Grid,
    /// Path of the first input, for error messages.
    pub(super) input: &'a Path,
}

impl Maker<'_> {
    /// Assigns octree levels to the points of a part ([`levels`]) and compresses the nodes inside it. Nodes above the
    /// part are returned uncompressed, in [`Made::upper`]. `taken` contains the level and Morton code of each cell
    /// larger than the part for which a point is already selected; this call adds its own.
    pub(super) fn make(&self, frame: &Frame, loaded: &Loaded, taken: &mut HashSet<VoxelKey>) -> io::Result<Made> {
        let Layout { template, laz, sorted_bytes: size, adds_normals, .. } = self.layout;
        let (size, Loaded { part, records, margin }) = (*size, loaded);
        let splats = self.splats(records, margin)?;
        let mut coded: Vec<Coded> = records
            .par_chunks_exact(size)
            .enumerate()
            .map(|(i, record)| (frame.code(self.grid.units(position(record))), i as u32))
            .collect();
        coded.par_sort_unstable();
        let color_at = (template.format >= 7).then_some(30);
        let mut filtered = LevelMeans { records, size, color_at, splats: splats.as_deref(), of: HashMap::new() };
        let level_of = levels(&coded, part, taken, &mut |i, group| {
            filtered.add(coded[i].1, coded[group].iter().map(|point| point.1));
        });
        let mut nodes: BTreeMap<VoxelKey, Vec<u32>> = BTreeMap::new();
        for ((code, i), level) in coded.iter().zip(&level_of) {
            let level = u32::from(*level);
            let key = VoxelKey { level: frame.bits, code: *code }.at_level(level);
            nodes.entry(key).or_default().push(*i);
        }
        drop((coded, level_of));
        let whole = |key: VoxelKey, mut indices: Vec<u32>| {
            // Points in scan order compress best.
            indices.sort_unstable();
            let mut bytes = Vec::with_capacity(indices.len() * (size + template.extra_bytes));
            for i in indices {
                bytes.extend_from_slice(&records[i as usize * size..][..size]);
                filtered.write(i, *adds_normals, &mut bytes);
            }
            (key, bytes)
        };
        let made: Vec<_> = nodes.into_par_iter().map(|(key, indices)| whole(key, indices)).collect();
        let (inner, upper): (Vec<_>, Vec<_>) = made.into_iter().partition(|(key, _)| key.level >= part.depth);
        Ok(Made { points: (records.len() / size) as u64, packed: packed(inner, laz)?, upper })
    }

    /// Estimates a splat for each point of `records`, with the points of `margin` as additional neighbours. Withheld
    /// points get zeros. Returns `None` if the conversion estimates no splats.
    pub(super) fn splats(&self, records: &[u8], margin: &[u8]) -> io::Result<Option<Vec<PointSplat>>> {
        let Some(prepare) = self.prepare else { return Ok(None) };
        let Layout { template, sorted_bytes, normals, .. } = self.layout;
        let rows = || records.chunks_exact(*sorted_bytes);
        let kept = || rows().chain(margin.chunks_exact(*sorted_bytes)).filter(|record| !is_withheld(record));
        let grid: Vec<[i32; 3]> = kept().map(position).collect();
        let (origin, positions) = on_grid(grid, template.scale.into(), template.offset.into());
        let normals = normals.map(|fields| {
            let of = |r: &[u8]| fields.map(|(at, kind, scale, offset)| value_of(kind)(&r[at..]) * scale + offset);
            Column3::from_f32(kept().map(|r| DVec3::from(of(r)).as_vec3()).collect())
        });
        let cloud = PointCloud { origin, positions, normals, viewpoint: self.viewpoint, ..PointCloud::default() };
        let unsuitable = |why: String| {
            let problem = Problem::new(format!("has points that no splats can be made of: {why}"));
            io::Error::other(IoError::Invalid { path: self.input.to_path_buf(), problem: Box::new(problem) })
        };
        let made = if cloud.is_empty() { Vec::new() } else { prepare(&cloud).map_err(unsuitable)? };
        if made.len() != cloud.len() {
            return Err(io::Error::other("a part of the cloud has fewer splats than points"));
        }
        let mut made = made.into_iter();
        let next = |r: &[u8]| if is_withheld(r) { PointSplat::default() } else { made.next().unwrap_or_default() };
        Ok(Some(rows().map(next).collect()))
    }
}

pub(super) fn is_withheld(record: &[u8]) -> bool {
    record[15] & 4 != 0
}

/// Compresses point records to one LAZ chunk, and returns its bytes.
pub(super) fn pack(points: &[u8], laz: &LazVlr) -> io::Result<Vec<u8>> {
    let other = |e: ::laz::LasZipError| io::Error::other(e.to_string());
    let mut compressor = LasZipCompressor::new(Cursor::new(Vec::new()), laz.clone()).map_err(other)?;
    compressor.compress_many(points)?;
    compressor.finish_current_chunk()?;
    // The first 8 bytes are the offset of a chunk table, which only the whole file has.
    Ok(compressor.into_inner().into_inner().split_off(8))
}

/// A compressed node.
pub(super) struct Packed {
    pub(super) key: VoxelKey,
    /// Number of points.
    pub(super) points: u64,
    /// Bytes of the chunk.
    pub(super) bytes: Vec<u8>,
}

/// Compresses nodes to chunks, in parallel.
pub(super) fn packed(nodes: Vec<(VoxelKey, Vec<u8>)>, laz: &LazVlr) -> io::Result<Vec<Packed>> {
    let size = laz.items_size() as usize;
    let packed = nodes.into_par_iter().map(|(key, records)| {
        let points = (records.len() / size) as u64;
        Ok(Packed { key, points, bytes: pack(&records, laz)? })
    });
    packed.collect()
}

/// Mean colours and normals of groups of points, each of which is represented by one point at its level.
pub(super) struct LevelMeans<'a> {
    pub(super) records: &'a [u8],
    pub(super) size: usize,
    pub(super) color_at: Option<usize>,
    pub(super) splats: Option<&'a [PointSplat]>,
    /// Mean colour, in 16-bit sRGB levels, and mean normal, in units of 1/127, by the index of the representing point.
    pub(super) of: HashMap<u32, ([u16; 3], [i8; 3])>,
}

impl LevelMeans<'_> {
    pub(super) fn record(&self, i: u32) -> &[u8] {
        &self.records[i as usize * self.size..][..self.size]
    }

    pub(super) fn color(&self, i: u32) -> [u16; 3] {
        let at = self.color_at.unwrap_or(0);
        [0, 2, 4].map(|k| u16::from_le_bytes(field(self.record(i), at + k)))
    }

    pub(super) fn normal(&self, i: u32) -> [f32; 3] {
        self.splats.map_or([0.0; 3], |splats| splats[i as usize].normal)
    }

    /// Stores the mean colour and mean normal of `others`: the points that point `i` represents, including `i` itself.
    /// Withheld points don't count. Stores nothing if fewer than two points count: point `i` then has its own values.
    pub(super) fn add(&mut self, i: u32, others: impl Iterator<Item = u32>) {
        let own = glam::Vec3::from(self.normal(i));
        let (mut count, mut color, mut normal) = (0_u64, [0.0_f64; 3], glam::Vec3::ZERO);
        let table = crate::color::linear_of_16_bit();
        for other in others.filter(|other| !is_withheld(self.record(*other))) {
            count += 1;
            if self.color_at.is_some() {
                let levels = self.color(other);
                (0..3).for_each(|k| color[k] += f64::from(table[usize::from(levels[k])]));
            }
            let n = glam::Vec3::from(self.normal(other));
            // The two sides of a thin sheet must not cancel.
            normal += if n.dot(own) < 0.0 { -n } else { n };
        }
        if count > 1 {
            let color = color.map(|sum| (surfel_math::srgb::encode(sum / count as f64) * 65_535.0).round() as u16);
            self.of.insert(i, (color, eight_bits(normal.normalize_or_zero().to_array())));
        }
    }

    /// Appends Surfel's extra bytes of point `i` to `out`.
    pub(super) fn write(&self, i: u32, adds_normals: bool, out: &mut Vec<u8>) {
        let filtered = self.of.get(&i);
        if let Some(splats) = self.splats {
            let splat = &splats[i as usize];
            // The radius is stored with only eight bits of its mantissa, because the zeros after them compress to
            // nothing. It is rounded up so that no hole opens.
            let bits = splat.radius.to_bits();
            out.extend_from_slice(&(bits.saturating_add(0x7fff) & 0xffff_8000).to_le_bytes());
            let own = eight_bits(splat.normal);
            let bytes = |n: [i8; 3]| n.map(|v| v as u8);
            if adds_normals {
                out.extend_from_slice(&bytes(own));
            }
            out.extend_from_slice(&bytes(filtered.map_or(own, |f| f.1)));
        }
        if self.color_at.is_some() {
            let color = filtered.map_or_else(|| self.color(i), |f| f.0);
            color.iter().for_each(|level| out.extend_from_slice(&level.to_le_bytes()));
        }
    }
}

pub(super) fn eight_bits(normal: [f32; 3]) -> [i8; 3] {
    normal.map(|v| (v * 127.0).round() as i8)
}

pub(super) fn position(record: &[u8]) -> [i32; 3] {
    [0, 4, 8].map(|at| i32::from_le_bytes(field(record, at)))
}
