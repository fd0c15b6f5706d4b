//! Records: splats on the screen, as the tile loops read them.

use crate::setup::tiny::TinyLanes;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::bins::RECORD_BYTES;
use crate::tiles::lists::Listable;
use crate::tiles::pool::Reused;
use fearless_simd::Simd;
use surfel_math::mapping::{Footprint, Linear};

/// Class of a record, which selects the evaluator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// A splat whose fragments all are between z_near and z_far, with the exact mapping and a nearly constant depth.
    /// The depth differs by less than a 64th over the disk and by less than a 12th over its blocks.
    Cheap,
    /// Every other splat that is set up in lanes.
    General,
    /// A [tiny splat](crate::setup::tiny): its depths and weights are stored pixel by pixel.
    Tiny,
    /// A splat near the eye, set up in f64: [`Record::object`] is its index among the segment's near splats.
    Near,
}

/// Facing of a splat: the side of its surface that the splat shows, if facings are separated (§5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Facing {
    /// The splat's cloud isn't oriented, or the plan doesn't separate facings.
    Undeclared,
    Front,
    Back,
}

/// Position of the facing among the bits of an object's index.
const FACING: u32 = 30;

impl Facing {
    /// Returns the facing of a splat of an oriented cloud.
    pub(crate) fn of(back_facing: bool) -> Self {
        if back_facing { Self::Back } else { Self::Front }
    }

    /// Returns an object's index with the facing in its high bits.
    pub(crate) fn with_object(self, object: u32) -> u32 {
        object | (self as u32) << FACING
    }
}

/// Class bits of a cheap splat whose filtered and unfiltered footprints are equal.
pub(crate) const UNFILTERED: u32 = 0;
/// Class bits of any other cheap splat.
pub(crate) const FILTERED: u32 = 1;
/// Class bits of a general splat.
pub(crate) const GENERAL: u32 = 4;
/// Class bits of a splat near the eye.
const NEAR: u32 = 8;
/// Class bits of tiny splats of 2×2 and of 3×3 pixels.
pub(crate) const TINY: [u32; 2] = [16, 32];

/// Bit of a class that marks a splat with a clip.
const CLIPPED: u32 = 64;

/// Method by which a batch of 4 splats is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Batch {
    /// Together: all are cheap and unfiltered, and none has a clip.
    Unfiltered,
    /// Together: all are cheap, and none has a clip.
    Filtered,
    /// One by one: some splat isn't cheap or has a clip.
    Scalar,
}

impl Batch {
    #[inline(always)]
    pub(crate) fn of([a, b, c, d]: &[&Record; 4]) -> Self {
        match any([a, b, c, d]) {
            0 => Self::Unfiltered,
            1 => Self::Filtered,
            _ => Self::Scalar,
        }
    }
}

/// Returns the union of four splats' class bits.
#[inline(always)]
fn any([a, b, c, d]: [&Record; 4]) -> u32 {
    let bits = |bits: f32| bits.to_bits();
    bits(a.class_bits()) | bits(b.class_bits()) | bits(c.class_bits()) | bits(d.class_bits())
}

/// Number of fields of a record.
pub(crate) const FIELDS: usize = 32;

/// A splat's footprint and attributes, in two cache lines. All forms are relative to the anchor, the projected centre,
/// in pixels.
///
/// The first line has the data of an unfiltered splat's footprint. Fields are read by name through the methods. The
/// alignment covers both lines: CPUs fetch lines in such pairs.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(128))]
pub(crate) struct Record(pub(crate) [f32; FIELDS]);

macro_rules! fields {
    ($($(#[$doc:meta])* $name:ident = $at:literal;)*) => {
        impl Record {
            $($(#[$doc])* #[inline(always)] pub(crate) fn $name(&self) -> f32 { self.0[$at] })*
        }

        /// The records of a group in lanes, field by field.
        #[derive(Clone, Copy)]
        pub(crate) struct RecordLanes<S: Simd> {
            $(pub $name: Lanes<S>,)*
        }

        impl<S: Simd> RecordLanes<S> {
            /// Loads one record into all lanes. Unused fields cost nothing.
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
    /// Row of the anchor's pixel.
    base_y = 1;
    /// Depth tolerance ε, in world units.
    epsilon = 2;
    /// Lower bound of the depth of the splat's fragments: [`Listable::z_min`].
    nearest = 3;
    /// Bits of the [`Class`], and one more bit that marks a splat with a clip.
    class_bits = 4;
    /// Offset in x from the anchor to its pixel's centre: ½ minus the anchor's fraction.
    offset_x = 5;
    /// Offset in y from the anchor to its pixel's centre.
    offset_y = 6;
    /// Change of u·w' per pixel to the right, in the filtered footprint.
    u_x = 7;
    /// Change of u·w' per pixel down, in the filtered footprint.
    u_y = 8;
    /// Change of v·w' per pixel to the right, in the filtered footprint.
    v_x = 9;
    /// Change of v·w' per pixel down, in the filtered footprint.
    v_y = 10;
    /// Change of the plane's depth form per pixel to the right: of p_z/z (perspective), or of z.
    depth_x = 11;
    /// Change of the plane's depth form per pixel down.
    depth_y = 12;
    /// Depth at the anchor, in world units.
    z = 13;
    /// Minimum over the disk of the depth form, p_z/z or z. For a filtered cheap splat it is the minimum of p_z/z − 1;
    /// for an unfiltered one it is unlimited.
    range_min = 14;
    /// Maximum over the disk of the same form.
    range_max = 15;
    /// Change of u·w' per pixel to the right, in the unfiltered footprint.
    visible_u_x = 16;
    /// Change of u·w' per pixel down, in the unfiltered footprint.
    visible_u_y = 17;
    /// Change of v·w' per pixel to the right, in the unfiltered footprint.
    visible_v_x = 18;
    /// Change of v·w' per pixel down, in the unfiltered footprint.
    visible_v_y = 19;
    /// Change of w' per pixel to the right, in the filtered footprint.
    w_x = 20;
    /// Change of w' per pixel down, in the filtered footprint.
    w_y = 21;
    /// Factor of the kernel's weight, which the filter sets.
    weight_scale = 22;
    red = 23;
    green = 24;
    blue = 25;
    /// World shading normal in x, turned to the eye if the material is two-sided.
    normal_x = 26;
    /// World shading normal in y.
    normal_y = 27;
    /// World shading normal in z.
    normal_z = 28;
    /// Coverage per unit of weight, without the factor of the cloud's W0.
    coverage_scale = 29;
    /// Bits of the object's index, for its material, or of a near splat's own index. The two highest bits are the
    /// facing.
    object_bits = 30;
    /// Bits of 1 plus the number of the splat's clip; 0 without a clip.
    clip_bits = 31;
}

/// First of the eighteen fields of forms, in which a [tiny splat](crate::setup::tiny) stores depths and weights.
pub(crate) const FORMS: usize = 5;

const _: () = assert!(size_of::<Record>() == RECORD_BYTES, "lists count records by their bytes");

/// Index of the field [`Listable::z_min`] in a record.
const Z_MIN: usize = 3;

/// Index of the field of the class in a record.
pub(crate) const CLASS: usize = 4;
/// First of the colour's three fields. The normal's three fields follow.
pub(crate) const COLOR: usize = 23;

impl Record {
    #[inline(always)]
    pub(crate) fn class(&self) -> Class {
        match self.class_bits().to_bits() & !CLIPPED {
            UNFILTERED | FILTERED => Class::Cheap,
            GENERAL => Class::General,
            NEAR => Class::Near,
            _ => Class::Tiny,
        }
    }

    /// True for cheap and general splats whose filtered footprint may differ from the unfiltered one.
    #[inline(always)]
    pub(crate) fn is_filtered(&self) -> bool {
        matches!(self.class_bits().to_bits() & !CLIPPED, FILTERED | GENERAL)
    }

    /// Returns the side of a tiny splat, in pixels.
    #[inline(always)]
    pub(crate) fn tiny_side(&self) -> usize {
        if self.class_bits().to_bits() == TINY[0] { 2 } else { 3 }
    }

    #[inline(always)]
    pub(crate) fn object(&self) -> usize {
        (self.object_bits().to_bits() & ((1 << FACING) - 1)) as usize
    }

    #[inline(always)]
    pub(crate) fn facing(&self) -> Facing {
        match self.object_bits().to_bits() >> FACING {
            1 => Facing::Front,
            2 => Facing::Back,
            _ => Facing::Undeclared,
        }
    }

    /// Returns the unfiltered footprint relative to the anchor; undefined for a near splat.
    #[inline(always)]
    pub(crate) fn visible_footprint(&self, projective: bool) -> Footprint<f32> {
        let (x, y) = if projective { (self.depth_x(), self.depth_y()) } else { (0.0, 0.0) };
        Footprint {
            u: Linear { c: 0.0, x: self.visible_u_x(), y: self.visible_u_y() },
            v: Linear { c: 0.0, x: self.visible_v_x(), y: self.visible_v_y() },
            w: Linear { c: 1.0, x, y },
        }
    }

    /// Returns the filtered footprint relative to the anchor; undefined for a near splat.
    #[inline(always)]
    pub(crate) fn filtered_footprint(&self) -> Footprint<f32> {
        Footprint {
            u: Linear { c: 0.0, x: self.u_x(), y: self.u_y() },
            v: Linear { c: 0.0, x: self.v_x(), y: self.v_y() },
            w: Linear { c: 1.0, x: self.w_x(), y: self.w_y() },
        }
    }

    /// Returns the number of the clip.
    #[inline(always)]
    pub(crate) fn clip(&self) -> Option<u32> {
        self.clip_bits().to_bits().checked_sub(1)
    }

    pub(crate) fn set_clip(&mut self, number: u32) {
        self.0[31] = f32::from_bits(number.wrapping_add(1));
        self.0[CLASS] = f32::from_bits(self.class_bits().to_bits() | CLIPPED);
    }

    /// Returns the colour and the normal.
    #[inline(always)]
    pub(crate) fn attributes(&self) -> [f32; 6] {
        [self.red(), self.green(), self.blue(), self.normal_x(), self.normal_y(), self.normal_z()]
    }

    /// Adds an offset to the index of a near splat.
    pub(crate) fn renumber(&mut self, first_near: usize) {
        if self.class() == Class::Near {
            self.0[30] = f32::from_bits(self.facing().with_object((self.object() + first_near) as u32));
        }
    }

    /// Creates the record that represents a near splat in the tiles' lists.
    pub(crate) fn near(index: u32, z_min: f32, color: [f32; 3], normal: [f32; 3], epsilon: f32) -> Self {
        let mut fields = [0.0; FIELDS];
        fields[2] = epsilon;
        fields[Z_MIN] = z_min;
        fields[CLASS] = f32::from_bits(NEAR);
        fields[COLOR..COLOR + 3].copy_from_slice(&color);
        fields[COLOR + 3..COLOR + 6].copy_from_slice(&normal);
        fields[29] = 1.0;
        fields[30] = f32::from_bits(index);
        Self(fields)
    }
}

/// A record without any fragment, which pads batches.
static EMPTY: Record = {
    let mut fields = [0.0; FIELDS];
    fields[0] = f32::NAN;
    Record(fields)
};

impl Listable for Record {
    const EMPTY: &'static Self = &EMPTY;

    #[inline(always)]
    fn z_min(&self) -> f32 {
        self.0[Z_MIN]
    }
}

/// A list of records.
pub(crate) type Records = Reused<Record>;

impl Records {
    /// Appends the records of a group whose bits are set in `keep`. Returns the index of the first.
    #[inline(always)]
    pub(crate) fn push_group<S: Simd>(
        &mut self,
        records: RecordLanes<S>,
        tiny: Option<&TinyLanes<S>>,
        keep: u64,
    ) -> u32 {
        let mut fields = records.to_fields();
        if let Some(tiny) = tiny {
            tiny.write(&mut fields);
        }
        let [low, high] = fields;
        let (low, high) = (Lanes::transpose(low), Lanes::transpose(high));
        let first = self.len();
        if let Some(room) = self.room::<LANES>() {
            let mut at = 0;
            for i in 0..LANES {
                // A record that isn't wanted is overwritten by the next one.
                let record = &mut room[at % LANES];
                low[i].store(&mut record.0);
                high[i].store(&mut record.0[LANES..]);
                at += (keep >> i & 1) as usize;
            }
            self.advance(at);
        }
        first as u32
    }
}

/// Box of blocks that a splat may touch: first column, first row, end column, end row, in blocks from the grid's
/// origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BlockBox(pub [u32; 4]);

impl<S: Simd> RecordLanes<S> {
    /// Returns the records one by one.
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
