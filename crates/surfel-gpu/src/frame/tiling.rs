//! Tiling: cuts a frame into tiles that fit the device.

use crate::frame::gaussians::{ProjectedGaussians, halves};
use crate::frame::planes::{floats_per_pixel, neighbour_floats};
use crate::frame::tile::TileData;
use crate::frame::uniforms::FrameScene;
use crate::passes::cells::{GpuPath, MAX_CELL_TILE};
use crate::passes::pass_list::has_layers;
use crate::scene::limits::Limits;
use crate::scene::segment::UploadedScene;
use surfel_render::{FramePlan, Pass, Region, View};
use surfel_shaders::layout;

/// Largest side of a tile in pixels. Records store pixel coordinates in 16 bits.
const MAX_SIDE: u32 = u16::MAX as u32;

/// Returns the image region that the textures (targets) of a tile cover: the tile, and a border of pixels whose values
/// passes over neighbouring pixels read. The border ends at the image's edge.
pub(crate) fn targets_of(tile: Region, view: &View, plan: &FramePlan) -> Region {
    tile.grown(plan.reach_px(), view.size)
}

/// Splits the view's region into tiles, row by row, whose textures and planes are within the limits. `by_cells` is true
/// for the compute path.
pub(crate) fn tiles(view: &View, plan: &FramePlan, limits: Limits, by_cells: bool) -> Vec<Region> {
    let largest = if by_cells { MAX_CELL_TILE } else { MAX_SIDE };
    let side = limits.texture_side.min(largest).saturating_sub(2 * plan.reach_px()).max(1);
    let layer_bytes = if has_layers(plan) { layout::layer_composite::SIZE as u64 } else { 0 };
    // A cell has at least one pixel.
    let layers = if has_layers(plan) { layout::LAYER_WORDS + layout::CELL_LAYER_WORDS } else { 0 };
    let cell_data = neighbour_floats(plan).iter().sum::<u32>() + layers;
    let cell_data = if by_cells { cell_data } else { 0 };
    let bytes = layer_bytes.max(4 * u64::from((floats_per_pixel(plan.planes) + cell_data).max(1)));
    // The planes of Gaussians begin with one extra float.
    let pixels = (limits.buffer_bytes.min(u64::from(u32::MAX)).saturating_sub(4) / bytes).max(1);
    // The border counts, too.
    let borders = 2 * u64::from(plan.reach_px());
    let within = |pixels: u64| pixels.saturating_sub(borders).clamp(1, u64::from(side)) as u32;
    let width = view.region.width.min(within(pixels / (1 + borders)));
    let height = view.region.height.min(within(pixels / (u64::from(width) + borders)));
    let mut tiles = Vec::new();
    let r = view.region;
    for y in (0..r.height).step_by(height as usize) {
        for x in (0..r.width).step_by(width.max(1) as usize) {
            tiles.push(Region {
                x: r.x + x,
                y: r.y + y,
                width: width.min(r.width - x),
                height: height.min(r.height - y),
            });
        }
    }
    tiles
}

/// Iterator over the data of a frame's tiles.
pub struct FrameTiles<'a> {
    scene: &'a UploadedScene,
    frame: &'a FrameScene,
    view: &'a View,
    plan: &'a FramePlan,
    limits: Limits,
    by_cells: bool,
    gaussians: Option<ProjectedGaussians>,
    /// Regions not yet drawn, in reverse order.
    regions: Vec<Region>,
}

impl<'a> FrameTiles<'a> {
    /// Creates the iterator for a frame, and projects the frame's Gaussians.
    pub fn new(
        scene: &'a UploadedScene,
        frame: &'a FrameScene,
        view: &'a View,
        plan: &'a FramePlan,
        limits: Limits,
        path: GpuPath,
    ) -> Self {
        let by_cells = path.draws_cells(plan);
        let gaussians = plan.has(Pass::Gaussians).then(|| ProjectedGaussians::new(scene, view, plan));
        let mut regions = tiles(view, plan, limits, by_cells);
        regions.reverse();
        Self { scene, frame, view, plan, limits, by_cells, gaussians, regions }
    }
}

impl Iterator for FrameTiles<'_> {
    /// A tile, or a message that states the cause and a remedy if its Gaussians don't fit the device.
    type Item = Result<TileData, String>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut region = self.regions.pop()?;
        let mut lists = None;
        while let Some(gaussians) = self.gaussians.as_ref().filter(|_| lists.is_none()) {
            match (gaussians.lists(region, self.limits), halves(region)) {
                (Ok(found), _) => lists = Some(found),
                (Err(_), Some([first, second])) => {
                    self.regions.push(second);
                    region = first;
                }
                (Err(too_many), None) => return Some(Err(too_many.message(self.limits))),
            }
        }
        let make = if self.by_cells { TileData::of_cells } else { TileData::new };
        let mut data = make(self.scene, self.frame, self.view, self.plan, region);
        if let Some(lists) = lists {
            data.put_gaussians(lists);
        }
        Some(Ok(data))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Camera, Projection, Settings};
    use surfel_render::{Capabilities, Planes, SceneSummary, plan};

    fn view(size: [u32; 2]) -> View {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0]);
        View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap()
    }

    fn planned(view: &View, planes: Planes) -> FramePlan {
        let capabilities = Capabilities::everything("test");
        plan(&SceneSummary::default(), view, &Settings::default(), planes, &capabilities).unwrap()
    }

    #[test]
    fn tiles_cover_every_pixel_once_within_the_limits() {
        let view = view([100, 70]);
        let plan = planned(&view, Planes::ALL);
        // Nine floats are 36 bytes a pixel, so a tile has at most 277 pixels.
        let limits = |side, bytes| Limits::default().within(bytes, side);
        let tiles = tiles(&view, &plan, limits(64, 10_000), false);
        let mut hits = vec![0; 7000];
        for t in &tiles {
            assert!(t.width <= 64 && t.height <= 64 && t.width * t.height <= 277, "{t:?}");
            for y in t.y..t.y + t.height {
                for x in t.x..t.x + t.width {
                    hits[(y * 100 + x) as usize] += 1;
                }
            }
        }
        assert!(hits.iter().all(|&h| h == 1));
        assert_eq!(super::tiles(&view, &plan, limits(8192, 1 << 27), false).len(), 1);
    }

    #[test]
    fn targets_have_a_border_inside_the_image_for_edges_alone() {
        let view = view([100, 70]);
        let plain = planned(&view, Planes::COLOR);
        let edges = FramePlan { passes: vec![Pass::EdgeAntialiasing], ..plain.clone() };
        let tile = Region { x: 0, y: 30, width: 50, height: 40 };
        assert_eq!(targets_of(tile, &view, &plain), tile);
        assert_eq!(targets_of(tile, &view, &edges), Region { x: 0, y: 29, width: 51, height: 41 });
        assert!(
            tiles(&view, &edges, Limits::default().within(1 << 27, 64), false).iter().all(|t| targets_of(
                *t, &view, &edges
            )
            .width
                <= 64)
        );
    }
}
