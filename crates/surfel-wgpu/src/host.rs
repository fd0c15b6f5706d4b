//! Draws into a host's render target, together with the host's own geometry.

use crate::error::{failed, scoped};
use crate::execute::{Tile, TileInputs};
use crate::host_target::HostTarget;
use crate::pipelines::{HostKey, Part};
use crate::renderer::Renderer;
use crate::scene::{ResidentScene, empty};
use surfel_gpu::{FrameScene, PixelPass, Step, TargetKey, TileData, schedule};
use surfel_model::Settings;
use surfel_render::{Capabilities, Feature, Planes, RenderError, View, plan};

/// Features that drawing into a host's target lacks.
///
/// - Edges by samples: the host's depth buffer has one depth per pixel, too few to test samples against.
/// - Trained Gaussians: they would have to be blended with the host's geometry fragment by fragment.
/// - A-buffers: the number of remaining layers would have to be read back.
/// - Balls: no variant of the pass that writes into a host's target shades them.
/// - The margin and a sky whose light isn't stored: no GPU backend draws them.
const CAPABILITIES: Capabilities = Capabilities {
    backend: crate::NAME,
    lacks: &[Feature::ABuffer, Feature::Balls, Feature::EdgeSamples, Feature::Gaussians, Feature::Margin, Feature::Sky],
};

impl Renderer {
    /// Draws a scene into a host's render target. Where the scene's surface passes the depth test, it replaces colour
    /// and depth; other pixels don't change. The scene's background is not drawn, and antialiased edges blend over the
    /// host's colours.
    ///
    /// Transparent splats blend over the host's colours, too, and don't write the depth. Splats that the host's
    /// geometry occludes are not drawn, which requires reading the depth buffer. If it can't be read (see
    /// [`HostTarget::depth`]), the scene's opaque surface, or else the nearest transparent one, decides for the whole
    /// pixel and writes its depth. The host's geometry between these surfaces is then lost: layers are composited front
    /// to back, but blending with the host's image is back to front.
    ///
    /// Records into `encoder`, which the host submits to the renderer's queue before the next call on this renderer.
    /// Nothing is read back, and no times are measured. `target` must have the size of the view's region.
    ///
    /// # Errors
    /// - [`RenderError::Model`] for settings out of range, [`RenderError::NoInteriorWeight`] for clouds that lack one;
    /// - [`RenderError::Unsupported`] for edges by samples, A-buffers, balls and trained Gaussians;
    /// - [`RenderError::Backend`] for a region larger than the largest texture, and for targets that wgpu refuses.
    pub fn render_to_view(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        target: &HostTarget<'_>,
    ) -> Result<(), RenderError> {
        let planes = Planes::COLOR.with_depth(true);
        let plan = plan(&scene.cpu.summary, view, settings, planes, &CAPABILITIES)?;
        let (region, side) = (view.region, self.limits.texture_side);
        // Targets have a border of a pixel for edges.
        let side = side.saturating_sub(2);
        if region.width > side || region.height > side {
            let (width, height) = (region.width, region.height);
            return Err(failed(format!("the view is of {width}x{height} pixels, expected at most {side} a side")));
        }
        let frame_scene = FrameScene::new(&scene.cpu, view, &plan);
        let mut data = TileData::new(&scene.cpu, &frame_scene, view, &plan, region);
        data.check(self.limits).map_err(failed)?;
        data.set_host_depth(target.mapping.offset, target.mapping.scale);
        // No plane is read back.
        let key = TargetKey { floats: 1, ..self.key(&plan, &data) };
        let texels = self.shadow_maps(scene, &plan)?.0;
        let mut pixels = PixelPass::of(&plan);
        let reads_depth = pixels.contains(&PixelPass::BeginLayers) && is_readable(target.depth);
        let parts: &[Part] = if reads_depth { &[Part::Opaque, Part::Layers] } else { &[Part::Whole] };
        let steps = schedule(&plan, &data.visible(), scene.shared_records);
        let in_host = |pixels: PixelPass| match pixels {
            PixelPass::BeginLayers if reads_depth => PixelPass::BeginLayersInHost,
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
            let host_depth = reads_depth.then_some(target.depth);
            let inputs = TileInputs {
                scene,
                pipelines: &self.pipelines,
                targets,
                frame: &frame_scene,
                data: &data,
                pixel_passes: &pixels,
                shadow_texels: &texels,
                drawn_shadow_texels: &none,
                host_depth,
            };
            let tile = Tile::new(&device, &self.queue, &inputs);
            for step in steps {
                match step {
                    Step::PixelPass(pixels) if pixels.is_shade() => {}
                    Step::PixelPass(pixels) => tile.step(encoder, &Step::PixelPass(in_host(pixels)), None),
                    other => tile.step(encoder, &other, None),
                }
            }
            parts.iter().for_each(|&part| tile.composite(encoder, host(part), target));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_lack_all_that_the_backend_lacks() {
        assert!(surfel_gpu::UNSUPPORTED.iter().all(|feature| CAPABILITIES.lacks.contains(feature)));
    }
}
