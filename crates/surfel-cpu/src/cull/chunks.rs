//! Selection of the visible chunks of clouds and the visible parts of meshes.

use crate::cull::object::{ObjectView, pixels_of_box};
use crate::scene::cloud::Chunk;
use crate::scene::mesh::{Part, StoredMesh};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use surfel_render::{SelectedParts, View};

/// A chunk of splats that may be visible.
#[derive(Clone, Copy)]
pub(crate) struct VisibleChunk {
    /// Index of the object among the scene's clouds.
    pub object: u32,
    /// Index of the chunk in the object.
    pub chunk: u32,
    /// Planar depth of the chunk's origin. Chunks are sorted by this depth, so that near ones, which may occlude
    /// others, are drawn first.
    z: f64,
}

impl VisibleChunk {
    /// Returns the object in view that the chunk belongs to, and the chunk itself.
    pub(crate) fn of<'a, 's>(&self, objects: &'a [ObjectView<'s>]) -> (&'a ObjectView<'s>, &'s Chunk) {
        let object = &objects[self.object as usize];
        (object, &object.object.chunks[self.chunk as usize])
    }
}

/// Chunks that may be visible, and the number of splats in culled chunks.
#[derive(Default)]
pub(crate) struct VisibleChunks {
    /// Chunks that may be visible, from near to far.
    pub chunks: Vec<VisibleChunk>,
    /// Number of splats that were culled because their whole chunk is outside the view.
    pub outside: u64,
    /// Number of splats that were culled because their whole chunk is back-facing.
    pub back_facing: u64,
}

/// Returns the chunks of all clouds that are neither outside the view nor back-facing, from near to far. Octrees
/// contribute their selected chunks only.
pub(crate) fn visible_chunks(objects: &[ObjectView<'_>]) -> VisibleChunks {
    let [outside, back_facing] = [const { AtomicU64::new(0) }; 2];
    let (out, back) = (&outside, &back_facing);
    let mut chunks: Vec<VisibleChunk> = objects
        .par_iter()
        .enumerate()
        .flat_map(|(index, object)| {
            let region = object.view.region.grown(object.plan.reach_px(), object.view.size);
            let selection = object.object.octree.and_then(|index| object.plan.selection_of(index));
            let chunks = object.object.chunks.par_iter().enumerate().with_min_len(1024);
            chunks.filter_map(move |(chunk, c)| {
                if selection.is_some_and(|selection| !selection.has_splat(c.member)) {
                    return None;
                }
                let center = object.center(c);
                let count = |of: &AtomicU64| {
                    of.fetch_add(c.count as u64, Ordering::Relaxed);
                    true
                };
                let culled =
                    (object.is_outside(center, c, region) && count(out)) || (object.is_back_facing(c) && count(back));
                (!culled).then_some(VisibleChunk { object: index as u32, chunk: chunk as u32, z: center.z })
            })
        })
        .collect();
    let order =
        |a: &VisibleChunk, b: &VisibleChunk| a.z.total_cmp(&b.z).then((a.object, a.chunk).cmp(&(b.object, b.chunk)));
    chunks.par_sort_unstable_by(order);
    VisibleChunks { chunks, outside: outside.into_inner(), back_facing: back_facing.into_inner() }
}

/// A part of a mesh, neighbouring triangles that may be within a view's depth range.
#[derive(Clone, Copy)]
pub(crate) struct MeshPart {
    /// Index of the mesh in the scene's list of meshes.
    pub mesh: u32,
    /// Index of the part in the mesh's list of parts.
    pub part: u32,
}

/// Returns the mesh parts that may be within a view's depth range, and the bounds of the pixels that each may touch.
/// Bounds are minimum x and y, maximum x and y. Octrees contribute their selected parts only.
pub(crate) fn mesh_parts<'a>(
    meshes: &'a [StoredMesh],
    octrees: &'a [SelectedParts],
    view: &'a View,
) -> impl Iterator<Item = (MeshPart, [f64; 4])> + 'a {
    meshes.iter().enumerate().flat_map(move |(index, mesh)| {
        let (linear, origin) = mesh.in_view(view);
        // The Frobenius norm bounds the largest singular value; the slack is far above rounding.
        let stretch = linear.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt() * (1.0 + 1e-9);
        let projection = &view.projection;
        let selection = mesh.octree.and_then(|index| SelectedParts::of(octrees, index));
        mesh.parts.iter().enumerate().filter_map(move |(part, Part { bounds, .. })| {
            let first = mesh.part(part as u32).first()?;
            if selection.is_some_and(|selection| !selection.has_triangle(*first)) {
                return None;
            }
            let (center, radius) = (origin + linear * bounds.center, bounds.radius * stretch);
            let visible = center.z + radius >= projection.near && center.z - radius <= projection.far();
            let mesh_part = MeshPart { mesh: index as u32, part: part as u32 };
            visible.then(|| (mesh_part, pixels_of_box(projection, center, DVec3::splat(radius), 1.0)))
        })
    })
}
