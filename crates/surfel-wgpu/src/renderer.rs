//! The backend: scenes in, frames out.

use crate::adapter::{self, Opened, blends_f32, renderer_info};
use crate::error::{Mailbox, failed, scoped};
use crate::execute::{Beside, Tile};
use crate::pipelines::Pipelines;
use crate::queries::{Queries, Taken};
use crate::readback::Readback;
use crate::scene::{self, ResidentScene, empty};
use crate::targets::Targets;
use std::time::Instant;
use surfel_gpu::{
    CEILING_RUNS, CeilingFrame, Draw, FillRate, FrameScene, LAYER_HEADER_BYTES, Limits, MapCache, MapJob, Pixels,
    Precision, SHADOW_MAPS, Step, TargetKey, TileData, Variant, count_frame_bytes, count_layers, map_jobs, schedule,
    shadow_texels, tiles,
};
use surfel_model::{Scene, Settings};
use surfel_render::{
    Frame, FramePlan, Planes, Region, RenderError, RendererInfo, Stats, Storage, UploadProgress, View, plan,
};

/// How a [`Renderer`] is opened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// A part of the adapter's name, in any case; `None`: the fastest kind of adapter there is.
    pub adapter: Option<String>,
    /// Has the API's own validation check every call, where it is installed. Messages go to the `log` crate.
    pub validation: bool,
    /// What may be used of the device.
    pub limits: Limits,
    /// How splats are kept in the device's memory.
    pub storage: Storage,
}

/// The wgpu backend.
pub struct Renderer {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) info: RendererInfo,
    is_software: bool,
    /// The adapter blends f32.
    f32_sums: bool,
    pub(crate) errors: Mailbox,
    pub(crate) pipelines: Pipelines,
    pub(crate) targets: Option<Targets>,
    /// Those of shadow maps.
    map_targets: Option<Targets>,
    queries: Queries,
    /// The shadow maps of the frame before.
    maps: Option<MapCache<wgpu::Buffer>>,
    /// Of the device, and of those who opened it.
    pub(crate) limits: Limits,
    storage: Storage,
}

impl Renderer {
    /// A renderer on the fastest kind of adapter there is.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if there is no adapter, or it doesn't start.
    pub fn new() -> Result<Self, RenderError> {
        Self::with_options(&Options::default())
    }

    /// A renderer with these options.
    ///
    /// # Errors
    /// As [`Renderer::new`]; also if no adapter has that name.
    pub fn with_options(options: &Options) -> Result<Self, RenderError> {
        let Opened { device, queue, info } = adapter::open(options)?;
        Self::start(device, queue, &info, options.limits, options.storage)
    }

    /// A renderer on a device that a program has anyway. `Features::FLOAT32_BLENDABLE` gives f32 sums,
    /// `Features::TIMESTAMP_QUERY` times of passes, `Features::PIPELINE_STATISTICS_QUERY` counts of what shaders ran; all are
    /// optional. The renderer takes over the device's handlers of
    /// uncaptured errors and of its loss.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if the device refuses the shaders.
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue) -> Result<Self, RenderError> {
        let info = device.adapter_info();
        Self::start(device, queue, &info, Limits::default(), Storage::default())
    }

    fn start(
        device: wgpu::Device,
        queue: wgpu::Queue,
        info: &wgpu::AdapterInfo,
        limits: Limits,
        storage: Storage,
    ) -> Result<Self, RenderError> {
        let errors = Mailbox::of(&device);
        let f32_sums = blends_f32(&device);
        let (pipelines, queries) = scoped(&device, || (Pipelines::new(&device), Queries::new(&device, &queue)))?;
        let own = device.limits();
        let buffer_bytes = own.max_storage_buffer_binding_size.min(own.max_buffer_size);
        let limits = limits.within(buffer_bytes, own.max_texture_dimension_2d);
        let is_software = info.device_type == wgpu::DeviceType::Cpu;
        let info = renderer_info(info, f32_sums);
        Ok(Self {
            device,
            queue,
            info,
            is_software,
            f32_sums,
            errors,
            pipelines,
            targets: None,
            map_targets: None,
            queries,
            maps: None,
            limits,
            storage,
        })
    }

    /// True if the adapter computes on the processor: the `cpu` backend is faster.
    pub fn is_software(&self) -> bool {
        self.is_software
    }

    /// The targets of a tile.
    pub(crate) fn key(&self, plan: &FramePlan, data: &TileData) -> TargetKey {
        TargetKey {
            size: [data.targets.width, data.targets.height],
            precision: Precision::of(plan, self.f32_sums),
            draws: Draw::of(plan),
            floats: data.planes.floats,
        }
    }

    /// Makes pipelines and targets, where they aren't there from the frame before.
    pub(crate) fn prepare(&mut self, key: TargetKey, variants: &[Variant], pixels: &[Pixels]) {
        for &pixels in pixels {
            self.pipelines.prepare_pixels(&self.device, pixels);
        }
        for &variant in variants {
            self.pipelines.prepare_splats(&self.device, variant);
            for &draw in key.draws.iter().filter(|draw| draw.is_of_records() || variant == Variant::Whole) {
                self.pipelines.prepare(&self.device, draw, variant, key.precision);
            }
        }
        if self.targets.as_ref().is_none_or(|targets| targets.key != key) {
            // The old ones go first: both may not fit.
            self.targets = None;
            self.targets = Some(Targets::new(&self.device, &self.pipelines, key));
        }
    }

    /// A plan's shadow maps: drawn, or those of the frame before where they are the same. What drawing them costs can be read
    /// once the device has done it.
    pub(crate) fn shadow_maps(
        &mut self,
        scene: &ResidentScene,
        plan: &FramePlan,
    ) -> Result<(wgpu::Buffer, Vec<MapCost>), RenderError> {
        let jobs = map_jobs(&scene.cpu, plan);
        if let Some(cache) = self.maps.as_ref().filter(|cache| cache.fits(&scene.cpu, &jobs)) {
            return Ok((cache.texels.clone(), Vec::new()));
        }
        // Those before go first: both may not fit.
        self.maps = None;
        let texels = shadow_texels(plan, self.limits).map_err(failed)?;
        let device = self.device.clone();
        let buffer = scoped(&device, || empty(&device, "shadow texels", 4 * texels, wgpu::BufferUsages::STORAGE))?;
        let mut costs = Vec::new();
        std::mem::swap(&mut self.targets, &mut self.map_targets);
        let drawn = jobs.iter().try_for_each(|job| self.shadow_map(scene, job, &buffer, &mut costs));
        std::mem::swap(&mut self.targets, &mut self.map_targets);
        drawn?;
        self.maps = Some(MapCache::new(buffer.clone(), &scene.cpu, &jobs));
        Ok((buffer, costs))
    }

    fn shadow_map(
        &mut self,
        scene: &ResidentScene,
        job: &MapJob,
        texels: &wgpu::Buffer,
        costs: &mut Vec<MapCost>,
    ) -> Result<(), RenderError> {
        let device = self.device.clone();
        let pixels = Pixels::of(&job.plan);
        for data in job.tiles(&scene.cpu, self.limits) {
            data.check(self.limits).map_err(failed)?;
            let key = self.key(&job.plan, &data);
            scoped(&device, || {
                self.prepare(key, &data.variants(), &pixels);
                let Some(targets) = &self.targets else { return };
                let none = empty(&device, "no shadows", 4, wgpu::BufferUsages::STORAGE);
                let beside = Beside { shadows: &none, drawn_shadows: texels, host_depth: None };
                let parts = (scene, &self.pipelines, targets);
                let tile = Tile::new(&device, &self.queue, parts, &job.frame, &data, &pixels, beside);
                let mut encoder =
                    device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("shadow map") });
                self.queries.restart(Some(SHADOW_MAPS));
                for step in schedule(&job.plan, &data.visible(), scene.shared_records) {
                    tile.step(&mut encoder, &step, Some(&mut self.queries));
                }
                if let Some((buffer, bytes)) = self.queries.resolve(&device, &mut encoder) {
                    let readback = Readback::record(&device, &mut encoder, &[(&buffer, bytes)]);
                    costs.push(MapCost { readback, taken: self.queries.taken() });
                }
                self.queue.submit([encoder.finish()]);
            })?;
        }
        Ok(())
    }

    /// Draws one tile into the frame.
    fn tile(
        &mut self,
        resident: (&ResidentScene, &wgpu::Buffer),
        frame_scene: &FrameScene,
        (view, plan, tile): (&View, &FramePlan, Region),
        frame: &mut Frame,
        stats: &mut Stats,
    ) -> Result<(), RenderError> {
        let data = TileData::new(&resident.0.cpu, frame_scene, view, plan, tile);
        let key = self.key(plan, &data);
        let steps = schedule(plan, &data.visible(), resident.0.shared_records);
        let planes = self.execute(resident, frame_scene, (&data, key, &Pixels::of(plan), &steps), stats, |planes| {
            data.planes.store(bytemuck::cast_slice(planes), tile, view.region, frame)
        })?;
        stats.fragments += planes;
        let target_bytes = self.targets.as_ref().map_or(0, |targets| targets.key.bytes());
        count_frame_bytes(target_bytes, resident.1.size(), stats);
        Ok(())
    }

    /// Executes steps, waits for them, and hands the words of the planes to `read`.
    fn execute<T>(
        &mut self,
        (scene, texels): (&ResidentScene, &wgpu::Buffer),
        frame_scene: &FrameScene,
        (data, key, pixels, steps): (&TileData, TargetKey, &[Pixels], &[Step]),
        stats: &mut Stats,
        read: impl FnOnce(&[u32]) -> T,
    ) -> Result<T, RenderError> {
        data.check(self.limits).map_err(failed)?;
        let floats = key.floats;
        let device = self.device.clone();
        let recorded = scoped(&device, || {
            self.prepare(key, &data.variants(), pixels);
            let targets = self.targets.as_ref()?;
            let parts = (scene, &self.pipelines, targets);
            let none = empty(&device, "no shadow map", 4, wgpu::BufferUsages::STORAGE);
            let beside = Beside { shadows: texels, drawn_shadows: &none, host_depth: None };
            let job = Tile::new(&device, &self.queue, parts, frame_scene, data, pixels, beside);
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("tile") });
            self.queries.restart(None);
            for step in steps {
                job.step(&mut encoder, step, Some(&mut self.queries));
            }
            let costs = self.queries.resolve(&device, &mut encoder);
            let nothing = (&job.drawn, 0);
            let layers = job.layer_draws.as_ref().map(|draws| (draws, LAYER_HEADER_BYTES));
            let parts = [
                (&targets.planes, 4 * u64::from(floats)),
                (&job.drawn, 4),
                layers.unwrap_or(nothing),
                costs.as_ref().map_or(nothing, |(buffer, bytes)| (buffer, *bytes)),
            ];
            let readback = Readback::record(&device, &mut encoder, &parts);
            self.queue.submit([encoder.finish()]);
            Some(readback)
        })?;
        let missing = || failed("the targets were not made");
        let taken = self.queries.taken();
        let result = recorded.ok_or_else(missing)?.read(&device, |parts| {
            let [planes, drawn, layers, costs] = parts else { return None };
            if !layers.is_empty() {
                count_layers(layers, stats);
            }
            taken.add(costs, stats);
            stats.drawn += u64::from(drawn.first().copied().unwrap_or(0)) + u64::from(data.near_count());
            Some(read(planes))
        })?;
        self.errors.check()?;
        result.ok_or_else(missing)
    }

    /// What the device does at best, in targets of so many pixels a side: what its times are to be judged by. Empty where it
    /// has no timestamps.
    ///
    /// # Errors
    /// As [`surfel_render::Renderer::render`].
    pub fn ceilings(&mut self, side_px: u32) -> Result<Vec<FillRate>, RenderError> {
        let frame = CeilingFrame::new(side_px.min(self.limits.texture_side))?;
        let scene = surfel_render::Renderer::upload(self, &Scene::default())?;
        let (texels, _) = self.shadow_maps(&scene, &frame.plan)?;
        let frame_scene = FrameScene::new(&scene.cpu, &frame.view, &frame.plan);
        let data = TileData::new(&scene.cpu, &frame_scene, &frame.view, &frame.plan, frame.view.region);
        let mut runs = Vec::new();
        // The first warms up, and counts no less than the others: the best one is taken.
        for _ in 0..CEILING_RUNS {
            let key = TargetKey { draws: frame.draws.clone(), floats: 1, ..self.key(&frame.plan, &data) };
            let mut stats = Stats::default();
            let job = (&data, key, &[][..], frame.steps.as_slice());
            self.execute((&scene, &texels), &frame_scene, job, &mut stats, |_| ())?;
            runs.push(stats);
        }
        Ok(frame.rates(&runs))
    }
}

/// What drawing a shadow map costs, on its way.
pub(crate) struct MapCost {
    readback: Readback,
    taken: Taken,
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

    fn render(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let start = Instant::now();
        let plan = plan(&scene.cpu.summary, view, settings, planes, &self.info.capabilities)?;
        let mut stats = Stats { splats: scene.cpu.summary.splats, ..Stats::default() };
        frame.reset(view.region.width, view.region.height, plan.planes);
        let frame_scene = FrameScene::new(&scene.cpu, view, &plan);
        let (texels, costs) = self.shadow_maps(scene, &plan)?;
        for tile in tiles(view, &plan, self.limits) {
            self.tile((scene, &texels), &frame_scene, (view, &plan, tile), frame, &mut stats)?;
        }
        for MapCost { readback, taken } in costs {
            readback.read(&self.device, |parts| taken.add(parts.concat().as_slice(), &mut stats))?;
        }
        stats.bytes_per_splat = scene.bytes() as f64 / stats.splats.max(1) as f64;
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(stats)
    }
}
