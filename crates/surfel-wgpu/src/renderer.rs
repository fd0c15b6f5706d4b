//! Renderer that uploads scenes and draws frames.

use crate::adapter::{self, OpenDevice, blends_f32, renderer_info};
use crate::cells::{CellBuffers, CellTile};
use crate::error::{ErrorSink, ScopedError, failed, scoped};
use crate::execute::{Tile, TileInputs};
use crate::options::Options;
use crate::pipelines::{Pipelines, storage_buffers};
use crate::queries::{PassRecord, Queries};
use crate::queue::Queue;
use crate::readback::Readback;
use crate::scene::{self, ResidentScene, empty};
use crate::targets::Targets;
use std::time::Instant;
use surfel_gpu::{
    CellBuffer, CellCapacity, CellTiles, Draw, EDGE_SAMPLES, FILL_RATE_RUNS, FillRate, FillRateFrame, FrameScene,
    FrameTiles, GpuPath, HostWork, LAYER_HEADER_BYTES, Limits, PixelPass, Precision, SHADOW_MAPS, SamplePart,
    ShadowMapCache, ShadowMapJob, Step, TargetKey, TileData, Variant, cell_entries, count_frame_bytes, count_layers,
    layers_remain, min_surface_count, schedule, shadow_map_jobs, shadow_texels, with_more_layers,
};
use surfel_model::Storage;
use surfel_model::{Scene, Settings};
use surfel_render::{Frame, FramePlan, Pass, Planes, RenderError, RendererInfo, Stats, UploadProgress, View, plan};

/// Renderer of the wgpu backend.
pub struct Renderer {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: Queue,
    pub(crate) info: RendererInfo,
    /// True if the adapter computes on the CPU.
    is_software: bool,
    /// True if the adapter can blend targets of f32.
    f32_sums: bool,
    pub(crate) errors: ErrorSink,
    pub(crate) pipelines: Pipelines,
    /// Textures and buffers of the last tile, which the next tile reuses if they fit.
    pub(crate) targets: Option<Targets>,
    /// Textures and buffers into which the last frame's shadow maps were drawn.
    pub(crate) map_targets: Option<Targets>,
    queries: Queries,
    /// Buffers of the compute path.
    cells: CellBuffers,
    /// Counters of the CPU work that grows with the number of splats (chunks tested, splats visited), summed over all
    /// frames so far.
    pub(crate) host_work: HostWork,
    /// Buffer through which the last frame was read back, to be reused.
    readback: Option<wgpu::Buffer>,
    /// Shadow maps of the last frame, which the next frame reuses if nothing changed.
    maps: Option<ShadowMapCache<wgpu::Buffer>>,
    /// Limits on the use of the device: each is the smaller of the device's and the one in the options.
    pub(crate) limits: Limits,
    /// Storage format of splats in the device's memory.
    storage: Storage,
    /// Way in which frames are drawn: by compute shaders or by raster hardware.
    pub(crate) path: GpuPath,
    /// True if wgpu translates shaders from WGSL even where the driver takes SPIR-V.
    pub(crate) wgsl: bool,
    /// True if the embedding application's shader function replaces the shader `phong`.
    pub(crate) has_host_shader: bool,
}

impl Renderer {
    surfel_render::renderer_methods!(ResidentScene);

    /// Opens a renderer on the adapter that the options name, or on the fastest kind available.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if no adapter exists or matches the name, or if its device can't be opened.
    pub fn new(options: Options) -> Result<Self, RenderError> {
        let OpenDevice { device, queue, info } = adapter::open(&options)?;
        Self::start(device, queue, &info, &options)
    }

    /// Creates a renderer with default options on a program's existing device.
    ///
    /// # Errors
    /// The errors of [`Renderer::from_device_with`].
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue) -> Result<Self, RenderError> {
        Self::from_device_with(device, queue, &Options::default())
    }

    /// Creates a renderer on a program's existing device. The options `adapter` and `validation` have no effect.
    ///
    /// Optional features of the device enable f32 sums (`Features::FLOAT32_BLENDABLE`), times of passes
    /// (`Features::TIMESTAMP_QUERY`), counts of shader invocations (`Features::PIPELINE_STATISTICS_QUERY`) and, on
    /// Vulkan, shaders that start sooner (`Features::PASSTHROUGH_SHADERS`). The renderer replaces the device's handlers
    /// of uncaptured errors and of device loss.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if the device refuses the shaders.
    pub fn from_device_with(device: wgpu::Device, queue: wgpu::Queue, options: &Options) -> Result<Self, RenderError> {
        let info = device.adapter_info();
        Self::start(device, queue, &info, options)
    }

    /// Creates a renderer on an open device.
    fn start(
        device: wgpu::Device,
        queue: wgpu::Queue,
        info: &wgpu::AdapterInfo,
        options: &Options,
    ) -> Result<Self, RenderError> {
        let errors = ErrorSink::of(&device);
        let f32_sums = blends_f32(&device);
        let (pipelines, queries) =
            scoped(&device, || (Pipelines::new(&device, options.wgsl), Queries::new(&device, &queue)))?;
        let own = device.limits();
        let buffer_bytes = own.max_storage_buffer_binding_size.min(own.max_buffer_size);
        let limits = options.limits.within(buffer_bytes, own.max_texture_dimension_2d);
        let is_software = info.device_type == wgpu::DeviceType::Cpu;
        let info = renderer_info(info, f32_sums);
        Ok(Self {
            device,
            queue: Queue::new(queue),
            info,
            is_software,
            f32_sums,
            errors,
            pipelines,
            targets: None,
            map_targets: None,
            queries,
            cells: CellBuffers::default(),
            host_work: HostWork::default(),
            readback: None,
            maps: None,
            limits,
            storage: options.storage,
            path: options.path,
            wgsl: options.wgsl,
            has_host_shader: false,
        })
    }

    /// True if the adapter computes on the CPU; the `cpu` backend is then faster.
    pub fn is_software(&self) -> bool {
        self.is_software
    }

    /// Returns the renderer's device.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// Returns the CPU work that grows with the number of splats (chunks tested, splats visited), summed over all
    /// frames so far. The difference of two calls is the work of the frames between them. Splats that the application
    /// places by [`Renderer::place_splats`] cause no such work.
    pub fn host_work(&self) -> HostWork {
        self.host_work
    }

    /// Returns the number of bytes that the renderer has written to the device's queue so far.
    pub fn written_bytes(&self) -> u64 {
        self.queue.written()
    }

    /// Returns the key of the textures and buffers that raster hardware needs for a tile.
    pub(crate) fn key(&self, plan: &FramePlan, data: &TileData) -> TargetKey {
        TargetKey {
            size: data.target_size(plan),
            precision: Precision::of(plan, self.f32_sums),
            draws: Draw::of(plan),
            floats: data.planes.buffer_floats,
        }
    }

    /// Checks that the device can bind the storage buffers of a plan's passes. The passes of balls bind more than
    /// WebGPU's core limits allow.
    pub(crate) fn check_bindings(&self, plan: &FramePlan) -> Result<(), RenderError> {
        let (needed, most) =
            (storage_buffers(&PixelPass::of(plan)), self.device.limits().max_storage_buffers_per_shader_stage);
        if needed <= most {
            return Ok(());
        }
        Err(failed(format!(
            "the frame binds {needed} storage buffers in a shader stage, but the device was opened with at most \
             {most}: raise `max_storage_buffers_per_shader_stage`"
        )))
    }

    /// Creates the pipelines and targets that don't exist from an earlier frame: those of the key's draws for these
    /// clip variants, and of the pixel passes.
    pub(crate) fn prepare(&mut self, key: TargetKey, variants: &[Variant], pixels: &[PixelPass]) {
        for &pixels in pixels {
            self.pipelines.prepare_pixels(&self.device, pixels);
        }
        for &variant in variants {
            self.pipelines.prepare_splats(&self.device, variant);
            for &draw in key.draws.iter().filter(|draw| draw.draws_records() || variant == Variant::Whole) {
                self.pipelines.prepare(&self.device, draw, variant, key.precision);
            }
        }
        self.prepare_targets(key);
    }

    /// Creates the targets, unless the last frame's targets fit.
    fn prepare_targets(&mut self, key: TargetKey) {
        if self.targets.as_ref().is_none_or(|targets| targets.key != key) {
            // The old targets are freed first, because memory may not suffice for both.
            self.targets = None;
            self.targets = Some(Targets::new(&self.device, &self.pipelines, key));
        }
    }

    /// Returns the texels of a plan's shadow maps, drawn now or cached from the last frame if nothing changed, and the
    /// costs of drawing the maps. The costs can be read once the device has drawn the maps; there are none for cached
    /// maps.
    pub(crate) fn shadow_maps(
        &mut self,
        scene: &ResidentScene,
        plan: &FramePlan,
    ) -> Result<(wgpu::Buffer, Vec<MapCost>), RenderError> {
        let jobs = shadow_map_jobs(&scene.cpu, plan);
        if let Some(cache) = self.maps.as_ref().filter(|cache| cache.fits(&scene.cpu, &jobs)) {
            return Ok((cache.texels.clone(), Vec::new()));
        }
        // The old maps are freed first, because memory may not suffice for both.
        self.maps = None;
        let texels = shadow_texels(plan, self.limits).map_err(failed)?;
        let device = self.device.clone();
        let buffer = scoped(&device, || empty(&device, "shadow texels", 4 * texels, wgpu::BufferUsages::STORAGE))?;
        let mut costs = Vec::new();
        std::mem::swap(&mut self.targets, &mut self.map_targets);
        let drawn = jobs.iter().try_for_each(|job| self.shadow_map(scene, job, &buffer, &mut costs));
        std::mem::swap(&mut self.targets, &mut self.map_targets);
        drawn?;
        self.maps = Some(ShadowMapCache::new(buffer.clone(), &scene.cpu, &jobs));
        Ok((buffer, costs))
    }

    /// Draws one shadow map into the buffer `texels`, and appends the costs of its tiles.
    fn shadow_map(
        &mut self,
        scene: &ResidentScene,
        job: &ShadowMapJob,
        texels: &wgpu::Buffer,
        costs: &mut Vec<MapCost>,
    ) -> Result<(), RenderError> {
        let device = self.device.clone();
        let pixels = PixelPass::of(&job.plan);
        for data in job.tiles(&scene.cpu, self.limits) {
            self.host_work += data.host_work();
            data.check(self.limits).map_err(failed)?;
            let key = self.key(&job.plan, &data);
            scoped(&device, || {
                self.prepare(key, &data.variants(), &pixels);
                let Some(targets) = &self.targets else { return };
                let none = empty(&device, "no shadows", 4, wgpu::BufferUsages::STORAGE);
                let inputs = TileInputs {
                    scene,
                    pipelines: &self.pipelines,
                    targets,
                    frame: &job.frame,
                    data: &data,
                    pixel_passes: &pixels,
                    shadow_texels: &none,
                    drawn_shadow_texels: texels,
                    host_depth: None,
                };
                let tile = Tile::new(&device, &self.queue, &inputs);
                let mut encoder =
                    device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("shadow map") });
                self.queries.restart(Some(SHADOW_MAPS));
                for step in schedule(&job.plan, &data.visible(), scene.shared_records) {
                    tile.step(&mut encoder, &step, Some(&mut self.queries));
                }
                if let Some((buffer, bytes)) = self.queries.resolve(&device, &mut encoder) {
                    let readback = Readback::record(&device, &mut encoder, &[(&buffer, bytes)]);
                    costs.push(MapCost { readback, pass_record: self.queries.pass_record() });
                }
                self.queue.submit([encoder.finish()]);
            })?;
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
    ) -> Result<(), RenderError> {
        self.host_work += data.host_work();
        if data.cells.is_none() {
            return self.raster_tile(job, &data, frame, stats);
        }
        let tile = data.tile;
        let mut tiles = CellTiles::new(data, &job.scene.cpu, job.frame_scene, job.view, job.plan);
        if !self.cell_tiles(job, &mut tiles, Some(frame), stats)? {
            let data = TileData::new(&job.scene.cpu, job.frame_scene, job.view, job.plan, tile);
            self.raster_tile(job, &data, frame, stats)?;
        }
        Ok(())
    }

    /// Draws one tile by the compute path into the planes of [`Self::targets`], and copies them to `frame`, if there is
    /// one. Returns false and draws nothing if the tile doesn't fit the device.
    pub(crate) fn cell_tiles(
        &mut self,
        job: &FrameJob<'_>,
        tiles: &mut CellTiles,
        mut frame: Option<&mut Frame>,
        stats: &mut Stats,
    ) -> Result<bool, RenderError> {
        tiles.tiles().iter().skip(1).for_each(|samples| self.host_work += samples.host_work());
        let device = self.device.clone();
        let no_targets = || failed("the targets were not made");
        let mut plan = job.plan.clone();
        let mut room = tiles.room(self.cells.room, self.limits);
        while let Some(tried) = room {
            tiles.put_room(tried);
            let made = scoped(&device, || self.cells.prepare(&device, tiles, tried));
            if matches!(made, Err(ScopedError::OutOfMemory)) {
                // Memory may still suffice for raster hardware.
                self.cells = CellBuffers::default();
                return Ok(false);
            }
            made?;
            let pixels = tiles.pixels().ok_or_else(no_targets)?;
            let recorded = scoped(&device, || {
                cell_entries(job.plan).into_iter().for_each(|entry| self.pipelines.prepare_cells(&device, entry));
                self.prepare_targets(TargetKey {
                    size: pixels.target_size(job.plan),
                    precision: Precision::F32,
                    draws: Vec::new(),
                    floats: tiles.floats(tried),
                });
                self.record_cells(job, &plan, tiles, (tried, frame.is_some()))
            })?;
            let pass_record = self.queries.pass_record();
            let (missing, readback) = recorded.ok_or_else(no_targets)?.read_and_keep(&device, |parts| {
                let [planes, counters, costs] = parts else { return None };
                if !tried.holds(counters) {
                    return Some(Missing::Capacity(tiles.grown(tried, counters, self.limits)));
                }
                if CellCapacity::lacks_layers(&plan, counters) {
                    return Some(Missing::Layers);
                }
                pass_record.add(costs, stats);
                CellCapacity::count(counters, stats);
                let identity = |group, n| pixels.cell_identity(&job.scene.cpu, group, n);
                if let Some(frame) = frame.as_deref_mut() {
                    let planes = bytemuck::cast_slice(planes);
                    stats.fragments += pixels.planes.store(planes, pixels.tile, job.view.region, frame, identity);
                }
                None
            })?;
            self.readback = Some(readback);
            self.errors.check()?;
            match missing {
                Some(Missing::Capacity(grown)) => room = grown,
                Some(Missing::Layers) => {
                    let region = tiles.pixels().ok_or_else(no_targets)?.tile;
                    let least = || min_surface_count(&job.scene.cpu, job.frame_scene, job.view, job.plan, region);
                    plan = with_more_layers(&plan, least).map_err(failed)?;
                }
                None => {
                    let target_bytes = self.targets.as_ref().map_or(0, |targets| targets.key.bytes());
                    count_frame_bytes(target_bytes + self.cells.bytes(), job.shadow_texels.size(), stats);
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }

    /// Records and submits the dispatches that draw a tile and its samples by `plan`, and the copies that the host
    /// reads: counters, query results and, if `reads_planes`, planes. Returns `None` if a resource is missing.
    fn record_cells(
        &mut self,
        job: &FrameJob<'_>,
        plan: &FramePlan,
        tiles: &CellTiles,
        (room, reads_planes): (CellCapacity, bool),
    ) -> Option<Readback> {
        let device = self.device.clone();
        let targets = self.targets.as_ref()?;
        let none = empty(&device, "no shadow map", 4, wgpu::BufferUsages::STORAGE);
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("tile of cells") };
        let mut encoder = device.create_command_encoder(&descriptor);
        self.queries.restart(None);
        for (data, stages) in tiles.tiles().iter().zip(&tiles.stages(plan, room)) {
            let inputs = TileInputs {
                scene: job.scene,
                pipelines: &self.pipelines,
                targets,
                frame: job.frame_scene,
                data,
                pixel_passes: &[],
                shadow_texels: job.shadow_texels,
                drawn_shadow_texels: &none,
                host_depth: None,
            };
            let tile = CellTile::new(&device, &self.queue, &inputs, &self.cells, stages);
            tile.record(&mut encoder, &mut self.queries);
        }
        let costs = self.queries.resolve(&device, &mut encoder);
        let counters = self.cells.get(CellBuffer::Counters)?;
        let floats = if reads_planes { tiles.pixels()?.planes.floats } else { 0 };
        let parts = [
            (&targets.planes, 4 * u64::from(floats)),
            (counters, tiles.bytes(CellBuffer::Counters, room)),
            costs.as_ref().map_or((counters, 0), |(buffer, bytes)| (buffer, *bytes)),
        ];
        let readback = Readback::record_into(self.readback.take(), &device, &mut encoder, &parts);
        self.queue.submit([encoder.finish()]);
        Some(readback)
    }

    /// Draws one tile into the frame by raster hardware.
    fn raster_tile(
        &mut self,
        job: &FrameJob<'_>,
        data: &TileData,
        frame: &mut Frame,
        stats: &mut Stats,
    ) -> Result<(), RenderError> {
        let FrameJob { view, .. } = *job;
        let (region, shared_records) = (data.tile, job.scene.shared_records);
        let (mut plan, before) = (job.plan.clone(), stats.drawn);
        loop {
            let key = self.key(&plan, data);
            let steps = schedule(&plan, &data.visible(), shared_records);
            let tile = (region, data);
            let samples = SamplePart::all(&job.scene.cpu, job.frame_scene, view, &plan, tile, shared_records);
            samples.iter().for_each(|part| self.host_work += part.data.host_work());
            let tile = TileJob { data, key, pixel_passes: &PixelPass::of(&plan), steps: &steps, samples: &samples };
            let (fragments, is_whole) = self.execute(job, tile, stats, |planes| {
                let identity = |draw, record| data.identity(&job.scene.cpu, draw, record);
                data.planes.store(bytemuck::cast_slice(planes), region, view.region, frame, identity)
            })?;
            if is_whole || !plan.has(Pass::ABuffer) {
                stats.fragments += fragments;
                break;
            }
            // The tile's splats were counted already, and are drawn again.
            stats.drawn = before;
            let least = || min_surface_count(&job.scene.cpu, job.frame_scene, view, job.plan, region);
            plan = with_more_layers(&plan, least).map_err(failed)?;
        }
        let target_bytes = self.targets.as_ref().map_or(0, |targets| targets.key.bytes());
        count_frame_bytes(target_bytes, job.shadow_texels.size(), stats);
        Ok(())
    }

    /// Executes the steps of a tile, waits for them, and returns what `read` makes of the words of the planes. The
    /// returned flag is false if more transparent layers may lie behind those that were drawn.
    fn execute<T>(
        &mut self,
        frame: &FrameJob<'_>,
        TileJob { data, key, pixel_passes, steps, samples }: TileJob<'_>,
        stats: &mut Stats,
        read: impl FnOnce(&[u32]) -> T,
    ) -> Result<(T, bool), RenderError> {
        let all = || std::iter::once(data).chain(samples.iter().map(|part| &part.data));
        all().try_for_each(|data| data.check(self.limits)).map_err(failed)?;
        let floats = key.floats;
        let device = self.device.clone();
        let recorded = scoped(&device, || {
            all().for_each(|data| self.prepare(key.clone(), &data.variants(), pixel_passes));
            let targets = self.targets.as_ref()?;
            let none = empty(&device, "no shadow map", 4, wgpu::BufferUsages::STORAGE);
            let inputs = TileInputs {
                scene: frame.scene,
                pipelines: &self.pipelines,
                targets,
                frame: frame.frame_scene,
                data,
                pixel_passes,
                shadow_texels: frame.shadow_texels,
                drawn_shadow_texels: &none,
                host_depth: None,
            };
            let tile = Tile::new(&device, &self.queue, &inputs);
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("tile") });
            self.queries.restart(None);
            for step in steps {
                tile.step(&mut encoder, step, Some(&mut self.queries));
            }
            self.queries.rename(Some(EDGE_SAMPLES));
            let mut layers_of_samples = Vec::new();
            for part in samples {
                let tile = Tile::new(&device, &self.queue, &TileInputs { data: &part.data, ..inputs });
                part.steps.iter().for_each(|step| tile.step(&mut encoder, step, Some(&mut self.queries)));
                layers_of_samples.extend(tile.layer_draws);
            }
            let costs = self.queries.resolve(&device, &mut encoder);
            if let Some(lists) = &data.gaussians {
                let mut dispatches = 1;
                loop {
                    let first = (&targets.planes, 4 * u64::from(floats.min(1)));
                    let readback = Readback::record(&device, &mut encoder, &[first]);
                    self.queue.submit([encoder.finish()]);
                    let more = readback.read(&device, |parts| lists.more_dispatches(dispatches, &parts.concat()));
                    let descriptor = wgpu::CommandEncoderDescriptor { label: Some("more of the tile") };
                    encoder = device.create_command_encoder(&descriptor);
                    // A device that doesn't respond is detected where the planes are read.
                    let Ok(Some(more)) = more else { break };
                    tile.dispatch_again(&mut encoder, steps, more);
                    dispatches += more;
                }
            }
            let none = (&tile.drawn, 0);
            let layers = tile.layer_draws.as_ref().map(|draws| (draws, LAYER_HEADER_BYTES));
            let mut parts = vec![
                (&targets.planes, 4 * u64::from(floats)),
                (&tile.drawn, 4),
                layers.unwrap_or(none),
                costs.as_ref().map_or(none, |(buffer, bytes)| (buffer, *bytes)),
            ];
            parts.extend(layers_of_samples.iter().map(|draws| (draws, LAYER_HEADER_BYTES)));
            let readback = Readback::record_into(self.readback.take(), &device, &mut encoder, &parts);
            self.queue.submit([encoder.finish()]);
            Some(readback)
        })?;
        let missing = || failed("the targets were not made");
        let pass_record = self.queries.pass_record();
        let (result, readback) = recorded.ok_or_else(missing)?.read_and_keep(&device, |parts| {
            let [planes, drawn, layers, costs, of_samples @ ..] = parts else { return None };
            if !layers.is_empty() {
                count_layers(layers, stats);
            }
            pass_record.add(costs, stats);
            stats.drawn += u64::from(drawn.first().copied().unwrap_or(0)) + u64::from(data.host_records());
            let is_whole = !layers_remain(layers) && !of_samples.iter().any(|layers| layers_remain(layers));
            Some((read(planes), is_whole))
        })?;
        self.readback = Some(readback);
        self.errors.check()?;
        result.ok_or_else(missing)
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
        let (texels, _) = self.shadow_maps(&scene, &frame.plan)?;
        let frame_scene = FrameScene::new(&scene.cpu, &frame.view, &frame.plan);
        let data = TileData::new(&scene.cpu, &frame_scene, &frame.view, &frame.plan, frame.view.region);
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
            let key = TargetKey { draws: frame.draws.clone(), floats: 1, ..self.key(&frame.plan, &data) };
            let mut stats = Stats::default();
            let tile = TileJob { data: &data, key, pixel_passes: &[], steps: &frame.steps, samples: &[] };
            self.execute(&job, tile, &mut stats, |_| ())?;
            runs.push(stats);
        }
        Ok(frame.rates(&runs))
    }
}

/// Query results of a tile of a shadow map, before they are read back.
pub(crate) struct MapCost {
    readback: Readback,
    pass_record: PassRecord,
}

/// Part of a tile that the compute path lacked, so that the tile is drawn again.
enum Missing {
    /// Capacity of the buffers: the required one, or `None` if it exceeds the limits.
    Capacity(Option<CellCapacity>),
    /// Layers of an A-buffer.
    Layers,
}

/// Inputs that all tiles of a frame share.
#[derive(Clone, Copy)]
pub(crate) struct FrameJob<'a> {
    pub scene: &'a ResidentScene,
    /// Texels of the frame's shadow maps.
    pub shadow_texels: &'a wgpu::Buffer,
    pub frame_scene: &'a FrameScene,
    pub view: &'a View,
    pub plan: &'a FramePlan,
}

/// Steps that raster hardware executes for a tile, with their data.
struct TileJob<'a> {
    data: &'a TileData,
    key: TargetKey,
    /// Pixel passes among the steps, and among the steps of samples.
    pixel_passes: &'a [PixelPass],
    steps: &'a [Step],
    /// Samples of the tile's edge pixels, in parts that each fit the tile's targets; empty unless edges are antialiased
    /// by samples.
    samples: &'a [SamplePart],
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
        let resident = scene::upload(&self.device, &self.queue, (scene, self.storage), self.limits, progress)?;
        self.errors.check()?;
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
        if !self.path.draws_cells(&plan) {
            self.check_bindings(&plan)?;
        }
        let mut stats = Stats::default().with_splats(plan.splats);
        // Tiles write every pixel. Colours requested only in 8 bits are encoded from the device's f32 colours.
        frame.resize(view.region.width, view.region.height, plan.planes.with_color(planes.color));
        let frame_scene = FrameScene::new(&scene.cpu, view, &plan).with_host_shader(self.has_host_shader);
        let (texels, costs) = self.shadow_maps(scene, &plan)?;
        let job = FrameJob { scene, shadow_texels: &texels, frame_scene: &frame_scene, view, plan: &plan };
        for data in FrameTiles::new(&scene.cpu, &frame_scene, view, &plan, self.limits, self.path) {
            self.tile(&job, data.map_err(failed)?, frame, &mut stats)?;
        }
        for MapCost { readback, pass_record } in costs {
            readback.read(&self.device, |parts| pass_record.add(parts.concat().as_slice(), &mut stats))?;
        }
        frame.locate(view);
        stats.bytes_per_splat = scene.bytes() as f64 / scene.cpu.summary.splats.max(1) as f64;
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(stats)
    }
}
