//! Estimation of the up axis from the shape of a scene.
//!
//! Each entry of [`EVIDENCE`] is a weighted function that scores an axis; negative weights count against it. An axis's
//! total is the weighted sum of its scores, minus a cost that depends on the convention of the file format. The axis
//! with the highest total wins. The entry that contributes most becomes the reported reason.
//!
//! The evidence follows Fu, Cohen-Or, Dror, Sheffer 2008, "Upright Orientation of Man-Made Objects" (ACM TOG 27:3).
//! They rate the planes on which a shape can rest by static stability, symmetry and support. Here, the candidates are
//! the six planes perpendicular to a coordinate axis. Other tilts aren't considered, since files with a wrong up axis
//! have y and z exchanged.

use crate::patches::{Patch, Patches};
use crate::samples::Samples;
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use std::fmt;
use surfel_model::Up;

/// Reason why an axis is the up axis of a scene, if the options don't state the axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum UpReason {
    /// The file states its up axis.
    Stated,
    /// The file format defines the up axis.
    Format,
    /// Two coordinates are in the range of map coordinates, so that the third is the height.
    Georeferenced,
    /// The shape rests stably on a base in this orientation and less stably upside down.
    Base,
    /// The shape spreads out horizontally, as terrain does.
    Ground,
    /// The points' own normals show a floor that faces this direction.
    Floor,
    /// The shape would topple in other orientations: it is long and tapers at both ends, or it is a plate.
    Lying,
    /// The shape is mirror-symmetric from left to right, and the up axis lies in its mirror plane.
    Mirrored,
    /// The points are those that a depth camera captures, in the coordinates of the camera.
    Camera,
    /// There is no evidence for an axis, so that the most common one is used: +y for meshes and splats, +z for points.
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
            Self::Camera => "a camera at 0,0,0 sees it so",
            Self::Convention => "nothing in the data says it, this is most common",
        })
    }
}

/// Up axis, with the reason for which it was chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Upright {
    /// Up axis of the scene.
    pub up: Up,
    /// Evidence that contributed most to the choice, or another reason for the axis.
    pub reason: UpReason,
}

/// Up axes that are common among files of a kind. An uncommon axis needs stronger evidence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum UpConvention {
    /// Meshes and splats: mostly +y, nearly as often +z.
    Meshes,
    /// Points: mostly +z, less often +y.
    Points,
    /// STL: +z, as 3D printers use it; or +y if the shape would clearly lie on its side with +z up.
    Stl,
}

impl UpConvention {
    /// Returns the convention for a file. `points` is true if it contains points, and `default` is the default up axis
    /// of its format.
    pub fn of(points: bool, default: Up) -> Self {
        match (points, default) {
            (true, _) => Self::Points,
            // STL is the only mesh format whose default is +z.
            (false, Up::PlusZ) => Self::Stl,
            (false, _) => Self::Meshes,
        }
    }

    /// Returns the cost of each axis in the order of [`Up::ALL`], which is subtracted from the axis's score. It is 0
    /// for the conventional axis.
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

/// Range of the magnitudes of map coordinates, in metres. It includes UTM, Gauss–Krüger, national grids, and Web
/// Mercator away from its origin.
const MAP: std::ops::RangeInclusive<f64> = 1e5..=3e7;
/// Largest magnitude, in metres, of a coordinate that may be the height above sea level of a georeferenced scene.
const MAX_HEIGHT: f64 = 1e4;
/// Thickness of the lowest layer, whose patches count as touching the ground. The thickness is a fraction of the
/// shape's height, but at least the second number, in units of [`Patches::scale`].
const CONTACT: (f64, f64) = (0.02, 0.004);
/// Cosine of the angle between the up axis and a patch's normal above which a patch that touches the ground is part of
/// a level base.
const LEVEL: f64 = 0.95;
/// Number of grid cells along each side of the bounds of a shape's footprint, for measuring the area of the base.
const FOOTPRINT: usize = 24;
/// Largest number of voxels per unit of length for comparing a shape with its mirror image. The unit is half of the
/// diagonal of the shape's bounds.
const VOXELS: f64 = 20.0;
/// Number of patches per voxel for which the voxel size is chosen, so that voxels on the surface aren't empty. Small
/// samples therefore get larger voxels.
const PATCHES_OF_VOXELS: f64 = 6.0;
/// Range over which [`Standing::steady`] increases from 0 to 1. The measure is the distance of the centroid from the
/// nearest edge of the support's hull, seen from above, divided by the centroid's height.
const STEADY: (f64, f64) = (0.04, 0.14);
/// Largest score that feet at the corners of the footprint add to a base.
const FEET_WEIGHT: f64 = 0.7;
/// Range over which the score of feet increases from 0 to [`FEET_WEIGHT`]. The measure is the area of the hull around
/// the feet, as a fraction of the hull of the footprint.
const CORNERS: (f64, f64) = (0.5, 0.8);
/// Fraction of the footprint that the level top of a shape on feet must exceed to count as a tabletop. Tables rest
/// stably upside down, too, which is then ignored.
const TABLE: f64 = 0.85;
/// Two limits for terrain. The first is the cosine of the largest angle (60°) between its normals and the up axis. The
/// second is the thickness below which it counts as thin, as a fraction of its smaller width.
const GROUND: (f64, f64) = (0.5, 0.35);
/// Cosine of the largest angle (30°) between the up axis and the mean normal of tilted terrain, such as a hillside.
const LEANING: f64 = 0.866;
/// Weight of terrain as evidence for an up axis. For comparison, the score of a base is at most 1.5 without feet: its
/// hull plus half of the footprint's fill.
const GROUND_WEIGHT: f64 = 0.8;
/// Weight of a floor as evidence for an up axis.
const FLOOR_WEIGHT: f64 = 1.2;
/// Range over which the evidence of a floor increases from 0 to 1. The measure is the fraction of the surface that
/// faces up near the bottom.
const FLOOR: (f64, f64) = (0.08, 0.16);
/// Cosine of the angle between the up axis and a patch's normal above which the patch may belong to a floor.
const FLOOR_COS: f64 = 0.9;
/// Smallest fraction of the surface whose stored normals must fit the positions of the points ([`Patch::is_given`]).
/// With less, stored normals are no evidence of a floor or a depth camera.
const FITTING: f64 = 0.8;
/// Height above the lowest point below which a patch may belong to a floor, as a fraction of the shape's height.
const LOW: f64 = 0.25;
/// Range over which a thin surface's evidence as terrain increases from 0 to 1. The measure is the fraction of the
/// surface that faces up within 60°.
const ABOVE: (f64, f64) = (0.5, 0.7);
/// Fraction of a thin surface that faces down from which it isn't terrain.
const BELOW: f64 = 0.05;
/// Range over which a mirror plane's evidence increases from 0 to 1. The measure is the difference between its score
/// (see [`MIRROR_SHARE`]) and that of the next best of the three planes.
const MIRROR_LEAD: (f64, f64) = (0.03, 0.15);
/// Extent across a mirror plane above which mirror symmetry is evidence, in units of [`Patches::scale`]. A thinner
/// shape always maps onto the same voxels.
const THIN: f64 = 0.33;
/// Range over which a mirror plane's evidence increases from 0 to 1. The measure is the plane's score: the fraction of
/// the surface that it maps onto the surface. The limits exclude scans, for which some plane is always slightly better
/// than the others.
const MIRROR_SHARE: (f64, f64) = (0.7, 0.85);
/// Ratio of the length to the larger width above which a shape that tapers at both ends is assumed to lie, not to
/// stand.
const LONG: f64 = 1.75;
/// Indices of the sections that form the middle of a shape, if ten equal sections divide its length.
const MIDDLE: std::ops::Range<usize> = 2..8;
/// Ratio of the cross-section of a shape's ends to that of its middle below which the shape counts as tapered. It
/// excludes posts, which may be thicker in the middle because of an arm or a lamp.
const TAPERED: f64 = 0.5;
/// Weight of a depth camera as evidence for an up axis. It exceeds that of a floor, which a depth camera may also
/// capture.
const CAMERA_WEIGHT: f64 = 1.6;
/// Largest tangents of the angles, horizontal and vertical, between a depth camera's viewing direction and the
/// directions of its points. They correspond to the widest usual field of view, 75°×65°, plus a margin.
const CAMERA_TANGENTS: [f64; 2] = [0.8, 0.7];
/// Smallest extent of a depth camera's points in its field of view, as a difference of tangents. With less, the shape
/// is so far away that any shape would be within the field of view.
const CAMERA_EXTENT: f64 = 0.1;
/// Smallest fraction of the patches that must be within a depth camera's field of view. Patches outside of it count as
/// strays.
const WITHIN_VIEW: f64 = 0.995;
/// Range over which the evidence of a depth camera from stored normals increases from 0 to 1. The measure is the
/// component of the mean normal toward the camera.
const FACING_CAMERA: (f64, f64) = (0.5, 0.7);
/// Smallest number of patches from which a depth camera is detected. Fewer patches are so far apart in direction that a
/// watertight shape seems to have only one surface per direction.
const MIN_SEEN: usize = 500;
/// Number of patches per cell for which the cell size of the grid of viewing directions is chosen.
const PATCHES_OF_DIRECTIONS: f64 = 8.0;
/// Difference in depth above which two patches in one cell of the direction grid belong to two surfaces. The unit is
/// the width of a cell at that depth.
const LAYERS_APART: f64 = 5.0;
/// Range over which the evidence of a depth camera decreases from 1 to 0. The measure is the fraction of viewing
/// directions that meet two surfaces. A few directions at each outline of a depth image do.
const LAYERED: (f64, f64) = (0.25, 0.45);
/// Score of resting ([`Standing::rest`]) below which a shape topples.
const FALLS: f64 = 0.15;
/// Score of resting ([`Standing::rest`]) that both faces of a plate must exceed for the plate to lie flat.
const LIES: f64 = 1.0;

/// A weighted criterion for or against an axis.
struct Criterion {
    reason: UpReason,
    weight: f64,
    measure: fn(&Shape, Up) -> f64,
    /// Weighted score of the chosen axis above which this criterion may be the reported reason. For a criterion that
    /// counts against axes, the number is negative. Such a criterion may be reported if another axis's score is below
    /// the number.
    decides: f64,
}

/// All criteria. The score of an axis is the sum of the measurements times their weights. If no evidence is for an
/// axis, the first criterion in this list that rules out others is the reported reason.
const EVIDENCE: [Criterion; 6] = [
    Criterion { reason: UpReason::Base, weight: 1.0, measure: Shape::base, decides: 0.25 },
    Criterion { reason: UpReason::Ground, weight: GROUND_WEIGHT, measure: Shape::ground_beyond_floor, decides: 0.25 },
    Criterion { reason: UpReason::Floor, weight: FLOOR_WEIGHT, measure: Shape::floor, decides: 0.25 },
    Criterion { reason: UpReason::Lying, weight: -0.6, measure: Shape::topples, decides: -0.2 },
    Criterion { reason: UpReason::Mirrored, weight: -0.8, measure: Shape::is_mirror_axis, decides: -0.2 },
    Criterion { reason: UpReason::Camera, weight: CAMERA_WEIGHT, measure: Shape::camera_up, decides: 0.25 },
];

impl Criterion {
    fn score(&self, shape: &Shape, up: Up) -> f64 {
        self.weight * (self.measure)(shape, up)
    }
}

/// Estimates the up axis of a scene whose files don't state it: from map coordinates of the whole scene, else from the
/// shape of one of its equal parts. The estimate is deterministic, and takes a limited time whatever the size of the
/// scene.
pub(crate) fn upright(samples: &Samples, convention: UpConvention) -> Upright {
    let nothing = Upright { up: convention.up(), reason: convention.reason() };
    let Some(all) = samples.all() else { return nothing };
    if let Some(up) = map_height(all) {
        return Upright { up, reason: UpReason::Georeferenced };
    }
    let patches = samples.one().unwrap_or(all);
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

/// Returns the positive axis along which heights are measured. The centre's coordinate along this axis is at most
/// [`MAX_HEIGHT`]. Its other two coordinates are in the range [`MAP`] and more than twice the scene's half diagonal.
/// Returns `None` if no axis fits.
fn map_height(patches: &Patches) -> Option<Up> {
    let at = patches.middle.abs();
    let is_map = |k: usize| MAP.contains(&at[k]) && patches.scale < 0.5 * at[k];
    let is_height = |k: usize| at[k] <= MAX_HEIGHT;
    [Up::PlusX, Up::PlusY, Up::PlusZ].into_iter().enumerate().find_map(|(k, up)| {
        let [u, v] = others(k);
        (is_height(k) && is_map(u) && is_map(v)).then_some(up)
    })
}

pub(crate) fn others(k: usize) -> [usize; 2] {
    [(k + 1) % 3, (k + 2) % 3]
}

/// Returns the index of the coordinate axis (0 to 2) to which an up direction is parallel.
pub(crate) fn axis_of(up: Up) -> usize {
    up.vector().abs().max_position()
}

/// Support of a shape by its lowest points, for one up axis. It shows how well the shape rests on them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Standing {
    /// Area of the convex hull of the patches that touch the ground, as a fraction of the area of the footprint's hull.
    /// The footprint is the shape as seen from above.
    hull: f64,
    /// Area of the level patches that touch the ground, as a fraction of the area of the footprint's hull.
    fill: f64,
    /// Stability, from 0 (the shape would topple) to 1 (it is stable). It grows with the distance of the centroid from
    /// the support's edge ([`STEADY`]).
    steady: f64,
}

impl Standing {
    /// Scores how well the shape rests on its lowest points, from 0 to 1.5.
    fn rest(self) -> f64 {
        self.steady * (self.hull + 0.5 * self.fill)
    }

    /// True if the shape rests on feet, tips or a rim rather than on a solid base.
    pub(crate) fn is_on_feet(self) -> bool {
        self.steady * self.hull > 0.25 && self.fill < 0.5 * self.hull
    }

    /// True if the shape rests on a solid base.
    fn is_on_base(self) -> bool {
        self.steady * self.hull > 0.15 && self.fill > 0.6 * self.hull
    }
}

/// Measurements of a shape from which the evidence is computed.
#[derive(Debug)]
struct Shape {
    /// Support of the shape for each up axis, in the order of [`Up::ALL`].
    standing: [Standing; 6],
    /// Mirror symmetry across each axis: the fraction of the surface that is mapped onto the surface when the shape is
    /// mirrored at its centroid.
    mirror: [f64; 3],
    /// Length along each axis, in units of [`Patches::scale`] (half of the diagonal of the bounds).
    extent: [f64; 3],
    /// Length along each axis like `extent`, but without the influence of a few far parts, such as wires over a street.
    breadth: [f64; 3],
    /// One flag per axis, true if the shape is thinner at both ends than in its middle along the axis.
    tapers: [bool; 3],
    /// One flag per axis, true if the shape looks like terrain whose heights are along the axis.
    ground: [bool; 3],
    /// Evidence of a floor, 0 to 1, for each up axis in the order of [`Up::ALL`]. Zero unless points have stored
    /// normals.
    floors: [f64; 6],
    /// Evidence, 0 to 1, that a depth camera captured the points: one whose up axis is −y, and one whose up axis is +y.
    /// Zero unless the file has points.
    camera: [f64; 2],
    /// Mean unit normal of the surface. A component is negative if the surface mostly faces down the axis.
    facing: DVec3,
    /// True if plates are assumed to lie flat, which holds for files of 3D printers and mills (STL). In other formats,
    /// a plate may hang on a wall.
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
            breadth: breadth(patches),
            camera: match convention {
                UpConvention::Points if is_ground(patches, 2) => [faces_camera(patches), 0.0],
                UpConvention::Points => {
                    [depth_camera(patches, 1.0).max(faces_camera(patches)), depth_camera(patches, -1.0)]
                }
                _ => [0.0; 2],
            },
            facing: patches.mean(|p| p.normal),
            plates_lie: convention == UpConvention::Stl,
        }
    }

    /// Returns the evidence of a base, 0 to 2.2: how much better the shape rests with `up` as up axis than upside down.
    /// A floor reduces it.
    fn base(&self, up: Up) -> f64 {
        let sides = [up as usize, up as usize ^ 1].map(|i| self.standing[i]);
        // Walls above a floor resemble bases, so that a floor reduces the score.
        base(sides, is_negative(up)) * (1.0 - self.floors.into_iter().fold(0.0, f64::max))
    }

    /// Returns 1 if the shape is terrain with the up axis `up`, and 0 otherwise.
    fn ground(&self, up: Up) -> f64 {
        let k = axis_of(up);
        if self.ground[k] && !is_negative(up) && self.facing[k] >= 0.0 { 1.0 } else { 0.0 }
    }

    /// Returns the evidence of terrain, 0 to 1, reduced by that of a floor, so that one surface doesn't count twice.
    fn ground_beyond_floor(&self, up: Up) -> f64 {
        (self.ground(up) - FLOOR_WEIGHT / GROUND_WEIGHT * self.floor(up)).max(0.0)
    }

    /// Returns the evidence of a floor that faces in the direction `up`, 0 to 1.
    fn floor(&self, up: Up) -> f64 {
        self.floors[up as usize]
    }

    /// Returns the evidence of a depth camera whose up direction is `up`, 0 to 1.
    fn camera_up(&self, up: Up) -> f64 {
        match up {
            Up::MinusY => self.camera[0],
            Up::PlusY => self.camera[1],
            _ => 0.0,
        }
    }

    /// Returns the evidence, 0 to 1, that `up` is perpendicular to the best mirror plane. Such an axis isn't up,
    /// because mirror planes of upright shapes contain the up axis.
    fn is_mirror_axis(&self, up: Up) -> f64 {
        self.leads(axis_of(up))
    }

    /// Returns 1 if the shape would topple with `up` as up axis, and 0 otherwise.
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
        leads(self.mirror, self.breadth, k)
    }

    /// Returns the reason to report for the up axis `up`: the strongest evidence for it. Without any, returns the first
    /// criterion that rules out other axes, or `None`.
    fn reason(&self, up: Up) -> Option<UpReason> {
        let strongest = EVIDENCE
            .iter()
            .filter(|piece| piece.decides > 0.0 && piece.score(self, up) > piece.decides)
            .max_by(|a, b| a.score(self, up).total_cmp(&b.score(self, up)));
        let against = |piece: &&Criterion| {
            piece.decides < 0.0 && Up::ALL.into_iter().any(|other| piece.score(self, other) < piece.decides)
        };
        strongest.or_else(|| EVIDENCE.iter().find(against)).map(|piece| piece.reason)
    }
}

fn is_negative(up: Up) -> bool {
    up.vector()[axis_of(up)] < 0.0
}

/// Returns how clearly the mirror plane perpendicular to axis `k` is better than the other two planes, from 0 to 1.
/// `mirror` has, for each of the three planes, the fraction of the surface that the plane maps onto the surface.
/// `extent` has the shape's lengths along the axes, in units of [`Patches::scale`].
pub(crate) fn leads(mirror: [f64; 3], extent: [f64; 3], k: usize) -> f64 {
    let [u, v] = others(k);
    let lead = mirror[k] - mirror[u].max(mirror[v]);
    let share = smoothstep(MIRROR_SHARE.0, MIRROR_SHARE.1, mirror[k]);
    if extent[k] > THIN { share * smoothstep(MIRROR_LEAD.0, MIRROR_LEAD.1, lead) } else { 0.0 }
}

/// Returns the evidence of a base, 0 to 2.2, from how the shape rests on its lower side (`here`) and upside down
/// (`opposite`). `negative` is true if the up axis points in a negative direction.
fn base([here, opposite]: [Standing; 2], negative: bool) -> f64 {
    let [positive, other] = if negative { [opposite, here] } else { [here, opposite] };
    // A table also rests stably on its top, and a bowl on its rim. Files store both upright.
    let table = positive.is_on_feet() && other.fill > TABLE;
    let vessel = positive.is_on_base() && other.is_on_feet();
    // Feet at the corners indicate the side to stand on. A chair also rests stably on its back.
    let chair = !negative && !vessel && here.is_on_feet() && !opposite.is_on_feet();
    let feet = if chair { FEET_WEIGHT * smoothstep(CORNERS.0, CORNERS.1, here.hull) } else { 0.0 };
    match (table || vessel, negative) {
        (true, true) => 0.0,
        (true, false) => here.rest() + feet,
        // A shape that rests equally well upside down, such as a box, gives no evidence.
        (false, _) => (here.rest() - opposite.rest()).max(0.0) + feet,
    }
}

/// Measures the support of a shape with the up axis `up`. The measurements are the hull of the points that touch the
/// ground, the level part of these points, and the stability of the centroid.
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

/// Scores the evidence, from 0 to 1, of a floor for each up axis of [`Up::ALL`].
///
/// A floor is a large enough part of the surface that faces up and is near the bottom. A thin surface also counts if
/// most of it faces roughly up and hardly any of it faces down. Only +y, −y and +z are considered, the up axes that
/// occur in point files, because walls resemble floors. Competing axes reduce each other's score. All scores are 0 if
/// the file has no normals, or if most of them don't fit the positions of the points.
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

/// Scores the evidence, from 0 to 1, of a depth camera at the origin that looks along the z axis. The sign `ahead`
/// gives its direction. Nearly all points are then within its field of view ([`WITHIN_VIEW`]), and nearly each
/// direction has one surface. If the camera looks along +z, y points down; along −z, as in OpenGL, y points up.
pub(crate) fn depth_camera(patches: &Patches, ahead: f64) -> f64 {
    let at = |p: &Patch| p.position * patches.scale + patches.middle;
    if patches.all.len() < MIN_SEEN {
        return 0.0;
    }
    let ray = |p: DVec3| (p.truncate() / p.z.abs(), p.z * ahead);
    let is_within = |(ray, depth): &(DVec2, f64)| *depth > 0.0 && ray.abs().cmple(DVec2::from(CAMERA_TANGENTS)).all();
    let seen: Vec<(DVec2, f64)> = patches.all.iter().map(|p| ray(at(p))).filter(is_within).collect();
    let bounds = |f: fn(DVec2, DVec2) -> DVec2| seen.iter().map(|(ray, _)| *ray).reduce(f).unwrap_or_default();
    let (lo, hi) = (bounds(DVec2::min), bounds(DVec2::max));
    let has_strays_at_most = seen.len() as f64 >= WITHIN_VIEW * patches.all.len() as f64;
    if !has_strays_at_most || (hi - lo).max_element() < CAMERA_EXTENT {
        return 0.0;
    }
    let cells = (seen.len() as f64 / PATCHES_OF_DIRECTIONS).sqrt().max(1.0);
    let width = (hi - lo).max_element() / cells;
    let mut directions = BTreeMap::<[u64; 2], Vec<f64>>::new();
    for (ray, depth) in &seen {
        directions.entry(((*ray - lo) / width).to_array().map(|c| c as u64)).or_default().push(*depth);
    }
    directions.retain(|_, depths| depths.len() > 2);
    let is_layered = |depths: &mut Vec<f64>| {
        depths.sort_unstable_by(f64::total_cmp);
        depths.windows(2).any(|pair| pair[1] - pair[0] > LAYERS_APART * width * pair[0])
    };
    let layered = directions.values_mut().map(is_layered).filter(|layered| *layered).count();
    1.0 - smoothstep(LAYERED.0, LAYERED.1, layered as f64 / directions.len() as f64)
}

/// Scores the evidence, from 0 to 1, that stored normals face −z as a whole. This holds for a depth camera that looks
/// along +z with y down, whatever the origin. Normals that face +z are no evidence, since the surface may be ground.
fn faces_camera(patches: &Patches) -> f64 {
    let given = patches.all.iter().filter(|p| p.is_given).map(|p| p.area).sum::<f64>();
    if given < FITTING * patches.area {
        return 0.0;
    }
    smoothstep(FACING_CAMERA.0, FACING_CAMERA.1, -patches.mean(|p| p.normal).z)
}

/// Returns, for each axis, the length of a box whose positions vary as much as the surface's, in units of
/// [`Patches::scale`]. If this length is more than half of the extent, returns the extent: the legs of an animal aren't
/// strays.
fn breadth(patches: &Patches) -> [f64; 3] {
    let extent = patches.extent();
    let spread = patches.mean(|p| (p.position - patches.centroid).powf(2.0)).map(|variance| (12.0 * variance).sqrt());
    DVec3::select(spread.cmplt(0.5 * extent), spread, extent).to_array()
}

/// True if the surface is like terrain: a thin height field, but not a flat drawing. Its heights are along axis `k`, or
/// along a tilted axis near `k`, as on a hillside.
fn is_ground(patches: &Patches, k: usize) -> bool {
    let axis = DVec3::AXES[k];
    // This mean normal doesn't depend on the signs of the normals, and vertical surfaces don't contribute to it.
    let leaning = patches.mean(|p| p.normal * p.normal[k]).normalize_or(axis);
    spreads_across(patches, axis) || leaning[k] > LEANING && spreads_across(patches, leaning)
}

/// True if the surface is like terrain: a thin height field, but not a flat drawing. Its heights are along the unit
/// vector `direction`.
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

/// True if the shape is thinner at both ends than in the middle along axis `k`. This holds for fish, but not for posts.
fn tapers(patches: &Patches, k: usize) -> bool {
    let [u, v] = others(k);
    let lowest = patches.all.iter().map(|p| p.position[k]).fold(f64::INFINITY, f64::min);
    let tenths = 10.0 / patches.extent()[k].max(f64::MIN_POSITIVE);
    // For each tenth of the length: sums over its patches, weighted by area, of 1, x, y, x², xy and y², with x and y
    // across axis `k`.
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

/// Mirrors the shape at its centroid across each axis. Returns, for each axis, the fraction of the surface that is
/// mapped onto the surface, to within one voxel.
pub(crate) fn mirror(patches: &Patches) -> [f64; 3] {
    // Positions are at most 1 from the centre of the bounds, and so at most 2 from the centroid.
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

/// Computes the convex hull in counter-clockwise order (Andrew 1979, monotone chain).
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

/// Returns the distance from a point inside a convex polygon to the nearest edge. The result is negative for points
/// outside.
fn distance_inside(polygon: &[DVec2], p: DVec2) -> f64 {
    let distances = edges(polygon).map(|[a, b]| (b - a).normalize_or_zero().perp_dot(p - a));
    distances.fold(f64::INFINITY, f64::min)
}
