//! Sorting of fragments per pixel: fragments wait until no nearer ones can follow.
//!
//! A tile's records are sorted by their minimum depth. A fragment nearer than the minimum depth of the next record is
//! in its final place. Once a fragment makes its pixel opaque, fragments behind it are dropped, because nearer
//! fragments can't change this. A pixel therefore stores few more fragments than are visible in it.

use crate::gaussians::records::Record;
use crate::gaussians::tile::{BLOCKS, Block};
use crate::simd::lanes::LANES;
use surfel_math::gaussian::{MIN_TRANSMITTANCE, depth_step_f32};

/// Number of Gaussians that a block collects between sorts.
const SORT_EVERY: usize = 32;

/// A fragment: one Gaussian at one pixel.
pub(super) struct Fragment<'a> {
    key: u64,
    pub alpha: f32,
    pub z: f32,
    pub record: &'a Record,
}

/// Returns the sort key of a fragment: first the depth step, then the Gaussian's number in the scene.
#[inline(always)]
pub(super) fn key(z: f32, number: u32) -> u64 {
    u64::from(depth_step_f32(z)) << 32 | u64::from(number)
}

/// The fragments of a tile that wait to be blended.
#[derive(Default)]
pub(super) struct Pending<'a> {
    /// Fragments per pixel; pixels are in blocks of [`LANES`].
    pub fragments: Vec<Vec<Fragment<'a>>>,
    /// Sort key from which on fragments are invisible, per pixel.
    ends: Vec<u64>,
    /// Number of Gaussians per block to collect before the next sort.
    until_sort: [usize; BLOCKS],
}

impl<'a> Pending<'a> {
    /// Empties the lists, for the next tile.
    pub(super) fn clear(&mut self) {
        self.fragments.resize_with(BLOCKS * LANES, Vec::new);
        self.fragments.iter_mut().for_each(Vec::clear);
        self.ends.clear();
        self.ends.resize(BLOCKS * LANES, u64::MAX);
        self.until_sort = [SORT_EVERY; BLOCKS];
    }

    /// Adds a record at the block's pixels whose bits are set. Returns true if the block has to be sorted.
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

    /// Sorts a block's fragments, drops invisible ones, and counts each pixel's fragments whose keys are below a limit.
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
