//! Scenes of scene files.

use std::path::Path;
use std::sync::Arc;
use surfel_io::{Content, LoadOptions};
use surfel_model::{Geometry, Object, Scene, SceneFile};

/// Returns the scene with its objects loaded from a folder: splat files and meshes, without conversions.
pub(crate) fn scene(file: &SceneFile, folder: &Path) -> Scene {
    let objects = file.objects.iter().map(|object| {
        let path = folder.join(object.splats.as_ref().or(object.mesh.as_ref()).unwrap());
        let geometry = match surfel_io::load(&path, &LoadOptions::default()).unwrap().content {
            Content::Splats(cloud) => Geometry::Splats(Arc::new(cloud)),
            Content::Mesh(mesh) => Geometry::Mesh(Arc::new(mesh)),
            Content::Points(_) | Content::Octree(_) | Content::Gaussians(_) => {
                panic!("{} has no splats", path.display())
            }
        };
        Object { geometry, world_from_object: object.world_from_object().unwrap(), material: object.material }
    });
    Scene {
        up: file.up,
        background: file.background,
        ambient: file.ambient,
        lights: file.lights.clone(),
        sky: None,
        ground: None,
        matcap: file.matcap.as_ref().map(|ball| Arc::new(surfel_io::load_matcap(&folder.join(ball)).unwrap())),
        objects: objects.collect(),
    }
}
