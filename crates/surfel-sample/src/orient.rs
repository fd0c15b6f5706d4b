//! Consistent signs for estimated normals (after Hoppe et al. 1992, §3.3), in parallel. An edge connects a point to one
//! of its nearest neighbours. Within a block of points, the strongest edges join points to *patches*: sets of points
//! with consistent signs. The votes of all edges between patches then decide the signs of the few patches.
//!
//! An edge's *relation* says whether two normals are on the same side of the surface. For this, one normal is mirrored
//! across the plane halfway between the two points, and compared with the other. The source is König and Gumhold 2009,
//! "Consistent propagation of normal orientations in point clouds". The mirrored normal is right around creases too.
//! The steeper an edge is to the tangent planes, the less it counts, because it may lead to another surface.
//! Union-finds store the sign of each element relative to its root, so that no tree is built or traversed.
//!
//! A *slot* is a point's place in the order of [`SortedPoints`], and a *grid step* is the unit of its coordinates.

use crate::class::ROUGH;
use crate::median::spread;
use crate::nearest::Search;
use crate::normals::{WIDE, estimate, fitted_stored_normal, offset, wider};
use crate::parallel::{for_chunks, map_tasks};
use crate::progress::Progress;
use crate::sorted::{RUN, SortedPoints};
use glam::{DVec3, Vec3};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Number of points in a block, which one task divides into patches of consistent normals. Patches don't extend beyond
/// a block.
const BLOCK: usize = RUN;
/// Smallest absolute relation of an edge (see [`relation`]) at which its two points are joined at once, in any order.
/// With noise as large as one spacing, 0.95 turns 2 to 3.5 % of a torus's points the wrong way. A limit of 0.75 turns 2
/// to 9 %.
const STRONG: f32 = 0.95;
/// Absolute mean of the relations ([`relation`]) of the edges between two patches of a block below which the patches
/// are joined only if one of them is small ([`SMALL`]).
const WEAK: f32 = 0.25;
/// Number of points below which a patch of consistent normals is small.
const SMALL: u32 = 16;
/// Ratio of lengths above which an edge, from a point to one of its nearest neighbours, may start at a stray point and
/// is ignored at first. The ratio is the edge's length over the distance from the neighbour to the neighbour's own
/// farthest neighbour.
const ALONE: f32 = 3.0;
/// Number of nearest neighbours of a point that are tested for strong edges, and compared for the coherence of normals.
pub(crate) const NEAREST: usize = 8;

/// Normal of a point's disk, and the distance of the point's farthest neighbour.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Oriented {
    /// Unit normal of the point's disk.
    pub(crate) normal: Vec3,
    /// Squared distance from the point to its farthest neighbour, in squared grid steps; 0 if unknown.
    pub(crate) farthest2: f32,
}

impl Oriented {
    /// Creates an entry with this normal and unknown neighbours.
    pub(crate) fn alone(normal: Vec3) -> Self {
        Self { normal, ..Self::default() }
    }
}

/// Rule for the side of the surface to which estimated normals point.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Outside {
    /// Toward a viewpoint, given in grid steps from the centre of all points.
    Toward(DVec3),
    /// Away from the volume that the points enclose; up if there is none.
    Outward {
        /// Up axis of the cloud as a unit vector.
        up: DVec3,
        /// True if the up axis is certain. Surfaces that may be ground then face up.
        is_certain: bool,
    },
}

impl Outside {
    /// Returns the unit direction toward the outside for a point in no surface; `place` is its position in grid steps
    /// from the centre of all points.
    pub(crate) fn at(self, place: DVec3) -> DVec3 {
        match self {
            Self::Toward(viewpoint) => (viewpoint - place).normalize_or(DVec3::Z),
            Self::Outward { up, .. } => up,
        }
    }
}

/// Computes a unit normal for each slot: from its normal in `given` if this isn't zero, else from the `degree` nearest
/// neighbours.
///
/// A given normal is preserved if it fits the neighbours ([`fitted_stored_normal`]). Estimated normals face the
/// viewpoint of [`Outside::Toward`]. With [`Outside::Outward`], the majority of the given normals decides the sign of
/// all points connected with them.
///
/// With `level_where_scattered`, estimated normals point up (+z) if the neighbours form no plane. The second result
/// flags the slots of such points, or is empty if there are none.
pub(crate) fn normals(
    points: &SortedPoints,
    degree: usize,
    given: Option<&[Vec3]>,
    outside: Outside,
    level_where_scattered: bool,
    progress: &dyn Progress,
) -> (Vec<Oriented>, Vec<bool>) {
    let count = points.len();
    progress.stage("normals", count as u64);
    let given = |slot: usize| given.map_or(Vec3::ZERO, |g| g[slot]);
    let mut all = vec![Oriented::default(); count];
    let mut labels = vec![0; count];
    let blocks = count.div_ceil(BLOCK);
    let mut blocks: Vec<Block> = all
        .chunks_mut(BLOCK)
        .zip(labels.chunks_mut(BLOCK))
        .zip(vec![Patches::default(); blocks])
        .map(|((oriented, labels), patches)| Block { oriented, labels, patches })
        .collect();
    let edges = Mutex::new(Vec::new());
    let level = Mutex::new(Vec::new());
    for_chunks(&mut blocks, 1, &|i, block| {
        let Block { oriented, labels, patches } = &mut block[0];
        let mut search = Search::new(points);
        let mut rows = Vec::with_capacity(oriented.len() * degree);
        for (slot, o) in (i * BLOCK..).zip(oriented.iter_mut()) {
            let (near, farthest2) = search.nearest(slot, degree, 0.0);
            let from = rows.len();
            rows.extend_from_slice(near);
            o.farthest2 = farthest2;
            let stored = given(slot);
            if stored != Vec3::ZERO {
                o.normal = fitted_stored_normal(points, slot, &rows[from..], stored, given);
            } else {
                o.normal = estimate(&mut search, points, slot, &rows[from..], farthest2).as_vec3();
                if let Outside::Toward(viewpoint) = outside
                    && o.normal.as_dvec3().dot(viewpoint - points.point(slot)) < 0.0
                {
                    o.normal = -o.normal;
                }
                if level_where_scattered && is_rough(points, (slot, o.normal), &rows[from..]) {
                    o.normal = Vec3::Z;
                    level.lock().unwrap_or_else(PoisonError::into_inner).push(slot);
                }
            }
        }
        if let Outside::Outward { .. } = outside {
            *patches = Patches::new(points, i * BLOCK, oriented, &rows, labels, &edges);
        }
        progress.advance(oriented.len() as u64);
    });
    let patches: Vec<Patches> = blocks.into_iter().map(|block| block.patches).collect();
    if let Outside::Outward { up, is_certain } = outside {
        progress.stage("orientation", 1);
        let edges = edges.into_inner().unwrap_or_else(PoisonError::into_inner);
        orient(points, &mut all, &given, labels, patches, edges, (up, is_certain));
        progress.advance(1);
    }
    let slots = level.into_inner().unwrap_or_else(PoisonError::into_inner);
    let mut level = vec![false; if slots.is_empty() { 0 } else { count }];
    slots.into_iter().for_each(|slot| level[slot] = true);
    (all, level)
}

/// Input and output of one task: its points' normals, and the patches that it finds among them.
struct Block<'a> {
    oriented: &'a mut [Oriented],
    labels: &'a mut [u16],
    patches: Patches,
}

/// Returns the relation of the unit normals `n` and `m` at the slots `a` and `b`: 1 for the same side of the surface,
/// −1 for opposite sides, near 0 if unclear.
#[inline]
fn relation(points: &SortedPoints, (a, n): (usize, Vec3), (b, m): (usize, Vec3)) -> f32 {
    let d = offset(points, a, b);
    let scale = 1.0 / d.length_squared();
    let (above, other) = (n.dot(d), m.dot(d));
    let mirrored = n.dot(m) - 2.0 * above * other * scale;
    mirrored * (1.0 - (above * above).max(other * other) * scale)
}

/// True if the neighbours of a point form no plane perpendicular to its normal.
fn is_rough(points: &SortedPoints, (slot, normal): (usize, Vec3), near: &[u32]) -> bool {
    let sine2 = |j: &u32| {
        let d = offset(points, slot, *j as usize);
        d.dot(normal).powi(2) / d.length_squared()
    };
    near.iter().map(sine2).sum::<f32>() > ROUGH * near.len() as f32
}

/// Returns the coherence of the normals around a point. It is the mean cosine between the point's normal and the
/// normals of `near`, each mirrored across the plane halfway to the point. A smooth surface measures 1, also around a
/// thin limb; random normals measure about 0.
pub(crate) fn coherence(points: &SortedPoints, oriented: &[Oriented], slot: usize, near: &[u32]) -> f32 {
    let n = oriented[slot].normal;
    let mirrored = |j: &u32| {
        let (d, m) = (offset(points, slot, *j as usize), oriented[*j as usize].normal);
        n.dot(m) - 2.0 * n.dot(d) * m.dot(d) / d.length_squared()
    };
    near.iter().map(mirrored).sum::<f32>() / near.len() as f32
}

/// True if the point `a` may be a stray point near `b`: all neighbours of `b` are more than [`ALONE`] times nearer to
/// `b` than `a` is.
#[inline]
fn is_alone(points: &SortedPoints, a: usize, (b, of_b): (usize, Oriented)) -> bool {
    offset(points, a, b).length_squared() > ALONE * ALONE * of_b.farthest2
}

/// Union-find over points or patches, in which each element has a sign relative to the root of its set.
struct SignedSets {
    parent: Vec<u32>,
    flipped: Vec<bool>,
    /// Number of points in the set of each root.
    sizes: Vec<u32>,
    count: usize,
}

impl SignedSets {
    fn new(sizes: Vec<u32>) -> Self {
        let count = sizes.len();
        Self { parent: (0..count as u32).collect(), flipped: vec![false; count], sizes, count }
    }

    /// Returns the root of `i`, and true if `i` is flipped relative to the root. Halves the path on the way.
    fn find(&mut self, i: u32) -> (u32, bool) {
        let (mut at, mut flip) = (i as usize, false);
        loop {
            let parent = self.parent[at] as usize;
            if parent == at {
                return (at as u32, flip);
            }
            let above = self.parent[parent];
            if above as usize != parent {
                self.flipped[at] ^= self.flipped[parent];
                self.parent[at] = above;
            }
            flip ^= self.flipped[at];
            at = self.parent[at] as usize;
        }
    }

    fn join(&mut self, a: u32, b: u32, flip: bool) {
        let ((ra, fa), (rb, fb)) = (self.find(a), self.find(b));
        if ra != rb {
            // The smaller index remains the root; path halving bounds the depth.
            let (root, child) = (ra.min(rb), ra.max(rb));
            self.parent[child as usize] = root;
            self.flipped[child as usize] = fa ^ fb ^ flip;
            self.sizes[root as usize] += self.sizes[child as usize];
            self.count -= 1;
        }
    }
}

/// Sum of the relations ([`relation`]) of all edges between two patches; its sign decides their relative orientation.
#[derive(Clone, Copy, Debug)]
struct Vote {
    patches: [u32; 2],
    /// Sum of the relations of the edges between both patches.
    sum: f32,
    /// Number of edges between both patches.
    count: f32,
}

impl Vote {
    fn new(a: u32, b: u32, relation: f32, flip: bool) -> Self {
        Self { patches: [a.min(b), a.max(b)], sum: if flip { -relation } else { relation }, count: 1.0 }
    }

    /// Converts a vote between two patches to a vote between the sets that contain the patches.
    fn between(self, sets: &mut SignedSets) -> Self {
        let ((a, fa), (b, fb)) = (sets.find(self.patches[0]), sets.find(self.patches[1]));
        Self { count: self.count, ..Self::new(a, b, self.sum, fa ^ fb) }
    }
}

/// Sums the votes of each pair of patches, and sorts them by pair.
fn summed(mut votes: Vec<Vote>) -> Vec<Vote> {
    // The sort is stable, so that sums are in the order of the edges.
    votes.sort_by_key(|v| v.patches);
    votes.dedup_by(|next, sum| {
        let is_same = next.patches == sum.patches;
        if is_same {
            sum.sum += next.sum;
            sum.count += next.count;
        }
        is_same
    });
    // The list shrinks from one vote per edge to one per pair.
    votes.shrink_to_fit();
    votes
}

/// Joins sets in rounds until `counts` is false for all votes. In each round, every set is joined along its clearest
/// vote (the largest absolute sum) for which `counts` returns true. The votes between the new sets are then summed.
/// Returns the votes between the remaining sets.
fn join_by(mut votes: Vec<Vote>, sets: &mut SignedSets, counts: impl Fn(&Vote, &SignedSets) -> bool) -> Vec<Vote> {
    let mut clearest = vec![None; sets.parent.len()];
    loop {
        votes.iter_mut().for_each(|v| *v = v.between(sets));
        votes.retain(|v| v.patches[0] != v.patches[1]);
        votes = summed(votes);
        for v in votes.iter().filter(|v| counts(v, sets)) {
            for patch in v.patches {
                let best: &mut Option<Vote> = &mut clearest[patch as usize];
                if best.is_none_or(|b| v.sum.abs() > b.sum.abs()) {
                    *best = Some(*v);
                }
            }
        }
        let mut followed: Vec<Vote> =
            votes.iter().flat_map(|v| v.patches).filter_map(|p| clearest[p as usize].take()).collect();
        if followed.is_empty() {
            return votes;
        }
        followed.sort_by(|a, b| b.sum.abs().total_cmp(&a.sum.abs()).then(a.patches.cmp(&b.patches)));
        for v in followed {
            sets.join(v.patches[0], v.patches[1], v.sum < 0.0);
        }
    }
}

/// Patches of consistent normals in a block of points. Data per point or per edge is in columns that all blocks share.
/// Many small allocations would not be returned to the system when freed.
#[derive(Clone, Debug, Default)]
struct Patches {
    /// Number of points of each patch.
    sizes: Vec<u32>,
    /// Votes between the patches of this block.
    votes: Vec<Vote>,
    /// Range of this block's edges in the shared list of edges between blocks.
    edges: Range<usize>,
}

/// Bit of a point's label that is set if the point's normal is flipped relative to the patch.
const FLIPPED: u16 = 1 << 15;

impl Patches {
    /// Finds the patches of a block, and writes each point's patch to `labels`. Edges to other blocks are appended to
    /// `all_edges`.
    fn new(
        points: &SortedPoints,
        first: usize,
        oriented: &[Oriented],
        rows: &[u32],
        labels: &mut [u16],
        all_edges: &Mutex<Vec<[u32; 2]>>,
    ) -> Self {
        let count = oriented.len();
        let degree = rows.len() / count;
        let mut sets = SignedSets::new(vec![1; count]);
        let relate = |i: usize, j: usize| {
            (!is_alone(points, first + i, (first + j, oriented[j])))
                .then(|| relation(points, (first + i, oriented[i].normal), (first + j, oriented[j].normal)))
        };
        let row = |i: usize| &rows[i * degree..(i + 1) * degree];
        for i in 0..count {
            for j in row(i).iter().take(NEAREST) {
                let j = (*j as usize).wrapping_sub(first);
                if j >= count || sets.parent[i] == sets.parent[j] {
                    continue;
                }
                if let Some(relation) = relate(i, j).filter(|r| r.abs() >= STRONG) {
                    sets.join(i as u32, j as u32, relation < 0.0);
                }
            }
        }
        let mut edges = Vec::new();
        let mut left = Vec::new();
        for i in 0..count {
            for slot in row(i) {
                let j = (*slot as usize).wrapping_sub(first);
                if j >= count {
                    edges.push([(first + i) as u32, *slot]);
                } else if sets.find(i as u32).0 != sets.find(j as u32).0 {
                    left.extend(relate(i, j).map(|relation| Vote::new(i as u32, j as u32, relation, false)));
                }
            }
        }
        let left = join_by(left, &mut sets, |v, sets| {
            let smaller = v.patches.map(|p| sets.sizes[p as usize]).into_iter().fold(u32::MAX, u32::min);
            v.sum.abs() >= WEAK * v.count || smaller < SMALL
        });
        let mut numbers = vec![u32::MAX; count];
        let mut sizes = Vec::new();
        for (i, label) in (0..).zip(labels.iter_mut()) {
            let (root, flipped) = sets.find(i);
            let number = &mut numbers[root as usize];
            if *number == u32::MAX {
                *number = sizes.len() as u32;
                sizes.push(sets.sizes[root as usize]);
            }
            *label = *number as u16 | if flipped { FLIPPED } else { 0 };
        }
        let patch = |i: u32| (u32::from(labels[i as usize] & !FLIPPED), labels[i as usize] & FLIPPED != 0);
        let between = left.iter().map(|v| {
            let ((a, fa), (b, fb)) = (patch(v.patches[0]), patch(v.patches[1]));
            Vote { count: v.count, ..Vote::new(a, b, v.sum, fa ^ fb) }
        });
        let votes = between.collect();
        let mut all_edges = all_edges.lock().unwrap_or_else(PoisonError::into_inner);
        let from = all_edges.len();
        all_edges.extend_from_slice(&edges);
        Self { sizes, votes, edges: from..all_edges.len() }
    }
}

/// Patches of all blocks, numbered consecutively.
struct AllPatches {
    blocks: Vec<Patches>,
    /// Index of each point's patch within its block, with the bit [`FLIPPED`] if the point's normal is flipped.
    labels: Vec<u16>,
    /// Index of the first patch of each block among the patches of all blocks.
    first: Vec<u32>,
}

impl AllPatches {
    /// Returns the patch of a slot, and true if the slot's normal is flipped relative to the patch.
    fn of(&self, slot: usize) -> (u32, bool) {
        let label = self.labels[slot];
        (self.first[slot / BLOCK] + u32::from(label & !FLIPPED), label & FLIPPED != 0)
    }

    fn vote(&self, points: &SortedPoints, all: &[Oriented], a: usize, b: usize) -> Vote {
        let ((pa, fa), (pb, fb)) = (self.of(a), self.of(b));
        Vote::new(pa, pb, relation(points, (a, all[a].normal), (b, all[b].normal)), fa ^ fb)
    }
}

fn orient(
    points: &SortedPoints,
    all: &mut [Oriented],
    given: &(impl Fn(usize) -> Vec3 + Sync),
    labels: Vec<u16>,
    blocks: Vec<Patches>,
    edges: Vec<[u32; 2]>,
    up: (DVec3, bool),
) {
    let mut first = Vec::with_capacity(blocks.len());
    let mut sizes = Vec::new();
    for block in &blocks {
        first.push(sizes.len() as u32);
        sizes.extend_from_slice(&block.sizes);
    }
    let mut sets = SignedSets::new(sizes);
    let atlas = AllPatches { blocks, labels, first };
    let votes = map_tasks(atlas.blocks.len(), |i| {
        let (block, first) = (&atlas.blocks[i], atlas.first[i]);
        let inside = block.votes.iter().map(|v| Vote { patches: v.patches.map(|p| p + first), ..*v });
        let across = edges[block.edges.clone()].iter().map(|e| e.map(|slot| slot as usize));
        let across = across.filter(|[a, b]| !is_alone(points, *a, (*b, all[*b])));
        let across = across.map(|[a, b]| atlas.vote(points, all, a, b));
        summed(inside.chain(across).collect())
    });
    drop(edges);
    join_by(votes.concat(), &mut sets, |_, _| true);
    if sets.count > 1 {
        bridge(points, all, &atlas, &mut sets);
    }
    // The root of each patch, and true if the patch is flipped relative to the root.
    let roots: Vec<(u32, bool)> = (0..sets.parent.len() as u32).map(|p| sets.find(p)).collect();
    let signs = signs(points, all, given, &atlas, &roots, up);
    for_chunks(all, BLOCK, &|from, chunk| {
        for (slot, o) in (from..).zip(chunk) {
            let (patch, flipped) = atlas.of(slot);
            let (root, patch_flipped) = roots[patch as usize];
            if (signs[root as usize] ^ patch_flipped ^ flipped) && given(slot) == Vec3::ZERO {
                o.normal = -o.normal;
            }
        }
    });
}

/// Joins sets of patches without edges between them (distant scan lines, stray points) by a search for more neighbours.
fn bridge(points: &SortedPoints, all: &[Oriented], atlas: &AllPatches, sets: &mut SignedSets) {
    let roots: Vec<u32> = (0..sets.parent.len() as u32).map(|p| sets.find(p).0).collect();
    // The other sets find the largest one: searches from its points would cost far more.
    let size = |r: &u32| (sets.sizes[*r as usize], std::cmp::Reverse(*r));
    let Some(largest) = roots.iter().copied().max_by_key(size) else { return };
    let root = |slot: usize| roots[atlas.of(slot).0 as usize];
    let votes = map_tasks(atlas.blocks.len(), |i| {
        let mut search = Search::new(points);
        let mut votes = Vec::new();
        for slot in i * BLOCK..points.len().min((i + 1) * BLOCK) {
            if root(slot) == largest {
                continue;
            }
            let (wide, _) = search.nearest(slot, WIDE, wider(all[slot].farthest2, 16));
            let other = wide.iter().filter(|j| root(**j as usize) != root(slot));
            votes.extend(other.map(|j| atlas.vote(points, all, slot, *j as usize)));
        }
        summed(votes)
    });
    join_by(votes.concat(), sets, |_, _| true);
}

/// Returns the 14 unit directions along which the extreme points of a set of patches are found: toward the faces and
/// corners of a cube. The normals at these points vote for the outside.
fn directions() -> [DVec3; 14] {
    let mut all = [DVec3::ZERO; 14];
    for (i, d) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
        (all[2 * i], all[2 * i + 1]) = (d, -d);
    }
    for (i, d) in all[6..].iter_mut().enumerate() {
        let sign = |bit: usize| if i & bit == 0 { 1.0 } else { -1.0 };
        *d = DVec3::new(sign(1), sign(2), sign(4)) / 3.0_f64.sqrt();
    }
    all
}

/// Number of outward votes below which a set of patches counts as an open surface. A vote is the component of an
/// extreme point's normal along the direction in which the point is extreme ([`directions`]). A valley whose sides rise
/// by 10° gets about as many votes from below.
const MIN_OUTWARD_VOTES: f64 = 2.0;

/// Evidence for the sign of a patch, or of a set of patches. `given` is the number of given normals that agree with the
/// patch's normals, less those that don't. `up` is the sum of its normals' components along the up axis, and `count`
/// its number of points.
#[derive(Clone)]
struct Evidence {
    given: i64,
    up: f64,
    count: f64,
    /// Extreme point in each of the [`directions`], without stray points: its coordinate along the direction, and its
    /// slot.
    extremes: [(f64, u32); 14],
}

impl Default for Evidence {
    fn default() -> Self {
        Self { given: 0, up: 0.0, count: 0.0, extremes: [(f64::NEG_INFINITY, 0); 14] }
    }
}

/// Returns a flag per set of patches, by its root, true if the set must be flipped so that its normals point outward.
/// The last argument is the up axis, and true if it is certain.
fn signs(
    points: &SortedPoints,
    all: &[Oriented],
    given: &(impl Fn(usize) -> Vec3 + Sync),
    atlas: &AllPatches,
    roots: &[(u32, bool)],
    (up, is_certain): (DVec3, bool),
) -> Vec<bool> {
    let directions = directions();
    // Stray points are outermost, but don't describe the surface.
    let farthest = |slot: usize| all[slot].farthest2.sqrt();
    let most = spread(all.len(), farthest).map_or(f64::INFINITY, |spread| spread.most(2.0));
    let found = map_tasks(atlas.blocks.len(), |i| {
        let block = &atlas.blocks[i];
        let mut evidence = vec![Evidence::default(); block.sizes.len()];
        for (slot, label) in (i * BLOCK..).zip(&atlas.labels[i * BLOCK..points.len().min((i + 1) * BLOCK)]) {
            let e = &mut evidence[usize::from(label & !FLIPPED)];
            let sign = if label & FLIPPED == 0 { 1.0 } else { -1.0 };
            e.given += if given(slot) == Vec3::ZERO { 0 } else { sign as i64 };
            e.up += sign * all[slot].normal.as_dvec3().dot(up);
            e.count += 1.0;
            if f64::from(farthest(slot)) > most {
                continue;
            }
            let p = points.point(slot);
            for (extreme, d) in e.extremes.iter_mut().zip(&directions) {
                let height = p.dot(*d);
                if height > extreme.0 {
                    *extreme = (height, slot as u32);
                }
            }
        }
        evidence
    });
    let mut sets = vec![Evidence::default(); roots.len()];
    for (patch, e) in found.iter().flatten().enumerate() {
        let (root, flipped) = roots[patch];
        let (set, sign) = (&mut sets[root as usize], if flipped { -1.0 } else { 1.0 });
        set.given += if flipped { -e.given } else { e.given };
        set.up += sign * e.up;
        set.count += e.count;
        for (extreme, other) in set.extremes.iter_mut().zip(e.extremes) {
            if other.0 > extreme.0 {
                *extreme = other;
            }
        }
    }
    let outward = |e: &Evidence| -> f64 {
        let vote = |((height, slot), d): (&(f64, u32), &DVec3)| {
            if *height == f64::NEG_INFINITY {
                return 0.0;
            }
            let (patch, flipped) = atlas.of(*slot as usize);
            let sign = if flipped ^ roots[patch as usize].1 { -1.0 } else { 1.0 };
            sign * all[*slot as usize].normal.as_dvec3().dot(*d)
        };
        e.extremes.iter().zip(&directions).map(vote).sum()
    };
    let flip = |e: &Evidence| {
        if e.count == 0.0 {
            return false;
        }
        if e.given != 0 {
            return e.given < 0;
        }
        // A watertight surface gets close to 14 votes. An open sheet gets about none, because its extreme points are
        // the same from both sides, and so does a shallow valley seen from below. The up axis then decides. If the up
        // axis is undecided too (a wall), the outward votes decide, however few. If the up axis is certain, a valley of
        // any depth is ground: all its normals have upward parts, while the upward parts of an object's normals nearly
        // cancel.
        let outward = outward(e);
        let level = e.up.abs() / e.count;
        let is_ground = is_certain && level > outward.abs() / directions.len() as f64;
        let is_undecided = outward.abs() < MIN_OUTWARD_VOTES && level > 0.01;
        if is_ground || is_undecided { e.up < 0.0 } else { outward < 0.0 }
    };
    sets.iter().map(flip).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoProgress;
    use crate::mesh::random::Random;

    #[test]
    fn signed_sets_know_the_sign_of_each_element_against_each() {
        let mut random = Random::new(8);
        let signs: Vec<bool> = (0..500).map(|_| random.unit() < 0.5).collect();
        let mut sets = SignedSets::new(vec![1; 500]);
        for _ in 0..3000 {
            let (a, b) = ((random.unit() * 500.0) as u32, (random.unit() * 500.0) as u32);
            sets.join(a, b, signs[a as usize] != signs[b as usize]);
        }
        assert_eq!((sets.count, sets.sizes[0]), (1, 500));
        let first = sets.find(0).1;
        assert!((0..500).all(|i| (sets.find(i).1 == first) == (signs[i as usize] == signs[0])));
    }

    /// Returns the percentage of normals with the wrong sign relative to `outward`.
    fn wrong(positions: &[DVec3], outward: &[DVec3]) -> f64 {
        let points = SortedPoints::new(positions.len(), |i| positions[i]).unwrap();
        let (all, _) =
            normals(&points, 16, None, Outside::Outward { up: DVec3::Z, is_certain: false }, false, &NoProgress);
        let is_wrong = |slot: &usize| {
            let exact = outward[points.inputs(*slot)[0] as usize];
            all[*slot].normal.as_dvec3().dot(exact) < 0.0
        };
        100.0 * (0..points.len()).filter(is_wrong).count() as f64 / points.len() as f64
    }

    #[test]
    fn signs_agree_across_blocks_around_creases_and_between_close_sheets() {
        let mut random = Random::new(12);
        // A cube: 60,000 points, fifteen blocks, edges of 90°.
        let (mut positions, mut outward) = (Vec::new(), Vec::new());
        for i in 0..60_000 {
            let (axis, sign) = (i % 3, if i % 2 == 0 { 1.0 } else { -1.0 });
            let mut p = DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
            p[axis] = sign;
            positions.push(p);
            outward.push(DVec3::AXES[axis] * sign);
        }
        // Points of an edge have normals between those of the two faces; their sign is as reliable as the faces'.
        assert!(wrong(&positions, &outward) < 0.1, "cube: {}", wrong(&positions, &outward));
        // Two sheets, three spacings apart: 30,000 points on 1 x 1 twice, spacing 1/122.
        let thickness = 3.0 / 122.0;
        let (mut positions, mut outward) = (Vec::new(), Vec::new());
        for i in 0..30_000 {
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            positions.push(DVec3::new(random.unit(), random.unit(), 0.5 * side * thickness));
            outward.push(DVec3::Z * side);
        }
        assert!(wrong(&positions, &outward) < 0.1, "sheets: {}", wrong(&positions, &outward));
    }

    /// Returns random points on the unit sphere.
    fn sphere(random: &mut Random, count: usize) -> Vec<DVec3> {
        let mut within = || DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
        let mut on = || std::iter::repeat_with(&mut within).find(|p| p.length() < 1.0).unwrap_or(DVec3::Z).normalize();
        (0..count).map(|_| on()).collect()
    }

    #[test]
    fn strays_around_a_surface_dont_turn_it() {
        let mut random = Random::new(17);
        for one_in in [500, 66, 20] {
            let mut positions = sphere(&mut random, 20_000);
            let mut outward = positions.clone();
            for _ in 0..positions.len() / one_in {
                positions.push(DVec3::new(random.unit(), random.unit(), random.unit()) * 4.0 - 2.0);
                // Both signs are right for a stray.
                outward.push(DVec3::ZERO);
            }
            let wrong = wrong(&positions, &outward);
            assert!(wrong < 0.1, "one in {one_in}: {wrong} %");
        }
    }

    #[test]
    fn dense_and_sparse_parts_of_a_surface_agree() {
        let mut random = Random::new(18);
        for times in [10, 100, 1000] {
            // One half of the sphere has `times` the density of the other.
            let mut positions = sphere(&mut random, 40_000);
            let mut left = 0;
            positions.retain(|p| {
                left += usize::from(p.x < 0.0);
                p.x >= 0.0 || left % times == 0
            });
            let wrong = wrong(&positions, &positions);
            assert!(wrong < 0.1, "{times}: {wrong} %");
        }
    }
}
