//! Choice of the direction from which a scene's image shows the most detail.
//!
//! The candidates are views on a ring: all around the scene, at one elevation. They are compared by the weighted
//! criteria in `EVIDENCE`:
//! - Viewpoint entropy (Vázquez, Feixas, Sbert, Heidrich 2001, "Viewpoint Selection using Viewpoint Entropy") is
//!   measured over cells of equal size, direction and colour. The faces of a mesh aren't used, so that tessellation has
//!   no influence.
//! - Visible curvature follows Lee, Varshney, Jacobs 2005, "Mesh Saliency".
//! - Three-quarter views are preferred to straight ones.
//!
//! These criteria are terms of the measure that Secord, Lu, Finkelstein, Singh, Nealen 2011, "Perceptual Models of
//! Viewpoint Preference" (ACM TOG 30:5), fit to people's choices.
//!
//! A front view is preferred to a back view that shows slightly more, since shapes in files face the front by
//! convention. A scene that is open on one side is viewed through the opening.

use crate::front::front;
use crate::patches::{Patch, Patches};
use crate::samples::Samples;
use crate::up_axis::{axis_of, depth_camera, others};
use crate::view::{ChosenView, ViewAngles, ViewAxes, ViewReason};
use glam::{DVec2, DVec3};
use surfel_model::Up;

/// Side in pixels of the small images that are drawn to compare views.
const SIDE: usize = 64;
/// Largest number of patches that are drawn in one of the images that are compared. Of more, a regular sample is drawn
/// enlarged.
const DRAWN: usize = 8000;
/// Number of cells per unit of position, for counting viewpoint entropy. The unit is half of the diagonal of the
/// scene's bounds ([`Patches::scale`]).
const ENTROPY_CELLS: f64 = 3.0;
/// Number of cells per unit of position, for averaging normals to measure curvature. The unit is half of the diagonal
/// of the scene's bounds ([`Patches::scale`]).
const CURVATURE_CELLS: f64 = 18.0;
/// Azimuths, in degrees, of the ring of candidate views, in order of preference. Three-quarter views, such as
/// [`ViewAngles::ISO`], come first.
const RING: [f64; 12] = [30.0, 330.0, 60.0, 300.0, 0.0, 90.0, 270.0, 150.0, 210.0, 120.0, 240.0, 180.0];
/// Elevation, in degrees, of the ring of candidate views around shapes of usual height.
const ELEVATION_DEG: f64 = ViewAngles::ISO.elevation_deg;
/// Elevation, in degrees, of an additional candidate above the best view of the ring.
const HIGH_DEG: f64 = 40.0;
/// Elevation, in degrees, of the ring of candidate views around flat shapes ([`FLAT`]).
const FLAT_DEG: f64 = 50.0;
/// Ratio of the height to the smaller width below which a shape is flat, and viewed from [`FLAT_DEG`].
const FLAT: f64 = 0.22;
/// Elevation, in degrees, of the ring of candidate views around low shapes ([`LOW`]).
const LOW_DEG: f64 = HIGH_DEG;
/// Ratio of the height to the smaller width below which a shape is low, and viewed from [`LOW_DEG`].
const LOW: f64 = 0.4;
/// Elevation, in degrees, of the ring of candidate views around a room that is open on one side. From higher up, the
/// roof would hide more.
const ROOM_DEG: f64 = 10.0;
/// Cosine of the horizontal angle (37°) between a view and the scene's front. At smaller angles, all views count
/// equally as front views.
const FRONT_COS: f64 = 0.8;
/// Lead in score up to which a view of the ring doesn't replace one that comes earlier in the order of preference
/// ([`RING`]).
const TIE: f64 = 0.03;
/// Back-facing fraction of the surface visible in all views of the ring together, above which facing directions are
/// meaningless. Both sides of a surface then count. The exception is a room: in some view, less than [`OPENING`] of its
/// visible surface is back-facing.
const MEANINGLESS: f64 = 0.6;
/// Back-facing fraction of a view's visible surface. If some view has a smaller one, the scene may be a room, which is
/// viewed through its opening.
const OPENING: f64 = 0.5;
/// Back-facing fraction of the surface visible in all views of the ring together, below which back faces are only
/// silhouettes of a watertight surface. Openings aren't searched for then.
const RIMS: f64 = 0.3;
/// Smallest difference between the back-facing fractions of the surface visible in all views of the ring and in one
/// view, at which an opening is reported as the reason for that view.
const OPENS: f64 = 0.2;

/// Largest lateral offset of a point that a depth camera at the origin may have captured, as a multiple of the point's
/// depth.
const WIDEST: f64 = 1.5;
/// Fraction of the patches that must face a depth camera for the surface to count as captured by it. The other patches
/// may be at silhouettes, which face in any direction.
const SEEN: f64 = 0.95;

/// A weighted criterion for or against a view.
struct Piece {
    reason: ViewReason,
    weight: f64,
    measure: fn(&Compared, &Candidate) -> f64,
}

/// All criteria. The score of a view is the sum of the measurements times their weights. Entropy and curvature are 1
/// for the best view of the ring, so that their weights can be compared.
const EVIDENCE: [Piece; 6] = {
    const fn piece(reason: ViewReason, weight: f64, measure: fn(&Compared, &Candidate) -> f64) -> Piece {
        Piece { reason, weight, measure }
    }
    [
        piece(ViewReason::Details, 0.5, entropy),
        piece(ViewReason::Details, 0.5, curvature_shown),
        piece(ViewReason::Front, 0.2, frontal),
        piece(ViewReason::Opening, 0.4, open),
        piece(ViewReason::Details, -0.05, straight),
        piece(ViewReason::Details, -0.1, from_high),
    ]
};

/// Returns the viewpoint entropy of a view, as a fraction of the highest on the ring.
fn entropy(compared: &Compared, view: &Candidate) -> f64 {
    compared.shown(&view.seen).entropy / compared.best.entropy
}

/// Returns the visible curvature of a view, as a fraction of the highest on the ring.
fn curvature_shown(compared: &Compared, view: &Candidate) -> f64 {
    compared.shown(&view.seen).curvature / compared.best.curvature
}

/// Returns the cosine of the horizontal angle between a view and the view of the scene's front, at most [`FRONT_COS`].
fn frontal(compared: &Compared, view: &Candidate) -> f64 {
    let level = ViewAngles { elevation_deg: 0.0, ..view.angles };
    (-ViewAxes::turned(level, compared.up).forward.dot(compared.front)).min(FRONT_COS)
}

/// Returns by how much the back-facing fraction of the visible surface is smaller in this view than in all views of the
/// ring together. The difference is large if the view shows the scene through an opening. Returns 0 if facing
/// directions are meaningless, or only silhouettes are back-facing.
fn open(compared: &Compared, view: &Candidate) -> f64 {
    if compared.two_sided || compared.away < RIMS { 0.0 } else { (compared.away - view.seen.share_away()).max(0.0) }
}

/// Returns 1 if the view is straight from the front, the back or a side, and 0 otherwise.
fn straight(_: &Compared, view: &Candidate) -> f64 {
    f64::from(u8::from(view.angles.azimuth_deg % 90.0 == 0.0))
}

/// Returns 1 if the view is from higher up than the ring, and 0 otherwise. The weight is negative: a high view must
/// show clearly more to win.
fn from_high(compared: &Compared, view: &Candidate) -> f64 {
    f64::from(u8::from(view.angles.elevation_deg > compared.elevation_deg))
}

/// Candidate view, with its measurements.
struct Candidate {
    angles: ViewAngles,
    seen: ViewMeasurements,
}

/// Properties of a scene and of the ring of its candidate views, with which each view is compared.
struct Compared {
    up: Up,
    /// Unit vector in which the scene's front faces: detected from the shape, or the default.
    front: DVec3,
    /// True if the front was detected from the shape, false if it is the default.
    has_front: bool,
    /// Elevation, in degrees, of the ring of candidate views.
    elevation_deg: f64,
    /// True if facing directions are meaningless, so that both sides of a surface count.
    two_sided: bool,
    /// Fraction of the surface visible from the whole ring that is back-facing.
    away: f64,
    /// Largest entropy and largest curvature of any view of the ring.
    best: VisibleDetail,
}

impl Compared {
    fn shown<'a>(&self, seen: &'a ViewMeasurements) -> &'a VisibleDetail {
        if self.two_sided { &seen.all } else { &seen.facing }
    }

    fn score(&self, view: &Candidate) -> f64 {
        EVIDENCE.iter().map(|piece| piece.weight * (piece.measure)(self, view)).sum()
    }

    /// Returns the reason to report for a view: the kind of criteria by which its score exceeds the ring's mean by
    /// most. An opening takes precedence, since entropy also counts surfaces that are visible only through the opening.
    fn reason(&self, view: &Candidate, ring: &[Candidate]) -> ViewReason {
        if open(self, view) >= OPENS {
            return ViewReason::Opening;
        }
        let lead = |reason: ViewReason| {
            let of = |view: &Candidate| -> f64 {
                let pieces = EVIDENCE.iter().filter(|piece| piece.reason == reason);
                pieces.map(|piece| piece.weight * (piece.measure)(self, view)).sum()
            };
            of(view) - ring.iter().map(of).sum::<f64>() / ring.len() as f64
        };
        let is_from_front = self.has_front && lead(ViewReason::Front) > lead(ViewReason::Details);
        if is_from_front { ViewReason::Front } else { ViewReason::Details }
    }
}

/// Chooses the view with the highest score for a scene, or for one part of a scene of equal parts. A relief, or a
/// surface that a depth camera captured, gets the front view instead, and a scene with too few patches
/// [`ViewAngles::ISO`]. The elevation of the ring depends on the whole scene. The choice is deterministic, and takes a
/// limited time whatever the size of the scene.
pub(crate) fn choose_view(samples: &Samples, up: Up) -> ChosenView {
    let Some((all, patches)) = samples.all().zip(samples.one()) else {
        return ChosenView { angles: ViewAngles::ISO, reason: ViewReason::Convention };
    };
    let mut elevation_deg = elevation(all, up);
    let level = ViewAngles { azimuth_deg: 0.0, elevation_deg: 0.0 };
    let ahead = match up {
        Up::MinusY => DVec3::Z,
        Up::PlusY => DVec3::NEG_Z,
        _ => DVec3::ZERO,
    };
    let is_captured = ahead != DVec3::ZERO && depth_camera(patches, ahead.z) > 0.5;
    if is_captured || is_captured_along(ahead, patches) {
        return ChosenView { angles: level, reason: ViewReason::Camera };
    }
    let judge = ViewComparison::new(patches);
    let candidate = |angles: ViewAngles| Candidate { angles, seen: judge.look(&ViewAxes::turned(angles, up)) };
    let ring_at = |elevation_deg: f64| RING.map(|azimuth_deg| candidate(ViewAngles { azimuth_deg, elevation_deg }));
    let away = |ring: &[Candidate]| {
        let sum = |f: fn(&ViewMeasurements) -> f64| ring.iter().map(|view| f(&view.seen)).sum::<f64>();
        sum(|s| s.away) / (sum(|s| s.away) + sum(|s| s.toward)).max(1.0)
    };
    let mut ring = ring_at(elevation_deg);
    let mut two_sided = away(&ring) > MEANINGLESS;
    if two_sided {
        let lower = ring_at(ROOM_DEG);
        if lower.iter().any(|view| view.seen.share_away() < OPENING) {
            (ring, elevation_deg, two_sided) = (lower, ROOM_DEG, false);
        }
    }
    let away = away(&ring);
    let found = front(patches, up);
    let front = found.unwrap_or(-ViewAxes::turned(level, up).forward);
    let has_front = found.is_some();
    let mut compared =
        Compared { up, front, has_front, elevation_deg, two_sided, away, best: VisibleDetail::default() };
    let best = |f: fn(&VisibleDetail) -> f64| {
        ring.iter().map(|view| f(compared.shown(&view.seen))).fold(f64::MIN_POSITIVE, f64::max)
    };
    compared.best = VisibleDetail { entropy: best(|s| s.entropy), curvature: best(|s| s.curvature) };
    let mut chosen = (f64::NEG_INFINITY, &ring[0]);
    for view in &ring {
        let score = compared.score(view);
        if score > chosen.0 + TIE {
            chosen = (score, view);
        }
    }
    let (score, mut view) = chosen;
    let high = candidate(ViewAngles { elevation_deg: HIGH_DEG, ..view.angles });
    if elevation_deg <= ELEVATION_DEG && compared.score(&high) > score {
        view = &high;
    }
    ChosenView { angles: view.angles, reason: compared.reason(view, &ring) }
}

/// Returns the elevation, in degrees, of the ring of candidate views. From [`ELEVATION_DEG`], low shapes would appear
/// as a line, or their rim would hide them.
fn elevation(patches: &Patches, up: Up) -> f64 {
    let extent = patches.extent();
    let [u, v] = others(axis_of(up));
    let height = extent[axis_of(up)] / extent[u].min(extent[v]);
    match height {
        _ if height < FLAT => FLAT_DEG,
        _ if height < LOW => LOW_DEG,
        _ => ELEVATION_DEG,
    }
}

/// True if nearly all patches face a depth camera that looks along `ahead`, from the origin or from far away. From
/// other directions, a surface that such a camera captured has gaps. Reliefs and drawings also match; a zero vector
/// never matches.
fn is_captured_along(ahead: DVec3, patches: &Patches) -> bool {
    let is_seen = |p: &&Patch| {
        let at = patches.middle + p.position * patches.scale;
        let is_before_origin = at.x.abs().max(at.y.abs()) < WIDEST * at.dot(ahead);
        p.normal.dot(if is_before_origin { at } else { ahead }) < 0.0
    };
    patches.all.iter().filter(is_seen).count() as f64 > SEEN * patches.all.len() as f64
}

impl ViewMeasurements {
    /// Returns the fraction of the visible surface that is back-facing.
    fn share_away(&self) -> f64 {
        self.away / (self.away + self.toward).max(1.0)
    }
}

/// Amount of detail that is visible in the image of one view.
#[derive(Clone, Copy, Debug, Default)]
struct VisibleDetail {
    /// Viewpoint entropy in bits. The background counts as one cell.
    entropy: f64,
    /// Curvature of the visible patches, summed over the pixels.
    curvature: f64,
}

/// Measurements of the small image that is drawn of a view.
#[derive(Clone, Copy, Debug, Default)]
struct ViewMeasurements {
    /// Detail of the whole visible surface, including back faces.
    all: VisibleDetail,
    /// Detail of the front-facing surface. Other pixels count as background.
    facing: VisibleDetail,
    /// Number of pixels whose surface is front-facing.
    toward: f64,
    /// Number of pixels whose surface is back-facing.
    away: f64,
}

/// Scene whose views are compared, with data about its patches that all views share.
struct ViewComparison<'a> {
    patches: &'a Patches,
    /// Number of the entropy cell of each patch. Patches with about the same position, direction and colour share a
    /// cell.
    cells: Vec<u32>,
    /// Curvature around each patch, from 0 (flat) to 1.
    curvature: Vec<f64>,
}

impl<'a> ViewComparison<'a> {
    fn new(patches: &'a Patches) -> Self {
        let mut cells: Vec<u64> = patches.all.iter().map(cell).collect();
        let mut distinct = cells.clone();
        distinct.sort_unstable();
        distinct.dedup();
        for cell in &mut cells {
            *cell = distinct.partition_point(|d| d < cell) as u64;
        }
        let cells = cells.into_iter().map(|c| c as u32).collect();
        Self { patches, cells, curvature: curvature(patches) }
    }

    fn look(&self, axes: &ViewAxes) -> ViewMeasurements {
        let mut counts = vec![[0u32; 2]; self.cells.len()];
        let mut seen = ViewMeasurements::default();
        let all = &self.patches.all;
        let step = all.len().div_ceil(DRAWN);
        let drawn = all.iter().enumerate().step_by(step.max(1));
        for (_, number) in draw(drawn, (step as f64).sqrt(), axes, SIDE) {
            let Some(patch) = all.get(number) else { continue };
            let facing = !patch.has_sides || patch.normal.dot(axes.forward) <= 0.0;
            let count = &mut counts[self.cells[number] as usize];
            count[0] += 1;
            seen.all.curvature += self.curvature[number];
            if facing {
                count[1] += 1;
                seen.toward += 1.0;
                seen.facing.curvature += self.curvature[number];
            } else {
                seen.away += 1.0;
            }
        }
        let total = (SIDE * SIDE) as f64;
        let term = |pixels: f64| if pixels > 0.0 { -pixels / total * (pixels / total).log2() } else { 0.0 };
        let entropy =
            |k: usize, covered: f64| term(total - covered) + counts.iter().map(|c| term(f64::from(c[k]))).sum::<f64>();
        seen.all.entropy = entropy(0, seen.toward + seen.away);
        seen.facing.entropy = entropy(1, seen.toward);
        seen
    }
}

/// Returns a code for the entropy cell of a patch. The code combines the patch's position in the scene, one of 54
/// directions, and its approximate sRGB colour, quantised to four levels per channel.
fn cell(patch: &Patch) -> u64 {
    let index = |digits: [u64; 3], base: u64| (digits[0] * base + digits[1]) * base + digits[2];
    let place = ((patch.position + 1.0) * ENTROPY_CELLS).to_array().map(|c| c as u64);
    let n = patch.normal;
    let k = n.abs().max_position();
    let side = |c: f64| (((c / n[k].abs() + 1.0) * 1.5) as u64).min(2);
    let face = 2 * k as u64 + u64::from(n[k] < 0.0);
    let direction = (face * 3 + side(n[(k + 1) % 3])) * 3 + side(n[(k + 2) % 3]);
    let color = patch.color.map(|c| ((f64::from(c.clamp(0.0, 1.0)).sqrt() * 4.0) as u64).min(3));
    (index(place, 8) * 54 + direction) * 64 + index(color, 4)
}

/// Returns, for each patch, how much the normals around it differ: 1 − the length of their mean. Patches whose normals
/// have an arbitrary sign get 1.
fn curvature(patches: &Patches) -> Vec<f64> {
    const SIDE: usize = 2 * CURVATURE_CELLS as usize + 3;
    let index = |p: DVec3| {
        let [x, y, z] = ((p + 1.0) * CURVATURE_CELLS + 1.0).to_array().map(|c| c as usize);
        (z * SIDE + y) * SIDE + x
    };
    let mut sums = vec![[0.0f32; 4]; SIDE * SIDE * SIDE];
    for p in &patches.all {
        let n = p.normal * p.area;
        let added = [n.x, n.y, n.z, p.area].map(|v| v as f32);
        sums[index(p.position)].iter_mut().zip(added).for_each(|(s, v)| *s += v);
    }
    let around = |p: &Patch| {
        if !p.has_sides {
            return 1.0;
        }
        let middle = index(p.position);
        let mut sum = [0.0f32; 4];
        for z in [middle - SIDE * SIDE, middle, middle + SIDE * SIDE] {
            for y in [z - SIDE, z, z + SIDE] {
                for cell in &sums[y - 1..=y + 1] {
                    sum.iter_mut().zip(cell).for_each(|(s, v)| *s += v);
                }
            }
        }
        let [x, y, z, area] = sum.map(f64::from);
        (1.0 - DVec3::new(x, y, z).length() / area.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
    };
    patches.all.iter().map(around).collect()
}

/// Draws numbered patches as ellipses by orthographic projection, with a depth test. Radii are scaled by `growth`. A
/// length of 1 is half of the image, which has `side` × `side` pixels. Returns depth and patch number of each pixel,
/// row by row. Background pixels have the depth +∞ and the number `usize::MAX`.
pub fn draw<'a>(
    patches: impl Iterator<Item = (usize, &'a Patch)>,
    growth: f64,
    axes: &ViewAxes,
    side: usize,
) -> Vec<(f64, usize)> {
    let mut pixels = vec![(f64::INFINITY, usize::MAX); side * side];
    let scale = 0.5 * side as f64;
    let to_image = |v: DVec3| DVec2::new(v.dot(axes.right), -v.dot(axes.up)) * scale;
    for (number, patch) in patches {
        let center = to_image(patch.position) + DVec2::splat(scale);
        let [s, t] = patch.axes.map(|axis| to_image(axis * growth));
        let inverse = 1.0 / s.perp_dot(t);
        // Half a pixel is added, so that patches seen edge-on are visible, too.
        let reach = (s * s + t * t).map(f64::sqrt).max(DVec2::splat(0.5));
        let depth = patch.position.dot(axes.forward);
        let pixel = |v: f64| (v.max(0.0) as usize).min(side);
        let [x0, y0] = (center - reach).to_array().map(pixel);
        let [x1, y1] = (center + reach).to_array().map(|v| pixel(v + 1.0));
        for y in y0..y1 {
            for x in x0..x1 {
                let d = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - center;
                let (u, v) = (d.perp_dot(t) * inverse, s.perp_dot(d) * inverse);
                let found = &mut pixels[y * side + x];
                if depth < found.0 && (u * u + v * v <= 1.0 || d.abs().max_element() <= 0.5) {
                    *found = (depth, number);
                }
            }
        }
    }
    pixels
}
