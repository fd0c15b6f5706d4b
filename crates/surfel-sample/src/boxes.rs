//! A hierarchy of oriented boxes around shapes, searched for the nearest shape. Axis-aligned boxes of slivers that meet
//! in a point, as in a fan, all overlap; oriented boxes don't.

use crate::eigen::symmetric3;
use glam::DVec3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

/// Maximum number of shapes in a leaf.
const LEAF: usize = 4;
/// Tolerance for rounding, relative to the size of all shapes.
const SLACK: f64 = 1e-9;
/// Minimum number of shapes of a node that may have a hub while its parent has none. In ordinary meshes fewer triangles
/// share a corner.
const LEAST_AT_HUB: usize = 16;
/// Tolerance for rounding of a squared sine.
const SINE2_SLACK: f64 = 1e-14;

/// An oriented box around some points.
struct OrientedBox {
    center: DVec3,
    /// Unit vectors at right angles.
    axes: [DVec3; 3],
    /// Half the box's size along each axis.
    half: [f64; 3],
}

/// A box around some of the shapes.
struct Node {
    bounds: OrientedBox,
    /// Range of the node's shapes in [`Boxes::order`].
    shapes: Range<usize>,
    /// Index of the second child; the first child follows its node. 0 for a leaf.
    second: usize,
    /// The corner that all shapes share, if there are many and they do.
    hub: Option<Box<Hub>>,
}

/// A corner that all shapes of a node share, as the slivers of a cone do. The boxes of slivers say little about points
/// beyond the corner, to which all of them are equally near, and about points near it, where all boxes overlap.
struct Hub {
    corner: Fan,
    /// The edge that all shapes share, as the pages of a book do; seen along itself, it is a corner.
    edge: Option<Fan>,
    /// The first of the shapes.
    first: u32,
}

/// Directions of shapes about a point that they share.
struct Fan {
    /// The point, or the ends of an edge, which is projected to a point.
    ends: [DVec3; 2],
    /// Unit vector along the edge; zero for a point.
    along: DVec3,
    /// A box about the unit vectors from the point to all other corners, at right angles to the edge.
    directions: OrientedBox,
    /// A lower bound of the length of a mean, with any weights, of the unit vectors of one shape: 1 for slivers, less
    /// for shapes that are wide at the centre.
    least_mean: f64,
    /// True if all shapes have exactly the same distance from points to which the centre is nearest.
    are_equally_near: bool,
}

/// A hierarchy of boxes.
pub(crate) struct Boxes {
    /// Nodes in preorder: a node, its first subtree, its second subtree.
    nodes: Vec<Node>,
    order: Vec<u32>,
    slack: f64,
}

impl Boxes {
    /// Builds boxes around shapes; each shape is within the hull of its points.
    pub(crate) fn new<const N: usize>(shapes: &[[DVec3; N]]) -> Self {
        let mut boxes = Self { nodes: Vec::new(), order: (0..shapes.len() as u32).collect(), slack: 0.0 };
        if !shapes.is_empty() {
            boxes.build(shapes, 0..shapes.len(), false);
        }
        boxes.slack = boxes.nodes.first().map_or(0.0, |root| SLACK * DVec3::from(root.bounds.half).length());
        boxes
    }

    /// Builds the boxes of some shapes; `is_at_hub` is true if they share a corner.
    fn build<const N: usize>(&mut self, shapes: &[[DVec3; N]], range: Range<usize>, is_at_hub: bool) {
        let order = &self.order[range.clone()];
        let bounds = OrientedBox::about(order.iter().flat_map(|i| shapes[*i as usize]));
        let may_have_hub = is_at_hub || order.len() >= LEAST_AT_HUB;
        let hub = if may_have_hub { Hub::of(shapes, order).map(Box::new) } else { None };
        let is_at_hub = hub.is_some();
        let index = self.nodes.len();
        if range.len() <= LEAF {
            self.nodes.push(Node { bounds, shapes: range, second: 0, hub });
            return;
        }
        // Split along the axis on which the shapes' centres are farthest apart. For slivers side by side this isn't the
        // longest. About a hub, where boxes overlap, shapes are divided by their directions, whatever their lengths.
        let fan = hub.as_ref().map(|hub| hub.edge.as_ref().unwrap_or(&hub.corner));
        let axes = fan.map_or(bounds.axes, |fan| fan.directions.axes);
        let place = |i: u32| {
            let shape = &shapes[i as usize];
            fan.map_or_else(|| shape.iter().sum::<DVec3>(), |fan| fan.directions_of(shape).sum())
        };
        let mut places: Vec<(DVec3, u32)> = order.iter().map(|i| (place(*i), *i)).collect();
        let spread = axes.map(|axis| {
            let places = places.iter().map(|(p, _)| p.dot(axis));
            let (least, most) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), p| (l.min(p), m.max(p)));
            most - least
        });
        let axis = axes[(0..3).fold(0, |best, k| if spread[k] > spread[best] { k } else { best })];
        let middle = range.len() / 2;
        places.select_nth_unstable_by(middle, |(p, i), (q, j)| p.dot(axis).total_cmp(&q.dot(axis)).then(i.cmp(j)));
        self.order[range.clone()].iter_mut().zip(places).for_each(|(place, (_, i))| *place = i);
        self.nodes.push(Node { bounds, shapes: range.clone(), second: 0, hub });
        self.build(shapes, range.start..range.start + middle, is_at_hub);
        self.nodes[index].second = self.nodes.len();
        self.build(shapes, range.start + middle..range.end, is_at_hub);
    }

    /// Returns the smallest `distance` about `p`, and the index of its shape; the first of equally near shapes wins.
    /// The result is infinite, with the index `usize::MAX`, if there are no shapes. `distance` maps a shape's index to
    /// its distance from `p`, which must not be less than that of the shape's hull.
    ///
    /// The nearest boxes are opened first, in the whole hierarchy. The distance of a shape may be far larger than that
    /// of its box, and boxes that contain `p` overlap.
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
    fn about(points: impl Iterator<Item = DVec3> + Clone) -> Self {
        let count = points.clone().count().max(1) as f64;
        let mean = points.clone().sum::<DVec3>() / count;
        let mut moments = [0.0; 6];
        for d in points.clone().map(|p| p - mean) {
            let products = [d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z];
            moments.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
        }
        let (_, axes) = symmetric3(moments);
        let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
        for d in points.map(|p| p - mean) {
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

    /// The largest product of a vector with a point of the box.
    fn support(&self, d: DVec3) -> f64 {
        self.center.dot(d) + (0..3).map(|k| (self.axes[k].dot(d) * self.half[k]).abs()).sum::<f64>()
    }
}

impl Node {
    /// A lower bound of the distance between a point and the shapes.
    fn distance(&self, p: DVec3) -> f64 {
        let to_box = self.bounds.distance(p);
        self.hub.as_ref().map_or(to_box, |hub| to_box.max(hub.distance(p)))
    }
}

impl Hub {
    /// The hub of some of the shapes, if all share a corner.
    fn of<const N: usize>(shapes: &[[DVec3; N]], order: &[u32]) -> Option<Self> {
        let first = shapes[*order.first()? as usize];
        let mut shared: Vec<DVec3> = first.to_vec();
        // True while the corners that shapes share have the same numbers in all of them.
        let mut are_aligned = true;
        for i in order {
            let shape = shapes[*i as usize];
            shared.retain(|p| shape.contains(p));
            are_aligned &= shape.iter().zip(&first).all(|(p, q)| p == q || !shared.contains(q));
            if shared.is_empty() {
                return None;
            }
        }
        let all = || order.iter().map(|i| &shapes[*i as usize]);
        let is_large = order.len() >= LEAST_AT_HUB;
        let corner = Fan::about([shared[0]; 2], all(), is_large);
        let edge = match shared[..] {
            [start, end] if start != end => Some(Fan::about([start, end], all(), is_large && are_aligned)),
            _ => None,
        };
        Some(Self { corner, edge, first: *order.iter().min()? })
    }

    /// True if the corner, or the edge, has the nearest point of every shape.
    fn is_nearest(&self, p: DVec3) -> bool {
        self.corner.is_nearest(p) || self.edge.as_ref().is_some_and(|edge| edge.is_nearest(p))
    }

    /// A lower bound of the distance between a point and the shapes.
    fn distance(&self, p: DVec3) -> f64 {
        let from_corner = self.corner.distance(p);
        self.edge.as_ref().map_or(from_corner, |edge| from_corner.max(edge.distance(p)))
    }
}

impl Fan {
    fn about<'a, const N: usize>(
        ends: [DVec3; 2],
        shapes: impl Iterator<Item = &'a [DVec3; N]>,
        are_equally_near: bool,
    ) -> Self {
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
        fan.directions = OrientedBox::about(units.into_iter());
        fan
    }

    /// Returns the unit vectors from the point to the other corners of a shape.
    fn directions_of<'a>(&'a self, shape: &'a [DVec3]) -> impl Iterator<Item = DVec3> + 'a {
        let others = shape.iter().filter(|p| !self.ends.contains(p));
        others.map(|p| self.across(*p).normalize_or_zero())
    }

    /// Returns the vector from the edge to a point, at right angles to the edge.
    fn across(&self, p: DVec3) -> DVec3 {
        let d = p - self.ends[0];
        d - self.along * d.dot(self.along)
    }

    /// The distance of a point from the edge's line, and the largest product of its direction with those of the
    /// corners.
    fn distance_and_support(&self, p: DVec3) -> (f64, f64) {
        let d = self.across(p);
        (d.length(), self.directions.support(d.normalize_or_zero()))
    }

    /// True if the point, or the same point of the edge, is the nearest one of every shape.
    fn is_nearest(&self, p: DVec3) -> bool {
        let [start, end] = self.ends;
        // Beyond the ends of an edge, other points of the shapes may be nearer.
        let is_beside = || start == end || (p - start).dot(self.along) >= 0.0 && (p - end).dot(self.along) <= 0.0;
        // To within rounding, where the distance has its largest value and hardly changes.
        self.are_equally_near && is_beside() && self.distance_and_support(p).1 <= SLACK
    }

    /// A lower bound of the distance between a point and the shapes.
    fn distance(&self, p: DVec3) -> f64 {
        let (distance, support) = self.distance_and_support(p);
        // Directions within a shape are means of its corners' directions, which are shorter than 1.
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
            // Some others, which are nearer here and there.
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

    /// Slivers of a cone of this height over a unit circle, with its bottom or without, and distances that points
    /// beyond its apex ask for: for each sliver one where the sliver would go on, at a tenth of its length.
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
        // Needles, cones of 45°, where the nearest slivers are across, and flat ones.
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
