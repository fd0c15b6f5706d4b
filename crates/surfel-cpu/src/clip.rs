//! Clips of splats (§7): how they are stored, and what a frame makes of them.
//!
//! Most clips are a line or two: of each only the forms that there are are kept, in one list for many splats.

use crate::lanes::{LANES, Lanes};
use fearless_simd::{Simd, mask32x16};
use surfel_math::clip::{Clip, Turn, composed};
use surfel_math::mapping::{Footprint, Linear};
use surfel_math::{Real, V2};
use surfel_model::{ClipPolicy, SplatCloud};

/// Index of a splat without a clip.
const NONE: u32 = u32::MAX;

/// What a clip's forms after its lines are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Curve {
    /// There are none.
    Absent,
    /// One, at least 0 where it keeps: a curve taken for its chord.
    Chord,
    /// [`Clip::chord`], `side1` and `side3`; the inside is kept.
    Inside,
    /// The same; the outside is kept.
    Outside,
}

impl Curve {
    #[inline(always)]
    fn forms(self) -> usize {
        match self {
            Self::Absent => 0,
            Self::Chord => 1,
            Self::Inside | Self::Outside => 3,
        }
    }
}

/// Which forms a clip has, in a list of many clips' forms.
#[derive(Clone, Copy, Debug)]
struct Head {
    /// Index of the first.
    first: u32,
    /// They come first: times −1 where one that keeps is enough.
    lines: u8,
    any_line: bool,
    curve: Curve,
    /// The forms over the unfiltered footprint are followed by as many over the filtered one.
    has_filtered: bool,
}

impl Head {
    #[inline(always)]
    fn forms(self) -> usize {
        usize::from(self.lines) + self.curve.forms()
    }
}

/// The clips of an object's splats, over their (u, v).
#[derive(Default)]
pub(crate) struct StoredClips {
    /// Of every slot of the object's columns.
    of_slot: Vec<u32>,
    heads: Vec<Head>,
    forms: Vec<Linear<f32>>,
}

/// A stored clip under a policy.
#[derive(Clone, Copy)]
pub(crate) struct StoredClip<'a> {
    head: Head,
    lines: &'a [Linear<f32>],
    curve: &'a [Linear<f32>],
    /// The curve's first form is to be its only one, so many times.
    straightened: Option<f32>,
}

impl StoredClips {
    /// Adds the next slot: splat `i` of a cloud.
    pub(crate) fn push(&mut self, cloud: &SplatCloud, i: usize) {
        let Some(clip) = cloud.data().clips.as_ref().and_then(|c| c.clip(i, ClipPolicy::Exact)) else {
            self.of_slot.push(NONE);
            return;
        };
        self.of_slot.push(self.heads.len() as u32);
        let nothing = Clip::nothing();
        let lines = clip.lines.iter().rposition(|line| *line != nothing.lines[0]).map_or(0, |last| last + 1);
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
        self.heads.push(Head { first, lines: lines as u8, any_line, curve, has_filtered: false });
        let clip = clip.map(|v| v as f32);
        self.forms.extend_from_slice(&clip.lines[..lines]);
        match curve {
            Curve::Absent => (),
            Curve::Chord => self.forms.push(times(&clip.chord, -1.0)),
            Curve::Inside | Curve::Outside => self.forms.extend([clip.chord, clip.side1, clip.side3]),
        }
    }

    /// True if no slot has a clip.
    pub(crate) fn is_empty(&self) -> bool {
        self.heads.is_empty()
    }

    /// Which of sixteen slots from `at` on have a clip, as bits.
    #[inline(always)]
    pub(crate) fn clipped(&self, at: usize) -> u64 {
        let slots = self.of_slot.get(at..).unwrap_or_default();
        (0..LANES).zip(slots).fold(0, |bits, (i, clip)| bits | u64::from(*clip != NONE) << i)
    }

    /// The clip of a slot under a policy.
    pub(crate) fn get(&self, slot: usize, policy: ClipPolicy) -> Option<StoredClip<'_>> {
        let mut head = *self.heads.get(*self.of_slot.get(slot)? as usize)?;
        let (first, lines) = (head.first as usize, usize::from(head.lines));
        let (lines, curve) = self.forms.get(first..first + head.forms())?.split_at_checked(lines)?;
        let straightened = match (policy, head.curve) {
            (ClipPolicy::Off, _) => return None,
            // Kept is where `chord` is at most 0.
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
fn times(l: &Linear<f32>, k: f32) -> Linear<f32> {
    Linear { c: l.c * k, x: l.x * k, y: l.y * k }
}

impl StoredClip<'_> {
    /// All of it, over (u, v).
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

    /// Appends its forms over pixels, seen through a footprint.
    #[inline(always)]
    fn push_through(&self, (footprint, turn): Seen<'_>, forms: &mut Vec<Linear<f32>>) {
        for line in self.lines {
            forms.push(composed(line, footprint, turn));
        }
        match (self.straightened, self.curve) {
            (Some(sign), [chord, ..]) => forms.push(composed(&times(chord, sign), footprint, turn)),
            (_, curve) => {
                for form in curve {
                    forms.push(composed(form, footprint, turn));
                }
            }
        }
    }
}

/// A footprint, and the turn from its (u, v) to the given ones.
pub(crate) type Seen<'a> = (&'a Footprint<f32>, &'a Turn<f32>);

/// Clips over pixels of some splats of a frame.
#[derive(Default)]
pub(crate) struct ScreenClips {
    heads: Vec<Head>,
    forms: Vec<Linear<f32>>,
    /// Number of the first one in the frame.
    first: u32,
}

impl ScreenClips {
    /// Empties it; the next clip has this number.
    pub(crate) fn restart(&mut self, first: u32) {
        self.heads.clear();
        self.forms.clear();
        self.first = first;
    }

    /// Adds a clip as a splat's unfiltered footprint sees it and, if that is another, as the filtered one does: its number.
    #[inline(always)]
    pub(crate) fn push(&mut self, clip: &StoredClip<'_>, visible: Seen<'_>, filtered: Option<Seen<'_>>) -> u32 {
        let number = self.first + self.heads.len() as u32;
        let first = self.forms.len() as u32;
        self.heads.push(Head { first, has_filtered: filtered.is_some(), ..clip.head });
        clip.push_through(visible, &mut self.forms);
        if let Some(filtered) = filtered {
            clip.push_through(filtered, &mut self.forms);
        }
        number
    }

    fn bytes(&self) -> usize {
        size_of_val(self.heads.as_slice()) + size_of_val(self.forms.as_slice())
    }
}

/// Clips of all splats of a frame. Tasks number theirs on their own, so that nobody has to go over records afterwards.
pub(crate) struct FrameClips {
    /// Each list has as many numbers as its task has splats, or more: 2 to this.
    shift: u32,
    /// Two a task.
    lists: Vec<ScreenClips>,
}

impl Default for FrameClips {
    /// For two tasks of any size.
    fn default() -> Self {
        Self { shift: 30, lists: Vec::new() }
    }
}

impl FrameClips {
    /// For tasks of this many splats at most.
    pub(crate) fn new(splats: usize) -> Self {
        // Records of 2³² splats are 512 GiB: numbers don't run out before memory does.
        Self { shift: (usize::BITS - splats.leading_zeros()).min(30), lists: Vec::new() }
    }

    /// The first numbers of the two lists of the task that is the n-th from now.
    pub(crate) fn first_of(&self, task: usize) -> [u32; 2] {
        [0, 1].map(|list| ((self.lists.len() + 2 * task + list) as u32).wrapping_shl(self.shift))
    }

    /// Adds the next list.
    pub(crate) fn push(&mut self, list: ScreenClips) {
        self.lists.push(list);
    }

    pub(crate) fn bytes(&self) -> usize {
        self.lists.iter().map(ScreenClips::bytes).sum()
    }

    /// How many clips there are.
    pub(crate) fn count(&self) -> usize {
        self.lists.iter().map(|list| list.heads.len()).sum()
    }

    /// The clip of this number.
    #[inline(always)]
    pub(crate) fn get(&self, number: u32) -> Option<ScreenClip<'_>> {
        let list = self.lists.get((number >> self.shift) as usize)?;
        let head = *list.heads.get(number.wrapping_sub(list.first) as usize)?;
        let (first, count) = (head.first as usize, head.forms());
        let visible = list.forms.get(first..first + count)?;
        let filtered = if head.has_filtered { Some(list.forms.get(first + count..first + 2 * count)?) } else { None };
        Some(ScreenClip { head, visible, filtered })
    }
}

/// A splat's clip over pixels, as its two footprints see it.
#[derive(Clone, Copy)]
pub(crate) struct ScreenClip<'a> {
    head: Head,
    visible: &'a [Linear<f32>],
    /// Absent where the footprints are the same.
    filtered: Option<&'a [Linear<f32>]>,
}

impl ScreenClip<'_> {
    /// Pixels at these offsets that the unfiltered and the filtered footprint keep.
    #[inline(always)]
    pub(crate) fn keeps<S: Simd>(&self, visible: V2<Lanes<S>>, filtered: V2<Lanes<S>>) -> [mask32x16<S>; 2] {
        let keeps = self.part_keeps(self.visible, visible);
        match self.filtered {
            Some(forms) => [keeps, self.part_keeps(forms, filtered)],
            None => [keeps, keeps],
        }
    }

    #[inline(always)]
    fn part_keeps<S: Simd>(&self, forms: &[Linear<f32>], d: V2<Lanes<S>>) -> mask32x16<S> {
        let zero = d.x.zero();
        let (lines, curve) = forms.split_at_checked(usize::from(self.head.lines)).unwrap_or_default();
        let lines_keep = match lines.split_first() {
            None => zero.le(zero),
            Some((first, others)) => {
                // As `Clip::lines_keep`, of the lines that there are.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Options, Renderer};
    use glam::{DVec3, Vec3};
    use surfel_model::{
        Camera, ClipColumns, ClipLine, CloudData, Column3, NO_LINE, OnInvalid, Projection, Scene, Settings, Shape,
    };
    use surfel_render::{Frame, Planes, Renderer as _, View};

    /// Forty ellipses in a row, of which the first `clipped` have a line each.
    fn row(clipped: Option<usize>) -> Scene {
        const COUNT: usize = 40;
        let same = |v: [f32; 3]| Column3::from_f32(vec![Vec3::from(v); COUNT]);
        let shape = Shape::Ellipses { s: same([0.1, 0.0, 0.0]), t: same([0.0, 0.1, 0.0]) };
        let half = [ClipLine { a: 1.0, b: 0.0, c: 0.0 }, NO_LINE, NO_LINE, NO_LINE];
        let lines = |n| (0..COUNT).map(|i| if i < n { half } else { [NO_LINE; 4] }).collect();
        let clips = clipped.map(|n| ClipColumns { lines: Some(lines(n)), ..ClipColumns::default() });
        let centers = (0..COUNT).map(|i| Vec3::new(0.05 * (i as f32 - 20.0), 0.0, 0.0)).collect();
        let data = CloudData { clips, ..CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape) };
        Scene::of_cloud(SplatCloud::new(data, OnInvalid::Refuse).unwrap().0)
    }

    /// Resident bytes, clips that a frame sets up, and its weights.
    fn drawn(scene: &Scene, clip: ClipPolicy) -> (usize, f64, Vec<f32>) {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 3.0], [0.0, 1.0, 0.0], [64, 64]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        let mut renderer = Renderer::with_options(&Options { threads: 1, ..Options::default() }).unwrap();
        let resident = renderer.upload(scene).unwrap();
        let mut frame = Frame::default();
        let settings = Settings { clip, ..Settings::default() };
        let stats = renderer.render(&resident, &view, &settings, Planes::ALL, &mut frame).unwrap();
        assert_eq!(stats.drawn, 40);
        let clips = stats.counters.iter().find(|(name, _)| *name == "clips").unwrap().1;
        (resident.bytes(), clips, frame.weight)
    }

    #[test]
    fn only_splats_with_a_clip_pay_for_it() {
        let plain = drawn(&row(None), ClipPolicy::Exact);
        assert_eq!(plain.1, 0.0);
        // Columns of clips with nothing in them: no memory, no clip in a frame, and the same picture.
        assert!(drawn(&row(Some(0)), ClipPolicy::Exact) == plain);
        let (bytes, clips, weights) = drawn(&row(Some(13)), ClipPolicy::Exact);
        // A number for each of the 48 slots, and 13 clips of one form.
        assert_eq!(bytes - plain.0, 48 * size_of::<u32>() + 13 * (size_of::<Head>() + size_of::<Linear<f32>>()));
        assert_eq!(clips, 13.0);
        assert!(weights != plain.2);
        let (_, clips, weights) = drawn(&row(Some(13)), ClipPolicy::Off);
        assert_eq!(clips, 0.0);
        assert!(weights == plain.2);
        assert_eq!(drawn(&row(Some(40)), ClipPolicy::Line).1, 40.0);
    }
}
