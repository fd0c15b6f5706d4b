//! Reader and writer of `.surfel` files: an octree of splats and polygons (docs/format.md).
//!
//! A file begins with a signature and a version. Sections with a tag and a length follow; unknown sections are skipped.
//! All numbers are little endian.

use crate::atomic;
use crate::bytes::Bytes;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, IoError, Location, Problem, quote};
use crate::format::OCTREE_SIGNATURE;
use crate::ply::encoding::PlyEncoding;
use crate::ply::write::write_splat_ply;
use glam::{DVec3, Vec3};
use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use surfel_model::{Column3, Mesh, Octree, OctreeNode, Texture, Transition};

/// Version of the `.surfel` format that is written, and the only one that can be read.
const VERSION: u32 = 1;

const SPLATS: &[u8; 4] = b"SPLT";
const MESH: &[u8; 4] = b"MESH";
const TEXTURE: &[u8; 4] = b"TEXR";
const NODES: &[u8; 4] = b"NODE";
const EDGES: &[u8; 4] = b"EDGE";

/// Flag of a mesh section whose positions have a low part, the rounding errors of their f32 values.
const LOW: u32 = 1;
/// Flag of a mesh section with vertex normals.
const NORMALS: u32 = 2;
/// Flag of a mesh section with vertex colours.
const COLORS: u32 = 4;
/// Flag of a mesh section with vertex alphas.
const ALPHAS: u32 = 8;
/// Flag of a mesh section with texture coordinates.
const UVS: u32 = 16;

/// Number of bytes of a node in its section.
const NODE_BYTES: usize = 9 * 8 + 6 * 4;
/// Number of bytes of a transition, an edge that two leaves share, in its section.
const EDGE_BYTES: usize = 4 * 4;

/// Writes an octree to a file, atomically and without loss.
///
/// # Errors
/// [`IoError::Exists`] if the file exists and `overwrite` is false; [`IoError::System`] if it can't be written.
pub fn save_octree(path: &Path, overwrite: bool, octree: &Octree) -> Result<(), IoError> {
    atomic::write(path, overwrite, |out| write_octree(out, octree))
}

/// Writes an octree like [`save_octree`], to any sink.
///
/// # Errors
/// [`io::Error`] if `out` fails.
pub fn write_octree(out: &mut dyn Write, octree: &Octree) -> io::Result<()> {
    let mut splats = Vec::new();
    write_splat_ply(&mut splats, octree.cloud(), PlyEncoding::BinaryLittleEndian)?;
    let mut sections = vec![(SPLATS, splats), (MESH, mesh_section(octree.mesh()))];
    if let Some(texture) = &octree.mesh().texture {
        sections.push((TEXTURE, png_of(texture)?));
    }
    sections.push((NODES, nodes_section(octree.nodes())));
    sections.push((EDGES, edges_section(octree.transitions())));
    out.write_all(OCTREE_SIGNATURE)?;
    out.write_all(&VERSION.to_le_bytes())?;
    out.write_all(&(sections.len() as u32).to_le_bytes())?;
    for (tag, bytes) in sections {
        out.write_all(tag)?;
        out.write_all(&(bytes.len() as u64).to_le_bytes())?;
        out.write_all(&bytes)?;
    }
    Ok(())
}

fn floats<'a>(bytes: &mut Vec<u8>, values: impl IntoIterator<Item = &'a f32>) {
    values.into_iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
}

fn numbers(bytes: &mut Vec<u8>, values: &[u32]) {
    values.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
}

fn doubles(bytes: &mut Vec<u8>, values: &[f64]) {
    values.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
}

fn mesh_section(mesh: &Mesh) -> Vec<u8> {
    let columns = [
        (mesh.positions.low().is_some(), LOW),
        (mesh.normals.is_some(), NORMALS),
        (mesh.colors.is_some(), COLORS),
        (mesh.alphas.is_some(), ALPHAS),
        (mesh.uvs.is_some(), UVS),
    ];
    let flags = columns.iter().filter(|(there, _)| *there).fold(0, |flags, (_, bit)| flags | bit);
    let mut bytes = Vec::new();
    doubles(&mut bytes, &mesh.origin.to_array());
    numbers(&mut bytes, &[mesh.positions.len() as u32, mesh.triangles.len() as u32, flags]);
    for column in [Some(mesh.positions.high()), mesh.positions.low()].into_iter().flatten() {
        column.iter().for_each(|v| floats(&mut bytes, &v.to_array()));
    }
    for column in [&mesh.normals, &mesh.colors].into_iter().flatten() {
        floats(&mut bytes, column.as_flattened());
    }
    floats(&mut bytes, mesh.alphas.iter().flatten());
    floats(&mut bytes, mesh.uvs.iter().flatten().flatten());
    mesh.triangles.iter().for_each(|t| numbers(&mut bytes, t));
    bytes
}

fn png_of(texture: &Texture) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, texture.width, texture.height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(texture.srgba8.as_flattened())?;
    writer.finish()?;
    Ok(bytes)
}

fn nodes_section(nodes: &[OctreeNode]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(nodes.len() * NODE_BYTES);
    for node in nodes {
        doubles(&mut bytes, &node.center);
        doubles(&mut bytes, &[node.radius, node.splat_radius]);
        doubles(&mut bytes, &node.cone_axis);
        doubles(&mut bytes, &[node.cone_cosine]);
        for range in [&node.children, &node.splats, &node.triangles] {
            numbers(&mut bytes, &[range.start, range.end]);
        }
    }
    bytes
}

fn edges_section(transitions: &[Transition]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(transitions.len() * EDGE_BYTES);
    for t in transitions {
        numbers(&mut bytes, &[t.leaves[0], t.leaves[1], t.splats.start, t.splats.end]);
    }
    bytes
}

/// Reads an octree from the bytes of a `.surfel` file.
pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut file = Cursor { bytes, at: OCTREE_SIGNATURE.len(), what: "the file" };
    let version = file.number()?;
    if version != VERSION {
        let problem = Problem::new(format!("is version {version} of the octree format"));
        return Err(problem.expected("version 1").help("convert the mesh again with this version of surfel").into());
    }
    let (mut cloud, mut mesh, mut nodes, mut transitions, mut texture) = (None, None, None, None, None);
    for _ in 0..file.number()? {
        let tag = file.take(4)?;
        let length = u64::from(file.number()?) | u64::from(file.number()?) << 32;
        let length = usize::try_from(length).map_err(|_| file.short())?;
        let section = file.take(length)?;
        let mut section = Cursor { bytes: section, at: 0, what: "a section" };
        match tag {
            t if t == SPLATS => cloud = Some(read_splats(section.bytes, context)?),
            t if t == MESH => mesh = Some(read_mesh(&mut section)?),
            t if t == TEXTURE => {
                let decoded = context.textures.decode(section.bytes, "TEXR");
                texture = Some(decoded.map_err(|why| Problem::new(format!("its texture can't be read: {why}")))?);
            }
            t if t == NODES => nodes = Some(read_nodes(&mut section)?),
            t if t == EDGES => transitions = Some(read_edges(&mut section)?),
            other => context.note(format!("skipped the section {}, which this version doesn't know", quote(other))),
        }
    }
    let missing = |name: &str| Problem::new(format!("lacks its section {name}")).help("convert the mesh again");
    let cloud = cloud.ok_or_else(|| missing("SPLT"))?;
    let mut mesh: Mesh = mesh.ok_or_else(|| missing("MESH"))?;
    mesh.texture = texture.map(Arc::new);
    mesh.up = cloud.data().up;
    let nodes = nodes.ok_or_else(|| missing("NODE"))?;
    let transitions = transitions.ok_or_else(|| missing("EDGE"))?;
    Ok(Content::Octree(Box::new(Octree::new(cloud, mesh, nodes, transitions)?)))
}

fn read_splats(bytes: &[u8], context: &mut Context<'_>) -> Result<surfel_model::SplatCloud, Fault> {
    match crate::ply::read(Bytes::Memory(bytes), context)? {
        Content::Splats(cloud) => Ok(cloud),
        _ => Err(Problem::new("its section SPLT holds no splats").expected("a splat PLY").into()),
    }
}

fn read_mesh(section: &mut Cursor) -> Result<Mesh, Problem> {
    let origin = DVec3::from(section.doubles()?);
    let (vertices, triangles, flags) = (section.count()?, section.count()?, section.number()?);
    let positions = section.vectors(vertices)?;
    let low = section.if_there(flags & LOW, |s| s.vectors(vertices))?;
    let positions = match low {
        Some(low) => {
            let sum = |(high, low): (&Vec3, &Vec3)| high.as_dvec3() + low.as_dvec3();
            Column3::from_f64(&positions.iter().zip(&low).map(sum).collect::<Vec<_>>())
        }
        None => Column3::from_f32(positions),
    };
    let triples = |s: &mut Cursor| s.rows::<3>(vertices);
    Ok(Mesh {
        origin,
        positions,
        normals: section.if_there(flags & NORMALS, triples)?,
        colors: section.if_there(flags & COLORS, triples)?,
        alphas: section.if_there(flags & ALPHAS, |s| Ok(s.rows::<1>(vertices)?.as_flattened().to_vec()))?,
        uvs: section.if_there(flags & UVS, |s| s.rows::<2>(vertices))?,
        triangles: section.items(triangles, 12, |s| Ok([s.number()?, s.number()?, s.number()?]))?,
        ..Mesh::default()
    })
}

fn read_nodes(section: &mut Cursor) -> Result<Vec<OctreeNode>, Problem> {
    let count = section.bytes.len() / NODE_BYTES;
    section.items(count, NODE_BYTES, |s| {
        let center = s.doubles()?;
        let [radius, splat_radius] = s.doubles()?;
        let (cone_axis, [cone_cosine]) = (s.doubles()?, s.doubles()?);
        let (children, splats, triangles) = (s.range()?, s.range()?, s.range()?);
        Ok(OctreeNode { center, radius, splat_radius, cone_axis, cone_cosine, children, splats, triangles })
    })
}

fn read_edges(section: &mut Cursor) -> Result<Vec<Transition>, Problem> {
    let count = section.bytes.len() / EDGE_BYTES;
    section.items(count, EDGE_BYTES, |s| Ok(Transition { leaves: [s.number()?, s.number()?], splats: s.range()? }))
}

/// A reader of the bytes of a file, or of one of its sections, from front to back.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    what: &'static str,
}

impl<'a> Cursor<'a> {
    fn short(&self) -> Problem {
        let found = format!("{} ends after {} bytes", self.what, self.bytes.len());
        Problem::new(found).at(Location::Byte(self.at)).help("the file is damaged or incomplete")
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], Problem> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let taken = end.and_then(|end| self.bytes.get(self.at..end)).ok_or_else(|| self.short())?;
        self.at += count;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Problem> {
        let short = self.short();
        self.take(N)?.try_into().map_err(|_| short)
    }

    fn number(&mut self) -> Result<u32, Problem> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn count(&mut self) -> Result<usize, Problem> {
        Ok(self.number()? as usize)
    }

    fn range(&mut self) -> Result<Range<u32>, Problem> {
        Ok(self.number()?..self.number()?)
    }

    fn doubles<const N: usize>(&mut self) -> Result<[f64; N], Problem> {
        let mut values = [0.0; N];
        for v in &mut values {
            *v = f64::from_le_bytes(self.array()?);
        }
        Ok(values)
    }

    /// Reads `count` items of `size` bytes each. Memory is allocated only if the remaining bytes can contain all of
    /// them.
    fn items<T>(
        &mut self,
        count: usize,
        size: usize,
        mut item: impl FnMut(&mut Self) -> Result<T, Problem>,
    ) -> Result<Vec<T>, Problem> {
        if count > (self.bytes.len() - self.at) / size {
            return Err(self.short());
        }
        (0..count).map(|_| item(self)).collect()
    }

    fn rows<const N: usize>(&mut self, count: usize) -> Result<Vec<[f32; N]>, Problem> {
        self.items(count, 4 * N, |s| {
            let mut row = [0.0; N];
            for v in &mut row {
                *v = f32::from_le_bytes(s.array()?);
            }
            Ok(row)
        })
    }

    fn vectors(&mut self, count: usize) -> Result<Vec<Vec3>, Problem> {
        Ok(self.rows::<3>(count)?.into_iter().map(Vec3::from).collect())
    }

    fn if_there<T>(
        &mut self,
        flag: u32,
        read: impl FnOnce(&mut Self) -> Result<T, Problem>,
    ) -> Result<Option<T>, Problem> {
        if flag == 0 { Ok(None) } else { read(self).map(Some) }
    }
}
