//! Octree over a mesh's triangles, sorted by their centroids.

use super::geometry::Geometry;
use glam::DVec3;
use std::ops::Range;

/// Depth of the deepest possible level of the octree; leaves there may have any number of triangles. Splats there are
/// 2⁸ times as close as the root's.
const DEEPEST: u32 = 8;

/// Cube of the octree, with the triangles whose centroids it contains.
pub(crate) struct Node {
    pub(crate) depth: u32,
    /// Range of the cube's triangles in [`FaceTree::order`].
    pub(crate) faces: Range<usize>,
    /// Range of the children's node indices; empty for a leaf.
    pub(crate) children: Range<u32>,
}

/// Octree over triangles. Nodes are in breadth-first order, and the children of a node are consecutive.
pub(crate) struct FaceTree {
    pub(crate) nodes: Vec<Node>,
    /// Indices of all triangles, sorted so that those of each node are consecutive.
    pub(crate) order: Vec<u32>,
    /// Largest side of the mesh's bounding box, in object units, from which the distances between splats follow. The
    /// root's cube, which bounds the triangles' centroids, is no larger.
    pub(crate) side: f64,
}

impl FaceTree {
    /// Builds an octree by dividing cubes until each has at most `leaf_triangles` triangles or is at the depth
    /// [`DEEPEST`]. Every triangle is in exactly one leaf.
    pub(crate) fn new(geometry: &Geometry, leaf_triangles: usize) -> Self {
        let count = geometry.areas.len();
        let centroid = |face: u32| geometry.corners(face as usize).iter().sum::<DVec3>() / 3.0;
        let centroids: Vec<DVec3> = (0..count as u32).map(centroid).collect();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for c in &centroids {
            (low, high) = (low.min(*c), high.max(*c));
        }
        let mut order: Vec<u32> = (0..count as u32).collect();
        let mut nodes = vec![Node { depth: 0, faces: 0..count, children: 0..0 }];
        let mut cubes = vec![((low + high) * 0.5, (high - low).max_element() * 0.5)];
        let mut i = 0;
        while i < nodes.len() {
            let (faces, depth, (center, half)) = (nodes[i].faces.clone(), nodes[i].depth, cubes[i]);
            i += 1;
            if faces.len() <= leaf_triangles || depth >= DEEPEST {
                continue;
            }
            let octant = |face: u32| {
                let c = centroids[face as usize];
                usize::from(c.x >= center.x) | usize::from(c.y >= center.y) << 1 | usize::from(c.z >= center.z) << 2
            };
            order[faces.clone()].sort_by_key(|&face| octant(face));
            let first = nodes.len() as u32;
            let mut start = faces.start;
            while start < faces.end {
                let part = octant(order[start]);
                let end = start + order[start..faces.end].partition_point(|&face| octant(face) == part);
                nodes.push(Node { depth: depth + 1, faces: start..end, children: 0..0 });
                let sign = |bit: usize| if part >> bit & 1 == 1 { 0.5 } else { -0.5 };
                cubes.push((center + DVec3::new(sign(0), sign(1), sign(2)) * half, half * 0.5));
                start = end;
            }
            nodes[i - 1].children = first..nodes.len() as u32;
        }
        Self { nodes, order, side: geometry.extent }
    }

    /// Returns, for every triangle of the mesh, the node index of the leaf that contains it.
    pub(crate) fn leaf_of_face(&self) -> Vec<u32> {
        let mut leaves = vec![0; self.order.len()];
        for (i, node) in self.nodes.iter().enumerate().filter(|(_, n)| n.children.is_empty()) {
            for face in &self.order[node.faces.clone()] {
                leaves[*face as usize] = i as u32;
            }
        }
        leaves
    }
}
