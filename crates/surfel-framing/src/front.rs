//! Detection of the semantic front of animals, seats and figures on two feet.
//!
//! Each entry of [`EVIDENCE`] votes for a direction, with a weight. The direction with the largest total weight wins.
//! Lengths of animals and seats are measured along the horizontal axis within their mirror plane.

use crate::patches::{Patch, Patches};
use crate::up_axis::{axis_of, leads, mirror, others, standing};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use surfel_model::Up;

/// Fraction of the surface above which the mirror plane of an animal or a seat must map the surface onto itself.
const MIRRORED: f64 = 0.9;
/// Ratio of length to width above which a shape on feet may be an animal with a head.
const LONGER: f64 = 1.25;
/// Distance from the centre beyond which a patch belongs to an end of an animal, as a fraction of half of its length.
/// The heights of both ends are compared to find the head.
const END: f64 = 0.4;
/// Distance from the centre beyond which a patch belongs to the tip of an animal's end, as a fraction of half of its
/// length. The tip contains the head, if there is one.
const TIP: f64 = 0.8;
/// Difference in height above which the higher end of an animal counts as the end with the head, as a fraction of the
/// body's height.
const HIGHER: f64 = 0.15;
/// Height above the ground that all of the tip must exceed for the higher end to have a head, as a fraction of the
/// body's height. It excludes cars.
const CHIN: f64 = 0.35;
/// Ratio of length to width above which a tail is detected in a shape.
const SLENDER: f64 = 2.0;
/// Distance from the centre beyond which a patch may belong to a tail, as a fraction of half of the body's length.
const TAIL: f64 = 0.6;
/// Fraction of the body's height, and of its width, below which an end is thin enough for a tail.
const THIN_TAIL: f64 = 0.3;
/// Height above which a seat consists only of its backrest, as a fraction of the seat's height.
const BACKREST: f64 = 0.65;
/// Distance from the centre beyond which all patches of a backrest lie, as a fraction of half of the seat's length.
const BEHIND: f64 = 0.3;
/// Ratio of height to length above which a shape on feet may be a seat.
const SEAT: f64 = 0.75;

/// Stance of a figure that stands on both feet.
const STANDING: Stance = Stance { soles: 0.05, shins: (0.08, 0.16), off: 0.0 };
/// Stance of a figure in mid-step, whose hind foot touches the ground only with the toes.
const STEPPING: Stance = Stance { soles: 0.11, shins: (0.14, 0.24), off: 0.35 };
/// Side of the grid cells that cluster patches near the ground into feet, as a fraction of the figure's height. Patches
/// in adjacent cells belong to the same foot.
const TOGETHER: f64 = 0.02;
/// Largest length of a foot, as a fraction of the figure's height. Larger clusters of patches aren't feet.
const MAX_FOOT: f64 = 0.22;
/// Horizontal distance from a shin's centre to its foot's centre, averaged over both feet, above which the toes show
/// the front. It is a fraction of the figure's height.
const TOES: f64 = 0.015;
/// Two limits, as fractions of the number of patches that touch the ground. Both feet together must have more than the
/// first fraction of these patches, and each foot more than the second.
const FEET: (f64, f64) = (0.9, 0.1);
/// Smallest number of patches that touch the ground from which a figure's feet are detected.
const FEWEST: usize = 20;

/// A weighted criterion for the direction in which a shape faces.
struct Piece {
    weight: f64,
    direction: fn(&Patches, Up) -> Option<DVec3>,
}

/// All criteria for the front. A backrest outweighs a head, and a head outweighs a tail. Toes have the smallest weight,
/// so that they decide only if no other criterion does.
const EVIDENCE: [Piece; 4] = [
    Piece { weight: 1.0, direction: away_from_backrest },
    Piece { weight: 0.6, direction: toward_head },
    Piece { weight: 0.3, direction: away_from_tail },
    Piece { weight: 0.2, direction: toes },
];
/// Cosine of the angle below which the directions of two criteria count as the same, so that their weights are added.
const ALIKE: f64 = 0.7;

/// Returns the horizontal unit vector in which a shape faces, or `None` if there is no evidence.
pub(crate) fn front(patches: &Patches, up: Up) -> Option<DVec3> {
    let found: Vec<(f64, DVec3)> =
        EVIDENCE.iter().filter_map(|piece| Some((piece.weight, (piece.direction)(patches, up)?))).collect();
    let score = |direction: DVec3| -> f64 {
        found.iter().filter(|(_, other)| direction.dot(*other) > ALIKE).map(|(weight, _)| weight).sum()
    };
    let directions = found.iter().map(|(_, direction)| *direction);
    directions.rev().max_by(|a, b| score(*a).total_cmp(&score(*b)))
}

fn away_from_backrest(patches: &Patches, up: Up) -> Option<DVec3> {
    let (body, forward, length, _) = Body::on_feet(patches, up)?;
    body.backrest(forward, length)
}

fn toward_head(patches: &Patches, up: Up) -> Option<DVec3> {
    let (body, forward, length, across) = Body::on_feet(patches, up)?;
    let is_long = length > LONGER * patches.extent().dot(across);
    if is_long { body.head(forward, length) } else { None }
}

fn away_from_tail(patches: &Patches, up: Up) -> Option<DVec3> {
    let (body, forward, length, across) = Body::on_feet(patches, up)?;
    body.tail(forward, length, across)
}

/// Body that may have a front: its surface, its up direction, and its height in the units of the patches.
struct Body<'a> {
    patches: &'a Patches,
    up: DVec3,
    height: f64,
}

impl<'a> Body<'a> {
    /// Returns the shape as a body that may be an animal or a seat: it rests on feet and is symmetric from left to
    /// right. Also returns the horizontal direction within the mirror plane, the length along it, and the direction
    /// across it. Returns `None` for other shapes.
    fn on_feet(patches: &'a Patches, up: Up) -> Option<(Self, DVec3, f64, DVec3)> {
        if !standing(patches, up).is_on_feet() {
            return None;
        }
        let (mirror, extent) = (mirror(patches), patches.extent());
        let is_mirror = |k: usize| leads(mirror, extent.to_array(), k) > 0.5 && mirror[k] > MIRRORED;
        let [u, v] = others(axis_of(up));
        let (across, along) = [(u, v), (v, u)].into_iter().find(|(across, _)| is_mirror(*across))?;
        let body = Self { patches, up: up.vector(), height: extent[axis_of(up)] };
        Some((body, DVec3::AXES[along], extent[along], DVec3::AXES[across]))
    }

    /// Returns the height of a patch above the ground, as a fraction of the body's height. The bounds are centred at
    /// the origin.
    fn height(&self, patch: &Patch) -> f64 {
        patch.position.dot(self.up) / self.height + 0.5
    }

    /// Returns the heights, as fractions of the body's height, of the patches at one end of a body. The end begins at
    /// the fraction `from` of half of `length` from the centre, in the direction `end`.
    fn heights(&self, end: DVec3, length: f64, from: f64) -> impl Iterator<Item = f64> {
        let there = self.patches.all.iter().filter(move |p| p.position.dot(end) > from * 0.5 * length);
        there.map(|p| self.height(p))
    }

    /// Returns the direction away from the backrest of a seat, or `None`. A shape is a seat if it is high enough
    /// ([`SEAT`]) and all of its patches above [`BACKREST`] are at one end.
    fn backrest(&self, forward: DVec3, length: f64) -> Option<DVec3> {
        let high = || self.patches.all.iter().filter(|p| self.height(p) > BACKREST);
        let is_behind = |end: &DVec3| high().all(|p| p.position.dot(*end) > BEHIND * 0.5 * length);
        let is_seat = self.height > SEAT * length;
        [forward, -forward].into_iter().filter(|_| is_seat).find(is_behind).map(|back| -back)
    }

    /// Returns the direction toward the taller end, where animals have their heads. Returns `None` if neither end is
    /// clearly taller, or if the taller end extends down to the ground.
    fn head(&self, forward: DVec3, length: f64) -> Option<DVec3> {
        let top = |end: DVec3| self.heights(end, length, END).fold(f64::NEG_INFINITY, f64::max);
        let lead = top(forward) - top(-forward);
        let end = forward * lead.signum();
        // A head is above the ground, whereas the tall end of a car extends down to the ground.
        let chin = self.heights(end, length, TIP).fold(f64::INFINITY, f64::min);
        (lead.abs() > HIGHER && chin > CHIN).then_some(end)
    }

    /// Returns the direction away from the thin end, which is the tail. Returns `None` unless exactly one end is thin
    /// and the body is long enough ([`SLENDER`]).
    fn tail(&self, forward: DVec3, length: f64, across: DVec3) -> Option<DVec3> {
        let span = |of: &dyn Fn(&Patch) -> f64, end: Option<DVec3>| {
            let is_there = |p: &&Patch| end.is_none_or(|end| p.position.dot(end) > TAIL * 0.5 * length);
            let values = self.patches.all.iter().filter(is_there).map(of);
            let (least, most) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            most - least
        };
        let (height, width) = (|p: &Patch| self.height(p), |p: &Patch| p.position.dot(across));
        let whole = span(&width, None);
        let is_thin = |end| span(&height, Some(end)) < THIN_TAIL && span(&width, Some(end)) < THIN_TAIL * whole;
        let is_slender = length > (SLENDER * whole).max(self.height);
        match [forward, -forward].map(is_thin) {
            [true, false] if is_slender => Some(-forward),
            [false, true] if is_slender => Some(forward),
            _ => None,
        }
    }
}

/// Cluster of patches projected onto the ground plane: its bounds and its number of patches. Lengths are fractions of
/// the figure's height.
#[derive(Clone, Copy)]
struct Spot {
    low: DVec2,
    high: DVec2,
    count: usize,
}

impl Spot {
    const NONE: Self = Self { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY, count: 0 };

    fn with(self, o: Self) -> Self {
        Self { low: self.low.min(o.low), high: self.high.max(o.high), count: self.count + o.count }
    }

    fn of(points: impl Iterator<Item = DVec2>) -> Self {
        points.fold(Self::NONE, |spot, p| spot.with(Self { low: p, high: p, count: 1 }))
    }

    fn has(&self, p: DVec2, around: f64) -> bool {
        p.cmpge(self.low - around).all() && p.cmple(self.high + around).all()
    }

    fn middle(&self) -> DVec2 {
        0.5 * (self.low + self.high)
    }
}

/// Heights at which the feet and shins of a figure on two feet are searched, and a limit for its balance. All are
/// fractions of the figure's height.
struct Stance {
    /// Height above the ground up to which patches belong to the soles.
    soles: f64,
    /// Range of heights of the shins, which are compared with the feet.
    shins: (f64, f64),
    /// Largest horizontal distance of the figure's centroid from the bounds of its feet. A figure that stands still is
    /// balanced above them.
    off: f64,
}

impl Stance {
    /// Returns the clusters of patches that form a large enough part of the soles to be feet ([`FEET`]), and the number
    /// of all patches of the soles.
    fn feet(&self, figure: &Figure) -> (Vec<Spot>, usize) {
        let soles = figure.between(0.0, self.soles);
        let least = FEET.1 * soles.len() as f64;
        (spots(&soles).into_iter().filter(|foot| foot.count as f64 > least).collect(), soles.len())
    }
}

/// Shape that may be a figure on two feet, with its horizontal axes.
struct Figure<'a> {
    body: Body<'a>,
    /// Indices of the two horizontal axes.
    axes: [usize; 2],
}

impl Figure<'_> {
    fn level(&self, p: DVec3) -> DVec2 {
        DVec2::new(p[self.axes[0]], p[self.axes[1]]) / self.body.height
    }

    /// Returns the horizontal positions of patches at heights between `low` and `high`. All lengths are fractions of
    /// the figure's height.
    fn between(&self, low: f64, high: f64) -> Vec<DVec2> {
        let there = self.body.patches.all.iter().filter(|p| (low..high).contains(&self.body.height(p)));
        there.map(|p| self.level(p.position)).collect()
    }
}

/// Returns the direction in which the toes of a figure on two feet point, or `None` if the shape isn't such a figure or
/// its toes show no direction. Toes extend farther in front of the shins than heels extend behind them.
fn toes(patches: &Patches, up: Up) -> Option<DVec3> {
    let body = Body { patches, up: up.vector(), height: patches.extent()[axis_of(up)] };
    let figure = Figure { body, axes: others(axis_of(up)) };
    // In mid-step, only one foot is on the ground.
    let stance = if STANDING.feet(&figure).0.len() == 1 { STEPPING } else { STANDING };
    let (feet, total) = stance.feet(&figure);
    let [left, right] = feet.try_into().ok()?;
    let both = left.with(right);
    let is_most = total >= FEWEST && both.count as f64 > FEET.0 * total as f64;
    if !is_most || !both.has(figure.level(patches.centroid), stance.off) {
        return None;
    }
    let shins = figure.between(stance.shins.0, stance.shins.1);
    let forward = |foot: Spot| {
        let shin = Spot::of(shins.iter().copied().filter(|p| foot.has(*p, stance.soles)));
        let is_foot = (foot.high - foot.low).max_element() < MAX_FOOT && shin.count > 0;
        is_foot.then(|| foot.middle() - shin.middle())
    };
    let forward = 0.5 * (forward(left)? + forward(right)?);
    let [u, v] = figure.axes;
    let toward = DVec3::AXES[u] * forward.x + DVec3::AXES[v] * forward.y;
    (forward.length() > TOES).then(|| toward.normalize())
}

/// Groups points into clusters, which may be feet. Points in the same or in adjacent grid cells of side [`TOGETHER`]
/// are in one cluster.
fn spots(points: &[DVec2]) -> Vec<Spot> {
    let mut cells = BTreeMap::new();
    for &p in points {
        let cell = p.to_array().map(|c| (c / TOGETHER).floor() as i64);
        let spot = cells.entry(cell).or_insert(Spot::NONE);
        *spot = spot.with(Spot { low: p, high: p, count: 1 });
    }
    let mut all = Vec::new();
    while let Some((cell, mut spot)) = cells.pop_first() {
        let mut left = vec![cell];
        while let Some([x, y]) = left.pop() {
            for next in (-1..=1).flat_map(|j| (-1..=1).map(move |i| [x + i, y + j])) {
                if let Some(found) = cells.remove(&next) {
                    spot = spot.with(found);
                    left.push(next);
                }
            }
        }
        all.push(spot);
    }
    all
}
