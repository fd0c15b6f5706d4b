//! The surfaces of an A-buffer (rendering model §8), for blocks with many fragments. Searching all fragments for each
//! surface would take quadratic time in such blocks.
//!
//! A pixel's surfaces end at its depth thresholds, which are found from the fragments in order of depth. Each fragment
//! belongs to the first surface whose threshold isn't nearer than the fragment. The block's fragments are sorted by
//! surface, and stay in splat order within a surface.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)).

use crate::raster::layers::Remembered;
use crate::simd::lanes::LANES;

/// Number of the surface that a splat's fragment belongs to, per pixel: 0 for the nearest; NaN for no fragment.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Numbers(pub [f32; LANES]);

/// A pair of a surface and a splat that has a fragment of this surface in some pixel. Members are ordered by surface,
/// then by splat.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Member {
    surface: u32,
    /// Index of the splat among the block's stored fragments.
    pub fragment: u32,
}

/// Surface `number` of all pixels of a block, counted from the nearest in each pixel.
pub(super) struct Surface<'a> {
    pub number: u32,
    /// Surfaces that the fragments of each stored splat belong to.
    pub numbers: &'a [Numbers],
    /// Splats that have fragments of this surface, in splat order.
    pub members: &'a [Member],
}

/// The surfaces of a block's pixels, numbered from the nearest, and scratch buffers for finding them.
#[derive(Default)]
pub(super) struct SurfaceNumbers {
    /// Surfaces that the fragments of each stored splat belong to.
    numbers: Vec<Numbers>,
    members: Vec<Member>,
    /// Index in `members` of the first member of the surface that [`Self::next()`] returns next.
    next: usize,
    /// Scratch: the visibility fragments of one pixel in order of depth, as depths and indices of splats.
    order: Vec<(f32, u32)>,
    /// Scratch: for each fragment of `order`, the smallest z + ε of it and of all fragments behind it.
    ends: Vec<f32>,
    /// Scratch: depth thresholds of one pixel, from near to far.
    thresholds: Vec<f32>,
}

impl SurfaceNumbers {
    /// Finds the surfaces that a block's stored fragments belong to, and numbers them from the nearest.
    pub(super) fn number(&mut self, fragments: &[Remembered]) {
        self.numbers.clear();
        self.numbers.resize(fragments.len(), Numbers([f32::NAN; LANES]));
        self.order.clear();
        self.order.extend((0..fragments.len() as u32).map(|i| (0.0, i)));
        for lane in 0..LANES {
            self.find_thresholds(fragments, lane);
            for (f, numbers) in fragments.iter().zip(&mut self.numbers) {
                let z = f.inside_z[lane];
                if !z.is_nan() {
                    numbers.0[lane] = self.thresholds.partition_point(|&threshold| threshold < z) as f32;
                }
            }
        }
        self.members.clear();
        for (fragment, numbers) in self.numbers.iter().enumerate() {
            let first = self.members.len();
            for number in numbers.0.iter().filter(|number| !number.is_nan()) {
                let member = Member { surface: *number as u32, fragment: fragment as u32 };
                if !self.members[first..].contains(&member) {
                    self.members.push(member);
                }
            }
        }
        self.members.sort_unstable();
        self.next = 0;
    }

    /// Finds the depth thresholds of the pixel in this lane, from near to far.
    fn find_thresholds(&mut self, fragments: &[Remembered], lane: usize) {
        self.thresholds.clear();
        // The order of the previous pixel is nearly the order of this one, from which the sort benefits.
        self.order.iter_mut().for_each(|(z, i)| *z = fragments[*i as usize].visible_z[lane]);
        self.order.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        // The depth of a fragment that isn't visible is NaN, which sorts last.
        let visible = &self.order[..self.order.partition_point(|(z, _)| !z.is_nan())];
        self.ends.clear();
        self.ends.resize(visible.len(), f32::INFINITY);
        let mut least = f32::INFINITY;
        for (end, (z, i)) in self.ends.iter_mut().zip(visible).rev() {
            least = least.min(z + fragments[*i as usize].epsilon);
            *end = least;
        }
        let mut at = 0;
        while let Some(&threshold) = self.ends.get(at) {
            self.thresholds.push(threshold);
            at += visible[at..].partition_point(|(z, _)| *z <= threshold);
        }
    }

    /// Returns the next surface of the block, from the nearest; `None` after the last one.
    pub(super) fn next(&mut self) -> Option<Surface<'_>> {
        let first = self.next;
        let number = self.members.get(first)?.surface;
        let members = &self.members[first..];
        let members = &members[..members.partition_point(|member| member.surface == number)];
        self.next = first + members.len();
        Some(Surface { number, numbers: &self.numbers, members })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::xorshift::Xorshift;

    /// Splits a pixel's fragments into surfaces by the definition, one surface after the other.
    fn one_by_one(fragments: &[Remembered], lane: usize) -> Vec<Vec<u32>> {
        let (mut surfaces, mut beyond) = (Vec::new(), f32::NEG_INFINITY);
        while beyond < f32::INFINITY {
            let visible = fragments.iter().filter(|f| f.visible_z[lane] > beyond);
            let threshold = visible.map(|f| f.visible_z[lane] + f.epsilon).fold(f32::INFINITY, f32::min);
            let is_in = |f: &Remembered| f.inside_z[lane] > beyond && f.inside_z[lane] <= threshold;
            surfaces.push((0..fragments.len() as u32).filter(|&i| is_in(&fragments[i as usize])).collect());
            beyond = threshold;
        }
        surfaces
    }

    #[test]
    fn surfaces_have_the_members_that_they_have_one_by_one() {
        let mut random = Xorshift::new();
        let mut below = |n: u64| random.bits() % n;
        let mut fragments = Vec::new();
        for i in 0..300 {
            let mut f = Remembered { epsilon: [0.0, 0.02, 0.3][i % 3], ..Remembered::default() };
            for lane in 0..LANES {
                // Some splats have only one of the two footprints, some none, and many have equal depths.
                let z = 1.0 + (below(400) as f32) * 0.01;
                let [inside, visible] = [below(5) > 0, below(4) > 0];
                f.inside_z[lane] = if inside { z } else { f32::NAN };
                f.visible_z[lane] = if visible { z } else { f32::NAN };
            }
            fragments.push(f);
        }
        let mut surfaces = SurfaceNumbers::default();
        // A second, smaller block checks that no state of the first remains.
        for fragments in [&fragments[..], &fragments[50..250]] {
            surfaces.number(fragments);
            let want: Vec<Vec<Vec<u32>>> = (0..LANES).map(|lane| one_by_one(fragments, lane)).collect();
            let mut got = vec![vec![Vec::new(); want.iter().map(Vec::len).max().unwrap()]; LANES];
            while let Some(Surface { number, numbers, members }) = surfaces.next() {
                assert!(members.is_sorted() && !members.is_empty());
                for member in members {
                    for (lane, got) in got.iter_mut().enumerate() {
                        if numbers[member.fragment as usize].0[lane] == number as f32 {
                            got[number as usize].push(member.fragment);
                        }
                    }
                }
            }
            for (got, mut want) in got.into_iter().zip(want) {
                want.resize(got.len(), Vec::new());
                assert_eq!(got, want);
            }
        }
    }
}
