//! Textures and buffers of a tile, kept from frame to frame while they fit.

use crate::pipelines::{KEPT_FORMAT, Pipelines, Precision};
use crate::scene::empty;
use surfel_gpu::Sums;

/// What a tile's targets have to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TargetKey {
    pub size: [u32; 2],
    pub precision: Precision,
    pub surface: bool,
    pub further: bool,
    /// Floats of the planes.
    pub floats: u32,
}

pub(crate) struct Targets {
    pub key: TargetKey,
    pub kept: wgpu::TextureView,
    /// Colour, surface, material and count sums; 1×1 where they aren't needed.
    pub sums: [wgpu::TextureView; 4],
    pub planes: wgpu::Buffer,
    pub kept_group: wgpu::BindGroup,
    pub shade_group: wgpu::BindGroup,
    /// For composing into a host's picture.
    pub composite_group: wgpu::BindGroup,
}

impl Targets {
    pub(crate) fn new(device: &wgpu::Device, pipelines: &Pipelines, key: TargetKey) -> Self {
        let view = |label, format, needed: bool| {
            let [width, height] = if needed { key.size } else { [1, 1] };
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let (four, one) = (key.precision.four(), key.precision.one());
        let kept = view("kept depth", KEPT_FORMAT, true);
        let sums = [
            view("colour sums", four, true),
            view("surface sums", four, key.surface),
            view("material sums", four, key.further),
            view("fragment counts", one, key.further),
        ];
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let planes = empty(device, "planes", 4 * u64::from(key.floats), usage);
        let kept_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("kept"),
            layout: &pipelines.kept_group,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&kept) }],
        });
        let textures = sums.iter().map(wgpu::BindingResource::TextureView);
        let resources = textures.chain([planes.as_entire_binding()]);
        let entries: Vec<wgpu::BindGroupEntry<'_>> = resources
            .enumerate()
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding: binding as u32, resource })
            .collect();
        let shade_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("sums"),
            layout: &pipelines.shade_group,
            entries: &entries,
        });
        // The first three: colour, surface and material.
        let composed: Vec<wgpu::BindGroupEntry<'_>> = entries.iter().take(3).cloned().collect();
        let composite_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("sums to compose"),
            layout: &pipelines.composite_group,
            entries: &composed,
        });
        Self { key, kept, sums, planes, kept_group, shade_group, composite_group }
    }

    /// The targets that a pass writes.
    pub(crate) fn of(&self, sums: Sums) -> &[wgpu::TextureView] {
        match sums {
            Sums::Color => &self.sums[..1],
            Sums::Surface => &self.sums[..2],
            Sums::Further => &self.sums[2..],
        }
    }
}
