//! Sorting of fragments per pixel: fragments wait until no nearer ones can follow.
//!
//! A tile's records are sorted by their minimum depth. A fragment nearer than the minimum depth of the next record is
//! in its final place. Once a fragment makes its pixel opaque, fragments behind it are dropped, because nearer
//! fragments can't make the pixel less opaque. A pixel therefore stores few more fragments than are visible in it.
//!
//! A *block* is 4×4 pixels, and a *record* is a projected Gaussian ([`Record`]).

use crate::gaussians::records::Record;
use crate::gaussians::tile::{BLOCKS, Block};
use crate::simd::lanes::LANES;
use surfel_math::gaussian::{MIN_TRANSMITTANCE, depth_step_f32};

/// Smallest number of Gaussians that are added to a block of pixels between two sorts of its fragments.
const SORT_EVERY: usize = 32;

/// A fragment: the contribution of one Gaussian to one pixel.
pub(super) struct Fragment<'a> {
    /// Sort key, as returned by [`key`].
    key: u64,
    pub alpha: f32,
    pub z: f32,
    pub record: &'a Record,
}

/// Returns the sort key of a fragment: its depth, rounded to a depth step, and among equal steps the Gaussian's number
/// in the scene.
#[inline(always)]
pub(super) fn key(z: f32, number: u32) -> u64 {
    u64::from(depth_step_f32(z)) << 32 | u64::from(number)
}

/// The fragments of a tile that wait to be blended, because nearer ones may follow.
#[derive(Default)]
pub(super) struct Pending<'a> {
    /// Waiting fragments of each pixel. The pixels of a block are consecutive, [`LANES`] of them.
    pub fragments: Vec<Vec<Fragment<'a>>>,
    /// Smallest sort key, per pixel, at which a fragment is invisible because nearer ones make the pixel opaque.
    ends: Vec<u64>,
    /// Number of Gaussians, per block, that are still to be added before the block's fragments are sorted.
    until_sort: [usize; BLOCKS],
}

impl<'a> Pending<'a> {
    /// Empties the lists before the next tile.
    pub(super) fn clear(&mut self) {
        self.fragments.resize_with(BLOCKS * LANES, Vec::new);
        self.fragments.iter_mut().for_each(Vec::clear);
        self.ends.clear();
        self.ends.resize(BLOCKS * LANES, u64::MAX);
        self.until_sort = [SORT_EVERY; BLOCKS];
    }

    /// Adds the fragments of a record in the block's pixels whose bits are set. Returns true if the block has to be
    /// sorted now.
    #[inline(always)]
    pub(super) fn add(&mut self, block: usize, bits: u64, alpha: &Block, z: &Block, record: &'a Record) -> bool {
        let mut bits = bits;
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            // The maximum prevents that rounding moves a fragment in front of its record's minimum depth.
            let key = key(z[lane].max(record.nearest), record.number);
            let pixel = block * LANES + lane;
            if key < self.ends[pixel] {
                self.fragments[pixel].push(Fragment { key, alpha: alpha[lane], z: z[lane], record });
            }
        }
        self.until_sort[block] -= 1;
        self.until_sort[block] == 0
    }

    /// Sorts the fragments of a block's pixels and drops invisible ones. Returns, for each pixel, the number of
    /// fragments whose sort keys are below `limit`, which can be blended.
    #[inline(always)]
    pub(super) fn sort(&mut self, block: usize, limit: u64, transmittance: &Block) -> [usize; LANES] {
        let (mut ready, mut most_left) = ([0; LANES], 0);
        for (lane, ready) in ready.iter_mut().enumerate() {
            let pixel = block * LANES + lane;
            let fragments = &mut self.fragments[pixel];
            fragments.sort_unstable_by_key(|fragment| fragment.key);
            let mut left = transmittance[lane];
            let end = fragments.iter().position(|fragment| {
                left *= 1.0 - fragment.alpha;
                left < MIN_TRANSMITTANCE as f32
            });
            if let Some(end) = end {
                self.ends[pixel] = fragments[end].key;
                fragments.truncate(end + 1);
            }
            *ready = fragments.partition_point(|fragment| fragment.key < limit);
            most_left = most_left.max(fragments.len() - *ready);
        }
        self.until_sort[block] = SORT_EVERY.max(2 * most_left);
        ready
    }
}
