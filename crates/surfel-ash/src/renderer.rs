//! Renderer that uploads scenes and draws frames.

use crate::cells::{CellBuffers, CellReadback, CellTile, record_tiles};
use crate::commands::submit;
use crate::device::Device;
use crate::error::Failure;
use crate::execute::{Tile, TileInputs};
use crate::instance::{Candidate, Instance};
use crate::memory::Buffer;
use crate::options::Options;
use crate::pipelines::Pipelines;
use crate::queries::Queries;
use crate::scene::{self, ResidentScene};
use crate::targets::Targets;
use crate::{CAPABILITIES, NAME};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;
use std::time::Instant;
use surfel_gpu::{
    CellBuffer, CellCapacity, CellTiles, Draw, EDGE_SAMPLES, FILL_RATE_RUNS, FillRate, FillRateFrame, FrameScene,
    FrameTiles, GpuPath, LAYER_HEADER_BYTES, Limits, PixelPass, Precision, SHADOW_MAPS, SamplePart, ShadowMapCache,
    ShadowMapJob, Step, TargetKey, TileData, Variant, cell_entries, count_frame_bytes, count_layers, layers_remain,
    min_surface_count, schedule, shadow_map_jobs, shadow_texels, with_more_layers,
};
use surfel_model::Storage;
use surfel_model::{Scene, Settings};
use surfel_render::{Frame, FramePlan, Pass, Planes, RenderError, RendererInfo, Stats, UploadProgress, View, plan};

/// Existing Vulkan device of a program.
pub struct RawDevice {
    /// Vulkan loader. A program that continues to use its device must keep a clone, because dropping the last clone
    /// unloads Vulkan.
    pub entry: ash::Entry,
    /// Instance created for Vulkan 1.1 or later.
    pub instance: ash::Instance,
    /// Physical device.
    pub physical: vk::PhysicalDevice,
    /// Logical device.
    pub device: ash::Device,
    /// Queue of the device that supports graphics and compute.
    pub queue: vk::Queue,
    /// Index of the queue's family.
    pub family: u32,
}

/// Renderer of the Vulkan backend.
pub struct Renderer {
    // Fields are declared in the order of their destruction, although each has a reference to the device.
    /// Images and buffers of the last tile, which the next tile reuses if they fit.
    targets: Option<Targets>,
    /// Images and buffers into which the last frame's shadow maps were drawn.
    map_targets: Option<Targets>,
    /// Shadow maps of the last frame, which the next frame reuses if nothing changed.
    maps: Option<ShadowMapCache<Arc<Buffer>>>,
    /// Buffers of the compute path.
    cells: CellBuffers,
    pipelines: Pipelines,
    device: Arc<Device>,
    info: RendererInfo,
    /// True if the adapter computes on the CPU.
    is_software: bool,
    /// Limits on the use of the device: each is the smaller of the device's and the one in the options.
    limits: Limits,
    /// Storage format of splats in the device's memory.
    storage: Storage,
    /// Way in which frames are drawn: by compute shaders or by raster hardware.
    path: GpuPath,
}

impl Renderer {
    surfel_render::renderer_methods!(ResidentScene);

    /// Opens a renderer on the adapter that the options name, or on the fastest kind available.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if there is no Vulkan loader, or no adapter exists or matches the name. The error is
    /// also returned if the device can't be opened, or validation is requested but not installed.
    pub fn new(options: Options) -> Result<Self, RenderError> {
        let instance = Arc::new(Instance::new(options.validation)?);
        let candidates = instance.candidates()?;
        let wanted = options.adapter.as_ref().map(|name| name.to_lowercase());
        let fits = |c: &&Candidate| wanted.as_ref().is_none_or(|wanted| c.name.to_lowercase().contains(wanted));
        let Some(candidate) = candidates.iter().find(fits) else {
            let names: Vec<&str> = candidates.iter().map(|c| c.name.as_str()).collect();
            return Err(Failure::Other(match &options.adapter {
                Some(wanted) if !names.is_empty() => {
                    format!("no adapter is called '{wanted}'; found: {}", names.join(", "))
                }
                _ => "no adapter with Vulkan 1.1 was found; install a graphics driver".to_owned(),
            })
            .into());
        };
        let device = Device::new(instance, candidate)?;
        Self::start(device, candidate, &options)
    }

    /// Creates a renderer with default options on a program's existing device. The renderer uses none of the device's
    /// optional features, so queries count neither fragments nor shader invocations.
    ///
    /// # Safety
    /// The handles must be valid, belong together, and stay valid as long as the renderer exists. No other thread may
    /// submit to the queue while the renderer is borrowed. The instance must be created for Vulkan 1.1 or later.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if the device has Vulkan 1.0 or refuses the shaders.
    pub unsafe fn from_raw(raw: RawDevice) -> Result<Self, RenderError> {
        let RawDevice { entry, instance, physical, device, queue, family } = raw;
        let instance = Arc::new(Instance::borrowed(entry, instance));
        // SAFETY: the physical device is the instance's, as the caller promises.
        let families = unsafe { instance.raw.get_physical_device_queue_family_properties(physical) };
        let timestamp_bits = families.get(family as usize).map_or(0, |family| family.timestamp_valid_bits);
        let candidate = Candidate::with_family(&instance.raw, physical, family, timestamp_bits);
        let candidate = candidate.ok_or_else(|| Failure::other("the device is of Vulkan 1.0, expected 1.1"))?;
        let device = Device::borrowed(instance, &candidate, device, queue)?;
        Self::start(device, &candidate, &Options::default())
    }

    /// Creates a renderer on an open device.
    fn start(device: Arc<Device>, candidate: &Candidate, options: &Options) -> Result<Self, RenderError> {
        let pipelines = Pipelines::new(&device)?;
        let mut driver = candidate.driver.clone();
        if !device.caps.blends_f32 {
            driver += "; sums in f16, for it can't blend f32";
        }
        let info = RendererInfo {
            backend: NAME,
            adapter: candidate.name.clone(),
            driver,
            threads: 0,
            capabilities: CAPABILITIES,
        };
        let is_software = candidate.is_software();
        let limits = options.limits.within(device.caps.buffer_bytes(), device.caps.texture_side());
        let limits = limits.within_memory(device.caps.memory_bytes);
        let renderer = Self {
            targets: None,
            map_targets: None,
            maps: None,
            cells: CellBuffers::default(),
            pipelines,
            device,
            info,
            is_software,
            limits,
            storage: options.storage,
            path: options.path,
        };
        renderer.check_messages()?;
        Ok(renderer)
    }

    /// True if the adapter computes on the CPU; the `cpu` backend is then faster.
    pub fn is_software(&self) -> bool {
        self.is_software
    }

    /// Returns an error if the validation layer has reported messages.
    fn check_messages(&self) -> Result<(), RenderError> {
        let messages = self.device.instance.take_messages();
        if messages.is_empty() {
            return Ok(());
        }
        Err(Failure::Other(format!("the validation layer says: {}", messages.join("\n"))).into())
    }

    /// Creates those pipelines and targets of a tile that don't exist from an earlier frame. Fails if the tile's
    /// polygons or balls exceed the limits.
    fn prepare(&mut self, plan: &FramePlan, data: &TileData, work: &TileWork) -> Result<(), Failure> {
        work.all(data).try_for_each(|data| data.check(self.limits)).map_err(Failure::Other)?;
        let precision = Precision::of(plan, self.device.caps.blends_f32);
        let draws = work.draws.clone();
        for &pass in &work.pixel_passes {
            self.pipelines.prepare_pixels(pass)?;
        }
        for variant in work.all(data).flat_map(TileData::variants) {
            self.pipelines.prepare_splats(variant)?;
            for &draw in draws.iter().filter(|draw| draw.draws_records() || variant == Variant::Whole) {
                self.pipelines.prepare(draw, variant, precision)?;
            }
        }
        let size = data.target_size(plan);
        self.prepare_targets(TargetKey { size, precision, draws, floats: data.planes.buffer_floats })
    }

    /// Creates the targets, unless the last frame's targets fit.
    fn prepare_targets(&mut self, key: TargetKey) -> Result<(), Failure> {
        // The old targets are freed first, because memory may not suffice for both.
        let fitting = self.targets.take().filter(|targets| targets.key == key);
        self.targets = Some(fitting.map_or_else(|| Targets::new(&self.device, &self.pipelines, key), Ok)?);
        Ok(())
    }

    /// Creates a buffer for the texels of shadow maps.
    fn shadow_buffer(&self, texels: u64) -> Result<Buffer, Failure> {
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        Buffer::new(&self.device, "shadow texels", 4 * texels, storage, MemoryLocation::GpuOnly)
    }

    /// Returns the texels of a plan's shadow maps, drawn now or cached from the last frame if nothing changed. Times of
    /// drawing are added to the statistics.
    fn shadow_maps(
        &mut self,
        scene: &ResidentScene,
        plan: &FramePlan,
        stats: &mut Stats,
    ) -> Result<Arc<Buffer>, Failure> {
        let jobs = shadow_map_jobs(&scene.cpu, plan);
        if let Some(cache) = self.maps.as_ref().filter(|cache| cache.fits(&scene.cpu, &jobs)) {
            return Ok(cache.texels.clone());
        }
        // The old maps are freed first, because memory may not suffice for both.
        self.maps = None;
        let texels = Arc::new(self.shadow_buffer(shadow_texels(plan, self.limits).map_err(Failure::Other)?)?);
        std::mem::swap(&mut self.targets, &mut self.map_targets);
        let drawn = jobs.iter().try_for_each(|job| self.shadow_map(scene, job, &texels, stats));
        std::mem::swap(&mut self.targets, &mut self.map_targets);
        drawn?;
        self.maps = Some(ShadowMapCache::new(texels.clone(), &scene.cpu, &jobs));
        Ok(texels)
    }

    /// Draws one shadow map into the buffer `texels`, and adds its times to the statistics.
    fn shadow_map(
        &mut self,
        scene: &ResidentScene,
        job: &ShadowMapJob,
        texels: &Buffer,
        stats: &mut Stats,
    ) -> Result<(), Failure> {
        for data in job.tiles(&scene.cpu, self.limits) {
            let work = TileWork::of(&job.plan, &data, scene, Vec::new());
            self.prepare(&job.plan, &data, &work)?;
            let targets = self.targets.as_ref().ok_or_else(|| Failure::other("the targets were not made"))?;
            let queries = Queries::new(&self.device, Some(SHADOW_MAPS), work.steps.len())?;
            let none = self.shadow_buffer(1)?;
            let tile = Tile::new(
                &self.device,
                &TileInputs {
                    scene,
                    pipelines: &self.pipelines,
                    targets,
                    queries: &queries,
                    frame: &job.frame,
                    data: &data,
                    pixel_passes: &work.pixel_passes,
                    shadow_texels: &none,
                    drawn_shadow_texels: texels,
                },
            )?;
            submit(&self.device, |commands| tile.record(commands, &work.steps, &[]))?;
            queries.add(stats)?;
        }
        Ok(())
    }

    /// Draws one tile into the frame, by the compute path if the tile's data are for it and fit, otherwise by raster
    /// hardware.
    fn tile(
        &mut self,
        job: &FrameJob<'_>,
        data: TileData,
        frame: &mut Frame,
        stats: &mut Stats,
    ) -> Result<(), Failure> {
        if data.cells.is_none() {
            return self.raster_tile(job, &data, frame, stats);
        }
        let tile = data.tile;
        let tiles = CellTiles::new(data, &job.scene.cpu, job.frame_scene, job.view, job.plan);
        if !self.cell_tiles(job, tiles, frame, stats)? {
            let data = TileData::new(&job.scene.cpu, job.frame_scene, job.view, job.plan, tile);
            self.raster_tile(job, &data, frame, stats)?;
        }
        Ok(())
    }

    /// Draws one tile by the compute path. Returns false and draws nothing if the tile doesn't fit the device.
    fn cell_tiles(
        &mut self,
        job: &FrameJob<'_>,
        mut tiles: CellTiles,
        frame: &mut Frame,
        stats: &mut Stats,
    ) -> Result<bool, Failure> {
        let mut plan = job.plan.clone();
        let mut room = tiles.room(self.cells.room, self.limits);
        while let Some(tried) = room {
            tiles.put_room(tried);
            match self.cells.prepare(&self.device, &tiles, tried) {
                // Memory may still suffice for raster hardware.
                Err(Failure::OutOfMemory) => {
                    self.cells = CellBuffers::default();
                    return Ok(false);
                }
                prepared => prepared?,
            }
            for entry in cell_entries(job.plan) {
                self.pipelines.prepare_cells(entry)?;
            }
            let pixels = tiles.pixels().ok_or_else(|| Failure::other("a tile has no pixels"))?;
            self.prepare_targets(TargetKey {
                size: pixels.target_size(job.plan),
                precision: Precision::F32,
                draws: Vec::new(),
                floats: tiles.floats(tried),
            })?;
            let targets = self.targets.as_ref().ok_or_else(|| Failure::other("the targets were not made"))?;
            let counters = self.draw_cells(job, &plan, &tiles, tried, targets, stats)?;
            if !tried.holds(&counters) {
                room = tiles.grown(tried, &counters, self.limits);
                continue;
            }
            if CellCapacity::lacks_layers(&plan, &counters) {
                let region = pixels.tile;
                let least = || min_surface_count(&job.scene.cpu, job.frame_scene, job.view, job.plan, region);
                plan = with_more_layers(&plan, least).map_err(Failure::Other)?;
                continue;
            }
            CellCapacity::count(&counters, stats);
            let planes = targets.readback.words(pixels.planes.floats as usize)?;
            let identity = |group, n| pixels.cell_identity(&job.scene.cpu, group, n);
            stats.fragments +=
                pixels.planes.store(bytemuck::cast_slice(planes), pixels.tile, job.view.region, frame, identity);
            count_frame_bytes(targets.key.bytes() + self.cells.bytes(), job.shadow_texels.bytes, stats);
            return Ok(true);
        }
        Ok(false)
    }

    /// Executes the dispatches that draw a tile and its samples by `plan`, and returns the words of
    /// [`CellBuffer::Counters`]. Times are added to the statistics if the tile isn't drawn again.
    fn draw_cells(
        &self,
        job: &FrameJob<'_>,
        plan: &FramePlan,
        tiles: &CellTiles,
        room: CellCapacity,
        targets: &Targets,
        stats: &mut Stats,
    ) -> Result<Vec<u32>, Failure> {
        let stages = tiles.stages(plan, room);
        let queries = Queries::new(&self.device, None, stages.iter().map(Vec::len).sum())?;
        let none = self.shadow_buffer(1)?;
        let tile = |data, stages| {
            let inputs = TileInputs {
                scene: job.scene,
                pipelines: &self.pipelines,
                targets,
                queries: &queries,
                frame: job.frame_scene,
                data,
                pixel_passes: &[],
                shadow_texels: job.shadow_texels,
                drawn_shadow_texels: &none,
            };
            CellTile::new(&self.device, &inputs, &self.cells, stages)
        };
        let drawn = tiles.tiles().iter().zip(&stages).map(|(data, stages)| tile(data, stages));
        let drawn: Vec<CellTile<'_>> = drawn.collect::<Result<_, _>>()?;
        let counter_bytes = tiles.bytes(CellBuffer::Counters, room);
        let to_host = vk::BufferUsageFlags::TRANSFER_DST;
        let read_counters =
            Buffer::new(&self.device, "counters to read", counter_bytes, to_host, MemoryLocation::GpuToCpu)?;
        let readback = CellReadback {
            targets,
            plane_bytes: 4 * tiles.pixels().map_or(1, |pixels| u64::from(pixels.planes.floats.max(1))),
            counters: self.cells.get(CellBuffer::Counters)?,
            read_counters: &read_counters,
        };
        submit(&self.device, |commands| record_tiles(commands, &drawn, &queries, &readback))?;
        let counters = read_counters.words((counter_bytes / 4) as usize)?.to_vec();
        if room.holds(&counters) && !CellCapacity::lacks_layers(plan, &counters) {
            queries.add(stats)?;
        }
        Ok(counters)
    }

    /// Draws one tile into the frame by raster hardware.
    fn raster_tile(
        &mut self,
        job: &FrameJob<'_>,
        data: &TileData,
        frame: &mut Frame,
        stats: &mut Stats,
    ) -> Result<(), Failure> {
        let FrameJob { view, .. } = *job;
        let (region, shared_records) = (data.tile, job.scene.shared_records);
        let (mut plan, before) = (job.plan.clone(), [stats.drawn, stats.fragments]);
        let counted = loop {
            let tile = (region, data);
            let samples = SamplePart::all(&job.scene.cpu, job.frame_scene, view, &plan, tile, shared_records);
            let work = TileWork::of(&plan, data, job.scene, samples);
            let (counted, is_whole) = self.execute(job, data, &work, stats, |planes| {
                let identity = |draw, record| data.identity(&job.scene.cpu, draw, record);
                data.planes.store(bytemuck::cast_slice(planes), region, view.region, frame, identity)
            })?;
            if is_whole || !plan.has(Pass::ABuffer) {
                break counted;
            }
            // The tile's splats were counted already, and are drawn again.
            [stats.drawn, stats.fragments] = before;
            let least = || min_surface_count(&job.scene.cpu, job.frame_scene, view, job.plan, region);
            plan = with_more_layers(&plan, least).map_err(Failure::Other)?;
        };
        // Without queries, the fragments are the sum over the plane of fragments. This also holds for Gaussians:
        // queries don't count the work of the compute shader that draws them.
        if !self.device.caps.counts_samples || job.plan.has(Pass::Gaussians) {
            stats.fragments += counted;
        }
        let target_bytes = self.targets.as_ref().map_or(0, |targets| targets.key.bytes());
        count_frame_bytes(target_bytes, job.shadow_texels.bytes, stats);
        Ok(())
    }

    /// Executes `work`, waits for it, and returns what `read` makes of the words of the planes. The returned flag is
    /// false if more transparent layers may lie behind those that were drawn.
    fn execute<T>(
        &mut self,
        job: &FrameJob<'_>,
        data: &TileData,
        work: &TileWork,
        stats: &mut Stats,
        read: impl FnOnce(&[u32]) -> T,
    ) -> Result<(T, bool), Failure> {
        self.prepare(job.plan, data, work)?;
        let targets = self.targets.as_ref().ok_or_else(|| Failure::other("the targets were not made"))?;
        let queries = Queries::new(&self.device, None, work.steps.len())?;
        let none = self.shadow_buffer(1)?;
        let inputs = TileInputs {
            scene: job.scene,
            pipelines: &self.pipelines,
            targets,
            queries: &queries,
            frame: job.frame_scene,
            data,
            pixel_passes: &work.pixel_passes,
            shadow_texels: job.shadow_texels,
            drawn_shadow_texels: &none,
        };
        let tile = Tile::new(&self.device, &inputs)?;
        let sample_steps = work.samples.iter().map(|part| part.steps.len()).sum();
        let sample_queries = Queries::new(&self.device, Some(EDGE_SAMPLES), sample_steps)?;
        let mut parts = Vec::with_capacity(work.samples.len());
        for SamplePart { data, steps } in &work.samples {
            let tile = Tile::new(&self.device, &TileInputs { data, queries: &sample_queries, ..inputs })?;
            parts.push((tile, steps.as_slice()));
        }
        submit(&self.device, |commands| tile.record(commands, &work.steps, &parts))?;
        if let Some(lists) = &data.gaussians {
            let mut dispatches = 1;
            while let Some(more) = lists.more_dispatches(dispatches, targets.readback.words(1)?) {
                submit(&self.device, |commands| tile.dispatch_again(commands, &work.steps, more))?;
                dispatches += more;
            }
        }
        let drawn = tile.drawn_readback.words(1)?.first().copied().unwrap_or(0);
        stats.drawn += u64::from(drawn) + u64::from(data.host_records());
        if let Some(layers) = &tile.layers_readback {
            count_layers(layers.words((LAYER_HEADER_BYTES / 4) as usize)?, stats);
        }
        queries.add(stats)?;
        if !parts.is_empty() {
            sample_queries.add(stats)?;
        }
        let mut is_whole = true;
        for layers in std::iter::once(&tile).chain(parts.iter().map(|part| &part.0)).flat_map(|t| &t.layers_readback) {
            is_whole &= !layers_remain(layers.words((LAYER_HEADER_BYTES / 4) as usize)?);
        }
        Ok((read(targets.readback.words(data.planes.floats as usize)?), is_whole))
    }

    /// Measures the device's fill rates in square targets of side `side_px` in pixels, or of the largest texture's side
    /// if that is smaller. Fill rates are upper bounds of the speed of passes. Returns an empty list if the device has
    /// no timestamps.
    ///
    /// # Errors
    /// [`RenderError::Model`] if an image can't have this size; [`RenderError::Backend`] if the device fails.
    pub fn fill_rates(&mut self, side_px: u32) -> Result<Vec<FillRate>, RenderError> {
        let frame = FillRateFrame::new(side_px.min(self.limits.texture_side))?;
        let scene = surfel_render::Renderer::upload(self, &Scene::default())?;
        let texels = self.shadow_maps(&scene, &frame.plan, &mut Stats::default())?;
        let frame_scene = FrameScene::new(&scene.cpu, &frame.view, &frame.plan);
        let data = TileData::new(&scene.cpu, &frame_scene, &frame.view, &frame.plan, frame.view.region);
        let (draws, steps) = (frame.draws.clone(), frame.steps.clone());
        let work = TileWork { draws, pixel_passes: Vec::new(), steps, samples: Vec::new() };
        let job = FrameJob {
            scene: &scene,
            shadow_texels: &texels,
            frame_scene: &frame_scene,
            view: &frame.view,
            plan: &frame.plan,
        };
        let mut runs = Vec::new();
        // The first run warms up. It needs no special case, because the best run is used.
        for _ in 0..FILL_RATE_RUNS {
            let mut stats = Stats::default();
            self.execute(&job, &data, &work, &mut stats, |_| ())?;
            runs.push(stats);
        }
        self.check_messages()?;
        Ok(frame.rates(&runs))
    }
}

/// Inputs that all tiles of a frame share.
struct FrameJob<'a> {
    scene: &'a ResidentScene,
    /// Texels of the frame's shadow maps.
    shadow_texels: &'a Buffer,
    frame_scene: &'a FrameScene,
    view: &'a View,
    plan: &'a FramePlan,
}

/// Steps that raster hardware executes for a tile, with their data.
struct TileWork {
    /// Render passes among the steps, and among the steps of samples.
    draws: Vec<Draw>,
    /// Pixel passes among the steps, and among the steps of samples.
    pixel_passes: Vec<PixelPass>,
    steps: Vec<Step>,
    /// Samples of the tile's edge pixels, in parts that each fit the tile's targets; empty unless edges are antialiased
    /// by samples.
    samples: Vec<SamplePart>,
}

impl TileWork {
    /// Returns the work that draws a tile of a plan, with these samples.
    fn of(plan: &FramePlan, data: &TileData, scene: &ResidentScene, samples: Vec<SamplePart>) -> Self {
        let steps = schedule(plan, &data.visible(), scene.shared_records);
        Self { draws: Draw::of(plan), pixel_passes: PixelPass::of(plan), steps, samples }
    }

    /// Returns the data of the tile and of its samples.
    fn all<'a>(&'a self, data: &'a TileData) -> impl Iterator<Item = &'a TileData> {
        std::iter::once(data).chain(self.samples.iter().map(|part| &part.data))
    }
}

impl surfel_render::Renderer for Renderer {
    type Scene = ResidentScene;

    fn info(&self) -> &RendererInfo {
        &self.info
    }

    fn upload(&mut self, scene: &Scene) -> Result<ResidentScene, RenderError> {
        self.upload_reporting(scene, &mut |_| {})
    }

    fn upload_reporting(
        &mut self,
        scene: &Scene,
        progress: &mut dyn FnMut(UploadProgress),
    ) -> Result<ResidentScene, RenderError> {
        let resident = scene::upload(&self.device, (scene, self.storage), self.limits, progress)?;
        self.check_messages()?;
        Ok(resident)
    }

    fn update(&mut self, resident: &mut ResidentScene, scene: &Scene) -> Result<bool, RenderError> {
        resident.cpu.update(scene)
    }

    fn render_into(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let start = Instant::now();
        let plan = plan(&scene.cpu.summary, view, settings, planes, &self.info.capabilities)?;
        let mut stats = Stats::default().with_splats(plan.splats);
        // Tiles write every pixel. Colours requested only in 8 bits are encoded from the device's f32 colours.
        frame.resize(view.region.width, view.region.height, plan.planes.with_color(planes.color));
        let frame_scene = FrameScene::new(&scene.cpu, view, &plan);
        let texels = self.shadow_maps(scene, &plan, &mut stats)?;
        let job = FrameJob { scene, shadow_texels: &texels, frame_scene: &frame_scene, view, plan: &plan };
        for data in FrameTiles::new(&scene.cpu, &frame_scene, view, &plan, self.limits, self.path) {
            self.tile(&job, data.map_err(Failure::Other)?, frame, &mut stats)?;
        }
        self.check_messages()?;
        frame.locate(view);
        stats.bytes_per_splat = scene.bytes() as f64 / scene.cpu.summary.splats.max(1) as f64;
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(stats)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Camera, CloudData, Column3, OnInvalid, Projection, Shape, SplatCloud};
    use surfel_render::Renderer as _;

    #[test]
    fn nothing_outlives_its_device() {
        let options = Options::default().with_validation(true);
        let mut renderer = match Renderer::new(options) {
            Ok(renderer) => renderer,
            Err(error) => {
                let required = std::env::var("SURFEL_REQUIRE").unwrap_or_default();
                assert!(!required.split(',').any(|word| word.trim() == "validation"), "{error}");
                println!("skipped: {error}");
                return;
            }
        };
        let z = Column3::from_f64(&[[0.0, 0.0, 1.0].into()]);
        let shape = Shape::Disks { normals: z.clone(), radii: vec![0.5] };
        let cloud = SplatCloud::new(CloudData::new([0.0; 3].into(), z, shape), OnInvalid::Refuse).unwrap().0;
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        let resident = renderer.upload(&Scene::from(cloud)).unwrap();
        let mut frame = Frame::default();
        renderer.render_into(&resident, &view, &Settings::default(), Planes::COLOR, &mut frame).unwrap();
        assert!(frame.color()[36][0] > 0.0);
        // The validation layer reports objects that still exist when the device is destroyed. The scene may outlive the
        // renderer.
        let instance = renderer.device.instance.clone();
        drop(renderer);
        drop(resident);
        assert_eq!(instance.take_messages(), [""; 0]);
        assert_eq!(Arc::strong_count(&instance), 1);
    }
}
