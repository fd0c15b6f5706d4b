//! Drawing of shadow maps (rendering model §5). A map has the depth thresholds seen from a light, and is drawn by the
//! same cells, setup and tiles as an image.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::cull::balls::BallView;
use crate::cull::cells::{self, CellLimits, OtherParts};
use crate::cull::chunks::visible_chunks;
use crate::cull::object::ObjectView;
use crate::raster::balls::{hides, list_balls};
use crate::raster::depth::thresholds;
use crate::raster::inputs::{RasterFrame, RasterInputs};
use crate::raster::listing::{ListScratch, Listing, list_triangles};
use crate::raster::triangles::nearest;
use crate::scene::resident::ResidentScene;
use crate::setup::balls::{BallRecord, BallSegment};
use crate::setup::prepare::{CellSetup, CellSplats, SetupPool};
use crate::setup::triangles::{TriangleSegment, project};
use crate::shade::shadow_map::ShadowMap;
use crate::simd::compress::ones;
use crate::simd::lanes::Lanes;
use crate::simd::level::{Instructions, with_instructions};
use crate::tiles::drawn::DrawnBlocks;
use crate::tiles::driver::{self, Tuning};
use crate::tiles::grid::Grid;
use crate::tiles::lists::ItemLists;
use crate::tiles::target::{Rows, cut};
use fearless_simd::Simd;
use fearless_simd::prelude::SimdMask;
use surfel_math::Real;
use surfel_math::ball::MIN_TEXELS;
use surfel_math::depth::slope_allowance;
use surfel_math::projection::Projection;
use surfel_model::Cull;
use surfel_render::{Attributes, FramePlan, Region, ShadowMap as PlannedMap, View};

/// A frame whose shadow maps are drawn, and the resources to draw them.
pub(crate) struct ShadowDrawing<'a> {
    pub instructions: Instructions,
    pub tuning: Tuning,
    pub pool: &'a SetupPool,
    pub scene: &'a ResidentScene,
    pub plan: &'a FramePlan,
    /// View of the image, in whose pixels radii of balls may be given.
    pub image: &'a View,
}

impl ShadowDrawing<'_> {
    /// Draws all shadow maps of the plan. Everything opaque casts a shadow, whichever side faces the light or the eye.
    pub(crate) fn draw_all(&self) -> Vec<ShadowMap> {
        self.plan.shadow_maps.iter().map(|map| self.draw(map)).collect()
    }

    fn draw(&self, map: &PlannedMap) -> ShadowMap {
        let plan = FramePlan {
            splat_filter: map.splat_filter,
            attributes: Attributes::default(),
            passes: Vec::new(),
            keeps_facings: false,
            shadow_maps: Vec::new(),
            ..self.plan.clone()
        };
        let (view, region) = (&map.view, map.view.region);
        let [width, height] = view.size.map(|size| size as usize);
        let mut plane = vec![f32::INFINITY; width * height];
        let objects = ObjectView::all(&self.scene.clouds, view, &plan, Cull::None);
        let chunks = visible_chunks(&objects).chunks;
        let setup = CellSetup { instructions: self.instructions, objects: &objects, tiny: None, pool: self.pool };
        let frame = RasterFrame::depth_only(&plan, view);
        let grid = Grid::new(region, self.tuning.tile_blocks);
        let threads = rayon::current_num_threads();
        let limits = CellLimits { splats: self.tuning.cell_splats, reach_px: 0, threads };
        let balls = BallView::all(&self.scene.balls, view, &plan, MIN_TEXELS);
        let others = OtherParts { meshes: &self.scene.meshes, octrees: &plan.octrees, balls: &balls };
        let cells = cells::divide(&objects, &chunks, others, view, &grid, &limits);
        let parts: Vec<Region> = cells.iter().map(|cell| cell.region).collect();
        let jobs = cells.into_iter().zip(cut(&mut plane, region, &parts)).collect();
        let scratch = || (ListScratch::default(), ItemLists::default());
        driver::run(jobs, scratch, |scratch: &mut MapScratch<'static>, (cell, mut target)| {
            let mut splats = CellSplats::default();
            let grid = Grid::new(cell.region, self.tuning.tile_blocks);
            setup.add(&cell.chunks, &grid, cell.region, &mut splats);
            let triangles = project(self.instructions, &self.scene.meshes, &cell.mesh_parts, view, &grid, Cull::None);
            let all = (&grid, DrawnBlocks::default());
            let balls = BallSegment::project(self.instructions, &balls, &cell.ball_parts, all, plan.ball_alphas);
            let inputs = RasterInputs { frame: &frame, near: &splats.near, clips: &splats.clips, largest_epsilon: 0.0 };
            let listing = Listing { segments: &splats.segments, grid };
            let projection = &view.projection;
            let cell = MapCell { listing, triangles: &triangles, balls: &balls, projection, inputs };
            let (lists, of_balls) = std::mem::take(scratch);
            let mut lists = (lists.for_others(), of_balls.for_others());
            for tile in 0..grid.tiles() {
                with_instructions!(self.instructions, simd =>
                    simd.vectorize(#[inline(always)] || cell.draw(simd, tile, &mut target, &mut lists)));
            }
            *scratch = (lists.0.for_others(), lists.1.for_others());
            self.pool.give_back(splats.segments);
        });
        ShadowMap {
            light: map.light,
            projection: view.projection,
            map_from_world: view.view_from_world.as_mat3(),
            to_eye: (self.image.eye - view.eye).as_vec3(),
            side: width,
            thresholds: plane,
        }
    }
}

/// Per-thread block lists for shadow maps, reused between cells: of splats and triangles, and of balls.
type MapScratch<'a> = (ListScratch<'a>, ItemLists<&'a BallRecord>);

/// A cell of a shadow map: its content, sorted into tiles.
struct MapCell<'a> {
    listing: Listing<'a>,
    triangles: &'a [TriangleSegment],
    balls: &'a BallSegment,
    projection: &'a Projection,
    inputs: RasterInputs<'a>,
}

impl<'a> MapCell<'a> {
    #[inline(always)]
    fn draw<S: Simd>(&self, simd: S, tile: usize, target: &mut Rows<'_, f32>, (scratch, balls): &mut MapScratch<'a>) {
        let grid = &self.listing.grid;
        let all = grid.blocks(tile);
        list_triangles(self.triangles, tile, all, &mut scratch.triangles);
        self.listing.list(tile, all, &mut scratch.splats);
        list_balls(self.balls, tile, all, balls);
        for block in ones(all).map(|block| block as u32) {
            let at = grid.block_px(tile, block);
            let (splats, triangles) = (scratch.splats.of(simd, block), scratch.triangles.of(block));
            let balls = balls.of(block);
            if splats.is_empty() && triangles.is_empty() && balls.is_empty() {
                continue;
            }
            let mut threshold = thresholds(simd, splats, at, &self.inputs);
            if !triangles.is_empty() {
                let nearest = nearest(simd, triangles, at, self.inputs.frame.constants.depth_range());
                let there = nearest.z.lt(threshold.constant(f64::INFINITY)).to_bitmask();
                let bias = |z, gradient| slope_allowance(z, gradient, self.projection);
                threshold = threshold.min(nearest.moved_back(simd, triangles, at, there, bias));
            }
            // The lit part of a ball is in front of the ball's centre, and points in its shadow are behind the centre.
            for ball in balls.iter().filter(|ball| ball.alpha >= 1.0) {
                let z = Lanes::splat(simd, ball.z);
                threshold = Lanes::select(hides(simd, ball, at), threshold.min(z), threshold);
            }
            target.put_lanes(at, threshold);
        }
    }
}
