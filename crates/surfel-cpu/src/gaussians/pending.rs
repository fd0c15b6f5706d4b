//! The order of each pixel: fragments wait until no nearer ones can follow.
//!
//! A tile's records come by the depth at which they begin. What is nearer than the record that comes next is in its
//! final place, and what would end a pixel does so whatever else comes before it: fragments behind that are dropped, so
//! that a pixel holds few more than it shows.

use crate::gaussians::records::Record;
use crate::gaussians::tile::{BLOCKS, Block};
use crate::simd::lanes::LANES;
use surfel_math::gaussian::{MIN_TRANSMITTANCE, depth_step_f32};

/// Gaussians that a block takes between sorts, at least.
const SORT_EVERY: usize = 32;

/// A Gaussian at a pixel.
pub(super) struct Fragment<'a> {
    key: u64,
    pub alpha: f32,
    pub z: f32,
    pub record: &'a Record,
}

/// Fragments are in the order of these: by steps of depth, then as in the scene.
#[inline(always)]
pub(super) fn key(z: f32, number: u32) -> u64 {
    u64::from(depth_step_f32(z)) << 32 | u64::from(number)
}

/// The fragments of a tile that wait.
#[derive(Default)]
pub(super) struct Pending<'a> {
    /// By pixel, in blocks of [`LANES`].
    pub fragments: Vec<Vec<Fragment<'a>>>,
    /// By pixel, the key from which on nothing is seen.
    ends: Vec<u64>,
    /// Gaussians that a block takes until it is sorted.
    until_sort: [usize; BLOCKS],
}

impl<'a> Pending<'a> {
    /// Begins a tile.
    pub(super) fn clear(&mut self) {
        self.fragments.resize_with(BLOCKS * LANES, Vec::new);
        self.fragments.iter_mut().for_each(Vec::clear);
        self.ends.clear();
        self.ends.resize(BLOCKS * LANES, u64::MAX);
        self.until_sort = [SORT_EVERY; BLOCKS];
    }

    /// Adds a record at the pixels of a block that have a bit; true if it is time to sort the block.
    #[inline(always)]
    pub(super) fn add(&mut self, block: usize, bits: u64, alpha: &Block, z: &Block, record: &'a Record) -> bool {
        let mut bits = bits;
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            // Rounding never takes it before where its record begins.
            let key = key(z[lane].max(record.nearest), record.number);
            let pixel = block * LANES + lane;
            if key < self.ends[pixel] {
                self.fragments[pixel].push(Fragment { key, alpha: alpha[lane], z: z[lane], record });
            }
        }
        self.until_sort[block] -= 1;
        self.until_sort[block] == 0
    }

    /// Sorts a block's fragments, drops those that aren't seen, and counts those at each pixel with keys below a limit.
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
