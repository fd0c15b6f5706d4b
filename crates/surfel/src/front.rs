//! Which way things look that have a front: animals and seats.

use crate::patches::{Patch, Patches};
use crate::upright::{axis_of, leads, mirror, others, standing};
use glam::DVec3;
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

/// The level unit vector toward which it looks; `None` where the shape doesn't say it.
pub(crate) fn front(patches: &Patches, up: Up) -> Option<DVec3> {
    if !standing(patches, up).is_on_feet() {
        return None;
    }
    let (mirror, extent) = (mirror(patches), patches.extent());
    let is_mirror = |k: usize| leads(mirror, extent.to_array(), k) > 0.5 && mirror[k] > MIRRORED;
    let [u, v] = others(axis_of(up));
    let (across, along) = [(u, v), (v, u)].into_iter().find(|(across, _)| is_mirror(*across))?;
    let body = Body { patches, up: up.vector(), height: extent[axis_of(up)] };
    let (forward, length) = (DVec3::AXES[along], extent[along]);
    let is_long = length > LONGER * extent[across];
    body.backrest(forward, length)
        .or_else(|| if is_long { body.head(forward, length) } else { None })
        .or_else(|| body.tail(forward, length, DVec3::AXES[across]))
}

/// What stands there.
struct Body<'a> {
    patches: &'a Patches,
    up: DVec3,
    height: f64,
}

impl Body<'_> {
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
