//! Clips of projected splats (rendering model §7), as linear forms over pixels, relative to the projected centres.
//!
//! A *cell* is a part of the view that one thread draws alone ([`Cell`](crate::cull::cells::Cell)). A *record* is a
//! splat projected to the screen ([`Record`](crate::setup::record::Record)).

use crate::scene::clips::{Curve, Head, StoredClip, times};
use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::{Simd, mask32x16};
use surfel_math::clip::{Clip, Turn, composed};
use surfel_math::mapping::{Footprint, Linear};
use surfel_math::{Real, V2};

/// Mapping from pixels to a splat's (u, v), in two steps: the footprint's (u', v'), and a turn from there.
#[derive(Clone, Copy)]
pub(crate) struct Mapping<'a> {
    pub footprint: &'a Footprint<f32>,
    /// Turn from the footprint's (u', v') to the splat's own (u, v).
    pub turn: &'a Turn<f32>,
}

/// Appends a clip's linear forms to `forms`, converted from forms over the splat's (u, v) to forms over pixels.
#[inline(always)]
fn push_forms(clip: &StoredClip<'_>, to: Mapping<'_>, forms: &mut Vec<Linear<f32>>) {
    for line in clip.lines {
        forms.push(composed(line, to.footprint, to.turn));
    }
    match (clip.straightened, clip.curve) {
        (Some(sign), [chord, ..]) => forms.push(composed(&times(chord, sign), to.footprint, to.turn)),
        (_, curve) => {
            for form in curve {
                forms.push(composed(form, to.footprint, to.turn));
            }
        }
    }
}

/// A list of clips of projected splats, as forms over pixels. Clips have consecutive numbers.
#[derive(Default)]
pub(crate) struct ScreenClips {
    heads: Vec<Head>,
    forms: Vec<Linear<f32>>,
    /// Number of the first clip in the list.
    first: u32,
}

impl ScreenClips {
    /// Clears the list; the next clip gets number `first`.
    pub(crate) fn restart(&mut self, first: u32) {
        self.heads.clear();
        self.forms.clear();
        self.first = first;
    }

    /// Adds a splat's clip, as forms over the pixels of the unfiltered footprint and, if it differs, of the filtered
    /// one. Returns the clip's number.
    #[inline(always)]
    pub(crate) fn push(
        &mut self,
        clip: &StoredClip<'_>,
        visible: Mapping<'_>,
        filtered: Option<Mapping<'_>>,
        holds_visible: bool,
    ) -> u32 {
        let number = self.first + self.heads.len() as u32;
        let first = self.forms.len() as u32;
        self.heads.push(Head { first, has_filtered: filtered.is_some(), holds_visible, ..clip.head });
        push_forms(clip, visible, &mut self.forms);
        if let Some(filtered) = filtered {
            push_forms(clip, filtered, &mut self.forms);
        }
        number
    }

    fn bytes(&self) -> usize {
        size_of_val(self.heads.as_slice()) + size_of_val(self.forms.as_slice())
    }
}

/// Clips of all splats of a cell. Each setup of chunks numbers its own clips uniquely, so that records need no
/// renumbering.
#[derive(Default)]
pub(crate) struct CellClips {
    /// Lists of clips, two for each setup of chunks: of its opaque splats, and of its transparent ones.
    lists: Vec<ScreenClips>,
}

/// Base-2 logarithm of the number of clip numbers reserved for each list. A list can't have more clips, because as many
/// splats would not fit into memory.
const SHIFT: u32 = 30;

impl CellClips {
    /// Returns the first clip numbers of the two lists of the next setup. 32 bits suffice for four lists, and a cell
    /// needs no more.
    pub(crate) fn next_numbers(&self) -> [u32; 2] {
        [0, 1].map(|list| ((self.lists.len() + list) as u32).wrapping_shl(SHIFT))
    }

    /// Appends the next list, whose numbers [`Self::next_numbers`] has reserved.
    pub(crate) fn push(&mut self, list: ScreenClips) {
        self.lists.push(list);
    }

    pub(crate) fn bytes(&self) -> usize {
        self.lists.iter().map(ScreenClips::bytes).sum()
    }

    /// Returns the number of clips in all lists.
    pub(crate) fn count(&self) -> usize {
        self.lists.iter().map(|list| list.heads.len()).sum()
    }

    /// Returns the clip with this number; `None` if no splat of the cell has it.
    #[inline(always)]
    pub(crate) fn get(&self, number: u32) -> Option<ScreenClip<'_>> {
        let list = self.lists.get((number >> SHIFT) as usize)?;
        let head = *list.heads.get(number.wrapping_sub(list.first) as usize)?;
        let (first, count) = (head.first as usize, head.forms());
        let visible = list.forms.get(first..first + count)?;
        let filtered = if head.has_filtered { Some(list.forms.get(first + count..first + 2 * count)?) } else { None };
        Some(ScreenClip { head, visible, filtered })
    }
}

/// The clip of a projected splat, as forms over the pixels of its unfiltered and its filtered footprint.
#[derive(Clone, Copy)]
pub(crate) struct ScreenClip<'a> {
    head: Head,
    /// Forms over the pixels of the unfiltered footprint.
    visible: &'a [Linear<f32>],
    /// Forms over the pixels of the filtered footprint; `None` if it equals the unfiltered one.
    filtered: Option<&'a [Linear<f32>]>,
}

impl ScreenClip<'_> {
    /// True if fragments of the clipped, unfiltered footprint also belong to the filtered one (rendering model §7).
    #[inline(always)]
    pub(crate) fn holds_visible(&self) -> bool {
        self.head.holds_visible
    }

    /// Returns masks of the pixels that the clip retains, for offsets in the unfiltered and the filtered footprint.
    #[inline(always)]
    pub(crate) fn keeps<S: Simd>(&self, visible: V2<Lanes<S>>, filtered: V2<Lanes<S>>) -> [mask32x16<S>; 2] {
        let keeps = self.forms_contain(self.visible, visible);
        match self.filtered {
            Some(forms) => [keeps, self.forms_contain(forms, filtered)],
            None => [keeps, keeps],
        }
    }

    #[inline(always)]
    fn forms_contain<S: Simd>(&self, forms: &[Linear<f32>], d: V2<Lanes<S>>) -> mask32x16<S> {
        let zero = d.x.zero();
        let (lines, curve) = forms.split_at_checked(usize::from(self.head.lines)).unwrap_or_default();
        let lines_keep = match lines.split_first() {
            None => zero.le(zero),
            Some((first, others)) => {
                // The same test as `Clip::lines_keep`, for the lines present.
                let mut least = widened(first, zero).at(d);
                for line in others {
                    least = least.min(widened(line, zero).at(d));
                }
                if self.head.any_line { least.le(zero) } else { zero.le(least) }
            }
        };
        match curve {
            [] => lines_keep,
            [chord] => lines_keep & zero.le(widened(chord, zero).at(d)),
            [chord, side1, side3, ..] => {
                let curve = Clip {
                    chord: widened(chord, zero),
                    side1: widened(side1, zero),
                    side3: widened(side3, zero),
                    curve_sign: zero.constant(if self.head.curve == Curve::Outside { -1.0 } else { 1.0 }),
                    lines: [Linear { c: zero, x: zero, y: zero }; 4],
                    line_sign: zero,
                };
                curve.curve_keeps(d) & lines_keep
            }
            _ => lines_keep,
        }
    }
}

#[inline(always)]
fn widened<S: Simd>(l: &Linear<f32>, like: Lanes<S>) -> Linear<Lanes<S>> {
    let simd = like.0.simd;
    Linear { c: Lanes::splat(simd, l.c), x: Lanes::splat(simd, l.x), y: Lanes::splat(simd, l.y) }
}

/// Returns the turn of each splat of a group, from their turns in lanes.
#[inline(always)]
pub(crate) fn turns<S: Simd>(turn: &Turn<Lanes<S>>) -> [Turn<f32>; LANES] {
    let Turn { first, second } = turn;
    let [a, b, c, d] = [first.x, first.y, second.x, second.y].map(Lanes::to_array);
    std::array::from_fn(|i| Turn { first: V2::new(a[i], b[i]), second: V2::new(c[i], d[i]) })
}
