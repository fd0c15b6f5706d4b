//! Clips of splats (§7): how they are stored, and what a frame makes of them.

use crate::lanes::{LANES, Lanes};
use fearless_simd::{Simd, mask32x16};
use surfel_math::clip::{Clip, Turn};
use surfel_math::mapping::{Footprint, Linear};
use surfel_math::{Real, V2};
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
    /// Absent where the footprints are the same.
    filtered: Option<Clip<f32>>,
    has_curve: bool,
    lines: usize,
}

impl ScreenClip {
    /// A clip through both footprints, with the turn of each.
    #[inline(always)]
    pub(crate) fn new(
        clip: &Clip<f64>,
        visible: (&Footprint<f32>, &Turn<f32>),
        filtered: Option<(&Footprint<f32>, &Turn<f32>)>,
    ) -> Self {
        let nothing = Clip::nothing();
        let narrow = clip.map(|v| v as f32);
        let present = clip.lines.iter().rposition(|line| *line != nothing.lines[0]);
        Self {
            visible: narrow.through(visible.0, visible.1),
            filtered: match filtered {
                Some((footprint, turn)) => Some(narrow.through(footprint, turn)),
                None => None,
            },
            has_curve: clip.chord != nothing.chord,
            lines: present.map_or(0, |last| last + 1),
        }
    }

    /// Pixels at these offsets that the unfiltered and the filtered footprint keep.
    #[inline(always)]
    pub(crate) fn keeps<S: Simd>(&self, visible: V2<Lanes<S>>, filtered: V2<Lanes<S>>) -> [mask32x16<S>; 2] {
        let keeps = self.part_keeps(&self.visible, visible);
        match &self.filtered {
            Some(clip) => [keeps, self.part_keeps(clip, filtered)],
            None => [keeps, keeps],
        }
    }

    #[inline(always)]
    fn part_keeps<S: Simd>(&self, clip: &Clip<f32>, d: V2<Lanes<S>>) -> mask32x16<S> {
        let zero = d.x.zero();
        let lines_keep = if self.lines == 0 {
            zero.le(zero)
        } else {
            // As `Clip::lines_keep`, of the lines that there are.
            let mut least = widened(&clip.lines[0], zero).at(d);
            for line in &clip.lines[1..self.lines] {
                least = least.min(widened(line, zero).at(d));
            }
            zero.le(least * zero.constant(f64::from(clip.line_sign)))
        };
        if !self.has_curve {
            return lines_keep;
        }
        let curve = Clip {
            chord: widened(&clip.chord, zero),
            side1: widened(&clip.side1, zero),
            side3: widened(&clip.side3, zero),
            curve_sign: zero.constant(f64::from(clip.curve_sign)),
            lines: [Linear { c: zero, x: zero, y: zero }; 4],
            line_sign: zero,
        };
        curve.curve_keeps(d) & lines_keep
    }
}

#[inline(always)]
fn widened<S: Simd>(l: &Linear<f32>, like: Lanes<S>) -> Linear<Lanes<S>> {
    let simd = like.0.simd;
    Linear { c: Lanes::splat(simd, l.c), x: Lanes::splat(simd, l.x), y: Lanes::splat(simd, l.y) }
}

/// Turns of sixteen splats.
pub(crate) struct Turns([[f32; LANES]; 4]);

impl Turns {
    #[inline(always)]
    pub(crate) fn new<S: Simd>(turn: &Turn<Lanes<S>>) -> Self {
        let Turn { first, second } = turn;
        Self([first.x.to_array(), first.y.to_array(), second.x.to_array(), second.y.to_array()])
    }

    #[inline(always)]
    pub(crate) fn of(&self, i: usize) -> Turn<f32> {
        let [a, b, c, d] = &self.0;
        Turn { first: V2::new(a[i], b[i]), second: V2::new(c[i], d[i]) }
    }
}
