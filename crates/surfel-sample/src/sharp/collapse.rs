//! Simplification of a mesh by edge collapse (Garland and Heckbert 1997) with the two rules of C12 §5.2. A collapse is
//! rejected if a splat of the new triangles couldn't be clipped to its ridges. The error of a ridge's curve adds to the
//! priority.

use super::conic::{even_points, parabola_error};
use super::surface::{Edge, Kind, Piece, Surface, edge, normal_of};
use crate::Progress;
use glam::{DMat3, DVec3};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Fraction of an edge's squared length that is added to the squared error of its collapse; collapses are ordered by
/// the sum. In flat areas the term makes the triangles even; elsewhere it is small relative to the error.
const EVENNESS: f64 = 1e-5;
/// Smallest cosine (about 45°) between a triangle's normals before and after a collapse.
const MIN_TURN: f64 = 0.7;
/// Height of a triangle, relative to its longest edge, below which the triangle is a sliver. A collapse may make a
/// triangle a sliver only if the triangle was more slender before.
const SLIVER: f64 = 0.1;
/// Largest length of an edge in the first round, relative to the edges of an even triangulation with the requested
/// number of triangles. Larger splats would have too large a depth tolerance.
const LONGEST: f64 = 2.2;
/// Largest error of a collapse, relative to the longest edge allowed in the same round; the last round has no such
/// limit. Flat parts thus get longer edges before a curved part loses its shape.
const MAX_RELATIVE_ERROR: f64 = 0.01;
/// Maximum number of rounds in which all edges are tried.
const ROUNDS: usize = 8;
/// Largest distance of a ridge from its triangle's edge, relative to the triangle's height, at which a collapse is
/// accepted. The splat reaches a third of the height beyond the edge.
const MAX_BULGE: f64 = 0.28;

/// Limits of a simplification by edge collapse.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Number of triangles at which the simplification stops.
    pub faces: usize,
    /// Largest error that a collapse may have, in object units.
    pub error: f64,
    /// Largest distance of a ridge from its chord at which it counts as straight, in object units.
    pub straight: f64,
    /// Cosine of the crease angle, at which faces no longer belong to one smooth surface.
    pub crease_cos: f64,
}

/// Quadric error metric of a vertex: the sum pᵀ·a·p + 2·b·p + c of the squared distances of a point p to planes. The
/// distances are weighted by the areas of the planes' triangles, and `area` is the sum of these areas.
#[derive(Clone, Copy)]
struct Quadric {
    a: DMat3,
    b: DVec3,
    c: f64,
    area: f64,
}

impl Quadric {
    const ZERO: Self = Self { a: DMat3::ZERO, b: DVec3::ZERO, c: 0.0, area: 0.0 };

    fn of_plane(n: DVec3, p: DVec3, area: f64) -> Self {
        let d = -n.dot(p);
        let outer = DMat3::from_cols(n * n.x, n * n.y, n * n.z);
        Self { a: outer * area, b: n * (d * area), c: d * d * area, area }
    }

    fn plus(&self, o: &Self) -> Self {
        Self { a: self.a + o.a, b: self.b + o.b, c: self.c + o.c, area: self.area + o.area }
    }

    /// Returns the mean squared distance of a point to the planes.
    fn error(&self, p: DVec3) -> f64 {
        let sum = p.dot(self.a * p) + 2.0 * self.b.dot(p) + self.c;
        if self.area > 0.0 { (sum / self.area).max(0.0) } else { 0.0 }
    }

    /// Returns the position with the smallest error. Along directions in which the error doesn't change, it is the
    /// position nearest to `middle`.
    fn best_near(&self, middle: DVec3) -> DVec3 {
        let pull = 1e-3 * self.area;
        let a = self.a + DMat3::from_diagonal(DVec3::splat(pull));
        let solved = a.inverse() * (middle * pull - self.b);
        if solved.is_finite() { solved } else { middle }
    }
}

#[derive(Clone, Copy)]
struct Candidate {
    keep: u32,
    remove: u32,
    target: DVec3,
    /// Squared distance of the collapsed surface from the original surface and its ridges, in squared object units.
    error: f64,
    cost: f64,
}

struct Collapser<'a> {
    surface: &'a mut Surface,
    limits: Limits,
    /// Function that returns the distance of a point from the original mesh.
    distance: &'a dyn Fn(DVec3) -> f64,
    alive: Vec<bool>,
    /// Indices of the triangles at each vertex, some of which may be removed ones.
    around: Vec<Vec<u32>>,
    /// Number of triangles at each vertex that aren't removed.
    valences: Vec<u32>,
    quadrics: Vec<Quadric>,
    longest: f64,
    heap: BinaryHeap<Reverse<(u64, u32, u32)>>,
}

/// Collapses edges of `surface`, cheapest first, until [`Limits::faces`] is reached or no collapse is possible within
/// the limits. Returns the largest error of a collapse, in object units.
pub(crate) fn collapse(
    surface: &mut Surface,
    limits: Limits,
    distance: &dyn Fn(DVec3) -> f64,
    progress: &dyn Progress,
) -> f64 {
    let mut around = vec![Vec::new(); surface.positions.len()];
    let mut quadrics = vec![Quadric::ZERO; surface.positions.len()];
    let mut total = 0.0;
    for (i, face) in surface.faces.iter().enumerate() {
        let corners = surface.corners(*face);
        let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        let quadric = Quadric::of_plane(normal_of(corners), corners[0], area);
        total += area;
        for v in face {
            around[*v as usize].push(i as u32);
            quadrics[*v as usize] = quadrics[*v as usize].plus(&quadric);
        }
    }
    let even = (4.0 / 3f64.sqrt() * total / limits.faces.max(1) as f64).sqrt();
    let alive = vec![true; surface.faces.len()];
    let valences = around.iter().map(|faces| faces.len() as u32).collect();
    let mut collapser = Collapser {
        surface,
        limits,
        distance,
        alive,
        around,
        valences,
        quadrics,
        longest: LONGEST * even,
        heap: BinaryHeap::new(),
    };
    let largest = collapser.run(progress);
    collapser.compact();
    largest.sqrt()
}

impl Collapser<'_> {
    fn run(&mut self, progress: &dyn Progress) -> f64 {
        let mut left = self.surface.faces.len();
        progress.stage("edges", left.saturating_sub(self.limits.faces) as u64);
        let mut largest = 0.0f64;
        // In each round, collapses rejected before may have become possible. Longer edges are allowed only in later
        // rounds, because a few large splats are better than too many splats.
        for round in 1..=ROUNDS {
            let before = left;
            self.offer_all();
            let dearest = if round < ROUNDS { MAX_RELATIVE_ERROR * self.longest } else { f64::INFINITY };
            let (error, got_dear) = self.round(dearest, &mut left, progress);
            largest = largest.max(error);
            if left <= self.limits.faces {
                break;
            }
            if got_dear || 100 * (before - left) < before {
                self.longest *= 1.5;
            }
        }
        largest
    }

    fn offer_all(&mut self) {
        self.heap.clear();
        for vertex in 0..self.surface.positions.len() as u32 {
            for other in self.neighbours(vertex) {
                if vertex < other {
                    self.offer(vertex, other);
                }
            }
        }
    }

    /// Collapses edges, cheapest first, until [`Limits::faces`] is reached, no edge is left, or the next error is above
    /// `dearest`. `left` is the number of remaining triangles. Returns the largest squared error, and true if an error
    /// above `dearest` ended the round.
    fn round(&mut self, dearest: f64, left: &mut usize, progress: &dyn Progress) -> (f64, bool) {
        let mut largest = 0.0f64;
        while *left > self.limits.faces {
            let Some(Reverse((bits, a, b))) = self.heap.pop() else { break };
            // Heap entries aren't removed when they change, so each popped entry is evaluated again.
            let Some(candidate) = self.candidate(a, b) else { continue };
            if candidate.cost > f64::from_bits(bits) * (1.0 + 1e-9) {
                self.heap.push(Reverse((candidate.cost.to_bits(), a, b)));
                continue;
            }
            if candidate.error > self.limits.error * self.limits.error || !self.is_feasible(&candidate) {
                continue;
            }
            // Quadrics average over planes, which hides the error of a small plane, so the new triangles' measured
            // distance decides.
            let measured = self.measured(&candidate);
            if measured.cost > f64::from_bits(bits) * (1.0 + 1e-9) {
                if measured.error <= self.limits.error * self.limits.error {
                    self.heap.push(Reverse((measured.cost.to_bits(), a, b)));
                }
                continue;
            }
            let candidate = measured;
            if candidate.error > dearest * dearest {
                return (largest, true);
            }
            let removed = self.apply(&candidate);
            *left -= removed;
            largest = largest.max(candidate.error);
            progress.advance(removed as u64);
        }
        (largest, false)
    }

    fn position(&self, v: u32) -> DVec3 {
        self.surface.positions[v as usize]
    }

    fn kind(&self, v: u32) -> Kind {
        self.surface.kinds[v as usize]
    }

    fn piece(&self, a: u32, b: u32) -> Option<Piece> {
        self.surface.pieces.get(&edge(a, b)).copied()
    }

    /// Returns the indices of the triangles at a vertex, without removed ones.
    fn faces_at(&self, v: u32) -> impl Iterator<Item = u32> {
        self.around[v as usize].iter().copied().filter(|face| self.alive[*face as usize])
    }

    /// Returns the vertices that share an edge with `v`, in ascending order.
    fn neighbours(&self, v: u32) -> Vec<u32> {
        let faces = self.faces_at(v).flat_map(|f| self.surface.faces[f as usize]);
        let mut all: Vec<u32> = faces.filter(|o| *o != v).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Returns two vertices, the one with fewer triangles first. Callers search the triangles of the first one only,
    /// because the vertex in the middle of a fan may have thousands.
    fn by_triangles(&self, a: u32, b: u32) -> (u32, u32) {
        if self.valences[a as usize] <= self.valences[b as usize] { (a, b) } else { (b, a) }
    }

    /// True if two vertices share an edge.
    fn are_joined(&self, a: u32, b: u32) -> bool {
        let (few, other) = self.by_triangles(a, b);
        self.faces_at(few).any(|f| self.surface.faces[f as usize].contains(&other))
    }

    fn offer(&mut self, a: u32, b: u32) {
        if let Some(candidate) = self.candidate(a, b) {
            self.heap.push(Reverse((candidate.cost.to_bits(), a, b)));
        }
    }

    /// Returns the best collapse of an edge; `None` if the edge can't be collapsed.
    fn candidate(&self, a: u32, b: u32) -> Option<Candidate> {
        if !self.are_joined(a, b) {
            return None;
        }
        let quadric = self.quadrics[a as usize].plus(&self.quadrics[b as usize]);
        let length2 = self.position(a).distance_squared(self.position(b));
        let candidate = |keep: u32, remove: u32, target: DVec3, curve: f64| {
            let error = quadric.error(target).max(curve * curve);
            Candidate { keep, remove, target, error, cost: error + EVENNESS * length2 }
        };
        let onto = |keep: u32, remove: u32, curve: f64| candidate(keep, remove, self.position(keep), curve);
        if self.piece(a, b).is_some() {
            // Along the ridge, onto one of its own points.
            let along = |keep: u32, remove: u32| {
                let is_ridge = self.kind(remove) == Kind::Ridge;
                let merged = is_ridge.then(|| self.merged(keep, remove)).flatten()?;
                Some(onto(keep, remove, parabola_error(&self.surface.line(&merged.1))))
            };
            let (first, second) = (along(a, b), along(b, a));
            return match (first, second) {
                (Some(x), Some(y)) => Some(if y.cost < x.cost { y } else { x }),
                (x, y) => x.or(y),
            };
        }
        match (self.kind(a), self.kind(b)) {
            (Kind::Smooth, Kind::Smooth) => {
                let middle = 0.5 * (self.position(a) + self.position(b));
                let best = quadric.best_near(middle);
                let sound = best.distance_squared(middle) <= length2;
                Some(candidate(a, b, if sound { best } else { middle }, 0.0))
            }
            (_, Kind::Smooth) => Some(onto(a, b, 0.0)),
            (Kind::Smooth, _) => Some(onto(b, a, 0.0)),
            _ => None,
        }
    }

    /// Returns the ridge piece that results if `remove` is collapsed into `keep`: the ridge's next vertex after
    /// `remove`, and the piece from `keep` to that vertex. `None` if the edge is on no ridge, if the ridge ends at
    /// `remove`, or if it is a loop of three pieces.
    fn merged(&self, keep: u32, remove: u32) -> Option<(u32, Piece)> {
        let first = self.piece(keep, remove)?;
        let beyond = self.neighbours(remove).into_iter().find(|o| *o != keep && self.piece(remove, *o).is_some())?;
        let second = self.piece(remove, beyond)?;
        // A loop of three pieces can't lose another vertex.
        if first.ridge != second.ridge || self.piece(keep, beyond).is_some() {
            return None;
        }
        let piece = Piece { from: first.from.min(second.from), to: first.to.max(second.to), ..first };
        Some((beyond, piece))
    }

    /// Returns the candidate with its error raised to the measured one, if that is larger. The measured error is the
    /// largest distance of the new triangles' centroids and edge midpoints from the mesh.
    fn measured(&self, c: &Candidate) -> Candidate {
        let moves = c.target != self.position(c.keep);
        let moved = moves.then(|| self.faces_at(c.keep)).into_iter().flatten();
        let mut largest = 0.0f64;
        for face in self.faces_at(c.remove).chain(moved) {
            let t = self.surface.faces[face as usize];
            if t.contains(&c.keep) && t.contains(&c.remove) {
                continue;
            }
            let [a, b, d] = t.map(|v| if v == c.keep || v == c.remove { c.target } else { self.position(v) });
            let points = [(a + b + d) / 3.0, 0.5 * (a + b), 0.5 * (b + d), 0.5 * (d + a)];
            largest = points.into_iter().map(self.distance).fold(largest, f64::max);
        }
        let error = c.error.max(largest * largest);
        Candidate { error, cost: c.cost - c.error + error, ..*c }
    }

    fn is_feasible(&self, c: &Candidate) -> bool {
        let valence = |v: u32| self.valences[v as usize] as usize;
        let (few, other) = self.by_triangles(c.keep, c.remove);
        let has = |face: &u32, v: u32| self.surface.faces[*face as usize].contains(&v);
        let shared = self.faces_at(few).filter(|f| has(f, other)).count();
        let common = self.neighbours(few).into_iter().filter(|v| *v != other && self.are_joined(*v, other)).count();
        // Topology: every common neighbour must be the third corner of a removed triangle.
        if common != shared || shared == 0 || shared > 2 || valence(c.keep) + valence(c.remove) <= 2 * shared {
            return false;
        }
        let merged = self.piece(c.keep, c.remove).and_then(|_| self.merged(c.keep, c.remove));
        let moves = c.target != self.position(c.keep);
        let changed = self.faces_at(c.remove).filter(|f| !has(f, c.keep));
        let moved = moves.then(|| self.faces_at(c.keep)).into_iter().flatten().filter(|f| !has(f, c.remove));
        changed.chain(moved).all(|f| self.is_sound(c, f, merged))
    }

    /// True if a triangle is well-shaped after the collapse `c`, and its splat can be clipped. `merged` is the result
    /// of [`Self::merged`] for the collapsed edge, if this is part of a ridge.
    fn is_sound(&self, c: &Candidate, face: u32, merged: Option<(u32, Piece)>) -> bool {
        let old = self.surface.faces[face as usize];
        let new = old.map(|v| if v == c.remove { c.keep } else { v });
        let corners = new.map(|v| if v == c.keep { c.target } else { self.position(v) });
        let before = self.surface.corners(old);
        let (normal, old_normal) = (normal_of(corners), normal_of(before));
        let (shape, old_shape) = (slenderness(corners), slenderness(before));
        if normal.dot(old_normal) < MIN_TURN || (shape.0 < SLIVER && shape.0 < old_shape.0) {
            return false;
        }
        if shape.1 > self.longest && shape.1 > old_shape.1 {
            return false;
        }
        let mut curved = 0;
        for k in 0..3 {
            let (a, b, opposite) = (new[k], new[(k + 1) % 3], corners[(k + 2) % 3]);
            let of_merged = merged.filter(|(beyond, _)| edge(a, b) == edge(c.keep, *beyond));
            let piece = of_merged.map(|m| m.1).or_else(|| self.piece(a, b));
            let Some(piece) = piece else {
                if !self.stays_smooth(c, face, (a, b), normal) {
                    return false;
                }
                continue;
            };
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let direction = (to - from).normalize_or_zero();
            let off = |p: &DVec3| (*p - from).reject_from_normalized(direction).length();
            let bulge = even_points(&self.surface.line(&piece), 9).iter().map(off).fold(0.0, f64::max);
            let height = (opposite - from).reject_from_normalized(direction).length();
            curved += usize::from(bulge > self.limits.straight);
            if bulge > self.limits.straight && bulge > MAX_BULGE * height {
                return false;
            }
        }
        // A splat has one curve; its other ridges are clipped by lines.
        curved <= 1
    }

    /// True if, after the collapse `c`, the triangle `face` meets the triangle across its edge (a, b) at less than the
    /// crease angle. `normal` is the new normal of `face`. Also true if the collapse changes the other triangle too, or
    /// if there is none.
    fn stays_smooth(&self, c: &Candidate, face: u32, (a, b): Edge, normal: DVec3) -> bool {
        let other = self.faces_at(self.by_triangles(a, b).0).find(|f| {
            let t = self.surface.faces[*f as usize];
            *f != face && t.contains(&a) && t.contains(&b) && !t.contains(&c.remove) && !t.contains(&c.keep)
        });
        other.is_none_or(|f| {
            let beyond = normal_of(self.surface.corners(self.surface.faces[f as usize]));
            normal.dot(beyond) >= self.limits.crease_cos
        })
    }

    /// Performs a collapse, puts the edges whose costs it changed into the queue again, and returns the number of
    /// removed triangles.
    fn apply(&mut self, c: &Candidate) -> usize {
        if let Some((beyond, piece)) = self.piece(c.keep, c.remove).and_then(|_| self.merged(c.keep, c.remove)) {
            self.surface.pieces.remove(&edge(c.keep, c.remove));
            self.surface.pieces.remove(&edge(c.remove, beyond));
            self.surface.pieces.insert(edge(c.keep, beyond), piece);
        }
        self.surface.positions[c.keep as usize] = c.target;
        self.quadrics[c.keep as usize] = self.quadrics[c.keep as usize].plus(&self.quadrics[c.remove as usize]);
        let mut removed = 0;
        for face in std::mem::take(&mut self.around[c.remove as usize]) {
            if !self.alive[face as usize] {
                continue;
            }
            let t = &mut self.surface.faces[face as usize];
            if t.contains(&c.keep) {
                self.alive[face as usize] = false;
                removed += 1;
                for v in *t {
                    self.decrement_valence(v);
                }
            } else {
                t.iter_mut().for_each(|v| *v = if *v == c.remove { c.keep } else { *v });
                self.around[c.keep as usize].push(face);
                self.valences[c.keep as usize] += 1;
            }
        }
        self.valences[c.remove as usize] = 0;
        for other in self.neighbours(c.keep) {
            self.offer(c.keep, other);
            // The next vertex of the ridge has another piece on this side after the collapse.
            if self.piece(c.keep, other).is_some() {
                for further in self.neighbours(other).into_iter().filter(|f| *f != c.keep) {
                    self.offer(other, further);
                }
            }
        }
        removed
    }

    /// Decrements the number of triangles at a vertex. Once most triangles in the vertex's list [`Self::around`] have
    /// been removed from the mesh, the list is cleaned. Otherwise every search at the middle of a fan would visit
    /// removed triangles.
    fn decrement_valence(&mut self, v: u32) {
        let valence = &mut self.valences[v as usize];
        *valence = valence.saturating_sub(1);
        let faces = &mut self.around[v as usize];
        if faces.len() > 2 * *valence as usize {
            faces.retain(|face| self.alive[*face as usize]);
        }
    }

    fn compact(self) {
        let mut alive = self.alive.iter();
        self.surface.faces.retain(|_| *alive.next().unwrap_or(&false));
    }
}

/// Returns a triangle's height relative to its longest edge, and the length of that edge.
fn slenderness([a, b, c]: [DVec3; 3]) -> (f64, f64) {
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    if longest <= 0.0 {
        return (0.0, 0.0);
    }
    ((b - a).cross(c - a).length() / (longest * longest), longest)
}

#[cfg(test)]
mod tests;
