//! Depth thresholds: the result of the visibility pass in each pixel (§5).

use crate::splat::{Facing, ScreenSplat};
use surfel_math::facing::{nearness, sheet_limit};

/// Depth up to which fragments belong to a pixel's nearest surface: the smallest z + ε of its fragments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Threshold {
    /// Depth up to which fragments' attributes are summed; +∞ without a visibility fragment.
    pub depth: f64,
    /// z + ε of the fragment that set the threshold. It equals `depth`, unless the other side of the surface limits the
    /// depth.
    pub writer_depth: f64,
    /// ε of the fragment that set the threshold.
    pub epsilon: f64,
    /// Side of oriented surfaces that the pixel shows, or [`Facing::Undeclared`] if it shows both.
    pub facing: Facing,
    /// Nearest depth of the side that the pixel shows; +∞ if sides aren't separated.
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

    /// Creates the threshold of a fragment at depth `z`.
    pub(crate) fn of(splat: &ScreenSplat, z: f64) -> Self {
        let depth = z + splat.epsilon;
        Self { depth, writer_depth: depth, epsilon: splat.epsilon, ..Self::NONE }
    }

    /// Returns the threshold that a fragment would set in a pixel with this threshold. A fragment on the other side of
    /// the surface limits the depth instead.
    pub(crate) fn by(&self, splat: &ScreenSplat, z: f64) -> Self {
        let own = Self::of(splat, z);
        if self.shows(splat.facing) {
            return own;
        }
        let near = nearness(z, splat.epsilon, splat.facing == Facing::Back);
        Self { depth: sheet_limit(self.nearest, near), ..own }
    }

    /// True if the other side of the surface limits the threshold's depth.
    pub(crate) fn ends_sheet(&self) -> bool {
        self.writer_depth > self.depth
    }

    /// Lowers the threshold to a nearer one. Of equal depths, the first remains. Since splats come in index order, the
    /// smallest (z + ε, index) wins.
    pub(crate) fn lower(&mut self, other: Self) {
        if other.depth < self.depth {
            *self = other;
        }
    }

    /// True if the pixel shows the side of a splat with this facing.
    pub(crate) fn shows(&self, facing: Facing) -> bool {
        self.facing == Facing::Undeclared || facing == Facing::Undeclared || facing == self.facing
    }
}

/// Thresholds that a pixel could have, for either result of the tests that rounding could change.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PossibleThresholds {
    /// Threshold if every fragment on a rim is inside.
    pub nearest: Threshold,
    /// Threshold if no fragment on a rim is inside.
    pub farthest: Threshold,
    /// Threshold within the margin of the pixel's own, but with another ε; [`Threshold::NONE`] if there is none.
    pub tie: Threshold,
}

/// Visibility results of a pixel for the front and the back side of oriented surfaces, in this order (§5).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sides {
    /// Threshold of each side's fragments. Fragments of undeclared splats count for both sides.
    pub thresholds: [Threshold; 2],
    /// Nearest depth of each side's fragments, and the fragment that has this depth; +∞ if there are none.
    pub nearest: [Threshold; 2],
}

impl Sides {
    pub(crate) const NONE: Self = Self { thresholds: [Threshold::NONE; 2], nearest: [Threshold::NONE; 2] };

    /// Adds a fragment of the visibility pass.
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

    /// Returns the nearest depth of each side; +∞ for a side without fragments.
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
