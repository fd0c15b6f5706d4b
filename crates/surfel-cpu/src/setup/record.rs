//! Records: splats projected to the screen, in the form in which the tiles' loops read them.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *slot* is the index of a stored splat in the columns of its object
//! ([`StoredObject`](crate::scene::cloud::StoredObject)). A *tile* is a square of blocks
//! ([`Grid`](crate::tiles::grid::Grid)). A *lane* is one of the 16 numbers that SIMD instructions compute at once.

use crate::setup::tiny::TinyLanes;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::bins::RECORD_BYTES;
use crate::tiles::lists::Listable;
use crate::tiles::pool::Reused;
use fearless_simd::Simd;
use surfel_math::mapping::{Footprint, Linear};

/// Class of a record, which selects the function that evaluates it at pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// A splat with the exact mapping and a nearly constant depth, all of whose fragments are between z_near and z_far.
    /// The depth differs from the centre's by at most 1/64 of it over the disk. Over the splat's blocks, the centre's
    /// depth divided by the plane's depth is between 0.6 and 1.4.
    Cheap,
    /// Any other splat that is set up in lanes.
    General,
    /// A [tiny splat](crate::setup::tiny), of at most 3×3 pixels: its record stores depths and weights pixel by pixel.
    Tiny,
    /// A near splat ([`near`](crate::setup::near)), which is set up and evaluated in f64: [`Record::object`] is its
    /// index among the near splats.
    Near,
}

/// Facing of a splat: the side, front or back, that its oriented surface shows. Used where the sides are kept apart
/// (rendering model §5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Facing {
    /// The splat counts for both sides: its cloud isn't oriented, or the plan doesn't keep sides apart.
    Undeclared,
    /// The splat faces the eye with its outward side.
    Front,
    /// The splat faces the eye with its inward side.
    Back,
}

/// Index of the lowest of the two bits in [`Record::object_bits`] that store the facing; the bits below store the
/// object's index.
const FACING: u32 = 30;

impl Facing {
    /// Returns the facing of a splat of an oriented cloud, by whether it is back-facing.
    pub(crate) fn of(back_facing: bool) -> Self {
        if back_facing { Self::Back } else { Self::Front }
    }

    /// Returns an object's index with the facing in the two highest bits, as [`Record::object_bits`] stores them.
    pub(crate) fn with_object(self, object: u32) -> u32 {
        object | (self as u32) << FACING
    }
}

/// Class bits of a cheap splat ([`Class::Cheap`]) that the filter doesn't change.
pub(crate) const UNFILTERED: u32 = 0;
/// Class bits of a cheap splat ([`Class::Cheap`]) whose filtered footprint may differ from the unfiltered one.
pub(crate) const FILTERED: u32 = 1;
/// Class bits of a general splat ([`Class::General`]).
pub(crate) const GENERAL: u32 = 4;
/// Class bits of a near splat ([`Class::Near`]).
const NEAR: u32 = 8;
/// Class bits of tiny splats ([`Class::Tiny`]) of 2×2 and of 3×3 pixels.
pub(crate) const TINY: [u32; 2] = [16, 32];

/// Bit that is added to the class bits of a splat with a clip.
const CLIPPED: u32 = 64;

/// Method by which the four splats of a batch are evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Batch {
    /// The four splats are evaluated together, because all are of [`Class::Cheap`] and unfiltered, and none is cut by a
    /// clip.
    Unfiltered,
    /// The four splats are evaluated together, because all are of [`Class::Cheap`] and none is cut by a clip. The
    /// filter may change some of their footprints.
    Filtered,
    /// The splats are evaluated one by one, because at least one isn't of [`Class::Cheap`] or is cut by a clip.
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

/// Returns the bits that are set in the class bits of any of four splats.
#[inline(always)]
fn any([a, b, c, d]: [&Record; 4]) -> u32 {
    let bits = |bits: f32| bits.to_bits();
    bits(a.class_bits()) | bits(b.class_bits()) | bits(c.class_bits()) | bits(d.class_bits())
}

/// Number of f32 fields of a record.
pub(crate) const FIELDS: usize = 32;

/// A splat's footprint and attributes, in two cache lines. The footprint consists of the linear forms u·w', v·w' and w'
/// over pixels. (u, v) is the place on the splat, and w' the homogeneous coordinate, scaled to 1 at the anchor. All
/// forms are relative to the anchor, which is the splat's projected centre, in pixels.
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

        /// The records of a group of 16 splats in lanes, field by field.
        #[derive(Clone, Copy)]
        pub(crate) struct RecordLanes<S: Simd> {
            $(pub $name: Lanes<S>,)*
        }

        impl<S: Simd> RecordLanes<S> {
            /// Copies one record into all lanes. Unused fields cost nothing.
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
    /// Column of the pixel that contains the anchor (the splat's projected centre).
    base_x = 0;
    /// Row of the pixel that contains the anchor (the splat's projected centre).
    base_y = 1;
    /// Depth tolerance ε of the splat, in world units.
    epsilon = 2;
    /// Lower bound of the depth of the splat's fragments, in world units ([`Listable::z_min`]).
    nearest = 3;
    /// Bits of the [`Class`], and one more bit that marks a splat with a clip, as the bits of a float.
    class_bits = 4;
    /// Offset in x, in pixels, from the projected centre to the centre of the pixel that contains it.
    offset_x = 5;
    /// Offset in y, in pixels, from the projected centre to the centre of the pixel that contains it.
    offset_y = 6;
    /// Change of the filtered footprint's form u·w' per pixel to the right ([`Record`] defines the form).
    u_x = 7;
    /// Change of the filtered footprint's form u·w' per pixel down ([`Record`] defines the form).
    u_y = 8;
    /// Change of the filtered footprint's form v·w' per pixel to the right ([`Record`] defines the form).
    v_x = 9;
    /// Change of the filtered footprint's form v·w' per pixel down ([`Record`] defines the form).
    v_y = 10;
    /// Change of the plane's depth form per pixel to the right. With the exact mapping in perspective the form is
    /// p_z/z, the centre's depth divided by the plane's depth z; else z.
    depth_x = 11;
    /// Change per pixel down of the depth form that [`Self::depth_x`] defines.
    depth_y = 12;
    /// Planar depth of the splat's centre, in world units.
    z = 13;
    /// Smallest value over the disk of the depth form that [`Self::depth_x`] defines. For a filtered splat of
    /// [`Class::Cheap`], the smallest p_z/z − 1. For an unfiltered one, −[`f32::MAX`], since its depth isn't limited.
    range_min = 14;
    /// Largest value over the disk of the depth form that [`Self::depth_x`] defines, with the same exceptions as
    /// [`Self::range_min`].
    range_max = 15;
    /// Change of the unfiltered footprint's form u·w' per pixel to the right ([`Record`] defines the form).
    visible_u_x = 16;
    /// Change of the unfiltered footprint's form u·w' per pixel down ([`Record`] defines the form).
    visible_u_y = 17;
    /// Change of the unfiltered footprint's form v·w' per pixel to the right ([`Record`] defines the form).
    visible_v_x = 18;
    /// Change of the unfiltered footprint's form v·w' per pixel down ([`Record`] defines the form).
    visible_v_y = 19;
    /// Change of the filtered footprint's form w' per pixel to the right ([`Record`] defines the form).
    w_x = 20;
    /// Change of the filtered footprint's form w' per pixel down ([`Record`] defines the form).
    w_y = 21;
    /// Factor of the kernel's weight by which a filter accounts for the widened area; else 1.
    weight_scale = 22;
    red = 23;
    green = 24;
    blue = 25;
    /// World shading normal, x coordinate; the normal is turned to the eye if the material is two-sided.
    normal_x = 26;
    /// World shading normal, y coordinate.
    normal_y = 27;
    /// World shading normal, z coordinate.
    normal_z = 28;
    /// Factor from weight to coverage by which a filter accounts for the widened area. The factor 1/W0 of the cloud
    /// isn't included.
    coverage_scale = 29;
    /// Bits of the index of the splat's object, which selects its material; of a slot's number if slots are numbered;
    /// or of a near splat's index. The two highest bits are the [`Facing`].
    object_bits = 30;
    /// Bits of 1 plus the number of the splat's clip; 0 for a splat without a clip.
    clip_bits = 31;
}

/// First of the eighteen fields in which a [tiny splat](crate::setup::tiny) stores depths and weights in place of
/// linear forms.
pub(crate) const FORMS: usize = 5;

const _: () = assert!(size_of::<Record>() == RECORD_BYTES, "lists count records by their bytes");

/// Index of the field [`Record::nearest`] in a record.
const Z_MIN: usize = 3;

/// Index of the field [`Record::class_bits`] in a record.
pub(crate) const CLASS: usize = 4;
/// Index of the first of the colour's three fields in a record. The normal's three fields follow.
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

    /// True for splats of [`Class::Cheap`] and [`Class::General`] whose filtered footprint may differ from the
    /// unfiltered one.
    #[inline(always)]
    pub(crate) fn is_filtered(&self) -> bool {
        matches!(self.class_bits().to_bits() & !CLIPPED, FILTERED | GENERAL)
    }

    /// Returns the side of a tiny splat in pixels, 2 or 3.
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

    /// Returns the unfiltered footprint, relative to the splat's projected centre; undefined for a near splat.
    #[inline(always)]
    pub(crate) fn visible_footprint(&self, projective: bool) -> Footprint<f32> {
        let (x, y) = if projective { (self.depth_x(), self.depth_y()) } else { (0.0, 0.0) };
        Footprint {
            u: Linear { c: 0.0, x: self.visible_u_x(), y: self.visible_u_y() },
            v: Linear { c: 0.0, x: self.visible_v_x(), y: self.visible_v_y() },
            w: Linear { c: 1.0, x, y },
        }
    }

    /// Returns the filtered footprint, relative to the splat's projected centre; undefined for a near splat.
    #[inline(always)]
    pub(crate) fn filtered_footprint(&self) -> Footprint<f32> {
        Footprint {
            u: Linear { c: 0.0, x: self.u_x(), y: self.u_y() },
            v: Linear { c: 0.0, x: self.v_x(), y: self.v_y() },
            w: Linear { c: 1.0, x: self.w_x(), y: self.w_y() },
        }
    }

    /// Returns the number of the splat's clip; `None` without a clip.
    #[inline(always)]
    pub(crate) fn clip(&self) -> Option<u32> {
        self.clip_bits().to_bits().checked_sub(1)
    }

    pub(crate) fn set_clip(&mut self, number: u32) {
        self.0[31] = f32::from_bits(number.wrapping_add(1));
        self.0[CLASS] = f32::from_bits(self.class_bits().to_bits() | CLIPPED);
    }

    /// Returns the colour and the world shading normal.
    #[inline(always)]
    pub(crate) fn attributes(&self) -> [f32; 6] {
        [self.red(), self.green(), self.blue(), self.normal_x(), self.normal_y(), self.normal_z()]
    }

    /// Adds `first_near` to the index of a near splat, after the near splats are moved to the cell's list. Other
    /// records don't change.
    pub(crate) fn renumber(&mut self, first_near: usize) {
        if self.class() == Class::Near {
            self.0[30] = f32::from_bits(self.facing().with_object((self.object() + first_near) as u32));
        }
    }

    /// Creates the record that represents a near splat in the tiles' lists. `index` is the splat's index among the near
    /// splats, with the [`Facing`] in the two highest bits.
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

/// A record without any fragment, which fills the last batch of a list.
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
    /// Appends those records of a group whose bits are set in `keep`. Returns the index of the first one.
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
    /// Converts the records from lanes to one record per splat.
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
