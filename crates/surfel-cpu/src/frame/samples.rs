//! Drawing of the samples of a cell's edge pixels: 4×4 samples per pixel (rendering model §5). Splats around these
//! pixels are set up again, in a view whose pixels are samples.
//!
//! A *cell* is a part of the view that one thread draws alone ([`Cell`]).

use crate::cull::balls::BallView;
use crate::cull::cells::Cell;
use crate::cull::chunks::VisibleChunk;
use crate::cull::object::ObjectView;
use crate::frame::totals::Totals;
use crate::frame::{Drawing, FrameInputs, is_opaque_splats_only};
use crate::raster::inputs::{RasterFrame, RasterInputs};
use crate::raster::listing::Listing;
use crate::screen::composite::{CompositeJob, Extras};
use crate::screen::samples::SampleJob;
use crate::screen::steps::StepPlanes;
use crate::screen::tile::{TileJob, TileScratch};
use crate::setup::balls::BallSegment;
use crate::setup::prepare::{CellSetup, CellSplats};
use crate::setup::triangles::{TriangleSegment, project_some};
use crate::shade::lighting::Lighting;
use crate::tiles::drawn::{BlockSet, DrawnBlocks};
use crate::tiles::target::Target;
use surfel_model::Cull;
use surfel_render::{Pass, View};

/// The view whose pixels are the samples of the image's pixels, four times as many along each axis. Also the objects,
/// raster inputs and lighting for this view.
pub(super) struct SampleView<'a> {
    pub view: &'a View,
    pub objects: Vec<ObjectView<'a>>,
    pub balls: Vec<BallView<'a>>,
    pub raster: RasterFrame,
    pub lighting: Lighting,
}

impl SampleView<'_> {
    /// Returns the chunks of a cell, from near to far, that may touch a sampled pixel. Each sampled pixel is a block of
    /// `sampled`, the block of its samples.
    fn chunks(&self, cell: &Cell, sampled: &BlockSet) -> Vec<VisibleChunk> {
        let touches = |visible: &&VisibleChunk| {
            let (object, chunk) = visible.of(&self.objects);
            sampled.touches(object.pixels(object.center(chunk), chunk))
        };
        cell.chunks.iter().filter(touches).copied().collect()
    }
}

impl Drawing<'_> {
    /// Draws the sampled pixels of a cell. Returns the memory, in bytes, of the splats, balls and triangles that were
    /// set up for the samples; 0 if no pixel is sampled.
    pub(super) fn draw_samples(
        &self,
        samples: &SampleView<'_>,
        cell: &Cell,
        planes: &StepPlanes<'_>,
        target: &mut Target<'_>,
        scratch: &mut TileScratch<'static>,
        totals: &mut Totals,
    ) -> usize {
        let FrameInputs { instructions, pools, plan, .. } = *self.inputs;
        let sampled = planes.sampled(instructions, cell.region);
        if sampled.count == 0 {
            return 0;
        }
        let (grid, drawn) = (sampled.grid, DrawnBlocks::some(&sampled));
        let mut splats = CellSplats::default();
        let setup = CellSetup { instructions, objects: &samples.objects, tiny: None, pool: &pools.setup };
        setup.add_some(&samples.chunks(cell, &sampled), &grid, cell.region, drawn, &mut splats);
        let triangles =
            project_some(instructions, self.meshes, &cell.mesh_parts, samples.view, &grid, Cull::Back, drawn);
        let balls =
            BallSegment::project(instructions, &samples.balls, &cell.ball_parts, (&grid, drawn), plan.ball_alphas);
        if plan.has(Pass::RemainingLayer) {
            let CellSplats { transparent, near, .. } = &mut splats;
            let lit_by = (&samples.lighting, &samples.raster);
            transparent.iter_mut().for_each(|segment| self.light_splats(lit_by, segment, near));
        }
        let job = SampleJob {
            tiles: CompositeJob {
                tiles: TileJob {
                    listing: Listing { segments: &splats.segments, grid },
                    inputs: RasterInputs {
                        frame: &samples.raster,
                        near: &splats.near,
                        clips: &splats.clips,
                        largest_epsilon: splats.largest_epsilon(),
                    },
                    lighting: &samples.lighting,
                    by_splats: false,
                },
                extras: Extras {
                    meshes: self.meshes,
                    triangles: &triangles,
                    transparent: &splats.transparent,
                    layers: self.layers,
                    balls: &balls,
                    ball_looks: &self.ball_looks,
                },
                opaque_splats_only: is_opaque_splats_only(plan),
            },
            sampled: &sampled,
            grid: *planes.grid,
            gbuffer: planes.gbuffer,
            lighting: &self.lighting,
        };
        let mut own = std::mem::take(scratch).for_others();
        totals.counters += job.draw(instructions, target, &mut own);
        *scratch = own.for_others();
        let bytes = splats.bytes() + balls.bytes() + triangles.iter().map(TriangleSegment::bytes).sum::<usize>();
        pools.setup.give_back(splats.segments);
        bytes
    }
}
