//! Layouts and pipelines, built once for each format of the sums.

use std::collections::HashMap;
use surfel_gpu::{Sums, slots};
use surfel_shaders::{BindingKind, ENTRIES, PASSES, Stage};

/// Depth buffer of the visibility pass.
pub(crate) const KEPT_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Precision of the sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Precision {
    F32,
    F16,
}

impl Precision {
    /// Of a target of four.
    pub(crate) fn four(self) -> wgpu::TextureFormat {
        match self {
            Self::F32 => wgpu::TextureFormat::Rgba32Float,
            Self::F16 => wgpu::TextureFormat::Rgba16Float,
        }
    }

    /// Of a target of one.
    pub(crate) fn one(self) -> wgpu::TextureFormat {
        match self {
            Self::F32 => wgpu::TextureFormat::R32Float,
            Self::F16 => wgpu::TextureFormat::R16Float,
        }
    }
}

/// Everything about shaders that is built once for a device.
pub(crate) struct Pipelines {
    module: wgpu::ShaderModule,
    pub frame_group: wgpu::BindGroupLayout,
    pub setup_group: wgpu::BindGroupLayout,
    pub records_group: wgpu::BindGroupLayout,
    pub kept_group: wgpu::BindGroupLayout,
    pub shade_group: wgpu::BindGroupLayout,
    pub setup: wgpu::ComputePipeline,
    pub shade: wgpu::ComputePipeline,
    pub visibility: wgpu::RenderPipeline,
    sums_layout: wgpu::PipelineLayout,
    sums: HashMap<(Sums, Precision), wgpu::RenderPipeline>,
    pub composite_group: wgpu::BindGroupLayout,
    composite_layout: wgpu::PipelineLayout,
    composites: HashMap<HostKey, wgpu::RenderPipeline>,
}

/// What a pipeline that composes into a host's picture depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct HostKey {
    pub color: wgpu::TextureFormat,
    pub depth: wgpu::TextureFormat,
    pub compare: wgpu::CompareFunction,
}

const VERTICES: [&str; 2] = ["visibility_vertex", "attribute_vertex"];

fn group(device: &wgpu::Device, label: &str, entries: &[&str], number: u32) -> wgpu::BindGroupLayout {
    let entries: Vec<wgpu::BindGroupLayoutEntry> = slots(entries, number)
        .iter()
        .map(|slot| wgpu::BindGroupLayoutEntry {
            binding: slot.binding,
            visibility: slot.stages.iter().fold(wgpu::ShaderStages::NONE, |all, stage| {
                all | match stage {
                    Stage::Vertex => wgpu::ShaderStages::VERTEX,
                    Stage::Fragment => wgpu::ShaderStages::FRAGMENT,
                    Stage::Compute => wgpu::ShaderStages::COMPUTE,
                }
            }),
            ty: binding_type(slot.kind),
            count: None,
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

fn binding_type(kind: BindingKind) -> wgpu::BindingType {
    let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let texture = |sample_type| wgpu::BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    match kind {
        BindingKind::Uniform => buffer(wgpu::BufferBindingType::Uniform),
        BindingKind::StorageRead => buffer(wgpu::BufferBindingType::Storage { read_only: true }),
        BindingKind::StorageWrite => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
        BindingKind::Texture => texture(wgpu::TextureSampleType::Float { filterable: false }),
        BindingKind::DepthTexture => texture(wgpu::TextureSampleType::Depth),
    }
}

impl Pipelines {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("surfel passes"),
            source: wgpu::ShaderSource::Wgsl(PASSES.into()),
        });
        let all: Vec<&str> = ENTRIES.iter().map(|entry| entry.name).collect();
        let fragments = [Sums::Color, Sums::Surface, Sums::Further].map(Sums::entry);
        let frame_group = group(device, "frame", &all, 0);
        let setup_group = group(device, "segment", &["setup"], 1);
        let records_group = group(device, "records", &VERTICES, 1);
        let kept_group = group(device, "kept", &fragments, 2);
        let shade_group = group(device, "sums", &["shade"], 1);
        let composite_group = group(device, "sums to compose", &["composite_fragment"], 1);
        let layout = |label, groups: &[&wgpu::BindGroupLayout]| {
            let bind_group_layouts: Vec<Option<&wgpu::BindGroupLayout>> = groups.iter().copied().map(Some).collect();
            device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(label),
                bind_group_layouts: &bind_group_layouts,
                immediate_size: 0,
            })
        };
        let compute = |entry, layout: &wgpu::PipelineLayout| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(layout),
                module: &module,
                entry_point: Some(entry),
                compilation_options: compilation(),
                cache: None,
            })
        };
        let setup = compute("setup", &layout("setup", &[&frame_group, &setup_group]));
        let shade = compute("shade", &layout("shade", &[&frame_group, &shade_group]));
        let visibility_layout = layout("visibility", &[&frame_group, &records_group]);
        let depth = depth_state(KEPT_FORMAT, wgpu::CompareFunction::Greater);
        let entries = [VERTICES[0], "visibility_fragment"];
        let visibility = drawing(device, &module, &visibility_layout, entries, Some(depth), &[]);
        let sums_layout = layout("attributes", &[&frame_group, &records_group, &kept_group]);
        let composite_layout = layout("composite", &[&frame_group, &composite_group]);
        Self {
            module,
            frame_group,
            setup_group,
            records_group,
            kept_group,
            shade_group,
            setup,
            shade,
            visibility,
            sums_layout,
            sums: HashMap::new(),
            composite_group,
            composite_layout,
            composites: HashMap::new(),
        }
    }

    /// The pipeline of a set of sums, built when it is first needed.
    pub(crate) fn prepare(&mut self, device: &wgpu::Device, sums: Sums, precision: Precision) {
        self.sums.entry((sums, precision)).or_insert_with(|| {
            let add = wgpu::BlendComponent {
                src_factor: wgpu::BlendFactor::One,
                dst_factor: wgpu::BlendFactor::One,
                operation: wgpu::BlendOperation::Add,
            };
            let target = |format| {
                let blend = Some(wgpu::BlendState { color: add, alpha: add });
                Some(wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL })
            };
            let (four, one) = (target(precision.four()), target(precision.one()));
            let targets = match sums {
                Sums::Color => vec![four],
                Sums::Surface => vec![four.clone(), four],
                Sums::Further => vec![four, one],
            };
            drawing(device, &self.module, &self.sums_layout, [VERTICES[1], sums.entry()], None, &targets)
        });
    }

    /// The pipeline that composes into a host's picture, built when it is first needed.
    pub(crate) fn prepare_composite(&mut self, device: &wgpu::Device, host: HostKey) {
        self.composites.entry(host).or_insert_with(|| {
            let target = wgpu::ColorTargetState { format: host.color, blend: None, write_mask: wgpu::ColorWrites::ALL };
            let entries = ["composite_vertex", "composite_fragment"];
            let depth = depth_state(host.depth, host.compare);
            drawing(device, &self.module, &self.composite_layout, entries, Some(depth), &[Some(target)])
        });
    }

    pub(crate) fn composite(&self, host: HostKey) -> Option<&wgpu::RenderPipeline> {
        self.composites.get(&host)
    }

    pub(crate) fn sums(&self, sums: Sums, precision: Precision) -> Option<&wgpu::RenderPipeline> {
        self.sums.get(&(sums, precision))
    }
}

/// No bounds are checked but those of buffers; every variable is written before it is read.
fn compilation() -> wgpu::PipelineCompilationOptions<'static> {
    wgpu::PipelineCompilationOptions { constants: &[], zero_initialize_workgroup_memory: false }
}

fn depth_state(format: wgpu::TextureFormat, compare: wgpu::CompareFunction) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format,
        depth_write_enabled: Some(true),
        depth_compare: Some(compare),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

/// A pipeline that draws strips without vertex buffers: records as quads, or one triangle over everything.
fn drawing(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    [vertex, fragment]: [&str; 2],
    depth_stencil: Option<wgpu::DepthStencilState>,
    targets: &[Option<wgpu::ColorTargetState>],
) -> wgpu::RenderPipeline {
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(fragment),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: compilation(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            ..wgpu::PrimitiveState::default()
        },
        depth_stencil,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: compilation(),
            targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}
