//! Depth thresholds: the result of the visibility pass in each pixel (rendering model §5).

use crate::splat::{Facing, ScreenSplat};
use surfel_math::facing::{nearness, sheet_limit};

/// Depth threshold of a pixel: depth up to which fragments belong to its nearest surface. It is the smallest z + ε of
/// the pixel's visibility fragments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Threshold {
    /// Depth up to which fragments' attributes are summed; +∞ if the pixel has no visibility fragment.
    pub depth: f64,
    /// z + ε of the fragment that set the threshold. `depth` is smaller if fragments on the other side of the surface
    /// limit it.
    pub writer_depth: f64,
    /// Depth tolerance ε of the fragment that set the threshold.
    pub epsilon: f64,
    /// Side of oriented surfaces that the pixel shows; [`Facing::Undeclared`] if it shows both.
    pub facing: Facing,
    /// Smallest [`nearness`] of the fragments on the side that the pixel shows; +∞ if sides aren't separated.
    pub nearest: f64,
}

impl Threshold {
    pub(crate) const NONE: Self = Self {
        depth: f64::INFINITY,
        writer_depth: f64::INFINITY,
        epsilon: 0.0,
        facing: Facing::Undeclared,
        nearest: f64::INFINITY,
    };

    /// Creates the threshold z + ε of a splat's fragment at depth `z`.
    pub(crate) fn of(splat: &ScreenSplat, z: f64) -> Self {
        let depth = z + splat.epsilon;
        Self { depth, writer_depth: depth, epsilon: splat.epsilon, ..Self::NONE }
    }

    /// Returns the threshold that a splat's fragment at depth `z` sets in a pixel with this threshold. If the fragment
    /// is on the side that the pixel doesn't show, the returned depth is the limit of the sheet between both sides
    /// instead of z + ε.
    pub(crate) fn by(&self, splat: &ScreenSplat, z: f64) -> Self {
        let own = Self::of(splat, z);
        if self.shows(splat.facing) {
            return own;
        }
        let near = nearness(z, splat.epsilon, splat.facing == Facing::Back);
        Self { depth: sheet_limit(self.nearest, near), ..own }
    }

    /// True if the other side of the surface limits `depth`.
    pub(crate) fn ends_sheet(&self) -> bool {
        self.writer_depth > self.depth
    }

    /// Replaces the threshold by `other` if that one is nearer. Since splats come in index order, the smallest (z + ε,
    /// index) wins.
    pub(crate) fn lower(&mut self, other: Self) {
        if other.depth < self.depth {
            *self = other;
        }
    }

    /// True if the pixel shows fragments of splats with this facing.
    pub(crate) fn shows(&self, facing: Facing) -> bool {
        self.facing == Facing::Undeclared || facing == Facing::Undeclared || facing == self.facing
    }
}

/// Thresholds that a pixel could have if rounding changed the results of tests within their margins.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PossibleThresholds {
    /// Threshold if every fragment with the pixel on its rim counts as inside.
    pub nearest: Threshold,
    /// Threshold if no fragment with the pixel on its rim counts as inside.
    pub farthest: Threshold,
    /// Threshold of another fragment at nearly the same depth, but with another ε; [`Threshold::NONE`] if there is
    /// none.
    pub tie: Threshold,
}

/// Visibility results of a pixel for each side of oriented surfaces: front, then back (rendering model §5).
#[derive(Clone, Copy, Debug)]
pub(crate) struct SideThresholds {
    /// Depth threshold of each side's fragments. Fragments of undeclared splats count for both sides.
    pub thresholds: [Threshold; 2],
    /// Smallest [`nearness`] of each side's fragments, as the field `depth`; the other fields are those of the fragment
    /// that has it. It is +∞ if a side has no fragment.
    pub nearest: [Threshold; 2],
}

impl SideThresholds {
    pub(crate) const NONE: Self = Self { thresholds: [Threshold::NONE; 2], nearest: [Threshold::NONE; 2] };

    /// Adds a fragment of the visibility pass at depth `z`, on the side that `facing` names.
    pub(crate) fn add(&mut self, splat: &ScreenSplat, facing: Facing, z: f64) {
        let own = Threshold::of(splat, z);
        for (side, its_own) in [Facing::Front, Facing::Back].into_iter().enumerate() {
            if facing == Facing::Undeclared || facing == its_own {
                self.thresholds[side].lower(own);
            }
            if facing == its_own {
                self.nearest[side].lower(Threshold { depth: nearness(z, splat.epsilon, side == 1), ..own });
            }
        }
    }

    /// Returns the smallest [`nearness`] of each side's fragments, a depth by which the nearer side is chosen. It is +∞
    /// for a side without fragments.
    pub(crate) fn nearness(&self) -> [f64; 2] {
        self.nearest.map(|nearest| nearest.depth)
    }

    /// Returns the threshold of a pixel that shows `side`; the other side limits the depth.
    pub(crate) fn limited(&self, side: usize) -> Threshold {
        let [own, other] = [self.nearest[side], self.nearest[1 - side]];
        let mut threshold = self.thresholds[side];
        threshold.lower(Threshold { depth: sheet_limit(own.depth, other.depth), ..other });
        threshold
    }

    /// Returns the pixel's threshold, which belongs to the nearer side.
    pub(crate) fn shown(&self) -> Threshold {
        match self.nearness() {
            [f64::INFINITY, f64::INFINITY] => self.thresholds[0],
            [front, back] if back < front => Threshold { facing: Facing::Back, nearest: back, ..self.limited(1) },
            [front, _] => Threshold { facing: Facing::Front, nearest: front, ..self.limited(0) },
        }
    }
}
