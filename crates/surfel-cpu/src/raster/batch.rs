//! Traversal of a block's list of splats, in batches.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *record* is a splat projected to the screen
//! ([`Record`]).

use crate::raster::fragment::{cheap_batch, fragment};
use crate::raster::inputs::RasterInputs;
use crate::setup::evaluate::Fragment;
use crate::setup::record::{Batch, Record};
use crate::simd::lanes::Lanes;
use crate::tiles::lists::{BATCH, BlockList};
use fearless_simd::Simd;

/// The pixels of a block, as coordinates in lanes.
#[derive(Clone, Copy)]
pub(crate) struct Pixels<S: Simd> {
    first: (i32, i32),
    /// Columns and rows of the block's pixels, one lane per pixel.
    at: (Lanes<S>, Lanes<S>),
}

impl<S: Simd> Pixels<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, first: (i32, i32)) -> Self {
        Self { first, at: Lanes::block_pixels(simd, first) }
    }
}

/// A visitor of the fragments of a block's splats. A trait rather than a closure: a closure that is called in several
/// places isn't inlined into SIMD code.
pub(crate) trait Visit<S: Simd> {
    /// Receives a batch's number in the block's list, before the fragments of the batch are added.
    #[inline(always)]
    fn begin(&mut self, _number: usize) {}

    /// Adds the fragments of splat `j` of the current batch of four; `record` is the splat's record.
    fn add(&mut self, simd: S, fragment: Fragment<S>, j: usize, record: &Record);

    /// Returns the depth behind which no further fragment of the block matters, so that splats behind it may be
    /// skipped. `None` if the visitor has no such depth.
    fn farthest(&self) -> Option<f32>;
}

/// Number of batches drawn between calls of [`Visit::farthest`], whose depth lets splats behind it be skipped.
const BATCHES_PER_THRESHOLD_READ: usize = 4;

/// Computes the fragments of a block's splats, in batches, and passes them to `visit`. Skips splats behind `farthest`,
/// or behind the depth that `visit` returns later. Returns the number of splats computed.
#[inline(always)]
pub(crate) fn for_each_batch<S: Simd>(
    simd: S,
    list: BlockList<'_, '_, Record>,
    mut farthest: f32,
    pixels: &Pixels<S>,
    inputs: &RasterInputs<'_>,
    visit: &mut impl Visit<S>,
) -> u32 {
    let (mut tested, mut last) = (0, 0);
    let all = list.batches();
    for (number, &[i, j, k, l]) in all.iter().enumerate() {
        let [(a, a_z), (b, b_z), (c, c_z), (d, d_z)] = [list.get(i), list.get(j), list.get(k), list.get(l)];
        // The first comparison nearly always decides.
        if farthest < a_z && farthest < b_z && farthest < c_z && farthest < d_z {
            continue;
        }
        tested += BATCH as u32;
        last = number;
        let records = [a, b, c, d];
        visit.begin(number);
        match Batch::of(&records) {
            Batch::Unfiltered => {
                add_all(simd, cheap_batch::<S, false>(simd, records, [pixels.at; BATCH], inputs), records, visit);
            }
            Batch::Filtered => {
                add_all(simd, cheap_batch::<S, true>(simd, records, [pixels.at; BATCH], inputs), records, visit);
            }
            Batch::Scalar => {
                for (j, record) in records.into_iter().enumerate() {
                    visit.add(simd, fragment(simd, record, pixels.at, pixels.first, inputs), j, record);
                }
            }
        }
        if number % BATCHES_PER_THRESHOLD_READ == BATCHES_PER_THRESHOLD_READ - 1
            && number + 1 < all.len()
            && let Some(depth) = visit.farthest()
        {
            farthest = depth;
        }
    }
    // The last batch may be padded with empty splats.
    let filled = if last + 1 == all.len() { (BATCH * all.len() - list.len()) as u32 } else { 0 };
    tested.saturating_sub(filled)
}

#[inline(always)]
fn add_all<S: Simd>(
    simd: S,
    [e, f, g, h]: [Fragment<S>; BATCH],
    [a, b, c, d]: [&Record; BATCH],
    visit: &mut impl Visit<S>,
) {
    visit.add(simd, e, 0, a);
    visit.add(simd, f, 1, b);
    visit.add(simd, g, 2, c);
    visit.add(simd, h, 3, d);
}
