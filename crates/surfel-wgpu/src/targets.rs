//! Textures and buffers of a tile, reused from frame to frame if their key is the same.

use crate::pipelines::{Pipelines, format_of};
use crate::scene::empty;
use std::collections::HashMap;
use surfel_gpu::{Draw, Target, TargetKey, Variant, layer_composite_bytes};

/// Textures and buffers that a tile's passes write, for one [`TargetKey`].
pub(crate) struct Targets {
    pub key: TargetKey,
    /// View of each target's texture.
    views: HashMap<Target, wgpu::TextureView>,
    /// Bind group of the textures, and of the layer composites, that each draw reads; none for draws that read neither
    /// or bind the same group as a pixel pass.
    reads: HashMap<Draw, wgpu::BindGroup>,
    /// Planes of the tile, which shading writes.
    pub planes: wgpu::Buffer,
    /// Composites of the transparent layers, one per pixel.
    pub layer_composites: wgpu::Buffer,
}

impl Targets {
    /// Creates the targets. The pipelines of the key's draws have to exist.
    pub(crate) fn new(device: &wgpu::Device, pipelines: &Pipelines, key: TargetKey) -> Self {
        let view = |target: Target| {
            let [width, height] = target.size(&key.draws, key.size);
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some(target.name()),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: format_of(target, key.precision),
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let views: HashMap<Target, wgpu::TextureView> =
            Target::ALL.into_iter().map(|target| (target, view(target))).collect();
        let planes = empty(
            device,
            "planes",
            4 * u64::from(key.floats),
            wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        );
        let layer_composites =
            empty(device, "layer composites", layer_composite_bytes(&key.draws, key.size), wgpu::BufferUsages::STORAGE);
        let reads =
            key.draws.iter().filter(|draw| draw.has_reads() && !draw.binds_as_pixel_pass()).filter_map(|&draw| {
                let layout = &pipelines.draw(draw, Variant::Whole, key.precision)?.reads_group.layout;
                let mut entries = entries(&views, draw.reads());
                let resource = layer_composites.as_entire_binding();
                let binding = draw.layer_composites_binding();
                entries.extend(binding.map(|binding| wgpu::BindGroupEntry { binding, resource }));
                Some((
                    draw,
                    device.create_bind_group(&wgpu::BindGroupDescriptor {
                        label: Some(draw.name()),
                        layout,
                        entries: &entries,
                    }),
                ))
            });
        let reads = reads.collect();
        Self { key, views, reads, planes, layer_composites }
    }

    /// Returns bind group entries for some of the textures. `reads` are pairs of binding and target.
    pub(crate) fn entries(&self, reads: &[(u32, Target)]) -> Vec<wgpu::BindGroupEntry<'_>> {
        entries(&self.views, reads)
    }

    /// Returns the view of a target's texture.
    pub(crate) fn view(&self, target: Target) -> Option<&wgpu::TextureView> {
        self.views.get(&target)
    }

    /// Returns the bind group of the textures and layer composites that a draw reads; `None` if it reads neither, or
    /// binds the same group as a pixel pass.
    pub(crate) fn reads(&self, draw: Draw) -> Option<&wgpu::BindGroup> {
        self.reads.get(&draw)
    }
}

fn entries<'a>(
    views: &'a HashMap<Target, wgpu::TextureView>,
    reads: &[(u32, Target)],
) -> Vec<wgpu::BindGroupEntry<'a>> {
    let entry = |&(binding, target): &(u32, Target)| {
        let resource = wgpu::BindingResource::TextureView(views.get(&target)?);
        Some(wgpu::BindGroupEntry { binding, resource })
    };
    reads.iter().filter_map(entry).collect()
}
