//! Samples of edge pixels (rendering model §5) for raster hardware. Samples are the pixels of a finer view, which is
//! drawn after a tile of pixels, part by part, into the textures (targets) of the tile.

use crate::frame::tile::TileData;
use crate::frame::uniforms::FrameScene;
use crate::passes::schedule::{Step, sample_schedule};
use crate::scene::segment::UploadedScene;
use surfel_render::{FramePlan, Pass, Region, SAMPLES_SIDE, View};
use surfel_shaders::layout;

// Asserts that the shaders and the model use the same constant.
const _: () = assert!(SAMPLES_SIDE == layout::SAMPLES_SIDE, "samples along a pixel's side");

/// Part of a tile's samples that fits the tile's textures (targets).
#[derive(Clone, Debug)]
pub struct SamplePart {
    /// Data of the samples in addition to the resident scene. Its layout of planes is that of the tile of pixels, to
    /// which the samples' means are written.
    pub data: TileData,
    /// Steps that draw the samples. They run after the tile's own steps.
    pub steps: Vec<Step>,
}

impl SamplePart {
    /// Splits the samples of a tile of pixels, given by its region and data, into parts that each fit the tile's
    /// textures (targets). Empty if the plan doesn't antialias edges by samples. `shared_records` is true if all
    /// segments share one buffer of records.
    pub fn all(
        scene: &UploadedScene,
        frame: &FrameScene,
        view: &View,
        plan: &FramePlan,
        (tile, pixels): (Region, &TileData),
        shared_records: bool,
    ) -> Vec<Self> {
        if !plan.has(Pass::EdgeSamples) {
            return Vec::new();
        }
        let (fine_view, fine_plan) = (view.of_samples(), plan.of_samples());
        let part = |region: Region| {
            let mut data = TileData::new(scene, frame, &fine_view, &fine_plan, region);
            data.attach_to_pixel_tile(pixels, region);
            let steps = sample_schedule(plan, &data.visible(), shared_records);
            Self { data, steps }
        };
        regions(tile.of_samples(), pixels.target_size(plan)).into_iter().map(part).collect()
    }
}

/// Splits a region of samples into regions of whole pixels, none larger than `size`. All are in samples.
fn regions(samples: Region, size: [u32; 2]) -> Vec<Region> {
    let [width, height] = size.map(|side| side / SAMPLES_SIDE * SAMPLES_SIDE);
    let rows = (0..samples.height).step_by(height as usize);
    let columns = || (0..samples.width).step_by(width as usize);
    let region = |x: u32, y: u32| Region {
        x: samples.x + x,
        y: samples.y + y,
        width: width.min(samples.width - x),
        height: height.min(samples.height - y),
    };
    rows.flat_map(|y| columns().map(move |x| region(x, y))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_hold_every_sample_once_in_whole_pixels_and_fit() {
        for ([width, height], size) in [([5, 3], [7, 4]), ([1, 1], [4, 4]), ([100, 70], [102, 71]), ([30, 1], [32, 4])]
        {
            let samples = Region { x: 12, y: 8, width, height }.of_samples();
            let found = regions(samples, size);
            let mut hits = vec![0; (16 * width * height) as usize];
            for r in &found {
                assert!(r.width <= size[0] && r.height <= size[1], "{r:?}");
                assert!([r.x, r.y, r.width, r.height].iter().all(|n| n % SAMPLES_SIDE == 0), "{r:?}");
                for (x, y) in (0..r.height).flat_map(|j| (0..r.width).map(move |i| (r.x + i, r.y + j))) {
                    hits[((y - samples.y) * samples.width + x - samples.x) as usize] += 1;
                }
            }
            assert!(hits.iter().all(|&n| n == 1));
        }
    }
}
