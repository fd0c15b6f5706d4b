//! Drawing of trained Gaussians (docs/gaussians.md): front to back, in tiles of 16×16 pixels.
//!
//! - `records` projects all Gaussians and sorts them once, by the depth of their centres or by their nearest depth. It
//!   divides the sorted records into parts and lists each part by tile.
//! - `tile` blends a tile's lists part by part, so that the order within each pixel doesn't depend on the number of
//!   threads.
//! - `pending` sorts the fragments of each pixel if the settings ask for that.

mod grid;
mod pending;
mod records;
mod tile;

use crate::gaussians::grid::TileGrid;
use crate::gaussians::pending::Pending;
use crate::scene::resident::ResidentScene;
use crate::simd::level::{Instructions, with_instructions};
use fearless_simd::Simd;
use rayon::prelude::*;
use records::Record;
use surfel_math::gaussian;
use surfel_model::Sort;
use surfel_render::clock::Instant;
use surfel_render::{Frame, FramePlan, GaussianColors, Identity, PassTime, Stats, View};
use tile::{Tile, TileInputs};

/// Largest number of entries in tiles' lists that are in memory at once. If a frame has more, its tiles are listed and
/// drawn in batches. A single tile with more is one batch.
const MAX_ENTRIES: u64 = 1 << 24;

/// Draws a frame of Gaussians on the current thread pool.
pub(crate) fn draw(
    instructions: Instructions,
    scene: &ResidentScene,
    (view, plan): (&View, &FramePlan),
    frame: &mut Frame,
    stats: &mut Stats,
) {
    let mut last = Instant::now();
    let mut lap = |stats: &mut Stats, name| {
        let now = Instant::now();
        stats.passes.push(PassTime { name, ms: (now - last).as_secs_f64() * 1e3 });
        last = now;
    };
    let grid = TileGrid::new(view.region);
    let mut parts = records::project(&scene.gaussians, (view, plan), &grid);
    lap(stats, "project");
    stats.drawn = parts.iter().map(|part| part.records.len() as u64).sum();
    let linear = scene.summary.gaussians == Some(GaussianColors::Linear);
    let background = gaussian::background(scene.straight_background(), linear);
    let near = gaussian::near(&view.projection) as f32;
    frame.resize(view.region.width, view.region.height, plan.planes);
    let inputs = TileInputs { grid: &grid, near, background, linear, planes: plan.planes };
    let batches = records::batches(&parts, &grid, MAX_ENTRIES);
    let (cells, mut tested) = (batches.len() as f64, 0);
    for tiles in batches {
        parts.par_iter_mut().for_each(|part| part.list(&tiles, &grid));
        let first = tiles.start;
        let listed = &parts;
        let draw = |pending: &mut Option<_>, tile: usize| {
            let records = listed.iter().flat_map(|part| part.of_tile(tile - first));
            draw_tile(instructions, &inputs, records, tile, pending.as_mut())
        };
        let pending = || (plan.sort == Sort::Pixel).then(Pending::default);
        let drawn: Vec<Tile> = tiles.into_par_iter().map_init(pending, draw).collect();
        for (t, tile) in drawn.iter().enumerate() {
            tile.write(&grid, first + t, frame);
            stats.fragments += tile.fragments();
            tested += tile.tested;
        }
    }
    let culled = (plan.splats - stats.drawn) as f64;
    stats.counters = vec![
        ("cells", cells),
        ("culled", culled),
        ("culled_outside", culled),
        ("culled_back_facing", 0.0),
        ("set_up", stats.drawn as f64),
        ("fragments_tested", tested as f64),
        ("fragments_inside", stats.fragments as f64),
    ];
    frame.finish(view, |_| Identity::NOTHING);
    lap(stats, "blend");
}

fn draw_tile<'a>(
    instructions: Instructions,
    inputs: &TileInputs<'_>,
    records: impl Iterator<Item = &'a Record>,
    tile: usize,
    pending: Option<&mut Pending<'a>>,
) -> Tile {
    with_instructions!(instructions, simd => {
        simd.vectorize(#[inline(always)] || Tile::draw(simd, inputs, records, tile, pending))
    })
}
