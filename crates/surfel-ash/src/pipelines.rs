//! Shaders, descriptor set layouts and pipelines. Each is built when it is first used, and then kept.

use crate::descriptors::{SetLayout, stage};
use crate::device::Device;
use crate::error::Failure;
use crate::object::{Owned, destroy};
use crate::passes::Pass;
use ash::vk;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::ffi::CString;
use std::sync::Arc;
use surfel_gpu::{Draw, PixelPass, Precision, Variant};
use surfel_shaders::{ENTRIES, SPIRV, Stage};

/// Key of the pipeline of a draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct DrawKey {
    draw: Draw,
    variant: Variant,
    precision: Precision,
}

/// Descriptor set layouts and pipelines of a device; each is built once.
pub(crate) struct Pipelines {
    device: Arc<Device>,
    cache: Owned<vk::PipelineCache>,
    /// Layout of the frame's set: the uniform, objects, lights, shadow maps and matcap.
    pub frame_set: SetLayout,
    /// Layout of the bindings of the frame's set that splat setup uses. With the whole set, setup would use more
    /// buffers than every device supports.
    pub setup_frame_set: SetLayout,
    /// Layout of the set of polygons.
    pub polygons_set: SetLayout,
    pixels: HashMap<PixelPass, PixelPipeline>,
    splats: HashMap<Variant, SplatPipeline>,
    draws: HashMap<DrawKey, DrawPipeline>,
    cells: HashMap<&'static str, CellPipeline>,
}

/// Pipeline of one entry point of the compute path, with the layouts of its sets. Each pipeline has its own layout of
/// the frame's set. With the whole set, some passes would use more buffers than every device supports.
pub(crate) struct CellPipeline {
    pub pipeline: Pipeline,
    pub frame_set: SetLayout,
    pub set: SetLayout,
}

/// Vulkan pipeline with its layout.
pub(crate) struct Pipeline {
    pub raw: Owned<vk::Pipeline>,
    pub layout: Owned<vk::PipelineLayout>,
}

/// Pipeline of a pixel pass, with the layout of its set.
pub(crate) struct PixelPipeline {
    pub pipeline: Pipeline,
    pub set: SetLayout,
}

/// Setup pipeline of a clip variant of splats ([`Variant`]), with the layouts of the sets of setup and of records.
pub(crate) struct SplatPipeline {
    pub setup: Pipeline,
    pub setup_set: SetLayout,
    pub records_set: SetLayout,
}

/// Pipeline of a draw, with its render pass.
pub(crate) struct DrawPipeline {
    pub pipeline: Pipeline,
    pub pass: Pass,
    /// Layout of the set of targets that the draw reads.
    pub reads_set: SetLayout,
}

impl Pipelines {
    /// Creates the layouts. No pipeline is built yet.
    pub(crate) fn new(device: &Arc<Device>) -> Result<Self, Failure> {
        // SAFETY: no requirement.
        let cache = unsafe { device.raw.create_pipeline_cache(&vk::PipelineCacheCreateInfo::default(), None) }?;
        let cache = Owned::new(device, cache, "pipelines", destroy!(destroy_pipeline_cache));
        let all: Vec<&str> = ENTRIES.iter().map(|entry| entry.name).collect();
        let setups = [Variant::Whole, Variant::Clipped].map(Variant::setup);
        let setup_frame_set = SetLayout::new(device, "frame of setup", &setups, 0)?;
        let drawn: Vec<&str> = all.into_iter().filter(|name| !setups.iter().any(|setup| setup == name)).collect();
        let frame_set = SetLayout::new(device, "frame", &drawn, 0)?;
        let polygons_set = SetLayout::new(device, "polygons", &["polygon_vertex", "polygon_fragment"], 1)?;
        Ok(Self {
            device: device.clone(),
            cache,
            frame_set,
            setup_frame_set,
            polygons_set,
            pixels: HashMap::new(),
            splats: HashMap::new(),
            draws: HashMap::new(),
            cells: HashMap::new(),
        })
    }

    /// Builds the pipeline of a pixel pass, if it doesn't exist.
    pub(crate) fn prepare_pixels(&mut self, pixels: PixelPass) -> Result<(), Failure> {
        let Entry::Vacant(place) = self.pixels.entry(pixels) else { return Ok(()) };
        let entry = pixels.entry();
        let set = SetLayout::new(&self.device, entry, &[entry], 1)?;
        let layout = pipeline_layout(&self.device, entry, &[&self.frame_set, &set])?;
        let raw = compute_pipeline(&self.device, self.cache.raw, layout.raw, entry)?;
        place.insert(PixelPipeline { pipeline: Pipeline { raw, layout }, set });
        Ok(())
    }

    /// Returns the pipeline of a pixel pass, or an error if it wasn't built.
    pub(crate) fn pixels(&self, pixels: PixelPass) -> Result<&PixelPipeline, Failure> {
        self.pixels.get(&pixels).ok_or_else(|| Failure::other("a pixel pass was recorded that was not prepared"))
    }

    /// Builds the pipeline of an entry point of the compute path, if it doesn't exist.
    pub(crate) fn prepare_cells(&mut self, entry: &'static str) -> Result<(), Failure> {
        let Entry::Vacant(place) = self.cells.entry(entry) else { return Ok(()) };
        let [frame_set, set] = [0, 1].map(|group| SetLayout::new(&self.device, entry, &[entry], group));
        let (frame_set, set) = (frame_set?, set?);
        let layout = pipeline_layout(&self.device, entry, &[&frame_set, &set])?;
        let raw = compute_pipeline(&self.device, self.cache.raw, layout.raw, entry)?;
        place.insert(CellPipeline { pipeline: Pipeline { raw, layout }, frame_set, set });
        Ok(())
    }

    /// Returns the pipeline of an entry point of the compute path, or an error if it wasn't built.
    pub(crate) fn cells(&self, entry: &str) -> Result<&CellPipeline, Failure> {
        self.cells.get(entry).ok_or_else(|| Failure::other("a pass over cells was recorded that was not prepared"))
    }

    /// Builds the setup pipeline of a clip variant of splats, if it doesn't exist.
    pub(crate) fn prepare_splats(&mut self, variant: Variant) -> Result<(), Failure> {
        let Entry::Vacant(place) = self.splats.entry(variant) else { return Ok(()) };
        let entry = variant.setup();
        let setup_set = SetLayout::new(&self.device, "segment", &[&entry], 1)?;
        let records_set = SetLayout::new(&self.device, "records", &variant.record_entry_points(), 1)?;
        let layout = pipeline_layout(&self.device, &entry, &[&self.setup_frame_set, &setup_set])?;
        let raw = compute_pipeline(&self.device, self.cache.raw, layout.raw, &entry)?;
        place.insert(SplatPipeline { setup: Pipeline { raw, layout }, setup_set, records_set });
        Ok(())
    }

    /// Returns the setup pipeline of a clip variant, or an error if it wasn't built.
    pub(crate) fn splats(&self, variant: Variant) -> Result<&SplatPipeline, Failure> {
        self.splats.get(&variant).ok_or_else(|| Failure::other("splats were drawn that were not prepared"))
    }

    /// Builds the pipeline of a draw, if it doesn't exist. The setup pipeline of the variant has to exist.
    pub(crate) fn prepare(&mut self, draw: Draw, variant: Variant, precision: Precision) -> Result<(), Failure> {
        let unprepared = || Failure::other("splats were drawn that were not prepared");
        let splats = self.splats.get(&variant).ok_or_else(unprepared)?;
        let Entry::Vacant(place) = self.draws.entry(DrawKey { draw, variant, precision }) else { return Ok(()) };
        let entries = draw.entries(variant);
        let [_, fragment] = &entries;
        let reads_set = SetLayout::new(&self.device, fragment, &[fragment], draw.reads_group())?;
        let mut sets = vec![&self.frame_set];
        sets.extend(draw.draws_records().then_some(&splats.records_set));
        sets.extend((draw == Draw::Polygons).then_some(&self.polygons_set));
        sets.extend(draw.has_reads().then_some(&reads_set));
        let layout = pipeline_layout(&self.device, fragment, &sets)?;
        let pass = Pass::new(&self.device, draw, precision)?;
        let raw = draw_pipeline(&self.device, self.cache.raw, layout.raw, pass.raw(true), (draw, &entries))?;
        place.insert(DrawPipeline { pipeline: Pipeline { raw, layout }, pass, reads_set });
        Ok(())
    }

    /// Returns the pipeline of a draw, or an error if it wasn't built.
    pub(crate) fn draw(&self, draw: Draw, variant: Variant, precision: Precision) -> Result<&DrawPipeline, Failure> {
        let found = self.draws.get(&DrawKey { draw, variant, precision });
        found.ok_or_else(|| Failure::other("a pass was recorded that was not prepared"))
    }
}

/// Creates a pipeline layout from the layouts of descriptor sets.
fn pipeline_layout(
    device: &Arc<Device>,
    name: &str,
    sets: &[&SetLayout],
) -> Result<Owned<vk::PipelineLayout>, Failure> {
    let sets: Vec<vk::DescriptorSetLayout> = sets.iter().map(|set| set.raw.raw).collect();
    let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets);
    // SAFETY: the set layouts are this device's; there are at most three, and every device supports four.
    let raw = unsafe { device.raw.create_pipeline_layout(&info, None) }?;
    Ok(Owned::new(device, raw, name, destroy!(destroy_pipeline_layout)))
}

/// Creates the shader module of an entry point. It can be destroyed once its pipeline exists.
fn shader_module(device: &Arc<Device>, name: &str) -> Result<Owned<vk::ShaderModule>, Failure> {
    let found = SPIRV.iter().find(|(entry, _)| *entry == name);
    let (_, code) = found.ok_or_else(|| Failure::other(format!("there is no shader {name}")))?;
    let info = vk::ShaderModuleCreateInfo::default().code(code);
    // SAFETY: the code is SPIR-V 1.3, which Vulkan 1.1 takes, and naga has validated it.
    let raw = unsafe { device.raw.create_shader_module(&info, None) }?;
    Ok(Owned::new(device, raw, name, destroy!(destroy_shader_module)))
}

/// Returns the name of an entry point as a C string.
fn entry_name(entry: &str) -> Result<CString, Failure> {
    CString::new(entry).map_err(Failure::other)
}

/// Takes ownership of the single pipeline that a call of Vulkan, with this result, created.
fn made(
    device: &Arc<Device>,
    name: &str,
    result: Result<Vec<vk::Pipeline>, (Vec<vk::Pipeline>, vk::Result)>,
) -> Result<Owned<vk::Pipeline>, Failure> {
    // After an error no pipeline exists, since the call requested only one.
    let pipelines = result.map_err(|(_, error)| error)?;
    let raw = *pipelines.first().ok_or(Failure::OutOfMemory)?;
    Ok(Owned::new(device, raw, name, destroy!(destroy_pipeline)))
}

/// Creates the compute pipeline of an entry point.
fn compute_pipeline(
    device: &Arc<Device>,
    cache: vk::PipelineCache,
    layout: vk::PipelineLayout,
    entry: &str,
) -> Result<Owned<vk::Pipeline>, Failure> {
    let (name, module) = (entry_name(entry)?, shader_module(device, entry)?);
    let shader =
        vk::PipelineShaderStageCreateInfo::default().stage(stage(Stage::Compute)).module(module.raw).name(&name);
    let info = vk::ComputePipelineCreateInfo::default().stage(shader).layout(layout);
    // SAFETY: the entry point is the module's, and the layout is made of its reflected bindings.
    let result = unsafe { device.raw.create_compute_pipelines(cache, &[info], None) };
    made(device, entry, result)
}

/// Creates a pipeline that draws triangle strips without vertex buffers: records as quads, or full-screen triangles.
fn draw_pipeline(
    device: &Arc<Device>,
    cache: vk::PipelineCache,
    layout: vk::PipelineLayout,
    pass: vk::RenderPass,
    (draw, [vertex, fragment]): (Draw, &[String; 2]),
) -> Result<Owned<vk::Pipeline>, Failure> {
    let names = [entry_name(vertex)?, entry_name(fragment)?];
    let modules = [shader_module(device, vertex)?, shader_module(device, fragment)?];
    let shader = |which, i: usize| {
        vk::PipelineShaderStageCreateInfo::default().stage(stage(which)).module(modules[i].raw).name(&names[i])
    };
    let stages = [shader(Stage::Vertex, 0), shader(Stage::Fragment, 1)];
    let no_vertices = vk::PipelineVertexInputStateCreateInfo::default();
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::TRIANGLE_STRIP);
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let raster = vk::PipelineRasterizationStateCreateInfo::default()
        .polygon_mode(vk::PolygonMode::FILL)
        .cull_mode(vk::CullModeFlags::NONE)
        .line_width(1.0);
    let samples = vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(draw.depth().is_some())
        .depth_write_enable(draw.depth().is_some())
        .depth_compare_op(vk::CompareOp::GREATER);
    let add = vk::PipelineColorBlendAttachmentState::default()
        .blend_enable(draw.is_additive())
        .src_color_blend_factor(vk::BlendFactor::ONE)
        .dst_color_blend_factor(vk::BlendFactor::ONE)
        .color_blend_op(vk::BlendOp::ADD)
        .src_alpha_blend_factor(vk::BlendFactor::ONE)
        .dst_alpha_blend_factor(vk::BlendFactor::ONE)
        .alpha_blend_op(vk::BlendOp::ADD)
        .color_write_mask(vk::ColorComponentFlags::RGBA);
    let blends = vec![add; draw.colors().len()];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&blends);
    let dynamic = [vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR];
    let dynamic = vk::PipelineDynamicStateCreateInfo::default().dynamic_states(&dynamic);
    let info = vk::GraphicsPipelineCreateInfo::default()
        .stages(&stages)
        .vertex_input_state(&no_vertices)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&raster)
        .multisample_state(&samples)
        .depth_stencil_state(&depth)
        .color_blend_state(&blend)
        .dynamic_state(&dynamic)
        .layout(layout)
        .render_pass(pass);
    // SAFETY: entry points are the module's, the layout is made of their reflected bindings, the blend states are as
    // many as the pass has colour targets, and all that `info` points to lives through the call.
    let result = unsafe { device.raw.create_graphics_pipelines(cache, &[info], None) };
    made(device, fragment, result)
}
