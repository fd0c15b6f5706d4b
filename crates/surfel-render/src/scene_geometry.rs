//! Identity of a scene's geometry, by which backends recognise a scene whose splats they already hold.

use std::sync::{Arc, Weak};
use surfel_model::{GaussianCloud, Geometry, Mesh, Octree, Scene, SplatCloud};

/// Identity of the geometry of a scene's objects. A backend compares it with another scene, and copies no splats if
/// both share the same clouds and meshes. The pointers are weak, so the geometry isn't retained in memory.
#[derive(Clone, Debug, Default)]
pub struct SceneGeometry(Vec<Identity>);

/// Pointer to the cloud, mesh, octree or Gaussians of one object.
#[derive(Clone, Debug)]
enum Identity {
    Splats(Weak<SplatCloud>),
    Mesh(Weak<Mesh>),
    Octree(Weak<Octree>),
    Gaussians(Weak<GaussianCloud>),
}

impl SceneGeometry {
    /// Returns the identity of a scene's geometry.
    pub fn of(scene: &Scene) -> Self {
        let identity = |geometry: &Geometry| match geometry {
            Geometry::Splats(cloud) => Identity::Splats(Arc::downgrade(cloud)),
            Geometry::Mesh(mesh) => Identity::Mesh(Arc::downgrade(mesh)),
            Geometry::Octree(octree) => Identity::Octree(Arc::downgrade(octree)),
            Geometry::Gaussians(cloud) => Identity::Gaussians(Arc::downgrade(cloud)),
        };
        Self(scene.objects.iter().map(|object| identity(&object.geometry)).collect())
    }

    /// True if a scene has the same objects in the same order, and each shares its geometry by `Arc` with the original
    /// scene.
    pub fn is_of(&self, scene: &Scene) -> bool {
        // The weak pointer keeps the memory of a dropped cloud allocated, so no other geometry can have the same
        // address.
        let is_same = |(known, found): (&Identity, &Geometry)| match (known, found) {
            (Identity::Splats(known), Geometry::Splats(found)) => Weak::as_ptr(known) == Arc::as_ptr(found),
            (Identity::Mesh(known), Geometry::Mesh(found)) => Weak::as_ptr(known) == Arc::as_ptr(found),
            (Identity::Octree(known), Geometry::Octree(found)) => Weak::as_ptr(known) == Arc::as_ptr(found),
            (Identity::Gaussians(known), Geometry::Gaussians(found)) => Weak::as_ptr(known) == Arc::as_ptr(found),
            _ => false,
        };
        let found = scene.objects.iter().map(|object| &object.geometry);
        self.0.len() == scene.objects.len() && self.0.iter().zip(found).all(is_same)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Object;

    #[test]
    fn scenes_share_geometry_by_its_place_in_memory() {
        let cloud = || SplatCloud::disks(&[[0.0; 3]], &[[0.0, 0.0, 1.0]], &[1.0]).unwrap();
        let scene = Scene::from(cloud());
        let geometry = SceneGeometry::of(&scene);
        let mut moved = scene.clone();
        moved.objects[0].world_from_object.translation.x = 3.0;
        assert!(geometry.is_of(&moved));
        moved.objects.push(Object::from(cloud()));
        assert!(!geometry.is_of(&moved) && !geometry.is_of(&Scene::from(cloud())));
        // A new cloud isn't mistaken for a dropped one, whose memory it could reuse.
        drop((scene, moved));
        assert!(!geometry.is_of(&Scene::from(cloud())));
    }
}
