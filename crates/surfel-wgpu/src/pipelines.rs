//! Bind group layouts and pipelines. Each is built when it is first used, and then kept.

use crate::spirv;
use std::collections::HashMap;
use surfel_gpu::{
    BindingSlot, Draw, PixelPass, Precision, Target, TargetFormat, Variant, binding_slots, is_cell_entry,
};
use surfel_shaders::{BindingKind, ENTRIES, PASSES, Stage};

/// Returns the texture format of a target at a precision of the sums.
pub(crate) fn format_of(target: Target, sums: Precision) -> wgpu::TextureFormat {
    match (target.format(), sums) {
        (TargetFormat::Depth, _) => wgpu::TextureFormat::Depth32Float,
        (TargetFormat::Sums4, Precision::F32) => wgpu::TextureFormat::Rgba32Float,
        (TargetFormat::Sums4, Precision::F16) => wgpu::TextureFormat::Rgba16Float,
        (TargetFormat::Sums2, Precision::F32) | (TargetFormat::Exact2, _) => wgpu::TextureFormat::Rg32Float,
        (TargetFormat::Sums2, Precision::F16) => wgpu::TextureFormat::Rg16Float,
        (TargetFormat::Exact1, _) => wgpu::TextureFormat::R32Float,
    }
}

/// Part of the image that a pass composites into the application's render target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Part {
    /// The whole image at once.
    Whole,
    /// The opaque surface.
    Opaque,
    /// The transparent layers, blended over the target without a depth test. They are cut off at the application's
    /// depth.
    Layers,
    /// The whole image from the planes, with the application's depth test.
    Planes,
    /// The whole image from the planes, blended over the target without a depth test. It is cut off at the
    /// application's depth.
    PlanesOver,
    /// Numbers of the nearest splats, from the planes, into a texture of [`INDEX_FORMAT`].
    Index,
}

/// Format of the application's index texture, for the numbers of the nearest splats.
pub(crate) const INDEX_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Sint;

impl Part {
    /// Returns the name of the fragment entry point that composites the part.
    fn fragment(self) -> &'static str {
        match self {
            Self::Whole => "composite_fragment",
            Self::Opaque => "composite_opaque_fragment",
            Self::Layers => "composite_layers_fragment",
            Self::Planes => "composite_planes_fragment",
            Self::PlanesOver => "composite_planes_over_fragment",
            Self::Index => "composite_index_fragment",
        }
    }

    /// True if the pass tests against the application's depth buffer.
    pub(crate) fn has_depth(self) -> bool {
        !matches!(self, Self::Layers | Self::PlanesOver)
    }

    /// True if the pass reads the planes, false if it reads sums and layers.
    pub(crate) fn reads_planes(self) -> bool {
        matches!(self, Self::Planes | Self::PlanesOver | Self::Index)
    }
}

/// Key of a pipeline that composites into the application's render target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct HostKey {
    pub part: Part,
    pub color: wgpu::TextureFormat,
    pub depth: wgpu::TextureFormat,
    pub compare: wgpu::CompareFunction,
}

/// Key of the pipeline of a draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct DrawKey {
    draw: Draw,
    variant: Variant,
    precision: Precision,
}

/// Origin of the shaders of pipelines.
pub(crate) enum Shaders {
    /// A module of all passes in WGSL, with the application's shader function if there is one.
    Wgsl(wgpu::ShaderModule),
    /// The SPIR-V of each entry point, which was built with the project.
    Spirv,
}

impl Shaders {
    /// Returns the shaders of a device without a shader function of the application. They are in WGSL if `wgsl` is
    /// true.
    fn of(device: &wgpu::Device, wgsl: bool) -> Self {
        if spirv::is_passed(device) && !wgsl { Self::Spirv } else { Self::Wgsl(module(device, PASSES)) }
    }

    /// Returns a module with an entry point. `groups` are the bind groups of the pipeline.
    fn module(&self, device: &wgpu::Device, entry: &str, groups: &[&Group]) -> wgpu::ShaderModule {
        let bindings: Vec<&[u32]> = groups.iter().map(|group| group.bindings.as_slice()).collect();
        match self {
            Self::Wgsl(module) => module.clone(),
            Self::Spirv => spirv::module(device, entry, &bindings).unwrap_or_else(|| module(device, PASSES)),
        }
    }
}

/// Layout of a bind group.
pub(crate) struct Group {
    pub layout: wgpu::BindGroupLayout,
    /// Numbers of the bindings, in ascending order.
    bindings: Vec<u32>,
}

/// Layouts and pipelines of a device; each is built once.
pub(crate) struct Pipelines {
    shaders: Shaders,
    /// Layout of the group `frame`: the frame's uniform, objects, lights, shadow maps and matcap.
    pub frame_group: Group,
    /// Layout of those bindings of the group `frame` that splat setup uses. With the whole group, setup would bind more
    /// buffers than the limit that all adapters support.
    pub setup_frame_group: Group,
    splats: HashMap<Variant, SplatPipeline>,
    /// Layout of the sums and layers that are composited into the application's render target.
    pub composite_group: Group,
    /// Layout of the planes that are composited into the application's render target.
    pub host_planes_group: Group,
    /// Layout of the group of polygons.
    pub polygons_group: Group,
    pixels: HashMap<PixelPass, PixelPipeline>,
    draws: HashMap<DrawKey, DrawPipeline>,
    composites: HashMap<HostKey, wgpu::RenderPipeline>,
    cells: HashMap<&'static str, CellPipeline>,
}

/// Pipeline of one entry point of the compute path, with the layouts of its bind groups. Each pipeline has its own
/// layout of the frame's group. With the whole group, some passes would use more buffers than every adapter supports.
pub(crate) struct CellPipeline {
    pub raw: wgpu::ComputePipeline,
    pub frame_group: Group,
    pub group: Group,
}

/// Pipeline of a pixel pass, with the layout of its bind group.
pub(crate) struct PixelPipeline {
    pub raw: wgpu::ComputePipeline,
    pub group: Group,
}

/// Setup pipeline of a clip variant, with the layouts of the bind groups of setup and of records.
pub(crate) struct SplatPipeline {
    pub setup: wgpu::ComputePipeline,
    pub setup_group: Group,
    pub records_group: Group,
}

/// Pipeline of a draw, with the layout of the textures that it reads.
pub(crate) struct DrawPipeline {
    pub raw: wgpu::RenderPipeline,
    pub reads_group: Group,
}

/// Creates the layout of bind group number `number` from the bindings that the entry points use.
fn group(device: &wgpu::Device, label: &str, entries: &[impl AsRef<str>], number: u32) -> Group {
    let slots = binding_slots(entries, number);
    let entries: Vec<wgpu::BindGroupLayoutEntry> = slots
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
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries };
    let bindings = slots.iter().map(|slot| slot.binding).collect();
    Group { layout: device.create_bind_group_layout(&descriptor), bindings }
}

/// Returns the type of a binding in a layout.
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

/// Creates the shader module of a WGSL text of the passes.
pub(crate) fn module(device: &wgpu::Device, text: &str) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(text.into());
    device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some("surfel passes"), source })
}

/// Returns the largest number of storage buffers that any of these passes binds in compute shaders, including the
/// buffers of the group `frame`, which all passes share.
pub(crate) fn storage_buffers(passes: &[PixelPass]) -> u32 {
    let is_stored = |kind| matches!(kind, BindingKind::StorageRead | BindingKind::StorageWrite);
    let count = |slots: &[BindingSlot]| {
        let is_counted = |slot: &&BindingSlot| is_stored(slot.kind) && slot.stages.contains(&Stage::Compute);
        slots.iter().filter(is_counted).count() as u32
    };
    let own = passes.iter().map(|pass| count(&binding_slots(&[pass.entry()], 1))).max();
    count(&binding_slots(&drawn_entries(), 0)) + own.unwrap_or(0)
}

/// Returns the names of the entry points that share the layout of the group `frame`: all except setup and the compute
/// path.
fn drawn_entries() -> Vec<&'static str> {
    let setups = [Variant::Whole, Variant::Clipped].map(Variant::setup);
    let is_drawn = |name: &&str| !is_cell_entry(name) && !setups.iter().any(|setup| setup == name);
    ENTRIES.iter().map(|entry| entry.name).filter(is_drawn).collect()
}

impl Pipelines {
    /// Creates the layouts for the passes without a shader function of the application, which are in WGSL if `wgsl` is
    /// true. No pipeline is built yet.
    pub(crate) fn new(device: &wgpu::Device, wgsl: bool) -> Self {
        Self::of(device, Shaders::of(device, wgsl))
    }

    /// Creates the layouts for shaders of the passes. No pipeline is built yet.
    pub(crate) fn of(device: &wgpu::Device, shaders: Shaders) -> Self {
        let setups = [Variant::Whole, Variant::Clipped].map(Variant::setup);
        let setup_frame_group = group(device, "frame of setup", &setups, 0);
        let frame_group = group(device, "frame", &drawn_entries(), 0);
        let composite_group = group(device, "sums to compose", &["composite_fragment"], 1);
        let host_planes_group = group(device, "planes to compose", &[Part::Planes.fragment()], 1);
        let polygons_group = group(device, "polygons", &["polygon_vertex", "polygon_fragment"], 1);
        Self {
            shaders,
            frame_group,
            setup_frame_group,
            composite_group,
            host_planes_group,
            polygons_group,
            pixels: HashMap::new(),
            splats: HashMap::new(),
            draws: HashMap::new(),
            composites: HashMap::new(),
            cells: HashMap::new(),
        }
    }

    /// Builds the pipeline of a pixel pass, if it doesn't exist.
    pub(crate) fn prepare_pixels(&mut self, device: &wgpu::Device, pixels: PixelPass) {
        self.pixels.entry(pixels).or_insert_with(|| {
            let entry = pixels.entry();
            let group = group(device, entry, &[entry], 1);
            PixelPipeline { raw: compute(device, &self.shaders, entry, &[&self.frame_group, &group]), group }
        });
    }

    /// Returns the pipeline of a pixel pass, if it was built.
    pub(crate) fn pixels(&self, pixels: PixelPass) -> Option<&PixelPipeline> {
        self.pixels.get(&pixels)
    }

    /// Builds the pipeline of an entry point of the compute path, if it doesn't exist.
    pub(crate) fn prepare_cells(&mut self, device: &wgpu::Device, entry: &'static str) {
        self.cells.entry(entry).or_insert_with(|| {
            let [frame_group, own] = [0, 1].map(|number| group(device, entry, &[entry], number));
            let raw = compute(device, &self.shaders, entry, &[&frame_group, &own]);
            CellPipeline { raw, frame_group, group: own }
        });
    }

    /// Returns the pipeline of an entry point of the compute path, if it was built.
    pub(crate) fn cells(&self, entry: &str) -> Option<&CellPipeline> {
        self.cells.get(entry)
    }

    /// Builds the setup pipeline of a clip variant of splats, if it doesn't exist.
    pub(crate) fn prepare_splats(&mut self, device: &wgpu::Device, variant: Variant) -> &SplatPipeline {
        self.splats.entry(variant).or_insert_with(|| {
            let entry = variant.setup();
            let setup_group = group(device, &entry, &[&entry], 1);
            let records_group = group(device, "records", &variant.record_entry_points(), 1);
            let setup = compute(device, &self.shaders, &entry, &[&self.setup_frame_group, &setup_group]);
            SplatPipeline { setup, setup_group, records_group }
        })
    }

    /// Returns the setup pipeline of a clip variant, if it was built.
    pub(crate) fn splats(&self, variant: Variant) -> Option<&SplatPipeline> {
        self.splats.get(&variant)
    }

    /// Builds the pipeline of a draw, if it doesn't exist. The setup pipeline of the variant has to exist.
    pub(crate) fn prepare(&mut self, device: &wgpu::Device, draw: Draw, variant: Variant, precision: Precision) {
        let Some(splats) = self.splats.get(&variant) else { return };
        self.draws.entry(DrawKey { draw, variant, precision }).or_insert_with(|| {
            let entries = draw.entries(variant);
            let [vertex, fragment] = entries.each_ref().map(String::as_str);
            let reads_group = group(device, fragment, &[fragment], draw.reads_group());
            let mut groups = vec![&self.frame_group];
            groups.extend(draw.draws_records().then_some(&splats.records_group));
            groups.extend((draw == Draw::Polygons).then_some(&self.polygons_group));
            groups.extend(draw.has_reads().then_some(&reads_group));
            let depth = draw.depth().map(|t| depth_state(format_of(t, precision), wgpu::CompareFunction::Greater));
            let add = wgpu::BlendComponent {
                src_factor: wgpu::BlendFactor::One,
                dst_factor: wgpu::BlendFactor::One,
                operation: wgpu::BlendOperation::Add,
            };
            let targets: Vec<Option<wgpu::ColorTargetState>> = draw
                .colors()
                .iter()
                .map(|&target| {
                    let blend = draw.is_additive().then_some(wgpu::BlendState { color: add, alpha: add });
                    let format = format_of(target, precision);
                    Some(wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL })
                })
                .collect();
            let raw = drawing(device, &self.shaders, &groups, [vertex, fragment], depth, &targets);
            DrawPipeline { raw, reads_group }
        });
    }

    /// Returns the pipeline of a draw, if it was built.
    pub(crate) fn draw(&self, draw: Draw, variant: Variant, precision: Precision) -> Option<&DrawPipeline> {
        self.draws.get(&DrawKey { draw, variant, precision })
    }

    /// Builds the pipeline that composites a part of the image into the application's render target, if it doesn't
    /// exist.
    pub(crate) fn prepare_composite(&mut self, device: &wgpu::Device, host: HostKey) {
        self.composites.entry(host).or_insert_with(|| {
            let blend = Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING);
            let (format, blend) = match host.part {
                Part::Index => (INDEX_FORMAT, None),
                _ => (host.color, blend),
            };
            let target = wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL };
            let entries = ["fullscreen_vertex", host.part.fragment()];
            let depth = host.part.has_depth().then(|| wgpu::DepthStencilState {
                depth_write_enabled: Some(host.part != Part::Index),
                ..depth_state(host.depth, host.compare)
            });
            let own = if host.part.reads_planes() { &self.host_planes_group } else { &self.composite_group };
            drawing(device, &self.shaders, &[&self.frame_group, own], entries, depth, &[Some(target)])
        });
    }

    /// Returns the pipeline that composites a part of the image, if it was built.
    pub(crate) fn composite(&self, host: HostKey) -> Option<&wgpu::RenderPipeline> {
        self.composites.get(&host)
    }
}

/// Creates the compute pipeline of an entry point with these bind groups.
fn compute(device: &wgpu::Device, shaders: &Shaders, entry: &str, groups: &[&Group]) -> wgpu::ComputePipeline {
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&layout(device, entry, groups)),
        module: &shaders.module(device, entry, groups),
        entry_point: Some(entry),
        compilation_options: compilation(),
        cache: None,
    })
}

/// Creates a pipeline layout from the layouts of bind groups.
fn layout(device: &wgpu::Device, label: &str, groups: &[&Group]) -> wgpu::PipelineLayout {
    let bind_group_layouts: Vec<Option<&wgpu::BindGroupLayout>> =
        groups.iter().map(|group| Some(&group.layout)).collect();
    device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: &bind_group_layouts,
        immediate_size: 0,
    })
}

/// Returns options that don't zero workgroup memory, because shaders write it before they read it.
fn compilation() -> wgpu::PipelineCompilationOptions<'static> {
    wgpu::PipelineCompilationOptions { constants: &[], zero_initialize_workgroup_memory: false }
}

/// Returns the state of a depth buffer that is tested with `compare` and written.
fn depth_state(format: wgpu::TextureFormat, compare: wgpu::CompareFunction) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format,
        depth_write_enabled: Some(true),
        depth_compare: Some(compare),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

/// Creates a pipeline that draws triangle strips without vertex buffers: records as quads, or full-screen triangles.
fn drawing(
    device: &wgpu::Device,
    shaders: &Shaders,
    groups: &[&Group],
    [vertex, fragment]: [&str; 2],
    depth_stencil: Option<wgpu::DepthStencilState>,
    targets: &[Option<wgpu::ColorTargetState>],
) -> wgpu::RenderPipeline {
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(fragment),
        layout: Some(&layout(device, fragment, groups)),
        vertex: wgpu::VertexState {
            module: &shaders.module(device, vertex, groups),
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
            module: &shaders.module(device, fragment, groups),
            entry_point: Some(fragment),
            compilation_options: compilation(),
            targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}
