//! Depth thresholds, the result of visibility in each pixel (§5).

use crate::splat::{Facing, ScreenSplat};
use surfel_math::facing::{nearness, sheet_limit};

/// The depth up to which fragments belong to a pixel's nearest surface: its smallest z + ε.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Threshold {
    /// Depth up to which fragments add their attributes; +∞ without a visibility fragment.
    pub depth: f64,
    /// z + ε of the writer: `depth`, unless the other side of a sheet sets that.
    pub writer_depth: f64,
    /// ε of the writer.
    pub epsilon: f64,
    /// Side of oriented surfaces that the pixel shows; undeclared if it shows both.
    pub facing: Facing,
    /// Nearest depth of that side; +∞ where sides aren't separated.
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

    /// Returns the threshold that a fragment at depth `z` sets.
    pub(crate) fn of(splat: &ScreenSplat, z: f64) -> Self {
        let depth = z + splat.epsilon;
        Self { depth, writer_depth: depth, epsilon: splat.epsilon, ..Self::NONE }
    }

    /// The one that a fragment sets in a pixel that has this threshold: of the other side, where a sheet ends.
    pub(crate) fn by(&self, splat: &ScreenSplat, z: f64) -> Self {
        let own = Self::of(splat, z);
        if self.shows(splat.facing) {
            return own;
        }
        let near = nearness(z, splat.epsilon, splat.facing == Facing::Back);
        Self { depth: sheet_limit(self.nearest, near), ..own }
    }

    /// True if the other side of a sheet sets it.
    pub(crate) fn ends_sheet(&self) -> bool {
        self.writer_depth > self.depth
    }

    /// Lowers the threshold to another one's depth. Among equal depths the first remains: splats come in index order,
    /// so that the smallest (z + ε, index) wins.
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

/// The thresholds that a pixel could have, for either result of its marginal tests.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PossibleThresholds {
    /// Threshold if every fragment on a rim is inside.
    pub nearest: Threshold,
    /// Threshold if no fragment on a rim is inside.
    pub farthest: Threshold,
    /// Threshold as near as the pixel's within the margin, with another ε; [`Threshold::NONE`] without one.
    pub tie: Threshold,
}

/// Results of visibility for both sides of oriented surfaces in a pixel (§5): front-facing, then back-facing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sides {
    /// Thresholds over the fragments of each side. Fragments of undeclared splats count for both.
    pub thresholds: [Threshold; 2],
    /// Nearest depth of each side's fragments, and the fragment that has it; +∞ without any.
    pub nearest: [Threshold; 2],
}

impl Sides {
    pub(crate) const NONE: Self = Self { thresholds: [Threshold::NONE; 2], nearest: [Threshold::NONE; 2] };

    /// Adds a visibility fragment.
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

    /// Returns the nearest depth of each side; +∞ without any fragment.
    pub(crate) fn nearness(&self) -> [f64; 2] {
        self.nearest.map(|nearest| nearest.depth)
    }

    /// Returns the threshold of a side if a pixel shows it: the other side ends what blends there.
    pub(crate) fn limited(&self, side: usize) -> Threshold {
        let [own, other] = [self.nearest[side], self.nearest[1 - side]];
        let mut threshold = self.thresholds[side];
        threshold.lower(Threshold { depth: sheet_limit(own.depth, other.depth), ..other });
        threshold
    }

    /// Returns the pixel's threshold, of the side that it shows.
    pub(crate) fn shown(&self) -> Threshold {
        match self.nearness() {
            [f64::INFINITY, f64::INFINITY] => self.thresholds[0],
            [front, back] if back < front => Threshold { facing: Facing::Back, nearest: back, ..self.limited(1) },
            [front, _] => Threshold { facing: Facing::Front, nearest: front, ..self.limited(0) },
        }
    }
}
