//! Inputs shared by all blocks of a cell.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *record* is a splat projected to the screen
//! ([`Record`](crate::setup::record::Record)).

use crate::scene::numbers::SplatNumbers;
use crate::setup::clips::CellClips;
use crate::setup::evaluate::FrameConstants;
use crate::setup::near::NearSplat;
use surfel_render::{Attributes, FramePlan, Pass, View};

/// Quantities that the plan needs per pixel. Others are neither computed nor stored.
#[derive(Clone, Copy)]
pub(crate) struct Wanted {
    pub attributes: Attributes,
    /// True if a pixel needs the ε of the splat that set its depth threshold.
    pub epsilon: bool,
    /// True if a pixel needs the far end of its nearest polygon's depth range, as for edges by samples (rendering model
    /// §5).
    pub polygon_ends: bool,
    /// True if fragments are counted, both those inside footprints and those that contribute.
    pub counts: bool,
    /// True if a pixel needs the number of its nearest splat.
    pub nearest: bool,
    /// True if front- and back-facing splats of oriented clouds are kept apart, so that each pixel shows one side.
    pub facings: bool,
}

/// Inputs of rasterisation that all blocks of a frame share.
pub(crate) struct RasterFrame {
    pub constants: FrameConstants,
    pub wanted: Wanted,
    /// Ambient, diffuse, specular and shininess factors of each object's material.
    pub factors: Vec<[f32; 4]>,
    /// Factor from weight to coverage of each object: 1/W0, the reciprocal of its interior weight; 1 if the weight is
    /// unknown.
    pub coverage: Vec<f32>,
    /// Factor from a pixel's sum of weights to its coverage, if it is the same for all splats; coverage then isn't
    /// summed. `None` if the factors differ, or if the plan needs no coverage.
    pub coverage_of_weight: Option<f32>,
    /// Numbering of splats that records store in place of object indices if the frame outputs the nearest splat; else
    /// empty.
    pub numbers: SplatNumbers,
}

impl RasterFrame {
    /// Returns the inputs for drawing depth thresholds: without factors of materials and coverage, and without numbers
    /// of splats. The field `wanted` is nevertheless as the plan states.
    pub(crate) fn depth_only(plan: &FramePlan, view: &View) -> Self {
        let (factors, coverage) = (Vec::new(), Vec::new());
        let wanted = Wanted {
            attributes: plan.attributes,
            epsilon: plan.has(Pass::EdgeAntialiasing) || plan.has(Pass::EdgeSamples),
            polygon_ends: plan.has(Pass::EdgeSamples),
            counts: plan.planes.fragments,
            nearest: plan.has(Pass::Nearest),
            facings: plan.keeps_facings,
        };
        let (constants, numbers) = (FrameConstants::new(plan, view), SplatNumbers::default());
        Self { constants, wanted, factors, coverage, coverage_of_weight: None, numbers }
    }
}

/// Inputs of rasterisation that all blocks of a cell share.
#[derive(Clone, Copy)]
pub(crate) struct RasterInputs<'a> {
    pub frame: &'a RasterFrame,
    /// The cell's near splats ([`near`](crate::setup::near)), which are evaluated in f64.
    pub near: &'a [NearSplat],
    pub clips: &'a CellClips,
    /// Largest depth tolerance ε, in world units, of the cell's opaque splats of oriented clouds, if front and back
    /// sides are blended separately; else 0.
    pub largest_epsilon: f32,
}
