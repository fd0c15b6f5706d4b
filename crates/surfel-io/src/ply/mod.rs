//! PLY files: Surfel's splat profile (splats with half-axes, or with normals and radii), point clouds, meshes, and
//! Gaussian splats.

mod body;
pub(crate) mod colors;
mod comments;
mod compressed;
pub(crate) mod encoding;
mod gaussians;
mod header;
mod mesh;
mod names;
#[cfg(feature = "laz")]
pub(crate) mod points;
mod splats;
mod table;
mod wedges;
pub(crate) mod write;

use crate::bytes::Bytes;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Problem, list};
use body::PropertySelection;
use encoding::PlyEncoding;
use header::ElementDef;
use mesh::Faces;
use table::require;

/// Names of the list property with the corners of a face or strip.
const INDEX_LISTS: &[&str] = &["vertex_indices", "vertex_index"];

/// Reads a PLY file. Vertices that are compressed Gaussian splats have priority. Other files are read as a mesh if they
/// have faces or triangle strips, else as Gaussian splats, splats or points. The properties of the vertices decide
/// between the last three.
pub(crate) fn read(bytes: Bytes<'_>, context: &mut Context<'_>) -> Result<Content, Fault> {
    // One byte more than the longest header, to detect longer ones.
    let header = header::parse(&bytes.at_most(0, header::MAX_HEADER_BYTES + header::MAX_LINE_BYTES + 1))?;
    let whole;
    let is_fixed = header.encoding != PlyEncoding::Ascii && header.elements.iter().all(ElementDef::is_fixed);
    let bytes = if is_fixed {
        bytes
    } else {
        whole = bytes.read();
        Bytes::Memory(&whole)
    };
    let packed = header.elements.iter().any(|e| e.properties.iter().any(|p| p.name == "packed_position"));
    let tables = body::read(bytes, &header, |element| match element.name.as_str() {
        "vertex" => PropertySelection::Scalars,
        "chunk" if packed => PropertySelection::Scalars,
        "face" | "tristrips" => PropertySelection::Lists(INDEX_LISTS),
        _ => PropertySelection::Nothing,
    })?;
    let (mut vertices, mut chunks, mut faces, mut strips) = (None, None, None, None);
    for (name, table) in tables {
        match name.as_str() {
            "vertex" => vertices = Some(table),
            "chunk" => chunks = Some(table),
            "face" => faces = Faces::of(table, &header.comments, context)?,
            _ => strips = table.lists.into_iter().next().map(|(_, lists)| lists),
        }
    }
    let Some(vertices) = vertices else {
        let names: Vec<&str> = header.elements.iter().map(|e| e.in_file.as_str()).collect();
        let what = format!("the PLY file has no 'vertex' element; it has {}", list(&names));
        return Err(Problem::new(what).expected("'element vertex N' with properties x y z").into());
    };
    if compressed::recognise(&vertices) {
        let harmonics = header.elements.iter().any(|e| e.name == "sh");
        return compressed::build(vertices, chunks, harmonics, header.comments, context);
    }
    require(&vertices, &["x", "y", "z"])?;
    let strips = strips.filter(|s| !s.lengths.is_empty());
    if faces.is_some() || strips.is_some() {
        return mesh::build(vertices, faces, strips, header.comments, context);
    }
    if gaussians::recognise(&vertices)? {
        return gaussians::build(vertices, header.comments, context);
    }
    splats::build(vertices, header.comments, context)
}
