//! The backend: scenes in, frames out.

use crate::adapter::{self, Opened, blends_f32, renderer_info};
use crate::error::{Mailbox, failed, scoped};
use crate::execute::{Shadows, Tile};
use crate::pipelines::{Pipelines, Precision};
use crate::readback::Readback;
use crate::scene::{self, ResidentScene, empty};
use crate::targets::{TargetKey, Targets};
use crate::timing::Timer;
use std::time::Instant;
use surfel_gpu::{
    Draw, FrameScene, LAYER_HEADER_BYTES, Limits, MapJob, Pixels, TileData, Variant, count_layers, map_jobs, schedule,
    shadow_texels, tiles,
};
use surfel_model::{Accumulate, Scene, Settings};
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
    timer: Option<Timer>,
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
    /// `Features::TIMESTAMP_QUERY` times of passes; both are optional. The renderer takes over the device's handlers of
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
        let (pipelines, timer) = scoped(&device, || (Pipelines::new(&device), Timer::new(&device, &queue)))?;
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
            timer,
            limits,
            storage,
        })
    }

    /// True if the adapter computes on the processor: the `cpu` backend is faster.
    pub fn is_software(&self) -> bool {
        self.is_software
    }

    /// Precision of a plan's sums on this adapter.
    fn precision(&self, plan: &FramePlan) -> Precision {
        let f32_sums = self.f32_sums && plan.accumulate == Accumulate::F32;
        if f32_sums { Precision::F32 } else { Precision::F16 }
    }

    /// The targets of a tile.
    pub(crate) fn key(&self, plan: &FramePlan, data: &TileData) -> TargetKey {
        TargetKey {
            size: [data.targets.width, data.targets.height],
            precision: self.precision(plan),
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

    /// Draws a plan's shadow maps.
    pub(crate) fn shadow_maps(&mut self, scene: &ResidentScene, plan: &FramePlan) -> Result<wgpu::Buffer, RenderError> {
        let texels = shadow_texels(plan, self.limits).map_err(failed)?;
        let device = self.device.clone();
        let buffer = scoped(&device, || empty(&device, "shadow texels", 4 * texels, wgpu::BufferUsages::STORAGE))?;
        std::mem::swap(&mut self.targets, &mut self.map_targets);
        let drawn = map_jobs(&scene.cpu, plan).iter().try_for_each(|job| self.shadow_map(scene, job, &buffer));
        std::mem::swap(&mut self.targets, &mut self.map_targets);
        drawn.map(|()| buffer)
    }

    fn shadow_map(&mut self, scene: &ResidentScene, job: &MapJob, texels: &wgpu::Buffer) -> Result<(), RenderError> {
        let device = self.device.clone();
        let pixels = Pixels::of(&job.plan);
        for data in job.tiles(&scene.cpu, self.limits) {
            data.check(self.limits).map_err(failed)?;
            let key = self.key(&job.plan, &data);
            scoped(&device, || {
                self.prepare(key, &data.variants(), &pixels);
                let Some(targets) = &self.targets else { return };
                let none = empty(&device, "no shadows", 4, wgpu::BufferUsages::STORAGE);
                let shadows = Shadows { read: &none, written: texels };
                let parts = (scene, &self.pipelines, targets);
                let tile = Tile::new(&device, &self.queue, parts, &job.frame, &data, &pixels, shadows);
                let mut encoder =
                    device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("shadow map") });
                for step in schedule(&job.plan, &data.visible(), scene.shared_records) {
                    tile.step(&mut encoder, &step, None);
                }
                self.queue.submit([encoder.finish()]);
            })?;
        }
        Ok(())
    }

    /// Draws one tile into the frame.
    fn tile(
        &mut self,
        (scene, texels): (&ResidentScene, &wgpu::Buffer),
        frame_scene: &FrameScene,
        (view, plan, tile): (&View, &FramePlan, Region),
        frame: &mut Frame,
        stats: &mut Stats,
    ) -> Result<(), RenderError> {
        let data = TileData::new(&scene.cpu, frame_scene, view, plan, tile);
        data.check(self.limits).map_err(failed)?;
        let key = self.key(plan, &data);
        let floats = key.floats;
        let device = self.device.clone();
        let readback = scoped(&device, || {
            self.prepare(key, &data.variants(), &Pixels::of(plan));
            let targets = self.targets.as_ref()?;
            let parts = (scene, &self.pipelines, targets);
            let none = empty(&device, "no shadow map", 4, wgpu::BufferUsages::STORAGE);
            let shadows = Shadows { read: texels, written: &none };
            let job = Tile::new(&self.device, &self.queue, parts, frame_scene, &data, &Pixels::of(plan), shadows);
            let mut encoder =
                self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("tile") });
            if let Some(timer) = &mut self.timer {
                timer.restart();
            }
            for step in schedule(plan, &data.visible(), scene.shared_records) {
                job.step(&mut encoder, &step, self.timer.as_mut());
            }
            let times = self.timer.as_ref().map(|timer| {
                let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
                let buffer = empty(&self.device, "pass times", timer.bytes(), usage);
                timer.resolve(&mut encoder, &buffer);
                (buffer, timer.bytes())
            });
            let layers = job.layer_draws.as_ref().map(|draws| (draws, LAYER_HEADER_BYTES));
            let mut parts =
                vec![(&targets.planes, 4 * u64::from(floats)), (&job.drawn, 4), layers.unwrap_or((&job.drawn, 0))];
            parts.extend(times.as_ref().map(|(buffer, bytes)| (buffer, *bytes)));
            let readback = Readback::record(&self.device, &mut encoder, &parts);
            self.queue.submit([encoder.finish()]);
            Some(readback)
        })?;
        let Some(readback) = readback else { return Err(failed("the targets were not made")) };
        let timer = self.timer.as_ref();
        readback.read(&self.device, |parts| {
            let [planes, drawn, layers, times @ ..] = parts else { return };
            if !layers.is_empty() {
                count_layers(layers, stats);
            }
            stats.fragments += data.planes.store(bytemuck::cast_slice(planes), tile, view.region, frame);
            stats.drawn += u64::from(drawn.first().copied().unwrap_or(0)) + u64::from(data.near_count());
            if let (Some(timer), Some(words)) = (timer, times.first()) {
                timer.add(words, &mut stats.passes);
            }
        })?;
        self.errors.check()
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
        let texels = self.shadow_maps(scene, &plan)?;
        for tile in tiles(view, &plan, self.limits) {
            self.tile((scene, &texels), &frame_scene, (view, &plan, tile), frame, &mut stats)?;
        }
        stats.bytes_per_splat = scene.bytes() as f64 / stats.splats.max(1) as f64;
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(stats)
    }
}
