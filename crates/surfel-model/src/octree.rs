//! Octree of a surface, stored both as splats of several sizes and as polygons (rendering model §6).

use crate::{CloudData, Column3, Mesh, ModelError, OnInvalid, Shape, SplatCloud};
use glam::DVec3;
use std::ops::Range;
use std::sync::Arc;

/// Octree node: a region of the surface, stored both as polygons and as splats that replace them.
#[derive(Clone, Debug, PartialEq)]
pub struct OctreeNode {
    /// Centre of a sphere around the node's splats and polygons, relative to the mesh's origin, in object units.
    pub center: [f64; 3],
    /// Radius of the sphere, in object units.
    pub radius: f64,
    /// Larger semi-axis of the node's splats, in object units. It is also the largest error of drawing the splats
    /// instead of the surface.
    pub splat_radius: f64,
    /// Axis of a cone that contains the outward normals of the node's splats and polygons; a unit vector in object
    /// space.
    pub cone_axis: [f64; 3],
    /// Cosine of the half-angle of the cone of normals; −1 if the normals have all directions.
    pub cone_cosine: f64,
    /// Indices of the node's children, at most 8; empty for a leaf.
    pub children: Range<u32>,
    /// Range of the node's splats, as indices into the octree's cloud.
    pub splats: Range<u32>,
    /// Range of all polygons of the surface in the node, as indices into the octree mesh's triangles.
    pub triangles: Range<u32>,
}

impl OctreeNode {
    /// True for a node without children.
    pub fn is_leaf(&self) -> bool {
        self.children.is_empty()
    }
}

/// Splats centred on the edges that two leaves of an octree share. The leaves' own splats are left out near these edges
/// (rendering model §6).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Transition {
    /// Indices of the two leaves in the octree's nodes.
    pub leaves: [u32; 2],
    /// Range of the splats, as indices into the octree's cloud.
    pub splats: Range<u32>,
}

/// Validated octree of splats and polygons: its nodes form a tree, and all its index ranges are within bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct Octree {
    cloud: Arc<SplatCloud>,
    mesh: Arc<Mesh>,
    nodes: Vec<OctreeNode>,
    transitions: Vec<Transition>,
}

impl Octree {
    /// Creates an octree from splats, polygons, nodes and transitions, and validates them.
    ///
    /// Nodes must be in breadth-first order, the root first, so that the children of all nodes are consecutive. The
    /// splats of the nodes are consecutive in the same order, followed by those of the transitions. The triangles of a
    /// node's children are consecutive and make up all of its own; the root has all triangles.
    ///
    /// # Errors
    /// [`ModelError`] naming the first node, transition or splat that breaks these rules, or a problem of the mesh;
    /// [`ModelError::Conflict`] for a mesh with [`Mesh::materials`].
    pub fn new(
        cloud: SplatCloud,
        mesh: Mesh,
        nodes: Vec<OctreeNode>,
        transitions: Vec<Transition>,
    ) -> Result<Self, ModelError> {
        mesh.validate()?;
        if mesh.materials.is_some() {
            let problem = "an octree's mesh has a material for each triangle, expected one for all: give it \
                           Mesh::with_one_material";
            return Err(ModelError::Conflict(problem.into()));
        }
        let broken = |what: &str, i: usize, problem: &str| {
            Err(ModelError::Conflict(format!("{what} {i} of the octree {problem}: the file is damaged")))
        };
        let finite = |n: &OctreeNode| {
            let numbers = [n.center, n.cone_axis, [n.radius, n.splat_radius, n.cone_cosine]];
            numbers.as_flattened().iter().all(|v| v.is_finite()) && n.radius >= 0.0 && n.splat_radius >= 0.0
        };
        let whole = nodes.first().map(|n| &n.triangles);
        if whole != Some(&(0..mesh.triangles.len() as u32)) {
            return broken("node", 0, "doesn't hold all triangles");
        }
        let (mut next_node, mut next_splat) = (1, 0);
        for (i, node) in nodes.iter().enumerate() {
            if !finite(node) {
                return broken("node", i, "has a number out of range");
            }
            if node.splats.start != next_splat || node.splats.end < node.splats.start {
                return broken("node", i, "has splats out of order");
            }
            next_splat = node.splats.end;
            if node.is_leaf() {
                continue;
            }
            let children = node.children.clone();
            if children.start != next_node || children.len() > 8 || children.end as usize > nodes.len() {
                return broken("node", i, "has children out of order");
            }
            next_node = children.end;
            let mut next_triangle = node.triangles.start;
            for child in &nodes[children.start as usize..children.end as usize] {
                if child.triangles.start != next_triangle || child.triangles.end < next_triangle {
                    return broken("node", i, "has children whose triangles are out of order");
                }
                next_triangle = child.triangles.end;
            }
            if next_triangle != node.triangles.end {
                return broken("node", i, "has triangles that its children lack");
            }
        }
        if next_node as usize != nodes.len() {
            return broken("node", next_node as usize, "has no parent");
        }
        for (i, transition) in transitions.iter().enumerate() {
            let [a, b] = transition.leaves.map(|l| nodes.get(l as usize).is_some_and(OctreeNode::is_leaf));
            if !a || !b || transition.leaves[0] == transition.leaves[1] {
                return broken("transition", i, "isn't between two leaves");
            }
            if transition.splats.start != next_splat || transition.splats.end < next_splat {
                return broken("transition", i, "has splats out of order");
            }
            next_splat = transition.splats.end;
        }
        if next_splat as usize != cloud.len() {
            return broken("splat", next_splat as usize, "belongs to nothing, or isn't there");
        }
        Ok(Self { cloud: Arc::new(cloud), mesh: Arc::new(mesh), nodes, transitions })
    }

    /// Returns all splats.
    pub fn cloud(&self) -> &SplatCloud {
        &self.cloud
    }

    /// Returns all polygons.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Sets the interior weight ([`CloudData::interior_weight`]): the typical sum of kernel weights of the octree's
    /// splats inside the surface. Ignored unless finite and greater than 0.
    pub fn set_interior_weight(&mut self, weight: f64) {
        Arc::make_mut(&mut self.cloud).set_interior_weight(weight);
    }

    /// Returns a shared reference to all splats.
    pub fn shared_cloud(&self) -> Arc<SplatCloud> {
        self.cloud.clone()
    }

    /// Returns a shared reference to all polygons.
    pub fn shared_mesh(&self) -> Arc<Mesh> {
        self.mesh.clone()
    }

    /// Returns the nodes, the root first.
    pub fn nodes(&self) -> &[OctreeNode] {
        &self.nodes
    }

    /// Returns the transitions: the splats on the edges between leaves.
    pub fn transitions(&self) -> &[Transition] {
        &self.transitions
    }

    /// Returns the ranges of splats that are always selected together, as consecutive indices into the cloud. The
    /// ranges of the nodes precede those of the transitions.
    pub fn parts(&self) -> impl Iterator<Item = Range<u32>> + '_ {
        let of_nodes = self.nodes.iter().map(|node| node.splats.clone());
        of_nodes.chain(self.transitions.iter().map(|transition| transition.splats.clone()))
    }

    /// Returns the ranges of the finest splats, which are those of leaves and transitions, as indices into the cloud.
    pub fn finest(&self) -> impl Iterator<Item = Range<u32>> + '_ {
        let of_leaves = self.nodes.iter().filter(|node| node.is_leaf()).map(|node| node.splats.clone());
        of_leaves.chain(self.transitions.iter().map(|transition| transition.splats.clone()))
    }

    /// Returns the heap memory of the splats, nodes and transitions, in bytes; that of the mesh is not included.
    pub fn bytes(&self) -> usize {
        self.cloud.bytes() + size_of_val(self.nodes.as_slice()) + size_of_val(self.transitions.as_slice())
    }

    /// Returns the splats in the ranges `splats` as a cloud of their own; ranges out of bounds are cut off. Rows,
    /// labels, uninterpreted columns and comments are dropped.
    pub fn cloud_of(&self, splats: &[Range<u32>]) -> Result<SplatCloud, ModelError> {
        let count = self.cloud.len() as u32;
        let indices: Vec<u32> = splats.iter().flat_map(|r| r.start..r.end.min(count)).collect();
        let d = self.cloud.data();
        let pick3 = |column: &Vec<[f32; 3]>| indices.iter().map(|&i| column[i as usize]).collect();
        let pick = |column: &Vec<f32>| indices.iter().map(|&i| column[i as usize]).collect::<Vec<f32>>();
        let shape = match &d.shape {
            Shape::Disks { normals, radii } => Shape::Disks { normals: normals.select(&indices), radii: pick(radii) },
            Shape::Ellipses { s, t } => Shape::Ellipses { s: s.select(&indices), t: t.select(&indices) },
            Shape::Balls { radii, in_pixels, flat } => {
                Shape::Balls { radii: pick(radii), in_pixels: *in_pixels, flat: *flat }
            }
        };
        let data = CloudData {
            colors: d.colors.as_ref().map(pick3),
            alphas: d.alphas.as_ref().map(pick),
            shading_normals: d.shading_normals.as_ref().map(|n: &Column3| n.select(&indices)),
            clips: d.clips.as_ref().map(|clips| clips.select(&indices)),
            interior_weight: d.interior_weight,
            oriented: d.oriented,
            up: d.up,
            ..CloudData::new(d.origin, d.centers.select(&indices), shape)
        };
        Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
    }

    /// Returns the polygons in the ranges `triangles` as a mesh with the vertices that they use; ranges out of bounds
    /// are cut off.
    pub fn mesh_of(&self, triangles: &[Range<u32>]) -> Mesh {
        let count = self.mesh.triangles.len() as u32;
        let triangles: Vec<u32> = triangles.iter().flat_map(|r| r.start..r.end.min(count)).collect();
        let materials = self.mesh.materials.as_ref().map(|all| all.select(triangles.iter().copied()));
        Mesh { materials, ..self.mesh.part(&triangles) }
    }

    /// Returns the centre of a node's sphere in object space.
    pub fn center_of(&self, node: &OctreeNode) -> DVec3 {
        self.mesh.origin + DVec3::from(node.center)
    }
}
