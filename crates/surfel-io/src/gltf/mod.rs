//! glTF 2.0 and GLB: points, triangles and Gaussian splats of the default scene, in world space and at rest.
//!
//! The `gltf` crate holds the document; its bytes are read here, because that crate trusts every offset, count and type
//! of an accessor, and knows neither quantised positions nor compressed buffers. What a document has to keep so that
//! the crate doesn't panic is checked in [`document`] first.

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
mod uri;

use crate::content::Content;
use crate::context::Context;
use crate::error::Fault;

/// Reads a glTF document, or a GLB file by its signature.
pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let container = container::split(bytes)?;
    let document = document::parse(container.json)?;
    for note in &document.notes {
        context.note(note.clone());
    }
    let asset = buffers::load(&document, container.binary, &context.siblings)?;
    scene::read(&asset, context)
}
