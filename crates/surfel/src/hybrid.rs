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

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Camera, CloudData, Column3, OnInvalid, Projection, Shape, SplatCloud};

    #[test]
    fn scene_without_octrees_is_drawn_from_its_own_memory() {
        let center = Column3::from_f64(&[[0.0, 0.0, 1.0].into()]);
        let shape = Shape::Disks { normals: center.clone(), radii: vec![0.5] };
        let data = CloudData::new([0.0; 3].into(), center, shape);
        let scene = Scene::of_cloud(SplatCloud::new(data, OnInvalid::Refuse).unwrap().0);
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        // So small that any octree would be polygons.
        let detail = at_detail(&scene, &[], &view, 1e-6).unwrap();
        let [Geometry::Splats(own), Geometry::Splats(drawn)] =
            [&scene, &detail].map(|scene| scene.objects[0].geometry.clone())
        else {
            panic!("splats became something else")
        };
        assert!(detail.objects.len() == 1 && Arc::ptr_eq(&own, &drawn));
    }
}
