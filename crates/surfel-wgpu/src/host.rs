//! Drawing into a host's picture, among whatever else it draws.

use crate::error::{failed, scoped};
use crate::execute::{Beside, Tile};
use crate::pipelines::{HostKey, Part};
use crate::renderer::Renderer;
use crate::scene::{ResidentScene, empty};
use surfel_gpu::{FrameScene, Pixels, Step, TargetKey, TileData, schedule};
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
    /// Is tested and written. If it is of one sample, has the usage `TEXTURE_BINDING` and a format without stencil, it is read,
    /// too, and transparent splats are seen before and behind the host's own things as they should.
    pub depth: &'a wgpu::TextureView,
    /// Format of `depth`.
    pub depth_format: wgpu::TextureFormat,
    /// What `depth` holds.
    pub mapping: HostDepth,
}

impl Renderer {
    /// Draws a scene into a host's picture: where its surface passes the depth test it replaces colour and depth, elsewhere
    /// nothing changes. The scene's background is not drawn, and antialiased edges blend over what the host has there.
    /// Transparent splats blend over it, too, and leave the depth alone: those that the host's things hide are
    /// not drawn. For that the depth buffer is read; where it can't be (see [`HostTarget::depth`]), the scene's opaque
    /// surface, or else the nearest transparent one, decides for all of a pixel, and writes its depth: the host's own things
    /// between them are not seen, for layers are drawn front to back and a host's picture is blended back to front.
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
        let texels = self.shadow_maps(scene, &plan)?.0;
        let mut pixels = Pixels::of(&plan);
        let among = pixels.contains(&Pixels::BeginLayers) && is_readable(target.depth);
        let parts: &[Part] = if among { &[Part::Opaque, Part::Layers] } else { &[Part::Whole] };
        let steps = schedule(&plan, &data.visible(), scene.shared_records);
        let in_host = |pixels: Pixels| match pixels {
            Pixels::BeginLayers if among => Pixels::BeginLayersInHost,
            others => others,
        };
        pixels.iter_mut().for_each(|pixels| *pixels = in_host(*pixels));
        let device = self.device.clone();
        scoped(&device, || {
            self.prepare(key, &data.variants(), &pixels);
            let host = |part| HostKey {
                part,
                color: target.color_format,
                depth: target.depth_format,
                compare: target.mapping.compare,
            };
            parts.iter().for_each(|&part| self.pipelines.prepare_composite(&device, host(part)));
            let Some(targets) = &self.targets else { return };
            let none = empty(&device, "no shadow map", 4, wgpu::BufferUsages::STORAGE);
            let host_depth = among.then_some(target.depth);
            let beside = Beside { shadows: &texels, drawn_shadows: &none, host_depth };
            let resources = (scene, &self.pipelines, targets);
            let job = Tile::new(&device, &self.queue, resources, &frame_scene, &data, &pixels, beside);
            for step in steps {
                match step {
                    Step::Pixels(pixels) if pixels.is_shade() => {}
                    Step::Pixels(pixels) => job.step(encoder, &Step::Pixels(in_host(pixels)), None),
                    other => job.step(encoder, &other, None),
                }
            }
            parts.iter().for_each(|&part| job.composite(encoder, host(part), target));
        })?;
        self.errors.check()
    }
}

/// True if shaders can read a depth buffer.
fn is_readable(depth: &wgpu::TextureView) -> bool {
    let texture = depth.texture();
    let stencil = texture.format().has_stencil_aspect();
    texture.usage().contains(wgpu::TextureUsages::TEXTURE_BINDING) && !stencil && texture.sample_count() == 1
}
