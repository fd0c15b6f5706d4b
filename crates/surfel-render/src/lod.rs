//! Which parts of an octree a view needs, as splats or as polygons (§6, after G06 §5.2).

use crate::View;
use glam::{DAffine3, DVec3};
use std::ops::Range;
use surfel_math::basis::unit;
use surfel_model::{Cull, Octree, OctreeNode};

/// What of an octree is drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Splats, as ranges of its cloud in ascending order.
    pub splats: Vec<Range<u32>>,
    /// Polygons, as ranges of its mesh's triangles in ascending order.
    pub triangles: Vec<Range<u32>>,
}

impl Selection {
    /// True if splat `i` of the cloud is drawn.
    pub fn has_splat(&self, i: u32) -> bool {
        holds(&self.splats, i)
    }

    /// True if triangle `i` of the mesh is drawn.
    pub fn has_triangle(&self, i: u32) -> bool {
        holds(&self.triangles, i)
    }
}

/// True if one of the ranges, which ascend, holds `i`.
fn holds(ranges: &[Range<u32>], i: u32) -> bool {
    let after = ranges.partition_point(|range| range.end <= i);
    ranges.get(after).is_some_and(|range| range.contains(&i))
}

/// How a leaf is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Drawn {
    /// Not at all.
    Culled,
    /// By its own splats.
    Splats,
    /// By the splats of a node above it.
    Above,
    /// By its polygons.
    Polygons,
}

/// Chooses the coarsest nodes whose splats are no larger than `error_px` pixels, and where those of a leaf are, its
/// polygons.
///
/// Nodes outside of the image are left out, whatever region of it is drawn, and with [`Cull::Back`] those that face
/// away as a whole. A transition's splats are drawn once if either of its leaves is drawn by its own splats, or one as
/// polygons and the other by splats of a node above; between two leaves under such nodes none are missing (ours: G06
/// draws them too).
pub fn select(octree: &Octree, world_from_object: &DAffine3, cull: Cull, view: &View, error_px: f64) -> Selection {
    let nodes = octree.nodes();
    let eye = Eye::new(world_from_object, cull, view);
    let mut drawn = vec![Drawn::Culled; nodes.len()];
    let mut selection = Selection::default();
    let mut open: Vec<u32> = vec![0];
    while let Some(i) = open.pop() {
        let Some(node) = nodes.get(i as usize) else { continue };
        if !eye.sees(octree.center_of(node), node) {
            continue;
        }
        // A node too small for a splat of its size has none.
        let small = eye.size_px(octree.center_of(node), node) <= error_px;
        if small && !node.splats.is_empty() {
            selection.splats.push(node.splats.clone());
            cover(nodes, i, &mut drawn);
        } else if node.is_leaf() {
            selection.triangles.push(node.triangles.clone());
            drawn[i as usize] = Drawn::Polygons;
        } else {
            open.extend(node.children.clone());
        }
    }
    for transition in octree.transitions() {
        use Drawn::{Above, Polygons, Splats};
        let [a, b] = transition.leaves.map(|leaf| drawn[leaf as usize]);
        if a == Splats || b == Splats || matches!((a, b), (Polygons, Above) | (Above, Polygons)) {
            selection.splats.push(transition.splats.clone());
        }
    }
    selection.splats.sort_by_key(|r| r.start);
    selection.triangles.sort_by_key(|r| r.start);
    selection
}

/// Marks the leaves that a node's splats stand for.
fn cover(nodes: &[OctreeNode], root: u32, drawn: &mut [Drawn]) {
    let mut open = vec![root];
    while let Some(i) = open.pop() {
        let node = &nodes[i as usize];
        drawn[i as usize] = if i == root { Drawn::Splats } else { Drawn::Above };
        open.extend(node.children.clone());
    }
}

/// A view of an object.
struct Eye<'a> {
    world_from_object: &'a DAffine3,
    view: &'a View,
    cull: Cull,
    /// Greatest factor by which a length grows from object to world.
    scale: f64,
    /// True if normals keep their angles: rotation, uniform scale, no mirror.
    conformal: bool,
    /// Inward normals of the view's side planes, in view space, and their distance from the eye.
    sides: [(DVec3, f64); 4],
}

impl<'a> Eye<'a> {
    fn new(world_from_object: &'a DAffine3, cull: Cull, view: &'a View) -> Self {
        let m = world_from_object.matrix3;
        // The largest column sum bounds the largest singular value from above within √3; exact for similarities.
        let gram = m.transpose() * m;
        let columns = [gram.x_axis.x, gram.y_axis.y, gram.z_axis.z];
        let mean = columns.iter().sum::<f64>() / 3.0;
        let off = [gram.x_axis.y, gram.x_axis.z, gram.y_axis.z];
        let conformal = columns.iter().all(|c| (c - mean).abs() <= 1e-9 * mean)
            && off.iter().all(|o| o.abs() <= 1e-9 * mean)
            && m.determinant() > 0.0;
        let scale = if conformal { mean.sqrt() } else { columns.iter().sum::<f64>().sqrt() };
        let p = &view.projection;
        // Those of the whole image, so that a region of it has the same parts, and the same shadows.
        let [width, height] = view.size.map(f64::from);
        let slope = |pixel: f64, axis: usize| (pixel - p.principal_px[axis]) / p.focal_px[axis];
        let side = |axis: DVec3, at: f64| match p.is_perspective() {
            // axis·v ≥ at·z, scaled to a unit normal.
            true => (unit(axis - DVec3::Z * at), 0.0),
            false => (axis, at),
        };
        let sides = [
            side(DVec3::X, slope(0.0, 0)),
            side(-DVec3::X, -slope(width, 0)),
            side(DVec3::Y, slope(0.0, 1)),
            side(-DVec3::Y, -slope(height, 1)),
        ];
        Self { world_from_object, view, cull, scale, conformal, sides }
    }

    /// View position of an object's point.
    fn at(&self, p: DVec3) -> DVec3 {
        self.view.view_from_world * (self.world_from_object.transform_point3(p) - self.view.eye)
    }

    /// False if no part of a node can show.
    fn sees(&self, center: DVec3, node: &OctreeNode) -> bool {
        let (p, radius) = (self.at(center), node.radius * self.scale);
        let projection = &self.view.projection;
        // A filter reaches a pixel or so past a splat's own extent.
        let margin = radius + 2.0 * self.pixel_size(p.z + radius);
        if p.z + radius < projection.near || p.z - radius > projection.far() {
            return false;
        }
        if self.sides.iter().any(|(normal, distance)| normal.dot(p) - distance < -margin) {
            return false;
        }
        !(self.cull == Cull::Back && self.conformal && self.faces_away(p, radius, node))
    }

    /// True if every normal in the node's cone faces away from the eye at every point of its sphere.
    fn faces_away(&self, p: DVec3, radius: f64, node: &OctreeNode) -> bool {
        let m = self.world_from_object.matrix3;
        let axis = unit(self.view.view_from_world * (m * DVec3::from(node.cone_axis)));
        let (toward, spread) = match self.view.projection.is_perspective() {
            true if p.length() <= radius => return false,
            true => (unit(p), (radius / p.length()).asin()),
            false => (DVec3::Z, 0.0),
        };
        let apart = axis.dot(toward).clamp(-1.0, 1.0).acos();
        apart + node.cone_cosine.clamp(-1.0, 1.0).acos() + spread < std::f64::consts::FRAC_PI_2
    }

    /// Size of a pixel at depth z, world units.
    fn pixel_size(&self, z: f64) -> f64 {
        let p = &self.view.projection;
        let focal = p.focal_px[0].min(p.focal_px[1]);
        if p.is_perspective() { z.max(p.near) / focal } else { 1.0 / focal }
    }

    /// Pixels that a node's splats measure where the node is nearest.
    fn size_px(&self, center: DVec3, node: &OctreeNode) -> f64 {
        let p = self.at(center);
        let focal = self.view.projection.focal_px[0].max(self.view.projection.focal_px[1]);
        let nearest = (p.z - node.radius * self.scale).max(self.view.projection.near);
        let distance = if self.view.projection.is_perspective() { nearest } else { 1.0 };
        node.splat_radius * self.scale * focal / distance
    }
}
