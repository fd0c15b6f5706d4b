//! Conversion of words of bits to the indices of the bits that are set.

use fearless_simd::Simd;

/// Number of bits in a word.
pub(crate) const BITS: usize = 64;

/// Returns the index of each set bit of a word, from the lowest.
#[inline(always)]
pub(crate) fn ones(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lowest = (bits != 0).then(|| bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        lowest
    })
}

/// Number of indices that are written together, even if fewer bits are set.
const FOUR: usize = 4;

/// Writes `first` plus the index of each set bit, in order, to the front of `to`. Later elements of `to` are
/// meaningless.
///
/// The number of set bits is hard to predict, so a branch per bit costs more than a few superfluous writes.
#[inline(always)]
pub(crate) fn set_bits<S: Simd>(simd: S, bits: u64, first: u32, to: &mut [u32; BITS]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx512) = simd.level().as_avx512() {
        return x86::set_bits(avx512, bits, first, to);
    }
    let _ = simd;
    one_by_one(bits, first, to);
}

#[inline(always)]
fn one_by_one(mut bits: u64, first: u32, to: &mut [u32; BITS]) {
    for four in to.as_chunks_mut::<FOUR>().0 {
        if bits == 0 {
            break;
        }
        for to in four {
            *to = first + bits.trailing_zeros();
            bits &= bits.wrapping_sub(1);
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::BITS;
    use fearless_simd::prelude::*;
    use fearless_simd::u32x16;
    use std::arch::x86_64::*;

    /// The bytes 0 to 63, as eight words.
    const NUMBERS: [i64; 8] = {
        let mut numbers = [0; 8];
        let mut i = 0;
        while i < BITS {
            numbers[i / 8] |= (i as i64) << (8 * (i % 8));
            i += 1;
        }
        numbers
    };

    fearless_simd::kernel!(
        /// Writes all indices as [`super::set_bits`] does, at once, by compressing the bytes 0 to 63.
        #[inline]
        pub(super) fn set_bits(avx512: Avx512, bits: u64, first: u32, to: &mut [u32; BITS]) {
            let [a, b, c, d, e, f, g, h] = NUMBERS;
            let numbers = _mm512_maskz_compress_epi8(bits, _mm512_set_epi64(h, g, f, e, d, c, b, a));
            let first = _mm512_set1_epi32(first as i32);
            let quarters = [
                _mm512_castsi512_si128(numbers),
                _mm512_extracti32x4_epi32::<1>(numbers),
                _mm512_extracti32x4_epi32::<2>(numbers),
                _mm512_extracti32x4_epi32::<3>(numbers),
            ];
            for (i, (quarter, to)) in quarters.into_iter().zip(to.as_chunks_mut().0).enumerate() {
                if i > 0 && bits.count_ones() as usize <= 16 * i {
                    break;
                }
                let numbers = _mm512_add_epi32(_mm512_cvtepu8_epi32(quarter), first);
                let numbers: u32x16<_> = numbers.simd_into(avx512);
                numbers.store_array(to);
            }
        }
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};
    use crate::simd::xorshift::Xorshift;

    #[test]
    fn numbers_of_set_bits_are_those_a_loop_finds_by_any_instructions() {
        let mut numbers = Xorshift::new();
        let mut random = move || numbers.bits();
        let mut words = vec![0, 1, 1 << 63, u64::MAX, u64::MAX >> 1, 0xffff, 0x1_ffff, 0xffff_ffff, 0x1_ffff_ffff];
        words.extend((0..300).map(|i| (0..i % 6).fold(random(), |word, _| word & random())));
        for &level in SimdLevel::ALL {
            let instructions = Instructions::new(level).unwrap();
            for &word in &words {
                let mut found = [0; BITS];
                with_instructions!(instructions, simd => set_bits(simd, word, 1000, &mut found));
                let expected: Vec<u32> = (0..64).filter(|i| word >> i & 1 == 1).map(|i| 1000 + i).collect();
                assert_eq!(found[..expected.len()], expected, "{word:x}");
            }
        }
    }
}
