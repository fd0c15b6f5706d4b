//! What a splat is on the screen, as the tile loops read it.

use crate::dots::DotLanes;
use crate::lanes::{LANES, Lanes};
use fearless_simd::Simd;
use surfel_math::mapping::{Footprint, Linear};

/// Which of the evaluators draws a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// Filtered and unfiltered footprint are the same, no fragment lies before z_near or beyond z_far, and the depth, of the
    /// exact mapping, differs by less than a 64th over the disk and by less than a 12th over its blocks.
    Shallow,
    /// The filtered footprint is another, and both are as shallow.
    Soft,
    /// [`Class::Shallow`] but for the depth.
    Plain,
    /// Everything else that is set up in lanes.
    General,
    /// A [dot](crate::dots): depths and weights are known pixel by pixel.
    Dot,
    /// A splat near the eye, set up in f64: [`Record::object`] is its index among the segment's near splats.
    Near,
}

impl Class {
    /// All of them.
    pub(crate) const ALL: [Self; 6] = [Self::Shallow, Self::Soft, Self::Plain, Self::General, Self::Dot, Self::Near];

    /// Name of the counter of its records.
    pub(crate) fn counter(self) -> &'static str {
        match self {
            Self::Shallow => "records_shallow",
            Self::Soft => "records_soft",
            Self::Plain => "records_plain",
            Self::General => "records_general",
            Self::Dot => "records_dot",
            Self::Near => "records_near",
        }
    }
}

/// What can be done with four splats together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Together {
    /// All are shallow, and none has a clip.
    Simple,
    /// All are shallow or soft, and none has a clip.
    Soft,
    Nothing,
}

impl Together {
    #[inline(always)]
    pub(crate) fn of([a, b, c, d]: &[&Record; 4]) -> Self {
        match any([a, b, c, d]) {
            0 => Self::Simple,
            1 => Self::Soft,
            _ => Self::Nothing,
        }
    }
}

/// All set bits of four splats' classes.
#[inline(always)]
fn any([a, b, c, d]: [&Record; 4]) -> u32 {
    let bits = |bits: f32| bits.to_bits();
    bits(a.class_bits()) | bits(b.class_bits()) | bits(c.class_bits()) | bits(d.class_bits())
}

/// Among the bits of a class: the splat has a clip.
const CLIPPED: u32 = 64;

/// [`Class::Dot`] as bits: of four pixels, and of nine.
pub(crate) const DOT_BITS: [u32; 2] = [16, 32];

/// Numbers of a record.
pub(crate) const FIELDS: usize = 32;

/// A splat's footprint and attributes, two cache lines. All forms are about the anchor, the projected centre, in pixels.
///
/// The first line is what a plain splat's footprint needs; fields are read by name through the methods. Aligned to both:
/// processors fetch lines in such pairs.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(128))]
pub(crate) struct Record(pub(crate) [f32; FIELDS]);

macro_rules! fields {
    ($($(#[$doc:meta])* $name:ident = $at:literal;)*) => {
        impl Record {
            $($(#[$doc])* #[inline(always)] pub(crate) fn $name(&self) -> f32 { self.0[$at] })*
        }

        /// The lanes of sixteen records, field by field.
        #[derive(Clone, Copy)]
        pub(crate) struct RecordLanes<S: Simd> {
            $(pub $name: Lanes<S>,)*
        }

        impl<S: Simd> RecordLanes<S> {
            /// One record in all lanes. What isn't used costs nothing.
            #[inline(always)]
            pub(crate) fn splat(simd: S, record: &Record) -> Self {
                Self { $($name: Lanes::splat(simd, record.$name()),)* }
            }

            #[inline(always)]
            fn to_fields(self) -> [[Lanes<S>; LANES]; 2] {
                let zero = Lanes::splat(self.base_x.0.simd, 0.0);
                let mut fields = [[zero; LANES]; 2];
                $(fields[$at / LANES][$at % LANES] = self.$name;)*
                fields
            }
        }
    };
}

fields! {
    /// Column of the anchor's pixel.
    base_x = 0;
    base_y = 1;
    /// ε.
    epsilon = 2;
    /// No fragment of the splat is nearer.
    z_min = 3;
    /// [`Class`], as bits: each class one of its own, and none for a shallow splat; and one for a clip.
    class_bits = 4;
    /// From the anchor to its pixel's centre: ½ less the anchor's fraction.
    offset_x = 5;
    offset_y = 6;
    /// Gradients of the filtered (u·w', v·w').
    u_x = 7;
    u_y = 8;
    v_x = 9;
    v_y = 10;
    /// Gradient of the plane's depth: of p_z/z (perspective), or of z.
    depth_x = 11;
    depth_y = 12;
    /// Depth at the anchor.
    z = 13;
    /// Range of the depth form over the disk: of p_z/z, or of z. Of a soft splat of p_z/z − 1; of a shallow one all there is.
    range_min = 14;
    range_max = 15;
    /// Gradients of the unfiltered (u·w', v·w').
    visible_u_x = 16;
    visible_u_y = 17;
    visible_v_x = 18;
    visible_v_y = 19;
    /// Gradient of the filtered w'.
    w_x = 20;
    w_y = 21;
    /// Factor of the weight.
    weight_scale = 22;
    red = 23;
    green = 24;
    blue = 25;
    /// World shading normal, turned to the eye where the material is two-sided.
    normal_x = 26;
    normal_y = 27;
    normal_z = 28;
    /// Coverage of a unit of weight, but for the cloud's W0.
    coverage_scale = 29;
    /// Index of the object, for its material; of a near splat its own. As bits.
    object_bits = 30;
    /// 1 more than the number of the splat's clip, 0 without one. As bits.
    clip_bits = 31;
}

/// The first of the eighteen fields of forms, in which a [dot](crate::dots) has its depths and weights.
pub(crate) const FORMS: usize = 5;

/// The field of the class, and the first of a colour and a normal.
pub(crate) const CLASS: usize = 4;
pub(crate) const COLOR: usize = 23;

impl Record {
    #[inline(always)]
    pub(crate) fn class(&self) -> Class {
        match self.class_bits().to_bits() & !CLIPPED {
            0 => Class::Shallow,
            1 => Class::Soft,
            2 => Class::Plain,
            4 => Class::General,
            16 | 32 => Class::Dot,
            _ => Class::Near,
        }
    }

    /// Side of a dot, in pixels.
    #[inline(always)]
    pub(crate) fn dot_side(&self) -> usize {
        if self.class_bits().to_bits() == DOT_BITS[0] { 2 } else { 3 }
    }

    #[inline(always)]
    pub(crate) fn object(&self) -> usize {
        self.object_bits().to_bits() as usize
    }

    /// The unfiltered footprint about the anchor. Not of a near splat.
    #[inline(always)]
    pub(crate) fn visible_footprint(&self, projective: bool) -> Footprint<f32> {
        let (x, y) = if projective { (self.depth_x(), self.depth_y()) } else { (0.0, 0.0) };
        Footprint {
            u: Linear { c: 0.0, x: self.visible_u_x(), y: self.visible_u_y() },
            v: Linear { c: 0.0, x: self.visible_v_x(), y: self.visible_v_y() },
            w: Linear { c: 1.0, x, y },
        }
    }

    /// The filtered footprint about the anchor. Not of a near splat.
    #[inline(always)]
    pub(crate) fn filtered_footprint(&self) -> Footprint<f32> {
        Footprint {
            u: Linear { c: 0.0, x: self.u_x(), y: self.u_y() },
            v: Linear { c: 0.0, x: self.v_x(), y: self.v_y() },
            w: Linear { c: 1.0, x: self.w_x(), y: self.w_y() },
        }
    }

    /// Number of the clip.
    #[inline(always)]
    pub(crate) fn clip(&self) -> Option<u32> {
        self.clip_bits().to_bits().checked_sub(1)
    }

    pub(crate) fn set_clip(&mut self, number: u32) {
        self.0[31] = f32::from_bits(number.wrapping_add(1));
        self.0[CLASS] = f32::from_bits(self.class_bits().to_bits() | CLIPPED);
    }

    /// Colour and normal.
    #[inline(always)]
    pub(crate) fn attributes(&self) -> [f32; 6] {
        [self.red(), self.green(), self.blue(), self.normal_x(), self.normal_y(), self.normal_z()]
    }

    /// Moves the index of a near splat.
    pub(crate) fn renumber(&mut self, first_near: usize) {
        if self.class() == Class::Near {
            self.0[30] = f32::from_bits((self.object() + first_near) as u32);
        }
    }

    /// Stands for a near splat in the tiles' lists.
    pub(crate) fn near(index: usize, z_min: f32, color: [f32; 3], normal: [f32; 3], epsilon: f32) -> Self {
        let mut fields = [0.0; FIELDS];
        fields[2] = epsilon;
        fields[3] = z_min;
        fields[CLASS] = f32::from_bits(8);
        fields[COLOR..COLOR + 3].copy_from_slice(&color);
        fields[COLOR + 3..COLOR + 6].copy_from_slice(&normal);
        fields[29] = 1.0;
        fields[30] = f32::from_bits(index as u32);
        Self(fields)
    }
}

/// A shallow splat without a fragment anywhere.
pub(crate) static NOWHERE: Record = {
    let mut fields = [0.0; FIELDS];
    fields[0] = f32::NAN;
    Record(fields)
};

/// Records, or what is as short-lived, of which the memory is kept when they are cleared: what is written is written once.
#[derive(Default)]
pub(crate) struct Slots<T> {
    /// Those past `used` are left from before.
    slots: Vec<T>,
    used: usize,
}

/// Records of some splats.
pub(crate) type Records = Slots<Record>;

impl<T: Copy + Default> Slots<T> {
    pub(crate) fn clear(&mut self) {
        self.used = 0;
    }

    /// Makes room for more, sixteen that are written together included.
    pub(crate) fn make_room(&mut self, more: usize) {
        let length = self.used + more + LANES;
        if self.slots.len() < length {
            self.slots.resize(length, T::default());
        }
    }

    /// Writes those of sixteen that are in `keep`, as bits, for which there is room: index of the first.
    #[inline(always)]
    pub(crate) fn write_sixteen(&mut self, keep: u64, write: impl Fn(usize, &mut T)) -> u32 {
        let first = self.used;
        let room = self.slots.get_mut(first..).and_then(|slots| slots.first_chunk_mut::<LANES>());
        debug_assert!(room.is_some());
        if let Some(room) = room {
            let mut at = 0;
            for i in 0..LANES {
                // Written over by the next one if it isn't kept.
                write(i, &mut room[at % LANES]);
                at += (keep >> i & 1) as usize;
            }
            self.used += at;
        }
        first as u32
    }
}

impl Records {
    pub(crate) fn push(&mut self, record: Record) {
        self.make_room(1);
        if let Some(slot) = self.slots.get_mut(self.used) {
            *slot = record;
            self.used += 1;
        }
    }

    /// Appends those of sixteen that are in `keep`, as bits, for which there is room: index of the first.
    #[inline(always)]
    pub(crate) fn push_sixteen<S: Simd>(
        &mut self,
        records: RecordLanes<S>,
        dots: Option<&DotLanes<S>>,
        keep: u64,
    ) -> u32 {
        let mut fields = records.to_fields();
        if let Some(dots) = dots {
            dots.write(&mut fields);
        }
        let [low, high] = fields;
        let (low, high) = (Lanes::transpose(low), Lanes::transpose(high));
        self.write_sixteen(
            keep,
            #[inline(always)]
            |i, record| {
                low[i].store(&mut record.0);
                high[i].store(&mut record.0[LANES..]);
            },
        )
    }

    pub(crate) fn get_mut(&mut self, index: usize) -> Option<&mut Record> {
        self.slots[..self.used].get_mut(index)
    }

    pub(crate) fn iter_mut(&mut self) -> std::slice::IterMut<'_, Record> {
        self.slots[..self.used].iter_mut()
    }
}

impl<T> std::ops::Deref for Slots<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.slots[..self.used]
    }
}

/// Blocks that a splat may touch: first column, first row, end column, end row, in blocks from the grid's origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BlockBox(pub [u32; 4]);

impl<S: Simd> RecordLanes<S> {
    /// The sixteen records.
    #[inline(always)]
    pub(crate) fn transposed(self) -> [Record; LANES] {
        let [low, high] = self.to_fields();
        let (low, high) = (Lanes::transpose(low), Lanes::transpose(high));
        let mut records = [Record([0.0; FIELDS]); LANES];
        for i in 0..LANES {
            low[i].store(&mut records[i].0);
            high[i].store(&mut records[i].0[LANES..]);
        }
        records
    }
}
