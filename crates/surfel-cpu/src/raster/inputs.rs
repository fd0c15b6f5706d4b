//! Inputs shared by all blocks of a cell.

use crate::scene::numbers::SplatNumbers;
use crate::setup::clips::CellClips;
use crate::setup::evaluate::FrameConstants;
use crate::setup::near::NearSplat;
use surfel_render::{Attributes, FramePlan, Pass, View};

/// Quantities that the plan needs per pixel.
#[derive(Clone, Copy)]
pub(crate) struct Wanted {
    pub attributes: Attributes,
    /// True if the ε of the splat that set the depth threshold is needed.
    pub epsilon: bool,
    /// True if the far ends of the polygons' depth ranges are needed.
    pub polygon_ends: bool,
    /// True if fragments are counted, both inside footprints and added.
    pub counts: bool,
    /// True if the nearest splat of each pixel is needed.
    pub nearest: bool,
    /// True if front- and back-facing splats of oriented clouds are separated.
    pub facings: bool,
}

/// Inputs shared by all blocks of a frame.
pub(crate) struct RasterFrame {
    pub constants: FrameConstants,
    pub wanted: Wanted,
    /// Ambient, diffuse, specular and shininess factors per object.
    pub factors: Vec<[f32; 4]>,
    /// Reciprocal 1/W0 of the interior weight, per object.
    pub coverage: Vec<f32>,
    /// Coverage per unit of weight, if it is the same for all splats; coverage isn't summed then.
    pub coverage_of_weight: Option<f32>,
    /// Numbers that records store in place of object indices if the nearest splat is needed; else empty.
    pub numbers: SplatNumbers,
}

impl RasterFrame {
    /// Returns the inputs for depths without attributes.
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

/// Inputs shared by all blocks of a cell.
#[derive(Clone, Copy)]
pub(crate) struct RasterInputs<'a> {
    pub frame: &'a RasterFrame,
    pub near: &'a [NearSplat],
    pub clips: &'a CellClips,
    /// The largest ε of the splats whose facings are separated.
    pub largest_epsilon: f32,
}
