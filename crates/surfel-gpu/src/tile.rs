//! A frame cut into tiles that fit the device, and what each needs beside the resident scene.

use crate::clip::Variant;
use crate::culling::{is_outside, may_reach_near};
use crate::near::{NearJob, NearSplats};
use crate::planes::{PlaneLayout, floats_per_pixel};
use crate::polygon::polygon_words;
use crate::rounds::{has_layers, is_of_map};
use crate::segment::{Limits, Segment, UploadedScene};
use crate::uniforms::{FrameScene, frame_words};
use crate::words::Words;
use rayon::prelude::*;
use surfel_model::ClipPolicy;
use surfel_render::{FramePlan, Pass, Region, View};
use surfel_shaders::layout;

/// Largest side of a tile: records count its pixels in 16 bits.
const LARGEST_SIDE: u32 = u16::MAX as u32;

/// Polygons of a tile, less than.
const MOST_POLYGONS: u32 = 1 << 24;

/// A tile and, where they are inside the image, the pixels around it that passes look at.
fn targets_of(tile: Region, view: &View, plan: &FramePlan) -> Region {
    tile.grown(plan.reach_px(), view.size)
}

/// Cuts the view's region into tiles whose targets and planes are within the limits.
pub fn tiles(view: &View, plan: &FramePlan, limits: Limits) -> Vec<Region> {
    let side = limits.texture_side.min(LARGEST_SIDE).saturating_sub(2 * plan.reach_px()).max(1);
    let veil = if has_layers(plan) { layout::veil::SIZE as u64 } else { 0 };
    let bytes = veil.max(4 * u64::from(floats_per_pixel(plan.planes).max(1)));
    let pixels = (limits.buffer_bytes.min(u64::from(u32::MAX)) / bytes).max(1);
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

/// What of a scene may touch a tile, as indices of its segments.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Visible {
    /// Drawn as opaque.
    pub opaque: Vec<usize>,
    /// Drawn in layers.
    pub transparent: Vec<usize>,
    /// Some near splats are drawn in layers.
    pub near_transparent: bool,
}

impl Visible {
    /// True if anything is drawn in layers.
    pub fn has_transparent(&self) -> bool {
        self.near_transparent || !self.transparent.is_empty()
    }
}

/// What a segment needs for a tile.
#[derive(Clone, Debug)]
pub struct SegmentData {
    /// How it is drawn.
    pub variant: Variant,
    /// It is drawn in layers.
    pub is_transparent: bool,
    /// The shaders' `chunks`.
    pub chunks: Vec<u32>,
    /// The shaders' `near_bits`, one word at least.
    pub near_bits: Vec<u32>,
    /// No splat of it can touch the tile.
    pub is_outside: bool,
    /// Depth of the farthest chunk that can.
    farthest: f64,
}

/// Splats that reach the near plane and are drawn alike, one at least.
#[derive(Clone, Debug)]
pub struct NearRecords {
    /// How they are drawn.
    pub variant: Variant,
    /// They are drawn in layers.
    pub is_transparent: bool,
    /// The shaders' `records`.
    pub records: Vec<u32>,
    /// The same for lighting each by itself; empty where nothing is lit so.
    pub lit: Vec<u32>,
    /// The shaders' `record_clips`; empty where nothing clips them.
    pub clips: Vec<u32>,
}

impl NearRecords {
    /// How many.
    pub fn count(&self) -> u32 {
        (self.records.len() / (layout::record::SIZE / 4)) as u32
    }
}

/// What a tile needs beside the resident scene.
#[derive(Clone, Debug)]
pub struct TileData {
    /// The pixels of the image that its targets hold: the tile and, where edges are antialiased, a border.
    pub targets: Region,
    /// Size of the tile itself, which is shaded.
    pub shaded: [u32; 2],
    /// The shaders' `frame`.
    pub frame: Vec<u32>,
    /// One for each segment of the scene.
    pub segments: Vec<SegmentData>,
    /// The splats that reach the near plane.
    pub near: Vec<NearRecords>,
    /// The shaders' `polygons` that may touch it, one at least; the first is no polygon where there are none.
    pub polygons: Vec<u32>,
    /// How many there are.
    pub polygon_count: u32,
    /// Where the tile's planes will be.
    pub planes: PlaneLayout,
}

impl TileData {
    /// Works out a tile of a frame.
    pub fn new(scene: &UploadedScene, frame: &FrameScene, view: &View, plan: &FramePlan, tile: Region) -> Self {
        let planes = PlaneLayout::new(plan.planes, tile.width * tile.height);
        let targets = targets_of(tile, view, plan);
        let job = NearJob { view, plan, tile: targets };
        let parts: Vec<(SegmentData, NearSplats)> =
            scene.segments.par_iter().map(|segment| segment_data(scene, frame, segment, &job)).collect();
        let mut polygons = match plan.has(Pass::Polygons) {
            true => polygon_words(&scene.meshes, view, targets, is_of_map(plan)),
            false => Vec::new(),
        };
        let polygon_count = (polygons.len() / (layout::polygon::SIZE / 4)) as u32;
        polygons.resize(polygons.len().max(layout::polygon::SIZE / 4), 0);
        let mut near: Vec<NearRecords> = Vec::new();
        let mut segments = Vec::with_capacity(parts.len());
        for (segment, own) in parts {
            let (variant, is_transparent) = (segment.variant, segment.is_transparent);
            segments.push(segment);
            if own.records.is_empty() {
                continue;
            }
            match near.iter_mut().find(|n| n.variant == variant && n.is_transparent == is_transparent) {
                Some(alike) => {
                    alike.records.extend(own.records);
                    alike.lit.extend(own.lit);
                    alike.clips.extend(own.clips);
                }
                None => near.push(NearRecords {
                    variant,
                    is_transparent,
                    records: own.records,
                    lit: own.lit,
                    clips: own.clips,
                }),
            }
        }
        let mut frame = frame_words(scene, frame, (view, plan), (tile, targets), &planes);
        let farthest = segments.iter().map(|segment| segment.farthest).fold(view.projection.near, f64::max);
        // Within what f32 holds, whatever the scene's scale.
        let unit = farthest.log2().round().clamp(-100.0, 100.0).exp2() as f32;
        for (offset, value) in [(layout::frame::DEPTH_UNIT, unit), (layout::frame::PER_DEPTH_UNIT, 1.0 / unit)] {
            if let Some(word) = frame.get_mut(offset / 4) {
                *word = value.to_bits();
            }
        }
        Self { targets, shaded: [tile.width, tile.height], frame, segments, near, polygons, polygon_count, planes }
    }

    /// Checks that its polygons fit the device.
    ///
    /// # Errors
    /// What is wrong and what to do, if they don't.
    pub fn check(&self, limits: Limits) -> Result<(), String> {
        let bytes = 4 * self.polygons.len() as u64;
        // Targets tell polygons by a float's whole numbers.
        if bytes <= limits.buffer_bytes && self.polygon_count < MOST_POLYGONS {
            return Ok(());
        }
        let (count, most) = (self.polygon_count, limits.buffer_bytes);
        Err(format!(
            "{count} polygons in view need {bytes} bytes, expected at most {most} and {MOST_POLYGONS} polygons; render by \
             --region, or have the mesh converted to splats"
        ))
    }

    /// Has the tile composed into a host's depth buffer, which holds `offset` + `scale`/z in a perspective projection, and
    /// `offset` + `scale`·z in an orthographic one.
    pub fn set_host_depth(&mut self, offset: f32, scale: f32) {
        let at = layout::frame::HOST_DEPTH / 4;
        for (word, value) in self.frame.iter_mut().skip(at).zip([offset, scale]) {
            *word = value.to_bits();
        }
    }

    /// What may touch the tile.
    pub fn visible(&self) -> Visible {
        let inside = self.segments.iter().enumerate().filter(|(_, segment)| !segment.is_outside);
        let (transparent, opaque): (Vec<_>, Vec<_>) = inside.partition(|(_, segment)| segment.is_transparent);
        let indices = |found: Vec<(usize, &SegmentData)>| found.into_iter().map(|(i, _)| i).collect();
        let near_transparent = self.near.iter().any(|near| near.is_transparent);
        Visible { opaque: indices(opaque), transparent: indices(transparent), near_transparent }
    }

    /// Number of near records.
    pub fn near_count(&self) -> u32 {
        self.near.iter().map(NearRecords::count).sum()
    }

    /// How its splats are drawn: whole ones always, so that every draw has a pipeline.
    pub fn variants(&self) -> Vec<Variant> {
        let seen = self.segments.iter().filter(|s| !s.is_outside).map(|s| s.variant);
        let clipped = seen.chain(self.near.iter().map(|n| n.variant)).any(|v| v == Variant::Clipped);
        if clipped { vec![Variant::Whole, Variant::Clipped] } else { vec![Variant::Whole] }
    }
}

fn segment_data(
    scene: &UploadedScene,
    frame: &FrameScene,
    segment: &Segment,
    job: &NearJob<'_>,
) -> (SegmentData, NearSplats) {
    use layout::chunk as at;
    let variant = if job.plan.clip == ClipPolicy::Off { Variant::Whole } else { segment.variant };
    let is_transparent = segment.is_transparent && job.plan.separates_transparent;
    let (chunks, near_bits) = (Vec::new(), Vec::new());
    let mut data = SegmentData { variant, is_transparent, chunks, near_bits, is_outside: true, farthest: 0.0 };
    let mut near = NearSplats::default();
    let index = segment.object as usize;
    let (Some(object), Some(placement)) = (scene.objects.get(index), frame.placements.get(index)) else {
        return (data, near);
    };
    data.chunks.reserve(segment.chunks.len() * at::SIZE / 4);
    for chunk in &segment.chunks {
        let center = placement.point(chunk.space.origin);
        let state = if is_outside(chunk, center, placement, job.tile, job.view, job.plan) {
            layout::CHUNK_OUTSIDE
        } else if may_reach_near(chunk, center, placement, job.view) {
            let members = segment.members.get(chunk.first as usize..(chunk.first + chunk.count) as usize);
            let members = (members.unwrap_or_default(), &chunk.space, scene.storage);
            let bits = job.chunk((object, segment.object), placement, members, (variant, is_transparent), &mut near);
            bits.map_or(layout::CHUNK_ORDINARY, |bits| {
                let start = data.near_bits.len() as u32;
                data.near_bits.extend(bits);
                start
            })
        } else {
            layout::CHUNK_ORDINARY
        };
        if state != layout::CHUNK_OUTSIDE {
            data.is_outside = false;
            data.farthest = data.farthest.max(center.z);
        }
        let mut words = Words::new(at::SIZE);
        words.vec3(at::CENTER, center).u32(at::STATE, state);
        data.chunks.extend(words.into_vec());
    }
    if data.near_bits.is_empty() {
        data.near_bits.push(0);
    }
    (data, near)
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
        // 9 floats, 36 bytes a pixel: at most 277 pixels a tile.
        let limits = |side, bytes| Limits::default().within(bytes, side);
        let tiles = tiles(&view, &plan, limits(64, 10_000));
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
        assert_eq!(super::tiles(&view, &plan, limits(8192, 1 << 27)).len(), 1);
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
            tiles(&view, &edges, Limits::default().within(1 << 27, 64))
                .iter()
                .all(|t| targets_of(*t, &view, &edges).width <= 64)
        );
    }
}
