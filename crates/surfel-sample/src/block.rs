//! Measures the neighbourhoods of a run of points: each point's Voronoi cell in its tangent plane, and the values that
//! decide its class.
//!
//! A *slot* is a point's place in the order of [`SortedPoints`], and a *grid step* is the unit of its coordinates. A
//! *run* is the range of consecutive slots that one task measures.

use crate::cell::{Cell, MAX_IN_CELL};
use crate::class::{ALONE, FLAT, Measured, needs_coherence};
use crate::eigen::{symmetric2, symmetric3};
use crate::lanes::{LANES, compress, numbers, rank};
use crate::nearest::{Search, distance2};
use crate::normals::offset;
use crate::normals::{COLLINEAR, WIDE, WIDEST, covariance, sum, wider};
use crate::orient::{NEAREST, Oriented, coherence};
use crate::size::{ANISOTROPIC_RATIO, Ellipse, MAX_AXIS_RATIO, Size};
use crate::sorted::{LEAF, SortedPoints};
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16, u32x16};
use glam::{Vec2, Vec3};
use std::ops::Range;

/// Largest distance from a point to a corner of its Voronoi cell at which the cell counts as closed, for cells bounded
/// by the nearest neighbours. The distance is relative to that of the farthest of these neighbours. At a border, where
/// points jut out by chance, cells close far outside the surface. The limit admits cells that reach halfway to the next
/// scan line.
const MAX_CLOSED_REACH: f32 = 0.75;
/// Limit like [`MAX_CLOSED_REACH`] for cells bounded by the neighbours of a wider search ([`WIDE`] or [`WIDEST`]). This
/// search reaches farther relative to the spacing.
const MAX_CLOSED_REACH_WIDE: f32 = 0.55;
/// Smallest cosine (60°) between the normals of a point and of a neighbour that may bound the point's cell. Neighbours
/// at larger angles belong to the back of a thin part, or to the far side of a crease.
pub(crate) const AGREE: f32 = 0.5;
/// Largest sine (60°) of the angle between a point's tangent plane and the direction to a neighbour that may bound the
/// point's cell. Steeper neighbours belong to another surface.
const MAX_NEIGHBOUR_SINE: f32 = 0.866;
/// Smallest cosine (120°) between the normals of a point and of a neighbour in the second attempt to build the point's
/// cell ([`NeighbourSet::Around`]). The attempt is made if neighbours within [`AGREE`] leave the cell open. The surface
/// may continue around a crease or a limb, and points beyond the crease then bound the cell. Only neighbours that face
/// away, as on the back of a thin part, are excluded.
const MIN_COSINE_AROUND: f32 = -0.5;
/// Rank, counted from 1, of the neighbour whose distance is compared between neighbours ([`Summary::spacing`]). Also
/// the number of neighbours that determine how fast the surface turns. In a plane, six points surround a point.
const RING: usize = 6;
/// Rank, counted from 1, of the neighbour whose distance limits the disk of a border or foliage point, and of a point
/// where another surface meets its own. In a square grid, four points surround a point.
const GRID: usize = 4;
/// Smallest squared distance from a point's scan line at which a neighbour belongs to another line. It is a fraction of
/// the largest squared distance from that line among the neighbours found.
const BESIDE: f32 = 0.1;

/// Measurements of one point's Voronoi cell and of its nearest neighbours; lengths are in grid steps of
/// [`SortedPoints`].
#[derive(Clone, Copy, Default)]
struct Summary {
    /// Area of the point's cell; 0 if the cell is open.
    area: f32,
    /// Distance from the point to the farthest corner of its cell; 0 if the cell has no corner.
    reach: f32,
    /// Distance of the sixth nearest neighbour ([`RING`]), or of the farthest one if there are fewer.
    spacing: f32,
    /// Distance of the fourth nearest neighbour ([`GRID`]), or of the farthest one if there are fewer.
    fourth: f32,
    /// Set of neighbours whose bisectors close the cell (bound it on all sides); [`NeighbourSet::Side`] if the cell is
    /// open.
    among: NeighbourSet,
    /// Fraction of the nearest neighbours that belong to another surface, because their direction is steep or their
    /// normal differs. Signs of normals are ignored.
    elsewhere: f32,
    /// Mean squared sine of the angle between the tangent plane and the directions to the nearest neighbours.
    roughness: f32,
    /// Second moments (xx, xy, xz, yy, yz, zz) of a closed cell about its centroid, along the object's axes.
    moments: [f32; 6],
}

/// Set of neighbours whose bisectors bound a point's cell.
#[derive(Clone, Copy, Default, PartialEq)]
enum NeighbourSet {
    /// Nearest neighbours on the point's side: their normals agree with the point's normal within [`AGREE`].
    #[default]
    Side,
    /// Nearest neighbours all around, except those whose normals face away ([`MIN_COSINE_AROUND`]).
    Around,
    /// Neighbours from a wider search ([`WIDE`]) whose normals agree with the point's normal.
    Wide,
    /// Nearest neighbours, which are collinear, and points off their line that the widest search ([`WIDEST`]) finds.
    Lines,
}

/// Result of building a point's cell from the best set of neighbours. The polygon itself is in [`Block::cell`].
struct Found {
    is_closed: bool,
    /// Length, in grid steps, of one unit of the polygon's coordinates.
    unit: f32,
    /// Set of neighbours that bounds the cell. This field and the next two are defined in [`Summary`].
    among: NeighbourSet,
    elsewhere: f32,
    roughness: f32,
}

/// Returns two unit vectors u and v perpendicular to a unit normal, with u × v along the normal. They are computed like
/// `surfel_math::basis::orthonormal`.
#[inline]
pub(crate) fn tangents(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Parameters by which the neighbourhoods of points are measured ([`Block`]); they are the same for all points of a
/// cloud.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    /// Number of nearest neighbours that are listed for each point, as its row in [`Block::rows`].
    pub(crate) degree: usize,
    /// Spacing of the points in grid steps, if the caller provides one; `None` if it is measured. With a given spacing,
    /// sparseness, roughness and creases are not tested.
    pub(crate) known: Option<f32>,
    /// Median over all points of the distance to the farthest of [`Self::degree`] neighbours, in grid steps.
    pub(crate) farthest: f32,
    /// True if ellipses are estimated in addition to radii.
    pub(crate) ellipses: bool,
}

/// Measurement of a run of consecutive slots (places of sorted points): the Voronoi cells of these points and of the
/// points around them.
pub(crate) struct Block<'a> {
    points: &'a SortedPoints,
    oriented: &'a [Oriented],
    /// Flag per slot, true if the slot's normal is set to +z because the neighbours form no plane. Empty if there are
    /// no such slots.
    level: &'a [bool],
    scale: Scale,
    search: Search<'a>,
    /// Index of the leaf for which `search` was prepared last.
    leaf: usize,
    cell: Cell,
    /// Coordinates (x, y) of the current point's neighbours in its tangent plane, in units of the farthest neighbour's
    /// distance.
    offsets: [[f32; MAX_IN_CELL + LANES]; 2],
    /// Number of neighbours in the same surface as the point whose cell was built last. Signs of normals are ignored.
    on_surface: usize,
    /// Sum, over the neighbours of the point whose cell was built last, of a squared sine. The angle is between the
    /// point's tangent plane and the direction to the neighbour.
    squared_sines: f32,
    /// Slots of the run: the points whose splat sizes are computed.
    own: Range<usize>,
    /// Slots of points outside the run that are neighbours of the run's points, in ascending order. Their cells are
    /// built too.
    halo: Vec<u32>,
    /// Rows of nearest neighbours, as slots: [`Scale::degree`] for each slot of the run, then for each slot of the
    /// halo.
    rows: Vec<u32>,
    summaries: Vec<Summary>,
    /// Cells of the run's points that needed a wider search, by ascending slot. They are cached for [`Self::ellipse`],
    /// because a second search would take longer than all other work.
    far_cells: Vec<FarCell>,
    /// Corners of all cells in [`Self::far_cells`].
    far_corners: Vec<Vec2>,
}

/// Cell bounded by the neighbours of a wider search: [`NeighbourSet::Wide`] or [`NeighbourSet::Lines`].
struct FarCell {
    slot: usize,
    /// Length, in grid steps, of one unit of the corners' coordinates.
    unit: f32,
    /// Range of the cell's corners in [`Block::far_corners`].
    corners: Range<usize>,
}

impl<'a> Block<'a> {
    pub(crate) fn new(points: &'a SortedPoints, (oriented, level): (&'a [Oriented], &'a [bool]), scale: Scale) -> Self {
        Self {
            points,
            oriented,
            level,
            scale,
            search: Search::new(points),
            leaf: usize::MAX,
            cell: Cell::default(),
            offsets: [[0.0; MAX_IN_CELL + LANES]; 2],
            on_surface: 0,
            squared_sines: 0.0,
            own: 0..0,
            halo: Vec::new(),
            rows: Vec::new(),
            summaries: Vec::new(),
            far_cells: Vec::new(),
            far_corners: Vec::new(),
        }
    }

    /// Measures the run `own` and its halo: finds the neighbours of each of their points, and builds its cell.
    pub(crate) fn measure(&mut self, own: Range<usize>) {
        self.own = own.clone();
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
            let summary = self.summary(slot, &rows[i * self.scale.degree..(i + 1) * self.scale.degree]);
            self.summaries.push(summary);
        }
        self.rows = rows;
    }

    /// Finds the nearest neighbours of the point at `slot`, and appends them to the rows.
    fn add_row(&mut self, slot: usize) {
        let leaf = slot / LEAF;
        if leaf != self.leaf {
            self.leaf = leaf;
            let of_leaf = &self.oriented[self.points.leaf(leaf)];
            self.search.expect(leaf, of_leaf.iter().map(|o| o.farthest2).fold(0.0, f32::max));
        }
        let (near, _) = self.search.nearest(slot, self.scale.degree, self.oriented[slot].farthest2);
        self.rows.extend_from_slice(near);
    }

    fn is_level(&self, slot: usize) -> bool {
        self.level.get(slot).copied().unwrap_or(false)
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

    /// Builds the cell of `slot` from those points of `near` that `among` admits. The points are first unrolled into
    /// the tangent plane: their directions are projected and their distances preserved, as if measured along the
    /// surface. For a level slot (see [`Self::level`]), distances are projected too.
    ///
    /// Returns true if the cell is closed and its corners are within the accepted distance. The second value is the
    /// unit of the cell's lengths in grid steps: the distance of the farthest point of `near`.
    fn build(&mut self, slot: usize, near: &[u32], among: NeighbourSet) -> (bool, f32) {
        let (agree, believed) = match among {
            NeighbourSet::Side => (AGREE, MAX_CLOSED_REACH),
            NeighbourSet::Around => (MIN_COSINE_AROUND, MAX_CLOSED_REACH),
            NeighbourSet::Wide | NeighbourSet::Lines => (AGREE, MAX_CLOSED_REACH_WIDE),
        };
        let Some(last) = near.last() else { return (false, 0.0) };
        let limit2 = distance2(self.points.at(*last as usize), self.points.at(slot));
        let is_level = self.is_level(slot);
        let (points, oriented, cell) = (self.points, self.oriented, &mut self.cell);
        let unrolled = (points, oriented, (slot, is_level), limit2, agree);
        let counts = dispatch!(Level::new(), simd => build_by(simd, unrolled, near, &mut self.offsets, cell));
        let (count, on_surface, squared_sines) = counts;
        (self.on_surface, self.squared_sines) = (on_surface, squared_sines);
        // If only a fraction of the neighbours is used, a search for as many neighbours in this surface would reach
        // farther, by the root of the inverse fraction. The cell's reach is compared with that distance.
        let share = count as f32 / near.len() as f32;
        (self.cell.is_closed() && self.cell.reach() * share.sqrt() <= believed, limit2.sqrt())
    }

    /// Builds the cell of `slot` from the nearest neighbours that face the same way. If the cell stays open, the other
    /// sets of [`NeighbourSet`] are tried in order.
    fn best_cell(&mut self, slot: usize, near: &[u32]) -> Found {
        let (is_closed, unit) = self.build(slot, near, NeighbourSet::Side);
        let elsewhere = 1.0 - self.on_surface as f32 / near.len() as f32;
        let roughness = self.squared_sines / near.len() as f32;
        let found = Found { is_closed, unit, among: NeighbourSet::Side, elsewhere, roughness };
        if is_closed || self.points.len() <= near.len() + 1 {
            return found;
        }
        if self.build(slot, near, NeighbourSet::Around).0 {
            return Found { is_closed: true, among: NeighbourSet::Around, ..found };
        }
        let wide = self.wide(slot, unit);
        let (is_closed, wide_unit) = self.build(slot, &wide, NeighbourSet::Wide);
        if is_closed {
            return Found { is_closed, unit: wide_unit, among: NeighbourSet::Wide, ..found };
        }
        if let Some(lines) = self.lines(slot, near) {
            let (is_closed, unit) = self.build(slot, &lines, NeighbourSet::Lines);
            if is_closed {
                return Found { is_closed, unit, among: NeighbourSet::Lines, ..found };
            }
        }
        // No set closes the cell, so the first one is restored. At a border, a wider search only adds slivers along it.
        self.build(slot, near, NeighbourSet::Side);
        found
    }

    /// Returns the [`WIDE`] nearest neighbours of a slot. `farthest` is the distance of the farthest neighbour in the
    /// slot's row.
    fn wide(&mut self, slot: usize, farthest: f32) -> WideRow {
        let (found, _) = self.search.nearest(slot, WIDE, wider(farthest * farthest, self.scale.degree));
        WideRow::of(found.iter().copied())
    }

    /// Returns the slot's row `near` and the nearest points off the row's line, found by the widest search. `None` if
    /// the row isn't collinear, or if the caller gave the spacing. Adjacent scan lines are farther away than
    /// [`Self::wide`] reaches.
    fn lines(&mut self, slot: usize, near: &[u32]) -> Option<WideRow> {
        let (values, vectors) = symmetric3(covariance(self.points, slot, near));
        if self.scale.known.is_some() || values[1] > COLLINEAR * values[2] {
            return None;
        }
        let along = vectors[2].as_vec3();
        let guess2 = self.oriented[slot].farthest2 * (WIDEST * WIDEST) as f32 / (near.len() * near.len()) as f32;
        let (found, _) = self.search.nearest(slot, WIDEST, guess2);
        let points = self.points;
        let across2 = |j: u32| offset(points, slot, j as usize).reject_from_normalized(along).length_squared();
        let least2 = BESIDE * found.iter().map(|j| across2(*j)).fold(0.0, f32::max);
        let (row, rest) = found.split_at(near.len().min(found.len()));
        Some(WideRow::of(row.iter().chain(rest.iter().filter(|j| across2(**j) > least2)).copied()))
    }

    fn summary(&mut self, slot: usize, near: &[u32]) -> Summary {
        let Some(last) = near.last() else { return Summary::default() };
        let distance = |count: usize| {
            let other = near.get(count - 1).unwrap_or(last);
            distance2(self.points.at(*other as usize), self.points.at(slot)).sqrt()
        };
        let (spacing, fourth) = (distance(RING), distance(GRID));
        let Found { is_closed, unit, among, elsewhere, roughness } = self.best_cell(slot, near);
        let reach = self.cell.reach() * unit;
        if !is_closed {
            return Summary { reach, spacing, fourth, among, elsewhere, roughness, ..Summary::default() };
        }
        let (area, [xx, xy, yy]) = self.cell.moments();
        let square = unit * unit;
        let mut moments = [0.0; 6];
        if self.scale.ellipses {
            if matches!(among, NeighbourSet::Wide | NeighbourSet::Lines) && self.own.contains(&slot) {
                let start = self.far_corners.len();
                self.far_corners.extend(self.cell.corners());
                self.far_cells.push(FarCell { slot, unit, corners: start..self.far_corners.len() });
            }
            let (u, v) = tangents(self.oriented[slot].normal);
            let at =
                |i: usize, j: usize| square * (xx * u[i] * u[j] + xy * (u[i] * v[j] + v[i] * u[j]) + yy * v[i] * v[j]);
            moments = [at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)];
        }
        Summary { area: area * square, reach, spacing, fourth, among, elsewhere, roughness, moments }
    }

    /// Returns the size of the splat for point `i` of the run, and its ellipse; `None` if the splat is a disk.
    pub(crate) fn size(&mut self, i: usize) -> (Size, Option<Ellipse>) {
        let slot = self.own.start + i;
        let rows = std::mem::take(&mut self.rows);
        let near = &rows[i * self.scale.degree..(i + 1) * self.scale.degree];
        let size = self.size_among(slot, near);
        self.rows = rows;
        size
    }

    fn size_among(&mut self, slot: usize, near: &[u32]) -> (Size, Option<Ellipse>) {
        let own = self.summaries[slot - self.own.start];
        let mut smooth = Smooth::default();
        let (mut denser, mut together) = (0, 1);
        for j in near {
            let Some(other) = self.measured(*j) else { continue };
            denser += usize::from(ALONE as f32 * other.spacing < own.spacing);
            if self.same_side(slot, *j as usize) {
                together += 1;
                smooth.add(other);
            }
        }
        smooth.add(&own);
        let p = self.points.at(slot);
        let nearest = near.iter().take(2).map(|j| distance2(self.points.at(*j as usize), p));
        let second = nearest.fold(0.0, f32::max).sqrt();
        let surrounded = Measured { together, closed: smooth.len, ..Measured::default() };
        let area = smooth.median().filter(|_| surrounded.is_surrounded());
        let spacing = area.map_or(second, |area| self.scale.known.unwrap_or(area.sqrt()));
        let is_known = self.scale.known.is_some();
        let m = Measured {
            spacing,
            second,
            fourth: if is_known { f32::INFINITY } else { own.fourth },
            // The fraction leaves out one neighbour, which may form a pair with the point.
            denser: if near.len() >= RING { denser as f32 / (near.len() - 1) as f32 } else { 0.0 },
            flat_reach: if is_known { f32::INFINITY } else { self.flat_reach(slot, near) },
            is_open: own.area == 0.0,
            is_between_lines: own.among == NeighbourSet::Lines,
            elsewhere: if is_known { 0.0 } else { own.elsewhere },
            ..self.layout(slot, near, own.roughness, surrounded)
        };
        let evidence = m.evidence();
        let class = evidence.class();
        let radius = class.radius(&m, own.reach);
        let has_ellipse = self.scale.ellipses && class.is_surface() && !m.is_cut();
        let ellipse = if has_ellipse { self.ellipse(slot, near, own.among, &smooth.moments) } else { None };
        let ellipse = ellipse.map(|(angle, ratio, reach)| Ellipse::new(class.covering(&m, reach), angle, ratio));
        (Size { radius, spacing, evidence }, ellipse)
    }

    /// Returns `measured` with sparseness, roughness and coherence filled in. If the spacing is given, if the slot's
    /// normal is level, or if there are no neighbours, only the coherence is set, to 1.
    fn layout(&self, slot: usize, near: &[u32], roughness: f32, measured: Measured) -> Measured {
        let own = self.oriented[slot];
        if self.scale.known.is_some() || self.is_level(slot) || near.is_empty() {
            return Measured { coherence: 1.0, ..measured };
        }
        let sparseness = own.farthest2.sqrt() / self.scale.farthest;
        let coherence = match needs_coherence(sparseness, roughness) {
            true => coherence(self.points, self.oriented, slot, &near[..near.len().min(NEAREST)]),
            false => 1.0,
        };
        Measured { sparseness, roughness, coherence, ..measured }
    }

    /// Returns the distance along the tangent plane, in grid steps, at which the surface has turned by [`FLAT`]. It is
    /// estimated from the normals of the nearest neighbours, and infinite if these don't turn.
    fn flat_reach(&self, slot: usize, near: &[u32]) -> f32 {
        let (p, n) = (self.points.at(slot), self.oriented[slot].normal);
        let (mut turns, mut squares) = (0.0, 0.0);
        for j in near.iter().take(RING) {
            let cosine = n.dot(self.oriented[*j as usize].normal);
            if cosine >= MIN_COSINE_AROUND {
                turns += 2.0 * (1.0 - cosine);
                squares += distance2(self.points.at(*j as usize), p);
            }
        }
        if turns > 0.0 { FLAT * (squares / turns).sqrt() } else { f32::INFINITY }
    }

    /// Returns the ellipse with the second moments `m`: the angle of its long axis in the tangent plane, in radians,
    /// its axis ratio, and its reach in grid steps. The reach is the distance of the cell's farthest corner after the
    /// affine map that makes the cell round. `None` if the ratio is at most [`ANISOTROPIC_RATIO`].
    fn ellipse(&mut self, slot: usize, near: &[u32], among: NeighbourSet, m: &[f32; 6]) -> Option<(f64, f64, f32)> {
        let (u, v) = tangents(self.oriented[slot].normal);
        let along = |a: Vec3, b: Vec3| {
            f64::from(
                a.x * (m[0] * b.x + m[1] * b.y + m[2] * b.z)
                    + a.y * (m[1] * b.x + m[3] * b.y + m[4] * b.z)
                    + a.z * (m[2] * b.x + m[4] * b.y + m[5] * b.z),
            )
        };
        let (xx, xy, yy) = (along(u, u), along(u, v), along(v, v));
        // For eigenvalues a ± b, the axis ratio exceeds √q where b > a·(q − 1)/(q + 1).
        const LEAST: f64 =
            (ANISOTROPIC_RATIO * ANISOTROPIC_RATIO - 1.0) / (ANISOTROPIC_RATIO * ANISOTROPIC_RATIO + 1.0);
        let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        if half * half + xy * xy <= LEAST * LEAST * mean * mean {
            return None;
        }
        let ([large, small], direction) = symmetric2(xx, xy, yy);
        let ratio = (large / small.max(large * 1e-9)).sqrt();
        if ratio.is_nan() || ratio <= ANISOTROPIC_RATIO {
            return None;
        }
        let ratio = ratio.min(MAX_AXIS_RATIO);
        let (direction, root) = (direction.as_vec2(), ratio.sqrt() as f32);
        let round = |c: Vec2| Vec2::new(c.dot(direction) / root, c.dot(direction.perp()) * root);
        let reach2 = |reach2: f32, c: Vec2| reach2.max(round(c).length_squared());
        let far = self.far_cells.binary_search_by_key(&slot, |cell| cell.slot).ok().map(|i| &self.far_cells[i]);
        let (reach2, unit) = match far {
            Some(FarCell { unit, corners, .. }) => {
                (self.far_corners[corners.clone()].iter().copied().fold(0.0, reach2), *unit)
            }
            None => {
                let unit = self.build(slot, near, among).1;
                (self.cell.corners().fold(0.0, reach2), unit)
            }
        };
        let reach = reach2.sqrt() * unit;
        Some((f64::from(direction.to_angle()), ratio, reach))
    }
}

/// Builds the cell of a slot from the points of `near`, and counts these neighbours. `limit2` is the squared distance
/// of the farthest point of `near`. Neighbours whose normals have a cosine below `least` with the slot's normal are
/// skipped.
///
/// Returns the number of neighbours used, and the number in the slot's surface ([`AGREE`]) regardless of the signs of
/// normals. The third result is the sum, over all of `near`, of the squared sine of the angle between the tangent plane
/// and the direction to the neighbour.
#[inline(always)]
fn build_by<S: Simd>(
    simd: S,
    (points, oriented, (slot, is_level), limit2, least): (&SortedPoints, &[Oriented], (usize, bool), f32, f32),
    near: &[u32],
    offsets: &mut [[f32; MAX_IN_CELL + LANES]; 2],
    cell: &mut Cell,
) -> (usize, usize, f32) {
    let (p, n) = (points.at(slot), oriented[slot].normal);
    let (u, v) = tangents(n);
    let level_scale = f32x16::splat(simd, limit2.sqrt().recip());
    let (mut count, mut on_surface) = (0, 0);
    let zero = f32x16::splat(simd, 0.0);
    let mut squared_sines = zero;
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
        squared_sines += is_one.select(above * above / square, zero);
        let (scale, takes_part, either_side) = if is_level {
            (level_scale, is_one, is_one)
        } else {
            let is_flat = is_one & (above * above).simd_le(square * (MAX_NEIGHBOUR_SINE * MAX_NEIGHBOUR_SINE));
            let agree = along(m, n);
            (scale, is_flat & agree.simd_ge(least), is_flat & agree.abs().simd_ge(AGREE))
        };
        on_surface += either_side.to_bitmask().count_ones() as usize;
        compress(flat[0] * scale, takes_part, &mut offsets[0], count);
        compress(flat[1] * scale, takes_part, &mut offsets[1], count);
        count += takes_part.to_bitmask().count_ones() as usize;
    }
    cell.build(simd, &offsets[0][..count], &offsets[1][..count]);
    (count, on_surface, sum(squared_sines.to_array()) as f32)
}

#[inline(always)]
fn dot<S: Simd>(a: [f32x16<S>; 3], b: [f32x16<S>; 3]) -> f32x16<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn along<S: Simd>(a: [f32x16<S>; 3], n: Vec3) -> f32x16<S> {
    a[0] * n.x + a[1] * n.y + a[2] * n.z
}

/// Slots of the neighbours found by a wider search: the first [`MAX_IN_CELL`] if there are more.
struct WideRow {
    slots: [u32; MAX_IN_CELL],
    len: usize,
}

impl WideRow {
    fn of(slots: impl Iterator<Item = u32>) -> Self {
        let mut row = Self { slots: [0; MAX_IN_CELL], len: 0 };
        for slot in slots.take(MAX_IN_CELL) {
            row.slots[row.len] = slot;
            row.len += 1;
        }
        row
    }
}

impl std::ops::Deref for WideRow {
    type Target = [u32];

    fn deref(&self) -> &[u32] {
        &self.slots[..self.len]
    }
}

/// Areas of the closed cells of a point and its neighbours, from which a smoothed area is computed, and the sum of the
/// cells' second moments.
struct Smooth {
    areas: [f32; MAX_AREAS],
    len: usize,
    moments: [f32; 6],
}

/// Capacity for the areas of a point's cell and of its neighbours' cells, with room for a whole SIMD step.
const MAX_AREAS: usize = MAX_IN_CELL + LANES;

impl Default for Smooth {
    fn default() -> Self {
        Self { areas: [0.0; MAX_AREAS], len: 0, moments: [0.0; 6] }
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

    /// Returns the lower median of the areas; `None` if no cell is closed.
    fn median(&mut self) -> Option<f32> {
        let middle = self.len.checked_sub(1)? / 2;
        let mut ranks = [0; MAX_AREAS];
        dispatch!(Level::new(), simd => rank(simd, &mut self.areas, self.len, &mut ranks));
        self.areas.iter().zip(ranks).take(self.len).find(|(_, rank)| *rank as usize == middle).map(|(area, _)| *area)
    }
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
}
