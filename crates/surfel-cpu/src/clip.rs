//! Clips of splats (§7): how they are stored, and what a frame makes of them.

use crate::lanes::Lanes;
use fearless_simd::{Simd, mask32x16};
use surfel_math::V2;
use surfel_math::clip::{Clip, Turn};
use surfel_math::mapping::{Footprint, Linear};
use surfel_model::{ClipPolicy, SplatCloud};

/// Index of a splat without a clip.
const NONE: u32 = u32::MAX;

/// The clips of an object's splats.
#[derive(Default)]
pub(crate) struct StoredClips {
    /// Of every slot of the object's columns.
    of_slot: Vec<u32>,
    /// Exact forms, and those with chords in place of curves.
    clips: Vec<[Clip<f64>; 2]>,
}

impl StoredClips {
    /// Adds the next slot: splat `i` of a cloud.
    pub(crate) fn push(&mut self, cloud: &SplatCloud, i: usize) {
        let columns = cloud.data().clips.as_ref();
        let pair = columns.and_then(|c| Some([c.clip(i, ClipPolicy::Exact)?, c.clip(i, ClipPolicy::Line)?]));
        self.of_slot.push(pair.map_or(NONE, |_| self.clips.len() as u32));
        self.clips.extend(pair);
    }

    /// The clip of a slot under a policy.
    pub(crate) fn get(&self, slot: usize, policy: ClipPolicy) -> Option<&Clip<f64>> {
        let [exact, line] = self.clips.get(*self.of_slot.get(slot)? as usize)?;
        match policy {
            ClipPolicy::Off => None,
            ClipPolicy::Line => Some(line),
            ClipPolicy::Exact | ClipPolicy::Paper => Some(exact),
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.of_slot.as_slice()) + size_of_val(self.clips.as_slice())
    }
}

/// A splat's clip over pixels, as its two footprints see it.
#[derive(Clone, Copy)]
pub(crate) struct ScreenClip {
    visible: Clip<f32>,
    filtered: Clip<f32>,
    has_curve: bool,
    has_lines: bool,
}

impl ScreenClip {
    /// Lane `i` of both footprints, with the turn of each.
    pub(crate) fn new<S: Simd>(
        clip: &Clip<f64>,
        i: usize,
        visible: (&Footprint<Lanes<S>>, &Turn<Lanes<S>>),
        filtered: (&Footprint<Lanes<S>>, &Turn<Lanes<S>>),
    ) -> Self {
        let nothing = Clip::nothing();
        let narrow = clip.map(|v| v as f32);
        Self {
            visible: narrow.through(&footprint_of(visible.0, i), &turn_of(visible.1, i)),
            filtered: narrow.through(&footprint_of(filtered.0, i), &turn_of(filtered.1, i)),
            has_curve: clip.chord != nothing.chord,
            has_lines: clip.lines != nothing.lines,
        }
    }

    /// Pixels at these offsets that the unfiltered and the filtered footprint keep.
    #[inline(always)]
    pub(crate) fn keeps<S: Simd>(&self, visible: V2<Lanes<S>>, filtered: V2<Lanes<S>>) -> [mask32x16<S>; 2] {
        [self.part_keeps(&self.visible, visible), self.part_keeps(&self.filtered, filtered)]
    }

    #[inline(always)]
    fn part_keeps<S: Simd>(&self, clip: &Clip<f32>, d: V2<Lanes<S>>) -> mask32x16<S> {
        let lanes = widened(clip, d.x);
        match (self.has_curve, self.has_lines) {
            (true, false) => lanes.curve_keeps(d),
            (false, true) => lanes.lines_keep(d),
            _ => lanes.keeps(d),
        }
    }
}

#[inline(always)]
fn widened<S: Simd>(clip: &Clip<f32>, like: Lanes<S>) -> Clip<Lanes<S>> {
    let k = |v: f32| Lanes::splat(like.0.simd, v);
    let linear = |l: &Linear<f32>| Linear { c: k(l.c), x: k(l.x), y: k(l.y) };
    let [a, b, c, d] = &clip.lines;
    Clip {
        chord: linear(&clip.chord),
        side1: linear(&clip.side1),
        side3: linear(&clip.side3),
        curve_sign: k(clip.curve_sign),
        lines: [linear(a), linear(b), linear(c), linear(d)],
        line_sign: k(clip.line_sign),
    }
}

fn lane<S: Simd>(values: Lanes<S>, i: usize) -> f32 {
    values.to_array()[i]
}

fn footprint_of<S: Simd>(f: &Footprint<Lanes<S>>, i: usize) -> Footprint<f32> {
    let linear = |l: &Linear<Lanes<S>>| Linear { c: lane(l.c, i), x: lane(l.x, i), y: lane(l.y, i) };
    Footprint { u: linear(&f.u), v: linear(&f.v), w: linear(&f.w) }
}

fn turn_of<S: Simd>(turn: &Turn<Lanes<S>>, i: usize) -> Turn<f32> {
    let vector = |v: &V2<Lanes<S>>| V2::new(lane(v.x, i), lane(v.y, i));
    Turn { first: vector(&turn.first), second: vector(&turn.second) }
}
