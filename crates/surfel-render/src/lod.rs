//! Selection of the parts of an octree that a view needs, as splats or polygons (rendering model §6, after G06 §5.2),
//! and of LOD nodes of points.

mod early_end;
mod visibility;

use crate::View;
use early_end::EarlyEnd;
use glam::{DAffine3, DVec3};
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::Range;
use surfel_math::basis::unit;
use surfel_model::{Cull, Octree, OctreeNode};
pub use visibility::SplatVisibility;

/// Parts of an octree that are drawn in a view.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Indices of the selected splats in the octree's cloud, as ranges in ascending order.
    pub splats: Vec<Range<u32>>,
    /// Indices of the selected triangles in the octree's mesh, as ranges in ascending order.
    pub triangles: Vec<Range<u32>>,
}

impl Selection {
    /// True if splat `i` of the cloud is selected.
    pub fn has_splat(&self, i: u32) -> bool {
        holds(&self.splats, i)
    }

    /// True if triangle `i` of the mesh is selected.
    pub fn has_triangle(&self, i: u32) -> bool {
        holds(&self.triangles, i)
    }
}

/// True if one of the ranges, which must ascend, contains `i`.
fn holds(ranges: &[Range<u32>], i: u32) -> bool {
    let after = ranges.partition_point(|range| range.end <= i);
    ranges.get(after).is_some_and(|range| range.contains(&i))
}

/// Method by which a leaf of an octree is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Drawn {
    /// The leaf isn't drawn: it is outside the image, or faces away under back-face culling.
    Culled,
    /// The leaf's own splats are drawn.
    Splats,
    /// The splats of an ancestor node are drawn in place of the leaf's own splats.
    Above,
    /// The leaf's polygons are drawn.
    Polygons,
}

/// Selects the coarsest nodes whose splats have a radius of at most `error_px` pixels. A leaf whose splats are larger,
/// or that has none, is drawn as polygons.
///
/// Nodes outside the whole image are skipped, even if only a region of it is drawn. With [`Cull::Back`], nodes that
/// face away completely are skipped, too.
///
/// An edge that two leaves share has transition splats. They are selected if one of the two leaves is drawn by its own
/// splats. They are also selected if one leaf is drawn as polygons and the other by an ancestor's splats. If ancestors'
/// splats replace both leaves, no transition splats are needed. This rule is Surfel's own: G06 draws the transition
/// splats there, too.
pub fn select(octree: &Octree, world_from_object: &DAffine3, cull: Cull, view: &View, error_px: f64) -> Selection {
    let nodes = octree.nodes();
    let eye = Eye::new(world_from_object, cull, view);
    let mut drawn = vec![Drawn::Culled; nodes.len()];
    let mut selection = Selection::default();
    let mut open: Vec<u32> = vec![0];
    while let Some(i) = open.pop() {
        let Some(node) = nodes.get(i as usize) else { continue };
        let center = octree.center_of(node);
        if !eye.may_be_visible(center, node.radius) || eye.is_culled_back_facing(center, node) {
            continue;
        }
        // A node smaller than the splats of its level has no splats.
        let small = eye.size_px(center, node.radius, node.splat_radius) <= error_px;
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

/// Marks, in `drawn`, the node `root` as drawn by its own splats and all nodes below it as drawn by an ancestor's
/// splats.
fn cover(nodes: &[OctreeNode], root: u32, drawn: &mut [Drawn]) {
    let mut open = vec![root];
    while let Some(i) = open.pop() {
        let node = &nodes[i as usize];
        drawn[i as usize] = if i == root { Drawn::Splats } else { Drawn::Above };
        open.extend(node.children.clone());
    }
}

/// Distance outside a view, in pixels, up to which parts of an object are still drawn, because a filter extends a splat
/// by about a pixel.
const MARGIN_PX: f64 = 2.0;

/// An object's placement relative to a view, for testing which parts of the object are visible and how large they are
/// in pixels.
struct Eye<'a> {
    world_from_object: &'a DAffine3,
    view: &'a View,
    cull: Cull,
    /// Upper bound of the factor by which the object's matrix lengthens a vector; exact for rotation with uniform
    /// scale.
    scale: f64,
    /// True if the object's matrix preserves angles and handedness: rotation and uniform scale, no mirror.
    conformal: bool,
    /// Left, right, top and bottom plane of the view. Each is an inward unit normal in view space and the plane's
    /// distance from the eye along the normal, in world units.
    sides: [(DVec3, f64); 4],
    /// Axes of the object in view space, with the lengths that the object's matrix gives them.
    axes: [DVec3; 3],
}

impl<'a> Eye<'a> {
    fn new(world_from_object: &'a DAffine3, cull: Cull, view: &'a View) -> Self {
        let m = world_from_object.matrix3;
        // The root of the sum of squared columns is at least the largest singular value, and at most √3 times as large.
        // For similarities, the scale is exact.
        let gram = m.transpose() * m;
        let columns = [gram.x_axis.x, gram.y_axis.y, gram.z_axis.z];
        let mean = columns.iter().sum::<f64>() / 3.0;
        let off = [gram.x_axis.y, gram.x_axis.z, gram.y_axis.z];
        let conformal = columns.iter().all(|c| (c - mean).abs() <= 1e-9 * mean)
            && off.iter().all(|o| o.abs() <= 1e-9 * mean)
            && m.determinant() > 0.0;
        let scale = if conformal { mean.sqrt() } else { columns.iter().sum::<f64>().sqrt() };
        let p = &view.projection;
        // These are the sides of the whole image, not of its region, so that all regions of an image select the same
        // nodes.
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
        let axes = [m.x_axis, m.y_axis, m.z_axis].map(|axis| view.view_from_world * axis);
        Self { world_from_object, view, cull, scale, conformal, sides, axes }
    }

    /// Returns the view-space position of a point of the object.
    fn at(&self, p: DVec3) -> DVec3 {
        self.view.view_from_world * (self.world_from_object.transform_point3(p) - self.view.eye)
    }

    /// True if a part of a sphere, given in object space, may be visible.
    fn may_be_visible(&self, center: DVec3, radius: f64) -> bool {
        self.may_be_visible_within((center, radius), MARGIN_PX, |_| 0.0)
    }

    /// True if a part of a body may be visible, after the body is grown by `radius` (object units) plus `margin_px`
    /// pixels. `reach` returns the extent of the body from its centre along a direction in view space, in world units.
    fn may_be_visible_within(
        &self,
        (center, radius): (DVec3, f64),
        margin_px: f64,
        reach: impl Fn(DVec3) -> f64,
    ) -> bool {
        let (p, radius) = (self.at(center), radius * self.scale);
        let projection = &self.view.projection;
        let depth = radius + reach(DVec3::Z);
        let margin = radius + margin_px * self.pixel_size(p.z + depth);
        if p.z + depth < projection.near || p.z - depth > projection.far() {
            return false;
        }
        !self.sides.iter().any(|(normal, distance)| normal.dot(p) - distance < -margin - reach(*normal))
    }

    /// Returns the distance from a cube's centre to its farthest corner along a direction in view space, in world
    /// units. The cube is aligned with the object's axes, and `half` is half of its side in object units.
    fn cube_reach(&self, half: f64, direction: DVec3) -> f64 {
        half * self.axes.iter().map(|axis| axis.dot(direction).abs()).sum::<f64>()
    }

    /// True if a node is culled because its whole surface faces away from the eye. Always false without back-face
    /// culling, and if the object's matrix isn't conformal.
    fn is_culled_back_facing(&self, center: DVec3, node: &OctreeNode) -> bool {
        let (p, radius) = (self.at(center), node.radius * self.scale);
        self.cull == Cull::Back && self.conformal && self.faces_away(p, radius, node)
    }

    /// True if every normal in the node's cone faces away from the eye, seen from every point of the node's sphere. The
    /// sphere has centre `p` in view space and `radius` in world units.
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

    /// Returns the larger side of a pixel, in world units, at depth `z`, or at the near plane if `z` is nearer. In an
    /// orthographic view, the result doesn't depend on `z`.
    fn pixel_size(&self, z: f64) -> f64 {
        let p = &self.view.projection;
        let focal = p.focal_px[0].min(p.focal_px[1]);
        if p.is_perspective() { z.max(p.near) / focal } else { 1.0 / focal }
    }

    /// Returns the projected size, in pixels, of `length` (object units) at the nearest point of a sphere.
    fn size_px(&self, center: DVec3, radius: f64, length: f64) -> f64 {
        self.size_at(self.at(center).z - radius * self.scale, length)
    }

    /// Returns the projected size, in pixels, of `length` (object units) at depth `z`, or at the near plane if `z` is
    /// nearer.
    fn size_at(&self, z: f64, length: f64) -> f64 {
        let focal = self.view.projection.focal_px[0].max(self.view.projection.focal_px[1]);
        let nearest = z.max(self.view.projection.near);
        let distance = if self.view.projection.is_perspective() { nearest } else { 1.0 };
        length * self.scale * focal / distance
    }
}

/// Magnification of an object in a view: pixels per object unit, as a function of the position in object space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Magnification {
    /// Depth of a point as a linear function over object space: its gradient, and its value at the object's origin.
    depth: (DVec3, f64),
    /// Depth of the near plane, in world units.
    near: f64,
    /// Projected size, in pixels, of an object unit at depth 1 (perspective), or at any depth (orthographic).
    factor: f64,
    is_perspective: bool,
}

impl Magnification {
    /// Computes the magnification of an object in a view.
    pub fn new(world_from_object: &DAffine3, view: &View) -> Self {
        let eye = Eye::new(world_from_object, Cull::None, view);
        let projection = &view.projection;
        let factor = eye.scale * projection.focal_px[0].max(projection.focal_px[1]);
        let depth = (DVec3::from(eye.axes.map(|axis| axis.z)), eye.at(DVec3::ZERO).z);
        Self { depth, near: projection.near, factor, is_perspective: projection.is_perspective() }
    }

    /// Returns the projected size, in pixels, of an object unit at a point, or at the near plane if the point is
    /// nearer.
    pub fn at(&self, point: DVec3) -> f64 {
        self.at_depth(self.depth.0.dot(point) + self.depth.1)
    }

    /// Returns the smallest magnification, in pixels per object unit, in a cube that is aligned with the object's axes.
    /// `half` is half of the cube's side.
    pub fn least_in(&self, center: DVec3, half: f64) -> f64 {
        self.at_depth(self.depth.0.dot(center) + self.depth.1 + half * self.depth.0.abs().element_sum())
    }

    fn at_depth(&self, z: f64) -> f64 {
        if self.is_perspective { self.factor / z.max(self.near) } else { self.factor }
    }
}

/// Level-of-detail (LOD) node of a point cloud: a cube with some of the cloud's points. In the cube, the node's points
/// and its ancestors' points together represent the cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelNode {
    /// Centre of a cube around the node's points, along the axes of object space.
    pub center: DVec3,
    /// Half of the cube's side, in object units.
    pub half: f64,
    /// Radius, in object units, of splats that cover the surface when this node is drawn: half of the parent node's
    /// radius.
    pub splat_radius: f64,
    /// Number of the node's own points, without its ancestors' points.
    pub points: u64,
    /// Indices of the node's children in the list of nodes; children follow their parents.
    pub children: Range<u32>,
}

/// LOD nodes of a point cloud that [`select_levels`] selected, and the remaining error.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelSelection {
    /// Selected nodes in ascending order; the ancestors of each are selected too.
    pub nodes: Vec<u32>,
    /// Number of points of the selected nodes.
    pub points: u64,
    /// Largest radius, in pixels, of splats that are drawn in place of visible finer nodes, because these are not
    /// selected.
    pub error_px: f64,
    /// Reason why the selection ended; explains why `error_px` may exceed the requested error.
    pub end: StopReason,
}

/// Stop reason of a selection of LOD nodes ([`select_levels`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StopReason {
    /// All visible splats are as small in the image as requested, or their nodes have no children.
    #[default]
    Error,
    /// The next node would exceed the point budget.
    Points,
    /// There are so many points per pixel that more of them would hardly change the image.
    EnoughPoints,
}

/// Number of octaves (halvings) of the viewing distance during which the points of a finer level fade in. A larger
/// number changes less from one image to the next, and draws larger splats.
pub const FADE_OCTAVES: f64 = 0.5;

/// Distance outside a view up to which LOD nodes still count as visible, in splat radii of the parent node. Splats at
/// the view's border thereby overlap with their neighbours outside.
const RIM: f64 = 4.0;

/// Selects the LOD nodes that views need. The root is always selected, even if it has more than `most_points` points. A
/// child of a selected node is wanted if it is visible in some view, and its parent's splats have a radius above
/// `error_px` pixels at the nearest point of the child. Wanted children for which the parent's splats are largest are
/// selected first. The selection ends before `most_points` points are exceeded, or when more points would be barely
/// visible ([`StopReason::EnoughPoints`]).
pub fn select_levels(
    nodes: &[LevelNode],
    world_from_object: &DAffine3,
    views: &[View],
    error_px: f64,
    most_points: u64,
) -> LevelSelection {
    let eyes: Vec<Eye<'_>> = views.iter().map(|view| Eye::new(world_from_object, Cull::None, view)).collect();
    // Size in pixels of the splats drawn in place of an unselected node; 0 if the node is outside all views.
    let without = |node: &LevelNode| {
        let coarser = 2.0 * node.splat_radius;
        let size_px = |eye: &Eye<'_>| {
            let reach = |direction| eye.cube_reach(node.half, direction);
            let nearest = eye.at(node.center).z - reach(DVec3::Z);
            eye.may_be_visible_within((node.center, RIM * coarser), MARGIN_PX, reach)
                .then(|| eye.size_at(nearest, coarser))
        };
        eyes.iter().filter_map(size_px).fold(0.0, f64::max)
    };
    let (mut selection, mut sizes) = (LevelSelection::default(), Vec::new());
    let mut open = BinaryHeap::from([LodCandidate { size_px: f64::INFINITY, node: 0 }]);
    while let Some(next) = open.pop() {
        let Some(node) = nodes.get(next.node as usize) else { continue };
        if !sizes.is_empty() && selection.points.saturating_add(node.points) > most_points {
            (selection.error_px, selection.end) = (next.size_px, StopReason::Points);
            open.push(next);
            break;
        }
        selection.nodes.push(next.node);
        sizes.push((next.size_px, node));
        selection.points = selection.points.saturating_add(node.points);
        for child in node.children.clone() {
            let size_px = nodes.get(child as usize).map_or(0.0, without);
            if size_px > error_px {
                open.push(LodCandidate { size_px, node: child });
            } else {
                selection.error_px = selection.error_px.max(size_px);
            }
        }
    }
    let least_px = if selection.end == StopReason::Points { selection.error_px } else { error_px };
    let left = open.into_sorted_vec().into_iter().rev();
    sizes.extend(left.filter_map(|wanted| Some((wanted.size_px, nodes.get(wanted.node as usize)?))));
    if let Some(enough_px) = EarlyEnd::error_px(&eyes, &sizes, (error_px, least_px)) {
        // A node's size is at least that of each of its children, so `sizes` descends and ancestors come first.
        let taken = sizes.partition_point(|(size_px, _)| *size_px > enough_px);
        selection.nodes.truncate(taken);
        selection.points = sizes[..taken].iter().fold(0, |sum, (_, node)| node.points.saturating_add(sum));
        (selection.error_px, selection.end) = (enough_px, StopReason::EnoughPoints);
    }
    selection.nodes.sort_unstable();
    selection
}

/// A node that a selection may add next. In the order of [`Ord`], the greatest is the node with the largest `size_px`,
/// and among equal sizes the node with the lowest index.
struct LodCandidate {
    /// Size, in pixels, of the parent's splats, which are drawn in place of the node.
    size_px: f64,
    /// Index of the node in the list of nodes.
    node: u32,
}

impl Ord for LodCandidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.size_px.total_cmp(&other.size_px).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for LodCandidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for LodCandidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for LodCandidate {}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Camera;

    /// Returns a square of 16 x 16 cells of size 1 around the origin, with levels of nodes of 100 points each.
    fn square() -> Vec<LevelNode> {
        let mut nodes = Vec::new();
        for level in 0..5_u32 {
            let (cells, side) = (1_u32 << level, 16.0 / f64::from(1_u32 << level));
            let first = nodes.len() as u32 + cells * cells;
            for i in 0..cells * cells {
                // In Morton order, because children must be consecutive.
                let bit = |k: u32, shift: u32| (i >> (2 * k + shift) & 1) << k;
                let at = |shift| (0..level).map(|k| bit(k, shift)).sum::<u32>();
                let middle = |c: u32| (f64::from(c) + 0.5) * side - 8.0;
                let children = if level == 4 { 0..0 } else { first + 4 * i..first + 4 * i + 4 };
                let center = DVec3::new(middle(at(0)), middle(at(1)), 0.0);
                let splat_radius = side / 10.0;
                nodes.push(LevelNode { center, half: side / 2.0, splat_radius, points: 100, children });
            }
        }
        nodes
    }

    fn from_above(height: f64, size: u32) -> View {
        let camera = Camera::perspective([0.0, 0.0, height], [0.0; 3], 90.0, [size, size]).with_up([0.0, 1.0, 0.0]);
        View::new(&camera).unwrap()
    }

    #[test]
    fn nodes_chosen_are_a_tree_whose_splats_are_small_enough() {
        let nodes = square();
        for (height, size) in [(10.0, 100), (100.0, 100), (3.0, 400), (1000.0, 64)] {
            let view = from_above(height, size);
            let error_px = 2.0;
            let found = select_levels(&nodes, &DAffine3::IDENTITY, std::slice::from_ref(&view), error_px, u64::MAX);
            assert!(found.nodes.is_sorted() && found.nodes[0] == 0 && found.error_px <= error_px);
            assert_eq!(found.points, 100 * found.nodes.len() as u64);
            let chosen = |i: u32| found.nodes.binary_search(&i).is_ok();
            let focal = f64::from(size) / 2.0;
            for (i, node) in nodes.iter().enumerate() {
                for child in node.children.clone() {
                    let nearest = height - nodes[child as usize].half;
                    let size_px = node.splat_radius * focal / nearest.max(view.projection.near);
                    let center = nodes[child as usize].center;
                    let inside = center.x.abs().max(center.y.abs()) < height;
                    if chosen(child) {
                        assert!(chosen(i as u32) && size_px > error_px, "{child} at {height}");
                    } else if inside && chosen(i as u32) {
                        assert!(size_px <= error_px + 1e-9, "{child} at {height}: {size_px}");
                    }
                }
            }
        }
    }

    #[test]
    fn budget_takes_the_coarsest_first_and_views_add_up() {
        let nodes = square();
        let (near, far) = (from_above(4.0, 800), from_above(40.0, 100));
        let all = select_levels(&nodes, &DAffine3::IDENTITY, std::slice::from_ref(&near), 0.5, u64::MAX);
        let mut last = 0;
        for most in [0, 100, 500, 2000, 10_000] {
            let some = select_levels(&nodes, &DAffine3::IDENTITY, std::slice::from_ref(&near), 0.5, most);
            assert!(some.points <= most.max(100) && some.points >= last);
            assert!(some.nodes.iter().all(|i| all.nodes.contains(i)));
            assert!(some.points == all.points || some.error_px > 0.5);
            last = some.points;
        }
        let both = select_levels(&nodes, &DAffine3::IDENTITY, &[near, far.clone()], 0.5, u64::MAX);
        let other = select_levels(&nodes, &DAffine3::IDENTITY, &[far], 0.5, u64::MAX);
        assert!(all.nodes.iter().chain(&other.nodes).all(|i| both.nodes.contains(i)));
    }

    #[test]
    fn nodes_out_of_sight_are_left_out() {
        let nodes = square();
        let camera = Camera::perspective([6.0, 6.0, 1.0], [7.0, 7.0, 0.0], 40.0, [400, 400]).with_up([0.0, 0.0, 1.0]);
        let view = View::new(&camera).unwrap();
        let found = select_levels(&nodes, &DAffine3::IDENTITY, &[view], 1.0, u64::MAX);
        let is_behind = |i: &u32| nodes[*i as usize].center.x < 0.0 && nodes[*i as usize].half < 2.0;
        assert!(found.nodes.len() > 20 && !found.nodes.iter().any(is_behind), "{found:?}");
    }

    #[test]
    fn cubes_are_measured_where_they_are_nearest_and_seen_wherever_a_part_is() {
        let mut random = 1_u64;
        let mut next = |low: f64, high: f64| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            low + (high - low) * (random >> 11) as f64 / (1_u64 << 53) as f64
        };
        let (mut seen, mut left_out) = (0, 0);
        for round in 0..1000 {
            // Sizes from fractions of a micrometre to the size of the Earth.
            let unit = [1.0, 1e-6, 1e7][round % 3];
            let place = |next: &mut dyn FnMut(f64, f64) -> f64| DVec3::from([(); 3].map(|()| next(-9.0, 9.0) * unit));
            let (eye, target) = (place(&mut next), place(&mut next));
            let mut camera = Camera::perspective(eye.to_array(), target.to_array(), next(5.0, 120.0), [640, 480]);
            if round % 4 == 0 {
                let (eye, target) = (eye.to_array(), target.to_array());
                camera = Camera::orthographic(eye, target, next(0.5, 9.0) * unit, 30.0 * unit, [640, 480]);
            }
            camera.near = 0.01 * unit;
            let view = View::new(&camera).unwrap();
            let turn = glam::DQuat::from_scaled_axis(place(&mut next) / unit);
            let world_from_object = DAffine3::from_rotation_translation(turn, place(&mut next));
            let eye = Eye::new(&world_from_object, Cull::None, &view);
            let (center, half) = (place(&mut next), next(0.01, 4.0) * unit);
            let at = |[x, y, z]: [f64; 3]| eye.at(center + half * DVec3::new(x, y, z));
            let signs = |i: u32| [0, 1, 2].map(|k| if i >> k & 1 == 1 { 1.0 } else { -1.0 });
            let nearest = (0..8).map(|i| at(signs(i)).z).fold(f64::INFINITY, f64::min);
            let found = eye.at(center).z - eye.cube_reach(half, DVec3::Z);
            // Rounding of sums of a few terms.
            assert!((found - nearest).abs() <= 1e-13 * 40.0 * unit, "{round}: {found} {nearest}");
            let magnification = Magnification::new(&world_from_object, &view);
            let focal = view.projection.focal_px[0].max(view.projection.focal_px[1]);
            let exact = |z: f64| focal / if view.projection.is_perspective() { z.max(camera.near) } else { 1.0 };
            let farthest = (0..8).map(|i| at(signs(i)).z).fold(f64::NEG_INFINITY, f64::max);
            for (found, z) in
                [(magnification.at(center), eye.at(center).z), (magnification.least_in(center, half), farthest)]
            {
                // A depth's rounding is that of the distance relative to the near plane, 40 over 0.01.
                assert!((found / exact(z) - 1.0).abs() < 1e-13 * 4000.0, "{round}: {found} {}", exact(z));
            }
            let sees = eye.may_be_visible_within((center, 0.0), MARGIN_PX, |direction| eye.cube_reach(half, direction));
            let projection = &view.projection;
            let shows = (0..500).any(|_| {
                let p = at([(); 3].map(|()| next(-1.0, 1.0)));
                let depth = if projection.is_perspective() { p.z } else { 1.0 };
                let px = |k: usize| p[k] / depth * projection.focal_px[k] + projection.principal_px[k];
                let inside = (0.0..640.0).contains(&px(0)) && (0.0..480.0).contains(&px(1));
                inside && p.z >= projection.near && p.z <= projection.far()
            });
            assert!(sees || !shows, "{round}");
            seen += u32::from(sees);
            // The sphere around a cube is visible more often.
            left_out += u32::from(!sees && eye.may_be_visible(center, half * 3_f64.sqrt()));
        }
        assert!(seen > 200 && left_out > 15, "{seen} {left_out}");
    }
}
