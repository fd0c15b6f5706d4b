//! Reading of a COPC file's hierarchy and of selected nodes. A *chunk* is the compressed points of a node.

use super::super::header::{ExtraField, Header, POINT_BYTES};
use super::super::laz::{checked_vlr, chunk_points, decode_some, leave_out, of_splats};
use super::super::records::{Columns, value_of};
use super::super::{field, finish, unreadable};
use super::cache::{Decoded, FileState, NodeCache};
use super::octants::{cell, code};
use super::{ENTRY_BYTES, INFO_AT, INFO_BYTES, LEVEL_COLORS, LEVEL_NORMALS, NORMALS, RADIUS};
use crate::RegularFile;
use crate::content::{Content, LoadOptions};
use crate::error::{IoError, Location, Problem, READ};
use crate::format::Format;
use crate::loaded::{self, Loaded};
use crate::survey::Source;
use ::laz::{DecompressionSelection, LazVlr};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

/// Maximum number of compressed bytes, and of decompressed bytes, of nodes that are decoded together. A single larger
/// node is decoded alone.
const GROUP_BYTES: (u64, u64) = (16 << 20, 48 << 20);

/// Largest supported level of a node; the root has level 0. Files with deeper nodes are refused.
const MAX_LEVEL: u32 = super::octants::BITS;

/// A node of the octree in a COPC file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CopcNode {
    /// Level of the node in the octree; the root is at level 0, and each level halves the cubes.
    pub level: u32,
    /// Position of the node's cube among those of its level, counted in cubes along x, y and z: the `VoxelKey` of COPC.
    pub cell: [u32; 3],
    /// Size of the node's chunk of compressed points, in bytes.
    pub bytes: u64,
    /// Number of points in the node's chunk, without those of ancestors or descendants.
    pub points: u64,
    /// Range of the child nodes' indices among [`Copc::nodes`]; at most 8.
    pub children: Range<u32>,
    /// Byte offset of the node's chunk in the file.
    at: u64,
}

/// An open COPC file: its header and hierarchy are read, its points aren't.
#[derive(Debug)]
pub struct Copc {
    file: Arc<FileState>,
    cache: Option<Arc<NodeCache>>,
    header_points: u64,
    has_colors: bool,
    has_splats: bool,
    center: DVec3,
    half: f64,
    spacing: f64,
    nodes: Vec<CopcNode>,
}

/// Selection of the point columns that are read from nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeColumns<'a> {
    /// All columns of the points.
    All,
    /// Only the columns that splats are made of: positions, colours, normals and extra bytes. The slice states for each
    /// node, by index, which colours and normals are read; nodes beyond its end get [`LevelValues::Without`]. Columns
    /// that aren't read are zero.
    Splats(&'a [LevelValues]),
}

/// Selection of the colours and normals that are read: a point's own, or the mean of the points that it represents at
/// its level ([`LEVEL_COLORS`], [`LEVEL_NORMALS`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LevelValues {
    /// Each point's own colours and normals, without the mean values of its level.
    #[default]
    Without,
    /// Each point's own colours and normals, and the mean values of its level.
    With,
    /// Only the mean values of the level; own values if the file has no mean values.
    Alone,
}

impl NodeColumns<'_> {
    /// Returns the fields to decode for the points of the node with index `node`.
    fn of(self, node: u32) -> Decoded {
        match self {
            Self::All => Decoded::All,
            Self::Splats(values) => Decoded::Splats(values.get(node as usize).copied().unwrap_or_default()),
        }
    }
}

/// Filter for points: returns true for a point that is read. Its arguments are the level of the point's node, the
/// point's position, and its radius, in the file's units. The radius is 0 if the file states none.
pub type PointFilter<'a> = &'a (dyn Fn(u32, DVec3, f64) -> bool + Sync);

/// Points of a selection of nodes.
#[derive(Clone, Debug)]
pub struct NodePoints {
    /// The points as a point cloud, with notes and coordinate reference system as for any loaded file.
    pub loaded: Loaded,
    /// For each node that was read, in the requested order, the number of points of this node and those before it.
    /// These are the ends of the nodes' ranges in the cloud.
    pub ends: Vec<usize>,
}

impl Copc {
    /// Opens a file and reads its hierarchy; returns `None` if it isn't a COPC file.
    ///
    /// # Errors
    /// [`IoError`] if the file can't be read, its hierarchy doesn't fit the file, or the hierarchy isn't a tree.
    pub fn open(path: &Path) -> Result<Option<Self>, IoError> {
        let system = |source| IoError::System { path: path.to_path_buf(), action: READ, source };
        let Some(mut file) = RegularFile::open(path).map_err(system)? else { return Ok(None) };
        let mut head = Vec::new();
        (&mut file).take(512).read_to_end(&mut head).map_err(system)?;
        if Format::from_seekable_signature(&head) != Some(Format::Copc) {
            return Ok(None);
        }
        let read = Self::read(path, &mut file);
        read.map(Some).map_err(|problem| IoError::Invalid { path: path.to_path_buf(), problem: Box::new(problem) })
    }

    fn read(path: &Path, file: &mut RegularFile) -> Result<Self, Problem> {
        let file_bytes = file.file_bytes();
        let header = Header::read(file, file_bytes)?;
        let mut info = [0; INFO_BYTES];
        file.seek(SeekFrom::Start(INFO_AT as u64)).map_err(unreadable)?;
        file.read_exact(&mut info).map_err(unreadable)?;
        let number = |i: usize| f64::from_le_bytes(field(&info, 8 * i));
        let center = DVec3::new(number(0), number(1), number(2));
        let (half, spacing) = (number(3), number(4));
        let is_size = |v: f64| v > 0.0 && v.is_finite();
        if !center.is_finite() || !is_size(half) || !is_size(spacing) {
            let what = format!("has an octree about {center} of half-size {half} and spacing {spacing}");
            let problem = Problem::new(what).at(Location::Byte(INFO_AT));
            return Err(problem.expected("finite numbers, and sizes greater than 0"));
        }
        let root = [40, 48].map(|at| u64::from_le_bytes(field(&info, at)));
        let pages = Pages { header: &header, file_bytes, entries: BTreeMap::new(), points_bytes: 0 };
        let nodes = pages.read(file, root)?;
        let file = Arc::new(FileState::of_opened(path, file));
        let has_colors = header.format >= 7;
        let has = |name: &str| header.extra.iter().any(|extra| extra.name == name);
        let has_splats = has(RADIUS) && NORMALS.iter().all(|name| has(name));
        let header_points = header.count;
        Ok(Self { file, cache: None, header_points, has_colors, has_splats, center, half, spacing, nodes })
    }

    /// Returns the same file with a cache of decoded nodes, which several files may share. `None` disables caching.
    #[must_use]
    pub fn with_cache(self, cache: Option<Arc<NodeCache>>) -> Self {
        Self { cache, ..self }
    }

    /// Returns the nodes of the octree, level by level; the children of a node are consecutive.
    pub fn nodes(&self) -> &[CopcNode] {
        &self.nodes
    }

    /// Returns the number of points of all nodes.
    pub fn points(&self) -> u64 {
        self.nodes.iter().map(|node| node.points).sum()
    }

    /// True if the point format has colours. They may be all black.
    pub fn has_colors(&self) -> bool {
        self.has_colors
    }

    /// True if the file states radii and normals of its points.
    pub fn has_splats(&self) -> bool {
        self.has_splats
    }

    /// Returns the number of points that the file's header states.
    pub fn header_points(&self) -> u64 {
        self.header_points
    }

    /// Returns the distance between neighbouring points at a level, in the file's units; each level halves it.
    pub fn spacing(&self, level: u32) -> f64 {
        self.spacing * (-f64::from(level)).exp2()
    }

    /// Returns the centre of a node's cube and half of its side, in the file's units.
    pub fn cube(&self, node: &CopcNode) -> (DVec3, f64) {
        let half = self.half * (-f64::from(node.level)).exp2();
        let corner = self.center - self.half;
        (corner + DVec3::from(node.cell.map(|c| 2.0 * f64::from(c) + 1.0)) * half, half)
    }

    /// Returns the octant at the finest possible level that contains a point in the file's coordinates, as its position
    /// along x, y and z. Points outside the root's cube are assigned to the nearest octant. [`Self::cell_above`]
    /// returns the octants that enclose an octant.
    pub fn cell_of(&self, point: DVec3) -> [u32; 3] {
        let cells = f64::from(1_u32 << MAX_LEVEL);
        let at = (point - (self.center - self.half)) / (2.0 * self.half) * cells;
        at.to_array().map(|v| v.floor().clamp(0.0, cells - 1.0) as u32)
    }

    /// Returns the octant of `level` that encloses an octant returned by [`Self::cell_of`].
    pub fn cell_above(cell: [u32; 3], level: u32) -> [u32; 3] {
        cell.map(|c| c >> MAX_LEVEL.saturating_sub(level))
    }

    /// Returns the row number of each node's first point, by node index: the number of points before it in the file.
    pub fn first_rows(&self) -> Vec<u64> {
        let mut order: Vec<usize> = (0..self.nodes.len()).collect();
        order.sort_by_key(|i| self.nodes[*i].at);
        let (mut rows, mut next) = (vec![0; self.nodes.len()], 0);
        for i in order {
            rows[i] = next;
            next += self.nodes[i].points;
        }
        rows
    }

    /// Reads the points of nodes, given by index, in this order; ignores indices for which there is no node.
    ///
    /// # Errors
    /// [`IoError`] if the file can't be read or a node is damaged.
    pub fn points_of(
        &self,
        nodes: &[u32],
        columns: NodeColumns<'_>,
        options: &LoadOptions,
    ) -> Result<NodePoints, IoError> {
        self.kept_points_of(nodes, (columns, None), options)
    }

    /// Reads points like [`Self::points_of`], filtered by `keeps`. Rejected points take memory only while their node is
    /// decoded. If no point of the first node with points passes the filter, all points of this node are returned. Row
    /// numbers are indices among the returned points.
    ///
    /// # Errors
    /// Errors of [`Self::points_of`].
    pub fn kept_points_of(
        &self,
        nodes: &[u32],
        (columns, keeps): (NodeColumns<'_>, Option<PointFilter<'_>>),
        options: &LoadOptions,
    ) -> Result<NodePoints, IoError> {
        let mut ends = Vec::with_capacity(nodes.len());
        let node = |i: &u32| Some((self.nodes.get(*i as usize)?, columns.of(*i)));
        let nodes: Vec<(&CopcNode, Decoded)> = nodes.iter().filter_map(node).collect();
        let path = &self.file.path;
        let system = |source| IoError::System { path: path.clone(), action: READ, source };
        let not_regular = || system(io::Error::other("it is no regular file"));
        let mut file = RegularFile::open(path).map_err(system)?.ok_or_else(not_regular)?;
        let loaded = loaded::run_plain(
            |context| {
                let mut header = Header::read(&mut file, self.file.bytes)?;
                header.reads_withheld = context.options.withheld;
                let read =
                    AssertUnwindSafe(|| self.read_nodes(&mut file, &mut header, &nodes, (columns, keeps), &mut ends));
                let columns = catch_unwind(read).unwrap_or_else(|_| {
                    let problem = Problem::new("is damaged: its compressed points make no sense");
                    Err(problem.help("copy the file again"))
                })?;
                let content = finish(Some(columns), header, Format::Copc, Some(self.points()), context)?;
                Ok((Format::Copc, content))
            },
            path,
            options,
        )?;
        // Positions on an integer grid are finite, so no point is dropped.
        assert!(matches!(&loaded.content, Content::Points(p) if Some(&p.len()) == ends.last()));
        Ok(NodePoints { loaded, ends })
    }

    fn read_nodes(
        &self,
        source: &mut dyn Source,
        header: &mut Header,
        nodes: &[(&CopcNode, Decoded)],
        (wanted, keeps): (NodeColumns<'_>, Option<PointFilter<'_>>),
        ends: &mut Vec<usize>,
    ) -> Result<Columns, Problem> {
        let (vlr, _) = checked_vlr(header)?;
        let size = header.record_bytes as u64;
        let count: u64 = nodes.iter().map(|(node, _)| node.points).sum();
        let (mut columns, fields) = match wanted {
            NodeColumns::All => (Columns::new(header, count as usize), DecompressionSelection::all()),
            NodeColumns::Splats(_) => (Columns::of_splats(header, count as usize), of_splats()),
        };
        let is_of_level = marked_bytes(header, [LEVEL_COLORS, LEVEL_NORMALS].as_flattened());
        // With `LevelValues::Alone`, the level's mean values replace a point's own colours and normals, which aren't
        // decoded.
        let [has_colors, has_normals] = [LEVEL_COLORS, LEVEL_NORMALS]
            .map(|names| names.iter().all(|name| header.extra.iter().any(|e| e.name == *name)));
        let is_own = marked_bytes(header, if has_normals { &NORMALS } else { &[] });
        let kept = |(node, decoded): &(&CopcNode, Decoded)| {
            let records = self.cache.as_ref()?.get(&self.file, node.at, *decoded)?;
            (records.len() as u64 == node.points * size).then_some(records)
        };
        let mut rest = nodes;
        let (mut packed, mut bytes) = (Vec::new(), Vec::new());
        while !rest.is_empty() {
            let (mut group, mut sums) = (0, (0, 0));
            while let Some((node, _)) = rest.get(group) {
                let next = (sums.0 + node.bytes, sums.1 + node.points * size);
                if group > 0 && (next.0 > GROUP_BYTES.0 || next.1 > GROUP_BYTES.1) {
                    break;
                }
                (group, sums) = (group + 1, next);
            }
            let (now, after) = rest.split_at(group);
            let found: Vec<_> = now.iter().map(kept).collect();
            packed.clear();
            let mut chunks: Vec<(u64, u64)> = Vec::new();
            for ((node, decoded), _) in now.iter().zip(&found).filter(|((n, _), f)| n.points > 0 && f.is_none()) {
                check_node(source, node, &vlr, header.record_bytes)?;
                let start = packed.len();
                packed.resize(start + node.bytes as usize, 0);
                source.seek(SeekFrom::Start(node.at)).map_err(unreadable)?;
                source.read_exact(&mut packed[start..]).map_err(unreadable)?;
                match decoded {
                    Decoded::Splats(LevelValues::Without) => leave_out(&mut packed, start, &vlr, false, &is_of_level),
                    Decoded::Splats(LevelValues::Alone) => leave_out(&mut packed, start, &vlr, has_colors, &is_own),
                    Decoded::Splats(LevelValues::With) | Decoded::All => {}
                }
                chunks.push((node.points, (packed.len() - start) as u64));
            }
            bytes.clear();
            bytes.resize((chunks.iter().map(|(points, _)| points).sum::<u64>() * size) as usize, 0);
            decode_some(&packed, &mut bytes, &vlr, &chunks, fields).map_err(|e| {
                let at = now.first().map_or(0, |(node, _)| node.at);
                Problem::new(format!("is damaged: {e}")).at(Location::Byte(at as usize)).help("copy the file again")
            })?;
            let mut at = 0;
            for ((node, decoded), found) in now.iter().zip(&found) {
                let mut append = |records: &mut [u8]| match keeps {
                    Some(keeps) => append_kept(&mut columns, header, (node.level, keeps), records),
                    None => columns.append(records),
                };
                if let Some(records) = found {
                    append(&mut records.to_vec());
                } else {
                    let end = at + (node.points * size) as usize;
                    if let Some(cache) = self.cache.as_ref().filter(|_| node.points > 0) {
                        cache.add(&self.file, node.at, *decoded, (&bytes[at..end], node.bytes));
                    }
                    append(&mut bytes[at..end]);
                    at = end;
                }
                ends.push(columns.len());
            }
            rest = after;
        }
        Ok(columns)
    }
}

/// Appends the points of a node that pass the filter `keeps`. Appends all of them if none passes and no point was
/// appended before.
fn append_kept(columns: &mut Columns, header: &Header, (level, keeps): (u32, PointFilter<'_>), records: &mut [u8]) {
    let stated = header.extra.iter().find(|extra| extra.name == RADIUS);
    let radius_at = stated.map(|extra| (POINT_BYTES[usize::from(header.format)] + extra.at, value_of(extra.kind)));
    let [scale, offset] = stated.and_then(|extra| extra.scaled).map_or([1.0, 0.0], |(scale, offset)| [scale, offset]);
    let is_kept = |record: &[u8]| {
        let steps = [0, 4, 8].map(|at| f64::from(i32::from_le_bytes(field(record, at))));
        let radius = radius_at.map_or(0.0, |(at, value)| value(&record[at..]) * scale + offset);
        keeps(level, DVec3::from(steps) * header.scale + header.offset, radius)
    };
    let is_first = columns.len() == 0 && !records.chunks_exact(header.record_bytes).any(is_kept);
    if is_first {
        columns.append(records);
    } else {
        columns.append_kept(records, is_kept);
    }
}

/// Returns a flag for each extra byte of a point: true if the byte belongs to a field with one of `names`.
fn marked_bytes(header: &Header, names: &[&str]) -> Vec<bool> {
    let extra_bytes = header.record_bytes - POINT_BYTES[usize::from(header.format)];
    let mut is_marked = vec![false; extra_bytes];
    for extra in header.extra.iter().filter(|e| names.contains(&e.name.as_str())) {
        let end = extra_bytes.min(extra.at + ExtraField::bytes(extra.kind));
        is_marked[extra.at.min(end)..end].fill(true);
    }
    is_marked
}

/// Checks that a node's chunk has as many points as the hierarchy states, if the chunk itself states their number.
fn check_node(source: &mut dyn Source, node: &CopcNode, vlr: &LazVlr, record_bytes: usize) -> Result<(), Problem> {
    let there = chunk_points(source, node.at, node.bytes, vlr, record_bytes)?;
    if there.is_some_and(|there| there != node.points) {
        let (there, said) = (there.unwrap_or(0), node.points);
        let what = format!("has {there} points in a node that its hierarchy says has {said}");
        return Err(Problem::new(what).at(Location::Byte(node.at as usize)).help("the file is damaged"));
    }
    Ok(())
}

/// State of reading the hierarchy's pages: the file's limits and the nodes found so far.
struct Pages<'a> {
    header: &'a Header,
    file_bytes: u64,
    entries: BTreeMap<(u32, u64), CopcNode>,
    points_bytes: u64,
}

impl Pages<'_> {
    fn read(mut self, source: &mut dyn Source, root: [u64; 2]) -> Result<Vec<CopcNode>, Problem> {
        let (mut open, mut seen, mut total) = (vec![root], BTreeSet::new(), 0_u64);
        while let Some([at, bytes]) = open.pop() {
            let place = Location::Byte(at.min(self.file_bytes) as usize);
            let fault = |what: String| Problem::new(what).at(place).help("the file is cut off or damaged");
            if at.checked_add(bytes).is_none_or(|end| end > self.file_bytes) || bytes % ENTRY_BYTES as u64 != 0 {
                let what = format!("says that a page of its hierarchy has {bytes} bytes at byte {at}");
                return Err(fault(what).expected(format!("whole entries within its {} bytes", self.file_bytes)));
            }
            total = total.saturating_add(bytes);
            if !seen.insert(at) || total > self.file_bytes {
                return Err(fault("has a hierarchy whose pages lead back to one another".into()));
            }
            let mut page = vec![0; bytes as usize];
            source.seek(SeekFrom::Start(at)).map_err(unreadable)?;
            source.read_exact(&mut page).map_err(unreadable)?;
            for entry in page.chunks_exact(ENTRY_BYTES) {
                if let Some(next) = self.add(entry).map_err(fault)? {
                    open.push(next);
                }
            }
        }
        self.finish()
    }

    /// Parses an entry of the hierarchy. Adds a node, or returns the byte offset and length of the further page to
    /// which the entry refers.
    fn add(&mut self, entry: &[u8]) -> Result<Option<[u64; 2]>, String> {
        let number = |at: usize| i32::from_le_bytes(field(entry, at));
        let [level, x, y, z] = [0, 4, 8, 12].map(number);
        let at = u64::from_le_bytes(field(entry, 16));
        let (bytes, points) = (number(24), number(28));
        let name = format!("node {level}-{x}-{y}-{z}");
        let (Ok(bytes), true) = (u64::try_from(bytes), points >= -1) else {
            return Err(format!("has {name} with {points} points in {bytes} bytes"));
        };
        if points == -1 {
            return Ok(Some([at, bytes]));
        }
        let points = points as u64;
        let level = u32::try_from(level).ok().filter(|l| *l <= MAX_LEVEL);
        let within = |v: i32, level: u32| u32::try_from(v).ok().filter(|v| u64::from(*v) < 1 << level);
        let cell = level.and_then(|level| Some([within(x, level)?, within(y, level)?, within(z, level)?]));
        let (Some(level), Some(cell)) = (level, cell) else {
            return Err(format!("has {name}, which is no octant of {MAX_LEVEL} levels at most"));
        };
        if points > 0 {
            let starts = self.header.start + 8;
            let ends = at.checked_add(bytes).is_some_and(|end| end <= self.file_bytes);
            self.points_bytes = self.points_bytes.saturating_add(bytes);
            if at < starts || !ends || bytes < self.header.record_bytes as u64 || self.points_bytes > self.file_bytes {
                return Err(format!("has {name} with {points} points in {bytes} bytes at byte {at}"));
            }
        }
        let node = CopcNode { level, cell, bytes, points, children: 0..0, at };
        match self.entries.insert((level, code(cell)), node) {
            Some(_) => Err(format!("has {name} twice")),
            None => Ok(None),
        }
    }

    /// Checks that the nodes are a tree. Returns them level by level, with the range of each node's children.
    fn finish(self) -> Result<Vec<CopcNode>, Problem> {
        let all = self.entries.values().fold(0_u64, |sum, node| sum.saturating_add(node.points));
        super::super::laz::check_size(self.header, all, self.file_bytes)?;
        let mut nodes: Vec<CopcNode> = self.entries.into_values().collect();
        let index: BTreeMap<(u32, u64), usize> =
            nodes.iter().enumerate().map(|(i, n)| ((n.level, code(n.cell)), i)).collect();
        for i in 0..nodes.len() {
            let (level, own) = (nodes[i].level, code(nodes[i].cell));
            if level == 0 {
                continue;
            }
            let Some(parent) = index.get(&(level - 1, own >> 3)) else {
                let [x, y, z] = cell(own);
                let what = format!("has node {level}-{x}-{y}-{z} in its hierarchy, and none above it");
                return Err(Problem::new(what).help("the file is damaged"));
            };
            let children = &mut nodes[*parent].children;
            let start = if children.start == children.end { i as u32 } else { children.start };
            *children = start..i as u32 + 1;
        }
        match nodes.first() {
            Some(_) => Ok(nodes),
            None => Err(Problem::new("has a hierarchy without nodes").help("the file is damaged")),
        }
    }
}
