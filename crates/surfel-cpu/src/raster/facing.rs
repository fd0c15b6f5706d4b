//! Separation of front- and back-facing splats of oriented clouds in a block (rendering model §5): thresholds of both
//! sides, and the side that each pixel shows.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *record* is a splat projected to the screen
//! ([`Record`]).

use crate::raster::filter::FragmentFilter;
use crate::setup::record::Record;
use crate::simd::lanes::Lanes;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;
use surfel_math::facing::{BACK_FACING_LAG, sheet_limit};

const FAR: f32 = f32::INFINITY;

/// Numbers for each facing, in the order of [`crate::setup::record::Facing`], by which a fragment lowers only the
/// depths of its own side.
///
/// The first four are added to a fragment's depth, and are 0, or +∞ to exclude the fragment. They apply to the front's
/// threshold, the back's threshold, the front's nearest depth and the back's nearest depth. The fifth is the fraction
/// of ε by which the fragment counts as farther when the sides are compared.
const FACING_OFFSETS: [[f32; 5]; 3] = [[0.0, 0.0, FAR, FAR, 0.0], [0.0, FAR, 0.0, FAR, 0.0], [FAR, 0.0, FAR, 0.0, LAG]];
/// Fraction of the depth tolerance ε by which back-facing fragments count as farther when the sides are compared.
const LAG: f32 = BACK_FACING_LAG as f32;

/// Depth thresholds and nearest depths of a block's pixels, separately for the front- and the back-facing side.
#[derive(Clone, Copy)]
pub(crate) struct Sides<S: Simd> {
    front: Side<S>,
    back: Side<S>,
}

/// Depth threshold and nearest depth of one side of the surfaces in a block's pixels.
#[derive(Clone, Copy)]
struct Side<S: Simd> {
    /// Depth threshold min(z + ε) of the side's visibility fragments.
    threshold: Lanes<S>,
    /// Depth tolerance ε of the splat that set the threshold.
    epsilon: Lanes<S>,
    /// Nearest depth of the side's visibility fragments; for the back it includes the lag by which the front is
    /// preferred.
    nearest: Lanes<S>,
    /// ε of the splat that has the nearest fragment.
    nearest_epsilon: Lanes<S>,
}

impl<S: Simd> Side<S> {
    #[inline(always)]
    fn lower<const EPSILON: bool>(&mut self, threshold: Lanes<S>, epsilon: Lanes<S>, nearest: Lanes<S>) {
        if EPSILON {
            self.epsilon = Lanes::select(threshold.lt(self.threshold), epsilon, self.epsilon);
            self.nearest_epsilon = Lanes::select(nearest.lt(self.nearest), epsilon, self.nearest_epsilon);
        }
        self.threshold = self.threshold.min(threshold);
        self.nearest = self.nearest.min(nearest);
    }
}

/// The side that each pixel of a block shows, and its depth threshold.
#[derive(Clone, Copy)]
pub(crate) struct VisibleSide<S: Simd> {
    pub threshold: Lanes<S>,
    /// z + ε of the fragment that sets the threshold; larger than the threshold if the surface's other side limits it.
    pub writer_depth: Lanes<S>,
    /// Depth tolerance ε of the fragment that sets the threshold.
    pub epsilon: Lanes<S>,
    /// Largest depth at which fragments of each facing ([`crate::setup::record::Facing`]) exist: +∞ if the pixel shows
    /// the facing, else −∞.
    limits: [Lanes<S>; 3],
}

impl<S: Simd> Sides<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S) -> Self {
        let far = Lanes::splat(simd, FAR);
        let none = Lanes::splat(simd, 0.0);
        let side = Side { threshold: far, epsilon: none, nearest: far, nearest_epsilon: none };
        Self { front: side, back: side }
    }

    /// Adds a splat's visibility fragments, given by their depths `z`; +∞ in pixels without one.
    #[inline(always)]
    pub(crate) fn add<const EPSILON: bool>(&mut self, simd: S, record: &Record, z: Lanes<S>) {
        let k = |v: f32| Lanes::splat(simd, v);
        let [front, back, nearest_front, nearest_back, lag] = FACING_OFFSETS[record.facing() as usize];
        let (epsilon, value) = (k(record.epsilon()), z + k(record.epsilon()));
        let nearest = z + k(lag * record.epsilon());
        self.front.lower::<EPSILON>(value + k(front), epsilon, nearest + k(nearest_front));
        self.back.lower::<EPSILON>(value + k(back), epsilon, nearest + k(nearest_back));
    }

    /// Returns depths behind which no fragment contributes, whichever side is shown in the end.
    #[inline(always)]
    pub(crate) fn farthest(&self) -> Lanes<S> {
        self.front.threshold.max(self.back.threshold)
    }

    /// Returns a nearer bound than [`Self::farthest`], if no further splat has an ε above `largest_epsilon`. The side
    /// shown in the end has a fragment no farther than the nearest so far. The side's threshold is at most that
    /// fragment's ε behind it.
    #[inline(always)]
    pub(crate) fn farthest_within(&self, largest_epsilon: f32) -> Lanes<S> {
        let nearest = self.front.nearest.min(self.back.nearest);
        let reach = nearest + nearest.constant(largest_epsilon.into());
        self.farthest().min(reach)
    }

    #[inline(always)]
    pub(crate) fn shown(&self) -> VisibleSide<S> {
        let Self { front, back } = *self;
        let shows_back = back.nearest.lt(front.nearest);
        let choose = |if_back, if_front| Lanes::select(shows_back, if_back, if_front);
        let far = front.nearest.constant(f64::INFINITY);
        // A pixel without an oriented visibility fragment shows the filtered fragments of both sides.
        let shows_any = far.le(front.nearest.min(back.nearest));
        let (threshold, epsilon) = (choose(back.threshold, front.threshold), choose(back.epsilon, front.epsilon));
        // The other side limits blending: its nearest fragment may be the one that sets the threshold.
        let limit = sheet_limit(front.nearest, back.nearest);
        let is_limited = limit.lt(threshold);
        let other_epsilon = choose(front.nearest_epsilon, back.nearest_epsilon);
        let other_depth = choose(front.nearest, back.nearest)
            + other_epsilon * choose(far.constant(1.0), far.constant(1.0 - BACK_FACING_LAG));
        VisibleSide {
            threshold: limit.min(threshold),
            writer_depth: Lanes::select(is_limited, other_depth, threshold),
            epsilon: Lanes::select(is_limited, other_epsilon, epsilon),
            limits: [far, Lanes::select(shows_back, -far, far), Lanes::select(shows_back | shows_any, far, -far)],
        }
    }
}

/// A fragment filter that rejects fragments of the side that a pixel doesn't show, and then applies another filter.
pub(crate) struct ByFacing<S: Simd, L> {
    other: L,
    shown: VisibleSide<S>,
}

impl<S: Simd, L> ByFacing<S, L> {
    #[inline(always)]
    pub(crate) fn new(simd: S, other: L) -> Self {
        Self { other, shown: Sides::new(simd).shown() }
    }
}

impl<S: Simd, L: FragmentFilter<S>> FragmentFilter<S> for ByFacing<S, L> {
    const KEEPS_FACINGS: bool = true;

    #[inline(always)]
    fn exists(&self, z: Lanes<S>) -> Option<mask32x16<S>> {
        self.other.exists(z)
    }

    #[inline(always)]
    fn relevant(&self, threshold: Lanes<S>) -> Lanes<S> {
        self.other.relevant(threshold)
    }

    #[inline(always)]
    fn settle(&mut self, threshold: Lanes<S>) {
        self.other.settle(threshold);
    }

    #[inline(always)]
    fn show(&mut self, shown: &VisibleSide<S>) {
        self.shown = *shown;
    }

    #[inline(always)]
    fn adds(&self, z: Lanes<S>, record: &Record, mask: mask32x16<S>) -> mask32x16<S> {
        self.other.adds(z, record, mask & z.lt(self.shown.limits[record.facing() as usize]))
    }
}
