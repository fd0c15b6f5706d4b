//! Render passes and framebuffers.

use crate::device::Device;
use crate::error::Failure;
use crate::memory::{Image, read_layout};
use crate::object::{Owned, destroy};
use ash::vk;
use std::sync::Arc;
use surfel_gpu::{Draw, Precision, Target, TargetFormat};

/// Returns the image format of a target at a precision of the sums.
pub(crate) fn format_of(target: Target, sums: Precision) -> vk::Format {
    match (target.format(), sums) {
        // Every device supports this format.
        (TargetFormat::Depth, _) => vk::Format::D32_SFLOAT,
        (TargetFormat::Sums4, Precision::F32) => vk::Format::R32G32B32A32_SFLOAT,
        (TargetFormat::Sums4, Precision::F16) => vk::Format::R16G16B16A16_SFLOAT,
        (TargetFormat::Sums2, Precision::F32) | (TargetFormat::Exact2, _) => vk::Format::R32G32_SFLOAT,
        (TargetFormat::Sums2, Precision::F16) => vk::Format::R16G16_SFLOAT,
        (TargetFormat::Exact1, _) => vk::Format::R32_SFLOAT,
    }
}

/// Returns the targets of a draw: colour targets, then the depth buffer.
pub(crate) fn attachments(draw: Draw) -> impl Iterator<Item = Target> {
    draw.colors().iter().copied().chain(draw.depth())
}

/// Two compatible render passes of a draw: the first clears its targets, the second keeps their contents.
pub(crate) struct Pass {
    clearing: Owned<vk::RenderPass>,
    loading: Owned<vk::RenderPass>,
    /// Number of targets.
    targets: usize,
}

impl Pass {
    /// Creates the render passes of a draw, for sums of this precision.
    pub(crate) fn new(device: &Arc<Device>, draw: Draw, precision: Precision) -> Result<Self, Failure> {
        let clearing = render_pass(device, draw, precision, vk::AttachmentLoadOp::CLEAR)?;
        let loading = render_pass(device, draw, precision, vk::AttachmentLoadOp::LOAD)?;
        Ok(Self { clearing, loading, targets: attachments(draw).count() })
    }

    /// Returns the render pass that clears its targets, or, if `clears` is false, the one that keeps their contents.
    /// Pipelines and framebuffers are compatible with both.
    pub(crate) fn raw(&self, clears: bool) -> vk::RenderPass {
        if clears { self.clearing.raw } else { self.loading.raw }
    }

    /// Returns a clear value for each target: zeros. A reversed depth of 0 means infinitely far.
    pub(crate) fn clear_values(&self) -> Vec<vk::ClearValue> {
        vec![vk::ClearValue { color: vk::ClearColorValue { float32: [0.0; 4] } }; self.targets]
    }
}

/// Creates a render pass of a draw that clears or loads its targets, as `load` says.
fn render_pass(
    device: &Arc<Device>,
    draw: Draw,
    precision: Precision,
    load: vk::AttachmentLoadOp,
) -> Result<Owned<vk::RenderPass>, Failure> {
    let descriptions: Vec<vk::AttachmentDescription> = attachments(draw)
        .map(|target| {
            let format = format_of(target, precision);
            vk::AttachmentDescription::default()
                .format(format)
                .samples(vk::SampleCountFlags::TYPE_1)
                .load_op(load)
                .store_op(vk::AttachmentStoreOp::STORE)
                .stencil_load_op(vk::AttachmentLoadOp::DONT_CARE)
                .stencil_store_op(vk::AttachmentStoreOp::DONT_CARE)
                .initial_layout(read_layout(format))
                .final_layout(read_layout(format))
        })
        .collect();
    let colors: Vec<vk::AttachmentReference> = (0..draw.colors().len() as u32)
        .map(|attachment| vk::AttachmentReference { attachment, layout: vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL })
        .collect();
    let depth = vk::AttachmentReference {
        attachment: colors.len() as u32,
        layout: vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
    };
    let subpass = vk::SubpassDescription::default()
        .pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)
        .color_attachments(&colors);
    let subpasses = [if draw.depth().is_some() { subpass.depth_stencil_attachment(&depth) } else { subpass }];
    // Image layouts change after all earlier commands and before all later ones.
    let (all, graphics) = (vk::PipelineStageFlags::ALL_COMMANDS, vk::PipelineStageFlags::ALL_GRAPHICS);
    let dependency = vk::SubpassDependency::default()
        .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
        .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE);
    let before = dependency.src_subpass(vk::SUBPASS_EXTERNAL).src_stage_mask(all).dst_stage_mask(graphics);
    let after = dependency.dst_subpass(vk::SUBPASS_EXTERNAL).src_stage_mask(graphics).dst_stage_mask(all);
    let dependencies = [before, after];
    let info = vk::RenderPassCreateInfo::default()
        .attachments(&descriptions)
        .subpasses(&subpasses)
        .dependencies(&dependencies);
    // SAFETY: references are to attachments of this pass, in layouts that fit their aspect.
    let raw = unsafe { device.raw.create_render_pass(&info, None) }?;
    Ok(Owned::new(device, raw, draw.name(), destroy!(destroy_render_pass)))
}

/// Creates a framebuffer of a render pass from images that all have this width and height.
pub(crate) fn framebuffer(
    device: &Arc<Device>,
    pass: &Pass,
    images: &[&Image],
    [width, height]: [u32; 2],
) -> Result<Owned<vk::Framebuffer>, Failure> {
    let views: Vec<vk::ImageView> = images.iter().map(|image| image.view()).collect();
    let info = vk::FramebufferCreateInfo::default()
        .render_pass(pass.raw(true))
        .attachments(&views)
        .width(width)
        .height(height)
        .layers(1);
    // SAFETY: the views have the pass's formats in order, and this size; they live as long as the framebuffer's owner.
    let raw = unsafe { device.raw.create_framebuffer(&info, None) }?;
    Ok(Owned::new(device, raw, "targets", destroy!(destroy_framebuffer)))
}
