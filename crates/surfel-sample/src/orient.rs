//! Consistent signs for estimated normals: a minimum spanning forest over the neighbour graph (Hoppe et al. 1992,
//! §3.3).
//!
//! Kruskal's algorithm with a union-find that carries the relative sign of each point to its root: no tree is ever
//! built or walked. Weights 1 − |n·n'| are sorted into 65,536 buckets; finer differences don't change a sign.

use crate::neighbours::{Neighbours, WIDE};
use crate::parallel::map_each;
use crate::progress::Progress;
use crate::tree::Nearest;
use glam::DVec3;

/// Union-find whose elements know their sign relative to their root.
struct SignedSets {
    parent: Vec<u32>,
    flipped: Vec<bool>,
    count: usize,
}

impl SignedSets {
    fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect(), flipped: vec![false; count], count }
    }

    /// The root of `i`, and whether `i` is flipped against it. Halves the path as it goes.
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
            // The smaller index stays root: no sizes to keep, and path halving bounds the depth.
            let (root, child) = (ra.min(rb), ra.max(rb));
            self.parent[child as usize] = root;
            self.flipped[child as usize] = fa ^ fb ^ flip;
            self.count -= 1;
        }
    }
}

fn bucket(n: DVec3, m: DVec3) -> u16 {
    ((1.0 - n.dot(m).abs()).clamp(0.0, 1.0) * f64::from(u16::MAX)) as u16
}

/// Flips the `normals` (one a slot) that are not `given`, so that neighbours agree and surfaces face outward; what
/// cannot be told (a flat sheet) faces `up`. Given normals stay, and their majority decides for their component.
pub(crate) fn orient(cloud: &Neighbours, normals: &mut [DVec3], given: &[bool], up: DVec3, progress: &dyn Progress) {
    let (count, degree) = (cloud.len(), cloud.degree);
    progress.stage("orientation", count as u64);
    let mut sets = SignedSets::new(count);
    let buckets: Vec<u16> = map_each(
        count * degree,
        progress_none(),
        || (),
        |(), edge| {
            let slot = edge / degree;
            bucket(normals[slot], normals[cloud.of(slot)[edge % degree] as usize])
        },
    );
    for edge in sorted(&buckets) {
        let (a, b) = (edge / degree, cloud.of(edge / degree)[edge % degree]);
        sets.join(a as u32, b, normals[a].dot(normals[b as usize]) < 0.0);
    }
    if sets.count > 1 && count > degree + 1 {
        bridge(cloud, normals, &mut sets);
    }
    let signs = component_signs(cloud, normals, given, up, &mut sets);
    for slot in 0..count {
        let (root, flipped) = sets.find(slot as u32);
        if !given[slot] && (signs[root as usize] != flipped) {
            normals[slot] = -normals[slot];
        }
    }
    progress.advance(count as u64);
}

fn progress_none() -> &'static dyn Progress {
    &crate::NoProgress
}

/// Indices of `buckets` in ascending order of their value, equal ones in order of index.
fn sorted(buckets: &[u16]) -> impl Iterator<Item = usize> {
    let mut starts = vec![0_usize; usize::from(u16::MAX) + 2];
    for b in buckets {
        starts[usize::from(*b) + 1] += 1;
    }
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    let mut order = vec![0_u32; buckets.len()];
    for (i, b) in buckets.iter().enumerate() {
        let start = &mut starts[usize::from(*b)];
        order[*start] = i as u32;
        *start += 1;
    }
    order.into_iter().map(|i| i as usize)
}

/// Joins components that the table keeps apart (scan lines far from each other) where a wider look reaches.
fn bridge(cloud: &Neighbours, normals: &[DVec3], sets: &mut SignedSets) {
    let roots: Vec<u32> = (0..cloud.len() as u32).map(|i| sets.find(i).0).collect();
    let state = || (Nearest::new(WIDE + 1), Vec::new());
    // The largest component is found by the others: looking from it would cost far more.
    let mut sizes = vec![0_u32; cloud.len()];
    roots.iter().for_each(|r| sizes[*r as usize] += 1);
    let largest = (0..sizes.len()).max_by_key(|r| (sizes[*r], std::cmp::Reverse(*r))).unwrap_or(0);
    let found = map_each(cloud.len(), progress_none(), state, |(found, wide), slot| {
        if roots[slot] as usize == largest {
            return None;
        }
        cloud.widen(slot, found, wide);
        wide.iter().find(|&&j| roots[j as usize] != roots[slot]).copied()
    });
    let edges: Vec<(usize, u32)> = found.into_iter().enumerate().filter_map(|(a, b)| Some((a, b?))).collect();
    let buckets: Vec<u16> = edges.iter().map(|&(a, b)| bucket(normals[a], normals[b as usize])).collect();
    for e in sorted(&buckets) {
        let (a, b) = edges[e];
        sets.join(a as u32, b, normals[a].dot(normals[b as usize]) < 0.0);
    }
}

/// The directions in which a component's extreme points vote: the faces and corners of a cube.
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

/// The votes of a component's points about its sign.
#[derive(Clone, Copy)]
struct Votes {
    given: i64,
    up: f64,
    count: f64,
    extremes: [(f64, u32); 14],
}

/// For each root whether its component must be flipped.
fn component_signs(
    cloud: &Neighbours,
    normals: &[DVec3],
    given: &[bool],
    up: DVec3,
    sets: &mut SignedSets,
) -> Vec<bool> {
    let directions = directions();
    let mut place = vec![u32::MAX; cloud.len()];
    let mut votes: Vec<Votes> = Vec::new();
    for slot in 0..cloud.len() {
        let (root, flipped) = sets.find(slot as u32);
        let place = &mut place[root as usize];
        if *place == u32::MAX {
            *place = votes.len() as u32;
            votes.push(Votes { given: 0, up: 0.0, count: 0.0, extremes: [(f64::NEG_INFINITY, 0); 14] });
        }
        let v = &mut votes[*place as usize];
        if given[slot] {
            v.given += if flipped { -1 } else { 1 };
        }
        let sign = if flipped { -1.0 } else { 1.0 };
        v.up += sign * normals[slot].dot(up);
        v.count += 1.0;
        for (extreme, d) in v.extremes.iter_mut().zip(&directions) {
            let height = cloud.point(slot).dot(*d);
            if height > extreme.0 {
                *extreme = (height, slot as u32);
            }
        }
    }
    let mut signs = vec![false; cloud.len()];
    for root in 0..cloud.len() {
        if place[root] == u32::MAX {
            continue;
        }
        let v = &votes[place[root] as usize];
        let mut outward = 0.0;
        for ((_, slot), d) in v.extremes.iter().zip(&directions) {
            let sign = if sets.find(*slot).1 { -1.0 } else { 1.0 };
            outward += sign * normals[*slot as usize].dot(*d);
        }
        // A closed surface gets close to 14 votes, a sheet about none: its extreme points look the same from both
        // sides. Then up decides, and where that says nothing either (a wall), whatever outward says.
        let undecided = outward.abs() < 1.0 && v.up.abs() > 0.01 * v.count;
        signs[root] = if v.given != 0 {
            v.given < 0
        } else if undecided {
            v.up < 0.0
        } else {
            outward < 0.0
        };
    }
    signs
}

/// Points every normal that is not `given` toward `viewpoint`, in working coordinates.
pub(crate) fn toward(cloud: &Neighbours, normals: &mut [DVec3], given: &[bool], viewpoint: DVec3) {
    for slot in 0..cloud.len() {
        if !given[slot] && normals[slot].dot(viewpoint - cloud.point(slot)) < 0.0 {
            normals[slot] = -normals[slot];
        }
    }
}
