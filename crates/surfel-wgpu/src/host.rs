//! Drawing into a host's picture, among whatever else it draws.

use crate::error::{failed, scoped};
use crate::execute::{Shadows, Tile};
use crate::pipelines::HostKey;
use crate::renderer::Renderer;
use crate::scene::{ResidentScene, empty};
use crate::targets::TargetKey;
use surfel_gpu::{FrameScene, Pixels, Step, TileData, schedule};
use surfel_model::Settings;
use surfel_render::{Planes, RenderError, View, plan};

/// What a host's depth buffer holds for a planar depth z, and which of two depths is nearer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HostDepth {
    /// In a perspective projection it holds `offset` + `scale`/z, in an orthographic one `offset` + `scale`·z.
    pub offset: f32,
    /// See `offset`.
    pub scale: f32,
    /// Whether a new depth replaces the one that is there.
    pub compare: wgpu::CompareFunction,
}

impl HostDepth {
    /// Reversed depth without a far plane, z_near/z: 1 at z_near, 0 infinitely far.
    pub fn reversed(near: f32) -> Self {
        Self { offset: 0.0, scale: near, compare: wgpu::CompareFunction::Greater }
    }

    /// The usual depth of a perspective projection: 0 at `near`, 1 at `far`.
    pub fn usual(near: f32, far: f32) -> Self {
        let offset = far / (far - near);
        Self { offset, scale: -near * offset, compare: wgpu::CompareFunction::Less }
    }
}

/// A host's picture: a colour target and a depth buffer of the size of the view's region.
#[derive(Clone, Copy, Debug)]
pub struct HostTarget<'a> {
    /// Gets linear colours; a format that ends in `Srgb` encodes them.
    pub color: &'a wgpu::TextureView,
    /// Format of `color`.
    pub color_format: wgpu::TextureFormat,
    /// Is tested and written.
    pub depth: &'a wgpu::TextureView,
    /// Format of `depth`.
    pub depth_format: wgpu::TextureFormat,
    /// What `depth` holds.
    pub mapping: HostDepth,
}

impl Renderer {
    /// Draws a scene into a host's picture: where its surface passes the depth test it replaces colour and depth, elsewhere
    /// nothing changes. The scene's background is not drawn; antialiased edges and transparent splats blend over what the
    /// host has there. Where transparent splats are before an opaque surface, that surface decides for both; the host's own
    /// things between them are not seen.
    ///
    /// Records into `encoder`, which the host submits to the renderer's queue before the next call on this renderer.
    /// Nothing is read back, and no time is counted.
    ///
    /// # Errors
    /// As [`surfel_render::Renderer::render`]; also for a region larger than a texture can be, and targets that wgpu
    /// refuses.
    pub fn render_to_view(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        target: &HostTarget<'_>,
    ) -> Result<(), RenderError> {
        let planes = Planes { depth: true, ..Planes::COLOR };
        let plan = plan(&scene.cpu.summary, view, settings, planes, &self.info.capabilities)?;
        let (region, side) = (view.region, self.limits.texture_side);
        // Edges have a border of a pixel.
        let side = side.saturating_sub(2);
        if region.width > side || region.height > side {
            let (width, height) = (region.width, region.height);
            return Err(failed(format!("the view is of {width}x{height} pixels, expected at most {side} a side")));
        }
        let frame_scene = FrameScene::new(&scene.cpu, view, &plan);
        let mut data = TileData::new(&scene.cpu, &frame_scene, view, &plan, region);
        data.check(self.limits).map_err(failed)?;
        data.set_host_depth(target.mapping.offset, target.mapping.scale);
        // The planes go nowhere.
        let key = TargetKey { floats: 1, ..self.key(&plan, &data) };
        let host = HostKey { color: target.color_format, depth: target.depth_format, compare: target.mapping.compare };
        let (texels, _) = self.shadow_maps(scene, &plan)?;
        let device = self.device.clone();
        scoped(&device, || {
            self.prepare(key, &data.variants(), &Pixels::of(&plan));
            self.pipelines.prepare_composite(&device, host);
            let Some(targets) = &self.targets else { return };
            let parts = (scene, &self.pipelines, targets);
            let none = empty(&device, "no shadow map", 4, wgpu::BufferUsages::STORAGE);
            let shadows = Shadows { read: &texels, written: &none };
            let job = Tile::new(&device, &self.queue, parts, &frame_scene, &data, &Pixels::of(&plan), shadows);
            for step in schedule(&plan, &data.visible(), scene.shared_records) {
                if !matches!(step, Step::Pixels(pixels) if pixels.is_shade()) {
                    job.step(encoder, &step, None);
                }
            }
            job.composite(encoder, host, target);
        })?;
        self.errors.check()
    }
}
