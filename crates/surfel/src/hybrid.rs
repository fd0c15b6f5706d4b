//! Octrees of splats and polygons: made of a mesh, and cut down to what a view needs.

use crate::load::load_mesh;
use crate::{Error, LoadOptions};
use std::path::Path;
use std::sync::Arc;
use surfel_model::{Geometry, Hybrid, Object, Scene};
use surfel_render::{View, select};
use surfel_sample::{HybridOptions, Progress};

/// An object of a scene that is held as an octree.
#[derive(Clone, Debug)]
pub struct HybridObject {
    /// Index of the object.
    pub object: usize,
    /// Its octree.
    pub hybrid: Arc<Hybrid>,
}

/// Loads a mesh and puts it into an octree; also what the user should know.
///
/// # Errors
/// As [`crate::prepare`]; also [`Error::Unsuitable`] if the file holds no triangles.
pub fn prepare_hybrid(
    path: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<(Hybrid, Vec<String>), Error> {
    let (mesh, up, notes) = load_mesh(path, options)?;
    let mut mesh = Arc::unwrap_or_clone(mesh);
    mesh.up = Some(up);
    let sample = |source| Error::Sample { path: path.to_path_buf(), source };
    let hybrid = surfel_sample::hybrid_from_mesh(&mesh, &HybridOptions::default(), progress).map_err(sample)?;
    Ok((hybrid, notes))
}

/// The scene as a view needs it: of each octree the coarsest splats that measure at most `error_px` pixels, and polygons where
/// even the finest are larger. Polygons are objects of their own, after the others.
///
/// # Errors
/// [`Error::Model`] if an octree's part is no valid cloud; none in practice.
pub fn at_detail(scene: &Scene, hybrids: &[HybridObject], view: &View, error_px: f64) -> Result<Scene, Error> {
    let mut result = scene.clone();
    for HybridObject { object, hybrid } in hybrids {
        let Some(whole) = result.objects.get(*object).cloned() else { continue };
        let chosen = select(hybrid, &whole.world_from_object, whole.material.cull, view, error_px);
        result.objects[*object].geometry = Geometry::Splats(Arc::new(hybrid.cloud_of(&chosen.splats)?));
        if !chosen.triangles.is_empty() {
            let geometry = Geometry::Mesh(Arc::new(hybrid.mesh_of(&chosen.triangles)));
            result.objects.push(Object { geometry, ..whole });
        }
    }
    Ok(result)
}
