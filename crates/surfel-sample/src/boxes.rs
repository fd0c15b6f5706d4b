//! Hierarchy of oriented boxes around shapes, searched for the nearest shape. Axis-aligned boxes of slivers that meet
//! in a point, as in a fan, all overlap; oriented boxes don't.
//!
//! Boxes around long shapes that cross each other overlap in any orientation. If the two halves of such a node overlap,
//! each long shape is cut into two pieces, which are sorted into the hierarchy separately. The method is early split
//! clipping (Ernst and Greiner 2007). Distances are computed to the whole shape of a piece, so that they are exact.

use crate::eigen::symmetric3;
use glam::DVec3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

/// Maximum number of shapes in a leaf of the hierarchy.
const LEAF: usize = 4;
/// Tolerance of distance bounds for rounding, relative to half the diagonal of the box around all shapes.
const SLACK: f64 = 1e-9;
/// Smallest number of shapes at which a node is tested for a hub, a corner that all its shapes share. Children of a
/// node with a hub are always tested. In ordinary meshes fewer triangles share a corner.
const MIN_AT_HUB: usize = 16;
/// Limits from which the long shapes of a node are cut: smallest number of shapes, and smallest overlap of the node's
/// two children. The overlap is measured along the dividing axis, relative to the extent of both children. Nodes with
/// that many triangles overlap by an eighth at most in an ordinary surface, and by a third among the pages of a book.
const CROSSING: (usize, f64) = (128, 0.5);
/// Limits like [`CROSSING`] for nodes inside a node whose shapes were already cut. Nodes with fewer shapes are cheap to
/// search one by one.
const STILL_CROSSING: (usize, f64) = (8, 0.1);
/// Smallest length of a shape that is cut, relative to the diagonal of its node's box.
const MIN_LENGTH: f64 = 0.2;
/// Largest breadth of a shape that is cut, relative to its length. The boxes of wide shapes that share an edge overlap
/// however often the shapes are cut.
const MAX_BREADTH: f64 = 0.25;
/// Maximum number of cuts in a hierarchy, per shape on average.
const MAX_CUTS_EACH: usize = 63;
/// Maximum number of cuts in a hierarchy, regardless of the number of shapes.
const MAX_CUTS: usize = 1 << 20;
/// Tolerance for the rounding of a squared sine, which [`Fan::distance`] subtracts.
const SINE2_SLACK: f64 = 1e-14;

/// Oriented box around some points, by which distances are bounded.
struct OrientedBox {
    center: DVec3,
    /// Unit vectors along the box's sides, perpendicular to each other.
    axes: [DVec3; 3],
    /// Half-width of the box along each axis.
    half: [f64; 3],
}

/// Node of the hierarchy: a box around some of the shapes, with two children or a few shapes.
struct Node {
    bounds: OrientedBox,
    /// Range of a leaf's shapes in [`Boxes::order`]; empty for other nodes.
    shapes: Range<usize>,
    /// Index of the second child, or 0 for a leaf. The first child follows its parent directly.
    second: usize,
    /// Corner that all shapes of the node share; `None` if they share none, or if there are few shapes.
    hub: Option<Box<SharedCorner>>,
}

/// Corner that all shapes of a node share, as the slivers of a cone do. Boxes give poor bounds there: beyond the
/// corner, all shapes are equally near, and close to the corner, all boxes overlap.
struct SharedCorner {
    corner: Fan,
    /// Directions of the shapes around an edge that all of them share, as the pages of a book do; `None` if they share
    /// none. Projected along itself, the edge is a point.
    edge: Option<Fan>,
    /// Index of the first of the node's shapes, which wins where all are equally near.
    first: u32,
}

/// Directions of shapes around a point or an edge that they share.
struct Fan {
    /// The shared point, twice, or the two ends of the shared edge.
    ends: [DVec3; 2],
    /// Unit vector along the shared edge; zero for a point.
    along: DVec3,
    /// Box around the unit vectors from the shared point to all other corners, projected perpendicular to the shared
    /// edge.
    directions: OrientedBox,
    /// Lower bound of the length of any weighted mean of the unit vectors to one shape's corners. [`Fan::distance`]
    /// needs it for points inside a shape, whose direction is such a mean. It is 1 for slivers, and less for shapes
    /// that are wide at the shared point.
    least_mean: f64,
    /// True if one shape may stand for all where the shared point is nearest: all shapes then have exactly the same
    /// distance. False for nodes with fewer than [`MIN_AT_HUB`] shapes, which are compared one by one.
    are_equally_near: bool,
}

/// Hierarchy of oriented boxes in which the nearest shape is searched.
pub(crate) struct Boxes {
    /// Nodes in preorder: a node, its first subtree, its second subtree.
    nodes: Vec<Node>,
    /// Shapes in the order of the leaves. A shape that was cut may be in several leaves.
    order: Vec<u32>,
    slack: f64,
}

/// Shapes from which a hierarchy is built, and the pieces of those that are cut. Pieces are numbered after the shapes.
struct Pieces<'a, const N: usize> {
    shapes: &'a [[DVec3; N]],
    /// Corners of each piece, and index of the shape from which it was cut.
    cut: Vec<(u32, Vec<DVec3>)>,
}

impl<const N: usize> Pieces<'_, N> {
    /// Returns the corners of shape or piece `i`.
    fn corners(&self, i: u32) -> &[DVec3] {
        let whole = self.shapes.get(i as usize).map(<[DVec3; N]>::as_slice);
        whole.unwrap_or_else(|| &self.cut[i as usize - self.shapes.len()].1)
    }

    /// Returns the index of the shape to which shape or piece `i` belongs.
    fn shape(&self, i: u32) -> u32 {
        (i as usize).checked_sub(self.shapes.len()).map_or(i, |piece| self.cut[piece].0)
    }

    /// Returns the overlap, along an axis, of the first `middle` pieces in `order` and the other pieces. It is relative
    /// to the extent of all pieces, and negative for a gap.
    fn overlap(&self, order: &[u32], middle: usize, axis: DVec3) -> f64 {
        let ends = |half: &[u32]| {
            let along = half.iter().flat_map(|i| self.corners(*i)).map(|p| p.dot(axis));
            along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
        };
        let [(a, b), (c, d)] = [&order[..middle], &order[middle..]].map(|half| ends(half).into());
        (b.min(d) - a.max(c)) / (b.max(d) - a.min(c))
    }

    /// Halves the slender pieces in `order` that are at least `length` long, with at most `room` cuts. Returns the
    /// indices of all resulting pieces; `None` if none was cut.
    fn halved(&mut self, order: &[u32], length: f64, room: usize) -> Option<Vec<u32>> {
        let mut all = Vec::with_capacity(2 * order.len());
        let mut cuts = 0;
        for i in order {
            let [a, b] = longest(self.corners(*i));
            if cuts == room || a.distance(b) < length || !is_slender(self.corners(*i), [a, b]) {
                all.push(*i);
                continue;
            }
            cuts += 1;
            let shape = self.shape(*i);
            for half in halves(self.corners(*i), [a, b]) {
                all.push((self.shapes.len() + self.cut.len()) as u32);
                self.cut.push((shape, half));
            }
        }
        (cuts > 0).then_some(all)
    }
}

/// Returns the two corners of a shape that are farthest apart.
fn longest(corners: &[DVec3]) -> [DVec3; 2] {
    let pairs = corners.iter().enumerate().flat_map(|(i, a)| corners[..i].iter().map(move |b| [*a, *b]));
    let first = [corners[0]; 2];
    pairs.fold(first, |best, pair| if distance2(pair) > distance2(best) { pair } else { best })
}

fn distance2([a, b]: [DVec3; 2]) -> f64 {
    a.distance_squared(b)
}

/// True if a shape is slender. Each corner's distance from the line through `a` and `b` is then at most
/// [`MAX_BREADTH`] times the distance between `a` and `b`.
fn is_slender(corners: &[DVec3], [a, b]: [DVec3; 2]) -> bool {
    let along = b - a;
    corners.iter().all(|p| (*p - a).cross(along).length() <= MAX_BREADTH * along.length_squared())
}

/// Returns the corners of both halves of a flat convex shape, which is cut in the middle of a segment and perpendicular
/// to it.
fn halves(corners: &[DVec3], [start, end]: [DVec3; 2]) -> [Vec<DVec3>; 2] {
    let (middle, along) = (0.5 * (start + end), end - start);
    let height = |p: &DVec3| (*p - middle).dot(along);
    let (below, above): (Vec<DVec3>, Vec<DVec3>) = corners.iter().partition(|p| height(p) < 0.0);
    // The lines between both sides meet the cutting plane in a segment.
    let across = |a: &DVec3, b: &DVec3| *a + (*b - *a) * (height(a) / (height(a) - height(b)));
    let met: Vec<DVec3> = below.iter().flat_map(|a| above.iter().map(move |b| across(a, b))).collect();
    let ends = longest(&met);
    [below, above].map(|mut half| {
        half.extend(ends);
        half
    })
}

impl Boxes {
    /// Builds the hierarchy. Each shape is flat, and is the convex hull of its points.
    pub(crate) fn new<const N: usize>(shapes: &[[DVec3; N]]) -> Self {
        let mut boxes = Self { nodes: Vec::new(), order: Vec::with_capacity(shapes.len()), slack: 0.0 };
        if !shapes.is_empty() {
            let mut pieces = Pieces { shapes, cut: Vec::new() };
            let mut order: Vec<u32> = (0..shapes.len() as u32).collect();
            let room = shapes.len().saturating_mul(MAX_CUTS_EACH).min(MAX_CUTS);
            boxes.build(&mut pieces, &mut order, (room, CROSSING), false);
        }
        boxes.slack = boxes.nodes.first().map_or(0.0, |root| SLACK * DVec3::from(root.bounds.half).length());
        boxes
    }

    /// Builds the nodes of some pieces. `room` is the maximum number of cuts, and `crossing` has the limits from which
    /// pieces are cut. `is_at_hub` is true if the pieces share a corner.
    fn build<const N: usize>(
        &mut self,
        pieces: &mut Pieces<N>,
        order: &mut [u32],
        (room, crossing): (usize, (usize, f64)),
        is_at_hub: bool,
    ) {
        let bounds = OrientedBox::about(order.iter().flat_map(|i| pieces.corners(*i)));
        let may_have_hub = is_at_hub || order.len() >= MIN_AT_HUB;
        let hub = if may_have_hub { SharedCorner::of(pieces, order).map(Box::new) } else { None };
        let is_at_hub = hub.is_some();
        let index = self.nodes.len();
        if order.len() <= LEAF {
            let start = self.order.len();
            self.order.extend(order.iter().map(|i| pieces.shape(*i)));
            self.nodes.push(Node { bounds, shapes: start..self.order.len(), second: 0, hub });
            return;
        }
        // Split along the axis on which the shapes' centres are farthest apart. For slivers next to each other, the
        // longest axis is another one. At a hub, where boxes overlap, shapes are divided by their directions only.
        let fan = hub.as_ref().map(|hub| hub.edge.as_ref().unwrap_or(&hub.corner));
        let axes = fan.map_or(bounds.axes, |fan| fan.directions.axes);
        let place = |i: u32| {
            let corners = pieces.corners(i);
            match fan {
                Some(fan) => fan.directions_of(corners).sum(),
                // The mean of a whole shape's corners, times their number, so that no digit changes.
                None if corners.len() == N => corners.iter().sum::<DVec3>(),
                None => corners.iter().sum::<DVec3>() * (N as f64 / corners.len() as f64),
            }
        };
        let mut places: Vec<(DVec3, u32)> = order.iter().map(|i| (place(*i), *i)).collect();
        let spread = axes.map(|axis| {
            let places = places.iter().map(|(p, _)| p.dot(axis));
            let (least, most) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), p| (l.min(p), m.max(p)));
            most - least
        });
        let axis = axes[(0..3).fold(0, |best, k| if spread[k] > spread[best] { k } else { best })];
        let middle = order.len() / 2;
        places.select_nth_unstable_by(middle, |(p, i), (q, j)| p.dot(axis).total_cmp(&q.dot(axis)).then(i.cmp(j)));
        order.iter_mut().zip(places).for_each(|(place, (_, i))| *place = i);
        if hub.is_none() && order.len() >= crossing.0 && pieces.overlap(order, middle, axis) > crossing.1 {
            let length = MIN_LENGTH * 2.0 * DVec3::from(bounds.half).length();
            if let Some(mut all) = pieces.halved(order, length, room) {
                let room = room - (all.len() - order.len());
                self.build(pieces, &mut all, (room, STILL_CROSSING), false);
                return;
            }
        }
        self.nodes.push(Node { bounds, shapes: 0..0, second: 0, hub });
        let (low, high) = order.split_at_mut(middle);
        let each = (room / 2, crossing);
        self.build(pieces, low, each, is_at_hub);
        self.nodes[index].second = self.nodes.len();
        self.build(pieces, high, each, is_at_hub);
    }

    /// Returns the smallest `distance` from `p`, and the index of its shape; the first of equally near shapes wins.
    /// Without shapes, the result is infinity and `usize::MAX`. `distance` maps a shape's index to the shape's distance
    /// from `p`, which must not be less than the distance of the shape's convex hull.
    ///
    /// The search opens the nearest box of the whole hierarchy first. The distance of a shape may be far larger than
    /// the distance of its box, and boxes that contain `p` overlap.
    pub(crate) fn nearest(&self, p: DVec3, mut distance: impl FnMut(usize) -> f64) -> (f64, usize) {
        let mut best = (f64::INFINITY, usize::MAX);
        let mut open = BinaryHeap::with_capacity(64);
        // The bits of non-negative floats have the same order as the floats.
        let entry = |node: usize| Reverse((self.nodes[node].distance(p).to_bits(), node));
        open.extend(self.nodes.first().map(|_| entry(0)));
        while let Some(Reverse((bound, index))) = open.pop() {
            if f64::from_bits(bound) - self.slack > best.0 {
                break;
            }
            let node = &self.nodes[index];
            let hub = node.hub.as_deref().filter(|hub| hub.is_nearest(p));
            let asked = match hub {
                Some(hub) => std::slice::from_ref(&hub.first),
                None if node.second == 0 => &self.order[node.shapes.clone()],
                None => {
                    open.extend([index + 1, node.second].map(entry));
                    continue;
                }
            };
            for i in asked {
                let found = (distance(*i as usize), *i as usize);
                if found < best {
                    best = found;
                }
            }
        }
        best
    }
}

impl OrientedBox {
    fn about<'a>(points: impl Iterator<Item = &'a DVec3> + Clone) -> Self {
        let count = points.clone().count().max(1) as f64;
        let mean = points.clone().sum::<DVec3>() / count;
        let mut moments = [0.0; 6];
        for d in points.clone().map(|p| *p - mean) {
            let products = [d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z];
            moments.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
        }
        let (_, axes) = symmetric3(moments);
        let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
        for d in points.map(|p| *p - mean) {
            for (end, axis) in ends.iter_mut().zip(axes) {
                let along = d.dot(axis);
                *end = [end[0].min(along), end[1].max(along)];
            }
        }
        let center = mean + (0..3).map(|k| axes[k] * (0.5 * (ends[k][0] + ends[k][1]))).sum::<DVec3>();
        Self { center, axes, half: ends.map(|[from, to]| 0.5 * (to - from)) }
    }

    /// Returns the distance of a point to the box; 0 inside.
    fn distance(&self, p: DVec3) -> f64 {
        let d = p - self.center;
        let beyond = |k: usize| (d.dot(self.axes[k]).abs() - self.half[k]).max(0.0);
        DVec3::new(beyond(0), beyond(1), beyond(2)).length()
    }

    /// Returns the largest dot product of a vector with a point of the box.
    fn support(&self, d: DVec3) -> f64 {
        self.center.dot(d) + (0..3).map(|k| (self.axes[k].dot(d) * self.half[k]).abs()).sum::<f64>()
    }
}

impl Node {
    /// Returns a lower bound of the distance between a point and the node's shapes.
    fn distance(&self, p: DVec3) -> f64 {
        let to_box = self.bounds.distance(p);
        self.hub.as_ref().map_or(to_box, |hub| to_box.max(hub.distance(p)))
    }
}

impl SharedCorner {
    /// Finds the hub of some pieces, a corner that all of them share; `None` if they share none.
    fn of<const N: usize>(pieces: &Pieces<N>, order: &[u32]) -> Option<Self> {
        let first = pieces.corners(*order.first()?);
        let mut shared: Vec<DVec3> = first.to_vec();
        // True while the shared corners have the same indices in all shapes.
        let mut are_aligned = true;
        for i in order {
            let corners = pieces.corners(*i);
            shared.retain(|p| corners.contains(p));
            are_aligned &= corners.iter().zip(first).all(|(p, q)| p == q || !shared.contains(q));
            if shared.is_empty() {
                return None;
            }
        }
        let all = || order.iter().map(|i| pieces.corners(*i));
        let is_large = order.len() >= MIN_AT_HUB;
        let corner = Fan::about([shared[0]; 2], all(), is_large);
        let edge = match shared[..] {
            [start, end] if start != end => Some(Fan::about([start, end], all(), is_large && are_aligned)),
            _ => None,
        };
        Some(Self { corner, edge, first: order.iter().map(|i| pieces.shape(*i)).min()? })
    }

    /// True if the nearest point of every shape is surely on the shared corner or edge, at the same distance.
    fn is_nearest(&self, p: DVec3) -> bool {
        self.corner.is_nearest(p) || self.edge.as_ref().is_some_and(|edge| edge.is_nearest(p))
    }

    /// Returns a lower bound of the distance between a point and the shapes that share the corner.
    fn distance(&self, p: DVec3) -> f64 {
        let from_corner = self.corner.distance(p);
        self.edge.as_ref().map_or(from_corner, |edge| from_corner.max(edge.distance(p)))
    }
}

impl Fan {
    fn about<'a>(ends: [DVec3; 2], shapes: impl Iterator<Item = &'a [DVec3]>, are_equally_near: bool) -> Self {
        let along = (ends[1] - ends[0]).normalize_or_zero();
        let directions = OrientedBox { center: DVec3::ZERO, axes: [DVec3::ZERO; 3], half: [0.0; 3] };
        let mut fan = Self { ends, along, directions, least_mean: 1.0, are_equally_near };
        let mut units = Vec::new();
        for shape in shapes {
            let first = units.len();
            units.extend(fan.directions_of(shape));
            let of_shape = &units[first..];
            let middle = of_shape.iter().sum::<DVec3>().normalize_or_zero();
            fan.least_mean = of_shape.iter().fold(fan.least_mean, |least, unit| least.min(unit.dot(middle)));
        }
        fan.directions = OrientedBox::about(units.iter());
        fan
    }

    /// Returns the unit vectors from the shared point to the other corners of a shape, or perpendicular from the shared
    /// edge to them.
    fn directions_of<'a>(&'a self, shape: &'a [DVec3]) -> impl Iterator<Item = DVec3> + 'a {
        let others = shape.iter().filter(|p| !self.ends.contains(p));
        others.map(|p| self.across(*p).normalize_or_zero())
    }

    /// Returns the vector from the shared edge (or point) to a point, perpendicular to the edge.
    fn across(&self, p: DVec3) -> DVec3 {
        let d = p - self.ends[0];
        d - self.along * d.dot(self.along)
    }

    /// Returns the distance of a point from the shared edge's line (or the shared point). The second value is an upper
    /// bound of the dot product of the point's direction with the directions of the shapes.
    fn distance_and_support(&self, p: DVec3) -> (f64, f64) {
        let d = self.across(p);
        (d.length(), self.directions.support(d.normalize_or_zero()))
    }

    /// True if the nearest point of every shape is surely the shared point, or the same point of the shared edge.
    fn is_nearest(&self, p: DVec3) -> bool {
        let [start, end] = self.ends;
        // Beyond the ends of an edge, other points of the shapes may be nearer.
        let is_beside = || start == end || (p - start).dot(self.along) >= 0.0 && (p - end).dot(self.along) <= 0.0;
        // A slightly positive dot product is accepted, to allow for rounding: it changes the distance only in second
        // order.
        self.are_equally_near && is_beside() && self.distance_and_support(p).1 <= SLACK
    }

    /// Returns a lower bound of the distance between a point and the shapes around the shared point or edge.
    fn distance(&self, p: DVec3) -> f64 {
        let (distance, support) = self.distance_and_support(p);
        // The direction to a point inside a shape is a weighted mean of its corners' directions, which may be as short
        // as `least_mean`.
        let support = support.max(0.0);
        if support >= self.least_mean {
            return 0.0;
        }
        let cosine = support / self.least_mean;
        distance * (1.0 - SINE2_SLACK - cosine * cosine).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distances::closest;
    use crate::mesh::random::Random;

    #[test]
    fn nearest_shape_is_that_of_brute_force() {
        let mut random = Random::new(5);
        // Coarse coordinates make many shapes equally near; segments have all lengths, and some are points.
        for (count, levels) in [(1, 8.0), (5, 3.0), (300, 8.0), (2000, 1e9)] {
            let mut place = || {
                let mut coordinate = || (random.unit() * levels).floor() / levels;
                DVec3::new(coordinate(), coordinate(), coordinate())
            };
            let shapes: Vec<[DVec3; 2]> = (0..count)
                .map(|i| (place(), place(), 0.5f64.powi(i % 9)))
                .map(|(a, b, s)| [a, a + (b - a) * s])
                .collect();
            let boxes = Boxes::new(&shapes);
            for _ in 0..50 {
                let p = place() * 1.5;
                let distance = |i: usize| {
                    let [a, b] = shapes[i];
                    let along = (p - a).dot(b - a) / (b - a).length_squared().max(f64::MIN_POSITIVE);
                    p.distance(a + (b - a) * along.clamp(0.0, 1.0))
                };
                let all = (0..shapes.len()).map(|i| (distance(i), i));
                let expected = all.reduce(|a, b| if b < a { b } else { a }).unwrap();
                assert_eq!(boxes.nearest(p, distance), expected);
            }
        }
        assert_eq!(Boxes::new::<3>(&[]).nearest(DVec3::ZERO, |_| 0.0), (f64::INFINITY, usize::MAX));
    }

    #[test]
    fn nearest_shape_at_a_hub_is_that_of_brute_force() {
        let mut random = Random::new(6);
        let mut place = move || DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
        let spine = [DVec3::new(0.1, 0.2, -0.9), DVec3::new(0.0, 0.1, 0.9)];
        // Slivers and wide triangles about a corner, and pages about an edge, of one winding and of both.
        let kinds: [&dyn Fn(usize, DVec3, DVec3) -> [DVec3; 3]; 4] = [
            &|_, a, b| [spine[0], a, a + b * 0.01],
            &|_, a, b| [a, spine[0], b],
            &|_, a, _| [spine[0], spine[1], a],
            &|i, a, _| if i % 2 == 0 { [spine[0], spine[1], a] } else { [spine[1], spine[0], a] },
        ];
        for (kind, make) in kinds.iter().enumerate() {
            let mut shapes: Vec<[DVec3; 3]> = (0..500).map(|i| make(i, place(), place())).collect();
            // Some triangles that don't share the corner or edge, which are nearer at some query points.
            shapes.extend((0..20).map(|_| [place(), place(), place()]));
            let boxes = Boxes::new(&shapes);
            for k in 0..400 {
                let along = spine[0] + (spine[1] - spine[0]) * (place().x * 0.7 + 0.5);
                let p = match k % 4 {
                    0 => place() * 1.5,
                    1 => spine[0] + place() * 1e-3,
                    2 => along + place() * 1e-3,
                    _ => shapes[k].iter().sum::<DVec3>() / 3.0,
                };
                let all = (0..shapes.len()).map(|i| (closest(p, shapes[i]).0, i));
                let expected = all.reduce(|a, b| if b < a { b } else { a }).unwrap();
                let found = boxes.nearest(p, |i| closest(p, shapes[i]).0);
                // Shapes whose nearest point is the corner are equally near but for rounding.
                assert!((found.0 - expected.0).abs() < 1e-14, "{kind} {k}: {found:?} {expected:?}");
            }
        }
    }

    /// Counts the calls of `distance` for points near the middle of pages about an edge, or of slivers about a corner
    /// in all directions: three points in each, ever nearer to the middle.
    fn work_of_hub(count: u32, is_book: bool) -> usize {
        let mut random = Random::new(8);
        let spine = [DVec3::ZERO, DVec3::Z];
        let shapes: Vec<[DVec3; 3]> = (0..count)
            .map(|i| {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(count)).sin_cos();
                let far = DVec3::new(random.unit() - 0.5, random.unit() - 0.5, random.unit() - 0.5);
                let page = [spine[0], spine[1], DVec3::new(cos, sin, 0.5)];
                if is_book { page } else { [spine[0], far, far + DVec3::X * 0.001] }
            })
            .collect();
        let boxes = Boxes::new(&shapes);
        let mut asked = 0;
        for (own, [a, b, c]) in shapes.iter().enumerate() {
            for near in [0.1, 0.01, 0.001] {
                let p = if is_book { (a + b) * 0.5 * (1.0 - near) + c * near } else { a + (b + c) * 0.5 * near };
                let (found, _) = boxes.nearest(p, |i| {
                    asked += 1;
                    closest(p, shapes[i]).0
                });
                assert!(found < 1e-9, "{own} {near}: {found}");
            }
        }
        asked
    }

    #[test]
    fn work_near_a_hub_is_nearly_linear() {
        for is_book in [true, false] {
            let work = [1000, 2000, 4000].map(|count| work_of_hub(count, is_book));
            assert!(
                work[1] as f64 <= 2.3 * work[0] as f64 && work[2] as f64 <= 2.3 * work[1] as f64,
                "{is_book}: {work:?}"
            );
            assert!(work[2] < 3 * 60 * 4000, "{is_book}: {work:?}");
        }
    }

    /// Counts the calls of `distance` for needles that cross each other in a cube, with one query about each.
    fn work_of_needles(count: u32) -> usize {
        let mut random = Random::new(12);
        let mut place = move || DVec3::new(random.unit(), random.unit(), random.unit());
        let shapes: Vec<[DVec3; 3]> = (0..count).map(|_| (place(), place())).map(|(a, b)| [a, b, b + 1e-4]).collect();
        let boxes = Boxes::new(&shapes);
        let mut asked = 0;
        for (own, [a, b, _]) in shapes.iter().enumerate() {
            // The query's distance from the needle is the mean distance between needles.
            let p = 0.5 * (a + b) + (place() - 0.5) / f64::from(count).sqrt();
            let found = boxes.nearest(p, |i| {
                asked += 1;
                closest(p, shapes[i]).0
            });
            if own % (count as usize / 20) == 0 {
                let all = (0..shapes.len()).map(|i| (closest(p, shapes[i]).0, i));
                assert_eq!(Some(found), all.reduce(|a, b| if b < a { b } else { a }), "{own} of {count}");
            }
        }
        asked
    }

    #[test]
    fn work_among_crossing_needles_is_nearly_linear() {
        let work = [1000, 2000, 4000, 8000].map(work_of_needles);
        assert!(work.windows(2).all(|w| w[1] as f64 <= 2.5 * w[0] as f64), "{work:?}");
        assert!(work[3] < 20 * 8000, "{work:?}");
    }

    #[test]
    fn only_long_shapes_whose_boxes_overlap_are_cut() {
        let mut random = Random::new(13);
        let mut place = move || DVec3::new(random.unit(), random.unit(), random.unit());
        let surface = |p: DVec3| DVec3::new(p.x, p.y, 0.1 * (5.0 * p.x).sin());
        let small: Vec<[DVec3; 3]> =
            (0..2000).map(|_| surface(place())).map(|p| [p, p + 0.02 * DVec3::X, p + 0.02 * DVec3::Y]).collect();
        assert_eq!(Boxes::new(&small).order.len(), 2000);
        let slivers: Vec<[DVec3; 3]> = (0..2000).map(|_| DVec3::X * place().x).map(|p| [p, p, p + DVec3::Y]).collect();
        assert_eq!(Boxes::new(&slivers).order.len(), 2000);
        // Equilateral triangles in all directions.
        let wide = |a: DVec3, d: DVec3, e: DVec3| [a, a + d, a + 0.5 * d + 0.8 * d.length() * d.cross(e).normalize()];
        let wide: Vec<[DVec3; 3]> = (0..2000).map(|_| wide(place(), place() - 0.5, place() - 0.5)).collect();
        assert_eq!(Boxes::new(&wide).order.len(), 2000);
        let long: Vec<[DVec3; 2]> = (0..2000).map(|_| [place(), place()]).collect();
        let cut = Boxes::new(&long).order.len();
        assert!(cut > 3 * 2000 && cut <= (1 + MAX_CUTS_EACH) * 2000, "{cut}");
    }

    #[test]
    fn halves_of_a_shape_are_all_of_it() {
        let mut random = Random::new(14);
        let mut number = || random.unit() * 2.0 - 1.0;
        for _ in 0..200 {
            let corners: Vec<DVec3> = (0..5).map(|_| DVec3::new(number(), number(), 0.0)).collect();
            let ends = longest(&corners);
            let parts = halves(&corners, ends);
            let (middle, along) = (0.5 * (ends[0] + ends[1]), ends[1] - ends[0]);
            // The support of both halves together, in any direction, is that of the shape.
            for _ in 0..20 {
                let d = DVec3::new(number(), number(), 0.0);
                let support = |corners: &[DVec3]| corners.iter().map(|p| p.dot(d)).fold(f64::NEG_INFINITY, f64::max);
                let of_parts = parts.iter().map(|part| support(part)).fold(f64::NEG_INFINITY, f64::max);
                assert!((support(&corners) - of_parts).abs() < 1e-12);
            }
            // Each half is on its side of the cut, and both meet in the same two points.
            for (part, sign) in parts.iter().zip([-1.0, 1.0]) {
                assert!(part.iter().all(|p| (*p - middle).dot(along) * sign >= -1e-12), "{parts:?}");
            }
            assert_eq!(parts[0][parts[0].len() - 2..], parts[1][parts[1].len() - 2..]);
        }
    }

    /// Counts the calls of `distance` for a fan of slivers, with one query near each sliver.
    fn work_of_fan(count: u32) -> usize {
        let rim = |i: u32| {
            let (sin, cos) = (6.2 * f64::from(i) / f64::from(count)).sin_cos();
            DVec3::new(cos, sin, 0.0)
        };
        let shapes: Vec<[DVec3; 3]> = (0..count).map(|i| [DVec3::ZERO, rim(i), rim(i + 1)]).collect();
        let boxes = Boxes::new(&shapes);
        let mut asked = 0;
        for (own, [a, b, c]) in shapes.iter().enumerate() {
            // The query's distance to the plane is a sliver's width.
            let p = (a + b + c) / 3.0 + DVec3::Z / f64::from(count);
            let (_, found) = boxes.nearest(p, |i| {
                asked += 1;
                closest(p, shapes[i]).0
            });
            assert_eq!(found, own);
        }
        asked
    }

    #[test]
    fn work_of_a_fan_is_nearly_linear() {
        let work = [1000, 2000, 4000].map(work_of_fan);
        assert!(work[1] as f64 <= 2.3 * work[0] as f64 && work[2] as f64 <= 2.3 * work[1] as f64, "{work:?}");
        assert!(work[2] < 60 * 4000, "{work:?}");
    }

    /// Counts the calls of `distance` for points beyond the apex of a cone of `count` slivers over a unit circle, with
    /// a bottom or without. There is one query for each sliver: on the sliver's continuation, a tenth of its length
    /// beyond the apex.
    fn work_of_cone(count: u32, height: f64, has_bottom: bool) -> usize {
        let rim = |i: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(count)).sin_cos();
            DVec3::new(cos, sin, 0.0)
        };
        let apex = DVec3::Z * height;
        let mut shapes: Vec<[DVec3; 3]> = (0..count).map(|i| [apex, rim(i), rim((i + 1) % count)]).collect();
        if has_bottom {
            shapes.extend((0..count).map(|i| [DVec3::ZERO, rim((i + 1) % count), rim(i)]));
        }
        let boxes = Boxes::new(&shapes);
        let mut asked = 0;
        for i in 0..count {
            let p = apex + 0.1 * (apex - rim(i));
            let (found, _) = boxes.nearest(p, |i| {
                asked += 1;
                closest(p, shapes[i]).0
            });
            let all = shapes.iter().step_by(1 + count as usize / 50).map(|shape| closest(p, *shape).0);
            assert!(found <= all.fold(f64::INFINITY, f64::min) + 1e-12, "{i} of {count}");
        }
        asked
    }

    #[test]
    fn work_beyond_the_apex_of_a_cone_is_linear() {
        // Needles, cones of 45°, for which the nearest slivers are on the opposite side, and flat cones.
        for height in [20.0, 2.0, 1.0, 0.5, 0.05] {
            for has_bottom in [false, true] {
                for count in [1000, 4000] {
                    let work = work_of_cone(count, height, has_bottom);
                    let each = work / count as usize;
                    assert!(each < 200, "{count} of height {height}, bottom {has_bottom}: {each} each");
                }
            }
        }
    }
}
