//! Clips of stored splats (rendering model §7), as linear forms c + x·u + y·v over the splats' (u, v).
//!
//! Most clips are one line or two. Only the linear forms that a clip has are stored, in one list for many splats.
//!
//! A *slot* is the index of a stored splat in the columns of its object
//! ([`StoredObject`](crate::scene::cloud::StoredObject)).

use crate::simd::lanes::LANES;
use surfel_math::clip::Clip;
use surfel_math::mapping::Linear;
use surfel_model::{ClipPolicy, SplatCloud};

/// Index in place of a clip's, which marks a slot without a clip.
const NONE: u32 = u32::MAX;

/// Kind of a clip's curve, which decides how many linear forms are stored for the curve and how they are tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Curve {
    /// The clip has no curve, and no form is stored for it.
    Absent,
    /// The curve is replaced by its chord. One form is stored, at least 0 at the points that the splat retains.
    Chord,
    /// The splat retains the inside of the curve. Three forms are stored: [`Clip::chord`], [`Clip::side1`] and
    /// [`Clip::side3`].
    Inside,
    /// The splat retains the outside of the curve. The same three forms are stored as for [`Curve::Inside`].
    Outside,
}

impl Curve {
    #[inline(always)]
    pub(crate) fn forms(self) -> usize {
        match self {
            Self::Absent => 0,
            Self::Chord => 1,
            Self::Inside | Self::Outside => 3,
        }
    }
}

/// Number and kinds of a clip's linear forms, and where they are in a list of many clips' forms.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Head {
    /// Index of the clip's first form in the list.
    pub first: u32,
    /// Number of lines of the clip. Their forms precede the forms of the curve.
    pub lines: u8,
    /// True if the splat retains points inside at least one line, false if only points inside all lines. If true, the
    /// forms of the lines are negated.
    pub any_line: bool,
    pub curve: Curve,
    /// True if the forms for the unfiltered footprint are followed by as many for the filtered footprint.
    pub has_filtered: bool,
    /// True if fragments of the clipped, unfiltered footprint also belong to the filtered one (rendering model §7), as
    /// in oriented clouds.
    pub holds_visible: bool,
}

impl Head {
    #[inline(always)]
    pub(crate) fn forms(self) -> usize {
        usize::from(self.lines) + self.curve.forms()
    }
}

/// The clips of an object's splats, as forms over the splats' (u, v).
#[derive(Default)]
pub(crate) struct StoredClips {
    /// Index in `heads` of each slot's clip, or [`NONE`].
    of_slot: Vec<u32>,
    heads: Vec<Head>,
    forms: Vec<Linear<f32>>,
}

/// A stored clip, as the plan's [`ClipPolicy`] evaluates it.
#[derive(Clone, Copy)]
pub(crate) struct StoredClip<'a> {
    pub head: Head,
    pub lines: &'a [Linear<f32>],
    pub curve: &'a [Linear<f32>],
    /// Factor that turns the first form of the curve into the chord's form. `None` unless the policy replaces a curve,
    /// stored as such, by its chord.
    pub straightened: Option<f32>,
}

impl StoredClips {
    /// Adds the next slot of the object, with the clip of splat `i` of a cloud if it has one.
    pub(crate) fn push(&mut self, cloud: &SplatCloud, i: usize) {
        let Some(clip) = cloud.data().clips.as_ref().and_then(|c| c.clip(i, ClipPolicy::Exact)) else {
            self.of_slot.push(NONE);
            return;
        };
        self.of_slot.push(self.heads.len() as u32);
        let nothing = Clip::nothing();
        let lines = clip.lines.iter().rposition(|line| *line != nothing.lines[0]).map_or(0, |last| last + 1);
        // If a point is retained by any one line, a line that excludes every point looks like an absent line, but must
        // be stored.
        let lines = lines.max(usize::from(clip.line_sign < 0.0));
        let curve = if clip.chord == nothing.chord {
            Curve::Absent
        } else if clip.side1 == nothing.side1 && clip.side3 == nothing.side3 {
            Curve::Chord
        } else if clip.curve_sign < 0.0 {
            Curve::Outside
        } else {
            Curve::Inside
        };
        let (first, any_line) = (self.forms.len() as u32, clip.line_sign < 0.0);
        self.heads.push(Head { first, lines: lines as u8, any_line, curve, has_filtered: false, holds_visible: false });
        let clip = clip.map(|v| v as f32);
        self.forms.extend_from_slice(&clip.lines[..lines]);
        match curve {
            Curve::Absent => (),
            Curve::Chord => self.forms.push(times(&clip.chord, -1.0)),
            Curve::Inside | Curve::Outside => self.forms.extend([clip.chord, clip.side1, clip.side3]),
        }
    }

    /// Appends the clips of the object's next slots. Neither list may have forms for filtered footprints yet.
    pub(crate) fn append(&mut self, part: Self) {
        let (heads, forms) = (self.heads.len() as u32, self.forms.len() as u32);
        let slots = part.of_slot.into_iter().map(|clip| if clip == NONE { NONE } else { clip + heads });
        self.of_slot.extend(slots);
        self.heads.extend(part.heads.into_iter().map(|head| Head { first: head.first + forms, ..head }));
        self.forms.extend(part.forms);
    }

    /// True if no slot has a clip.
    pub(crate) fn is_empty(&self) -> bool {
        self.heads.is_empty()
    }

    /// Returns a word in which bit i is set if slot `at` + i has a clip, for i from 0 to 15.
    #[inline(always)]
    pub(crate) fn clipped(&self, at: usize) -> u64 {
        let slots = self.of_slot.get(at..).unwrap_or_default();
        (0..LANES).zip(slots).fold(0, |bits, (i, clip)| bits | u64::from(*clip != NONE) << i)
    }

    /// Returns the clip of a slot, as a policy evaluates it; `None` if the slot has no clip or the policy is `Off`.
    pub(crate) fn get(&self, slot: usize, policy: ClipPolicy) -> Option<StoredClip<'_>> {
        let mut head = *self.heads.get(*self.of_slot.get(slot)? as usize)?;
        let (first, lines) = (head.first as usize, usize::from(head.lines));
        let (lines, curve) = self.forms.get(first..first + head.forms())?.split_at_checked(lines)?;
        let straightened = match (policy, head.curve) {
            (ClipPolicy::Off, _) => return None,
            // The inside of the clip is where `chord` is at most 0.
            (ClipPolicy::Line, Curve::Inside) => Some(-1.0),
            (ClipPolicy::Line, Curve::Outside) => Some(1.0),
            _ => None,
        };
        if straightened.is_some() {
            head.curve = Curve::Chord;
        }
        Some(StoredClip { head, lines, curve, straightened })
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.of_slot.as_slice()) + size_of_val(self.heads.as_slice()) + size_of_val(self.forms.as_slice())
    }
}

#[inline(always)]
pub(crate) fn times(l: &Linear<f32>, k: f32) -> Linear<f32> {
    Linear { c: l.c * k, x: l.x * k, y: l.y * k }
}

impl StoredClip<'_> {
    /// Returns the clip as a [`Clip`] over (u, v). Forms that aren't stored are those of [`Clip::nothing`], which
    /// exclude no point.
    pub(crate) fn whole(&self) -> Clip<f64> {
        let wide = |l: &Linear<f32>| Linear { c: l.c.into(), x: l.x.into(), y: l.y.into() };
        let mut clip = Clip::nothing();
        for (line, form) in clip.lines.iter_mut().zip(self.lines) {
            *line = wide(form);
        }
        clip.line_sign = if self.head.any_line { -1.0 } else { 1.0 };
        match (self.head.curve, self.curve) {
            (Curve::Chord, [form, ..]) => clip.chord = wide(&times(form, -self.straightened.unwrap_or(1.0))),
            (curve, [chord, side1, side3]) => {
                (clip.chord, clip.side1, clip.side3) = (wide(chord), wide(side1), wide(side3));
                clip.curve_sign = if curve == Curve::Outside { -1.0 } else { 1.0 };
            }
            _ => (),
        }
        clip
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Vec3};
    use surfel_model::{ClipColumns, ClipLine, CloudData, Column3, NO_LINE, OnInvalid, Shape};

    #[test]
    fn parts_that_are_put_together_are_stored_as_one() {
        let column = |v: Vec3| Column3::from_f32(vec![v; 7]);
        let shape = Shape::Ellipses { s: column(Vec3::X), t: column(Vec3::Y) };
        let line = |i: usize| ClipLine { a: 1.0, b: 0.1 * i as f32, c: 0.5 };
        // Every other splat has lines: one, two, three and four.
        let lines =
            |i: usize| std::array::from_fn(|k| if i.is_multiple_of(2) && k <= i / 2 { line(i + k) } else { NO_LINE });
        let clips = ClipColumns { lines: Some((0..7).map(lines).collect()), ..ClipColumns::default() };
        let data = CloudData { clips: Some(clips), ..CloudData::new(DVec3::ZERO, column(Vec3::ZERO), shape) };
        let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
        let stored = |splats: std::ops::Range<usize>| {
            let mut stored = StoredClips::default();
            splats.for_each(|i| stored.push(&cloud, i));
            stored
        };
        let (whole, mut parts) = (stored(0..7), stored(0..3));
        parts.append(stored(3..4));
        parts.append(stored(4..7));
        assert_eq!(whole.clipped(0), 0b101_0101);
        assert_eq!(parts.clipped(0), whole.clipped(0));
        for slot in 0..7 {
            let [one, other] =
                [&whole, &parts].map(|clips| clips.get(slot, ClipPolicy::Exact).map(|clip| clip.whole()));
            assert_eq!(one, other, "{slot}");
        }
    }
}
