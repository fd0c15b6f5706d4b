//! The depth thresholds that visibility leaves in pixels (§5).

use crate::splat::{Facing, ScreenSplat};
use surfel_math::facing::{nearness, sheet_limit};

/// The depth up to which fragments belong to a pixel's nearest surface: its smallest z + ε.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Threshold {
    /// Fragments up to this depth add their attributes; +∞ where there is no visibility fragment.
    pub depth: f64,
    /// z + ε of the writer: `depth`, unless the other side of a sheet sets that.
    pub writer_depth: f64,
    /// ε of the writer.
    pub epsilon: f64,
    /// The side that the pixel shows of oriented surfaces; undeclared: any.
    pub facing: Facing,
    /// How near that side comes; +∞ where no sides are kept apart.
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

    /// The one that a fragment at depth `z` sets.
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

    /// Lowers it to another one's depth. Of equal ones the first stays: splats come in index order, so that the
    /// smallest (z + ε, index) wins.
    pub(crate) fn lower(&mut self, other: Self) {
        if other.depth < self.depth {
            *self = other;
        }
    }

    /// True if the pixel shows the side that a splat does.
    pub(crate) fn shows(&self, facing: Facing) -> bool {
        self.facing == Facing::Undeclared || facing == Facing::Undeclared || facing == self.facing
    }
}

/// The thresholds that a pixel could have, however its marginal tests come out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PossibleThresholds {
    /// The one if every fragment on a rim is inside.
    pub nearest: Threshold,
    /// The one if none is.
    pub farthest: Threshold,
    /// One as near as the pixel's within the margin, by another ε; none if there is no such.
    pub tie: Threshold,
}

/// What visibility finds of both sides of oriented surfaces in a pixel (§5): front-facing, then back-facing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sides {
    /// Thresholds over the fragments of either side. Those of undeclared splats count for both.
    pub thresholds: [Threshold; 2],
    /// How near either side's fragments come, as depth, and the fragment that comes nearest; +∞ without any.
    pub nearest: [Threshold; 2],
}

impl Sides {
    pub(crate) const NONE: Self = Self { thresholds: [Threshold::NONE; 2], nearest: [Threshold::NONE; 2] };

    /// Takes in a visibility fragment.
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

    /// How near either side comes; +∞ without any fragment.
    pub(crate) fn nearness(&self) -> [f64; 2] {
        self.nearest.map(|nearest| nearest.depth)
    }

    /// The threshold of a side if a pixel shows it: the other side ends what blends there.
    pub(crate) fn limited(&self, side: usize) -> Threshold {
        let [own, other] = [self.nearest[side], self.nearest[1 - side]];
        let mut threshold = self.thresholds[side];
        threshold.lower(Threshold { depth: sheet_limit(own.depth, other.depth), ..other });
        threshold
    }

    /// The pixel's threshold, of the side that it shows.
    pub(crate) fn shown(&self) -> Threshold {
        match self.nearness() {
            [f64::INFINITY, f64::INFINITY] => self.thresholds[0],
            [front, back] if back < front => Threshold { facing: Facing::Back, nearest: back, ..self.limited(1) },
            [front, _] => Threshold { facing: Facing::Front, nearest: front, ..self.limited(0) },
        }
    }
}
