//! Which way things look that have a front: animals, seats and figures on two feet.
//!
//! Pieces of evidence each speak for a direction, with weights that stand in [`EVIDENCE`]; the direction with the most
//! weight wins.

use crate::patches::{Patch, Patches};
use crate::upright::{axis_of, leads, mirror, others, standing};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use surfel_model::Up;

/// The share that a mirror plane mirrors, of animals and seats.
const MIRRORED: f64 = 0.9;
/// How much longer than wide an animal is.
const LONGER: f64 = 1.25;
/// Where the ends of a body and their tips begin, of its half length; and by how much one is taller, and how far its
/// tip is above the ground, of its height.
const END: f64 = 0.4;
const TIP: f64 = 0.8;
const HIGHER: f64 = 0.15;
const CHIN: f64 = 0.35;
/// How much longer than wide a body with a tail is, where the tail begins, of the half length, and how high and wide it
/// is at most, of the body.
const SLENDER: f64 = 2.0;
const TAIL: f64 = 0.6;
const THIN_TAIL: f64 = 0.3;
/// Above which height there is a backrest alone, of the whole; where it begins, of the half length; and how high a seat
/// is at least, in its lengths.
const BACKREST: f64 = 0.65;
const BEHIND: f64 = 0.3;
const SEAT: f64 = 0.75;

/// Where the feet of a figure are that stands, or is in mid-step.
const STANDING: Stance = Stance { soles: 0.05, shins: (0.08, 0.16), off: 0.0 };
const STEPPING: Stance = Stance { soles: 0.11, shins: (0.14, 0.24), off: 0.35 };
/// Of its height: how far apart patches of one foot are at most, how long a foot is at most, and how far toes reach
/// forward at least.
const TOGETHER: f64 = 0.02;
const LONGEST_FOOT: f64 = 0.22;
const TOES: f64 = 0.015;
/// The share of what touches the ground that both feet are at least, and each of them; and the fewest patches there.
const FEET: (f64, f64) = (0.9, 0.1);
const FEWEST: usize = 20;

/// A piece of evidence for the direction in which a shape looks.
struct Piece {
    weight: f64,
    direction: fn(&Patches, Up) -> Option<DVec3>,
}

/// All evidence. A backrest outweighs a head, which outweighs a tail; toes say most where nothing else does.
const EVIDENCE: [Piece; 4] = [
    Piece { weight: 1.0, direction: away_from_backrest },
    Piece { weight: 0.6, direction: toward_head },
    Piece { weight: 0.3, direction: away_from_tail },
    Piece { weight: 0.2, direction: toes },
];
/// Cosine of the angle between two directions that are one.
const ALIKE: f64 = 0.7;

/// Returns the level unit vector toward which a shape looks; `None` where the shape doesn't say it.
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

/// What stands there.
struct Body<'a> {
    patches: &'a Patches,
    up: DVec3,
    height: f64,
}

impl<'a> Body<'a> {
    /// An animal or a seat: it stands on feet, and is its own mirror image from left to right. With it the direction of
    /// its length, that length, and the direction across.
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

    /// Height above the ground, of the whole.
    fn height(&self, patch: &Patch) -> f64 {
        patch.position.dot(self.up) / self.height + 0.5
    }

    /// Heights above the ground at one end of a body, from this share of the half length on.
    fn heights(&self, end: DVec3, length: f64, from: f64) -> impl Iterator<Item = f64> {
        let there = self.patches.all.iter().filter(move |p| p.position.dot(end) > from * 0.5 * length);
        there.map(|p| self.height(p))
    }

    /// Away from the back of a seat: what is high up is all at one end.
    fn backrest(&self, forward: DVec3, length: f64) -> Option<DVec3> {
        let high = || self.patches.all.iter().filter(|p| self.height(p) > BACKREST);
        let is_behind = |end: &DVec3| high().all(|p| p.position.dot(*end) > BEHIND * 0.5 * length);
        let is_seat = self.height > SEAT * length;
        [forward, -forward].into_iter().filter(|_| is_seat).find(is_behind).map(|back| -back)
    }

    /// Toward the end at which it is taller, as animals carry their heads.
    fn head(&self, forward: DVec3, length: f64) -> Option<DVec3> {
        let top = |end: DVec3| self.heights(end, length, END).fold(f64::NEG_INFINITY, f64::max);
        let lead = top(forward) - top(-forward);
        let end = forward * lead.signum();
        // A head is held up; the tall end of a car goes down to the ground.
        let chin = self.heights(end, length, TIP).fold(f64::INFINITY, f64::min);
        (lead.abs() > HIGHER && chin > CHIN).then_some(end)
    }

    /// Away from the end that is thin, where the other isn't.
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

/// What lies level: its bounds, and how many patches it has.
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

/// How a figure is on its feet, of its height.
struct Stance {
    /// Up to where its soles are, and from where to where its shins are above them.
    soles: f64,
    shins: (f64, f64),
    /// How far its middle is from above its feet, at most.
    off: f64,
}

impl Stance {
    /// What stands on the ground, each with a good share of what does; with how many patches that is of all there.
    fn feet(&self, figure: &Figure) -> (Vec<Spot>, usize) {
        let soles = figure.between(0.0, self.soles);
        let least = FEET.1 * soles.len() as f64;
        (spots(&soles).into_iter().filter(|foot| foot.count as f64 > least).collect(), soles.len())
    }
}

/// A shape that may be a figure on two feet; lengths are in its heights.
struct Figure<'a> {
    body: Body<'a>,
    /// The level axes.
    axes: [usize; 2],
}

impl Figure<'_> {
    fn level(&self, p: DVec3) -> DVec2 {
        DVec2::new(p[self.axes[0]], p[self.axes[1]]) / self.body.height
    }

    /// Places of patches that are so high above the ground.
    fn between(&self, low: f64, high: f64) -> Vec<DVec2> {
        let there = self.body.patches.all.iter().filter(|p| (low..high).contains(&self.body.height(p)));
        there.map(|p| self.level(p.position)).collect()
    }
}

/// Where the toes of a figure point that stands on two feet: these reach farther forward of the shins than heels back.
fn toes(patches: &Patches, up: Up) -> Option<DVec3> {
    let body = Body { patches, up: up.vector(), height: patches.extent()[axis_of(up)] };
    let figure = Figure { body, axes: others(axis_of(up)) };
    // In mid-step one foot is on the ground.
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
        let is_foot = (foot.high - foot.low).max_element() < LONGEST_FOOT && shin.count > 0;
        is_foot.then(|| foot.middle() - shin.middle())
    };
    let forward = 0.5 * (forward(left)? + forward(right)?);
    let [u, v] = figure.axes;
    let toward = DVec3::AXES[u] * forward.x + DVec3::AXES[v] * forward.y;
    (forward.length() > TOES).then(|| toward.normalize())
}

/// Points that lie together, each with those of the cells around its own.
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
