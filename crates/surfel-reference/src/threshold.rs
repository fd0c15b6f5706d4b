//! Depth thresholds, the result of visibility in each pixel (§5).

use crate::splat::{Facing, ScreenSplat};
use surfel_math::facing::nearness;

/// The depth up to which fragments belong to a pixel's nearest surface: its smallest z + ε.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Threshold {
    /// z + ε of the writer; +∞ without a visibility fragment.
    pub depth: f64,
    /// ε of the writer.
    pub epsilon: f64,
    /// Side of oriented surfaces that the pixel shows; undeclared if it shows both.
    pub facing: Facing,
}

impl Threshold {
    pub(crate) const NONE: Self = Self { depth: f64::INFINITY, epsilon: 0.0, facing: Facing::Undeclared };

    /// Returns the threshold that a fragment at depth `z` sets.
    pub(crate) fn of(splat: &ScreenSplat, z: f64) -> Self {
        Self { depth: z + splat.epsilon, epsilon: splat.epsilon, ..Self::NONE }
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
    /// Nearest depth of each side's fragments; +∞ without any.
    pub nearest: [f64; 2],
}

impl Sides {
    pub(crate) const NONE: Self = Self { thresholds: [Threshold::NONE; 2], nearest: [f64::INFINITY; 2] };

    /// Adds a visibility fragment.
    pub(crate) fn add(&mut self, splat: &ScreenSplat, facing: Facing, z: f64) {
        let own = Threshold::of(splat, z);
        for (side, its_own) in [Facing::Front, Facing::Back].into_iter().enumerate() {
            if facing == Facing::Undeclared || facing == its_own {
                self.thresholds[side].lower(own);
            }
            if facing == its_own {
                let near = nearness(z, splat.epsilon, facing == Facing::Back);
                self.nearest[side] = self.nearest[side].min(near);
            }
        }
    }

    /// Returns the pixel's threshold, of the side that it shows.
    pub(crate) fn shown(&self) -> Threshold {
        match self.nearest {
            [f64::INFINITY, f64::INFINITY] => self.thresholds[0],
            [front, back] if back < front => Threshold { facing: Facing::Back, ..self.thresholds[1] },
            _ => Threshold { facing: Facing::Front, ..self.thresholds[0] },
        }
    }
}
