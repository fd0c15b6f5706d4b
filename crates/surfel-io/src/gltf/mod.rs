//! glTF 2.0 and GLB: points, triangles and Gaussian splats of the default scene, in world space and in rest pose.
//!
//! The crate `gltf` parses the document. Binary data are decoded here, because the crate trusts all offsets, counts and
//! types of accessors, and doesn't support quantised positions or compressed buffers. [`document`] first checks
//! everything that the crate could panic about.

mod accessor;
mod buffers;
mod container;
mod document;
mod draco;
mod instances;
mod materials;
mod nodes;
mod primitive;
mod rest_pose;
mod scene;
mod splats;
pub(crate) mod uri;
mod wrap;

use self::buffers::Asset;
use crate::content::Content;
use crate::context::Context;
use crate::error::Fault;
use crate::files::Siblings;
use crate::gathered_points::PointsPart;

/// Reads a glTF document, or a GLB file, which its signature reveals.
pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    with_asset(bytes, &context.siblings.clone(), context, scene::read)
}

/// Reads the points of a document that lies in the subfolder `folder` of the context's folder. Returns `None` if there
/// are none.
pub(crate) fn read_points(bytes: &[u8], folder: &str, context: &mut Context<'_>) -> Result<Option<PointsPart>, Fault> {
    with_asset(bytes, &context.siblings.below(folder), context, scene::read_points)
}

fn with_asset<T>(
    bytes: &[u8],
    siblings: &Siblings,
    context: &mut Context<'_>,
    read: impl FnOnce(&Asset<'_>, &mut Context<'_>) -> Result<T, Fault>,
) -> Result<T, Fault> {
    let container = container::split(bytes)?;
    let document = document::parse(container.json)?;
    for note in &document.notes {
        context.note(note.clone());
    }
    let asset = buffers::load(&document, container.binary, siblings)?;
    read(&asset, context)
}
