//! Clipping of a triangle's splat by the ridges (creases and open edges) that its ellipse crosses. (u, v) are
//! coordinates in a splat's plane, in units of its half-axes.

use super::conic::Conic;
use super::surface::normal_of;
use crate::mesh::per_face::steiner_axes;
use glam::{DVec2, DVec3};
use std::collections::HashMap;
use std::ops::Range;
use surfel_model::{ClipCurve, ClipLine, NO_LINE};

/// Size of a splat, relative to the ellipse through its triangle's corners. It exceeds 1, so that the corners aren't on
/// the splat's rim, the edge of its ellipse.
pub(crate) const REACH: f64 = 1.1;
/// Largest size of a splat, relative to the ellipse through its triangle's corners, if a ridge bulges out of the
/// triangle.
const MAX_REACH: f64 = 1.6;
/// Number of directions tried for a line that separates the triangle from a ridge beyond it.
const DIRECTIONS: u32 = 64;
/// Distance, in units of the splat's half-axes, from the edge of its ellipse or from a clip line within which points
/// count as outside.
const SLACK: f64 = 1e-4;
/// Sizes, relative to its triangle, to which a splat is cut back if it can't be clipped otherwise; the largest possible
/// one is used. From about twice the triangle's size on, the enlarged triangle contains the whole splat ([`REACH`]).
const CUTS: [f64; 5] = [1.6, 1.4, 1.25, 1.1, 1.03];
/// Smallest size of a splat that is cut back, relative to its triangle. Neighbours overlap by this margin. A sliver
/// viewed edge-on may contain a pixel that its own filtered footprint just misses, and a neighbour must cover the
/// pixel.
const MIN_CUT: f64 = 1.01;
/// Number of directions from a splat's centre in which points of the splat that protrude from the surface are searched.
const RING: u32 = 32;
/// Distance, in units of the splat's half-axes, by which a clip line is moved away from the area to be covered, so that
/// they don't touch. It is many times the rounding of f32.
const HAIR: f64 = 2e-5;
/// Largest distance of a ridge's curve from its chord, in units of the splat's half-axes, at which a clip line replaces
/// the clip curve.
const STRAIGHT_UV: f64 = 1e-3;
/// Number of points at which a piece of a ridge is sampled.
pub(crate) const PIECE_SAMPLES: usize = 9;
/// Maximum number of pieces in a leaf of a region's spatial index.
const LEAF: usize = 4;

/// Piece of a ridge that clips the splats of the surface on one of its sides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Border {
    /// Curve of the piece, in the direction that has the clipped surface on its left, viewed from outside.
    pub conic: Conic,
    /// Index of the ridge that contains the piece.
    pub ridge: u32,
    /// Index of the smooth region that the piece bounds.
    pub region: u32,
    /// Unit normal of the triangle next to the piece, on the clipped surface's side.
    pub normal: DVec3,
    /// True if the curve is its chord, a straight segment.
    pub is_straight: bool,
    /// Distance, in object units, by which the splats of both sides overlap across the piece, because their planes
    /// don't meet exactly in the piece.
    pub overlap: f64,
}

/// Borders that clip the splats of a surface, with a spatial index for each smooth region.
pub(crate) struct Borders {
    pub all: Vec<Border>,
    regions: HashMap<u32, RegionBorders>,
}

/// Spatial index of one region's borders: a balanced binary tree of pieces. Node k has the children 2k + 1 and 2k + 2,
/// each with half of the pieces.
struct RegionBorders {
    pieces: Vec<Piece>,
    nodes: Vec<Ends>,
}

/// Part of a border in the spatial index: a straight border, or a short part of a curved one, with its chord's ends.
#[derive(Clone, Copy, Debug)]
struct Piece {
    ends: [DVec3; 2],
    /// Upper bound of the distance between this part of the border and its chord.
    margin: f64,
    border: u32,
}

impl Piece {
    /// Returns one of the six coordinates of the two ends: x, y, z of the first one, then of the second one.
    fn coordinate(&self, k: usize) -> f64 {
        self.ends[k / 3][k % 3]
    }
}

/// Bounding boxes of some pieces: one of their first ends, and one of their second ends. The convex hull of both boxes
/// contains the pieces. Separate boxes fit the spokes of a star, which meet at one end and are far apart at the other.
#[derive(Clone, Copy, Debug)]
struct Ends {
    lo: [DVec3; 2],
    hi: [DVec3; 2],
}

impl Ends {
    fn of(pieces: &[Piece]) -> Self {
        let none = Self { lo: [DVec3::INFINITY; 2], hi: [DVec3::NEG_INFINITY; 2] };
        pieces.iter().fold(none, |bounds, piece| Self {
            lo: [0, 1].map(|k| bounds.lo[k].min(piece.ends[k] - piece.margin)),
            hi: [0, 1].map(|k| bounds.hi[k].max(piece.ends[k] + piece.margin)),
        })
    }

    /// True if the hull of the boxes may meet a slab (the space between two parallel planes) centred on `p`. The slab
    /// is given by its unit normal and half of its width.
    fn may_enter(&self, p: DVec3, (axis, half): (DVec3, f64)) -> bool {
        let side = |k: usize| {
            let (middle, size) = (self.lo[k].midpoint(self.hi[k]), 0.5 * (self.hi[k] - self.lo[k]));
            ((middle - p).dot(axis), size.dot(axis.abs()))
        };
        let [(a, a_size), (b, b_size)] = [side(0), side(1)];
        (a - a_size).min(b - b_size) <= half && (a + a_size).max(b + b_size) >= -half
    }
}

impl Borders {
    pub(crate) fn new(all: Vec<Border>) -> Self {
        let mut of_region: HashMap<u32, Vec<u32>> = HashMap::new();
        (0..).zip(&all).for_each(|(i, border)| of_region.entry(border.region).or_default().push(i));
        let regions = of_region.into_iter().map(|(region, own)| (region, RegionBorders::new(&all, &own))).collect();
        Self { all, regions }
    }

    /// Returns the borders of a region, in ascending order, that may meet a box with centre `p` and half-axes
    /// `half_axes`. The box of a sliver contains far fewer borders than the ball around it.
    fn near(&self, p: DVec3, half_axes: [DVec3; 3], region: u32) -> Vec<usize> {
        let mut found = Vec::new();
        let Some(own) = self.regions.get(&region) else { return found };
        let sides = half_axes.map(|axis| (axis.normalize_or_zero(), axis.length()));
        own.in_box(p, sides, 0, 0..own.pieces.len(), &mut found);
        found.sort_unstable();
        found.dedup();
        found
    }
}

impl RegionBorders {
    fn new(all: &[Border], own: &[u32]) -> Self {
        let mut pieces = Vec::new();
        for border in own {
            let conic = &all[*border as usize].conic;
            if all[*border as usize].is_straight {
                pieces.push(Piece { ends: [conic.p1, conic.p3], margin: 0.0, border: *border });
                continue;
            }
            let line = conic.even_points(PIECE_SAMPLES);
            // Points are evenly spaced along the curve, and a piece of it bulges by less than the longest chord.
            let longest = line.windows(2).map(|w| w[0].distance(w[1])).fold(0.0, f64::max);
            pieces.extend(line.windows(2).map(|w| Piece { ends: [w[0], w[1]], margin: longest, border: *border }));
        }
        let mut nodes = Vec::new();
        divide(&mut pieces, 0, &mut nodes);
        Self { pieces, nodes }
    }

    /// Appends the borders of a node's pieces that may meet a box; `range` has the indices of these pieces.
    fn in_box(&self, p: DVec3, sides: [(DVec3, f64); 3], node: usize, range: Range<usize>, found: &mut Vec<usize>) {
        if !sides.iter().all(|side| self.nodes[node].may_enter(p, *side)) {
            return;
        }
        if range.len() <= LEAF {
            let enters = |piece: &&Piece| {
                let ends = Ends::of(std::slice::from_ref(*piece));
                sides.iter().all(|side| ends.may_enter(p, *side))
            };
            found.extend(self.pieces[range].iter().filter(enters).map(|piece| piece.border as usize));
            return;
        }
        let middle = range.start + range.len() / 2;
        self.in_box(p, sides, 2 * node + 1, range.start..middle, found);
        self.in_box(p, sides, 2 * node + 2, middle..range.end, found);
    }
}

/// Sorts pieces into a tree: halves them repeatedly along the coordinate of their ends that varies most.
fn divide(pieces: &mut [Piece], node: usize, nodes: &mut Vec<Ends>) {
    let bounds = Ends::of(pieces);
    if nodes.len() <= node {
        nodes.resize(node + 1, bounds);
    }
    nodes[node] = bounds;
    if pieces.len() <= LEAF {
        return;
    }
    let extent = |k: usize| bounds.hi[k / 3][k % 3] - bounds.lo[k / 3][k % 3];
    let widest = (1..6).fold(0, |best, k| if extent(k) > extent(best) { k } else { best });
    let middle = pieces.len() / 2;
    pieces.select_nth_unstable_by(middle, |a, b| a.coordinate(widest).total_cmp(&b.coordinate(widest)));
    let (before, after) = pieces.split_at_mut(middle);
    divide(before, 2 * node + 1, nodes);
    divide(after, 2 * node + 2, nodes);
}

/// Splat as half-axes around a centre, with its clip curve and clip lines.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ClippedSplat {
    pub center: DVec3,
    pub s: DVec3,
    pub t: DVec3,
    pub curve: Option<ClipCurve>,
    pub lines: [ClipLine; 4],
    /// True if one curve and four lines couldn't clip all that is beyond ridges or protrudes from the surface, so that
    /// the splat is cut back to about its triangle.
    pub is_cut_back: bool,
}

impl Default for ClippedSplat {
    fn default() -> Self {
        let [center, s, t] = [DVec3::ZERO; 3];
        Self { center, s, t, curve: None, lines: [NO_LINE; 4], is_cut_back: false }
    }
}

impl ClippedSplat {
    pub(crate) fn is_clipped(&self) -> bool {
        self.curve.is_some() || !self.lines[0].a.is_nan()
    }
}

struct Clipper {
    center: DVec3,
    s: DVec3,
    t: DVec3,
    curve: Option<Conic>,
    /// Coefficients a, b and c of each clip line so far: points (u, v) with a·u + b·v + c > 0 are visible.
    lines: Vec<[f64; 3]>,
    /// Edge (0 to 2) of the triangle along which the clip curve runs; `None` without a curve.
    curved_edge: Option<usize>,
    is_cut_back: bool,
}

impl Clipper {
    fn uv(&self, p: DVec3) -> DVec2 {
        let d = p - self.center;
        DVec2::new(d.dot(self.s) / self.s.length_squared(), d.dot(self.t) / self.t.length_squared())
    }

    fn flat(&self, conic: &Conic) -> Conic {
        conic.map(|p| self.uv(p).extend(0.0))
    }

    /// True if the lines and the curve so far leave a point in (u, v) visible, by more than [`SLACK`].
    fn keeps(&self, q: DVec2) -> bool {
        let by_lines = self.lines.iter().all(|[a, b, c]| a * q.x + b * q.y + c > SLACK);
        by_lines && self.curve.is_none_or(|curve| keeps_inside(&curve, q, SLACK))
    }

    /// Adds a line through `a` and `b`, in (u, v), that clips everything to the right of the direction from `a` to `b`.
    fn add_line_left_of(&mut self, a: DVec2, b: DVec2) {
        let n = (b - a).perp().normalize_or_zero();
        if n != DVec2::ZERO {
            self.lines.push([n.x, n.y, -n.dot(a)]);
        }
    }
}

/// True if a point is on the left of a curve by more than `slack`; all are in (u, v).
fn keeps_inside(curve: &Conic, q: DVec2, slack: f64) -> bool {
    // The nearest of 33 points, and the side of the tangent there, are exact enough for a decision with slack.
    let at = |i: i32| curve.at(f64::from(i) / 32.0).truncate();
    let nearest = (0..=32).min_by(|&i, &j| at(i).distance_squared(q).total_cmp(&at(j).distance_squared(q)));
    let i = nearest.unwrap_or(0);
    let tangent = at((i + 1).min(32)) - at((i - 1).max(0));
    tangent.perp_dot(q - at(i)) > slack * tangent.length()
}

/// Makes the splat of a triangle: the ellipse through its corners, slightly enlarged, and its clip.
///
/// A ridge along the triangle's own edge clips the splat exactly: by a line, or by the curve shared by both sides. The
/// curve is projected into the splat's plane and extended along its own conic to the rim. A ridge beyond the triangle
/// is excluded by a line between both, because the area beyond belongs to other splats. All clips are combined by
/// "and".
///
/// `own` are the borders along the triangle's edges, and `region` is its smooth region. `scale` is a factor for the
/// splat's size, and `margin` the distance, in object units, by which the splat must reach over the triangle's edges.
/// `outside` returns true if a point protrudes from the surface by too much for a splat of the given radius.
pub(crate) fn clip(
    corners: [DVec3; 3],
    own: [Option<usize>; 3],
    region: u32,
    borders: &Borders,
    scale: f64,
    margin: f64,
    outside: impl Fn(DVec3, f64) -> bool,
) -> ClippedSplat {
    let [a, b, c] = corners;
    let (s, t) = steiner_axes(corners);
    let center = a + ((b - a) + (c - a)) / 3.0;
    let normal = normal_of(corners);
    let mut clipper = Clipper { center, s, t, curve: None, lines: Vec::new(), curved_edge: None, is_cut_back: false };
    // The splat must contain the bulges of its own ridges.
    let own_borders = || own.iter().flatten().map(|i| &borders.all[*i]);
    let farthest = own_borders()
        .flat_map(|border| border.conic.even_points(PIECE_SAMPLES))
        .map(|p| clipper.uv(p).length())
        .fold(1.0, f64::max);
    let reach = (farthest * 1.05).clamp(REACH, MAX_REACH) * scale;
    (clipper.s, clipper.t) = (s * reach, t * reach);

    // The most curved of the triangle's own ridges becomes the curve, and the others become lines.
    let mut mine: Vec<(f64, Conic, bool, usize)> = (0..3)
        .filter_map(|k| own[k].map(|i| (k, &borders.all[i])))
        .map(|(k, border)| {
            let outward = (border.conic.p3 - border.conic.p1).cross(normal).normalize_or_zero() * border.overlap;
            let flat = clipper.flat(&border.conic.map(|p| p + outward));
            (flat.sagitta(), flat, border.is_straight, k)
        })
        .collect();
    mine.sort_by(|x, y| y.0.total_cmp(&x.0));
    for (sagitta, conic, is_straight, edge) in mine {
        let straight = is_straight || sagitta < STRAIGHT_UV;
        if !straight && clipper.curve.is_none() {
            clipper.curve = lengthened(&conic);
            if clipper.curve.is_some() {
                clipper.curved_edge = Some(edge);
                continue;
            }
        }
        // A line in place of a curve is moved outward to contain the curve: covering too much is better than a hole.
        let chord = (conic.p3 - conic.p1).truncate();
        let out = -chord.perp().normalize_or_zero();
        let bulge = (1..8).map(|i| (conic.at(f64::from(i) / 8.0) - conic.p1).truncate().dot(out)).fold(0.0, f64::max);
        let start = conic.p1.truncate() + out * bulge;
        clipper.add_line_left_of(start, start + chord);
    }

    let own_lines = clipper.lines.len();
    let triangle: Vec<DVec2> = corners.iter().map(|p| clipper.uv(*p)).collect();
    // The area to be covered: the triangle and the bulges of its own ridges.
    let bulges = own_borders().flat_map(|border| border.conic.even_points(PIECE_SAMPLES)).map(|p| clipper.uv(p));
    let kept: Vec<DVec2> = triangle.iter().copied().chain(bulges).collect();
    let radius = clipper.s.length();
    let mut beyond: Vec<(usize, Vec<DVec2>)> = Vec::new();
    let mut place_of: HashMap<u32, usize> = HashMap::new();
    for i in borders.near(center, [clipper.s, clipper.t, normal * (0.5 * radius)], region) {
        let border = &borders.all[i];
        if own.contains(&Some(i)) || border.normal.dot(normal) < 0.3 {
            continue;
        }
        let samples = border.conic.even_points(4 * PIECE_SAMPLES);
        let is_near = |p: DVec3| (p - center).dot(normal).abs() < 0.5 * radius;
        let flat: Vec<DVec2> = samples.iter().map(|p| clipper.uv(*p)).collect();
        let is_over = |k: usize| is_near(samples[k]) && flat[k].length() < 1.0 - SLACK && clipper.keeps(flat[k]);
        // Neighbouring samples count as well: a line may meet the ridge between two samples.
        let over: Vec<bool> = (0..flat.len()).map(is_over).collect();
        let counts = |k: &usize| over[*k] || (*k > 0 && over[*k - 1]) || over.get(*k + 1).is_some_and(|o| *o);
        let points: Vec<DVec2> = (0..flat.len()).filter(counts).map(|k| flat[k]).collect();
        if points.is_empty() {
            continue;
        }
        let place = *place_of.entry(border.ridge).or_insert_with(|| {
            beyond.push((i, Vec::new()));
            beyond.len() - 1
        });
        beyond[place].1.extend(points);
    }
    // Ridges that reach farthest into the disk come first, because a line for them may also exclude the next ones.
    beyond.sort_by(|x, y| nearest(&x.1).total_cmp(&nearest(&y.1)).then(x.0.cmp(&y.0)));
    let mut unwanted = Vec::new();
    for (_, points) in beyond {
        unwanted.extend_from_slice(&points);
        clipper.keep_out(&kept, &by_angle(points));
    }
    let stray = overhang(&clipper, &triangle, |p| outside(p, radius));
    // A splat that was moved out of its triangle's plane covers the step to its neighbours.
    let inradius = inradius(corners);
    let least = MIN_CUT.max(1.0 + margin / inradius.max(f64::MIN_POSITIVE));
    let covering: Vec<DVec2> = triangle.iter().map(|p| *p * least).chain(kept.iter().copied()).collect();
    clipper.keep_out(&covering, &by_angle(stray.clone()));
    if clipper.is_cut_back {
        unwanted.extend(stray);
        clipper.cut_to(&triangle, own_lines, least, &unwanted);
    }
    clipper.finish()
}

/// Returns visible points of the splat in (u, v), outside of its triangle, that protrude from the surface where the
/// surface curves away.
fn overhang(clipper: &Clipper, triangle: &[DVec2], outside: impl Fn(DVec3) -> bool) -> Vec<DVec2> {
    let is_stray = |q: &DVec2| {
        let beyond = (0..3).any(|k| (triangle[(k + 1) % 3] - triangle[k]).perp_dot(*q - triangle[k]) < -SLACK);
        beyond && clipper.keeps(*q) && outside(clipper.center + clipper.s * q.x + clipper.t * q.y)
    };
    let ring = |radius: f64| {
        (0..RING).map(move |i| DVec2::from_angle(std::f64::consts::TAU * f64::from(i) / f64::from(RING)) * radius)
    };
    let rim: Vec<DVec2> = ring(0.999).filter(is_stray).collect();
    if rim.is_empty() {
        return rim;
    }
    let inner = [0.9, 0.8, 0.7, 0.6].into_iter().flat_map(ring).filter(is_stray);
    rim.iter().copied().chain(inner).collect()
}

/// Sorts points by angle around the splat's centre, starting after the widest gap. The centre is inside the triangle.
fn by_angle(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|p, q| p.to_angle().total_cmp(&q.to_angle()));
    let gap = |i: usize| {
        let (before, own) = (points[(i + points.len() - 1) % points.len()], points[i]);
        (own.to_angle() - before.to_angle()).rem_euclid(std::f64::consts::TAU)
    };
    let first = (0..points.len()).max_by(|&i, &j| gap(i).total_cmp(&gap(j))).unwrap_or(0);
    points.rotate_left(first);
    points
}

fn inradius([a, b, c]: [DVec3; 3]) -> f64 {
    let perimeter = a.distance(b) + b.distance(c) + c.distance(a);
    if perimeter > 0.0 { (b - a).cross(c - a).length() / perimeter } else { 0.0 }
}

fn nearest(points: &[DVec2]) -> f64 {
    points.iter().map(|q| q.length_squared()).fold(f64::INFINITY, f64::min)
}

/// Returns a clip line that leaves the points `kept` visible and excludes as many of `points` as possible. If several
/// lines separate both sets, the result is the one that leaves the most of the disk visible. If no line separates them,
/// the result is the line for which the sets overlap least. The second value is the gap between the sets along the
/// line's normal, negative if they overlap.
fn between(kept: &[DVec2], points: &[DVec2]) -> ([f64; 3], f64) {
    let mut best = ([0.0, 0.0, 1.0], f64::NEG_INFINITY, f64::NEG_INFINITY);
    // All directions around, and exactly those along the edges of both sets, because the sets may touch in a corner.
    let around =
        (0..DIRECTIONS).map(|k| DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / f64::from(DIRECTIONS)));
    let sides = (0..3.min(kept.len())).map(|k| kept[(k + 1) % 3.min(kept.len())] - kept[k]);
    let chord = points[points.len() - 1] - points[0];
    let along = sides.chain([chord]).map(|d| d.perp().normalize_or_zero()).filter(|n| *n != DVec2::ZERO);
    for n in around.chain(along.flat_map(|n| [n, -n])) {
        let least = kept.iter().map(|p| n.dot(*p)).fold(f64::INFINITY, f64::min);
        let most = points.iter().map(|q| n.dot(*q)).fold(f64::NEG_INFINITY, f64::max);
        let gap = least - most;
        // Keeps n·x ≥ offset; within a gap, the line is on the points' side.
        let offset = most.min(least - HAIR);
        let score = if gap >= -SLACK { -offset } else { -10.0 + gap };
        if score > best.1 {
            best = ([n.x, n.y, -offset], score, gap);
        }
    }
    (best.0, best.2)
}

/// Extends a conic that is in (u, v), inside the unit disk, along itself, so that both ends are exactly on the rim.
/// `None` if it can't be extended that far.
fn lengthened(conic: &Conic) -> Option<Conic> {
    let start = 1.0 - to_rim(&conic.reversed())?;
    let end = to_rim(conic)?;
    let part = conic.part(start, end)?;
    // The middle control point may be anywhere, but must be finite, and its weight bounded.
    (part.p2.is_finite() && part.w < 1e3).then_some(part)
}

/// Returns the parameter beyond 1 at which a conic in (u, v) that ends inside the unit disk leaves the disk. `None` if
/// its end is outside, or if it doesn't leave the disk up to parameter 2.
fn to_rim(conic: &Conic) -> Option<f64> {
    if conic.p3.length_squared() >= 1.0 {
        return None;
    }
    let outside = |t: f64| {
        let p = conic.at(t);
        !p.is_finite() || p.length_squared() >= 1.0
    };
    // Marches by a tenth of the conic's length, at most by its own length: beyond that it no longer resembles the
    // ridge.
    let first = (1..=10).map(|i| 1.0 + 0.1 * f64::from(i)).find(|t| outside(*t))?;
    let (mut lo, mut hi) = (first - 0.1, first);
    for _ in 0..60 {
        let middle = 0.5 * (lo + hi);
        if outside(middle) { hi = middle } else { lo = middle }
    }
    Some(lo)
}

impl Clipper {
    /// Adds lines that exclude `points` (sorted by angle) and leave the points `kept` visible: one line if possible,
    /// else one line for each half of `points`. Sets `is_cut_back` if that fails.
    fn keep_out(&mut self, kept: &[DVec2], points: &[DVec2]) {
        if points.is_empty() || points.iter().all(|q| !self.keeps(*q)) {
            return;
        }
        let (line, gap) = between(kept, points);
        if gap < -SLACK && points.len() > 1 && self.lines.len() + 2 <= 4 {
            let (first, second) = points.split_at(points.len() / 2);
            self.keep_out(kept, first);
            self.keep_out(kept, second);
            return;
        }
        self.is_cut_back |= gap < -0.05 || self.lines.len() == 4;
        if self.lines.len() < 4 {
            self.lines.push(line);
        }
    }

    /// Cuts the splat back to its triangle, enlarged around the triangle's middle. The factor is the largest of
    /// [`CUTS`] that excludes `points`, but at least `least`, which leaves no gaps. The curve and the first `own` lines
    /// already are edges of the triangle.
    fn cut_to(&mut self, triangle: &[DVec2], own: usize, least: f64, points: &[DVec2]) {
        self.lines.truncate(own);
        let on_line = |[x, y, c]: &[f64; 3], p: DVec2| (x * p.x + y * p.y + c).abs() < 1e-9;
        let edges: Vec<(DVec2, DVec2)> = (0..3)
            .filter(|k| Some(*k) != self.curved_edge)
            .map(|k| (triangle[k], triangle[(k + 1) % 3]))
            .filter(|(a, b)| !self.lines.iter().any(|l| on_line(l, *a) && on_line(l, *b)))
            .collect();
        for enlarged in CUTS.into_iter().filter(|c| *c > least).chain([least]) {
            self.lines.truncate(own);
            for (a, b) in &edges {
                self.add_line_left_of(*a * enlarged, *b * enlarged);
            }
            if points.iter().all(|q| !self.keeps(*q)) {
                break;
            }
        }
    }

    fn finish(self) -> ClippedSplat {
        let curve = self.curve.map(|c| ClipCurve {
            theta1: c.p1.y.atan2(c.p1.x) as f32,
            theta3: c.p3.y.atan2(c.p3.x) as f32,
            u: c.p2.x as f32,
            v: c.p2.y as f32,
            w: c.w as f32,
        });
        let mut lines = [NO_LINE; 4];
        for (line, [a, b, c]) in lines.iter_mut().zip(&self.lines) {
            *line = ClipLine { a: *a as f32, b: *b as f32, c: *c as f32 };
        }
        ClippedSplat { center: self.center, s: self.s, t: self.t, curve, lines, is_cut_back: self.is_cut_back }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts the borders that the splats of a fan of `count` slivers are compared with. The two spokes at the fan's
    /// ends are far longer than the borders along its rim. With creases, every spoke is a border, and every sliver a
    /// region.
    fn work_of_fan(count: u32, with_creases: bool) -> usize {
        let rim = |i: u32| {
            let (sin, cos) = (6.2 * f64::from(i) / f64::from(count)).sin_cos();
            DVec3::new(cos, sin, 0.0)
        };
        let region = |i: u32| if with_creases { i } else { 0 };
        let border = |from: DVec3, to: DVec3, region: u32| Border {
            conic: Conic::straight(from, to),
            ridge: 0,
            region,
            normal: DVec3::Z,
            is_straight: true,
            overlap: 0.0,
        };
        let mut all: Vec<Border> = (0..count).map(|i| border(rim(i), rim(i + 1), region(i))).collect();
        for i in 0..count {
            if i == 0 || with_creases {
                all.push(border(DVec3::ZERO, rim(i), region(i)));
            }
            if i + 1 == count || with_creases {
                all.push(border(rim(i + 1), DVec3::ZERO, region(i)));
            }
        }
        let borders = Borders::new(all);
        let near = |i: u32| {
            let corners = [DVec3::ZERO, rim(i), rim(i + 1)];
            let ((s, t), center) = (steiner_axes(corners), corners.iter().sum::<DVec3>() / 3.0);
            let axes = [s * REACH, t * REACH, DVec3::Z * (0.5 * REACH * s.length())];
            let found = borders.near(center, axes, region(i));
            assert!(found.contains(&(i as usize)), "{i} of {count}");
            found.len()
        };
        (0..count).map(near).sum()
    }

    /// Counts the borders that the slivers of a star are compared with. All of them are in one region, and all borders
    /// are as long as the star's arms.
    fn work_of_star(count: u32) -> usize {
        let corner = |i: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(count)).sin_cos();
            DVec3::new(cos, sin, 0.0) * if i.is_multiple_of(2) { 1.0 } else { 0.1 }
        };
        let border = |i: u32| Border {
            conic: Conic::straight(corner(i), corner(i + 1)),
            ridge: 0,
            region: 0,
            normal: DVec3::Z,
            is_straight: true,
            overlap: 0.0,
        };
        let borders = Borders::new((0..count).map(border).collect());
        let near = |i: u32| {
            let corners = [DVec3::ZERO, corner(i), corner(i + 1)];
            let ((s, t), center) = (steiner_axes(corners), corners.iter().sum::<DVec3>() / 3.0);
            let axes = [s * REACH, t * REACH, DVec3::Z * (0.5 * REACH * s.length())];
            let found = borders.near(center, axes, 0);
            assert!(found.contains(&(i as usize)), "{i} of {count}");
            found.len()
        };
        (0..count).map(near).sum()
    }

    #[test]
    fn work_of_a_star_is_linear() {
        let work = [500, 1000, 2000].map(work_of_star);
        assert!(work[1] as f64 <= 2.2 * work[0] as f64 && work[2] as f64 <= 2.2 * work[1] as f64, "{work:?}");
        assert!(work[2] < 20 * 2000, "{work:?}");
    }

    #[test]
    fn work_of_a_fan_is_linear() {
        for with_creases in [false, true] {
            let work = [500, 1000, 2000].map(|count| work_of_fan(count, with_creases));
            assert!(work[1] as f64 <= 2.2 * work[0] as f64 && work[2] as f64 <= 2.2 * work[1] as f64, "{work:?}");
            assert!(work[2] < 20 * 2000, "{work:?}");
        }
    }
}
