//! Which axis is up, from the shape of what is there.
//!
//! Pieces of evidence speak for an axis or against it: each is a function, and its weight stands in [`EVIDENCE`]. The
//! axis with the highest score wins, less what convention asks of it, and the strongest piece is the reason.
//!
//! Upright things stand: Fu, Cohen-Or, Dror, Sheffer 2008, "Upright Orientation of Man-Made Objects" (ACM TOG 27:3),
//! judge the planes that a shape can stand on by static stability, symmetry and support. Here the planes are the six
//! that face a coordinate axis, since files are tilted by nothing else: y and z are mistaken for each other.

use crate::patches::{Patch, Patches};
use glam::{DVec2, DVec3};
use std::fmt;
use surfel_model::Up;

/// How the up axis of a scene without a statement was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum UpReason {
    /// The file says it.
    Stated,
    /// It is part of the file's format.
    Format,
    /// Two coordinates are those of a map.
    Georeferenced,
    /// It stands on a base, steadily, and not so on the opposite side.
    Base,
    /// It spreads out as ground does.
    Ground,
    /// By the points' own normals, what lies lowest faces this way.
    Floor,
    /// It is long and tapers at both ends, or a plate, so it lies.
    Lying,
    /// It is mirror-symmetric from left to right.
    Mirrored,
    /// Nothing speaks for an axis: meshes and splats are mostly +y, points +z.
    Convention,
}

impl fmt::Display for UpReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stated => "the file says so",
            Self::Format => "by the file's format",
            Self::Georeferenced => "by its map coordinates",
            Self::Base => "it stands on a base",
            Self::Ground => "it spreads out as ground does",
            Self::Floor => "by its normals a floor faces that way",
            Self::Lying => "otherwise it would fall over",
            Self::Mirrored => "its left and right sides are alike",
            Self::Convention => "nothing in the data says it, this is most common",
        })
    }
}

/// An up axis and how it was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Upright {
    /// The axis.
    pub up: Up,
    /// Where it is from.
    pub reason: UpReason,
}

/// Which way up files of a kind mostly are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum UpConvention {
    /// Meshes and splats: mostly +y, +z nearly as often.
    Meshes,
    /// Points: +z, +y less often.
    Points,
    /// STL: +z, as printers have it; +y where what it holds clearly lies then.
    Stl,
}

impl UpConvention {
    /// That of a file that held points or not, in a format with this default.
    pub fn of(points: bool, default: Up) -> Self {
        match (points, default) {
            (true, _) => Self::Points,
            // Of the meshes' formats it is STL that has +z.
            (false, Up::PlusZ) => Self::Stl,
            (false, _) => Self::Meshes,
        }
    }

    /// What each axis must bring to win over the convention, in the order of [`Up::ALL`].
    const fn costs(self) -> [f64; 6] {
        match self {
            Self::Meshes => [0.6, 0.9, 0.0, 0.7, 0.2, 0.7],
            Self::Points => [0.6, 0.9, 0.2, 0.7, 0.0, 0.7],
            Self::Stl => [f64::INFINITY, f64::INFINITY, 0.45, f64::INFINITY, 0.0, f64::INFINITY],
        }
    }

    const fn up(self) -> Up {
        match self {
            Self::Meshes => Up::PlusY,
            Self::Points | Self::Stl => Up::PlusZ,
        }
    }

    const fn reason(self) -> UpReason {
        match self {
            Self::Meshes | Self::Points => UpReason::Convention,
            Self::Stl => UpReason::Format,
        }
    }
}

/// Map coordinates in metres: UTM, Gauss–Krüger, national grids and Web Mercator away from its origin.
const MAP: std::ops::RangeInclusive<f64> = 1e5..=3e7;
/// Heights above the sea, and sizes of scenes that lie on a map, in metres.
const MOST_HEIGHT: f64 = 1e4;
/// Thickness of the bottom layer that touches the ground, in heights, or where it is flat in half diagonals.
const CONTACT: (f64, f64) = (0.02, 0.004);
/// Facets of a base are this level, as the cosine to the axis.
const LEVEL: f64 = 0.95;
/// Cells along each side of the footprint in which a base is filled.
const FOOTPRINT: usize = 24;
/// Cells along a half diagonal in which mirror images are compared, at most; of fewer patches, a cell holds a few.
const VOXELS: f64 = 20.0;
const PATCHES_OF_VOXELS: f64 = 6.0;
/// Slopes at which a standing shape begins to be steady and fully is: distance of the centroid from the support's rim,
/// over its height.
const STEADY: (f64, f64) = (0.04, 0.14);
/// What feet say that stand at corners, and the hull between them, of the footprint, from which they begin to and do.
const FEET_WEIGHT: f64 = 0.7;
const CORNERS: (f64, f64) = (0.5, 0.8);
/// Share of the footprint that the top of a table fills.
const TABLE: f64 = 0.85;
/// Ground faces up within 60° and is this thin, of its smaller width; and no more than half of it is quite level, as
/// drawings are.
const GROUND: (f64, f64) = (0.5, 0.35);
/// The cosine of how far ground leans at most: 30°.
const LEANING: f64 = 0.866;
/// What evidence weighs against a base, whose best is 1.5: hull and half the fill of its footprint.
const GROUND_WEIGHT: f64 = 0.8;
const FLOOR_WEIGHT: f64 = 1.2;
/// Share of the surface that is a floor, from which it begins to be one and is; the cosine up to which it leans, and
/// how high it lies, of the whole.
const FLOOR: (f64, f64) = (0.08, 0.16);
const FLOOR_COS: f64 = 0.9;
/// Share of the surface whose normals fit the layout of the points, from which they tell a floor.
const FITTING: f64 = 0.8;
const LOW: f64 = 0.25;
/// The share of something thin that faces up, from which it begins to be ground and is, and what may face down.
const ABOVE: (f64, f64) = (0.5, 0.7);
const BELOW: f64 = 0.05;
/// By how much the best mirror plane begins to be better than the next, and fully is; and the length across it below
/// which every shape is its own mirror image, as cells go.
const MIRROR_LEAD: (f64, f64) = (0.03, 0.15);
const THIN: f64 = 0.33;
/// The share that it mirrors, at which it begins to be a mirror plane and fully is: of scans, some plane is the best.
const MIRROR_SHARE: (f64, f64) = (0.7, 0.85);
/// Lengths, in the larger of the two widths, from which what tapers at both ends lies.
const LONG: f64 = 1.75;
/// Tenths of a length that its middle is, and the share of its cross-section there that tapered ends have at most: the
/// ends of a post are as thick as its middle, within what an arm or a lamp adds.
const MIDDLE: std::ops::Range<usize> = 2..8;
const TAPERED: f64 = 0.5;
/// How well something rests that falls over, at most, and what lies on either face, at least.
const FALLS: f64 = 0.15;
const LIES: f64 = 1.0;

/// A piece of evidence for an axis, or against it.
struct Piece {
    reason: UpReason,
    weight: f64,
    measure: fn(&Shape, Up) -> f64,
    /// What it adds to a score, from which it is the reason of a choice: of one against, for the others.
    decides: f64,
}

/// All evidence, the strongest kind first: an axis's score is the sum of what is measured times the weights.
const EVIDENCE: [Piece; 5] = [
    Piece { reason: UpReason::Base, weight: 1.0, measure: Shape::base, decides: 0.25 },
    Piece { reason: UpReason::Ground, weight: GROUND_WEIGHT, measure: Shape::ground_beyond_floor, decides: 0.25 },
    Piece { reason: UpReason::Floor, weight: FLOOR_WEIGHT, measure: Shape::floor, decides: 0.25 },
    Piece { reason: UpReason::Lying, weight: -0.6, measure: Shape::topples, decides: -0.2 },
    Piece { reason: UpReason::Mirrored, weight: -0.8, measure: Shape::is_mirror_axis, decides: -0.2 },
];

impl Piece {
    fn score(&self, shape: &Shape, up: Up) -> f64 {
        self.weight * (self.measure)(shape, up)
    }
}

/// The up axis of a scene whose files don't say it: by the place of all of it, or the shape of what `one_of` makes of
/// it. Deterministic; time doesn't grow with the data.
pub(crate) fn upright(
    all: Option<Patches>,
    one_of: impl FnOnce(Patches) -> Patches,
    convention: UpConvention,
) -> Upright {
    let nothing = Upright { up: convention.up(), reason: convention.reason() };
    let Some(all) = all else { return nothing };
    if let Some(up) = map_height(&all) {
        return Upright { up, reason: UpReason::Georeferenced };
    }
    let patches = &one_of(all);
    let shape = Shape::of(patches, convention);
    let mut best = (f64::NEG_INFINITY, nothing.up);
    for (up, cost) in Up::ALL.into_iter().zip(convention.costs()) {
        let score = EVIDENCE.iter().map(|piece| piece.score(&shape, up)).sum::<f64>() - cost;
        if score > best.0 {
            best = (score, up);
        }
    }
    Upright { up: best.1, reason: shape.reason(best.1).unwrap_or(nothing.reason) }
}

/// The axis that is height, where the two others are map coordinates.
fn map_height(patches: &Patches) -> Option<Up> {
    let at = patches.middle.abs();
    let is_map = |k: usize| MAP.contains(&at[k]) && patches.scale < 0.5 * at[k];
    let is_height = |k: usize| at[k] <= MOST_HEIGHT;
    [Up::PlusX, Up::PlusY, Up::PlusZ].into_iter().enumerate().find_map(|(k, up)| {
        let [u, v] = others(k);
        (is_height(k) && is_map(u) && is_map(v)).then_some(up)
    })
}

pub(crate) fn others(k: usize) -> [usize; 2] {
    [(k + 1) % 3, (k + 2) % 3]
}

/// The axis of an up direction, 0 to 2.
pub(crate) fn axis_of(up: Up) -> usize {
    up.vector().abs().max_position()
}

/// How a shape stands on its lowest points.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Standing {
    /// Area of the hull of what touches the ground, of the footprint's hull.
    hull: f64,
    /// Share of the footprint that is a level base.
    fill: f64,
    /// 0 where it would topple, 1 where it is steady.
    steady: f64,
}

impl Standing {
    /// How well it rests, 0 to 1.5.
    fn rest(self) -> f64 {
        self.steady * (self.hull + 0.5 * self.fill)
    }

    /// On feet, tips or a rim rather than on a base.
    pub(crate) fn is_on_feet(self) -> bool {
        self.steady * self.hull > 0.25 && self.fill < 0.5 * self.hull
    }

    /// On a base that is solid.
    fn is_on_base(self) -> bool {
        self.steady * self.hull > 0.15 && self.fill > 0.6 * self.hull
    }
}

/// What is measured of a shape.
#[derive(Debug)]
struct Shape {
    /// How it stands with each of [`Up::ALL`] up.
    standing: [Standing; 6],
    /// Shares of its surface that are their own mirror image across the centroid, axis by axis.
    mirror: [f64; 3],
    /// Lengths along the axes.
    extent: [f64; 3],
    /// Whether it is thinner at both ends than in its middle, axis by axis.
    tapers: [bool; 3],
    /// Evidence of ground, axis by axis.
    ground: [bool; 3],
    /// Evidence of a floor, with each of [`Up::ALL`] up, in points with normals of their own.
    floors: [f64; 6],
    /// Sums of the normals, axis by axis: negative where the surface faces down.
    facing: DVec3,
    /// What has two large faces was made lying, as printers and mills make it; elsewhere it may hang on a wall.
    plates_lie: bool,
}

impl Shape {
    fn of(patches: &Patches, convention: UpConvention) -> Self {
        let extent = patches.extent().to_array();
        Self {
            standing: Up::ALL.map(|up| standing(patches, up)),
            mirror: mirror(patches),
            extent,
            tapers: [0, 1, 2].map(|k| tapers(patches, k)),
            ground: [0, 1, 2].map(|k| is_ground(patches, k)),
            floors: if convention == UpConvention::Points { floors(patches) } else { [0.0; 6] },
            facing: patches.mean(|p| p.normal),
            plates_lie: convention == UpConvention::Stl,
        }
    }

    /// How much better the shape stands on this side than on the opposite one, 0 to 2.2.
    fn base(&self, up: Up) -> f64 {
        let sides = [up as usize, up as usize ^ 1].map(|i| self.standing[i]);
        // The walls above a floor look like bases.
        base(sides, is_negative(up)) * (1.0 - self.floors.into_iter().fold(0.0, f64::max))
    }

    /// 1 where the shape spreads out as ground does.
    fn ground(&self, up: Up) -> f64 {
        let k = axis_of(up);
        if self.ground[k] && !is_negative(up) && self.facing[k] >= 0.0 { 1.0 } else { 0.0 }
    }

    /// How much more the ground says than a floor that faces this way, by their weights.
    fn ground_beyond_floor(&self, up: Up) -> f64 {
        (self.ground(up) - FLOOR_WEIGHT / GROUND_WEIGHT * self.floor(up)).max(0.0)
    }

    /// Evidence of a floor that faces this way, 0 to 1.
    fn floor(&self, up: Up) -> f64 {
        self.floors[up as usize]
    }

    /// 1 across the best mirror plane, in which up lies.
    fn is_mirror_axis(&self, up: Up) -> f64 {
        self.leads(axis_of(up))
    }

    /// 1 where the shape would fall over and lies otherwise.
    fn topples(&self, up: Up) -> f64 {
        let k = axis_of(up);
        let [u, v] = others(k);
        let [here, opposite] = [up as usize, up as usize ^ 1].map(|i| self.standing[i]);
        let falls = here.rest().max(opposite.rest()) < FALLS;
        let long = self.extent[k] > LONG * self.extent[u].max(self.extent[v]) && self.tapers[k];
        let mirrored_across = self.leads(u).max(self.leads(v)) > 0.5;
        if falls && (long && mirrored_across || self.is_plate()) { 1.0 } else { 0.0 }
    }

    fn is_plate(&self) -> bool {
        let lies = |sides: &[Standing]| sides.iter().all(|side| side.rest() > LIES);
        self.plates_lie && self.standing.chunks(2).any(lies)
    }

    fn leads(&self, k: usize) -> f64 {
        leads(self.mirror, self.extent, k)
    }

    /// The strongest piece of evidence for an axis, or else the first that speaks against others.
    fn reason(&self, up: Up) -> Option<UpReason> {
        let strongest = EVIDENCE
            .iter()
            .filter(|piece| piece.decides > 0.0 && piece.score(self, up) > piece.decides)
            .max_by(|a, b| a.score(self, up).total_cmp(&b.score(self, up)));
        let against = |piece: &&Piece| {
            piece.decides < 0.0 && Up::ALL.into_iter().any(|other| piece.score(self, other) < piece.decides)
        };
        strongest.or_else(|| EVIDENCE.iter().find(against)).map(|piece| piece.reason)
    }
}

fn is_negative(up: Up) -> bool {
    up.vector()[axis_of(up)] < 0.0
}

/// 1 where the mirror plane across axis `k` is clearly better than the two others, 0 where it isn't.
pub(crate) fn leads(mirror: [f64; 3], extent: [f64; 3], k: usize) -> f64 {
    let [u, v] = others(k);
    let lead = mirror[k] - mirror[u].max(mirror[v]);
    let share = smoothstep(MIRROR_SHARE.0, MIRROR_SHARE.1, mirror[k]);
    if extent[k] > THIN { share * smoothstep(MIRROR_LEAD.0, MIRROR_LEAD.1, lead) } else { 0.0 }
}

/// What standing on one side and on the opposite one says for the former, 0 to 2.2, for an axis that is negative or
/// not.
fn base([here, opposite]: [Standing; 2], negative: bool) -> f64 {
    let [positive, other] = if negative { [opposite, here] } else { [here, opposite] };
    // A table rests well on its top, and a bowl on its rim: files hold them the right way up.
    let table = positive.is_on_feet() && other.fill > TABLE;
    let vessel = positive.is_on_base() && other.is_on_feet();
    // What stands on feet at its corners was made to; a chair lies as well on its back.
    let chair = !negative && !vessel && here.is_on_feet() && !opposite.is_on_feet();
    let feet = if chair { FEET_WEIGHT * smoothstep(CORNERS.0, CORNERS.1, here.hull) } else { 0.0 };
    match (table || vessel, negative) {
        (true, true) => 0.0,
        (true, false) => here.rest() + feet,
        // What rests as well on its head, such as a box, says nothing.
        (false, _) => (here.rest() - opposite.rest()).max(0.0) + feet,
    }
}

/// How a shape stands with this axis up: what touches the ground, how much of it is level, and whether the centroid is
/// steady over it.
pub(crate) fn standing(patches: &Patches, up: Up) -> Standing {
    let axis = up.vector();
    let [u, v] = others(axis_of(up));
    let flat = |p: DVec3| DVec2::new(p[u], p[v]);
    let heights = || patches.all.iter().map(|p| p.position.dot(axis));
    let (bottom, top) = heights().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(h), b.max(h)));
    let layer = bottom + (CONTACT.0 * (top - bottom)).max(CONTACT.1);
    let touching = || patches.all.iter().filter(|p| p.position.dot(axis) <= layer);
    let support = hull(touching().map(|p| flat(p.position)).collect());
    if support.len() < 3 {
        return Standing::default();
    }
    let height = (patches.centroid.dot(axis) - bottom).max(CONTACT.1);
    let steady = smoothstep(STEADY.0, STEADY.1, distance_inside(&support, flat(patches.centroid)) / height);
    let footprint = hull(patches.all.iter().map(|p| flat(p.position)).collect());
    let area = polygon_area(&footprint);
    if steady == 0.0 || area <= 0.0 {
        return Standing::default();
    }
    let fold = |f: fn(DVec2, DVec2) -> DVec2| footprint.iter().copied().reduce(f).unwrap_or_default();
    let (lo, hi) = (fold(DVec2::min), fold(DVec2::max));
    let cell = |p: DVec3| {
        let at = (flat(p) - lo) / (hi - lo) * FOOTPRINT as f64;
        let [x, y] = at.to_array().map(|c| (c as usize).min(FOOTPRINT - 1));
        y * FOOTPRINT + x
    };
    let count = |cells: [bool; FOOTPRINT * FOOTPRINT]| cells.into_iter().filter(|c| *c).count() as f64;
    let mut base = [false; FOOTPRINT * FOOTPRINT];
    touching().filter(|p| p.normal.dot(axis).abs() > LEVEL).for_each(|p| base[cell(p.position)] = true);
    let of_cells = (hi - lo).element_product() / (FOOTPRINT * FOOTPRINT) as f64;
    Standing { hull: polygon_area(&support) / area, fill: (count(base) * of_cells / area).min(1.0), steady }
}

fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// What speaks, 0 to 1, for a floor that faces each of [`Up::ALL`]: a good share of the surface does, low in
/// it; or it is thin, and most of it faces more or less that way, hardly any the other. Only of the axes that are up in
/// files of points, since walls look like floors, and less where another one has such evidence too. Nothing speaks
/// where the file's normals are missing, or mostly don't fit the layout of the points.
fn floors(patches: &Patches) -> [f64; 6] {
    let share =
        |is: &dyn Fn(&Patch) -> bool| patches.all.iter().filter(|p| is(p)).map(|p| p.area).sum::<f64>() / patches.area;
    if share(&|p| p.is_given) < FITTING {
        return [0.0; 6];
    }
    let extent = patches.extent();
    let of = |up: Up| {
        let (axis, k) = (up.vector(), axis_of(up));
        let [u, v] = others(k);
        let low = patches.all.iter().map(|p| p.position.dot(axis)).fold(f64::INFINITY, f64::min) + LOW * extent[k];
        let floor = share(&|p| p.normal.dot(axis) > FLOOR_COS && p.position.dot(axis) < low);
        let is_thin = extent[k] < GROUND.1 * extent[u].min(extent[v]);
        let above = share(&|p| p.normal.dot(axis) > GROUND.0);
        let below = share(&|p| p.normal.dot(axis) < -GROUND.0);
        let ground = if is_thin && below < BELOW { smoothstep(ABOVE.0, ABOVE.1, above) } else { 0.0 };
        smoothstep(FLOOR.0, FLOOR.1, floor).max(ground)
    };
    let found = Up::ALL.map(|up| if matches!(up, Up::PlusY | Up::MinusY | Up::PlusZ) { of(up) } else { 0.0 });
    let sum: f64 = found.iter().sum();
    found.map(|one| (2.0 * one - sum).max(0.0))
}

/// The surface is a thin height field over this axis, or over one that leans from it as hillsides do, and not a drawing
/// in its plane.
fn is_ground(patches: &Patches, k: usize) -> bool {
    let axis = DVec3::AXES[k];
    // Either side counts, and what stands upright says nothing.
    let leaning = patches.mean(|p| p.normal * p.normal[k]).normalize_or(axis);
    spreads_across(patches, axis) || leaning[k] > LEANING && spreads_across(patches, leaning)
}

/// Whether the surface is a thin height field in this direction, and not a drawing in its plane.
fn spreads_across(patches: &Patches, direction: DVec3) -> bool {
    let (u, v) = direction.any_orthonormal_pair();
    let extent = |d: DVec3| {
        let along = patches.all.iter().map(|p| p.position.dot(d));
        let (lo, hi) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)));
        hi - lo
    };
    let share = |least: f64| {
        let areas = patches.all.iter().filter(|p| p.normal.dot(direction).abs() > least).map(|p| p.area);
        areas.sum::<f64>() / patches.area
    };
    let is_thin = extent(direction) < GROUND.1 * extent(u).min(extent(v));
    is_thin && share(GROUND.0) > 0.85 && share(0.999) < 0.5
}

/// Thinner at both ends than in the middle along axis `k`, as fish are and posts aren't.
fn tapers(patches: &Patches, k: usize) -> bool {
    let [u, v] = others(k);
    let lowest = patches.all.iter().map(|p| p.position[k]).fold(f64::INFINITY, f64::min);
    let tenths = 10.0 / patches.extent()[k].max(f64::MIN_POSITIVE);
    // Of area, position and its products.
    let mut sums = [[0.0; 6]; 10];
    for p in &patches.all {
        let (x, y) = (p.position[u], p.position[v]);
        let tenth = (((p.position[k] - lowest) * tenths) as usize).min(9);
        sums[tenth].iter_mut().zip([1.0, x, y, x * x, x * y, y * y]).for_each(|(sum, m)| *sum += p.area * m);
    }
    let section = |[area, x, y, xx, xy, yy]: [f64; 6]| {
        let [x, y, xx, xy, yy] = [x, y, xx, xy, yy].map(|sum| sum / area.max(f64::MIN_POSITIVE));
        ((xx - x * x) * (yy - y * y) - (xy - x * y).powi(2)).max(0.0).sqrt()
    };
    let sections = sums.map(section);
    let mut middle = sections[MIDDLE].to_vec();
    middle.sort_unstable_by(f64::total_cmp);
    let middle = middle[middle.len() / 2];
    sections[0].max(sections[9]) < TAPERED * middle
}

/// Shares of the surface whose mirror image across the centroid, axis by axis, is surface too, within a cell.
pub(crate) fn mirror(patches: &Patches) -> [f64; 3] {
    // Positions are within 1 of the middle, so within 2 of the centroid.
    const SIDE: usize = 2 * (2 * VOXELS as usize + 2) + 1;
    let voxels = (patches.all.len() as f64 / PATCHES_OF_VOXELS).sqrt().min(VOXELS);
    let cell = |p: DVec3| (p * voxels).round().to_array().map(|c| (c + 2.0 * VOXELS + 2.0) as usize);
    let index = |[x, y, z]: [usize; 3]| (z * SIDE + y) * SIDE + x;
    let mut near = vec![false; SIDE * SIDE * SIDE];
    for p in &patches.all {
        let [x, y, z] = cell(p.position - patches.centroid);
        for z in z - 1..=z + 1 {
            for y in y - 1..=y + 1 {
                let middle = index([x, y, z]);
                near[middle - 1..=middle + 1].fill(true);
            }
        }
    }
    [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
        let mirrored = |p: DVec3| p - axis * (2.0 * p.dot(axis));
        let found = patches.all.iter().filter(|p| near[index(cell(mirrored(p.position - patches.centroid)))]);
        found.map(|p| p.area).sum::<f64>() / patches.area
    })
}

/// The convex hull, counter-clockwise (Andrew 1979, monotone chain).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && (b - a).perp_dot(p - b) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut chain = half(&mut points.iter().copied());
    chain.append(&mut half(&mut points.iter().rev().copied()));
    chain
}

fn edges(polygon: &[DVec2]) -> impl Iterator<Item = [DVec2; 2]> + '_ {
    polygon.iter().zip(polygon.iter().cycle().skip(1)).map(|(a, b)| [*a, *b])
}

fn polygon_area(polygon: &[DVec2]) -> f64 {
    0.5 * edges(polygon).map(|[a, b]| a.perp_dot(b)).sum::<f64>()
}

/// Distance from a point to the nearest edge of a convex polygon around it; negative outside.
fn distance_inside(polygon: &[DVec2], p: DVec2) -> f64 {
    let distances = edges(polygon).map(|[a, b]| (b - a).normalize_or_zero().perp_dot(p - a));
    distances.fold(f64::INFINITY, f64::min)
}
