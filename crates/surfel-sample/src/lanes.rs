//! SIMD operations on sixteen lanes: packing of selected lanes, and ranking of a few values.

use fearless_simd::prelude::*;
use fearless_simd::{f32x16, mask32x16, u32x16};

/// Number of values of a SIMD vector in this crate: sixteen of 32 bits.
pub(crate) const LANES: usize = 16;

/// Indices of the sixteen lanes, 0 to 15.
const NUMBERS: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Returns sixteen consecutive numbers, the first of which is `first`.
#[inline(always)]
pub(crate) fn numbers<S: Simd>(simd: S, first: u32) -> u32x16<S> {
    u32x16::load_array(simd, NUMBERS) + u32x16::splat(simd, first)
}

/// Writes the lanes selected by `kept` to `to`, consecutively from index `at` on. Up to sixteen elements are
/// overwritten.
#[inline(always)]
pub(crate) fn compress<S: Simd, T: SimdElement, V>(values: V, kept: mask32x16<S>, to: &mut [T], at: usize)
where
    V: SimdBase<S, Element = T, Array = [T; LANES], Mask = mask32x16<S>>,
{
    if let Some(to) = to[at..].first_chunk_mut() {
        values.compress(kept).store_array(to);
    }
}

/// Computes the rank of each of the first `n` values: the number of smaller values, plus the number of equal values
/// before it. Both slices need room for whole SIMD steps; elements beyond `n` are overwritten.
#[inline(always)]
pub(crate) fn rank<S: Simd>(simd: S, values: &mut [f32], n: usize, ranks: &mut [u32]) {
    let room = n.next_multiple_of(LANES);
    values[n..room].fill(f32::INFINITY);
    let (groups, ranks) = (values[..room].as_chunks::<LANES>().0, ranks[..room].as_chunks_mut::<LANES>().0);
    let one = u32x16::splat(simd, 1);
    for (g, to) in ranks.iter_mut().enumerate() {
        let own = f32x16::load_array_ref(simd, &groups[g]);
        let mut rank = u32x16::splat(simd, 0);
        for (h, group) in groups.iter().enumerate() {
            for (i, other) in group.iter().enumerate().take(n - h * LANES) {
                let other = f32x16::splat(simd, *other);
                let is_before = if h < g {
                    other.simd_le(own)
                } else if h > g {
                    other.simd_lt(own)
                } else {
                    let is_earlier = numbers(simd, 0).simd_gt(u32x16::splat(simd, i as u32));
                    other.simd_lt(own) | (other.simd_le(own) & is_earlier)
                };
                rank = is_before.select(rank + one, rank);
            }
        }
        rank.store_array(to);
    }
}

/// Returns the SIMD instruction sets that this machine supports, the best one last.
#[cfg(test)]
pub(crate) fn levels() -> Vec<fearless_simd::Level> {
    use fearless_simd::Level;
    let best = Level::new();
    #[cfg(target_arch = "x86_64")]
    let others =
        [best.as_avx2().map(Level::Avx2), best.as_sse4_2().map(Level::Sse4_2), best.as_sse2().map(Level::Sse2)];
    #[cfg(not(target_arch = "x86_64"))]
    let others = [];
    others.into_iter().flatten().chain([best]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::random::Random;
    use fearless_simd::dispatch;

    #[test]
    fn ranks_are_places_in_sorted_order_with_ties_in_their_own() {
        let mut random = Random::new(6);
        for n in [0, 1, 15, 16, 17, 40, 96] {
            for different in [1.0, 5.0, 1e9] {
                let values: Vec<f32> = (0..n).map(|_| (random.unit() * different).floor() as f32).collect();
                let mut order: Vec<usize> = (0..n).collect();
                order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
                for level in levels() {
                    let (mut room, mut ranks) = (values.clone(), vec![0; 96]);
                    room.resize(96, -1.0);
                    dispatch!(level, simd => rank(simd, &mut room, n, &mut ranks));
                    assert!(order.iter().enumerate().all(|(rank, i)| ranks[*i] as usize == rank), "{n} {level:?}");
                }
            }
        }
    }

    #[test]
    fn kept_lanes_move_together_behind_what_is_there() {
        let all = [0_u32, 1, 0x8000, 0xffff, 0x5a0f];
        for (bits, level) in all.into_iter().flat_map(|bits| levels().into_iter().map(move |level| (bits, level))) {
            let mut to = [100_u32; 40];
            dispatch!(level, simd => {
                let kept = mask32x16::from_bitmask(simd, u64::from(bits));
                compress(numbers(simd, 7), kept, &mut to, 5);
            });
            let expected: Vec<u32> = (0..16).filter(|i| bits >> i & 1 == 1).map(|i| 7 + i).collect();
            assert_eq!(to[5..5 + expected.len()], expected);
            assert!(to[..5].iter().chain(&to[21..]).all(|v| *v == 100), "{to:?}");
        }
    }
}
