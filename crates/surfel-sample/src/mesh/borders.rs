//! Creases and open edges of a mesh, and the lines that clip splats there.
//!
//! A splat near an edge of its smooth region is clipped to its own side by up to four lines. At a reflex corner, one
//! line removes more than the surface beyond the edge; neighbouring splats cover what is missing. The pair (u, v) has
//! coordinates in a splat's plane, in units of its half-axes.

use super::density::Density;
use super::geometry::{Border, Geometry, Kind};
use super::parts::Sample;
use crate::radii;
use crate::tree::{KdTree, Nearest};
use glam::{DVec2, DVec3};
use std::collections::HashMap;
use surfel_model::{ClipColumns, ClipLine, NO_LINE};

/// Maximum number of clip lines per splat, as in rendering model §7.
const MAX_LINES: usize = 4;
/// Maximum number of border pieces near a splat that are tested for clip lines: those nearest to its centre. An edge
/// between two faces has two pieces, one for each face.
const MAX_PIECES: usize = 48;
/// Number of pieces at one position above which each smooth region gets a spatial index of its own
/// ([`Borders::indices`]). An ordinary edge has two.
const MAX_IN_PLACE: usize = MAX_PIECES / 2;
/// Largest height of an edge over a splat's plane at which the edge clips the splat, relative to the splat's radius.
/// Edges farther away belong to another part of the surface.
pub(super) const FARTHEST: f64 = 0.5;
/// Smallest cosine (about 73°) between the normals of an edge's face and of a splat at which the edge clips the splat.
pub(super) const FACING: f64 = 0.3;
/// Largest overhang of a splat over a border, in units of the splat's half-axes, at which no clip line is added.
const SLACK: f64 = 0.02;
/// Largest distance of a splat's centre beyond a border that still clips the splat, in units of the splat's half-axes.
/// A centre is beyond a border only because the surface is curved.
const BEHIND: f64 = 0.05;
/// Distance, in units of the half-axes, by which the splats of both sides reach over their common border: many times
/// the rounding of f32.
const HAIR: f64 = 2e-5;
/// Number of corners of the polygon by which a splat's unit disk is approximated.
const RING: u32 = 24;
/// Smallest visible area of a splat if only open edges and cuts clip it, in units of the half-axes before the splat
/// grows; the whole disk has π. A splat with less grows, or its clip lines are moved outward. In parts of the surface
/// narrower than the distance between splats, few places have a splat, which must cover the area of several. Without
/// borders, the area per splat is 0.37 at the radius for its density.
const MIN_AT_OPEN_EDGES: f64 = 0.4;
/// Smallest visible area of a splat if any crease or bend clips it, in the same units as [`MIN_AT_OPEN_EDGES`].
const MIN_AT_CREASES: f64 = 1.1;
/// Largest height by which splats may stand out from a bent surface, relative to the distance between them. It is a
/// third of a pixel for a distance of two pixels.
const MAX_PROTRUSION: f64 = 0.15;
/// Distance by which splats reach over an edge where the surface continues in another part of an octree, relative to
/// their radius.
const CUT_OVERHANG: f64 = 0.2;
/// Smallest area of a face, relative to the area per splat, at which the face has splats of its own. Only then are its
/// bends borders.
const RESOLVED: f64 = 3.0;

/// Piece of a border of a face, about as long as a splat's radius. Splats reach over it by `overhang`, in object units.
#[derive(Clone, Copy, Debug)]
struct Piece {
    ends: [DVec3; 2],
    /// Flags for both ends of the piece, true if the end is also an end of the whole border.
    is_end: [bool; 2],
    face: u32,
    /// Unit normal of the piece's face.
    normal: DVec3,
    /// Unit normal of the face on the other side of the border; `None` if that face is missing or in another smooth
    /// region.
    across: Option<DVec3>,
    region: u32,
    kind: Kind,
    overhang: f64,
}

/// Borders of a surface, cut into pieces about as long as a splat's radius, in a spatial index. Pieces are longer if
/// there would be more than about four per splat.
pub(crate) struct Borders {
    pieces: Vec<Piece>,
    /// Spatial indices of the pieces. There is one for each smooth region if many regions meet at one edge, as the
    /// pages of a book do. Otherwise all regions share one index, under `None`. With a shared index, a splat at such an
    /// edge would be compared with the pieces of other regions.
    indices: HashMap<Option<u32>, PieceIndex>,
    is_crowded: bool,
    /// Half of the longest piece's length, in object units, by which the search for pieces near a splat is widened.
    half: f64,
}

/// Spatial index of some pieces: their indices in [`Borders::pieces`], and a tree of their midpoints.
struct PieceIndex {
    pieces: Vec<u32>,
    tree: KdTree,
}

/// Visible part of a clipped splat: its clip lines, and the area that they leave of the unit disk in (u, v).
#[derive(Clone, Debug)]
pub(crate) struct VisiblePart {
    lines: Vec<Line>,
    /// Area of the visible part, in units of the half-axes; the whole disk has π.
    pub(crate) area: f64,
}

/// Clip line of a splat in (u, v); points q with normal·q ≤ offset are visible.
#[derive(Clone, Copy, Debug)]
struct Line {
    normal: DVec2,
    offset: f64,
    kind: Kind,
}

/// Border piece projected into a splat's plane, in (u, v). The splat's visible part is on the left of the direction
/// from `a` to `b`.
#[derive(Clone, Copy, Debug)]
struct Segment {
    a: DVec2,
    b: DVec2,
    kind: Kind,
    /// Distance, in (u, v), by which the clip line along the piece is moved outward.
    overhang: f64,
}

impl Borders {
    /// Cuts the borders of a surface into pieces of about a splat's radius. `count` is the number of splats; the
    /// distance between them is `density` times `scale`. `regions` has an index per face, equal for faces of one smooth
    /// region. Bends are no borders if a face next to them is too small for splats of its own.
    pub(crate) fn new(
        geometry: &Geometry,
        borders: &[Border],
        regions: &[u32],
        (density, scale): (&Density, f64),
        count: usize,
    ) -> Self {
        let is_resolved = |face: u32| {
            let spacing = scale * density.of_face(face as usize);
            geometry.areas[face as usize] >= RESOLVED * spacing * spacing
        };
        let counts = |b: &&Border| b.kind != Kind::Bend || (is_resolved(b.face()) && b.across.is_some_and(is_resolved));
        let total: f64 = borders.iter().filter(counts).map(|b| b.ends[0].distance(b.ends[1])).sum();
        let most = (4 * count + borders.len()).max(1);
        let least = total / most as f64;
        let length_of = |spacing: f64| (radii::DENSITY * spacing).max(least);
        let length = length_of(scale * density.coarsest);
        let (mut pieces, mut half) = (Vec::new(), 0.0_f64);
        for border in borders.iter().filter(counts) {
            let normal_of = |face: u32| geometry.normals[face as usize];
            let (region, normal) = (regions[border.face() as usize], normal_of(border.face()));
            let across = border.across.filter(|face| regions[*face as usize] == region).map(normal_of);
            let (face, kind) = (border.face(), border.kind);
            let [a, b] = border.ends;
            let parts = (a.distance(b) / length).ceil().clamp(1.0, most as f64) as usize;
            let at = |i: usize| a.lerp(b, i as f64 / parts as f64);
            for part in 0..parts {
                let [a, b] = [at(part), at(part + 1)];
                let (is_first, is_last) = (part == 0, part + 1 == parts);
                let spacing = scale * density.at(&Sample::at(geometry, face, 0.5 * (a + b)));
                let overhang = match (kind, border.across) {
                    (Kind::Bend, Some(other)) => MAX_PROTRUSION * spacing / normal.cross(normal_of(other)).length(),
                    (Kind::Cut, _) => CUT_OVERHANG * radii::DENSITY * spacing,
                    _ => 0.0,
                };
                // The piece stays whole if the spacing is the same everywhere.
                let parts = (length / length_of(spacing)).ceil() as usize;
                let at = |i: usize| if i == parts { b } else { a.lerp(b, i as f64 / parts as f64) };
                let piece = |i: usize| {
                    let is_end = [is_first && i == 0, is_last && i + 1 == parts];
                    Piece { ends: [at(i), at(i + 1)], is_end, face, normal, across, region, kind, overhang }
                };
                pieces.extend((0..parts).map(piece));
                half = half.max(0.5 * a.distance(b) / parts as f64);
            }
        }
        let middle = |piece: &Piece| 0.5 * (piece.ends[0] + piece.ends[1]);
        let mut in_place: HashMap<[u64; 3], usize> = HashMap::new();
        for piece in &pieces {
            *in_place.entry(middle(piece).to_array().map(f64::to_bits)).or_default() += 1;
        }
        let is_crowded = in_place.into_values().any(|count| count > MAX_IN_PLACE);
        let mut of_region: HashMap<Option<u32>, Vec<u32>> = HashMap::new();
        for (i, piece) in (0..).zip(&pieces) {
            of_region.entry(is_crowded.then_some(piece.region)).or_default().push(i);
        }
        let indexed = |own: Vec<u32>| {
            let tree = KdTree::new(&own.iter().map(|i| middle(&pieces[*i as usize])).collect::<Vec<_>>());
            PieceIndex { pieces: own, tree }
        };
        let indices = of_region.into_iter().map(|(region, own)| (region, indexed(own))).collect();
        Self { pieces, indices, is_crowded, half }
    }

    /// Creates the buffer for [`Self::keep`].
    pub(crate) fn nearest() -> Nearest {
        Nearest::within(MAX_PIECES, 0.0)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Returns the pieces at which the surface ends or creases: those of open edges and creases, for both sides of each
    /// edge.
    fn ends(&self) -> impl Iterator<Item = &Piece> {
        self.pieces.iter().filter(|piece| matches!(piece.kind, Kind::Open | Kind::Crease))
    }

    /// Returns the total length of creases and open edges, in object units; edges between two faces count twice.
    pub(crate) fn length(&self) -> f64 {
        self.ends().map(|piece| piece.ends[0].distance(piece.ends[1])).sum()
    }

    /// Returns places close to creases and open edges, on both sides, with their faces. There is one place per `step`
    /// of length, and one at each end of a border whose last piece is longer than `step`. Places are moved by `inset`
    /// toward the middle of their face, and not beyond it.
    pub(crate) fn places(&self, geometry: &Geometry, step: f64, inset: f64) -> impl Iterator<Item = (u32, DVec3)> {
        let mut next = 0.5 * step;
        self.ends().flat_map(move |piece| {
            let [a, b, c] = geometry.corners(piece.face as usize);
            let middle = a + ((b - a) + (c - a)) / 3.0;
            let [from, to] = piece.ends;
            let length = from.distance(to);
            let first = next;
            let count = ((length - first) / step).ceil().max(0.0);
            next = first + count * step - length;
            let ends = [(0.0, piece.is_end[0]), (1.0, piece.is_end[1])].into_iter();
            let ends = ends.filter(move |(_, is_end)| *is_end && length > step).map(|(share, _)| share);
            (0..count as usize).map(move |i| (first + i as f64 * step) / length).chain(ends).map(move |share| {
                let on_edge = from.lerp(to, share);
                let way = middle - on_edge;
                (piece.face, on_edge + way * (inset / way.length()).min(1.0))
            })
        })
    }

    /// Returns the visible part of the splat with centre `p` on a face of `region`; `None` if no border clips it.
    /// `axes` are the half-axes (s, t), with s at least as long as t. `found` is a buffer for the search.
    pub(crate) fn keep(&self, p: DVec3, axes: (DVec3, DVec3), region: u32, found: &mut Nearest) -> Option<VisiblePart> {
        let segments = self.segments(p, axes, region, found);
        if segments.is_empty() {
            return None;
        }
        let (mut lines, mut polygon): (Vec<Line>, Vec<DVec2>) = (Vec::new(), Vec::new());
        while lines.len() < MAX_LINES {
            let overhang = |line: &Line| {
                let kept = polygon.iter().map(|q| line.normal.dot(*q)).fold(f64::NEG_INFINITY, f64::max);
                if polygon.is_empty() { 1.0 - line.offset } else { kept - line.offset }
            };
            let worth = |segment: &Segment| {
                segment.part(&lines)?;
                let line = segment.line(&segments, &lines)?;
                Some((overhang(&line), line)).filter(|(overhang, _)| *overhang > SLACK)
            };
            let mut all = segments.iter().filter_map(worth);
            // The nearest border comes first, then repeatedly the line that cuts off most.
            let best = if lines.is_empty() { all.next() } else { all.max_by(|x, y| x.0.total_cmp(&y.0)) };
            let Some((_, line)) = best else { break };
            if polygon.is_empty() {
                polygon = ring();
            }
            polygon = cut(&polygon, &line);
            lines.push(line);
        }
        (!lines.is_empty()).then(|| VisiblePart { area: area(&polygon), lines })
    }

    /// Projects the pieces of a region that may clip a splat into the splat's (u, v); returns them nearest first.
    /// Pieces far from the splat's plane ([`FARTHEST`]) or of faces turned away from it ([`FACING`]) are left out.
    fn segments(&self, p: DVec3, (s, t): (DVec3, DVec3), region: u32, found: &mut Nearest) -> Vec<Segment> {
        let Some(own) = self.indices.get(&self.is_crowded.then_some(region)) else { return Vec::new() };
        let radius = s.length();
        found.look_within(radius + self.half);
        own.tree.nearest(p, found);
        if found.items().is_empty() {
            return Vec::new();
        }
        let normal = s.cross(t).normalize_or_zero();
        let flat = |q: DVec3| {
            let d = q - p;
            DVec2::new(d.dot(s) / s.length_squared(), d.dot(t) / t.length_squared())
        };
        let near = |slot: &(f64, u32)| {
            let piece = &self.pieces[own.pieces[own.tree.index(slot.1 as usize)] as usize];
            let facing = piece.normal.dot(normal);
            // Of the two pieces of an edge inside the region, the one whose face is turned more like the splat is used.
            let is_own =
                piece.region == region && facing > FACING && piece.across.is_none_or(|n| n.dot(normal) <= facing);
            let heights = piece.ends.map(|q| (q - p).dot(normal).abs());
            if !is_own || heights.iter().all(|&height| height >= FARTHEST * radius) {
                return None;
            }
            // A crease beyond a bend is off the splat's plane. Seen obliquely, the surface reaches beyond the crease's
            // projection.
            let stand_off = if piece.kind == Kind::Crease { 0.5 * (heights[0] + heights[1]) } else { 0.0 };
            let [a, b] = piece.ends.map(flat);
            Some(Segment { a, b, kind: piece.kind, overhang: piece.overhang.max(stand_off) / radius })
        };
        let all = found.items().iter().filter_map(near);
        let is_met = |s: &Segment| s.a != s.b && s.nearest().length() + s.overhang < 1.0;
        let mut segments: Vec<Segment> = all.filter(is_met).collect();
        segments.sort_by(|x, y| x.nearest().length_squared().total_cmp(&y.nearest().length_squared()));
        segments
    }
}

impl Segment {
    /// Returns the unit vector along the segment, and the parameter of the foot of the perpendicular from the origin: 0
    /// at `a`, 1 at `b`.
    fn foot(&self) -> (DVec2, f64) {
        let along = self.b - self.a;
        (along.normalize_or_zero(), -self.a.dot(along) / along.length_squared())
    }

    fn nearest(&self) -> DVec2 {
        self.a.lerp(self.b, self.foot().1.clamp(0.0, 1.0))
    }

    /// Returns the ends of the part of the segment that is inside the unit disk and, by more than [`SLACK`], on the
    /// visible side of the lines; `None` if there is none. The margin is 0 for lines that face the segment, such as the
    /// other border of a narrow strip, which may touch it.
    fn part(&self, lines: &[Line]) -> Option<[DVec2; 2]> {
        let along = self.b - self.a;
        let (square, half) = (along.length_squared(), self.a.dot(along));
        let root = (half * half - square * (self.a.length_squared() - 1.0)).sqrt();
        // NaN means that the segment's line misses the disk.
        let (mut from, mut to) = (((-half - root) / square).max(0.0), ((-half + root) / square).min(1.0));
        if root.is_nan() {
            return None;
        }
        let outward = -self.foot().0.perp();
        for line in lines {
            // A border on the other side of a strip may be as near as it is, however narrow the strip.
            let slack = if outward.dot(line.normal) < 0.0 { 0.0 } else { SLACK };
            let (start, change) = (line.normal.dot(self.a) - line.offset + slack, line.normal.dot(along));
            if change.abs() < 1e-12 {
                if start > 0.0 {
                    return None;
                }
            } else if change > 0.0 {
                to = to.min(-start / change);
            } else {
                from = from.max(-start / change);
            }
        }
        (from < to).then(|| [self.a + along * from, self.a + along * to])
    }

    /// Returns the clip line along this segment, for a splat whose centre is the origin; `None` if the segment faces
    /// away from the centre. `all` are the segments near the splat, and `lines` its earlier clip lines.
    fn line(&self, all: &[Self], lines: &[Line]) -> Option<Line> {
        let (direction, place) = self.foot();
        let outward = -direction.perp();
        let offset = outward.dot(self.a);
        if offset < -BEHIND {
            return None;
        }
        let support = Line { normal: outward, offset: offset.max(0.0) + self.overhang, kind: self.kind };
        // The range exceeds the segment slightly, because the foot of the perpendicular may be between two pieces of a
        // curved border.
        if (-0.05..=1.05).contains(&place) {
            return Some(support);
        }
        let corner = self.nearest();
        let is_left = |other: &Self| {
            let faces_away = -(other.foot().0.perp()).dot(other.a) < -BEHIND;
            let within = |q: DVec2| outward.dot(q) <= support.offset + BEHIND;
            faces_away || other.part(lines).is_none_or(|part| part.into_iter().all(within))
        };
        if corner.length() < 1e-6 || all.iter().all(is_left) {
            return Some(support);
        }
        // At a reflex corner, the surface behind the corner belongs to other splats, so the line touches the corner.
        Some(Line { normal: corner.normalize(), offset: corner.length() + self.overhang, kind: self.kind })
    }
}

impl VisiblePart {
    /// Returns the smallest visible area, in units of the half-axes, that the splat needs. If the area is smaller,
    /// [`Self::widen`] moves the lines outward.
    pub(crate) fn least(&self) -> f64 {
        let is_open = |line: &Line| matches!(line.kind, Kind::Open | Kind::Cut);
        if self.lines.iter().all(is_open) { MIN_AT_OPEN_EDGES } else { MIN_AT_CREASES }
    }

    /// True if the clip lines leave a point in (u, v) visible.
    pub(crate) fn keeps(&self, q: DVec2) -> bool {
        self.lines.iter().all(|line| line.normal.dot(q) <= line.offset + HAIR)
    }

    /// Moves the lines outward until the visible area is at least `least`, in units of the half-axes.
    pub(crate) fn widen(&mut self, least: f64) {
        let moved = |by: f64| self.lines.iter().map(move |line| Line { offset: line.offset + by, ..*line });
        let area_of = |by: f64| area(&moved(by).fold(ring(), |polygon, line| cut(&polygon, &line)));
        if self.area >= least {
            return;
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..12 {
            let middle = 0.5 * (low + high);
            if area_of(middle) < least { low = middle } else { high = middle }
        }
        self.area = area_of(high);
        self.lines = moved(high).collect();
    }

    /// Converts the lines to the model's clip lines.
    fn clip_lines(&self) -> [ClipLine; 4] {
        let mut all = [NO_LINE; 4];
        for (out, line) in all.iter_mut().zip(&self.lines) {
            let c = (line.offset + HAIR) as f32;
            *out = ClipLine { a: -line.normal.x as f32, b: -line.normal.y as f32, c };
        }
        all
    }
}

/// Builds the clip columns of a cloud from the visible parts of its splats; `None` if no splat is clipped.
pub(crate) fn clip_columns<'a>(kept: impl Iterator<Item = Option<&'a VisiblePart>> + Clone) -> Option<ClipColumns> {
    if kept.clone().all(|kept| kept.is_none()) {
        return None;
    }
    let lines = kept.map(|kept| kept.map_or([NO_LINE; 4], VisiblePart::clip_lines)).collect();
    Some(ClipColumns { lines: Some(lines), ..ClipColumns::default() })
}

/// Returns the corners of a regular polygon that approximates the unit disk.
fn ring() -> Vec<DVec2> {
    (0..RING).map(|i| DVec2::from_angle(std::f64::consts::TAU * f64::from(i) / f64::from(RING))).collect()
}

/// Returns the part of a convex polygon on the visible side of a clip line.
fn cut(polygon: &[DVec2], line: &Line) -> Vec<DVec2> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        let (da, db) = (line.normal.dot(*a) - line.offset, line.normal.dot(b) - line.offset);
        if da <= 0.0 {
            kept.push(*a);
        }
        if (da <= 0.0) != (db <= 0.0) {
            kept.push(*a + (b - *a) * (da / (da - db)));
        }
    }
    kept
}

fn area(polygon: &[DVec2]) -> f64 {
    (0..polygon.len()).map(|i| 0.5 * polygon[i].perp_dot(polygon[(i + 1) % polygon.len()])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Column3, Mesh};

    fn surface(positions: &[DVec3], triangles: Vec<[u32; 3]>) -> Mesh {
        Mesh { positions: Column3::from_f64(positions), triangles, ..Mesh::default() }
    }

    /// Returns the visible part of a splat of radius `radius` at `p` on `face`. The density of the splats corresponds
    /// to radius 1.
    fn kept(mesh: &Mesh, p: DVec3, face: usize, radius: f64) -> Option<VisiblePart> {
        let geometry = Geometry::new(mesh);
        let smooth = geometry.smooth();
        let density = Density::even(&geometry, 1.0 / radii::DENSITY);
        let borders = Borders::new(&geometry, &smooth.borders, &smooth.regions, (&density, 1.0), 1000);
        let (u, v) = surfel_math::basis::orthonormal(geometry.normals[face]);
        borders.keep(p, (u * radius, v * radius), smooth.regions[face], &mut Borders::nearest())
    }

    fn keeps(kept: &VisiblePart, q: DVec2) -> bool {
        kept.lines.iter().all(|line| line.normal.dot(q) <= line.offset)
    }

    /// Returns a surface that covers the half-plane x < 0 near the origin.
    fn half_plane() -> Mesh {
        let positions = [[-99.0, -99.0], [0.0, -99.0], [0.0, 99.0], [-99.0, 99.0]];
        surface(&positions.map(|[x, y]| DVec3::new(x, y, 0.0)), vec![[0, 1, 2], [0, 2, 3]])
    }

    #[test]
    fn keep_ends_at_an_open_edge_and_nowhere_else() {
        for distance in [0.0, 0.3, 0.9] {
            let kept = kept(&half_plane(), DVec3::X * -distance, 0, 1.0).unwrap();
            let [line] = kept.lines[..] else { panic!("{kept:?}") };
            assert!((line.normal - DVec2::X).length() < 1e-12 && (line.offset - distance).abs() < 1e-12, "{line:?}");
        }
        assert!(kept(&half_plane(), DVec3::X * -1.1, 0, 1.0).is_none());
        // A polygon of 24 corners has an area 1.1 % less than the half disk.
        let half = kept(&half_plane(), DVec3::ZERO, 0, 1.0).unwrap().area;
        assert!((half / std::f64::consts::FRAC_PI_2 - 0.989).abs() < 1e-3, "{half}");
    }

    #[test]
    fn keep_follows_convex_corners_and_leaves_what_lies_behind_reflex_ones() {
        // An L: the square of side 20 without its upper right quarter, which begins at the origin.
        let positions = [[-10.0, -10.0], [10.0, -10.0], [10.0, 0.0], [0.0, 0.0], [0.0, 10.0], [-10.0, 10.0]];
        let mesh =
            surface(&positions.map(|[x, y]| DVec3::new(x, y, 0.0)), vec![[0, 1, 2], [0, 2, 3], [0, 3, 5], [3, 4, 5]]);
        let corner = kept(&mesh, DVec3::new(9.9, -9.8, 0.0), 0, 1.0).unwrap();
        assert_eq!(corner.lines.len(), 2);
        assert!(keeps(&corner, DVec2::new(-0.5, 0.5)) && keeps(&corner, DVec2::new(0.09, -0.19)));
        assert!(!keeps(&corner, DVec2::new(0.11, 0.0)) && !keeps(&corner, DVec2::new(0.0, -0.21)));
        // On the corner's diagonal, the origin's foot is on neither edge.
        let reflex = kept(&mesh, DVec3::new(-0.3, -0.3, 0.0), 1, 1.0).unwrap();
        assert!(keeps(&reflex, DVec2::new(0.29, 0.29)) && !keeps(&reflex, DVec2::new(0.32, 0.32)));
        let beside = kept(&mesh, DVec3::new(0.5, -0.2, 0.0), 1, 1.0).unwrap();
        assert_eq!(beside.lines.len(), 1);
        assert!(!keeps(&beside, DVec2::new(0.0, 0.21)) && keeps(&beside, DVec2::new(-0.9, 0.19)));
    }

    /// Returns a roof along y whose sides, faces 0 and 3, slope down by `degrees`. Shallow faces join their far ends,
    /// so that both sides are in one region.
    fn roof(degrees: f64) -> Mesh {
        let eave = |side: f64, y: f64| fall(side, degrees) * 50.0 + DVec3::Y * y;
        let positions = [
            DVec3::Y * -50.0,
            DVec3::Y * 50.0,
            eave(-1.0, -50.0),
            eave(-1.0, 50.0),
            eave(1.0, -50.0),
            eave(1.0, 50.0),
            DVec3::new(-20.0, 400.0, -10.0),
            DVec3::new(20.0, 400.0, -10.0),
        ];
        let mesh =
            surface(&positions, vec![[0, 1, 3], [0, 3, 2], [0, 4, 5], [0, 5, 1], [1, 6, 3], [1, 7, 6], [1, 5, 7]]);
        assert_eq!(Geometry::new(&mesh).smooth().regions, [0; 7]);
        mesh
    }

    /// Returns the downhill direction on one side of the roof.
    fn fall(side: f64, degrees: f64) -> DVec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(side * cos, 0.0, -sin)
    }

    #[test]
    fn keep_takes_the_side_that_the_splat_is_on() {
        let mesh = roof(25.0);
        for (side, face) in [(-1.0, 0), (1.0, 3)] {
            // The splat is so near to the ridge that the other side's edge is hardly behind it.
            let down = fall(side, 25.0);
            let kept = kept(&mesh, down * 1e-3, face, 1.0).unwrap();
            let (u, v) = surfel_math::basis::orthonormal(Geometry::new(&mesh).normals[face]);
            let way = DVec2::new(down.dot(u), down.dot(v));
            assert!((way.length() - 1.0).abs() < 1e-9);
            assert!(keeps(&kept, 0.9 * way) && !keeps(&kept, -0.002 * way), "{face}: {kept:?}");
        }
    }

    #[test]
    fn keep_hangs_over_bends_by_what_stands_out() {
        let on_ridge = |degrees: f64| kept(&roof(0.5 * degrees), DVec3::ZERO, 3, 1.0);
        assert!(on_ridge(14.0).is_none(), "smooth enough");
        let bent = on_ridge(30.0).unwrap();
        assert!((bent.lines[0].offset - MAX_PROTRUSION / radii::DENSITY / 0.5).abs() < 1e-9, "{bent:?}");
        assert!(on_ridge(50.0).unwrap().lines[0].offset.abs() < 1e-9);
    }

    #[test]
    fn keep_hangs_over_creases_as_far_as_they_stand_off_its_plane() {
        for degrees in [0.0_f64, 5.0, 10.0] {
            // A floor whose last unit bends down gently, and a wall below.
            let (sin, cos) = degrees.to_radians().sin_cos();
            let ends = [[-50.0, 0.0], [0.0, 0.0], [cos, -sin], [cos, -sin - 50.0]];
            let row = |y: f64| ends.map(|[x, z]| DVec3::new(x, y, z));
            let positions = [row(-50.0), row(50.0)].concat();
            let strip = |i: u32| [[i, i + 1, i + 5], [i, i + 5, i + 4]];
            let mesh = surface(&positions, (0..3).flat_map(strip).collect());
            let kept = kept(&mesh, DVec3::X * -0.2, 0, 2.0).unwrap();
            let [line] = kept.lines[..] else { panic!("{kept:?}") };
            assert!((line.offset - (0.2 + cos + sin) / 2.0).abs() < 1e-9, "{degrees}: {line:?}");
        }
    }

    #[test]
    fn widen_leaves_a_splat_its_share() {
        // A ribbon much narrower than the distance between splats.
        let positions = [[-99.0, 0.0], [99.0, 0.0], [99.0, 0.01], [-99.0, 0.01]];
        let ribbon = surface(&positions.map(|[x, y]| DVec3::new(x, y, 0.0)), vec![[0, 1, 2], [0, 2, 3]]);
        let mut kept = kept(&ribbon, DVec3::new(0.0, 0.005, 0.0), 0, 1.0).unwrap();
        assert!(kept.area < 0.021);
        let least = kept.least();
        kept.widen(least);
        assert!((kept.area - MIN_AT_OPEN_EDGES).abs() < 1e-3, "{kept:?}");
    }

    #[test]
    fn each_page_of_a_book_ends_at_the_spine() {
        let pages = 300;
        let rim = (0..pages).map(|i| DVec2::from_angle(std::f64::consts::TAU * f64::from(i) / f64::from(pages)) * 9.0);
        let positions: Vec<DVec3> =
            [DVec3::ZERO, DVec3::Z * 9.0].into_iter().chain(rim.map(|p| p.extend(4.5))).collect();
        let mesh = surface(&positions, (0..pages as u32).map(|i| [0, 1, i + 2]).collect());
        let geometry = Geometry::new(&mesh);
        let smooth = geometry.smooth();
        let density = Density::even(&geometry, 1.0 / radii::DENSITY);
        let borders = Borders::new(&geometry, &smooth.borders, &smooth.regions, (&density, 1.0), 100_000);
        // A splat is compared with the pieces of its own page alone, not with those of all pages at the spine.
        assert!(borders.indices.len() == pages as usize && borders.indices.values().all(|own| own.tree.len() < 60));
        for face in [0, 77, 150, 299] {
            let away = positions[face + 2].with_z(0.0).normalize();
            let (p, normal) = (0.3 * away + DVec3::Z * 4.5, geometry.normals[face]);
            let (u, v) = surfel_math::basis::orthonormal(normal);
            let kept = borders.keep(p, (u, v), smooth.regions[face], &mut Borders::nearest()).unwrap();
            let at = |q: DVec3| DVec2::new((q - p).dot(u), (q - p).dot(v));
            assert!(keeps(&kept, at(p)) && !keeps(&kept, at(p - 0.4 * away)), "page {face}: {kept:?}");
        }
        // Few pages share one index.
        let mesh = Mesh { triangles: (0..8).map(|i| [0, 1, i + 2]).collect(), ..mesh };
        let geometry = Geometry::new(&mesh);
        let smooth = geometry.smooth();
        let few = Borders::new(&geometry, &smooth.borders, &smooth.regions, (&density, 1.0), 1000);
        assert_eq!(few.indices.len(), 1);
    }
}
