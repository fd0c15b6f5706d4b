//! K-d tree over fixed points: exact nearest neighbours and range queries, with deterministic results. A point's place
//! in the order of the tree is its *slot*.

use glam::DVec3;

/// Maximum number of points in a leaf of the tree. On 1 M points, limits from 8 to 16 are within 5 % of each other.
const LEAF: usize = 12;
/// Number of points below which one thread builds a whole subtree.
const PARALLEL: usize = 8192;

#[derive(Clone, Copy, Debug, Default)]
struct Node {
    split: f64,
    axis: u8,
}

/// Point in tree order, with its index in the input.
#[derive(Clone, Copy, Debug)]
struct Item {
    point: DVec3,
    index: u32,
}

/// Balanced k-d tree of points. Its items are addressed by *slot*, their place in tree order, in which neighbours are
/// close together in memory. [`KdTree::index`] maps a slot to the input.
#[derive(Debug)]
pub(crate) struct KdTree {
    items: Vec<Item>,
    /// Nodes in preorder: a node, its left subtree, its right subtree. Every leaf has the same depth.
    nodes: Vec<Node>,
}

impl KdTree {
    /// Builds the tree. Coordinates must be finite, and there must be at most `u32::MAX` points.
    pub(crate) fn new(points: &[DVec3]) -> Self {
        let mut items: Vec<Item> = points.iter().zip(0..).map(|(point, index)| Item { point: *point, index }).collect();
        let leaves = points.len().div_ceil(LEAF).max(1).next_power_of_two();
        let mut nodes = vec![Node::default(); leaves - 1];
        build(&mut items, &mut nodes);
        Self { items, nodes }
    }

    pub(crate) fn len(&self) -> usize {
        self.items.len()
    }

    pub(crate) fn point(&self, slot: usize) -> DVec3 {
        self.items[slot].point
    }

    /// Returns the index in the input of the item at `slot`.
    pub(crate) fn index(&self, slot: usize) -> usize {
        self.items[slot].index as usize
    }

    /// Fills `found` with the `found.limit` items nearest to `query`, or with fewer if fewer are within its distance,
    /// nearest first; equal distances are ordered by slot.
    pub(crate) fn nearest(&self, query: DVec3, found: &mut Nearest) {
        found.items.clear();
        self.search(0, self.nodes.len(), 0, self.items.len(), query, DVec3::ZERO, found);
    }

    #[allow(clippy::too_many_arguments, reason = "the recursion's whole state, kept in registers")]
    fn search(&self, node: usize, size: usize, lo: usize, hi: usize, query: DVec3, offset: DVec3, found: &mut Nearest) {
        if size == 0 {
            for (slot, item) in self.items[lo..hi].iter().enumerate() {
                found.offer(item.point.distance_squared(query), (lo + slot) as u32);
            }
            return;
        }
        let Node { split, axis } = self.nodes[node];
        let (mid, half) = (lo + (hi - lo) / 2, (size - 1) / 2);
        let distance = query[axis as usize] - split;
        let left = (node + 1, lo, mid);
        let right = (node + 1 + half, mid, hi);
        let (near, far) = if distance < 0.0 { (left, right) } else { (right, left) };
        self.search(near.0, half, near.1, near.2, query, offset, found);
        let mut offset = offset;
        offset[axis as usize] = distance;
        if offset.length_squared() <= found.farthest() {
            self.search(far.0, half, far.1, far.2, query, offset, found);
        }
    }

    /// Returns, for each node, the largest `reach` of the items below it. `reach` has one value per item, in input
    /// order.
    pub(crate) fn largest_below(&self, reach: &[f64]) -> Vec<f64> {
        let mut largest = vec![0.0; self.nodes.len()];
        self.fill_largest(0, self.nodes.len(), 0, self.items.len(), reach, &mut largest);
        largest
    }

    fn fill_largest(&self, node: usize, size: usize, lo: usize, hi: usize, reach: &[f64], out: &mut [f64]) -> f64 {
        if size == 0 {
            return self.items[lo..hi].iter().map(|i| reach[i.index as usize]).fold(0.0, f64::max);
        }
        let (mid, half) = (lo + (hi - lo) / 2, (size - 1) / 2);
        let left = self.fill_largest(node + 1, half, lo, mid, reach, out);
        let right = self.fill_largest(node + 1 + half, half, mid, hi, reach, out);
        out[node] = left.max(right);
        out[node]
    }

    /// Visits, leaf by leaf, the slots of all items whose distance from `query` is at most `radius` plus the item's own
    /// reach. Some other slots are visited too. `largest` comes from [`KdTree::largest_below`], or is empty for items
    /// without reach.
    pub(crate) fn near(&self, query: DVec3, radius: f64, largest: &[f64], visit: &mut impl FnMut(usize)) {
        self.walk(0, self.nodes.len(), 0, self.items.len(), query, DVec3::ZERO, radius, largest, visit);
    }

    #[allow(clippy::too_many_arguments, reason = "the recursion's whole state, kept in registers")]
    fn walk(
        &self,
        node: usize,
        size: usize,
        lo: usize,
        hi: usize,
        query: DVec3,
        offset: DVec3,
        radius: f64,
        largest: &[f64],
        visit: &mut impl FnMut(usize),
    ) {
        if size == 0 {
            (lo..hi).for_each(visit);
            return;
        }
        let reach = radius + largest.get(node).copied().unwrap_or(0.0);
        if offset.length_squared() > reach * reach {
            return;
        }
        let Node { split, axis } = self.nodes[node];
        let (mid, half) = (lo + (hi - lo) / 2, (size - 1) / 2);
        let distance = query[axis as usize] - split;
        let mut beyond = offset;
        beyond[axis as usize] = distance;
        let far_is_near = beyond.length_squared() <= reach * reach;
        if distance < 0.0 || far_is_near {
            let offset = if distance < 0.0 { offset } else { beyond };
            self.walk(node + 1, half, lo, mid, query, offset, radius, largest, visit);
        }
        if distance >= 0.0 || far_is_near {
            let offset = if distance >= 0.0 { offset } else { beyond };
            self.walk(node + 1 + half, half, mid, hi, query, offset, radius, largest, visit);
        }
    }

    /// Returns, for each node, the lower and upper corner of the bounding box of the items below it.
    pub(crate) fn bounds_below(&self) -> Vec<(DVec3, DVec3)> {
        let mut bounds = vec![(DVec3::INFINITY, DVec3::NEG_INFINITY); self.nodes.len()];
        self.fill_bounds(0, self.nodes.len(), 0, self.items.len(), &mut bounds);
        bounds
    }

    fn fill_bounds(
        &self,
        node: usize,
        size: usize,
        lo: usize,
        hi: usize,
        out: &mut [(DVec3, DVec3)],
    ) -> (DVec3, DVec3) {
        if size == 0 {
            let ends = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            return self.items[lo..hi].iter().fold(ends, |(low, high), i| (low.min(i.point), high.max(i.point)));
        }
        let (mid, half) = (lo + (hi - lo) / 2, (size - 1) / 2);
        let left = self.fill_bounds(node + 1, half, lo, mid, out);
        let right = self.fill_bounds(node + 1 + half, half, mid, hi, out);
        out[node] = (left.0.min(right.0), left.1.max(right.1));
        out[node]
    }

    /// Visits the tree from its root, and enters the nodes for which `enters` returns true. Calls `visit` with all
    /// slots of every leaf that is reached.
    pub(crate) fn visit_below(&self, enters: &impl Fn(usize) -> bool, visit: &mut impl FnMut(usize)) {
        self.walk_below((0, self.nodes.len()), (0, self.items.len()), enters, visit);
    }

    fn walk_below(
        &self,
        (node, size): (usize, usize),
        (lo, hi): (usize, usize),
        enters: &impl Fn(usize) -> bool,
        visit: &mut impl FnMut(usize),
    ) {
        if size == 0 {
            (lo..hi).for_each(visit);
        } else if enters(node) {
            let (mid, half) = (lo + (hi - lo) / 2, (size - 1) / 2);
            self.walk_below((node + 1, half), (lo, mid), enters, visit);
            self.walk_below((node + 1 + half, half), (mid, hi), enters, visit);
        }
    }
}

fn build(items: &mut [Item], nodes: &mut [Node]) {
    let Some((node, below)) = nodes.split_first_mut() else { return };
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for i in items.iter() {
        (lo, hi) = (lo.min(i.point), hi.max(i.point));
    }
    let axis = (hi - lo).max_position();
    let mid = items.len() / 2;
    let order = |a: &Item, b: &Item| a.point[axis].total_cmp(&b.point[axis]).then(a.index.cmp(&b.index));
    let (_, median, _) = items.select_nth_unstable_by(mid, order);
    *node = Node { split: median.point[axis], axis: axis as u8 };
    let half = below.len() / 2;
    let ((left, right), (left_nodes, right_nodes)) = (items.split_at_mut(mid), below.split_at_mut(half));
    if left.len() < PARALLEL {
        build(left, left_nodes);
        build(right, right_nodes);
    } else {
        rayon::join(|| build(left, left_nodes), || build(right, right_nodes));
    }
}

/// Items that a query of a [`KdTree`] found, nearest first. The buffer is reused, so that no query allocates.
#[derive(Clone, Debug)]
pub(crate) struct Nearest {
    /// Maximum number of items that a query returns; at least 1.
    limit: usize,
    /// Squared distance from the query beyond which items are ignored.
    bound: f64,
    items: Vec<(f64, u32)>,
}

impl Nearest {
    /// Creates the buffer for queries of the `limit` nearest items within `distance`.
    pub(crate) fn within(limit: usize, distance: f64) -> Self {
        let limit = limit.max(1);
        Self { limit, bound: distance * distance, items: Vec::with_capacity(limit) }
    }

    /// Limits subsequent queries to items within `distance`.
    pub(crate) fn look_within(&mut self, distance: f64) {
        self.bound = distance * distance;
    }

    /// Returns the items found as (squared distance, slot), nearest first.
    pub(crate) fn items(&self) -> &[(f64, u32)] {
        &self.items
    }

    fn farthest(&self) -> f64 {
        if self.items.len() < self.limit { self.bound } else { self.items[self.limit - 1].0 }
    }

    #[inline]
    fn offer(&mut self, distance: f64, slot: u32) {
        if distance > self.bound {
            return;
        }
        let nearer = |a: &(f64, u32)| a.0 < distance || (a.0 == distance && a.1 < slot);
        if self.items.len() == self.limit {
            if nearer(&self.items[self.limit - 1]) {
                return;
            }
            self.items.pop();
        }
        let mut at = self.items.len();
        while at > 0 && !nearer(&self.items[at - 1]) {
            at -= 1;
        }
        self.items.insert(at, (distance, slot));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::random::Random;

    fn scattered(count: usize, levels: f64) -> Vec<DVec3> {
        let mut random = Random::new(7);
        let mut coordinate = || (random.unit() * levels).floor() / levels;
        (0..count).map(|_| DVec3::new(coordinate(), coordinate(), coordinate())).collect()
    }

    #[test]
    fn nearest_agrees_with_brute_force_with_and_without_duplicates() {
        // Few coordinate values: most coordinates are shared and most distances tie. Trees have 1 to 3000 points.
        for (count, levels) in [(1, 1e9), (2, 1.0), (13, 3.0), (400, 4.0), (3000, 1e9), (3000, 9.0), (500, 1.0)] {
            let points = scattered(count, levels);
            let tree = KdTree::new(&points);
            let mut found = Nearest::within(10, f64::INFINITY);
            for q in scattered(40, 17.0) {
                tree.nearest(q, &mut found);
                let mut all: Vec<(f64, u32)> =
                    (0..count).map(|s| (tree.point(s).distance_squared(q), s as u32)).collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                all.truncate(10);
                assert_eq!(found.items(), all, "{count} points, {levels} levels");
            }
        }
    }

    #[test]
    fn near_visits_everything_within_reach() {
        let points = scattered(2000, 1e9);
        let reach: Vec<f64> = (0..2000).map(|i| if i % 500 == 3 { 0.6 } else { 0.01 }).collect();
        let tree = KdTree::new(&points);
        let largest = tree.largest_below(&reach);
        for q in scattered(30, 11.0) {
            let mut visited = vec![false; 2000];
            tree.near(q, 0.05, &largest, &mut |s| visited[tree.index(s)] = true);
            let missed = (0..2000).find(|&i| points[i].distance(q) <= 0.05 + reach[i] && !visited[i]);
            assert_eq!(missed, None);
            assert!(visited.iter().filter(|v| **v).count() < 1600, "nothing was pruned");
        }
    }
}
