//! How large a splat must be, from the local spacing of the points around it.
//!
//! Two rules, and the larger wins. The *density* rule makes the weights of neighbours add up: a radius of
//! [`DENSITY`] times the square root of the local area per point, for which Σw is about 3.7 (the renderer's kernel
//! exp(−2ρ²) integrates to 0.432·π·r²). The *covering* rule closes the surface where the sampling is uneven: a
//! splat reaches past the farthest corner of its own Voronoi cell in the tangent plane, because a plane whose cells
//! are all covered has no holes. Where the surface turns within the first rule's radius, the second alone holds, for a
//! disk there would stick out. Both hold for points of a surface, whose neighbours have closed cells; where few have,
//! such as in far returns of a sweep, a disk is no larger than the distance of the nearest suggests, and where its own
//! cell is open or its neighbours lie in other planes, than that of the fourth does. Where cells are stretched alike
//! over a neighbourhood (scan lines), the same two rules are applied after the affine map that makes them round, and
//! the splat is an ellipse.

use crate::cell::{Cell, MOST_IN_CELL};
use crate::eigen::symmetric2;
use crate::lanes::{LANES, compress, numbers, rank};
use crate::nearest::{Search, distance2};
use crate::normals::{WIDE, wider};
use crate::orient::{NEAREST, Oriented, coherence, is_rough};
use crate::parallel::{for_chunks, map_each};
use crate::progress::{NoProgress, Progress};
use crate::sorted::{LEAF, RUN, SortedPoints};
use crate::tree::{KdTree, Nearest};
use crate::usual::{ISOLATED, usual};
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16, u32x16};
use glam::{DVec2, DVec3, Vec2, Vec3};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Radius over the square root of the area per point.
pub(crate) const DENSITY: f64 = 1.65;
/// Radius over the reach of the Voronoi cell: what curvature and tilted neighbours may take away, and a weight of
/// exp(−2/1.15²) = 0.22 instead of exp(−2) = 0.14 at the corner, times the three or more splats that meet there.
pub(crate) const COVER: f64 = 1.15;
/// Where a surface turns within the radius of the density rule by so many radians (root mean square, over the nearest
/// neighbours), a disk would stick out past the outline. It ends there, but not before it covers its cell, nor before
/// this radius over the square root of the area per point.
const FLAT: f32 = 0.7;
const LEAST: f64 = 1.0;
/// A point is sparse whose spacing is this many times that of the cloud. Where fewer than so many of these are within
/// so many times its spacing, of some 80 in a surface and 40 at its border, they are a tuft, such as a few returns of a
/// spire: no more is known of a surface there than of strays.
const SPARSE: f64 = 2.0;
const TUFT: usize = 24;
const TUFT_REACH: f64 = 5.0;
/// No radius exceeds this times that of the density rule: beyond it a gap is one of the scan, not of the sampling.
const LARGEST: f64 = 2.5;
/// Radius over the reach at a border, where the corners of a cell may lie far outside the surface.
const LARGEST_AT_BORDER: f64 = 1.5;
/// Axis ratio from which sampling counts as anisotropic.
pub(crate) const STRETCHED: f64 = 1.5;
/// Axis ratio of the longest ellipse.
const MOST_STRETCHED: f64 = 16.0;
/// Share of stretched points from which a cloud gets ellipses: random samplings have about 5 % by chance.
const STRETCHED_SHARE: f64 = 0.1;
/// A closed cell is believed when its corners are no farther than this share of the farthest neighbour: at a border,
/// where points jut out by chance, cells close far outside the surface. Shares for the table's neighbours and for
/// the wider look, which is more generous in itself; half the spacing of scan lines must pass.
const BELIEVED: f32 = 0.75;
const BELIEVED_WIDE: f32 = 0.55;
/// Neighbours take part in a point's cell when their normals agree within 60°, and they lie within 60° of its
/// tangent plane: others belong to the back of a thin part, or to the far side of a crease.
const AGREE: f32 = 0.5;
const STEEPEST: f32 = 0.866;
/// Where these leave a cell open, the surface may go on around a crease or a limb. What lies there bounds the cell, so
/// that its disk ends with the surface: all but the back, whose normals are more than 120° off.
const TURNS_AWAY: f32 = -0.5;
/// A point is part of a surface where one in this many has a closed cell, of itself and its neighbours of its side: of
/// 17 at a straight border some 10, in a square's corner 7.
const SURROUNDED: usize = 3;
/// Where neighbours lie in no plane, and the normals of the nearest agree by less, they are on no surface: of leaves
/// half of them agree by 0.5 at most, of limbs so thin that neighbours go around them by more than 0.8.
const COHERENT: f32 = 0.6;
/// The neighbour whose distance is a point's spacing, counted from 1: as many as surround it in a plane.
const RING: usize = 6;
/// The one whose distance sizes what no cell does: as many as surround it in a grid.
const GRID: usize = 4;

/// Points of a task. What lies around them is measured too, and again by its own task: of random points
/// on a surface, about a tenth.
const BLOCK: usize = 2 * RUN;
/// Sizes in steps, one a slot.
#[derive(Debug)]
pub(crate) struct Sizes {
    all: Vec<Size>,
    /// Of each slot, where the cloud is stretched.
    ellipses: Vec<Ellipse>,
    /// The spacing of the cloud.
    pub(crate) typical: f64,
    /// Splats that are not circles, where the cloud is stretched, else 0.
    pub(crate) stretched: usize,
    /// Slots of points that lie in no surface with their neighbours, in ascending order; none if not wanted.
    pub(crate) tangled: Vec<u32>,
}

/// A size as one point's neighbourhood suggests it. Flags are signs of what is never negative: a cloud has as many of
/// these as points.
#[derive(Clone, Copy, Debug, Default)]
struct Size {
    /// Radius of a disk, 0 where there is no neighbour; negative where the point is isolated.
    radius: f32,
    /// √ of the area per point; negative where neither the point nor any neighbour is surrounded: a few stray points
    /// are not, and they must not become large.
    spacing: f32,
}

impl Size {
    fn new(radius: f32, spacing: f32, is_isolated: bool, is_loose: bool) -> Self {
        let signed = |value: f32, flag: bool| if flag { -value } else { value };
        Self { radius: signed(radius, is_isolated), spacing: signed(spacing, is_loose) }
    }

    fn radius(self) -> f32 {
        self.radius.abs()
    }

    fn spacing(self) -> f32 {
        self.spacing.abs()
    }

    fn is_isolated(self) -> bool {
        self.radius.is_sign_negative()
    }

    fn is_loose(self) -> bool {
        self.spacing.is_sign_negative()
    }
}

/// The ellipse that suits a point better than its disk, in 64 bits; a ratio of 0 where none does.
#[derive(Clone, Copy, Debug, Default)]
struct Ellipse {
    /// √ of the product of the half-axes.
    mean: f32,
    /// Steps of the long axis's angle in the normal's tangent frame, up to half a turn.
    angle: u16,
    /// Steps of its length over the short one's.
    ratio: u16,
}

impl Ellipse {
    /// Steps of half a turn, and of the largest ratio.
    const STEPS: f64 = 32_767.0;

    fn new(mean: f32, angle: f64, ratio: f64) -> Self {
        let turn = (angle / std::f64::consts::PI).rem_euclid(1.0);
        let ratio = (ratio / MOST_STRETCHED * Self::STEPS).round() as u16;
        Self { mean, angle: (turn * Self::STEPS).round() as u16, ratio }
    }

    fn angle(self) -> f64 {
        f64::from(self.angle) / Self::STEPS * std::f64::consts::PI
    }

    fn ratio(self) -> f64 {
        f64::from(self.ratio) / Self::STEPS * MOST_STRETCHED
    }
}

impl Sizes {
    /// Radius of a disk of this slot, kept within what suits the cloud.
    fn bounded(&self, own: f32, size: Size) -> f64 {
        let own = f64::from(own);
        match (own > 0.0, size.is_isolated(), size.is_loose()) {
            (false, ..) => DENSITY * self.typical,
            (true, true, _) => own.min(DENSITY * self.typical),
            (true, false, true) => own.min(LARGEST * DENSITY * self.typical),
            (true, false, false) => own,
        }
    }

    /// The ellipse of this slot, if it has one.
    fn ellipse(&self, slot: usize) -> Option<Ellipse> {
        self.ellipses.get(slot).copied().filter(|ellipse| ellipse.ratio > 0)
    }

    /// Makes the splat of a slot a disk, no larger than this.
    pub(crate) fn limit(&mut self, slot: usize, radius: f64) {
        let own = self.all[slot];
        let radius = (radius as f32).min(self.bounded(own.radius(), own) as f32);
        self.all[slot] = Size::new(radius, own.spacing(), own.is_isolated(), own.is_loose());
        if self.ellipse(slot).is_some() {
            self.ellipses[slot] = Ellipse::default();
            self.stretched -= 1;
        }
    }

    pub(crate) fn is_isolated(&self, slot: usize) -> bool {
        self.all[slot].is_isolated()
    }

    /// The larger half-axis.
    pub(crate) fn radius(&self, slot: usize) -> f64 {
        let size = self.all[slot];
        match self.ellipse(slot) {
            Some(ellipse) => self.bounded(ellipse.mean, size) * ellipse.ratio().sqrt(),
            None => self.bounded(size.radius(), size),
        }
    }

    /// Half-axes (s, t), s × t along the unit `normal`.
    pub(crate) fn axes(&self, slot: usize, normal: DVec3) -> (DVec3, DVec3) {
        let size = self.all[slot];
        let (u, v) = tangents(normal.as_vec3());
        let (u, v) = (u.as_dvec3(), v.as_dvec3());
        let Some(ellipse) = self.ellipse(slot) else {
            let radius = self.bounded(size.radius(), size);
            return (u * radius, v * radius);
        };
        let (mean, direction) = (self.bounded(ellipse.mean, size), DVec2::from_angle(ellipse.angle()));
        let s = u * direction.x + v * direction.y;
        let t = v * direction.x - u * direction.y;
        (s * (mean * ellipse.ratio().sqrt()), t * (mean / ellipse.ratio().sqrt()))
    }
}

/// The spacing of points, as far as it is known beforehand, in steps.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Spacing {
    /// Nothing; a cloud that has none (one point) gets this.
    Unknown(f64),
    /// It is this on average everywhere: the density rule takes it instead of measuring.
    Known(f64),
}

/// What is measured besides radii, if it is wanted.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Wanted {
    pub(crate) ellipses: bool,
    /// Which points lie in no surface.
    pub(crate) tangled: bool,
}

/// Measures sizes from the `degree` nearest of each point (one of `oriented` a slot).
pub(crate) fn sizes(
    points: &SortedPoints,
    oriented: &[Oriented],
    degree: usize,
    spacing: Spacing,
    wanted: Wanted,
    progress: &dyn Progress,
) -> Sizes {
    let (Spacing::Unknown(fallback) | Spacing::Known(fallback)) = spacing;
    let known = if let Spacing::Known(s) = spacing { Some(s as f32) } else { None };
    let count = points.len();
    progress.stage("radii", count as u64);
    let mut all = vec![Size::default(); count];
    // Of few slots, mostly: all of them are told only where the cloud is stretched.
    let ellipses = Mutex::new(Vec::new());
    let tangled = Mutex::new(Vec::new());
    let degree = degree.min(count - 1);
    for_chunks(&mut all, BLOCK, &|first, sizes| {
        let mut block = Block::new(points, oriented, degree, known, wanted.ellipses);
        block.measure(first..first + sizes.len());
        let (mut found, mut in_none) = (Vec::new(), Vec::new());
        for (i, size) in sizes.iter_mut().enumerate() {
            let ellipse;
            (*size, ellipse) = block.size(i);
            found.extend(ellipse.map(|ellipse| ((first + i) as u32, ellipse)));
            if wanted.tangled && block.is_tangled(i) {
                in_none.push((first + i) as u32);
            }
        }
        tangled.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(&in_none);
        ellipses.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(&found);
        progress.advance(sizes.len() as u64);
    });
    let usual = usual(count, |i| all[i].spacing());
    let typical = usual.as_ref().map_or(fallback, |u| u.median);
    let most = usual.map_or(f64::INFINITY, |u| u.most(ISOLATED));
    // Strays that are each other's neighbours aren't isolated among these, and yet no surface; sparse parts of one are.
    let wide: Vec<u32> = (0..count as u32).filter(|i| f64::from(all[*i as usize].spacing()) > most).collect();
    let block = || Block::new(points, oriented, degree, known, wanted.ellipses);
    let scattered = map_each(wide.len(), &NoProgress, block, |block, i| block.is_scattered(wide[i] as usize));
    for (slot, _) in wide.iter().zip(scattered).filter(|(_, scattered)| *scattered) {
        all[*slot as usize].radius = -all[*slot as usize].radius();
    }
    let found = ellipses.into_inner().unwrap_or_else(PoisonError::into_inner);
    let is_stretched = !found.is_empty() && found.len() as f64 >= STRETCHED_SHARE * count as f64;
    let mut ellipses = vec![Ellipse::default(); if is_stretched { count } else { 0 }];
    for (slot, ellipse) in found.iter().filter(|_| is_stretched) {
        ellipses[*slot as usize] = *ellipse;
    }
    for slot in tufts(points, &all, typical) {
        all[slot].radius = (DENSITY * typical) as f32;
        if let Some(ellipse) = ellipses.get_mut(slot) {
            *ellipse = Ellipse::default();
        }
    }
    let mut tangled = tangled.into_inner().unwrap_or_else(PoisonError::into_inner);
    tangled.sort_unstable();
    Sizes { all, ellipses, typical, stretched: if is_stretched { found.len() } else { 0 }, tangled }
}

/// Slots of points that are sparse and few: fewer than [`TUFT`] are as sparse as one about it. A sparse part of a
/// surface has more, of which its border has half.
fn tufts(points: &SortedPoints, all: &[Size], typical: f64) -> Vec<usize> {
    let is_sparse = |slot: usize| f64::from(all[slot].spacing()) > SPARSE * typical;
    let is_large = |slot: usize| {
        let size = all[slot];
        !size.is_isolated() && !size.is_loose() && f64::from(size.radius()) > LARGEST * DENSITY * typical
    };
    let large: Vec<usize> = (0..all.len()).filter(|slot| is_sparse(*slot) && is_large(*slot)).collect();
    if large.is_empty() {
        return large;
    }
    let sparse: Vec<DVec3> = (0..all.len()).filter(|slot| is_sparse(*slot)).map(|slot| points.point(slot)).collect();
    let tree = KdTree::new(&sparse);
    let tuft_at = |slot: usize| {
        let mut found = Nearest::within(TUFT, f64::from(all[slot].spacing()) * TUFT_REACH);
        tree.nearest(points.point(slot), &mut found);
        found.items().len() < TUFT
    };
    let is_tuft = map_each(large.len(), &NoProgress, || (), |(), i| tuft_at(large[i]));
    large.into_iter().zip(is_tuft).filter(|(_, is_tuft)| *is_tuft).map(|(slot, _)| slot).collect()
}

/// Measures of one point's cell, in steps.
#[derive(Clone, Copy, Default)]
struct Summary {
    /// Area of a closed cell, else 0.
    area: f32,
    /// Distance of the farthest corner, 0 when there is none.
    reach: f32,
    /// Distances of the sixth neighbour and of the fourth.
    spacing: f32,
    fourth: f32,
    /// Which neighbours closed it, if any did.
    among: Among,
    /// Whether more than a quarter of the row's neighbours are on no surface with the point, on either side.
    is_scattered: bool,
    /// Second moments of a closed cell about its centroid: xx xy xz yy yz zz in space.
    moments: [f32; 6],
}

/// What neighbours a cell is built among.
#[derive(Clone, Copy, Default, PartialEq)]
enum Among {
    /// Those of its row on its side.
    #[default]
    Side,
    /// All of its row but those on the other side.
    Around,
    /// More, on its side.
    Wide,
}

/// How a cell was built.
struct Found {
    is_closed: bool,
    /// Of its lengths.
    unit: f32,
    /// As in [`Summary`].
    among: Among,
    is_scattered: bool,
}

/// Unit tangents of a unit normal, as `surfel_math::basis::orthonormal` has them.
#[inline]
fn tangents(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Cells of a run of slots and of the points around them.
struct Block<'a> {
    points: &'a SortedPoints,
    oriented: &'a [Oriented],
    degree: usize,
    known: Option<f32>,
    ellipses: bool,
    search: Search<'a>,
    /// The leaf of the last row.
    leaf: usize,
    cell: Cell,
    /// Of neighbours, x and y.
    offsets: [[f32; MOST_IN_CELL + LANES]; 2],
    /// How many neighbours the cell was built among, and how many are on a surface with its point, on either side.
    taking_part: usize,
    on_surface: usize,
    /// The run, the slots of other points that are neighbours of its own, in ascending order, and the neighbours of
    /// them all, own ones first.
    own: Range<usize>,
    halo: Vec<u32>,
    rows: Vec<u32>,
    summaries: Vec<Summary>,
}

impl<'a> Block<'a> {
    fn new(
        points: &'a SortedPoints,
        oriented: &'a [Oriented],
        degree: usize,
        known: Option<f32>,
        ellipses: bool,
    ) -> Self {
        Self {
            points,
            oriented,
            degree,
            known,
            ellipses,
            search: Search::new(points),
            leaf: usize::MAX,
            cell: Cell::default(),
            offsets: [[0.0; MOST_IN_CELL + LANES]; 2],
            taking_part: 0,
            on_surface: 0,
            own: 0..0,
            halo: Vec::new(),
            rows: Vec::new(),
            summaries: Vec::new(),
        }
    }

    /// Builds the cells.
    fn measure(&mut self, own: Range<usize>) {
        own.clone().for_each(|slot| self.add_row(slot));
        self.halo.extend(self.rows.iter().filter(|j| !own.contains(&(**j as usize))));
        self.halo.sort_unstable();
        self.halo.dedup();
        let halo = std::mem::take(&mut self.halo);
        halo.iter().for_each(|slot| self.add_row(*slot as usize));
        self.halo = halo;
        let rows = std::mem::take(&mut self.rows);
        for i in 0..own.len() + self.halo.len() {
            let slot = if i < own.len() { own.start + i } else { self.halo[i - own.len()] as usize };
            let summary = self.summary(slot, &rows[i * self.degree..(i + 1) * self.degree]);
            self.summaries.push(summary);
        }
        (self.rows, self.own) = (rows, own);
    }

    /// Finds the neighbours of a slot.
    fn add_row(&mut self, slot: usize) {
        let leaf = slot / LEAF;
        if leaf != self.leaf {
            self.leaf = leaf;
            let of_leaf = &self.oriented[self.points.leaf(leaf)];
            self.search.expect(leaf, of_leaf.iter().map(|o| o.farthest2()).fold(0.0, f32::max));
        }
        let (near, _) = self.search.nearest(slot, self.degree, self.oriented[slot].farthest2());
        self.rows.extend_from_slice(near);
    }

    #[inline]
    fn same_side(&self, a: usize, b: usize) -> bool {
        self.oriented[a].normal.dot(self.oriented[b].normal) >= AGREE
    }

    #[inline]
    fn measured(&self, slot: u32) -> Option<&Summary> {
        if self.own.contains(&(slot as usize)) {
            return Some(&self.summaries[slot as usize - self.own.start]);
        }
        self.halo.binary_search(&slot).ok().map(|i| &self.summaries[self.own.len() + i])
    }

    /// Builds the cell of `slot` among those of `near` that are in question, unrolled into its tangent plane:
    /// directions are projected, distances are kept, as on the surface itself, but where there is none. Lengths are in
    /// units of the farthest one's distance, which is returned. True if it is closed, with corners within the believed
    /// share of that distance.
    fn build(&mut self, slot: usize, near: &[u32], among: Among) -> (bool, f32) {
        let (agree, believed) = match among {
            Among::Side => (AGREE, BELIEVED),
            Among::Around => (TURNS_AWAY, BELIEVED),
            Among::Wide => (AGREE, BELIEVED_WIDE),
        };
        let Some(last) = near.last() else { return (false, 0.0) };
        let limit2 = distance2(self.points.at(*last as usize), self.points.at(slot));
        let (points, oriented, cell) = (self.points, self.oriented, &mut self.cell);
        let unrolled = (points, oriented, slot, limit2, agree);
        let counts = dispatch!(Level::new(), simd => build_by(simd, unrolled, near, &mut self.offsets, cell));
        let (count, on_surface) = counts;
        (self.taking_part, self.on_surface) = (count, on_surface);
        // Where half of the neighbours are another sheet's, the farthest of this one's would be farther.
        let share = count as f32 / near.len() as f32;
        (self.cell.is_closed() && self.cell.reach() * share.sqrt() <= believed, limit2.sqrt())
    }

    /// Whether more than a quarter of the neighbours of `slot` are on no surface with it, or they are on no plane.
    fn is_scattered(&mut self, slot: usize) -> bool {
        let near = self.search.nearest(slot, self.degree, self.oriented[slot].farthest2()).0.to_vec();
        self.build(slot, &near, Among::Side);
        let is_rough = is_rough(self.points, (slot, self.oriented[slot].normal), &near);
        is_rough || 4 * self.taking_part < 3 * near.len()
    }

    /// Builds the cell of `slot`, among other neighbours when those of its row on its side don't close it.
    fn best_cell(&mut self, slot: usize, near: &[u32]) -> Found {
        let (is_closed, unit) = self.build(slot, near, Among::Side);
        let found = Found { is_closed, unit, among: Among::Side, is_scattered: 4 * self.on_surface < 3 * near.len() };
        if is_closed || self.points.len() <= near.len() + 1 {
            return found;
        }
        if self.build(slot, near, Among::Around).0 {
            return Found { is_closed: true, among: Among::Around, ..found };
        }
        let wide = self.wide(slot, unit);
        let (is_closed, wide_unit) = self.build(slot, &wide, Among::Wide);
        if is_closed {
            return Found { is_closed, unit: wide_unit, among: Among::Wide, ..found };
        }
        // At a border the wider view only adds slivers along it.
        self.build(slot, near, Among::Side);
        found
    }

    /// More neighbours than a row has, the farthest of which is this far.
    fn wide(&mut self, slot: usize, farthest: f32) -> WideRow {
        let (found, _) = self.search.nearest(slot, WIDE, wider(farthest * farthest, self.degree));
        let mut wide = WideRow { slots: [0; WIDE], len: found.len() };
        wide.slots[..found.len()].copy_from_slice(found);
        wide
    }

    fn summary(&mut self, slot: usize, near: &[u32]) -> Summary {
        let Some(last) = near.last() else { return Summary::default() };
        let distance = |count: usize| {
            let other = near.get(count - 1).unwrap_or(last);
            distance2(self.points.at(*other as usize), self.points.at(slot)).sqrt()
        };
        let (spacing, fourth) = (distance(RING), distance(GRID));
        let Found { is_closed, unit, among, is_scattered } = self.best_cell(slot, near);
        let reach = self.cell.reach() * unit;
        if !is_closed {
            return Summary { reach, spacing, fourth, among, is_scattered, ..Summary::default() };
        }
        let (area, [xx, xy, yy]) = self.cell.moments();
        let square = unit * unit;
        let mut moments = [0.0; 6];
        if self.ellipses {
            let (u, v) = tangents(self.oriented[slot].normal);
            let at =
                |i: usize, j: usize| square * (xx * u[i] * u[j] + xy * (u[i] * v[j] + v[i] * u[j]) + yy * v[i] * v[j]);
            moments = [at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)];
        }
        Summary { area: area * square, reach, spacing, fourth, among, is_scattered, moments }
    }

    /// The size of the point at place `i` of the run.
    fn size(&mut self, i: usize) -> (Size, Option<Ellipse>) {
        let slot = self.own.start + i;
        let rows = std::mem::take(&mut self.rows);
        let near = &rows[i * self.degree..(i + 1) * self.degree];
        let size = self.size_among(slot, near);
        self.rows = rows;
        size
    }

    /// Whether the point at place `i` of the run lies in no surface with its neighbours.
    fn is_tangled(&self, i: usize) -> bool {
        let slot = self.own.start + i;
        let near = &self.rows[i * self.degree..(i + 1) * self.degree];
        is_rough(self.points, (slot, self.oriented[slot].normal), near)
            && coherence(self.points, self.oriented, slot, &near[..near.len().min(NEAREST)]) < COHERENT
    }

    fn size_among(&mut self, slot: usize, near: &[u32]) -> (Size, Option<Ellipse>) {
        let own = self.summaries[slot - self.own.start];
        let mut smooth = Smooth::default();
        let (mut wider_spaced, mut together) = (0, 1);
        for j in near {
            let Some(other) = self.measured(*j) else { continue };
            wider_spaced += usize::from(ISOLATED as f32 * other.spacing < own.spacing);
            if self.same_side(slot, *j as usize) {
                together += 1;
                smooth.add(other);
            }
        }
        // More than half of the neighbours are that much closer to each other.
        let is_isolated = self.degree >= RING && wider_spaced > (near.len() - 1) / 2;
        smooth.add(&own);
        let is_surface = SURROUNDED * smooth.len >= together;
        let Some(area) = smooth.median().filter(|_| is_surface) else {
            // Little is surrounded here: a line, a pair, a sliver, a tuft of far returns, whose few cells close by
            // chance, through gaps. The nearest neighbours' distances are all there is.
            let p = self.points.at(slot);
            let near =
                near.iter().take(2).map(|j| distance2(self.points.at(*j as usize), p)).fold(0.0, f32::max).sqrt();
            return (Size::new(DENSITY as f32 * near, near, is_isolated, true), None);
        };
        let spacing = self.known.unwrap_or(area.sqrt());
        let density = DENSITY as f32 * spacing;
        let largest = if own.area > 0.0 { LARGEST } else { LARGEST_AT_BORDER } as f32 * density;
        let least = match self.known {
            None => self.flat_reach(slot, near).clamp(LEAST as f32 * spacing, density),
            Some(_) => density,
        };
        let bounded = |reach: f32| (COVER as f32 * reach).clamp(least, largest);
        // Leaves, strays and thin edges lie in no surface, and the few cells that close there are too large.
        let is_scattered = self.known.is_none() && own.is_scattered;
        let ellipse =
            if self.ellipses && !is_scattered { self.ellipse(slot, near, own.among, &smooth.moments) } else { None };
        let ellipse = ellipse.map(|(angle, ratio, reach)| Ellipse::new(bounded(reach), angle, ratio));
        let is_open = self.known.is_none() && own.area == 0.0;
        let most = if is_open || is_scattered { DENSITY as f32 * own.fourth } else { f32::INFINITY };
        (Size::new(bounded(own.reach).min(most), spacing, is_isolated, false), ellipse)
    }

    /// How far the surface goes on along the tangent plane of a point: where it has turned by [`FLAT`] on average, as
    /// the normals of the nearest tell.
    fn flat_reach(&self, slot: usize, near: &[u32]) -> f32 {
        let (p, n) = (self.points.at(slot), self.oriented[slot].normal);
        let (mut turns, mut squares) = (0.0, 0.0);
        for j in near.iter().take(RING) {
            let cosine = n.dot(self.oriented[*j as usize].normal);
            if cosine >= TURNS_AWAY {
                turns += 2.0 * (1.0 - cosine);
                squares += distance2(self.points.at(*j as usize), p);
            }
        }
        if turns > 0.0 { FLAT * (squares / turns).sqrt() } else { f32::INFINITY }
    }

    /// Angle and axis ratio of the ellipse with these moments, where it is stretched, and how far the cell reaches
    /// once it is made round.
    fn ellipse(&mut self, slot: usize, near: &[u32], among: Among, m: &[f32; 6]) -> Option<(f64, f64, f32)> {
        let (u, v) = tangents(self.oriented[slot].normal);
        let along = |a: Vec3, b: Vec3| {
            f64::from(
                a.x * (m[0] * b.x + m[1] * b.y + m[2] * b.z)
                    + a.y * (m[1] * b.x + m[3] * b.y + m[4] * b.z)
                    + a.z * (m[2] * b.x + m[4] * b.y + m[5] * b.z),
            )
        };
        let (xx, xy, yy) = (along(u, u), along(u, v), along(v, v));
        // Of eigenvalues a ± b, the ratio is above q where b > a·(q − 1)/(q + 1).
        const LEAST: f64 = (STRETCHED * STRETCHED - 1.0) / (STRETCHED * STRETCHED + 1.0);
        let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        if half * half + xy * xy <= LEAST * LEAST * mean * mean {
            return None;
        }
        let ([large, small], direction) = symmetric2(xx, xy, yy);
        let ratio = (large / small.max(large * 1e-9)).sqrt();
        if ratio.is_nan() || ratio <= STRETCHED {
            return None;
        }
        let ratio = ratio.min(MOST_STRETCHED);
        let unit = match among {
            Among::Wide => {
                let wide = self.wide(slot, self.oriented[slot].farthest2().sqrt());
                self.build(slot, &wide, among).1
            }
            _ => self.build(slot, near, among).1,
        };
        let (direction, root) = (direction.as_vec2(), ratio.sqrt() as f32);
        let round = |c: Vec2| Vec2::new(c.dot(direction) / root, c.dot(direction.perp()) * root);
        let reach = self.cell.corners().map(|c| round(c).length_squared()).fold(0.0, f32::max).sqrt() * unit;
        Some((f64::from(direction.to_angle()), ratio, reach))
    }
}

/// Builds the cell of a slot among `near`, the farthest of which has squared distance `limit2`, and whose normals agree
/// by the cosine `least`: how many take part, and how many would if normals had no sign.
#[inline(always)]
fn build_by<S: Simd>(
    simd: S,
    (points, oriented, slot, limit2, least): (&SortedPoints, &[Oriented], usize, f32, f32),
    near: &[u32],
    offsets: &mut [[f32; MOST_IN_CELL + LANES]; 2],
    cell: &mut Cell,
) -> (usize, usize) {
    let (p, n) = (points.at(slot), oriented[slot].normal);
    let ((u, v), is_level) = (tangents(n), oriented[slot].is_level());
    let level_scale = f32x16::splat(simd, limit2.sqrt().recip());
    let (mut count, mut on_surface) = (0, 0);
    for part in near.chunks(LANES) {
        let (mut d, mut m) = ([[0.0_f32; LANES]; 3], [[0.0_f32; LANES]; 3]);
        for (i, j) in part.iter().enumerate() {
            let (q, o) = (points.at(*j as usize), oriented[*j as usize].normal);
            for k in 0..3 {
                (d[k][i], m[k][i]) = ((q[k] - p[k]) as f32, o[k]);
            }
        }
        let d = d.map(|c| f32x16::load_array(simd, c));
        let m = m.map(|c| f32x16::load_array(simd, c));
        let square = dot(d, d);
        let above = along(d, n);
        let flat = [along(d, u), along(d, v)];
        let scale = (square / ((flat[0] * flat[0] + flat[1] * flat[1]) * limit2)).sqrt();
        let is_one = numbers(simd, 0).simd_lt(u32x16::splat(simd, part.len() as u32));
        let (scale, takes_part, either_side) = if is_level {
            (level_scale, is_one, is_one)
        } else {
            let is_flat = is_one & (above * above).simd_le(square * (STEEPEST * STEEPEST));
            let agree = along(m, n);
            (scale, is_flat & agree.simd_ge(least), is_flat & agree.abs().simd_ge(AGREE))
        };
        on_surface += either_side.to_bitmask().count_ones() as usize;
        compress(flat[0] * scale, takes_part, &mut offsets[0], count);
        compress(flat[1] * scale, takes_part, &mut offsets[1], count);
        count += takes_part.to_bitmask().count_ones() as usize;
    }
    cell.build(simd, &offsets[0][..count], &offsets[1][..count]);
    (count, on_surface)
}

#[inline(always)]
fn dot<S: Simd>(a: [f32x16<S>; 3], b: [f32x16<S>; 3]) -> f32x16<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn along<S: Simd>(a: [f32x16<S>; 3], n: Vec3) -> f32x16<S> {
    a[0] * n.x + a[1] * n.y + a[2] * n.z
}

struct WideRow {
    slots: [u32; WIDE],
    len: usize,
}

impl std::ops::Deref for WideRow {
    type Target = [u32];

    fn deref(&self) -> &[u32] {
        &self.slots[..self.len]
    }
}

/// Areas and the sum of the moments of closed cells.
struct Smooth {
    areas: [f32; MOST_AREAS],
    len: usize,
    moments: [f32; 6],
}

/// Those of a cell and its neighbours, in whole steps.
const MOST_AREAS: usize = MOST_IN_CELL + LANES;

impl Default for Smooth {
    fn default() -> Self {
        Self { areas: [0.0; MOST_AREAS], len: 0, moments: [0.0; 6] }
    }
}

impl Smooth {
    #[inline]
    fn add(&mut self, cell: &Summary) {
        self.areas[self.len] = cell.area;
        self.len += usize::from(cell.area > 0.0);
        for (sum, m) in self.moments.iter_mut().zip(cell.moments) {
            *sum += m;
        }
    }

    /// The lower median of the areas: the one with as many smaller ones.
    fn median(&mut self) -> Option<f32> {
        let middle = self.len.checked_sub(1)? / 2;
        let mut ranks = [0; MOST_AREAS];
        dispatch!(Level::new(), simd => rank(simd, &mut self.areas, self.len, &mut ranks));
        self.areas.iter().zip(ranks).take(self.len).find(|(_, rank)| *rank as usize == middle).map(|(area, _)| *area)
    }
}

/// The lower median; `None` of nothing. Reorders `values`.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_few_areas_are_those_of_sorted_values() {
        let mut random = crate::mesh::random::Random::new(9);
        for count in [0, 1, 2, 17, 60] {
            let values: Vec<f32> = (0..count).map(|_| (random.unit() * 3.0 - 0.5).powi(3) as f32).collect();
            let mut smooth = Smooth::default();
            values.iter().for_each(|area| smooth.add(&Summary { area: *area, ..Summary::default() }));
            let mut sorted: Vec<f32> = values.iter().copied().filter(|v| *v > 0.0).collect();
            sorted.sort_by(f32::total_cmp);
            assert_eq!(smooth.median(), sorted.len().checked_sub(1).map(|last| sorted[last / 2]));
        }
    }

    #[test]
    fn sizes_keep_their_flags_and_ellipses_their_axes_to_a_ten_thousandth() {
        for (isolated, loose) in [(false, false), (true, false), (false, true), (true, true)] {
            let size = Size::new(2.0, 0.0, isolated, loose);
            assert_eq!(
                (size.radius(), size.spacing(), size.is_isolated(), size.is_loose()),
                (2.0, 0.0, isolated, loose)
            );
        }
        for (angle, ratio) in [(-1.5, 1.6), (0.0, 16.0), (0.3, 2.0), (1.57, 7.7)] {
            let ellipse = Ellipse::new(3.0, angle, ratio);
            // Half a turn is the same ellipse.
            let turn = ((ellipse.angle() - angle) / std::f64::consts::PI + 0.5).rem_euclid(1.0) - 0.5;
            assert!(turn.abs() < 3e-5 && (ellipse.ratio() - ratio).abs() < 3e-4, "{angle} {ratio}: {ellipse:?}");
        }
        assert_eq!(size_of::<Size>() + size_of::<Ellipse>(), 16);
    }
}
