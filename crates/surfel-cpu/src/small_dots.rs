//! Dots of 2×2 pixels in one cache line each, where a record takes two.
//!
//! Far views have millions of them, written once and read twice from memory that no cache near the processor holds. Tiles that are
//! drawn splat by splat read them as they are; in others they get records ([`unfold`]).

use crate::bins::{Grid, Kind, Segment};
use crate::lanes::{LANES, Lanes};
use crate::record::{CLASS, COLOR, DOT_BITS, FORMS, Record, Slots};
use crate::tile::Listing;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x4};

/// A [dot](crate::dots) of 2×2 pixels: its first one's column and row, lowest 16 bits each; ε; four depths and four weights; colour
/// and normal.
#[derive(Clone, Copy, Default)]
#[repr(align(64))]
pub(crate) struct SmallDot([f32; LANES]);

/// Numbers that a tile may remember between its loops. One with more is drawn block by block, which computes them twice.
const REMEMBERED: usize = 1 << 22;

/// What a pair of dot and block costs where a tile is drawn block by block, another pair there, a dot where it is drawn splat
/// by splat, and another splat's pair there.
const COSTS: [usize; 4] = [40, 30, 10, 45];

const DEPTHS: usize = 2;
const WEIGHTS: usize = 6;
const ATTRIBUTES: usize = 10;

impl SmallDot {
    /// Column and row of its first pixel, which is near this one.
    #[inline(always)]
    pub(crate) fn first_px(&self, (x, y): (i32, i32)) -> (i32, i32) {
        let bits = self.0[0].to_bits();
        let near = |at: i32, low: u32| at + i32::from((low as u16).wrapping_sub(at as u16) as i16);
        (near(x, bits), near(y, bits >> 16))
    }

    #[inline(always)]
    pub(crate) fn epsilon(&self) -> f32 {
        self.0[1]
    }

    /// Depths and weights.
    #[inline(always)]
    pub(crate) fn fragments<S: Simd>(&self, simd: S) -> (f32x4<S>, f32x4<S>) {
        (f32x4::from_slice(simd, &self.0[DEPTHS..DEPTHS + 4]), f32x4::from_slice(simd, &self.0[WEIGHTS..WEIGHTS + 4]))
    }

    /// Colour and normal.
    #[inline(always)]
    pub(crate) fn attributes(&self) -> [f32; 6] {
        let [.., r, g, b, x, y, z] = self.0;
        [r, g, b, x, y, z]
    }

    /// As a record, given a pixel nearby.
    fn record(&self, near: (i32, i32)) -> Record {
        let mut record = Record::default();
        let fields = &mut record.0;
        let (x, y) = self.first_px(near);
        (fields[0], fields[1]) = (f32::from_bits(x as u32), f32::from_bits(y as u32));
        fields[2] = self.epsilon();
        let depths = &self.0[DEPTHS..WEIGHTS];
        // Outside the footprint as well: no fragment is nearer.
        fields[3] = depths.iter().copied().fold(f32::INFINITY, f32::min);
        fields[CLASS] = f32::from_bits(DOT_BITS[0]);
        fields[FORMS..FORMS + 8].copy_from_slice(&self.0[DEPTHS..ATTRIBUTES]);
        fields[COLOR..COLOR + 6].copy_from_slice(&self.0[ATTRIBUTES..]);
        record
    }
}

impl Slots<SmallDot> {
    /// Appends those of sixteen that are in `keep`, as bits, for which there is room: index of the first. Field by field.
    #[inline(always)]
    pub(crate) fn push_sixteen<S: Simd>(&mut self, fields: [Lanes<S>; LANES], keep: u64) -> u32 {
        let dots = Lanes::transpose(fields);
        self.write_sixteen(
            keep,
            #[inline(always)]
            |i, dot| dots[i].store(&mut dot.0),
        )
    }
}

/// True if a tile is drawn splat by splat: if so many of its splats are dots that it is faster.
fn serve(segments: &[Segment], tile: usize) -> bool {
    let [dot_by_blocks, by_blocks, dot, pair] = COSTS;
    let [mut dots, mut pairs] = [0; 2];
    for entry in segments.iter().flat_map(|segment| segment.of(tile)) {
        let is_dot = entry.kind() != Kind::Any;
        dots += usize::from(is_dot);
        pairs += if is_dot { 0 } else { entry.blocks.count_ones() as usize };
    }
    dots > 0 && 2 * LANES * pairs <= REMEMBERED && dots * dot + pairs * pair < dots * dot_by_blocks + pairs * by_blocks
}

/// Which tiles are drawn splat by splat, if any may be. Small dots in others get records.
pub(crate) fn unfold(segments: &mut [Segment], grid: &Grid, by_splats: bool) -> Vec<bool> {
    let served: Vec<bool> = (0..grid.tiles()).map(|tile| by_splats && serve(segments, tile)).collect();
    for segment in segments.iter_mut().filter(|segment| !segment.small_dots.is_empty()) {
        for (tile, _) in served.iter().enumerate().filter(|(_, served)| !**served) {
            let near = Listing { segments: &[], grid: *grid }.block_px(tile, 0);
            segment.unfold(tile, |dot| dot.record(near));
        }
    }
    served
}

impl Segment {
    fn unfold(&mut self, tile: usize, record: impl Fn(&SmallDot) -> Record) {
        let Self { records, small_dots, unfolded, lists, .. } = self;
        for entry in lists.of_mut(tile).iter_mut().filter(|entry| entry.kind() == Kind::Small) {
            records.push(record(&small_dots[entry.record as usize]));
            entry.refer_to(records.len() as u32 - 1, Kind::Four);
            *unfolded += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_dots_know_their_first_pixel_from_one_nearby_in_pictures_of_any_size() {
        for at in [-3, -1, 0, 7, 0x7fff, 0x8000, 0xffff, 0x1_0000, 0x1_8001] {
            for beside in [-40, -1, 0, 1, 40] {
                let (x, y) = (at, at + beside);
                let mut dot = SmallDot::default();
                dot.0[0] = f32::from_bits((x as u32 & 0xffff) | (y as u32) << 16);
                assert_eq!(dot.first_px((x + beside, y - beside)), (x, y), "beside {beside}");
            }
        }
    }

    #[test]
    fn small_dots_become_the_records_that_dots_of_four_pixels_have() {
        let numbers: [f32; LANES] = std::array::from_fn(|i| 0.25 + i as f32);
        let mut dot = SmallDot(numbers);
        // Outside the footprint depths and weights are NaN, and no depth is the nearest then.
        (dot.0[0], dot.0[DEPTHS], dot.0[WEIGHTS]) = (f32::from_bits(5 | 9 << 16), f32::NAN, f32::NAN);
        let record = dot.record((0, 0));
        assert_eq!(crate::dots::first_px(&record), (5, 9));
        assert_eq!((record.dot_side(), record.class()), (2, crate::record::Class::Dot));
        assert_eq!((record.epsilon(), record.z_min()), (numbers[1], numbers[DEPTHS + 1]));
        assert!(record.0[FORMS].is_nan() && record.0[FORMS + 4].is_nan());
        assert_eq!(record.0[FORMS + 1..FORMS + 4], numbers[DEPTHS + 1..DEPTHS + 4]);
        assert_eq!(record.0[FORMS + 5..FORMS + 8], numbers[WEIGHTS + 1..WEIGHTS + 4]);
        let attributes =
            [record.red(), record.green(), record.blue(), record.normal_x(), record.normal_y(), record.normal_z()];
        assert_eq!(attributes[..], numbers[ATTRIBUTES..]);
    }
}
