//! Morton order, in which backends store splats: neighbours in space are neighbours in memory.

use crate::SplatCloud;
use glam::DVec3;
#[cfg(feature = "rayon")]
use rayon::prelude::*;

impl SplatCloud {
    /// Returns the indices of the splats in Morton order of their centres; equal codes stay in index order. With the
    /// feature `rayon`, the sort runs in the caller's thread pool, and the result doesn't depend on the number of
    /// threads.
    pub fn morton_order(&self) -> Vec<u32> {
        order(self.len(), |i| self.center(i))
    }
}

/// Number of points per parallel task, for computing the bounds of all points.
#[cfg(feature = "rayon")]
const BLOCK: usize = 1 << 14;

/// Returns the indices of `n` points in Morton order; equal codes stay in index order.
pub(crate) fn order(n: usize, position: impl Fn(usize) -> DVec3 + Sync) -> Vec<u32> {
    let bounds = |range: std::ops::Range<usize>| {
        range.map(&position).fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)))
    };
    #[cfg(feature = "rayon")]
    let (min, max) = (0..n.div_ceil(BLOCK))
        .into_par_iter()
        .map(|block| bounds(block * BLOCK..n.min((block + 1) * BLOCK)))
        .reduce(|| bounds(0..0), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    #[cfg(not(feature = "rayon"))]
    let (min, max) = bounds(0..n);
    let extent = (max - min).max_element();
    let scale = if extent > 0.0 { 2_097_151.0 / extent } else { 0.0 };
    let keyed = |i: usize| {
        let q = (position(i) - min) * scale;
        (spread(q.x as u64) | spread(q.y as u64) << 1 | spread(q.z as u64) << 2, i as u32)
    };
    #[cfg(feature = "rayon")]
    let keyed = {
        let mut keyed: Vec<(u64, u32)> = (0..n).into_par_iter().map(keyed).collect();
        keyed.par_sort_unstable();
        keyed.into_par_iter()
    };
    #[cfg(not(feature = "rayon"))]
    let keyed = {
        let mut keyed: Vec<(u64, u32)> = (0..n).map(keyed).collect();
        keyed.sort_unstable();
        keyed.into_iter()
    };
    keyed.map(|(_, i)| i).collect()
}

/// Spreads the low 21 bits of `x` to every third bit, to interleave three coordinates into one Morton code.
fn spread(x: u64) -> u64 {
    let x = x & 0x1f_ffff;
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CloudData, Column3, OnInvalid, Shape};

    #[test]
    fn morton_order_takes_octants_one_by_one_and_keeps_equals_in_index_order() {
        // The corners of a cube, the last one twice: x counts 1, y 2, z 4.
        let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1));
        let centers: Vec<DVec3> = [6, 3, 7, 0, 5, 2, 4, 1, 7].map(corner).to_vec();
        let (origin, centers) = Column3::with_origin(&centers);
        let normals = Column3::from_f64(&[DVec3::Z; 9]);
        let data = CloudData::new(origin, centers, Shape::Disks { normals, radii: vec![1.0; 9] });
        let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
        assert_eq!(cloud.morton_order(), [3, 7, 5, 1, 6, 4, 0, 2, 8]);
    }
}
