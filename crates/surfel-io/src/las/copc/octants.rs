//! Morton codes of octants, with 21 bits per axis.

use serde::{Deserialize, Serialize};

/// Number of bits per axis of a Morton code, and thus the largest level below the root.
pub(super) const BITS: u32 = 21;

/// `VoxelKey` of a node: its level, and the Morton code of its x, y and z within the level.
#[derive(Clone, Copy, Debug, Deserialize, Eq, Hash, Ord, PartialEq, PartialOrd, Serialize)]
#[serde(from = "(u32, u64)", into = "(u32, u64)")]
pub(super) struct VoxelKey {
    pub(super) level: u32,
    pub(super) code: u64,
}

impl VoxelKey {
    /// Returns the ancestor of this octant at `level`, which must not be finer than the octant's own level.
    pub(super) fn at_level(self, level: u32) -> Self {
        Self { level, code: self.code >> (3 * (self.level - level)) }
    }
}

impl From<(u32, u64)> for VoxelKey {
    fn from((level, code): (u32, u64)) -> Self {
        Self { level, code }
    }
}

impl From<VoxelKey> for (u32, u64) {
    fn from(VoxelKey { level, code }: VoxelKey) -> Self {
        (level, code)
    }
}

/// Inserts two zero bits before each of the 21 lowest bits, where a Morton code has the bits of the other axes.
fn spread(v: u64) -> u64 {
    let mut v = v & 0x1f_ffff;
    v = (v | v << 32) & 0x1f_0000_0000_ffff;
    v = (v | v << 16) & 0x1f_0000_ff00_00ff;
    v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
    v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

fn compact(v: u64) -> u32 {
    let mut v = v & 0x1249_2492_4924_9249;
    v = (v | v >> 2) & 0x10c3_0c30_c30c_30c3;
    v = (v | v >> 4) & 0x100f_00f0_0f00_f00f;
    v = (v | v >> 8) & 0x1f_0000_ff00_00ff;
    v = (v | v >> 16) & 0x1f_0000_0000_ffff;
    ((v | v >> 32) & 0x1f_ffff) as u32
}

/// Returns the Morton code of a cell, given by its position along x, y and z. From the lowest bit on, the code has a
/// bit of x, y and z in turn.
pub(super) fn code([x, y, z]: [u32; 3]) -> u64 {
    spread(x.into()) | spread(y.into()) << 1 | spread(z.into()) << 2
}

/// Returns the position along x, y and z of the cell with a Morton code.
pub(super) fn cell(code: u64) -> [u32; 3] {
    [compact(code), compact(code >> 1), compact(code >> 2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_cells_are_each_others_inverses_and_octants_are_prefixes() {
        let mut random = 1_u64;
        for _ in 0..1000 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let [x, y, z] = [10, 21, 40].map(|shift| (random >> shift) as u32 & 0x1f_ffff);
            assert_eq!(cell(code([x, y, z])), [x, y, z]);
            assert_eq!(code([x, y, z]) >> 9, code([x >> 3, y >> 3, z >> 3]));
        }
        assert_eq!(code([0x1f_ffff; 3]), (1 << 63) - 1);
    }
}
