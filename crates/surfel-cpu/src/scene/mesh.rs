//! Resident meshes, divided into parts of neighbouring triangles with bounding spheres, for culling.

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use surfel_math::basis::{normal_matrix, unit};
use surfel_model::{Material, Mesh, MipmapCache, Mipmaps, Object, Octree};
use surfel_render::View;

/// The mesh of one object, as this backend stores it.
pub(crate) struct StoredMesh {
    pub mesh: Arc<Mesh>,
    pub world_from_object: DAffine3,
    pub material: Material,
    /// The mesh's texture and its smaller mip levels; `None` without a texture.
    pub mipmaps: Option<Arc<Mipmaps>>,
    /// Map of normals from object to world space, up to a positive scale.
    pub normals: DMat3,
    /// Index of the object in the scene.
    pub source: usize,
    /// Index of the object in the scene if it is an octree; `None` for a mesh.
    pub octree: Option<usize>,
    /// Indices of the mesh's triangles, in Morton order (octrees: leaf by leaf), so that the triangles of a part are
    /// consecutive.
    order: Vec<u32>,
    pub parts: Vec<Part>,
}

/// A part of a mesh, the unit of culling: up to [`PART`] neighbouring triangles, in an octree those of a single leaf.
pub(crate) struct Part {
    pub bounds: BoundingSphere,
    /// Range of the part's triangles in [`StoredMesh`]'s `order`.
    triangles: Range<usize>,
}

impl Part {
    /// Creates the part that consists of the triangles `order[triangles]`, which are indices of the mesh's triangles.
    fn new(mesh: &Mesh, order: &[u32], triangles: Range<usize>) -> Self {
        Self { bounds: BoundingSphere::about(mesh, &order[triangles.clone()]), triangles }
    }
}

/// Divides a range of triangles into ranges of at most [`PART`].
fn cut(range: Range<usize>) -> impl Iterator<Item = Range<usize>> + Clone {
    range.clone().step_by(PART).map(move |first| first..(first + PART).min(range.end))
}

/// Largest number of triangles in a part: enough that testing its bounds costs nothing, few enough to be close
/// together.
const PART: usize = 256;

/// A bounding sphere of triangles, in object space relative to the mesh's origin.
pub(crate) struct BoundingSphere {
    pub center: DVec3,
    pub radius: f64,
}

impl BoundingSphere {
    fn about(mesh: &Mesh, triangles: &[u32]) -> Self {
        let corners = || triangles.iter().flat_map(|&t| mesh.triangles[t as usize]);
        let corners = || corners().map(|i| mesh.positions.get(i as usize));
        let (min, max) = extent(corners());
        let center = 0.5 * (min + max);
        Self { center, radius: corners().map(|p| p.distance(center)).fold(0.0, f64::max) }
    }
}

fn extent(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)))
}

/// Returns the indices of a mesh's triangles in Morton order of their first corners.
fn morton_order(mesh: &Mesh) -> Vec<u32> {
    let first = |t: &[u32; 3]| mesh.positions.get(t[0] as usize);
    let (min, max) = extent(mesh.triangles.iter().map(first));
    let side = (max - min).max_element();
    let scale = if side > 0.0 { 1023.0 / side } else { 0.0 };
    let key = |t: &[u32; 3]| {
        let [x, y, z] = ((first(t) - min) * scale).to_array().map(|c| c as u32);
        (0..10).fold(0u32, |key, bit| {
            let axis = |c: u32, at: u32| (c >> bit & 1) << (3 * bit + at);
            key | axis(x, 0) | axis(y, 1) | axis(z, 2)
        })
    };
    let mut keyed: Vec<(u32, u32)> = (0..).zip(&mesh.triangles).map(|(i, t)| (key(t), i)).collect();
    keyed.par_sort_unstable();
    keyed.into_iter().map(|(_, i)| i).collect()
}

impl StoredMesh {
    /// Stores a mesh. Mip levels of a texture that is in `known`, because another object uses it too, are shared.
    pub(crate) fn new(object: &Object, mesh: &Arc<Mesh>, known: &mut MipmapCache) -> Self {
        let order = morton_order(mesh);
        let parts: Vec<Range<usize>> = cut(0..order.len()).collect();
        Self::in_parts(object, mesh, known, order, &parts)
    }

    /// Stores an octree's triangles, leaf by leaf.
    pub(crate) fn of_octree(index: usize, octree: &Octree, object: &Object, known: &mut MipmapCache) -> Self {
        let mesh = octree.shared_mesh();
        let leaves = octree.nodes().iter().filter(|node| node.is_leaf());
        let parts: Vec<Range<usize>> =
            leaves.flat_map(|leaf| cut(leaf.triangles.start as usize..leaf.triangles.end as usize)).collect();
        let order = (0..mesh.triangles.len() as u32).collect();
        Self { octree: Some(index), ..Self::in_parts(object, &mesh, known, order, &parts) }
    }

    fn in_parts(
        object: &Object,
        mesh: &Arc<Mesh>,
        known: &mut MipmapCache,
        order: Vec<u32>,
        parts: &[Range<usize>],
    ) -> Self {
        Self {
            mesh: mesh.clone(),
            world_from_object: object.world_from_object,
            material: object.material,
            mipmaps: Mipmaps::of_mesh(mesh, known),
            normals: normal_matrix(&object.world_from_object.matrix3),
            source: 0,
            octree: None,
            parts: parts.par_iter().map(|triangles| Part::new(mesh, &order, triangles.clone())).collect(),
            order,
        }
    }

    /// Replaces the matrix and the material by those of an object with the same mesh.
    pub(crate) fn place(&mut self, object: &Object) {
        (self.world_from_object, self.material) = (object.world_from_object, object.material);
        self.normals = normal_matrix(&object.world_from_object.matrix3);
    }

    /// Returns the indices in the mesh of a part's triangles.
    pub(crate) fn part(&self, part: u32) -> &[u32] {
        self.parts.get(part as usize).and_then(|part| self.order.get(part.triangles.clone())).unwrap_or_default()
    }

    /// Returns the transform from object to view space: the linear map of directions, and the view position of the
    /// mesh's origin.
    pub(crate) fn in_view(&self, view: &View) -> (DMat3, DVec3) {
        // The eye is subtracted before the rotation, so that scenes far from the origin stay exact.
        let origin = self.world_from_object.transform_point3(self.mesh.origin) - view.eye;
        (view.view_from_world * self.world_from_object.matrix3, view.view_from_world * origin)
    }

    /// Returns the unit world normal of a triangle's plane, on the side from which its corners run counter-clockwise;
    /// zero if the triangle has no area.
    pub(crate) fn flat_normal(&self, triangle: usize) -> DVec3 {
        let [a, b, c] = self.mesh.triangles[triangle].map(|i| self.mesh.positions.get(i as usize));
        unit(self.normals * (b - a).cross(c - a))
    }
}
