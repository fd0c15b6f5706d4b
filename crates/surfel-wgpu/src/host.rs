//! Draws into the render target of the embedding application, together with the application's own geometry.

use crate::error::{failed, scoped};
use crate::execute::{Tile, TileInputs, composite_planes};
use crate::host_target::HostTarget;
use crate::pipelines::{HostKey, Part};
use crate::renderer::{FrameJob, Renderer};
use crate::scene::{ResidentScene, empty};
use surfel_gpu::{
    CellTiles, FrameScene, FrameTiles, GpuPath, PixelPass, SamplePart, Step, TargetKey, TileData, schedule,
};
use surfel_model::Settings;
use surfel_render::{Capabilities, Feature, FramePlan, Identity, Pass, Planes, RenderError, Stats, View, plan};

/// Capabilities of drawing into the application's render target. It lacks the features that no GPU backend draws, and
/// A-buffers. Only a readback shows how many layers an A-buffer has, and nothing is read back here.
const CAPABILITIES: Capabilities =
    Capabilities { backend: crate::NAME, lacks: &[Feature::ABuffer, Feature::Margin, Feature::Sky] };

/// Table that resolves the pairs of numbers in the application's index texture ([`HostTarget::index`]). It belongs to
/// one call of [`Renderer::render_to_view`].
pub struct HostIndex(TileData);

impl HostIndex {
    /// Returns the row, object and label of a pixel's nearest splat, polygon or ball. `pixel` is the pixel's pair of
    /// numbers, and `scene` the scene that was drawn. Returns [`Identity::NOTHING`] for a pair that the call has not
    /// written. An application that clears its texture to −1 can thus recognise its own pixels.
    pub fn identity(&self, scene: &ResidentScene, pixel: [i32; 2]) -> Identity {
        match (pixel, usize::try_from(pixel[1])) {
            ([-1, _], _) | (_, Err(_)) => Identity::NOTHING,
            ([group, _], Ok(n)) if self.0.cells.is_some() => self.0.cell_identity(&scene.cpu, group, n),
            ([draw, _], Ok(record)) => self.0.identity(&scene.cpu, draw, record),
        }
    }
}

/// Decisions about how a frame is drawn into the application's render target.
struct HostFrame {
    /// Parts of the composition, in order.
    parts: Vec<Part>,
    /// True if shaders read the application's depth buffer.
    reads_depth: bool,
    /// True if shading writes the planes, because they are composited or have the numbers of the nearest splats.
    has_planes: bool,
}

impl HostFrame {
    /// Decides how the frame of a plan is drawn into a target.
    fn of(plan: &FramePlan, target: &HostTarget<'_>) -> Self {
        // Means of samples, Gaussians and balls are complete only in the planes.
        let by_planes = plan.has(Pass::EdgeSamples) || plan.has(Pass::Gaussians) || plan.has(Pass::Balls);
        let has_layers = PixelPass::of(plan).contains(&PixelPass::BeginLayers);
        let is_cut = plan.has(Pass::Gaussians) || (has_layers && !by_planes);
        let reads_depth = is_cut && is_readable(target.depth);
        // The numbers are written first, while the depth is still the application's own.
        let mut parts: Vec<Part> = target.index.map(|_| Part::Index).into_iter().collect();
        parts.extend_from_slice(match (by_planes, reads_depth) {
            (true, true) => &[Part::PlanesOver],
            (true, false) => &[Part::Planes],
            (false, true) => &[Part::Opaque, Part::Layers],
            (false, false) => &[Part::Whole],
        });
        Self { parts, reads_depth, has_planes: by_planes || target.index.is_some() }
    }

    /// Returns a pixel pass, or the pass that replaces it if the application's depth buffer is read.
    fn pass(&self, pass: PixelPass) -> PixelPass {
        match pass {
            PixelPass::BeginLayers if self.reads_depth => PixelPass::BeginLayersInHost,
            PixelPass::Gaussians if self.reads_depth => PixelPass::GaussiansInHost,
            others => others,
        }
    }
}

impl Renderer {
    /// Draws a scene into the application's render target. Where the scene's surface passes the depth test, it replaces
    /// colour and depth; other pixels don't change. The scene's background is not drawn, and antialiased edges blend
    /// over the application's colours.
    ///
    /// Everything else that a frame may contain is drawn, too. Its colours are those of a frame, over the application's
    /// image:
    /// - *Transparent splats* blend over the application's colours and don't write the depth. Splats that the
    ///   application's geometry occludes are not drawn, which requires reading the depth buffer. If it can't be read
    ///   (see [`HostTarget::depth`]), the scene's opaque surface, or else the nearest transparent one, decides for the
    ///   whole pixel and writes its depth. The application's geometry between these surfaces is then lost: layers are
    ///   composited front to back, but blending with the application's image is back to front.
    /// - *Trained Gaussians* blend in the same way. If the depth buffer can't be read, their mean depth decides for the
    ///   whole pixel and is written.
    /// - *Edges by samples* and *balls*: one depth decides for the whole pixel, that of the nearest surface at its
    ///   centre. Where only samples beside the centre show a surface, it is the nearest depth of the eight neighbours.
    ///   Transparent splats follow the same rule here, whether or not the depth can be read.
    /// - *Numbers of the nearest splats* are written to [`HostTarget::index`]. The returned [`HostIndex`] resolves
    ///   them.
    ///
    /// Frames are refused if only a readback tells how many passes they take. These are frames with A-buffers, with
    /// Gaussians sorted by pixel, and with more than 32,768 Gaussians before 16×16 pixels.
    ///
    /// Records into `encoder`, which the application submits to the renderer's queue before the next call on this
    /// renderer. No times are measured. `target` must have the size of the view's region.
    ///
    /// Raster hardware draws the frame by default, and nothing is read back. Compute shaders draw it with
    /// [`GpuPath::Compute`](surfel_gpu::GpuPath) in [`Options::path`](crate::Options), except transparent splats
    /// without edges by samples and what that path never draws. The call then submits their work itself, and **waits
    /// until the GPU is done** with it and with everything submitted before. The memory that a frame needs is known
    /// only once it is drawn; a frame that needs more is drawn again.
    ///
    /// # Errors
    /// - [`RenderError::Model`] for settings out of range, [`RenderError::NoInteriorWeight`] and
    ///   [`RenderError::NoRows`] for clouds that lack an interior weight or rows;
    /// - [`RenderError::Unsupported`] for A-buffers, and for skies whose light isn't stored;
    /// - [`RenderError::Backend`] for other refused frames, for a region larger than the largest texture, for
    ///   balls on a device with WebGPU's core limit of eight storage buffers per stage, and for targets that wgpu
    ///   refuses.
    pub fn render_to_view(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        target: &HostTarget<'_>,
    ) -> Result<HostIndex, RenderError> {
        let planes = Planes::COLOR.with_depth(true).with_index(target.index.is_some());
        let plan = plan(&scene.cpu.summary, view, settings, planes, &CAPABILITIES)?;
        self.check_bindings(&plan)?;
        let (region, side) = (view.region, self.limits.texture_side);
        // Targets have a border for passes that read neighbours.
        let side = side.saturating_sub(2 * plan.reach_px());
        if region.width > side || region.height > side {
            let (width, height) = (region.width, region.height);
            return Err(failed(format!("the view is of {width}x{height} pixels, expected at most {side} a side")));
        }
        let frame_scene = FrameScene::new(&scene.cpu, view, &plan).with_host_shader(self.has_host_shader);
        let texels = self.shadow_maps(scene, &plan)?.0;
        let job = FrameJob { scene, shadow_texels: &texels, frame_scene: &frame_scene, view, plan: &plan };
        if let Some(index) = self.cells_to_view(encoder, &job, target)? {
            return Ok(index);
        }
        let mut data = self.host_tile(scene, &frame_scene, view, &plan)?;
        let mut samples = SamplePart::all(&scene.cpu, &frame_scene, view, &plan, (region, &data), scene.shared_records);
        let own = std::iter::once(&mut data).chain(samples.iter_mut().map(|part| &mut part.data));
        for data in own {
            self.host_work += data.host_work();
            data.check(self.limits).map_err(failed)?;
            data.set_host_depth(target.mapping.offset, target.mapping.scale);
            data.clear_background();
        }
        let frame = HostFrame::of(&plan, target);
        let floats = if frame.has_planes { data.planes.buffer_floats } else { 1 };
        let key = TargetKey { floats, ..self.key(&plan, &data) };
        let pixels: Vec<PixelPass> = PixelPass::of(&plan).into_iter().map(|pass| frame.pass(pass)).collect();
        let steps = schedule(&plan, &data.visible(), scene.shared_records);
        let device = self.device.clone();
        scoped(&device, || {
            for data in std::iter::once(&data).chain(samples.iter().map(|part| &part.data)) {
                self.prepare(key.clone(), &data.variants(), &pixels);
            }
            let host = |part| host_key(part, target);
            frame.parts.iter().for_each(|&part| self.pipelines.prepare_composite(&device, host(part)));
            let Some(targets) = &self.targets else { return };
            let none = empty(&device, "no shadow map", 4, wgpu::BufferUsages::STORAGE);
            let inputs = TileInputs {
                scene,
                pipelines: &self.pipelines,
                targets,
                frame: &frame_scene,
                data: &data,
                pixel_passes: &pixels,
                shadow_texels: &texels,
                drawn_shadow_texels: &none,
                host_depth: frame.reads_depth.then_some(target.depth),
            };
            let tile = Tile::new(&device, &self.queue, &inputs);
            for step in steps {
                match step {
                    Step::PixelPass(pass) if pass.is_shade() && !frame.has_planes => {}
                    Step::PixelPass(pass) => tile.step(encoder, &Step::PixelPass(frame.pass(pass)), None),
                    other => tile.step(encoder, &other, None),
                }
            }
            for part in &samples {
                let tile = Tile::new(&device, &self.queue, &TileInputs { data: &part.data, ..inputs });
                part.steps.iter().for_each(|step| tile.step(encoder, step, None));
            }
            frame.parts.iter().for_each(|&part| tile.composite(encoder, host(part), target));
        })?;
        self.errors.check()?;
        Ok(HostIndex(data))
    }

    /// Draws a frame by the compute path, and records the compositing of its planes into the application's target.
    /// Returns `None` and draws nothing if the frame is for raster hardware.
    fn cells_to_view(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        job: &FrameJob<'_>,
        target: &HostTarget<'_>,
    ) -> Result<Option<HostIndex>, RenderError> {
        let FrameJob { scene, frame_scene, view, plan, .. } = *job;
        // Layers of their own are cut off at the application's depth, which compute shaders don't read.
        let has_layers = PixelPass::of(plan).contains(&PixelPass::BeginLayers);
        let has_own_layers = has_layers && !plan.has(Pass::EdgeSamples);
        if self.path != GpuPath::Compute || has_own_layers || !self.path.draws_cells(plan) {
            return Ok(None);
        }
        let first = FrameTiles::new(&scene.cpu, frame_scene, view, plan, self.limits, self.path).next();
        let whole = first.transpose().map_err(failed)?.filter(|data| data.tile == view.region);
        let Some(data) = whole else { return Ok(None) };
        self.host_work += data.host_work();
        let mut tiles = CellTiles::new(data, &scene.cpu, frame_scene, view, plan);
        tiles.prepare_for_host(target.mapping.offset, target.mapping.scale);
        if !self.cell_tiles(job, &mut tiles, None, &mut Stats::default())? {
            return Ok(None);
        }
        let (Some(data), Some(targets)) = (tiles.into_pixels(), &self.targets) else { return Ok(None) };
        let parts = target.index.map(|_| Part::Index).into_iter().chain([Part::Planes]);
        let parts: Vec<HostKey> = parts.map(|part| host_key(part, target)).collect();
        let device = self.device.clone();
        scoped(&device, || {
            parts.iter().for_each(|&part| self.pipelines.prepare_composite(&device, part));
            let none = empty(&device, "no shadow map", 4, wgpu::BufferUsages::STORAGE);
            let inputs = TileInputs {
                scene,
                pipelines: &self.pipelines,
                targets,
                frame: frame_scene,
                data: &data,
                pixel_passes: &[],
                shadow_texels: job.shadow_texels,
                drawn_shadow_texels: &none,
                host_depth: None,
            };
            composite_planes(encoder, (&device, &self.queue), &inputs, &parts, target);
        })?;
        self.errors.check()?;
        Ok(Some(HostIndex(data)))
    }

    /// Returns the data of the single tile that is drawn into the application's target. Fails for trained Gaussians
    /// that take several tiles or dispatches.
    fn host_tile(
        &self,
        scene: &ResidentScene,
        frame: &FrameScene,
        view: &View,
        plan: &FramePlan,
    ) -> Result<TileData, RenderError> {
        if !plan.has(Pass::Gaussians) {
            return Ok(TileData::new(&scene.cpu, frame, view, plan, view.region));
        }
        let mut tiles = FrameTiles::new(&scene.cpu, frame, view, plan, self.limits, GpuPath::Raster);
        let unfinished = |what: &str| {
            failed(format!(
                "{what}, and into a host's target nothing is read back: choose `sort=center`, a smaller \
                            view or fewer Gaussians"
            ))
        };
        let data = tiles.next().unwrap_or_else(|| Err("the view has no pixels".to_owned())).map_err(failed)?;
        if data.tile != view.region {
            return Err(unfinished("the Gaussians in view are drawn in several parts"));
        }
        if data.gaussians.as_ref().is_some_and(|lists| !lists.is_single_dispatch()) {
            return Err(unfinished("only a readback tells how many passes these Gaussians take"));
        }
        Ok(data)
    }
}

/// Returns the key of the pipeline that composites a part of the image into a target.
fn host_key(part: Part, target: &HostTarget<'_>) -> HostKey {
    let (color, depth, compare) = (target.color_format, target.depth_format, target.mapping.compare);
    HostKey { part, color, depth, compare }
}

/// True if shaders can read a depth buffer: it has the usage, one sample per pixel and no stencil.
fn is_readable(depth: &wgpu::TextureView) -> bool {
    let texture = depth.texture();
    let stencil = texture.format().has_stencil_aspect();
    texture.usage().contains(wgpu::TextureUsages::TEXTURE_BINDING) && !stencil && texture.sample_count() == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_lack_all_that_the_backend_lacks() {
        assert!(surfel_gpu::UNSUPPORTED.iter().all(|feature| CAPABILITIES.lacks.contains(feature)));
    }
}
