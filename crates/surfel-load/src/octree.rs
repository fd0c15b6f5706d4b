//! Octrees of splats and polygons built from a mesh.

use crate::load::{LoadedMesh, load_mesh};
use crate::{Error, LoadOptions};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use surfel_model::Octree;
use surfel_sample::{OctreeOptions, Progress};

/// Loads a mesh and builds an octree of splats and polygons from it. Also returns notes for the user.
///
/// # Errors
/// Errors of [`crate::load()`]; also [`Error::Unsuitable`] if the file holds no triangles.
pub fn load_octree(
    path: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<(Octree, Vec<String>), Error> {
    let LoadedMesh { mesh, up, up_reason, mut notes } = load_mesh(path, options, &mut BTreeSet::new())?;
    if mesh.texture.is_none() && mesh.is_textured() {
        let what = "an octree's polygons have one texture at most, and these have several: colours of vertices stand \
                    for them, and detail between these is lost where polygons are drawn";
        notes.push(what.into());
    }
    let mut mesh = Arc::unwrap_or_clone(mesh);
    // A default up axis isn't stored in the octree file, so that it is estimated from the shape when the file is drawn.
    mesh.up = up_reason.map(|_| up);
    let sample = |source| Error::Sample { path: path.to_path_buf(), source };
    let octree_options =
        OctreeOptions { texture: options.convert.texture.sampling.unwrap_or_default(), ..OctreeOptions::default() };
    let octree = surfel_sample::octree_from_mesh(&mesh, &octree_options, progress).map_err(sample)?;
    Ok((octree, notes))
}
