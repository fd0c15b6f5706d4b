//! What all blocks of a cell share.

use crate::scene::numbers::SplatNumbers;
use crate::setup::clips::CellClips;
use crate::setup::evaluate::FrameConstants;
use crate::setup::near::NearSplat;
use surfel_render::{Attributes, FramePlan, Pass, View};

/// What is wanted of a block's pixels, from the plan.
#[derive(Clone, Copy)]
pub(crate) struct Wanted {
    pub attributes: Attributes,
    /// The ε of the splat that set the depth threshold.
    pub epsilon: bool,
    /// Where polygons end.
    pub polygon_ends: bool,
    /// How many fragments are inside footprints, and how many are added.
    pub counts: bool,
    /// The nearest splat of each pixel.
    pub nearest: bool,
    /// Front- and back-facing splats of oriented clouds are kept apart.
    pub facings: bool,
}

/// What all blocks of a frame share.
pub(crate) struct RasterFrame {
    pub constants: FrameConstants,
    pub wanted: Wanted,
    /// Ambient, diffuse, specular, shininess of every object.
    pub factors: Vec<[f32; 4]>,
    /// 1/W0 of every object.
    pub coverage: Vec<f32>,
    /// Coverage of a unit of weight, where it is the same for all splats: it isn't summed then.
    pub coverage_of_weight: Option<f32>,
    /// What records hold in place of their objects, where the nearest splat is wanted; else empty.
    pub numbers: SplatNumbers,
}

impl RasterFrame {
    /// For depths alone.
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

/// What all blocks of a cell share.
#[derive(Clone, Copy)]
pub(crate) struct RasterInputs<'a> {
    pub frame: &'a RasterFrame,
    pub near: &'a [NearSplat],
    pub clips: &'a CellClips,
    /// The largest ε of splats whose sides are kept apart.
    pub largest_epsilon: f32,
}
